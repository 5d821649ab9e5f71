#![doc = include_str!("../README.md")]

mod compile;
mod error;
mod lint;
mod loops;
mod postpass;
mod toolchain;

pub use compile::{Compiled, Compiler, set_environment, validate};
pub use error::Error;
pub use lint::Finding;
pub use toolchain::RUST_GPU;

use rspirv::{
    binary::Assemble as _,
    dr::{self, Operand},
    spirv::ExecutionMode,
};

/// The SPIR-V target of [`Compiler`]: Vulkan 1.2, that is SPIR-V 1.5.
pub const TARGET: &str = "spirv-unknown-vulkan1.2";

/// A finished module.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Module {
    /// The module, to be passed to a Vulkan driver as it is.
    pub bytes: Vec<u8>,
    /// Float operations that carry `NoContraction`: all it has.
    pub exact_float_ops: usize,
    /// Entry points in the module's order.
    pub entry_points: Vec<EntryPoint>,
}

/// One kernel of a module.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EntryPoint {
    /// Name to give to the pipeline.
    pub name: String,
    /// Invocations per workgroup, if it is a compute shader.
    pub workgroup: Option<[u32; 3]>,
}

/// Makes a module that rust-gpu compiled exact, portable and reproducible, and refuses it if it still has an operation
/// that devices may compute differently.
///
/// * Every float operation is decorated `NoContraction`, so that drivers neither fuse nor rearrange it.
/// * Every entry point keeps signed zeros, infinities and NaNs and rounds to nearest even.
/// * `while` loops are left where their condition is asked.
/// * The memory model becomes GLSL450, under which barriers order memory as kernels expect.
/// * Names, lines and sources go, and ids are numbered in the order in which they appear.
///
/// The module must have been compiled with the capabilities `SignedZeroInfNanPreserve` and `RoundingModeRTE`, as
/// [`Compiler`] does, or rust-gpu's own optimiser may have rearranged floats already.
///
/// # Errors
/// These are no such bytes, or [`Error::Refused`] lists what must not be there.
pub fn finish(spirv: &[u8]) -> Result<Module, Error> {
    let mut module = dr::load_bytes(spirv).map_err(|e| Error::Damaged(e.to_string()))?;
    let exact_float_ops = postpass::run(&mut module)?;
    let findings = lint::check(&module);
    if !findings.is_empty() {
        return Err(Error::Refused(findings));
    }
    let bytes = module.assemble().into_iter().flat_map(u32::to_le_bytes).collect();
    Ok(Module { bytes, exact_float_ops, entry_points: entry_points(&module)? })
}

/// Names and workgroup sizes, in the order of the module.
fn entry_points(module: &dr::Module) -> Result<Vec<EntryPoint>, Error> {
    let damaged = |what: &str| Error::Damaged(what.to_owned());
    let of = |entry: &dr::Instruction| {
        let Operand::LiteralString(name) = &entry.operands[2] else {
            return Err(damaged("an entry point has no name"));
        };
        let local_size = Operand::ExecutionMode(ExecutionMode::LocalSize);
        let mut modes = module.execution_modes.iter();
        let size = modes.find(|mode| mode.operands[0] == entry.operands[1] && mode.operands[1] == local_size);
        let sides = |size: &dr::Instruction| match size.operands[2..] {
            [Operand::LiteralBit32(x), Operand::LiteralBit32(y), Operand::LiteralBit32(z)] => Ok([x, y, z]),
            _ => Err(damaged("a workgroup has no three sides")),
        };
        Ok(EntryPoint { name: name.clone(), workgroup: size.map(sides).transpose()? })
    };
    module.entry_points.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::spirv::{FunctionControl, Word};

    fn bytes(module: &dr::Module) -> Vec<u8> {
        module.assemble().into_iter().flat_map(Word::to_le_bytes).collect()
    }

    #[test]
    fn a_module_is_finished_once() {
        let finished = finish(&bytes(&postpass::tests::module())).unwrap();
        assert_eq!(finished.exact_float_ops, 2);
        let entry = EntryPoint { name: "main".into(), workgroup: Some([64, 1, 1]) };
        assert_eq!(finished.entry_points, [entry]);
        assert_eq!(finish(&finished.bytes).unwrap(), finished);
    }

    #[test]
    fn a_quotient_is_refused() {
        let mut b = dr::Builder::new_from_module(postpass::tests::module());
        let (void, float) = (b.type_void(), b.type_float(32, None));
        let one = b.constant_bit32(float, 1.0f32.to_bits());
        let kind = b.type_function(void, []);
        b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        b.f_div(float, None, one, one).unwrap();
        b.ret().unwrap();
        b.end_function().unwrap();
        let error = finish(&bytes(&b.module())).unwrap_err();
        let Error::Refused(findings) = &error else { panic!("{error}") };
        assert_eq!(findings[0].instruction, "OpFDiv");
        assert!(error.to_string().contains("math::div"), "{error}");
    }

    #[test]
    fn other_bytes_are_damaged() {
        for bytes in [&[][..], b"not SPIR-V at all, but four times four."] {
            assert!(matches!(finish(bytes), Err(Error::Damaged(_))));
        }
    }
}
