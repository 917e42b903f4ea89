//! Occurrences of symbols: every name of the trees with what it means.

mod parts;

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{
    BY_MEMBER, Binder, BinderSet, Clip, Declaration, Expr, ExprKind, File, Ident, Observation, SetMembers, Statement, StatementKind, Table,
    TableCells, UnitBase, UnitExpr,
};
use smpl_dsl::units::OwnUnits;

use crate::declare::{Declarer, site};
use crate::symbols::{Symbol, SymbolId, SymbolKind, Symbols};

/// A place where a symbol is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Occurrence {
    /// The name.
    pub span: Span,
    /// The symbol.
    pub symbol: SymbolId,
    /// The name is declared here.
    pub declares: bool,
}

/// An equation, a definition or a connection.
#[derive(Clone, Debug)]
pub struct EquationUse {
    /// The statement.
    pub span: Span,
    /// The symbol on the left side alone, or under `d/dt`.
    pub determines: Option<SymbolId>,
    /// Symbols that it mentions.
    pub mentions: Vec<SymbolId>,
}

/// Meanings of the names of trees.
#[derive(Clone, Debug, Default)]
pub(crate) struct Resolved {
    /// Symbols.
    pub symbols: Symbols,
    /// Their occurrences, by place.
    pub occurrences: Vec<Occurrence>,
    /// Equations in the order of the text.
    pub equations: Vec<EquationUse>,
    /// Names of functions that are called and unit symbols: built in, not declared.
    pub built_in: Vec<(Span, BuiltIn)>,
    /// Names that mean nothing.
    pub unknown: Vec<Span>,
}

/// Kinds of names that are not declared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuiltIn {
    /// A function or a name such as `pi`.
    Name,
    /// A unit symbol.
    Unit,
}

/// Resolves the names of all files of a program.
pub(crate) fn resolve(files: &[&File]) -> Resolved {
    let mut out = Resolved::default();
    for file in files {
        Declarer { symbols: &mut out.symbols }.sets(&file.statements, None);
    }
    for file in files {
        Declarer { symbols: &mut out.symbols }.statements(&file.statements, None);
    }
    let kinds = files.iter().flat_map(|file| &file.statements).map(|statement| &statement.kind);
    out.symbols.set_own_units(OwnUnits::declared(kinds).0);
    for file in files {
        Resolver { out: &mut out, within: None, locals: Vec::new() }.statements(&file.statements);
    }
    let places: Vec<(SymbolId, Span)> =
        out.symbols.iter().flat_map(|(id, symbol)| symbol.sites.iter().map(move |site| (id, site.name))).collect();
    out.occurrences.extend(places.into_iter().map(|(symbol, span)| Occurrence { span, symbol, declares: true }));
    out.occurrences.sort_by_key(|o| (o.span.file, o.span.start, !o.declares));
    out.occurrences.dedup_by_key(|o| o.span);
    out.built_in.sort_by_key(|(span, _)| (span.file, span.start));
    out
}

/// Resolves names.
struct Resolver<'o> {
    out: &'o mut Resolved,
    within: Option<SymbolId>,
    /// Indices and arguments in force, the innermost last.
    locals: Vec<SymbolId>,
}

impl Resolver<'_> {
    fn statements(&mut self, statements: &[Statement]) {
        for statement in statements {
            let locals = self.locals.len();
            self.statement(statement);
            self.locals.truncate(locals);
        }
    }

    fn use_of(&mut self, span: Span, symbol: SymbolId) {
        self.out.occurrences.push(Occurrence { span, symbol, declares: false });
    }

    /// A name in an expression, by scope.
    fn find(&self, name: &str) -> Option<SymbolId> {
        let local = self.locals.iter().rev().find(|id| self.out.symbols.get(**id).name == name).copied();
        local.or_else(|| self.out.symbols.lookup(self.within, name)).or_else(|| self.member_of_any(name))
    }

    /// A member of a set, where no name is declared.
    fn member_of_any(&self, name: &str) -> Option<SymbolId> {
        let sets = self.out.symbols.iter().filter(|(_, s)| matches!(s.kind, SymbolKind::Set | SymbolKind::Choice));
        sets.map(|(set, _)| set).find_map(|set| self.out.symbols.find(Some(set), true, name))
    }

    fn name(&mut self, name: &Ident) -> Option<SymbolId> {
        let found = self.find(&name.text);
        match found {
            Some(symbol) => self.use_of(name.span, symbol),
            None => self.undeclared(name),
        }
        found
    }

    fn undeclared(&mut self, name: &Ident) {
        // Reactions declare these.
        let made = matches!(name.text.as_str(), "reactions" | "source" | "stoichiometry" | "default");
        if made || crate::reference::is_built_in(&name.text) {
            self.out.built_in.push((name.span, BuiltIn::Name));
        } else {
            self.out.unknown.push(name.span);
        }
    }

    /// A name of the file's level, such as a component's.
    fn global(&mut self, name: &Ident) -> Option<SymbolId> {
        let found = self.out.symbols.lookup(self.within, &name.text);
        match found {
            Some(symbol) => self.use_of(name.span, symbol),
            None => self.undeclared(name),
        }
        found
    }

    fn member(&mut self, scope: Option<SymbolId>, name: &Ident) -> Option<SymbolId> {
        let found = scope.and_then(|scope| self.out.symbols.find(Some(scope), true, &name.text));
        if let Some(symbol) = found {
            self.use_of(name.span, symbol);
        }
        found
    }

    fn statement(&mut self, statement: &Statement) {
        match &statement.kind {
            StatementKind::Model { .. } | StatementKind::Import { .. } | StatementKind::Choice { .. } => {}
            StatementKind::Time { unit, .. } => self.unit(unit),
            StatementKind::Unit { size, .. } => size.iter().for_each(|size| {
                self.expr(size);
            }),
            StatementKind::Set { members, .. } => match members {
                SetMembers::Range(low, high) => self.exprs([low, high]),
                SetMembers::Of(e) => self.exprs([e]),
                SetMembers::Names(_) => {}
            },
            StatementKind::Table(table) => self.table(table),
            StatementKind::TimeTable(table) => {
                self.table_of_quantities(table);
            }
            StatementKind::Def { parameters, locals, body, .. } => self.function(parameters, locals, body),
            StatementKind::Declare { declarations, .. } => declarations.iter().for_each(|d| self.declaration(d)),
            StatementKind::Equation { lhs, rhs, binders } => self.equation(statement.span, lhs, rhs, binders),
            StatementKind::Domain(domain) => {
                self.exprs([&domain.range.0, &domain.range.1, &domain.cells]);
                [&domain.stretch, &domain.faces, &domain.volumes, &domain.areas].into_iter().flatten().for_each(|e| {
                    self.expr(e);
                });
            }
            StatementKind::Flux(flux) => {
                self.binders(&flux.indices);
                flux.unit.iter().for_each(|unit| self.unit(unit));
                [Some(&flux.inner), flux.low.as_ref(), flux.high.as_ref()].into_iter().flatten().for_each(|e| {
                    self.expr(e);
                });
            }
            StatementKind::Reaction(reaction) => self.reaction(reaction),
            StatementKind::Connector { members, .. } => members.iter().for_each(|d| self.declaration(d)),
            StatementKind::Component { name, parameters, extends, body, .. } => {
                extends.iter().for_each(|base| {
                    self.global(base);
                });
                parameters.iter().filter_map(|(_, value)| value.as_ref()).for_each(|e| {
                    self.expr(e);
                });
                let outer = std::mem::replace(&mut self.within, self.out.symbols.find(None, true, &name.text));
                self.statements(body);
                self.within = outer;
            }
            StatementKind::Port { connector, names } => {
                names.iter().for_each(|port| self.binders(&port.indices));
                self.global(connector);
            }
            StatementKind::Instance { component, indices, arguments, .. } => {
                let component = self.global(component);
                self.binders(indices);
                for (name, value) in arguments {
                    self.member(component, name);
                    self.expr(value);
                }
            }
            StatementKind::Connect { chain, binders } => {
                let before = self.out.occurrences.len();
                self.binders(binders);
                self.exprs(chain);
                self.note_equation(statement.span, None, before);
            }
            StatementKind::Initial { .. }
            | StatementKind::StartEquation { .. }
            | StatementKind::StartSteady { .. }
            | StatementKind::Steady { .. }
            | StatementKind::Observe { .. }
            | StatementKind::Level { .. }
            | StatementKind::Reward { .. }
            | StatementKind::Fail { .. }
            | StatementKind::Success { .. }
            | StatementKind::Constraint { .. }
            | StatementKind::Invariant { .. }
            | StatementKind::Episode { .. }
            | StatementKind::Solver { .. }
            | StatementKind::Policy { .. }
            | StatementKind::At { .. }
            | StatementKind::Control(_)
            | StatementKind::Remove { .. }
            | StatementKind::Next { .. }
            | StatementKind::Reset { .. }
            | StatementKind::Clamp { .. }
            | StatementKind::Event { .. }
            | StatementKind::Phase(_)
            | StatementKind::Test { .. }
            | StatementKind::TestStep(_)
            | StatementKind::Variant { .. }
            | StatementKind::When { .. } => self.problem(statement),
        }
    }

    /// Statements of the control problem and of alternatives.
    fn problem(&mut self, statement: &Statement) {
        match &statement.kind {
            StatementKind::Initial { target, value, clip, binders, .. } => {
                self.binders(binders);
                self.exprs([target, value]);
                self.clip(clip.as_ref());
            }
            StatementKind::StartEquation { lhs, rhs, free, binders } => {
                self.binders(binders);
                self.exprs([lhs, rhs]);
                self.exprs(free);
            }
            StatementKind::StartSteady { targets } => self.exprs(targets),
            StatementKind::Steady { entries, free } => {
                entries.iter().for_each(|(target, value)| self.exprs([target, value]));
                self.exprs(free);
            }
            StatementKind::Policy { entries, .. } => {
                entries.iter().for_each(|(target, value)| self.exprs([target, value]));
            }
            StatementKind::Observe { items } => items.iter().for_each(|item| self.observation(item)),
            StatementKind::Reward { value, unit, .. } => {
                unit.iter().for_each(|unit| self.unit(unit));
                self.expr(value);
            }
            StatementKind::Fail { condition, .. }
            | StatementKind::Success { condition, .. }
            | StatementKind::Constraint { condition, .. }
            | StatementKind::Event { condition, .. } => {
                self.expr(condition);
            }
            StatementKind::Invariant { value, rate, .. } => self.exprs([Some(value), rate.as_ref()].into_iter().flatten()),
            StatementKind::Episode { entries } | StatementKind::Solver { entries } => {
                // Names of methods and the like are words of the place.
                let values = entries.iter().map(|(_, value)| value);
                values.filter(|value| !matches!(value.kind, ExprKind::Name(_))).for_each(|value| {
                    self.expr(value);
                });
            }
            StatementKind::At { instant, every, body } => {
                if every.is_none() && !matches!(instant.text.as_str(), "start" | "end") {
                    self.global(instant);
                }
                self.exprs(every);
                self.statements(body);
            }
            StatementKind::Next { target, value, binders } | StatementKind::Reset { target, value, binders } => {
                self.binders(binders);
                self.exprs([target, value]);
            }
            StatementKind::Control(control) => {
                self.binders(&control.binders);
                self.exprs(control.expressions());
            }
            StatementKind::Clamp { target, value, condition, binders } => {
                self.binders(binders);
                self.exprs([target, value, condition]);
            }
            StatementKind::Phase(phase) => {
                self.exprs([&phase.duration, &phase.until].into_iter().flatten());
                if let Some(next) = &phase.next {
                    self.global(next);
                }
                self.statements(&phase.body);
            }
            StatementKind::When { choice, option, body } => {
                let choice = self.global(choice);
                self.member(choice, option);
                self.statements(body);
            }
            StatementKind::Test { body, .. } => self.statements(body),
            StatementKind::Variant { body, extends, .. } | StatementKind::Level { body, extends, .. } => {
                // The level `default` is declared by what the file observes.
                extends.iter().filter(|base| base.text != "default").for_each(|base| {
                    self.global(base);
                });
                self.statements(body);
            }
            StatementKind::Remove { kind, target } => {
                let is_end = matches!(&target.kind, ExprKind::Name(name) if matches!(name.text.as_str(), "start" | "end"));
                if !(is_end && kind.as_ref().is_some_and(|kind| kind.text == "at")) {
                    self.expr(target);
                }
            }
            StatementKind::TestStep(step) => self.test_step(step),
            StatementKind::Model { .. }
            | StatementKind::Import { .. }
            | StatementKind::Time { .. }
            | StatementKind::Unit { .. }
            | StatementKind::Set { .. }
            | StatementKind::Table(_)
            | StatementKind::TimeTable(_)
            | StatementKind::Def { .. }
            | StatementKind::Declare { .. }
            | StatementKind::Equation { .. }
            | StatementKind::Domain(_)
            | StatementKind::Flux(_)
            | StatementKind::Reaction(_)
            | StatementKind::Connector { .. }
            | StatementKind::Component { .. }
            | StatementKind::Port { .. }
            | StatementKind::Instance { .. }
            | StatementKind::Connect { .. }
            | StatementKind::Choice { .. } => {}
        }
    }

    fn equation(&mut self, span: Span, lhs: &Expr, rhs: &Expr, binders: &[Binder]) {
        let before = self.out.occurrences.len();
        self.binders(binders);
        let left = match &lhs.kind {
            ExprKind::Derivative(inner) => self.expr(inner),
            _ => self.expr(lhs),
        };
        self.expr(rhs);
        self.note_equation(span, left, before);
    }

    fn note_equation(&mut self, span: Span, determines: Option<SymbolId>, before: usize) {
        let mut mentions: Vec<SymbolId> = self.out.occurrences[before..].iter().map(|o| o.symbol).collect();
        mentions.sort_unstable();
        mentions.dedup();
        self.out.equations.push(EquationUse { span, determines, mentions });
    }

    fn table(&mut self, table: &Table) {
        let sets: Vec<Option<SymbolId>> = table.indices.iter().map(|set| self.global(set)).collect();
        table.columns.iter().filter_map(|c| c.unit.as_ref()).for_each(|unit| self.unit(unit));
        table.default.iter().for_each(|e| {
            self.expr(e);
        });
        for row in &table.rows {
            self.member(sets.first().copied().flatten(), &row.label);
            match &row.cells {
                TableCells::Values(cells) => self.exprs(cells),
                TableCells::Sparse(cells) => {
                    for (member, value) in cells {
                        self.member(sets.get(1).copied().flatten(), member);
                        self.expr(value);
                    }
                }
            }
        }
    }

    fn declaration(&mut self, d: &Declaration) {
        let locals = self.locals.len();
        let before = self.out.occurrences.len();
        self.binders(&d.indices);
        d.unit.iter().for_each(|unit| self.unit(unit));
        self.exprs([&d.value, &d.sample, &d.scale].into_iter().flatten());
        if let Some((low, high)) = &d.bounds {
            self.exprs([low, high]);
        }
        self.clip(d.clip.as_ref());
        if d.value.is_some() && self.out.occurrences.len() > before {
            let name = self.out.symbols.find(self.within, true, &d.name.text);
            if name.is_some_and(|id| self.out.symbols.get(id).kind == SymbolKind::Variable(smpl_dsl::syntax::Role::Let)) {
                self.note_equation(d.span, name, before);
            }
        }
        self.locals.truncate(locals);
    }

    fn clip(&mut self, clip: Option<&Clip>) {
        if let Some(Clip::Range(low, high)) = clip {
            self.exprs([low, high]);
        }
    }

    fn observation(&mut self, item: &Observation) {
        let locals = self.locals.len();
        self.binders(&item.binders);
        item.unit.iter().for_each(|unit| self.unit(unit));
        self.expr(&item.value);
        self.exprs([&item.noise, &item.every, &item.delay].into_iter().flatten());
        if let Some((low, high)) = &item.bounds {
            self.exprs([low, high]);
        }
        self.locals.truncate(locals);
    }

    /// Binds indices. An index named as its set is the set itself.
    fn binders(&mut self, binders: &[Binder]) {
        for binder in binders {
            match &binder.over {
                BinderSet::Itself => {
                    self.global(&binder.name);
                }
                BinderSet::Set(set) => {
                    self.global(set);
                    self.local(&binder.name, SymbolKind::Index, Some(set.text.clone()));
                }
                BinderSet::Range(low, high) => {
                    self.exprs([&**low, &**high]);
                    match self.out.symbols.lookup(self.within, &binder.name.text) {
                        Some(domain) if self.out.symbols.get(domain).kind == SymbolKind::Domain => self.use_of(binder.name.span, domain),
                        _ => self.local(&binder.name, SymbolKind::Index, None),
                    }
                }
                BinderSet::Tuple(list) => {
                    self.exprs(list);
                    self.local(&binder.name, SymbolKind::Index, None);
                }
            }
            self.exprs(binder.condition.as_deref());
        }
    }

    fn local(&mut self, name: &Ident, kind: SymbolKind, of: Option<String>) {
        let mut symbol = Symbol::new(&name.text, kind, self.within, site(name, name.span));
        symbol.of = of;
        let id = self.out.symbols.add(symbol);
        self.locals.push(id);
    }

    fn exprs<'e>(&mut self, list: impl IntoIterator<Item = &'e Expr>) {
        for e in list {
            self.expr(e);
        }
    }

    /// Resolves the names of an expression; the symbol that it names, for members and indices.
    fn expr(&mut self, e: &Expr) -> Option<SymbolId> {
        match &e.kind {
            ExprKind::Number { unit, .. } => unit.iter().for_each(|unit| self.unit(unit)),
            ExprKind::Bool(_) => {}
            ExprKind::Name(name) => return self.name(name),
            ExprKind::Member(base, member) => {
                let base = self.expr(base)?;
                let scope = self.out.symbols.scope_of(base);
                return self.member(scope, member);
            }
            ExprKind::Index(base, list) => {
                let base = self.expr(base);
                let sets = base.map(|id| self.out.symbols.get(id).indices.clone()).unwrap_or_default();
                list.iter().enumerate().for_each(|(i, index)| self.index(index, sets.get(i).map(String::as_str)));
                return base;
            }
            ExprKind::Call { function, arguments } => {
                match self.find(&function.text) {
                    Some(symbol) => self.use_of(function.span, symbol),
                    // Special forms, without a function's name.
                    None if matches!(function.text.as_str(), "in" | BY_MEMBER) => {}
                    None => self.undeclared(function),
                }
                self.exprs(arguments);
            }
            ExprKind::Reduce { function, body, binders, condition } => {
                self.undeclared(function);
                let locals = self.locals.len();
                self.binders(binders);
                self.expr(body);
                condition.iter().for_each(|e| {
                    self.expr(e);
                });
                self.locals.truncate(locals);
            }
            ExprKind::Derivative(inner) | ExprKind::Unary(_, inner) => {
                self.expr(inner);
            }
            ExprKind::As(inner, unit) => {
                self.expr(inner);
                self.unit(unit);
            }
            ExprKind::Binary(_, a, b) => self.exprs([&**a, &**b]),
            ExprKind::If(c, a, b) => self.exprs([&**c, &**a, &**b]),
            ExprKind::Tuple(list) => self.exprs(list),
        }
        None
    }

    /// An index: a bound name, a member of the array's set, or an expression.
    fn index(&mut self, e: &Expr, set: Option<&str>) {
        if let (ExprKind::Name(name), Some(set)) = (&e.kind, set) {
            let is_local = self.locals.iter().any(|id| self.out.symbols.get(*id).name == name.text);
            let set = self.out.symbols.lookup(self.within, set);
            if !is_local && self.member(set, name).is_some() {
                return;
            }
        }
        self.expr(e);
    }

    fn unit(&mut self, unit: &UnitExpr) {
        for factor in &unit.factors {
            match &factor.base {
                UnitBase::Symbol(symbol) => match self.out.symbols.unit(&symbol.text) {
                    Some(unit) => self.use_of(symbol.span, unit),
                    None => self.out.built_in.push((symbol.span, BuiltIn::Unit)),
                },
                UnitBase::Of(e) => {
                    self.expr(e);
                }
                UnitBase::Number(..) => {}
            }
        }
    }
}
