//! What papers say of the sources.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The Rust files below a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Uses of the keyword that are not in a comment or a message.
fn uses(text: &str) -> usize {
    let code = |line: &&str| !line.trim_start().starts_with("//");
    let counted = |line: &str| {
        let words = line.split(|c: char| !c.is_alphanumeric() && c != '_');
        words.filter(|&word| word == "unsafe").count()
    };
    text.lines().filter(code).map(counted).sum()
}

#[test]
fn every_unsafe_is_listed() {
    let root = root();
    let paper = fs::read_to_string(root.join("docs/unsafe.md")).unwrap();
    let rows = paper.lines().filter_map(|line| {
        let mut cells = line.split('|').map(str::trim).skip(1);
        Some((cells.next()?.to_owned(), cells.next()?.parse().ok()?))
    });
    let listed: BTreeMap<String, usize> = rows.collect();
    let mut files = Vec::new();
    for folder in [
        "shared/src",
        "kernels/src",
        "oracle/src",
        "host/src",
        "cli/src",
        "spirv/src",
        "python/src",
        "xtask/src",
        "xtask/kernels/src",
    ] {
        sources(&root.join(folder), &mut files);
    }
    let counted = files.iter().filter_map(|file| {
        let name = file.strip_prefix(&root).unwrap().to_str().unwrap().replace('\\', "/");
        Some((name, uses(&fs::read_to_string(file).unwrap()))).filter(|&(_, count)| count > 0)
    });
    assert_eq!(listed, counted.collect(), "docs/unsafe.md, left, lists other uses than there are, right");
}
