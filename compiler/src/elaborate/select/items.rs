//! The statements of a block as single items, with the active variants and choices worked in.
//!
//! A statement in an active `variant` or `when` block replaces the items with the same key, or is
//! added.

use std::collections::HashMap;
use std::mem::{Discriminant, discriminant};

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{
    Binder, Declaration, Domain, Expr, ExprKind, File, Flux, Form, Ident, Observation, Phase, Role, Statement, StatementKind, TimeTable,
};

/// A statement, with declarations, observations and contents of `at` blocks taken one by one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Item<'a> {
    /// One declaration.
    Declare(Role, &'a Declaration),
    /// One observation.
    Observe(&'a Observation),
    /// One statement of an `at` block.
    At(Moment<'a>, &'a Statement),
    /// Any other statement.
    Other(&'a Statement),
}

/// Instants of an `at` block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment<'a> {
    /// `start`, `end`, the name of an event, or `every`.
    pub name: &'a Ident,
    /// The interval of `every 3 [s]`.
    pub every: Option<&'a Expr>,
}

/// Active variants and chosen options.
#[derive(Clone, Debug, Default)]
pub(crate) struct Selection {
    /// Option of each choice, `true` for a variant that is on.
    pub chosen: HashMap<String, String>,
}

impl Selection {
    pub(in crate::elaborate::select) fn holds(&self, name: &str, option: &str) -> bool {
        self.chosen.get(name).is_some_and(|o| o == option)
    }
}

/// The items of a block under a selection.
pub(crate) fn items<'a>(statements: &'a [Statement], selection: &Selection) -> Vec<Item<'a>> {
    let mut base = plain(statements);
    for body in selected(statements, selection) {
        overlay(&mut base, items(body, selection));
    }
    base
}

/// The items of a block without its variants and choices.
pub(crate) fn plain(statements: &[Statement]) -> Vec<Item<'_>> {
    let mut base = Vec::new();
    for statement in statements {
        push(statement, &mut base);
    }
    specific_last(&mut base);
    base
}

/// Puts start values of more elements before those of fewer: of two that set one element the later
/// one holds, and the order of the text has no meaning.
fn specific_last(items: &mut [Item<'_>]) {
    let of = |item: &Item<'_>| match item {
        Item::Other(Statement { kind: StatementKind::Initial { target, binders, .. }, .. }) => Some(breadth(target, binders)),
        _ => None,
    };
    let at: Vec<usize> = (0..items.len()).filter(|&i| of(&items[i]).is_some()).collect();
    let mut starts: Vec<Item<'_>> = at.iter().map(|&i| items[i]).collect();
    starts.sort_by_key(|item| std::cmp::Reverse(of(item)));
    at.into_iter().zip(starts).for_each(|(i, item)| items[i] = item);
}

/// The breadth of a whole variable.
pub(crate) const WHOLE: usize = 1000;

/// Of how much an entry is: 0 of one element, else the number of indices that it runs over; more
/// than that of a whole variable. Of two entries for one element the one of less breadth holds.
pub(crate) fn breadth(target: &Expr, binders: &[Binder]) -> usize {
    let whole = if matches!(target.kind, ExprKind::Index(..)) { 0 } else { WHOLE };
    whole + binders.len()
}

/// The innermost `variant` or `when` block around a place of the text; `None` outside of all.
pub(crate) fn block_around(files: &[File], place: Span) -> Option<Span> {
    let mut found = None;
    let mut lists: Vec<&[Statement]> = files.iter().map(|file| file.statements.as_slice()).collect();
    while let Some(around) = lists.iter().copied().flatten().find(|s| s.span.contains(place)) {
        lists = match &around.kind {
            StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => {
                found = Some(around.span);
                vec![body.as_slice()]
            }
            StatementKind::Component { body, .. } => vec![body.as_slice()],
            _ => return found,
        };
    }
    found
}

/// The bodies of the active variants and choices of a block, those of a variant behind those that
/// it extends.
pub(crate) fn selected<'a>(statements: &'a [Statement], selection: &Selection) -> impl Iterator<Item = &'a [Statement]> {
    let active = statements.iter().filter_map(|statement| match &statement.kind {
        StatementKind::Variant { name, body, .. } if selection.holds(&name.text, "true") => {
            Some((heirs(statements, name), body.as_slice()))
        }
        StatementKind::When { choice, option, body } if selection.holds(&choice.text, &option.text) => Some((0, body.as_slice())),
        _ => None,
    });
    let mut bodies: Vec<(usize, &[Statement])> = active.collect();
    bodies.sort_by_key(|(bases, _)| *bases);
    bodies.into_iter().map(|(_, body)| body)
}

/// The number of variants that one extends, one behind another.
fn heirs(statements: &[Statement], name: &Ident) -> usize {
    let base = |name: &&Ident| {
        statements.iter().find_map(|statement| match &statement.kind {
            StatementKind::Variant { name: known, extends: Some(base), .. } if known.text == name.text => Some(base),
            _ => None,
        })
    };
    std::iter::successors(base(&name), base).take(statements.len()).count()
}

fn push<'a>(statement: &'a Statement, out: &mut Vec<Item<'a>>) {
    match &statement.kind {
        StatementKind::Declare { role, declarations } => {
            out.extend(declarations.iter().map(|d| Item::Declare(*role, d)));
        }
        StatementKind::Observe { items } => out.extend(items.iter().map(Item::Observe)),
        StatementKind::At { instant, every, body } => {
            let moment = Moment { name: instant, every: every.as_ref() };
            out.extend(body.iter().map(|s| Item::At(moment, s)));
        }
        _ => out.push(Item::Other(statement)),
    }
}

/// Works overriding items into those of a block.
pub(crate) fn overlay<'a>(base: &mut Vec<Item<'a>>, over: Vec<Item<'a>>) {
    if over.is_empty() {
        return;
    }
    let (removals, over): (Vec<Item<'a>>, Vec<Item<'a>>) = over.into_iter().partition(|item| removed(item).is_some());
    for item in removals {
        let before = base.len();
        let Some((kind, target)) = removed(&item) else { continue };
        let is_gone = |other: &Item<'_>| is_removed(other, kind, target);
        let events: Vec<&str> = base.iter().filter(|other| is_gone(other)).filter_map(event).collect();
        base.retain(|other| !is_gone(other) && !moment(other).is_some_and(|name| events.contains(&name)));
        // What removes nothing stays, and is reported.
        if base.len() == before {
            base.push(item);
        }
    }
    let keys: Vec<Option<Key>> = over.iter().map(key).collect();
    let mut replaced: HashMap<&Key, Vec<usize>> = HashMap::new();
    for (i, key) in keys.iter().enumerate() {
        key.iter().for_each(|key| replaced.entry(key).or_default().push(i));
    }
    let mut placed = vec![false; over.len()];
    let mut result = Vec::with_capacity(base.len() + over.len());
    for item in base.drain(..) {
        match key(&item).and_then(|own| replaced.get(&own)) {
            // All overriding items of one key take the place of the first overridden one.
            Some(list) => result.extend(list.iter().filter(|&&i| !std::mem::replace(&mut placed[i], true)).map(|&i| over[i])),
            None => result.push(item),
        }
    }
    result.extend(over.iter().zip(&placed).filter(|(_, p)| !**p).map(|(i, _)| *i));
    *base = result;
}

/// Kind, and name or left side, of the statements that a `remove` takes out.
pub(crate) fn removed<'a>(item: &Item<'a>) -> Option<(Option<&'a Ident>, &'a Expr)> {
    match item {
        Item::Other(Statement { kind: StatementKind::Remove { kind, target }, .. }) => Some((kind.as_ref(), target)),
        _ => None,
    }
}

/// The name of an event.
fn event<'a>(item: &Item<'a>) -> Option<&'a str> {
    match item {
        Item::Other(Statement { kind: StatementKind::Event { name, .. }, .. }) => Some(&name.text),
        _ => None,
    }
}

/// The name of the instant at which a statement of an `at` block runs.
fn moment<'a>(item: &Item<'a>) -> Option<&'a str> {
    match item {
        Item::At(moment, _) if moment.every.is_none() => Some(&moment.name.text),
        _ => None,
    }
}

/// Returns whether a statement is the one to be removed.
fn is_removed(item: &Item<'_>, kind: Option<&Ident>, target: &Expr) -> bool {
    match (kind.map(|kind| kind.text.as_str()), item) {
        (Some("at"), _) => return moment(item).is_some_and(|own| matches!(&target.kind, ExprKind::Name(name) if name.text == own)),
        (Some("every"), Item::At(moment, _)) => return moment.every.is_some_and(|every| Form::of(every) == Form::of(target)),
        (Some("connect"), Item::Other(Statement { kind: StatementKind::Connect { chain, .. }, .. })) => {
            let ends = if let ExprKind::Tuple(ends) = &target.kind { ends.as_slice() } else { std::slice::from_ref(target) };
            return Form::bound(&[], chain) == Form::bound(&[], ends);
        }
        _ => {}
    }
    let same_kind = kind.is_none_or(|kind| kind.text == keyword(item));
    let named = |name: &str| matches!(&target.kind, ExprKind::Name(own) if own.text == name);
    same_kind
        && match key(item) {
            Some(Key::Name(name) | Key::Table(name) | Key::Named(_, name) | Key::Observed(name)) => named(name),
            Some(Key::Observe(form)) => form == Form::of(target),
            Some(Key::Determined(..) | Key::Set(..)) => {
                kind.is_some() && left_side(item).is_some_and(|left| Form::of(left) == Form::of(target))
            }
            Some(Key::Time) | None => false,
        }
}

/// The left side or the target of a statement without a name.
fn left_side<'a>(item: &Item<'a>) -> Option<&'a Expr> {
    let (Item::Other(statement) | Item::At(_, statement)) = item else { return None };
    match &statement.kind {
        StatementKind::Equation { lhs, .. } | StatementKind::StartEquation { lhs, .. } => Some(lhs),
        StatementKind::Initial { target, .. }
        | StatementKind::Next { target, .. }
        | StatementKind::Reset { target, .. }
        | StatementKind::Clamp { target, .. } => Some(target),
        StatementKind::Control(control) => Some(&control.output),
        _ => None,
    }
}

/// The keyword of a statement that may be removed by its kind.
fn keyword(item: &Item<'_>) -> &'static str {
    let statement = match item {
        Item::Declare(role, _) => {
            return match role {
                Role::Param => "param",
                Role::Action => "action",
                Role::State => "state",
                Role::Var => "var",
                Role::Let => "let",
                Role::Discrete => "discrete",
                Role::Disturbance => "disturbance",
                Role::Random => "random",
            };
        }
        Item::Observe(_) => return "observe",
        Item::At(_, statement) | Item::Other(statement) => statement,
    };
    match &statement.kind {
        StatementKind::Equation { .. } => "eq",
        StatementKind::Initial { .. } | StatementKind::StartEquation { .. } => "initial",
        StatementKind::Connect { .. } => "connect",
        StatementKind::Next { .. } => "next",
        StatementKind::Reset { .. } => "reset",
        StatementKind::Clamp { .. } => "clamp",
        StatementKind::Fail { .. } => "fail",
        StatementKind::Success { .. } => "success",
        StatementKind::Constraint { .. } => "constraint",
        StatementKind::Reward { .. } => "reward",
        StatementKind::Policy { .. } => "policy",
        StatementKind::Invariant { .. } => "invariant",
        StatementKind::Level { .. } => "level",
        StatementKind::Event { .. } => "event",
        StatementKind::Phase(_) => "phase",
        StatementKind::Reaction(_) => "reaction",
        StatementKind::Control(_) => "control",
        StatementKind::Model { .. }
        | StatementKind::Import { .. }
        | StatementKind::Time { .. }
        | StatementKind::Unit { .. }
        | StatementKind::Set { .. }
        | StatementKind::Table(_)
        | StatementKind::TimeTable(_)
        | StatementKind::Def { .. }
        | StatementKind::Declare { .. }
        | StatementKind::Domain(_)
        | StatementKind::Flux(_)
        | StatementKind::Connector { .. }
        | StatementKind::Component { .. }
        | StatementKind::Port { .. }
        | StatementKind::Instance { .. }
        | StatementKind::StartSteady { .. }
        | StatementKind::Steady { .. }
        | StatementKind::Observe { .. }
        | StatementKind::Episode { .. }
        | StatementKind::Solver { .. }
        | StatementKind::At { .. }
        | StatementKind::Test { .. }
        | StatementKind::TestStep(_)
        | StatementKind::Variant { .. }
        | StatementKind::Remove { .. }
        | StatementKind::Choice { .. }
        | StatementKind::When { .. } => "",
    }
}

/// Key of a statement: a statement of a variant replaces those of the same key.
#[derive(Debug, PartialEq, Eq, Hash)]
enum Key<'a> {
    /// A declaration, by its name.
    Name(&'a str),
    /// A table, by its first column.
    Table(&'a str),
    /// The time.
    Time,
    /// A statement of a kind with its own names, by kind and name.
    Named(Discriminant<StatementKind>, &'a str),
    /// An observation with a name.
    Observed(&'a str),
    /// An observation without.
    Observe(Form<'a>),
    /// An equation, a start value or a connection, by kind and what it determines.
    Determined(Discriminant<StatementKind>, Form<'a>),
    /// A statement of an instant, by instant, kind and what it sets.
    Set(&'a str, Discriminant<StatementKind>, Form<'a>),
}

fn key<'a>(item: &Item<'a>) -> Option<Key<'a>> {
    Some(match item {
        Item::Declare(_, d) => Key::Name(&d.name.text),
        Item::Observe(o) => match observed(o) {
            Ok(name) => Key::Observed(name),
            Err(form) => Key::Observe(form),
        },
        Item::At(instant, s) => match &s.kind {
            StatementKind::Next { target, binders, .. }
            | StatementKind::Reset { target, binders, .. }
            | StatementKind::Clamp { target, binders, .. } => {
                Key::Set(&instant.name.text, discriminant(&s.kind), Form::bound(binders, [target].into_iter().chain(instant.every)))
            }
            _ => return None,
        },
        Item::Other(s) => return statement_key(&s.kind),
    })
}

fn statement_key(kind: &StatementKind) -> Option<Key<'_>> {
    Some(match kind {
        StatementKind::Equation { lhs: target, binders, .. }
        | StatementKind::StartEquation { lhs: target, binders, .. }
        | StatementKind::Initial { target, binders, .. } => Key::Determined(discriminant(kind), Form::bound(binders, [target])),
        StatementKind::Control(control) => Key::Determined(discriminant(kind), Form::bound(&control.binders, [&control.output])),
        StatementKind::Connect { chain, binders } => Key::Determined(discriminant(kind), Form::bound(binders, chain)),
        StatementKind::Fail { name, .. }
        | StatementKind::Success { name, .. }
        | StatementKind::Constraint { name, .. }
        | StatementKind::Reward { name, .. }
        | StatementKind::Policy { name, .. }
        | StatementKind::Invariant { name, .. }
        | StatementKind::Level { name, .. }
        | StatementKind::Unit { name, .. }
        | StatementKind::Event { name, .. }
        | StatementKind::Phase(Phase { name, .. }) => Key::Named(discriminant(kind), &name.text),
        StatementKind::Flux(Flux { name, .. })
        | StatementKind::Domain(Domain { name, .. })
        | StatementKind::TimeTable(TimeTable { name, .. })
        | StatementKind::Set { name, .. }
        | StatementKind::Def { name, .. }
        | StatementKind::Instance { name, .. } => Key::Name(&name.text),
        StatementKind::Reaction(reaction) => Key::Name(&reaction.declaration.name.text),
        StatementKind::Test { name, .. } => Key::Named(discriminant(kind), name),
        StatementKind::Table(table) => Key::Table(&table.columns.first()?.name.text),
        StatementKind::Time { .. } => Key::Time,
        StatementKind::Model { .. }
        | StatementKind::Import { .. }
        | StatementKind::Declare { .. }
        | StatementKind::Connector { .. }
        | StatementKind::Component { .. }
        | StatementKind::Port { .. }
        | StatementKind::StartSteady { .. }
        | StatementKind::Steady { .. }
        | StatementKind::Observe { .. }
        | StatementKind::Episode { .. }
        | StatementKind::Solver { .. }
        | StatementKind::At { .. }
        | StatementKind::Next { .. }
        | StatementKind::Reset { .. }
        | StatementKind::Clamp { .. }
        | StatementKind::TestStep(_)
        | StatementKind::Remove { .. }
        | StatementKind::Variant { .. }
        | StatementKind::Choice { .. }
        | StatementKind::When { .. } => return None,
    })
}

/// The name of an observation, its own or that of the variable; what it observes where it has none.
pub(crate) fn observed(o: &Observation) -> Result<&str, Form<'_>> {
    match (&o.name, &o.value.kind) {
        (Some(name), _) => Ok(&name.text),
        (None, ExprKind::Name(name)) if o.binders.is_empty() => Ok(&name.text),
        _ => Err(Form::bound(&o.binders, [&o.value])),
    }
}

/// The text of a reference (`J[z.low]`), as a name to be shown; other expressions have none.
pub(crate) fn reference(e: &Expr) -> String {
    let list = |list: &[Expr]| list.iter().map(reference).collect::<Vec<_>>().join(",");
    match &e.kind {
        ExprKind::Name(name) => name.text.clone(),
        ExprKind::Number { value, .. } => value.to_string(),
        ExprKind::Member(base, member) => format!("{}.{}", reference(base), member.text),
        ExprKind::Index(base, index) => format!("{}[{}]", reference(base), list(index)),
        _ => "...".to_owned(),
    }
}
