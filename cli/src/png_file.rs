//! PNG files.

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};
use std::io::{self, Write};

/// Writes a picture: red, green and blue of each pixel, row by row.
pub(super) fn write(to: impl Write, rgb: &[u8], size: [u32; 2]) -> io::Result<()> {
    encoded(to, rgb, size, ColorType::Rgb, BitDepth::Eight)
}

/// Writes a picture of black and white, a bit a pixel: each row begins with a byte.
pub(super) fn write_bits(to: impl Write, bits: &[u8], size: [u32; 2]) -> io::Result<()> {
    encoded(to, bits, size, ColorType::Grayscale, BitDepth::One)
}

fn encoded(
    to: impl Write,
    pixels: &[u8],
    [width, height]: [u32; 2],
    color: ColorType,
    depth: BitDepth,
) -> io::Result<()> {
    let mut encoder = Encoder::new(to, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(pixels)?;
        writer.finish()
    });
    written.map_err(|error| match error {
        EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    })
}
