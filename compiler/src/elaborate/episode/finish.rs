//! What a step ends in: failures, successes, constraints, rewards and observations.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Expr, Ident, Statement, StatementKind};

use crate::elaborate::declare::symbols::ScopeId;
use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::{Condition, Outcome, each};
use crate::elaborate::select::items::Item;
use crate::elaborate::{Elaborator, Place, Site};
use crate::ir::{Builtin, ExprId};
use crate::model::{Failure, Root, RootAction};

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
}

impl<'a> Elaborator<'a> {
    /// Failures, successes, constraints, rewards and observations, in the layout of [`crate::model::Finish`].
    pub(in crate::elaborate) fn finish_program(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let observed = self.observations(blocks);
        let mut ends = self.declared_ends(blocks);
        let outcome = self.outcome(&ends);
        self.episode.outcome = Some(outcome);
        let rewards = self.rewards(blocks);
        let reward = rewards.get(self.model.interface.default_reward as usize).copied();
        self.episode.outcome = Some(Outcome { reward, ..outcome });
        for (at, place, condition, failure) in std::mem::take(&mut ends.on_reward) {
            let c = self.failing(condition, &place);
            ends.failures.push((at, c, failure));
        }
        ends.failures.sort_by_key(|f| f.0);
        let constraints = self.constraints(blocks);
        let numbers = self.numbers_of_ends(&ends, &constraints, &rewards);

        let finish = &mut self.model.interface.finish;
        finish.failures = ends.failures.len() as u32;
        finish.successes = ends.successes.len() as u32;
        finish.constraints = constraints.len() as u32;
        finish.rewards = rewards.len() as u32;
        finish.observations = observed.names.len() as u32;
        let base = numbers.len() as i64;
        let mut program = Assembly::of_numbers(numbers);
        program.append(observed.nests, base);
        self.model.programs.finish = program.program();
        self.model.interface.observations = observed.names;
        self.model.interface.successes = ends.successes.into_iter().map(|s| s.0).collect();
        self.model.interface.constraints = constraints.into_iter().map(|c| c.0).collect();
        self.box_program(ends.failures);
    }

    /// The ends that the statements declare.
    fn declared_ends(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Ends<'a> {
        let mut ends = Ends::default();
        let mut count = 0;
        for (scope, item) in each(blocks) {
            let Item::Other(statement) = item else { continue };
            match &statement.kind {
                StatementKind::Fail { name, .. } => {
                    self.refuse_reserved(name);
                    self.failure(scope, statement, count, &mut ends);
                    count += 1;
                }
                StatementKind::Success { name, condition, .. } => {
                    let holds = self.condition(condition, &Place::new(scope, Site::Instant));
                    ends.successes.push((self.symbols.path_of(scope, name), holds));
                }
                _ => {}
            }
        }
        ends
    }

    fn refuse_reserved(&mut self, name: &Ident) {
        if RESERVED.contains(&name.text.as_str()) {
            let message = format!("`{}` is the name of a failure that every model has", name.text);
            self.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span));
        }
    }

    /// The failure number `at`, with its root function if it is an event.
    fn failure(&mut self, scope: ScopeId, statement: &'a Statement, at: usize, ends: &mut Ends<'a>) {
        let StatementKind::Fail { name, event, condition, text } = &statement.kind else { return };
        let place = Place::new(scope, Site::Instant);
        let failure = Failure {
            name: self.symbols.path_of(scope, name),
            text: text.clone().unwrap_or_default(),
            event: *event,
            items: Vec::new(),
            on_reward: condition.mentions("reward"),
        };
        if failure.on_reward {
            ends.on_reward.push((at, place, condition, failure));
            return;
        }
        let c = self.failing(condition, &place);
        if *event && let Some((value, strict)) = self.root_of(condition, &place) {
            let name = failure.name.clone();
            self.model.roots.push(Root { name, value, strict, action: RootAction::Fail(at as u32) });
        }
        ends.failures.push((at, c, failure));
    }

    /// What `success`, `failure` and `timeout` stand for: a failure wins over a success, both over the last step.
    fn outcome(&mut self, ends: &Ends<'_>) -> Outcome {
        let mut failure = self.flag(Builtin::Failed);
        for (_, c, _) in &ends.failures {
            failure = self.exprs.or(failure, c.holds);
        }
        let no_failure = self.exprs.not(failure);
        let mut success = self.exprs.truth(false);
        for (_, holds) in &ends.successes {
            success = self.exprs.or(success, *holds);
        }
        let last = self.flag(Builtin::LastStep);
        if self.model.interface.episode.end_is_success {
            success = self.exprs.or(success, last);
        }
        let success = self.exprs.and(no_failure, success);
        let no_success = self.exprs.not(success);
        let timeout = self.exprs.and(no_failure, no_success);
        let timeout = self.exprs.and(timeout, last);
        Outcome { success, failure, timeout, reward: None }
    }

    /// The numbers of the output, but for the observations.
    fn numbers_of_ends(&mut self, ends: &Ends<'_>, constraints: &[(String, ExprId)], rewards: &[ExprId]) -> Vec<ExprId> {
        let mut numbers = Vec::new();
        for (_, c, _) in &ends.failures {
            numbers.push(self.values().or_nan(c.holds, c.unknown));
            numbers.push(c.excess);
        }
        for &(_, holds) in &ends.successes {
            let unknown = self.doubting().unknown(holds);
            numbers.push(self.values().or_nan(holds, unknown));
        }
        numbers.extend(constraints.iter().map(|c| c.1));
        numbers.extend(rewards);
        numbers
    }

    /// The values of the members of all boxes, in the order of the failures.
    fn box_program(&mut self, failures: Vec<(usize, Condition, Failure)>) {
        let mut values = Vec::new();
        for (_, condition, mut failure) in failures {
            for (item, value) in condition.items {
                failure.items.push(item);
                values.push(value);
            }
            self.model.interface.failures.push(failure);
        }
        self.model.programs.boxes = Assembly::of_numbers(values).program();
    }
}
