//! The control problem: episode, initial values, sampling instants, steady state, conditions and rewards.

pub(in crate::elaborate) mod boxes;
pub(in crate::elaborate) mod initial;
pub(in crate::elaborate) mod instants;
pub(in crate::elaborate) mod order;
pub(in crate::elaborate) mod outputs;
pub(in crate::elaborate) mod parameters;
pub(in crate::elaborate) mod phases;
pub(in crate::elaborate) mod policies;
pub(in crate::elaborate) mod ranges;
pub(in crate::elaborate) mod rewards;
pub(in crate::elaborate) mod settings;
pub(in crate::elaborate) mod unknown;

pub use order::ordered_initial;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::symbols::ScopeId;
use crate::elaborate::episode::phases::Schedule;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::select::items::Item;
use crate::elaborate::{Elaborator, Place, Site};
use crate::ir::{Affine, Builtin, Compare, ExprId, FastMap, Flavour, Nest, Place as Memory, Program, Store, Target, VarId};
use crate::model::{BoxItem, Failure, Reward, Root, RootAction};

/// What the names `success`, `failure`, `timeout` and `reward` stand for.
#[derive(Clone, Copy, Debug)]
pub(in crate::elaborate) struct Outcome {
    success: ExprId,
    failure: ExprId,
    timeout: ExprId,
    reward: Option<ExprId>,
}

/// What is known of the control problem.
#[derive(Default)]
pub(in crate::elaborate) struct Episode<'a> {
    /// What the names of the outcome stand for, once they stand for something.
    pub outcome: Option<Outcome>,
    /// The phases.
    pub schedule: Option<Schedule<'a>>,
    /// Assignments happen only where this holds: in the transition of a phase.
    pub guard: Option<ExprId>,
    /// Elements that have a `next`, by scope and instant.
    pub assigned: FastMap<(ScopeId, String), FastMap<(VarId, i64), Span>>,
    /// Observed numbers with their boxes, for failures on the observation box.
    pub observed_members: Vec<(BoxItem, ExprId)>,
    /// Something asks for the steady state.
    pub uses_steady: bool,
}

/// A condition that ends or costs something.
pub(in crate::elaborate) struct Condition {
    /// Whether it holds.
    pub holds: ExprId,
    /// Whether it is neither true nor false.
    pub unknown: ExprId,
    /// By how much, relative to a range.
    pub excess: ExprId,
    /// Members of its box.
    pub items: Vec<(BoxItem, ExprId)>,
}

impl<'a> Elaborator<'a> {
    pub(in crate::elaborate) fn elaborate_control(&mut self) {
        let blocks = std::mem::take(&mut self.instances.blocks);
        self.instances.blocks = blocks.clone();
        self.settings(&blocks);
        self.parameter_program();
        self.steady_program(&blocks);
        self.initial_programs(&blocks);
        self.disturbance_program();
        self.instant_programs(&blocks);
        self.policies(&blocks);
        self.finish_program(&blocks);
        self.output_program();
        self.invariants(&blocks);
        self.interface();
    }

    /// `success`, `failure`, `timeout`, `reward` in an expression.
    pub(in crate::elaborate) fn outcome_name(&mut self, name: &Ident, _place: &Place) -> Option<Value> {
        let outcome = self.episode.outcome?;
        Some(match name.text.as_str() {
            "success" => Value::truth(outcome.success),
            "failure" => Value::truth(outcome.failure),
            "timeout" => Value::truth(outcome.timeout),
            _ => Value { expr: outcome.reward?, unit: Measure::Bare },
        })
    }

    /// A name with the path of its instance.
    fn path_of(&self, scope: ScopeId, name: &Ident) -> String {
        format!("{}{}", self.symbols.scopes[scope].prefix, name.text)
    }

    fn builtin(&mut self, b: Builtin) -> ExprId {
        self.exprs.load(self.hidden.builtins, Flavour::Value, Affine::constant(b as i64))
    }

    fn flag(&mut self, b: Builtin) -> ExprId {
        let (e, half) = (self.builtin(b), self.exprs.constant(0.5));
        self.exprs.compare(Compare::Lt, half, e)
    }

    /// Failures, successes, constraints, rewards and observations, in the layout of [`crate::model::Finish`].
    fn finish_program(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let observed = self.observations(blocks);
        let mut failures: Vec<(usize, Condition, Failure)> = Vec::new();
        let mut on_reward = Vec::new();
        let mut successes = Vec::new();
        let mut order = 0;
        for (scope, item) in each(blocks) {
            let Item::Other(statement) = item else { continue };
            let place = Place::new(scope, Site::Instant);
            match &statement.kind {
                StatementKind::Fail { name, event, condition, text } => {
                    let failure = Failure {
                        name: self.path_of(scope, name),
                        text: text.clone().unwrap_or_default(),
                        event: *event,
                        items: Vec::new(),
                        on_reward: condition.mentions("reward"),
                    };
                    if ["action_box", "solver", "events", "not_finite"].contains(&name.text.as_str()) {
                        self.report(Diagnostic::error(
                            codes::DUPLICATE_NAME,
                            format!("`{}` is the name of a failure that every model has", name.text),
                            name.span,
                        ));
                    }
                    if failure.on_reward {
                        on_reward.push((order, place, condition, failure));
                    } else {
                        let c = self.failing(condition, &place);
                        if *event && let Some((value, strict)) = self.root_of(condition, &place) {
                            let name = self.path_of(scope, name);
                            self.model.roots.push(Root { name, value, strict, action: RootAction::Fail(order as u32) });
                        }
                        failures.push((order, c, failure));
                    }
                    order += 1;
                }
                StatementKind::Success { name, condition, .. } => {
                    let c = self.condition(condition, &place);
                    successes.push((self.path_of(scope, name), c));
                }
                _ => {}
            }
        }
        let failure = {
            let mut any = self.flag(Builtin::Failed);
            for (_, c, _) in &failures {
                any = self.exprs.or(any, c.holds);
            }
            any
        };
        let no_failure = self.exprs.not(failure);
        let mut success = self.exprs.truth(false);
        for (_, c) in &successes {
            success = self.exprs.or(success, *c);
        }
        let last = self.flag(Builtin::LastStep);
        let end_is_success = self.model.interface.episode.end_is_success;
        if end_is_success {
            success = self.exprs.or(success, last);
        }
        let success = self.exprs.and(no_failure, success);
        let no_success = self.exprs.not(success);
        let timeout = self.exprs.and(no_failure, no_success);
        let timeout = self.exprs.and(timeout, last);
        self.episode.outcome = Some(Outcome { success, failure, timeout, reward: None });
        let rewards = self.rewards(blocks);
        if let Some(outcome) = &mut self.episode.outcome {
            outcome.reward = rewards.get(self.model.interface.default_reward as usize).copied();
        }
        for (at, place, condition, failure) in on_reward {
            let c = self.failing(condition, &place);
            failures.push((at, c, failure));
        }
        failures.sort_by_key(|f| f.0);
        let constraints = self.constraints(blocks);

        let mut scalars: Vec<ExprId> = Vec::new();
        for (_, c, _) in &failures {
            scalars.push(self.or_nan(c.holds, c.unknown));
            scalars.push(c.excess);
        }
        for &(_, holds) in &successes {
            let unknown = self.unknown(holds);
            scalars.push(self.or_nan(holds, unknown));
        }
        scalars.extend(constraints.iter().map(|c| c.1));
        scalars.extend(&rewards);
        let finish = &mut self.model.interface.finish;
        finish.failures = failures.len() as u32;
        finish.successes = successes.len() as u32;
        finish.constraints = constraints.len() as u32;
        finish.rewards = rewards.len() as u32;
        finish.observations = observed.names.len() as u32;
        let stores = scalars.iter().enumerate().map(|(i, &e)| store(Memory::Out, Affine::constant(i as i64), e)).collect();
        let mut program = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: false };
        let base = scalars.len() as i64;
        for nest in observed.nests {
            let stores = nest
                .stores
                .into_iter()
                .map(|mut s| {
                    s.target.at.offset += base;
                    s
                })
                .collect();
            match (nest.extents.is_empty(), program.nests.first_mut()) {
                (true, Some(first)) => first.stores.extend::<Vec<Store>>(stores),
                _ => program.nests.push(Nest { extents: nest.extents, stores }),
            }
        }
        self.model.programs.finish = program;

        let mut boxes = Vec::new();
        for (_, c, failure) in &mut failures {
            for (item, e) in std::mem::take(&mut c.items) {
                failure.items.push(item);
                boxes.push(store(Memory::Out, Affine::constant(boxes.len() as i64), e));
            }
        }
        self.model.programs.boxes = Program { nests: vec![Nest { extents: Vec::new(), stores: boxes }], in_place: false };
        self.model.interface.failures = failures.into_iter().map(|f| f.2).collect();
        self.model.interface.successes = successes.into_iter().map(|s| s.0).collect();
        self.model.interface.constraints = constraints.into_iter().map(|c| c.0).collect();
        self.model.interface.observations = observed.names;
    }

    /// A number or a truth value, NaN where it is unknown.
    fn or_nan(&mut self, value: ExprId, unknown: ExprId) -> ExprId {
        if matches!(self.exprs.node(unknown), crate::ir::Expr::Truth(false)) {
            return value;
        }
        let (nan, value) = (self.exprs.constant(f64::NAN), self.exprs.number(value));
        self.exprs.select(unknown, nan, value)
    }

    fn rewards(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<ExprId> {
        let mut out = Vec::new();
        let mut chosen = None;
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Reward { name, unit, default, value, text }, .. }) = item else { continue };
            let place = Place::new(scope, Site::Instant);
            let unit = match unit {
                Some(u) => self.unit(u, &place).unwrap_or_else(Unit::one),
                None => Unit::one(),
            };
            if *default {
                chosen = Some(out.len());
            }
            let v = self.value(value, &place);
            let what = format!("the reward `{}`", name.text);
            let reward = self.strictly_or_bare(v, &unit, value.span, &what, name.span);
            self.check_limits(&name.text, reward, value.span);
            out.push(reward);
            let name = self.path_of(scope, name);
            self.model.interface.rewards.push(Reward { name, unit: unit.to_string(), text: text.clone().unwrap_or_default() });
        }
        if let Some(wanted) = &self.input.options.reward {
            let names: Vec<String> = self.model.interface.rewards.iter().map(|r| r.name.clone()).collect();
            match names.iter().position(|n| n == wanted) {
                Some(at) => chosen = Some(at),
                None => self.reports.scenario_fault(format!("unknown reward `{wanted}`; the model has {}", names.join(", ")), None),
            }
        }
        self.model.interface.default_reward = chosen.unwrap_or(0) as u32;
        out
    }

    fn constraints(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<(String, ExprId)> {
        let mut out = Vec::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Constraint { name, condition, .. }, .. }) = item else { continue };
            let place = Place::new(scope, Site::Instant);
            let c = self.failing(condition, &place);
            let excess = self.or_nan(c.excess, c.unknown);
            out.push((self.path_of(scope, name), excess));
        }
        out
    }
}

/// All items with their scopes.
pub(in crate::elaborate) fn each<'a, 'b>(blocks: &'b [(ScopeId, Vec<Item<'a>>)]) -> impl Iterator<Item = (ScopeId, Item<'a>)> + 'b {
    blocks.iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i)))
}

/// A store.
pub(in crate::elaborate) fn store(place: Memory, at: Affine, value: ExprId) -> Store {
    Store { target: Target { place, at }, value }
}

/// Name of the random stream of an element.
fn stream_name(path: &str, at: Affine, len: u32) -> String {
    if len == 1 || !at.is_constant() { path.to_owned() } else { format!("{path}[{}]", at.offset) }
}
