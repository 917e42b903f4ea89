//! Components and their instances.

use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, Statement};

use crate::elaborate::lower::place::Place;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::ScopeId;
use crate::ir::{FastMap, FastSet};

/// Value of a parameter without one in a sample: many numbers divide it, and ranges up to it stay
/// loops.
pub(in crate::elaborate) const SAMPLE: f64 = 60.0;
/// Most instances in the samples of a model.
const MAX_SAMPLES: u32 = 500;
/// Deepest nest of components in a sample.
const MAX_SAMPLE_DEPTH: usize = 4;

/// Components and their instances.
#[derive(Default)]
pub(in crate::elaborate) struct Instances<'a> {
    /// Components by name with their declaring statement.
    pub components: FastMap<&'a str, &'a Statement>,
    /// Connectors, likewise.
    pub connectors: FastMap<&'a str, &'a Statement>,
    /// Items of every scope in the order of instances; the file first.
    pub blocks: Vec<(ScopeId, Vec<Item<'a>>)>,
    /// Components that are being instantiated, one inside another.
    pub open: Vec<&'a str>,
    /// Declarations made for instances so far.
    pub made: usize,
    /// Components that are arguments of instances, by the scope and the name of the parameter.
    pub types: FastMap<(ScopeId, &'a str), &'a Statement>,
    /// Components that have an instance.
    pub used: FastSet<&'a str>,
    /// Place of use of the component of each instance.
    pub used_at: FastMap<ScopeId, Span>,
    /// Arguments of instances.
    pub given: FastMap<(ScopeId, String), (&'a Expr, Place)>,
    /// Instances with arguments that their component does not have.
    pub misspelt: FastSet<ScopeId>,
    /// Components that stand for themselves.
    pub samples: Samples,
}

/// Components that stand for themselves.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Samples {
    /// True if this elaboration is one of samples, and how many instances it has.
    pub instances: Option<u32>,
}

impl Samples {
    /// Returns `true` if what is elaborated is a sample.
    pub(in crate::elaborate) fn taken(&self) -> bool {
        self.instances.is_some()
    }

    /// Counts an instance; `false` where a sample has enough of them.
    pub(in crate::elaborate) fn may_instantiate(&mut self, depth: usize) -> bool {
        self.instances.as_mut().is_none_or(|n| {
            *n += 1;
            *n <= MAX_SAMPLES && depth < MAX_SAMPLE_DEPTH
        })
    }
}
