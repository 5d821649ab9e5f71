//! Stanford PLY: text, binary little-endian and binary big-endian.
//!
//! `ply-rs-bw` reads the header and binary elements. Text elements are read here: version 4.0.1 refuses
//! numbers such as `.5` and `1.`, and takes three times as long.

use crate::mesh::error::{self, MeshError, Place, Spot, check_triangles, malformed, quoted_bytes, truncated};
use crate::mesh::raw::{Polygon, Raw, decimal, fits, split_line, unmarked};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    BeginList, ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
    ScalarType,
};
use std::collections::HashSet;
use std::io::ErrorKind;

/// Whether a file begins as one does.
pub(super) fn begins(bytes: &[u8]) -> bool {
    let text = unmarked(bytes);
    text.starts_with(b"ply\n") || text.starts_with(b"ply\r")
}

/// The mesh of a PLY file, its triangles numbered in the order of the faces.
pub(super) fn parse(bytes: &[u8]) -> Result<Raw, MeshError> {
    read(bytes, true)
}

/// The vertices of a PLY file, which need have no faces.
///
/// # Errors
/// The file cannot be understood.
pub fn ply_vertices(bytes: &[u8]) -> Result<Vec<[f64; 3]>, MeshError> {
    Ok(read(bytes, false)?.positions)
}

fn read(bytes: &[u8], with_faces: bool) -> Result<Raw, MeshError> {
    let bytes = unmarked(bytes);
    let head = plain_header(bytes);
    let mut reader = Reader::new(&head[..]);
    let header = Parser::<Record>::new().read_header(&mut reader).map_err(|e| header_error(&e))?;
    let line = reader.line() as u64;
    let length = head.len() - reader.into_inner().len();
    no_name_twice(&head[..length])?;
    let body = &bytes[length..];
    let mut sink = Sink::new(&header, with_faces)?;
    match header.encoding {
        Encoding::Ascii => Text { rest: body, line }.read(&header, &mut sink)?,
        Encoding::BinaryLittleEndian => Binary { rest: body, big_endian: false }.read(&header, &mut sink)?,
        Encoding::BinaryBigEndian => Binary { rest: body, big_endian: true }.read(&header, &mut sink)?,
    }
    Ok(sink.raw)
}

/// The header as `ply-rs-bw` takes it, of the same length: all lines end with LF, and comments are ASCII
/// without other ends of lines.
fn plain_header(bytes: &[u8]) -> Vec<u8> {
    // The first line's end is that of all: behind the last one, any byte may begin a binary body.
    let end = if bytes.starts_with(b"ply\r") && bytes.get(4) != Some(&b'\n') { b'\r' } else { b'\n' };
    let mut header = Vec::new();
    for line in bytes.split_inclusive(|&b| b == end) {
        let comment = line.starts_with(b"comment") || line.starts_with(b"obj_info");
        // A CR before the LF belongs to the end.
        let text = line.strip_suffix(b"\r\n").map_or(line.len() - 1, <[u8]>::len);
        header.extend(line.iter().enumerate().map(|(at, &b)| match b {
            b if b == end => b'\n',
            b if comment && (!b.is_ascii() || at < text && matches!(b, b'\r' | b'\n')) => b'?',
            b => b,
        }));
        if line.trim_ascii() == b"end_header" {
            break;
        }
    }
    header
}

fn header_error(e: &ParseError) -> MeshError {
    let at = e.line().map_or_else(Place::header, |line| Place::line(line as u64));
    let text = e.to_string();
    // `Line 3: what happened`, followed by lines of detail.
    let what = text.lines().next().unwrap_or_default();
    let what = what.split_once(": ").filter(|_| e.line().is_some()).map_or(what, |(_, what)| what);
    let what = quoted_bytes(what.trim_end_matches('.').as_bytes());
    if e.kind() == ErrorKind::UnexpectedEof { truncated(at, what) } else { malformed(at, what) }
}

/// Refuses two elements, or two properties of an element, of one name: of those `ply-rs-bw` tells the last only.
fn no_name_twice(header: &[u8]) -> Result<(), MeshError> {
    // Sets, as a header may name hundreds of thousands.
    let (mut elements, mut properties) = (HashSet::new(), HashSet::new());
    for (line, text) in (1..).zip(header.split(|&b| b == b'\n')) {
        let mut words = text.trim_ascii().split(u8::is_ascii_whitespace);
        let (names, name) = match words.next() {
            Some(b"element") => {
                properties.clear();
                (&mut elements, words.find(|word| !word.is_empty()))
            }
            Some(b"property") => (&mut properties, words.next_back()),
            _ => continue,
        };
        if !names.insert(name) {
            let name = quoted_bytes(name.unwrap_or_default());
            let what = format!("the name '{name}' is taken by an earlier element or property");
            return Err(malformed(Place::line(line), what));
        }
    }
    Ok(())
}

/// What an element is to us.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Vertex,
    Face,
    /// Strips of triangles: each next corner makes one with the two before it, and -1 ends a strip.
    Strips,
    /// Lines between vertices.
    Edge,
    Other,
}

fn kind(element: &ElementDef) -> Kind {
    match element.name.as_str() {
        "vertex" => Kind::Vertex,
        "face" => Kind::Face,
        "tristrips" => Kind::Strips,
        "edge" => Kind::Edge,
        _ => Kind::Other,
    }
}

/// Which coordinate a vertex property is.
fn axis(name: &str) -> Option<usize> {
    match name {
        "x" => Some(0),
        "y" => Some(1),
        "z" => Some(2),
        _ => None,
    }
}

/// Whether a face property is the list of corners.
fn is_corners(name: &str) -> bool {
    matches!(name, "vertex_indices" | "vertex_index")
}

/// Checks elements and collects them.
struct Sink {
    raw: Raw,
    /// As the header says.
    vertices: u64,
}

impl Sink {
    /// Makes sure that the header describes a mesh, or points.
    fn new(header: &Header, with_faces: bool) -> Result<Self, MeshError> {
        let malformed = |what: &str| error::malformed(Place::header(), what);
        let vertices =
            header.elements.get("vertex").ok_or_else(|| malformed("there is no element 'vertex'"))?;
        for name in ["x", "y", "z"] {
            let scalar =
                vertices.properties.get(name).map(|p| matches!(p.data_type, PropertyType::Scalar(_)));
            if scalar != Some(true) {
                return Err(malformed(&format!("element 'vertex' has no coordinate '{name}'")));
            }
        }
        let (mut faces, mut edges) = (0, 0);
        for element in header.elements.values().filter(|e| e.count > 0) {
            let name = quoted_bytes(element.name.as_bytes());
            let mut lists = element.properties.values().filter(|p| is_corners(&p.name)).map(|p| &p.data_type);
            match (kind(element), lists.next(), lists.next()) {
                (
                    Kind::Face | Kind::Strips,
                    Some(
                        PropertyType::List(_, ScalarType::Float | ScalarType::Double)
                        | PropertyType::Scalar(_),
                    ),
                    _,
                ) => return Err(malformed(&format!("the corners of '{name}' are not a list of integers"))),
                (Kind::Face | Kind::Strips, Some(PropertyType::List(..)), None) => faces += element.count,
                (Kind::Face | Kind::Strips, ..) => {
                    let what = format!("element '{name}' needs one list 'vertex_indices' or 'vertex_index'");
                    return Err(malformed(&what));
                }
                (Kind::Edge, ..) => edges = element.count,
                (Kind::Other, Some(_), _) => {
                    let what = "lists vertices, but only 'face' and 'tristrips' are understood";
                    return Err(malformed(&format!("element '{name}' {what}")));
                }
                _ => {}
            }
        }
        if faces == 0 && with_faces {
            return Err(MeshError::NoFaces { at: Place::default() });
        }
        if u32::try_from(vertices.count).is_err() {
            return Err(malformed(&format!("{} vertices are more than 32 bits can number", vertices.count)));
        }
        check_triangles(header.elements.get("face").map_or(0, |faces| faces.count as u64))?;
        let mut raw = Raw { binary: header.encoding != Encoding::Ascii, ..Raw::default() };
        raw.repairs.ignored = edges.try_into().unwrap_or(u32::MAX);
        Ok(Self { raw, vertices: vertices.count as u64 })
    }

    fn vertex(&mut self, position: [f64; 3], at: impl Fn() -> Place) -> Result<(), MeshError> {
        if let Some(x) = position.iter().find(|x| !fits(**x)) {
            return Err(MeshError::NonFinite { at: at(), value: format!("{x:?}") });
        }
        self.raw.positions.push(position);
        Ok(())
    }

    fn corner(&self, index: i64, at: &impl Fn() -> Place) -> Result<u32, MeshError> {
        let there = u32::try_from(index).ok().filter(|&v| u64::from(v) < self.vertices);
        let vertices = self.vertices;
        there.ok_or_else(|| MeshError::IndexOutOfRange { at: at(), index, first: 0, vertices })
    }

    fn room_for(&self, triangles: usize) -> Result<(), MeshError> {
        check_triangles((self.raw.triangles.len() + triangles) as u64)
    }

    fn corners<I: Copy + Into<i64>>(
        &mut self,
        kind: Kind,
        corners: &[I],
        at: impl Fn() -> Place,
    ) -> Result<(), MeshError> {
        if kind == Kind::Face {
            return self.face(corners, at);
        }
        corners
            .split(|&index| index.into() == -1)
            .filter(|strip| !strip.is_empty())
            .try_for_each(|strip| self.strip(strip, &at))
    }

    fn strip<I: Copy + Into<i64>>(
        &mut self,
        corners: &[I],
        at: &impl Fn() -> Place,
    ) -> Result<(), MeshError> {
        if corners.len() < 3 {
            return Err(MeshError::TooFewCorners { at: at(), corners: corners.len() as u64 });
        }
        self.room_for(corners.len() - 2)?;
        let vertices: Vec<u32> =
            corners.iter().map(|&index| self.corner(index.into(), at)).collect::<Result<_, _>>()?;
        // Every other one is the other way round.
        let turned =
            |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
        self.raw.triangles.extend(vertices.windows(3).enumerate().map(turned));
        Ok(())
    }

    fn face<I: Copy + Into<i64>>(&mut self, corners: &[I], at: impl Fn() -> Place) -> Result<(), MeshError> {
        let vertex = |&index: &I| self.corner(index.into(), &at);
        let [first, second, others @ ..] = corners else {
            return Err(MeshError::TooFewCorners { at: at(), corners: corners.len() as u64 });
        };
        if others.is_empty() {
            return Err(MeshError::TooFewCorners { at: at(), corners: 2 });
        }
        self.room_for(others.len())?;
        let first = vertex(first)?;
        let mut previous = vertex(second)?;
        for corner in others {
            let corner = self.corner((*corner).into(), &at)?;
            self.raw.triangles.push([first, previous, corner]);
            previous = corner;
        }
        if others.len() > 1 {
            self.raw.repairs.polygons += 1;
            let (Spot::Line(at) | Spot::Element(_, at)) = at().spot else { return Ok(()) };
            let triangles = others.len() as u32;
            let first = self.raw.triangles.len() as u32 - triangles;
            self.raw.polygons.push(Polygon { first, triangles, at });
        }
        Ok(())
    }
}

/// The body of a text file: a line per element.
struct Text<'a> {
    rest: &'a [u8],
    /// Number of the next line.
    line: u64,
}

impl<'a> Text<'a> {
    fn read(mut self, header: &Header, sink: &mut Sink) -> Result<(), MeshError> {
        for element in header.elements.values().filter(|e| !e.properties.is_empty()) {
            let kind = kind(element);
            for index in 0..element.count {
                let mut words = self.next_line().ok_or_else(|| end_of_file(element, index))?;
                match kind {
                    Kind::Vertex => {
                        let position = words.vertex(element)?;
                        sink.vertex(position, || Place::line(words.line))?;
                    }
                    Kind::Face | Kind::Strips => {
                        let corners = words.face(element)?;
                        sink.corners(kind, &corners, || Place::line(words.line))?;
                    }
                    Kind::Edge | Kind::Other => words.pass(element)?,
                }
                if !words.rest.trim_ascii().is_empty() {
                    let what =
                        format!("'{}' follows the last property", quoted_bytes(words.rest.trim_ascii()));
                    return Err(malformed(Place::line(words.line), what));
                }
            }
        }
        match self.next_line() {
            Some(more) => {
                let what = "there is more here than the header promises";
                Err(malformed(Place::line(more.line), what))
            }
            None => Ok(()),
        }
    }

    /// The next line that is not blank.
    fn next_line(&mut self) -> Option<Words<'a>> {
        while !self.rest.is_empty() {
            let (line, rest) = split_line(self.rest);
            self.rest = rest;
            self.line += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                return Some(Words { rest: line, line: self.line - 1 });
            }
        }
        None
    }
}

/// One line of a text file.
struct Words<'a> {
    rest: &'a [u8],
    line: u64,
}

impl Words<'_> {
    fn vertex(&mut self, element: &ElementDef) -> Result<[f64; 3], MeshError> {
        let mut position = [0.0; 3];
        for property in element.properties.values() {
            match (&property.data_type, axis(&property.name)) {
                (PropertyType::Scalar(_), Some(axis)) => position[axis] = self.coordinate()?,
                (PropertyType::Scalar(_), None) => self.skip(1)?,
                (PropertyType::List(..), _) => self.skip_list()?,
            }
        }
        Ok(position)
    }

    fn face(&mut self, element: &ElementDef) -> Result<Vec<i64>, MeshError> {
        let mut corners = Vec::new();
        for property in element.properties.values() {
            match &property.data_type {
                PropertyType::List(..) if is_corners(&property.name) => {
                    let count: u64 = self.number("a number of corners")?;
                    // A corner takes two bytes at least, so what the line says cannot ask for too much.
                    corners.reserve_exact((count as usize).min(self.rest.len()));
                    for _ in 0..count {
                        corners.push(self.number("a vertex index")?);
                    }
                }
                PropertyType::List(..) => self.skip_list()?,
                PropertyType::Scalar(_) => self.skip(1)?,
            }
        }
        Ok(corners)
    }

    fn pass(&mut self, element: &ElementDef) -> Result<(), MeshError> {
        element.properties.values().try_for_each(|property| match property.data_type {
            PropertyType::Scalar(_) => self.skip(1),
            PropertyType::List(..) => self.skip_list(),
        })
    }

    fn word(&mut self) -> Result<&[u8], MeshError> {
        let start = self.rest.trim_ascii_start();
        let end = start.iter().position(u8::is_ascii_whitespace).unwrap_or(start.len());
        self.rest = &start[end..];
        if end == 0 {
            let what = "the line ends before all its properties";
            return Err(malformed(Place::line(self.line), what));
        }
        Ok(&start[..end])
    }

    fn coordinate(&mut self) -> Result<f64, MeshError> {
        self.read("a coordinate", decimal)
    }

    fn number<T: std::str::FromStr>(&mut self, wanted: &str) -> Result<T, MeshError> {
        self.read(wanted, |text| text.parse().ok())
    }

    fn read<T>(&mut self, wanted: &str, parse: impl Fn(&str) -> Option<T>) -> Result<T, MeshError> {
        let line = self.line;
        let word = self.word()?;
        std::str::from_utf8(word)
            .ok()
            .and_then(parse)
            .ok_or_else(|| malformed(Place::line(line), format!("'{}' is not {wanted}", quoted_bytes(word))))
    }

    fn skip(&mut self, count: u64) -> Result<(), MeshError> {
        (0..count).try_for_each(|_| self.word().map(|_| ()))
    }

    fn skip_list(&mut self) -> Result<(), MeshError> {
        let count = self.number("the length of a list")?;
        self.skip(count)
    }
}

/// The body of a binary file.
struct Binary<'a> {
    rest: &'a [u8],
    big_endian: bool,
}

impl Binary<'_> {
    fn read(mut self, header: &Header, sink: &mut Sink) -> Result<(), MeshError> {
        for element in header.elements.values().filter(|e| !e.properties.is_empty()) {
            let kind = kind(element);
            for index in 0..element.count {
                let at = || Place::element(&element.name, index as u64);
                let record = self.element(element, index)?;
                match kind {
                    Kind::Vertex => sink.vertex(record.position, at)?,
                    Kind::Face | Kind::Strips if record.unsigned.is_empty() => {
                        sink.corners(kind, &record.signed, at)?;
                    }
                    Kind::Face | Kind::Strips => sink.corners(kind, &record.unsigned, at)?,
                    Kind::Edge | Kind::Other => {}
                }
            }
        }
        // Some programs end a file with a line break, or fill a block with zeros.
        if self.rest.iter().any(|b| !b.is_ascii_whitespace() && *b != 0) {
            let what = format!("{} bytes more than the header promises", self.rest.len());
            return Err(malformed(Place::default(), what));
        }
        Ok(())
    }

    fn element(&mut self, element: &ElementDef, index: usize) -> Result<Record, MeshError> {
        let parser = Parser::<Record>::new();
        let read = if self.big_endian {
            parser.read_big_endian_element(&mut self.rest, element)
        } else {
            parser.read_little_endian_element(&mut self.rest, element)
        };
        read.map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof => end_of_file(element, index),
            _ => malformed(
                Place::element(&element.name, index as u64),
                quoted_bytes(e.to_string().lines().next().unwrap_or_default().as_bytes()),
            ),
        })
    }
}

fn end_of_file(element: &ElementDef, index: usize) -> MeshError {
    let what = format!("the file ends here, but its header promises {} of '{}'", element.count, element.name);
    truncated(Place::element(&element.name, index as u64), what)
}

/// An element of a binary file. All are of one type, which is compiled once; the header is checked.
#[derive(Default)]
struct Record {
    /// A vertex's coordinates.
    position: [f64; 3],
    /// A face's corners are in one of the two.
    signed: Vec<i32>,
    unsigned: Vec<u32>,
}

impl Record {
    fn coordinate(&mut self, name: &str, x: f64) -> PropertyAccessResult {
        let Some(axis) = axis(name) else { return PropertyAccessResult::Ignored };
        self.position[axis] = x;
        PropertyAccessResult::Set
    }

    fn corners<I: Into<i32>>(&mut self, name: &str, list: Vec<I>) -> PropertyAccessResult {
        if !is_corners(name) {
            return PropertyAccessResult::Ignored;
        }
        self.signed = list.into_iter().map(Into::into).collect();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Record {
    fn new() -> Self {
        Self::default()
    }

    fn begin_list_int(&mut self, name: &str, _: usize) -> BeginList<'_, i32> {
        if is_corners(name) { BeginList::Fill(&mut self.signed) } else { BeginList::UseSetter }
    }

    fn begin_list_uint(&mut self, name: &str, _: usize) -> BeginList<'_, u32> {
        if is_corners(name) { BeginList::Fill(&mut self.unsigned) } else { BeginList::UseSetter }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        match value {
            Property::Char(x) => self.coordinate(name, x.into()),
            Property::UChar(x) => self.coordinate(name, x.into()),
            Property::Short(x) => self.coordinate(name, x.into()),
            Property::UShort(x) => self.coordinate(name, x.into()),
            Property::Int(x) => self.coordinate(name, x.into()),
            Property::UInt(x) => self.coordinate(name, x.into()),
            Property::Float(x) => self.coordinate(name, x.into()),
            Property::Double(x) => self.coordinate(name, x),
            Property::ListChar(list) => self.corners(name, list),
            Property::ListUChar(list) => self.corners(name, list),
            Property::ListShort(list) => self.corners(name, list),
            Property::ListUShort(list) => self.corners(name, list),
            _ => PropertyAccessResult::Ignored,
        }
    }
}
