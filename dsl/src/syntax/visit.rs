//! Visitors and comparison of the parts of expressions.

use std::mem::{Discriminant, discriminant};

use super::{BinaryOp, Binder, BinderSet, Expr, ExprKind, UnaryOp, UnitBase, UnitExpr};

impl Expr {
    /// The expressions directly inside of this one: operands, indices, arguments, conditions, what
    /// binders run over, and the `x` of `unit(x)`.
    #[must_use]
    pub fn children(&self) -> Vec<&Expr> {
        match &self.kind {
            ExprKind::Number { unit, .. } => unit.iter().flat_map(UnitExpr::children).collect(),
            ExprKind::Bool(_) | ExprKind::Name(_) => Vec::new(),
            ExprKind::Member(a, _) | ExprKind::Derivative(a) | ExprKind::Unary(_, a) => vec![a],
            ExprKind::As(a, unit) => std::iter::once(&**a).chain(unit.children()).collect(),
            ExprKind::Index(a, list) => std::iter::once(&**a).chain(list).collect(),
            ExprKind::Call { arguments: list, .. } | ExprKind::Tuple(list) => list.iter().collect(),
            ExprKind::Reduce { body, binders, condition, .. } => {
                binders.iter().flat_map(Binder::children).chain([&**body]).chain(condition.as_deref()).collect()
            }
            ExprKind::Binary(_, a, b) => vec![a, b],
            ExprKind::If(c, a, b) => vec![c, a, b],
        }
    }

    /// Calls `visit` with this expression and all inside of it, the outer ones first.
    pub fn walk<'e>(&'e self, visit: &mut dyn FnMut(&'e Expr)) {
        let mut stack = vec![self];
        while let Some(e) = stack.pop() {
            visit(e);
            stack.extend(e.children().into_iter().rev());
        }
    }

    /// Returns `true` if a name is anywhere inside.
    #[must_use]
    pub fn mentions(&self, name: &str) -> bool {
        let mut found = false;
        self.walk(&mut |e| found |= matches!(&e.kind, ExprKind::Name(n) if n.text == name));
        found
    }
}

impl Binder {
    /// Ends of a range or elements of a tuple, then the condition.
    pub fn children(&self) -> impl Iterator<Item = &Expr> {
        self.range().chain(self.condition.as_deref())
    }

    /// The expressions that it runs over: ends of a range, elements of a tuple.
    pub fn range(&self) -> impl Iterator<Item = &Expr> {
        let (ends, elements) = match &self.over {
            BinderSet::Itself | BinderSet::Set(_) => (None, [].as_slice()),
            BinderSet::Range(low, high) => (Some([&**low, &**high]), [].as_slice()),
            BinderSet::Tuple(list) => (None, list.as_slice()),
        };
        ends.into_iter().flatten().chain(elements)
    }
}

impl UnitExpr {
    /// The expressions whose units are intended: `x` in `unit(x)`.
    pub fn children(&self) -> impl Iterator<Item = &Expr> {
        self.factors.iter().filter_map(|factor| match &factor.base {
            UnitBase::Of(e) => Some(&**e),
            UnitBase::Symbol(_) | UnitBase::Number(..) => None,
        })
    }
}

/// Expressions without their places: two are equal if they have the same words.
///
/// Names that binders give to their indices do not count: `sum(v[i] for i in s)` equals `sum(v[j]
/// for j in s)`. Units, ranges and conditions do, as they are written: `1 [m]` differs from `100
/// [cm]`, and `a + b` from `b + a`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Form<'e> {
    words: Vec<Word<'e>>,
}

/// A part of a [`Form`]. Every word that opens something says how much follows, so that lists of
/// words are equal only where trees are.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Word<'e> {
    Kind(Discriminant<ExprKind>, usize),
    Name(&'e str),
    /// An index, by how many have been bound before it.
    Bound(usize),
    /// By its bits: what is read equal is equal.
    Number(u64),
    Truth(bool),
    Unary(UnaryOp),
    Binary(BinaryOp),
    Unit(Option<usize>),
    Exponent(i32, i32),
    Binders(usize),
    Over(Discriminant<BinderSet>, usize),
}

impl<'e> Form<'e> {
    /// The form of an expression.
    #[must_use]
    pub fn of(e: &'e Expr) -> Self {
        Self::bound(&[], [e])
    }

    /// The form of expressions whose indices are bound by `binders`, with what these run over.
    #[must_use]
    pub fn bound(binders: &'e [Binder], expressions: impl IntoIterator<Item = &'e Expr>) -> Self {
        let mut writer = Writer { form: Form::default(), bound: Vec::new() };
        writer.binders(binders);
        expressions.into_iter().for_each(|e| writer.expr(e));
        writer.form
    }
}

/// Writes the words of expressions, with the names that are bound around.
struct Writer<'e> {
    form: Form<'e>,
    bound: Vec<&'e str>,
}

impl<'e> Writer<'e> {
    fn push(&mut self, word: Word<'e>) {
        self.form.words.push(word);
    }

    fn name(&mut self, name: &'e str) {
        let word = self.bound.iter().rposition(|n| *n == name).map_or(Word::Name(name), Word::Bound);
        self.push(word);
    }

    fn expr(&mut self, e: &'e Expr) {
        let outside = self.bound.len();
        self.push(Word::Kind(discriminant(&e.kind), e.children().len()));
        match &e.kind {
            ExprKind::Number { value, unit } => {
                self.push(Word::Number(value.to_bits()));
                self.unit(unit.as_ref());
            }
            ExprKind::Bool(b) => self.push(Word::Truth(*b)),
            ExprKind::Name(n) => self.name(&n.text),
            ExprKind::Member(_, n) => self.push(Word::Name(&n.text)),
            ExprKind::Call { function, .. } => self.push(Word::Name(&function.text)),
            ExprKind::Reduce { function, body, binders, condition } => {
                self.push(Word::Name(&function.text));
                self.binders(binders);
                [&**body].into_iter().chain(condition.as_deref()).for_each(|e| self.expr(e));
                self.bound.truncate(outside);
                return;
            }
            ExprKind::Unary(op, _) => self.push(Word::Unary(*op)),
            ExprKind::Binary(op, ..) => self.push(Word::Binary(*op)),
            ExprKind::As(_, unit) => self.unit(Some(unit)),
            ExprKind::Index(..) | ExprKind::Derivative(_) | ExprKind::If(..) | ExprKind::Tuple(_) => {}
        }
        e.children().into_iter().for_each(|e| self.expr(e));
    }

    /// Binders see those before them; `z` alone is `z in z`.
    fn binders(&mut self, binders: &'e [Binder]) {
        self.push(Word::Binders(binders.len()));
        for binder in binders {
            match &binder.over {
                // A range takes its domain from its name.
                BinderSet::Range(..) => self.push(Word::Name(&binder.name.text)),
                BinderSet::Itself => self.push(Word::Name(&binder.name.text)),
                BinderSet::Set(set) => self.push(Word::Name(&set.text)),
                BinderSet::Tuple(_) => {}
            }
            let over = if matches!(binder.over, BinderSet::Itself) { &BinderSet::Set(binder.name.clone()) } else { &binder.over };
            self.push(Word::Over(discriminant(over), binder.children().count()));
            binder.range().for_each(|e| self.expr(e));
            self.bound.push(&binder.name.text);
            binder.condition.iter().for_each(|e| self.expr(e));
        }
    }

    fn unit(&mut self, unit: Option<&'e UnitExpr>) {
        self.push(Word::Unit(unit.map(|u| u.factors.len())));
        for factor in unit.iter().flat_map(|u| &u.factors) {
            match &factor.base {
                UnitBase::Symbol(symbol) => self.push(Word::Name(&symbol.text)),
                UnitBase::Number(value, _) => self.push(Word::Number(value.to_bits())),
                UnitBase::Of(_) => {}
            }
            self.push(Word::Exponent(factor.exponent.0, factor.exponent.1));
        }
    }
}
