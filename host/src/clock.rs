//! The clock that times are taken by.

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use std::time::Instant;
// The standard library's has no time in a browser.
#[cfg(target_arch = "wasm32")]
pub(crate) use web_time::Instant;
