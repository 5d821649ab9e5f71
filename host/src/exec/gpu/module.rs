//! The compiled kernels: a module of SPIR-V, and one for devices that have doubles.

use super::link::Link;
use crate::Error;
use raykd_kernels::Kernel;
use std::collections::HashSet;

/// Words of a module.
pub(super) fn words(spirv: &[u8]) -> Vec<u32> {
    spirv.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// Its instructions: where they begin, and their words, the first of which is length and opcode.
fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, &[u32])> {
    // Behind a header.
    let mut at = 5;
    std::iter::from_fn(move || {
        let length = (words.get(at)? >> 16).max(1) as usize;
        let instruction = (at, words.get(at..at + length)?);
        at += length;
        Some(instruction)
    })
}

/// Names of its entry points.
pub(super) fn entry_points(words: &[u32]) -> HashSet<String> {
    const OP_ENTRY_POINT: u32 = 15;
    let named = |i: &&[u32]| i[0] & 0xFFFF == OP_ENTRY_POINT;
    let name = |i: &[u32]| {
        let bytes = i.iter().skip(3).flat_map(|word| word.to_le_bytes()).take_while(|&byte| byte != 0);
        String::from_utf8_lossy(&bytes.collect::<Vec<_>>()).into_owned()
    };
    instructions(words).map(|(_, i)| i).filter(named).map(name).collect()
}

/// The words for a device that multiplies and adds with one rounding: the only specialization constant is 1. wgpu gives
/// none to a module of SPIR-V.
pub(super) fn rounding_once(mut words: Vec<u32>) -> Vec<u32> {
    const OP_SPEC_CONSTANT: u32 = 50;
    let found = instructions(&words).find(|(_, i)| i[0] & 0xFFFF == OP_SPEC_CONSTANT).map(|(at, _)| at);
    if let Some(at) = found {
        words[at + 3] = 1.0_f32.to_bits();
    }
    words
}

/// Hands the words of a module of these kernels to the device.
pub(super) fn load(
    link: &Link,
    words: Vec<u32>,
    kernels: &[&'static Kernel],
) -> Result<wgpu::ShaderModule, Error> {
    link.guard("loading the kernels", || {
        let entry = |kernel: &&Kernel| wgpu::PassthroughShaderEntryPoint {
            name: kernel.entry_point().into(),
            workgroup_size: (kernel.threads, 1, 1),
        };
        let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
            label: Some("raykd"),
            spirv: Some(words.into()),
            entry_points: kernels.iter().map(entry).collect(),
            ..Default::default()
        };
        // SAFETY: the module was validated by spirv-val when it was made, and no other value of its constant makes it
        // invalid; its kernels keep to their buffers, which robust buffer access bounds.
        unsafe { link.device.create_shader_module_passthrough(descriptor) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    use raykd_kernels::{BY_DOUBLES, KERNELS, SPIRV, SPIRV_BY_DOUBLES};

    const MODULES: [(&[u8], &[&Kernel]); 2] = [(SPIRV, KERNELS), (SPIRV_BY_DOUBLES, BY_DOUBLES)];

    #[test]
    fn modules_have_one_word_for_rounding_once() {
        for (module, _) in MODULES {
            let (before, after) = (words(module), rounding_once(words(module)));
            let changed: Vec<_> = before.iter().zip(&after).filter(|(a, b)| a != b).collect();
            assert_eq!(changed, [(&0, &1.0_f32.to_bits())]);
            assert_eq!(instructions(&before).filter(|(_, i)| i[0] & 0xFFFF == 50).count(), 1);
        }
    }

    #[test]
    fn modules_hold_every_kernel() {
        for (module, kernels) in MODULES {
            let names = entry_points(&words(module));
            for kernel in kernels {
                let name = kernel.entry_point();
                assert!(names.contains(name), "{name}: run `cargo xtask kernels`");
            }
        }
    }

    #[test]
    fn doubles_are_in_their_own_module() {
        const OP_TYPE_FLOAT: u32 = 22;
        let widths = MODULES.map(|(module, _)| {
            let words = words(module);
            let floats = instructions(&words).map(|(_, i)| i).filter(|i| i[0] & 0xFFFF == OP_TYPE_FLOAT);
            floats.map(|i| i[2]).max()
        });
        assert_eq!(widths, [Some(32), Some(64)]);
    }
}
