//! Sparse LU by SuiteSparse's KLU.

use std::os::raw::c_long;
use std::ptr;

use sundials_sys::{
    klu_l_analyze, klu_l_common, klu_l_condest, klu_l_defaults, klu_l_factor, klu_l_free_numeric, klu_l_free_symbolic, klu_l_numeric,
    klu_l_rcond, klu_l_refactor, klu_l_solve, klu_l_symbolic,
};

use super::super::{IdaFlag, Pattern, SolveError};
use super::Singular;

/// Reciprocal condition below which old pivots are not trusted (SUNDIALS' own bound, roundoff to
/// the power 2/3).
const ILL_CONDITIONED: f64 = 3.7e-11;

/// KLU's number for the ordering by columns' approximate minimum degree.
const COLAMD: c_long = 1;

/// A sparse matrix, analysed once, factorised with pivoting once, and then again with the same
/// pivots as long as they serve.
pub(crate) struct Klu {
    n: c_long,
    column_starts: Box<[c_long]>,
    rows: Box<[c_long]>,
    common: Box<klu_l_common>,
    symbolic: *mut klu_l_symbolic,
    numeric: *mut klu_l_numeric,
    /// True if the next factorisation chooses its pivots anew.
    pivot: bool,
    values: Box<[f64]>,
}

// SAFETY: the objects behind the pointers are owned, and KLU has no global state.
unsafe impl Send for Klu {}

impl Klu {
    pub(crate) fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        let signed = |from: &[usize]| from.iter().map(|&i| i as c_long).collect::<Box<[_]>>();
        let mut klu = Self {
            n: pattern.dimension() as c_long,
            column_starts: signed(pattern.column_starts()),
            rows: signed(pattern.rows()),
            // SAFETY: numbers, pointers and optional functions; `klu_l_defaults` sets every field.
            common: Box::new(unsafe { std::mem::zeroed() }),
            symbolic: ptr::null_mut(),
            numeric: ptr::null_mut(),
            pivot: true,
            values: vec![0.0; pattern.entries()].into_boxed_slice(),
        };
        // SAFETY: the arrays are the pattern that the constructor was given, whose starts and rows
        // fit one another; KLU keeps no address of them.
        unsafe {
            klu_l_defaults(&mut *klu.common);
            klu.common.ordering = COLAMD;
            // Blocks only cost time (a third of a solve with 1700 unknowns) unless they are needed
            // to find pivots.
            klu.common.btf = c_long::from(!has_diagonal(pattern));
            klu.symbolic = klu_l_analyze(klu.n, klu.column_starts.as_mut_ptr(), klu.rows.as_mut_ptr(), &mut *klu.common);
        }
        if klu.symbolic.is_null() {
            let message = "structurally singular, or out of memory".to_owned();
            let flag = IdaFlag { value: klu.common.status as i32, message };
            return Err(SolveError::Setup { function: "klu_l_analyze", flag });
        }
        Ok(klu)
    }

    pub(crate) fn forget(&mut self) {
        self.pivot = true;
    }

    pub(crate) fn factorise(&mut self, values: &[f64]) -> Result<(), Singular> {
        self.values.copy_from_slice(values);
        if !self.pivot && self.refactorise() {
            return Ok(());
        }
        self.pivot = true;
        self.factorise_with_pivoting()?;
        self.pivot = false;
        Ok(())
    }

    /// Factorises with the pivots of the last time; false if they do not serve.
    fn refactorise(&mut self) -> bool {
        // SAFETY: the arrays have the pattern that was analysed; there are factors, since only a
        // success of `factorise_with_pivoting` clears `pivot`.
        unsafe {
            let done = klu_l_refactor(
                self.column_starts.as_mut_ptr(),
                self.rows.as_mut_ptr(),
                self.values.as_mut_ptr(),
                self.symbolic,
                self.numeric,
                &mut *self.common,
            );
            done == 1 && self.common.status == 0 && self.is_well_conditioned()
        }
    }

    /// A cheap estimate of the condition first, a better one where that is alarming.
    ///
    /// # Safety
    /// There are factors.
    unsafe fn is_well_conditioned(&mut self) -> bool {
        // SAFETY: by the contract of this function; the arrays have the pattern that was analysed.
        unsafe {
            klu_l_rcond(self.symbolic, self.numeric, &mut *self.common);
            if self.common.rcond >= ILL_CONDITIONED {
                return true;
            }
            klu_l_condest(self.column_starts.as_mut_ptr(), self.values.as_mut_ptr(), self.symbolic, self.numeric, &mut *self.common);
            self.common.condest <= 1.0 / ILL_CONDITIONED
        }
    }

    fn factorise_with_pivoting(&mut self) -> Result<(), Singular> {
        // SAFETY: the arrays have the pattern that was analysed; old factors are freed once, which
        // sets their address to null.
        unsafe {
            if !self.numeric.is_null() {
                klu_l_free_numeric(&mut self.numeric, &mut *self.common);
            }
            self.numeric = klu_l_factor(
                self.column_starts.as_mut_ptr(),
                self.rows.as_mut_ptr(),
                self.values.as_mut_ptr(),
                self.symbolic,
                &mut *self.common,
            );
        }
        if self.numeric.is_null() {
            let column = usize::try_from(self.common.singular_col).ok();
            return Err(Singular { column: column.filter(|&c| c < self.n as usize) });
        }
        Ok(())
    }

    /// Solves in place.
    ///
    /// # Panics
    /// Where there are fewer numbers than the matrix has rows.
    pub(crate) fn solve(&mut self, b: &mut [f64]) {
        let b = &mut b[..self.n as usize];
        // SAFETY: as many numbers as the matrix has rows; without factors KLU returns at once.
        unsafe {
            klu_l_solve(self.symbolic, self.numeric, self.n, 1, b.as_mut_ptr(), &mut *self.common);
        }
    }
}

/// Returns `true` if every diagonal entry is in the pattern.
fn has_diagonal(pattern: &Pattern) -> bool {
    (0..pattern.dimension()).all(|i| pattern.rows()[pattern.column(i)].contains(&i))
}

impl Drop for Klu {
    fn drop(&mut self) {
        // SAFETY: made by KLU with the same settings, or null, which it leaves alone; freed here
        // only.
        unsafe {
            klu_l_free_numeric(&mut self.numeric, &mut *self.common);
            klu_l_free_symbolic(&mut self.symbolic, &mut *self.common);
        }
    }
}
