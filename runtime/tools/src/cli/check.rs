//! `smpl check`

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde_json::{Value as Json, json};
use smpl_dsl::diagnostic::{Diagnostic, JsonDiagnostic, SHOWN, SourceMap, printable};

use super::report::{self, Failed};
use super::{Files, Format, ModelArguments, say};
use crate::policy::Policy;
use crate::reduction::{Summary, shown};
use smpl_runtime::catalogue::Element;
use smpl_runtime::environment::{Environment, ResetOptions, Start};
use smpl_runtime::failure::{Short, unit_suffix};
use smpl_runtime::load::{LoadError, LoadOptions, Loaded};
use smpl_runtime::setup::Setup;

#[derive(Debug, Args)]
pub(super) struct CheckArguments {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    model: ModelArguments,
    /// Format of diagnostics; JSON goes to standard output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// List the equations that index reduction differentiated, and the states that follow from them
    #[arg(long)]
    verbose: bool,
    /// Evaluate the drift of declared invariants along a nominal episode
    #[arg(long)]
    invariants: bool,
}

/// Checks all files; faults of all of them are shown.
pub(super) fn run(arguments: &CheckArguments) -> Result<(), Failed> {
    let mut objects: Vec<Json> = Vec::new();
    let mut faulty = false;
    for file in &arguments.files.files {
        match check(file, &arguments.model) {
            Ok(loaded) => {
                show(&loaded.warnings, &loaded.sources, arguments.format, &mut objects);
                if arguments.format == Format::Text {
                    say(printable(&format!("{}: {}\n", file.display(), verdict(&loaded))))?;
                    if arguments.verbose
                        && let Some(summary) = Summary::of(loaded.model.interface())
                    {
                        say(printable(&summary.text()))?;
                    }
                    if arguments.verbose
                        && let Some(text) = determined(&loaded)
                    {
                        say(printable(&text))?;
                    }
                }
                if arguments.invariants {
                    match (invariants(loaded), arguments.format) {
                        (Ok(text), Format::Text) => say(text)?,
                        // Standard output is for the array of diagnostics.
                        (Ok(text), Format::Json) => report::note(&text),
                        (Err(failed), _) => {
                            faulty = true;
                            failed.print();
                        }
                    }
                }
            }
            Err(LoadError::Diagnostics { sources, diagnostics }) => {
                faulty = true;
                show(&diagnostics, &sources, arguments.format, &mut objects);
            }
            Err(other) => {
                faulty = true;
                match arguments.format {
                    Format::Text => {
                        Failed::Message(other.to_string()).print();
                    }
                    Format::Json => objects.push(without_place(file, &other)),
                }
            }
        }
    }
    if arguments.format == Format::Json {
        let text = serde_json::to_string_pretty(&Json::Array(objects)).map_err(|e| Failed::Message(e.to_string()))?;
        say(text + "\n")?;
    }
    if faulty { Err(Failed::Quiet(1)) } else { Ok(()) }
}

fn check(file: &Path, model: &ModelArguments) -> Result<Loaded, LoadError> {
    smpl_runtime::load::load(file, &LoadOptions { lints: true, ..model.options() })
}

fn verdict(loaded: &Loaded) -> String {
    let model = &loaded.model;
    let warnings = match loaded.warnings.len() {
        0 => String::new(),
        1 => ", 1 warning".into(),
        n if n > SHOWN => format!(", more than {SHOWN} warnings"),
        n => format!(", {n} warnings"),
    };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    format!("ok ({}, {}{warnings})", count(model.states(), "state"), count(model.unknowns() - model.states(), "solved algebraic variable"))
}

fn show(diagnostics: &[Diagnostic], sources: &SourceMap, format: Format, objects: &mut Vec<Json>) {
    match format {
        Format::Text => report::print_diagnostics(diagnostics, sources),
        Format::Json => {
            let all = diagnostics.iter().map(|d| JsonDiagnostic::new(d, sources));
            objects.extend(all.filter_map(|d| serde_json::to_value(d).ok()));
        }
    }
}

fn without_place(file: &PathBuf, error: &LoadError) -> Json {
    json!({
        "code": smpl_runtime::load::UNREADABLE, "severity": "error", "message": error.to_string(), "file": file,
        "line": 1, "column": 1, "end_line": 1, "end_column": 1, "help": null, "notes": [], "related": [],
    })
}

/// The states that conditions at the start determine, with the declared values that are guesses.
pub(super) fn determined(loaded: &Loaded) -> Option<String> {
    if loaded.model.interface().start_conditions.is_empty() {
        return None;
    }
    let setup = Setup::new(Arc::clone(&loaded.model), loaded.options.clone(), Some(Arc::clone(&loaded.sources))).ok()?;
    let guess = |state: &Element| match state.default {
        guess if guess.is_finite() => format!(" (guess {}{})", Short(guess), unit_suffix(&state.unit)),
        _ => String::new(),
    };
    let names: Vec<String> = setup.determined_at_start().map(|(_, state)| format!("{}{}", state.name, guess(state))).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Some(format!("  set by conditions     {}\n", shown(&names)))
}

/// Largest drift of each invariant over a nominal episode: the change of its value less the
/// integral of its rate.
fn invariants(loaded: Loaded) -> Result<String, Failed> {
    let invariants = loaded.model.interface().invariants.clone();
    if invariants.is_empty() {
        return Ok("no invariants declared\n".into());
    }
    let setup = Setup::new(loaded.model, loaded.options, Some(Arc::clone(&loaded.sources)))?;
    let limit = setup.max_steps();
    let mut environment = Environment::new(setup)?;
    environment.watch_invariants()?;
    environment.reset(Some(0), &ResetOptions { start: Start::Nominal, hold_records: true, ..ResetOptions::default() })?;
    let mut policy = Policy::named("nominal", 0, environment.setup())?;
    let mut action = vec![0.0; environment.catalogue().actions.len()];
    while environment.is_running() {
        policy.choose(&mut environment, &mut action);
        environment.step(&action)?;
    }
    let drifts = environment.invariant_drifts();
    let lines = invariants.iter().zip(drifts).map(|(invariant, drift)| {
        // A balance is nothing but rounding; its parts are what the drift is to be compared with,
        // and only the model knows them.
        let relative = match drift.largest / drift.magnitude.max(f64::MIN_POSITIVE) {
            relative if relative < 0.1 => format!(" ({relative:.1e} of its magnitude)"),
            _ => String::new(),
        };
        format!("invariant {}: drift {:.3e} over {} steps{relative}\n", invariant.name, drift.largest, environment.steps())
    });
    let mut text: String = lines.collect();
    if let Some(end) = super::simulate::early_end(&mut environment) {
        text.push_str(&format!("the episode ended after {} of {limit} steps: {end}\n", environment.steps()));
    }
    Ok(text)
}
