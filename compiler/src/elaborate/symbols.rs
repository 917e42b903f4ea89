//! Scopes, symbols, sets and domains: what a name can stand for.

mod queries;

use std::rc::Rc;

use cranelift_entity::{PrimaryMap, entity_impl};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Declaration, Expr, Flux, Ident, Local, Parameter, Phase, Reaction, TimeTableKind};
use smpl_dsl::units::{OwnUnits, Unit};

use crate::elaborate::formula::Formula;
use crate::ir::{FastMap, VarId};
use crate::model::Variable;

/// A scope: the file, an instance of a component, or a port of one.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct ScopeId(u32);
entity_impl!(ScopeId, "scope");

/// Something with a name.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct SymbolId(u32);
entity_impl!(SymbolId, "symbol");

/// An index set.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct SetId(u32);
entity_impl!(SetId, "set");

/// A spatial domain of one instance.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct DomainId(u32);
entity_impl!(DomainId, "domain");

/// Names of one scope.
#[derive(Debug, Default)]
pub(super) struct Scope {
    /// Path with a trailing dot, empty for the file: `R1.inlet.`
    pub prefix: String,
    /// Enclosing scope.
    pub parent: Option<ScopeId>,
    /// The names declared here.
    pub names: FastMap<String, SymbolId>,
}

/// A symbol.
#[derive(Clone, Debug)]
pub(super) struct Symbol<'a> {
    /// Name with its path.
    pub path: String,
    /// Place of the declaration.
    pub scope: ScopeId,
    /// Place of the declaration.
    pub span: Span,
    /// Kind.
    pub kind: SymbolKind<'a>,
}

/// Kind of a symbol.
#[derive(Clone, Debug)]
pub(super) enum SymbolKind<'a> {
    /// State, algebraic variable, parameter, action, discrete variable or disturbance.
    Variable { var: VarId, axes: Rc<[Axis]>, unit: Unit, declaration: &'a Declaration },
    /// Named expression; a `random` number is one whose definition draws.
    Let { axes: Rc<[Axis]>, binders: Rc<[String]>, unit: Option<Unit>, definition: &'a Expr, random: bool, declaration: &'a Declaration },
    /// Numbers over sets.
    Table { axes: Rc<[Axis]>, unit: Unit, values: Rc<[f64]> },
    /// A function of time or another quantity.
    TimeTable { unit: Unit, time_unit: Unit, kind: TimeTableKind, outside: Outside, points: Rc<[(f64, f64)]> },
    /// A function of two quantities.
    Surface { unit: Unit, units: Rc<[Unit; 2]>, cubic: bool, outside: Outside, grid: Rc<Grid> },
    /// Source terms of reactions, over their species and the domains of their rates.
    Source(Rc<Reactions<'a>>),
    /// Stoichiometric coefficients, over reactions and species.
    Stoichiometry(Rc<Reactions<'a>>),
    /// A function.
    Def { parameters: &'a [Parameter], locals: &'a [Local], body: &'a Expr },
    /// Variables under one name.
    Tuple(&'a [Expr]),
    /// An index set.
    Set(SetId),
    /// A domain.
    Domain(DomainId),
    /// A flux on the faces of a domain.
    Flux { flux: &'a Flux, axes: Rc<[Axis]>, binders: Rc<[String]> },
    /// An instance of a component, or a port of one.
    Instance(ScopeId),
    /// Instances over a set.
    Instances(Rc<Row>),
    /// A choice: the options and the chosen one.
    Choice { options: &'a [Ident], chosen: usize },
    /// A structural number.
    Integer(i64),
    /// A structural switch.
    Truth(bool),
    /// The phase in force; as a set, all phases.
    Phase(SetId),
    /// The independent variable.
    Time,
    /// Something whose declaration is invalid; its uses are not reported.
    Faulty,
}

/// The reactions of a scope.
#[derive(Clone, Debug)]
pub(super) struct Reactions<'a> {
    /// The set that has all species.
    pub species: SetId,
    /// The set of the reactions, in the order of the list.
    pub names: SetId,
    /// Domains over whose cells rates are.
    pub domains: Vec<DomainId>,
    /// The reactions.
    pub list: Vec<OneReaction<'a>>,
}

/// A reaction at members of the sets of its indices.
#[derive(Clone, Debug)]
pub(super) struct OneReaction<'a> {
    /// Symbol of the rate.
    pub rate: SymbolId,
    /// The statement.
    pub reaction: &'a Reaction,
    /// Indices over sets, and the members.
    pub bound: Vec<(&'a str, SetId, usize)>,
}

/// Reading of a table outside its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Outside {
    /// As at the nearest point.
    #[default]
    Constant,
    /// By a line from the nearest point on.
    Linear,
    /// The episode fails there.
    Refused,
    /// As inside, shifted by whole periods from the first point to the last.
    Cyclic,
}

/// Values over a rectangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Grid {
    /// Values of the first argument.
    pub first: Vec<f64>,
    /// Values of the second argument.
    pub second: Vec<f64>,
    /// Values of the table, the second argument fastest.
    pub values: Vec<f64>,
}

/// Instances in a row, by the labels of their index.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// Label and scope of each.
    pub list: Vec<(String, ScopeId)>,
    /// Number of indices, whose labels a comma separates.
    pub indices: usize,
    by_label: FastMap<String, ScopeId>,
}

impl Row {
    /// A row of instances.
    pub(super) fn new(list: Vec<(String, ScopeId)>, indices: usize) -> Row {
        let by_label = list.iter().cloned().collect();
        Row { list, indices, by_label }
    }

    /// The instance with a label.
    pub(super) fn find(&self, label: &str) -> Option<ScopeId> {
        self.by_label.get(label).copied()
    }
}

/// One index of a declared array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    /// Members of a set: unrolled.
    Set(SetId),
    /// Cells of a domain: loops.
    Domain(DomainId),
}

/// Names in a message; of many, the first few.
pub(super) fn listed<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> String {
    const MANY: usize = 8;
    let n = names.len();
    let shown: Vec<&str> = names.take(if n > MANY { MANY / 2 } else { MANY }).collect();
    if n > MANY { format!("{}, ... ({n} members)", shown.join(", ")) } else { shown.join(", ") }
}

/// An index set.
#[derive(Clone, Debug)]
pub(super) struct Set {
    /// Its name.
    pub name: String,
    /// Labels of its members.
    pub labels: Vec<String>,
    /// The first member of a set of integers.
    pub first: Option<i64>,
    /// Positions of the members of a long set of names.
    by_label: FastMap<String, usize>,
}

impl Set {
    /// A set of names, or of the integers from `first` on.
    pub(super) fn new(name: String, labels: Vec<String>, first: Option<i64>) -> Set {
        const LONG: usize = 32;
        let mut by_label = FastMap::default();
        if labels.len() > LONG && first.is_none() {
            labels.iter().enumerate().for_each(|(i, label)| {
                by_label.entry(label.clone()).or_insert(i);
            });
        }
        Set { name, labels, first, by_label }
    }

    /// Position of a member.
    pub(super) fn position(&self, label: &str) -> Option<usize> {
        if let Some(first) = self.first {
            let at = label.parse::<i64>().ok()?.checked_sub(first)?;
            return usize::try_from(at).ok().filter(|&at| self.labels.get(at).is_some_and(|l| l == label));
        }
        if self.by_label.is_empty() { self.labels.iter().position(|l| l == label) } else { self.by_label.get(label).copied() }
    }
}

/// Scheme of face values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scheme {
    /// The cell on the low side.
    Upwind,
    /// The cell on the high side.
    Downwind,
    /// Linear between the neighbours.
    Central,
    /// Linear from two cells on the low side.
    Upwind2,
    /// Second order limited by van Leer's function.
    Limited,
}

/// Shape of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Geometry {
    /// Faces of equal area.
    Planar,
    /// Areas grow with the radius.
    Cylindrical,
    /// Areas grow with its square.
    Spherical,
}

/// A domain.
#[derive(Clone, Debug)]
pub(super) struct Domain<'a> {
    /// Name of the domain and of its index.
    pub name: String,
    /// Scope of its expressions.
    pub scope: ScopeId,
    /// The declaration.
    pub declaration: &'a smpl_dsl::syntax::Domain,
    /// Number of cells.
    pub cells: i64,
    /// Scheme of its fluxes.
    pub scheme: Scheme,
    /// Shape.
    pub geometry: Geometry,
}

/// The schedule of a model.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct Schedule<'a> {
    /// Number of the phase in force.
    pub current: VarId,
    /// When it began.
    pub since: VarId,
    /// Number of the phase being left, 0 outside a transition.
    pub leaving: VarId,
    pub scope: ScopeId,
    pub phases: Vec<&'a Phase>,
}

/// A port of an instance.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct Port {
    /// Its path: `R1.inlet`.
    pub path: String,
    /// Name of its connector.
    pub connector: String,
    /// Its scope.
    pub scope: ScopeId,
    /// Its members as the connector declares them.
    pub members: Vec<SymbolId>,
    /// Those after `flow`.
    pub flows: Vec<SymbolId>,
}

/// All scopes, symbols, sets and domains, and the variables that they stand for.
#[derive(Debug)]
pub(super) struct Symbols<'a> {
    /// Scopes; the file is the first.
    pub scopes: PrimaryMap<ScopeId, Scope>,
    /// Symbols in the order of declaration.
    pub list: PrimaryMap<SymbolId, Symbol<'a>>,
    /// Sets.
    pub sets: PrimaryMap<SetId, Set>,
    /// Domains.
    pub domains: PrimaryMap<DomainId, Domain<'a>>,
    /// Variables of the flat model.
    pub vars: PrimaryMap<VarId, Variable>,
    /// The symbol of each declared variable.
    pub of_var: FastMap<VarId, SymbolId>,
    /// Formulas of members of sets: elements with their numbers, and the charge.
    pub formulas: FastMap<(SetId, usize), Formula>,
    /// Units that the model declares.
    pub units: OwnUnits,
    /// The phases.
    pub schedule: Option<Schedule<'a>>,
    /// Ports of all instances.
    pub ports: Vec<Port>,
    /// Packages that are arguments of instances.
    pub packages: FastMap<ScopeId, Vec<ScopeId>>,
    /// Name of the independent variable.
    pub time_name: String,
    /// Its unit.
    pub time_unit: Unit,
}

impl Default for Symbols<'_> {
    fn default() -> Self {
        Symbols {
            scopes: PrimaryMap::new(),
            list: PrimaryMap::new(),
            sets: PrimaryMap::new(),
            domains: PrimaryMap::new(),
            vars: PrimaryMap::new(),
            formulas: FastMap::default(),
            units: OwnUnits::default(),
            schedule: None,
            of_var: FastMap::default(),
            ports: Vec::new(),
            packages: FastMap::default(),
            time_name: "t".to_owned(),
            time_unit: Unit::one(),
        }
    }
}

impl<'a> std::ops::Index<SymbolId> for Symbols<'a> {
    type Output = Symbol<'a>;

    fn index(&self, symbol: SymbolId) -> &Symbol<'a> {
        &self.list[symbol]
    }
}

impl std::ops::IndexMut<SymbolId> for Symbols<'_> {
    fn index_mut(&mut self, symbol: SymbolId) -> &mut Self::Output {
        &mut self.list[symbol]
    }
}

impl<'a> Symbols<'a> {
    /// Looks a name up from a scope outwards.
    pub(crate) fn lookup(&self, scope: ScopeId, name: &str) -> Option<SymbolId> {
        let mut at = Some(scope);
        while let Some(id) = at {
            let scope = &self.scopes[id];
            if let Some(&symbol) = scope.names.get(name) {
                return Some(symbol);
            }
            at = scope.parent;
        }
        None
    }

    /// All names that can be seen from a scope, for suggestions; in no order.
    pub(crate) fn visible(&self, scope: ScopeId) -> Vec<&str> {
        let mut names = Vec::new();
        let mut at = Some(scope);
        while let Some(id) = at {
            // Data of disturbances have names that no text can have.
            names.extend(self.scopes[id].names.keys().map(String::as_str).filter(|name| !name.contains(' ')));
            at = self.scopes[id].parent;
        }
        names
    }

    /// Declares a symbol; gives back the earlier one of that name in that scope.
    pub(super) fn declare(&mut self, name: &str, symbol: Symbol<'a>) -> Result<SymbolId, SymbolId> {
        let scope = symbol.scope;
        if let Some(&before) = self.scopes[scope].names.get(name) {
            return Err(before);
        }
        let id = self.list.push(symbol);
        self.scopes[scope].names.insert(name.to_owned(), id);
        Ok(id)
    }

    /// Number of members along an axis.
    pub(crate) fn axis_len(&self, axis: Axis) -> i64 {
        match axis {
            Axis::Set(set) => self.sets[set].labels.len() as i64,
            Axis::Domain(domain) => self.domains[domain].cells,
        }
    }

    /// Name of the set or domain of an axis.
    pub(crate) fn axis_name(&self, axis: Axis) -> &str {
        match axis {
            Axis::Set(set) => &self.sets[set].name,
            Axis::Domain(domain) => &self.domains[domain].name,
        }
    }
}
