//! Files that the program writes: never over what it reads, whole or not at all, with the mode and the owner of what
//! was there, and nothing left behind.

use crate::{names, told, within as raykd};
use flate2::{Compression, write::GzEncoder};
use raykd::KdTree;
use std::{
    fs::{self, Permissions},
    io::{BufRead as _, BufReader, Read as _, Write as _},
    os::unix::{
        fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _, chown, symlink},
        process::{CommandExt as _, ExitStatusExt as _},
    },
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};
use tempfile::TempDir;

const HANGUP: i32 = 1;
const INTERRUPT: i32 = 2;
const QUIT: i32 = 3;
const TERMINATE: i32 = 15;

/// The message of a command that fails.
fn refused(command: Command) -> String {
    refused_by(1, command)
}

fn refused_by(code: i32, mut command: Command) -> String {
    let output = command.output().unwrap();
    let message = told(&output);
    assert_eq!(output.status.code(), Some(code), "{command:?}: {message}");
    assert!(message.contains("error: "), "{message}");
    message
}

fn succeeds(mut command: Command) {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", told(&output));
}

/// A folder with a mesh, its tree, rays at it and costs.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    fs::write(file("m.obj"), "v 0 0 0\nv 4 0 0\nv 0 4 0\nf 1 2 3\n").unwrap();
    let rays = raykd::rays::random(([0.0; 3], [4.0, 4.0, 0.0]), 100, 1);
    fs::write(file("rays"), bytemuck::cast_slice::<_, u8>(&rays)).unwrap();
    fs::write(file("costs.json"), "{}").unwrap();
    fs::write(
        file("m.gltf"),
        r#"{"asset": {"version": "2.0"}, "buffers": [{"uri": "m.bin", "byteLength": 36}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}"#,
    )
    .unwrap();
    fs::write(file("m.bin"), bytemuck::cast_slice::<f32, u8>(&[0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0, 0.0]))
        .unwrap();
    succeeds(raykd(&folder, "build m.obj -o m.kd --device cpu"));
    folder
}

#[test]
fn an_output_that_is_an_input_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let cases = [
        ("m.obj", "build m.obj -o {}", "as the mesh", "-o"),
        ("costs.json", "build m.obj --quality auto --costs costs.json -o {}", "by --costs", "-o"),
        ("m.obj", "trace m.obj --rays rays --hits {}", "as the mesh", "--hits"),
        ("rays", "trace m.obj --rays rays --hits {}", "by --rays", "--hits"),
        ("m.kd", "trace m.obj --rays rays --tree m.kd --hits {}", "by --tree", "--hits"),
        (
            "costs.json",
            "trace m.obj --rays rays --quality auto --costs costs.json --hits {}",
            "by --costs",
            "--hits",
        ),
        ("m.bin", "build m.gltf -o {}", "as a buffer of the mesh", "-o"),
        ("m.png", "render m.png -o {}", "as the mesh", "-o"),
        ("costs.png", "render m.obj --quality auto --costs costs.png -o {}", "by --costs", "-o"),
        ("index.html", "chart index.html -o .", "as the mesh", "-o"),
        ("1-a.svg", "chart 1-a.svg -o .", "as the mesh", "-o"),
        ("2-peers.csv", "chart --peers 2-peers.csv -o .", "by --peers", "-o"),
    ];
    for (input, line, read, written) in cases {
        if !at(input).exists() {
            fs::copy(at("m.obj"), at(input)).unwrap();
        }
        let before = fs::read(at(input)).unwrap();
        let ending = Path::new(input).extension().map_or_else(String::new, |e| format!(".{}", e.display()));
        let [soft, softer, hard] = ["soft", "softer", "hard"].map(|name| format!("{name}{ending}"));
        symlink(input, at(&soft)).unwrap();
        symlink(&soft, at(&softer)).unwrap();
        fs::hard_link(at(input), at(&hard)).unwrap();
        for output in [
            input.to_owned(),
            format!("./{input}"),
            at(input).display().to_string(),
            format!("../{}/{input}", folder.path().file_name().unwrap().display()),
            soft.clone(),
            softer.clone(),
            hard.clone(),
        ] {
            let message = refused(raykd(&folder, &format!("{} --device cpu", line.replace("{}", &output))));
            // With another name its own follows it: "soft, the same file as m.obj, would be both".
            let comma = if line.contains("{}") && output == input { "" } else { "," };
            let roles = format!("{input}{comma} would be both read {read} and written by {written}; name");
            assert!(message.contains(&roles), "{line} onto {output}: {message}");
            assert_eq!(fs::read(at(input)).unwrap(), before, "{line} onto {output}");
        }
        for link in [soft, softer, hard] {
            fs::remove_file(at(&link)).unwrap();
        }
    }
}

/// With `-` other programs mean standard output.
#[test]
fn an_output_called_as_standard_output_is_refused() {
    let folder = folder();
    let lines = [
        "build m.obj -o -",
        "trace m.obj --rays rays --hits -",
        "rays m.obj random -o -",
        "chart m.obj -o -",
    ];
    for line in lines {
        let message = refused(raykd(&folder, &format!("{line} --device cpu")));
        let (what, _) = message.split_once(" '-' write ./-").expect("a remedy");
        assert!(what.contains("not to standard output; for a "), "{line}: {message}");
        assert!(!folder.path().join("-").exists(), "{line}");
    }
    succeeds(raykd(&folder, "rays m.obj random -o ./- --device cpu"));
    assert!(folder.path().join("-").exists());
}

/// A glTF file is known by what is in it, whatever it is called and however it is packed.
#[test]
fn an_output_that_is_a_buffer_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let text = fs::read(at("m.gltf")).unwrap();
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&text).unwrap();
    let packed = packed.finish().unwrap();
    let marked = [b"\xef\xbb\xbf", &text[..]].concat();
    let before = fs::read(at("m.bin")).unwrap();
    let files = [
        ("m.gltf.gz", &packed),
        ("packed.gltf", &packed),
        ("unnamed", &text),
        ("m.json", &text),
        ("mark", &marked),
    ];
    for (name, bytes) in files {
        fs::write(at(name), bytes).unwrap();
        for least in [String::new(), format!(" --max-bytes {}", text.len() + 39)] {
            succeeds(raykd(&folder, &format!("rays {name} random -o new --device cpu{least}")));
            let message =
                refused(raykd(&folder, &format!("rays {name} random -o m.bin --device cpu{least}")));
            assert!(
                message.contains("m.bin would be both read as a buffer of the mesh and written"),
                "{message}"
            );
            assert_eq!(fs::read(at("m.bin")).unwrap(), before, "{name}");
        }
    }
}

/// What is printed may be seen on a terminal, whose cursor a name could move.
#[test]
fn names_of_files_are_printed_without_control_characters() {
    let folder = folder();
    let name = "\u{1b}[31mred\u{7}";
    let at = |name: &str| folder.path().join(name);
    fs::copy(at("m.obj"), at(&format!("{name}.obj"))).unwrap();
    fs::copy(at("rays"), at(name)).unwrap();
    fs::write(at(&format!("{name}.txt")), "1,1,1\n").unwrap();
    for line in [
        "bench NAME.obj --device cpu",
        "build NAME.obj -o NAME.kd --device cpu",
        "build NAME.obj --compare --device cpu",
        "trace NAME.obj --rays NAME --hits NAME.hits --device cpu",
        "trace NAME.obj --compare --device cpu",
        "rays NAME.obj random -o NAME.npy --device cpu",
        "inside NAME.obj --points NAME.txt -o NAME.csv --device cpu",
        "check NAME.obj",
        "voxels NAME.obj --size 4 -o NAME.npy --device cpu",
        "render NAME.obj -o NAME.png --size 8x8 --device cpu",
        "stress --scene NAME.obj --rays 10 --method exact/stack --device cpu",
    ] {
        let output = raykd(&folder, &line.replace("NAME", name)).output().unwrap();
        let printed = String::from_utf8(output.stdout.clone()).unwrap() + &told(&output);
        assert!(printed.contains("\u{fffd}[31mred\u{fffd}"), "{line}: {printed:?}");
        assert!(!printed.contains(|c: char| c.is_control() && c != '\n'), "{line}: {printed:?}");
    }
}

/// A pipe is read once, so that nobody knows before which files it names.
#[test]
fn meshes_come_out_of_pipes() {
    let folder = folder();
    let shell = |script: &str| {
        let mut command = Command::new("timeout");
        command.args(["60", "bash", "-c", &script.replace("raykd", env!("CARGO_BIN_EXE_raykd"))]);
        command.current_dir(&folder);
        command
    };
    let bytes = fs::read(folder.path().join("m.bin")).unwrap();
    let data = bytes.iter().map(|byte| format!("%{byte:02x}")).collect::<String>();
    let text = fs::read_to_string(folder.path().join("m.gltf")).unwrap();
    fs::write(folder.path().join("whole.gltf"), text.replace("m.bin", &format!("data:,{data}"))).unwrap();
    for (pipe, file) in [("p.gltf", "whole.gltf"), ("p.glb", "whole.gltf"), ("p", "m.obj")] {
        let line = format!("rays {pipe} random -o new --device cpu");
        succeeds(shell(&format!("mkfifo {pipe}; cat {file} > {pipe} & exec raykd {line}")));
    }
    let message =
        refused(shell("mkfifo q.gltf; cat m.gltf > q.gltf & exec raykd rays q.gltf random -o m.bin"));
    assert!(
        message.contains("it is the file 'm.bin', which bytes in memory or from a pipe cannot name"),
        "{message}"
    );
}

#[test]
fn what_is_printed_does_not_go_to_an_input_or_output_either() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let onto = |file: &str, line: &str| {
        let mut command = raykd(&folder, line);
        command.stdout(fs::OpenOptions::new().append(true).create(true).open(at(file)).unwrap());
        refused(command)
    };
    let before = fs::read(at("m.obj")).unwrap();
    for line in [
        "bench m.obj --json --device cpu",
        "bench m.obj --device cpu",
        "build m.obj --json --device cpu",
        "build m.obj",
        "stress --scene m.obj",
        "render m.obj -o a.png",
    ] {
        let message = onto("m.obj", line);
        assert!(
            message.contains("m.obj would be both read as the mesh and written as standard output"),
            "{line}: {message}"
        );
        assert_eq!(fs::read(at("m.obj")).unwrap(), before, "{line}");
    }
    let message = onto("hits", "trace m.obj --rays rays --hits hits --device cpu");
    assert!(
        message.contains("hits would be both written as standard output and written by --hits"),
        "{message}"
    );
    // Devices take both.
    let mut both = raykd(&folder, "trace m.obj --rays rays --hits /dev/null --device cpu");
    both.stdout(Stdio::null());
    succeeds(both);
}

/// Starts a command that writes a file of 180 MB, and waits until it is about it.
fn writing(folder: &TempDir, shell: &str) -> Child {
    let rays = raykd::rays::random(([-9.0; 3], [9.0; 3]), 700, 1);
    fs::write(folder.path().join("many"), bytemuck::cast_slice::<_, u8>(&rays)).unwrap();
    let line = "trace teapot:1 --rays many --hits hits --query all --limit 16384 --device cpu";
    let child = Command::new("bash")
        .args(["-c", &format!("{shell} exec '{}' {line}", env!("CARGO_BIN_EXE_raykd"))])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begun = || {
        let entries = fs::read_dir(folder.path()).unwrap().flatten();
        let temporary = |e: &fs::DirEntry| e.file_name().as_encoded_bytes().starts_with(b".raykd-");
        entries.filter(temporary).any(|e| e.metadata().is_ok_and(|it| it.len() > 0))
    };
    let start = Instant::now();
    while !begun() {
        assert!(start.elapsed() < Duration::from_secs(120), "nothing was written");
        thread::sleep(Duration::from_millis(1));
    }
    child
}

fn send(signal: i32, child: &Child) {
    let sent = Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn signals_in_the_middle_of_a_write_leave_nothing() {
    let folder = folder();
    let whole = 700 * 16384 * 16;
    let mut stopped = 0;
    for signal in [HANGUP, INTERRUPT, QUIT, TERMINATE] {
        fs::write(folder.path().join("hits"), "old").unwrap();
        let child = writing(&folder, "ulimit -c 0;");
        send(signal, &child);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.signal(), Some(signal), "{}", told(&output));
        // Whoever was too late finds the new file, and all of it.
        let length = fs::metadata(folder.path().join("hits")).unwrap().len();
        assert!(length == 3 || length == whole, "{length} bytes");
        stopped += usize::from(length == 3);
        let left = names(folder.path());
        assert_eq!(left, ["costs.json", "hits", "m.bin", "m.gltf", "m.kd", "m.obj", "many", "rays"]);
    }
    assert!(stopped > 0, "no write was interrupted");
}

#[test]
fn signals_that_are_to_be_ignored_are() {
    let folder = folder();
    let child = writing(&folder, "trap '' HUP;");
    send(HANGUP, &child);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    assert_eq!(fs::metadata(folder.path().join("hits")).unwrap().len(), 700 * 16384 * 16);
}

#[test]
fn mode_and_owner_stay() {
    let folder = folder();
    let out = folder.path().join("out");
    let build = || raykd(&folder, "build m.obj -o out --device cpu");
    succeeds(build());
    let usual = fs::metadata(&out).unwrap().permissions().mode() & 0o777;
    assert_eq!(usual & 0o600, 0o600, "{usual:o}");
    for mode in [0o600, 0o640, 0o644, 0o666, 0o700, 0o755, 0o620, 0o777] {
        for owner in [None, Some((1234, 2345))] {
            fs::write(&out, "old").unwrap();
            // Only root can give files away.
            if owner.is_some_and(|(user, group)| chown(&out, Some(user), Some(group)).is_err()) {
                continue;
            }
            fs::set_permissions(&out, Permissions::from_mode(mode)).unwrap();
            let seen = || fs::metadata(&out).map(|it| (it.mode(), it.uid(), it.gid())).unwrap();
            let before = seen();
            succeeds(build());
            assert_eq!(seen(), before, "{mode:o} {owner:?}");
            KdTree::load(&out).unwrap();
            fs::remove_file(&out).unwrap();
        }
    }
}

#[test]
fn what_must_not_be_replaced_is_not() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    for fixed in ["fixed.png", "c/index.html"] {
        fs::create_dir_all(at("c")).unwrap();
        fs::write(at(fixed), "old").unwrap();
        fs::set_permissions(at(fixed), Permissions::from_mode(0o444)).unwrap();
    }
    for (to, link) in [
        ("nowhere", "dangling.png"),
        ("loop.png", "loop.png"),
        ("../nowhere", "charts/index.html"),
        ("nowhere", "figures/1-accuracy.svg"),
        ("nowhere", "gone"),
    ] {
        fs::create_dir_all(at(link).parent().unwrap()).unwrap();
        symlink(to, at(link)).unwrap();
    }
    fs::create_dir_all(at("folder.png")).unwrap();
    fs::create_dir_all(at("d/index.html")).unwrap();
    let inside = ["", "c", "charts", "figures", "d", "folder.png"];
    let before = inside.map(|folder| names(&at(folder)));
    let (long, deep) = (format!("{}.png", "n".repeat(300)), "deep/".repeat(2000) + "out.png");
    for (place, why) in [
        ("fixed.png", "fixed.png: the file is read-only"),
        ("dangling.png", "dangling.png: this is a link to a file that does not exist"),
        ("loop.png", "loop.png: "),
        ("new.png/", "new.png/: this names no file"),
        ("none/..", "none/..: "),
        ("folder.png", "folder.png"),
        ("none/out.png", "none/out.png"),
        ("m.obj/out.png", "m.obj/out.png"),
        // Not even root can make files there.
        ("/proc/out.png", "/proc/out.png"),
        ("/sys/out.png", "/sys/out.png"),
        ("/dev/null/out.png", "/dev/null/out.png"),
        (".", ""),
        ("..", ""),
        ("/", ""),
        (&long, ""),
        (&deep, ""),
    ] {
        for line in ["build none.obj -o", "trace none.obj --rays rays --hits", "render none.obj -o"] {
            // A picture's name is looked at first: what ends in no .png is wrong usage.
            let (code, why) = if line.starts_with("render") && Path::new(place).extension().is_none() {
                (2, "pictures are PNG files")
            } else {
                (1, why)
            };
            let message = refused_by(code, raykd(&folder, &format!("{line} {place}")));
            assert!(message.contains(why), "{line} {place}: {message}");
            assert!(!message.contains("none.obj"), "{line} {place} read the mesh first: {message}");
        }
    }
    assert_eq!(raykd(&folder, "build none.obj -o ").output().unwrap().status.code(), Some(2));
    for (place, why) in [
        ("charts", "index.html: this is a link to a file that does not exist"),
        ("fixed.png", "fixed.png: not a directory"),
        ("gone", "gone: "),
        ("none/charts", "none/charts: there is no such folder"),
        ("/proc/charts", "/proc/charts"),
        ("m.obj", "m.obj: not a directory"),
        ("c", "index.html: the file is read-only"),
        ("figures", "1-accuracy.svg: this is a link to a file that does not exist"),
        ("d", "index.html"),
    ] {
        let message = refused(raykd(&folder, &format!("chart none.obj -o {place}")));
        assert!(message.contains(why), "{place}: {message}");
        assert!(!message.contains("none.obj"), "{place}: the mesh was read first: {message}");
    }
    assert_eq!(fs::read(at("fixed.png")).unwrap(), b"old");
    assert_eq!(inside.map(|folder| names(&at(folder))), before);
}

#[test]
fn devices_and_pipes_are_written_to() {
    let folder = folder();
    succeeds(raykd(&folder, "build m.obj --device cpu -o /dev/null"));
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    let mut full = raykd(&folder, "build m.obj --json --device cpu");
    full.stdout(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    assert!(refused(full).contains("No space left"));
    for asks in ["--help", "--version", "help build", "trace -h"] {
        let mut full = raykd(&folder, asks);
        full.stdout(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
        assert!(refused(full).contains("No space left"), "{asks}");
    }
    let shell = |script: &str| {
        let mut command = Command::new("bash");
        command.args(["-c", &script.replace("raykd", env!("CARGO_BIN_EXE_raykd"))]).current_dir(&folder);
        command
    };
    let pipe =
        "mkfifo p && (cat p > seen &) && raykd build m.obj --device cpu -o p && sleep 0.2 && test -p p";
    succeeds(shell(pipe));
    KdTree::load(folder.path().join("seen")).unwrap();
    let gone = "mkdir gone && cd gone && rmdir ../gone && exec raykd build teapot:1 --device cpu -o out";
    assert!(refused(shell(gone)).contains("out"));
}

/// Somebody else who may write into a folder cannot keep the owner of the files there.
#[test]
fn files_of_others_are_not_replaced() {
    let folder = folder();
    // So that they can come in, and start the program.
    let program = folder.path().join("raykd");
    fs::copy(env!("CARGO_BIN_EXE_raykd"), &program).unwrap();
    for (mode, folder_mode, why) in [
        (0o644, 0o777, "ermission denied"),
        (0o666, 0o777, "owner and group could not be kept"),
        (0o444, 0o777, "out"),
        (0o666, 0o1777, "out"),
        (0o666, 0o755, "out"),
        (0o600, 0o755, "out"),
    ] {
        let out = folder.path().join("out");
        fs::set_permissions(folder.path(), Permissions::from_mode(folder_mode)).unwrap();
        fs::write(&out, "old").unwrap();
        fs::set_permissions(&out, Permissions::from_mode(mode)).unwrap();
        let mut command = Command::new(&program);
        command
            .args(["build", "m.obj", "--device", "cpu", "-o", "out"])
            .current_dir(&folder)
            .uid(65534)
            .gid(65534);
        match command.output() {
            // Not root, so that nobody else can be played.
            Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::PermissionDenied),
            Ok(output) => {
                assert_eq!(output.status.code(), Some(1), "{}", told(&output));
                assert!(told(&output).contains(why), "{}", told(&output));
            }
        }
        assert_eq!(fs::read(&out).unwrap(), b"old");
        assert!(names(folder.path()).iter().all(|name| !name.starts_with(".raykd")));
    }
}

#[test]
fn an_interrupted_chart_leaves_no_folder() {
    let folder = folder();
    let before = names(folder.path());
    let mut child = raykd(&folder, "chart teapot:2 --quick --device cpu --threads 1 -o charts")
        .env("RAYKD_CACHE", folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    thread::sleep(Duration::from_millis(500));
    send(TERMINATE, &child);
    assert_eq!(child.wait().unwrap().signal(), Some(TERMINATE));
    assert_eq!(names(folder.path()), before);
}

#[test]
fn costs_that_cannot_be_kept_are_measured_all_the_same() {
    let folder = folder();
    // Not even root can make files there.
    let mut child = raykd(&folder, "build m.obj --quality auto --device cpu --threads 1")
        .env("RAYKD_CACHE", "/proc/nowhere")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It is told before anything is measured, which takes long: nobody waits for that.
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let [first, second, third] = [(); 3].map(|()| lines.next().map_or_else(String::new, Result::unwrap));
    let going_on = child.try_wait().unwrap().is_none();
    send(TERMINATE, &child);
    child.wait().unwrap();
    assert!(
        first.contains("note: costs cannot be kept: /proc/nowhere") && first.contains("RAYKD_CACHE"),
        "{first}"
    );
    assert!(second.contains("measuring what trees cost on this CPU, for this run"), "{second}");
    // And then from time to time how far that is.
    assert!(third.contains(" s: measuring what trees cost on the CPU, "), "{third}");
    assert!(going_on);
    // But whoever wants them kept hears it at once.
    let mut calibrate = raykd(&folder, "calibrate --device cpu");
    calibrate.env("RAYKD_CACHE", "/proc/nowhere");
    let told = refused(calibrate);
    assert!(told.contains("/proc/nowhere") && told.contains("RAYKD_CACHE"), "{told}");
    let mut homeless = raykd(&folder, "calibrate --device cpu");
    homeless.env_remove("RAYKD_CACHE").env_remove("XDG_CACHE_HOME").env_remove("HOME");
    let told = refused(homeless);
    assert!(told.contains("no folder to keep it in") && !told.contains("measures anew"), "{told}");
    assert_eq!(told.matches("RAYKD_CACHE").count(), 1, "{told}");
}

#[test]
fn messages_quote_little() {
    let folder = folder();
    let long = "x".repeat(100_000);
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("string.json", &format!("\"{long}\""));
    write("rows.json", &format!("[{{\"scene\": 1, \"{long}\": 2}}]"));
    let version = format!(r#"{{"version":"{long}","device":"cpu","name":"","looks":[],"costs":[]}}"#);
    write("version.json", &version);
    let name = format!(
        r#"{{"version":"{}","device":"cpu","name":"{long}","looks":[],"costs":[]}}"#,
        env!("CARGO_PKG_VERSION")
    );
    write("name.json", &name);
    for line in [
        "build LONG",
        "build LONG.obj",
        "build m.obj -o LONG",
        "build m.obj --device LONG",
        "build m.obj --cost-step LONG",
        "build m.obj --LONG",
        "LONG",
        "build m.obj --adapter LONG",
        "render m.obj -o LONG.jpg",
        "render m.obj -o a.png --size LONG",
        "trace m.obj --rays LONG --hits h",
        "trace m.obj --rays rays --hits h --tree LONG",
        "stress --scene LONG",
        "stress --method LONG",
        "stress --replay string.json",
        "stress --replay rows.json",
        "bench --compare-with string.json",
        "bench --compare-with rows.json",
        "chart --peers string.json",
        "chart --peers rows.json",
        "build m.obj --quality auto --device cpu --costs string.json",
        "build m.obj --quality auto --device cpu --costs version.json",
        "build m.obj --quality auto --device cpu --costs name.json",
        "calibrate --check LONG",
    ] {
        let output = raykd(&folder, &line.replace("LONG", &long)).output().unwrap();
        let message = told(&output);
        assert!(!output.status.success() && message.contains("error: "), "{line}: {message}");
        let quoted = message.split(|c| c != 'x').map(str::len).max();
        assert!(quoted <= Some(200), "{line} quotes {quoted:?} characters");
        assert!(message.len() < 2000, "{line} tells {} bytes", message.len());
    }
    // Nothing that a file says moves the cursor.
    write("escape.json", "\"\u{1b}[2Jgone\"");
    assert!(!refused(raykd(&folder, "bench --compare-with escape.json")).contains('\u{1b}'));
}

/// The most memory that a process ever had, in bytes.
#[cfg(target_os = "linux")]
fn peak(child: &mut Child) -> u64 {
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut most = 0;
    while child.try_wait().unwrap().is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        most = most.max(kilobytes.unwrap_or(0) << 10);
        thread::sleep(Duration::from_millis(2));
    }
    most
}

#[test]
#[cfg(target_os = "linux")]
fn all_hits_take_little_more_memory_than_their_file() {
    let folder = folder();
    let rays = raykd::rays::random(([-9.0; 3], [9.0; 3]), 60_000, 1);
    fs::write(folder.path().join("many"), bytemuck::cast_slice::<_, u8>(&rays)).unwrap();
    let run = |limit: u32| {
        let line = format!(
            "trace teapot:1 --rays many --hits hits --query all --limit {limit} --device cpu --threads 1"
        );
        let mut child = raykd(&folder, &line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let most = peak(&mut child);
        let mut message = String::new();
        child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
        assert!(child.wait().unwrap().success(), "{message}");
        most
    };
    let (little, much) = (run(1), run(256));
    let written = fs::metadata(folder.path().join("hits")).unwrap().len();
    assert_eq!(written, 60_000 * 256 * 16);
    let times = (much - little) as f64 / written as f64;
    println!("{times:.2} times the {written} bytes written");
    assert!(times > 0.5, "{times:.2}: it was not seen");
    assert!(times < 1.5, "{times:.2}");
}
