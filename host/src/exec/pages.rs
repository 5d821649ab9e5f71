//! Memory of pages: zeros, and files, which processes may share.

use memmap2::{MmapMut, MmapOptions, MmapRaw};
use std::{
    fs::{self, File},
    io::{self, Read as _},
    path::Path,
    sync::Arc,
};

/// A file's bytes, which must not be written. Clones are the same memory.
#[derive(Clone, Debug)]
pub(crate) struct FileBytes(Arc<MmapRaw>);

impl FileBytes {
    /// Reads a whole file.
    pub(crate) fn read(path: &Path) -> io::Result<Self> {
        let mut file = regular(path)?;
        let mut bytes = pages(file.metadata()?.len().try_into().unwrap_or(usize::MAX))?;
        file.read_exact(&mut bytes)?;
        Ok(Self(Arc::new(bytes.into())))
    }

    /// Maps a whole file: all processes that do share the pages.
    ///
    /// # Safety
    /// The file does not change as long as this or a clone of it lives.
    pub(crate) unsafe fn map(path: &Path) -> io::Result<Self> {
        Ok(Self(Arc::new(MmapOptions::new().map_raw_read_only(&regular(path)?)?)))
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

/// So many bytes of zeros.
pub(super) fn pages(len: usize) -> io::Result<MmapMut> {
    let map = MmapMut::map_anon(len)?;
    // Traversal jumps about; finding small pages would cost it more than reading them.
    #[cfg(target_os = "linux")]
    let _ = map.advise(memmap2::Advice::HugePage);
    Ok(map)
}

/// The first bytes of a file, no more than `most`, and how many it has.
pub(crate) fn start_of(path: &Path, most: usize) -> io::Result<(Vec<u8>, u64)> {
    let file = regular(path)?;
    let (mut start, length) = (Vec::new(), file.metadata()?.len());
    file.take(most as u64).read_to_end(&mut start)?;
    Ok((start, length))
}

/// Opens a file that has a length.
fn regular(path: &Path) -> io::Result<File> {
    // Asked before it is opened: a pipe would wait for somebody who writes.
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "this is no regular file"));
    }
    File::open(path)
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
        let device = Device::cpu();
        // SAFETY: the file is this test's alone.
        let map = unsafe { FileBytes::map(file.path()) }.unwrap();
        let part = device.share::<u32>("part", &map, 64, 20).unwrap();
        assert_eq!(device.read(&part, 0, 20).unwrap(), words[16..36]);
        let write = || device.write(&part, 0, &[1]);
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(write)).is_err());
        let past = || device.share::<u32>("part", &map, 64, 85);
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(past)).is_err());
        assert_eq!(fs::read(file.path()).unwrap(), bytemuck::cast_slice::<_, u8>(&words));
    }
}
