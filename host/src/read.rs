//! Reading files, but not without end.

use crate::Error;
use raykd_shared::limits::MAX_TRIANGLES;
use std::{
    fs::{self, File},
    io::{self, Read},
    path::Path,
};

/// Bytes that are read of one file, unpacked, unless more are allowed: four times what a mesh of as many triangles as
/// there can be takes as binary PLY, or a quarter of the memory of this machine (of 8 GiB where that cannot be
/// told), whichever is less.
pub fn default_max_bytes() -> u64 {
    // A face takes 13 bytes, a vertex 12, and there are half as many vertices as faces.
    const LARGEST: u64 = MAX_TRIANGLES as u64 * (13 + 12 / 2);
    (4 * LARGEST).min(memory().unwrap_or(8 << 30) / 4)
}

/// Memory that this process may use, on Linux: what the machine has, or what its control group or `ulimit -v` leaves of
/// that.
fn memory() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).ok();
    let total = read("/proc/meminfo")?;
    let kib: u64 = total
        .lines()
        .find_map(|line| line.strip_prefix("MemTotal:"))?
        .split_whitespace()
        .next()?
        .parse()
        .ok()?;
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let allowed = group.iter().filter_map(|path| read(path)?.trim().parse().ok());
    let limits = read("/proc/self/limits").unwrap_or_default();
    let addresses = limits.lines().find_map(|line| line.strip_prefix("Max address space"));
    let addresses = addresses.and_then(|line| line.split_whitespace().next()?.parse().ok());
    allowed.chain([kib * 1024]).chain(addresses).min()
}

/// All bytes there are, or none if there are more than the limit. `expected` is a guess.
pub(crate) fn up_to(from: impl Read, limit: u64, expected: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(expected.min(limit) as usize)?;
    from.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

/// A file's bytes, or none if there are more than the limit.
pub(crate) fn file(path: &Path, limit: u64) -> io::Result<Option<Vec<u8>>> {
    let file = File::open(path)?;
    let about = file.metadata()?;
    // What is no plain file, as a pipe or `/dev/stdin`, does not know how long it is.
    if about.is_file() && about.len() > limit { Ok(None) } else { up_to(file, limit, about.len()) }
}

/// A file's bytes.
///
/// # Errors
/// It cannot be read, or there are more than the limit.
pub fn all_of(path: &Path, limit: u64) -> Result<Vec<u8>, Error> {
    let bytes = file(path, limit).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    bytes.ok_or_else(|| Error::TooLong { path: path.to_owned(), limit })
}
