//! An attack on raykd: hostile meshes, names, limits and moments, each case in a process that it may bring down, each
//! answer judged. `cargo xtask attack` builds what it needs and runs it. Files of meshes and trees are tested by
//! `host/tests/mesh` and `tests/tests/mutants.rs`.
#![forbid(unsafe_code)]

mod harness;
mod library;
#[cfg(unix)]
mod limits;
mod scenes;

use harness::Case;
use std::process::ExitCode;

/// All cases, always in the same order.
fn cases() -> Vec<Case> {
    let mut all = library::cases();
    #[cfg(unix)]
    all.extend(limits::cases());
    all.extend(scenes::cases());
    all
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let wanted = |names: &[String]| -> Vec<Case> {
        let named =
            |case: &Case| names.is_empty() || names.iter().any(|name| case.name.contains(name.as_str()));
        cases().into_iter().filter(named).collect()
    };
    match args.split_first() {
        Some((worker, [first, names @ ..])) if worker == "--worker" => {
            harness::work(&wanted(names), first.parse().expect("the number of a case"));
            ExitCode::SUCCESS
        }
        _ => harness::supervise(&wanted(&args), &args),
    }
}
