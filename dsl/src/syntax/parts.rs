//! Parts of functions and of tests.

use serde::{Deserialize, Serialize};

use super::{Binder, Expr, Ident, UnitExpr};

/// A declared port, or an array of ports.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PortName {
    /// Name as written.
    pub name: Ident,
    /// Indices of an array of ports.
    pub indices: Vec<Binder>,
}

/// A controller: its output follows the error at regular instants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Control {
    /// The discrete variable that it sets, or an element of one.
    pub output: Expr,
    /// `from y`: what it measures
    pub measured: Expr,
    /// `setpoint r`
    pub setpoint: Expr,
    /// `gain K`: change of the output per change of the error
    pub gain: Expr,
    /// `reset T`: time of the integral part; none without it
    pub reset: Option<Expr>,
    /// `limits a..b` of the output; its bounds where left out
    pub limits: Option<(Expr, Expr)>,
    /// `manual 50 when stopped`: a condition under which the output has this value, or is kept
    pub manual: Option<(Option<Expr>, Expr)>,
    /// `every 3 [s]`
    pub every: Expr,
    /// Indices of a controller for each of many outputs.
    pub binders: Vec<Binder>,
    /// Describing text.
    pub text: Option<String>,
}

impl Control {
    /// Its expressions, the output first.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let limits = self.limits.iter().flat_map(|(low, high)| [low, high]);
        let manual = self.manual.iter().flat_map(|(value, condition)| value.iter().chain([condition]));
        [&self.output, &self.measured, &self.setpoint, &self.gain]
            .into_iter()
            .chain(&self.reset)
            .chain(limits)
            .chain(manual)
            .chain([&self.every])
    }
}

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
