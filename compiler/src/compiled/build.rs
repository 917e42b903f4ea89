//! The list of passes.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use cranelift_entity::SecondaryMap;
use serde::{Deserialize, Serialize};
use smpl_dsl::span::Span;

use super::{BackEndError, Function, Parts, Tapes};
use crate::differentiate::{self, Column, Rows, pattern};
use crate::explicit_time;
use crate::generate::reroll::reroll;
use crate::generate::schedule::{Access, Job, Sink, Task};
use crate::generate::{self, Code, Effort, GenerateError, Generator, Plan};
use crate::hoist::{Hoister, Stage};
use crate::interpret::Tape;
use crate::ir::{Affine, BUILTIN_COUNT, Builtin, ExprId, Exprs, Flavour, LoopVar, Program, Role, VarId};
use crate::layout::Layout;
use crate::model::{Model, Quantity, Variable};

/// Models with fewer nodes are compiled sooner than a thread has started.
const WORTH_A_THREAD: usize = 1000;

/// Choices of the back end.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct BackEndSettings {
    /// Compile quickly instead of well.
    pub quick: bool,
    /// Keep intermediate text and assembly for [`crate::emit`].
    pub texts: bool,
}

/// What compiling took and gave.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompileStatistics {
    /// Time of differentiation and of the pattern.
    pub differentiate: Duration,
    /// Time of hoisting and layout.
    pub hoist: Duration,
    /// Time of code generation.
    pub generate: Duration,
    /// Bytes of machine code.
    pub code_bytes: usize,
    /// Non-zeros of the Jacobian.
    pub nonzeros: usize,
    /// Nodes of all expressions.
    pub expressions: usize,
    /// Numbers in caches.
    pub cached: usize,
    /// Time of code generation and bytes of each compiled function.
    pub functions: Vec<(String, Duration, usize)>,
}

/// Runs the passes.
pub(super) fn passes(mut model: Model, settings: &BackEndSettings) -> Result<Parts, BackEndError> {
    let started = Instant::now();
    let unknowns = check_square(&model)?;
    let mut tables: Vec<u32> = model.slots.concat();
    let rows = rows(&mut model)?;
    let entries = jacobian_entries(&mut model, &rows);
    let pattern = pattern::Pattern::new(&entries, unknowns);
    let jacobian = pattern::job(&entries, &pattern, &mut model.exprs, &mut tables);
    let differentiated = Instant::now();

    let time = explicit_time::collect(&mut model, &rows);
    let (has_breaks, forcings, timed) = (time.next_break.is_some(), time.forcing_count, time.in_equations);
    let mut jobs = jobs(&model, &rows, jacobian);
    jobs.extend([(Function::NextBreak, time.next_break.unwrap_or_default()), (Function::Forcings, time.forcings)]);
    for (_, job) in jobs.iter_mut().filter(|(f, _)| is_program(*f)) {
        *job = reroll(std::mem::take(job), &mut model.exprs);
    }
    let mut hoister = Hoister::new(&mut model);
    for (function, job) in &mut jobs {
        *job = hoister.job(job, limit(*function));
    }
    let (prepare_parameters, prepare_step) = hoister.finish();
    jobs.insert(0, (Function::PrepareStep, prepare_step));
    let layout = Layout::new(&model, 0);
    let hoisted = Instant::now();

    let plan = |(function, job): &(Function, Job)| {
        let started = Instant::now();
        let access = access(*function, &model, unknowns, (pattern.nonzeros(), forcings as usize));
        generate::plan(job, &model.exprs, &layout, access).map(|plan| (plan, started.elapsed()))
    };
    let compile = |generator: &mut Generator, function: Function, plan: &Plan, piece: usize| {
        let effort = if settings.quick { Effort::Lukewarm } else { effort(function) };
        let started = Instant::now();
        let code = generator.compile(plan, &plan.pieces()[piece], &model.exprs, &layout, function.name(), effort);
        code.map(|code| (code, started.elapsed()))
    };
    let helped = model.exprs.len() >= WORTH_A_THREAD;
    let generated = generate(&jobs, helped, || Generator::new(settings.texts), plan, compile)?;
    let size = |codes: &[Code]| codes.iter().map(|c| c.bytes.len()).sum::<usize>();
    let named = jobs.iter().zip(&generated);
    let functions = named.map(|((f, _), (codes, time))| (f.name().to_owned(), *time, size(codes))).collect();
    let codes: Vec<Vec<Code>> = generated.into_iter().map(|(codes, _)| codes).collect();
    let statistics = CompileStatistics {
        differentiate: differentiated - started,
        hoist: hoisted - differentiated,
        generate: hoisted.elapsed(),
        code_bytes: codes.iter().map(|codes| size(codes)).sum(),
        nonzeros: pattern.nonzeros(),
        expressions: model.exprs.len(),
        cached: model.vars.values().filter(|v| v.role == Role::Cache).map(|v| v.len as usize).sum(),
        functions,
    };
    Ok(Parts { model, pattern, tables, codes, prepare_parameters, has_breaks, forcings, timed, statistics })
}

/// The pieces of each job with the time that they took.
type Generated = Vec<(Vec<Code>, Duration)>;

/// Generates the code of all jobs, with the help of a second thread if that is worth it: plans of all jobs first, then their pieces,
/// the longest first.
fn generate(
    jobs: &[(Function, Job)],
    helped: bool,
    generator: impl Fn() -> Generator + Sync,
    plan: impl Fn(&(Function, Job)) -> Result<(Plan, Duration), GenerateError> + Sync,
    compile: impl Fn(&mut Generator, Function, &Plan, usize) -> Result<(Code, Duration), GenerateError> + Sync,
) -> Result<Generated, GenerateError> {
    let mut order: Vec<usize> = (0..jobs.len()).collect();
    order.sort_by_key(|&i| (jobs[i].0 != Function::Jacobian, jobs[i].0 != Function::Residual));
    let found = side_by_side(jobs.len(), helped, || |n: usize| plan(&jobs[order[n]]));
    let mut plans = order.iter().zip(found).map(|(&i, plan)| Ok((i, plan?))).collect::<Result<Vec<_>, GenerateError>>()?;
    plans.sort_by_key(|&(i, _)| i);
    let plans: Vec<(Plan, Duration)> = plans.into_iter().map(|(_, plan)| plan).collect();
    let numbered = plans.iter().enumerate().flat_map(|(i, (plan, _))| (0..plan.pieces().len()).map(move |k| (i, k)));
    let mut pieces: Vec<(usize, usize)> = numbered.collect();
    pieces.sort_by_key(|&(i, k)| std::cmp::Reverse(plans[i].0.pieces()[k].size()));
    let codes = side_by_side(pieces.len(), helped, || {
        let (mut generator, plans, pieces, compile) = (generator(), &plans, &pieces, &compile);
        move |n: usize| {
            let (i, k) = pieces[n];
            compile(&mut generator, jobs[i].0, &plans[i].0, k)
        }
    });
    let mut generated: Generated = plans.iter().map(|(plan, time)| (vec![Code::default(); plan.pieces().len()], *time)).collect();
    for ((i, k), code) in pieces.into_iter().zip(codes) {
        let (code, time) = code?;
        generated[i].0[k] = code;
        generated[i].1 += time;
    }
    Ok(generated)
}

/// Does so many tasks, with the help of a second thread if that is worth it; results in the order of tasks.
fn side_by_side<R: Send + Sync, W: FnMut(usize) -> R>(count: usize, helped: bool, worker: impl Fn() -> W + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results: Vec<OnceLock<R>> = (0..count).map(|_| OnceLock::new()).collect();
    let work = || {
        let mut task = worker();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(result) = results.get(number) else { break };
            // Each task is taken once.
            let _ = result.set(task(number));
        }
    };
    thread::scope(|scope| {
        // Without a second thread this one does it all.
        let _ = helped.then(|| thread::Builder::new().spawn_scoped(scope, work));
        work();
    });
    results.into_iter().filter_map(OnceLock::into_inner).collect()
}

fn check_square(model: &Model) -> Result<usize, BackEndError> {
    let unknowns = model.unknowns.iter().map(|v| model.vars[*v].len as usize).sum();
    let rows = model.rows.iter().map(|r| r.extents.iter().map(|&e| e as usize).product::<usize>()).sum();
    if unknowns == rows { Ok(unknowns) } else { Err(BackEndError::NotSquare { unknowns, rows }) }
}

/// Position in `y` of each unknown's first element.
pub(super) fn positions(model: &Model) -> SecondaryMap<VarId, Option<u32>> {
    let mut positions = SecondaryMap::new();
    let mut next = 0;
    for &var in &model.unknowns {
        positions[var] = Some(next);
        next += model.vars[var].len;
    }
    positions
}

/// The equations in the order of `y`, ready to be differentiated.
pub(super) fn rows(model: &mut Model) -> Result<Vec<Rows>, BackEndError> {
    let positions = positions(model);
    let mut rows = Vec::with_capacity(model.rows.len());
    for row in &model.rows {
        let column_of = |var: VarId, flavour: Flavour| {
            let wanted = matches!(flavour, Flavour::Value | Flavour::Derivative);
            positions[var].filter(|_| wanted).map(|first| Column { first, factor: None })
        };
        let value = differentiate::normalise(&mut model.exprs, row.extents.len(), row.residual, &column_of)?;
        let first = i64::from(positions[row.var].unwrap_or(0));
        rows.push(Rows { extents: row.extents.clone(), row: row.at.plus(Affine::constant(first)), value });
    }
    Ok(joined(&mut model.exprs, rows))
}

/// The rows with those at the ends of a loop, often split off where a boundary might differ, taken into the loop where they do not.
fn joined(exprs: &mut Exprs, rows: Vec<Rows>) -> Vec<Rows> {
    let mut out: Vec<Rows> = Vec::with_capacity(rows.len());
    for row in rows {
        let before = out.pop();
        match before {
            Some(mut before) if continues(exprs, &before, &row) => {
                if let Some(extent) = before.extents.last_mut() {
                    *extent += 1;
                }
                out.push(before);
            }
            before => out.extend(before.into_iter().chain([row])),
        }
    }
    out
}

/// Whether a row is the next pass of the innermost loop of the one before.
fn continues(exprs: &mut Exprs, before: &Rows, row: &Rows) -> bool {
    let Some((&extent, outer)) = before.extents.split_last() else { return false };
    let d = outer.len();
    let next = i64::from(extent);
    let mut at = before.row;
    at.offset += at.strides[d] * next;
    at.strides[d] = 0;
    outer == row.extents && at == row.row && exprs.shift(before.value, LoopVar(d as u8), next) == row.value
}

fn jacobian_entries(model: &mut Model, rows: &[Rows]) -> Vec<differentiate::Entry> {
    let positions = positions(model);
    let builtin = builtin_variable(model);
    let at = Affine::constant(Builtin::DerivativeFactor as i64);
    let factor = model.exprs.load(builtin, Flavour::Value, at);
    let column_of = |var: VarId, flavour: Flavour| {
        let first = positions[var]?;
        match flavour {
            Flavour::Value => Some(Column { first, factor: None }),
            Flavour::Derivative => Some(Column { first, factor: Some(factor) }),
            _ => None,
        }
    };
    differentiate::entries(&mut model.exprs, rows, &column_of)
}

fn builtin_variable(model: &mut Model) -> VarId {
    let known = model.vars.iter().find(|(_, v)| v.role == Role::Builtin).map(|(id, _)| id);
    known.unwrap_or_else(|| {
        let name = "builtin".into();
        model.vars.push(Variable { name, role: Role::Builtin, len: BUILTIN_COUNT, span: Span::default() })
    })
}

/// One number each, in order.
fn numbers(values: impl Iterator<Item = ExprId>) -> Job {
    let stores = (0..).zip(values).map(|(i, value)| (Sink::Out(Affine::constant(i)), value)).collect();
    Job { stages: vec![vec![Task { loops: vec![], stores }]], in_place: false }
}

/// The compiled functions but the one that fills caches, in the order of [`Function::ALL`].
fn jobs(model: &Model, rows: &[Rows], jacobian: Job) -> Vec<(Function, Job)> {
    let residual = rows
        .iter()
        .map(|row| Task { loops: (0..).zip(row.extents.iter().copied()).collect(), stores: vec![(Sink::Out(row.row), row.value)] });
    let residual = Job { stages: vec![residual.collect()], in_place: false };
    let programs = &model.programs;
    let program = |program: &Program| rebase(program.job(), model);
    vec![
        (Function::Residual, residual),
        (Function::Jacobian, jacobian),
        (Function::Roots, numbers(model.roots.iter().map(|r| r.value))),
        (Function::Quadratures, numbers(model.quadratures.iter().copied())),
        (Function::Start, program(&programs.start)),
        (Function::End, program(&programs.end)),
        (Function::Finish, program(&programs.finish)),
        (Function::Outputs, program(&programs.outputs)),
        (Function::Disturb, program(&programs.disturb)),
    ]
}

/// Tables of the model stand one after another: their numbers become starts.
fn rebase(mut job: Job, model: &Model) -> Job {
    for (sink, _) in job.stages.iter_mut().flatten().flat_map(|t| &mut t.stores) {
        if let Sink::Table { table, .. } = sink {
            *table = model.slots.iter().take(*table as usize).map(|s| s.len() as u32).sum();
        }
    }
    job
}

/// Caches that a function may use: discrete variables may have changed since the step was prepared.
fn limit(function: Function) -> Stage {
    match function {
        Function::Residual | Function::Jacobian | Function::Roots | Function::Quadratures => Stage::Step,
        Function::NextBreak | Function::Forcings => Stage::Step,
        _ => Stage::Parameter,
    }
}

/// Programs are often written element by element; equations are loops already.
fn is_program(function: Function) -> bool {
    matches!(function, Function::Start | Function::End | Function::Finish | Function::Outputs | Function::Disturb)
}

fn effort(function: Function) -> Effort {
    match function {
        Function::Residual | Function::Jacobian | Function::Roots | Function::Quadratures => Effort::Hot,
        _ => Effort::Lukewarm,
    }
}

fn elements(quantities: &[Quantity]) -> usize {
    quantities.iter().map(Quantity::len).sum()
}

/// Length of the output of `steady` after the actions.
pub(super) fn steady_len(model: &Model) -> usize {
    model.interface.steady_fixed.len() + model.interface.steady_conditions as usize
}

/// Length of the output of `finish`.
pub(super) fn finish_len(model: &Model) -> usize {
    let f = &model.interface.finish;
    (2 * f.failures + f.successes + f.constraints + f.rewards + f.observations) as usize
}

fn access(function: Function, model: &Model, unknowns: usize, (nonzeros, forcings): (usize, usize)) -> Access {
    let name = function.name();
    let (y, yp, out) = match function {
        Function::PrepareStep | Function::Disturb => (false, false, 0),
        Function::NextBreak => (false, false, 1),
        Function::Forcings => (true, true, forcings),
        Function::Residual => (true, true, unknowns),
        Function::Jacobian => (true, true, nonzeros),
        Function::Roots => (true, true, model.roots.len()),
        Function::Quadratures => (true, true, model.quadratures.len()),
        Function::Start | Function::End => (true, false, 0),
        Function::Finish => (true, true, finish_len(model)),
        Function::Outputs => (true, true, elements(&model.interface.algebraics)),
    };
    Access { name, y, yp, out }
}

/// Prepares what is interpreted.
pub(super) fn tapes(parts: &Parts, layout: &Layout) -> Result<Tapes, BackEndError> {
    let (model, programs) = (&parts.model, &parts.model.programs);
    let tape =
        |name: &'static str, job: &Job, y: bool, yp: bool, out: usize| Tape::new(job, &model.exprs, layout, Access { name, y, yp, out });
    let program = |name, program: &Program, y, yp, out| tape(name, &rebase(program.job(), model), y, yp, out);
    let actions = elements(&model.interface.actions);
    let boxed = model.interface.failures.iter().map(|f| f.items.len()).sum();
    let steady = actions + steady_len(model);
    Ok(Tapes {
        prepare_parameters: tape("prepare_parameters", &parts.prepare_parameters, false, false, 0)?,
        parameters: program("parameters", &programs.parameters, false, false, 0)?,
        initial_states: program("initial_states", &programs.initial_states, true, false, 0)?,
        initial_discretes: program("initial_discretes", &programs.initial_discretes, true, false, 0)?,
        steady: program("steady", &programs.steady, true, false, steady)?,
        invariants: program("invariants", &programs.invariants, true, true, 2 * model.interface.invariants.len())?,
        boxes: program("boxes", &programs.boxes, true, true, boxed)?,
        events: programs.events.iter().map(|p| program("event", p, true, false, 0)).collect::<Result<_, _>>()?,
        policies: programs.policies.iter().map(|(_, p)| program("policy", p, true, false, actions)).collect::<Result<_, _>>()?,
    })
}
