//! The root of a mesh that is expected to be like the one before. Of such a root the host knows all but the box. So it
//! need not look at what the survey found before it has a tree built.

use super::{
    FOUND_HI, FOUND_KEPT, FOUND_LO, FOUND_SMALLEST, FOUND_TRIANGLE, FOUND_VERTEX, JOB_DUST, JOB_EXPECTED,
};
use crate::{
    build::{
        ARGS_ACTIVE, ARGS_BRANCHES, ARGS_CHUNKS, LEVEL_ACTIVE, ROUND_NUMBER, STATE_STATUS, bin::unordered,
        to_bits,
    },
    glam::{UVec4, Vec3},
    math::{div, exp2},
    mem::{Atomics, Buf, Slots},
    pair::Pair,
    put_groups,
};
use core::mem::offset_of;
use raykd_shared::{
    BuildParams, TreeHeader,
    limits::{DUST, LEAST_UNSCALED, MOST_UNSCALED},
    status,
};

const PARAMS_LO: u32 = offset_of!(BuildParams, lo) as u32 / 4;
const PARAMS_HI: u32 = offset_of!(BuildParams, hi) as u32 / 4;
const PARAMS_PRICE: u32 = offset_of!(BuildParams, price) as u32 / 4;
const HEADER_LO: u32 = offset_of!(TreeHeader, lo) as u32 / 4;
const HEADER_HI: u32 = offset_of!(TreeHeader, hi) as u32 / 4;

/// Products that come to less may differ between machines, as parts of them may be subnormal.
const LEAST: f32 = exp2(-60);

/// A component, which is never -0.
#[inline(always)]
fn plain(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x }
}

#[inline(always)]
fn corner(found: &Buf<u32>, at: u32) -> Vec3 {
    let x = move |i: u32| plain(unordered(found.at(at + i)));
    Vec3::new(x(0), x(1), x(2))
}

/// The longer of two extents.
#[inline(always)]
fn longer(a: Pair, b: Pair) -> Pair {
    if b.hi > a.hi || (b.hi == a.hi && b.lo > a.lo) { b } else { a }
}

/// The power of two that an extent is not less than, and less than twice; [`MOST_UNSCALED`] where that is not clear.
#[inline(always)]
fn exponent(extent: Pair) -> i32 {
    let bits = extent.hi.to_bits();
    let e = (bits >> 23) as i32 - 127;
    // A power of two may have been rounded up. The host takes the difference in `f64`, which may round it up, too.
    if bits & 0x007F_FFFF != 0 || extent.lo >= 0.0 {
        e
    } else if -extent.lo > extent.hi * exp2(-50) {
        e - 1
    } else {
        MOST_UNSCALED
    }
}

/// Gives the build the box of its root, if the mesh is as expected: with so many triangles that take part, no scale, no
/// dust. Else it makes the build one of nothing, and the host looks for itself.
pub fn root(
    i: u32,
    found: &Buf<u32>,
    job: &mut Buf<u32>,
    params: &mut Buf<u32>,
    item: &mut Buf<UVec4>,
    header: &mut Buf<u32>,
    level: &mut Buf<u32>,
    args: &mut Buf<u32>,
    round: &mut Buf<u32>,
    state: &mut Buf<u32>,
) {
    if i == 0 {
        let (lo, hi) = (corner(found, FOUND_LO), corner(found, FOUND_HI));
        let d = hi - lo;
        let side = |lo: f32, hi: f32| Pair::sum(hi, -lo);
        let e = exponent(longer(longer(side(lo.x, hi.x), side(lo.y, hi.y)), side(lo.z, hi.z)));
        // Bits of an `f32`, if the extent is one that is not scaled.
        let dust = ((e + DUST + 127) as u32) << 23;
        let kept = found.at(FOUND_KEPT);
        let area = d.x * d.y + d.y * d.z + d.z * d.x;
        let given = f32::from_bits(params.at(PARAMS_PRICE));
        let price = given * area;
        let sound = (found.at(FOUND_VERTEX) == u32::MAX) & (found.at(FOUND_TRIANGLE) == u32::MAX);
        let usual = (LEAST_UNSCALED..MOST_UNSCALED).contains(&e) & (found.at(FOUND_SMALLEST) >= dust);
        let priced = (given == 0.0) | ((area >= LEAST) & (price >= LEAST));
        if sound & usual & priced & (kept == job.at(JOB_EXPECTED)) {
            job.put(JOB_DUST, dust);
            put(params, PARAMS_LO, lo);
            put(params, PARAMS_HI, hi);
            params.put(PARAMS_PRICE, div(price, kept as f32).to_bits());
            put(header, HEADER_LO, lo);
            put(header, HEADER_HI, hi);
            let growth = item.at(1).w;
            item.put(1, to_bits(lo, growth));
            item.put(2, to_bits(hi, 0));
        } else {
            state.or(STATE_STATUS, status::CAPACITY);
            round.put(ROUND_NUMBER, 0);
            put_groups(round, ARGS_BRANCHES, 0);
            level.put(LEVEL_ACTIVE, 0);
            put_groups(args, ARGS_ACTIVE, 0);
            put_groups(args, ARGS_CHUNKS, 0);
        }
    }
}

/// Puts the bits of a vector.
#[inline(always)]
fn put(words: &mut Buf<u32>, at: u32, v: Vec3) {
    words.put(at, v.x.to_bits());
    words.put(at + 1, v.y.to_bits());
    words.put(at + 2, v.z.to_bits());
}

kernel! {
    /// [`root`], once.
    map ROOT = root, threads 64, {
        0 found: read u32, 1 job: write u32, 2 params: write u32, 3 item: write UVec4, 4 header: write u32,
        5 level: write u32, 6 args: write u32, 7 round: write u32, 8 state: write u32,
    }
}
