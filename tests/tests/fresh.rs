//! The committed SPIR-V module is what its sources say.

use std::path::Path;

#[test]
fn the_committed_module_is_compiled_from_these_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    // The error says what to do: run `cargo xtask kernels`.
    let manifest = xtask::verify(&root).unwrap_or_else(|e| panic!("{e:#}"));
    let module: Vec<_> = manifest.entry_points.iter().map(|e| (e.name.as_str(), e.workgroup)).collect();
    assert_eq!(module.len(), raykd::internals::kernels::KERNELS.len());
    for kernel in raykd::internals::kernels::KERNELS {
        assert!(module.contains(&(kernel.entry_point(), [kernel.threads, 1, 1])), "{}", kernel.name());
    }
    assert_eq!(
        xtask::sha256(raykd::internals::kernels::SPIRV),
        manifest.module_sha256,
        "this test was built with another"
    );
}
