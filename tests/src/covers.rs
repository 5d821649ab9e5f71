//! What tracing needs of a tree, however it was built, in exact arithmetic.

use crate::{
    Failure,
    exact::{Point, half, rational, rough},
};
use num_rational::BigRational;
use raykd::{
    Mesh,
    shared::{Content, TreeView},
};

/// Checks that every point of every triangle lies in the closed cell of some leaf that lists the triangle.
///
/// So a leaf may leave out a triangle only if the two meet nowhere, or merely in points of the leaf's boundary that
/// belong to leaves that list it. Leaves tile the root's box, which holds all triangles: [`TreeView::validate`]
/// has planes inside their nodes.
///
/// # Errors
/// A point is not covered.
pub fn covers(mesh: &Mesh, tree: TreeView<'_>) -> Result<(), Failure> {
    tree.validate().map_err(|fault| Failure(fault.to_string()))?;
    if (tree.header.lo, tree.header.hi) != mesh.scaled_bounds() {
        return Err(Failure("the root's box is not the mesh's".to_owned()));
    }
    let positions = mesh.scaled_positions();
    for &triangle in mesh.kept() {
        let corner = |v: u32| [0, 1, 2].map(|axis| rational(positions[3 * v as usize + axis]));
        let corners = mesh.triangles()[triangle as usize].map(corner).to_vec();
        covered(tree, triangle, corners, vec![0])?;
    }
    Ok(())
}

/// Whether every point of a convex polygon lies in a leaf with the triangle below one of these nodes, in the closed
/// cells of all of which the polygon lies.
fn covered(
    tree: TreeView<'_>,
    triangle: u32,
    polygon: Vec<Point>,
    mut nodes: Vec<u32>,
) -> Result<(), Failure> {
    let mut leaf = 0;
    while let Some(node) = nodes.pop() {
        match tree.nodes[node as usize].content() {
            Content::Leaf { first, count } => {
                if tree.refs[first as usize..(first + count) as usize].binary_search(&triangle).is_ok() {
                    return Ok(());
                }
                leaf = node;
            }
            Content::Inner { axis, split, below } => {
                let at: BigRational = rational(split);
                let starts_below = polygon.iter().any(|p| p[axis as usize] < at);
                let ends_above = polygon.iter().any(|p| p[axis as usize] > at);
                match (starts_below, ends_above) {
                    // Points next to the plane are in the child's leaves only, and those are closed: the points in
                    // the plane must be in them, too.
                    (true, true) => {
                        for (child, is_below) in [(below, true), (below + 1, false)] {
                            let part = half(&polygon, axis as usize, &at, is_below);
                            covered(tree, triangle, part, [nodes.as_slice(), &[child]].concat())?;
                        }
                        return Ok(());
                    }
                    (true, false) => nodes.push(below),
                    (false, true) => nodes.push(below + 1),
                    // In the plane: either side will do, or each for a part.
                    (false, false) => nodes.extend([below, below + 1]),
                }
            }
        }
    }
    let place: Vec<_> = polygon.iter().map(|p| p.each_ref().map(rough)).collect();
    Err(Failure(format!("leaf {leaf} and its neighbours lack triangle {triangle} at {place:?}")))
}
