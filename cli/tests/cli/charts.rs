//! `raykd chart`, `raykd calibrate` and `--quality auto` from outside, on the CPU.

use crate::{command, raykd};
use raykd::{
    Device, Mesh, Ray,
    plan::{CHOICES, cache_file},
    rays,
};
use serde_json::{Value, json};
use std::{fs, path::Path, process::Output};

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// A calibration's file for one thread, by which this choice is the best one.
fn favouring(name: &str) -> String {
    favouring_on(&Device::cpu_with_threads(1).unwrap(), name)
}

fn favouring_on(device: &Device, name: &str) -> String {
    let cost = |choice: &str, triangles: u32| {
        json!({
            "choice": choice,
            "triangles": triangles,
            "upload_ms": 0.1,
            "build_ms": if choice == name { 1.0 } else { 100.0 },
            "launch_ms": 0.0,
            "ray_ns": 1.0,
            "worst_ns": 1.0,
            "transfer_ns": 1.0,
            "bytes": 1000,
            "spread": 1.0,
        })
    };
    let seen = json!({ "whole": 10.0, "halfway": 20.0, "wide": 5.0 });
    let costs: Vec<_> = CHOICES.iter().flat_map(|c| [cost(c.name, 100), cost(c.name, 1000)]).collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "device": "cpu",
        "name": device.name(),
        "looks": [[100, [seen, seen]], [1000, [seen, seen]]],
        "costs": costs,
    })
    .to_string()
}

/// Rays at the teapot in a file.
fn rays_file(folder: &Path) -> String {
    let rays: Vec<Ray> = rays::random(Mesh::teapot(4).bounds(), 3000, 1);
    let path = folder.join("rays");
    fs::write(&path, bytemuck::cast_slice(&rays)).unwrap();
    path.display().to_string()
}

#[test]
fn whatever_auto_chooses_hits_are_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (rays, hits, costs) = (rays_file(folder.path()), path("hits"), path("costs.json"));
    let line = ["trace", "teapot", "--rays", &rays, "--hits", &hits, "--threads", "1"];
    assert!(raykd(&line).status.success());
    let expected = fs::read(&hits).unwrap();
    for &choice in CHOICES {
        fs::write(&costs, favouring(choice.name)).unwrap();
        fs::remove_file(&hits).unwrap();
        let output = raykd(&[line.as_slice(), &["--quality", "auto", "--costs", &costs, "--json"]].concat());
        assert!(output.status.success(), "{}", told(&output));
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["auto"]["choice"], choice.name);
        assert!(json["auto"]["predicted_ms"].as_f64() > Some(1.0), "{json}");
        assert!(json["auto"]["measured_ms"].as_f64() > Some(0.0), "{json}");
        assert_eq!(fs::read(&hits).unwrap(), expected, "{}", choice.name);
    }
}

/// Boxes answer closest and any hits by the test `strict`; all else needs a tree.
#[test]
fn auto_chooses_no_boxes_for_what_they_do_not_answer() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (rays, hits, costs) = (rays_file(folder.path()), path("hits"), path("costs.json"));
    fs::write(&costs, favouring("wide")).unwrap();
    let auto = ["--threads", "1", "--quality", "auto", "--costs", &costs, "--json"];
    let trace = ["trace", "teapot", "--rays", &rays, "--hits", &hits];
    let choice = |line: &[&str]| {
        let output = raykd(&[line, &auto].concat());
        assert!(output.status.success(), "{}", told(&output));
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        json["auto"]["choice"].as_str().unwrap().to_owned()
    };
    let asked = |more: &[&str]| choice(&[trace.as_slice(), more].concat());
    for boxes in [[].as_slice(), &["--any"], &["--intersector", "strict"]] {
        assert_eq!(asked(boxes), "wide", "{boxes:?}");
    }
    for tree in
        [["--query", "count"], ["--query", "all"], ["--intersector", "exact"], ["--intersector", "woop"]]
    {
        assert_ne!(asked(&tree), "wide", "{tree:?}");
    }
    assert_ne!(choice(&["build", "teapot"]), "wide");
}

#[test]
fn auto_tells_what_it_chose_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (costs, picture) = (path("costs.json"), path("a.png"));
    fs::write(&costs, favouring("halfway")).unwrap();
    let auto = ["--threads", "1", "--quality", "auto", "--costs", &costs];
    let build = raykd(&[["build", "teapot"].as_slice(), &auto, &["--rays", "5000"]].concat());
    assert!(told(&build).contains("halfway tree for 5,000 rays: predicted 1.1"), "{}", told(&build));
    let render = ["render", "teapot", "--size", "64x32", "--samples", "1", "-o", &picture];
    let render = raykd(&[render.as_slice(), &auto].concat());
    assert!(told(&render).contains("halfway tree for 2,048 rays: predicted"), "{}", told(&render));
    let render = ["render", "teapot", "--size", "64x32", "--shading", "ao", "-o", &picture];
    let render = raykd(&[render.as_slice(), &auto].concat());
    assert!(told(&render).contains("halfway tree for 18,432 rays: predicted"), "{}", told(&render));
    let bench = raykd(&[["bench", "--device", "cpu", "--rays", "700"].as_slice(), &auto].concat());
    assert!(told(&bench).contains("CPU: auto: halfway tree for 700 rays: predicted"), "{}", told(&bench));
}

/// Puts a calibration into a folder that serves as cache, for so many threads.
fn into_cache(folder: &Path, threads: usize) {
    let device = Device::cpu_with_threads(threads).unwrap();
    let name = cache_file(&device).unwrap();
    fs::write(folder.join(name.file_name().unwrap()), favouring_on(&device, "halfway")).unwrap();
}

#[test]
fn auto_is_checked_against_what_everything_takes() {
    let folder = tempfile::tempdir().unwrap();
    into_cache(folder.path(), 1);
    let line = ["calibrate", "--check", "teapot:2", "--threads", "1", "--device", "cpu", "--json"];
    let output = command(&line).env("RAYKD_CACHE", folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (cases, costs) = (json["cases"].as_array().unwrap(), json["costs"].as_array().unwrap());
    assert_eq!((cases.len(), costs.len(), &json["traced"]["cpu"]), (7, CHOICES.len(), &32768.into()));
    for (case, power) in cases.iter().zip(3..) {
        assert_eq!(case["choice"], "CPU halfway");
        assert_eq!(case["rays"], 10u64.pow(power));
        // 1.1 ms before the rays, 2 ns a ray, as was made up.
        let predicted = 1.1 + 2e-6 * 10f64.powi(power as i32);
        assert!((case["predicted_ms"].as_f64().unwrap() / predicted - 1.0).abs() < 0.6, "{case}");
        assert!(case["best_ms"].as_f64() <= case["measured_ms"].as_f64(), "{case}");
    }
    assert!(costs.iter().all(|pair| pair["measured"]["ray_ns"].as_f64() > Some(0.0)), "{costs:?}");
}

#[test]
fn what_auto_chooses_cannot_be_given() {
    let given: [&[&str]; 8] = [
        &["--builder", "median"],
        &["--no-clip"],
        &["--cost-step", "1"],
        &["--cost-test", "1"],
        &["--price", "1"],
        &["--budget", "2"],
        &["--empty", "0.5"],
        &["--traversal", "ropes"],
    ];
    for option in given {
        let refused = raykd(&[&["bench", "--quality", "auto"], option].concat());
        assert_eq!(refused.status.code(), Some(2), "{option:?}");
        let words = told(&refused);
        assert!(words.contains("--quality") && words.contains(option[0]), "{words}");
    }
    let trace = ["trace", "teapot", "--rays", "none", "--hits", "none", "--tree", "none"];
    for option in [given[0], given[1], &["--quality", "auto"]] {
        let refused = raykd(&[&trace, option].concat());
        assert_eq!(refused.status.code(), Some(2), "{option:?}");
        assert!(told(&refused).contains("--tree"), "{}", told(&refused));
    }
    assert!(told(&raykd(&["bench", "--costs", "none"])).contains("--costs is for --quality auto"));
}

#[test]
fn costs_of_no_use_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let costs = folder.path().join("costs.json").display().to_string();
    let build = |more: &[&str]| {
        let line = ["build", "teapot", "--threads", "1", "--quality", "auto", "--costs", &costs];
        raykd(&[line.as_slice(), more].concat())
    };
    let missing = build(&[]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(told(&missing).contains("costs.json"), "{}", told(&missing));
    fs::write(&costs, "[]").unwrap();
    let damaged = build(&[]);
    assert_eq!(damaged.status.code(), Some(1));
    assert!(told(&damaged).contains("`raykd calibrate` measures anew"), "{}", told(&damaged));
    let mut other: Value = serde_json::from_str(&favouring("none")).unwrap();
    other["name"] = "Analytical Engine".into();
    fs::write(&costs, other.to_string()).unwrap();
    assert!(told(&build(&[])).contains("Analytical Engine"));
    // What auto decides cannot be decided otherwise too.
    assert_eq!(build(&["--builder", "zhou"]).status.code(), Some(2));
}

#[test]
fn a_page_and_its_figures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let peers = folder.path().join("peers.json");
    let peer = r#"[{"scene": "teapot", "peer": "a <b>", "build_ms": 2, "mrays_a": 1, "mrays_b": 4, "mrays_c": 2,
        "mrays_d": 3, "mrays_d_any": null, "wrong": 7, "unclear": 0, "any_differs": 0}]"#;
    fs::write(&peers, peer).unwrap();
    into_cache(folder.path(), 2);
    let output = command(&[
        "chart",
        "teapot:2",
        "--quick",
        "--rays",
        "256",
        "--device",
        "cpu",
        "--threads",
        "2",
        "-o",
    ])
    .args([&out, Path::new("--peers"), &peers])
    .env("RAYKD_CACHE", folder.path())
    .output()
    .unwrap();
    assert!(output.status.success(), "{}", told(&output));

    let page = fs::read_to_string(out.join("index.html")).unwrap();
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let html = roxmltree::Document::parse_with_options(&page, options).unwrap();
    let figures: Vec<_> = html.descendants().filter(|node| node.has_tag_name("figure")).collect();
    let names: Vec<&str> = figures.iter().filter_map(|figure| figure.attribute("id")).collect();
    for name in [
        "1-accuracy",
        "2-builders-teapot-2",
        "2-sah-teapot-2",
        "3-total-teapot-2",
        "4-bytes-teapot-2",
        "5-size",
        "5-threads",
        "6-talk-build",
        "6-talk-rays",
        "7-peers-teapot",
        "8-auto",
    ] {
        assert!(names.contains(&name), "{name} is not among {names:?}");
    }
    for figure in figures {
        let name = figure.attribute("id").unwrap();
        let marks = |tag| figure.descendants().filter(|node| node.tag_name().name() == tag).count();
        assert!(marks("svg") == 1 && marks("text") > 5 && marks("td") > 2, "{name}");
        let caption = figure.children().find(|node| node.has_tag_name("figcaption")).unwrap();
        assert!(caption.text().is_some_and(|text| text.len() > 20), "{name}");
        roxmltree::Document::parse(&fs::read_to_string(out.join(format!("{name}.svg"))).unwrap()).unwrap();
        let ([width, _], pixels) = crate::picture(&out.join(format!("{name}.png")));
        assert!(width == 1280 && pixels.iter().any(|pixel| *pixel != [255; 3]), "{name}");
        let csv = fs::read_to_string(out.join(format!("{name}.csv"))).unwrap();
        assert!(csv.lines().count() >= 2, "{name}: {csv}");
    }
    // Needs nothing from elsewhere, and says where it comes from.
    for foreign in ["src=", "href=", "url(", "@import"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    let footer = html.descendants().find(|node| node.has_tag_name("footer")).unwrap();
    let footer: String = footer.descendants().filter_map(|node| node.text()).collect();
    for part in ["CPU: ", "2 threads", env!("CARGO_PKG_VERSION"), "chart teapot:2 --quick"] {
        assert!(footer.contains(part), "{part}: {footer}");
    }
}

/// Names that no file of a figure could have, or that two scenes would share, and a folder's that is not Unicode.
#[cfg(unix)]
#[test]
fn scenes_and_folders_of_any_name_are_charted() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    let long = folder.path().join("d".repeat(150)).join("e".repeat(150));
    fs::create_dir_all(&long).unwrap();
    let scenes = ["\u{e4}.obj", "\u{f6}.obj", "\u{1}.obj"].map(|name| long.join(name));
    for scene in &scenes {
        fs::write(scene, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    }
    into_cache(folder.path(), 1);
    let out = folder.path().join(std::ffi::OsStr::from_bytes(b"out\xff"));
    let line = ["chart", "--quick", "--rays", "256", "--device", "cpu", "--threads", "1", "-o"];
    let output = command(&line).arg(&out).args(&scenes).env("RAYKD_CACHE", folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    let mut pictures: Vec<String> =
        fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    pictures.retain(|name| name.starts_with("3-total-") && name.ends_with(".svg"));
    assert_eq!(pictures.len(), scenes.len(), "{pictures:?}");
    for name in pictures {
        roxmltree::Document::parse(&fs::read_to_string(out.join(name)).unwrap()).unwrap();
    }
}
