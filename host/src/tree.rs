//! A kd-tree in memory and on disk.

use crate::{Error, Mesh, TreeError};
use raykd_shared::{LAYOUT_VERSION, Node, Report, TreeHeader, TreeView};
use sha2::{Digest, Sha256};
use std::{io::Write, path::Path};

/// A tree, owned: header, nodes and references as `raykd-shared` lays them out.
#[derive(Clone, Debug, PartialEq)]
pub struct KdTree {
    pub(crate) header: TreeHeader,
    pub(crate) nodes: Vec<Node>,
    pub(crate) refs: Vec<u32>,
}

/// First bytes of a tree file.
pub(crate) const MAGIC: &[u8; 8] = b"raykd-kd";
/// First bytes of a scene file.
pub(crate) const SCENE_MAGIC: [u8; 8] = *b"raykd-sc";
/// Bytes of the checksum at the end of a tree file.
const SUM: usize = 32;

impl KdTree {
    /// The parts, for code that reads the layout.
    pub fn view(&self) -> TreeView<'_> {
        TreeView { header: &self.header, nodes: &self.nodes, refs: &self.refs }
    }

    /// A tree whose header says which mesh it is of, and has its checksum.
    pub(crate) fn sealed(header: TreeHeader, nodes: Vec<Node>, refs: Vec<u32>, mesh: [u32; 2]) -> Self {
        Self { header: seal(header, &nodes, &refs, mesh), nodes, refs }
    }

    /// Tells whether this is a tree of these triangles, with these numbers.
    ///
    /// # Errors
    /// It is another mesh's.
    pub fn check_mesh(&self, mesh: &Mesh) -> Result<(), Error> {
        let (header, triangles) = (&self.header, mesh.triangles().len());
        let same = header.triangles as usize == triangles
            && (header.lo, header.hi) == mesh.scaled_bounds()
            && header.scale.to_bits() == mesh.scale().to_bits()
            && header.mesh == mesh.tree_key();
        if same {
            return Ok(());
        }
        Err(TreeError::OtherMesh { tree: header.triangles as usize, mesh: triangles }.into())
    }

    /// Header, nodes and references as they lie in memory, one after the other.
    fn parts(&self) -> [&[u8]; 3] {
        [
            bytemuck::bytes_of(&self.header),
            bytemuck::cast_slice(&self.nodes),
            bytemuck::cast_slice(&self.refs),
        ]
    }

    /// Bytes of nodes and references in memory; [`KdTree::to_bytes`] gives the bytes of a file.
    pub fn size_in_bytes(&self) -> u64 {
        (size_of_val(self.nodes.as_slice()) + size_of_val(self.refs.as_slice())) as u64
    }

    /// SHA-256 of the tree's bytes in hexadecimal, with the header's digest and checksum as zeros.
    pub fn digest(&self) -> String {
        let header = TreeHeader { mesh: [0; 2], checksum: 0, ..self.header };
        let [_, nodes, refs] = self.parts();
        let mut hasher = Sha256::new();
        for part in [bytemuck::bytes_of(&header), nodes, refs] {
            hasher.update(part);
        }
        hex(&hasher.finalize())
    }

    /// Checks the whole tree and measures it; see [`TreeView::validate`].
    ///
    /// # Errors
    /// The tree is damaged: [`TreeError::Fault`] says where.
    pub fn validate(&self) -> Result<Report, Error> {
        self.view().validate().map_err(|fault| TreeError::Fault(fault).into())
    }

    /// Writes the tree to a file: the bytes `raykd-kd`, [`LAYOUT_VERSION`], [`TreeHeader`], nodes, references, SHA-256
    /// of all that, with nothing between. The file appears whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        crate::output::write_whole(path.as_ref(), |file| self.write(file))
    }

    /// The bytes of the file that [`KdTree::save`] writes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write(&mut bytes).expect("memory takes all that is written");
        bytes
    }

    fn write(&self, file: &mut dyn Write) -> std::io::Result<()> {
        let mut hasher = Sha256::new();
        let version = LAYOUT_VERSION.to_le_bytes();
        let [header, nodes, refs] = self.parts();
        for part in [MAGIC.as_slice(), &version, header, nodes, refs] {
            hasher.update(part);
            file.write_all(part)?;
        }
        file.write_all(&hasher.finalize())
    }

    /// Reads a tree that [`KdTree::save`] wrote, and checks every node. No more than
    /// [`default_max_bytes`](crate::default_max_bytes) are read.
    ///
    /// # Errors
    /// The file cannot be read, is larger than that, is no tree file, has another version, or is damaged.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::load_up_to(path, crate::default_max_bytes())
    }

    /// Like [`KdTree::load`], but so many bytes are read before it is an error.
    ///
    /// # Errors
    /// The file cannot be read, is larger, is no tree file, has another version, or is damaged.
    pub fn load_up_to(path: impl AsRef<Path>, max_bytes: u64) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = crate::read::all_of(path, max_bytes)?;
        Self::from_bytes(&bytes).map_err(in_file(path))
    }

    /// Reads a tree from the bytes of a tree file, as [`KdTree::to_bytes`] gives them.
    ///
    /// # Errors
    /// They are no tree file, of another version, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let damaged = |what: &str| Err(TreeError::Damaged(what.to_owned()).into());
        let start = MAGIC.len() + 4;
        let body = start + size_of::<TreeHeader>();
        if bytes.starts_with(&SCENE_MAGIC) {
            return Err(TreeError::SceneFile.into());
        }
        if !bytes.starts_with(MAGIC) {
            return Err(TreeError::NoTreeFile.into());
        }
        if bytes.len() < body + SUM {
            return damaged("truncated tree file; build it again");
        }
        let version = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
        if version != LAYOUT_VERSION {
            return Err(TreeError::TreeVersion(version).into());
        }
        let (data, sum) = bytes.split_at(bytes.len() - SUM);
        if Sha256::digest(data).as_slice() != sum {
            return damaged("damaged or truncated tree file: its checksum does not match; build it again");
        }
        let header: TreeHeader = bytemuck::pod_read_unaligned(&data[start..body]);
        let node_bytes = u64::from(header.nodes) * size_of::<Node>() as u64;
        if (data.len() - body) as u64 != node_bytes + u64::from(header.refs) * 4 {
            return damaged("damaged tree file: its length does not match its header; build it again");
        }
        let node_bytes = node_bytes as usize;
        let nodes = bytemuck::pod_collect_to_vec::<u8, _>(&data[body..body + node_bytes]);
        let refs = bytemuck::pod_collect_to_vec::<u8, _>(&data[body + node_bytes..]);
        let tree = Self { header, nodes, refs };
        tree.validate()?;
        Ok(tree)
    }
}

/// A header that says which mesh the tree is of, and has the tree's checksum.
pub(crate) fn seal(header: TreeHeader, nodes: &[Node], refs: &[u32], mesh: [u32; 2]) -> TreeHeader {
    let header = TreeHeader { mesh, ..header };
    TreeHeader { checksum: TreeView { header: &header, nodes, refs }.checksum(), ..header }
}

/// Adds the file to what is wrong in it.
pub(crate) fn in_file(path: &Path) -> impl Fn(Error) -> Error + '_ {
    |error| match error {
        Error::Tree { why, .. } => Error::Tree { file: Some(path.to_owned()), why },
        other => other,
    }
}

/// Bytes in hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut s, b| {
        let _ = write!(s, "{b:02x}");
        s
    })
}

/// SHA-256 of hits as their file would hold them, in hexadecimal.
pub fn hits_digest(hits: &[raykd_shared::Hit]) -> String {
    digest_of(bytemuck::cast_slice(hits))
}

/// SHA-256 of bytes, in hexadecimal.
pub fn digest_of(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}
