//! Scenes by name, and the teapot.

use raykd::mesh::{Mesh, MeshError, MeshSource, teapot_level_for};
use std::collections::HashMap;

fn load(name: &str) -> Result<Mesh, MeshError> {
    name.parse::<MeshSource>()?.load()
}

#[test]
fn names_and_paths() {
    for (text, scene) in [
        ("teapot", MeshSource::Teapot(4)),
        ("teapot:100", MeshSource::Teapot(100)),
        ("sponza", MeshSource::Fetched { name: "sponza", file: "sponza.obj" }),
        ("./sponza", MeshSource::File("./sponza".into())),
        ("mesh.ply", MeshSource::File("mesh.ply".into())),
    ] {
        let parsed: MeshSource = text.parse().unwrap();
        assert_eq!(parsed, scene);
        assert_eq!(parsed.to_string(), text);
    }
    assert_eq!("teapot:4".parse::<MeshSource>().unwrap().to_string(), "teapot");
    for text in ["kettle", "teapot:0", "teapot:1001", "teapot:many", ""] {
        let message = text.parse::<MeshSource>().unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("'{text}' is neither a file nor a scene; the scenes are teapot,")),
            "{message}"
        );
        assert!(message.ends_with("dragon, dragon_res2, dragon_res3, dragon_res4, sponza"), "{message}");
    }
    assert!(matches!(load("no/such.obj"), Err(MeshError::Read { .. })));
}

#[test]
fn a_missing_scene_says_what_to_do() {
    let scene = MeshSource::Fetched { name: "dragon", file: "never-fetched.ply.gz" };
    let message = scene.load().unwrap_err().to_string();
    assert!(
        message.starts_with("scene 'dragon' is not here: there is no never-fetched.ply.gz in "),
        "{message}"
    );
    assert!(message.contains("run: cargo xtask scenes"), "{message}");
}

/// The scenes are what docs/scenes.md says, where they have been fetched.
#[test]
fn fetched_scenes() {
    for (name, triangles, kept, duplicates, polygons, concave) in [
        ("dragon", 871_414, 871_306, 0, 0, 0),
        ("dragon_res2", 202_520, 202_520, 30, 0, 0),
        ("dragon_res3", 47_794, 47_794, 77, 0, 0),
        ("dragon_res4", 11_102, 11_102, 39, 0, 0),
        ("sponza", 66_450, 66_444, 0, 26_239, 193),
    ] {
        let mesh = match load(name) {
            Err(error @ MeshError::MissingScene { .. }) => {
                eprintln!("{error}");
                continue;
            }
            mesh => mesh.unwrap(),
        };
        assert_eq!(mesh.triangles().len(), triangles, "{name}");
        assert_eq!(mesh.kept().len(), kept, "{name}");
        assert_eq!((mesh.repairs().duplicates, mesh.repairs().polygons), (duplicates, polygons), "{name}");
        assert_eq!((mesh.repairs().concave, mesh.repairs().crossed), (concave, 0), "{name}");
        assert_eq!((mesh.repairs().flushed, mesh.scale()), (0, 1.0), "{name}");
    }
}

#[test]
fn the_default_teapot() {
    let mesh = load("teapot").unwrap();
    assert_eq!((mesh.triangles().len(), mesh.kept().len()), (1024, 992));
    assert_eq!(mesh.bounds(), ([-16.070_313, -7.875, -10.0], [16.070_313, 7.875, 10.0]));
    assert_eq!((mesh.repairs().duplicates, mesh.repairs().flushed, mesh.scale()), (0, 0, 1.0));
    assert_eq!(mesh.positions().len(), 529);
    // The same bits everywhere: FNV-1a over what the kernels get.
    let positions = mesh.scaled_positions();
    let words = positions.iter().map(|x| x.to_bits()).chain(mesh.triangles().as_flattened().to_vec());
    let digest =
        words.fold(0xcbf2_9ce4_8422_2325u64, |h, w| (h ^ u64::from(w)).wrapping_mul(0x0100_0000_01b3));
    assert_eq!(digest, 0x2e78_476a_f3c6_272f, "{digest:#x}");
}

/// Patches meet without a crack: an edge that only one triangle has lies on one of the rims Newell left open.
#[test]
fn teapot_patches_share_their_seams() {
    for level in [2, 3, 4, 7, 10] {
        let mesh = Mesh::teapot(level);
        assert_eq!(mesh.triangles().len() as u32, 64 * level * level);
        assert_eq!(mesh.repairs().zero_area, 8 * level);
        assert_eq!(teapot_level_for(mesh.kept().len() as u32), level);
        let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
        for &t in mesh.kept() {
            let t = mesh.triangles()[t as usize];
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        // Open: the upper rim and the lid's, 4 patch edges each; both ends of the handle, the root of the spout
        // and its mouth, 2 each.
        let open = edges.values().filter(|&&sides| sides != 0).count() as u32;
        assert_eq!(open, 16 * level, "level {level}");
        // Outside out: the volume that its triangles enclose with the origin is positive.
        let corner = |v: u32| mesh.positions()[v as usize].map(f64::from);
        let volume: f64 = mesh
            .triangles()
            .iter()
            .map(|t| t.map(corner))
            .map(|[a, b, c]| {
                let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
                (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
            })
            .sum();
        assert!((2500.0..3400.0).contains(&volume), "level {level}: {volume}");
    }
}

#[test]
fn teapot_levels_are_clamped() {
    assert_eq!(Mesh::teapot(0).triangles(), Mesh::teapot(1).triangles());
}
