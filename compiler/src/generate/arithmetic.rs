//! Functions of numbers, and calls of kernels.

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{AbiParam, InstBuilder, SigRef, Signature, Value, types};

use super::Surroundings;
use super::emitter::{Emitter, WORD};
use super::memory::constant_memory;
use crate::ir::{BinaryFn, List, UnaryFn};
use crate::kernels::{self, KernelTable, UNARY_COUNT};
use crate::schedule::BlockId;

impl Emitter<'_> {
    pub(super) fn unary(&mut self, block: BlockId, f: UnaryFn, a: Value) -> Value {
        match f {
            UnaryFn::Neg => self.negative(block, a),
            UnaryFn::Abs => self.b.ins().fabs(a),
            UnaryFn::Sqrt => self.b.ins().sqrt(a),
            UnaryFn::Floor if self.input.rounding => self.b.ins().floor(a),
            UnaryFn::Ceil if self.input.rounding => self.b.ins().ceil(a),
            UnaryFn::Round if self.input.rounding => self.b.ins().nearest(a),
            UnaryFn::Sign => {
                let two = self.is_two(block);
                let (zero, one, minus) = (self.number(block, 0.0), self.number(block, 1.0), self.number(block, -1.0));
                let (up, down) = (self.b.ins().fcmp(FloatCC::GreaterThan, a, zero), self.b.ins().fcmp(FloatCC::LessThan, a, zero));
                let lower = self.select(two, down, minus, a);
                self.select(two, up, one, lower)
            }
            _ => match f.kernel() {
                Some(kernel) => self.call(block, kernel as i64, &[a]),
                None => a,
            },
        }
    }

    pub(super) fn whole_power(&mut self, block: BlockId, a: Value, n: i32) -> Value {
        let power = kernels::power_chain(n.unsigned_abs(), a, |x, y| self.b.ins().fmul(x, y));
        if let Some(power) = power.filter(|_| n > 0) {
            return power;
        }
        let one = self.held_number(block, 1.0);
        power.map_or(one, |power| self.b.ins().fdiv(one, power))
    }

    pub(super) fn binary(&mut self, block: BlockId, f: BinaryFn, a: Value, b: Value) -> Value {
        match f {
            BinaryFn::Add => self.b.ins().fadd(a, b),
            BinaryFn::Sub => self.b.ins().fsub(a, b),
            BinaryFn::Mul => self.b.ins().fmul(a, b),
            BinaryFn::Div => self.b.ins().fdiv(a, b),
            BinaryFn::Min => self.choose(FloatCC::LessThan, a, b),
            BinaryFn::Max => self.choose(FloatCC::GreaterThan, a, b),
            BinaryFn::Pow => self.call(block, pow_entry(), &[a, b]),
            BinaryFn::Atan2 => self.call(block, pow_entry() + 1, &[a, b]),
        }
    }

    /// Calls a kernel of numbers by its place in the table.
    fn call(&mut self, block: BlockId, entry: i64, arguments: &[Value]) -> Value {
        self.each_lane(block, arguments, &mut |emitter, numbers| emitter.call_scalar(entry, numbers))
    }

    /// Calls a kernel of a number and a list by its place in the table.
    pub(super) fn look_up(&mut self, block: BlockId, entry: i64, a: Value, list: List) -> Value {
        self.each_lane(block, &[a], &mut |emitter, numbers| emitter.call_with_list(entry, numbers[0], list))
    }

    /// A function of numbers, once a lane.
    fn each_lane(&mut self, block: BlockId, arguments: &[Value], f: &mut dyn FnMut(&mut Self, &[Value]) -> Value) -> Value {
        if !self.is_two(block) {
            return f(self, arguments);
        }
        let mut both = None;
        for lane in [0u8, 1] {
            let numbers: Vec<Value> = arguments.iter().map(|a| self.b.ins().extractlane(*a, lane)).collect();
            let result = f(self, &numbers);
            both = Some(match both {
                None => self.b.ins().splat(types::F64X2, result),
                Some(first) => self.b.ins().insertlane(first, result, lane),
            });
        }
        both.unwrap_or(arguments[0])
    }

    fn call_scalar(&mut self, entry: i64, arguments: &[Value]) -> Value {
        let signature = self.signature(arguments.len(), true);
        let callee = self.kernel(entry);
        let call = self.b.ins().call_indirect(signature, callee, arguments);
        self.b.inst_results(call)[0]
    }

    fn call_with_list(&mut self, entry: i64, a: Value, list: List) -> Value {
        let lists_at = std::mem::offset_of!(Surroundings, lists) as i32;
        let lists = self.b.ins().load(types::I64, constant_memory(), self.input.arguments.surroundings, lists_at);
        let start = self.b.ins().iadd_imm_s(lists, i64::from(list.first) * WORD);
        let len = self.b.ins().iconst(types::I64, i64::from(list.len));
        let mut signature = Signature::new(self.b.func.signature.call_conv);
        signature.params.extend([types::F64, types::I64, types::I64].map(AbiParam::new));
        signature.returns.push(AbiParam::new(types::F64));
        let signature = self.b.import_signature(signature);
        let callee = self.kernel(entry);
        let call = self.b.ins().call_indirect(signature, callee, &[a, start, len]);
        self.b.inst_results(call)[0]
    }

    /// Calls an array kernel by its place in the table: pointers, then the number of elements.
    pub(super) fn call_array(&mut self, entry: i64, pointers: &[Value], n: u32) {
        let count = self.b.ins().iconst(types::I64, i64::from(n));
        let mut arguments = pointers.to_vec();
        arguments.push(count);
        let signature = self.signature(arguments.len(), false);
        let callee = self.kernel(entry);
        self.b.ins().call_indirect(signature, callee, &arguments);
    }

    fn kernel(&mut self, entry: i64) -> Value {
        let offset = (entry * WORD) as i32;
        self.b.ins().load(types::I64, constant_memory(), self.input.arguments.surroundings, offset)
    }

    fn signature(&mut self, arguments: usize, numbers: bool) -> SigRef {
        if let Some(&known) = self.signatures.get(&(arguments, numbers)) {
            return known;
        }
        let mut signature = Signature::new(self.b.func.signature.call_conv);
        let kind = if numbers { types::F64 } else { types::I64 };
        signature.params.extend((0..arguments).map(|_| AbiParam::new(kind)));
        if numbers {
            signature.returns.push(AbiParam::new(types::F64));
        }
        let known = self.b.import_signature(signature);
        self.signatures.insert((arguments, numbers), known);
        known
    }
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
