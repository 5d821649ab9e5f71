//! The program `raykd`; `src/main.rs` calls [`main`] and has nothing else.
//!
//! A library is compiled beside the crates it needs, a program after them: as one, both are built sooner.

mod amount;
mod args;
mod builders;
mod changes;
mod commands;
mod compare;
mod costs;
mod files;
mod hints;
mod input;
mod machine;
mod measure;
mod notes;
mod npy;
mod png_file;
mod points;
mod ray_file;
mod report;
#[cfg(unix)]
mod signals;
mod task;

use clap::{
    Parser as _,
    error::{ContextKind, ContextValue},
};
use commands::Args;
use raykd::internals::{QUOTED, quoted};
use std::{
    env,
    ffi::OsString,
    fmt::Write as _,
    io::{self, StdoutLock, Write as _},
    process::ExitCode,
};

/// Runs the program with the arguments of this process. Gives the exit code 0 for success, 1 for an error or a
/// difference between devices, 2 for wrong usage.
pub fn main() -> ExitCode {
    // Mesa's layer for choosing a device asks Wayland, which says "error: XDG_RUNTIME_DIR is invalid" on every
    // machine without a desktop. We choose devices ourselves.
    if env::var_os("XDG_RUNTIME_DIR").is_none() && env::var_os("MESA_VK_DEVICE_SELECT").is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { env::set_var("NODEVICE_SELECT", "1") };
    }
    #[cfg(unix)]
    signals::watch();
    let args = Args::try_parse_from(words(env::args_os())).and_then(|args| args.check().map(|()| args));
    let args = match args {
        Ok(args) => args,
        Err(error) => return said(&shortened(error)),
    };
    let mut out = io::stdout().lock();
    let done = run(&args, &mut out).and_then(|code| Ok(out.flush().map(|()| code)?));
    done.unwrap_or_else(|error| {
        if reader_left(&error) {
            return ExitCode::SUCCESS;
        }
        eprint!("{}", told(&error));
        ExitCode::FAILURE
    })
}

/// The words of the command line, but those that ask `raykd help` for help: it knows the names of commands only.
fn words(mut line: impl Iterator<Item = OsString>) -> impl Iterator<Item = OsString> {
    let begin = line.by_ref().take(2).collect::<Vec<_>>();
    let help = begin.get(1).is_some_and(|word| word == "help");
    begin.into_iter().chain(line.filter(move |word| !help || (word != "--help" && word != "-h")))
}

fn run(args: &Args, out: &mut StdoutLock<'_>) -> anyhow::Result<ExitCode> {
    let (.., task) = args.command.task();
    task.files().check()?;
    task.run(out)
}

/// Says what is wrong with the command line, or the help that it asks for.
fn said(error: &clap::Error) -> ExitCode {
    let printed = error.print().and_then(|()| io::stdout().flush()).map_err(Into::into);
    match printed {
        Err(failed) if !error.use_stderr() && !reader_left(&failed) => {
            eprint!("{}", told(&failed));
            ExitCode::FAILURE
        }
        _ => ExitCode::from(error.exit_code() as u8),
    }
}

/// Wrong usage, quoting no more of an argument than other messages do.
fn shortened(mut error: clap::Error) -> clap::Error {
    let quotes: Vec<_> = error
        .context()
        .filter_map(|(kind, value)| match value {
            ContextValue::String(text) => Some((kind, quoted(text))),
            _ => None,
        })
        .collect();
    for (kind, text) in quotes {
        error.insert(kind, ContextValue::String(text));
    }
    // What to write instead quotes it again.
    if env::args_os().any(|argument| argument.len() > QUOTED) {
        error.remove(ContextKind::Suggested);
    }
    error
}

/// Whether whoever read our standard output has had enough (`raykd bench | head -1`): no error.
fn reader_left(error: &anyhow::Error) -> bool {
    let kind = match error.downcast_ref::<io::Error>() {
        Some(error) => Some(error.kind()),
        None => error.downcast_ref::<serde_json::Error>().and_then(serde_json::Error::io_error_kind),
    };
    kind == Some(io::ErrorKind::BrokenPipe)
}

/// An error with those of its causes that it does not quote itself, and what to do about them.
fn told(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let hint = hints::of(cause);
        let told = cause.to_string();
        if text.is_empty() {
            let _ = writeln!(text, "error: {told}{hint}");
        } else if !text.contains(&told) {
            let _ = writeln!(text, "  because: {}{hint}", quoted(told));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn causes_are_told_once() {
        let inner = anyhow::anyhow!("disk full");
        assert_eq!(
            told(&inner.context("cannot write a.png")),
            "error: cannot write a.png\n  because: disk full\n"
        );
        let quoted = raykd::Error::Io { path: "a".into(), source: io::Error::other("disk full") };
        assert_eq!(told(&quoted.into()), "error: a: disk full\n");
    }

    #[test]
    fn hints_follow_what_they_are_for() {
        let failed =
            || raykd::Error::DeviceFailed { adapter: "Voodoo 2".to_owned(), what: "it broke".to_owned() };
        let hinted = "Voodoo 2: it broke; the same job gives the same bytes on the CPU: --device cpu\n";
        assert_eq!(told(&failed().into()), format!("error: {hinted}"));
        let within = Err::<(), _>(failed()).context("no picture").unwrap_err();
        assert_eq!(told(&within), format!("error: no picture\n  because: {hinted}"));
        let long = raykd::mesh::MeshError::TooLong { at: Default::default(), limit: 7 };
        assert!(told(&long.into()).ends_with("allow more by --max-bytes\n"));
    }

    #[test]
    fn only_a_closed_stdout_is_no_error() {
        let pipe = || io::Error::from(io::ErrorKind::BrokenPipe);
        assert!(reader_left(&pipe().into()));
        assert!(reader_left(&serde_json::Error::io(pipe()).into()));
        assert!(!reader_left(&raykd::Error::Io { path: "a".into(), source: pipe() }.into()));
        let wrapped: anyhow::Error = io::Result::<()>::Err(io::Error::other("x")).context("y").unwrap_err();
        assert!(!reader_left(&wrapped));
    }
}
