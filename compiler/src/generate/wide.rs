//! Innermost loops, two lanes at a time.
//!
//! Elementary functions are taken out of the loop: the loop is split into phases, a phase writes the arguments of the functions to
//! columns of working memory, array kernels are applied to whole columns, the next phase goes on. What an earlier phase
//! computed and a later one needs is kept in a column too; loads are repeated.

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{InstBuilder, MemFlagsData, Value, types};

use super::arithmetic::pow_entry;
use super::emitter::{Emitter, LINE, Lanes, WORD};
use super::plan::is_wide;
use super::residence::{Course, Residence, WideResidence};
use crate::ir::{Affine, BinaryFn, Expr, ExprId, FastMap, FastSet, UnaryFn};
use crate::kernels::UNARY_COUNT;
use crate::layout::Base;
use crate::schedule::{BlockId, Item, Sink, is_immediate};

/// How the items of a loop are spread over phases.
#[derive(Default)]
struct Phases {
    /// Phase in which each item is first computed (for functions: in which their argument is).
    of: FastMap<ExprId, usize>,
    /// Results of functions.
    functions: Vec<ExprId>,
    /// Other values that a later phase needs.
    kept: FastSet<ExprId>,
    /// Number of phases.
    count: usize,
    /// Column of each function's result (and its last argument) and of each kept value.
    column: FastMap<ExprId, u32>,
    /// Column of the first of two arguments.
    first: FastMap<ExprId, u32>,
}

impl Emitter<'_> {
    /// Whether a loop is written in lanes.
    pub(super) fn is_wide(&self, block: BlockId) -> bool {
        !self.input.in_place && is_wide(self.input.schedule, block)
    }

    /// The loop of lanes that is being written.
    pub(super) fn wide_block(&self) -> BlockId {
        self.wide.as_ref().map_or(0, |wide| wide.block)
    }

    /// Writes an innermost loop in lanes.
    pub(super) fn wide_loop(&mut self, block: BlockId) {
        let extent = self.input.schedule.blocks[block].extent;
        let phases = self.phases(block);
        let adds = self.input.schedule.blocks[block].items.iter().any(|i| matches!(i, Item::Store(Sink::Table { add: true, .. }, _)));
        self.columns = self.columns.max(self.reserved() + (phases.column.len() + phases.first.len()) as u32 * column_length(extent));
        self.prepare_pointers(block);
        if self.input.lean {
            self.spread_to_memory(block, &phases);
        }
        for phase in 0..phases.count {
            if self.input.lean {
                self.reside(block, &phases, phase);
            } else {
                self.spread(block, &phases, phase);
            }
            self.lanes = Lanes::Two(block);
            self.pairs(extent, adds, &mut |emitter, counter| emitter.pass(block, &phases, phase, counter));
            self.lanes = Lanes::One;
            if extent % 2 == 1 && adds {
                let last = self.b.ins().iconst(types::I64, i64::from(extent) - 1);
                self.pass(block, &phases, phase, last);
            }
            for &function in phases.functions.iter().filter(|f| phases.of[f] == phase) {
                self.apply(block, &phases, function);
            }
        }
        self.splats.clear();
        self.wide = None;
    }

    /// Puts all values from outside into memory, in both lanes.
    fn spread_to_memory(&mut self, block: BlockId, phases: &Phases) {
        for phase in 0..phases.count {
            self.spread(block, phases, phase);
        }
        let length = column_length(self.input.schedule.blocks[block].extent);
        let start = self.reserved() + (phases.column.len() + phases.first.len()) as u32 * length;
        let mut wide = WideResidence { block, residence: Residence::default(), splats: FastMap::default(), start };
        let mut outside: Vec<_> = self.splats.drain().collect();
        outside.sort_unstable_by_key(|&(from, _)| from);
        for (from, value) in outside {
            self.write_slot(wide.start, value);
            wide.splats.insert(from, wide.start);
            wide.start += 2;
        }
        self.columns = self.columns.max(wide.start);
        self.wide = Some(wide);
        if self.input.segments.is_active() {
            self.values[0].clear();
        }
    }

    /// Decides what stays in the registers in a phase.
    fn reside(&mut self, block: BlockId, phases: &Phases, phase: usize) {
        let (schedule, exprs) = (self.input.schedule, self.input.exprs);
        let mut course = Course::default();
        for (i, item) in schedule.blocks[block].items.iter().enumerate() {
            let result = match *item {
                _ if self.phase_of(phases, *item) != phase => continue,
                Item::Eval(expr) if is_repeated(exprs.node(expr)) => continue,
                Item::Eval(expr) if is_function(exprs.node(expr)) => None,
                Item::Eval(expr) | Item::Reduce { expr, .. } => Some(expr),
                Item::Store(..) => None,
            };
            schedule.each_use(exprs, block, *item, &mut |_, e| {
                if !is_immediate(exprs.node(e)) {
                    course.uses(e);
                }
            });
            course.step(i, result);
        }
        let outside = |e: ExprId| !schedule.is_inside(schedule.home(exprs, block, e), block);
        let residence = Residence::of(&course, |e| {
            let earlier = phases.of.get(&e).is_some_and(|&p| p < phase);
            is_repeated(exprs.node(e)) || earlier || phases.kept.contains(&e) || outside(e)
        });
        if let Some(wide) = &mut self.wide {
            self.columns = self.columns.max(wide.start + 2 * residence.len());
            wide.residence = residence;
        }
    }

    /// Forgets what leaves the registers after an item of a loop of lanes.
    fn leave(&mut self, block: BlockId, item: usize) {
        let Some(wide) = &self.wide else { return };
        for expr in wide.residence.leaving(item) {
            self.values[block].remove(&expr);
            self.splats.remove(&(self.input.schedule.home(self.input.exprs, block, expr), expr));
        }
    }

    /// A loop over pairs of neighbours. The last pair of an odd number overlaps the one before it and computes the same again, unless
    /// something is `added`: then the last element is left to the caller.
    fn pairs(&mut self, extent: u32, added: bool, pass: &mut dyn FnMut(&mut Self, Value)) {
        let odd = extent % 2 == 1;
        let last = i64::from(if odd && added { extent - 3 } else { extent - 2 });
        let (body, exit) = (self.b.create_block(), self.b.create_block());
        let counter = self.b.append_block_param(body, types::I64);
        let start = self.b.ins().iconst(types::I64, 0);
        self.b.ins().jump(body, &[start.into()]);
        self.b.switch_to_block(body);
        pass(self, counter);
        let mut next = self.b.ins().iadd_imm_s(counter, 2);
        if odd && !added {
            let end = self.b.ins().iconst(types::I64, last);
            next = self.b.ins().smin(next, end);
        }
        let more = self.b.ins().icmp_imm_s(IntCC::SignedLessThan, counter, last);
        self.b.ins().brif(more, body, &[next.into()], exit, &[]);
        self.b.switch_to_block(exit);
    }

    /// Finds the phase of every item.
    fn phases(&self, block: BlockId) -> Phases {
        let mut phases = Phases { count: 1, ..Phases::default() };
        for item in &self.input.schedule.blocks[block].items {
            let expr = match *item {
                Item::Eval(expr) | Item::Reduce { expr, .. } => expr,
                Item::Store(..) => continue,
            };
            let phase = self.needs(block, *item).into_iter().map(|o| self.ready(&phases, o)).max().unwrap_or(0);
            phases.of.insert(expr, phase);
            if is_function(self.input.exprs.node(expr)) {
                phases.functions.push(expr);
            }
            phases.count = phases.count.max(self.ready(&phases, expr) + 1);
        }
        self.postpone(block, &mut phases);
        self.keep(block, &mut phases);
        let length = column_length(self.input.schedule.blocks[block].extent);
        let start = self.input.layout.columns() + self.reserved();
        // In an order that no hash decides.
        let mut kept: Vec<ExprId> = phases.kept.iter().copied().collect();
        kept.sort_unstable();
        let results = phases.functions.iter().copied().chain(kept);
        phases.column = results.zip(0u32..).map(|(expr, i)| (expr, start + i * length)).collect();
        let pairs = phases.functions.iter().copied().filter(|f| matches!(self.input.exprs.node(*f), Expr::Binary(..)));
        let next = phases.column.len() as u32;
        phases.first = pairs.zip(next..).map(|(expr, i)| (expr, start + i * length)).collect();
        phases
    }

    /// Moves what no function waits for to the phase that needs it first: it has not to be kept until then.
    fn postpone(&self, block: BlockId, phases: &mut Phases) {
        let mut needed: FastMap<ExprId, usize> = FastMap::default();
        for item in self.input.schedule.blocks[block].items.iter().rev() {
            if let Item::Eval(expr) | Item::Reduce { expr, .. } = *item
                && !is_function(self.input.exprs.node(expr))
                && let (Some(phase), Some(first)) = (phases.of.get_mut(&expr), needed.get(&expr))
            {
                *phase = *first;
            }
            let phase = self.phase_of(phases, *item);
            for value in self.needs(block, *item) {
                let first = needed.entry(value).or_insert(phase);
                *first = phase.min(*first);
            }
        }
    }

    /// First phase in which a value can be used.
    fn ready(&self, phases: &Phases, expr: ExprId) -> usize {
        phases.of.get(&expr).map_or(0, |p| p + usize::from(is_function(self.input.exprs.node(expr))))
    }

    /// Marks the values that have to live from one phase to a later one.
    fn keep(&self, block: BlockId, phases: &mut Phases) {
        let mut kept = FastSet::default();
        for item in &self.input.schedule.blocks[block].items {
            let phase = self.phase_of(phases, *item);
            for needed in self.needs(block, *item) {
                let node = self.input.exprs.node(needed);
                let elsewhere = is_repeated(node) || is_function(node);
                if !elsewhere && phases.of.get(&needed).is_some_and(|&p| p < phase) {
                    kept.insert(needed);
                }
            }
        }
        phases.kept = kept;
    }

    /// Phase in which an item is done.
    fn phase_of(&self, phases: &Phases, item: Item) -> usize {
        match item {
            Item::Eval(expr) | Item::Reduce { expr, .. } => phases.of.get(&expr).copied().unwrap_or(0),
            Item::Store(_, value) => self.ready(phases, value),
        }
    }

    /// The values of the loop that an item uses, also inside of reductions.
    fn needs(&self, block: BlockId, item: Item) -> Vec<ExprId> {
        let mut needed = vec![];
        self.input.schedule.each_use(self.input.exprs, block, item, &mut |from, e| {
            if !is_immediate(self.input.exprs.node(e)) && self.input.schedule.home(self.input.exprs, from, e) == block {
                needed.push(e);
            }
        });
        needed
    }

    /// Puts values from outside into both lanes ahead of the loop.
    fn spread(&mut self, block: BlockId, phases: &Phases, phase: usize) {
        let mut outside = vec![];
        for item in &self.input.schedule.blocks[block].items {
            if self.phase_of(phases, *item) != phase {
                continue;
            }
            self.input.schedule.each_use(self.input.exprs, block, *item, &mut |from, operand| {
                let home = self.input.schedule.home(self.input.exprs, from, operand);
                if !self.input.schedule.is_inside(home, block) && !is_immediate(self.input.exprs.node(operand)) {
                    outside.push((home, operand));
                }
            });
        }
        for (home, operand) in outside {
            self.splat(home, operand);
        }
    }

    /// One pass of one phase.
    fn pass(&mut self, block: BlockId, phases: &Phases, phase: usize, counter: Value) {
        self.counters[block] = Some(counter);
        let schedule = self.input.schedule;
        for (i, item) in schedule.blocks[block].items.iter().enumerate() {
            if self.phase_of(phases, *item) != phase {
                continue;
            }
            for needed in self.needs(block, *item) {
                self.fetch(block, phases, phase, needed);
            }
            match *item {
                Item::Eval(expr) if is_function(self.input.exprs.node(expr)) => self.write_arguments(block, phases, expr),
                // Loads are written when they are needed, in each phase.
                Item::Eval(expr) if is_repeated(self.input.exprs.node(expr)) => {}
                Item::Eval(expr) | Item::Reduce { expr, .. } => {
                    self.item(block, *item);
                    let kept = phases.kept.contains(&expr).then(|| phases.column.get(&expr)).flatten();
                    if let Some(&column) = kept {
                        let number = self.as_number(block, expr);
                        self.write_column(block, column, number);
                    }
                }
                Item::Store(..) => self.item(block, *item),
            }
            self.leave(block, i);
        }
        if self.wide.is_some() {
            self.splats.clear();
        }
        self.forget(block);
    }

    /// Makes a value of the loop available in this phase.
    fn fetch(&mut self, block: BlockId, phases: &Phases, phase: usize, expr: ExprId) {
        if self.values[block].contains_key(&expr) {
            return;
        }
        let node = self.input.exprs.node(expr);
        let earlier = phases.of.get(&expr).is_some_and(|&p| p < phase);
        let value = if is_repeated(node) {
            self.node(block, expr)
        } else if let Some(slot) = self.wide.as_ref().and_then(|wide| wide.slot(expr)) {
            self.read_slot(block, slot, expr)
        } else if earlier || self.wide.is_some() && phases.kept.contains(&expr) {
            match phases.column.get(&expr) {
                Some(&column) => self.read_column(block, column, expr),
                None => return,
            }
        } else {
            return;
        };
        self.values[block].insert(expr, value);
    }

    fn column_at(&self, block: BlockId, column: u32) -> Affine {
        let mut at = Affine::constant(i64::from(column));
        if let Some(counter) = self.input.schedule.blocks[block].counter {
            at.strides[counter as usize] = 1;
        }
        at
    }

    fn read_column(&mut self, block: BlockId, column: u32, expr: ExprId) -> Value {
        let at = self.column_at(block, column);
        let (pointer, offset) = self.pointer(block, Base::Work, at);
        let kind = if self.is_two(block) { types::F64X2 } else { types::F64 };
        // Columns change between phases.
        let number = self.b.ins().load(kind, MemFlagsData::new().with_notrap(), pointer, offset);
        if !self.input.exprs.is_truth(expr) {
            return number;
        }
        let zero = self.number(block, 0.0);
        self.b.ins().fcmp(FloatCC::NotEqual, number, zero)
    }

    fn write_column(&mut self, block: BlockId, column: u32, value: Value) {
        let at = self.column_at(block, column);
        let (pointer, offset) = self.pointer(block, Base::Work, at);
        self.b.ins().store(MemFlagsData::new().with_notrap(), value, pointer, offset);
    }

    fn write_arguments(&mut self, block: BlockId, phases: &Phases, expr: ExprId) {
        let columns = [phases.first.get(&expr), phases.column.get(&expr)];
        let operands: Vec<ExprId> = self.input.exprs.operands(expr).collect();
        // The last argument shares the column of the result.
        for (&operand, column) in operands.iter().rev().zip(columns.into_iter().rev()) {
            let value = self.operand(block, operand);
            if let Some(&column) = column {
                self.write_column(block, column, value);
            }
        }
    }

    fn column_pointer(&mut self, column: Option<&u32>) -> Option<Value> {
        column.map(|&c| self.b.ins().iadd_imm_s(self.input.arguments.work, i64::from(c) * WORD))
    }

    fn apply(&mut self, block: BlockId, phases: &Phases, expr: ExprId) {
        let extent = self.input.schedule.blocks[block].extent;
        let Some(to) = self.column_pointer(phases.column.get(&expr)) else {
            return;
        };
        match self.input.exprs.node(expr) {
            Expr::Unary(f, _) => {
                let Some(kernel) = f.kernel() else {
                    return;
                };
                self.call_array((UNARY_COUNT + kernel as usize) as i64, &[to, to], extent);
            }
            Expr::Binary(f, ..) => {
                let Some(first) = self.column_pointer(phases.first.get(&expr)) else {
                    return;
                };
                let entry = pow_entry() + 2 + i64::from(f == BinaryFn::Atan2);
                self.call_array(entry, &[first, to, to], extent);
            }
            _ => {}
        }
    }
}

/// Numbers between the starts of two columns.
fn column_length(extent: u32) -> u32 {
    extent.next_multiple_of(LINE)
}

/// Whether a node is taken out of the loop as a call of an array kernel.
fn is_function(node: Expr) -> bool {
    match node {
        // Rounding and signs are a few instructions.
        Expr::Unary(f, _) => f.kernel().is_some() && !matches!(f, UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round | UnaryFn::Sign),
        Expr::Binary(f, ..) => matches!(f, BinaryFn::Pow | BinaryFn::Atan2),
        _ => false,
    }
}

/// Whether a node is written again in each phase.
fn is_repeated(node: Expr) -> bool {
    matches!(node, Expr::Load { .. } | Expr::Counter(_))
}
