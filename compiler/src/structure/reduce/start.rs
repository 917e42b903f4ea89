//! Numbers at the start, as far as the compiler knows them: they choose between states that a
//! constraint could determine.

use std::hash::{Hash, Hasher};

use crate::interpret::eval_at;
use crate::ir::{Expr, ExprId, Exprs, FastMap, Flavour, MAX_DEPTH, Place, Program, Rewritten, Role, VarId};
use crate::model::{Model, Quantity, Variate};

/// Most passes of a loop of initial values that are worked out.
const MOST: usize = 20_000;

/// Values of elements at the start of a nominal episode.
#[derive(Default)]
pub(super) struct Start {
    known: FastMap<(VarId, i64), f64>,
    /// All values are arbitrary numbers, the same ones in every run.
    anywhere: bool,
}

impl Start {
    /// The start of a model: declared values, computed parameters, initial values of states.
    pub(super) fn of(model: &Model) -> Start {
        let mut start = Start::default();
        let q = &model.interface.quantities;
        for quantity in [&q.parameters, &q.states, &q.algebraics, &q.actions, &q.discretes, &q.disturbances].into_iter().flatten() {
            let Some(var) = quantity.var else { continue };
            let values = (0..quantity.len()).map(|i| (i as i64, Quantity::pick(&quantity.default, i)));
            start.known.extend(values.filter(|(_, x)| x.is_finite()).map(|(i, x)| ((var, i), x)));
        }
        if let Some(draws) = model.vars.iter().find(|(_, v)| v.role == Role::Draw).map(|(var, _)| var) {
            let mean = |kind: Variate| if kind == Variate::Uniform { 0.5 } else { 0.0 };
            start.known.extend(model.interface.draws.iter().enumerate().map(|(i, draw)| ((draws, i as i64), mean(draw.kind))));
        }
        start.run(model, &model.programs.parameters);
        start.run(model, &model.programs.initial_states);
        start
    }

    /// Values of parameters: each declared one that may change is multiplied by a factor, or is the
    /// factor where it is zero; others follow from these.
    pub(super) fn of_parameters(model: &Model, factor: &dyn Fn(VarId, i64) -> f64) -> Start {
        let mut start = Start::default();
        for quantity in &model.interface.quantities.parameters {
            let Some(var) = quantity.var else { continue };
            for i in 0..quantity.len() {
                let (x, part) = (Quantity::pick(&quantity.default, i), factor(var, i as i64));
                let value = if quantity.structural {
                    x
                } else if x == 0.0 {
                    part - 1.0
                } else {
                    x * part
                };
                if value.is_finite() {
                    start.known.insert((var, i as i64), value);
                }
            }
        }
        for (var, v) in model.vars.iter() {
            let hidden = |i: i64| match v.role {
                Role::ParamGiven => Some(0.0),
                Role::Draw => Some(0.5 * factor(var, i)),
                _ => None,
            };
            start.known.extend((0..i64::from(v.len)).filter_map(|i| Some(((var, i), hidden(i)?))));
        }
        start.run(model, &model.programs.parameters);
        start
    }

    /// The same with each unknown somewhere around its value, within its bounds; other numbers for
    /// each `sample`.
    pub(super) fn scattered(&self, model: &Model, sample: i64) -> Start {
        let mut known = self.known.clone();
        let q = &model.interface.quantities;
        for quantity in q.states.iter().chain(&q.algebraics) {
            let Some(var) = quantity.var else { continue };
            for i in 0..quantity.len() {
                let at = |list: &[f64]| Quantity::pick(list, i);
                let value = known.get(&(var, i as i64)).copied().unwrap_or(0.0);
                let wide = 0.5 * value.abs() + 2.0 * if at(&quantity.scale).is_normal() { at(&quantity.scale).abs() } else { 1.0 };
                let part = 2.0 * (somewhere(var, Flavour::Initial, (sample << 32) + i as i64) - 1.0);
                known.insert((var, i as i64), (value + part * wide).max(at(&quantity.low)).min(at(&quantity.high)));
            }
        }
        Start { known, anywhere: false }
    }

    /// The value of an element, where it is known.
    pub(super) fn element(&self, var: VarId, at: i64) -> Option<f64> {
        self.at(var, Flavour::Value, at)
    }

    /// Arbitrary numbers, the same ones in every run.
    pub(super) fn anywhere() -> Start {
        Start { anywhere: true, ..Start::default() }
    }

    fn run(&mut self, model: &Model, program: &Program) {
        for nest in &program.nests {
            let extents = nest.extents();
            let passes: usize = extents.iter().map(|&n| n as usize).product();
            if passes > MOST {
                continue;
            }
            for pass in 0..passes {
                let mut counters = [0; MAX_DEPTH];
                let mut rest = pass;
                for (d, &n) in extents.iter().enumerate().rev() {
                    counters[d] = (rest % n as usize) as i64;
                    rest /= n as usize;
                }
                for store in &nest.stores {
                    let Place::Var(var) = store.target.place else { continue };
                    if let Some(value) = eval_at(&model.exprs, store.value, &mut counters, &|var, flavour, at| self.at(var, flavour, at)) {
                        self.known.insert((var, store.target.at.at(&counters)), value);
                    }
                }
            }
        }
    }

    fn at(&self, var: VarId, flavour: Flavour, at: i64) -> Option<f64> {
        let moves = matches!(flavour, Flavour::Value | Flavour::Initial | Flavour::Previous | Flavour::Steady);
        self.known.get(&(var, at)).copied().filter(|_| moves)
    }

    /// The value of an expression in the first pass of all loops; arbitrary where something in it
    /// is not known.
    pub(super) fn value(&self, exprs: &mut Exprs, e: ExprId) -> f64 {
        let zero = exprs.constant(if self.anywhere { 0.377 } else { 0.0 });
        let still = exprs.rewrite(e, &mut Rewritten::default(), &mut |_, node| (node == Expr::Time).then_some(zero));
        let known = |var: VarId, flavour: Flavour, at: i64| {
            let known = self.at(var, flavour, at).filter(|_| !self.anywhere);
            Some(known.unwrap_or_else(|| somewhere(var, flavour, at)))
        };
        eval_at(exprs, still, &mut [0; MAX_DEPTH], &known).filter(|x| x.is_finite()).unwrap_or(1.0)
    }
}

/// A number between 0.5 and 1.5 for a place in memory.
fn somewhere(var: VarId, flavour: Flavour, at: i64) -> f64 {
    let mut hasher = rustc_hash::FxHasher::default();
    (var, flavour, at, 0x9e37_79b9_7f4a_7c15_u64).hash(&mut hasher);
    0.5 + (hasher.finish().wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
}
