//! Fixes the specialization constants of a shader, and leaves out the blocks that they rule out.
//!
//! Drivers do the same, but read, check and inline all blocks before they do: modules of megabytes, of which a twelfth is
//! left, took most of the time in which a renderer starts.

use std::{
    collections::{HashMap, HashSet},
    sync::LazyLock,
};

use rspirv::{
    grammar::{INSTRUCTION_TABLE, OperandKind},
    spirv::{Decoration, Op},
};

/// Words before the first instruction.
const HEADER: usize = 5;

/// The module with its specialization constants at these values, by `SpecId`, and at their defaults where none is given.
///
/// A module that is not well-formed comes back as whoever validates it shall see it.
pub(super) fn specialized(spirv: &[u32], values: &[(u32, u32)]) -> Vec<u32> {
    let instructions: Vec<Instruction<'_>> = split(&spirv[HEADER.min(spirv.len())..]);
    let functions = instructions.iter().position(|i| i.op() == Some(Op::Function)).unwrap_or(instructions.len());
    let (globals, functions) = instructions.split_at(functions);

    let mut known = Known::default();
    let globals: Vec<Vec<u32>> = globals.iter().filter_map(|instruction| known.global(instruction, values)).collect();
    let mut code = Vec::new();
    for function in functions.split_inclusive(|instruction| instruction.op() == Some(Op::FunctionEnd)) {
        match Function::new(function).and_then(|function| function.folded(&known)) {
            Some(folded) => code.extend(folded),
            None => code.extend(function.iter().flat_map(|instruction| instruction.0)),
        }
    }
    let defined: HashSet<u32> = globals
        .iter()
        .map(|words| Instruction(words))
        .chain(split(&code))
        .filter_map(|instruction| instruction.result())
        .collect();
    // names and decorations of what is gone
    let stays = |words: &Vec<u32>| match (Instruction(words).op(), &words[1..]) {
        (Some(Op::Name | Op::Decorate | Op::DecorateId), [target, ..]) => defined.contains(target),
        _ => true,
    };
    let mut module = spirv[..HEADER.min(spirv.len())].to_vec();
    module.extend(globals.iter().filter(|words| stays(words)).flatten());
    module.extend(code);
    module
}

/// By opcode, the word of the id that an instruction defines.
static RESULTS: LazyLock<Vec<Option<usize>>> = LazyLock::new(|| {
    let mut words = Vec::new();
    for instruction in INSTRUCTION_TABLE.iter() {
        let opcode = instruction.opcode as usize;
        words.resize(words.len().max(opcode + 1), None);
        let at = instruction.operands.iter().position(|operand| operand.kind == OperandKind::IdResult);
        words[opcode] = at.map(|operand| 1 + operand);
    }
    words
});

/// The words of an instruction.
#[derive(Clone, Copy, Debug)]
struct Instruction<'a>(&'a [u32]);

fn split(mut words: &[u32]) -> Vec<Instruction<'_>> {
    let mut instructions = Vec::new();
    while let Some(first) = words.first() {
        let (instruction, rest) = words.split_at(((first >> 16) as usize).clamp(1, words.len()));
        instructions.push(Instruction(instruction));
        words = rest;
    }
    instructions
}

/// The first word of an instruction of this many words.
fn head(op: Op, words: usize) -> u32 {
    (words as u32) << 16 | op as u32
}

impl<'a> Instruction<'a> {
    fn op(self) -> Option<Op> {
        Op::from_u32(self.0[0] & 0xffff)
    }

    /// The id that it defines.
    fn result(self) -> Option<u32> {
        let at = RESULTS.get((self.0[0] & 0xffff) as usize).copied().flatten()?;
        self.0.get(at).copied()
    }

    /// The blocks that follow a block that ends so.
    fn targets(self) -> Vec<u32> {
        match (self.op(), self.0) {
            (Some(Op::Branch), &[_, target]) => vec![target],
            (Some(Op::BranchConditional), &[_, _, yes, no, ..]) => vec![yes, no],
            (Some(Op::Switch), [_, _, default, cases @ ..]) => {
                std::iter::once(*default).chain(cases.iter().skip(1).step_by(2).copied()).collect()
            }
            _ => vec![],
        }
    }

    /// The blocks that a merge instruction names.
    fn merges(self) -> &'a [u32] {
        match (self.op(), self.0) {
            (Some(Op::LoopMerge), [_, targets @ .., _]) => &targets[..2.min(targets.len())],
            (Some(Op::SelectionMerge), [_, targets @ .., _]) => targets,
            _ => &[],
        }
    }
}

/// The bits of 32-bit numbers that are known, and 0 or 1 for truth values.
#[derive(Clone, Default)]
struct Known {
    values: HashMap<u32, u32>,
    /// The given values of specialization constants.
    given: HashMap<u32, u32>,
    /// The type of truth values.
    bool: Option<u32>,
}

impl Known {
    fn of(&self, id: u32) -> Option<u32> {
        self.values.get(&id).copied()
    }

    /// An instruction outside functions, a constant for a specialization constant. Nothing, where it numbers one.
    fn global(&mut self, instruction: &Instruction<'_>, values: &[(u32, u32)]) -> Option<Vec<u32>> {
        let words = instruction.0;
        let constant = match (instruction.op(), words) {
            (Some(Op::Decorate), &[_, id, decoration, spec_id]) if decoration == Decoration::SpecId as u32 => {
                if let Some((_, value)) = values.iter().find(|(id, _)| *id == spec_id) {
                    self.given.insert(id, *value);
                }
                return None;
            }
            (Some(Op::TypeBool), &[_, id]) => {
                self.bool = Some(id);
                None
            }
            (Some(Op::ConstantTrue), &[_, ty, id]) => Some((ty, id, 1)),
            (Some(Op::ConstantFalse), &[_, ty, id]) => Some((ty, id, 0)),
            (Some(Op::Constant), &[_, ty, id, value]) => Some((ty, id, value)),
            (Some(Op::SpecConstantTrue), &[_, ty, id]) => Some((ty, id, self.given.get(&id).copied().unwrap_or(1))),
            (Some(Op::SpecConstantFalse), &[_, ty, id]) => Some((ty, id, self.given.get(&id).copied().unwrap_or(0))),
            (Some(Op::SpecConstant), &[_, ty, id, value]) => {
                Some((ty, id, self.given.get(&id).copied().unwrap_or(value)))
            }
            (Some(Op::SpecConstantOp), &[_, ty, id, op, ref operands @ ..]) => {
                Op::from_u32(op).and_then(|op| self.evaluated(op, operands)).map(|value| (ty, id, value))
            }
            _ => None,
        };
        let Some((ty, id, value)) = constant else { return Some(words.to_vec()) };
        self.values.insert(id, value);
        Some(match self.bool == Some(ty) {
            true => vec![head(if value != 0 { Op::ConstantTrue } else { Op::ConstantFalse }, 3), ty, id],
            false => vec![head(Op::Constant, 4), ty, id, value],
        })
    }

    /// The value of an operation, where its operands tell.
    fn evaluated(&self, op: Op, operands: &[u32]) -> Option<u32> {
        let value = |n: usize| operands.get(n).and_then(|id| self.of(*id));
        let (a, b) = (value(0), value(1));
        match op {
            Op::LogicalAnd if a == Some(0) || b == Some(0) => return Some(0),
            Op::LogicalOr if a == Some(1) || b == Some(1) => return Some(1),
            Op::LogicalNot => return Some(u32::from(a? == 0)),
            Op::Select => return if a? != 0 { b } else { value(2) },
            Op::CopyObject => return a,
            _ => {}
        }
        let (a, b) = (a?, b?);
        let (i, j) = (a.cast_signed(), b.cast_signed());
        let truth = |value: bool| Some(u32::from(value));
        match op {
            Op::LogicalAnd | Op::BitwiseAnd => Some(a & b),
            Op::LogicalOr | Op::BitwiseOr => Some(a | b),
            Op::LogicalEqual | Op::IEqual => truth(a == b),
            Op::LogicalNotEqual | Op::INotEqual => truth(a != b),
            Op::UGreaterThan => truth(a > b),
            Op::UGreaterThanEqual => truth(a >= b),
            Op::ULessThan => truth(a < b),
            Op::ULessThanEqual => truth(a <= b),
            Op::SGreaterThan => truth(i > j),
            Op::SGreaterThanEqual => truth(i >= j),
            Op::SLessThan => truth(i < j),
            Op::SLessThanEqual => truth(i <= j),
            Op::IAdd => Some(a.wrapping_add(b)),
            Op::ISub => Some(a.wrapping_sub(b)),
            Op::IMul => Some(a.wrapping_mul(b)),
            _ => None,
        }
    }
}

/// A block: its label, and the instructions after it.
struct Block<'a> {
    label: u32,
    body: &'a [Instruction<'a>],
    end: Instruction<'a>,
}

/// A function with a body.
struct Function<'a> {
    /// Before the first block.
    start: &'a [Instruction<'a>],
    blocks: Vec<Block<'a>>,
    /// `OpFunctionEnd`.
    end: Instruction<'a>,
}

impl<'a> Function<'a> {
    /// Finds the blocks.
    fn new(instructions: &'a [Instruction<'a>]) -> Option<Self> {
        let is_label = |instruction: &Instruction<'_>| instruction.op() == Some(Op::Label);
        let (end, instructions) = instructions.split_last()?;
        let first = instructions.iter().position(is_label)?;
        let (start, mut rest) = instructions.split_at(first);
        let mut blocks = Vec::new();
        while let Some((label, body)) = rest.split_first() {
            let length = body.iter().position(is_label).unwrap_or(body.len());
            let (last, inner) = body[..length].split_last()?;
            blocks.push(Block { label: label.result()?, body: inner, end: *last });
            rest = &body[length..];
        }
        Some(Self { start, blocks, end: *end })
    }

    /// The function's words without the blocks that no path leads to; nothing if loops would no longer be loops.
    fn folded(&self, globals: &Known) -> Option<Vec<u32>> {
        let reached = self.reached(globals)?;
        let stubs: HashSet<u32> = self
            .live(&reached)
            .flat_map(|block| reached.merge(block).into_iter().flat_map(Instruction::merges))
            .copied()
            .filter(|label| !reached.blocks.contains(label))
            .collect();
        let mut words: Vec<u32> = self.start.iter().flat_map(|instruction| instruction.0).copied().collect();
        for block in &self.blocks {
            if reached.blocks.contains(&block.label) {
                self.write(block, &reached, &mut words);
            } else if stubs.contains(&block.label) {
                // A merge instruction names it: it stays as a block that nothing leads to.
                words.extend([head(Op::Label, 2), block.label]);
                match self.live(&reached).find(|header| header.continues() == Some(block.label)) {
                    Some(header) => words.extend([head(Op::Branch, 2), header.label]),
                    None => words.push(head(Op::Unreachable, 1)),
                }
            }
        }
        words.extend(self.end.0);
        Some(words)
    }

    fn live(&self, reached: &Reached) -> impl Iterator<Item = &Block<'a>> {
        self.blocks.iter().filter(|block| reached.blocks.contains(&block.label))
    }

    /// Follows the branches from the first block on. Blocks come after those that dominate them, so one walk is enough.
    fn reached(&self, globals: &Known) -> Option<Reached> {
        let order: HashMap<u32, usize> = self.blocks.iter().enumerate().map(|(n, block)| (block.label, n)).collect();
        let mut reached = Reached::default();
        let mut known = globals.clone();
        reached.blocks.extend(self.blocks.first().map(|block| block.label));
        for (at, block) in self.blocks.iter().enumerate() {
            if !reached.blocks.contains(&block.label) {
                continue;
            }
            for instruction in block.body {
                let value = match (instruction.op(), instruction.0) {
                    (Some(Op::Phi), [_, _, _, pairs @ ..]) => {
                        let mut values = pairs.chunks_exact(2).filter_map(|pair| match order.get(&pair[1])? {
                            before if *before < at => {
                                reached.edges.contains(&(pair[1], block.label)).then(|| known.of(pair[0]))
                            }
                            _ => Some(None), // a way back, not known yet
                        });
                        let first = values.next().flatten();
                        first.filter(|_| values.all(|value| value == first))
                    }
                    (Some(op), [_, _, _, operands @ ..]) => known.evaluated(op, operands),
                    _ => None,
                };
                if let (Some(value), Some(result)) = (value, instruction.result()) {
                    known.values.insert(result, value);
                }
            }
            let targets = match (block.end.op(), block.end.0) {
                // The way back of a loop stays, whatever its condition.
                (Some(Op::BranchConditional), &[_, condition, yes, no, ..])
                    if [yes, no].iter().all(|target| order.get(target).is_some_and(|n| *n > at)) =>
                {
                    match known.of(condition) {
                        Some(value) => {
                            let target = if value != 0 { yes } else { no };
                            reached.decided.insert(block.label, target);
                            vec![target]
                        }
                        None => vec![yes, no],
                    }
                }
                _ => block.end.targets(),
            };
            for target in targets {
                reached.blocks.insert(target);
                reached.edges.insert((block.label, target));
            }
        }
        // A loop whose continue target is reached must come back.
        let whole = self.live(&reached).all(|header| match header.continues() {
            Some(target) if reached.blocks.contains(&target) => reached
                .edges
                .iter()
                .any(|(from, to)| *to == header.label && order.get(from) >= order.get(&header.label)),
            _ => true,
        });
        whole.then_some(reached)
    }

    /// Writes a block that is reached.
    fn write(&self, block: &Block<'_>, reached: &Reached, words: &mut Vec<u32>) {
        let lost = block.continues().filter(|target| !reached.blocks.contains(target));
        let merge = reached.merge(block);
        words.extend([head(Op::Label, 2), block.label]);
        for instruction in block.body {
            match (instruction.op(), instruction.0) {
                (Some(Op::Phi), [_, ty, result, pairs @ ..]) => {
                    let stays = |pair: &&[u32]| reached.edges.contains(&(pair[1], block.label));
                    let mut pairs: Vec<u32> = pairs.chunks_exact(2).filter(stays).flatten().copied().collect();
                    // what never comes back brings back what was there
                    pairs.extend(lost.iter().flat_map(|from| [*result, *from]));
                    words.extend([head(Op::Phi, 3 + pairs.len()), *ty, *result]);
                    words.extend(pairs);
                }
                (Some(Op::SelectionMerge), _) if merge.is_none() => {}
                _ => words.extend(instruction.0),
            }
        }
        match reached.decided.get(&block.label) {
            Some(target) => words.extend([head(Op::Branch, 2), *target]),
            None => words.extend(block.end.0),
        }
    }
}

impl<'a> Block<'a> {
    /// The continue target, in the header of a loop.
    fn continues(&self) -> Option<u32> {
        let last = self.body.last().filter(|instruction| instruction.op() == Some(Op::LoopMerge))?;
        last.merges().get(1).copied()
    }
}

/// What paths lead to.
#[derive(Default)]
struct Reached {
    blocks: HashSet<u32>,
    edges: HashSet<(u32, u32)>,
    /// Where conditions are known: the one block that follows.
    decided: HashMap<u32, u32>,
}

impl Reached {
    /// The block's merge instruction, which a selection that is decided no longer needs.
    fn merge<'a>(&self, block: &Block<'a>) -> Option<Instruction<'a>> {
        let last = block.body.last().copied().filter(|instruction| !instruction.merges().is_empty())?;
        (last.op() == Some(Op::LoopMerge) || !self.decided.contains_key(&block.label)).then_some(last)
    }
}

#[cfg(all(test, debug_assertions))] // sources of all shaders are known in debug builds
mod tests {
    use super::*;
    use crate::shaders;

    /// What validators demand of blocks: branches lead to blocks, and each phi names the blocks that lead to its own.
    fn is_well_formed(module: &[u32]) {
        let instructions = split(&module[HEADER..]);
        let functions = instructions.iter().position(|i| i.op() == Some(Op::Function)).expect("main");
        let results: HashSet<u32> = instructions.iter().filter_map(|instruction| instruction.result()).collect();
        for instruction in &instructions {
            if let (Some(Op::Name | Op::Decorate), [_, target, ..]) = (instruction.op(), instruction.0) {
                assert!(results.contains(target), "{instruction:?} is of what is gone");
            }
            let left = [Op::SpecConstant, Op::SpecConstantTrue, Op::SpecConstantFalse];
            assert!(!left.iter().any(|op| instruction.op() == Some(*op)), "{instruction:?} is left");
        }
        for function in instructions[functions..].split_inclusive(|i| i.op() == Some(Op::FunctionEnd)) {
            let Some(function) = Function::new(function) else { continue };
            let mut before: HashMap<u32, Vec<u32>> =
                function.blocks.iter().map(|block| (block.label, vec![])).collect();
            for block in &function.blocks {
                for target in block.end.targets() {
                    let list = before.get_mut(&target).expect("branches lead to blocks");
                    if !list.contains(&block.label) {
                        list.push(block.label);
                    }
                }
            }
            for block in &function.blocks {
                for instruction in block.body {
                    assert!(instruction.merges().iter().all(|target| before.contains_key(target)), "{instruction:?}");
                    if let (Some(Op::Phi), [_, _, _, pairs @ ..]) = (instruction.op(), instruction.0) {
                        let mut named: Vec<u32> = pairs.iter().skip(1).step_by(2).copied().collect();
                        let mut leading = before[&block.label].clone();
                        named.sort_unstable();
                        leading.sort_unstable();
                        assert_eq!(named, leading, "{instruction:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_shader_is_well_formed_whatever_its_constants() {
        let mut random = fastrand::Rng::with_seed(1);
        for (_, spirv) in shaders::SOURCES {
            for round in 0..8 {
                let values: Vec<(u32, u32)> = (0..64).map(|id| (id, random.u32(0..2))).collect();
                let module = specialized(spirv, if round == 0 { &[] } else { &values });
                is_well_formed(&module);
                assert_eq!(specialized(&module, &[]), module, "what is folded once is folded");
            }
        }
    }

    #[test]
    fn what_constants_rule_out_is_gone() {
        let none: Vec<(u32, u32)> = (0..64).map(|id| (id, 0)).collect();
        let module = specialized(shaders::IRRADIANCE, &none);
        assert!(4 * module.len() < shaders::IRRADIANCE.len(), "{} words", module.len());
    }
}
