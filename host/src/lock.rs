//! Locks of what no panic leaves half done.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Takes a lock, whatever became of the thread that had it.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
