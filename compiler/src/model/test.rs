//! Tests of a text as they are run: what is set, how far it goes, what is expected.

use smpl_dsl::span::Span;

use crate::ir::Role;

/// A test.
#[derive(Clone, Debug, PartialEq)]
pub struct Test {
    /// Its name.
    pub name: String,
    /// Place of its name.
    pub span: Span,
    /// Start of the episode: `sampled`, `nominal` or `steady`.
    pub start: String,
    /// Policy that chooses the actions that the test does not set.
    pub policy: String,
    /// Steps in the order of the text.
    pub steps: Vec<TestStep>,
}

/// A step of a test.
#[derive(Clone, Debug, PartialEq)]
pub enum TestStep {
    /// Elements of a variable get a value.
    Set {
        /// Kind of the variable.
        role: Role,
        /// Flattened names.
        names: Vec<String>,
        /// The value in the declared unit.
        value: f64,
        /// Place of the statement.
        span: Span,
    },
    /// So many control steps are taken.
    Run(u32),
    /// Something is expected.
    Expect {
        /// Place of the expectation.
        span: Span,
        /// The expectation.
        what: Expectation,
    },
}

/// An expectation. Numbers are places behind the declared outputs of the model, in the order of the
/// outputs of a model compiled with its tests.
#[derive(Clone, Debug, PartialEq)]
pub enum Expectation {
    /// The number is 1; NaN where the condition is unknown. Of a comparison, both sides and their
    /// unit.
    Holds {
        /// The condition.
        holds: usize,
        /// Left and right side, and their unit.
        sides: Option<(usize, usize, String)>,
    },
    /// A value lies within a tolerance of another one.
    Within {
        /// The value.
        value: usize,
        /// The tolerance.
        tolerance: usize,
        /// The expected value.
        target: usize,
        /// Unit of all three.
        unit: String,
    },
    /// The episode has ended in a failure, of that name.
    Failure(Option<String>),
    /// The episode has ended in a success, of that name.
    Success(Option<String>),
    /// The largest change of a state over a step at the present rate, relative to its scale, is at
    /// most a tolerance.
    Steady {
        /// The change.
        change: usize,
        /// The tolerance.
        tolerance: usize,
    },
}
