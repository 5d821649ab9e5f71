//! What can be asked of rays.

/// What is asked of each ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Query {
    /// The hit with the smallest `t`; of several, the one with the lowest triangle number.
    #[default]
    Closest,
    /// Some hit, if there is one: enough for shadows. Which one depends on tree, traversal and triangle test, not on
    /// the device.
    Any,
}
