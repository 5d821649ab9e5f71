//! What some traversals need beside the tree.

#[path = "../../../../kernels/src/trace/prepare/climb.rs"]
pub mod climb;
#[path = "../../../../kernels/src/trace/prepare/node_boxes.rs"]
pub mod node_boxes;
#[path = "../../../../kernels/src/trace/prepare/parents.rs"]
pub mod parents;
#[path = "../../../../kernels/src/trace/prepare/rope_links.rs"]
pub mod rope_links;
