//! Statements of the control problem: what is set, seen, wanted and forbidden, and what happens at
//! sampling instants.

use pest::iterators::Pair;

use super::declaration::{arguments, fill};
use super::{Children, Context, Fallible, Rule, control, declaration, expression, unit};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Binder, BinderSet, Expr, ExprKind, Observation, Phase, Statement, StatementKind};

/// The rule of a statement of the control problem.
pub(super) fn rule(keyword: &str) -> Option<Rule> {
    Some(match keyword {
        "initial" => Rule::initial,
        "steady" => Rule::steady,
        "observe" => Rule::observe,
        "level" => Rule::level,
        "reward" => Rule::reward,
        "fail" | "success" => Rule::fail,
        "constraint" | "event" => Rule::conditional,
        "invariant" => Rule::invariant,
        "episode" | "solver" => Rule::settings,
        "policy" => Rule::policy,
        "at" => Rule::at,
        "control" => Rule::control,
        "next" | "reset" => Rule::next,
        "clamp" => Rule::clamp,
        "phase" => Rule::phase,
        _ => return None,
    })
}

/// The statement that `context.keyword` introduces.
pub(super) fn lower(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    match context.keyword {
        "initial" => initial(context, children),
        "steady" => steady(context, children),
        "observe" => Ok(StatementKind::Observe { items: observations(context, children)? }),
        "level" => {
            let (name, extends) = (children.name(context)?, declaration::extends(context, &mut children)?);
            Ok(StatementKind::Level { name, extends, text: children.text(), body })
        }
        "reward" => reward(context, children),
        "fail" | "success" => fail(context, children),
        "constraint" | "event" => conditional(context, children),
        "invariant" => invariant(context, children),
        "episode" => Ok(StatementKind::Episode { entries: arguments(context, children)? }),
        "solver" => Ok(StatementKind::Solver { entries: arguments(context, children)? }),
        "policy" => Ok(StatementKind::Policy { name: children.name(context)?, entries: place_entries(context, children)? }),
        "at" => at(context, children, body),
        "control" => control::control(context, children),
        "clamp" => clamp(context, children),
        "phase" => phase(context, children, body),
        _ => update(context, children),
    }
}

fn initial(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    if let Some(steady) = children.take(Rule::start_steady) {
        return start_steady(context, Children::new(steady), &mut children);
    }
    if let Some(equation) = children.take(Rule::start_equation) {
        return start_equation(context, Children::new(equation), &mut children);
    }
    let target = expression::place(context, children.expect(context, Rule::place)?)?;
    let random = children.skip(Rule::tilde);
    children.skip(Rule::equals);
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let clip = declaration::clip(context, &mut children)?;
    Ok(StatementKind::Initial { target, random, value, clip, binders: expression::for_clause(context, &mut children)? })
}

/// `steady for (T, c)`; a loop over the places is not needed, since a name stands for the whole
/// array.
fn start_steady(context: &Context<'_>, mut steady: Children<'_>, rest: &mut Children<'_>) -> Fallible<StatementKind> {
    steady.skip(Rule::kw_steady);
    steady.skip(Rule::kw_for);
    let targets = start_places(context, steady.expect(context, Rule::start_places)?)?;
    match rest.take(Rule::for_clause) {
        None => Ok(StatementKind::StartSteady { targets }),
        Some(clause) => {
            let fault = Diagnostic::error(codes::SYNTAX, "`initial steady for` takes no loop", context.span(&clause));
            Err(Box::new(fault.help("name the whole array, or write `initial d/dt x[i] = 0 for i in set`")))
        }
    }
}

/// `eq p = 2 [bar] free n for z`
fn start_equation(context: &Context<'_>, mut equation: Children<'_>, rest: &mut Children<'_>) -> Fallible<StatementKind> {
    equation.skip(Rule::kw_eq);
    let lhs = expression::expr(context, equation.expect(context, Rule::expr)?)?;
    equation.skip(Rule::equals);
    let rhs = expression::expr(context, equation.expect(context, Rule::expr)?)?;
    let free = match equation.skip(Rule::kw_free) {
        true => start_places(context, equation.expect(context, Rule::start_places)?)?,
        false => Vec::new(),
    };
    Ok(StatementKind::StartEquation { lhs, rhs, free, binders: expression::for_clause(context, rest)? })
}

fn start_places(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Vec<Expr>> {
    pair.into_inner().filter(|part| part.as_rule() == Rule::place).map(|part| expression::place(context, part)).collect()
}

/// Each side of an entry is an expression: `h = 0.7`, `A + B = 1`; `free Q, u` names actions that
/// are found.
fn steady(context: &Context<'_>, children: Children<'_>) -> Fallible<StatementKind> {
    let (mut entries, mut free) = (Vec::new(), Vec::new());
    let mut is_free = false;
    for part in children.pairs.filter(|part| part.as_rule() == Rule::steady_entry) {
        let whole = context.span(&part);
        let mut children = Children::new(part);
        let begins = children.skip(Rule::kw_free);
        if let Some(place) = children.take(Rule::place) {
            is_free |= begins;
            if !is_free {
                let fault = Diagnostic::error(codes::SYNTAX, "a steady value needs `= value`", whole);
                return Err(Box::new(fault.help("write `name = value`, or `free name` for an action that is found")));
            }
            free.push(expression::place(context, place)?);
            continue;
        }
        is_free = false;
        let left = expression::expr(context, children.expect(context, Rule::expr)?)?;
        children.skip(Rule::equals);
        entries.push((left, expression::expr(context, children.expect(context, Rule::expr)?)?));
    }
    Ok(StatementKind::Steady { entries, free })
}

fn place_entries(context: &Context<'_>, children: Children<'_>) -> Fallible<Vec<(Expr, Expr)>> {
    let lower = |part: Pair<'_, Rule>| {
        let mut children = Children::new(part);
        let place = expression::place(context, children.expect(context, Rule::place)?)?;
        children.skip(Rule::equals);
        Ok((place, expression::expr(context, children.expect(context, Rule::expr)?)?))
    };
    children.pairs.filter(|part| part.as_rule() == Rule::place_entry).map(lower).collect()
}

fn reward(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let unit = unit::declared(context, &mut children)?;
    let default = children.skip(Rule::kw_default);
    children.skip(Rule::equals);
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    Ok(StatementKind::Reward { name, unit, default, value, text: children.text() })
}

fn fail(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let event = children.skip(Rule::kw_event);
    children.skip(Rule::kw_when);
    let condition = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let text = children.text();
    Ok(if context.keyword == "fail" {
        StatementKind::Fail { name, event, condition, text }
    } else {
        StatementKind::Success { name, event, condition, text }
    })
}

fn conditional(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::kw_when);
    let condition = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let text = children.text();
    Ok(match context.keyword {
        "event" => StatementKind::Event { name, condition, text },
        _ => StatementKind::Constraint { name, condition, text },
    })
}

fn invariant(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::equals);
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let rate = if children.skip(Rule::kw_rate) { Some(expression::expr(context, children.expect(context, Rule::expr)?)?) } else { None };
    Ok(StatementKind::Invariant { name, value, rate, text: children.text() })
}

/// `next` and `reset`
fn update(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let target = expression::place(context, children.expect(context, Rule::place)?)?;
    children.skip(Rule::equals);
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let binders = expression::for_clause(context, &mut children)?;
    Ok(if context.keyword == "next" {
        StatementKind::Next { target, value, binders }
    } else {
        StatementKind::Reset { target, value, binders }
    })
}

fn clamp(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let target = expression::place(context, children.expect(context, Rule::place)?)?;
    children.skip(Rule::kw_at);
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    children.skip(Rule::kw_when);
    let condition = expression::expr(context, children.expect(context, Rule::expr)?)?;
    Ok(StatementKind::Clamp { target, value, condition, binders: expression::for_clause(context, &mut children)? })
}

/// `start`, the name of an event, or `every 3 [s]`
fn at(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    if let Some(word) = children.take(Rule::kw_every) {
        let every = expression::expr(context, children.expect(context, Rule::expr)?)?;
        return Ok(StatementKind::At { instant: context.word(&word), every: Some(every), body });
    }
    Ok(StatementKind::At { instant: children.name(context)?, every: None, body })
}

fn phase(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let duration = declaration::clause(context, &mut children, Rule::phase_for)?;
    let until = declaration::clause(context, &mut children, Rule::phase_until)?;
    let then = children.take(Rule::phase_then);
    let next = then.and_then(|pair| pair.into_inner().find(|part| part.as_rule() == Rule::name));
    let next = next.map(|name| context.ident(&name)).transpose()?;
    Ok(StatementKind::Phase(Phase { name, duration, until, next, body }))
}

fn observations(context: &Context<'_>, children: Children<'_>) -> Fallible<Vec<Observation>> {
    let mut items: Vec<Observation> = Vec::new();
    for part in children.pairs.filter(|part| part.as_rule() == Rule::observation) {
        let item = observation(context, part)?;
        match items.last_mut() {
            Some(previous) => match binder_of(previous, &item) {
                Some(binder) => previous.binders.push(binder),
                None => items.push(item),
            },
            None => items.push(item),
        }
    }
    Ok(items)
}

/// In `observe c[i, z] for i in species, z` the last `z` is an index of the observation before it,
/// since that one mentions it as such.
fn binder_of(previous: &Observation, item: &Observation) -> Option<Binder> {
    let ExprKind::Name(name) = &item.value.kind else { return None };
    let bare = item.name.is_none() && item.unit.is_none() && item.text.is_none();
    if previous.binders.is_empty() || !bare || !indexed_by(&previous.value, &name.text) {
        return None;
    }
    let over = match &item.bounds {
        Some((low, high)) => BinderSet::Range(Box::new(low.clone()), Box::new(high.clone())),
        None => BinderSet::Itself,
    };
    Some(Binder { name: name.clone(), over, condition: None, span: item.span })
}

fn indexed_by(value: &Expr, name: &str) -> bool {
    match &value.kind {
        ExprKind::Index(base, indices) => {
            indexed_by(base, name) || indices.iter().any(|index| matches!(&index.kind, ExprKind::Name(ident) if ident.text == name))
        }
        ExprKind::Member(base, _) => indexed_by(base, name),
        _ => false,
    }
}

fn observation(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Observation> {
    let span = context.span(&pair);
    let mut children = Children::new(pair);
    let mut item = match children.take(Rule::observed_name) {
        Some(named) => observed_name(context, named)?,
        None => bare(expression::expr(context, children.expect(context, Rule::expr)?)?),
    };
    item.span = span;
    for clause in children.pairs {
        observation_clause(context, &mut item, clause)?;
    }
    Ok(item)
}

fn bare(value: Expr) -> Observation {
    let span = value.span;
    Observation {
        name: None,
        unit: None,
        value,
        binders: Vec::new(),
        bounds: None,
        noise: None,
        every: None,
        delay: None,
        text: None,
        span,
    }
}

/// `pH : unit = expr`, or a variable with the unit in which it is observed.
fn observed_name(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Observation> {
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    let unit = unit::declared(context, &mut children)?;
    if children.skip(Rule::equals) {
        let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
        return Ok(Observation { name: Some(name), unit, ..bare(value) });
    }
    Ok(Observation { unit, ..bare(Expr { span: name.span, kind: ExprKind::Name(name) }) })
}

fn observation_clause(context: &Context<'_>, item: &mut Observation, pair: Pair<'_, Rule>) -> Fallible<()> {
    let mut children = Children::new(pair.clone());
    let Some(clause) = children.pairs.next() else { return Ok(()) };
    match clause.as_rule() {
        Rule::bounds => {
            let mut inner = Children::new(clause);
            inner.skip(Rule::kw_in);
            fill(context, &mut item.bounds, declaration::range(context, &mut inner)?, "in", &pair)
        }
        Rule::noise => fill(context, &mut item.noise, declaration::only_expr(context, clause)?, "noise", &pair),
        Rule::every => fill(context, &mut item.every, declaration::only_expr(context, clause)?, "every", &pair),
        Rule::delay => fill(context, &mut item.delay, declaration::only_expr(context, clause)?, "delay", &pair),
        Rule::text => fill(context, &mut item.text, Context::text(&clause), "text", &pair),
        _ => {
            item.binders.extend(expression::binders(context, clause)?);
            Ok(())
        }
    }
}
