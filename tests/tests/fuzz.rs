//! The fuzzers' corpus, and what they found: `fuzz/` says how they run.

#[expect(unreachable_pub, reason = "elsewhere it is a library")]
#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

use raykd::{internals::known_formats, rays::Random};
use std::{fs, path::Path};

/// What a file of the corpus is given to.
type Target = fn(&[u8]);

const TARGETS: [(&str, Target); 4] =
    [("api", fuzz::api), ("tree", fuzz::tree), ("rays", fuzz::rays), ("triangles", fuzz::triangles)];

/// The files of a folder of the corpus, by name.
fn corpus(folder: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(folder);
    let mut paths: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(!paths.is_empty(), "{} is empty", folder.display());
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

/// The folders of mesh files, each named as its files end.
fn folders() -> impl Iterator<Item = &'static str> {
    known_formats().map(|(_, extensions)| extensions[0])
}

#[test]
fn the_corpus_does_no_harm() {
    for (folder, target) in TARGETS {
        corpus(folder).iter().for_each(|bytes| target(bytes));
    }
    for folder in folders() {
        corpus(folder).iter().for_each(|bytes| fuzz::mesh(bytes));
    }
}

/// A small round of what a fuzzer does, with the corpus of mesh files: bytes changed, doubled, cut out, and joined.
#[test]
fn damaged_mesh_files_do_no_harm() {
    let mut random = Random::new(2026);
    for folder in folders() {
        let files = corpus(folder);
        for _ in 0..1500 {
            let mut bytes = files[random.below(files.len())].clone();
            for _ in 0..=random.below(4) {
                if bytes.is_empty() {
                    break;
                }
                let (at, other) = (random.below(bytes.len()), random.below(bytes.len()));
                let (start, end) = (at.min(other), at.max(other));
                match random.below(8) {
                    0 => drop(bytes.drain(start..end)),
                    1 => bytes.extend_from_within(start..end.min(start + 64)),
                    2 => bytes.extend(&files[random.below(files.len())]),
                    3 => bytes.swap(at, other),
                    _ => bytes[at] = random.bits() as u8,
                }
            }
            fuzz::mesh_of(folder, &bytes);
        }
    }
}

/// Three findings of one kind: the judge took triangles that are thinner than rounding for planes with a slope.
#[test]
fn needles_thinner_than_rounding_are_judged_by_their_reach() {
    let flat = [0.0, 0.0, 0.0, 1.000_122, 0.0, 0.0, 0.0, 1.0, 0.0];
    let needle = [0.0, 0.0, 2.199_023_3e12, 0.0, 1.220_712_3e-4, -1.074_790_4e8, 1.9e-35, 0.0, 0.0f32];
    fuzz::triangles(bytemuck::cast_slice(&[flat, needle]));
}

/// As a fuzzer would, but with no more than the standard library: what is in the corpus, changed here and there.
#[test]
fn calls_in_any_order_do_no_harm() {
    let mut random = Random::new(11);
    for case in 0..400 {
        let usual = |bits: u64| match bits % 8 {
            0..=4 => (bits >> 8) as u32 % 9,
            5 => (bits >> 8) as u32,
            // Numbers of all sizes, and none.
            6 => ((bits >> 8) as u32 % 512) << 23,
            _ => f32::NAN.to_bits(),
        };
        let mut words: Vec<u32> = (0..60).map(|_| usual(random.bits())).collect();
        if case % 4 != 0 {
            // Zeros leave the options' numbers as they are.
            words[3..8].fill(0);
        }
        fuzz::api(bytemuck::cast_slice(&words));
    }
}
