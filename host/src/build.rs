//! The plan of a build: which kernels, over which buffers, how large.

use crate::{
    Error,
    choices::choices,
    exact::levels,
    exec::{Buffer, Device, Step, Timing},
    mesh::Mesh,
};
use raykd_kernels::build::{
    ARGS_ACTIVE, ARGS_BLOCKS, ARGS_CHUNKS, ARGS_SEVERAL_ACTIVE, ARGS_SEVERAL_CHUNKS, ARGS_TREELET_BLOCKS,
    ARGS_TREELETS, ARGS_WORDS, LEVEL_WORDS, STATE_DEPTH, STATE_LEFT, STATE_NODES, STATE_REFS, STATE_STATUS,
    STATE_TREELET_REFS, STATE_TREELETS, STATE_WORDS,
    alloc::{ALLOC, put_groups},
    alone::ALONE,
    bin::BIN,
    bin::HIST_WORDS,
    boxes::BOXES,
    count::COUNT,
    emit::EMIT,
    place::PLACE,
    scatter::SCATTER,
    split::SPLIT,
    tally::BLOCK,
    tally::KINDS,
    tally::TALLY,
    tally::blocks_of,
    top::TOP,
    treelet::TREELETS,
    treelet::scratch_base,
};
use raykd_shared::{
    BuildParams, Node, TreeHeader,
    limits::{CHUNK, MAX_DEPTH, TREELET},
    rule, status,
};
use std::time::{Duration, Instant};

choices! {
    /// How the planes of a tree are chosen; the cheapest first.
    pub enum Builder {
        /// Empty space cut off, else the middle of the longest axis, down to 8 references: the cheap baseline
        Median = "median",
        /// As median above 32 references and as binned below (Zhou et al. 2008, who go over at 64)
        Zhou = "zhou",
        /// Surface area heuristic, over 32 bins an axis above 32 references (Shevtsov et al. 2007) and all box faces
        /// below
        Binned = "binned",
        /// Surface area heuristic over all box faces, with boxes clipped at every plane (Wald & Havran 2006; on a GPU
        /// after Wu et al. 2011)
        Exact = "exact",
    }
    default = Binned;
}

impl Builder {
    fn rule(self) -> u32 {
        match self {
            Self::Median => rule::MEDIAN | rule::LEAVES,
            Self::Binned | Self::Exact => 0,
            Self::Zhou => rule::MEDIAN,
        }
    }

    /// References at which a node leaves the level loop.
    fn small(self) -> u32 {
        if self == Self::Median { 8 } else { TREELET }
    }
}

/// What a build may be told.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// SAH cost of one traversal step, from 0 to [`Self::MOST`].
    pub cost_step: f32,
    /// SAH cost of one triangle test, from 0 to [`Self::MOST`].
    pub cost_test: f32,
    /// Price of a reference, from 0 to [`Self::MOST`]: how many tests a ray through the scene it has to save, times the
    /// number of triangles. 0 takes every split that saves anything; more makes trees smaller where that costs least. It has
    /// never to save a ray through its own node more than there is to save, nor in nodes of more than `long` more than half a
    /// test: an object that is small in its scene is split, too.
    pub price: f32,
    /// In nodes of more references the price is a hundredth (2^-7): long leaves hold up the rays beside.
    pub long: u32,
    /// Most references a triangle, on average, at least 1: `price` and `long` are doubled until the tree keeps to it. A scene that
    /// needs more gets slow. [`Builder::Median`] weighs no costs, [`Builder::Zhou`] none in large nodes: they may not keep to it.
    pub budget: Option<f32>,
    /// Factor on the cost of planes that cut off empty space, from 0 to 1.
    pub empty: f32,
    /// Deepest level for a leaf, at most [`MAX_DEPTH`].
    pub max_depth: u32,
    /// How planes are chosen.
    pub builder: Builder,
    /// Whether a reference is dropped where its triangle does not reach, though its box does ("perfect splits",
    /// Wald & Havran 2006, section 4.3).
    pub clip: bool,
    /// Time every kernel, see [`BuildTimes::kernels`].
    pub profile: bool,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            cost_step: 1.0,
            cost_test: 1.0,
            price: 5.0,
            long: 16,
            budget: None,
            empty: 0.9,
            max_depth: MAX_DEPTH,
            builder: Builder::default(),
            clip: true,
            profile: false,
        }
    }
}

impl BuildOptions {
    /// The most that a cost or price may be.
    pub const MOST: f32 = 1e9;

    /// Refuses numbers that costs cannot be weighed by.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let numbers = [
            ("cost_step", self.cost_step, 0.0, Self::MOST),
            ("cost_test", self.cost_test, 0.0, Self::MOST),
            ("price", self.price, 0.0, Self::MOST),
            ("empty", self.empty, 0.0, 1.0),
            ("budget", self.budget.unwrap_or(1.0), 1.0, f32::INFINITY),
        ];
        match numbers.into_iter().find(|(_, value, least, most)| !(least..=most).contains(&value)) {
            Some((name, value, least, most)) => Err(Error::Options { name, value, least, most }),
            None => Ok(()),
        }
    }

    /// [`BuildParams::price`] in the scaled mesh.
    fn price(&self, mesh: &Mesh) -> f32 {
        let (lo, hi) = mesh.scaled_bounds();
        let d: [f32; 3] = std::array::from_fn(|i| hi[i] - lo[i]);
        let area = d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
        self.price * self.cost_test * area / mesh.kept().len().max(1) as f32
    }
}

/// How long a build took and what it needed.
#[derive(Clone, Debug, Default)]
pub struct BuildTimes {
    /// Mesh to device.
    pub upload: Duration,
    /// All kernels, on the device's clock.
    pub build: Duration,
    /// Laying the leaves' triangles out for tracing, on the device's clock.
    pub layout: Duration,
    /// Most bytes of buffers held at once, the mesh included.
    pub peak_bytes: u64,
    /// How often the build was repeated, with more room or a higher price; the other times are those of the last try.
    pub retries: u32,
    /// What the tries before the last took in all, by the clock on the wall.
    pub failed: Duration,
    /// Whether the host built the tree because the device had not the room to.
    pub by_host: bool,
    /// With profiling: what each kernel took, in order of first use.
    pub kernels: Vec<KernelTimes>,
}

/// What all dispatches of a kernel took.
#[derive(Clone, Copy, Debug)]
pub struct KernelTimes {
    /// Its name.
    pub name: &'static str,
    /// How often it was dispatched.
    pub dispatches: u32,
    /// On the device's clock.
    pub time: Duration,
    /// Bytes read and written in buffers: on the CPU, with the feature `traffic`.
    pub bytes: Option<u64>,
}

/// What a build leaves on the device.
#[derive(Debug)]
pub(crate) struct Built {
    pub header: TreeHeader,
    pub nodes: Buffer,
    pub refs: Buffer,
    pub times: BuildTimes,
}

/// References that the large nodes of so many triangles may make of them: few more a triangle where those are many, as
/// memory and time go by all.
fn bound(triangles: u32) -> u32 {
    let few = triangles.saturating_mul(48).saturating_add(1 << 16);
    few.min(triangles.saturating_mul(4).saturating_add(1 << 23)).min(1 << 29)
}

/// The same for each triangle: what the root's references may become, see [`raykd_kernels::build::Costs::most`].
pub(crate) fn growth(triangles: u32) -> f32 {
    bound(triangles) as f32 / triangles.max(1) as f32
}

/// Most references a tree of so many triangles may have, even if more depth were allowed: the build is repeated with half of it.
pub(crate) fn most_refs(triangles: u32) -> u32 {
    bound(triangles).saturating_mul(2).min(1 << 29)
}

/// Allocates, and keeps count.
pub(crate) struct Arena<'d> {
    pub device: &'d Device,
    pub bytes: u64,
}

impl Arena<'_> {
    pub(crate) fn alloc(&mut self, name: &'static str, count: u32, stride: u64) -> Result<Buffer, Error> {
        let buffer = self.device.alloc(name, u64::from(count) * stride)?;
        self.bytes += buffer.bytes();
        Ok(buffer)
    }
}

/// Capacities of one try.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Room {
    pub level_refs: u32,
    pub treelet_refs: u32,
    pub active: u32,
    pub treelets: u32,
    pub levels: u32,
}

impl Room {
    pub(crate) fn first_guess(references: u32, small: u32) -> Self {
        let n = references;
        // The usual bound on useful depth (Pharr, Jakob & Humphreys, PBRT): 8 + 1.3 log2 N.
        let levels = 12 + 13 * (n + 1).ilog2() / 10;
        let chunks = n.div_ceil(CHUNK);
        let level_refs = n + n / 2 + 64;
        // Dragons, Sponza and the teapot take 1.4 to 2.1 in treelets of 14 to 18; without costs, in short leaves, 5.
        let (treelet_refs, a_treelet) = if small < TREELET { (5 * n, 3) } else { (2 * n + n / 4, 14) };
        let treelet_refs = treelet_refs + 64;
        Self {
            level_refs,
            treelet_refs,
            active: n / small + chunks + 4,
            treelets: treelet_refs / a_treelet + 16,
            levels: levels.min(MAX_DEPTH),
        }
    }

    /// Twice the room, but in lists of references for no more than `most`, if there is not that yet.
    fn grown(self, most: u32, small: u32) -> Option<Self> {
        let double = |x: u32| x.saturating_mul(2).min(1 << 29);
        (self.level_refs.min(self.treelet_refs) < most).then(|| {
            let level_refs = double(self.level_refs).min(most);
            Self {
                level_refs,
                treelet_refs: double(self.treelet_refs).min(most),
                // Active nodes hold more than `small` each, and their last chunk may be short.
                active: double(self.active).min(level_refs / small + level_refs / CHUNK + 4),
                treelets: double(self.treelets),
                levels: self.levels,
            }
        })
    }
}

/// An indexed mesh on a device.
#[derive(Clone, Debug)]
pub(crate) struct MeshBuffers {
    pub positions: Buffer,
    /// Numbers in it.
    pub coordinates: usize,
    pub indices: Buffer,
}

/// Copies the mesh to the device.
pub(crate) fn upload(device: &Device, mesh: &Mesh) -> Result<MeshBuffers, Error> {
    let coordinates = mesh.scaled_positions();
    let positions = device.alloc("positions", coordinates.len() as u64 * 4)?;
    let indices = device.alloc("indices", mesh.triangles().len() as u64 * 12)?;
    device.write(&positions, 0, bytemuck::cast_slice(&coordinates))?;
    device.write(&indices, 0, bytemuck::cast_slice(mesh.triangles()))?;
    Ok(MeshBuffers { positions, coordinates: coordinates.len(), indices })
}

pub(crate) fn params(mesh: &Mesh, options: &BuildOptions, room: Room, max_depth: u32) -> BuildParams {
    let (lo, hi) = mesh.scaled_bounds();
    BuildParams {
        lo,
        triangles: mesh.triangles().len() as u32,
        hi,
        references: mesh.kept().len() as u32,
        cost_step: options.cost_step,
        cost_test: options.cost_test,
        max_depth,
        level_refs: room.level_refs,
        treelet_refs: room.treelet_refs,
        active: room.active,
        treelets: room.treelets,
        long: options.long,
        rule: options.builder.rule() | if options.clip { rule::CLIP } else { 0 },
        small: options.builder.small(),
        price: options.price(mesh),
        empty: options.empty,
    }
}

/// Builds the tree of `mesh` on `device`.
pub(crate) fn build(
    device: &Device,
    mesh: &Mesh,
    options: &BuildOptions,
) -> Result<(MeshBuffers, Built), Error> {
    if options.builder == Builder::Exact {
        return levels::build(device, mesh, options, levels::SMALL);
    }
    let start = Instant::now();
    let mesh_buffers = upload(device, mesh)?;
    let mesh_bytes = mesh_buffers.positions.bytes() + mesh_buffers.indices.bytes();
    let upload = start.elapsed();
    let references = mesh.kept().len() as u32;
    let mut room = Room::first_guess(references, options.builder.small());
    let mut max_depth = options.max_depth.min(MAX_DEPTH);
    // Rounding counts.
    let most = bound(references) / 64 * 65 + 64;
    let (mut retries, mut failed) = (0, Duration::ZERO);
    loop {
        let begin = Instant::now();
        let mut attempt = Arena { device, bytes: mesh_bytes };
        let params = params(mesh, options, room, max_depth);
        match attempt_build(device, mesh, &mesh_buffers, &params, room, options.profile, &mut attempt)? {
            Outcome::Built(mut built) => {
                built.times.upload += upload;
                (built.times.retries, built.times.failed) = (retries, failed);
                return Ok((mesh_buffers, *built));
            }
            // The levels down to the greatest depth are always enough, and so is room for a single leaf.
            Outcome::MoreLevels if room.levels <= MAX_DEPTH => room.levels = MAX_DEPTH + 1,
            Outcome::MoreLevels => return Err(Error::Kernel(status::describe(status::LEVELS))),
            Outcome::MoreRoom => match room.grown(most, options.builder.small()) {
                Some(grown) => room = grown,
                // Splitting does not separate these triangles: fewer levels, longer leaves, bounded memory.
                None if max_depth > 0 => max_depth /= 2,
                None => return Err(Error::Kernel(status::describe(status::CAPACITY))),
            },
        }
        retries += 1;
        failed += begin.elapsed();
    }
}

enum Outcome {
    Built(Box<Built>),
    MoreRoom,
    MoreLevels,
}

#[expect(clippy::too_many_lines, reason = "one list of buffers and one of steps, best read in one piece")]
fn attempt_build(
    device: &Device,
    mesh: &Mesh,
    on_device: &MeshBuffers,
    params: &BuildParams,
    room: Room,
    profile: bool,
    arena: &mut Arena<'_>,
) -> Result<Outcome, Error> {
    let references = params.references;
    let param_buffer = arena.alloc("params", 1, size_of::<BuildParams>() as u64)?;
    let state = arena.alloc("state", STATE_WORDS, 4)?;
    let mut pair = |name, count, stride| -> Result<[Buffer; 2], Error> {
        Ok([arena.alloc(name, count, stride)?, arena.alloc(name, count, stride)?])
    };
    let levels = pair("level", LEVEL_WORDS, 4)?;
    let args = pair("args", ARGS_WORDS, 4)?;
    let mut pair = |name, count, stride| -> Result<[Buffer; 2], Error> {
        Ok([arena.alloc(name, count, stride)?, arena.alloc(name, count, stride)?])
    };
    let actives = pair("active", room.active, 48)?;
    let chunks = pair("chunks", room.active, 4)?;
    let refs = pair("level refs", room.level_refs, 32)?;
    // Histograms are done with when treelets are built.
    let words = (u64::from(room.active) * u64::from(HIST_WORDS))
        .max(2 * u64::from(scratch_base(room.treelet_refs, room.treelets)));
    let hists = arena.alloc("histograms", words.div_ceil(4) as u32, 16)?;
    let scratch = &hists;
    let planes = arena.alloc("planes", room.active, 8)?;
    let sides = arena.alloc("sides", room.active, 8)?;
    let targets = arena.alloc("targets", room.active, 8)?;
    let sizes = arena.alloc("sizes", room.active, 8)?;
    let blocks = arena.alloc("blocks", blocks_of(room.active), u64::from(KINDS) * 4)?;
    let top = arena.alloc("top", 2 * params.treelets, 8)?;
    let treelets = arena.alloc("treelets", room.treelets, 48)?;
    let treelet_refs = arena.alloc("treelet refs", room.treelet_refs, 32)?;
    let treelet_sizes = arena.alloc("treelet sizes", room.treelets, 8)?;
    let treelet_blocks = arena.alloc(
        "treelet blocks",
        blocks_of(room.treelets),
        u64::from(raykd_kernels::build::place::KINDS) * 4,
    )?;
    let places = arena.alloc("treelet places", room.treelets, 8)?;

    let begin = Instant::now();
    device.write(&param_buffer, 0, bytemuck::bytes_of(params))?;
    // The root: an active node of many references, or the only treelet.
    let root_is_large = references > params.small;
    let root = |first: u32, extra: u32| {
        let bits = |v: [f32; 3]| [v[0].to_bits(), v[1].to_bits(), v[2].to_bits(), 0];
        let mut root = [[0, first, references, extra], bits(params.lo), bits(params.hi)];
        root[1][3] = growth(references).to_bits();
        root
    };
    let mut words = [0u32; STATE_WORDS as usize];
    // The root and the padding after it.
    words[raykd_kernels::build::STATE_TOP as usize] = 2;
    device.write(&top, 8, bytemuck::bytes_of(&Node::PADDING))?;
    let mut first_args = [0u32; ARGS_WORDS as usize];
    put_groups(&mut first_args, ARGS_TREELET_BLOCKS, 1);
    if root_is_large {
        let pieces = references.div_ceil(CHUNK);
        // The root and the padding after it are the first two slots.
        let first: [u32; LEVEL_WORDS as usize] = [1, pieces, references, 0, 2, 0, 0];
        device.write(&levels[0], 0, bytemuck::cast_slice(&first))?;
        let several = if pieces > 1 { pieces } else { 0 };
        for (entry, groups) in [
            (ARGS_ACTIVE, 1),
            (ARGS_BLOCKS, 1),
            (ARGS_CHUNKS, pieces),
            (ARGS_SEVERAL_ACTIVE, several.min(1)),
            (ARGS_SEVERAL_CHUNKS, several),
        ] {
            put_groups(&mut first_args, entry, groups);
        }
        device.write(&actives[0], 0, bytemuck::cast_slice(&root(0, 0)))?;
        device.write(&chunks[0], 0, bytemuck::cast_slice(&vec![0u32; pieces as usize]))?;
    } else {
        device.write(&levels[0], 0, &[0; LEVEL_WORDS as usize * 4])?;
        words[3 * ARGS_TREELETS as usize..].copy_from_slice(&[1, 1, 1]);
        words[STATE_TREELETS as usize] = 1;
        words[STATE_TREELET_REFS as usize] = references;
        device.write(&treelets, 0, bytemuck::cast_slice(&root(0, 0)))?;
    }
    device.write(&args[0], 0, bytemuck::cast_slice(&first_args))?;
    device.write(&treelet_blocks, 0, &vec![0; treelet_blocks.bytes() as usize])?;
    // The second list is not needed before the first has been moved.
    let kept = &refs[1];
    device.write(kept, 0, bytemuck::cast_slice(mesh.kept()))?;
    device.write(&state, 0, bytemuck::cast_slice(&words))?;
    let upload = begin.elapsed();

    let mut steps = Vec::new();
    let whole = if root_is_large { &refs[0] } else { &treelet_refs };
    let buffers = vec![&param_buffer, &on_device.positions, &on_device.indices, kept, whole];
    steps.push(Step::over(&BOXES, references, buffers));
    let number = if root_is_large { room.levels.min(params.max_depth + 1) } else { 0 };
    for depth in 0..number as usize {
        let (now, then) = (depth % 2, (depth + 1) % 2);
        let (level, arg, active, chunk, list) =
            (&levels[now], &args[now], &actives[now], &chunks[now], &refs[now]);
        // What those bind that clip references.
        let clipping = [&param_buffer, &on_device.positions, &on_device.indices, level, active];
        let of_chunks = [&clipping[..], &[chunk, list, &planes, &sides]].concat();
        let buffers = [&clipping[..], &[list, &planes, &sizes, &hists]].concat();
        steps.push(Step::indirect(&ALONE, arg, ARGS_ACTIVE, buffers));
        let buffers = vec![level, active, chunk, list, &hists];
        steps.push(Step::indirect(&BIN, arg, ARGS_SEVERAL_CHUNKS, buffers));
        let buffers = vec![&param_buffer, level, active, &hists, &planes];
        steps.push(Step::indirect(&SPLIT, arg, ARGS_SEVERAL_ACTIVE, buffers));
        let buffers = [&of_chunks[..], &[&sizes]].concat();
        steps.push(Step::indirect(&COUNT, arg, ARGS_SEVERAL_CHUNKS, buffers));
        // No more nodes than that are active here.
        if room.active.min(1 << depth.min(31)) > BLOCK {
            let buffers = vec![&param_buffer, level, &planes, &sizes, &blocks];
            steps.push(Step::indirect(&TALLY, arg, ARGS_BLOCKS, buffers));
        }
        steps.push(Step::indirect(
            &ALLOC,
            arg,
            ARGS_BLOCKS,
            vec![
                &param_buffer,
                level,
                active,
                &planes,
                &sizes,
                &blocks,
                &targets,
                &top,
                &levels[then],
                &actives[then],
                &chunks[then],
                &args[then],
                &treelets,
                &state,
            ],
        ));
        let buffers = [&of_chunks[..], &[&targets, &state, &refs[then], &treelet_refs]].concat();
        steps.push(Step::indirect(&SCATTER, arg, ARGS_CHUNKS, buffers));
    }
    steps.push(Step::indirect(
        &TREELETS,
        &state,
        ARGS_TREELETS,
        vec![
            &param_buffer,
            &on_device.positions,
            &on_device.indices,
            &state,
            &treelets,
            &treelet_refs,
            scratch,
            &treelet_sizes,
            &treelet_blocks,
        ],
    ));
    let last = number as usize % 2;
    let buffers = vec![&levels[last], &treelet_sizes, &treelet_blocks, &places, &state];
    steps.push(Step::indirect(&PLACE, &args[last], ARGS_TREELET_BLOCKS, buffers));
    let first_part = device.dispatch(&steps, profile)?;
    let mut kernels = Vec::new();
    add_times(&mut kernels, &steps, &first_part);

    // The one look at the device: how large is the tree?
    let words: Vec<u32> = device.read(&state, 0, STATE_WORDS as usize)?;
    let bits = words[STATE_STATUS as usize];
    if bits & status::CAPACITY != 0 {
        return Ok(Outcome::MoreRoom);
    }
    if bits != 0 {
        return Err(Error::Kernel(status::describe(bits)));
    }
    if words[STATE_LEFT as usize] != 0 {
        return Ok(Outcome::MoreLevels);
    }
    let (node_count, ref_count) = (words[STATE_NODES as usize], words[STATE_REFS as usize]);
    let nodes = arena.alloc("nodes", node_count, 8)?;
    let out = arena.alloc("refs", ref_count, 4)?;
    let steps = [
        Step::over(&TOP, words[raykd_kernels::build::STATE_TOP as usize], vec![&state, &top, &nodes]),
        Step::groups(
            &EMIT,
            words[STATE_TREELETS as usize],
            vec![&state, &treelets, &treelet_refs, scratch, &treelet_sizes, &places, &nodes, &out],
        ),
    ];
    let second_part = device.dispatch(&steps, profile)?;
    add_times(&mut kernels, &steps, &second_part);
    let header = TreeHeader {
        lo: params.lo,
        nodes: node_count,
        hi: params.hi,
        refs: ref_count,
        triangles: params.triangles,
        depth: words[STATE_DEPTH as usize],
        scale: mesh.scale(),
        cost_step: params.cost_step,
        cost_test: params.cost_test,
        mesh: [0; 2],
        checksum: 0,
    };
    let times = BuildTimes {
        upload,
        layout: Duration::ZERO,
        build: first_part.total + second_part.total,
        peak_bytes: arena.bytes,
        retries: 0,
        failed: Duration::ZERO,
        by_host: false,
        kernels,
    };
    Ok(Outcome::Built(Box::new(Built { header, nodes, refs: out, times })))
}

/// Sums the steps' times by kernel, in order of first use.
pub(crate) fn add_times(kernels: &mut Vec<KernelTimes>, steps: &[Step<'_>], timing: &Timing) {
    for (i, (step, &time)) in steps.iter().zip(&timing.steps).enumerate() {
        let name = step.kernel.name();
        let bytes = timing.moved.get(i).copied();
        match kernels.iter_mut().find(|kernel| kernel.name == name) {
            Some(kernel) => {
                kernel.dispatches += 1;
                kernel.time += time;
                kernel.bytes = kernel.bytes.zip(bytes).map(|(sum, more)| sum + more);
            }
            None => kernels.push(KernelTimes { name, dispatches: 1, time, bytes }),
        }
    }
}
