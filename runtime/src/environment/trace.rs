//! Traces between sampling instants: values at points within each step, and the events, for
//! pictures.
//!
//! A traced environment steps as any other, but reads values of its integrator on the way. Its
//! results agree with those of an untraced one to the tolerances, not to the bit. For both, step
//! two of them.

use smpl_compiler::layout::Region;
use smpl_compiler::model::RootAction;

use super::Environment;
use crate::solver::{Advance, SolveError};

/// A number that is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Followed {
    /// An unknown, by its place in `y`.
    Unknown(usize),
    /// An algebraic output, by its place in the output vector.
    Output(usize),
    /// A discrete variable, by its place in its region.
    Discrete(usize),
}

/// Trace since tracing began.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    followed: Vec<Followed>,
    points: u32,
    outputs: Vec<f64>,
    /// Time of each point; an instant of a jump appears twice.
    pub times: Vec<f64>,
    /// Values, point after point, in the order in which they are followed.
    pub values: Vec<f64>,
    /// Time and root function of each event that went on.
    pub events: Vec<(f64, usize)>,
}

impl Environment {
    /// Follows these numbers from now on, at `points` instants a step.
    pub fn trace(&mut self, followed: Vec<Followed>, points: u32) {
        let outputs = followed.iter().any(|f| matches!(f, Followed::Output(_)));
        let width = if outputs { self.catalogue().algebraics.len() } else { 0 };
        self.trace = Some(Box::new(Trace { followed, points: points.max(1), outputs: vec![0.0; width], ..Trace::default() }));
    }

    /// Returns the trace and ends tracing.
    pub fn take_trace(&mut self) -> Option<Trace> {
        self.trace.take().map(|trace| *trace)
    }

    /// Goes to `end`, or to an event before it, by way of the points of the trace.
    pub(super) fn advance_traced(&mut self, begin: f64, end: f64) -> Result<Advance, SolveError> {
        let points = self.trace.as_ref().map_or(1, |trace| trace.points);
        let (first, interval) = (self.begin, (self.end_time() - self.begin) / f64::from(points));
        self.note_point(begin);
        for point in 1..=points {
            let target = if point == points { end } else { first + f64::from(point) * interval };
            if target <= begin || target > end {
                continue;
            }
            let outcome = self.integrator.advance(&mut self.system, target)?;
            self.note_point(self.integrator.time());
            if outcome == Advance::Event {
                return Ok(outcome);
            }
        }
        Ok(Advance::Reached)
    }

    fn note_point(&mut self, t: f64) {
        let Some(mut trace) = self.trace.take() else { return };
        let (y, yp) = (self.integrator.state(), self.integrator.derivative());
        if !trace.outputs.is_empty() {
            self.system.look_back(t, y, yp);
            let (model, memory) = self.system.parts();
            model.outputs(memory, t, y, yp, &mut trace.outputs);
        }
        trace.times.push(t);
        let discretes = self.system.region(Region::Discrete);
        let value = |followed: &Followed| match *followed {
            Followed::Unknown(at) => y[at],
            Followed::Output(at) => trace.outputs[at],
            Followed::Discrete(at) => discretes[at],
        };
        trace.values.extend(trace.followed.iter().map(value));
        self.trace = Some(trace);
    }

    /// Notes the events that fired at `t`.
    pub(super) fn note_events(&mut self, t: f64) {
        let Some(trace) = self.trace.as_mut() else { return };
        let roots = self.setup.model().roots_info().iter().zip(self.integrator.events());
        let runs = roots
            .enumerate()
            .filter(|(_, (root, fired))| **fired > 0 && !matches!(root.action, RootAction::Fail(_) | RootAction::Succeed(_)));
        trace.events.extend(runs.map(|(index, _)| (t, index)));
    }
}
