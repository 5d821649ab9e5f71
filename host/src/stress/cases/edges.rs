//! Edges, vertices and silhouettes, and rays that leave or graze a surface.

use super::*;

pub(super) fn icosphere_edges(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = icosphere(3);
    let rays = many(n, || aim(r.point().map(|x| x * 0.5), seam(&mesh, r)));
    vec![part("", mesh, rays, Rule::Hits)]
}

pub(super) fn fan_hub(r: &mut Random, n: usize) -> Vec<Part> {
    let hub = [0.1, 0.2, 0.3];
    let rim = |i: usize| {
        let angle = (i % 1000) as f32 * (std::f32::consts::TAU / 1000.0);
        [angle.cos(), angle.sin(), 0.0]
    };
    let mesh = loose(&(0..1000).map(|i| [hub, rim(i), rim(i + 1)]).collect::<Vec<_>>());
    let rays = many(n, || {
        let [x, y, z] = r.point();
        aim([x * 0.5, y * 0.5, z * 0.5 + 2.0], hub)
    });
    vec![part("", mesh, rays, Rule::Hits)]
}

/// A cube of which one face has a vertex more on its diagonal than the triangle on the other side of it: what is left
/// is a triangle without area, so that every edge still has two triangles.
pub(super) fn flat_seam(r: &mut Random, n: usize) -> Vec<Part> {
    let corner = |i: u32| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32].map(|x| x * 2.0 - 1.0);
    let middle = [0.25, 0.25, -1.0];
    let mut mesh = Welded::default();
    for [a, b, c, d] in [[4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        mesh.triangle([a, b, c].map(corner));
        mesh.triangle([a, c, d].map(corner));
    }
    let [a, b, c, d] = [0, 1, 3, 2].map(corner);
    [[a, b, middle], [b, c, middle], [a, middle, c], [a, c, d]].into_iter().for_each(|t| mesh.triangle(t));
    let mesh = mesh.mesh();
    let rays = many(n, || aim(r.point().map(|x| x * 0.5), mix(a, c, r.unit() as f32)));
    vec![part("", mesh, rays, Rule::Hits)]
}

/// A point seen from the middle, computed as a renderer does: rounded, it is not on the surface.
pub(super) fn leaving(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = icosphere(3);
    let (mut rays, mut from) = (Vec::new(), Vec::new());
    while rays.len() < n {
        let triangle = r.below(mesh.triangles().len());
        let [a, b, c] = mesh.triangles()[triangle].map(|v| mesh.positions()[v as usize]);
        let origin = inside([a, b, c], r);
        let to = seam(&mesh, r);
        // Well away from the triangle it leaves.
        if (0..3).map(|i| origin[i] * to[i]).sum::<f32>() < 0.0 {
            rays.push(aim(origin, to));
            from.push(triangle as u32);
        }
    }
    vec![part("", mesh, rays, Rule::Leaves(from))]
}

/// After Wächter & Binder 2019.
pub(super) fn leaving_offset(r: &mut Random, n: usize) -> Vec<Part> {
    let mut parts = leaving(r, n);
    for Part { name, mesh, rays, rule } in &mut parts {
        "by offset_origin".clone_into(name);
        let Rule::Leaves(from) = rule else { continue };
        for (ray, &triangle) in rays.iter_mut().zip(from.iter()) {
            let hit = Hit { triangle, t: 0.0, u: 0.0, v: 0.0 };
            // The side that the ray leaves by is where it would have come from.
            let back = Ray { direction: ray.direction.map(|d| -d), ..*ray };
            let normal = facing_normal(mesh, &back, &hit).expect("a triangle of this mesh");
            ray.origin = offset_origin(ray.origin, normal);
        }
    }
    parts
}

pub(super) fn translated(r: &mut Random, n: usize) -> Vec<Part> {
    let sphere = icosphere(3);
    [1.0e2f32, 1.0e4, 1.0e6]
        .map(|by| {
            let mesh = moved(&sphere, |p| p.map(|x| x + by));
            let rays = many(n / 3, || aim(r.point().map(|x| by + x * 0.5), seam(&mesh, r)));
            part(format!("{by:e}"), mesh, rays, Rule::Hits)
        })
        .into()
}

pub(super) fn instances(r: &mut Random, n: usize) -> Vec<Part> {
    let sphere = icosphere(1);
    let offsets = many(8, || r.point().map(|x| x * 1.0e5));
    let mut mesh = Welded::default();
    for offset in &offsets {
        for t in sphere.triangles() {
            mesh.triangle(t.map(|v| [0, 1, 2].map(|i| sphere.positions()[v as usize][i] * 3.0 + offset[i])));
        }
    }
    let mesh = mesh.mesh();
    let each = sphere.triangles().len();
    let rays = many(n, || {
        let which = r.below(offsets.len());
        let [a, b, _] = mesh.triangles()[which * each + r.below(each)].map(|v| mesh.positions()[v as usize]);
        let from = [0, 1, 2].map(|i| offsets[which][i] + r.signed());
        aim(from, mix(a, b, r.unit() as f32))
    });
    vec![part("", mesh, rays, Rule::Hits)]
}

pub(super) fn nearly_parallel(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = soup(200, r);
    let rays = many(n, || {
        let triangle = corners(&mesh, r);
        let (p, q) = (inside(triangle, r), inside(triangle, r));
        let from = mix(p, q, -20.0 * r.unit() as f32 - 1.0);
        let size = 10f32.powf(-3.0 - 5.0 * r.unit() as f32);
        aim(from, r.near(q, size))
    });
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn silhouettes(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = icosphere(1);
    let mut rays = Vec::new();
    while rays.len() < n {
        let from = r.point().map(|x| x * 6.0);
        let p = seam(&mesh, r);
        // On a sphere the silhouette is near where the line of sight is a tangent.
        let [to, across]: [f32; 2] =
            [0, 1].map(|k| (0..3).map(|i| if k == 0 { p[i] * from[i] } else { p[i] * p[i] }).sum());
        if (to - across).abs() < 0.2 * across {
            let out =
                p.map(|x| (0..=r.below(4)).fold(x, |x, _| if x > 0.0 { x.next_up() } else { x.next_down() }));
            rays.push(aim(from, out));
        }
    }
    vec![part("", mesh, rays, Rule::Rounding)]
}
