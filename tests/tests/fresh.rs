//! The committed SPIR-V modules are what their sources say.

use raykd::internals::kernels::{BY_DOUBLES, KERNELS, SPIRV, SPIRV_BY_DOUBLES};
use std::path::Path;

#[test]
fn the_committed_modules_are_compiled_from_these_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    // The error says what to do: run `cargo xtask kernels`.
    let manifest = xtask::verify(&root).unwrap_or_else(|e| panic!("{e:#}"));
    let built = [(KERNELS, SPIRV), (BY_DOUBLES, SPIRV_BY_DOUBLES)];
    assert_eq!(manifest.modules.len(), built.len());
    for ((kernels, bytes), contents) in built.iter().zip(&manifest.modules) {
        let module: Vec<_> = contents.entry_points.iter().map(|e| (e.name.as_str(), e.workgroup)).collect();
        assert_eq!(module.len(), kernels.len());
        for kernel in *kernels {
            assert!(module.contains(&(kernel.entry_point(), [kernel.threads, 1, 1])), "{}", kernel.name());
        }
        assert_eq!(xtask::sha256(bytes), contents.sha256, "this test was built with another");
    }
}
