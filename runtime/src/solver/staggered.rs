//! IDA for the unknowns, and derivatives along directions that follow them in their own steps.

use super::{Advance, Edge, Following, Ida, Integrator, Nodes, Pattern, RootKind, Settings, SolveError, Statistics, System, Within};

/// An integrator for systems with directions.
pub(crate) struct Staggered {
    ida: Ida,
    /// Number of leading unknowns, of integrals of theirs.
    n: usize,
    integrals: usize,
    /// Unknowns with derivatives, their rates, integrals: as they are where an advance ended.
    y: Vec<f64>,
    yp: Vec<f64>,
    quadratures: Vec<f64>,
}

/// A system with directions, as if it had none.
struct Leading<'a> {
    whole: &'a mut dyn System,
    n: usize,
}

impl Staggered {
    /// An integrator for systems of this one's dimension, pattern, directions and counts.
    ///
    /// # Errors
    /// As for [`Ida::new`].
    pub(crate) fn new(system: &mut dyn System, settings: Settings) -> Result<Self, SolveError> {
        settings.validate(system.dimension())?;
        let (length, width, quadratures) = (system.dimension(), system.directions(), system.quadrature_count());
        let n = length / (1 + width);
        let of_unknowns = Settings { atol: settings.atol[..n].to_vec(), ..settings.clone() };
        let mut ida = Ida::new(&Leading { whole: &mut *system, n }, of_unknowns)?;
        ida.add_following(system, &settings)?;
        let numbers = |length| vec![0.0; length];
        Ok(Self {
            ida,
            n,
            integrals: quadratures / (1 + width),
            y: numbers(length),
            yp: numbers(length),
            quadratures: numbers(quadratures),
        })
    }

    /// Takes unknowns, derivatives and integrals as they are now.
    fn take(&mut self) {
        let Self { ida, n, integrals, y, yp, quadratures } = self;
        y[..*n].copy_from_slice(ida.state());
        yp[..*n].copy_from_slice(ida.derivative());
        quadratures[..*integrals].copy_from_slice(ida.quadratures());
        if let Some(following) = ida.following() {
            y[*n..].copy_from_slice(following.derivatives());
            yp[*n..].copy_from_slice(following.rates());
            quadratures[*integrals..].copy_from_slice(following.integrals());
        }
    }
}

impl Integrator for Staggered {
    fn restart(&mut self, system: &mut dyn System, t0: f64, y: &[f64], yp: Option<&[f64]>) -> Result<(), SolveError> {
        let length = self.y.len();
        let lengths = [("system", system.dimension()), ("y", y.len()), ("yp", yp.map_or(length, <[f64]>::len))];
        if let Some((name, given)) = lengths.into_iter().find(|&(_, given)| given != length) {
            return Err(SolveError::Length { name, given, expected: length });
        }
        let n = self.n;
        let mut leading = Leading { whole: system, n };
        self.ida.restart(&mut leading, t0, &y[..n], yp.map(|yp| &yp[..n]))?;
        self.ida.begin_following(&mut leading, &y[n..])?;
        self.take();
        Ok(())
    }

    fn advance(&mut self, system: &mut dyn System, t_end: f64) -> Result<Advance, SolveError> {
        if system.dimension() != self.y.len() {
            return Err(SolveError::Length { name: "system", given: system.dimension(), expected: self.y.len() });
        }
        let advance = self.ida.advance(&mut Leading { whole: system, n: self.n }, t_end);
        self.take();
        advance
    }

    fn forget(&mut self) {
        self.ida.forget();
    }

    fn time(&self) -> f64 {
        self.ida.time()
    }

    fn state(&self) -> &[f64] {
        &self.y
    }

    fn derivative(&self) -> &[f64] {
        &self.yp
    }

    fn quadratures(&self) -> &[f64] {
        &self.quadratures
    }

    fn events(&self) -> &[i32] {
        self.ida.events()
    }

    fn edges(&self) -> &[Edge] {
        self.ida.edges()
    }

    fn edges_mut(&mut self) -> &mut [Edge] {
        self.ida.edges_mut()
    }

    fn undefined_event(&self) -> Option<usize> {
        self.ida.undefined_event()
    }

    fn statistics(&self) -> Statistics {
        self.ida.statistics()
    }
}

impl System for Leading<'_> {
    fn differential(&self) -> &[bool] {
        &self.whole.differential()[..self.n]
    }

    fn is_explicit(&self) -> bool {
        self.whole.is_explicit()
    }

    fn nonnegative(&self) -> &[u32] {
        self.whole.nonnegative()
    }

    fn pattern(&self) -> &Pattern {
        self.whole.pattern()
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.whole.leading(t, y, yp, out);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        self.whole.jacobian(t, y, yp, cj, values);
    }

    fn following(&mut self, at: Following<'_>, s: (&[f64], &[f64]), out: &mut [f64]) {
        self.whole.following(at, s, out);
    }

    fn moving(&mut self, at: Following<'_>, rates: &mut [f64]) {
        self.whole.moving(at, rates);
    }

    fn next_break(&mut self, t: f64) -> f64 {
        self.whole.next_break(t)
    }

    fn has_past(&self) -> bool {
        self.whole.has_past()
    }

    fn longest_step(&self) -> f64 {
        self.whole.longest_step()
    }

    fn crosses(&mut self, at: f64) {
        self.whole.crosses(at);
    }

    fn begin(&mut self, t: f64, y: &[f64]) {
        self.whole.begin(t, y);
    }

    fn begun(&mut self, t: f64, y: &[f64], yp: &[f64], rtol: f64) {
        self.whole.begun(t, y, yp, rtol);
    }

    fn record(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        self.whole.record_leading(span, rtol, within);
    }

    fn record_following(&mut self, nodes: &Nodes) {
        self.whole.record_following(nodes);
    }

    fn depends_on_time(&self) -> bool {
        self.whole.depends_on_time()
    }

    fn forcing_count(&self) -> usize {
        self.whole.forcing_count()
    }

    fn forcings(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.whole.forcings(t, y, yp, out);
    }

    fn root_count(&self) -> usize {
        self.whole.root_count()
    }

    fn roots_use_derivatives(&self) -> bool {
        self.whole.roots_use_derivatives()
    }

    fn root_kinds(&self) -> &[RootKind] {
        self.whole.root_kinds()
    }

    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.whole.roots(t, y, yp, out);
    }

    fn watched_unknowns(&self) -> &[u32] {
        self.whole.watched_unknowns()
    }

    fn watched_input_count(&self) -> Option<usize> {
        self.whole.watched_input_count()
    }

    fn watched_inputs(&self, out: &mut [f64]) {
        self.whole.watched_inputs(out);
    }

    fn root_bounds(&mut self, span: (f64, f64), least: &[f64], most: &[f64], out: &mut [f64]) -> bool {
        self.whole.root_bounds(span, least, most, out)
    }

    fn reports_jumps(&self) -> bool {
        self.whole.reports_jumps()
    }

    fn quadrature_count(&self) -> usize {
        self.whole.quadrature_count() / (1 + self.whole.directions())
    }

    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.whole.leading_integrands(t, y, yp, out);
    }

    fn integrands_read_rates(&self) -> bool {
        self.whole.integrands_read_rates()
    }

    fn following_integrands(&mut self, t: f64, y: (&[f64], &[f64]), s: (&[f64], &[f64]), out: &mut [f64]) {
        self.whole.following_integrands(t, y, s, out);
    }
}
