//! The indexed intermediate representation: what a model means, free of text, units and names.
//!
//! Everything is a directed acyclic graph of scalar nodes in one arena, [`Exprs`]; equal nodes are
//! one node. A node may depend on *loop variables*: [`LoopVar`] `d` is the counter of the loop at
//! depth `d`, always running from 0 to an extent that the surrounding [`Nest`] fixes. `c[z-1]` over
//! the cells 2..40 is a load at `offset + 1·l0` in a nest of extent 39, so arrays stay loops and
//! equations over equal extents share nodes. Members of enumerated sets are constants of an
//! address.
//!
//! A [`Program`] is a list of nests executed in order; each evaluates expressions and stores them.
//! Programs are what the back end compiles and what the interpreter runs.

mod affine;
mod build;
mod elementary;
mod expr;
mod frames;
mod function;
mod loads;
mod numbers;
mod program;
mod var;
mod walk;

pub(crate) use affine::loops_of;
pub use affine::{Affine, LoopVar, Loops, MAX_DEPTH};
pub(crate) use build::Rewritten;
pub use elementary::UnaryFn;
pub(crate) use elementary::{Arithmetic, Slope, slope};
pub use expr::{Expr, ExprId, Exprs, Flavour};
pub(crate) use frames::Unframed;
pub use function::{BinaryFn, Compare, ReduceFn};
pub use numbers::{List, Lists, Side, before, behind};
pub use program::{Nest, Place, Program, Store, Target};
pub use rustc_hash::{FxHashMap as FastMap, FxHashSet as FastSet};
pub use var::{BUILTIN_COUNT, Builtin, DELAY_SLOTS, DelaySlot, Role, VarId};
