//! Models of other forms, turned into text of the language: `smpl import`.
//!
//! What is read is [SBML](https://sbml.org), Levels 2 and 3, the core. The XML is read into an SBML
//! model in which no relevant part is passed over. Every symbol gets its role (parameter, state,
//! discrete variable, named expression, algebraic variable); then the text is written. What cannot
//! be carried is refused with its line.
//!
//! SBML converts no units, and the language does. Units are declared only if they do not change
//! numbers. The text is written with and without units, and both are compiled. If the first does
//! not compile or computes anything else, the second is used, with the reason.

mod comp;
mod convert;
mod document;
mod events;
mod extents;
mod fast;
mod first;
mod initial;
mod known;
mod lookup;
mod math;
mod names;
mod order;
mod past;
mod prepare;
mod roles;
mod staged;
mod start;
mod tickets;
mod ties;
mod trigger;
mod units;
mod writer;
mod xml;

use std::path::Path;

use smpl_compiler::compiled::{CompiledModel, Region};
use smpl_dsl::stack::on_own_stack;

use smpl_runtime::load::{LoadError, LoadOptions, Loaded, load_text};

/// A model as text of the language.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Imported {
    /// The text of an `.eq` file.
    pub text: String,
    /// Reason why units are not declared; `None` if they are.
    pub without_units: Option<String>,
}

/// Reason why a file is not turned into a model.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub(crate) enum ImportError {
    /// No XML.
    #[error("line {line}: invalid XML: {message}")]
    Xml {
        /// Place.
        line: u32,
        /// Message of the reader.
        message: String,
    },
    /// Something that has no counterpart, or that is invalid in the file itself.
    #[error("line {line}: {message}")]
    Refused {
        /// Line in the file.
        line: u32,
        /// Name of the element.
        message: String,
    },
    /// The equations are invalid: they do not determine the unknowns, for example.
    #[error("the equations of the file make no model: {0}")]
    Equations(String),
}

/// Turns an SBML document into text of the language; `file` is its name.
///
/// # Errors
/// See [`ImportError`].
pub(crate) fn sbml(xml: &str, file: &str) -> Result<Imported, ImportError> {
    on_own_stack(|| convert_sbml(xml, file))
}

fn convert_sbml(xml: &str, file: &str) -> Result<Imported, ImportError> {
    let document =
        roxmltree::Document::parse(xml).map_err(|error| ImportError::Xml { line: error.pos().row, message: error.to_string() })?;
    let line = |at: usize| document.text_pos_at(at.min(xml.len())).row;
    let in_file = |fault: xml::Fault| ImportError::Refused { line: line(fault.at), message: fault.message };
    let flat = comp::flatten(&document).map_err(in_file)?;
    let refused = |fault: xml::Fault| {
        let at = flat.as_ref().map_or(fault.at, |flat| flat.origin(fault.at));
        ImportError::Refused { line: line(at), message: fault.message }
    };
    let mut sbml = match &flat {
        None => document::read(&document),
        Some(flat) => match roxmltree::Document::parse(&flat.xml) {
            Ok(document) => document::read(&document),
            Err(error) => Err(xml::Fault { at: 0, message: format!("submodels without a flat form: {error}") }),
        },
    }
    .map_err(refused)?;
    prepare::prepare(&mut sbml).map_err(refused)?;
    let write = |bare: Option<&str>| convert::write(&sbml, &convert::Head { file, bare }).map_err(refused);
    let plain_text = write(Some(""))?;
    let plain = compiled(&plain_text).map_err(ImportError::Equations)?;
    let why = match convert::unit_without_symbols(&sbml) {
        Some(id) => format!("the unit `{id}` has no symbol here."),
        None => {
            let text = write(None)?;
            match compiled(&text) {
                Ok(with_units) if agree(&plain, &with_units) => return Ok(Imported { text, without_units: None }),
                Ok(_) => "a factor would be put where units differ, and SBML puts none.".to_owned(),
                Err(message) => format!("they do not balance ({message})."),
            }
        }
    };
    Ok(Imported { text: write(Some(&why))?, without_units: Some(why) })
}

/// Compiles a text; the first fault in words.
fn compiled(text: &str) -> Result<Loaded, String> {
    let loaded = load_text(Path::new("imported.eq"), text.to_owned(), &LoadOptions::default());
    loaded.map_err(|error| match error {
        LoadError::Diagnostics { sources, diagnostics } => {
            let first = diagnostics.iter().find(|d| d.is_error());
            first.map_or_else(String::new, |d| {
                let line = sources.file(d.primary.span.file).and_then(|file| {
                    let number = sources.locate(d.primary.span).line;
                    file.text()
                        .lines()
                        .nth(number.checked_sub(1)?)
                        .map(|line| format!(", in `{}`", line.split("    \"").next().unwrap_or(line).trim()))
                });
                format!("{}{}", d.message, line.unwrap_or_default())
            })
        }
        other => other.to_string(),
    })
}

/// Returns `true` if two models compute the same numbers: parameters, initial values, rates,
/// conditions, and what events set.
fn agree(first: &Loaded, second: &Loaded) -> bool {
    let (a, b) = (numbers(&first.model), numbers(&second.model));
    let close = |(x, y): (&f64, &f64)| x == y || x.is_nan() && y.is_nan() || (x - y).abs() <= 1e-9 * x.abs().max(y.abs());
    a.len() == b.len() && a.iter().zip(&b).all(close)
}

fn numbers(model: &CompiledModel) -> Vec<f64> {
    let n = model.unknowns();
    let mut all = vec![];
    let mut memory = model.memory();
    model.parameters(&mut memory);
    model.prepare_parameters(&mut memory);
    let mut start: Vec<f64> = vec![1.0; n];
    model.initial_states(&mut memory, &mut start);
    model.initial_discretes(&mut memory, &mut start);
    all.extend(start.iter().chain(memory.region(Region::Param)).chain(memory.region(Region::Discrete)));
    for point in 0..4_u32 {
        let about = |i: usize| 0.3 + f64::from((i as u32 * 7 + point * 5) % 11) / 7.0;
        let y: Vec<f64> =
            (0..n).map(|i| start[i] * if point == 0 { 1.0 } else { about(i) } + if point > 1 { about(i + 3) } else { 0.0 }).collect();
        let yp: Vec<f64> = (0..n).map(|i| about(i + 1)).collect();
        let t = f64::from(point) * 0.7;
        model.prepare_step(&mut memory);
        let mut residual = vec![0.0; n];
        model.residual(&mut memory, t, &y, &yp, &mut residual);
        let mut roots = vec![0.0; model.watched().len()];
        model.roots(&mut memory, t, &y, &yp, &mut roots);
        let mut outputs = vec![0.0; model.interface().quantities.algebraics.iter().map(smpl_compiler::model::Quantity::len).sum()];
        model.outputs(&mut memory, t, &y, &yp, &mut outputs);
        all.extend(residual.into_iter().chain(roots).chain(outputs));
        for event in 0..model.model().programs.events.len() {
            let (mut after, mut memory) = (y.clone(), memory.clone());
            model.event(event, &mut memory, t, &mut after);
            all.extend(after.iter().chain(memory.region(Region::Discrete)));
        }
    }
    all
}
