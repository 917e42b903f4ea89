//! PenSim of `models/`, as the tests use it.

use std::path::PathBuf;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::layout::{Memory, Region};
use smpl_runtime::catalogue::Catalogue;
use smpl_runtime::environment::{Environment, ResetOptions, Start, StateInput};
use smpl_runtime::load::{LoadOptions, Loaded, load};
use smpl_runtime::scenario::Value;
use smpl_runtime::setup::Setup;

use super::reference::Table;

pub const ACTIONS: [&str; 6] = ["discharge", "Fs", "Foil", "Fg", "pressure", "Fw"];
pub const FLOWS: [&str; 5] = ["Fa", "Fb", "Fc", "Fh", "Fpaa"];
pub const DRAWN: [&str; 5] = ["mu_p", "mux_max", "alpha_kla", "N_conc_paa", "PAA_c"];
pub const STEPS: usize = 1150;

pub fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../models/pensim.eq")
}

pub fn pensim(options: &LoadOptions) -> Loaded {
    load(&path(), options).unwrap_or_else(|e| panic!("{e}"))
}

/// Loads a scenario with settings written as `name=value`.
pub fn options(scenario: &str, settings: &[&str]) -> LoadOptions {
    let pair = |text: &&str| {
        let (name, value) = text.split_once('=').expect("name=value");
        let value = value.parse().map_or_else(|_| Value::Text(value.into()), Value::Number);
        (name.to_owned(), value)
    };
    LoadOptions { scenario: Some(scenario.into()), settings: settings.iter().map(pair).collect(), ..LoadOptions::default() }
}

pub fn environment(loaded: Loaded, rtol: Option<f64>) -> Environment {
    let mut options = loaded.options;
    options.solver.rtol = rtol.or(options.solver.rtol);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).expect("the setup");
    Environment::new(setup).expect("the solver takes the system")
}

/// A reset that replays a reference episode (1 or 2).
pub fn replay(episode: usize, parameters: &Table, table: &Table, suffix: &str) -> ResetOptions {
    let named = |names: &[String], column: &dyn Fn(&str) -> f64| names.iter().map(|n| (n.clone(), column(n))).collect();
    let drawn: Vec<String> = DRAWN.iter().map(|&n| n.to_owned()).collect();
    let states: Vec<String> = table
        .names()
        .filter_map(|n| Some(n.strip_suffix(suffix)?.to_owned()))
        .filter(|n| !FLOWS.contains(&n.as_str()) && n != "yield")
        .collect();
    ResetOptions {
        start: Start::Nominal,
        state: StateInput::Named(named(&states, &|n| table.get(0, &format!("{n}{suffix}")))),
        parameters: named(&drawn, &|n| parameters.get(episode - 1, n)),
        disturbances: [("z".to_owned(), table.column("z", 1))].into(),
        ..ResetOptions::default()
    }
}

/// The model's own functions, with inputs set by name.
pub struct Bare<'a> {
    pub model: &'a CompiledModel,
    pub catalogue: Catalogue,
    pub memory: Memory,
}

impl<'a> Bare<'a> {
    pub fn new(model: &'a CompiledModel) -> Self {
        let mut memory = model.memory();
        model.parameters(&mut memory);
        Self { catalogue: Catalogue::new(model), memory, model }
    }

    pub fn set(&mut self, name: &str, value: f64) {
        let catalogue = &self.catalogue;
        let families = [
            (&catalogue.parameters, Region::Param),
            (&catalogue.actions, Region::Action),
            (&catalogue.discretes, Region::Discrete),
            (&catalogue.disturbances, Region::Disturbance),
        ];
        let found = families.into_iter().find_map(|(family, region)| Some((family.find(name)?.at, region)));
        let (at, region) = found.unwrap_or_else(|| panic!("no input {name}"));
        self.memory.region_mut(region)[at] = value;
    }

    /// y' of an explicit model: its residual at y' = 0.
    pub fn rates(&mut self, t: f64, y: &[f64]) -> Vec<f64> {
        let zero = vec![0.0; y.len()];
        let mut out = zero.clone();
        self.prepare();
        self.model.residual(&mut self.memory, t, y, &zero, &mut out);
        out
    }

    /// Brings the caches up to the inputs.
    pub fn prepare(&mut self) {
        self.model.prepare_parameters(&mut self.memory);
        self.model.prepare_step(&mut self.memory);
    }

    pub fn discrete(&self, name: &str) -> f64 {
        let element = self.catalogue.discretes.find(name).expect("a discrete variable");
        self.memory.region(Region::Discrete)[element.at]
    }

    /// Values in the order of `y` from values by name.
    pub fn y(&self, value: impl Fn(&str) -> f64) -> Vec<f64> {
        let mut y = vec![0.0; self.model.unknowns()];
        for state in self.catalogue.states.elements() {
            y[state.at] = value(&state.name);
        }
        y
    }
}
