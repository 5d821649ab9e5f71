//! Hits of the exact test of eight rays side by side, on a CPU. On their way through the tree
//! ([`packet`](super::packet), [`apart`](super::apart)) floats tell which triangles may be a ray's hit: mostly one.
//! Those are then tested by doubles, eight rays at once; where a ray has several, or doubles do not tell, alone.
//! [`narrow`](crate::trace::traverse::narrow) and [`settle`](crate::trace::traverse::settle) do this on a GPU. The
//! answers are those of the test in the walk.

use super::{
    Packets, Range, Scene,
    apart::{LANES, Visits},
    neighbours,
    packet::{Leaves, Packet, Scaled},
};
use crate::{
    Group,
    eight::{Doubles, Eight, SIDE_BY_SIDE},
    glam::{UVec4, Vec4},
    kernel::Bits,
    math::Sides,
    mem::{Buf, Slots, Stack},
    pair::Double,
    trace::{
        frame::{Frame, flush},
        intersect::{Best, Glance, NORMAL, by_doubles::side_by_side, exact::Exact},
        job::{JOB_ANY, Left, SPAN, THREADS, record},
        traverse::{
            leaf::{self, Choice, Filter, LeafTriangle},
            narrow::{MOST, Narrow, WORDS},
        },
    },
};
use raykd_shared::{MISS, Node, TreeHeader};

const SIDES: usize = SIDE_BY_SIDE as usize;

/// Fewer of eight rays wait for others.
const AT_ONCE: u32 = 5;

/// The triangles that may be the hit of one ray.
type List = [u32; WORDS];

impl Scene<'_> {
    /// Tests the triangle that a reference lists.
    fn test(&self, ray: &Frame, at: u32, best: &mut Best) {
        let corners = self.corners.three(3 * at);
        Exact.settle(ray, corners.0.w.to_bits() & !NORMAL, corners, best);
    }

    /// What ray `i` hits of one triangle.
    #[cold]
    #[inline(never)]
    fn alone(&self, i: u32, at: u32) -> UVec4 {
        let (ray, mut best) = (self.frame(i, true), Best::NOTHING);
        self.test(&ray, at, &mut best);
        record(&ray, &best)
    }

    /// The best of a ray's candidates.
    fn best(&self, ray: &Frame, list: &List) -> Best {
        let mut best = Best::NOTHING;
        for i in 0..Narrow::count(list) {
            self.test(ray, Narrow::reference(list, i), &mut best);
        }
        best
    }

    /// What ray `i` hits of its candidates.
    #[cold]
    #[inline(never)]
    fn best_of(&self, i: u32, list: &List) -> UVec4 {
        let ray = self.frame(i, true);
        record(&ray, &self.best(&ray, list))
    }
}

/// Where answers go, and what has none yet.
struct Answers<'a> {
    scene: Scene<'a>,
    hits: &'a mut Buf<UVec4>,
    /// Rays that have one candidate each, and the references that list those.
    waiting: Stack<(u32, u32), { (SPAN * THREADS) as usize }>,
    count: u32,
}

impl Answers<'_> {
    /// Answers a ray by its candidates, or later. False if there was no room for all.
    fn take(&mut self, i: u32, list: &List) -> bool {
        match Narrow::count(list) {
            0 => self.hits.put(i, NOTHING),
            1 => self.wait(i, Narrow::reference(list, 0)),
            2..=MOST => self.hits.put(i, self.scene.best_of(i, list)),
            _ => return false,
        }
        true
    }

    #[inline(always)]
    fn wait(&mut self, ray: u32, at: u32) {
        self.waiting.put(self.count, (ray, at));
        self.count += 1;
    }

    /// Answers those that wait, eight at a time.
    #[inline(always)]
    fn settle<D: Double<One: Sides>>(&mut self) {
        let mut first = 0;
        while first < self.count {
            let some = SIDE_BY_SIDE.min(self.count - first);
            let mut eight = [self.waiting.at(first); SIDES];
            let (mut starts, mut ways) = ([Vec4::ZERO; SIDES], [Vec4::ZERO; SIDES]);
            let mut lane = 0;
            while lane < SIDES {
                if (lane as u32) < some {
                    eight[lane] = self.waiting.at(first + lane as u32);
                }
                let ray = eight[lane].0;
                (starts[lane], ways[lane]) = (self.scene.rays.at(2 * ray), self.scene.rays.at(2 * ray + 1));
                lane += 1;
            }
            let scaled = Scaled::new(&starts, &ways, self.scene.header.scale, true);
            self.settle_eight::<D, D::One>(&scaled, &eight, (1 << some) - 1);
            first += SIDE_BY_SIDE;
        }
    }

    /// Answers some of eight rays, which have one candidate each.
    #[inline(always)]
    fn settle_eight<D: Double<One = N>, N: Sides>(
        &mut self,
        scaled: &Scaled<N>,
        rays: &[(u32, u32); SIDES],
        some: u32,
    ) {
        let Scene { header, corners, .. } = self.scene;
        let mut rows = [[Vec4::ZERO; SIDES]; 3];
        let mut lane = 0;
        while lane < SIDES {
            (rows[0][lane], rows[1][lane], rows[2][lane]) = corners.three(3 * rays[lane].1);
            lane += 1;
        }
        let mains = scaled.mains();
        let line = scaled.line(&mains, header);
        let corners = [mains.turned(&rows[0]), mains.turned(&rows[1]), mains.turned(&rows[2])];
        let found = side_by_side::<D>(&line, &corners);
        let (certain, hit) = (N::bits(found.certain) & scaled.rays, N::bits(found.hit));
        // What is subnormal is 0, and so is a negative zero.
        let zero = N::all(0.0);
        let t = (flush(found.t * scaled.unstretch(), f32::MIN_POSITIVE) + zero).numbers();
        let u = (flush(found.u, f32::MIN_POSITIVE) + zero).numbers();
        let v = (flush(found.v, f32::MIN_POSITIVE) + zero).numbers();
        for lane in Bits(some) {
            let lane = lane as usize;
            let (ray, at) = rays[lane];
            let answer = if certain >> lane & 1 == 0 {
                self.scene.alone(ray, at)
            } else if hit >> lane & 1 != 0 {
                let triangle = rows[0][lane].w.to_bits() & !NORMAL;
                UVec4::new(triangle, t[lane].to_bits(), u[lane].to_bits(), v[lane].to_bits())
            } else {
                NOTHING
            };
            self.hits.put(ray, answer);
        }
    }
}

/// No hit.
const NOTHING: UVec4 = UVec4::new(MISS, 0, 0, 0);

/// Candidates of eight rays that go together.
struct Together<'a, N, const ANY: bool> {
    scene: Scene<'a>,
    /// The number of the first ray.
    first: u32,
    /// The last `t` that counts.
    last: N,
    /// The triangle that is surely hit there or before, as corners have it.
    best: N,
    /// The lowest number that `t` of a candidate may be.
    least: N,
    /// Of rays with one candidate, which floats are sure of, the reference that lists it.
    one: N,
    /// The other rays that have any: theirs are in lists. What is in those of others means nothing.
    listed: u32,
    lists: &'a mut [List; SIDES],
    /// Which rays are done.
    done: u32,
}

impl<'a, N: Sides, const ANY: bool> Together<'a, N, ANY> {
    #[inline(always)]
    fn new(scene: Scene<'a>, packet: &Packet<N>, lists: &'a mut [List; SIDES]) -> Self {
        let none = N::all(f32::INFINITY);
        Self {
            scene,
            first: packet.first,
            last: packet.scaled.t_max,
            best: none,
            least: none,
            one: none,
            listed: 0,
            lists,
            done: 0,
        }
    }

    /// Answers some rays, or later, and returns which are left.
    #[inline(always)]
    fn end<D: Double<One = N>>(&self, packet: &Packet<N>, rays: u32, answers: &mut Answers<'_>) -> u32 {
        let one = self.one.numbers();
        let single = N::bits(self.least.below(N::all(f32::INFINITY))) & !self.listed & rays;
        let mut left = 0;
        for lane in Bits(rays & !single) {
            let i = self.first + lane;
            if self.listed >> lane & 1 != 0 {
                left |= u32::from(!answers.take(i, &self.lists[lane as usize])) << lane;
            } else {
                answers.hits.put(i, NOTHING);
            }
        }
        if single.count_ones() >= AT_ONCE {
            // The others need a triangle, too.
            let mut eight = [(0, one[single.trailing_zeros() as usize].to_bits()); SIDES];
            for lane in Bits(single) {
                eight[lane as usize] = (self.first + lane, one[lane as usize].to_bits());
            }
            answers.settle_eight::<D, N>(&packet.scaled, &eight, single);
        } else {
            for lane in Bits(single) {
                answers.wait(self.first + lane, one[lane as usize].to_bits());
            }
        }
        left
    }

    /// Of a leaf's candidates any hit is the best: done are those rays that surely have one, and those that do on a
    /// closer look.
    #[inline(always)]
    fn look(&mut self, rays: u32, sure: u32) {
        self.done |= sure;
        for lane in Bits(self.listed & rays & !sure) {
            let list = &mut self.lists[lane as usize];
            // Where there is no room for all nothing is known.
            if Narrow::count(list) > MOST || self.scene.best_of(self.first + lane, list).x != MISS {
                self.done |= 1 << lane;
            } else {
                Narrow::clear(list);
            }
        }
    }
}

/// Adds a candidate to those of a ray, whose `t` is not above `last`.
#[cold]
#[inline(never)]
fn add(list: &mut List, triangle: (u32, u32, f32), last: f32) {
    if Narrow::count(list) <= MOST {
        Narrow::add(list, 0, triangle, last);
    }
}

impl<N: Sides, const ANY: bool> Leaves<N> for Together<'_, N, ANY> {
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<N>, leaf: Node, rays: u32, corners: &Buf<Vec4>) {
        let end = leaf.first() + leaf.count();
        let (mut r, mut found) = (leaf.first(), 0);
        while r < end {
            let (a, b, c) = corners.three(3 * r);
            let at = r;
            r += 1;
            let Some((may, seen)) = packet.glance((a, b, c), rays) else { continue };
            let Glance { near, later, sure, .. } = seen;
            let passed =
                later.below(packet.scaled.t_min) | near.exceeds(self.last) | N::all(a.w).is(self.best);
            let new = may & !passed & N::mask(rays);
            let hit = new & sure & !near.below(packet.scaled.t_min) & later.below(self.last);
            // Before all others.
            let alone = hit & later.below(self.least);
            let beside = N::bits(new & !alone);
            let (least, one) = (self.least, self.one);
            self.last = N::choose(hit, later, self.last);
            self.best = N::choose(hit, N::all(a.w), self.best);
            self.least = N::choose(alone, near, N::choose(new, least.low(near), least));
            self.one = N::choose(alone, N::all(f32::from_bits(at)), one);
            self.listed &= !N::bits(alone);
            found |= N::bits(hit);
            if beside != 0 {
                let (least, one) = (least.numbers(), one.numbers());
                let (near, last) = (near.numbers(), self.last.numbers());
                for lane in Bits(beside) {
                    let (bit, lane) = (1 << lane, lane as usize);
                    let list = &mut self.lists[lane];
                    if self.listed & bit == 0 {
                        self.listed |= bit;
                        Narrow::clear(list);
                        if least[lane] < f32::INFINITY {
                            let one = one[lane].to_bits();
                            let id = corners.at(3 * one).w.to_bits() & !NORMAL;
                            add(list, (id, one, least[lane]), last[lane]);
                        }
                    }
                    add(list, (a.w.to_bits() & !NORMAL, at, near[lane]), last[lane]);
                }
            }
        }
        if ANY {
            self.look(rays, found);
        }
    }

    #[inline(always)]
    fn last(&self) -> N {
        self.last
    }

    #[inline(always)]
    fn done(&self) -> u32 {
        self.done
    }
}

/// Answers rays that go together, and others by lists of their own.
struct By<'a, 'b, const ANY: bool> {
    answers: &'a mut Answers<'b>,
    lists: [List; LANES],
    /// The same of rays that go together.
    together: [List; SIDES],
}

/// Adds to a list what may be hit.
struct Keeping<'a>(&'a mut List);

impl Filter<Exact> for Keeping<'_> {
    #[inline(always)]
    fn test(&mut self, by: Exact, ray: &Frame, triangle: LeafTriangle<Exact>, best: &mut Best) -> bool {
        Narrow::<false>.test(by, ray, triangle, best, self.0)
    }
}

impl<const ANY: bool> Visits<Eight> for By<'_, '_, ANY> {
    #[inline(always)]
    fn begin(&mut self, lane: usize) {
        Narrow::clear(&mut self.lists[lane]);
    }

    #[inline(always)]
    fn visit(&mut self, lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool {
        let list = &mut self.lists[lane];
        leaf::visit(Exact, ray, leaf, corners, &mut Keeping(list), best);
        let count = Narrow::count(list);
        if !ANY || count == 0 || count > MOST {
            return count > MOST;
        }
        // While there is no hit, its `t` is the last that counts.
        let within = Frame { t_max: best.t, ..*ray };
        let enough = best.triangle != MISS || self.answers.scene.best(&within, list).triangle != MISS;
        if !enough {
            Narrow::clear(list);
        }
        enough
    }

    #[inline(always)]
    fn end(&mut self, lane: usize, i: u32, _ray: &Frame, _best: &Best) -> bool {
        self.answers.take(i, &self.lists[lane])
    }

    #[inline(always)]
    fn miss(&mut self, i: u32) {
        self.answers.hits.put(i, NOTHING);
    }
}

impl<const ANY: bool> Packets<Eight> for By<'_, '_, ANY> {
    const WHOLE: bool = true;

    #[inline(always)]
    fn answer(&mut self, scene: &Scene<'_>, packet: &mut Packet<Eight>) -> u32 {
        let mut found = Together::<Eight, ANY>::new(*scene, packet, &mut self.together);
        let gone = packet.walk_together::<ANY>(scene, &mut found);
        gone & !found.end::<Doubles>(packet, gone, self.answers)
    }
}

/// Answers some rays that may go side by side, and returns which are left.
///
/// # Safety
/// The processor has these instructions.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight<const ANY: bool>(
    range: Range,
    scene: Scene<'_>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) -> Left {
    let answers = &mut Answers { scene, hits, waiting: Stack::new(), count: 0 };
    let by = &mut By::<ANY> { answers, lists: [[0; WORDS]; LANES], together: [[0; WORDS]; SIDES] };
    let left = scene.side_by_side(range, outcome, by);
    answers.settle::<Doubles>();
    left
}

/// Answers those of a workgroup's rays that go side by side.
#[inline(always)]
pub(in crate::trace) fn exact(
    group: &Group,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) -> Left {
    let Some(range) = neighbours(group, job) else { return Left::ALL };
    let header = &header.at(0);
    let scene = Scene { header, pairs, corners, rays };
    // SAFETY: that the group is usual says so.
    unsafe {
        if job.at(JOB_ANY) != 0 {
            by_eight::<true>(range, scene, hits, outcome)
        } else {
            by_eight::<false>(range, scene, hits, outcome)
        }
    }
}
