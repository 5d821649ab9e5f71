//! The program `raykd` from outside.

mod charts;
#[cfg(feature = "gpu")]
mod commands;
#[cfg(unix)]
mod faults;
#[cfg(feature = "gpu")]
mod inside;
#[cfg(unix)]
mod outputs;
#[cfg(feature = "gpu")]
mod rays;
#[cfg(feature = "gpu")]
mod stress;
#[cfg(feature = "gpu")]
mod voxels;

use std::{
    fs::{self, File},
    io::BufReader,
    path::Path,
    process::{Command, Output, Stdio},
};
use tempfile::TempDir;

fn command(line: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_raykd"));
    command.args(line).stdin(Stdio::null());
    command
}

/// A file of numpy's: numbers of a kind, in rows.
fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    [&b"\x93NUMPY\x01\x00"[..], &length, header.as_bytes(), data].concat()
}

/// The program in a folder, with a line of words.
fn within(folder: &TempDir, line: &str) -> Command {
    let mut command = command(&line.split(' ').collect::<Vec<_>>());
    command.current_dir(folder);
    command
}

fn raykd(line: &[&str]) -> Output {
    command(line).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

/// What a program said beside its output.
#[cfg(unix)]
fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The names in a folder, in order.
#[cfg(unix)]
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Width, height, and red, green and blue of each pixel.
fn picture(file: &Path) -> ([u32; 2], Vec<[u8; 3]>) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(file).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((frame.color_type, frame.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    ([frame.width, frame.height], bytes.as_chunks().0.to_vec())
}
