//! The program `raykd`; everything is in [`raykd::cli`].

use std::{env, process::ExitCode};

fn main() -> ExitCode {
    // Mesa's layer for choosing a device asks Wayland, which says "error: XDG_RUNTIME_DIR is invalid" on every
    // machine without a desktop. We choose devices ourselves.
    if env::var_os("XDG_RUNTIME_DIR").is_none() && env::var_os("MESA_VK_DEVICE_SELECT").is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { env::set_var("NODEVICE_SELECT", "1") };
    }
    raykd::cli::main()
}
