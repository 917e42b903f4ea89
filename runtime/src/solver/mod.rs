//! Time integration of differential–algebraic systems, F(t, y, y') = 0.
//!
//! This layer knows nothing of the compiler: a model is anything that implements [`System`], and
//! stepping is behind the narrow trait [`Integrator`]. [`Ida`] implements it by SUNDIALS'
//! variable-order BDF code IDA, with
//!
//! * own vectors (`vector`, `kernels`), the same bits on every processor;
//! * own linear solvers (`linear`): dense LU for small systems, sparse LU of diagonal blocks for
//!   large ones;
//! * Newton's method in few passes over memory (`newton`);
//! * derivatives along directions that follow the unknowns in their own steps (`staggered`,
//!   `variational`);
//! * consistent initial conditions and a first step computed from the model's exact Jacobian
//!   (`consistent`);
//! * stops at the times where the equations change their form, and a look at what time moves inside
//!   of an interval (`forcing`);
//! * bounds of what an accepted step may hide from events and switches of the equations
//!   (`enclosure`, `inside`).
//!
//! A control step is a [`restart`](Integrator::restart) at the state and inputs of its beginning
//! and an [`advance`](Integrator::advance) to its end, which is hit exactly:
//!
//! ```
//! use smpl_runtime::solver::{Advance, Ida, Integrator, Settings, problems};
//!
//! let mut system = problems::robertson();
//! let settings = Settings::new(1e-6, vec![1e-10; 3]);
//! let mut ida = Ida::new(&system, settings)?;
//! ida.restart(&mut system, 0.0, &[1.0, 0.0, 0.0], None)?;
//! assert_eq!(ida.advance(&mut system, 40.0)?, Advance::Reached);
//! assert!((ida.state()[0] - 0.7158).abs() < 1e-4);
//! # Ok::<(), smpl_runtime::solver::SolveError>(())
//! ```
//!
//! Results depend only on the system, the settings and the integrations since the last
//! [`forget`](Integrator::forget), not on the thread, the processor's vector width or earlier work.

mod bounds;
mod callbacks;
mod choose;
mod consistent;
mod enclosure;
mod error;
mod forcing;
mod ida;
mod inside;
mod integrator;
mod kernels;
pub mod linear;
mod newton;
pub(crate) mod nodes;
pub(crate) mod nonnegative;
mod onestep;
pub mod problems;
mod quadrature;
mod resting;
mod safe;
mod settings;
mod staggered;
mod sundials;
mod system;
mod traverse;
mod variational;
mod vector;
mod watch;

pub use bounds::Bounds;
pub use choose::integrator;
pub use error::{IdaFlag, SolveError};
pub use ida::Ida;
pub(crate) use integrator::Absent;
pub use integrator::{Advance, Carried, Integrator, Statistics};
pub use linear::Method as LinearMethod;
pub use nodes::Nodes;
pub use onestep::OneStep;
pub use settings::{FirstStep, LinearSolver, Method, Quadratures, Settings};
pub(crate) use staggered::Staggered;
pub use system::{Following, Pattern, PatternError, RootKind, RootRole, System, Within};
pub use watch::Edge;
