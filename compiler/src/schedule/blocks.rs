//! Order of evaluation: which node is computed in which loop.
//!
//! Each node is placed in the innermost loop whose counter it uses, once; nests over equal loops
//! share them. The interpreter and the code generator walk the same [`Schedule`], so both evaluate
//! in the same order.

use thiserror::Error;

use super::staged::Staged;
use crate::ir::{Affine, Expr, ExprId, Exprs, FastSet, Flavour, MAX_DEPTH, Nest, Place, ReduceFn, Store, Target};
use crate::layout::{Address, Base, Layout};

/// Memory that a function may access.
#[derive(Clone, Copy, Debug)]
pub struct Access {
    /// Name for messages.
    pub name: &'static str,
    /// Has the unknowns.
    pub y: bool,
    /// Has their derivatives.
    pub yp: bool,
    /// Length of the output.
    pub out: usize,
}

/// A function asks for what it cannot have: a fault of the passes before.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ScheduleError {
    /// The copy of the variable does not exist for this function.
    #[error("`{function}` uses a copy of variable {variable} that it does not have")]
    Unavailable {
        /// The function.
        function: &'static str,
        /// The variable.
        variable: String,
    },
    /// An element outside of its variable.
    #[error("`{function}` addresses elements {low}..={high} of {len} in {what}")]
    OutOfRange {
        /// The function.
        function: &'static str,
        /// The memory.
        what: String,
        /// Smallest element.
        low: i64,
        /// Largest element.
        high: i64,
        /// Number of elements.
        len: i64,
    },
    /// A loop counter is used outside of its loop.
    #[error("`{function}` uses counter {counter} outside of its loop")]
    Unbound {
        /// The function.
        function: &'static str,
        /// The counter.
        counter: u8,
    },
}

/// Number of a block.
pub type BlockId = usize;

/// A loop, or the function's body (block 0).
#[derive(Clone, Debug)]
pub struct Block {
    /// Surrounding block.
    pub parent: Option<BlockId>,
    /// The counter bound here.
    pub counter: Option<u8>,
    /// Number of passes.
    pub extent: u32,
    /// Nodes and stores in order.
    pub items: Vec<Item>,
    /// Loops inside, after all items (reductions are items).
    pub children: Vec<BlockId>,
    /// The loop of stores (no loops of other nests inside).
    pub leaf: bool,
}

/// A step of a block.
#[derive(Clone, Copy, Debug)]
pub enum Item {
    /// Evaluate a node whose operands have values.
    Eval(ExprId),
    /// Evaluate a reduction: run a block and accumulate.
    Reduce {
        /// The node.
        expr: ExprId,
        /// Operation.
        op: ReduceFn,
        /// Accumulated value.
        body: ExprId,
        /// The loop.
        block: BlockId,
    },
    /// Store a value.
    Store(Store),
}

/// Blocks of one function.
#[derive(Clone, Debug)]
pub struct Schedule {
    /// The blocks, 0 first.
    pub blocks: Vec<Block>,
    /// Outermost block that values may be placed in.
    floor: BlockId,
}

/// The schedules of a staged program, to be run one after another.
///
/// # Errors
/// If the staged program addresses what it cannot have.
pub(crate) fn schedules(staged: &Staged, exprs: &Exprs, layout: &Layout, access: Access) -> Result<Vec<Schedule>, ScheduleError> {
    staged.stages.iter().map(|nests| Builder::new(exprs, layout, access).build(nests, staged.in_place)).collect()
}

impl Schedule {
    /// The block where a node that is needed in `block` has its value.
    #[must_use]
    pub fn home(&self, exprs: &Exprs, block: BlockId, expr: ExprId) -> BlockId {
        home(&self.blocks, self.floor, exprs.free(expr), block)
    }

    /// The loop around a place in `block` that binds a counter there: the innermost one, as
    /// reductions may bind a counter again.
    #[must_use]
    pub fn binder(&self, block: BlockId, counter: u8) -> Option<BlockId> {
        let mut at = Some(block);
        while let Some(b) = at.filter(|&b| self.blocks[b].counter != Some(counter)) {
            at = self.blocks[b].parent;
        }
        at
    }

    /// Visits what an item uses, with the block that uses it, also inside of reductions.
    pub(crate) fn each_use(&self, exprs: &Exprs, block: BlockId, item: Item, visit: &mut dyn FnMut(BlockId, ExprId)) {
        match item {
            Item::Eval(expr) => exprs.operands(expr).for_each(|o| visit(block, o)),
            Item::Store(store) => visit(block, store.value),
            Item::Reduce { body, block: inner, .. } => {
                visit(inner, body);
                for item in &self.blocks[inner].items {
                    self.each_use(exprs, inner, *item, visit);
                }
            }
        }
    }

    /// Visits the items of a block and of the loops in it.
    pub(crate) fn each_item(&self, block: BlockId, visit: &mut dyn FnMut(BlockId, Item)) {
        self.blocks[block].items.iter().for_each(|item| visit(block, *item));
        self.blocks[block].children.iter().for_each(|&child| self.each_item(child, visit));
    }

    /// Returns `true` if `block` is `outer` or inside of it.
    #[must_use]
    pub fn is_inside(&self, block: BlockId, outer: BlockId) -> bool {
        let mut at = Some(block);
        while let Some(b) = at {
            if b == outer {
                return true;
            }
            at = self.blocks[b].parent;
        }
        false
    }
}

fn home(blocks: &[Block], floor: BlockId, free: u8, block: BlockId) -> BlockId {
    let mut at = block;
    loop {
        if at == floor || blocks[at].counter.is_some_and(|c| free & (1 << c) != 0) {
            return at;
        }
        match blocks[at].parent {
            Some(parent) => at = parent,
            None => return at,
        }
    }
}

/// Returns `true` if a node needs no place: it is written where it is used.
#[must_use]
pub(crate) fn is_immediate(node: Expr) -> bool {
    matches!(node, Expr::Const(_) | Expr::Truth(_))
}

struct Builder<'a> {
    exprs: &'a Exprs,
    layout: &'a Layout,
    access: Access,
    schedule: Schedule,
    placed: FastSet<(BlockId, ExprId)>,
    /// Body blocks of reductions by where the reduction is placed.
    bodies: Vec<(BlockId, ExprId, BlockId)>,
}

impl<'a> Builder<'a> {
    fn new(exprs: &'a Exprs, layout: &'a Layout, access: Access) -> Self {
        let root = Block { parent: None, counter: None, extent: 1, items: vec![], children: vec![], leaf: false };
        let schedule = Schedule { blocks: vec![root], floor: 0 };
        Builder { exprs, layout, access, schedule, placed: FastSet::default(), bodies: vec![] }
    }

    fn build(mut self, nests: &[Nest], in_place: bool) -> Result<Schedule, ScheduleError> {
        for nest in nests.iter().filter(|t| t.loops.iter().all(|&(_, extent)| extent > 0)) {
            let block = self.nest(&nest.loops);
            if in_place {
                self.schedule.floor = block;
                for store in &nest.stores {
                    self.place(block, store.value)?;
                }
            }
            for &store in &nest.stores {
                self.place(block, store.value)?;
                self.check_target(block, store.target)?;
                self.schedule.blocks[block].items.push(Item::Store(store));
            }
        }
        Ok(self.schedule)
    }

    /// The block of a nest of loops, shared by the nests over the same.
    fn nest(&mut self, loops: &[(u8, u32)]) -> BlockId {
        let mut at = 0;
        for (i, &(counter, extent)) in loops.iter().enumerate() {
            let leaf = i + 1 == loops.len();
            let blocks = &mut self.schedule.blocks;
            let same = |&&b: &&BlockId| {
                let block = &blocks[b];
                block.counter == Some(counter) && block.extent == extent && block.leaf == leaf
            };
            at = match blocks[at].children.iter().find(same) {
                Some(&child) => child,
                None => {
                    let child = blocks.len();
                    blocks.push(Block { parent: Some(at), counter: Some(counter), extent, items: vec![], children: vec![], leaf });
                    blocks[at].children.push(child);
                    child
                }
            };
        }
        at
    }

    /// Places a node and all it needs, operands first.
    fn place(&mut self, block: BlockId, expr: ExprId) -> Result<(), ScheduleError> {
        let mut stack = vec![(block, expr, false)];
        while let Some((from, expr, entered)) = stack.pop() {
            let node = self.exprs.node(expr);
            if is_immediate(node) {
                continue;
            }
            let home = self.schedule.home(self.exprs, from, expr);
            if entered {
                self.finish(home, expr, node);
                continue;
            }
            if !self.placed.insert((home, expr)) {
                continue;
            }
            self.check_node(home, expr, node)?;
            stack.push((home, expr, true));
            if let Expr::Reduce { depth, extent, body, .. } = node {
                let blocks = &mut self.schedule.blocks;
                let inner = blocks.len();
                blocks.push(Block { parent: Some(home), counter: Some(depth.0), extent, items: vec![], children: vec![], leaf: false });
                self.bodies.push((home, expr, inner));
                stack.push((inner, body, false));
            } else {
                // The last pushed is placed first: operands in their order.
                let first = stack.len();
                stack.extend(self.exprs.operands(expr).map(|o| (home, o, false)));
                stack[first..].reverse();
            }
        }
        Ok(())
    }

    fn finish(&mut self, home: BlockId, expr: ExprId, node: Expr) {
        let item = match node {
            Expr::Reduce { op, body, .. } => match self.bodies.iter().rposition(|&(h, e, _)| h == home && e == expr) {
                Some(i) => Item::Reduce { expr, op, body, block: self.bodies.swap_remove(i).2 },
                None => return,
            },
            _ => Item::Eval(expr),
        };
        self.schedule.blocks[home].items.push(item);
    }

    fn check_node(&self, block: BlockId, expr: ExprId, node: Expr) -> Result<(), ScheduleError> {
        let function = self.access.name;
        let free = self.exprs.free(expr);
        if let Some(counter) = (0..MAX_DEPTH as u8).find(|c| free & (1 << c) != 0 && self.extent(block, *c).is_none()) {
            return Err(ScheduleError::Unbound { function, counter });
        }
        let Expr::Load { var, flavour, at } = node else {
            return Ok(());
        };
        let address = self.layout.address(var, flavour);
        let has = match address {
            Some(Address { base: Base::Y, .. }) => self.access.y,
            Some(Address { base: Base::Yp, .. }) => self.access.yp,
            other => other.is_some(),
        };
        if !has {
            return Err(ScheduleError::Unavailable { function, variable: format!("{var} ({flavour:?})") });
        }
        self.check_range(block, at, i64::from(self.layout.elements(var)), || var.to_string())
    }

    fn check_target(&self, block: BlockId, Target { place, at }: Target) -> Result<(), ScheduleError> {
        let function = self.access.name;
        match place {
            Place::Out => self.check_range(block, at, self.access.out as i64, || "the output".into()),
            // Tables are made together with the nests that use them, from the same loops.
            Place::Table { .. } => Ok(()),
            Place::Var(var) => {
                let variable = var.to_string();
                match self.layout.address(var, Flavour::Value) {
                    Some(Address { base: Base::Y, .. }) if !self.access.y => Err(ScheduleError::Unavailable { function, variable }),
                    None => Err(ScheduleError::Unavailable { function, variable }),
                    Some(_) => self.check_range(block, at, i64::from(self.layout.elements(var)), || variable),
                }
            }
        }
    }

    fn extent(&self, block: BlockId, counter: u8) -> Option<u32> {
        self.schedule.binder(block, counter).map(|b| self.schedule.blocks[b].extent)
    }

    fn check_range(&self, block: BlockId, at: Affine, len: i64, what: impl FnOnce() -> String) -> Result<(), ScheduleError> {
        let function = self.access.name;
        let (mut low, mut high) = (at.offset, at.offset);
        for (counter, &stride) in (0..).zip(&at.strides).filter(|(_, s)| **s != 0) {
            let Some(extent) = self.extent(block, counter) else {
                return Err(ScheduleError::Unbound { function, counter });
            };
            if extent == 0 {
                return Ok(());
            }
            let reach = stride * (i64::from(extent) - 1);
            low += reach.min(0);
            high += reach.max(0);
        }
        if low < 0 || high >= len {
            return Err(ScheduleError::OutOfRange { function, what: what(), low, high, len });
        }
        Ok(())
    }
}
