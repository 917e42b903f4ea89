//! Parts of instances: ports, structural parameters, and how many there may be.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Binder, BinderSet, Expr, ExprKind, Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::instances::SAMPLE;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{structural, units};
use crate::elaborate::options::Setting;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{Port, Scope, ScopeId, SymbolKind, Symbols};
use crate::ir::Role;

/// Deepest nest of components.
const MAX_COMPONENT_DEPTH: usize = 32;

/// Most declarations and equations that instances of components make together.
pub(in crate::elaborate::declare) const MAX_INSTANTIATED: usize = 300_000;

/// A component with all that it extends.
pub(in crate::elaborate::declare) struct Lineage<'a> {
    /// Structural parameters, those of the bases first.
    pub parameters: Vec<&'a (Ident, Option<Expr>)>,
    /// Bodies, that of the last base first.
    pub bodies: Vec<&'a [Statement]>,
}

impl<'a> Declaring<'_, 'a> {
    /// A component with all that it extends; reports bases that do not exist or extend each other.
    pub(in crate::elaborate::declare) fn lineage(&mut self, statement: &'a Statement) -> Lineage<'a> {
        let mut out = Lineage { parameters: Vec::new(), bodies: Vec::new() };
        let (mut at, mut seen) = (Some(statement), Vec::new());
        while let Some(statement) = at.take() {
            let StatementKind::Component { name, parameters, extends, body, .. } = &statement.kind else { break };
            seen.push(&name.text);
            out.bodies.insert(0, body.as_slice());
            let own = parameters.iter().filter(|(p, _)| !out.parameters.iter().any(|(known, _)| known.text == p.text)).collect::<Vec<_>>();
            out.parameters.splice(0..0, own);
            let Some(base) = extends else { break };
            if seen.contains(&&base.text) {
                let message = format!("the component `{}` extends itself", base.text);
                self.work.ledger.report(Diagnostic::error(codes::CYCLIC_DEFINITION, message, base.span));
                break;
            }
            at = self.instances.components.get(base.text.as_str()).copied();
            match at {
                // What others extend need not be whole by itself.
                Some(_) => {
                    self.instances.used.insert(&base.text);
                }
                None => {
                    let help = self.work.ledger.reports.did_you_mean(&base.text, self.instances.components.keys().copied());
                    let message = format!("unknown component `{}`", base.text);
                    self.work.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, message, base.span).maybe_help(help));
                }
            }
        }
        out
    }

    /// Declares a port with its members; `None`, and a report, for an unknown connector.
    pub(in crate::elaborate::declare) fn declare_port(&mut self, scope: ScopeId, path: String, connector: &Ident) -> Option<ScopeId> {
        let Some(StatementKind::Connector { members, flows, .. }) = self.instances.connectors.get(connector.text.as_str()).map(|s| &s.kind)
        else {
            let help = self.work.ledger.reports.did_you_mean(&connector.text, self.instances.connectors.keys().copied());
            self.work.ledger.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown connector `{}`", connector.text), connector.span).maybe_help(help),
            );
            return None;
        };
        let port = self.symbols.scopes.push(Scope { prefix: format!("{path}."), parent: Some(scope), names: Default::default() });
        for member in members {
            let place = Place::new(scope, Site::Dynamics);
            let Some((axes, _)) = self.axes(&member.indices, &place) else { continue };
            let unit = match &member.unit {
                Some(u) => units::unit(&mut self.lowering(), u, &place),
                None => Some(Unit::one()),
            };
            let Some(unit) = unit else { continue };
            self.new_variable(port, &member.name, Role::Algebraic, axes, unit, member);
        }
        let names = &self.symbols.scopes[port].names;
        let known = |name: &str| names.get(name).copied();
        let members = members.iter().filter_map(|member| known(&member.name.text)).collect();
        let flows = flows.iter().filter_map(|name| known(&name.text)).collect();
        self.symbols.ports.push(Port { path, connector: connector.text.clone(), scope: port, members, flows });
        Some(port)
    }

    /// The component that an instance is made of, where one may be made here; reports why not.
    pub(in crate::elaborate::declare) fn instantiable(
        &mut self,
        scope: ScopeId,
        component: &'a Ident,
        depth: usize,
    ) -> Option<&'a Statement> {
        // Enough was reported.
        if self.instances.made > MAX_INSTANTIATED {
            return None;
        }
        if let Some(at) = self.instances.open.iter().position(|c| *c == component.text) {
            self.work.ledger.report(contains_itself(&self.instances.open[at + 1..], component));
            return None;
        }
        if depth >= MAX_COMPONENT_DEPTH {
            self.instances.made = usize::MAX;
            let message = format!("components inside one another, more than {MAX_COMPONENT_DEPTH} deep");
            self.work.ledger.report(Diagnostic::error(codes::TOO_LARGE, message, component.span));
            return None;
        }
        let argument = self.instances.types.get(&(scope, component.text.as_str())).copied();
        let Some(statement) = argument.or_else(|| self.instances.components.get(component.text.as_str()).copied()) else {
            let help = self.work.ledger.reports.did_you_mean(&component.text, self.instances.components.keys().copied());
            let message = format!("unknown component `{}`", component.text);
            self.work.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, message, component.span).maybe_help(help));
            return None;
        };
        self.instances.used.insert(&component.text);
        self.instances.samples.may_instantiate(depth).then_some(statement)
    }

    /// Counts the declarations of an instance; `false`, and one report, where they are beyond
    /// reason.
    pub(in crate::elaborate::declare) fn may_instantiate(&mut self, declarations: usize, used: Span) -> bool {
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
                .help("use indexed states or a `domain`, whose elements stay a loop, instead of instances"),
            );
        }
        fits
    }

    /// Notes the arguments of an instance that are parameters of its body; reports those of which
    /// its component knows nothing.
    pub(in crate::elaborate::declare) fn note_given(
        &mut self,
        scope: ScopeId,
        (component, structural): (&Ident, &[&(Ident, Option<Expr>)]),
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
            self.instances.misspelt.insert(scope);
            let help = self.work.ledger.reports.did_you_mean(&argument.text, known.iter().copied());
            let message = format!("the component `{}` has no parameter `{}`", component.text, argument.text);
            let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, message, argument.span).label("unknown argument").maybe_help(help);
            let list = known.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
            self.work.ledger.report(if known.is_empty() { fault } else { fault.note(format!("its parameters are {list}")) });
        }
    }

    /// A structural parameter: a whole number, a switch, a set or a component; a setting
    /// `R1.n_cells` or `n_cells` overrides it.
    pub(in crate::elaborate::declare) fn structural(
        &mut self,
        scope: ScopeId,
        (path, used): (&str, Span),
        name: &'a Ident,
        (given, default): (Option<&'a Expr>, Option<&'a Expr>),
        (outer, depth): (&Place, usize),
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
        if let ExprKind::Bool(holds) = e.kind {
            self.declare(scope, name, SymbolKind::Truth(holds));
            return;
        }
        if let Some(component) = self.component_named(e, outer).or_else(|| self.misnamed(e, default, outer)) {
            return self.component_argument(scope, path, (name, component), (e, default), depth);
        }
        if let ExprKind::Name(n) = &e.kind
            && let Some(symbol) = self.symbols.lookup(outer.scope, &n.text)
            && let kind @ (SymbolKind::Set(_) | SymbolKind::Truth(_)) = self.symbols[symbol].kind.clone()
        {
            self.declare(scope, name, kind);
            return;
        }
        let kind = structural::integer(&mut self.lowering(), e, outer).map_or(SymbolKind::Faulty, SymbolKind::Integer);
        self.declare(scope, name, kind);
    }
}

impl<'a> Symbols<'a> {
    /// Kind of a structural parameter in a sample: a set where something runs over it, else a
    /// number.
    pub(in crate::elaborate) fn sampled(&self, scope: ScopeId, name: &Ident, bodies: &[&[Statement]]) -> SymbolKind<'a> {
        if !bodies.iter().copied().flatten().any(|s| runs_over(s, &name.text)) {
            return SymbolKind::Integer(SAMPLE as i64);
        }
        // The set that it stands for mostly has its name.
        match self.lookup(scope, &name.text).map(|s| self[s].kind.clone()) {
            Some(kind @ SymbolKind::Set(_)) => kind,
            _ => SymbolKind::Faulty,
        }
    }
}

/// A component that is inside of itself, with those between.
fn contains_itself(between: &[&str], component: &Ident) -> Diagnostic {
    let between: Vec<String> = between.iter().map(|c| format!("`{c}`")).collect();
    let through = if between.is_empty() { String::new() } else { format!(" through {}", between.join(" and ")) };
    let message = format!("`{}` contains itself{through}", component.text);
    Diagnostic::error(codes::CYCLIC_DEFINITION, message, component.span)
        .help("a component has a fixed size: use an array of instances, `use Stage as s[k in 1..n]`, and connect them")
}

/// Returns `true` if an index of a statement runs over a name.
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
        StatementKind::Connect { binders, .. } => any(binders),
        StatementKind::When { body, .. } | StatementKind::Variant { body, .. } => body.iter().any(|s| runs_over(s, name)),
        _ => false,
    }
}
