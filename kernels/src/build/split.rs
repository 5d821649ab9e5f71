//! The cheapest plane of every active node, over the last ends before the bin borders of all three axes and
//! the first starts behind them.

use super::{
    Costs, Item, Sah, SplitPlane,
    bin::{BEFORE, ENDS, FIRST_STARTS, LAST_ENDS, STARTS, TABLE, UNTOLD, unordered},
    longest_axis,
    scan::{serial, serial_back},
};
use crate::{
    Group, ON_GPU,
    glam::UVec2,
    math::{Listed, Wide, component},
    mem::{Atomics, Slots},
};
use raykd_shared::{BuildParams, limits::BINS, rule};

/// How many lanes share out the axes of a border: a GPU waits for the arithmetic, a CPU for the comparisons at the end.
const SHARES: u32 = if ON_GPU { 3 } else { 1 };
/// Lanes that weigh planes: a workgroup has as many at least.
pub const WEIGHING: u32 = SHARES * BINS / Wide::WIDTH;
const _: () = assert!(SHARES == 1 || Wide::WIDTH == 1, "what a lane finds stands in a row");
/// How many cheapest planes they find.
const PLANES: u32 = SHARES * BINS;

/// Cost of the cheapest plane, or of the node as a leaf.
const COST: u32 = 0;
/// Number of the first plane of that cost, or [`NONE`].
const PICK: u32 = 1;
/// If none, [`SplitPlane::words`] of the plane there is instead.
const INSTEAD: u32 = 2;
// Each lane's cheapest planes: what they cost, their axes and places.
const COSTS: u32 = INSTEAD + 2;
const AXES: u32 = COSTS + PLANES;
const PLACES: u32 = AXES + PLANES;
// On a GPU, how many start and end in each four bins, in the order of the table.
const FOURS: u32 = PLACES + PLANES;
/// Words for all of it.
pub const FOUND: usize = (FOURS + 6 * BINS / 4) as usize;
const _: () = assert!(BINS == 32, "eight times four bins");
const NONE: u32 = u32::MAX;

/// Nothing ends in the bin, or its first start is not told.
const BEFORE_ALL: f32 = f32::NEG_INFINITY;
/// Nothing starts in the bin.
const BEHIND_ALL: f32 = f32::INFINITY;

/// Without the surface area heuristic (Zhou et al. 2008, section 3.2): cut off empty space where that is at
/// least a quarter of an axis, the more the better, else take the middle of the longest axis.
#[inline(always)]
fn median_cost<Bins: Listed>(border: Bins, below: Bins, above: Bins, longest: bool) -> Bins {
    let all = Bins::all;
    let (bins, none) = (all(BINS as f32), all(0.0));
    let below_empty = Bins::choose(below.is(none), border, none);
    let above_empty = Bins::choose(above.is(none), bins - border, none);
    let empty = Bins::choose(below_empty.exceeds(above_empty), below_empty, above_empty);
    let middle = all(if longest { (BINS / 2) as f32 } else { BEFORE_ALL });
    let cost = Bins::choose(border.is(middle), bins, all(f32::INFINITY));
    Bins::choose(all((BINS / 4) as f32).exceeds(empty), cost, bins - empty)
}

/// Turns the last ends and first starts of bins into places, and on a CPU their counts into how many start before each
/// border and how many end behind it; and there is nothing found yet.
#[inline(always)]
fn start(group: Group, table: &mut [u32; TABLE], found: &mut [u32; FOUND], leaf: u32, instead: SplitPlane) {
    let step = group.sharers();
    lanes!(group, ..step, |lane| {
        let mut word = BEFORE + lane;
        while word < BEFORE + 3 * BINS {
            let (last, first) = (table.at(LAST_ENDS + word), table.at(FIRST_STARTS + word));
            let last = if last == 0 { BEFORE_ALL } else { unordered(last) };
            let told = if first == 0 { BEHIND_ALL } else { unordered(!first) };
            table.put(LAST_ENDS + word, last.to_bits());
            table.put(FIRST_STARTS + word, if first == UNTOLD { BEFORE_ALL } else { told }.to_bits());
            word += step;
        }
        // A GPU's lanes each add up their own, see [`Counts`], most of them from sums of four.
        let mut four = lane;
        while ON_GPU && four < 6 * BINS / 4 {
            let [a, b, c, d] = table.four(BEFORE + STARTS + 4 * four);
            found.put(FOURS + four, a + b + c + d);
            four += step;
        }
        let mut row = lane;
        while !ON_GPU && row < 6 {
            let first = BEFORE + (row >> 1) * BINS;
            if row & 1 == 0 {
                serial(table, STARTS + first, BINS);
            } else {
                serial_back(table, ENDS + first, BINS);
            }
            row += step;
        }
        if lane == 0 {
            found.put(COST, leaf);
            found.put(PICK, NONE);
            let words = instead.words();
            found.put(INSTEAD, words.x);
            found.put(INSTEAD + 1, words.y);
        }
    });
}

/// The cheapest planes by some borders: what they cost, their axes and places.
#[derive(Clone, Copy)]
struct Best<Bins> {
    cost: Bins,
    axis: Bins,
    at: Bins,
}

impl<Bins: Listed> Best<Bins> {
    /// Keeps the cheaper ones of these and planes across `axis`.
    #[inline(always)]
    fn weigh(&mut self, cost: Bins, axis: u32, at: Bins) {
        let better = self.cost.exceeds(cost);
        self.cost = Bins::choose(better, cost, self.cost);
        self.axis = Bins::choose(better, Bins::all(axis as f32), self.axis);
        self.at = Bins::choose(better, at, self.at);
    }
}

/// How many references start before some borders, and before the ones before those; how many end behind them, and
/// behind the next ones.
#[derive(Clone, Copy)]
struct Counts<Bins> {
    below: Bins,
    before: Bins,
    above: Bins,
    behind: Bins,
}

impl<Bins: Listed> Counts<Bins> {
    /// Those of bin `bin`, whose word is `word`, and on.
    #[inline(always)]
    fn of(table: &[u32; TABLE], found: &[u32; FOUND], bin: u32, word: u32) -> Self {
        if !ON_GPU {
            // As `start` added them up.
            return Self {
                below: Bins::counts(table, STARTS + word),
                before: Bins::counts(table, STARTS + word - 1),
                above: Bins::counts(table, ENDS + word),
                behind: Bins::counts(table, ENDS + word + 1),
            };
        }
        // Fours of bins on either side, then those of its own four.
        let (mut below, mut above) = (0, 0);
        let mut take = |is_below: bool, starts: u32, is_above: bool, ends: u32| {
            below += if is_below { starts } else { 0 };
            above += if is_above { ends } else { 0 };
        };
        let (first, own) = (word - bin, bin / 4 * 4);
        let mut i = 0;
        while i < BINS {
            let four = FOURS + (first - BEFORE + i) / 4;
            let (starts, ends) = (found.four(four), found.four(four + (ENDS - STARTS) / 4));
            take(i < own, starts[0], i > own, ends[0]);
            take(i + 4 < own, starts[1], i + 4 > own, ends[1]);
            take(i + 8 < own, starts[2], i + 8 > own, ends[2]);
            take(i + 12 < own, starts[3], i + 12 > own, ends[3]);
            i += 16;
        }
        let (starts, ends) = (table.four(STARTS + first + own), table.four(ENDS + first + own));
        take(own < bin, starts[0], own >= bin, ends[0]);
        take(own + 1 < bin, starts[1], own + 1 >= bin, ends[1]);
        take(own + 2 < bin, starts[2], own + 2 >= bin, ends[2]);
        take(false, 0, true, ends[3]);
        let count = |n: u32| Bins::all(n as f32);
        Self {
            below: count(below),
            // Of the first border it does not matter.
            before: count(u32::wrapping_sub(below, table.at(STARTS + word - 1))),
            above: count(above),
            behind: count(above - table.at(ENDS + word)),
        }
    }
}

/// Some borders on an axis: their numbers and places, what lies on either side of each, and the word of their bins.
#[derive(Clone, Copy)]
struct Borders<Bins> {
    number: Bins,
    at: Bins,
    counts: Counts<Bins>,
    word: u32,
}

impl<Bins: Listed> Borders<Bins> {
    #[inline(always)]
    fn new(table: &[u32; TABLE], found: &[u32; FOUND], bin: u32, axis: u32, lo: f32, hi: f32) -> Self {
        let all = Bins::all;
        let word = BEFORE + axis * BINS + bin;
        let number = Bins::numbers(bin);
        Self {
            number,
            at: all(lo) + all((hi - lo) * const { 1.0 / BINS as f32 }) * number,
            counts: Counts::of(table, found, bin, word),
            word,
        }
    }

    /// Weighs faces in the bins on either side of each border, for between faces the cost has no minimum.
    #[inline(always)]
    fn weigh_faces(self, table: &[u32; TABLE], sah: &Sah, axis: u32, best: &mut Best<Bins>) {
        let Self { number, at: border, counts: Counts { below, before, above, behind }, word } = self;
        let all = Bins::all;
        // The last end before it,
        let across = sah.across(axis);
        let never = all(BEFORE_ALL);
        let first_bin = all(0.5).exceeds(number);
        let last = Bins::choose(first_bin, never, Bins::bits(table, LAST_ENDS + word - 1));
        let first = Bins::bits(table, FIRST_STARTS + word);
        let is_last = last.exceeds(never);
        // or, instead of a first start that is not told, the border;
        let instead = Bins::choose(never.is(first), border, never);
        let at = Bins::choose(is_last, last, instead);
        // Nothing ends between there and the border: no more lies above. What starts there or
        // behind lies not below, if that is all that starts in the bin.
        let later = is_last & !last.exceeds(Bins::bits(table, FIRST_STARTS + word - 1));
        best.weigh(across.cut(at, Bins::choose(later, before, below), above), axis, at);
        // and the first start behind it. What ends there or before lies not above, if that is all that ends in
        // the bin; what starts in the last one ends in it, too.
        let longer = Bins::bits(table, LAST_ENDS + word).exceeds(first);
        best.weigh(across.cut(first, below, Bins::choose(longer, above, behind)), axis, first);
    }
}

/// Finds the plane of a node whose histogram stands in `table`, and changes that: a lane has a border on an axis, or
/// some on all. Of equally cheap planes the one by the lowest border is taken, then that across the lowest axis. See
/// [`chosen`].
#[inline(always)]
pub fn find(
    group: Group,
    table: &mut [u32; TABLE],
    found: &mut [u32; FOUND],
    params: &BuildParams,
    depth: u32,
    item: &Item,
) {
    by_eight!(
        group.usual,
        find_by::<Eight>(group, table, found, params, depth, item),
        else find_by::<Wide>(group, table, found, params, depth, item)
    );
}

/// [`find`], so many borders at a time.
#[inline(always)]
fn find_by<Bins: Listed>(
    group: Group,
    table: &mut [u32; TABLE],
    found: &mut [u32; FOUND],
    params: &BuildParams,
    depth: u32,
    item: &Item,
) {
    let step = group.sharers();
    let costs = Costs::of(params);
    let most = costs.most(item.lo, item.hi, item.count, item.growth);
    let sah = Sah::new(item.lo, item.hi, item.count, most, costs);
    let median = (params.rule & rule::MEDIAN) != 0;
    let leaf = if median { f32::INFINITY } else { sah.leaf }.to_bits();
    let pays = sah.may_pay & !median & (depth < params.max_depth);
    let instead = if pays { sah.middle(item.count) } else { SplitPlane::LEAF };
    start(group, table, found, leaf, instead);
    let longest = longest_axis(item.hi - item.lo);
    lanes!(group, ..SHARES * BINS / Bins::WIDTH, |lane| {
        let all = Bins::all;
        let bin = lane * Bins::WIDTH % BINS;
        let mut best = Best { cost: all(f32::INFINITY), axis: all(0.0), at: all(0.0) };
        let mut axis = lane * Bins::WIDTH / BINS;
        while axis < 3 {
            let (lo, hi) = (component(item.lo, axis), component(item.hi, axis));
            let borders = Borders::<Bins>::new(table, found, bin, axis, lo, hi);
            if median {
                let Borders { number, at, counts: Counts { below, above, .. }, .. } = borders;
                let inside = at.exceeds(all(lo)) & all(hi).exceeds(at);
                let inside = inside & !(below + above).exceeds(all(most));
                let cost = median_cost(number, below, above, axis == longest);
                best.weigh(Bins::choose(inside, cost, all(f32::INFINITY)), axis, at);
            } else {
                borders.weigh_faces(table, &sah, axis, &mut best);
            }
            axis += SHARES;
        }
        // By border, then axis: of equally cheap planes the first is taken.
        let bin = lane * Bins::WIDTH;
        let first = bin % BINS * SHARES + bin / BINS;
        best.cost.put(found, COSTS + first);
        best.axis.put(found, AXES + first);
        best.at.put(found, PLACES + first);
        // Costs are positive, so bits order as numbers do.
        let mut plane = first;
        while depth < params.max_depth && plane < first + Bins::WIDTH {
            let cost = found.at(COSTS + plane);
            // Most are not, and lanes that change the same word wait for each other.
            if cost < leaf {
                found.lower(COST, cost);
            }
            plane += 1;
        }
    });
    lanes!(group, ..step, |lane| {
        let mut plane = lane;
        while found.at(COST) < leaf && plane < PLANES {
            if found.at(COSTS + plane) == found.at(COST) {
                found.lower(PICK, plane);
            }
            plane += step;
        }
    });
}

/// The plane that [`find`] found.
#[inline(always)]
pub fn chosen(found: &[u32; FOUND]) -> SplitPlane {
    let pick = found.at(PICK);
    if pick == NONE {
        SplitPlane::from_words(UVec2::new(found.at(INSTEAD), found.at(INSTEAD + 1)))
    } else {
        let number = move |found: &[u32; FOUND], word: u32| f32::from_bits(found.at(word + pick));
        SplitPlane { axis: number(found, AXES) as u32, at: number(found, PLACES), pays: true }
    }
}
