//! Innermost loops, two lanes at a time.
//!
//! Elementary functions are taken out of the loop, which is split into phases. A phase writes the
//! arguments of the functions to columns of working memory, array kernels are applied to whole
//! columns, and the next phase continues. What an earlier phase computed and a later one needs is
//! kept in a column too; loads are repeated.

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{InstBuilder, MemFlagsData, Value, types};

use super::arithmetic::pow_entry;
use super::emitter::{Emitter, Lanes, WORD};
use super::phases::{Phases, column_length, is_function, is_repeated, needs};
use super::plan::is_wide;
use super::residence::{Course, Residence, WideResidence};
use super::{arithmetic, memory};
use crate::ir::{Affine, BinaryFn, Expr, ExprId, FastMap, Place, Store, Target};
use crate::kernels::UNARY_COUNT;
use crate::layout::Base;
use crate::schedule::{BlockId, Item, is_immediate};

/// Returns `true` if a loop is written in lanes.
pub(super) fn is_in_lanes(emitter: &Emitter<'_>, block: BlockId) -> bool {
    !emitter.input.in_place && is_wide(emitter.input.schedule, block)
}

/// Writes an innermost loop in lanes.
pub(super) fn wide_loop(emitter: &mut Emitter<'_>, block: BlockId) {
    let extent = emitter.input.schedule.blocks[block].extent;
    let phases = Phases::of_loop(&emitter.input, emitter.reserved(), block);
    let adds = emitter.input.schedule.blocks[block]
        .items
        .iter()
        .any(|i| matches!(i, Item::Store(Store { target: Target { place: Place::Table { add: true, .. }, .. }, .. })));
    emitter.columns = emitter.columns.max(emitter.reserved() + (phases.column.len() + phases.first.len()) as u32 * column_length(extent));
    memory::prepare_pointers(emitter, block);
    if emitter.input.lean {
        spread_to_memory(emitter, block, &phases);
    }
    for phase in 0..phases.count {
        if emitter.input.lean {
            reside(emitter, block, &phases, phase);
        } else {
            spread(emitter, block, &phases, phase);
        }
        emitter.lanes = Lanes::Two(block);
        pairs(emitter, extent, adds, &mut |emitter, counter| pass(emitter, block, &phases, phase, counter));
        emitter.lanes = Lanes::One;
        if extent % 2 == 1 && adds {
            let last = emitter.b.ins().iconst(types::I64, i64::from(extent) - 1);
            pass(emitter, block, &phases, phase, last);
        }
        for &function in phases.functions.iter().filter(|f| phases.of[f] == phase) {
            apply(emitter, block, &phases, function);
        }
    }
    emitter.splats.clear();
    emitter.wide = None;
}

/// Puts all values from outside into memory, in both lanes.
fn spread_to_memory(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases) {
    for phase in 0..phases.count {
        spread(emitter, block, phases, phase);
    }
    let length = column_length(emitter.input.schedule.blocks[block].extent);
    let start = emitter.reserved() + (phases.column.len() + phases.first.len()) as u32 * length;
    let mut wide = WideResidence { block, residence: Residence::default(), splats: FastMap::default(), start };
    let mut outside: Vec<_> = emitter.splats.drain().collect();
    outside.sort_unstable_by_key(|&(from, _)| from);
    for (from, value) in outside {
        memory::write_slot(emitter, wide.start, value);
        wide.splats.insert(from, wide.start);
        wide.start += 2;
    }
    emitter.columns = emitter.columns.max(wide.start);
    emitter.wide = Some(wide);
    if emitter.input.segments.is_active() {
        emitter.values[0].clear();
    }
}

/// Decides what stays in the registers in a phase.
fn reside(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, phase: usize) {
    let (schedule, exprs) = (emitter.input.schedule, emitter.input.exprs);
    let mut course = Course::default();
    for (i, item) in schedule.blocks[block].items.iter().enumerate() {
        let result = match *item {
            _ if phases.phase_of(&emitter.input, *item) != phase => continue,
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
    if let Some(wide) = &mut emitter.wide {
        emitter.columns = emitter.columns.max(wide.start + 2 * residence.len());
        wide.residence = residence;
    }
}

/// Forgets what leaves the registers after an item of a loop of lanes.
fn leave(emitter: &mut Emitter<'_>, block: BlockId, item: usize) {
    let Some(wide) = &emitter.wide else { return };
    for expr in wide.residence.leaving(item) {
        emitter.values[block].remove(&expr);
        emitter.splats.remove(&(emitter.input.schedule.home(emitter.input.exprs, block, expr), expr));
    }
}

/// A loop over pairs of neighbours. The last pair of an odd number overlaps the one before it and
/// computes the same again, unless something is `added`: then the last element is left to the
/// caller.
fn pairs(emitter: &mut Emitter<'_>, extent: u32, added: bool, pass: &mut dyn FnMut(&mut Emitter<'_>, Value)) {
    let odd = extent % 2 == 1;
    let last = i64::from(if odd && added { extent - 3 } else { extent - 2 });
    let (body, exit) = (emitter.b.create_block(), emitter.b.create_block());
    let counter = emitter.b.append_block_param(body, types::I64);
    let start = emitter.b.ins().iconst(types::I64, 0);
    emitter.b.ins().jump(body, &[start.into()]);
    emitter.b.switch_to_block(body);
    pass(emitter, counter);
    let mut next = emitter.b.ins().iadd_imm_s(counter, 2);
    if odd && !added {
        let end = emitter.b.ins().iconst(types::I64, last);
        next = emitter.b.ins().smin(next, end);
    }
    let more = emitter.b.ins().icmp_imm_s(IntCC::SignedLessThan, counter, last);
    emitter.b.ins().brif(more, body, &[next.into()], exit, &[]);
    emitter.b.switch_to_block(exit);
}

/// Puts values from outside into both lanes ahead of the loop.
fn spread(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, phase: usize) {
    let mut outside = vec![];
    for item in &emitter.input.schedule.blocks[block].items {
        if phases.phase_of(&emitter.input, *item) != phase {
            continue;
        }
        emitter.input.schedule.each_use(emitter.input.exprs, block, *item, &mut |from, operand| {
            let home = emitter.input.schedule.home(emitter.input.exprs, from, operand);
            if !emitter.input.schedule.is_inside(home, block) && !is_immediate(emitter.input.exprs.node(operand)) {
                outside.push((home, operand));
            }
        });
    }
    for (home, operand) in outside {
        emitter.splat(home, operand);
    }
}

/// One pass of one phase.
fn pass(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, phase: usize, counter: Value) {
    emitter.counters[block] = Some(counter);
    let schedule = emitter.input.schedule;
    for (i, item) in schedule.blocks[block].items.iter().enumerate() {
        if phases.phase_of(&emitter.input, *item) != phase {
            continue;
        }
        for needed in needs(&emitter.input, block, *item) {
            fetch(emitter, block, phases, phase, needed);
        }
        match *item {
            Item::Eval(expr) if is_function(emitter.input.exprs.node(expr)) => write_arguments(emitter, block, phases, expr),
            // Loads are written when they are needed, in each phase.
            Item::Eval(expr) if is_repeated(emitter.input.exprs.node(expr)) => {}
            Item::Eval(expr) | Item::Reduce { expr, .. } => {
                emitter.item(block, *item);
                let kept = phases.kept.contains(&expr).then(|| phases.column.get(&expr)).flatten();
                if let Some(&column) = kept {
                    let number = emitter.as_number(block, expr);
                    write_column(emitter, block, column, number);
                }
            }
            Item::Store(..) => emitter.item(block, *item),
        }
        leave(emitter, block, i);
    }
    if emitter.wide.is_some() {
        emitter.splats.clear();
    }
    emitter.forget(block);
}

/// Makes a value of the loop available in this phase.
fn fetch(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, phase: usize, expr: ExprId) {
    if emitter.values[block].contains_key(&expr) {
        return;
    }
    let node = emitter.input.exprs.node(expr);
    let earlier = phases.of.get(&expr).is_some_and(|&p| p < phase);
    let value = if is_repeated(node) {
        emitter.node(block, expr)
    } else if let Some(slot) = emitter.wide.as_ref().and_then(|wide| wide.slot(expr)) {
        memory::read_slot(emitter, block, slot, expr)
    } else if earlier || emitter.wide.is_some() && phases.kept.contains(&expr) {
        match phases.column.get(&expr) {
            Some(&column) => read_column(emitter, block, column, expr),
            None => return,
        }
    } else {
        return;
    };
    emitter.values[block].insert(expr, value);
}

fn column_at(emitter: &Emitter<'_>, block: BlockId, column: u32) -> Affine {
    let mut at = Affine::constant(i64::from(column));
    if let Some(counter) = emitter.input.schedule.blocks[block].counter {
        at.strides[counter as usize] = 1;
    }
    at
}

fn read_column(emitter: &mut Emitter<'_>, block: BlockId, column: u32, expr: ExprId) -> Value {
    let at = column_at(emitter, block, column);
    let (pointer, offset) = memory::pointer_to(emitter, block, Base::Work, at);
    let kind = if emitter.is_two(block) { types::F64X2 } else { types::F64 };
    // Columns change between phases.
    let number = emitter.b.ins().load(kind, MemFlagsData::new().with_notrap(), pointer, offset);
    if !emitter.input.exprs.is_truth(expr) {
        return number;
    }
    let zero = emitter.number(block, 0.0);
    emitter.b.ins().fcmp(FloatCC::NotEqual, number, zero)
}

fn write_column(emitter: &mut Emitter<'_>, block: BlockId, column: u32, value: Value) {
    let at = column_at(emitter, block, column);
    let (pointer, offset) = memory::pointer_to(emitter, block, Base::Work, at);
    emitter.b.ins().store(MemFlagsData::new().with_notrap(), value, pointer, offset);
}

fn write_arguments(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, expr: ExprId) {
    let columns = [phases.first.get(&expr), phases.column.get(&expr)];
    let operands: Vec<ExprId> = emitter.input.exprs.operands(expr).collect();
    // The last argument shares the column of the result.
    for (&operand, column) in operands.iter().rev().zip(columns.into_iter().rev()) {
        let value = emitter.operand(block, operand);
        if let Some(&column) = column {
            write_column(emitter, block, column, value);
        }
    }
}

fn column_pointer(emitter: &mut Emitter<'_>, column: Option<&u32>) -> Option<Value> {
    column.map(|&c| emitter.b.ins().iadd_imm_s(emitter.input.arguments.work, i64::from(c) * WORD))
}

fn apply(emitter: &mut Emitter<'_>, block: BlockId, phases: &Phases, expr: ExprId) {
    let extent = emitter.input.schedule.blocks[block].extent;
    let Some(to) = column_pointer(emitter, phases.column.get(&expr)) else {
        return;
    };
    match emitter.input.exprs.node(expr) {
        Expr::Unary(f, _) => {
            let Some(kernel) = f.kernel() else {
                return;
            };
            arithmetic::call_array(emitter, (UNARY_COUNT + kernel as usize) as i64, &[to, to], extent);
        }
        Expr::Binary(f, ..) => {
            let Some(first) = column_pointer(emitter, phases.first.get(&expr)) else {
                return;
            };
            let entry = pow_entry() + 2 + i64::from(f == BinaryFn::Atan2);
            arithmetic::call_array(emitter, entry, &[first, to, to], extent);
        }
        _ => {}
    }
}
