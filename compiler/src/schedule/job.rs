//! What a function of the back end does: nests of loops with their counters, in stages.
//!
//! The front end writes [`Program`]s, whose counters are numbered by depth. A [`Job`] is what the back end makes of a program, of the
//! equations and of the entries of the Jacobian: its loops name their counters, and what may share loops and values is one stage.

use serde::{Deserialize, Serialize};

use crate::differentiate::Rows;
use crate::ir::{Affine, ExprId, Nest, Place, Program, VarId};

/// Stores inside a nest of loops.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Task {
    /// Counter and number of iterations of each loop, outermost first.
    pub loops: Vec<(u8, u32)>,
    /// What is stored where.
    pub stores: Vec<(Sink, ExprId)>,
}

/// Where a value goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Sink {
    /// Element of the output.
    Out(Affine),
    /// Element of the output at `tables[table + index] + plus`; added to what is there if so marked.
    Table {
        /// Start of the table.
        table: u32,
        /// Entry of the table.
        index: Affine,
        /// Added to the entry.
        plus: Affine,
        /// Add instead of store.
        add: bool,
    },
    /// Element of a variable.
    Var(VarId, Affine),
}

/// A function to be interpreted or compiled.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Job {
    /// What it does: tasks of one stage share loops and values and may run in any order, stages run one after another.
    pub stages: Vec<Vec<Task>>,
    /// It stores into what it reads.
    pub in_place: bool,
}

impl Task {
    /// A nest of loops of a program; table numbers of `Place::OutSlots` are turned into starts.
    fn of_nest(nest: &Nest, starts: &[u32]) -> Task {
        let sink = |place: Place, at: Affine| match place {
            Place::Out => Sink::Out(at),
            Place::OutSlots(table) => {
                let table = starts.get(table as usize).copied().unwrap_or_default();
                Sink::Table { table, index: at, plus: Affine::default(), add: false }
            }
            Place::Var(var) => Sink::Var(var, at),
        };
        Task {
            loops: (0..).zip(nest.extents.iter().copied()).collect(),
            stores: nest.stores.iter().map(|s| (sink(s.target.place, s.target.at), s.value)).collect(),
        }
    }
}

impl Job {
    /// Tasks of one stage.
    #[must_use]
    pub(crate) fn of_tasks(tasks: Vec<Task>) -> Job {
        let stages = if tasks.is_empty() { vec![] } else { vec![tasks] };
        Job { stages, in_place: false }
    }

    /// A program; `slots` are the model's position tables, which stand one after another in the tables of the compiled model.
    #[must_use]
    pub fn of_program(program: &Program, slots: &[Vec<u32>]) -> Job {
        let starts: Vec<u32> = slots.iter().scan(0, |next, slots| Some(std::mem::replace(next, *next + slots.len() as u32))).collect();
        let tasks = program.nests.iter().map(|nest| Task::of_nest(nest, &starts));
        let stages = if program.in_place { tasks.map(|t| vec![t]).collect() } else { vec![tasks.collect()] };
        Job { stages, in_place: program.in_place }
    }

    /// The residual of each row at its place in `y`.
    #[must_use]
    pub(crate) fn of_rows(rows: &[Rows]) -> Job {
        let task =
            |row: &Rows| Task { loops: (0..).zip(row.extents.iter().copied()).collect(), stores: vec![(Sink::Out(row.row), row.value)] };
        Job { stages: vec![rows.iter().map(task).collect()], in_place: false }
    }

    /// One number each, in order.
    #[must_use]
    pub(crate) fn of_numbers(values: impl IntoIterator<Item = ExprId>) -> Job {
        let stores = (0..).zip(values).map(|(i, value)| (Sink::Out(Affine::constant(i)), value)).collect();
        Job { stages: vec![vec![Task { loops: vec![], stores }]], in_place: false }
    }

    /// Values over loops, each value's passes one after another, the last loop fastest.
    #[must_use]
    pub(crate) fn of_lists<L: AsRef<[(u8, u32)]>>(lists: impl IntoIterator<Item = (L, ExprId)>) -> Job {
        let mut next = 0;
        let task = |(loops, value): (L, ExprId)| {
            let loops = loops.as_ref().to_vec();
            let at = row_major(&loops).plus(Affine::constant(next));
            next += loops.iter().map(|&(_, extent)| i64::from(extent)).product::<i64>();
            Task { loops, stores: vec![(Sink::Out(at), value)] }
        };
        Job::of_tasks(lists.into_iter().map(task).collect())
    }

    /// Whether nothing is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stages.iter().flatten().all(|t| t.stores.is_empty())
    }
}

/// Number of an iteration as a function of the counters.
#[must_use]
pub(crate) fn row_major(loops: &[(u8, u32)]) -> Affine {
    let mut at = Affine::default();
    let mut stride = 1;
    for &(counter, extent) in loops.iter().rev() {
        at.strides[counter as usize] = stride;
        stride *= i64::from(extent);
    }
    at
}
