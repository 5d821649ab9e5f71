//! What kernels report to the host: a bit set, or-ed into one word, that the host turns into an error or a
//! retry.

/// A buffer of the level loop was too short, or made for another mesh than was found; the host tries again.
pub const CAPACITY: u32 = 1;
/// The level loop ended with large nodes left over; the host encodes more levels.
pub const LEVELS: u32 = 2;
/// The traversal stack was full: the tree is deeper than its header says.
pub const STACK: u32 = 8;
/// The driver left a loop early: llvmpipe does after 65,535 rounds. The result is not to be used.
pub const CUT_SHORT: u32 = 16;

/// What a set of bits means, for messages.
pub const fn describe(bits: u32) -> &'static str {
    if bits & CUT_SHORT != 0 {
        "the driver cut a long loop short, as llvmpipe does after 65,535 rounds; use --device cpu"
    } else if bits & STACK != 0 {
        "the tree is deeper than its header says"
    } else if bits & LEVELS != 0 {
        "the level loop was too short"
    } else {
        "a buffer was too short"
    }
}
