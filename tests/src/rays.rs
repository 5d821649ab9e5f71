//! Rays that are hard for a mesh and its tree.

use raykd::{
    Mesh, Ray,
    internals::kernels::math::{exponent, ldexp},
    rays::Random,
    shared::{Content, TreeView},
};

/// Rays at a mesh: at corners, edges and insides of triangles, along axes and diagonals, from corners,
/// surfaces, splitting planes and corners of leaves, of any length, with any range of `t`; a few that are no rays at
/// all.
pub fn rays(mesh: &Mesh, tree: TreeView<'_>, count: usize, seed: u64) -> Vec<Ray> {
    let (planes, cells) = cells(tree);
    let mut aim = Aim { mesh, planes, cells, random: Random::new(seed) };
    (0..count).map(|_| aim.ray()).collect()
}

/// The rays with directions of any length, and with numbers from the whole range of `f32` among their coordinates and
/// ends, where there was a 0 above all.
pub fn of_any_size(rays: &[Ray], seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let mut any = move |most: i32| {
        let e = (random.bits() % (most + 127) as u64) as u32 + 1;
        let bits = e << 23 | random.bits() as u32 & 0x807F_FFFF;
        (random.below(12), f32::from_bits(bits))
    };
    let one = |ray: &Ray| {
        let Ray { mut origin, mut direction, mut t_min, mut t_max } = *ray;
        let top = direction.map(exponent).into_iter().max().unwrap_or(0);
        if (-126..128).contains(&top) {
            // As long as the first and the last number there is every now and then.
            let length = match any(128) {
                (0, _) => 127 - top,
                (1, _) => -126 - top,
                (_, x) => exponent(x) - top,
            };
            direction = direction.map(|d| ldexp(d, length));
            [t_min, t_max] = [t_min, t_max].map(|t| ldexp(t, -length));
            let top = top + length;
            for (x, largest) in
                direction.iter_mut().map(|d| (d, top)).chain(origin.iter_mut().map(|o| (o, 0)))
            {
                let (choice, other) = any(largest);
                if choice == 0 || (choice < 6 && *x == 0.0) {
                    *x = other;
                }
            }
        }
        for end in [&mut t_min, &mut t_max] {
            let (choice, other) = any(128);
            if choice == 0 {
                *end = other;
            }
        }
        Ray { origin, direction, t_min, t_max }
    };
    rays.iter().map(one).collect()
}

/// A box: lower and upper corner.
type Bounds = [[f32; 3]; 2];

/// Axis and position of every splitting plane, and the box of every leaf, in the mesh's units.
fn cells(tree: TreeView<'_>) -> (Vec<(usize, f32)>, Vec<Bounds>) {
    let own = |x: f32| x / tree.header.scale;
    let (mut planes, mut cells) = (Vec::new(), Vec::new());
    let mut waiting = vec![(0, [tree.header.lo.map(own), tree.header.hi.map(own)])];
    while let Some((number, cell)) = waiting.pop() {
        match tree.nodes[number as usize].content() {
            Content::Inner { axis, split, below } => {
                let axis = axis as usize;
                planes.push((axis, own(split)));
                let mut halves = [cell; 2];
                halves[0][1][axis] = own(split);
                halves[1][0][axis] = own(split);
                waiting.extend([(below, halves[0]), (below + 1, halves[1])]);
            }
            Content::Leaf { .. } => cells.push(cell),
        }
    }
    (planes, cells)
}

struct Aim<'a> {
    mesh: &'a Mesh,
    planes: Vec<(usize, f32)>,
    cells: Vec<Bounds>,
    random: Random,
}

impl Aim<'_> {
    fn below(&mut self, n: usize) -> usize {
        self.random.below(n)
    }

    fn unit(&mut self) -> f32 {
        self.random.unit() as f32
    }

    fn signed(&mut self) -> f32 {
        self.unit() * 2.0 - 1.0
    }

    fn corners(&mut self) -> [[f32; 3]; 3] {
        let i = self.below(self.mesh.triangles().len());
        self.mesh.triangles()[i].map(|v| self.mesh.positions()[v as usize])
    }

    /// A corner, a point of an edge, or a point inside, of some triangle.
    fn on_surface(&mut self) -> [f32; 3] {
        let [a, b, c] = self.corners();
        let (s, t) = match self.below(4) {
            0 => (0.0, 0.0),
            1 => (0.5, 0.0),
            2 => (self.unit(), 0.0),
            _ => (self.unit() * 0.5, self.unit() * 0.5),
        };
        [0, 1, 2].map(|i| a[i] * (1.0 - s - t) + b[i] * s + c[i] * t)
    }

    /// A corner of a leaf's box, or a point of one of its edges.
    fn on_cell(&mut self) -> [f32; 3] {
        let i = self.below(self.cells.len());
        let cell = self.cells[i];
        let mut point = [0, 1, 2].map(|axis| cell[self.below(2)][axis]);
        if self.below(3) == 0 {
            let axis = self.below(3);
            let s = self.unit();
            point[axis] = cell[0][axis] * (1.0 - s) + cell[1][axis] * s;
        }
        point
    }

    /// A point of the box around the mesh, made larger.
    fn in_box(&mut self, larger: f32) -> [f32; 3] {
        let (lo, hi) = self.mesh.bounds();
        [0, 1, 2].map(|i| {
            let half = (hi[i] * 0.5 - lo[i] * 0.5).max(f32::MIN_POSITIVE);
            (hi[i] * 0.5 + lo[i] * 0.5) + half * larger * self.signed()
        })
    }

    fn extent(&self) -> f32 {
        let (lo, hi) = self.mesh.bounds();
        (0..3).map(|i| hi[i] - lo[i]).fold(f32::MIN_POSITIVE, f32::max)
    }

    fn ray(&mut self) -> Ray {
        let target = if self.below(6) == 0 { self.on_cell() } else { self.on_surface() };
        let mut origin = match self.below(9) {
            8 => self.on_cell(),
            0 => self.on_surface(),
            1 => self.in_box(1.0),
            2 => self.in_box(300.0),
            3 => target.map(f32::round),
            _ => self.in_box(2.0),
        };
        if self.below(4) == 0 && !self.planes.is_empty() {
            let i = self.below(self.planes.len());
            let (axis, at) = self.planes[i];
            origin[axis] = at;
        }
        let size = self.extent();
        let mut direction = [0, 1, 2].map(|i| target[i] - origin[i]);
        match self.below(8) {
            // Along an axis, through the target.
            0 => {
                let axis = self.below(3);
                origin = target;
                origin[axis] -= size * self.signed();
                direction = [0, 1, 2].map(|i| if i == axis { target[i] - origin[i] } else { self.zero() });
            }
            // In a plane across an axis.
            1 => {
                let axis = self.below(3);
                origin[axis] = target[axis];
                direction[axis] = self.zero();
            }
            2 => direction = [0; 3].map(|_| if self.below(2) == 0 { size } else { -size }),
            3 => direction = [0; 3].map(|_| self.signed() * size),
            _ => {}
        }
        // `t` counts from 0 to 1 on the way to the target, or in other lengths.
        let length = match self.below(6) {
            0 => 2f32.powi(self.below(40) as i32 - 20),
            1 => 10f32.powf(6.0 * self.signed()),
            2 => 1.0 / size,
            _ => 1.0,
        };
        let direction = direction.map(|d| if (d * length).is_finite() { d * length } else { d });
        let (t_min, t_max) = match self.below(10) {
            0 => (0.0, 1.0 / length),
            1 => (0.0, 2.0 * self.unit() / length),
            2 => (self.unit() / length, f32::INFINITY),
            3 => (-3.0 / length, 3.0 * self.unit() / length),
            4 => (0.0, f32::MAX),
            5 => (f32::NEG_INFINITY, f32::INFINITY),
            _ => (0.0, f32::INFINITY),
        };
        let mut ray = Ray { origin, direction, t_min, t_max };
        if self.below(40) == 0 {
            self.spoil(&mut ray);
        }
        ray
    }

    fn zero(&mut self) -> f32 {
        if self.below(2) == 0 { 0.0 } else { -0.0 }
    }

    /// Makes a ray odd or invalid.
    fn spoil(&mut self, ray: &mut Ray) {
        let axis = self.below(3);
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40, -1e-42, f32::MIN_POSITIVE, 1e38];
        let odd = odd[self.below(odd.len())];
        match self.below(6) {
            0 => ray.origin[axis] = odd,
            1 => ray.direction[axis] = odd,
            2 => ray.direction = [self.zero(), self.zero(), self.zero()],
            3 => ray.t_min = odd,
            4 => ray.t_max = odd,
            _ => std::mem::swap(&mut ray.t_min, &mut ray.t_max),
        }
    }
}
