//! Functions that are compiled when they are first asked for: what sensitivities call at every step
//! of the solver.

use std::sync::Arc;

use super::{BackEndError, CompiledModel};
use crate::generate::{CompiledFn, Effort, Executable, Request, Surroundings, generate};
use crate::ir::Exprs;
use crate::layout::{Layout, Memory};
use crate::schedule::{Access, Staged};

/// A function of the unknowns, their derivatives and the workspace, in machine code.
pub(super) struct Native {
    pieces: Box<[CompiledFn]>,
    /// As the model's, with working memory for this function.
    layout: Arc<Layout>,
    len: usize,
    /// Holds the code that `pieces` point to.
    _executable: Executable,
}

// SAFETY: the pointers go into the mapping that `_executable` owns, which nothing changes while
// this value lives.
unsafe impl Send for Native {}
// SAFETY: through a shared reference the mapping is only read; the code writes to what its caller
// has exclusively.
unsafe impl Sync for Native {}

impl Native {
    /// Compiles a staged program of `len` outputs.
    pub(super) fn new(
        model: &CompiledModel,
        staged: &Staged,
        exprs: &Exprs,
        len: usize,
        name: &'static str,
    ) -> Result<Native, BackEndError> {
        let access = Access { name, y: true, yp: true, out: len };
        let request = Request { staged, access, effort: Effort::Hot, rank: 0 };
        let codes = generate(&[request], exprs, &model.layout, false)?.into_iter().flat_map(|g| g.codes).collect::<Vec<_>>();
        let columns = codes.iter().map(|c| c.columns).max().unwrap_or(0);
        let bytes: Vec<&[u8]> = codes.iter().map(|c| c.bytes.as_slice()).collect();
        let executable = Executable::new(&bytes)?;
        let addresses = (0..codes.len()).filter_map(|piece| executable.address(piece));
        // SAFETY: at the address begins code that was generated with this signature; it is mapped
        // as long as `executable` lives.
        let pieces = addresses.map(|address| unsafe { std::mem::transmute::<*const u8, CompiledFn>(address) }).collect();
        Ok(Native { pieces, layout: Arc::new(Layout::new(&model.parts.model, columns)), len, _executable: executable })
    }

    /// A workspace for the function.
    pub(super) fn memory(&self) -> Memory {
        Memory::new(Arc::clone(&self.layout))
    }

    /// Takes the present numbers of a workspace of the model, all but its working memory.
    pub(super) fn take(&self, memory: &mut Memory, from: &Memory) {
        let len = self.layout.columns() as usize;
        memory.all_mut()[..len].copy_from_slice(&from.all()[..len]);
    }

    /// Runs the function.
    ///
    /// # Panics
    /// If the memory is not one of [`Native::memory`], or a vector has the wrong length.
    pub(super) fn run(&self, model: &CompiledModel, memory: &mut Memory, t: f64, (y, yp): (&[f64], &[f64]), out: &mut [f64]) {
        assert_eq!(memory.layout().len(), self.layout.len(), "memory of another function");
        assert!(y.len() == model.unknowns() && yp.len() == model.unknowns(), "length of y or y'");
        assert_eq!(out.len(), self.len, "length of the output");
        let surroundings: &Surroundings = &model.surroundings;
        let work = memory.all_mut().as_mut_ptr();
        for code in &self.pieces {
            // SAFETY: the code stays within the lengths that it was generated for, which are
            // asserted above. It writes to the output and the workspace, which are borrowed
            // exclusively. It never writes to `y`, since no nest of such a staged program stores
            // there.
            unsafe { code(t, 1.0, y.as_ptr().cast_mut(), yp.as_ptr(), work, out.as_mut_ptr(), surroundings) }
        }
    }
}
