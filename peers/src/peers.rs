//! Each crate in its fastest documented use, with its own triangle test where it has one that sees both sides.

use crate::{
    embree::embree,
    peer::{Answer, Peer, Trace, each, timed},
};
use bvh::{
    aabb::{Aabb, Bounded},
    bounding_hierarchy::BHShape,
    bvh::{Bvh, BvhNode},
};
use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    bvh2::builder::build_bvh2_from_tris,
    cwbvh::builder::build_cwbvh_from_tris,
    ray::{Ray as ObRay, RayHit},
    rt_triangle::RtTriangle,
    triangle::Triangle,
};
use parry3d::{
    query::Ray as ParryRay,
    shape::{CompositeShapeRef, TriMesh},
};
use raykd::{BuildOptions, Builder, Device, Mesh, Query, Ray, Scene, shared::MISS};
use std::{rc::Rc, time::Duration};

/// raykd's trees as they are unless told otherwise.
fn usual(builder: Builder) -> BuildOptions {
    BuildOptions::default().with_builder(builder)
}

/// Trees of fewer nodes and references, which suit a CPU's caches: `--price 20 --cost-step 1.4 --empty 0.8`.
fn small(builder: Builder) -> BuildOptions {
    usual(builder).with_price(20.0).with_cost_step(1.4).with_empty(0.8)
}

/// raykd with one of its trees; its times are those of its kernels.
fn raykd<'a>(device: &'a Device, mesh: &Mesh, name: &'static str, options: &BuildOptions) -> Peer<'a> {
    let scene = Rc::new(Scene::build(device, mesh, options).expect("the CPU does not fail"));
    let trace = |query| -> Trace<'a> {
        let scene = Rc::clone(&scene);
        Box::new(move |rays: &[Ray]| {
            let traced = scene.trace(query, rays).expect("the CPU does not fail");
            let answer = |hit: &raykd::Hit| match hit.is_hit() {
                true => Answer { triangle: hit.triangle, t: hit.t },
                false => Answer::MISS,
            };
            (traced.times.trace, traced.hits.iter().map(answer).collect())
        })
    };
    let build = scene.times().build + scene.times().layout;
    Peer { name, build, closest: trace(Query::Closest), any: Some(trace(Query::Any)) }
}

/// raykd ray by ray, as the other crates are asked.
fn single<'a>(device: &'a Device, mesh: &Mesh) -> Peer<'a> {
    let scene = Scene::build(device, mesh, &usual(Builder::Binned)).expect("the CPU does not fail");
    let tracer = scene.tracer().expect("the CPU does not fail");
    let answer =
        |hit: Option<raykd::Hit>| hit.map_or(Answer::MISS, |hit| Answer { triangle: hit.triangle, t: hit.t });
    let other = tracer.clone();
    Peer {
        name: "raykd single rays",
        build: scene.times().build + scene.times().layout,
        closest: each(move |ray| answer(tracer.closest(ray))),
        any: Some(each(move |ray| answer(other.any(ray)))),
    }
}

/// Builds a tree; none if what that takes is not on this system.
pub type Make = for<'a> fn(&'a Device, &Mesh) -> Option<Peer<'a>>;

/// All of them, raykd first.
pub const ALL: [Make; 11] = [
    |device, mesh| Some(raykd(device, mesh, "raykd binned", &usual(Builder::Binned))),
    |device, mesh| Some(single(device, mesh)),
    |device, mesh| Some(raykd(device, mesh, "raykd exact", &usual(Builder::Exact))),
    |device, mesh| Some(raykd(device, mesh, "raykd binned, small", &small(Builder::Binned))),
    |device, mesh| Some(raykd(device, mesh, "raykd exact, small", &small(Builder::Exact))),
    |_, mesh| Some(bvh(mesh)),
    |_, mesh| Some(parry(mesh)),
    |_, mesh| Some(kdtree_ray(mesh)),
    |_, mesh| Some(obvhs_bvh2(mesh)),
    |_, mesh| Some(obvhs_cwbvh(mesh)),
    |_, mesh| embree(mesh),
];

fn corners(mesh: &Mesh) -> impl Iterator<Item = [[f32; 3]; 3]> {
    mesh.triangles().iter().map(|ids| ids.map(|i| mesh.positions()[i as usize]))
}

/// Möller and Trumbore's test of both sides, for the crates without one.
#[derive(Clone, Copy)]
struct Plain {
    a: Vec3A,
    ab: Vec3A,
    ac: Vec3A,
    node: usize,
}

impl Plain {
    fn new(corners: [[f32; 3]; 3]) -> Self {
        let [a, b, c] = corners.map(Vec3A::from_array);
        Self { a, ab: b - a, ac: c - a, node: 0 }
    }

    fn corners(&self) -> [Vec3A; 3] {
        [self.a, self.a + self.ab, self.a + self.ac]
    }

    #[inline]
    fn hit(&self, origin: Vec3A, d: Vec3A, t_min: f32, t_max: f32) -> Option<f32> {
        let p = d.cross(self.ac);
        let inverse = 1.0 / self.ab.dot(p);
        let from = origin - self.a;
        let u = from.dot(p) * inverse;
        let q = from.cross(self.ab);
        let v = d.dot(q) * inverse;
        let t = self.ac.dot(q) * inverse;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= t_min && t <= t_max).then_some(t)
    }
}

impl Bounded<f32, 3> for Plain {
    fn aabb(&self) -> Aabb<f32, 3> {
        let [a, b, c] = self.corners();
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        Aabb::with_bounds(lo.to_array().into(), hi.to_array().into())
    }
}

impl BHShape<f32, 3> for Plain {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }
    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// The crate finds boxes by distance but knows no best hit: an ordered walk over its nodes and its box test.
fn bvh<'a>(mesh: &Mesh) -> Peer<'a> {
    let mut triangles: Vec<Plain> = corners(mesh).map(Plain::new).collect();
    let (build, tree) = timed(|| Bvh::build(&mut triangles));
    let both = Rc::new((tree, triangles));
    let trace = |any: bool| {
        let both = Rc::clone(&both);
        each(move |ray| {
            let (tree, triangles) = &*both;
            let d = Vec3A::from_array(ray.direction);
            let origin = Vec3A::from_array(ray.origin);
            let length = d.length();
            let slabs = bvh::ray::Ray::new(ray.origin.into(), ray.direction.into());
            let mut best = Answer { triangle: MISS, t: ray.t_max };
            let mut stack = [(0usize, 0f32); 128];
            let mut top = 1;
            while top > 0 {
                top -= 1;
                let (node, enter) = stack[top];
                if enter > best.t * length {
                    continue;
                }
                match &tree.nodes[node] {
                    BvhNode::Leaf { shape_index, .. } => {
                        if let Some(t) = triangles[*shape_index].hit(origin, d, ray.t_min, best.t) {
                            best = Answer { triangle: *shape_index as u32, t };
                            if any {
                                break;
                            }
                        }
                    }
                    BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } => {
                        let l =
                            slabs.intersection_slice_for_aabb(child_l_aabb).map(|s| (*child_l_index, s.0));
                        let r =
                            slabs.intersection_slice_for_aabb(child_r_aabb).map(|s| (*child_r_index, s.0));
                        let (near, far) = match (l, r) {
                            (Some(l), Some(r)) if r.1 < l.1 => (Some(r), Some(l)),
                            both => both,
                        };
                        for child in [far, near].into_iter().flatten() {
                            stack[top] = child;
                            top += 1;
                        }
                    }
                }
            }
            if best.is_hit() { best } else { Answer::MISS }
        })
    };
    Peer { name: "bvh", build, closest: trace(false), any: Some(trace(true)) }
}

fn parry<'a>(mesh: &Mesh) -> Peer<'a> {
    let vertices = mesh.positions().iter().map(|p| (*p).into()).collect();
    let indices = mesh.triangles().to_vec();
    let (build, tree) = timed(|| TriMesh::new(vertices, indices).expect("a mesh"));
    let closest = each(move |ray| {
        let line = ParryRay::new(ray.origin.into(), ray.direction.into());
        let hit = CompositeShapeRef(&tree).cast_local_ray(&line, ray.t_max, false);
        hit.map_or(Answer::MISS, |(triangle, t)| Answer { triangle, t })
    });
    Peer { name: "parry3d", build, closest, any: None }
}

struct Boxed([[f32; 3]; 2]);

impl kdtree_ray::Bounded for Boxed {
    fn bound(&self) -> kdtree_ray::AABB {
        let [lo, hi] = self.0.map(cgmath::Vector3::from);
        kdtree_ray::AABB::new(lo, hi)
    }
}

/// It gives all candidates along the line, to be tested by its user.
fn kdtree_ray<'a>(mesh: &Mesh) -> Peer<'a> {
    let triangles: Vec<Plain> = corners(mesh).map(Plain::new).collect();
    let boxed = |[a, b, c]: [[f32; 3]; 3]| {
        let [a, b, c] = [a, b, c].map(Vec3A::from_array);
        Boxed([a.min(b).min(c).to_array(), a.max(b).max(c).to_array()])
    };
    let shapes: Vec<Boxed> = corners(mesh).map(boxed).collect();
    let (build, tree) = timed(|| kdtree_ray::KDTree::build(&shapes));
    let closest = each(move |ray| {
        let (o, d) = (Vec3A::from_array(ray.origin), Vec3A::from_array(ray.direction));
        let mut best = Answer { triangle: MISS, t: ray.t_max };
        for id in tree.intersect(&ray.origin.into(), &ray.direction.into()) {
            if let Some(t) = triangles[id].hit(o, d, ray.t_min, best.t) {
                best = Answer { triangle: id as u32, t };
            }
        }
        if best.is_hit() { best } else { Answer::MISS }
    });
    Peer { name: "kdtree-ray", build, closest, any: None }
}

fn ob_ray(ray: &Ray) -> ObRay {
    ObRay::new(Vec3A::from_array(ray.origin), Vec3A::from_array(ray.direction), ray.t_min, ray.t_max)
}

/// Both of the crate's trees are used alike.
macro_rules! obvhs {
    ($name:ident, $label:literal, $build:path) => {
        fn $name<'a>(mesh: &Mesh) -> Peer<'a> {
            let triangles: Vec<Triangle> = corners(mesh)
                .map(|t| t.map(Vec3A::from_array))
                .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
                .collect();
            let (build, tree) =
                timed(|| $build(&triangles, BvhBuildParams::medium_build(), &mut Duration::default()));
            // In the order of the leaves, as its examples do.
            let ordered: Vec<RtTriangle> =
                tree.primitive_indices.iter().map(|&i| (&triangles[i as usize]).into()).collect();
            let both = Rc::new((tree, ordered));
            let again = Rc::clone(&both);
            let closest = each(move |ray| {
                let (tree, ordered) = &*both;
                let mut hit = RayHit::none();
                if tree.ray_traverse(ob_ray(ray), &mut hit, |ray, id| ordered[id].intersect(ray)) {
                    Answer { triangle: tree.primitive_indices[hit.primitive_id as usize], t: hit.t }
                } else {
                    Answer::MISS
                }
            });
            let any = each(move |ray| {
                let (tree, ordered) = &*again;
                match tree.ray_traverse_miss(ob_ray(ray), |ray, id| ordered[id].intersect(ray)) {
                    true => Answer::MISS,
                    false => Answer { triangle: 0, t: 0.0 },
                }
            });
            Peer { name: $label, build, closest, any: Some(any) }
        }
    };
}
obvhs!(obvhs_bvh2, "obvhs BVH2", build_bvh2_from_tris);
obvhs!(obvhs_cwbvh, "obvhs CWBVH", build_cwbvh_from_tris);
