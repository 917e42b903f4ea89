//! The problem without its fixed states: rows and unknowns that are free, and their Jacobian.

use nalgebra::{DMatrix, DVector};
use smpl_compiler::compiled::{Derived, WithRespectTo};
use smpl_compiler::layout::Region;

use super::delays::Delays;
use super::error::SteadyError;
use super::frames::{self, Frames};
use crate::catalogue::{Catalogue, Element};
use crate::solver::linear::Factorisation;
use crate::solver::{LinearSolver, Pattern, SolveError, System};
use crate::system::CompiledSystem;

/// A solution that is larger than its right-hand side by this is that of a matrix that may be
/// singular.
const SUSPICIOUS: f64 = 1e10;
/// Correction, relative to the scales, of a point at rest: what a search leaves is far below it.
const AT_REST: f64 = 1e-7;

/// Fixed values of a problem, and values found with the unknowns.
#[derive(Clone, Copy)]
pub(super) struct Given<'a> {
    /// True if each place of `y` is held.
    pub fixed: &'a [bool],
    /// Numbers of the conditions that hold.
    pub conditions: &'a [usize],
    /// Actions that are unknowns too, by their place in the region: as many as held places and
    /// conditions. All equations hold then.
    pub actions: &'a [usize],
}

/// The problem without its fixed states, and working memory. Points are those of `y`, with free
/// actions behind.
pub(super) struct Problem {
    /// Places of the free unknowns, in `y` and behind.
    pub free: Vec<usize>,
    /// Places of the rows, as many; the conditions of a problem with free actions are behind those
    /// of the equations.
    pub row_places: Vec<usize>,
    /// Places of free actions in their region.
    actions: Vec<usize>,
    /// Conditions, by number, and the row that each takes the place of.
    conditions: Vec<(usize, usize)>,
    /// Place of each number of the conditions' derivatives, and of the derivatives by free actions,
    /// among the numbers behind the Jacobian's.
    gradient: Vec<Option<usize>>,
    /// Values of other instants in the equations, which are the point itself.
    frames: Option<Frames>,
    /// Delayed expressions, with their present values.
    delays: Option<Delays>,
    /// Entries of the reduced Jacobian to which values of the frames, and behind them of the
    /// delays, are added: entry, value.
    added: Vec<(usize, usize)>,
    /// Places of the reduced Jacobian's entries among all entries; `None` where only frames have
    /// one.
    kept: Vec<Option<usize>>,
    pattern: Pattern,
    /// `None` where the reduced Jacobian has no pivots whatever its numbers are.
    factorisation: Option<Factorisation>,
    /// Size of each unknown of the whole problem.
    pub scales: Vec<f64>,
    zero: Vec<f64>,
    /// Rows of the whole problem at the last point.
    pub rows: Vec<f64>,
    entries: Vec<f64>,
    reduced: Vec<f64>,
}

impl Problem {
    /// The problem near the point `y`.
    ///
    /// # Errors
    /// A condition that determines no state.
    pub(super) fn new(system: &mut CompiledSystem, catalogue: &Catalogue, given: Given<'_>, y: &[f64]) -> Result<Self, SteadyError> {
        let Given { fixed, conditions: numbers, actions } = given;
        let n = fixed.len();
        let mut scales = scales(catalogue, n);
        scales.extend(actions.iter().map(|&at| catalogue.actions.elements().iter().find(|e| e.at == at).map_or(1.0, Element::range)));
        let triplets = slopes(system, (numbers, actions), y)?;
        let conditions = match actions {
            [] => replaced(&triplets, numbers, fixed, system.model().states(), &scales)?,
            _ => numbers.iter().enumerate().map(|(i, &condition)| (condition, n + i)).collect(),
        };
        let free: Vec<usize> = (0..n).filter(|&i| !fixed[i]).chain(n..n + actions.len()).collect();
        let row_places = match actions {
            [] => free.clone(),
            _ => (0..n + conditions.len()).collect(),
        };
        if free.len() != row_places.len() {
            let (held, count) = (fixed.iter().filter(|fixed| **fixed).count() + numbers.len(), actions.len());
            let message = format!("`free` needs as many actions as given values and conditions: {count} are free, {held} are given");
            return Err(SteadyError::Condition { message });
        }
        let mut number = vec![None; n + conditions.len()];
        row_places.iter().enumerate().for_each(|(position, &at)| number[at] = Some(position));
        conditions.iter().filter(|&&(_, row)| row < n).for_each(|&(_, row)| number[row] = None);
        let frames = Frames::new(system)?;
        let delays = Delays::new(system, actions, &y[..n])?;
        let pattern = system.pattern();
        let places = frames.iter().flat_map(|frames| &frames.places).chain(delays.iter().flat_map(|delays| &delays.places));
        let by_frames = places.enumerate();
        let by_frames: Vec<(usize, usize, usize)> =
            by_frames.filter_map(|(value, &(row, column))| Some((number[row]?, column, value))).collect();
        // The row of each slope: that of its condition, or an equation.
        let row_of = |slope: &Slope| match slope.of {
            Of::Condition(k) => conditions.iter().find(|c| c.0 == k).and_then(|&(_, row)| row_places.iter().position(|&at| at == row)),
            Of::Row(row) => number[row],
        };
        let (mut starts, mut rows, mut kept, mut added) = (vec![0], Vec::new(), Vec::new(), Vec::new());
        let mut gradient = vec![None; triplets.len()];
        let mut behind = pattern.entries();
        for &column in &free {
            let mut entries: Vec<(usize, Option<usize>)> = match column < n {
                true => pattern.column(column).filter_map(|entry| Some((number[pattern.rows()[entry]]?, Some(entry)))).collect(),
                false => Vec::new(),
            };
            let own: Vec<(usize, usize)> =
                (0..triplets.len()).filter(|&k| triplets[k].column == column).filter_map(|k| Some((k, row_of(&triplets[k])?))).collect();
            for (k, row) in own {
                let place = match entries.iter().find(|e| e.0 == row) {
                    Some((_, Some(place))) => *place,
                    _ => {
                        entries.push((row, Some(behind)));
                        behind += 1;
                        behind - 1
                    }
                };
                gradient[k] = Some(place);
            }
            let moved = || by_frames.iter().filter(|&&(_, at, _)| at == column).map(|&(row, _, value)| (row, value));
            for (row, _) in moved() {
                if entries.iter().all(|e| e.0 != row) {
                    entries.push((row, None));
                }
            }
            entries.sort_unstable();
            let place = |row: usize| entries.iter().position(|e| e.0 == row).map(|place| rows.len() + place);
            added.extend(moved().filter_map(|(row, value)| Some((place(row)?, value))));
            rows.extend(entries.iter().map(|e| e.0));
            kept.extend(entries.iter().map(|e| e.1));
            starts.push(rows.len());
        }
        let pattern = Pattern::new(starts, rows).map_err(SolveError::from)?;
        Ok(Self {
            reduced: vec![0.0; kept.len()],
            factorisation: Factorisation::new(&pattern, LinearSolver::Auto).ok(),
            pattern,
            rows: vec![0.0; n + conditions.len()],
            free,
            row_places,
            actions: actions.to_vec(),
            conditions,
            gradient,
            frames,
            delays,
            added,
            kept,
            scales,
            zero: vec![0.0; n],
            entries: vec![0.0; behind],
        })
    }

    /// Number of unknowns of the model.
    fn unknowns(&self) -> usize {
        self.zero.len()
    }

    /// Returns whether actions are among the unknowns.
    pub(super) fn has_actions(&self) -> bool {
        !self.actions.is_empty()
    }

    /// The state, variable or free action at a place.
    pub(super) fn element<'c>(&self, catalogue: &'c Catalogue, at: usize) -> Option<&'c Element> {
        match at.checked_sub(self.unknowns()) {
            None => catalogue.states.elements().iter().chain(catalogue.solved.elements()).find(|e| e.at == at),
            Some(action) => catalogue.actions.elements().iter().find(|e| e.at == self.actions[action]),
        }
    }

    /// Size by which a row is judged: the scale of the unknown of the same place.
    pub(super) fn row_scale(&self, row: usize) -> f64 {
        if row < self.unknowns() { self.scales[row] } else { 1.0 }
    }

    /// Puts free actions into the instance.
    fn apply(&self, system: &mut CompiledSystem, y: &[f64]) {
        if self.actions.is_empty() {
            return;
        }
        let region = system.region_mut(Region::Action);
        self.actions.iter().zip(&y[self.unknowns()..]).for_each(|(&at, &value)| region[at] = value);
        let (model, memory) = system.parts();
        model.prepare_step(memory);
    }

    /// Rows that conditions take the place of.
    pub(super) fn replaced(&self) -> impl Iterator<Item = usize> + '_ {
        self.conditions.iter().map(|c| c.1)
    }

    /// Returns `true` if a right-hand side gives a solution so large that the matrix of the last
    /// factorisation may be singular.
    pub(super) fn looks_singular(&mut self, system: &mut CompiledSystem, y: &[f64]) -> bool {
        if self.factorise(system, y, 0.0).is_err() {
            return true;
        }
        let mut sizes = vec![0.0_f64; self.free.len()];
        for (row, _, size) in self.places() {
            sizes[row] = sizes[row].max(size.abs());
        }
        let sign = |i: usize| 1.0 - 2.0 * ((i as f64 + 1.0) * 0.618_033_988_749_895).fract();
        let mut solution: Vec<f64> = sizes.iter().enumerate().map(|(i, size)| sign(i) * size).collect();
        self.solve(&mut solution);
        // NaN counts as large.
        let size = self.norm(&solution);
        size.is_nan() || size > SUSPICIOUS
    }

    /// Rows, columns and values of the reduced Jacobian, columns scaled.
    fn places(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let pattern = self.pattern.column_starts().windows(2).enumerate();
        let entries = pattern.flat_map(|(column, ends)| (ends[0]..ends[1]).map(move |entry| (column, entry)));
        entries.map(|(column, entry)| (self.pattern.rows()[entry], column, self.reduced[entry] * self.scales[self.free[column]]))
    }

    /// The Jacobian with scaled columns and the rates at a point, in full; `None` where they are
    /// not finite.
    pub(super) fn dense(&mut self, system: &mut CompiledSystem, y: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>)> {
        self.evaluate(system, y);
        self.take_jacobian(system, y, 0.0);
        let n = self.free.len();
        let mut jacobian = DMatrix::zeros(n, n);
        for (row, column, value) in self.places() {
            jacobian[(row, column)] = value;
        }
        let rates = DVector::from_iterator(n, self.row_places.iter().map(|&at| self.rows[at]));
        (jacobian.iter().chain(rates.iter()).all(|x| x.is_finite())).then_some((jacobian, rates))
    }

    /// Rows at rest.
    pub(super) fn evaluate(&mut self, system: &mut CompiledSystem, y: &[f64]) {
        self.apply(system, y);
        let n = self.unknowns();
        let y = &y[..n];
        if self.frames.is_some() {
            frames::rest_at(system, y);
        }
        system.residual(0.0, y, &self.zero, &mut self.rows[..n]);
        if !self.conditions.is_empty() {
            let missed = missed_conditions(system, y);
            self.conditions.iter().for_each(|&(condition, row)| self.rows[row] = missed[condition]);
        }
    }

    /// The reduced Jacobian with the weight `cj` of the derivatives.
    fn take_jacobian(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) {
        self.apply(system, y);
        let y = &y[..self.unknowns()];
        if let Some(frames) = &mut self.frames {
            frames::rest_at(system, y);
            frames.evaluate(system, y, &self.zero);
        }
        if let Some(delays) = &mut self.delays {
            delays.evaluate(system, &self.actions, y, &self.zero);
        }
        let (jacobian, behind) = self.entries.split_at_mut(system.pattern().entries());
        system.jacobian(0.0, y, &self.zero, cj, jacobian);
        if !self.gradient.is_empty() {
            behind.fill(0.0);
            let first = jacobian.len();
            // Differentiable when the search began, so now.
            let numbers: Vec<usize> = self.conditions.iter().map(|c| c.0).collect();
            for (place, slope) in self.gradient.iter().zip(slopes(system, (&numbers, &self.actions), y).unwrap_or_default()) {
                place.iter().for_each(|at| behind[at - first] += slope.value);
            }
        }
        for (value, &entry) in self.reduced.iter_mut().zip(&self.kept) {
            *value = entry.map_or(0.0, |entry| self.entries[entry]);
        }
        let moved = self.frames.iter().flat_map(|frames| &frames.values).chain(self.delays.iter().flat_map(|delays| &delays.values));
        if !self.added.is_empty() {
            let moved: Vec<f64> = moved.copied().collect();
            self.added.iter().for_each(|&(entry, value)| self.reduced[entry] += moved[value]);
        }
    }

    /// Factorises the Jacobian with the weight `cj` of the derivatives. The column without a pivot
    /// is the error.
    pub(super) fn factorise(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) -> Result<(), Option<usize>> {
        self.take_jacobian(system, y, cj);
        if self.reduced.iter().any(|v| !v.is_finite()) {
            return Err(None);
        }
        let factorisation = self.factorisation.as_mut().ok_or(None)?;
        factorisation.factorise(&self.reduced).map_err(|singular| singular.column)
    }

    /// Writes the correction that the last factorisation gives for the present rows.
    pub(super) fn correction(&mut self, out: &mut [f64]) {
        for (value, &at) in out.iter_mut().zip(&self.row_places) {
            *value = -self.rows[at];
        }
        self.solve(out);
    }

    /// Returns `true` if the present rows ask for no correction that counts; the last factorisation
    /// is one near the point.
    pub(super) fn rests(&mut self, system: &mut CompiledSystem, y: &[f64]) -> bool {
        self.evaluate(system, y);
        let mut correction = vec![0.0; self.free.len()];
        if !correction.is_empty() {
            self.correction(&mut correction);
        }
        self.norm(&correction) <= AT_REST
    }

    fn solve(&mut self, x: &mut [f64]) {
        if let Some(factorisation) = &mut self.factorisation {
            factorisation.solve(x);
        }
    }

    /// Returns `true` if the reduced Jacobian has no pivots whatever its numbers are.
    pub(super) fn is_singular(&self) -> bool {
        self.factorisation.is_none()
    }

    /// The place in `y` of an unknown that no free equation mentions.
    pub(super) fn empty_column(&self) -> Option<usize> {
        let column = (0..self.pattern.dimension()).find(|&c| self.pattern.column(c).is_empty())?;
        Some(self.free[column])
    }

    /// Largest entry of a correction relative to the scales; NaN where an entry is.
    pub(super) fn norm(&self, correction: &[f64]) -> f64 {
        let relative = correction.iter().zip(&self.free).map(|(d, &at)| (d / self.scales[at]).abs());
        relative.fold(0.0, |norm, x| if x.is_nan() || x > norm { x } else { norm })
    }
}

/// The scale of each unknown, 1 where it has none.
fn scales(catalogue: &Catalogue, unknowns: usize) -> Vec<f64> {
    let mut scales = vec![1.0; unknowns];
    for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
        if element.scale.is_finite() && element.scale > 0.0 {
            scales[element.at] = element.scale;
        }
    }
    scales
}

/// By how much each condition on the steady state is missed.
fn missed_conditions(system: &mut CompiledSystem, y: &[f64]) -> Vec<f64> {
    let (model, memory) = system.parts();
    let (conditions, fixed) =
        model.interface().steady.as_ref().map_or((0, 0), |problem| (problem.conditions as usize, problem.fixed.len()));
    let mut out = vec![0.0; memory.region(smpl_compiler::layout::Region::Action).len() + fixed + conditions];
    model.steady(memory, &mut y.to_vec(), &mut out);
    out.split_off(out.len() - conditions)
}

/// Derivatives of the conditions: condition, unknown, value.
pub(super) fn gradient(system: &mut CompiledSystem, y: &[f64]) -> Result<Vec<(usize, usize, f64)>, SteadyError> {
    let zero = vec![0.0; y.len()];
    let (model, memory) = system.parts();
    let found = model.derivative(Derived::SteadyConditions, WithRespectTo::Unknowns, memory, 0.0, (y, &zero));
    found.map_err(|e| SteadyError::Condition { message: e.to_string() })
}

/// A derivative of a condition by an unknown, or of a condition or an equation by a free action.
struct Slope {
    of: Of,
    /// Place of the unknown, of `y` and behind.
    column: usize,
    value: f64,
}

/// Function of a derivative.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Of {
    Condition(usize),
    Row(usize),
}

/// Derivatives of conditions by unknowns, and of conditions and equations by free actions, always
/// in the same order.
fn slopes(system: &mut CompiledSystem, (conditions, actions): (&[usize], &[usize]), y: &[f64]) -> Result<Vec<Slope>, SteadyError> {
    let n = system.model().unknowns();
    let y = &y[..n];
    let mut out = Vec::new();
    if !conditions.is_empty() {
        let of_conditions = gradient(system, y)?.into_iter();
        out.extend(of_conditions.map(|(k, column, value)| Slope { of: Of::Condition(k), column, value }));
    }
    if actions.is_empty() {
        return Ok(out);
    }
    let zero = vec![0.0; n];
    let (model, memory) = system.parts();
    for of in [Derived::Rows, Derived::SteadyConditions] {
        let found = model.derivative(of, WithRespectTo::Actions, memory, 0.0, (y, &zero));
        for (row, at, value) in found.map_err(|e| SteadyError::Condition { message: e.to_string() })? {
            let of = if of == Derived::Rows { Of::Row(row) } else { Of::Condition(row) };
            out.extend(actions.iter().position(|&free| free == at).map(|i| Slope { of, column: n + i, value }));
        }
    }
    Ok(out)
}

/// For each condition a row that it takes the place of: that of the state that it depends on most.
fn replaced(
    slopes: &[Slope],
    conditions: &[usize],
    fixed: &[bool],
    states: usize,
    scales: &[f64],
) -> Result<Vec<(usize, usize)>, SteadyError> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for &condition in conditions {
        let own = slopes.iter().filter(|t| t.of == Of::Condition(condition) && t.column < states && !fixed[t.column]);
        let own = own.filter(|t| !out.iter().any(|o| o.1 == t.column));
        let size = |t: &Slope| (t.value * scales[t.column]).abs();
        match own.max_by(|a, b| size(a).total_cmp(&size(b))) {
            Some(largest) => out.push((condition, largest.column)),
            None => {
                let message = format!("no state is left that condition {} of the `steady` block could determine", condition + 1);
                return Err(SteadyError::Condition { message });
            }
        }
    }
    Ok(out)
}
