//! What must hold of every tree.

use crate::Failure;
use raykd::{
    KdTree, Mesh,
    shared::{Content, LAYOUT_VERSION, Node, TreeHeader, TreeView},
};
use sha2::{Digest as _, Sha256};

/// Lower and upper corner of every triangle's box, as the kernels see it.
fn boxes(mesh: &Mesh) -> Vec<[[f32; 3]; 2]> {
    let positions = mesh.scaled_positions();
    let corner = |v: u32, axis: usize| positions[3 * v as usize + axis];
    let face = |t: &[u32; 3], pick: fn(f32, f32) -> f32| {
        [0, 1, 2].map(|axis| pick(pick(corner(t[0], axis), corner(t[1], axis)), corner(t[2], axis)))
    };
    mesh.triangles().iter().map(|t| [face(t, f32::min), face(t, f32::max)]).collect()
}

/// Whether a child holds what lies between `lo` and `hi`: what lies in the plane is below it, and not above.
fn belongs(above: bool, lo: f32, hi: f32, split: f32) -> bool {
    if above { hi > split } else { lo < split || hi <= split }
}

/// Checks that the tree is well formed, and that every leaf lists only triangles that the planes on the way to it
/// leave, and unless references were clipped all of them.
///
/// # Errors
/// It does not hold.
pub fn check(mesh: &Mesh, tree: TreeView<'_>, clipped: bool) -> Result<(), Failure> {
    tree.validate().map_err(|fault| Failure(fault.to_string()))?;
    let (lo, hi) = mesh.scaled_bounds();
    if (tree.header.lo, tree.header.hi) != (lo, hi) {
        return Err(Failure("the root's box is not the mesh's".to_owned()));
    }
    let boxes = boxes(mesh);
    // Validation has shown that this ends: a tree, no deeper than its header says.
    let mut waiting = vec![(0u32, mesh.kept().to_vec())];
    while let Some((number, triangles)) = waiting.pop() {
        match tree.nodes[number as usize].content() {
            Content::Leaf { first, count } => {
                let listed = &tree.refs[first as usize..(first + count) as usize];
                let odd = |t: &&u32| !triangles.contains(t) || !clipped && !listed.contains(t);
                if listed.iter().chain(&triangles).any(|t| odd(&t)) {
                    let triangle = listed.iter().chain(&triangles).find(odd);
                    return Err(Failure(format!(
                        "leaf {number} lists {} triangles where {} belong; one of those that differ is {}",
                        listed.len(),
                        triangles.len(),
                        triangle.map_or("none".to_owned(), u32::to_string)
                    )));
                }
            }
            Content::Inner { axis, split, below } => {
                for above in [false, true] {
                    let goes = |&t: &u32| {
                        let [lo, hi] = boxes[t as usize].map(|corner| corner[axis as usize]);
                        belongs(above, lo, hi, split)
                    };
                    let there = triangles.iter().copied().filter(goes).collect();
                    waiting.push((below + u32::from(above), there));
                }
            }
        }
    }
    Ok(())
}

/// A tree of these parts, by way of its file.
///
/// # Errors
/// It is damaged.
pub fn assemble(header: TreeHeader, nodes: &[Node], refs: &[u32]) -> Result<KdTree, raykd::Error> {
    let mut header = TreeHeader { nodes: nodes.len() as u32, refs: refs.len() as u32, ..header };
    header.checksum = TreeView { header: &header, nodes, refs }.checksum();
    let mut bytes = b"raykd-kd".to_vec();
    bytes.extend(LAYOUT_VERSION.to_le_bytes());
    bytes.extend(bytemuck::bytes_of(&header));
    bytes.extend(bytemuck::cast_slice::<_, u8>(nodes));
    bytes.extend(bytemuck::cast_slice::<_, u8>(refs));
    bytes.extend(Sha256::digest(&bytes).as_slice());
    KdTree::from_bytes(&bytes)
}

/// The tree with its `n`th reference taken out of its leaf: well formed, and wrong.
///
/// # Errors
/// It would be damaged.
pub fn without_reference(tree: &KdTree, n: u32) -> Result<KdTree, raykd::Error> {
    let view = tree.view();
    let mut refs = view.refs.to_vec();
    refs.remove(n as usize);
    let shrink = |node: &Node| match node.content() {
        Content::Leaf { first, count } if first > n => Node::leaf(first - 1, count),
        Content::Leaf { first, count } if first + count > n => Node::leaf(first, count - 1),
        _ => *node,
    };
    let nodes: Vec<Node> = view.nodes.iter().map(shrink).collect();
    assemble(*view.header, &nodes, &refs)
}
