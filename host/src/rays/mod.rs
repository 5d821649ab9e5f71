//! Rays to trace: random lines through a scene, a camera's image, bounces and shadows from what it saw.
//!
//! All are made by `+ - * / sqrt` from a fixed seed, so they are the same on every machine. They are made in `f32`, in
//! the mesh's own coordinates; where those have more digits than that, make them for the mesh as
//! [`Mesh::into_local`] gives it, and trace them there.

#[doc(hidden)]
pub mod sets;
mod wide;

#[doc(hidden)]
pub use crate::random::Random;
pub use wide::{AnyPoint, AnyRay, Ray64};

use crate::{
    Hit, Mesh, Ray,
    vector::{V, add, cross, dot, mul, narrow, normalize, sub, wide},
};
use std::ops::Range;

/// Centre and half diagonal of a box.
fn ball_around((lo, hi): ([f32; 3], [f32; 3])) -> (V, f64) {
    let centre = mul(add(wide(lo), wide(hi)), 0.5);
    let half = mul(sub(wide(hi), wide(lo)), 0.5);
    (centre, dot(half, half).sqrt())
}

/// The corners of a box.
fn corners((lo, hi): ([f32; 3], [f32; 3])) -> [[f32; 3]; 8] {
    [0, 1, 2, 3, 4, 5, 6, 7].map(|i| [0, 1, 2].map(|a| if i >> a & 1 == 0 { lo[a] } else { hi[a] }))
}

/// The rays of the travel table in Meng Zhou, *Build and Travel KD-Tree with CUDA*: from the sphere around the box to
/// uniform points of the box. Directions have unit length.
pub fn random(bounds: ([f32; 3], [f32; 3]), count: usize, seed: u64) -> Vec<Ray> {
    let (centre, radius) = ball_around(bounds);
    let (lo, hi) = (wide(bounds.0), wide(bounds.1));
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let from = add(centre, mul(random.sphere(), radius));
            let to = [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * random.unit());
            Ray::new(narrow(from), narrow(normalize(sub(to, from))))
        })
        .collect()
}

/// A pinhole camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Its position, in the mesh's units.
    pub eye: [f64; 3],
    /// The point that it looks at.
    pub target: [f64; 3],
    /// Which way is up, of any length.
    pub up: [f64; 3],
    /// Vertical field of view in degrees.
    pub fov: f64,
}

impl Camera {
    /// A camera that sees the whole box from the front, the right and a little above (y is up), and fills a
    /// square picture with it.
    pub fn framing(bounds: ([f32; 3], [f32; 3])) -> Self {
        let (centre, _) = ball_around(bounds);
        let eye = add(centre, [0.32, 0.23, 0.92]);
        Self { eye, target: centre, up: [0.0, 1.0, 0.0], fov: 40.0 }.fitted(corners(bounds), 1.0)
    }

    /// The camera moved, its direction kept, to where the points just fit a picture of `aspect` = width / height,
    /// but for a small margin.
    #[must_use]
    pub fn fitted(self, points: impl IntoIterator<Item = [f32; 3]>, aspect: f64) -> Self {
        const MARGIN: f64 = 1.04;
        let centre = self.target;
        let [right, up, forward] = self.frame();
        let tall = (self.fov.to_radians() * 0.5).tan() / MARGIN;
        let broad = tall * aspect;
        // Looking from `d` before the centre and `o` beside it, a point at (x, z) is in the picture if
        // |x - o| <= broad * (d + z): lower bounds of d that fall and rise with o, and meet in the middle.
        let mut least = [[f64::NEG_INFINITY; 2]; 2];
        let mut size = dot(centre, centre) * 1.0e-12;
        for point in points {
            let offset = sub(wide(point), centre);
            size = size.max(dot(offset, offset));
            let z = dot(forward, offset);
            for (least, (axis, slope)) in least.iter_mut().zip([(right, broad), (up, tall)]) {
                let x = dot(axis, offset) / slope;
                *least = [least[0].max(x - z), least[1].max(-x - z)];
            }
        }
        let [[r, l], [u, d]] = least;
        if r.is_infinite() {
            return self;
        }
        let shift = add(mul(right, broad * 0.5 * (r - l)), mul(up, tall * 0.5 * (u - d)));
        // Some distance even if all is one point.
        let distance = (0.5 * (r + l)).max(0.5 * (u + d)).max(1.0e-3 * size.sqrt()).max(1.0e-37);
        let target = add(centre, shift);
        Self { eye: sub(target, mul(forward, distance)), target, ..self }
    }

    /// Unit vectors to the right, up and forward.
    pub fn frame(&self) -> [[f64; 3]; 3] {
        let forward = normalize(sub(self.target, self.eye));
        let across = |up: V| Some(cross(forward, normalize(up))).filter(|r| dot(*r, *r) > 1e-12);
        // Looking straight up or down, any other direction serves as "up".
        let right = across(self.up).or_else(|| across([0.0, 0.0, 1.0])).or_else(|| across([1.0, 0.0, 0.0]));
        let right = normalize(right.unwrap_or([1.0, 0.0, 0.0]));
        [right, cross(right, forward), forward]
    }

    /// One ray a pixel centre, row by row from the top left, with a direction of unit length.
    pub fn rays(&self, width: u32, height: u32) -> Vec<Ray> {
        self.rows(width, height, 0..height)
    }

    /// Some rows of [`Camera::rays`], counted from the top.
    pub fn rows(&self, width: u32, height: u32, rows: Range<u32>) -> Vec<Ray> {
        let [right, up, forward] = self.frame();
        let tall = (self.fov.to_radians() * 0.5).tan();
        let broad = tall * f64::from(width) / f64::from(height);
        let origin = narrow(self.eye);
        let pixel = |x: u32, y: u32| {
            let across = ((f64::from(x) + 0.5) / f64::from(width) * 2.0 - 1.0) * broad;
            let down = (1.0 - (f64::from(y) + 0.5) / f64::from(height) * 2.0) * tall;
            let direction = add(forward, add(mul(right, across), mul(up, down)));
            Ray::new(origin, narrow(normalize(direction)))
        };
        rows.flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
    }
}

/// The unit normal of the triangle hit, on the side that the ray came from: to shade, and for [`offset_origin`]. None
/// if the hit is a miss, or of a triangle that the mesh does not have.
pub fn facing_normal(mesh: &Mesh, ray: &Ray, hit: &Hit) -> Option<[f32; 3]> {
    facing(mesh, ray, hit).map(narrow)
}

/// The same before it is rounded.
pub(crate) fn facing(mesh: &Mesh, ray: &Ray, hit: &Hit) -> Option<V> {
    let triangle = mesh.triangles().get(hit.triangle as usize)?;
    let [a, b, c] = triangle.map(|i| wide(mesh.positions()[i as usize]));
    let normal = normalize(cross(sub(b, a), sub(c, a)));
    Some(if dot(normal, wide(ray.direction)) > 0.0 { mul(normal, -1.0) } else { normal })
}

/// The origin for a ray that leaves a surface: the point moved to the side that the unit normal points to, far
/// enough to be off the surface if the point is a hit rounded to `f32` (Wächter & Binder 2019, "A fast and robust
/// method for avoiding self-intersection", Ray Tracing Gems, chapter 6).
///
/// Coordinates move by up to 256 of their units in the last place, those below 1/32 in size by up to 2^-16: so the
/// point's size must come from where it is, as in scenes of size 1 and more, not from far larger terms that cancelled.
/// What lies nearer than that to the surface is passed over; [`Scene::trace_except`](crate::Scene::trace_except)
/// does not.
pub fn offset_origin(point: [f32; 3], normal: [f32; 3]) -> [f32; 3] {
    const NEAR_ZERO: f32 = 1.0 / 32.0;
    [0, 1, 2].map(|axis| {
        let (p, n) = (point[axis], normal[axis]);
        if p.abs() < NEAR_ZERO {
            return p + n * (1.0 / 65_536.0);
        }
        let units = (n * 256.0) as i32;
        // Bits rise with the size of a number, so away from zero is up for either sign.
        let units = if p < 0.0 { -units } else { units };
        f32::from_bits(p.to_bits().wrapping_add_signed(units))
    })
}

/// Where a ray met the mesh, lifted off the surface towards the ray's origin, and the facing normal.
fn surface(mesh: &Mesh, ray: &Ray, hit: &Hit, lift: f64) -> (V, V) {
    let normal = facing(mesh, ray, hit).expect("a hit of this mesh");
    let point = add(wide(ray.origin), mul(wide(ray.direction), f64::from(hit.t)));
    (add(point, mul(normal, lift)), normal)
}

/// One cosine-distributed bounce from every hit, always the same ones for a seed: to measure with. Rays that miss have
/// none, so there may be fewer than `rays`; they come in the same order.
///
/// # Panics
/// There are not as many hits as rays, or a hit is of another mesh.
pub fn bounces(mesh: &Mesh, rays: &[Ray], hits: &[Hit], seed: u64) -> Vec<Ray> {
    let lift = ball_around(mesh.bounds()).1 * 2.0e-5;
    let mut random = Random::new(seed);
    assert_eq!(rays.len(), hits.len(), "one hit a ray");
    let seen = rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit());
    seen.map(|(ray, hit)| {
        let (point, normal) = surface(mesh, ray, hit, lift);
        // A point on the sphere that touches the surface is cosine-distributed around the normal.
        Ray::new(narrow(point), narrow(normalize(add(normal, mul(random.sphere(), 0.999_999)))))
    })
    .collect()
}

/// A shadow ray from every hit to a random point of a ball around `light`, ending just short of it, always the same
/// ones for a seed. Rays that miss have none, so there may be fewer than `rays`; they come in the same order.
///
/// # Panics
/// There are not as many hits as rays, or a hit is of another mesh.
pub fn shadows(mesh: &Mesh, rays: &[Ray], hits: &[Hit], light: [f64; 3], radius: f64, seed: u64) -> Vec<Ray> {
    let lift = ball_around(mesh.bounds()).1 * 2.0e-5;
    let mut random = Random::new(seed);
    assert_eq!(rays.len(), hits.len(), "one hit a ray");
    let seen = rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit());
    seen.map(|(ray, hit)| {
        let (point, _) = surface(mesh, ray, hit, lift);
        let to = sub(add(light, mul(random.ball(), radius)), point);
        Ray { t_max: 0.9999, ..Ray::new(narrow(point), narrow(to)) }
    })
    .collect()
}

/// A light above and in front of a box: its centre and radius.
#[doc(hidden)]
pub fn light(bounds: ([f32; 3], [f32; 3])) -> ([f64; 3], f64) {
    let (centre, radius) = ball_around(bounds);
    (add(centre, mul(normalize([-0.45, 0.75, 0.5]), 2.0 * radius)), radius * 0.15)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the box's corners appear in the picture: -1 to 1 both ways if inside.
    fn extent(camera: &Camera, bounds: ([f32; 3], [f32; 3]), aspect: f64) -> [[f64; 2]; 2] {
        let [right, up, forward] = camera.frame();
        let tall = (camera.fov.to_radians() * 0.5).tan();
        let mut extent = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for point in corners(bounds) {
            let offset = sub(wide(point), camera.eye);
            let depth = dot(forward, offset);
            assert!(depth > 0.0);
            for (range, x) in extent
                .iter_mut()
                .zip([dot(right, offset) / (depth * tall * aspect), dot(up, offset) / (depth * tall)])
            {
                *range = [range[0].min(x), range[1].max(x)];
            }
        }
        extent
    }

    #[test]
    fn framing_fills_the_picture() {
        let boxes = [
            ([-16.0, -8.0, -10.0], [16.0, 8.0, 10.0]),
            ([1.0, 2.0, 3.0], [1.5, 9.0, 3.1]),
            ([-1e18, -2e18, -1e15], [1e18, 1e16, 1e18]),
            ([-1e-34, 0.0, -1e-35], [1e-34, 1e-35, 2e-34]),
            ([100.0; 3], [100.001; 3]),
        ];
        for bounds in boxes {
            for aspect in [1.0, 16.0 / 9.0, 0.25] {
                let camera = Camera::framing(bounds).fitted(corners(bounds), aspect);
                let [x, y] = extent(&camera, bounds, aspect);
                let spans = [x, y].map(|[low, high]| high - low);
                assert!(x[0] >= -1.0 && y[0] >= -1.0 && x[1] <= 1.0 && y[1] <= 1.0, "{x:?} {y:?}");
                assert!(spans[0].max(spans[1]) > 1.85, "{bounds:?} {aspect}: {spans:?}");
            }
        }
    }

    #[test]
    fn framing_of_a_point_looks_at_it() {
        for point in [[0.0; 3], [5.0, -7.0, 1e6]] {
            let camera = Camera::framing((point, point));
            assert_ne!(camera.eye, camera.target);
            assert_eq!(camera.target, wide(point));
        }
    }

    #[test]
    fn straight_down_has_a_frame() {
        let camera = Camera { eye: [0.0, 5.0, 0.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 40.0 };
        for axis in camera.frame() {
            assert!((dot(axis, axis) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn rows_are_part_of_the_picture() {
        let camera = Camera::framing(([0.0; 3], [1.0; 3]));
        assert_eq!(camera.rows(8, 6, 2..5), camera.rays(8, 6)[16..40]);
    }
}
