//! Time derivatives of nodes: rates of states by their equations, rates of unknowns as further
//! unknowns.

use super::super::rates::shifted;
use super::super::whole::placed;
use super::jumps::{self, Jump, jumping};
use super::system::{Node, Pool};
use crate::differentiate;
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, Flavour, LoopVar, Loops, Rewritten, Role, VarId, loops_of};
use crate::model::{Model, Quantity, Variable};

/// The rate of a state over a loop.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) extents: Vec<u32>,
    pub(super) at: Affine,
    pub(super) value: ExprId,
    pub(super) span: smpl_dsl::span::Span,
}

/// Known rates.
#[derive(Clone, Debug, Default)]
pub(super) struct Slopes {
    /// Explicit rates of states.
    pub(super) pieces: FastMap<VarId, Vec<Piece>>,
    /// The variable of the rate of a variable.
    pub(super) of: FastMap<VarId, VarId>,
    /// The other way round.
    pub(super) base: FastMap<VarId, VarId>,
}

/// Reasons for a node without a time derivative.
#[derive(Clone, Copy, Debug)]
pub(super) enum NoSlope {
    /// It reads a variable that jumps.
    Jumps(VarId),
    /// It has two values at a place.
    Breaks(Jump),
    /// It is too deep, or contains what cannot be differentiated.
    Form,
}

impl Slopes {
    /// The rates that equations give.
    pub(super) fn new(equations: &[Equation]) -> Slopes {
        let mut slopes = Slopes::default();
        for equation in equations {
            if let EquationForm::Rate { var, at, value } = equation.form {
                let piece = Piece { extents: equation.extents.clone(), at, value, span: equation.span };
                slopes.pieces.entry(var).or_default().push(piece);
            }
        }
        slopes
    }

    /// The variable of the rate of a variable, new or known.
    pub(super) fn variable(&mut self, model: &mut Model, var: VarId) -> VarId {
        if let Some(&known) = self.of.get(&var) {
            return known;
        }
        let Variable { name, len, span, .. } = model.vars[var].clone();
        let new = model.vars.push(Variable { name: format!("der({name})"), role: Role::Algebraic, len, span });
        self.of.insert(var, new);
        self.base.insert(new, var);
        new
    }

    /// Makes the rate of a state an unknown: its equations determine that one, which the state
    /// follows.
    pub(super) fn detach(&mut self, model: &mut Model, nodes: &mut Vec<Node>, pool: &mut Pool, state: VarId) {
        if !self.of.contains_key(&state) {
            let rate = self.variable(model, state);
            self.known_as(model, (nodes, pool), state, rate);
        }
    }

    /// Makes the rate of a state an unknown under a variable that is there.
    pub(super) fn known_as(&mut self, model: &mut Model, (nodes, pool): (&mut Vec<Node>, &mut Pool), state: VarId, rate: VarId) {
        for piece in self.pieces.remove(&state).unwrap_or_default() {
            let own = model.exprs.load(rate, Flavour::Value, piece.at);
            let residual = model.exprs.sub(piece.value, own);
            let Piece { extents, at, span, .. } = piece;
            nodes.push(Node { extents, residual, span, own: Some((rate, at)), order: 0, derivative: None });
        }
        let len = model.vars[state].len;
        (0..i64::from(len)).for_each(|i| pool.set(model, rate, i, true));
        let (extents, at) = whole(len);
        let value = model.exprs.load(rate, Flavour::Value, at);
        let span = model.vars[state].span;
        self.pieces.insert(state, vec![Piece { extents, at, value, span }]);
        self.of.insert(state, rate);
        self.base.insert(rate, state);
    }

    /// The rate of a state where its equations give it in one piece.
    fn explicit(&self, exprs: &mut Exprs, var: VarId, at: Affine, loops: &Loops) -> Option<ExprId> {
        self.pieces.get(&var)?.iter().find_map(|piece| {
            if piece.at == at && piece.extents.iter().zip(loops).all(|(&n, l)| l.is_none_or(|l| l <= n)) {
                return Some(piece.value);
            }
            if at.is_constant() {
                let passes = super::super::rates::passes_at(piece.at, &piece.extents, at)?;
                return Some(shifted(exprs, piece.value, &passes));
            }
            let [n] = piece.extents[..] else { return None };
            let stride = piece.at.strides[0];
            let ahead = at.offset - piece.at.offset;
            if stride == 0 || ahead % stride != 0 || at.strides.iter().any(|s| s % stride != 0) {
                return None;
            }
            let index = Affine { offset: ahead / stride, strides: at.strides.map(|s| s / stride) };
            let (low, high) = index.reach(loops);
            if low < 0 || high >= i64::from(n) { None } else { placed(exprs, piece.value, &[index]) }
        })
    }

    /// The time derivative of a node.
    pub(super) fn differentiated(
        &mut self,
        model: &mut Model,
        (nodes, pool): (&mut Vec<Node>, &mut Pool),
        node: usize,
    ) -> Result<Node, NoSlope> {
        if let Some(var) = jumping(model, nodes[node].residual) {
            return Err(NoSlope::Jumps(var));
        }
        let Node { extents, residual, span, order, .. } = nodes[node].clone();
        let values = |_: VarId, flavour: Flavour| (flavour == Flavour::Value).then_some(differentiate::Column { first: 0, factor: None });
        // Each sum has another counter: addresses have one meaning.
        let residual = differentiate::normalise(&mut model.exprs, extents.len(), residual, &values).map_err(|_| NoSlope::Form)?;
        let doubts = jumps::examine(model, residual).map_err(NoSlope::Breaks)?;
        let around = all_loops(&model.exprs, residual, &extents);
        jumps::watch::watch(model, &doubts, &around, span).map_err(|doubt| NoSlope::Breaks(doubt.refused()))?;
        for state in self.in_several_pieces(model, residual, &extents) {
            self.detach(model, nodes, pool, state);
        }
        let unknowns = model.exprs.loads(residual, |v, f| f == Flavour::Value && model.vars[v].role == Role::Algebraic);
        for (var, ..) in unknowns {
            self.variable(model, var);
        }
        let loops = all_loops(&model.exprs, residual, &extents);
        let roles: Vec<Role> = model.vars.values().map(|v| v.role).collect();
        let (this, roles) = (&*self, &roles);
        let rate_of = |exprs: &mut Exprs, load: Option<(VarId, Flavour, Affine)>| {
            let Some((var, flavour, at)) = load else { return Some(exprs.constant(1.0)) };
            match roles[var.as_u32() as usize] {
                Role::Algebraic if flavour == Flavour::Value => this.of.get(&var).map(|&rate| exprs.load(rate, Flavour::Value, at)),
                Role::State if flavour == Flavour::Value => {
                    this.explicit(exprs, var, at, &loops).or_else(|| Some(exprs.constant(f64::NAN)))
                }
                _ => None,
            }
        };
        let slope = differentiate::total(&mut model.exprs, extents.len(), residual, &rate_of).map_err(|_| NoSlope::Form)?;
        let is_nan = |e: ExprId| model.exprs.as_const(e).is_some_and(f64::is_nan);
        if model.exprs.has_derivative(slope) || model.exprs.below([slope]).any(is_nan) {
            return Err(NoSlope::Form);
        }
        Ok(Node { extents, residual: slope, span, own: None, order: order + 1, derivative: None })
    }

    /// States that an expression reads whose rates no single piece gives.
    fn in_several_pieces(&self, model: &mut Model, residual: ExprId, extents: &[u32]) -> Vec<VarId> {
        let loops = all_loops(&model.exprs, residual, extents);
        let read = model.exprs.loads(residual, |var, flavour| flavour == Flavour::Value && model.vars[var].role == Role::State);
        let mut out: Vec<VarId> = Vec::new();
        for (var, _, at) in read {
            if out.last() != Some(&var) && self.explicit(&mut model.exprs, var, at, &loops).is_none() {
                out.push(var);
            }
        }
        out
    }

    /// The quantity of a rate.
    pub(super) fn quantity(&self, model: &Model, rate: VarId) -> Option<Quantity> {
        let mut base = *self.base.get(&rate)?;
        let mut times = 1;
        while let Some(&below) = self.base.get(&base) {
            (base, times) = (below, times + 1);
        }
        let q = &model.interface.quantities;
        let of = q.states.iter().chain(&q.algebraics).find(|q| q.var == Some(base));
        let per = if times == 1 { model.interface.time.unit.clone() } else { format!("{}^{times}", model.interface.time.unit) };
        let name = model.vars[rate].name.clone();
        let open = |x: f64| vec![x];
        let (axes, unit, scale) = match of {
            Some(q) => (q.axes.clone(), format!("({})/{per}", q.unit), q.scale.clone()),
            None => {
                let labels = (1..=model.vars[rate].len).map(|i| i.to_string()).collect();
                let axes = if model.vars[rate].len == 1 { vec![] } else { vec![crate::model::Axis::Names(labels)] };
                (axes, format!("1/{per}"), vec![1.0])
            }
        };
        Some(Quantity {
            var: Some(rate),
            name,
            axes,
            pattern: None,
            unit,
            text: "rate, an unknown of the reduced system".to_owned(),
            low: open(f64::NEG_INFINITY),
            high: open(f64::INFINITY),
            default: open(0.0),
            scale,
            affine_unit: false,
            structural: false,
            nonnegative: false,
        })
    }
}

/// The loop over a whole variable.
pub(super) fn whole(len: u32) -> (Vec<u32>, Affine) {
    match len {
        1 => (Vec::new(), Affine::constant(0)),
        len => (vec![len], Affine::along(0, LoopVar(0), 1)),
    }
}

/// The widest extent of every loop around or inside of an expression.
pub(super) fn all_loops(exprs: &Exprs, e: ExprId, extents: &[u32]) -> Loops {
    let mut loops = loops_of(extents);
    for below in exprs.below([e]) {
        if let Expr::Reduce { depth, extent, .. } = exprs.node(below) {
            let slot = &mut loops[usize::from(depth.0)];
            *slot = Some(slot.unwrap_or(0).max(extent));
        }
    }
    loops
}

/// Puts the variables of rates in the place of rates of variables.
pub(super) fn replace_rates(model: &mut Model, equations: &mut [Equation], slopes: &Slopes) {
    let of = slopes.of.clone();
    let mut done = Rewritten::default();
    super::super::common::replace_everywhere(model, equations, &mut done, &Exprs::has_derivative, &mut |exprs, node| match node {
        Expr::Load { var, flavour: Flavour::Derivative, at } => of.get(&var).map(|&rate| exprs.load(rate, Flavour::Value, at)),
        _ => None,
    });
}
