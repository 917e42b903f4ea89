//! The equations of a start: algebraic rows and conditions, in algebraic unknowns and freed states.

use smpl_compiler::compiled::{Derived, Triplet, WithRespectTo};
use smpl_compiler::ir::DELAY_SLOTS;
use smpl_compiler::layout::Region;
use smpl_compiler::model::StartCondition;
use smpl_dsl::span::Span;

use super::{Context, Sought};
use crate::catalogue::Element;
use crate::failure::{describe_equation, row_of};
use crate::solver::{Bounds, System};
use crate::steady::delays;
use crate::system::CompiledSystem;

/// An equation of a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Row {
    /// That of an algebraic unknown, by its place in `y`.
    Equation(usize),
    /// A condition at the start, by number.
    Condition(usize),
}

/// The equations, with working memory.
pub(super) struct Problem<'a> {
    system: &'a mut CompiledSystem,
    pub context: Context<'a>,
    /// Places in `y` of the unknowns.
    pub places: Vec<usize>,
    pub rows: Vec<Row>,
    pub bounds: Bounds,
    /// Size of each unknown of `y`.
    pub scales: Vec<f64>,
    /// Entries of the Jacobian of the equations that are those of unknowns: row, column, entry.
    entries: Vec<(usize, usize, usize)>,
    /// Row of each condition.
    row_of: Vec<Option<usize>>,
    /// Column of each place in `y`.
    column_of: Vec<Option<usize>>,
    zero: Vec<f64>,
    residual: Vec<f64>,
    values: Vec<f64>,
    missed: Vec<f64>,
    /// The equations at the last point.
    pub out: Vec<f64>,
    /// The Jacobian is one of differences, with what acts through other instants.
    pub by_differences: bool,
}

/// Difference of an unknown, relative to its size, for derivatives by differences.
const DIFFERENCE: f64 = 1e-7;

impl<'a> Problem<'a> {
    pub(super) fn new(system: &'a mut CompiledSystem, context: Context<'a>, sought: Sought<'_>, y: &[f64]) -> Self {
        let n = y.len();
        let first = system.model().states();
        let places: Vec<usize> = (first..n).chain(sought.states.iter().copied()).collect();
        let rows: Vec<Row> = (first..n).map(Row::Equation).chain(sought.conditions.iter().map(|&k| Row::Condition(k))).collect();
        let mut column_of = vec![None; n];
        places.iter().enumerate().for_each(|(column, &at)| column_of[at] = Some(column));
        let conditions = system.model().interface().start_conditions.iter().map(|c| c.count as usize).sum();
        let mut row_of = vec![None; conditions];
        sought.conditions.iter().enumerate().for_each(|(i, &k)| row_of[k] = Some(n - first + i));
        let pattern = system.pattern();
        let own = |column: usize| pattern.column(places[column]).map(move |entry| (column, entry));
        let entries = (0..places.len()).flat_map(own);
        let entries = entries.filter(|&(_, entry)| pattern.rows()[entry] >= first);
        let entries: Vec<_> = entries.map(|(column, entry)| (pattern.rows()[entry] - first, column, entry)).collect();
        let catalogue = context.catalogue;
        let elements = || catalogue.states.elements().iter().chain(catalogue.solved.elements());
        let mut scales = vec![1.0; n];
        for element in elements().filter(|e| e.scale.is_finite() && e.scale > 0.0) {
            scales[element.at] = element.scale;
        }
        Self {
            values: vec![0.0; pattern.entries()],
            out: vec![0.0; rows.len()],
            by_differences: false,
            bounds: Bounds::new(elements(), n),
            zero: vec![0.0; n],
            residual: vec![0.0; n],
            missed: vec![0.0; conditions],
            system,
            context,
            places,
            rows,
            scales,
            entries,
            row_of,
            column_of,
        }
    }

    /// Number of equations, and of unknowns.
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns whether unknowns act through delayed, sampled and first values, or through discrete
    /// variables.
    pub(super) fn acts_through_instants(&self) -> bool {
        self.system.reads_other_instants() || self.system.looks_back() || self.context.discretes.is_some()
    }

    /// Columns of the unknowns that may occur in each row; the first one of an algebraic row is its
    /// own.
    pub(super) fn incidence(&mut self) -> Vec<Vec<usize>> {
        let mut out: Vec<Vec<usize>> = vec![Vec::new(); self.rows.len()];
        let algebraic = self.rows.iter().filter(|row| matches!(row, Row::Equation(_))).count();
        (0..algebraic).for_each(|row| out[row].push(row));
        for &(row, column, _) in &self.entries {
            if !out[row].contains(&column) {
                out[row].push(column);
            }
        }
        let y = vec![0.0; self.zero.len()];
        let places = self.gradient(&y).into_iter().map(|(row, column, _)| (row, column));
        for (row, column) in places.chain(self.through_delays(&y)) {
            if !out[row].contains(&column) {
                out[row].push(column);
            }
        }
        out
    }

    /// Row and column of the unknowns that act through delayed values, which are the present ones.
    fn through_delays(&mut self, y: &[f64]) -> Vec<(usize, usize)> {
        if !self.system.looks_back() {
            return Vec::new();
        }
        let first = self.system.model().states();
        let (model, memory) = self.system.parts();
        let mut of = |of, by| model.derivative(of, by, memory, self.context.time, (y, &self.zero)).unwrap_or_default();
        let by_element = |places: Vec<Triplet>| places.into_iter().map(|(row, slot, x)| (row, slot / DELAY_SLOTS as usize, x));
        let by_unknowns = of(Derived::Delayed, WithRespectTo::Unknowns);
        let nested: Vec<_> = by_element(of(Derived::Delayed, WithRespectTo::Delayed)).collect();
        let rows = by_element(of(Derived::Rows, WithRespectTo::Delayed)).filter_map(|(row, of, _)| Some((row.checked_sub(first)?, of)));
        let conditions = of(Derived::StartConditions, WithRespectTo::Delayed);
        let conditions = by_element(conditions).filter_map(|(k, of, _)| Some((self.row_of[k]?, of)));
        let mut found = Vec::new();
        for (row, element) in rows.chain(conditions).collect::<Vec<_>>() {
            let columns = delays::reach(&by_unknowns, &nested, element).into_iter().filter_map(|at| self.column_of[at]);
            found.extend(columns.map(|column| (row, column)));
        }
        found
    }

    /// Derivatives of the conditions by the unknowns: row, column, value.
    fn gradient(&mut self, y: &[f64]) -> Vec<(usize, usize, f64)> {
        if self.row_of.iter().all(Option::is_none) {
            return Vec::new();
        }
        let (model, memory) = self.system.parts();
        let found = model.derivative(Derived::StartConditions, WithRespectTo::Unknowns, memory, self.context.time, (y, &self.zero));
        let places = found.unwrap_or_default().into_iter();
        places.filter_map(|(k, at, value)| Some((self.row_of[k]?, self.column_of[at]?, value))).collect()
    }

    /// Evaluates all equations at `y` into `out`.
    pub(super) fn evaluate(&mut self, y: &[f64]) {
        self.take_instant(y);
        let time = self.context.time;
        self.system.residual(time, y, &self.zero, &mut self.residual);
        if !self.missed.is_empty() {
            let (model, memory) = self.system.parts();
            model.start_conditions(memory, time, &mut y.to_vec(), &mut self.missed);
        }
        for (out, row) in self.out.iter_mut().zip(&self.rows) {
            *out = match *row {
                Row::Equation(at) => self.residual[at],
                Row::Condition(k) => self.missed[k],
            };
        }
    }

    /// The entries of the Jacobian at `y`: row, column, value; a place may occur several times.
    pub(super) fn jacobian(&mut self, y: &[f64]) -> Vec<(usize, usize, f64)> {
        if self.by_differences {
            return self.differences(y);
        }
        self.take_instant(y);
        self.system.jacobian(self.context.time, y, &self.zero, 0.0, &mut self.values);
        let mut out: Vec<_> = self.entries.iter().map(|&(row, column, entry)| (row, column, self.values[entry])).collect();
        out.extend(self.gradient(y));
        out
    }

    /// All entries of the Jacobian by differences.
    fn differences(&mut self, y: &[f64]) -> Vec<(usize, usize, f64)> {
        self.evaluate(y);
        let base = self.out.clone();
        let mut moved = y.to_vec();
        let mut entries = Vec::with_capacity(base.len() * self.places.len());
        for column in 0..self.places.len() {
            let at = self.places[column];
            let step = DIFFERENCE * y[at].abs().max(self.scales[at]);
            moved[at] = if y[at] + step > self.bounds.high[at] { y[at] - step } else { y[at] + step };
            self.evaluate(&moved);
            let step = moved[at] - y[at];
            entries.extend(self.out.iter().zip(&base).enumerate().map(|(row, (new, old))| (row, column, (new - old) / step)));
            moved[at] = y[at];
        }
        self.evaluate(y);
        entries
    }

    /// The start of the episode and the end of the step before are the point itself, and discrete
    /// variables are what they are there.
    fn take_instant(&mut self, y: &[f64]) {
        if self.system.reads_other_instants() {
            self.system.keep(y, Region::Initial);
            self.system.keep(y, Region::Previous);
        }
        if let Some(given) = self.context.discretes {
            self.system.look_back(self.context.time, y, &self.zero);
            let (model, memory) = self.system.parts();
            model.initial_discretes(memory, &mut y.to_vec());
            let discretes = self.system.region_mut(Region::Discrete);
            given.iter().for_each(|&(at, value)| discretes[at] = value);
        }
        if self.system.reads_other_instants() || self.context.discretes.is_some() {
            let (model, memory) = self.system.parts();
            model.prepare_step(memory);
        }
    }

    /// The state or variable at a place of `y`.
    pub(super) fn element(&self, at: usize) -> Option<&Element> {
        let catalogue = self.context.catalogue;
        catalogue.states.elements().iter().chain(catalogue.solved.elements()).find(|e| e.at == at)
    }

    /// An equation in words: `equation at flash.eq:12, z`.
    pub(super) fn describe(&self, row: usize) -> String {
        match self.rows[row] {
            Row::Equation(at) => describe_equation(at, self.system.model(), self.context.catalogue, self.context.sources),
            Row::Condition(k) => condition_text(self.system, k, self.context.sources),
        }
    }

    /// Place of an equation or a condition in the text.
    pub(super) fn place(&self, row: usize) -> Option<Span> {
        let span = match self.rows[row] {
            Row::Equation(at) => row_of(at, self.system.model())?.span,
            Row::Condition(k) => condition(self.system, k)?.span,
        };
        (span.end > 0).then_some(span)
    }
}

/// The condition with a number.
fn condition(system: &CompiledSystem, number: usize) -> Option<&StartCondition> {
    let mut first = 0;
    system.model().interface().start_conditions.iter().find(|c| {
        first += c.count as usize;
        number < first
    })
}

/// A condition in words: `condition at flash.eq:20`.
pub(super) fn condition_text(system: &CompiledSystem, number: usize, sources: Option<&smpl_dsl::diagnostic::SourceMap>) -> String {
    match (condition(system, number), sources) {
        (Some(found), Some(sources)) if found.span.end > 0 => {
            format!("condition at {}:{}", sources.name(found.span.file), sources.locate(found.span).line)
        }
        _ => format!("condition {} at the start", number + 1),
    }
}
