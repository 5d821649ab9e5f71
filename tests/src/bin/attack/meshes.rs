//! Mesh files: right ones in every spelling there is, and broken ones.

use crate::{
    harness::{Case, Good, Judged, holds, raykd, run},
    judge::Reference,
};
use flate2::{Compression, write::GzEncoder};
use raykd::{Hit, Ray};
use std::{fs, io::Write as _, path::Path};

/// What must come of a file.
#[derive(Clone)]
enum Expect {
    /// These triangles.
    Right(Reference),
    /// A message that has these words.
    Refused(&'static [&'static str]),
    /// These triangles, or a message.
    Either(Reference),
    /// A surface above z = 0, met or missed from above at these points; or a message if it says so.
    Points(&'static [([f32; 2], bool)], bool),
    /// A mesh of so many triangles with area, or a message.
    Kept(u64),
    /// Anything but a crash.
    Any,
}
use Expect::{Any, Either, Kept, Points, Refused, Right};

/// A file's name, its bytes, what is expected.
type File = (String, Vec<u8>, Expect);

pub(crate) fn cases() -> Vec<Case> {
    let files = [obj(), polygons(), ply(), ply_spellings(), stl(), gltf(), packed()].concat();
    files
        .into_iter()
        .map(|(name, bytes, expect)| {
            Case::one(format!("mesh/{name}"), move || {
                let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
                fs::write(folder.path().join(&name), &bytes).map_err(|e| e.to_string())?;
                attempt(folder.path(), &name, &expect)
            })
        })
        .collect()
}

fn attempt(folder: &Path, name: &str, expect: &Expect) -> Judged {
    let build = || run(raykd(folder, "build --json --device cpu --threads 1 --").arg(name));
    match expect {
        Right(mesh) => {
            let found = mesh.trace(folder, name)?;
            if found == Good::Right { Ok(found) } else { Err("refused".to_owned()) }
        }
        Either(mesh) => mesh.trace(folder, name),
        Refused(words) => build()?.refused(&[words, &[name][..]].concat()),
        Any => build()?.either(),
        Kept(count) => {
            let ran = build()?;
            if !ran.status.success() {
                return ran.refused(&[name]);
            }
            holds(ran.out.contains(&format!("\"kept\": {count},")), || {
                format!("{count} triangles expected: {}", ran.out)
            })?;
            Ok(Good::Right)
        }
        Points(points, may_refuse) => {
            let rays: Vec<Ray> =
                points.iter().map(|(p, _)| Ray::new([p[0], p[1], 9.0], [0.0, 0.0, -1.0])).collect();
            fs::write(folder.join("rays"), bytemuck::cast_slice::<_, u8>(&rays))
                .map_err(|e| e.to_string())?;
            let ran =
                run(raykd(folder, "trace --rays rays --hits hits --device cpu --threads 1 --").arg(name))?;
            if !ran.status.success() && *may_refuse {
                return ran.refused(&[name]);
            }
            ran.succeeded()?;
            let bytes = fs::read(folder.join("hits")).map_err(|e| e.to_string())?;
            let hits: Vec<Hit> = bytemuck::pod_collect_to_vec(&bytes);
            for ((point, inside), hit) in points.iter().zip(hits) {
                let right = hit.is_hit() == *inside && (!inside || hit.t == 9.0);
                holds(right, || {
                    format!("{point:?} is {}, but {hit:?}", if *inside { "inside" } else { "outside" })
                })?;
            }
            Ok(Good::Right)
        }
    }
}

const V: &str = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\n";
const F: &str = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Names without their ending, and texts.
type Texts = Vec<(&'static str, String)>;

fn files_of<const N: usize>(ending: &str, groups: [(Expect, Texts); N]) -> impl Iterator<Item = File> {
    groups.into_iter().flat_map(move |(expect, texts)| {
        texts
            .into_iter()
            .map(move |(name, text)| (format!("{name}.{ending}"), text.into_bytes(), expect.clone()))
    })
}

fn obj() -> Vec<File> {
    let tetra = Reference::tetra();
    // The last vertex is nobody's corner: where one is lost, indices still name some.
    let whole = format!("{V}v 9 9 9\n{F}");
    let groups = [
        (Right(tetra.clone()), obj_right(&whole)),
        (Either(tetra.clone()), obj_either(&whole)),
        (Refused(&["line 6"]), obj_wrong_faces()),
        (Refused(&["line 2"]), obj_wrong_numbers(&whole)),
        (Refused(&[]), obj_wrong(&whole)),
    ];
    let mut files: Vec<File> = files_of("obj", groups).collect();
    let sixteen: Vec<u8> = format!("\u{feff}{whole}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    files.push(("utf-16.obj".to_owned(), sixteen, Refused(&[])));
    let after = |line: &str| format!("{V}{line}\n{F}").into_bytes();
    files.push(("unknown-word.obj".to_owned(), after("xyzzy 1 2 3"), Refused(&["line", "xyzzy"])));
    files.push(("call.obj".to_owned(), after("call other.obj"), Refused(&["line", "call"])));
    let latin = format!("# caf\u{e9}\n{whole}").chars().map(|c| c as u8).collect();
    files.push(("latin-1.obj".to_owned(), latin, Right(tetra.clone())));
    // The same as whatever it is called.
    for name in ["upper.OBJ", "no-extension", "wörld 🌍.obj", "-dash.obj", "a=b;c&d'e.obj"] {
        files.push((name.to_owned(), whole.clone().into_bytes(), Right(tetra.clone())));
    }
    files.push(("an-obj.ply".to_owned(), whole.into_bytes(), Either(tetra)));
    files
}

/// Right ones.
fn obj_right(whole: &str) -> Texts {
    let v = |from: &str, to: &str| whole.replacen(from, to, 1);
    vec![
        ("plain", whole.to_owned()),
        ("crlf", whole.replace('\n', "\r\n")),
        ("no-last-line-end", whole.trim_end().to_owned()),
        ("tabs", whole.replace(' ', "\t")),
        ("spaces", whole.replace(' ', "   ").replace('\n', "  \n  ")),
        ("blank-lines", whole.replace('\n', "\n\n\n")),
        ("negative", format!("{V}f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n")),
        ("faces-first", format!("{F}{V}")),
        ("mixed-signs", format!("{V}f 1 -2 2\nf 1 2 -1\nf 1 4 -2\nf -3 3 4\n")),
        ("texture", format!("{V}vt 0 0\nf 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n")),
        (
            "normals",
            format!("{V}vn 0 0 1\nf 1//1 3//1 2//1\nf 1//1 2//1 4//1\nf 1//1 4//1 3//1\nf 2//1 3//1 4//1\n"),
        ),
        ("both", format!("{V}vt 0 0\nvn 0 0 1\n{}", F.replace("f 1", "f 1/1/1").replace(" 2", " 2/1/1"))),
        ("bad-normals", format!("{V}vn nan inf x\nvt\n{F}")),
        ("colours", whole.replace("0 0 0\n", "0 0 0 1 0.5 0\n")),
        ("weights", V.replace('\n', " 1.0\n") + F),
        ("materials", format!("mtllib none.mtl\no a b\ng x y z\ns off\nusemtl none\n{whole}")),
        ("points-and-lines", format!("{V}p 1 2\nl 1 2 3\n{F}")),
        ("exponents", v("4 0 0", "4e0 0E-3 +0.0e+2")),
        ("dots", v("4 0 0", "4. .0 -.0")),
        ("long-numbers", v("4 0 0", &format!("4.{} 0 0", "0".repeat(5000)))),
        ("comments", whole.replace('\n', " # 9 9 9\n")),
        ("comment-lines", whole.replace('\n', "\n# v 1 2 3 f 1 2 3\n")),
        ("long-comment", format!("#{}\n{whole}", "x".repeat(3_000_000))),
        ("nul-in-comment", format!("# \0\0\n{whole}")),
        ("joined-face", v("f 1 3 2", "f 1 \\\n3 \\\n2")),
        ("joined-vertex", v("v 4 0 0", "v 4 \\\r\n0 0")),
        ("many-blank-lines", format!("{V}{}{F}", "\n".repeat(1_000_000))),
    ]
}

/// Ones that may be taken for right.
fn obj_either(whole: &str) -> Texts {
    let v = |from: &str, to: &str| whole.replacen(from, to, 1);
    vec![
        ("byte-order-mark", format!("\u{feff}{whole}")),
        ("comment-backslash", format!("# a path c:\\\n{whole}")),
        ("end-comment-backslash", v("v 4 0 0\n", "v 4 0 0 # \\\n")),
        ("lone-returns", whole.replace('\n', "\r")),
        ("return-in-line", v("v 4 0 0", "v 4\r0 0")),
        ("return-between", v("v 4 0 0\n", "v 4 0 0\r")),
        ("vertical-tab", whole.replace("v ", "v\u{b}")),
        ("form-feed", whole.replace("v ", "v\u{c}")),
        ("no-break-space", whole.replace("v ", "v\u{a0}")),
        ("no-break-space-inside", v("v 4 0 0", "v 4\u{a0}0 0")),
        ("zero-width-space", v("v 4 0 0", "\u{200b}v 4 0 0")),
        ("line-separator", v("v 4 0 0\n", "v 4 0 0\u{2028}")),
        ("upper-case", whole.to_uppercase()),
        ("backslash-space", v("f 1 3 2", "f 1 3 \\ \n2")),
        ("backslash-at-end", format!("{}\\", whole.trim_end())),
        ("four-slashes", v("f 1 3 2", "f 1/1/1/1 3 2")),
        ("trailing-word", v("f 1 3 2", "f 1 3 2 x")),
        ("nul-in-line", v("v 4 0 0", "v 4 0 0\0")),
        ("escape", v("v 4 0 0", "v 4 0 0\u{1b}[2J")),
    ]
}

/// Wrong in line 6.
fn obj_wrong_faces() -> Texts {
    let index = |i: &str| format!("{V}f 1 3 2\nf 1 2 {i}\n");
    vec![
        ("index-zero", index("0")),
        ("index-past", index("5")),
        ("index-before", index("-5")),
        ("index-2-31", index("2147483648")),
        ("index-2-32", index("4294967299")),
        ("index-2-63", index("9223372036854775808")),
        ("index-below", index("-9223372036854775808")),
        ("index-huge", index(&"9".repeat(5000))),
        ("index-float", index("4.0")),
        ("index-word", index("x")),
        ("index-empty", index("/1")),
        ("two-corners", format!("{V}f 1 3 2\nf 1 2\n")),
        ("one-corner", format!("{V}f 1 3 2\nf 1\n")),
        ("no-corner", format!("{V}f 1 3 2\nf\n")),
    ]
}

/// Wrong in line 2.
fn obj_wrong_numbers(whole: &str) -> Texts {
    let v = |from: &str, to: &str| whole.replacen(from, to, 1);
    let number = |x: &str| v("v 4 0 0", &format!("v 4 {x} 0"));
    vec![
        ("nan", number("nan")),
        ("infinite", number("-inf")),
        ("too-large", number("1e39")),
        ("too-large-double", number("1e400")),
        ("comma", number("0,5")),
        ("hexadecimal", number("0x1p3")),
        ("word", number("x")),
        ("many-digits-word", number(&format!("{}x", "1".repeat(100_000)))),
        ("fortran", number("1d3")),
        ("two-numbers", v("v 4 0 0", "v 4 0")),
        ("no-numbers", v("v 4 0 0", "v")),
        ("commas", v("v 4 0 0", "v 4,0,0")),
    ]
}

/// Wrong as a whole.
fn obj_wrong(whole: &str) -> Texts {
    vec![
        ("empty", String::new()),
        ("comment-only", "# nothing\n".to_owned()),
        ("vertices-only", V.to_owned()),
        ("faces-only", F.to_owned()),
        ("page", "<!DOCTYPE html><html><body>404</body></html>".to_owned()),
        ("nuls", "\0".repeat(5000)),
        ("one-backslash", "\\".to_owned()),
        ("tiny", whole.replace('4', "1e-42")),
    ]
}

fn polygons() -> Vec<File> {
    let polygon = |corners: &[[f32; 2]]| {
        let mut text: String = corners.iter().map(|[x, y]| format!("v {x} {y} 0\n")).collect();
        let all: Vec<String> = (1..=corners.len()).map(|i| i.to_string()).collect();
        text += &format!("f {}\n", all.join(" "));
        text
    };
    let file = |name: &str, text: String, expect: Expect| (format!("{name}.obj"), text.into_bytes(), expect);
    let arrow = [[0.0, 0.0], [4.0, 4.0], [0.0, 2.0], [-4.0, 4.0]];
    let arrow_points = Points(
        &[
            ([0.0, 1.0], true),
            ([0.0, 3.0], false),
            ([2.0, 2.5], true),
            ([-2.0, 2.5], true),
            ([0.0, 5.0], false),
        ],
        false,
    );
    let mut files = Vec::new();
    // Any corner may come first, either way round.
    for turn in 0..4 {
        let mut corners = arrow;
        corners.rotate_left(turn);
        files.push(file(&format!("arrow-{turn}"), polygon(&corners), arrow_points.clone()));
        corners.reverse();
        files.push(file(&format!("arrow-back-{turn}"), polygon(&corners), arrow_points.clone()));
    }
    let ell = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]];
    let ell_points =
        Points(&[([3.0, 0.5], true), ([0.5, 3.0], true), ([2.0, 2.0], false), ([1.25, 1.25], false)], false);
    for turn in 0..6 {
        let mut corners = ell;
        corners.rotate_left(turn);
        files.push(file(&format!("ell-{turn}"), polygon(&corners), ell_points.clone()));
    }
    // A comb of teeth, each 1 wide, 1 apart.
    let mut comb: Vec<[f32; 2]> = vec![[0.0, -1.0]];
    comb.push([99.0, -1.0]);
    for tooth in (0..50).rev() {
        let x = 2.0 * tooth as f32;
        comb.extend([[x + 1.0, 0.0], [x + 1.0, 5.0], [x, 5.0], [x, 0.0]]);
    }
    let comb_points = Points(
        &[
            ([0.5, 4.0], true),
            ([1.5, 4.0], false),
            ([1.5, -0.5], true),
            ([98.5, 2.0], true),
            ([51.5, 0.5], false),
        ],
        false,
    );
    files.push(file("comb", polygon(&comb), comb_points));
    let twice = [[0.0, 0.0], [4.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 4.0], [0.0, 4.0], [0.0, 0.0]];
    files.push(file(
        "corners-twice",
        polygon(&twice),
        Points(&[([1.0, 1.0], true), ([3.0, 3.5], true), ([5.0, 1.0], false)], false),
    ));
    let many: Vec<[f32; 2]> = (0..20_000)
        .map(|i| (f64::from(i) * 0.000_314_159_265).sin_cos())
        .map(|(y, x)| [x as f32, y as f32])
        .collect();
    files.push(file(
        "round",
        polygon(&many),
        Points(&[([0.1, 0.2], true), ([0.9, 0.9], false), ([-0.5, 0.1], true)], true),
    ));
    let bow = [[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]];
    files.push(file("bow-tie", polygon(&bow), Any));
    files.push(file("line-polygon", polygon(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]), Any));
    files.push(file("saddle", "v 0 0 0\nv 4 0 1\nv 4 4 0\nv 0 4 1\nf 1 2 3 4\n".to_owned(), Any));
    files.push(file("one-point", format!("v 1 1 1\nf{}\n", " 1".repeat(1000)), Any));
    files
}

/// A number as PLY has it.
fn number(kind: &str, x: f64, format: &str) -> Vec<u8> {
    let mut bytes = match kind {
        "char" => (x as i8).to_le_bytes().to_vec(),
        "uchar" => (x as u8).to_le_bytes().to_vec(),
        "short" => (x as i16).to_le_bytes().to_vec(),
        "ushort" => (x as u16).to_le_bytes().to_vec(),
        "int" => (x as i32).to_le_bytes().to_vec(),
        "uint" => (x as u32).to_le_bytes().to_vec(),
        "float" => (x as f32).to_le_bytes().to_vec(),
        _ => x.to_le_bytes().to_vec(),
    };
    match format {
        "ascii" => format!("{x} ").into_bytes(),
        "binary_big_endian" => {
            bytes.reverse();
            bytes
        }
        _ => bytes,
    }
}

const SHAPE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
const FACES: [[f64; 3]; 4] = [[0.0, 2.0, 1.0], [0.0, 1.0, 3.0], [0.0, 3.0, 2.0], [1.0, 2.0, 3.0]];

/// The tetrahedron with numbers of these kinds.
fn tetra_ply(format: &str, coordinate: &str, count: &str, index: &str, points: &[[f64; 3]]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty {coordinate} x\nproperty {coordinate} y\n\
         property {coordinate} z\nelement face 4\nproperty list {count} {index} vertex_indices\nend_header\n",
        points.len()
    )
    .into_bytes();
    let end = |bytes: &mut Vec<u8>| bytes.extend(if format == "ascii" { &b"\n"[..] } else { b"" });
    for point in points {
        point.iter().for_each(|&x| bytes.extend(number(coordinate, x, format)));
        end(&mut bytes);
    }
    for face in FACES {
        bytes.extend(number(count, 3.0, format));
        face.iter().for_each(|&x| bytes.extend(number(index, x, format)));
        end(&mut bytes);
    }
    bytes
}

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];
const WHOLE: [&str; 6] = ["char", "uchar", "short", "ushort", "int", "uint"];

/// Every kind of number in every place, in every format, whole and cut short.
fn ply() -> Vec<File> {
    let tetra = Reference::tetra();
    let mut files = Vec::new();
    let mut add =
        |name: String, bytes: Vec<u8>, expect: &Expect| files.push((name + ".ply", bytes, expect.clone()));
    for format in FORMATS {
        for kind in WHOLE.into_iter().chain(["float", "double"]) {
            add(
                format!("{format}-{kind}"),
                tetra_ply(format, kind, "uchar", "int", &SHAPE),
                &Right(tetra.clone()),
            );
        }
        for kind in WHOLE {
            add(
                format!("{format}-index-{kind}"),
                tetra_ply(format, "float", "uchar", kind, &SHAPE),
                &Right(tetra.clone()),
            );
            add(
                format!("{format}-count-{kind}"),
                tetra_ply(format, "float", kind, "int", &SHAPE),
                &Right(tetra.clone()),
            );
        }
        for kind in ["float", "double"] {
            add(
                format!("{format}-float-index-{kind}"),
                tetra_ply(format, "float", "uchar", kind, &SHAPE),
                &Either(tetra.clone()),
            );
            let far: Vec<[f64; 3]> = SHAPE.iter().map(|p| p.map(|x| x * 0.0025 + 4.5e6)).collect();
            // As floats it has no area at all, and says so; as doubles it is a tetrahedron.
            let kept = if kind == "float" { 0 } else { 4 };
            add(
                format!("{format}-far-{kind}"),
                tetra_ply(format, kind, "uchar", "int", &far),
                &if format == "ascii" && kind == "float" { Any } else { Kept(kept) },
            );
        }
        let whole = tetra_ply(format, "float", "uchar", "int", &SHAPE);
        for cut in [3, 4, 20, 40, 60] {
            let end = if format == "ascii" { whole.len() - 1 - cut } else { whole.len() - cut };
            add(format!("{format}-cut-{cut}"), whole[..end].to_vec(), &Refused(&[]));
        }
        for at in (0..whole.len()).step_by(7) {
            let mut other = whole.clone();
            other[at] ^= 0x55;
            add(format!("{format}-changed-{at}"), other, &Any);
        }
        let mut nan = SHAPE.to_vec();
        nan[1][0] = f64::NAN;
        if format != "ascii" {
            add(
                format!("{format}-nan"),
                tetra_ply(format, "float", "uchar", "int", &nan),
                &Refused(&["vertex 1"]),
            );
        }
        nan[1][0] = 1e39;
        add(format!("{format}-large"), tetra_ply(format, "double", "uchar", "int", &nan), &Any);
    }
    files
}

const VERTEX: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
const FACE: &str = "element face 4\nproperty list uchar int vertex_indices\n";
const POINTS: &str = "0 0 0\n4 0 0\n0 4 0\n0 0 4\n";
const CORNERS: &str = "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

fn text_ply(header: &str, body: &str) -> String {
    format!("ply\nformat ascii 1.0\n{header}end_header\n{body}")
}

/// Headers and text.
fn ply_spellings() -> Vec<File> {
    let tetra = Reference::tetra();
    let whole = text_ply(&format!("{VERTEX}{FACE}"), &format!("{POINTS}{CORNERS}"));
    let named = [("no-extension-ply", Right(tetra.clone())), ("ply-in.obj", Either(tetra.clone()))];
    let named = named.map(|(name, expect)| (name.to_owned(), whole.clone().into_bytes(), expect));
    let groups = [
        (Right(tetra.clone()), ply_right(&whole)),
        (Either(tetra), ply_either(&whole)),
        (Refused(&[]), ply_refused(&whole)),
    ];
    files_of("ply", groups).chain(named).collect()
}

/// Right ones.
fn ply_right(whole: &str) -> Texts {
    let listed = |name, header: &str, body: &str| (name, text_ply(header, body));
    vec![
        ("plain", whole.to_owned()),
        ("crlf", whole.replace('\n', "\r\n")),
        ("vertex-index", whole.replace("vertex_indices", "vertex_index")),
        ("comments", whole.replace("end_header", "comment end_header here\nobj_info x\nend_header")),
        ("dots", whole.replace("\n4 0 0", "\n4. .0 -.0")),
        listed(
            "zyx",
            &format!("{}{FACE}", VERTEX.replace("x\n", "w\n").replace("z\n", "x\n").replace("w\n", "z\n")),
            &format!("0 0 0\n0 0 4\n0 4 0\n4 0 0\n{CORNERS}"),
        ),
        listed(
            "more-properties",
            &format!(
                "element vertex 4\nproperty uchar red\nproperty float x\nproperty list uchar float more\nproperty float y\nproperty float z\nproperty double q\n{FACE}property uchar flags\n"
            ),
            "1 0 2 8 9 0 0 7\n1 4 0 0 0 7\n1 0 1 5 4 0 7\n1 0 0 0 4 7\n3 0 2 1 9\n3 0 1 3 9\n3 0 3 2 9\n3 1 2 3 9\n",
        ),
        listed(
            "other-elements",
            &format!(
                "element camera 1\nproperty float f\n{VERTEX}element edge 1\nproperty int a\nproperty list uchar int b\n{FACE}element last 1\nproperty float q\n"
            ),
            &format!("5\n{POINTS}1 2 8 8\n{CORNERS}7\n"),
        ),
        listed("faces-first", &format!("{FACE}{VERTEX}"), &format!("{CORNERS}{POINTS}")),
        ("blank-lines", whole.replace("\n0 4 0", "\n\n\n0 4 0")),
        ("spaces", whole.replace("\n4 0 0", "\n  4\t 0   0  ")),
        ("no-last-line-end", whole.trim_end().to_owned()),
        ("returns", whole.replace('\n', "\r")),
    ]
}

/// Ones that may be taken for right.
fn ply_either(whole: &str) -> Texts {
    let listed = |name, header: &str, body: &str| (name, text_ply(header, body));
    vec![
        ("byte-order-mark", format!("\u{feff}{whole}")),
        ("line-numbers", whole.replace("float", "float32").replace("uchar int", "uint8 int32")),
        listed(
            "two-face-elements",
            &format!(
                "{VERTEX}element face 2\nproperty list uchar int vertex_indices\nelement face 2\nproperty list uchar int vertex_indices\n"
            ),
            &format!("{POINTS}{CORNERS}"),
        ),
        listed(
            "two-vertex-elements",
            &format!(
                "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n{}{FACE}",
                VERTEX.replace('4', "2")
            ),
            &format!("{POINTS}{CORNERS}"),
        ),
        listed(
            "duplicate-property",
            &format!(
                "element vertex 4\nproperty float x\nproperty float x\nproperty float y\nproperty float z\n{FACE}"
            ),
            &format!("0 0 0 0\n4 4 0 0\n0 0 4 0\n0 0 0 4\n{CORNERS}"),
        ),
        ("more-words", whole.replace("\n4 0 0", "\n4 0 0 9")),
        ("more-face-words", whole.replace("3 0 1 3", "3 0 1 3 2")),
        ("more-lines", format!("{whole}1 2 3\n")),
        ("one-line", text_ply(&format!("{VERTEX}{FACE}"), &format!("{POINTS}{CORNERS}").replace('\n', " "))),
        listed(
            "strips",
            &format!("{VERTEX}element tristrips 1\nproperty list int int vertex_indices\n"),
            &format!("{POINTS}14 0 2 1 -1 0 1 3 -1 0 3 2 -1 1 2\n"),
        ),
        listed(
            "whole-strips",
            &format!("{VERTEX}element tristrips 1\nproperty list int int vertex_indices\n"),
            &format!("{POINTS}15 0 2 1 -1 0 1 3 -1 0 3 2 -1 1 2 3\n"),
        ),
        ("version-2", whole.replace("ascii 1.0", "ascii 2.0")),
        ("upper-case", whole.to_uppercase()),
    ]
}

/// Wrong ones.
fn ply_refused(whole: &str) -> Texts {
    vec![
        ("index-past", whole.replace("3 1 2 3", "3 1 2 4")),
        ("index-before", whole.replace("3 1 2 3", "3 1 2 -1")),
        ("index-float", whole.replace("3 1 2 3", "3 1 2 2.5")),
        ("index-huge", whole.replace("3 1 2 3", "3 1 2 99999999999999999999")),
        ("count-2", whole.replace("3 1 2 3", "2 1 2")),
        ("count-0", whole.replace("3 1 2 3", "0")),
        ("count-negative", whole.replace("3 1 2 3", "-3 1 2 3")),
        ("count-huge", whole.replace("3 1 2 3", "4000000000 1 2 3")),
        ("too-few", whole.replace("3 1 2 3", "4 1 2 3")),
        ("nan", whole.replace("\n4 0 0", "\n4 nan 0")),
        ("word", whole.replace("\n4 0 0", "\n4 x 0")),
        ("two-numbers", whole.replace("\n4 0 0", "\n4 0")),
        ("more-vertices", whole.replace("vertex 4", "vertex 5")),
        ("fewer-vertices", whole.replace("vertex 4", "vertex 3")),
        ("more-faces", whole.replace("face 4", "face 5")),
        ("all-vertices", whole.replace("vertex 4", "vertex 18446744073709551615")),
        ("all-faces", whole.replace("face 4", "face 4294967295")),
        ("negative-vertices", whole.replace("vertex 4", "vertex -4")),
        ("no-z", whole.replace("property float z\n", "")),
        ("no-end", whole.replace("end_header\n", "")),
        ("no-format", whole.replace("format ascii 1.0\n", "")),
        ("ebcdic", whole.replace("ascii", "ebcdic")),
        ("no-faces", text_ply(VERTEX, POINTS)),
        ("empty", String::new()),
        ("magic-only", "ply\n".to_owned()),
        ("quad", whole.replace("list uchar int", "list uchar quad")),
        ("list-x", whole.replace("float x", "list uchar float x")),
        ("long-name", whole.replace("property float x", &format!("property {} x", "n".repeat(100_000)))),
    ]
}

/// The tetrahedron as STL has it.
fn stl() -> Vec<File> {
    let tetra = Reference::tetra();
    let corners: Vec<[[f32; 3]; 3]> =
        tetra.triangles().iter().map(|t| t.map(|v| tetra.positions()[v as usize])).collect();
    let binary = |header: &str, count: u32, x: f32| {
        let mut bytes = format!("{header:80}").into_bytes();
        bytes.extend(count.to_le_bytes());
        for triangle in &corners {
            bytes.extend([0; 12]);
            triangle.iter().flatten().for_each(|&y| bytes.extend((y * x).to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    };
    let mut ascii = "solid a b\n".to_owned();
    for triangle in &corners {
        ascii += "facet normal 0 0 0\nouter loop\n";
        triangle.iter().for_each(|[x, y, z]| ascii += &format!("vertex {x} {y} {z}\n"));
        ascii += "endloop\nendfacet\n";
    }
    ascii += "endsolid a b\n";
    let whole = binary("raykd", 4, 1.0);
    let file = |name: &str, bytes: &[u8], expect: Expect| (format!("{name}.stl"), bytes.to_vec(), expect);
    vec![
        file("binary", &whole, Right(tetra.clone())),
        file("binary-solid", &binary("solid not text", 4, 1.0), Right(tetra.clone())),
        file("ascii", ascii.as_bytes(), Right(tetra.clone())),
        file("ascii-crlf", ascii.replace('\n', "\r\n").as_bytes(), Right(tetra.clone())),
        file("ascii-indented", ascii.replace('\n', "\n   ").as_bytes(), Right(tetra.clone())),
        file("ascii-upper", ascii.to_uppercase().as_bytes(), Either(tetra.clone())),
        file("binary-more-bytes", &[&whole[..], &[0; 3]].concat(), Either(tetra)),
        file("binary-more-counted", &binary("x", 5, 1.0), Refused(&[])),
        file("binary-all-counted", &binary("x", u32::MAX, 1.0), Refused(&[])),
        file("binary-none", &binary("x", 0, 1.0)[..84], Refused(&[])),
        file("binary-nan", &binary("x", 4, f32::NAN), Refused(&[])),
        file("binary-cut", &whole[..200], Refused(&[])),
        file("binary-short", &whole[..50], Refused(&[])),
        file("ascii-cut", &ascii.as_bytes()[..ascii.len() / 2], Refused(&[])),
        file("ascii-word", ascii.replacen("vertex 0 4 0", "vertex 0 four 0", 1).as_bytes(), Refused(&[])),
        file("ascii-two-corners", ascii.replacen("vertex 0 4 0\n", "", 1).as_bytes(), Refused(&[])),
        file("empty", b"", Refused(&[])),
    ]
}

/// The tetrahedron as glTF has it, moved by its node.
fn gltf() -> Vec<File> {
    let tetra = Reference::tetra();
    let mut data = Vec::new();
    tetra.positions().iter().flatten().for_each(|x| data.extend(x.to_le_bytes()));
    tetra.triangles().iter().flatten().for_each(|&v| data.extend((v as u16).to_le_bytes()));
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"children":[1],"translation":[10,0,0]},{"mesh":0,"translation":[0,5,0]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[4,4,4]},
        {"bufferView":1,"componentType":5123,"count":12,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":24}],
        "buffers":[{"byteLength":72}]}"#;
    let glb = |json: &str, data: &[u8]| {
        let mut json = json.as_bytes().to_vec();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF".to_vec();
        let total = 12 + 8 + json.len() + 8 + data.len();
        bytes.extend([2, total as u32, json.len() as u32].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend(b"JSON");
        bytes.extend(&json);
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(data);
        bytes
    };
    let moved = tetra.moved([10.0, 5.0, 0.0]);
    let file = |name: &str, bytes: Vec<u8>, expect: Expect| (format!("{name}.glb"), bytes, expect);
    let with = |from: &str, to: &str| glb(&json.replacen(from, to, 1), &data);
    let whole = glb(json, &data);
    let required = r#""extensionsRequired":["KHR_draco_mesh_compression"],"extensionsUsed":["KHR_draco_mesh_compression"],"asset""#;
    let text = json.replace(r#"{"byteLength":72}"#, r#"{"byteLength":72,"uri":"../../../../etc/passwd"}"#);
    vec![
        file("moved", whole.clone(), Right(moved.clone())),
        file(
            "scaled",
            with(r#""translation":[0,5,0]"#, r#""scale":[1,1,1],"rotation":[0,0,0,1],"translation":[0,5,0]"#),
            Right(moved.clone()),
        ),
        file(
            "matrix",
            with(r#""translation":[0,5,0]"#, r#""matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,5,0,1]"#),
            Right(moved.clone()),
        ),
        file("draco", with(r#""asset""#, required), Refused(&["KHR_draco_mesh_compression"])),
        file("index-past", with(r#""count":4"#, r#""count":3"#), Refused(&[])),
        file("accessor-past", with(r#""count":12"#, r#""count":1200000000"#), Refused(&[])),
        file("view-past", with(r#""byteOffset":48"#, r#""byteOffset":4294967295"#), Refused(&[])),
        file("no-such-accessor", with(r#""indices":1"#, r#""indices":99"#), Refused(&[])),
        file("no-such-mesh", with(r#""mesh":0"#, r#""mesh":7"#), Refused(&[])),
        file("ring", with(r#""mesh":0,"#, r#""mesh":0,"children":[0],"#), Either(moved)),
        file("no-nodes", with(r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[]}]"#), Refused(&[])),
        file("points", with(r#""indices":1"#, r#""mode":0"#), Refused(&[])),
        file("infinite", with("[0,5,0]", "[0,1e39,0]"), Refused(&[])),
        file("cut", whole[..whole.len() - 30].to_vec(), Refused(&[])),
        file("head-only", whole[..12].to_vec(), Refused(&[])),
        file("no-json", glb("[]", &data), Refused(&[])),
        file("deep", glb(&"[".repeat(100_000), &data), Refused(&[])),
        ("elsewhere.gltf".to_owned(), text.into_bytes(), Refused(&[])),
        ("version-1.gltf".to_owned(), br#"{"asset":{"version":"1.0"}}"#.to_vec(), Refused(&[])),
    ]
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("memory takes it")
}

fn packed() -> Vec<File> {
    let tetra = Reference::tetra();
    let whole = format!("{V}{F}").into_bytes();
    let zipped = gzip(&whole);
    let mut other = zipped.clone();
    let end = other.len() - 6;
    other[end] ^= 1;
    let file = |name: &str, bytes: Vec<u8>, expect: Expect| (name.to_owned(), bytes, expect);
    let mut files = vec![
        file("plain.obj.gz", zipped.clone(), Right(tetra.clone())),
        file("hidden.obj", zipped.clone(), Right(tetra.clone())),
        file("no-ending", zipped.clone(), Right(tetra.clone())),
        file(
            "members.obj.gz",
            [gzip(V.as_bytes()), gzip(b""), gzip(F.as_bytes())].concat(),
            Right(tetra.clone()),
        ),
        file("zeros.obj.gz", [&zipped[..], &[0; 512]].concat(), Right(tetra.clone())),
        file("twice.obj.gz", gzip(&zipped), Either(tetra.clone())),
        file("behind.obj.gz", [&zipped[..], b"garbage"].concat(), Either(tetra)),
        file("checksum.obj.gz", other, Refused(&[])),
        file("nothing.obj.gz", gzip(b""), Refused(&[])),
        file("empty.obj.gz", Vec::new(), Refused(&[])),
        file("no-gzip.obj.gz", whole, Refused(&[])),
    ];
    for cut in [1, 5, 9, 20, 40] {
        files.push(file(&format!("cut-{cut}.obj.gz"), zipped[..zipped.len() - cut].to_vec(), Refused(&[])));
    }
    files
}
