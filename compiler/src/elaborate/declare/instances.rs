//! Components: ports, instances, structural parameters.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Binder, BinderSet, Expr, ExprKind, Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::instances::SAMPLE;
use crate::elaborate::lower::place::{BinderValue, Bound, Place, Site};
use crate::elaborate::options::Setting;
use crate::elaborate::select::items::{Item, items};
use crate::elaborate::symbols::{Row, Scope, ScopeId, SymbolKind, Symbols};
use crate::ir::Role;

/// Deepest nest of components.
const MAX_COMPONENT_DEPTH: usize = 32;

/// Most declarations and equations that instances of components make together.
const MAX_INSTANTIATED: usize = 300_000;

impl<'a> Declaring<'_, 'a> {
    pub(in crate::elaborate) fn declare_port(&mut self, scope: ScopeId, name: &Ident, connector: &Ident) {
        let Some(StatementKind::Connector { members, .. }) = self.instances.connectors.get(connector.text.as_str()).map(|s| &s.kind) else {
            let help = self.work.ledger.reports.did_you_mean(&connector.text, self.instances.connectors.keys().copied());
            self.work.ledger.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown connector `{}`", connector.text), connector.span).maybe_help(help),
            );
            return self.faulty(scope, name);
        };
        let prefix = format!("{}{}.", self.symbols.scopes[scope].prefix, name.text);
        let port = self.symbols.scopes.push(Scope { prefix, parent: Some(scope), names: Default::default() });
        self.declare(scope, name, SymbolKind::Instance(port));
        for member in members {
            let place = Place::new(scope, Site::Dynamics);
            let Some((axes, _)) = self.axes(&member.indices, &place) else { continue };
            let unit = match &member.unit {
                Some(u) => self.lowering().unit(u, &place),
                None => Some(Unit::one()),
            };
            let Some(unit) = unit else { continue };
            if let Some(var) = self.new_variable(port, &member.name, Role::Algebraic, axes, unit, member) {
                self.symbols.ports.insert(var);
            }
        }
    }

    pub(in crate::elaborate) fn declare_instance(
        &mut self,
        scope: ScopeId,
        component: &'a Ident,
        name: &'a Ident,
        indices: &'a [Binder],
        arguments: &'a [(Ident, Expr)],
        depth: usize,
    ) {
        let Some(statement) = self.instantiable(component, depth) else { return self.faulty(scope, name) };
        let place = Place::new(scope, Site::Dynamics);
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, name.text);
        let kind = match indices {
            [] => Some(SymbolKind::Instance(self.instantiate(statement, &path, name.span, arguments, &place, depth))),
            [binder] => self.row_of_instances(statement, (&path, name.span), binder, arguments, &place, depth),
            _ => {
                self.work.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, "instances take one index", name.span));
                None
            }
        };
        self.declare(scope, name, kind.unwrap_or(SymbolKind::Faulty));
    }

    /// The component that an instance is made of, where one may be made here; reports why not.
    fn instantiable(&mut self, component: &'a Ident, depth: usize) -> Option<&'a Statement> {
        // Enough was said.
        if self.instances.made > MAX_INSTANTIATED {
            return None;
        }
        if let Some(at) = self.instances.open.iter().position(|c| *c == component.text) {
            self.contains_itself(at, component);
            return None;
        }
        if depth >= MAX_COMPONENT_DEPTH {
            self.instances.made = usize::MAX;
            let message = format!("components inside one another, more than {MAX_COMPONENT_DEPTH} deep");
            self.work.ledger.report(Diagnostic::error(codes::TOO_LARGE, message, component.span));
            return None;
        }
        let Some(statement) = self.instances.components.get(component.text.as_str()).copied() else {
            let help = self.work.ledger.reports.did_you_mean(&component.text, self.instances.components.keys().copied());
            let message = format!("unknown component `{}`", component.text);
            self.work.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, message, component.span).maybe_help(help));
            return None;
        };
        self.instances.used.insert(&component.text);
        self.instances.samples.may_instantiate(depth).then_some(statement)
    }

    /// An instance for each member of a set; `None`, and a report, where they are too many or what counts them is no set.
    fn row_of_instances(
        &mut self,
        statement: &'a Statement,
        (path, used): (&str, Span),
        binder: &'a Binder,
        arguments: &'a [(Ident, Expr)],
        place: &Place,
        depth: usize,
    ) -> Option<SymbolKind<'a>> {
        let mut list = Vec::new();
        for value in self.lowering().bindings_of(binder, place) {
            if self.instances.made > MAX_INSTANTIATED {
                return None;
            }
            let BinderValue::One(bound) = value else {
                self.work.ledger.report(Diagnostic::error(codes::WRONG_KIND, "instances are counted by a set", binder.span));
                return None;
            };
            let label = match &bound {
                Bound::Member(set, i) => self.symbols.sets[*set].labels[*i].clone(),
                Bound::Number(e) => self.work.exprs.as_const(*e).map_or_else(String::new, |x| x.to_string()),
                _ => continue,
            };
            if !self.instances.samples.may_instantiate(depth) {
                break;
            }
            let inner_place = place.bind(&binder.name.text, bound);
            let inner = self.instantiate(statement, &format!("{path}[{label}]"), used, arguments, &inner_place, depth);
            list.push((label, inner));
        }
        Some(SymbolKind::Instances(Row::new(list).into()))
    }

    /// Reports a component that is inside of itself, with those between.
    fn contains_itself(&mut self, at: usize, component: &Ident) {
        let between: Vec<String> = self.instances.open[at + 1..].iter().map(|c| format!("`{c}`")).collect();
        let through = if between.is_empty() { String::new() } else { format!(" through {}", between.join(" and ")) };
        let message = format!("`{}` contains itself{through}", component.text);
        let fault = Diagnostic::error(codes::CYCLIC_DEFINITION, message, component.span);
        self.work
            .ledger
            .report(fault.help("a component has a fixed size: use an array of instances, `use Stage as s[k in 1..n]`, and connect them"));
    }

    /// Counts the declarations of an instance; `false`, and one report, where they are beyond reason.
    fn may_instantiate(&mut self, declarations: usize, used: Span) -> bool {
        let before = self.instances.made;
        self.instances.made = before.saturating_add(1 + declarations);
        let fits = self.instances.made <= MAX_INSTANTIATED;
        if !fits && before <= MAX_INSTANTIATED {
            self.work.ledger.report(
                Diagnostic::error(
                    codes::TOO_LARGE,
                    "instances of components would make more than 300,000 declarations and equations",
                    used,
                )
                .help("use indexed states or a `domain`, whose elements stay a loop, in place of instances"),
            );
        }
        fits
    }

    pub(in crate::elaborate) fn instantiate(
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
        let StatementKind::Component { name, parameters, body, .. } = &statement.kind else { return scope };
        for (parameter, default) in parameters {
            self.work.ledger.warn_of_name(parameter);
            let given = arguments.iter().find(|(a, _)| a.text == parameter.text).map(|(_, e)| e);
            if self.instances.samples.taken() && given.is_none() && default.is_none() {
                let kind = self.symbols.sampled(scope, parameter, body);
                self.declare(scope, parameter, kind);
                continue;
            }
            self.structural(scope, (path, used), parameter, given, default.as_ref(), outer);
        }
        let list = items(body, &self.input.selection);
        self.note_given(scope, (name, parameters), &list, arguments, outer);
        if self.may_instantiate(list.len(), used) {
            self.instances.open.push(&name.text);
            self.declare_block(scope, list, depth + 1);
            self.instances.open.pop();
        }
        scope
    }

    /// Notes the arguments of an instance that are parameters of its body; reports those of which its component knows nothing.
    fn note_given(
        &mut self,
        scope: ScopeId,
        (component, structural): (&Ident, &[(Ident, Option<Expr>)]),
        list: &[Item<'a>],
        arguments: &'a [(Ident, Expr)],
        outer: &Place,
    ) {
        let declared = list.iter().filter_map(|i| match i {
            Item::Declare(syntax::Role::Param, d) => Some(d.name.text.as_str()),
            _ => None,
        });
        let known: Vec<&str> = declared.chain(structural.iter().map(|(p, _)| p.text.as_str())).collect();
        for (argument, e) in arguments {
            if structural.iter().any(|(p, _)| p.text == argument.text) {
                continue;
            }
            if known.contains(&argument.text.as_str()) {
                self.instances.given.insert((scope, argument.text.clone()), (e, outer.clone()));
                continue;
            }
            let help = self.work.ledger.reports.did_you_mean(&argument.text, known.iter().copied());
            let message = format!("the component `{}` has no parameter `{}`", component.text, argument.text);
            self.work.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, message, argument.span).maybe_help(help));
        }
    }

    /// A structural parameter: a whole number or a set; a setting `R1.n_cells` or `n_cells` overrides it.
    fn structural(
        &mut self,
        scope: ScopeId,
        (path, used): (&str, Span),
        name: &'a Ident,
        given: Option<&Expr>,
        default: Option<&Expr>,
        outer: &Place,
    ) {
        for key in [format!("{path}.{}", name.text), name.text.clone()] {
            if let Some(Setting::Number(x)) = self.input.options.settings.get(&key) {
                self.work.constants.taken.insert(key.clone());
                if x.fract() == 0.0 && *x >= 0.0 && *x < 1e9 {
                    self.declare(scope, name, SymbolKind::Integer(*x as i64));
                    return;
                }
                self.work.ledger.reports.scenario_fault(&key, format!("`{key}` takes a whole number, not {x}"), None);
            }
        }
        let Some(e) = given.or(default) else {
            self.work.ledger.report(
                Diagnostic::error(codes::MISSING_DEFAULT, format!("`{path}` needs a value of `{}`", name.text), used)
                    .secondary(name.span, "it has no default")
                    .help(format!("write `({} = ...)` after the instance's name", name.text)),
            );
            return self.faulty(scope, name);
        };
        if let ExprKind::Name(n) = &e.kind
            && let Some(symbol) = self.symbols.lookup(outer.scope, &n.text)
            && let SymbolKind::Set(set) = self.symbols[symbol].kind
        {
            self.declare(scope, name, SymbolKind::Set(set));
            return;
        }
        let kind = self.lowering().integer(e, outer).map_or(SymbolKind::Faulty, SymbolKind::Integer);
        self.declare(scope, name, kind);
    }
}

impl<'a> Declaring<'_, 'a> {
    /// Declares what components see of the file, and one instance of each.
    pub(in crate::elaborate) fn declare_samples(&mut self, components: &[&'a Statement]) {
        self.instances.samples.instances = Some(0);
        let root = self.declare_seen();
        let place = Place::new(root, Site::Dynamics);
        for statement in components {
            let StatementKind::Component { name, .. } = &statement.kind else { continue };
            self.instantiate(statement, &name.text, name.span, &[], &place, 0);
        }
    }
}

impl<'a> Symbols<'a> {
    /// Kind of a structural parameter in a sample: a set where something runs over it, else a number.
    pub(in crate::elaborate) fn sampled(&self, scope: ScopeId, name: &Ident, body: &[Statement]) -> SymbolKind<'a> {
        if !body.iter().any(|s| runs_over(s, &name.text)) {
            return SymbolKind::Integer(SAMPLE as i64);
        }
        // The set that it stands for mostly has its name.
        match self.lookup(scope, &name.text).map(|s| self[s].kind.clone()) {
            Some(kind @ SymbolKind::Set(_)) => kind,
            _ => SymbolKind::Faulty,
        }
    }
}

/// Whether an index of a statement runs over a name.
fn runs_over(statement: &Statement, name: &str) -> bool {
    let any = |binders: &[Binder]| {
        binders.iter().any(|b| match &b.over {
            BinderSet::Itself => b.name.text == name,
            BinderSet::Set(set) => set.text == name,
            BinderSet::Range(..) | BinderSet::Tuple(_) => false,
        })
    };
    let inside = |e: &Expr| {
        let mut found = false;
        e.walk(&mut |e| found |= matches!(&e.kind, ExprKind::Reduce { binders, .. } if any(binders)));
        found
    };
    match &statement.kind {
        StatementKind::Declare { declarations, .. } => declarations.iter().any(|d| any(&d.indices) || d.value.iter().any(inside)),
        StatementKind::Flux(flux) => any(&flux.indices) || inside(&flux.inner),
        StatementKind::Table(table) => table.indices.iter().any(|set| set.text == name),
        StatementKind::Equation { lhs, rhs, binders } => any(binders) || inside(lhs) || inside(rhs),
        StatementKind::Instance { indices, .. } => any(indices),
        StatementKind::When { body, .. } | StatementKind::Variant { body, .. } => body.iter().any(|s| runs_over(s, name)),
        _ => false,
    }
}
