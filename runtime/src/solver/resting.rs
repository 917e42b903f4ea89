//! Systems without states: algebra only, which time and inputs move.
//!
//! The methods step differential equations. A system without unknowns gets one at rest, y' = 0,
//! which nothing reads and no caller sees. Events, integrals and forcings are then those of every
//! other system.

use super::{Advance, Bounds, Carried, Edge, Integrator, Pattern, PatternError, RootKind, Settings, SolveError, Statistics, System};

/// A system with an unknown at rest before its own.
struct WithRest<'s> {
    inner: Inner<'s>,
    shape: &'s Shape,
}

/// The system itself: lent for a call, or shown to the constructor of a method, which evaluates
/// nothing.
enum Inner<'s> {
    Lent(&'s mut dyn System),
    Shown(&'s dyn System),
}

impl Inner<'_> {
    fn shown(&self) -> &dyn System {
        match self {
            Inner::Lent(system) => &**system,
            Inner::Shown(system) => *system,
        }
    }

    fn lent(&mut self) -> Option<&mut dyn System> {
        match self {
            Inner::Lent(system) => Some(&mut **system),
            Inner::Shown(_) => None,
        }
    }
}

/// Properties of such a system that need no evaluation.
struct Shape {
    differential: Vec<bool>,
    pattern: Pattern,
    bounds: Option<Bounds>,
    kinds: Vec<RootKind>,
    watched: Vec<u32>,
}

impl Shape {
    fn new(system: &dyn System) -> Result<Self, PatternError> {
        let (differential, pattern) = (system.differential(), system.pattern());
        let starts = [0].into_iter().chain(pattern.column_starts().iter().map(|start| start + 1)).collect();
        let rows = [0].into_iter().chain(pattern.rows().iter().map(|row| row + 1)).collect();
        Ok(Self {
            differential: [true].into_iter().chain(differential.iter().copied()).collect(),
            pattern: Pattern::new(starts, rows)?,
            bounds: system.bounds().map(Bounds::behind_a_rest),
            kinds: system.root_kinds().to_vec(),
            watched: system.watched_unknowns().iter().map(|at| at + 1).collect(),
        })
    }
}

impl System for WithRest<'_> {
    fn differential(&self) -> &[bool] {
        &self.shape.differential
    }

    fn is_explicit(&self) -> bool {
        true
    }

    fn bounds(&self) -> Option<&Bounds> {
        self.shape.bounds.as_ref()
    }

    fn pattern(&self) -> &Pattern {
        &self.shape.pattern
    }

    fn integrands_read_rates(&self) -> bool {
        self.inner.shown().integrands_read_rates()
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        out[0] = -yp[0];
        if let Some(system) = self.inner.lent() {
            system.residual(t, &y[1..], &yp[1..], &mut out[1..]);
        }
    }

    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        values[0] = -cj;
        if let Some(system) = self.inner.lent() {
            system.jacobian(t, &y[1..], &yp[1..], cj, &mut values[1..]);
        }
    }

    fn next_break(&mut self, t: f64) -> f64 {
        self.inner.lent().map_or(f64::INFINITY, |system| system.next_break(t))
    }

    fn depends_on_time(&self) -> bool {
        self.inner.shown().depends_on_time()
    }

    fn by_time(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) -> bool {
        out[0] = 0.0;
        self.inner.lent().is_some_and(|system| system.by_time(t, &y[1..], &yp[1..], &mut out[1..]))
    }

    fn forcing_count(&self) -> usize {
        self.inner.shown().forcing_count()
    }

    fn forcings(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        if let Some(system) = self.inner.lent() {
            system.forcings(t, &y[1..], &yp[1..], out);
        }
    }

    fn root_count(&self) -> usize {
        self.inner.shown().root_count()
    }

    fn roots_use_derivatives(&self) -> bool {
        self.inner.shown().roots_use_derivatives()
    }

    fn root_kinds(&self) -> &[RootKind] {
        &self.shape.kinds
    }

    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        if let Some(system) = self.inner.lent() {
            system.roots(t, &y[1..], &yp[1..], out);
        }
    }

    fn watched_unknowns(&self) -> &[u32] {
        &self.shape.watched
    }

    fn watched_input_count(&self) -> Option<usize> {
        self.inner.shown().watched_input_count()
    }

    fn watched_inputs(&self, out: &mut [f64]) {
        self.inner.shown().watched_inputs(out);
    }

    fn root_bounds(&mut self, span: (f64, f64), least: &[f64], most: &[f64], out: &mut [f64]) -> bool {
        self.inner.lent().is_some_and(|system| system.root_bounds(span, &least[1..], &most[1..], out))
    }

    fn reports_jumps(&self) -> bool {
        self.inner.shown().reports_jumps()
    }

    fn quadrature_count(&self) -> usize {
        self.inner.shown().quadrature_count()
    }

    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        if let Some(system) = self.inner.lent() {
            system.quadratures(t, &y[1..], &yp[1..], out);
        }
    }
}

/// A method for a system without states.
pub(super) struct Resting {
    method: Box<dyn Integrator>,
    shape: Shape,
    /// The unknowns and their rates, that at rest first.
    y: Vec<f64>,
    yp: Vec<f64>,
}

/// Constructor of a method.
type Maker = fn(&dyn System, Settings) -> Result<Box<dyn Integrator>, SolveError>;

impl Resting {
    /// The method that `make` gives for the system with an unknown at rest.
    pub(super) fn new(system: &dyn System, mut settings: Settings, make: Maker) -> Result<Self, SolveError> {
        let shape = Shape::new(system)?;
        settings.atol.insert(0, 1.0);
        let method = make(&WithRest { inner: Inner::Shown(system), shape: &shape }, settings).map_err(without_rest)?;
        let n = shape.differential.len();
        Ok(Self { method, shape, y: vec![0.0; n], yp: vec![0.0; n] })
    }
}

impl Integrator for Resting {
    fn restart(&mut self, system: &mut dyn System, t0: f64, y: &[f64], yp: Option<&[f64]>) -> Result<(), SolveError> {
        let n = self.y.len() - 1;
        if y.len() != n {
            return Err(SolveError::Length { name: "y", given: y.len(), expected: n });
        }
        self.y[1..].copy_from_slice(y);
        if let Some(yp) = yp.filter(|yp| yp.len() == n) {
            self.yp[1..].copy_from_slice(yp);
        }
        let mut whole = WithRest { inner: Inner::Lent(system), shape: &self.shape };
        self.method.restart(&mut whole, t0, &self.y, yp.is_some().then_some(self.yp.as_slice())).map_err(without_rest)
    }

    fn advance(&mut self, system: &mut dyn System, t_end: f64) -> Result<Advance, SolveError> {
        let mut whole = WithRest { inner: Inner::Lent(system), shape: &self.shape };
        self.method.advance(&mut whole, t_end).map_err(without_rest)
    }

    fn forget(&mut self) {
        self.method.forget();
    }

    fn carried(&self) -> Carried {
        self.method.carried()
    }

    fn carry(&mut self, carried: Carried) {
        self.method.carry(carried);
    }

    fn time(&self) -> f64 {
        self.method.time()
    }

    fn state(&self) -> &[f64] {
        &self.method.state()[1..]
    }

    fn derivative(&self) -> &[f64] {
        &self.method.derivative()[1..]
    }

    fn quadratures(&self) -> &[f64] {
        self.method.quadratures()
    }

    fn events(&self) -> &[i32] {
        self.method.events()
    }

    fn edges(&self) -> &[Edge] {
        self.method.edges()
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        self.method.edges_mut()
    }

    fn undefined_event(&self) -> Option<usize> {
        self.method.undefined_event()
    }

    fn statistics(&self) -> Statistics {
        self.method.statistics()
    }
}

/// An error in the numbers of the system itself.
fn without_rest(mut error: SolveError) -> SolveError {
    let own = |at: &mut usize| *at = at.saturating_sub(1);
    match &mut error {
        SolveError::TooManySteps { unknown, .. }
        | SolveError::StepTooSmall { unknown, .. }
        | SolveError::ErrorTestFailures { unknown, .. }
        | SolveError::ConvergenceFailures { unknown, .. }
        | SolveError::InitialConditions { unknown, .. }
        | SolveError::ImplicitInitialConditions { unknown, .. }
        | SolveError::Outside { unknown, .. }
        | SolveError::SingularJacobian { column: unknown, .. } => {
            *unknown = unknown.filter(|at| *at > 0);
            unknown.iter_mut().for_each(own);
        }
        SolveError::Switching { at: places, .. } => {
            for place in places {
                *place = place.and_then(|(at, value)| Some((at.checked_sub(1)?, value)));
            }
        }
        SolveError::NotFinite { row, .. } | SolveError::Diagonal { row } => own(row),
        SolveError::JacobianNotFinite { row, column, .. } => [row, column].into_iter().for_each(own),
        SolveError::Negative { unknown, .. } | SolveError::Algebraic { unknown } => own(unknown),
        _ => {}
    }
    error
}
