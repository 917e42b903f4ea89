//! Code of all functions, by one thread or two.

use std::cmp::Reverse;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use super::{Code, Effort, GenerateError, Generator, Plan, plan};
use crate::ir::Exprs;
use crate::layout::Layout;
use crate::schedule::{Access, Staged};
use smpl_dsl::stack::make_room;

/// Models with fewer nodes are compiled sooner than a thread has started.
const WORTH_A_THREAD: usize = 1000;

/// A function to be generated.
pub(crate) struct Request<'a> {
    /// Task.
    pub staged: &'a Staged,
    /// Accessible memory.
    pub access: Access,
    /// Optimisation level.
    pub effort: Effort,
    /// Its place among the plans: what takes longest comes first.
    pub rank: u8,
}

/// The code of a function.
#[derive(Debug)]
pub(crate) struct Generated {
    /// Pieces, to be called one after another.
    pub codes: Vec<Code>,
    /// Time that planning and generating took, on whichever thread.
    pub time: Duration,
}

impl Generated {
    /// Bytes of machine code.
    #[must_use]
    pub(crate) fn size(&self) -> usize {
        self.codes.iter().map(|c| c.bytes.len()).sum()
    }
}

/// Generates all functions, with the help of a second thread if that is worth it: plans of all
/// first, then their pieces, the longest first. With `texts` intermediate text and assembly are
/// kept.
///
/// # Errors
/// If a staged program addresses what it cannot have, or Cranelift refuses.
pub(crate) fn generate(requests: &[Request<'_>], exprs: &Exprs, layout: &Layout, texts: bool) -> Result<Vec<Generated>, GenerateError> {
    let helped = exprs.len() >= WORTH_A_THREAD;
    let plans = plans(requests, exprs, layout, helped)?;
    let numbered = plans.iter().enumerate().flat_map(|(i, (plan, _))| (0..plan.pieces().len()).map(move |k| (i, k)));
    let mut pieces: Vec<(usize, usize)> = numbered.collect();
    pieces.sort_by_key(|&(i, k)| Reverse(plans[i].0.pieces()[k].size()));
    let codes = side_by_side(pieces.len(), helped, || {
        let (mut generator, plans, pieces) = (Generator::new(texts), &plans, &pieces);
        move |n: usize| {
            let ((i, k), started) = (pieces[n], Instant::now());
            let (request, plan) = (&requests[i], &plans[i].0);
            let code = generator.compile(plan, &plan.pieces()[k], exprs, layout, request.access.name, request.effort);
            code.map(|code| (code, started.elapsed()))
        }
    });
    let empty = |(plan, time): &(Plan, Duration)| Generated { codes: vec![Code::default(); plan.pieces().len()], time: *time };
    let mut generated: Vec<Generated> = plans.iter().map(empty).collect();
    for ((i, k), code) in pieces.into_iter().zip(codes) {
        let (code, time) = code?;
        generated[i].codes[k] = code;
        generated[i].time += time;
    }
    Ok(generated)
}

/// The plan of each request, with the time it took.
fn plans(requests: &[Request<'_>], exprs: &Exprs, layout: &Layout, helped: bool) -> Result<Vec<(Plan, Duration)>, GenerateError> {
    let mut order: Vec<usize> = (0..requests.len()).collect();
    order.sort_by_key(|&i| requests[i].rank);
    let found = side_by_side(requests.len(), helped, || {
        |n: usize| {
            let (request, started) = (&requests[order[n]], Instant::now());
            plan(request.staged, exprs, layout, request.access).map(|plan| (plan, started.elapsed()))
        }
    });
    let mut plans = order.iter().zip(found).map(|(&i, plan)| Ok((i, plan?))).collect::<Result<Vec<_>, GenerateError>>()?;
    plans.sort_by_key(|&(i, _)| i);
    Ok(plans.into_iter().map(|(_, plan)| plan).collect())
}

/// Does so many tasks, with the help of a second thread if that is worth it; results in the order
/// of tasks.
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
        let help = || {
            make_room();
            work();
        };
        // Without a second thread this one does it all.
        let _ = helped.then(|| thread::Builder::new().spawn_scoped(scope, help));
        work();
    });
    results.into_iter().filter_map(OnceLock::into_inner).collect()
}
