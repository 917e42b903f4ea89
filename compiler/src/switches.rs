//! Switches of the equations: where comparisons, extrema and rounding make them change their form
//! as unknowns move.
//!
//! A *jump* is a switch at which an equation has two values: a comparison that chooses between
//! different branches, `sign`, `floor`, a table of steps. A *kink* is one at which both forms
//! agree: `abs`, `min`, `max`, a table of straight lines, a comparison whose branches meet. Each is
//! a root function that changes its sign where the form changes. The integrator stops at jumps; at
//! a kink it stops only if a step would otherwise pass a form without meeting it.
//!
//! Switches that depend linearly on time alone are breaks (see
//! [`explicit_time`](crate::explicit_time)). Everything inside of `smooth(...)` is left to the
//! error test.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::enclose::Encloser;
use crate::explicit_time::{ExplicitTime, Looped};
use crate::interpret::eval_otherwise;
use crate::ir::{
    Affine, BinaryFn, Compare, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, List, LoopVar, MAX_DEPTH, Rewritten, Role, Side, UnaryFn,
    VarId,
};
use crate::model::Model;

/// Passes of the loops around, by counter; 0 without a loop.
type Extents = [u32; MAX_DEPTH];

/// Nodes that are evaluated at most to find out whether the forms of a model agree where they meet;
/// switches that are left are jumps.
const EFFORT: usize = 1 << 18;

/// Relative difference of two values that are one.
const ALIKE: f64 = 1e-9;

/// Points at which the forms of other switches are tried.
const FORMS: u32 = 6;

/// Points of a table whose forms are compared at most.
const POINTS: u32 = 64;

/// Switches over a nest of loops.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Switch {
    /// The loops around by counter and number of passes, outermost first, and a root function of
    /// unknowns and time.
    pub root: Looped,
    /// The form at zero is that of negative values.
    pub strict: bool,
    /// Another function with the same signs whose bounds are tighter.
    pub guide: Option<ExprId>,
    /// Both forms agree where they meet.
    pub kink: bool,
    /// Quantity that is compared: switches of one group look at one quantity. Each pass of the
    /// loops has its own group, except for the last `shared` loops.
    pub group: u32,
    /// Number of loops, counted from the last, over the thresholds of one quantity.
    pub shared: usize,
}

/// Collects the switches of equations and integrands.
fn collect(model: &mut Model, time: &ExplicitTime) -> Vec<Switch> {
    let mut rows: Vec<(ExprId, Extents)> = Vec::with_capacity(model.rows.len());
    for row in &model.rows {
        let mut extents = [0; MAX_DEPTH];
        extents.iter_mut().zip(&row.extents).for_each(|(to, &extent)| *to = extent);
        rows.push((row.residual, extents));
    }
    rows.extend(model.quadratures.iter().map(|&value| (value, [0; MAX_DEPTH])));
    rows.extend(model.past());
    let mut collector = Collector { moves: moves(model), found: vec![], known: FastSet::default(), choices: FastMap::default() };
    rows.iter().for_each(|&(row, extents)| collector.walk(&model.exprs, row, extents, time));
    let Collector { found, choices, .. } = collector;
    let rows: Vec<ExprId> = rows.into_iter().map(|(row, _)| row).collect();
    Maker { exprs: &mut model.exprs, rows, choices, left: EFFORT, groups: FastMap::default(), next_group: 0 }.make(found)
}

/// Dependence of a node on time and unknowns.
#[derive(Clone, Copy, Default)]
struct Moves {
    any: bool,
    unknowns: bool,
}

fn moves(model: &Model) -> Vec<Moves> {
    let exprs = &model.exprs;
    let mut moves: Vec<Moves> = Vec::with_capacity(exprs.len());
    for id in exprs.ids() {
        let of = match exprs.node(id) {
            Expr::Time => Moves { any: true, unknowns: false },
            Expr::Load { var, flavour: Flavour::Value | Flavour::Derivative, .. } => {
                let unknown = matches!(model.vars[var].role, Role::State | Role::Algebraic | Role::Delayed);
                Moves { any: unknown, unknowns: unknown }
            }
            _ => exprs
                .operands(id)
                .map(|o| moves[o.as_u32() as usize])
                .fold(Moves::default(), |sum, of| Moves { any: sum.any || of.any, unknowns: sum.unknowns || of.unknowns }),
        };
        moves.push(of);
    }
    moves
}

/// Looks for nodes at which something changes its form.
struct Collector {
    moves: Vec<Moves>,
    found: Vec<(ExprId, Extents)>,
    known: FastSet<(ExprId, Extents)>,
    /// The two branches that a comparison chooses from; nothing for one that is used otherwise.
    choices: FastMap<ExprId, Option<Vec<(ExprId, ExprId)>>>,
}

impl Collector {
    fn moves(&self, e: ExprId) -> Moves {
        self.moves[e.as_u32() as usize]
    }

    fn walk(&mut self, exprs: &Exprs, root: ExprId, extents: Extents, time: &ExplicitTime) {
        let mut stack = vec![(root, extents, None)];
        let mut seen = FastSet::default();
        while let Some((e, extents, choice)) = stack.pop() {
            if !self.moves(e).any {
                continue;
            }
            if self.changes_form(exprs, e, time) {
                let free = exprs.free(e);
                let loops = std::array::from_fn(|d| if free & (1 << d) == 0 { 0 } else { extents[d] });
                if self.known.insert((e, loops)) {
                    self.found.push((e, loops));
                }
                let choices = self.choices.entry(e).or_insert_with(|| Some(vec![]));
                match (choices.as_mut(), choice) {
                    (Some(all), Some(choice)) => all.push(choice),
                    _ => *choices = None,
                }
            }
            if !seen.insert((e, extents)) {
                continue;
            }
            let mut inner = extents;
            match exprs.node(e) {
                Expr::Unary(UnaryFn::Smooth, _) => continue,
                Expr::Select(c, a, b) => {
                    stack.extend([(c, extents, Some((a, b))), (a, extents, None), (b, extents, None)]);
                    continue;
                }
                Expr::Reduce { depth, extent, .. } => inner[depth.0 as usize] = extent,
                _ => {}
            }
            stack.extend(exprs.operands(e).map(|o| (o, inner, None)));
        }
    }

    fn changes_form(&self, exprs: &Exprs, e: ExprId, time: &ExplicitTime) -> bool {
        let switches = match exprs.node(e) {
            Expr::Compare(Compare::Lt | Compare::Le, ..) | Expr::Binary(BinaryFn::Min | BinaryFn::Max, ..) | Expr::Passed(..) => true,
            Expr::Unary(f, _) => {
                matches!(f, UnaryFn::Sign | UnaryFn::Abs | UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round)
            }
            _ => false,
        };
        switches && (self.moves(e).unknowns || !time.is_break(exprs, e))
    }
}

/// Makes root functions of what was found.
struct Maker<'a> {
    exprs: &'a mut Exprs,
    rows: Vec<ExprId>,
    choices: FastMap<ExprId, Option<Vec<(ExprId, ExprId)>>>,
    /// Nodes that may be evaluated yet.
    left: usize,
    groups: FastMap<(ExprId, Extents), u32>,
    next_group: u32,
}

impl Maker<'_> {
    fn make(mut self, found: Vec<(ExprId, Extents)>) -> Vec<Switch> {
        found.into_iter().filter_map(|(e, extents)| self.switch(e, extents)).collect()
    }

    fn switch(&mut self, e: ExprId, extents: Extents) -> Option<Switch> {
        let mut loops: Vec<(u8, u32)> = (0..).zip(extents).filter(|&(_, extent)| extent > 0).collect();
        let passes = loops.iter().fold(1_u32, |n, &(_, extent)| n.saturating_mul(extent));
        let (mut strict, mut kink, mut shared, mut guide) = (false, false, 0, None);
        let (looked_at, value) = match self.exprs.node(e) {
            Expr::Compare(op, a, b) => {
                strict = op == Compare::Lt;
                let value = self.exprs.sub(b, a);
                let quantity = if self.exprs.as_const(a).is_some() { b } else { a };
                let (truth, falsehood) = (self.exprs.truth(true), self.exprs.truth(false));
                kink = self.meets(e, quantity, if quantity == a { b } else { a }, [truth, falsehood]);
                (quantity, value)
            }
            Expr::Binary(_, a, b) => {
                kink = true;
                let value = self.exprs.sub(b, a);
                (if self.exprs.as_const(a).is_some() { b } else { a }, value)
            }
            Expr::Unary(UnaryFn::Sign, a) => {
                strict = true;
                let [zero, one, minus] = [0.0, 1.0, -1.0].map(|x| self.exprs.constant(x));
                kink = self.meets(e, a, zero, [one, minus]);
                (a, a)
            }
            Expr::Unary(UnaryFn::Abs, a) => {
                kink = true;
                (a, a)
            }
            Expr::Unary(f, a) => {
                let (value, wave) = self.whole(f, a);
                guide = Some(wave);
                (a, value)
            }
            Expr::Passed(limits, side, a) => {
                kink = self.table_meets(e, limits, side, a);
                shared = 1;
                (a, self.passed(limits, a, &mut loops)?)
            }
            _ => return None,
        };
        let next = self.next_group;
        let group = *self.groups.entry((looked_at, extents)).or_insert(next);
        if group == next {
            self.next_group = next.saturating_add(passes);
        }
        Some(Switch { root: (loops, value), guide, strict, kink, group, shared })
    }

    /// Functions that change their sign where `floor(a)` and the like jump: the distance to the
    /// nearest whole number, with the sign of its parity; and a wave.
    fn whole(&mut self, f: UnaryFn, a: ExprId) -> (ExprId, ExprId) {
        let x = &mut *self.exprs;
        let [half, one, two, pi] = [0.5, 1.0, 2.0, PI].map(|number| x.constant(number));
        let a = if f == UnaryFn::Round { x.add(a, half) } else { a };
        let nearest = x.unary(UnaryFn::Round, a);
        let distance = x.sub(a, nearest);
        let halved = x.mul(half, nearest);
        let whole = x.unary(UnaryFn::Floor, halved);
        let even = x.mul(two, whole);
        let odd = x.sub(nearest, even);
        let twice = x.mul(two, odd);
        let sign = x.sub(one, twice);
        let turn = x.mul(pi, a);
        (x.mul(sign, distance), x.unary(UnaryFn::Sin, turn))
    }

    /// The distance from each limit of a list, over a separate loop; `None` without a counter for
    /// it.
    fn passed(&mut self, limits: List, a: ExprId, loops: &mut Vec<(u8, u32)>) -> Option<ExprId> {
        // Counters of reductions below may not be bound again.
        let mut used = self.exprs.free(a);
        self.exprs.each_reduction(a, &mut |depth, _| used |= 1 << depth.0);
        let free = (0..MAX_DEPTH as u8).find(|d| used & (1 << d) == 0)?;
        let counter = self.exprs.counter(LoopVar(free));
        let limit = self.exprs.entry(limits, counter);
        loops.push((free, limits.len));
        Some(self.exprs.sub(a, limit))
    }

    /// Returns whether both forms of a table agree at all of its limits.
    fn table_meets(&mut self, e: ExprId, limits: List, side: Side, a: ExprId) -> bool {
        if limits.len > POINTS {
            return false;
        }
        let at: Vec<f64> = self.exprs.lists().of(limits).to_vec();
        (0..).zip(at).all(|(i, limit)| {
            let (limit, below) = (self.exprs.constant(limit), self.exprs.passed(limits, side, a));
            let forms = [i, i + 1].map(|i: u32| self.exprs.constant(f64::from(i)));
            debug_assert_eq!(below, e);
            self.meets(e, a, limit, forms)
        })
    }

    /// Returns whether the two forms of what contains a switch agree where its quantity is at the
    /// threshold.
    fn meets(&mut self, switch: ExprId, quantity: ExprId, threshold: ExprId, forms: [ExprId; 2]) -> bool {
        // The branches themselves, where nothing else looks at the comparison: they may agree where
        // whole equations are too large to look at.
        let choices = self.choices.get(&switch).cloned().flatten();
        let at = |x: &mut Exprs, e: ExprId, form: ExprId| {
            let mut done = Rewritten::from_iter([(switch, form), (quantity, threshold)]);
            x.rewrite(e, &mut done, &mut |_, _| None)
        };
        if let Some(choices) = choices.filter(|choices| !choices.is_empty()) {
            let agree = choices.iter().all(|&(a, b)| {
                let (a, b) = (at(self.exprs, a, forms[0]), at(self.exprs, b, forms[1]));
                self.agree(a, b)
            });
            if agree {
                return true;
            }
        }
        for i in 0..self.rows.len() {
            let row = self.rows[i];
            if self.left == 0 {
                return false;
            }
            if row < switch || !self.contains(row, switch) {
                continue;
            }
            let (first, second) = (at(self.exprs, row, forms[0]), at(self.exprs, row, forms[1]));
            if !self.agree(first, second) {
                return false;
            }
        }
        true
    }

    fn contains(&mut self, row: ExprId, switch: ExprId) -> bool {
        let mut count = 0;
        let found = self.exprs.below([row]).any(|e| {
            count += 1;
            e == switch
        });
        self.left = self.left.saturating_sub(count);
        found
    }

    /// Returns whether two expressions have the same value. A factor that is zero at a point would
    /// hide a jump: other switches are tried in other forms, too.
    fn agree(&mut self, a: ExprId, b: ExprId) -> bool {
        if a == b {
            return true;
        }
        self.left = self.left.saturating_sub(2 * self.exprs.below([a, b]).count());
        let value = |e, point, free| value_at(self.exprs, e, point, free);
        self.left > 0
            && (1..=2).all(|point| {
                let both = (value(a, point, false), value(b, point, false));
                matches!(both, (Some(a), Some(b)) if alike(a, b))
            })
            && !forms_differ(self.exprs, a, b)
    }
}

/// Returns whether two expressions differ with other switches in some of their forms.
pub(crate) fn forms_differ(exprs: &Exprs, a: ExprId, b: ExprId) -> bool {
    (1..=FORMS).any(|point| match (value_at(exprs, a, point, true), value_at(exprs, b, point, true)) {
        (Some(a), Some(b)) => a.is_finite() && b.is_finite() && !alike(a, b),
        // A form outside of its range.
        _ => false,
    })
}

/// Returns whether two values are one.
fn alike(a: f64, b: f64) -> bool {
    (a - b).abs() <= ALIKE * a.abs().max(b.abs())
}

/// The value of an expression at a point, in the first pass of the loops around; `free`: with
/// switches in one of their forms, rather in one that moves.
fn value_at(exprs: &Exprs, e: ExprId, point: u32, free: bool) -> Option<f64> {
    let value_of = |var: VarId, flavour: Flavour, at: i64| Some(somewhere(point, var, flavour, at));
    let some = |seed: u32| ((seed ^ point.rotate_left(16)).wrapping_mul(0x9e37_79b1) ^ point).wrapping_mul(0x85eb_ca6b) >> 8;
    let second_of = |a: ExprId, b: ExprId| {
        let rank = |e| match exprs.as_const(e) {
            None => 2,
            Some(0.0) => 0,
            Some(_) => 1,
        };
        if rank(a) == rank(b) { some(a.as_u32() ^ b.as_u32().rotate_left(9)) & 1 == 1 } else { rank(b) > rank(a) }
    };
    let other = |node: Expr, [x, y, z]: [f64; 3]| match node {
        Expr::Time => Some(0.37 * f64::from(point)),
        _ if !free => None,
        Expr::Select(c, a, b) if !decided(exprs, c) => Some(if second_of(a, b) { z } else { y }),
        Expr::Binary(BinaryFn::Min | BinaryFn::Max, a, b) => Some(if second_of(a, b) { y } else { x }),
        Expr::Unary(UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round, _) => Some(x + f64::from(some(7)) / f64::from(1 << 24)),
        // An entry of a table where nothing is known of the place: some number.
        Expr::Entry(list, index) if exprs.as_const(index).is_none() => Some(0.5 + f64::from(some(list.first)) / f64::from(1 << 24)),
        _ => None,
    };
    eval_otherwise(exprs, e, &value_of, &other)
}

/// Returns whether a condition compares numbers only, or something with itself.
fn decided(exprs: &Exprs, condition: ExprId) -> bool {
    let mut stack = vec![condition];
    while let Some(e) = stack.pop() {
        match exprs.node(e) {
            Expr::Truth(_) => {}
            Expr::Compare(_, a, b) if a == b => {}
            Expr::Not(_) | Expr::And(..) | Expr::Or(..) => stack.extend(exprs.operands(e)),
            _ => return false,
        }
    }
    true
}

/// A number between 0.5 and 1.5 for a place in memory.
pub(crate) fn somewhere(point: u32, var: VarId, flavour: Flavour, at: i64) -> f64 {
    let mixed = [u64::from(point), u64::from(var.as_u32()), flavour as u64, at as u64]
        .into_iter()
        .fold(0x9e37_79b9_7f4a_7c15_u64, |hash, part| (hash ^ part).wrapping_mul(0x2545_f491_4f6c_dd1d).rotate_left(29));
    0.5 + (mixed >> 11) as f64 / (1_u64 << 53) as f64
}

/// Functions that the integrator watches: the conditions of events, then the switches of the
/// equations.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Watched {
    /// The switches.
    pub switches: Vec<Switch>,
    /// Lower bounds of all root functions over a box of unknowns, then upper ones.
    pub bounds: Vec<Looped>,
    /// Kind of each root function.
    pub kinds: Vec<WatchKind>,
    /// The unknowns that root functions read, by their place in `y`.
    pub unknowns: Vec<u32>,
    /// The other variables that they and their bounds read; `None` where time moves them, too.
    pub inputs: Option<Vec<(VarId, Flavour)>>,
}

/// Kind of a root function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WatchKind {
    /// It does not hold at zero.
    pub strict: bool,
    /// Purpose.
    pub role: WatchRole,
    /// There are bounds of it.
    pub bounded: bool,
}

/// Purpose of a root function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WatchRole {
    /// The condition of an event, by its index in [`Model::roots`].
    Event(u32),
    /// The equations jump there.
    Jump,
    /// The equations change their form there, by a kink. Those of one group look at one quantity.
    Kink {
        /// The group.
        group: u32,
    },
}

impl Watched {
    /// Collects what a model has to watch.
    pub(crate) fn new(model: &mut Model, time: &ExplicitTime) -> Watched {
        let switches = collect(model, time);
        let mut watched = Watched { switches, ..Watched::default() };
        let roots = watched.roots(model);
        let model_roots = model.roots.len();
        if let Some(builtins) = model.builtins() {
            let mut encloser = Encloser::new(model, builtins);
            let guides = (0..model_roots).map(|_| None).chain(watched.switches.iter().map(|switch| switch.guide));
            let pairs: Vec<_> = roots.iter().zip(guides).map(|((_, root), guide)| encloser.bounds(guide.unwrap_or(*root))).collect();
            let (least, most) = (model.exprs.constant(f64::NEG_INFINITY), model.exprs.constant(f64::INFINITY));
            let bounds = |of: fn((ExprId, ExprId)) -> ExprId| {
                let each = roots.iter().zip(&pairs);
                each.map(move |((loops, _), pair)| (loops.clone(), of(pair.unwrap_or((least, most)))))
            };
            watched.bounds = bounds(|pair| pair.0).chain(bounds(|pair| pair.1)).collect();
            watched.kinds = watched.find_kinds(model, &pairs);
        }
        watched.unknowns = unknowns_read(model, &roots);
        let guides = watched.switches.iter().filter_map(|switch| switch.guide);
        let read: Vec<ExprId> = roots.iter().map(|(_, root)| *root).chain(guides).collect();
        watched.inputs = inputs_read(model, &read);
        watched
    }

    /// All root functions over their loops.
    pub(crate) fn roots(&self, model: &Model) -> Vec<Looped> {
        let events = model.roots.iter().map(|root| (vec![], root.value));
        events.chain(self.switches.iter().map(|switch| switch.root.clone())).collect()
    }

    fn find_kinds(&self, model: &Model, bounds: &[Option<(ExprId, ExprId)>]) -> Vec<WatchKind> {
        let mut bounded = bounds.iter().map(Option::is_some);
        let mut kinds: Vec<WatchKind> = (0..)
            .zip(&model.roots)
            .zip(&mut bounded)
            .map(|((index, root), bounded)| WatchKind { strict: root.strict, role: WatchRole::Event(index), bounded })
            .collect();
        for (switch, bounded) in self.switches.iter().zip(bounded) {
            let kind = |group| WatchRole::Kink { group };
            let role = |group| if switch.kink { kind(group) } else { WatchRole::Jump };
            kinds.extend(switch.groups().map(|group| WatchKind { strict: switch.strict, role: role(group), bounded }));
        }
        kinds
    }
}

impl Switch {
    /// The group of each of its root functions, the last loop fastest.
    fn groups(&self) -> impl Iterator<Item = u32> {
        let passes = |loops: &[(u8, u32)]| loops.iter().map(|&(_, extent)| extent).product::<u32>();
        let (own, shared) = self.root.0.split_at(self.root.0.len() - self.shared);
        let (own, shared, first) = (passes(own), passes(shared), self.group);
        (0..own).flat_map(move |pass| std::iter::repeat_n(first + pass, shared as usize))
    }
}

/// The variables other than unknowns that expressions read; `None` where they read the time, too.
fn inputs_read(model: &Model, read: &[ExprId]) -> Option<Vec<(VarId, Flavour)>> {
    if model.exprs.below(read.iter().copied()).any(|e| matches!(model.exprs.node(e), Expr::Time)) {
        return None;
    }
    let is_input = |var: VarId, flavour| flavour != Flavour::Value || !model.unknowns.contains(&var);
    let mut inputs = Vec::new();
    for (var, flavour, _) in read.iter().flat_map(|&e| model.exprs.loads(e, is_input)) {
        if !inputs.contains(&(var, flavour)) {
            inputs.push((var, flavour));
        }
    }
    Some(inputs)
}

/// The unknowns that expressions over loops read, by their place in `y`.
pub(crate) fn unknowns_read(model: &Model, roots: &[Looped]) -> Vec<u32> {
    let mut first = FastMap::default();
    let mut next = 0;
    for &var in &model.unknowns {
        first.insert(var, next);
        next += i64::from(model.vars[var].len);
    }
    let mut read = vec![false; next as usize];
    for (loops, root) in roots {
        let mut around = [None; MAX_DEPTH];
        loops.iter().for_each(|&(d, extent)| around[d as usize] = Some(extent));
        for e in model.exprs.below([*root]) {
            if let Expr::Reduce { depth, extent, .. } = model.exprs.node(e) {
                // A counter that is bound twice reaches as far as the longer loop.
                let known = &mut around[depth.0 as usize];
                *known = Some(known.map_or(extent, |k: u32| k.max(extent)));
            }
        }
        for (var, _, at) in model.exprs.loads(*root, |var, flavour| flavour == Flavour::Value && first.contains_key(&var)) {
            let (low, high) = Affine::reach(&at, &around);
            let last = i64::from(model.vars[var].len) - 1;
            let begin = first[&var];
            (low.max(0)..=high.min(last)).for_each(|i| read[(begin + i) as usize] = true);
        }
    }
    (0..).zip(read).filter(|&(_, read)| read).map(|(at, _)| at).collect()
}
