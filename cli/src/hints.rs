//! What a user of the program can do about an error of the library, which knows no options.

use raykd::{Error, TreeError, mesh::MeshError};

/// An error in the library's words, and what to do about it in the program's.
pub(super) fn told(error: &Error) -> String {
    format!("{error}{}", hint(error))
}

/// What follows the words of an error, if it is one of the library's; nothing if they say it all.
pub(super) fn of(error: &(dyn std::error::Error + 'static)) -> &'static str {
    match (error.downcast_ref(), error.downcast_ref()) {
        (Some(error), _) => hint(error),
        (_, Some(error)) => of_mesh(error),
        _ => "",
    }
}

const fn hint(error: &Error) -> &'static str {
    match error {
        Error::Mesh(error) => of_mesh(error),
        Error::TooLong { .. } => MORE,
        Error::TooLarge { .. } => ", as by --device cpu",
        Error::NoAdapter { wanted: Some(_) } => " (`raykd devices` lists the adapters there are)",
        Error::Inexact { .. } => {
            "; to use it all the same, name it with --adapter and set RAYKD_ALLOW_INEXACT=1"
        }
        Error::Lacking { .. } => "; use --device cpu",
        Error::DeviceFailed { .. } => ": --device cpu",
        Error::Calibration { .. } => "; `raykd calibrate` measures anew",
        Error::Tree { why: TreeError::NoTreeFile | TreeError::SceneFile, .. } => {
            "; on the command line: raykd build MESH -o FILE"
        }
        _ => "",
    }
}

/// Behind "allow more".
const MORE: &str = " by --max-bytes";

const fn of_mesh(error: &MeshError) -> &'static str {
    match error {
        MeshError::TooLong { .. } => MORE,
        _ => "",
    }
}
