//! Rays to trace: random lines through a scene, a camera's image, bounces and shadows from what it saw.
//!
//! All are made by `+ - * / sqrt` from a fixed seed, so they are the same on every machine.

use crate::{Hit, Mesh, Ray};

/// A small random number generator (SplitMix64, Steele, Lea & Flood 2014): the same numbers everywhere.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Starts a sequence.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in `0 <= x < 1`.
    pub const fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A point inside the unit ball.
    fn ball(&mut self) -> [f64; 3] {
        loop {
            let p = [(); 3].map(|()| self.unit() * 2.0 - 1.0);
            let length = dot(p, p);
            if length <= 1.0 && length > 1e-6 {
                return p;
            }
        }
    }

    /// A point on the unit sphere.
    fn sphere(&mut self) -> [f64; 3] {
        normalize(self.ball())
    }
}

type V = [f64; 3];

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn mul(a: V, s: f64) -> V {
    a.map(|x| x * s)
}
fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn normalize(a: V) -> V {
    let length = dot(a, a).sqrt();
    if length > 0.0 { mul(a, 1.0 / length) } else { [0.0, 1.0, 0.0] }
}
fn wide(a: [f32; 3]) -> V {
    a.map(f64::from)
}
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
fn narrow(a: V) -> [f32; 3] {
    a.map(|x| x as f32)
}

/// Centre and half diagonal of a box.
fn ball_around((lo, hi): ([f32; 3], [f32; 3])) -> (V, f64) {
    let centre = mul(add(wide(lo), wide(hi)), 0.5);
    let half = mul(sub(wide(hi), wide(lo)), 0.5);
    (centre, dot(half, half).sqrt())
}

/// The rays of the talk's travel table: from the sphere around the box to uniform points of the box.
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
    /// Where it is.
    pub eye: [f64; 3],
    /// What it looks at.
    pub target: [f64; 3],
    /// Which way is up.
    pub up: [f64; 3],
    /// Vertical field of view in degrees.
    pub fov: f64,
}

impl Camera {
    /// A camera that sees the whole box from the front, the right and a little above (y is up).
    pub fn framing(bounds: ([f32; 3], [f32; 3])) -> Self {
        let (centre, radius) = ball_around(bounds);
        let direction = normalize([0.32, 0.23, 0.92]);
        // The ball of the box fits a cone of this opening at this distance.
        let fov: f64 = 40.0;
        let distance = radius / (fov.to_radians() * 0.5).sin() * 0.92;
        Self {
            eye: add(centre, mul(direction, distance.max(f64::MIN_POSITIVE))),
            target: centre,
            up: [0.0, 1.0, 0.0],
            fov,
        }
    }

    /// One ray a pixel centre, row by row from the top left.
    pub fn rays(&self, width: u32, height: u32) -> Vec<Ray> {
        let forward = normalize(sub(self.target, self.eye));
        let mut right = cross(forward, self.up);
        if dot(right, right) < 1e-12 {
            right = cross(forward, [0.0, 0.0, 1.0]);
        }
        let right = normalize(right);
        let up = cross(right, forward);
        let tall = (self.fov.to_radians() * 0.5).tan();
        let broad = tall * f64::from(width) / f64::from(height);
        let origin = narrow(self.eye);
        let pixel = |x: u32, y: u32| {
            let across = ((f64::from(x) + 0.5) / f64::from(width) * 2.0 - 1.0) * broad;
            let down = (1.0 - (f64::from(y) + 0.5) / f64::from(height) * 2.0) * tall;
            let direction = add(forward, add(mul(right, across), mul(up, down)));
            Ray::new(origin, narrow(normalize(direction)))
        };
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
    }
}

/// Where a ray met the mesh, lifted off the surface towards the ray's origin, and the facing normal.
fn surface(mesh: &Mesh, ray: &Ray, hit: &Hit, lift: f64) -> (V, V) {
    let [a, b, c] = mesh.triangles()[hit.triangle as usize].map(|i| wide(mesh.positions()[i as usize]));
    let direction = wide(ray.direction);
    let mut normal = normalize(cross(sub(b, a), sub(c, a)));
    if dot(normal, direction) > 0.0 {
        normal = mul(normal, -1.0);
    }
    let point = add(wide(ray.origin), mul(direction, f64::from(hit.t)));
    (add(point, mul(normal, lift)), normal)
}

/// One cosine-distributed bounce from every hit.
pub fn bounces(mesh: &Mesh, rays: &[Ray], hits: &[Hit], seed: u64) -> Vec<Ray> {
    let lift = ball_around(mesh.bounds()).1 * 2.0e-5;
    let mut random = Random::new(seed);
    let seen = rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit());
    seen.map(|(ray, hit)| {
        let (point, normal) = surface(mesh, ray, hit, lift);
        // A point on the sphere that touches the surface is cosine-distributed around the normal.
        Ray::new(narrow(point), narrow(normalize(add(normal, mul(random.sphere(), 0.999_999)))))
    })
    .collect()
}

/// A shadow ray from every hit to a random point of a ball, ending just short of it.
pub fn shadows(mesh: &Mesh, rays: &[Ray], hits: &[Hit], light: [f64; 3], radius: f64, seed: u64) -> Vec<Ray> {
    let lift = ball_around(mesh.bounds()).1 * 2.0e-5;
    let mut random = Random::new(seed);
    let seen = rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit());
    seen.map(|(ray, hit)| {
        let (point, _) = surface(mesh, ray, hit, lift);
        let to = sub(add(light, mul(random.ball(), radius)), point);
        Ray { t_max: 0.9999, ..Ray::new(narrow(point), narrow(to)) }
    })
    .collect()
}

/// A light above and in front of a box: its centre and radius.
pub fn light(bounds: ([f32; 3], [f32; 3])) -> ([f64; 3], f64) {
    let (centre, radius) = ball_around(bounds);
    (add(centre, mul(normalize([-0.45, 0.75, 0.5]), 2.0 * radius)), radius * 0.15)
}
