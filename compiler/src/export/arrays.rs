//! Functions as operations on whole arrays: a nest of loops becomes one operation on all of its
//! passes.
//!
//! A value has an axis for every loop counter that it depends on. The same node in nests of other
//! extents is another value.

use std::rc::Rc;

use super::ExportError;
use super::functions::{at_pass, extents, is_sequential};
use super::sheet::{Array, Extents, Function, Loops, Nest, Sheet, Store};
use crate::differentiate::pattern::each;
use crate::ir::{BinaryFn, Compare, Expr, ExprId, FastMap, FastSet, LoopVar, MAX_DEPTH, ReduceFn, Side, UnaryFn};

/// Position of a value in [`Arrays::values`].
pub(super) type Id = usize;

/// A value: one number for each pass of its axes.
#[derive(Clone, Debug)]
pub(super) struct Value {
    pub op: Op,
    /// Length of the axis of each counter; 0 where it has none.
    pub axes: Extents,
    /// It is true or false.
    pub truth: bool,
}

/// Computation of a value.
#[derive(Clone, Debug)]
pub(super) enum Op {
    Const(f64),
    Truth(bool),
    Time,
    Counter(u8),
    Load {
        array: Array,
        loops: Loops,
        positions: Vec<u32>,
    },
    Unary(UnaryFn, Id),
    Binary(BinaryFn, Id, Id),
    PowInt(Id, i32),
    /// Number of the limits below the value; whether equal ones count.
    Passed(Rc<[f64]>, bool, Id),
    /// The number at an index.
    Entry(Rc<[f64]>, Id),
    Compare(Compare, Id, Id),
    And(Id, Id),
    Or(Id, Id),
    Not(Id),
    Select(Id, Id, Id),
    Reduce {
        op: ReduceFn,
        depth: u8,
        extent: u32,
        body: Id,
    },
}

/// Operations of a function, in order.
#[derive(Clone, Debug)]
pub(super) enum ArrayOperation {
    Define(Id),
    /// Stores a value, spread over all loops.
    Store {
        array: Option<Array>,
        loops: Loops,
        positions: Vec<u32>,
        value: Id,
    },
}

/// A function as operations on arrays.
#[derive(Default)]
pub(super) struct Arrays {
    pub values: Vec<Value>,
    pub steps: Vec<ArrayOperation>,
    known: FastMap<(ExprId, Extents), Id>,
}

impl Arrays {
    /// The operations of a function. Nests whose passes build on each other are written pass after
    /// pass.
    pub(super) fn new(sheet: &mut Sheet, function: &Function) -> Result<Arrays, ExportError> {
        let mut arrays = Arrays::default();
        for nest in &function.nests {
            if function.update && is_sequential(sheet, nest) {
                for pass in passes(sheet, nest) {
                    arrays.nest(sheet, &pass, true)?;
                }
            } else {
                arrays.nest(sheet, nest, function.update)?;
            }
        }
        Ok(arrays)
    }

    /// Numbers that are computed in all.
    pub(super) fn size(&self) -> usize {
        self.values.iter().map(|v| v.axes.iter().map(|&n| n.max(1) as usize).product::<usize>()).sum()
    }

    fn nest(&mut self, sheet: &Sheet, nest: &Nest, in_place: bool) -> Result<(), ExportError> {
        if nest.loops.iter().any(|&(_, extent)| extent == 0) {
            return Ok(());
        }
        let around = extents(&nest.loops);
        for store in &nest.stores {
            self.place(sheet, store.value, around)?;
        }
        for Store { array, positions, value, .. } in &nest.stores {
            let value = self.of(sheet, *value, around);
            self.steps.push(ArrayOperation::Store { array: *array, loops: nest.loops.clone(), positions: positions.clone(), value });
        }
        if in_place {
            // What has been read may have changed.
            self.known.clear();
        }
        Ok(())
    }

    /// The value of a node that is there.
    fn of(&self, sheet: &Sheet, expr: ExprId, around: Extents) -> Id {
        self.known.get(&(expr, axes(sheet, expr, around))).copied().unwrap_or(0)
    }

    /// Computes a node and all it needs; only reductions recurse.
    fn place(&mut self, sheet: &Sheet, root: ExprId, around: Extents) -> Result<(), ExportError> {
        let exprs = &sheet.model.exprs;
        let mut missing = FastSet::default();
        let mut stack = vec![root];
        while let Some(expr) = stack.pop() {
            if self.known.contains_key(&(expr, axes(sheet, expr, around))) || !missing.insert(expr) {
                continue;
            }
            if !matches!(exprs.node(expr), Expr::Reduce { .. }) {
                stack.extend(exprs.operands(expr));
            }
        }
        // Operands have smaller numbers than what uses them.
        let mut missing: Vec<ExprId> = missing.into_iter().collect();
        missing.sort_unstable();
        missing.into_iter().try_for_each(|expr| self.define(sheet, expr, around))
    }

    fn define(&mut self, sheet: &Sheet, expr: ExprId, around: Extents) -> Result<(), ExportError> {
        let id = |o: ExprId| self.of(sheet, o, around);
        let op = match sheet.model.exprs.node(expr) {
            Expr::Const(bits) => Op::Const(f64::from_bits(bits)),
            Expr::Truth(t) => Op::Truth(t),
            Expr::Time => Op::Time,
            Expr::Counter(LoopVar(d)) => Op::Counter(d),
            Expr::Load { var, flavour, at } => {
                let read = sheet.read(var, flavour, at, &around)?;
                Op::Load { array: read.array, loops: read.loops, positions: read.positions }
            }
            Expr::Unary(f, a) => Op::Unary(f, id(a)),
            Expr::Binary(f, a, b) => Op::Binary(f, id(a), id(b)),
            Expr::PowInt(a, n) => Op::PowInt(id(a), n),
            Expr::Passed(limits, side, a) => Op::Passed(sheet.model.exprs.lists().of(limits).into(), side == Side::UpTo, id(a)),
            Expr::Entry(list, a) => Op::Entry(sheet.model.exprs.lists().of(list).into(), id(a)),
            Expr::Compare(f, a, b) => Op::Compare(f, id(a), id(b)),
            Expr::And(a, b) => Op::And(id(a), id(b)),
            Expr::Or(a, b) => Op::Or(id(a), id(b)),
            Expr::Not(a) => Op::Not(id(a)),
            Expr::Select(c, a, b) => Op::Select(id(c), id(a), id(b)),
            Expr::Reduce { op, extent: 0, .. } => Op::Const(op.identity()),
            Expr::Reduce { op, depth, extent, body } => {
                let mut inside = around;
                inside[depth.0 as usize] = extent;
                self.place(sheet, body, inside)?;
                Op::Reduce { op, depth: depth.0, extent, body: self.of(sheet, body, inside) }
            }
        };
        let axes = axes(sheet, expr, around);
        let truth = sheet.model.exprs.is_truth(expr);
        self.known.insert((expr, axes), self.values.len());
        self.steps.push(ArrayOperation::Define(self.values.len()));
        self.values.push(Value { op, axes, truth });
        Ok(())
    }
}

/// The passes of the loops that move a node.
fn axes(sheet: &Sheet, expr: ExprId, around: Extents) -> Extents {
    let free = sheet.model.exprs.free(expr);
    std::array::from_fn(|d| if free & (1 << d) == 0 { 0 } else { around[d] })
}

/// The loops of axes, outermost first.
pub(super) fn loops(axes: &Extents) -> Loops {
    (0..MAX_DEPTH).filter(|&d| axes[d] > 0).map(|d| (d as u8, axes[d])).collect()
}

/// A nest pass after pass.
fn passes(sheet: &mut Sheet, nest: &Nest) -> Vec<Nest> {
    let mut counters = vec![];
    each(&nest.loops, |c| counters.push(*c));
    let exprs = &mut sheet.model.exprs;
    let mut out = Vec::with_capacity(counters.len());
    for (pass, counters) in counters.iter().enumerate() {
        let mut single = nest.stores.clone();
        for store in &mut single {
            store.value = at_pass(exprs, store.value, &nest.loops, counters);
            store.positions = vec![store.positions[pass]];
        }
        out.push(Nest { loops: vec![], stores: single });
    }
    out
}
