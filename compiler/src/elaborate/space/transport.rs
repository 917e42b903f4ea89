//! Which way a flux flows: the cells from which its face values come.
//!
//! Where a domain has a directed scheme, the inner expression of a flux is elaborated with a *mark* in place of each face value first.
//! It is taken apart into terms, a product of *factors* without marks and of a rest with marks. The sign of the factors says from which
//! side the values of the rest come. Where bounds and constants tell that all come from below, every trace of this is removed and the
//! flux is elaborated with those cells at once; else the marks are replaced by the values of one side, or by a choice.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, Flux};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::symbols::{Scheme, SymbolId, SymbolKind, Symbols};
use crate::elaborate::lower::cells::Face;
use crate::elaborate::lower::units;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::space::interval;
use crate::elaborate::space::interval::Interval;
use crate::elaborate::{Elaborator, Place};
use crate::ir::{Affine, BinaryFn, Compare, Expr as Node, ExprId, FastMap, FastSet, Flavour, LoopVar, ReduceFn, Rewritten, UnaryFn, VarId};

/// Marks are loads of the builtins from this element on.
const MARK: i64 = 1 << 40;
/// Exponent of the time among those of the base quantities.
const TIME: usize = 2;

/// A face value that waits for its direction.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct FaceValue {
    symbol: SymbolId,
    index: Vec<Expr>,
    span: Span,
    face: Face,
    place: Place,
    /// The field in the cell below, or beside the end: tells the fields apart.
    beside: ExprId,
    mark: ExprId,
    range: Interval,
    /// An odd power of the time in its unit, as velocities and flows have it, and what they carry has not.
    odd: bool,
    /// Stands as velocity in a call of `upwind`.
    velocity: bool,
}

/// Where a face value comes from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Direction {
    Below,
    Above,
    /// From below where this holds.
    When(ExprId),
    /// A velocity: the mean of both cells.
    Mean,
    /// By the mean slope of what depends on this face value alone.
    Slope,
}

/// Marks in an expression.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Marks {
    None,
    One(usize),
    Many,
}

/// A term of a flux.
#[derive(Clone)]
struct Term {
    /// Factors, and whether they divide.
    factors: Vec<(ExprId, bool)>,
    /// What has marks.
    rest: ExprId,
    marks: Marks,
    /// Brackets behind a factor in which it stands, and its own factor in there.
    bracket: Option<(usize, Interval)>,
    /// Sums around it, the innermost last.
    sums: Vec<(LoopVar, u32)>,
}

/// What came of the elaboration with marks.
enum Outcome {
    /// As if all came from below; also where there are faults, which the usual way reports.
    Plain,
    Built(Value),
    Fault(Diagnostic),
}

/// Terms of a flux and the directions of its marks.
struct Flow {
    terms: Vec<Term>,
    directions: Vec<Direction>,
}

/// What a flux is elaborated with.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Fluxes {
    /// Face values of the flux that is being elaborated, where their directions are yet to be found.
    pub faces: Option<Vec<FaceValue>>,
    /// Face values are means of both cells: in a velocity.
    pub averaging: bool,
}

impl Elaborator<'_> {
    /// The inner expression of a flux at a face between two cells.
    pub(in crate::elaborate) fn directed(&mut self, flux: &Flux, place: &Place) -> Value {
        let outcome = self.with_marks(|s| {
            let v = s.value(&flux.inner, place);
            let flow = match s.flow(v.expr, flux.inner.span) {
                Ok(flow) => flow,
                Err(fault) => return Outcome::Fault(*fault),
            };
            if v.is_poison() || flow.directions.iter().all(|d| *d == Direction::Below) {
                return Outcome::Plain;
            }
            s.placed(v, &flow).map_or(Outcome::Plain, Outcome::Built)
        });
        match outcome {
            Outcome::Plain => self.value(&flux.inner, place),
            Outcome::Built(v) => v,
            Outcome::Fault(fault) => self.fault(fault),
        }
    }

    /// The flux given at an end, where the flow may turn: what is carried in holds while the flow enters, else the cell's own value.
    pub(in crate::elaborate) fn entering(&mut self, given: Value, flux: &Flux, is_low: bool, place: &Place) -> Value {
        if given.is_poison() {
            return given;
        }
        let outcome = self.with_marks(|s| {
            let v = s.value(&flux.inner, place);
            let Ok(flow) = s.flow(v.expr, flux.inner.span) else { return Outcome::Plain };
            if v.is_poison() {
                return Outcome::Plain;
            }
            s.turning(&given, v, &flow, is_low).map_or(Outcome::Plain, Outcome::Built)
        });
        match outcome {
            Outcome::Built(v) => v,
            Outcome::Plain | Outcome::Fault(_) => given,
        }
    }

    /// Elaborates something with marks for face values; leaves no trace unless it is what was wanted.
    fn with_marks(&mut self, body: impl FnOnce(&mut Self) -> Outcome) -> Outcome {
        let before = self.ledger.trace();
        let (nodes, diagnostics) = (self.exprs.len(), self.ledger.reports.diagnostics.len());
        let drawn = self.hidden.len();
        let outer = self.fluxes.faces.replace(Vec::new());
        self.ledger.speculation.enter();
        let mut outcome = body(self);
        self.ledger.speculation.end();
        self.fluxes.faces = outer;
        if self.ledger.reports.diagnostics.len() > diagnostics {
            outcome = Outcome::Plain;
        }
        if matches!(outcome, Outcome::Built(_)) {
            self.ledger.speculation.settle(&mut self.ledger.reports);
        } else {
            self.ledger.roll_back(before, &mut self.expansions);
            // What was drawn in there keeps its node.
            if drawn == self.hidden.len() {
                self.exprs.truncate(nodes);
            }
        }
        outcome
    }

    /// A mark for a field's value at a face; `beside` is the field in the cell below, or beside the end.
    pub(in crate::elaborate) fn marked(
        &mut self,
        (symbol, index, span): (SymbolId, &[Expr], Span),
        face: Face,
        place: &Place,
        beside: &Value,
        velocity: bool,
    ) -> Value {
        let Node::Load { var, flavour, at } = self.exprs.node(beside.expr) else { return beside.clone() };
        let range = self.declared_range(var, flavour, at);
        let Some(faces) = &mut self.fluxes.faces else { return beside.clone() };
        if let Some(known) = faces.iter_mut().find(|f| f.beside == beside.expr) {
            known.velocity |= velocity;
            return Value { expr: known.mark, unit: beside.unit.clone() };
        }
        let mark = Affine { offset: MARK + faces.len() as i64, ..at };
        let mark = self.exprs.load(self.hidden.builtins, Flavour::Value, mark);
        let odd = is_odd(&beside.unit.unit());
        let index = index.to_vec();
        faces.push(FaceValue { symbol, index, span, face, place: place.clone(), beside: beside.expr, mark, range, odd, velocity });
        Value { expr: mark, unit: beside.unit.clone() }
    }

    /// What is declared of an element.
    fn declared_range(&self, var: VarId, flavour: Flavour, at: Affine) -> Interval {
        if let Some(face) = self.mark_of(var, at) {
            return self.fluxes.faces.as_ref().and_then(|f| f.get(face)).map_or(Interval::ALL, |f| f.range);
        }
        let Some(q) = self.symbols.quantities.get(&var).filter(|_| flavour != Flavour::Derivative) else { return Interval::ALL };
        let one = |list: &[f64]| if at.is_constant() { list.get(at.offset as usize).copied() } else { None };
        let low = one(&q.low).unwrap_or_else(|| q.low.iter().copied().fold(f64::INFINITY, f64::min));
        let high = one(&q.high).unwrap_or_else(|| q.high.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        if low <= high { Interval { low, high } } else { Interval::ALL }
    }

    fn mark_of(&self, var: VarId, at: Affine) -> Option<usize> {
        (var == self.hidden.builtins && at.offset >= MARK).then(|| (at.offset - MARK) as usize)
    }

    /// What an expression may be by declared bounds.
    pub(in crate::elaborate) fn interval(&self, e: ExprId) -> Interval {
        interval::values(&self.exprs, e, &|var, flavour, at| self.declared_range(var, flavour, at))
    }

    fn slope(&self, e: ExprId, mark: usize) -> Interval {
        let Some(by) = self.fluxes.faces.as_ref().and_then(|f| f.get(mark)).map(|f| f.mark) else { return Interval::ALL };
        interval::slopes(&self.exprs, e, by, &|var, flavour, at| self.declared_range(var, flavour, at))
    }

    /// The marks in an expression and in all that it consists of.
    fn marks(&self, root: ExprId, done: &mut FastMap<ExprId, Marks>) -> Marks {
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
    fn marks_in(&self, e: ExprId) -> Vec<usize> {
        let mut seen = FastSet::default();
        let (mut stack, mut out) = (vec![e], Vec::new());
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            if let Node::Load { var, at, .. } = self.exprs.node(e)
                && let Some(mark) = self.mark_of(var, at)
            {
                out.push(mark);
            }
            stack.extend(self.exprs.operands(e));
        }
        out.sort_unstable();
        out
    }

    /// The terms of a flux that have marks.
    fn flux_terms(&mut self, root: ExprId) -> Vec<Term> {
        let mut done = FastMap::default();
        let marks = self.marks(root, &mut done);
        let mut terms = Vec::new();
        let mut brackets = 0;
        let mut stack = vec![Term { factors: Vec::new(), rest: root, marks, bracket: None, sums: Vec::new() }];
        while let Some(term) = stack.pop() {
            let of = |e: ExprId| done.get(&e).copied().unwrap_or(Marks::None);
            let has = |e: ExprId| of(e) != Marks::None;
            let inside = |e: ExprId| Term { rest: e, marks: of(e), ..term.clone() };
            match self.exprs.node(term.rest) {
                _ if term.marks == Marks::None => {}
                Node::Binary(f @ (BinaryFn::Add | BinaryFn::Sub), a, b) => {
                    let opened =
                        term.bracket.is_none() && has(a) && has(b) && term.factors.iter().any(|&(x, _)| self.exprs.as_const(x).is_none());
                    brackets += usize::from(opened);
                    let bracket = if opened { Some((brackets, Interval::of(1.0))) } else { term.bracket };
                    let (a, b) = (Term { bracket, ..inside(a) }, Term { bracket, ..inside(b) });
                    stack.push(a);
                    stack.push(if f == BinaryFn::Sub { self.with_factor(b, -1.0) } else { b });
                }
                Node::Unary(UnaryFn::Neg, a) => {
                    let a = inside(a);
                    stack.push(self.with_factor(a, -1.0));
                }
                Node::Binary(BinaryFn::Mul, a, b) if !(has(a) && has(b)) => {
                    let (factor, rest) = if has(a) { (b, a) } else { (a, b) };
                    stack.push(self.times(inside(rest), factor, false));
                }
                Node::Binary(BinaryFn::Div, a, b) if !has(b) => stack.push(self.times(inside(a), b, true)),
                Node::Select(c, a, b) if !has(c) => {
                    let (one, zero) = (self.exprs.constant(1.0), self.exprs.constant(0.0));
                    let (first, second) = (self.exprs.select(c, one, zero), self.exprs.select(c, zero, one));
                    let (a, b) = (inside(a), inside(b));
                    stack.push(self.times(a, first, false));
                    stack.push(self.times(b, second, false));
                }
                Node::Reduce { op: ReduceFn::Sum, depth, extent, body } => {
                    let mut body = inside(body);
                    body.sums.push((depth, extent));
                    stack.push(body);
                }
                Node::Binary(BinaryFn::Mul | BinaryFn::Div, ..) => {
                    let term = self.unmarked_factors_out(term, &done);
                    terms.push(term);
                }
                _ => terms.push(term),
            }
        }
        terms.reverse();
        terms
    }

    /// A product of several parts with marks, with the others among its factors.
    fn unmarked_factors_out(&mut self, mut term: Term, marks: &FastMap<ExprId, Marks>) -> Term {
        let mut stack = vec![(term.rest, false)];
        let mut rest = self.exprs.constant(1.0);
        while let Some((e, divides)) = stack.pop() {
            match self.exprs.node(e) {
                _ if marks.get(&e).is_none_or(|m| *m == Marks::None) => term = self.times(term, e, divides),
                Node::Binary(BinaryFn::Mul, a, b) => stack.extend([(b, divides), (a, divides)]),
                Node::Binary(BinaryFn::Div, a, b) => stack.extend([(b, !divides), (a, divides)]),
                Node::Unary(UnaryFn::Neg, a) => {
                    term = self.with_factor(term, -1.0);
                    stack.push((a, divides));
                }
                _ => rest = if divides { self.exprs.div(rest, e) } else { self.exprs.mul(rest, e) },
            }
        }
        term.rest = rest;
        term
    }

    fn with_factor(&mut self, term: Term, x: f64) -> Term {
        let factor = self.exprs.constant(x);
        self.times(term, factor, false)
    }

    fn times(&self, mut term: Term, factor: ExprId, divides: bool) -> Term {
        if let Some((_, own)) = &mut term.bracket {
            let range = self.interval(factor);
            *own = own.times(if divides { range.reciprocal() } else { range });
        }
        term.factors.push((factor, divides));
        term
    }

    /// What the factors of a term may be.
    fn factor_range(&self, factors: &[(ExprId, bool)]) -> Interval {
        factors.iter().fold(Interval::of(1.0), |product, &(e, divides)| {
            let range = self.interval(e);
            product.times(if divides { range.reciprocal() } else { range })
        })
    }

    fn multiplied(&mut self, factors: &[(ExprId, bool)], first: ExprId) -> ExprId {
        factors.iter().fold(first, |e, &(f, divides)| if divides { self.exprs.div(e, f) } else { self.exprs.mul(e, f) })
    }

    /// A product with the sign of the factors, without those whose sign is known.
    fn sign_of(&mut self, factors: &[(ExprId, bool)]) -> ExprId {
        let mut sign = self.exprs.constant(1.0);
        let mut stack: Vec<ExprId> = factors.iter().rev().map(|f| f.0).collect();
        while let Some(e) = stack.pop() {
            let range = self.interval(e);
            match self.exprs.node(e) {
                _ if range.is_not_negative() => {}
                _ if range.is_not_positive() => sign = self.exprs.neg(sign),
                Node::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => stack.extend([b, a]),
                Node::Unary(UnaryFn::Neg, a) => {
                    sign = self.exprs.neg(sign);
                    stack.push(a);
                }
                _ => sign = self.exprs.mul(sign, e),
            }
        }
        sign
    }

    /// From below where a number is not negative.
    fn forward(&mut self, sign: ExprId) -> Direction {
        let range = self.interval(sign);
        if range.is_not_negative() {
            return Direction::Below;
        }
        if range.is_not_positive() {
            return Direction::Above;
        }
        let zero = self.exprs.constant(0.0);
        Direction::When(match self.exprs.node(sign) {
            Node::Unary(UnaryFn::Neg, a) => self.exprs.compare(Compare::Le, a, zero),
            _ => self.exprs.compare(Compare::Le, zero, sign),
        })
    }

    /// The directions of all face values of a flux.
    fn flow(&mut self, e: ExprId, span: Span) -> Result<Flow, Box<Diagnostic>> {
        let terms = self.flux_terms(e);
        let faces = self.fluxes.faces.clone().unwrap_or_default();
        self.check_brackets(&terms, &faces, span)?;
        let mut directions: Vec<Option<Direction>> = faces.iter().map(|f| f.velocity.then_some(Direction::Mean)).collect();
        for term in &terms {
            if term.marks == Marks::Many {
                for (mark, direction) in self.together(term, &faces, span)? {
                    settle(&mut directions, &faces, mark, direction)?;
                }
            }
        }
        for mark in 0..faces.len() {
            let own: Vec<Term> = terms.iter().filter(|t| t.marks == Marks::One(mark)).cloned().collect();
            if !own.is_empty() {
                for direction in self.alone(&own, mark) {
                    settle(&mut directions, &faces, mark, direction)?;
                }
            }
        }
        let directions = directions.into_iter().map(|d| d.unwrap_or(Direction::Below)).collect();
        Ok(Flow { terms, directions })
    }

    /// Fields that stand behind one factor in brackets, or have equal factors, flow with each other or against each other: where both
    /// may be meant, it must be said.
    fn check_brackets(&mut self, terms: &[Term], faces: &[FaceValue], span: Span) -> Result<(), Box<Diagnostic>> {
        let fields: Vec<Vec<usize>> = terms.iter().map(|t| self.marks_in(t.rest)).collect();
        let keys: Vec<(Vec<(ExprId, bool)>, Interval)> = terms
            .iter()
            .map(|t| {
                let (numbers, mut others): (Vec<_>, Vec<_>) = t.factors.iter().partition(|f| self.exprs.as_const(f.0).is_some());
                others.sort_unstable();
                (others, self.factor_range(&numbers))
            })
            .collect();
        for (i, a) in terms.iter().enumerate() {
            for (j, b) in terms.iter().enumerate().take(i) {
                if fields[i] == fields[j] {
                    continue;
                }
                let agree =
                    |x: Interval, y: Interval| (x.is_not_negative() && y.is_not_negative()) || (x.is_not_positive() && y.is_not_positive());
                let together = match (a.bracket, b.bracket) {
                    (Some((m, x)), Some((n, y))) if m == n => agree(x, y),
                    _ => keys[i].0 != keys[j].0 || agree(keys[i].1, keys[j].1),
                };
                let first = |k: usize| fields[k].iter().copied().find(|m| fields[i + j - k].iter().all(|n| n != m));
                let (Some(x), Some(y)) = (first(j).or(fields[j].first().copied()), first(i).or(fields[i].first().copied())) else {
                    continue;
                };
                if !together && !faces[x].velocity && !faces[y].velocity {
                    return Err(self.both_ways(&faces[x], &faces[y], span));
                }
            }
        }
        Ok(())
    }

    fn both_ways(&self, a: &FaceValue, b: &FaceValue, span: Span) -> Box<Diagnostic> {
        let (x, y) = (self.symbols[a.symbol].path.clone(), self.symbols[b.symbol].path.clone());
        Box::new(
            Diagnostic::error(codes::WRONG_KIND, format!("does `{y}` flow with `{x}` in this flux, or against it?"), span)
                .label(format!("one factor carries `{x}` and, with the other sign, `{y}`"))
                .help("carried together: `v*upwind(v, a[z] - b[z])`; against each other: `v*upwind(v, a[z]) - v*upwind(-v, b[z])`"),
        )
    }

    /// Directions of the face values of a product (or another function) of several fields: they come from one side.
    fn together(&mut self, term: &Term, faces: &[FaceValue], span: Span) -> Result<Vec<(usize, Direction)>, Box<Diagnostic>> {
        let parts = self.parts(term.rest);
        let unknown: Vec<ExprId> = parts.iter().copied().filter(|&p| !self.interval(p).is_not_negative()).collect();
        let is_velocity = |s: &Self, part: ExprId| s.reaches(part, &mut |s, node| s.may_be_velocity(node));
        let fields = self.marks_in(term.rest);
        let velocities: Vec<ExprId> = unknown.iter().copied().filter(|&p| is_velocity(self, p)).collect();
        let timeless = units::is_dimensionless(&self.symbols.time_unit);
        let mut factors = term.factors.clone();
        let mut carriers = Vec::new();
        match velocities.as_slice() {
            [] if unknown.is_empty() || !timeless => {}
            [velocity] => {
                carriers = self.marks_in(*velocity);
                let pure = carriers.iter().all(|&m| faces[m].odd || faces[m].velocity);
                let twice = parts.iter().filter(|&&p| self.marks_in(p).iter().any(|m| carriers.contains(m))).count() > 1;
                if !pure || twice {
                    return Err(self.no_velocity(&fields, faces, span));
                }
                let mean = self.replaced(*velocity, faces, &mut |s, m| s.mean_of(&faces[m]));
                factors.push((mean, false));
            }
            _ => return Err(self.no_velocity(&fields, faces, span)),
        }
        let sign = self.sign_of(&factors);
        let direction = self.forward(sign);
        Ok(fields.into_iter().map(|m| (m, if carriers.contains(&m) { Direction::Mean } else { direction })).collect())
    }

    /// Whether a variable may be what carries the others: of any sign, and by its unit a velocity or a flow.
    fn may_be_velocity(&self, node: ExprId) -> bool {
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

    fn no_velocity(&self, fields: &[usize], faces: &[FaceValue], span: Span) -> Box<Diagnostic> {
        let mut names: Vec<String> = fields.iter().map(|&m| format!("`{}`", self.symbols[faces[m].symbol].path)).collect();
        names.dedup();
        let (names, what) = (names.join(", "), faces.first().map_or("c", |f| self.symbols[f.symbol].path.as_str()));
        Box::new(
            Diagnostic::error(codes::WRONG_KIND, format!("the direction of this flux is not clear: which of {names} is a velocity?"), span)
                .label("from which of both cells they come depends on it")
                .help(format!("name it: `v[z]*upwind(v[z], {what}[z])`, or give what cannot be negative a bound, `in 0..inf`")),
        )
    }

    /// Factors of a product that have marks; of a power its base.
    fn parts(&self, e: ExprId) -> Vec<ExprId> {
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

    /// Directions of a face value by the terms that depend on it alone.
    fn alone(&mut self, terms: &[Term], mark: usize) -> Vec<Direction> {
        let ranges = terms.iter().map(|t| self.factor_range(&t.factors).times(self.slope(t.rest, mark)));
        let range = ranges.fold(Interval::of(0.0), Interval::plus);
        if range.is_not_negative() {
            return vec![Direction::Below];
        }
        if range.is_not_positive() {
            return vec![Direction::Above];
        }
        let rests: Vec<Interval> = terms.iter().map(|t| self.slope(t.rest, mark)).collect();
        if terms.len() == 1 && rests[0].is_not_negative() || terms.iter().all(|t| !t.sums.is_empty()) {
            let signs: Vec<ExprId> = terms.iter().map(|t| self.sign_of(&t.factors)).collect();
            return signs.into_iter().map(|s| self.forward(s)).collect();
        }
        let is_linear = rests.iter().all(|&r| r == Interval::of(1.0));
        if !is_linear || terms.iter().any(|t| !t.sums.is_empty()) {
            return vec![Direction::Slope];
        }
        let one = self.exprs.constant(1.0);
        let mut total = self.exprs.constant(0.0);
        for term in terms {
            let factor = self.multiplied(&term.factors, one);
            total = self.exprs.add(total, factor);
        }
        vec![self.forward(total)]
    }

    /// The flux with the marks replaced.
    fn placed(&mut self, v: Value, flow: &Flow) -> Option<Value> {
        let faces = self.fluxes.faces.clone().unwrap_or_default();
        let mut values = Vec::with_capacity(faces.len());
        for (mark, face) in faces.iter().enumerate() {
            values.push(match flow.directions[mark] {
                Direction::Below => self.side(face, true)?,
                Direction::Above => self.side(face, false)?,
                Direction::Mean => self.mean_of(face),
                Direction::When(holds) => {
                    let (below, above) = (self.side(face, true)?, self.side(face, false)?);
                    self.exprs.select(holds, below, above)
                }
                Direction::Slope => {
                    let (below, above) = (self.side(face, true)?, self.side(face, false)?);
                    let holds = self.mean_slope(&flow.terms, mark, &faces, (below, above));
                    self.exprs.select(holds, below, above)
                }
            });
        }
        let expr = self.replaced(v.expr, &faces, &mut |_, m| values[m]);
        Some(Value { expr, unit: v.unit })
    }

    /// Whether what depends on one face value alone rises from one side's value to the other's.
    fn mean_slope(&mut self, terms: &[Term], mark: usize, faces: &[FaceValue], (below, above): (ExprId, ExprId)) -> ExprId {
        let mut total = self.exprs.constant(0.0);
        for term in terms.iter().filter(|t| t.marks == Marks::One(mark)) {
            let e = self.term(term);
            total = self.exprs.add(total, e);
        }
        let f = [below, above].map(|value| self.replaced(total, faces, &mut |_, _| value));
        let (rise, run) = (self.exprs.sub(f[1], f[0]), self.exprs.sub(above, below));
        let product = self.exprs.mul(rise, run);
        let zero = self.exprs.constant(0.0);
        self.exprs.compare(Compare::Le, zero, product)
    }

    /// A term as an expression.
    fn term(&mut self, term: &Term) -> ExprId {
        let e = self.multiplied(&term.factors, term.rest);
        term.sums.iter().rev().fold(e, |e, &(depth, extent)| self.exprs.reduce(ReduceFn::Sum, depth, extent, e))
    }

    /// An expression with other nodes in place of the marks.
    fn replaced(&mut self, e: ExprId, faces: &[FaceValue], by: &mut dyn FnMut(&mut Self, usize) -> ExprId) -> ExprId {
        let marks = self.marks_in(e);
        let map: FastMap<ExprId, ExprId> = marks.into_iter().map(|m| (faces[m].mark, by(self, m))).collect();
        self.exprs.rewrite(e, &mut map.into_iter().collect::<Rewritten>(), &mut |_, _| None)
    }

    /// A field at its face from one side; `None` where the loop has to be cut.
    fn side(&mut self, f: &FaceValue, below: bool) -> Option<ExprId> {
        let faces = self.fluxes.faces.take();
        let v = self.value_from_side(f.face, below, &mut |s, by| {
            s.in_cell(f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place)
        });
        self.fluxes.faces = faces;
        (!v.is_poison()).then_some(v.expr)
    }

    fn mean_of(&mut self, f: &FaceValue) -> ExprId {
        let cell = |s: &mut Self, by| s.in_cell(f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place).expr;
        let n = self.symbols.domains[f.face.domain].cells;
        if f.face.at.count == 1 && (f.face.at.first == 0 || f.face.at.first == n) {
            return f.beside;
        }
        let (l, r) = (cell(self, -1), cell(self, 0));
        self.interpolate(f.face, l, r)
    }

    /// A flux given at an end with what the flow carries out while it leaves there; `None` where nothing has to be changed.
    fn turning(&mut self, given: &Value, inner: Value, flow: &Flow, is_low: bool) -> Option<Value> {
        let faces = self.fluxes.faces.clone().unwrap_or_default();
        let mut conditions: Vec<ExprId> = Vec::new();
        for direction in &flow.directions {
            if let Direction::When(holds) = direction
                && !conditions.contains(holds)
            {
                conditions.push(*holds);
            }
        }
        let given_expr = match (&given.unit, &inner.unit) {
            (Measure::Of(a), Measure::Of(b)) => self.values().convert(given.expr, &a.clone(), &b.clone())?,
            _ => given.expr,
        };
        let velocities: Vec<FastSet<ExprId>> = conditions.iter().map(|&holds| self.velocities(holds)).collect();
        let mut rest: Vec<ExprId> = self.summands(given_expr, &velocities);
        let mut total = None;
        for (holds, velocities) in conditions.into_iter().zip(&velocities) {
            let carried: Vec<&FaceValue> =
                faces.iter().zip(&flow.directions).filter(|(_, d)| **d == Direction::When(holds)).map(|(f, _)| f).collect();
            let (turns, stays): (Vec<ExprId>, Vec<ExprId>) = rest.iter().partition(|&&e| {
                let value = self.beside_velocity(e, velocities);
                let reads = |e: ExprId| carried.iter().any(|f| self.reaches(e, &mut |_, node| node == f.beside));
                value.is_some_and(|factors| !factors.into_iter().any(reads))
            });
            if turns.is_empty() {
                continue;
            }
            rest = stays;
            let mut out = self.exprs.constant(0.0);
            for term in &flow.terms {
                if self.marks_in(term.rest).iter().any(|&m| flow.directions[m] == Direction::When(holds)) {
                    let e = self.term(term);
                    let e = self.replaced(e, &faces, &mut |_, m| faces[m].beside);
                    out = self.exprs.add(out, e);
                }
            }
            let into = self.total(&turns);
            let e = if is_low { self.exprs.select(holds, into, out) } else { self.exprs.select(holds, out, into) };
            total = Some(total.map_or(e, |t| self.exprs.add(t, e)));
        }
        let total = total?;
        let rest = self.total(&rest);
        let expr = self.exprs.add(rest, total);
        Some(Value { expr, unit: if matches!(inner.unit, Measure::Of(_)) { inner.unit } else { given.unit.clone() } })
    }

    fn total(&mut self, list: &[ExprId]) -> ExprId {
        let zero = self.exprs.constant(0.0);
        list.iter().fold(zero, |sum, &e| self.exprs.add(sum, e))
    }

    /// The terms of a sum; a velocity that is a sum itself is one.
    fn summands(&mut self, e: ExprId, velocities: &[FastSet<ExprId>]) -> Vec<ExprId> {
        let mut stack = vec![(e, false)];
        let mut out = Vec::new();
        while let Some((e, negative)) = stack.pop() {
            match self.exprs.node(e) {
                _ if velocities.iter().any(|v| v.contains(&e)) => out.push(if negative { self.exprs.neg(e) } else { e }),
                Node::Binary(BinaryFn::Add, a, b) => stack.extend([(b, negative), (a, negative)]),
                Node::Binary(BinaryFn::Sub, a, b) => stack.extend([(b, !negative), (a, negative)]),
                Node::Unary(UnaryFn::Neg, a) => stack.push((a, !negative)),
                _ => out.push(if negative { self.exprs.neg(e) } else { e }),
            }
        }
        out
    }

    /// What a condition turns by: nodes of no known sign in it.
    fn velocities(&self, holds: ExprId) -> FastSet<ExprId> {
        let mut moving = FastSet::default();
        let mut fixed = FastSet::default();
        self.reaches(holds, &mut |s, node| {
            if !s.exprs.is_truth(node) && !s.interval(node).has_sign() {
                if s.symbols.varying(&s.exprs, node).is_some() {
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
    fn beside_velocity(&self, e: ExprId, velocities: &FastSet<ExprId>) -> Option<Vec<ExprId>> {
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

    /// Whether `what` is said of any node of an expression.
    fn reaches(&self, e: ExprId, what: &mut dyn FnMut(&Self, ExprId) -> bool) -> bool {
        let mut seen = FastSet::default();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            if seen.insert(e) {
                if what(self, e) {
                    return true;
                }
                stack.extend(self.exprs.operands(e));
            }
        }
        false
    }
}

impl<'a> Symbols<'a> {
    /// Whether the scheme of a domain looks where the flow comes from.
    pub(in crate::elaborate) fn is_directed(&self, face: Face) -> bool {
        matches!(self.domains[face.domain].scheme, Scheme::Upwind | Scheme::Upwind2 | Scheme::Limited)
    }
}

/// Whether the unit has an odd power of the time, as those of velocities and flows.
fn is_odd(unit: &Unit) -> bool {
    unit.dimension().exponents()[TIME].numerator() % 2 != 0
}

/// Notes the direction of a face value; two that differ cannot both hold.
fn settle(directions: &mut [Option<Direction>], faces: &[FaceValue], mark: usize, direction: Direction) -> Result<(), Box<Diagnostic>> {
    match directions[mark] {
        Some(Direction::Mean) => {}
        None => directions[mark] = Some(direction),
        Some(_) if direction == Direction::Mean => directions[mark] = Some(direction),
        Some(known) if known == direction => {}
        Some(_) => {
            return Err(Box::new(
                Diagnostic::error(
                    codes::WRONG_KIND,
                    "two terms of this flux carry this field, each with a velocity of its own",
                    faces[mark].span,
                )
                .label("from which of both cells does it come?")
                .help("say it for each term: `v*upwind(v, c[z]) + w*upwind(w, c[z]*b[z])`"),
            ));
        }
    }
    Ok(())
}
