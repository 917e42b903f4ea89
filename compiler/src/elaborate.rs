//! Elaboration: from syntax trees to the flat indexed model.
//!
//! | pass | from | to |
//! |---|---|---|
//! | [`select`] | files, options | the variants and choices in force |
//! | [`declare`] | statements | [`symbols`], frozen from there on |
//! | [`quantities`] | declarations | bounds, defaults and scales as numbers |
//! | [`equations`] | equations, connections | [`Equation`]s |
//! | [`episode`] | the control problem | programs, interface |
//! | [`check`] | unused declarations and inactive alternatives | warnings and faults |
//!
//! All but the first take expressions to nodes by [`lower`], with [`space`] for expressions over
//! the cells of a domain. Names are looked up, shapes and units checked on the text, functions and
//! `let`s expanded, indices over enumerated sets unrolled, and equations over cells become loops.
//! Where a stencil meets the end of a domain, the loop is split on demand. [`lower::cells`]
//! elaborates a body over a range of cells and starts again with a cut where the body needed one.
//! The first, the inner and the last cells each get their own equation, however large the grid is.
//!
//! Faults are collected; a faulty expression becomes *poison*, which fits everywhere and causes no
//! further report.

mod budget;
mod built_ins;
mod check;
mod connections;
mod constants;
mod declare;
mod episode;
mod equation;
mod equations;
mod expansions;
mod formula;
mod hidden;
mod instances;
mod ledger;
mod lower;
mod naming;
pub mod notes;
mod noting;
mod options;
mod outside;
mod quantities;
mod reports;
mod select;
mod space;
mod speculation;
mod symbols;
mod transport;

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Statement};

use crate::ir::ExprId;
use crate::model::{Alternatives, Interface, Model, Time};
use crate::read::Data;
use declare::declaring::{About, Declaring};
use episode::Control;
use ledger::Ledger;
use lower::Lowering;
use select::Input;
use select::variants::Choices;
use symbols::SymbolKind;

pub use built_ins::{built_in_names, is_built_in};
pub(crate) use check::derivative::show_derivatives;
pub(crate) use check::lints::unused_parameters;
pub(crate) use episode::{DISCRETES, STATES, ordered_initial};
pub use episode::{block_entries, is_entry_setting, refused_by_solver, solver_setting};
pub use equation::{Equation, EquationForm};
pub use lower::builtins::{BUILTINS, Builtin};
pub(crate) use lower::nests::for_each_element;
pub use options::{Given, GivenData, Options, Setting};

/// Result of elaboration: the model before structure analysis, and its equations.
#[derive(Debug)]
pub struct Elaborated {
    /// The model; rows are still empty.
    pub model: Model,
    /// All equations.
    pub equations: Vec<Equation>,
    /// True if a range of numbers stayed a loop.
    pub runs: bool,
    /// Expressions whose rates equations read, with their places.
    pub rated: Vec<(ExprId, Span)>,
    /// Warnings.
    pub warnings: Faults,
}

/// Elaborates the main file `files[0]`; `imports` are the files that `use "path"` means, `data`
/// those of tables.
///
/// # Errors
/// All independent faults of the model.
pub fn elaborate(
    files: &[syntax::File],
    (imports, data): (&HashMap<String, usize>, &Data),
    options: &Options,
) -> Result<Elaborated, Faults> {
    let files = &*transport::with_residence_times(files);
    let pass = Pass::over(files, (imports, data), options, 0);
    let (chosen, mut spent) = (pass.chosen, pass.work);
    let mut elaborated = pass.result?;
    if options.lints {
        let mut faults_with = |options: &Options, reading: u32| {
            let pass = Pass::over(files, (imports, data), options, spent.saturating_add(reading));
            spent = pass.work;
            (pass.result.err(), spent)
        };
        let alternatives = check::alternatives::faults_in_alternatives(files, options, &chosen, pass.work, &mut faults_with);
        elaborated.warnings.append(alternatives);
        elaborated.warnings.sort();
    }
    Ok(elaborated)
}

/// One pass over the files, under one selection.
struct Pass {
    /// Result.
    result: Result<Elaborated, Faults>,
    /// Option of each choice.
    chosen: HashMap<String, String>,
    /// The work that it took, with what was spent before.
    work: u32,
}

impl Pass {
    /// Selects, declares and lowers; `spent` is the work that passes before took.
    fn over(files: &[syntax::File], (imports, data): (&HashMap<String, usize>, &Data), options: &Options, spent: u32) -> Pass {
        let mut ledger = Ledger::default();
        ledger.budget.begin_at(spent);
        ledger.budget.cancelled = options.observer.as_ref().map(|observer| observer.cancelled.clone());
        let choices = Choices::of(files);
        let (selected, shown) = choices.select(files, options);
        ledger.reports.diagnostics.append(selected.faults);
        let input = Input { files, imports, data, options, selection: selected.selection };

        let mut declaring = Declaring::new(&input, ledger);
        declaring.work.constants.taken.extend(selected.settings);
        declaring.declare_file();
        let (result, work) = lowered(&input, declaring, shown);
        Pass { result, chosen: input.selection.chosen, work }
    }
}

/// Lowers what is declared; the result, and the work that it took.
fn lowered(input: &Input<'_>, declaring: Declaring<'_, '_>, shown: Alternatives) -> (Result<Elaborated, Faults>, u32) {
    let Declaring { mut symbols, instances, about, mut work, .. } = declaring;
    // What a missing file declares would be missed everywhere.
    let mut passed = None;
    if !work.ledger.reports.diagnostics.iter().any(|d| d.code == codes::UNKNOWN_IMPORT) {
        let mut lowering = Lowering::new(input, &symbols, &instances, &mut work);
        let (equations, control) = all_statements(&mut lowering);
        if let Some(observer) = &input.options.observer {
            observer.write(noting::collected(&lowering));
        }
        let unused = check::unused::components(&lowering);
        sample_faults(input, &unused).into_iter().for_each(|fault| lowering.ledger.report(fault));
        if input.options.lints && !lowering.ledger.reports.has_errors() {
            check::lints::lint(&mut lowering, &control);
            check::balances::lint_masses(&mut lowering);
        }
        passed = Some((equations, control));
    }
    let spent = work.ledger.budget.work();
    let runs = work.ledger.speculation.looped;
    let rated = std::mem::take(&mut work.ledger.rated);
    let warnings = match work.ledger.closed() {
        Ok(warnings) => warnings,
        Err(faults) => return (Err(faults), spent),
    };
    let (equations, control) = passed.unwrap_or_default();
    work.hidden.close(&mut symbols.vars);
    let mut model = model_of(control, about, shown);
    model.interface.reduction.preferred = preferred(&symbols);
    model.interface.time = Time { name: symbols.time_name, unit: symbols.time_unit.to_string() };
    model.interface.draws = work.hidden.draws.list;
    model.quadratures = work.hidden.quadratures.list;
    model.quadrature_units = work.hidden.quadratures.units;
    work.hidden.delays.write(&mut model.programs);
    model.delays = work.hidden.delays.list.into_iter().map(|delayed| delayed.about).collect();
    model.exprs = work.exprs;
    model.vars = symbols.vars;
    (Ok(Elaborated { model, equations, runs, rated, warnings }), spent)
}

/// Paths of the states that are declared with `prefer`.
fn preferred(symbols: &symbols::Symbols<'_>) -> Vec<String> {
    let is_preferred =
        |symbol: &&symbols::Symbol<'_>| matches!(&symbol.kind, SymbolKind::Variable { declaration, .. } if declaration.prefer.is_some());
    symbols.list.values().filter(is_preferred).map(|symbol| symbol.path.clone()).collect()
}

/// Steps after the declarations, in this order.
fn all_statements(l: &mut Lowering<'_, '_>) -> (Vec<Equation>, Control) {
    quantities::declare_defaults(l);
    space::backwards::check_grids(l);
    l.ledger.speculation.enabled = true;
    let equations = equations::elaborate_equations(l);
    let control = episode::elaborate_control(l);
    check::unused::check_unused(l);
    check::balances::check_elements(l);
    (equations, control)
}

/// Faults of components without an instance, elaborated separately from the declarations of the
/// file.
fn sample_faults(input: &Input<'_>, unused: &[&Statement]) -> Vec<Diagnostic> {
    if unused.is_empty() {
        return Vec::new();
    }
    let options = Options::default();
    let Input { files, imports, data, selection, .. } = input;
    let input = Input { files, imports, data, options: &options, selection: selection.clone() };
    let mut declaring = Declaring::new(&input, Ledger::default());
    declaring.declare_samples(unused);
    let Declaring { symbols, instances, mut work, .. } = declaring;
    all_statements(&mut Lowering::new(&input, &symbols, &instances, &mut work));
    work.ledger.reports.name_calls();
    check::unused::of_components(&work.ledger, unused)
}

/// A model with what the control problem says; its expressions and variables are still missing.
fn model_of(control: Control, about: About, shown: Alternatives) -> Model {
    let Control { programs, roots, unknowns, interface } = control;
    let alternatives = Alternatives { levels: interface.alternatives.levels, ..shown };
    let interface = Interface { name: about.name, text: about.text, alternatives, ..interface };
    Model { programs, roots, unknowns, interface, ..Model::default() }
}
