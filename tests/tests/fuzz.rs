//! The fuzzers' corpus, and what they found: `fuzz/` says how they run.

#[expect(unreachable_pub, reason = "elsewhere it is a library")]
#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

use std::path::Path;

/// What a file of the corpus is given to.
type Target = fn(&[u8]);

const TARGETS: [(&str, Target); 6] = [
    ("api", fuzz::api),
    ("obj", |bytes| fuzz::mesh("fuzz.obj", bytes)),
    ("ply", |bytes| fuzz::mesh("fuzz.ply", bytes)),
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
    let mut random = raykd::rays::Random::new(11);
    for _ in 0..400 {
        let usual = |bits: u64| match bits % 8 {
            0..=4 => (bits >> 8) as u32 % 9,
            5 => (bits >> 8) as u32,
            // Numbers of all sizes, and none.
            6 => ((bits >> 8) as u32 % 512) << 23,
            _ => f32::NAN.to_bits(),
        };
        let words: Vec<u32> = (0..60).map(|_| usual(random.bits())).collect();
        fuzz::api(bytemuck::cast_slice(&words));
    }
}
