//! The ropes of every leaf (Popov, Günther, Seidel & Slusallek 2007, "Stackless kd-tree traversal for high
//! performance GPU ray tracing"): what lies beyond each of the six sides of its box.
//!
//! A record is three words of four: lower corner and upper corner, then the six ropes in the same order.
//! Records stand at their leaf's number, so inner nodes waste theirs: 48 bytes a node.

use super::climb::{NONE, climb};
use crate::{
    glam::UVec4,
    mem::{Buf, Slots, scratch},
    trace::place::Place,
};
use raykd_shared::TreeHeader;

/// Word of the job record: 1 to pull ropes down as far as one node alone lies beyond the whole side.
pub const JOB_OPTIMISE: u32 = 0;

/// Writes box and ropes of node `i` if it is a leaf.
pub fn rope_links(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    parents: &Buf<u32>,
    links: &mut Buf<UVec4>,
) {
    let header = header.at(0);
    if i < header.nodes && i != 1 && Place::load(i, pairs).node.is_leaf() {
        let mut ropes = scratch::<u32, 6>();
        let sides = climb(i, &header, pairs, parents, &mut ropes);
        let mut side = 0;
        while side < 6 {
            let mut end = ropes.at(side);
            let mut pulling = end != NONE && job.at(JOB_OPTIMISE) != 0;
            while pulling {
                let node = Place::load(end, pairs).node;
                if node.is_leaf() {
                    pulling = false;
                } else {
                    let axis = node.axis();
                    let (upper, own) = (side >= 3, side == axis || side == axis + 3);
                    // Across the side's own axis the child at the side; else the one that all of the leaf
                    // faces.
                    let below = if own { upper } else { sides.at(axis + 3) <= node.split() };
                    let above = if own { !upper } else { sides.at(axis) >= node.split() };
                    pulling = below || above;
                    end = if below {
                        node.below()
                    } else if above {
                        node.below() + 1
                    } else {
                        end
                    };
                }
            }
            ropes.put(side, end);
            side += 1;
        }
        let bits = |side: u32| sides.at(side).to_bits();
        links.put(3 * i, UVec4::new(bits(0), bits(1), bits(2), bits(3)));
        links.put(3 * i + 1, UVec4::new(bits(4), bits(5), ropes.at(0), ropes.at(1)));
        links.put(3 * i + 2, UVec4::new(ropes.at(2), ropes.at(3), ropes.at(4), ropes.at(5)));
    }
}

kernel! {
    /// [`rope_links`] over all nodes.
    map ROPE_LINKS = rope_links, threads 64, {
        0 job: read u32, 1 header: read TreeHeader, 2 pairs: read UVec4, 3 parents: read u32, 4 links: write UVec4,
    }
}
