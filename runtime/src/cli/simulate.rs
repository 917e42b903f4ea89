//! `smpl simulate`

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::report::{self, Failed};
use super::{ModelArguments, outputs};
use crate::catalogue::UnknownName;
use crate::environment::{Environment, ResetOptions, Start, StateInput};
use crate::failure::Short;
use crate::load::Loaded;
use crate::random::Stream;
use crate::setup::Setup;
use crate::trajectory::{Recorder, read_actions, read_disturbances, read_initial};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl simulate models/reactor.eq --actions a.csv --out t.csv
  smpl simulate models/reactor.eq --policy random --seed 7 --out t.parquet --plot t.svg
  smpl simulate models/pensim.eq --start nominal --init i.csv --disturbances z.csv --set paa_schedule=hours")]
pub(super) struct SimulateArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// Actions: columns named as the actions, physical units, row by row the steps 1..n
    #[arg(long, value_name = "A.csv", conflicts_with = "policy")]
    actions: Option<PathBuf>,
    /// nominal, random, or a policy that the model declares
    #[arg(long, value_name = "NAME", default_value = "nominal")]
    policy: String,
    /// Number of steps, in place of the time limit
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), allow_negative_numbers = true)]
    steps: Option<u32>,
    /// Where the episode starts
    #[arg(long, value_enum, default_value_t)]
    start: StartArgument,
    /// Initial values: one row, columns named as states or discrete variables
    #[arg(long, value_name = "I.csv")]
    init: Option<PathBuf>,
    /// Recorded disturbances in place of drawn ones
    #[arg(long, value_name = "D.csv")]
    disturbances: Option<PathBuf>,
    /// Seed of the episode
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = seed, allow_negative_numbers = true)]
    seed: u64,
    /// Relative tolerance
    #[arg(long, value_name = "R", value_parser = tolerance, allow_negative_numbers = true)]
    rtol: Option<f64>,
    /// Absolute tolerance of a state = F * R * its scale
    #[arg(long, value_name = "F", value_parser = positive, allow_negative_numbers = true)]
    atol_factor: Option<f64>,
    /// Longest internal step, in the model's unit of time
    #[arg(long, value_name = "T", value_parser = positive, allow_negative_numbers = true)]
    max_step: Option<f64>,
    /// What takes the steps: ida, rosenbrock, explicit or auto
    #[arg(long, value_name = "METHOD", value_parser = ["ida", "rosenbrock", "explicit", "auto"])]
    method: Option<String>,
    /// Table of the trajectory, CSV or Parquet
    #[arg(long, value_name = "T.csv|T.parquet")]
    out: Option<PathBuf>,
    /// Picture of states, actions and reward
    #[arg(long, value_name = "P.svg", value_parser = picture)]
    plot: Option<PathBuf>,
    /// Go on after the end of the episode
    #[arg(long = "continue")]
    keep_going: bool,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum StartArgument {
    /// Drawn by the model's distributions
    #[default]
    Sampled,
    /// Random numbers at their means
    Nominal,
    /// The steady state
    Steady,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err(format!("expected a positive number, found `{text}`")),
    }
}

/// The seeds of the command are those of 64 bits; Python takes longer ones too.
fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("a seed is a whole number from 0 to 2^64 - 1 = {}, not `{text}`", u64::MAX))
}

/// A relative tolerance that double precision can keep.
fn tolerance(text: &str) -> Result<f64, String> {
    match positive(text)? {
        x if (1e-15..1.0).contains(&x) => Ok(x),
        x => Err(format!("a relative tolerance lies between 1e-15 and 1, not {x}")),
    }
}

/// A file for a picture.
fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
        Some(other) if other != "svg" => Err(format!("pictures are SVG; name it `{}`", path.with_extension("svg").display())),
        _ => Ok(path),
    }
}

/// Where actions come from.
pub(super) enum Policy {
    /// The actions' nominal values.
    Nominal,
    /// A program of the model.
    Declared(usize),
    /// Uniform in the action box.
    Random(Stream),
    /// A table.
    Recorded(Vec<Vec<f64>>),
}

/// The model's policy `nominal`, else its nominal actions.
pub(super) fn nominal(environment: &Environment) -> Policy {
    declared(environment, "nominal").map_or(Policy::Nominal, Policy::Declared)
}

fn declared(environment: &Environment, name: &str) -> Option<usize> {
    environment.setup().model().model().programs.policies.iter().position(|(n, _)| n == name)
}

impl Policy {
    /// Writes the action of the coming step.
    pub fn choose(&mut self, environment: &mut Environment, action: &mut [f64]) {
        let step = environment.steps();
        match self {
            Policy::Declared(index) => environment.policy(*index, action),
            Policy::Recorded(rows) => {
                if let Some(row) = rows.get(step as usize) {
                    action.copy_from_slice(row);
                }
            }
            Policy::Nominal => {
                for (a, element) in action.iter_mut().zip(environment.catalogue().actions.elements()) {
                    *a = element.default;
                }
            }
            Policy::Random(stream) => {
                for (i, (a, element)) in action.iter_mut().zip(environment.catalogue().actions.elements()).enumerate() {
                    let u = stream.uniform(step, i as u32);
                    *a = if (element.high - element.low).is_finite() {
                        element.low + u * (element.high - element.low)
                    } else {
                        element.default
                    };
                }
            }
        }
    }
}

/// Runs one episode.
pub(super) fn run(arguments: &SimulateArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let written = [arguments.out.as_deref(), arguments.plot.as_deref()];
    outputs::check(&written, outputs::names(&loaded.sources).chain(data_files(arguments)))?;
    let mut environment = make(arguments, loaded)?;
    let mut policy = policy(arguments, &environment)?;
    let reset = reset_options(arguments, &environment)?;
    environment.set_keep_going(arguments.keep_going);
    environment.reset(Some(arguments.seed), &reset)?;

    let mut recorder = Recorder::new(&environment);
    recorder.record(&mut environment, None);
    let mut steps = arguments.steps.unwrap_or_else(|| environment.setup().max_steps());
    if let Policy::Recorded(rows) = &policy
        && (rows.len() as u32) < steps
    {
        warn_of_the_end(
            arguments.actions.as_deref(),
            &format!("the actions end after step {} of {steps}, and the run with them", rows.len()),
        );
        steps = rows.len() as u32;
    }
    let mut action = vec![0.0; environment.catalogue().actions.len()];
    let mut total = 0.0;
    let mut progress = Progress::new(steps);
    while environment.steps() < steps && (environment.is_running() || arguments.keep_going) {
        policy.choose(&mut environment, &mut action);
        let result = environment.step(&action)?;
        total += result.reward;
        recorder.record(&mut environment, Some(&result));
        progress.update(environment.steps());
    }
    progress.finish();
    for (name, values) in environment.ended_records() {
        let message = format!("the disturbance `{name}` ends after step {values}; its last value held to step {}", environment.steps());
        warn_of_the_end(arguments.disturbances.as_deref(), &message);
    }
    if let Some(path) = &arguments.out {
        recorder.table().write(path)?;
    }
    if let Some(path) = &arguments.plot {
        crate::plot::write(recorder.table(), environment.setup(), path)?;
    }
    outputs::conclude(&summary(&mut environment, total), &written)
}

/// Records that end early are said.
fn warn_of_the_end(path: Option<&Path>, message: &str) {
    let file = path.map(|path| format!("{}: ", path.display())).unwrap_or_default();
    report::note(&format!("warning: {file}{message}\n"));
}

/// Files that are read beside the sources.
fn data_files(arguments: &SimulateArguments) -> impl Iterator<Item = PathBuf> {
    let data = [&arguments.actions, &arguments.init, &arguments.disturbances];
    data.into_iter().flatten().chain([&arguments.file]).cloned()
}

fn make(arguments: &SimulateArguments, loaded: Loaded) -> Result<Environment, Failed> {
    let mut options = loaded.options;
    options.rtol = arguments.rtol.or(options.rtol);
    options.method = arguments.method.clone().or(options.method);
    options.max_step = arguments.max_step.or(options.max_step);
    options.atol_factor = arguments.atol_factor.or(options.atol_factor);
    options.max_steps = arguments.steps.or(options.max_steps);
    let setup = Setup::new(loaded.model, options, Some(loaded.sources))?;
    Ok(Environment::new(setup)?)
}

fn policy(arguments: &SimulateArguments, environment: &Environment) -> Result<Policy, Failed> {
    if let Some(path) = &arguments.actions {
        return Ok(Policy::Recorded(read_actions(path, environment.catalogue())?));
    }
    match arguments.policy.as_str() {
        "nominal" => Ok(nominal(environment)),
        "random" => {
            let key = crate::random::EpisodeKey::seeded(arguments.seed);
            Ok(Policy::Random(Stream::new(key, "policy:random")))
        }
        name => declared(environment, name).map(Policy::Declared).ok_or_else(|| {
            let policies = &environment.setup().model().model().programs.policies;
            let declared = policies.iter().map(|(n, _)| n.as_str()).filter(|n| *n != "nominal");
            let known = ["nominal", "random"].into_iter().chain(declared);
            UnknownName::new("policy", name, known).into()
        }),
    }
}

fn reset_options(arguments: &SimulateArguments, environment: &Environment) -> Result<ResetOptions, Failed> {
    let catalogue = environment.catalogue();
    let start = match arguments.start {
        StartArgument::Sampled => Start::Sampled,
        StartArgument::Nominal => Start::Nominal,
        StartArgument::Steady => Start::Steady,
    };
    let mut options = ResetOptions { start, hold_records: true, ..ResetOptions::default() };
    if let Some(path) = &arguments.init {
        let (states, discrete) = read_initial(path, catalogue)?;
        let states_given = states.iter().filter_map(|(name, &value)| Some((catalogue.states.find(name)?, value)));
        let discretes_given = discrete.iter().filter_map(|(name, &value)| Some((catalogue.discretes.find(name)?, value)));
        report::warn_of_bounds(&path.display().to_string(), states_given.chain(discretes_given));
        options.state = StateInput::Named(states);
        options.discrete = discrete;
    }
    if let Some(path) = &arguments.disturbances {
        options.disturbances = read_disturbances(path, catalogue)?;
    }
    Ok(options)
}

/// How the episode ended before its time limit.
pub(super) fn early_end(environment: &mut Environment) -> Option<String> {
    match environment.last().copied() {
        Some(r) if r.failure.is_some() => Some(format!("failed: {}", environment.failure_message())),
        Some(r) if r.success => Some("success".into()),
        _ => None,
    }
}

/// One line on how the episode went.
fn summary(environment: &mut Environment, total: f64) -> String {
    let setup = Arc::clone(environment.setup());
    let interface = setup.model().interface();
    let reward = interface.rewards.get(setup.reward).map_or(String::new(), |r| format!("sum of {} = {}, ", r.name, Short(total)));
    let truncated = environment.last().is_some_and(|r| r.truncated);
    let end = early_end(environment).unwrap_or_else(|| if truncated { "time limit".into() } else { "not ended".into() });
    format!("{}: {} steps, t = {} {}, {reward}{end}\n", interface.name, environment.steps(), Short(environment.time()), interface.time.1,)
}

/// A bar on standard error, where it is a terminal and the run is long.
struct Progress {
    begin: Instant,
    steps: u32,
    bar: Option<ProgressBar>,
}

impl Progress {
    fn new(steps: u32) -> Self {
        Self { begin: Instant::now(), steps, bar: None }
    }

    fn update(&mut self, step: u32) {
        const SHORT: Duration = Duration::from_millis(700);
        if self.bar.is_none() && self.begin.elapsed() > SHORT {
            let bar = ProgressBar::with_draw_target(Some(u64::from(self.steps)), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{bar:40} step {pos} of {len}, {eta} left") {
                bar.set_style(style);
            }
            self.bar = Some(bar);
        }
        if let Some(bar) = &self.bar {
            bar.set_position(u64::from(step));
        }
    }

    fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}
