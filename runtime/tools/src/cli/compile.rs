//! `smpl compile`

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use serde_json::json;
use smpl_compiler::compiled::{CompiledModel, WatchRole};
use smpl_compiler::model::{AlgebraicCounts, Quantity};

use super::check::determined;
use super::report::Failed;
use super::{ModelArguments, outputs, say};
use crate::reduction::Summary;
use smpl_compiler::emit;
use smpl_runtime::catalogue::{Catalogue, Element, Family};
use smpl_runtime::files::write_whole;
use smpl_runtime::load::{self, ARTEFACT_EXTENSION, Loaded};
use smpl_runtime::solver::System;
use smpl_runtime::solver::linear;
use smpl_runtime::system::CompiledSystem;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl compile models/reactor.eq
  smpl compile models/reactor.eq -o build/reactor.smplc
  smpl compile models/reactor.eq --emit json")]
pub(super) struct CompileArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// File of the compiled model (default: next to the model); with --emit, file of the stage
    /// (default: standard output)
    #[arg(short, long, value_name = "FILE.smplc")]
    output: Option<PathBuf>,
    /// Print a stage of the compilation instead of writing the compiled model
    #[arg(long, value_enum)]
    emit: Option<Stage>,
}

/// Stages of the compilation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Stage {
    /// Syntax tree
    Ast,
    /// Flat model with its expressions
    Ir,
    /// Cranelift's intermediate form
    Clif,
    /// Machine code
    Asm,
    /// Equations typeset
    Latex,
    /// Names, units, bounds
    Json,
}

/// Compiles, prints what was compiled, writes the compiled model.
pub(super) fn run(arguments: &CompileArguments) -> Result<(), Failed> {
    let given = arguments.output.as_deref();
    if given.is_some() {
        outputs::check(&[given], load::files_of(&arguments.file).into_iter())?;
    }
    let print = |text: String| match &arguments.output {
        None => say(text),
        Some(path) => Ok(write_whole(path, |file| file.write_all(text.as_bytes()))?),
    };
    match arguments.emit {
        Some(Stage::Ast) => return print(super::document::syntax_tree(&arguments.file)?),
        Some(Stage::Latex) => return print(super::document::equations(&arguments.file)?),
        _ => {}
    }
    if arguments.emit.is_none() && arguments.file.extension().is_some_and(|e| e == ARTEFACT_EXTENSION) {
        return Err(Failed::Message(format!("{} is compiled already; give the `.eq` file", arguments.file.display())));
    }
    if arguments.emit.is_none() && arguments.model.extra.is_some() {
        let message = "a compiled model belongs to a file: write the statements of --extra into one that it imports, or as a variant";
        return Err(Failed::Message(message.to_owned()));
    }
    let texts = matches!(arguments.emit, Some(Stage::Clif | Stage::Asm));
    let begin = Instant::now();
    let loaded = arguments.model.load_with(&arguments.file, texts)?;
    let loading = begin.elapsed();
    let read = || outputs::names(&loaded.sources).chain([arguments.file.clone()]);
    outputs::check(&[given], read())?;
    match arguments.emit {
        Some(Stage::Ir) => return print(emit::ir(loaded.model.model())),
        Some(Stage::Json) => return print(interface_json(&loaded.model)? + "\n"),
        Some(Stage::Clif) => return print(emit::clif(&loaded.model)),
        Some(Stage::Asm) => return print(emit::assembly(&loaded.model)),
        Some(Stage::Ast | Stage::Latex) | None => {}
    }
    let out = arguments.output.clone().unwrap_or_else(|| arguments.file.with_extension(ARTEFACT_EXTENSION));
    outputs::check(&[Some(&out)], read())?;
    let bytes = loaded.model.to_bytes(loaded.fingerprint, &loaded.circumstances)?;
    write_whole(&out, |file| file.write_all(&bytes))?;
    outputs::conclude(&summary(&loaded, loading, &out)?, &[Some(&out)])
}

/// Summary of the compilation; `loading` is the time from the text to the compiled model.
fn summary(loaded: &Loaded, loading: Duration, out: &Path) -> Result<String, Failed> {
    let model = &loaded.model;
    let interface = model.interface();
    let statistics = model.statistics();
    let count = |quantities: &[Quantity]| quantities.iter().map(Quantity::len).sum::<usize>();
    let AlgebraicCounts { declared, solved, substituted } = interface.quantities.algebraic_counts;
    let mut text = String::new();
    // Writing into a string cannot fail.
    let _ = writeln!(text, "model {}: {}", interface.name, interface.text);
    let _ = writeln!(text, "  differential states   {}", model.states());
    let _ = writeln!(text, "  algebraic variables   {declared} declared, {solved} solved, {substituted} substituted");
    text.push_str(&Summary::of(interface).map(|summary| summary.text()).unwrap_or_default());
    text.push_str(&determined(loaded).unwrap_or_default());
    let _ = writeln!(text, "  discrete variables    {}", count(&interface.quantities.discretes));
    let _ = writeln!(text, "  actions               {}", count(&interface.quantities.actions));
    let _ = writeln!(text, "  observations          {}", interface.finish.observations.len());
    let _ = writeln!(text, "  parameters            {}", count(&interface.quantities.parameters));
    let switches = |kink: bool| {
        let is = |role: WatchRole| if kink { matches!(role, WatchRole::Kink { .. }) } else { role == WatchRole::Jump };
        model.watched().iter().filter(|kind| is(kind.role)).count()
    };
    let _ = writeln!(text, "  switches              {} jumps, {} kinks", switches(false), switches(true));
    let _ = writeln!(text, "  Jacobian              {} nonzeros, {}", model.pattern().row_indices.len(), method(model)?);
    let back_end = statistics.differentiate + statistics.hoist + statistics.generate;
    let phases = [
        ("text to equations", loading.saturating_sub(back_end)),
        ("differentiation", statistics.differentiate),
        ("hoisting, layout", statistics.hoist),
        ("code generation", statistics.generate),
    ];
    for (phase, duration) in phases {
        let _ = writeln!(text, "  {phase:<21} {:.2} ms", duration.as_secs_f64() * 1e3);
    }
    let _ = writeln!(text, "  code                  {} bytes", statistics.code_bytes);
    let _ = writeln!(text, "written to {}", out.display());
    Ok(text)
}

fn method(model: &std::sync::Arc<CompiledModel>) -> Result<String, Failed> {
    let system = CompiledSystem::new(std::sync::Arc::clone(model)).map_err(|e| Failed::Message(e.to_string()))?;
    let choice = model.interface().solver.linear_solver;
    let method = linear::method(system.pattern(), choice).map_err(|e| Failed::Message(e.to_string()))?;
    Ok(format!("{method}, exact"))
}

/// The array that holds each element with a public name, by its name in the flat model, and the
/// element's number in it. Elements without a variable are outputs.
fn places(model: &CompiledModel) -> HashMap<String, (String, usize)> {
    let interface = model.interface();
    let lists = [
        &interface.quantities.states,
        &interface.quantities.algebraics,
        &interface.quantities.discretes,
        &interface.quantities.actions,
        &interface.quantities.disturbances,
        &interface.quantities.parameters,
    ];
    let mut places = HashMap::new();
    for list in lists {
        let mut output = 0;
        for quantity in list {
            for element in 0..quantity.len() {
                let place = match quantity.var {
                    Some(var) => (model.model().vars[var].name.clone(), element),
                    None => ("out".to_owned(), output),
                };
                places.insert(quantity.element_name(element), place);
                output += 1;
            }
        }
    }
    places
}

/// Names, units, bounds and places of all that is seen from outside.
fn interface_json(model: &CompiledModel) -> Result<String, Failed> {
    let interface = model.interface();
    let catalogue = Catalogue::new(model);
    let places = places(model);
    let family = |family: &Family| -> Vec<_> {
        let described = |e: &Element| {
            let (array, element) = places.get(&e.name).map_or((None, None), |(array, element)| (Some(array), Some(element)));
            json!({"name": e.name, "unit": e.unit, "low": e.low, "high": e.high, "default": e.default, "array": array, "element": element})
        };
        family.elements().iter().map(described).collect()
    };
    let observations: Vec<_> = interface
        .finish
        .observations
        .iter()
        .map(
            |o| json!({"name": o.name, "unit": o.unit, "low": o.low, "high": o.high, "every": o.every, "delay": o.delay, "noise": o.noise}),
        )
        .collect();
    let rewards: Vec<_> = interface.finish.rewards.iter().map(|r| json!({"name": r.name, "unit": r.unit, "text": r.text})).collect();
    let failures: Vec<_> = interface.finish.failures.iter().map(|f| json!({"name": f.name, "text": f.text})).collect();
    let ports: Vec<_> = interface
        .ports
        .iter()
        .map(|port| {
            json!({
                "name": port.name, "connector": port.connector,
                "members": port.members.iter().map(|m| json!({"name": m.name, "output": m.output, "equals": m.equals, "flow": m.flow})).collect::<Vec<_>>(),
            })
        })
        .collect();
    let value = json!({
        "model": interface.name,
        "text": interface.text,
        "time": {"name": interface.time.name, "unit": interface.time.unit},
        "states": family(&catalogue.states),
        "algebraics": family(&catalogue.algebraics),
        "reduction": Summary::of(interface).map(|summary| summary.json()),
        "discretes": family(&catalogue.discretes),
        "actions": family(&catalogue.actions),
        "disturbances": family(&catalogue.disturbances),
        "parameters": family(&catalogue.parameters),
        "ports": ports,
        "observations": observations,
        "rewards": rewards,
        "failures": failures,
        "successes": interface.finish.successes,
        "constraints": interface.finish.constraints,
        "levels": interface.alternatives.levels,
        "variants": interface.alternatives.variants.iter().map(|v| (&v.name, v.on)).collect::<Vec<_>>(),
        "choices": interface.alternatives.choices.iter().map(|c| (&c.name, &c.options, c.at)).collect::<Vec<_>>(),
        "episode": {"step": interface.episode.step, "max_steps": interface.episode.max_steps, "error_reward": interface.episode.error_reward},
    });
    serde_json::to_string_pretty(&value).map_err(|e| Failed::Message(e.to_string()))
}
