//! Distribution of the items of a loop in lanes over phases.

use super::emitter::{Input, LINE};
use crate::ir::{BinaryFn, Expr, ExprId, FastMap, FastSet, UnaryFn};
use crate::schedule::{BlockId, Item, is_immediate};

/// Distribution of the items of a loop over phases.
#[derive(Default)]
pub(super) struct Phases {
    /// Phase in which each item is first computed (for functions: in which their argument is).
    pub(super) of: FastMap<ExprId, usize>,
    /// Results of functions.
    pub(super) functions: Vec<ExprId>,
    /// Other values that a later phase needs.
    pub(super) kept: FastSet<ExprId>,
    /// Number of phases.
    pub(super) count: usize,
    /// Column of each function's result (and its last argument) and of each kept value.
    pub(super) column: FastMap<ExprId, u32>,
    /// Column of the first of two arguments.
    pub(super) first: FastMap<ExprId, u32>,
}

impl Phases {
    /// Finds the phase of every item.
    /// Columns begin behind the `reserved` numbers.
    pub(super) fn of_loop(input: &Input<'_>, reserved: u32, block: BlockId) -> Phases {
        let mut phases = Phases { count: 1, ..Phases::default() };
        for item in &input.schedule.blocks[block].items {
            let expr = match *item {
                Item::Eval(expr) | Item::Reduce { expr, .. } => expr,
                Item::Store(..) => continue,
            };
            let phase = needs(input, block, *item).into_iter().map(|o| phases.ready(input, o)).max().unwrap_or(0);
            phases.of.insert(expr, phase);
            if is_function(input.exprs.node(expr)) {
                phases.functions.push(expr);
            }
            phases.count = phases.count.max(phases.ready(input, expr) + 1);
        }
        phases.postpone(input, block);
        phases.keep(input, block);
        let length = column_length(input.schedule.blocks[block].extent);
        let start = input.layout.columns() + reserved;
        // In an order that no hash decides.
        let mut kept: Vec<ExprId> = phases.kept.iter().copied().collect();
        kept.sort_unstable();
        let results = phases.functions.iter().copied().chain(kept);
        phases.column = results.zip(0u32..).map(|(expr, i)| (expr, start + i * length)).collect();
        let pairs = phases.functions.iter().copied().filter(|f| matches!(input.exprs.node(*f), Expr::Binary(..)));
        let next = phases.column.len() as u32;
        phases.first = pairs.zip(next..).map(|(expr, i)| (expr, start + i * length)).collect();
        phases
    }

    /// Moves what no function waits for to the phase that needs it first: it has not to be kept
    /// until then.
    fn postpone(&mut self, input: &Input<'_>, block: BlockId) {
        let mut needed: FastMap<ExprId, usize> = FastMap::default();
        for item in input.schedule.blocks[block].items.iter().rev() {
            if let Item::Eval(expr) | Item::Reduce { expr, .. } = *item
                && !is_function(input.exprs.node(expr))
                && let (Some(phase), Some(first)) = (self.of.get_mut(&expr), needed.get(&expr))
            {
                *phase = *first;
            }
            let phase = self.phase_of(input, *item);
            for value in needs(input, block, *item) {
                let first = needed.entry(value).or_insert(phase);
                *first = phase.min(*first);
            }
        }
    }

    /// First phase in which a value can be used.
    fn ready(&self, input: &Input<'_>, expr: ExprId) -> usize {
        self.of.get(&expr).map_or(0, |p| p + usize::from(is_function(input.exprs.node(expr))))
    }

    /// Marks the values that have to live from one phase to a later one.
    fn keep(&mut self, input: &Input<'_>, block: BlockId) {
        let mut kept = FastSet::default();
        for item in &input.schedule.blocks[block].items {
            let phase = self.phase_of(input, *item);
            for needed in needs(input, block, *item) {
                let node = input.exprs.node(needed);
                let elsewhere = is_repeated(node) || is_function(node);
                if !elsewhere && self.of.get(&needed).is_some_and(|&p| p < phase) {
                    kept.insert(needed);
                }
            }
        }
        self.kept = kept;
    }

    /// Phase in which an item is done.
    pub(super) fn phase_of(&self, input: &Input<'_>, item: Item) -> usize {
        match item {
            Item::Eval(expr) | Item::Reduce { expr, .. } => self.of.get(&expr).copied().unwrap_or(0),
            Item::Store(store) => self.ready(input, store.value),
        }
    }
}

/// The values of the loop that an item uses, also inside of reductions.
pub(super) fn needs(input: &Input<'_>, block: BlockId, item: Item) -> Vec<ExprId> {
    let mut needed = vec![];
    input.schedule.each_use(input.exprs, block, item, &mut |from, e| {
        if !is_immediate(input.exprs.node(e)) && input.schedule.home(input.exprs, from, e) == block {
            needed.push(e);
        }
    });
    needed
}

/// Numbers between the starts of two columns.
pub(super) fn column_length(extent: u32) -> u32 {
    extent.next_multiple_of(LINE)
}

/// Returns `true` if a node is taken out of the loop as a call of an array kernel.
pub(super) fn is_function(node: Expr) -> bool {
    match node {
        // Rounding and signs are a few instructions.
        Expr::Unary(f, _) => f.kernel().is_some() && !matches!(f, UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round | UnaryFn::Sign),
        Expr::Binary(f, ..) => matches!(f, BinaryFn::Pow | BinaryFn::Atan2),
        _ => false,
    }
}

/// Returns `true` if a node is written again in each phase.
pub(super) fn is_repeated(node: Expr) -> bool {
    matches!(node, Expr::Load { .. } | Expr::Counter(_))
}
