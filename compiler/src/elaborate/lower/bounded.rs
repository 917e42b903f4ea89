//! Bounded quantities.

use crate::elaborate::lower::loops::Piece;
use crate::ir::{Affine, ExprId};
use crate::model::BoxItem;

/// Content of a box: one number, or the elements of an array.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct Bounded {
    /// Name, unit and bounds of each element.
    pub items: Vec<BoxItem>,
    /// Elements and their values, in loops.
    pub pieces: Vec<Piece<(Affine, ExprId)>>,
}

impl Bounded {
    /// One number.
    pub(in crate::elaborate) fn one(item: BoxItem, value: ExprId) -> Bounded {
        Bounded { items: vec![item], pieces: vec![Piece { extents: Vec::new(), value: (Affine::default(), value) }] }
    }

    pub(in crate::elaborate) fn has_loops(&self) -> bool {
        self.pieces.iter().any(|piece| !piece.extents.is_empty())
    }
}
