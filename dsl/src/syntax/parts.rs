//! Parts of functions and of tests.

use serde::{Deserialize, Serialize};

use super::{Binder, Expr, Ident, UnitExpr};

/// A parameter of a function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name as written.
    pub name: Ident,
    /// Kind of its arguments.
    pub kind: ParameterKind,
}

/// Kinds of parameters of functions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ParameterKind {
    /// `T`: a value
    Value,
    /// `y[s]`: an array
    Array(Vec<Binder>),
    /// `i in species`: an index
    Index(Ident),
}

/// A name inside of a function: `let th : 1 = T / 300 [K]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Local {
    /// Name as written.
    pub name: Ident,
    /// Unit, where given.
    pub unit: Option<UnitExpr>,
    /// Its definition.
    pub value: Expr,
}

/// A statement of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the example of each kind names its fields")]
pub enum TestStep {
    /// `start nominal`
    Start(Ident),
    /// `scenario legacy`, `level online`, `variant NAME = OPTION` of the compilation
    Choose { word: Ident, name: Ident, option: Option<Ident> },
    /// `policy profile`
    Policy(Ident),
    /// `F = 1.2`: of an action, a parameter, a disturbance, a state or a discrete variable
    Assign { target: Expr, value: Expr },
    /// `steps 3`
    Steps(Expr),
    /// `for 40 [h]`
    For(Expr),
    /// `expect ...`
    Expect(Expect),
}

/// An expectation of a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the example of each kind names its fields")]
pub enum Expect {
    /// `expect x > 1`
    Holds(Expr),
    /// `expect x within 1e-6 of 6`
    Within { value: Expr, tolerance: Expr, target: Expr },
    /// `expect failure`, `expect failure overflow`
    Failure(Option<Ident>),
    /// `expect success`, `expect success finished`
    Success(Option<Ident>),
    /// `expect steady`, `expect steady within 1e-4`
    Steady(Option<Expr>),
}
