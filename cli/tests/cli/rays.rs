//! `raykd rays`, and files of numpy for `raykd trace`, from outside.

use crate::{
    inside::{folder, raykd},
    npy, text,
};
use serde_json::Value;
use std::fs;

/// What stands behind the header of an NPY file, and the header.
fn array(bytes: &[u8]) -> (&[u8], &str) {
    assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    (&bytes[end..], text(&bytes[10..end]))
}

#[test]
fn files_of_numpy_hold_what_plain_files_do() {
    let folder = folder();
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    let run = |line: &str| {
        let told = raykd(&folder, &format!("{line} --device cpu --json"));
        assert!(told.status.success(), "{line}: {}", text(&told.stderr));
        serde_json::from_slice::<Value>(&told.stdout).unwrap()
    };
    for kind in ["primary", "diffuse", "shadow", "random"] {
        let told = run(&format!("rays closed.obj {kind} -o rays.npy"));
        run(&format!("rays closed.obj {kind} -o rays.bin"));
        let (npy, bin) = (read("rays.npy"), read("rays.bin"));
        let (numbers, header) = array(&npy);
        assert_eq!(numbers, bin, "{kind}");
        assert!(header.contains("'<f4'"), "{header}");
        assert_eq!(told["rays"], bin.len() / 32);
    }
    // Those that are there now are random.
    for (query, named) in [("closest", "'triangle', '<u4'"), ("count", "'<u4'")] {
        run(&format!("trace closed.obj --query {query} --rays rays.npy --hits hits.npy"));
        let told = run(&format!("trace closed.obj --query {query} --rays rays.bin --hits hits.bin"));
        let (npy, bin) = (read("hits.npy"), read("hits.bin"));
        let (records, header) = array(&npy);
        assert_eq!(records, bin);
        assert!(header.contains(named), "{header}");
        assert!(told["hits"].as_u64().unwrap() > 1000);
    }
}

/// Far from zero, where rays take more digits.
#[test]
fn rays_of_a_mesh_far_away_are_wide() {
    let folder = folder();
    let far = "v 1e9 0 0\nv 1000000004 0 0\nv 1e9 4 0\nv 1e9 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(folder.path().join("far.obj"), far).unwrap();
    for (mesh, number) in [("closed.obj", "'<f4'"), ("far.obj", "'<f8'")] {
        let told = raykd(&folder, &format!("rays {mesh} random -o rays.npy --device cpu"));
        assert!(told.status.success(), "{}", text(&told.stderr));
        assert!(array(&fs::read(folder.path().join("rays.npy")).unwrap()).1.contains(number));
        let told = raykd(&folder, &format!("trace {mesh} --rays rays.npy --hits h --device cpu --json"));
        let told: Value = serde_json::from_slice(&told.stdout).unwrap();
        assert!(told["hits"].as_u64().unwrap() > 10_000, "{mesh}: {told}");
    }
}

#[test]
fn arrays_that_are_no_rays_are_refused() {
    let folder = folder();
    fs::write(folder.path().join("no.npy"), "no array").unwrap();
    // The points of another test's array: three numbers a row.
    fs::write(folder.path().join("points.npy"), npy("<f4", "(1, 3)", &[0; 12])).unwrap();
    // So many numbers are none, counted in 64 bits.
    fs::write(folder.path().join("huge.npy"), npy("<f4", "(2305843009213693952, 8)", &[])).unwrap();
    for (file, reason) in [
        ("no.npy", "no NPY array"),
        ("points.npy", "rays are an array of N x 8"),
        ("huge.npy", "the 2305843009213693952 rays that it promises"),
    ] {
        let told = raykd(&folder, &format!("trace closed.obj --rays {file} --hits h --device cpu"));
        assert_eq!(told.status.code(), Some(1));
        assert!(text(&told.stderr).contains(reason), "{}", text(&told.stderr));
    }
}
