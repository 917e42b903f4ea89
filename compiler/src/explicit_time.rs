//! Explicit time in the equations, which the integrator has to know in advance, since no error test
//! sees it.
//!
//! * *Breaks*: times at which an equation changes its form, a knot of a table over time, `t > a`,
//!   `floor(t/a)`. Every expression of time and a step's inputs alone that is linear between breaks
//!   has its slope computed here. The next break is then one division away: `t - v/slope` for the
//!   value `v` whose sign changes there. What is nested (a table at `mod(t, a)`) needs nothing
//!   more: between breaks the inner function is linear too.
//! * *Forcings*: everything else that time moves, `sin(w*t)` or `exp(-k*t)`: the smallest
//!   expressions that hold it whole. The integrator looks at them all over the interval before it
//!   chooses its steps.

use std::collections::BTreeSet;

use crate::differentiate::Rows;
use crate::ir::{
    BinaryFn, Compare, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, List, LoopVar, MAX_DEPTH, ReduceFn, Role, Side, UnaryFn, before,
    behind,
};
use crate::model::Model;

/// Passes of the loops around, by counter; 0 without a loop.
type Extents = [u32; MAX_DEPTH];

/// An expression over loops, by counter and number of iterations, outermost first.
pub(crate) type Looped = (Vec<(u8, u32)>, ExprId);

/// Queries of the integrator.
pub(crate) struct ExplicitTime {
    /// The next break from the present time on, infinite if none. `None` where there are no breaks
    /// at all.
    pub next_break: Option<ExprId>,
    /// The next time of each break apart.
    pub breaks: Vec<Looped>,
    /// All forcings.
    pub forcings: Vec<Looped>,
    /// Time occurs in the equations themselves.
    pub in_equations: bool,
    /// Expressions of time alone that are linear between breaks.
    linear: FastSet<ExprId>,
}

impl ExplicitTime {
    /// Returns `true` if the changes of form of a node of time alone are breaks.
    pub(crate) fn is_break(&self, exprs: &Exprs, e: ExprId) -> bool {
        exprs.operands(e).all(|o| self.linear.contains(&o) || !exprs.below([o]).any(|e| exprs.node(e) == Expr::Time))
    }

    /// Number of values of all forcings.
    #[must_use]
    pub(crate) fn forcing_count(&self) -> u32 {
        count(&self.forcings)
    }

    /// Number of breaks.
    #[must_use]
    pub(crate) fn break_count(&self) -> u32 {
        count(&self.breaks)
    }
}

/// Number of values of expressions over loops.
fn count(all: &[Looped]) -> u32 {
    let passes = |(loops, _): &Looped| loops.iter().fold(1_u32, |n, &(_, extent)| n.saturating_mul(extent));
    all.iter().map(passes).fold(0, u32::saturating_add)
}

/// Collects the breaks and forcings of equations, integrands and root functions.
pub(crate) fn collect(model: &mut Model, rows: &[Rows]) -> ExplicitTime {
    let mut roots: Vec<(ExprId, Extents)> = Vec::with_capacity(rows.len());
    for row in rows {
        let mut extents = [0; MAX_DEPTH];
        extents.iter_mut().zip(&row.extents).for_each(|(to, &extent)| *to = extent);
        roots.push((row.value, extents));
    }
    let others = model.quadratures.iter().copied().chain(model.roots.iter().map(|r| r.value));
    roots.extend(others.map(|value| (value, [0; MAX_DEPTH])));
    roots.extend(model.past());
    let mut collector = Collector::new(model);
    let in_equations = !collector.model.delays.is_empty() || rows.iter().any(|row| collector.moves[row.value].time);
    if roots.iter().any(|&(root, _)| collector.moves[root].time) {
        collector.walk(&roots);
        for (root, extents) in roots {
            collector.force(root, extents);
        }
    }
    ExplicitTime { in_equations, ..collector.finish() }
}

/// Variables that move an expression within a step.
#[derive(Clone, Copy, Default)]
struct Moves {
    time: bool,
    unknowns: bool,
}

struct Collector<'a> {
    model: &'a mut Model,
    moves: cranelift_entity::SecondaryMap<ExprId, Moves>,
    /// Slopes of expressions of time alone that are linear between breaks; `None` for the others.
    slopes: FastMap<ExprId, Option<ExprId>>,
    /// The next zero of each value that changes the form of something, with the loops around.
    breaks: Vec<(ExprId, Extents)>,
    forcings: Vec<(ExprId, Extents)>,
    forced: FastSet<(ExprId, Extents)>,
}

impl<'a> Collector<'a> {
    fn new(model: &'a mut Model) -> Self {
        let mut moves = cranelift_entity::SecondaryMap::<ExprId, Moves>::new();
        for id in (0..model.exprs.len()).map(cranelift_entity::EntityRef::new) {
            moves[id] = match model.exprs.node(id) {
                Expr::Time => Moves { time: true, unknowns: false },
                Expr::Load { var, flavour: Flavour::Value | Flavour::Derivative, .. } => {
                    let role = model.vars[var].role;
                    let inputs =
                        [Role::Param, Role::Action, Role::Discrete, Role::Disturbance, Role::Draw, Role::Builtin, Role::ParamGiven];
                    Moves { time: false, unknowns: !inputs.contains(&role) }
                }
                // Delayed values are smooth between the breaks that the runtime knows, and its
                // steps have followed them.
                _ if model.is_delayed(id) => Moves { time: false, unknowns: true },
                _ => model.exprs.operands(id).fold(Moves::default(), |sum, o| Moves {
                    time: sum.time || moves[o].time,
                    unknowns: sum.unknowns || moves[o].unknowns,
                }),
            };
        }
        Collector { model, moves, slopes: FastMap::default(), breaks: vec![], forcings: vec![], forced: FastSet::default() }
    }

    fn exprs(&mut self) -> &mut Exprs {
        &mut self.model.exprs
    }

    /// An expression of time and a step's inputs alone.
    fn is_pure(&self, e: ExprId) -> bool {
        self.moves[e].time && !self.moves[e].unknowns
    }

    /// Slopes and breaks of everything below, operands before what uses them.
    fn walk(&mut self, roots: &[(ExprId, Extents)]) {
        let mut found: BTreeSet<(ExprId, Extents)> = BTreeSet::new();
        let mut todo = roots.to_vec();
        while let Some((e, around)) = todo.pop() {
            if !self.moves[e].time || !found.insert((e, self.bound(e, around))) {
                continue;
            }
            let mut around = around;
            if let Expr::Reduce { depth, extent, .. } = self.model.exprs.node(e) {
                around[depth.0 as usize] = extent;
            }
            todo.extend(self.model.exprs.operands(e).map(|o| (o, around)));
        }
        for (e, around) in found {
            if self.is_pure(e) {
                let slope = match self.slopes.get(&e) {
                    Some(&known) => known,
                    None => self.find_slope(e),
                };
                self.slopes.insert(e, slope);
                if slope.is_some() {
                    self.find_break(e, around);
                }
            }
        }
    }

    /// The loops whose counters an expression depends on.
    fn bound(&self, e: ExprId, around: Extents) -> Extents {
        let free = self.model.exprs.free(e);
        std::array::from_fn(|d| if free & (1 << d) == 0 { 0 } else { around[d] })
    }

    /// The slope of an operand: zero where time does not occur.
    fn slope(&mut self, e: ExprId) -> Option<ExprId> {
        if self.moves[e].time { self.slopes.get(&e).copied().flatten() } else { Some(self.exprs().constant(0.0)) }
    }

    /// Returns `true` if a slope is zero whatever the inputs.
    fn is_flat(&self, slope: ExprId) -> bool {
        self.model.exprs.as_const(slope) == Some(0.0)
    }

    /// Slope of a pure expression whose operands have theirs.
    fn find_slope(&mut self, e: ExprId) -> Option<ExprId> {
        let zero = self.exprs().constant(0.0);
        match self.model.exprs.node(e) {
            Expr::Time => Some(self.exprs().constant(1.0)),
            Expr::Unary(f, a) => {
                let slope = self.slope(a)?;
                match f {
                    UnaryFn::Neg => Some(self.exprs().neg(slope)),
                    UnaryFn::Abs => {
                        let (negative, down) = (self.exprs().compare(Compare::Lt, a, zero), self.exprs().neg(slope));
                        Some(self.exprs().select(negative, down, slope))
                    }
                    UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round | UnaryFn::Sign => Some(zero),
                    _ => self.is_flat(slope).then_some(zero),
                }
            }
            Expr::Binary(f, a, b) => self.slope_of_binary(f, a, b),
            Expr::PowInt(a, _) => self.slope(a).filter(|&slope| self.is_flat(slope)),
            Expr::Select(c, a, b) => {
                self.slope(c)?;
                let (first, second) = (self.slope(a)?, self.slope(b)?);
                Some(self.exprs().select(c, first, second))
            }
            // Truth values are constant between breaks.
            Expr::Compare(_, a, b) | Expr::And(a, b) | Expr::Or(a, b) => self.slope(a).and(self.slope(b)).map(|_| zero),
            Expr::Not(a) | Expr::Passed(_, _, a) => self.slope(a).map(|_| zero),
            Expr::Entry(_, a) => self.slope(a).filter(|&slope| self.is_flat(slope)),
            Expr::Reduce { op, depth, extent, body } => {
                let slope = self.slope(body)?;
                match op {
                    ReduceFn::Sum => Some(self.exprs().reduce(op, depth, extent, slope)),
                    _ => self.is_flat(slope).then_some(zero),
                }
            }
            _ => None,
        }
    }

    fn slope_of_binary(&mut self, f: BinaryFn, a: ExprId, b: ExprId) -> Option<ExprId> {
        let (first, second) = (self.slope(a)?, self.slope(b)?);
        let flat = (self.is_flat(first), self.is_flat(second));
        let exprs = self.exprs();
        match (f, flat) {
            (BinaryFn::Add, _) => Some(exprs.add(first, second)),
            (BinaryFn::Sub, _) => Some(exprs.sub(first, second)),
            (_, (true, true)) => Some(first),
            (BinaryFn::Mul, (true, _)) => Some(exprs.mul(a, second)),
            (BinaryFn::Mul, (_, true)) => Some(exprs.mul(first, b)),
            (BinaryFn::Div, (_, true)) => Some(exprs.div(first, b)),
            (BinaryFn::Min, _) => {
                let below = exprs.compare(Compare::Lt, a, b);
                Some(exprs.select(below, first, second))
            }
            (BinaryFn::Max, _) => {
                let below = exprs.compare(Compare::Lt, a, b);
                Some(exprs.select(below, second, first))
            }
            _ => None,
        }
    }

    /// Points at which a pure expression itself changes its form.
    fn find_break(&mut self, e: ExprId, around: Extents) {
        let (value, slope) = match self.model.exprs.node(e) {
            Expr::Compare(Compare::Lt | Compare::Le, a, b) | Expr::Binary(BinaryFn::Min | BinaryFn::Max, a, b) => {
                let (Some(first), Some(second)) = (self.slope(a), self.slope(b)) else { return };
                let exprs = self.exprs();
                (exprs.sub(a, b), exprs.sub(first, second))
            }
            Expr::Passed(limits, _, a) => {
                let Some(slope) = self.slope(a) else { return };
                (self.left_to_limit(limits, a, slope), slope)
            }
            Expr::Unary(UnaryFn::Abs | UnaryFn::Sign, a) => {
                let Some(slope) = self.slope(a) else { return };
                (a, slope)
            }
            Expr::Unary(f @ (UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round), a) => {
                let Some(slope) = self.slope(a) else { return };
                (self.left_to_whole(f, a, slope), slope)
            }
            _ => return,
        };
        if !self.is_flat(slope) {
            let next = self.next_zero(value, slope);
            self.breaks.push((next, around));
        }
    }

    /// Distance to the next jump of `floor(a)` and the like: negative for rising, positive for
    /// falling values.
    fn left_to_whole(&mut self, f: UnaryFn, a: ExprId, slope: ExprId) -> ExprId {
        let exprs = self.exprs();
        let (zero, half, one) = (exprs.constant(0.0), exprs.constant(0.5), exprs.constant(1.0));
        let a = if f == UnaryFn::Round { exprs.add(a, half) } else { a };
        let (below, above) = if f == UnaryFn::Ceil {
            let above = exprs.unary(UnaryFn::Ceil, a);
            (exprs.sub(above, one), above)
        } else {
            let below = exprs.unary(UnaryFn::Floor, a);
            (below, exprs.add(below, one))
        };
        let rises = exprs.compare(Compare::Lt, zero, slope);
        let target = exprs.select(rises, above, below);
        exprs.sub(a, target)
    }

    /// Distance to the next limit: negative for rising, positive for falling values.
    fn left_to_limit(&mut self, limits: List, a: ExprId, slope: ExprId) -> ExprId {
        let exprs = self.exprs();
        let (zero, below, up_to) = (exprs.constant(0.0), exprs.passed(limits, Side::Below, a), exprs.passed(limits, Side::UpTo, a));
        let (above, under) = (exprs.entry(behind(limits), below), exprs.entry(before(limits), up_to));
        let rises = exprs.compare(Compare::Lt, zero, slope);
        let target = exprs.select(rises, above, under);
        exprs.sub(a, target)
    }

    /// The time at which a value with a slope becomes zero, infinite if that has been.
    fn next_zero(&mut self, value: ExprId, slope: ExprId) -> ExprId {
        let exprs = self.exprs();
        let (zero, never, t) = (exprs.constant(0.0), exprs.constant(f64::INFINITY), exprs.time());
        let (rises, falls) = (exprs.compare(Compare::Lt, zero, slope), exprs.compare(Compare::Lt, slope, zero));
        let (low, high) = (exprs.compare(Compare::Le, value, zero), exprs.compare(Compare::Le, zero, value));
        let (up, down) = (exprs.and(rises, low), exprs.and(falls, high));
        let comes = exprs.or(up, down);
        let wait = exprs.div(value, slope);
        let at = exprs.sub(t, wait);
        exprs.select(comes, at, never)
    }

    /// Notes what time moves in an expression other than along straight lines.
    fn force(&mut self, root: ExprId, around: Extents) {
        let mut todo = vec![(root, around)];
        let mut seen = FastSet::default();
        while let Some((e, around)) = todo.pop() {
            let new = self.moves[e].time && seen.insert((e, self.bound(e, around)));
            if !new || self.slopes.get(&e).is_some_and(Option::is_some) {
                continue;
            }
            let time = |e: ExprId| self.moves[e].time;
            match self.model.exprs.node(e) {
                Expr::Unary(UnaryFn::Neg, a) => todo.push((a, around)),
                Expr::Binary(BinaryFn::Add | BinaryFn::Sub, a, b) => todo.extend([(a, around), (b, around)]),
                Expr::Binary(BinaryFn::Mul, a, b) if !self.is_pure(e) || time(a) != time(b) => todo.extend([(a, around), (b, around)]),
                Expr::Binary(BinaryFn::Div, a, b) if !time(b) => todo.push((a, around)),
                Expr::Binary(BinaryFn::Div, a, b) if !self.is_pure(e) => {
                    let one = self.exprs().constant(1.0);
                    let inverse = self.exprs().div(one, b);
                    self.add_forcing(inverse, around);
                    todo.push((a, around));
                }
                Expr::Select(_, a, b) if !self.is_pure(e) => {
                    // The switch is located where it happens.
                    todo.extend([(a, around), (b, around)]);
                }
                Expr::Reduce { op: ReduceFn::Sum, depth, extent, body } => {
                    let mut around = around;
                    around[depth.0 as usize] = extent;
                    todo.push((body, around));
                }
                _ => self.add_forcing(e, around),
            }
        }
    }

    fn add_forcing(&mut self, e: ExprId, around: Extents) {
        let value = self.exprs().number(e);
        let loops = self.bound(value, around);
        if self.forced.insert((value, loops)) {
            self.forcings.push((value, loops));
        }
    }

    fn finish(mut self) -> ExplicitTime {
        let looped = |&(value, around): &(ExprId, Extents)| ((0..).zip(around).filter(|&(_, extent)| extent > 0).collect(), value);
        let (breaks, forcings) = (self.breaks.iter().map(looped).collect(), self.forcings.iter().map(looped).collect());
        let next_break = self.next_break();
        let linear = self.slopes.iter().filter(|(_, slope)| slope.is_some()).map(|(&e, _)| e).collect();
        ExplicitTime { next_break, breaks, forcings, in_equations: false, linear }
    }

    /// The least of all next breaks.
    fn next_break(&mut self) -> Option<ExprId> {
        let mut next = None;
        for (mut value, around) in std::mem::take(&mut self.breaks) {
            for (d, extent) in (0..).zip(around).filter(|&(_, extent)| extent > 0).collect::<Vec<_>>().into_iter().rev() {
                value = self.exprs().reduce(ReduceFn::Min, LoopVar(d), extent, value);
            }
            next = Some(match next {
                Some(so_far) => self.exprs().binary(BinaryFn::Min, so_far, value),
                None => value,
            });
        }
        next
    }
}
