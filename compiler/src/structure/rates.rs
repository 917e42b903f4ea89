//! Rates of the states: solving for derivatives, coverage, substitution on right sides.

use cranelift_entity::PrimaryMap;
use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;

use super::common::{element_name, replace_everywhere};
use crate::elaborate::{Equation, EquationForm, for_each_element};
use crate::ir::{Affine, BinaryFn, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, MAX_DEPTH, Rewritten, Role, UnaryFn, VarId};
use crate::model::{Model, Variable};

/// States with an explicit rate.
pub(crate) struct Rates {
    /// For each state variable, whether each element has an equation `d/dt x = ...`.
    pub covered: FastMap<VarId, Vec<bool>>,
}

/// `a·x' + b = 0` becomes `x' = -b/a` if `x'` occurs linearly and is the only derivative that no
/// other equation gives: `w = der(x)` is one for `w` if `d/dt x = ...` is another equation.
pub(crate) fn solve_for_derivatives(exprs: &mut Exprs, vars: &PrimaryMap<VarId, Variable>, equations: &mut [Equation]) {
    let mut given = Given { covered: FastMap::default(), reads: FastMap::default(), vars };
    let mut open = Vec::new();
    for (number, equation) in equations.iter_mut().enumerate() {
        let mut own = None;
        if let EquationForm::Rate { var, at, value } = equation.form {
            given.add(exprs, (var, at, value), &equation.extents);
            // A rate that mentions itself is an equation for it.
            if exprs.derivatives(value, |v| v == var).contains(&(var, Flavour::Derivative, at)) {
                let rate = exprs.load(var, Flavour::Derivative, at);
                equation.form = EquationForm::Implicit { residual: exprs.sub(rate, value) };
                own = Some((var, at));
            }
        }
        if let EquationForm::Implicit { residual } = equation.form {
            let rates: Vec<_> = exprs.derivatives(residual, |v| vars[v].role == Role::State).iter().map(|d| (d.0, d.2)).collect();
            open.push((number, residual, own, rates));
        }
    }
    // A solved rate may be the missing one of an equation before.
    loop {
        let before = open.len();
        open.retain(|(number, residual, own, rates)| {
            let equation = &mut equations[*number];
            let Some((var, at)) = given.missing(*own, rates, &equation.extents) else { return true };
            let rate = exprs.load(var, Flavour::Derivative, at);
            let Some((a, b)) = linear(exprs, *residual, rate).filter(|(a, _)| !exprs.has_derivative(*a)) else { return true };
            let minus_b = exprs.neg(b);
            let value = exprs.div(minus_b, a);
            equation.form = EquationForm::Rate { var, at, value };
            given.add(exprs, (var, at, value), &equation.extents);
            false
        });
        if open.len() == before {
            return;
        }
    }
}

/// Elements of states whose rates equations give.
struct Given<'m> {
    covered: FastMap<VarId, Vec<bool>>,
    /// States whose rates occur in that of a state.
    reads: FastMap<VarId, FastSet<VarId>>,
    vars: &'m PrimaryMap<VarId, Variable>,
}

impl Given<'_> {
    fn add(&mut self, exprs: &Exprs, (var, at, value): (VarId, Affine, ExprId), extents: &[u32]) {
        let covered = self.covered.entry(var).or_insert_with(|| vec![false; self.vars[var].len as usize]);
        for_each_element(extents, at, &mut |i| covered.get_mut(i as usize).into_iter().for_each(|slot| *slot = true));
        let read = exprs.derivatives(value, |v| v != var && self.vars[v].role == Role::State);
        self.reads.entry(var).or_default().extend(read.iter().map(|(other, ..)| *other));
    }

    /// The rate that an equation is for: its own, or the only one of `rates` that is not given. The
    /// others must be given, and must not follow from it.
    fn missing(&self, own: Option<(VarId, Affine)>, rates: &[(VarId, Affine)], extents: &[u32]) -> Option<(VarId, Affine)> {
        let is_missing = |rate: &&(VarId, Affine)| own.map_or_else(|| !self.has_all(**rate, extents), |own| **rate == own);
        let (missing, others): (Vec<_>, Vec<_>) = rates.iter().partition(is_missing);
        let &[&(var, at)] = missing.as_slice() else { return None };
        if own.is_none() && self.count(var, at, extents).1 || !others.iter().all(|other| self.has_all(**other, extents)) {
            return None;
        }
        let mut follow: Vec<VarId> = others.iter().map(|other| other.0).collect();
        let mut seen = FastSet::default();
        while let Some(one) = follow.pop() {
            if one == var {
                return None;
            }
            if seen.insert(one) {
                follow.extend(self.reads.get(&one).into_iter().flatten());
            }
        }
        Some((var, at))
    }

    fn has_all(&self, (var, at): (VarId, Affine), extents: &[u32]) -> bool {
        self.count(var, at, extents).0
    }

    /// Returns whether all of the elements are among them, and whether one is.
    fn count(&self, var: VarId, at: Affine, extents: &[u32]) -> (bool, bool) {
        let (mut all, mut any) = (true, false);
        for_each_element(extents, at, &mut |i| {
            let has = self.covered.get(&var).and_then(|covered| covered.get(i as usize)) == Some(&true);
            (all, any) = (all && has, any || has);
        });
        (all, any)
    }
}

/// `e = a·x + b` with `a` and `b` free of the node `x`.
pub(super) fn linear(exprs: &mut Exprs, e: ExprId, x: ExprId) -> Option<(ExprId, ExprId)> {
    let zero = exprs.constant(0.0);
    if e == x {
        return Some((exprs.constant(1.0), zero));
    }
    if !depends(exprs, e, x) {
        return Some((zero, e));
    }
    match exprs.node(e) {
        Expr::Unary(UnaryFn::Neg, a) => {
            let (a, b) = linear(exprs, a, x)?;
            Some((exprs.neg(a), exprs.neg(b)))
        }
        Expr::Binary(f @ (BinaryFn::Add | BinaryFn::Sub), p, q) => {
            let ((a1, b1), (a2, b2)) = (linear(exprs, p, x)?, linear(exprs, q, x)?);
            Some((exprs.binary(f, a1, a2), exprs.binary(f, b1, b2)))
        }
        Expr::Binary(BinaryFn::Mul, p, q) => {
            let (p, q) = if depends(exprs, p, x) { (p, q) } else { (q, p) };
            if depends(exprs, q, x) {
                return None;
            }
            let (a, b) = linear(exprs, p, x)?;
            Some((exprs.mul(a, q), exprs.mul(b, q)))
        }
        Expr::Binary(BinaryFn::Div, p, q) if !depends(exprs, q, x) => {
            let (a, b) = linear(exprs, p, x)?;
            Some((exprs.div(a, q), exprs.div(b, q)))
        }
        Expr::Select(condition, p, q) if !depends(exprs, condition, x) => {
            let ((a1, b1), (a2, b2)) = (linear(exprs, p, x)?, linear(exprs, q, x)?);
            Some((exprs.select(condition, a1, a2), exprs.select(condition, b1, b2)))
        }
        _ => None,
    }
}

fn depends(exprs: &Exprs, e: ExprId, x: ExprId) -> bool {
    exprs.below([e]).any(|e| e == x)
}

/// Checks that no state has two rates, and returns those with one.
///
/// # Errors
/// States with two equations for their derivative.
pub(crate) fn cover_states(model: &Model, equations: &[Equation]) -> Result<Rates, Faults> {
    let mut covered: FastMap<VarId, Vec<bool>> = FastMap::default();
    let mut first: FastMap<VarId, Span> = FastMap::default();
    let mut faults = Faults::default();
    for (var, v) in model.vars.iter().filter(|(_, v)| v.role == Role::State) {
        covered.insert(var, vec![false; v.len as usize]);
    }
    for equation in equations {
        let EquationForm::Rate { var, at, .. } = equation.form else { continue };
        let Some(list) = covered.get_mut(&var) else { continue };
        let mut twice = None;
        for_each_element(&equation.extents, at, &mut |i| match list.get_mut(i as usize) {
            Some(slot) if *slot => twice = Some(i),
            Some(slot) => *slot = true,
            None => {}
        });
        if let Some(i) = twice {
            faults.push_with(|| {
                let message = format!("two equations determine `d/dt {}`", element_name(model, var, i));
                Diagnostic::error(codes::OVERDETERMINED, message, equation.span)
                    .label("the second one")
                    .secondary(first.get(&var).copied().unwrap_or_default(), "the first one")
            });
        }
        first.entry(var).or_insert(equation.span);
    }
    if faults.is_empty() { Ok(Rates { covered }) } else { Err(faults) }
}

/// Replaces derivatives on right sides, in programs and elsewhere by the rates themselves, where
/// these are explicit.
pub(crate) fn substitute_derivatives(model: &mut Model, equations: &mut [Equation]) {
    let pieces: Vec<(VarId, Affine, Vec<u32>, ExprId)> = equations
        .iter()
        .filter_map(|e| match e.form {
            EquationForm::Rate { var, at, value } => Some((var, at, e.extents.clone(), value)),
            _ => None,
        })
        .collect();
    let mut resolver = Resolver { pieces, done: FastMap::default(), open: Vec::new() };
    let mut done = Rewritten::default();
    replace_everywhere(model, equations, &mut done, &Exprs::has_derivative, &mut |exprs, node| match node {
        Expr::Load { var, flavour: Flavour::Derivative, at } => resolver.rate(exprs, var, at),
        _ => None,
    });
}

struct Resolver {
    pieces: Vec<(VarId, Affine, Vec<u32>, ExprId)>,
    done: FastMap<(VarId, Affine), Option<ExprId>>,
    open: Vec<(VarId, Affine)>,
}

impl Resolver {
    /// The rate of an element (or of the elements of a loop), free of derivatives; `None` if it is
    /// missing or needs itself.
    fn rate(&mut self, exprs: &mut Exprs, var: VarId, at: Affine) -> Option<ExprId> {
        if let Some(known) = self.done.get(&(var, at)) {
            return *known;
        }
        if self.open.contains(&(var, at)) {
            return None;
        }
        let value = self.pieces.iter().filter(|p| p.0 == var).find_map(|(_, own, extents, value)| {
            let fixed = passes_at(*own, extents, at)?;
            Some((fixed, *value))
        });
        let result = value.map(|(fixed, value)| {
            let moved = shifted(exprs, value, &fixed);
            self.open.push((var, at));
            let free = exprs.rewrite_where(moved, &mut Rewritten::default(), &Exprs::has_derivative, &mut |exprs, node| match node {
                Expr::Load { var, flavour: Flavour::Derivative, at } => self.rate(exprs, var, at),
                _ => None,
            });
            self.open.pop();
            free
        });
        self.done.insert((var, at), result);
        result
    }
}

/// Passes at which a piece determines the element `at`: none where it is the same loop, one a loop
/// for a single element inside it. A loop that is shifted against the piece is refused: its ends
/// would belong to other equations.
pub(super) fn passes_at(own: Affine, extents: &[u32], at: Affine) -> Option<Vec<i64>> {
    if own == at {
        return Some(Vec::new());
    }
    if !at.is_constant() || own.is_constant() {
        return None;
    }
    let mut rest = at.offset - own.offset;
    let mut fixed = Vec::with_capacity(extents.len());
    for (d, &n) in extents.iter().enumerate() {
        let stride = own.strides[d];
        if stride == 0 {
            return None;
        }
        let pass = rest.div_euclid(stride);
        if pass < 0 || pass >= i64::from(n) {
            return None;
        }
        rest -= pass * stride;
        fixed.push(pass);
    }
    (rest == 0).then_some(fixed)
}

pub(super) fn shifted(exprs: &mut Exprs, e: ExprId, passes: &[i64]) -> ExprId {
    let mut e = e;
    for (d, &pass) in passes.iter().enumerate().take(MAX_DEPTH) {
        e = exprs.shift(e, LoopVar(d as u8), pass);
    }
    e
}

/// Returns `true` if every rate is `f(t, y) - y'` and nothing else mentions a derivative.
pub(crate) fn is_explicit(model: &Model) -> bool {
    let exprs = &model.exprs;
    model.rows.iter().all(|row| {
        if model.vars[row.var].role != Role::State {
            return !exprs.has_derivative(row.residual);
        }
        match exprs.node(row.residual) {
            Expr::Binary(BinaryFn::Sub, value, own) => {
                let own_is =
                    matches!(exprs.node(own), Expr::Load { var, flavour: Flavour::Derivative, at } if var == row.var && at == row.at);
                own_is && !exprs.has_derivative(value)
            }
            // 0 - y'
            Expr::Unary(UnaryFn::Neg, own) => {
                matches!(exprs.node(own), Expr::Load { var, flavour: Flavour::Derivative, at } if var == row.var && at == row.at)
            }
            _ => false,
        }
    })
}
