//! Numbers at the ends of their range, and the same scene in other forms.

use super::*;

/// A soup, the same by two powers of two, and by two powers of ten.
fn sizes(r: &mut Random, n: usize, powers: [i32; 2], decimals: [f32; 2]) -> Vec<Part> {
    let mesh = soup(200, r);
    let rays = at_soup(&mesh, n / 5, r);
    let sized = |k: f32| moved(&mesh, |p| p.map(|x| x * k));
    let mut parts = vec![part("1", mesh.clone(), rays.clone(), Rule::Rounding)];
    for k in powers {
        let t = 2f32.powi(k);
        let as_before = Rule::As { of: 0, t, triangles: None };
        parts.push(part(format!("2^{k}"), sized(t), scaled(&rays, t), as_before));
    }
    for k in decimals {
        let larger = sized(k);
        let rays = rays.iter().map(|ray| Ray {
            origin: ray.origin.map(|x| x * k),
            direction: ray.direction.map(|x| x * k),
            ..*ray
        });
        let rays = rays.collect();
        parts.push(part(format!("{k:e}"), larger, rays, Rule::Rounding));
    }
    parts
}

pub(super) fn tiny(r: &mut Random, n: usize) -> Vec<Part> {
    sizes(r, n, [-40, -66], [1.0e-12, 1.0e-20])
}

pub(super) fn huge(r: &mut Random, n: usize) -> Vec<Part> {
    sizes(r, n, [43, 63], [1.0e13, 1.0e19])
}

pub(super) fn far(r: &mut Random, n: usize) -> Vec<Part> {
    let mut parts = Vec::new();
    for (distance, size) in [(256.0f32, 1.0f32), (1.0e4, 1.0), (1.0e6, 100.0)] {
        let mesh = moved(&icosphere(2), |p| p.map(|x| x * size));
        let rays = many(n / 3, || {
            let p = r.point();
            let length = p.iter().map(|x| x * x).sum::<f32>().sqrt().max(0.1);
            let from = p.map(|x| x / length * distance);
            let ray = aim(from, r.point().map(|x| x * size * 0.5));
            Ray { direction: ray.direction.map(|x| x / distance), ..ray }
        });
        parts.push(part(format!("{distance}"), mesh, rays, Rule::Hits));
    }
    parts
}

pub(super) fn no_rays(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = soup(100, r);
    let rays = many(n, || {
        let mut ray = aim(r.point(), r.point());
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN][r.below(4)];
        let axis = r.below(3);
        match r.below(5) {
            0 => ray.origin[axis] = odd,
            1 => ray.direction[axis] = odd,
            2 => ray.direction = [0.0, -0.0, 0.0],
            3 => ray.t_min = f32::NAN,
            _ => ray.t_max = f32::NAN,
        }
        ray
    });
    let none = vec![MISS; rays.len()];
    vec![part("", mesh, rays, Rule::Known(none))]
}

pub(super) fn denormal_mesh(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = moved(&soup(200, r), |p| p.map(|x| x * 1.0e-40));
    // Subnormal numbers in rays count as 0: they start at larger ones.
    let rays = many(n, || {
        let target = inside(corners(&mesh, r), r);
        let from = r.point().map(|x| if x < 0.0 { -2.0e-38 } else { 2.0e-38 } * (1.0 + x.abs()));
        Ray::new(from, [0, 1, 2].map(|i| (target[i] - from[i]) * 1.0e18))
    });
    vec![part("", mesh, rays, Rule::Rounding)]
}

pub(super) fn denormal_rays(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = soup(200, r);
    let odd = |r: &mut Random| f32::from_bits(r.below(1 << 23) as u32) * [1.0, -1.0][r.below(2)];
    let rays: Vec<Ray> = many(n / 2, || {
        let mut ray = at_soup(&mesh, 1, r)[0];
        let axis = r.below(3);
        match r.below(4) {
            0 => ray.origin[axis] = odd(r),
            1 => ray.direction[axis] = odd(r),
            2 => ray.t_min = odd(r),
            _ => ray.direction = [odd(r), odd(r), odd(r)],
        }
        ray
    });
    let settled: Vec<Ray> = rays.iter().map(crate::stress::settled).collect();
    vec![
        part("as 0", mesh.clone(), settled, Rule::Rounding),
        part("subnormal", mesh, rays, Rule::As { of: 0, t: 1.0, triangles: None }),
    ]
}

pub(super) fn symmetries(r: &mut Random, n: usize) -> Vec<Part> {
    let mesh = soup(300, r);
    let rays = at_soup(&mesh, n / 5, r);
    let through = |ray: &Ray, f: &dyn Fn(Point) -> Point| Ray {
        origin: f(ray.origin),
        direction: f(ray.direction),
        ..*ray
    };
    let same = |name: &str, f: &dyn Fn(Point) -> Point| {
        let rays = rays.iter().map(|ray| through(ray, f)).collect();
        part(name, moved(&mesh, f), rays, Rule::As { of: 0, t: 1.0, triangles: None })
    };
    let mut parts = vec![
        part("soup", mesh.clone(), rays.clone(), Rule::Rounding),
        same("times 2^30", &|p| p.map(|x| x * 2f32.powi(30))),
        same("mirrored", &|[x, y, z]| [x, -y, z]),
        same("axes turned", &|[x, y, z]| [y, z, x]),
        same("axes exchanged", &|[x, y, z]| [y, x, z]),
    ];
    let mut order: Vec<u32> = (0..mesh.triangles().len() as u32).collect();
    for i in 0..order.len() {
        let j = i + r.below(order.len() - i);
        order.swap(i, j);
    }
    let triangles = order.iter().map(|&t| mesh.triangles()[t as usize]).collect();
    let shuffled = Mesh::new(mesh.positions().to_vec(), triangles).expect("the same triangles");
    parts.push(part("renumbered", shuffled, rays, Rule::As { of: 0, t: 1.0, triangles: Some(order) }));
    parts
}
