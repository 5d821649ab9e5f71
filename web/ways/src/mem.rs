//! Buffers that remember what was read of them.

pub(crate) use raykd_kernels::mem::{Slots, scratch, stack};
use std::{cell::RefCell, rc::Rc};

/// What a traversal looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Seen {
    /// The children of an inner node: their pair's number.
    Pair(u32),
    /// A leaf, by its first reference.
    Leaf(u32),
}

/// What was looked at, in that order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Log(Rc<RefCell<Vec<Seen>>>);

impl Log {
    pub(crate) fn add(&self, seen: Seen) {
        self.0.borrow_mut().push(seen);
    }

    pub(crate) fn take(&self) -> Vec<Seen> {
        self.0.take()
    }
}

/// A buffer of the kernels; if it is watched, what is read of it is written down.
#[derive(Debug)]
pub(crate) struct Buf<T> {
    all: Vec<T>,
    log: Option<Log>,
}

impl<T: Copy> Buf<T> {
    pub(crate) const fn of(all: Vec<T>) -> Self {
        Self { all, log: None }
    }

    pub(crate) fn watch(&mut self, log: &Log) {
        self.log = Some(log.clone());
    }

    /// Reads an element, and nobody hears of it.
    pub(crate) fn peek(&self, i: u32) -> T {
        self.all[i as usize]
    }
}

impl<T: Copy> Slots<T> for Buf<T> {
    fn at(&self, i: u32) -> T {
        if let Some(log) = &self.log {
            log.add(Seen::Pair(i));
        }
        self.peek(i)
    }

    fn put(&mut self, i: u32, value: T) {
        self.all[i as usize] = value;
    }
}
