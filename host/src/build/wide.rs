//! Nodes of eight children by kernels: which run, over which buffers, how large.

use super::{
    Kept, MeshBuffers,
    radix::{Radix, UNSORTED},
    room::Arena,
};
use crate::{
    Error,
    exec::{Buffer, Device, Launch, Step},
};
use bytemuck::Zeroable;
use raykd_kernels::{
    build::wide::{
        Job, OVER_ALL, OVER_BLOCKS, RECORD_WORDS, State, advance, curve, encode, finish, merge,
        nearest::{self, BLOCK},
        open, place, record, singles,
    },
    glam::{UVec2, UVec4, Vec4},
    trace::prepare::corners,
};
use raykd_shared::{TreeHeader, WideNode};
use std::time::Duration;

/// Rounds and levels from one look of the host to the next, if there are more than it guessed.
const LOOK: usize = 4;

/// Nodes of eight children, the root first, and the triangles in their order, as leaves of a tree keep them: what
/// queries bind instead of a tree.
#[derive(Clone, Debug)]
pub(crate) struct Wide {
    pub nodes: Buffer<UVec4>,
    pub corners: Buffer<Vec4>,
}

/// The buffers from triangles to nodes, in pairs where one is made from the other.
struct Lists<'a> {
    mesh: &'a MeshBuffers,
    count: u32,
    kept: Buffer<u32>,
    job: Buffer<u32>,
    state: Buffer<u32>,
    radix: Radix,
    places: [Buffer<UVec2>; 2],
    triangles: Buffer<u32>,
    clusters: Buffer<u32>,
    nodes: Buffer<UVec4>,
    children: Buffer<UVec2>,
    costs: Buffer<Vec4>,
    fates: Buffer<u32>,
    totals: Buffer<UVec2>,
    rounds: [Buffer<u32>; 2],
    queue: Buffer<UVec4>,
    slots: Buffer<u32>,
    levels: [Buffer<u32>; 2],
}

impl Wide {
    /// Of the triangles of a mesh that take part. `header` tells the box around them. Says how long that took, by the
    /// device's clock.
    pub(crate) fn build(
        device: &Device,
        mesh: &MeshBuffers,
        kept: &Kept,
        header: &TreeHeader,
    ) -> Result<(Self, Duration), Error> {
        Self::guessing(device, mesh, kept, header, [first_rounds, first_levels])
    }

    /// The same, guessing how many rounds and levels so many triangles take.
    fn guessing(
        device: &Device,
        mesh: &MeshBuffers,
        kept: &Kept,
        header: &TreeHeader,
        guess: [fn(u32) -> usize; 2],
    ) -> Result<(Self, Duration), Error> {
        let count = kept.count();
        if count == 0 {
            let nodes = device.upload("wide nodes", &[WideNode::zeroed()])?.view();
            return Ok((Self { nodes, corners: device.room("wide triangles", 0)? }, Duration::ZERO));
        }
        let lists = Lists::new(device, mesh, kept, header)?;
        let (wide, mut took) = lists.run(device, guess.map(|guess| guess(count)))?;
        let nodes = device.room("wide nodes", u64::from(wide) * (size_of::<WideNode>() / 16) as u64)?;
        let order = device.room("order", count.into())?;
        let header = device.put("wide header", &[TreeHeader { refs: count, ..*header }])?;
        let corners = device.room("wide triangles", 3 * u64::from(count))?;
        let encode = encode::Buffers {
            job: &lists.job,
            state: &lists.state,
            nodes: &lists.nodes,
            children: &lists.children,
            triangles: &lists.triangles,
            queue: &lists.queue,
            slots: &lists.slots,
            order: order.out(),
            wide: nodes.out(),
        };
        let lay_out = corners::Buffers {
            header: &header,
            positions: &mesh.positions,
            indices: &mesh.indices,
            refs: &order,
            corners: corners.out(),
        };
        took += device.dispatch(&[encode.over(wide), lay_out.over(count)], false)?.total;
        Ok((Self { nodes, corners }, took))
    }

    /// Bytes of nodes and triangles.
    pub(crate) fn bytes(&self) -> u64 {
        self.nodes.bytes() + self.corners.bytes()
    }
}

/// Rounds after which the host looks first whether clusters are few: the dragons and Sponza need somewhat fewer.
fn first_rounds(count: u32) -> usize {
    if count <= BLOCK { 0 } else { 2 + 3 * (count / BLOCK).ilog2() as usize }
}

/// The same for the levels of wide nodes.
fn first_levels(count: u32) -> usize {
    3 + count.ilog2() as usize / 2
}

impl<'a> Lists<'a> {
    fn new(device: &Device, mesh: &'a MeshBuffers, kept: &Kept, header: &TreeHeader) -> Result<Self, Error> {
        let count = kept.count();
        let extents = [0, 1, 2].map(|axis| header.hi[axis] - header.lo[axis]);
        let extent = extents.into_iter().fold(0.0, f32::max);
        // What is smaller has one place.
        let places = if extent < 2f32.powi(-48) { 0.0 } else { curve::PLACES as f32 / (2.0 * extent) };
        let job =
            Job { triangles: count, lo: header.lo.map(|x| (2.0 * x).to_bits()), places: places.to_bits() };
        let mut round = [0; RECORD_WORDS as usize];
        record(&mut round, count, BLOCK, count, 0);
        let mut arena = Arena { device, bytes: 0 };
        let lists = Self {
            mesh,
            count,
            // The largest first: if they fit, no number of elements is too large for a word.
            nodes: arena.alloc("wide boxes", count, 4)?,
            slots: arena.alloc("wide slots", count, 8)?,
            costs: arena.alloc("wide costs", count, 2)?,
            queue: arena.alloc("wide queue", count, 1)?,
            children: arena.alloc("wide children", count, 1)?,
            places: arena.pair("wide places", count, 1)?,
            clusters: arena.alloc("wide clusters", count, 2)?,
            triangles: arena.alloc("wide numbers", count, 1)?,
            fates: arena.alloc("wide fates", count, 1)?,
            totals: arena.alloc("wide totals", count.div_ceil(BLOCK), 1)?,
            kept: kept.on(device)?,
            job: device.put("wide job", &[job])?.view(),
            state: device.put("wide state", &[State::default()])?.view(),
            radix: Radix::new(&mut arena, 1, count, count)?,
            rounds: [device.put("wide round", &round)?, arena.alloc("wide round", 1, RECORD_WORDS)?],
            levels: arena.pair("wide level", 1, RECORD_WORDS)?,
        };
        Ok(lists)
    }

    /// Makes a cluster of each triangle, in the order of the curve.
    fn start(&self) -> Vec<Step<'_>> {
        let Self { mesh: MeshBuffers { positions, indices, .. }, count, kept, job, .. } = self;
        let places = self.places[UNSORTED].out();
        let mut steps = vec![curve::Buffers { job, positions, indices, kept, places }.over(*count)];
        steps.extend(self.radix.steps(&self.places));
        let singles = singles::Buffers {
            job,
            positions,
            indices,
            kept,
            places: &self.places[0],
            triangles: self.triangles.out(),
            clusters: self.clusters.out(),
            nodes: self.nodes.out(),
        };
        steps.push(singles.over(*count));
        steps
    }

    /// Makes the clusters of the round behind number `round`.
    fn round(&self, round: usize) -> [Step<'_>; 3] {
        let Self { job, clusters, nodes, fates, totals, state, .. } = self;
        let (record, next) = (&self.rounds[round % 2], self.rounds[(round + 1) % 2].out());
        let nearest =
            nearest::Buffers { job, record, clusters, nodes, fates: fates.out(), totals: totals.out() };
        let advance = advance::Buffers { now: record, totals: totals.out(), next, state: state.out() };
        let merge = merge::Buffers {
            job,
            record,
            fates,
            totals,
            clusters: clusters.out(),
            nodes: nodes.out(),
            children: self.children.out(),
            costs: self.costs.out(),
        };
        [nearest.indirect(record, OVER_BLOCKS), advance.groups(1), merge.indirect(record, OVER_ALL)]
    }

    /// Makes the root, if clusters are few before a round.
    fn finish(&self, round: usize) -> Step<'_> {
        let finish = finish::Buffers {
            job: &self.job,
            last: &self.rounds[round % 2],
            clusters: self.clusters.out(),
            nodes: self.nodes.out(),
            children: self.children.out(),
            costs: self.costs.out(),
            fates: self.fates.out(),
            queue: self.queue.out(),
            level: self.levels[0].out(),
            state: self.state.out(),
        };
        finish.groups(1)
    }

    /// Finds the children of the wide nodes of a level.
    fn level(&self, depth: usize) -> [Step<'_>; 3] {
        let Self { job, nodes, children, queue, slots, totals, state, .. } = self;
        let (level, next) = (&self.levels[depth % 2], &self.levels[(depth + 1) % 2]);
        let open = open::Buffers {
            job,
            level,
            nodes,
            children,
            queue: queue.out(),
            slots: slots.out(),
            totals: totals.out(),
        };
        let advance =
            advance::Buffers { now: level, totals: totals.out(), next: next.out(), state: state.out() };
        let place = place::Buffers { level, next, totals, nodes, slots, queue: queue.out() };
        [open.indirect(level, OVER_BLOCKS), advance.groups(1), place.indirect(level, OVER_ALL)]
    }

    /// Finds what becomes wide nodes, and says how many there are and how long it took.
    fn run(&self, device: &Device, guess: [usize; 2]) -> Result<(u32, Duration), Error> {
        let mut took = Duration::ZERO;
        let mut steps = self.start();
        let (mut round, mut depth) = (0, 0);
        let [mut rounds, mut levels] = guess;
        let mut has_root = false;
        loop {
            if !has_root {
                steps.extend((round..round + rounds).flat_map(|round| self.round(round)));
                round += rounds;
                steps.push(self.finish(round));
            }
            steps.extend((depth..depth + levels).flat_map(|depth| self.level(depth)));
            let (timing, state): (_, State) = device.dispatch_and_read(&steps, false, &self.state.view())?;
            took += timing.total;
            has_root = state.clusters == 1;
            if has_root && state.next == 0 {
                return Ok((state.nodes, took));
            }
            // Without a root there was nothing on any level.
            depth = if has_root { depth + levels } else { 0 };
            (rounds, levels) = (LOOK, if has_root { LOOK } else { levels });
            steps.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mesh, build::upload, exec::Cpu};
    use bytemuck::Zeroable;
    use raykd_kernels::Order;

    /// A triangle: its number and its corners, scaled.
    type Triangle = (u32, [[f32; 3]; 3]);

    fn triangles(mesh: &Mesh) -> Vec<Triangle> {
        let scaled = mesh.scaled_positions();
        let at = |v: u32| [0, 1, 2].map(|axis| scaled[3 * v as usize + axis]);
        mesh.kept().iter().map(|&t| (t, mesh.triangles()[t as usize].map(at))).collect()
    }

    fn mesh_of(triangles: &[[[f32; 3]; 3]]) -> Mesh {
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        Mesh::new(triangles.concat(), indices.collect()).unwrap()
    }

    /// Nodes, and words of triangles.
    fn built(device: &Device, mesh: &Mesh) -> (Vec<WideNode>, Vec<[f32; 4]>) {
        guessed(device, mesh, [first_rounds, first_levels])
    }

    fn guessed(device: &Device, mesh: &Mesh, guess: [fn(u32) -> usize; 2]) -> (Vec<WideNode>, Vec<[f32; 4]>) {
        let (lo, hi) = mesh.scaled_bounds();
        let header = TreeHeader { lo, hi, ..TreeHeader::zeroed() };
        let kept = Kept::Host(mesh.kept().into());
        let (wide, _) =
            Wide::guessing(device, &upload(device, mesh).unwrap(), &kept, &header, guess).unwrap();
        let nodes = wide.nodes.view::<WideNode>();
        let corners = wide.corners.view::<[f32; 4]>();
        let count = 3 * mesh.kept().len();
        (device.read(&nodes, 0, nodes.elements()).unwrap(), device.read(&corners, 0, count).unwrap())
    }

    /// Goes through all nodes: boxes hold what is in them, nothing is lost or there twice. Returns the depth.
    fn check(mesh: &Mesh) -> u32 {
        let triangles = triangles(mesh);
        let (nodes, corners) = built(&Device::cpu(), mesh);
        let mut found = vec![0; triangles.len()];
        let number: std::collections::HashMap<u32, usize> =
            triangles.iter().enumerate().map(|(i, t)| (t.0, i)).collect();
        let whole = [[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]];
        let (mut seen, mut deepest) = (0, 0);
        let mut waiting = vec![(0usize, whole, 0)];
        while let Some((at, within, depth)) = waiting.pop() {
            seen += 1;
            deepest = deepest.max(depth);
            let node = &nodes[at];
            for slot in 0..8 {
                let bits = |word: u32| word >> (3 * slot) & 7;
                let face = |upper: usize, axis: usize| {
                    let steps = f64::from(node.faces[3 * upper + axis][slot]);
                    let unit = f32::from_bits(u32::from(node.exponents[axis]) << 23);
                    f64::from(f32::from_bits(node.lo[axis])) + steps * f64::from(unit)
                };
                let holds = |p: [f32; 3]| {
                    (0..3).all(|a| {
                        let x = f64::from(p[a]);
                        face(0, a) <= x && x <= face(1, a) && within[0][a] <= p[a] && p[a] <= within[1][a]
                    })
                };
                let below = (1u32 << (3 * slot)) - 1;
                if bits(node.nodes) != 0 {
                    assert_eq!((bits(node.nodes), bits(node.triangles)), (3, 0));
                    let before = (node.nodes & WideNode::LOWEST & below).count_ones();
                    let outwards = |upper| [0, 1, 2].map(|axis| face(upper, axis) as f32);
                    let box_of = [outwards(0).map(f32::next_down), outwards(1).map(f32::next_up)];
                    waiting.push(((node.first_node + before) as usize, box_of, depth + 1));
                } else {
                    let before = (node.triangles & below).count_ones();
                    for bit in 0..3 {
                        if bits(node.triangles) >> bit & 1 == 1 {
                            let place = 3 * (node.first_triangle + before + bit) as usize;
                            let corners = [0, 1, 2].map(|i| corners[place + i]);
                            let id = corners[0][3].to_bits() & !raykd_kernels::trace::intersect::NORMAL;
                            let i = number[&id];
                            found[i] += 1;
                            let kept = corners.map(|p| [p[0], p[1], p[2]]);
                            assert_eq!(kept, triangles[i].1);
                            assert!(kept.into_iter().all(holds), "{kept:?} in {node:?}");
                        }
                    }
                }
            }
        }
        assert!(found.iter().all(|&times| times == 1));
        assert_eq!(seen, nodes.len());
        deepest
    }

    #[test]
    fn every_triangle_is_in_one_slot_and_its_box() {
        for level in [1, 2, 8] {
            let teapot = Mesh::teapot(level);
            check(&teapot);
            let all = triangles(&teapot);
            for some in [1, 2, 3, 4, 25, BLOCK as usize, BLOCK as usize + 1] {
                check(&mesh_of(&all.iter().take(some).map(|t| t.1).collect::<Vec<_>>()));
            }
        }
    }

    /// Triangles in one place, and such as get smaller, of which each round would make one pair.
    #[test]
    fn no_node_lies_too_deep() {
        let one = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0f32]];
        assert!(check(&mesh_of(&vec![one; 10_000])) < 10);
        let smaller = |i: i32| one.map(|p| p.map(|x| x * 0.8f32.powi(i)));
        assert!(check(&mesh_of(&(0..200).map(smaller).collect::<Vec<_>>())) <= WideNode::MAX_DEPTH);
    }

    #[test]
    fn no_triangles_are_one_node() {
        let device = Device::cpu();
        let mesh = upload(&device, &Mesh::teapot(1)).unwrap();
        let kept = Kept::Host([].into());
        let (wide, _) = Wide::build(&device, &mesh, &kept, &TreeHeader::zeroed()).unwrap();
        assert_eq!(device.read(&wide.nodes.view::<WideNode>(), 0, 1).unwrap(), [WideNode::zeroed()]);
    }

    #[test]
    fn more_rounds_and_levels_than_guessed_are_run() {
        let mesh = Mesh::teapot(20);
        let usual = built(&Device::cpu(), &mesh);
        for guess in [[|_| 1, |_| 20], [|_| 40, |_| 1], [|_| 1, |_| 1]] as [[fn(u32) -> usize; 2]; 3] {
            let other = guessed(&Device::cpu(), &mesh, guess);
            assert!(usual.0 == other.0);
            assert!(bytemuck::cast_slice::<_, u32>(&usual.1) == bytemuck::cast_slice::<_, u32>(&other.1));
        }
    }

    #[test]
    fn order_of_lanes_and_number_of_threads_change_no_byte() {
        let mesh = Mesh::teapot(20);
        let usual = built(&Device::cpu(), &mesh);
        for cpu in [
            Cpu::default().in_order(Order::Reverse),
            Cpu::default().in_order(Order::Shuffled(5)),
            Cpu::with_threads(1).unwrap(),
            Cpu::default().in_rows_of(50),
        ] {
            let other = built(&Device::from(cpu), &mesh);
            assert!(usual.0 == other.0);
            assert!(bytemuck::cast_slice::<_, u32>(&usual.1) == bytemuck::cast_slice::<_, u32>(&other.1));
        }
    }
}
