//! Computations of a function of the back end: nests of loops, in stages.
//!
//! The front end writes [`Program`]s, whose nests follow one another. A [`Staged`] program is what
//! the back end makes of one, of the equations and of the entries of the Jacobian: what may share
//! loops and values is one stage.

use serde::{Deserialize, Serialize};

use crate::differentiate::Rows;
use crate::ir::{Affine, ExprId, Nest, Program, Store, Target};

/// A function to be interpreted or compiled.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Staged {
    /// Computations: nests of one stage share loops and values and may run in any order, stages run
    /// one after another.
    pub stages: Vec<Vec<Nest>>,
    /// It stores into what it reads.
    pub in_place: bool,
}

impl Staged {
    /// Nests of one stage.
    #[must_use]
    pub(crate) fn of_nests(nests: Vec<Nest>) -> Staged {
        let stages = if nests.is_empty() { vec![] } else { vec![nests] };
        Staged { stages, in_place: false }
    }

    /// A program: a stage each nest if it is in place, else one.
    #[must_use]
    pub fn of_program(program: &Program) -> Staged {
        let nests = program.nests.clone();
        let stages = if program.in_place { nests.into_iter().map(|nest| vec![nest]).collect() } else { vec![nests] };
        Staged { stages, in_place: program.in_place }
    }

    /// The residual of each row at its place in `y`.
    #[must_use]
    pub(crate) fn of_rows(rows: &[Rows]) -> Staged {
        let nest = |row: &Rows| Nest::over(row.extents.iter().copied(), vec![Store { target: Target::out(row.row), value: row.value }]);
        Staged { stages: vec![rows.iter().map(nest).collect()], in_place: false }
    }

    /// One number each, in order.
    #[must_use]
    pub(crate) fn of_numbers(values: impl IntoIterator<Item = ExprId>) -> Staged {
        let stores = (0..).zip(values).map(|(i, value)| Store { target: Target::out(Affine::constant(i)), value }).collect();
        Staged { stages: vec![vec![Nest { loops: vec![], stores }]], in_place: false }
    }

    /// Values over loops, each value's passes one after another, the last loop fastest.
    #[must_use]
    pub(crate) fn of_lists<L: AsRef<[(u8, u32)]>>(lists: impl IntoIterator<Item = (L, ExprId)>) -> Staged {
        let mut next = 0;
        let nest = |(loops, value): (L, ExprId)| {
            let loops = loops.as_ref().to_vec();
            let at = row_major(&loops).plus(Affine::constant(next));
            next += loops.iter().map(|&(_, extent)| i64::from(extent)).product::<i64>();
            Nest { loops, stores: vec![Store { target: Target::out(at), value }] }
        };
        Staged::of_nests(lists.into_iter().map(nest).collect())
    }

    /// Returns `true` if nothing is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stages.iter().flatten().all(|nest| nest.stores.is_empty())
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
