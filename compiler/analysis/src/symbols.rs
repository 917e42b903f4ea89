//! Symbols: everything in a model that has a name, with its declarations.

use std::collections::HashMap;

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Role, UnitExpr};
use smpl_dsl::units::OwnUnits;

/// A symbol of a [`crate::program::Program`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SymbolId(pub u32);

/// Kinds of symbol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SymbolKind {
    /// The model itself.
    Model,
    /// The independent variable.
    Time,
    /// A declared unit.
    Unit,
    /// An index set.
    Set,
    /// A member of a set.
    Member,
    /// Numbers over sets.
    Table,
    /// A value over time.
    TimeTable,
    /// A function.
    Function,
    /// An argument of a function.
    Argument,
    /// A declared quantity.
    Variable(Role),
    /// A spatial domain.
    Domain,
    /// A flux along a domain.
    Flux,
    /// A connector.
    Connector,
    /// A component.
    Component,
    /// A structural parameter of a component.
    Structural,
    /// A port of a component.
    Port,
    /// An instance of a component.
    Instance,
    /// An index that a `for`, a sum or a declaration binds.
    Index,
    /// A set of observations.
    Level,
    /// An observation with its own name.
    Observation,
    /// A reward.
    Reward,
    /// A failure.
    Failure,
    /// A success condition.
    Success,
    /// A constraint.
    Constraint,
    /// An invariant.
    Invariant,
    /// A policy.
    Policy,
    /// An event.
    Event,
    /// A phase of a schedule.
    Phase,
    /// A test.
    Test,
    /// A variant.
    Variant,
    /// A choice.
    Choice,
    /// An option of a choice.
    Choose,
}

impl SymbolKind {
    /// The kind in words: `state`, `parameter`, `index set`.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            SymbolKind::Model => "model",
            SymbolKind::Time => "time",
            SymbolKind::Unit => "unit",
            SymbolKind::Set => "index set",
            SymbolKind::Member => "member of a set",
            SymbolKind::Table => "table",
            SymbolKind::TimeTable => "table over time",
            SymbolKind::Function => "function",
            SymbolKind::Argument => "argument",
            SymbolKind::Variable(role) => role_words(role),
            SymbolKind::Domain => "domain",
            SymbolKind::Flux => "flux",
            SymbolKind::Connector => "connector",
            SymbolKind::Component => "component",
            SymbolKind::Structural => "structural parameter",
            SymbolKind::Port => "port",
            SymbolKind::Instance => "instance",
            SymbolKind::Index => "index",
            SymbolKind::Level => "observation level",
            SymbolKind::Observation => "observation",
            SymbolKind::Reward => "reward",
            SymbolKind::Failure => "failure",
            SymbolKind::Success => "success condition",
            SymbolKind::Constraint => "constraint",
            SymbolKind::Invariant => "invariant",
            SymbolKind::Policy => "policy",
            SymbolKind::Event => "event",
            SymbolKind::Phase => "phase",
            SymbolKind::Test => "test",
            SymbolKind::Variant => "variant",
            SymbolKind::Choice => "choice",
            SymbolKind::Choose => "option",
        }
    }

    /// Returns whether the name is used in expressions, so that it shares their scope.
    #[must_use]
    pub fn is_value(self) -> bool {
        !matches!(
            self,
            SymbolKind::Model
                | SymbolKind::Level
                | SymbolKind::Observation
                | SymbolKind::Reward
                | SymbolKind::Failure
                | SymbolKind::Success
                | SymbolKind::Constraint
                | SymbolKind::Invariant
                | SymbolKind::Policy
                | SymbolKind::Event
                | SymbolKind::Phase
                | SymbolKind::Test
        )
    }

    /// Returns whether the symbol is known in a part of one statement only.
    #[must_use]
    pub fn is_local(self) -> bool {
        matches!(self, SymbolKind::Index | SymbolKind::Argument)
    }
}

fn role_words(role: Role) -> &'static str {
    match role {
        Role::Param => "parameter",
        Role::Action => "action",
        Role::State => "state",
        Role::Var => "algebraic variable",
        Role::Let => "named expression",
        Role::Discrete => "discrete variable",
        Role::Disturbance => "disturbance",
        Role::Random => "random number",
    }
}

/// A declaration of a symbol: variants may declare it again.
#[derive(Clone, Debug)]
pub struct Site {
    /// The declared name.
    pub name: Span,
    /// The declaration, without the others of its statement.
    pub declaration: Span,
}

/// A symbol.
#[derive(Clone, Debug)]
pub struct Symbol {
    /// Name.
    pub name: String,
    /// Kind, by the first declaration.
    pub kind: SymbolKind,
    /// Component, connector, set or choice that it belongs to; `None` at the level of the file.
    pub within: Option<SymbolId>,
    /// Declarations, those of variants included.
    pub sites: Vec<Site>,
    /// Unit, where written.
    pub unit: Option<UnitExpr>,
    /// Describing text.
    pub text: Option<String>,
    /// Sets and domains of its indices.
    pub indices: Vec<String>,
    /// The defining expression.
    pub value: Option<Span>,
    /// Bounds as written.
    pub bounds: Option<(Span, Span)>,
    /// Names of arguments: of a function, of a component's structural parameters.
    pub arguments: Vec<String>,
    /// Component of an instance, connector of a port, set of an index or of a table, base of a
    /// component.
    pub of: Option<String>,
}

impl Symbol {
    /// A symbol with a name and nothing else.
    pub(crate) fn new(name: &str, kind: SymbolKind, within: Option<SymbolId>, site: Site) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            within,
            sites: vec![site],
            unit: None,
            text: None,
            indices: Vec::new(),
            value: None,
            bounds: None,
            arguments: Vec::new(),
            of: None,
        }
    }

    /// The name at its first declaration.
    #[must_use]
    pub fn span(&self) -> Span {
        self.sites.first().map_or_else(Span::default, |site| site.name)
    }
}

/// Symbols by scope and name.
#[derive(Clone, Debug, Default)]
pub struct Symbols {
    list: Vec<Symbol>,
    /// Units by symbol, a separate name space.
    units: HashMap<String, SymbolId>,
    own: OwnUnits,
    by_name: HashMap<(Option<SymbolId>, bool), HashMap<String, SymbolId>>,
}

impl Symbols {
    /// A symbol.
    #[must_use]
    pub fn get(&self, id: SymbolId) -> &Symbol {
        &self.list[id.0 as usize]
    }

    /// All symbols.
    pub fn iter(&self) -> impl Iterator<Item = (SymbolId, &Symbol)> {
        self.list.iter().enumerate().map(|(i, symbol)| (SymbolId(i as u32), symbol))
    }

    /// The symbol of a name in one scope; those that expressions use are a separate name space.
    #[must_use]
    pub fn find(&self, within: Option<SymbolId>, value: bool, name: &str) -> Option<SymbolId> {
        let own = |within| self.by_name.get(&(within, value)).and_then(|names| names.get(name).copied());
        own(within).or_else(|| self.bases(within?).find_map(|base| own(Some(base))))
    }

    /// The components that a component extends, the nearest first.
    fn bases(&self, component: SymbolId) -> impl Iterator<Item = SymbolId> {
        const DEEPEST: usize = 32;
        let base = |id: &SymbolId| {
            let symbol = self.get(*id);
            let name = symbol.of.as_ref().filter(|_| symbol.kind == SymbolKind::Component)?;
            self.by_name.get(&(None, true))?.get(name).copied()
        };
        std::iter::successors(base(&component), base).take(DEEPEST)
    }

    /// The symbol that a name in an expression means, from a component outwards.
    #[must_use]
    pub fn lookup(&self, within: Option<SymbolId>, name: &str) -> Option<SymbolId> {
        let here = within.and_then(|_| self.find(within, true, name).or_else(|| self.find(within, false, name)));
        here.or_else(|| self.find(None, true, name)).or_else(|| self.find(None, false, name))
    }

    /// The declared unit of a symbol.
    #[must_use]
    pub fn unit(&self, symbol: &str) -> Option<SymbolId> {
        self.units.get(symbol).copied()
    }

    /// Meanings of the declared units.
    #[must_use]
    pub fn own_units(&self) -> &OwnUnits {
        &self.own
    }

    /// Sets the meanings of the declared units.
    pub(crate) fn set_own_units(&mut self, own: OwnUnits) {
        self.own = own;
    }

    /// Symbols of one scope, in the order of their declaration.
    pub fn members(&self, within: Option<SymbolId>) -> impl Iterator<Item = (SymbolId, &Symbol)> {
        let bases: Vec<SymbolId> = within.iter().flat_map(|id| self.bases(*id)).collect();
        let inside = move |symbol: &Symbol| symbol.within == within || symbol.within.is_some_and(|id| bases.contains(&id));
        self.iter().filter(move |(_, symbol)| inside(symbol) && !symbol.kind.is_local())
    }

    /// The scope that the members of a symbol are in: the component of an instance, the connector
    /// of a port, a set or choice itself.
    #[must_use]
    pub fn scope_of(&self, id: SymbolId) -> Option<SymbolId> {
        let symbol = self.get(id);
        match symbol.kind {
            SymbolKind::Instance | SymbolKind::Port => self.find(None, true, symbol.of.as_deref()?),
            SymbolKind::Set | SymbolKind::Choice | SymbolKind::Component | SymbolKind::Connector => Some(id),
            _ => None,
        }
    }

    /// The name with its scope: `TubularReactor.c`.
    #[must_use]
    pub fn path(&self, id: SymbolId) -> String {
        let symbol = self.get(id);
        match symbol.within {
            Some(within) => format!("{}.{}", self.path(within), symbol.name),
            None => symbol.name.clone(),
        }
    }

    /// Adds a symbol, or a declaration to the symbol of that name and scope.
    pub(crate) fn declare(&mut self, symbol: Symbol) -> SymbolId {
        let names = match symbol.kind {
            SymbolKind::Unit => &mut self.units,
            _ => self.by_name.entry((symbol.within, symbol.kind.is_value())).or_default(),
        };
        match names.get(&symbol.name) {
            Some(&known) => {
                self.list[known.0 as usize].sites.extend(symbol.sites);
                known
            }
            None => {
                names.insert(symbol.name.clone(), SymbolId(self.list.len() as u32));
                self.add(symbol)
            }
        }
    }

    /// Adds a symbol that no name leads to.
    pub(crate) fn add(&mut self, symbol: Symbol) -> SymbolId {
        self.list.push(symbol);
        SymbolId(self.list.len() as u32 - 1)
    }
}
