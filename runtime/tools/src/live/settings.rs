//! Settings of a run, as the controls of the page give them.

use std::collections::BTreeMap;

use serde::Deserialize;
use smpl_runtime::environment::{ResetOptions, Start, StateInput};
use smpl_runtime::load::LoadOptions;
use smpl_runtime::scenario::{Value, Variant};
use smpl_runtime::setup::{Setup, SolverOverrides, method};

use super::wire::Fault;

/// Most episodes of a request.
pub(crate) const MOST_RUNS: usize = 200;

/// All that the controls say; whatever is missing is as the model has it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Settings {
    pub(crate) scenario: Option<String>,
    pub(crate) variants: Vec<String>,
    pub(crate) settings: BTreeMap<String, Value>,
    pub(crate) parameters: BTreeMap<String, f64>,
    pub(crate) initial: BTreeMap<String, f64>,
    pub(crate) actions: BTreeMap<String, f64>,
    pub(crate) disturbances: BTreeMap<String, f64>,
    pub(crate) start: StartAt,
    pub(crate) seed: u64,
    pub(crate) seeds: Option<u32>,
    pub(crate) policy: Option<String>,
    pub(crate) pid: Option<PidSettings>,
    pub(crate) method: Option<String>,
    pub(crate) rtol: Option<f64>,
    pub(crate) steps: Option<u32>,
    pub(crate) reward: Option<String>,
    pub(crate) level: Option<String>,
    pub(crate) keep_going: bool,
    pub(crate) sweep: Option<SweepSettings>,
}

/// The start of the episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum StartAt {
    /// Drawn by the model's distributions.
    #[default]
    Sampled,
    /// Random numbers at their means.
    Nominal,
    /// The steady state.
    Steady,
}

impl StartAt {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Sampled => "sampled",
            Self::Nominal => "nominal",
            Self::Steady => "steady",
        }
    }
}

/// A control loop on one pair of a measured variable and an action.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PidSettings {
    pub(crate) measured: String,
    pub(crate) action: String,
    pub(crate) gain: f64,
    #[serde(default)]
    pub(crate) integral_time: Option<f64>,
    #[serde(default)]
    pub(crate) derivative_time: f64,
    #[serde(default)]
    pub(crate) set_point: Option<f64>,
}

/// Values of one quantity, one run each.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SweepSettings {
    pub(crate) name: String,
    pub(crate) values: Vec<f64>,
}

/// One run among those of a request.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Single {
    pub(crate) label: String,
    pub(crate) value: Option<f64>,
    pub(crate) seed: u64,
    pub(crate) settings: Settings,
}

impl Settings {
    /// The choices for which a model is compiled. `structural` are parameters among those of the
    /// controls that shape the model.
    pub(crate) fn load_options(&self, structural: &BTreeMap<String, f64>) -> LoadOptions {
        let mut settings = self.settings.clone();
        settings.extend(structural.iter().map(|(name, value)| (name.clone(), Value::Number(*value))));
        LoadOptions {
            scenario: self.scenario.clone().filter(|name| name != "default"),
            variants: self.variants.iter().map(|text| Variant::parse(text)).collect(),
            settings,
            reward: self.reward.clone(),
            observation: self.level.clone(),
            ..LoadOptions::default()
        }
    }

    /// The given solver options over those of the scenario.
    pub(crate) fn solver(&self, mut options: SolverOverrides) -> Result<SolverOverrides, Fault> {
        options.rtol = self.rtol.or(options.rtol);
        if let Some(name) = &self.method {
            options.method = Some(method(name).map_err(Fault::setting)?);
        }
        Ok(options)
    }

    /// The beginning of the episode.
    pub(crate) fn reset_options(&self, setup: &Setup) -> ResetOptions {
        let start = match self.start {
            StartAt::Sampled => Start::Sampled,
            StartAt::Nominal => Start::Nominal,
            StartAt::Steady => Start::Steady,
        };
        let catalogue = &setup.catalogue;
        let (discrete, states): (BTreeMap<String, f64>, BTreeMap<String, f64>) =
            self.initial.clone().into_iter().partition(|(name, _)| catalogue.discretes.find(name).is_some());
        let structural = |name: &str| catalogue.parameters.find(name).is_some_and(|element| element.structural);
        ResetOptions {
            start,
            state: if states.is_empty() { StateInput::Start } else { StateInput::Named(states) },
            discrete,
            parameters: self.parameters.clone().into_iter().filter(|(name, _)| !structural(name)).collect(),
            disturbances: self.disturbances.iter().map(|(name, value)| (name.clone(), vec![*value])).collect(),
            hold_records: true,
            ..ResetOptions::default()
        }
    }

    /// The runs that the settings ask for: one a seed, or one a value of the sweep.
    ///
    /// # Errors
    /// Too many, or values that are not finite.
    pub(crate) fn singles(&self, kind_of: impl Fn(&str) -> Option<Swept>) -> Result<Vec<Single>, Fault> {
        let base = Settings { sweep: None, seeds: None, ..self.clone() };
        if let Some(sweep) = &self.sweep {
            let kind = kind_of(&sweep.name).ok_or_else(|| Fault::setting(format!("unknown quantity `{}` to sweep", sweep.name)))?;
            limited(sweep.values.len())?;
            let single = |value: &f64| {
                let mut settings = base.clone();
                let place = match kind {
                    Swept::Parameter => &mut settings.parameters,
                    Swept::Initial => &mut settings.initial,
                    Swept::Action => &mut settings.actions,
                };
                place.insert(sweep.name.clone(), *value);
                let label = format!("{} = {}", sweep.name, smpl_runtime::failure::Short(*value));
                Single { label, value: Some(*value), seed: self.seed, settings }
            };
            return Ok(sweep.values.iter().map(single).collect());
        }
        let seeds = self.seeds.unwrap_or(1).max(1);
        limited(seeds as usize)?;
        let single = |offset: u32| {
            let seed = self.seed.wrapping_add(u64::from(offset));
            let label = if seeds > 1 { format!("seed {seed}") } else { String::new() };
            Single { label, value: None, seed, settings: base.clone() }
        };
        Ok((0..seeds).map(single).collect())
    }
}

/// A kind of quantity that a sweep varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Swept {
    /// A parameter.
    Parameter,
    /// The initial value of a state or of a discrete variable.
    Initial,
    /// A constant action.
    Action,
}

fn limited(count: usize) -> Result<(), Fault> {
    match count {
        0 => Err(Fault::setting("the sweep has no values")),
        n if n > MOST_RUNS => Err(Fault::setting(format!("{n} runs are too many; ask for at most {MOST_RUNS}"))),
        _ => Ok(()),
    }
}

/// The kind of a quantity by its name.
pub(crate) fn kind_of(setup: &Setup, name: &str) -> Option<Swept> {
    let catalogue = &setup.catalogue;
    let known = [
        (catalogue.parameters.find(name).is_some(), Swept::Parameter),
        (catalogue.actions.find(name).is_some(), Swept::Action),
        (catalogue.state(name).is_some() || catalogue.discretes.find(name).is_some(), Swept::Initial),
    ];
    known.into_iter().find_map(|(is, kind)| is.then_some(kind))
}
