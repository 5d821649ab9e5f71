//! What goes to standard error while a command works: the stage it is at, and remarks.

use crate::report::capitals;
use indicatif::{ProgressBar, ProgressStyle, WeakProgressBar};
use raykd::{Device, internals::quoted};
use std::{
    cell::RefCell,
    collections::HashSet,
    fmt::Display,
    io::{IsTerminal as _, Write as _, stderr},
    thread,
    time::Duration,
};

/// A spinner that names the stage, on a terminal only; and notes, always. Elsewhere long work says from time to
/// time where it is.
#[derive(Debug)]
pub(super) struct Notes {
    bar: ProgressBar,
    /// Notes so far, each of which is said once.
    noted: RefCell<HashSet<String>>,
}

/// Of long work without a terminal something is heard so often.
const OFTEN: Duration = Duration::from_secs(10);

impl Notes {
    /// With a spinner unless `quiet` or standard error is no terminal.
    pub(super) fn new(quiet: bool) -> Self {
        // indicatif hides bars by itself where standard error is no terminal.
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        bar.set_style(ProgressStyle::with_template("{spinner} {wide_msg}").expect("a valid template"));
        bar.enable_steady_tick(Duration::from_millis(120));
        if !quiet && !stderr().is_terminal() {
            tell_often(bar.downgrade());
        }
        Self { bar, noted: RefCell::default() }
    }

    /// From now on shows how many of so many jobs are done, and about how long the others will take.
    pub(super) fn expect(&self, jobs: usize) {
        self.bar.set_length(jobs as u64);
        let style = ProgressStyle::with_template("{spinner} {pos} of {len}, about {eta} left: {wide_msg}");
        self.bar.set_style(style.expect("a valid template"));
    }

    /// One of them is done.
    pub(super) fn step(&self) {
        self.bar.inc(1);
    }

    /// Says what happens now.
    pub(super) fn stage(&self, what: impl Display) {
        self.bar.set_message(quoted(what));
    }

    /// Says what happens now to something, and on which device.
    pub(super) fn stage_on(&self, it: impl Display, what: impl Display, device: &Device) {
        self.stage(format_args!("{it}: {what} on the {}", capitals(device)));
    }

    /// Says something to remember, unless it was said before.
    pub(super) fn note(&self, what: impl Display) {
        let what = what.to_string();
        if self.noted.borrow_mut().insert(what.clone()) {
            self.bar.suspend(|| eprintln!("note: {what}"));
        }
    }

    /// Takes the spinner away, before results are printed.
    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// Says what the spinner would show, as long as it is there.
fn tell_often(bar: WeakProgressBar) {
    let tell = move || {
        loop {
            thread::sleep(OFTEN);
            let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) else { return };
            let (after, stage, left) = (bar.elapsed().as_secs(), bar.message(), bar.eta().as_secs());
            let mut err = stderr();
            // Whoever closed it does not want to know.
            let _ = match (bar.position(), bar.length()) {
                (done, Some(all)) => {
                    writeln!(err, "note: after {after} s: {done} of {all} done, about {left} s left: {stage}")
                }
                _ => writeln!(err, "note: after {after} s: {stage}"),
            };
        }
    };
    // Without a thread nothing is heard, and the work goes on.
    let _ = thread::Builder::new().spawn(tell);
}

impl Drop for Notes {
    fn drop(&mut self) {
        self.clear();
    }
}
