//! All hits of eight rays side by side, on a CPU. Those that go together ([`packet`](super::packet)) take one walk for
//! the next hits of each, and those that have more another. Of those that go apart ([`apart`](super::apart)) each walks
//! on alone if it has more. The answers are those of [`find`].

use super::{
    Packets, Range, Scene,
    apart::{LANES, Visits},
    neighbours,
    packet::{Leaves, Packet, offer},
};
use crate::{
    Group,
    eight::{Eight, SIDE_BY_SIDE},
    glam::{UVec4, Vec4},
    kernel::Bits,
    math::Sides,
    mem::{Buf, Slots},
    trace::{
        all::{AGAIN, find},
        frame::Frame,
        intersect::{Best, Corners, Intersector, NORMAL, exact::Exact, strict::Strict},
        job::{JOB_LIMIT, Left, record},
        traverse::{
            Steps,
            leaf::{self, Choice, Filter, LeafTriangle},
            next::{AT_ONCE, After, Next, WORDS},
        },
    },
};
use core::marker::PhantomData;
use raykd_shared::{MISS, Node, TreeHeader};

const SIDES: usize = SIDE_BY_SIDE as usize;

/// The next hits of a ray.
type Hits = [u32; WORDS];

/// Where answers go, and how many hits of a ray there is room for.
struct Answers<'a> {
    hits: &'a mut Buf<UVec4>,
    totals: &'a mut Buf<u32>,
    room: u32,
}

impl Answers<'_> {
    /// Writes the next hits of ray `i`, which has had `total`. Returns how many it has had then.
    #[inline(always)]
    fn put(&mut self, i: u32, ray: &Frame, own: &Hits, total: u32) -> u32 {
        let count = Next::count(own);
        for k in 0..count.min(self.room.saturating_sub(total)) {
            self.hits.put(i * self.room + total + k, record(ray, &Next::hit(own, k)));
        }
        total + count
    }
}

/// A triangle test of rays that go together.
pub(in crate::trace) trait Together: Intersector {
    /// Tests a triangle for some of them.
    fn test_some<N: Sides>(nexts: &mut Nexts<'_>, packet: &Packet<N>, corners: Corners, rays: u32);
}

impl Together for Strict {
    #[inline(always)]
    fn test_some<N: Sides>(nexts: &mut Nexts<'_>, packet: &Packet<N>, corners: Corners, rays: u32) {
        let s = packet.sheared(corners);
        let may_hit = N::bits(s.agree()) & rays;
        if may_hit == 0 {
            return;
        }
        let plain = N::bits(s.is_plain());
        let met = packet.meet(&s);
        let counts = met.hit & !met.t.below(N::of(&nexts.from)) & !met.t.exceeds(N::of(&nexts.last));
        let counts = N::bits(counts) & may_hit & plain;
        let triangle = corners.0.w.to_bits() & !NORMAL;
        if counts != 0 {
            let (t, u, v, det) = (met.t.numbers(), met.u.numbers(), met.v.numbers(), met.det.numbers());
            for lane in Bits(counts) {
                let lane = lane as usize;
                nexts.take(lane, &Best { t: t[lane], triangle, u: u[lane], v: v[lane], det: det[lane] });
            }
        }
        for lane in Bits(may_hit & !plain) {
            let lane = lane as usize;
            let mut hit = Best { t: nexts.last[lane], ..Best::NOTHING };
            offer(&packet.frame(lane), corners, &mut hit);
            if hit.triangle != MISS {
                nexts.take(lane, &hit);
            }
        }
    }
}

impl Together for Exact {
    #[inline(always)]
    fn test_some<N: Sides>(nexts: &mut Nexts<'_>, packet: &Packet<N>, corners: Corners, rays: u32) {
        let Some((may, seen)) = packet.glance(corners, rays) else { return };
        let passed = seen.later.below(N::of(&nexts.from)) | seen.near.exceeds(N::of(&nexts.last));
        for lane in Bits(N::bits(may & !passed) & rays) {
            nexts.settle(lane as usize, corners);
        }
    }
}

/// The next hits of eight rays.
pub(in crate::trace) struct Nexts<'a> {
    scene: Scene<'a>,
    /// The number of the first ray.
    first: u32,
    own: [Hits; SIDES],
    after: [After; SIDES],
    /// The first `t` that counts, and the last.
    from: [f32; SIDES],
    last: [f32; SIDES],
    /// The last `t` of each ray.
    ends: [f32; SIDES],
    /// For tests of one ray: which are there.
    frames: [Frame; SIDES],
    framed: u32,
}

impl<'a> Nexts<'a> {
    #[inline(always)]
    fn new<N: Sides>(scene: Scene<'a>, packet: &Packet<N>) -> Self {
        let ends = packet.scaled.t_max.numbers();
        Self {
            scene,
            first: packet.first,
            own: [[0; WORDS]; SIDES],
            after: [After::NOTHING; SIDES],
            from: packet.scaled.t_min.numbers(),
            last: ends,
            ends,
            frames: [Frame::NOTHING; SIDES],
            framed: 0,
        }
    }

    /// Keeps a hit in the ray's range if it is one of the next.
    fn take(&mut self, lane: usize, hit: &Best) {
        if self.after[lane].precedes(hit) {
            self.last[lane] = Next::keep(&mut self.own[lane], hit, self.last[lane]);
        }
    }

    /// Tests a triangle for one ray exactly, if it is not there yet.
    fn settle(&mut self, lane: usize, corners: Corners) {
        let triangle = corners.0.w.to_bits() & !NORMAL;
        if Next::has(&self.own[lane], triangle) {
            return;
        }
        if self.framed >> lane & 1 == 0 {
            self.framed |= 1 << lane;
            self.frames[lane] = self.scene.frame(self.first + lane as u32, true);
        }
        let mut hit = Best { t: self.last[lane], ..Best::NOTHING };
        Exact.settle(&self.frames[lane], triangle, corners, &mut hit);
        if hit.triangle != MISS {
            self.take(lane, &hit);
        }
    }

    /// Goes on behind the next hits of a ray.
    fn pass(&mut self, lane: usize) {
        let last = Next::hit(&self.own[lane], AT_ONCE - 1);
        self.after[lane] = After::of(&last);
        (self.from[lane], self.last[lane]) = (last.t, self.ends[lane]);
        Next::clear(&mut self.own[lane]);
    }

    /// Finds all hits of some rays.
    #[inline(always)]
    fn answer<I: Together, N: Sides>(&mut self, packet: &mut Packet<N>, answers: &mut Answers<'_>) {
        let mut totals = [0; SIDES];
        let mut walking = packet.together;
        while walking != 0 {
            let scene = self.scene;
            packet.walk(walking, &scene, &mut By::<I> { nexts: self, test: PhantomData });
            let mut more = 0;
            for lane in Bits(walking) {
                let (side, i) = (lane as usize, self.first + lane);
                let own = &self.own[side];
                totals[side] = answers.put(i, &packet.frame(side), own, totals[side]);
                if Next::count(own) == AT_ONCE {
                    more |= 1 << lane;
                    self.pass(side);
                } else {
                    answers.totals.put(i, totals[side]);
                }
            }
            packet.begin_at(N::of(&self.from));
            walking = more;
        }
    }
}

/// The leaves of rays that go together, by a triangle test.
struct By<'b, 'a, I> {
    nexts: &'b mut Nexts<'a>,
    test: PhantomData<I>,
}

impl<I: Together, N: Sides> Leaves<N> for By<'_, '_, I> {
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<N>, leaf: Node, rays: u32, corners: &Buf<Vec4>) {
        let end = leaf.first() + leaf.count();
        let mut r = leaf.first();
        while r < end {
            I::test_some(self.nexts, packet, corners.three(3 * r), rays);
            r += 1;
        }
    }

    #[inline(always)]
    fn last(&self) -> N {
        N::of(&self.nexts.last)
    }

    #[inline(always)]
    fn done(&self) -> u32 {
        0
    }
}

/// Answers rays that go together, and others with next hits of their own.
struct All<'a, 'b, I> {
    scene: Scene<'a>,
    answers: &'a mut Answers<'b>,
    own: [Hits; LANES],
    test: PhantomData<I>,
}

/// Keeps the next hits of a ray.
struct Keeping<'a>(&'a mut Hits);

impl<I: Intersector> Filter<I> for Keeping<'_> {
    #[inline(always)]
    fn test(&mut self, by: I, ray: &Frame, triangle: LeafTriangle<I>, best: &mut Best) -> bool {
        Next(After::NOTHING).test(by, ray, triangle, best, self.0)
    }
}

impl<I: Together> Visits<Eight> for All<'_, '_, I> {
    #[inline(always)]
    fn begin(&mut self, lane: usize) {
        Next::clear(&mut self.own[lane]);
    }

    #[inline(always)]
    fn visit(&mut self, lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool {
        leaf::visit(I::new(ray), ray, leaf, corners, &mut Keeping(&mut self.own[lane]), best);
        false
    }

    #[inline(always)]
    fn end(&mut self, lane: usize, i: u32, ray: &Frame, _best: &Best) -> bool {
        let own = &self.own[lane];
        let mut total = self.answers.put(i, ray, own, 0);
        if total == AT_ONCE {
            let Scene { pairs, corners, .. } = self.scene;
            let (room, hits) = (self.answers.room, &mut *self.answers.hits);
            let (mut ray, mut after) = (self.scene.frame(i, I::WHOLE), After::NOTHING);
            after.pass(&mut ray, &Next::hit(own, AT_ONCE - 1));
            let (tree, steps) = ((pairs, corners), &mut Steps::default());
            let place = (i * room, room);
            total = find::<I>(&mut ray, tree, hits, place, u32::MAX, (after, total), steps);
        }
        self.answers.totals.put(i, total);
        true
    }

    #[inline(always)]
    fn miss(&mut self, i: u32) {
        self.answers.totals.put(i, 0);
    }
}

impl<N: Sides, I: Together> Packets<N> for All<'_, '_, I> {
    const WHOLE: bool = I::WHOLE;

    #[inline(always)]
    fn answer(&mut self, scene: &Scene<'_>, packet: &mut Packet<N>) -> u32 {
        Nexts::new(*scene, packet).answer::<I, _>(packet, self.answers);
        packet.together
    }
}

/// Answers some rays that may go side by side, and returns which are left.
///
/// # Safety
/// The processor has these instructions.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight<I: Together>(
    range: Range,
    scene: Scene<'_>,
    answers: &mut Answers<'_>,
    outcome: &mut Buf<u32>,
) -> Left {
    let all = &mut All::<I> { scene, answers, own: [[0; WORDS]; LANES], test: PhantomData };
    scene.side_by_side(range, outcome, all)
}

/// Counts the hits of those of a workgroup's rays that go side by side, and keeps as many of the first as the job says.
#[inline(always)]
pub(in crate::trace) fn all<I: Together>(
    group: &Group,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    totals: &mut Buf<u32>,
) -> Left {
    let room = job.at(JOB_LIMIT);
    if room & AGAIN != 0 {
        return Left::ALL;
    }
    let Some(range) = neighbours(group, job) else { return Left::ALL };
    let header = &header.at(0);
    let scene = Scene { header, pairs, corners, rays };
    let answers = &mut Answers { hits, totals, room };
    // SAFETY: that the group is usual says so.
    unsafe { by_eight::<I>(range, scene, answers, outcome) }
}
