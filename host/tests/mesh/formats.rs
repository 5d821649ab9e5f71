//! STL and glTF: what is read, what is refused, and with which words.

use crate::{A, B, C, D, corners, gzip, is_the_quad, read, refusal};
use proptest::prelude::*;
use raykd::mesh::{Mesh, MeshError};
use serde_json::{Value, json};
use std::sync::LazyLock;

// STL

const QUAD_STL: &str = "solid a quad\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n\
    \x20  vertex 1 1 .5\n  endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n\
    \x20  vertex 1. 1e0 5e-1\n   vertex 0 1 0.25\n  endloop\n endfacet\nendsolid a quad\n";

fn stl(head: &[u8], triangles: &[[[f64; 3]; 3]]) -> Vec<u8> {
    let mut out = head.to_vec();
    out.resize(80, b' ');
    out.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        out.extend([0; 12]);
        out.extend(triangle.as_flattened().iter().flat_map(|&x| (x as f32).to_le_bytes()));
        out.extend([7, 7]);
    }
    out
}

#[test]
fn stl_of_both_forms() {
    let binary = stl(b"made by hand", &[[A, B, C], [A, C, D]]);
    for name in ["a.stl", "a.STL", "unnamed"] {
        is_the_quad(&read(name, &binary).unwrap());
        is_the_quad(&read(name, QUAD_STL).unwrap());
        is_the_quad(&read(name, QUAD_STL.replace('\n', "\r\n")).unwrap());
    }
    for bytes in [&binary[..], QUAD_STL.as_bytes()] {
        is_the_quad(&read("a.stl.gz", gzip(bytes)).unwrap());
        is_the_quad(&read("mesh.gz", gzip(bytes)).unwrap());
    }
    is_the_quad(&read("a.stl", QUAD_STL.to_uppercase()).unwrap());
    is_the_quad(&read("a.stl", QUAD_STL.replace('\n', "\r")).unwrap());
    // A mark of UTF-8.
    is_the_quad(&read("a.stl", format!("\u{feff}{QUAD_STL}")).unwrap());
    is_the_quad(&read("a", format!("\u{feff}{QUAD_STL}")).unwrap());
    // Several solids, and blank lines.
    let (first, second) = QUAD_STL.split_at(QUAD_STL.rfind(" facet").unwrap());
    is_the_quad(&read("a.stl", format!("\n{first}endsolid\n\nsolid\n{second}\n\n")).unwrap());
    // Vertices are not joined: corner k of triangle i is vertex 3 i + k.
    assert_eq!(read("a.stl", QUAD_STL).unwrap().triangles(), [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(read("a.stl", &binary).unwrap().triangles(), [[0, 1, 2], [3, 4, 5]]);
}

/// Its length tells a binary file, not its first word.
#[test]
fn binary_stl_may_begin_with_solid() {
    for head in [&b"solid"[..], b"solid cube\n", b"SOLID facet normal"] {
        is_the_quad(&read("a.stl", stl(head, &[[A, B, C], [A, C, D]])).unwrap());
    }
    let cut = stl(b"solid cube", &[[A, B, C], [A, C, D]]);
    let cut = refusal("a.stl", &cut[..cut.len() - 1]);
    assert_eq!(
        cut,
        "a.stl, header: its header says 2 triangles, but there are 1 and 49 bytes; the file is incomplete, \
         fetch or export it again"
    );
}

#[test]
fn stl_errors_name_the_place() {
    for (from, to, message) in [
        ("vertex 1 1 .5", "vertex 1 nan .5", "bad.stl, line 6: coordinate 'NaN' is not a finite"),
        ("vertex 1 1 .5", "vertex 1 1e39 .5", "coordinate '1e39' is not a finite 32-bit float"),
        ("vertex 1 1 .5", "vertex 1 one .5", "bad.stl, line 6: 'one' is not a coordinate"),
        (
            "vertex 1 1 .5",
            "vertex 1 1",
            "bad.stl, line 6: 'vertex' with three coordinates must stand here, not",
        ),
        ("vertex 1 1 .5", "vertex 1 1 1 1", "bad.stl, line 6: 'vertex' with three coordinates must"),
        (
            "   vertex 1 1 .5\n",
            "",
            "bad.stl, line 6: 'vertex' with three coordinates must stand here, not 'endloop'",
        ),
        (
            "   vertex 1 1 .5\n",
            "vertex 1 1 .5\nvertex 1 1 1\n",
            "bad.stl, line 7: 'endloop' (a facet has three",
        ),
        (" facet normal", " polygon normal", "bad.stl, line 2: 'facet normal' or 'endsolid' must stand here"),
        ("outer loop", "loop", "bad.stl, line 3: 'outer loop' must stand here, not 'loop'"),
        ("endfacet", "end", "bad.stl, line 8: 'endfacet' must stand here, not 'end'"),
        ("endsolid a quad\n", "", "bad.stl: the file ends where 'facet normal' or 'endsolid' must stand"),
        ("solid a quad\n", "liquid\n", "bad.stl, header: its header says"),
    ] {
        let text = QUAD_STL.replacen(from, to, 1);
        assert_ne!(text, QUAD_STL);
        let refusal = refusal("bad.stl", text);
        assert!(refusal.contains(message), "{from:?} -> {to:?}\ngives {refusal:?}\nwanted {message:?}");
    }
    assert!(refusal("a.stl", "solid\nendsolid\n").starts_with("a.stl: there are no faces"));
    assert!(refusal("a.stl", "").starts_with("a.stl: there is nothing in it"));
    assert!(refusal("a.stl", "stl").starts_with("a.stl, header: 3 bytes are too few for a binary file"));
    assert!(refusal("a.stl", stl(b"", &[])).starts_with("a.stl: there are no faces"));
    let bad = stl(b"", &[[A, B, C], [A, [0.0, f64::INFINITY, 0.0], D]]);
    assert!(refusal("a.stl", bad).starts_with("a.stl, triangle 1: coordinate 'inf' is not a finite"));
    // What a header says is not what is asked of memory.
    for count in [0u32, 1, 3, 1 << 28, u32::MAX] {
        let mut lie = stl(b"", &[[A, B, C], [A, C, D]]);
        lie[80..84].copy_from_slice(&count.to_le_bytes());
        let refusal = refusal("a.stl", lie);
        let wanted = format!("a.stl, header: its header says {count} triangles, but there are 2 and 0 bytes");
        assert!(refusal.starts_with(&wanted), "{refusal}");
    }
}

// glTF

/// Four vertices and six indices of 16 bits.
fn quad_bytes() -> Vec<u8> {
    let mut bytes: Vec<u8> =
        [A, B, C, D].as_flattened().iter().flat_map(|&x| (x as f32).to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

fn quad_json() -> Value {
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 99}, "indices": 1, "material": 7}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0.5]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48, "target": 34962},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60}],
        "materials": [{"what": "ever"}], "images": [{"uri": "missing.png"}],
    })
}

fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let pad = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, bin) = (pad(json.to_string().as_bytes(), b' '), pad(bin, 0));
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((28 + json.len() + bin.len()) as u32).to_le_bytes());
    for (kind, bytes) in [(b"JSON", json), (b"BIN\0", bin)] {
        out.extend((bytes.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(bytes);
    }
    out
}

/// The quad's file with one value changed, or added.
fn changed(pointer: &str, value: Value) -> Value {
    let mut json = quad_json();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match json.pointer_mut(parent).unwrap_or_else(|| panic!("{pointer}")) {
        Value::Object(map) => drop(map.insert(key.to_owned(), value)),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        _ => panic!("{pointer}"),
    }
    json
}

fn in_glb(json: &Value) -> Result<Mesh, MeshError> {
    read("a.glb", glb(json, &quad_bytes()))
}

fn data_uri(bytes: &[u8]) -> String {
    use base64::Engine as _;
    format!(
        "data:application/octet-stream;base64,{}",
        base64::engine::general_purpose::STANDARD.encode(bytes)
    )
}

#[test]
fn gltf_of_every_form() {
    let binary = glb(&quad_json(), &quad_bytes());
    let text = changed("/buffers/0/uri", data_uri(&quad_bytes()).into()).to_string();
    for bytes in [&binary[..], text.as_bytes()] {
        for name in ["a.glb", "a.gltf", "A.GLTF", "unnamed"] {
            is_the_quad(&read(name, bytes).unwrap());
        }
        is_the_quad(&read("a.glb.gz", gzip(bytes)).unwrap());
        is_the_quad(&read("unnamed", gzip(bytes)).unwrap());
        // A mark of UTF-8.
        let marked = [b"\xef\xbb\xbf", bytes].concat();
        is_the_quad(&read("a.gltf", &marked).unwrap());
        is_the_quad(&read("unnamed", &marked).unwrap());
    }
    // Data that are not base64, and base64 without its padding.
    let percent: String = quad_bytes().iter().map(|byte| format!("%{byte:02x}")).collect();
    is_the_quad(
        &read("a.gltf", changed("/buffers/0/uri", format!("data:,{percent}").into()).to_string()).unwrap(),
    );
    let bare = data_uri(&[quad_bytes(), vec![0]].concat()).trim_end_matches('=').to_owned();
    is_the_quad(&read("a.gltf", changed("/buffers/0/uri", bare.into()).to_string()).unwrap());
}

#[test]
fn gltf_buffers_in_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let load = |uri: &str| {
        std::fs::write(&path, changed("/buffers/0/uri", uri.into()).to_string()).unwrap();
        Mesh::load(&path)
    };
    std::fs::write(folder.path().join("a mesh.bin"), [quad_bytes(), vec![1; 100]].concat()).unwrap();
    is_the_quad(&load("a%20mesh.bin").unwrap());
    is_the_quad(&load("a mesh.bin").unwrap());
    let below = folder.path().join("below");
    std::fs::create_dir(&below).unwrap();
    std::fs::write(below.join("a.bin"), quad_bytes()).unwrap();
    is_the_quad(&load("./below/a.bin").unwrap());
    std::fs::write(folder.path().join("short.bin"), [0; 59]).unwrap();
    for (uri, message) in [
        ("short.bin", "a.gltf, buffer 0: it has 59 bytes of 60 announced"),
        ("missing.bin", "a.gltf, buffer 0: cannot read "),
        ("/dev/zero", "a.gltf, buffer 0: '/dev/zero' is no file beside this one, or in a folder there"),
        ("../a mesh.bin", "'../a mesh.bin' is no file beside this one"),
        ("below/%2e./../a mesh.bin", "'below/%2e./../a mesh.bin' is no file beside this one"),
        (
            "https://example.org/a.bin",
            "a.gltf, buffer 0: 'https://example.org/a.bin' is no file beside this one",
        ),
        ("missing.bin", "missing.bin: No such file"),
        (".", "not a regular file; put this file there"),
        ("data:;base64,=AAA", "a.gltf, buffer 0: its data are no base64"),
        ("data:none", "a.gltf, buffer 0: its data are no base64"),
    ] {
        let found = load(uri).unwrap_err().to_string();
        assert!(found.contains(message), "{uri}: {found}");
    }
    // The file itself is short of what its buffer takes.
    is_the_quad(&load("a%20mesh.bin").unwrap());
    let bytes = std::fs::metadata(&path).unwrap().len();
    is_the_quad(&Mesh::load_up_to(&path, bytes + 60).unwrap());
    let found = Mesh::load_up_to(&path, bytes + 59).unwrap_err().to_string();
    assert!(found.contains("buffer 0") && found.contains(&format!("more than {}", bytes + 59)), "{found}");
    let text = changed("/buffers/0/uri", "a.bin".into()).to_string();
    assert!(
        refusal("a.gltf", text)
            .starts_with("a.gltf, buffer 0: it is the file 'a.bin', which bytes in memory")
    );
}

#[test]
fn gltf_nodes_are_transformed_in_f64() {
    let moved = |node: Value| corners(&in_glb(&changed("/nodes/0", node)).unwrap());
    let quad = |f: &dyn Fn([f64; 3]) -> [f64; 3]| vec![[A, B, C].map(f), [A, C, D].map(f)];
    assert_eq!(
        moved(json!({"mesh": 0, "translation": [1, -2, 0.5]})),
        quad(&|p| [p[0] + 1.0, p[1] - 2.0, p[2] + 0.5])
    );
    assert_eq!(
        moved(json!({"mesh": 0, "scale": [2, -4, 8]})),
        quad(&|p| [p[0] * 2.0, p[1] * -4.0, p[2] * 8.0])
    );
    // A quarter turn about z, not quite normalized, and then moved: scale, rotation, translation.
    let turn = json!({"mesh": 0, "rotation": [0, 0, 0.5, 0.5], "scale": [2, 1, 1], "translation": [5, 0, 0]});
    assert_eq!(moved(turn), quad(&|p| [5.0 - p[1], 2.0 * p[0], p[2]]));
    let columns = json!({"mesh": 0, "matrix": [0, 2, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]});
    assert_eq!(moved(columns), quad(&|p| [5.0 - p[1], 2.0 * p[0], p[2]]));
    // A child of a child: the parent's transform comes last.
    let mut json = changed(
        "/nodes",
        json!([{"scale": [2, 2, 2], "children": [2]}, {}, {"translation": [1, 0, 0], "mesh": 0}]),
    );
    assert_eq!(corners(&in_glb(&json).unwrap()), quad(&|p| [2.0 * p[0] + 2.0, 2.0 * p[1], 2.0 * p[2]]));
    // A translation that f32 cannot hold keeps its digits.
    let small = 0.007_812_5;
    json["nodes"] =
        json!([{"mesh": 0, "translation": [4_500_000.125, 0, 0], "scale": [small, small, small]}]);
    let far = in_glb(&json).unwrap();
    assert_eq!(corners(&far), quad(&|p| [p[0] / 128.0 + 4_500_000.125, p[1] / 128.0, p[2] / 128.0]));
    assert_eq!((far.kept().len(), far.repairs().rounded), (2, 0));
    assert!(far.translation()[0] > 4_499_999.0);
    for (node, message) in [
        (json!({"mesh": 0, "rotation": [0, 0, 0, 0]}), "node 0: its rotation is no unit quaternion"),
        (
            json!({"mesh": 0, "matrix": [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}),
            "node 0: its matrix is no affine",
        ),
        (json!({"mesh": 0, "scale": [1e39, 1, 1]}), "mesh 0, primitive 0: coordinate '1e39' is not a finite"),
        (json!({"mesh": 0, "children": [0]}), "node 0: it is reached twice"),
        (json!({"mesh": 0, "children": [1]}), "node 1: there is none of that number, but 1 in all"),
        (json!({"mesh": 1}), "mesh 1: there is none of that number, but 1 in all"),
    ] {
        let found = in_glb(&changed("/nodes/0", node)).unwrap_err().to_string();
        assert!(found.starts_with(&format!("a.glb, {message}")), "{found}");
    }
}

#[test]
fn gltf_triangles_are_numbered_by_the_scene() {
    // Nodes at x = 0, 10, 20 and so on tell the order.
    let at = |x: u32, children: &[u32]| json!({"mesh": 0, "translation": [x, 0, 0], "children": children});
    let order = |json: &Value| -> Vec<f64> {
        let mesh = in_glb(json).unwrap();
        mesh.triangles().iter().map(|t| mesh.vertex(t[0])[0]).collect()
    };
    let nodes = json!([at(10, &[3, 1]), at(1, &[]), at(20, &[]), at(2, &[4]), at(5, &[])]);
    let mut json = changed("/nodes", nodes);
    json["scenes"] = json!([{"nodes": [2]}, {"nodes": [2, 0]}]);
    assert_eq!(order(&json), [20.0, 20.0]);
    json["scene"] = 1.into();
    let deep = [10.0, 10.0, 12.0, 12.0, 17.0, 17.0, 11.0, 11.0];
    assert_eq!(order(&json), [&[20.0, 20.0], &deep[..]].concat());
    json.as_object_mut().unwrap().remove("scene");
    assert_eq!(order(&json), [20.0, 20.0], "the first scene");
    json["scenes"] = json!([]);
    assert_eq!(order(&json), [&deep[..], &[20.0, 20.0]].concat(), "all nodes without parent");
    json["nodes"] = json!([]);
    assert_eq!(order(&json), [0.0, 0.0], "meshes as they are");
    json["nodes"] = json!([{"children": [1]}, {"children": [0]}]);
    assert!(
        in_glb(&json).unwrap_err().to_string().starts_with("a.glb: there are no faces"),
        "a ring has no root"
    );
    json["scene"] = 3.into();
    assert!(
        in_glb(&json).unwrap_err().to_string().starts_with("a.glb, scene 3: there is none of that number")
    );
}

#[test]
fn gltf_modes() {
    let mode = |mode: u32, indices: &[u16]| {
        let mut json = changed("/meshes/0/primitives/0/mode", mode.into());
        json["accessors"][1]["count"] = indices.len().into();
        json["bufferViews"][1]["byteLength"] = (2 * indices.len()).into();
        json["buffers"][0]["byteLength"] = (48 + 2 * indices.len()).into();
        let bytes =
            [&quad_bytes()[..48], &indices.iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<_>>()].concat();
        read("a.glb", glb(&json, &bytes))
    };
    assert_eq!(corners(&mode(4, &[3, 1, 2]).unwrap()), [[D, B, C]]);
    assert_eq!(corners(&mode(5, &[0, 1, 3, 2]).unwrap()), [[A, B, D], [B, C, D]]);
    assert_eq!(corners(&mode(5, &[0, 1, 3, 2, 0]).unwrap()), [[A, B, D], [B, C, D], [D, C, A]]);
    assert_eq!(corners(&mode(6, &[0, 1, 2, 3]).unwrap()), [[B, C, A], [C, D, A]]);
    let wrong = |number, indices: &[u16]| mode(number, indices).unwrap_err().to_string();
    assert!(wrong(0, &[0, 1, 2]).starts_with("a.glb: there are no faces"));
    assert!(
        wrong(4, &[0, 1, 2, 3]).starts_with("a.glb, mesh 0, primitive 0: 4 corners are no whole triangles")
    );
    assert!(
        wrong(5, &[0, 1])
            .starts_with("a.glb, mesh 0, primitive 0: a face needs at least 3 corners, this one has 2")
    );
    assert!(wrong(7, &[0, 1, 2]).starts_with("a.glb, mesh 0, primitive 0: there is no mode 7"));
    assert!(
        wrong(4, &[0, 1, 4]).starts_with(
            "a.glb, mesh 0, primitive 0: vertex index 4 is out of range, the vertices are 0 to 3"
        )
    );
    // Without indices, and with points beside.
    let mut json = quad_json();
    json["meshes"][0]["primitives"] = json!([
        {"attributes": {"POSITION": 0}, "mode": 5}, {"attributes": {"POSITION": 0}, "mode": 0},
    ]);
    let mesh = in_glb(&json).unwrap();
    assert_eq!(corners(&mesh), [[A, B, C], [B, D, C]]);
    assert_eq!(mesh.repairs().ignored, 1);
}

#[test]
fn gltf_accessors_of_every_kind() {
    // Integers, as they are and normalized, with strides and offsets.
    let vertices: [[i32; 3]; 4] = [[0, 0, 0], [100, 0, 0], [127, -127, 50], [-128, 64, 3]];
    for (kind, size, whole, signed) in
        [(5120, 1, 127.0, true), (5121, 1, 255.0, false), (5122, 2, 32767.0, true), (5123, 2, 65535.0, false)]
    {
        for (normalized, stride, offset) in [(false, 8, 0), (true, 8, 2), (false, 6, 0)] {
            let stride = if stride == 6 { 3 * size } else { stride };
            let given = |x: i32| if signed { x } else { x.abs() };
            let mut bytes = vec![0xee; offset];
            for vertex in vertices {
                let start = bytes.len();
                bytes.extend(vertex.iter().flat_map(|&x| given(x).to_le_bytes()[..size].to_vec()));
                bytes.resize(start + stride, 0xee);
            }
            let mut json = changed(
                "/accessors/0",
                json!({
                    "bufferView": 0, "byteOffset": offset, "componentType": kind, "normalized": normalized,
                    "count": 4, "type": "VEC3",
                }),
            );
            json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
            json["bufferViews"][0]["byteLength"] = bytes.len().into();
            json["bufferViews"][0]["byteStride"] = stride.into();
            json["bufferViews"][1]["byteOffset"] = bytes.len().into();
            bytes.extend(&quad_bytes()[48..]);
            json["buffers"][0]["byteLength"] = bytes.len().into();
            let mesh = read("a.glb", glb(&json, &bytes)).unwrap();
            for (number, vertex) in vertices.iter().enumerate() {
                let wanted = vertex.map(|x| {
                    let x = f64::from(given(x));
                    if normalized { f64::from((x / whole).max(-1.0) as f32) } else { x }
                });
                assert_eq!(mesh.vertex(number as u32), wanted, "{kind} {normalized} {stride}");
            }
        }
    }
    // Indices of 8 and 32 bits.
    for (kind, size) in [(5121, 1), (5125, 4)] {
        let mut json = changed("/accessors/1/componentType", kind.into());
        json["bufferViews"][1]["byteLength"] = (6 * size).into();
        json["buffers"][0]["byteLength"] = (48 + 6 * size).into();
        let indices = [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()[..size].to_vec());
        let bytes = [quad_bytes()[..48].to_vec(), indices.collect()].concat();
        is_the_quad(&read("a.glb", glb(&json, &bytes)).unwrap());
    }
}

#[test]
fn gltf_sparse_accessors() {
    let sparse = |base: Option<u32>, indices: [u8; 2]| {
        let mut json = quad_json();
        json["accessors"][0]["sparse"] = json!({
            "count": 2,
            "indices": {"bufferView": 2, "componentType": 5121},
            "values": {"bufferView": 2, "byteOffset": 4},
        });
        match base {
            Some(view) => json["accessors"][0]["bufferView"] = view.into(),
            None => drop(json["accessors"][0].as_object_mut().unwrap().remove("bufferView")),
        }
        json["bufferViews"]
            .as_array_mut()
            .unwrap()
            .push(json!({"buffer": 0, "byteOffset": 60, "byteLength": 28}));
        json["buffers"][0]["byteLength"] = 88.into();
        let values = [7.0f32, 8.0, 9.0, -1.0, -2.0, -3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        read("a.glb", glb(&json, &[quad_bytes(), indices.to_vec(), vec![0; 2], values].concat()))
    };
    let [p, q] = [[7.0, 8.0, 9.0], [-1.0, -2.0, -3.0]];
    assert_eq!(corners(&sparse(Some(0), [1, 3]).unwrap()), [[A, p, C], [A, C, q]]);
    assert_eq!(corners(&sparse(None, [1, 2]).unwrap()), [[A, p, q], [A, q, A]]);
    for indices in [[3, 1], [1, 1], [0, 4]] {
        let found = sparse(Some(0), indices).unwrap_err().to_string();
        assert!(found.starts_with("a.glb, accessor 0: sparse index"), "{found}");
    }
}

/// All primitives have the same vertices: what is done for each must not grow with their number.
#[test]
fn gltf_primitives_take_no_quadratic_time() {
    const PRIMITIVES: usize = 100_000;
    let timed = |primitive: &Value, vertices: usize, changes: usize| {
        let mut json = quad_json();
        let primitives = vec![primitive.clone(); PRIMITIVES];
        json["meshes"][0]["primitives"] = primitives.into();
        let zeros = json!({"componentType": 5126, "count": vertices, "type": "VEC3"});
        json["accessors"].as_array_mut().unwrap().push(zeros);
        let mut bytes = quad_bytes();
        let (places, values) = (bytes.len(), bytes.len() + 4 * changes);
        bytes.extend((0..changes as u32).flat_map(u32::to_le_bytes));
        bytes.resize(values + 12 * changes, 0);
        json["buffers"][0]["byteLength"] = bytes.len().into();
        if changes > 0 {
            let views = json["bufferViews"].as_array_mut().unwrap();
            views.push(json!({"buffer": 0, "byteOffset": places, "byteLength": 4 * changes}));
            views.push(json!({"buffer": 0, "byteOffset": values, "byteLength": 12 * changes}));
            json["accessors"][2]["sparse"] = json!({
                "count": changes,
                "indices": {"bufferView": 2, "componentType": 5125},
                "values": {"bufferView": 3},
            });
        }
        let file = glb(&json, &bytes);
        let start = std::time::Instant::now();
        let found = read("a.glb", file);
        assert!(start.elapsed().as_secs() < 10, "{primitive}: {:?}", start.elapsed());
        found
    };
    let points = timed(&json!({"attributes": {"POSITION": 2}, "mode": 0}), 3_000_000, 0);
    assert!(points.unwrap_err().to_string().starts_with("a.glb: there are no faces"));
    let sparse = timed(&json!({"attributes": {"POSITION": 2}, "indices": 1}), 500_000, 500_000);
    assert_eq!(sparse.unwrap().triangles().len(), 2 * PRIMITIVES);
}

/// What is named again takes no room in the file, but in memory.
#[test]
fn gltf_that_names_the_same_numbers_again_has_a_limit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let mut json = quad_json();
    json["nodes"] = vec![json!({"mesh": 0}); 1000].into();
    json["scenes"][0]["nodes"] = (0..1000).collect::<Vec<_>>().into();
    let primitive = json["meshes"][0]["primitives"][0].clone();
    json["meshes"][0]["primitives"] = vec![primitive; 10].into();
    std::fs::write(&path, glb(&json, &quad_bytes())).unwrap();
    // Ten thousand squares of four vertices and two triangles.
    let written = 12 * 10_000 * (4 + 2);
    assert_eq!(Mesh::load_up_to(&path, written).unwrap().triangles().len(), 20_000);
    let found = Mesh::load_up_to(&path, written - 1).unwrap_err().to_string();
    assert!(
        found.contains(&format!("mesh 0, primitive 9: this is more than {} bytes", written - 1)),
        "{found}"
    );
}

/// All nodes have the same mesh, of which little is triangles.
#[test]
fn gltf_nodes_take_no_quadratic_time() {
    const MANY: usize = 100_000;
    let mut json = quad_json();
    let points = json!({"attributes": {"POSITION": 0}, "mode": 0});
    json["meshes"][0]["primitives"].as_array_mut().unwrap().resize(MANY, points);
    json["meshes"][0]["primitives"][7]["targets"] = json!([{}]);
    json["nodes"] = vec![json!({"mesh": 0}); MANY].into();
    json["scenes"][0]["nodes"] = (0..MANY).collect::<Vec<_>>().into();
    let file = glb(&json, &quad_bytes());
    let start = std::time::Instant::now();
    let mesh = read("a.glb", file).unwrap();
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
    assert_eq!(corners(&mesh), [[A, B, C], [A, C, D]].repeat(MANY));
    let repairs = mesh.repairs();
    assert_eq!((repairs.ignored, repairs.unposed), (u32::MAX, MANY as u32));
}

#[test]
fn gltf_extensions_are_refused_by_name() {
    let draco = "KHR_draco_mesh_compression";
    let mut json = changed("/extensionsRequired", json!([draco]));
    assert_eq!(
        in_glb(&json).unwrap_err().to_string(),
        "a.glb, header: it needs the glTF extension 'KHR_draco_mesh_compression', which is not read; \
         export the mesh without it"
    );
    // Not required, with and without other data.
    json = changed("/meshes/0/primitives/0/extensions", json!({draco: {"bufferView": 0}}));
    json["extensionsUsed"] = json!([draco]);
    is_the_quad(&in_glb(&json).unwrap());
    json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let found = in_glb(&json).unwrap_err().to_string();
    assert!(
        found.starts_with(&format!("a.glb, mesh 0, primitive 0: it needs the glTF extension '{draco}'")),
        "{found}"
    );
    for name in ["EXT_meshopt_compression", "KHR_gaussian_splatting", "VENDOR_anything"] {
        let found = in_glb(&changed("/extensionsRequired", json!(["KHR_materials_unlit", name])))
            .unwrap_err()
            .to_string();
        assert!(found.contains(&format!("the glTF extension '{name}'")), "{found}");
        is_the_quad(&in_glb(&changed("/extensionsUsed", json!([name]))).unwrap());
    }
    for name in ["EXT_mesh_gpu_instancing", "CESIUM_RTC"] {
        let found = in_glb(&changed("/extensionsUsed", json!([name]))).unwrap_err().to_string();
        assert!(found.contains(&format!("the glTF extension '{name}'")), "{found}");
    }
    for name in ["KHR_texture_transform", "KHR_materials_ior", "EXT_texture_webp", "KHR_lights_punctual"] {
        is_the_quad(&in_glb(&changed("/extensionsRequired", json!([name]))).unwrap());
    }
    // A buffer that only an extension fills.
    let mut json = changed("/bufferViews/0/extensions", json!({"EXT_meshopt_compression": {}}));
    json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 60}));
    json["bufferViews"][0]["buffer"] = 1.into();
    let found = in_glb(&json).unwrap_err().to_string();
    assert!(
        found.starts_with("a.glb, buffer 1: it needs the glTF extension 'EXT_meshopt_compression'"),
        "{found}"
    );
}

#[test]
fn gltf_poses_are_counted() {
    assert_eq!(in_glb(&quad_json()).unwrap().repairs().unposed, 0);
    let skin = in_glb(&changed("/nodes/0/skin", 0.into())).unwrap();
    let morph = in_glb(&changed("/meshes/0/primitives/0/targets", json!([{"POSITION": 0}]))).unwrap();
    for mesh in [skin, morph] {
        is_the_quad(&mesh);
        assert_eq!(mesh.repairs().unposed, 1);
    }
}

#[test]
fn gltf_errors_name_the_place() {
    let huge = json!(1u64 << 60);
    for (pointer, value, message) in [
        ("/asset/version", json!("1.0"), "header: glTF of version '1.0', but 2.0 is read"),
        (
            "/accessors/0/count",
            huge.clone(),
            "accessor 0: 1152921504606846976 elements do not fit its buffer view of 48",
        ),
        ("/accessors/0/count", json!(5), "accessor 0: 5 elements do not fit its buffer view of 48 bytes"),
        ("/accessors/1/count", json!(u64::MAX), "accessor 1: 18446744073709551615 elements do not fit"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "accessor 0: 4 elements do not fit"),
        (
            "/accessors/0/componentType",
            json!(5130),
            "accessor 0: type 'VEC3' of component type 5130 cannot serve",
        ),
        ("/accessors/0/type", json!("VEC2"), "accessor 0: type 'VEC2' of component type 5126 cannot serve"),
        (
            "/accessors/1/componentType",
            json!(5122),
            "accessor 1: type 'SCALAR' of component type 5122 cannot serve",
        ),
        (
            "/accessors/1/normalized",
            json!(true),
            "accessor 1: type 'SCALAR' of component type 5123 cannot serve",
        ),
        ("/bufferViews/0/byteLength", huge.clone(), "bufferView 0: it does not fit its buffer of 60 bytes"),
        (
            "/bufferViews/0/byteOffset",
            json!(u64::MAX),
            "bufferView 0: it does not fit its buffer of 60 bytes",
        ),
        ("/bufferViews/0/byteStride", json!(8), "bufferView 0: a stride of 8 bytes, but an element has 12"),
        ("/bufferViews/0/byteStride", json!(u64::MAX), "accessor 0: 4 elements do not fit"),
        ("/bufferViews/0/buffer", json!(1), "buffer 1: there is none of that number, but 1 in all"),
        ("/buffers/0/byteLength", huge, "buffer 0: it has 60 bytes of 1152921504606846976 announced"),
        (
            "/meshes/0/primitives/0/attributes",
            json!({}),
            "mesh 0, primitive 0: it has no attribute 'POSITION'",
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(2),
            "accessor 2: there is none of that number, but 2 in all",
        ),
        ("/meshes/0/primitives", json!([]), "there are no faces"),
        ("/scenes/0/nodes", json!([]), "there are no faces"),
        ("/accessors/0/count", json!(-4), "line 1: invalid value: integer `-4`"),
        ("/nodes/0", json!("node"), "line 1: "),
    ] {
        let found = in_glb(&changed(pointer, value.clone())).unwrap_err().to_string();
        assert!(found.starts_with("a.glb") && found.contains(message), "{pointer} = {value}: {found}");
    }
    // Nothing of a file moves a terminal's cursor, or fills its screen.
    let evil = format!("\u{1b}[31mRED\u{7}{}", "x".repeat(1000));
    for (pointer, value) in [
        ("/asset/version", json!(evil)),
        ("/extensionsRequired", json!([evil])),
        ("/accessors/0/type", json!(evil)),
        ("/buffers/0/uri", json!(format!("https://{evil}"))),
        ("/buffers/0/uri", json!(evil)),
        ("/nodes/0", json!(evil)),
    ] {
        let found = in_glb(&changed(pointer, value)).unwrap_err().to_string();
        assert!(!found.contains(char::is_control) && found.chars().count() < 400, "{pointer}: {found}");
        assert!(found.contains("\\u{1b}[31mRED\\u{7}x"), "{pointer}: {found}");
    }
    // Zeros without data, as many as one likes to announce.
    let mut json = changed("/accessors/0/count", json!(u32::MAX));
    json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    assert!(
        in_glb(&json)
            .unwrap_err()
            .to_string()
            .starts_with("a.glb, accessor 0: 4294967295 elements without data")
    );
    let mut bytes = quad_bytes();
    bytes[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    let nan = refusal("a.glb", glb(&quad_json(), &bytes));
    assert!(nan.starts_with("a.glb, mesh 0, primitive 0: coordinate 'NaN' is not a finite"), "{nan}");
    // The container.
    let whole = glb(&quad_json(), &quad_bytes());
    let with = |at: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        refusal("a.glb", bytes)
    };
    assert!(with(4, 1).starts_with("a.glb, header: binary glTF of version 1, but 2 is read"));
    assert!(with(11, 255).starts_with("a.glb, header: its header says"));
    assert!(with(15, 255).starts_with("a.glb, chunk 0: the file ends within its JSON part"));
    assert!(with(16, b'j').starts_with("a.glb, chunk 0: this is not the JSON part"));
    assert!(refusal("a.glb", &whole[..12]).starts_with("a.glb, "));
    assert!(refusal("a.glb", glb(&json!([]), &quad_bytes())).starts_with("a.glb"));
    assert!(
        refusal("a.glb", "glTF\x02")
            .starts_with("a.glb, header: a binary glTF file has a header of 12 bytes")
    );
    assert!(refusal("a.gltf", "{\"asset\": {\n").starts_with("a.gltf, line 2: EOF while parsing"));
    // Deep nesting takes no stack.
    assert!(refusal("a.gltf", "{\"asset\":".repeat(100_000)).starts_with("a.gltf, line 1: "));
}

// All of them

/// Every file that the tests of damage start from.
static SAMPLES: LazyLock<[(&str, Vec<u8>); 4]> = LazyLock::new(|| {
    let mut nodes =
        changed("/nodes", json!([{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [9, 9, 9]}]));
    nodes["bufferViews"][0]["byteStride"] = 12.into();
    [
        ("a.stl", stl(b"solid", &[[A, B, C], [A, C, D]])),
        ("a.stl", QUAD_STL.into()),
        ("a.glb", glb(&nodes, &quad_bytes())),
        ("a.gltf", TEXT.clone().into()),
    ]
});

/// A file without others beside it.
static TEXT: LazyLock<String> =
    LazyLock::new(|| changed("/buffers/0/uri", data_uri(&quad_bytes()).into()).to_string());

#[test]
fn truncation_anywhere_is_an_error() {
    for &(name, ref bytes) in SAMPLES.iter() {
        for length in 0..bytes.len() - 20 {
            let found = read(name, &bytes[..length]).expect_err(name).to_string();
            assert!(found.len() > 20 && found.starts_with(name), "{name} {length}: {found}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn damage_is_no_panic(
        sample in 0usize..4,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
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

    /// Numbers of the structure are where lies are told.
    #[test]
    fn wrong_numbers_are_no_panic(changes in prop::collection::vec((
        any::<prop::sample::Index>(),
        prop::sample::select(vec![
            "0", "1", "2", "3", "12", "255", "4294967295", "9223372036854775807", "18446744073709551615", "-1",
            "1e300", "0.5",
        ]),
    ), 1..4)) {
        let mut parts: Vec<String> = TEXT.split_inclusive(|c: char| !c.is_ascii_digit()).map(str::to_owned).collect();
        for (at, number) in changes {
            let digits: Vec<usize> = (0..parts.len()).filter(|&i| parts[i].len() > 1).collect();
            let at = digits[at.index(digits.len())];
            let end = parts[at].pop().unwrap();
            parts[at] = format!("{number}{end}");
        }
        if let Err(e) = read("a.gltf", parts.concat()) {
            prop_assert!(e.to_string().len() > 20);
        }
    }

    #[test]
    fn word_salad_is_no_panic(words in prop::collection::vec(prop::sample::select(vec![
        "solid", "facet", "normal", "outer loop", "vertex", "endloop", "endfacet", "endsolid", "0", "1.5", "-1e39",
        "nan", "0 0 1", "\n", "\n", "\n", "\r", "\0",
    ]), 0..60)) {
        let _ = read("a.stl", words.join(" "));
    }

}

proptest! {
    // Of some hundred numbers each.
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// What is written is what is read, bit for bit.
    #[test]
    fn stl_round_trips(triangles in prop::collection::vec(
        prop::array::uniform3(prop::array::uniform3((-1e6f32..1e6).prop_map(f64::from))),
        1..20,
    )) {
        let binary = read("a.stl", stl(b"", &triangles)).unwrap();
        prop_assert_eq!(&corners(&binary), &triangles);
        let mut text = "solid\n".to_owned();
        for triangle in &triangles {
            text += "facet normal 0 0 0\nouter loop\n";
            for p in triangle {
                text += &format!("vertex {} {:e} {}\n", p[0], p[1], p[2]);
            }
            text += "endloop\nendfacet\n";
        }
        let text = read("a.stl", text + "endsolid").unwrap();
        prop_assert_eq!(corners(&text), corners(&binary));
        prop_assert_eq!(text.repairs(), binary.repairs());
    }
}
