//! Programs: nests of loops that evaluate expressions and store them.

use serde::{Deserialize, Serialize};

use super::affine::Affine;
use super::expr::ExprId;
use super::var::VarId;

/// Nests executed in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Program {
    /// The nests.
    pub nests: Vec<Nest>,
    /// The program stores into what it reads (`y`, discrete variables): nothing loaded before a nest may be reused after it.
    pub in_place: bool,
}

/// A nest of loops: for all counters `l_d` in `0..extents[d]`, evaluate and store. Without extents: once. All values of one pass
/// are evaluated before the first of them is stored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Nest {
    /// Number of iterations of each loop, the outermost first.
    pub extents: Vec<u32>,
    /// What is stored.
    pub stores: Vec<Store>,
}

/// One store.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Store {
    /// Where to.
    pub target: Target,
    /// The value; a truth value is stored as 1 or 0.
    pub value: ExprId,
}

/// Destination of a store.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Which memory.
    pub place: Place,
    /// Which element.
    pub at: Affine,
}

/// Memory that a store goes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Place {
    /// The program's output vector.
    Out,
    /// The output vector at a position from a table of the model (slots of Jacobian entries): element `slots[at]`.
    OutSlots(u32),
    /// The present value of a variable: a state in `y`, others in the workspace.
    Var(VarId),
}
