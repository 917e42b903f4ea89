//! Undeclared variables: random numbers, integrals over the step, values from the runtime.

use cranelift_entity::PrimaryMap;
use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;

use crate::ir::{Affine, BUILTIN_COUNT, DELAY_SLOTS, ExprId, LoopVar, Nest, Program, Role, Store, Target, VarId};
use crate::model::{Delay, Draw, Instant, Programs, Variable};

/// The variables, each an array that grows as it is used.
#[derive(Debug)]
pub(in crate::elaborate) struct Hidden {
    /// Elements by [`crate::ir::Builtin`].
    pub builtins: VarId,
    /// Given parameters.
    pub param_given: VarId,
    /// Random numbers.
    pub draws: Draws,
    /// Integrals over the step.
    pub quadratures: Quadratures,
    /// Delayed expressions.
    pub delays: Delays,
    /// Old values of what the assignments of one block read and set.
    pub held: Held,
    /// Memory of regular instants, where the model has any.
    pub regular: Option<Regular>,
    /// Something asks for the steady state.
    pub steady: bool,
}

/// Copies of values during an instant.
#[derive(Debug)]
pub(in crate::elaborate) struct Held {
    /// The array.
    pub var: VarId,
    /// Its elements.
    pub len: u32,
}

/// Memory of `at every` and of controllers.
#[derive(Debug)]
pub(in crate::elaborate) struct Regular {
    /// Number of the next instant of each interval.
    pub ticks: VarId,
    /// The intervals, in the unit of time.
    pub intervals: Vec<f64>,
    /// Errors of controllers at their last instants.
    pub errors: Held,
}

impl Regular {
    /// Declares the variables.
    pub(in crate::elaborate) fn new(vars: &mut PrimaryMap<VarId, Variable>) -> Self {
        let mut hidden = |name: &str| vars.push(Variable { name: name.to_owned(), role: Role::Discrete, len: 0, span: Span::default() });
        Regular { ticks: hidden("tick"), intervals: Vec::new(), errors: Held { var: hidden("error"), len: 0 } }
    }
}

/// Standard variates.
#[derive(Debug)]
pub(in crate::elaborate) struct Draws {
    /// The array.
    pub var: VarId,
    /// Its elements.
    pub list: Vec<Draw>,
    /// For whom numbers are drawn now, and when.
    pub site: Option<(String, Instant)>,
}

/// Quadratures.
#[derive(Debug)]
pub(in crate::elaborate) struct Quadratures {
    /// The array.
    pub var: VarId,
    /// Integrands of its elements.
    pub list: Vec<ExprId>,
    /// Units of the integrals; empty where two of one integrand have different ones.
    pub units: Vec<String>,
}

/// Delayed expressions.
#[derive(Debug)]
pub(in crate::elaborate) struct Delays {
    /// The array.
    pub var: VarId,
    /// Calls, in the order of their elements.
    pub list: Vec<Delayed>,
}

/// A call of `delay`.
#[derive(Debug)]
pub(in crate::elaborate) struct Delayed {
    /// Delayed expression, dead time, and value before the start.
    pub values: (ExprId, ExprId, Option<ExprId>),
    /// Extents of the loops around, the outermost first; 1 for a loop that changes nothing.
    pub extents: Vec<u32>,
    /// Known properties.
    pub about: Delay,
}

impl Hidden {
    /// Declares the variables, without elements but for the builtins.
    pub(in crate::elaborate) fn new(vars: &mut PrimaryMap<VarId, Variable>) -> Self {
        let mut hidden = |name: &str, role| vars.push(Variable { name: name.to_owned(), role, len: 0, span: Span::default() });
        let builtins = hidden("builtin", Role::Builtin);
        let draws = Draws { var: hidden("draw", Role::Draw), list: Vec::new(), site: None };
        let quadratures = Quadratures { var: hidden("quadrature", Role::Quadrature), list: Vec::new(), units: Vec::new() };
        let param_given = hidden("given", Role::ParamGiven);
        let delays = Delays { var: hidden("delayed", Role::Delayed), list: Vec::new() };
        let held = Held { var: hidden("held", Role::Discrete), len: 0 };
        vars[builtins].len = BUILTIN_COUNT;
        Hidden { builtins, param_given, draws, quadratures, delays, held, regular: None, steady: false }
    }

    /// Elements of the arrays, which show whether an attempt has added some.
    pub(in crate::elaborate) fn len(&self) -> (usize, usize, usize) {
        (self.draws.list.len(), self.quadratures.list.len(), self.delays.list.len())
    }

    /// Takes back elements.
    pub(in crate::elaborate) fn truncate(&mut self, (draws, quadratures, delays): (usize, usize, usize)) {
        self.delays.list.truncate(delays);
        self.draws.list.truncate(draws);
        self.quadratures.list.truncate(quadratures);
        self.quadratures.units.truncate(quadratures);
    }

    /// Gives the variables their lengths.
    pub(in crate::elaborate) fn close(&self, vars: &mut PrimaryMap<VarId, Variable>) {
        vars[self.draws.var].len = self.draws.list.len() as u32;
        vars[self.quadratures.var].len = self.quadratures.list.len() as u32;
        vars[self.delays.var].len = DELAY_SLOTS * self.delays.len();
        vars[self.held.var].len = self.held.len;
        if let Some(regular) = &self.regular {
            vars[regular.ticks].len = regular.intervals.len() as u32;
            vars[regular.errors.var].len = regular.errors.len;
        }
        vars[self.param_given].len = vars.values().filter(|v| v.role == Role::Param).map(|v| v.len).sum();
    }
}

impl Delays {
    /// Number of elements.
    fn len(&self) -> u32 {
        self.list.iter().map(|delayed| delayed.about.count).sum()
    }

    /// The first element of a call, new or known.
    pub(in crate::elaborate) fn first(&mut self, new: Delayed) -> i64 {
        let mut first = 0;
        for known in &self.list {
            if known.values == new.values && known.extents == new.extents {
                return first;
            }
            first += i64::from(known.about.count);
        }
        self.list.push(new);
        first
    }

    /// The programs that write what is delayed, by how much, and the values before the start.
    pub(in crate::elaborate) fn write(&self, programs: &mut Programs) {
        let mut first = 0;
        for Delayed { values: (value, lag, before), extents, about } in &self.list {
            let target = Target::out(element(extents).plus(Affine::constant(first)));
            let push = |program: &mut Program, value: ExprId| {
                program.nests.push(Nest::over(extents.iter().copied(), vec![Store { target, value }]));
            };
            push(&mut programs.delayed, *value);
            push(&mut programs.lags, *lag);
            before.iter().for_each(|&before| push(&mut programs.before, before));
            first += i64::from(about.count);
        }
    }
}

/// The element of a call of `delay` within loops of these extents.
pub(in crate::elaborate) fn element(extents: &[u32]) -> Affine {
    let mut at = Affine::constant(0);
    for (depth, &extent) in (0..).zip(extents) {
        at = at.times(i64::from(extent));
        if extent > 1 {
            at = at.plus(Affine::along(0, LoopVar(depth), 1));
        }
    }
    at
}

impl Quadratures {
    /// The element that integrates an expression, with the unit of the integral.
    pub(in crate::elaborate) fn element(&mut self, integrand: ExprId, unit: &Unit) -> usize {
        let unit = unit.to_string();
        let Some(at) = self.list.iter().position(|&q| q == integrand) else {
            self.list.push(integrand);
            self.units.push(unit);
            return self.list.len() - 1;
        };
        if self.units[at] != unit {
            self.units[at].clear();
        }
        at
    }
}
