//! Rays each at a node of its own, on a CPU, for those that do not go together ([`packet`](super::packet)): eight take
//! their steps down at once, then each visits its leaf alone, and one that is done makes room for the next. Each does
//! what it does in [`stack`](super::traverse::stack).

use super::{
    frame::Frame,
    intersect::{Best, strict::Strict},
    job::{load, record},
    traverse::{
        crossing::crossed,
        leaf::{self, Every},
    },
};
use crate::{
    eight::SIDE_BY_SIDE,
    glam::{UVec4, Vec4},
    math::{Sides, high, low},
    mem::{Buf, Slots, Stack},
};
use raykd_shared::{MISS, Node, TreeHeader, limits::MAX_DEPTH};

/// While fewer than this are on their way down, those that have arrived do not wait for them.
const KEEP: u32 = 5;

const SIDES: usize = SIDE_BY_SIDE as usize;

/// What is made of the leaves that rays visit, each alone.
pub(super) trait Visits {
    /// Whether rays are as [`Frame::whole`] makes them.
    const WHOLE: bool;
    /// A lane begins with a ray.
    fn begin(&mut self, lane: usize);
    /// Tests the triangles of a leaf. True if the ray has enough.
    fn visit(&mut self, lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool;
    /// Answers ray `i`, which is done. False if it is left to others.
    fn end(&mut self, lane: usize, i: u32, ray: &Frame, best: &Best) -> bool;
    /// Answers a ray that meets nothing.
    fn miss(&mut self, i: u32);
}

/// Hits by the default test.
pub(super) struct Hits<'a, const ANY: bool>(pub &'a mut Buf<UVec4>);

impl<const ANY: bool> Visits for Hits<'_, ANY> {
    const WHOLE: bool = false;

    #[inline(always)]
    fn begin(&mut self, _lane: usize) {}

    #[inline(always)]
    fn visit(&mut self, _lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool {
        leaf::visit(Strict, ray, leaf, corners, &mut Every, best);
        ANY && best.triangle != MISS
    }

    #[inline(always)]
    fn end(&mut self, _lane: usize, i: u32, ray: &Frame, best: &Best) -> bool {
        self.0.put(i, record(ray, best));
        true
    }

    #[inline(always)]
    fn miss(&mut self, i: u32) {
        self.0.put(i, UVec4::new(MISS, 0, 0, 0));
    }
}

/// Eight rays; what their steps need lies side by side.
struct Lanes {
    origins: [[f32; SIDES]; 3],
    inverses: [[f32; SIDES]; 3],
    pads: [f32; SIDES],
    enter: [f32; SIDES],
    exit: [f32; SIDES],
    /// The words of the nodes that they are at; those without a ray are at a leaf.
    words: [[f32; SIDES]; 2],
    /// Which rays they are.
    rays: [u32; SIDES],
    frames: [Frame; SIDES],
    bests: [Best; SIDES],
    /// Nodes for later: their numbers, where the interval begins there and where it ends.
    stacks: [Stack<UVec4, { MAX_DEPTH as usize }>; SIDES],
    tops: [u32; SIDES],
    /// Which have a ray.
    live: u32,
    /// Which have left a child for later by their last step.
    pushed: u32,
}

impl Lanes {
    fn put(&mut self, lane: usize, node: Node, (enter, exit): (f32, f32)) {
        let (word0, word1) = node.words();
        (self.words[0][lane], self.words[1][lane]) = (f32::from_bits(word0), f32::from_bits(word1));
        (self.enter[lane], self.exit[lane]) = (enter, exit);
    }

    /// Gives a lane a ray. False if that meets nothing.
    #[inline(always)]
    fn begin(&mut self, lane: usize, ray: u32, frame: &Frame, root: Node) -> bool {
        let meets = frame.valid && frame.enter <= frame.exit;
        if meets {
            let (origin, inverse) = (frame.origin.to_array(), frame.inverse.to_array());
            let mut axis = 0;
            while axis < 3 {
                (self.origins[axis][lane], self.inverses[axis][lane]) = (origin[axis], inverse[axis]);
                axis += 1;
            }
            self.pads[lane] = frame.pad;
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
    fn down<N: Sides>(&mut self, pairs: &Buf<UVec4>) -> u32 {
        let three = |of: &[[f32; SIDES]; 3]| [N::of(&of[0]), N::of(&of[1]), N::of(&of[2])];
        let (origins, inverses, pads) = (three(&self.origins), three(&self.inverses), N::of(&self.pads));
        let (enter, mut exit) = (N::of(&self.enter), N::of(&self.exit));
        let (mut splits, mut tags) = (N::of(&self.words[0]), N::of(&self.words[1]));
        loop {
            let leaves = N::leaves(tags);
            let inner = !N::bits(leaves) & 0xFF;
            if inner == 0 || (inner.count_ones() < KEEP && self.live & !inner != 0) {
                self.exit = exit.numbers();
                self.words = [splits.numbers(), tags.numbers()];
                return inner;
            }
            let inverse = N::on_axis(tags, &inverses);
            let (at, wide) = crossed(splits, N::on_axis(tags, &origins), inverse, pads);
            let (first, last) = (at - wide, at + wide);
            let (past, before) = (last.below(enter), first.exceeds(exit));
            let back = inverse.below(N::all(0.0));
            let (near, far) = (N::child(tags, back), N::child(tags, !back));
            let mut both = !N::bits(past | before) & inner;
            self.pushed = (self.pushed & !inner) | both;
            if both != 0 {
                let (far, first, exit) = (far.numbers(), first.numbers(), exit.numbers());
                while both != 0 {
                    let lane = both.trailing_zeros() as usize;
                    both &= both - 1;
                    let entry = [far[lane], first[lane], exit[lane], 0.0].map(f32::to_bits);
                    self.stacks[lane].put(self.tops[lane], UVec4::from_array(entry));
                    self.tops[lane] += 1;
                }
            }
            exit = N::choose(past, exit, exit.low(last));
            (splits, tags) = N::nodes(pairs, N::choose(past, far, near), !leaves, (splits, tags));
        }
    }

    /// Visits the leaf of a lane and goes to its next node. False if its ray is done.
    #[inline(always)]
    fn visit(
        &mut self,
        lane: usize,
        pairs: &Buf<UVec4>,
        corners: &Buf<Vec4>,
        visits: &mut impl Visits,
    ) -> bool {
        let leaf = Node::from_words(self.words[0][lane].to_bits(), self.words[1][lane].to_bits());
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
                enter = high(self.enter[lane], enter);
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

/// Answers those of 64 rays from `first` on whose bits are in `left`, and returns which are left still.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub(super) fn answer<N: Sides, V: Visits>(
    first: u32,
    mut left: u64,
    header: &TreeHeader,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    outcome: &mut Buf<u32>,
    mut visits: V,
) -> u64 {
    // Which have no answer.
    let mut back = 0u64;
    let (tag, root) = (f32::from_bits(Node::PADDING.words().1), pairs.at(0));
    let mut lanes = Lanes {
        origins: [[0.0; SIDES]; 3],
        inverses: [[0.0; SIDES]; 3],
        pads: [0.0; SIDES],
        enter: [0.0; SIDES],
        exit: [0.0; SIDES],
        words: [[0.0; SIDES], [tag; SIDES]],
        rays: [0; SIDES],
        frames: [Frame::NOTHING; SIDES],
        bests: [Best::NOTHING; SIDES],
        stacks: [const { Stack::new() }; SIDES],
        tops: [0; SIDES],
        live: 0,
        pushed: 0,
    };
    // Which look for a ray.
    let mut free = 0xFFu32;
    loop {
        while free != 0 {
            let lane = free.trailing_zeros() as usize;
            free &= free - 1;
            lanes.live &= !(1 << lane);
            let mut begun = false;
            while left != 0 && !begun {
                let ray = first + left.trailing_zeros();
                left &= left - 1;
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
            return back;
        }
        let mut arrived = !lanes.down::<N>(pairs) & lanes.live;
        let mut soon = arrived;
        while soon != 0 {
            // An empty leaf may name any place.
            corners.soon(lanes.words[0][soon.trailing_zeros() as usize].to_bits().wrapping_mul(3));
            soon &= soon - 1;
        }
        while arrived != 0 {
            let lane = arrived.trailing_zeros() as usize;
            arrived &= arrived - 1;
            if !lanes.visit(lane, pairs, corners, &mut visits) {
                let ray = lanes.rays[lane];
                if !visits.end(lane, ray, &lanes.frames[lane], &lanes.bests[lane]) {
                    back |= 1 << (ray - first);
                }
                free |= 1 << lane;
            }
        }
    }
}
