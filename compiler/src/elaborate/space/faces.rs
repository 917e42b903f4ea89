//! Face values of a flux while their directions are yet to be found.

use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;

use crate::elaborate::lower::loops::Face;
use crate::elaborate::lower::place::Place;
use crate::elaborate::space::interval::Interval;
use crate::elaborate::symbols::SymbolId;
use crate::ir::ExprId;

/// A face value that waits for its direction.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct FaceValue {
    pub symbol: SymbolId,
    pub index: Vec<Expr>,
    pub span: Span,
    pub face: Face,
    pub place: Place,
    /// The field in the cell below, or at the end, which distinguishes fields.
    pub beside: ExprId,
    pub mark: ExprId,
    pub range: Interval,
    /// An odd power of the time in its unit, as velocities and flows have it, and what they carry
    /// has not.
    pub odd: bool,
    /// Is the velocity in a call of `upwind`.
    pub velocity: bool,
    /// It is what a call of `upwind` carries, and comes from below where this holds.
    pub told: Option<ExprId>,
}

/// Data of the elaboration of a flux.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Fluxes {
    /// Face values of the flux that is being elaborated, where their directions are yet to be
    /// found.
    pub faces: Option<Vec<FaceValue>>,
    /// Face values are means of both cells: in a velocity.
    pub averaging: bool,
}
