//! Loops as drivers expect them. rust-gpu makes `while c { body }` to
//!
//! ```text
//! loop { if c { body }; if !c { break } }
//! ```
//!
//! with all that changes carried through both. So a driver keeps two copies of it, and moves one to the other in every
//! round. Here the loop is left where `c` is asked, as other compilers have it.

use rspirv::{
    dr::{Function, Instruction, Module, Operand},
    spirv::{Op, Word},
};
use std::collections::{HashMap, HashSet};

/// Turns all loops that have that form, and returns how many had.
pub(crate) fn leave_where_asked(module: &mut Module) -> usize {
    let never = module.types_global_values.iter().filter(|i| i.class.opcode == Op::ConstantFalse);
    let never: HashSet<Word> = never.filter_map(|i| i.result_id).collect();
    let Some(header) = &mut module.header else { return 0 };
    let mut count = 0;
    for function in &mut module.functions {
        // From the last to the first, so that what stands before keeps its place.
        for head in (0..function.blocks.len()).rev() {
            if let Some(found) = While::at(function, head, &never) {
                found.turn(function, &mut header.bound);
                count += 1;
            }
        }
    }
    count
}

/// A block, by its place in the function and its label.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Place {
    at: usize,
    label: Word,
}

/// A loop of that form.
struct While {
    /// Where it begins.
    head: Word,
    /// Asks, and goes on to the body or to `skip`, which is empty.
    asks: Place,
    skip: Place,
    /// Where both meet, and choose for each value which of them it is of: (name, of the body, else).
    meet: Place,
    chosen: Vec<(Word, Word, Word)>,
    /// Goes back to the head, by what the body says, or always.
    back: Place,
    says: Option<Word>,
    /// What comes after the loop.
    after: Place,
}

/// The id that an operand names.
fn id(operand: &Operand) -> Option<Word> {
    operand.id_ref_any()
}

/// The target of a block's last instruction, if it is a plain branch.
fn branch(instructions: &[Instruction]) -> Option<Word> {
    let last = instructions.last()?;
    (last.class.opcode == Op::Branch).then(|| id(&last.operands[0]))?
}

/// Condition and targets of a block's last instruction, if it has them.
fn conditional(instructions: &[Instruction]) -> Option<(Word, Word, Word)> {
    let last = instructions.last()?;
    let [a, b, c] = &last.operands[..] else { return None };
    (last.class.opcode == Op::BranchConditional).then(|| Some((id(a)?, id(b)?, id(c)?)))?
}

/// How many instructions name a block as a target.
fn named(function: &Function, block: Word) -> usize {
    let last = function.blocks.iter().filter_map(|b| b.instructions.last());
    last.flat_map(|i| &i.operands).filter(|o| id(o) == Some(block)).count()
}

impl While {
    /// The one whose head is a block, if there is one.
    fn at(function: &Function, head: usize, never: &HashSet<Word>) -> Option<Self> {
        let place = |label: Word| {
            let at = function.blocks.iter().position(|b| b.label_id() == Some(label))?;
            Some(Place { at, label })
        };
        let code = |block: Place| &function.blocks[block.at].instructions[..];
        let head = Place { at: head, label: function.blocks[head].label_id()? };
        let merge = code(head).iter().find(|i| i.class.opcode == Op::LoopMerge)?;
        let (after, back) = (place(id(&merge.operands[0])?)?, place(id(&merge.operands[1])?)?);
        let asks = place(branch(code(head))?)?;
        let (asked, yes, no) = conditional(code(asks))?;
        let selection = code(asks).iter().rev().nth(1).filter(|i| i.class.opcode == Op::SelectionMerge)?;
        let meet = place(id(&selection.operands[0])?)?;
        // One of both ways is empty.
        let empty =
            |way: Word| place(way).filter(|&b| code(b).len() == 1 && branch(code(b)) == Some(meet.label));
        let (body, skip) = match (empty(yes), empty(no)) {
            (None, Some(skip)) => (yes, skip),
            (Some(skip), None) => (no, skip),
            _ => return None,
        };
        let (_, chosen) = code(meet).split_last()?;
        if branch(code(meet)) != Some(back.label) {
            return None;
        }
        let choose = |i: &Instruction| {
            let [a, from, b, other] = i.operands.iter().map(id).collect::<Option<Vec<_>>>()?[..] else {
                return None;
            };
            let of = match (from == skip.label, other == skip.label) {
                (true, false) => (b, a),
                (false, true) => (a, b),
                _ => return None,
            };
            (i.class.opcode == Op::Phi).then_some((i.result_id?, of.0, of.1))
        };
        let chosen: Vec<_> = chosen.iter().map(choose).collect::<Option<_>>()?;
        let (again, to, out) = conditional(code(back))?;
        if code(back).len() != 1 || to != head.label || out != after.label {
            return None;
        }
        // What sends the loop back is what was asked, or what the body says and false without it.
        let says = match chosen.iter().find(|c| c.0 == again) {
            Some(&(_, says, otherwise)) if never.contains(&otherwise) => Some(says),
            None if again == asked && body == yes => None,
            _ => return None,
        };
        // What leaves such a loop must not be read where it asks, unless it has two ways out: a software driver runs a
        // loop for lanes that have left it, too, and reads nothing for them.
        let read = |value: Word| code(asks).iter().any(|i| i.result_id == Some(value));
        let kept = says.is_some() || !chosen.iter().any(|&(_, _, otherwise)| read(otherwise));
        let ways = [(back, 1), (meet, 2), (skip, 1), (after, 1)];
        let alone = ways.iter().all(|&(block, times)| named(function, block.label) == times);
        let plain = code(after).first()?.class.opcode != Op::Phi;
        let head = head.label;
        (kept && alone && plain).then_some(Self { head, asks, skip, meet, chosen, back, says, after })
    }

    /// Leaves the loop where it asks. Takes new ids from `next` on.
    fn turn(self, function: &mut Function, next: &mut Word) {
        let Self { head, asks, skip, meet, chosen, back, says, after } = self;
        let by = |op: Op, operands: &[Word]| {
            Instruction::new(op, None, None, operands.iter().map(|&word| Operand::IdRef(word)).collect())
        };
        let code = &mut function.blocks[asks.at].instructions;
        code.remove(code.len() - 2);
        for operand in code.last_mut().into_iter().flat_map(|last| &mut last.operands) {
            if id(operand) == Some(skip.label) {
                *operand = Operand::IdRef(after.label);
            }
        }
        let choices = &mut function.blocks[meet.at].instructions;
        let choices: Vec<Instruction> = choices.drain(..choices.len() - 1).collect();
        function.blocks[back.at].instructions = vec![match says {
            Some(says) => by(Op::BranchConditional, &[says, head, after.label]),
            None => by(Op::Branch, &[head]),
        }];
        // In the loop values are those of the body. After it they are those of the body or the others, by where it was
        // left.
        let mut inside = HashMap::new();
        let mut outside = HashMap::new();
        let mut joined = Vec::new();
        for (&(name, body, otherwise), choice) in chosen.iter().zip(&choices) {
            inside.insert(name, body);
            let value = if says.is_some() {
                let operands = [otherwise, asks.label, body, back.label].map(Operand::IdRef).to_vec();
                joined.push(Instruction::new(Op::Phi, choice.result_type, Some(*next), operands));
                *next += 1;
                *next - 1
            } else {
                otherwise
            };
            outside.insert(name, value);
        }
        for block in &mut function.blocks {
            let is_head = block.label_id() == Some(head);
            for instruction in &mut block.instructions {
                let of = if is_head && instruction.class.opcode == Op::Phi { &inside } else { &outside };
                for word in instruction.operands.iter_mut().filter_map(Operand::id_ref_any_mut) {
                    *word = of.get(word).copied().unwrap_or(*word);
                }
            }
        }
        function.blocks[after.at].instructions.splice(..0, joined);
        function.blocks.remove(skip.at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::{
        dr::{Block, Builder},
        spirv::{FunctionControl, LoopControl, SelectionControl},
    };

    /// What the words of a loop stand for.
    #[derive(Clone, Copy, PartialEq, Eq)]
    enum Form {
        /// `while i < 9 { i += 1 }`, and `i` after it.
        While,
        /// The same, and after it a number that was found where `i < 9` was asked.
        AskedFor,
        /// `loop { if i >= 9 { break }; i += 1; if i > 5 { break } }`, and `i` after it.
        Two,
    }

    /// Such a loop as rust-gpu makes it, with a sum of what is left after it.
    fn function(form: Form) -> Module {
        let mut b = Builder::new();
        let (void, uint, bool) = (b.type_void(), b.type_int(32, 0), b.type_bool());
        let [zero, one, nine, five] = [0, 1, 9, 5].map(|n| b.constant_bit32(uint, n));
        let never = b.constant_false(bool);
        let kind = b.type_function(void, []);
        b.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        let [before, head, asks, skip, body, meet, back, after] = [(); 8].map(|()| b.id());
        let [i, kept, next] = [(); 3].map(|()| b.id());
        b.begin_block(Some(before)).unwrap();
        b.branch(head).unwrap();
        b.begin_block(Some(head)).unwrap();
        b.phi(uint, Some(i), [(zero, before), (kept, back)]).unwrap();
        b.loop_merge(after, back, LoopControl::NONE, []).unwrap();
        b.branch(asks).unwrap();
        b.begin_block(Some(asks)).unwrap();
        let double = b.i_add(uint, None, i, i).unwrap();
        let asked = b.u_less_than(bool, None, i, nine).unwrap();
        b.selection_merge(meet, SelectionControl::NONE).unwrap();
        b.branch_conditional(asked, body, skip, []).unwrap();
        b.begin_block(Some(skip)).unwrap();
        b.branch(meet).unwrap();
        b.begin_block(Some(body)).unwrap();
        b.i_add(uint, Some(next), i, one).unwrap();
        let more = b.u_less_than_equal(bool, None, next, five).unwrap();
        b.branch(meet).unwrap();
        b.begin_block(Some(meet)).unwrap();
        let otherwise = if form == Form::AskedFor { double } else { i };
        b.phi(uint, Some(kept), [(next, body), (otherwise, skip)]).unwrap();
        let again = b.phi(bool, None, [(more, body), (never, skip)]).unwrap();
        b.branch(back).unwrap();
        b.begin_block(Some(back)).unwrap();
        b.branch_conditional(if form == Form::Two { again } else { asked }, head, after, []).unwrap();
        b.begin_block(Some(after)).unwrap();
        b.i_add(uint, None, kept, zero).unwrap();
        b.ret().unwrap();
        b.end_function().unwrap();
        b.module()
    }

    fn operands(i: &Instruction) -> Vec<Word> {
        i.operands.iter().filter_map(id).collect()
    }

    /// What is left of it, block by block: opcodes.
    fn shape(module: &Module) -> Vec<Vec<Op>> {
        let blocks = module.functions[0].blocks.iter();
        blocks.map(|b| b.instructions.iter().map(|i| i.class.opcode).collect()).collect()
    }

    /// The function once its loop was turned.
    fn turned(form: Form) -> Module {
        let mut module = function(form);
        assert_eq!(leave_where_asked(&mut module), 1);
        module
    }

    /// Its seven blocks: before the loop, head, asking, body, where both meet, going back, after the loop.
    fn parts(module: &Module) -> &[Block; 7] {
        module.functions[0].blocks[..].try_into().unwrap_or_else(|_| panic!("{:?}", shape(module)))
    }

    fn name(block: &Block) -> Word {
        block.label_id().unwrap()
    }

    #[test]
    fn a_loop_is_left_where_it_asks() {
        let mut module = turned(Form::While);
        let [before, head, asks, body, meet, back, after] = parts(&module);
        // By the condition to the body or out of the loop; from its end always back.
        let asked = asks.instructions[1].result_id.unwrap();
        assert_eq!(operands(&asks.instructions[2]), [asked, name(body), name(after)]);
        assert_eq!(
            shape(&module)[2..6],
            [
                vec![Op::IAdd, Op::ULessThan, Op::BranchConditional],
                vec![Op::IAdd, Op::ULessThanEqual, Op::Branch],
                vec![Op::Branch],
                vec![Op::Branch],
            ]
        );
        assert_eq!(operands(&meet.instructions[0]), [name(back)]);
        assert_eq!(operands(&back.instructions[0]), [name(head)]);
        // The head goes on with the body's number; after the loop stands the head's.
        let (i, next) = (head.instructions[0].result_id.unwrap(), body.instructions[0].result_id.unwrap());
        assert_eq!(operands(&head.instructions[0])[1..], [name(before), next, name(back)]);
        assert_eq!(operands(&after.instructions[0])[0], i);
        assert_eq!(leave_where_asked(&mut module), 0);
    }

    #[test]
    fn a_loop_that_its_body_leaves_too_has_two_ways_out() {
        let module = turned(Form::Two);
        let [_, head, asks, body, _, back, after] = parts(&module);
        let more = body.instructions[1].result_id.unwrap();
        assert_eq!(operands(&back.instructions[0]), [more, name(head), name(after)]);
        let (i, next) = (head.instructions[0].result_id.unwrap(), body.instructions[0].result_id.unwrap());
        assert_eq!(operands(&after.instructions[0]), [i, name(asks), next, name(back)]);
        let sum = after.instructions.iter().find(|i| i.class.opcode == Op::IAdd).unwrap();
        assert_eq!(operands(sum)[0], after.instructions[0].result_id.unwrap());
        let ids = module.all_inst_iter().filter_map(|i| i.result_id);
        let (mut seen, bound) = (HashSet::new(), module.header.as_ref().unwrap().bound);
        ids.for_each(|id| assert!(seen.insert(id) && id < bound, "{id}"));
    }

    #[test]
    fn what_is_read_where_a_loop_asks_does_not_leave_it_so() {
        let mut module = function(Form::AskedFor);
        let before = shape(&module);
        assert_eq!(leave_where_asked(&mut module), 0);
        assert_eq!(shape(&module), before);
    }
}
