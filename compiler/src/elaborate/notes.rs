//! Notes of an elaboration for editors: units, values and sizes, also of a text with faults.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use smpl_dsl::span::Span;
use smpl_dsl::units::Unit;

use crate::model::Quantity;

/// A channel between an elaboration and an editor.
#[derive(Clone, Debug, Default)]
pub struct Observer {
    /// Set by the editor when the result is no longer needed: the elaboration then ends with a
    /// fault.
    pub cancelled: Arc<AtomicBool>,
    notes: Arc<Mutex<Notes>>,
}

/// Units, values and sizes, by the span of the declared name.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    /// Declared variables, once for each instance.
    pub quantities: Vec<(Span, Quantity)>,
    /// Units of named expressions, declared or derived.
    pub units: Vec<(Span, Unit)>,
    /// Numbers of cells of domains and numbers of members of sets.
    pub sizes: Vec<(Span, usize)>,
}

impl Observer {
    /// An observer with its own notes that is cancelled together with this one.
    #[must_use]
    pub fn apart(&self) -> Observer {
        Observer { cancelled: Arc::clone(&self.cancelled), ..Observer::default() }
    }

    /// Keeps the notes of the first pass; later passes read alternatives of the text.
    pub(super) fn write(&self, notes: Notes) {
        let mut kept = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.is_empty() {
            *kept = notes;
        }
    }

    /// The notes; leaves empty ones.
    #[must_use]
    pub fn take(&self) -> Notes {
        std::mem::take(&mut self.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Notes {
    /// Returns whether nothing was noted.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.quantities.is_empty() && self.units.is_empty() && self.sizes.is_empty()
    }
}
