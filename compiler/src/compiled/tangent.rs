//! Derivatives along directions, for sensitivities of a control step.
//!
//! Programs (updates, rewards, root functions, ...) run on values with their derivatives,
//! interpreted. What the solver asks for at every step is compiled when it is first asked for: the
//! derivatives of the equations by inputs ([`CompiledModel::by_inputs`]).

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::native::Native;
use super::{BackEndError, CompiledModel};
use crate::differentiate::pattern::each_place;
use crate::differentiate::{self, Column, ColumnOf, Rows};
use crate::explicit_time;
use crate::interpret::Tape;
pub use crate::interpret::tangent::{Dual, LANES, STILL, Tangent, TangentView};
use crate::ir::{Affine, ExprId, FastMap, FastSet, Flavour, Role, VarId};
use crate::layout::{Base, Memory};
use crate::model::Model;
use crate::schedule::{Access, Staged};

/// Programs that run on values with derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentProgram {
    /// Computed parameters (in place).
    Parameters,
    /// Initial values of discrete variables and disturbances (in place).
    InitialDiscretes,
    /// Fixed values of the steady problem, as in [`CompiledModel::steady`].
    Steady,
    /// Next values of the disturbances (in place).
    Disturb,
    /// Updates at the start of a step (in place).
    Start,
    /// Updates at its end (in place).
    End,
    /// Updates at an event, by the index of its program (in place).
    Event(u32),
    /// Rewards, observations and the rest of the `finish` program.
    Finish,
    /// Algebraic outputs.
    Outputs,
    /// Root functions, those of switches too.
    Roots,
    /// Integrands.
    Quadratures,
    /// The residual, rows in the order of `y`.
    Rows,
    /// The next times at which an equation changes its form: that of each break.
    Breaks,
    /// Present values of the delayed expressions.
    Delayed,
    /// Their dead times.
    Lags,
    /// Their values before the start, as in [`CompiledModel::before`].
    Before,
}

/// Number of parts that have a place among the tapes.
pub(super) const PARTS: usize = 11;

/// Entries of a sparse matrix of derivatives in machine code: the row of each, and what it is a
/// derivative by.
pub struct Entries<By> {
    native: Native,
    places: Vec<(u32, By)>,
    sources: Vec<By>,
}

/// Derivatives of the equations by inputs, numbers in the workspace: actions, parameters, discrete
/// variables, disturbances, and copies of any at other instants.
pub type ByInputs = Entries<u32>;

/// Variables of the derivatives of an integrand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// An unknown.
    Unknown(u32),
    /// The derivative of an unknown by time.
    Rate(u32),
    /// A number in the workspace.
    Input(u32),
}

/// Derivatives of the integrands by unknowns, their rates, and inputs.
pub type Integrands = Entries<Source>;

/// Variables, or copies of them at other instants.
type Inputs = Vec<(VarId, Flavour)>;

/// Entries by inputs, made once for each list of them.
type Known<By> = Mutex<FastMap<Inputs, Arc<Entries<By>>>>;

/// Data made at the first request.
#[derive(Default)]
pub(super) struct Later {
    tapes: [OnceLock<Result<Tape, BackEndError>>; PARTS],
    by_inputs: Known<u32>,
    integrands: Known<Source>,
    read: OnceLock<Result<Vec<bool>, BackEndError>>,
    held: OnceLock<Vec<Held>>,
}

/// A variable, or a copy of it at another instant, and the numbers in the workspace that hold it.
type Held = ((VarId, Flavour), std::ops::Range<usize>);

impl CompiledModel {
    /// Runs a part on values with derivatives.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn tangent(&self, part: TangentProgram, view: &mut TangentView<'_>) -> Result<(), &BackEndError> {
        view.tables = &[];
        let tape = match part {
            TangentProgram::Parameters => &self.tapes.parameters,
            TangentProgram::InitialDiscretes => &self.tapes.initial_discretes,
            TangentProgram::Steady => &self.tapes.steady,
            TangentProgram::Before => &self.tapes.before,
            TangentProgram::Event(index) => &self.tapes.events[index as usize],
            part => self.later.tapes[place(part)].get_or_init(|| self.make_tape(part)).as_ref()?,
        };
        let mut view = TangentView {
            time: view.time,
            y: (view.y.0, view.y.1),
            yp: view.yp,
            work: (view.work.0, view.work.1),
            out: (view.out.0, view.out.1),
            tables: &self.parts.tables,
            registers: view.registers,
        };
        tape.run_tangent(&mut view);
        Ok(())
    }

    fn make_tape(&self, part: TangentProgram) -> Result<Tape, BackEndError> {
        let model = &self.parts.model;
        let programs = &model.programs;
        let program = |name, program, yp, out| {
            let staged = Staged::of_program(program);
            Ok(Tape::new(&staged, &model.exprs, &self.layout, Access { name, y: true, yp, out })?)
        };
        let numbers = |name, values: Vec<ExprId>| {
            let out = values.len();
            Ok(Tape::new(&Staged::of_numbers(values), &model.exprs, &self.layout, Access { name, y: true, yp: true, out })?)
        };
        match part {
            TangentProgram::Disturb => program("disturb", &programs.disturb, false, 0),
            TangentProgram::Start => program("start", &programs.start, false, 0),
            TangentProgram::End => program("end", &programs.end, false, 0),
            TangentProgram::Finish => program("finish", &programs.finish, true, self.finish_len()),
            TangentProgram::Outputs => {
                program("outputs", &programs.outputs, true, crate::functions::elements(&model.interface.quantities.algebraics))
            }
            TangentProgram::Roots => {
                let watched = &self.parts.watched;
                let access = Access { name: "roots", y: true, yp: true, out: watched.kinds.len() };
                Ok(Tape::new(&Staged::of_lists(watched.roots(model)), &model.exprs, &self.layout, access)?)
            }
            TangentProgram::Quadratures => numbers("quadratures", model.quadratures.clone()),
            TangentProgram::Delayed => program("delayed", &programs.delayed, true, model.delayed()),
            TangentProgram::Lags => program("lags", &programs.lags, true, model.delayed()),
            _ => self.make_equations(part),
        }
    }

    /// Rows and breaks, for which the equations are worked out anew.
    fn make_equations(&self, part: TangentProgram) -> Result<Tape, BackEndError> {
        let mut model = self.parts.model.clone();
        let rows = differentiate::rows(&mut model)?;
        let (staged, out) = if part == TangentProgram::Rows {
            (Staged::of_rows(&rows), self.unknowns())
        } else {
            (Staged::of_lists(explicit_time::collect(&mut model, &rows).breaks), self.breaks())
        };
        Ok(Tape::new(&staged, &model.exprs, &self.layout, Access { name: "rows", y: true, yp: true, out })?)
    }

    /// Writes the inputs of which some number in the workspace is `active` to `found`.
    pub fn find_inputs(&self, active: impl Fn(std::ops::Range<usize>) -> bool, found: &mut Vec<(VarId, Flavour)>) {
        found.clear();
        let held = self.later.held.get_or_init(|| self.held());
        found.extend(held.iter().filter(|(_, cells)| active(cells.clone())).map(|&(input, _)| input));
    }

    /// Variables of the workspace, without caches.
    fn held(&self) -> Vec<Held> {
        let model = &self.parts.model;
        let flavours = [Flavour::Value, Flavour::Initial, Flavour::Previous, Flavour::Steady];
        let all = model.vars.keys().flat_map(|var| flavours.map(|flavour| (var, flavour)));
        let place = |(var, flavour): (VarId, Flavour)| {
            let held = !matches!(model.vars[var].role, Role::Cache | Role::Scratch | Role::Builtin);
            let address = self.layout.address(var, flavour).filter(|a| held && a.base == Base::Work)?;
            let first = address.offset as usize;
            Some(((var, flavour), first..first + model.vars[var].len as usize))
        };
        all.filter_map(place).collect()
    }

    /// Derivatives of the equations by these inputs.
    ///
    /// # Errors
    /// If an equation cannot be differentiated, or there is no code.
    pub fn by_inputs(&self, inputs: &[(VarId, Flavour)]) -> Result<Arc<ByInputs>, BackEndError> {
        known(&self.later.by_inputs, inputs, || self.make_by_inputs(inputs))
    }

    fn make_by_inputs(&self, inputs: &[(VarId, Flavour)]) -> Result<ByInputs, BackEndError> {
        let mut model = self.parts.model.clone();
        let wanted: FastSet<(VarId, Flavour)> = inputs.iter().copied().collect();
        let column_of = |var: VarId, flavour: Flavour| {
            let address = self.layout.address(var, flavour).filter(|_| wanted.contains(&(var, flavour)))?;
            Some(Column { first: address.offset, factor: None })
        };
        let rows = differentiate::rows(&mut model)?;
        self.make_entries("by_inputs", model, rows, &column_of, |column| column)
    }

    /// Derivatives of the integrands by unknowns, rates and these inputs.
    ///
    /// # Errors
    /// If an integrand cannot be differentiated, or there is no code.
    pub fn integrands(&self, inputs: &[(VarId, Flavour)]) -> Result<Arc<Integrands>, BackEndError> {
        known(&self.later.integrands, inputs, || self.make_integrands(inputs))
    }

    fn make_integrands(&self, inputs: &[(VarId, Flavour)]) -> Result<Integrands, BackEndError> {
        let model = self.parts.model.clone();
        let wanted: FastSet<(VarId, Flavour)> = inputs.iter().copied().collect();
        let n = self.unknowns() as u32;
        // Columns: unknowns, their rates, the workspace.
        let column_of = |var: VarId, flavour: Flavour| {
            let address = self.layout.address(var, flavour)?;
            let first = match address.base {
                Base::Y => address.offset,
                Base::Yp => n + address.offset,
                Base::Work if wanted.contains(&(var, flavour)) => 2 * n + address.offset,
                _ => return None,
            };
            Some(Column { first, factor: None })
        };
        let each = model.quadratures.iter().enumerate();
        let rows = each.map(|(at, &value)| Rows { extents: vec![], row: Affine::constant(at as i64), value }).collect();
        self.make_entries("integrands", model, rows, &column_of, |column| match column {
            unknown if unknown < n => Source::Unknown(unknown),
            rate if rate < 2 * n => Source::Rate(rate - n),
            input => Source::Input(input - 2 * n),
        })
    }

    /// Compiles derivatives of rows by columns; `by` says what a column is.
    fn make_entries<By: Copy + Ord>(
        &self,
        name: &'static str,
        mut model: Model,
        mut rows: Vec<Rows>,
        column_of: &ColumnOf<'_>,
        by: impl Fn(u32) -> By,
    ) -> Result<Entries<By>, BackEndError> {
        for row in &mut rows {
            row.value = differentiate::normalise(&mut model.exprs, row.extents.len(), row.value, column_of)?;
        }
        let entries = differentiate::entries(&mut model.exprs, &rows, column_of);
        let mut places = vec![];
        entries.iter().for_each(|entry| each_place(entry, |row, column| places.push((row as u32, by(column as u32)))));
        let staged = Staged::of_lists(entries.iter().map(|entry| (&entry.loops, entry.value)));
        let native = Native::new(self, &staged, &model.exprs, places.len(), name)?;
        let mut sources: Vec<By> = places.iter().map(|&(_, source)| source).collect();
        sources.sort_unstable();
        sources.dedup();
        Ok(Entries { native, places, sources })
    }

    /// Returns `true` if an equation reads each unknown itself, in addition to its rate.
    ///
    /// # Errors
    /// If an equation cannot be differentiated.
    pub fn read_unknowns(&self) -> Result<&[bool], &BackEndError> {
        self.later.read.get_or_init(|| self.find_read_unknowns()).as_ref().map(Vec::as_slice)
    }

    fn find_read_unknowns(&self) -> Result<Vec<bool>, BackEndError> {
        let mut model = self.parts.model.clone();
        let column_of = |var: VarId, flavour: Flavour| {
            let address = self.layout.address(var, flavour).filter(|address| address.base == Base::Y)?;
            Some(Column { first: address.offset, factor: None })
        };
        let rows = differentiate::rows(&mut model)?;
        let mut read = vec![false; self.unknowns()];
        for entry in &differentiate::entries(&mut model.exprs, &rows, &column_of) {
            each_place(entry, |_, column| read[column] = true);
        }
        Ok(read)
    }
}

impl<By> Entries<By> {
    /// Row of each value, and what it is a derivative by; a pair may occur several times, its
    /// values are to be added.
    #[must_use]
    pub fn places(&self) -> &[(u32, By)] {
        &self.places
    }

    /// All that values are derivatives by, each once.
    #[must_use]
    pub fn sources(&self) -> &[By] {
        &self.sources
    }

    /// A workspace for evaluations.
    #[must_use]
    pub fn memory(&self) -> Memory {
        self.native.memory()
    }

    /// Takes the present inputs.
    pub fn take(&self, memory: &mut Memory, from: &Memory) {
        self.native.take(memory, from);
    }

    /// Values at a point; `memory` is one of [`Entries::memory`].
    pub fn evaluate(&self, model: &CompiledModel, memory: &mut Memory, t: f64, y: (&[f64], &[f64]), out: &mut [f64]) {
        self.native.run(model, memory, t, y, out);
    }
}

/// Entries that were made before, or are now.
fn known<By>(
    all: &Known<By>,
    inputs: &[(VarId, Flavour)],
    make: impl FnOnce() -> Result<Entries<By>, BackEndError>,
) -> Result<Arc<Entries<By>>, BackEndError> {
    let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(made) = all.get(inputs) {
        return Ok(Arc::clone(made));
    }
    let made = Arc::new(make()?);
    all.insert(inputs.to_vec(), Arc::clone(&made));
    Ok(made)
}

/// Place of a tape.
fn place(part: TangentProgram) -> usize {
    let all = [
        TangentProgram::Disturb,
        TangentProgram::Start,
        TangentProgram::End,
        TangentProgram::Finish,
        TangentProgram::Outputs,
        TangentProgram::Roots,
        TangentProgram::Quadratures,
        TangentProgram::Rows,
        TangentProgram::Breaks,
        TangentProgram::Delayed,
        TangentProgram::Lags,
    ];
    all.iter().position(|&p| p == part).unwrap_or(0)
}
