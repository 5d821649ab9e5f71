//! What `cargo xtask kernels` writes next to the committed SPIR-V modules, and how anyone checks them without
//! rust-gpu: they are current if [`verify`] finds the manifest's hashes in the tree.

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::{
    fs, io,
    iter::repeat,
    path::{Path, PathBuf},
};

/// A module that is committed.
#[derive(Clone, Copy, Debug)]
pub struct Module {
    /// The file, from the repository's root.
    pub path: &'static str,
    /// The feature of `raykd-kernels` by which its kernels are entry points.
    pub feature: &'static str,
    /// Whether these compute with doubles.
    pub doubles: bool,
}

/// The modules: that for all devices, and one for those that have doubles.
pub const MODULES: [Module; 2] = [
    Module { path: "kernels/spv/raykd.spv", feature: "entry-points", doubles: false },
    Module { path: "kernels/spv/doubles.spv", feature: "doubles", doubles: true },
];
/// Their manifest.
pub const MANIFEST: &str = "kernels/spv/manifest.json";

/// Packages that `cargo xtask test` leaves out, and whatever shares its builds: with them, dependencies have more
/// features and are compiled again. What compiles the kernels takes a minute to build, and its tests concern nobody
/// else. What makes bindings for JavaScript takes as long and has none. The Python package is tested by Python.
pub const LEFT_OUT: [&str; 4] = ["raykd-spirv", "xtask-kernels", "xtask-web", "raykd-python"];

/// What the modules were made from and what is in them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`sources_digest`] of the sources they were compiled from.
    pub sources_sha256: String,
    /// Version of rust-gpu.
    pub rust_gpu: String,
    /// What its rustc calls itself.
    pub rustc: String,
    /// SPIR-V target they were compiled for.
    pub target: String,
    /// Of each of [`MODULES`], in order.
    pub modules: Vec<Contents>,
}

/// What is in a module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Contents {
    /// SHA-256 of the module.
    pub sha256: String,
    /// Its size.
    pub bytes: usize,
    /// Float operations that carry `NoContraction`.
    pub exact_float_ops: usize,
    /// Entry points in the module's order.
    pub entry_points: Vec<EntryPoint>,
}

/// One kernel of the module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EntryPoint {
    /// Name to give to the pipeline.
    pub name: String,
    /// Invocations per workgroup.
    pub workgroup: [u32; 3],
}

impl Manifest {
    /// Reads the committed manifest.
    pub fn read(root: &Path) -> Result<Self> {
        let path = root.join(MANIFEST);
        let text = fs::read_to_string(&path)
            .with_context(|| format!("reading {} (run `cargo xtask kernels`)", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is damaged", path.display()))
    }
}

/// Checks that the committed modules are those the manifest describes and were compiled from the sources as
/// they are now. Needs no rust-gpu toolchain.
pub fn verify(root: &Path) -> Result<Manifest> {
    let manifest = Manifest::read(root)?;
    let described = manifest.modules.iter().map(|module| module.sha256.as_str());
    for (path, sha) in MODULES.iter().map(|module| module.path).zip(described.chain(repeat(""))) {
        let module = fs::read(root.join(path)).with_context(|| format!("reading {path}"))?;
        ensure!(
            sha256(&module) == sha,
            "{path} is not the module that {MANIFEST} describes: run `cargo xtask kernels`"
        );
    }
    ensure!(
        sources_digest(root)? == manifest.sources_sha256,
        "kernels/spv is older than the kernel sources: run `cargo xtask kernels` and commit kernels/spv"
    );
    Ok(manifest)
}

/// SHA-256 over everything the modules are compiled from: manifests and sources of `kernels` and `shared`, with
/// their paths, in order. Line ends are normalised, so that checkouts on every system agree.
pub fn sources_digest(root: &Path) -> io::Result<String> {
    let mut files = Vec::new();
    for part in ["kernels", "shared"] {
        files.push(PathBuf::from(part).join("Cargo.toml"));
        rust_files(root, &Path::new(part).join("src"), &mut files)?;
    }
    files.sort();
    let mut hash = Sha256::new();
    for file in files {
        let name = file.to_string_lossy().replace('\\', "/");
        let text = fs::read_to_string(root.join(&file))?.replace("\r\n", "\n");
        // Lengths keep one file's end from passing for the next one's name.
        hash.update(format!("{name}\n{}\n", text.len()));
        hash.update(text);
    }
    Ok(hex(&hash.finalize()))
}

/// SHA-256 in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn rust_files(root: &Path, dir: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(dir))? {
        let entry = entry?;
        let path = dir.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            rust_files(root, &path, files)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digest_sees_content_and_names_but_not_line_ends() {
        let dir = std::env::temp_dir().join(format!("raykd-digest-{}", std::process::id()));
        let write = |path: &str, text: &str| {
            let path = dir.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        for part in ["kernels", "shared"] {
            write(&format!("{part}/Cargo.toml"), "[package]\n");
            write(&format!("{part}/src/lib.rs"), "mod a;\n");
            write(&format!("{part}/src/deep/a.rs"), "fn f() {}\n");
        }
        let digest = || sources_digest(&dir).unwrap();
        let first = digest();
        write("shared/src/lib.rs", "mod a;\r\n");
        write("shared/src/notes.txt", "not a source");
        assert_eq!(digest(), first);
        write("shared/src/deep/a.rs", "fn g() {}\n");
        let second = digest();
        assert_ne!(second, first);
        fs::rename(dir.join("shared/src/deep/a.rs"), dir.join("shared/src/deep/b.rs")).unwrap();
        assert_ne!(digest(), second);
        fs::remove_dir_all(dir).unwrap();
    }
}
