//! Ambient occlusion: how much of the sky each point of a surface sees. [`look`] runs on GPU and CPU, and gives the
//! same bytes: beside raykd it has integers, and floats with `+ - *` and comparisons alone.
#![no_std]

#[cfg(target_arch = "spirv")]
pub mod nearest;
mod random;

use raykd_kernels::{glam::Vec3, trace::single::Tree};
use raykd_shared::{Hit, Ray};

/// Rays a point.
pub const RAYS: u32 = 16;
/// Stands for a count where a driver left a loop early.
pub const CUT_SHORT: u32 = u32::MAX;

/// What a ray of a camera sees.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Seen {
    /// Where it hits.
    pub hit: Hit,
    /// How many of [`RAYS`] rays from there, on the side it comes from, meet nothing.
    pub open: u32,
}

/// Where a ray leaves a surface: a little nearer than the hit, so that it does not meet the same triangle.
const NEARER: f32 = 1.0 - 1.0 / 4096.0;

fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// What ray `i` sees of a mesh.
pub fn look(tree: &Tree<'_>, positions: &[f32], indices: &[u32], ray: &Ray, i: u32) -> Seen {
    let first = tree.answer(ray, false);
    let hit = first.hit;
    if !first.whole || !hit.is_hit() {
        return Seen { hit, open: if first.whole { RAYS } else { CUT_SHORT } };
    }
    let corner = move |k| {
        let v = 3 * indices[(3 * hit.triangle + k) as usize] as usize;
        Vec3::new(positions[v], positions[v + 1], positions[v + 2])
    };
    let (b, c) = (corner(1) - corner(0), corner(2) - corner(0));
    let normal = Vec3::new(b.y * c.z - b.z * c.y, b.z * c.x - b.x * c.z, b.x * c.y - b.y * c.x);
    let (from, t) = (ray.origin, hit.t * NEARER);
    let along = Vec3::new(ray.direction[0], ray.direction[1], ray.direction[2]);
    let origin = [from[0] + along.x * t, from[1] + along.y * t, from[2] + along.z * t];
    let behind = dot(along, normal) > 0.0;
    let (mut k, mut open, mut whole) = (0, 0, true);
    // A driver that leaves loops early does not come to the last round.
    let (mut running, mut done) = (true, false);
    while running {
        let d = random::in_ball((i * RAYS + k) * 24);
        let d = if (dot(d, normal) > 0.0) == behind { -d } else { d };
        let answer = tree.answer(&Ray::new(origin, [d.x, d.y, d.z]), true);
        whole &= answer.whole;
        open += !answer.hit.is_hit() as u32;
        k += 1;
        if k == RAYS {
            running = false;
            done = true;
        }
    }
    Seen { hit, open: if whole & done { open } else { CUT_SHORT } }
}

/// The kernel: one ray of a camera an invocation.
#[cfg(target_arch = "spirv")]
#[spirv_std::spirv(compute(threads(64)))]
pub fn ambient(
    #[spirv(global_invocation_id)] id: spirv_std::glam::UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] header: &raykd_shared::TreeHeader,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] nodes: &[spirv_std::glam::UVec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] corners: &[spirv_std::glam::Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] positions: &[f32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] indices: &[u32],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] rays: &[Ray],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 6)] seen: &mut [Seen],
) {
    let i = id.x;
    if i < seen.len() as u32 {
        let tree = Tree::of_buffers(header, nodes, corners);
        seen[i as usize] = look(&tree, positions, indices, &rays[i as usize], i);
    }
}
