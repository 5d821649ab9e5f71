//! Which mesh a tree belongs to: a digest of the triangles as the kernels see them.

use rayon::prelude::*;

/// The sum of a hash of each triangle that takes part, of its number and its scaled corners: two words that do not
/// depend on the order in which they are added.
pub(crate) fn digest(positions: &[f32], triangles: &[[u32; 3]], kept: &[u32]) -> [u32; 2] {
    let of = |&number: &u32| {
        let corners = triangles[number as usize].map(|v| &positions[3 * v as usize..][..3]);
        // The kernels' coordinates have no -0.
        let words = corners.into_iter().flatten().map(|x| x.to_bits());
        [0x9E37_79B9, 0x85EB_CA6B].map(|seed| words.clone().fold(mix(number ^ seed), |h, word| mix(h ^ word)))
    };
    let add = |a: [u32; 2], b: [u32; 2]| [a[0].wrapping_add(b[0]), a[1].wrapping_add(b[1])];
    kept.par_iter().with_min_len(1 << 10).map(of).reduce(|| [0; 2], add)
}

/// A permutation of all words in which every bit depends on every other (the finaliser of MurmurHash3).
fn mix(mut word: u32) -> u32 {
    word = (word ^ word >> 16).wrapping_mul(0x85EB_CA6B);
    word = (word ^ word >> 13).wrapping_mul(0xC2B2_AE35);
    word ^ word >> 16
}

#[cfg(test)]
mod tests {
    use crate::Mesh;

    #[test]
    fn a_digest_tells_every_change_of_a_triangle() {
        let mesh = Mesh::teapot(2);
        let (positions, triangles) = (mesh.positions().to_vec(), mesh.triangles().to_vec());
        let of = |positions: Vec<[f32; 3]>, triangles| Mesh::new(positions, triangles).unwrap().tree_key();
        assert_eq!(mesh.tree_key(), of(positions.clone(), triangles.clone()));
        let mut seen = vec![mesh.tree_key()];
        for &triangle in mesh.kept() {
            for corner in triangles[triangle as usize] {
                for axis in 0..3 {
                    let mut moved = positions.clone();
                    let x = &mut moved[corner as usize][axis];
                    // What is next to 0 is too small to count.
                    *x = if *x == 0.0 { 1e-3 } else { f32::from_bits(x.to_bits() ^ 1) };
                    seen.push(of(moved, triangles.clone()));
                }
            }
        }
        // Neighbours share vertices, so each change was made several times.
        let changes = mesh.kept().iter().flat_map(|&t| triangles[t as usize]);
        let vertices: std::collections::BTreeSet<u32> = changes.collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 1 + 3 * vertices.len());
        let mut turned = triangles.clone();
        turned[0].rotate_left(1);
        assert_ne!(of(positions.clone(), turned), mesh.tree_key());
        let mut swapped = triangles;
        swapped.swap(5, 6);
        assert_ne!(of(positions, swapped), mesh.tree_key());
    }
}
