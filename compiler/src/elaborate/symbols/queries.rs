//! Queries of the symbols.

use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, ReactionTerm, StatementKind};

use crate::elaborate::lower::place::Place;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{Axis, OneReaction, ScopeId, SetId, SymbolId, SymbolKind, Symbols};
use crate::ir::{Affine, Expr as Node, ExprId, Exprs, FastMap, FastSet, Flavour, Role, VarId};
use crate::model;

impl<'a> Symbols<'a> {
    /// Dependencies of an expression other than parameters, for messages.
    pub(in crate::elaborate) fn varying(&self, exprs: &Exprs, e: ExprId) -> Option<String> {
        exprs.below([e]).find_map(|e| match exprs.node(e) {
            Node::Time => Some(format!("the time `{}`", self.time_name)),
            Node::Load { var, .. } => {
                let name = &self.vars[var].name;
                let what = match self.vars[var].role {
                    Role::State => "the state",
                    Role::Algebraic => "the algebraic variable",
                    Role::Action => "the action",
                    Role::Discrete => "the discrete variable",
                    Role::Disturbance => "the disturbance",
                    Role::Builtin => return Some("the clock".to_owned()),
                    Role::Quadrature => return Some("an integral over the step".to_owned()),
                    Role::Delayed => return Some("a delayed value".to_owned()),
                    _ => return None,
                };
                Some(format!("{what} `{name}`"))
            }
            _ => None,
        })
    }

    /// A state or algebraic variable whose present value or rate an expression reads, for messages.
    pub(in crate::elaborate) fn unknown_now(&self, exprs: &Exprs, e: ExprId) -> Option<String> {
        exprs.below([e]).find_map(|e| match exprs.node(e) {
            Node::Load { var, flavour: Flavour::Value | Flavour::Derivative, .. } => {
                let v = &self.vars[var];
                match v.role {
                    Role::State => Some(format!("the state `{}`", v.name)),
                    Role::Algebraic => Some(format!("the algebraic variable `{}`", v.name)),
                    _ => None,
                }
            }
            _ => None,
        })
    }

    /// Elements of parameters that an expression loads.
    pub(in crate::elaborate) fn parameters_in(&self, exprs: &Exprs, e: ExprId) -> Vec<(VarId, Affine)> {
        let read = |e: ExprId| match exprs.node(e) {
            Node::Load { var, at, .. } if self.vars[var].role == Role::Param => Some((var, at)),
            _ => None,
        };
        exprs.below([e]).filter_map(read).collect()
    }

    pub(in crate::elaborate) fn model_axes(&self, axes: &[Axis]) -> Vec<model::Axis> {
        axes.iter()
            .map(|&axis| match axis {
                Axis::Domain(d) => model::Axis::Cells { grid: d.as_u32(), count: self.domains[d].cells as u32 },
                Axis::Set(s) => {
                    let set = &self.sets[s];
                    match set.first {
                        Some(first) => model::Axis::Numbers { first, count: set.labels.len() as u32, set: set.name.clone() },
                        None => model::Axis::Names(set.labels.clone()),
                    }
                }
            })
            .collect()
    }

    pub(in crate::elaborate) fn walk(&self, scope: ScopeId, blocks: &FastMap<ScopeId, &[Item<'a>]>, out: &mut Vec<SymbolId>) {
        let Some(items) = blocks.get(&scope) else {
            // A port: its members in the order of declaration.
            let mut members: Vec<SymbolId> = self.scopes[scope].names.values().copied().collect();
            members.sort_unstable();
            out.extend(members);
            return;
        };
        self.packages.get(&scope).into_iter().flatten().for_each(|package| self.walk(*package, blocks, out));
        let own = |name: &str| self.scopes[scope].names.get(name).copied();
        for item in *items {
            match item {
                Item::Declare(_, d) => out.extend(own(&d.name.text)),
                Item::Other(statement) => match &statement.kind {
                    StatementKind::Instance { name, .. } => {
                        let scopes = own(&name.text).into_iter().flat_map(|symbol| self.scopes_of(symbol));
                        scopes.for_each(|inner| self.walk(inner, blocks, out));
                    }
                    StatementKind::Port { names, .. } => {
                        let scopes = names.iter().filter_map(|port| own(&port.name.text)).flat_map(|symbol| self.scopes_of(symbol));
                        scopes.for_each(|port| self.walk(port, blocks, out));
                    }
                    _ => {}
                },
                _ => {}
            }
        }
    }

    /// Scopes of instances, or of ports, with one name.
    fn scopes_of(&self, symbol: SymbolId) -> Vec<ScopeId> {
        match &self[symbol].kind {
            SymbolKind::Instance(scope) => vec![*scope],
            SymbolKind::Instances(row) => row.list.iter().map(|(_, scope)| *scope).collect(),
            _ => Vec::new(),
        }
    }

    /// The element of an array that a flattened name means: `c[water,3]`, or `n7` where the names
    /// are made so.
    pub(in crate::elaborate) fn element_named(&self, symbol: SymbolId, name: &str) -> Option<i64> {
        let SymbolKind::Variable { axes, declaration, .. } = &self[symbol].kind else { return None };
        let (before, after) = match &declaration.pattern {
            Some(pattern) => pattern.split_once("{}")?,
            None => (self[symbol].path.as_str(), ""),
        };
        let mut inner = name.strip_prefix(before)?.strip_suffix(after)?;
        if declaration.pattern.is_none() {
            inner = inner.strip_prefix('[')?.strip_suffix(']')?;
        }
        let labels: Vec<&str> = inner.split(',').map(str::trim).collect();
        if axes.is_empty() || labels.len() != axes.len() {
            return None;
        }
        axes.iter().zip(labels).try_fold(0, |at, (&axis, label)| {
            let len = self.axis_len(axis);
            let member = match axis {
                Axis::Set(set) => self.sets[set].position(label).map(|i| i as i64),
                Axis::Domain(_) => label.parse::<i64>().ok().map(|i| i - 1),
            };
            member.filter(|i| (0..len).contains(i)).map(|i| at * len + i)
        })
    }

    pub(in crate::elaborate) fn variables<const N: usize>(&self, roles: [Role; N]) -> impl Iterator<Item = (Role, SymbolId)> + '_ {
        let of = move |s: SymbolId| match &self[s].kind {
            SymbolKind::Variable { var, .. } => Some((self.vars[*var].role, s)).filter(|(role, _)| roles.contains(role)),
            _ => None,
        };
        self.list.keys().filter_map(of)
    }

    /// Labels of the members of a set made from others, `species - solids`; `None` if a name in it
    /// is not a known set.
    pub(in crate::elaborate) fn labels_of(&self, scope: ScopeId, e: &Expr) -> Option<Vec<String>> {
        match &e.kind {
            ExprKind::Name(name) => match self[self.lookup(scope, &name.text)?].kind {
                SymbolKind::Set(set) => Some(self.sets[set].labels.clone()),
                _ => None,
            },
            ExprKind::Binary(BinaryOp::Add, a, b) => {
                let mut labels = self.labels_of(scope, a)?;
                for label in self.labels_of(scope, b)? {
                    if !labels.contains(&label) {
                        labels.push(label);
                    }
                }
                Some(labels)
            }
            ExprKind::Binary(BinaryOp::Sub, a, b) => {
                let mut labels = self.labels_of(scope, a)?;
                let without = match &b.kind {
                    // A single member.
                    ExprKind::Name(name) if labels.contains(&name.text) => vec![name.text.clone()],
                    _ => self.labels_of(scope, b)?,
                };
                labels.retain(|label| !without.contains(label));
                Some(labels)
            }
            ExprKind::Tuple(list) => {
                let mut labels: Vec<String> = Vec::new();
                for e in list {
                    let members = self.labels_of(scope, e).or_else(|| Some(vec![self.known_member(e)?.to_owned()]))?;
                    labels.extend(members);
                }
                let mut seen = FastSet::default();
                labels.retain(|label| seen.insert(label.clone()));
                Some(labels)
            }
            _ => None,
        }
    }

    /// Names of sets and of their members.
    pub(in crate::elaborate) fn names_of_sets(&self) -> impl Iterator<Item = &str> {
        self.sets.values().flat_map(|set| set.labels.iter().chain([&set.name])).map(String::as_str)
    }

    /// Returns `true` if a set occurs in sums and differences.
    pub(in crate::elaborate) fn has_set(&self, scope: ScopeId, e: &Expr) -> bool {
        match &e.kind {
            ExprKind::Binary(BinaryOp::Add | BinaryOp::Sub, a, b) => self.has_set(scope, a) || self.has_set(scope, b),
            ExprKind::Name(_) | ExprKind::Tuple(_) => self.labels_of(scope, e).is_some(),
            _ => false,
        }
    }

    /// The name of a member of some set.
    fn known_member<'e>(&self, e: &'e Expr) -> Option<&'e str> {
        let ExprKind::Name(name) = &e.kind else { return None };
        self.sets.values().any(|set| set.position(&name.text).is_some()).then_some(name.text.as_str())
    }

    /// The first part of a set of sets that is neither a set nor a member in a list.
    pub(in crate::elaborate) fn not_a_set<'e>(&self, scope: ScopeId, e: &'e Expr) -> Option<&'e Expr> {
        match &e.kind {
            ExprKind::Binary(op @ (BinaryOp::Add | BinaryOp::Sub), a, b) => {
                let is_member = *op == BinaryOp::Sub && self.known_member(b).is_some();
                self.not_a_set(scope, a).or_else(|| self.not_a_set(scope, b).filter(|_| !is_member))
            }
            ExprKind::Tuple(list) => list.iter().find(|e| self.known_member(e).is_none() && self.labels_of(scope, e).is_none()),
            _ => self.labels_of(scope, e).is_none().then_some(e),
        }
    }

    /// The variables of a tuple with a name, and where they are declared.
    pub(in crate::elaborate) fn tuple(&self, e: &Expr, place: &Place) -> Option<(&'a [Expr], ScopeId)> {
        let ExprKind::Name(name) = &e.kind else { return None };
        let symbol = if place.bound(&name.text).is_none() { self.lookup(place.scope, &name.text)? } else { return None };
        match self[symbol].kind {
            SymbolKind::Tuple(list) => Some((list, self[symbol].scope)),
            _ => None,
        }
    }

    /// The set of which a label is a member, the first in sight from a scope.
    pub(in crate::elaborate) fn set_with(&self, scope: ScopeId, e: &Expr, label: &str) -> Option<(SetId, usize)> {
        match &e.kind {
            ExprKind::Name(name) => match self[self.lookup(scope, &name.text)?].kind {
                SymbolKind::Set(set) => Some((set, self.sets[set].position(label)?)),
                _ => None,
            },
            ExprKind::Binary(_, a, b) => self.set_with(scope, a, label).or_else(|| self.set_with(scope, b, label)),
            ExprKind::Tuple(list) => {
                let of_set = list.iter().find_map(|e| self.set_with(scope, e, label));
                of_set.or_else(|| self.sets.iter().find_map(|(set, data)| Some((set, data.position(label)?))))
            }
            _ => None,
        }
    }

    /// The species of a term of a reaction, by its label.
    pub(in crate::elaborate) fn species_label<'s>(&'s self, one: &OneReaction<'a>, term: &'a ReactionTerm) -> &'s str
    where
        'a: 's,
    {
        let bound = one.bound.iter().find(|(name, ..)| *name == term.species.text);
        bound.map_or(&term.species.text, |(_, set, i)| &self.sets[*set].labels[*i])
    }

    /// Returns `true` if a table is the data of a disturbance, which is read at the present time.
    pub(in crate::elaborate) fn is_data(&self, table: SymbolId) -> bool {
        let symbol = &self[table];
        let name = symbol.path.strip_prefix(&self.scopes[symbol.scope].prefix).unwrap_or_default();
        self.scopes[symbol.scope].names.get(name) != Some(&table)
    }

    /// Returns `true` if the model has a parameter of that name.
    pub(in crate::elaborate) fn parameters_named(&self, name: &str) -> bool {
        self.variables([Role::Param]).any(|(_, s)| self[s].path == name)
    }
}
