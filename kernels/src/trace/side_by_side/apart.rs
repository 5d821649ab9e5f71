//! Rays each at a node of its own, on a CPU, for those that do not go together ([`packet`](super::packet)): sets of
//! eight take their steps down at once, then each ray visits its leaf alone, and one that is done makes room for the
//! next. Each does what it does in [`stack`](crate::trace::traverse::stack).

use super::{Packets, Scene};
use crate::{
    eight::SIDE_BY_SIDE,
    glam::{UVec4, Vec4},
    math::{Sides, high, low},
    mem::{Buf, Slots, Stack},
    trace::{
        frame::Frame,
        intersect::Best,
        job::{Left, load},
        traverse::crossing::crossed,
    },
};
use raykd_shared::{Node, limits::MAX_DEPTH};

const SIDES: usize = SIDE_BY_SIDE as usize;
/// Sets of eight: while nodes of some rays are loaded, others take their step.
const SETS: usize = 6;
/// A set more for each so many rays: of few, many would wait for the last.
const SHARE: u32 = 32;
/// Rays on their way at once.
pub(super) const LANES: usize = SETS * SIDES;

/// What is made of the leaves that rays visit, each alone.
pub(super) trait Visits<N: Sides>: Packets<N> {
    /// A lane begins with a ray.
    fn begin(&mut self, lane: usize);
    /// Tests the triangles of a leaf. True if the ray has enough.
    fn visit(&mut self, lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool;
    /// Answers ray `i`, which is done. False if it is left to others.
    fn end(&mut self, lane: usize, i: u32, ray: &Frame, best: &Best) -> bool;
    /// Answers a ray that meets nothing.
    fn miss(&mut self, i: u32);
}

/// What eight rays need for their steps, side by side.
#[derive(Clone, Copy)]
struct Eights {
    origins: [[f32; SIDES]; 3],
    inverses: [[f32; SIDES]; 3],
    pads: [f32; SIDES],
    enter: [f32; SIDES],
    exit: [f32; SIDES],
    /// The words of the nodes that they are at; those without a ray are at a leaf.
    words: [[f32; SIDES]; 2],
}

/// Some rays on their way.
struct Lanes {
    /// Sets in use, at most [`SETS`].
    used: usize,
    sets: [Eights; SETS],
    /// Which rays they are.
    rays: [u32; LANES],
    frames: [Frame; LANES],
    bests: [Best; LANES],
    /// Nodes for later: their numbers, where the interval begins there and where it ends.
    stacks: [Stack<UVec4, { MAX_DEPTH as usize }>; LANES],
    tops: [u32; LANES],
    /// Which have a ray.
    live: u64,
    /// Which have left a child for later by their last step.
    pushed: u64,
}

impl Lanes {
    fn put(&mut self, lane: usize, node: Node, (enter, exit): (f32, f32)) {
        let (word0, word1) = node.words();
        let (set, lane) = (&mut self.sets[lane / SIDES], lane % SIDES);
        (set.words[0][lane], set.words[1][lane]) = (f32::from_bits(word0), f32::from_bits(word1));
        (set.enter[lane], set.exit[lane]) = (enter, exit);
    }

    /// Gives a lane a ray. False if that meets nothing.
    #[inline(always)]
    fn begin(&mut self, lane: usize, ray: u32, frame: &Frame, root: Node) -> bool {
        let meets = frame.valid && frame.enter <= frame.exit;
        if meets {
            let (origin, inverse) = (frame.origin.to_array(), frame.inverse.to_array());
            let (set, side) = (&mut self.sets[lane / SIDES], lane % SIDES);
            let mut axis = 0;
            while axis < 3 {
                (set.origins[axis][side], set.inverses[axis][side]) = (origin[axis], inverse[axis]);
                axis += 1;
            }
            set.pads[side] = frame.pad;
            self.put(lane, root, (frame.enter, frame.exit));
            self.frames[lane] = Frame { t_max: f32::INFINITY, ..*frame };
            // A hit as far as the ray goes is taken, and none beyond.
            self.bests[lane] = Best { t: frame.t_max, ..Best::NOTHING };
            (self.rays[lane], self.tops[lane]) = (ray, 0);
            self.live |= 1 << lane;
        }
        meets
    }

    /// All go down, until few are left that have not arrived at a leaf. Returns which have not.
    #[inline(always)]
    fn down<N: Sides>(&mut self, pairs: &Buf<UVec4>) -> u64 {
        let mut state = [(N::all(0.0), N::all(0.0), N::all(0.0)); SETS];
        let mut set = 0;
        while set < self.used {
            let Eights { exit, words, .. } = &self.sets[set];
            state[set] = (N::of(exit), N::of(&words[0]), N::of(&words[1]));
            set += 1;
        }
        loop {
            let (mut inner, mut set) = (0, 0);
            while set < self.used {
                inner |= u64::from(!N::bits(N::leaves(state[set].2)) & 0xFF) << (SIDES * set);
                set += 1;
            }
            if inner == 0 || (4 * inner.count_ones() < 3 * self.live.count_ones()) {
                let mut set = 0;
                while set < self.used {
                    let (exit, splits, tags) = state[set];
                    self.sets[set].exit = exit.numbers();
                    self.sets[set].words = [splits.numbers(), tags.numbers()];
                    set += 1;
                }
                return inner;
            }
            let mut set = 0;
            while set < self.used {
                let inner = (inner >> (SIDES * set)) as u32 & 0xFF;
                if inner != 0 {
                    state[set] = self.step::<N>(set, inner, state[set], pairs);
                }
                set += 1;
            }
        }
    }

    /// One step of eight of them.
    #[inline(always)]
    fn step<N: Sides>(
        &mut self,
        set: usize,
        inner: u32,
        (exit, splits, tags): (N, N, N),
        pairs: &Buf<UVec4>,
    ) -> (N, N, N) {
        let Eights { origins, inverses, pads, enter, .. } = &self.sets[set];
        let origins = [N::of(&origins[0]), N::of(&origins[1]), N::of(&origins[2])];
        let inverses = [N::of(&inverses[0]), N::of(&inverses[1]), N::of(&inverses[2])];
        let (pads, enter) = (N::of(pads), N::of(enter));
        let inverse = N::on_axis(tags, &inverses);
        let (at, wide) = crossed(splits, N::on_axis(tags, &origins), inverse, pads);
        let (first, last) = (at - wide, at + wide);
        let (past, before) = (last.below(enter), first.exceeds(exit));
        let back = inverse.below(N::all(0.0));
        let (near, far) = (N::child(tags, back), N::child(tags, !back));
        let shift = SIDES * set;
        let mut both = !N::bits(past | before) & inner;
        self.pushed = (self.pushed & !(u64::from(inner) << shift)) | u64::from(both) << shift;
        if both != 0 {
            let (far, first, exit) = (far.numbers(), first.numbers(), exit.numbers());
            while both != 0 {
                let lane = both.trailing_zeros() as usize;
                both &= both - 1;
                let entry = [far[lane], first[lane], exit[lane], 0.0].map(f32::to_bits);
                let lane = lane + shift;
                self.stacks[lane].put(self.tops[lane], UVec4::from_array(entry));
                self.tops[lane] += 1;
            }
        }
        let ends = N::choose(past, exit, exit.low(last));
        let some = N::mask(inner);
        let (splits, tags) = N::nodes(pairs, N::choose(past, far, near), some, (splits, tags));
        (ends, splits, tags)
    }

    /// The node that a lane is at.
    #[inline(always)]
    fn node(&self, lane: usize) -> Node {
        let words = &self.sets[lane / SIDES].words;
        Node::from_words(words[0][lane % SIDES].to_bits(), words[1][lane % SIDES].to_bits())
    }

    /// Lets the processor fetch the triangles of a lane's leaf: mostly no more than four. An empty one may name any
    /// place.
    #[inline(always)]
    fn ask_for_leaf(&self, lane: usize, corners: &Buf<Vec4>) {
        let leaf = self.node(lane);
        let at = leaf.first().wrapping_mul(3);
        corners.soon(at);
        if leaf.count() > 1 {
            corners.soon(at.wrapping_add(4));
            corners.soon(at.wrapping_add(8));
        }
    }

    /// Visits the leaf of a lane and goes to its next node. False if its ray is done.
    #[inline(always)]
    fn visit<N: Sides>(
        &mut self,
        lane: usize,
        pairs: &Buf<UVec4>,
        corners: &Buf<Vec4>,
        visits: &mut impl Visits<N>,
    ) -> bool {
        let leaf = self.node(lane);
        let best = &mut self.bests[lane];
        let mut behind = self.pushed >> lane & 1 != 0;
        self.pushed &= !(1 << lane);
        if !leaf.is_empty() {
            if visits.visit(lane, &self.frames[lane], leaf, corners, best) {
                return false;
            }
            behind = false;
        }
        let t = best.t;
        while self.tops[lane] > 0 {
            self.tops[lane] -= 1;
            let entry = self.stacks[lane].at(self.tops[lane]);
            let mut enter = f32::from_bits(entry.y);
            // Behind an empty leaf, which a single ray would not have gone to.
            if behind {
                enter = high(self.sets[lane / SIDES].enter[lane % SIDES], enter);
                behind = false;
            }
            if enter <= t {
                let pair = pairs.at(entry.x >> 1);
                let (word0, word1) = if entry.x & 1 == 0 { (pair.x, pair.y) } else { (pair.z, pair.w) };
                let node = Node::from_words(word0, word1);
                if !node.is_empty() {
                    let exit = low(f32::from_bits(entry.z), t);
                    self.put(lane, node, (enter, exit));
                    return true;
                }
            }
        }
        false
    }
}

/// Answers those of the rays from `first` on that are `left`, and leaves those for which there was no room.
#[inline(always)]
pub(super) fn answer<N: Sides, V: Visits<N>>(
    first: u32,
    left: &mut Left,
    scene: Scene<'_>,
    outcome: &mut Buf<u32>,
    visits: &mut V,
) {
    let Scene { header, pairs, corners, rays } = scene;
    let (tag, root) = (f32::from_bits(Node::PADDING.words().1), pairs.at(0));
    let used = (left.count().div_ceil(SHARE) as usize).clamp(1, SETS);
    let (mut waiting, mut word) = (core::mem::replace(left, Left::first(0)), 0);
    let mut lanes = Lanes {
        used,
        sets: [Eights {
            origins: [[0.0; SIDES]; 3],
            inverses: [[0.0; SIDES]; 3],
            pads: [0.0; SIDES],
            enter: [0.0; SIDES],
            exit: [0.0; SIDES],
            words: [[0.0; SIDES], [tag; SIDES]],
        }; SETS],
        rays: [0; LANES],
        frames: [Frame::NOTHING; LANES],
        bests: [Best::NOTHING; LANES],
        stacks: [const { Stack::new() }; LANES],
        tops: [0; LANES],
        live: 0,
        pushed: 0,
    };
    // Which look for a ray.
    let mut free = u64::MAX >> (64 - SIDES * used);
    loop {
        while free != 0 {
            let lane = free.trailing_zeros() as usize;
            free &= free - 1;
            lanes.live &= !(1 << lane);
            let mut begun = false;
            while !begun {
                let Some(next) = waiting.take(&mut word) else { break };
                let ray = first + next;
                let mut frame = load(ray, rays, header, outcome);
                if V::WHOLE {
                    frame = frame.whole();
                }
                begun = lanes.begin(lane, ray, &frame, Node::from_words(root.x, root.y));
                if begun {
                    visits.begin(lane);
                } else {
                    visits.miss(ray);
                }
            }
        }
        if lanes.live == 0 {
            return;
        }
        let mut arrived = !lanes.down::<N>(pairs) & lanes.live;
        let mut soon = arrived;
        while soon != 0 {
            lanes.ask_for_leaf(soon.trailing_zeros() as usize, corners);
            soon &= soon - 1;
        }
        while arrived != 0 {
            let lane = arrived.trailing_zeros() as usize;
            arrived &= arrived - 1;
            if !lanes.visit(lane, pairs, corners, visits) {
                let ray = lanes.rays[lane];
                if !visits.end(lane, ray, &lanes.frames[lane], &lanes.bests[lane]) {
                    left.put_back(ray - first);
                }
                free |= 1 << lane;
            }
        }
    }
}
