//! What `raykd devices` can be told.

use clap::Parser;

const EXAMPLES: &str = "\
Every adapter computes some thousand sums and products, which are compared with the CPU's. One
that rounds otherwise, contracts or rearranges would build other trees: it is refused, unless
RAYKD_ALLOW_INEXACT=1 is set.

Examples:
  raykd devices
  raykd devices --json | jq -r '.[].adapter'";

/// List what raykd can run on: adapters, drivers, limits, and whether they compute exactly.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
