//! PenSim against its reference trajectories, the check sums of its specification, and the distributions it draws from.

#[path = "pensim/episodes.rs"]
mod episodes;
mod support;

use smpl_compiler::ir::Builtin;
use smpl_compiler::layout::Region;
use smpl_runtime::environment::{Environment, ResetOptions, Start, StepResult};
use smpl_runtime::load::LoadOptions;
use smpl_runtime::scenario::Variant;
use smpl_runtime::solver::{Ida, Integrator, Method, Settings};
use smpl_runtime::system::CompiledSystem;
use support::pensim::{ACTIONS, Bare, DRAWN, FLOWS, STEPS, environment, options, pensim, replay};
use support::reference::{self, Table};

/// Section 10, "right-hand side": relative to the rate and a thousandth of the scale an hour.
fn right_hand_side(load: &LoadOptions, suffix: impl Fn(&str) -> String) {
    let Some(table) = reference::table("pensim_rhs.csv") else {
        return;
    };
    let loaded = pensim(load);
    let mut bare = Bare::new(&loaded.model);
    let mut worst = (0.0, String::new(), 0);
    for row in 0..table.len() {
        for name in ACTIONS.iter().chain(&FLOWS).chain(&DRAWN).chain(&["z"]) {
            bare.set(name, table.get(row, name));
        }
        let y = bare.y(|name| table.get(row, name));
        let rates = bare.rates(table.get(row, "t"), &y);
        for state in bare.catalogue.states.elements() {
            let expected = table.get(row, &suffix(&state.name));
            let error = (rates[state.at] - expected).abs() / (expected.abs() + 1e-3 * state.scale);
            if worse(error, worst.0) {
                worst = (error, state.name.clone(), row);
            }
        }
    }
    eprintln!("right-hand side: {worst:?}");
    assert!(worst.0 <= 1e-9, "{worst:?}");
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn rates_are_those_of_the_reference() {
    right_hand_side(&LoadOptions::default(), |name| format!("der.{name}"));
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn legacy_rates_are_those_of_the_reference() {
    right_hand_side(&options("legacy", &[]), |name| match name {
        "H" | "visc" => format!("der.{name}.legacy"),
        _ => format!("der.{name}"),
    });
}

fn flow(environment: &Environment, name: &str) -> f64 {
    let element = environment.catalogue().discretes.find(name).expect("a flow");
    environment.discretes()[element.at]
}

/// Returns `true` for the worst error so far, or for NaN.
fn worse(error: f64, than: f64) -> bool {
    error.is_nan() || error > than
}

/// Section 10, "single steps": each step from the reference's own state, inner controllers left out.
fn single_steps(file: &str, scenario: &str, length: f64) {
    let (Some(table), Some(parameters)) = (reference::table(file), reference::table("pensim_parameters.csv")) else {
        return;
    };
    let loaded = pensim(&options(scenario, &[]));
    let episode = if file.contains("_1_") { 0 } else { 1 };
    let mut bare = Bare::new(&loaded.model);
    let states = bare.catalogue.states.elements().to_vec();
    let rtol = 1e-9;
    let mut atol = vec![0.0; states.len()];
    states.iter().for_each(|s| atol[s.at] = 0.01 * rtol * s.scale);
    let mut system = CompiledSystem::new(loaded.model.clone()).expect("a pattern");
    let mut ida = Ida::new(&system, Settings::new(rtol, atol)).expect("settings");
    let mut worst = (0.0, String::new(), 0);
    for row in 1..table.len() {
        for name in ACTIONS.iter().chain(&["z"]) {
            bare.set(name, table.get(row, name));
        }
        DRAWN.iter().for_each(|n| bare.set(n, parameters.get(episode, n)));
        bare.set("mux_max", table.get(row, "mux_max"));
        FLOWS.iter().for_each(|n| bare.set(n, table.get(row, &format!("{n}.tight"))));
        let mut y = bare.y(|name| match name {
            "int_mup" | "int_mue" => 0.0,
            _ => table.get(row - 1, &format!("{name}.tight")),
        });
        bare.prepare();
        system.restore(bare.memory.all());
        let t = 0.2 * (row - 1) as f64;
        ida.forget();
        ida.restart(&mut system, t, &y, None).expect("explicit");
        ida.advance(&mut system, t + length).unwrap_or_else(|e| panic!("{file}, step {row}: {e}"));
        y.copy_from_slice(ida.state());
        let (model, memory) = system.parts();
        model.end(memory, t + length, &mut y);
        for state in &states {
            let expected = table.get(row, &format!("{}.tight", state.name));
            let error = (y[state.at] - expected).abs() / expected.abs().max(state.scale);
            if worse(error, worst.0) {
                worst = (error, state.name.clone(), row);
            }
        }
    }
    eprintln!("single steps of {file}: {worst:?}");
    assert!(worst.0 <= 1e-6, "{file}: {worst:?}");
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn single_steps_are_those_of_the_reference() {
    single_steps("pensim_1_default.csv", "default", 0.2);
    single_steps("pensim_2_default.csv", "default", 0.2);
    single_steps("pensim_2_legacy.csv", "legacy", 0.205);
}

/// Section 10, "controllers": flows from the reference's states of the last three rows and its last flows.
#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn controllers_answer_the_states_of_the_reference_with_its_flows() {
    let Some(parameters) = reference::table("pensim_parameters.csv") else {
        return;
    };
    for episode in [1, 2] {
        let schedule = ["paa_schedule=hours", "paa_schedule=minutes"][episode - 1];
        let loaded = pensim(&options("default", &[schedule]));
        let mut bare = Bare::new(&loaded.model);
        DRAWN.iter().for_each(|n| bare.set(n, parameters.get(episode - 1, n)));
        for scenario in ["default", "legacy"] {
            let Some(table) = reference::table(&format!("pensim_{episode}_{scenario}.csv")) else {
                return;
            };
            for row in 1..table.len() {
                check_controllers(&mut bare, &table, row);
            }
        }
    }
}

fn check_controllers(bare: &mut Bare<'_>, table: &Table, row: usize) {
    let before = |steps: usize, name: &str| {
        // In steps 1 and 2 the memory is filled with the present value, so that the start is never seen again.
        let first = usize::from(row > 2);
        table.get(row.saturating_sub(steps).max(first), &format!("{name}.tight"))
    };
    for (steps, (ph, temperature)) in [(2, ("pH_1", "T_1")), (3, ("pH_2", "T_2"))] {
        bare.set(ph, -before(steps, "H").log10());
        bare.set(temperature, before(steps, "T"));
    }
    bare.set("PAA_1", before(2, "PAA"));
    for name in FLOWS {
        bare.set(name, if row == 1 { 0.0 } else { before(1, name) });
    }
    bare.memory.region_mut(Region::Builtin)[Builtin::Steps as usize] = (row - 1) as f64;
    let mut y = bare.y(|name| before(1, name));
    bare.prepare();
    bare.model.start(&mut bare.memory, 0.2 * (row - 1) as f64, &mut y);
    for name in FLOWS {
        let expected = table.get(row, &format!("{name}.tight"));
        let error = (bare.discrete(name) - expected).abs();
        assert!(error <= 1e-9 + 1e-12 * expected.abs(), "{name}, step {row}: {error:e}");
    }
}

/// Largest errors of a replayed episode.
#[derive(Debug, Default)]
struct Worst {
    /// By the measure of section 10, with its place.
    state: (f64, String, usize),
    /// S in its worst step (where growth is switched off within the step), which is not in `state`.
    switch: (f64, String, usize),
    flow: f64,
    reward: f64,
    sum: f64,
}

impl Worst {
    fn take_state(&mut self, error: (f64, String, usize)) {
        if worse(error.0, self.state.0) {
            self.state = error;
        }
    }
}

/// Replays an episode of the reference in closed loop.
fn closed_loop(episode: usize, scenario: &str, method: &str, rtol: f64, suffix: &str) -> Option<Worst> {
    let parameters = reference::table("pensim_parameters.csv")?;
    let table = reference::table(&format!("pensim_{episode}_{scenario}.csv"))?;
    let schedule = ["paa_schedule=hours", "paa_schedule=minutes"][episode - 1];
    let mut loaded = pensim(&options(scenario, &[schedule]));
    loaded.options.solver.method = Some(Method::from_name(method).expect("a method"));
    let mut env = environment(loaded, Some(rtol));
    env.reset(Some(0), &replay(episode, &parameters, &table, suffix)).expect("a start");
    let mut worst = Worst::default();
    let (mut sum, mut expected_sum) = (0.0, 0.0);
    let states: Vec<_> = env.catalogue().states.elements().to_vec();
    let known = |name: &str| table.names().any(|n| n == format!("{name}{suffix}"));
    let states: Vec<_> = states.into_iter().filter(|s| known(&s.name)).collect();
    for row in 1..table.len() {
        let result = env.step(&table.row(row, &ACTIONS)).expect("a finite action");
        let last_of_legacy = scenario == "legacy" && row == STEPS;
        assert_eq!(result.failure.is_some(), last_of_legacy, "step {row}: {}", env.failure_message());
        for state in &states {
            let expected = table.get(row, &format!("{}{suffix}", state.name));
            let error = (env.unknowns()[state.at] - expected).abs() / expected.abs().max(state.scale);
            if worse(error, worst.switch.0) && state.name == "S" {
                // The worst S so far is one of all the others now.
                let last = std::mem::replace(&mut worst.switch, (error, "S".into(), row));
                worst.take_state(last);
            } else {
                worst.take_state((error, state.name.clone(), row));
            }
        }
        for name in FLOWS {
            let error = (flow(&env, name) - table.get(row, &format!("{name}{suffix}"))).abs();
            worst.flow = worst.flow.max(error);
        }
        if !last_of_legacy {
            let expected = table.get(row, &format!("yield{suffix}"));
            worst.reward = worst.reward.max((result.reward - expected).abs());
            sum += result.reward;
            expected_sum += expected;
        }
    }
    worst.sum = (sum - expected_sum).abs();
    eprintln!("episode {episode}, {scenario}, {method}, rtol {rtol:e}, {suffix}: {worst:?} {:?}", env.statistics());
    Some(worst)
}

const METHODS: [&str; 4] = ["ida", "rosenbrock", "explicit", "auto"];

const EPISODES: [(usize, &str); 4] = [(1, "default"), (1, "legacy"), (2, "default"), (2, "legacy")];

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn closed_loops_at_tight_tolerances_follow_the_reference() {
    for ((episode, scenario), method) in EPISODES.into_iter().flat_map(|case| METHODS.map(|method| (case, method))) {
        let Some(worst) = closed_loop(episode, scenario, method, 1e-9, ".tight") else {
            return;
        };
        assert!(worst.state.0.max(worst.switch.0) <= 1e-5, "{method}: {worst:?}");
        assert!(worst.flow <= 1e-3, "{method}: {worst:?}");
        assert!(worst.reward <= 1e-5 && worst.sum <= 1e-3, "{method}: {worst:?}");
    }
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn closed_loops_at_everyday_tolerances_follow_the_reference() {
    for ((episode, scenario), method) in EPISODES.into_iter().flat_map(|case| METHODS.map(|method| (case, method))) {
        let Some(worst) = closed_loop(episode, scenario, method, 1e-6, ".tight") else {
            return;
        };
        assert!(worst.switch.0 <= 1e-2 && worst.state.0 <= 1e-4, "{method}: {worst:?}");
        assert!(worst.sum <= 1e-2, "{method}: {worst:?}");
    }
}

#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn legacy_follows_the_trajectory_of_the_original_solver() {
    for episode in [1, 2] {
        let Some(worst) = closed_loop(episode, "legacy", "ida", 1e-9, ".orig") else {
            return;
        };
        assert!(worst.state.0.max(worst.switch.0) <= 1e-4 && worst.sum <= 1e-2, "{worst:?}");
    }
}

/// The recipe from means without disturbances: sum of the rewards (the last one as the process gives it) and results.
fn recipe(load: &LoadOptions, rtol: f64) -> (f64, Vec<StepResult>, Environment) {
    let mut env = environment(pensim(load), Some(rtol));
    let start = ResetOptions { start: Start::Nominal, ..ResetOptions::default() };
    env.reset(Some(0), &start).expect("a start");
    let mut action = vec![0.0; ACTIONS.len()];
    let mut results = Vec::new();
    let mut sum = 0.0;
    while env.is_running() {
        env.policy(0, &mut action);
        let result = env.step(&action).expect("a finite action");
        sum += result.reward;
        results.push(result);
    }
    (sum, results, env)
}

fn repaired(name: &str) -> LoadOptions {
    LoadOptions { variants: vec![Variant { name: name.into(), option: None }], ..options("default", &["disturbances=false"]) }
}

/// Section 7.1, first row (default); legacy loses its last reward to the observed pH.
#[test]
fn the_recipe_yields_what_the_specification_says() {
    let (sum, results, _) = recipe(&options("default", &["disturbances=false"]), 1e-8);
    assert!((sum - 3493.6129).abs() <= 1e-3, "{sum}");
    let last = results.last().expect("steps");
    assert_eq!(results.len(), STEPS);
    assert!(last.terminated && last.success && !last.truncated);

    let legacy = options("legacy", &["disturbances=false", "paa_schedule=hours"]);
    let (sum, results, mut env) = recipe(&legacy, 1e-8);
    let last = results.last().expect("steps");
    assert_eq!((results.len(), last.reward), (STEPS, -100.0));
    assert!(last.terminated && !last.success && last.failure.is_some());
    let message = env.failure_message();
    assert!(message.starts_with("observation_box") && message.contains("pH"), "{message}");
    if let Some(table) = reference::table("pensim_1_legacy.csv") {
        let whole = sum + 100.0 + table.get(STEPS, "yield.tight");
        assert!((whole - 3547.1745).abs() <= 1e-3, "{whole}");
    }
}

/// Section 7.2, column "yield, episode 1", printed with two decimals.
#[test]
fn each_repair_changes_the_yield_as_the_specification_says() {
    let repairs = [
        ("vacuole_flux", 3632.51),
        ("oil_volume", 3484.85),
        ("gross_uptake", 3490.61),
        ("aerated_height", 3493.61),
        ("net_charge", 3501.15),
        ("viscosity_floor", 3493.61),
        ("harvest_volume", 3364.13),
        ("pid_setpoint", 3493.67),
        ("pid_heating", 3493.68),
        ("clamp_zero", 3493.58),
    ];
    for (name, expected) in repairs {
        let (sum, ..) = recipe(&repaired(name), 1e-6);
        eprintln!("{name}: {sum:.4}");
        assert!((sum - expected).abs() <= 0.0051 + 5e-3, "{name}: {sum}, expected {expected}");
    }
}

/// The compiled Jacobian against central differences of the rates, entry by entry, in units of the states' scales.
#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn the_jacobian_is_the_slope_of_the_rates() {
    let Some(table) = reference::table("pensim_rhs.csv") else {
        return;
    };
    let loaded = pensim(&LoadOptions::default());
    let mut bare = Bare::new(&loaded.model);
    let states = bare.catalogue.states.elements().to_vec();
    let n = states.len();
    for row in [1, 5, 10, 20] {
        for name in ACTIONS.iter().chain(&FLOWS).chain(&DRAWN).chain(&["z"]) {
            bare.set(name, table.get(row, name));
        }
        let y = bare.y(|name| table.get(row, name));
        let t = table.get(row, "t");
        bare.prepare();
        let pattern = loaded.model.pattern();
        let mut values = vec![0.0; pattern.nonzeros()];
        let cj = 3.0;
        loaded.model.jacobian(&mut bare.memory, t, &y, &vec![0.0; n], cj, &mut values);
        for column in &states {
            let size = y[column.at].abs().max(column.scale);
            let mut slope = |step: f64| {
                let mut moved = y.clone();
                moved[column.at] += step * size;
                let up = bare.rates(t, &moved);
                moved[column.at] -= 2.0 * step * size;
                let down = bare.rates(t, &moved);
                (0..n).map(|i| (up[i] - down[i]) / (2.0 * step)).collect::<Vec<f64>>()
            };
            let (fine, coarse) = (slope(1e-5), slope(2e-5));
            for r in &states {
                let range = pattern.column_pointers[column.at]..pattern.column_pointers[column.at + 1];
                let entry = range.into_iter().find(|&e| pattern.row_indices[e] == r.at);
                let diagonal = if r.at == column.at { cj } else { 0.0 };
                let exact = (entry.map_or(0.0, |e| values[e]) + diagonal) * size;
                let (a, b) = (fine[r.at], coarse[r.at]);
                let rate_size = y[r.at].abs().max(r.scale);
                let doubt = (a - b).abs() + 1e-4 * a.abs() + 1e-6 * rate_size;
                assert!((exact - a).abs() <= 4.0 * doubt, "row {row}: d {}'/d {}: {exact:e}, differences {a:e} {b:e}", r.name, column.name);
            }
        }
    }
}
