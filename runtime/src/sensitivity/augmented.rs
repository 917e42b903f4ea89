//! The equations of a model with those of its derivatives along directions.
//!
//! With F(t, y, y', w) = 0 the derivatives S of y along directions in which inputs w move by W obey
//! F_y S + F_y' S' + F_w W = 0. F_y and F_y' are the compiled Jacobian, F_w W compiled derivatives
//! by the inputs that move.

use std::sync::Arc;

use smpl_compiler::compiled::tangent::{ByInputs, Integrands, Source};
use smpl_compiler::ir::{DELAY_SLOTS, DelaySlot, Flavour, VarId};
use smpl_compiler::layout::{Memory, Region};

use super::tangents::Tangents;
use crate::past::moved::MovedPast;
use crate::solver::linear::columns::{Columns, each_piece, with_fma};
use crate::solver::nonnegative::seen;
use crate::solver::{Following, Nodes, Pattern, RootKind, System, Within};
use crate::system::CompiledSystem;

/// An input, or a copy of it at another instant.
pub(crate) type Input = (VarId, Flavour);

/// A model and its derivatives: n unknowns, then n rows of as many derivatives as there are
/// directions.
pub(crate) struct Augmented {
    /// The model with its present inputs.
    pub system: CompiledSystem,
    width: usize,
    differential: Vec<bool>,
    rows: Rows,
    /// F_y + c F_y'; and, where F_y' is not minus the identity on the rows of states, F_y and F_y'.
    jacobian: Vec<f64>,
    without: Vec<f64>,
    mass: Vec<f64>,
    /// F_y S, there, or rates.
    part: Vec<f64>,
    inputs: Option<Inputs>,
    integrals: Option<Integrals>,
    /// Unknowns with nonnegative states at zero or above.
    seen: Vec<f64>,
    /// Derivatives of the past, if there is one, and the directions that are integrated.
    pub past: Option<Box<MovedPast>>,
    live: Vec<usize>,
    nodes: Nodes,
    /// Unknowns with derivatives within a step, and their rates.
    inside: [Vec<f64>; 2],
}

/// Contributions of moving inputs to the equations.
struct Inputs {
    compiled: Arc<ByInputs>,
    memory: Memory,
    values: Vec<f64>,
    terms: Terms,
}

impl Inputs {
    fn new(compiled: Arc<ByInputs>) -> Self {
        Self { memory: compiled.memory(), values: vec![0.0; compiled.places().len()], compiled, terms: Terms::default() }
    }

    /// Takes the inputs of an instance and their derivatives.
    fn take(&mut self, system: &CompiledSystem, moved: Moved<'_>) {
        self.compiled.take(&mut self.memory, system.memory());
        self.terms.clear();
        for (value, &(row, cell)) in self.compiled.places().iter().enumerate() {
            self.terms.add(system, (row, value, cell), moved);
        }
    }
}

/// Derivatives of inputs, the directions that are integrated, and the past.
#[derive(Clone, Copy)]
struct Moved<'a> {
    tangents: &'a Tangents,
    live: &'a [usize],
    past: Option<&'a MovedPast>,
}

/// Terms that inputs give along the directions that are integrated.
#[derive(Default)]
struct Terms {
    /// Row, value, direction and derivative of the input.
    fixed: Vec<(u32, u32, u32, f64)>,
    /// Row, value, direction and place among the derivatives of delayed values, which change with
    /// time.
    delayed: Vec<(u32, u32, u32, u32)>,
}

impl Terms {
    fn clear(&mut self) {
        self.fixed.clear();
        self.delayed.clear();
    }

    /// Adds those of an input.
    fn add(&mut self, system: &CompiledSystem, (row, value, cell): (u32, usize, u32), Moved { tangents, live, past }: Moved<'_>) {
        let delayed = system.memory().layout().range(Region::Delayed);
        if let Some(past) = past.filter(|_| delayed.contains(&(cell as usize))) {
            let (element, slot) = ((cell - delayed.start as u32) / DELAY_SLOTS, (cell - delayed.start as u32) % DELAY_SLOTS);
            if slot != DelaySlot::Value as u32 {
                return;
            }
            let awake = live.iter().enumerate().filter(|(_, of_all)| past.is_awake(**of_all));
            let place = |of_all: usize| element * tangents.width() as u32 + of_all as u32;
            self.delayed.extend(awake.map(|(direction, &of_all)| (row, value as u32, direction as u32, place(of_all))));
            return;
        }
        for (direction, &of_all) in live.iter().enumerate() {
            let factor = tangents.work(cell as usize, of_all);
            if factor != 0.0 {
                self.fixed.push((row, value as u32, direction as u32, factor));
            }
        }
    }

    /// Adds `sign` times the terms to rows of `width` directions.
    fn write(&self, values: &[f64], past: Option<&MovedPast>, sign: f64, width: usize, out: &mut [f64]) {
        for &(row, value, direction, factor) in &self.fixed {
            out[row as usize * width + direction as usize] += sign * factor * values[value as usize];
        }
        let Some(past) = past else { return };
        for &(row, value, direction, place) in &self.delayed {
            out[row as usize * width + direction as usize] += sign * past.values[place as usize] * values[value as usize];
        }
    }
}

/// Derivatives of the integrands.
struct Integrals {
    compiled: Arc<Integrands>,
    memory: Memory,
    values: Vec<f64>,
    /// Integrand, value and unknown; the same for rates of unknowns.
    unknowns: Vec<(u32, u32, u32)>,
    rates: Vec<(u32, u32, u32)>,
    terms: Terms,
}

impl Integrals {
    fn new(compiled: Arc<Integrands>) -> Self {
        let values = vec![0.0; compiled.places().len()];
        Self { memory: compiled.memory(), compiled, values, unknowns: Vec::new(), rates: Vec::new(), terms: Terms::default() }
    }

    /// Takes the inputs of an instance and their derivatives.
    fn take(&mut self, system: &CompiledSystem, moved: Moved<'_>) {
        let Self { compiled, memory, unknowns, rates, terms, .. } = self;
        compiled.take(memory, system.memory());
        unknowns.clear();
        rates.clear();
        terms.clear();
        for (value, &(row, source)) in compiled.places().iter().enumerate() {
            match source {
                Source::Unknown(at) => unknowns.push((row, value as u32, at)),
                Source::Rate(at) => rates.push((row, value as u32, at)),
                Source::Input(cell) => terms.add(system, (row, value, cell), moved),
            }
        }
    }

    /// Derivatives of the integrands, row after row.
    fn write(
        &mut self,
        system: &CompiledSystem,
        t: f64,
        (y, yp): (&[f64], &[f64]),
        (s, sp): (&[f64], &[f64]),
        (past, width): (Option<&MovedPast>, usize),
        out: &mut [f64],
    ) {
        out.fill(0.0);
        if past.is_some() {
            self.memory.region_mut(Region::Delayed).copy_from_slice(system.region(Region::Delayed));
        }
        self.compiled.evaluate(system.model(), &mut self.memory, t, (y, yp), &mut self.values);
        for (terms, from) in [(&self.unknowns, s), (&self.rates, sp)] {
            for &(row, value, at) in terms {
                let (out, from) = (&mut out[row as usize * width..][..width], &from[at as usize * width..][..width]);
                let value = self.values[value as usize];
                out.iter_mut().zip(from).for_each(|(out, x)| *out += value * x);
            }
        }
        self.terms.write(&self.values, past, 1.0, width, out);
    }
}

impl Augmented {
    /// Of a model, along so many directions.
    pub(crate) fn new(system: &CompiledSystem, width: usize) -> Self {
        let inner = system.pattern();
        let entries = inner.entries();
        let rows_of_directions = system.differential().iter().flat_map(|&d| std::iter::repeat_n(d, width));
        Self {
            width,
            differential: system.differential().iter().copied().chain(rows_of_directions).collect(),
            rows: Rows::new(inner),
            jacobian: vec![0.0; entries],
            without: if system.is_explicit() { Vec::new() } else { vec![0.0; entries] },
            mass: if system.is_explicit() { Vec::new() } else { vec![0.0; entries] },
            part: if system.is_explicit() { Vec::new() } else { vec![0.0; system.dimension() * width] },
            inputs: None,
            integrals: None,
            seen: if system.nonnegative().is_empty() { Vec::new() } else { vec![0.0; system.dimension()] },
            system: system.clone(),
            past: None,
            live: Vec::new(),
            nodes: Nodes::default(),
            inside: [Vec::new(), Vec::new()],
        }
    }

    /// Takes the inputs of an instance, of which some move, and their derivatives along those
    /// directions that are integrated.
    ///
    /// # Errors
    /// In words, if the equations cannot be differentiated by them.
    pub(crate) fn set_inputs(
        &mut self,
        system: &CompiledSystem,
        tangents: &Tangents,
        moving: &[Input],
        live: &[usize],
    ) -> Result<(), String> {
        self.system.restore(system.memory().all());
        self.live.clear();
        self.live.extend_from_slice(live);
        self.past.iter_mut().for_each(|past| past.take(tangents));
        let moved = Moved { tangents, live, past: self.past.as_deref() };
        let model = Arc::clone(system.model());
        if system.quadrature_count() > 0 {
            let compiled = model.integrands(moving).map_err(|e| e.to_string())?;
            let known = self.integrals.take().filter(|integrals| Arc::ptr_eq(&integrals.compiled, &compiled));
            self.integrals.insert(known.unwrap_or_else(|| Integrals::new(compiled))).take(system, moved);
        }
        if moving.is_empty() {
            self.inputs = None;
            return Ok(());
        }
        let compiled = model.by_inputs(moving).map_err(|e| e.to_string())?;
        let known = self.inputs.take().filter(|inputs| Arc::ptr_eq(&inputs.compiled, &compiled));
        self.inputs.insert(known.unwrap_or_else(|| Inputs::new(compiled))).take(system, moved);
        Ok(())
    }

    /// Writes whether the equations move each direction's derivatives, or an integral with them.
    /// Where they do not, derivatives of unknowns stay as they are.
    ///
    /// # Errors
    /// In words, if the equations cannot be differentiated.
    pub(crate) fn find_moved(system: &CompiledSystem, tangents: &Tangents, inputs: &[Input], moved: &mut Vec<bool>) -> Result<(), String> {
        let model = system.model();
        moved.clear();
        moved.resize(tangents.width(), false);
        let mut add = |moves: &dyn Fn(usize) -> bool| moved.iter_mut().enumerate().for_each(|(j, moved)| *moved |= moves(j));
        let by_unknown = |at: usize, j: usize| tangents.y(at, j) != 0.0;
        let by_input = |cell: u32, j: usize| tangents.work(cell as usize, j) != 0.0;
        if system.is_explicit() {
            let read = model.read_unknowns().map_err(ToString::to_string)?;
            add(&|j| read.iter().enumerate().any(|(at, &read)| read && by_unknown(at, j)));
        } else {
            add(&|j| (0..system.dimension()).any(|at| by_unknown(at, j)));
        }
        if !inputs.is_empty() {
            let compiled = model.by_inputs(inputs).map_err(|e| e.to_string())?;
            add(&|j| compiled.sources().iter().any(|&cell| by_input(cell, j)));
        }
        if system.quadrature_count() > 0 {
            let compiled = model.integrands(inputs).map_err(|e| e.to_string())?;
            let by = |source: &Source, j: usize| match *source {
                Source::Unknown(at) | Source::Rate(at) => by_unknown(at as usize, j),
                Source::Input(cell) => by_input(cell, j),
            };
            add(&|j| compiled.sources().iter().any(|source| by(source, j)));
        }
        Ok(())
    }

    /// Finds F_y and F_y'.
    fn find_mass(&mut self, t: f64, (y, yp): (&[f64], &[f64])) {
        // The Jacobian is affine in the weight of the derivatives by rates.
        let (without, mass) = (&mut self.without, &mut self.mass);
        self.system.jacobian(t, y, yp, 0.0, without);
        self.system.jacobian(t, y, yp, 1.0, mass);
        mass.iter_mut().zip(&*without).for_each(|(mass, without)| *mass -= without);
    }

    /// Adds `sign` times what inputs that move give.
    fn add_inputs(&mut self, t: f64, (y, yp): (&[f64], &[f64]), sign: f64, out: &mut [f64]) {
        self.look_back(t, (y, yp));
        let y = seen(self.system.nonnegative(), y, &mut self.seen);
        let Some(Inputs { compiled, memory, values, terms }) = &mut self.inputs else { return };
        if self.past.is_some() {
            memory.region_mut(Region::Delayed).copy_from_slice(self.system.region(Region::Delayed));
        }
        compiled.evaluate(self.system.model(), memory, t, (y, yp), values);
        terms.write(values, self.past.as_deref(), sign, self.width, out);
    }

    /// Fills the delayed values and their derivatives at a point.
    pub(crate) fn look_back(&mut self, t: f64, (y, yp): (&[f64], &[f64])) {
        let Some(moved) = &mut self.past else { return };
        self.system.look_back(t, y, yp);
        if let Some(past) = self.system.past_mut() {
            moved.look_up(past, t);
        }
    }
}

/// A pattern by rows: the end of each, and column and place of each entry.
struct Rows {
    ends: Vec<u32>,
    entries: Vec<(u32, u32)>,
}

impl Rows {
    fn new(pattern: &Pattern) -> Self {
        let n = pattern.dimension();
        let mut rows = vec![Vec::new(); n];
        for column in 0..n {
            pattern.column(column).for_each(|place| rows[pattern.rows()[place]].push((column as u32, place as u32)));
        }
        let ends = rows.iter().scan(0, |end, row| {
            *end += row.len() as u32;
            Some(*end)
        });
        Self { ends: ends.collect(), entries: rows.concat() }
    }
}

/// Initial value of a product of a matrix by rows with a matrix of `width` columns.
#[derive(Clone, Copy)]
enum Beginning<'a> {
    Zero,
    /// Another matrix.
    Given(&'a [f64]),
    /// On differential rows `cj` x minus this; zero on others.
    Rates {
        differential: &'a [bool],
        cj: f64,
        rates: &'a [f64],
    },
}

with_fma! {
    /// `out = beginning + A X` for a sparse matrix and a matrix of `width` columns.
    fn multiply(rows: &Rows, values: &[f64], width: usize, x: &[f64], beginning: Beginning<'_>, out: &mut [f64]) = multiply_portable
}

#[inline(always)]
fn multiply_portable(rows: &Rows, values: &[f64], width: usize, x: &[f64], beginning: Beginning<'_>, out: &mut [f64]) {
    if width == 0 {
        return;
    }
    let mut first = 0;
    for ((row, &end), out) in rows.ends.iter().enumerate().zip(out.chunks_exact_mut(width)) {
        let entries = &rows.entries[first as usize..end as usize];
        first = end;
        let from = row * width..(row + 1) * width;
        let beginning = match beginning {
            Beginning::Given(other) => RowBeginning::Given(&other[from]),
            Beginning::Rates { differential, cj, rates } if differential[row] => RowBeginning::Rates(cj, &x[from.clone()], &rates[from]),
            Beginning::Zero | Beginning::Rates { .. } => RowBeginning::Zero,
        };
        each_piece(width, &mut Product { entries, values, width, x, beginning, out });
    }
}

#[derive(Clone, Copy)]
enum RowBeginning<'a> {
    Zero,
    Given(&'a [f64]),
    Rates(f64, &'a [f64], &'a [f64]),
}

/// A row of the product.
struct Product<'a> {
    entries: &'a [(u32, u32)],
    values: &'a [f64],
    width: usize,
    x: &'a [f64],
    beginning: RowBeginning<'a>,
    out: &'a mut [f64],
}

impl Columns for Product<'_> {
    #[inline(always)]
    fn piece<const B: usize>(&mut self, first: usize) {
        let mut sum = [0.0; B];
        match self.beginning {
            RowBeginning::Zero => {}
            RowBeginning::Given(other) => sum.copy_from_slice(&other[first..first + B]),
            RowBeginning::Rates(cj, own, rates) => {
                let both = own[first..first + B].iter().zip(&rates[first..first + B]);
                sum.iter_mut().zip(both).for_each(|(sum, (own, rate))| *sum = cj * own - rate);
            }
        }
        for &(column, place) in self.entries {
            let (value, from) = (self.values[place as usize], column as usize * self.width + first);
            sum.iter_mut().zip(&self.x[from..from + B]).for_each(|(sum, x)| *sum = value.mul_add(*x, *sum));
        }
        self.out[first..first + B].copy_from_slice(&sum);
    }
}

impl System for Augmented {
    fn differential(&self) -> &[bool] {
        &self.differential
    }

    fn is_explicit(&self) -> bool {
        self.system.is_explicit()
    }

    fn nonnegative(&self) -> &[u32] {
        self.system.nonnegative()
    }

    fn pattern(&self) -> &Pattern {
        self.system.pattern()
    }

    fn directions(&self) -> usize {
        self.width
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let n = self.system.dimension();
        let ((y, s), (yp, sp), (out, derivatives)) = (y.split_at(n), yp.split_at(n), out.split_at_mut(n));
        self.system.residual(t, y, yp, out);
        let mut jacobian = std::mem::take(&mut self.jacobian);
        if self.mass.is_empty() {
            self.system.jacobian(t, y, yp, 0.0, &mut jacobian);
        }
        self.following(Following { t, y, yp, cj: 0.0, jacobian: &jacobian }, (s, sp), derivatives);
        self.jacobian = jacobian;
    }

    fn leading(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.system.residual(t, y, yp, out);
    }

    fn following(&mut self, at: Following<'_>, (s, sp): (&[f64], &[f64]), out: &mut [f64]) {
        let (Following { t, y, yp, cj, jacobian }, width) = (at, self.width);
        if self.mass.is_empty() {
            let beginning = Beginning::Rates { differential: self.system.differential(), cj, rates: sp };
            multiply(&self.rows, jacobian, width, s, beginning, out);
        } else {
            self.find_mass(t, (y, yp));
            multiply(&self.rows, &self.without, width, s, Beginning::Zero, &mut self.part);
            multiply(&self.rows, &self.mass, width, sp, Beginning::Given(&self.part), out);
        }
        self.add_inputs(t, (y, yp), 1.0, out);
    }

    fn moving(&mut self, Following { t, y, yp, .. }: Following<'_>, rates: &mut [f64]) {
        let width = self.width;
        if self.mass.is_empty() {
            // ∂F/∂y' is minus the identity on the rows of states.
            let rows = rates.chunks_exact_mut(width).zip(self.system.differential());
            rows.filter(|(_, differential)| !**differential).for_each(|(row, _)| row.fill(0.0));
        } else {
            self.find_mass(t, (y, yp));
            multiply(&self.rows, &self.mass, width, rates, Beginning::Zero, &mut self.part);
            rates.iter_mut().zip(&self.part).for_each(|(to, from)| *to = -from);
        }
        self.add_inputs(t, (y, yp), -1.0, rates);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        let n = self.system.dimension();
        self.system.jacobian(t, &y[..n], &yp[..n], cj, values);
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
        self.system.root_count()
    }

    fn root_kinds(&self) -> &[RootKind] {
        self.system.root_kinds()
    }

    fn roots_use_derivatives(&self) -> bool {
        self.system.roots_use_derivatives()
    }

    fn roots(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let n = self.system.dimension();
        self.system.roots(t, &y[..n], &yp[..yp.len().min(n)], out);
    }

    fn watched_unknowns(&self) -> &[u32] {
        self.system.watched_unknowns()
    }

    fn watched_input_count(&self) -> Option<usize> {
        self.system.watched_input_count()
    }

    fn watched_inputs(&self, out: &mut [f64]) {
        self.system.watched_inputs(out);
    }

    fn root_bounds(&mut self, span: (f64, f64), least: &[f64], most: &[f64], out: &mut [f64]) -> bool {
        let n = self.system.dimension();
        self.system.root_bounds(span, &least[..n], &most[..n], out)
    }

    /// Derivatives jump there.
    fn reports_jumps(&self) -> bool {
        true
    }

    fn has_past(&self) -> bool {
        self.system.has_past()
    }

    fn longest_step(&self) -> f64 {
        self.system.longest_step()
    }

    fn crosses(&mut self, at: f64) {
        self.system.crosses(at);
    }

    fn begin(&mut self, t: f64, y: &[f64]) {
        self.system.begin(t, &y[..self.system.dimension()]);
        let crossed = self.system.past_mut().and_then(|past| past.crossed());
        self.past.iter_mut().for_each(|past| past.begin(t, crossed));
    }

    fn begun(&mut self, t: f64, y: &[f64], yp: &[f64], rtol: f64) {
        let n = self.system.dimension();
        self.system.begun(t, &y[..n], &yp[..n], rtol);
    }

    fn record(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        let (n, length) = (self.system.dimension(), self.differential.len());
        let [mut all, mut rates] = std::mem::take(&mut self.inside);
        all.resize(length, 0.0);
        rates.resize(length, 0.0);
        self.system.record(span, rtol, &mut |t, y, yp| {
            within(t, &mut all, &mut rates);
            y.copy_from_slice(&all[..n]);
            yp.copy_from_slice(&rates[..n]);
        });
        self.inside = [all, rates];
        let mut nodes = std::mem::take(&mut self.nodes);
        nodes.place(span, length);
        for (node, time) in nodes.times().into_iter().enumerate() {
            let (y, yp) = nodes.at_mut(node);
            within(time, y, yp);
        }
        self.record_following(&nodes);
        self.nodes = nodes;
    }

    fn record_leading(&mut self, span: (f64, f64), rtol: f64, within: Within<'_>) {
        self.system.record(span, rtol, within);
    }

    fn record_following(&mut self, nodes: &Nodes) {
        if let Some(past) = &mut self.past {
            // Differentiable when the integration began, so now.
            let _ = past.accept(&mut self.system, &self.live, nodes);
        }
    }

    fn quadrature_count(&self) -> usize {
        self.system.quadrature_count() * (1 + self.width)
    }

    fn integrands_read_rates(&self) -> bool {
        self.integrals.as_ref().is_some_and(|integrals| !integrals.rates.is_empty())
    }

    fn quadratures(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        let (n, count) = (self.system.dimension(), self.system.quadrature_count());
        let ((y, s), (yp, sp), (own, derivatives)) = (y.split_at(n), yp.split_at(n), out.split_at_mut(count));
        self.leading_integrands(t, y, yp, own);
        self.following_integrands(t, (y, yp), (s, sp), derivatives);
    }

    fn leading_integrands(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.system.quadratures(t, y, yp, out);
    }

    fn following_integrands(&mut self, t: f64, y: (&[f64], &[f64]), s: (&[f64], &[f64]), out: &mut [f64]) {
        self.look_back(t, y);
        match &mut self.integrals {
            Some(integrals) => {
                let y = (seen(self.system.nonnegative(), y.0, &mut self.seen), y.1);
                integrals.write(&self.system, t, y, s, (self.past.as_deref(), self.width), out);
            }
            None => out.fill(0.0),
        }
    }
}
