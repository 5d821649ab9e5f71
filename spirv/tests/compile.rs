//! Shader crates from source to module. These tests need rust-gpu and spirv-val:
//! `cargo test -p raykd-spirv -- --ignored`.

use raykd_spirv::{Compiler, Error, Module, validate};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// A shader crate whose kernel writes what an expression makes of two numbers, `a` and `b`.
fn shader(name: &str, expression: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(dir.join("src")).unwrap();
    let manifest = format!(
        "[package]\nname = \"{name}\"\nedition = \"2024\"\n\n[dependencies]\nspirv-std = \"=0.10.0\"\n\n[workspace]\n"
    );
    fs::write(dir.join("Cargo.toml"), manifest).unwrap();
    let source = format!(
        "#![no_std]\n\
         #[spirv_std::spirv(compute(threads(32)))]\n\
         pub fn kernel(#[spirv(storage_buffer, descriptor_set = 0, binding = 0)] values: &mut [f32]) {{\n\
             let (a, b) = (values[0], values[1]);\n\
             values[2] = {expression};\n\
         }}\n"
    );
    fs::write(dir.join("src/lib.rs"), source).unwrap();
    dir
}

fn compile(name: &str, expression: &str) -> Result<Module, Error> {
    // One folder for all, so that core is compiled once.
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("shaders");
    Compiler::new(shader(name, expression)).target_dir(target).compile().map(|compiled| compiled.module)
}

#[test]
#[ignore = "needs rust-gpu and spirv-val"]
fn exact_kernels_compile() {
    let module = compile("exact", "if a < b { a * b + a } else { a - b }").unwrap();
    assert_eq!(module.entry_points.len(), 1);
    assert_eq!(
        (&*module.entry_points[0].name, module.entry_points[0].workgroup),
        ("kernel", Some([32, 1, 1]))
    );
    assert!(module.exact_float_ops >= 3, "{} float operations", module.exact_float_ops);
}

#[test]
#[ignore = "needs rust-gpu and spirv-val"]
fn inexact_kernels_are_refused() {
    for (name, expression, instruction) in [
        ("quotient", "a / b", "OpFDiv"),
        ("fused", "spirv_std::num_traits::Float::mul_add(a, b, a)", "Fma"),
        ("root", "spirv_std::num_traits::Float::sqrt(a)", "Sqrt"),
    ] {
        let error = compile(name, expression).unwrap_err();
        let Error::Refused(findings) = &error else { panic!("{name}: {error}") };
        let found = |finding: &raykd_spirv::Finding| {
            finding.instruction.ends_with(instruction) && finding.entry.as_deref() == Some("kernel")
        };
        assert!(findings.iter().any(found), "{name}: {error}");
    }
}

#[test]
#[ignore = "needs spirv-val"]
fn spirv_val_is_asked() {
    let error = validate(&[3, 2, 35, 7, 0, 5, 1, 0, 0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0]).unwrap_err();
    assert!(matches!(error, Error::Invalid(_)), "{error}");
}
