//! The triangle tests that there are to choose from, and the kernels of each.

use crate::{
    Error, Query, Traversal,
    choices::choices,
    exec::{Buffer, Groups, Launch, OnDevice, Out, Step},
};
#[cfg(feature = "gpu")]
use raykd_kernels::trace::traverse::{narrow, rest, settle};
use raykd_kernels::{
    Bindings, Host, Kernel,
    glam::UVec4,
    trace::{
        all,
        crossings::{count_crossings, settle_crossings},
        intersect::{
            Intersector as Test,
            baldwin::{self, Baldwin, brute_baldwin},
            exact::{self, Exact, brute_exact},
            moeller::{self, Moeller, brute_moeller},
            plane::{self, Plane, brute_plane},
            strict::{Strict, brute_strict},
            woop::{self, Woop, brute_woop},
        },
        left::BLOCK,
        queries::{self, any, closest, exact_except, exact_steps, except, steps},
        single::Tree,
    },
};
use raykd_shared::{Hit, Ray};
use std::ops::ControlFlow;

/// A kernel, what it binds, and how many rays each of its workgroups takes.
pub(crate) struct Bound<'a, H: Host> {
    pub kernel: &'static Kernel,
    pub buffers: Vec<H::Any<'a>>,
    pub rays: u32,
}

impl<'a, H: Host> Bound<'a, H> {
    /// One ray a lane.
    pub(crate) fn of<B: Bindings<'a, H>>(buffers: B) -> Self {
        Self { kernel: B::KERNEL, buffers: buffers.list(), rays: B::KERNEL.threads }
    }
}

impl<'a> Bound<'a, OnDevice> {
    /// Over so many rays.
    pub(crate) fn step(self, count: u32) -> Step<'a> {
        Step { kernel: self.kernel, buffers: self.buffers, groups: Groups::Fixed(count.div_ceil(self.rays)) }
    }
}

choices! {
    /// How it is told whether a ray hits a triangle, and where. [`Intersector::Strict`] keeps raykd's promises, and
    /// [`Intersector::Exact`] more than those; the others are the literature's, with their failures, for comparison.
    pub enum Intersector {
        /// Edge functions with exact signs: no gaps, whatever the tree
        Strict = "strict",
        /// Without rounding: exact hits, `t`, `u` and `v` correctly rounded
        Exact = "exact",
        /// Edge functions of rounded products (Woop, Benthin & Wald 2013)
        Woop = "woop",
        /// Cramer's rule (Möller & Trumbore 1997)
        Moeller = "moeller",
        /// The point in the triangle's plane, then its edges (Snyder & Barr 1987)
        Plane = "plane",
        /// A stored transformation to the unit triangle (Baldwin & Weber 2016)
        Baldwin = "baldwin",
    }
    default = Strict;
    called = "triangle test";
}

impl Intersector {
    /// Whether it keeps the contract: the default, and what is more accurate still.
    pub const fn keeps_contract(self) -> bool {
        matches!(self, Self::Strict | Self::Exact)
    }

    /// Whether it goes with a way through the tree: all do with [`Intersector::Strict`], of which none loses a hit.
    ///
    /// # Errors
    /// Another test with a traversal other than `stack` and `brute`.
    pub fn goes_with(self, traversal: Traversal) -> Result<(), Error> {
        match (self, traversal) {
            (Self::Strict, _) | (_, Traversal::Stack | Traversal::Brute) => Ok(()),
            _ => {
                let asked = format!("traversal {traversal}");
                Err(Error::Intersector { name: self.name(), asked, exact: false })
            }
        }
    }

    /// Whether it answers more than closest and any hits: what is `asked`.
    ///
    /// # Errors
    /// It does not keep the contract.
    #[doc(hidden)]
    pub fn check_query(self, asked: &str) -> Result<(), Error> {
        if self.keeps_contract() {
            return Ok(());
        }
        Err(Error::Intersector { name: self.name(), asked: asked.to_owned(), exact: true })
    }

    /// How many hits so many rays have, and the first of them.
    pub(crate) fn count<'a>(
        self,
        query: queries::Query<'a, OnDevice>,
        totals: Out<'a, u32>,
        begins: &'a Buffer<u32>,
        count: u32,
    ) -> Result<Step<'a>, Error> {
        self.check_query("a query for all hits")?;
        Ok(match self {
            Self::Exact => all::exact_hits::Buffers { query, totals, begins }.over(count),
            _ => all::strict_hits::Buffers { query, totals, begins }.over(count),
        })
    }

    /// Hits of so many rays on other triangles than theirs.
    pub(crate) fn except<'a>(
        self,
        query: queries::Query<'a, OnDevice>,
        excluded: &'a Buffer<u32>,
        count: u32,
    ) -> Result<Step<'a>, Error> {
        self.check_query("leaving out a triangle")?;
        Ok(match self {
            Self::Exact => exact_except::Buffers { query, excluded }.over(count),
            _ => except::Buffers { query, excluded }.over(count),
        })
    }

    /// Closest hits of so many rays, counting steps.
    pub(crate) fn steps<'a>(
        self,
        query: queries::Query<'a, OnDevice>,
        counts: Out<'a, UVec4>,
        count: u32,
    ) -> Result<Step<'a>, Error> {
        self.check_query("counting steps")?;
        Ok(match self {
            Self::Exact => exact_steps::Buffers { query, counts }.over(count),
            _ => steps::Buffers { query, counts }.over(count),
        })
    }

    /// With a full stack, by one kernel; by the exact test on a CPU alone.
    pub(crate) fn stack<'a, H: Host>(self, query: queries::Query<'a, H>, asked: Query) -> Bound<'a, H> {
        match self {
            Self::Strict if asked == Query::Any => Bound::of(any::Buffers { query }),
            Self::Strict => Bound::of(closest::Buffers { query }),
            Self::Exact => Bound::of(exact::Buffers { query }),
            Self::Woop => Bound::of(woop::Buffers { query }),
            Self::Moeller => Bound::of(moeller::Buffers { query }),
            Self::Plane => Bound::of(plane::Buffers { query }),
            Self::Baldwin => Bound::of(baldwin::Buffers { query }),
        }
    }

    /// Whether a GPU finds hits by [`exact_hits`].
    #[cfg(feature = "gpu")]
    pub(crate) fn narrows(self) -> bool {
        self == Self::Exact
    }

    /// Every triangle of a list, for so many rays.
    pub(crate) fn brute<'a>(self, brute: queries::Brute<'a, OnDevice>, count: u32) -> Step<'a> {
        match self {
            Self::Strict => brute_strict::Buffers { brute }.over(count),
            Self::Exact => brute_exact::Buffers { brute }.over(count),
            Self::Woop => brute_woop::Buffers { brute }.over(count),
            Self::Moeller => brute_moeller::Buffers { brute }.over(count),
            Self::Plane => brute_plane::Buffers { brute }.over(count),
            Self::Baldwin => brute_baldwin::Buffers { brute }.over(count),
        }
    }

    /// Calls `each` with all hits of one ray on the CPU until it says no.
    pub(crate) fn single_all(
        self,
        tree: &Tree<'_>,
        ray: &Ray,
        each: &mut dyn FnMut(Hit) -> bool,
    ) -> Result<(), Error> {
        self.check_query("a query for all hits")?;
        let on = |hit| if each(hit) { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        let _ = match self {
            Self::Exact => tree.for_each::<Exact, ()>(ray, on),
            _ => tree.for_each::<Strict, ()>(ray, on),
        };
        Ok(())
    }

    /// One ray on the CPU.
    pub(crate) fn single(self, tree: &Tree<'_>, ray: &Ray, any: bool) -> Option<Hit> {
        self.with(Find { tree, ray, any })
    }

    /// Does something with the test itself.
    #[doc(hidden)]
    pub fn with<W: WithTest>(self, what: W) -> W::Output {
        match self {
            Self::Strict => what.with::<Strict>(),
            Self::Exact => what.with::<Exact>(),
            Self::Woop => what.with::<Woop>(),
            Self::Moeller => what.with::<Moeller>(),
            Self::Plane => what.with::<Plane>(),
            Self::Baldwin => what.with::<Baldwin>(),
        }
    }
}

/// What can be done with any triangle test.
pub trait WithTest {
    /// What comes of it.
    type Output;

    /// Does it.
    fn with<I: Test>(self) -> Self::Output;
}

/// Finds the closest hit, or any.
struct Find<'a> {
    tree: &'a Tree<'a>,
    ray: &'a Ray,
    any: bool,
}

impl WithTest for Find<'_> {
    type Output = Option<Hit>;

    fn with<I: Test>(self) -> Option<Hit> {
        self.tree.find::<I>(self.ray, self.any)
    }
}

/// Hits by the exact test with a full stack, in three kernels, the second by doubles or not. Both `more` are a buffer
/// of four words a ray.
#[cfg(feature = "gpu")]
pub(crate) fn exact_hits<'a, H: Host>(
    query: impl Fn() -> queries::Query<'a, H>,
    asked: Query,
    by_doubles: bool,
    more: (H::Write<'a, UVec4>, H::Read<'a, UVec4>),
) -> [Bound<'a, H>; 3] {
    [
        match asked {
            Query::Closest => Bound::of(narrow::Buffers { query: query(), more: more.0 }),
            Query::Any => Bound::of(narrow::any::Buffers { query: query(), more: more.0 }),
        },
        if by_doubles {
            Bound::of(settle::by_doubles::Buffers { query: query(), more: more.1 })
        } else {
            Bound::of(settle::Buffers { query: query(), more: more.1 })
        },
        Bound { rays: BLOCK, ..Bound::of(rest::Buffers { query: query() }) },
    ]
}

/// Crossings, in two kernels. Both `more` are a buffer of four words a ray.
pub(crate) fn crossings<'a, H: Host>(
    query: impl Fn() -> queries::Query<'a, H>,
    crossings: impl Fn() -> H::Write<'a, u32>,
    more: (H::Write<'a, UVec4>, H::Read<'a, UVec4>),
) -> [Bound<'a, H>; 2] {
    let count = count_crossings::Buffers { query: query(), crossings: crossings(), more: more.0 };
    let settle = settle_crossings::Buffers { query: query(), crossings: crossings(), more: more.1 };
    [Bound::of(count), Bound { rays: BLOCK, ..Bound::of(settle) }]
}
