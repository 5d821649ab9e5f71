//! The program `raykd`: what it does is in the library beside this file.

use std::process::ExitCode;

fn main() -> ExitCode {
    raykd_cli::main()
}
