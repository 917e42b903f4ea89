//! Equations as nodes, unknowns as elements, and a matching of both in which a loop of equations is
//! one node.

use smpl_dsl::span::Span;

use super::super::common::passes;
use crate::differentiate;
use crate::elaborate::{Equation, EquationForm, for_each_element};
use crate::ir::{Affine, Compare, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, Loops, MAX_DEPTH, Role, VarId, loops_of};
use crate::model::{Model, Quantity};

/// Passes of a sum of which each is tried as the unknown of an equation.
const TRIED: u32 = 64;

/// Deepest chain of equations that give their unknowns to each other.
const DEEPEST: usize = 4000;

/// Preferences from the text of the model.
pub(super) struct Wishes {
    /// Rank of each state; states of lower rank follow first.
    pub(super) keep: FastMap<VarId, u8>,
}

/// An equation, or a loop of equations.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) extents: Vec<u32>,
    /// Left side less right side.
    pub(super) residual: ExprId,
    pub(super) span: Span,
    /// The element on one side alone, which it determines first.
    pub(super) own: Option<(VarId, Affine)>,
    /// Number of differentiations.
    pub(super) order: u32,
    /// The node of its time derivative.
    pub(super) derivative: Option<usize>,
}

/// A constraint with the element that follows from it.
#[derive(Clone, Debug)]
pub(super) struct Settled {
    pub(super) node: Node,
    pub(super) var: VarId,
    pub(super) at: Affine,
    /// The derivative by it could become zero.
    pub(super) varies: bool,
}

impl Node {
    /// A node of an equation that is not a rate.
    pub(super) fn of(exprs: &mut Exprs, equation: &Equation) -> Option<Node> {
        let (residual, own) = match equation.form {
            EquationForm::Rate { .. } => return None,
            EquationForm::Definition { var, at, value } => {
                let own = exprs.load(var, Flavour::Value, at);
                (exprs.sub(value, own), Some((var, at)))
            }
            EquationForm::Implicit { residual } => (residual, None),
        };
        Some(Node { extents: equation.extents.clone(), residual, span: equation.span, own, order: 0, derivative: None })
    }

    /// One node for each pass of the loops.
    pub(super) fn unrolled(self, exprs: &mut Exprs) -> Vec<Node> {
        let mut nodes = vec![self];
        while let Some(d) = nodes.first().and_then(|node| node.extents.len().checked_sub(1)) {
            let mut next = Vec::with_capacity(nodes.len());
            for node in nodes {
                let extent = node.extents[d];
                next.extend((0..i64::from(extent)).map(|pass| node.at_pass(exprs, d, pass)));
            }
            nodes = next;
        }
        nodes
    }

    /// The node at one pass of its innermost loop.
    fn at_pass(&self, exprs: &mut Exprs, d: usize, pass: i64) -> Node {
        let residual = exprs.shift(self.residual, LoopVar(d as u8), pass);
        let own = self.own.map(|(var, at)| (var, at.at_pass(d, pass)));
        Node { extents: self.extents[..d].to_vec(), residual, own, ..self.clone() }
    }

    /// Number of equations.
    pub(super) fn count(&self) -> i64 {
        passes(&self.extents)
    }

    /// The unknown loads: values of algebraic variables.
    pub(super) fn reads(&self, model: &Model, of: Role) -> Vec<Read> {
        let mut walk = Walk { exprs: &model.exprs, seen: FastSet::default(), out: Vec::new() };
        walk.value(self.residual, loops_of(&self.extents), &|var| model.vars[var].role == of);
        walk.out.sort_by_key(|read| (read.var, read.at));
        walk.out.dedup_by_key(|read| (read.var, read.at, read.loops));
        walk.out
    }

    /// Elements of variables of a role, one for each pass of the loops, all of them different.
    pub(super) fn candidates(&self, model: &Model, of: Role) -> Vec<(VarId, Affine)> {
        let mut out = Vec::new();
        for read in self.reads(model, of) {
            let inner: Vec<usize> = (self.extents.len()..MAX_DEPTH).filter(|&d| read.at.strides[d] != 0).collect();
            let mut fixed = vec![read.at];
            for d in inner {
                let extent = read.loops[d].unwrap_or(1).min(TRIED);
                fixed = fixed.iter().flat_map(|at| (0..i64::from(extent)).map(|pass| at.at_pass(d, pass))).take(TRIED as usize).collect();
            }
            out.extend(fixed.into_iter().filter(|at| is_injective(&self.extents, *at)).map(|at| (read.var, at)));
        }
        out.sort_unstable();
        out.dedup();
        out
    }
}

/// Returns `true` if the passes of loops have different addresses.
fn is_injective(extents: &[u32], at: Affine) -> bool {
    let mut steps: Vec<(i64, i64)> = extents.iter().zip(at.strides).map(|(&n, s)| (s.abs(), i64::from(n))).collect();
    steps.retain(|&(_, n)| n > 1);
    steps.sort_unstable();
    let mut reach = 0;
    steps.into_iter().all(|(stride, n)| {
        let apart = stride > reach;
        reach += stride * (n - 1);
        apart
    })
}

/// Addresses of `len` elements one after another in the order of a nest of loops.
pub(super) fn whole_of(extents: &[u32], len: usize) -> Affine {
    let mut at = Affine::constant(0);
    let mut stride = len as i64;
    for (d, &n) in extents.iter().enumerate() {
        stride /= i64::from(n.max(1));
        at = at.plus(Affine::along(0, LoopVar(d as u8), stride));
    }
    at
}

/// A load inside of loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Read {
    pub(super) var: VarId,
    pub(super) at: Affine,
    pub(super) loops: Loops,
}

impl Read {
    /// Calls `f` with every element.
    pub(super) fn each(&self, f: &mut dyn FnMut(i64)) {
        let extents = self.loops.map(|extent| extent.unwrap_or(1));
        for_each_element(&extents, self.at, f);
    }
}

struct Walk<'m> {
    exprs: &'m Exprs,
    seen: FastSet<(ExprId, Loops)>,
    out: Vec<Read>,
}

impl Walk<'_> {
    fn value(&mut self, root: ExprId, loops: Loops, accept: &dyn Fn(VarId) -> bool) {
        let mut stack = vec![(root, loops)];
        while let Some((e, loops)) = stack.pop() {
            let free = self.exprs.free(e);
            let around: Loops = std::array::from_fn(|d| loops[d].filter(|_| free & (1 << d) != 0));
            if !self.seen.insert((e, around)) {
                continue;
            }
            match self.exprs.node(e) {
                Expr::Load { var, flavour: Flavour::Value, at } if accept(var) => self.out.push(Read { var, at, loops: around }),
                Expr::Reduce { depth, extent, body, .. } => {
                    let mut inner = loops;
                    inner[usize::from(depth.0)] = Some(extent);
                    stack.push((body, inner));
                }
                _ => stack.extend(self.exprs.operands(e).map(|o| (o, loops))),
            }
        }
    }
}

/// Sets of elements of variables.
#[derive(Clone, Debug, Default)]
pub(super) struct Pool(pub(super) FastMap<VarId, Vec<bool>>);

impl Pool {
    pub(super) fn has(&self, var: VarId, element: i64) -> bool {
        self.0.get(&var).and_then(|list| list.get(element as usize)).copied().unwrap_or(false)
    }

    pub(super) fn set(&mut self, model: &Model, var: VarId, element: i64, to: bool) {
        let list = self.0.entry(var).or_insert_with(|| vec![false; model.vars[var].len as usize]);
        list.get_mut(element as usize).into_iter().for_each(|slot| *slot = to);
    }

    /// All elements of it, in the order of the variables.
    pub(super) fn elements(&self) -> Vec<(VarId, i64)> {
        let mut vars: Vec<VarId> = self.0.keys().copied().collect();
        vars.sort_unstable();
        vars.iter().flat_map(|&var| self.0[&var].iter().zip(0..).filter(|(on, _)| **on).map(move |(_, i)| (var, i))).collect()
    }
}

/// A matching of nodes to elements.
#[derive(Clone, Debug, Default)]
pub(super) struct Matching {
    /// The elements of each node.
    pub(super) of: FastMap<usize, (VarId, Affine)>,
    owner: FastMap<(VarId, i64), usize>,
}

/// Input of a search.
pub(super) struct Search<'s> {
    pub(super) nodes: &'s [Node],
    /// Candidates of each node, the best first.
    pub(super) candidates: &'s FastMap<usize, Vec<(VarId, Affine)>>,
    pub(super) pool: &'s Pool,
}

impl Matching {
    /// The node that determines an element.
    pub(super) fn owner(&self, var: VarId, element: i64) -> Option<usize> {
        self.owner.get(&(var, element)).copied()
    }

    fn take(&mut self, nodes: &[Node], node: usize, (var, at): (VarId, Affine)) {
        self.leave(nodes, node);
        for_each_element(&nodes[node].extents, at, &mut |i| {
            self.owner.insert((var, i), node);
        });
        self.of.insert(node, (var, at));
    }

    /// Gives the elements of a node up.
    pub(super) fn leave(&mut self, nodes: &[Node], node: usize) {
        if let Some((var, at)) = self.of.remove(&node) {
            for_each_element(&nodes[node].extents, at, &mut |i| {
                self.owner.remove(&(var, i));
            });
        }
    }

    /// Gives a node its own elements where they are free.
    pub(super) fn take_own(&mut self, s: &Search<'_>, node: usize) -> bool {
        let Some((var, at)) = s.nodes[node].own else { return false };
        let fits = self.owners(s, node, (var, at)).is_some_and(|owners| owners.is_empty());
        if fits {
            self.take(s.nodes, node, (var, at));
        }
        fits
    }

    /// The nodes that hold elements of a candidate; `None` where one of these is not to be
    /// determined.
    fn owners(&self, s: &Search<'_>, node: usize, (var, at): (VarId, Affine)) -> Option<Vec<usize>> {
        let (mut fits, mut owners) = (true, Vec::new());
        for_each_element(&s.nodes[node].extents, at, &mut |i| {
            fits &= s.pool.has(var, i);
            owners.extend(self.owner(var, i).filter(|&o| o != node && owners.last() != Some(&o)));
        });
        owners.sort_unstable();
        owners.dedup();
        fits.then_some(owners)
    }

    /// Finds elements for a node, other nodes giving theirs up for others; `visited` are the nodes
    /// that the search came to.
    pub(super) fn augment(&mut self, s: &Search<'_>, node: usize, visited: &mut FastSet<usize>, depth: usize) -> bool {
        if depth > DEEPEST || !visited.insert(node) {
            return false;
        }
        let none = Vec::new();
        let candidates = s.candidates.get(&node).unwrap_or(&none);
        let owned: Vec<_> = candidates.iter().filter_map(|&c| Some((c, self.owners(s, node, c)?))).collect();
        if let Some((candidate, _)) = owned.iter().find(|(_, owners)| owners.is_empty()) {
            self.take(s.nodes, node, *candidate);
            return true;
        }
        for (candidate, owners) in owned {
            if owners.iter().any(|owner| visited.contains(owner)) {
                continue;
            }
            let before: Vec<_> = owners.iter().filter_map(|o| Some((*o, *self.of.get(o)?))).collect();
            // One owner more is exact; for several all must find something else.
            let kept = (owners.len() > 1).then(|| self.clone());
            owners.iter().for_each(|&owner| self.leave(s.nodes, owner));
            self.take(s.nodes, node, candidate);
            if owners.iter().all(|&owner| self.augment(s, owner, visited, depth + 1)) {
                return true;
            }
            match kept {
                Some(kept) => *self = kept,
                None => {
                    self.leave(s.nodes, node);
                    before.into_iter().for_each(|(owner, elements)| self.take(s.nodes, owner, elements));
                }
            }
        }
        false
    }
}

/// The derivative of an expression by one element.
pub(super) fn by_element(exprs: &mut Exprs, depth: usize, e: ExprId, (var, at): (VarId, Affine)) -> Option<ExprId> {
    let one = |exprs: &mut Exprs, load: Option<(VarId, Flavour, Affine)>| match load {
        Some((v, Flavour::Value, read)) if v == var => {
            let (own, other) = (super::super::whole::number(exprs, at), super::super::whole::number(exprs, read));
            let (same, one, zero) = (exprs.compare(Compare::Eq, own, other), exprs.constant(1.0), exprs.constant(0.0));
            Some(if read == at { one } else { exprs.select(same, one, zero) })
        }
        _ => None,
    };
    differentiate::total(exprs, depth, e, &one).ok()
}

/// The declared magnitude of a variable, 1 without one.
pub(super) fn scale(model: &Model, var: VarId, at: Affine) -> f64 {
    let q = &model.interface.quantities;
    let quantity = q.states.iter().chain(&q.algebraics).find(|q| q.var == Some(var));
    let scale = quantity.map(|q| Quantity::pick(&q.scale, at.offset.max(0) as usize)).filter(|x| x.is_finite() && *x > 0.0);
    scale.unwrap_or(1.0)
}
