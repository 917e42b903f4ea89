//! The rows of a simulation, in the columns of the interface contract.

use super::{Cell, ColumnType, Table};
use crate::environment::{Environment, StepResult};

/// Collects an episode: row 0 is the initial state, every other row the end of a step.
#[derive(Clone, Debug)]
pub struct Recorder {
    table: Table,
    states: Vec<f64>,
    algebraics: Vec<f64>,
    observations: Vec<f64>,
    /// Places of the parameters that are drawn: the last columns, so that those before keep their
    /// places.
    drawn: Vec<usize>,
}

impl Recorder {
    /// Columns for an environment.
    #[must_use]
    pub fn new(environment: &Environment) -> Self {
        let catalogue = environment.catalogue();
        let interface = environment.setup().model().interface();
        let mut columns = vec![("step".to_owned(), ColumnType::Integer), ("time".to_owned(), ColumnType::Number)];
        let families = [&catalogue.states, &catalogue.algebraics, &catalogue.discretes, &catalogue.disturbances, &catalogue.actions];
        let names = families.iter().flat_map(|family| family.names());
        columns.extend(names.map(|name| (name.to_owned(), ColumnType::Number)));
        columns.extend(interface.finish.observations.iter().map(|o| (format!("obs.{}", o.name), ColumnType::Number)));
        columns.push(("reward".to_owned(), ColumnType::Number));
        columns.extend(interface.finish.rewards.iter().map(|r| (format!("reward.{}", r.name), ColumnType::Number)));
        columns.extend(["terminated", "truncated"].map(|name| (name.to_owned(), ColumnType::Flag)));
        let drawn = environment.setup().drawn_parameters();
        columns.extend(drawn.iter().map(|e| (format!("param.{}", e.name), ColumnType::Number)));
        Self {
            states: vec![0.0; catalogue.states.len()],
            algebraics: vec![0.0; catalogue.algebraics.len()],
            observations: vec![0.0; interface.finish.observations.len()],
            drawn: drawn.iter().map(|e| e.at).collect(),
            table: Table::new(columns),
        }
    }

    /// Adds the present point of an episode; `result` is that of the step that led there, `None`
    /// for row 0.
    pub fn record(&mut self, environment: &mut Environment, result: Option<&StepResult>) {
        environment.state(&mut self.states);
        environment.algebraics(&mut self.algebraics);
        environment.observe(false, &mut self.observations);
        let catalogue = environment.catalogue();
        let placed =
            |family: &crate::catalogue::Family, values: &[f64]| -> Vec<f64> { family.elements().iter().map(|e| values[e.at]).collect() };
        let discretes = placed(&catalogue.discretes, environment.discretes());
        let disturbances = placed(&catalogue.disturbances, environment.disturbances());
        let actions = placed(&catalogue.actions, environment.actions());
        let only_after_a_step = |x: &f64| {
            if result.is_some() { Cell::Number(*x) } else { Cell::Empty }
        };
        let mut row = vec![Cell::Integer(i64::from(environment.steps())), Cell::Number(environment.time())];
        let present = [&self.states, &self.algebraics, &discretes, &disturbances];
        row.extend(present.into_iter().flatten().map(|x| Cell::Number(*x)));
        row.extend(actions.iter().map(only_after_a_step));
        let readings = self.observations.iter().zip(environment.missing_readings());
        row.extend(readings.map(|(x, &missing)| Cell::Number(if missing { f64::NAN } else { *x })));
        row.push(result.map_or(Cell::Empty, |r| Cell::Number(r.reward)));
        row.extend(environment.rewards().iter().map(only_after_a_step));
        row.push(Cell::Flag(result.is_some_and(|r| r.terminated)));
        row.push(Cell::Flag(result.is_some_and(|r| r.truncated)));
        row.extend(self.drawn.iter().map(|&at| Cell::Number(environment.parameters()[at])));
        self.table.push(row);
    }

    /// Leaves the first rows alone, as after a return to an earlier point.
    pub fn truncate(&mut self, rows: usize) {
        self.table.truncate(rows);
    }

    /// The table so far.
    #[must_use]
    pub fn table(&self) -> &Table {
        &self.table
    }
}
