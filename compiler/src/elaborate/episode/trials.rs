//! Tests of the text: what they set and expect, as numbers of the output.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expect, Expr, ExprKind, Ident, Statement, StatementKind, TestStep as Written};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::{each, store};
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, boxes, defaults, structural};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, SymbolKind};
use crate::ir::{Affine, BinaryFn, ExprId, Flavour, Nest, Place as Memory, Program, Role, UnaryFn};
use crate::model::{Expectation, Finish, Quantity, Test, TestStep};

/// Starts that a test may name.
const STARTS: [&str; 4] = ["sampled", "nominal", "steady", "cyclic"];

/// Most control steps of one test.
const MAX_STEPS: i64 = 10_000_000;

/// Tolerance of `expect steady`.
const STEADY: f64 = 1e-6;

/// Variables that a test may set.
const SETTABLE: [Role; 5] = [Role::Action, Role::Param, Role::Disturbance, Role::State, Role::Discrete];

/// The tests that are asked for. Their numbers follow those of the outputs; what is only checked
/// leaves nothing behind.
pub(in crate::elaborate) fn tests<'a>(
    l: &mut Lowering<'_, 'a>,
    blocks: &[(ScopeId, Vec<Item<'a>>)],
    (program, outputs): (&mut Program, &mut Vec<Quantity>),
    policies: &[(String, Program)],
    finish: &Finish,
) -> Vec<Test> {
    refuse_inner(l, blocks);
    let asked = l.input.options.tests.clone();
    if asked.is_none() && !l.input.options.lints {
        return Vec::new();
    }
    let first = outputs.iter().map(Quantity::len).sum();
    let mut trials = Trials { numbers: Vec::new(), first, policies, finish };
    let mut seen: Vec<(&str, Span)> = Vec::new();
    let mut list = Vec::new();
    let statements: &'a [Statement] = l.input.files.first().map_or(&[], |file| &file.statements);
    for statement in statements {
        let StatementKind::Test { name, name_span, body } = &statement.kind else { continue };
        if let Some((_, before)) = seen.iter().find(|(other, _)| other == name) {
            let fault = Diagnostic::error(codes::DUPLICATE_NAME, format!("two tests are called `{name}`"), *name_span);
            l.ledger.report(fault.secondary(*before, "the first one"));
        }
        seen.push((name, *name_span));
        let wanted = match &asked {
            Some(names) => names.contains(name),
            None => !body.iter().any(changes_the_model),
        };
        if wanted {
            list.push(trials.test(l, (name, *name_span), body));
        }
    }
    if asked.is_none() {
        return Vec::new();
    }
    let place = |i: usize| Affine::constant((first + i) as i64);
    let stores = trials.numbers.iter().enumerate().map(|(i, &e)| store(Memory::Out, place(i), e)).collect();
    outputs.extend((0..trials.numbers.len()).map(hidden));
    program.nests.push(Nest { loops: Vec::new(), stores });
    list
}

/// Refuses tests in components and variants: they belong to the file.
fn refuse_inner(l: &mut Lowering<'_, '_>, blocks: &[(ScopeId, Vec<Item<'_>>)]) {
    let top: Vec<Span> = l.input.files.iter().flat_map(|file| &file.statements).map(|statement| statement.span).collect();
    for (_, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Test { name, name_span, .. }, span }) = item else { continue };
        if !top.contains(span) {
            let fault = Diagnostic::error(codes::BAD_TEST, format!("the test `{name}` is inside of another block"), *name_span);
            l.ledger.report(fault.help("move it out: `variant NAME` in a test turns a variant on"));
        }
    }
}

/// Returns whether a statement of a test turns on a variant, so that the present model may not have
/// what the test names.
fn changes_the_model(statement: &Statement) -> bool {
    matches!(&statement.kind, StatementKind::TestStep(Written::Choose { word, .. }) if word.text == "variant")
}

/// A number of a test as an output.
fn hidden(at: usize) -> Quantity {
    Quantity {
        var: None,
        name: format!("test {at}"),
        axes: Vec::new(),
        pattern: None,
        unit: "1".to_owned(),
        text: String::new(),
        low: vec![f64::NEG_INFINITY],
        high: vec![f64::INFINITY],
        default: vec![f64::NAN],
        scale: vec![1.0],
        affine_unit: false,
        structural: false,
        nonnegative: false,
    }
}

/// The numbers of all tests, and what their names are looked up in.
struct Trials<'t> {
    numbers: Vec<ExprId>,
    first: usize,
    policies: &'t [(String, Program)],
    finish: &'t Finish,
}

impl Trials<'_> {
    fn test(&mut self, l: &mut Lowering<'_, '_>, (name, span): (&str, Span), body: &[Statement]) -> Test {
        let mut test = Test { name: name.to_owned(), span, start: "sampled".into(), policy: "nominal".into(), steps: Vec::new() };
        let (mut total, mut expects) = (0, false);
        for statement in body {
            let StatementKind::TestStep(step) = &statement.kind else { continue };
            match step {
                Written::Start(word) => self.start(l, word, total, &mut test),
                Written::Policy(name) => self.policy(l, name, &mut test),
                Written::Choose { .. } => {}
                Written::Assign { target, value } => test.steps.extend(assigned(l, target, value, total)),
                Written::Steps(e) => test.steps.extend(steps(l, e, "steps", &mut total)),
                Written::For(e) => test.steps.extend(steps(l, e, "for", &mut total)),
                Written::Expect(what) => {
                    expects = true;
                    if let Some(what) = self.expectation(l, what, statement.span) {
                        test.steps.push(TestStep::Expect { span: statement.span, what });
                    }
                }
            }
        }
        // A faulty expectation is left out, and was reported.
        if !expects && body.iter().all(|s| matches!(s.kind, StatementKind::TestStep(_))) {
            let fault = Diagnostic::error(codes::BAD_TEST, format!("the test `{name}` expects nothing"), span);
            l.ledger.report(fault.help("add what must hold, as `expect x > 0` or `expect x within 1e-6 of 6`"));
        }
        test
    }

    fn start(&self, l: &mut Lowering<'_, '_>, word: &Ident, total: i64, test: &mut Test) {
        if !STARTS.contains(&word.text.as_str()) {
            let message = format!("unknown start `{}`", word.text);
            let near = did_you_mean(&word.text, STARTS);
            let help = near.unwrap_or_else(|| format!("a start is one of {}; `scenario {}` runs a scenario", STARTS.join(", "), word.text));
            return l.ledger.report(Diagnostic::error(codes::BAD_TEST, message, word.span).help(help));
        }
        if total > 0 {
            let fault = Diagnostic::error(codes::BAD_TEST, "`start` after steps were taken", word.span);
            return l.ledger.report(fault.help("put it before the first `steps` or `for`"));
        }
        test.start.clone_from(&word.text);
    }

    fn policy(&self, l: &mut Lowering<'_, '_>, name: &Ident, test: &mut Test) {
        let known = || self.policies.iter().map(|(known, _)| known.as_str());
        if !known().any(|known| known == name.text) {
            let near = did_you_mean(&name.text, known());
            let fault = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown policy `{}`", name.text), name.span);
            return l.ledger.report(fault.maybe_help(near));
        }
        test.policy.clone_from(&name.text);
    }

    /// A number of the output.
    fn number(&mut self, l: &mut Lowering<'_, '_>, e: ExprId) -> usize {
        self.numbers.push(l.exprs.number(e));
        self.first + self.numbers.len() - 1
    }

    fn expectation(&mut self, l: &mut Lowering<'_, '_>, what: &Expect, span: Span) -> Option<Expectation> {
        let place = Place::new(ScopeId::from_u32(0), Site::Instant);
        match what {
            Expect::Holds(condition) => self.holds(l, condition, &place),
            Expect::Within { value, tolerance, target } => self.within(l, value, tolerance, target, &place),
            Expect::Failure(name) => {
                let reserved = ["action_box", "solver", "events", "not_finite"];
                let known = self.finish.failures.iter().map(|f| f.name.as_str()).chain(reserved);
                ended(l, name.as_ref(), "failure", known.collect()).map(Expectation::Failure)
            }
            Expect::Success(name) => {
                let known = self.finish.successes.iter().map(String::as_str).collect();
                ended(l, name.as_ref(), "success", known).map(Expectation::Success)
            }
            Expect::Steady(tolerance) => {
                let tolerance = match tolerance {
                    Some(e) => l.number_in(e, &Unit::one(), "the tolerance", span, &place),
                    None => l.exprs.constant(STEADY),
                };
                let change = change_in_a_step(l);
                Some(Expectation::Steady { change: self.number(l, change), tolerance: self.number(l, tolerance) })
            }
        }
    }

    fn holds(&mut self, l: &mut Lowering<'_, '_>, condition: &Expr, place: &Place) -> Option<Expectation> {
        let holds = l.sound_condition(condition, place)?;
        let unknown = doubting(l).unknown(holds);
        let holds = l.values().or_nan(holds, unknown);
        let sides = match &condition.kind {
            ExprKind::Binary(BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge | BinaryOp::Eq | BinaryOp::Ne, a, b) => {
                sides(l, a, b, place)
            }
            _ => None,
        };
        let holds = self.number(l, holds);
        Some(Expectation::Holds { holds, sides: sides.map(|(a, b, unit)| (self.number(l, a), self.number(l, b), unit)) })
    }

    fn within(&mut self, l: &mut Lowering<'_, '_>, value: &Expr, tolerance: &Expr, target: &Expr, place: &Place) -> Option<Expectation> {
        let v = l.value(value, place);
        let unit = v.unit.unit();
        if v.is_poison() {
            return None;
        }
        let found = l.values().in_unit(v, &unit, value.span, "the value", Span::default());
        let mut taken = |e: &Expr, unit: &Unit, what: &str| {
            let v = l.value(e, place);
            l.values().strictly_or_bare(v, unit, e.span, what, value.span)
        };
        let tolerance = taken(tolerance, &unit.difference(), "the tolerance");
        let target = taken(target, &unit, "the expected value");
        let [value, tolerance, target] = [found, tolerance, target].map(|e| self.number(l, e));
        Some(Expectation::Within { value, tolerance, target, unit: unit.to_string() })
    }
}

/// Both sides of a comparison of numbers, in the unit of the first that has one.
fn sides(l: &mut Lowering<'_, '_>, a: &Expr, b: &Expr, place: &Place) -> Option<(ExprId, ExprId, String)> {
    let (left, right) = (l.value(a, place), l.value(b, place));
    let unit = if left.unit.is_plain() { right.unit.unit() } else { left.unit.unit() };
    let mut number = |v: crate::elaborate::lower::value::Value| match &v.unit {
        crate::elaborate::lower::value::Measure::Truth => None,
        crate::elaborate::lower::value::Measure::Of(own) => l.values().convert(v.expr, &own.clone(), &unit),
        _ => l.values().convert(v.expr, &Unit::one(), &unit).or(Some(v.expr)),
    };
    Some((number(left)?, number(right)?, unit.to_string()))
}

/// An end by a name that there is.
fn ended(l: &mut Lowering<'_, '_>, name: Option<&Ident>, what: &str, known: Vec<&str>) -> Option<Option<String>> {
    let Some(name) = name else { return Some(None) };
    if known.contains(&name.text.as_str()) {
        return Some(Some(name.text.clone()));
    }
    let near = did_you_mean(&name.text, known.iter().copied());
    let all = if known.is_empty() { format!("the model declares no {what}") } else { format!("it is one of {}", known.join(", ")) };
    let fault = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown {what} `{}`", name.text), name.span);
    l.ledger.report(fault.help(near.unwrap_or(all)));
    None
}

/// The largest change of a state over a step at its present rate, relative to its scale.
fn change_in_a_step(l: &mut Lowering<'_, '_>) -> ExprId {
    let step = l.exprs.constant(l.names.step);
    let mut largest = l.exprs.constant(0.0);
    for var in l.variables_of(Role::State) {
        let scales = l.quantities.get(&var).map_or_else(Vec::new, |q| q.scale.clone());
        for i in 0..i64::from(l.symbols.vars[var].len) {
            let rate = l.exprs.load(var, Flavour::Derivative, Affine::constant(i));
            let size = l.exprs.unary(UnaryFn::Abs, rate);
            let scale = l.exprs.constant(Quantity::pick(&scales, i as usize));
            let moved = l.exprs.mul(size, step);
            let change = l.exprs.div(moved, scale);
            largest = l.exprs.binary(BinaryFn::Max, largest, change);
        }
    }
    largest
}

/// A run of so many steps.
fn steps(l: &mut Lowering<'_, '_>, e: &Expr, what: &str, total: &mut i64) -> Option<TestStep> {
    let place = Place::new(ScopeId::from_u32(0), Site::Instant);
    let n = structural::steps(l, e, what, &place)?;
    *total = total.saturating_add(n.max(1));
    if n < 1 || *total > MAX_STEPS {
        let message = if n < 1 { format!("a run of {n} steps") } else { format!("a test of more than {MAX_STEPS} steps") };
        l.ledger.report(Diagnostic::error(codes::BAD_TEST, message, e.span).help("run at least one step, and fewer of them"));
        return None;
    }
    Some(TestStep::Run(n as u32))
}

/// A value for a variable of the model.
fn assigned(l: &mut Lowering<'_, '_>, target: &Expr, e: &Expr, total: i64) -> Option<TestStep> {
    let place = Place::new(ScopeId::from_u32(0), Site::Instant);
    let (symbol, at) = boxes::target(l, target, &place, &SETTABLE)?;
    let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
    let role = l.symbols.vars[var].role;
    let path = l.symbols[symbol].path.clone();
    let reports = l.ledger.reports.diagnostics.len();
    let expr = l.number_in(e, &unit, &format!("`{path}`"), target.span, &place);
    let Some(value) = defaults::constant_value(l, expr).filter(|x| x.is_finite()) else {
        if reports == l.ledger.reports.diagnostics.len() {
            l.ledger.missing_value("what a test sets", e.span);
        }
        return None;
    };
    if total > 0 && !matches!(role, Role::Action | Role::Disturbance) {
        let message = format!("`{path}` is set after steps were taken");
        let help = "set it before the first `steps` or `for`; actions and disturbances may change later";
        l.ledger.report(Diagnostic::error(codes::BAD_TEST, message, target.span).help(help));
        return None;
    }
    if role == Role::Param && l.constants.is_structural(var) {
        let message = format!("`{path}` gives the model sizes or indices and cannot be set by a test");
        l.ledger.report(Diagnostic::error(codes::BAD_TEST, message, target.span).help("choose a scenario that sets it"));
        return None;
    }
    let quantity = l.quantities.get(&var)?;
    let elements = at.map_or(0..quantity.len(), |at| at.offset as usize..at.offset as usize + 1);
    Some(TestStep::Set { role, names: elements.map(|i| quantity.element_name(i)).collect(), value, span: target.span })
}
