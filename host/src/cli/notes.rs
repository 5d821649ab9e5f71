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
