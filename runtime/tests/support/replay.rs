//! A model of `models/` stepped with recorded actions, its values found by name.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use smpl_runtime::environment::{Environment, ResetOptions, Start, StateInput, StepResult};
use smpl_runtime::load::{LoadOptions, load};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::Method;

use super::reference::Table;

pub struct Replay {
    pub environment: Environment,
    places: HashMap<String, usize>,
    values: Vec<f64>,
}

impl Replay {
    /// An instance of a scenario; `tolerance` (rtol and atol factor) replaces the model's own.
    pub fn new(model: &str, scenario: &str, tolerance: Option<(f64, f64)>) -> Self {
        Self::with(model, &LoadOptions { scenario: Some(scenario.into()), ..LoadOptions::default() }, tolerance)
    }

    /// An instance with variants and settings.
    pub fn with(model: &str, asked: &LoadOptions, tolerance: Option<(f64, f64)>) -> Self {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models").join(model);
        let loaded = load(&path, asked).unwrap_or_else(|e| panic!("{model}: {e}"));
        let mut options = loaded.options;
        // The same trajectories by another method: `SMPL_METHOD=rosenbrock`.
        options.solver.method =
            std::env::var("SMPL_METHOD").ok().map(|name| Method::from_name(&name).expect("a method")).or(options.solver.method);
        if let Some((rtol, factor)) = tolerance {
            (options.solver.rtol, options.solver.atol_factor) = (Some(rtol), Some(factor));
        }
        let setup = Setup::new(loaded.model, options, Some(loaded.sources)).unwrap_or_else(|e| panic!("{model}: {e}"));
        let mut environment = Environment::new(setup).expect("the solver takes the system");
        environment.set_keep_going(true);
        let catalogue = environment.catalogue();
        let rewards = environment.setup().model().interface().finish.rewards.iter().map(|r| format!("reward.{}", r.name));
        let names: Vec<String> = catalogue.states.names().chain(catalogue.algebraics.names()).map(str::to_owned).collect();
        let discretes = catalogue.discretes.names().map(str::to_owned);
        let places = names.into_iter().chain(discretes).chain(rewards).enumerate().map(|(i, n)| (n, i)).collect();
        Self { environment, places, values: Vec::new() }
    }

    /// Starts at the steady state with the given states in place.
    pub fn start(&mut self, states: BTreeMap<String, f64>) {
        self.start_with(&ResetOptions { start: Start::Steady, state: StateInput::Named(states), ..ResetOptions::default() });
    }

    pub fn start_with(&mut self, options: &ResetOptions) {
        self.environment.reset(Some(0), options).expect("a consistent start");
        self.collect();
    }

    /// Steps with the actions of a row of a table.
    pub fn step(&mut self, table: &Table, row: usize) -> StepResult {
        let names: Vec<&str> = self.environment.catalogue().actions.names().collect();
        let actions = table.row(row, &names);
        self.step_with(&actions)
    }

    /// Steps with actions in their order.
    pub fn step_with(&mut self, actions: &[f64]) -> StepResult {
        let result = self.environment.step(actions).expect("finite actions");
        self.collect();
        result
    }

    /// Takes the values after a step that was made on the environment itself.
    pub fn collect(&mut self) {
        let catalogue = self.environment.catalogue();
        let (states, outputs) = (catalogue.states.len(), catalogue.algebraics.len());
        let discretes: Vec<usize> = catalogue.discretes.elements().iter().map(|e| e.at).collect();
        self.values.resize(states + outputs, 0.0);
        self.values.truncate(states + outputs);
        self.environment.state(&mut self.values[..states]);
        self.environment.algebraics(&mut self.values[states..]);
        self.values.extend(discretes.iter().map(|&at| self.environment.discretes()[at]));
        self.values.extend_from_slice(self.environment.rewards());
    }

    /// The present value of a state, algebraic output, discrete variable or `reward.NAME`.
    pub fn get(&self, name: &str) -> f64 {
        self.find(name).unwrap_or_else(|| panic!("no value `{name}`"))
    }

    pub fn find(&self, name: &str) -> Option<f64> {
        self.places.get(name).map(|&at| self.values[at])
    }
}

/// The largest of the errors of each kind, with where it occurred.
#[derive(Default)]
pub struct Worst(BTreeMap<String, (f64, String)>);

impl Worst {
    /// Takes an error, NaN as the largest.
    pub fn add(&mut self, kind: &str, error: f64, place: impl FnOnce() -> String) {
        let before = self.0.get(kind).map_or(-1.0, |w| w.0);
        if error.is_nan() || error > before {
            self.0.insert(kind.to_owned(), (error, place()));
        }
    }

    /// Prints all and asserts that each is within its bound.
    pub fn assert_within(&self, what: &str, bound: impl Fn(&str) -> f64) {
        for (kind, (error, place)) in &self.0 {
            eprintln!("{what}: {kind} within {error:.2e} ({place}), allowed {:.0e}", bound(kind));
        }
        for (kind, (error, place)) in &self.0 {
            assert!(*error <= bound(kind), "{what}: {kind} is off by {error:e} at {place}");
        }
    }
}
