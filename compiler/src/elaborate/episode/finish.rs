//! End of a step: failures, successes, constraints, rewards and observations.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Expr, Ident, Statement, StatementKind};

use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::boxes::failing;
use crate::elaborate::episode::common::{Condition, builtin, each, flag, store};
use crate::elaborate::episode::instants::{moving_clock, root_of};
use crate::elaborate::episode::observations::observations;
use crate::elaborate::episode::rewards::rewards;
use crate::elaborate::episode::unknown::doubting;
use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::bounded::Bounded;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::outcome::Outcome;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::Value;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, SymbolId};
use crate::ir::{Affine, BinaryFn, Builtin, Compare, ExprId, Place as Memory, Program};
use crate::model::{Episode, Failure, Finish, Root, RootAction};

/// Failures that every model has.
const RESERVED: [&str; 4] = ["action_box", "solver", "events", "not_finite"];

/// The ends that a model declares.
#[derive(Default)]
struct Ends<'a> {
    /// Number, condition and description of each failure.
    failures: Vec<(usize, Condition, Failure)>,
    /// Failures that depend on the reward, which depends on the others.
    on_reward: Vec<(usize, Place, &'a Expr, Failure)>,
    /// Name and condition of each success.
    successes: Vec<(String, ExprId)>,
    /// Of failures that are events.
    roots: Vec<Root>,
}

/// Parts of the end of a step.
#[derive(Default)]
pub(in crate::elaborate) struct Ending {
    /// In the layout of [`Finish::layout`].
    pub program: Program,
    /// The members of the boxes of failures.
    pub boxes: Program,
    /// Outputs of the program.
    pub finish: Finish,
    /// Of failures that are events.
    pub roots: Vec<Root>,
    /// Observation levels.
    pub levels: Vec<String>,
}

/// Failures, successes, constraints, rewards and observations.
pub(in crate::elaborate) fn ending<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)], episode: &mut Episode) -> Ending {
    let observed = observations(l, blocks);
    let mut ends = declared_ends(l, blocks);
    let outcome = outcome(l, &ends, episode.end_is_success);
    l.names.outcome = Some(outcome);
    let given = l.exprs.constant(episode.error_reward);
    l.names.failing = Some(match &l.names.error_reward {
        Some((unit, _)) => Value::of(given, unit.clone()),
        None => Value::bare(given),
    });
    let rewards = rewards(l, blocks, &mut episode.error_reward);
    // In the unit of each reward, as `reward` is.
    l.names.failing = Some(Value::bare(l.exprs.constant(episode.error_reward)));
    let reward = rewards.values.get(rewards.default as usize).copied();
    l.names.outcome = Some(Outcome { reward, ..outcome });
    for (at, place, condition, failure) in std::mem::take(&mut ends.on_reward) {
        let c = failing(l, condition, &place);
        ends.failures.push((at, c, failure));
    }
    ends.failures.sort_by_key(|f| f.0);
    let constraints = constraints(l, blocks);
    let numbers = numbers_of_ends(l, &ends, &constraints, &rewards.values);
    let base = numbers.len() as i64;
    let mut program = Assembly::of_numbers(numbers);
    program.append(observed.nests, base);
    let (boxes, failures) = boxes(ends.failures);
    let finish = Finish {
        failures,
        successes: ends.successes.into_iter().map(|s| s.0).collect(),
        constraints: constraints.into_iter().map(|c| c.0).collect(),
        rewards: rewards.list,
        default_reward: rewards.default,
        observations: observed.names,
    };
    Ending { program: program.program(), boxes, finish, roots: ends.roots, levels: observed.levels }
}

/// The ends that the statements declare.
fn declared_ends<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Ends<'a> {
    let mut ends = Ends::default();
    let mut count = 0;
    for (scope, item) in each(blocks) {
        let Item::Other(statement) = item else { continue };
        match &statement.kind {
            StatementKind::Fail { name, .. } => {
                refuse_reserved(l, name);
                failure(l, scope, statement, count, &mut ends);
                count += 1;
            }
            StatementKind::Success { name, event, condition, .. } => {
                let (name, place) = (l.symbols.path_of(scope, name), Place::new(scope, Site::Instant));
                let holds = l.condition(condition, &place);
                if *event && let Some((value, strict)) = root_of(l, condition, &place) {
                    let action = RootAction::Succeed(ends.successes.len() as u32);
                    ends.roots.push(Root { name: name.clone(), value, strict, action });
                }
                ends.successes.push((name, holds));
            }
            _ => {}
        }
    }
    refused_tables(l, count, &mut ends);
    ends
}

/// A failure for each table that is read outside of its points although that is refused.
fn refused_tables(l: &mut Lowering<'_, '_>, mut count: usize, ends: &mut Ends<'_>) {
    let reads = std::mem::take(&mut l.ledger.speculation.reads.list);
    l.ledger.speculation.reads.closed = true;
    let mut tables: Vec<SymbolId> = Vec::new();
    for (table, _) in &reads {
        if !tables.contains(table) {
            tables.push(*table);
        }
    }
    for table in tables {
        let name = l.symbols[table].path.clone();
        let zero = l.exprs.constant(0.0);
        let mut largest = zero;
        for &(_, excess) in reads.iter().filter(|(symbol, _)| *symbol == table) {
            largest = l.exprs.binary(BinaryFn::Max, largest, excess);
            let value = moving_clock(l, excess);
            ends.roots.push(Root { name: name.clone(), value, strict: true, action: RootAction::Fail(count as u32) });
        }
        let holds = l.exprs.compare(Compare::Lt, zero, largest);
        let unknown = doubting(l).unknown(holds);
        let condition = Condition { holds, unknown, excess: largest, items: Vec::new() };
        let text = format!("the table `{name}` is read outside of its points");
        ends.failures.push((count, condition, Failure { name, text, event: true, items: Vec::new(), on_reward: false }));
        count += 1;
    }
}

fn refuse_reserved(l: &mut Lowering<'_, '_>, name: &Ident) {
    if RESERVED.contains(&name.text.as_str()) {
        let message = format!("`{}` is the name of a failure that every model has", name.text);
        l.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span));
    }
}

/// The failure number `at`, with its root function if it is an event.
fn failure<'a>(l: &mut Lowering<'_, 'a>, scope: ScopeId, statement: &'a Statement, at: usize, ends: &mut Ends<'a>) {
    let StatementKind::Fail { name, event, condition, text } = &statement.kind else { return };
    let place = Place::new(scope, Site::Instant);
    let failure = Failure {
        name: l.symbols.path_of(scope, name),
        text: text.clone().unwrap_or_default(),
        event: *event,
        items: Vec::new(),
        on_reward: condition.mentions("reward"),
    };
    if failure.on_reward {
        ends.on_reward.push((at, place, condition, failure));
        return;
    }
    let c = failing(l, condition, &place);
    if *event && let Some((value, strict)) = root_of(l, condition, &place) {
        let name = failure.name.clone();
        ends.roots.push(Root { name, value, strict, action: RootAction::Fail(at as u32) });
    }
    ends.failures.push((at, c, failure));
}

/// Meaning of `success`, `failure` and `timeout`: a failure overrides a success, and both the last
/// step.
fn outcome(l: &mut Lowering<'_, '_>, ends: &Ends<'_>, end_is_success: bool) -> Outcome {
    let mut failure = flag(l, Builtin::Failed);
    for (_, c, _) in &ends.failures {
        failure = l.exprs.or(failure, c.holds);
    }
    let no_failure = l.exprs.not(failure);
    let mut success = l.exprs.truth(false);
    for (_, holds) in &ends.successes {
        success = l.exprs.or(success, *holds);
    }
    if ends.roots.iter().any(|root| matches!(root.action, RootAction::Succeed(_))) {
        // The condition itself may not hold yet at the instant at which the step stopped for it.
        let (failed, half) = (builtin(l, Builtin::Failed), l.exprs.constant(-0.5));
        let stopped = l.exprs.compare(Compare::Lt, failed, half);
        success = l.exprs.or(success, stopped);
    }
    let last = flag(l, Builtin::LastStep);
    if end_is_success {
        success = l.exprs.or(success, last);
    }
    let success = l.exprs.and(no_failure, success);
    let no_success = l.exprs.not(success);
    let timeout = l.exprs.and(no_failure, no_success);
    let timeout = l.exprs.and(timeout, last);
    Outcome { success, failure, timeout, reward: None }
}

/// The numbers of the output, but for the observations.
fn numbers_of_ends(l: &mut Lowering<'_, '_>, ends: &Ends<'_>, constraints: &[(String, ExprId)], rewards: &[ExprId]) -> Vec<ExprId> {
    let mut numbers = Vec::new();
    for (_, c, _) in &ends.failures {
        numbers.push(l.values().or_nan(c.holds, c.unknown));
        numbers.push(c.excess);
    }
    for &(_, holds) in &ends.successes {
        let unknown = doubting(l).unknown(holds);
        numbers.push(l.values().or_nan(holds, unknown));
    }
    numbers.extend(constraints.iter().map(|c| c.1));
    numbers.extend(rewards);
    numbers
}

/// The values of the members of all boxes, in the order of the failures; the failures with them.
fn boxes(list: Vec<(usize, Condition, Failure)>) -> (Program, Vec<Failure>) {
    let (mut program, mut failures) = (Assembly::default(), Vec::new());
    let mut base = 0;
    for (_, condition, mut failure) in list {
        for Bounded { items, pieces } in condition.items {
            for Piece { extents, value: (at, value) } in pieces {
                program.push(extents, store(Memory::Out, Affine::constant(base).plus(at), value));
            }
            base += items.len() as i64;
            failure.items.extend(items);
        }
        failures.push(failure);
    }
    (program.program(), failures)
}

/// By how much each constraint is violated.
fn constraints<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<(String, ExprId)> {
    let mut out = Vec::new();
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Constraint { name, condition, .. }, .. }) = item else { continue };
        let place = Place::new(scope, Site::Instant);
        let c = failing(l, condition, &place);
        let excess = l.values().or_nan(c.excess, c.unknown);
        out.push((l.symbols.path_of(scope, name), excess));
    }
    out
}
