//! Trees with one word changed: refused, or traced by every traversal to the right hits.
//!
//! A changed word is always noticed by the tree's checksum. So that the other checks are tested too, each mutant is
//! given the checksum that fits it: then it may still lead rays past a triangle, if a leaf does not list what lies
//! there any more, but must do no other harm.

use raykd::{
    BuildOptions, Builder, Device, Hit, KdTree, Mesh, Ray, Scene, Traversal,
    internals::Cpu,
    shared::{Node, TreeHeader, TreeView},
};
use raykd_tests::{
    Failure,
    covers::covers,
    meshes::{Family, Recipe},
    rays::rays,
    trees::assemble,
};
use sha2::{Digest as _, Sha256};
use std::{
    sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed},
    thread,
    time::{Duration, Instant},
};

/// How long one mutant may take before it counts as a hang.
const PATIENCE: Duration = Duration::from_secs(60);

/// Words of a header.
const HEAD: usize = size_of::<TreeHeader>() / 4;

/// What became of mutants.
#[derive(Debug, Default)]
struct Counts {
    tried: AtomicUsize,
    refused: AtomicUsize,
    /// Traced, all hits right.
    right: AtomicUsize,
    /// Traced, some hits missing, and a leaf lacks a triangle.
    lacking: AtomicUsize,
}

/// A mesh, the words of its tree, and rays with their hits.
struct Case {
    mesh: Mesh,
    words: Vec<u32>,
    nodes: usize,
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

impl Case {
    fn new(device: &Device, mesh: Mesh, builder: Builder) -> Self {
        let options = BuildOptions::default().with_builder(builder);
        let scene = Scene::build(device, &mesh, &options).unwrap();
        let tree = scene.tree().unwrap();
        let TreeView { header, nodes, refs } = tree.view();
        let words =
            [bytemuck::cast_ref::<_, [u32; HEAD]>(header), bytemuck::cast_slice(nodes), refs].concat();
        let rays = rays(&mesh, tree.view(), 24, 7);
        let hits = scene.brute(&rays).unwrap();
        Self { nodes: nodes.len(), words, rays, hits, mesh }
    }

    /// What a place may be changed to: each bit flipped, a little more or less, and what stands elsewhere.
    fn changes(&self, place: usize) -> impl Iterator<Item = u32> {
        let word = self.words[place];
        let elsewhere =
            [place + 1, place + 2, place + 3, 7 * place + 5].map(|i| self.words[i % self.words.len()]);
        let near =
            [1, 2, 4, 8].into_iter().flat_map(move |d: u32| [word.wrapping_add(d), word.wrapping_sub(d)]);
        (0..32)
            .map(move |bit| word ^ 1 << bit)
            .chain(near)
            .chain(elsewhere)
            .filter(move |&other| other != word)
    }

    fn tree(&self, place: usize, word: u32) -> Result<KdTree, raykd::Error> {
        let mut words = self.words.clone();
        words[place] = word;
        let header = bytemuck::cast(<[u32; HEAD]>::try_from(&words[..HEAD]).unwrap());
        let (nodes, refs) = words[HEAD..].split_at(2 * self.nodes);
        let nodes: &[Node] = bytemuck::cast_slice(nodes);
        assert!(
            TreeView { header: &header, nodes, refs }.validate().is_err(),
            "word {place} is now {word:#x}"
        );
        assemble(header, nodes, refs)
    }

    fn test(&self, device: &Device, place: usize, word: u32, counts: &Counts) -> Result<(), Failure> {
        counts.tried.fetch_add(1, Relaxed);
        let scene =
            self.tree(place, word).and_then(|tree| Ok((Scene::with_tree(device, &self.mesh, &tree)?, tree)));
        let Ok((mut scene, tree)) = scene else {
            counts.refused.fetch_add(1, Relaxed);
            return Ok(());
        };
        let mut same = true;
        for &traversal in Traversal::ALL {
            scene.traverse_by(traversal)?;
            same &= bytemuck::cast_slice::<_, u32>(&scene.closest(&self.rays)?)
                == bytemuck::cast_slice::<_, u32>(&self.hits);
        }
        if same {
            counts.right.fetch_add(1, Relaxed);
            return Ok(());
        }
        if covers(&self.mesh, tree.view()).is_ok() {
            return Err(Failure(format!(
                "hits are lost, though every leaf lists what lies there; word {place} is {word:#x}"
            )));
        }
        counts.lacking.fetch_add(1, Relaxed);
        Ok(())
    }
}

#[test]
fn a_tree_with_one_word_changed_is_refused_or_harmless() {
    let recipe = |family, size| Recipe { family, size, seed: 3 }.mesh();
    let counts = Counts::default();
    let start = Instant::now();
    let cpu = || Device::from(Cpu::with_threads(1).unwrap());
    let device = cpu();
    for &builder in Builder::ALL {
        for mesh in [recipe(Family::Soup, 24), recipe(Family::Lattice, 40), Mesh::teapot(1)] {
            let case = &Case::new(&device, mesh, builder);
            let changes: Vec<(usize, u32)> = (0..case.words.len())
                .flat_map(|place| case.changes(place).map(move |word| (place, word)))
                .collect();
            let (next, counts, threads) =
                (&AtomicUsize::new(0), &counts, thread::available_parallelism().unwrap().get());
            // When each thread began its mutant, in milliseconds, and which.
            let begun: &Vec<_> =
                &(0..threads).map(|_| (AtomicU64::new(u64::MAX), AtomicUsize::new(0))).collect();
            let work = &|mine: usize| {
                let (device, (since, which)) = (cpu(), &begun[mine]);
                while let i = next.fetch_add(1, Relaxed)
                    && let Some(&(place, word)) = changes.get(i)
                {
                    which.store(i, Relaxed);
                    since.store(start.elapsed().as_millis() as u64, Relaxed);
                    case.test(&device, place, word, counts).unwrap();
                }
                since.store(u64::MAX, Relaxed);
            };
            thread::scope(|scope| {
                let workers: Vec<_> = (0..threads).map(|mine| scope.spawn(move || work(mine))).collect();
                while workers.iter().any(|worker| !worker.is_finished()) {
                    thread::sleep(Duration::from_millis(5));
                    for (since, which) in begun {
                        let now = start.elapsed().as_millis() as u64;
                        if now.saturating_sub(since.load(Relaxed)) > PATIENCE.as_millis() as u64 {
                            let (place, word) = changes[which.load(Relaxed)];
                            eprintln!("{builder:?}: hangs where word {place} is {word:#x}");
                            std::process::abort();
                        }
                    }
                }
            });
        }
    }
    println!("{counts:?} in {:?}", start.elapsed());
    let [tried, refused, right, lacking] =
        [counts.tried, counts.refused, counts.right, counts.lacking].map(AtomicUsize::into_inner);
    assert_eq!(tried, refused + right + lacking);
    assert!(tried >= 100_000 && right > tried / 100, "{tried} mutants, {right} of them traced");
}

/// As it was, or with a checksum that fits.
#[test]
fn a_tree_file_of_another_length_is_refused() {
    let scene = Scene::build(&Device::cpu(), &Mesh::teapot(1), &BuildOptions::default()).unwrap();
    let file = scene.tree().unwrap().to_bytes();
    let data = &file[..file.len() - size_of_val(&*Sha256::digest(b""))];
    let sealed = |data: &[u8]| [data, Sha256::digest(data).as_slice()].concat();
    assert_eq!(sealed(data), file);
    for length in 0..file.len() {
        assert!(KdTree::from_bytes(&file[..length]).is_err(), "{length}");
        let short = length < data.len();
        assert!(!short || KdTree::from_bytes(&sealed(&data[..length])).is_err(), "{length}, sealed");
    }
    for more in [1, 4, 8, 64] {
        assert!(KdTree::from_bytes(&sealed(&[data, &vec![0; more]].concat())).is_err(), "{more} more");
    }
}
