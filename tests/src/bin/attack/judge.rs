//! What hits must be: asked of the oracle, on triangles that raykd never saw.

use crate::harness::{Good, Judged, holds, raykd, run};
use raykd::{
    Hit, Ray,
    rays::Random,
    stress::{is_ray, settled},
};
use raykd_oracle::Oracle;
use std::{fs, path::Path, rc::Rc};

/// How far, in units of the largest distance along an axis, the default test may see a corner moved: the contract's row
/// on accuracy.
const SLACK: f64 = 21.0 / (1u32 << 24) as f64;

/// Triangles, as whoever wrote a file meant them.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    oracle: Rc<Oracle>,
}

impl Reference {
    pub(crate) fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let oracle = Rc::new(Oracle::new(positions, triangles));
        Self { positions: positions.to_vec(), triangles: triangles.to_vec(), oracle }
    }

    /// A tetrahedron at the origin.
    pub(crate) fn tetra() -> Self {
        Self::new(
            &[[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]],
            &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        )
    }

    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    pub(crate) fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Elsewhere.
    pub(crate) fn moved(&self, by: [f32; 3]) -> Self {
        let positions: Vec<_> = self.positions.iter().map(|p| [0, 1, 2].map(|i| p[i] + by[i])).collect();
        Self::new(&positions, &self.triangles)
    }

    /// Rays at the middle, the edges and the corners of every triangle, from all around, and along the axes.
    pub(crate) fn rays(&self) -> Vec<Ray> {
        let mut random = Random::new(19);
        let mut rays = Vec::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
            for weights in
                [[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [3.0, 2.0, 1.0]]
            {
                let sum: f32 = weights.iter().sum();
                let at = [0, 1, 2].map(|i| (a[i] * weights[0] + b[i] * weights[1] + c[i] * weights[2]) / sum);
                let from = random.near(at, 9.0);
                rays.push(Ray::new(from, [0, 1, 2].map(|i| at[i] - from[i])));
                let axis = random.below(3);
                let direction = [0, 1, 2].map(|i| if i == axis { 1.0 } else { 0.0 });
                rays.push(Ray::new([0, 1, 2].map(|i| at[i] - 20.0 * direction[i]), direction));
            }
        }
        rays
    }

    /// Whether hits of the default test are right.
    pub(crate) fn judge(&self, rays: &[Ray], hits: &[Hit]) -> Result<(), String> {
        holds(rays.len() == hits.len(), || format!("{} hits of {} rays", hits.len(), rays.len()))?;
        for (ray, hit) in rays.iter().zip(hits) {
            judge(&self.oracle, self.triangles.len(), ray, hit, 1.0)?;
        }
        Ok(())
    }

    /// Has the program trace a file, and judges what it says. A refusal is one.
    pub(crate) fn trace(&self, folder: &Path, file: &str) -> Judged {
        let rays = self.rays();
        let bytes: &[u8] = bytemuck::cast_slice(&rays);
        fs::write(folder.join("rays"), bytes).map_err(|e| e.to_string())?;
        let mut command = raykd(folder, "trace --rays rays --hits hits --device cpu --threads 1");
        let ran = run(command.arg("--").arg(file))?;
        if !ran.status.success() {
            return ran.refused(&[]);
        }
        let bytes = fs::read(folder.join("hits")).map_err(|e| e.to_string())?;
        self.judge(&rays, &bytemuck::pod_collect_to_vec(&bytes))?;
        Ok(Good::Right)
    }
}

/// Whether a hit of the default test is right; `scale` is what the mesh is multiplied with.
pub(crate) fn judge(
    oracle: &Oracle,
    triangles: usize,
    ray: &Ray,
    hit: &Hit,
    scale: f32,
) -> Result<(), String> {
    let ray = settled(ray);
    let reach = oracle.reach(ray.origin);
    if !is_ray(&ray) || reach * f64::from(scale) >= f64::from(1 << 30) {
        let near = reach * f64::from(scale) < f64::from(1u32 << 31);
        return holds(!hit.is_hit() || (is_ray(&ray) && near), || {
            format!("{ray:?} is invalid and hit {hit:?}")
        });
    }
    let known = !hit.is_hit() || (hit.triangle as usize) < triangles;
    holds(known, || format!("{hit:?} of {triangles} triangles"))?;
    let crossings = oracle.crossings(&ray);
    match oracle.judge(&ray, &crossings, hit, SLACK * reach) {
        None => Ok(()),
        Some(fault) => Err(format!("{fault:?}: {hit:?} for {:?}, {ray:?}", crossings.first())),
    }
}
