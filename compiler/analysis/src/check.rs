//! Diagnostics of a text, and what the compiler derived from it.

use std::collections::HashMap;
use std::sync::atomic::Ordering;

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_compiler::elaborate::notes::{Notes, Observer};
use smpl_compiler::model::{Model, Quantity};
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;

use crate::program::{Program, loaded};
use crate::symbols::SymbolId;
use crate::texts::Texts;

/// Facts of a symbol beyond its declaration.
#[derive(Clone, Debug, Default)]
pub struct Fact {
    /// Values and bounds, once for each instance.
    pub quantities: Vec<Quantity>,
    /// Unit, declared or derived.
    pub unit: Option<Unit>,
    /// Number of cells or members.
    pub size: Option<usize>,
    /// Lines of the equations that determine it, counted from 1.
    pub determined_by: Vec<usize>,
}

/// Facts by the path of a symbol, so that they outlive the text that they were derived from.
pub type Facts = HashMap<String, Fact>;

/// The result of a check.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Faults and warnings; their files are those of the program.
    pub diagnostics: Vec<Diagnostic>,
    /// Facts of symbols.
    pub facts: Facts,
    /// The text is a model without errors.
    pub valid: bool,
}

/// Diagnostics of a flat model that need more than the front end.
pub type Further<'a> = &'a dyn Fn(Model) -> Vec<Diagnostic>;

/// Compiles a program as far as the flat model, which `further` judges; `None` if the observer
/// cancelled it.
#[must_use]
pub fn check(program: &Program, texts: &(dyn Texts + Sync), observer: &Observer, further: Further<'_>) -> Option<Checked> {
    let main = program.files.first()?;
    let mut sources = SourceMap::new();
    let id = sources.add(main.path.display().to_string(), main.text.as_ref());
    let options = Options { lints: true, observer: Some(observer.clone()), ..Options::default() };
    let mut loader = |written: &str| loaded(&main.path, written, texts);
    let result = flatten(&mut sources, id, &mut loader, &options);
    if observer.cancelled.load(Ordering::Relaxed) {
        return None;
    }
    let mut facts = Facts::default();
    note_facts(program, observer.take(), &mut facts);
    let mut diagnostics = match result {
        Ok((model, mut warnings)) => {
            note_equations(program, &model, &mut facts);
            warnings.extend(further(model));
            warnings
        }
        Err(faults) => faults,
    };
    let valid = !diagnostics.iter().any(Diagnostic::is_error);
    if program.is_library() {
        diagnostics.retain(|d| !of_models_alone(d));
    }
    Some(Checked { diagnostics, facts, valid })
}

/// Returns whether a diagnostic asks for what a file of components does not need.
fn of_models_alone(d: &Diagnostic) -> bool {
    d.code == codes::NO_EPISODE || d.code == codes::UNDERDETERMINED && d.primary.span == Span::default()
}

fn note_facts(program: &Program, notes: Notes, facts: &mut Facts) {
    let by_place: HashMap<Span, SymbolId> =
        program.symbols().iter().flat_map(|(id, symbol)| symbol.sites.iter().map(move |site| (site.name, id))).collect();
    let mut of = |span: &Span, note: &mut dyn FnMut(&mut Fact)| {
        if let Some(&id) = by_place.get(span) {
            note(facts.entry(program.symbols().path(id)).or_default());
        }
    };
    for (span, quantity) in notes.quantities {
        of(&span, &mut |fact| fact.quantities.push(quantity.clone()));
    }
    for (span, unit) in notes.units {
        of(&span, &mut |fact| fact.unit = Some(unit.clone()));
    }
    for (span, size) in notes.sizes {
        of(&span, &mut |fact| fact.size = Some(size));
    }
}

fn note_equations(program: &Program, model: &Model, facts: &mut Facts) {
    let by_declaration: HashMap<Span, SymbolId> =
        program.symbols().iter().flat_map(|(id, symbol)| symbol.sites.iter().map(move |site| (site.declaration, id))).collect();
    for row in &model.rows {
        let Some(&id) = by_declaration.get(&model.vars[row.var].span) else { continue };
        let (line, fact) = (program.line(row.span), facts.entry(program.symbols().path(id)).or_default());
        if !fact.determined_by.contains(&line) {
            fact.determined_by.push(line);
        }
    }
}
