//! Declarations: variants, imports, sets, tables, variables, components.

mod checks;
mod data;
mod declarations;
pub(in crate::elaborate) mod declaring;
mod functions_of_quantities;
mod instances;
pub(in crate::elaborate) mod interpolation;
mod packages;
mod phases;
mod reactions;
mod tables;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr, Ident, PortName, Statement, StatementKind};
use smpl_dsl::units::{OwnUnits, Unit};

use crate::elaborate::declare::declarations::Turn;
use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::declare::instances::{Lineage, MAX_INSTANTIATED};
use crate::elaborate::hidden::Regular;
use crate::elaborate::lower::place::{BinderValue, Bound, Place, Site};
use crate::elaborate::lower::{binders, units};
use crate::elaborate::select::imports::gathered;
use crate::elaborate::select::items::{Item, Selection, items, overlay, removed};
use crate::elaborate::symbols::{Row, Scope, ScopeId, Symbol, SymbolKind};

impl<'a> Declaring<'_, 'a> {
    /// Declares everything of the main file and what it imports.
    pub(in crate::elaborate) fn declare_file(&mut self) {
        let root = self.symbols.scopes.push(Scope::default());
        let mut list = self.gathered();
        overlay(&mut list, items(&self.input.options.overlay, &self.input.selection));
        for item in &list {
            if let Item::Other(statement) = item {
                self.register(statement);
            }
        }
        self.declare_units(&list);
        self.declare_time(root, &list);
        self.declare_block(root, list, 0);
        self.declare_regular();
    }

    /// Declares the memory of regular instants, if there are any.
    fn declare_regular(&mut self) {
        let is_regular = |item: &Item<'_>| match item {
            Item::At(moment, _) => moment.every.is_some(),
            Item::Other(statement) => matches!(statement.kind, StatementKind::Control(_)),
            Item::Declare(..) | Item::Observe(_) => false,
        };
        if self.instances.blocks.iter().flat_map(|(_, items)| items).any(is_regular) {
            self.work.hidden.regular = Some(Regular::new(&mut self.symbols.vars));
        }
    }

    /// Declares the units of the model: everything else may be in them.
    fn declare_units(&mut self, list: &[Item<'a>]) {
        let statements = list.iter().filter_map(|item| match item {
            Item::Other(statement) => Some(&statement.kind),
            Item::Declare(..) | Item::Observe(_) | Item::At(..) => None,
        });
        let (units, faults) = OwnUnits::declared(statements);
        self.symbols.units = units;
        faults.into_iter().for_each(|fault| self.work.ledger.report(fault));
        self.work.ledger.check_unit_names(list);
    }

    /// Declares what a component may see of the file, without what belongs to the file's own model.
    pub(in crate::elaborate) fn declare_seen(&mut self) -> ScopeId {
        let root = self.symbols.scopes.push(Scope::default());
        let mut list = self.gathered();
        list.iter().for_each(|item| match item {
            Item::Other(statement) => self.register(statement),
            Item::Declare(..) | Item::Observe(_) | Item::At(..) => {}
        });
        self.declare_units(&list);
        self.declare_time(root, &list);
        let instances = list.iter().filter_map(|item| match item {
            Item::Other(Statement { kind: StatementKind::Instance { name, .. }, .. }) => Some(name),
            _ => None,
        });
        let instances: Vec<&Ident> = instances.collect();
        list.retain(|item| match item {
            Item::Declare(..) => true,
            Item::Observe(_) | Item::At(..) => false,
            Item::Other(statement) => matches!(
                statement.kind,
                StatementKind::Set { .. }
                    | StatementKind::Table(_)
                    | StatementKind::TimeTable(_)
                    | StatementKind::Def { .. }
                    | StatementKind::Domain(_)
                    | StatementKind::Flux(_)
                    | StatementKind::Choice { .. }
                    | StatementKind::Reaction(_)
                    | StatementKind::Phase(_)
            ),
        });
        self.declare_block(root, list, 0);
        instances.into_iter().for_each(|name| self.faulty(root, name));
        root
    }

    /// The items of the main file and of what it imports.
    fn gathered(&mut self) -> Vec<Item<'a>> {
        let (list, faults) = gathered(self.input.files, self.input.imports, &self.input.selection);
        faults.into_iter().for_each(|fault| self.work.ledger.report(fault));
        list
    }

    fn register(&mut self, statement: &'a Statement) {
        let (table, name) = match &statement.kind {
            StatementKind::Component { name, .. } => (&mut self.instances.components, name),
            StatementKind::Connector { name, .. } => (&mut self.instances.connectors, name),
            _ => return,
        };
        if let Some(before) = table.insert(&name.text, statement) {
            let at = before.span;
            self.work.ledger.duplicate(name, at);
        }
    }

    fn declare_time(&mut self, root: ScopeId, list: &[Item<'a>]) {
        let mut name = "t".to_owned();
        let mut unit = Unit::named("s");
        let mut span = Span::default();
        let mut model_seen: Option<Span> = None;
        for item in list {
            let Item::Other(statement) = item else { continue };
            match &statement.kind {
                StatementKind::Time { name: n, unit: u } => {
                    name.clone_from(&n.text);
                    span = statement.span;
                    let place = Place::new(root, Site::Dynamics);
                    unit = units::unit(&mut self.lowering(), u, &place);
                }
                StatementKind::Model { name: n, text } => {
                    if let Some(before) = model_seen.replace(statement.span) {
                        self.work.ledger.duplicate(n, before);
                    }
                    self.about.name.clone_from(&n.text);
                    self.about.text = text.clone().unwrap_or_default();
                }
                _ => {}
            }
        }
        self.symbols.time_unit = unit.unwrap_or_else(Unit::one);
        self.symbols.time_name.clone_from(&name);
        let symbol = Symbol { path: name.clone(), scope: root, span, kind: SymbolKind::Time };
        let _ = self.symbols.declare(&name, symbol);
    }

    /// Declares a block: sets and scalars first, since sizes of domains may need them, then what is
    /// indexed, then instances.
    pub(in crate::elaborate) fn declare_block(&mut self, scope: ScopeId, list: Vec<Item<'a>>, depth: usize) {
        self.declare_phases(scope, &list);
        self.work.ledger.check_names(&list);
        self.work.ledger.check_built_ins(&list);
        // Ends of ranges may be computed from scalars; a table declares its set only where nothing
        // else does.
        self.declare_sets(scope, &list, Turn::Named);
        self.declare_derived(scope, &list, false);
        for item in &list {
            if let Item::Declare(role, d) = item
                && d.indices.is_empty()
            {
                self.declare_variable(scope, *role, d);
            }
        }
        self.declare_sets(scope, &list, Turn::Ranges);
        self.declare_reaction_names(scope, &list);
        self.declare_derived(scope, &list, false);
        self.declare_sets(scope, &list, Turn::Tables);
        self.declare_derived(scope, &list, true);
        for item in &list {
            self.declare_unindexed(scope, item);
        }
        for item in &list {
            self.declare_indexed(scope, item);
        }
        self.declare_reactions(scope, &list);
        let at = self.instances.blocks.len();
        self.instances.blocks.push((scope, Vec::new()));
        for item in &list {
            if let Item::Other(statement) = item
                && let StatementKind::Instance { component, name, indices, arguments } = &statement.kind
            {
                self.declare_instance(scope, component, name, indices, arguments, depth);
            }
        }
        self.instances.blocks[at].1 = list;
    }

    /// Declares tables, functions and domains.
    fn declare_unindexed(&mut self, scope: ScopeId, item: &Item<'a>) {
        if let Some((_, target)) = removed(item) {
            let message = "there is no such statement to remove";
            let fault = Diagnostic::error(codes::UNKNOWN_NAME, message, target.span);
            self.work.ledger.report(
                fault.help("`remove` belongs into a variant: write the name of a statement, or its kind and left side, `remove eq d/dt T`, `remove at start`"),
            );
        }
        let Item::Other(statement) = item else { return };
        match &statement.kind {
            StatementKind::Table(table) => self.declare_table(scope, table),
            StatementKind::TimeTable(table) => self.declare_time_table(scope, table),
            StatementKind::Def { name, parameters, locals, body } => {
                self.work.ledger.check_members("parameters", parameters.iter().map(|parameter| &parameter.name));
                self.declare(scope, name, SymbolKind::Def { parameters, locals, body });
            }
            StatementKind::Domain(domain) => self.declare_domain(scope, domain),
            StatementKind::Unit { name, .. } if scope != ScopeId::from_u32(0) => {
                let message = format!("the unit `{}` is declared inside of a component", name.text);
                let fault = Diagnostic::error(codes::WRONG_KIND, message, name.span);
                self.work.ledger.report(fault.help("declare it outside of all components: units belong to the whole model"));
            }
            _ => {}
        }
    }

    /// Declares arrays, fluxes and ports.
    fn declare_indexed(&mut self, scope: ScopeId, item: &Item<'a>) {
        match item {
            Item::Declare(role, d) if !d.indices.is_empty() => self.declare_variable(scope, *role, d),
            Item::Other(Statement { kind: StatementKind::Flux(flux), .. }) => self.declare_flux(scope, flux),
            Item::Other(Statement { kind: StatementKind::Port { names, connector }, .. }) => {
                names.iter().for_each(|port| self.declare_ports(scope, port, connector));
            }
            _ => {}
        }
    }

    /// A port, or one for each member of a set.
    fn declare_ports(&mut self, scope: ScopeId, port: &'a PortName, connector: &'a Ident) {
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, port.name.text);
        let kind = match port.indices.as_slice() {
            [] => self.declare_port(scope, path, connector).map(SymbolKind::Instance),
            indices => self.row_of_ports(scope, &path, indices, connector),
        };
        self.declare(scope, &port.name, kind.unwrap_or(SymbolKind::Faulty));
    }

    fn row_of_ports(&mut self, scope: ScopeId, path: &str, indices: &[Binder], connector: &Ident) -> Option<SymbolKind<'a>> {
        let labels = self.labelled(indices, &Place::new(scope, Site::Dynamics), "ports")?;
        let mut list = Vec::with_capacity(labels.len());
        for (label, _) in labels {
            let port = self.declare_port(scope, format!("{path}[{label}]"), connector)?;
            list.push((label, port));
        }
        Some(SymbolKind::Instances(Row::new(list, indices.len()).into()))
    }

    /// Instances of a component: one, or one for each member of a set.
    fn declare_instance(
        &mut self,
        scope: ScopeId,
        component: &'a Ident,
        name: &'a Ident,
        indices: &'a [Binder],
        arguments: &'a [(Ident, Expr)],
        depth: usize,
    ) {
        let Some(statement) = self.instantiable(scope, component, depth) else { return self.faulty(scope, name) };
        let place = Place::new(scope, Site::Dynamics);
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, name.text);
        let kind = match indices {
            [] => Some(SymbolKind::Instance(self.instantiate(statement, &path, name.span, arguments, &place, depth))),
            indices => self.row_of_instances(statement, (&path, name.span), indices, arguments, &place, depth),
        };
        self.declare(scope, name, kind.unwrap_or(SymbolKind::Faulty));
    }

    /// An instance for each member of a set, or for each combination of members; `None`, and a
    /// report, if they are too many or not counted by a set.
    fn row_of_instances(
        &mut self,
        statement: &'a Statement,
        (path, used): (&str, Span),
        indices: &'a [Binder],
        arguments: &'a [(Ident, Expr)],
        place: &Place,
        depth: usize,
    ) -> Option<SymbolKind<'a>> {
        let mut list = Vec::new();
        for (label, inner_place) in self.labelled(indices, place, "instances")? {
            if self.instances.made > MAX_INSTANTIATED {
                return None;
            }
            if !self.instances.samples.may_instantiate(depth) {
                break;
            }
            let inner = self.instantiate(statement, &format!("{path}[{label}]"), used, arguments, &inner_place, depth);
            list.push((label, inner));
        }
        Some(SymbolKind::Instances(Row::new(list, indices.len()).into()))
    }

    /// The label of each combination of index members, with the place at which they are bound.
    fn labelled(&mut self, indices: &[Binder], place: &Place, what: &str) -> Option<Vec<(String, Place)>> {
        let mut out = vec![(String::new(), place.clone())];
        for binder in indices {
            let mut next = Vec::new();
            for (before, outer) in out {
                for value in binders::bindings_of(&mut self.lowering(), binder, &outer) {
                    let BinderValue::One(bound) = value else {
                        let message = format!("{what} are counted by a set");
                        self.work.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, binder.span));
                        return None;
                    };
                    let label = match &bound {
                        Bound::Member(set, i) => self.symbols.sets[*set].labels[*i].clone(),
                        Bound::Number(e) => self.work.exprs.as_const(*e).map_or_else(String::new, |x| x.to_string()),
                        _ => continue,
                    };
                    let label = if before.is_empty() { label } else { format!("{before},{label}") };
                    next.push((label, outer.bind(&binder.name.text, bound)));
                    if next.len() > MAX_INSTANTIATED {
                        let message = format!("more than {MAX_INSTANTIATED} {what}");
                        self.work.ledger.report(Diagnostic::error(codes::TOO_LARGE, message, binder.span));
                        return None;
                    }
                }
            }
            out = next;
        }
        Some(out)
    }

    /// Declares what an instance holds, in a new scope.
    pub(in crate::elaborate::declare) fn instantiate(
        &mut self,
        statement: &'a Statement,
        path: &str,
        used: Span,
        arguments: &'a [(Ident, Expr)],
        outer: &Place,
        depth: usize,
    ) -> ScopeId {
        let root = ScopeId::from_u32(0);
        let scope = self.symbols.scopes.push(Scope { prefix: format!("{path}."), parent: Some(root), names: Default::default() });
        self.instances.used_at.insert(scope, used);
        let StatementKind::Component { name, .. } = &statement.kind else { return scope };
        let Lineage { parameters, bodies } = self.lineage(statement);
        for (parameter, default) in parameters.iter().copied() {
            self.work.ledger.warn_of_name(parameter);
            let given = arguments.iter().find(|(a, _)| a.text == parameter.text).map(|(_, e)| e);
            if self.instances.samples.taken() && given.is_none() && default.is_none() {
                let kind = self.symbols.sampled(scope, parameter, &bodies);
                self.declare(scope, parameter, kind);
                continue;
            }
            self.structural(scope, (path, used), parameter, (given, default.as_ref()), (outer, depth));
        }
        let selection = self.selection_of(scope, &parameters);
        let mut list = Vec::new();
        for body in bodies {
            let own = items(body, &selection);
            if list.is_empty() { list = own } else { overlay(&mut list, own) }
        }
        self.note_given(scope, (name, &parameters), &list, arguments, outer);
        if self.may_instantiate(list.len(), used) {
            self.instances.open.push(&name.text);
            self.declare_block(scope, list, depth + 1);
            self.instances.open.pop();
        }
        scope
    }

    /// Options of an instance: those of the model, and its own switches.
    fn selection_of(&self, scope: ScopeId, parameters: &[&(Ident, Option<Expr>)]) -> Selection {
        let mut selection = self.input.selection.clone();
        for (parameter, _) in parameters {
            let symbol = self.symbols.scopes[scope].names.get(&parameter.text);
            if let Some(SymbolKind::Truth(holds)) = symbol.map(|&symbol| &self.symbols[symbol].kind) {
                selection.chosen.insert(parameter.text.clone(), holds.to_string());
            }
        }
        selection
    }

    /// Declares what components see of the file, and one instance of each.
    pub(in crate::elaborate) fn declare_samples(&mut self, components: &[&'a Statement]) {
        self.instances.samples.instances = Some(0);
        let root = self.declare_seen();
        let place = Place::new(root, Site::Dynamics);
        for statement in components {
            let StatementKind::Component { name, .. } = &statement.kind else { continue };
            self.instantiate(statement, &name.text, name.span, &[], &place, 0);
        }
        self.declare_regular();
    }
}
