//! Pictures of what is at hand: saved tables, or a model alone.

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Arc;

use super::{Follower, Heading, Picture, Run, ShowError, heading, items, plan};
use smpl_runtime::environment::{Environment, ResetError, ResetOptions, StepError};
use smpl_runtime::setup::{Setup, SetupError};
use smpl_runtime::trajectory::{DataError, Recorder};

/// Reason why saved tables cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum SavedError {
    /// A table is invalid.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The requested quantities are missing or too many.
    #[error(transparent)]
    Show(#[from] ShowError),
}

/// A picture of tables that `smpl simulate --out` wrote, drawn over one another. Units, bounds and
/// set-points come from the model, if there is one.
///
/// # Errors
/// See [`SavedError`].
pub fn of_tables(paths: &[PathBuf], show: &[String], setup: Option<&Setup>) -> Result<Picture, SavedError> {
    let mut runs = Vec::new();
    for path in paths {
        runs.extend(Run::read(path)?);
    }
    for run in &mut runs {
        run.moved = setup.is_some_and(|setup| !tells_space(setup, run));
    }
    let present: HashSet<&str> = runs.iter().flat_map(Run::names).map(String::as_str).collect();
    let mut all = match (setup, runs.first()) {
        (Some(setup), _) => items::of_model(setup),
        (None, Some(first)) => items::of_columns(first.names(), |name| first.is_action(name)),
        (None, None) => Vec::new(),
    };
    for item in &mut all {
        item.members.retain(|member| present.contains(member.column.as_str()));
    }
    all.retain(|item| !item.members.is_empty());
    let plans = plan(&all, show)?;
    Ok(match setup {
        Some(setup) => Picture::new(&plans, &runs, &heading(setup, String::new()), &setup.model().interface().time.unit),
        None => Picture::new(&plans, &runs, &Heading { title: title(paths), ..Heading::default() }, ""),
    })
}

/// Returns `true` if cells lie where the model says in the run of a table: no column says that a
/// parameter which places them had its own value.
fn tells_space(setup: &Setup, run: &Run) -> bool {
    let model = setup.model();
    let places: HashSet<usize> = model
        .interface()
        .grids
        .iter()
        .flat_map(|grid| &grid.parameters)
        .filter_map(|(var, element, _)| Some(model.offset(*var)? + *element as usize))
        .collect();
    let is_said = |name: &str| match name.strip_prefix("param.") {
        Some(name) => setup.catalogue.parameters.find(name).is_some_and(|element| places.contains(&element.at)),
        // A column of a sweep: what is computed from it is not known.
        None => !places.is_empty() && setup.catalogue.parameters.find(name).is_some(),
    };
    items::knows_space(setup, setup.parameters()) && !run.names().iter().any(|name| is_said(name))
}

fn title(paths: &[PathBuf]) -> String {
    const SHOWN: usize = 4;
    let name = |path: &PathBuf| path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let mut names: Vec<String> = paths.iter().take(SHOWN).map(name).collect();
    if paths.len() > SHOWN {
        names.push(format!("and {} more", paths.len() - SHOWN));
    }
    names.join(", ")
}

/// Reason why a model alone cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum NominalError {
    /// The requested quantities are missing or too many.
    #[error(transparent)]
    Show(#[from] ShowError),
    /// There is no environment.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The episode cannot begin.
    #[error(transparent)]
    Reset(#[from] ResetError),
    /// It cannot go on.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// A picture of an episode of at most `most_steps` steps with the nominal policy.
///
/// # Errors
/// See [`NominalError`].
pub fn nominal(setup: &Arc<Setup>, show: &[String], most_steps: u32) -> Result<Picture, NominalError> {
    let plans = plan(&items::of_model(setup), show)?;
    let mut environment = Environment::new(Arc::clone(setup))?;
    environment.reset(Some(0), &ResetOptions::default())?;
    let steps = setup.max_steps().min(most_steps);
    let mut follower = Follower::new(setup, &plans, steps)?;
    let mut recorder = Recorder::new(&environment);
    recorder.record(&mut environment, None);
    let policy = setup.model().model().programs.policies.iter().position(|(name, _)| name == "nominal");
    let mut action: Vec<f64> = setup.catalogue.actions.elements().iter().map(|e| e.default).collect();
    while environment.is_running() && environment.steps() < steps {
        if let Some(index) = policy {
            environment.policy(index, &mut action);
        }
        if let Some(follower) = &mut follower {
            follower.follow(&environment, &action)?;
        }
        let result = environment.step(&action)?;
        recorder.record(&mut environment, Some(&result));
    }
    let mut run = Run::of_table("", recorder.table()).with_moved(!items::knows_space(setup, environment.parameters()));
    if let Some(follower) = follower {
        run.refine(follower.finish());
    }
    let time = super::duration(&setup.model().interface().time.unit, environment.time());
    let heading = heading(setup, format!("policy nominal; {} steps, t = {time}", environment.steps()));
    Ok(Picture::new(&plans, &[run], &heading, &setup.model().interface().time.unit))
}
