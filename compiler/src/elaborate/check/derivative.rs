//! Time derivatives of equations as text, for messages about constraints.

use smpl_dsl::diagnostic::{Faults, SourceMap, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, Expr, ExprKind, File, Role, Statement, StatementKind, UnaryOp};

/// Longest derivative that is shown.
const LONGEST: usize = 300;

/// Adds to faults about constraints that are to be differentiated the time derivative of the
/// equation, where it can be written.
pub(crate) fn show_derivatives(files: &[File], sources: &SourceMap, faults: &mut Faults) {
    for fault in faults.iter_mut().filter(|fault| fault.code == codes::HIGH_INDEX) {
        let found = files.iter().find_map(|file| equation(&file.statements, &[], fault.primary.span));
        let Some((lhs, rhs, binders, scopes)) = found else { continue };
        let deriver = Deriver { scopes, binders, sources };
        if let Some(text) = deriver.equation(lhs, rhs).filter(|text| text.len() <= LONGEST) {
            fault.notes.push(format!("its time derivative is `{text}`"));
        }
    }
}

/// Sides and binders of an equation with the lists of statements around it, the inner one first.
type Found<'a> = (&'a Expr, &'a Expr, &'a [Binder], Vec<&'a [Statement]>);

fn equation<'a>(statements: &'a [Statement], around: &[&'a [Statement]], span: Span) -> Option<Found<'a>> {
    let scopes: Vec<&'a [Statement]> = std::iter::once(statements).chain(around.iter().copied()).collect();
    statements.iter().find_map(|statement| match &statement.kind {
        StatementKind::Equation { lhs, rhs, binders } if statement.span == span => Some((lhs, rhs, binders.as_slice(), scopes.clone())),
        StatementKind::Component { body, .. } | StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => {
            equation(body, &scopes, span)
        }
        _ => None,
    })
}

/// A derivative: zero, or a text with how tightly its outermost operator binds.
enum Derivative {
    Zero,
    Text(String, Bind),
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Bind {
    Sum,
    Product,
    Whole,
}

struct Deriver<'a> {
    scopes: Vec<&'a [Statement]>,
    binders: &'a [Binder],
    sources: &'a SourceMap,
}

impl Deriver<'_> {
    fn equation(&self, lhs: &Expr, rhs: &Expr) -> Option<String> {
        let side = |derivative| match derivative {
            Derivative::Zero => "0".to_owned(),
            Derivative::Text(text, _) => text,
        };
        let (left, right) = (side(self.of(lhs)?), side(self.of(rhs)?));
        let ends = |b: &Binder| self.sources.text(b.span).to_owned();
        let binders: Vec<String> = self.binders.iter().map(ends).collect();
        let over = if binders.is_empty() { String::new() } else { format!(" for {}", binders.join(", ")) };
        Some(format!("eq {left} = {right}{over}"))
    }

    /// The derivative of an expression; `None` where it has a form that is not differentiated.
    fn of(&self, e: &Expr) -> Option<Derivative> {
        Some(match &e.kind {
            ExprKind::Number { .. } => Derivative::Zero,
            ExprKind::Name(name) => self.of_name(&name.text, e)?,
            ExprKind::Index(base, _) => match &base.kind {
                ExprKind::Name(name) => self.of_name(&name.text, e)?,
                _ => return None,
            },
            ExprKind::Unary(UnaryOp::Plus, a) => self.of(a)?,
            ExprKind::Unary(UnaryOp::Neg, a) => match self.of(a)? {
                Derivative::Zero => Derivative::Zero,
                inner => Derivative::Text(format!("-{}", wrapped(inner, Bind::Product)), Bind::Sum),
            },
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) => sum(*op, self.of(a)?, self.of(b)?),
            ExprKind::Binary(BinaryOp::Mul, a, b) => {
                let (da, db) = (self.of(a)?, self.of(b)?);
                sum(BinaryOp::Add, self.times(b, da), self.times(a, db))
            }
            ExprKind::Binary(BinaryOp::Div, a, b) => match (self.of(a)?, self.of(b)?) {
                (da, Derivative::Zero) => self.over(da, b),
                (da, db) => {
                    let square = Derivative::Text(format!("{}^2", self.whole(b)), Bind::Product);
                    let second = self.times(a, db);
                    let second = match second {
                        Derivative::Zero => Derivative::Zero,
                        second => Derivative::Text(
                            format!("{}/{}", wrapped(second, Bind::Product), wrapped(square, Bind::Product)),
                            Bind::Product,
                        ),
                    };
                    sum(BinaryOp::Sub, self.over(da, b), second)
                }
            },
            ExprKind::Binary(BinaryOp::Pow, a, b) => match (self.of(a)?, &b.kind) {
                (Derivative::Zero, _) if matches!(self.of(b)?, Derivative::Zero) => Derivative::Zero,
                (da, ExprKind::Number { value, unit: None }) => {
                    let lower = if *value == 2.0 { self.whole(a) } else { format!("{}^{}", self.whole(a), bracketed(value - 1.0)) };
                    Derivative::Text(format!("{value}*{lower}*{}", wrapped(da, Bind::Product)), Bind::Product)
                }
                _ => return None,
            },
            ExprKind::Call { function, arguments } => self.of_call(&function.text, arguments)?,
            _ => return None,
        })
    }

    fn of_name(&self, name: &str, whole: &Expr) -> Option<Derivative> {
        if self.binders.iter().any(|b| b.name.text == name) {
            return Some(Derivative::Zero);
        }
        let role = self.scopes.iter().find_map(|statements| declared(statements, name))?;
        Some(match role {
            Role::State => Derivative::Text(format!("d/dt {}", self.sources.text(whole.span)), Bind::Whole),
            Role::Param | Role::Action | Role::Discrete | Role::Disturbance | Role::Random => Derivative::Zero,
            Role::Var | Role::Let => return None,
        })
    }

    fn of_call(&self, function: &str, arguments: &[Expr]) -> Option<Derivative> {
        let [a] = arguments else { return None };
        let inner = match self.of(a)? {
            Derivative::Zero => return Some(Derivative::Zero),
            inner => wrapped(inner, Bind::Product),
        };
        let (text, whole) = (self.sources.text(a.span), self.whole(a));
        let slope = match function {
            "sq" => format!("2*{whole}*{inner}"),
            "sqrt" => format!("{inner}/(2*sqrt({text}))"),
            "exp" => format!("exp({text})*{inner}"),
            "ln" => format!("{inner}/{whole}"),
            "sin" => format!("cos({text})*{inner}"),
            "cos" => format!("-sin({text})*{inner}"),
            _ => return None,
        };
        Some(Derivative::Text(slope, if function == "cos" { Bind::Sum } else { Bind::Product }))
    }

    /// A factor times a derivative.
    fn times(&self, factor: &Expr, derivative: Derivative) -> Derivative {
        match derivative {
            Derivative::Zero => Derivative::Zero,
            inner => Derivative::Text(format!("{}*{}", self.whole(factor), wrapped(inner, Bind::Product)), Bind::Product),
        }
    }

    /// A derivative over a divisor.
    fn over(&self, derivative: Derivative, divisor: &Expr) -> Derivative {
        match derivative {
            Derivative::Zero => Derivative::Zero,
            inner => Derivative::Text(format!("{}/{}", wrapped(inner, Bind::Product), self.whole(divisor)), Bind::Product),
        }
    }

    /// The text of an expression as an operand.
    fn whole(&self, e: &Expr) -> String {
        let text = self.sources.text(e.span);
        match e.kind {
            ExprKind::Binary(..) | ExprKind::Unary(..) | ExprKind::If(..) | ExprKind::As(..) if !in_parentheses(text) => {
                format!("({text})")
            }
            _ => text.to_owned(),
        }
    }
}

/// Declarations of a name in a list of statements, and in the variants there.
fn declared(statements: &[Statement], name: &str) -> Option<Role> {
    statements.iter().find_map(|statement| match &statement.kind {
        StatementKind::Declare { role, declarations } => declarations.iter().any(|d| d.name.text == name).then_some(*role),
        StatementKind::Table(table) => table.columns.iter().any(|column| column.name.text == name).then_some(Role::Param),
        StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => declared(body, name),
        _ => None,
    })
}

fn sum(op: BinaryOp, a: Derivative, b: Derivative) -> Derivative {
    match (a, b) {
        (a, Derivative::Zero) => a,
        (Derivative::Zero, b) if op == BinaryOp::Add => b,
        (Derivative::Zero, b) => Derivative::Text(format!("-{}", wrapped(b, Bind::Product)), Bind::Sum),
        (a, b) if op == BinaryOp::Add => Derivative::Text(format!("{} + {}", wrapped(a, Bind::Sum), wrapped(b, Bind::Sum)), Bind::Sum),
        (a, b) => Derivative::Text(format!("{} - {}", wrapped(a, Bind::Sum), wrapped(b, Bind::Product)), Bind::Sum),
    }
}

/// The text of a derivative as an operand of an operator that binds as tightly.
fn wrapped(derivative: Derivative, within: Bind) -> String {
    match derivative {
        Derivative::Zero => "0".to_owned(),
        Derivative::Text(text, bind) if bind < within => format!("({text})"),
        Derivative::Text(text, _) => text,
    }
}

/// Returns `true` if one pair of parentheses is around all of a text.
fn in_parentheses(text: &str) -> bool {
    let mut depth = 0_i32;
    let closes = text.char_indices().find_map(|(at, c)| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        (depth == 0).then_some(at + c.len_utf8())
    });
    text.starts_with('(') && closes == Some(text.len())
}

fn bracketed(x: f64) -> String {
    if x < 0.0 { format!("({x})") } else { x.to_string() }
}
