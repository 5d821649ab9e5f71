//! Clipping triangles loses nothing, shown in exact arithmetic, and hardly adds anything.

use num_rational::BigRational;
use proptest::prelude::*;
use raykd::{
    internals::kernels::{bounds::Bounds, build::clip::clip_plane, glam::Vec3},
    rays::Random,
};
use raykd_tests::{Failure, cases, exact};

type Triangle = [[f32; 3]; 3];

/// A triangle and a cell that have something to do with each other.
#[derive(Clone, Copy, Debug)]
struct Case {
    triangle: Triangle,
    lo: [f32; 3],
    hi: [f32; 3],
}

/// How coordinates come about.
#[derive(Clone, Copy, Debug)]
enum Style {
    /// Anywhere in a box of size 2.
    Plain,
    /// As in a scene: small triangles and a cell of about their size.
    Mesh,
    /// Small integers: what touches touches exactly.
    Lattice,
    /// Needles.
    Sliver,
    /// A cell much smaller than the triangle, near its plane, an edge or a corner.
    Tiny,
    /// Far from the origin.
    Far,
    /// Over many binades.
    Wild,
    /// A point or a segment.
    Degenerate,
    /// A corner of the triangle lies on the cell's face, edge or corner.
    Touching,
}

const STYLES: [Style; 9] = [
    Style::Plain,
    Style::Mesh,
    Style::Lattice,
    Style::Sliver,
    Style::Tiny,
    Style::Far,
    Style::Wild,
    Style::Degenerate,
    Style::Touching,
];

fn make(style: Style, seed: u64) -> Case {
    let mut random = Random::new(seed);
    let random = &mut random;
    let whole = |n: u64, r: &mut Random| (r.bits() % n) as f32;
    let mut t: Triangle = [(); 3].map(|()| random.point());
    let mut corners = [random.point(), random.point()];
    match style {
        Style::Plain => {}
        Style::Mesh => {
            let place = random.point();
            let near = |p: [f32; 3]| [0, 1, 2].map(|i| place[i] + 0.02 * p[i]);
            (t, corners) = (t.map(near), corners.map(near));
        }
        Style::Lattice => {
            t = [(); 3].map(|()| [(); 3].map(|()| whole(7, random)));
            corners = [(); 2].map(|()| [(); 3].map(|()| whole(7, random)));
        }
        Style::Sliver => {
            let width = 10f32.powf(-8.0 * random.unit() as f32);
            let at = (random.bits() % 2) as usize;
            t[2] = t[at].map(|x| x + width * random.signed());
            let along = random.unit() as f32;
            let size = 10f32.powf(-6.0 * random.unit() as f32);
            corners[0] = [0, 1, 2].map(|i| t[0][i] + along * (t[1][i] - t[0][i]) + size * random.signed());
            corners[1] = corners[0].map(|x| x + size * random.signed());
        }
        Style::Tiny => {
            let (u, v) = (random.unit() as f32, random.unit() as f32);
            let (u, v) = match random.bits() % 4 {
                0 => (u, 0.0),
                1 => (0.0, 0.0),
                _ => (u, v * (1.0 - u)),
            };
            let size = 10f32.powf(-7.0 * random.unit() as f32);
            corners[0] = [0, 1, 2].map(|i| {
                t[0][i] + u * (t[1][i] - t[0][i]) + v * (t[2][i] - t[0][i]) + size * random.signed()
            });
            corners[1] = corners[0].map(|x| x + size * random.signed());
        }
        Style::Far => {
            let by = random.point().map(|x| x * 10f32.powf(7.0 * random.unit() as f32));
            let add = |p: [f32; 3]| [0, 1, 2].map(|i| p[i] + by[i]);
            (t, corners) = (t.map(add), corners.map(add));
        }
        Style::Wild => {
            // From the largest extent that is not scaled down to the smallest coordinate that is not dust.
            let mut x = || random.signed() * (20.0 - whole(90, random)).exp2();
            (t, corners) = ([(); 3].map(|()| [(); 3].map(|()| x())), [(); 2].map(|()| [(); 3].map(|()| x())));
        }
        Style::Degenerate => {
            let along = random.unit() as f32;
            let b = if random.bits().is_multiple_of(3) { t[0] } else { t[1] };
            t = [t[0], b, if random.bits().is_multiple_of(2) { t[0] } else { b }];
            if random.bits().is_multiple_of(2) {
                t = t.map(|p| p.map(|x| (x * 4.0).round()));
                corners = corners.map(|p| p.map(|x| (x * 4.0).round()));
            } else if random.bits().is_multiple_of(2) {
                corners[0] = [0, 1, 2].map(|i| t[0][i] + along * (t[1][i] - t[0][i]));
            }
        }
        Style::Touching => {
            for axis in 0..3 {
                if random.bits().is_multiple_of(2) {
                    corners[(random.bits() % 2) as usize][axis] = t[0][axis];
                }
            }
        }
    }
    // Flat cells too.
    if random.bits().is_multiple_of(8) {
        let axis = (random.bits() % 3) as usize;
        corners[1][axis] = corners[0][axis];
    }
    let [p, q] = corners;
    let pick = |f: fn(f32, f32) -> f32| [0, 1, 2].map(|i| f(p[i], q[i]));
    Case { triangle: t, lo: pick(f32::min), hi: pick(f32::max) }
}

fn any_case() -> impl Strategy<Value = Case> {
    (prop::sample::select(STYLES.to_vec()), any::<u64>()).prop_map(|(style, seed)| make(style, seed))
}

fn bounds(lo: [f32; 3], hi: [f32; 3]) -> Bounds {
    Bounds { lo: Vec3::from_array(lo), hi: Vec3::from_array(hi) }
}

/// The box of a polygon.
fn around(polygon: &[exact::Point]) -> Option<[(BigRational, BigRational); 3]> {
    let side = |i: usize| {
        let along = || polygon.iter().map(|p| &p[i]);
        Some((along().min()?.clone(), along().max()?.clone()))
    };
    Some([side(0)?, side(1)?, side(2)?])
}

/// Checks that a box holds a polygon, and returns how far it reaches beyond on each axis.
fn holds(found: &Bounds, polygon: &[exact::Point]) -> Result<Option<[f64; 3]>, Failure> {
    let Some(exactly) = around(polygon) else { return Ok(None) };
    if found.is_empty() {
        return Err(Failure(format!("{found:?} is empty, but the intersection is not: {polygon:?}")));
    }
    let mut beyond = [0.0; 3];
    for (i, (lo, hi)) in exactly.iter().enumerate() {
        let (found_lo, found_hi) = (exact::rational(found.lo[i]), exact::rational(found.hi[i]));
        if *lo < found_lo || found_hi < *hi {
            return Err(Failure(format!(
                "on axis {i} the box {found:?} does not hold {} to {}",
                exact::rough(lo),
                exact::rough(hi)
            )));
        }
        beyond[i] = exact::rough(&(lo - found_lo)).max(exact::rough(&(found_hi - hi)));
    }
    Ok(Some(beyond))
}

fn inside(inner: &Bounds, outer: &Bounds) -> bool {
    inner.is_empty() || inner.and(outer) == *inner
}

fn corners(triangle: Triangle) -> [Vec3; 3] {
    triangle.map(Vec3::from_array)
}

/// A triangle's box, cut at all faces of a cell.
fn clip(a: Vec3, b: Vec3, c: Vec3, cell: &Bounds) -> Bounds {
    (0..3).fold(Bounds::of(a, b, c), |part, axis| {
        let part = clip_plane(a, b, c, &part, axis, cell.hi[axis as usize]).0;
        clip_plane(a, b, c, &part, axis, cell.lo[axis as usize]).1
    })
}

fn check(case: &Case) -> Result<Option<[f64; 3]>, Failure> {
    let [a, b, c] = corners(case.triangle);
    let cell = bounds(case.lo, case.hi);
    let found = clip(a, b, c, &cell);
    if !inside(&found, &cell.and(&Bounds::of(a, b, c))) {
        return Err(Failure(format!("{found:?} is larger than the cell or the triangle's box")));
    }
    holds(&found, &exact::clip(case.triangle, case.lo, case.hi))
}

proptest! {
    #![proptest_config(cases(4000))]
    #[test]
    fn clipping_to_a_cell_loses_nothing(case in any_case()) {
        check(&case)?;
    }

    #[test]
    fn clipping_by_planes_loses_nothing(case in any_case(), order in any::<u64>()) {
        // Towards the cell plane by plane, in any order, as a builder does; the other halves count as well.
        let [a, b, c] = corners(case.triangle);
        let mut left = Bounds::of(a, b, c);
        let all = [f32::MIN; 3];
        let (mut lo, mut hi) = (all, all.map(|x| -x));
        let mut random = Random::new(order);
        for _ in 0..8 {
            let (axis, upper) = ((random.bits() % 3) as usize, random.bits().is_multiple_of(2));
            let at = if upper { case.hi[axis] } else { case.lo[axis] };
            let (below, above) = clip_plane(a, b, c, &left, axis as u32, at);
            let (keep, other) = if upper { (below, above) } else { (above, below) };
            prop_assert!(inside(&below, &left) && inside(&above, &left));
            let (mut other_lo, mut other_hi) = (lo, hi);
            if upper {
                hi[axis] = hi[axis].min(at);
                other_lo[axis] = other_lo[axis].max(at);
            } else {
                lo[axis] = lo[axis].max(at);
                other_hi[axis] = other_hi[axis].min(at);
            }
            holds(&other, &exact::clip(case.triangle, other_lo, other_hi))?;
            holds(&keep, &exact::clip(case.triangle, lo, hi))?;
            left = keep;
        }
    }
}

#[test]
fn the_check_notices_a_unit_in_the_last_place() {
    let mut noticed = 0;
    for seed in 0..200 {
        let Case { triangle, lo, hi } = make(Style::Plain, seed);
        let polygon = exact::clip(triangle, lo, hi);
        let Some(exactly) = around(&polygon) else { continue };
        // The largest box that is too small, on one axis.
        let axis = seed as usize % 3;
        let (mut tight_lo, mut tight_hi) = (lo, hi);
        let edge = exact::rough(&exactly[axis].0) as f32;
        let least = if exact::rational(edge) > exactly[axis].0 { edge } else { edge.next_up() };
        tight_lo[axis] = least;
        holds(&bounds(tight_lo, hi), &polygon).expect_err("a corner is outside");
        let edge = exact::rough(&exactly[axis].1) as f32;
        tight_hi[axis] = if exact::rational(edge) < exactly[axis].1 { edge } else { edge.next_down() };
        holds(&bounds(lo, tight_hi), &polygon).expect_err("a corner is outside");
        noticed += 1;
    }
    assert!(noticed > 30, "{noticed}");
}

/// How far boxes reach beyond what is exact, in units in the last place of the triangle's largest coordinate.
#[test]
fn boxes_are_tight() {
    for style in STYLES {
        let (mut beyond, mut in_vain) = (Vec::new(), 0);
        for seed in 0..2000 {
            let case = make(style, seed);
            let [a, b, c] = corners(case.triangle);
            match check(&case).unwrap_or_else(|e| panic!("{case:?}: {e}")) {
                Some(by) => {
                    let far =
                        case.triangle.as_flattened().iter().fold(f32::MIN_POSITIVE, |m, x| m.max(x.abs()));
                    beyond.push(by.into_iter().fold(0.0, f64::max) / (f64::from(far) * 2f64.powi(-23)));
                }
                None => in_vain += u32::from(!clip(a, b, c, &bounds(case.lo, case.hi)).is_empty()),
            }
        }
        beyond.sort_by(f64::total_cmp);
        let at = |share: f64| beyond[((beyond.len() - 1) as f64 * share) as usize];
        let (half, most, worst) = (at(0.5), at(0.95), at(1.0));
        println!(
            "{style:?}: {} boxes, half within {half:.1} ulp, 95 % within {most:.1}, all within {worst:.1}; {in_vain} others not empty",
            beyond.len()
        );
        // A face does not cut the edges that another has made: not every box is that of the polygon.
        if matches!(style, Style::Plain | Style::Mesh | Style::Far) {
            assert!(half <= 16.0, "{style:?}");
            assert!(in_vain <= (2000 - beyond.len() as u32) / 50, "{style:?}");
        }
    }
}
