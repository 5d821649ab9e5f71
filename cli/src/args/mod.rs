//! Options that several commands have.

mod machine;
mod read;
mod tree;
mod values;

pub(super) use machine::{MachineArgs, One, OneArgs, Which, WhichArgs, at_once};
pub(super) use read::ReadArgs;
pub(super) use tree::{HowArgs, Quality, TreeArgs, WalkArgs};
pub(super) use values::{direction, one_of, point, size, whole, within};
