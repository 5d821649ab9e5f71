//! The ways through the tree that there are to choose from, and what each needs and binds on a device.

use crate::{
    Error, Query as Asked,
    build::{Kept, MeshBuffers, Wide},
    choices::choices,
    exec::{Buffer, Device, Launch, OnDevice, Out, Step},
    intersector::Bound,
};
use raykd_kernels::{
    Host,
    glam::UVec4,
    trace::{
        prepare::{node_boxes, parents, rope_links},
        queries::Query,
        traverse::{
            backtrack, pushdown, restart,
            ropes::{self, optimised_ropes},
            sequential,
            shortstack::{self, shortstack1, shortstack2, shortstack4, shortstack8},
            wide::{self as walk_wide, wide_any, wide_steps},
        },
    },
};
use raykd_shared::{TreeHeader, WideNode, limits::MAX_DEPTH};
use std::time::Duration;

choices! {
    /// How rays find their way through the tree. All find the same closest hits, bit for bit; any hits of
    /// [`Traversal::Wide`] may be of other triangles. [`Traversal::Stack`] is the first, [`Traversal::Brute`] the last.
    pub enum Traversal {
        /// A full stack: the fastest
        Stack = "stack",
        /// Restarts at the root after every leaf (Foley & Sugerman 2005)
        Restart = "restart",
        /// Restarts at the lowest node that holds the rest of the ray (Horn et al. 2007)
        Pushdown = "pushdown",
        /// A stack of 1 entry, restarts when it is empty (Horn et al. 2007)
        ShortStack1 = "shortstack1",
        /// A stack of 2 entries
        ShortStack2 = "shortstack2",
        /// A stack of 4 entries
        ShortStack4 = "shortstack4",
        /// A stack of 8 entries
        ShortStack8 = "shortstack8",
        /// Climbs by parents and boxes (Foley & Sugerman 2005)
        Backtrack = "backtrack",
        /// Ropes from leaf to leaf (Popov et al. 2007)
        Ropes = "ropes",
        /// Ropes pulled down as far as they go (Popov et al. 2007)
        OptimisedRopes = "optimised-ropes",
        /// Locates every leaf from the root (Kaplan 1985)
        Sequential = "sequential",
        /// Boxes instead of the tree, eight a node (Ylitie et al. 2017): on a GPU the fastest through small triangles
        Wide = "wide",
        /// No tree: tests every triangle
        Brute = "brute",
    }
    default = Stack;
    called = "traversal";
}

/// What a traversal needs on the device beside the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Needs {
    Nothing,
    Boxes,
    Ropes { optimised: bool },
    Wide,
}

/// What traversals need on the device beside the tree, each made once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Extras {
    parents: Option<Buffer<u32>>,
    boxes: Option<Buffer<UVec4>>,
    /// As they are, and optimised.
    ropes: [Option<Buffer<UVec4>>; 2],
    wide: Option<Wide>,
}

impl Traversal {
    /// Bytes that a ray keeps between two leaves, beside the best hit.
    #[doc(hidden)]
    pub const fn state_bytes(self) -> u32 {
        match self {
            // Sixteen bytes an entry, and how many there are.
            Self::Stack => 16 * MAX_DEPTH + 4,
            Self::Restart => restart::STATE,
            Self::Pushdown => pushdown::STATE,
            Self::ShortStack1 => shortstack::state(1),
            Self::ShortStack2 => shortstack::state(2),
            Self::ShortStack4 => shortstack::state(4),
            Self::ShortStack8 => shortstack::state(8),
            Self::Backtrack => backtrack::STATE,
            Self::Ropes | Self::OptimisedRopes => ropes::STATE,
            Self::Sequential => sequential::STATE,
            // Eight bytes an entry, a group, and how many entries there are.
            Self::Wide => 8 * WideNode::MAX_DEPTH + 12,
            Self::Brute => 0,
        }
    }

    const fn needs(self) -> Needs {
        match self {
            Self::Backtrack => Needs::Boxes,
            Self::Ropes => Needs::Ropes { optimised: false },
            Self::OptimisedRopes => Needs::Ropes { optimised: true },
            Self::Wide => Needs::Wide,
            _ => Needs::Nothing,
        }
    }

    /// Of so many rays, counting steps too; `stack` and `brute` have kernels of their own. [`Extras::make`] was
    /// called for it, and `query` binds [`Extras::wide`].
    pub(crate) fn step<'a>(
        self,
        query: Query<'a, OnDevice>,
        counts: Out<'a, UVec4>,
        count: u32,
        extras: &'a Extras,
    ) -> Option<Step<'a>> {
        Some(match self {
            Self::Stack | Self::Brute => return None,
            Self::Restart => restart::Buffers { query, counts }.over(count),
            Self::Pushdown => pushdown::Buffers { query, counts }.over(count),
            Self::ShortStack1 => shortstack1::Buffers { query, counts }.over(count),
            Self::ShortStack2 => shortstack2::Buffers { query, counts }.over(count),
            Self::ShortStack4 => shortstack4::Buffers { query, counts }.over(count),
            Self::ShortStack8 => shortstack8::Buffers { query, counts }.over(count),
            Self::Backtrack => backtrack::Buffers { query, counts, boxes: extras.boxes() }.over(count),
            Self::Ropes => {
                let (parents, links) = (extras.parents(), extras.ropes(false));
                ropes::Buffers { query, counts, parents, links }.over(count)
            }
            Self::OptimisedRopes => {
                let (parents, links) = (extras.parents(), extras.ropes(true));
                optimised_ropes::Buffers { query, counts, parents, links }.over(count)
            }
            Self::Sequential => sequential::Buffers { query, counts }.over(count),
            Self::Wide => wide_steps::Buffers { query, counts }.over(count),
        })
    }

    /// The kernel that does not count steps, where that is another one; `query` binds [`Extras::wide`].
    pub(crate) fn uncounted<'a, H: Host>(self, query: Query<'a, H>, asked: Asked) -> Option<Bound<'a, H>> {
        match (self, asked) {
            (Self::Wide, Asked::Any) => Some(Bound::of(wide_any::Buffers { query })),
            (Self::Wide, _) => Some(Bound::of(walk_wide::Buffers { query })),
            _ => None,
        }
    }
}

impl Extras {
    /// Makes what a traversal needs of a tree of `count` nodes, or of the mesh's triangles that take part, if that is
    /// not there yet. `own_header` is the tree's. Says how long that took, by the device's clock.
    pub(crate) fn make(
        &mut self,
        traversal: Traversal,
        device: &Device,
        (header, pairs, count): (&Buffer<TreeHeader>, &Buffer<UVec4>, u32),
        (mesh, kept, own_header): (&MeshBuffers, &Kept, &TreeHeader),
    ) -> Result<Duration, Error> {
        let needs = traversal.needs();
        let mut took = Duration::ZERO;
        if needs == Needs::Wide && self.wide.is_none() {
            let (wide, time) = Wide::build(device, mesh, kept, own_header)?;
            self.wide = Some(wide);
            took = time;
        }
        if matches!(needs, Needs::Nothing | Needs::Wide) {
            return Ok(took);
        }
        let parents = match self.parents.take() {
            Some(parents) => parents,
            None => {
                let made = device.room("parents", u64::from(count / 2))?;
                let parents = parents::Buffers { header, pairs, parents: made.out() };
                took += device.dispatch(&[parents.over(count)], false)?.total;
                made
            }
        };
        if needs == Needs::Boxes && self.boxes.is_none() {
            let made = device.room("node boxes", 2 * u64::from(count))?;
            let boxes = node_boxes::Buffers { header, pairs, parents: &parents, boxes: made.out() };
            took += device.dispatch(&[boxes.over(count)], false)?.total;
            self.boxes = Some(made);
        }
        if let Needs::Ropes { optimised } = needs
            && self.ropes[usize::from(optimised)].is_none()
        {
            let job = &device.put("job", &[u32::from(optimised), 0, 0, 0])?;
            let made = device.room("ropes", 3 * u64::from(count))?;
            let ropes = rope_links::Buffers { job, header, pairs, parents: &parents, links: made.out() };
            took += device.dispatch(&[ropes.over(count)], false)?.total;
            self.ropes[usize::from(optimised)] = Some(made);
        }
        self.parents = Some(parents);
        Ok(took)
    }

    /// Bytes of what a traversal binds of it.
    pub(crate) fn bytes(&self, traversal: Traversal) -> u64 {
        match traversal.needs() {
            Needs::Nothing => 0,
            Needs::Boxes => self.boxes().bytes(),
            Needs::Ropes { optimised } => self.parents().bytes() + self.ropes(optimised).bytes(),
            Needs::Wide => self.wide.as_ref().map_or(0, |wide| wide.nodes.bytes()),
        }
    }

    /// Bytes of all that was made.
    pub(crate) fn all_bytes(&self) -> u64 {
        let links = self.ropes.iter().chain([&self.boxes]).flatten();
        let wide = self.wide.as_ref().map_or(0, Wide::bytes);
        links.map(|buffer| buffer.bytes()).sum::<u64>()
            + self.parents.as_ref().map_or(0, |it| it.bytes())
            + wide
    }

    fn parents(&self) -> &Buffer<u32> {
        self.parents.as_ref().expect("made for the traversal")
    }

    /// What a traversal binds instead of a tree.
    pub(crate) fn wide(&self, traversal: Traversal) -> Option<&Wide> {
        self.wide.as_ref().filter(|_| traversal.needs() == Needs::Wide)
    }

    fn boxes(&self) -> &Buffer<UVec4> {
        self.boxes.as_ref().expect("made for the traversal")
    }

    fn ropes(&self, optimised: bool) -> &Buffer<UVec4> {
        self.ropes[usize::from(optimised)].as_ref().expect("made for the traversal")
    }
}
