//! `smpl steady`

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::report::{self, Failed};
use super::{ModelArguments, number, outputs};
use smpl_compiler::layout::Region;
use smpl_runtime::catalogue::{Catalogue, Element};
use smpl_runtime::failure::{Short, describe_equation, unit_suffix};
use smpl_runtime::files::write_whole;
use smpl_runtime::linearize::linearize;
use smpl_runtime::setup::Setup;
use smpl_runtime::spectrum::{DENSE, eigenvalues};
use smpl_runtime::steady::{self, Held};
use smpl_runtime::trajectory::{read_initial, seventeen_digits};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl steady models/reactor.eq
  smpl steady plant.eq --guess X=2 --guess S=0.1
  smpl steady models/reactor.eq --action T_c=28 --fix h=0.7 --out s.csv
  smpl steady models/reactor.eq --fix h=0.7 --free q_out")]
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
    /// Action that is found: as many as values given with `--fix`, which then hold in addition to
    /// the equations; repeatable
    #[arg(long = "free", value_name = "ACTION")]
    free: Vec<String>,
    /// First guess of a state or an algebraic variable; the others as they start; repeatable
    #[arg(long = "guess", value_name = "NAME=VALUE", value_parser = number)]
    guesses: Vec<(String, f64)>,
    /// First guess of states and algebraic variables: a table that `--out` wrote, or one row with
    /// columns named as they are
    #[arg(long, value_name = "I.csv")]
    init: Option<PathBuf>,
    /// Table with name, unit and value of every state and algebraic variable
    #[arg(long, value_name = "S.csv", value_parser = outputs::table)]
    out: Option<PathBuf>,
}

/// Eigenvalues printed.
const SHOWN: usize = 20;
/// Discrete variables named.
const SHOWN_DISCRETES: usize = 8;
/// Dense eigenvalue problems beyond this many states take minutes.
const LARGE: usize = 3000;

/// Solves, prints, writes.
pub(super) fn run(arguments: &SteadyArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let out = arguments.out.as_deref();
    outputs::check(&[out], outputs::names(&loaded.sources).chain([arguments.file.clone()]))?;
    outputs::endings(&[out])?;
    if let Some(path) = out.filter(|path| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet"))) {
        return Err(Failed::Message(format!("a steady state is written as CSV; name it `{}`", path.with_extension("csv").display())));
    }
    let setup = Setup::without_steady(loaded.model, loaded.options, Some(loaded.sources))?;
    let catalogue = &setup.catalogue;
    let mut system = setup.system.clone();
    let found = setup.model().interface().steady.is_some() && setup.no_steady().is_none();
    let mut y = if found { setup.steady_state().to_vec() } else { steady::guess(&system, catalogue) };
    take_guesses(arguments, catalogue, &mut y)?;
    let (mut actions, mut held) = steady::declared(&mut system, catalogue, &mut y);
    for (name, value) in &arguments.actions {
        let element = catalogue.actions.get(name, "action")?;
        report::warn_of_bounds("--action", std::iter::once((element, *value)));
        if let Some(at) = catalogue.actions.position(name) {
            actions[at] = *value;
        }
    }
    if !arguments.free.is_empty() {
        held = Held { free: free_actions(arguments, catalogue)?, ..Held::default() };
    }
    for (name, value) in &arguments.fixed {
        let variable = catalogue.solved.find(name).filter(|_| !held.free.is_empty());
        let element = variable.map_or_else(|| catalogue.states.get(name, "state"), Ok)?;
        report::warn_of_bounds("--fix", std::iter::once((element, *value)));
        held.fix(element.at, *value, &mut system, &y)?;
    }
    let report = steady::solve_held(&mut system, catalogue, &actions, &held, &[], &mut y)?;
    steady::rest_at(&mut system, &y);
    let found = held.free.iter().map(|&position| &catalogue.actions.elements()[position]);
    let found = found.map(|e| (e.name.clone(), e.unit.clone(), system.region(Region::Action)[e.at]));
    let found: Vec<(String, String, f64)> = found.collect();
    let rows: Vec<_> = values(&mut system, catalogue, &y).into_iter().chain(found).collect();
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
    if let Some((at, rate)) = report.held.filter(|&(_, rate)| rate.abs() > resting) {
        let name = catalogue.states.elements().iter().find(|e| e.at == at).map_or("", |e| e.name.as_str());
        let _ = writeln!(text, "{}: d/dt {name} = {rate:.3e}", what_is_held(&held));
    }
    if let Some((at, rate)) = report.moving {
        let name = catalogue.states.elements().iter().find(|e| e.at == at).map_or("", |e| e.name.as_str());
        let _ = writeln!(
            text,
            "not a steady state: d/dt {name} = {rate:.3e}, its rate is coupled with that of a held state; hold other states"
        );
    }
    if arguments.out.is_none() {
        for (name, unit, value) in &rows {
            let _ = writeln!(text, "{name} = {}{}", Short(*value), unit_suffix(unit));
        }
    }
    text += &changing(&system, catalogue, &y);
    text += &spectrum(&mut system, catalogue, &y, report.moving.is_none(), &setup.model().interface().time.unit);
    if let Some(at) = steady::kink(&mut system, catalogue, &y) {
        let equation = describe_equation(at, setup.model(), catalogue, setup.sources());
        let _ = writeln!(
            text,
            "one-sided: at a tie of `min`, `max`, `if` or their like in the {equation}; on another side of it the eigenvalues are others"
        );
    }
    text += &others(&steady::others(&system, catalogue, &actions, &held, &y), &y, catalogue);
    outputs::conclude(&text, &[out])
}

/// Positions of the actions after `--free`.
fn free_actions(arguments: &SteadyArguments, catalogue: &Catalogue) -> Result<Vec<usize>, Failed> {
    let position = |name: &String| {
        catalogue.actions.get(name, "action")?;
        Ok(catalogue.actions.position(name).unwrap_or_default())
    };
    arguments.free.iter().map(position).collect()
}

/// Puts the values of the command line into the first guess.
fn take_guesses(arguments: &SteadyArguments, catalogue: &Catalogue, y: &mut [f64]) -> Result<(), Failed> {
    if let Some(path) = &arguments.init {
        let given = read_initial(path, catalogue)?.unknowns;
        let element = |name: &String| catalogue.states.find(name).or_else(|| catalogue.solved.find(name));
        given.iter().filter_map(|(name, value)| Some((element(name)?, value))).for_each(|(element, value)| y[element.at] = *value);
    }
    for (name, value) in &arguments.guesses {
        let element = match catalogue.solved.find(name) {
            Some(element) => element,
            None => catalogue.states.get(name, "state")?,
        };
        y[element.at] = *value;
    }
    Ok(())
}

/// `1 state and 1 condition are held at given values and not all at rest`.
fn what_is_held(held: &Held) -> String {
    let counted = |count: usize, what: &str| match count {
        0 => None,
        1 => Some(format!("1 {what}")),
        many => Some(format!("{many} {what}s")),
    };
    let parts = [counted(held.states.len(), "state"), counted(held.conditions.len(), "condition")];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    match held.states.len() + held.conditions.len() {
        1 => format!("{} is held at a given value and not at rest", parts.concat()),
        _ => format!("{} are held at given values and not all at rest, the largest rate", parts.join(" and ")),
    }
}

/// Discrete variables that are held although a control step would change them, in words.
fn changing(system: &smpl_runtime::system::CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> String {
    let found = steady::changed_by_a_step(system, catalogue, y);
    if found.is_empty() {
        return String::new();
    }
    let shown =
        |(e, value, next): &(&Element, f64, f64)| format!("{} = {}{}, next {}", e.name, Short(*value), unit_suffix(&e.unit), Short(*next));
    let shown_ones: Vec<String> = found.iter().take(SHOWN_DISCRETES).map(shown).collect();
    let more = if found.len() > SHOWN_DISCRETES { format!("; {} more", found.len() - SHOWN_DISCRETES) } else { String::new() };
    format!("held at initial values, though the updates of a control step change them here: {}{more}\n", shown_ones.join("; "))
}

/// Other steady states than `first` in words: the states, and of what has the same the algebraic
/// variables that differ.
fn others(found: &[Vec<f64>], first: &[f64], catalogue: &Catalogue) -> String {
    const SHOWN: usize = 8;
    let known: Vec<&[f64]> = std::iter::once(first).chain(found.iter().map(Vec::as_slice)).collect();
    let states = catalogue.states.elements();
    let mut text = String::new();
    for (number, y) in known.iter().enumerate().skip(1) {
        // Zero is met to rounding only.
        let value = |e: &Element| if y[e.at].abs() < 1e-12 * e.scale { 0.0 } else { y[e.at] };
        let shown = |e: &Element| format!("{} = {}{}", e.name, Short(value(e)), unit_suffix(&e.unit));
        let others = known.iter().enumerate().filter(|(i, _)| *i != number).map(|(_, other)| other);
        let twins: Vec<&&[f64]> = others.filter(|other| steady::is_same(&states[..states.len().min(SHOWN)], other, y)).collect();
        let differs = |e: &&Element| twins.iter().any(|twin| !steady::is_same(std::slice::from_ref(*e), twin, y));
        let rest = states.iter().skip(SHOWN).chain(catalogue.solved.elements()).filter(differs).take(SHOWN);
        let shown: Vec<String> = states.iter().take(SHOWN).chain(rest).map(shown).collect();
        let more = if states.len() > SHOWN { ", ..." } else { "" };
        // Writing into a string cannot fail.
        let _ = writeln!(text, "another steady state (begin near it by --guess): {}{more}", shown.join(", "));
    }
    text
}

/// Name, unit and value of every state and algebraic output.
fn values(system: &mut smpl_runtime::system::CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> Vec<(String, String, f64)> {
    let yp = vec![0.0; y.len()];
    let mut algebraics = vec![0.0; catalogue.algebraics.len()];
    let (model, memory) = system.parts();
    model.outputs(memory, 0.0, y, &yp, &mut algebraics);
    let row = |e: &Element, value: f64| (e.name.clone(), e.unit.clone(), value);
    let states = catalogue.states.elements().iter().map(|e| row(e, y[e.at]));
    let outputs = catalogue.algebraics.elements().iter().map(|e| row(e, algebraics[e.at]));
    states.chain(outputs).collect()
}

/// The eigenvalues of the linearisation in words.
fn spectrum(system: &mut smpl_runtime::system::CompiledSystem, catalogue: &Catalogue, y: &[f64], rests: bool, time_unit: &str) -> String {
    if catalogue.states.len() > LARGE {
        return format!("eigenvalues: not computed for more than {LARGE} states\n");
    }
    let values = match linearize(system, catalogue, 0.0, y) {
        Ok(linear) => eigenvalues(&linear.minimal().a),
        Err(error) => return format!("eigenvalues: {error}\n"),
    };
    let Some(spectrum) = values else {
        return "eigenvalues: the iteration did not converge\n".into();
    };
    let (values, omitted) = (&spectrum.values, spectrum.omitted);
    let kind = match values.first().map(|v| v.re) {
        _ if !rests => "not at rest",
        Some(re) if re > 1e-9 => "unstable",
        Some(re) if re > -1e-9 => "not asymptotically stable (an eigenvalue is zero)",
        _ => "stable",
    };
    let unit = if time_unit == "1" { String::new() } else { format!(", 1/{time_unit}") };
    let mut text = format!("{kind}; eigenvalues{unit}:\n");
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
