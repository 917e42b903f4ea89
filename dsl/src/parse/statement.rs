//! Statements: which rule of the grammar reads which keyword, and the kinds that describe the
//! process.
//!
//! The control problem is in `problem`, tables are in `table`.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, declaration, expression, problem, table, unit};
use crate::diagnostic::{Diagnostic, codes};
use crate::span::Span;
use crate::syntax::{Domain, Expr, ExprKind, Flux, Ident, Local, Parameter, ParameterKind, PortName, Role, Statement, StatementKind};

/// The rule that reads the rest of a statement behind its keyword.
pub(super) fn rule(keyword: &str, rest: &str) -> Rule {
    match keyword {
        "model" => Rule::model,
        "use" if rest.starts_with('"') => Rule::import,
        "use" => Rule::instances,
        "time" => Rule::time,
        "unit" => Rule::own_unit,
        "set" => Rule::set,
        "table" => Rule::table,
        "def" => Rule::def,
        "eq" => Rule::eq,
        "domain" => Rule::domain,
        "flux" => Rule::flux,
        "reaction" => Rule::reaction,
        "connector" => Rule::connector,
        "component" => Rule::component,
        "port" => Rule::port,
        "connect" => Rule::connect,
        "remove" => Rule::remove,
        "variant" => Rule::variant,
        "test" => Rule::test,
        "choice" => Rule::choice,
        "when" => Rule::when,
        _ => problem::rule(keyword).unwrap_or(Rule::declarations),
    }
}

/// The statement, or the several that one line stands for (`use Mixer as M1, M2`).
pub(super) fn lower(context: &Context<'_>, children: Children<'_>, body: Vec<Statement>) -> Fallible<Vec<StatementKind>> {
    if context.keyword == "use" {
        return instances(context, children);
    }
    let kind = match role(context.keyword) {
        Some(role) => StatementKind::Declare { role, declarations: declaration::declarations(context, children)? },
        None => single(context, children, body)?,
    };
    Ok(vec![kind])
}

fn role(keyword: &str) -> Option<Role> {
    Some(match keyword {
        "param" => Role::Param,
        "action" => Role::Action,
        "state" => Role::State,
        "var" => Role::Var,
        "let" => Role::Let,
        "discrete" => Role::Discrete,
        "disturbance" => Role::Disturbance,
        "random" => Role::Random,
        _ => return None,
    })
}

fn single(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    match context.keyword {
        "model" => Ok(StatementKind::Model { name: children.name(context)?, text: children.text() }),
        "time" => time(context, children),
        "unit" => own_unit(context, children),
        "set" => table::set(context, children),
        "table" => table::table(context, children),
        "def" => def(context, children),
        "eq" => equation(context, children),
        "domain" => domain(context, children),
        "flux" => flux(context, children),
        "connector" => connector(context, children),
        "reaction" => super::reaction::reaction(context, children),
        "component" => component(context, children, body),
        "port" => port(context, children),
        "connect" => connect(context, children),
        "choice" => choice(context, children),
        "variant" => {
            let (name, extends) = (children.name(context)?, declaration::extends(context, &mut children)?);
            Ok(StatementKind::Variant { name, extends, text: children.text(), body })
        }
        "remove" => remove(context, children),
        "test" => super::test::test(context, children, body),
        "when" => when(context, children, body),
        _ => problem::lower(context, children, body),
    }
}

/// `low`, `eq d/dt T`, `at every 3 [s]`, `connect a -> b`
fn remove(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let word = children.take(Rule::remove_word);
    let kind = children.take(Rule::kw_every).or(word).map(|word| context.word(&word));
    let first = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let mut ends = vec![first];
    while children.skip(Rule::arrow) {
        ends.push(expression::place(context, children.expect(context, Rule::place)?)?);
    }
    let target = match (ends.pop(), ends.first()) {
        (Some(last), Some(first)) => {
            let span = first.span.to(last.span);
            Expr { span, kind: ExprKind::Tuple(ends.into_iter().chain([last]).collect()) }
        }
        (Some(only), None) => only,
        (None, _) => return Err(Box::new(Diagnostic::error(codes::SYNTAX, "expected a name", Span::default()))),
    };
    Ok(StatementKind::Remove { kind, target })
}

fn instances(context: &Context<'_>, mut children: Children<'_>) -> Fallible<Vec<StatementKind>> {
    if let Some(path) = children.take(Rule::text) {
        return Ok(vec![StatementKind::Import { path: Context::text(&path), path_span: context.span(&path) }]);
    }
    let component = children.name(context)?;
    let parts = children.pairs.filter(|part| part.as_rule() == Rule::instance);
    parts.map(|part| instance(context, &component, part)).collect()
}

fn instance(context: &Context<'_>, component: &Ident, pair: Pair<'_, Rule>) -> Fallible<StatementKind> {
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    let indices = declaration::indices(context, &mut children)?;
    let arguments = children
        .take(Rule::instance_arguments)
        .map_or_else(|| Ok(Vec::new()), |pair| declaration::arguments(context, Children::new(pair)))?;
    Ok(StatementKind::Instance { component: component.clone(), name, indices, arguments })
}

fn time(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::colon);
    Ok(StatementKind::Time { name, unit: unit::unit(context, children.expect(context, Rule::unit)?)? })
}

fn own_unit(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::equals);
    let size = children.take(Rule::size).map(|pair| expression::size(context, pair)).transpose()?;
    Ok(StatementKind::Unit { name, size, text: children.text() })
}

fn def(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let parameters = children.expect(context, Rule::parameters)?.into_inner();
    let parameters = parameters.map(|pair| parameter(context, Children::new(pair))).collect::<Fallible<_>>()?;
    children.skip(Rule::equals);
    let Some(block) = children.take(Rule::def_block) else {
        let body = expression::expr(context, children.expect(context, Rule::expr)?)?;
        return Ok(StatementKind::Def { name, parameters, locals: Vec::new(), body });
    };
    let mut children = Children::new(block);
    children.skip(Rule::open);
    let mut locals = Vec::new();
    while let Some(pair) = children.take(Rule::local) {
        locals.push(local(context, Children::new(pair))?);
    }
    Ok(StatementKind::Def { name, parameters, locals, body: expression::expr(context, children.expect(context, Rule::expr)?)? })
}

fn parameter(context: &Context<'_>, mut children: Children<'_>) -> Fallible<Parameter> {
    let name = children.name(context)?;
    let kind = if children.skip(Rule::kw_in) {
        ParameterKind::Index(children.name(context)?)
    } else {
        match declaration::indices(context, &mut children)? {
            indices if indices.is_empty() => ParameterKind::Value,
            indices => ParameterKind::Array(indices),
        }
    };
    Ok(Parameter { name, kind })
}

fn local(context: &Context<'_>, mut children: Children<'_>) -> Fallible<Local> {
    children.skip(Rule::kw_let);
    let name = children.name(context)?;
    let unit = unit::declared(context, &mut children)?;
    children.skip(Rule::equals);
    Ok(Local { name, unit, value: expression::expr(context, children.expect(context, Rule::expr)?)? })
}

fn equation(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let lhs = expression::expr(context, children.expect(context, Rule::expr)?)?;
    children.skip(Rule::equals);
    let rhs = expression::expr(context, children.expect(context, Rule::expr)?)?;
    Ok(StatementKind::Equation { lhs, rhs, binders: expression::for_clause(context, &mut children)? })
}

fn domain(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::kw_in);
    let range = declaration::range(context, &mut children)?;
    let mut clauses = DomainClauses::default();
    while let Some(clause) = children.take(Rule::domain_clause) {
        clauses.add(context, clause)?;
    }
    let Some(cells) = clauses.cells else {
        let fault = Diagnostic::error(codes::MISSING_CLAUSE, format!("domain `{}` has no number of cells", name.text), name.span);
        return Err(Box::new(fault.label("declared here").help("add `cells 20` after the range")));
    };
    let DomainClauses { scheme, geometry, periodic, stretch, faces, volumes, areas, .. } = clauses;
    let text = children.text();
    Ok(StatementKind::Domain(Domain { name, range, cells, scheme, geometry, periodic, stretch, faces, volumes, areas, text }))
}

#[derive(Default)]
struct DomainClauses {
    cells: Option<Expr>,
    scheme: Option<Ident>,
    geometry: Option<Ident>,
    periodic: Option<Span>,
    stretch: Option<Expr>,
    faces: Option<Expr>,
    volumes: Option<Expr>,
    areas: Option<Expr>,
}

impl DomainClauses {
    fn add(&mut self, context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<()> {
        let place = pair.clone();
        let mut children = Children::new(pair);
        if let Some(word) = children.take(Rule::domain_choice) {
            let slot = if word.as_str() == "scheme" { &mut self.scheme } else { &mut self.geometry };
            return declaration::fill(context, slot, children.name(context)?, word.as_str(), &place);
        }
        if let Some(word) = children.take(Rule::domain_periodic) {
            return declaration::fill(context, &mut self.periodic, context.span(&word), word.as_str(), &place);
        }
        let word = children.expect(context, Rule::domain_word)?;
        let slot = match word.as_str() {
            "cells" => &mut self.cells,
            "stretch" => &mut self.stretch,
            "faces" => &mut self.faces,
            "areas" => &mut self.areas,
            _ => &mut self.volumes,
        };
        let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
        declaration::fill(context, slot, value, word.as_str(), &place)
    }
}

fn flux(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let indices = declaration::indices(context, &mut children)?;
    let unit = unit::declared(context, &mut children)?;
    children.skip(Rule::equals);
    let inner = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let (mut low, mut high) = (None, None);
    while let Some(end) = children.take(Rule::flux_end) {
        let place = end.clone();
        let side = Children::new(end.clone()).expect(context, Rule::flux_side)?;
        let slot = if side.as_str() == "low" { &mut low } else { &mut high };
        declaration::fill(context, slot, declaration::only_expr(context, end)?, side.as_str(), &place)?;
    }
    Ok(StatementKind::Flux(Flux { name, indices, unit, inner, low, high }))
}

fn component(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let parameters = children.take(Rule::structural).map_or_else(|| Ok(Vec::new()), |pair| structural(context, pair))?;
    let extends = declaration::extends(context, &mut children)?;
    Ok(StatementKind::Component { name, parameters, extends, text: children.text(), body })
}

fn structural(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Vec<(Ident, Option<Expr>)>> {
    let lower = |part| {
        let mut children = Children::new(part);
        Ok((children.name(context)?, declaration::clause(context, &mut children, Rule::value)?))
    };
    pair.into_inner().map(lower).collect()
}

/// Members, those after `flow` by name too.
fn connector(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let (mut members, mut flows) = (Vec::new(), Vec::new());
    for part in children.pairs.filter(|part| part.as_rule() == Rule::connector_member) {
        let mut member = Children::new(part);
        let is_flow = member.skip(Rule::kw_flow);
        let declared = declaration::declaration(context, member.expect(context, Rule::declaration)?)?;
        flows.extend(is_flow.then(|| declared.name.clone()));
        members.push(declared);
    }
    Ok(StatementKind::Connector { name, members, flows })
}

fn port(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let mut names = Vec::new();
    while let Some(part) = children.take(Rule::port_name) {
        let mut inner = Children::new(part);
        names.push(PortName { name: inner.name(context)?, indices: declaration::indices(context, &mut inner)? });
    }
    children.skip(Rule::colon);
    Ok(StatementKind::Port { names, connector: children.name(context)? })
}

fn connect(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let mut chain = Vec::new();
    while let Some(place) = children.take(Rule::place) {
        chain.push(expression::place(context, place)?);
        children.skip(Rule::arrow);
    }
    Ok(StatementKind::Connect { chain, binders: expression::for_clause(context, &mut children)? })
}

fn choice(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let mut options = Vec::new();
    let mut text = None;
    for part in children.pairs {
        match part.as_rule() {
            Rule::option => options.push(context.word(&part)),
            Rule::text => text = Some(Context::text(&part)),
            _ => {}
        }
    }
    Ok(StatementKind::Choice { name, options, text })
}

fn when(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    let choice = children.name(context)?;
    children.skip(Rule::equals);
    let option = context.word(&children.expect(context, Rule::option)?);
    Ok(StatementKind::When { choice, option, body })
}
