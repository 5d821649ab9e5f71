//! The written rule of `raykd::mesh`: which triangles take part, and with which numbers.

use proptest::prelude::*;
use raykd::mesh::{Mesh, MeshError, Repairs};

/// A mesh in which no two triangles share a vertex.
fn soup(corners: &[[[f32; 3]; 3]]) -> Result<Mesh, MeshError> {
    let triangles = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Mesh::new(corners.as_flattened().to_vec(), triangles)
}

const UNIT: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// Some triangle with area, times a factor.
fn times(factor: f32) -> [[f32; 3]; 3] {
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.5], [0.0, 1.0, 0.0]].map(|p: [f32; 3]| p.map(|x| x * factor))
}

#[test]
fn zero_area_triangles_keep_their_number() {
    let point = [UNIT[1]; 3];
    let edge = [UNIT[0], UNIT[1], UNIT[0]];
    // Collinear, and a rounding error away from it.
    let line = [[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.7, 0.7, 0.7]];
    let sliver = [[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.7, 0.7, f32::from_bits(0.7f32.to_bits() + 1)]];
    let mesh = soup(&[point, UNIT, edge, line, sliver]).unwrap();
    assert_eq!(mesh.kept(), [1, 4]);
    assert_eq!(mesh.triangles().len(), 5);
    let mut repairs = Repairs::default();
    (repairs.zero_area, repairs.zero_area_at) = (3, Some(0));
    assert_eq!(*mesh.repairs(), repairs);
    // Far away without area: no part of the box.
    let far = [[9e30, 9e30, 9e30]; 3];
    let mesh = soup(&[far, UNIT]).unwrap();
    assert_eq!(mesh.bounds(), ([0.0; 3], [1.0, 1.0, 0.0]));
    assert_eq!(mesh.scale(), 1.0);
}

#[test]
fn a_mesh_without_any_area_is_fine() {
    let mesh = soup(&[[[1.0, 2.0, 3.0]; 3], [[-5.0, 2.0, 3.0]; 3]]).unwrap();
    assert_eq!(mesh.kept(), [0u32; 0]);
    assert_eq!(mesh.bounds(), ([0.0; 3], [0.0; 3]));
    assert_eq!(mesh.scaled_bounds(), ([0.0; 3], [0.0; 3]));
    assert_eq!(mesh.scale(), 1.0);
    assert_eq!(mesh.repairs().zero_area, 2);
}

#[test]
fn duplicates_are_counted_by_position_and_order() {
    let [a, b, c] = UNIT;
    let minus = [[-0.0, 0.0, -0.0], b, [-0.0, 1.0, 0.0]];
    let mesh =
        soup(&[UNIT, [b, c, a], minus, [a, c, b], UNIT, times(1.0), [b, c, a], [a; 3], [a; 3]]).unwrap();
    // `minus` and the second UNIT repeat the first, [b, c, a] repeats itself; zero-area ones do not count.
    assert_eq!((mesh.repairs().duplicates, mesh.repairs().duplicate_at), (3, Some(2)));
    assert_eq!((mesh.repairs().zero_area, mesh.repairs().zero_area_at), (2, Some(7)));
    assert_eq!(mesh.kept(), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(mesh.repairs().flushed, 0);
}

#[test]
fn minus_zero_reaches_no_kernel() {
    let mesh = soup(&[[[-0.0, 0.0, -0.0], [1.0, -0.0, 0.0], [0.0, 1.0, 0.0]]]).unwrap();
    assert!(mesh.positions()[0][0].is_sign_negative());
    assert!(mesh.scaled_positions().iter().all(|x| x.is_sign_positive()));
    let (lo, _) = mesh.scaled_bounds();
    assert!(lo.iter().all(|x| x.is_sign_positive()));
}

#[test]
fn dust_becomes_zero() {
    let limit = 2f32.powi(-60);
    let below = f32::from_bits(limit.to_bits() - 1);
    let mesh = soup(&[[[-below, 1e-40, limit], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]).unwrap();
    assert_eq!(mesh.repairs().flushed, 2);
    assert_eq!(mesh.scaled_positions()[..3], [0.0, 0.0, limit]);
    assert_eq!(mesh.bounds().0, [0.0; 3]);
    assert_eq!(mesh.positions()[0][1], 1e-40, "what was given stays as it was");

    // A triangle that is nothing but dust next to the others.
    let mesh = soup(&[UNIT, times(1e-30), times(1e-15)]).unwrap();
    assert_eq!(mesh.kept(), [0, 2]);
    assert_eq!((mesh.repairs().flushed, mesh.repairs().zero_area), (4, 1));

    // A huge sliver whose width is dust goes, and with it the reason to call anything else dust.
    let sliver = [[0.0, 0.0, 0.0], [1e20, 0.0, 0.0], [0.0, 1e-20, 0.0]];
    let mesh = soup(&[sliver, times(1e10), [[1e-3, 0.0, 0.0]; 3]]).unwrap();
    assert_eq!(mesh.kept(), [1]);
    assert_eq!(mesh.bounds(), ([0.0; 3], [1e10; 3]));
    assert_eq!((mesh.repairs().zero_area, mesh.repairs().flushed), (2, 1));
    assert_eq!(mesh.scaled_positions()[18], 1e-3 * mesh.scale());

    // A vertex that takes no part and does not fit the scale.
    let mesh = soup(&[[[1e30; 3]; 3], times(1e-15)]).unwrap();
    assert_eq!(mesh.kept(), [1]);
    assert_eq!(mesh.scaled_positions()[..9], [0.0; 9]);
}

#[test]
fn wild_scales_become_ordinary() {
    for (factor, scale) in [
        (1.0, 1.0),
        (2f32.powi(-10), 1.0),
        (2f32.powi(20), 1.0),
        (2f32.powi(-11), 2f32.powi(11)),
        (2f32.powi(21), 2f32.powi(-21)),
        (1e-20, 2f32.powi(67)),
        (1e-40, 2f32.powi(127)),
        (2f32.powi(-137), 2f32.powi(127)),
        (1e19, 2f32.powi(-63)),
        (1e38, 2f32.powi(-126)),
        (f32::MAX, 2f32.powi(-126)),
    ] {
        let mesh = soup(&[times(factor)]).unwrap_or_else(|e| panic!("{factor}: {e}"));
        assert_eq!(mesh.scale(), scale, "{factor}");
        let exact =
            times(factor).as_flattened().iter().map(|&x| f64::from(x) * f64::from(scale)).collect::<Vec<_>>();
        let given: Vec<f64> = mesh.scaled_positions().iter().map(|&x| x.into()).collect();
        assert_eq!(given, exact, "{factor}");
    }
    // From -MAX to MAX: an extent that f32 itself cannot hold.
    let mesh = soup(&[[[f32::MAX; 3], [-f32::MAX; 3], [f32::MAX, 0.0, 0.0]]]).unwrap();
    assert_eq!(
        mesh.scaled_bounds(),
        ([-4.0 * (1.0 - f32::EPSILON / 2.0); 3], [4.0 * (1.0 - f32::EPSILON / 2.0); 3])
    );
}

#[test]
fn too_small_is_an_error() {
    let error = soup(&[times(2f32.powi(-138))]).unwrap_err();
    assert!(matches!(error, MeshError::TooSmall { .. }));
    let message = error.to_string();
    assert!(message.starts_with("mesh: the mesh is only 2.8"), "{message}");
    assert!(message.ends_with("less than 2^-137 (5.7e-42); scale its coordinates up"), "{message}");
}

#[test]
fn arrays_are_checked() {
    let message = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| {
        Mesh::new(positions.to_vec(), triangles.to_vec()).unwrap_err().to_string()
    };
    let [a, b, c] = UNIT;
    assert_eq!(
        message(&[a, b, c, [0.0, f32::NAN, 0.0]], &[[0, 1, 2]]),
        "mesh, vertex 3: coordinate 'NaN' is not a finite 32-bit float; correct or remove this vertex"
    );
    assert_eq!(
        message(&UNIT, &[[0, 1, 2], [0, 1, 3]]),
        "mesh, triangle 1: vertex index 3 is out of range, the vertices are 0 to 2; correct or remove this face"
    );
    assert!(message(&UNIT, &[]).starts_with("mesh: there are no faces"));
    assert!(message(&[], &[[0, 0, 0]]).contains("there are no vertices"));
}

/// Corners of all sizes and signs, many of them equal, zero or subnormal.
fn corner() -> impl Strategy<Value = f32> {
    prop_oneof![
        (-3i8..4).prop_map(f32::from),
        any::<f32>().prop_filter("finite", |x| x.is_finite()),
        (-1f32..1.0),
        (-1f32..1.0).prop_map(|x| x * 1e-39),
    ]
}

proptest! {
    /// Whatever finite numbers come: no panic, and the promises hold.
    #[test]
    fn promises(
        corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(corner())), 1..12),
        shift in -100i32..100,
    ) {
        let factor = 2f32.powi(shift);
        let scaled = |x: f32| if (x * factor).is_finite() { x * factor } else { x };
        let corners: Vec<_> = corners.iter().map(|t| t.map(|p| p.map(scaled))).collect();
        let mesh = match soup(&corners) {
            Err(e) => {
                let too_small = matches!(e, MeshError::TooSmall { .. });
                prop_assert!(too_small);
                return Ok(());
            }
            Ok(mesh) => mesh,
        };
        prop_assert!(mesh.kept().windows(2).all(|w| w[0] < w[1]));
        prop_assert_eq!(mesh.kept().len() + mesh.repairs().zero_area as usize, corners.len());
        prop_assert!(mesh.scale().is_normal() && mesh.scale().to_bits() & 0x7f_ffff == 0);
        let positions = mesh.scaled_positions();
        let (lo, hi) = mesh.scaled_bounds();
        let mut tight = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for &t in mesh.kept() {
            for v in mesh.triangles()[t as usize] {
                for axis in 0..3 {
                    let x = positions[3 * v as usize + axis];
                    prop_assert!(x == 0.0 && x.is_sign_positive() || x.is_normal());
                    tight.0[axis] = tight.0[axis].min(x);
                    tight.1[axis] = tight.1[axis].max(x);
                    // Exact, but for dust.
                    let given = f64::from(mesh.positions()[v as usize][axis]) * f64::from(mesh.scale());
                    prop_assert!(f64::from(x) == given || x == 0.0 && given.abs() < 2f64.powi(-37));
                }
            }
        }
        prop_assert!(positions.iter().all(|x| x.is_finite()));
        if !mesh.kept().is_empty() {
            prop_assert_eq!((lo, hi), tight);
            let extent = (0..3).map(|a| f64::from(hi[a]) - f64::from(lo[a])).fold(0.0, f64::max);
            prop_assert!((2f64.powi(-10)..=2f64.powi(20)).contains(&extent), "{}", extent);
        }
    }

    /// Duplicates as the definition has them, counted the slow way.
    #[test]
    fn duplicates(corners in prop::collection::vec(
        prop::array::uniform3(prop::array::uniform3((0i8..2).prop_map(f32::from))), 1..60,
    )) {
        let mesh = soup(&corners).unwrap();
        let kept: Vec<_> = mesh.kept().iter().map(|&t| corners[t as usize]).collect();
        let slow: Vec<_> = (0..kept.len()).filter(|&i| kept[..i].contains(&kept[i])).collect();
        prop_assert_eq!(mesh.repairs().duplicates as usize, slow.len());
        prop_assert_eq!(mesh.repairs().duplicate_at, slow.first().map(|&i| mesh.kept()[i]));
        let flat = (0..corners.len() as u32).find(|t| !mesh.kept().contains(t));
        prop_assert_eq!(mesh.repairs().zero_area_at, flat);
    }

    /// Times a power of two, a mesh gives the kernels the same digits.
    #[test]
    fn scaling_loses_nothing(
        corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1f32..1.0)), 1..6),
        e in prop_oneof![-100i32..-40, 40i32..120],
    ) {
        let scale = |x: f32| (f64::from(x) * 2f64.powi(e)) as f32;
        let scaled: Vec<_> = corners.iter().map(|t| t.map(|p| p.map(scale))).collect();
        let (small, large) = (soup(&corners).unwrap(), soup(&scaled).unwrap());
        let ratio = f64::from(large.scale()) * 2f64.powi(e);
        prop_assert_eq!(small.kept(), large.kept());
        for (&a, &b) in small.scaled_positions().iter().zip(large.scaled_positions().iter()) {
            // Unless the digits were lost on the way here, to subnormals.
            if e > -60 || a.abs() > 1e-3 {
                prop_assert_eq!(f64::from(a) * ratio, f64::from(b));
            }
        }
    }
}
