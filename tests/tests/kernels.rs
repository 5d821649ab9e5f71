//! Each kernel alone, and the arithmetic they stand on.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, Device, KdTree, Mesh, Scene,
    internals::{
        Cpu,
        kernels::{
            BY_DOUBLES, KERNELS, Order,
            build::tally::BLOCK,
            math::{div, ldexp, product_difference, product_difference_wide, quotient, ratio, whole},
        },
    },
    rays::Random,
    shared::{Content, limits::chunk},
};
use raykd_tests::{
    cases, cpu, devices,
    dispatches::Job,
    gpu,
    meshes::{Family, Recipe, small_mesh},
};
use std::collections::BTreeSet;

/// Builders that have all the kernels between them.
const BUILDERS: [Builder; 2] = [Builder::Binned, Builder::Exact];

fn either() -> impl Strategy<Value = Builder> {
    prop::sample::select(BUILDERS.to_vec())
}

proptest! {
    #![proptest_config(cases(48))]
    #[test]
    fn each_kernel_writes_the_same_bytes_on_every_device(
        recipe in small_mesh(), seed: u64, max_depth in 1u32..=48, builder in either(),
    ) {
        let options = BuildOptions::default().with_max_depth(max_depth).with_builder(builder);
        let devices: Vec<_> = devices().iter().map(|named| &named.device).collect();
        Job { mesh: &recipe.mesh(), options: &options, seed }.compare(&devices)?;
    }

    #[test]
    fn lane_order_changes_no_byte(recipe in small_mesh(), seed: u64, shuffle: u32, builder in either()) {
        let options = BuildOptions::default().with_builder(builder);
        let shuffled = Device::from(Cpu::default().in_order(Order::Shuffled(shuffle)));
        Job { mesh: &recipe.mesh(), options: &options, seed }.compare(&[cpu(), &shuffled])?;
    }
}

/// A GPU runs more than 32,768 workgroups in whole rows of so many, past the last that was asked for.
#[test]
fn workgroups_past_the_last_change_no_byte() {
    for row in [2, 7] {
        let in_rows = Device::from(Cpu::default().in_rows_of(row));
        for (builder, size) in LARGE {
            let mesh = Recipe { family: Family::Soup, size, seed: 2 }.mesh();
            let options = BuildOptions::default().with_builder(builder);
            Job { mesh: &mesh, options: &options, seed: 2 }.compare(&[cpu(), &in_rows]).unwrap();
        }
    }
}

/// Triangles for several chunks, and for more nodes on a level than one workgroup gives places to. `median` repeats
/// its build with twice the room, which takes the longer the larger the mesh is.
const LARGE: [(Builder, u32); 3] =
    [(Builder::Binned, BINNED), (Builder::Exact, 3000), (Builder::Median, 1500)];
const BINNED: u32 = 12_000;

#[test]
fn each_kernel_does_so_over_several_chunks_too() {
    let devices: Vec<_> = devices().iter().map(|named| &named.device).collect();
    for family in [Family::Soup, Family::Lattice] {
        // In a lattice `median` makes references until no list may grow, which takes minutes.
        let builders =
            LARGE.into_iter().filter(|&(builder, _)| (family, builder) != (Family::Lattice, Builder::Median));
        for (builder, size) in builders {
            let mesh = Recipe { family, size, seed: 1 }.mesh();
            let options = BuildOptions::default().with_builder(builder);
            if family == Family::Soup {
                let tree = Scene::build(devices[0], &mesh, &options).unwrap().tree().unwrap();
                let most = widest(&tree);
                assert!(
                    most > BLOCK as usize && size > 2 * chunk(size),
                    "{builder}: {most} nodes on a level"
                );
            }
            Job { mesh: &mesh, options: &options, seed: 1 }.compare(&devices).unwrap();
        }
    }
}

/// Chunks of the usual size are all that other tests have. llvmpipe has no room for a mesh with the longest.
#[test]
fn longer_chunks_make_the_same_tree_on_every_device() {
    let mesh = Mesh::teapot(91);
    let chunk_of = |triangles: usize| chunk(u32::try_from(triangles).unwrap());
    assert!(chunk_of(mesh.triangles().len()) > chunk(BINNED));
    let built = |device| Scene::build(device, &mesh, &BuildOptions::default()).unwrap().tree().unwrap();
    let digests: BTreeSet<_> = devices().iter().map(|named| built(&named.device).digest()).collect();
    assert_eq!(digests.len(), 1, "{digests:?}");
}

/// Most nodes on a level.
fn widest(tree: &KdTree) -> usize {
    let nodes = tree.view().nodes;
    let (mut level, mut most) = (vec![0], 0);
    while !level.is_empty() {
        most = most.max(level.len());
        level = level
            .into_iter()
            .flat_map(|at: u32| match nodes[at as usize].content() {
                Content::Inner { below, .. } => vec![below, below + 1],
                Content::Leaf { .. } => Vec::new(),
            })
            .collect();
    }
    most
}

#[test]
fn every_kernel_is_compared() {
    let kernels = |(builder, size)| {
        let mesh = Recipe { family: Family::Soup, size, seed: 1 }.mesh();
        let options = BuildOptions::default().with_builder(builder);
        Job { mesh: &mesh, options: &options, seed: 1 }.kernels(gpu()).unwrap()
    };
    let small = BUILDERS.map(|builder| (builder, 60));
    let seen: BTreeSet<_> = small.into_iter().chain([(Builder::Binned, BINNED)]).flat_map(kernels).collect();
    // Probes are compared by the executors' own tests: they ask what raykd need not rely on.
    let probes = ["probe", "doubles", "race"];
    let others = KERNELS.iter().chain(BY_DOUBLES).filter(|kernel| !probes.contains(&kernel.name()));
    let all: BTreeSet<_> = others.map(|kernel| kernel.entry_point()).collect();
    assert_eq!(seen, all);
}

/// A normal number of random bits with an exponent from `-spread` to `spread`.
fn number(random: &mut Random, spread: i32) -> f32 {
    let bits = random.bits();
    let exponent = (bits >> 40) as i32 % (2 * spread + 1) - spread;
    let mantissa = match bits & 7 {
        // The borders of a binade and their neighbours are where rounding goes wrong.
        0 => (bits >> 8 & 3) as u32,
        1 => 0x7F_FFFF - (bits >> 8 & 3) as u32,
        _ => (bits >> 8) as u32 & 0x7F_FFFF,
    };
    f32::from_bits((bits as u32 & 8) << 28 | ((exponent + 127) as u32) << 23 | mantissa)
}

/// The CPU's way to divide and the GPU's, which must be the same.
fn divided(a: f32, b: f32) -> f32 {
    let found = quotient(a, b);
    assert_eq!(found.to_bits(), div(a, b).to_bits(), "{a:e} / {b:e}");
    found
}

#[test]
fn a_ratio_is_off_by_little() {
    let mut random = Random::new(5);
    for mantissa in (0..1 << 23).step_by(3) {
        let a = number(&mut random, 20);
        let b = f32::from_bits(number(&mut random, 100).to_bits() & 0xFF80_0000 | mantissa);
        let (found, a, b) = (f64::from(ratio(a, b)), f64::from(a), f64::from(b));
        assert!((found * b - a).abs() <= 4.5 * 2f64.powi(-24) * a.abs(), "{a:e} / {b:e} = {found:e}");
    }
}

#[test]
fn division_is_rounded_correctly() {
    let mut random = Random::new(1);
    for i in 0..10_000_000 {
        let spread = if i % 2 == 0 { 3 } else { 62 };
        let (a, b) = (number(&mut random, spread), number(&mut random, spread));
        assert_eq!(divided(a, b).to_bits(), (a / b).to_bits(), "{a:e} / {b:e}");
    }
}

#[test]
fn division_of_near_ties_is_rounded_correctly() {
    // (n + 1/2 units) * b, rounded either way, divided by b: the quotient lies as close to a tie as it can.
    let mut random = Random::new(2);
    for _ in 0..2_000_000 {
        let (q, b) = (number(&mut random, 0), number(&mut random, 0));
        let tie = f64::from(q) + f64::from(q.signum()) * 0.5 * 2f64.powi(-23);
        let a = (tie * f64::from(b)) as f32;
        for a in [a, a.next_up(), a.next_down()] {
            assert_eq!(divided(a, b).to_bits(), (a / b).to_bits(), "{a:e} / {b:e}");
        }
    }
}

#[test]
fn division_at_the_ends_of_the_range() {
    let (min, max) = (f32::MIN_POSITIVE, f32::MAX);
    for (a, b, quotient) in [
        (0.0, 3.0, 0.0),
        (-0.0, 3.0, -0.0),
        (0.0, -3.0, -0.0),
        (3.0, 0.0, f32::INFINITY),
        (3.0, -0.0, f32::NEG_INFINITY),
        (-3.0, 0.0, f32::NEG_INFINITY),
        (max, 0.5, f32::INFINITY),
        (-max, min, f32::NEG_INFINITY),
        (max, max, 1.0),
        (min, min, 1.0),
        (max, 1.0, max),
        (min, 1.0, min),
        (min, -1.0, -min),
        (min, 2.0, 0.0),
        (-min, max, -0.0),
        // Subnormal operands count as zero.
        (min / 2.0, 1.0, 0.0),
        (1.0, min / 2.0, f32::INFINITY),
    ] {
        assert_eq!(divided(a, b).to_bits(), f32::to_bits(quotient), "{a:e} / {b:e}");
    }
    let mut random = Random::new(3);
    for _ in 0..2_000_000 {
        let (a, b) = (number(&mut random, 126), number(&mut random, 126));
        let (found, native) = (divided(a, b), a / b);
        let exact = (f64::from(a) / f64::from(b)).abs();
        if exact < f64::from(min) {
            assert!(found == 0.0 || exact > f64::from(min.next_down()), "{a:e} / {b:e} = {found:e}");
        } else {
            assert_eq!(found.to_bits(), native.to_bits(), "{a:e} / {b:e}");
        }
    }
}

#[test]
fn whole_parts_are_those_of_a_conversion() {
    let numbers = (0..=4096u16).map(|i| f32::from(i) / 128.0);
    let others =
        [-0.0, 1e-40, -1e-40, -1.0, 2_147_483_648.0, f32::MAX, f32::MIN, f32::INFINITY, -f32::INFINITY];
    for a in numbers.chain(others).chain([f32::NAN, -f32::NAN]) {
        assert_eq!(whole::<20>(a), (a as u32).min(20), "{a:e}");
    }
}

#[test]
fn ldexp_scales_exactly_or_flushes() {
    let mut random = Random::new(4);
    for _ in 0..1_000_000 {
        let a = number(&mut random, 126);
        let e = (random.bits() % 600) as i32 - 300;
        let exact = f64::from(a) * 2f64.powi(e);
        let expected =
            if exact.abs() < f64::from(f32::MIN_POSITIVE) { 0.0f32.copysign(a) } else { exact as f32 };
        assert_eq!(ldexp(a, e).to_bits(), expected.to_bits(), "{a:e} * 2^{e}");
    }
    assert_eq!(ldexp(f32::INFINITY, -300), f32::INFINITY);
    assert_eq!(ldexp(1e-40, 30), 0.0);
    assert_eq!(ldexp(-0.0, 5).to_bits(), (-0.0f32).to_bits());
}

#[test]
fn product_differences_have_exact_signs_and_accurate_sizes() {
    let mut random = Random::new(5);
    let (mut tight, mut zeros) = (0, 0);
    for round in 0..200_000 {
        // Products that agree in as many digits as can be, over all exponents, underflowing ones too.
        let spread = if round % 2 == 0 { 16 } else { 100 };
        let (a, b, c) =
            (number(&mut random, spread), number(&mut random, spread), number(&mut random, spread));
        let near = (f64::from(a) * f64::from(b) / f64::from(c)) as f32;
        for (c, d) in [
            (c, near),
            (c, near.next_up()),
            (c, near.next_down()),
            (b, a),
            (-a, -b),
            (a, b.next_up()),
            (c, a),
        ] {
            // Products of two f32 are exact in f64, and so is their difference where they are close.
            let exact = f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d);
            let right = |found: f64| {
                found == exact || (found - exact).abs() <= exact.abs() * 2f64.powi(-22) && found * exact > 0.0
            };
            if !d.is_normal() {
                continue;
            }
            zeros += u32::from(exact == 0.0);
            tight += u32::from(exact != 0.0 && exact.abs() < f64::from(a * b).abs() * 2f64.powi(-24));
            let (value, exponent) = product_difference_wide(a, b, c, d);
            // The exponent is the difference's own: who compares exponents compares sizes.
            assert!(
                value == 0.0 && exponent < -500 || (1.0..2.0).contains(&value.abs()),
                "{value:e}, {exponent}"
            );
            let found = f64::from(value) * 2f64.powi(exponent);
            assert!(right(found), "{a:e} * {b:e} - {c:e} * {d:e} is {exact:e}, found {found:e}");
            if spread == 16 {
                let found = f64::from(product_difference(a, b, c, d));
                assert!(right(found), "{a:e} * {b:e} - {c:e} * {d:e} is {exact:e}, found {found:e}");
            }
        }
    }
    assert!(zeros > 100_000 && tight > 100_000, "{zeros}, {tight}");
}

#[test]
fn product_differences_with_zeros() {
    let small = f32::MIN_POSITIVE;
    for (a, b, c, d, expected) in [
        (0.0, 1.0, 1.0, 0.0, 0.0),
        (0.0, -1.0, 1.0, 0.0, 0.0),
        (0.0, small, -0.0, small, 0.0),
        (3.0, 1.0, 0.0, 1.0, 3.0),
        (0.0, 1.0, 0.5, -2.0, 1.0),
    ] {
        let (value, exponent) = product_difference_wide(a, b, c, d);
        assert_eq!(
            f64::from(value) * 2f64.powi(exponent.max(-500)),
            expected,
            "{a:e} * {b:e} - {c:e} * {d:e}"
        );
        if b != small {
            assert_eq!(f64::from(product_difference(a, b, c, d)), expected, "{a:e} * {b:e} - {c:e} * {d:e}");
        }
    }
}
