//! Diagnosis of a model: structure, scaling, conditioning, the start, and a nominal episode.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::DMatrix;
use serde::Serialize;

use crate::catalogue::Element;
use crate::environment::{Environment, ResetError, ResetOptions, Start};
use crate::linearize::linearize;
use crate::setup::{Setup, SetupError};
use crate::solver::System;
use crate::spectrum::{DENSE, eigenvalues};
use crate::start::{self, Structure};

/// Unknowns up to which conditions and differences are computed: they need full matrices.
const MOST: usize = 1000;
/// Ratio of a size to its scale from which the scale is reported.
const FAR: f64 = 1e4;
/// Cosine of the angle between two scaled rows from which they are nearly parallel.
const PARALLEL: f64 = 1.0 - 1e-9;
/// Relative error of a Jacobian entry by differences from which it is reported.
const WRONG: f64 = 1e-3;
/// Part of its range within which a value is at a bound.
const AT_BOUND: f64 = 1e-6;

/// Findings about a model at its nominal start and along its nominal episode. Values are in
/// declared units.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Diagnosis {
    /// Number of states.
    pub states: usize,
    /// Number of algebraic variables that are solved for.
    pub algebraic: usize,
    /// Blocks of algebraic equations in the order of their solution.
    pub blocks: Vec<Block>,
    /// States that conditions at the start determine.
    pub freed: Vec<String>,
    /// Report of a start without a solution.
    pub start_failure: Option<String>,
    /// Condition number of the scaled Jacobian of the algebraic equations.
    pub condition: Option<f64>,
    /// States whose size in the episode is far from their scale.
    pub badly_scaled: Vec<Scaling>,
    /// Pairs of equations that are nearly parallel.
    pub parallel: Vec<(String, String)>,
    /// Variables at a bound at the start.
    pub at_bounds: Vec<String>,
    /// Eigenvalue with the smallest and with the largest size at the start: real and imaginary
    /// part.
    pub slowest: Option<(f64, f64)>,
    /// See [`slowest`](Self::slowest).
    pub fastest: Option<(f64, f64)>,
    /// Entries of the Jacobian that differences do not confirm.
    pub wrong_entries: Vec<String>,
    /// Events that do not happen in the nominal episode.
    pub silent_events: Vec<String>,
    /// Steps of the nominal episode, and its failure, empty without one.
    pub steps: u32,
    /// See [`steps`](Self::steps).
    pub failure: String,
}

/// A block of equations that are solved together.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Block {
    /// Number of unknowns.
    pub size: usize,
    /// The first unknowns by name.
    pub unknowns: Vec<String>,
}

/// A state whose size is far from its scale.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaling {
    /// Name.
    pub name: String,
    /// Scale, declared or derived from bounds.
    pub scale: f64,
    /// Largest size in the nominal episode.
    pub size: f64,
}

/// Diagnoses a model.
///
/// # Errors
/// Those of [`Environment::new`].
pub fn diagnose(setup: &Arc<Setup>) -> Result<Diagnosis, SetupError> {
    let mut environment = Environment::new(Arc::clone(setup))?;
    let model = setup.model();
    let mut out = Diagnosis { states: model.states(), algebraic: model.unknowns() - model.states(), ..Diagnosis::default() };
    out.freed = setup.determined_at_start().map(|(_, state)| state.name.clone()).collect();
    let nominal = ResetOptions { start: Start::Nominal, expected: true, ..ResetOptions::default() };
    let begun = environment.reset(Some(0), &nominal);
    let y = environment.unknowns().to_vec();
    out.structure(setup, &environment, &y);
    if let Err(error) = begun {
        out.start_failure = Some(match error {
            ResetError::Inconsistent { message, .. } => message,
            other => other.to_string(),
        });
        return Ok(out);
    }
    out.numbers(setup, &environment, &y);
    out.episode(setup, &mut environment);
    Ok(out)
}

fn element(setup: &Setup, at: usize) -> Option<&Element> {
    setup.catalogue.states.elements().iter().chain(setup.catalogue.solved.elements()).find(|e| e.at == at)
}

impl Diagnosis {
    /// Blocks of the algebraic equations.
    fn structure(&mut self, setup: &Setup, environment: &Environment, y: &[f64]) {
        const SHOWN: usize = 8;
        let mut system = setup.system.clone();
        system.restore(environment.memory().all());
        let context = start::Context { catalogue: &setup.catalogue, sources: setup.sources(), time: environment.time(), discretes: None };
        let Structure { blocks } = start::structure(&mut system, context, y);
        self.blocks = blocks
            .iter()
            .map(|places| Block {
                size: places.len(),
                unknowns: places.iter().take(SHOWN).filter_map(|&at| Some(element(setup, at)?.name.clone())).collect(),
            })
            .collect();
    }

    /// Findings at the start.
    fn numbers(&mut self, setup: &Setup, environment: &Environment, y: &[f64]) {
        let mut system = setup.system.clone();
        system.restore(environment.memory().all());
        let all = || setup.catalogue.states.elements().iter().chain(setup.catalogue.solved.elements());
        let is_at_bound = |e: &&Element| {
            let width = e.high - e.low;
            let width = if width.is_finite() { width } else { e.scale.abs() };
            (y[e.at] - e.low).min(e.high - y[e.at]) <= AT_BOUND * width
        };
        self.at_bounds = all().filter(is_at_bound).map(|e| e.name.clone()).collect();
        if y.len() > MOST {
            return;
        }
        if let Ok(linear) = linearize(&mut system, &setup.catalogue, environment.time(), y)
            && linear.a.nrows() <= DENSE
            && let Some(spectrum) = eigenvalues(&linear.minimal().a)
        {
            let size = |z: &&nalgebra::Complex<f64>| z.re.hypot(z.im);
            self.slowest = spectrum.values.iter().min_by(|a, b| size(a).total_cmp(&size(b))).map(|z| (z.re, z.im));
            self.fastest = spectrum.values.iter().max_by(|a, b| size(a).total_cmp(&size(b))).map(|z| (z.re, z.im));
        }
        let mut scales = vec![1.0; y.len()];
        all().filter(|e| e.scale.is_finite() && e.scale > 0.0).for_each(|e| scales[e.at] = e.scale);
        let t = environment.time();
        let jacobian = full_jacobian(&mut system, t, y);
        let first = self.states;
        let block = DMatrix::from_fn(y.len() - first, y.len() - first, |i, j| jacobian[(first + i, first + j)] * scales[first + j]);
        self.condition = condition(block.clone());
        let texts = |i: usize| crate::failure::describe_equation(first + i, setup.model(), &setup.catalogue, setup.sources());
        self.parallel = parallel(&block).into_iter().map(|(i, j)| (texts(i), texts(j))).collect();
        self.wrong_entries = wrong_entries(&mut system, (t, y), &jacobian, &scales)
            .into_iter()
            .map(|(row, column, exact, difference)| {
                let row = crate::failure::describe_equation(row, setup.model(), &setup.catalogue, setup.sources());
                let name = element(setup, column).map_or("", |e| e.name.as_str());
                format!("{row}, by {name}: {exact:.6e}, by differences {difference:.6e}")
            })
            .collect();
    }

    /// Findings along the nominal episode.
    fn episode(&mut self, setup: &Setup, environment: &mut Environment) {
        let action: Vec<f64> = setup.catalogue.actions.elements().iter().map(|e| e.default).collect();
        let roots = setup.model().roots_info();
        let mut happened: BTreeSet<usize> = BTreeSet::new();
        let mut sizes = vec![0.0_f64; environment.unknowns().len()];
        let mut note = |y: &[f64]| sizes.iter_mut().zip(y).for_each(|(size, y)| *size = size.max(y.abs()));
        note(environment.unknowns());
        while environment.is_running() {
            let Ok(result) = environment.step(&action) else { break };
            note(environment.unknowns());
            happened.extend(environment.happened());
            if result.failure.is_some() {
                self.failure = environment.failure_message();
            }
            if result.terminated || result.truncated {
                break;
            }
        }
        self.steps = environment.steps();
        let silent = roots.iter().enumerate().filter(|(i, root)| !root.name.is_empty() && !happened.contains(i));
        let named: BTreeSet<&str> = silent.map(|(_, root)| root.name.as_str()).collect();
        self.silent_events = named.into_iter().map(str::to_owned).collect();
        let far = |e: &&Element| {
            let ratio = sizes[e.at] / e.scale.abs();
            ratio > FAR || ratio > 0.0 && ratio < 1.0 / FAR
        };
        let states = setup.catalogue.states.elements().iter().filter(far);
        self.badly_scaled = states.map(|e| Scaling { name: e.name.clone(), scale: e.scale, size: sizes[e.at] }).collect();
    }
}

fn full_jacobian(system: &mut impl System, t: f64, y: &[f64]) -> DMatrix<f64> {
    let mut values = vec![0.0; system.pattern().entries()];
    system.jacobian(t, y, &vec![0.0; y.len()], 0.0, &mut values);
    let mut out = DMatrix::zeros(y.len(), y.len());
    let pattern = system.pattern();
    for column in 0..y.len() {
        pattern.column(column).for_each(|entry| out[(pattern.rows()[entry], column)] = values[entry]);
    }
    out
}

/// Condition number with rows scaled to their largest entries; `None` without rows or where an
/// entry is not finite.
fn condition(mut block: DMatrix<f64>) -> Option<f64> {
    if block.nrows() == 0 || block.iter().any(|x| !x.is_finite()) {
        return None;
    }
    for mut row in block.row_iter_mut() {
        let most = row.amax();
        if most > 0.0 {
            row /= most;
        }
    }
    let values = block.singular_values();
    let (most, least) = (values.max(), values.min());
    Some(if least > 0.0 { most / least } else { f64::INFINITY })
}

/// Pairs of rows whose directions differ by rounding only.
fn parallel(block: &DMatrix<f64>) -> Vec<(usize, usize)> {
    let rows: Vec<_> = block.row_iter().map(|row| row.transpose()).collect();
    let norms: Vec<f64> = rows.iter().map(|row| row.norm()).collect();
    let mut out = Vec::new();
    for i in 0..rows.len() {
        for j in i + 1..rows.len() {
            let product = norms[i] * norms[j];
            if product > 0.0 && (rows[i].dot(&rows[j]) / product).abs() >= PARALLEL {
                out.push((i, j));
            }
        }
    }
    out
}

/// Entries that central differences of the residual do not confirm: row, column, exact value,
/// difference.
fn wrong_entries(
    system: &mut impl System,
    (t, y): (f64, &[f64]),
    jacobian: &DMatrix<f64>,
    scales: &[f64],
) -> Vec<(usize, usize, f64, f64)> {
    let n = y.len();
    let (zero, mut above, mut below) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut point = y.to_vec();
    let mut out = Vec::new();
    for column in 0..n {
        let size = y[column].abs().max(scales[column]);
        let mut difference = |h: f64| {
            point[column] = y[column] + h;
            system.residual(t, &point, &zero, &mut above);
            point[column] = y[column] - h;
            system.residual(t, &point, &zero, &mut below);
            point[column] = y[column];
            above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * h)).collect::<Vec<f64>>()
        };
        // A kink nearby or rounding shows as two differences that disagree.
        let (wide, narrow) = (difference(1e-5 * size), difference(1e-6 * size));
        for row in 0..n {
            let exact = jacobian[(row, column)];
            let largest = jacobian.row(row).iter().zip(scales).fold(0.0_f64, |most, (x, s)| most.max((x * s).abs())) / scales[column];
            let off = |x: f64| (x - exact).abs() > WRONG * exact.abs().max(1e-3 * largest);
            let agree = (wide[row] - narrow[row]).abs() <= 0.1 * (wide[row] - exact).abs();
            if off(wide[row]) && off(narrow[row]) && agree {
                out.push((row, column, exact, narrow[row]));
            }
        }
    }
    out
}
