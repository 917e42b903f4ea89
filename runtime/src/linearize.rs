//! Linearisation about a point: dx/dt = A x + B u, observations = C x + D u, in deviations.
//!
//! Algebraic unknowns z are eliminated from the equations
//!
//! ```text
//! E dx/dt = F_x x + F_z z + F_u u,    0 = G_x x + G_z z + G_u u.
//! ```
//!
//! The matrices follow from z = -G_z^-1 (G_x x + G_u u). Where E depends on x, F_x has -E_x dx/dt,
//! with the rates at the point. Where equations of algebraic unknowns read rates as well, these and
//! z follow from all equations together. The matrices are stored in full, for models of up to some
//! thousand unknowns.

use nalgebra::DMatrix;
use smpl_compiler::compiled::{CompiledModel, Derived, WithRespectTo};

use crate::catalogue::Catalogue;
use crate::inverse::Inverse;
use crate::solver::System;
use crate::system::CompiledSystem;

/// Most corrections of rates, and the relative change of their weights that ends them.
const MOST_CORRECTIONS: usize = 50;
const SETTLED: f64 = 1e-12;
/// Largest entry of a row of constraints that depends on the others; rows are of length 1.
const DEPENDENT: f64 = 1e-10;

/// The matrices of a linearisation; states and actions in declaration order, units as declared.
#[derive(Clone, Debug, PartialEq)]
pub struct Linearization {
    /// States by states, per unit of time.
    pub a: DMatrix<f64>,
    /// States by actions.
    pub b: DMatrix<f64>,
    /// Observations by states.
    pub c: DMatrix<f64>,
    /// Observations by actions.
    pub d: DMatrix<f64>,
    /// Constraints that states are projected to leave fewer free coordinates than states.
    pub free: Option<Free>,
}

/// Coordinates of the states near a point on their constraints: some of the states themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Numbers of these states.
    pub coordinates: Vec<usize>,
    /// All states by the coordinates.
    pub states: DMatrix<f64>,
}

impl Linearization {
    /// The linearisation in free coordinates: without the modes that lead back to constraints.
    #[must_use]
    pub fn minimal(self) -> Linearization {
        let Some(free) = self.free else { return self };
        let a = self.a.select_rows(&free.coordinates) * &free.states;
        let (b, c) = (self.b.select_rows(&free.coordinates), &self.c * &free.states);
        Linearization { a, b, c, d: self.d, free: Some(free) }
    }
}

/// Reason why a point cannot be linearised about.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinearizeError {
    /// The equations cannot be solved for the algebraic variables or the rates.
    #[error("the linearisation is singular: {part} cannot be solved for")]
    Singular {
        /// Name.
        part: &'static str,
    },
    /// An expression reads the past: no finite number of states describes it.
    #[error("`{delay}` has no finite linearisation: take a Padé approximation of it, of order 2 by `pade=2`")]
    Delay {
        /// The call.
        delay: String,
    },
    /// An expression cannot be differentiated.
    #[error("the linearisation cannot be formed: {message}")]
    Derivative {
        /// Message of the back end.
        message: String,
    },
}

/// Linearises an instance (its present actions, parameters, discrete variables) at the unknowns
/// `y`.
///
/// # Errors
/// When the algebraic equations are singular there.
pub fn linearize(system: &mut CompiledSystem, catalogue: &Catalogue, t: f64, y: &[f64]) -> Result<Linearization, LinearizeError> {
    if let Some(delay) = system.model().model().delays.first() {
        return Err(LinearizeError::Delay { delay: delay.name.clone() });
    }
    let (n, nx) = (system.model().unknowns(), system.model().states());
    let (yp, weights) = rates(system, t, y)?;
    let by_y = jacobian(system, t, y, &yp, 0.0);
    let (model, memory) = system.parts();
    let actions = catalogue.actions.len();
    let observations = model.interface().finish.observations.len();
    let mut derivative = |of, with, rows, columns| {
        let triplets = model.derivative(of, with, memory, t, (y, &yp));
        let triplets = triplets.map_err(|e| LinearizeError::Derivative { message: e.to_string() })?;
        let mut matrix = DMatrix::zeros(rows, columns);
        for (row, column, value) in triplets {
            matrix[(row, column)] += value;
        }
        Ok(matrix)
    };
    let reduction = &model.interface().reduction;
    let constraints: u32 = reduction.projected.iter().map(|one| one.count).sum();
    // Distances from constraints that corrections lead to have derivatives of these unknowns.
    let own: u32 = reduction.projected.iter().filter(|one| !one.corrected).map(|one| one.count).sum();
    let corrections = places_of_corrections(model);
    let bound: DMatrix<f64> = match constraints {
        0 => DMatrix::zeros(0, n),
        count => derivative(Derived::Constraints, WithRespectTo::Unknowns, 2 * count as usize, n)?,
    };
    let by_u: DMatrix<f64> = derivative(Derived::Rows, WithRespectTo::Actions, n, actions)?;
    let seen_y: DMatrix<f64> = derivative(Derived::Observations, WithRespectTo::Unknowns, observations, n)?;
    let seen_yp: DMatrix<f64> = derivative(Derived::Observations, WithRespectTo::Derivatives, observations, n)?;
    let seen_u: DMatrix<f64> = derivative(Derived::Observations, WithRespectTo::Actions, observations, actions)?;

    let Eliminated { a, b, zx, zu } = match weights.rows(nx, n - nx).iter().all(|weight| *weight == 0.0) {
        true => one_by_one(&weights.rows(0, nx).clone_owned(), &by_y, &by_u)?,
        false => together(&weights, &by_y, &by_u)?,
    };
    let c = seen_y.columns(0, nx) + seen_y.columns(nx, n - nx) * &zx + seen_yp.columns(0, nx) * &a;
    let d = seen_u + seen_y.columns(nx, n - nx) * zu + seen_yp.columns(0, nx) * &b;
    let mut found = outside(catalogue, &a, &b, &c, &d);
    if constraints > 0 {
        let (states, own) = (catalogue.states.elements(), own as usize);
        let scale = |at: usize| states.iter().find(|state| state.at == at).map_or(1.0, |state| state.scale.abs());
        let rows = own + corrections.len();
        let moved = DMatrix::from_fn(rows, nx, |i, j| match i.checked_sub(own) {
            None => bound[(2 * i, states[j].at)] * states[j].scale.abs(),
            Some(k) => zx[(corrections[k].1 - nx, states[j].at)] * states[j].scale.abs() / scale(corrections[k].0),
        });
        found.free = Some(free(moved, |j| states[j].scale.abs()));
    }
    Ok(found)
}

/// Places in `y` of states and of their corrections.
fn places_of_corrections(model: &CompiledModel) -> Vec<(usize, usize)> {
    let layout = model.layout();
    let pairs = model.interface().reduction.corrections.iter().filter_map(|one| {
        let (state, by) = (layout.offset(one.state)?, layout.offset(one.by)?);
        Some((0..layout.elements(one.state) as usize).map(move |i| (state + i, by + i)))
    });
    pairs.flatten().collect()
}

/// Free coordinates where `bound` times the states, each in its scale, is zero: by elimination, row
/// by row, with the largest entries as pivots.
fn free(mut bound: DMatrix<f64>, scale: impl Fn(usize) -> f64) -> Free {
    let (rows, columns) = bound.shape();
    let mut pivots: Vec<(usize, usize)> = Vec::new();
    for i in 0..rows {
        let j = bound.row(i).iamax_full().1;
        if bound[(i, j)].abs() <= DEPENDENT {
            continue;
        }
        let row = bound.row(i) / bound[(i, j)];
        for other in (0..rows).filter(|&other| other != i) {
            let factor = bound[(other, j)];
            if factor != 0.0 {
                bound.row_mut(other).zip_apply(&row, |x, y| *x -= factor * y);
            }
        }
        bound.row_mut(i).copy_from(&row);
        pivots.push((i, j));
    }
    let coordinates: Vec<usize> = (0..columns).filter(|j| pivots.iter().all(|(_, column)| column != j)).collect();
    let mut states = DMatrix::zeros(columns, coordinates.len());
    for (k, &j) in coordinates.iter().enumerate() {
        states[(j, k)] = 1.0;
        for &(row, column) in &pivots {
            states[(column, k)] = -bound[(row, j)] * scale(column) / scale(j);
        }
    }
    Free { coordinates, states }
}

/// Rates and algebraic unknowns in deviations: dx/dt = a x + b u, z = zx x + zu u.
struct Eliminated {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    zx: DMatrix<f64>,
    zu: DMatrix<f64>,
}

/// Algebraic unknowns from their equations, then rates from theirs.
fn one_by_one(weights: &DMatrix<f64>, by_y: &DMatrix<f64>, by_u: &DMatrix<f64>) -> Result<Eliminated, LinearizeError> {
    let (nx, nz) = (weights.nrows(), by_y.nrows() - weights.nrows());
    let (zx, zu) = if nz == 0 {
        (DMatrix::zeros(0, nx), DMatrix::zeros(0, by_u.ncols()))
    } else {
        let inverse = Inverse::new(&by_y.view((nx, nx), (nz, nz)).clone_owned());
        let mut inverse = inverse.ok_or(LinearizeError::Singular { part: "an algebraic variable" })?;
        (-inverse.solve_all(by_y.view((nx, 0), (nz, nx)).clone_owned()), -inverse.solve_all(by_u.rows(nx, nz).clone_owned()))
    };
    let rates_x = by_y.view((0, 0), (nx, nx)) + by_y.view((0, nx), (nx, nz)) * &zx;
    let rates_u = by_u.rows(0, nx) + by_y.view((0, nx), (nx, nz)) * &zu;
    let (a, b) = match weighing(weights)? {
        None => (rates_x, rates_u),
        Some(mut inverse) => (inverse.solve_all(rates_x), inverse.solve_all(rates_u)),
    };
    Ok(Eliminated { a, b, zx, zu })
}

/// Rates and algebraic unknowns from all equations, of which those of the latter read rates.
fn together(weights: &DMatrix<f64>, by_y: &DMatrix<f64>, by_u: &DMatrix<f64>) -> Result<Eliminated, LinearizeError> {
    let (n, nx) = weights.shape();
    let mut solved = by_y.clone();
    solved.columns_mut(0, nx).copy_from(&-weights);
    let mut inverse = Inverse::new(&solved).ok_or(LinearizeError::Singular { part: "a rate or an algebraic variable" })?;
    let (by_x, by_u) = (-inverse.solve_all(by_y.columns(0, nx).clone_owned()), -inverse.solve_all(by_u.clone()));
    Ok(Eliminated {
        a: by_x.rows(0, nx).clone_owned(),
        b: by_u.rows(0, nx).clone_owned(),
        zx: by_x.rows(nx, n - nx).clone_owned(),
        zu: by_u.rows(nx, n - nx).clone_owned(),
    })
}

/// Rates at the point, where the equations need not rest, and their weights in all equations there.
/// Newton's method on the equations of states finds them, since rates may appear in products and
/// powers. A correction by weights that are those of its result is exact.
fn rates(system: &mut CompiledSystem, t: f64, y: &[f64]) -> Result<(Vec<f64>, DMatrix<f64>), LinearizeError> {
    let (n, nx) = (system.model().unknowns(), system.model().states());
    let (mut yp, mut residual) = (vec![0.0; n], vec![0.0; n]);
    let mut weights = mass(system, t, y, &yp);
    for _ in 0..MOST_CORRECTIONS {
        system.residual(t, y, &yp, &mut residual);
        let mut change = DMatrix::from_column_slice(nx, 1, &residual[..nx]);
        if let Some(mut inverse) = weighing(&weights.rows(0, nx).clone_owned())? {
            change = inverse.solve_all(change);
        }
        yp.iter_mut().zip(change.iter()).for_each(|(rate, change)| *rate += change);
        let before = std::mem::replace(&mut weights, mass(system, t, y, &yp));
        // What is not a number does not get better.
        let differs = (&weights - &before).amax() > SETTLED * before.amax();
        if !differs {
            return Ok((yp, weights));
        }
    }
    Err(LinearizeError::Singular { part: "a rate" })
}

/// Rates at states that need not rest, with the algebraic unknowns that belong to them: by Newton's
/// method on all equations.
///
/// # Errors
/// When the equations cannot be solved for them.
pub(crate) fn rates_at(system: &mut CompiledSystem, y: &[f64]) -> Result<Vec<f64>, LinearizeError> {
    let (n, nx) = (system.model().unknowns(), system.model().states());
    let (mut y, mut yp, mut residual) = (y.to_vec(), vec![0.0; n], vec![0.0; n]);
    if system.is_explicit() {
        system.residual(0.0, &y, &yp, &mut residual);
        residual[nx..].fill(0.0);
        return Ok(residual);
    }
    for _ in 0..MOST_CORRECTIONS {
        system.residual(0.0, &y, &yp, &mut residual);
        let mut matrix = jacobian(system, 0.0, &y, &yp, 0.0);
        let weights = mass(system, 0.0, &y, &yp);
        matrix.columns_mut(0, nx).copy_from(&-weights);
        let mut inverse = Inverse::new(&matrix).ok_or(LinearizeError::Singular { part: "a rate" })?;
        let change = inverse.solve_all(-DMatrix::from_column_slice(n, 1, &residual));
        let mut moved = 0.0_f64;
        for (i, change) in change.iter().enumerate() {
            let value = if i < nx { &mut yp[i] } else { &mut y[i] };
            *value += change;
            moved = moved.max(change.abs() / value.abs().max(f64::MIN_POSITIVE));
        }
        let rest = change.iter().all(|change| change.abs() <= f64::EPSILON);
        if moved <= SETTLED || rest {
            return Ok(yp);
        }
    }
    Err(LinearizeError::Singular { part: "a rate" })
}

/// Solver of rates by their weights; `None` if these are the identity, as in an explicit model.
fn weighing(mass: &DMatrix<f64>) -> Result<Option<Inverse>, LinearizeError> {
    if mass.is_identity(0.0) {
        return Ok(None);
    }
    Inverse::new(mass).map(Some).ok_or(LinearizeError::Singular { part: "a rate" })
}

/// Weights of the rates of states in the equations; the Jacobian is affine in the weight of the
/// derivatives.
fn mass(system: &mut CompiledSystem, t: f64, y: &[f64], yp: &[f64]) -> DMatrix<f64> {
    let nx = system.model().states();
    (jacobian(system, t, y, yp, 0.0) - jacobian(system, t, y, yp, 1.0)).columns(0, nx).clone_owned()
}

/// The Jacobian as a full matrix.
fn jacobian(system: &mut CompiledSystem, t: f64, y: &[f64], yp: &[f64], cj: f64) -> DMatrix<f64> {
    let mut values = vec![0.0; system.pattern().entries()];
    system.jacobian(t, y, yp, cj, &mut values);
    let pattern = system.pattern();
    let mut matrix = DMatrix::zeros(y.len(), y.len());
    for column in 0..y.len() {
        for entry in pattern.column(column) {
            matrix[(pattern.rows()[entry], column)] = values[entry];
        }
    }
    matrix
}

/// From internal order to declaration order.
fn outside(catalogue: &Catalogue, a: &DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>, d: &DMatrix<f64>) -> Linearization {
    let x: Vec<usize> = catalogue.states.elements().iter().map(|e| e.at).collect();
    let u: Vec<usize> = catalogue.actions.elements().iter().map(|e| e.at).collect();
    let y: Vec<usize> = (0..c.nrows()).collect();
    let pick =
        |m: &DMatrix<f64>, rows: &[usize], columns: &[usize]| DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])]);
    Linearization { a: pick(a, &x, &x), b: pick(b, &x, &u), c: pick(c, &y, &x), d: pick(d, &y, &u), free: None }
}
