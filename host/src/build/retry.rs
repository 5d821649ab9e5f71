//! What a try to build a tree is made with, and what the next one changes: the one place that decides how a
//! build goes on.

use super::{
    built::{Facts, Given, KeptIn},
    options::{BuildOptions, Builder},
    room::{Need, Room},
};
use crate::Error;
use raykd_shared::{
    BuildParams, rule,
    status::{CAPACITY, describe},
};

/// Who builds the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// Nobody: it is one leaf.
    Leaf,
    /// The level loop.
    Levels,
    /// The kernels of the sweep, with lists of faces in nodes of more than `small` references.
    SweepByKernels { small: u32 },
    /// The host's form of the sweep.
    SweepByHost,
}

/// Why a try left no tree that is wanted.
#[derive(Debug)]
pub(super) enum Stop {
    /// A list of the level loop was too short, or the lists were for another mesh than was found.
    Room,
    /// A list of the sweep was.
    Needs(Need),
    /// Splitting does not separate these triangles.
    Crowd,
    /// So many references are more than were asked for.
    Budget(u32),
    /// The device failed, or has no room.
    Failed(Error),
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

/// What a try is made with.
#[derive(Debug)]
pub(super) struct Setting {
    facts: Facts,
    /// Whether the host has the mesh, and may build the tree.
    host: bool,
    /// As asked for, but that `price` and `long` rise.
    options: BuildOptions,
    first_way: Way,
    pub way: Way,
    room: Room,
    max_depth: u32,
    /// References of the tree before, if that had too many.
    before: u32,
}

impl Setting {
    /// That of the first try.
    pub(super) fn first(from: &Given<'_>, options: &BuildOptions, way: Way) -> Self {
        Self::of(from.facts, matches!(from.kept, KeptIn::Host(_)), options, way)
    }

    fn of(facts: Facts, host: bool, options: &BuildOptions, way: Way) -> Self {
        let references = facts.kept;
        let room = match way {
            Way::Levels => Room::of_levels(references, options.builder.small()),
            _ => Room::of_sweep(references),
        };
        Self {
            facts,
            host,
            options: options.clone(),
            first_way: way,
            way,
            room,
            max_depth: options.max_depth,
            before: u32::MAX,
        }
    }

    /// The same where a build before had so much room in the end.
    pub(super) fn after(self, before: Option<Room>) -> Self {
        let room = before.map_or(self.room, |before| self.room.or(before));
        Self { room, ..self }
    }

    /// Whether more room was of no use, and the tree got fewer levels.
    pub(super) fn is_lowered(&self) -> bool {
        self.max_depth < self.options.max_depth
    }

    pub(super) fn params(&self) -> BuildParams {
        let Self { facts, options, room, max_depth, .. } = self;
        let (lo, hi) = facts.bounds;
        BuildParams {
            lo,
            triangles: facts.triangles,
            hi,
            references: facts.kept,
            cost_step: options.cost_step,
            cost_test: options.cost_test,
            max_depth: *max_depth,
            level_refs: room.level_refs,
            treelet_refs: room.treelet_refs,
            active: room.active,
            treelets: room.treelets,
            long: options.long,
            rule: options.builder.rule() | if options.clip { rule::CLIP } else { 0 },
            small: match self.way {
                Way::SweepByKernels { small } => small,
                _ => options.builder.small(),
            },
            price: options.price(facts),
            empty: options.empty,
        }
    }

    /// Refuses a tree of more references than were asked for, if a higher price can save some.
    pub(super) fn check_budget(&self, refs: u32) -> Result<(), Stop> {
        let (options, triangles) = (&self.options, self.facts.kept as f32);
        let most = options.budget.map_or(u32::MAX, |b| (b.max(1.0) * triangles) as u32);
        // Planes that are not chosen by cost stay where they are; no other saves so much.
        let settled =
            refs == self.before && options.long as f32 >= triangles && options.price >= triangles * triangles;
        let kept = refs <= most || settled || options.builder == Builder::Median;
        if kept { Ok(()) } else { Err(Stop::Budget(refs)) }
    }

    /// Makes the setting that of the next try.
    ///
    /// # Errors
    /// There is none.
    pub(super) fn change(&mut self, stop: Stop) -> Result<(), Error> {
        let references = self.facts.kept;
        match stop {
            Stop::Room => self.enlarge(self.room.doubled(references)),
            Stop::Needs(need) => self.enlarge(self.room.holding(&need, references)),
            Stop::Crowd => self.enlarge(None),
            Stop::Budget(refs) => {
                let price = (2.0 * self.options.price).max(0.25);
                let long = self.options.long.max(1).saturating_mul(2);
                let options = BuildOptions { price, long, ..self.options.clone() };
                *self = Self { before: refs, ..Self::of(self.facts, self.host, &options, self.first_way) };
                Ok(())
            }
            // The host builds the same tree, more slowly.
            Stop::Failed(Error::TooLarge { .. } | Error::OutOfMemory { .. })
                if self.host && matches!(self.way, Way::SweepByKernels { .. }) =>
            {
                self.way = Way::SweepByHost;
                Ok(())
            }
            Stop::Failed(error) => Err(error),
        }
    }

    /// Gives more room; without any, fewer levels, longer leaves, bounded memory.
    fn enlarge(&mut self, room: Option<Room>) -> Result<(), Error> {
        match room {
            Some(room) => self.room = room,
            None if self.max_depth > 0 => self.max_depth /= 2,
            None => return Err(Error::Kernel(describe(CAPACITY))),
        }
        Ok(())
    }
}
