//! The two executors against each other: same kernels, same buffers, same bytes.

use raykd::{
    AdapterVerdict, Device, Error, adapters,
    internals::{AnyBuffer, Buffer, Gpu, Groups, Launch as _, OnDevice, Step, Timing},
    shared::{BuildParams, limits::GROUPS_X},
};
use raykd_kernels::{
    Kernel,
    build::{bin::HIST_WORDS, boxes},
    glam::Vec4,
    probe::{self, PROBE, RESULTS},
};
use std::{
    panic::{self, AssertUnwindSafe},
    sync::{
        LazyLock,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};

/// What outputs hold before a kernel runs.
const POISON: u8 = 0xA5;

/// Two machines, the best adapter being one; no adapter is a failure.
fn devices() -> [&'static Device; 2] {
    static DEVICES: LazyLock<[Device; 2]> =
        LazyLock::new(|| [Device::cpu(), Device::gpu(None).expect("these tests need a Vulkan adapter")]);
    DEVICES.each_ref()
}

fn gpu() -> &'static Device {
    devices()[1]
}

/// A buffer with these contents.
fn buffer<T: bytemuck::Pod>(device: &Device, name: &'static str, data: &[T]) -> Buffer<T> {
    let buffer = device.alloc(name, data.len() as u64).unwrap();
    device.write(&buffer, 0, data).unwrap();
    buffer
}

fn poisoned<T>(device: &Device, name: &'static str, count: usize) -> Buffer<T> {
    let bytes = (count * size_of::<T>()).next_multiple_of(16);
    buffer(device, name, &vec![POISON; bytes]).view()
}

/// Runs steps over buffers of these tests.
fn run(device: &Device, steps: &[Step<'_>], profile: bool) -> Result<Timing, Error> {
    // SAFETY: the kernels used here, probe and boxes, write by their own number alone, whatever their buffers hold.
    unsafe { device.run(steps, profile) }
}

/// All bytes of a buffer.
fn bytes(device: &Device, buffer: &AnyBuffer) -> Vec<u8> {
    device.read(&buffer.view(), 0, buffer.bytes() as usize).unwrap()
}

/// A stream of pseudo-random words.
fn words(mut state: u64) -> impl Iterator<Item = u32> {
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
        (state >> 32) as u32
    })
}

/// Inputs whose results are neither subnormal nor infinite.
fn probe_inputs(count: u32) -> Vec<f32> {
    let float = |word: u32| f32::from_bits(word & 0x807F_FFFF | (0x78 + (word >> 23 & 15)) << 23);
    words(7).map(float).take(count as usize * 4).collect()
}

type Buffers<'a> = probe::Buffers<'a, OnDevice>;

/// The buffers of the probe kernel.
struct Probe {
    inputs: Buffer<Vec4>,
    results: Buffer<f32>,
    count: Buffer<u32>,
}

impl Probe {
    fn new(device: &Device, count: u32) -> Self {
        Self {
            inputs: buffer(device, "inputs", &probe_inputs(count)).view(),
            results: poisoned(device, "results", (count * RESULTS) as usize),
            count: buffer(device, "count", &[count]),
        }
    }

    fn buffers(&self) -> Buffers<'_> {
        Buffers { inputs: &self.inputs, results: self.results.out(), count: &self.count }
    }
}

/// The results of the probe when run as `groups` says, with indirect arguments at hand.
fn probe(device: &Device, count: u32, groups: impl Fn(&Buffer<u32>) -> Groups<'_>) -> Vec<u8> {
    let probe = Probe::new(device, count);
    let args = buffer(device, "args", &[9, 9, 9, 0, 1, 1, 1, 1, 1, 2, 3, 1u32]);
    run(device, &[probe.buffers().run(groups(&args))], false).unwrap();
    let mut results = bytes(device, &probe.results);
    results.truncate((4 * count * RESULTS) as usize);
    results
}

#[test]
fn probe_gives_the_same_bytes() {
    let [cpu, gpu] = devices().map(|device| probe(device, 10_001, |_| Groups::Fixed(10_001u32.div_ceil(64))));
    // Results that may be subnormal do not count.
    for (i, (cpu, gpu)) in cpu.chunks(4).zip(gpu.chunks(4)).enumerate() {
        let (input, result) = (i / RESULTS as usize, i % RESULTS as usize);
        assert!(cpu == gpu || result == 7, "result {result} of input {input}: {cpu:?} and {gpu:?}");
    }
    assert!(cpu.chunks(4).all(|word| word != [POISON; 4]), "every result is written");
}

#[test]
fn boxes_give_the_same_bytes() {
    let triangles = 1001u32;
    let params = BuildParams { triangles, references: triangles, ..bytemuck::Zeroable::zeroed() };
    let positions: Vec<f32> = probe_inputs(triangles).into_iter().take(triangles as usize * 3).collect();
    let indices: Vec<u32> = words(3).map(|word| word % triangles).take(triangles as usize * 3).collect();
    let [cpu, gpu] = devices().map(|device| {
        let params = buffer(device, "params", &[params]);
        let positions = buffer(device, "positions", &positions);
        let indices = buffer(device, "indices", &indices);
        let kept = buffer(device, "kept", &(0..triangles).collect::<Vec<_>>());
        // With room to spare, which must stay as it is.
        let refs = poisoned(device, "refs", triangles as usize * 2 + 256);
        let hists = poisoned(device, "histogram", HIST_WORDS as usize + 256);
        let sizes = poisoned(device, "sizes", 256);
        let boxes = boxes::Buffers {
            params: &params,
            positions: &positions,
            indices: &indices,
            kept: &kept,
            refs: refs.out(),
            hists: hists.out(),
            sizes: sizes.out(),
        };
        run(device, &[boxes.over(triangles)], false).unwrap();
        [bytes(device, &refs), bytes(device, &hists), bytes(device, &sizes)]
    });
    assert!(cpu == gpu);
    let [refs, cleared @ ..] = &cpu;
    let (written, spare) = refs.split_at(triangles as usize * 32);
    assert!(written.chunks(16).all(|row| row != [POISON; 16]));
    assert!(spare.iter().all(|&byte| byte == POISON));
    for (buffer, words) in cleared.iter().zip([HIST_WORDS as usize, 2]) {
        let (written, spare) = buffer.split_at(4 * words);
        assert!(written.iter().all(|&byte| byte == 0) && spare.iter().all(|&byte| byte == POISON));
    }
}

#[test]
fn indirect_dispatches_run_as_many_groups_as_the_buffer_says() {
    // Entry 1 holds no groups, entry 2 one, entry 3 six in a grid.
    for (entry, groups) in [(1, 0), (2, 1), (3, 6)] {
        let [cpu, gpu] = devices().map(|device| probe(device, 500, |args| Groups::Indirect(args, entry)));
        assert!(cpu == gpu, "entry {entry}");
        let written = cpu.chunks(4 * RESULTS as usize).filter(|row| row[..4] != [POISON; 4]).count();
        assert_eq!(written, (groups * 64).min(500));
    }
}

#[test]
fn large_dispatches_wrap_into_rows() {
    let groups = GROUPS_X + 3;
    let results = probe(gpu(), groups * 64, |_| Groups::Fixed(groups));
    assert!(results.chunks(4).all(|word| word != [POISON; 4]));
}

fn again<'a>(inputs: &'a Buffer<Vec4>, results: &'a Buffer<f32>, count: &'a Buffer<u32>) -> Step<'a> {
    Buffers { inputs, results: results.out(), count }.over(4096)
}

#[test]
fn steps_see_what_earlier_steps_wrote() {
    // Each step reads the results of the one before as its inputs.
    let [cpu, gpu] = devices().map(|device| {
        let first = Probe::new(device, 4096);
        let [second, third] = ["second", "third"].map(|name| poisoned(device, name, 4096 * RESULTS as usize));
        let inputs = [&first.results, &second, &third].map(|results| results.view());
        let steps = [
            first.buffers().over(4096),
            again(&inputs[0], &second, &first.count),
            again(&inputs[1], &third, &first.count),
            again(&inputs[2], &second, &first.count),
        ];
        run(device, &steps, false).unwrap();
        device.read(&second, 0, 4096 * RESULTS as usize).unwrap()
    });
    // The numbers may grow out of range here, and NaNs have many patterns.
    let same =
        |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) || a.is_subnormal();
    assert!(cpu.iter().zip(&gpu).all(same));
}

#[test]
fn transfers_keep_every_byte() {
    let data: Vec<u32> = words(11).take(5 << 20).collect();
    for device in devices() {
        let target = device.alloc("target", 6 << 20).unwrap();
        device.write(&target, 1, &data).unwrap();
        device.write(&target.view(), 64, &[1u8; 8]).unwrap();
        let read: Vec<u32> = device.read(&target, 0, 6 << 20).unwrap();
        assert_eq!(read[0], 0, "buffers start as zeroes");
        assert!(read[1..16] == data[..15]);
        assert_eq!(read[16..18], [0x0101_0101; 2]);
        assert!(read[18..=5 << 20] == data[17..]);
        assert!(read[(5 << 20) + 1..].iter().all(|&word| word == 0));
        let tail = device.read(&target, 5 << 20, 1).unwrap();
        assert_eq!(tail[0], data[(5 << 20) - 1]);
        assert!(device.read(&target, 0, 0).unwrap().is_empty());
    }
}

/// Whether something panics, with a message that says `what`.
fn panics(what: &str, act: impl FnOnce()) -> bool {
    let Err(cause) = panic::catch_unwind(AssertUnwindSafe(act)) else { return false };
    let text = cause.downcast_ref::<String>().expect("a message with a name in it");
    assert!(text.contains(what), "{text}");
    true
}

#[test]
fn ranges_outside_a_buffer_are_never_touched() {
    for device in devices() {
        let small: Buffer<u8> = device.alloc("small", 64).unwrap();
        let words: Buffer<u32> = small.view();
        for offset in [64, 61, u64::MAX, u64::MAX - 3, 1 << 63] {
            assert!(panics("past the end of small", || device.write(&small, offset, &[0; 4]).unwrap()));
        }
        // Sizes whose bytes wrap around to few.
        for count in [17, 1 << 62, (1 << 62) + 1, usize::MAX / 4 + 2, usize::MAX] {
            assert!(panics("past the end of small", || drop(device.read(&words, 0, count).unwrap())));
        }
        // And places.
        for from in [16, u64::MAX / 4, u64::MAX / 4 + 1, u64::MAX - 3, 1 << 62] {
            assert!(panics("past the end", || drop(device.read(&words, from, 1).unwrap())));
            assert!(panics("past the end", || device.write(&words, from, &[0]).unwrap()));
        }
        for bytes in [u64::MAX, u64::MAX - 15] {
            assert!(matches!(device.alloc::<u8>("all", bytes), Err(Error::TooLarge { .. })));
        }
        for count in [u64::MAX / 4 + 1, 1 << 62] {
            assert!(matches!(device.alloc::<u32>("all", count), Err(Error::TooLarge { .. })));
        }
    }
    let cpu = devices()[0];
    let probe = Probe::new(cpu, 64);
    let args = buffer(cpu, "args", &[1u32, 1, 1]);
    for entry in [2, u32::MAX] {
        let step = probe.buffers().indirect(&args, entry);
        assert!(panics("past the end of args", || drop(run(cpu, &[step], false))));
    }
}

/// On a CPU, where nothing else would keep them apart.
#[test]
fn no_thread_sees_a_buffer_that_another_writes() {
    let cpu = devices()[0];
    let shared = cpu.alloc("shared", 1 << 14).unwrap();
    let (reads, refused) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let count = |done: bool| if done { &reads } else { &refused }.fetch_add(1, Relaxed);
    thread::scope(|scope| {
        for value in [1u32, 2] {
            let shared = &shared;
            scope.spawn(move || {
                let data = vec![value; 1 << 14];
                for _ in 0..5000 {
                    panics("buffer shared is in use", || cpu.write(shared, 0, &data).unwrap());
                }
            });
        }
        for _ in 0..5000 {
            let refused = panics("buffer shared is in use", || {
                let words: Vec<u32> = cpu.read(&shared, 0, 1 << 14).unwrap();
                assert!(
                    words.iter().all(|word| *word == words[0]),
                    "buffer shared was read while it was written"
                );
            });
            count(!refused);
        }
    });
    let (reads, refused) = (reads.into_inner(), refused.into_inner());
    assert!(reads > 0, "{refused} reads refused, all of them");
    // A dispatch that binds a buffer twice, and writes it.
    let probe = Probe::new(cpu, 64);
    let inputs = &probe.results.view();
    let step = Buffers { inputs, ..probe.buffers() }.groups(1);
    assert!(panics("buffer results is in use", || drop(run(cpu, &[step], false))));
    run(cpu, &[probe.buffers().groups(1)], false).unwrap();
}

#[test]
fn profile_times_each_step() {
    for device in devices() {
        let probe = Probe::new(device, 64);
        // More steps than one set of timestamps holds, some of them empty.
        for count in [0, 1, 2, 4500] {
            let step = |i| probe.buffers().groups(u32::from(i % 16 == 0));
            let steps: Vec<_> = (0..count).map(step).collect();
            let timing = run(device, &steps, true).unwrap();
            assert_eq!(timing.steps.len(), count);
            let rounding = Duration::from_nanos(count as u64);
            assert!(timing.total + rounding >= timing.steps.iter().sum());
            assert!(count == 0 || !timing.total.is_zero());
            assert!(run(device, &steps, false).unwrap().steps.is_empty());
        }
    }
}

#[test]
fn unknown_adapter_is_an_error_that_helps() {
    let error = Device::gpu(Some("no such card")).unwrap_err();
    assert!(matches!(&error, Error::NoAdapter { wanted: Some(name) } if name == "no such card"));
    let text = error.to_string();
    assert!(text.contains("'no such card'") && text.contains("apt install mesa-vulkan-drivers"), "{text}");
}

#[test]
fn adapters_are_found_by_part_of_their_name() {
    let reports = adapters();
    assert!(!reports.is_empty());
    assert!(
        reports.iter().any(|report| matches!(report.verdict, AdapterVerdict::Exact { .. })),
        "{reports:?}"
    );
    let part = reports[0].name.to_uppercase();
    assert!(Device::gpu(Some(&part)).unwrap().name().starts_with(&reports[0].name));
    assert!(Device::gpu(Some("gpu:0")).unwrap().name().starts_with(&reports[0].name));
    let error = Device::gpu(Some(&format!("gpu:{}", reports.len()))).unwrap_err();
    assert!(matches!(&error, Error::NoAdapter { .. }), "{error}");
    // Whether there is hardware depends on the machine, what it may be does not.
    if let Ok(gpu) = Gpu::open_hardware() {
        let device = Device::from(gpu);
        assert!(
            reports
                .iter()
                .any(|report| device.name().starts_with(&report.name) && report.device_type != "cpu")
        );
    }
}

#[test]
fn too_large_a_buffer_is_an_error_that_names_the_limit() {
    for device in devices() {
        let limit = device.limit();
        let error = device.alloc::<u8>("everything", limit.bytes + 1).unwrap_err();
        assert!(matches!(error, Error::TooLarge { buffer: "everything", .. }));
        assert!(error.to_string().contains(limit.name), "{error}");
    }
}

#[test]
fn misuse_is_an_error_and_leaves_the_device_working() {
    let probe = Probe::new(gpu(), 64);
    // Read and written in one dispatch.
    let inputs = &probe.results.view();
    let step = Buffers { inputs, ..probe.buffers() }.groups(1);
    assert!(matches!(run(gpu(), &[step], false), Err(Error::DeviceFailed { .. })));
    // Not in the compiled module.
    static UNKNOWN: Kernel = Kernel { path: "raykd_kernels::unknown::entry", ..PROBE };
    let step = Step { kernel: &UNKNOWN, ..probe.buffers().groups(1) };
    let error = run(gpu(), &[step], false).unwrap_err();
    assert!(error.to_string().contains("cargo xtask kernels"), "{error}");
    run(gpu(), &[probe.buffers().groups(1)], true).unwrap();
}

#[test]
fn devices_may_be_shared_and_used_side_by_side() {
    let expected = probe(gpu(), 1000, |_| Groups::Fixed(16));
    thread::scope(|scope| {
        for i in 0..4 {
            let expected = &expected;
            scope.spawn(move || {
                let own;
                let device = if i % 2 == 0 {
                    gpu()
                } else {
                    own = Device::gpu(None).unwrap();
                    &own
                };
                for _ in 0..10 {
                    assert!(probe(device, 1000, |_| Groups::Fixed(16)) == *expected);
                }
            });
        }
    });
}
