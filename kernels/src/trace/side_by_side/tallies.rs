//! Crossings of eight rays side by side, on a CPU: they go through the tree together ([`packet`](super::packet)), and
//! floats tell of most triangles for all at once. What they leave open is decided as
//! [`crossings`](crate::trace::crossings) does.

use super::{
    Packets, Range, Scene, neighbours,
    packet::{Leaves, Packet},
};
use crate::{
    Group,
    eight::{Eight, SIDE_BY_SIDE},
    glam::{UVec4, Vec4},
    kernel::Bits,
    math::Sides,
    mem::{Buf, Slots},
    trace::{
        intersect::NORMAL,
        job::Left,
        tally::{Tally, WORDS},
    },
};
use raykd_shared::{Node, TreeHeader};

/// What is kept of each ray.
struct Tallies {
    own: [[u32; WORDS]; SIDE_BY_SIDE as usize],
    /// The last `t` that counts.
    last: [f32; SIDE_BY_SIDE as usize],
}

impl<N: Sides> Leaves<N> for Tallies {
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<N>, leaf: Node, rays: u32, corners: &Buf<Vec4>) {
        let end = leaf.first() + leaf.count();
        let mut r = leaf.first();
        while r < end {
            let (a, b, c) = corners.three(3 * r);
            let (id, at) = (a.w.to_bits() & !NORMAL, r);
            r += 1;
            let Some((may, seen)) = packet.glance((a, b, c), rays) else { continue };
            let (near, later, last) = (seen.near, seen.later, N::of(&self.last));
            let left = may & !(later.below(packet.scaled.t_min) | near.exceeds(last));
            let told = N::bits(seen.sure & near.exceeds(packet.scaled.t_min) & later.below(last));
            let leaving = N::bits(seen.leaving);
            for lane in Bits(N::bits(left) & rays) {
                let (own, bit) = (&mut self.own[lane as usize], 1 << lane);
                let (told, leaving) = (told & bit != 0, leaving & bit != 0);
                if !Tally::has(own, id) && !Tally::keep(own, (id, at), told, leaving) {
                    self.last[lane as usize] = f32::NEG_INFINITY;
                }
            }
        }
    }

    #[inline(always)]
    fn last(&self) -> N {
        N::of(&self.last)
    }

    #[inline(always)]
    fn done(&self) -> u32 {
        0
    }
}

/// Where answers go.
struct Counts<'a> {
    hits: &'a mut Buf<UVec4>,
    outcome: &'a mut Buf<u32>,
    crossings: &'a mut Buf<u32>,
    more: &'a mut Buf<UVec4>,
}

impl<N: Sides> Packets<N> for Counts<'_> {
    const WHOLE: bool = true;
    // Where rays start counts less than for hits: each goes on to the end of the scene.
    const NEAR: f32 = 1.0 / 4.0;

    #[inline(always)]
    fn answer(&mut self, scene: &Scene<'_>, packet: &mut Packet<N>) -> u32 {
        let own = [[0; WORDS]; SIDE_BY_SIDE as usize];
        let mut tallies = Tallies { own, last: packet.scaled.t_max.numbers() };
        packet.walk(packet.together, scene, &mut tallies);
        let Counts { hits, outcome, crossings, more } = self;
        for lane in Bits(packet.together) {
            Tally::put(&tallies.own[lane as usize], packet.first + lane, hits, outcome, crossings, more);
        }
        packet.together
    }
}

/// Counts for some rays, and returns which are left.
///
/// # Safety
/// The processor has these instructions.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight(range: Range, scene: Scene<'_>, mut counts: Counts<'_>) -> Left {
    scene.together::<Eight, _>(range, &mut counts)
}

/// Counts for those of a workgroup's rays that go side by side.
#[inline(always)]
pub(in crate::trace) fn crossings(
    group: &Group,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    crossings: &mut Buf<u32>,
    more: &mut Buf<UVec4>,
) -> Left {
    let Some(range) = neighbours(group, job) else { return Left::ALL };
    let scene = Scene { header: &header.at(0), pairs, corners, rays };
    let counts = Counts { hits, outcome, crossings, more };
    // SAFETY: that the group is usual says so.
    unsafe { by_eight(range, scene, counts) }
}
