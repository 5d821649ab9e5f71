//! What can go wrong, and what to do about it.

use std::path::PathBuf;

/// Everything raykd's library reports.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh could not be used.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is larger than what is read of one.
    #[error(
        "{}: this is more than {limit} bytes, and no more are read; if all is as it should be, allow more (--max-bytes, load_up_to)",
        path.display()
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// The most that is read.
        limit: u64,
    },
    /// A buffer would be larger than the device allows.
    #[error(
        "buffer '{buffer}' needs {bytes} bytes, but {limit_name} allows {limit}; use a smaller mesh, or another device (--device cpu)"
    )]
    TooLarge {
        /// Name of the buffer.
        buffer: &'static str,
        /// Bytes asked for.
        bytes: u64,
        /// Bytes allowed.
        limit: u64,
        /// Name of the limit.
        limit_name: &'static str,
    },
    /// Memory ran out.
    #[error("out of memory: no room for {bytes} bytes of '{buffer}'")]
    OutOfMemory {
        /// Name of the buffer.
        buffer: &'static str,
        /// Bytes asked for.
        bytes: u64,
    },
    /// CPU threads could not be started.
    #[error("cannot start threads: {0}")]
    Threads(String),
    /// There is no Vulkan adapter (of that name).
    #[error("no Vulkan adapter{}: install a driver; for a software one, on Debian or Ubuntu: apt install mesa-vulkan-drivers", wanted.as_ref().map(|w| format!(" named like '{w}' (`raykd devices` lists those there are)")).unwrap_or_default())]
    NoAdapter {
        /// The name asked for.
        wanted: Option<String>,
    },
    /// The device does not compute float operations as the CPU does.
    #[error(
        "{adapter} is refused: {reason}; to use it all the same, name it with --adapter and set RAYKD_ALLOW_INEXACT=1"
    )]
    Inexact {
        /// The adapter.
        adapter: String,
        /// What the probe found.
        reason: String,
    },
    /// The device failed.
    #[error("{adapter}: {what}; the same job gives the same bytes with --device cpu")]
    DeviceFailed {
        /// The adapter.
        adapter: String,
        /// What happened.
        what: String,
    },
    /// A kernel raised a status that more room cannot cure.
    #[error("a kernel stopped: {0}")]
    Kernel(&'static str),
    /// A file of measured costs is of no use.
    #[error("{}: {what}; `raykd calibrate` measures anew", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A triangle test was asked for what only the default one does.
    #[error(
        "intersector {name} works with the traversals stack and brute, for closest and any hits; {asked} needs the default, exact"
    )]
    Intersector {
        /// The test.
        name: &'static str,
        /// What was asked for.
        asked: String,
    },
    /// As many triangles to leave out as rays are needed.
    #[error("{rays} rays with {excluded} triangles to leave out; give one a ray (MISS for none)")]
    Excluded {
        /// Rays given.
        rays: usize,
        /// Triangles given.
        excluded: usize,
    },
    /// A tree file or tree does not hold together.
    #[error("{0}")]
    Tree(String),
}
