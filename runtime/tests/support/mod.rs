//! Flat models built manually, as elaboration would make them: the reactor and the beer of `models/`, and small ones.
#![allow(dead_code, reason = "each test file needs some of them")]

pub mod beer;
pub mod pensim;
pub mod reactor;
pub mod reference;
pub mod replay;

use std::sync::Arc;

use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::ir::{
    Affine, BUILTIN_COUNT, Builtin, Compare, ExprId, Flavour, Nest, Place, Program, Role, Store, Target, UnaryFn, VarId,
};
use smpl_compiler::model::{BoxItem, Draw, Failure, Instant, Model, Observed, Quantity, Reward, Row, Time, Variable, Variate};
use smpl_dsl::span::Span;
use smpl_runtime::environment::Environment;
use smpl_runtime::setup::{EnvironmentOptions, Setup};

/// Results of the `finish` program, in its order.
#[derive(Default)]
pub struct Finish {
    pub failures: Vec<(ExprId, ExprId)>,
    pub successes: Vec<ExprId>,
    pub constraints: Vec<ExprId>,
    pub rewards: Vec<ExprId>,
    pub observations: Vec<ExprId>,
}

/// A model under construction; all variables are scalars.
pub struct Maker {
    pub model: Model,
    builtin: VarId,
    draws: VarId,
    pub finish: Finish,
    boxes: Vec<ExprId>,
}

impl Maker {
    pub fn new(name: &str, time_unit: &str) -> Self {
        let mut model = Model { explicit: true, ..Model::default() };
        model.interface.name = name.into();
        model.interface.time = Time { name: "t".into(), unit: time_unit.into() };
        let mut variable = |name: &str, role, len| model.vars.push(Variable { name: name.into(), role, len, span: Span::default() });
        let builtin = variable("builtin", Role::Builtin, BUILTIN_COUNT);
        let draws = variable("draw", Role::Draw, 0);
        Self { model, builtin, draws, finish: Finish::default(), boxes: Vec::new() }
    }

    fn scalar(&mut self, name: &str, role: Role, unit: &str, value: f64, (low, high): (f64, f64)) -> (VarId, Quantity) {
        let var = self.model.vars.push(Variable { name: name.into(), role, len: 1, span: Span::default() });
        let range = high - low;
        let quantity = Quantity {
            var: Some(var),
            name: name.into(),
            axes: vec![],
            pattern: None,
            unit: unit.into(),
            text: String::new(),
            low: vec![low],
            high: vec![high],
            default: vec![value],
            scale: vec![if range.is_finite() { range } else { 1.0 }],
            affine_unit: false,
            structural: false,
            nonnegative: false,
        };
        (var, quantity)
    }

    pub fn param(&mut self, name: &str, unit: &str, value: f64) -> ExprId {
        let (var, quantity) = self.scalar(name, Role::Param, unit, value, OPEN);
        self.model.interface.quantities.parameters.push(quantity);
        self.value(var)
    }

    pub fn action(&mut self, name: &str, unit: &str, nominal: f64, bounds: (f64, f64)) -> ExprId {
        let (var, quantity) = self.scalar(name, Role::Action, unit, nominal, bounds);
        self.model.interface.quantities.actions.push(quantity);
        self.value(var)
    }

    pub fn discrete(&mut self, name: &str, unit: &str, bounds: (f64, f64)) -> (VarId, ExprId) {
        let (var, quantity) = self.scalar(name, Role::Discrete, unit, 0.0, bounds);
        self.model.interface.quantities.discretes.push(quantity);
        (var, self.value(var))
    }

    pub fn disturbance(&mut self, name: &str, unit: &str) -> (VarId, ExprId) {
        let (var, quantity) = self.scalar(name, Role::Disturbance, unit, 0.0, OPEN);
        self.model.interface.quantities.disturbances.push(quantity);
        (var, self.value(var))
    }

    pub fn state(&mut self, name: &str, unit: &str, initial: f64, bounds: (f64, f64)) -> (VarId, ExprId) {
        let (var, quantity) = self.scalar(name, Role::State, unit, initial, bounds);
        self.model.interface.quantities.states.push(quantity);
        self.model.unknowns.push(var);
        (var, self.value(var))
    }

    /// A solved algebraic variable; to be declared after all states.
    pub fn algebraic(&mut self, name: &str, unit: &str, guess: f64, bounds: (f64, f64)) -> (VarId, ExprId) {
        let (var, quantity) = self.scalar(name, Role::Algebraic, unit, guess, bounds);
        self.model.interface.quantities.solved.push(quantity);
        self.model.unknowns.push(var);
        (var, self.value(var))
    }

    /// An output that is an expression.
    pub fn output(&mut self, name: &str, unit: &str, value: ExprId) {
        let at = self.model.interface.quantities.algebraics.len() as i64;
        let quantity = Quantity {
            var: None,
            name: name.into(),
            axes: vec![],
            pattern: None,
            unit: unit.into(),
            text: String::new(),
            low: vec![OPEN.0],
            high: vec![OPEN.1],
            default: vec![0.0],
            scale: vec![1.0],
            affine_unit: false,
            structural: false,
            nonnegative: false,
        };
        self.model.interface.quantities.algebraics.push(quantity);
        self.model.programs.outputs.nests.push(out(&[value], at));
    }

    pub fn value(&mut self, var: VarId) -> ExprId {
        self.load(var, Flavour::Value)
    }

    pub fn load(&mut self, var: VarId, flavour: Flavour) -> ExprId {
        self.model.exprs.load(var, flavour, Affine::constant(0))
    }

    pub fn builtin(&mut self, which: Builtin) -> ExprId {
        self.model.exprs.load(self.builtin, Flavour::Value, Affine::constant(which as i64))
    }

    /// A standard variate.
    pub fn draw(&mut self, stream: &str, kind: Variate, instant: Instant) -> ExprId {
        let at = self.model.interface.draws.len();
        self.model.interface.draws.push(Draw { stream: stream.into(), kind, instant });
        self.model.vars[self.draws].len = at as u32 + 1;
        self.model.exprs.load(self.draws, Flavour::Value, Affine::constant(at as i64))
    }

    pub fn number(&mut self, x: f64) -> ExprId {
        self.model.exprs.constant(x)
    }

    pub fn exp(&mut self, x: ExprId) -> ExprId {
        self.model.exprs.unary(UnaryFn::Exp, x)
    }

    pub fn abs(&mut self, x: ExprId) -> ExprId {
        self.model.exprs.unary(UnaryFn::Abs, x)
    }

    pub fn max(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.model.exprs.binary(smpl_compiler::ir::BinaryFn::Max, a, b)
    }

    pub fn min(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.model.exprs.binary(smpl_compiler::ir::BinaryFn::Min, a, b)
    }

    pub fn less(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.model.exprs.compare(Compare::Lt, a, b)
    }

    /// `d/dt var = rate`
    pub fn rate(&mut self, var: VarId, rate: ExprId) {
        let derivative = self.load(var, Flavour::Derivative);
        let residual = self.model.exprs.sub(rate, derivative);
        self.row(var, residual);
    }

    /// `0 = residual`, the row of `var`.
    pub fn row(&mut self, var: VarId, residual: ExprId) {
        self.model.rows.push(Row { extents: vec![], var, at: Affine::constant(0), residual, span: Span::default() });
    }

    /// The failure of a box, tested at the end of a step.
    pub fn fail_box(&mut self, name: &str, items: &[(&str, &str, ExprId, (f64, f64))]) {
        let exprs = &mut self.model.exprs;
        let mut excess = exprs.constant(0.0);
        let mut all_inside = exprs.truth(true);
        for &(_, _, value, (low, high)) in items {
            let (low_e, high_e) = (exprs.constant(low), exprs.constant(high));
            let (above, below) = (exprs.sub(value, high_e), exprs.sub(low_e, value));
            let beyond = exprs.binary(smpl_compiler::ir::BinaryFn::Max, above, below);
            let range = exprs.constant(high - low);
            let relative = exprs.div(beyond, range);
            excess = exprs.binary(smpl_compiler::ir::BinaryFn::Max, relative, excess);
            let slack = exprs.constant(1e-6);
            let inside = exprs.compare(Compare::Le, relative, slack);
            all_inside = exprs.and(all_inside, inside);
        }
        let fails = exprs.not(all_inside);
        let zero = exprs.constant(0.0);
        let violation = exprs.select(fails, excess, zero);
        self.finish.failures.push((fails, violation));
        self.boxes.extend(items.iter().map(|i| i.2));
        let items = items.iter().map(|&(name, unit, _, (low, high))| BoxItem { name: name.into(), unit: unit.into(), low, high }).collect();
        self.model.interface.finish.failures.push(Failure {
            name: name.into(),
            text: String::new(),
            event: false,
            items,
            on_reward: false,
        });
    }

    /// A failure by condition; `event` for one that a root function finds.
    pub fn fail(&mut self, name: &str, text: &str, event: bool, condition: ExprId) {
        let zero = self.number(0.0);
        self.finish.failures.push((condition, zero));
        self.model.interface.finish.failures.push(Failure { name: name.into(), text: text.into(), event, items: vec![], on_reward: false });
    }

    pub fn reward(&mut self, name: &str, value: ExprId) {
        self.finish.rewards.push(value);
        self.model.interface.finish.rewards.push(Reward { name: name.into(), unit: "1".into(), text: String::new() });
    }

    pub fn observe(&mut self, name: &str, unit: &str, value: ExprId, (low, high): (f64, f64)) {
        self.finish.observations.push(value);
        let observed = Observed { name: name.into(), unit: unit.into(), low, high, every: 1, delay: 0, noise: 0.0 };
        self.model.interface.finish.observations.push(observed);
    }

    pub fn success(&mut self, name: &str, condition: ExprId) {
        self.finish.successes.push(condition);
        self.model.interface.finish.successes.push(name.into());
    }

    /// The model with its `finish` program.
    pub fn done(mut self) -> Model {
        let f = &self.finish;
        let failures = f.failures.iter().flat_map(|(fails, violation)| [*fails, *violation]);
        let parts = [&f.successes, &f.constraints, &f.rewards, &f.observations];
        let all: Vec<ExprId> = failures.chain(parts.into_iter().flatten().copied()).collect();
        self.model.programs.finish = Program { nests: vec![out(&all, 0)], in_place: false };
        self.model.programs.boxes = Program { nests: vec![out(&self.boxes, 0)], in_place: false };
        self.model
    }
}

pub const OPEN: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// Stores values into the output from `first` on.
pub fn out(values: &[ExprId], first: i64) -> Nest {
    let store =
        |(i, &value): (usize, &ExprId)| Store { target: Target { place: Place::Out, at: Affine::constant(first + i as i64) }, value };
    Nest { loops: vec![], stores: values.iter().enumerate().map(store).collect() }
}

/// Stores values into variables, all at once.
pub fn assign(values: &[(VarId, ExprId)]) -> Nest {
    let store = |&(var, value): &(VarId, ExprId)| Store { target: Target { place: Place::Var(var), at: Affine::constant(0) }, value };
    Nest { loops: vec![], stores: values.iter().map(store).collect() }
}

pub fn in_place(nests: Vec<Nest>) -> Program {
    Program { nests, in_place: true }
}

/// Compiles a flat model.
pub fn compile(model: Model) -> Arc<CompiledModel> {
    Arc::new(CompiledModel::build(model, &BackEndSettings::default()).expect("the model compiles"))
}

pub fn setup(model: Model, options: EnvironmentOptions) -> Arc<Setup> {
    Setup::new(compile(model), options, None).expect("the environment can be set up")
}

pub fn environment(model: Model, options: EnvironmentOptions) -> Environment {
    Environment::new(setup(model, options)).expect("the solver takes the system")
}
