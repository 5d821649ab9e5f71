//! Where the compiler for SPIR-V comes from.

use crate::Error;
use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// Version of rust-gpu; a shader crate's spirv-std must be the same.
pub const RUST_GPU: &str = "0.10.0";
/// The only toolchain this version builds with, unless its sources are patched.
const NIGHTLY: &str = "nightly-2026-07-03";
const COMPONENTS: [&str; 3] = ["rust-src", "rustc-dev", "llvm-tools"];

/// A rustc and the code generator made for it.
pub(crate) struct Toolchain {
    /// Its name in rustup.
    pub(crate) name: String,
    /// `librustc_codegen_spirv.so`.
    pub(crate) backend: PathBuf,
    /// What its rustc calls itself.
    pub(crate) rustc: String,
}

/// The toolchain named by the environment, or the pinned nightly, installed and built below `cache` if it is
/// not yet.
pub(crate) fn find(cache: &Path) -> Result<Toolchain, Error> {
    let (name, backend) = match (env::var("RUST_GPU_TOOLCHAIN"), env::var_os("RUSTC_CODEGEN_SPIRV")) {
        (Ok(name), Some(backend)) => {
            let backend = PathBuf::from(backend);
            if !backend.is_file() {
                return Err(Error::NoBackend(backend));
            }
            (name, backend)
        }
        (Err(_), None) => (NIGHTLY.to_owned(), install(cache)?),
        _ => return Err(Error::HalfSet),
    };
    let rustc = rustup()
        .args(["run", &name, "rustc", "--version"])
        .output()
        .map_err(|e| Error::Program("rustup", e))?;
    if !rustc.status.success() {
        return Err(Error::NoToolchain(name));
    }
    let rustc = String::from_utf8_lossy(&rustc.stdout).trim().to_owned();
    Ok(Toolchain { name, backend, rustc })
}

/// Installs the pinned nightly and builds the code generator with it.
fn install(cache: &Path) -> Result<PathBuf, Error> {
    let dir = cache.join(format!("rust-gpu-{RUST_GPU}-{NIGHTLY}"));
    let done = dir.join("backend");
    if let Ok(path) = fs::read_to_string(&done)
        && Path::new(&path).is_file()
    {
        return Ok(path.into());
    }
    eprintln!("installing {NIGHTLY} and building rust-gpu {RUST_GPU} with it, once (some minutes)");
    let mut toolchain = rustup();
    toolchain.args(["toolchain", "install", NIGHTLY, "--profile", "minimal", "--no-self-update"]);
    for component in COMPONENTS {
        toolchain.args(["--component", component]);
    }
    let status = toolchain.status().map_err(|e| Error::Program("rustup", e))?;
    if !status.success() {
        return Err(Error::Install(format!("rustup could not install {NIGHTLY}")));
    }
    write_crate(&dir).map_err(|e| Error::File(dir.clone(), e))?;
    let build = rustup()
        .args(["run", NIGHTLY, "cargo", "build", "--release", "--message-format", "json-render-diagnostics"])
        .current_dir(&dir)
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Error::Program("rustup", e))?;
    if !build.status.success() {
        return Err(Error::Install("building rustc_codegen_spirv failed".to_owned()));
    }
    let backend = String::from_utf8_lossy(&build.stdout)
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter(|message| message["target"]["name"] == "rustc_codegen_spirv")
        .filter_map(|message| message["filenames"].as_array().cloned())
        .flatten()
        .filter_map(|file| file.as_str().map(str::to_owned))
        .find(|file| file.ends_with(env::consts::DLL_SUFFIX))
        .ok_or_else(|| Error::Install("cargo built no rustc_codegen_spirv library".to_owned()))?;
    fs::write(&done, &backend).map_err(|e| Error::File(done, e))?;
    Ok(backend.into())
}

/// Writes a crate of its own that does nothing but depend on the code generator.
fn write_crate(dir: &Path) -> io::Result<()> {
    fs::create_dir_all(dir.join("src"))?;
    fs::write(dir.join("src/lib.rs"), "")?;
    fs::write(
        dir.join("Cargo.toml"),
        format!(
            "[package]\nname = \"backend\"\nedition = \"2024\"\n\n[workspace]\n\n\
             [dependencies]\nrustc_codegen_spirv = \"={RUST_GPU}\"\n"
        ),
    )
}

/// rustup without what `cargo run` of another toolchain left in the environment.
fn rustup() -> Command {
    let mut command = Command::new("rustup");
    for name in
        ["RUSTUP_TOOLCHAIN", "CARGO", "RUSTC", "RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_TARGET_DIR"]
    {
        command.env_remove(name);
    }
    command
}
