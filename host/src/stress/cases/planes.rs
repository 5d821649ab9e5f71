//! Splitting planes, and triangles and rays that lie in them.

use super::*;

/// A ray of which all arithmetic is exact at a lattice: from half-integers, along axes or diagonals.
fn lattice_ray(side: usize, r: &mut Random) -> Ray {
    let origin = [(); 3].map(|()| whole(2 * side + 8, r) * 0.5 - 2.0);
    loop {
        let direction = [(); 3].map(|()| [-1.0, 0.0, 1.0][r.below(3)]);
        if direction != [0.0; 3] {
            return Ray::new(origin, direction);
        }
    }
}

pub(super) fn lattice_cubes(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = cubes(60, r).mesh();
    let rays = many(n, || lattice_ray(5, r));
    vec![part("", mesh, rays, Rule::Exact)]
}

/// Rays in planes of cubes' faces, at half-integers along the way.
fn plane_rays(n: usize, r: &mut Random) -> Vec<Ray> {
    many(n, || {
        let axis = r.below(3);
        let mut origin = [(); 3].map(|()| whole(28, r) * 0.25 - 1.0);
        origin[axis] = whole(6, r);
        let mut direction = r.point();
        direction[axis] = 0.0;
        if r.below(2) == 0 {
            direction[(axis + 1) % 3] = 0.0;
        }
        Ray::new(origin, direction)
    })
}

pub(super) fn in_plane(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = cubes(60, r).mesh();
    let rays = plane_rays(n, r);
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn signed_zeros(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = cubes(60, r).mesh();
    let rays = plane_rays(n / 2, r);
    let negative = |x: f32| if x == 0.0 { -0.0 } else { x };
    let other = rays.iter().map(|ray| Ray { direction: ray.direction.map(negative), ..*ray }).collect();
    vec![
        part("+0", mesh.clone(), rays, Rule::Rounding),
        part("-0", mesh, other, Rule::As { of: 0, t: 1.0, triangles: None }),
    ]
}

/// Axis and place of the planes of a tree that raykd builds.
fn planes(mesh: &Mesh) -> Vec<(usize, f32)> {
    let device = Device::cpu();
    let scene = Scene::build(&device, mesh, &BuildOptions::default()).expect("a CPU builds small meshes");
    let tree = scene.tree().expect("it is there");
    let scale = tree.view().header.scale;
    let plane = |content| match content {
        Content::Inner { axis, split, .. } => Some((axis as usize, split / scale)),
        Content::Leaf { .. } => None,
    };
    tree.view().nodes.iter().filter_map(|node| plane(node.content())).collect()
}

pub(super) fn origin_on_plane(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = soup(400, r);
    let planes = planes(&mesh);
    let rays = many(n, || {
        let (axis, at) = planes[r.below(planes.len())];
        let target = inside(corners(&mesh, r), r);
        let mut origin = r.near(target, 0.3);
        origin[axis] = at;
        aim(origin, inside(corners(&mesh, r), r))
    });
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn on_split(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = loose(&many(300, || {
        let a = r.point();
        [a, r.near(a, 0.4), r.near(a, 0.4)]
    }));
    let planes = planes(&mesh);
    let mut rays = Vec::new();
    while rays.len() < n {
        let (axis, at) = planes[r.below(planes.len())];
        let triangle = corners(&mesh, r);
        let (p, q) = (inside(triangle, r), inside(triangle, r));
        let s = (at - p[axis]) / (q[axis] - p[axis]);
        if (0.0..=1.0).contains(&s) {
            let mut target = mix(p, q, s);
            target[axis] = at;
            rays.push(aim(r.point().map(|x| x * 3.0), target));
        }
    }
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn coplanar(r: &mut Random, n: usize) -> Vec<Part> {
    let mut flat = || [(); 3].map(|()| [whole(9, r), whole(9, r), 2.0]);
    let mesh = loose(&many(60, &mut flat));
    let rays = many(n, || {
        let [x, y] = [(); 2].map(|()| whole(18, r) * 0.5);
        Ray::new([x, y, 6.0], [[-1.0, 0.0, 1.0][r.below(3)], 0.0, -1.0])
    });
    vec![part("", mesh, rays, Rule::Exact)]
}

pub(super) fn lattice_corners(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = cubes(60, r).mesh();
    let rays = many(n, || {
        let direction = [(); 3].map(|()| [-1.0, 1.0][r.below(2)]);
        let through = [(); 3].map(|()| whole(6, r));
        Ray::new([0, 1, 2].map(|i| through[i] - 8.0 * direction[i]), direction)
    });
    vec![part("", mesh, rays, Rule::Exact)]
}

pub(super) fn flat_floor(r: &mut Random, n: usize) -> Vec<Part> {
    const SIDE: usize = 12;
    let mut mesh = Welded::default();
    for cell in 0..SIDE * SIDE {
        let at = |i: usize, j: usize| [(cell % SIDE + i) as f32, 0.0, (cell / SIDE + j) as f32];
        mesh.triangle([at(0, 0), at(1, 0), at(1, 1)]);
        mesh.triangle([at(0, 0), at(1, 1), at(0, 1)]);
    }
    let place = |r: &mut Random| 0.5 + (r.unit() * (SIDE as f64 - 1.0)) as f32;
    let rays = many(n, || {
        let (x, z) = (place(r), place(r));
        let oblique = [place(r), 0.0, place(r)];
        let from = [x, 1.0 + whole(9, r), z];
        if r.below(2) == 0 { Ray::new(from, [0.0, -1.0, 0.0]) } else { aim(from, oblique) }
    });
    vec![part("", mesh.mesh(), rays, Rule::Hits)]
}

pub(super) fn two_walls(r: &mut Random, n: usize) -> Vec<Part> {
    let wall = |x: f32| [[x, -1.0, -1.0], [x, 1.0, -1.0], [x, -1.0, 1.0]];
    let mesh = loose(&[wall(1.000_001), wall(1.0), wall(1.000_002), wall(3.0)]);
    let rays = many(n, || {
        Ray::new([-whole(4, r), -r.signed().abs() * 0.9, -r.signed().abs() * 0.9], [1.0, 0.0, 0.0])
    });
    let first = vec![1; rays.len()];
    vec![part("", mesh, rays, Rule::Known(first))]
}

pub(super) fn slabs(r: &mut Random, n: usize) -> Vec<Part> {
    const COUNT: u32 = 10_000;
    let slab = |z: f32| [[0.0, 0.0, z], [4.0, 0.0, z], [0.0, 4.0, z]];
    let mut slabs: Vec<_> = (0..COUNT).map(|i| slab(-(i as f32))).collect();
    let last = -(COUNT as f32);
    slabs.push([[-9.0, -9.0, last], [19.0, -9.0, last], [0.0, 19.0, last]]);
    // Inside the boxes, past the triangles.
    let rays = many(n.div_ceil(20), || {
        let (x, y) = (r.signed().abs(), r.signed().abs());
        Ray::new([3.9 - x, 3.9 - y * (1.8 - x).min(1.0), 2.0], [0.0, 0.0, -1.0])
    });
    let ids = vec![COUNT; rays.len()];
    vec![part("", loose(&slabs), rays, Rule::Known(ids))]
}
