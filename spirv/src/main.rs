//! Compiles a rust-gpu crate to a module that computes the same bytes on every device: see the library.

use raykd_spirv::{Compiler, Error, Module, finish, validate};
use std::{env, error, fs, process::ExitCode};

const USAGE: &str = "\
Usage: raykd-spirv compile CRATE MODULE [--features A,B] [--target-dir FOLDER]
       raykd-spirv finish MODULE MODULE

compile  compiles the rust-gpu crate in the folder CRATE, and writes the finished MODULE
finish   reads a MODULE that rust-gpu wrote, and writes it finished";

fn main() -> ExitCode {
    // SAFETY: this program has one thread.
    unsafe { raykd_spirv::set_environment() };
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let made = match arguments[..] {
        ["compile", from, to, ref options @ ..] => match compiler(from, options) {
            Some(compiler) => (compiler.compile().map(|compiled| compiled.module), to),
            None => return usage(),
        },
        ["finish", from, to] => (finished(from), to),
        _ => return usage(),
    };
    match write(made) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("raykd-spirv: {error}");
            let mut source = error.source();
            while let Some(cause) = source {
                eprintln!("  because: {cause}");
                source = cause.source();
            }
            ExitCode::FAILURE
        }
    }
}

fn usage() -> ExitCode {
    eprintln!("{USAGE}");
    ExitCode::from(2)
}

fn compiler(crate_dir: &str, mut options: &[&str]) -> Option<Compiler> {
    let mut compiler = Compiler::new(crate_dir);
    while let [name, value, rest @ ..] = options {
        compiler = match *name {
            "--features" => compiler.features(value.split(',')),
            "--target-dir" => compiler.target_dir(value),
            _ => return None,
        };
        options = rest;
    }
    options.is_empty().then_some(compiler)
}

fn finished(path: &str) -> Result<Module, Error> {
    let module = finish(&fs::read(path).map_err(|e| Error::File(path.into(), e))?)?;
    validate(&module.bytes)?;
    Ok(module)
}

fn write((module, path): (Result<Module, Error>, &str)) -> Result<(), Box<dyn error::Error>> {
    let module = module?;
    fs::write(path, &module.bytes).map_err(|e| Error::File(path.into(), e))?;
    let (bytes, floats) = (module.bytes.len(), module.exact_float_ops);
    println!("{path}: {} entry points, {bytes} bytes, {floats} float operations", module.entry_points.len());
    for entry in module.entry_points {
        println!("  {} {:?}", entry.name, entry.workgroup.unwrap_or_default());
    }
    Ok(())
}
