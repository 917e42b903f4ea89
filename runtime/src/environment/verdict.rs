//! What a step ended in: failures, successes, rewards, observations, in numbers and in words.

use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::Region;

use super::interval::Outcome;
use super::{Environment, Phase, StepResult};
use crate::failure::{ACTION_BOX, BOX_SLACK, Failure, describe_item, describe_solver};

impl Environment {
    /// Evaluates the end of a step and counts it.
    pub(super) fn judge(&mut self, outcome: Outcome, excess: f64) -> StepResult {
        if !matches!(outcome, Outcome::Solver) {
            self.progress.solver_failure = None;
        }
        self.progress.action_excess = excess;
        let failed_outside = excess > 0.0 || matches!(outcome, Outcome::Solver | Outcome::Event(_));
        self.set_builtin(Builtin::Failed, f64::from(u8::from(failed_outside)));
        self.set_builtin(Builtin::ActionExcess, excess);
        let last_step = self.progress.steps + 1 >= self.setup.max_steps;
        self.set_builtin(Builtin::LastStep, f64::from(u8::from(last_step)));
        self.evaluate_finish(self.end_time());

        self.collect_failures(outcome, excess);
        let mut failure = self.first_failure(outcome, excess);
        let rewards = self.part(3);
        self.progress.rewards.copy_from_slice(&self.finish[rewards]);
        if failure.is_none() && !self.progress.rewards[self.setup.reward..].first().is_none_or(|r| r.is_finite()) {
            failure = Some(Failure::NotFinite);
        }
        let result = self.conclude(failure, last_step);
        self.progress.last = Some(result);
        result
    }

    /// Runs the `finish` program.
    pub(super) fn evaluate_finish(&mut self, t: f64) {
        let (model, memory) = self.system.parts();
        model.finish(memory, t, &self.progress.y, &self.progress.yp, &mut self.finish);
    }

    /// Range of a part of the `finish` output: 0 failures, 1 successes, 2 constraints, 3 rewards, 4 observations.
    pub(super) fn part(&self, index: usize) -> std::ops::Range<usize> {
        let layout = self.setup.model().interface().finish;
        let lengths = [2 * layout.failures, layout.successes, layout.constraints, layout.rewards, layout.observations];
        let start: u32 = lengths[..index].iter().sum();
        start as usize..(start + lengths[index]) as usize
    }

    /// Takes failures and violations from the `finish` output.
    fn collect_failures(&mut self, outcome: Outcome, excess: f64) {
        let (failures, constraints) = (self.part(0), self.part(2));
        let event = match outcome {
            Outcome::Event(index) => Some(index as usize),
            _ => None,
        };
        self.progress.violations[0] = excess;
        let pairs = self.finish[failures].chunks_exact(2);
        let count = pairs.len();
        for (i, pair) in pairs.enumerate() {
            let failing = pair[0] != 0.0 || event == Some(i);
            self.progress.failing[i] = failing;
            // An event stops at the limit itself, and a condition may fail with equality: a breach is never worth nothing.
            self.progress.violations[1 + i] = if failing { pair[1].max(BOX_SLACK) } else { pair[1] };
        }
        self.progress.violations[1 + count..].copy_from_slice(&self.finish[constraints]);
    }

    fn first_failure(&self, outcome: Outcome, excess: f64) -> Option<Failure> {
        if excess > 0.0 {
            return Some(Failure::ActionBox);
        }
        if outcome == Outcome::Solver {
            return Some(Failure::Solver);
        }
        self.progress.failing.iter().position(|f| *f).map(|index| Failure::Declared(index as u32))
    }

    /// Rewards, flags and observation of a step whose failure is known; counts the step.
    fn conclude(&mut self, failure: Option<Failure>, last_step: bool) -> StepResult {
        let episode = &self.setup.model().interface().episode;
        let (error_reward, end_is_success, alone) = (episode.error_reward, episode.end_is_success, episode.failure_pays_alone);
        if failure.is_some() {
            self.progress.rewards.fill(error_reward);
        }
        let met = self.finish[self.part(1)].iter().any(|&s| s != 0.0);
        // A limit below the model's own cuts the batch short.
        let whole = self.setup.max_steps >= episode.max_steps;
        let success = failure.is_none() && (met || (last_step && whole && end_is_success));
        let terminated = failure.is_some() || success;
        let truncated = last_step && !terminated;
        self.progress.steps += 1;
        let dense = self.progress.rewards.get(self.setup.reward).copied().unwrap_or(0.0);
        self.progress.sum += dense;
        let reward = match (self.setup.options.sparse, terminated || truncated) {
            (false, _) => dense,
            (true, true) if alone && failure.is_some() => dense,
            (true, true) => self.progress.sum,
            (true, false) => 0.0,
        };
        if terminated || truncated {
            self.progress.phase = Phase::Over;
        }
        let observations = self.part(4);
        let progress = &mut self.progress;
        self.sensors.read(&mut progress.readings, progress.key, progress.steps, &self.finish[observations]);
        let cost = self.progress.violations.iter().sum();
        StepResult { reward, terminated, truncated, success, failure, cost, time: self.time() }
    }

    /// Every failure of the last step in words, the deciding one first, each beginning with its identifier; empty when nothing failed.
    pub fn failure_message(&mut self) -> String {
        let Some(first) = self.progress.last.and_then(|r| r.failure) else {
            return String::new();
        };
        let mut parts = Vec::new();
        if self.progress.action_excess > 0.0 {
            parts.push(format!("{ACTION_BOX}: {}", self.describe_action()));
        }
        if let Some(failure) = self.progress.solver_failure {
            let setup = &self.setup;
            let text = describe_solver(&failure, setup.model(), &setup.catalogue, setup.sources());
            parts.push(format!("{}: {text}", crate::failure::SOLVER));
        }
        parts.extend(self.describe_declared());
        if first == Failure::NotFinite {
            let reward = &self.setup.model().interface().rewards[self.setup.reward].name;
            parts.push(format!("{}: reward `{reward}` is not finite", crate::failure::NOT_FINITE));
        }
        parts.join("; ")
    }

    fn describe_action(&self) -> String {
        let actions = self.setup.catalogue.actions.elements();
        let present = self.system.region(Region::Action);
        let items: Vec<String> = actions.iter().filter_map(|e| describe_item(&e.into(), present[e.at])).collect();
        if items.is_empty() { "an action is not finite".into() } else { items.join(", ") }
    }

    fn describe_declared(&mut self) -> Vec<String> {
        let setup = std::sync::Arc::clone(&self.setup);
        let interface = setup.model().interface();
        let items: usize = interface.failures.iter().map(|f| f.items.len()).sum();
        let mut values = vec![0.0; items];
        let t = self.time();
        let (model, memory) = self.system.parts();
        model.boxes(memory, t, &self.progress.y, &self.progress.yp, &mut values);
        let mut rest = values.as_slice();
        let mut texts = Vec::new();
        for (index, failure) in interface.failures.iter().enumerate() {
            let (own, others) = rest.split_at(failure.items.len());
            rest = others;
            if !self.progress.failing[index] {
                continue;
            }
            let outside: Vec<String> = failure.items.iter().zip(own).filter_map(|(item, &value)| describe_item(item, value)).collect();
            let text = if outside.is_empty() { failure.text.clone() } else { outside.join(", ") };
            let separator = if text.is_empty() { "" } else { ": " };
            texts.push(format!("{}{separator}{text}", failure.name));
        }
        texts
    }
}

impl From<&crate::catalogue::Element> for smpl_compiler::model::BoxItem {
    fn from(element: &crate::catalogue::Element) -> Self {
        Self { name: element.name.clone(), unit: element.unit.clone(), low: element.low, high: element.high }
    }
}
