//! The nodes that a ray visits by each traversal, in their order.
//!
//! The traversals are the kernels' own sources, compiled once more with buffers that remember what was read of them. A
//! kernel counts an inner node where it loads the node's children, and a leaf by `Steps::visit`: both are written down
//! here.

#![forbid(unsafe_code)]

// The kernels' declarations: here only the bodies are wanted.
macro_rules! kernel {
    ($($all:tt)*) => {};
}
macro_rules! query {
    ($($all:tt)*) => {};
}

mod mem;
mod place;
mod steps;

/// The kernels' sources, and what takes the place of some of them.
#[path = "../../../kernels/src/trace"]
#[allow(
    unreachable_pub,
    dead_code,
    clippy::too_many_arguments,
    reason = "the kernels' sources are public there, have one argument per buffer, and not all is used here"
)]
mod trace {
    pub(crate) use crate::place;
    pub(crate) use raykd_kernels::trace::{frame, intersect};

    /// What some traversals need beside the tree.
    pub(crate) mod prepare {
        pub(crate) mod climb;
        pub(crate) mod node_boxes;
        pub(crate) mod parents;
        pub(crate) mod rope_links;
    }

    /// The traversals.
    pub(crate) mod traverse {
        pub(crate) use crate::steps::Steps;
        pub(crate) use raykd_kernels::trace::traverse::trail;

        pub(crate) mod backtrack;
        pub(crate) mod crossing;
        pub(crate) mod leaf;
        pub(crate) mod pushdown;
        pub(crate) mod restart;
        pub(crate) mod ropes;
        pub(crate) mod sequential;
        pub(crate) mod shortstack;
        pub(crate) mod stack;
    }
}

use mem::{Buf, Log, Slots as _};
use raykd::{Mesh, Ray, Scene, Traversal};
use raykd_kernels::{
    glam::{self, UVec4, Vec3, Vec4},
    math,
    trace::{
        intersect::{Best, strict::Strict},
        prepare::corners::kept,
        traverse::Steps as Counts,
    },
};
use raykd_shared::{Content, MISS, Node, TreeHeader};
use std::{cell::OnceCell, collections::HashMap};
use trace::{
    frame::Frame,
    prepare::{node_boxes, parents, rope_links},
    traverse::{Steps, backtrack, leaf, restart, ropes, sequential, shortstack, stack},
};

/// As in the kernels.
const ON_GPU: bool = false;

/// What a ray did by one traversal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Way {
    /// The nodes visited, by number. A node that is visited again stands here again.
    pub nodes: Vec<u32>,
    /// The triangle hit, or [`MISS`].
    pub triangle: u32,
    /// As [`Scene::steps`] counts them.
    pub inner: u32,
    /// The same.
    pub leaves: u32,
    /// The same.
    pub tests: u32,
    /// The same.
    pub turns: u32,
}

/// A tree whose traversals are written down.
#[derive(Debug)]
pub struct Ways {
    log: Log,
    header: Buf<TreeHeader>,
    pairs: Buf<UVec4>,
    corners: Buf<Vec4>,
    parents: Buf<u32>,
    /// Made when they are wanted, as the next.
    boxes: OnceCell<Buf<UVec4>>,
    /// As they are, and optimised.
    ropes: [OnceCell<Buf<UVec4>>; 2],
    /// The numbers of leaves, by the references that they begin with.
    leaves: HashMap<u32, u32>,
}

impl Ways {
    /// Through a scene's tree, which is of this mesh.
    ///
    /// # Errors
    /// The device failed.
    pub fn new(scene: &Scene, mesh: &Mesh) -> Result<Self, raykd::Error> {
        let tree = scene.tree()?;
        let view = tree.view();
        let count = view.nodes.len() as u32;
        // A leaf is known by its first reference, which no other has. Nobody reads that of an empty one: there
        // stands a number that is no reference's.
        let past = view.refs.len() as u32;
        let mut leaves = HashMap::new();
        let mut named = |(number, node): (u32, &Node)| match node.content() {
            Content::Inner { .. } => *node,
            Content::Leaf { first, count } => {
                let first = if count == 0 { past + number } else { first };
                leaves.insert(first, number);
                Node::leaf(first, count)
            }
        };
        let nodes: Vec<Node> = (0..).zip(view.nodes).map(&mut named).collect();
        let pair = |pair: &[Node]| {
            let [(a, b), (c, d)] = [pair[0], pair[1]].map(Node::words);
            UVec4::new(a, b, c, d)
        };
        let header = Buf::of(vec![*view.header]);
        let mut pairs = Buf::of(nodes.chunks_exact(2).map(pair).collect());
        let scaled = mesh.scaled_positions();
        let corner = |v: u32| Vec3::from_slice(&scaled[3 * v as usize..]);
        let corners = view.refs.iter().flat_map(|&id| {
            let [a, b, c] = mesh.triangles()[id as usize].map(corner);
            let (a, b, c) = kept::<Strict>(id, (a, b, c));
            [a, b, c]
        });
        let corners = Buf::of(corners.collect());
        let mut parents = Buf::of(vec![MISS; nodes.len() / 2]);
        for i in 0..count {
            parents::write(i, &header, &pairs, &mut parents);
        }
        let log = Log::default();
        pairs.watch(&log);
        let (boxes, ropes) = Default::default();
        Ok(Self { log, header, pairs, corners, parents, boxes, ropes, leaves })
    }

    /// So many words for each node, written by a kernel.
    fn made(&self, words: u32, write: impl Fn(u32, &mut Buf<UVec4>)) -> Buf<UVec4> {
        let nodes = self.header.at(0).nodes;
        let mut made = Buf::of(vec![UVec4::ZERO; (words * nodes) as usize]);
        (0..nodes).for_each(|i| write(i, &mut made));
        made
    }

    fn boxes(&self) -> &Buf<UVec4> {
        let Self { header, pairs, parents, .. } = self;
        let make = || self.made(2, |i, made| node_boxes::node_boxes(i, header, pairs, parents, made));
        self.boxes.get_or_init(make)
    }

    fn ropes(&self, optimised: bool) -> &Buf<UVec4> {
        let Self { header, pairs, parents, .. } = self;
        let job = &Buf::of(vec![u32::from(optimised)]);
        let make = || self.made(3, |i, made| rope_links::rope_links(i, job, header, pairs, parents, made));
        self.ropes[usize::from(optimised)].get_or_init(make)
    }

    /// The parent of a node, but of the root.
    pub fn parent(&self, node: u32) -> Option<u32> {
        (node != 0).then(|| self.parents.at(node >> 1))
    }

    /// What a ray does until its closest hit is known, by the default triangle test. There is nothing to tell of
    /// [`Traversal::Wide`] and [`Traversal::Brute`], which do without the tree.
    pub fn of(&self, ray: &Ray, traversal: Traversal) -> Option<Way> {
        let mut frame = Frame::of(ray, &self.header.at(0));
        let steps = &mut Steps::new(&self.log);
        let Self { pairs, corners, parents, .. } = self;
        let best: Best = match traversal {
            Traversal::Stack => stack::walk::<Strict, leaf::Every, true>(
                &mut frame,
                pairs,
                corners,
                leaf::Every,
                false,
                &mut [0; stack::ASIDE],
                steps,
            ),
            Traversal::Restart => restart::walk::<false>(&frame, pairs, corners, false, steps),
            Traversal::Pushdown => restart::walk::<true>(&frame, pairs, corners, false, steps),
            Traversal::ShortStack1 => shortstack::walk::<1>(&frame, pairs, corners, false, steps),
            Traversal::ShortStack2 => shortstack::walk::<2>(&frame, pairs, corners, false, steps),
            Traversal::ShortStack4 => shortstack::walk::<4>(&frame, pairs, corners, false, steps),
            Traversal::ShortStack8 => shortstack::walk::<8>(&frame, pairs, corners, false, steps),
            Traversal::Backtrack => backtrack::walk(&frame, pairs, corners, self.boxes(), false, steps),
            Traversal::Ropes => {
                ropes::walk::<false>(&frame, pairs, corners, parents, self.ropes(false), false, steps)
            }
            Traversal::OptimisedRopes => {
                ropes::walk::<true>(&frame, pairs, corners, parents, self.ropes(true), false, steps)
            }
            Traversal::Sequential => sequential::walk(&frame, pairs, corners, false, steps),
            _ => return None,
        };
        let Counts { inner, leaves, tests, turns, .. } = **steps;
        let nodes = self.log.take().into_iter().filter_map(|seen| match seen {
            // The root's own pair is nobody's children.
            mem::Seen::Pair(0) => None,
            mem::Seen::Pair(pair) => Some(self.parents.at(pair)),
            mem::Seen::Leaf(first) => Some(self.leaves[&first]),
        });
        Some(Way { nodes: nodes.collect(), triangle: best.triangle, inner, leaves, tests, turns })
    }
}
