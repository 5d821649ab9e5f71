//! How much is read of files.

use super::values::bytes;

/// How much is read of files.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct ReadArgs {
    /// Most that is read of one file, unpacked, in bytes or as 20G (also K, M, T: powers of 1024); left out: what suits
    /// this machine's memory
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub max_bytes: Option<u64>,
}

impl ReadArgs {
    /// In bytes.
    pub(crate) fn limit(self) -> u64 {
        self.max_bytes.unwrap_or_else(raykd::default_max_bytes)
    }
}
