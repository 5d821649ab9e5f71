//! What is made of a tree before rays are traced: triangles as leaves keep them, and what some ways through
//! the tree need beside it.

pub mod climb;
pub mod corners;
pub mod node_boxes;
pub mod parents;
pub mod rope_links;
pub mod workgroups;

kernels! {
    /// The kernels that run before rays do.
    workgroups::WORKGROUPS,
    corners::CORNERS,
    corners::transforms::TRANSFORMS,
    parents::PARENTS,
    node_boxes::NODE_BOXES,
    rope_links::ROPE_LINKS,
}
