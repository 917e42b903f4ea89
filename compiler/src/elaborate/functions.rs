//! Function calls and reductions.

mod binders;
mod reductions;
mod tables;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use super::names::{SymbolId, SymbolKind};
use super::quantity::{Measure, Value};
use super::{Bound, Elaborator, Place, Site, units};
use crate::ir::{Affine, BinaryFn, Expr as Node, Flavour, Role, UnaryFn};
use crate::model::Quantity;

/// Functions that every model knows, for suggestions.
pub(super) const FUNCTIONS: &[&str] = &[
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
    "celsius",
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
            "celsius" => {
                let Some(a) = one(self) else { return self.poison() };
                self.celsius(a, place)
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
        let help = match name.as_str() {
            "log" => Some("write `ln` for the natural logarithm, `log10` for the decimal one".to_owned()),
            "pow" => Some("write `x^y`".to_owned()),
            "sum" | "product" | "mean" | "any" | "all" => Some(format!("say over what: `{name}(x[i] for i in set)`")),
            _ if self.may_suggest() => self.did_you_mean(name, FUNCTIONS.iter().copied().chain(self.names.visible(place.scope))),
            _ => None,
        };
        let message = match name.as_str() {
            "sum" | "product" | "mean" | "any" | "all" => format!("`{name}` runs over a set, here is none"),
            _ => format!("unknown function `{name}`"),
        };
        let d = Diagnostic::error(codes::UNKNOWN_NAME, message, function.span).maybe_help(help);
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
        if !self.may_write_out(span) {
            return self.poison();
        }
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
        self.expanded.insert(symbol);
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
            best = (Value { expr, unit: best.0.unit.beside(&next.0.unit) }, best.1);
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
        Value { expr, unit: a.unit.beside(&b.unit) }
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
        let expr = exprs.rewrite(v.expr, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
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

    /// The point in degC of an absolute temperature, or of a point on another scale.
    fn celsius(&mut self, a: &Expr, place: &Place) -> Value {
        let v = self.value(a, place);
        let Some(celsius) = Unit::named("degC") else { return self.poison() };
        let found = match &v.unit {
            Measure::Poison => return v,
            Measure::Of(u) => u.clone(),
            _ => {
                let fault = Diagnostic::error(codes::UNIT_MISMATCH, "`celsius` takes a temperature, this is a pure number", a.span);
                return self.fault(fault.help("give the number its unit: `298.15 [K]`"));
            }
        };
        let Some(conversion) = found.conversion_to(&celsius) else {
            let fault = Diagnostic::error(codes::UNIT_MISMATCH, "`celsius` takes a temperature", a.span);
            return self.fault(fault.label(units::describe(&found)));
        };
        let (factor, offset) = (self.exprs.constant(conversion.factor), self.exprs.constant(conversion.offset));
        let scaled = self.exprs.mul(v.expr, factor);
        let expr = self.exprs.add(scaled, offset);
        Value::of(expr, celsius)
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

    fn cell_size(&mut self, span: Span, function: &Ident, a: &Expr, place: &Place) -> Value {
        if let ExprKind::Name(name) = &a.kind
            && let Some(Bound::Cell(domain, cell)) = place.bound(&name.text).cloned()
        {
            return if function.text == "width" { self.cell_width(domain, cell) } else { self.cell_volume(domain, cell) };
        }
        self.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{}` takes a cell: an index bound by `for`", function.text), span))
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
