//! Scenes in files: what is opened is what was saved, on every device; damage is told; processes share the memory.

use proptest::prelude::*;
use raykd::{
    BuildOptions, Builder, Device, Intersector, KdTree, Mesh, Query, Ray, Scene, Traversal,
    shared::{LAYOUT_VERSION, Node, TreeHeader, TreeView},
};
use raykd_tests::{
    Failure, built_from, cases, cpu, devices,
    meshes::{Family, Recipe},
    rays::rays,
};
use sha2::{Digest as _, Sha256};
use std::{
    fs,
    ops::Range,
    path::{Path, PathBuf},
    sync::LazyLock,
};
use tempfile::TempDir;

/// A folder of the test's own, and a file in it.
fn place() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scene");
    (folder, path)
}

fn build(device: &Device, mesh: &Mesh, builder: Builder) -> Scene {
    Scene::build(device, mesh, &BuildOptions::default().with_builder(builder)).unwrap()
}

/// A small scene's file.
fn teapot() -> Vec<u8> {
    static FILE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let (_folder, path) = place();
        build(cpu(), &Mesh::teapot(2), Builder::Binned).save(&path).unwrap();
        fs::read(path).unwrap()
    });
    FILE.clone()
}

/// What opening these bytes as a file says.
fn open(bytes: &[u8]) -> Result<Scene, String> {
    let (_folder, path) = place();
    fs::write(&path, bytes).unwrap();
    Scene::open(cpu(), &path).map_err(|error| error.to_string())
}

/// A file of a test's own, mapped.
fn open_mapped(device: &Device, path: &Path) -> Result<Scene, raykd::Error> {
    // SAFETY: tests replace files, and do not change them.
    unsafe { Scene::open_mapped(device, path) }
}

/// The message that such a file is refused with.
fn refusal(bytes: &[u8]) -> String {
    open(bytes).expect_err("it is refused")
}

/// Where the six sections lie, by the documented format.
fn sections(file: &[u8]) -> [Range<usize>; 6] {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let header: TreeHeader = bytemuck::pod_read_unaligned(&file[40..104]);
    let [nodes, refs, triangles] = [header.nodes, header.refs, header.triangles].map(|count| count as usize);
    let mut begin = 4096;
    [8 * nodes, 4 * refs, 48 * refs, 12 * word(104), 12 * triangles, 4 * word(108)].map(|bytes| {
        let section = begin..begin + bytes;
        begin = section.end.max(begin + 1).next_multiple_of(4096);
        section
    })
}

/// The file with the checksum of what it now holds.
fn resealed(mut file: Vec<u8>) -> Vec<u8> {
    let end = file.len() - 32;
    let sum = Sha256::digest(&file[..end]);
    file[end..].copy_from_slice(&sum);
    file
}

/// All that a scene answers, by name.
fn answers(scene: &Scene, rays: &[Ray]) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    fn bytes<T: bytemuck::NoUninit>(all: &[T]) -> Vec<u8> {
        bytemuck::cast_slice(all).to_vec()
    }
    let mut all = Vec::new();
    let mut add = |what: String, found: Vec<u8>| all.push((what, found));
    let found = scene.all(rays, 3)?;
    add("all hits".to_owned(), bytes(&found.hits));
    add("numbers of hits".to_owned(), bytes(&found.totals));
    add("crossings".to_owned(), bytes(&scene.crossings(rays)?.counts));
    add("hits of all triangles".to_owned(), bytes(&scene.brute(rays)?));
    let tracer = scene.tracer()?;
    let single: Vec<_> = rays.iter().map(|ray| tracer.closest(ray).unwrap_or(raykd::Hit::NONE)).collect();
    add("hits one by one".to_owned(), bytes(&single));
    let ways = Traversal::ALL.iter().copied().map(|traversal| (traversal, Intersector::default()));
    let tests = Intersector::ALL.iter().copied().map(|test| (Traversal::default(), test));
    for (traversal, test) in ways.into_iter().chain(tests) {
        let mut own = scene.clone();
        own.traverse_by(traversal)?;
        own.intersect_by(test)?;
        for query in [Query::Closest, Query::Any] {
            add(format!("{query:?} by {traversal} and {test}"), bytes(&own.trace(query, rays)?.hits));
        }
    }
    Ok(all)
}

/// Meshes with and without triangles in the tree, and one that is moved and scaled.
fn meshes() -> Vec<Mesh> {
    let family = |family, size| Recipe { family, size, seed: 3 }.mesh();
    let far =
        [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0; 3]].map(|p| p.map(|x| 1e7 + x * 1e-4));
    let far = Mesh::from_f64(far.to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
    assert!(far.translation() != [0.0; 3] && far.scale() != 1.0);
    vec![Mesh::teapot(2), family(Family::Holes, 100), family(Family::Nothing, 3), far]
}

#[test]
fn what_is_opened_is_what_was_saved() {
    for (number, mesh) in meshes().iter().enumerate() {
        for &builder in Builder::ALL {
            let mut first: Option<Vec<u8>> = None;
            for named in devices() {
                let what = format!("mesh {number}, {builder}, {}", named.name);
                let (_folder, path) = place();
                let built = build(&named.device, mesh, builder);
                built.save(&path).unwrap();
                let file = fs::read(&path).unwrap();
                assert!(*first.get_or_insert_with(|| file.clone()) == file, "{what}: another file");

                let tree = built.tree().unwrap();
                let mut some = rays(mesh, tree.view(), 200, 5);
                some.extend(raykd::rays::random(mesh.bounds(), 200, 6));
                let expected = answers(&built, &some).unwrap();
                for open in [Scene::open, open_mapped] {
                    let opened = open(&named.device, &path).unwrap();
                    assert_eq!(opened.header(), built.header(), "{what}");
                    assert!(tree == opened.tree().unwrap(), "{what}: another tree");
                    for ((of, expected), (_, found)) in expected.iter().zip(answers(&opened, &some).unwrap())
                    {
                        assert!(*expected == found, "{what}: {of} differ");
                    }
                    let same = opened.mesh().unwrap();
                    assert_eq!(same.tree_key(), mesh.tree_key(), "{what}: another mesh");
                    assert_eq!((same.bounds(), same.kept()), (mesh.bounds(), mesh.kept()), "{what}");

                    let again = path.with_extension("again");
                    opened.save(&again).unwrap();
                    assert!(fs::read(&again).unwrap() == file, "{what}: saved again, another file");
                }
            }
        }
    }
}

/// The rays that the test above compares do hit.
#[test]
fn rays_hit_what_there_is() {
    for mesh in meshes() {
        let scene = build(cpu(), &mesh, Builder::Binned);
        let rays = raykd::rays::random(mesh.bounds(), 200, 6);
        let hits = scene.closest(&rays).unwrap().iter().filter(|hit| hit.is_hit()).count();
        assert!(hits > 0 || mesh.kept().is_empty(), "{hits} hits of {} triangles", mesh.kept().len());
    }
}

/// What is in memory is what is in the file, and what a traversal and a triangle test need beside it.
#[test]
fn memory_is_counted() {
    let file = teapot();
    let mut scene = open(&file).unwrap();
    let rounded = |section: &Range<usize>| (section.end - section.start).next_multiple_of(16) as u64;
    let expected = 64 + sections(&file).iter().map(rounded).sum::<u64>();
    assert_eq!(scene.bytes_on_device(), expected);
    let (tree, refs) = (scene.tree_bytes(), u64::from(scene.header().refs));
    scene.intersect_by(Intersector::Baldwin).unwrap();
    assert_eq!(scene.bytes_on_device(), expected + 48 * refs);
    scene.intersect_by(Intersector::Strict).unwrap();
    scene.traverse_by(Traversal::Ropes).unwrap();
    assert_eq!(scene.bytes_on_device(), expected + 48 * refs + scene.tree_bytes() - tree);
    let built = build(cpu(), &Mesh::teapot(2), Builder::Binned);
    assert_eq!(built.bytes_on_device(), expected - rounded(&sections(&file)[5]));
}

/// A GPU keeps what was on its way until something is run there.
#[test]
fn what_is_never_traced_leaves_no_memory() -> Result<(), Failure> {
    let device = Device::gpu(None)?;
    let (of_wgpu, _) = device.wgpu().expect("a GPU");
    let taken = || of_wgpu.generate_allocator_report().expect("Vulkan has one").total_allocated_bytes >> 20;
    let (_folder, path) = place();
    build(cpu(), &Mesh::teapot(10), Builder::Binned).save(&path)?;
    let scene = Scene::open(&device, &path)?;
    let begin = taken();
    for _ in 0..40 {
        Scene::open(&device, &path)?;
    }
    let opened = taken();
    // A scene takes 0.9 MiB, these rays 2 MiB and 0.9 on their way.
    let rays = vec![Ray::new([0.0; 3], [1.0; 3]); 30_000];
    for _ in 0..40 {
        scene.resident(&rays)?;
    }
    let one_by_one = taken();
    let together: Vec<_> = (0..40).map(|_| scene.resident(&rays)).collect::<Result<_, _>>()?;
    // As what is kept is seen.
    assert!(taken() > begin + 64);
    drop(together);
    scene.closest(&rays[..10])?;
    let in_the_end = taken();
    for (what, mebibytes) in [("scenes", opened), ("rays", one_by_one), ("rays at once", in_the_end)] {
        assert!(mebibytes < begin + 12, "{what}: {begin} MiB, then {mebibytes}");
    }
    Ok(())
}

#[test]
fn a_mesh_of_the_devices_is_saved_too() {
    let mesh = Mesh::teapot(2);
    for named in devices() {
        let (_folder, path) = place();
        let options = BuildOptions::default().with_builder(Builder::Binned);
        let built = built_from(&named.device, mesh.positions(), mesh.triangles(), &options).unwrap();
        built.save(&path).unwrap();
        assert!(fs::read(&path).unwrap() == teapot(), "{}", named.name);
    }
}

#[test]
fn the_file_is_as_documented() {
    for mesh in meshes() {
        let (_folder, path) = place();
        let scene = build(cpu(), &mesh, Builder::Binned);
        scene.save(&path).unwrap();
        let file = fs::read(&path).unwrap();
        let (tree, all) = (scene.tree().unwrap(), sections(&file));
        let section = |n: usize| &file[all[n].clone()];
        assert_eq!(file[..8], *b"raykd-sc");
        assert_eq!(file[8..16], *[1, LAYOUT_VERSION].map(u32::to_le_bytes).as_flattened());
        assert_eq!(file[16..40], *mesh.translation().map(f64::to_le_bytes).as_flattened());
        assert_eq!(file[40..104], *bytemuck::bytes_of(tree.view().header));
        assert_eq!(*section(0), *bytemuck::cast_slice::<_, u8>(tree.view().nodes));
        assert_eq!(*section(1), *bytemuck::cast_slice::<_, u8>(tree.view().refs));
        let positions = mesh.scaled_positions();
        let corner = |triangle: u32, corner: usize| {
            let vertex = mesh.triangles()[triangle as usize][corner] as usize;
            &positions[3 * vertex..][..3]
        };
        for (&triangle, leaf) in tree.view().refs.iter().zip(section(2).chunks(48)) {
            for (n, found) in leaf.chunks(16).enumerate() {
                assert_eq!(found[..12], *bytemuck::cast_slice::<_, u8>(corner(triangle, n)));
            }
        }
        assert_eq!(*section(3), *bytemuck::cast_slice::<_, u8>(&positions));
        assert_eq!(*section(4), *bytemuck::cast_slice::<_, u8>(mesh.triangles()));
        assert_eq!(*section(5), *bytemuck::cast_slice::<_, u8>(mesh.kept()));
        let end = file.len() - 32;
        assert_eq!(all[5].end.max(all[5].start + 1).next_multiple_of(4096), end);
        assert_eq!(file[end..], *Sha256::digest(&file[..end]));
        let zeros = |gap: Range<usize>| file[gap].iter().all(|&byte| byte == 0);
        assert!(zeros(112..4096) && all.windows(2).all(|two| zeros(two[0].end..two[1].start)));
    }
}

#[test]
fn a_changed_byte_is_told() {
    let file = teapot();
    let end = file.len();
    let places = (0..112).chain((112..end - 32).step_by(397)).chain(end - 32..end);
    for place in places.chain(sections(&file).into_iter().flat_map(|section| [section.start, section.end])) {
        for bit in [1, 0x80] {
            let mut changed = file.clone();
            changed[place] ^= bit;
            let message = refusal(&changed);
            assert!(message.contains("a.scene: "), "byte {place}: {message}");
            let what = if place < 8 { "not a raykd scene file" } else { "save" };
            assert!(message.contains(what), "byte {place}: {message}");
        }
    }
    open(&file).unwrap();
}

#[test]
fn a_file_cut_short_or_grown_is_told() {
    let file = teapot();
    let ends = sections(&file).into_iter().flat_map(|section| [section.start, section.end]);
    let lengths =
        (0..200).chain((200..file.len()).step_by(1009)).chain(ends).chain(file.len() - 33..file.len());
    for length in lengths {
        let message = refusal(&file[..length]);
        let what = if length < 8 { "not a raykd scene file" } else { "truncated scene file" };
        assert!(message.contains(what), "{length} bytes: {message}");
    }
    for more in [1, 32, 4096] {
        let message = refusal(&[&file[..], &vec![0; more]].concat());
        assert!(message.contains("damaged or truncated"), "{message}");
    }
    // Counts in the head that no file is long enough for.
    for at in [52, 68, 72, 104, 108] {
        let mut changed = file.clone();
        changed[at..at + 4].fill(0xFF);
        let message = refusal(&resealed(changed));
        assert!(message.contains("damaged or truncated"), "{message}");
    }
}

#[test]
fn other_files_are_told_apart() {
    let (folder, path) = place();
    let mesh = Mesh::teapot(2);
    let scene = build(cpu(), &mesh, Builder::Binned);
    let tell = |path: &Path| Scene::open(cpu(), path).unwrap_err().to_string();
    scene.tree().unwrap().save(&path).unwrap();
    assert!(
        tell(&path).contains("a.scene: this is a tree's file, without its mesh; read it by KdTree::load")
    );
    scene.save(&path).unwrap();
    let message = KdTree::load(&path).unwrap_err().to_string();
    assert!(message.contains("a.scene: this is a scene's file; read it by Scene::open"), "{message}");
    for other in ["", "v 0 0 0\n", "raykd-s"] {
        assert!(refusal(other.as_bytes()).contains("not a raykd scene file (write one by Scene::save)"));
    }
    assert!(tell(folder.path()).contains("this is no regular file"));
    assert!(tell(&folder.path().join("none")).contains("none: "));
    for at in [8, 12] {
        let mut newer = teapot();
        newer[at] += 1;
        let message = refusal(&resealed(newer));
        assert!(message.contains(&format!(", but this raykd reads 1.{LAYOUT_VERSION}; ")), "{message}");
    }
}

/// Of a file that is none no more is read than tells so, however large it is: there would be no memory for these.
#[cfg(unix)]
#[test]
fn a_large_file_that_is_none_is_not_read() {
    use std::os::unix::fs::FileExt as _;
    let (_folder, path) = place();
    let file = fs::File::create(&path).unwrap();
    file.set_len(1 << 43).unwrap();
    for (start, what) in [
        (&b"raykd-kd"[..], "this is a tree's file, without its mesh"),
        (&teapot()[..4096], "damaged or truncated scene file: 8796093022208 bytes instead of"),
        (&b"ply\nform"[..], "not a raykd scene file"),
    ] {
        file.write_all_at(start, 0).unwrap();
        for open in [Scene::open, open_mapped] {
            let message = open(cpu(), &path).unwrap_err().to_string();
            assert!(message.contains(what), "{message}");
        }
    }
}

/// To open a pipe waits until somebody writes to it.
#[cfg(unix)]
#[test]
fn a_pipe_is_not_waited_for() {
    let (_folder, path) = place();
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let message = Scene::open(cpu(), &path).unwrap_err().to_string();
    assert!(message.contains("this is no regular file"), "{message}");
}

/// Files whose checksum is right, and which still do not hold together.
#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let file = teapot();
    let [nodes, _, corners, positions, indices, kept] = sections(&file);
    let count = (kept.end - kept.start) / 4;
    let write = |at: usize, words: &[u32]| {
        let mut changed = file.clone();
        changed[at..at + 4 * words.len()].copy_from_slice(bytemuck::cast_slice(words));
        resealed(changed)
    };
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let vertices = word(104);
    let some = |section: &Range<usize>| (section.start + section.end) / 8 * 4;
    let number = corners.start + 48 * 5 + 12;
    for (changed, what) in [
        (write(some(&indices), &[vertices]), "a triangle names no vertex"),
        (write(kept.end - 4, &[word(72)]), "do not rise, or are none of the mesh"),
        (write(kept.start + 4, &[word(kept.start)]), "do not rise, or are none of the mesh"),
        (write(108, &[count as u32 - 1]), "the tree belongs to another mesh"),
        (write(some(&positions), &[word(some(&positions)) ^ 1]), "the tree belongs to another mesh"),
        (write(nodes.start, &<[u32; 2]>::from(Node::leaf(0, 1).words())), "some nodes or references"),
        (write(84, &[0]), "its checksum does not match"),
        (write(number, &[word(number) ^ 1]), "a leaf's corners are not its triangle's"),
        (write(some(&corners), &[word(some(&corners)) ^ 1]), "a leaf's corners are not its triangle's"),
    ] {
        let message = refusal(&changed);
        assert!(message.contains(what), "{what}: {message}");
    }
}

/// The file with another header of its tree, all checksums right.
fn with_header(file: &[u8], change: impl FnOnce(&mut TreeHeader)) -> Vec<u8> {
    let [nodes, refs, ..] = sections(file).map(|section| &file[section]);
    let mut header: TreeHeader = bytemuck::pod_read_unaligned(&file[40..104]);
    change(&mut header);
    let (nodes, refs) = (bytemuck::pod_collect_to_vec(nodes), bytemuck::pod_collect_to_vec(refs));
    header.checksum = TreeView { header: &header, nodes: &nodes, refs: &refs }.checksum();
    let mut changed = file.to_vec();
    changed[40..104].copy_from_slice(bytemuck::bytes_of(&header));
    resealed(changed)
}

/// In a smaller box hits would be lost.
#[test]
fn a_box_scale_or_move_that_is_not_the_meshs_is_refused() {
    for mesh in meshes() {
        let (_folder, path) = place();
        build(cpu(), &mesh, Builder::Binned).save(&path).unwrap();
        let file = fs::read(&path).unwrap();
        assert!(open(&with_header(&file, |_| ())).is_ok());
        let boxes: &[fn(&mut TreeHeader)] = &[
            |header| header.lo[0] -= 1.0,
            |header| header.hi[2] += 1.0,
            |header| header.hi[1] = header.hi[1].next_up(),
        ];
        // What was scaled may have been of any size.
        let scales: &[fn(&mut TreeHeader)] = &[|header| header.scale *= 2.0, |header| header.scale *= 0.5];
        for change in boxes.iter().chain(if mesh.scale() == 1.0 { scales } else { &[] }) {
            let message = refusal(&with_header(&file, change));
            assert!(message.contains("box or scale is not its mesh's"), "{message}");
        }
        for number in [f64::NAN, f64::INFINITY] {
            let mut moved = file.clone();
            moved[24..32].copy_from_slice(&number.to_le_bytes());
            let message = refusal(&resealed(moved));
            assert!(message.contains("moved by what is no number"), "{message}");
        }
    }
}

proptest! {
    #![proptest_config(cases(500))]
    /// Any words in any places, with the right checksum: refused, or traced without harm.
    #[test]
    fn whatever_stands_in_a_file_harms_nobody(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u32>(), 0..4u8), 1..3),
        head in any::<bool>(),
    ) {
        let mut file = teapot();
        let words = if head { 28 } else { file.len() / 4 - 8 };
        for (place, value, how) in changes {
            let at = 4 * place.index(words);
            let old = u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
            let new = match how {
                0 => value,
                1 => old ^ 1 << (value % 32),
                2 => old.wrapping_add(1),
                _ => old.wrapping_sub(1),
            };
            file[at..at + 4].copy_from_slice(&new.to_le_bytes());
        }
        if let Ok(scene) = open(&resealed(file)) {
            let mesh = Mesh::teapot(2);
            for hit in scene.closest(&raykd::rays::random(mesh.bounds(), 100, 1)).unwrap() {
                prop_assert!(!hit.is_hit() || (hit.triangle as usize) < mesh.triangles().len());
            }
        }
    }
}

/// A file is replaced whole: what is open stays what it was.
#[test]
fn a_file_that_is_open_may_be_replaced() {
    let (_folder, path) = place();
    let (small, large) = (Mesh::teapot(2), Mesh::teapot(3));
    build(cpu(), &small, Builder::Binned).save(&path).unwrap();
    let old = open_mapped(cpu(), &path).unwrap();
    build(cpu(), &large, Builder::Binned).save(&path).unwrap();
    let new = Scene::open(cpu(), &path).unwrap();
    fs::remove_file(&path).unwrap();
    for (scene, mesh) in [(old, small), (new, large)] {
        assert!(scene.tree().unwrap() == build(cpu(), &mesh, Builder::Binned).tree().unwrap());
    }
}

/// Two processes that trace the same file take its memory once.
#[cfg(target_os = "linux")]
mod memory {
    use super::*;
    use std::{
        env,
        io::{BufRead as _, BufReader, Write as _},
        process::{Command, Stdio},
    };

    /// Tells the second process which file to open.
    const FILE: &str = "RAYKD_TEST_SCENE_FILE";

    /// Sum of the kibibytes that lines of this name tell of this process's maps of a file.
    fn kilobytes(path: &Path, name: &str) -> u64 {
        let maps = fs::read_to_string("/proc/self/smaps").unwrap();
        let (mut ours, mut sum) = (false, 0);
        for line in maps.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some(first) if first.ends_with(':') => {
                    if ours && first == name {
                        sum += words.next().unwrap().parse::<u64>().unwrap();
                    }
                }
                _ => ours = line.ends_with(path.to_str().unwrap()),
            }
        }
        sum
    }

    /// Kibibytes of this process that no file holds.
    fn anonymous() -> u64 {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        line.trim().strip_suffix(" kB").unwrap().parse().unwrap()
    }

    /// How much of the file is in memory here, and how much of that is this process's share.
    fn shares(path: &Path) -> [u64; 2] {
        ["Rss:", "Pss:"].map(|name| kilobytes(path, name))
    }

    fn trace(scene: &Scene) {
        let rays = raykd::rays::random(Mesh::teapot(1).bounds(), 10_000, 1);
        assert!(scene.closest(&rays).unwrap().iter().any(raykd::Hit::is_hit));
    }

    /// The second process: opens, traces, and tells its shares when it is asked.
    fn second(path: &Path) {
        let device = Device::cpu_with_threads(1).unwrap();
        let before = anonymous();
        let scene = open_mapped(&device, path).unwrap();
        trace(&scene);
        println!("\nready {}", anonymous().saturating_sub(before));
        std::io::stdin().read_line(&mut String::new()).unwrap();
        let [rss, pss] = shares(path);
        println!("\nshares {rss} {pss}");
        std::io::stdin().read_line(&mut String::new()).unwrap();
    }

    #[test]
    fn two_processes_share_the_pages() {
        if let Some(path) = env::var_os(FILE) {
            return second(path.as_ref());
        }
        let (_folder, path) = place();
        build(cpu(), &Mesh::teapot(24), Builder::Binned).save(&path).unwrap();
        let size = fs::metadata(&path).unwrap().len() >> 10;
        let scene = open_mapped(cpu(), &path).unwrap();
        trace(&scene);

        let mut child = Command::new(env::current_exe().unwrap())
            .args(["--exact", "memory::two_processes_share_the_pages", "--nocapture"])
            .env(FILE, &path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut ask = child.stdin.take().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        let mut told = |what: &str| -> Vec<u64> {
            let line = lines.find_map(|line| Some(line.strip_prefix(what)?.to_owned()));
            line.expect("the other process fails").split_whitespace().map(|n| n.parse().unwrap()).collect()
        };
        let own = told("ready")[0];
        let here = shares(&path);
        writeln!(ask).unwrap();
        let there = told("shares");
        drop(ask);
        assert!(child.wait().unwrap().success());
        drop(scene);

        for [rss, pss] in [here, [there[0], there[1]]] {
            assert!(rss >= size, "{rss} KiB of {size} are mapped");
            assert!(10 * pss <= 6 * rss, "{pss} KiB of {rss} are one process's own");
        }
        assert!(5 * own <= size, "{own} KiB beside a file of {size}");
    }
}
