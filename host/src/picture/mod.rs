//! Pictures of scenes, as the program and the page of `web` draw them.

mod colour;
mod legend;

use crate::{
    Error, Hit, Mesh, Query, Ray, Scene, Stepped, TraceTimes, Traced,
    choices::choices,
    exec::reserve,
    rays::{Camera, Random, bounces, facing},
    vector::{dot, sub},
};
pub use colour::{Rgb, encode, heat};
use colour::{add, mix, scale};
pub use legend::full_scale;
use std::ops::Range;

/// Most rays traced at a time.
const BAND_RAYS: u64 = 1 << 22;
/// Behind the mesh, in pictures that show numbers.
const NOTHING: Rgb = [0.004, 0.004, 0.006];

choices! {
    /// What colours show.
    pub enum Shading {
        /// Surfaces under a soft light
        Normal = "normal",
        /// Distance: near is bright
        Depth = "depth",
        /// Work per pixel: nodes visited and triangles tested
        Heat = "heat",
        /// A colour per triangle
        Id = "id",
        /// Ambient occlusion: how much of the sky each point sees
        Ao = "ao",
    }
    default = Normal;
    called = "shading";
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Red, green and blue of each pixel, row by row from the top left.
    pub rgb: Vec<u8>,
    /// Rays traced.
    pub rays: u64,
    /// Rays that hit something.
    pub hits: u64,
    /// Invalid rays, see [`Traced::invalid`].
    pub invalid: u64,
    /// What the rays took, without making them and painting what they hit.
    pub times: TraceTimes,
}

/// Renders a picture with `samples` by `samples` rays a pixel.
pub fn render(
    scene: &Scene,
    mesh: &Mesh,
    camera: &Camera,
    size: [u32; 2],
    samples: u32,
    shading: Shading,
) -> Result<Picture, Error> {
    render_while(scene, mesh, camera, size, samples, shading, || Ok(()))
}

/// Like [`render`], but whoever waits may end it between its parts, by an error of `go_on`.
pub fn render_while<E: From<Error>>(
    scene: &Scene,
    mesh: &Mesh,
    camera: &Camera,
    size: [u32; 2],
    samples: u32,
    shading: Shading,
    mut go_on: impl FnMut() -> Result<(), E>,
) -> Result<Picture, E> {
    let [width, height] = size;
    let band = (BAND_RAYS / u64::from(width * samples * samples)).clamp(1, height.into()) as u32;
    let (mut hits, mut invalid, mut times) = (0, 0, TraceTimes::default());
    // Steps of each pixel: only once all are known it is known what the brightest colour stands for.
    let mut heats: Vec<f32> = Vec::new();
    let mut rgb: Vec<u8> = Vec::new();
    let pixels = u64::from(width) * u64::from(height);
    reserve(&mut rgb, "picture", 3 * pixels)?;
    if shading == Shading::Heat {
        reserve(&mut heats, "steps", pixels)?;
    }
    for first in (0..height).step_by(band as usize) {
        let part = first..(first + band).min(height);
        let (seen, [hit, none], took) = rows(scene, mesh, camera, size, samples, shading, part)?;
        if shading == Shading::Heat {
            heats.extend(seen.iter().map(|pixel| pixel[0]));
        } else {
            rgb.extend(seen.into_iter().flat_map(encode));
        }
        hits += hit;
        invalid += none;
        times += took;
        go_on()?;
    }
    if shading == Shading::Heat {
        let full = full_scale(heats.iter().copied());
        rgb.extend(heats.iter().flat_map(|steps| encode(heat(steps / full))));
        legend::draw(&mut rgb, [width as usize, height as usize], full, "STEPS PER RAY");
    }
    let rays = pixels * u64::from(samples * samples);
    Ok(Picture { rgb, rays, hits, invalid, times })
}

/// What the pixels of some rows show, how many of their rays hit and how many were invalid, and what all rays took.
/// [`Shading::Heat`] has steps instead of light.
pub fn rows(
    scene: &Scene,
    mesh: &Mesh,
    camera: &Camera,
    [width, height]: [u32; 2],
    samples: u32,
    shading: Shading,
    rows: Range<u32>,
) -> Result<(Vec<Rgb>, [u64; 2], TraceTimes), Error> {
    let (across, down) = (width * samples, height * samples);
    let band = rows.start * samples..rows.end * samples;
    let rays = camera.rows(across, down, band.clone());
    let (hits, seen, invalid, times): (_, Vec<Rgb>, _, _) = if shading == Shading::Heat {
        let Stepped { hits, steps, times, invalid } = scene.steps(&rays)?;
        let seen = steps.iter().map(|s| [(s.inner + s.leaves + s.tests) as f32; 3]).collect();
        (hits, seen, invalid, times)
    } else if shading == Shading::Ao {
        let Traced { hits, mut times, invalid } = scene.trace(Query::Closest, &rays)?;
        let (seen, around) = sky(scene, mesh, &rays, &hits, band.start)?;
        times += around;
        (hits, seen, invalid, times)
    } else {
        let Traced { hits, times, invalid } = scene.trace(Query::Closest, &rays)?;
        let artist = Artist::new(mesh, camera, [across, down], shading);
        let row = |i: usize| band.start + (i / across as usize) as u32;
        let seen = (0..rays.len()).map(|i| artist.paint(&rays[i], &hits[i], row(i))).collect();
        (hits, seen, invalid, times)
    };
    let hit = hits.iter().filter(|hit| hit.is_hit()).count() as u64;
    Ok((means(&seen, across as usize, samples as usize), [hit, invalid], times))
}

/// Rays of ambient occlusion from every point seen.
const SKY_RAYS: u64 = 16;
/// Their length, in diagonals of the mesh: what is farther off does not darken.
const SKY_REACH: f64 = 0.2;

/// Rays along a pixel, if nothing is said.
pub fn samples_of(shading: Shading) -> u32 {
    if shading == Shading::Normal { 2 } else { 1 }
}

/// How many rays a picture of so many primary ones takes in all: of those about half hit what fills the picture.
pub const fn rays_of(shading: Shading, primary: u64) -> u64 {
    match shading {
        Shading::Ao => primary + primary / 2 * SKY_RAYS,
        Shading::Normal | Shading::Depth | Shading::Heat | Shading::Id => primary,
    }
}

/// The share of rays around each point's normal that get away, and what those took.
fn sky(
    scene: &Scene,
    mesh: &Mesh,
    rays: &[Ray],
    hits: &[Hit],
    seed: u32,
) -> Result<(Vec<Rgb>, TraceTimes), Error> {
    let mut times = TraceTimes::default();
    let (lo, hi) = mesh.bounds();
    let across = sub(hi.map(f64::from), lo.map(f64::from));
    let reach = (dot(across, across).sqrt() * SKY_REACH) as f32;
    let mut open = vec![0.0; hits.iter().filter(|hit| hit.is_hit()).count()];
    for round in 0..SKY_RAYS {
        let mut around = bounces(mesh, rays, hits, u64::from(seed) * SKY_RAYS + round);
        around.iter_mut().for_each(|ray| ray.t_max = reach);
        let Traced { hits, times: took, .. } = scene.trace(Query::Any, &around)?;
        times += took;
        for (open, hit) in open.iter_mut().zip(hits) {
            *open += if hit.is_hit() { 0.0 } else { 1.0 / SKY_RAYS as f32 };
        }
    }
    let mut open = open.into_iter();
    let mut paint = |hit: &Hit| if hit.is_hit() { open.next().map(|share| [share * 0.9; 3]) } else { None };
    Ok((hits.iter().map(|hit| paint(hit).unwrap_or(NOTHING)).collect(), times))
}

/// The camera at `eye`, which looks at `target` or at the middle of the mesh; or one that sees the whole mesh in a
/// picture of `aspect` = width / height.
pub fn camera(
    mesh: &Mesh,
    aspect: f64,
    [eye, target]: [Option<[f64; 3]>; 2],
    up: [f64; 3],
    fov: f64,
) -> Camera {
    let Some(eye) = eye else {
        return Camera { up, fov, ..Camera::framing(mesh.bounds()) }.fitted(corners(mesh), aspect);
    };
    let (lo, hi) = mesh.bounds();
    let middle = || [0, 1, 2].map(|a| f64::midpoint(f64::from(lo[a]), f64::from(hi[a])));
    Camera { eye, target: target.unwrap_or_else(middle), up, fov }
}

/// The corners of the triangles that can be seen.
fn corners(mesh: &Mesh) -> impl Iterator<Item = [f32; 3]> {
    let corner = |i: u32| mesh.positions()[i as usize];
    mesh.kept().iter().flat_map(move |&triangle| mesh.triangles()[triangle as usize].map(corner))
}

/// The mean of each block of `samples` by `samples` values in rows of `across`.
fn means(seen: &[Rgb], across: usize, samples: usize) -> Vec<Rgb> {
    let share = 1.0 / (samples * samples) as f32;
    let mut out = Vec::with_capacity(seen.len() / (samples * samples));
    for rows in seen.chunks(across * samples) {
        for x in (0..across).step_by(samples) {
            let block = rows.chunks(across).flat_map(|row| &row[x..x + samples]);
            out.push(scale(block.fold([0.0; 3], |sum, &value| add(sum, value)), share));
        }
    }
    out
}

/// Knows what colour a ray's answer has.
struct Artist<'a> {
    mesh: &'a Mesh,
    shading: Shading,
    rows: u32,
    /// Directions of the camera: right, up, forward.
    frame: [[f64; 3]; 3],
    /// Distances between which depth fades.
    fade: [f64; 2],
    eye: [f64; 3],
}

impl<'a> Artist<'a> {
    fn new(mesh: &'a Mesh, camera: &Camera, [_, rows]: [u32; 2], shading: Shading) -> Self {
        let frame = camera.frame();
        let mut fade = [f64::INFINITY, 0.0f64];
        // Nothing else fades, and meshes may be large.
        let fading = (shading == Shading::Depth).then(|| corners(mesh));
        for point in fading.into_iter().flatten() {
            let depth = dot(frame[2], sub(point.map(f64::from), camera.eye));
            fade = [fade[0].min(depth.max(0.0)), fade[1].max(depth)];
        }
        Self { mesh, shading, rows, frame, fade, eye: camera.eye }
    }

    /// The colour of a ray of the given row.
    fn paint(&self, ray: &Ray, hit: &Hit, row: u32) -> Rgb {
        match self.shading {
            Shading::Normal if hit.is_hit() => self.surface(ray, hit),
            Shading::Normal => {
                // A sky that is darkest at the top.
                let down = (row as f32 + 0.5) / self.rows as f32;
                mix([0.030, 0.045, 0.075], [0.33, 0.36, 0.40], down * down)
            }
            _ if !hit.is_hit() => NOTHING,
            Shading::Depth => {
                let point = [0, 1, 2]
                    .map(|a| f64::from(ray.origin[a]) + f64::from(ray.direction[a]) * f64::from(hit.t));
                let depth = dot(self.frame[2], sub(point, self.eye));
                let [near, far] = self.fade;
                let share = ((depth - near) / (far - near).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                [(0.03 + 0.97 * (1.0 - share).powi(3)) as f32; 3]
            }
            Shading::Id | Shading::Heat | Shading::Ao => {
                let mut random = Random::new(hit.triangle.into());
                [(); 3].map(|()| (0.04 + 0.9 * random.unit() * random.unit()) as f32)
            }
        }
    }

    /// A clay surface under a warm lamp at the upper left, a cool sky and a little light from the camera.
    fn surface(&self, ray: &Ray, hit: &Hit) -> Rgb {
        let normal = facing(self.mesh, ray, hit).expect("a hit of this mesh");
        let [right, up, forward] = self.frame;
        let toward = |r: f64, u: f64, f: f64| {
            let length = (r * r + u * u + f * f).sqrt();
            let light = [0, 1, 2].map(|a| (right[a] * r + up[a] * u - forward[a] * f) / length);
            dot(normal, light).max(0.0) as f32
        };
        let sky = (0.5 + 0.5 * dot(normal, up)) as f32;
        let light = [
            scale([1.00, 0.93, 0.82], 1.05 * toward(-0.60, 0.70, 0.45)),
            scale([0.55, 0.65, 0.85], 0.22 * toward(0.9, 0.1, 0.25)),
            scale([1.00, 1.00, 1.00], 0.10 * toward(0.0, 0.0, 1.0)),
            scale(mix([0.16, 0.13, 0.11], [0.42, 0.50, 0.62], sky), 0.34),
        ];
        let [r, g, b] = light.into_iter().fold([0.0; 3], add);
        [r * 0.72, g * 0.64, b * 0.56]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuildOptions, Device};

    /// A square of two triangles, two by two, facing +z.
    fn square() -> Mesh {
        let corners = vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    #[test]
    fn means_of_blocks() {
        let seen: Vec<Rgb> = (0..16).map(|i| [i as f32; 3]).collect();
        let blocks: Vec<f32> = means(&seen, 4, 2).iter().map(|value| value[0]).collect();
        assert_eq!(blocks, [2.5, 4.5, 10.5, 12.5]);
        assert_eq!(means(&seen, 4, 1), seen);
    }

    #[test]
    fn silhouette_of_a_square() {
        let (device, mesh) = (Device::cpu(), square());
        let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
        // 90 degrees from 2 away: 4 units across, of which the square takes 2.
        let camera = Camera { eye: [0.0, 0.0, 2.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 90.0 };
        for (shading, samples) in [(Shading::Id, 1), (Shading::Depth, 1), (Shading::Normal, 2)] {
            let picture = render(&scene, &mesh, &camera, [64, 64], samples, shading).unwrap();
            assert_eq!(picture.hits, 32 * 32 * u64::from(samples * samples));
            assert_eq!(picture.rgb.len(), 64 * 64 * 3);
            let pixel = |x: usize, y: usize| &picture.rgb[(y * 64 + x) * 3..][..3];
            assert_ne!(pixel(20, 40), pixel(2, 40), "{shading:?}");
            assert_eq!(pixel(2, 40), pixel(60, 40), "{shading:?}");
        }
        let picture = render(&scene, &mesh, &camera, [64, 64], 1, Shading::Id).unwrap();
        let colours: std::collections::BTreeSet<&[u8]> = picture.rgb.chunks(3).collect();
        assert_eq!(colours.len(), 3, "the two triangles and nothing");
    }

    #[test]
    fn a_corner_sees_less_sky_than_an_open_square() {
        let (device, open) = (Device::cpu(), square());
        let mut points = open.positions().to_vec();
        points.extend([[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0]]);
        let corner = Mesh::new(points, vec![[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 5, 4]]).unwrap();
        let camera = Camera { eye: [0.0, 0.0, 1.9], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 60.0 };
        let [open, corner] = [open, corner].map(|mesh| {
            let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
            let picture = render(&scene, &mesh, &camera, [32, 32], 1, Shading::Ao).unwrap();
            picture.rgb.iter().map(|&x| u64::from(x)).sum::<u64>()
        });
        assert!(corner < open, "{corner} {open}");
    }

    #[test]
    fn bands_do_not_show() {
        let (device, mesh) = (Device::cpu(), square());
        let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
        let camera = Camera::framing(mesh.bounds());
        // So broad that a band is few rows.
        let size = [16384, 600];
        let picture = render(&scene, &mesh, &camera, size, 1, Shading::Id).unwrap();
        let hits = scene.closest(&camera.rays(size[0], size[1])).unwrap();
        assert_eq!(picture.hits, hits.iter().filter(|hit| hit.is_hit()).count() as u64);
    }
}
