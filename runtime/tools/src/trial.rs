//! Tests of a model's text: found in its file, grouped by what they are compiled with, run and
//! judged.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use smpl_compiler::ir::Role;
use smpl_compiler::model::{Expectation, Test, TestStep};
use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Statement, StatementKind, TestStep as Written};
use smpl_runtime::environment::{Environment, ResetError, ResetOptions, Start, StateInput, StepError};
use smpl_runtime::failure::Short;
use smpl_runtime::load::{LoadError, LoadOptions, Loaded, load};
use smpl_runtime::scenario::Variant;
use smpl_runtime::setup::{Setup, SetupError};

use crate::policy::Policy;

mod coverage;

pub(crate) use coverage::Coverage;

/// The result of a test.
#[derive(Clone, Debug)]
pub(crate) struct TestResult {
    /// Name of the test.
    pub name: String,
    /// Line of its name.
    pub line: usize,
    /// Time that the run took.
    pub time: Duration,
    /// One sentence for each expectation that does not hold; empty if the test passes.
    pub faults: Vec<String>,
}

/// Reason why a test could not be run.
#[derive(Debug, thiserror::Error)]
enum TrialError {
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Reset(#[from] ResetError),
    #[error(transparent)]
    Step(#[from] StepError),
    #[error(transparent)]
    Name(#[from] smpl_runtime::catalogue::UnknownName),
}

/// Tests that one compilation serves.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Names of the tests.
    pub names: Vec<String>,
    options: LoadOptions,
}

/// The tests of a text whose names contain a filter, grouped by scenario, level and variants in the
/// order of the text.
#[must_use]
pub(crate) fn groups(text: &str, filter: &str, options: &LoadOptions) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for statement in smpl_dsl::parse(text, FileId(0)).file.statements {
        let StatementKind::Test { name, body, .. } = statement.kind else { continue };
        if !name.contains(filter) {
            continue;
        }
        let chosen = chosen(&body, options);
        match groups.iter_mut().find(|group| group.options == chosen) {
            Some(group) => group.names.push(name),
            None => groups.push(Group { names: vec![name], options: chosen }),
        }
    }
    groups
}

/// The options of a test's compilation.
fn chosen(body: &[Statement], options: &LoadOptions) -> LoadOptions {
    let mut options = options.clone();
    for statement in body {
        let StatementKind::TestStep(Written::Choose { word, name, option }) = &statement.kind else { continue };
        match word.text.as_str() {
            "scenario" => options.scenario = Some(name.text.clone()),
            "level" => options.observation = Some(name.text.clone()),
            _ => options.variants.push(Variant { name: name.text.clone(), option: option.as_ref().map(|option| option.text.clone()) }),
        }
    }
    options
}

/// Compiles the model for a group and runs its tests; `report` takes each result as it is there,
/// and `coverage` what the tests reach.
///
/// # Errors
/// See [`LoadError`].
pub(crate) fn run(file: &Path, group: &Group, coverage: &mut Coverage, report: &mut dyn FnMut(TestResult)) -> Result<Loaded, LoadError> {
    let loaded = load(file, &LoadOptions { tests: Some(group.names.clone()), ..group.options.clone() })?;
    coverage.declare(&loaded, &group.options);
    for test in &loaded.model.interface().tests {
        let begin = Instant::now();
        let faults = Trial::run(&loaded, test, coverage).unwrap_or_else(|error| vec![error.to_string()]);
        let line = loaded.sources.locate(test.span).line;
        report(TestResult { name: test.name.clone(), line, time: begin.elapsed(), faults });
    }
    Ok(loaded)
}

/// A run of a test.
struct Trial<'t> {
    environment: Environment,
    sources: &'t SourceMap,
    /// Actions that the test sets, by their places.
    actions: BTreeMap<usize, f64>,
    /// Outputs, those of the test behind the model's.
    outputs: Vec<f64>,
    faults: Vec<String>,
    /// Steps that the end of the episode left out.
    missing: u32,
    /// An end was expected.
    expects_end: bool,
    coverage: &'t mut Coverage,
}

impl<'t> Trial<'t> {
    fn run(loaded: &'t Loaded, test: &Test, coverage: &'t mut Coverage) -> Result<Vec<String>, TrialError> {
        let steps: u32 = test.steps.iter().map(|step| if let TestStep::Run(n) = step { *n } else { 0 }).sum();
        let mut options = loaded.options.clone();
        let limit = options.max_steps.unwrap_or(loaded.model.interface().episode.max_steps);
        if steps > limit {
            options.max_steps = Some(steps);
        }
        let setup = Setup::new(Arc::clone(&loaded.model), options, Some(Arc::clone(&loaded.sources)))?;
        let mut policy = Policy::named(&test.policy, 0, &setup)?;
        let mut environment = Environment::new(setup)?;
        environment.reset(Some(0), &reset_options(&environment, test))?;
        let outputs = vec![0.0; environment.catalogue().algebraics.len()];
        let (sources, actions) = (&*loaded.sources, BTreeMap::new());
        let mut trial = Trial { environment, sources, actions, outputs, faults: vec![], missing: 0, expects_end: false, coverage };
        trial.coverage.note(&mut trial.environment);
        for step in &test.steps {
            match step {
                TestStep::Set { role: Role::Action, names, value, .. } => trial.set_actions(names, *value),
                TestStep::Set { .. } => {}
                TestStep::Run(n) => trial.steps(*n, &mut policy)?,
                TestStep::Expect { span, what } => trial.expect(*span, what),
            }
        }
        trial.unexpected_end();
        Ok(trial.faults)
    }

    fn set_actions(&mut self, names: &[String], value: f64) {
        let actions = &self.environment.catalogue().actions;
        self.actions.extend(names.iter().filter_map(|name| actions.position(name)).map(|at| (at, value)));
    }

    fn steps(&mut self, steps: u32, policy: &mut Policy) -> Result<(), TrialError> {
        let mut action = vec![0.0; self.environment.catalogue().actions.len()];
        for taken in 0..steps {
            if !self.environment.is_running() {
                self.missing += steps - taken;
                break;
            }
            policy.choose(&mut self.environment, &mut action);
            self.actions.iter().for_each(|(&at, &value)| action[at] = value);
            self.environment.step(&action)?;
            self.coverage.note(&mut self.environment);
        }
        Ok(())
    }

    /// Adds the fault of an expectation that does not hold.
    fn expect(&mut self, span: Span, what: &Expectation) {
        self.environment.algebraics(&mut self.outputs);
        let at = |i: usize| self.outputs[i];
        let fault = match what {
            Expectation::Holds { holds, .. } if at(*holds) == 1.0 => None,
            Expectation::Holds { holds, sides } => {
                let unknown = if at(*holds).is_nan() { " (not a number)" } else { "" };
                Some(match sides {
                    Some((left, right, unit)) => {
                        let (left, right) = (quantity(at(*left), unit), quantity(at(*right), unit));
                        format!("found {left} on the left and {right} on the right{unknown}")
                    }
                    None => format!("does not hold{unknown}"),
                })
            }
            Expectation::Within { value, tolerance, target, unit } => {
                let [value, tolerance, target] = [value, tolerance, target].map(|i| at(*i));
                let away = (value - target).abs();
                exceeds(away, tolerance).then(|| {
                    let (found, away) = (quantity(value, unit), quantity(away, &difference(unit)));
                    format!("found {found}, expected {}, {away} apart", quantity(target, unit))
                })
            }
            Expectation::Failure(name) => {
                self.expects_end = true;
                let found = self.failure();
                let matches = found.as_ref().is_some_and(|found| name.as_ref().is_none_or(|name| name == found));
                (!matches).then(|| format!("found {}", self.end()))
            }
            Expectation::Success(name) => {
                self.expects_end = true;
                let success = self.environment.last().is_some_and(|last| last.success);
                let matches = success && name.as_ref().is_none_or(|name| name == self.environment.success_name());
                (!matches).then(|| format!("found {}", self.end()))
            }
            Expectation::Steady { change, tolerance } => {
                let (change, tolerance) = (at(*change), at(*tolerance));
                let limit = Short(tolerance);
                exceeds(change, tolerance)
                    .then(|| format!("a state moves by {} of its scale in a step, at most {limit} is expected", Short(change)))
            }
        };
        if let Some(fault) = fault {
            let line = self.sources.locate(span).line;
            let written = self.sources.text(span).split_whitespace().collect::<Vec<_>>().join(" ");
            let time = quantity(self.environment.time(), &self.environment.setup().model().interface().time.unit);
            self.faults.push(format!("line {line}: `{written}`: {fault} at t = {time}"));
        }
    }

    fn failure(&self) -> Option<String> {
        let failure = self.environment.last()?.failure?;
        Some(failure.name(self.environment.setup().model().interface()).to_owned())
    }

    /// The end of the episode in words.
    fn end(&mut self) -> String {
        match self.environment.last().copied() {
            Some(last) if last.failure.is_some() => format!("the failure {}", self.environment.failure_message()),
            Some(last) if last.success => format!("the success {}", self.environment.success_name()),
            _ => format!("no end after {} steps", self.environment.steps()),
        }
    }

    /// A failure, or an end before all steps were taken, that the test does not expect.
    fn unexpected_end(&mut self) {
        let failed = self.environment.last().is_some_and(|last| last.failure.is_some());
        if self.expects_end || !failed && self.missing == 0 {
            return;
        }
        let (end, steps, missing) = (self.end(), self.environment.steps(), self.missing);
        let left = if missing == 0 { String::new() } else { format!(", {missing} before the last one of the test") };
        self.faults.push(format!("the episode ended after {steps} steps{left}: {end}"));
    }
}

/// Returns whether a number is above a limit; one that is not a number is.
fn exceeds(x: f64, limit: f64) -> bool {
    x > limit || x.is_nan() || limit.is_nan()
}

/// A number with its unit.
fn quantity(value: f64, unit: &str) -> String {
    if unit == "1" { Short(value).to_string() } else { format!("{} [{unit}]", Short(value)) }
}

/// The unit of differences.
fn difference(unit: &str) -> String {
    if unit == "degC" { "K".to_owned() } else { unit.to_owned() }
}

/// The start of a test.
fn reset_options(environment: &Environment, test: &Test) -> ResetOptions {
    let start = Start::from_name(&test.start).unwrap_or_default();
    let mut options = ResetOptions { start, hold_records: true, ..ResetOptions::default() };
    let mut states = BTreeMap::new();
    for step in &test.steps {
        let TestStep::Set { role, names, value, .. } = step else { continue };
        let values = names.iter().map(|name| (name.clone(), *value));
        match role {
            Role::State => states.extend(values),
            Role::Discrete => options.discrete.extend(values),
            Role::Param => options.parameters.extend(values),
            _ => {}
        }
    }
    if !states.is_empty() {
        options.state = StateInput::Named(states);
    }
    options.disturbances = records(environment, test);
    options
}

/// The disturbances that a test sets, one value a step; before they are set they keep their initial
/// values.
fn records(environment: &Environment, test: &Test) -> BTreeMap<String, Vec<f64>> {
    let disturbances = &environment.catalogue().disturbances;
    let set = test.steps.iter().filter_map(|step| match step {
        TestStep::Set { role: Role::Disturbance, names, .. } => Some(names),
        _ => None,
    });
    let mut present: BTreeMap<&String, f64> = set.flatten().map(|name| (name, initial(disturbances.find(name)))).collect();
    let mut records: BTreeMap<String, Vec<f64>> = present.keys().map(|name| ((*name).clone(), Vec::new())).collect();
    for step in &test.steps {
        match step {
            TestStep::Set { role: Role::Disturbance, names, value, .. } => present.extend(names.iter().map(|name| (name, *value))),
            TestStep::Run(n) => {
                for (name, record) in &mut records {
                    let value = present.get(name).copied().unwrap_or_default();
                    record.extend(std::iter::repeat_n(value, *n as usize));
                }
            }
            _ => {}
        }
    }
    records.retain(|_, record| !record.is_empty());
    records
}

fn initial(element: Option<&smpl_runtime::catalogue::Element>) -> f64 {
    element.map(|element| element.default).filter(|x| x.is_finite()).unwrap_or_default()
}
