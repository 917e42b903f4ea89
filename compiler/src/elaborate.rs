//! Elaboration: from syntax trees to the flat indexed model.
//!
//! One pass does what belongs together at the place of writing: names are looked up, shapes and units are checked on what was
//! written, functions and `let`s are expanded, indices over enumerated sets are written out, and equations over the cells of a
//! domain become loops. Where a stencil meets the end of a domain, the loop is split on demand: [`lower::cells`] elaborates a body
//! over a range of cells and starts again with a cut where the body asked for one, so that the first, the inner and the
//! last cells each get their own equation, however large the grid is.
//!
//! Faults are collected; a faulty expression becomes *poison*, which fits everywhere and causes no further report.

mod budget;
mod check;
mod constants;
mod declare;
mod episode;
mod equations;
mod expansions;
mod hidden;
mod ledger;
mod lower;
mod options;
mod reports;
mod select;
mod space;
mod speculation;

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Faults, codes};
use smpl_dsl::syntax;

use crate::ir::{ExprId, Exprs, FastSet};
use crate::model::Model;
use constants::Constants;
use declare::instances::Instances;
use declare::symbols::Symbols;
use episode::Episode;
use expansions::Expansions;
use hidden::Hidden;
use ledger::Ledger;
use lower::cells::Loops;
use lower::place::{Bound, Place, Site};
use select::items::Selection;
use select::variants::Choices;
use space::transport::Fluxes;

pub(crate) use check::lints::unused_parameters;
pub use declare::defaults::for_each_element;
pub use episode::ordered_initial;
pub use equations::{Equation, EquationForm};
pub use lower::builtins::{BUILTINS, Builtin};
pub use options::{ENTRY_SETTINGS, Options, Setting};

/// Result of elaboration: the model before structure analysis, and its equations.
#[derive(Debug)]
pub struct Elaborated {
    /// The model; rows are still empty.
    pub model: Model,
    /// All equations.
    pub equations: Vec<Equation>,
    /// Whether a range of numbers stayed a loop.
    pub runs: bool,
    /// Warnings.
    pub warnings: Faults,
}

/// Elaborates the main file `files[0]`; `imports` tells which file a `use "path"` means.
///
/// # Errors
/// All independent faults of the model.
pub fn elaborate(files: &[syntax::File], imports: &HashMap<String, usize>, options: &Options) -> Result<Elaborated, Faults> {
    let mut elaborator = Elaborator::new(files, imports, options);
    elaborator.run();
    let (chosen, spent) = (elaborator.input.selection.chosen.clone(), elaborator.ledger.budget.work());
    let mut elaborated = elaborator.finish()?;
    if options.lints {
        elaborated.warnings.append(check::alternatives::faults_in_alternatives(files, imports, options, &chosen, spent));
        elaborated.warnings.sort();
    }
    Ok(elaborated)
}

/// What is elaborated.
struct Input<'a> {
    files: &'a [syntax::File],
    imports: &'a HashMap<String, usize>,
    options: &'a Options,
    selection: Selection,
    /// Settings that something took.
    used_settings: FastSet<String>,
}

/// The state of an elaboration, a part for each thing that it keeps.
pub(crate) struct Elaborator<'a> {
    input: Input<'a>,
    ledger: Ledger,
    symbols: Symbols<'a>,
    instances: Instances<'a>,
    exprs: Exprs,
    constants: Constants,
    expansions: Expansions,
    hidden: Hidden,
    loops: Loops,
    fluxes: Fluxes,
    equations: Vec<Equation>,
    episode: Episode<'a>,
    model: Model,
}

impl<'a> Elaborator<'a> {
    fn new(files: &'a [syntax::File], imports: &'a HashMap<String, usize>, options: &'a Options) -> Self {
        let mut symbols = Symbols::default();
        let hidden = Hidden::new(&mut symbols.vars);
        let input = Input { files, imports, options, selection: Selection::default(), used_settings: FastSet::default() };
        Elaborator {
            input,
            ledger: Ledger::default(),
            symbols,
            instances: Instances::default(),
            exprs: Exprs::default(),
            constants: Constants::default(),
            expansions: Expansions::default(),
            hidden,
            loops: Loops::default(),
            fluxes: Fluxes::default(),
            equations: Vec::new(),
            episode: Episode::default(),
            model: Model::default(),
        }
    }

    fn run(&mut self) {
        self.select();
        self.declare_file();
        // What a missing file declares would be missed everywhere.
        if self.ledger.reports.diagnostics.iter().any(|d| d.code == codes::UNKNOWN_IMPORT) {
            return;
        }
        self.declare_defaults();
        self.check_ends();
        self.ledger.speculation.enabled = true;
        self.elaborate_equations();
        self.elaborate_control();
        self.check_unused();
        if self.input.options.lints && !self.ledger.reports.has_errors() {
            self.lint();
        }
    }

    /// Decides which variants are on and which options are chosen; unknown names are faults.
    fn select(&mut self) {
        let choices = Choices::of(self.input.files);
        let mut faults = Faults::default();
        self.input.files.iter().for_each(|file| choices.check_whens(&file.statements, &mut faults));
        let chosen = choices.choose(self.input.options);
        faults.append(chosen.faults);
        self.ledger.reports.diagnostics.append(faults);
        self.model.interface.variants = choices.shown_variants(&chosen.selection);
        self.model.interface.choices = choices.shown_choices(&chosen.selection);
        self.input.selection = chosen.selection;
        self.input.used_settings.extend(chosen.settings);
    }

    fn finish(mut self) -> Result<Elaborated, Faults> {
        self.ledger.budget.fault().into_iter().for_each(|fault| self.ledger.reports.diagnostics.push(fault));
        self.ledger.reports.name_calls();
        self.ledger.reports.diagnostics.sort();
        if self.ledger.reports.has_errors() {
            return Err(self.ledger.reports.diagnostics);
        }
        self.hidden.close(&mut self.symbols.vars);
        let mut model = self.model;
        model.interface.draws = self.hidden.draws.list;
        model.quadratures = self.hidden.quadratures.list;
        model.exprs = self.exprs;
        model.vars = self.symbols.vars;
        let (runs, warnings) = (self.ledger.speculation.looped, self.ledger.reports.diagnostics);
        Ok(Elaborated { model, equations: self.equations, runs, warnings })
    }

    /// The number that an expression of constants and parameters has with the parameters' defaults and means of random numbers.
    fn constant_value(&mut self, e: ExprId) -> Option<f64> {
        if let Some(x) = self.exprs.as_const(e) {
            return Some(x);
        }
        for (var, _) in self.symbols.parameters_in(&self.exprs, e) {
            if let Some(&symbol) = self.symbols.of_var.get(&var) {
                self.know(symbol);
            }
        }
        self.folded(e)
    }

    /// The number of an expression with what is known of the parameters.
    fn folded(&mut self, e: ExprId) -> Option<f64> {
        self.constants.fold(&mut self.exprs, &self.symbols.vars, &self.hidden.draws, e)
    }

    /// Notes that sizes or indices were computed from an expression: its parameters keep their numbers.
    fn mark_structural(&mut self, e: ExprId) {
        let parameters = self.symbols.parameters_in(&self.exprs, e);
        self.constants.mark_structural(parameters.into_iter().map(|p| p.0));
    }
}
