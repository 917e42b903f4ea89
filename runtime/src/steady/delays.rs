//! Delayed values at rest: they are the present ones, so that what is delayed moves the equations
//! at once.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::DMatrix;
use smpl_compiler::compiled::{Derived, WithRespectTo};
use smpl_compiler::ir::DELAY_SLOTS;

use super::error::SteadyError;
use crate::inverse::Inverse;
use crate::system::CompiledSystem;

/// Row, column, value.
type Triplet = (usize, usize, f64);

/// Derivatives of the equations by the unknowns and free actions in what is delayed.
pub(super) struct Delays {
    /// Row of each value, and the place in `y` that it is a derivative by; free actions follow the
    /// unknowns.
    pub places: Vec<(usize, usize)>,
    pub values: Vec<f64>,
    numbers: BTreeMap<(usize, usize), usize>,
}

/// Derivatives of the equations by delayed values, of what is delayed by unknowns and free actions,
/// and of what is delayed by delayed values.
struct Parts {
    rows: Vec<Triplet>,
    by_unknowns: Vec<Triplet>,
    nested: Vec<Triplet>,
}

impl Parts {
    fn at(system: &mut CompiledSystem, actions: &[usize], y: &[f64], zero: &[f64]) -> Result<Self, SteadyError> {
        system.look_back(0.0, y, zero);
        let (model, memory) = system.parts();
        let mut of = |of, by| {
            let found = model.derivative(of, by, memory, 0.0, (y, zero));
            found.map_err(|e| SteadyError::Condition { message: e.to_string() })
        };
        let slots = DELAY_SLOTS as usize;
        // The rate is zero and the time is the present one.
        let values = |triplets: Vec<Triplet>| -> Vec<Triplet> {
            triplets.into_iter().filter(|(_, column, _)| column % slots == 0).map(|(row, column, x)| (row, column / slots, x)).collect()
        };
        let mut by_unknowns = of(Derived::Delayed, WithRespectTo::Unknowns)?;
        if !actions.is_empty() {
            let place = |at| actions.iter().position(|&free| free == at).map(|i| y.len() + i);
            let by_actions = of(Derived::Delayed, WithRespectTo::Actions)?.into_iter();
            by_unknowns.extend(by_actions.filter_map(|(element, at, value)| Some((element, place(at)?, value))));
        }
        Ok(Self {
            rows: values(of(Derived::Rows, WithRespectTo::Delayed)?),
            by_unknowns,
            nested: values(of(Derived::Delayed, WithRespectTo::Delayed)?),
        })
    }

    /// Derivatives of what is delayed by unknowns, through what is delayed in it.
    fn total(&self, width: usize, unknowns: usize) -> Vec<BTreeMap<usize, f64>> {
        let mut own: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); width];
        for &(element, column, value) in &self.by_unknowns {
            *own[element].entry(column).or_default() += value;
        }
        if self.nested.is_empty() {
            return own;
        }
        let mut matrix = DMatrix::identity(width, width);
        self.nested.iter().for_each(|&(row, column, value)| matrix[(row, column)] -= value);
        let mut right = DMatrix::zeros(width, unknowns);
        own.iter().enumerate().for_each(|(row, own)| own.iter().for_each(|(&column, value)| right[(row, column)] = *value));
        let solved = Inverse::new(&matrix).map(|mut inverse| inverse.solve_all(right));
        let value = |row, column| solved.as_ref().map_or(f64::NAN, |solved| solved[(row, column)]);
        (0..width).map(|row| self.reach(row).into_iter().map(|column| (column, value(row, column))).collect()).collect()
    }

    fn reach(&self, element: usize) -> BTreeSet<usize> {
        reach(&self.by_unknowns, &self.nested, element)
    }
}

/// Unknowns that a delayed value depends on, through other ones too. Places of derivatives say what
/// reads unknowns, and what reads delayed values.
pub(crate) fn reach(by_unknowns: &[Triplet], nested: &[Triplet], element: usize) -> BTreeSet<usize> {
    let (mut open, mut seen) = (vec![element], BTreeSet::from([element]));
    let mut columns = BTreeSet::new();
    while let Some(element) = open.pop() {
        columns.extend(by_unknowns.iter().filter(|t| t.0 == element).map(|t| t.1));
        open.extend(nested.iter().filter(|t| t.0 == element).map(|t| t.1).filter(|&next| seen.insert(next)));
    }
    columns
}

impl Delays {
    /// `None` where nothing is delayed.
    ///
    /// # Errors
    /// If an equation cannot be differentiated.
    pub(super) fn new(system: &mut CompiledSystem, actions: &[usize], y: &[f64]) -> Result<Option<Self>, SteadyError> {
        let width = system.model().model().delayed();
        if width == 0 {
            return Ok(None);
        }
        let parts = Parts::at(system, actions, y, &vec![0.0; y.len()])?;
        let mut numbers = BTreeMap::new();
        for &(row, element, _) in &parts.rows {
            for column in parts.reach(element) {
                let next = numbers.len();
                numbers.entry((row, column)).or_insert(next);
            }
        }
        let mut places = vec![(0, 0); numbers.len()];
        numbers.iter().for_each(|(&place, &number)| places[number] = place);
        Ok(Some(Self { values: vec![0.0; places.len()], places, numbers }))
    }

    /// Evaluates the derivatives at `y`.
    pub(super) fn evaluate(&mut self, system: &mut CompiledSystem, actions: &[usize], y: &[f64], zero: &[f64]) {
        self.values.fill(0.0);
        // Differentiable when the search began, so now.
        let Ok(parts) = Parts::at(system, actions, y, zero) else { return };
        let total = parts.total(system.model().model().delayed(), y.len() + actions.len());
        for &(row, element, value) in &parts.rows {
            for (&column, derivative) in &total[element] {
                if let Some(&number) = self.numbers.get(&(row, column)) {
                    self.values[number] += value * derivative;
                }
            }
        }
    }
}
