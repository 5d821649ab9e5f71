//! The cheapest plane of every active node, over the last ends before the bin borders of all three axes and the first starts
//! behind them.

use super::{
    Costs, Item, LEVEL_ACTIVE, LEVEL_DEPTH, Sah,
    bin::{ENDS, FIRST_STARTS, HIST_WORDS, LAST_ENDS, STARTS, UNTOLD, unordered},
    scan::{serial, serial_back},
};
use crate::{
    Group,
    glam::{UVec2, UVec4, Vec3},
    mem::{Buf, Slots},
    trace::frame::component,
};
use raykd_shared::{BuildParams, Node, limits::BINS, rule};

const WORDS: usize = (3 * BINS) as usize;
const LANES: usize = BINS as usize;
/// Nothing starts in the bin: behind all places.
const NONE: u32 = u32::MAX;

/// Position of the border below bin `i`.
#[inline(always)]
fn border(lo: f32, hi: f32, i: u32) -> f32 {
    lo + (hi - lo) * const { 1.0 / BINS as f32 } * i as f32
}

/// Number of the longest axis.
#[inline(always)]
fn longest(d: Vec3) -> u32 {
    if d.x >= d.y && d.x >= d.z {
        0
    } else if d.y >= d.z {
        1
    } else {
        2
    }
}

/// Without the surface area heuristic (Zhou et al. 2008, section 3.2): cut off empty space where that is at least a
/// quarter of an axis, the more the better, else take the middle of the longest axis.
#[inline(always)]
fn median_cost(border: u32, below: u32, above: u32, longest: bool) -> f32 {
    let below_empty = if below == 0 { border } else { 0 };
    let above_empty = if above == 0 { BINS - border } else { 0 };
    let empty = if below_empty > above_empty { below_empty } else { above_empty };
    if empty >= BINS / 4 {
        (BINS - empty) as f32
    } else if longest && border == BINS / 2 {
        BINS as f32
    } else {
        f32::INFINITY
    }
}

/// Chooses the plane of active node `group.id`, and clears its children's sizes: one lane a bin border, ties to the lowest border, then axis.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn split(
    group: Group,
    starts: &mut [u32; WORDS],
    ends: &mut [u32; WORDS],
    lasts: &mut [u32; WORDS],
    firsts: &mut [u32; WORDS],
    costs: &mut [u32; LANES],
    axes: &mut [u32; LANES],
    places: &mut [u32; LANES],
    params: &Buf<BuildParams>,
    level: &Buf<u32>,
    active: &Buf<UVec4>,
    hists: &Buf<u32>,
    planes: &mut Buf<UVec2>,
    sizes: &mut Buf<u32>,
) {
    if group.id < level.at(LEVEL_ACTIVE) {
        let params = params.at(0);
        let item = Item::load(active, group.id);
        let step = group.sharers();
        lanes!(group, ..step, |lane| {
            let at = group.id * HIST_WORDS;
            let mut word = lane;
            while word < WORDS as u32 {
                starts.put(word, hists.at(at + STARTS + word));
                ends.put(word, hists.at(at + ENDS + word));
                lasts.put(word, hists.at(at + LAST_ENDS + word));
                firsts.put(word, !hists.at(at + FIRST_STARTS + word));
                word += step;
            }
            let mut child = lane;
            while child < 2 {
                sizes.put(2 * group.id + child, 0);
                child += step;
            }
        });
        // How many start before each border, and how many end behind it.
        lanes!(group, ..6, |lane| {
            let first = (lane >> 1) * BINS;
            if lane & 1 == 0 {
                serial(starts, first, BINS);
            } else {
                serial_back(ends, first, BINS);
            }
        });
        let sah = Sah::new(item.lo, item.hi, item.count, Costs::of(&params));
        let median = (params.rule & rule::MEDIAN) != 0;
        let longest = longest(item.hi - item.lo);
        lanes!(group, |lane| {
            let mut best = f32::INFINITY;
            let mut best_axis = Node::LEAF;
            let mut place = 0.0;
            let mut axis = 0;
            while axis < 3 {
                let word = axis * BINS + lane;
                let (below, above) = (starts.at(word), ends.at(word));
                let (lo, hi) = (component(item.lo, axis), component(item.hi, axis));
                let mut weigh = |cost: f32, at: f32| {
                    if cost < best {
                        best = cost;
                        best_axis = axis;
                        place = at;
                    }
                };
                if median {
                    let at = border(lo, hi, lane);
                    if lo < at && at < hi {
                        weigh(median_cost(lane, below, above, axis == longest), at);
                    }
                } else {
                    let across = sah.across(axis);
                    // Faces in the bins on either side of the border, for between faces the cost has no minimum: the last end
                    // before it,
                    let last = if lane > 0 { lasts.at(word - 1) } else { 0 };
                    if last != 0 {
                        // Nothing ends between there and the border: no more lies above. What starts there or
                        // behind lies not below, if that is all that starts in the bin.
                        let below = if firsts.at(word - 1) >= last { starts.at(word - 1) } else { below };
                        let at = unordered(last);
                        weigh(across.cut(at, below as f32, above as f32), at);
                    } else if firsts.at(word) == !UNTOLD {
                        // or, instead of a first start that is not told, the border;
                        let at = border(lo, hi, lane);
                        weigh(across.cut(at, below as f32, above as f32), at);
                    }
                    // and the first start behind it.
                    let first = firsts.at(word);
                    if first != !UNTOLD && first != NONE {
                        // What ends there or before lies not above, if that is all that ends in the bin; what starts in
                        // the last one ends in it, too.
                        let above = if lasts.at(word) > first { above } else { ends.at(word + 1) };
                        let at = unordered(first);
                        weigh(across.cut(at, below as f32, above as f32), at);
                    }
                }
                axis += 1;
            }
            costs.put(lane, best.to_bits());
            axes.put(lane, best_axis);
            places.put(lane, place.to_bits());
        });
        lanes!(group, ..1, |_lane| {
            let mut best = if median { f32::INFINITY } else { sah.leaf };
            let mut plane = UVec2::new(Node::LEAF, 0);
            if level.at(LEVEL_DEPTH) < params.max_depth {
                let mut b = 0;
                while b < BINS {
                    let cost = f32::from_bits(costs.at(b));
                    if cost < best {
                        best = cost;
                        plane = UVec2::new(axes.at(b), places.at(b));
                    }
                    b += 1;
                }
            }
            planes.put(group.id, plane);
        });
    }
}

kernel! {
    /// [`split`] over all active nodes of a level.
    group SPLIT = split, threads 32, shared [starts: WORDS, ends: WORDS, lasts: WORDS, firsts: WORDS, costs: LANES, axes: LANES, places: LANES], {
        0 params: read BuildParams, 1 level: read u32, 2 active: read UVec4, 3 hists: read u32,
        4 planes: write UVec2, 5 sizes: write u32,
    }
}
