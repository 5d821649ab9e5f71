//! Tree files with valid checksums that are not what a build writes.

use crate::harness::{Case, Good, Judged, Tally, holds};
use raykd::{
    BuildOptions, Builder, Device, KdTree, Mesh, Ray, Scene, Traversal,
    internals::Cpu,
    rays::{Random, random},
};
use raykd_tests::meshes::{Family, Recipe};
use sha2::{Digest as _, Sha256};
use std::rc::Rc;

/// Before the first word that is changed: the format's name.
const START: usize = 8;
/// The checksum's bytes.
const SUM: usize = 32;

/// A mesh, its tree file, rays, and what brute force finds.
struct Base {
    device: Device,
    mesh: Mesh,
    file: Vec<u8>,
    rays: Vec<Ray>,
    hits: Vec<raykd::Hit>,
}

impl Base {
    fn new(family: Family, size: u32, builder: Builder) -> Self {
        let device = Device::from(Cpu::with_threads(1).expect("a thread"));
        let mesh = Recipe { family, size, seed: 7 }.mesh();
        let options = BuildOptions::default().with_builder(builder);
        let folder = tempfile::tempdir().expect("there is room");
        let path = folder.path().join("tree");
        let rays = random(mesh.bounds(), 64, 3);
        let scene = Scene::build(&device, &mesh, &options).expect("a CPU builds it");
        scene.tree().expect("a CPU has it").save(&path).expect("there is room");
        let hits = scene.brute(&rays).expect("a CPU traces");
        drop(scene);
        Self { device, mesh, file: std::fs::read(path).expect("it was written"), rays, hits }
    }

    fn words(&self) -> usize {
        (self.file.len() - START - SUM) / 4
    }

    fn word(&self, at: usize) -> u32 {
        let at = START + 4 * at;
        u32::from_le_bytes(self.file[at..at + 4].try_into().expect("four bytes"))
    }

    /// The file with other words and a checksum that fits.
    fn with(&self, changes: &[(usize, u32)]) -> Vec<u8> {
        let mut file = self.file.clone();
        for &(at, word) in changes {
            file[START + 4 * at..START + 4 * at + 4].copy_from_slice(&word.to_le_bytes());
        }
        sealed(file)
    }

    /// Refused, or right by every traversal.
    fn attempt(&self, file: &[u8]) -> Judged {
        let Ok(tree) = KdTree::from_bytes(file) else { return Ok(Good::Refused) };
        for &traversal in Traversal::ALL {
            let Ok(mut scene) = Scene::with_tree(&self.device, &self.mesh, &tree) else {
                return Ok(Good::Refused);
            };
            scene.traverse_by(traversal).map_err(|e| e.to_string())?;
            let hits = scene.closest(&self.rays).map_err(|e| e.to_string())?;
            let wrong = hits
                .iter()
                .zip(&self.hits)
                .filter(|(a, b)| bytemuck::bytes_of(*a) != bytemuck::bytes_of(*b))
                .count();
            holds(wrong == 0, || {
                format!("accepted, and {wrong} of {} hits by {traversal} are wrong", hits.len())
            })?;
        }
        Ok(Good::Right)
    }
}

/// With a checksum that fits.
fn sealed(mut file: Vec<u8>) -> Vec<u8> {
    let end = file.len() - SUM;
    let sum = Sha256::digest(&file[..end]);
    file[end..].copy_from_slice(&sum);
    file
}

pub(crate) fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    for (family, size, builder) in [
        (Family::Soup, 40, Builder::Median),
        (Family::Lattice, 16, Builder::Binned),
        (Family::Cubes, 36, Builder::Exact),
        (Family::Identical, 3, Builder::Median),
    ] {
        let base = Rc::new(Base::new(family, size, builder));
        let name = format!("tree/{family:?}");
        for at in 0..base.words() {
            let base = base.clone();
            all.push(Case::many(format!("{name}, word {at}"), move |tally| one_word(&base, at, tally)));
        }
        let pairs = base.clone();
        all.push(Case::many(format!("{name}, two words"), move |tally| two_words(&pairs, tally)));
        all.push(Case::many(format!("{name}, lengths"), move |tally| lengths(&base, tally)));
    }
    all
}

/// Every value that one could mean harm by, in one word.
fn one_word(base: &Base, at: usize, tally: &mut Tally) {
    let now = base.word(at);
    let mut values =
        vec![0, 1, 2, 3, u32::MAX, i32::MAX as u32, 0x7F80_0000, 0x7FC0_0000, 0x8000_0000, 0xFF80_0000];
    values.extend((0..32).map(|bit| now ^ 1 << bit));
    values.extend([
        now.wrapping_add(1),
        now.wrapping_sub(1),
        now.wrapping_add(4),
        now.wrapping_sub(4),
        now.wrapping_add(8),
        now.wrapping_sub(8),
    ]);
    // What other words say, as many as there is time for.
    values.extend((0..base.words()).step_by(base.words() / 80 + 1).map(|other| base.word(other)));
    values.sort_unstable();
    values.dedup();
    values.retain(|&value| value != now);
    for value in values {
        tally.attempt(&format!("{now:08x} became {value:08x}"), || base.attempt(&base.with(&[(at, value)])));
    }
}

/// Words of the file in each other's place.
fn two_words(base: &Base, tally: &mut Tally) {
    let mut random = Random::new(11);
    for _ in 0..2000 {
        let [a, b] = [(); 2].map(|()| random.below(base.words()));
        let changes = match random.below(3) {
            0 => [(a, base.word(b)), (b, base.word(a))],
            1 => [(a, base.word(a) ^ 1 << random.below(32)), (b, base.word(b) ^ 1 << random.below(32))],
            _ => [(a, base.word(random.below(base.words()))), (b, base.word(random.below(base.words())))],
        };
        let same = changes.iter().all(|&(at, word)| base.word(at) == word);
        if !same {
            tally.attempt(&format!("{changes:x?}"), || base.attempt(&base.with(&changes)));
        }
    }
}

/// Longer and shorter files.
fn lengths(base: &Base, tally: &mut Tally) {
    tally.attempt("as it is", || match base.attempt(&base.file)? {
        Good::Right => Ok(Good::Right),
        Good::Refused => Err("refused".to_owned()),
    });
    let end = base.file.len() - SUM;
    for cut in (0..base.file.len()).step_by(3) {
        tally.attempt(&format!("the first {cut} bytes"), || refused(base, &base.file[..cut]));
        if cut < end {
            let short = [&base.file[..cut], &[0; SUM][..]].concat();
            tally.attempt(&format!("{cut} bytes and a checksum"), || refused(base, &sealed(short)));
        }
    }
    for more in [1, 4, 8, 64] {
        let long = [&base.file[..end], &vec![0; more][..], &[0; SUM][..]].concat();
        tally.attempt(&format!("{more} more bytes"), || refused(base, &sealed(long)));
    }
}

fn refused(base: &Base, file: &[u8]) -> Judged {
    match base.attempt(file)? {
        Good::Refused => Ok(Good::Refused),
        Good::Right => Err("accepted".to_owned()),
    }
}
