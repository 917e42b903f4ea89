//! Components as arguments: `component Flash(properties = Ideal)`.
//!
//! A *package* is a component of functions, sets, tables, parameters and named expressions only. An
//! instance that is given one sees all that it declares by its names; the parameters of the package
//! belong to the instance, `F1.properties.A`. Any other component is a type that the body uses,
//! `use tray as t[k in 1..10]`. The default says what a component must have to be given instead.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Expr, ExprKind, Ident, Role, Statement, StatementKind};

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::symbols::{ScopeId, SymbolKind};

impl<'a> Declaring<'_, 'a> {
    /// The component that an argument names, by itself, by a choice or by a parameter around.
    pub(in crate::elaborate::declare) fn component_named(&self, e: &Expr, outer: &Place) -> Option<&'a Statement> {
        let ExprKind::Name(name) = &e.kind else { return None };
        let mut text = name.text.as_str();
        if let Some((_, &argument)) = self.instances.types.iter().find(|((scope, known), _)| *scope == outer.scope && *known == text) {
            return Some(argument);
        }
        if let Some(symbol) = self.symbols.lookup(outer.scope, text)
            && let SymbolKind::Choice { options, chosen } = self.symbols[symbol].kind
        {
            text = options.get(chosen)?.text.as_str();
        }
        self.instances.components.get(text).copied()
    }

    /// Gives an instance a component as the value of a parameter.
    pub(in crate::elaborate::declare) fn component_argument(
        &mut self,
        scope: ScopeId,
        path: &str,
        (name, component): (&'a Ident, &'a Statement),
        (argument, default): (&Expr, Option<&Expr>),
        depth: usize,
    ) {
        let component = self.fitting(name, component, (argument, default));
        let StatementKind::Component { name: given, .. } = &component.kind else { return };
        self.instances.used.insert(&given.text);
        self.instances.types.insert((scope, &name.text), component);
        if !self.is_package(component) {
            return self.faulty(scope, name);
        }
        if self.instances.open.contains(&given.text.as_str()) {
            let message = format!("the package `{}` is an argument of itself", given.text);
            self.work.ledger.report(Diagnostic::error(codes::CYCLIC_DEFINITION, message, argument.span));
            return self.faulty(scope, name);
        }
        let root = Place::new(ScopeId::from_u32(0), Site::Dynamics);
        let package = self.instantiate(component, &format!("{path}.{}", name.text), argument.span, &[], &root, depth);
        self.symbols.scopes[package].parent = self.symbols.scopes[scope].parent;
        self.symbols.scopes[scope].parent = Some(package);
        self.symbols.packages.entry(scope).or_default().push(package);
        self.declare(scope, name, SymbolKind::Instance(package));
    }

    /// Returns `true` if a component has functions and data only.
    fn is_package(&mut self, component: &'a Statement) -> bool {
        self.other_than_data(component).is_none()
    }

    /// The first statement of a component that is neither a function nor data.
    fn other_than_data(&mut self, component: &'a Statement) -> Option<&'a Statement> {
        let is_data = |statement: &Statement| match &statement.kind {
            StatementKind::Def { .. } | StatementKind::Set { .. } | StatementKind::Table(_) | StatementKind::TimeTable(_) => true,
            StatementKind::Declare { role, .. } => matches!(role, Role::Param | Role::Let),
            _ => false,
        };
        self.lineage(component).bodies.into_iter().flatten().find(|statement| !is_data(statement))
    }

    /// The component that a default names.
    fn default_component(&self, default: Option<&Expr>) -> Option<&'a Statement> {
        self.component_named(default?, &Place::new(ScopeId::from_u32(0), Site::Dynamics))
    }

    /// Reports an argument that is not a component although the default is one, and takes the
    /// default; `None` if the parameter is not a component.
    pub(in crate::elaborate::declare) fn misnamed(
        &mut self,
        argument: &Expr,
        default: Option<&Expr>,
        outer: &Place,
    ) -> Option<&'a Statement> {
        let standard = self.default_component(default)?;
        let fault = match &argument.kind {
            ExprKind::Name(name) if self.symbols.lookup(outer.scope, &name.text).is_none() => {
                let help = self.work.ledger.reports.did_you_mean(&name.text, self.instances.components.keys().copied());
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown component `{}`", name.text), argument.span).maybe_help(help)
            }
            _ => Diagnostic::error(codes::WRONG_ARGUMENTS, "this argument must be the name of a component", argument.span),
        };
        self.work.ledger.report(fault);
        Some(standard)
    }

    /// The component, or the default after a report if the component lacks something that the
    /// default has.
    fn fitting(&mut self, name: &Ident, component: &'a Statement, (argument, default): (&Expr, Option<&Expr>)) -> &'a Statement {
        let Some(wanted) = self.default_component(default).filter(|wanted| !std::ptr::eq(*wanted, component)) else {
            return component;
        };
        let (StatementKind::Component { name: given, .. }, StatementKind::Component { name: standard, .. }) =
            (&component.kind, &wanted.kind)
        else {
            return component;
        };
        if self.is_package(wanted)
            && let Some(other) = self.other_than_data(component)
        {
            let message = format!("`{}` cannot be the `{}` of this component: it is not a package", given.text, name.text);
            let fault =
                Diagnostic::error(codes::WRONG_ARGUMENTS, message, argument.span).secondary(other.span, "neither a function nor data");
            self.work.ledger.report(fault.help("a package holds functions, sets, tables, parameters and named expressions only"));
            return wanted;
        }
        let has = self.members(component);
        let lacks: Vec<String> = self
            .members(wanted)
            .into_iter()
            .filter(|(member, count)| !has.iter().any(|(known, own)| known == member && own == count))
            .map(|(member, count)| match count {
                Some(1) if has.iter().any(|(known, _)| *known == member) => format!("`{member}` with 1 argument"),
                Some(count) if has.iter().any(|(known, _)| *known == member) => format!("`{member}` with {count} arguments"),
                _ => format!("`{member}`"),
            })
            .collect();
        if lacks.is_empty() {
            return component;
        }
        let message = format!("`{}` cannot be the `{}` of this component: it has no {}", given.text, name.text, lacks.join(", "));
        let help = format!("declare it in `{}`, or write `component {} extends {}`", given.text, given.text, standard.text);
        let fault = Diagnostic::error(codes::WRONG_ARGUMENTS, message, argument.span);
        self.work.ledger.report(fault.secondary(standard.span, "has all that is needed").help(help));
        wanted
    }

    /// Names that a component declares, functions with their number of arguments.
    fn members(&mut self, component: &'a Statement) -> Vec<(&'a str, Option<usize>)> {
        let mut out = Vec::new();
        for statement in self.lineage(component).bodies.into_iter().flatten() {
            match &statement.kind {
                StatementKind::Def { name, parameters, .. } => out.push((name.text.as_str(), Some(parameters.len()))),
                StatementKind::Declare { declarations, .. } => out.extend(declarations.iter().map(|d| (d.name.text.as_str(), None))),
                StatementKind::Set { name, .. } => out.push((name.text.as_str(), None)),
                StatementKind::TimeTable(table) => out.push((table.name.text.as_str(), None)),
                StatementKind::Table(table) => out.extend(table.columns.iter().map(|column| (column.name.text.as_str(), None))),
                StatementKind::Port { names, .. } => out.extend(names.iter().map(|port| (port.name.text.as_str(), None))),
                _ => {}
            }
        }
        out.sort_unstable();
        out.dedup();
        out
    }
}
