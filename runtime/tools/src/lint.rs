//! Lints: texts that are legal and unwise, each with a code. A comment `# allow W0302` on the line,
//! or alone on the line above, silences one.

use smpl_compiler::model::{Interface, Quantity};
use smpl_dsl::diagnostic::{Code, Diagnostic, SourceMap, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Declaration, Expr, ExprKind, File, Role, Statement, StatementKind};

/// Numbers that are constants of nature, and what to write instead; a literal within this relative
/// distance is one.
const CONSTANTS: &[(f64, f64, &str, &str)] = &[
    (273.15, 1e-6, "the zero of the Celsius scale in kelvin", "use `kelvin(T)` or `celsius(T)`"),
    (8.314_462_618, 1e-3, "the molar gas constant", "declare it: `param R : J/(mol K) = 8.314462618`"),
    (96_485.332, 1e-4, "the Faraday constant", "declare it: `param F : C/mol = 96485.33212`"),
    (9.806_65, 1e-3, "the standard acceleration of gravity", "declare it: `param g : m/s^2 = 9.80665`"),
    (6.022_140_76e23, 1e-3, "the Avogadro constant", "declare it: `param N_A : 1/mol = 6.02214076e23`"),
    (1.380_649e-23, 1e-3, "the Boltzmann constant", "declare it: `param k_B : J/K = 1.380649e-23`"),
];

/// Sizes of states within this factor of 1, or of their range, need no scale.
const FAR: f64 = 1e4;

/// The lints of a file, in the order of the text.
#[must_use]
pub fn lints(file: &File, interface: &Interface) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    statements(&file.statements, interface, &mut found);
    idle_events(&file.statements, &mut found);
    found.sort_by_key(|lint| (lint.primary.span.start, lint.code.id()));
    found
}

/// Removes what comments of the text allow.
#[must_use]
pub fn allowed(found: Vec<Diagnostic>, sources: &SourceMap) -> Vec<Diagnostic> {
    found.into_iter().filter(|lint| !is_allowed(lint.code, lint.primary.span, sources)).collect()
}

fn is_allowed(code: Code, span: Span, sources: &SourceMap) -> bool {
    let Some(source) = sources.file(span.file) else { return false };
    let number = code.id().split('-').next().unwrap_or_default();
    let allows = |line: &str| {
        let Some((_, comment)) = line.split_once('#') else { return false };
        let Some(list) = comment.trim_start().strip_prefix("allow ") else { return false };
        list.split([' ', ',', ':']).any(|word| word == number || word == code.id())
    };
    let before = source.text().get(..span.start as usize).unwrap_or_default();
    let start = before.rfind('\n').map_or(0, |at| at + 1);
    let line = source.text()[start..].lines().next().unwrap_or_default();
    let above = before[..start.saturating_sub(1).min(before.len())].lines().next_back().unwrap_or_default();
    allows(line) || above.trim_start().starts_with('#') && allows(above)
}

fn statements(list: &[Statement], interface: &Interface, found: &mut Vec<Diagnostic>) {
    for statement in list {
        expressions(&statement.kind).into_iter().for_each(|e| magic_numbers(e, found));
        match &statement.kind {
            StatementKind::Declare { role: Role::State, declarations } => {
                declarations.iter().for_each(|d| found.extend(missing_scale(d, interface)));
            }
            StatementKind::Observe { items } => items.iter().for_each(|o| {
                let name = match (&o.name, &o.value.kind) {
                    (Some(name), _) | (None, ExprKind::Name(name)) => name.text.as_str(),
                    _ => "...",
                };
                found.extend(open_bounds(name, o.bounds.as_ref(), o.span));
            }),
            StatementKind::Event { name, condition, .. } => found.extend(unreachable(&name.text, condition, interface)),
            StatementKind::Fail { name, event: true, condition, .. } | StatementKind::Success { name, event: true, condition, .. } => {
                found.extend(unreachable(&name.text, condition, interface));
            }
            other => statements(other.block(), interface, found),
        }
    }
}

/// Expressions in which a number has no declared unit: those of equations, definitions, updates and
/// of the control problem.
fn expressions(kind: &StatementKind) -> Vec<&Expr> {
    match kind {
        StatementKind::Equation { lhs, rhs, .. } => vec![lhs, rhs],
        StatementKind::Declare { role: Role::Let, declarations } => declarations.iter().filter_map(|d| d.value.as_ref()).collect(),
        StatementKind::Def { body, locals, .. } => locals.iter().map(|local| &local.value).chain([body]).collect(),
        StatementKind::Flux(flux) => [Some(&flux.inner), flux.low.as_ref(), flux.high.as_ref()].into_iter().flatten().collect(),
        StatementKind::Next { value, .. } | StatementKind::Reset { value, .. } | StatementKind::Reward { value, .. } => vec![value],
        StatementKind::Control(_) | StatementKind::Reaction(_) => kind.expressions(),
        StatementKind::Observe { items } => items.iter().map(|item| &item.value).collect(),
        StatementKind::Fail { condition, .. }
        | StatementKind::Success { condition, .. }
        | StatementKind::Constraint { condition, .. }
        | StatementKind::Event { condition, .. } => vec![condition],
        StatementKind::Model { .. }
        | StatementKind::Import { .. }
        | StatementKind::Time { .. }
        | StatementKind::Unit { .. }
        | StatementKind::Set { .. }
        | StatementKind::Table(_)
        | StatementKind::TimeTable(_)
        | StatementKind::Declare { .. }
        | StatementKind::Domain(_)
        | StatementKind::Connector { .. }
        | StatementKind::Component { .. }
        | StatementKind::Port { .. }
        | StatementKind::Instance { .. }
        | StatementKind::Connect { .. }
        | StatementKind::Initial { .. }
        | StatementKind::StartEquation { .. }
        | StatementKind::StartSteady { .. }
        | StatementKind::Steady { .. }
        | StatementKind::Level { .. }
        | StatementKind::Invariant { .. }
        | StatementKind::Episode { .. }
        | StatementKind::Solver { .. }
        | StatementKind::Policy { .. }
        | StatementKind::At { .. }
        | StatementKind::Clamp { .. }
        | StatementKind::Phase(_)
        | StatementKind::Test { .. }
        | StatementKind::TestStep(_)
        | StatementKind::Remove { .. }
        | StatementKind::Variant { .. }
        | StatementKind::Choice { .. }
        | StatementKind::When { .. } => Vec::new(),
    }
}

fn magic_numbers(e: &Expr, found: &mut Vec<Diagnostic>) {
    e.walk(&mut |e| {
        let ExprKind::Number { value, .. } = &e.kind else { return };
        let constant = CONSTANTS.iter().find(|(constant, distance, ..)| (value / constant - 1.0).abs() <= *distance);
        if let Some((_, _, meaning, help)) = constant {
            let message = format!("{value} is {meaning}");
            found
                .push(Diagnostic::warning(codes::MAGIC_NUMBER, message, e.span).label("a constant of nature in an expression").help(*help));
        }
    });
}

/// The quantity of a declaration at the level of the file.
fn quantity<'i>(list: &'i [Quantity], name: &str) -> Option<&'i Quantity> {
    list.iter().find(|quantity| quantity.name == name)
}

/// A state whose size is far from that by which its absolute tolerance is chosen.
fn missing_scale(d: &Declaration, interface: &Interface) -> Option<Diagnostic> {
    if d.scale.is_some() {
        return None;
    }
    let state = quantity(&interface.quantities.states, &d.name.text)?;
    let size = state.default.iter().filter(|x| x.is_finite()).fold(0.0_f64, |most, x| most.max(x.abs()));
    let scale = state.scale.iter().copied().filter(|x| x.is_finite()).fold(0.0_f64, f64::max);
    let far = size > 0.0 && scale > 0.0 && (size > FAR * scale || size * FAR < scale);
    let message = format!("`{}` starts at {size} and is scaled by {scale}, from which its absolute tolerance follows", d.name.text);
    let help = format!("add `scale {size}`, or bounds that fit, to the declaration");
    far.then(|| Diagnostic::warning(codes::MISSING_SCALE, message, d.name.span).label("far from its scale").help(help))
}

/// Bounds with one end open, by which nothing can be normalised.
fn open_bounds(name: &str, bounds: Option<&(Expr, Expr)>, span: Span) -> Option<Diagnostic> {
    let (low, high) = bounds?;
    let open = |e: &Expr| {
        let mut open = false;
        e.walk(&mut |e| open |= matches!(&e.kind, ExprKind::Name(name) if name.text == "inf"));
        open
    };
    let message = format!("the observation `{name}` is bounded on one side only");
    let help = "give both ends: what learns from it is scaled by them";
    (open(low) != open(high)).then(|| Diagnostic::warning(codes::OPEN_BOUNDS, message, span).help(help))
}

/// An event whose threshold is outside of the declared bounds of the variable that it compares.
fn unreachable(name: &str, condition: &Expr, interface: &Interface) -> Option<Diagnostic> {
    let ExprKind::Binary(op @ (BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge), left, right) = &condition.kind else {
        return None;
    };
    let rises = matches!(op, BinaryOp::Gt | BinaryOp::Ge);
    let (variable, number, rises) = match (&left.kind, &right.kind) {
        (ExprKind::Name(variable), _) => (variable, right, rises),
        (_, ExprKind::Name(variable)) => (variable, left, !rises),
        _ => return None,
    };
    let i = &interface.quantities;
    let q = quantity(&i.states, &variable.text).or_else(|| quantity(&i.algebraics, &variable.text))?;
    let threshold = written(number, &q.unit)?;
    let (low, high) = (q.low.first().copied()?, q.high.first().copied()?);
    let beyond = if rises { threshold > high } else { threshold < low };
    let message = format!("the event `{name}` is outside the bounds of `{}`, {low}..{high}", variable.text);
    let help = "move the threshold or the bounds: inside of them the event cannot happen";
    beyond.then(|| Diagnostic::warning(codes::UNREACHABLE_EVENT, message, condition.span).label("never inside of the bounds").help(help))
}

/// The number that is written, in a unit of the model.
fn written(e: &Expr, unit: &str) -> Option<f64> {
    let (value, own) = match &e.kind {
        ExprKind::Number { value, unit } => (*value, unit.as_ref()),
        ExprKind::Unary(smpl_dsl::syntax::UnaryOp::Neg, inner) => return written(inner, unit).map(|x| -x),
        _ => return None,
    };
    let Some(own) = own else { return Some(value) };
    let refuse = |e: &Expr| Err(Diagnostic::error(codes::UNKNOWN_UNIT, "not known here", e.span));
    let none = smpl_dsl::units::OwnUnits::default();
    let own = smpl_dsl::units::resolve(own, &none, &mut { refuse }).ok()?;
    let of = smpl_dsl::parse_unit(unit, smpl_dsl::span::FileId(0), 1)?;
    let conversion = own.conversion_to(&smpl_dsl::units::resolve(&of, &none, &mut { refuse }).ok()?)?;
    Some(value * conversion.factor + conversion.offset)
}

/// Events without a block `at` that they run, which no phase waits for.
fn idle_events(list: &[Statement], found: &mut Vec<Diagnostic>) {
    let runs = |name: &str| {
        list.iter().any(|statement| match &statement.kind {
            StatementKind::At { instant, .. } => instant.text == name,
            StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => {
                body.iter().any(|s| matches!(&s.kind, StatementKind::At { instant, .. } if instant.text == name))
            }
            StatementKind::Phase(phase) => phase.until.as_ref().is_some_and(|until| until.mentions(name)),
            _ => false,
        })
    };
    for statement in list {
        let StatementKind::Event { name, .. } = &statement.kind else { continue };
        if !runs(&name.text) {
            let message = format!("nothing happens at the event `{}`", name.text);
            let help = format!("add `at {} {{ ... }}`, or end the episode with `fail` or `success`", name.text);
            found.push(Diagnostic::warning(codes::IDLE_EVENT, message, name.span).help(help));
        }
    }
}
