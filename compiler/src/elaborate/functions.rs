//! Function calls and reductions.

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, BinderSet, Expr, ExprKind, Ident, TimeTableKind};
use smpl_dsl::units::Unit;

use super::cells::Cell;
use super::names::{Axis, SymbolId, SymbolKind};
use super::quantity::{Measure, Value};
use super::{Bound, Elaborator, Place, Site, units};
use crate::ir::{Affine, BinaryFn, Compare, Expr as Node, ExprId, Flavour, LoopVar, ReduceFn, Role, UnaryFn};
use crate::model::{Draw, Instant, Quantity, Variate};

/// Functions that every model knows, for suggestions.
const FUNCTIONS: &[&str] = &[
    "abs",
    "sqrt",
    "sq",
    "exp",
    "ln",
    "log10",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sinh",
    "cosh",
    "tanh",
    "min",
    "max",
    "clip",
    "sign",
    "floor",
    "ceil",
    "round",
    "single",
    "initial",
    "previous",
    "steady",
    "integral",
    "der",
    "kelvin",
    "value",
    "low",
    "high",
    "scale",
    "nominal",
    "outside",
    "inside",
    "uniform",
    "normal",
    "lognormal",
    "div",
    "grad",
    "upwind",
    "width",
    "volume",
    "sum",
    "product",
    "mean",
    "any",
    "all",
    "mod",
];

impl Elaborator<'_> {
    /// `f(a, b)`
    pub(super) fn call(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if let Some(symbol) = self.names.lookup(place.scope, &function.text) {
            match self.names.symbols[symbol].kind.clone() {
                SymbolKind::Def { parameters, body } => return self.expand_def(span, symbol, parameters, body, arguments, place),
                SymbolKind::TimeTable { .. } => return self.time_table(span, symbol, arguments, place),
                _ => {}
            }
        }
        let one = |s: &mut Self| s.argument(span, function, arguments, 1).then(|| &arguments[0]);
        match function.text.as_str() {
            "exp" | "ln" | "log10" | "sin" | "cos" | "tan" | "asin" | "acos" | "atan" | "sinh" | "cosh" | "tanh" => {
                let Some(a) = one(self) else { return self.poison() };
                self.elementary(function, a, place)
            }
            "abs" | "floor" | "ceil" | "round" | "single" | "sign" => {
                let Some(a) = one(self) else { return self.poison() };
                self.keeping_unit(function, a, place)
            }
            "sqrt" | "sq" => {
                let Some(a) = one(self) else { return self.poison() };
                let v = self.value(a, place);
                let exponent = self.exprs.constant(if function.text == "sqrt" { 0.5 } else { 2.0 });
                self.arithmetic(BinaryOp::Pow, (v, a.span), (Value::bare(exponent), span), span)
            }
            "min" | "max" => self.extremum(span, function, arguments, place),
            "clip" => self.clip(span, function, arguments, place),
            "atan2" => self.atan2(span, function, arguments, place),
            "mod" => self.modulo(span, function, arguments, place),
            "der" => {
                let Some(a) = one(self) else { return self.poison() };
                let inner = Expr { span, kind: ExprKind::Derivative(Box::new(a.clone())) };
                self.value(&inner, place)
            }
            "initial" | "previous" | "steady" => {
                let Some(a) = one(self) else { return self.poison() };
                self.flavoured(span, function, a, place)
            }
            "integral" => {
                let Some(a) = one(self) else { return self.poison() };
                self.quadrature(span, a, place)
            }
            "kelvin" => {
                let Some(a) = one(self) else { return self.poison() };
                self.kelvin(a, place)
            }
            "value" => self.plain_value(span, function, arguments, place),
            "low" | "high" | "scale" | "nominal" => {
                let Some(a) = one(self) else { return self.poison() };
                self.attribute(span, function, a, place)
            }
            "outside" | "inside" => {
                let Some(a) = one(self) else { return self.poison() };
                self.box_condition(function, a, place)
            }
            "uniform" | "normal" | "lognormal" => self.random(span, function, arguments, place),
            "div" => {
                let Some(a) = one(self) else { return self.poison() };
                self.divergence(span, a, place)
            }
            "grad" => {
                let Some(a) = one(self) else { return self.poison() };
                self.gradient(span, a, place)
            }
            "upwind" => {
                if !self.argument(span, function, arguments, 2) {
                    return self.poison();
                }
                self.upwind(span, &arguments[0], &arguments[1], place)
            }
            "width" | "volume" => {
                let Some(a) = one(self) else { return self.poison() };
                self.cell_size(span, function, a, place)
            }
            _ => self.unknown_function(function, place),
        }
    }

    fn unknown_function(&mut self, function: &Ident, place: &Place) -> Value {
        let name = &function.text;
        let declared = self.names.lookup(place.scope, name);
        if let Some(symbol) = declared {
            let at = self.names.symbols[symbol].span;
            return self.fault(
                Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is no function"), function.span)
                    .secondary(at, "declared here")
                    .help(format!("multiply with `*`: `{name} * (...)`")),
            );
        }
        let visible = self.names.visible(place.scope);
        let help = match name.as_str() {
            "log" => Some("write `ln` for the natural logarithm, `log10` for the decimal one".to_owned()),
            "pow" => Some("write `x^y`".to_owned()),
            _ => did_you_mean(name, FUNCTIONS.iter().copied().chain(visible)),
        };
        let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown function `{name}`"), function.span).maybe_help(help);
        self.fault(d)
    }

    /// Reports a wrong number of arguments.
    fn argument(&mut self, span: Span, function: &Ident, arguments: &[Expr], wanted: usize) -> bool {
        if arguments.len() != wanted {
            let plural = if wanted == 1 { "" } else { "s" };
            self.report(Diagnostic::error(
                codes::WRONG_ARGUMENTS,
                format!("`{}` takes {wanted} argument{plural}, not {}", function.text, arguments.len()),
                span,
            ));
        }
        arguments.len() == wanted
    }

    fn expand_def(&mut self, span: Span, symbol: SymbolId, parameters: &[Ident], body: &Expr, arguments: &[Expr], place: &Place) -> Value {
        let path = self.names.symbols[symbol].path.clone();
        if parameters.len() != arguments.len() {
            let declared = self.names.symbols[symbol].span;
            return self.fault(
                Diagnostic::error(
                    codes::WRONG_ARGUMENTS,
                    format!("`{path}` takes {} arguments, not {}", parameters.len(), arguments.len()),
                    span,
                )
                .secondary(declared, "declared here"),
            );
        }
        if self.expanding.contains(&symbol) {
            let declared = self.names.symbols[symbol].span;
            let chain = self.cycle(symbol);
            return self.fault(
                Diagnostic::error(codes::CYCLIC_DEFINITION, format!("`{path}` calls itself{chain}"), declared)
                    .help("functions are expanded where they are called, so none can call itself"),
            );
        }
        let mut inner = place.clone();
        inner.scope = self.names.symbols[symbol].scope;
        inner.bindings = None;
        for (parameter, argument) in parameters.iter().zip(arguments) {
            let v = self.value(argument, place);
            inner = inner.bind(&parameter.text, Bound::Value(v));
        }
        self.expanding.push(symbol);
        self.calls.push(span);
        let v = self.value(body, &inner);
        self.calls.pop();
        self.expanding.pop();
        v
    }

    fn elementary(&mut self, function: &Ident, a: &Expr, place: &Place) -> Value {
        let v = self.value(a, place);
        let f = match function.text.as_str() {
            "exp" => UnaryFn::Exp,
            "ln" => UnaryFn::Ln,
            "log10" => UnaryFn::Log10,
            "sin" => UnaryFn::Sin,
            "cos" => UnaryFn::Cos,
            "tan" => UnaryFn::Tan,
            "asin" => UnaryFn::Asin,
            "acos" => UnaryFn::Acos,
            "atan" => UnaryFn::Atan,
            "sinh" => UnaryFn::Sinh,
            "cosh" => UnaryFn::Cosh,
            _ => UnaryFn::Tanh,
        };
        match self.dimensionless(&v, a.span, &function.text) {
            Some(x) => {
                let expr = self.exprs.unary(f, x);
                if v.unit.is_plain() { Value::bare(expr) } else { Value::of(expr, Unit::one()) }
            }
            None => self.poison(),
        }
    }

    fn keeping_unit(&mut self, function: &Ident, a: &Expr, place: &Place) -> Value {
        let v = self.value(a, place);
        let (f, is_amount) = match function.text.as_str() {
            "abs" => (UnaryFn::Abs, true),
            "sign" => (UnaryFn::Sign, true),
            "floor" => (UnaryFn::Floor, false),
            "ceil" => (UnaryFn::Ceil, false),
            "single" => (UnaryFn::Single, false),
            _ => (UnaryFn::Round, false),
        };
        match &v.unit {
            Measure::Poison => v,
            Measure::Truth => self.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{}` of a condition", function.text), a.span)),
            Measure::Of(u) if is_amount && units::is_point(u) => self.fault(
                Diagnostic::error(codes::AFFINE_UNIT, format!("`{}` of a point on a temperature scale", function.text), a.span)
                    .help("use `kelvin(T)`, or a difference of two temperatures"),
            ),
            unit => {
                let unit = if f == UnaryFn::Sign { Measure::Bare } else { unit.clone() };
                let expr = self.exprs.unary(f, v.expr);
                Value { expr, unit }
            }
        }
    }

    fn extremum(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if arguments.len() < 2 {
            return self.fault(
                Diagnostic::error(codes::WRONG_ARGUMENTS, format!("`{}` takes two or more arguments", function.text), span)
                    .help(format!("over a set: `{}(x[i] for i in set)`", function.text)),
            );
        }
        let f = if function.text == "min" { BinaryFn::Min } else { BinaryFn::Max };
        let values: Vec<(Value, Span)> = arguments.iter().map(|a| (self.value(a, place), a.span)).collect();
        self.fold_extremum(f, values, span)
    }

    fn fold_extremum(&mut self, f: BinaryFn, values: Vec<(Value, Span)>, span: Span) -> Value {
        let mut list = values.into_iter();
        let Some(mut best) = list.next() else { return self.poison() };
        for next in list {
            let Some((l, r)) = self.common(&best.0, best.1, &next.0, next.1, span) else { return self.poison() };
            let expr = self.exprs.binary(f, l, r);
            let unit = if matches!(best.0.unit, Measure::Zero) { next.0.unit } else { best.0.unit };
            best = (Value { expr, unit }, best.1);
        }
        best.0
    }

    fn clip(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if !self.argument(span, function, arguments, 3) {
            return self.poison();
        }
        let v: Vec<(Value, Span)> = arguments.iter().map(|a| (self.value(a, place), a.span)).collect();
        let [x, low, high] = &v[..] else { return self.poison() };
        let above = self.fold_extremum(BinaryFn::Max, vec![x.clone(), low.clone()], span);
        self.fold_extremum(BinaryFn::Min, vec![(above, x.1), high.clone()], span)
    }

    fn atan2(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if !self.argument(span, function, arguments, 2) {
            return self.poison();
        }
        let (a, b) = (self.value(&arguments[0], place), self.value(&arguments[1], place));
        let Some((l, r)) = self.common(&a, arguments[0].span, &b, arguments[1].span, span) else { return self.poison() };
        let expr = self.exprs.binary(BinaryFn::Atan2, l, r);
        Value::of(expr, Unit::one())
    }

    /// `mod(a, b)`: what is left of `a` after whole multiples of `b`, with the sign of `b`.
    fn modulo(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if !self.argument(span, function, arguments, 2) {
            return self.poison();
        }
        let (a, b) = (self.value(&arguments[0], place), self.value(&arguments[1], place));
        let Some((l, r)) = self.common(&a, arguments[0].span, &b, arguments[1].span, span) else { return self.poison() };
        let ratio = self.exprs.div(l, r);
        let whole = self.exprs.unary(UnaryFn::Floor, ratio);
        let multiple = self.exprs.mul(r, whole);
        let expr = self.exprs.sub(l, multiple);
        Value { expr, unit: a.unit }
    }

    /// `initial(e)`, `previous(e)`, `steady(e)`: `e` with every variable read from another frame.
    fn flavoured(&mut self, span: Span, function: &Ident, a: &Expr, place: &Place) -> Value {
        let flavour = match function.text.as_str() {
            "initial" => Flavour::Initial,
            "previous" => Flavour::Previous,
            _ => {
                self.uses_steady = true;
                Flavour::Steady
            }
        };
        let v = self.value(a, place);
        if v.is_poison() {
            return v;
        }
        let vars = &self.vars;
        let mut misuse = false;
        let mut exprs = std::mem::take(&mut self.exprs);
        let expr = exprs.rewrite(v.expr, &mut HashMap::new(), &mut |exprs, node| match node {
            Node::Load { var, flavour: Flavour::Value, at } => match vars[var].role {
                Role::State | Role::Algebraic | Role::Action | Role::Discrete | Role::Disturbance => Some(exprs.load(var, flavour, at)),
                Role::Quadrature => {
                    misuse = true;
                    None
                }
                _ => None,
            },
            Node::Load { flavour: Flavour::Derivative, .. } => {
                misuse = true;
                None
            }
            _ => None,
        });
        self.exprs = exprs;
        if misuse {
            return self.fault(Diagnostic::error(
                codes::MISPLACED_FUNCTION,
                format!("`{}` of a derivative or an integral over the step", function.text),
                span,
            ));
        }
        Value { expr, unit: v.unit }
    }

    /// `integral(e)`: over the present step.
    fn quadrature(&mut self, span: Span, a: &Expr, place: &Place) -> Value {
        if place.site != Site::Instant || place.depth > 0 {
            return self.fault(
                Diagnostic::error(
                    codes::MISPLACED_FUNCTION,
                    "`integral` over the step has a meaning in rewards, conditions and observations only",
                    span,
                )
                .help("declare a state with `d/dt m = ...` to use an integral in equations"),
            );
        }
        let v = self.value(a, place);
        let unit = match &v.unit {
            Measure::Poison => return v,
            Measure::Of(u) => units::times(u, &self.time_unit),
            _ => self.time_unit.clone(),
        };
        let at = match self.quadratures.iter().position(|&q| q == v.expr) {
            Some(at) => at,
            None => {
                self.quadratures.push(v.expr);
                self.quadratures.len() - 1
            }
        };
        let expr = self.exprs.load(self.quadratures_var, Flavour::Value, Affine::constant(at as i64));
        Value::of(expr, unit)
    }

    fn kelvin(&mut self, a: &Expr, place: &Place) -> Value {
        let v = self.value(a, place);
        let Some(kelvin) = Unit::named("K") else { return self.poison() };
        match &v.unit {
            Measure::Poison => v,
            Measure::Of(u) => match u.conversion_to(&kelvin) {
                Some(c) => {
                    let (f, o) = (self.exprs.constant(c.factor), self.exprs.constant(c.offset));
                    let scaled = self.exprs.mul(v.expr, f);
                    let expr = self.exprs.add(scaled, o);
                    Value::of(expr, kelvin)
                }
                None => {
                    let u = u.clone();
                    self.fault(Diagnostic::error(codes::UNIT_MISMATCH, "`kelvin` takes a temperature", a.span).label(units::describe(&u)))
                }
            },
            _ => self.fault(
                Diagnostic::error(codes::UNIT_MISMATCH, "`kelvin` takes a temperature, this is a pure number", a.span)
                    .help("give the number its unit: `25 [degC]`"),
            ),
        }
    }

    /// `value(x)`, `value(x, unit)`
    fn plain_value(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        let Some(first) = arguments.first().filter(|_| arguments.len() <= 2) else {
            self.argument(span, function, arguments, 1);
            return self.poison();
        };
        let v = self.value(first, place);
        if v.is_poison() {
            return v;
        }
        let Some(second) = arguments.get(1) else { return Value::bare(v.expr) };
        let Some(unit) = self.unit_argument(second, place) else { return self.poison() };
        let from = v.unit.unit();
        // An absolute temperature may be asked for on another scale.
        match from.conversion_to(&unit).filter(|_| from.commensurable(&unit)) {
            Some(c) => {
                let (f, o) = (self.exprs.constant(c.factor), self.exprs.constant(c.offset));
                let scaled = self.exprs.mul(v.expr, f);
                let expr = self.exprs.add(scaled, o);
                Value::bare(expr)
            }
            None => self.fault(units::mismatch(&from, &unit, first.span, "the unit asked for", second.span)),
        }
    }

    /// The variable whose element an expression is.
    pub(super) fn element(&mut self, v: &Value, span: Span) -> Option<(crate::ir::VarId, Affine)> {
        if v.is_poison() {
            return None;
        }
        match self.exprs.node(v.expr) {
            Node::Load { var, at, .. } if self.quantities.contains_key(&var) => Some((var, at)),
            _ => {
                self.report(Diagnostic::error(codes::WRONG_KIND, "a declared variable is needed here", span).label("not a variable"));
                None
            }
        }
    }

    /// `low(x)`, `high(x)`, `scale(x)`, `nominal(x)`
    fn attribute(&mut self, span: Span, function: &Ident, a: &Expr, place: &Place) -> Value {
        let v = self.value(a, place);
        let Some((var, at)) = self.element(&v, a.span) else { return self.poison() };
        let Some(q) = self.quantities.get(&var) else { return self.poison() };
        let list = match function.text.as_str() {
            "low" => &q.low,
            "high" => &q.high,
            "scale" => &q.scale,
            _ => &q.default,
        };
        let uniform = list.windows(2).all(|w| w[0] == w[1]);
        if !uniform && !at.is_constant() {
            return self.fault(Diagnostic::error(
                codes::WRONG_SHAPE,
                format!("`{}` differs from element to element here", function.text),
                span,
            ));
        }
        let x = Quantity::pick(list, at.offset.max(0) as usize);
        let expr = self.exprs.constant(x);
        let unit = v.unit.unit();
        Value::of(expr, if function.text == "scale" { units::difference(&unit) } else { unit })
    }

    /// `uniform(a, b)`, `normal(mean, sd)`, `lognormal(mu, sigma)`: a standard variate in its own slot, scaled.
    fn random(&mut self, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
        if !self.argument(span, function, arguments, 2) {
            return self.poison();
        }
        let Some((stream, instant)) = self.random_site.clone() else {
            return self.fault(
                Diagnostic::error(codes::MISPLACED_FUNCTION, format!("`{}` has no meaning here", function.text), span)
                    .help("random numbers are drawn in `param ... ~`, `initial ... ~`, `random ... ~`, `disturbance ... ~` and `noise`"),
            );
        };
        let kind = if function.text == "uniform" { Variate::Uniform } else { Variate::Normal };
        let (a, b) = (self.value(&arguments[0], place), self.value(&arguments[1], place));
        let draw = self.draw(&stream, kind, instant, place);
        let draw = (Value::bare(draw), span);
        let (a, b) = ((a, arguments[0].span), (b, arguments[1].span));
        if function.text == "uniform" {
            let width = self.arithmetic(BinaryOp::Sub, b, a.clone(), span);
            let part = self.arithmetic(BinaryOp::Mul, (width, span), draw, span);
            return self.arithmetic(BinaryOp::Add, a, (part, span), span);
        }
        let part = self.arithmetic(BinaryOp::Mul, b, draw, span);
        let x = self.arithmetic(BinaryOp::Add, a, (part, span), span);
        if function.text == "normal" {
            return x;
        }
        match self.dimensionless(&x, span, "lognormal") {
            Some(e) => {
                let expr = self.exprs.unary(UnaryFn::Exp, e);
                Value::bare(expr)
            }
            None => self.poison(),
        }
    }

    /// New slots for a random number: one for every pass of the loops around.
    fn draw(&mut self, stream: &str, kind: Variate, instant: Instant, place: &Place) -> ExprId {
        let passes: i64 = self.loops.iter().take(place.depth as usize).map(|l| l.passes).product();
        let first = self.draws.len() as i64;
        for i in 0..passes {
            let stream = if passes == 1 { stream.to_owned() } else { format!("{stream}#{i}") };
            self.draws.push(Draw { stream, kind, instant });
        }
        let mut at = Affine::constant(0);
        for d in 0..place.depth {
            let passes = self.loops.get(d as usize).map_or(1, |l| l.passes);
            at = at.times(passes).plus(Affine::along(0, LoopVar(d), 1));
        }
        at.offset = first;
        self.exprs.load(self.draws_var, Flavour::Value, at)
    }

    fn cell_size(&mut self, span: Span, function: &Ident, a: &Expr, place: &Place) -> Value {
        if let ExprKind::Name(name) = &a.kind
            && let Some(Bound::Cell(domain, cell)) = place.bound(&name.text).cloned()
        {
            return if function.text == "width" { self.cell_width(domain, cell) } else { self.cell_volume(domain, cell) };
        }
        self.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{}` takes a cell: an index bound by `for`", function.text), span))
    }

    /// A table over time at a given time.
    fn time_table(&mut self, span: Span, symbol: SymbolId, arguments: &[Expr], place: &Place) -> Value {
        let path = self.names.symbols[symbol].path.clone();
        let [argument] = arguments else {
            return self.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, format!("`{path}` takes a time"), span));
        };
        let SymbolKind::TimeTable { unit, time_unit, kind, points } = self.names.symbols[symbol].kind.clone() else {
            return self.poison();
        };
        let declared = self.names.symbols[symbol].span;
        let t = self.number_in(argument, &time_unit, &format!("the time of `{path}`"), declared, place);
        let expr = match kind {
            TimeTableKind::Linear => self.linear_table(t, &points),
            _ => self.step_table(t, &points, kind == TimeTableKind::Until),
        };
        Value::of(expr, unit)
    }

    /// Steps: up to and including a time (`until`), or from it on.
    fn step_table(&mut self, t: ExprId, points: &[(f64, f64)], until: bool) -> ExprId {
        let mut list = points.iter().rev();
        let Some(&(_, last)) = list.next() else { return self.exprs.constant(f64::NAN) };
        if until {
            let mut expr = self.exprs.constant(last);
            for &(time, value) in list {
                // A clock that counts in steps is a sum of roundings: a hair past the time still belongs to it.
                let limit = self.exprs.constant(time + 1e-9 * time.abs().max(1.0));
                let holds = self.exprs.compare(Compare::Le, t, limit);
                let value = self.exprs.constant(value);
                expr = self.exprs.select(holds, value, expr);
            }
            return expr;
        }
        let mut expr = self.exprs.constant(points.first().map_or(f64::NAN, |p| p.1));
        for &(time, value) in points.iter().skip(1) {
            let limit = self.exprs.constant(time - 1e-9 * time.abs().max(1.0));
            let reached = self.exprs.compare(Compare::Le, limit, t);
            let value = self.exprs.constant(value);
            expr = self.exprs.select(reached, value, expr);
        }
        expr
    }

    fn linear_table(&mut self, t: ExprId, points: &[(f64, f64)]) -> ExprId {
        let Some(&(_, last)) = points.last() else { return self.exprs.constant(f64::NAN) };
        let mut expr = self.exprs.constant(last);
        for pair in points.windows(2).rev() {
            let ((t0, v0), (t1, v1)) = (pair[0], pair[1]);
            let slope = self.exprs.constant((v1 - v0) / (t1 - t0));
            let (start, v0, end) = (self.exprs.constant(t0), self.exprs.constant(v0), self.exprs.constant(t1));
            let since = self.exprs.sub(t, start);
            let rise = self.exprs.mul(slope, since);
            let inside = self.exprs.add(v0, rise);
            let before = self.exprs.compare(Compare::Lt, t, end);
            expr = self.exprs.select(before, inside, expr);
        }
        if let Some(&(t0, v0)) = points.first() {
            let (start, v0) = (self.exprs.constant(t0), self.exprs.constant(v0));
            let before = self.exprs.compare(Compare::Lt, t, start);
            expr = self.exprs.select(before, v0, expr);
        }
        expr
    }

    /// `sum(e for i in set, z if condition)`
    pub(super) fn reduction(
        &mut self,
        span: Span,
        function: &Ident,
        body: &Expr,
        binders: &[Binder],
        condition: Option<&Expr>,
        place: &Place,
    ) -> Value {
        let mut terms = Vec::new();
        let weighted = function.text == "integral" || function.text == "mean";
        self.terms(body, binders, condition, weighted, place, &mut terms);
        if terms.iter().any(|t| t.value.is_poison()) {
            return self.poison();
        }
        match function.text.as_str() {
            "sum" => self.fold(terms, ReduceFn::Sum, span),
            "product" => self.product_of(terms, span),
            "min" => self.fold(terms, ReduceFn::Min, span),
            "max" => self.fold(terms, ReduceFn::Max, span),
            "mean" => self.mean(terms, span),
            "integral" => self.space_integral(terms, span),
            "any" | "all" => self.quantified(terms, function.text == "any", span),
            _ => self.unknown_function(function, place),
        }
    }

    /// All terms of a reduction: one for each member, one a piece of a range of cells.
    fn terms(&mut self, body: &Expr, binders: &[Binder], condition: Option<&Expr>, weighted: bool, place: &Place, out: &mut Vec<Term>) {
        let Some((binder, rest)) = binders.split_first() else {
            let keep = condition.map(|c| self.condition(c, place));
            if let Some(c) = keep
                && matches!(self.exprs.node(c), Node::Truth(false))
            {
                return;
            }
            let keep = keep.filter(|&c| !matches!(self.exprs.node(c), Node::Truth(true)));
            let value = self.value(body, place);
            out.push(Term { value, span: body.span, keep, loops: Vec::new(), weight: None });
            return;
        };
        for bound in self.bindings_of(binder, place) {
            match bound {
                BinderValue::One(bound) => {
                    let written = if let Bound::Alias(e, _) = &bound { Some(e.span) } else { None };
                    let first = out.len();
                    let inner = place.bind(&binder.name.text, bound);
                    self.terms(body, rest, condition, weighted, &inner, out);
                    if let Some(span) = written {
                        out[first..].iter_mut().for_each(|t| t.span = span);
                    }
                }
                BinderValue::Cells(domain, low, high) => {
                    let mut make = |cell: Cell| Bound::Cell(domain, cell);
                    self.looped_terms(binder, (low, high), &mut make, body, rest, condition, weighted.then_some(domain), place, out);
                }
                BinderValue::Elements(symbol, len) => {
                    let mut make = |cell: Cell| Bound::Element(symbol, cell.affine());
                    self.looped_terms(binder, (0, len - 1), &mut make, body, rest, condition, None, place, out);
                }
            }
        }
    }

    #[allow(clippy::too_many_arguments, reason = "the parts of one reduction")]
    fn looped_terms(
        &mut self,
        binder: &Binder,
        (low, high): (i64, i64),
        bound: &mut dyn FnMut(Cell) -> Bound,
        body: &Expr,
        rest: &[Binder],
        condition: Option<&Expr>,
        weight: Option<super::names::DomainId>,
        place: &Place,
        out: &mut Vec<Term>,
    ) {
        let pieces = self.cells(low, high, binder.span, place, &mut |s, cell, inner| {
            let inner = inner.bind(&binder.name.text, bound(cell));
            let mut list = Vec::new();
            s.terms(body, rest, condition, weight.is_some(), &inner, &mut list);
            if let Some(domain) = weight {
                for term in &mut list {
                    let volume = s.cell_volume(domain, cell);
                    term.weight = Some(match term.weight.take() {
                        Some(w) => s.arithmetic(BinaryOp::Mul, (w, body.span), (volume, body.span), body.span),
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

    /// A term summed over its loops.
    fn close(&mut self, term: &Term, op: ReduceFn, body: ExprId) -> ExprId {
        let neutral = match op {
            ReduceFn::Sum => 0.0,
            ReduceFn::Product => 1.0,
            ReduceFn::Min => f64::INFINITY,
            ReduceFn::Max => f64::NEG_INFINITY,
        };
        let mut e = body;
        if let Some(c) = term.keep {
            let neutral = self.exprs.constant(neutral);
            e = self.exprs.select(c, e, neutral);
        }
        // Loops were collected from the innermost outwards.
        for &(v, extent) in &term.loops {
            e = self.exprs.reduce(op, v, extent, e);
        }
        e
    }

    fn fold(&mut self, terms: Vec<Term>, op: ReduceFn, span: Span) -> Value {
        if terms.is_empty() {
            return match op {
                ReduceFn::Sum => Value { expr: self.exprs.constant(0.0), unit: Measure::Zero },
                ReduceFn::Product => Value::bare(self.exprs.constant(1.0)),
                _ => self.fault(Diagnostic::error(codes::EMPTY_SET, "the least or greatest of nothing", span)),
            };
        }
        let mut values = Vec::with_capacity(terms.len());
        for term in terms {
            let expr = self.close(&term, op, term.value.expr);
            values.push((Value { expr, unit: term.value.unit }, term.span));
        }
        let mut list = values.into_iter();
        let Some(mut total) = list.next() else { return self.poison() };
        let first = total.1;
        for next in list {
            let v = match op {
                ReduceFn::Sum => self.arithmetic(BinaryOp::Add, total, next, span),
                ReduceFn::Min => self.fold_extremum(BinaryFn::Min, vec![total, next], span),
                ReduceFn::Max => self.fold_extremum(BinaryFn::Max, vec![total, next], span),
                ReduceFn::Product => self.arithmetic(BinaryOp::Mul, total, next, span),
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
    fn mean(&mut self, terms: Vec<Term>, span: Span) -> Value {
        if terms.is_empty() {
            return self.fault(Diagnostic::error(codes::EMPTY_SET, "the mean of nothing", span));
        }
        if terms.iter().any(|t| t.weight.is_some()) {
            let weights: Vec<Term> = terms
                .iter()
                .filter_map(|t| {
                    t.weight.clone().map(|w| Term { value: w, span: t.span, keep: t.keep, loops: t.loops.clone(), weight: None })
                })
                .collect();
            let total = self.space_integral(terms, span);
            let measure = self.fold(weights, ReduceFn::Sum, span);
            return self.arithmetic(BinaryOp::Div, (total, span), (measure, span), span);
        }
        let n = self.exprs.constant(terms.len() as f64);
        let total = self.fold(terms, ReduceFn::Sum, span);
        self.arithmetic(BinaryOp::Div, (total, span), (Value::bare(n), span), span)
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
            let value = self.arithmetic(BinaryOp::Mul, (w, span), (term.value, span), span);
            weighted.push(Term { value, span: term.span, keep: term.keep, loops: term.loops, weight: None });
        }
        self.fold(weighted, ReduceFn::Sum, span)
    }

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
                let bare = Term { value: term.value.clone(), span: term.span, keep: None, loops: term.loops.clone(), weight: None };
                let e = self.close(&bare, if any { ReduceFn::Max } else { ReduceFn::Min }, number);
                holds = self.exprs.compare(Compare::Lt, zero, e);
            }
            total = if any { self.exprs.or(total, holds) } else { self.exprs.and(total, holds) };
        }
        Value::truth(total)
    }

    /// What a binder runs over.
    pub(super) fn bindings_of(&mut self, binder: &Binder, place: &Place) -> Vec<BinderValue> {
        match &binder.over {
            BinderSet::Itself => self.bindings_of_name(&binder.name, place),
            BinderSet::Set(name)
                if matches!(name.text.as_str(), "states" | "actions") && self.names.lookup(place.scope, &name.text).is_none() =>
            {
                let role = if name.text == "states" { Role::State } else { Role::Action };
                self.arrays_of(role)
            }
            BinderSet::Set(name) => self.bindings_of_name(name, place),
            BinderSet::Range(low, high) => self.bindings_of_range(binder, low, high, place),
            BinderSet::Tuple(list) => {
                let scope = place.scope;
                let mut out = Vec::new();
                for e in list {
                    // An element that is itself bound here must be taken now.
                    let bound = match &e.kind {
                        ExprKind::Name(n) if place.bound(&n.text).is_some() => place.bound(&n.text).cloned(),
                        _ => None,
                    };
                    out.push(BinderValue::One(bound.unwrap_or_else(|| Bound::Alias(e.clone(), scope))));
                }
                out
            }
        }
    }

    /// All variables of a role, each as the row of its elements.
    fn arrays_of(&self, role: Role) -> Vec<BinderValue> {
        let of_role = |kind: &SymbolKind| match kind {
            SymbolKind::Variable { var, .. } if self.vars[*var].role == role => Some(i64::from(self.vars[*var].len)),
            _ => None,
        };
        self.names.symbols.iter().filter_map(|(id, s)| of_role(&s.kind).map(|len| BinderValue::Elements(id, len))).collect()
    }

    fn bindings_of_name(&mut self, name: &Ident, place: &Place) -> Vec<BinderValue> {
        let Some(symbol) = self.names.lookup(place.scope, &name.text) else {
            let known: Vec<String> = self
                .names
                .symbols
                .values()
                .filter(|s| matches!(s.kind, SymbolKind::Set(_) | SymbolKind::Domain(_)))
                .map(|s| s.path.clone())
                .collect();
            let help = did_you_mean(&name.text, known.iter().map(String::as_str));
            self.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set or domain `{}`", name.text), name.span).maybe_help(help),
            );
            return Vec::new();
        };
        match self.names.symbols[symbol].kind {
            SymbolKind::Set(set) | SymbolKind::Phase(set) => {
                (0..self.names.sets[set].labels.len()).map(|i| BinderValue::One(Bound::Member(set, i))).collect()
            }
            SymbolKind::Domain(domain) => vec![BinderValue::Cells(domain, 0, self.names.domains[domain].cells - 1)],
            SymbolKind::Faulty => Vec::new(),
            _ => {
                let at = self.names.symbols[symbol].span;
                self.report(
                    Diagnostic::error(codes::WRONG_KIND, format!("`{}` is neither a set nor a domain", name.text), name.span)
                        .secondary(at, "declared here"),
                );
                Vec::new()
            }
        }
    }

    fn bindings_of_range(&mut self, binder: &Binder, low: &Expr, high: &Expr, place: &Place) -> Vec<BinderValue> {
        let symbol = self.names.lookup(place.scope, &binder.name.text);
        let (Some(a), Some(b)) = (self.integer(low, place), self.integer(high, place)) else { return Vec::new() };
        if b - a >= 10_000_000 {
            self.report(Diagnostic::error(codes::TOO_LARGE, "a range of more than ten million numbers", binder.span));
            return Vec::new();
        }
        match symbol.map(|s| self.names.symbols[s].kind.clone()) {
            Some(SymbolKind::Domain(domain)) => {
                let n = self.names.domains[domain].cells;
                if a > b {
                    return Vec::new();
                }
                if a < 1 || b > n {
                    self.report(Diagnostic::error(
                        codes::OUT_OF_RANGE,
                        format!("`{}` has the cells 1 to {n}, the range is {a} to {b}", binder.name.text),
                        binder.span,
                    ));
                    return Vec::new();
                }
                vec![BinderValue::Cells(domain, a - 1, b - 1)]
            }
            Some(SymbolKind::Set(set)) if self.names.sets[set].first.is_some() => {
                let first = self.names.sets[set].first.unwrap_or(0);
                let len = self.names.sets[set].labels.len() as i64;
                (a..=b)
                    .filter(|i| (first..first + len).contains(i))
                    .map(|i| BinderValue::One(Bound::Member(set, (i - first) as usize)))
                    .collect()
            }
            _ if self.names.sets.values().any(|s| s.name == format!("{a}..{b}")) => {
                let name = format!("{a}..{b}");
                let set = self.names.sets.iter().find(|(_, s)| s.name == name).map(|(id, _)| id);
                set.map_or_else(Vec::new, |set| (0..=(b - a) as usize).map(|i| BinderValue::One(Bound::Member(set, i))).collect())
            }
            _ => {
                if b - a >= 10_000 {
                    self.report(
                        Diagnostic::error(codes::TOO_LARGE, "a range of more than ten thousand numbers is written out", binder.span)
                            .help("use a `domain`: its cells stay a loop"),
                    );
                    return Vec::new();
                }
                let numbers: Vec<ExprId> = (a..=b).map(|i| self.exprs.constant(i as f64)).collect();
                numbers.into_iter().map(|e| BinderValue::One(Bound::Number(e))).collect()
            }
        }
    }

    /// The set of integers behind `k in 1..4` in a declaration; equal ranges are one set.
    fn anonymous_set(&mut self, binder: &Binder, low: &Expr, high: &Expr, place: &Place) -> Option<super::names::SetId> {
        let (a, b) = (self.integer(low, place)?, self.integer(high, place)?);
        if a > b || b - a >= 100_000 {
            let d = Diagnostic::error(codes::EMPTY_SET, format!("an index from {a} to {b}"), binder.span);
            self.report(d.label("must have between one and a hundred thousand members"));
            return None;
        }
        let name = format!("{a}..{b}");
        let known = self.names.sets.iter().find(|(_, s)| s.name == name).map(|(id, _)| id);
        Some(known.unwrap_or_else(|| {
            let labels = (a..=b).map(|i| i.to_string()).collect();
            self.names.sets.push(super::names::Set { name, labels, first: Some(a) })
        }))
    }

    /// Axes and binder names of an index list (`i in species, z`).
    pub(super) fn axes(&mut self, binders: &[Binder], place: &Place) -> Option<(Vec<Axis>, Vec<String>)> {
        let mut axes = Vec::with_capacity(binders.len());
        let mut names = Vec::with_capacity(binders.len());
        for binder in binders {
            let set = match &binder.over {
                BinderSet::Set(name) => name,
                BinderSet::Itself => &binder.name,
                BinderSet::Range(low, high) => {
                    let set = self.anonymous_set(binder, low, high, place)?;
                    axes.push(Axis::Set(set));
                    names.push(binder.name.text.clone());
                    continue;
                }
                BinderSet::Tuple(_) => {
                    self.report(Diagnostic::error(codes::BAD_BINDER, "an index of a declaration runs over a set or a domain", binder.span));
                    return None;
                }
            };
            let axis = match self.names.lookup(place.scope, &set.text).map(|s| self.names.symbols[s].kind.clone()) {
                Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => Axis::Set(set),
                Some(SymbolKind::Domain(domain)) => Axis::Domain(domain),
                _ => {
                    self.bindings_of_name(set, place);
                    return None;
                }
            };
            axes.push(axis);
            names.push(binder.name.text.clone());
        }
        Some((axes, names))
    }
}

/// One value of a binder.
pub enum BinderValue {
    /// A member, a number, an element.
    One(Bound),
    /// The cells of a domain from one number to another.
    Cells(super::names::DomainId, i64, i64),
    /// All elements of a variable.
    Elements(SymbolId, i64),
}

/// A term of a reduction.
#[derive(Clone)]
struct Term {
    value: Value,
    /// What was written: the body, or the element of a tuple.
    span: Span,
    keep: Option<ExprId>,
    loops: Vec<(LoopVar, u32)>,
    weight: Option<Value>,
}
