//! What the papers say of tests, files and numbers is there.

use serde_json::Value;
use std::{
    fs,
    path::{Path, PathBuf},
};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Files below a folder whose names end so; build outputs aside.
fn files(folder: &Path, end: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            found.extend(files(&path, end));
        } else if name.ends_with(end) {
            found.push(path);
        }
    }
    found
}

/// README and its like, and what docs holds.
fn papers() -> Vec<(PathBuf, String)> {
    let ours = [
        "README.md",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "peers/README.md",
        "python/README.md",
        "web/README.md",
    ]
    .map(|name| root().join(name));
    let all = ours.into_iter().chain(files(&root().join("docs"), ".md"));
    all.map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn every_case_of_the_contract_names_its_tests() {
    let contract = fs::read_to_string(root().join("docs/contract.md")).unwrap();
    let sources: Vec<_> = files(root(), ".rs").iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    let cases: Vec<_> = contract.split("\n- **").skip(1).collect();
    assert!(cases.len() > 8, "{} cases", cases.len());
    for case in cases {
        let (_, tests) = case.split_once("Tests:").unwrap_or_else(|| panic!("no test: {case}"));
        let tests = tests.split_once("\n#").map_or(tests, |(tests, _)| tests);
        let names: Vec<_> = tests.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "no test: {case}");
        for name in names {
            let there = |source: &String| {
                let at = source.find(&format!("fn {name}("));
                // Its attributes, and those of `proptest!`, stand right above.
                at.is_some_and(|at| source[..at].lines().rev().take(4).any(|line| line.contains("#[test]")))
            };
            assert!(sources.iter().any(there), "no test {name}: {case}");
        }
    }
}

#[test]
fn no_line_is_longer_than_120_columns() {
    // Code that rustfmt does not wrap.
    let others = ["python/raykd", "python/tests", "python/examples", "peers", "web/page", "web/test"];
    let others = others.iter().flat_map(|folder| {
        let of = |extension| files(&root().join(folder), extension);
        [of(".py"), of(".pyi"), of(".js"), of(".css")].concat()
    });
    let read = |path: PathBuf| (path.clone(), fs::read_to_string(path).unwrap());
    let (others, rust) = (others.map(read), files(root(), ".rs").into_iter().map(read));
    // Of Rust its comments, and what is not a string.
    let wrapped = |line: &&str| line.trim_start().starts_with("//") || !line.contains('"');
    for (path, text) in papers().into_iter().chain(others).chain(rust) {
        let any = path.extension().is_none_or(|extension| extension != "rs");
        for (i, line) in text.lines().enumerate().filter(|(_, line)| any || wrapped(line)) {
            let columns = line.chars().count();
            assert!(columns <= 120, "{}:{}: {columns} columns", path.display(), i + 1);
        }
    }
}

#[test]
fn links_lead_to_files() {
    let mut links = 0;
    for (path, text) in papers() {
        for link in text.split("](").skip(1).filter_map(|rest| rest.split_once(')')) {
            let target = link.0.split('#').next().unwrap();
            if !target.is_empty() && !target.contains("://") {
                let file = path.parent().unwrap().join(target);
                assert!(file.exists(), "{} links to {target}", path.display());
                links += 1;
            }
        }
    }
    assert!(links > 20, "{links} links");
}

/// The README's speeds are cells of docs/results.
#[test]
fn speeds_of_the_readme_are_measured() {
    let mut measured = Vec::new();
    for file in files(&root().join("docs/results"), ".json") {
        let section: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        for table in section["tables"].as_array().unwrap() {
            let of_dragon =
                |row: &&Value| row[0] == "dragon" || table["title"].as_str().unwrap().starts_with("Dragon");
            let rows = table["rows"].as_array().unwrap().iter().filter(of_dragon);
            measured.extend(rows.flat_map(|row| row.as_array().unwrap()).filter_map(Value::as_f64));
        }
    }
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, table) = readme.split_once("\n| Dragon").unwrap();
    let mut cells = 0;
    for row in table.lines().skip(2).take_while(|line| line.starts_with('|')) {
        for cell in row.trim_matches('|').split('|').skip(1).map(str::trim).filter(|cell| *cell != "-") {
            let number: f64 =
                cell.replace(',', "").parse().unwrap_or_else(|_| panic!("{cell} is no number: {row}"));
            assert!(measured.contains(&number), "{cell} is not in docs/results: {row}");
            cells += 1;
        }
    }
    assert!(cells > 8, "{cells} cells");
}

/// The crates are published without the folder docs.
#[test]
fn no_published_crate_points_to_docs() {
    for folder in ["shared", "kernels", "oracle", "host", "cli", "spirv"] {
        for path in files(&root().join(folder).join("src"), ".rs") {
            for (i, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
                let is_doc = line.trim_start().starts_with("///") || line.trim_start().starts_with("//!");
                assert!(!is_doc || !line.contains("docs/"), "{}:{}: {line}", path.display(), i + 1);
            }
        }
    }
}

#[test]
fn features_are_documented() {
    for folder in ["shared", "host", "kernels"] {
        let read = |file: &str| fs::read_to_string(root().join(folder).join(file)).unwrap();
        let manifest = read("Cargo.toml");
        let (_, features) = manifest.split_once("[features]\n").unwrap();
        let features = features.lines().take_while(|line| !line.starts_with('['));
        let names = features.filter_map(|line| line.split_once(" = ")).map(|(name, _)| name);
        let front = read("src/lib.rs");
        for name in names.filter(|name| *name != "default") {
            assert!(front.contains(&format!("//! * `{name}`")), "{folder}/src/lib.rs says nothing of {name}");
        }
    }
}
