//! Ways through a kd-tree as they were published, with the traps that raykd's avoid: to show that scenes find them.
//!
//! All but [`Textbook::Fused`] test triangles by raykd's own exact test: what they lose, the way loses. They run on
//! the CPU only, one ray at a time.

use crate::{
    Hit, Mesh, Ray,
    shared::{Content, MISS, TreeView},
};
use raykd_kernels::{
    glam::Vec3,
    math::{div, exponent, ldexp},
    trace::{
        frame::Frame,
        intersect::{Best, Intersector as _, strict::Strict},
    },
};

/// A published form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Textbook {
    /// A stack; near is where the direction comes from (Keller 1998, Wald 2004). `0 * inf`, and `+0` that counts as
    /// upwards, lose children.
    Sign,
    /// A stack; near is where the origin is, without asking the direction if it lies in the plane.
    Origin,
    /// The same with the tie broken as pbrt does, but hits count only inside of the leaf that they were found in
    /// (the trap of Havran & Bittner's figure, Hapala & Havran 2011, figure 2).
    Inside,
    /// Restarts at the root where the last leaf ended (Foley & Sugerman 2005).
    Restart,
    /// Locates the point a fixed step of 1e-5 behind the last leaf (Kaplan 1985).
    Sequential,
    /// Leaves by the nearest face and looks up the point beyond; at most 128 leaves (Popov et al. 2007, with the cap
    /// of programs that followed).
    Ropes,
    /// No tree; Woop, Benthin & Wald 2013 compiled to fused multiply-adds.
    Fused,
}

/// An interval of `t`, and a node.
type Entry = (u32, f32, f32);

/// A ray on its way through a tree, in scaled units.
struct Walk<'a> {
    tree: TreeView<'a>,
    positions: &'a [f32],
    triangles: &'a [[u32; 3]],
    frame: Frame,
    origin: [f32; 3],
    direction: [f32; 3],
    best: Best,
}

/// Leaves after which a walk without progress is given up.
const ENDLESS: u32 = 100_000;

impl Textbook {
    /// All of them.
    pub const ALL: &'static [Self] =
        &[Self::Sign, Self::Origin, Self::Inside, Self::Restart, Self::Sequential, Self::Ropes, Self::Fused];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sign => "sign",
            Self::Origin => "origin",
            Self::Inside => "inside",
            Self::Restart => "restart",
            Self::Sequential => "sequential",
            Self::Ropes => "ropes",
            Self::Fused => "fma",
        }
    }

    /// The closest hit of every ray, or what this form takes for it.
    pub(super) fn closest(self, mesh: &Mesh, tree: TreeView<'_>, rays: &[Ray]) -> Vec<Hit> {
        let positions = mesh.scaled_positions();
        let answer = |ray: &Ray| {
            let frame = Frame::of(ray, tree.header);
            let d = ray.direction;
            let top = d.iter().map(|&x| exponent(x)).fold(-127, i32::max);
            let mut walk = Walk {
                tree,
                positions: &positions,
                triangles: mesh.triangles(),
                origin: frame.origin.to_array(),
                direction: d.map(|x| ldexp(x, -top)),
                frame,
                best: Best::NOTHING,
            };
            if frame.valid {
                match self {
                    Self::Fused => mesh.kept().iter().for_each(|&t| walk.fused(t)),
                    _ => walk.go(self),
                }
            }
            let Best { t, triangle, u, v, det } = walk.best;
            if triangle == MISS {
                Hit::NONE
            } else {
                Hit {
                    triangle,
                    t: ldexp(t, -frame.stretch) + 0.0,
                    u: div(u, det) + 0.0,
                    v: div(v, det) + 0.0,
                }
            }
        };
        rays.iter().map(answer).collect()
    }
}

impl Walk<'_> {
    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| Vec3::from_slice(&self.positions[3 * v as usize..]))
    }

    /// Where the ray enters and leaves a box.
    fn clip(&self, lo: [f32; 3], hi: [f32; 3]) -> (f32, f32) {
        let (mut enter, mut exit) = (self.frame.t_min, self.frame.t_max);
        for i in 0..3 {
            let (a, b) =
                ((lo[i] - self.origin[i]) / self.direction[i], (hi[i] - self.origin[i]) / self.direction[i]);
            enter = enter.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        (enter, exit)
    }

    fn go(&mut self, form: Textbook) {
        let (lo, hi) = (self.tree.header.lo, self.tree.header.hi);
        let (enter, exit) = self.clip(lo, hi);
        if enter <= exit {
            match form {
                Textbook::Restart => self.restart(enter, exit),
                Textbook::Sequential | Textbook::Ropes => self.points(form, enter, exit),
                _ => self.stack(form, enter, exit),
            }
        }
    }

    /// Tests a leaf's triangles; hits outside of `enter..=exit` do not count.
    fn leaf(&mut self, first: u32, count: u32, enter: f32, exit: f32) {
        for r in first..first + count {
            let triangle = self.tree.refs[r as usize];
            let [a, b, c] = self.corners(triangle);
            let mut best = self.best;
            Strict.test_unseen(&self.frame, triangle, Strict::lay_out(a, b, c), &mut best);
            if best.t >= enter && best.t <= exit {
                self.best = best;
            }
        }
    }

    /// Near and far child of a node, and where the ray meets the plane.
    fn children(&self, axis: u32, split: f32, below: u32, form: Textbook) -> (u32, u32, f32) {
        let (o, d) = (self.origin[axis as usize], self.direction[axis as usize]);
        let upwards = match form {
            Textbook::Origin => o < split,
            Textbook::Inside => o < split || (o == split && d <= 0.0),
            _ => d > 0.0,
        };
        let (near, far) = if upwards { (below, below + 1) } else { (below + 1, below) };
        (near, far, (split - o) * (1.0 / d))
    }

    fn stack(&mut self, form: Textbook, enter: f32, exit: f32) {
        let mut waiting: Vec<Entry> = vec![(0, enter, exit)];
        while let Some((mut node, enter, mut exit)) = waiting.pop() {
            let mut enter = enter;
            loop {
                match self.tree.nodes[node as usize].content() {
                    Content::Inner { axis, split, below } => {
                        let (near, far, t) = self.children(axis, split, below, form);
                        let behind = form != Textbook::Sign && t <= 0.0;
                        if t > exit || behind {
                            node = near;
                        } else if t < enter {
                            node = far;
                        } else {
                            waiting.push((far, t, exit));
                            (node, exit) = (near, t);
                        }
                    }
                    Content::Leaf { first, count } => {
                        if form != Textbook::Inside {
                            enter = f32::NEG_INFINITY;
                        }
                        let last = if form == Textbook::Inside { exit } else { f32::INFINITY };
                        self.leaf(first, count, enter, last);
                        break;
                    }
                }
            }
            if self.best.t <= exit {
                return;
            }
        }
    }

    fn restart(&mut self, enter: f32, scene_exit: f32) {
        let mut enter = enter;
        for _ in 0..ENDLESS {
            let (mut node, mut exit) = (0, scene_exit);
            while let Content::Inner { axis, split, below } = self.tree.nodes[node as usize].content() {
                let (near, far, t) = self.children(axis, split, below, Textbook::Restart);
                if t <= enter {
                    node = far;
                } else if t >= exit {
                    node = near;
                } else {
                    (node, exit) = (near, t);
                }
            }
            if let Content::Leaf { first, count } = self.tree.nodes[node as usize].content() {
                self.leaf(first, count, f32::NEG_INFINITY, f32::INFINITY);
            }
            if self.best.t <= exit || exit >= scene_exit {
                return;
            }
            enter = exit;
        }
    }

    /// From leaf to leaf by points: a fixed step behind the last leaf, or across the face that the ray leaves by.
    fn points(&mut self, form: Textbook, enter: f32, scene_exit: f32) {
        const STEP: f32 = 1.0e-5;
        let ropes = form == Textbook::Ropes;
        let step = if ropes { 0.0 } else { STEP };
        let mut t = enter;
        let mut face = None;
        for _ in 0..if ropes { 128 } else { ENDLESS } {
            let mut p = [0, 1, 2].map(|i| self.origin[i] + self.direction[i] * (t + step));
            if let Some((axis, at)) = face {
                p[axis] = at;
            }
            let (mut lo, mut hi) = (self.tree.header.lo, self.tree.header.hi);
            let mut node = 0;
            while let Content::Inner { axis, split, below } = self.tree.nodes[node as usize].content() {
                let a = axis as usize;
                let across = face == Some((a, split)) && self.direction[a] > 0.0;
                if p[a] > split || across {
                    (node, lo[a]) = (below + 1, split);
                } else {
                    (node, hi[a]) = (below, split);
                }
            }
            if let Content::Leaf { first, count } = self.tree.nodes[node as usize].content() {
                self.leaf(first, count, f32::NEG_INFINITY, f32::INFINITY);
            }
            let mut exit = scene_exit;
            for i in 0..3 {
                let at = if self.direction[i] > 0.0 { hi[i] } else { lo[i] };
                let there = (at - self.origin[i]) / self.direction[i];
                if there < exit {
                    exit = there;
                    face = ropes.then_some((i, at));
                }
            }
            if self.best.t <= exit || exit >= scene_exit {
                return;
            }
            t = exit;
        }
    }

    /// The paper's test as a compiler that fuses `a * b - c` makes it.
    fn fused(&mut self, triangle: u32) {
        let ray = &self.frame;
        let turn = |p: Vec3| {
            let p = (p - ray.origin).to_array();
            let [x, y, z] = [1, 2, 3].map(|i| p[(ray.main as usize + i) % 3]);
            [(-ray.shear_x).mul_add(z, x), (-ray.shear_y).mul_add(z, y), z]
        };
        let [a, b, c] = self.corners(triangle).map(turn);
        let edge = |p: [f32; 3], q: [f32; 3]| p[0].mul_add(q[1], -(p[1] * q[0]));
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let negative = u < 0.0 || v < 0.0 || w < 0.0;
        let positive = u > 0.0 || v > 0.0 || w > 0.0;
        let det = u + v + w;
        if negative != positive && det != 0.0 {
            let along = ray.inverse.to_array()[ray.main as usize];
            let t = (u * a[2] + v * b[2] + w * c[2]) * along / det;
            let better = t < self.best.t || (t == self.best.t && triangle < self.best.triangle);
            if t >= ray.t_min && t <= ray.t_max && better {
                self.best = Best { t, triangle, u: v, v: w, det };
            }
        }
    }
}
