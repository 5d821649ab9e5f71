//! Signals that stop the program: temporary files are removed first.

use raykd::internals::output;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU, SIGXFSZ},
    flag,
    iterator::Signals,
    low_level::emulate_default_handler,
};
use std::{mem::zeroed, ptr, sync::mpsc, thread};

/// What stops the program and can be caught.
const STOPPING: [i32; 5] = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU];

/// Whether whoever started the program wants it to go on in spite of a signal, as `nohup` does.
fn is_ignored(signal: i32) -> bool {
    // SAFETY: without a new action, sigaction only tells the present one, and all zeros are a value of its type.
    unsafe {
        let mut now: libc::sigaction = zeroed();
        libc::sigaction(signal, ptr::null(), &raw mut now) == 0 && now.sa_sigaction == libc::SIG_IGN
    }
}

/// From now on temporary files are removed before a signal ends the program, and a file that must not grow further
/// (`ulimit -f`) is an error of writing, as a full disk is. Where that cannot be had, signals do what they always do.
pub(super) fn watch() {
    let _ = flag::register(SIGXFSZ, Default::default());
    let (ready, done) = mpsc::channel::<()>();
    let watching = move || {
        let Ok(mut signals) = Signals::new(STOPPING.into_iter().filter(|&signal| !is_ignored(signal))) else {
            return;
        };
        drop(ready);
        for signal in signals.forever() {
            let _none_is_made = output::abandon();
            let _ = emulate_default_handler(signal);
        }
    };
    if thread::Builder::new().name("signals".to_owned()).spawn(watching).is_ok() {
        let _ = done.recv();
    }
}
