//! What kernels report to the host: a bit set, or-ed into one word, that the host turns into an error or a retry.

/// A buffer of the level loop was too short; the host retries with more room.
pub const CAPACITY: u32 = 1;
/// The level loop ended with large nodes left over; the host encodes more levels.
pub const LEVELS: u32 = 2;
/// An index pointed outside its buffer: a bug or a damaged tree.
pub const BAD_INDEX: u32 = 4;
/// The traversal stack was full: the tree is deeper than its header says.
pub const STACK: u32 = 8;
