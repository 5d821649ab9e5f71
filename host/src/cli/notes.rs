//! What goes to standard error while a command works: the stage it is at, and remarks.

use indicatif::{ProgressBar, ProgressStyle};
use std::{fmt::Display, time::Duration};

/// A spinner that names the stage, on a terminal only; and notes, always.
#[derive(Debug)]
pub(super) struct Notes(ProgressBar);

impl Notes {
    /// With a spinner unless `quiet` or standard error is no terminal.
    pub(super) fn new(quiet: bool) -> Self {
        // indicatif hides bars by itself where standard error is no terminal.
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        bar.set_style(ProgressStyle::with_template("{spinner} {wide_msg}").expect("a valid template"));
        bar.enable_steady_tick(Duration::from_millis(120));
        Self(bar)
    }

    /// From now on shows how many of so many jobs are done, and about how long the others will take.
    pub(super) fn expect(&self, jobs: usize) {
        self.0.set_length(jobs as u64);
        let style = ProgressStyle::with_template("{spinner} {pos} of {len}, about {eta} left: {wide_msg}");
        self.0.set_style(style.expect("a valid template"));
    }

    /// One of them is done.
    pub(super) fn step(&self) {
        self.0.inc(1);
    }

    /// Says what happens now.
    pub(super) fn stage(&self, what: impl Display) {
        self.0.set_message(what.to_string());
    }

    /// Says something to remember.
    pub(super) fn note(&self, what: impl Display) {
        self.0.suspend(|| eprintln!("note: {what}"));
    }

    /// Takes the spinner away, before results are printed.
    pub(super) fn clear(&self) {
        self.0.finish_and_clear();
    }
}

impl Drop for Notes {
    fn drop(&mut self) {
        self.clear();
    }
}
