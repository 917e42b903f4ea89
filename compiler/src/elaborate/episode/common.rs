//! Shared functions of the steps of the control problem.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Ident;

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::values::Values;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, Symbols};
use crate::ir::{Affine, Builtin, Compare, ExprId, FastMap, Flavour, Place as Memory, Store, Target, VarId};

/// A condition that ends or costs something.
pub(in crate::elaborate) struct Condition {
    /// True if it holds.
    pub holds: ExprId,
    /// True if it is neither true nor false.
    pub unknown: ExprId,
    /// By how much, relative to a range.
    pub excess: ExprId,
    /// Members of its box.
    pub items: Vec<Bounded>,
}

pub(in crate::elaborate) fn flag(l: &mut Lowering<'_, '_>, b: Builtin) -> ExprId {
    let (e, half) = (builtin(l, b), l.exprs.constant(0.5));
    l.exprs.compare(Compare::Lt, half, e)
}

pub(in crate::elaborate) fn builtin(l: &mut Lowering<'_, '_>, b: Builtin) -> ExprId {
    l.exprs.load(l.hidden.builtins, Flavour::Value, Affine::constant(b as i64))
}

/// All items with their scopes.
pub(in crate::elaborate) fn each<'a, 'b>(blocks: &'b [(ScopeId, Vec<Item<'a>>)]) -> impl Iterator<Item = (ScopeId, Item<'a>)> + 'b {
    blocks.iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i)))
}

/// A store.
pub(in crate::elaborate) fn store(place: Memory, at: Affine, value: ExprId) -> Store {
    Store { target: Target { place, at }, value }
}

/// Name of the random stream of an element.
pub(in crate::elaborate) fn stream_name(path: &str, at: Affine, len: u32) -> String {
    if len == 1 || !at.is_constant() { path.to_owned() } else { format!("{path}[{}]", at.offset) }
}

impl Values<'_> {
    /// A number or a truth value, NaN where it is unknown.
    pub(in crate::elaborate) fn or_nan(&mut self, value: ExprId, unknown: ExprId) -> ExprId {
        if matches!(self.exprs.node(unknown), crate::ir::Expr::Truth(false)) {
            return value;
        }
        let (nan, value) = (self.exprs.constant(f64::NAN), self.exprs.number(value));
        self.exprs.select(unknown, nan, value)
    }
}

impl Symbols<'_> {
    /// A name with the path of its instance.
    pub(in crate::elaborate) fn path_of(&self, scope: ScopeId, name: &Ident) -> String {
        format!("{}{}", self.scopes[scope].prefix, name.text)
    }
}

/// The elements that entries have set so far, by block and breadth: two of one breadth in one block
/// are a fault, as their order has no meaning.
#[derive(Default)]
pub(in crate::elaborate) struct Given(FastMap<(VarId, i64), (usize, usize, Span)>);

impl Given {
    /// Notes what an entry sets; `false` where an entry has set it before, which is reported.
    pub(in crate::elaborate) fn note(
        &mut self,
        l: &mut Lowering<'_, '_>,
        (var, elements): (VarId, std::ops::Range<i64>),
        (block, breadth): (usize, usize),
        span: Span,
        what: &str,
    ) -> bool {
        let mut twice = None;
        let single = elements.end - elements.start == 1;
        for i in elements {
            let before = self.0.insert((var, i), (block, breadth, span));
            if let Some((.., first)) = before.filter(|(b, n, _)| (*b, *n) == (block, breadth)) {
                twice.get_or_insert((i, first));
            }
        }
        let Some((i, first)) = twice else { return true };
        l.ledger.report(two_values(&shown(l, var, single.then_some(i)), what, span, first));
        false
    }
}

/// Message for two entries for one element.
pub(in crate::elaborate) fn two_values(name: &str, what: &str, span: Span, first: Span) -> Diagnostic {
    Diagnostic::error(codes::DUPLICATE_NAME, format!("`{name}` has two {what}"), span)
        .secondary(first, "the first one")
        .help("keep one of them: their order has no meaning")
}

/// The name of a variable or of an element of it.
pub(in crate::elaborate) fn shown(l: &Lowering<'_, '_>, var: VarId, element: Option<i64>) -> String {
    match (element, l.quantities.get(&var)) {
        (Some(i), Some(quantity)) => quantity.element_name(i.max(0) as usize),
        _ => l.symbols.vars[var].name.clone(),
    }
}
