//! The control problem: episode, initial values, sampling instants, steady state, conditions and rewards.

pub(in crate::elaborate) mod assembly;
pub(in crate::elaborate) mod boxes;
pub(in crate::elaborate) mod finish;
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

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::symbols::{ScopeId, Symbols};
use crate::elaborate::episode::phases::Schedule;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::values::Values;
use crate::elaborate::select::items::Item;
use crate::elaborate::{Elaborator, Place, Site};
use crate::ir::{Affine, Builtin, Compare, ExprId, FastMap, Flavour, Place as Memory, Store, Target, VarId};
use crate::model::{BoxItem, Reward};

/// What the names `success`, `failure`, `timeout` and `reward` stand for.
#[derive(Clone, Copy, Debug)]
pub(in crate::elaborate) struct Outcome {
    /// `success`
    pub success: ExprId,
    /// `failure`
    pub failure: ExprId,
    /// `timeout`
    pub timeout: ExprId,
    /// `reward`, once it is known.
    pub reward: Option<ExprId>,
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

    fn builtin(&mut self, b: Builtin) -> ExprId {
        self.exprs.load(self.hidden.builtins, Flavour::Value, Affine::constant(b as i64))
    }

    pub(in crate::elaborate) fn flag(&mut self, b: Builtin) -> ExprId {
        let (e, half) = (self.builtin(b), self.exprs.constant(0.5));
        self.exprs.compare(Compare::Lt, half, e)
    }

    pub(in crate::elaborate) fn rewards(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<ExprId> {
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
            let reward = self.values().strictly_or_bare(v, &unit, value.span, &what, name.span);
            self.check_limits(&name.text, reward, value.span);
            out.push(reward);
            let name = self.symbols.path_of(scope, name);
            self.model.interface.rewards.push(Reward { name, unit: unit.to_string(), text: text.clone().unwrap_or_default() });
        }
        if let Some(wanted) = &self.input.options.reward {
            let names: Vec<String> = self.model.interface.rewards.iter().map(|r| r.name.clone()).collect();
            match names.iter().position(|n| n == wanted) {
                Some(at) => chosen = Some(at),
                None => self.ledger.reports.scenario_fault(format!("unknown reward `{wanted}`; the model has {}", names.join(", ")), None),
            }
        }
        self.model.interface.default_reward = chosen.unwrap_or(0) as u32;
        out
    }

    pub(in crate::elaborate) fn constraints(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<(String, ExprId)> {
        let mut out = Vec::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Constraint { name, condition, .. }, .. }) = item else { continue };
            let place = Place::new(scope, Site::Instant);
            let c = self.failing(condition, &place);
            let excess = self.values().or_nan(c.excess, c.unknown);
            out.push((self.symbols.path_of(scope, name), excess));
        }
        out
    }
}

impl Values<'_> {
    /// A number or a truth value, NaN where it is unknown.
    pub(in crate::elaborate) fn or_nan(&mut self, value: ExprId, unknown: ExprId) -> ExprId {
        if matches!(self.exprs.node(unknown), crate::ir::Expr::Truth(false)) {
            return value;
        }
        let (nan, value) = (self.exprs.constant(f64::NAN), self.exprs.number(value));
        self.exprs.select(unknown, nan, value)
    }
}

impl<'a> Symbols<'a> {
    /// A name with the path of its instance.
    fn path_of(&self, scope: ScopeId, name: &Ident) -> String {
        format!("{}{}", self.scopes[scope].prefix, name.text)
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
