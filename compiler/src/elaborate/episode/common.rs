//! What the steps of the control problem share.

use smpl_dsl::syntax::Ident;

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::values::Values;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, Symbols};
use crate::ir::{Affine, Builtin, Compare, ExprId, Flavour, Place as Memory, Store, Target};

/// A condition that ends or costs something.
pub(in crate::elaborate) struct Condition {
    /// Whether it holds.
    pub holds: ExprId,
    /// Whether it is neither true nor false.
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
