//! `raykd voxels` from outside.

use crate::{
    inside::{folder, raykd},
    text,
};
use serde_json::Value;
use std::fs;

#[test]
fn a_tetrahedron_becomes_voxels() {
    let folder = folder();
    let mut files = Vec::new();
    for device in ["cpu", "gpu"] {
        let told = raykd(&folder, &format!("voxels closed.obj --size 4 -o v.npy --json --device {device}"));
        assert!(told.status.success(), "{}", text(&told.stderr));
        assert!(!text(&told.stderr).contains("not closed"));
        let told: Value = serde_json::from_slice(&told.stdout).unwrap();
        assert_eq!(told["counts"], serde_json::json!([4, 4, 4]));
        assert_eq!((&told["size"], &told["closed"]), (&Value::from(1.0), &Value::Bool(true)));
        // Of the centres, in halves 1 + 1 + 1 and more, those with a sum below 4; none is on the slope.
        assert_eq!((&told["inside"], &told["volume"]), (&Value::from(10), &Value::from(10.0)));
        assert!((told["mesh_volume"].as_f64().unwrap() - 32.0 / 3.0).abs() < 1e-9);
        files.push(fs::read(folder.path().join("v.npy")).unwrap());
    }
    assert!(files[0] == files[1], "CPU and GPU give other voxels");
    let file = npyz::NpyFile::new(&files[0][..]).unwrap();
    let voxels: Vec<bool> = file.into_vec().unwrap();
    let expected: Vec<bool> = (0..64).map(|i| 2 * (i / 16 + i / 4 % 4 + i % 4) + 3 < 8).collect();
    assert_eq!(voxels, expected);
    for (name, first) in [("v.vox", &b"VOX "[..]), ("v.png", b"\x89PNG")] {
        let told = raykd(&folder, &format!("voxels closed.obj --size 4 -o {name} --device cpu"));
        assert!(told.status.success(), "{}", text(&told.stderr));
        assert!(
            text(&told.stdout).contains("4 x 4 x 4 voxels, 1 wide, from 0,0,0"),
            "{}",
            text(&told.stdout)
        );
        assert!(fs::read(folder.path().join(name)).unwrap().starts_with(first));
    }
    let open = raykd(&folder, "voxels open.obj --size 4 -o v.npy --device cpu");
    assert!(open.status.success() && text(&open.stderr).contains("not closed, so inside is not certain"));
}

/// Also where centres are subnormal numbers, which are zeros in rays.
#[test]
fn voxels_of_a_mesh_of_any_size_are_the_same() {
    let folder = folder();
    let filled = |exponent: i32| {
        let scaled = |number: &str| {
            number.parse().map_or(number.to_owned(), |x: f64| (x * 2_f64.powi(exponent)).to_string())
        };
        let of = |line: &str| match line.strip_prefix("v ") {
            Some(numbers) => format!("v {}", numbers.split(' ').map(scaled).collect::<Vec<_>>().join(" ")),
            None => line.to_owned(),
        };
        let given = fs::read_to_string(folder.path().join("closed.obj")).unwrap();
        let mesh: Vec<_> = given.lines().map(of).collect();
        fs::write(folder.path().join("scaled.obj"), mesh.join("\n") + "\n").unwrap();
        let told = raykd(&folder, "voxels scaled.obj --size 40 -o v.npy --json --device cpu");
        assert!(told.status.success(), "{}", text(&told.stderr));
        let told: Value = serde_json::from_slice(&told.stdout).unwrap();
        assert_eq!(told["size"].as_f64(), Some(0.1 * 2_f64.powi(exponent)));
        fs::read(folder.path().join("v.npy")).unwrap()
    };
    let usual = filled(0);
    for exponent in [-139, -130, -126, -124, -60, -12, 24, 125] {
        assert!(filled(exponent) == usual, "2^{exponent}");
    }
}

#[test]
fn voxels_that_cannot_be_are_refused() {
    let folder = folder();
    fs::write(folder.path().join("flat.obj"), "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n").unwrap();
    for (line, told, code) in [
        ("voxels closed.obj --size 257 -o v.vox", "256 voxels along an axis at most; use --size 256", 2),
        ("voxels closed.obj --size 1025 -o v.png", "--size 1024", 2),
        ("voxels closed.obj --size 4 -o v.ply", "name it like v.npy\n", 2),
        ("voxels closed.obj --size 4 -o none/v.npy", "none/v.npy", 1),
        ("voxels flat.obj --size 4 -o v.npy", "flat.obj: no triangle has an area", 1),
        ("voxels none.obj --size 4 -o v.npy", "none.obj", 1),
        ("voxels closed.obj --size 4 -o closed.obj", "closed.obj", 2),
        ("voxels closed.obj --size 0 -o v.npy", "a whole number from 1 to 4096", 2),
        ("voxels closed.obj --size 1.5 -o v.npy", "a whole number from 1 to 4096", 2),
        ("voxels closed.obj --size 4097 -o v.npy", "--size", 2),
        ("voxels closed.obj --size 4", "--output", 2),
        ("voxels closed.obj -o v.npy", "--size", 2),
    ] {
        let output = raykd(&folder, line);
        assert_eq!(output.status.code(), Some(code), "{line}");
        assert!(text(&output.stderr).contains(told), "{line}: {}", text(&output.stderr));
        assert_eq!(text(&output.stdout), "", "{line}");
    }
    assert!(!folder.path().join("v.npy").exists() && !folder.path().join("v.vox").exists());
}
