//! The search: damped Newton iterations and pseudo-transient continuation on the free rows and
//! unknowns.

mod iterations;

use super::bounds::{self, Bounds};
use super::error::{AtBound, Freedom, SteadyError};
use super::freedom::{LARGE, freedom};
use super::problem::{Given, Problem};
use super::{equation_name, unknown_name};
use crate::catalogue::Catalogue;
use crate::interrupt::Pace;
use crate::newton::Try;
use crate::system::CompiledSystem;

/// Other first guesses that are tried where the search from the given one leads nowhere.
const OTHER_GUESSES: u64 = 8;

/// A search, with the problem that it is for.
pub(super) struct Search {
    pub problem: Problem,
    bounds: Bounds,
    /// First step of pseudo-time.
    first_step: f64,
    pace: Pace,
    interrupted: bool,
}

/// Nearest approach to rest of a failed search.
struct Nearest {
    outside: bool,
    /// Largest residual, relative to the scale of its unknown.
    size: f64,
    row: usize,
    residual: f64,
    aside: Option<AtBound>,
}

impl Default for Nearest {
    fn default() -> Self {
        Self { outside: true, size: f64::INFINITY, row: 0, residual: f64::NAN, aside: None }
    }
}

/// Start and course of a try.
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
    /// A search near `y`.
    pub(super) fn new(system: &mut CompiledSystem, catalogue: &Catalogue, given: Given<'_>, y: &[f64]) -> Result<Self, SteadyError> {
        let problem = Problem::new(system, catalogue, given, y)?;
        let bounds = bounds::of(catalogue, given.fixed.len(), given.actions);
        let first_step = 0.1 * system.model().interface().episode.step;
        let mut search = Self { problem, bounds, first_step, pace: Pace::default(), interrupted: false };
        if search.problem.is_singular() {
            let unknown = search.problem.empty_column().and_then(|at| unknown_name(catalogue, at));
            return Err(search.undetermined(system, catalogue, y, unknown));
        }
        Ok(search)
    }

    /// Improves `y` to a steady state; the number of iterations.
    pub(super) fn run(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        if self.problem.free.is_empty() {
            return Ok(0);
        }
        let found = self.search(system, catalogue, y);
        if self.interrupted { Err(SteadyError::Interrupted) } else { found }
    }

    fn search(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &mut [f64]) -> Result<u32, SteadyError> {
        let guess = y.to_vec();
        self.check_finite(system, catalogue, y)?;
        let (mut total, mut outside, mut singular) = (0, None, None);
        let mut best = Nearest::default();
        let tries = [Way::Newton, Way::Process, Way::Inside]
            .into_iter()
            .chain((0..OTHER_GUESSES).flat_map(|k| [Way::From(k), Way::ProcessFrom(k)]));
        for way in tries {
            if self.interrupted {
                break;
            }
            if matches!(way, Way::From(0)) {
                // Neither the guess nor where the process leads from it: other guesses do not make
                // more equations.
                if let Some(free) = freedom(&mut self.problem, system, catalogue, &guess) {
                    y.copy_from_slice(&guess);
                    return Err(SteadyError::Undetermined(free));
                }
            }
            y.copy_from_slice(&guess);
            match self.attempt(way, system, y) {
                Ok(Try::Converged(iterations)) => {
                    total += iterations;
                    if let Some(free) =
                        self.problem.looks_singular(system, y).then(|| freedom(&mut self.problem, system, catalogue, y)).flatten()
                    {
                        return Err(SteadyError::Undetermined(free));
                    }
                    match self.bounds.outside(&self.problem.free, y) {
                        None => return Ok(total),
                        Some(at) => outside = outside.or(Some((at, y[at]))),
                    }
                }
                Ok(Try::Failed(iterations)) => {
                    total += iterations;
                    self.look(system, catalogue, y, &mut best);
                }
                Err(column) => singular = singular.or(Some(column)),
            }
        }
        if let Some((at, value)) = outside {
            return Err(bounds::refusal(&self.bounds, &self.problem, catalogue, at, value));
        }
        // That a matrix on the way was singular says something only where nothing else is known.
        if let Some(column) = singular.filter(|_| best.size.is_infinite() || self.problem.free.len() > LARGE) {
            let unknown = column.and_then(|c| self.problem.free.get(c)).and_then(|&at| unknown_name(catalogue, at));
            return Err(self.undetermined(system, catalogue, &guess, unknown));
        }
        let equation = equation_name(system.model(), catalogue, best.row);
        Err(SteadyError::NotFound { iterations: total, residual: best.residual, equation, aside: best.aside })
    }

    /// That the point found does not rest, in words.
    pub(super) fn not_at_rest(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64], iterations: u32) -> SteadyError {
        let (_, row) = self.worst(system, y);
        let equation = equation_name(system.model(), catalogue, row);
        SteadyError::NotFound { iterations, residual: self.problem.rows.get(row).copied().unwrap_or(f64::NAN), equation, aside: None }
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

    /// Returns `true` if the free unknowns are inside of their bounds.
    pub(super) fn is_inside(&self, y: &[f64]) -> bool {
        self.bounds.outside(&self.problem.free, y).is_none()
    }

    /// Returns whether an unknown has a bound.
    pub(super) fn has_bounds(&self) -> bool {
        self.bounds.bind()
    }

    /// Another first guess inside of the bounds, by number.
    pub(crate) fn other_guess(&self, number: u64, y: &mut [f64]) {
        self.bounds.other_guess(number, &self.problem.free, y);
    }

    fn attempt(&mut self, way: Way, system: &mut CompiledSystem, y: &mut [f64]) -> Result<Try, Option<usize>> {
        if let Way::From(number) | Way::ProcessFrom(number) = way {
            self.other_guess(number, y);
            self.problem.evaluate(system, y);
            if self.problem.row_places.iter().any(|&row| !self.problem.rows[row].is_finite()) {
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
        self.problem.evaluate(system, y);
        match self.problem.row_places.iter().find(|&&row| !self.problem.rows[row].is_finite()) {
            Some(&row) => Err(SteadyError::NotFinite { equation: equation_name(system.model(), catalogue, row) }),
            None => Ok(()),
        }
    }

    /// Free unknowns near `y`; if unknown, the one without a pivot.
    fn undetermined(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64], unknown: Option<String>) -> SteadyError {
        let found = freedom(&mut self.problem, system, catalogue, y);
        let is_state = |name: &String| catalogue.states.find(name).is_some();
        let (states, algebraics) = unknown.into_iter().partition(is_state);
        SteadyError::Undetermined(found.unwrap_or(Freedom { states, algebraics, ..Freedom::default() }))
    }

    /// Keeps where a try ended, if that is nearer to rest than what is kept: inside of the bounds
    /// first.
    fn look(&mut self, system: &mut CompiledSystem, catalogue: &Catalogue, y: &[f64], best: &mut Nearest) {
        let (size, row) = self.worst(system, y);
        let outside = !self.is_inside(y);
        if size.is_finite() && (outside, size) < (best.outside, best.size) {
            let aside = bounds::reached(&self.bounds, &self.problem, catalogue, y);
            *best = Nearest { outside, size, row, residual: self.problem.rows[row], aside };
        }
    }

    /// The largest residual at `y`, relative to the scale of its unknown, and its row.
    fn worst(&mut self, system: &mut CompiledSystem, y: &[f64]) -> (f64, usize) {
        self.problem.evaluate(system, y);
        let sizes = self.problem.row_places.iter().map(|&row| (self.problem.rows[row].abs() / self.problem.row_scale(row), row));
        sizes.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0))
    }

    /// Factorises the Jacobian with the weight `cj` of the derivatives. The column without a pivot
    /// is the error.
    fn factorise(&mut self, system: &mut CompiledSystem, y: &[f64], cj: f64) -> Result<(), Option<usize>> {
        self.interrupted |= self.pace.stops();
        if self.interrupted { Err(None) } else { self.problem.factorise(system, y, cj) }
    }
}
