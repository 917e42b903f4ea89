//! A model as a Functional Mock-up Unit of FMI 3.0: its description, and sources that hold the
//! model, an integrator and the interface.
//!
//! The sources are those of the C export, with derivatives for directional derivatives, and files
//! of C that are the same for every model (`fmu/sources`). These read tables that are written here.

mod description;
mod kernel;
mod order;
mod partials;
mod tables;
mod terminals;
mod units;
mod variables;

use std::num::NonZeroU32;

use super::c;
use super::sheet::{Function, Nest, Sheet, Store};
use super::{ExportError, Nominal, Origin, functions};
use crate::explicit_time;
use crate::ir::{Flavour, Role};
use crate::model::Model;

/// Settings of the simulation, as in the environment.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Relative tolerance of the integrator.
    pub rtol: f64,
    /// Absolute tolerance over the relative one times the scale.
    pub atol_factor: f64,
    /// Longest step of the integrator.
    pub max_step: f64,
    /// Most steps between two sampling instants.
    pub max_steps: u32,
    /// Most events there.
    pub max_events: u32,
    /// Most sampling intervals of an episode.
    pub episode: u32,
    /// Algebraic variables enter the error test.
    pub algebraic_errors: bool,
    /// Most steps that the past of delayed expressions holds; `None` for the default of the target.
    pub history: Option<NonZeroU32>,
}

/// The files of an FMU.
pub struct Package {
    /// Name of the binary.
    pub identifier: String,
    /// Path within the archive and text, in the order of the archive.
    pub files: Vec<(String, String)>,
}

/// Default of [`Settings::history`] for an FMU, and for an instance of a kernel.
const HISTORY: [u32; 2] = [10_000, 500];

/// The files of C that are the same for every model.
const SOURCES: [(&str, &str); 12] = [
    ("breaks.c", include_str!("fmu/sources/breaks.c")),
    ("core.c", include_str!("fmu/sources/core.c")),
    ("core.h", include_str!("fmu/sources/core.h")),
    ("fmi3.c", include_str!("fmu/sources/fmi3.c")),
    ("fmi3.h", include_str!("fmu/sources/fmi3.h")),
    ("linear.c", include_str!("fmu/sources/linear.c")),
    ("linear.h", include_str!("fmu/sources/linear.h")),
    ("past.c", include_str!("fmu/sources/past.c")),
    ("past.h", include_str!("fmu/sources/past.h")),
    ("solver.c", include_str!("fmu/sources/solver.c")),
    ("types.h", include_str!("fmu/sources/types.h")),
    ("variables.c", include_str!("fmu/sources/variables.c")),
];

/// Files that models without delays do not need.
const PAST: [&str; 3] = ["past.h", "past.c", "breaks.c"];

pub(super) use kernel::print as kernel;

/// All that a package is made of.
struct Parts<'a> {
    sheet: &'a Sheet,
    settings: &'a Settings,
    identifier: &'a str,
    variables: &'a variables::Variables,
    partials: &'a partials::Partials,
    order: &'a [u32],
    /// The most entries of the factors L and U.
    room: [usize; 2],
    /// Parts that read the steady state, which is that of the exported parameters.
    steady: &'a [String],
    /// Time occurs in the equations.
    timed: bool,
    /// Most steps that the past of delayed expressions holds.
    history: u32,
}

pub(super) fn package(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>, settings: &Settings) -> Result<Package, ExportError> {
    let mut sheet = functions::sheet(model, nominal)?;
    refuse(&sheet)?;
    let steady = readers_of_steady(&sheet);
    let identifier = c::identifier(&sheet.model.interface.name);
    let timed = sheet.function("residual").is_some_and(|f| sheet.uses_time(f));
    let partials = partials::add(&mut sheet)?;
    add_next_break(&mut sheet)?;
    let text = c::write(&mut sheet, origin, "model")?;
    let variables = variables::Variables::new(&sheet, !steady.is_empty())?;
    let order = order::order(&text.pattern);
    let parts = Parts {
        sheet: &sheet,
        settings,
        identifier: &identifier,
        variables: &variables,
        partials: &partials,
        order: &order,
        room: order::most_entries(&text.pattern, &order),
        steady: &steady,
        timed,
        history: settings.history.map_or(HISTORY[0], NonZeroU32::get),
    };
    let [header, source] = tables::print(&parts);
    let mut sources: Vec<(String, String)> = shared(&sheet).map(|(name, text)| (name.to_owned(), text.to_owned())).collect();
    sources.extend([("model.c", text.source), ("model.h", text.header), ("tables.c", source)].map(|(name, text)| (name.to_owned(), text)));
    sources.push(("tables.h".into(), header));
    sources.sort();
    let description = description::model(&parts, origin, "");
    let token = token(&description, &sources);
    sources.iter_mut().filter(|(name, _)| name == "tables.h").for_each(|(_, text)| *text = text.replace(TOKEN, &token));
    let mut files = vec![("modelDescription.xml".to_owned(), description::model(&parts, origin, &token))];
    files.push(("resources/elements.csv".into(), description::elements(&parts)));
    files.extend(terminals::describe(&parts).map(|text| ("terminalsAndIcons/terminalsAndIcons.xml".to_owned(), text)));
    files.push(("sources/buildDescription.xml".into(), description::build(&parts, &sources)));
    files.extend(sources.into_iter().map(|(name, text)| (format!("sources/{name}"), text)));
    Ok(Package { identifier, files })
}

/// Files of C that a model needs.
fn shared(sheet: &Sheet) -> impl Iterator<Item = (&'static str, &'static str)> {
    SOURCES.into_iter().filter(|(name, _)| !PAST.contains(name) || !sheet.model.delays.is_empty())
}

/// Stands for the token until it is known.
const TOKEN: &str = "@TOKEN@";

/// Identifier of an FMU: a hash of its content.
fn token(description: &str, sources: &[(String, String)]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(description.as_bytes());
    sources.iter().for_each(|(name, text)| {
        hasher.update(name.as_bytes()).update(text.as_bytes());
    });
    let hex = hasher.finalize().to_hex();
    format!("{{{}}}", &hex[..32])
}

/// Returns `true` if a function reads an integral over the step, which only the environment has.
fn reads_integral(sheet: &Sheet, function: &Function) -> bool {
    sheet.loads(function).iter().any(|&(var, _)| sheet.model.vars[var].role == Role::Quadrature)
}

/// Returns `true` if an FMU calls a function. It has start values instead of the programs that
/// compute them.
fn is_carried(function: &Function) -> bool {
    let left_out = ["rewards", "successes", "constraints", "invariants", "integrals", "boxes", "initial_states", "initial_discretes"];
    !left_out.contains(&function.name.as_str()) && !function.name.starts_with("policy_")
}

/// Parts that would be wrong numbers in an FMU.
fn refuse(sheet: &Sheet) -> Result<(), ExportError> {
    let episode = &sheet.model.interface.episode;
    if let Some(delay) = sheet.model.delays.first().filter(|_| episode.integrate != episode.step) {
        return Err(ExportError::Clock { delay: delay.name.clone() });
    }
    for function in sheet.functions.iter().filter(|f| is_carried(f)) {
        for (var, flavour) in sheet.loads(function) {
            match (sheet.model.vars[var].role, flavour) {
                (Role::Algebraic, Flavour::Derivative) => return Err(ExportError::AlgebraicDerivative { function: function.name.clone() }),
                (Role::Quadrature, _) => return Err(ExportError::Integral { function: function.name.clone() }),
                _ => {}
            }
        }
    }
    Ok(())
}

/// Functions that read the steady state.
fn readers_of_steady(sheet: &Sheet) -> Vec<String> {
    let reads = |f: &&Function| sheet.loads(f).iter().any(|(_, flavour)| *flavour == Flavour::Steady);
    sheet.functions.iter().filter(|f| is_carried(f)).filter(reads).map(|f| f.name.clone()).collect()
}

/// The function that gives the next time at which an equation changes its form.
fn add_next_break(sheet: &mut Sheet) -> Result<(), ExportError> {
    let rows = crate::differentiate::rows(&mut sheet.model)?;
    let Some(value) = explicit_time::collect(&mut sheet.model, &rows).next_break else { return Ok(()) };
    let nests = vec![Nest { loops: vec![], stores: vec![Store { array: None, positions: vec![0], add: false, value }] }];
    let text = "the next time at which an equation changes its form".to_owned();
    sheet.functions.push(Function { name: "next_break".into(), text, nests, update: false, outputs: vec![] });
    Ok(())
}
