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
    let next = module.header.as_ref().map_or(0, |header| header.bound);
    let mut turned = Turned { never, next, count: 0 };
    for function in &mut module.functions {
        // From the last to the first, so that what stands before keeps its place.
        for header in (0..function.blocks.len()).rev() {
            if let Some(found) = While::at(function, header, &turned.never) {
                found.turn(function, &mut turned);
            }
        }
    }
    if let Some(header) = &mut module.header {
        header.bound = turned.next;
    }
    turned.count
}

/// What was done so far.
struct Turned {
    /// The constants that are false.
    never: HashSet<Word>,
    /// The next id.
    next: Word,
    count: usize,
}

/// A loop of that form, by places of its blocks.
struct While {
    /// Asks, and goes on to the body or to `skip`, which is empty.
    asks: usize,
    skip: usize,
    /// Where both meet, and choose for each value which of them it is of: (name, of the body, else).
    meet: usize,
    chosen: Vec<(Word, Word, Word)>,
    /// Goes back to the loop's head, by what the body says, or always.
    back: usize,
    header: Word,
    says: Option<Word>,
    /// What comes after the loop.
    after: usize,
}

/// The id of a block's or an operand's.
fn id(operand: &Operand) -> Option<Word> {
    operand.id_ref_any()
}

fn label(function: &Function, block: usize) -> Option<Word> {
    function.blocks[block].label_id()
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
        let place = |id: Word| function.blocks.iter().position(|b| b.label_id() == Some(id));
        let code = |block: usize| &function.blocks[block].instructions[..];
        let merge = code(head).iter().find(|i| i.class.opcode == Op::LoopMerge)?;
        let (after, back) = (id(&merge.operands[0])?, id(&merge.operands[1])?);
        let header = label(function, head)?;
        let asks = place(branch(code(head))?)?;
        let (asked, yes, no) = conditional(code(asks))?;
        let selection = code(asks).iter().rev().nth(1).filter(|i| i.class.opcode == Op::SelectionMerge)?;
        let meets = id(&selection.operands[0])?;
        // One of both ways is empty.
        let empty =
            |way: Word| Some(place(way)?).filter(|&b| code(b).len() == 1 && branch(code(b)) == Some(meets));
        let (body, skip) = match (empty(yes), empty(no)) {
            (None, Some(skip)) => (yes, skip),
            (Some(skip), None) => (no, skip),
            _ => return None,
        };
        let skipped = label(function, skip)?;
        let meet = place(meets)?;
        let (ends, chosen) = code(meet).split_last()?;
        if ends.class.opcode != Op::Branch || id(&ends.operands[0]) != Some(back) {
            return None;
        }
        let choose = |i: &Instruction| {
            let [a, from, b, other] = i.operands.iter().map(id).collect::<Option<Vec<_>>>()?[..] else {
                return None;
            };
            let of = match (from == skipped, other == skipped) {
                (true, false) => (b, a),
                (false, true) => (a, b),
                _ => return None,
            };
            (i.class.opcode == Op::Phi).then_some((i.result_id?, of.0, of.1))
        };
        let chosen: Vec<_> = chosen.iter().map(choose).collect::<Option<_>>()?;
        let (back, after) = (place(back)?, place(after)?);
        let (again, to, out) = conditional(code(back))?;
        if code(back).len() != 1 || to != header || Some(out) != label(function, after) {
            return None;
        }
        // What sends the loop back is what was asked, or what the body says and false without it.
        let says = match chosen.iter().find(|c| c.0 == again) {
            Some(&(_, says, otherwise)) if never.contains(&otherwise) => Some(says),
            None if again == asked && body == yes => None,
            _ => return None,
        };
        // Values leave a loop as its head's, or as its body's and others: a software driver runs a loop for lanes that
        // have left it, too, and reads nothing for them.
        let outer = |value: Word| {
            let of = function
                .blocks
                .iter()
                .position(|b| b.instructions.iter().any(|i| i.result_id == Some(value)));
            of != Some(asks)
        };
        if says.is_none() && !chosen.iter().all(|&(_, _, otherwise)| outer(otherwise)) {
            return None;
        }
        let alone = [(back, 1), (meet, 2), (skip, 1), (after, 1)];
        let alone =
            alone.iter().all(|&(b, times)| label(function, b).is_some_and(|l| named(function, l) == times));
        let plain = code(after).first()?.class.opcode != Op::Phi;
        (alone && plain).then_some(Self { asks, skip, meet, chosen, back, header, says, after })
    }

    /// Leaves the loop where it asks.
    fn turn(self, function: &mut Function, turned: &mut Turned) {
        let (Some(after), Some(asks), Some(back)) =
            (label(function, self.after), label(function, self.asks), label(function, self.back))
        else {
            return;
        };
        turned.count += 1;
        let by = |op: Op, operands: Vec<Word>| {
            Instruction::new(op, None, None, operands.into_iter().map(Operand::IdRef).collect())
        };
        let skipped = label(function, self.skip);
        let code = &mut function.blocks[self.asks].instructions;
        code.remove(code.len() - 2);
        if let Some(last) = code.last_mut() {
            for operand in last.operands.iter_mut().filter(|o| id(o) == skipped) {
                *operand = Operand::IdRef(after);
            }
        }
        let choices = &mut function.blocks[self.meet].instructions;
        let choices: Vec<Instruction> = choices.drain(..choices.len() - 1).collect();
        function.blocks[self.back].instructions = vec![match self.says {
            Some(says) => by(Op::BranchConditional, vec![says, self.header, after]),
            None => by(Op::Branch, vec![self.header]),
        }];
        // In the loop values are those of the body. After it they are those of the body or the others, by where it was
        // left.
        let mut inside = HashMap::new();
        let mut outside = HashMap::new();
        let mut joined = Vec::new();
        for (&(name, body, otherwise), choice) in self.chosen.iter().zip(&choices) {
            inside.insert(name, body);
            let value = if self.says.is_some() {
                let operands = [otherwise, asks, body, back].map(Operand::IdRef).to_vec();
                joined.push(Instruction::new(Op::Phi, choice.result_type, Some(turned.next), operands));
                turned.next += 1;
                turned.next - 1
            } else {
                otherwise
            };
            outside.insert(name, value);
        }
        for block in &mut function.blocks {
            let head = block.label_id() == Some(self.header);
            for instruction in &mut block.instructions {
                let of = if head && instruction.class.opcode == Op::Phi { &inside } else { &outside };
                for word in instruction.operands.iter_mut().filter_map(Operand::id_ref_any_mut) {
                    *word = of.get(word).copied().unwrap_or(*word);
                }
            }
        }
        function.blocks[self.after].instructions.splice(..0, joined);
        function.blocks.remove(self.skip);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::{
        dr::Builder,
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

    #[test]
    fn a_loop_is_left_where_it_asks() {
        let mut module = function(Form::While);
        assert_eq!(leave_where_asked(&mut module), 1);
        let [before, head, asks, body, meet, back, after] = &module.functions[0].blocks[..] else {
            panic!("{:?}", shape(&module))
        };
        let name = |block: &rspirv::dr::Block| block.label_id().unwrap();
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
        let mut module = function(Form::Two);
        assert_eq!(leave_where_asked(&mut module), 1);
        let [_, head, asks, body, _, back, after] = &module.functions[0].blocks[..] else {
            panic!("{:?}", shape(&module))
        };
        let name = |block: &rspirv::dr::Block| block.label_id().unwrap();
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
