//! Scalar code and loops.

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{AbiParam, Constant, ConstantData, InstBuilder, MemFlagsData, SigRef, Signature, Type, Value, types};
use cranelift_codegen::isa::TargetIsa;
use cranelift_frontend::FunctionBuilder;

use super::memory::{Start, constant_memory};
use super::plan::{Part, Piece, Plan};
use super::schedule::{BlockId, Item, Schedule, is_immediate};
use super::segments::{Segments, is_load};
use super::wide::{LINE, WideResidence};
use crate::interpret::identity;
use crate::ir::hash::FastMap;
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, Exprs, MAX_DEPTH, ReduceFn, UnaryFn};
use crate::kernels::{self, UNARY_COUNT};
use crate::layout::{Base, Layout};

/// Bytes of a number, a pointer.
pub(super) const WORD: i64 = 8;

/// Arguments of the function.
#[derive(Clone, Copy)]
pub(super) struct Arguments {
    time: Value,
    factor: Value,
    pub(super) y: Value,
    pub(super) yp: Value,
    pub(super) work: Value,
    pub(super) out: Value,
    pub(super) surroundings: Value,
}

/// Lanes of the code that is being written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Lanes {
    /// One number.
    One,
    /// Two neighbours along the counter of the block.
    Two(BlockId),
}

/// Writes one function.
pub(super) struct Emitter<'a> {
    pub(super) b: FunctionBuilder<'a>,
    pub(super) exprs: &'a Exprs,
    pub(super) layout: &'a Layout,
    pub(super) schedule: &'a Schedule,
    pub(super) arguments: Arguments,
    pub(super) lanes: Lanes,
    /// Values by block; those of a block are forgotten when its code ends.
    pub(super) values: Vec<FastMap<ExprId, Value>>,
    /// Two equal lanes of values from outside of the loop of lanes.
    pub(super) splats: FastMap<(BlockId, ExprId), Value>,
    /// Loop counters by block.
    pub(super) counters: Vec<Option<Value>>,
    /// Pointers by block: memory and strides that they already contain.
    pub(super) pointers: Vec<FastMap<(Start, [i64; MAX_DEPTH]), Value>>,
    signatures: FastMap<(usize, bool), SigRef>,
    /// Numbers in both lanes, by their bits.
    constants: FastMap<u64, Constant>,
    /// How the code outside of loops is cut.
    pub(super) segments: &'a Segments,
    /// Where the values of the loop of lanes stay, if it is long.
    pub(super) wide: Option<WideResidence>,
    /// The code is long.
    pub(super) lean: bool,
    pub(super) in_place: bool,
    rounding: bool,
    /// Numbers of working memory used.
    pub(super) columns: u32,
}

/// Writes the code of the parts of a function; returns the numbers of working memory it uses.
pub(super) fn emit(
    mut builder: FunctionBuilder<'_>,
    plan: &Plan,
    piece: &Piece,
    exprs: &Exprs,
    layout: &Layout,
    isa: &dyn TargetIsa,
) -> u32 {
    let entry = builder.create_block();
    builder.append_block_params_for_function_params(entry);
    builder.switch_to_block(entry);
    let p = builder.block_params(entry);
    let arguments = Arguments { time: p[0], factor: p[1], y: p[2], yp: p[3], work: p[4], out: p[5], surroundings: p[6] };
    let rounding = has_rounding(isa);
    let mut columns = 0;
    let mut rest = Some(builder);
    for part in &piece.parts {
        let Some(b) = rest.take() else { break };
        let (schedule, segments) = &plan.schedules[part.schedule];
        let blocks = schedule.blocks.len();
        let mut emitter = Emitter {
            b,
            exprs,
            layout,
            schedule,
            arguments,
            lanes: Lanes::One,
            values: vec![FastMap::default(); blocks],
            splats: FastMap::default(),
            counters: vec![None; blocks],
            pointers: vec![FastMap::default(); blocks],
            signatures: FastMap::default(),
            constants: FastMap::default(),
            segments,
            wide: None,
            lean: piece.lean,
            in_place: plan.in_place,
            rounding,
            columns: 0,
        };
        emitter.columns = emitter.reserved();
        emitter.outside(part);
        columns = columns.max(emitter.columns);
        rest = Some(emitter.b);
    }
    if let Some(mut b) = rest {
        b.ins().return_(&[]);
        b.seal_all_blocks();
        b.finalize(isa.frontend_config());
    }
    columns
}

/// Whether rounding is an instruction; elsewhere Cranelift would call a library.
fn has_rounding(isa: &dyn TargetIsa) -> bool {
    let by_flag = isa.isa_flags().iter().any(|f| f.name == "has_sse41" && f.as_bool() == Some(true));
    by_flag || !matches!(isa.triple().architecture, target_lexicon::Architecture::X86_64)
}

impl Emitter<'_> {
    /// Writes items and loops of a part of a function.
    fn outside(&mut self, part: &Part) {
        for i in part.items.clone() {
            let item = self.schedule.blocks[0].items[i];
            self.item(0, item);
            if self.segments.ends_at(i) {
                let result = match item {
                    Item::Eval(expr) | Item::Reduce { expr, .. } => self.values[0].remove_entry(&expr),
                    Item::Store(..) => None,
                };
                self.values[0].clear();
                self.values[0].extend(result);
            }
        }
        for &child in &part.loops {
            if self.segments.is_active() {
                self.values[0].clear();
                if !self.lean {
                    self.fetch_for_loop(child);
                }
            }
            self.inner_loop(child);
        }
    }

    /// Writes the items of a loop, then the loops in it.
    fn inside(&mut self, block: BlockId) {
        let schedule = self.schedule;
        schedule.blocks[block].items.iter().for_each(|item| self.item(block, *item));
        schedule.blocks[block].children.iter().for_each(|&child| self.inner_loop(child));
    }

    fn inner_loop(&mut self, block: BlockId) {
        if self.is_wide(block) {
            self.wide_loop(block);
        } else {
            self.scalar_loop(block);
        }
    }

    /// Loads what a loop of stores needs from outside ahead of it.
    fn fetch_for_loop(&mut self, child: BlockId) {
        let mut items = vec![];
        self.schedule.each_item(child, &mut |block, item| items.push((block, item)));
        items.into_iter().for_each(|(block, item)| self.fetch_outside(block, item));
    }

    /// Loads what an item needs from outside of loops.
    fn fetch_outside(&mut self, block: BlockId, item: Item) {
        let (schedule, exprs) = (self.schedule, self.exprs);
        schedule.each_use(exprs, block, item, &mut |from, expr| {
            if !is_immediate(exprs.node(expr)) && schedule.home(exprs, from, expr) == 0 {
                self.value(0, expr);
            }
        });
    }

    /// Numbers of working memory ahead of the columns: those of [`Segments`].
    pub(super) fn reserved(&self) -> u32 {
        self.segments.len().next_multiple_of(LINE)
    }

    fn scalar_loop(&mut self, block: BlockId) {
        self.prepare_pointers(block);
        let extent = i64::from(self.schedule.blocks[block].extent);
        self.counted(extent, &mut |emitter, counter| {
            emitter.counters[block] = Some(counter);
            emitter.inside(block);
            emitter.forget(block);
        });
    }

    /// A loop of counters below `passes`; at least one pass.
    fn counted(&mut self, passes: i64, pass: &mut dyn FnMut(&mut Self, Value)) {
        let start = self.b.ins().iconst(types::I64, 0);
        if passes <= 1 {
            pass(self, start);
            return;
        }
        let (body, exit) = (self.b.create_block(), self.b.create_block());
        let counter = self.b.append_block_param(body, types::I64);
        self.b.ins().jump(body, &[start.into()]);
        self.b.switch_to_block(body);
        pass(self, counter);
        let next = self.b.ins().iadd_imm_s(counter, 1);
        let more = self.b.ins().icmp_imm_s(IntCC::SignedLessThan, next, passes);
        self.b.ins().brif(more, body, &[next.into()], exit, &[]);
        self.b.switch_to_block(exit);
    }

    /// Forgets what was computed in a block and inside of it.
    pub(super) fn forget(&mut self, block: BlockId) {
        for b in 0..self.schedule.blocks.len() {
            if self.schedule.is_inside(b, block) {
                self.values[b].clear();
                self.pointers[b].clear();
                self.counters[b] = None;
            }
        }
    }

    pub(super) fn item(&mut self, block: BlockId, item: Item) {
        match item {
            // Written where it is used.
            Item::Eval(expr) if block == 0 && self.segments.is_active() && is_load(self.exprs.node(expr)) => {}
            Item::Eval(expr) => {
                let value = self.node(block, expr);
                self.define(block, expr, value);
            }
            Item::Reduce { expr, op, body, block: inner } => {
                if block == 0 && self.segments.is_active() {
                    self.fetch_outside(block, item);
                }
                let value = self.reduce(op, body, inner);
                self.define(block, expr, value);
            }
            Item::Store(sink, value) => self.store(block, sink, value),
        }
    }

    /// Notes the value of a node, also in memory if a later segment needs it.
    fn define(&mut self, block: BlockId, expr: ExprId, value: Value) {
        self.values[block].insert(expr, value);
        let slot = match &self.wide {
            Some(wide) if block == wide.block => wide.slot(expr),
            _ if block == 0 => self.segments.slot(expr),
            _ => None,
        };
        if let Some(slot) = slot {
            self.write_slot(slot, value);
        }
    }

    /// Writes a value to its place in memory.
    pub(super) fn write_slot(&mut self, slot: u32, value: Value) {
        let (pointer, offset) = self.slot(slot);
        self.b.ins().store(MemFlagsData::new().with_notrap().with_aligned(), value, pointer, offset);
    }

    /// Reads a value of a block from its place in memory.
    pub(super) fn read_slot(&mut self, block: BlockId, slot: u32, expr: ExprId) -> Value {
        let (pointer, offset) = self.slot(slot);
        let kind = match (self.is_two(block), self.exprs.is_truth(expr)) {
            (true, false) => types::F64X2,
            (true, true) => types::I64X2,
            (false, false) => types::F64,
            (false, true) => types::I8,
        };
        self.b.ins().load(kind, MemFlagsData::new().with_notrap().with_aligned(), pointer, offset)
    }

    /// The value of a node in its block: known, or loaded again in this segment.
    fn value(&mut self, home: BlockId, expr: ExprId) -> Option<Value> {
        if let Some(&value) = self.values[home].get(&expr) {
            return Some(value);
        }
        if home != 0 || !self.segments.is_active() {
            return None;
        }
        let value = if is_load(self.exprs.node(expr)) {
            self.node(0, expr)
        } else {
            let slot = self.segments.slot(expr)?;
            self.read_slot(0, slot, expr)
        };
        self.values[home].insert(expr, value);
        Some(value)
    }

    /// Pointer and offset of a place ahead of the columns or after them.
    fn slot(&mut self, slot: u32) -> (Value, i32) {
        self.pointer(0, Base::Work, Affine::constant(i64::from(self.layout.columns() + slot)))
    }

    /// The type of numbers in a block.
    fn number_type(&self, block: BlockId) -> Type {
        if self.is_two(block) { types::F64X2 } else { types::F64 }
    }

    /// Whether values of a block have two lanes.
    pub(super) fn is_two(&self, block: BlockId) -> bool {
        match self.lanes {
            Lanes::One => false,
            Lanes::Two(outer) => self.schedule.is_inside(block, outer),
        }
    }

    fn reduce(&mut self, op: ReduceFn, body: ExprId, inner: BlockId) -> Value {
        let here = &self.schedule.blocks[inner];
        let start = self.number(inner, identity(op));
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
        for item in &self.schedule.blocks[inner].items {
            self.item(inner, *item);
        }
        let value = self.operand(inner, body);
        let sum = match op {
            ReduceFn::Sum => self.b.ins().fadd(sum, value),
            ReduceFn::Product => self.b.ins().fmul(sum, value),
            ReduceFn::Min => self.choose(FloatCC::LessThan, sum, value),
            ReduceFn::Max => self.choose(FloatCC::GreaterThan, sum, value),
        };
        self.forget(inner);
        let next = self.b.ins().iadd_imm_s(counter, 1);
        let more = self.b.ins().icmp_imm_s(IntCC::SignedLessThan, next, extent);
        self.b.ins().brif(more, pass, &[next.into(), sum.into()], exit, &[sum.into()]);
        self.b.switch_to_block(exit);
        result
    }

    /// A constant in the lanes of a block.
    pub(super) fn number(&mut self, block: BlockId, x: f64) -> Value {
        if !self.is_two(block) {
            return self.b.ins().f64const(x);
        }
        self.two_numbers(x)
    }

    /// A constant in the lanes of a block, to be held in a register: in long code read from memory, where it would else pass through a
    /// register for whole numbers (the mid-end, which long code goes without, would share it over calls).
    fn held_number(&mut self, block: BlockId, x: f64) -> Value {
        if self.is_two(block) || !self.lean || !cfg!(target_arch = "x86_64") || x.to_bits() == 0 {
            return self.number(block, x);
        }
        let both = self.two_numbers(x);
        self.b.ins().extractlane(both, 0u8)
    }

    fn two_numbers(&mut self, x: f64) -> Value {
        let func = &mut self.b.func;
        let both = *self.constants.entry(x.to_bits()).or_insert_with(|| {
            let bytes = x.to_le_bytes();
            let both: ConstantData = bytes.into_iter().chain(bytes).collect();
            func.dfg.constants.insert(both)
        });
        self.b.ins().vconst(types::F64X2, both)
    }

    /// `-a`
    fn negative(&mut self, block: BlockId, a: Value) -> Value {
        if !self.lean || !cfg!(target_arch = "x86_64") {
            return self.b.ins().fneg(a);
        }
        let sign = self.held_number(block, -0.0);
        self.b.ins().bxor(a, sign)
    }

    /// The second operand of an arithmetic operation: a constant is read from memory by the instruction itself.
    fn second_operand(&mut self, block: BlockId, expr: ExprId) -> Value {
        match self.exprs.node(expr) {
            Expr::Const(bits) => self.number(block, f64::from_bits(bits)),
            _ => self.operand(block, expr),
        }
    }

    /// The value of an operand in the lanes of a block.
    pub(super) fn operand(&mut self, block: BlockId, expr: ExprId) -> Value {
        match self.exprs.node(expr) {
            Expr::Const(bits) => return self.held_number(block, f64::from_bits(bits)),
            Expr::Truth(truth) => return self.truth(block, truth),
            _ => {}
        }
        let home = self.schedule.home(self.exprs, block, expr);
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
            let value = self.read_slot(self.wide_block(), place, expr);
            self.splats.insert((home, expr), value);
            return value;
        }
        let Some(one) = self.value(home, expr) else {
            let nan = self.b.ins().f64const(f64::NAN);
            return self.b.ins().splat(types::F64X2, nan);
        };
        let value = if self.exprs.is_truth(expr) {
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
        match self.exprs.node(expr) {
            Expr::Const(bits) => self.number(block, f64::from_bits(bits)),
            Expr::Truth(truth) => self.truth(block, truth),
            Expr::Time => self.arguments.time,
            Expr::Counter(v) => self.counter_number(block, v.0),
            Expr::Load { var, flavour, at } => {
                if self.layout.is_factor(var, at.offset) {
                    return self.arguments.factor;
                }
                match self.layout.address(var, flavour) {
                    Some(a) => self.load(block, a.base, at.plus(Affine::constant(i64::from(a.offset)))),
                    // The schedule has refused variables without memory.
                    None => self.number(block, f64::NAN),
                }
            }
            Expr::Unary(f, a) => {
                let a = self.operand(block, a);
                self.unary(block, f, a)
            }
            Expr::PowInt(a, n) => {
                let a = self.operand(block, a);
                self.whole_power(block, a, n)
            }
            Expr::Binary(f, a, b) => {
                // A constant as the second operand is read from memory by the instruction itself.
                let swap = matches!(f, BinaryFn::Add | BinaryFn::Mul) && is_immediate(self.exprs.node(a));
                let (a, b) = if swap { (b, a) } else { (a, b) };
                let arithmetic = matches!(f, BinaryFn::Add | BinaryFn::Sub | BinaryFn::Mul | BinaryFn::Div);
                let a = self.operand(block, a);
                let b = if arithmetic { self.second_operand(block, b) } else { self.operand(block, b) };
                self.binary(block, f, a, b)
            }
            Expr::Compare(op, a, b) => {
                let (a, b) = (self.operand(block, a), self.operand(block, b));
                let condition = match op {
                    Compare::Lt => FloatCC::LessThan,
                    Compare::Le => FloatCC::LessThanOrEqual,
                    Compare::Eq => FloatCC::Equal,
                    Compare::Ne => FloatCC::NotEqual,
                };
                self.b.ins().fcmp(condition, a, b)
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
            // Reductions are items of their own.
            Expr::Reduce { .. } => self.number(block, f64::NAN),
        }
    }

    fn select(&mut self, two: bool, c: Value, a: Value, b: Value) -> Value {
        if !two {
            return self.b.ins().select(c, a, b);
        }
        let mask = self.b.ins().bitcast(types::F64X2, MemFlagsData::new(), c);
        self.b.ins().bitselect(mask, a, b)
    }

    fn counter_number(&mut self, block: BlockId, counter: u8) -> Value {
        let bound = self.schedule.binder(block, counter);
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

    fn unary(&mut self, block: BlockId, f: UnaryFn, a: Value) -> Value {
        match f {
            UnaryFn::Neg => self.negative(block, a),
            UnaryFn::Abs => self.b.ins().fabs(a),
            UnaryFn::Sqrt => self.b.ins().sqrt(a),
            UnaryFn::Floor if self.rounding => self.b.ins().floor(a),
            UnaryFn::Ceil if self.rounding => self.b.ins().ceil(a),
            UnaryFn::Round if self.rounding => self.b.ins().nearest(a),
            UnaryFn::Sign => {
                let two = self.is_two(block);
                let (zero, one, minus) = (self.number(block, 0.0), self.number(block, 1.0), self.number(block, -1.0));
                let (up, down) = (self.b.ins().fcmp(FloatCC::GreaterThan, a, zero), self.b.ins().fcmp(FloatCC::LessThan, a, zero));
                let lower = self.select(two, down, minus, a);
                self.select(two, up, one, lower)
            }
            _ => match kernels::index(f) {
                Some(i) => self.call(block, i as i64, &[a]),
                None => a,
            },
        }
    }

    fn whole_power(&mut self, block: BlockId, a: Value, n: i32) -> Value {
        let power = kernels::power_chain(n.unsigned_abs(), a, |x, y| self.b.ins().fmul(x, y));
        if let Some(power) = power.filter(|_| n > 0) {
            return power;
        }
        let one = self.held_number(block, 1.0);
        power.map_or(one, |power| self.b.ins().fdiv(one, power))
    }

    fn binary(&mut self, block: BlockId, f: BinaryFn, a: Value, b: Value) -> Value {
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

    /// `a` where it is NaN or compares so with `b`, else `b`.
    fn choose(&mut self, condition: FloatCC, a: Value, b: Value) -> Value {
        let two = self.b.func.dfg.value_type(a) == types::F64X2;
        let compares = self.b.ins().fcmp(condition, a, b);
        let nan = self.b.ins().fcmp(FloatCC::Unordered, a, a);
        let first = self.b.ins().bor(compares, nan);
        self.select(two, first, a, b)
    }

    /// Calls a kernel of numbers by its place in the table, once a lane.
    fn call(&mut self, block: BlockId, entry: i64, arguments: &[Value]) -> Value {
        if !self.is_two(block) {
            return self.call_scalar(entry, arguments);
        }
        let mut both = None;
        for lane in [0u8, 1] {
            let numbers: Vec<Value> = arguments.iter().map(|a| self.b.ins().extractlane(*a, lane)).collect();
            let result = self.call_scalar(entry, &numbers);
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
        self.b.ins().load(types::I64, constant_memory(), self.arguments.surroundings, offset)
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

    /// The value of an operand, a truth value as 1 or 0.
    pub(super) fn as_number(&mut self, block: BlockId, expr: ExprId) -> Value {
        let value = self.operand(block, expr);
        if !self.exprs.is_truth(expr) {
            return value;
        }
        let (one, zero) = (self.number(block, 1.0), self.number(block, 0.0));
        self.select(self.is_two(block), value, one, zero)
    }
}

/// Place of `pow` in the table of kernels; `atan2` and the two array versions follow.
pub(super) fn pow_entry() -> i64 {
    2 * UNARY_COUNT as i64
}
