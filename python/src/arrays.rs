//! Fresh NumPy arrays, filled in place.

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

/// A new vector of `len` zeros, filled by `fill`.
pub fn vector<'py, T: Element + Copy>(
    py: Python<'py>,
    len: usize,
    fill: impl FnOnce(&mut [T]),
) -> Bound<'py, PyArray1<T>> {
    let array = PyArray1::<T>::zeros(py, [len], false);
    // SAFETY: the array was just made; nobody else has a reference to it or to its memory.
    if let Ok(slice) = unsafe { array.as_slice_mut() } {
        fill(slice);
    }
    array
}

/// A new matrix of zeros in row order, and its elements.
pub fn matrix<'py, T: Element + Copy>(
    py: Python<'py>,
    rows: usize,
    columns: usize,
) -> Bound<'py, PyArray2<T>> {
    PyArray2::<T>::zeros(py, [rows, columns], false)
}

/// The elements of an array that this module has just made and not yet given away.
pub fn elements<'a, T: Element, D: numpy::ndarray::Dimension>(
    array: &'a Bound<'_, numpy::PyArray<T, D>>,
) -> &'a mut [T] {
    // SAFETY: callers pass arrays that they made themselves, once each, and that Python has not seen yet; new arrays
    // are contiguous.
    unsafe { array.as_slice_mut() }.unwrap_or_default()
}
