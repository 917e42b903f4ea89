//! `transport(c, v, L)`: plug flow over a length L at a velocity v that changes.
//!
//! What leaves has entered a residence time θ ago: over the last θ the velocity has the integral L.
//! Before names are looked up, a call in an equation or a `let` gets θ as its fourth argument, and
//! these statements follow:
//!
//! ```text
//! state θ
//! initial eq θ*v = L free θ
//! eq d/dt θ = w*(1 - v/delay(v, θ)) + (1 - w)*(L - v*θ)/L
//! fail transport_1_stops event v <= 0
//! ```
//!
//! The first term is the derivative of the integral by time, and w is (t - delay(t, θ))/θ, which is
//! 1. At rest delayed values are the present ones: w is 0 there, and θ is L/v.

use std::borrow::Cow;

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, Declaration, Expr, ExprKind, File, Form, Ident, Role, Statement, StatementKind, UnitExpr};

/// The function of the language.
pub(in crate::elaborate) const TRANSPORT: &str = "transport";

/// t - delay(t, θ) of a residence time: a function whose name no text can have.
pub(in crate::elaborate) const ELAPSED: &str = "elapsed in transport";

/// The files with the residence times of their calls.
pub(in crate::elaborate) fn with_residence_times(files: &[File]) -> Cow<'_, [File]> {
    if !files.iter().any(|file| has_calls(&file.statements)) {
        return Cow::Borrowed(files);
    }
    let unit = files.iter().flat_map(|file| &file.statements).find_map(|statement| match &statement.kind {
        StatementKind::Time { unit, .. } => Some(unit.clone()),
        _ => None,
    });
    let mut files = files.to_vec();
    let mut writer = Writer { unit, count: 0 };
    files.iter_mut().for_each(|file| writer.block(&mut file.statements));
    Cow::Owned(files)
}

/// The blocks of statements inside of a statement.
fn body(kind: &StatementKind) -> &[Statement] {
    match kind {
        StatementKind::Component { body, .. } | StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => body,
        _ => &[],
    }
}

/// The expressions in which calls are allowed.
fn values(kind: &StatementKind) -> Vec<&Expr> {
    match kind {
        StatementKind::Equation { lhs, rhs, .. } => vec![lhs, rhs],
        StatementKind::Declare { role: Role::Let, declarations } => declarations.iter().filter_map(|d| d.value.as_ref()).collect(),
        _ => Vec::new(),
    }
}

fn has_calls(statements: &[Statement]) -> bool {
    let is_call = |e: &Expr| matches!(&e.kind, ExprKind::Call { function, .. } if function.text == TRANSPORT);
    statements.iter().any(|statement| {
        let mut found = has_calls(body(&statement.kind));
        values(&statement.kind).into_iter().for_each(|value| value.walk(&mut |e| found |= is_call(e)));
        found
    })
}

/// A residence time.
struct Residence {
    name: String,
    span: Span,
    velocity: Expr,
    length: Expr,
    binders: Vec<Binder>,
}

/// Writes the statements of residence times.
struct Writer {
    unit: Option<UnitExpr>,
    count: usize,
}

impl Writer {
    fn block(&mut self, statements: &mut Vec<Statement>) {
        let mut found = Vec::new();
        for statement in &mut *statements {
            match &mut statement.kind {
                StatementKind::Component { body, .. } | StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => {
                    self.block(body);
                }
                StatementKind::Equation { lhs, rhs, binders } => {
                    [lhs, rhs].into_iter().for_each(|value| self.value(value, binders, &mut found));
                }
                StatementKind::Declare { role: Role::Let, declarations } => {
                    for Declaration { value, indices, .. } in declarations {
                        value.iter_mut().for_each(|value| self.value(value, indices, &mut found));
                    }
                }
                _ => {}
            }
        }
        statements.extend(found.into_iter().flat_map(|residence| self.statements(residence)));
    }

    /// Gives the calls in an expression their residence times.
    fn value(&mut self, e: &mut Expr, binders: &[Binder], found: &mut Vec<Residence>) {
        operands(e).into_iter().for_each(|operand| self.value(operand, binders, found));
        let span = e.span;
        let ExprKind::Call { function, arguments } = &mut e.kind else { return };
        let [_, velocity, length] = &arguments[..] else { return };
        if function.text != TRANSPORT {
            return;
        }
        let read = |binder: &&Binder| velocity.mentions(&binder.name.text) || length.mentions(&binder.name.text);
        let binders: Vec<Binder> = binders.iter().filter(read).map(|binder| Binder { condition: None, ..binder.clone() }).collect();
        let known = found.iter().find(|r| Form::bound(&r.binders, [&r.velocity, &r.length]) == Form::bound(&binders, [velocity, length]));
        let name = known.map_or_else(
            || {
                self.count += 1;
                format!("{TRANSPORT}_{}", self.count)
            },
            |known| known.name.clone(),
        );
        let residence = Residence { name, span, velocity: velocity.clone(), length: length.clone(), binders };
        arguments.push(residence.time());
        if known.is_none() {
            found.push(residence);
        }
    }

    /// The statements of a residence time.
    fn statements(&self, of: Residence) -> Vec<Statement> {
        let span = of.span;
        let one = Expr { span, kind: ExprKind::Number { value: 1.0, unit: self.unit.clone() } };
        let declaration = Declaration {
            name: Ident { text: of.name.clone(), span },
            indices: of.binders.clone(),
            pattern: None,
            unit: self.unit.clone(),
            measured: None,
            value: Some(one),
            sample: None,
            clip: None,
            bounds: None,
            scale: None,
            nonnegative: None,
            prefer: None,
            text: Some("residence time".to_owned()),
            span,
        };
        let zero = Expr { span, kind: ExprKind::Number { value: 0.0, unit: None } };
        let mut slowest = of.velocity.clone();
        if !of.binders.is_empty() {
            let function = Ident { text: "min".to_owned(), span };
            let kind = ExprKind::Reduce { function, body: Box::new(slowest), binders: of.binders.clone(), condition: None };
            slowest = Expr { span, kind };
        }
        let derivative = Expr { span, kind: ExprKind::Derivative(Box::new(of.time())) };
        let free = vec![Expr { span, kind: ExprKind::Name(Ident { text: of.name.clone(), span }) }];
        let covered = binary(BinaryOp::Mul, of.time(), of.velocity.clone());
        let fails = Ident { text: format!("{}_stops", of.name), span };
        let kinds = [
            StatementKind::Declare { role: Role::State, declarations: vec![declaration] },
            StatementKind::StartEquation { lhs: covered, rhs: of.length.clone(), free, binders: of.binders.clone() },
            StatementKind::Equation { lhs: derivative, rhs: of.rate(), binders: of.binders.clone() },
            StatementKind::Fail {
                name: fails,
                event: true,
                condition: binary(BinaryOp::Le, slowest, zero),
                text: Some("the flow of `transport` stops or turns".to_owned()),
            },
        ];
        kinds.into_iter().map(|kind| Statement { span, kind }).collect()
    }
}

impl Residence {
    /// The residence time as an expression.
    fn time(&self) -> Expr {
        let span = self.span;
        let name = |text: &str| Expr { span, kind: ExprKind::Name(Ident { text: text.to_owned(), span }) };
        if self.binders.is_empty() {
            return name(&self.name);
        }
        let indices = self.binders.iter().map(|binder| name(&binder.name.text)).collect();
        Expr { span, kind: ExprKind::Index(Box::new(name(&self.name)), indices) }
    }

    /// The rate of the residence time.
    fn rate(&self) -> Expr {
        use BinaryOp::{Add, Div, Mul, Sub};
        let (span, velocity, length) = (self.span, &self.velocity, &self.length);
        let one = || Expr { span, kind: ExprKind::Number { value: 1.0, unit: None } };
        let running = || binary(Div, call(ELAPSED, vec![self.time()], span), self.time());
        let earlier = call(TRANSPORT, vec![velocity.clone(), velocity.clone(), length.clone(), self.time()], span);
        let moving = binary(Sub, one(), binary(Div, velocity.clone(), earlier));
        let resting = binary(Sub, length.clone(), binary(Mul, velocity.clone(), self.time()));
        let resting = binary(Div, resting, length.clone());
        binary(Add, binary(Mul, running(), moving), binary(Mul, binary(Sub, one(), running()), resting))
    }
}

fn call(function: &str, arguments: Vec<Expr>, span: Span) -> Expr {
    Expr { span, kind: ExprKind::Call { function: Ident { text: function.to_owned(), span }, arguments } }
}

fn binary(op: BinaryOp, a: Expr, b: Expr) -> Expr {
    Expr { span: a.span, kind: ExprKind::Binary(op, Box::new(a), Box::new(b)) }
}

/// The operands of an expression that may hold calls.
fn operands(e: &mut Expr) -> Vec<&mut Expr> {
    match &mut e.kind {
        ExprKind::Number { .. } | ExprKind::Bool(_) | ExprKind::Name(_) | ExprKind::Reduce { .. } => Vec::new(),
        ExprKind::Member(a, _) | ExprKind::Derivative(a) | ExprKind::Unary(_, a) | ExprKind::As(a, _) => vec![a],
        ExprKind::Index(a, list) => std::iter::once(&mut **a).chain(list).collect(),
        ExprKind::Call { arguments: list, .. } | ExprKind::Tuple(list) => list.iter_mut().collect(),
        ExprKind::Binary(_, a, b) => vec![a, b],
        ExprKind::If(c, a, b) => vec![c, a, b],
    }
}
