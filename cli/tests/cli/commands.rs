//! The program `raykd` from outside: what it prints, writes and exits with. Needs a Vulkan adapter; a software
//! one will do (Debian: mesa-vulkan-drivers).

use crate::{command, picture, raykd, text};
use raykd::{
    BuildOptions, Device, Hit, Intersector, Mesh, Ray, Scene, Traversal,
    internals::hits_digest,
    rays::{self, Camera},
};
use serde_json::Value;
use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};
use tempfile::TempDir;

/// Keys of `raykd bench --json` that other things rely on.
const BENCH_KEYS: &str = "\
    traversal intersector scene triangles device adapter load_ms upload_ms build_ms trace_ms download_ms mrays \
    rays nodes leaves depth refs_per_triangle tree_bytes peak_bytes sah_cost digest hits_digest mrays_a mrays_b \
    mrays_c mrays_d mrays_d_any sets_digest";

/// Keys of `raykd trace --compare --json`, all of them.
const COMPARE_KEYS: &str = "\
    traversal device mrays_primary mrays_diffuse mrays_shadow steps_mean steps_p50 steps_p99 steps_max \
    leaves_p50 tests_p50 restarts state_bytes tree_bytes hits_digest";

/// Standard output of a command that succeeds.
fn good(line: &[&str]) -> String {
    let output = raykd(line);
    assert!(output.status.success(), "{line:?}: {}", text(&output.stderr));
    text(&output.stdout).to_owned()
}

fn json(line: &[&str]) -> Value {
    serde_json::from_str(&good(line)).unwrap()
}

/// The message of a command that fails with this exit code, and prints nothing else.
fn bad(line: &[&str], code: i32) -> String {
    let output = raykd(line);
    assert_eq!(output.status.code(), Some(code), "{line:?}: {}", text(&output.stderr));
    assert_eq!(text(&output.stdout), "", "{line:?}");
    let message = text(&output.stderr).to_owned();
    assert!(message.contains("error: "), "{line:?}: {message}");
    message
}

fn has(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "'{word}' is missing in: {message}");
    }
}

/// A folder with a mesh of two triangles: z = 0 and, above it, z = 1.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mesh = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 1\nv 4 0 1\nv 0 4 1\nf 1 2 3\nf 4 5 6\n";
    fs::write(folder.path().join("two.obj"), mesh).unwrap();
    folder
}

fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_str().unwrap().to_owned()
}

fn write_rays(path: &str, rays: &[[f32; 8]]) {
    let bytes: Vec<u8> = rays.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(path, bytes).unwrap();
}

/// A hit: the triangle; t, u and v.
type Record = (u32, [f32; 3]);

fn read_hits(path: &str) -> Vec<Record> {
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes.len() % 16, 0);
    let word = |bytes: &[u8]| <[u8; 4]>::try_from(bytes).unwrap();
    let record = |r: &[u8]| {
        let float = |i: usize| f32::from_le_bytes(word(&r[4 * i..4 * i + 4]));
        (u32::from_le_bytes(word(&r[..4])), [float(1), float(2), float(3)])
    };
    bytes.chunks(16).map(record).collect()
}

const INFINITY: f32 = f32::INFINITY;
const MISS: Record = (u32::MAX, [0.0; 3]);

/// Rays at the mesh of [`folder`], and what they meet, by hand.
fn known() -> ([[f32; 8]; 7], [Record; 7]) {
    let rays = [
        // Down on (1, 2): the upper triangle, a quarter of the way to its second corner, half to its third.
        [1.0, 2.0, 3.0, 0.0, 0.0, -1.0, 0.0, INFINITY],
        // Up from below: the lower one; t counts in lengths of the direction.
        [1.0, 1.0, -3.0, 0.0, 0.0, 2.0, 0.0, INFINITY],
        // From between them, down.
        [2.0, 1.0, 0.5, 0.0, 0.0, -1.0, 0.0, INFINITY],
        // Past the hypotenuse.
        [3.0, 3.0, 3.0, 0.0, 0.0, -1.0, 0.0, INFINITY],
        // Not far enough; then just far enough.
        [1.0, 1.0, 3.0, 0.0, 0.0, -1.0, 0.0, 1.5],
        [1.0, 1.0, 3.0, 0.0, 0.0, -1.0, 0.0, 2.0],
        // No ray at all.
        [f32::NAN, 1.0, 3.0, 0.0, 0.0, -1.0, 0.0, INFINITY],
    ];
    let hits = [
        (1, [2.0, 0.25, 0.5]),
        (0, [1.5, 0.25, 0.25]),
        (0, [0.5, 0.5, 0.25]),
        MISS,
        MISS,
        (1, [2.0, 0.25, 0.25]),
        MISS,
    ];
    (rays, hits)
}

/// An installed program has no checkout.
#[test]
fn scenes_are_found_here_above_and_in_the_users_data() {
    let (here, data, named) = (folder(), folder(), folder());
    fs::create_dir_all(here.path().join("work/deeper")).unwrap();
    let find = |variable: Option<&TempDir>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_raykd"));
        command.args(["check", "sponza", "--json"]).current_dir(here.path().join("work/deeper"));
        command.env_remove("RAYKD_SCENES").env("XDG_DATA_HOME", data.path());
        if let Some(folder) = variable {
            command.env("RAYKD_SCENES", folder.path());
        }
        let output = command.stdin(Stdio::null()).output().unwrap();
        let json: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        (json["triangles"].as_u64(), text(&output.stderr).to_owned())
    };
    let put = |folder: &Path, triangles: usize| {
        fs::create_dir_all(folder).unwrap();
        let mesh = "v 0 0 0\nv 4 0 0\nv 0 4 0\n".to_owned() + &"f 1 2 3\n".repeat(triangles);
        fs::write(folder.join("sponza.obj"), mesh).unwrap();
    };
    let users = data.path().join("raykd/scenes");
    has(&find(None).1, &["no sponza.obj in", users.to_str().unwrap(), "cargo xtask scenes", "--to FOLDER"]);
    put(&users, 1);
    assert_eq!(find(None).0, Some(1));
    // One that is empty hides nothing.
    fs::create_dir_all(here.path().join("work/scenes")).unwrap();
    put(&here.path().join("scenes"), 2);
    assert_eq!(find(None).0, Some(2));
    has(&find(Some(&named)).1, &["no sponza.obj in", named.path().to_str().unwrap()]);
    put(named.path(), 3);
    assert_eq!(find(Some(&named)).0, Some(3));
}

#[test]
fn help_has_examples() {
    let general = good(&["--help"]);
    for name in ["bench", "build", "trace", "render", "stress", "devices"] {
        has(&general, &[name, "Examples:", "Exit code"]);
        let help = good(&[name, "--help"]);
        has(&help, &["Usage: raykd", "Examples:", &format!("raykd {name}")]);
        assert_eq!(name == "devices", !help.contains("--adapter"));
    }
    has(
        &good(&["bench", "--help"]),
        &["--rays", "50000", "both", "--json", "--profile", "--threads", "ball light"],
    );
    has(&good(&["trace", "--help"]), &["0xFFFFFFFF", "little-endian", "file order", "--any", "--tree"]);
    has(&good(&["render", "--help"]), &["normal", "depth", "heat", "id", "1024x1024", "--eye"]);
    has(&good(&["--version"]), &["raykd 0."]);
    for line in [&["help"] as &[&str], &["help", "--help"], &["help", "-h"]] {
        assert_eq!(good(line), general, "{line:?}");
    }
    assert_eq!(good(&["help", "bench", "--help"]), good(&["bench", "--help"]));
}

#[test]
fn wrong_usage_exits_with_2() {
    for line in [
        &["bench", "--device", "tpu"] as &[&str],
        &["bench", "--rays", "0"],
        &["bench", "--threads", "0"],
        &["build"],
        &["build", "teapot", "--device", "both"],
        &["build", "teapot", "--cost-step", "-1"],
        &["build", "teapot", "--device", "cpu", "--adapter", "x"],
        &["trace", "teapot", "--rays", "r"],
        &["render", "teapot", "-o", "a.png", "--size", "10"],
        &["render", "teapot", "-o", "a.png", "--target", "1,2,3"],
        &["render", "none.ply", "-o", "a.png", "--eye", "1,2,3", "--target", "1,2,3"],
        &["calibrate", "-o", "c.json"],
        &["calibrate", "-o", "c.json", "--device", "both"],
        &["walk"],
    ] {
        bad(line, 2);
    }
}

#[test]
fn errors_name_file_and_remedy() {
    let folder = folder();
    let file = |name: &str| path(&folder, name);
    has(&bad(&["build", &file("none.ply"), "--device", "cpu"], 1), &["none.ply", "No such file"]);
    has(&bad(&["build", "teapot", "--rays", "1.5"], 2), &["write a whole number from 1 to 1844"]);
    has(&bad(&["bench", "teepot", "--device", "cpu"], 1), &["teepot", "teapot", "dragon_res4", "sponza"]);

    let rays = file("rays");
    fs::write(&rays, [0; 63]).unwrap();
    let line = ["trace", &file("two.obj"), "--rays", &rays, "--hits", &file("hits"), "--device", "cpu"];
    has(&bad(&line, 1), &[&rays, "63 bytes", "32"]);
    fs::remove_file(&rays).unwrap();
    has(&bad(&line, 1), &[&rays, "No such file"]);
    assert!(!Path::new(&file("hits")).exists());

    let nowhere = file("nowhere/out.png");
    has(&bad(&["render", "teapot", "-o", &nowhere, "--device", "cpu"], 1), &[&nowhere, "no such folder"]);
    has(&bad(&["build", "teapot", "-o", &nowhere, "--device", "cpu"], 1), &[&nowhere, "no such folder"]);
    has(
        &bad(&["build", "teapot", "-o", &file(""), "--device", "cpu"], 1),
        &["this is a folder; name a file in it"],
    );
    has(&bad(&["render", "none.ply", "-o", "a.jpg"], 2), &["a.jpg: pictures are PNG", "like a.png\n"]);
    has(&bad(&["build", &file("")], 1), &["name a file in it (", ".ply"]);

    let none = bad(&["build", "teapot", "--adapter", "Voodoo 2"], 1);
    has(&none, &["Voodoo 2", "raykd devices", "mesa-vulkan-drivers"]);
}

#[test]
fn without_a_driver_gpu_is_an_error_and_bench_goes_on() {
    // A list of drivers that are not there.
    let without = |line: &[&str]| {
        let mut command = command(line);
        command.env("VK_DRIVER_FILES", "/nonexistent.json").env("VK_ICD_FILENAMES", "/nonexistent.json");
        command.output().unwrap()
    };
    let output = without(&["build", "teapot", "--device", "gpu"]);
    assert_eq!(output.status.code(), Some(1));
    has(text(&output.stderr), &["error: no Vulkan adapter", "apt install mesa-vulkan-drivers"]);
    assert_eq!(without(&["bench", "--device", "both"]).status.code(), Some(1));

    let output = without(&["bench", "--json", "--rays", "100"]);
    assert!(output.status.success());
    has(text(&output.stderr), &["note: ", "mesa-vulkan-drivers", "CPU alone"]);
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 1);
    assert!(rows[0]["identical"].is_null());

    let output = without(&["devices"]);
    assert!(output.status.success());
    has(text(&output.stdout), &["CPU  ", "(default)", "mesa-vulkan-drivers"]);
}

#[test]
fn bench_compares_both_devices() {
    let rows = json(&["bench", "--json", "--device", "both", "--rays", "5000"]);
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 2);
    for row in rows {
        for key in BENCH_KEYS.split_whitespace() {
            assert!(!row[key].is_null(), "{key}");
        }
        assert_eq!((&row["scene"], &row["triangles"]), (&"teapot".into(), &1024.into()));
        assert_eq!(row["rays"], 5000);
        for key in ["build_ms", "trace_ms", "upload_ms", "download_ms", "mrays", "sah_cost", "primary_mrays"]
        {
            assert!(row[key].as_f64().unwrap() > 0.0, "{key}");
        }
        let leaves = row["leaves"].as_u64().unwrap();
        assert!(row["nodes"].as_u64().unwrap() >= 2 * leaves - 1);
        assert_eq!(row["identical"], true);
    }
    assert_eq!((&rows[0]["device"], &rows[1]["device"]), (&"cpu".into(), &"gpu".into()));
    for key in ["digest", "hits_digest", "sets_digest", "nodes", "leaves", "depth", "tree_bytes", "sah_cost"]
    {
        assert_eq!(rows[0][key], rows[1][key], "{key}");
    }

    // The digests are those of the library.
    let (device, mesh) = (Device::cpu(), Mesh::teapot(4));
    let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
    let hits = scene.closest(&rays::random(mesh.bounds(), 5000, 2026)).unwrap();
    assert_eq!(rows[0]["digest"], scene.tree().unwrap().digest().as_str());
    assert_eq!(rows[0]["hits_digest"], hits_digest(&hits).as_str());
    assert_eq!(rows[0]["hits"], hits.iter().filter(|hit| hit.is_hit()).count());
}

#[test]
fn bench_prints_both_tables() {
    let told = good(&["bench", "teapot:1", "--rays", "1000", "--profile"]);
    has(&told, &["Build", "CPU ms", "GPU ms", "upload ms", "Travel", "Mray/s", "SAH cost", "dispatches"]);
    has(&told, &["teapot:1: CPU and GPU gave byte-identical trees and hits"]);
    has(&told, &["12 zero-area triangles kept out"]);
}

#[test]
fn one_device_has_nothing_to_compare() {
    let output =
        raykd(&["bench", "--json", "--device", "cpu", "--rays", "10", "--threads", "1", "--profile"]);
    assert!(output.status.success());
    // Results and remarks do not mix.
    assert_eq!(text(&output.stderr), "", "nothing to remark on the CPU");
    assert!(text(&output.stdout).starts_with("[\n"));
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 1);
    assert!(rows[0]["identical"].is_null());
    has(rows[0]["adapter"].as_str().unwrap(), &["1 thread"]);
    let many = std::thread::available_parallelism().unwrap().get() + 1;
    let output = raykd(&["build", "teapot:1", "--json", "--threads", &many.to_string()]);
    has(text(&output.stderr), &[&format!("note: --threads {many}: {} run at once here", many - 1)]);
    let too_many = (64 * (many - 1) + 1).to_string();
    let output = raykd(&["build", "teapot:1", "--threads", &too_many]);
    assert_eq!(output.status.code(), Some(2));
    has(text(&output.stderr), &["write a whole number from 1 to "]);
    assert!(rows[0]["kernels"].as_array().unwrap().iter().any(|kernel| kernel["name"] == "treelet"));
}

/// A mesh far off is moved: that is told, and rays, cameras and hits stay in its own coordinates.
#[test]
fn a_mesh_far_off_is_moved_and_that_is_told() {
    let folder = folder();
    let [mesh, rays, hits, picture] = ["far.obj", "rays", "hits", "far.png"].map(|name| path(&folder, name));
    let far = [4_500_000.003, -5_700_000.0, 0.0];
    let corner = |x: f64, y: f64| format!("v {} {} 0.1\n", far[0] + x, far[1] + y);
    let corners = [corner(0.0, 0.0), corner(0.01, 0.0), corner(0.0, 0.01)].concat();
    fs::write(&mesh, format!("{corners}f 1 2 3\n")).unwrap();
    let told = json(&["build", &mesh, "--device", "cpu", "--json"]);
    assert_eq!((&told["kept"], &told["repairs"]["zero_area"]), (&1.into(), &0.into()));
    let by: Vec<f64> = serde_json::from_value(told["repairs"]["translation"].clone()).unwrap();
    assert!((by[0] - far[0]).abs() < 0.02 && (by[1] - far[1]).abs() < 0.02 && by[2] != 0.0, "{by:?}");
    assert!(told["repairs"]["rounded"].as_u64().unwrap() > 0);
    let change = told["repairs"]["largest_change"].as_f64().unwrap();
    assert!(change > 0.0 && change < 1e-9, "{change}");
    has(
        &good(&["build", &mesh, "--device", "cpu"]),
        &["moved by -4500000.0", "coordinates rounded to 32-bit floats, by"],
    );

    // Rays in f64 down to a point inside, to one just outside, and past it all.
    let wide = [(0.004, 0.004), (0.006, 0.006), (-0.5, 0.25)]
        .map(|(x, y)| [far[0] + x, far[1] + y, 1.1, 0.0, 0.0, -1.0, 0.0, f64::INFINITY]);
    fs::write(&rays, wide.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()).unwrap();
    let line = ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--device", "cpu", "--json"];
    let told = json(&[&line[..], &["--f64"]].concat());
    assert_eq!((&told["rays"], &told["hits"], &told["invalid"]), (&3.into(), &1.into(), &0.into()));
    assert_eq!(told["repairs"]["translation"][0], by[0]);
    let found = read_hits(&hits);
    assert_eq!(found.iter().map(|hit| hit.0).collect::<Vec<_>>(), [0, u32::MAX, u32::MAX]);
    assert!(found[0].1.iter().zip([1.0, 0.4, 0.4]).all(|(x, y)| (x - y).abs() < 1e-3), "{found:?}");
    // A ray in f32 from where f32 reaches.
    write_rays(&rays, &[[4.5e6, -5.7e6, 1.1, 0.005, 0.003, -1.0, 0.0, 9.0]]);
    assert_eq!(json(&line)["hits"], 1);
    has(
        &bad(&[&line[..], &["--f64"]].concat(), 1),
        &["32 bytes are no whole number of rays of 64 bytes", "8 little-endian f64"],
    );

    let [eye, target] = [1.0, 0.1].map(|z| format!("{},{},{z}", far[0] + 0.003, far[1] + 0.003));
    let line = ["render", &mesh, "-o", &picture, "--eye", &eye, "--target", &target];
    let small = ["--fov", "0.2", "--size", "9x9", "--samples", "1", "--device", "cpu"];
    has(&good(&[&line[..], &small].concat()), &["81 of 81 rays hit"]);
}

#[test]
fn trace_gives_known_hits() {
    let folder = folder();
    let [mesh, rays, hits, tree] = ["two.obj", "rays", "hits", "tree"].map(|name| path(&folder, name));
    let (given, expected) = known();
    write_rays(&rays, &given);
    good(&["build", &mesh, "-o", &tree, "--device", "gpu"]);
    let mut digests = Vec::new();
    for more in [
        &["--device", "cpu", "--threads", "2"] as &[&str],
        &["--device", "gpu"],
        &["--device", "cpu", "--tree", &tree],
        &["--device", "gpu", "--tree", &tree],
        &["--device", "gpu", "--traversal", "wide"],
    ] {
        fs::remove_file(&hits).ok();
        let line = [&["trace", &mesh, "--rays", &rays, "--hits", &hits, "--json"], more].concat();
        let told = json(&line);
        assert_eq!(read_hits(&hits), expected, "{more:?}");
        assert_eq!((&told["rays"], &told["hits"], &told["invalid"]), (&7.into(), &4.into(), &1.into()));
        assert_eq!(told["device"], more[1]);
        for key in ["load_ms", "build_ms", "upload_ms", "trace_ms", "download_ms", "mrays", "adapter"] {
            assert!(!told[key].is_null(), "{key}");
        }
        assert_eq!(told["build_ms"] == 0.0, more.contains(&"--tree"));
        assert_eq!(told["prepare_ms"] == 0.0, !more.contains(&"wide"));
        digests.push((told["digest"].clone(), told["hits_digest"].clone()));
    }
    digests.dedup();
    assert_eq!(digests.len(), 1);
    let given: Vec<Hit> = bytemuck::pod_collect_to_vec(&fs::read(&hits).unwrap());
    assert_eq!(digests[0].1, hits_digest(&given).as_str());
}

#[test]
fn any_hit_finds_what_is_there() {
    let folder = folder();
    let [mesh, rays, hits] = ["two.obj", "rays", "hits"].map(|name| path(&folder, name));
    let (given, expected) = known();
    write_rays(&rays, &given);
    let told = good(&["trace", &mesh, "--rays", &rays, "--hits", &hits, "--any"]);
    has(&told, &["any query", "7 (4 hit)"]);
    for (any, closest) in read_hits(&hits).iter().zip(expected) {
        assert_eq!(any.0 == u32::MAX, closest.0 == u32::MAX);
    }
}

#[test]
fn hits_are_counted_and_listed() {
    let folder = folder();
    let [mesh, rays, hits] = ["two.obj", "rays", "hits"].map(|name| path(&folder, name));
    let (given, expected) = known();
    write_rays(&rays, &given);
    for device in ["cpu", "gpu"] {
        let line =
            ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--device", device, "--json", "--query"];
        let told = json(&[&line as &[&str], &["count"]].concat());
        let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&fs::read(&hits).unwrap());
        assert_eq!(told["total_hits"], counts.iter().sum::<u32>());
        assert_eq!((&told["hits"], &told["invalid"]), (&4.into(), &1.into()));
        for key in ["upload_ms", "trace_ms", "download_ms"] {
            assert!(told[key].as_f64() > Some(0.0), "{key}");
        }
        let told = json(&[&line as &[&str], &["all", "--limit", "2"]].concat());
        let all: Vec<Hit> = bytemuck::pod_collect_to_vec(&fs::read(&hits).unwrap());
        assert_eq!((&told["query"], all.len()), (&"all".into(), 2 * given.len()));
        for ((two, &count), first) in all.chunks(2).zip(&counts).zip(&expected) {
            assert_eq!(two[0].triangle, first.0);
            assert_eq!(two.iter().filter(|hit| hit.is_hit()).count(), count.min(2) as usize);
        }
    }
}

#[test]
fn every_triangle_test_finds_what_is_easy() {
    let folder = folder();
    let [mesh, rays, hits] = ["two.obj", "rays", "hits"].map(|name| path(&folder, name));
    let (given, expected) = known();
    write_rays(&rays, &given);
    for &intersector in Intersector::ALL {
        let name = intersector.name();
        let line = ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--json", "--intersector", name];
        assert_eq!(json(&line)["intersector"], name);
        assert_eq!(read_hits(&hits), expected, "{intersector}");
    }
    let told = bad(&["bench", "--intersector", "woop", "--traversal", "ropes"], 2);
    has(&told, &["intersector woop works with the traversals stack and brute"]);
}

#[test]
fn every_traversal_traces_the_same() {
    let folder = folder();
    let [mesh, rays, hits] = ["two.obj", "rays", "hits"].map(|name| path(&folder, name));
    let (given, expected) = known();
    write_rays(&rays, &given);
    for &traversal in Traversal::ALL {
        let line = ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--json", "--device", "cpu"];
        let told = json(&[&line[..], &["--traversal", traversal.name()]].concat());
        assert_eq!(told["traversal"], traversal.name());
        assert_eq!(read_hits(&hits), expected, "{traversal}");
    }
    // And on both devices. Few rays are timed again and again.
    let many = path(&folder, "many");
    write_rays(&many, &given.repeat(1000));
    let rows = json(&["trace", "--compare", &mesh, "--rays", &many, "--json", "--brute"]);
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 2 * Traversal::ALL.len());
    let last = &rows[Traversal::ALL.len() - 1];
    assert_eq!((&last["traversal"], &last["tests_p50"]), (&"brute".into(), &2.into()));
    for row in rows {
        let mut keys: Vec<&str> = row.as_object().unwrap().keys().map(String::as_str).collect();
        let mut wanted: Vec<&str> = COMPARE_KEYS.split_whitespace().collect();
        keys.sort_unstable();
        wanted.sort_unstable();
        assert_eq!(keys, wanted);
        assert_eq!(row["hits_digest"], rows[0]["hits_digest"]);
    }
    let told = good(&["trace", "--compare", &mesh, "--rays", &rays, "--device", "cpu"]);
    has(&told, &["7 primary", "optimised-ropes", "All hits are the same bytes."]);
    assert!(!told.contains("brute"), "it is compared if asked for");
}

#[test]
fn no_rays_no_hits() {
    let folder = folder();
    let [mesh, rays, hits] = ["two.obj", "rays", "hits"].map(|name| path(&folder, name));
    write_rays(&rays, &[]);
    for device in ["cpu", "gpu"] {
        let told = json(&["trace", &mesh, "--rays", &rays, "--hits", &hits, "--json", "--device", device]);
        assert_eq!((&told["rays"], &told["mrays"]), (&0.into(), &0.0.into()));
        assert!(fs::read(&hits).unwrap().is_empty());
    }
}

#[test]
fn damaged_or_foreign_tree_is_refused() {
    let folder = folder();
    let [mesh, rays, hits, tree] = ["two.obj", "rays", "hits", "tree"].map(|name| path(&folder, name));
    write_rays(&rays, &known().0);
    good(&["build", "teapot", "-o", &tree, "--device", "cpu"]);
    let line = ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--device", "cpu", "--tree", &tree];
    has(&bad(&line, 1), &["another mesh", &tree, &mesh]);
    // Of a mesh with as many triangles, in the same box, one of whose corners has moved since.
    good(&["build", &mesh, "-o", &tree, "--device", "cpu"]);
    good(&line);
    fs::remove_file(&hits).unwrap();
    let text = fs::read_to_string(&mesh).unwrap();
    let edited = text.replacen("v 4 0 1", "v 3 0 1", 1);
    assert_ne!(text, edited);
    fs::write(&mesh, edited).unwrap();
    has(&bad(&line, 1), &["another mesh", "not the same", &tree, &mesh]);
    fs::write(&mesh, text).unwrap();
    let mut bytes = fs::read(&tree).unwrap();
    bytes[100] ^= 1;
    fs::write(&tree, bytes).unwrap();
    has(&bad(&line, 1), &[&tree, "checksum"]);
    assert!(!Path::new(&hits).exists());
}

#[test]
fn build_tells_the_same_on_both_devices() {
    let cpu = json(&["build", "teapot", "--device", "cpu", "--json", "--profile"]);
    let gpu = json(&["build", "teapot", "--device", "gpu", "--json"]);
    for key in
        ["digest", "nodes", "leaves", "empty_leaves", "refs", "depth", "sah_cost", "tree_bytes", "kept"]
    {
        assert_eq!(cpu[key], gpu[key], "{key}");
    }
    assert_eq!(cpu["repairs"]["zero_area"], 32);
    assert!(!cpu["kernels"].as_array().unwrap().is_empty());
    let dear = json(&["build", "teapot", "--device", "cpu", "--json", "--cost-test", "8"]);
    assert!(dear["refs"].as_u64() >= cpu["refs"].as_u64() && dear["digest"] != cpu["digest"]);
    has(&good(&["build", "teapot", "--device", "cpu"]), &["32 zero-area", "SAH cost", "digest", "depth"]);
}

#[test]
fn software_adapter_is_named_as_such() {
    let output = raykd(&["devices", "--json"]);
    let devices: Value = serde_json::from_slice(&output.stdout).unwrap();
    let devices = devices.as_array().unwrap();
    assert!(devices.len() >= 2, "no Vulkan adapter: apt install mesa-vulkan-drivers");
    assert_eq!(devices.iter().filter(|device| device["default"] == true).count(), 1);
    assert_eq!(devices.last().unwrap()["device"], "cpu");
    for device in &devices[..devices.len() - 1] {
        for key in ["adapter", "driver", "kind", "probe", "max_binding_bytes", "timestamps", "doubles"] {
            assert!(!device[key].is_null(), "{key}");
        }
    }
    if let Some(software) = devices.iter().find(|device| device["kind"] == "cpu") {
        let name = software["adapter"].as_str().unwrap();
        let output = raykd(&["build", "teapot", "--adapter", name, "--json"]);
        assert!(output.status.success());
        has(text(&output.stderr), &["software rasteriser", "slower than --device cpu"]);
    }
    has(&good(&["devices"]), &["GPU  ", "CPU  ", "driver", "probe      exact", "(default)"]);
}

#[test]
fn render_draws_what_the_library_sees() {
    let folder = folder();
    let file = path(&folder, "teapot.png");
    let look = ["--eye", "0,5,60", "--target", "0,0,0", "--fov", "35"];
    let line = ["render", "teapot", "-o", &file, "--size", "96x64", "--shading", "id", "--device", "gpu"];
    has(&good(&[&line as &[&str], &look].concat()), &["96x64", "GPU"]);
    let (size, seen) = picture(Path::new(&file));
    assert_eq!(size, [96, 64]);

    let (device, mesh) = (Device::cpu(), Mesh::teapot(4));
    let camera = Camera { eye: [0.0, 5.0, 60.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov: 35.0 };
    let scene = Scene::build(&device, &mesh, &BuildOptions::default()).unwrap();
    let hits = scene.closest(&camera.rays(96, 64)).unwrap();
    for (pixel, hit) in seen.iter().zip(&hits) {
        assert_eq!(*pixel != seen[0], hit.is_hit());
    }
    let silhouette = hits.iter().filter(|hit| hit.is_hit()).count();
    assert!((600..4000).contains(&silhouette), "{silhouette} pixels");
}

#[test]
fn render_frames_and_shades() {
    let folder = folder();
    let file = PathBuf::from(path(&folder, "out.png"));
    for (shading, colours) in [("normal", 100), ("depth", 30), ("heat", 30), ("id", 100)] {
        let name = file.to_str().unwrap();
        good(&["render", "teapot", "-o", name, "--size", "320x240", "--shading", shading, "--device", "cpu"]);
        let (size, seen) = picture(&file);
        assert_eq!(size, [320, 240]);
        let different: std::collections::HashSet<_> = seen.iter().collect();
        assert!(different.len() >= colours, "{shading}: {} colours", different.len());
        if shading == "id" {
            // Framed: the teapot reaches from one side nearly to the other, and no pixel beyond.
            let filled = |x: usize| seen[x..].iter().step_by(320).any(|pixel| *pixel != seen[0]);
            let columns: Vec<usize> = (0..320).filter(|&x| filled(x)).collect();
            assert!(columns[0] > 0 && columns[0] < 20, "{columns:?}");
            assert!(columns[columns.len() - 1] < 319 && columns[columns.len() - 1] > 299, "{columns:?}");
        }
    }
}

#[test]
fn reader_may_leave_early() {
    let mut child = command(&["build", "teapot", "--json", "--device", "cpu"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), ""));
}

#[test]
fn ray_records_are_32_bytes() {
    assert_eq!(size_of::<Ray>(), 32);
}

/// No file is read without end: meshes, rays and trees, as much as --max-bytes allows.
#[test]
fn files_are_read_up_to_a_limit() {
    let folder = folder();
    let [mesh, rays, hits, tree] = ["two.obj", "rays", "hits", "two.kd"].map(|name| path(&folder, name));
    write_rays(&rays, &[[1.0, 1.0, 5.0, 0.0, 0.0, -1.0, 0.0, 100.0]; 4]);
    good(&["build", &mesh, "--device", "cpu", "-o", &tree]);
    let size = |path: &str| fs::metadata(path).unwrap().len();
    let most = [&mesh, &rays, &tree].map(|path| size(path)).into_iter().max().unwrap();
    let trace = ["trace", &mesh, "--rays", &rays, "--hits", &hits, "--tree", &tree, "--device", "cpu"];
    good(&[&trace[..], &["--max-bytes", &most.to_string()]].concat());
    for file in [&mesh, &rays, &tree] {
        // So small a limit that this file is the only one beyond it.
        let limit = size(file) - 1;
        let others = [&mesh, &rays, &tree].into_iter().filter(|other| *other != file);
        for other in others.filter(|other| size(other) > limit) {
            assert!(size(other) >= size(file));
        }
        let limit = limit.to_string();
        let trace = ["trace", "teapot:1", "--rays", &rays, "--hits", &hits];
        let line = match file {
            _ if file == &mesh => vec!["build", file],
            _ if file == &rays => trace.to_vec(),
            _ => [&trace[..], &["--tree", file]].concat(),
        };
        let message = bad(&[&line[..], &["--max-bytes", &limit]].concat(), 1);
        has(&message, &[file, &format!("more than {limit} bytes"), "--max-bytes"]);
    }
    #[cfg(unix)]
    {
        has(
            &bad(&["trace", &mesh, "--rays", "/dev/zero", "--hits", &hits, "--max-bytes", "1M"], 1),
            &["1048576 bytes"],
        );
        has(&bad(&["build", "/dev/zero", "--max-bytes", "1M"], 1), &["/dev/zero: ", "1048576 bytes"]);
    }
    has(&bad(&["build", &mesh, "--max-bytes", "1X"], 2), &["write it like 5000000000, 500M or 5G"]);
}

/// What a gzipped file of ten megabytes may take is a part of the ten gigabytes it holds.
#[cfg(target_os = "linux")]
#[test]
fn a_bomb_takes_little_memory() {
    use std::io::Write as _;
    let folder = folder();
    let file = path(&folder, "bomb.obj.gz");
    let mut part = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    part.write_all(&vec![b'\n'; 64 << 20]).unwrap();
    fs::write(&file, part.finish().unwrap().repeat(160)).unwrap();
    let line = format!("ulimit -v 4000000; exec {} build {file} --device cpu", env!("CARGO_BIN_EXE_raykd"));
    let start = std::time::Instant::now();
    let output = Command::new("sh").args(["-c", &line]).stdin(Stdio::null()).output().unwrap();
    println!("{:?}", start.elapsed());
    assert_eq!(output.status.code(), Some(1));
    has(text(&output.stderr), &["bomb.obj.gz: this is more than ", " bytes, unpacked, and no more are read"]);
}

#[test]
fn pictures_of_rays_that_are_none_are_told() {
    let folder = folder();
    let [mesh, picture] = ["t.obj", "t.png"].map(|name| path(&folder, name));
    fs::write(&mesh, "v 0 0 0\nv 4 0 0\nv 0 4 0\nf 1 2 3\n").unwrap();
    for (eye, none) in [("1e30,0,0", true), ("9,9,9", false)] {
        let line = ["render", &mesh, "-o", &picture, "--eye", eye, "--size", "8x8", "--device", "cpu"];
        let output = raykd(&line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert_eq!(
            text(&output.stderr).contains("invalid rays: 256 (with NaN"),
            none,
            "{}",
            text(&output.stderr)
        );
    }
}

/// What a file names again and again takes memory, as if it were written out.
#[cfg(target_os = "linux")]
#[test]
fn a_small_file_of_a_large_mesh_takes_little_memory() {
    let folder = folder();
    let file = path(&folder, "many.gltf");
    let primitives = vec![r#"{"attributes": {"POSITION": 0}}"#; 3000].join(", ");
    let gltf = format!(
        r#"{{"asset": {{"version": "2.0"}}, "meshes": [{{"primitives": [{primitives}]}}],
            "accessors": [{{"componentType": 5126, "count": 60000, "type": "VEC3"}}]}}"#
    );
    fs::write(&file, gltf).unwrap();
    let line = format!("ulimit -v 2000000; exec {} check {file}", env!("CARGO_BIN_EXE_raykd"));
    let output = Command::new("sh").args(["-c", &line]).stdin(Stdio::null()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    has(
        text(&output.stderr),
        &["many.gltf, mesh 0, primitive 533: this is more than 512000000 bytes, unpacked"],
    );
    has(&bad(&["check", &file, "--max-bytes", "1M"], 1), &["primitive 1: this is more than 1048576 bytes"]);
}

/// A mesh's name that is no UTF-8, and what is told of faces that had to be looked at.
#[cfg(unix)]
#[test]
fn any_name_names_a_mesh() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt as _};
    let folder = folder();
    let name = folder.path().join(OsStr::from_bytes(b"gr\xfc\xdfe.obj"));
    let faces = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nv 4 4 1\nv 4 4 0\n\
                 f 2 3 4 1\nf 1 2 5 4\nf 1 3 2 4\nf 3 2 1 4\nf 1 2 4 6\n";
    fs::write(&name, faces).unwrap();
    let run = |line: &str| {
        let words = line.split(' ').map(|word| if word == "MESH" { name.as_os_str() } else { word.as_ref() });
        let output = command(&[]).args(words).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout).to_owned()
    };
    let picture = path(&folder, "p.png");
    let told = run("build MESH --device cpu");
    has(&told, &["gr\u{fffd}\u{fffd}e.obj", "5 polygons cut into triangles", "1 not flat (first: line 8)"]);
    has(&told, &["2 of them concave", "1 crossed by their own edges, left as fans (first: line 11)"]);
    run(&format!("render MESH -o {picture} --device cpu --size 8x8"));
    assert!(Path::new(&picture).exists());
    run("stress --scene MESH --method exact/stack --device cpu --rays 10");
}
