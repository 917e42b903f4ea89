//! Assignments of one block of an instant: all right sides see the values before it.
//!
//! Assignments that read nothing set by an earlier one keep a nest each. Where one does, scalars
//! share a nest, whose values are all computed before the first is stored, and with loops the old
//! values are copied first.

use smpl_dsl::span::Span;

use crate::elaborate::episode::common::store;
use crate::elaborate::lower::Lowering;
use crate::ir::{
    Affine, Expr, FastMap, FastSet, Flavour, LoopVar, Nest, Place as Memory, Program, Rewritten, Role, Store, VarId, loops_of,
};

/// Kind of a statement of an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::elaborate) enum AssignmentKind {
    /// `next`
    Next,
    /// `reset`
    Reset,
    /// `clamp`: acts in the order of the text.
    Clamp,
}

/// A store in loops, if there are any.
pub(in crate::elaborate) struct Assignment {
    /// Extents of the loops.
    pub extents: Vec<u32>,
    /// The store.
    pub store: Store,
}

/// The program of an instant as it is put together.
#[derive(Default)]
pub(in crate::elaborate) struct Draft {
    /// The `next`s of all blocks come first.
    nexts_first: bool,
    nests: Vec<Nest>,
    /// `next`s that come first.
    first: Vec<Assignment>,
    /// Assignments of the block since its last clamp, and whether each is a `next`.
    open: Vec<(bool, Assignment)>,
    block: Option<Span>,
}

impl Draft {
    /// The program of the start of a step, in which the `next`s of all blocks come first.
    pub(in crate::elaborate) fn of_start() -> Draft {
        Draft { nexts_first: true, ..Draft::default() }
    }

    /// Adds an assignment of a block.
    pub(in crate::elaborate) fn push(&mut self, l: &mut Lowering<'_, '_>, block: Span, kind: AssignmentKind, assignment: Assignment) {
        if kind == AssignmentKind::Next && self.nexts_first {
            return self.first.push(assignment);
        }
        if kind == AssignmentKind::Clamp || self.block.is_some_and(|b| b != block) {
            self.close(l);
        }
        self.block = Some(block);
        match kind {
            AssignmentKind::Clamp => self.nests.push(Nest::over(assignment.extents, vec![assignment.store])),
            _ => self.open.push((kind == AssignmentKind::Next, assignment)),
        }
    }

    /// Ends a group of assignments.
    fn close(&mut self, l: &mut Lowering<'_, '_>) {
        let group = std::mem::take(&mut self.open);
        self.nests.extend(together(l, group));
    }

    /// The program.
    pub(in crate::elaborate) fn program(mut self, l: &mut Lowering<'_, '_>) -> Program {
        self.close(l);
        let first = std::mem::take(&mut self.first).into_iter().map(|assignment| (true, assignment)).collect();
        let mut nests = together(l, first);
        nests.extend(self.nests);
        Program { nests, in_place: true }
    }
}

/// The nests of assignments that see the values before all of them; with each, whether it is a
/// `next`.
fn together(l: &mut Lowering<'_, '_>, mut group: Vec<(bool, Assignment)>) -> Vec<Nest> {
    let reads_later = reads_what_is_set(l, &group);
    let scalar = group.iter().all(|(_, a)| a.extents.is_empty());
    if reads_later && scalar {
        return vec![Nest { loops: Vec::new(), stores: group.into_iter().map(|(_, a)| a.store).collect() }];
    }
    let mut nests = if reads_later { hold_old_values(l, &mut group) } else { Vec::new() };
    let mut after_next = false;
    for (is_next, Assignment { extents, store }) in group {
        let joins = is_next && extents.is_empty();
        match nests.last_mut().filter(|_| joins && after_next) {
            Some(last) => last.stores.push(store),
            None => nests.push(Nest::over(extents, vec![store])),
        }
        after_next = joins;
    }
    nests
}

/// A value that an assignment reads: the element, where it is one, else the lowest and the highest
/// one.
struct Read {
    var: VarId,
    flavour: Flavour,
    at: Affine,
    reach: (i64, i64),
}

fn reads(l: &Lowering<'_, '_>, assignment: &Assignment) -> Vec<Read> {
    let loops = loops_of(&assignment.extents);
    let of = |e| match l.exprs.node(e) {
        Expr::Load { var, flavour: flavour @ (Flavour::Value | Flavour::Derivative), at } => {
            let within = usize::from(at.depth()) <= assignment.extents.len();
            let reach = if within { at.reach(&loops) } else { (0, i64::from(l.symbols.vars[var].len) - 1) };
            Some(Read { var, flavour, at, reach })
        }
        _ => None,
    };
    l.exprs.below([assignment.store.value]).filter_map(of).collect()
}

/// Variable of a store.
fn target(store: &Store) -> Option<VarId> {
    match store.target.place {
        Memory::Var(var) => Some(var),
        _ => None,
    }
}

/// Returns `true` if an assignment would see what an earlier one of the group, or an earlier pass
/// of the same loops, has set. An algebraic variable and a rate follow everything that is set.
fn reads_what_is_set(l: &Lowering<'_, '_>, group: &[(bool, Assignment)]) -> bool {
    let mut elements: FastSet<(VarId, i64)> = FastSet::default();
    let mut ranges: FastMap<VarId, Vec<(i64, i64)>> = FastMap::default();
    let mut any_element: FastSet<VarId> = FastSet::default();
    for (at, (_, assignment)) in group.iter().enumerate() {
        let Some(own) = target(&assignment.store) else { continue };
        let in_loops = !assignment.extents.is_empty();
        for read in reads(l, assignment) {
            let (low, high) = read.reach;
            let follows = read.flavour == Flavour::Derivative || l.symbols.vars[read.var].role == Role::Algebraic;
            let one = if low == high { elements.contains(&(read.var, low)) } else { any_element.contains(&read.var) };
            let range = ranges.get(&read.var).is_some_and(|list| list.iter().any(|&(a, b)| a <= high && low <= b));
            let itself = in_loops && read.var == own && read.at != assignment.store.target.at;
            if follows && (at > 0 || in_loops) || one || range || itself {
                return true;
            }
        }
        let (low, high) = assignment.store.target.at.reach(&loops_of(&assignment.extents));
        if in_loops {
            ranges.entry(own).or_default().push((low, high));
        } else {
            elements.insert((own, low));
            any_element.insert(own);
        }
    }
    false
}

/// Copies of all that the assignments read and set; they read the copies.
fn hold_old_values(l: &mut Lowering<'_, '_>, group: &mut [(bool, Assignment)]) -> Vec<Nest> {
    let set: FastSet<VarId> = group.iter().filter_map(|(_, a)| target(&a.store)).collect();
    let held = l.hidden.held.var;
    let mut places: FastMap<(VarId, Flavour), i64> = FastMap::default();
    let (mut nests, mut next) = (Vec::new(), 0);
    for (_, assignment) in group.iter() {
        for Read { var, flavour, .. } in reads(l, assignment) {
            let follows = flavour == Flavour::Derivative || l.symbols.vars[var].role == Role::Algebraic;
            if !(follows || set.contains(&var)) || places.contains_key(&(var, flavour)) {
                continue;
            }
            let len = l.symbols.vars[var].len;
            let value = l.exprs.load(var, flavour, Affine::along(0, LoopVar(0), 1));
            nests.push(Nest::over([len], vec![store(Memory::Var(held), Affine::along(next, LoopVar(0), 1), value)]));
            places.insert((var, flavour), next);
            next += i64::from(len);
        }
    }
    l.hidden.held.len = l.hidden.held.len.max(next as u32);
    for (_, assignment) in group.iter_mut() {
        assignment.store.value = l.exprs.rewrite(assignment.store.value, &mut Rewritten::default(), &mut |exprs, node| match node {
            Expr::Load { var, flavour, at } => {
                places.get(&(var, flavour)).map(|&by| exprs.load(held, Flavour::Value, at.plus(Affine::constant(by))))
            }
            _ => None,
        });
    }
    nests
}
