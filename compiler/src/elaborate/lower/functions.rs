//! Function calls and reductions.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BY_MEMBER, BinaryOp, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::builtins::{self, Attribute, Builtin, Call};
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, boxes, definitions, delays, interpolation, membership, operators, random_and_tables, units};
use crate::elaborate::space::{field, flux, grid};
use crate::elaborate::symbols::SymbolKind;
use crate::elaborate::transport;
use crate::ir::{Affine, BinaryFn, Expr as Node, Flavour, UnaryFn, Unframed};

/// `f(a, b)`
pub(in crate::elaborate) fn call(l: &mut Lowering<'_, '_>, span: Span, function: &Ident, arguments: &[Expr], place: &Place) -> Value {
    if let Some(symbol) = l.symbols.lookup(place.scope, &function.text) {
        match l.symbols[symbol].kind.clone() {
            SymbolKind::Def { .. } => return definitions::expand(l, span, symbol, arguments, place),
            SymbolKind::TimeTable { .. } => return random_and_tables::time_table(l, span, symbol, arguments, place),
            SymbolKind::Surface { .. } => return interpolation::surface(l, span, symbol, arguments, place),
            SymbolKind::Faulty => return l.poison(),
            _ => {}
        }
    }
    if function.text == BY_MEMBER {
        return match membership::by_member(l, arguments, place) {
            Some(e) => l.value(e, place),
            None => l.poison(),
        };
    }
    if function.text == transport::ELAPSED {
        return delays::elapsed(l, span, arguments, place);
    }
    if function.text == membership::IN {
        return membership::membership(l, arguments, place);
    }
    let Some(&Builtin { name, arity, call: Some(call), .. }) = builtins::find(&function.text) else {
        return unknown_function(l, function, place);
    };
    if arity.is_some_and(|wanted| !l.ledger.argument(span, function, arguments, wanted)) {
        return l.poison();
    }
    built_in(l, span, (name, call), arguments, place)
}

/// A call of a built-in function with as many arguments as it takes.
fn built_in(l: &mut Lowering<'_, '_>, span: Span, (name, call): (&str, Call), arguments: &[Expr], place: &Place) -> Value {
    match (call, arguments) {
        (Call::Elementary(f), [a]) => elementary(l, name, f, a, place),
        (Call::Rounding(f), [a]) => rounding(l, name, f, a, place),
        (Call::OfAmount(f), [a]) => of_amount(l, name, f, a, place),
        (Call::Power(exponent), [a]) => {
            let v = l.value(a, place);
            let exponent = l.exprs.constant(exponent);
            operators::arithmetic(l, BinaryOp::Pow, (v, a.span), (Value::bare(exponent), span), span)
        }
        (Call::Extremum(f), _) => extremum(l, span, name, f, arguments, place),
        (Call::Clip, _) => clip(l, span, arguments, place),
        (Call::Atan2, [y, x]) => atan2(l, span, y, x, place),
        (Call::Modulo, [a, b]) => modulo(l, span, a, b, place),
        (Call::Derivative, [a]) => l.derivative(span, a, place),
        (Call::Frame(flavour), [a]) => flavoured(l, span, name, flavour, a, place),
        (Call::Quadrature, [a]) => quadrature(l, span, a, place),
        (Call::Delay, _) => delays::delay(l, span, arguments, place),
        (Call::Transport, _) => delays::transport(l, span, arguments, place),
        (Call::Kelvin, [a]) => kelvin(l, a, place),
        (Call::Celsius, [a]) => celsius(l, a, place),
        (Call::Value, [a]) => plain_value(l, a, None, place),
        (Call::Value, [a, unit]) => plain_value(l, a, Some(unit), place),
        (Call::Attribute(attribute), [a]) => declared_number(l, attribute, a, place),
        (Call::Box(inside), [a]) => boxes::box_condition(l, inside, a, place),
        (Call::Random(distribution), [a, b]) => random_and_tables::random(l, span, name, distribution, (a, b), place),
        (Call::Divergence, [a]) => flux::divergence(l, span, a, place),
        (Call::Gradient, [a]) => field::gradient(l, span, a, place),
        (Call::Smooth, [a]) => smooth(l, a, place),
        (Call::Upwind, [v, e]) => field::upwind(l, span, v, e, place),
        (Call::Width | Call::Volume, [a]) => cell_size(l, span, name, call, a, place),
        _ => {
            l.ledger.wrong_number(span, name, 1, arguments.len());
            l.poison()
        }
    }
}

pub(in crate::elaborate) fn unknown_function(l: &mut Lowering<'_, '_>, function: &Ident, place: &Place) -> Value {
    let name = &function.text;
    let declared = l.symbols.lookup(place.scope, name);
    if let Some(symbol) = declared {
        let at = l.symbols[symbol].span;
        return l.fault(
            Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is not a function"), function.span)
                .secondary(at, "declared here")
                .help(format!("multiply with `*`: `{name} * (...)`")),
        );
    }
    let over_sets = builtins::find(name).filter(|b| b.call.is_none());
    let help = match name.as_str() {
        "log" => Some("write `ln` for the natural logarithm, `log10` for the decimal one".to_owned()),
        "pow" => Some("write `x^y`".to_owned()),
        "pre" => {
            Some("right sides of `next x = ...` read the old values; in equations `previous(x)` is the value a step before".to_owned())
        }
        "noEvent" => Some("write `smooth(...)`: switches in it are not located".to_owned()),
        "ddt" | "PARTIAL" => Some("a rate is `d/dt x`; along a domain there are `div` of a `flux`, and `grad` in it".to_owned()),
        "sample" => Some("write `at every 3 [s] { next x = ... }`".to_owned()),
        _ if over_sets.is_some() => over_sets.map(|b| format!("say over what: `{}`", b.usage)),
        _ if l.ledger.reports.may_suggest() => l.ledger.reports.did_you_mean(name, builtins::names().chain(l.symbols.visible(place.scope))),
        _ => None,
    };
    let message = if over_sets.is_some() { format!("`{name}` needs a set to run over") } else { format!("unknown function `{name}`") };
    let d = Diagnostic::error(codes::UNKNOWN_NAME, message, function.span).maybe_help(help);
    l.fault(d)
}

fn elementary(l: &mut Lowering<'_, '_>, name: &str, f: UnaryFn, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    match l.values().dimensionless(&v, a.span, name) {
        Some(x) => {
            // A pure number in any unit, of a number too: no number of the unit that a place
            // declares.
            Value::of(l.exprs.unary(f, x), Unit::one())
        }
        None => l.poison(),
    }
}

fn of_amount(l: &mut Lowering<'_, '_>, name: &str, f: UnaryFn, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    match &v.unit {
        Measure::Poison => v,
        Measure::Truth => l.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{name}` of a condition"), a.span)),
        Measure::Of(u) if units::is_point(u) => l.fault(units::of_a_point(name, a.span)),
        unit => {
            let unit = match unit {
                Measure::Of(_) if f == UnaryFn::Sign => Measure::Of(Unit::one()),
                _ if f == UnaryFn::Sign => Measure::Bare,
                unit => unit.clone(),
            };
            let expr = l.exprs.unary(f, v.expr);
            Value { expr, unit }
        }
    }
}

/// `smooth(x)`: the same quantity, of any unit.
fn smooth(l: &mut Lowering<'_, '_>, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    match &v.unit {
        Measure::Poison => v,
        Measure::Truth => l.fault(
            Diagnostic::error(codes::WRONG_KIND, "`smooth` of a condition", a.span).help("give it the whole `if ... then ... else ...`"),
        ),
        _ => Value { expr: l.exprs.unary(UnaryFn::Smooth, v.expr), unit: v.unit },
    }
}

/// `floor(x)` and the like: of what has no dimension the number itself is rounded, of a quantity
/// its number in a unit that the text names.
fn rounding(l: &mut Lowering<'_, '_>, name: &str, f: UnaryFn, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    let to_whole = f != UnaryFn::Single;
    match &v.unit {
        Measure::Poison => v,
        Measure::Truth => l.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{name}` of a condition"), a.span)),
        Measure::Of(unit) if units::is_dimensionless(unit) => {
            if to_whole && !unit.is_unnamed() && !units::is_plain_number(unit) {
                l.ledger.report(units::rounded_as_number(name, unit, a.span));
            }
            let number = l.values().convert(v.expr, unit, &Unit::one()).unwrap_or(v.expr);
            Value::of(l.exprs.unary(f, number), Unit::one())
        }
        Measure::Of(unit) if to_whole && unit.is_unnamed() => l.fault(units::unnamed(name, unit, a.span)),
        unit => Value { expr: l.exprs.unary(f, v.expr), unit: unit.clone() },
    }
}

fn extremum(l: &mut Lowering<'_, '_>, span: Span, name: &str, f: BinaryFn, arguments: &[Expr], place: &Place) -> Value {
    if arguments.len() < 2 {
        return l.fault(
            Diagnostic::error(codes::WRONG_ARGUMENTS, format!("`{name}` takes two or more arguments"), span)
                .help(format!("over a set: `{name}(x[i] for i in set)`")),
        );
    }
    let values: Vec<(Value, Span)> = arguments.iter().map(|a| (l.value(a, place), a.span)).collect();
    l.values().fold_extremum(f, values, span)
}

fn clip(l: &mut Lowering<'_, '_>, span: Span, arguments: &[Expr], place: &Place) -> Value {
    let v: Vec<(Value, Span)> = arguments.iter().map(|a| (l.value(a, place), a.span)).collect();
    let [x, low, high] = &v[..] else { return l.poison() };
    if let (Some(a), Some(b)) = (l.exprs.as_const(low.0.expr), l.exprs.as_const(high.0.expr))
        && let Some((factor, offset)) = units::conversion(&high.0.unit.unit(), &low.0.unit.unit())
        && a > factor * b + offset
    {
        let message = "the upper limit of `clip` lies below the lower one";
        return l.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, message, low.1.to(high.1)).help("the form is `clip(x, low, high)`"));
    }
    let above = l.values().fold_extremum(BinaryFn::Max, vec![x.clone(), low.clone()], span);
    l.values().fold_extremum(BinaryFn::Min, vec![(above, x.1), high.clone()], span)
}

/// Reports points on a temperature scale where amounts are needed; whether there was one.
fn refuse_points(l: &mut Lowering<'_, '_>, name: &str, arguments: [(&Value, Span); 2]) -> bool {
    let points = arguments.into_iter().filter(|(v, _)| matches!(&v.unit, Measure::Of(unit) if units::is_point(unit)));
    let faults: Vec<Diagnostic> = points.map(|(_, span)| units::of_a_point(name, span)).collect();
    let any = !faults.is_empty();
    faults.into_iter().for_each(|fault| l.ledger.report(fault));
    any
}

fn atan2(l: &mut Lowering<'_, '_>, span: Span, y: &Expr, x: &Expr, place: &Place) -> Value {
    let (a, b) = (l.value(y, place), l.value(x, place));
    if refuse_points(l, "atan2", [(&a, y.span), (&b, x.span)]) {
        return l.poison();
    }
    let Some((left, right)) = l.values().common(&a, y.span, &b, x.span, span) else { return l.poison() };
    let expr = l.exprs.binary(BinaryFn::Atan2, left, right);
    Value::of(expr, Unit::one())
}

/// `mod(a, b)`: what is left of `a` after whole multiples of `b`, with the sign of `b`.
fn modulo(l: &mut Lowering<'_, '_>, span: Span, first: &Expr, second: &Expr, place: &Place) -> Value {
    let (a, b) = (l.value(first, place), l.value(second, place));
    if refuse_points(l, "mod", [(&a, first.span), (&b, second.span)]) {
        return l.poison();
    }
    let Some((left, right)) = l.values().common(&a, first.span, &b, second.span, span) else { return l.poison() };
    if l.exprs.as_const(right) == Some(0.0) {
        return l
            .fault(Diagnostic::error(codes::WRONG_ARGUMENTS, "nothing is left of whole multiples of 0", second.span).label("this is 0"));
    }
    let ratio = l.exprs.div(left, right);
    let whole = l.exprs.unary(UnaryFn::Floor, ratio);
    let multiple = l.exprs.mul(right, whole);
    let expr = l.exprs.sub(left, multiple);
    Value { expr, unit: a.unit.beside(&b.unit) }
}

/// `initial(e)`, `previous(e)`, `steady(e)`: `e` with every variable read from another frame.
fn flavoured(l: &mut Lowering<'_, '_>, span: Span, name: &str, flavour: Flavour, a: &Expr, place: &Place) -> Value {
    l.hidden.steady |= flavour == Flavour::Steady;
    let v = l.value(a, place);
    if v.is_poison() {
        return v;
    }
    let (vars, builtins) = (&l.symbols.vars, l.hidden.builtins);
    let at_frame = l.exprs.in_frame(v.expr, flavour, &|var| vars[var].role, builtins, &mut crate::ir::Rewritten::default());
    let (message, help) = match at_frame {
        Ok(expr) => return Value { expr, unit: v.unit },
        Err(Unframed::OverTime) => (format!("`{name}` of a derivative, an integral over the step or a delayed value"), None),
        Err(Unframed::Frame) => (
            format!("`{name}` of `previous` or `sampled`"),
            Some("a discrete variable keeps what was two steps ago: `at end { next last = x }`"),
        ),
        Err(Unframed::Outcome) => (format!("`{name}` of how the step ends"), None),
    };
    let fault = Diagnostic::error(codes::MISPLACED_FUNCTION, message, span);
    l.fault(fault.maybe_help(help.map(str::to_owned)))
}

/// `integral(e)`: over the present step.
fn quadrature(l: &mut Lowering<'_, '_>, span: Span, a: &Expr, place: &Place) -> Value {
    if place.site != Site::Instant || place.depth > 0 {
        return l.fault(
            Diagnostic::error(
                codes::MISPLACED_FUNCTION,
                "`integral` over the step has a meaning in rewards, conditions and observations only",
                span,
            )
            .help("declare a state with `d/dt m = ...` to use an integral in equations"),
        );
    }
    let v = l.value(a, place);
    let quadratures = l.hidden.quadratures.var;
    if !l.exprs.loads(v.expr, |var, _| var == quadratures).is_empty() {
        return l.fault(Diagnostic::error(codes::MISPLACED_FUNCTION, "`integral` over the step of an integral over the step", span));
    }
    let unit = match &v.unit {
        Measure::Poison => return v,
        Measure::Of(u) if units::is_point(u) => return l.fault(units::of_a_point("integral", a.span)),
        Measure::Of(u) => units::times(u, &l.symbols.time_unit),
        _ => l.symbols.time_unit.clone(),
    };
    let at = l.hidden.quadratures.element(v.expr, &unit);
    let expr = l.exprs.load(l.hidden.quadratures.var, Flavour::Value, Affine::constant(at as i64));
    Value::of(expr, unit)
}

fn kelvin(l: &mut Lowering<'_, '_>, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    let Some(kelvin) = Unit::named("K") else { return l.poison() };
    match &v.unit {
        Measure::Poison => v,
        Measure::Of(u) if u.is_between_points() && u.commensurable(&kelvin) => l.fault(units::of_a_difference("kelvin", a.span)),
        Measure::Of(u) => match u.conversion_to(&kelvin) {
            Some(c) => {
                let (f, o) = (l.exprs.constant(c.factor), l.exprs.constant(c.offset));
                let scaled = l.exprs.mul(v.expr, f);
                let expr = l.exprs.add(scaled, o);
                Value::of(expr, kelvin)
            }
            None => {
                let u = u.clone();
                l.fault(Diagnostic::error(codes::UNIT_MISMATCH, "`kelvin` takes a temperature", a.span).label(units::describe(&u)))
            }
        },
        _ => l.fault(
            Diagnostic::error(codes::UNIT_MISMATCH, "`kelvin` takes a temperature, this is a pure number", a.span)
                .help("give the number its unit: `25 [degC]`"),
        ),
    }
}

/// The point in degC of an absolute temperature, or of a point on another scale.
fn celsius(l: &mut Lowering<'_, '_>, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    let Some(celsius) = Unit::named("degC") else { return l.poison() };
    let found = match &v.unit {
        Measure::Poison => return v,
        Measure::Of(u) if u.is_between_points() && u.commensurable(&celsius) => {
            return l.fault(units::of_a_difference("celsius", a.span));
        }
        Measure::Of(u) => u.clone(),
        _ => {
            let fault = Diagnostic::error(codes::UNIT_MISMATCH, "`celsius` takes a temperature, this is a pure number", a.span);
            return l.fault(fault.help("give the number its unit: `298.15 [K]`"));
        }
    };
    let Some(conversion) = found.conversion_to(&celsius) else {
        let fault = Diagnostic::error(codes::UNIT_MISMATCH, "`celsius` takes a temperature", a.span);
        return l.fault(fault.label(units::describe(&found)));
    };
    let (factor, offset) = (l.exprs.constant(conversion.factor), l.exprs.constant(conversion.offset));
    let scaled = l.exprs.mul(v.expr, factor);
    let expr = l.exprs.add(scaled, offset);
    Value::of(expr, celsius)
}

/// `value(x)`, `value(x, unit)`
fn plain_value(l: &mut Lowering<'_, '_>, first: &Expr, unit: Option<&Expr>, place: &Place) -> Value {
    let v = l.value(first, place);
    if v.is_poison() {
        return v;
    }
    let Some(second) = unit else {
        return match &v.unit {
            Measure::Of(unit) if unit.is_unnamed() => match l.values().convert(v.expr, unit, &Unit::one()) {
                Some(number) => Value::bare(number),
                None => l.fault(units::unnamed("value", unit, first.span)),
            },
            _ => Value::bare(v.expr),
        };
    };
    let Some(unit) = units::unit_argument(l, second, place) else { return l.poison() };
    let from = v.unit.unit();
    if unit.is_point() && from.is_between_points() && from.commensurable(&unit) {
        return l.fault(units::of_a_difference(&format!("value(x, {unit})"), first.span));
    }
    // An absolute temperature may be asked for on another scale.
    match from.conversion_to(&unit).filter(|_| from.commensurable(&unit)) {
        Some(c) => {
            let (f, o) = (l.exprs.constant(c.factor), l.exprs.constant(c.offset));
            let scaled = l.exprs.mul(v.expr, f);
            let expr = l.exprs.add(scaled, o);
            Value::bare(expr)
        }
        None => l.fault(units::mismatch(&from, &unit, first.span, "the unit asked for", second.span)),
    }
}

/// The variable whose element an expression is.
pub(in crate::elaborate) fn element(l: &mut Lowering<'_, '_>, v: &Value, span: Span) -> Option<(crate::ir::VarId, Affine)> {
    if v.is_poison() {
        return None;
    }
    match l.exprs.node(v.expr) {
        Node::Load { var, at, .. } if l.quantities.contains_key(&var) => Some((var, at)),
        _ => {
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "a declared variable is needed here", span).label("not a variable"));
            None
        }
    }
}

/// `low(x)`, `high(x)`, `scale(x)`, `nominal(x)`
fn declared_number(l: &mut Lowering<'_, '_>, attribute: Attribute, a: &Expr, place: &Place) -> Value {
    let v = l.value(a, place);
    let Some((var, at)) = element(l, &v, a.span) else { return l.poison() };
    let Some(q) = l.quantities.get(&var) else { return l.poison() };
    let list = match attribute {
        Attribute::Low => &q.low,
        Attribute::High => &q.high,
        Attribute::Scale => &q.scale,
        Attribute::Nominal => &q.default,
    };
    let expr = l.exprs.entry_at(list, at);
    let unit = v.unit.unit();
    Value::of(expr, if attribute == Attribute::Scale { units::difference(&unit) } else { unit })
}

fn cell_size(l: &mut Lowering<'_, '_>, span: Span, name: &str, call: Call, a: &Expr, place: &Place) -> Value {
    if let ExprKind::Name(index) = &a.kind
        && let Some(Bound::Cell(domain, cell)) = place.bound(&index.text).cloned()
    {
        return if call == Call::Width { grid::cell_width(l, domain, cell) } else { grid::cell_volume(l, domain, cell) };
    }
    l.fault(Diagnostic::error(codes::WRONG_KIND, format!("`{name}` takes a cell: an index bound by `for`"), span))
}

impl Values<'_> {
    pub(in crate::elaborate) fn fold_extremum(&mut self, f: BinaryFn, values: Vec<(Value, Span)>, span: Span) -> Value {
        let mut list = values.into_iter();
        let Some(mut best) = list.next() else { return self.poison() };
        for next in list {
            let Some((l, r)) = self.common(&best.0, best.1, &next.0, next.1, span) else { return self.poison() };
            let expr = self.exprs.binary(f, l, r);
            best = (Value { expr, unit: best.0.unit.beside(&next.0.unit) }, best.1);
        }
        best.0
    }
}

impl Ledger {
    /// Reports a wrong number of arguments.
    pub(in crate::elaborate) fn argument(&mut self, span: Span, function: &Ident, arguments: &[Expr], wanted: usize) -> bool {
        if arguments.len() != wanted {
            self.wrong_number(span, &function.text, wanted, arguments.len());
        }
        arguments.len() == wanted
    }

    fn wrong_number(&mut self, span: Span, name: &str, wanted: usize, given: usize) {
        let plural = if wanted == 1 { "" } else { "s" };
        let message = format!("`{name}` takes {wanted} argument{plural}, not {given}");
        self.report(Diagnostic::error(codes::WRONG_ARGUMENTS, message, span));
    }
}
