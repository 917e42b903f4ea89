//! Programs as they are put together: single stores first, together, then the loops.

use crate::elaborate::episode::common::store;
use crate::ir::{Affine, ExprId, Nest, Place as Memory, Program, Store};

/// A program under construction.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Assembly {
    /// Stores outside of loops.
    pub single: Vec<Store>,
    /// Nests of loops, and what must come after the single stores.
    pub nests: Vec<Nest>,
}

impl Assembly {
    /// Adds a store in loops, if there are any.
    pub(in crate::elaborate) fn push(&mut self, extents: Vec<u32>, store: Store) {
        if extents.is_empty() {
            self.single.push(store);
        } else {
            self.nests.push(Nest::over(extents, vec![store]));
        }
    }

    /// Adds numbers of the output, from its start on.
    pub(in crate::elaborate) fn of_numbers(values: impl IntoIterator<Item = ExprId>) -> Assembly {
        let single = (0..).zip(values).map(|(i, value)| store(Memory::Out, Affine::constant(i), value)).collect();
        Assembly { single, nests: Vec::new() }
    }

    /// Adds nests of the output that begin after what is there.
    pub(in crate::elaborate) fn append(&mut self, nests: Vec<Nest>, base: i64) {
        for Nest { loops, stores } in nests {
            let moved = stores.into_iter().map(|mut s| {
                s.target.at.offset += base;
                s
            });
            if loops.is_empty() {
                self.single.extend(moved);
            } else {
                self.nests.push(Nest { loops, stores: moved.collect() });
            }
        }
    }

    /// The single stores as one nest, ahead of the others.
    pub(in crate::elaborate) fn gathered(self) -> Vec<Nest> {
        let mut nests = vec![Nest { loops: Vec::new(), stores: self.single }];
        nests.extend(self.nests);
        nests
    }

    /// The program.
    pub(in crate::elaborate) fn program(self) -> Program {
        Program { nests: self.gathered(), in_place: false }
    }
}
