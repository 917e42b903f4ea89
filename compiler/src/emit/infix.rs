//! Expressions in infix notation.

use super::COUNTERS;
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, FastMap, Flavour, MAX_DEPTH, Side, VarId};
use crate::model::Model;

/// Longer parts get their own name.
const LONGEST: usize = 100;

/// Binding strength of an operation.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Tightness {
    Or,
    And,
    Compare,
    Sum,
    Product,
    Sign,
    Power,
    Atom,
}

/// Prints expressions; what is used several times is printed once, in `parts`. A part that depends
/// on the counter of a sum is a function of it, `%7(j)`.
pub(super) struct Printer<'m> {
    model: &'m Model,
    /// Loops around the expressions.
    depth: usize,
    done: FastMap<ExprId, (String, Tightness)>,
    pub(super) parts: Vec<String>,
}

impl<'m> Printer<'m> {
    pub(super) fn new(model: &'m Model, depth: usize) -> Self {
        Printer { model, depth, done: FastMap::default(), parts: vec![] }
    }

    /// The text of an expression.
    pub(super) fn value(&mut self, root: ExprId) -> String {
        let order = self.model.exprs.below_in_order([root]);
        let mut uses: FastMap<ExprId, u32> = FastMap::default();
        for &expr in &order {
            for operand in self.model.exprs.operands(expr) {
                *uses.entry(operand).or_default() += 1;
            }
        }
        for expr in order {
            if self.done.contains_key(&expr) {
                continue;
            }
            let (text, tightness) = self.node(self.model.exprs.node(expr));
            let repeated = uses.get(&expr).is_some_and(|&n| n > 1) && tightness < Tightness::Atom;
            if (repeated || text.len() > LONGEST) && expr != root {
                let name = self.name(expr);
                self.parts.push(format!("{name} = {text}"));
                self.done.insert(expr, (name, Tightness::Atom));
            } else {
                self.done.insert(expr, (text, tightness));
            }
        }
        self.text(root, Tightness::Or)
    }

    /// The name of a part, with the counters of sums that it depends on.
    fn name(&self, expr: ExprId) -> String {
        let free = self.model.exprs.free(expr);
        let counters: Vec<&str> = (self.depth..MAX_DEPTH).filter(|d| free & (1 << d) != 0).map(counter).collect();
        let arguments = if counters.is_empty() { String::new() } else { format!("({})", counters.join(", ")) };
        format!("%{}{arguments}", expr.as_u32())
    }

    /// A part, in parentheses if it binds less tightly than its place requires.
    fn text(&self, expr: ExprId, wanted: Tightness) -> String {
        match self.done.get(&expr) {
            Some((text, tightness)) if *tightness >= wanted => text.clone(),
            Some((text, _)) => format!("({text})"),
            None => "?".into(),
        }
    }

    fn node(&self, node: Expr) -> (String, Tightness) {
        use Tightness as T;
        let infix =
            |a, operator: &str, b, tightness, right| (format!("{} {operator} {}", self.text(a, tightness), self.text(b, right)), tightness);
        match node {
            Expr::Const(bits) => {
                let x = f64::from_bits(bits);
                (format!("{x:?}"), if x < 0.0 { T::Sign } else { T::Atom })
            }
            Expr::Truth(t) => (t.to_string(), T::Atom),
            Expr::Time => ("time".into(), T::Atom),
            Expr::Counter(v) => (counter(v.0 as usize).into(), T::Atom),
            Expr::Load { var, flavour, at } => (self.load(var, flavour, at), T::Atom),
            Expr::Unary(crate::ir::UnaryFn::Neg, a) => (format!("-{}", self.text(a, T::Power)), T::Sign),
            Expr::Unary(f, a) => (format!("{}({})", format!("{f:?}").to_lowercase(), self.text(a, T::Or)), T::Atom),
            Expr::Binary(f, a, b) => match f {
                BinaryFn::Add => infix(a, "+", b, T::Sum, T::Sum),
                BinaryFn::Sub => infix(a, "-", b, T::Sum, T::Product),
                BinaryFn::Mul => infix(a, "*", b, T::Product, T::Product),
                BinaryFn::Div => infix(a, "/", b, T::Product, T::Sign),
                BinaryFn::Pow => (format!("{}^{}", self.text(a, T::Atom), self.text(b, T::Atom)), T::Power),
                BinaryFn::Min | BinaryFn::Max | BinaryFn::Atan2 => {
                    let name = format!("{f:?}").to_lowercase();
                    (format!("{name}({}, {})", self.text(a, T::Or), self.text(b, T::Or)), T::Atom)
                }
            },
            Expr::PowInt(a, n) if n < 0 => (format!("{}^({n})", self.text(a, T::Atom)), T::Power),
            Expr::PowInt(a, n) => (format!("{}^{n}", self.text(a, T::Atom)), T::Power),
            Expr::Compare(op, a, b) => {
                let sign = match op {
                    Compare::Lt => "<",
                    Compare::Le => "<=",
                    Compare::Eq => "==",
                    Compare::Ne => "!=",
                };
                (infix(a, sign, b, T::Sum, T::Sum).0, T::Compare)
            }
            Expr::And(a, b) => infix(a, "and", b, T::And, T::And),
            Expr::Or(a, b) => infix(a, "or", b, T::Or, T::Or),
            Expr::Not(a) => (format!("not {}", self.text(a, T::Atom)), T::Compare),
            Expr::Passed(limits, side, a) => {
                let side = if side == Side::UpTo { "up to" } else { "below" };
                (format!("passed({}, {} limits {side})", self.text(a, T::Or), limits.len), T::Atom)
            }
            Expr::Entry(list, a) => (format!("entry({}, {} numbers)", self.text(a, T::Or), list.len), T::Atom),
            Expr::Select(c, a, b) => {
                let [c, a, b] = [c, a, b].map(|e| self.text(e, T::Or));
                (format!("if({c}, {a}, {b})"), T::Atom)
            }
            Expr::Reduce { op, depth, extent, body } => {
                let name = format!("{op:?}").to_lowercase();
                (format!("{name}({} in 0..{extent}: {})", counter(depth.0 as usize), self.text(body, T::Or)), T::Atom)
            }
        }
    }

    fn load(&self, var: VarId, flavour: Flavour, at: Affine) -> String {
        let variable = &self.model.vars[var];
        let name = if variable.len == 1 { variable.name.clone() } else { format!("{}[{}]", variable.name, affine(at)) };
        match flavour {
            Flavour::Value => name,
            Flavour::Derivative => format!("der({name})"),
            Flavour::Initial => format!("initial({name})"),
            Flavour::Previous => format!("previous({name})"),
            Flavour::Steady => format!("steady({name})"),
        }
    }
}

fn counter(depth: usize) -> &'static str {
    COUNTERS.get(depth).copied().unwrap_or("?")
}

/// An address: `3*i + j - 1`.
pub(super) fn affine(at: Affine) -> String {
    let mut text = String::new();
    for (depth, &stride) in at.strides.iter().enumerate().filter(|(_, s)| **s != 0) {
        let sign = match (text.is_empty(), stride < 0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        let factor = if stride.abs() == 1 { String::new() } else { format!("{}*", stride.abs()) };
        text += &format!("{sign}{factor}{}", counter(depth));
    }
    match (text.is_empty(), at.offset) {
        (true, offset) => offset.to_string(),
        (false, 0) => text,
        (false, offset) if offset < 0 => format!("{text} - {}", -offset),
        (false, offset) => format!("{text} + {offset}"),
    }
}
