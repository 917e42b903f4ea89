//! Long lists of numbers, stored separately from the nodes: points of long tables over time.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::FastMap;

/// Numbers of [`Lists`], one after another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct List {
    /// Position of the first one.
    pub first: u32,
    /// Number of them.
    pub len: u32,
}

impl List {
    /// Position of the numbers.
    #[must_use]
    pub fn range(self) -> Range<usize> {
        self.first as usize..self.first as usize + self.len as usize
    }
}

/// Limits that a number has passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Side {
    /// Those below it.
    #[serde(rename = "passed_below")]
    Below,
    /// Those below it, and the one that it is equal to.
    #[serde(rename = "passed_up_to")]
    UpTo,
}

/// All lists of a model, equal ones once.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    numbers: Vec<f64>,
    known: FastMap<Vec<u64>, u32>,
}

impl Lists {
    /// Lists that were written by [`Lists::all`].
    #[must_use]
    pub(crate) fn from_all(numbers: Vec<f64>) -> Lists {
        Lists { numbers, known: FastMap::default() }
    }

    /// The numbers of all lists.
    #[must_use]
    pub fn all(&self) -> &[f64] {
        &self.numbers
    }

    /// The numbers of a list; none where it reaches beyond the last one.
    #[must_use]
    pub fn of(&self, list: List) -> &[f64] {
        self.numbers.get(list.range()).unwrap_or_default()
    }

    /// Returns `true` if a list is one of these.
    #[must_use]
    pub fn has(&self, list: List) -> bool {
        list.len > 0 && list.range().end <= self.numbers.len()
    }

    /// A list of these numbers.
    pub fn add(&mut self, numbers: &[f64]) -> List {
        let len = numbers.len() as u32;
        let first = *self.known.entry(numbers.iter().map(|x| x.to_bits()).collect()).or_insert_with(|| {
            let first = self.numbers.len() as u32;
            self.numbers.extend(numbers);
            first
        });
        List { first, len }
    }

    /// A list of ascending limits. Negative infinity precedes it and infinity follows it, for
    /// [`before`] and [`behind`].
    pub(crate) fn add_limits(&mut self, limits: &[f64]) -> List {
        let mut between = Vec::with_capacity(limits.len() + 2);
        between.push(f64::NEG_INFINITY);
        between.extend(limits);
        between.push(f64::INFINITY);
        let List { first, len } = self.add(&between);
        List { first: first + 1, len: len - 2 }
    }
}

/// For each number of limits that have been left behind, the last of them.
#[must_use]
pub fn before(limits: List) -> List {
    List { first: limits.first - 1, len: limits.len + 1 }
}

/// For each number of limits that have been left behind, the first that has not.
#[must_use]
pub fn behind(limits: List) -> List {
    List { first: limits.first, len: limits.len + 1 }
}
