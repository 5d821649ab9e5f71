//! What rust-gpu leaves undone for results that agree to the bit: see [`run`].

use crate::{Error, loops};
use rspirv::{
    dr::{Instruction, Module, Operand},
    spirv::{
        AddressingModel, Capability, Decoration, ExecutionMode, GlslStd450Op, MemoryModel, MemorySemantics,
        Op, Scope, Word,
    },
};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Does to a module what [`finish`](crate::finish) says. rust-gpu declares the Vulkan memory model, but none of the
/// availability operations which that needs.
///
/// Returns how many operations were decorated.
pub(crate) fn run(module: &mut Module) -> Result<usize, Error> {
    strip(module);
    loops::leave_where_asked(module);
    memory_model(module)?;
    rounds_once(module)?;
    float_controls(module);
    let decorated = no_contraction(module);
    renumber(module);
    Ok(decorated)
}

/// Removes all that only debuggers read; it holds paths of the machine that compiled the module.
fn strip(module: &mut Module) {
    module.debug_string_source.clear();
    module.debug_names.clear();
    module.debug_module_processed.clear();
    let line = |i: &Instruction| matches!(i.class.opcode, Op::Line | Op::NoLine);
    module.types_global_values.retain(|i| !line(i));
    for block in module.functions.iter_mut().flat_map(|f| &mut f.blocks) {
        block.instructions.retain(|i| !line(i));
    }
}

/// Whether `NoContraction` means something for this operation.
fn is_arithmetic(op: Op) -> bool {
    use Op::*;
    matches!(
        op,
        FNegate
            | FAdd
            | FSub
            | FMul
            | FDiv
            | FRem
            | FMod
            | VectorTimesScalar
            | MatrixTimesScalar
            | VectorTimesMatrix
            | MatrixTimesVector
            | MatrixTimesMatrix
            | OuterProduct
            | Dot
    )
}

fn no_contraction(module: &mut Module) -> usize {
    let ids: Vec<Word> = module
        .functions
        .iter()
        .flat_map(|f| f.all_inst_iter())
        .filter(|i| is_arithmetic(i.class.opcode))
        .filter_map(|i| i.result_id)
        .collect();
    let present: HashSet<Word> = module
        .annotations
        .iter()
        .filter(|i| i.operands.get(1) == Some(&Operand::Decoration(Decoration::NoContraction)))
        .filter_map(|i| i.operands[0].id_ref_any())
        .collect();
    for &id in ids.iter().filter(|id| !present.contains(id)) {
        let operands = vec![Operand::IdRef(id), Operand::Decoration(Decoration::NoContraction)];
        module.annotations.push(Instruction::new(Op::Decorate, None, None, operands));
    }
    ids.len()
}

fn float_controls(module: &mut Module) {
    let modes = [
        (ExecutionMode::SignedZeroInfNanPreserve, Capability::SignedZeroInfNanPreserve),
        (ExecutionMode::RoundingModeRTE, Capability::RoundingModeRTE),
    ];
    let entries: Vec<Word> = module.entry_points.iter().filter_map(|e| e.operands[1].id_ref_any()).collect();
    for (mode, capability) in modes {
        for &entry in &entries {
            let operands =
                vec![Operand::IdRef(entry), Operand::ExecutionMode(mode), Operand::LiteralBit32(32)];
            if !module.execution_modes.iter().any(|i| i.operands == operands) {
                module.execution_modes.push(Instruction::new(Op::ExecutionMode, None, None, operands));
            }
        }
        if !has_capability(module, capability) {
            let operands = vec![Operand::Capability(capability)];
            module.capabilities.push(Instruction::new(Op::Capability, None, None, operands));
        }
    }
}

/// Whether the module declares a capability.
pub(crate) fn has_capability(module: &Module, capability: Capability) -> bool {
    module.capabilities.iter().any(|i| i.operands[0] == Operand::Capability(capability))
}

fn no_header() -> Error {
    Error::Damaged("it has no header".to_owned())
}

/// To GLSL450; scopes and semantics that only the Vulkan model knows are replaced.
fn memory_model(module: &mut Module) -> Result<(), Error> {
    use Capability::{VulkanMemoryModel, VulkanMemoryModelDeviceScope};
    module.capabilities.retain(|i| {
        ![VulkanMemoryModel, VulkanMemoryModelDeviceScope].map(Operand::Capability).contains(&i.operands[0])
    });
    let extension = Operand::LiteralString("SPV_KHR_vulkan_memory_model".into());
    module.extensions.retain(|i| i.operands[0] != extension);
    module.memory_model = Some(Instruction::new(
        Op::MemoryModel,
        None,
        None,
        vec![Operand::AddressingModel(AddressingModel::Logical), Operand::MemoryModel(MemoryModel::GLSL450)],
    ));

    // Constants are shared with arithmetic, so a changed value needs a constant of its own.
    let constants: HashMap<Word, (Word, u32)> = module
        .types_global_values
        .iter()
        .filter(|i| i.class.opcode == Op::Constant)
        .filter_map(|i| match i.operands[0] {
            Operand::LiteralBit32(value) => Some((i.result_id?, (i.result_type?, value))),
            _ => None,
        })
        .collect();
    let only_vulkan = MemorySemantics::OUTPUT_MEMORY
        | MemorySemantics::MAKE_AVAILABLE
        | MemorySemantics::MAKE_VISIBLE
        | MemorySemantics::VOLATILE;
    let mut next = module.header.as_ref().ok_or_else(no_header)?.bound;
    let mut added: BTreeMap<(Word, u32), Word> = BTreeMap::new();
    for operand in
        module.functions.iter_mut().flat_map(|f| f.all_inst_iter_mut()).flat_map(|i| &mut i.operands)
    {
        let (id, is_scope) = match operand {
            Operand::IdScope(id) => (id, true),
            Operand::IdMemorySemantics(id) => (id, false),
            _ => continue,
        };
        let &(of_type, value) = constants
            .get(id)
            .ok_or_else(|| Error::Damaged("a scope or its semantics is not a constant".to_owned()))?;
        let wanted = if !is_scope {
            value & !only_vulkan.bits()
        } else if value == Scope::QueueFamily as u32 {
            Scope::Device as u32
        } else {
            value
        };
        if wanted != value {
            *id = *added.entry((of_type, wanted)).or_insert_with(|| {
                next += 1;
                next - 1
            });
        }
    }
    // A type stands before all that uses it, and so does a constant put at the end.
    for ((of_type, value), id) in added {
        let operands = vec![Operand::LiteralBit32(value)];
        module.types_global_values.push(Instruction::new(Op::Constant, Some(of_type), Some(id), operands));
    }
    module.header.as_mut().ok_or_else(no_header)?.bound = next;
    Ok(())
}

/// What `raykd_kernels::math` multiplies and adds to itself to ask whether the device rounds such a sum once.
const ROUNDS_ONCE: u32 = 0xBED1_0F3A;

/// Number of the specialization constant that answers.
const ANSWER: Operand = Operand::LiteralBit32(0x5AD1);

/// The id of that constant, if the module has it.
pub(crate) fn answer(module: &Module) -> Option<Word> {
    let number = [Operand::Decoration(Decoration::SpecId), ANSWER];
    module.annotations.iter().find(|i| i.operands[1..] == number)?.operands[0].id_ref_any()
}

/// Puts a specialization constant of 0 in place of the question.
fn rounds_once(module: &mut Module) -> Result<(), Error> {
    let constants = module
        .types_global_values
        .iter()
        .filter(|i| i.class.opcode == Op::Constant && i.operands[0] == Operand::LiteralBit32(ROUNDS_ONCE));
    let asked: HashSet<Word> = constants.filter_map(|i| i.result_id).collect();
    let asks = |i: &Instruction| fused(i).is_some_and(|[a, b, c]| a == b && b == c && asked.contains(&a));
    let all = || module.functions.iter().flat_map(|f| f.all_inst_iter()).filter(|i| asks(i));
    let answers: HashSet<Word> = all().filter_map(|i| i.result_id).collect();
    let Some(float) = all().find_map(|i| i.result_type) else { return Ok(()) };
    for block in module.functions.iter_mut().flat_map(|f| &mut f.blocks) {
        block.instructions.retain(|i| !asks(i));
    }
    let header = module.header.as_mut().ok_or_else(no_header)?;
    let answer = header.bound;
    header.bound += 1;
    let operands =
        module.functions.iter_mut().flat_map(|f| f.all_inst_iter_mut()).flat_map(|i| &mut i.operands);
    for id in operands.filter_map(Operand::id_ref_any_mut).filter(|id| answers.contains(id)) {
        *id = answer;
    }
    let zero = vec![Operand::LiteralBit32(0)];
    module.types_global_values.push(Instruction::new(Op::SpecConstant, Some(float), Some(answer), zero));
    let number = vec![Operand::IdRef(answer), Operand::Decoration(Decoration::SpecId), ANSWER];
    module.annotations.push(Instruction::new(Op::Decorate, None, None, number));
    Ok(())
}

/// Operands of `Fma`, if the set of extended instructions is GLSL.std.450.
pub(crate) fn fused(i: &Instruction) -> Option<[Word; 3]> {
    match i.operands[..] {
        [_, Operand::LiteralExtInstInteger(op), Operand::IdRef(a), Operand::IdRef(b), Operand::IdRef(c)]
            if i.class.opcode == Op::ExtInst && op == GlslStd450Op::Fma as u32 =>
        {
            Some([a, b, c])
        }
        _ => None,
    }
}

/// Numbers ids from 1 in the order in which they appear.
fn renumber(module: &mut Module) {
    let mut numbers: HashMap<Word, Word> = HashMap::new();
    for instruction in module.all_inst_iter_mut() {
        let operands = instruction.operands.iter_mut().filter_map(Operand::id_ref_any_mut);
        let ids = instruction.result_type.iter_mut().chain(&mut instruction.result_id).chain(operands);
        for id in ids {
            let next = numbers.len() as Word + 1;
            *id = *numbers.entry(*id).or_insert(next);
        }
    }
    if let Some(header) = &mut module.header {
        header.bound = numbers.len() as Word + 1;
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rspirv::{
        binary::Assemble as _,
        dr::Builder,
        spirv::{ExecutionModel, FunctionControl},
    };

    /// Two float operations, one integer operation, a barrier and an atomic, the Vulkan memory model.
    pub(crate) fn module() -> Module {
        let mut b = Builder::new();
        b.set_version(1, 5);
        b.capability(Capability::Shader);
        b.capability(Capability::VulkanMemoryModel);
        b.extension("SPV_KHR_vulkan_memory_model");
        b.memory_model(AddressingModel::Logical, MemoryModel::Vulkan);
        let (void, float, uint) = (b.type_void(), b.type_float(32, None), b.type_int(32, 0));
        let pointer = b.type_pointer(None, rspirv::spirv::StorageClass::Workgroup, uint);
        let word = b.variable(pointer, None, rspirv::spirv::StorageClass::Workgroup, None);
        let one = b.constant_bit32(float, 1.0f32.to_bits());
        let workgroup = b.constant_bit32(uint, Scope::Workgroup as u32);
        let family = b.constant_bit32(uint, Scope::QueueFamily as u32);
        let semantics = MemorySemantics::ACQUIRE_RELEASE
            | MemorySemantics::WORKGROUP_MEMORY
            | MemorySemantics::MAKE_AVAILABLE
            | MemorySemantics::MAKE_VISIBLE;
        let semantics = b.constant_bit32(uint, semantics.bits());
        let kind = b.type_function(void, []);
        let main = b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        let sum = b.f_add(float, None, one, one).unwrap();
        b.f_mul(float, None, sum, sum).unwrap();
        // The same constant as a scope and as a number.
        let number = b.i_add(uint, None, family, semantics).unwrap();
        b.control_barrier(workgroup, workgroup, semantics).unwrap();
        b.atomic_i_add(uint, None, word, family, semantics, number).unwrap();
        b.ret().unwrap();
        b.end_function().unwrap();
        b.entry_point(ExecutionModel::GLCompute, main, "main", [word]);
        b.execution_mode(main, ExecutionMode::LocalSize, [64, 1, 1]);
        let file = b.string("/home/someone/kernel.rs");
        b.source(rspirv::spirv::SourceLanguage::Unknown, 0, Some(file), None::<String>);
        b.name(sum, "sum");
        b.module()
    }

    fn constant(module: &Module, id: Word) -> u32 {
        let found = module.types_global_values.iter().find(|i| i.result_id == Some(id)).unwrap();
        found.operands[0].unwrap_literal_bit32()
    }

    #[test]
    fn every_float_operation_is_decorated_once() {
        let mut m = module();
        let count = |m: &Module| {
            let wanted = Operand::Decoration(Decoration::NoContraction);
            m.annotations.iter().filter(|i| i.operands.get(1) == Some(&wanted)).count()
        };
        assert_eq!(run(&mut m).unwrap(), 2);
        assert_eq!(count(&m), 2);
        assert_eq!(run(&mut m).unwrap(), 2);
        assert_eq!(count(&m), 2);
    }

    #[test]
    fn entry_points_have_float_controls_once() {
        let mut m = module();
        run(&mut m).unwrap();
        run(&mut m).unwrap();
        for mode in [ExecutionMode::SignedZeroInfNanPreserve, ExecutionMode::RoundingModeRTE] {
            let has = |i: &&Instruction| i.operands[1] == Operand::ExecutionMode(mode);
            assert_eq!(m.execution_modes.iter().filter(has).count(), 1, "{mode:?}");
        }
        assert!(has_capability(&m, Capability::SignedZeroInfNanPreserve));
        assert!(has_capability(&m, Capability::RoundingModeRTE));
    }

    #[test]
    fn memory_model_is_glsl() {
        let mut m = module();
        run(&mut m).unwrap();
        let model = m.memory_model.as_ref().unwrap();
        assert_eq!(model.operands[1], Operand::MemoryModel(MemoryModel::GLSL450));
        assert!(!has_capability(&m, Capability::VulkanMemoryModel));
        assert!(m.extensions.is_empty());
        let find = |op| m.functions[0].all_inst_iter().find(|i| i.class.opcode == op).unwrap();
        let id = |i: &Instruction, n: usize| i.operands[n].id_ref_any().unwrap();
        let plain = (MemorySemantics::ACQUIRE_RELEASE | MemorySemantics::WORKGROUP_MEMORY).bits();
        let barrier = find(Op::ControlBarrier);
        assert_eq!(constant(&m, id(barrier, 1)), Scope::Workgroup as u32);
        assert_eq!(constant(&m, id(barrier, 2)), plain);
        let atomic = find(Op::AtomicIAdd);
        assert_eq!(constant(&m, id(atomic, 1)), Scope::Device as u32);
        assert_eq!(constant(&m, id(atomic, 2)), plain);
        // Numbers that happen to be equal stay as they are.
        let sum = find(Op::IAdd);
        assert_eq!(constant(&m, id(sum, 0)), Scope::QueueFamily as u32);
        assert_ne!(constant(&m, id(sum, 1)), plain);
    }

    #[test]
    fn whether_a_device_rounds_once_is_one_constant() {
        let mut b = Builder::new_from_module(module());
        let glsl = b.ext_inst_import("GLSL.std.450");
        let (void, float) = (b.type_void(), b.type_float(32, None));
        let uint = b.type_int(32, 0);
        b.constant_bit32(uint, ROUNDS_ONCE);
        let [asked, other] = [ROUNDS_ONCE, 7].map(|bits| b.constant_bit32(float, bits));
        let kind = b.type_function(void, []);
        b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        for operands in [[asked; 3], [asked, other, asked], [asked, asked, other], [asked; 3]] {
            let operands = operands.map(Operand::IdRef);
            let answer = b.ext_inst(float, None, glsl, GlslStd450Op::Fma as u32, operands).unwrap();
            b.f_add(float, None, answer, other).unwrap();
        }
        b.ret().unwrap();
        b.end_function().unwrap();
        let mut m = b.module();
        run(&mut m).unwrap();
        let found: Vec<_> =
            m.types_global_values.iter().filter(|i| i.class.opcode == Op::SpecConstant).collect();
        let [found] = found[..] else { panic!("{found:?}") };
        assert_eq!(found.operands, [Operand::LiteralBit32(0)]);
        assert_eq!(answer(&m), found.result_id);
        let id = Operand::IdRef(found.result_id.unwrap());
        let last: Vec<&Instruction> = m.functions[1].all_inst_iter().collect();
        let of = |op| last.iter().filter(|i| i.class.opcode == op).collect::<Vec<_>>();
        assert_eq!(of(Op::ExtInst).len(), 2);
        let summed: Vec<bool> = of(Op::FAdd).iter().map(|i| i.operands[0] == id).collect();
        assert_eq!(summed, [true, false, false, true]);
    }

    #[test]
    fn nothing_of_the_compiling_machine_stays() {
        let mut m = module();
        run(&mut m).unwrap();
        let bytes: Vec<u8> = m.assemble().into_iter().flat_map(u32::to_le_bytes).collect();
        for text in ["/home/someone", "sum"] {
            assert!(!bytes.windows(text.len()).any(|w| w == text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn ids_are_dense_and_survive_a_round_trip() {
        let mut m = module();
        run(&mut m).unwrap();
        let words = m.assemble();
        let mut again = rspirv::dr::load_words(&words).unwrap();
        renumber(&mut again);
        assert_eq!(again.assemble(), words);
    }
}
