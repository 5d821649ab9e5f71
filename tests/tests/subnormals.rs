//! Triangle tests on a CPU that is told to flush subnormal numbers, as GPUs may: the same bits.
#![cfg(target_arch = "x86_64")]

use raykd::{
    BuildOptions, Intersector, Mesh, Ray, Scene,
    internals::{
        WithTest,
        kernels::{
            glam::{Vec3, Vec4},
            math::div,
            trace::{
                frame::Frame,
                intersect::{Best, Intersector as Test, exact::Exact},
            },
        },
    },
    rays::Random,
    shared::{MISS, TreeHeader},
};
use raykd_tests::{cpu, same};

/// Runs something on a CPU that flushes subnormal results and operands, or does not.
#[inline(never)]
fn flushing<T>(flush: bool, run: impl FnOnce() -> T) -> T {
    // Bits 15 and 6 of the control word.
    let mut word = 0x1F80u32 | if flush { 0x8040 } else { 0 };
    // SAFETY: only the treatment of subnormals changes, and it is what it was before this function returns.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const word) };
    let found = run();
    word = 0x1F80;
    // SAFETY: as above; this is how Rust expects it.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const word) };
    found
}

/// Tests every triangle with every ray by a test, and gives `each` ray, triangle as leaves would keep it, and the best
/// hit, which is that of all triangles before, or if `alone` of this one.
fn tested<I: Test>(
    mesh: &Mesh,
    header: &TreeHeader,
    rays: &[Ray],
    alone: bool,
    mut each: impl FnMut([Vec4; 3], &Best),
) {
    let positions = mesh.scaled_positions();
    for ray in rays {
        let frame = Frame::of(ray, header);
        let frame = if I::WHOLE { frame.whole() } else { frame };
        let mut best = Best::NOTHING;
        for &id in mesh.kept().iter().filter(|_| frame.valid) {
            let [a, b, c] =
                mesh.triangles()[id as usize].map(|v| Vec3::from_slice(&positions[3 * v as usize..]));
            let corners = I::lay_out(a, b, c);
            if alone {
                best = Best::NOTHING;
            }
            I::new(&frame).test_unseen(&frame, id, corners, &mut best);
            if best.triangle == id {
                assert!(I::new(&frame).look(&frame, corners).1, "{ray:?} {id}");
            }
            each(corners.into(), &best);
        }
    }
}

/// Every triangle tested alone with every ray, by a test, and all together: bits of the hits, and of what leaves would
/// keep.
struct HitsOf<'a> {
    mesh: &'a Mesh,
    header: &'a TreeHeader,
    rays: &'a [Ray],
    flush: bool,
}

impl WithTest for HitsOf<'_> {
    type Output = Vec<u32>;

    fn with<I: Test>(self) -> Vec<u32> {
        let Self { mesh, header, rays, flush } = self;
        flushing(flush, || {
            let mut bits = Vec::new();
            for alone in [true, false] {
                tested::<I>(mesh, header, rays, alone, |corners, best| {
                    bits.extend(corners.iter().flat_map(|v| v.to_array().map(f32::to_bits)));
                    bits.push(best.triangle);
                    bits.extend(
                        [best.t, div(best.u, best.det), div(best.v, best.det)].map(|x| (x + 0.0).to_bits()),
                    );
                });
            }
            bits
        })
    }
}

/// A number of `range` binades that end at `2^-least`, or often 0.
fn spread(random: &mut Random, least: u32, range: u32) -> f32 {
    let bits = random.bits();
    let exponent = 127 - least + (bits >> 32) as u32 % range;
    let size = f32::from_bits(exponent << 23 | (bits as u32 & 0x7F_FFFF));
    [0.0, size, -size, size, -size, size, -size][(bits >> 24) as usize % 7]
}

/// A point some units in the last place away.
fn near(random: &mut Random, point: [f32; 3]) -> [f32; 3] {
    point.map(|x| f32::from_bits(x.to_bits() + if x == 0.0 { 0 } else { random.bits() as u32 % 8 }))
}

#[test]
fn a_device_that_flushes_subnormals_finds_the_same() {
    let mut random = Random::new(9);
    let mut hits = [0; Intersector::ALL.len()];
    for _ in 0..300 {
        // Triangles from the size of the mesh down to where coordinates end, some of them both large and small.
        let mut positions = Vec::new();
        let mut spans = Vec::new();
        for _ in 0..20 {
            let least = 1 + (random.bits() % 60) as u32;
            let span = [(least, 1 + least.min(6)), (60, 60)][usize::from(random.bits().is_multiple_of(4))];
            spans.push(span);
            let corner = |random: &mut Random| [(); 3].map(|()| spread(random, span.0, span.1));
            let a = corner(&mut random);
            // Every third so small that edges are a few units in the last place.
            let small = random.bits().is_multiple_of(3);
            for _ in 0..3 {
                positions.push(if small { near(&mut random, a) } else { corner(&mut random) });
            }
        }
        let mesh = Mesh::new(positions, (0..20).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap();
        let mut rays = Vec::new();
        for (triangle, &(least, range)) in mesh.triangles().iter().zip(&spans) {
            // At a corner, or at the middle, from afar or near.
            let [a, b, c] = triangle.map(|v| mesh.positions()[v as usize]);
            let middle = [0, 1, 2].map(|i| a[i] * 0.5 + b[i] * 0.25 + c[i] * 0.25);
            for target in [a, middle] {
                let (least, range) = [(least, range), (60, 60)][usize::from(random.bits().is_multiple_of(2))];
                let far = [(); 3].map(|()| spread(&mut random, least, range));
                let from = if random.bits().is_multiple_of(3) { near(&mut random, target) } else { far };
                rays.push(Ray::new(from, [0, 1, 2].map(|i| target[i] - from[i])));
            }
            let way = [(); 3].map(|()| spread(&mut random, least, range));
            rays.push(Ray { t_min: f32::NEG_INFINITY, ..Ray::new(middle, way) });
        }
        let header = *Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap().header();
        for (test, hits) in Intersector::ALL.iter().zip(&mut hits) {
            let hits_of = |flush| test.with(HitsOf { mesh: &mesh, header: &header, rays: &rays, flush });
            let kept = hits_of(false);
            same(test.name(), &kept, &hits_of(true)).unwrap();
            *hits += kept.chunks(16).filter(|words| words[12] != MISS).count();
        }
    }
    println!("hits: {hits:?}");
    assert!(hits.iter().all(|&n| n > 2000), "{hits:?}");
}

/// Triangles in planes across an axis, many in each, and rays that start next to those planes: of triangles that are
/// met at the same `t` the first one counts, however small that is.
#[test]
fn so_it_does_of_triangles_next_to_the_origin() {
    let mut random = Random::new(10);
    let mut near = 0;
    for _ in 0..300 {
        let (axis, planes) = (random.below(3), [0.0, 0.5, spread(&mut random, 60, 60)]);
        let mut positions = Vec::new();
        for i in 0..24 {
            // Around the axis.
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)] {
                let jitter = |random: &mut Random| random.unit() as f32 * 0.3;
                let mut corner = [0.0; 3];
                corner[axis] = planes[i % 3];
                corner[(axis + 1) % 3] = x + jitter(&mut random);
                corner[(axis + 2) % 3] = y + jitter(&mut random);
                positions.push(corner);
            }
        }
        let mesh = Mesh::new(positions, (0..24).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap();
        let rays: Vec<Ray> = (0..40)
            .map(|_| {
                let (mut from, mut way) = ([0.0; 3], [(); 3].map(|()| random.unit() as f32 - 0.5));
                let (binade, digits) = (1 + random.below(120) as u32, random.bits() as u32 >> 9);
                let height = f32::from_bits(binade << 23 | digits);
                from[axis] = planes[random.below(3)] + if random.below(2) == 0 { height } else { -height };
                way[axis] += 1.0;
                Ray { t_min: [0.0, f32::NEG_INFINITY][random.below(2)], ..Ray::new(from, way) }
            })
            .collect();
        let header = *Scene::build(cpu(), &mesh, &BuildOptions::default()).unwrap().header();
        let run = |flush| {
            flushing(flush, || {
                let mut bits = Vec::new();
                tested::<Exact>(&mesh, &header, &rays, false, |_, best| {
                    bits.extend([best.triangle, (best.t + 0.0).to_bits()]);
                });
                bits
            })
        };
        let kept: Vec<u32> = run(false);
        near += kept.chunks(2).filter(|hit| hit[0] != MISS && f32::from_bits(hit[1]).abs() < 1e-30).count();
        same("hits next to the origin", &kept, &run(true)).unwrap();
    }
    assert!(near > 10_000, "{near}");
}
