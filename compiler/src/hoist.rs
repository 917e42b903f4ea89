//! Moves what does not change between calls out of the functions of the inner loop.
//!
//! Every node has a [`Stage`]: when its value can first be known. Maximal sub-expressions that are
//! known before a function runs become loads of cache variables. Two preparing functions fill
//! these: one when parameters are set, one at the start of each step.

use std::collections::hash_map::Entry;

use crate::ir::{Affine, Builtin, Expr, ExprId, FastMap, Flavour, MAX_DEPTH, Nest, Rewritten, Role, Store, Target, UnaryFn, VarId};
use crate::model::{Instant, Model, Variable};
use crate::schedule::Staged;
use smpl_dsl::span::Span;

/// Largest cache for one sub-expression.
const LARGEST_CACHE: u32 = 1 << 20;

/// When a value is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Stage {
    /// Always.
    Constant,
    /// Once parameters are set.
    Parameter,
    /// Once a step's inputs are set.
    Step,
    /// At a time and state.
    Dynamic,
}

/// The pass: rewrites staged programs and collects what the preparing functions compute.
pub(crate) struct Hoister<'a> {
    model: &'a mut Model,
    stages: Vec<Stage>,
    caches: FastMap<(ExprId, Extents), VarId>,
    /// Copies by the loops around and by what they may load.
    rewritten: FastMap<(Extents, Stage), Rewritten>,
    /// Fills the caches that depend on parameters.
    pub parameter: Vec<Nest>,
    /// Fills the caches that depend on a step's inputs.
    pub step: Vec<Nest>,
}

/// Passes of the loops around, by counter; 0 without a loop.
type Extents = [u32; MAX_DEPTH];

impl<'a> Hoister<'a> {
    /// A pass over a model; caches become variables of it.
    #[must_use]
    pub(crate) fn new(model: &'a mut Model) -> Self {
        Hoister { model, stages: vec![], caches: FastMap::default(), rewritten: FastMap::default(), parameter: vec![], step: vec![] }
    }

    /// The staged program with what is known at `limit` loaded from caches.
    #[must_use]
    pub(crate) fn staged(&mut self, staged: &Staged, limit: Stage) -> Staged {
        let mut staged = staged.clone();
        for nest in staged.stages.iter_mut().flatten() {
            let mut extents = [0; MAX_DEPTH];
            nest.loops.iter().for_each(|&(counter, extent)| extents[counter as usize] = extent);
            for Store { value, .. } in &mut nest.stores {
                *value = self.rewrite(*value, extents, limit);
            }
        }
        staged
    }

    /// The filling staged programs, parameters first.
    #[must_use]
    pub(crate) fn finish(self) -> (Staged, Staged) {
        let staged = |nests: Vec<Nest>| Staged { stages: vec![nests], in_place: false };
        (staged(self.parameter), staged(self.step))
    }

    /// Copies an expression with caches in it; only reductions and what fills caches recurse.
    fn rewrite(&mut self, root: ExprId, extents: Extents, limit: Stage) -> ExprId {
        let mut done = self.rewritten.remove(&(extents, limit)).unwrap_or_default();
        let mut stack = vec![(root, false)];
        while let Some((expr, entered)) = stack.pop() {
            if done.contains_key(&expr) {
                continue;
            }
            let node = self.model.exprs.node(expr);
            let copy = if entered {
                self.model.exprs.rebuild(node, |o| done.get(&o).copied().unwrap_or(o))
            } else if let Some(load) = self.hoisted(expr, node, extents, limit) {
                load
            } else if let Expr::Reduce { op, depth, extent, body } = node {
                let mut inner = extents;
                inner[depth.0 as usize] = extent;
                let body = self.rewrite(body, inner, limit);
                self.model.exprs.reduce(op, depth, extent, body)
            } else {
                stack.push((expr, true));
                stack.extend(self.model.exprs.operands(expr).map(|o| (o, false)));
                continue;
            };
            done.insert(expr, copy);
        }
        let copy = done.get(&root).copied().unwrap_or(root);
        // Filling a cache may have copied under the same loops meanwhile.
        match self.rewritten.entry((extents, limit)) {
            Entry::Vacant(place) => {
                place.insert(done);
            }
            Entry::Occupied(mut place) => place.get_mut().extend(done),
        }
        copy
    }

    /// The load that replaces a node, if it is worth a cache.
    fn hoisted(&mut self, expr: ExprId, node: Expr, extents: Extents, limit: Stage) -> Option<ExprId> {
        let stage = self.stage(expr).max(Stage::Parameter);
        if stage > limit || !self.is_worth_it(expr, node) {
            return None;
        }
        let free = self.model.exprs.free(expr);
        let mut shape = [0; MAX_DEPTH];
        let mut at = Affine::default();
        let mut len = 1u32;
        for d in (0..MAX_DEPTH).rev().filter(|d| free & (1 << d) != 0) {
            shape[d] = extents[d];
            at.strides[d] = i64::from(len);
            len = len.checked_mul(extents[d]).filter(|&l| l > 0 && l <= LARGEST_CACHE)?;
        }
        let cache = match self.caches.get(&(expr, shape)) {
            Some(&cache) => cache,
            None => self.make_cache(expr, shape, len, at, stage),
        };
        Some(self.model.exprs.load(cache, Flavour::Value, at))
    }

    fn make_cache(&mut self, expr: ExprId, shape: Extents, len: u32, at: Affine, stage: Stage) -> VarId {
        let name = format!("cache {}", self.caches.len());
        let cache = self.model.vars.push(Variable { name, role: Role::Cache, len, span: Span::default() });
        self.caches.insert((expr, shape), cache);
        let value = if stage == Stage::Step { self.rewrite(expr, shape, Stage::Parameter) } else { expr };
        let loops = (0..).zip(shape).filter(|&(_, extent)| extent > 0).collect();
        let nest = Nest { loops, stores: vec![Store { target: Target::var(cache, at), value }] };
        if stage == Stage::Step {
            self.step.push(nest)
        } else {
            self.parameter.push(nest)
        }
        cache
    }

    /// Truth values and what a load would not shorten stay where they are.
    fn is_worth_it(&self, expr: ExprId, node: Expr) -> bool {
        let exprs = &self.model.exprs;
        match node {
            Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } => false,
            Expr::Unary(UnaryFn::Neg, a) if exprs.free(expr) != 0 => !matches!(exprs.node(a), Expr::Load { .. }),
            _ => !exprs.is_truth(expr),
        }
    }

    /// Stage of a node; those of new nodes are found from operands to users.
    fn stage(&mut self, expr: ExprId) -> Stage {
        use cranelift_entity::EntityRef;
        let exprs = &self.model.exprs;
        for i in self.stages.len()..=expr.index() {
            let id = ExprId::new(i);
            let stage = match exprs.node(id) {
                Expr::Time => Stage::Dynamic,
                Expr::Load { var, flavour, at } => self.stage_of_load(var, flavour, at),
                _ => exprs.operands(id).map(|o| self.stages[o.index()]).max().unwrap_or(Stage::Constant),
            };
            self.stages.push(stage);
        }
        self.stages[expr.index()]
    }

    fn stage_of_load(&self, var: VarId, flavour: Flavour, at: Affine) -> Stage {
        let role = self.model.vars[var].role;
        match (flavour, role) {
            // Frames are filled after the parameters are prepared, also the steady one.
            (Flavour::Initial | Flavour::Previous | Flavour::Steady, _) => Stage::Step,
            (_, Role::Param | Role::ParamGiven) => Stage::Parameter,
            (_, Role::Draw) => {
                let draws = &self.model.interface.draws;
                let drawn = usize::try_from(at.offset).ok().filter(|_| at.is_constant()).and_then(|i| draws.get(i));
                if drawn.is_some_and(|d| d.instant == Instant::Reset) { Stage::Parameter } else { Stage::Step }
            }
            (_, Role::Builtin) => {
                let factor = at.offset == Builtin::DerivativeFactor as i64 || !at.is_constant();
                if factor { Stage::Dynamic } else { Stage::Step }
            }
            (_, Role::Action | Role::Discrete | Role::Disturbance) => Stage::Step,
            (_, Role::State | Role::Algebraic | Role::Quadrature | Role::Delayed | Role::Cache | Role::Scratch) => Stage::Dynamic,
        }
    }
}
