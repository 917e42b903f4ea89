//! The reactor of `models/reactor.eq`.

use smpl_compiler::ir::{ExprId, Flavour, VarId};
use smpl_compiler::model::{AlgebraicCounts, Instant, Model, Root, RootAction, Steady, Variate};

use super::{Maker, assign, in_place, out};

const BOUNDS: [(f64, f64); 3] = [(1e-8, 1.0), (1e-8, 100.0), (1e-8, 1.0)];
const SET_POINT_LEGACY: [f64; 3] = [0.877_825_200_557_708_7, 51.346_607_208_251_95, 0.658_999_979_496_002_2];

/// Alternatives of the model.
#[derive(Clone, Copy, Default)]
pub struct Alternatives {
    /// The set-point as printed, 101 steps, an end at the reward floor.
    pub legacy: bool,
}

pub fn model() -> Model {
    build(Alternatives::default())
}

pub fn build(alternatives: Alternatives) -> Model {
    let mut m = Maker::new("Reactor", "min");
    let p = |m: &mut Maker, name, unit, value| m.param(name, unit, value);
    let q_in = p(&mut m, "q_in", "m^3/min", 0.1);
    let t_f = p(&mut m, "T_f", "degC", 76.85);
    let c_af = p(&mut m, "c_Af", "kmol/m^3", 1.0);
    let r = p(&mut m, "r", "m", 0.219);
    let k_0 = p(&mut m, "k_0", "1/min", 7.2e10);
    let e_r = p(&mut m, "E_R", "K", 8750.0);
    let u = p(&mut m, "U", "kJ/(min m^2 K)", 54.94);
    let rho = p(&mut m, "rho", "kg/m^3", 1000.0);
    let c_p = p(&mut m, "c_p", "kJ/(kg K)", 0.239);
    let dh = p(&mut m, "dH", "kJ/kmol", -5.0e4);
    let v_0 = p(&mut m, "V_0", "m^3", 1e-8);
    let spread = p(&mut m, "spread", "1", 0.3);
    let t_c = m.action("T_c", "degC", 26.85, (15.0, 35.0));
    let q_out = m.action("q_out", "m^3/min", 0.1, (0.05, 0.2));
    let (c_a_var, c_a) = m.state("c_A", "kmol/m^3", 0.877_825_2, BOUNDS[0]);
    let (t_var, t) = m.state("T", "degC", 51.346_608_37, BOUNDS[1]);
    let (h_var, h) = m.state("h", "m", 0.659, BOUNDS[2]);

    let x = &mut m.model.exprs;
    let pi = x.constant(std::f64::consts::PI);
    let r2 = x.mul(r, r);
    let area = x.mul(pi, r2);
    let ah = x.mul(area, h);
    let v = x.add(ah, v_0);
    let zero_c = x.constant(273.15);
    let kelvin = x.add(t, zero_c);
    let ratio = x.div(e_r, kelvin);
    let exponent = x.neg(ratio);
    let e = x.unary(smpl_compiler::ir::UnaryFn::Exp, exponent);
    let k = x.mul(k_0, e);
    let rate = x.mul(k, c_a);
    let dilution = x.div(q_in, v);
    let dc = x.sub(c_af, c_a);
    let feed = x.mul(dilution, dc);
    let rate_c = x.sub(feed, rate);
    let dt = x.sub(t_f, t);
    let feed_t = x.mul(dilution, dt);
    let capacity = x.mul(rho, c_p);
    let heat = x.div(dh, capacity);
    let heat_rate = x.mul(heat, rate);
    let two = x.constant(2.0);
    let two_u = x.mul(two, u);
    let r_capacity = x.mul(r, capacity);
    let transfer = x.div(two_u, r_capacity);
    let difference = x.sub(t_c, t);
    let jacket = x.mul(transfer, difference);
    let sum = x.sub(feed_t, heat_rate);
    let rate_t = x.add(sum, jacket);
    let net = x.sub(q_in, q_out);
    let rate_h = x.div(net, area);
    m.rate(c_a_var, rate_c);
    m.rate(t_var, rate_t);
    m.rate(h_var, rate_h);
    m.output("V", "m^3", v);
    m.output("k", "1/min", k);
    m.output("rate", "kmol/(m^3 min)", rate);
    m.model.interface.quantities.algebraic_counts = AlgebraicCounts { declared: 3, solved: 0, substituted: 3 };

    let states = [(c_a_var, c_a), (t_var, t), (h_var, h)];
    steady(&mut m, alternatives, h_var);
    initial(&mut m, spread, &states);
    rewards(&mut m, alternatives, &states);
    let names = [("c_A", "kmol/m^3"), ("T", "degC"), ("h", "m")];
    for i in 0..3 {
        m.observe(names[i].0, names[i].1, states[i].1, BOUNDS[i]);
    }
    let items: Vec<_> = (0..3).map(|i| (names[i].0, names[i].1, states[i].1, BOUNDS[i])).collect();
    m.fail_box("state_box", &items);
    let floor = m.number(1e-8);
    let is_empty = m.less(h, floor);
    m.fail("empty", "the tank has run empty", true, is_empty);
    let distance = m.model.exprs.sub(floor, h);
    m.model.roots.push(Root { name: "empty".into(), value: distance, strict: false, action: RootAction::Fail(1) });
    m.model.interface.episode = smpl_compiler::model::Episode {
        step: 0.1,
        integrate: 0.1,
        max_steps: if alternatives.legacy { 101 } else { 100 },
        error_reward: -1000.0,
        ..smpl_compiler::model::Episode::default()
    };
    // At 1e-8 the error before the ignition of reactor_1 is 6e-6 of the range.
    m.model.interface.solver.rtol = 1e-9;
    if alternatives.legacy {
        let floor = m.number(-1000.0);
        let reward = m.finish.rewards[0];
        let above = m.less(floor, reward);
        let at_floor = m.model.exprs.not(above);
        m.fail("reward_floor", "the reward is at its floor", false, at_floor);
    }
    m.done()
}

fn steady(m: &mut Maker, alternatives: Alternatives, h: VarId) {
    let actions = [m.number(26.85), m.number(0.1)];
    let fixed: Vec<ExprId> = if alternatives.legacy { SET_POINT_LEGACY.map(|x| m.number(x)).into() } else { vec![m.number(0.659)] };
    let all: Vec<ExprId> = actions.into_iter().chain(fixed).collect();
    m.model.programs.steady.nests.push(out(&all, 0));
    let _ = h;
    let fixed = if alternatives.legacy { vec![0, 1, 2] } else { vec![2] };
    m.model.interface.steady = Some(Steady { fixed, given: alternatives.legacy, ..Steady::default() });
}

/// `x ~ steady(x) * uniform(1 - spread, 1 + spread) clip bounds`
fn initial(m: &mut Maker, spread: ExprId, states: &[(VarId, ExprId)]) {
    let mut stores = Vec::new();
    for (i, &(var, _)) in states.iter().enumerate() {
        let name = m.model.vars[var].name.clone();
        let draw = m.draw(&name, Variate::Uniform, Instant::Reset);
        let set_point = m.load(var, Flavour::Steady);
        let (low, high) = (m.number(BOUNDS[i].0), m.number(BOUNDS[i].1));
        let x = &mut m.model.exprs;
        let one = x.constant(1.0);
        let two = x.constant(2.0);
        let from = x.sub(one, spread);
        let width = x.mul(two, spread);
        let part = x.mul(width, draw);
        let factor = x.add(from, part);
        let value = x.mul(set_point, factor);
        let value = m.max(value, low);
        stores.push((var, m.min(value, high)));
    }
    m.model.programs.initial_states = in_place(vec![assign(&stores)]);
}

fn rewards(m: &mut Maker, alternatives: Alternatives, states: &[(VarId, ExprId)]) {
    let now = distance(m, states, Flavour::Value);
    let before = distance(m, states, Flavour::Previous);
    let change = m.model.exprs.sub(now, before);
    let floor = m.number(-1000.0);
    let setpoint = m.max(floor, now);
    m.reward("setpoint", setpoint);
    let change = m.max(floor, change);
    m.reward("setpoint_change", change);
    let _ = alternatives;
}

/// Minus the mean of the squared distances to the set-point, relative to those of the start.
fn distance(m: &mut Maker, states: &[(VarId, ExprId)], flavour: Flavour) -> ExprId {
    let mut sum = m.number(0.0);
    for &(var, _) in states {
        let set_point = m.load(var, Flavour::Steady);
        let (x, start) = (m.load(var, flavour), m.load(var, Flavour::Initial));
        let e = &mut m.model.exprs;
        let off = e.sub(x, set_point);
        let first = e.sub(start, set_point);
        let (off2, first2) = (e.mul(off, off), e.mul(first, first));
        let floor = m.number(1e-8);
        let scale = m.max(first2, floor);
        let e = &mut m.model.exprs;
        let term = e.div(off2, scale);
        sum = e.add(sum, term);
    }
    let third = m.number(-1.0 / 3.0);
    m.model.exprs.mul(third, sum)
}
