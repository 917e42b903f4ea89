//! Jumps of constraints: tables of steps, rounding, and comparisons whose branches do not meet.
//!
//! At a jump all states of a constraint would have to move along the impulse of its unknowns; the
//! reduced system moves only the state that follows. A constraint with a jump is refused.
//!
//! Each switch is tested with numbers: one unknown, or time, is moved to the threshold, and the
//! constraint is evaluated with both forms of the switch. Other unknowns have several values;
//! parameters have their defaults. A jump is reported if both forms differ for all of these values.
//! With other values of parameters, or with other switches in other forms, a difference at one
//! point is a doubt: [`watch`] finds out in a run.

use super::start::Start;
use crate::interpret::eval_at;
use crate::ir::{Compare, Expr, ExprId, Exprs, FastSet, Flavour, MAX_DEPTH, Rewritten, Role, UnaryFn, VarId};
use crate::model::{Model, Quantity};

pub(super) mod watch;

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
    /// It depends on values of parameters, which may change.
    pub(super) depends: bool,
}

/// A switch whose forms differ for some values: a run finds out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt {
    /// The values of both forms at the threshold.
    pub(super) sides: [ExprId; 2],
    /// Distance from the threshold.
    pub(super) distance: ExprId,
    /// The element that moves the switch; `None` for time.
    pub(super) of: Option<(VarId, i64)>,
}

/// Two forms of a switch, and its distance from the threshold.
struct Forms {
    switch: ExprId,
    forms: [ExprId; 2],
    distance: ExprId,
    /// A subexpression and its value at the threshold.
    quantity: (ExprId, ExprId),
}

impl Doubt {
    /// The refusal of a switch that no run can watch.
    pub(super) fn refused(self) -> Jump {
        Jump { of: self.of, at: f64::NAN, depends: true }
    }
}

/// Finds the switches of an expression over loops at which it may jump.
///
/// # Errors
/// A switch at which it jumps, or may jump at a place that no run can watch.
pub(super) fn examine(model: &mut Model, value: ExprId) -> Result<Vec<Doubt>, Jump> {
    if !model.exprs.below([value]).any(|e| is_switch(&model.exprs, e)) {
        return Ok(Vec::new());
    }
    let nominal = vec![Start::of_parameters(model, &|_, _| 1.0)];
    let mut search = JumpSearch { model, exprs: model.exprs.clone(), parameters: nominal };
    let switches = search.switches(value);
    let certain = switches.iter().find_map(|(root, forms, leaf)| search.jump_at(*root, forms, *leaf));
    if let Some(jump) = certain {
        return Err(jump);
    }
    let other = |point| Start::of_parameters(model, &move |var, at| crate::switches::somewhere(point, var, Flavour::Value, at));
    search.parameters = (0..POINTS).map(other).collect();
    let mut doubts = Vec::new();
    for (root, forms, leaf) in &switches {
        match (search.differs_at(*root, forms, *leaf), search.doubt(*root, forms, *leaf)) {
            (Some(jump), doubt) => doubts.push(doubt.ok_or(jump)?),
            // A factor that is zero at all of these points may hide a jump.
            (None, Some(doubt)) if crate::switches::forms_differ(&search.exprs, doubt.sides[0], doubt.sides[1]) => doubts.push(doubt),
            (None, _) => {}
        }
    }
    let exprs = search.exprs;
    if !doubts.is_empty() {
        model.exprs = exprs;
    }
    Ok(doubts)
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
    /// Values of parameters at each point; the last ones beyond.
    parameters: Vec<Start>,
}

/// An expression, the forms of a switch in it, and the element that moves the switch.
type Switching = (ExprId, Forms, Option<(VarId, i64)>);

impl JumpSearch<'_> {
    /// The switches of an expression, and of the terms of its sums, that read no counter of a loop
    /// inside: a sum jumps if its terms do.
    fn switches(&mut self, value: ExprId) -> Vec<Switching> {
        let reductions: Vec<ExprId> = self.exprs.below([value]).filter(|&e| matches!(self.exprs.node(e), Expr::Reduce { .. })).collect();
        let bodies = reductions.iter().filter_map(|&e| if let Expr::Reduce { body, .. } = self.exprs.node(e) { Some(body) } else { None });
        let roots: Vec<ExprId> = std::iter::once(value).chain(bodies).collect();
        roots.into_iter().flat_map(|root| self.switches_below(root)).collect()
    }

    fn switches_below(&mut self, root: ExprId) -> Vec<Switching> {
        let below: Vec<ExprId> = self.exprs.below([root]).collect();
        let mut inner = 0_u8;
        for &e in &below {
            if let Expr::Reduce { depth, .. } = self.exprs.node(e) {
                inner |= 1 << depth.0;
            }
        }
        let smooth: Vec<ExprId> =
            below.iter().copied().filter(|&e| matches!(self.exprs.node(e), Expr::Unary(UnaryFn::Smooth, _))).collect();
        let hidden: FastSet<ExprId> = self.exprs.below(smooth).collect();
        let switches: Vec<ExprId> =
            below.into_iter().filter(|e| is_switch(&self.exprs, *e) && self.exprs.free(*e) & inner == 0 && !hidden.contains(e)).collect();
        let mut out = Vec::new();
        for switch in switches {
            let Some(leaf) = self.leaf(switch) else { continue };
            out.extend((0..).map_while(|k| self.forms(switch, k)).map(|forms| (root, forms, leaf)));
        }
        out
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

    /// The values of an expression with both forms of a switch, at the threshold.
    fn sides(&mut self, root: ExprId, forms: &Forms) -> [ExprId; 2] {
        let (quantity, limit) = forms.quantity;
        forms.forms.map(|form| {
            let mut done = Rewritten::from_iter([(forms.switch, form), (quantity, limit)]);
            self.exprs.rewrite(root, &mut done, &mut |_, _| None)
        })
    }

    /// The threshold, and whether both forms differ there, at a point.
    fn compared(&mut self, sides: [ExprId; 2], distance: ExprId, leaf: Option<(VarId, i64)>, point: u32) -> Option<(f64, bool)> {
        let at = self.threshold(distance, leaf, point)?;
        let [a, b] = sides.map(|side| self.value(side, leaf, at, point));
        let (a, b) = (a.filter(|x| x.is_finite())?, b.filter(|x| x.is_finite())?);
        Some((at, (a - b).abs() > DIFFERS * a.abs().max(b.abs())))
    }

    /// The jump of an expression at a threshold, if its values differ at all points.
    fn jump_at(&mut self, root: ExprId, forms: &Forms, leaf: Option<(VarId, i64)>) -> Option<Jump> {
        let sides = self.sides(root, forms);
        let mut first = None;
        for point in 0..POINTS {
            let (at, _) = self.compared(sides, forms.distance, leaf, point).filter(|(_, differs)| *differs)?;
            first = first.or(Some(at));
        }
        first.map(|at| Jump { of: leaf, at, depends: false })
    }

    /// The jump of an expression at a threshold, if its values differ at some point.
    fn differs_at(&mut self, root: ExprId, forms: &Forms, leaf: Option<(VarId, i64)>) -> Option<Jump> {
        let sides = self.sides(root, forms);
        let found = (0..POINTS).filter_map(|point| self.compared(sides, forms.distance, leaf, point)).find(|(_, differs)| *differs);
        found.map(|(at, _)| Jump { of: leaf, at, depends: true })
    }

    /// A switch as a run watches it: not where the values at the threshold move with what moves the
    /// switch.
    fn doubt(&mut self, root: ExprId, forms: &Forms, leaf: Option<(VarId, i64)>) -> Option<Doubt> {
        let sides = self.sides(root, forms);
        let gap = self.exprs.sub(sides[0], sides[1]);
        let moves = self.exprs.below([gap]).any(|e| match (self.exprs.node(e), leaf) {
            (Expr::Time, None) => true,
            (Expr::Load { var, flavour: Flavour::Value, .. }, Some((own, _))) => var == own,
            _ => false,
        });
        (!moves).then_some(Doubt { sides, distance: forms.distance, of: leaf })
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

    /// The value of a parameter, otherwise a number about the default or the scale of a variable.
    fn sample(&self, var: VarId, flavour: Flavour, element: i64, point: u32) -> f64 {
        if self.model.vars[var].role == Role::Param && flavour == Flavour::Value {
            let start = self.parameters.get(point as usize).or(self.parameters.last());
            if let Some(value) = start.and_then(|start| start.element(var, element)) {
                return value;
            }
        }
        let default = self.default_of(var, element).filter(|_| flavour == Flavour::Value);
        let part = crate::switches::somewhere(point, var, flavour, element);
        match default.filter(|x| *x != 0.0) {
            Some(x) => x * part,
            None => part * super::system::scale(self.model, var, crate::ir::Affine::constant(element)),
        }
    }

    fn default_of(&self, var: VarId, element: i64) -> Option<f64> {
        let q = &self.model.interface.quantities;
        let mut all = q.states.iter().chain(&q.algebraics);
        let quantity = all.find(|q| q.var == Some(var))?;
        Some(Quantity::pick(&quantity.default, element.max(0) as usize)).filter(|x| x.is_finite())
    }
}

/// A variable that jumps and that an expression reads.
pub(super) fn jumping(model: &Model, e: ExprId) -> Option<VarId> {
    let jumps = |var: VarId, flavour: Flavour| match model.vars[var].role {
        Role::Action | Role::Discrete | Role::Disturbance | Role::Delayed => flavour == Flavour::Value,
        Role::State | Role::Algebraic => flavour == Flavour::Previous,
        _ => false,
    };
    model.exprs.loads(e, jumps).first().map(|load| load.0)
}
