//! Memory on a device, and what is read of it.

use super::Memory;
use crate::Error;
use raykd_kernels::Host;
#[cfg(feature = "gpu")]
use rayon::prelude::*;
use std::{
    marker::PhantomData,
    ops::Deref,
    sync::{
        Arc,
        atomic::{Ordering, fence},
    },
};

/// Memory on a [`Device`](super::Device). Clones share it.
#[derive(Clone, Debug)]
pub struct AnyBuffer {
    pub(super) name: &'static str,
    pub(super) bytes: u64,
    pub(super) memory: Memory,
    /// Counted: a pool that has the only one may give the memory to somebody else.
    pub(super) users: Arc<()>,
}

impl AnyBuffer {
    pub(super) fn of(name: &'static str, bytes: u64, memory: Memory) -> Self {
        Self { name, bytes, memory, users: Arc::default() }
    }

    /// The name it was allocated under.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Its size in bytes.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether nobody else has it, or reads what it holds.
    pub(super) fn is_free(&self) -> bool {
        let is_read = match &self.memory {
            Memory::Cpu(memory) => memory.is_shared(),
            #[cfg(feature = "gpu")]
            Memory::Gpu(_) => false,
        };
        let free = Arc::strong_count(&self.users) == 1 && !is_read;
        // Counts alone do not say that what others did with it is over.
        fence(Ordering::Acquire);
        free
    }

    /// Bytes of its memory, of which it may use a part.
    pub(super) fn room(&self) -> u64 {
        match &self.memory {
            Memory::Cpu(memory) => memory.len(),
            #[cfg(feature = "gpu")]
            Memory::Gpu(memory) => memory.size(),
        }
    }

    /// The same memory as elements of some type.
    pub fn view<T>(&self) -> Buffer<T> {
        Buffer { any: self.clone(), of: PhantomData }
    }

    /// The same as elements of some type.
    pub(super) fn into_typed<T>(self) -> Buffer<T> {
        Buffer { any: self, of: PhantomData }
    }

    /// What is to be read from its start once kernels have run.
    pub(crate) fn back<'a, T: bytemuck::Pod + Send + Sync>(&'a self, to: To<'a, T>) -> Back<'a> {
        match to {
            To::Room(room) => self.back_from(0, room),
            To::End(list, count) => {
                const { assert!(size_of::<T>().is_power_of_two() && align_of::<T>() <= 4, "parts hold them") };
                let offset = self.place("read", size_of::<T>(), 0, count);
                list.reserve(count);
                let take = move |part: &[u8]| {
                    let elements: &[T] = bytemuck::cast_slice(part);
                    #[cfg(feature = "gpu")]
                    if part.len() > PIECE {
                        return list.par_extend(elements.par_iter().with_min_len(PIECE / size_of::<T>()));
                    }
                    list.extend_from_slice(elements);
                };
                Back { buffer: self, offset, bytes: count * size_of::<T>(), take: Box::new(take) }
            }
        }
    }

    /// What is to be read from the element numbered `from` on, as much as there is room for.
    pub(crate) fn back_from<'a, T: bytemuck::Pod>(&'a self, from: u64, room: &'a mut [T]) -> Back<'a> {
        let offset = self.place("read", size_of::<T>(), from, room.len());
        let bytes = size_of_val(room);
        let mut rest: &mut [u8] = bytemuck::cast_slice_mut(room);
        let take = move |part: &[u8]| {
            let (now, later) = std::mem::take(&mut rest).split_at_mut(part.len());
            rest = later;
            #[cfg(feature = "gpu")]
            if part.len() > PIECE {
                let pieces = now.par_chunks_mut(PIECE).zip(part.par_chunks(PIECE));
                return pieces.for_each(|(now, part)| now.copy_from_slice(part));
            }
            now.copy_from_slice(part);
        };
        Back { buffer: self, offset, bytes, take: Box::new(take) }
    }

    /// Where `count` elements of `size` bytes begin from the one numbered `from` on. Panics if they do not lie inside.
    pub(super) fn place(&self, act: &str, size: usize, from: u64, count: usize) -> u64 {
        let begin = from.checked_mul(size as u64);
        let bytes = count.checked_mul(size).map(|bytes| bytes as u64);
        let end = begin.zip(bytes).and_then(|(begin, bytes)| begin.checked_add(bytes));
        let inside = begin.filter(|_| end.is_some_and(|end| end <= self.bytes));
        inside.unwrap_or_else(|| panic!("{act} past the end of {}", self.name))
    }
}

/// A buffer of elements of type `T`. Clones share the memory.
#[derive(Debug)]
pub struct Buffer<T> {
    pub(super) any: AnyBuffer,
    of: PhantomData<fn() -> T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        self.any.view()
    }
}

impl<T> Deref for Buffer<T> {
    type Target = AnyBuffer;
    fn deref(&self) -> &AnyBuffer {
        &self.any
    }
}

impl<T> Buffer<T> {
    /// How many elements it holds.
    pub const fn elements(&self) -> usize {
        self.any.bytes as usize / size_of::<T>()
    }

    /// The buffer with all the memory that is there: where that was used before, it may be more than was asked for.
    pub(crate) fn whole(self) -> Self {
        let bytes = match &self.any.memory {
            Memory::Cpu(_) => self.any.bytes,
            #[cfg(feature = "gpu")]
            Memory::Gpu(memory) => memory.size(),
        };
        Self { any: AnyBuffer { bytes, ..self.any }, of: PhantomData }
    }

    /// The buffer for its first `count` elements.
    pub(crate) fn first(mut self, count: u32) -> Self {
        self.any.bytes = whole_bytes(count.into(), size_of::<T>()).min(self.any.bytes);
        self
    }

    /// The buffer, to be written by a kernel.
    pub const fn out(&self) -> Out<'_, T> {
        Out(self)
    }
}

/// Where elements go that are read.
#[derive(Debug)]
pub(crate) enum To<'a, T> {
    /// Into memory that is there, which they fill.
    Room(&'a mut [T]),
    /// So many to the end of a list: new memory need not be zeroed first, which takes as long as to fill it.
    End(&'a mut Vec<T>, usize),
}

/// What is given bytes that were read.
type Take<'a> = Box<dyn FnMut(&[u8]) + Send + 'a>;

/// What is to be read of a buffer.
pub(crate) struct Back<'a> {
    pub(super) buffer: &'a AnyBuffer,
    pub(super) offset: u64,
    pub(super) bytes: usize,
    /// Is given the bytes, in one part or several.
    pub(super) take: Take<'a>,
}

/// Bytes that one thread copies at least. One alone moves much less than a bus, the more so into memory that the
/// process has never touched. So many, or fewer, are copied by the thread that asks.
pub(super) const PIECE: usize = 256 << 10;

/// Makes room in a list for so many.
pub fn reserve<T>(list: &mut Vec<T>, name: &'static str, count: u64) -> Result<(), Error> {
    let bytes = count.saturating_mul(size_of::<T>() as u64);
    let reserved = usize::try_from(count).ok().and_then(|count| list.try_reserve_exact(count).ok());
    reserved.ok_or(Error::OutOfMemory { buffer: name, bytes })
}

/// Bytes of a buffer of so many elements: some, and a multiple of 16.
pub(super) const fn whole_bytes(count: u64, element: usize) -> u64 {
    match count.saturating_mul(element as u64) {
        0 => 16,
        bytes => bytes.div_ceil(16).saturating_mul(16),
    }
}

/// A buffer that a kernel writes.
#[derive(Debug)]
pub struct Out<'a, T>(&'a Buffer<T>);

/// How a [`Device`](super::Device) refers to the buffers of a kernel.
#[derive(Debug)]
pub enum OnDevice {}

impl Host for OnDevice {
    type Read<'a, T: 'static> = &'a Buffer<T>;
    type Write<'a, T: 'static> = Out<'a, T>;
    type Any<'a> = &'a AnyBuffer;

    fn read<'a, T: 'static>(buffer: Self::Read<'a, T>) -> Self::Any<'a> {
        &buffer.any
    }

    fn write<'a, T: 'static>(buffer: Self::Write<'a, T>) -> Self::Any<'a> {
        &buffer.0.any
    }
}
