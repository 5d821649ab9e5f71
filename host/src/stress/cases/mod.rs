//! The scenes in which ray tracers fail, each with its rays and what a right answer is.

mod crowds;
mod edges;
mod planes;
mod sizes;

use super::{Case, Part, Rule, shapes::*};
use crate::{
    BuildOptions, Device, Hit, Mesh, Ray, Scene,
    rays::{Random, facing_normal, offset_origin},
    shared::{Content, MISS},
};

/// Tests that round products before they take differences: their `t` has no bound.
const PLACES: &[&str] = &["moeller", "plane", "baldwin", "woop"];
/// Triangle tests whose edges differ from triangle to triangle.
const EDGES: &[&str] = &["moeller", "plane", "baldwin"];
/// All tests: a rounded origin is on either side of its triangle.
const TESTS: &[&str] = &["strict/", "exact/", "moeller/", "plane/", "baldwin/", "woop/"];
/// All tests that round: a vertex on an edge is seen beside it.
const ROUNDED: &[&str] = &["strict/", "moeller/", "plane/", "baldwin/", "woop/"];
/// [`EDGES`], and ways through the tree that lose hits beside leaves.
const CRACKS: &[&str] =
    &["moeller", "plane", "baldwin", "textbook/inside", "textbook/sequential", "textbook/ropes"];
/// [`EDGES`], and the paper's test by fused multiply-adds.
const FUSED: &[&str] = &["textbook/fma", "moeller", "plane", "baldwin"];
/// Ways that compare `0 * inf`, or take +0 for upwards.
const ZEROS: &[&str] = &["textbook/sign", "textbook/restart"];

/// All scenes. Last stand methods, by the start of their name, that are known to fail there; methods of the
/// textbooks run nowhere else.
pub const CASES: &[Case] = &[
    case("icosphere-edges", "from inside a sphere at its edges and vertices", CRACKS, edges::icosphere_edges),
    case("fan-hub", "at the vertex that 1000 triangles share", EDGES, edges::fan_hub),
    case("contraction", "the first, for tests with fused operations", FUSED, edges::icosphere_edges),
    case(
        "lattice-cubes",
        "cubes with faces in splitting planes, along axes and diagonals",
        ZEROS,
        planes::lattice_cubes,
    ),
    case("in-plane", "rays inside splitting planes", ZEROS, planes::in_plane),
    case("signed-zeros", "the same, with +0 and -0 in the direction", ZEROS, planes::signed_zeros),
    case("origin-on-plane", "origins on splitting planes", &["textbook/origin"], planes::origin_on_plane),
    case("leaving", "from the surface of a hollow sphere to its other side", TESTS, edges::leaving),
    case("leaving-offset", "the same with origins moved off the surface", &[], edges::leaving_offset),
    case("far", "from 256 to 1e6 units away", &["textbook/sequential"], sizes::far),
    case("two-walls", "walls a millionth apart", &["textbook/sequential"], planes::two_walls),
    case(
        "flat-floor",
        "a floor without thickness",
        &["textbook/sequential", "textbook/inside", "textbook/sign"],
        planes::flat_floor,
    ),
    case(
        "lattice-corners",
        "diagonals through the corners of cells",
        &["textbook/ropes"],
        planes::lattice_corners,
    ),
    case(
        "slabs",
        "10,000 parallel triangles, the last is hit",
        &["textbook/ropes", "textbook/sequential"],
        planes::slabs,
    ),
    case("slivers", "triangles a million times longer than wide", PLACES, crowds::slivers),
    case("hair", "long diagonal sticks", PLACES, crowds::hair),
    case("identical", "the same triangle 3000 times", &[], crowds::identical),
    case("one-vertex", "3000 random triangles that share a vertex", &["moeller"], crowds::one_vertex),
    case("degenerate", "points, segments and lines for triangles", &[], crowds::degenerate),
    case(
        "flat-seam",
        "from inside a cube at a T-junction that a triangle without area closes",
        ROUNDED,
        edges::flat_seam,
    ),
    case("tiny", "1e-12 and 1e-20 large, and by powers of two", &["moeller"], sizes::tiny),
    case("huge", "1e13 and 1e19 large, and by powers of two", &["moeller"], sizes::huge),
    case("stadium", "a teapot in a stadium", &["moeller"], crowds::stadium),
    case("translated", "a sphere moved by 1e2, 1e4 and 1e6", EDGES, edges::translated),
    case("no-rays", "NaN, infinities, zero directions", &[], sizes::no_rays),
    case("denormal-mesh", "coordinates around 1e-40", &["moeller"], sizes::denormal_mesh),
    case("denormal-rays", "subnormal numbers in rays count as 0", &[], sizes::denormal_rays),
    case("on-split", "hits where triangles cross splitting planes", &["textbook/inside"], planes::on_split),
    case(
        "coplanar",
        "overlapping triangles in one plane: the lowest number",
        &["baldwin", "textbook/origin"],
        planes::coplanar,
    ),
    case("symmetries", "scaled, mirrored, turned, renumbered: the same hits", EDGES, sizes::symmetries),
    case("instances", "spheres far from the origin, from inside at edges", EDGES, edges::instances),
    case("nearly-parallel", "rays that graze triangles", &["moeller", "woop"], edges::nearly_parallel),
    case("silhouettes", "1 to 4 ULP outside of silhouettes", &["moeller"], edges::silhouettes),
];

const fn case(
    name: &'static str,
    about: &'static str,
    known: &'static [&'static str],
    make: fn(&mut Random, usize) -> Vec<Part>,
) -> Case {
    Case { name, about, known, make }
}

fn part(name: impl Into<String>, mesh: Mesh, rays: Vec<Ray>, rule: Rule) -> Part {
    Part { name: name.into(), mesh, rays, rule }
}

fn whole(n: usize, r: &mut Random) -> f32 {
    r.below(n) as f32
}

fn mix(a: Point, b: Point, s: f32) -> Point {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * s)
}

fn aim(from: Point, at: Point) -> Ray {
    Ray::new(from, [0, 1, 2].map(|i| at[i] - from[i]))
}

/// `n` of something.
fn many<T>(n: usize, make: impl FnMut() -> T) -> Vec<T> {
    std::iter::repeat_with(make).take(n).collect()
}

fn corners(mesh: &Mesh, r: &mut Random) -> [Point; 3] {
    mesh.triangles()[r.below(mesh.triangles().len())].map(|v| mesh.positions()[v as usize])
}

/// A point of an edge, in one case of four a vertex.
fn seam(mesh: &Mesh, r: &mut Random) -> Point {
    let [a, b, _] = corners(mesh, r);
    if r.below(4) == 0 { a } else { mix(a, b, r.unit() as f32) }
}

/// A point inside a triangle.
fn inside([a, b, c]: [Point; 3], r: &mut Random) -> Point {
    let (s, t) = (r.unit() as f32, r.unit() as f32);
    mix(mix(a, b, s), c, t * 0.5)
}

/// A soup of triangles in the cube from -1 to 1.
fn soup(n: usize, r: &mut Random) -> Mesh {
    loose(&many(n, || {
        let size = if r.below(10) == 0 { 1.0 } else { 0.15 };
        let a = r.point();
        [a, r.near(a, size), r.near(a, size)]
    }))
}

/// Rays from around a soup at its triangles, edges and vertices.
fn at_soup(mesh: &Mesh, n: usize, r: &mut Random) -> Vec<Ray> {
    many(n, || {
        let from = r.point().map(|x| x * 2.0);
        let target = if r.below(2) == 0 { seam(mesh, r) } else { inside(corners(mesh, r), r) };
        aim(from, target)
    })
}

fn scaled(rays: &[Ray], k: f32) -> Vec<Ray> {
    rays.iter().map(|ray| Ray { origin: ray.origin.map(|x| x * k), ..*ray }).collect()
}
