//! For tests: watching a thread's dispatches one by one, on buffers that start as garbage.

use super::{AnyBuffer, Device, Step, Timing};
use crate::Error;
use std::cell::RefCell;

/// Is shown every step after it ran. What it calls an error is the step's.
pub type Watcher = Box<dyn FnMut(&Device, &Step<'_>) -> Result<(), Error>>;

/// What every byte of a buffer is when it is allocated by a thread that watches.
pub const POISON: u8 = 0xA5;

thread_local! {
    static WATCHER: RefCell<Option<Watcher>> = const { RefCell::new(None) };
}

/// Watches this thread's dispatches, on any device, while `act` runs. Not to be nested.
pub fn watching<R>(watcher: Watcher, act: impl FnOnce() -> R) -> R {
    /// Stops watching, after a panic too.
    struct Stop;
    impl Drop for Stop {
        fn drop(&mut self) {
            WATCHER.set(None);
        }
    }
    WATCHER.set(Some(watcher));
    let _stop = Stop;
    act()
}

pub(crate) fn is_on() -> bool {
    WATCHER.with_borrow(Option::is_some)
}

pub(super) fn poison(device: &Device, buffer: &AnyBuffer) -> Result<(), Error> {
    if is_on() { device.write(&buffer.view(), 0, &vec![POISON; buffer.bytes as usize]) } else { Ok(()) }
}

pub(super) fn one_by_one(device: &Device, steps: &[Step<'_>]) -> Result<Timing, Error> {
    let mut all = Timing::default();
    for step in steps {
        let one = device.dispatch(std::slice::from_ref(step), false)?;
        all.total += one.total;
        all.steps.push(one.total);
    }
    Ok(all)
}

pub(super) fn tell(device: &Device, steps: &[Step<'_>]) -> Result<(), Error> {
    // Taken out meanwhile: the watcher reads buffers, which may run something itself.
    let Some(mut watcher) = WATCHER.take() else { return Ok(()) };
    let told = steps.iter().try_for_each(|step| watcher(device, step));
    WATCHER.set(Some(watcher));
    told
}
