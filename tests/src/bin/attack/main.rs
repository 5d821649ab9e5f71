//! An attack on raykd: hostile meshes, trees, places, limits and moments, each case in a process that it may bring
//! down, each answer judged. `cargo xtask attack` builds what it needs and runs it.
#![forbid(unsafe_code)]

mod harness;
mod judge;
mod library;
#[cfg(unix)]
mod limits;
mod meshes;
#[cfg(unix)]
mod places;
mod scenes;
mod trees;

use harness::Case;
use std::process::ExitCode;

/// All cases, always in the same order.
fn cases() -> Vec<Case> {
    let mut all = meshes::cases();
    #[cfg(unix)]
    all.extend(places::cases().into_iter().chain(limits::cases()));
    all.extend(library::cases());
    all.extend(trees::cases());
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
