//! Marks in an expression, and what is known of what has them: read, not changed.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;

use crate::elaborate::lower::Lowering;
use crate::elaborate::space::faces::{FaceValue, Fluxes};
use crate::elaborate::space::interval;
use crate::elaborate::space::interval::Interval;
use crate::elaborate::symbols::{SymbolKind, Symbols};
use crate::ir::{Affine, BinaryFn, Expr as Node, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, UnaryFn, VarId};
use crate::model::Quantity;
/// Marks are loads of the builtins from this element on.
pub(in crate::elaborate::space) const MARK: i64 = 1 << 40;
/// Exponent of the time among those of the base quantities.
const TIME: usize = 2;

/// Marks in an expression.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::elaborate::space) enum Marks {
    None,
    One(usize),
    Many,
}

/// A term of a flux.
#[derive(Clone)]
pub(in crate::elaborate::space) struct Term {
    /// Factors, and whether they divide.
    pub factors: Vec<(ExprId, bool)>,
    /// Expressions with marks.
    pub rest: ExprId,
    pub marks: Marks,
    /// Brackets behind a factor that contain it, and its own factor in there.
    pub bracket: Option<(usize, Interval)>,
    /// Sums around it, the innermost last.
    pub sums: Vec<(LoopVar, u32)>,
}

/// Reads expressions in which marks stand for face values.
pub(in crate::elaborate) struct Reading<'r, 'a> {
    exprs: &'r Exprs,
    symbols: &'r Symbols<'a>,
    quantities: &'r FastMap<VarId, Quantity>,
    fluxes: &'r Fluxes,
    /// The variable whose elements beyond [`MARK`] are the marks.
    builtins: VarId,
}

/// Reader of expressions with marks.
pub(in crate::elaborate) fn reading<'r, 'a>(l: &'r Lowering<'_, 'a>) -> Reading<'r, 'a> {
    let builtins = l.hidden.builtins;
    Reading { exprs: l.exprs, symbols: l.symbols, quantities: l.quantities, fluxes: l.fluxes, builtins }
}

impl Reading<'_, '_> {
    /// Declared bounds of an element.
    pub(in crate::elaborate::space) fn declared_range(&self, var: VarId, flavour: Flavour, at: Affine) -> Interval {
        if let Some(face) = self.mark_of(var, at) {
            return self.fluxes.faces.as_ref().and_then(|f| f.get(face)).map_or(Interval::ALL, |f| f.range);
        }
        let Some(q) = self.quantities.get(&var).filter(|_| flavour != Flavour::Derivative) else { return Interval::ALL };
        let one = |list: &[f64]| if at.is_constant() { list.get(at.offset as usize).copied() } else { None };
        let low = one(&q.low).unwrap_or_else(|| q.low.iter().copied().fold(f64::INFINITY, f64::min));
        let high = one(&q.high).unwrap_or_else(|| q.high.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        if low <= high { Interval { low, high } } else { Interval::ALL }
    }

    pub(in crate::elaborate::space) fn mark_of(&self, var: VarId, at: Affine) -> Option<usize> {
        (var == self.builtins && at.offset >= MARK).then(|| (at.offset - MARK) as usize)
    }

    /// Possible values of an expression by declared bounds.
    pub(in crate::elaborate::space) fn interval(&self, e: ExprId) -> Interval {
        interval::values(self.exprs, e, &|var, flavour, at| self.declared_range(var, flavour, at))
    }

    pub(in crate::elaborate::space) fn slope(&self, e: ExprId, mark: usize) -> Interval {
        let Some(by) = self.fluxes.faces.as_ref().and_then(|f| f.get(mark)).map(|f| f.mark) else { return Interval::ALL };
        interval::slopes(self.exprs, e, by, &|var, flavour, at| self.declared_range(var, flavour, at))
    }

    /// The marks in an expression and in all that it consists of.
    pub(in crate::elaborate::space) fn marks(&self, root: ExprId, done: &mut FastMap<ExprId, Marks>) -> Marks {
        let mut stack = vec![(root, false)];
        while let Some((e, entered)) = stack.pop() {
            if done.contains_key(&e) {
                continue;
            }
            if !entered {
                stack.push((e, true));
                stack.extend(self.exprs.operands(e).map(|o| (o, false)));
                continue;
            }
            let own = match self.exprs.node(e) {
                Node::Load { var, at, .. } => self.mark_of(var, at).map_or(Marks::None, Marks::One),
                _ => Marks::None,
            };
            let all = self.exprs.operands(e).map(|o| done.get(&o).copied().unwrap_or(Marks::None));
            let both = all.fold(own, |a, b| match (a, b) {
                (Marks::None, x) | (x, Marks::None) => x,
                (a, b) if a == b => a,
                _ => Marks::Many,
            });
            done.insert(e, both);
        }
        done.get(&root).copied().unwrap_or(Marks::None)
    }

    /// Each mark in an expression.
    pub(in crate::elaborate::space) fn marks_in(&self, e: ExprId) -> Vec<usize> {
        let mark = |e: ExprId| match self.exprs.node(e) {
            Node::Load { var, at, .. } => self.mark_of(var, at),
            _ => None,
        };
        let mut out: Vec<usize> = self.exprs.below([e]).filter_map(mark).collect();
        out.sort_unstable();
        out
    }

    /// Factors of a product that have marks; of a power its base.
    pub(in crate::elaborate::space) fn parts(&self, e: ExprId) -> Vec<ExprId> {
        let mut done = FastMap::default();
        let mut stack = vec![e];
        let mut parts = Vec::new();
        while let Some(e) = stack.pop() {
            if self.marks(e, &mut done) == Marks::None {
                continue;
            }
            match self.exprs.node(e) {
                Node::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => stack.extend([a, b]),
                Node::PowInt(a, n) => stack.extend(std::iter::repeat_n(a, if n == 1 { 1 } else { 2 })),
                Node::Unary(UnaryFn::Neg, a) => stack.push(a),
                _ => parts.push(e),
            }
        }
        parts
    }

    pub(in crate::elaborate::space) fn times(&self, mut term: Term, factor: ExprId, divides: bool) -> Term {
        if let Some((_, own)) = &mut term.bracket {
            let range = self.interval(factor);
            *own = own.times(if divides { range.reciprocal() } else { range });
        }
        term.factors.push((factor, divides));
        term
    }

    /// Possible values of the factors of a term.
    pub(in crate::elaborate::space) fn factor_range(&self, factors: &[(ExprId, bool)]) -> Interval {
        factors.iter().fold(Interval::of(1.0), |product, &(e, divides)| {
            let range = self.interval(e);
            product.times(if divides { range.reciprocal() } else { range })
        })
    }

    /// Returns `true` if a variable may be what carries the others: of any sign, and by its unit a
    /// velocity or a flow.
    pub(in crate::elaborate::space) fn may_be_velocity(&self, node: ExprId) -> bool {
        let Node::Load { var, at, .. } = self.exprs.node(node) else { return false };
        if self.interval(node).is_not_negative() {
            return false;
        }
        if let Some(face) = self.mark_of(var, at).and_then(|m| self.fluxes.faces.as_ref()?.get(m)) {
            return face.odd || face.velocity;
        }
        match self.symbols.of_var.get(&var).map(|&s| &self.symbols[s].kind) {
            Some(SymbolKind::Variable { unit, .. }) => is_odd(unit),
            _ => true,
        }
    }

    /// Nodes without a known sign in a condition, by which it turns.
    pub(in crate::elaborate::space) fn velocities(&self, holds: ExprId) -> FastSet<ExprId> {
        let mut moving = FastSet::default();
        let mut fixed = FastSet::default();
        self.reaches(holds, &mut |s, node| {
            if !s.exprs.is_truth(node) && !s.interval(node).has_sign() {
                if s.symbols.varying(s.exprs, node).is_some() {
                    moving.insert(node)
                } else {
                    fixed.insert(node)
                };
            }
            false
        });
        // A parameter turns a flow only where nothing else does.
        if moving.is_empty() { fixed } else { moving }
    }

    /// The other factors of a term at an end that has a velocity among its factors.
    pub(in crate::elaborate::space) fn beside_velocity(&self, e: ExprId, velocities: &FastSet<ExprId>) -> Option<Vec<ExprId>> {
        let (mut stack, mut others, mut found) = (vec![e], Vec::new(), false);
        while let Some(e) = stack.pop() {
            match self.exprs.node(e) {
                _ if velocities.contains(&e) => found = true,
                Node::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => stack.extend([a, b]),
                Node::Unary(UnaryFn::Neg, a) => stack.push(a),
                _ => others.push(e),
            }
        }
        found.then_some(others)
    }

    /// Returns `true` if `what` holds for any node of an expression.
    pub(in crate::elaborate::space) fn reaches(&self, e: ExprId, what: &mut dyn FnMut(&Self, ExprId) -> bool) -> bool {
        self.exprs.below([e]).any(|e| what(self, e))
    }

    pub(in crate::elaborate::space) fn both_ways(&self, a: &FaceValue, b: &FaceValue, span: Span) -> Box<Diagnostic> {
        let (x, y) = (self.symbols[a.symbol].path.clone(), self.symbols[b.symbol].path.clone());
        Box::new(
            Diagnostic::error(codes::WRONG_KIND, format!("does `{y}` flow with `{x}` in this flux, or against it?"), span)
                .label(format!("one factor carries `{x}` and, with the other sign, `{y}`"))
                .help("carried together: `v*upwind(v, a[z] - b[z])`; against each other: `v*upwind(v, a[z]) - v*upwind(-v, b[z])`"),
        )
    }

    pub(in crate::elaborate::space) fn no_velocity(&self, fields: &[usize], faces: &[FaceValue], span: Span) -> Box<Diagnostic> {
        let mut names: Vec<String> = fields.iter().map(|&m| format!("`{}`", self.symbols[faces[m].symbol].path)).collect();
        names.dedup();
        let (names, what) = (names.join(", "), faces.first().map_or("c", |f| self.symbols[f.symbol].path.as_str()));
        Box::new(
            Diagnostic::error(codes::WRONG_KIND, format!("the direction of this flux is not clear: which of {names} is a velocity?"), span)
                .label("from which of both cells they come depends on it")
                .help(format!("name it: `v[z]*upwind(v[z], {what}[z])`, or give what cannot be negative a bound, `in 0..inf`")),
        )
    }
}

/// Returns `true` if the unit has an odd power of the time, as those of velocities and flows.
pub(in crate::elaborate::space) fn is_odd(unit: &Unit) -> bool {
    unit.dimension().exponents()[TIME].numerator() % 2 != 0
}
