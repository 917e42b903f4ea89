//! First pass over the trees: the symbols that statements declare.

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, BinderSet, Declaration, Ident, Observation, PortName, Role, SetMembers, Statement, StatementKind, Table};

use crate::symbols::{Site, Symbol, SymbolId, SymbolKind, Symbols};

/// Declares symbols.
pub(crate) struct Declarer<'s> {
    pub(crate) symbols: &'s mut Symbols,
}

/// A declaration of a name.
pub(crate) fn site(name: &Ident, declaration: Span) -> Site {
    Site { name: name.span, declaration }
}

impl Declarer<'_> {
    /// Sets come first, since a table over an undeclared name declares a set.
    pub(crate) fn sets(&mut self, statements: &[Statement], within: Option<SymbolId>) {
        for statement in statements {
            match &statement.kind {
                StatementKind::Set { name, members, text, .. } => {
                    let mut symbol = Symbol::new(&name.text, SymbolKind::Set, within, site(name, statement.span));
                    symbol.text = text.clone();
                    let set = self.symbols.declare(symbol);
                    if let SetMembers::Names(names) = members {
                        self.members(set, names.iter());
                    }
                }
                StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => self.sets(body, within),
                _ => {}
            }
        }
    }

    fn members<'i>(&mut self, set: SymbolId, names: impl Iterator<Item = &'i Ident>) {
        for name in names {
            self.symbols.declare(Symbol::new(&name.text, SymbolKind::Member, Some(set), site(name, name.span)));
        }
    }

    /// Declares what statements declare, in a component or at the level of the file.
    pub(crate) fn statements(&mut self, statements: &[Statement], within: Option<SymbolId>) {
        for statement in statements {
            self.statement(statement, within);
        }
    }

    fn statement(&mut self, statement: &Statement, within: Option<SymbolId>) {
        let at = statement.span;
        let named = |name: &Ident, kind: SymbolKind, text: &Option<String>| {
            let mut symbol = Symbol::new(&name.text, kind, within, site(name, at));
            symbol.text = text.clone();
            symbol
        };
        let symbol = match &statement.kind {
            StatementKind::Model { name, text } => named(name, SymbolKind::Model, text),
            StatementKind::Time { name, unit } => Symbol { unit: Some(unit.clone()), ..named(name, SymbolKind::Time, &None) },
            StatementKind::Unit { name, size, text } => {
                let value = size.as_ref().map(|e| e.span);
                self.symbols.declare(Symbol { value, ..named(name, SymbolKind::Unit, text) });
                return;
            }
            StatementKind::Table(table) => return self.table(table, within, at),
            StatementKind::TimeTable(table) => {
                let arguments = ["x", "y"].iter().take(1 + usize::from(table.second_unit.is_some())).map(ToString::to_string).collect();
                Symbol { unit: table.unit.clone(), arguments, ..named(&table.name, SymbolKind::TimeTable, &table.text) }
            }
            StatementKind::Def { name, parameters, body, .. } => {
                let arguments = parameters.iter().map(|p| p.name.text.clone()).collect();
                Symbol { arguments, value: Some(body.span), ..named(name, SymbolKind::Function, &None) }
            }
            StatementKind::Declare { role, declarations } => {
                let kind = SymbolKind::Variable(*role);
                return declarations.iter().for_each(|d| self.declaration(d, kind, within));
            }
            StatementKind::Reaction(reaction) => {
                return self.declaration(&reaction.declaration, SymbolKind::Variable(Role::Let), within);
            }
            StatementKind::Domain(domain) => {
                let bounds = Some((domain.range.0.span, domain.range.1.span));
                Symbol { bounds, ..named(&domain.name, SymbolKind::Domain, &domain.text) }
            }
            StatementKind::Flux(flux) => {
                let indices = flux.indices.iter().map(set_of).collect();
                let value = Some(flux.inner.span);
                Symbol { unit: flux.unit.clone(), indices, value, ..named(&flux.name, SymbolKind::Flux, &None) }
            }
            StatementKind::Connector { name, members, .. } => {
                let connector = self.symbols.declare(named(name, SymbolKind::Connector, &None));
                let kind = SymbolKind::Variable(Role::Var);
                return members.iter().for_each(|d| self.declaration(d, kind, Some(connector)));
            }
            StatementKind::Component { name, parameters, extends, text, body } => {
                let arguments = parameters.iter().map(|(p, _)| p.text.clone()).collect();
                let of = extends.as_ref().map(|base| base.text.clone());
                let component = self.symbols.declare(Symbol { arguments, of, ..named(name, SymbolKind::Component, text) });
                for (parameter, value) in parameters {
                    let mut symbol = Symbol::new(&parameter.text, SymbolKind::Structural, Some(component), site(parameter, parameter.span));
                    symbol.value = value.as_ref().map(|e| e.span);
                    self.symbols.declare(symbol);
                }
                self.sets(body, Some(component));
                return self.statements(body, Some(component));
            }
            StatementKind::Port { names, connector } => {
                for PortName { name, indices } in names {
                    let indices = indices.iter().map(set_of).collect();
                    let mut symbol = Symbol { indices, ..named(name, SymbolKind::Port, &None) };
                    symbol.of = Some(connector.text.clone());
                    self.symbols.declare(symbol);
                }
                return;
            }
            StatementKind::Instance { component, name, indices, .. } => {
                let indices = indices.iter().map(set_of).collect();
                Symbol { of: Some(component.text.clone()), indices, ..named(name, SymbolKind::Instance, &None) }
            }
            StatementKind::Observe { items } => return items.iter().for_each(|item| self.observation(item, within)),
            StatementKind::Level { name, text, body, .. } => {
                self.symbols.declare(named(name, SymbolKind::Level, text));
                return self.statements(body, within);
            }
            StatementKind::Reward { name, unit, text, .. } => Symbol { unit: unit.clone(), ..named(name, SymbolKind::Reward, text) },
            StatementKind::Fail { name, text, .. } => named(name, SymbolKind::Failure, text),
            StatementKind::Success { name, text, .. } => named(name, SymbolKind::Success, text),
            StatementKind::Constraint { name, text, .. } => named(name, SymbolKind::Constraint, text),
            StatementKind::Invariant { name, text, .. } => named(name, SymbolKind::Invariant, text),
            StatementKind::Policy { name, .. } => named(name, SymbolKind::Policy, &None),
            StatementKind::Event { name, text, .. } => named(name, SymbolKind::Event, text),
            StatementKind::Phase(phase) => named(&phase.name, SymbolKind::Phase, &None),
            StatementKind::Variant { name, text, body, .. } => {
                self.symbols.declare(named(name, SymbolKind::Variant, text));
                return self.statements(body, within);
            }
            StatementKind::Choice { name, options, text } => {
                let choice = self.symbols.declare(named(name, SymbolKind::Choice, text));
                for option in options {
                    self.symbols.declare(Symbol::new(&option.text, SymbolKind::Choose, Some(choice), site(option, option.span)));
                }
                return;
            }
            StatementKind::Test { name, name_span, .. } => named(&Ident { text: name.clone(), span: *name_span }, SymbolKind::Test, &None),
            StatementKind::When { body, .. } => return self.statements(body, within),
            StatementKind::Import { .. }
            | StatementKind::Set { .. }
            | StatementKind::Equation { .. }
            | StatementKind::Connect { .. }
            | StatementKind::Initial { .. }
            | StatementKind::StartEquation { .. }
            | StatementKind::StartSteady { .. }
            | StatementKind::Steady { .. }
            | StatementKind::Episode { .. }
            | StatementKind::Solver { .. }
            | StatementKind::At { .. }
            | StatementKind::Next { .. }
            | StatementKind::Reset { .. }
            | StatementKind::Clamp { .. }
            | StatementKind::Control(_)
            | StatementKind::Remove { .. }
            | StatementKind::TestStep(_) => return,
        };
        self.symbols.declare(symbol);
    }

    fn declaration(&mut self, d: &Declaration, kind: SymbolKind, within: Option<SymbolId>) {
        let mut symbol = Symbol::new(&d.name.text, kind, within, site(&d.name, d.span));
        symbol.unit = d.unit.clone();
        symbol.text = d.text.clone();
        symbol.indices = d.indices.iter().map(set_of).collect();
        symbol.value = d.value.as_ref().or(d.sample.as_ref()).map(|e| e.span);
        symbol.bounds = d.bounds.as_ref().map(|(low, high)| (low.span, high.span));
        self.symbols.declare(symbol);
    }

    fn observation(&mut self, item: &Observation, within: Option<SymbolId>) {
        let Some(name) = item.name.as_ref().filter(|name| name.span != item.value.span) else { return };
        let mut symbol = Symbol::new(&name.text, SymbolKind::Observation, within, site(name, item.span));
        symbol.unit = item.unit.clone();
        symbol.text = item.text.clone();
        self.symbols.declare(symbol);
    }

    fn table(&mut self, table: &Table, within: Option<SymbolId>, at: Span) {
        if let Some(set) = table.indices.first()
            && self.symbols.find(within, true, &set.text).or_else(|| self.symbols.find(None, true, &set.text)).is_none()
        {
            let set = self.symbols.declare(Symbol::new(&set.text, SymbolKind::Set, within, site(set, at)));
            self.members(set, table.rows.iter().map(|row| &row.label));
        }
        for column in &table.columns {
            let mut symbol = Symbol::new(&column.name.text, SymbolKind::Table, within, site(&column.name, at));
            symbol.unit = column.unit.clone();
            symbol.text = table.text.clone();
            symbol.indices = table.indices.iter().map(|set| set.text.clone()).collect();
            self.symbols.declare(symbol);
        }
    }
}

/// The set or domain of a binder.
fn set_of(binder: &Binder) -> String {
    match &binder.over {
        BinderSet::Set(set) => set.text.clone(),
        BinderSet::Itself | BinderSet::Range(..) | BinderSet::Tuple(_) => binder.name.text.clone(),
    }
}
