//! PNG files.

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};
use std::io::{self, Write};

/// Writes a picture: red, green and blue of each pixel, row by row.
pub(super) fn write(to: impl Write, rgb: &[u8], [width, height]: [u32; 2]) -> io::Result<()> {
    let mut encoder = Encoder::new(to, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(rgb)?;
        writer.finish()
    });
    written.map_err(|error| match error {
        EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    })
}
