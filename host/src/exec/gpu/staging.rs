//! Transfers between host and device through mapped buffers that are kept.

use super::link::Link;
use crate::{
    Error,
    exec::{Back, PIECE},
};
use rayon::prelude::*;
use std::sync::mpsc::{Receiver, channel};

/// Bytes of one staging buffer. Two of them take turns, so that the device copies one while the host fills or
/// empties the other.
pub(super) const CHUNK: usize = 8 << 20;

/// A page, as which pieces of mapped memory can be handed to threads.
const PAGE: usize = 4096;

/// A buffer that the host maps whenever the device is done with it.
#[derive(Debug)]
pub(super) struct Slot {
    pub(super) buffer: wgpu::Buffer,
    mode: wgpu::MapMode,
    /// The submission that uses it, and where its mapping will be announced.
    pending: Option<(wgpu::SubmissionIndex, Receiver<Result<(), wgpu::BufferAsyncError>>)>,
}

impl Slot {
    /// A buffer that the host writes and the device copies from; mapped.
    pub(super) fn upload(link: &Link, bytes: u64) -> Result<Self, Error> {
        let usage = wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC;
        let buffer = link.buffer("upload staging", bytes, usage)?;
        Ok(Self { buffer, mode: wgpu::MapMode::Write, pending: None })
    }

    /// A buffer that the device copies to and the host reads; not mapped.
    pub(super) fn download(link: &Link, bytes: u64) -> Result<Self, Error> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let buffer = link.buffer("download staging", bytes, usage)?;
        Ok(Self { buffer, mode: wgpu::MapMode::Read, pending: None })
    }

    /// Submits commands that use the buffer (unmapped now), after which its first `bytes` bytes are mapped.
    pub(super) fn submit(
        &mut self,
        link: &Link,
        commands: wgpu::CommandEncoder,
        bytes: u64,
    ) -> Result<(), Error> {
        let (done, signal) = channel();
        commands.map_buffer_on_submit(&self.buffer, self.mode, 0..bytes, move |result| {
            let _ = done.send(result);
        });
        self.pending = Some((link.submit(commands)?, signal));
        Ok(())
    }

    /// Waits until the submission is done and the buffer mapped.
    pub(super) fn mapped(&mut self, link: &Link) -> Result<(), Error> {
        let Some((submission, signal)) = self.pending.take() else { return Ok(()) };
        let mut told = None;
        let is_told = || {
            told = signal.try_recv().ok();
            told.is_some()
        };
        if !link.ask(is_told)? {
            link.wait(submission)?;
        }
        match told.map_or_else(|| signal.recv(), Ok) {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(link.failed(format_args!("mapping a buffer: {error}"))),
            Err(_) => Err(link.failed("mapping a buffer: given up")),
        }
    }

    /// Shows the mapped buffer's first bytes and unmaps it.
    pub(super) fn take(&self, link: &Link, bytes: u64, show: impl FnOnce(&[u8])) -> Result<(), Error> {
        let view = self.buffer.get_mapped_range(0..bytes).map_err(|e| link.failed(e))?;
        show(&view);
        drop(view);
        self.buffer.unmap();
        Ok(())
    }

    /// Fills the mapped buffer's first bytes with `data` and unmaps it.
    fn give(&self, link: &Link, data: &[u8]) -> Result<(), Error> {
        let view = self.buffer.get_mapped_range_mut(0..data.len() as u64);
        let mut view = view.map_err(|e| link.failed(e))?;
        let (whole, rest) = data.as_chunks::<PAGE>();
        let (to, mut to_rest) = view.slice(..).into_chunks::<PAGE>();
        let pages: Vec<_> = to.into_iter().zip(whole).collect();
        pages.into_par_iter().with_min_len(PIECE / PAGE).for_each(|(to, page)| to.write(*page));
        to_rest.copy_from_slice(rest);
        drop(view);
        self.buffer.unmap();
        Ok(())
    }
}

/// Writes `data` to `target` from byte `offset` on. The last of it is on its way, and is there before what is submitted
/// next.
pub(super) fn upload(
    link: &Link,
    slots: &mut [Slot; 2],
    target: &wgpu::Buffer,
    offset: u64,
    data: &[u8],
) -> Result<(), Error> {
    for (i, part) in data.chunks(CHUNK).enumerate() {
        let slot = &mut slots[i % 2];
        slot.mapped(link)?;
        slot.give(link, part)?;
        let mut commands = link.encoder();
        let at = offset + (i * CHUNK) as u64;
        commands.copy_buffer_to_buffer(&slot.buffer, 0, target, at, part.len() as u64);
        slot.submit(link, commands, CHUNK as u64)?;
    }
    Ok(())
}

/// Reads what is wanted, one byte at least.
pub(super) fn download(link: &Link, slots: &mut [Slot; 2], back: &mut Back<'_>) -> Result<(), Error> {
    let Back { buffer, offset, bytes, take } = back;
    let (source, offset, bytes) = (buffer.as_wgpu(), *offset, *bytes);
    let part = |from: usize| CHUNK.min(bytes - from) as u64;
    let request = |slot: &mut Slot, from: usize| {
        let mut commands = link.encoder();
        commands.copy_buffer_to_buffer(source, offset + from as u64, &slot.buffer, 0, part(from));
        slot.submit(link, commands, part(from))
    };
    request(&mut slots[0], 0)?;
    for (i, from) in (0..bytes).step_by(CHUNK).enumerate() {
        if from + CHUNK < bytes {
            request(&mut slots[(i + 1) % 2], from + CHUNK)?;
        }
        let slot = &mut slots[i % 2];
        slot.mapped(link)?;
        slot.take(link, part(from), &mut *take)?;
    }
    Ok(())
}
