//! The fuzzers' corpus, and what they found: `fuzz/` says how they run.

#[expect(unreachable_pub, reason = "elsewhere it is a library")]
#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

use raykd::rays::Random;
use std::path::Path;

/// What a file of the corpus is given to.
type Target = fn(&[u8]);

const TARGETS: [(&str, Target); 7] = [
    ("obj", |bytes| fuzz::mesh("fuzz.obj", bytes)),
    ("ply", |bytes| fuzz::mesh("fuzz.ply", bytes)),
    ("stl", |bytes| fuzz::mesh("fuzz.stl", bytes)),
    ("glb", |bytes| fuzz::mesh("fuzz.glb", bytes)),
    ("tree", fuzz::tree),
    ("rays", fuzz::rays),
    ("triangles", fuzz::triangles),
];

#[test]
fn the_corpus_does_no_harm() {
    for (name, target) in TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(name);
        let mut files = 0;
        for entry in std::fs::read_dir(&folder).unwrap() {
            target(&std::fs::read(entry.unwrap().path()).unwrap());
            files += 1;
        }
        assert!(files > 0, "{} is empty", folder.display());
    }
}

/// A small round of what a fuzzer does, with the corpus of mesh files: bytes changed, doubled, cut out, and joined.
#[test]
fn damaged_mesh_files_do_no_harm() {
    let mut random = Random::new(2026);
    for (name, target) in &TARGETS[..4] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(name);
        let mut paths: Vec<_> =
            std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let files: Vec<Vec<u8>> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
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
            target(&bytes);
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
