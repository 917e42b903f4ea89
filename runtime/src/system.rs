//! A compiled model with the memory of one instance, as the solver sees it.

use std::collections::HashSet;
use std::sync::Arc;

use smpl_compiler::compiled::{CompiledModel, WatchKind, WatchRole};
use smpl_compiler::ir::{Expr, ExprId, Flavour};
use smpl_compiler::layout::{FramePart, Memory, Region};
use smpl_compiler::model::{Root, RootAction};

use crate::catalogue::{Catalogue, Element};
use crate::past::{Kept, Past, PastError, Point, Samples};
use crate::solver::nonnegative::seen;
use crate::solver::{Bounds, Pattern, PatternError, RootKind, RootRole, System, Within};

/// Part of its scale at which a nonnegative state is nearly zero.
const NEARLY: f64 = 1e-9;

/// Most inputs of root functions that are compared where an integration begins.
const FEW: usize = 64;

/// Data that the solver needs repeatedly, shared by all instances of a model.
#[derive(Debug)]
struct Shape {
    pattern: Pattern,
    differential: Vec<bool>,
    roots: Vec<RootKind>,
    roots_use_derivatives: bool,
    quadratures: usize,
    quadratures_use_derivatives: bool,
    reads_other_instants: bool,
    /// Places of what root functions read besides unknowns, where these are few.
    watched_inputs: Option<Vec<usize>>,
    /// Of algebraic unknowns.
    bounds: Option<Bounds>,
    nonnegative: Box<[u32]>,
    /// Least values of these at which derivatives are taken.
    nearly_zero: Box<[f64]>,
}

/// A compiled model and everything that one instance of it holds but its unknowns. A clone is a
/// snapshot.
#[derive(Clone)]
pub struct CompiledSystem {
    model: Arc<CompiledModel>,
    shape: Arc<Shape>,
    memory: Memory,
    /// Values and rates of the invariants, where the rates are integrated too.
    invariants: Vec<f64>,
    /// Past of delayed expressions, if there are any.
    past: Option<Box<Past>>,
    /// Unknowns with nonnegative states at zero or above, and upper bounds of them, where there are
    /// such states.
    seen: Option<Box<[Vec<f64>; 2]>>,
}

impl CompiledSystem {
    /// An instance with parameters at their defaults and nominal actions.
    ///
    /// # Errors
    /// When the model's Jacobian has no proper pattern (a fault of the compiler or a damaged
    /// artefact).
    pub fn new(model: Arc<CompiledModel>) -> Result<Self, PatternError> {
        let pattern = model.pattern();
        let catalogue = Catalogue::new(&model);
        let mut nonnegative: Vec<&Element> = catalogue.states.elements().iter().filter(|e| e.nonnegative).collect();
        nonnegative.sort_by_key(|e| e.at);
        let seen = (!nonnegative.is_empty()).then(|| Box::new([vec![0.0; model.unknowns()], vec![0.0; model.unknowns()]]));
        let shape = Shape {
            pattern: Pattern::new(pattern.column_pointers.clone(), pattern.row_indices.clone())?,
            differential: (0..model.unknowns()).map(|i| i < model.states()).collect(),
            roots: model.watched().iter().map(|kind| root_kind(kind, model.roots_info())).collect(),
            roots_use_derivatives: model.roots_use_derivatives(),
            quadratures: model.quadratures(),
            quadratures_use_derivatives: model.quadratures_use_derivatives(),
            reads_other_instants: reads_other_instants(&model),
            watched_inputs: model.watched_inputs().filter(|places| places.len() <= FEW),
            bounds: bounds(&model, &catalogue),
            nonnegative: nonnegative.iter().map(|e| e.at as u32).collect(),
            nearly_zero: nonnegative.iter().map(|e| NEARLY * e.scale).collect(),
        };
        let memory = model.memory();
        let past = Past::new(&model).map(Box::new);
        Ok(Self { model, shape: Arc::new(shape), memory, invariants: Vec::new(), past, seen })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Arc<CompiledModel> {
        &self.model
    }

    /// Model and memory at once, for calls of compiled functions.
    pub fn parts(&mut self) -> (&CompiledModel, &mut Memory) {
        (&self.model, &mut self.memory)
    }

    /// Fills the delayed values at a point, for what reads them there.
    pub fn look_back(&mut self, t: f64, y: &[f64], yp: &[f64]) {
        if let Some(past) = &mut self.past {
            past.fill(&self.model, &mut self.memory, Point { t, y, yp }, false);
        }
    }

    /// Returns whether the equations read delayed values.
    pub(crate) fn looks_back(&self) -> bool {
        self.past.is_some()
    }

    /// From now on there is no past: delayed values are the present ones.
    pub(crate) fn rest_past(&mut self) {
        self.past.iter_mut().for_each(|past| past.rest());
    }

    /// From now on delayed values are those before the start.
    pub(crate) fn start_past(&mut self) {
        self.past.iter_mut().for_each(|past| past.start());
    }

    /// Records what was before the start, which is at this point.
    ///
    /// # Errors
    /// See [`PastError`].
    pub(crate) fn record_start(&mut self, t: f64, y: &[f64], yp: &[f64]) -> Result<(), PastError> {
        let Some(past) = &mut self.past else { return Ok(()) };
        let rtol = self.model.interface().solver.rtol;
        past.record_start(&self.model, &mut self.memory, Point { t, y, yp }, rtol)
    }

    /// Records samples instead of what was recorded before the start.
    ///
    /// # Errors
    /// See [`PastError`].
    pub(crate) fn record_samples(&mut self, t: f64, y: &[f64], yp: &[f64], samples: &Samples) -> Result<(), PastError> {
        let Some(past) = &mut self.past else { return Ok(()) };
        let rtol = self.model.interface().solver.rtol;
        past.record_samples(&self.model, &mut self.memory, Point { t, y, yp }, rtol, samples)
    }

    /// Forgets what no dead time reaches from a time on.
    pub(crate) fn trim_past(&mut self, t: f64) {
        self.past.iter_mut().for_each(|past| past.trim(t));
    }

    /// The past of delayed expressions, if there are any.
    pub(crate) fn past_mut(&mut self) -> Option<&mut Past> {
        self.past.as_deref_mut()
    }

    /// The next time at which an equation changes its form by itself.
    pub(crate) fn next_break_of_equations(&mut self, t: f64) -> f64 {
        self.model.next_break(&mut self.memory, t)
    }

    /// The next time at which a delayed value is not smooth.
    pub(crate) fn next_break_of_past(&self) -> f64 {
        self.past.as_ref().map_or(f64::INFINITY, |past| past.next_break())
    }

    /// Exchanges the past with that of another instance.
    pub(crate) fn exchange_past(&mut self, other: &mut Self) {
        std::mem::swap(&mut self.past, &mut other.past);
    }

    /// Past data of a snapshot.
    pub(crate) fn past(&self) -> Option<&Kept> {
        self.past.as_ref().map(|past| past.kept())
    }

    /// Takes what a snapshot kept of the past; whether it fits.
    pub(crate) fn take_past(&mut self, kept: Option<&Kept>) -> bool {
        match (&mut self.past, kept) {
            (Some(past), Some(kept)) => past.take(kept),
            (past, kept) => past.is_none() && kept.is_none(),
        }
    }

    /// Integrates the rates of the invariants from now on, after the quadratures of the model.
    pub fn watch_invariants(&mut self) {
        self.invariants = vec![0.0; 2 * self.model.interface().invariants.len()];
    }

    /// Returns `true` if an equation reads values of the start of the episode, of the end of the
    /// step before or of the steady state.
    #[must_use]
    pub fn reads_other_instants(&self) -> bool {
        self.shape.reads_other_instants
    }

    /// A region, to be read.
    #[must_use]
    pub fn region(&self, region: Region) -> &[f64] {
        self.memory.region(region)
    }

    /// A region, to be written.
    pub fn region_mut(&mut self, region: Region) -> &mut [f64] {
        self.memory.region_mut(region)
    }

    /// The memory of the instance.
    #[must_use]
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Puts back the numbers of a memory of the same model.
    ///
    /// # Panics
    /// If there are more or fewer of them.
    pub fn restore(&mut self, numbers: &[f64]) {
        self.memory.all_mut().copy_from_slice(numbers);
    }

    /// Keeps the present unknowns, actions, discrete variables and disturbances as those of another
    /// instant.
    pub fn keep(&mut self, y: &[f64], instant: fn(FramePart) -> Region) {
        self.memory.region_mut(instant(FramePart::Y)).copy_from_slice(y);
        for (part, present) in PRESENT {
            self.copy(present, instant(part));
        }
    }

    /// Exchanges the present actions and disturbances with those of another instant.
    pub(crate) fn exchange_inputs(&mut self, instant: fn(FramePart) -> Region) {
        for (part, present) in PRESENT.into_iter().filter(|(part, _)| *part != FramePart::Discrete) {
            for i in 0..self.memory.region(present).len() {
                let value = self.memory.region(present)[i];
                self.memory.region_mut(present)[i] = std::mem::replace(&mut self.memory.region_mut(instant(part))[i], value);
            }
        }
    }

    /// The residual with nonnegative states at zero or above.
    #[inline(never)]
    fn residual_seen(&mut self, t: f64, (y, yp): (&[f64], &[f64]), out: &mut [f64]) {
        let y = self.seen.as_mut().map_or(y, |space| seen(&self.shape.nonnegative, y, &mut space[0]));
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, true);
        self.model.residual(&mut self.memory, t, y, yp, out);
    }

    /// Copies one region over another of the same length.
    pub fn copy(&mut self, from: Region, to: Region) {
        let (from, to) = (self.memory.layout().range(from), self.memory.layout().range(to));
        debug_assert_eq!(from.len(), to.len());
        self.memory.all_mut().copy_within(from, to.start);
    }
}

/// Unknowns with nonnegative states no nearer to zero than a small part of their scale.
fn raised<'a>(shape: &Shape, y: &'a [f64], space: &'a mut [f64]) -> &'a [f64] {
    let states = || shape.nonnegative.iter().zip(&shape.nearly_zero).map(|(&at, &least)| (at as usize, least));
    if states().all(|(at, least)| y[at] >= least) {
        return y;
    }
    space.copy_from_slice(y);
    for (at, least) in states() {
        space[at] = if space[at] < least { least } else { space[at] };
    }
    space
}

/// The bounds of the algebraic unknowns, if there are any.
fn bounds(model: &CompiledModel, catalogue: &Catalogue) -> Option<Bounds> {
    if model.unknowns() == model.states() {
        return None;
    }
    let bounds = Bounds::new(catalogue.solved.elements().iter(), model.unknowns());
    bounds.bind().then_some(bounds)
}

fn reads_other_instants(model: &CompiledModel) -> bool {
    let model = model.model();
    let mut todo: Vec<ExprId> = model.rows.iter().map(|row| row.residual).collect();
    todo.extend(model.programs.start_conditions.nests.iter().flat_map(|nest| &nest.stores).map(|store| store.value));
    let mut seen = HashSet::new();
    while let Some(e) = todo.pop() {
        if !seen.insert(e) {
            continue;
        }
        if matches!(model.exprs.node(e), Expr::Load { flavour: Flavour::Initial | Flavour::Previous | Flavour::Steady, .. }) {
            return true;
        }
        todo.extend(model.exprs.operands(e));
    }
    false
}

/// An event without updates marks a switch in the equations, which matters in both directions.
fn root_kind(kind: &WatchKind, roots: &[Root]) -> RootKind {
    let (both, role) = match kind.role {
        WatchRole::Event(index) => (roots[index as usize].action == RootAction::Restart, RootRole::Event),
        WatchRole::Jump => (true, RootRole::Jump),
        WatchRole::Kink { group } => (true, RootRole::Kink { group }),
    };
    RootKind { strict: kind.strict, both, role, bounded: kind.bounded }
}

/// The present values that a frame keeps in addition to `y`.
const PRESENT: [(FramePart, Region); 3] =
    [(FramePart::Action, Region::Action), (FramePart::Discrete, Region::Discrete), (FramePart::Disturbance, Region::Disturbance)];

/// Fills the delayed values, where there are any.
#[inline]
fn fill(model: &CompiledModel, memory: &mut Memory, past: &mut Option<Box<Past>>, at: Point<'_>, strictly: bool) {
    if let Some(past) = past {
        past.fill(model, memory, at, strictly);
    }
}

impl System for CompiledSystem {
    fn differential(&self) -> &[bool] {
        &self.shape.differential
    }

    fn is_explicit(&self) -> bool {
        self.model.explicit()
    }

    fn bounds(&self) -> Option<&Bounds> {
        self.shape.bounds.as_ref()
    }

    fn nonnegative(&self) -> &[u32] {
        &self.shape.nonnegative
    }

    fn pattern(&self) -> &Pattern {
        &self.shape.pattern
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        if self.seen.is_some() {
            return self.residual_seen(t, (y, yp), out);
        }
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, true);
        self.model.residual(&mut self.memory, t, y, yp, out);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        // A root has no finite slope at zero.
        let y = self.seen.as_mut().map_or(y, |space| raised(&self.shape, y, &mut space[0]));
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, false);
        self.model.jacobian(&mut self.memory, t, y, yp, cj, values);
    }

    fn next_break(&mut self, t: f64) -> f64 {
        self.next_break_of_equations(t).min(self.next_break_of_past())
    }

    fn has_past(&self) -> bool {
        self.past.is_some()
    }

    fn longest_step(&self) -> f64 {
        self.past.as_ref().map_or(f64::INFINITY, |past| past.longest_step())
    }

    fn crosses(&mut self, at: f64) {
        self.past.iter_mut().for_each(|past| past.crosses(at));
    }

    fn begin(&mut self, t: f64, y: &[f64]) {
        if let Some(past) = &mut self.past {
            past.begin(&self.model, &mut self.memory, Point { t, y, yp: y });
        }
    }

    fn begun(&mut self, t: f64, y: &[f64], yp: &[f64], rtol: f64) {
        if let Some(past) = &mut self.past {
            past.begun(&self.model, &mut self.memory, Point { t, y, yp }, rtol);
        }
    }

    fn record(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        let nonnegative = &self.shape.nonnegative;
        if let Some(past) = &mut self.past {
            past.accept(&self.model, &mut self.memory, span, rtol, &mut |t, y, yp| {
                within(t, y, yp);
                nonnegative.iter().for_each(|&at| y[at as usize] = if y[at as usize] < 0.0 { 0.0 } else { y[at as usize] });
            });
        }
    }

    fn depends_on_time(&self) -> bool {
        self.model.depends_on_time()
    }

    fn by_time(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) -> bool {
        let y = self.seen.as_mut().map_or(y, |space| seen(&self.shape.nonnegative, y, &mut space[0]));
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, false);
        self.model.by_time(&mut self.memory, t, y, yp, out)
    }

    fn forcing_count(&self) -> usize {
        self.model.forcings_len()
    }

    fn forcings(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let y = self.seen.as_mut().map_or(y, |space| seen(&self.shape.nonnegative, y, &mut space[0]));
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, false);
        self.model.forcings(&mut self.memory, t, y, yp, out);
    }

    fn root_count(&self) -> usize {
        self.shape.roots.len()
    }

    fn root_kinds(&self) -> &[RootKind] {
        &self.shape.roots
    }

    fn roots_use_derivatives(&self) -> bool {
        self.shape.roots_use_derivatives
    }

    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let y = self.seen.as_mut().map_or(y, |space| seen(&self.shape.nonnegative, y, &mut space[0]));
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, false);
        self.model.roots(&mut self.memory, t, y, yp, out);
    }

    fn watched_unknowns(&self) -> &[u32] {
        self.model.watched_unknowns()
    }

    fn watched_input_count(&self) -> Option<usize> {
        self.shape.watched_inputs.as_ref().map(Vec::len)
    }

    fn watched_inputs(&self, out: &mut [f64]) {
        let places = self.shape.watched_inputs.iter().flatten();
        out.iter_mut().zip(places).for_each(|(out, &at)| *out = self.memory.all()[at]);
    }

    fn root_bounds(&mut self, span: (f64, f64), least: &[f64], most: &[f64], out: &mut [f64]) -> bool {
        let states = &self.shape.nonnegative;
        let (least, most) = match &mut self.seen {
            Some(space) => {
                let [low, high] = &mut **space;
                (seen(states, least, low), seen(states, most, high))
            }
            None => (least, most),
        };
        if let Some(past) = &mut self.past {
            past.bound(&mut self.memory, span);
        }
        self.model.bounds(&mut self.memory, span, (least, most), out);
        true
    }

    fn quadrature_count(&self) -> usize {
        self.shape.quadratures + self.invariants.len() / 2
    }

    fn integrands_read_rates(&self) -> bool {
        self.shape.quadratures_use_derivatives || !self.invariants.is_empty()
    }

    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let y = self.seen.as_mut().map_or(y, |space| seen(&self.shape.nonnegative, y, &mut space[0]));
        let (own, rates) = out.split_at_mut(self.shape.quadratures);
        fill(&self.model, &mut self.memory, &mut self.past, Point { t, y, yp }, false);
        self.model.quadrature_rates(&mut self.memory, t, y, yp, own);
        if !rates.is_empty() {
            self.model.invariants(&mut self.memory, t, y, yp, &mut self.invariants);
            rates.iter_mut().zip(self.invariants.chunks_exact(2)).for_each(|(rate, pair)| *rate = pair[1]);
        }
    }
}
