//! OBJ and PLY: what is read, what is refused, and with which words.

use crate::{A, B, C, D, corners, gzip, read, refusal};
use proptest::prelude::*;
use raykd::mesh::Mesh;
use std::{path::Path, sync::LazyLock};

const QUAD_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 .5\nv 0 1. 2.5e-1\nf 1 2 3 4\n";

const QUAD_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n1 1 .5\n0 1. 2.5e-1\n4 0 1 2 3\n";

/// The types of PLY that a binary file under test uses.
#[derive(Clone, Copy, Debug)]
struct Types {
    big_endian: bool,
    coordinate: &'static str,
    count: &'static str,
    index: &'static str,
    list: &'static str,
}

fn number(out: &mut Vec<u8>, kind: &str, big_endian: bool, x: f64) {
    let (big, little) = match kind {
        "char" | "int8" => (vec![x as i8 as u8], vec![x as i8 as u8]),
        "uchar" | "uint8" => (vec![x as u8], vec![x as u8]),
        "short" => ((x as i16).to_be_bytes().to_vec(), (x as i16).to_le_bytes().to_vec()),
        "ushort" => ((x as u16).to_be_bytes().to_vec(), (x as u16).to_le_bytes().to_vec()),
        "int" => ((x as i32).to_be_bytes().to_vec(), (x as i32).to_le_bytes().to_vec()),
        "uint" => ((x as u32).to_be_bytes().to_vec(), (x as u32).to_le_bytes().to_vec()),
        "float" => ((x as f32).to_be_bytes().to_vec(), (x as f32).to_le_bytes().to_vec()),
        "double" => (x.to_be_bytes().to_vec(), x.to_le_bytes().to_vec()),
        other => panic!("no type {other}"),
    };
    out.extend(if big_endian { big } else { little });
}

/// A binary PLY with things that are to be skipped before, between and after what counts.
fn binary_ply(types: Types, vertices: &[[f64; 3]], faces: &[&[i64]]) -> Vec<u8> {
    let Types { big_endian, coordinate, count, index, list } = types;
    let order = if big_endian { "big" } else { "little" };
    let mut out = format!(
        "ply\nformat binary_{order}_endian 1.0\ncomment a test\nobj_info of nothing\n\
         element camera 1\nproperty list uchar float view\nproperty double zoom\n\
         element vertex {}\nproperty {coordinate} x\nproperty uchar red\nproperty {coordinate} y\n\
         property {coordinate} z\nproperty list uchar short bones\n\
         element face {}\nproperty uchar flags\nproperty list {count} {index} {list}\n\
         property list uchar float texcoord\nelement note 1\nproperty int text\nend_header\n",
        vertices.len(),
        faces.len()
    )
    .into_bytes();
    let mut put = |kind: &str, x: f64| number(&mut out, kind, big_endian, x);
    for (kind, x) in [("uchar", 2.0), ("float", 1.0), ("float", 2.0), ("double", 3.0)] {
        put(kind, x);
    }
    for v in vertices {
        for (kind, x) in [(coordinate, v[0]), ("uchar", 200.0), (coordinate, v[1]), (coordinate, v[2])] {
            put(kind, x);
        }
        put("uchar", 1.0);
        put("short", -3.0);
    }
    for face in faces {
        put("uchar", 9.0);
        put(count, face.len() as f64);
        for &corner in *face {
            put(index, corner as f64);
        }
        put("uchar", 1.0);
        put("float", 0.5);
    }
    put("int", 7.0);
    out
}

const PLAIN: Types =
    Types { big_endian: false, coordinate: "float", count: "uchar", index: "int", list: "vertex_indices" };

fn quad_binary(types: Types) -> Vec<u8> {
    let vertices = [A, B, C, D];
    binary_ply(types, &vertices, &[&[0, 1, 2, 3]])
}

fn is_the_quad(mesh: &Mesh) {
    crate::is_the_quad(mesh);
    assert_eq!(mesh.repairs().polygons, 1);
    assert_eq!(mesh.bounds(), ([0.0; 3], [1.0, 1.0, 0.5]));
}

#[test]
fn every_format_gives_the_same_mesh() {
    is_the_quad(&read("a.obj", QUAD_OBJ).unwrap());
    is_the_quad(&read("a.OBJ", QUAD_OBJ.replace('\n', "\r\n")).unwrap());
    is_the_quad(&read("a.ply", QUAD_PLY).unwrap());
    is_the_quad(&read("a.ply", QUAD_PLY.replace('\n', "\r\n")).unwrap());
    is_the_quad(&read("a.obj.gz", gzip(QUAD_OBJ.as_bytes())).unwrap());
    is_the_quad(&read("a.ply.gz", gzip(QUAD_PLY.as_bytes())).unwrap());
    // Several gzip members in a row are one file.
    let (head, tail) = QUAD_PLY.as_bytes().split_at(99);
    is_the_quad(&read("a.ply.gz", [gzip(head), gzip(tail)].concat()).unwrap());
    // What follows the last may be zeros.
    is_the_quad(&read("a.ply.gz", [gzip(head), gzip(tail), vec![0; 600]].concat()).unwrap());
    // Without a telling name.
    is_the_quad(&read("mesh", QUAD_OBJ).unwrap());
    is_the_quad(&read("mesh.txt", format!("# a comment\n\n{QUAD_OBJ}")).unwrap());
    is_the_quad(&read("mesh", QUAD_PLY).unwrap());
    is_the_quad(&read("mesh.dat", gzip(QUAD_PLY.as_bytes())).unwrap());
    is_the_quad(&read("mesh.gz", gzip(QUAD_OBJ.as_bytes())).unwrap());
    is_the_quad(&read("hidden.obj", gzip(QUAD_OBJ.as_bytes())).unwrap());
    // Without a last line end.
    is_the_quad(&read("a.obj", QUAD_OBJ.trim_end()).unwrap());
    is_the_quad(&read("a.ply", QUAD_PLY.trim_end()).unwrap());
}

#[test]
fn binary_ply_of_all_types() {
    for big_endian in [false, true] {
        for coordinate in ["float", "double"] {
            for count in ["char", "uchar", "short", "ushort", "int", "uint"] {
                for index in ["char", "uchar", "short", "ushort", "int", "uint"] {
                    for list in ["vertex_index", "vertex_indices"] {
                        let types = Types { big_endian, coordinate, count, index, list };
                        is_the_quad(&read("a.ply", quad_binary(types)).unwrap());
                    }
                }
            }
        }
    }
}

#[test]
fn ply_coordinates_may_be_whole_numbers() {
    let vertices = [A, B, [1.0, 1.0, 7.0]];
    for coordinate in ["char", "uchar", "short", "ushort", "int", "uint"] {
        for big_endian in [false, true] {
            let types = Types { big_endian, coordinate, ..PLAIN };
            let mesh = read("a.ply", binary_ply(types, &vertices, &[&[0, 1, 2]])).unwrap();
            assert_eq!(corners(&mesh), [vertices], "{coordinate}");
        }
        let text = QUAD_PLY.replace("float", coordinate).replace("1. 2.5e-1", "1 2").replace(".5", "5");
        assert_eq!(read("a.ply", text).unwrap().vertex(3), [0.0, 1.0, 2.0], "{coordinate}");
    }
}

#[test]
fn text_ply_skips_what_it_need_not_know() {
    let text = "ply\nformat ascii 1.0\nelement camera 2\nproperty list uchar float view\nelement nothing 5\n\
        element face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\n\
        property list uchar float texcoord\nelement vertex 4\nproperty list uchar int bones\n\
        property double z\nproperty double x\nproperty float nx\nproperty double y\nend_header\n\
        1 5\n0\n\n9 3 0 1 2 2 .5 .5\n9 3 0 2 3 0\n2 7 7 0 0 nan 0\n0 0 1 0 0\n0 0.5 1 0 1\n  0 0.25 0 0 1  \n\n";
    let mesh = read("a.ply", text).unwrap();
    assert_eq!(corners(&mesh), [[A, B, C], [A, C, D]]);
}

#[test]
fn obj_keeps_the_order_of_faces() {
    // Objects, groups and materials, forward and negative indices, joined lines, textures and normals that
    // lead nowhere, colours and weights, points and lines, words nobody knows, bytes that are no text.
    let mut text = b"mtllib missing.mtl\n# gr\xfc\xdfe \\\n".to_vec();
    text.extend_from_slice(
        b"o one\nf 1/9/9 2//7 3/5\nv 0 0 0 0.5\nv 1 0 0 255 0 0\nv 1 1 0.5\nusemtl red\nv 0 1 \\\n 0.25\nl 1 2 3 4\n\
          p 1 2\nf -4 -2 -1 # the second half\ng two\nusemtl blue\nvt 0\nvn 0 0\nf 3 2 1\ncurv 0 1\nusemtl red\n\
          f -1 \\\n-2 -3\nv 9 9 9\n",
    );
    let mesh = read("a.obj", text).unwrap();
    assert_eq!(corners(&mesh), [[A, B, C], [A, C, D], [C, B, A], [D, C, B]]);
    assert_eq!(mesh.repairs().ignored, 3);
    assert_eq!(mesh.repairs().polygons, 0);
}

#[test]
fn polygons_become_fans() {
    let ring = "v 1 0 0\nv 0.5 0.9 0\nv -0.5 0.9 0\nv -1 0 0\nv -0.5 -0.9 0\nv 0.5 -0.9 0\n";
    let obj = read("a.obj", format!("{ring}f 1 2 3 4 5 6\nf 3 2 1\n")).unwrap();
    let p: [[f32; 3]; 6] =
        [[1., 0., 0.], [0.5, 0.9, 0.], [-0.5, 0.9, 0.], [-1., 0., 0.], [-0.5, -0.9, 0.], [0.5, -0.9, 0.]];
    let p = p.map(|p| p.map(f64::from));
    let fan =
        [[p[0], p[1], p[2]], [p[0], p[2], p[3]], [p[0], p[3], p[4]], [p[0], p[4], p[5]], [p[2], p[1], p[0]]];
    assert_eq!(corners(&obj), fan);
    assert_eq!(obj.repairs().polygons, 1);
    let ply = read("a.ply", binary_ply(PLAIN, &p, &[&[0, 1, 2, 3, 4, 5], &[2, 1, 0]])).unwrap();
    assert_eq!(corners(&ply), fan);
    assert_eq!(ply.repairs().polygons, 1);
    // 0.9 is no f32, and was one when it was written to the binary file.
    assert_eq!((ply.repairs().rounded, obj.repairs().rounded), (0, 4));
}

/// Ends of lines, blanks and comments that differ from program to program: the same mesh, not a vertex less.
#[test]
fn obj_loses_no_line() {
    let digits = format!("v 1.{} 0E-3 -.0\n", "0".repeat(5000));
    for (from, to) in [
        // A mark of UTF-8 before the first vertex.
        ("v 0 0 0\nv 1", "\u{feff}v 0 0 0\nv 1"),
        // A comment's backslash joins nothing.
        ("v 1 0 0\n", "# a comment \\\nv 1 0 0 # another \\\n"),
        ("v 1 0 0\n", "# c:\\\r\nv 1 0 0\r\n"),
        ("v 1 0 0\nv 1 1 .5\n", "v 1 0 0\rv 1 1 .5\n"),
        ("v 1 0 0\nv 1 1 .5\n", "v 1 0 0#\rv 1 1 .5\r\r\n"),
        ("v 1 0 0\n", "v\x0b1 0\x0b0\x0c\n"),
        ("v 1 0 0\n", "\tv\t1 \\\r\n0 \\\n0\n"),
        ("f 1 2 3 4\n", "fo 1 2 3 4#5\n"),
        ("f 1 2 3 4\n", "f 1 2 \\\r 3 4"),
        // Weights, colours, both.
        ("v 1 0 0\n", "v 1 0 0 1\n"),
        ("v 1 0 0\n", "v 1 0 0 .5 .5 1 1 1\n"),
        // What is no number where none counts, and numbers as people write them.
        ("v 1 0 0\n", "vn nan inf x\nvt\n# \0\0\nv +1e0 0 0\n"),
        ("v 1 0 0\n", &digits),
    ] {
        assert!(QUAD_OBJ.contains(from));
        let text = QUAD_OBJ.replacen(from, to, 1);
        is_the_quad(&read("a.obj", &text).unwrap_or_else(|e| panic!("{text:?}: {e}")));
        is_the_quad(&read("unnamed", &text).unwrap_or_else(|e| panic!("{text:?}: {e}")));
    }
    // All statements of the format that make no surface.
    let others = "vt 0\nvn 0\nvp 0\ng\ns off\nmg 1\no a\\ \nbevel on\nc_interp on\nd_interp on\nlod 1\nusemtl a#b\n\
        mtllib m\nusemap off\nmaplib m\nshadow_obj s\ntrace_obj t\nctech t\nstech t\ncstype bezier\ndeg 3\n\
        bmat u 1\nstep 1\ncurv2 1 2\nparm u 0 1\ntrim 0 1 1\nhole 0 1 1\nscrv 0 1 1\nsp 1\nend\n\
        con 1 0 1 1 2 0 1 1\nres 1\ncsh ls\n\n\t\n";
    let mesh = read("a.obj", format!("{others}{QUAD_OBJ}")).unwrap();
    is_the_quad(&mesh);
    assert_eq!(mesh.repairs().ignored, 0);
    let lines = read("a.obj", format!("{QUAD_OBJ}l 1 2\np 1\ncurv 0 1 1 2\ncdc 1 2\n")).unwrap();
    assert_eq!(lines.repairs().ignored, 4);
}

/// What is not understood and could be geometry is refused, by its line.
#[test]
fn obj_passes_over_nothing() {
    let long = "x".repeat(5000);
    for (line, message) in [
        ("v\u{a0}0 0 0", r"line 6: 'v\u{a0}0' is no statement of OBJ (a # before it makes it a comment)"),
        ("V 0 0 0", "line 6: 'V' is no statement of OBJ"),
        ("F 1 2 3", "line 6: 'F' is no statement of OBJ"),
        ("\u{feff}v 0 0 0", r"line 6: '\u{feff}v' is no statement of OBJ"),
        ("\0v 0 0 0", r"line 6: '\0v' is no statement"),
        ("f1 2 3", "line 6: 'f1' is no statement"),
        ("v 0 0 0 v 1 1 1", "line 6: 'v' is not a weight or a colour"),
        ("v 0 0 0 1 2 3 4 5 6", "line 6: '6' is not a weight or a colour"),
        ("v 0 0\u{a0}0", r"line 6: '0\u{a0}0' is not a coordinate"),
        (
            "o name\\\nv 0 0 0",
            "line 7: the backslash at the end of the line before makes this a part of that one",
        ),
        ("v 0 0 0 \\\nv 0 0 0", "line 7: the backslash"),
        ("vn 0 0 1\\\r\nf 1 2 3", "line 7: the backslash"),
        ("surf 0 1 0 1 1 2 3 4", "line 6: 'surf' is a curved surface"),
        ("bzp 1 2 3", "line 6: 'bzp' is a curved surface"),
        ("call more.obj", "line 6: 'call' takes in another file"),
        (&long, &format!("line 6: '{}…' is no statement", "x".repeat(200))),
        (&format!("v 0 0 {long}"), &format!("line 6: '{}…' is not a coordinate; ", "x".repeat(200))),
        (
            &format!("v 0 0 1{}e9", "0".repeat(999)),
            &format!("line 6: coordinate '1{}…' is not", "0".repeat(199)),
        ),
        (&format!("f 1 2 {long}"), &format!("line 6: '{}…' is not a vertex index;", "x".repeat(200))),
    ] {
        let refusal = refusal("bad.obj", format!("{QUAD_OBJ}{line}\n"));
        assert!(
            refusal.starts_with(&format!("bad.obj, {message}")),
            "{line:?}\ngives {refusal:?}\nwanted {message:?}"
        );
        assert!(refusal.chars().count() < 400, "{refusal}");
    }
    let utf16: Vec<u8> = [0xff, 0xfe].into_iter().chain(QUAD_OBJ.bytes().flat_map(|b| [b, 0])).collect();
    assert!(refusal("bad.obj", utf16).starts_with("bad.obj, line 1: the text is UTF-16; save it as UTF-8;"));
}

/// A strip is what its triangles are.
#[test]
fn ply_reads_strips() {
    let strips = |body: &str| {
        QUAD_PLY
            .replace("element face", "element tristrips")
            .replace("uchar int vertex_indices", "int int vertex_indices")
            .replace("4 0 1 2 3\n", body)
    };
    for body in ["4 0 1 2 3\n", "6 -1 0 1 2 3 -1\n"] {
        let mesh = read("a.ply", strips(body)).unwrap();
        assert_eq!(corners(&mesh), [[A, B, C], [C, B, D]]);
        assert_eq!(mesh.repairs().polygons, 0);
    }
    let mesh = read("a.ply", strips("9 0 1 2 3 0 -1 2 1 0\n")).unwrap();
    assert_eq!(corners(&mesh), [[A, B, C], [C, B, D], [C, D, A], [C, B, A]]);
    let vertices = [A, B, C, D];
    for big_endian in [false, true] {
        let types = Types { count: "int", big_endian, ..PLAIN };
        let both = binary_ply(types, &vertices, &[&[0, 1, 2, 3, -1, 0, 2, 3]]);
        let at = both.windows(12).position(|w| w == b"element face").unwrap();
        let strips = [&both[..at], b"element tristrips", &both[at + 12..]].concat();
        assert_eq!(corners(&read("a.ply", strips).unwrap()), [[A, B, C], [C, B, D], [A, C, D]]);
    }
    for (body, message) in [
        ("2 0 1\n", "bad.ply, line 14: a face needs at least 3 corners, this one has 2"),
        ("5 0 1 2 -1 3\n", "bad.ply, line 14: a face needs at least 3 corners, this one has 1"),
        ("3 0 1 -2\n", "bad.ply, line 14: vertex index -2 is out of range"),
        ("3 0 1 4\n", "bad.ply, line 14: vertex index 4 is out of range"),
    ] {
        let refusal = refusal("bad.ply", strips(body));
        assert!(refusal.starts_with(message), "{refusal}");
    }
}

/// Comments in any encoding, and lines that end as on old machines, say nothing of the mesh.
#[test]
fn ply_headers_of_other_programs() {
    let comments = b"comment gr\xfc\xdfe\nobj_info \xff\xfe end_header\n".to_vec();
    for whole in [QUAD_PLY.as_bytes().to_vec(), quad_binary(PLAIN)] {
        let at = whole.windows(15).position(|w| w == b"\nelement vertex").unwrap() + 1;
        let commented = [&whole[..at], &comments, &whole[at..]].concat();
        is_the_quad(&read("a.ply", &commented).unwrap());
        let body = commented.windows(12).position(|w| w == b"\nend_header\n").unwrap() + 12;
        let header = commented[..body].iter().map(|&b| if b == b'\n' { b'\r' } else { b });
        let returns: Vec<u8> = header.chain(commented[body..].iter().copied()).collect();
        is_the_quad(&read("a.ply", &returns).unwrap());
        is_the_quad(&read("unnamed", &returns).unwrap());
    }
    is_the_quad(&read("a.ply", QUAD_PLY.replace('\n', "\r")).unwrap());
    // In a comment, no other end of a line ends it.
    let odd = "comment a\rproperty float w\r\r\nobj_info \r b\nelement face";
    is_the_quad(&read("a.ply", QUAD_PLY.replace("element face", odd)).unwrap());
    let odd =
        QUAD_PLY.replace('\n', "\r").replace("element face", "comment a\nproperty float w\n\relement face");
    is_the_quad(&read("a.ply", odd).unwrap());
    // The first byte of the body is none of the header's, whatever it is.
    let header = "ply\rformat binary_little_endian 1.0\relement vertex 3\rproperty uchar x\rproperty uchar y\r\
        property uchar z\relement face 1\rproperty list uchar uchar vertex_index\rend_header\r";
    let body = b"\n\0\0\0\x01\0\0\0\x01\x03\0\x01\x02";
    let mesh = read("a.ply", [header.as_bytes(), body].concat()).unwrap();
    assert_eq!(corners(&mesh), [[[10.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]);
    // What is no comment is refused, by its line.
    let named = QUAD_PLY.replace("element face", "element gr\u{fc}\u{df}e 0\nelement face");
    assert!(refusal("a.ply", named).starts_with("a.ply, line 7: Couldn't parse line"));
}

/// What a header or a body says twice, or more than the header promises, is refused, by its line.
#[test]
fn ply_passes_over_nothing() {
    let long = "x".repeat(5000);
    for (from, to, message) in [
        (
            "end_header",
            "element face 1\nproperty list uchar int vertex_index\nend_header",
            "line 9: the name 'face' is taken by an earlier element or property",
        ),
        ("property float z", "property float z\nproperty double x", "line 7: the name 'x' is taken"),
        ("property float z", "property float z\nproperty\tint  x ", "line 7: the name 'x' is taken"),
        ("0 0 0\n", "0 0 0 0\n", "line 10: '0' follows the last property"),
        ("4 0 1 2 3", "3 0 1 2 3", "line 14: '3' follows the last property"),
        ("4 0 1 2 3\n", "4 0 1 2 3\n3 0 1 2\n", "line 15: there is more here than the header promises"),
        ("4 0 1 2 3\n", &format!("4 0 1 2 3 {long}\n"), &format!("line 14: '{}…' follows", "x".repeat(200))),
        ("1 1 .5", &format!("1 1 {long}"), &format!("line 12: '{}…' is not a coordinate", "x".repeat(200))),
        ("element face", "element edge 1\nproperty int vertex1\nelement face", "line 16: '0 1 2 3' follows"),
        (
            "element face",
            "element range_grid",
            "header: element 'range_grid' lists vertices, but only 'face' and",
        ),
        (
            "element face",
            "element tristrips 1\nproperty int a\nelement face",
            "header: element 'tristrips' needs one list",
        ),
        (
            "element face",
            &format!("element {long}"),
            &format!("header: element '{}…' lists vertices", "x".repeat(200)),
        ),
        ("format ascii", &format!("comment\n{long}\nformat ascii"), "line 3: Couldn't parse line"),
    ] {
        assert!(QUAD_PLY.contains(from), "{from}");
        let refusal = refusal("bad.ply", QUAD_PLY.replacen(from, to, 1));
        assert!(
            refusal.starts_with(&format!("bad.ply, {message}")),
            "{to:?}\ngives {refusal:?}\nwanted {message:?}"
        );
        assert!(refusal.chars().count() < 500, "{refusal}");
    }
    let whole = quad_binary(PLAIN);
    assert!(
        refusal("b.ply", [&whole[..], b"\x03\0"].concat())
            .starts_with("b.ply: 2 bytes more than the header promises")
    );
    is_the_quad(&read("b.ply", [&whole[..], b"\r\n\0\0"].concat()).unwrap());
    // Lines that end with CR, a mark of UTF-8, numbers as people write them, lines between vertices.
    let (header, body) = QUAD_PLY.split_at(QUAD_PLY.find("0 0 0").unwrap());
    is_the_quad(&read("a.ply", format!("{header}{}", body.replace('\n', "\r"))).unwrap());
    is_the_quad(&read("a.ply", format!("\u{feff}{QUAD_PLY}")).unwrap());
    is_the_quad(&read("a", format!("\u{feff}{QUAD_PLY}")).unwrap());
    is_the_quad(&read("a.ply", QUAD_PLY.replace("1 0 0\n", "+1. -.0 .0e5\n")).unwrap());
    let edges = QUAD_PLY
        .replace("element face", "element edge 2\nproperty int vertex1\nproperty int vertex2\nelement face");
    let mesh = read("a.ply", edges.replace("4 0 1 2 3", "0 1\n1 2\n4 0 1 2 3")).unwrap();
    is_the_quad(&mesh);
    assert_eq!(mesh.repairs().ignored, 2);
}

#[test]
fn ply_headers_of_many_names_take_no_quadratic_time() {
    let names = |line: &str| (0..200_000).map(|i| format!("{line}{i}\n")).collect::<String>();
    let properties = format!("element other 0\n{}element face", names("property int a"));
    let start = std::time::Instant::now();
    is_the_quad(&read("a.ply", QUAD_PLY.replace("element face", &properties)).unwrap());
    assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
}

#[test]
fn obj_errors_name_the_line() {
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (text, message) in [
        (
            format!("{v}v 0 nan 0\nf 1 2 3\n"),
            "bad.obj, line 4: coordinate 'nan' is not a finite 32-bit float",
        ),
        (
            format!("{v}v 0 0 -1e39\nf 1 2 3\n"),
            "bad.obj, line 4: coordinate '-1e39' is not a finite 32-bit float",
        ),
        (format!("{v}f 1 2 3\nv inf 0 0\n"), "bad.obj, line 5: coordinate 'inf' is not"),
        (format!("{v}v 0 zero 0\nf 1 2 3\n"), "bad.obj, line 4: 'zero' is not a coordinate"),
        (format!("{v}v 0 1e400 0\n"), "bad.obj, line 4: coordinate '1e400' is not a finite 32-bit float"),
        (format!("{v}v 0 0,5 0\n"), "bad.obj, line 4: '0,5' is not a coordinate"),
        (format!("{v}v 0 0x1p3 0\n"), "bad.obj, line 4: '0x1p3' is not a coordinate"),
        (format!("{v}v 0 1d3 0\n"), "bad.obj, line 4: '1d3' is not a coordinate"),
        (format!("{v}v 4,0,0\n"), "bad.obj, line 4: '4,0,0' is not a coordinate"),
        (format!("{v}f 1 2 3.0\n"), "bad.obj, line 4: '3.0' is not a vertex index"),
        // 3, -1 and 0 of 32 bits.
        (format!("{v}f 1 2 4294967299\n"), "bad.obj, line 4: vertex index 4294967299 is out of range"),
        (format!("{v}f 1 2 4294967295\n"), "bad.obj, line 4: vertex index 4294967295 is out of range"),
        (format!("{v}f 1 2 -9223372036854775808\n"), "bad.obj, line 4: vertex index -9223372036854775808 is"),
        (format!("{v}f 1 2 9223372036854775808\n"), "bad.obj, line 4: '9223372036854775808' is not a vertex"),
        (format!("{v}v 0 0\nf 1 2 3\n"), "bad.obj, line 4: a vertex needs three coordinates"),
        (
            format!("{v}f 1 2 3\nf 1 2 0\n"),
            "bad.obj, line 5: vertex index 0 is out of range, the vertices are 1 to 3",
        ),
        (format!("{v}f 1 2 4\n"), "bad.obj, line 4: vertex index 4 is out of range, the vertices are 1 to 3"),
        (format!("{v}f 1 2 -4\n"), "bad.obj, line 4: vertex index -4 is out of range"),
        ("f 1 2 3".to_owned(), "bad.obj, line 1: vertex index 3 is out of range, there are no vertices"),
        (format!("{v}f 1 2 x\n"), "bad.obj, line 4: 'x' is not a vertex index"),
        (format!("{v}f 1 2 /3\n"), "bad.obj, line 4: '/3' is not a vertex index"),
        (
            format!("{v}f 1 2 99999999999999999999\n"),
            "bad.obj, line 4: '99999999999999999999' is not a vertex index",
        ),
        (
            format!("{v}f 1 2 3\n\nf 1 2\n"),
            "bad.obj, line 6: a face needs at least 3 corners, this one has 2",
        ),
        (format!("{v}f\n"), "bad.obj, line 4: a face needs at least 3 corners, this one has 0"),
        (v.to_owned(), "bad.obj: there are no faces"),
        (String::new(), "bad.obj: there is nothing in it"),
    ] {
        let refusal = refusal("bad.obj", &text);
        assert!(refusal.starts_with(message), "{text:?}\ngives {refusal:?}\nwanted {message:?}");
    }
}

#[test]
fn text_ply_errors_name_the_line() {
    for (from, to, message) in [
        ("ply\n", "pyl\n", "bad.ply, line 1: Expected magic number"),
        ("format ascii 1.0\n", "", "bad.ply, header: No format line found"),
        ("format ascii", "format utf8", "bad.ply, line 2: Couldn't parse line"),
        ("property float z\n", "", "bad.ply, header: element 'vertex' has no coordinate 'z'"),
        (
            "property float z\n",
            "property list int int z\n",
            "bad.ply, header: element 'vertex' has no coordinate 'z'",
        ),
        ("list uchar int", "list uchar quad", "bad.ply, line 8: Couldn't parse line"),
        ("element vertex", "element point", "bad.ply, header: there is no element 'vertex'"),
        ("element vertex 4", "element vertex -4", "bad.ply, line 3: Couldn't parse line"),
        ("element vertex 4", "element vertex 3", "bad.ply, line 13: "),
        ("element face 1\nproperty list uchar int vertex_indices\n", "", "bad.ply: there are no faces"),
        ("element vertex 4", "element vertex 4294967296", "bad.ply, header: 4294967296 vertices are more"),
        (
            "element face",
            "element tetrahedra",
            "bad.ply, header: element 'tetrahedra' lists vertices, but only",
        ),
        ("element face 1", "element face 0", "bad.ply: there are no faces"),
        ("element face 1", "element face 999999999", "bad.ply: more than 268435455 triangles"),
        ("vertex_indices", "corners", "bad.ply, header: element 'face' needs one list 'vertex_indices'"),
        (
            "list uchar int",
            "list uchar float",
            "bad.ply, header: the corners of 'face' are not a list of integers",
        ),
        ("end_header\n", "", "bad.ply, line 9: Couldn't parse line"),
        ("1 1 .5", "1 NaN .5", "bad.ply, line 12: coordinate 'NaN' is not a finite 32-bit float"),
        ("1 1 .5", "1 1e40 .5", "bad.ply, line 12: coordinate '1e40' is not a finite 32-bit float"),
        ("1 1 .5", "1 1", "bad.ply, line 12: the line ends before all its properties"),
        ("1 1 .5", "1 one .5", "bad.ply, line 12: 'one' is not a coordinate"),
        (
            "4 0 1 2 3",
            "4 0 1 2 4",
            "bad.ply, line 14: vertex index 4 is out of range, the vertices are 0 to 3",
        ),
        ("4 0 1 2 3", "4 0 1 -2 3", "bad.ply, line 14: vertex index -2 is out of range"),
        ("4 0 1 2 3", "4 0 1 2", "bad.ply, line 14: the line ends before all its properties"),
        ("4 0 1 2 3", "-3 0 1 2", "bad.ply, line 14: "),
        ("4 0 1 2 3", "2 0 1", "bad.ply, line 14: a face needs at least 3 corners, this one has 2"),
        ("4 0 1 2 3", "0", "bad.ply, line 14: a face needs at least 3 corners, this one has 0"),
        (
            "4 0 1 2 3",
            "4000000000000000000 0 1 2",
            "bad.ply, line 14: the line ends before all its properties",
        ),
        ("4 0 1 2 3", "4 0 1 2.0 3", "bad.ply, line 14: '2.0' is not a vertex index"),
        ("4 0 1 2 3\n", "", "bad.ply, face 0: the file ends here, but its header promises 1 of 'face'"),
        ("element vertex 4", "element vertex 4000000000", "bad.ply, line 14: the line ends before"),
        (
            "element face 1",
            "element face 200000000",
            "bad.ply, face 1: the file ends here, but its header promises 200000000",
        ),
    ] {
        assert!(QUAD_PLY.contains(from), "{from}");
        // `4 0 1 2 3` read as a vertex is a fine vertex; a shorter line shows the lie.
        let text = QUAD_PLY.replacen(from, to, 1);
        let text = if to.ends_with("4000000000") { text.replace("4 0 1 2 3", "4 0") } else { text };
        let refusal = refusal("bad.ply", &text);
        assert!(refusal.starts_with(message), "{from:?} -> {to:?}\ngives {refusal:?}\nwanted {message:?}");
    }
}

#[test]
fn binary_ply_errors_name_the_element() {
    let vertices = [A, B, C, D];
    let with = |x: f64| {
        let mut vertices = vertices;
        vertices[2][1] = x;
        binary_ply(Types { coordinate: "double", ..PLAIN }, &vertices, &[&[0, 1, 2]])
    };
    assert!(
        refusal("b.ply", with(f64::NAN)).starts_with("b.ply, vertex 2: coordinate 'NaN' is not a finite")
    );
    assert!(refusal("b.ply", with(1e39)).starts_with("b.ply, vertex 2: coordinate '1e39' is not a finite"));
    let faces = |faces: &[&[i64]]| binary_ply(PLAIN, &vertices, faces);
    assert!(
        refusal("b.ply", faces(&[&[0, 1, 2], &[0, 1, 4]]))
            .starts_with("b.ply, face 1: vertex index 4 is out of range, the vertices are 0 to 3")
    );
    assert!(
        refusal("b.ply", faces(&[&[0, 1, -2]])).starts_with("b.ply, face 0: vertex index -2 is out of range")
    );
    assert!(
        refusal("b.ply", faces(&[&[0, 1]])).starts_with("b.ply, face 0: a face needs at least 3 corners")
    );
    assert!(refusal("b.ply", faces(&[&[]])).starts_with("b.ply, face 0: a face needs at least 3 corners"));
    let whole = faces(&[&[0, 1, 2]]);
    assert!(
        refusal("b.ply", &whole[..whole.len() - 8])
            .starts_with("b.ply, face 0: the file ends here, but its header promises 1 of 'face'")
    );
}

/// A header that promises far more than the file holds costs nothing.
#[test]
fn lying_headers_are_cheap() {
    for (from, to) in [
        ("element vertex 4", "element vertex 4294967295"),
        ("element camera 1", "element camera 9999999999999"),
    ] {
        let bytes = quad_binary(PLAIN);
        let text = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let lie = [&bytes[..text], to.as_bytes(), &bytes[text + from.len()..]].concat();
        assert!(refusal("b.ply", lie).contains("the file ends here"));
    }
    // A list of 4 billion corners in a file of a few hundred bytes.
    let bytes = quad_binary(Types { count: "uint", ..PLAIN });
    let mut lie = bytes.clone();
    let face = bytes.len() - 4 - 5 - 16 - 4;
    lie[face..face + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(refusal("b.ply", lie).starts_with("b.ply, face 0: the file ends here"));
    // Elements without properties take no bytes, so their number says nothing.
    let empty = QUAD_PLY.replace("element face", "element nothing 18446744073709551615\nelement face");
    is_the_quad(&read("a.ply", empty).unwrap());
}

#[test]
fn other_refusals() {
    let packed = gzip(QUAD_PLY.as_bytes());
    assert!(
        refusal("a.ply.gz", &packed[..packed.len() - 5]).starts_with("a.ply.gz: the gzip data is damaged")
    );
    assert!(refusal("a.ply.gz", QUAD_PLY).starts_with("a.ply.gz: the gzip data is damaged"));
    assert!(
        refusal("a.ply.gz", [&packed[..], &[0, 0, 1]].concat())
            .starts_with("a.ply.gz: the gzip data is damaged")
    );
    let mut changed = packed.clone();
    changed[packed.len() - 6] ^= 1;
    assert!(refusal("a.ply.gz", changed).starts_with("a.ply.gz: the gzip data is damaged"));
    assert!(refusal("a.ply.gz", gzip(b"")).starts_with("a.ply.gz: there is nothing in it"));
    assert!(refusal("a.ply.gz", "").starts_with("a.ply.gz: "));
    assert!(refusal("a.fbx", "teapot\n").starts_with("a.fbx: neither OBJ, PLY, STL nor glTF; convert it"));
    assert!(refusal("a", [0u8, 1, 2, 255]).starts_with("a: neither OBJ, PLY"));

    let missing = Mesh::load(Path::new("no/such/file.ply")).unwrap_err().to_string();
    assert!(missing.starts_with("cannot read no/such/file.ply: No such file"), "{missing}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quad.obj");
    std::fs::write(&path, QUAD_OBJ).unwrap();
    is_the_quad(&Mesh::load(&path).unwrap());
    std::fs::write(&path, "f 1 2\n").unwrap();
    let named = Mesh::load(&path).unwrap_err().to_string();
    assert!(named.starts_with(&format!("{}, line 1: a face needs", path.display())), "{named}");
}

/// Ten gigabytes in ten megabytes, and a file without end.
#[test]
fn what_is_read_has_a_limit() {
    let part = gzip(&vec![b' '; 64 << 20]);
    let bomb = part.repeat(160);
    let start = std::time::Instant::now();
    let limit = raykd::default_max_bytes().min(100 * bomb.len() as u64);
    let message = refusal("bomb.obj.gz", &bomb);
    assert!(
        message.starts_with(&format!(
            "bomb.obj.gz: this is more than {limit} bytes, unpacked, and no more are read;"
        )),
        "{message}"
    );
    assert!(message.ends_with("no more are read; if all is as it should be, allow more"), "{message}");
    // 256 MiB are always unpacked.
    assert!(refusal("small.obj.gz", part.repeat(3)).starts_with("small.obj.gz: there are no faces"));
    assert!(refusal("small.obj.gz", part.repeat(5)).contains("more than 268435456 bytes"));
    println!("{:?}", start.elapsed());

    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in
        [("quad.obj", QUAD_OBJ.as_bytes().to_vec()), ("quad.obj.gz", gzip(QUAD_OBJ.as_bytes()))]
    {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let enough = QUAD_OBJ.len().max(bytes.len()) as u64;
        is_the_quad(&Mesh::load_up_to(&path, enough).unwrap());
        let message = Mesh::load_up_to(&path, enough - 1).unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("{}: this is more than {} bytes", path.display(), enough - 1)),
            "{message}"
        );
    }
    #[cfg(unix)]
    {
        let endless = Mesh::load_up_to(Path::new("/dev/zero"), 1 << 20).unwrap_err().to_string();
        assert!(endless.starts_with("/dev/zero: this is more than 1048576 bytes"), "{endless}");
    }
    // A plain file's length is known before it is read.
    let path = folder.path().join("sparse.ply");
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    assert!(Mesh::load(&path).unwrap_err().to_string().contains("this is more than"));
}

#[cfg(unix)]
#[test]
fn names_need_not_be_utf8() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt};
    let folder = tempfile::tempdir().unwrap();
    for name in [&b"gr\xfc\xdfe.obj"[..], b"\xff.OBJ.gz", b"\xfe"] {
        let path = folder.path().join(OsStr::from_bytes(name));
        let bytes = if name.ends_with(b"gz") { gzip(QUAD_OBJ.as_bytes()) } else { QUAD_OBJ.into() };
        std::fs::write(&path, bytes).unwrap();
        is_the_quad(&Mesh::load(&path).unwrap());
        let scene = raykd::mesh::MeshSource::try_from(path.as_os_str()).unwrap();
        is_the_quad(&scene.load().unwrap());
    }
}

/// Every file that the tests of damage start from.
static SAMPLES: LazyLock<[(&str, Vec<u8>); 7]> = LazyLock::new(|| {
    let big = Types { big_endian: true, coordinate: "double", count: "uint", index: "short", ..PLAIN };
    [
        ("a.obj", QUAD_OBJ.into()),
        ("a.ply", QUAD_PLY.into()),
        ("a.ply", quad_binary(PLAIN)),
        ("a.ply", quad_binary(big)),
        ("a.obj.gz", gzip(QUAD_OBJ.as_bytes())),
        ("a.ply.gz", gzip(&quad_binary(PLAIN))),
        ("unnamed", QUAD_PLY.into()),
    ]
});

#[test]
fn truncation_anywhere_is_no_panic() {
    for &(name, ref bytes) in SAMPLES.iter() {
        for length in 0..bytes.len() {
            match read(name, &bytes[..length]) {
                Err(e) => assert!(e.to_string().len() > 20),
                // Text may lose its last line break or digits, and PLY what follows the faces.
                Ok(mesh) => {
                    assert!(mesh.triangles().len() <= 2 && bytes.len() - length <= 12, "{name} {length}")
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn damage_is_no_panic(
        sample in 0usize..7,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let (name, mut bytes) = SAMPLES[sample].clone();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Err(e) = read(name, bytes) {
            prop_assert!(e.to_string().len() > 20);
        }
    }

    #[test]
    fn noise_is_no_panic(
        name in prop::sample::select(vec!["a.obj", "a.ply", "a.gz", "a"]),
        bytes in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let _ = read(name, bytes);
    }

    /// Words of the formats in any order reach deeper than noise.
    #[test]
    fn word_salad_is_no_panic(ply in any::<bool>(), words in prop::collection::vec(prop::sample::select(vec![
        "v", "f", "l", "1", "-1", "2/", "/", "//", "1/1/1/1", "9e99", "\\\n", "\n", "\n", "\n", "ply\n",
        "format ascii 1.0\n", "format binary_little_endian 1.0\n",
        "element vertex 3\n", "element face 1\n", "property float x\n", "property float y\n", "property float z\n",
        "property list uchar int vertex_indices\n", "property list float int vertex_index\n", "end_header\n",
        "0 0 0\n", "3 0 1 2\n",
        "nan", "\u{e9}",
        "f 9223372036854775807 -9223372036854775808 1\n",
    ]), 0..40)) {
        let text = words.join(" ").replace("\n ", "\n");
        let _ = read(if ply { "a.ply" } else { "a.obj" }, text);
    }

    /// What is written is what is read, bit for bit.
    #[test]
    fn round_trips(
        positions in prop::collection::vec(prop::array::uniform3((-1e6f32..1e6).prop_map(|x| x + 0.0)), 3..30),
        faces in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 1..30),
        big_endian in any::<bool>(),
        double in any::<bool>(),
    ) {
        let triangles: Vec<[u32; 3]> = faces.iter().map(|f| f.map(|i| i.index(positions.len()) as u32)).collect();
        let mesh = Mesh::new(positions.clone(), triangles.clone()).unwrap();
        let lists: Vec<Vec<i64>> = triangles.iter().map(|t| t.map(i64::from).to_vec()).collect();
        let lists: Vec<&[i64]> = lists.iter().map(Vec::as_slice).collect();
        let vertices: Vec<[f64; 3]> = positions.iter().map(|p| p.map(f64::from)).collect();
        let types = Types { big_endian, coordinate: if double { "double" } else { "float" }, ..PLAIN };
        let ply = read("a.ply", binary_ply(types, &vertices, &lists)).unwrap();
        prop_assert_eq!(ply.positions(), &positions[..]);
        prop_assert_eq!(ply.triangles(), &triangles[..]);
        prop_assert_eq!(ply.kept(), mesh.kept());
        prop_assert_eq!(ply.repairs(), mesh.repairs());
        let mut obj = String::new();
        for p in &vertices {
            obj += &format!("v {} {} {}\n", p[0], p[1], p[2]);
        }
        for t in &triangles {
            obj += &format!("f {} {}/1 {}//2\n", t[0] + 1, t[1] + 1, t[2] + 1);
        }
        let obj = read("a.obj", obj).unwrap();
        prop_assert_eq!(corners(&obj), corners(&mesh));
        prop_assert_eq!(obj.kept(), mesh.kept());
        prop_assert_eq!(obj.repairs(), mesh.repairs());
    }
}
