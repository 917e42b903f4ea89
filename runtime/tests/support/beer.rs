//! The beer of `models/beer.eq`.

use smpl_compiler::ir::{Builtin, ExprId};
use smpl_compiler::model::{Instant, Model, Variate};

use super::{Maker, assign, in_place, out};

const NAMES: [&str; 7] = ["X_A", "X_L", "X_D", "S", "EtOH", "DY", "EA"];
const HIGH: [f64; 7] = [15.0, 15.0, 15.0, 150.0, 150.0, 10.0, 10.0];
const START: [f64; 7] = [0.0, 2.0, 2.0, 130.0, 0.0, 0.0, 0.0];

/// `integrate` is the length integrated in a step of one hour.
pub fn model(integrate: f64, max_steps: u32) -> Model {
    let mut m = Maker::new("Beer", "h");
    let temperature = m.action("T", "degC", 13.0, (9.0, 16.0));
    let (mut vars, mut x) = (Vec::new(), Vec::new());
    for i in 0..7 {
        let unit = if i < 5 { "g/L" } else { "mg/L" };
        let (var, value) = m.state(NAMES[i], unit, START[i], (0.0, HIGH[i]));
        vars.push(var);
        x.push(value);
    }
    let [x_a, x_l, x_d, s, etoh, dy, _] = x[..] else { unreachable!("seven states") };
    let (elapsed_var, elapsed) = m.discrete("elapsed", "h", (0.0, 200.0));
    let (before_var, before) = m.discrete("biomass_before", "g/L", super::OPEN);

    let arrhenius = |m: &mut Maker, a: f64, b: f64| {
        let (a, b, zero) = (m.number(a), m.number(b), m.number(273.15));
        let kelvin = m.model.exprs.add(temperature, zero);
        let ratio = m.model.exprs.div(b, kelvin);
        let sum = m.model.exprs.add(a, ratio);
        m.exp(sum)
    };
    let mu_x0 = arrhenius(&mut m, 108.31, -31934.09);
    let y_ea = arrhenius(&mut m, 89.92, -26589.0);
    let mu_s0 = arrhenius(&mut m, -41.92, 11654.64);
    let mu_l = arrhenius(&mut m, 30.72, -9501.54);
    let mu_dt = arrhenius(&mut m, 130.16, -38313.0);
    let mu_sd0 = arrhenius(&mut m, 33.82, -10033.28);
    let mu_e0 = arrhenius(&mut m, 3.27, -1267.24);
    let k_s = arrhenius(&mut m, -119.63, 34203.95);

    let k_x = m.number(65.0);
    let (mu_dy, mu_ab, one) = (m.number(0.000_127_672), m.number(0.001_138_64), m.number(1.0));
    let e = &mut m.model.exprs;
    let inhibited = e.add(k_x, etoh);
    let growth = e.mul(mu_x0, s);
    let mu_x = e.div(growth, inhibited);
    let settling = e.mul(mu_sd0, k_x);
    let mu_sd = e.div(settling, inhibited);
    let monod = e.add(k_s, s);
    let uptake = e.mul(mu_s0, s);
    let mu_s = e.div(uptake, monod);
    let formation = e.mul(mu_e0, s);
    let mu_e = e.div(formation, monod);
    let part = e.div(etoh, k_x);
    let f = e.sub(one, part);
    let two = e.add(x_a, x_l);
    let biomass = e.add(two, x_d);

    let grown = e.mul(mu_x, x_a);
    let died = e.mul(mu_dt, x_a);
    let woken = e.mul(mu_l, x_l);
    let net = e.sub(grown, died);
    let rate_xa = e.add(net, woken);
    let rate_xl = e.neg(woken);
    let settled = e.mul(mu_sd, x_d);
    let rate_xd = e.sub(died, settled);
    let eaten = e.mul(mu_s, x_a);
    let rate_s = e.neg(eaten);
    let ethanol = e.mul(f, mu_e);
    let rate_etoh = e.mul(ethanol, x_a);
    let sx = e.mul(s, x_a);
    let made = e.mul(mu_dy, sx);
    let dye = e.mul(dy, etoh);
    let reduced = e.mul(mu_ab, dye);
    let rate_dy = e.sub(made, reduced);
    let rate_ea = e.mul(y_ea, grown);
    for (var, rate) in vars.iter().zip([rate_xa, rate_xl, rate_xd, rate_s, rate_etoh, rate_dy, rate_ea]) {
        m.rate(*var, rate);
    }
    m.output("biomass", "g/L", biomass);

    // elapsed and biomass_before
    let hour = m.number(1.0);
    let later = m.model.exprs.add(elapsed, hour);
    m.model.programs.start = in_place(vec![assign(&[(before_var, biomass)])]);
    m.model.programs.end = in_place(vec![assign(&[(elapsed_var, later)])]);
    m.model.programs.initial_discretes = in_place(vec![assign(&[(before_var, biomass)])]);
    initial(&mut m, &vars);
    finish(&mut m, &x, elapsed, biomass, before);
    policy(&mut m);
    m.model.interface.episode =
        smpl_compiler::model::Episode { step: 1.0, integrate, max_steps, error_reward: -200.0, ..smpl_compiler::model::Episode::default() };
    m.done()
}

fn initial(m: &mut Maker, vars: &[smpl_compiler::ir::VarId]) {
    let mut stores: Vec<_> = vars.iter().zip(START).map(|(&var, x)| (var, m.number(x))).collect();
    for (i, low, width) in [(1, 1.8, 0.4), (2, 1.8, 0.4), (3, 117.0, 26.0)] {
        let draw = m.draw(NAMES[i], Variate::Uniform, Instant::Reset);
        let (low, width) = (m.number(low), m.number(width));
        let part = m.model.exprs.mul(width, draw);
        stores[i].1 = m.model.exprs.add(low, part);
    }
    m.model.programs.initial_states = in_place(vec![assign(&stores)]);
}

fn finish(m: &mut Maker, x: &[ExprId], elapsed: ExprId, biomass: ExprId, before: ExprId) {
    let (half, hundredth, fifty) = (m.number(0.5), m.number(0.01), m.number(50.0));
    let little = m.less(biomass, half);
    let change = m.model.exprs.sub(biomass, before);
    let change = m.abs(change);
    let still = m.less(change, hundredth);
    let settled = m.model.exprs.or(little, still);
    let eaten = m.less(x[3], half);
    let strong = m.less(fifty, x[4]);
    let both = m.model.exprs.and(settled, eaten);
    let finished = m.model.exprs.and(both, strong);
    m.success("finished", finished);
    let last = m.builtin(Builtin::LastStep);
    let is_last = m.less(half, last);
    let (prize, penalty, hour) = (m.number(200.0), m.number(-200.0), m.number(-1.0));
    let otherwise = m.model.exprs.select(is_last, penalty, hour);
    let reward = m.model.exprs.select(finished, prize, otherwise);
    m.reward("finish", reward);
    let unit = |i: usize| if i < 5 { "g/L" } else { "mg/L" };
    let mut items: Vec<_> = (0..7).map(|i| (NAMES[i], unit(i), x[i], (0.0, HIGH[i]))).collect();
    items.push(("elapsed", "h", elapsed, (0.0, 200.0)));
    for &(name, unit, value, bounds) in &items {
        m.observe(name, unit, value, bounds);
    }
    m.fail_box("state_box", &items);
}

/// The industrial profile.
fn policy(m: &mut Maker) {
    let n = m.builtin(Builtin::Steps);
    let mut value = m.number(9.0);
    let line = |m: &mut Maker, start: f64, slope: f64, from: f64| {
        let (start, slope, from) = (m.number(start), m.number(slope), m.number(from));
        let x = m.model.exprs.sub(n, from);
        let part = m.model.exprs.mul(slope, x);
        m.model.exprs.add(start, part)
    };
    let pieces = [
        (184.0, 16.0, -8.0 / 15.0, 170.0),
        (170.0, 16.0, 0.0, 0.0),
        (145.0, 14.0, 2.0 / 25.0, 120.0),
        (120.0, 14.0, 0.0, 0.0),
        (25.0, 11.0, 1.0 / 8.0, 0.0),
    ];
    for (until, start, slope, from) in pieces {
        let piece = line(m, start, slope, from);
        let until = m.number(until);
        let holds = m.less(n, until);
        value = m.model.exprs.select(holds, piece, value);
    }
    let program = smpl_compiler::ir::Program { nests: vec![out(&[value], 0)], in_place: false };
    m.model.programs.policies.push(("profile".into(), program));
}
