//! Sums, products, means and the like.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, BinderSet, Expr, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::builtins::{self, Over};
use crate::elaborate::lower::expression::Own;
use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::place::{BinderValue, Bound, Place};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, binders, functions, operators, units};
use crate::elaborate::space::grid;
use crate::elaborate::symbols::DomainId;
use crate::ir::{BinaryFn, Compare, Expr as Node, ExprId, LoopVar, ReduceFn};

/// Body of the reduction over the remaining binders.
#[derive(Clone, Copy)]
pub(in crate::elaborate::lower) struct Reduced<'e> {
    pub body: &'e Expr,
    pub binders: &'e [Binder],
    pub condition: Option<&'e Expr>,
    pub kind: Terms,
    /// Terms need their indices as numbers.
    pub indexed: bool,
    /// Reading of the body.
    pub read: Own,
}

impl<'e> Reduced<'e> {
    /// The first binder, and what is reduced inside of it.
    fn inside(self) -> Option<(&'e Binder, Reduced<'e>)> {
        let (binder, binders) = self.binders.split_first()?;
        Some((binder, Reduced { binders, ..self }))
    }
}

/// A binder whose range stays a loop.
struct Looped<'e> {
    binder: &'e Binder,
    /// First and last number.
    range: (i64, i64),
    /// Whose cells they are.
    domain: Option<DomainId>,
}

impl Lowering<'_, '_> {
    /// `sum(e for i in set, z if condition)`
    pub(in crate::elaborate) fn reduction(
        &mut self,
        span: Span,
        function: &Ident,
        body: &Expr,
        binders: &[Binder],
        condition: Option<&Expr>,
        place: &Place,
    ) -> Value {
        let mut terms = Vec::new();
        let over = builtins::find(&function.text).and_then(|b| b.over);
        match (over, binders, condition) {
            (Some(Over::Between), [binder], Some(at)) if matches!(binder.over, BinderSet::Itself) => {
                return self.interpolation(body, binder, at, place);
            }
            (Some(Over::Between), ..) => {
                let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, "`interp` takes an array and a position", span);
                return self.fault(fault.help("write `interp(T[z], z = x)`"));
            }
            (Some(Over::Index(_)), [_, second, ..], _) => {
                let message = format!("`{}` takes one index", function.text);
                return self.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, message, second.span));
            }
            _ => {}
        }
        let kind = match over {
            Some(Over::Integral | Over::Mean) => Terms::Weighted,
            Some(Over::Reduce(ReduceFn::Sum) | Over::Any | Over::All) => Terms::Plain,
            _ => Terms::Single,
        };
        let read: Own = |l, e, place| l.value(e, place);
        let indexed = matches!(over, Some(Over::Index(_)));
        self.terms(Reduced { body, binders, condition, kind, indexed, read }, place, &mut terms);
        if terms.iter().any(|t| t.value.is_poison()) {
            return self.poison();
        }
        match over {
            Some(Over::Reduce(ReduceFn::Product)) => self.product_of(terms, span),
            Some(Over::Reduce(op)) => self.fold(terms, op, span),
            Some(Over::Mean) => self.mean(terms, span),
            Some(Over::Integral) => self.space_integral(terms, span),
            Some(Over::Any) => self.values().quantified(terms, true, span),
            Some(Over::All) => self.values().quantified(terms, false, span),
            Some(Over::Index(op)) => self.index_of_extreme(terms, op, span),
            Some(Over::Between) | None => functions::unknown_function(self, function, place),
        }
    }

    /// The greatest or least of what a body is read as, over its binders: `number` makes a number
    /// of what was read, and of the condition under which it counts. `None` where all that was read
    /// are truth values.
    pub(in crate::elaborate) fn extreme(
        &mut self,
        op: ReduceFn,
        (body, binders, condition): (&Expr, &[Binder], Option<&Expr>),
        read: Own,
        place: &Place,
        number: &mut dyn FnMut(&mut Self, &Value, Option<ExprId>) -> ExprId,
    ) -> Option<Value> {
        let mut terms = Vec::new();
        self.terms(Reduced { body, binders, condition, kind: Terms::Plain, indexed: false, read }, place, &mut terms);
        if terms.iter().all(|t| matches!(t.value.unit, Measure::Truth | Measure::Poison)) {
            return None;
        }
        for term in &mut terms {
            let counts = term.keep.take();
            term.value = Value::bare(number(self, &term.value, counts));
        }
        Some(self.fold(terms, op, body.span))
    }

    /// All terms of a reduction: one for each member, one a piece of a range of cells.
    pub(in crate::elaborate::lower) fn terms(&mut self, reduced: Reduced<'_>, place: &Place, out: &mut Vec<Term>) {
        let Some((binder, reduced)) = reduced.inside() else { return self.innermost_term(reduced, place, out) };
        if self.looped_run(binder, reduced, place, out) {
            return;
        }
        for (position, bound) in binders::bindings_of(self, binder, place).into_iter().enumerate() {
            if self.ledger.budget.is_full() {
                return;
            }
            match bound {
                BinderValue::One(bound) => {
                    let written = if let Bound::Alias(e, ..) = &bound { Some(e.span) } else { None };
                    let first = out.len();
                    let index = reduced.indexed.then(|| self.number_of(&bound, position));
                    self.terms(reduced, &place.bind(&binder.name.text, bound), out);
                    if let Some(index) = index {
                        out[first..].iter_mut().for_each(|t| t.index = index.clone());
                    }
                    if let Some(span) = written {
                        out[first..].iter_mut().for_each(|t| t.span = span);
                    }
                }
                BinderValue::Cells(domain, low, high) => {
                    let mut make = |cell: Cell| Bound::Cell(domain, cell);
                    self.looped_terms(Looped { binder, range: (low, high), domain: Some(domain) }, &mut make, reduced, place, out);
                }
                BinderValue::Elements(symbol, len) => {
                    let mut make = |cell: Cell| Bound::Element(symbol, cell.affine());
                    self.looped_terms(Looped { binder, range: (0, len - 1), domain: None }, &mut make, reduced, place, out);
                }
            }
        }
    }

    /// The term inside of all binders, unless its condition never holds.
    fn innermost_term(&mut self, Reduced { body, condition, read, .. }: Reduced<'_>, place: &Place, out: &mut Vec<Term>) {
        if !self.ledger.may_write_out(body.span) {
            return;
        }
        let keep = condition.map(|c| self.condition(c, place));
        if keep.is_some_and(|c| matches!(self.exprs.node(c), Node::Truth(false))) {
            return;
        }
        let keep = keep.filter(|&c| !matches!(self.exprs.node(c), Node::Truth(true)));
        let value = read(self, body, place);
        let index = value.clone();
        out.push(Term { value, span: body.span, keep, loops: Vec::new(), weight: None, index });
    }

    /// The number that an index is: that of a member of a set of numbers, otherwise its position.
    fn number_of(&mut self, bound: &Bound, position: usize) -> Value {
        let number = match bound {
            Bound::Member(set, i) => self.symbols.sets[*set].first.map(|first| first as f64 + *i as f64),
            Bound::Number(e) => return Value::bare(*e),
            _ => None,
        };
        Value::bare(self.exprs.constant(number.unwrap_or((position + 1) as f64)))
    }

    /// Attempts to keep the members of a set as a loop; whether that went.
    fn looped_run(&mut self, binder: &Binder, reduced: Reduced<'_>, place: &Place, out: &mut Vec<Term>) -> bool {
        if reduced.kind == Terms::Single {
            return false;
        }
        let Some(range) = self.run_of(binder, place) else { return false };
        let mut terms = Vec::new();
        let looped = self.attempt(|s| {
            s.looped_terms(Looped { binder, range, domain: None }, &mut Bound::Run, reduced, place, &mut terms);
            if terms.iter().any(|t| t.value.is_poison() || s.repeats_sums(t)) {
                s.ledger.speculation.refuse();
            }
        });
        if looped.is_some() {
            out.append(&mut terms);
        }
        looped.is_some()
    }

    /// The terms of a range that stays a loop, weighted with the volumes of cells where they are.
    fn looped_terms(
        &mut self,
        Looped { binder, range: (low, high), domain }: Looped<'_>,
        bound: &mut dyn FnMut(Cell) -> Bound,
        reduced: Reduced<'_>,
        place: &Place,
        out: &mut Vec<Term>,
    ) {
        let span = reduced.body.span;
        let pieces = self.cells(low, high, binder.span, place, &mut |s, cell, inner| {
            let inner = inner.bind(&binder.name.text, bound(cell));
            let mut list = Vec::new();
            s.terms(reduced, &inner, &mut list);
            if reduced.indexed {
                let index = match (domain, bound(cell)) {
                    (Some(domain), _) => grid::cell_centre(s, domain, cell),
                    (None, Bound::Run(_)) => s.values().run_value(cell),
                    _ => s.values().run_value(cell.shifted(1)),
                };
                list.iter_mut().for_each(|t| t.index = index.clone());
            }
            if let Some(domain) = domain.filter(|_| reduced.kind == Terms::Weighted) {
                for term in &mut list {
                    let volume = grid::cell_volume(s, domain, cell);
                    term.weight = Some(match term.weight.take() {
                        Some(w) => operators::arithmetic(s, BinaryOp::Mul, (w, span), (volume, span), span),
                        None => volume,
                    });
                }
            }
            list
        });
        for (cell, list) in pieces {
            for mut term in list {
                if let Some(v) = cell.along {
                    term.loops.push((v, cell.count as u32));
                }
                out.push(term);
            }
        }
    }

    /// Returns `true` if a term has sums that depend on its loops and not on those around it. As a
    /// loop it would compute them again for each outer pass; unrolled, they are shared.
    fn repeats_sums(&self, term: &Term) -> bool {
        let own = term.loops.iter().fold(0, |bits, (v, _)| bits | 1 << v.0);
        let around = self.exprs.free(term.value.expr) & !own;
        self.exprs.has_reduction(term.value.expr, |free| free & own != 0 && around & !free != 0)
    }

    pub(in crate::elaborate::lower) fn fold(&mut self, terms: Vec<Term>, op: ReduceFn, span: Span) -> Value {
        if terms.is_empty() {
            return match op {
                ReduceFn::Sum => Value { expr: self.exprs.constant(0.0), unit: Measure::Nothing },
                ReduceFn::Product => Value::bare(self.exprs.constant(1.0)),
                _ => self.fault(Diagnostic::error(codes::EMPTY_SET, "the least or greatest of nothing", span)),
            };
        }
        // One term that stands for many, or that may be left out.
        let repeated = |t: &&Term| !t.loops.is_empty() || t.keep.is_some();
        if op == ReduceFn::Sum
            && let Some((Measure::Of(unit), at)) = terms.iter().find(repeated).map(|t| (&t.value.unit, t.span))
            && units::is_point(unit)
        {
            let unit = unit.clone();
            return self.values().point_fault(&unit, at);
        }
        let mut values = Vec::with_capacity(terms.len());
        for term in terms {
            let expr = self.values().close(&term, op, term.value.expr);
            values.push((Value { expr, unit: term.value.unit }, term.span));
        }
        let mut list = values.into_iter();
        let Some(mut total) = list.next() else { return self.poison() };
        let first = total.1;
        for next in list {
            let v = match op {
                ReduceFn::Sum => operators::arithmetic(self, BinaryOp::Add, total, next, span),
                ReduceFn::Min => self.values().fold_extremum(BinaryFn::Min, vec![total, next], span),
                ReduceFn::Max => self.values().fold_extremum(BinaryFn::Max, vec![total, next], span),
                ReduceFn::Product => operators::arithmetic(self, BinaryOp::Mul, total, next, span),
            };
            total = (v, first);
        }
        total.0
    }

    fn product_of(&mut self, terms: Vec<Term>, span: Span) -> Value {
        if let Some(term) = terms.iter().find(|t| !t.loops.is_empty())
            && !term.value.unit.is_plain()
            && !units::is_dimensionless(&term.value.unit.unit())
        {
            return self.fault(
                Diagnostic::error(codes::NOT_DIMENSIONLESS, "a product over cells takes dimensionless factors", span)
                    .label("its unit would depend on the grid"),
            );
        }
        self.fold(terms, ReduceFn::Product, span)
    }

    /// Mean over members; weighted with the measure over cells.
    fn mean(&mut self, mut terms: Vec<Term>, span: Span) -> Value {
        if terms.is_empty() {
            return self.fault(Diagnostic::error(codes::EMPTY_SET, "the mean of nothing", span));
        }
        if let Some(point) = self.values().as_differences(&mut terms) {
            let mean = self.mean(terms, span);
            return Value { unit: if mean.is_poison() { mean.unit } else { Measure::Of(point) }, ..mean };
        }
        if terms.iter().any(|t| t.weight.is_some()) {
            let weights: Vec<Term> =
                terms.iter().filter_map(|t| t.weight.clone().map(|w| Term { value: w, weight: None, ..t.clone() })).collect();
            let total = self.space_integral(terms, span);
            let measure = self.fold(weights, ReduceFn::Sum, span);
            return operators::arithmetic(self, BinaryOp::Div, (total, span), (measure, span), span);
        }
        // Each term counts where its condition holds.
        let one = Value::bare(self.exprs.constant(1.0));
        let counted = terms.iter().map(|t| Term { value: one.clone(), weight: None, ..t.clone() }).collect();
        let n = self.fold(counted, ReduceFn::Sum, span);
        let total = self.fold(terms, ReduceFn::Sum, span);
        operators::arithmetic(self, BinaryOp::Div, (total, span), (n, span), span)
    }

    fn space_integral(&mut self, terms: Vec<Term>, span: Span) -> Value {
        let mut weighted = Vec::with_capacity(terms.len());
        for term in terms {
            let Some(w) = term.weight.clone() else {
                return self.fault(
                    Diagnostic::error(codes::WRONG_KIND, "`integral(... for z)` runs over the cells of a domain", span)
                        .help("use `sum` over a set"),
                );
            };
            let value = operators::arithmetic(self, BinaryOp::Mul, (w, span), (term.value, span), span);
            weighted.push(Term { value, weight: None, ..term });
        }
        self.fold(weighted, ReduceFn::Sum, span)
    }
}

impl Values<'_> {
    fn quantified(&mut self, terms: Vec<Term>, any: bool, span: Span) -> Value {
        let mut total = self.exprs.truth(!any);
        let zero = self.exprs.constant(0.0);
        for term in terms {
            if !matches!(term.value.unit, Measure::Truth) {
                return self.fault(Diagnostic::error(codes::WRONG_KIND, "`any` and `all` take conditions", span));
            }
            let mut holds = term.value.expr;
            if let Some(c) = term.keep {
                holds = if any {
                    self.exprs.and(c, holds)
                } else {
                    let not = self.exprs.not(c);
                    self.exprs.or(not, holds)
                };
            }
            if !term.loops.is_empty() {
                // Over cells: the greatest (least) of the conditions as numbers.
                let number = self.exprs.number(holds);
                let bare = Term { keep: None, weight: None, ..term };
                let e = self.close(&bare, if any { ReduceFn::Max } else { ReduceFn::Min }, number);
                holds = self.exprs.compare(Compare::Lt, zero, e);
            }
            total = if any { self.exprs.or(total, holds) } else { self.exprs.and(total, holds) };
        }
        Value::truth(total)
    }

    /// A term summed over its loops.
    fn close(&mut self, term: &Term, op: ReduceFn, body: ExprId) -> ExprId {
        let mut e = body;
        if let Some(c) = term.keep {
            let neutral = self.exprs.constant(op.identity());
            e = self.exprs.select(c, e, neutral);
        }
        // Loops were collected from the innermost outwards.
        for &(v, extent) in &term.loops {
            e = self.exprs.reduce(op, v, extent, e);
        }
        e
    }

    /// Makes differences from the zero of their scale of temperatures in degC, whose mean is one
    /// again; the scale, where all are such.
    fn as_differences(&mut self, terms: &mut [Term]) -> Option<Unit> {
        let point = |t: &Term| if let Measure::Of(unit) = &t.value.unit { units::is_point(unit).then(|| unit.clone()) } else { None };
        let scales: Vec<Unit> = terms.iter().map(point).collect::<Option<_>>()?;
        let scale = scales.first()?.clone();
        for (term, own) in terms.iter_mut().zip(&scales) {
            let expr = self.convert(term.value.expr, own, &scale)?;
            term.value = Value::of(expr, units::difference(&scale));
        }
        Some(scale)
    }
}

/// Combination of the terms of a reduction.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::elaborate::lower) enum Terms {
    /// A range of numbers may stay a loop.
    Plain,
    /// So it may, and cells are weighted with their measure.
    Weighted,
    /// Long ranges of factors and the like cannot be differentiated as loops.
    Single,
}

/// A term of a reduction.
#[derive(Clone)]
pub(in crate::elaborate::lower) struct Term {
    pub value: Value,
    /// Source: the body, or the element of a tuple.
    pub span: Span,
    pub keep: Option<ExprId>,
    pub loops: Vec<(LoopVar, u32)>,
    pub weight: Option<Value>,
    /// Number of its member, or centre of its cell, if requested.
    pub index: Value,
}
