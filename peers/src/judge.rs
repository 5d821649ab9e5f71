//! Who is right where two answers differ: the ray against the two triangles in question.

use crate::peer::{Answer, NEAR};
use raykd::{Mesh, Ray};
use raykd_oracle::judge::Sight;

/// How far a triangle may seem moved, in units of the largest coordinate: some ULP. What is nearer to an edge is left
/// to f32's rounding. Not a barycentric weight: a ten-thousandth of a small triangle is less than an ULP.
const SLACK: f64 = 32.0 / (1u32 << 24) as f64;

/// Counts of one peer's answers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Verdict {
    pub wrong: usize,
    pub unclear: usize,
}

/// Whether each of two answers is wrong beyond doubt.
pub fn judge(mesh: &Mesh, ray: &Ray, x: Answer, y: Answer) -> [bool; 2] {
    let near = f64::from(NEAR);
    if x.agrees(y) {
        return [false; 2];
    }
    let (lo, hi) = mesh.bounds();
    let size = lo.into_iter().chain(hi).chain(ray.origin).fold(0.0, |most, x| x.abs().max(most));
    let slack = SLACK * f64::from(size);
    let sight = |answer: Answer| {
        let corners = mesh.triangles()[answer.triangle as usize].map(|v| mesh.positions()[v as usize]);
        Sight::new(ray, &corners, slack)
    };
    let [sx, sy] = [x, y].map(|answer| answer.is_hit().then(|| sight(answer)));
    let wrong = |one: Answer, own: Option<Sight>, other: Option<Sight>| {
        let t = f64::from(one.t);
        let invented =
            own.is_some_and(|s| s.margin < -slack || t < s.t[0] * (1.0 - near) || t > s.t[1] * (1.0 + near));
        let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
        let missed = other.is_some_and(|s| {
            let seen = s.margin > slack && s.t[0] * (1.0 - near) > t_min && s.t[1] * (1.0 + near) < t_max;
            seen && (!one.is_hit() || t > s.t[1] * (1.0 + near))
        });
        invented || missed
    };
    [wrong(x, sx, sy), wrong(y, sy, sx)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ray of set b at the dragon, once counted against raykd: it passes 2.4e-9 beside triangle 864,305, a seventh
    /// of an ULP of the corners' coordinates, but 1.6e-4 of so small a triangle's height.
    #[test]
    fn less_than_an_ulp_beside_an_edge_both_are_right() {
        let corners = [
            [-0.043_573, 0.055_812_2, 0.033_312_5],
            [-0.043_923, 0.055_781_3, 0.033_312_5],
            [-0.043_573, 0.055_600_1, 0.032_962_5],
        ];
        let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
        let ray = Ray::new([0.08852, 0.19238, 0.2651], [-0.440_449_68, -0.455_767_12, -0.773_485_9]);
        let hit = Answer { triangle: 0, t: 0.300_040_84 };
        let miss = Answer { triangle: raykd::shared::MISS, ..hit };
        assert_eq!(judge(&mesh, &ray, hit, miss), [false; 2]);
        // Well beside it is wrong, and so is half way there.
        let beside = Ray { direction: [-0.440_449_68, -0.455, -0.773_485_9], ..ray };
        assert_eq!(judge(&mesh, &beside, hit, miss), [true, false]);
        assert_eq!(judge(&mesh, &ray, Answer { t: 0.15, ..hit }, miss), [true, false]);
    }
}
