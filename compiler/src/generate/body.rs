//! The code of nodes: values, operands, reductions.

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{InstBuilder, Value, types};

use super::arithmetic::{list_entry, passed_entry};
use super::emitter::{Emitter, Lanes};
use super::segments::is_load;
use super::{arithmetic, memory};
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, Flavour, ReduceFn, Side, Store, VarId};
use crate::schedule::{BlockId, Item, is_immediate};

impl Emitter<'_> {
    /// Loads what an item needs from outside of loops.
    pub(super) fn fetch_outside(&mut self, block: BlockId, item: Item) {
        let (schedule, exprs) = (self.input.schedule, self.input.exprs);
        schedule.each_use(exprs, block, item, &mut |from, expr| {
            if !is_immediate(exprs.node(expr)) && schedule.home(exprs, from, expr) == 0 {
                self.value(0, expr);
            }
        });
    }

    /// Forgets what was computed in a block and inside of it.
    pub(super) fn forget(&mut self, block: BlockId) {
        for b in 0..self.input.schedule.blocks.len() {
            if self.input.schedule.is_inside(b, block) {
                self.values[b].clear();
                self.pointers[b].clear();
                self.counters[b] = None;
            }
        }
    }

    pub(super) fn item(&mut self, block: BlockId, item: Item) {
        match item {
            // Written where it is used.
            Item::Eval(expr) if block == 0 && self.input.segments.is_active() && is_load(self.input.exprs.node(expr)) => {}
            Item::Eval(expr) => {
                let value = self.node(block, expr);
                self.define(block, expr, value);
            }
            Item::Reduce { expr, op, body, block: inner } => {
                if block == 0 && self.input.segments.is_active() {
                    self.fetch_outside(block, item);
                }
                let value = self.reduce(op, body, inner);
                self.define(block, expr, value);
            }
            Item::Store(Store { target, value }) => {
                let number = self.as_number(block, value);
                memory::store(self, block, target, number);
            }
        }
    }

    /// Notes the value of a node, also in memory if a later segment needs it.
    fn define(&mut self, block: BlockId, expr: ExprId, value: Value) {
        self.values[block].insert(expr, value);
        let slot = match &self.wide {
            Some(wide) if block == wide.block => wide.slot(expr),
            _ if block == 0 => self.input.segments.slot(expr),
            _ => None,
        };
        if let Some(slot) = slot {
            memory::write_slot(self, slot, value);
        }
    }

    /// The value of a node in its block: known, or loaded again in this segment.
    fn value(&mut self, home: BlockId, expr: ExprId) -> Option<Value> {
        if let Some(&value) = self.values[home].get(&expr) {
            return Some(value);
        }
        if home != 0 || !self.input.segments.is_active() {
            return None;
        }
        let value = if is_load(self.input.exprs.node(expr)) {
            self.node(0, expr)
        } else {
            let slot = self.input.segments.slot(expr)?;
            memory::read_slot(self, 0, slot, expr)
        };
        self.values[home].insert(expr, value);
        Some(value)
    }

    fn reduce(&mut self, op: ReduceFn, body: ExprId, inner: BlockId) -> Value {
        let here = &self.input.schedule.blocks[inner];
        let start = self.number(inner, op.identity());
        if here.extent == 0 {
            return start;
        }
        let extent = i64::from(here.extent);
        let (pass, exit) = (self.b.create_block(), self.b.create_block());
        let counter = self.b.append_block_param(pass, types::I64);
        let number = self.number_type(inner);
        let sum = self.b.append_block_param(pass, number);
        let result = self.b.append_block_param(exit, number);
        let zero = self.b.ins().iconst(types::I64, 0);
        self.b.ins().jump(pass, &[zero.into(), start.into()]);
        self.b.switch_to_block(pass);
        self.counters[inner] = Some(counter);
        for item in &self.input.schedule.blocks[inner].items {
            self.item(inner, *item);
        }
        let value = self.operand(inner, body);
        let sum = match op {
            ReduceFn::Sum => self.b.ins().fadd(sum, value),
            ReduceFn::Product => self.b.ins().fmul(sum, value),
            ReduceFn::Min => self.least(sum, value),
            ReduceFn::Max => self.most(sum, value),
        };
        self.forget(inner);
        let next = self.b.ins().iadd_imm_s(counter, 1);
        let more = self.b.ins().icmp_imm_s(IntCC::SignedLessThan, next, extent);
        self.b.ins().brif(more, pass, &[next.into(), sum.into()], exit, &[sum.into()]);
        self.b.switch_to_block(exit);
        result
    }

    /// The second operand of an arithmetic operation: a constant is read from memory by the
    /// instruction itself.
    fn second_operand(&mut self, block: BlockId, expr: ExprId) -> Value {
        match self.input.exprs.node(expr) {
            Expr::Const(bits) => self.number(block, f64::from_bits(bits)),
            _ => self.operand(block, expr),
        }
    }

    /// The value of an operand in the lanes of a block.
    pub(super) fn operand(&mut self, block: BlockId, expr: ExprId) -> Value {
        match self.input.exprs.node(expr) {
            Expr::Const(bits) => return self.held_number(block, f64::from_bits(bits)),
            Expr::Truth(truth) => return self.truth(block, truth),
            _ => {}
        }
        let home = self.input.schedule.home(self.input.exprs, block, expr);
        if self.is_two(block) && !self.is_two(home) {
            return self.splat(home, expr);
        }
        match self.value(home, expr) {
            Some(value) => value,
            // The schedule places operands before users.
            None => self.number(block, f64::NAN),
        }
    }

    fn truth(&mut self, block: BlockId, truth: bool) -> Value {
        if self.is_two(block) {
            let mask = self.b.ins().iconst(types::I64, -i64::from(truth));
            return self.b.ins().splat(types::I64X2, mask);
        }
        self.b.ins().iconst(types::I8, i64::from(truth))
    }

    /// A value from outside of the loop of lanes, in both lanes.
    pub(super) fn splat(&mut self, home: BlockId, expr: ExprId) -> Value {
        if let Some(&value) = self.splats.get(&(home, expr)) {
            return value;
        }
        if let Some(place) = self.wide.as_ref().and_then(|wide| wide.splat(home, expr)) {
            let value = memory::read_slot(self, self.wide_block(), place, expr);
            self.splats.insert((home, expr), value);
            return value;
        }
        let Some(one) = self.value(home, expr) else {
            let nan = self.b.ins().f64const(f64::NAN);
            return self.b.ins().splat(types::F64X2, nan);
        };
        let value = if self.input.exprs.is_truth(expr) {
            let (yes, no) = (self.b.ins().iconst(types::I64, -1), self.b.ins().iconst(types::I64, 0));
            let mask = self.b.ins().select(one, yes, no);
            self.b.ins().splat(types::I64X2, mask)
        } else {
            self.b.ins().splat(types::F64X2, one)
        };
        self.splats.insert((home, expr), value);
        value
    }

    /// Writes the computation of a node whose operands have values.
    pub(super) fn node(&mut self, block: BlockId, expr: ExprId) -> Value {
        let two = self.is_two(block);
        match self.input.exprs.node(expr) {
            Expr::Const(bits) => self.number(block, f64::from_bits(bits)),
            Expr::Truth(truth) => self.truth(block, truth),
            Expr::Time => self.input.arguments.time,
            Expr::Counter(v) => self.counter_number(block, v.0),
            Expr::Load { var, flavour, at } => self.element(block, var, flavour, at),
            Expr::Unary(f, a) => {
                let a = self.operand(block, a);
                arithmetic::unary(self, block, f, a)
            }
            Expr::PowInt(a, n) => {
                let a = self.operand(block, a);
                arithmetic::whole_power(self, block, a, n)
            }
            Expr::Binary(f, a, b) => self.binary_of(block, f, a, b),
            Expr::Compare(op, a, b) => {
                let (a, b) = (self.operand(block, a), self.operand(block, b));
                self.b.ins().fcmp(condition_code(op), a, b)
            }
            Expr::And(a, b) => {
                let (a, b) = (self.operand(block, a), self.operand(block, b));
                self.b.ins().band(a, b)
            }
            Expr::Or(a, b) => {
                let (a, b) = (self.operand(block, a), self.operand(block, b));
                self.b.ins().bor(a, b)
            }
            Expr::Not(a) => {
                let a = self.operand(block, a);
                if two { self.b.ins().bnot(a) } else { self.b.ins().bxor_imm_u(a, 1) }
            }
            Expr::Select(c, a, b) => {
                let c = self.operand(block, c);
                let (a, b) = (self.operand(block, a), self.operand(block, b));
                self.select(two, c, a, b)
            }
            Expr::Passed(limits, side, a) => {
                let a = self.operand(block, a);
                arithmetic::look_up(self, block, passed_entry(side == Side::UpTo), a, limits)
            }
            Expr::Entry(list, a) => {
                let a = self.operand(block, a);
                arithmetic::look_up(self, block, list_entry(), a, list)
            }
            // Reductions are separate items.
            Expr::Reduce { .. } => self.number(block, f64::NAN),
        }
    }

    /// An element of a variable.
    fn element(&mut self, block: BlockId, var: VarId, flavour: Flavour, at: Affine) -> Value {
        if self.input.layout.is_factor(var, at.offset) {
            return self.input.arguments.factor;
        }
        match self.input.layout.address(var, flavour) {
            Some(a) => memory::load(self, block, a.base, at.plus(Affine::constant(i64::from(a.offset)))),
            // The schedule has refused variables without memory.
            None => self.number(block, f64::NAN),
        }
    }

    /// A function of two operands. A constant as the second operand is read from memory by the
    /// instruction itself.
    fn binary_of(&mut self, block: BlockId, f: BinaryFn, a: ExprId, b: ExprId) -> Value {
        let swap = matches!(f, BinaryFn::Add | BinaryFn::Mul) && is_immediate(self.input.exprs.node(a));
        let (a, b) = if swap { (b, a) } else { (a, b) };
        let arithmetic = matches!(f, BinaryFn::Add | BinaryFn::Sub | BinaryFn::Mul | BinaryFn::Div);
        let a = self.operand(block, a);
        let b = if arithmetic { self.second_operand(block, b) } else { self.operand(block, b) };
        arithmetic::binary(self, block, f, a, b)
    }

    fn counter_number(&mut self, block: BlockId, counter: u8) -> Value {
        let bound = self.input.schedule.binder(block, counter);
        let counter = match bound.and_then(|b| self.counters[b]) {
            Some(counter) => counter,
            None => self.b.ins().iconst(types::I64, 0),
        };
        let first = self.b.ins().fcvt_from_sint(types::F64, counter);
        if !self.is_two(block) {
            return first;
        }
        let both = self.b.ins().splat(types::F64X2, first);
        // Only the counter of the loop of lanes differs between them.
        if bound.map(Lanes::Two) != Some(self.lanes) {
            return both;
        }
        let one = self.b.ins().f64const(1.0);
        let second = self.b.ins().fadd(first, one);
        self.b.ins().insertlane(both, second, 1u8)
    }

    /// The value of an operand, a truth value as 1 or 0.
    pub(super) fn as_number(&mut self, block: BlockId, expr: ExprId) -> Value {
        let value = self.operand(block, expr);
        if !self.input.exprs.is_truth(expr) {
            return value;
        }
        let (one, zero) = (self.number(block, 1.0), self.number(block, 0.0));
        self.select(self.is_two(block), value, one, zero)
    }
}

/// The machine's name of a comparison.
fn condition_code(op: Compare) -> FloatCC {
    match op {
        Compare::Lt => FloatCC::LessThan,
        Compare::Le => FloatCC::LessThanOrEqual,
        Compare::Eq => FloatCC::Equal,
        Compare::Ne => FloatCC::NotEqual,
    }
}
