//! What can be asked of a ray, and the kernels that answer: the default triangle test with every way through
//! the tree, every other test with a stack, and all tests without a tree.

use super::{
    intersect::{
        Intersector, baldwin::Baldwin, exact::Exact, moeller::Moeller, plane::Plane, strict::Strict,
        woop::Woop,
    },
    job::{JOB_ANY, JOB_LIMIT, JOB_RAYS, OUTCOME_STATUS, THREADS, load, record},
    traverse::{
        self, Steps,
        brute::brute,
        leaf::{After, Every, Except},
        stack::ASIDE,
    },
};
use crate::{
    glam::{UVec4, Vec4},
    kernel::Group,
    mem::{Atomics, Buf, Slots, aside},
};
use raykd_shared::{MISS, TreeHeader, status};

/// Declares something of the buffers that all queries of the tree bind.
macro_rules! of_query {
    ($declare:ident { $($head:tt)* } { $($own:tt)* }) => {
        $declare! {
            $($head)* Query {
                0 job: read u32, 1 header: read TreeHeader, 2 pairs: read UVec4, 3 corners: read Vec4,
                4 rays: read Vec4, 5 hits: write UVec4, 6 outcome: write u32,
            } $($own)*
        }
    };
}

/// Declares something of the buffers that all tests of every triangle bind.
macro_rules! of_brute {
    ($declare:ident { $($head:tt)* } { $($own:tt)* }) => {
        $declare! {
            $($head)* Brute {
                0 job: read u32, 1 header: read TreeHeader, 2 kept: read u32, 3 positions: read f32,
                4 indices: read u32, 5 rays: read Vec4, 6 hits: write UVec4, 7 outcome: write u32,
                8 bests: write UVec4,
            } $($own)*
        }
    };
}

of_query! {
    bindings {
        /// What all queries of the tree bind.
    } {}
}
of_brute! {
    bindings {
        /// What all tests of every triangle bind.
    } {}
}

/// Words of workgroup memory.
const SHARED: usize = ASIDE * THREADS as usize;

/// Declares the kernel of a query: how it answers ray `i`, whether it writes counts of its steps too, and buffers that
/// only it binds.
macro_rules! query {
    ($(#[$doc:meta])* $file:ident::$name:ident $($counts:ident)? = |$i:pat_param, $ray:ident, $pairs:ident,
     $corners:ident, $any:pat_param, $aside:pat_param, $steps:ident| $walk:expr
     $(, { $($b:tt $more:ident: $t:ty),* $(,)? })?) => {
        $(#[$doc])*
        pub mod $file {
            use super::*;

            /// Answers the rays of a workgroup, one a lane.
            #[inline(always)]
            #[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
            pub fn answer(
                group: Group,
                shared: &mut [u32; SHARED],
                job: &Buf<u32>,
                header: &Buf<TreeHeader>,
                $pairs: &Buf<UVec4>,
                $corners: &Buf<Vec4>,
                rays: &Buf<Vec4>,
                hits: &mut Buf<UVec4>,
                outcome: &mut Buf<u32>,
                $($counts: &mut Buf<UVec4>,)?
                $($($more: &Buf<$t>),*)?
            ) {
                lanes!(group, |lane| {
                    let i = group.id * group.width + lane;
                    if i < job.at(JOB_RAYS) {
                        let $ray = &mut load(i, rays, &header.at(0), outcome);
                        let ($i, $any) = (i, job.at(JOB_ANY) != 0);
                        let ($aside, $steps) = (&mut aside::<ASIDE, SHARED>(shared, lane), &mut Steps::default());
                        let best = $walk;
                        hits.put(i, record($ray, &best));
                        $($counts.put(i, $steps.words());)?
                        if $steps.status != 0 {
                            outcome.or(OUTCOME_STATUS, $steps.status);
                        }
                    }
                });
            }

            of_query! {
                kernel { $(#[$doc])* group $name = answer, threads 64, shared [shared: SHARED], query: }
                { , { $(7 $counts: write UVec4,)? $($($b $more: read $t),*)? } }
            }
        }
    };
}

/// Declares the kernel that tests every triangle.
macro_rules! brute {
    ($file:ident::$name:ident = $test:ident) => {
        #[doc = concat!("Every triangle, by [`", stringify!($test), "`].")]
        pub mod $file {
            use super::*;

            of_brute! {
                kernel { #[doc = "All rays against a slice of the triangles."] map $name = brute::<$test>, threads 64, brute: }
                { , {} }
            }
        }
    };
}

/// Declares both kernels of a triangle test that is not the default.
macro_rules! test {
    ($file:ident::$name:ident, $brute_file:ident::$brute_name:ident = $test:ident) => {
        query! {
            #[doc = concat!("The closest or any hit by [`", stringify!($test), "`].")]
            $file::$name = |_, ray, pairs, corners, any, aside, steps|
                traverse::stack::walk::<$test, Every, false>(
                    &mut if $test::WHOLE { ray.whole() } else { *ray }, pairs, corners, Every, any, aside, steps,
                )
        }
        brute!($brute_file::$brute_name = $test);
    };
}

query! {
    /// The closest hit.
    closest::CLOSEST = |_, ray, pairs, corners, _, aside, steps|
        traverse::stack::walk::<Strict, Every, false>(ray, pairs, corners, Every, false, aside, steps)
}
query! {
    /// Any hit, for shadows.
    any::ANY = |_, ray, pairs, corners, _, aside, steps|
        traverse::stack::walk::<Strict, Every, false>(ray, pairs, corners, Every, true, aside, steps)
}
query! {
    /// The closest hit, counting steps.
    steps::STEPS counts = |_, ray, pairs, corners, _, aside, steps|
        traverse::stack::walk::<Strict, Every, true>(ray, pairs, corners, Every, false, aside, steps)
}
query! {
    /// The closest or any hit of another triangle than the one given with the ray, for rays that leave a
    /// surface.
    except::EXCEPT = |i, ray, pairs, corners, any, aside, steps|
        traverse::stack::walk::<Strict, Except, false>(ray, pairs, corners, Except(excluded.at(i)), any, aside, steps),
    { 7 excluded: u32 }
}

/// Answers ray `i`: its first hits in order, as many as the job's limit, the rest filled with misses; and how
/// many it has.
///
/// A triangle may be listed in several leaves, and where a hit lies is too uncertain to say which of them
/// owns it. But hits have an order, (`t`, triangle), in which each comes once: so this asks for the closest
/// hit after the last one until there is none. `n` hits take `n + 1` traversals, each from the last hit on.
#[allow(clippy::too_many_arguments, reason = "one argument per buffer")]
pub fn each(
    i: u32,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
    totals: &mut Buf<u32>,
) {
    if i < job.at(JOB_RAYS) {
        let limit = job.at(JOB_LIMIT);
        let mut ray = load(i, rays, &header.at(0), outcome);
        let mut steps = Steps::default();
        let mut after = After::NOTHING;
        let mut total = 0;
        let mut running = true;
        // 1 until there are no more.
        let mut open = 1;
        while running {
            let aside = &mut [0; ASIDE];
            let best = traverse::stack::walk::<Strict, After, false>(
                &mut ray, pairs, corners, after, false, aside, &mut steps,
            );
            if best.triangle == MISS {
                running = false;
                open = 0;
            } else {
                if total < limit {
                    hits.put(i * limit + total, record(&ray, &best));
                }
                total += 1;
                after.pass(&mut ray, &best);
            }
        }
        let mut empty = total;
        while empty < limit {
            hits.put(i * limit + empty, UVec4::new(MISS, 0, 0, 0));
            empty += 1;
        }
        totals.put(i, total);
        if open != 0 {
            steps.status |= status::CUT_SHORT;
        }
        if steps.status != 0 {
            outcome.or(OUTCOME_STATUS, steps.status);
        }
    }
}

/// All hits of a ray in order, for counting them or for passing through surfaces.
pub mod all {
    use super::*;

    of_query! {
        kernel {
            /// [`each`] over all rays.
            map ALL_HITS = each, threads 64, query:
        } { , { 7 totals: write u32 } }
    }
}

query! {
    /// Restarts at the root.
    restart::RESTART counts = |_, ray, pairs, corners, any, _, steps|
        traverse::restart::walk::<false>(ray, pairs, corners, any, steps)
}
query! {
    /// Restarts at the push-down node.
    pushdown::PUSHDOWN counts = |_, ray, pairs, corners, any, _, steps|
        traverse::restart::walk::<true>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of one entry.
    shortstack1::SHORTSTACK1 counts = |_, ray, pairs, corners, any, _, steps|
        traverse::shortstack::walk::<1>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of two entries.
    shortstack2::SHORTSTACK2 counts = |_, ray, pairs, corners, any, _, steps|
        traverse::shortstack::walk::<2>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of four entries.
    shortstack4::SHORTSTACK4 counts = |_, ray, pairs, corners, any, _, steps|
        traverse::shortstack::walk::<4>(ray, pairs, corners, any, steps)
}
query! {
    /// A stack of eight entries.
    shortstack8::SHORTSTACK8 counts = |_, ray, pairs, corners, any, _, steps|
        traverse::shortstack::walk::<8>(ray, pairs, corners, any, steps)
}
query! {
    /// Climbs by parents.
    backtrack::BACKTRACK counts = |_, ray, pairs, corners, any, _, steps|
        traverse::backtrack::walk(ray, pairs, corners, boxes, any, steps),
    { 8 boxes: UVec4 }
}
query! {
    /// Follows ropes to the node beyond the whole plane.
    ropes::ROPES counts = |_, ray, pairs, corners, any, _, steps|
        traverse::ropes::walk::<false>(ray, pairs, corners, parents, links, any, steps),
    { 8 parents: u32, 9 links: UVec4 }
}
query! {
    /// Follows ropes to the smallest node beyond a side.
    optimised_ropes::OPTIMISED_ROPES counts = |_, ray, pairs, corners, any, _, steps|
        traverse::ropes::walk::<true>(ray, pairs, corners, parents, links, any, steps),
    { 8 parents: u32, 9 links: UVec4 }
}
query! {
    /// Locates every leaf from the root.
    sequential::SEQUENTIAL counts = |_, ray, pairs, corners, any, _, steps|
        traverse::sequential::walk(ray, pairs, corners, any, steps)
}

brute!(brute_strict::BRUTE_STRICT = Strict);
test!(exact::EXACT, brute_exact::BRUTE_EXACT = Exact);
test!(woop::WOOP, brute_woop::BRUTE_WOOP = Woop);
test!(moeller::MOELLER, brute_moeller::BRUTE_MOELLER = Moeller);
test!(plane::PLANE, brute_plane::BRUTE_PLANE = Plane);
test!(baldwin::BALDWIN, brute_baldwin::BRUTE_BALDWIN = Baldwin);
