//! Declarations of sets, domains, fluxes and variables.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{self, Declaration, Expr, ExprKind, Flux, Ident, Measured, SetMembers, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::declaring::{Declaring, MAX_ELEMENTS};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{structural, units};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{Axis, Domain, DomainId, Geometry, Scheme, ScopeId, SymbolKind};
use crate::ir::Role;

/// When a set is declared.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::elaborate::declare) enum Turn {
    /// Ahead of everything: its members are written.
    Named,
    /// After the scalars: its ends may be computed from them.
    Ranges,
    /// Once the sets are known of whose members it consists.
    Derived,
    /// After all other sets: the rows of a table are a set where there is no other of that name.
    Tables,
}

impl Turn {
    fn of(statement: &Statement) -> Turn {
        match &statement.kind {
            StatementKind::Set { members: SetMembers::Range(..), .. } => Turn::Ranges,
            StatementKind::Set { members: SetMembers::Of(e), .. } if !matches!(e.kind, ExprKind::Tuple(_)) => Turn::Derived,
            StatementKind::Table(_) => Turn::Tables,
            _ => Turn::Named,
        }
    }
}

impl<'a> Declaring<'_, 'a> {
    /// Declares the sets whose turn it is.
    pub(in crate::elaborate::declare) fn declare_sets(&mut self, scope: ScopeId, list: &[Item<'a>], turn: Turn) {
        for item in list {
            if let Item::Other(statement) = item
                && Turn::of(statement) == turn
            {
                self.declare_set(scope, statement);
            }
        }
    }

    pub(in crate::elaborate::declare) fn declare_flux(&mut self, scope: ScopeId, flux: &'a Flux) {
        let place = Place::new(scope, Site::Dynamics);
        let Some((axes, binders)) = self.axes(&flux.indices, &place) else { return self.faulty(scope, &flux.name) };
        if let Some(&Axis::Domain(domain)) = axes.last() {
            self.check_ends(flux, domain);
            self.declare(scope, &flux.name, SymbolKind::Flux { flux, axes: axes.into(), binders: binders.into() });
            return;
        }
        let message = format!("the last index of the flux `{}` must be the domain along which it flows", flux.name.text);
        self.work.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, message, flux.name.span));
        self.faulty(scope, &flux.name);
    }

    /// Reports fluxes given at the ends of a periodic domain, which has none.
    fn check_ends(&mut self, flux: &Flux, domain: DomainId) {
        let domain = &self.symbols.domains[domain];
        let Some(word) = domain.declaration.periodic else { return };
        for (side, e) in [("low", &flux.low), ("high", &flux.high)] {
            let Some(e) = e else { continue };
            let message = format!("`{}` is periodic and has no end where `{}` could be given", domain.name, flux.name.text);
            let fault = Diagnostic::error(codes::WRONG_KIND, message, e.span).secondary(word, "declared here");
            self.work.ledger.report(fault.help(format!("remove `{side} = ...`, or `periodic` from the domain")));
        }
    }

    fn declare_set(&mut self, scope: ScopeId, statement: &'a Statement) {
        match &statement.kind {
            StatementKind::Choice { name, options, .. } => {
                self.work.ledger.check_members("choice", options);
                let chosen = self.input.selection.chosen.get(&name.text).and_then(|c| options.iter().position(|o| o.text == *c));
                self.declare(scope, name, SymbolKind::Choice { options, chosen: chosen.unwrap_or(0) });
            }
            StatementKind::Set { name, members, formulas, .. } => {
                self.declare_members(scope, name, members);
                if let Some(SymbolKind::Set(set)) = self.symbols.lookup(scope, &name.text).map(|symbol| &self.symbols[symbol].kind) {
                    self.declare_formulas(*set, formulas);
                }
            }
            // `table over species { ... }` declares the set as well, unless it exists.
            StatementKind::Table(table) => {
                if let [index] = table.indices.as_slice()
                    && self.symbols.lookup(scope, &index.text).is_none()
                {
                    let labels = table.rows.iter().map(|r| r.label.text.clone()).collect();
                    self.new_set(scope, index, labels, None);
                }
            }
            _ => {}
        }
    }

    /// `set s = (a, b, c)`, `set s = 1..n`
    fn declare_members(&mut self, scope: ScopeId, name: &Ident, members: &'a SetMembers) {
        let (labels, first) = match members {
            SetMembers::Names(names) => (names.iter().map(|n| n.text.clone()).collect::<Vec<_>>(), None),
            SetMembers::Range(a, b) => {
                let Some((a, b)) = self.bounds_of_set(scope, name, a, b) else { return self.faulty(scope, name) };
                ((a..=b).map(|i| i.to_string()).collect(), Some(a))
            }
            SetMembers::Of(Expr { kind: ExprKind::Tuple(list), .. }) => {
                self.declare(scope, name, SymbolKind::Tuple(list));
                return;
            }
            SetMembers::Of(_) => return,
        };
        if labels.is_empty() {
            let message = format!("the set `{}` has no members", name.text);
            self.work.ledger.report(Diagnostic::error(codes::EMPTY_SET, message, name.span));
        }
        if let SetMembers::Names(names) = members {
            self.work.ledger.check_members("set", names);
        }
        self.new_set(scope, name, labels, first);
    }

    /// Declares the sets of members of other sets that are known so far; the `last` call reports
    /// names in the others that are not sets.
    pub(in crate::elaborate::declare) fn declare_derived(&mut self, scope: ScopeId, list: &[Item<'a>], last: bool) {
        let derived = |item: &Item<'a>| match item {
            Item::Other(Statement { kind: StatementKind::Set { name, members: SetMembers::Of(e), .. }, .. }) => Some((name, e)),
            _ => None,
        };
        let mut waiting: Vec<(&Ident, &Expr)> = list.iter().filter_map(derived).collect();
        waiting.retain(|(name, e)| !matches!(e.kind, ExprKind::Tuple(_)) && !self.symbols.scopes[scope].names.contains_key(&name.text));
        loop {
            let before = waiting.len();
            waiting.retain(|(name, e)| {
                let Some(labels) = self.symbols.labels_of(scope, e) else { return true };
                if labels.is_empty() {
                    let message = format!("the set `{}` has no members", name.text);
                    self.work.ledger.report(Diagnostic::error(codes::EMPTY_SET, message, name.span));
                }
                self.new_set(scope, name, labels, None);
                false
            });
            if waiting.len() == before {
                break;
            }
        }
        for (name, e) in waiting.into_iter().filter(|_| last) {
            let unknown = self.symbols.not_a_set(scope, e).unwrap_or(e);
            let message = format!("the set `{}` is made of sets, this is not one", name.text);
            let near = match &unknown.kind {
                ExprKind::Name(name) => self.work.ledger.reports.did_you_mean(&name.text, self.symbols.names_of_sets()),
                _ => None,
            };
            let help = near.unwrap_or_else(|| "write `{ a, b }`, `1..9`, `species - solids` or `(c_A, T)`".to_owned());
            self.work.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, message, unknown.span).help(help));
            self.faulty(scope, name);
        }
    }

    /// First and last number of a set, where they are not too far apart.
    fn bounds_of_set(&mut self, scope: ScopeId, name: &Ident, first: &Expr, last: &Expr) -> Option<(i64, i64)> {
        let place = Place::new(scope, Site::Dynamics);
        // Both are read, so that faults of both are reported.
        let (first, last) =
            (structural::integer(&mut self.lowering(), first, &place), structural::integer(&mut self.lowering(), last, &place));
        let (first, last) = (first?, last?);
        let more = last.saturating_sub(first);
        if more >= 100_000 || !self.work.ledger.budget.may_hold(more) {
            let message = "a set of more than a hundred thousand members, or sets of more than two million together";
            self.work.ledger.report(Diagnostic::error(codes::TOO_LARGE, message, name.span).help("use a `domain`: its cells stay a loop"));
            return None;
        }
        Some((first, last))
    }

    pub(in crate::elaborate::declare) fn declare_domain(&mut self, scope: ScopeId, domain: &'a syntax::Domain) {
        let place = Place::new(scope, Site::Dynamics);
        let Some(cells) = structural::integer(&mut self.lowering(), &domain.cells, &place) else { return self.faulty(scope, &domain.name) };
        if !(1..=MAX_ELEMENTS).contains(&cells) {
            let code = if cells < 1 { codes::EMPTY_SET } else { codes::TOO_LARGE };
            self.work.ledger.report(
                Diagnostic::error(code, format!("a domain of {cells} cells"), domain.cells.span).label("at least 1, at most 10 million"),
            );
            return self.faulty(scope, &domain.name);
        }
        let scheme = self.work.ledger.option(
            domain.scheme.as_ref(),
            "scheme",
            Scheme::Central,
            &[
                ("upwind", Scheme::Upwind),
                ("downwind", Scheme::Downwind),
                ("central", Scheme::Central),
                ("upwind2", Scheme::Upwind2),
                ("limited", Scheme::Limited),
            ],
        );
        let geometry = self.work.ledger.option(
            domain.geometry.as_ref(),
            "geometry",
            Geometry::Planar,
            &[("planar", Geometry::Planar), ("cylindrical", Geometry::Cylindrical), ("spherical", Geometry::Spherical)],
        );
        let id = self.symbols.domains.push(Domain { name: domain.name.text.clone(), scope, declaration: domain, cells, scheme, geometry });
        self.declare(scope, &domain.name, SymbolKind::Domain(id));
    }

    /// Declares a parameter, state, `let` and so on.
    pub(in crate::elaborate::declare) fn declare_variable(&mut self, scope: ScopeId, role: syntax::Role, d: &'a Declaration) {
        // Declared member by member: the first one was reported.
        let before = self.symbols.scopes[scope].names.get(&d.name.text);
        if !d.indices.is_empty() && before.is_some_and(|&s| matches!(self.symbols[s].kind, SymbolKind::Faulty)) {
            return;
        }
        if let Some(word) = d.nonnegative.filter(|_| role != syntax::Role::State) {
            let message = format!("`{}` is not a state, and only states can be `nonnegative`", d.name.text);
            let help = "remove the word; `in 0..high` declares bounds";
            self.work.ledger.report(Diagnostic::error(codes::NOT_NONNEGATIVE, message, word).help(help));
        }
        if let Some(word) = d.prefer.filter(|_| role != syntax::Role::State) {
            let message = format!("`{}` is not a state, and only states can be preferred as states", d.name.text);
            self.work.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, word).help("remove the word `prefer`"));
        }
        if let Some(sample) = d.sample.as_ref().filter(|_| !may_be_drawn(role)) {
            let message = format!("`{}` has no value at the start that `~` could draw", d.name.text);
            let help = "`~` draws a `param`, and the start of a `state` or `discrete`; a `disturbance` is drawn at each step";
            self.work.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, sample.span).help(help));
        }
        let place = Place::new(scope, Site::Dynamics);
        let Some((axes, binders)) = self.axes(&d.indices, &place) else { return self.faulty(scope, &d.name) };
        let written = d.unit.as_ref().map(|u| units::unit(&mut self.lowering(), u, &place));
        if matches!(written, Some(None)) {
            // The unit is invalid; the name is declared so that its uses cause no further report.
            return self.declare_poison(scope, role, d, axes, binders);
        }
        let unit = written.flatten();
        if let Some(measured) = &d.measured {
            return self.declare_input(scope, (role, d), measured, unit.unwrap_or_else(Unit::one));
        }
        let role = match role {
            syntax::Role::Let | syntax::Role::Random => {
                let random = role == syntax::Role::Random;
                let definition = if random { d.sample.as_ref().or(d.value.as_ref()) } else { d.value.as_ref() };
                let Some(definition) = definition else {
                    self.work.ledger.report(
                        Diagnostic::error(codes::MISSING_CLAUSE, format!("`{}` has no definition", d.name.text), d.span)
                            .help("write `= expression`, or declare a `var` and give it an equation"),
                    );
                    return self.faulty(scope, &d.name);
                };
                self.declare(
                    scope,
                    &d.name,
                    SymbolKind::Let { axes: axes.into(), binders: binders.into(), unit, definition, random, declaration: d },
                );
                return;
            }
            syntax::Role::Param => Role::Param,
            syntax::Role::Action => Role::Action,
            syntax::Role::State => Role::State,
            syntax::Role::Var => Role::Algebraic,
            syntax::Role::Discrete => Role::Discrete,
            syntax::Role::Disturbance => Role::Disturbance,
        };
        let unit = unit.unwrap_or_else(Unit::one);
        self.new_variable(scope, &d.name, role, axes, unit, d);
    }

    /// Declares a disturbance that follows data: an algebraic variable, whose equation reads them.
    fn declare_input(&mut self, scope: ScopeId, (role, d): (syntax::Role, &'a Declaration), measured: &'a Measured, unit: Unit) {
        let name = &d.name.text;
        let fault = match (role, &d.value.as_ref().or(d.sample.as_ref())) {
            (syntax::Role::Disturbance, _) if !d.indices.is_empty() => {
                Some((format!("the disturbance `{name}` follows one column of a file and has no indices"), d.name.span))
            }
            (syntax::Role::Disturbance, Some(e)) => {
                Some((format!("the disturbance `{name}` follows `{}` and has no other value", measured.path), e.span))
            }
            (syntax::Role::Disturbance, None) => None,
            _ => Some((format!("`{name}` is not a disturbance, and only disturbances follow a file"), measured.path_span)),
        };
        if let Some((message, span)) = fault {
            let help = "write `disturbance T : degC from \"weather.csv\" linear`, or a `table ... from` for other data";
            self.work.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, span).help(help));
            return self.faulty(scope, &d.name);
        }
        self.declare_measured(scope, d, measured, &unit);
        self.new_variable(scope, &d.name, Role::Algebraic, Vec::new(), unit, d);
    }
}

/// Returns `true` if declarations of a role may have a random value after `~`.
fn may_be_drawn(role: syntax::Role) -> bool {
    match role {
        syntax::Role::Param | syntax::Role::State | syntax::Role::Discrete | syntax::Role::Disturbance | syntax::Role::Random => true,
        syntax::Role::Action | syntax::Role::Var | syntax::Role::Let => false,
    }
}
