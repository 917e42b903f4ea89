//! Expressions: names, operators, reductions.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Ident, UnaryOp};
use smpl_dsl::units::Unit;

use super::names::{Axis, ScopeId, SymbolId, SymbolKind};
use super::quantity::{Measure, Value};
use super::units;
use super::{Bound, Elaborator, Place};
use crate::ir::{Affine, BinaryFn, Builtin, Compare, Expr as Node, ExprId, Flavour, Role};

/// Deepest nest of expressions, definitions expanded; each level takes two kilobytes of stack.
const MAX_NESTING: u32 = 500;

impl<'a> Elaborator<'a> {
    /// Elaborates an expression.
    pub(super) fn value(&mut self, e: &Expr, place: &Place) -> Value {
        if !self.may_elaborate(e.span) {
            return self.poison();
        }
        self.nested(e.span, |s| s.value_of(e, place))
    }

    /// Elaborates one level deeper, unless that is too deep.
    fn nested(&mut self, span: Span, value: impl FnOnce(&mut Self) -> Value) -> Value {
        if self.nesting >= MAX_NESTING {
            return self.fault(
                Diagnostic::error(codes::TOO_LARGE, "definitions within definitions, hundreds deep", span)
                    .help("break the chain: make one of its members a `var` with an equation"),
            );
        }
        self.nesting += 1;
        let v = value(self);
        self.nesting -= 1;
        v
    }

    fn value_of(&mut self, e: &Expr, place: &Place) -> Value {
        match &e.kind {
            ExprKind::Number { value, unit: None } => {
                let expr = self.exprs.constant(*value);
                Value { expr, unit: if *value == 0.0 { Measure::Zero } else { Measure::Bare } }
            }
            ExprKind::Number { value, unit: Some(unit) } => {
                let unit = self.unit(unit, place);
                let expr = self.exprs.constant(*value);
                match unit {
                    Some(unit) => Value::of(expr, unit),
                    None => self.poison(),
                }
            }
            ExprKind::Bool(b) => {
                let expr = self.exprs.truth(*b);
                Value::truth(expr)
            }
            ExprKind::Name(name) => self.name(name, place),
            ExprKind::Member(..) | ExprKind::Index(..) => self.reference(e, place),
            ExprKind::Call { function, arguments } => self.call(e.span, function, arguments, place),
            ExprKind::Reduce { function, body, binders, condition } => {
                self.reduction(e.span, function, body, binders, condition.as_deref(), place)
            }
            ExprKind::Derivative(inner) => self.derivative(e.span, inner, place),
            ExprKind::Unary(op, a) => self.unary(*op, a, place),
            ExprKind::Binary(op, a, b) => self.binary(e.span, *op, a, b, place),
            ExprKind::If(c, a, b) => self.conditional_of(e.span, c, (a, b), place, &mut |s, e| s.value(e, place)),
            ExprKind::As(a, unit) => {
                let Some(target) = self.unit(unit, place) else { return self.poison() };
                let v = self.value(a, place);
                self.put_unit(v, target, a.span)
            }
            ExprKind::Tuple(_) => self.fault(
                Diagnostic::error(codes::WRONG_SHAPE, "a list of values where one value is needed", e.span)
                    .help("reduce it: `sum(x for x in (a, b))`"),
            ),
        }
    }

    /// An expression that must be a truth value.
    pub(super) fn condition(&mut self, e: &Expr, place: &Place) -> ExprId {
        match self.sound_condition(e, place) {
            Some(c) => c,
            None => self.exprs.truth(false),
        }
    }

    /// An expression that must be a truth value; `None` after a report.
    fn sound_condition(&mut self, e: &Expr, place: &Place) -> Option<ExprId> {
        let v = self.value(e, place);
        match v.unit {
            Measure::Truth => Some(v.expr),
            Measure::Poison => None,
            _ => {
                self.report(
                    Diagnostic::error(codes::WRONG_KIND, "a condition is needed here, this is a number", e.span)
                        .help("compare it with something: `x > 0`"),
                );
                None
            }
        }
    }

    /// An expression as a number in `target`; a pure number is taken in it. Reports a mismatch against `what`.
    pub(super) fn number_in(&mut self, e: &Expr, target: &Unit, what: &str, declared: Span, place: &Place) -> ExprId {
        let v = self.declared_value(e, place, &mut |s, v, span| s.in_unit(v, target, span, what, declared), target);
        self.in_unit(v, target, e.span, what, declared)
    }

    /// An expression where a unit is declared. The branches of an `if` stand in that place themselves: each is taken in the unit, by `taken`, so
    /// that a pure number in one of them means the same as alone.
    pub(super) fn declared_value(
        &mut self,
        e: &Expr,
        place: &Place,
        taken: &mut dyn FnMut(&mut Self, Value, Span) -> ExprId,
        unit: &Unit,
    ) -> Value {
        let ExprKind::If(c, a, b) = &e.kind else {
            let v = self.value(e, place);
            return match v.unit {
                Measure::Poison | Measure::Truth => v,
                _ => Value::of(taken(self, v, e.span), unit.clone()),
            };
        };
        self.nested(e.span, |s| s.conditional_of(e.span, c, (a, b), place, &mut |s, e| s.declared_value(e, place, taken, unit)))
    }

    /// A value as a number in `target`; a pure number is taken in it.
    pub(super) fn in_unit(&mut self, v: Value, target: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        match &v.unit {
            Measure::Poison | Measure::Zero | Measure::Bare => v.expr,
            Measure::Truth => {
                self.report(
                    Diagnostic::error(codes::WRONG_KIND, "a number is needed here, this is a condition", span)
                        .help("write `if condition then 1 else 0`"),
                );
                v.expr
            }
            Measure::Of(unit) => {
                let unit = unit.clone();
                // A dimensionless factor on a bare number (`value(x)*uniform(...)`) still is a number of the declared unit.
                if units::is_plain_number(&unit) && !units::is_dimensionless(target) {
                    return v.expr;
                }
                match self.convert(v.expr, &unit, target) {
                    Some(e) => e,
                    None => {
                        self.report(units::mismatch(&unit, target, span, what, declared));
                        v.expr
                    }
                }
            }
        }
    }

    /// A value as a number in `target`, strictly: a dimensionless number does not pass for a quantity.
    pub(super) fn strictly_in(&mut self, v: Value, target: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        match &v.unit {
            Measure::Bare if !units::is_dimensionless(target) => {
                let mut fault = units::mismatch(&Unit::one(), target, span, what, declared);
                if let Some(x) = self.exprs.as_const(v.expr) {
                    fault = fault.help(units::literal(x, target));
                }
                self.report(fault);
                v.expr
            }
            Measure::Of(unit) if units::is_plain_number(unit) && !units::is_dimensionless(target) => {
                self.report(units::mismatch(&unit.clone(), target, span, what, declared));
                v.expr
            }
            Measure::Bare => self.convert(v.expr, &Unit::one(), target).unwrap_or(v.expr),
            _ => self.in_unit(v, target, span, what, declared),
        }
    }

    /// The number of one unit as the number of another one; `None` where the dimensions differ.
    pub(super) fn convert(&mut self, e: ExprId, from: &Unit, to: &Unit) -> Option<ExprId> {
        let (factor, offset) = units::conversion(from, to)?;
        let mut e = e;
        if factor != 1.0 {
            let f = self.exprs.constant(factor);
            e = self.exprs.mul(e, f);
        }
        if offset != 0.0 {
            let o = self.exprs.constant(offset);
            e = self.exprs.add(e, o);
        }
        Some(e)
    }

    /// `v as [unit]`: a pure number gets the unit, a quantity is converted.
    fn put_unit(&mut self, v: Value, target: Unit, span: Span) -> Value {
        match &v.unit {
            Measure::Poison => v,
            Measure::Zero | Measure::Bare => Value::of(v.expr, target),
            Measure::Truth => {
                self.fault(Diagnostic::error(codes::WRONG_KIND, "a condition has no unit", span).label("this is a condition"))
            }
            Measure::Of(unit) => {
                let unit = unit.clone();
                // A number gets the unit, `mg/g` and `%` included; a dimensionless quantity with a scale is a number first.
                if units::is_plain_number(&unit) {
                    return Value::of(v.expr, target);
                }
                if units::is_dimensionless(&unit) && !units::is_dimensionless(&target) {
                    let expr = self.convert(v.expr, &unit, &Unit::one()).unwrap_or(v.expr);
                    return Value::of(expr, target);
                }
                match self.convert(v.expr, &unit, &target) {
                    Some(expr) => Value::of(expr, target),
                    None => self.fault(units::mismatch(&unit, &target, span, "the unit after `as`", Span::default())),
                }
            }
        }
    }

    /// A name by itself.
    pub(super) fn name(&mut self, name: &Ident, place: &Place) -> Value {
        if let Some(bound) = place.bound(&name.text).cloned() {
            return self.bound_value(name.span, &name.text, &bound, place);
        }
        if let Some(symbol) = self.names.lookup(place.scope, &name.text) {
            return self.symbol_value(symbol, &[], name.span, place);
        }
        if let Some(v) = self.schedule_name(name) {
            return v;
        }
        if let Some(v) = self.builtin_name(name, place) {
            return v;
        }
        self.unknown_name(name, place.scope)
    }

    fn unknown_name(&mut self, name: &Ident, scope: ScopeId) -> Value {
        let help = if self.may_suggest() { self.did_you_mean(&name.text, self.names.visible(scope)) } else { None };
        let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown name `{}`", name.text), name.span)
            .label("not declared")
            .maybe_help(help);
        self.fault(d)
    }

    fn bound_value(&mut self, span: Span, name: &str, bound: &Bound, place: &Place) -> Value {
        match bound {
            Bound::Value(v) => v.clone(),
            Bound::Number(e) => Value::bare(*e),
            Bound::Run(numbers) => self.run_value(*numbers),
            Bound::Member(set, index) => match self.names.sets[*set].first {
                Some(first) => {
                    let expr = self.exprs.constant((first + *index as i64) as f64);
                    Value { expr, unit: Measure::Bare }
                }
                None => self.fault(
                    Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is a member of a set, not a number"), span)
                        .help("use it as an index"),
                ),
            },
            Bound::Cell(domain, cell) => self.cell_centre(*domain, *cell),
            Bound::Face(domain, face) => self.face_position_value(*domain, *face),
            Bound::Alias(e, scope, bindings) => {
                let mut inner = place.clone();
                inner.scope = *scope;
                inner.bindings = bindings.clone();
                let e = e.clone();
                self.value(&e, &inner)
            }
            Bound::Element(symbol, at) => self.load(*symbol, *at),
        }
    }

    /// A whole variable's element.
    pub(super) fn load(&mut self, symbol: SymbolId, at: Affine) -> Value {
        let SymbolKind::Variable { var, unit, .. } = &self.names.symbols[symbol].kind else { return self.poison() };
        let (var, unit) = (*var, unit.clone());
        let expr = self.exprs.load(var, Flavour::Value, at);
        Value::of(expr, unit)
    }

    /// A symbol with index expressions.
    pub(super) fn symbol_value(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
        if let Some(v) = self.by_phase(symbol, index, span, place) {
            return v;
        }
        match self.names.symbols[symbol].kind.clone() {
            SymbolKind::Variable { axes, .. } => {
                if let Some(face) = place.face
                    && let Some(v) = self.face_value(symbol, &axes, index, span, face, place)
                {
                    return v;
                }
                match self.address(symbol, &axes, index, span, place) {
                    Some((at, _)) => self.load(symbol, at),
                    None => self.poison(),
                }
            }
            SymbolKind::Let { axes, binders, unit, definition, random, .. } => {
                self.expand_let(symbol, &axes, &binders, unit.as_ref(), definition, random, index, span, place)
            }
            SymbolKind::Table { axes, unit, values } => match self.address(symbol, &axes, index, span, place) {
                Some((at, _)) if at.is_constant() => {
                    let expr = self.exprs.constant(values.get(at.offset as usize).copied().unwrap_or(f64::NAN));
                    Value::of(expr, unit)
                }
                _ => {
                    self.refuse();
                    self.poison()
                }
            },
            SymbolKind::Integer(n) => {
                let expr = self.exprs.constant(n as f64);
                Value { expr, unit: if n == 0 { Measure::Zero } else { Measure::Bare } }
            }
            SymbolKind::Time => {
                let expr = self.exprs.time();
                Value::of(expr, self.time_unit.clone())
            }
            SymbolKind::Flux { .. } => self.flux_at_end(symbol, index, span, place),
            SymbolKind::Faulty => self.poison(),
            SymbolKind::Phase(_) => {
                let name = Ident { text: "phase".to_owned(), span };
                self.schedule_name(&name).unwrap_or_else(|| self.poison())
            }
            kind => {
                let what = match kind {
                    SymbolKind::Def { .. } => "a function; call it with arguments",
                    SymbolKind::TimeTable { .. } => "a function of time; call it, `table(t)`",
                    SymbolKind::Set(_) => "a set; use a member as an index",
                    SymbolKind::Domain(_) => "a domain; bind it with `for`",
                    SymbolKind::Choice { .. } => "a choice; compare it with one of its options",
                    _ => "a component; name one of its variables",
                };
                let path = self.names.symbols[symbol].path.clone();
                let d = Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}"), span);
                self.fault(super::declare::built_ins::note(d, &path))
            }
        }
    }

    #[allow(clippy::too_many_arguments, reason = "the parts of one symbol")]
    fn expand_let(
        &mut self,
        symbol: SymbolId,
        axes: &[Axis],
        binders: &[String],
        unit: Option<&Unit>,
        definition: &Expr,
        random: bool,
        index: &[Expr],
        span: Span,
        place: &Place,
    ) -> Value {
        let Some((_, bounds)) = self.address(symbol, axes, index, span, place) else { return self.poison() };
        // At a face a field index keeps meaning "here", so the expansion is made anew.
        let key = place.face.is_none().then(|| {
            let site = if random { super::Site::Reset } else { place.site };
            (symbol, bounds.iter().map(super::indices::IndexKey::of).collect::<Vec<_>>(), site)
        });
        if let Some(v) = key.as_ref().and_then(|k| self.memo.get(k)) {
            return v.clone();
        }
        if self.expanding.contains(&symbol) {
            let path = self.names.symbols[symbol].path.clone();
            let at = self.names.symbols[symbol].span;
            let chain = self.cycle(symbol);
            return self.fault(
                Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the definition of `{path}` needs itself{chain}"), at)
                    .help("make it a `var` with an equation of its own: then it is solved for"),
            );
        }
        let mut inner = place.clone();
        inner.scope = self.names.symbols[symbol].scope;
        inner.bindings = None;
        if random {
            inner.site = super::Site::Reset;
            inner.depth = 0;
        }
        for (name, bound) in binders.iter().zip(bounds) {
            inner = inner.bind(name, bound);
        }
        self.expanded.insert(symbol);
        self.expanding.push(symbol);
        let outer_stream = random.then(|| {
            let path = self.names.symbols[symbol].path.clone();
            self.random_site.replace((path, crate::model::Instant::Reset))
        });
        // A fault of a definition is its own, whoever asks for it.
        let calls = std::mem::take(&mut self.calls);
        let v = match unit {
            Some(unit) => self.value_of_let(symbol, definition, unit, random, &inner),
            None => self.value(definition, &inner),
        };
        self.calls = calls;
        if let Some(outer) = outer_stream {
            self.random_site = outer;
        }
        self.expanding.pop();
        if let Some(key) = key {
            if self.attempts > 0 {
                self.remembered.push(key.clone());
            }
            self.memo.insert(key, v.clone());
        }
        v
    }

    /// The value of a `let` with a unit, in that unit: strictly, but for a pure number and what is drawn.
    fn value_of_let(&mut self, symbol: SymbolId, definition: &Expr, unit: &Unit, random: bool, place: &Place) -> Value {
        let declared = self.names.symbols[symbol].span;
        let what = format!("`{}`", self.names.symbols[symbol].path);
        let taken = &mut |s: &mut Self, v: Value, span: Span| {
            if random { s.in_unit(v, unit, span, &what, declared) } else { s.strictly_or_bare(v, unit, span, &what, declared) }
        };
        self.declared_value(definition, place, taken, unit)
    }

    /// The way from a definition back to itself, where it has stations.
    pub(super) fn cycle(&self, symbol: SymbolId) -> String {
        let start = self.expanding.iter().position(|&s| s == symbol).unwrap_or(0);
        let ring = &self.expanding[start..];
        if ring.len() < 2 {
            return String::new();
        }
        let path = |s: &SymbolId| format!("`{}`", self.names.symbols[*s].path);
        let stations: Vec<String> = ring.iter().chain([&symbol]).map(path).collect();
        format!(": {}", stations.join(" needs "))
    }

    fn builtin_name(&mut self, name: &Ident, place: &Place) -> Option<Value> {
        let builtin = |s: &mut Self, b: Builtin| s.exprs.load(s.builtins, Flavour::Value, Affine::constant(b as i64));
        Some(match name.text.as_str() {
            "pi" => Value::bare(self.exprs.constant(std::f64::consts::PI)),
            "e" => Value::bare(self.exprs.constant(std::f64::consts::E)),
            "inf" => Value { expr: self.exprs.constant(f64::INFINITY), unit: Measure::Zero },
            "n" | "steps" => Value::bare(builtin(self, Builtin::Steps)),
            "step" => {
                let e = builtin(self, Builtin::StepLength);
                Value::of(e, self.time_unit.clone())
            }
            "clock" => {
                let e = builtin(self, Builtin::Clock);
                Value::of(e, self.time_unit.clone())
            }
            "success" | "failure" | "timeout" | "reward" => {
                return self.outcome_name(name, place).or_else(|| {
                    Some(self.fault(Diagnostic::error(
                        codes::MISPLACED_FUNCTION,
                        format!("`{}` is known at the end of a step: it has a meaning in rewards and in `fail` only", name.text),
                        name.span,
                    )))
                });
            }
            _ => return None,
        })
    }

    /// `d/dt x`
    fn derivative(&mut self, span: Span, inner: &Expr, place: &Place) -> Value {
        let v = self.value(inner, place);
        let Measure::Of(unit) = &v.unit else {
            return if v.is_poison() { v } else { self.not_a_state(span, inner) };
        };
        match self.exprs.node(v.expr) {
            Node::Load { var, flavour: Flavour::Value, at } if self.vars[var].role == Role::State => {
                let expr = self.exprs.load(var, Flavour::Derivative, at);
                Value::of(expr, units::rate(unit, &self.time_unit))
            }
            _ => self.not_a_state(span, inner),
        }
    }

    fn not_a_state(&mut self, span: Span, inner: &Expr) -> Value {
        let help = match &inner.kind {
            ExprKind::Binary(BinaryOp::Mul, a, b) => match (&a.kind, &b.kind) {
                (ExprKind::Name(Ident { text: a, .. }), ExprKind::Name(Ident { text: b, .. })) => format!(
                    "write the product rule, `{a} * d/dt {b} + {b} * d/dt {a}` (one term where the other factor is constant), or make the product a state and divide"
                ),
                _ => "write the product rule, or make the product a state of its own and divide".to_owned(),
            },
            ExprKind::Name(_) | ExprKind::Index(..) | ExprKind::Member(..) => "declare it with `state`".to_owned(),
            _ => "write out the derivative of the expression, or make it a state of its own".to_owned(),
        };
        self.fault(Diagnostic::error(codes::WRONG_KIND, "only a state has a time derivative", span).help(help))
    }

    fn unary(&mut self, op: UnaryOp, a: &Expr, place: &Place) -> Value {
        if op == UnaryOp::Not {
            let Some(c) = self.sound_condition(a, place) else { return self.poison() };
            let expr = self.exprs.not(c);
            return Value::truth(expr);
        }
        let v = self.value(a, place);
        if op == UnaryOp::Plus || v.is_poison() {
            return v;
        }
        match &v.unit {
            Measure::Truth => self.fault(Diagnostic::error(codes::WRONG_KIND, "the negative of a condition", a.span).help("write `not`")),
            // A literal -5 in a declaration of degC is a number, but the negative of a temperature means nothing.
            Measure::Of(unit) if units::is_point(unit) && !matches!(a.kind, ExprKind::Number { .. }) => {
                let unit = unit.clone();
                self.point_fault(&unit, a.span)
            }
            unit => {
                let unit = unit.clone();
                let expr = self.exprs.neg(v.expr);
                Value { expr, unit }
            }
        }
    }

    fn point_fault(&mut self, unit: &Unit, span: Span) -> Value {
        self.fault(
            Diagnostic::error(codes::AFFINE_UNIT, format!("a temperature in {unit} is a point on a scale, not an amount"), span)
                .label(format!("in {unit}"))
                .help("use `kelvin(T)` for the absolute temperature, or a difference of two temperatures"),
        )
    }

    fn binary(&mut self, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
        match op {
            BinaryOp::And | BinaryOp::Or => {
                let (x, y) = (self.sound_condition(a, place), self.sound_condition(b, place));
                let (Some(x), Some(y)) = (x, y) else { return self.poison() };
                let expr = if op == BinaryOp::And { self.exprs.and(x, y) } else { self.exprs.or(x, y) };
                Value::truth(expr)
            }
            BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge | BinaryOp::Eq | BinaryOp::Ne => {
                self.comparison(span, op, a, b, place)
            }
            BinaryOp::Div if self.is_rate_slip(a, b, place) => {
                let what = match &a.kind {
                    ExprKind::Name(name) => name.text.strip_prefix('d').unwrap_or_default().to_owned(),
                    ExprKind::Call { arguments, .. } => arguments.first().map(super::items::reference).unwrap_or_default(),
                    _ => String::new(),
                };
                self.fault(
                    Diagnostic::error(codes::UNKNOWN_NAME, "neither part of this quotient is declared", span)
                        .label("meant as a rate?")
                        .help(format!("a rate is written `d/dt {what}`")),
                )
            }
            _ => {
                let (x, y) = (self.value(a, place), self.value(b, place));
                self.arithmetic(op, (x, a.span), (y, b.span), span)
            }
        }
    }

    /// `dx/dt`, `d(x)/dt` where that means nothing else.
    fn is_rate_slip(&self, a: &Expr, b: &Expr, place: &Place) -> bool {
        let is_free = |name: &str| place.bound(name).is_none() && self.names.lookup(place.scope, name).is_none();
        let by_time = matches!(&b.kind, ExprKind::Name(dt) if dt.text == "dt" && is_free("dt"));
        by_time
            && match &a.kind {
                ExprKind::Name(dx) => dx.text.len() > 1 && dx.text.starts_with('d') && is_free(&dx.text),
                ExprKind::Call { function, .. } => function.text == "d" && is_free("d"),
                _ => false,
            }
    }

    /// `a + b` and so on, on values.
    pub(super) fn arithmetic(&mut self, op: BinaryOp, a: (Value, Span), b: (Value, Span), span: Span) -> Value {
        if a.0.is_poison() || b.0.is_poison() {
            return self.poison();
        }
        for (v, s) in [&a, &b] {
            if matches!(v.unit, Measure::Truth) {
                return self.fault(
                    Diagnostic::error(codes::WRONG_KIND, "arithmetic with a condition", *s).help("write `if condition then 1 else 0`"),
                );
            }
        }
        match op {
            BinaryOp::Add | BinaryOp::Sub => self.sum(op, a, b, span),
            BinaryOp::Mul | BinaryOp::Div => self.product(op, a, b),
            _ => self.power(a, b),
        }
    }

    fn sum(&mut self, op: BinaryOp, (a, sa): (Value, Span), (b, sb): (Value, Span), span: Span) -> Value {
        let f = if op == BinaryOp::Add { BinaryFn::Add } else { BinaryFn::Sub };
        let unit = match (&a.unit, &b.unit) {
            (Measure::Zero | Measure::Bare, Measure::Zero | Measure::Bare) => {
                let expr = self.exprs.binary(f, a.expr, b.expr);
                return Value::bare(expr);
            }
            (Measure::Zero, m) | (m, Measure::Zero) => {
                let unit = m.clone();
                let expr = self.exprs.binary(f, a.expr, b.expr);
                return Value { expr, unit };
            }
            (m, n) => (m.unit(), n.unit()),
        };
        let (ua, ub) = unit;
        self.warn_of_scale((&a, sa), (&b, sb));
        // Points on a scale: point - point is a difference, point ± difference is a point.
        let result = match (units::is_point(&ua), units::is_point(&ub)) {
            (false, false) => ua.clone(),
            (true, true) if op == BinaryOp::Sub => units::difference(&ua),
            (true, false) => ua.clone(),
            (false, true) if op == BinaryOp::Add => ub.clone(),
            _ => return self.point_fault(&ub, sb),
        };
        let target = match (units::is_point(&ua), units::is_point(&ub)) {
            (true, true) => ua.clone(),
            (true, false) => units::difference(&ua),
            _ => ua.clone(),
        };
        let left =
            if units::is_point(&ub) && !units::is_point(&ua) { self.convert(a.expr, &ua, &units::difference(&ub)) } else { Some(a.expr) };
        let right = if units::is_point(&ub) && !units::is_point(&ua) { Some(b.expr) } else { self.convert(b.expr, &ub, &target) };
        let (Some(left), Some(right)) = (left, right) else {
            let verb = if op == BinaryOp::Add { "added" } else { "subtracted" };
            let d = units::clash(&ua, sa, &ub, sb, span, verb);
            let d = self.with_literal(d, (&a, &units::difference(&ua)), (&b, &units::difference(&ub)));
            return self.fault(d);
        };
        let expr = self.exprs.binary(f, left, right);
        Value::of(expr, result)
    }

    /// Warns of a number without a unit beside a percentage or the like, where it is easily meant as one too.
    pub(super) fn warn_of_scale(&mut self, (a, sa): (&Value, Span), (b, sb): (&Value, Span)) {
        for ((number, span), quantity) in [((a, sa), b), ((b, sb), a)] {
            if let (Measure::Bare, Measure::Of(unit)) = (&number.unit, &quantity.unit)
                && units::is_dimensionless(unit)
                && units::conversion(&Unit::one(), unit).is_some_and(|(factor, _)| factor != 1.0)
            {
                let x = self.exprs.as_const(number.expr);
                self.report(units::bare_beside(x, unit, span));
            }
        }
    }

    /// The hint for a literal number that lacks its unit.
    fn with_literal(&self, d: Diagnostic, (a, ua): (&Value, &Unit), (b, ub): (&Value, &Unit)) -> Diagnostic {
        for (number, other) in [(b, ua), (a, ub)] {
            if let (Measure::Bare, Some(x)) = (&number.unit, self.exprs.as_const(number.expr)) {
                return d.help(units::literal(x, other));
            }
        }
        d
    }

    fn product(&mut self, op: BinaryOp, (a, sa): (Value, Span), (b, sb): (Value, Span)) -> Value {
        for (v, s) in [(&a, sa), (&b, sb)] {
            if let Measure::Of(u) = &v.unit
                && units::is_point(u)
            {
                let u = u.clone();
                return self.point_fault(&u, s);
            }
        }
        let f = if op == BinaryOp::Mul { BinaryFn::Mul } else { BinaryFn::Div };
        let expr = self.exprs.binary(f, a.expr, b.expr);
        if a.unit.is_plain() && b.unit.is_plain() {
            return Value::bare(expr);
        }
        let (ua, ub) = (a.unit.unit(), b.unit.unit());
        let unit = if op == BinaryOp::Mul { units::times(&ua, &ub) } else { units::over(&ua, &ub) };
        Value::of(expr, unit)
    }

    fn power(&mut self, (a, sa): (Value, Span), (b, sb): (Value, Span)) -> Value {
        let exponent = match &b.unit {
            Measure::Of(u) => {
                let u = u.clone();
                match self.convert(b.expr, &u, &Unit::one()) {
                    Some(e) => e,
                    None => {
                        return self.fault(
                            Diagnostic::error(codes::NOT_DIMENSIONLESS, "an exponent must be dimensionless", sb).label(units::describe(&u)),
                        );
                    }
                }
            }
            _ => b.expr,
        };
        // Powers of whole numbers are products.
        if self.exprs.free(exponent) != 0 {
            self.refuse();
        }
        let unit = match &a.unit {
            Measure::Of(u) if units::is_point(u) => {
                let u = u.clone();
                return self.point_fault(&u, sa);
            }
            Measure::Of(u) if !units::is_dimensionless(u) => {
                let u = u.clone();
                let power = self.constant_value(exponent).and_then(|x| units::power(&u, x));
                match power {
                    Some(unit) => Measure::Of(unit),
                    None => {
                        return self.fault(
                            Diagnostic::error(codes::NOT_DIMENSIONLESS, "only a simple constant power of a quantity has a unit", sa)
                                .label(units::describe(&u))
                                .secondary(sb, "this exponent is not a simple fraction")
                                .help("divide the base by a reference of its unit, or take the unit off: `value(x)^p`"),
                        );
                    }
                }
            }
            Measure::Of(u) => {
                let u = u.clone();
                let base = self.convert(a.expr, &u, &Unit::one()).unwrap_or(a.expr);
                let expr = self.exprs.binary(BinaryFn::Pow, base, exponent);
                return Value::of(expr, Unit::one());
            }
            m => m.clone(),
        };
        let unit = if matches!(unit, Measure::Zero) { Measure::Bare } else { unit };
        let expr = self.exprs.binary(BinaryFn::Pow, a.expr, exponent);
        Value { expr, unit }
    }

    fn comparison(&mut self, span: Span, op: BinaryOp, a: &Expr, b: &Expr, place: &Place) -> Value {
        if let Some(v) = self.phase_comparison(a, b, place) {
            return match op {
                BinaryOp::Eq => v,
                BinaryOp::Ne if v.is_poison() => v,
                BinaryOp::Ne => Value::truth(self.exprs.not(v.expr)),
                _ => self.fault(Diagnostic::error(codes::WRONG_KIND, "phases have no order; compare with `==` or `!=`", span)),
            };
        }
        if let Some(equal) = self.name_comparison(a, b, place) {
            return match (op, equal) {
                (_, None) => self.poison(),
                (BinaryOp::Eq, Some(equal)) => Value::truth(self.exprs.truth(equal)),
                (BinaryOp::Ne, Some(equal)) => Value::truth(self.exprs.truth(!equal)),
                _ => self.fault(Diagnostic::error(codes::WRONG_KIND, "names have no order; compare with `==` or `!=`", span)),
            };
        }
        if let Some(holds) = self.run_comparison(op, a, b, place) {
            return Value::truth(self.exprs.truth(holds));
        }
        let (x, y) = (self.value(a, place), self.value(b, place));
        let Some((l, r)) = self.common(&x, a.span, &y, b.span, span) else { return self.poison() };
        let expr = match op {
            BinaryOp::Lt => self.exprs.compare(Compare::Lt, l, r),
            BinaryOp::Le => self.exprs.compare(Compare::Le, l, r),
            BinaryOp::Gt => self.exprs.compare(Compare::Lt, r, l),
            BinaryOp::Ge => self.exprs.compare(Compare::Le, r, l),
            BinaryOp::Eq => self.exprs.compare(Compare::Eq, l, r),
            _ => self.exprs.compare(Compare::Ne, l, r),
        };
        Value::truth(expr)
    }

    /// Both values as numbers of the first one's unit (points stay points); reports a clash.
    pub(super) fn common(&mut self, a: &Value, sa: Span, b: &Value, sb: Span, span: Span) -> Option<(ExprId, ExprId)> {
        self.common_for(a, sa, b, sb, span, "compared")
    }

    /// As [`Self::common`], with the word for what the two are put together for.
    fn common_for(&mut self, a: &Value, sa: Span, b: &Value, sb: Span, span: Span, verb: &str) -> Option<(ExprId, ExprId)> {
        if a.is_poison() || b.is_poison() {
            return None;
        }
        match (&a.unit, &b.unit) {
            (Measure::Truth, Measure::Truth) => {
                self.report(
                    Diagnostic::error(codes::WRONG_KIND, "conditions are not compared", span).help("combine them with `and`, `or`, `not`"),
                );
                None
            }
            (Measure::Truth, _) | (_, Measure::Truth) => {
                self.report(Diagnostic::error(codes::WRONG_KIND, "a condition meets a number", span));
                None
            }
            (Measure::Zero, _) | (_, Measure::Zero) => Some((a.expr, b.expr)),
            (m, n) => {
                let (ua, ub) = (m.unit(), n.unit());
                self.warn_of_scale((a, sa), (b, sb));
                match self.convert(b.expr, &ub, &ua) {
                    Some(r) if units::is_point(&ua) == units::is_point(&ub) => Some((a.expr, r)),
                    _ => {
                        let d = units::clash(&ua, sa, &ub, sb, span, verb);
                        let d = self.with_literal(d, (a, &ua), (b, &ub));
                        self.report(d);
                        None
                    }
                }
            }
        }
    }

    /// `if c then a else b`, with the way to elaborate a branch.
    fn conditional_of(
        &mut self,
        span: Span,
        c: &Expr,
        (a, b): (&Expr, &Expr),
        place: &Place,
        branch: &mut dyn FnMut(&mut Self, &Expr) -> Value,
    ) -> Value {
        let Some(condition) = self.sound_condition(c, place) else {
            // The branches may have faults of their own.
            branch(self, a);
            branch(self, b);
            return self.poison();
        };
        // What the compiler can decide is decided: the other branch need not even have a meaning here.
        if let Node::Truth(holds) = self.exprs.node(condition) {
            return branch(self, if holds { a } else { b });
        }
        let (x, y) = (branch(self, a), branch(self, b));
        self.choose(condition, (x, a.span), (y, b.span), span)
    }

    /// `if c then a else b` on values.
    pub(super) fn choose(&mut self, c: ExprId, (a, sa): (Value, Span), (b, sb): (Value, Span), span: Span) -> Value {
        if a.is_poison() || b.is_poison() {
            return self.poison();
        }
        if matches!((&a.unit, &b.unit), (Measure::Truth, Measure::Truth)) {
            let expr = self.exprs.select(c, a.expr, b.expr);
            return Value::truth(expr);
        }
        let unit = a.unit.beside(&b.unit);
        let Some((l, r)) = self.common_for(&a, sa, &b, sb, span, "branches of one `if`") else { return self.poison() };
        let expr = self.exprs.select(c, l, r);
        Value { expr, unit }
    }

    /// A function of a dimensionless number.
    pub(super) fn dimensionless(&mut self, v: &Value, span: Span, function: &str) -> Option<ExprId> {
        match &v.unit {
            Measure::Poison => None,
            Measure::Zero | Measure::Bare => Some(v.expr),
            Measure::Truth => {
                self.report(Diagnostic::error(codes::WRONG_KIND, format!("`{function}` of a condition"), span));
                None
            }
            Measure::Of(u) => {
                let u = u.clone();
                let converted = self.convert(v.expr, &u, &Unit::one());
                if converted.is_none() {
                    self.report(
                        Diagnostic::error(
                            codes::NOT_DIMENSIONLESS,
                            format!("`{function}` takes a dimensionless number, this is {}", units::describe(&u)),
                            span,
                        )
                        .label(units::describe(&u))
                        .help("divide by a reference of the same dimension"),
                    );
                }
                converted
            }
        }
    }
}
