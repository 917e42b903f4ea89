//! Many runs: episodes (`--episodes`) for all combinations of values (`--sweep`), on all
//! processors.

mod table;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rayon::prelude::*;

use super::excursion::Excursion;
use super::outputs;
use super::plot::Sketch;
use super::report::{self, Failed};
use super::simulate::SimulateArguments;
use crate::policy::Policy;
use crate::sweep::{Sweep, combination, combinations};
use smpl_runtime::environment::{Environment, ResetOptions, StateInput, StepResult};
use smpl_runtime::failure::Short;
use smpl_runtime::load::LoadOptions;
use smpl_runtime::pool;
use smpl_runtime::scenario::{Value, Variant};
use smpl_runtime::setup::Setup;
use smpl_runtime::trajectory::{Recorder, Table};

/// Most runs of a command.
const MOST_RUNS: usize = 10_000_000;

/// Target of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// The scenario.
    Scenario,
    /// Source of actions.
    Policy,
    /// A switch or a choice.
    Variant,
    /// A parameter of an episode.
    Parameter,
    /// The initial value of a state.
    State,
    /// That of a discrete variable.
    Discrete,
    /// Anything else that a setting may be.
    Setting,
}

/// One combination of values.
struct Point {
    setup: Arc<Setup>,
    reset: ResetOptions,
    policy: String,
    /// The values, one a sweep.
    values: Vec<Value>,
    /// Reason why a run cannot start.
    broken: Option<String>,
}

/// Result of a run.
struct RunResult {
    steps: u32,
    time: f64,
    /// Sum of the chosen reward, then of each reward.
    sums: Vec<f64>,
    end: End,
    /// Parameters that were drawn, by name.
    drawn: Vec<(String, f64)>,
    table: Option<Table>,
    /// See [`crate::picture::Run::moved`].
    moved: bool,
    /// The state that left its bounds furthest, in words; nothing after a failure.
    excursion: Option<String>,
}

/// End of a run.
#[derive(Clone, Debug, PartialEq)]
enum End {
    Success,
    TimeLimit,
    NotEnded,
    /// With its message.
    Failed(String),
    /// It could not begin or go on, with the reason.
    Broken(String),
}

impl End {
    /// In a word: `success`, `time limit`, `not ended`, the identifier of the failure, `no run`.
    fn word(&self) -> &str {
        match self {
            End::Success => "success",
            End::TimeLimit => "time limit",
            End::NotEnded => "not ended",
            End::Failed(message) => message.split([':', ' ']).next().unwrap_or("failed"),
            End::Broken(_) => "no run",
        }
    }

    fn message(&self) -> &str {
        match self {
            End::Failed(message) | End::Broken(message) => message,
            _ => "",
        }
    }
}

/// Runs them all.
pub(super) fn run(arguments: &SimulateArguments) -> Result<(), Failed> {
    let written = [arguments.out.as_deref(), arguments.summary.as_deref(), arguments.plot.as_deref()];
    outputs::check(&written, arguments.inputs())?;
    outputs::endings(&written[..2])?;
    let episodes = arguments.episodes.unwrap_or(1) as usize;
    let count = combinations(&arguments.sweep).and_then(|n| n.checked_mul(episodes)).filter(|n| *n <= MOST_RUNS);
    let Some(count) = count else { return Err(Failed::Message(format!("these are more than {MOST_RUNS} runs"))) };
    if arguments.seed.checked_add(episodes as u64 - 1).is_none() {
        let most = u64::MAX - (episodes as u64 - 1);
        return Err(Failed::Message(format!("the seeds of {episodes} episodes begin at --seed, which is at most {most} here")));
    }
    let points = points(arguments)?;
    arguments.warn_of_bounds(&points[0].setup, &arguments.reset_options(&points[0].setup)?);
    let mut sketch = None;
    if let Some(path) = &arguments.plot {
        sketch = Some(Sketch::new(path, &arguments.show, &points[0].setup)?);
    }
    let keeps = arguments.out.is_some() || arguments.plot.is_some();
    let begin = Instant::now();
    let outcomes = run_all(arguments, &points, episodes, count, keeps)?;
    let spent = begin.elapsed().as_secs_f64();
    let keys = table::Keys { arguments, points: &points, episodes };
    if let Some(path) = &arguments.out {
        table::rows(&keys, &outcomes).write(path)?;
    }
    if let Some(path) = &arguments.summary {
        table::summary(&keys, &outcomes).write(path)?;
    }
    if let Some(sketch) = sketch {
        let part = if count > table::MOST_DRAWN { format!("the first {} of ", table::MOST_DRAWN) } else { String::new() };
        let note = format!("{}; {part}{count} runs", arguments.circumstances());
        sketch.write_runs(&table::pictures(&keys, &outcomes), &points[0].setup, note)?;
    }
    outputs::conclude(&conclusion(&keys, &outcomes, spent), &written)
}

/// Compiles what has to be compiled, each only once.
fn points(arguments: &SimulateArguments) -> Result<Vec<Point>, Failed> {
    let sweeps = &arguments.sweep;
    let first = |name: &str| sweeps.iter().position(|sweep| sweep.name == name);
    if let Some((_, twice)) = sweeps.iter().enumerate().find(|(i, sweep)| first(&sweep.name) != Some(*i)) {
        return Err(Failed::Message(format!("--sweep {} is given twice: give all of its values in one", twice.name)));
    }
    let first = |options: &mut LoadOptions| {
        if let Some(sweep) = sweeps.iter().find(|s| s.name == "scenario") {
            options.scenario = Some(sweep.values[0].to_string());
        }
    };
    let mut base = arguments.model.options();
    first(&mut base);
    let mut setups: Vec<(LoadOptions, Arc<Setup>)> = vec![(base.clone(), arguments.setup(&base)?)];
    let targets: Vec<Target> = sweeps.iter().map(|sweep| target(&sweep.name, &setups[0].1)).collect();
    let mut points = Vec::new();
    for index in 0..combinations(sweeps).unwrap_or_default() {
        let values: Vec<Value> = combination(sweeps, index).into_iter().cloned().collect();
        let options = changed(arguments.model.options(), sweeps, &targets, &values);
        let setup = match setups.iter().find(|(known, _)| *known == options) {
            Some((_, setup)) => Arc::clone(setup),
            None => {
                let setup = arguments.setup(&options)?;
                setups.push((options, Arc::clone(&setup)));
                setup
            }
        };
        points.push(point(arguments, setup, &targets, values)?);
    }
    Ok(points)
}

fn target(name: &str, setup: &Setup) -> Target {
    let (interface, catalogue) = (setup.model().interface(), &setup.catalogue);
    let is_variant = interface.alternatives.names(name);
    match name {
        "scenario" => Target::Scenario,
        "policy" => Target::Policy,
        _ if is_variant => Target::Variant,
        _ if catalogue.parameters.find(name).is_some_and(|e| !e.structural) => Target::Parameter,
        _ if catalogue.state(name).is_some() => Target::State,
        _ if catalogue.discretes.find(name).is_some() => Target::Discrete,
        _ => Target::Setting,
    }
}

fn changed(mut options: LoadOptions, sweeps: &[Sweep], targets: &[Target], values: &[Value]) -> LoadOptions {
    for ((sweep, target), value) in sweeps.iter().zip(targets).zip(values) {
        match target {
            Target::Scenario => options.scenario = Some(value.to_string()),
            Target::Variant => options.variants.push(Variant { name: sweep.name.clone(), option: Some(value.to_string()) }),
            Target::Setting => {
                options.settings.insert(sweep.name.clone(), value.clone());
            }
            Target::Policy | Target::Parameter | Target::State | Target::Discrete => {}
        }
    }
    options
}

fn point(arguments: &SimulateArguments, setup: Arc<Setup>, targets: &[Target], values: Vec<Value>) -> Result<Point, Failed> {
    let mut reset = arguments.reset_options(&setup)?;
    let mut policy = arguments.policy.clone();
    let (mut states, mut broken) = (BTreeMap::new(), None);
    for ((sweep, target), value) in arguments.sweep.iter().zip(targets).zip(&values) {
        let number = || match value.number() {
            Some(x) if x.is_finite() => Ok(x),
            _ => Err(Failed::Message(format!("the values of `{}` must be numbers, not `{value}`", sweep.name))),
        };
        match target {
            Target::Policy => policy = value.to_string(),
            Target::Parameter => {
                reset.parameters.insert(sweep.name.clone(), number()?);
            }
            Target::State | Target::Discrete => {
                let (family, given) = match target {
                    Target::State => (&setup.catalogue.states, &mut states),
                    _ => (&setup.catalogue.discretes, &mut reset.discrete),
                };
                let value = number()?;
                given.insert(sweep.name.clone(), value);
                let outside = family.find(&sweep.name).and_then(|element| element.check_bounds(value).err());
                broken = broken.or(outside.map(|outside| format!("initial value {outside}")));
            }
            Target::Scenario | Target::Variant | Target::Setting => {}
        }
    }
    if !states.is_empty() {
        if let StateInput::Named(given) = &reset.state {
            states.extend(given.iter().filter(|(name, _)| !states.contains_key(*name)).map(|(n, x)| (n.clone(), *x)).collect::<Vec<_>>());
        }
        reset.state = StateInput::Named(states);
    }
    Ok(Point { setup, reset, policy, values, broken })
}

fn run_all(arguments: &SimulateArguments, points: &[Point], episodes: usize, count: usize, keeps: bool) -> Result<Vec<RunResult>, Failed> {
    let given = arguments.threads.map_or_else(pool::processors, |n| n as usize);
    let threads = pool::useful(given, count);
    let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let workers = workers.map_err(|error| Failed::Message(format!("threads: {error}")))?;
    let bar = progress(count);
    // One environment a thread serves all runs of a setup.
    let outcome = |held: &mut Option<(usize, Environment)>, index: usize| -> Result<RunResult, Failed> {
        let (point, episode) = (&points[index / episodes], index % episodes);
        let identity = Arc::as_ptr(&point.setup) as usize;
        let mut environment = match held.take() {
            Some((same, environment)) if same == identity => environment,
            _ => Environment::new(Arc::clone(&point.setup))?,
        };
        let seed = arguments.seed.wrapping_add(episode as u64);
        let policy = arguments.policy_named(&point.policy, seed, &environment)?;
        let outcome = episode_of(arguments, point, &mut environment, policy, seed, keeps);
        *held = Some((identity, environment));
        bar.inc(1);
        Ok(outcome)
    };
    let all = workers.install(|| (0..count).into_par_iter().map_init(|| None, outcome).collect());
    bar.finish_and_clear();
    all
}

fn progress(count: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(count as u64), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos} of {len} runs, {per_sec}, {eta} left") {
        bar.set_style(style);
    }
    bar
}

/// One run. What goes wrong in it is its result: the others go on.
fn episode_of(
    arguments: &SimulateArguments,
    point: &Point,
    environment: &mut Environment,
    mut policy: Policy,
    seed: u64,
    keeps: bool,
) -> RunResult {
    let rewards = point.setup.model().interface().finish.rewards.len();
    let mut outcome = RunResult {
        steps: 0,
        time: 0.0,
        sums: vec![0.0; 1 + rewards],
        end: End::NotEnded,
        drawn: Vec::new(),
        table: None,
        moved: false,
        excursion: None,
    };
    let mut excursion = Excursion::default();
    environment.set_keep_going(arguments.keep_going);
    if let Some(reason) = &point.broken {
        outcome.end = End::Broken(reason.clone());
        return outcome;
    }
    if let Err(error) = environment.reset(Some(seed), &point.reset) {
        outcome.end = End::Broken(error.to_string());
        return outcome;
    }
    let values = environment.parameters();
    outcome.drawn = point.setup.drawn_parameters().iter().map(|e| (e.name.clone(), values[e.at])).collect();
    outcome.moved = !crate::picture::items::knows_space(&point.setup, values);
    let mut recorder = keeps.then(|| Recorder::new(environment));
    if let Some(recorder) = &mut recorder {
        recorder.record(environment, None);
    }
    let steps = policy.length().map_or(point.setup.max_steps(), |n| n.min(point.setup.max_steps()));
    let mut action = vec![0.0; environment.catalogue().actions.len()];
    while environment.steps() < steps && (environment.is_running() || arguments.keep_going) {
        policy.choose(environment, &mut action);
        match environment.step(&action) {
            Ok(result) => {
                add(&mut outcome, environment, &result);
                excursion.look(environment);
            }
            Err(error) => {
                outcome.end = End::Broken(error.to_string());
                break;
            }
        }
        if let (Some(recorder), Some(result)) = (&mut recorder, environment.last().copied()) {
            recorder.record(environment, Some(&result));
        }
    }
    if !matches!(outcome.end, End::Failed(_) | End::Broken(_)) {
        outcome.excursion = excursion.describe(environment);
    }
    outcome.table = recorder.map(|recorder| recorder.table().clone());
    outcome
}

fn add(outcome: &mut RunResult, environment: &mut Environment, result: &StepResult) {
    outcome.steps = environment.steps();
    outcome.time = environment.time();
    outcome.sums[0] += result.reward;
    for (sum, reward) in outcome.sums[1..].iter_mut().zip(environment.rewards()) {
        *sum += reward;
    }
    outcome.end = match result {
        r if r.failure.is_some() => End::Failed(environment.failure_message()),
        r if r.success => End::Success,
        r if r.truncated => End::TimeLimit,
        _ => outcome.end.clone(),
    };
}

/// Printed summary: number of runs, returns, ends, and a line for each combination.
fn conclusion(keys: &table::Keys<'_>, outcomes: &[RunResult], spent: f64) -> String {
    let steps: u64 = outcomes.iter().map(|o| u64::from(o.steps)).sum();
    let interface = keys.points[0].setup.model().interface();
    let reward = interface.finish.rewards.get(keys.points[0].setup.reward).map_or("reward", |r| r.name.as_str());
    let rate = Short((steps as f64 / spent.max(1e-9)).round());
    let mut text = format!("{}: {} runs, {steps} steps in {spent:.1} s ({rate} steps/s)\n", interface.name, outcomes.len());
    text.push_str(&format!("sum of {reward}: {}\nends: {}\n", statistics(outcomes), ends(outcomes)));
    if keys.points.len() > 1 {
        text.push_str(&table::points_as_text(keys, outcomes));
    }
    if let Some(broken) = outcomes.iter().find(|o| matches!(o.end, End::Broken(_))) {
        report::note(&format!("warning: some runs did not begin or go on; the first one: {}\n", broken.end.message()));
    }
    let left = outcomes.iter().filter_map(|o| o.excursion.as_ref());
    if let Some(first) = left.clone().next() {
        report::note(&format!("warning: in {} runs without a failure a state leaves its bounds; the first one: {first}\n", left.count()));
    }
    text
}

/// Mean, standard deviation and extremes of the returns.
fn statistics(outcomes: &[RunResult]) -> String {
    let returns: Vec<f64> = returns(outcomes).collect();
    if returns.is_empty() {
        return "none".into();
    }
    let (mean, deviation) = moments(&returns);
    let (low, high) = returns.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(*r), h.max(*r)));
    format!("mean {}, standard deviation {}, from {} to {}", Short(mean), Short(deviation), Short(low), Short(high))
}

/// Returns of the runs that there were.
fn returns(outcomes: &[RunResult]) -> impl Iterator<Item = f64> {
    outcomes.iter().filter(|o| !matches!(o.end, End::Broken(_))).map(|o| o.sums[0])
}

/// Mean and standard deviation of a sample (its variance with n − 1).
fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
    (mean, if values.len() > 1 { (squares / (n - 1.0)).sqrt() } else { 0.0 })
}

/// `28 time limit, 2 state_box`
fn ends(outcomes: &[RunResult]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for outcome in outcomes {
        *counts.entry(outcome.end.word()).or_default() += 1;
    }
    let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
    counts.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
    counts.iter().map(|(word, n)| format!("{n} {word}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NumPy: `np.mean([1, 2, 4])`, `np.std([1, 2, 4], ddof=1)`.
    #[test]
    fn returns_have_the_moments_of_a_sample() {
        let (mean, deviation) = moments(&[1.0, 2.0, 4.0]);
        assert!((mean - 2.333_333_333_333_333_5).abs() < 1e-15 && (deviation - 1.527_525_231_651_946_8).abs() < 1e-15);
        assert_eq!(moments(&[3.0]), (3.0, 0.0));
    }
}
