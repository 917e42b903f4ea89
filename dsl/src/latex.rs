//! Expressions and equations typeset in LaTeX, from the syntax tree.
//!
//! Names become symbols (`c_A` is c with an upright subscript, `mu` the Greek letter), divisions
//! become fractions, sums get their index below, conditions become cases. The result is for math
//! mode and needs `amsmath`.
//!
//! ```
//! use smpl_dsl::{latex, parse, span::FileId, syntax::StatementKind};
//!
//! let parsed = parse("eq d/dt c_A = q/V * c_A", FileId(0));
//! if let StatementKind::Equation { lhs, rhs, binders } = &parsed.file.statements[0].kind {
//!     let rate = r"\frac{\mathrm{d} c_{\mathrm{A}}}{\mathrm{d} t}";
//!     let expected = format!(r"{rate} = \frac{{q}}{{V}} \, c_{{\mathrm{{A}}}}");
//!     assert_eq!(latex::equation(lhs, rhs, binders), expected);
//! }
//! ```

mod names;

use crate::syntax::{BY_MEMBER, BinaryOp, Binder, BinderSet, Expr, ExprKind, Ident, UnaryOp, UnitBase, UnitExpr};

pub use names::{name, number};

use names::{escape, subscripted};

/// An equation, with its indices behind it.
#[must_use]
pub fn equation(lhs: &Expr, rhs: &Expr, binders: &[Binder]) -> String {
    let sides = format!("{} = {}", expression(lhs), expression(rhs));
    if binders.is_empty() { sides } else { format!("{sides}, \\quad {}", binder_list(binders)) }
}

/// An expression.
#[must_use]
pub fn expression(expr: &Expr) -> String {
    typeset(expr, Level::Or)
}

/// Sets of indices; empty without indices.
#[must_use]
pub fn binders(binders: &[Binder]) -> String {
    binder_list(binders)
}

/// A unit, upright: `\mathrm{kJ\,min^{-1}}`; `1` for the unit of numbers.
#[must_use]
pub fn unit(unit: &UnitExpr) -> String {
    let factors = unit.factors.iter().map(|factor| {
        let base = match &factor.base {
            UnitBase::Symbol(symbol) => format!("\\mathrm{{{}}}", escape(&symbol.text)),
            UnitBase::Number(value, _) => number(*value),
            UnitBase::Of(expr) => format!("[{}]", expression(expr)),
        };
        match factor.exponent {
            (1, 1) => base,
            (numerator, 1) => format!("{base}^{{{numerator}}}"),
            (numerator, denominator) => format!("{base}^{{{numerator}/{denominator}}}"),
        }
    });
    let product = factors.collect::<Vec<_>>().join("\\,");
    if product.is_empty() { "1".to_owned() } else { product }
}

/// Binding strength of an expression; a weaker one than its place needs gets parentheses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Or,
    And,
    Not,
    Comparison,
    Sum,
    Product,
    Sign,
    Power,
    Atom,
}

fn typeset(expr: &Expr, place: Level) -> String {
    let (text, level) = built(expr);
    if level < place { parenthesised(&text) } else { text }
}

fn parenthesised(text: &str) -> String {
    format!("\\left({text}\\right)")
}

/// The text of an expression and how tightly it binds.
fn built(expr: &Expr) -> (String, Level) {
    match &expr.kind {
        ExprKind::Number { value, unit: None } if *value >= 0.0 => (number(*value), number_level(*value)),
        ExprKind::Number { value, unit: None } => (number(*value), Level::Sign),
        ExprKind::Number { value, unit: Some(written) } => (format!("{}\\,{}", number(*value), unit(written)), Level::Product),
        ExprKind::Bool(value) => (format!("\\text{{{value}}}"), Level::Atom),
        ExprKind::Name(_) | ExprKind::Member(..) | ExprKind::Index(..) => (symbol(expr), Level::Atom),
        ExprKind::Call { function, arguments } if function.text == "in" => (membership(arguments), Level::Comparison),
        ExprKind::Call { function, arguments } if function.text == BY_MEMBER => (by_member(arguments), Level::Product),
        ExprKind::Call { function, arguments } => (call(function, arguments), call_level(function)),
        ExprKind::Reduce { function, body, binders, condition } => {
            (reduction(function, body, binders, condition.as_deref()), Level::Product)
        }
        ExprKind::Derivative(inner) => {
            (format!("\\frac{{\\mathrm{{d}} {}}}{{\\mathrm{{d}} t}}", typeset(inner, Level::Atom)), Level::Product)
        }
        ExprKind::Unary(op, inner) => unary(*op, inner),
        ExprKind::Binary(op, left, right) => binary(*op, left, right),
        ExprKind::If(..) => (cases(expr), Level::Product),
        ExprKind::As(inner, written) => (format!("{}\\,{}", typeset(inner, Level::Product), unit(written)), Level::Product),
        ExprKind::Tuple(items) => (parenthesised(&list(items)), Level::Atom),
    }
}

/// `i in solids`, `i in {A, B}`
fn membership(arguments: &[Expr]) -> String {
    match arguments {
        [index, one] => format!("{} \\in {}", expression(index), set(one)),
        [index, members @ ..] => format!("{} \\in {}", expression(index), listed(members)),
        [] => String::new(),
    }
}

/// The members of a list; a list of one sum of sets is that sum.
fn listed(members: &[Expr]) -> String {
    match members {
        [sum @ Expr { kind: ExprKind::Binary(..), .. }] => set(sum),
        _ => format!("\\left\\lbrace {}\\right\\rbrace", list(members)),
    }
}

/// Sums and differences of sets as unions and differences.
#[must_use]
pub fn set(e: &Expr) -> String {
    match &e.kind {
        ExprKind::Binary(op, a, b) => {
            let right = if matches!(b.kind, ExprKind::Binary(..)) { parenthesised(&set(b)) } else { set(b) };
            format!("{} {} {right}", set(a), if *op == BinaryOp::Sub { "\\setminus" } else { "\\cup" })
        }
        ExprKind::Tuple(members) => listed(members),
        ExprKind::Name(name) => format!("\\mathrm{{{}}}", escape(&name.text)),
        _ => expression(e),
    }
}

/// `{ A: 1, B: 2 }`
fn by_member(arguments: &[Expr]) -> String {
    let rows: Vec<String> = arguments[1..].chunks(2).map(|pair| pair.iter().map(expression).collect::<Vec<_>>().join(": & ")).collect();
    format!("\\begin{{cases}} {} \\end{{cases}}", rows.join(" \\\\ "))
}

fn number_level(value: f64) -> Level {
    if number(value).contains('^') { Level::Product } else { Level::Atom }
}

fn call_level(function: &Ident) -> Level {
    if function.text == "sq" { Level::Power } else { Level::Atom }
}

fn list(items: &[Expr]) -> String {
    items.iter().map(expression).collect::<Vec<_>>().join(", ")
}

// ---- symbols

/// `R1.c[i, z]`: the last name, with what it belongs to and its indices below.
fn symbol(expr: &Expr) -> String {
    let mut owners = Vec::new();
    let mut indices = Vec::new();
    let mut last = None;
    collect(expr, &mut owners, &mut last, &mut indices);
    let Some(last) = last else { return indexed_anyway(expr) };
    let owner = if owners.is_empty() { None } else { Some(format!("\\mathrm{{{}}}", escape(&owners.join(".")))) };
    subscripted(&last, &owner.into_iter().chain(indices).collect::<Vec<_>>())
}

fn collect(expr: &Expr, owners: &mut Vec<String>, last: &mut Option<String>, indices: &mut Vec<String>) {
    match &expr.kind {
        ExprKind::Name(ident) => *last = Some(ident.text.clone()),
        ExprKind::Member(base, ident) => {
            collect(base, owners, last, indices);
            owners.extend(last.replace(ident.text.clone()));
        }
        ExprKind::Index(base, own) => {
            collect(base, owners, last, indices);
            indices.extend(own.iter().map(expression));
        }
        _ => *last = None,
    }
}

/// An index or member of something that is not a name.
fn indexed_anyway(expr: &Expr) -> String {
    match &expr.kind {
        ExprKind::Index(base, own) => format!("{{{}}}_{{{}}}", typeset(base, Level::Atom), list(own)),
        ExprKind::Member(base, ident) => format!("{{{}}}_{{{}}}", typeset(base, Level::Atom), name(&ident.text)),
        _ => String::new(),
    }
}

// ---- functions

fn call(function: &Ident, arguments: &[Expr]) -> String {
    let one = match arguments {
        [single] => Some(single),
        _ => None,
    };
    match (function.text.as_str(), one) {
        ("sqrt", Some(x)) => format!("\\sqrt{{{}}}", expression(x)),
        ("abs", Some(x)) => format!("\\left\\lvert {}\\right\\rvert", expression(x)),
        ("floor", Some(x)) => format!("\\left\\lfloor {}\\right\\rfloor", expression(x)),
        ("ceil", Some(x)) => format!("\\left\\lceil {}\\right\\rceil", expression(x)),
        ("sq", Some(x)) => format!("{}^{{2}}", typeset(x, Level::Atom)),
        ("grad", Some(x)) => format!("\\nabla\\left({}\\right)", expression(x)),
        ("div", Some(x)) => format!("\\nabla\\cdot\\left({}\\right)", expression(x)),
        _ => format!("{}\\left({}\\right)", function_name(&function.text), list(arguments)),
    }
}

fn function_name(function: &str) -> String {
    match function {
        "exp" | "ln" | "sin" | "cos" | "tan" | "sinh" | "cosh" | "tanh" | "min" | "max" => format!("\\{function}"),
        "log10" => "\\log_{10}".to_owned(),
        "asin" | "acos" | "atan" => format!("\\arc{}", &function[1..]),
        _ if function.chars().count() == 1 || function.contains('_') => name(function),
        _ => format!("\\operatorname{{{}}}", escape(function)),
    }
}

fn reduction(function: &Ident, body: &Expr, binders: &[Binder], condition: Option<&Expr>) -> String {
    if function.text == "integral" {
        let variables = binders.iter().map(|binder| format!("\\,\\mathrm{{d}} {}", name(&binder.name.text)));
        let whole = condition.is_none() && binders.iter().all(|b| matches!(b.over, BinderSet::Itself));
        let over = if whole { String::new() } else { format!("_{{{}}}", below(binders, condition)) };
        return format!("\\int{over} {}{}", typeset(body, Level::Product), variables.collect::<String>());
    }
    if let ("interp", [binder], Some(at)) = (function.text.as_str(), binders, condition) {
        return format!("\\left.{}\\right|_{{{} = {}}}", expression(body), name(&binder.name.text), expression(at));
    }
    let operator = match function.text.as_str() {
        "sum" => "\\sum".to_owned(),
        "product" => "\\prod".to_owned(),
        "min" | "max" => format!("\\{}", function.text),
        "all" => "\\bigwedge".to_owned(),
        "any" => "\\bigvee".to_owned(),
        other => format!("\\operatorname*{{{}}}", escape(other)),
    };
    format!("{operator}_{{{}}} {}", below(binders, condition), typeset(body, Level::Product))
}

/// Sets of a reduction, and their condition.
fn below(binders: &[Binder], condition: Option<&Expr>) -> String {
    match condition {
        Some(condition) => format!("\\substack{{{} \\\\ {}}}", binder_list(binders), expression(condition)),
        None => binder_list(binders),
    }
}

fn binder_list(binders: &[Binder]) -> String {
    binders.iter().map(binder).collect::<Vec<_>>().join(",\\, ")
}

fn binder(binder: &Binder) -> String {
    let only = binder.condition.as_ref().map(|c| format!(" \\text{{ if }} {}", expression(c))).unwrap_or_default();
    over(binder) + &only
}

fn over(binder: &Binder) -> String {
    let index = name(&binder.name.text);
    match &binder.over {
        BinderSet::Itself => index,
        BinderSet::Set(set) => format!("{index} \\in \\mathrm{{{}}}", escape(&set.text)),
        BinderSet::Range(low, high) => format!("{index} = {}, \\ldots, {}", expression(low), expression(high)),
        BinderSet::Tuple(items) => format!("{index} \\in {}", listed(items)),
    }
}

// ---- operators

fn unary(op: UnaryOp, inner: &Expr) -> (String, Level) {
    match op {
        UnaryOp::Neg => (format!("-{}", typeset(inner, Level::Product)), Level::Sum),
        UnaryOp::Plus => (format!("+{}", typeset(inner, Level::Product)), Level::Sum),
        UnaryOp::Not => (format!("\\lnot {}", typeset(inner, Level::Atom)), Level::Not),
    }
}

fn binary(op: BinaryOp, left: &Expr, right: &Expr) -> (String, Level) {
    let infix = |symbol: &str, level: Level, next: Level| (format!("{} {symbol} {}", typeset(left, level), typeset(right, next)), level);
    match op {
        BinaryOp::Add => infix("+", Level::Sum, Level::Product),
        BinaryOp::Sub => infix("-", Level::Sum, Level::Product),
        BinaryOp::Mul => (times(left, right), Level::Product),
        BinaryOp::Div => quotient(left, right),
        BinaryOp::Pow => (format!("{}^{{{}}}", typeset(left, Level::Atom), expression(right)), Level::Power),
        BinaryOp::And => infix("\\land", Level::And, Level::Not),
        BinaryOp::Or => infix("\\lor", Level::Or, Level::And),
        BinaryOp::Lt => infix("<", Level::Comparison, Level::Sum),
        BinaryOp::Le => infix("\\le", Level::Comparison, Level::Sum),
        BinaryOp::Gt => infix(">", Level::Comparison, Level::Sum),
        BinaryOp::Ge => infix("\\ge", Level::Comparison, Level::Sum),
        BinaryOp::Eq => infix("=", Level::Comparison, Level::Sum),
        BinaryOp::Ne => infix("\\ne", Level::Comparison, Level::Sum),
    }
}

/// A fraction, with the sign of its numerator in front.
fn quotient(left: &Expr, right: &Expr) -> (String, Level) {
    match &left.kind {
        ExprKind::Unary(UnaryOp::Neg, inner) => (format!("-\\frac{{{}}}{{{}}}", expression(inner), expression(right)), Level::Sum),
        _ => (format!("\\frac{{{}}}{{{}}}", expression(left), expression(right)), Level::Product),
    }
}

/// A product; what extends to the right (a sum, an integral, cases) is closed off when something
/// follows.
fn times(left: &Expr, right: &Expr) -> String {
    let open = matches!(left.kind, ExprKind::Reduce { .. });
    let left = if open { parenthesised(&expression(left)) } else { typeset(left, Level::Product) };
    let right = typeset(right, Level::Product);
    let sign = if right.starts_with(|c: char| c.is_ascii_digit()) { "\\cdot" } else { "\\," };
    format!("{left} {sign} {right}")
}

fn cases(expr: &Expr) -> String {
    let mut rows = Vec::new();
    let mut rest = expr;
    while let ExprKind::If(condition, value, otherwise) = &rest.kind {
        rows.push(format!("{} & \\text{{if }} {}", expression(value), expression(condition)));
        rest = otherwise;
    }
    rows.push(format!("{} & \\text{{otherwise}}", expression(rest)));
    format!("\\begin{{cases}} {} \\end{{cases}}", rows.join(" \\\\ "))
}
