//! Expressions: names, operators, reductions.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BY_MEMBER, Declaration, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use crate::differentiate::{self, Loaded};
use crate::elaborate::expansions::Asked;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, functions, indices, membership, operators, outcome, paths, phases, reactions, units};
use crate::elaborate::select::items::reference;
use crate::elaborate::space::{field, flux, grid};
use crate::elaborate::symbols::{Axis, ScopeId, SymbolId, SymbolKind, Symbols};
use crate::ir::{Affine, Builtin, Expr as Node, ExprId, Exprs, Flavour, Role, VarId};

impl<'a> Lowering<'_, 'a> {
    /// Elaborates an expression.
    pub(in crate::elaborate) fn value(&mut self, e: &Expr, place: &Place) -> Value {
        if !self.ledger.budget.may_elaborate(e.span, self.exprs.len()) {
            return self.poison();
        }
        self.nested(e.span, |s| s.value_of(e, place))
    }

    /// Elaborates one level deeper, unless that is too deep.
    fn nested(&mut self, span: Span, value: impl FnOnce(&mut Self) -> Value) -> Value {
        if !self.ledger.budget.enter() {
            return self.fault(
                Diagnostic::error(codes::TOO_LARGE, "definitions within definitions, hundreds deep", span)
                    .help("break the chain: make one of its members a `var` with an equation"),
            );
        }
        let v = value(self);
        self.ledger.budget.leave();
        v
    }

    fn value_of(&mut self, e: &Expr, place: &Place) -> Value {
        match &e.kind {
            ExprKind::Number { value, unit: None } => {
                let expr = self.exprs.constant(*value);
                Value { expr, unit: if *value == 0.0 { Measure::Zero } else { Measure::Bare } }
            }
            ExprKind::Number { value, unit: Some(unit) } => {
                let unit = units::unit(self, unit, place);
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
            ExprKind::Member(..) | ExprKind::Index(..) => paths::reference(self, e, place),
            ExprKind::Call { function, arguments } => functions::call(self, e.span, function, arguments, place),
            ExprKind::Reduce { function, body, binders, condition } => {
                self.reduction(e.span, function, body, binders, condition.as_deref(), place)
            }
            ExprKind::Derivative(inner) => self.derivative(e.span, inner, place),
            ExprKind::Unary(op, a) => operators::unary(self, *op, a, place),
            ExprKind::Binary(op, a, b) => operators::binary(self, e.span, *op, a, b, place),
            ExprKind::If(c, a, b) => operators::conditional_of(self, e.span, c, (a, b), place, &mut |s, e| s.value(e, place)),
            ExprKind::As(a, unit) => {
                let Some(target) = units::unit(self, unit, place) else { return self.poison() };
                let v = self.value(a, place);
                self.values().put_unit(v, target, a.span)
            }
            ExprKind::Tuple(_) => self.fault(
                Diagnostic::error(codes::WRONG_SHAPE, "a list of values where one value is needed", e.span)
                    .help("reduce it: `sum(x for x in (a, b))`"),
            ),
        }
    }

    /// An expression that must be a truth value.
    pub(in crate::elaborate) fn condition(&mut self, e: &Expr, place: &Place) -> ExprId {
        match self.sound_condition(e, place) {
            Some(c) => c,
            None => self.exprs.truth(false),
        }
    }

    /// An expression that must be a truth value; `None` after a report.
    pub(in crate::elaborate) fn sound_condition(&mut self, e: &Expr, place: &Place) -> Option<ExprId> {
        let v = self.value(e, place);
        match v.unit {
            Measure::Truth => Some(v.expr),
            Measure::Poison => None,
            _ => {
                self.ledger.report(
                    Diagnostic::error(codes::WRONG_KIND, "a condition is needed here, this is a number", e.span)
                        .help("compare it with something: `x > 0`"),
                );
                None
            }
        }
    }

    /// An expression as a number in `target`; a pure number is taken in it. Reports a mismatch
    /// against `what`.
    pub(in crate::elaborate) fn number_in(&mut self, e: &Expr, target: &Unit, what: &str, declared: Span, place: &Place) -> ExprId {
        let v = self.declared_value(e, place, &mut |s, v, span| s.values().in_unit(v, target, span, what, declared), target);
        self.values().in_unit(v, target, e.span, what, declared)
    }

    /// An expression where a unit is declared. The branches of an `if` are in that place
    /// themselves: `taken` takes each in the unit, so that a pure number in one of them means the
    /// same as alone.
    pub(in crate::elaborate) fn declared_value(
        &mut self,
        e: &Expr,
        place: &Place,
        taken: &mut dyn FnMut(&mut Self, Value, Span) -> ExprId,
        unit: &Unit,
    ) -> Value {
        if let ExprKind::Call { function, arguments } = &e.kind
            && function.text == BY_MEMBER
        {
            let Some(own) = membership::by_member(self, arguments, place) else { return self.poison() };
            return self.nested(own.span, |s| s.declared_value(own, place, taken, unit));
        }
        let ExprKind::If(c, a, b) = &e.kind else {
            let v = self.value(e, place);
            return match v.unit {
                Measure::Poison | Measure::Truth => v,
                _ => Value::of(taken(self, v, e.span), unit.clone()),
            };
        };
        self.nested(e.span, |s| operators::conditional_of(s, e.span, c, (a, b), place, &mut |s, e| s.declared_value(e, place, taken, unit)))
    }

    /// A name by itself.
    pub(in crate::elaborate) fn name(&mut self, name: &Ident, place: &Place) -> Value {
        if let Some(bound) = place.bound(&name.text).cloned() {
            return bound_value(self, name.span, &name.text, &bound, place);
        }
        if let Some(symbol) = self.symbols.lookup(place.scope, &name.text) {
            return self.symbol_value(symbol, &[], name.span, place);
        }
        if let Some(v) = phases::schedule_name(self, name) {
            return v;
        }
        if let Some(v) = builtin_name(self, name) {
            return v;
        }
        unknown_name(self, name, place.scope)
    }

    /// A whole variable's element.
    pub(in crate::elaborate) fn load(&mut self, symbol: SymbolId, at: Affine) -> Value {
        let SymbolKind::Variable { var, unit, .. } = &self.symbols[symbol].kind else { return self.poison() };
        let (var, unit) = (*var, unit.clone());
        let expr = self.exprs.load(var, Flavour::Value, at);
        Value::of(expr, unit)
    }

    /// A symbol with index expressions.
    pub(in crate::elaborate) fn symbol_value(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Value {
        if let Some(v) = phases::by_phase(self, symbol, index, span, place) {
            return v;
        }
        match self.symbols[symbol].kind.clone() {
            // Rules of disturbances run ahead of the step and read data, not the variable.
            SymbolKind::Variable { declaration: Declaration { measured: Some(measured), .. }, .. } if place.site == Site::Disturb => {
                let inner = Place { scope: self.symbols[symbol].scope, ..place.clone() };
                self.value(&measured.read, &inner)
            }
            SymbolKind::Variable { axes, .. } => {
                if let Some(face) = place.face
                    && let Some(v) = field::face_value(self, symbol, &axes, index, span, face, place)
                {
                    return v;
                }
                match indices::address(self, symbol, &axes, index, span, place) {
                    Some((at, _)) => self.load(symbol, at),
                    None => self.poison(),
                }
            }
            SymbolKind::Let { axes, binders, unit, definition, random, .. } => {
                expand_let(self, symbol, &axes, &binders, unit.as_ref(), definition, random, index, span, place, None)
            }
            SymbolKind::Table { axes, unit, values } => match indices::address(self, symbol, &axes, index, span, place) {
                Some((at, _)) if at.is_constant() => {
                    let expr = self.exprs.constant(values.get(at.offset as usize).copied().unwrap_or(f64::NAN));
                    Value::of(expr, unit)
                }
                address => match address.and_then(|(at, _)| self.table_entry(at, &values)) {
                    Some(expr) => Value::of(expr, unit),
                    None => {
                        self.ledger.speculation.refuse();
                        self.poison()
                    }
                },
            },
            SymbolKind::Integer(n) => {
                let expr = self.exprs.constant(n as f64);
                Value { expr, unit: if n == 0 { Measure::Zero } else { Measure::Bare } }
            }
            SymbolKind::Truth(holds) => Value::truth(self.exprs.truth(holds)),
            SymbolKind::Time => {
                let expr = self.exprs.time();
                Value::of(expr, self.symbols.time_unit.clone())
            }
            SymbolKind::Source(_) => reactions::source(self, symbol, index, span, place),
            SymbolKind::Stoichiometry(_) => reactions::stoichiometry(self, symbol, index, span, place),
            SymbolKind::Flux { .. } => flux::flux_at_end(self, symbol, index, span, place),
            SymbolKind::Faulty => self.poison(),
            SymbolKind::Phase(_) => {
                let name = Ident { text: "phase".to_owned(), span };
                phases::schedule_name(self, &name).unwrap_or_else(|| self.poison())
            }
            kind => no_value(self, symbol, &kind, span),
        }
    }

    /// `d/dt x`, `d/dt (expression)`: the rate of a variable, and by the chain rule that of an
    /// expression of some.
    pub(in crate::elaborate) fn derivative(&mut self, span: Span, inner: &Expr, place: &Place) -> Value {
        let v = self.value(inner, place);
        let Measure::Of(unit) = &v.unit else {
            return if v.is_poison() { v } else { self.values().not_a_state(span, inner) };
        };
        let unit = units::rate(unit, &self.symbols.time_unit);
        if let Node::Load { var, flavour, at } = self.exprs.node(v.expr) {
            return match self.symbols.vars[var].role {
                Role::State | Role::Algebraic if flavour == Flavour::Value => {
                    let expr = self.exprs.load(var, Flavour::Derivative, at);
                    Value::of(expr, unit)
                }
                _ => {
                    let fault = self.symbols.no_derivative(var, inner, span);
                    self.fault(fault)
                }
            };
        }
        if let Some(fault) = self.without_rate(v.expr, span) {
            return self.fault(fault);
        }
        if place.site == Site::Dynamics && !self.ledger.rated.contains(&(v.expr, span)) {
            self.ledger.rated.push((v.expr, span));
        }
        let vars = &self.symbols.vars;
        let moves = |exprs: &mut Exprs, load: Option<Loaded>| match load {
            None => Some(exprs.constant(1.0)),
            Some((var, Flavour::Value, at)) if matches!(vars[var].role, Role::State | Role::Algebraic) => {
                Some(exprs.load(var, Flavour::Derivative, at))
            }
            Some(_) => None,
        };
        match differentiate::total(self.exprs, usize::from(place.depth), v.expr, &moves) {
            Ok(expr) => Value::of(expr, unit),
            Err(_) => self.fault(
                Diagnostic::error(codes::WRONG_KIND, "the expression has too many nested sums to be differentiated", span)
                    .help("name the inner sum by a `var` with its own equation"),
            ),
        }
    }

    /// The fault of an expression without a rate: one that contains a rate, or something that
    /// jumps.
    fn without_rate(&self, e: ExprId, span: Span) -> Option<Diagnostic> {
        if self.exprs.has_derivative(e) {
            let message = "the time derivative of an expression that contains a time derivative";
            return Some(Diagnostic::error(codes::WRONG_KIND, message, span).help("give the inner one a name: `var v`, `eq v = d/dt x`"));
        }
        let jumps = self.exprs.loads(e, |var, flavour| flavour == Flavour::Value && self.symbols.jumps(var)).first().copied();
        let (var, ..) = jumps?;
        let v = &self.symbols.vars[var];
        let what = match v.role {
            Role::Action => "an action, which is held over a step and jumps between steps",
            Role::Disturbance => "a disturbance, which jumps between steps",
            Role::Quadrature => "an integral over the step",
            Role::Delayed => "a delayed value, which may jump",
            _ => "a discrete variable, which jumps at sampling instants",
        };
        let message = format!("the expression has no time derivative: `{}` is {what}", v.name);
        let fault = Diagnostic::error(codes::WRONG_KIND, message, span).secondary(v.span, "declared here");
        Some(fault.help(format!("write the rates of the other factors out, or declare `{}` with `state`", v.name)))
    }
}

impl Symbols<'_> {
    /// Reports the time derivative of a variable that is not a state.
    fn no_derivative(&self, var: VarId, inner: &Expr, span: Span) -> Diagnostic {
        let name = reference(inner);
        let (what, help) = match self.vars[var].role {
            Role::Discrete => {
                let set = format!("change it at the sampling instants, `at start {{ next {name} = ... }}`");
                ("a discrete variable, which is constant between sampling instants", format!("{set}, or declare it with `state`"))
            }
            Role::Param => ("a parameter, which is constant", "declare it with `state`".to_owned()),
            Role::Action => ("an action, which is held over a step", "declare it with `state`, and the rate as the action".to_owned()),
            _ => ("not a state", "declare it with `state`".to_owned()),
        };
        let message = format!("only a state has a time derivative: `{name}` is {what}");
        Diagnostic::error(codes::WRONG_KIND, message, span).secondary(self.vars[var].span, "declared here").help(help)
    }

    /// Returns `true` if a variable changes at instants only.
    fn jumps(&self, var: VarId) -> bool {
        matches!(self.vars[var].role, Role::Action | Role::Disturbance | Role::Discrete | Role::Quadrature | Role::Delayed)
    }

    /// Name of the independent variable.
    fn time_name(&self) -> Option<&str> {
        self.list.values().find(|symbol| matches!(symbol.kind, SymbolKind::Time)).map(|symbol| symbol.path.as_str())
    }
}

fn unknown_name(l: &mut Lowering<'_, '_>, name: &Ident, scope: ScopeId) -> Value {
    if let Some(time) = l.symbols.time_name().filter(|_| matches!(name.text.as_str(), "time" | "t")) {
        let help = format!("the time is called `{time}` here");
        let fault = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown name `{}`", name.text), name.span);
        return l.fault(fault.label("not declared").help(help));
    }
    let help = if l.ledger.reports.may_suggest() { l.ledger.reports.did_you_mean(&name.text, l.symbols.visible(scope)) } else { None };
    let d =
        Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown name `{}`", name.text), name.span).label("not declared").maybe_help(help);
    l.fault(d)
}

fn bound_value(l: &mut Lowering<'_, '_>, span: Span, name: &str, bound: &Bound, place: &Place) -> Value {
    match bound {
        Bound::Value(v) => v.clone(),
        Bound::Axis(_) => {
            let message = format!("`{name}` is a set; use a member as an index");
            l.fault(Diagnostic::error(codes::WRONG_KIND, message, span))
        }
        Bound::Number(e) => Value::bare(*e),
        Bound::Run(numbers) => l.values().run_value(*numbers),
        Bound::Member(set, index) => match l.symbols.sets[*set].first {
            Some(first) => {
                let expr = l.exprs.constant((first + *index as i64) as f64);
                Value { expr, unit: Measure::Bare }
            }
            None => l.fault(
                Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is a member of a set, not a number"), span)
                    .help("use it as an index"),
            ),
        },
        Bound::Cell(domain, cell) => grid::cell_centre(l, *domain, *cell),
        Bound::Face(domain, face) => grid::face_position_value(l, *domain, *face),
        Bound::Alias(e, scope, bindings) => {
            let mut inner = place.clone();
            inner.scope = *scope;
            inner.bindings = bindings.clone();
            let e = e.clone();
            l.value(&e, &inner)
        }
        Bound::Element(symbol, at) => l.load(*symbol, *at),
    }
}

/// Reports a name that stands for no value.
fn no_value(l: &mut Lowering<'_, '_>, symbol: SymbolId, kind: &SymbolKind<'_>, span: Span) -> Value {
    let path = l.symbols[symbol].path.clone();
    let mut d = match kind {
        SymbolKind::TimeTable { time_unit, .. } => {
            let of_time = time_unit.commensurable(&l.symbols.time_unit);
            let argument = l.symbols.time_name().filter(|_| of_time).unwrap_or("x");
            let message = format!("`{path}` is a table over {}, which takes an argument", units::describe(time_unit));
            Diagnostic::error(codes::WRONG_KIND, message, span).help(format!("write `{path}({argument})`"))
        }
        SymbolKind::Surface { units, .. } => {
            let message = format!("`{path}` is a table over two quantities, in {} and {}, which takes two arguments", units[0], units[1]);
            Diagnostic::error(codes::WRONG_KIND, message, span).help(format!("write `{path}(x, y)`"))
        }
        _ => {
            let what = match kind {
                SymbolKind::Def { .. } => "a function; call it with arguments",
                SymbolKind::Set(_) => "a set; use a member as an index",
                SymbolKind::Tuple(_) => "a list of variables; bind them by `for x in`",
                SymbolKind::Domain(_) => "a domain; bind it with `for`",
                SymbolKind::Choice { .. } => "a choice; compare it with one of its options",
                _ => "a component; name one of its variables",
            };
            Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}"), span)
        }
    };
    d = crate::elaborate::built_ins::note(d, &path);
    l.fault(d)
}

/// Reading of an expression other than for its value.
pub(in crate::elaborate) type Own = fn(&mut Lowering<'_, '_>, &Expr, &Place) -> Value;

/// Result of a separate reading of the definition of a name without a unit; `None` for other names.
pub(in crate::elaborate) fn read_definition(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    index: &[Expr],
    span: Span,
    place: &Place,
    amount: Own,
) -> Option<Value> {
    let SymbolKind::Let { axes, binders, unit: None, definition, random: false, .. } = l.symbols[symbol].kind.clone() else {
        return None;
    };
    Some(expand_let(l, symbol, &axes, &binders, None, definition, false, index, span, place, Some(amount)))
}

#[allow(clippy::too_many_arguments, reason = "the parts of one symbol")]
fn expand_let(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    axes: &[Axis],
    binders: &[String],
    unit: Option<&Unit>,
    definition: &Expr,
    random: bool,
    index: &[Expr],
    span: Span,
    place: &Place,
    amount: Option<Own>,
) -> Value {
    let Some((_, bounds)) = indices::address(l, symbol, axes, index, span, place) else { return l.poison() };
    // At a face a field index keeps meaning "here", so the expansion is made anew.
    let key = place.face.is_none().then(|| {
        let site = if random { Site::Reset } else { place.site };
        let asked = if amount.is_some() { Asked::Amount } else { Asked::Value };
        (symbol, bounds.iter().map(crate::elaborate::lower::place::IndexKey::of).collect::<Vec<_>>(), site, asked)
    });
    if let Some(v) = key.as_ref().and_then(|k| l.expansions.value(k)) {
        return v.clone();
    }
    if l.expansions.is_open(symbol) {
        return needs_itself(l, symbol);
    }
    let mut inner = Place { scope: l.symbols[symbol].scope, bindings: None, ..place.clone() };
    if random {
        (inner.site, inner.depth) = (Site::Reset, 0);
    }
    for (name, bound) in binders.iter().zip(bounds) {
        inner = inner.bind(name, bound);
    }
    l.expansions.note_use(symbol);
    l.expansions.enter(symbol);
    let outer_stream = random.then(|| {
        let path = l.symbols[symbol].path.clone();
        l.hidden.draws.site.replace((path, crate::model::Instant::Reset))
    });
    // A fault of a definition is its own, whoever asks for it.
    let calls = std::mem::take(&mut l.ledger.reports.calls);
    let v = match (amount, unit) {
        (Some(amount), _) => amount(l, definition, &inner),
        (None, Some(unit)) => value_of_let(l, symbol, definition, unit, random, &inner),
        (None, None) => l.value(definition, &inner),
    };
    l.ledger.reports.calls = calls;
    if let Some(outer) = outer_stream {
        l.hidden.draws.site = outer;
    }
    l.expansions.leave();
    if let Some(key) = key {
        l.ledger.speculation.remember(&key);
        l.expansions.remember(key, v.clone());
    }
    v
}

/// Reports a definition that needs itself.
fn needs_itself(l: &mut Lowering<'_, '_>, symbol: SymbolId) -> Value {
    let path = l.symbols[symbol].path.clone();
    let at = l.symbols[symbol].span;
    let chain = l.expansions.cycle(symbol, l.symbols);
    l.fault(
        Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the definition of `{path}` needs itself{chain}"), at)
            .help("make it a `var` with its own equation: then it is solved for"),
    )
}

/// The value of a `let` with a unit, in that unit: strictly, but for a pure number and what is
/// drawn.
fn value_of_let<'m, 'a>(l: &mut Lowering<'m, 'a>, symbol: SymbolId, definition: &Expr, unit: &Unit, random: bool, place: &Place) -> Value {
    let declared = l.symbols[symbol].span;
    let what = format!("`{}`", l.symbols[symbol].path);
    let taken = &mut |s: &mut Lowering<'m, 'a>, v: Value, span: Span| {
        if random {
            s.values().in_unit(v, unit, span, &what, declared)
        } else {
            s.values().strictly_or_bare(v, unit, span, &what, declared)
        }
    };
    l.declared_value(definition, place, taken, unit)
}

fn builtin_name<'m, 'a>(l: &mut Lowering<'m, 'a>, name: &Ident) -> Option<Value> {
    let builtin = |s: &mut Lowering<'m, 'a>, b: Builtin| s.exprs.load(s.hidden.builtins, Flavour::Value, Affine::constant(b as i64));
    Some(match name.text.as_str() {
        // Pure numbers in any unit, as the functions of numbers that they stand for: `pi` is half a
        // turn.
        "pi" => Value::of(l.exprs.constant(std::f64::consts::PI), Unit::one()),
        "e" => Value::of(l.exprs.constant(std::f64::consts::E), Unit::one()),
        "inf" => Value { expr: l.exprs.constant(f64::INFINITY), unit: Measure::Zero },
        "n" | "steps" => Value::bare(builtin(l, Builtin::Steps)),
        "step" => {
            let e = builtin(l, Builtin::StepLength);
            Value::of(e, l.symbols.time_unit.clone())
        }
        "clock" => {
            let e = builtin(l, Builtin::Clock);
            Value::of(e, l.symbols.time_unit.clone())
        }
        "success" | "failure" | "timeout" | "reward" | "error_reward" => {
            return outcome::outcome_name(l, name).or_else(|| {
                Some(l.fault(Diagnostic::error(
                    codes::MISPLACED_FUNCTION,
                    format!("`{}` is known at the end of a step: it has a meaning in rewards and in `fail` only", name.text),
                    name.span,
                )))
            });
        }
        _ => return None,
    })
}
