//! What can go wrong, and what to do about it.

use crate::{Intersector, quoted::quoted};
use raykd_shared::{Fault, LAYOUT_VERSION, status};
use std::path::PathBuf;

/// Everything raykd's library reports.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh could not be used.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A file could not be read or written.
    #[error("{}: {source}", quoted(path.display()))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is larger than what is read of one: [`KdTree::load_up_to`](crate::KdTree::load_up_to) allows more.
    #[error(
        "{}: this is more than {limit} bytes, and no more are read; if all is as it should be, allow more",
        quoted(path.display())
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// The most that is read.
        limit: u64,
    },
    /// A buffer would be larger than the device allows.
    #[error(
        "buffer '{buffer}' needs {bytes} bytes, but {limit_name} allows {limit}; use {}, or another device",
        if *buffer == "rays" { "fewer rays" } else { "a smaller mesh" }
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
    #[error(
        "no Vulkan adapter{} install a driver; for a software one, on Debian or Ubuntu: apt install \
         mesa-vulkan-drivers",
        wanted.as_ref().map_or(":".to_owned(), |wanted| format!(" is named like '{}': correct the name, or", quoted(wanted)))
    )]
    NoAdapter {
        /// The name asked for.
        wanted: Option<String>,
    },
    /// The device does not compute float operations as the CPU does. [`Device::gpu`](crate::Device::gpu) tells how it
    /// may be used all the same.
    #[error("{adapter} is refused: {reason}")]
    Inexact {
        /// The adapter.
        adapter: String,
        /// What the probe found.
        reason: String,
    },
    /// A driver, or a device that was opened elsewhere, lacks a feature or limit that the kernels need.
    #[error("{adapter} cannot run raykd's kernels: {what}")]
    Lacking {
        /// The adapter.
        adapter: String,
        /// What is missing.
        what: String,
    },
    /// The device failed.
    #[error("{adapter}: {what}; the same job gives the same bytes on the CPU")]
    DeviceFailed {
        /// The adapter.
        adapter: String,
        /// What happened.
        what: String,
    },
    /// A kernel stopped, and its output is dropped: a software driver (llvmpipe) left a loop early (run the job on the
    /// CPU), a tree is deeper than its header says, or no room was enough for a build.
    #[error("a kernel stopped: {0}")]
    Kernel(&'static str),
    /// A file of measured costs is of no use.
    #[error("{}: {what}", quoted(path.display()))]
    Calibration {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A buffer or device of a wgpu program cannot be used: the message says why.
    #[error("{0}")]
    Wgpu(String),
    /// A transform of a [`World`](crate::World) cannot be undone.
    #[error("the transform of instance {instance} {why}")]
    Transform {
        /// The number that the instance would have.
        instance: u32,
        /// What is wrong with it.
        why: &'static str,
    },
    /// No builder, traversal or triangle test has this name.
    #[error("no {what} is named '{}'; there are {}", quoted(name), names.join(", "))]
    UnknownName {
        /// What was named.
        what: &'static str,
        /// The name given.
        name: String,
        /// The names there are.
        names: &'static [&'static str],
    },
    /// An option of a build is out of its range.
    #[error("{name} is {value}, and must be from {least} to {most}")]
    Options {
        /// Field of [`crate::BuildOptions`].
        name: &'static str,
        /// What it is.
        value: f32,
        /// The least it may be.
        least: f32,
        /// The most it may be.
        most: f32,
    },
    /// A triangle test was asked for a query or a traversal that it does not support, see [`Intersector::goes_with`].
    #[error(
        "intersector {name} works with the traversals stack and brute{}; {asked} needs {}the default, {}",
        if *exact { ", for closest and any hits" } else { "" },
        if *exact { "exact or " } else { "" },
        Intersector::default()
    )]
    Intersector {
        /// The test.
        name: &'static str,
        /// What was asked for.
        asked: String,
        /// Whether [`Intersector::Exact`] does that too.
        exact: bool,
    },
    /// [`ResidentRays`](crate::ResidentRays) were asked for hits before a trace succeeded.
    #[error("these rays have no hits yet; call ResidentRays::trace first, and see that it succeeds")]
    Untraced,
    /// [`Scene::trace_except`](crate::Scene::trace_except) needs as many triangles as rays.
    #[error("{rays} rays with {excluded} triangles to leave out; give one a ray (MISS for none)")]
    Excluded {
        /// Rays given.
        rays: usize,
        /// Triangles given.
        excluded: usize,
    },
    /// A tree, or the file of a tree or a scene, cannot be used.
    #[error("{}{why}", file.as_ref().map(|file| format!("{}: ", quoted(file.display()))).unwrap_or_default())]
    Tree {
        /// The file, if it came from one.
        file: Option<PathBuf>,
        /// What is wrong with it.
        why: TreeError,
    },
}

/// Why a tree, or the file of a tree or a scene, cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TreeError {
    /// The bytes do not begin as those of a tree's file.
    #[error("not a raykd tree file (write one by KdTree::save)")]
    NoTreeFile,
    /// The bytes do not begin as those of a scene's file.
    #[error("not a raykd scene file (write one by Scene::save)")]
    NoSceneFile,
    /// This is a tree's file where a scene's is wanted.
    #[error(
        "this is a tree's file, without its mesh; read it by KdTree::load, and pass it to Scene::with_tree with the \
         mesh"
    )]
    NoMesh,
    /// This is a scene's file where a tree's is wanted.
    #[error("this is a scene's file; read it by Scene::open, and take the tree by Scene::tree")]
    SceneFile,
    /// A tree's file has another layout.
    #[error("tree layout version {0}, but this raykd reads {LAYOUT_VERSION}; build the tree again")]
    TreeVersion(u32),
    /// A scene's file has another format.
    #[error("scene layout version {found}, but this raykd reads {known}; build the scene again and save it")]
    SceneVersion {
        /// That of the file: of the format, and of the layout behind the point.
        found: String,
        /// The one that is read.
        known: String,
    },
    /// A file was cut short or changed.
    #[error("{0}")]
    Damaged(String),
    /// The tree does not hold together.
    #[error("damaged tree: {0}")]
    Fault(#[from] Fault),
    /// The tree is of other triangles.
    #[error(
        "the tree belongs to another mesh ({}); build it again from this one",
        if *tree == *mesh {
            format!("of as many triangles, {mesh}, but not the same")
        } else {
            format!("of {tree} triangles, this one has {mesh}")
        }
    )]
    OtherMesh {
        /// How many triangles the mesh has that the tree is of.
        tree: usize,
        /// How many this one has.
        mesh: usize,
    },
}

impl Error {
    /// That a kernel stopped, by the bits that it left.
    pub(crate) const fn of_status(bits: u32) -> Self {
        Self::Kernel(if bits & status::CUT_SHORT == 0 {
            status::describe(bits)
        } else {
            "the driver cut a long loop short, as llvmpipe does after 65,535 rounds; a CPU does the same job"
        })
    }
}

impl From<TreeError> for Error {
    fn from(why: TreeError) -> Self {
        Self::Tree { file: None, why }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Traversal;

    #[test]
    fn a_refused_intersector_names_the_real_default() {
        for &test in Intersector::ALL {
            let asked = "traversal ropes".to_owned();
            let error = Error::Intersector { name: test.name(), asked, exact: false }.to_string();
            assert!(error.ends_with(&format!("the default, {}", Intersector::default().name())), "{error}");
        }
        assert_eq!(Intersector::default().name(), "strict");
    }

    #[test]
    fn a_loop_cut_short_is_told_without_options_of_the_program() {
        let error = Error::of_status(status::CUT_SHORT | status::STACK).to_string();
        assert!(error.contains("cut a long loop short") && !error.contains("--"), "{error}");
        assert!(Error::of_status(status::STACK).to_string().ends_with("deeper than its header says"));
    }

    #[test]
    fn a_refused_intersector_is_told_what_it_does() {
        let told = |refused: Result<(), Error>| refused.unwrap_err().to_string();
        assert_eq!(
            told(Intersector::Exact.goes_with(Traversal::Ropes)),
            "intersector exact works with the traversals stack and brute; traversal ropes needs the default, strict"
        );
        assert_eq!(
            told(Intersector::Woop.check_query("counting steps")),
            "intersector woop works with the traversals stack and brute, for closest and any hits; counting steps \
             needs exact or the default, strict"
        );
    }
}
