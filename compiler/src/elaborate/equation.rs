//! One equation over a nest of loops.

use smpl_dsl::span::Span;

use crate::ir::{Affine, ExprId, VarId};

/// An equation over a nest of loops.
#[derive(Clone, Debug)]
pub struct Equation {
    /// Extents of its loops.
    pub extents: Vec<u32>,
    /// Loops over numbers, by bit, which may be unrolled.
    pub runs: u8,
    /// The element of an algebraic variable that another equation defines as well.
    pub repeats: Option<(VarId, i64)>,
    /// Content.
    pub form: EquationForm,
    /// Place in the text.
    pub span: Span,
}

/// Forms of equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EquationForm {
    /// `d/dt var[at] = value`
    Rate {
        /// The state.
        var: VarId,
        /// Its element.
        at: Affine,
        /// The right side.
        value: ExprId,
    },
    /// `var[at] = value`, `var` algebraic
    Definition {
        /// The variable.
        var: VarId,
        /// Its element.
        at: Affine,
        /// The right side.
        value: ExprId,
    },
    /// `0 = residual`
    Implicit {
        /// Left side minus right side.
        residual: ExprId,
    },
}

impl EquationForm {
    /// The right side, or the residual.
    pub fn value(self) -> ExprId {
        match self {
            EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => value,
            EquationForm::Implicit { residual } => residual,
        }
    }
}
