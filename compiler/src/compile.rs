//! The list of passes, from text to machine code: the one way that the command, Python and the
//! tests take.
//!
//! | part | from | to |
//! |---|---|---|
//! | [`flatten`] | texts, [`Options`] | a flat [`Model`]: variables, rows, programs, interface |
//! | [`CompiledModel::build`] | the flat model, [`BackEndSettings`] | a [`CompiledModel`] |
//!
//! [`compile`] is both.

use std::time::Instant;

use smpl_dsl::diagnostic::{Diagnostic, Faults, SourceMap, codes};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::stack::on_own_stack;

use crate::compiled::{BackEndError, BackEndSettings, CompileStatistics, CompiledModel, Parts};
use crate::differentiate::pattern::Pattern;
use crate::elaborate::{self, Elaborated, Equation, Options};
use crate::explicit_time::ExplicitTime;
use crate::functions::{self, Function, Lengths};
use crate::generate::{Effort, Generated, Request, generate};
use crate::hoist::Hoister;
use crate::ir::{Exprs, Role};
use crate::layout::Layout;
use crate::model::{Interface, Model};
use crate::read::{Loader, independent, read};
use crate::schedule::{Staged, reroll};
use crate::switches::Watched;
use crate::verify::{Violation, verify_equations};
use crate::{differentiate, explicit_time, schedule, structure};

#[cfg(test)]
mod tests;

/// Result of a compilation.
pub struct Compiled {
    /// The model.
    pub model: CompiledModel,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
    /// Imports, among the sources.
    pub imports: Vec<FileId>,
}

/// Compiles a file of `sources` with all that it imports.
///
/// # Errors
/// All independent faults of the texts; one at the head of the file where the back end refuses.
pub fn compile(
    sources: &mut SourceMap,
    main: FileId,
    loader: &mut Loader,
    options: &Options,
    settings: &BackEndSettings,
) -> Result<Compiled, Vec<Diagnostic>> {
    on_own_stack(|| {
        let before = sources.len();
        let (model, warnings) = flatten(sources, main, loader, options)?;
        let imports = (before..sources.len()).map(|i| FileId(i as u16)).collect();
        let whole = Span { file: main, start: 0, end: 0 };
        let refused = |error: BackEndError| vec![Diagnostic::error(codes::BACK_END, error.to_string(), whole)];
        let model = CompiledModel::build(model, settings).map_err(refused)?;
        Ok(Compiled { model, warnings, imports })
    })
}

/// Compiles a file of `sources` to a flat model, with the warnings, on a new stack, since a
/// caller's thread may have a small one.
///
/// # Errors
/// All independent faults of the text and of what it imports.
pub fn flatten(
    sources: &mut SourceMap,
    main: FileId,
    loader: &mut Loader,
    options: &Options,
) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let (model, warnings) = on_own_stack(|| front_end(sources, main, loader, options)).map_err(Faults::shown)?;
    Ok((model, warnings.shown()))
}

impl CompiledModel {
    /// Compiles a flat model.
    ///
    /// # Errors
    /// If an equation cannot be differentiated, a program addresses what it cannot have, or no code
    /// can be made.
    pub fn build(model: Model, settings: &BackEndSettings) -> Result<CompiledModel, BackEndError> {
        on_own_stack(|| CompiledModel::assemble(back_end(model, settings)?))
    }
}

/// Texts to a flat model.
fn front_end(sources: &mut SourceMap, main: FileId, loader: &mut Loader, options: &Options) -> Result<(Model, Faults), Faults> {
    let data: Vec<String> = options.files().map(str::to_owned).collect();
    let texts = read(sources, main, options.extra, &data, loader);
    // With so many faults not all are known, so that consequences cannot be distinguished from
    // causes.
    if texts.faults.more() > 0 {
        return Err(texts.faults);
    }
    let elaborated = match elaborate::elaborate(&texts.files, (&texts.imports, &texts.data), options) {
        Ok(_) if !texts.faults.is_empty() => return Err(texts.faults),
        Ok(elaborated) => elaborated,
        Err(faults) => return Err(independent(sources, texts.faults, faults)),
    };
    let (mut model, mut warnings) = determine(elaborated, options.verify || cfg!(debug_assertions)).map_err(|mut faults| {
        elaborate::show_derivatives(&texts.files, sources, &mut faults);
        faults
    })?;
    describe_reduction(&mut model.interface, sources);
    if model.interface.name.is_empty() {
        model.interface.name = named_after(sources.name(main));
    }
    if options.lints {
        elaborate::unused_parameters(&model, sources, main, &texts.ids).into_iter().for_each(|w| warnings.push(w));
    }
    Ok((model, warnings))
}

/// Puts places and texts of equations into the record of index reduction.
fn describe_reduction(interface: &mut Interface, sources: &SourceMap) {
    let file = |span: Span| std::path::Path::new(sources.name(span.file)).file_name().unwrap_or_default().to_string_lossy();
    let place = |span: Span| format!("{}:{}", file(span), sources.locate(span).line);
    let text = |span: Span| sources.text(span).split_whitespace().collect::<Vec<_>>().join(" ");
    for one in &mut interface.reduction.differentiated {
        (one.place, one.text) = (place(one.span), text(one.span));
    }
    for unsteady in &interface.reduction.unsteady {
        if let Some(failure) = interface.finish.failures.get_mut(unsteady.failure as usize) {
            failure.text = format!(
                "what has to be differentiated at {} jumps, since `{}` passed a threshold; use values of the parameters for which it does not",
                place(unsteady.span),
                unsteady.of
            );
        }
    }
    for guard in &interface.reduction.guards {
        let mut places: Vec<String> = guard.spans.iter().map(|span| place(*span)).collect();
        places.dedup();
        let names = guard.names.join("`, `");
        if let Some(failure) = interface.finish.failures.get_mut(guard.failure as usize) {
            let equation = if places.len() == 1 { "equation" } else { "equations" };
            let places = places.join(" and ");
            let is_state =
                |name: &String| interface.reduction.demoted.iter().any(|demoted| demoted.elements.contains(name) || demoted.name == *name);
            let help = match guard.names.iter().any(is_state) {
                true => "declare it with `prefer`, so that another state follows",
                false => "declare it with `state`",
            };
            failure.text = format!("the {equation} at {places} no longer determines `{names}`; {help}");
        }
    }
}

/// Name of a model without a name: that of its file.
fn named_after(file: &str) -> String {
    let stem = std::path::Path::new(file).file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let name: String = stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { "model".to_owned() }
}

/// Assigns equations to unknowns: completes the model, equations to rows. With `verify` the
/// invariants are checked after each pass.
fn determine(elaborated: Elaborated, verify: bool) -> Result<(Model, Faults), Faults> {
    let Elaborated { mut model, mut equations, runs, rated, warnings } = elaborated;
    let check = |pass: &str, model: &Model, equations: &[Equation]| {
        if verify {
            sound(pass, verify_equations(model, equations));
        }
    };
    check("elaborate", &model, &equations);
    macro_rules! pass {
        ($call:expr) => {{
            let made = $call;
            check(stringify!($call), &model, &equations);
            made
        }};
    }
    pass!(structure::drop_unused_delays(&mut model, &mut equations));
    pass!(structure::approximate_delays(&mut model, &mut equations)?);
    pass!(structure::settle_repeats(&mut model, &mut equations));
    pass!(structure::cut_at_parts(&mut model, &mut equations));
    if runs {
        pass!(structure::write_out_ranges(&mut model, &mut equations));
    }
    pass!(structure::watch_rates(&mut model, &rated)?);
    pass!(structure::expand_rates(&mut model, &mut equations)?);
    pass!(structure::solve_for_derivatives(&mut model.exprs, &model.vars, &mut equations));
    pass!(structure::combine_rates(&mut model, &mut equations));
    let rates = structure::cover_states(&model, &equations)?;
    pass!(structure::substitute_derivatives(&mut model, &mut equations));
    let written = equations.clone();
    let plan = pass!(structure::plan_algebraic(&mut model, &mut equations));
    pass!(structure::substitute_algebraic(&mut model, &mut equations, &plan));
    pass!(structure::substitute_derivatives(&mut model, &mut equations));
    model.rows = structure::match_rows(&mut model, equations, &written, &plan, &rates)?;
    structure::refuse_singular_loops(&model)?;
    model.explicit = structure::is_explicit(&model);
    if verify {
        sound("match_rows", model.verify());
    }
    structure::order_initial(&mut model)?;
    structure::identify_ports(&mut model);
    if verify {
        sound("identify_ports", model.verify());
    }
    Ok((model, warnings))
}

/// Ends the program where a pass has broken an invariant: a fault of the compiler, found by tests.
fn sound(pass: &str, verified: Result<(), Violation>) {
    if let Err(violation) = verified {
        panic!("the pass `{pass}` breaks an invariant of the model: {violation}");
    }
}

/// Computations of the functions of a model.
struct Planned {
    /// In the order of [`Function::ALL`].
    functions: Vec<(Function, Staged)>,
    /// Fills the caches once parameters are set.
    prepare_parameters: Staged,
    /// Pattern of the Jacobian.
    pattern: Pattern,
    /// Positions in outputs.
    tables: Vec<u32>,
    /// Explicit time in the equations.
    time: ExplicitTime,
    /// Events and switches for the integrator.
    watched: Watched,
    /// There are derivatives of the equations by time.
    has_slopes: bool,
    /// When the derivatives were there.
    differentiated: Instant,
}

/// Derivatives, and what is computed in which loop and ahead of it.
fn planned(model: &mut Model) -> Result<Planned, BackEndError> {
    let unknowns = check_square(model)?;
    let mut tables = vec![];
    let rows = differentiate::rows(model)?;
    let entries = differentiate::jacobian(model, &rows);
    let pattern = Pattern::new(&entries, unknowns);
    let jacobian = schedule::of_entries(&entries, &pattern, &mut model.exprs, &mut tables);
    let differentiated = Instant::now();

    let time = explicit_time::collect(model, &rows);
    let watched = Watched::new(model, &time);
    let slopes = if time.in_equations { differentiate::by_time(&mut model.exprs, &rows) } else { None };
    let by_time = slopes.as_deref().map_or_else(Staged::default, Staged::of_rows);
    let functions = functions::staged(model, &rows, (jacobian, by_time), &time, &watched);
    let functions = rerolled(functions, &mut model.exprs);
    let (functions, prepare_parameters) = hoisted(functions, model);
    Ok(Planned { functions, prepare_parameters, pattern, tables, time, watched, has_slopes: slopes.is_some(), differentiated })
}

/// A flat model to machine code.
fn back_end(mut model: Model, settings: &BackEndSettings) -> Result<Parts, BackEndError> {
    let started = Instant::now();
    let Planned { functions, prepare_parameters, pattern, tables, time, watched, has_slopes, differentiated } = planned(&mut model)?;
    let layout = Layout::new(&model, 0);
    let hoisted = Instant::now();

    let (nonzeros, forcings) = (pattern.nonzeros(), time.forcing_count());
    let lengths = Lengths { nonzeros, forcings: forcings as usize, watched: watched.kinds.len() };
    let request = |(function, staged)| request(function, staged, &model, lengths, settings.quick);
    let requests: Vec<Request<'_>> = functions.iter().map(|(function, staged)| request((*function, staged))).collect();
    let generated = generate(&requests, &model.exprs, &layout, settings.texts)?;
    let named = functions.iter().map(|(function, _)| function.name().to_owned());
    let statistics = CompileStatistics {
        differentiate: differentiated - started,
        hoist: hoisted - differentiated,
        generate: hoisted.elapsed(),
        code_bytes: generated.iter().map(Generated::size).sum(),
        nonzeros,
        expressions: model.exprs.len(),
        cached: model.vars.values().filter(|v| v.role == Role::Cache).map(|v| v.len as usize).sum(),
        functions: named.zip(&generated).map(|(name, g)| (name, g.time, g.size())).collect(),
    };
    let codes = generated.into_iter().map(|g| g.codes).collect();
    let (breaks, timed) = (time.break_count(), time.in_equations);
    Ok(Parts { model, pattern, tables, codes, prepare_parameters, breaks, forcings, timed, has_slopes, watched, statistics })
}

fn check_square(model: &Model) -> Result<usize, BackEndError> {
    let unknowns = model.unknowns.iter().map(|v| model.vars[*v].len as usize).sum();
    let rows = model.rows.iter().map(|r| r.extents.iter().map(|&e| e as usize).product::<usize>()).sum();
    if unknowns == rows { Ok(unknowns) } else { Err(BackEndError::NotSquare { unknowns, rows }) }
}

/// The functions; of those that are programs, runs of stores as loops.
fn rerolled(functions: Vec<(Function, Staged)>, exprs: &mut Exprs) -> Vec<(Function, Staged)> {
    let mut pass = |(function, staged): (Function, Staged)| (function, if function.is_program() { reroll(staged, exprs) } else { staged });
    functions.into_iter().map(&mut pass).collect()
}

/// The functions in the order of [`Function::ALL`] with what is known before they run in caches,
/// and what fills the caches once parameters are set.
fn hoisted(functions: Vec<(Function, Staged)>, model: &mut Model) -> (Vec<(Function, Staged)>, Staged) {
    let mut hoister = Hoister::new(model);
    let dynamic: Vec<_> = functions.iter().map(|(function, staged)| (*function, hoister.staged(staged, function.limit()))).collect();
    let (prepare_parameters, prepare_step) = hoister.finish();
    let functions = [(Function::PrepareStep, prepare_step)].into_iter().chain(dynamic).collect();
    (functions, prepare_parameters)
}

fn request<'j>(function: Function, staged: &'j Staged, model: &Model, lengths: Lengths, quick: bool) -> Request<'j> {
    let effort = if quick { Effort::Lukewarm } else { function.effort() };
    Request { staged, access: function.access(model, lengths), effort, rank: function.rank() }
}
