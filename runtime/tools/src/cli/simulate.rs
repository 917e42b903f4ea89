//! `smpl simulate`

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::excursion::Excursion;
use super::plot::{self, Sketch};
use super::report::{self, Failed};
use super::{ModelArguments, outputs};
use crate::policy::Policy;
use crate::sweep::Sweep;
use smpl_runtime::environment::{Environment, ResetOptions, Start, StateInput};
use smpl_runtime::failure::Short;
use smpl_runtime::load::{LoadOptions, Loaded};
use smpl_runtime::setup::{Setup, method};
use smpl_runtime::trajectory::{Between, Clock, Recorder, read_actions, read_disturbances, read_initial};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl simulate models/reactor.eq --actions a.csv --out t.csv
  smpl simulate models/reactor.eq --policy random --seed 7 --out t.parquet --plot t.svg
  smpl simulate models/pensim.eq --start nominal --init i.csv --disturbances z.csv --set paa_schedule=hours
  smpl simulate models/reactor.eq --episodes 100 --policy random --summary s.csv
  smpl simulate models/reactor.eq --sweep k_0=1e10..1e11:5 --sweep scenario=default,legacy --out all.csv --plot all.svg")]
// A field for each option of the command.
pub(super) struct SimulateArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    pub(super) model: ModelArguments,
    /// Actions: columns named as the actions, physical units, by a column `time` or row by row the
    /// steps 1..n
    #[arg(long, value_name = "A.csv", conflicts_with = "policy")]
    actions: Option<PathBuf>,
    /// nominal, random, or a policy that the model declares
    #[arg(long, value_name = "NAME", default_value = "nominal")]
    pub(super) policy: String,
    /// Number of steps, instead of the time limit
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), allow_negative_numbers = true)]
    steps: Option<u32>,
    /// Start of the episode
    #[arg(long, value_enum, default_value_t)]
    start: StartArgument,
    /// Initial values: one row, columns named as states, discrete variables or guesses of algebraic
    /// ones; or a table of `smpl steady --out`
    #[arg(long, value_name = "I.csv")]
    init: Option<PathBuf>,
    /// Recorded disturbances instead of drawn ones
    #[arg(long, value_name = "D.csv")]
    disturbances: Option<PathBuf>,
    /// Course of recorded inputs between the times of their tables
    #[arg(long, value_enum, default_value_t)]
    resample: Between,
    /// Warnings that were given: several runs read the same tables.
    #[arg(skip)]
    warned: Mutex<Vec<String>>,
    /// Seed of the episode
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = seed, allow_negative_numbers = true)]
    pub(super) seed: u64,
    /// Relative tolerance, of every method
    #[arg(long, value_name = "R", value_parser = tolerance, allow_negative_numbers = true)]
    rtol: Option<f64>,
    /// Absolute tolerance of a state = F * R * its scale
    #[arg(long, value_name = "F", value_parser = positive, allow_negative_numbers = true)]
    atol_factor: Option<f64>,
    /// Longest internal step, in the model's unit of time
    #[arg(long, value_name = "T", value_parser = positive, allow_negative_numbers = true)]
    max_step: Option<f64>,
    /// Integration method: ida, rosenbrock, explicit or auto
    #[arg(long, value_name = "METHOD", value_parser = ["ida", "rosenbrock", "explicit", "auto"])]
    method: Option<String>,
    /// Table of the trajectory, CSV or Parquet
    #[arg(long, value_name = "T.csv|T.parquet", value_parser = outputs::table)]
    pub(super) out: Option<PathBuf>,
    /// Picture of the run: SVG, PNG, PDF, or HTML to look into
    #[arg(long, value_name = "P.svg|png|pdf|html", value_parser = plot::picture)]
    pub(super) plot: Option<PathBuf>,
    /// Quantities in the picture: names, `states`, `observations`, `outputs`, `actions`,
    /// `discretes`, `rewards`, `all`
    #[arg(long, value_name = "NAME,...", requires = "plot")]
    pub(super) show: Vec<String>,
    /// Go on after the end of the episode
    #[arg(long = "continue")]
    pub(super) keep_going: bool,
    /// Number of episodes, with the seeds N, N + 1, ...
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Many runs")]
    pub(super) episodes: Option<u32>,
    /// Values of a parameter, setting, variant, initial value, of `scenario` or `policy`; several
    /// are crossed
    #[arg(long, value_name = "NAME=LOW..HIGH:COUNT|NAME=A,B,...", value_parser = Sweep::parse, help_heading = "Many runs")]
    pub(super) sweep: Vec<Sweep>,
    /// Table of one row a run: return, end, drawn parameters
    #[arg(long, value_name = "S.csv|S.parquet", value_parser = outputs::table, help_heading = "Many runs")]
    pub(super) summary: Option<PathBuf>,
    /// Threads, at most one a run; all processors by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Many runs")]
    pub(super) threads: Option<u32>,
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
    /// The state to which a period under the nominal policy returns
    Cyclic,
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

impl SimulateArguments {
    /// Returns `true` if many episodes are asked for.
    pub(super) fn is_many(&self) -> bool {
        self.episodes.is_some() || !self.sweep.is_empty() || self.summary.is_some()
    }
}

/// Runs one episode.
pub(super) fn run(arguments: &SimulateArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let written = [arguments.out.as_deref(), arguments.plot.as_deref()];
    outputs::check(&written, outputs::names(&loaded.sources).chain(data_files(arguments)))?;
    outputs::endings(&written[..1])?;
    let mut environment = Environment::new(arguments.setup_of(loaded)?)?;
    let mut policy = arguments.policy_named(&arguments.policy, arguments.seed, &environment)?;
    let reset = arguments.reset_options(environment.setup())?;
    arguments.warn_of_bounds(environment.setup(), &reset);
    environment.set_keep_going(arguments.keep_going);
    environment.reset(Some(arguments.seed), &reset)?;

    let setup = Arc::clone(environment.setup());
    let mut sketch = arguments.plot.as_deref().map(|path| Sketch::new(path, &arguments.show, &setup)).transpose()?;
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
    let (mut total, mut excursion) = (0.0, Excursion::default());
    let mut progress = Progress::new(steps);
    if let Some(sketch) = &mut sketch {
        sketch.follow_run(&setup, steps)?;
    }
    while environment.steps() < steps && (environment.is_running() || arguments.keep_going) {
        policy.choose(&mut environment, &mut action);
        if let Some(sketch) = &mut sketch {
            sketch.follow(&environment, &action)?;
        }
        let result = environment.step(&action)?;
        total += result.reward;
        recorder.record(&mut environment, Some(&result));
        excursion.look(&environment);
        progress.update(environment.steps());
    }
    progress.finish();
    if let Some(text) = excursion.describe(&environment).filter(|_| environment.last().is_none_or(|last| last.failure.is_none())) {
        report::note(&format!("warning: {text}\n"));
    }
    for (name, values) in environment.ended_records() {
        let message = format!("the disturbance `{name}` ends after step {values}; its last value held to step {}", environment.steps());
        warn_of_the_end(arguments.disturbances.as_deref(), &message);
    }
    if let Some(path) = &arguments.out {
        recorder.table().write(path)?;
    }
    let summary = summary(&mut environment, total);
    if let Some(sketch) = sketch {
        let note =
            format!("{}; {}", arguments.circumstances(), outcome(&mut environment, total, crate::picture::duration, crate::picture::short));
        sketch.write(recorder.table(), &environment, note)?;
    }
    outputs::conclude(&summary, &written)
}

/// Records that end early are reported.
fn warn_of_the_end(path: Option<&Path>, message: &str) {
    let file = path.map(|path| format!("{}: ", path.display())).unwrap_or_default();
    report::note(&format!("warning: {file}{message}\n"));
}

/// Files that are read next to the sources.
fn data_files(arguments: &SimulateArguments) -> impl Iterator<Item = PathBuf> {
    let data = [&arguments.actions, &arguments.init, &arguments.disturbances];
    data.into_iter().flatten().chain([&arguments.file]).cloned()
}

impl SimulateArguments {
    /// Files that a run reads.
    pub(super) fn inputs(&self) -> impl Iterator<Item = PathBuf> {
        let texts = smpl_runtime::load::files_of(&self.file);
        texts.into_iter().chain(data_files(self))
    }

    /// Description of the run's inputs.
    pub(super) fn circumstances(&self) -> String {
        let actions = match &self.actions {
            Some(path) => format!("actions of {}", path.file_name().unwrap_or_default().display()),
            None => format!("policy {}", self.policy),
        };
        let scenario = self.model.scenario.iter().map(|name| format!("scenario {name}"));
        let variants = self.model.variants.iter().map(|variant| format!("variant {variant}"));
        let settings = self.model.settings.iter().map(|(name, value)| format!("{name} = {value}"));
        let all = scenario.chain(variants).chain(settings).chain([format!("seed {}", self.seed), actions]);
        all.collect::<Vec<_>>().join(", ")
    }
}

impl SimulateArguments {
    /// The model under options, ready to run. Warnings are shown.
    pub(super) fn setup(&self, options: &LoadOptions) -> Result<Arc<Setup>, Failed> {
        let loaded = smpl_runtime::load::load(&self.file, options)?;
        report::print_diagnostics(&loaded.warnings, &loaded.sources);
        self.setup_of(loaded)
    }

    fn setup_of(&self, loaded: Loaded) -> Result<Arc<Setup>, Failed> {
        let mut options = loaded.options;
        if let Some(rtol) = self.rtol {
            options.solver.rtol = Some(rtol);
            options.solver.one_step_rtol = None;
        }
        if let Some(name) = &self.method {
            options.solver.method = Some(method(name)?);
        }
        options.solver.max_step = self.max_step.or(options.solver.max_step);
        options.solver.atol_factor = self.atol_factor.or(options.solver.atol_factor);
        options.max_steps = self.steps.or(options.max_steps);
        Ok(Setup::new(loaded.model, options, Some(loaded.sources))?)
    }

    /// The policy of a name, or the recorded actions.
    pub(crate) fn policy_named(&self, name: &str, seed: u64, environment: &Environment) -> Result<Policy, Failed> {
        if let Some(path) = &self.actions {
            let inputs = read_actions(path, environment.catalogue(), self.clock(environment.setup()))?;
            self.warn_of_split(path, inputs.split.as_ref());
            let row = |step: usize| inputs.sequences.iter().map(|sequence| sequence[step]).collect();
            return Ok(Policy::Recorded((0..inputs.steps).map(row).collect()));
        }
        Ok(Policy::named(name, seed, environment.setup())?)
    }

    /// Warns, once, of a recorded input that changes within a step.
    fn warn_of_split(&self, path: &Path, split: Option<&(String, usize)>) {
        let Some((name, step)) = split else { return };
        let path = path.display();
        let text =
            format!("warning: {path}: `{name}` changes within step {step}; a step has one value of an input, the mean over the step\n");
        let mut warned = self.warned.lock().unwrap_or_else(PoisonError::into_inner);
        if !warned.contains(&text) {
            report::note(&text);
            warned.push(text);
        }
    }

    fn clock(&self, setup: &Setup) -> Clock {
        Clock { step: setup.model().interface().episode.step, between: self.resample, most: setup.max_steps() as usize }
    }

    /// Start of episodes.
    pub(crate) fn reset_options(&self, setup: &Setup) -> Result<ResetOptions, Failed> {
        let start = match self.start {
            StartArgument::Sampled => Start::Sampled,
            StartArgument::Nominal => Start::Nominal,
            StartArgument::Steady => Start::Steady,
            StartArgument::Cyclic => Start::Cyclic,
        };
        let mut options = ResetOptions { start, hold_records: true, ..ResetOptions::default() };
        if let Some(path) = &self.init {
            let initial = read_initial(path, &setup.catalogue)?;
            options.state = StateInput::Named(initial.unknowns);
            options.discrete = initial.discretes;
        }
        if let Some(path) = &self.disturbances {
            let (disturbances, split) = read_disturbances(path, &setup.catalogue, self.clock(setup))?;
            self.warn_of_split(path, split.as_ref());
            options.disturbances = disturbances;
        }
        Ok(options)
    }

    /// Says which of the initial values and of the recorded disturbances that are given lie outside
    /// of their bounds.
    pub(crate) fn warn_of_bounds(&self, setup: &Setup, reset: &ResetOptions) {
        let catalogue = &setup.catalogue;
        if let (Some(path), StateInput::Named(states)) = (&self.init, &reset.state) {
            let states = states.iter().filter_map(|(name, &value)| Some((catalogue.state(name)?, value)));
            let discretes = reset.discrete.iter().filter_map(|(name, &value)| Some((catalogue.discretes.find(name)?, value)));
            report::warn_of_bounds(&path.display().to_string(), states.chain(discretes));
        }
        if let Some(path) = &self.disturbances {
            let first = reset.disturbances.iter().filter_map(|(name, values)| {
                let element = catalogue.disturbances.find(name)?;
                values.iter().find(|value| element.check_bounds(**value).is_err()).map(|&value| (element, value))
            });
            report::warn_of_bounds(&path.display().to_string(), first);
        }
    }
}

/// End of the episode before its time limit.
pub(super) fn early_end(environment: &mut Environment) -> Option<String> {
    match environment.last().copied() {
        Some(r) if r.failure.is_some() => Some(format!("failed: {}", environment.failure_message())),
        Some(r) if r.success => Some("success".into()),
        _ => None,
    }
}

/// One line on how the episode went.
fn summary(environment: &mut Environment, total: f64) -> String {
    let name = environment.setup().model().interface().name.clone();
    let time = |unit: &str, time: f64| format!("{} {unit}", Short(time));
    format!("{name}: {}\n", outcome(environment, total, time, |x| Short(x).to_string()))
}

/// Steps, time, sum of rewards and end of an episode, with its time and its numbers as text.
fn outcome(environment: &mut Environment, total: f64, time: impl Fn(&str, f64) -> String, number: impl Fn(f64) -> String) -> String {
    let setup = Arc::clone(environment.setup());
    let interface = setup.model().interface();
    let reward = interface.finish.rewards.get(setup.reward).map_or(String::new(), |r| format!("sum of {} = {}, ", r.name, number(total)));
    let truncated = environment.last().is_some_and(|r| r.truncated);
    let end = early_end(environment).unwrap_or_else(|| if truncated { "time limit".into() } else { "not ended".into() });
    format!("{} steps, t = {}, {reward}{end}", environment.steps(), time(&interface.time.unit, environment.time()))
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
