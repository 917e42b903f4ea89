//! Context of an expression: its place, and bound names.

use std::rc::Rc;

use smpl_dsl::syntax::Expr;

use crate::elaborate::lower::loops::{Cell, Face};
use crate::elaborate::lower::value::Value;
use crate::elaborate::symbols::{Axis, DomainId, ScopeId, SetId, SymbolId};
use crate::ir::{Affine, ExprId};

/// Context of an expression: its place, and bound names.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// Scope of names.
    pub scope: ScopeId,
    /// Bound names.
    pub bindings: Option<Rc<Binding>>,
    /// Number of loops around.
    pub depth: u8,
    /// The face at which field values are taken, inside a flux.
    pub face: Option<Face>,
    /// Kind of text.
    pub site: Site,
}

/// Kind of text of an expression, which determines the valid functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Site {
    /// Equations, `let`s, fluxes.
    Dynamics,
    /// Parameters, initial values: random numbers drawn at reset.
    Reset,
    /// Update of a disturbance: random numbers drawn at each step.
    Disturb,
    /// Sampling instants, rewards, conditions, policies, observations.
    Instant,
}

/// An index, argument or tuple element that is bound to a name.
#[derive(Debug)]
pub(crate) struct Binding {
    name: String,
    to: Bound,
    next: Option<Rc<Binding>>,
}

/// Binding of a name.
#[derive(Clone, Debug)]
pub(crate) enum Bound {
    /// A member of a set.
    Member(SetId, usize),
    /// A cell of a domain.
    Cell(DomainId, Cell),
    /// The face at which a flux is taken.
    Face(DomainId, Cell),
    /// A value: argument of a function.
    Value(Value),
    /// A set or domain: that of an array that a function takes.
    Axis(Axis),
    /// An expression at its own place, with what is bound there: element of a tuple.
    Alias(Expr, ScopeId, Option<Rc<Binding>>),
    /// An element of a variable, by its linear address: element of `states` and the like.
    Element(SymbolId, Affine),
    /// A whole number: face or cell number of a prescribed grid.
    Number(ExprId),
    /// The numbers of a range that stays a loop.
    Run(Cell),
}

impl Place {
    /// A place with nothing bound.
    pub(in crate::elaborate) fn new(scope: ScopeId, site: Site) -> Place {
        Place { scope, bindings: None, depth: 0, face: None, site }
    }

    /// The place with one more name bound.
    pub(in crate::elaborate) fn bind(&self, name: &str, to: Bound) -> Place {
        let mut place = self.clone();
        place.bindings = Some(Rc::new(Binding { name: name.to_owned(), to, next: self.bindings.clone() }));
        place
    }

    /// Bindings, the innermost first.
    pub(in crate::elaborate) fn all_bound(&self) -> impl Iterator<Item = (&str, &Bound)> {
        std::iter::successors(self.bindings.as_deref(), |binding| binding.next.as_deref()).map(|b| (b.name.as_str(), &b.to))
    }

    /// Surrounding loops over numbers, by bit.
    pub(in crate::elaborate) fn runs(&self) -> u8 {
        self.all_bound().fold(0, |bits, (_, bound)| match bound {
            Bound::Run(Cell { along: Some(v), .. }) => bits | 1 << v.0,
            _ => bits,
        })
    }

    /// Binding of a name.
    pub(in crate::elaborate) fn bound(&self, name: &str) -> Option<&Bound> {
        self.all_bound().find(|(bound, _)| *bound == name).map(|(_, to)| to)
    }
}

/// An index as a key of what was expanded for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum IndexKey {
    /// Member of a set.
    Member(usize),
    /// Cells of a loop.
    Cell(Cell),
}

impl IndexKey {
    /// The key of a bound index.
    pub(crate) fn of(bound: &Bound) -> Self {
        match bound {
            Bound::Member(_, i) => IndexKey::Member(*i),
            Bound::Cell(_, c) | Bound::Face(_, c) | Bound::Run(c) => IndexKey::Cell(*c),
            _ => IndexKey::Member(usize::MAX),
        }
    }
}

/// One value of a binder.
pub(crate) enum BinderValue {
    /// A member, a number, an element.
    One(Bound),
    /// The cells of a domain from one number to another.
    Cells(DomainId, i64, i64),
    /// All elements of a variable.
    Elements(SymbolId, i64),
}

/// Target of a path such as `R1.inlet` or `col[2].c`.
pub(crate) enum Target {
    /// A symbol.
    Symbol(SymbolId),
    /// Already a value.
    Value(Value),
    /// An error was reported.
    Nothing,
}
