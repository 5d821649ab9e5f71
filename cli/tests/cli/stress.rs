//! `raykd stress` from outside. Needs a Vulkan adapter; a software one will do.

use crate::text;
use serde_json::Value;
use std::fs;

/// Keys of every row.
const KEYS: [&str; 8] =
    ["scene", "method", "device", "rays", "failures", "failures_per_million", "expected", "ok"];

/// Exit code, standard output and standard error.
fn raykd(line: &[&str]) -> (i32, String, String) {
    let output = crate::raykd(line);
    let text = |bytes| text(bytes).to_owned();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

/// Exit code and rows.
fn rows(line: &[&str]) -> (i32, Vec<Value>) {
    let (code, out, error) = raykd(&[&["stress", "--json"], line].concat());
    let rows: Value = serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {error}"));
    (code, rows.as_array().unwrap().clone())
}

#[test]
fn scenes_pass_on_both_devices() {
    let (code, rows) = rows(&["--scene", "signed-zeros,no-rays", "--method", "strict", "--rays", "100"]);
    assert_eq!(code, 0);
    for device in ["cpu", "gpu"] {
        let of = |row: &&Value| row["device"] == device && row["method"] == "strict/stack";
        assert_eq!(rows.iter().filter(of).count(), 2);
    }
    for row in &rows {
        for key in KEYS {
            assert!(!row[key].is_null(), "{key}");
        }
        assert_eq!((&row["failures"], &row["ok"], &row["rays"]), (&0.into(), &true.into(), &100.into()));
    }
}

#[test]
fn known_failures_happen_and_are_no_error() {
    let methods = "moeller/stack,textbook/fma,textbook/ropes";
    let line = ["--scene", "contraction,slabs", "--method", methods, "--rays", "2000", "--device", "cpu"];
    let (code, rows) = rows(&line);
    assert_eq!(code, 0);
    let failing: Vec<_> = rows.iter().filter(|row| row["failures"].as_u64() > Some(0)).collect();
    assert_eq!(failing.len(), 3, "{rows:?}");
    for row in failing {
        assert_eq!((&row["expected"], &row["ok"]), (&true.into(), &true.into()));
        let rate = 1e6 * row["failures"].as_f64().unwrap() / row["rays"].as_f64().unwrap();
        assert_eq!(row["failures_per_million"].as_f64(), Some(rate));
        assert!(!row["example"].is_null());
    }
}

#[test]
fn unknown_failures_exit_with_1_and_can_be_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, file] =
        ["small.obj", "failed.json"].map(|name| folder.path().join(name).display().to_string());
    // So small that the paper's threshold drops it, and not small enough for raykd to scale it.
    fs::write(&mesh, "v 0 0 0\nv .0015 0 0\nv 0 .0015 0\nf 1 2 3\n").unwrap();
    let line = ["--scene", &mesh, "--method", "moeller/stack,strict/stack", "--device", "cpu"];
    let (code, found) = rows(&line);
    assert_eq!(code, 1);
    let of = |method: &str| found.iter().find(|row| row["method"] == method).unwrap();
    assert_eq!((&of("strict/stack")["ok"], &of("moeller/stack")["ok"]), (&true.into(), &false.into()));
    assert!(of("moeller/stack")["kinds"]["missed"].as_u64() > Some(100));
    fs::write(&file, serde_json::to_vec(&found).unwrap()).unwrap();
    let (code, again) = rows(&["--replay", &file]);
    assert_eq!((code, again.len()), (1, 1));
    assert_eq!((&again[0]["rays"], &again[0]["failures"]), (&1.into(), &1.into()));
    let (code, out, _) = raykd(&["stress", "--replay", &file]);
    assert!(code == 1 && out.contains("moeller/stack") && out.contains("missed"), "{out}");
    // More rays than any run makes of a scene.
    let mut many = found.clone();
    many.iter_mut()
        .filter(|row| !row["example"].is_null())
        .for_each(|row| row["example"]["rays"] = u64::MAX.into());
    fs::write(&file, serde_json::to_vec(&many).unwrap()).unwrap();
    let (code, _, error) = raykd(&["stress", "--replay", &file]);
    assert!(code == 1 && error.contains("18,446,744,073,709,551,615 rays are too many"), "{error}");
    // A ray that the scene does not have.
    let mut other = found.clone();
    for row in &mut other {
        if row["method"] == "moeller/stack" {
            row["example"]["ray"][0] = 7.into();
        }
    }
    fs::write(&file, serde_json::to_vec(&other).unwrap()).unwrap();
    let (code, _, error) = raykd(&["stress", "--replay", &file]);
    assert!(code == 1 && error.contains("makes other rays"), "{error}");
}

#[test]
fn surfaces_do_not_leak() {
    let (code, rows) =
        rows(&["--scene", "leaks", "--method", "strict/stack,moeller/stack", "--rays", "50000"]);
    assert_eq!(code, 0);
    for name in ["sphere-inside", "cubes-inside", "sphere", "teapot"] {
        let row = |method: &str, device: &str| {
            let scene = format!("leaks/{name}");
            rows.iter()
                .find(|r| r["scene"] == scene.as_str() && r["method"] == method && r["device"] == device)
        };
        for device in ["cpu", "gpu"] {
            let exact = row("strict/stack", device).unwrap();
            assert_eq!((&exact["failures"], &exact["rays"]), (&0.into(), &50_000.into()), "{name}");
        }
        let [cpu, gpu] = ["cpu", "gpu"].map(|device| &row("moeller/stack", device).unwrap()["failures"]);
        assert_eq!(cpu, gpu, "{name}");
        assert!(name == "cubes-inside" || cpu.as_u64() > Some(1000), "{name}: {cpu}");
    }
}

#[test]
fn what_there_is_is_listed_and_wrong_names_are_errors() {
    let (code, out, _) = raykd(&["stress", "--list"]);
    assert_eq!(code, 0);
    for word in ["icosphere-edges", "silhouettes", "leaks", "strict/stack/zhou", "woop/brute", "textbook/fma"]
    {
        assert!(out.contains(word), "{word}");
    }
    for (line, words) in [
        (["--scene", "moon"], ["moon", "--list"]),
        (["--method", "guess"], ["guess", "--list"]),
        (["--replay", "/nowhere.json"], ["/nowhere.json", "No such file"]),
    ] {
        let (code, _, error) = raykd(&[&["stress"] as &[&str], &line].concat());
        assert_eq!(code, 1);
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    let (code, _, error) = raykd(&["stress", "--replay", "f", "--rays", "5"]);
    assert_eq!(code, 2, "{error}");
}
