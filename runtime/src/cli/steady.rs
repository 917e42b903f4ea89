//! `smpl steady`

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::report::Failed;
use super::{ModelArguments, number, outputs};
use crate::failure::Short;
use crate::files::write_whole;
use crate::linearize::linearize;
use crate::setup::Setup;
use crate::spectrum::{DENSE, eigenvalues};
use crate::steady;
use crate::trajectory::seventeen_digits;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl steady models/reactor.eq
  smpl steady models/reactor.eq --action T_c=28 --fix h=0.7 --out s.csv")]
pub(super) struct SteadyArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// Action, in its unit; the others as in the model's steady block, else nominal; repeatable
    #[arg(long = "action", value_name = "NAME=VALUE", value_parser = number)]
    actions: Vec<(String, f64)>,
    /// State that the equations leave free; repeatable
    #[arg(long = "fix", value_name = "STATE=VALUE", value_parser = number)]
    fixed: Vec<(String, f64)>,
    /// Table with name, unit and value of every state and algebraic variable
    #[arg(long, value_name = "S.csv")]
    out: Option<PathBuf>,
}

/// Eigenvalues printed.
const SHOWN: usize = 20;
/// Dense eigenvalue problems beyond this many states take minutes.
const LARGE: usize = 3000;

/// Solves, prints, writes.
pub(super) fn run(arguments: &SteadyArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let out = arguments.out.as_deref();
    outputs::check(&[out], outputs::names(&loaded.sources).chain([arguments.file.clone()]))?;
    let setup = Setup::new(loaded.model, loaded.options, Some(loaded.sources))?;
    let catalogue = &setup.catalogue;
    let mut system = setup.system.clone();
    let has_steady = setup.model().interface().has_steady;
    let mut y = if has_steady { setup.steady_state().to_vec() } else { steady::guess(&system, catalogue) };
    let (mut actions, mut fixed) = steady::declared(&mut system, catalogue, &mut y);
    for (name, value) in &arguments.actions {
        catalogue.actions.get(name, "action")?;
        if let Some(at) = catalogue.actions.position(name) {
            actions[at] = *value;
        }
    }
    for (name, value) in &arguments.fixed {
        let at = catalogue.states.get(name, "state")?.at;
        fixed.retain(|(place, _)| *place != at);
        fixed.push((at, *value));
    }
    let report = steady::solve(&mut system, catalogue, &actions, &fixed, &mut y)?;
    let rows = values(&mut system, catalogue, &y);
    if let Some(path) = &arguments.out {
        write_whole(path, |out| {
            let mut writer = csv::WriterBuilder::new().from_writer(out);
            writer.write_record(["name", "unit", "value"])?;
            for (name, unit, value) in &rows {
                let mut text = String::new();
                seventeen_digits(*value, &mut text);
                writer.write_record([name, unit, &text])?;
            }
            writer.flush()
        })?;
    }
    let mut text = String::new();
    // Writing into a string cannot fail.
    let _ = writeln!(text, "residual norm {:.3e} after {} iterations", report.residual_norm, report.iterations);
    let resting = catalogue.states.elements().iter().map(|e| e.scale).fold(0.0, f64::max) * 1e-9;
    if let Some((at, rate)) = report.held.filter(|&(_, rate)| rate > resting) {
        let name = catalogue.states.elements().iter().find(|e| e.at == at).map_or("", |e| e.name.as_str());
        let count = fixed.len();
        let _ = writeln!(text, "{count} states are held at given values and not all at rest: d/dt {name} = {rate:.3e} is the largest rate");
    }
    if arguments.out.is_none() {
        for (name, unit, value) in &rows {
            let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
            let _ = writeln!(text, "{name} = {}{unit}", Short(*value));
        }
    }
    text += &spectrum(&mut system, catalogue, &y, &setup.model().interface().time.1);
    outputs::conclude(&text, &[out])
}

/// Name, unit and value of every state and algebraic output.
fn values(system: &mut crate::system::CompiledSystem, catalogue: &crate::catalogue::Catalogue, y: &[f64]) -> Vec<(String, String, f64)> {
    let yp = vec![0.0; y.len()];
    let mut algebraics = vec![0.0; catalogue.algebraics.len()];
    let (model, memory) = system.parts();
    model.outputs(memory, 0.0, y, &yp, &mut algebraics);
    let row = |e: &crate::catalogue::Element, value: f64| (e.name.clone(), e.unit.clone(), value);
    let states = catalogue.states.elements().iter().map(|e| row(e, y[e.at]));
    let outputs = catalogue.algebraics.elements().iter().map(|e| row(e, algebraics[e.at]));
    states.chain(outputs).collect()
}

/// The eigenvalues of the linearisation in words.
fn spectrum(system: &mut crate::system::CompiledSystem, catalogue: &crate::catalogue::Catalogue, y: &[f64], time_unit: &str) -> String {
    if catalogue.states.len() > LARGE {
        return format!("eigenvalues: not computed for more than {LARGE} states\n");
    }
    let values = match linearize(system, catalogue, 0.0, y) {
        Ok(linear) => eigenvalues(&linear.a),
        Err(error) => return format!("eigenvalues: {error}\n"),
    };
    let Some(spectrum) = values else {
        return "eigenvalues: the iteration did not converge\n".into();
    };
    let (values, omitted) = (&spectrum.values, spectrum.omitted);
    let kind = match values.first().map(|v| v.re) {
        Some(re) if re > 1e-9 => "unstable",
        Some(re) if re > -1e-9 => "not asymptotically stable (an eigenvalue is zero)",
        _ => "stable",
    };
    let mut text = format!("{kind}; eigenvalues, 1/{time_unit}:\n");
    for value in values.iter().take(SHOWN) {
        let imaginary = match value.im {
            0.0 => String::new(),
            im if im > 0.0 => format!(" + {}i", Short(im)),
            im => format!(" - {}i", Short(-im)),
        };
        // Writing into a string cannot fail.
        let _ = writeln!(text, "  {}{imaginary}", Short(value.re));
    }
    if values.len() > SHOWN {
        let _ = writeln!(text, "  ... {} more, all left of these", values.len() - SHOWN);
    }
    if omitted > 0 {
        let _ = writeln!(
            text,
            "  {omitted} not computed: of parts with more than {DENSE} states that all act on each other, those nearest to zero are"
        );
    }
    text
}
