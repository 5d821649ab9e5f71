//! The connection to one device: every wgpu call that can fail goes through here and becomes a `Result`.

use crate::Error;
use std::{
    fmt::Display,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

/// A device with its queue, and the first fault it reported.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Set once, by wgpu's callbacks or by us; afterwards every call fails with it.
    fault: Arc<OnceLock<String>>,
    /// Whether it pays to [`Self::ask`].
    asks: bool,
    /// Bytes written since commands were last handed over.
    riding: AtomicUsize,
}

/// So many bytes may wait for the next submission. wgpu keeps them till then, and the buffers that they go to, even if
/// nobody else does.
const MOST_RIDING: usize = 4 << 20;

/// How long the host asks a device whether it is done before it sleeps until it is told: to wake up takes it a tenth of
/// a millisecond or two, which is much beside what most runs take. A device in software needs the host's cores itself.
const ASKING: Duration = Duration::from_millis(5);

fn asks(device: &wgpu::Device) -> bool {
    device.adapter_info().device_type != wgpu::DeviceType::Cpu
}

impl Link {
    /// Opens a device on `adapter` with all its limits and those of `features` that it has.
    pub(super) fn open(
        adapter: &wgpu::Adapter,
        name: String,
        features: wgpu::Features,
    ) -> Result<Self, Error> {
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("raykd"),
            required_features: adapter.features() & features,
            required_limits: adapter.limits(),
            // SAFETY: passthrough counts as experimental; the modules we pass are checked by `cargo xtask kernels`.
            experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|e| Error::DeviceFailed { adapter: name.clone(), what: flat(e) })?;
        let fault = Arc::new(OnceLock::new());
        let (lost, uncaught) = (Arc::clone(&fault), Arc::clone(&fault));
        device.set_device_lost_callback(move |_, message| {
            let _ = lost.set(flat(format_args!("the device was lost: {message}")));
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = uncaught.set(flat(error));
        }));
        Ok(Self { asks: asks(&device), name, device, queue, fault, riding: AtomicUsize::new(0) })
    }

    /// A device that somebody else opened, whose callbacks are left alone.
    pub(super) fn given(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Self {
        Self { asks: asks(&device), name, device, queue, fault: Arc::default(), riding: AtomicUsize::new(0) }
    }

    /// The error that this device failed in some way.
    pub(super) fn failed(&self, what: impl Display) -> Error {
        Error::DeviceFailed { adapter: self.name.clone(), what: flat(what) }
    }

    /// Whether the device still works.
    pub(super) fn check(&self) -> Result<(), Error> {
        self.fault.get().map_or(Ok(()), |what| Err(self.failed(what)))
    }

    /// Runs wgpu calls, and gives the error that they raised, if any.
    pub(super) fn guard<T>(&self, doing: impl Display, calls: impl FnOnce() -> T) -> Result<T, Error> {
        let (value, error) = self.scoped(calls);
        error.map_or(Ok(value), |e| Err(self.failed(format_args!("{doing}: {e}")))).and_then(|value| {
            // A lost device raises no error, it calls back.
            self.check().map(|()| value)
        })
    }

    /// A buffer for the given use.
    pub(super) fn buffer(
        &self,
        name: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Error> {
        self.check()?;
        let mapped_at_creation = usage.contains(wgpu::BufferUsages::MAP_WRITE);
        let descriptor = wgpu::BufferDescriptor { label: Some(name), size: bytes, usage, mapped_at_creation };
        let (buffer, error) = self.scoped(|| self.device.create_buffer(&descriptor));
        match error {
            None => self.check().map(|()| buffer),
            Some(wgpu::Error::OutOfMemory { .. }) => Err(Error::OutOfMemory { buffer: name, bytes }),
            Some(error) => Err(self.failed(format_args!("allocating '{name}': {error}"))),
        }
    }

    /// An encoder for [`Self::submit`].
    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Writes along with the next submission, which follows at once if much waits for it.
    pub(super) fn write(&self, buffer: &wgpu::Buffer, offset: u64, data: &[u8]) -> Result<(), Error> {
        self.guard("writing", || self.queue.write_buffer(buffer, offset, data))?;
        if self.riding.fetch_add(data.len(), Relaxed) + data.len() > MOST_RIDING {
            self.submit(self.encoder())?;
        }
        Ok(())
    }

    /// Hands commands to the device.
    pub(super) fn submit(&self, encoder: wgpu::CommandEncoder) -> Result<wgpu::SubmissionIndex, Error> {
        self.check()?;
        self.riding.store(0, Relaxed);
        self.guard("submitting commands", || self.queue.submit([encoder.finish()]))
    }

    /// Waits until a submission is done, and runs the callbacks that waited for it.
    pub(super) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), Error> {
        self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })
    }

    /// Asks the device again and again, for a while, until its callbacks say so. Returns whether they did.
    ///
    /// Not by waiting for no time: wgpu 30 panics if another thread finds the queue empty meanwhile.
    pub(super) fn ask(&self, mut is_done: impl FnMut() -> bool) -> Result<bool, Error> {
        let begin = Instant::now();
        while self.asks && begin.elapsed() < ASKING {
            self.poll(wgpu::PollType::Poll)?;
            if is_done() {
                return Ok(true);
            }
            std::thread::yield_now();
        }
        Ok(false)
    }

    fn poll(&self, poll: wgpu::PollType) -> Result<(), Error> {
        // wgpu panics where the device is lost while it waits.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll))) {
            Ok(Ok(_)) => {}
            Ok(Err(error)) => return Err(self.failed(format_args!("waiting for the device: {error}"))),
            Err(_) => {
                let _ = self.fault.set("the device was lost".to_owned());
            }
        }
        self.check()
    }

    /// Runs calls within error scopes (which belong to this thread) of all kinds.
    fn scoped<T>(&self, calls: impl FnOnce() -> T) -> (T, Option<wgpu::Error>) {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        let scopes = [Internal, OutOfMemory, Validation].map(|kind| self.device.push_error_scope(kind));
        let value = calls();
        let mut error = None;
        for scope in scopes.into_iter().rev() {
            error = pollster::block_on(scope.pop()).or(error);
        }
        (value, error)
    }
}

/// wgpu's messages on one line.
fn flat(message: impl Display) -> String {
    message.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
