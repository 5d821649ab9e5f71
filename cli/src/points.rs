//! Files of points.

use crate::npy::{self, Rows};
use anyhow::{Context as _, anyhow, bail};
use raykd::internals::{all_of, ply_vertices, quoted};
use std::{
    ffi::OsStr,
    io::{self, Write},
    path::Path,
};

/// The points of a file, in the mesh's own coordinates, and what is needed to write them again.
pub(super) struct Points {
    pub points: Vec<[f64; 3]>,
    format: Format,
}

/// What the file was.
enum Format {
    /// Fields of every line, and of a first line that names them.
    Csv {
        head: Option<csv::StringRecord>,
        lines: Vec<csv::StringRecord>,
    },
    Npy,
    Ply,
}

impl Points {
    /// Reads a file whose name ends in `.npy` or `.ply`, or else lines of three numbers with commas between.
    pub(super) fn read(path: &Path, max_bytes: u64) -> anyhow::Result<Self> {
        let bytes = all_of(path, max_bytes)?;
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        let found = match extension.as_str() {
            _ if npy::is_named(path) => npy(&bytes),
            "ply" => {
                ply_vertices(&bytes).map_err(Into::into).map(|points| Self { points, format: Format::Ply })
            }
            _ => text(&bytes),
        };
        found.with_context(|| quoted(path.display()))
    }

    /// Whether they came from an NPY file.
    pub(super) fn are_npy(&self) -> bool {
        matches!(self.format, Format::Npy)
    }

    /// Writes the points with a fourth number: as an NPY file of `f64`, or as lines of text, with what else the lines
    /// held that they came from.
    pub(super) fn write(&self, file: &mut dyn Write, numbers: &[i32], as_npy: bool) -> io::Result<()> {
        match &self.format {
            _ if as_npy => {
                let rows = self.points.iter().zip(numbers);
                let numbers = rows.flat_map(|(&[x, y, z], &number)| [x, y, z, f64::from(number)]);
                npy::write(file, &[self.points.len(), 4], numbers)
            }
            Format::Npy | Format::Ply => {
                for ([x, y, z], number) in self.points.iter().zip(numbers) {
                    writeln!(file, "{x},{y},{z},{number}")?;
                }
                Ok(())
            }
            Format::Csv { head, lines } => {
                let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(file);
                if let Some(head) = head {
                    writer.write_record(head.iter().chain(["winding"])).map_err(unwrapped)?;
                }
                for (line, number) in lines.iter().zip(numbers) {
                    let number = number.to_string();
                    writer.write_record(line.iter().chain([number.as_str()])).map_err(unwrapped)?;
                }
                writer.flush()
            }
        }
    }
}

/// What went wrong in writing: csv's own conversion hides its kind, by which a reader who left is known.
fn unwrapped(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        kind => io::Error::other(format!("{kind:?}")),
    }
}

fn npy(bytes: &[u8]) -> anyhow::Result<Points> {
    let points = match npy::rows(bytes, "points")? {
        Rows::Narrow(points) => points.into_iter().map(|point| point.map(f64::from)).collect(),
        Rows::Wide(points) => points,
    };
    Ok(Points { points, format: Format::Npy })
}

fn text(bytes: &[u8]) -> anyhow::Result<Points> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let (mut points, mut head, mut lines) = (Vec::new(), None, Vec::new());
    for record in reader.records() {
        let record = record.map_err(|error| match error.kind() {
            csv::ErrorKind::Utf8 { pos, .. } => {
                let line = pos.as_ref().map_or(0, csv::Position::line);
                anyhow!("line {line}: this is no UTF-8 text; save the file as CSV in UTF-8")
            }
            _ => error.into(),
        })?;
        // csv itself knows comments only where no blank stands before them.
        if record.get(0).is_some_and(|field| field.starts_with('#')) {
            continue;
        }
        let number = |i: usize| record.get(i).and_then(|field| field.parse::<f64>().ok());
        match (number(0), number(1), number(2)) {
            (Some(x), Some(y), Some(z)) => {
                points.push([x, y, z]);
                lines.push(record);
            }
            // A first line that names the columns.
            (None, None, None) if points.is_empty() && head.is_none() && record.len() >= 3 => {
                head = Some(record)
            }
            _ => {
                let line = record.position().map_or(0, csv::Position::line);
                let text = quoted(record.iter().collect::<Vec<_>>().join(","));
                bail!("line {line}: {text} does not begin with three numbers with commas between, x,y,z");
            }
        }
    }
    Ok(Points { points, format: Format::Csv { head, lines } })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, bytes: &[u8]) -> anyhow::Result<Points> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Points::read(&path, 1 << 20)
    }

    fn written(points: &Points, numbers: &[i32]) -> Vec<u8> {
        let mut out = Vec::new();
        points.write(&mut out, numbers, points.are_npy()).unwrap();
        out
    }

    #[test]
    fn lines_keep_their_text() {
        let found =
            read("p.csv", b"# made by hand\n \t# twice\nx,y,z,name\n1.0, 2,3,a\n  #c\n-1e-3,0,nan,\"b,c\"\n")
                .unwrap();
        assert_eq!(found.points[0], [1.0, 2.0, 3.0]);
        assert_eq!((found.points[1][0], found.points[1][2].is_nan()), (-1e-3, true));
        let text = String::from_utf8(written(&found, &[1, 0])).unwrap();
        assert_eq!(text, "x,y,z,name,winding\n1.0,2,3,a,1\n-1e-3,0,nan,\"b,c\",0\n");
        assert!(read("p.csv", b"").unwrap().points.is_empty());
    }

    /// `raykd inside ... | head -1` is no error.
    #[test]
    fn a_reader_who_leaves_is_known() {
        struct Closed;
        impl Write for Closed {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::BrokenPipe.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let lines = "1,2,3\n".repeat(5000);
        let found = read("p.csv", lines.as_bytes()).unwrap();
        let error = found.write(&mut Closed, &[0; 5000], false).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn wrong_lines_are_named() {
        for (text, told) in [
            (&b"1,2,3\n1,2\n"[..], "line 2: "),
            (b"a,b\n", "line 1: "),
            (b"x,y,z\nx,y,z\n", "line 2: "),
            (b"1,2,3\nx,y,z\n", "line 2: "),
            (b"1 2 3\n", "line 1: "),
            (b"# gr\xfc\xdfe\n1,2,3\n4,5,6,gr\xfc\n", "p.csv: line 3: this is no UTF-8 text; save the file"),
        ] {
            let error = format!("{:#}", read("p.csv", text).err().unwrap());
            assert!(error.contains(told), "{error}");
        }
    }

    #[test]
    fn arrays_of_both_widths_and_orders() {
        let npy = |kind: &str, order: &str, shape: &str, data: &[u8]| {
            let head = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
            let pad = " ".repeat(127 - 10 - head.len());
            [b"\x93NUMPY\x01\x00\x76\x00".as_slice(), head.as_bytes(), pad.as_bytes(), b"\n", data].concat()
        };
        let narrow: Vec<u8> = (1..=6).flat_map(|x| (x as f32).to_le_bytes()).collect();
        let wide: Vec<u8> = [1, 4, 2, 5, 3, 6].iter().flat_map(|&x| f64::from(x).to_le_bytes()).collect();
        let wanted = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        let rows = read("p.npy", &npy("<f4", "False", "(2, 3)", &narrow)).unwrap();
        assert_eq!(rows.points, wanted);
        assert_eq!(read("p.npy", &npy("<f8", "True", "(2, 3)", &wide)).unwrap().points, wanted);
        let back = written(&rows, &[7, -1]);
        let array: Vec<f64> = npyz::NpyFile::new(&back[..]).unwrap().into_vec().unwrap();
        assert_eq!(array, [1.0, 2.0, 3.0, 7.0, 4.0, 5.0, 6.0, -1.0]);
        for (kind, shape, told) in [
            ("<i4", "(2, 3)", "neither f32 nor f64"),
            ("<f4", "(6,)", "its shape is [6]"),
            ("<f4", "(3, 2)", "its shape is [3, 2]"),
            ("<f4", "(3, 3)", "the 3 points that it promises"),
            ("<f4", "(4611686018427387904, 3)", "points that it promises"),
        ] {
            let error = read("p.npy", &npy(kind, "False", shape, &narrow)).err().unwrap();
            assert!(format!("{error:#}").contains(told), "{kind} {shape}: {error:#}");
        }
    }

    /// What numpy never writes for numbers would take minutes, or the whole stack, to understand.
    #[test]
    fn headers_of_many_brackets_are_refused() {
        let deep = [b"(".repeat(5000), b"1".to_vec(), b",)".repeat(5000)].concat();
        let fields = b"{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,), }";
        let digits = [&b"{'shape': ("[..], &b"1".repeat(1 << 17)].concat();
        for header in [&b"{".repeat(31), &b"[".repeat(31), &deep, &fields.to_vec(), &digits] {
            let length = (header.len() as u32).to_le_bytes();
            for version in 1..=3 {
                if version == 1 && header.len() >= 1 << 16 {
                    continue;
                }
                let length = if version == 1 { &length[..2] } else { &length };
                let bytes = [&[0x93], &b"NUMPY"[..], &[version, 0], length, header].concat();
                let error = read("p.npy", &bytes).err().unwrap();
                assert!(format!("{error:#}").contains("not that of an array of plain numbers"), "{error:#}");
            }
        }
        for cut in
            [&b"\x93NUMPY"[..], b"\x93NUMPY\x01\0\xff", b"\x93NUMPY\x01\0\xff\0{", b"\x93NUMPY\x02\0\xff\0\0"]
        {
            assert!(read("p.npy", cut).err().unwrap().to_string().contains("p.npy"));
        }
    }

    #[test]
    fn vertices_without_faces() {
        let head = "ply\nformat ascii 1.0\nelement vertex 2\n";
        let text =
            format!("{head}property float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n4 5 6\n");
        let found = read("p.ply", text.as_bytes()).unwrap();
        assert_eq!(found.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(written(&found, &[0, 1]), b"1,2,3,0\n4,5,6,1\n");
    }
}
