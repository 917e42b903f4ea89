//! Variables that nothing declares: random numbers, integrals over the step, what the runtime tells.

use cranelift_entity::PrimaryMap;
use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;

use crate::ir::{BUILTIN_COUNT, ExprId, Role, VarId};
use crate::model::{Draw, Instant, Variable};

/// The variables, each an array that grows as it is used.
#[derive(Debug)]
pub(in crate::elaborate) struct Hidden {
    /// Elements by [`crate::ir::Builtin`].
    pub builtins: VarId,
    /// Which parameters were given.
    pub param_given: VarId,
    /// Random numbers.
    pub draws: Draws,
    /// Integrals over the step.
    pub quadratures: Quadratures,
    /// Old values of what the assignments of one block read and set.
    pub held: Held,
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

impl Hidden {
    /// Declares the variables, without elements but for the builtins.
    pub(in crate::elaborate) fn new(vars: &mut PrimaryMap<VarId, Variable>) -> Self {
        let mut hidden = |name: &str, role| vars.push(Variable { name: name.to_owned(), role, len: 0, span: Span::default() });
        let builtins = hidden("builtin", Role::Builtin);
        let draws = Draws { var: hidden("draw", Role::Draw), list: Vec::new(), site: None };
        let quadratures = Quadratures { var: hidden("quadrature", Role::Quadrature), list: Vec::new(), units: Vec::new() };
        let param_given = hidden("given", Role::ParamGiven);
        let held = Held { var: hidden("held", Role::Discrete), len: 0 };
        vars[builtins].len = BUILTIN_COUNT;
        Hidden { builtins, param_given, draws, quadratures, held, steady: false }
    }

    /// Elements of both arrays: what tells whether an attempt has added some.
    pub(in crate::elaborate) fn len(&self) -> (usize, usize) {
        (self.draws.list.len(), self.quadratures.list.len())
    }

    /// Takes back elements.
    pub(in crate::elaborate) fn truncate(&mut self, (draws, quadratures): (usize, usize)) {
        self.draws.list.truncate(draws);
        self.quadratures.list.truncate(quadratures);
        self.quadratures.units.truncate(quadratures);
    }

    /// Gives the variables their lengths.
    pub(in crate::elaborate) fn close(&self, vars: &mut PrimaryMap<VarId, Variable>) {
        vars[self.draws.var].len = self.draws.list.len() as u32;
        vars[self.quadratures.var].len = self.quadratures.list.len() as u32;
        vars[self.held.var].len = self.held.len;
        vars[self.param_given].len = vars.values().filter(|v| v.role == Role::Param).map(|v| v.len).sum();
    }
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
