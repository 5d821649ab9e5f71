//! The compiled kernels, one module of SPIR-V.

use super::link::Link;
use crate::Error;
use raykd_kernels::Kernel;
use std::collections::HashSet;

/// The words of the module.
pub(super) fn words() -> Vec<u32> {
    raykd_kernels::SPIRV.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
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

/// Hands the words to the device.
pub(super) fn load(link: &Link, words: Vec<u32>) -> Result<wgpu::ShaderModule, Error> {
    link.guard("loading the kernels", || {
        let entry = |kernel: &&Kernel| wgpu::PassthroughShaderEntryPoint {
            name: kernel.entry_point().into(),
            workgroup_size: (kernel.threads, 1, 1),
        };
        let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
            label: Some("raykd"),
            spirv: Some(words.into()),
            entry_points: raykd_kernels::KERNELS.iter().map(entry).collect(),
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

    #[test]
    fn module_has_one_word_for_rounding_once() {
        let (before, after) = (words(), rounding_once(words()));
        let changed: Vec<_> = before.iter().zip(&after).filter(|(a, b)| a != b).collect();
        assert_eq!(changed, [(&0, &1.0_f32.to_bits())]);
        assert_eq!(instructions(&before).filter(|(_, i)| i[0] & 0xFFFF == 50).count(), 1);
    }

    #[test]
    fn module_holds_every_kernel() {
        let names = entry_points(&words());
        for kernel in raykd_kernels::KERNELS {
            assert!(
                names.contains(kernel.entry_point()),
                "{}: run `cargo xtask kernels`",
                kernel.entry_point()
            );
        }
    }
}
