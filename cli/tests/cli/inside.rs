//! `raykd inside` and `raykd check` from outside.

use crate::{npy, text, within};
use serde_json::Value;
use std::{fs, process::Output};
use tempfile::TempDir;

/// A folder with a tetrahedron of four triangles that look outward, and the same without the last.
pub(super) fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let open = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\n";
    fs::write(folder.path().join("open.obj"), open).unwrap();
    fs::write(folder.path().join("closed.obj"), format!("{open}f 2 3 4\n")).unwrap();
    let points = "x,y,z,name\n1,1,1,in\n3,3,3,out\n0,0,0,corner\nnan,0,0,none\n";
    fs::write(folder.path().join("points.csv"), points).unwrap();
    folder
}

pub(super) fn raykd(folder: &TempDir, line: &str) -> Output {
    within(folder, line).output().unwrap()
}

#[test]
fn points_get_their_winding_number() {
    let folder = folder();
    let expected = "x,y,z,name,winding\n1,1,1,in,1\n3,3,3,out,0\n0,0,0,corner,1\nnan,0,0,none,0\n";
    for device in ["cpu", "gpu"] {
        let told = raykd(&folder, &format!("inside closed.obj --points points.csv --device {device}"));
        assert!(told.status.success(), "{}", text(&told.stderr));
        assert_eq!(text(&told.stdout), expected);
        assert!(!text(&told.stderr).contains("not closed"));
        assert!(text(&told.stderr).contains("invalid points: 1 "), "{}", text(&told.stderr));
        let line = format!("inside closed.obj --points points.csv --device {device} -o out.csv --json");
        let told: Value = serde_json::from_slice(&raykd(&folder, &line).stdout).unwrap();
        assert_eq!(
            [&told["closed"], &told["points"], &told["inside"], &told["invalid"]],
            [&Value::Bool(true), &Value::from(4), &Value::from(2), &Value::from(1)]
        );
        assert_eq!(fs::read_to_string(folder.path().join("out.csv")).unwrap(), expected);
    }
    // The name of the file to write says what it becomes.
    assert!(raykd(&folder, "inside closed.obj --points points.csv --device cpu -o out.npy").status.success());
    let array = fs::read(folder.path().join("out.npy")).unwrap();
    assert!(array.starts_with(b"\x93NUMPY"), "{}", text(&array));
    let three: Vec<u8> = (1..=3).flat_map(|x: i32| f64::from(x).to_le_bytes()).collect();
    fs::write(folder.path().join("one.npy"), npy("<f8", "(1, 3)", &three)).unwrap();
    let told = raykd(&folder, "inside closed.obj --points one.npy --device cpu -o one.csv");
    assert!(told.status.success(), "{}", text(&told.stderr));
    assert_eq!(fs::read_to_string(folder.path().join("one.csv")).unwrap(), "1,2,3,0\n");
    let told = raykd(&folder, "inside open.obj --points points.csv --device cpu");
    assert!(told.status.success());
    assert!(text(&told.stderr).contains("not closed, so inside is not certain"), "{}", text(&told.stderr));
}

#[test]
fn what_cannot_be_points_is_refused() {
    let folder = folder();
    fs::write(folder.path().join("bad.csv"), "1,2,3\n1,2\n").unwrap();
    fs::write(folder.path().join("bad.npy"), "no array").unwrap();
    for (line, told, code) in [
        (
            "inside closed.obj --points bad.csv",
            "bad.csv\n  because: line 2: 1,2 does not begin with three",
            1,
        ),
        ("inside closed.obj --points bad.npy", "bad.npy\n  because: this is no NPY array", 1),
        ("inside closed.obj --points none.csv", "none.csv", 1),
        ("inside closed.obj --points points.csv -o points.csv", "points.csv", 1),
        ("inside closed.obj --points points.csv --json", "--output", 2),
        ("inside closed.obj", "--points", 2),
    ] {
        let output = raykd(&folder, line);
        assert_eq!(output.status.code(), Some(code), "{line}");
        assert!(text(&output.stderr).contains(told), "{line}: {}", text(&output.stderr));
        assert_eq!(text(&output.stdout), "", "{line}");
    }
    assert!(fs::read_to_string(folder.path().join("points.csv")).unwrap().starts_with("x,y,z,name\n"));
}

#[test]
fn closed_and_open_meshes_are_told_apart() {
    let folder = folder();
    let closed = raykd(&folder, "check closed.obj");
    assert_eq!(closed.status.code(), Some(0));
    assert!(text(&closed.stdout).contains("closed  yes"), "{}", text(&closed.stdout));
    let open = raykd(&folder, "check open.obj --json");
    assert_eq!(open.status.code(), Some(1));
    let told: Value = serde_json::from_slice(&open.stdout).unwrap();
    assert_eq!((&told["closed"], &told["edges"]), (&Value::Bool(false), &Value::from(6)));
    assert_eq!(told["border"]["count"], 3);
    assert_eq!(told["border"]["first"], serde_json::json!([[0.0, 4.0, 0.0], [4.0, 0.0, 0.0]]));
    assert_eq!((&told["t_junctions"]["count"], &told["intersections"]["count"]), (&0.into(), &0.into()));
    let missing = raykd(&folder, "check none.obj");
    assert_eq!(missing.status.code(), Some(1));
    assert!(text(&missing.stderr).contains("none.obj"));
}

/// Triangles are numbered as the hits are, from 0.
#[test]
fn the_first_triangle_of_each_repair_is_told() {
    let folder = folder();
    let closed = fs::read_to_string(folder.path().join("closed.obj")).unwrap();
    let again = "f 1 1 2\nf 1 3 2\nf 1 3 2\nf 2 2 2\n";
    fs::write(folder.path().join("again.obj"), closed + again).unwrap();
    let told = raykd(&folder, "check again.obj");
    let told = text(&told.stdout);
    for part in [
        "2 zero-area triangles kept out of the tree (first: triangle 4)",
        "2 duplicate triangles, of which the lowest number wins (first: triangle 5)",
    ] {
        assert!(told.contains(part), "{told}");
    }
    let json = |mesh| {
        let output = raykd(&folder, &format!("check {mesh} --json"));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()["repairs"].clone()
    };
    let told = json("again.obj");
    assert_eq!((&told["zero_area_at"], &told["duplicate_at"]), (&4.into(), &5.into()));
    let told = json("closed.obj");
    assert_eq!((told.get("zero_area_at"), told.get("duplicate_at")), (None, None));
}

/// A closed mesh may meet itself: that is told, and is no reason for another exit code.
#[test]
fn meshes_that_meet_themselves_are_told() {
    let folder = folder();
    // Two tetrahedra through each other: the corner of one, at 1 1 1, is inside the other.
    let one = fs::read_to_string(folder.path().join("closed.obj")).unwrap();
    let two = "v 1 1 1\nv 5 1 1\nv 1 5 1\nv 1 1 5\nf 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\n";
    fs::write(folder.path().join("two.obj"), one + two).unwrap();
    let told = raykd(&folder, "check two.obj");
    assert_eq!(told.status.code(), Some(0), "{}", text(&told.stderr));
    // The three edges from that corner meet the slope.
    let line = "through 3 edges through triangles (first: 1,1,1 to 1,5,1 meets 4,0,0 0,4,0 0,0,4)";
    assert!(text(&told.stdout).contains(line), "{}", text(&told.stdout));
    assert!(!text(&told.stdout).contains("t-joint"));
    // A square of two triangles beside one, whose edge has a vertex of theirs in its middle.
    let joint = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 1 0 0\nv 1 -1 0\nv 0 -1 0\nf 1 2 3\nf 1 6 5\nf 1 5 4\n";
    fs::write(folder.path().join("joint.obj"), joint).unwrap();
    let told = raykd(&folder, "check joint.obj --json");
    assert_eq!(told.status.code(), Some(1));
    let told: Value = serde_json::from_slice(&told.stdout).unwrap();
    let first = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    let place = serde_json::json!({"count": 1, "first": first, "meets": [[1.0, 0.0, 0.0]]});
    assert_eq!(told["t_junctions"], place);
    assert_eq!(told["intersections"], serde_json::json!({"count": 0}));
}
