//! Fresh NumPy arrays, filled in place before Python sees them.

use numpy::ndarray::{Dimension, Ix1, Ix2, Ix3};
use numpy::{Element, PyArray, PyArrayMethods};
use pyo3::prelude::*;

/// A new array without other references, so that its elements may be written.
pub struct Fresh<'py, T, D>(Bound<'py, PyArray<T, D>>);

impl<'py, T: Element> Fresh<'py, T, Ix1> {
    /// A vector of zeros.
    pub fn vector(py: Python<'py>, len: usize) -> Self {
        Self(PyArray::zeros(py, [len], false))
    }
}

impl<'py, T: Element> Fresh<'py, T, Ix2> {
    /// A matrix of zeros in row order.
    pub fn matrix(py: Python<'py>, rows: usize, columns: usize) -> Self {
        Self(PyArray::zeros(py, [rows, columns], false))
    }
}

impl<'py, T: Element> Fresh<'py, T, Ix3> {
    /// A cube of zeros, the last index running fastest.
    pub fn cube(py: Python<'py>, shape: [usize; 3]) -> Self {
        Self(PyArray::zeros(py, shape, false))
    }
}

impl<'py, T: Element, D: Dimension> Fresh<'py, T, D> {
    /// All elements, row after row.
    pub fn elements(&mut self) -> &mut [T] {
        // SAFETY: the array was made by this type and has not left it, so this is the only access
        // to its memory; new arrays are contiguous.
        unsafe { self.0.as_slice_mut() }.unwrap_or_default()
    }

    /// Fills the array and gives it away.
    pub fn filled(mut self, fill: impl FnOnce(&mut [T])) -> Bound<'py, PyArray<T, D>> {
        fill(self.elements());
        self.0
    }

    /// Gives the array away.
    pub fn done(self) -> Bound<'py, PyArray<T, D>> {
        self.0
    }
}
