//! Making an integrator: everything that is allocated, and everything IDA gets once.

use super::super::callbacks::{Bridge, History, Tolerances};
use super::super::consistent::Consistent;
use super::super::forcing::Forcing;
use super::super::linear::Factorisation;
use super::super::newton::Newton;
use super::super::nonnegative::Nonnegative;
use super::super::quadrature::Integrals;
use super::super::sundials::{Context, Memory};
use super::super::vector::{Operations, Vector};
use super::super::watch::Watch;
use super::super::{Pattern, Settings, SolveError, System};
use super::{Ida, Past, Phase, Shape};

impl Ida {
    pub(super) fn with_operations(system: &dyn System, settings: Settings, operations: Operations) -> Result<Self, SolveError> {
        let n = system.dimension();
        settings.validate(n)?;
        check_shape(system)?;
        let context = &Context::new()?;
        let mut bridge = bridge(system, &settings, operations, context)?;
        let sharing = || Vector::sharing(n, operations, context, &bridge.shared);
        let (y, yp) = (sharing(), sharing());
        let later = (system.root_count() > 0 || system.has_past()).then(|| (sharing(), sharing()));
        let derivative = (system.root_count() > 0 && system.roots_use_derivatives()).then(sharing);
        bridge.derivative = derivative;
        let bounded = system.root_kinds().iter().any(|kind| kind.bounded);
        bridge.history = bounded.then(|| Box::new(History::new(system, sharing())));
        let consistent = match system.is_explicit() {
            true => Some(Consistent::new(system, operations, context)?),
            false => None,
        };
        let mut ida = Self {
            memory: Memory::new(bridge, &y, &yp, context)?,
            y,
            yp,
            quadratures: Integrals::new(system, &settings.quadratures, operations, context),
            consistent,
            following: None,
            forcing: Forcing::new(system.forcing_count()),
            operations,
            settings,
            shape: Shape::new(system),
            events: vec![0; system.root_count()].into(),
            reports_jumps: system.reports_jumps(),
            later,
            time: 0.0,
            phase: Phase::Idle,
            past: Past::none(),
            has_past: system.has_past(),
            longest_step: f64::INFINITY,
            course_step: f64::INFINITY,
        };
        ida.configure(system)?;
        Ok(ida)
    }

    /// Passes to IDA everything that does not change.
    fn configure(&mut self, system: &dyn System) -> Result<(), SolveError> {
        let settings = &self.settings;
        self.memory.set_limits(settings.max_order, settings.max_steps)?;
        if settings.max_step.is_finite() {
            self.memory.set_longest_step(settings.max_step)?;
        }
        if settings.min_step > 0.0 {
            self.memory.set_shortest_step(settings.min_step)?;
        }
        self.configure_identity(system)?;
        self.configure_quadratures()
    }

    /// Implicit systems, and those whose algebraic unknowns are left out of the error test: which
    /// unknowns are differential.
    fn configure_identity(&mut self, system: &dyn System) -> Result<(), SolveError> {
        let masks = !self.settings.tests_algebraic() && self.shape.differential.contains(&false);
        if !masks && system.is_explicit() {
            return Ok(());
        }
        let mut identity = self.unknowns();
        for (entry, &differential) in identity.entries_mut().iter_mut().zip(&self.shape.differential) {
            *entry = f64::from(u8::from(differential));
        }
        self.memory.set_identity(&identity, !self.settings.tests_algebraic())
    }

    fn configure_quadratures(&mut self) -> Result<(), SolveError> {
        let Some(quadratures) = self.quadratures.as_ref().filter(|q| q.by_steps.is_none()) else {
            return Ok(());
        };
        self.memory.set_integrals(&quadratures.values)?;
        if let Some(rtol) = quadratures.checked() {
            self.memory.set_integral_tolerances(rtol, &quadratures.tolerances)?;
            self.memory.test_integrals()?;
        }
        Ok(())
    }
}

impl Shape {
    fn new(system: &dyn System) -> Self {
        let pattern: &Pattern = system.pattern();
        let columns = (0..pattern.dimension()).flat_map(|column| pattern.column(column).map(move |_| column)).collect();
        Self { differential: system.differential().into(), rows: pattern.rows().into(), columns, bounds: system.bounds().cloned() }
    }
}

/// Data of IDA's callbacks.
fn bridge(system: &dyn System, settings: &Settings, operations: Operations, context: &Context) -> Result<Bridge, SolveError> {
    let n = system.dimension();
    let factorisation = Factorisation::new(system.pattern(), settings.linear_solver)?;
    let untested = system.differential().contains(&false) && !settings.tests_algebraic();
    let newton = Newton::new(n, operations, context);
    let newton = if untested { newton.with_untested_unknowns() } else { newton };
    let watch = Watch::new(system.root_count(), system.root_kinds());
    let tolerances = Tolerances::new(settings.rtol, &settings.atol);
    let nonnegative = Nonnegative::new(system, settings);
    Ok(Bridge::new(operations, tolerances, system.pattern().entries(), factorisation, newton, nonnegative, watch))
}

/// The pattern has the system's dimension, and a diagonal where derivatives are explicit.
fn check_shape(system: &dyn System) -> Result<(), SolveError> {
    let pattern = system.pattern();
    let n = pattern.dimension();
    if n != system.dimension() {
        return Err(SolveError::Length { name: "pattern", given: n, expected: system.dimension() });
    }
    let lacks_diagonal = |&i: &usize| system.differential()[i] && !pattern.rows()[pattern.column(i)].contains(&i);
    match (0..n).find(lacks_diagonal) {
        Some(row) if system.is_explicit() => Err(SolveError::Diagonal { row }),
        _ => Ok(()),
    }
}
