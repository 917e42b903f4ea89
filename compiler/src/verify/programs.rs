//! Invariants of programs: stores inside of variables and outputs, every delayed element once.

use std::ops::Range;

use super::values::{ValueCheck, inside};
use super::{Checked, each_element, ensure, violation};
use crate::functions::{elements, finish_len, start_conditions, steady_len};
use crate::ir::{MAX_DEPTH, Nest, Place, Program, Store, loops_of};
use crate::model::{Finish, Model, RootAction};

/// The effect of an event exists.
pub(super) fn action(model: &Model, finish: &Finish, place: &dyn Fn() -> String, action: RootAction) -> Checked {
    let (at, count, of) = match action {
        RootAction::Restart => return Ok(()),
        RootAction::Fail(at) => (at, finish.failures.len(), "failure"),
        RootAction::Succeed(at) => (at, finish.successes.len(), "success"),
        RootAction::Run(at) => (at, model.programs.events.len(), "program of an event"),
    };
    ensure((at as usize) < count, || format!("{}.does", place()), || format!("there is no {of} {at}, there are {count}"))
}

/// Checks the programs of the model.
pub(super) fn check(model: &Model, values: &mut ValueCheck<'_>) -> Checked {
    for (name, program) in model.programs.named() {
        let len = output_len(model, &name);
        for (n, nest) in program.nests.iter().enumerate() {
            let place = || format!("programs.{name}.nests[{n}]");
            let numbered = nest.loops.len() <= MAX_DEPTH && nest.loops.iter().zip(0..).all(|(&(depth, _), d)| depth == d);
            ensure(numbered, place, || format!("counters of loops are not numbered by depth, up to {MAX_DEPTH}"))?;
            for (s, store) in nest.stores.iter().enumerate() {
                check_store(values, &|| format!("{}.stores[{s}]", place()), nest, store, len)?;
            }
        }
    }
    delays(model)
}

fn check_store(values: &mut ValueCheck<'_>, place: &dyn Fn() -> String, nest: &Nest, store: &Store, len: u32) -> Checked {
    let extents = nest.extents();
    values.any(place, store.value, &extents)?;
    match store.target.place {
        Place::Var(var) => values.element(place, var, store.target.at, &extents),
        Place::Out => inside(place, "the output", store.target.at, &loops_of(&extents), len),
        Place::Table { .. } => violation(place(), "tables of positions belong to the back end"),
    }
}

/// Length of the output of a program.
fn output_len(model: &Model, name: &str) -> u32 {
    let (i, actions) = (&model.interface, elements(&model.interface.quantities.actions));
    let len = match name {
        "steady" => actions + steady_len(model),
        "start_conditions" => start_conditions(model),
        "finish" => finish_len(model),
        "outputs" => elements(&i.quantities.algebraics),
        "invariants" => 2 * i.invariants.len(),
        "boxes" => i.finish.failures.iter().map(|failure| failure.items.len()).sum(),
        "delayed" | "lags" | "before" => model.delayed(),
        name if name.starts_with("policy ") => actions,
        _ => 0,
    };
    u32::try_from(len).unwrap_or(u32::MAX)
}

/// Delayed expression and dead time are stored once for each element, values before the start for
/// those that have one.
fn delays(model: &Model) -> Checked {
    for (i, delay) in model.delays.iter().enumerate() {
        let (low, high) = delay.bounds;
        let bounded = match delay.lag {
            crate::model::Lag::Constant => low == f64::INFINITY && high == f64::INFINITY,
            _ => 0.0 <= low && low <= high,
        };
        ensure(bounded, || format!("delays[{i}].bounds"), || "expected two numbers from 0 on, the lower one first".into())?;
    }
    let mut at = 0;
    let ranges = model.delays.iter().map(|delay| {
        at += delay.count as usize;
        (at - delay.count as usize..at, delay.before)
    });
    let ranges: Vec<(Range<usize>, bool)> = ranges.collect();
    let programs = &model.programs;
    stored_once("delayed", &programs.delayed, &ranges, |_| true)?;
    stored_once("lags", &programs.lags, &ranges, |_| true)?;
    stored_once("before", &programs.before, &ranges, |before| before)
}

fn stored_once(name: &str, program: &Program, ranges: &[(Range<usize>, bool)], needed: impl Fn(bool) -> bool) -> Checked {
    let len = ranges.last().map_or(0, |(range, _)| range.end);
    let mut stored = vec![false; len];
    for nest in &program.nests {
        for store in &nest.stores {
            let fault = |_| violation(format!("programs.{name}"), format!("does not store each of {len} delayed elements once"));
            if store.target.place != Place::Out {
                return fault(Ok(0));
            }
            each_element(&nest.extents(), store.target.at, &mut stored, fault)?;
        }
    }
    let left_out = ranges.iter().any(|(range, before)| needed(*before) && !stored[range.clone()].iter().all(|&stored| stored));
    ensure(!left_out, || format!("programs.{name}"), || "leaves out a delayed element".into())
}
