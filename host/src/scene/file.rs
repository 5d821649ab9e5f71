//! A scene in one file, which processes share.

use super::Scene;
use crate::{
    BuildTimes, Error, TreeError,
    build::{Built, Kept, Laid, MeshBuffers},
    clock::Instant,
    exec::{
        Device,
        cpu::Memory,
        pages::{FileBytes, start_of},
    },
    mesh::{Measure, digest},
    output, tree,
};
use bytemuck::{Pod, Zeroable, cast_slice};
use raykd_kernels::{
    glam::Vec3,
    trace::{intersect::strict::Strict, prepare::corners, single::LeafTriangle},
};
use raykd_shared::{LAYOUT_VERSION, Node, TreeHeader, TreeView};
use rayon::prelude::*;
use sha2::{Digest as _, Sha256};
use std::{
    io::{self, Write as _},
    path::Path,
};

/// Version of what a scene file adds to the layouts of `raykd-shared`: head, order of the sections, leaf triangles.
const VERSION: u32 = 1;
/// Sections begin at multiples of this.
const PAGE: u64 = 4096;
/// Bytes of the checksum at the end.
const SUM: u64 = 32;
/// What helps against all damage.
const AGAIN: &str = "build the scene again and save it";

/// Start of a scene file: 112 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Head {
    magic: [u8; 8],
    version: u32,
    layout: u32,
    translation: [f64; 3],
    /// With the digest of the mesh and the tree's checksum.
    tree: TreeHeader,
    vertices: u32,
    kept: u32,
}

/// How many sections there are.
const SECTIONS: usize = 6;

impl Head {
    /// Bytes of each section.
    fn sizes(&self) -> [u64; SECTIONS] {
        let TreeHeader { nodes, refs, triangles, .. } = self.tree;
        let each = [(nodes, 8), (refs, 4), (refs, 48), (self.vertices, 12), (triangles, 12), (self.kept, 4)];
        each.map(|(count, size)| u64::from(count) * size)
    }
}

/// Where sections of so many bytes begin, and where the last one ends.
fn places(sizes: [u64; SECTIONS]) -> ([u64; SECTIONS], u64) {
    let mut end = PAGE;
    // Every section has a page at least, as no buffer is empty.
    let begins = sizes.map(|bytes| {
        let begin = end;
        end += bytes.max(1).next_multiple_of(PAGE);
        begin
    });
    (begins, end)
}

/// The sections.
struct Parts<'a> {
    nodes: &'a [Node],
    refs: &'a [u32],
    corners: &'a [LeafTriangle],
    /// Scaled.
    positions: &'a [f32],
    indices: &'a [[u32; 3]],
    kept: &'a [u32],
}

impl Parts<'_> {
    fn sections(&self) -> [&[u8]; SECTIONS] {
        let Self { nodes, refs, corners, positions, indices, kept } = *self;
        [
            cast_slice(nodes),
            cast_slice(refs),
            cast_slice(corners),
            cast_slice(positions),
            cast_slice(indices),
            cast_slice(kept),
        ]
    }

    /// Whether a tree has the box of the triangles that take part, and their scale.
    fn is_measured(&self, header: &TreeHeader) -> bool {
        let Self { positions, indices, kept, .. } = *self;
        if kept.is_empty() {
            return header.lo == [0.0; 3] && header.hi == [0.0; 3] && header.scale == 1.0;
        }
        let at = |vertex: u32| [0, 1, 2].map(|axis| positions[3 * vertex as usize + axis]);
        let Measure { lo, hi, .. } = Measure::of(kept, |triangle| indices[triangle as usize].map(at));
        // The mesh as it was given, which tells by what power of two it was multiplied.
        let [lo_given, hi_given] = [lo, hi].map(|corner| corner.map(|x| x / header.scale));
        let finite = lo_given.iter().chain(&hi_given).all(|x| x.is_finite());
        let scale = Measure { lo: lo_given, hi: hi_given, smallest: 0.0 }.scale();
        (header.lo, header.hi) == (lo, hi) && finite && scale.is_ok_and(|scale| scale == header.scale)
    }

    /// Makes sure that it all belongs together: kernels rely on it. Whatever stands there is no harm to this.
    fn check(&self, head: &Head) -> Result<(), String> {
        let Self { nodes, refs, corners, positions, indices, kept } = *self;
        let vertices = head.vertices;
        if !indices.par_iter().all(|triangle| triangle.iter().all(|&vertex| vertex < vertices)) {
            return Err("a triangle names no vertex".to_owned());
        }
        let rising = kept.par_windows(2).all(|pair| pair[0] < pair[1]);
        if !rising || kept.last().is_some_and(|&last| last >= head.tree.triangles) {
            return Err("the triangles that take part do not rise, or are none of the mesh".to_owned());
        }
        let view = TreeView { header: &head.tree, nodes, refs };
        view.validate().map_err(|fault| fault.to_string())?;
        if digest(positions, indices, kept) != head.tree.mesh {
            return Err("the tree belongs to another mesh".to_owned());
        }
        if !self.is_measured(&head.tree) {
            return Err("the tree's box or scale is not its mesh's".to_owned());
        }
        if !head.translation.iter().all(|x| x.is_finite()) {
            return Err("the mesh was moved by what is no number".to_owned());
        }
        let laid = |(&id, corners): (&u32, &LeafTriangle)| {
            let at = |vertex: u32| Vec3::from_slice(&positions[3 * vertex as usize..][..3]);
            let (a, b, c) = corners::kept::<Strict>(id, indices[id as usize].map(at).into());
            bytemuck::bytes_of(&[a, b, c].map(|v| v.to_array())) == bytemuck::bytes_of(corners)
        };
        if !refs.par_iter().zip(corners).all(laid) {
            return Err("a leaf's corners are not its triangle's".to_owned());
        }
        Ok(())
    }
}

/// Scenes as files, to be built once and used by several processes, or later.
///
/// ```
/// use raykd::{BuildOptions, Device, Mesh, Ray, Scene};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = &folder.path().join("teapot.scene");
/// let device = Device::best();
/// let built = Scene::build(&device, &Mesh::teapot(4), &BuildOptions::default())?;
/// built.save(path)?;
///
/// // In any number of processes.
/// let scene = Scene::open(&device, path)?;
/// let ray = [Ray::new([0.0, 0.0, 50.0], [0.0, 0.0, -1.0])];
/// assert_eq!(scene.closest(&ray)?, built.closest(&ray)?);
/// # Ok(())
/// # }
/// ```
///
/// # Format
/// All numbers are little-endian. A head, sections, and the SHA-256 of all that comes before it, 32 bytes. The head is
///
/// | byte | what |
/// |---:|---|
/// | 0 | `raykd-sc` |
/// | 8 | version of this format, 1, and [`LAYOUT_VERSION`](raykd_shared::LAYOUT_VERSION), a `u32` each |
/// | 16 | what the mesh was moved by ([`Mesh::translation`](crate::Mesh::translation)), three `f64` |
/// | 40 | [`TreeHeader`](raykd_shared::TreeHeader), 64 bytes, as in a tree's file |
/// | 104 | how many vertices the mesh has, and how many triangles take part, a `u32` each |
///
/// Behind it come the sections: the tree's nodes, 8 bytes each; its references, 4 bytes each; the triangles of the
/// references, as leaves keep them, 48 bytes each
/// ([`LeafTriangle`](crate::single::LeafTriangle)); vertices, three `f32` each
/// ([`Mesh::scaled_positions`](crate::Mesh::scaled_positions)); triangles, three `u32` each; and the numbers of the
/// triangles that take part, rising, a `u32` each. The first section begins at byte 4096. Every other one, and then the
/// SHA-256, begins at the next multiple of 4096 behind the section before it, where an empty section counts as a byte.
/// Zeros lie between.
impl Scene {
    /// Writes mesh and tree to a file, for [`Scene::open`]: all that is needed to trace by any traversal and triangle
    /// test. Those that were chosen are not written, nor what they need beside the tree. The file appears whole or not
    /// at all. It is the same for every device.
    ///
    /// # Errors
    /// The file cannot be written, or the device failed.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.save_to(path.as_ref())
    }

    fn save_to(&self, path: &Path) -> Result<(), Error> {
        let (device, header) = (&self.device, self.header);
        let (nodes, refs) = (device.kept(&self.nodes)?, device.kept(&self.refs)?);
        let (positions, indices) = (device.kept(&self.mesh.positions)?, device.kept(&self.mesh.indices)?);
        let (corners, kept) = (device.kept(&self.corners)?, self.kept.list(device)?);
        let parts = Parts {
            nodes: &nodes.slice()[..header.nodes as usize],
            refs: &refs.slice()[..header.refs as usize],
            corners: &corners.slice()[..header.refs as usize],
            positions: &positions.slice()[..self.mesh.coordinates],
            indices: &indices.slice()[..header.triangles as usize],
            kept: &kept,
        };
        let mesh = device.install(|| digest(parts.positions, parts.indices, parts.kept));
        let head = Head {
            magic: tree::SCENE_MAGIC,
            version: VERSION,
            layout: LAYOUT_VERSION,
            translation: self.translation,
            tree: tree::seal(header, parts.nodes, parts.refs, mesh),
            vertices: (self.mesh.coordinates / 3) as u32,
            kept: parts.kept.len() as u32,
        };
        output::write_whole(path, |file| {
            let mut hasher = Sha256::new();
            let mut write = |part: &[u8]| {
                let gap = part.len().max(1).next_multiple_of(PAGE as usize) - part.len();
                for bytes in [part, &[0; PAGE as usize][..gap]] {
                    hasher.update(bytes);
                    file.write_all(bytes)?;
                }
                Ok::<(), std::io::Error>(())
            };
            write(bytemuck::bytes_of(&head))?;
            parts.sections().into_iter().try_for_each(write)?;
            file.write_all(&hasher.finalize())
        })
    }

    /// Opens a scene that [`Scene::save`] wrote, on any machine and device. Everything in it is checked first.
    /// Traversal and triangle test are the default ones. [`Scene::times`] tells only how long this took, as
    /// [`BuildTimes::upload`]. The file is read whole, however large it is.
    ///
    /// # Errors
    /// The file cannot be read, is no regular file or no scene file, has another version, or is damaged; or the scene
    /// does not fit the device, or the device failed.
    pub fn open(device: &Device, path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::of_file(device, path.as_ref(), FileBytes::read)
    }

    /// Like [`Scene::open`], but on the CPU nothing is copied: the scene is a map of the file in memory, of which all
    /// processes that open it share the pages. A GPU gets a copy.
    ///
    /// # Safety
    /// The file does not change as long as a scene of it lives: what is found could then be anything, and if it were
    /// cut short, the system would end the process (`SIGBUS` on Unix). To replace it is safe, as [`Scene::save`] does,
    /// or to remove it: scenes that are open keep the old one.
    ///
    /// # Errors
    /// Those of [`Scene::open`].
    pub unsafe fn open_mapped(device: &Device, path: impl AsRef<Path>) -> Result<Self, Error> {
        // SAFETY: what the caller promises.
        Self::of_file(device, path.as_ref(), |path| unsafe { FileBytes::map(path) })
    }

    fn of_file(
        device: &Device,
        path: &Path,
        bytes: impl FnOnce(&Path) -> io::Result<FileBytes>,
    ) -> Result<Self, Error> {
        let start = Instant::now();
        let unread = |source| Error::Io { path: path.to_owned(), source };
        let damaged = |why| Error::Tree { file: Some(path.to_owned()), why };
        // There may be no memory for what is no scene file.
        let (first, length) = start_of(path, size_of::<Head>()).map_err(unread)?;
        head(&first, length).map_err(damaged)?;
        let file = bytes(path).map_err(unread)?;
        let (head, [nodes, refs, corners, positions, indices, kept]) =
            device.install(|| checked(&file)).map_err(damaged)?;
        let header = TreeHeader { mesh: [0; 2], checksum: 0, ..head.tree };
        let [of_nodes, of_refs, vertices, triangles, count] =
            [header.nodes, header.refs, head.vertices, header.triangles, head.kept]
                .map(|count| count as usize);
        let mesh = MeshBuffers {
            positions: device.share("positions", &file, positions, 3 * vertices)?,
            coordinates: 3 * vertices,
            indices: device.share("indices", &file, indices, 3 * triangles)?,
        };
        let kept = Kept::Device { list: device.share("kept", &file, kept, count)?, count: head.kept };
        let laid = Laid {
            header: Some(device.put("header", &[header])?),
            corners: Some(device.share::<LeafTriangle>("corners", &file, corners, of_refs)?.view()),
        };
        let built = Built {
            header,
            nodes: device.share("nodes", &file, nodes, of_nodes)?,
            refs: device.share("refs", &file, refs, of_refs)?,
            times: BuildTimes { upload: start.elapsed(), ..BuildTimes::default() },
            laid,
        };
        Self::assemble(device, mesh, kept, head.translation, built)
    }
}

/// The head of a file that is a scene's and as long as that says, by its first bytes.
fn head(first: &[u8], length: u64) -> Result<Head, TreeError> {
    if first.starts_with(tree::MAGIC) {
        return Err(TreeError::NoMesh);
    }
    if !first.starts_with(&tree::SCENE_MAGIC) {
        return Err(TreeError::NoSceneFile);
    }
    let Some(head) = first.get(..size_of::<Head>()) else {
        return Err(TreeError::Damaged(format!("truncated scene file; {AGAIN}")));
    };
    let head: Head = bytemuck::pod_read_unaligned(head);
    let (given, read) = ([head.version, head.layout], [VERSION, LAYOUT_VERSION]);
    if given != read {
        let [found, known] = [given, read].map(|[format, layout]| format!("{format}.{layout}"));
        return Err(TreeError::SceneVersion { found, known });
    }
    let expected = places(head.sizes()).1 + SUM;
    if length != expected {
        let what = format!("damaged or truncated scene file: {length} bytes instead of {expected}; {AGAIN}");
        return Err(TreeError::Damaged(what));
    }
    Ok(head)
}

/// The head of a file that is a scene's, whole and undamaged, and where its sections begin.
fn checked(file: &FileBytes) -> Result<(Head, [usize; SECTIONS]), TreeError> {
    let all = Memory::part_of(file, 0, file.len()).keep("scene file", file.len() as u64);
    let all: &[u8] = all.slice();
    let head = head(all, all.len() as u64)?;
    let sizes = head.sizes();
    let (begins, end) = places(sizes);
    let (data, sum) = all.split_at(end as usize);
    let begins = begins.map(|begin| begin as usize);
    let section = |n: usize| &data[begins[n]..][..sizes[n] as usize];
    let parts = Parts {
        nodes: cast_slice(section(0)),
        refs: cast_slice(section(1)),
        corners: cast_slice(section(2)),
        positions: cast_slice(section(3)),
        indices: cast_slice(section(4)),
        kept: cast_slice(section(5)),
    };
    let (is_whole, checked) = rayon::join(|| Sha256::digest(data).as_slice() == sum, || parts.check(&head));
    let checked = if is_whole { checked } else { Err("its checksum does not match".to_owned()) };
    checked.map_err(|what| TreeError::Damaged(format!("damaged scene file: {what}; {AGAIN}")))?;
    Ok((head, begins))
}
