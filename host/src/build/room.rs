//! How much room the lists of a build get.

use crate::{
    Error,
    exec::{Buffer, Device},
};
use bytemuck::Pod;
use raykd_kernels::build::sweep::FRESH_SHARE;
use raykd_shared::{
    BuildParams,
    limits::{BRANCH, TREELET, chunk},
    rule,
};

/// References that the large nodes of so many triangles may make of them: few more a triangle where those are many, as
/// memory and time go by all.
fn bound(triangles: u32) -> u32 {
    let few = triangles.saturating_mul(48).saturating_add(1 << 16);
    few.min(triangles.saturating_mul(4).saturating_add(1 << 23)).min(1 << 29)
}

/// The same for each triangle: what the root's references may become, see [`raykd_kernels::build::Costs::most`].
pub(super) fn growth(triangles: u32) -> f32 {
    bound(triangles) as f32 / triangles.max(1) as f32
}

/// Most references of a tree by the sweep, even if more depth were allowed.
pub(super) fn most_of_sweep(triangles: u32) -> u32 {
    bound(triangles).saturating_mul(2).min(1 << 29)
}

/// Most references on a level of the level loop: rounding counts.
fn most_of_levels(triangles: u32) -> u32 {
    bound(triangles) / 64 * 65 + 64
}

/// Most large nodes on a level, and most chunks of theirs, the last of which may be short, if the root has so many
/// references.
const fn most_active(level_refs: u32, references: u32) -> u32 {
    level_refs / BRANCH + level_refs / chunk(references) + 4
}

/// Allocates, and keeps count.
pub(super) struct Arena<'d> {
    pub device: &'d Device,
    pub bytes: u64,
}

impl Arena<'_> {
    /// Room for so many records of so many elements.
    pub(super) fn alloc<T>(
        &mut self,
        name: &'static str,
        records: u32,
        elements: u32,
    ) -> Result<Buffer<T>, Error> {
        let buffer = self.device.room(name, u64::from(records) * u64::from(elements))?;
        self.bytes += buffer.bytes();
        Ok(buffer)
    }

    /// Room for so many elements or more: all that there is in memory used again.
    pub(super) fn at_least<T>(&mut self, name: &'static str, elements: u64) -> Result<Buffer<T>, Error> {
        let buffer = self.device.room(name, elements)?.whole();
        self.bytes += buffer.bytes();
        Ok(buffer)
    }

    /// Two of a kind: one for a level, one for the next.
    pub(super) fn pair<T>(
        &mut self,
        name: &'static str,
        records: u32,
        elements: u32,
    ) -> Result<[Buffer<T>; 2], Error> {
        Ok([self.alloc(name, records, elements)?, self.alloc(name, records, elements)?])
    }

    /// A buffer of these elements.
    pub(super) fn upload<T: Pod>(&mut self, name: &'static str, data: &[T]) -> Result<Buffer<T>, Error> {
        let buffer = self.device.put(name, data)?;
        self.bytes += buffer.bytes();
        Ok(buffer)
    }
}

/// Capacities of one try.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    pub level_refs: u32,
    pub treelet_refs: u32,
    pub active: u32,
    pub treelets: u32,
}

/// Levels of large nodes that are enough for most scenes: dragons have about nine tenths of these, teapots all. Where
/// there are many nodes, some shrink slowly.
pub(super) fn usual_levels(params: &BuildParams) -> u32 {
    let halvings = params.references.div_ceil(BRANCH).max(1).ilog2();
    // Without costs there are more.
    let a_halving = if params.rule & rule::MEDIAN == 0 { [3, 6] } else { [4, 8] };
    let [few, many] = a_halving.map(|halves| halves * halvings / 2);
    (4 + few).max(many.saturating_sub(12))
}

impl Room {
    /// As words, see [`Self::of_words`].
    pub(super) const fn words(self) -> [u32; 4] {
        [self.level_refs, self.treelet_refs, self.active, self.treelets]
    }

    /// Of its [`Self::words`].
    pub(super) const fn of_words([level_refs, treelet_refs, active, treelets]: [u32; 4]) -> Self {
        Self { level_refs, treelet_refs, active, treelets }
    }

    /// Room for what either has room for.
    pub(super) fn or(self, other: Self) -> Self {
        let (a, b) = (self.words(), other.words());
        Self::of_words(std::array::from_fn(|i| a[i].max(b[i])))
    }

    /// The first guess for the level loop, with treelets of `small` references.
    pub(super) fn of_levels(references: u32, small: u32) -> Self {
        let n = references;
        let level_refs = n + n / 4 + 64;
        // Dragons, Sponza and the teapot have 1.1 to 1.2 in branches, whose room is twice that and something more; and
        // treelets of 14 to 18. Without costs, in short leaves, there are more.
        let (treelet_refs, a_treelet) = if small < TREELET { (5 * n, 3) } else { (3 * n, 18) };
        let treelet_refs = treelet_refs + 2 * BRANCH;
        Self {
            level_refs,
            treelet_refs,
            active: most_active(level_refs, references),
            treelets: treelet_refs / a_treelet + 64,
        }
    }

    /// The first guess for the sweep: what the dragons, Sponza and the teapot need.
    pub(super) fn of_sweep(references: u32) -> Self {
        let n = references;
        Self {
            level_refs: 2 * n + n / 4 + 1024,
            treelet_refs: 3 * n + 1024,
            active: n / 2 + 1024,
            treelets: 2 * n + n / 4 + 1024,
        }
    }

    /// Twice the room for the level loop. None if lists of references are as long as those of so many triangles get.
    pub(super) fn doubled(self, triangles: u32) -> Option<Self> {
        let most = most_of_levels(triangles);
        let double = |x: u32| x.saturating_mul(2).min(1 << 29);
        // What branches leave to other rounds gets new room.
        let rooms = most.saturating_mul(3).min(1 << 29);
        (self.level_refs < most || self.treelet_refs < rooms).then(|| {
            let level_refs = double(self.level_refs).min(most);
            Self {
                level_refs,
                treelet_refs: double(self.treelet_refs).min(rooms),
                active: most_active(level_refs, triangles),
                treelets: double(self.treelets),
            }
        })
    }

    /// Room for what a level of the sweep would have needed, and something more. None if that is more
    /// references than trees of so many triangles may have.
    pub(super) fn holding(self, need: &Need, triangles: u32) -> Option<Self> {
        let most = most_of_sweep(triangles);
        let more = |has: u32, needed: u32| if needed > has { 2 * needed } else { has };
        (need.references.max(need.listed) <= most).then(|| {
            // Lists of new faces are shorter than others.
            let refs = need.references.max(need.fresh.saturating_mul(FRESH_SHARE));
            Self {
                level_refs: more(self.level_refs, refs).min(most.saturating_mul(FRESH_SHARE)),
                treelet_refs: more(self.treelet_refs, need.listed).min(most),
                active: more(self.active, need.cells),
                treelets: more(self.treelets, need.nodes + need.cells),
            }
        })
    }
}

/// What a level of the sweep that did not fit would have needed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Need {
    pub references: u32,
    pub fresh: u32,
    pub cells: u32,
    pub nodes: u32,
    pub listed: u32,
}
