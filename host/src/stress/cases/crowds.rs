//! Triangles that a tree does not part: thin, many in one place, or none at all.

use super::*;

pub(super) fn slivers(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = loose(&many(300, || {
        let (a, b) = (r.point(), r.point());
        [a, b, r.near(b, 1.0e-6)]
    }));
    let rays = at_soup(&mesh, n, r);
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn hair(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = loose(&many(400, || {
        let a = r.point().map(|x| x * 0.3);
        let b = a.map(|x| x + 1.0);
        [a, b, r.near(b, 1.0e-2)]
    }));
    let rays = at_soup(&mesh, n, r);
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn identical(r: &mut Random, n: usize) -> Vec<Part> {
    let one = [[0.1, -0.7, 0.2], [0.9, 0.3, -0.4], [-0.6, 0.5, 0.7]];
    let mesh = loose(&vec![one; 3000]);
    let rays = many(n / 4, || aim(r.point().map(|x| x + 2.0), mix(inside(one, r), [0.13, 0.03, 0.17], 0.1)));
    let ids = vec![0; rays.len()];
    vec![part("", mesh, rays, Rule::Known(ids))]
}

pub(super) fn one_vertex(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = loose(&many(3000, || [[0.25, 0.5, -0.125], r.point(), r.point()]));
    let rays = at_soup(&mesh, n / 4, r);
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn degenerate(r: &mut Random, n: usize) -> Vec<Part> {
    let p = [1.0, 2.0, 3.0];
    let line = |r: &mut Random| {
        let (a, d) = ([(); 3].map(|()| whole(9, r)), [(); 3].map(|()| whole(3, r)));
        [a, [0, 1, 2].map(|k| a[k] + d[k]), [0, 1, 2].map(|k| a[k] + 2.0 * d[k])]
    };
    let meshes = [
        ("a point", loose(&[[p; 3]; 40])),
        ("a segment", loose(&[[p, [2.0, 2.0, 3.0], [5.0, 2.0, 3.0]]; 40])),
        ("lines", loose(&many(300, || line(r)))),
    ];
    let make = |(name, mesh): (&str, Mesh)| {
        let rays = many(n / 3, || {
            let from = r.point().map(|x| 10.0 * x);
            aim(from, seam(&mesh, r))
        });
        let none = vec![MISS; rays.len()];
        part(name, mesh, rays, Rule::Known(none))
    };
    meshes.into_iter().map(make).collect()
}

pub(super) fn stadium(r: &mut Random, n: usize) -> Vec<Part> {
    let teapot = Mesh::teapot(2);
    let small = |i: u32| teapot.positions()[i as usize].map(|x| x * 1.0e-4);
    let mut triangles: Vec<[Point; 3]> = teapot.triangles().iter().map(|t| t.map(small)).collect();
    triangles
        .extend(many(8, || [r.point().map(|x| x * 1.0e6), r.point().map(|x| x * 1.0e6), [0.0, -1.0e6, 0.0]]));
    let rays = many(n, || {
        let near = r.below(2) == 0;
        let from = r.point().map(|x| x * if near { 0.01 } else { 1.0e6 });
        let triangle = triangles[r.below(triangles.len())];
        aim(from, inside(triangle, r))
    });
    vec![part("", loose(&triangles), rays, Rule::Rounding)]
}
