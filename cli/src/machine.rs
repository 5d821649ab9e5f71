//! Which device a command runs on.

use crate::{
    args::{MachineArgs, One, Which, at_once},
    hints,
    notes::Notes,
    report::capitals,
};
use raykd::{Device, DeviceKind, Error};
use std::io::{self, Write};

/// The device of a command that uses one.
#[derive(Debug)]
pub(super) struct Machine {
    device: Device,
    /// Nobody asked for this device: if it fails, the CPU takes over.
    automatic: bool,
}

impl Machine {
    /// The device asked for; or a real GPU if there is one, else the CPU.
    pub(super) fn choose(wish: Option<One>, more: &MachineArgs, notes: &Notes) -> anyhow::Result<Self> {
        notes.stage("opening the device");
        let wish = wish.or_else(|| {
            let implied = more.adapter.as_ref().map(|_| One::Gpu);
            implied.or_else(|| more.threads.map(|_| One::Cpu))
        });
        Ok(match wish {
            Some(One::Cpu) => Self { device: cpu(more, notes)?, automatic: false },
            Some(One::Gpu) => Self { device: gpu(more, notes)?, automatic: false },
            None => match hardware() {
                Ok(device) => Self { device, automatic: true },
                Err(error) => {
                    // That there is no GPU is nothing to talk about; that it is not used is.
                    if !matches!(error, Error::NoAdapter { .. }) {
                        notes.note(format_args!("{}; using the CPU", hints::told(&error)));
                    }
                    Self { device: cpu(more, notes)?, automatic: true }
                }
            },
        })
    }

    /// A device that was chosen already.
    pub(super) const fn of(device: Device, automatic: bool) -> Self {
        Self { device, automatic }
    }

    /// Does the work; if a device that nobody asked for fails, once more on the CPU.
    pub(super) fn run<T>(
        self,
        notes: &Notes,
        work: impl Fn(&Device) -> Result<T, Error>,
    ) -> Result<T, Error> {
        match work(&self.device) {
            Err(error) if self.automatic && self.device.kind() == DeviceKind::Gpu && at_fault(&error) => {
                notes.note(format_args!("{error}; doing it on the CPU"));
                work(&Device::cpu())
            }
            done => done,
        }
    }
}

/// The devices of a command that compares them.
#[derive(Debug)]
pub(super) struct Machines {
    pub cpu: Option<Device>,
    pub gpu: Option<Device>,
    /// Nobody asked for the GPU: if it fails, the command goes on without it.
    pub automatic: bool,
}

impl Machines {
    /// The devices asked for; or the CPU and, if there is one, the best Vulkan adapter.
    pub(super) fn choose(wish: Option<Which>, more: &MachineArgs, notes: &Notes) -> anyhow::Result<Self> {
        notes.stage("opening the devices");
        let wish = self::wish(wish, more);
        let automatic = wish.is_none() && more.adapter.is_none();
        let cpu = if wish == Some(Which::Gpu) { None } else { Some(cpu(more, notes)?) };
        let gpu = match wish {
            Some(Which::Cpu) => None,
            _ => match gpu(more, notes) {
                Ok(device) => Some(device),
                Err(error) if automatic => {
                    notes.note(format_args!("{error}; going on with the CPU alone"));
                    None
                }
                Err(error) => return Err(error.into()),
            },
        };
        Ok(Self { cpu, gpu, automatic })
    }

    /// What was done on a device; nothing, and a note of how to go on, if one failed that nobody asked for.
    pub(super) fn spared<T>(
        &self,
        device: &Device,
        done: Result<T, Error>,
        going_on: &str,
        notes: &Notes,
    ) -> Result<Option<T>, Error> {
        match done {
            Err(error) if self.automatic && device.kind() == DeviceKind::Gpu && at_fault(&error) => {
                notes.note(format_args!("{error}; going on {going_on}"));
                Ok(None)
            }
            done => done.map(Some),
        }
    }

    /// Says which they are, a line each.
    pub(super) fn write_names(&self, out: &mut impl Write) -> io::Result<()> {
        for device in self.iter() {
            let software = if is_software(device) { " (software)" } else { "" };
            writeln!(out, "{}  {}{software}", capitals(device), device.name())?;
        }
        Ok(())
    }

    /// All of them, the CPU first.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Device> {
        self.cpu.iter().chain(&self.gpu)
    }
}

/// The devices of a command that compares them, as far as its options say it.
pub(super) fn wish(device: Option<Which>, more: &MachineArgs) -> Option<Which> {
    let gpu_only = more.adapter.is_some() && more.threads.is_none();
    device.or(if gpu_only { Some(Which::Gpu) } else { None })
}

/// The devices to choose among: the one asked for, or the CPU and, if there is one, a real GPU.
pub(super) fn candidates(
    wish: Option<One>,
    more: &MachineArgs,
    notes: &Notes,
) -> anyhow::Result<Vec<Device>> {
    let asked = wish.is_some() || more.adapter.is_some() || more.threads.is_some();
    if asked {
        return Ok(vec![Machine::choose(wish, more, notes)?.device]);
    }
    Ok(std::iter::once(cpu(more, notes)?).chain(hardware().ok()).collect())
}

/// Whether another device might do better.
pub(super) const fn at_fault(error: &Error) -> bool {
    matches!(
        error,
        Error::DeviceFailed { .. } | Error::TooLarge { .. } | Error::OutOfMemory { .. } | Error::Kernel(_)
    )
}

fn cpu(more: &MachineArgs, notes: &Notes) -> Result<Device, Error> {
    let Some(threads) = more.threads else { return Ok(Device::cpu()) };
    let there = at_once();
    if usize::from(threads) > there {
        notes.note(format_args!("--threads {threads}: {there} run at once here, more may be slower"));
    }
    Device::cpu_with_threads(threads.into())
}

#[cfg(feature = "gpu")]
fn gpu(more: &MachineArgs, notes: &Notes) -> Result<Device, Error> {
    let device = Device::gpu(more.adapter.as_deref())?;
    if is_software(&device) {
        let name = device.name();
        notes.note(format_args!("{name} is a software rasteriser: expect it to be slower than --device cpu"));
    }
    Ok(device)
}

#[cfg(feature = "gpu")]
fn hardware() -> Result<Device, Error> {
    raykd::internals::Gpu::open_hardware().map(Device::from)
}

/// Whether the device is a GPU that the CPU plays.
pub(super) fn is_software(device: &Device) -> bool {
    device.kind() == DeviceKind::Gpu && !device.is_card()
}

#[cfg(not(feature = "gpu"))]
fn gpu(more: &MachineArgs, _: &Notes) -> Result<Device, Error> {
    Err(Error::NoAdapter { wanted: more.adapter.clone() })
}

#[cfg(not(feature = "gpu"))]
fn hardware() -> Result<Device, Error> {
    Err(Error::NoAdapter { wanted: None })
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;
    use raykd::{BuildOptions, Mesh, Scene};

    /// Work that fails on GPUs.
    fn work(device: &Device) -> Result<&'static str, Error> {
        match device.kind() {
            DeviceKind::Cpu => Ok("done"),
            _ => {
                Err(Error::DeviceFailed { adapter: device.name().to_owned(), what: "it was lost".to_owned() })
            }
        }
    }

    fn on_gpu(automatic: bool) -> Machine {
        Machine { device: Device::gpu(None).expect("these tests need a Vulkan adapter"), automatic }
    }

    #[test]
    fn cpu_takes_over_where_nobody_asked_for_the_gpu() {
        assert_eq!(on_gpu(true).run(&Notes::new(true), work).unwrap(), "done");
        assert!(on_gpu(false).run(&Notes::new(true), work).is_err());
    }

    /// The device goes away between building and tracing, as late as it can.
    #[test]
    fn device_lost_halfway_costs_nothing_but_time() {
        let mesh = Mesh::teapot(2);
        let rays = raykd::rays::random(mesh.bounds(), 500, 1);
        let work = |device: &Device| {
            let scene = Scene::build(device, &mesh, &BuildOptions::default())?;
            scene.closest(&rays)?;
            if let Some(gpu) = device.as_gpu() {
                gpu.lose();
            }
            scene.closest(&rays)
        };
        let expected = work(&Device::cpu()).unwrap();
        assert_eq!(on_gpu(true).run(&Notes::new(true), work).unwrap(), expected);
        let error = hints::told(&on_gpu(false).run(&Notes::new(true), work).unwrap_err());
        assert!(error.contains("lost") && error.contains("--device cpu"), "{error}");
    }

    #[test]
    fn other_errors_are_nobodys_fault() {
        let work = |_: &Device| -> Result<(), Error> { Err(Error::Untraced) };
        assert!(on_gpu(true).run(&Notes::new(true), work).is_err());
    }

    #[test]
    fn options_imply_devices() {
        let more =
            |adapter: Option<&str>, threads| MachineArgs { adapter: adapter.map(str::to_owned), threads };
        let notes = Notes::new(true);
        assert_eq!(
            Machine::choose(None, &more(Some(""), None), &notes).unwrap().device.kind(),
            DeviceKind::Gpu
        );
        assert_eq!(
            Machine::choose(None, &more(None, Some(1)), &notes).unwrap().device.kind(),
            DeviceKind::Cpu
        );
        let kinds = |wish, more: &MachineArgs| -> Vec<&'static str> {
            Machines::choose(wish, more, &notes).unwrap().iter().map(|it| it.kind().name()).collect()
        };
        assert_eq!(kinds(None, &more(None, None)), ["cpu", "gpu"]);
        assert_eq!(kinds(None, &more(Some(""), None)), ["gpu"]);
        assert_eq!(kinds(None, &more(Some(""), Some(1))), ["cpu", "gpu"]);
        assert_eq!(kinds(Some(Which::Cpu), &more(None, None)), ["cpu"]);
        assert_eq!(kinds(Some(Which::Both), &more(Some(""), None)), ["cpu", "gpu"]);
    }
}
