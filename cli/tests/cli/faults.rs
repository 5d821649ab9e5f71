//! What goes wrong around the program: disks, memory, interruptions. Output files appear whole or not at all.

use crate::{names, told};
use raykd::{Device, Error, KdTree};
use std::{
    fs,
    os::unix::process::ExitStatusExt as _,
    path::Path,
    process::{Command, Output, Stdio},
    thread,
    time::Duration,
};
use tempfile::TempDir;

/// The program after shell commands that limit it; `{}` in the line is a folder's path.
fn limited(limits: &str, line: &str, folder: &TempDir) -> Output {
    let line = line.replace("{}", folder.path().to_str().unwrap());
    let script = format!("{limits}; exec '{}' {line}", env!("CARGO_BIN_EXE_raykd"));
    Command::new("bash").args(["-c", &script]).stdin(Stdio::null()).output().unwrap()
}

/// The commands that write files, each to `out`.
const WRITERS: [&str; 3] = [
    "build teapot -o {}/out --device cpu",
    "render teapot -o {}/out.png --size 200x200 --device cpu",
    "trace teapot --rays {}/rays --hits {}/out --device cpu",
];

fn with_rays() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rays = raykd::rays::random(([-9.0; 3], [9.0; 3]), 20_000, 1);
    fs::write(folder.path().join("rays"), bytemuck::cast_slice::<_, u8>(&rays)).unwrap();
    folder
}

/// Where no more can be written, as on a full disk, the old file stays.
#[test]
fn a_limit_of_file_sizes_is_an_error() {
    let folder = with_rays();
    for line in WRITERS {
        let name = if line.contains("png") { "out.png" } else { "out" };
        let file = folder.path().join(name);
        fs::write(&file, "old").unwrap();
        // No file may grow beyond so many KiB; whoever tries is sent a signal, which may be ignored.
        for limit in ["ulimit -f 0", "ulimit -f 8", "trap '' XFSZ; ulimit -f 0", "trap '' XFSZ; ulimit -f 8"]
        {
            let output = limited(limit, line, &folder);
            let message = told(&output);
            assert_eq!(output.status.code(), Some(1), "{limit}; {line}: {message}");
            assert!(message.contains(name) && message.contains("too large"), "{limit}; {line}: {message}");
            assert_eq!(fs::read(&file).unwrap(), b"old");
            assert!(
                names(folder.path()).iter().all(|name| !name.starts_with(".raykd")),
                "{:?}",
                names(folder.path())
            );
        }
        fs::remove_file(&file).unwrap();
    }
}

#[test]
fn devices_and_links_are_written_to_and_not_replaced() {
    let folder = with_rays();
    let before = fs::metadata("/dev/full").unwrap().file_type();
    let output = limited(":", "build teapot -o /dev/full --device cpu", &folder);
    assert_eq!(output.status.code(), Some(1));
    assert!(told(&output).contains("No space left on device"), "{}", told(&output));
    assert_eq!(fs::metadata("/dev/full").unwrap().file_type(), before);

    let [link, target] = ["link", "target"].map(|name| folder.path().join(name));
    fs::write(&target, "old").unwrap();
    std::os::unix::fs::symlink(&target, &link).unwrap();
    assert!(limited(":", "build teapot -o {}/link --device cpu", &folder).status.success());
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    KdTree::load(&target).unwrap();
}

#[test]
fn interrupted_runs_leave_whole_files_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let tree = folder.path().join("tree");
    let mut whole = 0;
    for (i, signal) in ["INT", "TERM", "KILL"].iter().cycle().take(12).enumerate() {
        let mut child = Command::new(env!("CARGO_BIN_EXE_raykd"))
            .args(["build", "teapot:12", "--device", "cpu", "-o"])
            .arg(&tree)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        thread::sleep(Duration::from_millis(10 * i as u64));
        let _ = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status();
        child.wait().unwrap();
        if tree.exists() {
            KdTree::load(&tree).unwrap();
            whole += 1;
            fs::remove_file(&tree).unwrap();
        }
    }
    assert!(whole < 12, "no run was interrupted");
}

#[test]
fn too_little_memory_is_told_and_nothing_is_written() {
    let folder = with_rays();
    let few = raykd::rays::random(([-9.0; 3], [9.0; 3]), 30, 1);
    fs::write(folder.path().join("few"), bytemuck::cast_slice::<_, u8>(&few)).unwrap();
    for megabytes in [64, 128, 256] {
        let limits = format!("ulimit -v {}", megabytes << 10);
        let output = limited(&limits, "build teapot:300 -o {}/out --device cpu --threads 1", &folder);
        assert!(!output.status.success(), "{megabytes} MB were enough");
        assert!(told(&output).contains("memory"), "{megabytes} MB: {}", told(&output));
        assert!(!Path::new(&folder.path().join("out")).exists());
        // These may be enough here.
        for line in [
            "trace teapot:60 --rays {}/few --device cpu --query all --limit 65536 --hits {}/out.png",
            "render teapot:60 --device cpu --size 2000x2000 -o {}/out.png",
        ] {
            let output = limited(&limits, line, &folder);
            let message = told(&output).to_lowercase();
            let words = ["memory", "threads", "resource temporarily unavailable"];
            let said = words.iter().any(|word| message.contains(word));
            assert!(output.status.success() || said, "{megabytes} MB: {message}");
            // Nothing but success, an error, or Rust's own end where a list cannot grow.
            assert!(matches!(output.status.signal(), None | Some(6)), "{megabytes} MB: {}", output.status);
            assert_eq!(folder.path().join("out.png").exists(), output.status.success(), "{megabytes} MB");
            fs::remove_file(folder.path().join("out.png")).ok();
        }
    }
}

/// A software driver's memory is the machine's. How much it takes for itself is its own affair, so limits are
/// tried, rising.
#[test]
#[cfg(feature = "gpu")]
fn too_little_memory_on_a_gpu_is_told_and_nothing_is_written() {
    let folder = with_rays();
    for megabytes in (600..4000).step_by(100) {
        let limits = format!("ulimit -v {}", megabytes << 10);
        let output = limited(&limits, "build teapot:110 -o {}/out --device gpu", &folder);
        assert!(
            !output.status.success(),
            "{megabytes} MB were enough, and less was never said to be too little"
        );
        assert!(!Path::new(&folder.path().join("out")).exists());
        if told(&output).contains("out of memory: no room for") {
            return;
        }
    }
    panic!("never enough memory, nor too little");
}

#[test]
fn a_buffer_that_no_machine_has_room_for_is_an_error() {
    let error = Device::cpu().alloc::<u8>("everything", 1 << 46).unwrap_err();
    assert!(matches!(error, Error::OutOfMemory { .. } | Error::TooLarge { .. }), "{error}");
    assert!(error.to_string().contains("everything"), "{error}");
}
