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

use std::{fs::File, io::BufReader, path::Path};

/// Width, height, and red, green and blue of each pixel.
fn picture(file: &Path) -> ([u32; 2], Vec<[u8; 3]>) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(file).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((frame.color_type, frame.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    ([frame.width, frame.height], bytes.as_chunks().0.to_vec())
}
