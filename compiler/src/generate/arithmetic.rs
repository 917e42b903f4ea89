//! Functions of numbers, and calls of kernels.

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{AbiParam, InstBuilder, SigRef, Signature, Value, types};

use super::Surroundings;
use super::emitter::{Emitter, WORD};
use super::memory::constant_memory;
use crate::ir::{BinaryFn, List, UnaryFn};
use crate::kernels::{self, KernelTable, UNARY_COUNT};
use crate::schedule::BlockId;

pub(super) fn unary(emitter: &mut Emitter<'_>, block: BlockId, f: UnaryFn, a: Value) -> Value {
    match f {
        UnaryFn::Neg => emitter.negative(block, a),
        UnaryFn::Abs => emitter.b.ins().fabs(a),
        UnaryFn::Sqrt => emitter.b.ins().sqrt(a),
        UnaryFn::Floor if emitter.input.rounding => emitter.b.ins().floor(a),
        UnaryFn::Ceil if emitter.input.rounding => emitter.b.ins().ceil(a),
        UnaryFn::Round if emitter.input.rounding => emitter.b.ins().nearest(a),
        UnaryFn::Sign => {
            let two = emitter.is_two(block);
            let (zero, one, minus) = (emitter.number(block, 0.0), emitter.number(block, 1.0), emitter.number(block, -1.0));
            let (up, down) = (emitter.b.ins().fcmp(FloatCC::GreaterThan, a, zero), emitter.b.ins().fcmp(FloatCC::LessThan, a, zero));
            let lower = emitter.select(two, down, minus, a);
            emitter.select(two, up, one, lower)
        }
        _ => match f.kernel() {
            Some(kernel) => call(emitter, block, kernel as i64, &[a]),
            None => a,
        },
    }
}

pub(super) fn whole_power(emitter: &mut Emitter<'_>, block: BlockId, a: Value, n: i32) -> Value {
    let power = kernels::power_chain(n.unsigned_abs(), a, |x, y| emitter.b.ins().fmul(x, y));
    if let Some(power) = power.filter(|_| n > 0) {
        return power;
    }
    let one = emitter.held_number(block, 1.0);
    power.map_or(one, |power| emitter.b.ins().fdiv(one, power))
}

pub(super) fn binary(emitter: &mut Emitter<'_>, block: BlockId, f: BinaryFn, a: Value, b: Value) -> Value {
    match f {
        BinaryFn::Add => emitter.b.ins().fadd(a, b),
        BinaryFn::Sub => emitter.b.ins().fsub(a, b),
        BinaryFn::Mul => emitter.b.ins().fmul(a, b),
        BinaryFn::Div => emitter.b.ins().fdiv(a, b),
        BinaryFn::Min => emitter.least(a, b),
        BinaryFn::Max => emitter.most(a, b),
        BinaryFn::Pow => call(emitter, block, pow_entry(), &[a, b]),
        BinaryFn::Atan2 => call(emitter, block, pow_entry() + 1, &[a, b]),
    }
}

/// Calls a kernel of numbers by its place in the table.
fn call(emitter: &mut Emitter<'_>, block: BlockId, entry: i64, arguments: &[Value]) -> Value {
    each_lane(emitter, block, arguments, &mut |emitter, numbers| call_scalar(emitter, entry, numbers))
}

/// Calls a kernel of a number and a list by its place in the table.
pub(super) fn look_up(emitter: &mut Emitter<'_>, block: BlockId, entry: i64, a: Value, list: List) -> Value {
    each_lane(emitter, block, &[a], &mut |emitter, numbers| call_with_list(emitter, entry, numbers[0], list))
}

/// A function of numbers, once a lane.
fn each_lane(
    emitter: &mut Emitter<'_>,
    block: BlockId,
    arguments: &[Value],
    f: &mut dyn FnMut(&mut Emitter<'_>, &[Value]) -> Value,
) -> Value {
    if !emitter.is_two(block) {
        return f(emitter, arguments);
    }
    let mut both = None;
    for lane in [0u8, 1] {
        let numbers: Vec<Value> = arguments.iter().map(|a| emitter.b.ins().extractlane(*a, lane)).collect();
        let result = f(emitter, &numbers);
        both = Some(match both {
            None => emitter.b.ins().splat(types::F64X2, result),
            Some(first) => emitter.b.ins().insertlane(first, result, lane),
        });
    }
    both.unwrap_or(arguments[0])
}

fn call_scalar(emitter: &mut Emitter<'_>, entry: i64, arguments: &[Value]) -> Value {
    let signature = signature(emitter, arguments.len(), true);
    let callee = kernel(emitter, entry);
    let call = emitter.b.ins().call_indirect(signature, callee, arguments);
    emitter.b.inst_results(call)[0]
}

fn call_with_list(emitter: &mut Emitter<'_>, entry: i64, a: Value, list: List) -> Value {
    let lists_at = std::mem::offset_of!(Surroundings, lists) as i32;
    let lists = emitter.b.ins().load(types::I64, constant_memory(), emitter.input.arguments.surroundings, lists_at);
    let start = emitter.b.ins().iadd_imm_s(lists, i64::from(list.first) * WORD);
    let len = emitter.b.ins().iconst(types::I64, i64::from(list.len));
    let mut signature = Signature::new(emitter.b.func.signature.call_conv);
    signature.params.extend([types::F64, types::I64, types::I64].map(AbiParam::new));
    signature.returns.push(AbiParam::new(types::F64));
    let signature = emitter.b.import_signature(signature);
    let callee = kernel(emitter, entry);
    let call = emitter.b.ins().call_indirect(signature, callee, &[a, start, len]);
    emitter.b.inst_results(call)[0]
}

/// Calls an array kernel by its place in the table: pointers, then the number of elements.
pub(super) fn call_array(emitter: &mut Emitter<'_>, entry: i64, pointers: &[Value], n: u32) {
    let count = emitter.b.ins().iconst(types::I64, i64::from(n));
    let mut arguments = pointers.to_vec();
    arguments.push(count);
    let signature = signature(emitter, arguments.len(), false);
    let callee = kernel(emitter, entry);
    emitter.b.ins().call_indirect(signature, callee, &arguments);
}

fn kernel(emitter: &mut Emitter<'_>, entry: i64) -> Value {
    let offset = (entry * WORD) as i32;
    emitter.b.ins().load(types::I64, constant_memory(), emitter.input.arguments.surroundings, offset)
}

fn signature(emitter: &mut Emitter<'_>, arguments: usize, numbers: bool) -> SigRef {
    if let Some(&known) = emitter.signatures.get(&(arguments, numbers)) {
        return known;
    }
    let mut signature = Signature::new(emitter.b.func.signature.call_conv);
    let kind = if numbers { types::F64 } else { types::I64 };
    signature.params.extend((0..arguments).map(|_| AbiParam::new(kind)));
    if numbers {
        signature.returns.push(AbiParam::new(types::F64));
    }
    let known = emitter.b.import_signature(signature);
    emitter.signatures.insert((arguments, numbers), known);
    known
}

/// Place of a search in the table of kernels, by [`KernelTable::passed`].
pub(super) fn passed_entry(up_to: bool) -> i64 {
    std::mem::offset_of!(KernelTable, passed) as i64 / WORD + i64::from(up_to)
}

/// Place of [`KernelTable::entry`].
pub(super) fn list_entry() -> i64 {
    std::mem::offset_of!(KernelTable, entry) as i64 / WORD
}

/// Place of `pow` in the table of kernels; `atan2` and the two array versions follow.
pub(super) fn pow_entry() -> i64 {
    2 * UNARY_COUNT as i64
}
