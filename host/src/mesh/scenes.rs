//! Scenes by name: the built-in teapot, the meshes that `cargo xtask scenes` fetches, or any file.

use super::{
    Mesh,
    error::{MeshError, quoted_bytes},
    fetched::FETCHED,
    teapot,
};
use std::ffi::OsStr;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The level of the scene `teapot`: 992 triangles with area.
const DEFAULT_LEVEL: u32 = 4;

/// Where a mesh comes from, by name: a file, or one of the scenes that raykd is tested with.
///
/// `teapot`, `teapot:LEVEL`, `dragon`, `dragon_res2`, `dragon_res3`, `dragon_res4`, `sponza`, or the path of a
/// file. A scene's name comes first; write `./dragon` for a file of that name.
///
/// ```
/// use raykd::mesh::MeshSource;
///
/// let source: MeshSource = "teapot:2".parse()?;
/// assert_eq!(source.load()?.triangles().len(), 256);
/// # Ok::<_, raykd::mesh::MeshError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshSource {
    /// The Utah teapot with each of its patches cut into so many by so many quads.
    Teapot(u32),
    /// A mesh that `cargo xtask scenes` fetches. It is looked for in the folder that `RAYKD_SCENES` names; else in
    /// `scenes` here and in the folders above, as in a checkout of raykd, then in `raykd/scenes` of the user's data
    /// folder.
    Fetched {
        /// Its name.
        name: &'static str,
        /// Its file in one of these folders.
        file: &'static str,
    },
    /// A mesh file.
    File(PathBuf),
}

impl FromStr for MeshSource {
    type Err = MeshError;

    fn from_str(text: &str) -> Result<Self, MeshError> {
        if text == "teapot" {
            return Ok(Self::Teapot(DEFAULT_LEVEL));
        }
        if let Some(&(name, file)) = FETCHED.iter().find(|(name, _)| *name == text) {
            return Ok(Self::Fetched { name, file });
        }
        if let Some(level) = text.strip_prefix("teapot:").and_then(|level| level.parse().ok())
            && (1..=teapot::MAX_LEVEL).contains(&level)
        {
            return Ok(Self::Teapot(level));
        }
        Self::file(Path::new(text))
    }
}

impl TryFrom<&OsStr> for MeshSource {
    type Error = MeshError;

    /// As [`str::parse`] does; a path need not be UTF-8.
    fn try_from(name: &OsStr) -> Result<Self, MeshError> {
        name.to_str().map_or_else(|| Self::file(Path::new(name)), str::parse)
    }
}

impl fmt::Display for MeshSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Teapot(DEFAULT_LEVEL) => f.write_str("teapot"),
            Self::Teapot(level) => write!(f, "teapot:{level}"),
            Self::Fetched { name, .. } => f.write_str(name),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

impl MeshSource {
    /// Something that looks like a path gets the system's own words if it cannot be read.
    fn file(path: &Path) -> Result<Self, MeshError> {
        if path.exists() || path.extension().is_some() || path.components().count() > 1 {
            return Ok(Self::File(path.to_owned()));
        }
        Err(MeshError::UnknownScene { name: quoted_bytes(path.as_os_str().as_encoded_bytes()) })
    }

    /// Its file. None if it has none, or is a scene that was not fetched.
    pub fn path(&self) -> Option<PathBuf> {
        match self {
            Self::Teapot(_) => None,
            Self::Fetched { file, .. } => folders().iter().map(|f| f.join(file)).find(|path| path.exists()),
            Self::File(path) => Some(path.clone()),
        }
    }

    /// Reads or makes the mesh.
    ///
    /// # Errors
    /// If its file is missing or unusable, or too large as [`Mesh::load`] has it.
    pub fn load(&self) -> Result<Mesh, MeshError> {
        self.load_by(|path| Mesh::load(path))
    }

    /// Like [`MeshSource::load`], with a limit of bytes as [`Mesh::load_up_to`] has it.
    ///
    /// # Errors
    /// If its file is missing or unusable, or larger.
    pub fn load_up_to(&self, max_bytes: u64) -> Result<Mesh, MeshError> {
        self.load_by(|path| Mesh::load_up_to(path, max_bytes))
    }

    fn load_by(&self, load: impl FnOnce(&Path) -> Result<Mesh, MeshError>) -> Result<Mesh, MeshError> {
        match self {
            Self::Teapot(level) => Ok(Mesh::teapot(*level)),
            Self::Fetched { name, file } => match self.path() {
                Some(path) => load(&path),
                None => Err(MeshError::MissingScene {
                    name: (*name).to_owned(),
                    file: (*file).to_owned(),
                    folders: folders(),
                }),
            },
            Self::File(path) => load(path),
        }
    }
}

/// Where fetched scenes are looked for, see [`MeshSource::Fetched`].
fn folders() -> Vec<PathBuf> {
    if let Some(folder) = std::env::var_os("RAYKD_SCENES").filter(|f| !f.is_empty()) {
        return vec![folder.into()];
    }
    let here = std::env::current_dir().unwrap_or_default();
    let above = here.ancestors().map(|folder| folder.join("scenes")).filter(|folder| folder.is_dir());
    let users = of_user("XDG_DATA_HOME", ".local/share", "Library/Application Support");
    above.chain(users.map(|folder| folder.join("scenes"))).collect()
}

/// raykd's folder among the user's own: in the one that a variable names, or the system's.
pub(crate) fn of_user(variable: &str, at_home: &str, on_mac: &str) -> Option<PathBuf> {
    let folder = |name| std::env::var_os(name).filter(|folder| !folder.is_empty()).map(PathBuf::from);
    let at_home = if cfg!(target_os = "macos") { on_mac } else { at_home };
    let own = folder(variable).or_else(|| folder("LOCALAPPDATA"));
    Some(own.or_else(|| Some(folder("HOME")?.join(at_home)))?.join("raykd"))
}
