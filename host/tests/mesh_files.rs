//! Mesh files: what is read, what is refused, and with which words.

use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;
use raykd::mesh::{Mesh, MeshError};
use std::io::Write;
use std::path::Path;

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, MeshError> {
    Mesh::from_bytes(Path::new(name), bytes.as_ref().to_vec())
}

/// The message of the error that reading gives.
fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> String {
    read(name, bytes).expect_err("this file should be refused").to_string()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// The corners of every triangle, in order: what a mesh is whatever its vertices are numbered like.
fn corners(mesh: &Mesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles().iter().map(|t| t.map(|v| mesh.positions()[v as usize])).collect()
}

const A: [f32; 3] = [0.0, 0.0, 0.0];
const B: [f32; 3] = [1.0, 0.0, 0.0];
const C: [f32; 3] = [1.0, 1.0, 0.5];
const D: [f32; 3] = [0.0, 1.0, 0.25];

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
    let vertices = [A, B, C, D].map(|p| p.map(f64::from));
    binary_ply(types, &vertices, &[&[0, 1, 2, 3]])
}

fn is_the_quad(mesh: &Mesh) {
    assert_eq!(corners(mesh), [[A, B, C], [A, C, D]]);
    assert_eq!(mesh.kept(), [0, 1]);
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
    // Without a telling name.
    is_the_quad(&read("mesh", QUAD_OBJ).unwrap());
    is_the_quad(&read("mesh.txt", format!("# a comment\n\n{QUAD_OBJ}")).unwrap());
    is_the_quad(&read("mesh", QUAD_PLY).unwrap());
    is_the_quad(&read("mesh.dat", gzip(QUAD_PLY.as_bytes())).unwrap());
    is_the_quad(&read("mesh.gz", gzip(QUAD_OBJ.as_bytes())).unwrap());
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
fn text_ply_skips_what_it_need_not_know() {
    let text = "ply\nformat ascii 1.0\nelement camera 2\nproperty list uchar float view\nelement nothing 5\n\
        element face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\n\
        property list uchar float texcoord\nelement vertex 4\nproperty list uchar int bones\n\
        property double z\nproperty double x\nproperty float nx\nproperty double y\nend_header\n\
        1 5\n0\n\n9 3 0 1 2 2 .5 .5\n9 3 0 2 3 0\n2 7 7 0 0 nan 0\n0 0 1 0 0\n0 0.5 1 0 1\n  0 0.25 0 0 1  \nmore";
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
    assert_eq!(mesh.repairs().ignored, 2);
    assert_eq!(mesh.repairs().polygons, 0);
}

#[test]
fn polygons_become_fans() {
    let ring = "v 1 0 0\nv 0.5 0.9 0\nv -0.5 0.9 0\nv -1 0 0\nv -0.5 -0.9 0\nv 0.5 -0.9 0\n";
    let obj = read("a.obj", format!("{ring}f 1 2 3 4 5 6\nf 3 2 1\n")).unwrap();
    let p: Vec<[f32; 3]> =
        vec![[1., 0., 0.], [0.5, 0.9, 0.], [-0.5, 0.9, 0.], [-1., 0., 0.], [-0.5, -0.9, 0.], [0.5, -0.9, 0.]];
    let fan =
        [[p[0], p[1], p[2]], [p[0], p[2], p[3]], [p[0], p[3], p[4]], [p[0], p[4], p[5]], [p[2], p[1], p[0]]];
    assert_eq!(corners(&obj), fan);
    assert_eq!(obj.repairs().polygons, 1);
    let vertices: Vec<[f64; 3]> = p.iter().map(|p| p.map(f64::from)).collect();
    let ply = read("a.ply", binary_ply(PLAIN, &vertices, &[&[0, 1, 2, 3, 4, 5], &[2, 1, 0]])).unwrap();
    assert_eq!(corners(&ply), fan);
    assert_eq!(ply.repairs().polygons, 1);
    // 0.9 is no f32, and was one when it was written to the binary file.
    assert_eq!((ply.repairs().rounded, obj.repairs().rounded), (0, 4));
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
        ("element vertex", "element point", "bad.ply, header: there is no element 'vertex'"),
        ("element vertex 4", "element vertex 4294967296", "bad.ply, header: 4294967296 vertices are more"),
        ("element face", "element tristrips", "bad.ply: there are no faces"),
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
    let vertices = [A, B, C, D].map(|p| p.map(f64::from));
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
    assert!(refusal("a.ply.gz", gzip(b"")).starts_with("a.ply.gz: there is nothing in it"));
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

/// Every file that the tests of damage start from.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let big = Types { big_endian: true, coordinate: "double", count: "uint", index: "short", ..PLAIN };
    vec![
        ("a.obj", QUAD_OBJ.into()),
        ("a.ply", QUAD_PLY.into()),
        ("a.ply", quad_binary(PLAIN)),
        ("a.ply", quad_binary(big)),
        ("a.obj.gz", gzip(QUAD_OBJ.as_bytes())),
        ("a.ply.gz", gzip(&quad_binary(PLAIN))),
        ("unnamed", QUAD_PLY.into()),
    ]
}

#[test]
fn truncation_anywhere_is_no_panic() {
    for (name, bytes) in samples() {
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
    fn damage_is_no_panic(sample in 0usize..7, damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let (name, mut bytes) = samples().swap_remove(sample);
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Err(e) = read(name, bytes) {
            prop_assert!(e.to_string().len() > 20);
        }
    }

    #[test]
    fn noise_is_no_panic(name in prop::sample::select(vec!["a.obj", "a.ply", "a.gz", "a"]), bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = read(name, bytes);
    }

    /// Words of the formats in any order reach deeper than noise.
    #[test]
    fn word_salad_is_no_panic(ply in any::<bool>(), words in prop::collection::vec(prop::sample::select(vec![
        "v", "f", "l", "1", "-1", "2/", "/", "//", "1/1/1/1", "9e99", "\\\n", "\n", "\n", "\n", "ply\n", "format ascii 1.0\n", "format binary_little_endian 1.0\n",
        "element vertex 3\n", "element face 1\n", "property float x\n", "property float y\n", "property float z\n",
        "property list uchar int vertex_indices\n", "property list float int vertex_index\n", "end_header\n", "0 0 0\n", "3 0 1 2\n", "nan", "\u{e9}",
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
