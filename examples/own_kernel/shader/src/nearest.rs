//! The smallest kernel that traces rays: the closest hit of each.

use raykd_kernels::trace::single::Tree;
use raykd_shared::{Hit, Ray, TreeHeader};
use spirv_std::glam::{UVec3, UVec4, Vec4};

/// One ray an invocation.
#[spirv_std::spirv(compute(threads(64)))]
pub fn nearest(
    #[spirv(global_invocation_id)] id: UVec3,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 0)] header: &TreeHeader,
    #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] nodes: &[UVec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] corners: &[Vec4],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] rays: &[Ray],
    #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] hits: &mut [Hit],
) {
    let i = id.x as usize;
    if i < hits.len() {
        hits[i] = Tree::of_buffers(header, nodes, corners).answer(&rays[i], false).hit;
    }
}
