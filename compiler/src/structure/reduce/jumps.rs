//! Jumps of constraints: tables of steps, rounding, and comparisons whose branches do not meet.
//!
//! At a jump all states of a constraint would have to move along the impulse of its unknowns; the
//! reduced system moves only the state that follows. A constraint with a jump is refused.
//!
//! Each switch is tested with numbers: one unknown, or time, is moved to the threshold, and the
//! constraint is evaluated with both forms of the switch. Other unknowns have several values;
//! parameters have their defaults. A jump is reported if both forms differ for all of these values.

use crate::interpret::eval_at;
use crate::ir::{Compare, Expr, ExprId, Exprs, FastSet, Flavour, MAX_DEPTH, Rewritten, Role, UnaryFn, VarId};
use crate::model::{Model, Quantity};

/// Relative difference between the forms of a switch that is a jump.
const DIFFERS: f64 = 1e-6;

/// Sets of values that are tried.
const POINTS: u32 = 4;

/// Points of a table at which its forms are compared at most.
const LIMITS: usize = 64;

/// Steps of the search for a threshold.
const STEPS: usize = 40;

/// A place at which a constraint has two values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jump {
    /// The element that is at a threshold; `None` for time.
    pub(super) of: Option<(VarId, i64)>,
    /// The threshold, one of several.
    pub(super) at: f64,
}

/// Two forms of a switch, and its distance from the threshold.
struct Forms {
    switch: ExprId,
    forms: [ExprId; 2],
    distance: ExprId,
    /// A subexpression and its value at the threshold.
    quantity: (ExprId, ExprId),
}

/// Finds a jump of an expression over loops.
pub(super) fn find(model: &Model, residual: ExprId) -> Option<Jump> {
    if !model.exprs.below([residual]).any(|e| is_switch(&model.exprs, e)) {
        return None;
    }
    let exprs = model.exprs.clone();
    let mut search = JumpSearch { model, exprs };
    // The sum of a loop jumps if its terms do.
    let reductions: Vec<ExprId> = search.exprs.below([residual]).filter(|&e| matches!(search.exprs.node(e), Expr::Reduce { .. })).collect();
    let bodies = reductions.iter().filter_map(|&e| if let Expr::Reduce { body, .. } = search.exprs.node(e) { Some(body) } else { None });
    let roots: Vec<ExprId> = std::iter::once(residual).chain(bodies).collect();
    roots.into_iter().find_map(|root| search.jump_below(root))
}

fn is_switch(exprs: &Exprs, e: ExprId) -> bool {
    match exprs.node(e) {
        Expr::Compare(Compare::Lt | Compare::Le, ..) | Expr::Passed(..) => true,
        Expr::Unary(f, _) => matches!(f, UnaryFn::Sign | UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round),
        _ => false,
    }
}

struct JumpSearch<'m> {
    model: &'m Model,
    exprs: Exprs,
}

impl JumpSearch<'_> {
    /// A jump at a switch that reads no counter of a loop inside of the expression.
    fn jump_below(&mut self, root: ExprId) -> Option<Jump> {
        let below: Vec<ExprId> = self.exprs.below([root]).collect();
        let mut inner = 0_u8;
        for &e in &below {
            if let Expr::Reduce { depth, .. } = self.exprs.node(e) {
                inner |= 1 << depth.0;
            }
        }
        let switches = below.iter().copied().filter(|&e| is_switch(&self.exprs, e) && self.exprs.free(e) & inner == 0);
        let switches: Vec<ExprId> = switches.collect();
        switches.into_iter().find_map(|switch| {
            let leaf = self.leaf(switch)?;
            if !self.is_known(&below, switch) {
                return None;
            }
            (0..).map_while(|k| self.forms(switch, k)).collect::<Vec<_>>().into_iter().find_map(|forms| self.jump_at(root, &forms, leaf))
        })
    }

    /// The quantity that moves a switch: time, or an element of an unknown.
    fn leaf(&self, switch: ExprId) -> Option<Option<(VarId, i64)>> {
        if self.exprs.below([switch]).any(|e| self.exprs.node(e) == Expr::Time) {
            return Some(None);
        }
        let is_unknown = |var, flavour| flavour == Flavour::Value && matches!(self.model.vars[var].role, Role::State | Role::Algebraic);
        let (var, _, at) = self.exprs.loads(switch, is_unknown).first().copied()?;
        Some(Some((var, at.at(&[0; MAX_DEPTH]))))
    }

    /// Returns `true` if the values of the parameters are known that a comparison and its branches
    /// read.
    fn is_known(&self, below: &[ExprId], switch: ExprId) -> bool {
        let chooses = |e: &&ExprId| match self.exprs.node(**e) {
            Expr::Select(condition, ..) => self.exprs.below([condition]).any(|e| e == switch),
            _ => false,
        };
        let read: FastSet<ExprId> = below.iter().filter(chooses).copied().chain([switch]).collect();
        let is_parameter = |var: VarId, flavour| flavour == Flavour::Value && self.model.vars[var].role == Role::Param;
        let mut loads = read.into_iter().flat_map(|e| self.exprs.loads(e, is_parameter));
        loads.all(|(var, _, at)| self.default_of(var, at.at(&[0; MAX_DEPTH])).is_some())
    }

    /// The forms of a switch at its k-th threshold.
    fn forms(&mut self, switch: ExprId, k: usize) -> Option<Forms> {
        let x = &mut self.exprs;
        let form = |x: &mut Exprs, a: ExprId, limit: f64, values: [f64; 2]| {
            let limit = x.constant(limit);
            Forms { switch, forms: values.map(|value| x.constant(value)), distance: x.sub(a, limit), quantity: (a, limit) }
        };
        match x.node(switch) {
            Expr::Passed(limits, _, a) => {
                let limit = *x.lists().of(limits).get(k).filter(|_| k < LIMITS)?;
                Some(form(x, a, limit, [k as f64, k as f64 + 1.0]))
            }
            _ if k > 0 => None,
            Expr::Compare(_, a, b) => {
                let forms = [x.truth(true), x.truth(false)];
                let quantity = if x.as_const(a).is_some() { (b, a) } else { (a, b) };
                Some(Forms { switch, forms, distance: x.sub(b, a), quantity })
            }
            Expr::Unary(UnaryFn::Sign, a) => Some(form(x, a, 0.0, [-1.0, 1.0])),
            Expr::Unary(UnaryFn::Floor, a) => Some(form(x, a, 1.0, [0.0, 1.0])),
            Expr::Unary(UnaryFn::Ceil, a) => Some(form(x, a, 1.0, [1.0, 2.0])),
            Expr::Unary(UnaryFn::Round, a) => Some(form(x, a, 0.5, [0.0, 1.0])),
            _ => None,
        }
    }

    /// The jump of an expression at a threshold, if its values differ at all points.
    fn jump_at(&mut self, root: ExprId, forms: &Forms, leaf: Option<(VarId, i64)>) -> Option<Jump> {
        let (quantity, limit) = forms.quantity;
        let sides = forms.forms.map(|form| {
            let mut done = Rewritten::from_iter([(forms.switch, form), (quantity, limit)]);
            self.exprs.rewrite(root, &mut done, &mut |_, _| None)
        });
        let mut threshold = None;
        for point in 0..POINTS {
            let at = self.threshold(forms.distance, leaf, point)?;
            let [a, b] = sides.map(|side| self.value(side, leaf, at, point));
            let (a, b) = (a.filter(|x| x.is_finite())?, b.filter(|x| x.is_finite())?);
            if (a - b).abs() <= DIFFERS * a.abs().max(b.abs()) {
                return None;
            }
            threshold = threshold.or(Some(at));
        }
        threshold.map(|at| Jump { of: leaf, at })
    }

    /// The value of a quantity at which an expression is zero, by the secant method.
    fn threshold(&mut self, distance: ExprId, leaf: Option<(VarId, i64)>, point: u32) -> Option<f64> {
        let start = leaf.map_or(0.5, |(var, element)| self.sample(var, Flavour::Value, element, point));
        let (mut before, mut x) = (start, start + 0.125 * start.abs().max(0.5));
        let mut was = self.value(distance, leaf, before, point)?;
        for _ in 0..STEPS {
            let is = self.value(distance, leaf, x, point)?;
            let next = if is == 0.0 { x } else { x - is * (x - before) / (is - was) };
            if !next.is_finite() {
                return None;
            }
            (before, was) = (x, is);
            if (next - x).abs() <= 1e-14 * next.abs() {
                return Some(next);
            }
            x = next;
        }
        None
    }

    /// The value of an expression in the first pass of its loops, with one quantity moved.
    fn value(&mut self, e: ExprId, leaf: Option<(VarId, i64)>, at: f64, point: u32) -> Option<f64> {
        let time = self.exprs.constant(if leaf.is_none() { at } else { 0.37 * f64::from(point + 1) });
        let e = self.exprs.rewrite(e, &mut Rewritten::default(), &mut |_, node| (node == Expr::Time).then_some(time));
        let value_of = |var: VarId, flavour: Flavour, element: i64| {
            let is_leaf = flavour == Flavour::Value && leaf == Some((var, element));
            Some(if is_leaf { at } else { self.sample(var, flavour, element, point) })
        };
        eval_at(&self.exprs, e, &mut [0; MAX_DEPTH], &value_of)
    }

    /// The default of a parameter, otherwise a number about the default or the scale of a variable.
    fn sample(&self, var: VarId, flavour: Flavour, element: i64, point: u32) -> f64 {
        let default = self.default_of(var, element).filter(|_| flavour == Flavour::Value);
        if let Some(value) = default.filter(|_| self.model.vars[var].role == Role::Param) {
            return value;
        }
        let part = crate::switches::somewhere(point, var, flavour, element);
        match default.filter(|x| *x != 0.0) {
            Some(x) => x * part,
            None => part * super::system::scale(self.model, var, crate::ir::Affine::constant(element)),
        }
    }

    fn default_of(&self, var: VarId, element: i64) -> Option<f64> {
        let q = &self.model.interface.quantities;
        let mut all = q.parameters.iter().chain(&q.states).chain(&q.algebraics);
        let quantity = all.find(|q| q.var == Some(var))?;
        Some(Quantity::pick(&quantity.default, element.max(0) as usize)).filter(|x| x.is_finite())
    }
}
