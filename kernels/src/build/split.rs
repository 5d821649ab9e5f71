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
    math::{Number, whole},
    mem::{Buf, Slots},
    trace::frame::component,
};
use raykd_shared::{BuildParams, Node, limits::BINS, rule};

/// Borders that a lane weighs side by side.
#[cfg(target_arch = "spirv")]
type Bins = f32;
#[cfg(not(target_arch = "spirv"))]
type Bins = crate::glam::Vec4;

const WORDS: u32 = 3 * BINS;
/// What is told of the bins; a word before them and some behind are read, but do not matter.
const ROOM: usize = WORDS as usize + 4;
const LANES: usize = BINS as usize;
/// Nothing ends in the bin, or its first start is not told.
const BEFORE_ALL: f32 = f32::NEG_INFINITY;
/// Nothing starts in the bin.
const BEHIND_ALL: f32 = f32::INFINITY;

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
fn median_cost(border: Bins, below: Bins, above: Bins, longest: bool) -> Bins {
    let all = Bins::all;
    let (bins, none) = (all(BINS as f32), all(0.0));
    let below_empty = Bins::choose(below.is(none), border, none);
    let above_empty = Bins::choose(above.is(none), bins - border, none);
    let empty = Bins::choose(below_empty.exceeds(above_empty), below_empty, above_empty);
    let middle = all(if longest { (BINS / 2) as f32 } else { BEFORE_ALL });
    let cost = Bins::choose(border.is(middle), bins, all(f32::INFINITY));
    Bins::choose(all((BINS / 4) as f32).exceeds(empty), cost, bins - empty)
}

/// Chooses the plane of active node `group.id`, and clears its children's sizes: a lane a border, or some, ties to the lowest border, then axis.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
#[inline(always)]
pub fn split(
    group: Group,
    starts: &mut [u32; ROOM],
    ends: &mut [u32; ROOM],
    lasts: &mut [u32; ROOM],
    firsts: &mut [u32; ROOM],
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
            while word < WORDS {
                starts.put(1 + word, hists.at(at + STARTS + word));
                ends.put(1 + word, hists.at(at + ENDS + word));
                let last = hists.at(at + LAST_ENDS + word);
                let first = hists.at(at + FIRST_STARTS + word);
                let last = if last == 0 { BEFORE_ALL } else { unordered(last) };
                let told = if first == 0 { BEHIND_ALL } else { unordered(!first) };
                lasts.put(1 + word, last.to_bits());
                firsts.put(1 + word, if first == UNTOLD { BEFORE_ALL } else { told }.to_bits());
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
            let first = 1 + (lane >> 1) * BINS;
            if lane & 1 == 0 {
                serial(starts, first, BINS);
            } else {
                serial_back(ends, first, BINS);
            }
        });
        let sah = Sah::new(item.lo, item.hi, item.count, Costs::of(&params));
        let median = (params.rule & rule::MEDIAN) != 0;
        let longest = longest(item.hi - item.lo);
        lanes!(group, ..BINS / Bins::WIDTH, |lane| {
            let all = Bins::all;
            let bin = lane * Bins::WIDTH;
            let number = Bins::numbers(bin);
            let mut best = all(f32::INFINITY);
            let mut best_axis = all(0.0);
            let mut place = all(0.0);
            let mut axis = 0;
            while axis < 3 {
                let word = 1 + axis * BINS + bin;
                let (below, above) = (Bins::counts(starts, word), Bins::counts(ends, word));
                let (lo, hi) = (component(item.lo, axis), component(item.hi, axis));
                let border = all(lo) + all((hi - lo) * const { 1.0 / BINS as f32 }) * number;
                let mut weigh = |cost: Bins, at: Bins| {
                    let better = best.exceeds(cost);
                    best = Bins::choose(better, cost, best);
                    best_axis = Bins::choose(better, all(axis as f32), best_axis);
                    place = Bins::choose(better, at, place);
                };
                if median {
                    let inside = border.exceeds(all(lo)) & all(hi).exceeds(border);
                    let cost = median_cost(number, below, above, axis == longest);
                    weigh(Bins::choose(inside, cost, all(f32::INFINITY)), border);
                } else {
                    // Faces in the bins on either side of the border, for between faces the cost has no minimum: the last end
                    // before it,
                    let across = sah.across(axis);
                    let never = all(BEFORE_ALL);
                    let first_bin = all(0.5).exceeds(number);
                    let last = Bins::choose(first_bin, never, Bins::bits(lasts, word - 1));
                    let first = Bins::bits(firsts, word);
                    let is_last = last.exceeds(never);
                    // or, instead of a first start that is not told, the border;
                    let instead = Bins::choose(never.is(first), border, never);
                    let at = Bins::choose(is_last, last, instead);
                    // Nothing ends between there and the border: no more lies above. What starts there or
                    // behind lies not below, if that is all that starts in the bin.
                    let later = is_last & !last.exceeds(Bins::bits(firsts, word - 1));
                    let before = Bins::counts(starts, word - 1);
                    weigh(across.cut(at, Bins::choose(later, before, below), above), at);
                    // and the first start behind it. What ends there or before lies not above, if that is all that ends in
                    // the bin; what starts in the last one ends in it, too.
                    let longer = Bins::bits(lasts, word).exceeds(first);
                    let behind = Bins::counts(ends, word + 1);
                    weigh(across.cut(first, below, Bins::choose(longer, above, behind)), first);
                }
                axis += 1;
            }
            best.put(costs, bin);
            best_axis.put(axes, bin);
            place.put(places, bin);
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
                        plane = UVec2::new(whole(f32::from_bits(axes.at(b))), places.at(b));
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
    group SPLIT = split, threads 32, shared [starts: ROOM, ends: ROOM, lasts: ROOM, firsts: ROOM, costs: LANES, axes: LANES, places: LANES], {
        0 params: read BuildParams, 1 level: read u32, 2 active: read UVec4, 3 hists: read u32,
        4 planes: write UVec2, 5 sizes: write u32,
    }
}
