//! Files as memory that processes share.

use memmap2::{MmapOptions, MmapRaw};
use std::{
    fs::{self, File},
    io,
    path::Path,
    sync::Arc,
};

/// A file's bytes, in pages that all processes share which map it. They must not be written. Clones are the same map.
#[derive(Clone, Debug)]
pub(crate) struct MappedFile(Arc<MmapRaw>);

impl MappedFile {
    /// Maps a whole file.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        // Asked before it is opened: a pipe would wait for somebody who writes.
        if !fs::metadata(path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "this is no regular file"));
        }
        Ok(Self(Arc::new(MmapOptions::new().map_raw_read_only(&File::open(path)?)?)))
    }

    /// How many bytes it has.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Where they begin: at a page.
    pub(super) fn start(&self) -> *mut u8 {
        self.0.as_mut_ptr()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::Device;

    #[test]
    fn a_part_of_a_file_is_read_and_never_written() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let words: Vec<u32> = (0..100).collect();
        fs::write(file.path(), bytemuck::cast_slice(&words)).unwrap();
        let (device, map) = (Device::cpu(), MappedFile::open(file.path()).unwrap());
        let part = device.share::<u32>("part", &map, 64, 20).unwrap();
        assert_eq!(device.read(&part, 0, 20).unwrap(), words[16..36]);
        let write = || device.write(&part, 0, &[1]);
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(write)).is_err());
        let past = || device.share::<u32>("part", &map, 64, 85);
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(past)).is_err());
        assert_eq!(fs::read(file.path()).unwrap(), bytemuck::cast_slice::<_, u8>(&words));
    }
}
