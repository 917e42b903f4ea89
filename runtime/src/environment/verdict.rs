//! End of a step: failures, successes, rewards, observations, as numbers and text.

use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::Region;
use smpl_compiler::model::Failure as Failed;

use super::finish::FinishPart;
use super::interval::IntervalEnd;
use super::{Environment, Phase, StepResult};
use crate::failure::{ACTION_BOX, BOX_SLACK, EVENTS, Failure, FailureKind, NOT_FINITE, NotFinite, describe_item, describe_solver};

/// Most members of a box that a message names.
const MOST_NAMED: usize = 8;

impl Environment {
    /// Evaluates the end of a step and counts it.
    pub(super) fn judge(&mut self, outcome: IntervalEnd, excess: f64) -> StepResult {
        if !matches!(outcome, IntervalEnd::Solver) {
            self.progress.verdict.solver_failure = None;
        }
        self.progress.verdict.action_excess = excess;
        let ended_inside = !matches!(outcome, IntervalEnd::Completed | IntervalEnd::NotRun | IntervalEnd::Success(_));
        let succeeded = if let IntervalEnd::Success(index) = outcome { Some(index as usize) } else { None };
        let failed = f64::from(u8::from(excess > 0.0 || ended_inside));
        let last_step = self.progress.steps + 1 >= self.setup.max_steps;
        self.set_builtins([
            // A success at its event is -1.
            (Builtin::Failed, if failed == 0.0 && succeeded.is_some() { -1.0 } else { failed }),
            (Builtin::ActionExcess, excess),
            (Builtin::LastStep, f64::from(u8::from(last_step))),
        ]);
        self.evaluate_finish(self.progress.event_time.unwrap_or_else(|| self.end_time()));

        self.collect_failures(outcome, excess);
        self.progress.verdict.rewards.copy_from_slice(self.finish.part(FinishPart::Rewards));
        let mut failure = self.first_failure(outcome, excess);
        self.progress.not_finite = if failure.is_none() { self.not_finite(outcome) } else { None };
        if self.progress.not_finite.is_some() {
            failure = Some(Failure::NotFinite);
        }
        let result = self.conclude(failure, succeeded, last_step);
        self.progress.verdict.last = Some(result);
        result
    }

    /// The first number that is not finite, of those that a step is judged by. Without an
    /// integration nothing has changed.
    fn not_finite(&self, outcome: IntervalEnd) -> Option<NotFinite> {
        if outcome == IntervalEnd::NotRun || self.all_finite() {
            return None;
        }
        let infinite = |part| self.finish.part(part).iter().position(|x| !x.is_finite());
        let condition = |part, stride: usize| self.finish.part(part).iter().step_by(stride).position(|x| x.is_nan());
        let chosen = self.setup.reward;
        let dense = self.progress.verdict.rewards.get(chosen).filter(|r| !r.is_finite()).map(|_| chosen);
        (self.broken_variable())
            .or_else(|| self.integrator.undefined_event().map(NotFinite::Event))
            .or_else(|| dense.or_else(|| infinite(FinishPart::Rewards)).map(NotFinite::Reward))
            .or_else(|| condition(FinishPart::Failures, 2).map(NotFinite::Failure))
            .or_else(|| condition(FinishPart::Successes, 1).map(NotFinite::Success))
            .or_else(|| infinite(FinishPart::Constraints).map(NotFinite::Constraint))
            .or_else(|| infinite(FinishPart::Observations).map(NotFinite::Observation))
    }

    /// Returns `true` if there is nothing to look for: most steps, by sums of 0 * x, which are zero
    /// unless an entry is not finite.
    fn all_finite(&self) -> bool {
        let sum = |values: &[f64]| values.iter().map(|x| x * 0.0).sum::<f64>();
        let undefined = || self.integrator.undefined_event().is_some();
        sum(self.finish.all()) + sum(&self.progress.y) + sum(self.discretes()) == 0.0 && !undefined()
    }

    /// A state or an algebraic variable that is not finite, or a discrete variable that is not a
    /// number.
    pub(super) fn broken_variable(&self) -> Option<NotFinite> {
        let y = &self.progress.y;
        // The sum of 0 * x is zero unless an entry is not finite.
        if y.iter().map(|x| x * 0.0).sum::<f64>() != 0.0 {
            return y.iter().position(|x| !x.is_finite()).map(NotFinite::Unknown);
        }
        self.discretes().iter().position(|x| x.is_nan()).map(NotFinite::Discrete)
    }

    /// Runs the `finish` program.
    pub(super) fn evaluate_finish(&mut self, t: f64) {
        self.system.look_back(t, &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.finish(memory, t, &self.progress.y, &self.progress.yp, self.finish.all_mut());
    }

    /// Takes failures and violations from the `finish` output.
    fn collect_failures(&mut self, outcome: IntervalEnd, excess: f64) {
        let event = match outcome {
            IntervalEnd::Event(index) => Some(index as usize),
            _ => None,
        };
        self.progress.verdict.violations[0] = excess;
        let pairs = self.finish.part(FinishPart::Failures).chunks_exact(2);
        let count = pairs.len();
        for (i, pair) in pairs.enumerate() {
            let failing = pair[0] == 1.0 || event == Some(i);
            self.progress.verdict.failing[i] = failing;
            // An event stops at the limit itself, and a condition may fail with equality: a breach
            // is never worth nothing.
            self.progress.verdict.violations[1 + i] = if failing { pair[1].max(BOX_SLACK) } else { known(pair[1]) };
        }
        for (violation, &excess) in self.progress.verdict.violations[1 + count..].iter_mut().zip(self.finish.part(FinishPart::Constraints))
        {
            *violation = known(excess);
        }
    }

    fn first_failure(&self, outcome: IntervalEnd, excess: f64) -> Option<Failure> {
        if excess > 0.0 {
            return Some(Failure::ActionBox);
        }
        if outcome == IntervalEnd::Solver {
            return Some(Failure::Solver);
        }
        if outcome == IntervalEnd::Chatter {
            return Some(Failure::Events);
        }
        self.progress.verdict.failing.iter().position(|f| *f).map(|index| Failure::Declared(index as u32))
    }

    /// Rewards, flags and observation of a step whose failure is known; counts the step.
    fn conclude(&mut self, failure: Option<Failure>, succeeded: Option<usize>, last_step: bool) -> StepResult {
        let episode = &self.setup.model().interface().episode;
        let (error_reward, end_is_success, alone) = (episode.error_reward, episode.end_is_success, episode.failure_pays_alone);
        if failure.is_some() {
            self.progress.verdict.rewards.fill(error_reward);
        }
        // A limit below the model's own cuts the batch short.
        let whole = last_step && self.setup.max_steps >= episode.max_steps && end_is_success;
        let conditions = self.finish.part(FinishPart::Successes).iter();
        let met = succeeded.or_else(|| conditions.clone().position(|x| *x == 1.0)).or(whole.then_some(conditions.len()));
        let success = failure.is_none() && met.is_some();
        self.progress.verdict.met = met.filter(|_| success).map(|met| met as u32);
        let terminated = failure.is_some() || success;
        let truncated = last_step && !terminated;
        self.progress.steps += 1;
        let dense = self.progress.verdict.rewards.get(self.setup.reward).copied().unwrap_or(0.0);
        self.progress.verdict.sum += dense;
        let reward = match (self.setup.options.sparse, terminated || truncated) {
            (false, _) => dense,
            (true, true) if alone && failure.is_some() => dense,
            (true, true) => self.progress.verdict.sum,
            (true, false) => 0.0,
        };
        if terminated || truncated {
            self.progress.phase = Phase::Over;
        }
        let progress = &mut self.progress;
        let (errors, steps) = (progress.errors(), progress.steps);
        self.sensors.read(&mut progress.readings, errors, steps, self.finish.part(FinishPart::Observations));
        let cost = self.progress.verdict.violations.iter().sum();
        StepResult { reward, terminated, truncated, success, failure, cost, time: self.time() }
    }

    /// Name of the success condition that ended the last step; `end` for the end of a batch of
    /// fixed length, empty where there was none.
    #[must_use]
    pub fn success_name(&self) -> &str {
        let names = &self.setup.model().interface().finish.successes;
        self.progress.verdict.met.map_or("", |met| names.get(met as usize).map_or("end", String::as_str))
    }

    /// Every failure of the last step in words, the deciding one first, each beginning with its
    /// identifier; empty when nothing failed.
    pub fn failure_message(&mut self) -> String {
        if self.progress.verdict.last.is_none_or(|r| r.failure.is_none()) {
            return String::new();
        }
        let mut parts = Vec::new();
        if self.progress.verdict.action_excess > 0.0 {
            parts.push(format!("{ACTION_BOX}: {}", self.describe_action()));
        }
        if let Some(failure) = self.progress.verdict.solver_failure {
            let setup = &self.setup;
            let text = describe_solver(&failure, setup.model(), &setup.catalogue, setup.sources());
            parts.push(format!("{}: {text}", crate::failure::SOLVER));
        }
        if let Some(chatter) = &self.progress.chatter {
            parts.push(format!("{EVENTS}: {}", chatter.describe(self.setup.model(), self.setup.max_events)));
        }
        parts.extend(self.describe_declared());
        if let Some(what) = self.progress.not_finite {
            parts.push(format!("{NOT_FINITE}: {}", what.describe(self.setup.model(), &self.setup.catalogue)));
        }
        parts.join("; ")
    }

    /// Kind of the failure of the last step and, for declared failures, its name. If there are
    /// several, a cause that undid or cut the step comes first: solver, events without end, event,
    /// not finite. Then action box and the declared failures in their order.
    #[must_use]
    pub fn failure_cause(&self) -> (FailureKind, &str) {
        let verdict = &self.progress.verdict;
        if verdict.last.is_none_or(|result| result.failure.is_none()) {
            return (FailureKind::None, "");
        }
        let declared = &self.setup.model().interface().finish.failures;
        let mut failing = declared.iter().zip(&verdict.failing).filter(|(_, failing)| **failing).map(|(failure, _)| failure);
        if verdict.solver_failure.is_some() {
            (FailureKind::Solver, "")
        } else if self.progress.chatter.is_some() {
            (FailureKind::Events, "")
        } else if let Some(failure) = failing.clone().find(|failure| failure.event) {
            (FailureKind::Event, &failure.name)
        } else if self.progress.not_finite.is_some() {
            (FailureKind::NotFinite, "")
        } else if verdict.action_excess > 0.0 {
            (FailureKind::ActionBox, "")
        } else {
            let kind = |failure: &Failed| if failure.items.is_empty() { FailureKind::Condition } else { FailureKind::Box };
            failing.next().map_or((FailureKind::None, ""), |failure| (kind(failure), &failure.name))
        }
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
        let items: usize = interface.finish.failures.iter().map(|f| f.items.len()).sum();
        let mut values = vec![0.0; items];
        let t = self.time();
        self.system.look_back(t, &self.progress.y, &self.progress.yp);
        let (model, memory) = self.system.parts();
        model.boxes(memory, t, &self.progress.y, &self.progress.yp, &mut values);
        let mut rest = values.as_slice();
        let mut texts = Vec::new();
        for (index, failure) in interface.finish.failures.iter().enumerate() {
            let (own, others) = rest.split_at(failure.items.len());
            rest = others;
            if !self.progress.verdict.failing[index] {
                continue;
            }
            let mut outside = failure.items.iter().zip(own).filter_map(|(item, &value)| describe_item(item, value));
            let mut named: Vec<String> = outside.by_ref().take(MOST_NAMED).collect();
            let others = outside.count();
            named.extend((others > 0).then(|| format!("and {others} more")));
            let text = if named.is_empty() { failure.text.clone() } else { named.join(", ") };
            let separator = if text.is_empty() { "" } else { ": " };
            texts.push(format!("{}{separator}{text}", failure.name));
        }
        texts
    }
}

/// A violation; what is not known counts as one by a whole range.
fn known(violation: f64) -> f64 {
    if violation.is_nan() { 1.0 } else { violation }
}

impl From<&crate::catalogue::Element> for smpl_compiler::model::BoxItem {
    fn from(element: &crate::catalogue::Element) -> Self {
        Self { name: element.name.clone(), unit: element.unit.clone(), low: element.low, high: element.high }
    }
}
