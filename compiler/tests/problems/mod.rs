//! Flat models built manually, shared by the tests and the benchmark of the back end.
#![allow(dead_code, reason = "each user needs some of them")]

use smpl_compiler::ir::{Affine, BUILTIN_COUNT, ExprId, Flavour, LoopVar, Role, UnaryFn, VarId};
use smpl_compiler::model::{Model, Quantity, Row, Variable};
use smpl_dsl::span::Span;

/// A model under construction.
#[derive(Default)]
pub struct Maker {
    pub model: Model,
}

impl Maker {
    pub fn new() -> Maker {
        let mut maker = Maker::default();
        maker.model.explicit = true;
        maker.variable("builtin", Role::Builtin, BUILTIN_COUNT);
        maker
    }

    pub fn variable(&mut self, name: &str, role: Role, len: u32) -> VarId {
        let var = self.model.vars.push(Variable { name: name.into(), role, len, span: Span::default() });
        if matches!(role, Role::State | Role::Algebraic) {
            self.model.unknowns.push(var);
        }
        var
    }

    /// A scalar parameter or action with its value.
    pub fn input(&mut self, name: &str, role: Role, value: f64) -> ExprId {
        let var = self.variable(name, role, 1);
        let quantity = Quantity {
            var: Some(var),
            name: name.into(),
            axes: vec![],
            pattern: None,
            unit: "1".into(),
            text: String::new(),
            low: vec![f64::NEG_INFINITY],
            high: vec![f64::INFINITY],
            default: vec![value],
            scale: vec![1.0],
            affine_unit: false,
            structural: false,
            nonnegative: false,
        };
        if role == Role::Action {
            self.model.interface.quantities.actions.push(quantity);
        } else {
            self.model.interface.quantities.parameters.push(quantity);
        }
        self.load(var, Affine::default())
    }

    pub fn load(&mut self, var: VarId, at: Affine) -> ExprId {
        self.model.exprs.load(var, Flavour::Value, at)
    }

    pub fn constant(&mut self, x: f64) -> ExprId {
        self.model.exprs.constant(x)
    }

    /// `der(var[at]) = rate` for all counters.
    pub fn rate(&mut self, extents: &[u32], var: VarId, at: Affine, rate: ExprId) {
        let derivative = self.model.exprs.load(var, Flavour::Derivative, at);
        let residual = self.model.exprs.sub(rate, derivative);
        self.row(extents, var, at, residual);
    }

    /// `0 = residual`, the row of `var[at]`.
    pub fn row(&mut self, extents: &[u32], var: VarId, at: Affine, residual: ExprId) {
        self.model.rows.push(Row { extents: extents.to_vec(), var, at, residual, span: Span::default() });
    }
}

/// The cell `offset + l0` of an array.
pub fn cell(offset: i64) -> Affine {
    Affine::along(offset, LoopVar(0), 1)
}

/// The stirred-tank reactor of the specification (Pannocchia and Rawlings 2003): c_A, T in degC, h; actions T_c, q_out.
pub fn reactor() -> Model {
    let mut m = Maker::new();
    let [c, t, h] = ["c_A", "T", "h"].map(|n| m.variable(n, Role::State, 1));
    let p = |m: &mut Maker, name: &str, value: f64| m.input(name, Role::Param, value);
    let (q_in, t_f, c_f) = (p(&mut m, "q_in", 0.1), p(&mut m, "T_f", 76.85), p(&mut m, "c_Af", 1.0));
    let (r, k_0, e_r) = (p(&mut m, "r", 0.219), p(&mut m, "k_0", 7.2e10), p(&mut m, "E_R", 8750.0));
    let (u, rho, c_p) = (p(&mut m, "U", 54.94), p(&mut m, "rho", 1000.0), p(&mut m, "c_p", 0.239));
    let (dh, v_0) = (p(&mut m, "dH", -5e4), p(&mut m, "V_0", 1e-8));
    let (t_c, q_out) = (m.input("T_c", Role::Action, 26.85), m.input("q_out", Role::Action, 0.1));
    let [lc, lt, lh] = [c, t, h].map(|v| m.load(v, Affine::default()));
    let x = &mut m.model.exprs;
    let (pi, two, zero_c) = (x.constant(std::f64::consts::PI), x.constant(2.0), x.constant(273.15));
    let square = x.powi(r, 2);
    let area = x.mul(pi, square);
    let volume = x.mul(area, lh);
    let volume = x.add(volume, v_0);
    let kelvin = x.add(lt, zero_c);
    let exponent = x.div(e_r, kelvin);
    let exponent = x.neg(exponent);
    let exponential = x.unary(UnaryFn::Exp, exponent);
    let k = x.mul(k_0, exponential);
    let rate = x.mul(k, lc);
    let dilution = x.div(q_in, volume);
    let excess_c = x.sub(c_f, lc);
    let feed_c = x.mul(dilution, excess_c);
    let rate_c = x.sub(feed_c, rate);
    let excess_t = x.sub(t_f, lt);
    let feed_t = x.mul(dilution, excess_t);
    let capacity = x.mul(rho, c_p);
    let minus_dh = x.neg(dh);
    let heat = x.div(minus_dh, capacity);
    let heat = x.mul(heat, rate);
    let wall = x.mul(r, capacity);
    let two_u = x.mul(two, u);
    let wall = x.div(two_u, wall);
    let cooling = x.sub(t_c, lt);
    let cooling = x.mul(wall, cooling);
    let rate_t = x.add(feed_t, heat);
    let rate_t = x.add(rate_t, cooling);
    let net = x.sub(q_in, q_out);
    let rate_h = x.div(net, area);
    for (var, rate) in [(c, rate_c), (t, rate_t), (h, rate_h)] {
        m.rate(&[], var, Affine::default(), rate);
    }
    m.model
}

/// Upwind advection with one exponential rate a cell: A, B, C, T over `n` cells, A + B -> C, feed values as parameters.
pub fn advection_reaction(n: u32) -> Model {
    let mut m = Maker::new();
    let species = ["A", "B", "C", "T"].map(|name| m.variable(name, Role::State, n));
    let feeds = [("A_in", 1.0), ("B_in", 1.2), ("C_in", 0.0), ("T_in", 350.0)].map(|(k, v)| m.input(k, Role::Param, v));
    let velocity = m.input("v", Role::Action, 1.0);
    let k_0 = m.input("k_0", Role::Param, 1e6);
    let energy = m.input("E_R", Role::Param, 6000.0);
    let heat = m.input("heat", Role::Param, 40.0);
    let x = &mut m.model.exprs;
    let cells = x.constant(f64::from(n));
    let speed = x.mul(velocity, cells);
    let upwind = |m: &mut Maker, offset: i64, var: VarId, before: ExprId, rate: ExprId, factor: Option<ExprId>| {
        let here = m.load(var, cell(offset));
        let x = &mut m.model.exprs;
        let difference = x.sub(before, here);
        let transport = x.mul(speed, difference);
        match factor {
            Some(factor) => {
                let source = x.mul(factor, rate);
                x.add(transport, source)
            }
            None => x.add(transport, rate),
        }
    };
    for (offset, extent) in [(0i64, 1u32), (1, n - 1)] {
        let at = if offset == 0 { Affine::constant(offset) } else { cell(offset) };
        let extents: &[u32] = if offset == 0 { &[] } else { &[extent] };
        let [a, b, _, t] = species.map(|v| m.load(v, at));
        let x = &mut m.model.exprs;
        let exponent = x.div(energy, t);
        let exponent = x.neg(exponent);
        let exponential = x.unary(UnaryFn::Exp, exponent);
        let k = x.mul(k_0, exponential);
        let ka = x.mul(k, a);
        let rate = x.mul(ka, b);
        let consumed = x.neg(rate);
        for (i, (var, feed)) in species.into_iter().zip(feeds).enumerate() {
            let before = if offset == 0 { feed } else { m.load(var, cell(offset - 1)) };
            let (source, factor) = match i {
                0 | 1 => (consumed, None),
                2 => (rate, None),
                _ => (rate, Some(heat)),
            };
            let value = if offset == 0 {
                let here = m.load(var, at);
                let x = &mut m.model.exprs;
                let difference = x.sub(before, here);
                let transport = x.mul(speed, difference);
                let source = factor.map_or(source, |f| x.mul(f, source));
                x.add(transport, source)
            } else {
                upwind(&mut m, offset, var, before, source, factor)
            };
            m.rate(extents, var, at, value);
        }
    }
    m.model
}
