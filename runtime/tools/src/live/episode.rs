//! One episode with what the page shows of it.

use std::sync::Arc;

use smpl_runtime::catalogue::UnknownName;
use smpl_runtime::environment::{Environment, Followed, ResetError, StepError, Trace};
use smpl_runtime::failure::Short;
use smpl_runtime::trajectory::{Recorder, Table};

use super::jobs::Stop;
use super::pid::Pid;
use super::settings::{Settings, Single};
use super::wire::Fault;
use crate::picture::Tracing;
use crate::policy::Policy;

/// Most numbers of the table of a run.
const MOST_CELLS: usize = 50_000_000;

/// End of a run.
#[derive(Clone, Debug)]
pub(crate) struct End {
    pub(crate) kind: &'static str,
    pub(crate) name: String,
    pub(crate) message: String,
}

/// A run.
pub(crate) struct Episode {
    pub(crate) table: Table,
    /// Quantities followed within steps, with their values.
    pub(crate) trace: Option<(Tracing, Trace)>,
    pub(crate) end: End,
    pub(crate) total: f64,
    /// Violations of the constraints, step after step.
    pub(crate) violations: Vec<f64>,
    pub(crate) set_point: Option<f64>,
    pub(crate) moved: bool,
    pub(crate) ended_records: Vec<(String, usize)>,
}

/// Progress of a run.
pub(crate) type Progress<'a> = &'a mut dyn FnMut(u32);

/// Columns that are followed within steps.
pub(crate) type Wanted = Vec<(String, Followed)>;

/// Runs one episode. The environment is reset, so that it may have run before.
///
/// # Errors
/// Settings that the model does not take, or a stop.
pub(crate) fn run(
    environment: &mut Environment,
    single: &Single,
    wanted: &Wanted,
    stop: &Stop,
    progress: Progress<'_>,
) -> Result<Episode, Fault> {
    let setup = Arc::clone(environment.setup());
    let settings = &single.settings;
    environment.set_keep_going(settings.keep_going);
    let _ = environment.take_trace();
    let steps = setup.max_steps();
    let mut policy = Policy::named(settings.policy.as_deref().unwrap_or("nominal"), single.seed, &setup).map_err(Fault::setting)?;
    let reset = settings.reset_options(&setup);
    environment.reset(Some(single.seed), &reset).map_err(|error| match error {
        ResetError::Interrupted => stop.fault(),
        other => Fault::setting(other),
    })?;
    let mut recorder = Recorder::new(environment);
    let width = recorder.table().columns().len();
    if width.saturating_mul(steps as usize) > MOST_CELLS {
        return Err(Fault::setting(format!("{steps} steps of {width} columns are too many; ask for fewer steps")));
    }
    let tracing = Tracing::new(&setup, wanted.iter().cloned(), steps);
    if let Some(tracing) = &tracing {
        tracing.begin(environment);
    }
    let mut controls = Controls::new(settings, environment)?;
    recorder.record(environment, None);
    let (mut total, mut violations) = (0.0, Vec::new());
    let mut action = vec![0.0; setup.catalogue.actions.len()];
    while environment.steps() < steps && (environment.is_running() || settings.keep_going) {
        stop.check()?;
        policy.choose(environment, &mut action);
        controls.override_in(environment, &mut action);
        let result = environment.step(&action).map_err(|error| match error {
            StepError::Interrupted => stop.fault(),
            other => Fault::setting(other),
        })?;
        total += result.reward;
        recorder.record(environment, Some(&result));
        violations.extend_from_slice(environment.violations());
        progress(environment.steps());
    }
    Ok(Episode {
        end: end_of(environment),
        table: recorder.table().clone(),
        trace: tracing.zip(environment.take_trace()),
        total,
        violations,
        set_point: controls.pid.as_ref().map(Pid::set_point),
        moved: !crate::picture::items::knows_space(&setup, environment.parameters()),
        ended_records: environment.ended_records(),
    })
}

/// Constant actions and the loop, over those of the policy.
struct Controls {
    constants: Vec<(usize, f64)>,
    pid: Option<Pid>,
}

impl Controls {
    fn new(settings: &Settings, environment: &Environment) -> Result<Self, Fault> {
        let catalogue = environment.catalogue();
        let place = |(name, &value): (&String, &f64)| {
            if !value.is_finite() {
                return Err(Fault::setting(format!("action `{name}` must be finite")));
            }
            let at = catalogue.actions.position(name);
            let unknown = || Fault::setting(UnknownName::new("action", name, catalogue.actions.names()));
            Ok((at.ok_or_else(unknown)?, value))
        };
        let constants: Vec<(usize, f64)> = settings.actions.iter().map(place).collect::<Result<_, Fault>>()?;
        let base = operating_action(environment);
        let pid = settings.pid.as_ref().map(|pid| Pid::new(pid, environment, &base)).transpose()?;
        Ok(Self { constants, pid })
    }

    fn override_in(&mut self, environment: &Environment, action: &mut [f64]) {
        for &(at, value) in &self.constants {
            action[at] = value;
        }
        if let Some(pid) = &mut self.pid {
            action[pid.action] = pid.next(environment);
        }
    }
}

/// The actions of the steady state where there is one, else the nominal ones.
fn operating_action(environment: &Environment) -> Vec<f64> {
    let setup = environment.setup();
    let elements = setup.catalogue.actions.elements();
    let steady = setup.steady_action();
    let has = setup.model().interface().steady.is_some() && setup.no_steady().is_none();
    let of = |element: &smpl_runtime::catalogue::Element| steady.get(element.at).copied().filter(|x| has && x.is_finite());
    elements.iter().map(|element| of(element).unwrap_or(element.default)).collect()
}

fn end_of(environment: &mut Environment) -> End {
    let end = |kind, name: &str, message: String| End { kind, name: name.to_owned(), message };
    match environment.last().copied() {
        Some(result) => match result.failure {
            Some(failure) => {
                let message = environment.failure_message();
                let setup = Arc::clone(environment.setup());
                end("failure", failure.name(setup.model().interface()), message)
            }
            None if result.success => end("success", "success", "success".into()),
            None if result.truncated => end("time_limit", "time limit", "time limit".into()),
            None => end("open", "", format!("not ended at t = {}", Short(environment.time()))),
        },
        None => end("open", "", "no step".into()),
    }
}
