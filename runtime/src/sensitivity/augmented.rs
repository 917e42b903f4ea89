//! The equations of a model with those of its derivatives along directions.
//!
//! With F(t, y, y', w) = 0 the derivatives S of y along directions in which inputs w move by W obey F_y S + F_y' S' + F_w W = 0. F_y and F_y' are the
//! compiled Jacobian, F_w W compiled derivatives by the inputs that move.

use std::sync::Arc;

use smpl_compiler::compiled::tangent::{ByInputs, Part};
use smpl_compiler::layout::Memory;

use super::tangents::{Point, Tangents};
use crate::solver::{Pattern, PatternError, RootKind, System};
use crate::system::CompiledSystem;

/// A model and its derivatives: n unknowns, then n rows of as many derivatives as there are directions.
pub struct Augmented {
    /// The model with its present inputs.
    pub system: CompiledSystem,
    width: usize,
    differential: Vec<bool>,
    pattern: Pattern,
    /// F_y, and F_y' where it is not the identity on the rows of states.
    jacobian: Vec<f64>,
    mass: Vec<f64>,
    inputs: Option<Inputs>,
    kinds: Vec<RootKind>,
    switches: Option<Memory>,
    /// Derivatives at a point, for integrands.
    tangents: Tangents,
    /// What cannot be integrated, in words.
    pub fault: Option<String>,
}

/// What inputs that move add to the equations.
struct Inputs {
    compiled: Arc<ByInputs>,
    memory: Memory,
    values: Vec<f64>,
    /// Row, value, direction and derivative of the input.
    terms: Vec<(u32, u32, u32, f64)>,
}

impl Augmented {
    /// Of a model, along so many directions.
    ///
    /// # Errors
    /// A pattern that is none.
    pub fn new(system: &CompiledSystem, width: usize) -> Result<Self, PatternError> {
        let inner = system.pattern();
        let entries = inner.entries();
        let switches = system.model().switches().ok();
        let strict = switches.map_or(&[][..], |switches| &switches.strict);
        let kinds = system.root_kinds().iter().copied().chain(strict.iter().map(|&strict| RootKind { strict, both: true }));
        let rows_of_directions = system.differential().iter().flat_map(|&d| std::iter::repeat_n(d, width));
        Ok(Self {
            width,
            differential: system.differential().iter().copied().chain(rows_of_directions).collect(),
            pattern: repeated(inner, width)?,
            jacobian: vec![0.0; entries],
            mass: if system.is_explicit() { Vec::new() } else { vec![0.0; entries] },
            inputs: None,
            kinds: kinds.collect(),
            switches: switches.and_then(|switches| switches.memory()),
            tangents: Tangents::new(system, width),
            system: system.clone(),
            fault: None,
        })
    }

    /// Number of root functions that are switches of the equations, after those of the model.
    pub fn switches(&self) -> usize {
        self.kinds.len() - self.system.root_count()
    }

    /// Takes the inputs of an instance and their derivatives.
    ///
    /// # Errors
    /// In words, if the equations cannot be differentiated by them.
    pub fn set_inputs(&mut self, system: &CompiledSystem, tangents: &Tangents) -> Result<(), String> {
        self.system.restore(system.memory().all());
        let model = Arc::clone(system.model());
        if let (Ok(switches), Some(memory)) = (model.switches(), &mut self.switches) {
            switches.take(memory, system.memory());
        }
        self.tangents.copy_work(tangents);
        let moving = model.inputs(|cells| tangents.is_active(cells));
        if moving.is_empty() {
            self.inputs = None;
            return Ok(());
        }
        let compiled = model.by_inputs(&moving).map_err(|e| e.to_string())?;
        let mut memory = compiled.memory();
        compiled.take(&mut memory, system.memory());
        let mut terms = Vec::new();
        for (value, &(row, cell)) in compiled.places().iter().enumerate() {
            for direction in 0..self.width {
                let factor = tangents.work(cell as usize, direction);
                if factor != 0.0 {
                    terms.push((row, value as u32, direction as u32, factor));
                }
            }
        }
        self.inputs = Some(Inputs { values: vec![0.0; compiled.places().len()], compiled, memory, terms });
        Ok(())
    }

    fn derivatives(&mut self, t: f64, (y, yp): (&[f64], &[f64]), (s, sp): (&[f64], &[f64]), out: &mut [f64]) {
        let width = self.width;
        self.system.jacobian(t, y, yp, 0.0, &mut self.jacobian);
        out.fill(0.0);
        multiply(self.system.pattern(), &self.jacobian, width, s, out);
        if self.mass.is_empty() {
            let rows = out.chunks_exact_mut(width).zip(sp.chunks_exact(width)).zip(self.system.differential());
            for ((out, sp), _) in rows.filter(|(_, differential)| **differential) {
                out.iter_mut().zip(sp).for_each(|(out, sp)| *out -= sp);
            }
        } else {
            // The Jacobian is affine in the weight of the derivatives.
            self.system.jacobian(t, y, yp, 1.0, &mut self.mass);
            self.mass.iter_mut().zip(&self.jacobian).for_each(|(mass, jacobian)| *mass -= jacobian);
            multiply(self.system.pattern(), &self.mass, width, sp, out);
        }
        if let Some(Inputs { compiled, memory, values, terms }) = &mut self.inputs {
            compiled.evaluate(self.system.model(), memory, t, (y, yp), values);
            for &(row, value, direction, factor) in &*terms {
                out[row as usize * width + direction as usize] += factor * values[value as usize];
            }
        }
    }
}

/// `out += A X` for a sparse matrix and a matrix of `width` columns, row after row.
fn multiply(pattern: &Pattern, values: &[f64], width: usize, x: &[f64], out: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        unsafe fn wide(pattern: &Pattern, values: &[f64], width: usize, x: &[f64], out: &mut [f64]) {
            multiply_portable(pattern, values, width, x, out);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has the feature.
            return unsafe { wide(pattern, values, width, x, out) };
        }
    }
    multiply_portable(pattern, values, width, x, out);
}

#[inline(always)]
fn multiply_portable(pattern: &Pattern, values: &[f64], width: usize, x: &[f64], out: &mut [f64]) {
    for (column, x) in x.chunks_exact(width).enumerate() {
        for entry in pattern.column(column) {
            let (row, value) = (pattern.rows()[entry], values[entry]);
            if value != 0.0 {
                let out = &mut out[row * width..(row + 1) * width];
                out.iter_mut().zip(x).for_each(|(out, x)| *out += value * x);
            }
        }
    }
}

/// The pattern of the whole, of which only the diagonal blocks are told.
fn repeated(inner: &Pattern, width: usize) -> Result<Pattern, PatternError> {
    let n = inner.dimension();
    let mut starts = inner.column_starts().to_vec();
    let mut rows = inner.rows().to_vec();
    for column in 0..n {
        for j in 0..width {
            rows.extend(inner.rows()[inner.column(column)].iter().map(|row| n + row * width + j));
            starts.push(rows.len());
        }
    }
    Pattern::new(starts, rows)
}

impl System for Augmented {
    fn differential(&self) -> &[bool] {
        &self.differential
    }

    fn is_explicit(&self) -> bool {
        self.system.is_explicit()
    }

    fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    fn directions(&self) -> usize {
        self.width
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let n = self.system.dimension();
        let ((y, s), (yp, sp), (out, derivatives)) = (y.split_at(n), yp.split_at(n), out.split_at_mut(n));
        self.system.residual(t, y, yp, out);
        self.derivatives(t, (y, yp), (s, sp), derivatives);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        let n = self.system.dimension();
        let (first, mut rest) = values.split_at_mut(self.jacobian.len());
        self.system.jacobian(t, &y[..n], &yp[..n], cj, first);
        for column in 0..n {
            let from = &first[self.system.pattern().column(column)];
            let (these, others) = rest.split_at_mut(from.len() * self.width);
            if !from.is_empty() {
                these.chunks_exact_mut(from.len()).for_each(|to| to.copy_from_slice(from));
            }
            rest = others;
        }
    }

    /// Breaks are crossed from outside: their times may move.
    fn next_break(&mut self, _t: f64) -> f64 {
        f64::INFINITY
    }

    fn depends_on_time(&self) -> bool {
        self.system.depends_on_time()
    }

    fn forcing_count(&self) -> usize {
        self.system.forcing_count()
    }

    fn forcings(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let n = self.system.dimension();
        self.system.forcings(t, &y[..n], &yp[..n], out);
    }

    fn root_count(&self) -> usize {
        self.kinds.len()
    }

    fn root_kinds(&self) -> &[RootKind] {
        &self.kinds
    }

    fn roots_use_derivatives(&self) -> bool {
        self.system.roots_use_derivatives()
    }

    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let n = self.system.dimension();
        let (own, switches) = out.split_at_mut(self.system.root_count());
        let (y, yp) = (&y[..n], &yp[..yp.len().min(n)]);
        if !own.is_empty() {
            self.system.roots(t, y, yp, own);
        }
        if let (Ok(compiled), Some(memory)) = (self.system.model().switches(), &mut self.switches) {
            compiled.evaluate(self.system.model(), memory, t, (y, yp), switches);
        }
    }

    fn quadrature_count(&self) -> usize {
        self.system.quadrature_count() * (1 + self.width)
    }

    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let (n, count, width) = (self.system.dimension(), self.system.quadrature_count(), self.width);
        let ((y, s), (yp, sp), (own, derivatives)) = (y.split_at(n), yp.split_at(n), out.split_at_mut(count));
        self.system.quadratures(t, y, yp, own);
        self.tangents.take_y(s);
        self.tangents.take_yp(sp);
        let point = Point { time: t, moving: &[], y, yp };
        if let Err(fault) = self.tangents.run(&self.system, Part::Quadratures, point, count) {
            self.fault = Some(fault);
        }
        for (at, row) in derivatives.chunks_exact_mut(width).enumerate() {
            row.iter_mut().enumerate().for_each(|(direction, out)| *out = self.tangents.output(at, direction));
        }
    }
}
