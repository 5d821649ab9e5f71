//! Files of voxels.

use crate::{files::renamed, png_file};
use raykd::internals::quoted;
use std::{
    ffi::OsStr,
    io::{self, Write},
    ops::Range,
    path::Path,
};

/// A kind of file, by the end of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// A numpy array of booleans by x, y and z.
    Npy,
    /// MagicaVoxel's places and colours.
    Vox,
    /// A picture of all slices, a bit a voxel.
    Png,
}

impl Format {
    /// What the file is, if it holds so many voxels along an axis.
    pub(super) fn of(path: &Path, most: usize) -> Result<Self, String> {
        let name = quoted(path.display());
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        let (format, limit) = match extension.as_str() {
            "npy" => (Self::Npy, usize::MAX),
            "vox" => (Self::Vox, 256),
            "png" => (Self::Png, 1024),
            _ => {
                let better = renamed(path, "npy");
                return Err(format!(
                    "{name}: voxels are written as .npy, .vox or .png; name it like {better}"
                ));
            }
        };
        if most > limit {
            return Err(format!(
                "{name}: a .{extension} file takes {limit} voxels along an axis at most; use --size {limit}, or \
                 write a .npy"
            ));
        }
        Ok(format)
    }
}

/// A file that is written slab by slab.
pub(super) struct VoxelFile<'a> {
    to: &'a mut dyn Write,
    counts: [usize; 3],
    body: Body,
}

enum Body {
    /// Written already.
    Nothing,
    /// x, y, z and a colour.
    Places(Vec<[u8; 4]>),
    Bits {
        across: usize,
        bits: Vec<u8>,
    },
}

impl<'a> VoxelFile<'a> {
    pub(super) fn begin(to: &'a mut dyn Write, format: Format, counts: [usize; 3]) -> io::Result<Self> {
        let [x, y, z] = counts;
        let body = match format {
            Format::Npy => {
                let text = format!("{{'descr': '|b1', 'fortran_order': False, 'shape': ({x}, {y}, {z}), }}");
                // Data begins at a multiple of 64 bytes, behind a new line.
                let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
                to.write_all(b"\x93NUMPY\x01\x00")?;
                to.write_all(&(length as u16).to_le_bytes())?;
                writeln!(to, "{text:<0$}", length - 1)?;
                Body::Nothing
            }
            Format::Vox => Body::Places(Vec::new()),
            Format::Png => {
                let across = across(counts);
                let [width, height] = picture(counts);
                Body::Bits { across, bits: vec![0; width.div_ceil(8) * height] }
            }
        };
        Ok(Self { to, counts, body })
    }

    /// Adds the voxels of these numbers along x: z runs fastest, then y.
    pub(super) fn add(&mut self, xs: Range<usize>, voxels: &[u8]) -> io::Result<()> {
        let [_, height, depth] = self.counts;
        let row = picture(self.counts)[0].div_ceil(8);
        let filled = voxels.iter().enumerate().filter(|&(_, &voxel)| voxel != 0);
        let filled = filled.map(|(i, _)| [xs.start + i / (height * depth), i / depth % height, i % depth]);
        match &mut self.body {
            Body::Nothing => self.to.write_all(voxels)?,
            Body::Places(places) => {
                places.extend(filled.map(|[x, y, z]| [x as u8, y as u8, z as u8, 1]));
            }
            Body::Bits { across, bits } => {
                for [x, y, z] in filled {
                    let column = z % *across * self.counts[0] + x;
                    let line = z / *across * height + height - 1 - y;
                    bits[line * row + column / 8] |= 0x80 >> (column % 8);
                }
            }
        }
        Ok(())
    }

    /// Writes what is left.
    pub(super) fn end(self) -> io::Result<()> {
        match self.body {
            Body::Nothing => Ok(()),
            Body::Bits { bits, .. } => {
                png_file::write_bits(self.to, &bits, picture(self.counts).map(|side| side as u32))
            }
            Body::Places(places) => {
                let word = |x: usize| (x as u32).to_le_bytes();
                let chunk = |name: &[u8; 4], own: usize, others: usize| {
                    [name.as_slice(), &word(own), &word(others)].concat()
                };
                let [size, list] = [12, 4 + 4 * places.len()];
                let head = [
                    [b"VOX ".as_slice(), &word(150)].concat(),
                    chunk(b"MAIN", 0, 12 + size + 12 + list),
                    chunk(b"SIZE", size, 0),
                    self.counts.map(word).concat(),
                    chunk(b"XYZI", list, 0),
                    word(places.len()).to_vec(),
                ];
                self.to.write_all(&head.concat())?;
                self.to.write_all(places.as_flattened())
            }
        }
    }
}

/// How many slices stand side by side in a picture: about as many pixels as stand one above the other.
pub(super) fn across([x, y, z]: [usize; 3]) -> usize {
    (((z * y) as f64 / x as f64).sqrt().round() as usize).clamp(1, z)
}

/// Width and height of a picture of all slices.
fn picture(counts: [usize; 3]) -> [usize; 2] {
    let across = across(counts);
    [across * counts[0], counts[2].div_ceil(across) * counts[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two by three by five, of which three are filled, in two slabs.
    fn written(format: Format) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut file = VoxelFile::begin(&mut bytes, format, [2, 3, 5]).unwrap();
        let slab = |filled: &[[usize; 2]]| {
            let mut voxels = vec![0; 15];
            filled.iter().for_each(|[y, z]| voxels[y * 5 + z] = 1);
            voxels
        };
        file.add(0..1, &slab(&[[0, 1]])).unwrap();
        file.add(1..2, &slab(&[[2, 0], [1, 4]])).unwrap();
        file.end().unwrap();
        bytes
    }

    #[test]
    fn arrays_are_those_of_numpy() {
        let bytes = written(Format::Npy);
        let file = npyz::NpyFile::new(&bytes[..]).unwrap();
        assert_eq!((file.shape(), file.order(), bytes.len() % 64), (&[2, 3, 5][..], npyz::Order::C, 30));
        let voxels: Vec<bool> = file.into_vec().unwrap();
        let filled: Vec<usize> = (0..30).filter(|&i| voxels[i]).collect();
        assert_eq!(filled, [1, 15 + 9, 15 + 10]);
    }

    /// As the format's own text has it: <https://github.com/ephtracy/voxel-model>.
    #[test]
    fn places_are_those_of_magicavoxel() {
        let bytes = written(Format::Vox);
        let expected: [&[u8]; 8] = [
            b"VOX \x96\0\0\0MAIN\0\0\0\0\x34\0\0\0",
            b"SIZE\x0c\0\0\0\0\0\0\0\x02\0\0\0\x03\0\0\0\x05\0\0\0",
            b"XYZI\x10\0\0\0\0\0\0\0",
            b"\x03\0\0\0",
            &[0, 0, 1, 1],
            &[1, 1, 4, 1],
            &[1, 2, 0, 1],
            b"",
        ];
        assert_eq!(bytes, expected.concat());
    }

    /// Three slices side by side, then two, each with y upward.
    #[test]
    fn pictures_show_all_slices() {
        let bytes = written(Format::Png);
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, info.bit_depth), (6, 6, png::BitDepth::One));
        assert_eq!(pixels, [0b0100_0000, 0, 0b0010_0000, 0, 0b0001_0000, 0]);
    }

    #[test]
    fn names_tell_the_format_and_its_limit() {
        let of = |name: &str, most| Format::of(Path::new(name), most);
        assert_eq!(of("a.NPY", 4096), Ok(Format::Npy));
        assert_eq!([of("a.vox", 256), of("a.png", 1024)], [Ok(Format::Vox), Ok(Format::Png)]);
        assert!(of("a.vox", 257).unwrap_err().contains("256 voxels along an axis at most; use --size 256"));
        assert!(of("a.png", 1025).unwrap_err().contains("--size 1024"));
        for name in ["a", "a.ply", "npy"] {
            assert!(of(name, 1).unwrap_err().contains("name it like"), "{name}");
        }
    }
}
