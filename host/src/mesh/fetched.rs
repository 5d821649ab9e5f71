//! The scenes that `cargo xtask scenes` fetches.

/// Name and file of each.
pub(super) const FETCHED: [(&str, &str); 5] = [
    ("dragon", "dragon.ply.gz"),
    ("dragon_res2", "dragon_res2.ply.gz"),
    ("dragon_res3", "dragon_res3.ply.gz"),
    ("dragon_res4", "dragon_res4.ply.gz"),
    ("sponza", "sponza.obj"),
];

/// Their names, for messages.
pub(super) fn names() -> String {
    FETCHED.map(|(name, _)| name).join(", ")
}
