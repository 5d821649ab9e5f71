//! Timestamps of the device.

use super::{link::Link, staging::Slot};
use crate::{
    Error,
    exec::{Back, Timing},
};
use std::time::Duration;

/// Bytes of one timestamp.
const STAMP: u64 = wgpu::QUERY_SIZE as u64;
/// Timestamps in one set.
const PER_SET: u32 = wgpu::QUERY_SET_MAX_QUERIES;
/// Steps that one pass can time each: one more timestamp than steps.
pub(super) const STEPS_PER_PASS: usize = PER_SET as usize - 1;

/// One set of timestamps per compute pass.
#[derive(Debug)]
pub(super) struct Clock {
    pub(super) sets: Vec<wgpu::QuerySet>,
    resolved: wgpu::Buffer,
    readback: Slot,
    /// Nanoseconds per tick.
    period: f64,
}

impl Clock {
    /// Features that the clock needs; Vulkan devices have both or none.
    pub(super) const FEATURES: wgpu::Features =
        wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES);

    /// A clock for up to `passes` passes.
    pub(super) fn new(link: &Link, passes: usize) -> Result<Self, Error> {
        let descriptor =
            wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: PER_SET };
        let bytes = passes as u64 * u64::from(PER_SET) * STAMP;
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        Ok(Self {
            sets: link.guard("creating timestamps", || {
                (0..passes).map(|_| link.device.create_query_set(&descriptor)).collect()
            })?,
            resolved: link.buffer("timestamps", bytes, usage)?,
            readback: Slot::download(link, bytes)?,
            period: f64::from(link.queue.get_timestamp_period()),
        })
    }

    /// Submits commands whose passes wrote the first `stamps[pass]` timestamps of their sets, waits for the
    /// end, and gives the times between them; those of single steps if `profile`. Reads what is wanted back beside:
    /// some bytes, if nothing is timed.
    pub(super) fn finish(
        &mut self,
        link: &Link,
        mut commands: wgpu::CommandEncoder,
        stamps: &[u32],
        profile: bool,
        back: &mut [Back<'_>],
    ) -> Result<Timing, Error> {
        let stride = u64::from(PER_SET) * STAMP;
        let bytes = match *stamps {
            [] => 0,
            [ref full @ .., last] => full.len() as u64 * stride + u64::from(last) * STAMP,
        };
        let needed = bytes + back.iter().map(|back| back.bytes as u64).sum::<u64>();
        if needed > self.readback.buffer.size() {
            self.readback = Slot::download(link, needed.next_power_of_two())?;
        }
        for (i, (&count, set)) in stamps.iter().zip(&self.sets).enumerate() {
            commands.resolve_query_set(set, 0..count, &self.resolved, i as u64 * stride);
        }
        if bytes > 0 {
            commands.copy_buffer_to_buffer(&self.resolved, 0, &self.readback.buffer, 0, bytes);
        }
        let mut all = bytes;
        for Back { buffer, offset, bytes, .. } in back.iter().filter(|back| back.bytes > 0) {
            commands.copy_buffer_to_buffer(
                buffer.as_wgpu(),
                *offset,
                &self.readback.buffer,
                all,
                *bytes as u64,
            );
            all += *bytes as u64;
        }
        self.readback.submit(link, commands, all)?;
        self.readback.mapped(link)?;
        let mut ticks: Vec<u64> = Vec::new();
        self.readback.take(link, all, |words| {
            let (stamps, mut rest) = words.split_at(bytes as usize);
            ticks = bytemuck::pod_collect_to_vec(stamps);
            for Back { bytes, take, .. } in back {
                let (now, later) = rest.split_at(*bytes);
                take(now);
                rest = later;
            }
        })?;

        let time = |from: u64, to: u64| {
            Duration::from_nanos((to.saturating_sub(from) as f64 * self.period).round() as u64)
        };
        let total = match *ticks {
            [] => Duration::ZERO,
            [first, ..] => time(first, ticks[ticks.len() - 1]),
        };
        let mut steps = Vec::new();
        if profile {
            for (pass, &count) in ticks.chunks(PER_SET as usize).zip(stamps) {
                steps.extend(pass[..count as usize].windows(2).map(|t| time(t[0], t[1])));
            }
        }
        Ok(Timing { total, steps, moved: Vec::new() })
    }
}
