//! Scenes in which ray tracers fail, and what each way of tracing makes of them.
//!
//! A [`Case`] makes meshes, rays and rules; a [`Method`] answers the rays; [`Trial`] judges the answers by the exact
//! [`Oracle`], by brute force with the same triangle test, and by the CPU's bytes.

mod cases;
pub mod leaks;
mod method;
#[doc(hidden)]
pub mod shapes;
mod textbook;

pub use cases::CASES;
pub use method::{Method, Way};
pub use textbook::Textbook;

use crate::{
    BuildOptions, Device, DeviceKind, Error, Hit, Intersector, KdTree, Mesh, Ray, Scene,
    rays::{AnyRay, Random},
    shared::MISS,
};
pub use raykd_oracle::{Crossing, judge::Fault};
use raykd_oracle::{Oracle, judge::ulps};
use rayon::prelude::*;
use std::collections::HashMap;

/// How far, in units of the largest distance along an axis from the ray's origin to the scene's box, raykd's default
/// test may see a triangle moved: see `raykd_kernels::trace::frame`.
pub const SLACK: f64 = 21.0 / (1u32 << 24) as f64;

/// The same for [`Intersector::Exact`], which may not: what the judge's own `f64` round.
pub const EXACT_SLACK: f64 = 1.0 / (1u64 << 46) as f64;

/// A scene to be made.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Case {
    /// Its name.
    pub name: &'static str,
    /// What is in it.
    pub about: &'static str,
    /// Methods, by the start of their name, that are known to fail there.
    pub known: &'static [&'static str],
    make: fn(&mut Random, usize) -> Vec<Part>,
}

/// A mesh, rays, and what their answers must be. Some scenes have several.
#[derive(Debug)]
#[non_exhaustive]
pub struct Part {
    /// What tells it from the others of its scene; may be empty.
    pub name: String,
    /// The mesh.
    pub mesh: Mesh,
    /// The rays.
    pub rays: Vec<Ray>,
    /// Which answers are right.
    pub rule: Rule,
}

/// Which answers are right.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Rule {
    /// Those that are exact for corners moved by at most [`SLACK`], or [`EXACT_SLACK`].
    Rounding,
    /// Of those, hits only: each ray passes through the inside of a surface.
    Hits,
    /// Exact ones: arithmetic is, here. Of equal `t` the lowest triangle.
    Exact,
    /// Of those of [`Rule::Rounding`], the ones with these triangles.
    Known(Vec<u32>),
    /// Those of an earlier part's rays, one by one, with `t` times this. Triangle `i` here is `triangles[i]` there.
    As {
        /// Which part.
        of: usize,
        /// What `t` is multiplied with.
        t: f32,
        /// Numbers that the triangles have there; as here if `None`.
        triangles: Option<Vec<u32>>,
    },
    /// Of those of [`Rule::Rounding`], hits of other triangles than these, which the rays leave.
    Leaves(Vec<u32>),
}

/// Why an answer counts as a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Failure {
    /// The oracle says so.
    Oracle(Fault),
    /// A miss where there is no gap.
    Leak,
    /// Not the triangle it must be.
    Triangle,
    /// The triangle that the ray leaves.
    Itself,
    /// Not the answer that the same ray gets in another form of the scene.
    Symmetry,
    /// Not what brute force finds with the same triangle test.
    Tree,
    /// Not the CPU's bytes.
    Device,
}

impl Failure {
    /// One word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Oracle(Fault::Missed) => "missed",
            Self::Oracle(Fault::Invented) => "invented",
            Self::Oracle(Fault::Misplaced) => "misplaced",
            Self::Oracle(Fault::OutOfRange) => "out-of-range",
            Self::Leak => "leak",
            Self::Triangle => "triangle",
            Self::Itself => "itself",
            Self::Symmetry => "symmetry",
            Self::Tree => "tree",
            Self::Device => "device",
        }
    }
}

/// Whether this is a ray by the contract: finite, with a direction that is not zero, `t_min` and `t_max` numbers.
#[doc(hidden)]
pub fn is_ray(ray: &Ray) -> bool {
    let finite = ray.origin.iter().chain(&ray.direction).all(|x| x.is_finite());
    finite && ray.direction.iter().any(|x| x.is_normal()) && !ray.t_min.is_nan() && !ray.t_max.is_nan()
}

/// The ray with 0 for subnormal numbers, as which the contract takes them.
#[doc(hidden)]
pub fn settled(ray: &Ray) -> Ray {
    let settle = |x: f32| if x.is_subnormal() { 0.0 } else { x };
    Ray {
        origin: ray.origin.map(settle),
        direction: ray.direction.map(settle),
        t_min: settle(ray.t_min),
        t_max: settle(ray.t_max),
    }
}

/// A scene made, with the exact answers.
#[derive(Debug)]
pub struct Trial {
    /// Its name.
    pub name: String,
    /// Methods that are known to fail here.
    known: &'static [&'static str],
    parts: Vec<Part>,
    truths: Vec<Truth>,
    /// The trees that methods share, made by the CPU.
    trees: Vec<KdTree>,
    /// What brute force finds on the CPU, by the name of the triangle test.
    brute: HashMap<&'static str, Vec<Vec<Hit>>>,
    /// What the CPU found, by method.
    cpu: HashMap<String, Vec<Vec<Hit>>>,
}

/// The exact answers of a part.
#[derive(Debug)]
struct Truth {
    oracle: Oracle,
    crossings: Vec<Vec<Crossing>>,
}

impl Truth {
    fn new(part: &Part) -> Self {
        let oracle = Oracle::new(part.mesh.positions(), part.mesh.triangles());
        let crossings = part.rays.par_iter().map(|ray| oracle.crossings(&settled(ray))).collect();
        Self { oracle, crossings }
    }
}

/// A ray that fails, to be traced again.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Example {
    /// Which part of the scene.
    pub part: usize,
    /// Which ray of that.
    pub ray: usize,
    /// What is wrong.
    pub why: Failure,
    /// The answer.
    pub answer: Hit,
    /// The exact answer.
    pub exact: Option<Crossing>,
}

/// What a method made of a scene.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Outcome {
    /// Rays traced.
    pub rays: u64,
    /// Rays whose answer is wrong.
    pub failures: u64,
    /// Rays whose answer names another triangle than the exact one, wrong or within rounding.
    pub inexact: u64,
    /// Failures by kind.
    pub kinds: Vec<(Failure, u64)>,
    /// One of them.
    pub example: Option<Example>,
    /// Errors of `t` in ULP of the exact one where the closest exact triangle was hit: half of them are at most the
    /// first, 99.9 % the second, all the third.
    pub ulps: Option<[f64; 3]>,
    /// Whether the method is known to fail here.
    pub expected: bool,
}

impl Case {
    /// Makes the scene, always the same one for a number of rays.
    pub fn parts(&self, rays: usize) -> Vec<Part> {
        (self.make)(&mut Random::new(0x57E55), rays)
    }

    /// The same, with the exact answers.
    ///
    /// # Errors
    /// Its trees do not fit memory.
    pub fn prepare(&self, rays: usize) -> Result<Trial, Error> {
        Trial::prepared(self.name.to_owned(), self.known, self.parts(rays))
    }
}

impl Trial {
    /// A scene of one's own: a mesh, rays in its own coordinates, and only rounding allowed for: that of `f32`, not
    /// what was rounded when the mesh and its rays were moved ([`Mesh::translation`]).
    ///
    /// # Errors
    /// Its tree does not fit memory.
    pub fn new(name: String, mesh: Mesh, rays: Vec<Ray>) -> Result<Self, Error> {
        let rays = AnyRay::local(&rays, mesh.translation()).into_owned();
        let mesh = mesh.into_local();
        Self::prepared(name, &[], vec![Part { name: String::new(), mesh, rays, rule: Rule::Rounding }])
    }

    fn prepared(name: String, known: &'static [&'static str], parts: Vec<Part>) -> Result<Self, Error> {
        let truths = parts.iter().map(Truth::new).collect();
        let cpu = Device::cpu();
        let tree = |part: &Part| Scene::build(&cpu, &part.mesh, &BuildOptions::default())?.tree();
        let trees = parts.iter().map(tree).collect::<Result<_, Error>>()?;
        Ok(Self { name, known, parts, truths, trees, brute: HashMap::new(), cpu: HashMap::new() })
    }

    /// Whether a method runs in the scene and on a device: those of the textbooks where they are known to fail, on
    /// the CPU; leaving out a triangle where rays leave one.
    pub fn runs(&self, method: &Method, device: &Device) -> bool {
        match method.way {
            Way::Textbook(_) => self.fails(method) && device.kind() == DeviceKind::Cpu,
            Way::Except => self.parts.iter().any(|part| matches!(part.rule, Rule::Leaves(_))),
            _ => true,
        }
    }

    /// Whether a method is known to fail here.
    fn fails(&self, method: &Method) -> bool {
        self.known.iter().any(|known| method.name().starts_with(known))
    }

    /// Its meshes and rays.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Traces all rays by a method and judges the answers; or, of `only` a part and a ray, that one.
    ///
    /// # Errors
    /// The device failed.
    pub fn run(
        &mut self,
        method: &Method,
        device: &Device,
        only: Option<(usize, usize)>,
    ) -> Result<Outcome, Error> {
        let answers = self.answers(method, device)?;
        if device.kind() == DeviceKind::Cpu {
            self.cpu.insert(method.name(), answers.clone());
        }
        let test = method.test.name();
        if method.judges_tree() && !self.brute.contains_key(test) {
            let cpu = Device::cpu();
            let brute = self.answers(&method.by_brute_force(), &cpu)?;
            self.brute.insert(test, brute);
        }
        let mut outcome = Outcome { expected: self.fails(method), ..Outcome::default() };
        let mut errors = Vec::new();
        for part in 0..self.parts.len() {
            for (ray, answer) in answers[part].iter().enumerate() {
                if only.is_some_and(|only| only != (part, ray)) {
                    continue;
                }
                outcome.rays += 1;
                errors.extend(self.ulps(part, ray, answer));
                let first = self.truths[part].crossings[ray].first().copied();
                outcome.inexact += u64::from(answer.triangle != first.map_or(MISS, |c| c.triangle));
                let Some(why) = self.judge(method, &answers, part, ray) else { continue };
                outcome.failures += 1;
                match outcome.kinds.iter_mut().find(|(kind, _)| *kind == why) {
                    Some((_, count)) => *count += 1,
                    None => outcome.kinds.push((why, 1)),
                }
                outcome.example.get_or_insert(Example { part, ray, why, answer: *answer, exact: first });
            }
        }
        errors.sort_by(f64::total_cmp);
        let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
        outcome.ulps = (!errors.is_empty()).then(|| [at(0.5), at(0.999), at(1.0)]);
        Ok(outcome)
    }

    fn answers(&self, method: &Method, device: &Device) -> Result<Vec<Vec<Hit>>, Error> {
        let tree = |at: usize| method.takes_a_tree().then(|| &self.trees[at]);
        let parts = self.parts.iter().enumerate();
        parts.map(|(at, part)| method.closest(device, part, tree(at))).collect()
    }

    fn judge(&self, method: &Method, answers: &[Vec<Hit>], at: usize, number: usize) -> Option<Failure> {
        let (part, truth) = (&self.parts[at], &self.truths[at]);
        let answer = &answers[at][number];
        let ray = settled(&part.rays[number]);
        let crossings = &truth.crossings[number];
        if !is_ray(&ray) {
            return answer.is_hit().then_some(Failure::Triangle);
        }
        if let Rule::As { of, t, triangles } = &part.rule {
            let mut expected = answers[*of][number];
            if expected.is_hit() {
                expected.t *= t;
            }
            let mut found = *answer;
            if let (Some(triangles), true) = (triangles, found.is_hit()) {
                found.triangle = triangles[found.triangle as usize];
            }
            if (found.triangle, found.t) != (expected.triangle, expected.t) {
                return Some(Failure::Symmetry);
            }
        } else {
            let slack = if method.test == Intersector::Exact { EXACT_SLACK } else { SLACK };
            let slack = slack * truth.oracle.reach(ray.origin);
            let (crossings, own) = match &part.rule {
                // The triangle it leaves does not count.
                Rule::Leaves(from) => {
                    let own = from[number];
                    (&crossings.iter().copied().filter(|c| c.triangle != own).collect(), own)
                }
                _ => (crossings, MISS),
            };
            if answer.is_hit() && answer.triangle == own {
                return Some(Failure::Itself);
            }
            if let Some(fault) = truth.oracle.judge(&ray, crossings, answer, slack) {
                return Some(Failure::Oracle(fault));
            }
            match &part.rule {
                Rule::Hits if !answer.is_hit() => return Some(Failure::Leak),
                Rule::Exact if answer.triangle != crossings.first().map_or(MISS, |c| c.triangle) => {
                    return Some(Failure::Triangle);
                }
                Rule::Known(ids) if answer.triangle != ids[number] => return Some(Failure::Triangle),
                _ => {}
            }
        }
        let same = |other: &[Vec<Hit>]| bytemuck::bytes_of(&other[at][number]) == bytemuck::bytes_of(answer);
        if method.judges_tree() && !same(&self.brute[method.test.name()]) {
            return Some(Failure::Tree);
        }
        let on_cpu = self.cpu.get(&method.name());
        on_cpu.is_some_and(|cpu| !same(cpu)).then_some(Failure::Device)
    }

    fn ulps(&self, part: usize, ray: usize, answer: &Hit) -> Option<f64> {
        let crossing = self.truths[part].crossings[ray].first()?;
        (answer.triangle == crossing.triangle && crossing.t != 0.0).then(|| ulps(answer.t, crossing.t))
    }
}
