//! Addresses of elements as functions of loop counters.

use serde::{Deserialize, Serialize};

/// Deepest nest of loops.
pub const MAX_DEPTH: usize = 6;

/// Extents of the loops around a value, by depth; none outside of them.
pub type Loops = [Option<u32>; MAX_DEPTH];

/// The loops of a nest.
#[must_use]
pub(crate) fn loops_of(extents: &[u32]) -> Loops {
    let mut loops = [None; MAX_DEPTH];
    loops.iter_mut().zip(extents).for_each(|(l, &extent)| *l = Some(extent));
    loops
}

/// Counter of the loop at a depth, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct LoopVar(pub u8);

/// Element of an array as an affine function of the loop counters: `offset + Σ strides[d]·l_d`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Affine {
    /// Constant part, in elements.
    pub offset: i64,
    /// Factor of each loop counter, in elements.
    pub strides: [i64; MAX_DEPTH],
}

impl Affine {
    /// The constant address.
    #[must_use]
    pub fn constant(offset: i64) -> Self {
        Affine { offset, strides: [0; MAX_DEPTH] }
    }

    /// `offset + stride·l_depth`
    #[must_use]
    pub fn along(offset: i64, depth: LoopVar, stride: i64) -> Self {
        let mut a = Self::constant(offset);
        a.strides[depth.0 as usize] = stride;
        a
    }

    /// Sum of two addresses.
    #[must_use]
    pub fn plus(self, other: Affine) -> Self {
        let mut a = self;
        a.offset += other.offset;
        for (s, o) in a.strides.iter_mut().zip(other.strides) {
            *s += o;
        }
        a
    }

    /// The address times a number.
    #[must_use]
    pub fn times(self, factor: i64) -> Self {
        Affine { offset: self.offset * factor, strides: self.strides.map(|s| s * factor) }
    }

    /// Returns `true` if no loop counter occurs.
    #[must_use]
    pub fn is_constant(&self) -> bool {
        self.strides == [0; MAX_DEPTH]
    }

    /// One more than the deepest loop that occurs; 0 for a constant.
    #[must_use]
    pub fn depth(&self) -> u8 {
        (0..MAX_DEPTH).rev().find(|&d| self.strides[d] != 0).map_or(0, |d| d as u8 + 1)
    }

    /// The lowest and the highest element over all passes; counters of no loop count as 0.
    #[must_use]
    pub fn reach(&self, loops: &Loops) -> (i64, i64) {
        let (mut low, mut high) = (self.offset, self.offset);
        for (&stride, extent) in self.strides.iter().zip(loops) {
            let way = stride * i64::from(extent.unwrap_or(1).max(1) - 1);
            low += way.min(0);
            high += way.max(0);
        }
        (low, high)
    }

    /// The address with a counter that begins `by` passes later.
    #[must_use]
    pub(crate) fn advanced(mut self, depth: usize, by: i64) -> Affine {
        self.offset += self.strides[depth] * by;
        self
    }

    /// The address in one pass of the loop at a depth.
    #[must_use]
    pub(crate) fn at_pass(mut self, depth: usize, pass: i64) -> Affine {
        self.offset += self.strides[depth] * pass;
        self.strides[depth] = 0;
        self
    }

    /// The counters that it depends on, by bit.
    #[must_use]
    pub fn counters(&self) -> u8 {
        (0..MAX_DEPTH).filter(|&d| self.strides[d] != 0).fold(0, |bits, d| bits | 1 << d)
    }

    /// The element at given counters.
    #[must_use]
    pub fn at(&self, counters: &[i64; MAX_DEPTH]) -> i64 {
        self.offset + self.strides.iter().zip(counters).map(|(s, c)| s * c).sum::<i64>()
    }
}
