//! The search: damped Newton iterations and pseudo-transient continuation on the free rows and unknowns.

mod iterations;

use nalgebra::{DMatrix, DVector};
use smpl_compiler::compiled::{Derived, WithRespectTo};

use super::bounds::Bounds;
use super::error::{Freedom, SteadyError};
use super::freedom::{LARGE, freedom};
use super::{equation_name, unknown_name};
use crate::catalogue::Catalogue;
use crate::interrupt::Pace;
use crate::solver::linear::Factorisation;
use crate::solver::{LinearSolver, Pattern, System};
use crate::system::CompiledSystem;

/// Other first guesses that are tried where the search from the given one leads nowhere.
const OTHER_GUESSES: u64 = 8;
/// A solution that is larger than its right-hand side by this is that of a matrix that may be singular.
const SUSPICIOUS: f64 = 1e10;

/// The problem without its fixed states, and working memory.
pub(super) struct Search {
    /// Places in `y` of the free unknowns.
    pub free: Vec<usize>,
    /// Conditions, by number, and the row that each takes the place of.
    conditions: Vec<(usize, usize)>,
    /// Place of each number of the conditions' derivatives among the numbers behind the Jacobian's.
    gradient: Vec<Option<usize>>,
    /// Places of the reduced Jacobian's entries among all entries.
    kept: Vec<usize>,
    pattern: Pattern,
    factorisation: Factorisation,
    pub scales: Vec<f64>,
    bounds: Bounds,
    /// First step of pseudo-time.
    first_step: f64,
    zero: Vec<f64>,
    rows: Vec<f64>,
    entries: Vec<f64>,
    reduced: Vec<f64>,
    pace: Pace,
    interrupted: bool,
}

/// How one try ended.
enum Try {
    Converged(u32),
    Failed(u32),
}

/// Where a try begins and how it goes on.
#[derive(Clone, Copy)]
enum Way {
    /// Newton's method from the guess.
    Newton,
    /// From where the process leads from the guess.
    Process,
    /// From the guess, kept inside of the bounds.
    Inside,
    /// From another guess.
    From(u64),
    /// From where the process leads from it.
    ProcessFrom(u64),
}

impl Search {
    /// `conditions` are the numbers of those that hold.
    pub fn new(
        system: &mut CompiledSystem,
        catalogue: &Catalogue,
        fixed: &[bool],
        conditions: &[usize],
        y: &[f64],
    ) -> Result<Self, SteadyError> {
        let n = fixed.len();
        let mut scales = vec![1.0; n];
        for element in catalogue.states.elements().iter().chain(catalogue.solved.elements()) {
            if element.scale.is_finite() && element.scale > 0.0 {
                scales[element.at] = element.scale;
            }
        }
        let triplets = if conditions.is_empty() { Vec::new() } else { gradient(system, y)? };
        let conditions = replaced(&triplets, conditions, fixed, system.model().states(), &scales)?;
        let pattern = system.pattern();
        let free: Vec<usize> = (0..n).filter(|&i| !fixed[i]).collect();
        let mut number = vec![usize::MAX; n];
        for (position, &at) in free.iter().enumerate() {
            number[at] = position;
        }
        let is_replaced = |row: usize| conditions.iter().any(|&(_, replaced)| replaced == row);
        let (mut starts, mut rows, mut kept) = (vec![0], Vec::new(), Vec::new());
        let mut gradient = vec![None; triplets.len()];
        let mut behind = pattern.entries();
        for &column in &free {
            let own =
                pattern.column(column).map(|entry| (pattern.rows()[entry], entry)).filter(|&(row, _)| !fixed[row] && !is_replaced(row));
            let mut entries: Vec<(usize, usize)> = own.map(|(row, entry)| (number[row], entry)).collect();
            for &(condition, replaced) in &conditions {
                let parts = (0..triplets.len()).filter(|&k| triplets[k].0 == condition && triplets[k].1 == column);
                let mut place = None;
                for k in parts {
                    gradient[k] = Some(*place.get_or_insert(behind));
                }
                if let Some(place) = place {
                    entries.push((number[replaced], place));
                    behind += 1;
                }
            }
            entries.sort_unstable();
            rows.extend(entries.iter().map(|e| e.0));
            kept.extend(entries.iter().map(|e| e.1));
            starts.push(rows.len());
        }
        let reduced = Pattern::new(starts, rows).map_err(crate::solver::SolveError::from)?;
        let factorisation = Factorisation::new(&reduced, LinearSolver::Auto);
        let singular = factorisation.is_err();
        let entries = vec![0.0; behind];
        let mut search = Self {
            reduced: vec![0.0; kept.len()],
            pace: Pace::default(),
            interrupted: false,
            bounds: Bounds::new(catalogue, n),
            // Where there is none, one of nothing stands in until it is known what is free.
            factorisation: match factorisation {
                Ok(factorisation) => factorisation,
                Err(_) => Factorisation::new(&Pattern::full(0), LinearSolver::Dense)?,
            },
            pattern: reduced.clone(),
            free,
            conditions,
            gradient,
            kept,
            scales,
            first_step: 0.1 * system.model().interface().episode.step,
            zero: vec![0.0; n],
            rows: vec![0.0; n],
            entries,
        };
        if singular {
            let unknown = empty_column(&reduced, &search.free, catalogue);
            return Err(search.undetermined(system, catalogue, y, unknown));
        }
        Ok(search)
    }

    /// Improves `y` to a steady state; the number of iterations.
    pub fn run(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        if self.free.is_empty() {
            return Ok(0);
        }
        let found = self.search(system, catalogue, y);
        if self.interrupted { Err(SteadyError::Interrupted) } else { found }
    }

    fn search(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        let guess = y.to_vec();
        self.check_finite(system, catalogue, y)?;
        let (mut total, mut outside, mut singular) = (0, None, None);
        let mut best = (f64::INFINITY, 0, f64::NAN);
        let tries = [Way::Newton, Way::Process, Way::Inside]
            .into_iter()
            .chain((0..OTHER_GUESSES).flat_map(|k| [Way::From(k), Way::ProcessFrom(k)]));
        for way in tries {
            if self.interrupted {
                break;
            }
            if matches!(way, Way::From(0)) {
                // Neither the guess nor where the process leads from it: other guesses do not make more equations.
                if let Some(free) = freedom(self, system, catalogue, &guess) {
                    y.copy_from_slice(&guess);
                    return Err(SteadyError::Undetermined(free));
                }
            }
            y.copy_from_slice(&guess);
            match self.attempt(way, system, y) {
                Ok(Try::Converged(iterations)) => {
                    total += iterations;
                    if let Some(free) = self.looks_singular(system, y).then(|| freedom(self, system, catalogue, y)).flatten() {
                        return Err(SteadyError::Undetermined(free));
                    }
                    match self.bounds.outside(&self.free, y) {
                        None => return Ok(total),
                        Some(at) => outside = outside.or(Some((at, y[at]))),
                    }
                }
                Ok(Try::Failed(iterations)) => {
                    total += iterations;
                    let (size, row) = self.worst(system, y);
                    if size < best.0 {
                        best = (size, row, self.rows[row]);
                    }
                }
                Err(column) => singular = singular.or(Some(column)),
            }
        }
        if let Some((at, value)) = outside {
            return Err(self.bounds.refusal(catalogue, at, value));
        }
        // That a matrix on the way was singular says something only where nothing else is known.
        if let Some(column) = singular.filter(|_| best.0.is_infinite() || self.free.len() > LARGE) {
            let unknown = column.and_then(|c| self.free.get(c)).and_then(|&at| unknown_name(catalogue, at));
            return Err(self.undetermined(system, catalogue, &guess, unknown));
        }
        let equation = equation_name(system.model(), catalogue, best.1);
        Err(SteadyError::NotFound { iterations: total, residual: best.2, equation })
    }

    /// Newton's method from `y`, and from where the process leads, whatever the bounds.
    pub(crate) fn run_once(&mut self, system: &mut CompiledSystem, y: &mut [f64]) -> bool {
        let guess = y.to_vec();
        for way in [Way::Newton, Way::Process] {
            y.copy_from_slice(&guess);
            if matches!(self.attempt(way, system, y), Ok(Try::Converged(_))) {
                return true;
            }
        }
        false
    }

    /// Rows that conditions take the place of.
    pub fn replaced(&self) -> impl Iterator<Item = usize> + '_ {
        self.conditions.iter().map(|c| c.1)
    }

    /// Whether the free unknowns are inside of their bounds.
    pub fn is_inside(&self, y: &[f64]) -> bool {
        self.bounds.outside(&self.free, y).is_none()
    }

    /// Another first guess inside of the bounds, by number.
    pub(crate) fn other_guess(&self, number: u64, y: &mut [f64]) {
        self.bounds.other_guess(number, &self.free, &self.scales, y);
    }

    fn attempt(&mut self, way: Way, system: &mut CompiledSystem, y: &mut [f64]) -> Result<Try, Option<usize>> {
        if let Way::From(number) | Way::ProcessFrom(number) = way {
            self.other_guess(number, y);
            self.evaluate(system, y);
            if self.free.iter().any(|&row| !self.rows[row].is_finite()) {
                return Ok(Try::Failed(0));
            }
        }
        let followed = if matches!(way, Way::Process | Way::ProcessFrom(_)) { self.follow(system, y) } else { 0 };
        Ok(match self.newton(system, y, matches!(way, Way::Inside))? {
            Try::Converged(iterations) => Try::Converged(followed + iterations),
            Try::Failed(iterations) => Try::Failed(followed + iterations),
        })
    }

    fn check_finite(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64]) -> Result<(), SteadyError> {
        self.evaluate(system, y);
        match self.free.iter().find(|&&row| !self.rows[row].is_finite()) {
            Some(&row) => Err(SteadyError::NotFinite { equation: equation_name(system.model(), catalogue, row) }),
            None => Ok(()),
        }
    }

    /// What is free near `y`; where that cannot be told, the unknown without a pivot.
    fn undetermined(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64], unknown: Option<String>) -> SteadyError {
        let found = freedom(self, system, catalogue, y);
        let is_state = |name: &String| catalogue.states.find(name).is_some();
        let (states, algebraics) = unknown.into_iter().partition(is_state);
        SteadyError::Undetermined(found.unwrap_or(Freedom { states, algebraics, ..Freedom::default() }))
    }

    /// Whether a right-hand side gives a solution so large that the matrix of the last factorisation may be singular.
    fn looks_singular(&mut self, system: &mut CompiledSystem, y: &[f64]) -> bool {
        if self.factorise(system, y, 0.0).is_err() {
            return true;
        }
        let mut sizes = vec![0.0_f64; self.free.len()];
        for (row, _, size) in self.places() {
            sizes[row] = sizes[row].max(size.abs());
        }
        let sign = |i: usize| 1.0 - 2.0 * ((i as f64 + 1.0) * 0.618_033_988_749_895).fract();
        let mut solution: Vec<f64> = sizes.iter().enumerate().map(|(i, size)| sign(i) * size).collect();
        self.factorisation.solve(&mut solution);
        // A number that is none counts as large.
        let size = self.norm(&solution);
        size.is_nan() || size > SUSPICIOUS
    }

    /// Rows, columns and values of the reduced Jacobian, columns scaled.
    fn places(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let pattern = self.pattern.column_starts().windows(2).enumerate();
        let entries = pattern.flat_map(|(column, ends)| (ends[0]..ends[1]).map(move |entry| (column, entry)));
        entries.map(|(column, entry)| (self.pattern.rows()[entry], column, self.reduced[entry] * self.scales[self.free[column]]))
    }

    /// The Jacobian with scaled columns and the rates at a point, in full; `None` where they are not finite.
    pub fn dense(&mut self, system: &mut CompiledSystem, y: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>)> {
        self.evaluate(system, y);
        self.take_jacobian(system, y, 0.0);
        let n = self.free.len();
        let mut jacobian = DMatrix::zeros(n, n);
        for (row, column, value) in self.places() {
            jacobian[(row, column)] = value;
        }
        let rates = DVector::from_iterator(n, self.free.iter().map(|&at| self.rows[at]));
        (jacobian.iter().chain(rates.iter()).all(|x| x.is_finite())).then_some((jacobian, rates))
    }

    /// The largest residual at `y`, relative to the scale of its unknown, and its row.
    fn worst(&mut self, system: &mut CompiledSystem, y: &[f64]) -> (f64, usize) {
        self.evaluate(system, y);
        let sizes = self.free.iter().map(|&row| (self.rows[row].abs() / self.scales[row], row));
        sizes.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0))
    }

    /// Rows at rest.
    fn evaluate(&mut self, system: &mut CompiledSystem, y: &[f64]) {
        system.residual(0.0, y, &self.zero, &mut self.rows);
        if !self.conditions.is_empty() {
            let missed = missed_conditions(system, y);
            self.conditions.iter().for_each(|&(condition, row)| self.rows[row] = missed[condition]);
        }
    }

    /// The reduced Jacobian with the weight `cj` of the derivatives.
    fn take_jacobian(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) {
        let (jacobian, behind) = self.entries.split_at_mut(system.pattern().entries());
        system.jacobian(0.0, y, &self.zero, cj, jacobian);
        if !self.conditions.is_empty() {
            behind.fill(0.0);
            let first = jacobian.len();
            // Differentiable when the search began, so now.
            for (place, (_, _, value)) in self.gradient.iter().zip(gradient(system, y).unwrap_or_default()) {
                place.iter().for_each(|at| behind[at - first] += value);
            }
        }
        for (value, &entry) in self.reduced.iter_mut().zip(&self.kept) {
            *value = self.entries[entry];
        }
    }

    /// Factorises the Jacobian with the weight `cj` of the derivatives. The column without a pivot is the error.
    fn factorise(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) -> Result<(), Option<usize>> {
        self.interrupted |= self.pace.stops();
        if self.interrupted {
            return Err(None);
        }
        self.take_jacobian(system, y, cj);
        if self.reduced.iter().any(|v| !v.is_finite()) {
            return Err(None);
        }
        self.factorisation.factorise(&self.reduced).map_err(|singular| singular.column)
    }

    /// Writes the correction that the last factorisation gives for the present rows.
    fn correction(&mut self, out: &mut [f64]) {
        for (value, &at) in out.iter_mut().zip(&self.free) {
            *value = -self.rows[at];
        }
        self.factorisation.solve(out);
    }
}

/// An unknown that no free equation mentions.
fn empty_column(pattern: &Pattern, free: &[usize], catalogue: &Catalogue) -> Option<String> {
    let column = (0..pattern.dimension()).find(|&c| pattern.column(c).is_empty())?;
    unknown_name(catalogue, free[column])
}

/// By how much each condition on the steady state is missed.
pub(super) fn missed_conditions(system: &mut CompiledSystem, y: &[f64]) -> Vec<f64> {
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

/// For each condition a row that it takes the place of: that of the state that it depends on most.
fn replaced(
    triplets: &[(usize, usize, f64)],
    conditions: &[usize],
    fixed: &[bool],
    states: usize,
    scales: &[f64],
) -> Result<Vec<(usize, usize)>, SteadyError> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for &condition in conditions {
        let own = triplets.iter().filter(|t| t.0 == condition && t.1 < states && !fixed[t.1] && !out.iter().any(|o| o.1 == t.1));
        let size = |t: &(usize, usize, f64)| (t.2 * scales[t.1]).abs();
        match own.max_by(|a, b| size(a).total_cmp(&size(b))) {
            Some(largest) => out.push((condition, largest.1)),
            None => {
                let message = format!("no state is left that condition {} of the `steady` block could determine", condition + 1);
                return Err(SteadyError::Condition { message });
            }
        }
    }
    Ok(out)
}
