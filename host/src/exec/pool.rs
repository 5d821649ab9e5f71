//! Memory that a build leaves for the next one.

use super::AnyBuffer;
use crate::lock::lock;
use std::sync::Mutex;

#[derive(Debug, Default)]
pub(super) struct Pool {
    /// Buffers that some [`Device`](super::Device) has given out, and gives out again once they are free.
    buffers: Mutex<Vec<AnyBuffer>>,
}

impl Pool {
    /// A free buffer of this name with room for so many bytes. Smaller free ones are given up, as they will hardly be
    /// of use any more.
    pub(super) fn take(&self, name: &str, bytes: u64) -> Option<AnyBuffer> {
        let mut buffers = lock(&self.buffers);
        let free = |buffer: &AnyBuffer| buffer.name == name && buffer.is_free();
        let fits = buffers.iter().filter(|buffer| free(buffer) && buffer.room() >= bytes);
        let found = fits.min_by_key(|buffer| buffer.room()).cloned();
        if found.is_none() {
            buffers.retain(|buffer| !free(buffer));
        }
        found.map(|buffer| AnyBuffer { bytes, ..buffer })
    }

    /// Keeps a buffer, to be taken when nobody else has it.
    pub(super) fn keep(&self, buffer: AnyBuffer) {
        lock(&self.buffers).push(buffer);
    }
}

/// What to ask for where so many bytes are needed now: something more, as the next mesh may need it.
pub(super) const fn with_room_to_grow(bytes: u64) -> u64 {
    (bytes + bytes / 8).next_multiple_of(256)
}
