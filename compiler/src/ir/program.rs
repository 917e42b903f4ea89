//! Programs: nests of loops that evaluate expressions and store them.
//!
//! A [`Program`] is what the text of a model asks for, a [`Staged`](crate::schedule::Staged)
//! program what the back end makes of it; both are made of the same nests.

use serde::{Deserialize, Serialize};

use super::affine::Affine;
use super::expr::ExprId;
use super::var::VarId;

/// Nests executed in order; their counters are numbered by depth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Program {
    /// The nests.
    pub nests: Vec<Nest>,
    /// The program stores into what it reads (`y`, discrete variables): nothing loaded before a
    /// nest may be reused after it.
    pub in_place: bool,
}

/// A nest of loops: for all values of the counters, evaluate and store. Without loops: once. All
/// values of one pass are evaluated before the first of them is stored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Nest {
    /// Counter and number of iterations of each loop, the outermost first.
    pub loops: Vec<(u8, u32)>,
    /// Stored value.
    pub stores: Vec<Store>,
}

/// One store.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Store {
    /// Destination.
    pub target: Target,
    /// The value; a truth value is stored as 1 or 0.
    pub value: ExprId,
}

/// Destination of a store.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Memory.
    pub place: Place,
    /// Element.
    pub at: Affine,
}

/// Memory that a store goes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Place {
    /// The function's output vector.
    Out,
    /// The output vector at `tables[table + at] + plus`: entries of the Jacobian, in the back end
    /// only.
    Table {
        /// Start of the table among the tables of the compiled model.
        table: u32,
        /// Added to the entry.
        plus: Affine,
        /// Add to what is there instead of storing.
        add: bool,
    },
    /// The present value of a variable: a state in `y`, others in the workspace.
    Var(VarId),
}

impl Nest {
    /// Stores in loops of some extents, the outermost first; counters are numbered by depth.
    #[must_use]
    pub fn over(extents: impl IntoIterator<Item = u32>, stores: Vec<Store>) -> Nest {
        Nest { loops: (0..).zip(extents).collect(), stores }
    }

    /// Number of iterations of each loop, the outermost first.
    #[must_use]
    pub fn extents(&self) -> Vec<u32> {
        self.loops.iter().map(|&(_, extent)| extent).collect()
    }
}

impl Target {
    /// An element of the output.
    #[must_use]
    pub fn out(at: Affine) -> Target {
        Target { place: Place::Out, at }
    }

    /// An element of a variable.
    #[must_use]
    pub fn var(var: VarId, at: Affine) -> Target {
        Target { place: Place::Var(var), at }
    }
}
