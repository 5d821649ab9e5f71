//! Refuses SPIR-V whose result a device may choose, or that it may not survive: see [`check`].

use crate::postpass;
use rspirv::{
    dr::{Function, Instruction, Module, Operand},
    spirv::{Capability, GlslStd450Op, Op, Word},
};
use std::{
    collections::{BTreeSet, HashMap, HashSet},
    fmt,
};

/// One instruction that must not be in a kernel.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub struct Finding {
    /// Entry point that reaches it, or nothing if it stands outside of functions.
    pub entry: Option<String>,
    /// The instruction, as SPIR-V calls it.
    pub instruction: String,
    /// Why it is refused and what to write instead.
    pub reason: &'static str,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let entry = self.entry.as_deref().unwrap_or("the module");
        write!(f, "{entry}: {}: {}", self.instruction, self.reason)
    }
}

const DIVISION: &str = "Vulkan allows an error of 2.5 ULP; use raykd_kernels::math::div, cross-multiply, or divide \
                        constants in a `const`";
const ORDER: &str = "Vulkan leaves order or rounding to the device; write it with + - *";
const INEXACT: &str = "its precision is up to the device; write it with + - * or in integers";
const MIN_MAX: &str = "Vulkan leaves open which zero or NaN wins; use raykd_kernels::math::low and high";
const WIDTH: &str = "only f32 is on every device; see Compiler::doubles";
const MATRIX: &str = "matrix operations may be evaluated in any order; use vectors";
const CHOSEN: &str = "Vulkan has no choice between buffers, which spirv-val overlooks and drivers crash on; choose \
                      what is read or written";
const UNKNOWN: &str = "not on the list of float operations that are exact on every device";

/// Finds every operation whose float result is not the same, to the bit, on every Vulkan device.
///
/// What may make floats is a list: `+ - *`, negation, moving and conversion from integers. All else that has
/// a float result is refused, and so are the extended instructions that are not known to be exact, but for
/// [one](is_rest_of_product), matrices and floats that are not 32 bits wide. And pointers that are anything but a
/// variable's or a parameter's, or lead into one.
///
/// Where the module says that it needs doubles, they may be multiplied and added at once, and converted: they are for
/// numbers that carry bounds of their errors.
pub(crate) fn check(module: &Module) -> Vec<Finding> {
    let mut findings = BTreeSet::new();
    let (mut floats, mut doubles, mut pointers) = (HashSet::new(), HashSet::new(), HashSet::new());
    let with_doubles = postpass::has_capability(module, Capability::Float64);
    for i in &module.types_global_values {
        let refused = match i.class.opcode {
            Op::TypeFloat => {
                floats.extend(i.result_id);
                let is_double = with_doubles && i.operands[0] == Operand::LiteralBit32(64);
                doubles.extend(i.result_id.filter(|_| is_double));
                (!is_double && i.operands[0] != Operand::LiteralBit32(32)).then_some(WIDTH)
            }
            Op::TypeVector => {
                if i.operands[0].id_ref_any().is_some_and(|component| floats.contains(&component)) {
                    floats.extend(i.result_id);
                }
                None
            }
            Op::TypePointer => {
                pointers.extend(i.result_id);
                None
            }
            Op::TypeMatrix => Some(MATRIX),
            Op::SpecConstantOp => Some(UNKNOWN),
            _ => None,
        };
        findings.extend(refused.map(|reason| Finding { entry: None, instruction: name(i), reason }));
    }
    let glsl: HashSet<Word> = module
        .ext_inst_imports
        .iter()
        .filter(|i| i.operands[0] == Operand::LiteralString("GLSL.std.450".into()))
        .filter_map(|i| i.result_id)
        .collect();
    let answer = postpass::answer(module);
    for (function, entry) in reachable(module) {
        for i in function.all_inst_iter() {
            let is_double = i.result_type.is_some_and(|t| doubles.contains(&t));
            let converts = with_doubles && i.class.opcode == Op::FConvert;
            let refused = if i.class.opcode == Op::ExtInst {
                extended(i, &glsl, |i| {
                    is_compared(i, function) || is_double || is_rest_of_product(i, function, answer)
                })
            } else if converts {
                None
            } else if i.result_type.is_some_and(|t| floats.contains(&t)) {
                float(i.class.opcode)
            } else if i.result_type.is_some_and(|t| pointers.contains(&t)) {
                pointer(i.class.opcode)
            } else {
                None
            };
            findings.extend(refused.map(|reason| Finding {
                entry: entry.clone(),
                instruction: name(i),
                reason,
            }));
        }
    }
    findings.into_iter().collect()
}

/// Why an operation with a float result is refused, if it is.
fn float(op: Op) -> Option<&'static str> {
    use Op::*;
    match op {
        // Exact by IEEE 754 under the float controls that the post-pass declares.
        FNegate | FAdd | FSub | FMul | VectorTimesScalar | ConvertSToF | ConvertUToF => None,
        // Moves.
        Undef | Load | Phi | Select | Bitcast | CopyObject | FunctionParameter | FunctionCall
        | CompositeConstruct | CompositeExtract | CompositeInsert | VectorExtractDynamic
        | VectorInsertDynamic | VectorShuffle | Function => None,
        FDiv => Some(DIVISION),
        FRem | FMod => Some(INEXACT),
        Dot => Some(ORDER),
        MatrixTimesScalar | VectorTimesMatrix | MatrixTimesVector | MatrixTimesMatrix | OuterProduct
        | Transpose => Some(MATRIX),
        FConvert | QuantizeToF16 => Some(WIDTH),
        _ => Some(UNKNOWN),
    }
}

/// Why an operation with a pointer as its result is refused, if it is.
fn pointer(op: Op) -> Option<&'static str> {
    use Op::*;
    match op {
        Variable | AccessChain | InBoundsAccessChain | FunctionParameter | CopyObject | Undef => None,
        _ => Some(CHOSEN),
    }
}

/// Whether this is `fma(a, b, -(a * b))`, and taken only if [the constant](postpass::answer) allows.
fn is_rest_of_product(i: &Instruction, function: &Function, answer: Option<Word>) -> bool {
    let operand = |id: Word, op: Op, n: usize| {
        let made = function.all_inst_iter().find(|i| i.result_id == Some(id));
        made.filter(|i| i.class.opcode == op).and_then(|i| i.operands.get(n)?.id_ref_any())
    };
    let is_rest = |[a, b, c]: [Word; 3]| {
        let product = operand(c, Op::FNegate, 0);
        let factors = [0, 1].map(|n| product.and_then(|product| operand(product, Op::FMul, n)));
        factors == [Some(a), Some(b)] || factors == [Some(b), Some(a)]
    };
    let asked = |id: Word| operand(id, Op::FOrdGreaterThan, 0) == answer;
    let Some(rest) = i.result_id.filter(|_| answer.is_some() && postpass::fused(i).is_some_and(is_rest))
    else {
        return false;
    };
    function.all_inst_iter().filter(|i| i.operands.contains(&Operand::IdRef(rest))).all(|i| {
        i.class.opcode == Op::Select
            && i.operands[0].id_ref_any().is_some_and(asked)
            && i.operands[2] != Operand::IdRef(rest)
    })
}

/// Whether nothing but comparisons gets to see a result, or the larger or smaller of it and others: such are bounds
/// that have room for a device's freedom, as of a box that is left out if a ray surely passes it by.
fn is_compared(i: &Instruction, function: &Function) -> bool {
    let Some(result) = i.result_id else { return false };
    let mut uses =
        function.all_inst_iter().filter(|i| i.operands.contains(&Operand::IdRef(result))).peekable();
    uses.peek().is_some()
        && uses.all(|i| match i.class.opcode {
            Op::FOrdLessThan | Op::FOrdLessThanEqual | Op::FOrdGreaterThan | Op::FOrdGreaterThanEqual => true,
            Op::ExtInst => glsl_op(i).is_some_and(is_choice),
            _ => false,
        })
}

/// Whether it is the larger or the smaller of two numbers.
const fn is_choice(op: GlslStd450Op) -> bool {
    use GlslStd450Op::*;
    matches!(op, FMin | FMax | NMin | NMax)
}

/// Why an extended instruction is refused, if it is, given which `Fma`, or choice of one of two numbers, may stay.
fn extended(
    i: &Instruction,
    glsl: &HashSet<Word>,
    stays: impl FnOnce(&Instruction) -> bool,
) -> Option<&'static str> {
    use GlslStd450Op::*;
    match glsl_op(i).filter(|_| i.operands[0].id_ref_any().is_some_and(|set| glsl.contains(&set))) {
        Some(
            FAbs | Floor | Ceil | Trunc | RoundEven | SAbs | SSign | UMin | SMin | UMax | SMax | UClamp
            | SClamp | FindILsb | FindSMsb | FindUMsb,
        ) => None,
        Some(op) if (matches!(op, Fma) || is_choice(op)) && stays(i) => None,
        Some(FMin | FMax | FClamp | NMin | NMax | NClamp) => Some(MIN_MAX),
        Some(_) => Some(INEXACT),
        None => Some("an extended instruction set other than GLSL.std.450"),
    }
}

fn glsl_op(i: &Instruction) -> Option<GlslStd450Op> {
    match i.operands.get(1) {
        Some(&Operand::LiteralExtInstInteger(n)) => GlslStd450Op::from_u32(n),
        _ => None,
    }
}

fn name(i: &Instruction) -> String {
    match (i.class.opcode, glsl_op(i)) {
        (Op::ExtInst, Some(op)) => format!("OpExtInst {op:?}"),
        _ => format!("Op{}", i.class.opname),
    }
}

/// Every function with the name of each entry point that reaches it, or with none.
fn reachable(module: &Module) -> Vec<(&Function, Option<String>)> {
    let by_id: HashMap<Word, &Function> =
        module.functions.iter().filter_map(|f| Some((f.def_id()?, f))).collect();
    let mut seen = HashSet::new();
    let mut found = Vec::new();
    for entry in &module.entry_points {
        let Operand::LiteralString(name) = &entry.operands[2] else { continue };
        let mut visited = HashSet::new();
        let mut open: Vec<Word> = entry.operands[1].id_ref_any().into_iter().collect();
        while let Some(id) = open.pop() {
            let Some(function) = by_id.get(&id).filter(|_| visited.insert(id)) else { continue };
            found.push((*function, Some(name.clone())));
            let calls = function.all_inst_iter().filter(|i| i.class.opcode == Op::FunctionCall);
            open.extend(calls.filter_map(|i| i.operands[0].id_ref_any()));
        }
        seen.extend(visited);
    }
    let rest = module.functions.iter().filter(|f| f.def_id().is_none_or(|id| !seen.contains(&id)));
    found.extend(rest.map(|f| (f, None)));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::{
        dr::Builder,
        spirv::{
            AddressingModel, Capability, Decoration, ExecutionModel, FunctionControl, MemoryModel,
            StorageClass,
        },
    };

    /// Types and values a planted instruction may use.
    struct Kit {
        float: Word,
        vector: Word,
        uint: Word,
        /// A float, a vector and a uint.
        x: Word,
        v: Word,
        n: Word,
        glsl: Word,
    }

    /// Lints a kernel that calls a function with one planted instruction.
    fn lint(plant: impl FnOnce(&mut Builder, &Kit)) -> Vec<Finding> {
        let mut b = Builder::new();
        b.capability(Capability::Shader);
        b.memory_model(AddressingModel::Logical, MemoryModel::GLSL450);
        let glsl = b.ext_inst_import("GLSL.std.450");
        let (void, float, uint) = (b.type_void(), b.type_float(32, None), b.type_int(32, 0));
        let vector = b.type_vector(float, 3);
        let x = b.constant_bit32(float, 1.0f32.to_bits());
        let v = b.constant_composite(vector, [x, x, x]);
        let n = b.constant_bit32(uint, 1);
        let kind = b.type_function(void, []);
        let helper = b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        plant(&mut b, &Kit { float, vector, uint, x, v, n, glsl });
        b.ret().unwrap();
        b.end_function().unwrap();
        let main = b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        b.function_call(void, None, helper, []).unwrap();
        b.ret().unwrap();
        b.end_function().unwrap();
        b.entry_point(ExecutionModel::GLCompute, main, "trace::main", []);
        check(&b.module())
    }

    fn assert_refused(found: &[Finding], instruction: &str) {
        assert_eq!(found.len(), 1, "{instruction}: {found:?}");
        assert_eq!(found[0].instruction, instruction);
        assert_eq!(found[0].entry.as_deref(), Some("trace::main"));
        assert!(found[0].to_string().starts_with(&format!("trace::main: {instruction}: ")));
    }

    #[test]
    fn exact_operations_pass() {
        let found = lint(|b, k| {
            let s = b.f_add(k.float, None, k.x, k.x).unwrap();
            let d = b.f_sub(k.float, None, s, k.x).unwrap();
            let p = b.f_mul(k.float, None, s, d).unwrap();
            b.f_negate(k.float, None, p).unwrap();
            b.vector_times_scalar(k.vector, None, k.v, p).unwrap();
            b.convert_u_to_f(k.float, None, k.n).unwrap();
            b.bitcast(k.float, None, k.n).unwrap();
            b.composite_extract(k.float, None, k.v, [0]).unwrap();
            b.u_div(k.uint, None, k.n, k.n).unwrap();
            for op in [GlslStd450Op::FAbs, GlslStd450Op::Floor, GlslStd450Op::Trunc] {
                b.ext_inst(k.float, None, k.glsl, op as u32, [Operand::IdRef(k.x)]).unwrap();
            }
            for op in [GlslStd450Op::FindUMsb, GlslStd450Op::FindILsb] {
                b.ext_inst(k.uint, None, k.glsl, op as u32, [Operand::IdRef(k.n)]).unwrap();
            }
            for op in [GlslStd450Op::UMin, GlslStd450Op::UMax] {
                let operands = [Operand::IdRef(k.n), Operand::IdRef(k.n)];
                b.ext_inst(k.uint, None, k.glsl, op as u32, operands).unwrap();
            }
        });
        assert_eq!(found, []);
    }

    #[test]
    fn inexact_operations_are_refused() {
        assert_refused(&lint(|b, k| drop(b.f_div(k.float, None, k.x, k.x))), "OpFDiv");
        assert_refused(&lint(|b, k| drop(b.f_div(k.vector, None, k.v, k.v))), "OpFDiv");
        assert_refused(&lint(|b, k| drop(b.f_rem(k.float, None, k.x, k.x))), "OpFRem");
        assert_refused(&lint(|b, k| drop(b.f_mod(k.float, None, k.x, k.x))), "OpFMod");
        assert_refused(&lint(|b, k| drop(b.dot(k.float, None, k.v, k.v))), "OpDot");
        assert_refused(&lint(|b, k| drop(b.quantize_to_f16(k.float, None, k.x))), "OpQuantizeToF16");
        assert_refused(&lint(|b, k| drop(b.d_pdx(k.float, None, k.x))), "OpDPdx");
    }

    #[test]
    fn inexact_extended_instructions_are_refused() {
        use GlslStd450Op::*;
        #[rustfmt::skip]
        let refused = [
            Round, FSign, Fract, Sin, Cos, Tan, Asin, Acos, Atan, Sinh, Cosh, Tanh, Atan2, Pow, Exp, Log,
            Exp2, Log2, Sqrt, InverseSqrt, Determinant, FMin, FMax, FClamp, NMin, NMax, NClamp, FMix, Step,
            SmoothStep, Fma, Ldexp, Length, Distance, Cross, Normalize, Reflect, Refract, PackHalf2x16,
        ];
        for op in refused {
            let found = lint(|b, k| {
                drop(b.ext_inst(k.float, None, k.glsl, op as u32, [Operand::IdRef(k.x)]));
            });
            assert_refused(&found, &format!("OpExtInst {op:?}"));
        }
    }

    #[test]
    fn only_the_rest_of_a_product_is_fused_and_by_the_constant() {
        let lint = |[negated, own, asked, either, glsl]: [bool; 5]| {
            lint(|b, k| {
                let boolean = b.type_bool();
                let answer = b.spec_constant_bit32(k.float, 0);
                let number = [Operand::LiteralBit32(0x5AD1)];
                b.decorate(answer, Decoration::SpecId, number);
                let y = b.f_add(k.float, None, k.x, k.x).unwrap();
                let product = b.f_mul(k.float, None, if own { y } else { k.x }, k.x).unwrap();
                let c = if negated { b.f_negate(k.float, None, product).unwrap() } else { product };
                let operands = [k.x, y, c].map(Operand::IdRef);
                let set = if glsl { k.glsl } else { b.ext_inst_import("OpenCL.std") };
                let rest = b.ext_inst(k.float, None, set, GlslStd450Op::Fma as u32, operands).unwrap();
                let asks = if asked { answer } else { y };
                let yes = b.f_ord_greater_than(boolean, None, asks, k.x).unwrap();
                drop(b.select(k.float, None, yes, rest, if either { y } else { rest }));
            })
        };
        assert_eq!(lint([true; 5]), []);
        for fault in 0..5 {
            assert_refused(&lint([0, 1, 2, 3, 4].map(|n| n != fault)), "OpExtInst Fma");
        }
    }

    /// One step after the other: what is fused, the larger of that and another number, what is asked of it.
    #[test]
    fn bounds_that_are_only_compared_are_as_a_device_likes() {
        let lint = |[sum, choice, chosen]: [bool; 3]| {
            lint(|b, k| {
                let operands = [k.x; 3].map(Operand::IdRef);
                let fused = b.ext_inst(k.float, None, k.glsl, GlslStd450Op::Fma as u32, operands).unwrap();
                if sum {
                    b.f_add(k.float, None, fused, k.x).unwrap();
                }
                let operands = [fused, k.x].map(Operand::IdRef);
                let most = b.ext_inst(k.float, None, k.glsl, GlslStd450Op::FMax as u32, operands).unwrap();
                if choice {
                    b.f_mul(k.float, None, most, k.x).unwrap();
                }
                let boolean = b.type_bool();
                let less = b.f_ord_less_than_equal(boolean, None, most, k.x).unwrap();
                drop(b.select(k.float, None, less, if chosen { most } else { k.x }, k.x));
            })
        };
        assert_eq!(lint([false; 3]), []);
        assert_refused(&lint([true, false, false]), "OpExtInst Fma");
        assert_refused(&lint([false, true, false]), "OpExtInst FMax");
        assert_refused(&lint([false, false, true]), "OpExtInst FMax");
    }

    #[test]
    fn other_extended_instruction_sets_are_refused() {
        let found = lint(|b, k| {
            let opencl = b.ext_inst_import("OpenCL.std");
            drop(b.ext_inst(k.float, None, opencl, GlslStd450Op::FAbs as u32, [Operand::IdRef(k.x)]));
        });
        assert_eq!(found.len(), 1);
    }

    #[test]
    fn chosen_pointers_are_refused() {
        /// Two arrays, and what `choose` makes of pointers to them.
        fn of_two(choose: impl FnOnce(&mut Builder, &Kit, Word, [Word; 2])) -> Vec<Finding> {
            lint(|b, k| {
                let three = b.constant_bit32(k.uint, 3);
                let array = b.type_array(k.uint, three);
                let pointer = b.type_pointer(None, StorageClass::Function, array);
                let (one, two) = (
                    b.variable(pointer, None, StorageClass::Function, None),
                    b.variable(pointer, None, StorageClass::Function, None),
                );
                let word = b.type_pointer(None, StorageClass::Function, k.uint);
                b.access_chain(word, None, one, [k.n]).unwrap();
                choose(b, k, pointer, [one, two]);
            })
        }
        assert_eq!(of_two(|_, _, _, _| ()), []);
        let found = of_two(|b, _, pointer, [one, two]| {
            let boolean = b.type_bool();
            let yes = b.constant_true(boolean);
            drop(b.select(pointer, None, yes, one, two));
        });
        assert_refused(&found, "OpSelect");
        // As rust-gpu writes it: slices are pairs of pointer and length.
        let found = of_two(|b, k, pointer, [one, _]| {
            let slice = b.type_struct([pointer, k.uint]);
            let pair = b.composite_construct(slice, None, [one, k.n]).unwrap();
            drop(b.composite_extract(pointer, None, pair, [0]));
        });
        assert_refused(&found, "OpCompositeExtract");
    }

    #[test]
    fn matrices_and_other_widths_are_refused() {
        let matrix = lint(|b, k| _ = b.type_matrix(k.vector, 3));
        assert_eq!(matrix.len(), 1);
        assert_eq!(matrix[0].instruction, "OpTypeMatrix");
        for width in [16, 64] {
            let found = lint(|b, _| _ = b.type_float(width, None));
            assert_eq!(found.len(), 1);
            assert_eq!(found[0].instruction, "OpTypeFloat");
            assert_eq!(found[0].reason, WIDTH);
        }
        let product = lint(|b, k| {
            let matrix = b.type_matrix(k.vector, 3);
            let m = b.constant_composite(matrix, [k.v, k.v, k.v]);
            drop(b.matrix_times_vector(k.vector, None, m, k.v));
        });
        assert!(product.iter().any(|f| f.instruction == "OpMatrixTimesVector"));
    }

    #[test]
    fn doubles_may_be_asked_for() {
        let lint = |asked: bool| {
            lint(|b, k| {
                if asked {
                    b.capability(Capability::Float64);
                }
                let double = b.type_float(64, None);
                let x = b.f_convert(double, None, k.x).unwrap();
                let operands = [Operand::IdRef(x), Operand::IdRef(x), Operand::IdRef(x)];
                let y = b.ext_inst(double, None, k.glsl, GlslStd450Op::Fma as u32, operands).unwrap();
                b.f_convert(k.float, None, y).unwrap();
            })
        };
        assert_eq!(lint(true), []);
        let found: Vec<_> = lint(false).into_iter().map(|f| f.instruction).collect();
        assert_eq!(found, ["OpTypeFloat", "OpExtInst Fma", "OpFConvert"]);
        // Quotients and half precision are refused all the same.
        let found = super::tests::lint(|b, k| {
            b.capability(Capability::Float64);
            let double = b.type_float(64, None);
            let x = b.f_convert(double, None, k.x).unwrap();
            b.type_float(16, None);
            drop(b.f_div(double, None, x, x));
        });
        let found: Vec<_> = found.into_iter().map(|f| f.instruction).collect();
        assert_eq!(found, ["OpTypeFloat", "OpFDiv"]);
    }

    #[test]
    fn functions_that_nothing_calls_are_checked_too() {
        let mut b = Builder::new();
        let (void, float) = (b.type_void(), b.type_float(32, None));
        let x = b.constant_bit32(float, 0);
        let kind = b.type_function(void, []);
        b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        b.begin_block(None).unwrap();
        b.f_div(float, None, x, x).unwrap();
        b.ret().unwrap();
        b.end_function().unwrap();
        let found = check(&b.module());
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].entry, None);
    }
}
