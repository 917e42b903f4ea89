//! A model ready to run: interface, pattern, memory layout, machine code, and tapes for what runs
//! rarely.

use std::sync::{Arc, OnceLock};

use crate::differentiate::pattern::Pattern;
use crate::functions::Function;
use crate::generate::{CompiledFn, Executable, Surroundings};
use crate::ir::{Builtin, VarId};
use crate::kernels;
use crate::layout::{Base, Layout};
pub use crate::layout::{FramePart, Memory, Region};
use crate::model::{Failure, Interface, Model, Quantity, Root, RootAction};

mod call;
mod derivative;
mod native;
mod parts;
pub mod tangent;
mod tapes;

pub use crate::switches::{WatchKind, WatchRole};
use derivative::Derivative;
pub use derivative::{Derived, Triplet, WithRespectTo};
pub(crate) use parts::Parts;
pub use parts::{BackEndError, BackEndSettings, CompileStatistics};
use tapes::Tapes;

/// A model ready to run; shared by many instances, each with its own [`Memory`]. It has many
/// methods: one for each compiled function.
pub struct CompiledModel {
    parts: Parts,
    layout: Arc<Layout>,
    tapes: Tapes,
    /// Functions of one piece.
    functions: [Option<CompiledFn>; Function::ALL.len()],
    /// Pieces of the others, to be called one after another.
    pieces: [Box<[CompiledFn]>; Function::ALL.len()],
    surroundings: Surroundings,
    /// Tapes of derivatives, made when first asked for.
    derivatives: [OnceLock<Result<Derivative, BackEndError>>; derivative::DERIVATIVES],
    /// Data for sensitivities.
    later: tangent::Later,
    /// Holds the code that `functions` point to.
    executable: Executable,
}

// SAFETY: the pointers in `functions`, `pieces` and `surroundings` go to the mapping and to the
// heap memory that `executable` and `parts` own. Neither changes while this value lives, and no
// thread has a claim on them.
unsafe impl Send for CompiledModel {}
// SAFETY: through a shared reference that memory is only read. Compiled functions write to the
// workspace, `y` and output that their callers have exclusively, and late values are in
// `OnceLock`s.
unsafe impl Sync for CompiledModel {}

impl CompiledModel {
    /// Maps the code and prepares the tapes.
    pub(crate) fn assemble(parts: Parts) -> Result<CompiledModel, BackEndError> {
        let columns = parts.codes.iter().flatten().map(|c| c.columns).max().unwrap_or(0);
        let layout = Layout::new(&parts.model, columns);
        let tapes = Tapes::new(&parts, &layout)?;
        let codes: Vec<&[u8]> = parts.codes.iter().flatten().map(|c| c.bytes.as_slice()).collect();
        let executable = Executable::new(&codes)?;
        let pieces: [Box<[CompiledFn]>; Function::ALL.len()] = Function::ALL.map(|f| {
            let first = parts.codes.iter().take(f as usize).map(Vec::len).sum::<usize>();
            let count = parts.codes.get(f as usize).map_or(0, Vec::len);
            let addresses = (first..first + count).filter_map(|piece| executable.address(piece));
            // SAFETY: at the address begins code that was generated with this signature; it is
            // mapped as long as `executable` lives.
            addresses.map(|address| unsafe { std::mem::transmute::<*const u8, CompiledFn>(address) }).collect()
        });
        let functions = Function::ALL.map(|f| match *pieces[f as usize] {
            [single] => Some(single),
            _ => None,
        });
        let surroundings =
            Surroundings { kernels: *kernels::table(), tables: parts.tables.as_ptr(), lists: parts.model.exprs.lists().all().as_ptr() };
        let derivatives = Default::default();
        Ok(CompiledModel {
            parts,
            layout: Arc::new(layout),
            tapes,
            functions,
            pieces,
            surroundings,
            derivatives,
            later: tangent::Later::default(),
            executable,
        })
    }

    pub(crate) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Names, units, bounds, settings.
    #[must_use]
    pub fn interface(&self) -> &Interface {
        &self.parts.model.interface
    }

    /// The flat model, with the caches that hoisting added.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.parts.model
    }

    /// Length of `y`.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.layout.unknowns()
    }

    /// Leading part of `y` that is differential.
    #[must_use]
    pub fn states(&self) -> usize {
        self.layout.states()
    }

    /// Every state's row is `f(t, y) - y'`, and no algebraic row mentions a derivative.
    #[must_use]
    pub fn explicit(&self) -> bool {
        self.parts.model.explicit
    }

    /// Non-zeros of the Jacobian.
    #[must_use]
    pub fn pattern(&self) -> &Pattern {
        &self.parts.pattern
    }

    /// The root functions.
    #[must_use]
    pub fn roots_info(&self) -> &[Root] {
        &self.parts.model.roots
    }

    /// The failure of a root function that watches a constraint of a reduced system.
    #[must_use]
    pub fn guard(&self, event: usize) -> Option<&Failure> {
        let RootAction::Fail(failure) = self.roots_info().get(event)?.action else { return None };
        let interface = &self.parts.model.interface;
        let is_guard = interface.reduction.guards.iter().any(|guard| guard.failure == failure);
        interface.finish.failures.get(failure as usize).filter(|_| is_guard)
    }

    /// Monitored root functions: the conditions of events, then the switches of the equations.
    #[must_use]
    pub fn watched(&self) -> &[WatchKind] {
        &self.parts.watched.kinds
    }

    /// The unknowns that root functions read, by their place in `y`.
    #[must_use]
    pub fn watched_unknowns(&self) -> &[u32] {
        &self.parts.watched.unknowns
    }

    /// Places in the workspace of what root functions read besides unknowns; `None` where they read
    /// the time or rates, too.
    #[must_use]
    pub fn watched_inputs(&self) -> Option<Vec<usize>> {
        let mut places = Vec::new();
        for &(var, flavour) in self.parts.watched.inputs.as_ref()? {
            let address = self.layout.address(var, flavour).filter(|address| address.base == Base::Work)?;
            let first = address.offset as usize;
            places.extend(first..first + self.parts.model.vars[var].len as usize);
        }
        Some(places)
    }

    /// Returns `true` if a root function looks at derivatives of the unknowns.
    #[must_use]
    pub fn roots_use_derivatives(&self) -> bool {
        let model = &self.parts.model;
        self.parts.watched.roots(model).iter().any(|(_, root)| model.exprs.has_derivative(*root))
    }

    /// Returns `true` if a quadrature looks at derivatives of the unknowns.
    #[must_use]
    pub fn quadratures_use_derivatives(&self) -> bool {
        let model = &self.parts.model;
        model.quadratures.iter().any(|&integrand| model.exprs.has_derivative(integrand))
    }

    /// Returns `true` if a quadrature, a root function or a delay reads algebraic unknowns, so that
    /// these have to be right within steps.
    #[must_use]
    pub fn algebraic_are_watched(&self) -> bool {
        let model = &self.parts.model;
        let solved: Vec<VarId> = model.interface.quantities.solved.iter().filter_map(|quantity| quantity.var).collect();
        let delayed = model.past().into_iter().map(|(value, _)| value);
        let mut watching = model.quadratures.iter().copied().chain(model.roots.iter().map(|root| root.value)).chain(delayed);
        !solved.is_empty() && watching.any(|e| !model.exprs.loads(e, |var, _| solved.contains(&var)).is_empty())
    }

    /// Number of quadratures.
    #[must_use]
    pub fn quadratures(&self) -> usize {
        self.parts.model.quadratures.len()
    }

    /// Number of the breaks: times known beforehand at which an equation changes its form.
    #[must_use]
    pub fn breaks(&self) -> usize {
        self.parts.breaks as usize
    }

    /// Number of expressions that time moves other than along straight lines.
    #[must_use]
    pub fn forcings_len(&self) -> usize {
        self.parts.forcings as usize
    }

    /// Returns `true` if time occurs in the equations.
    #[must_use]
    pub fn depends_on_time(&self) -> bool {
        self.parts.timed
    }

    /// Times and sizes of a compilation.
    #[must_use]
    pub fn statistics(&self) -> &CompileStatistics {
        &self.parts.statistics
    }

    /// Places of all parts.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Offset of a variable inside its region, of an unknown in `y`; `None` for a variable without
    /// memory.
    #[must_use]
    pub fn offset(&self, var: VarId) -> Option<usize> {
        self.layout.offset(var)
    }

    /// Bytes of executable memory.
    #[must_use]
    pub fn code_len(&self) -> usize {
        self.executable.len()
    }

    /// A workspace with parameters, actions, discrete variables and disturbances at their defaults,
    /// all else zero.
    #[must_use]
    pub fn memory(&self) -> Memory {
        let mut memory = Memory::new(Arc::clone(&self.layout));
        let interface = self.interface();
        memory.region_mut(Region::Builtin)[Builtin::StepLength as usize] = interface.episode.step;
        for (region, quantities) in [
            (Region::Param, &interface.quantities.parameters),
            (Region::Action, &interface.quantities.actions),
            (Region::Discrete, &interface.quantities.discretes),
            (Region::Disturbance, &interface.quantities.disturbances),
        ] {
            let numbers = memory.region_mut(region);
            for quantity in quantities {
                let Some(offset) = quantity.var.and_then(|v| self.layout.offset(v)) else {
                    continue;
                };
                for (i, slot) in numbers.iter_mut().skip(offset).take(quantity.len()).enumerate() {
                    let default = Quantity::pick(&quantity.default, i);
                    *slot = if default.is_nan() { 0.0 } else { default };
                }
            }
        }
        memory
    }
}
