//! Sparse derivatives for linearisation and sensitivities: interpreted, made when first asked for.

use super::{BackEndError, CompiledModel};
use crate::differentiate::pattern::each_place;
use crate::differentiate::{self, Column, Entry, Rows};
use crate::interpret::{Tape, View};
use crate::ir::{Affine, Flavour, Place, Program, Role, VarId};
use crate::layout::Memory;
use crate::schedule::{Access, Staged};

/// Differentiated function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Derived {
    /// The residual; rows in the order of `y`.
    Rows,
    /// The observations of the `finish` program; rows in their order.
    Observations,
    /// The conditions on the steady state; rows in their order.
    SteadyConditions,
    /// The conditions at the start; rows in their order.
    StartConditions,
    /// Delayed expressions; one row per element.
    Delayed,
    /// Distances from the constraints that states are projected to; two rows for each, of which the
    /// second is its rate.
    Constraints,
}

/// Role of the variables of the derivatives; columns are positions in the region of that role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WithRespectTo {
    /// `y`
    Unknowns,
    /// `y'`
    Derivatives,
    /// Actions.
    Actions,
    /// Parameters, as far as they occur in the equations themselves.
    Parameters,
    /// Delayed values: an element has [`DELAY_SLOTS`](crate::ir::DELAY_SLOTS) columns.
    Delayed,
}

/// Number of roles.
const ROLES: usize = WithRespectTo::Delayed as usize + 1;

/// Number of derivatives: each function with respect to each role.
pub(super) const DERIVATIVES: usize = (Derived::Constraints as usize + 1) * ROLES;

/// Row, column, value.
pub type Triplet = (usize, usize, f64);

/// A derivative ready to be evaluated.
pub(super) struct Derivative {
    tape: Tape,
    places: Vec<(usize, usize)>,
}

impl CompiledModel {
    /// Non-zero pattern entries of a derivative with their values; a place may occur several times,
    /// its values are to be added.
    ///
    /// # Errors
    /// If an expression cannot be differentiated.
    pub fn derivative(
        &self,
        of: Derived,
        with_respect_to: WithRespectTo,
        m: &mut Memory,
        t: f64,
        (y, yp): (&[f64], &[f64]),
    ) -> Result<Vec<Triplet>, &BackEndError> {
        let cell = &self.derivatives[of as usize * ROLES + with_respect_to as usize];
        let derivative = cell.get_or_init(|| self.make_derivative(of, with_respect_to)).as_ref()?;
        let mut values = vec![0.0; derivative.places.len()];
        let (mut y, work) = (y.to_vec(), m.all_mut());
        derivative.tape.run(&mut View { time: t, factor: 1.0, y: &mut y, yp, work, out: &mut values, tables: &[] });
        Ok(derivative.places.iter().zip(values).map(|(&(row, column), value)| (row, column, value)).collect())
    }

    fn make_derivative(&self, of: Derived, with_respect_to: WithRespectTo) -> Result<Derivative, BackEndError> {
        let mut model = self.parts.model.clone();
        let layout = &self.layout;
        let (roles, flavour): (&[Role], Flavour) = match with_respect_to {
            WithRespectTo::Unknowns => (&[Role::State, Role::Algebraic], Flavour::Value),
            WithRespectTo::Derivatives => (&[Role::State, Role::Algebraic], Flavour::Derivative),
            WithRespectTo::Actions => (&[Role::Action], Flavour::Value),
            WithRespectTo::Parameters => (&[Role::Param], Flavour::Value),
            WithRespectTo::Delayed => (&[Role::Delayed], Flavour::Value),
        };
        let vars = model.vars.clone();
        let column_of = |var: VarId, f: Flavour| {
            let wanted = f == flavour && roles.contains(&vars[var].role);
            let first = layout.offset(var).filter(|_| wanted)? as u32;
            Some(Column { first, factor: None })
        };
        let mut rows = match of {
            Derived::Rows => differentiate::rows(&mut model)?,
            Derived::Observations => {
                let first = model.interface.finish.layout().observations.start as i64;
                output_rows(&model.programs.finish, first)
            }
            Derived::StartConditions => output_rows(&model.programs.start_conditions, 0),
            Derived::Delayed => output_rows(&model.programs.delayed, 0),
            Derived::Constraints => {
                let first = model.interface.reduction.projected.first().map_or(i64::MAX, |p| 2 * i64::from(p.invariant));
                output_rows(&model.programs.invariants, first)
            }
            Derived::SteadyConditions => {
                let first = model.programs.steady.nests.iter().map(|n| n.stores.len()).sum::<usize>() as i64;
                output_rows(
                    &model.programs.steady,
                    first - i64::from(model.interface.steady.as_ref().map_or(0, |steady| steady.conditions)),
                )
            }
        };
        for row in &mut rows {
            row.value = differentiate::normalise(&mut model.exprs, row.extents.len(), row.value, &column_of)?;
        }
        let entries = differentiate::entries(&mut model.exprs, &rows, &column_of);
        let (staged, places) = list(&entries);
        let access = Access { name: "derivative", y: true, yp: true, out: places.len() };
        Ok(Derivative { tape: Tape::new(&staged, &model.exprs, layout, access)?, places })
    }
}

/// The stores of a program from a place of its output on.
fn output_rows(program: &Program, first: i64) -> Vec<Rows> {
    let mut rows = vec![];
    for nest in &program.nests {
        let wanted = nest.stores.iter().filter(|s| s.target.place == Place::Out && s.target.at.offset >= first);
        rows.extend(wanted.map(|s| Rows { extents: nest.extents(), row: s.target.at.plus(Affine::constant(-first)), value: s.value }));
    }
    rows
}

/// A staged program that writes the values of entries one after another, and their places.
fn list(entries: &[Entry]) -> (Staged, Vec<(usize, usize)>) {
    let mut places = vec![];
    entries.iter().for_each(|entry| each_place(entry, |row, column| places.push((row, column))));
    (Staged::of_lists(entries.iter().map(|entry| (&entry.loops, entry.value))), places)
}
