//! What can be asked of a ray, and how kernels that answer are declared. Those of the default test stand here; the
//! other ways through the tree and triangle tests have theirs beside them.

use super::{
    intersect::{exact::Exact, strict::Strict},
    job::THREADS,
    traverse::{
        self,
        leaf::{Every, Except},
        stack::ASIDE,
    },
};

/// Declares something of the buffers that all queries of the tree bind.
macro_rules! of_query {
    (bindings { $($head:tt)* } {}) => {
        of_query! { @of bindings { $($head)* Query } {} }
    };
    (kernel { $($head:tt)* } { $($own:tt)* }) => {
        of_query! { @of kernel { $($head)* $crate::trace::queries::Query<'a, H> } { $($own)* } }
    };
    (@of $declare:ident { $($head:tt)* } { $($own:tt)* }) => {
        $declare! {
            $($head)* {
                0 job: read u32, 1 header: read ::raykd_shared::TreeHeader, 2 pairs: read $crate::glam::UVec4,
                3 corners: read $crate::glam::Vec4, 4 rays: read $crate::glam::Vec4,
                5 hits: write $crate::glam::UVec4, 6 outcome: write u32,
            } $($own)*
        }
    };
}

/// Declares something of the buffers that all tests of every triangle bind.
macro_rules! of_brute {
    (bindings { $($head:tt)* } {}) => {
        of_brute! { @of bindings { $($head)* Brute } {} }
    };
    (kernel { $($head:tt)* } { $($own:tt)* }) => {
        of_brute! { @of kernel { $($head)* $crate::trace::queries::Brute<'a, H> } { $($own)* } }
    };
    (@of $declare:ident { $($head:tt)* } { $($own:tt)* }) => {
        $declare! {
            $($head)* {
                0 job: read u32, 1 header: read ::raykd_shared::TreeHeader, 2 kept: read u32,
                3 positions: read f32, 4 indices: read u32, 5 rays: read $crate::glam::Vec4,
                6 hits: write $crate::glam::UVec4, 7 outcome: write u32, 8 bests: write $crate::glam::UVec4,
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
pub const SHARED: usize = ASIDE * THREADS as usize;

/// Declares the kernel of a query: how it answers ray `i`, whether it writes counts of its steps too, and buffers that
/// only it binds. With a module's name before the kernel's it gets a module of its own.
macro_rules! query {
    (@span) => { 1 };
    (@span $beside:path) => { $crate::trace::job::SPAN };
    (@left $group:ident,) => {
        $crate::trace::job::Left::ALL
    };
    (@left $group:ident, $beside:expr) => {
        by_eight!($group.usual, $beside, else $crate::trace::job::Left::ALL)
    };
    ($(#[$doc:meta])* $file:ident::$name:ident $($rest:tt)*) => {
        $(#[$doc])*
        pub mod $file {
            #[allow(unused_imports, reason = "not every query needs all of them")]
            use super::*;
            query! { $(#[$doc])* $name $($rest)* }
        }
    };
    ($(#[$doc:meta])* $name:ident $(($beside:path))? $($counts:ident)? = |$i:pat_param, $ray:ident, $pairs:ident,
     $corners:ident, $any:pat_param, $aside:pat_param, $steps:ident| $walk:expr
     $(, { $($b:tt $more:ident: $t:ty),* $(,)? })?) => {
        /// Answers the rays of a workgroup, one a lane that takes one.
        #[inline(always)]
        pub fn answer(
            group: $crate::Group,
            shared: &mut [u32; $crate::trace::queries::SHARED],
            job: &$crate::mem::Buf<u32>,
            header: &$crate::mem::Buf<::raykd_shared::TreeHeader>,
            $pairs: &$crate::mem::Buf<$crate::glam::UVec4>,
            $corners: &$crate::mem::Buf<$crate::glam::Vec4>,
            rays: &$crate::mem::Buf<$crate::glam::Vec4>,
            hits: &mut $crate::mem::Buf<$crate::glam::UVec4>,
            outcome: &mut $crate::mem::Buf<u32>,
            $($counts: &mut $crate::mem::Buf<$crate::glam::UVec4>,)?
            $($($more: &$crate::mem::Buf<$t>),*)?
        ) {
            use $crate::{
                mem::{Atomics as _, Slots as _, aside},
                trace::{job, queries::SHARED, traverse::{Steps, stack::ASIDE}},
            };
            let left = query! {
                @left group, $($beside(&group, job, header, $pairs, $corners, rays, hits, outcome))?
            };
            lanes!(group, |lane| {
                let i = job::ray_of(group.id * group.width + lane, job);
                if i < job.at(job::JOB_RAYS) && left.has(lane) {
                    let $ray = &mut job::load(i, rays, &header.at(0), outcome);
                    let ($i, $any) = (i, job.at(job::JOB_ANY) != 0);
                    let ($aside, $steps) = (&mut aside::<ASIDE, SHARED>(shared, lane), &mut Steps::default());
                    let best = $walk;
                    hits.put(i, job::record($ray, &best));
                    $($counts.put(i, $steps.words());)?
                    if $steps.status != 0 {
                        outcome.or(job::OUTCOME_STATUS, $steps.status);
                    }
                }
            });
        }

        of_query! {
            kernel {
                $(#[$doc])*
                group $name = answer, threads 64, span (query!(@span $($beside)?)),
                shared [shared: $crate::trace::queries::SHARED], query:
            }
            { , { $(7 $counts: write $crate::glam::UVec4,)? $($($b $more: read $t),*)? } }
        }
    };
}

/// Declares the kernel of a triangle test with a stack.
macro_rules! with_stack {
    ($name:ident $(($beside:path))? = $test:ident) => {
        query! {
            #[doc = concat!("The closest or any hit by [`", stringify!($test), "`].")]
            $name $(($beside))? = |_, ray, pairs, corners, any, aside, steps|
                $crate::trace::traverse::stack::walk::<$test, $crate::trace::traverse::leaf::Every, false>(
                    ray, pairs, corners, $crate::trace::traverse::leaf::Every, any, aside, steps,
                )
        }
    };
}

/// Declares the kernels of a triangle test: the one with a stack, if it has none of its own, and the one that tests
/// every triangle.
macro_rules! test {
    ($name:ident, $brute_file:ident::$brute_name:ident = $test:ident) => {
        with_stack!($name = $test);
        test!($brute_file::$brute_name = $test);
    };
    ($brute_file:ident::$brute_name:ident = $test:ident) => {
        #[doc = concat!("Every triangle, by [`", stringify!($test), "`].")]
        pub mod $brute_file {
            use super::$test;
            use $crate::trace::traverse::brute::brute;

            of_brute! {
                kernel {
                    #[doc = "All rays against a slice of the triangles."] map $brute_name = brute::<$test>,
                    threads 64, brute:
                }
                { , {} }
            }
        }
    };
}

query! {
    /// The closest hit.
    closest::CLOSEST(crate::trace::side_by_side::closest::<false>) = |_, ray, pairs, corners, _, aside, steps|
        traverse::stack::walk::<Strict, Every, false>(ray, pairs, corners, Every, false, aside, steps)
}
query! {
    /// Any hit, for shadows.
    any::ANY(crate::trace::side_by_side::closest::<true>) = |_, ray, pairs, corners, _, aside, steps|
        traverse::stack::walk::<Strict, Every, false>(ray, pairs, corners, Every, true, aside, steps)
}
/// Declares the kernels of a triangle test that keeps the contract, beside those of closest and any hits.
macro_rules! more {
    ($test:ident, $steps_file:ident::$steps:ident, $except_file:ident::$except:ident) => {
        query! {
            #[doc = concat!("The closest hit by [`", stringify!($test), "`], counting steps.")]
            $steps_file::$steps counts = |_, ray, pairs, corners, _, aside, steps|
                traverse::stack::walk::<$test, Every, true>(ray, pairs, corners, Every, false, aside, steps)
        }
        query! {
            #[doc = concat!("The closest or any hit by [`", stringify!($test), "`] of another triangle than")]
            /// the one given with the ray, for rays that leave a surface.
            $except_file::$except = |i, ray, pairs, corners, any, aside, steps|
                traverse::stack::walk::<$test, Except, false>(
                    ray, pairs, corners, Except(excluded.at(i)), any, aside, steps,
                ),
            { 7 excluded: u32 }
        }
    };
}

more!(Strict, steps::STEPS, except::EXCEPT);
more!(Exact, exact_steps::EXACT_STEPS, exact_except::EXACT_EXCEPT);

kernels! {
    /// The kernels of this file.
    closest::CLOSEST,
    any::ANY,
    steps::STEPS,
    except::EXCEPT,
    exact_steps::EXACT_STEPS,
    exact_except::EXACT_EXCEPT,
}
