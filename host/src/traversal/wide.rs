//! Nodes of eight children for the traversal `wide`, made of a mesh on the CPU: a binary hierarchy of boxes by surface
//! area (Wald 2007, "On fast construction of SAH-based bounding volume hierarchies"), of whose nodes those are kept
//! that cost least (Ylitie, Karras & Laine 2017, section 4.3). The same on every machine.

use crate::{Error, exec::reserve};
use raykd_kernels::{
    glam::Vec4,
    trace::{intersect::strict::Strict, prepare::corners::kept},
};
use raykd_shared::WideNode;
use std::collections::VecDeque;

/// What a step to a node costs, and the test of a triangle.
const STEP: f32 = 1.0;
const TEST: f32 = 0.3;

/// Parts in which centres are counted along an axis.
const BINS: usize = 32;

/// From this depth on triangles are halved by number, so that no node lies deeper than [`WideNode::MAX_DEPTH`].
const HALVED: u32 = WideNode::MAX_DEPTH / 2;

/// More triangles are divided among threads.
const GRAIN: usize = 4096;

/// A triangle: its number and its corners, scaled.
pub(crate) type Triangle = (u32, [[f32; 3]; 3]);

/// Nodes, the root first, and the triangles in their order, as leaves of a tree keep them.
pub(super) struct Wide {
    pub(super) nodes: Vec<WideNode>,
    pub(super) corners: Vec<Vec4>,
}

/// A box by its lower and upper corner.
#[derive(Clone, Copy)]
struct Cuboid([f32; 3], [f32; 3]);

impl Cuboid {
    const NOTHING: Self = Self([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);

    fn of(corners: &[[f32; 3]; 3]) -> Self {
        corners.iter().fold(Self::NOTHING, |all, &p| all.with(Self(p, p)))
    }

    fn with(self, other: Self) -> Self {
        let each =
            |choose: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|i| choose(a[i], b[i]));
        Self(each(f32::min, self.0, other.0), each(f32::max, self.1, other.1))
    }

    /// Half its surface.
    fn area(self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|i| self.1[i] - self.0[i]);
        x * y + y * z + z * x
    }

    /// Twice its centre.
    fn centre(self) -> [f32; 3] {
        [0, 1, 2].map(|i| self.0[i] + self.1[i])
    }
}

/// A node of the binary hierarchy. Its first child follows it, with all its own; then comes the second.
#[derive(Clone, Copy)]
struct Binary {
    bounds: Cuboid,
    /// How many triangles it has, and where they begin.
    count: u32,
    first: u32,
    /// How it is represented best by at most `j` wide nodes or slots with triangles: how many of them its first child
    /// gets, or 0 for as with one less. For `j = 1` 0 if it is a slot with triangles, else a node, whose children are
    /// shared out as `shares[8]` says.
    shares: [u8; 9],
}

/// What it costs to represent a node by at most so many, in units of its surface.
type Costs = [f32; 9];

impl Binary {
    const fn is_slot(&self) -> bool {
        self.shares[1] == 0
    }
}

impl Wide {
    /// Of the triangles of a mesh, if there is memory.
    pub(super) fn of(triangles: &[Triangle]) -> Result<Self, Error> {
        let mut wide = Self { nodes: Vec::new(), corners: Vec::new() };
        if triangles.is_empty() {
            wide.nodes.push(bytemuck::Zeroable::zeroed());
            return Ok(wide);
        }
        let (mut ids, mut binary) = (Vec::new(), Vec::new());
        let count = triangles.len() as u64;
        reserve(&mut wide.corners, "wide triangles", 3 * count)?;
        reserve(&mut ids, "boxes of triangles", count)?;
        reserve(&mut binary, "boxes of nodes", 2 * count - 1)?;
        ids.extend((0..).zip(triangles.iter().map(|(_, t)| Cuboid::of(t))));
        let empty = Binary { bounds: Cuboid::NOTHING, count: 0, first: 0, shares: [0; 9] };
        binary.resize(2 * triangles.len() - 1, empty);
        divide(&mut ids, 0, &mut binary, 0);
        // Breadth first, so that the children of a node follow each other.
        let mut waiting = VecDeque::from([0]);
        let mut children = Vec::with_capacity(8);
        while let Some(at) = waiting.pop_front() {
            children.clear();
            if binary[at].is_slot() {
                children.push(at);
            } else {
                share_out(&binary, at, 8, &mut children);
            }
            let first_node = (wide.nodes.len() + 1 + waiting.len()) as u32;
            let slots = in_slots(&binary, at, &children);
            wide.nodes.push(encode(&binary, at, &slots, [first_node, (wide.corners.len() / 3) as u32]));
            for child in slots.into_iter().flatten() {
                let child_node = &binary[child];
                if child_node.is_slot() {
                    let (first, count) = (child_node.first as usize, child_node.count as usize);
                    for &(i, _) in &ids[first..first + count] {
                        let (id, [a, b, c]) = triangles[i as usize];
                        let (a, b, c) = kept::<Strict>(id, (a.into(), b.into(), c.into()));
                        wide.corners.extend([a, b, c]);
                    }
                } else {
                    waiting.push_back(child);
                }
            }
        }
        Ok(wide)
    }
}

/// Makes the hierarchy of some triangles, of which `first` come before, and says what they cost.
fn divide(ids: &mut [(u32, Cuboid)], first: u32, nodes: &mut [Binary], depth: u32) -> Costs {
    let count = ids.len() as u32;
    let bounds = ids.iter().fold(Cuboid::NOTHING, |all, (_, one)| all.with(*one));
    let area = bounds.area();
    let as_slot = if count <= WideNode::TRIANGLES { area * count as f32 * TEST } else { f32::INFINITY };
    let mut shares = [0; 9];
    let mut costs = [as_slot; 9];
    let (node, children) = nodes.split_first_mut().expect("a node for each triangle and each division");
    if count > 1 {
        let middle = if depth < HALVED { partition(ids) } else { ids.len() / 2 };
        let (low, high) = ids.split_at_mut(middle);
        let (low_nodes, high_nodes) = children.split_at_mut(2 * middle - 1);
        let between = first + middle as u32;
        let mut below = || divide(low, first, low_nodes, depth + 1);
        let mut above = || divide(high, between, high_nodes, depth + 1);
        let (below, above) =
            if count as usize > GRAIN { rayon::join(below, above) } else { (below(), above()) };
        costs = [f32::INFINITY; 9];
        for most in 2..=8_usize {
            for share in 1..most {
                let cost = below[share] + above[most - share];
                if cost < costs[most] {
                    costs[most] = cost;
                    shares[most] = share as u8;
                }
            }
        }
        let as_node = area * STEP + costs[8];
        costs[1] = as_slot.min(as_node);
        shares[1] = u8::from(as_node < as_slot);
        for most in 2..8 {
            if costs[most - 1] <= costs[most] {
                costs[most] = costs[most - 1];
                shares[most] = 0;
            }
        }
    }
    *node = Binary { bounds, count, first, shares };
    costs
}

/// Divides some triangles, two at least, where that costs least by area of boxes and number of triangles, and says
/// where the second part begins.
fn partition(ids: &mut [(u32, Cuboid)]) -> usize {
    let centres =
        ids.iter().fold(Cuboid::NOTHING, |all, (_, one)| all.with(Cuboid(one.centre(), one.centre())));
    let bin = |axis: usize, one: &Cuboid| {
        let extent = centres.1[axis] - centres.0[axis];
        let part = (one.centre()[axis] - centres.0[axis]) / extent * BINS as f32;
        (part as usize).min(BINS - 1)
    };
    let mut best = (f32::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| centres.0[axis] < centres.1[axis]) {
        let mut bins = [(Cuboid::NOTHING, 0u32); BINS];
        for (_, one) in ids.iter() {
            let (bounds, count) = &mut bins[bin(axis, one)];
            *bounds = bounds.with(*one);
            *count += 1;
        }
        let add = |(all, sum): (Cuboid, u32), (bounds, count): (Cuboid, u32)| (all.with(bounds), sum + count);
        let cost = |(bounds, count): (Cuboid, u32)| bounds.area() * count as f32;
        // Of what lies from each bin on.
        let mut above = [0.0; BINS];
        let mut so_far = (Cuboid::NOTHING, 0);
        for i in (1..BINS).rev() {
            so_far = add(so_far, bins[i]);
            above[i] = if so_far.1 == 0 { f32::INFINITY } else { cost(so_far) };
        }
        so_far = (Cuboid::NOTHING, 0);
        for i in 1..BINS {
            so_far = add(so_far, bins[i - 1]);
            if so_far.1 > 0 && cost(so_far) + above[i] < best.0 {
                best = (cost(so_far) + above[i], axis, i);
            }
        }
    }
    let (cost, axis, border) = best;
    if cost == f32::INFINITY {
        return ids.len() / 2;
    }
    let mut below = 0;
    for i in 0..ids.len() {
        if bin(axis, &ids[i].1) < border {
            ids.swap(i, below);
            below += 1;
        }
    }
    below
}

/// Finds what represents the children of node `at` by at most `most` wide nodes or slots with triangles.
fn share_out(binary: &[Binary], at: usize, most: usize, found: &mut Vec<usize>) {
    let low = at + 1;
    let high = at + 2 * binary[low].count as usize;
    let share = usize::from(binary[at].shares[most]);
    for (child, most) in [(low, share), (high, most - share)] {
        represent(binary, child, most, found);
    }
}

/// Finds what represents node `at` by at most `most` wide nodes or slots with triangles.
fn represent(binary: &[Binary], at: usize, most: usize, found: &mut Vec<usize>) {
    let least = (1..=most).rev().find(|&most| most == 1 || binary[at].shares[most] != 0);
    match least {
        Some(most) if most > 1 => share_out(binary, at, most, found),
        _ => found.push(at),
    }
}

/// The children in their slots: each goes where it lies farthest that way from the middle, those first that lie
/// farthest.
fn in_slots(binary: &[Binary], at: usize, children: &[usize]) -> [Option<usize>; 8] {
    let middle = binary[at].bounds.centre();
    let mut slots = [None; 8];
    let mut left = children.to_vec();
    while !left.is_empty() {
        let mut best = (f32::NEG_INFINITY, 0, 0);
        for (i, &child) in left.iter().enumerate() {
            let centre = binary[child].bounds.centre();
            let away = [0, 1, 2].map(|axis| centre[axis] - middle[axis]);
            for slot in (0..8).filter(|&slot| slots[slot].is_none()) {
                let along = |axis: usize| if slot >> axis & 1 == 1 { away[axis] } else { -away[axis] };
                let far = along(0) + along(1) + along(2);
                if far > best.0 {
                    best = (far, i, slot);
                }
            }
        }
        slots[best.2] = Some(left.remove(best.1));
    }
    slots
}

/// The wide node of node `at` with some children, the first of which that are nodes and triangles have these numbers.
fn encode(
    binary: &[Binary],
    at: usize,
    slots: &[Option<usize>; 8],
    [first_node, first_triangle]: [u32; 2],
) -> WideNode {
    let Cuboid(lo, hi) = binary[at].bounds;
    let [x, y, z] = [0, 1, 2].map(|axis| exponent(lo[axis], hi[axis]));
    let exponents = [x, y, z, 0];
    let mut node = WideNode {
        lo: lo.map(f32::to_bits),
        exponents,
        first_node,
        first_triangle,
        triangles: 0,
        nodes: 0,
        faces: [[0; 8]; 6],
    };
    for (slot, child) in slots.iter().enumerate() {
        let Some(child) = *child else { continue };
        let Binary { bounds: Cuboid(low, high), count, .. } = binary[child];
        for axis in 0..3 {
            let step = |x: f32| (f64::from(x) - f64::from(lo[axis])) / f64::from(unit(exponents[axis]));
            // In 0 to 255, by the exponent.
            node.faces[axis][slot] = step(low[axis]).floor() as u8;
            node.faces[3 + axis][slot] = step(high[axis]).ceil() as u8;
        }
        if binary[child].is_slot() {
            node.triangles |= WideNode::triangles(slot as u32, count);
        } else {
            node.nodes |= WideNode::node(slot as u32);
        }
    }
    node
}

/// The power of two from one face to the next.
fn unit(exponent: u8) -> f32 {
    f32::from_bits(u32::from(exponent) << 23)
}

/// The exponent of the smallest unit of which 255 reach from `lo` to `hi`, at least `2^-90`: with reciprocals of a ray,
/// which are at least `2^-1`, no product of it is subnormal.
fn exponent(lo: f32, hi: f32) -> u8 {
    let reaches = |exponent: u8| 255.0 * f64::from(unit(exponent)) >= f64::from(hi) - f64::from(lo);
    (37..=254).find(|&exponent| reaches(exponent)).expect("coordinates of a scene are small")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;

    fn triangles(mesh: &Mesh) -> Vec<Triangle> {
        let scaled = mesh.scaled_positions();
        let at = |v: u32| [0, 1, 2].map(|axis| scaled[3 * v as usize + axis]);
        mesh.kept().iter().map(|&t| (t, mesh.triangles()[t as usize].map(at))).collect()
    }

    /// Goes through all nodes: boxes hold what is in them, nothing is lost or there twice.
    fn check(triangles: &[Triangle]) {
        let wide = Wide::of(triangles).unwrap();
        let mut found = vec![0; triangles.len()];
        let number: std::collections::HashMap<u32, usize> =
            triangles.iter().enumerate().map(|(i, t)| (t.0, i)).collect();
        let whole = Cuboid([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
        let mut seen = 0;
        let mut waiting = vec![(0usize, whole, 0)];
        while let Some((at, within, depth)) = waiting.pop() {
            seen += 1;
            assert!(depth <= WideNode::MAX_DEPTH);
            let node = &wide.nodes[at];
            for slot in 0..8 {
                let bits = |word: u32| word >> (3 * slot) & 7;
                let face = |upper: usize, axis: usize| {
                    let steps = f64::from(node.faces[3 * upper + axis][slot]);
                    f64::from(f32::from_bits(node.lo[axis])) + steps * f64::from(unit(node.exponents[axis]))
                };
                let holds = |p: [f32; 3]| {
                    (0..3).all(|a| {
                        let x = f64::from(p[a]);
                        face(0, a) <= x && x <= face(1, a) && within.0[a] <= p[a] && p[a] <= within.1[a]
                    })
                };
                let below = (1u32 << (3 * slot)) - 1;
                if bits(node.nodes) != 0 {
                    assert_eq!((bits(node.nodes), bits(node.triangles)), (3, 0));
                    let before = (node.nodes & WideNode::LOWEST & below).count_ones();
                    let outwards = |upper| [0, 1, 2].map(|axis| face(upper, axis) as f32);
                    let (lo, hi) = (outwards(0).map(f32::next_down), outwards(1).map(f32::next_up));
                    waiting.push(((node.first_node + before) as usize, Cuboid(lo, hi), depth + 1));
                } else {
                    let before = (node.triangles & below).count_ones();
                    for bit in 0..3 {
                        if bits(node.triangles) >> bit & 1 == 1 {
                            let place = 3 * (node.first_triangle + before + bit) as usize;
                            let corners = [0, 1, 2].map(|i| wide.corners[place + i]);
                            let id = corners[0].w.to_bits() & !raykd_kernels::trace::intersect::NORMAL;
                            let i = number[&id];
                            found[i] += 1;
                            let kept = corners.map(|p| [p.x, p.y, p.z]);
                            assert_eq!(kept, triangles[i].1);
                            assert!(kept.into_iter().all(holds), "{kept:?} in {node:?}");
                        }
                    }
                }
            }
        }
        assert!(found.iter().all(|&times| times == 1));
        assert_eq!((seen, wide.corners.len()), (wide.nodes.len(), 3 * triangles.len()));
    }

    #[test]
    fn every_triangle_is_in_one_slot_and_its_box() {
        check(&[]);
        for level in [1, 2, 8] {
            let teapot = triangles(&Mesh::teapot(level));
            for some in [1, 2, 3, 4, 25, teapot.len()] {
                check(&teapot[..some]);
            }
        }
    }

    /// Triangles in one place, and such that get smaller, so that surface area divides off few: not so far down.
    #[test]
    fn no_node_lies_too_deep() {
        let one = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0f32]];
        check(&(0..10_000).map(|i| (i, one)).collect::<Vec<_>>());
        let smaller = |i: i32| one.map(|p| p.map(|x| x * 0.8f32.powi(i)));
        check(&(0..200).map(|i| (i as u32, smaller(i))).collect::<Vec<_>>());

        let ids: Vec<_> = (0..200).map(|i| (i as u32, Cuboid::of(&smaller(i)))).collect();
        let below = |depth| {
            let empty = Binary { bounds: Cuboid::NOTHING, count: 0, first: 0, shares: [0; 9] };
            let mut nodes = vec![empty; 399];
            divide(&mut ids.clone(), 0, &mut nodes, depth);
            nodes[1].count
        };
        assert_ne!(below(HALVED - 1), 100);
        assert_eq!(below(HALVED), 100);
    }

    #[test]
    fn any_number_of_threads_makes_the_same() {
        let mesh = triangles(&Mesh::teapot(20));
        assert!(mesh.len() > GRAIN);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let Wide { nodes, corners } = pool.install(|| Wide::of(&mesh)).unwrap();
            (nodes, bytemuck::cast_slice::<Vec4, u32>(&corners).to_vec())
        };
        assert!(with(1) == with(4));
    }
}
