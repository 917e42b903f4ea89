//! Form of a program.

use serde::{Deserialize, Serialize};

use super::address::Address;
use crate::ir::{ExprId, MAX_DEPTH, Nest, Place, Program, Store, Target, VarId};

/// A program.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProgramForm {
    in_place: bool,
    nests: Vec<NestForm>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct NestForm {
    extents: Vec<u32>,
    stores: Vec<StoreForm>,
}

/// A store: into the output at `out`, or into a variable at an element.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoreForm {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    out: Option<Address>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    variable: Option<VarId>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    at: Option<Address>,
    value: ExprId,
}

impl From<&Program> for ProgramForm {
    fn from(program: &Program) -> Self {
        let store = |store: &Store| {
            let (at, value) = (Some(Address(store.target.at)), store.value);
            match store.target.place {
                Place::Var(var) => StoreForm { out: None, variable: Some(var), at, value },
                // Positions from tables are made behind the flat model only.
                Place::Out | Place::Table { .. } => StoreForm { out: at, variable: None, at: None, value },
            }
        };
        let nest = |nest: &Nest| NestForm { extents: nest.extents(), stores: nest.stores.iter().map(store).collect() };
        ProgramForm { in_place: program.in_place, nests: program.nests.iter().map(nest).collect() }
    }
}

impl ProgramForm {
    /// The program.
    ///
    /// # Errors
    /// The place of a store without a target, and the reason.
    pub(super) fn program(self) -> Result<Program, (String, String)> {
        let mut program = Program { nests: Vec::new(), in_place: self.in_place };
        for (n, nest) in self.nests.into_iter().enumerate() {
            let mut stores = Vec::new();
            for (s, store) in nest.stores.into_iter().enumerate() {
                let target = match store {
                    StoreForm { out: Some(Address(at)), variable: None, at: None, .. } => Target::out(at),
                    StoreForm { out: None, variable: Some(var), at: Some(Address(at)), .. } => Target::var(var, at),
                    _ => return Err((format!("nests[{n}].stores[{s}]"), "a store has `out`, or `variable` and `at`".into())),
                };
                stores.push(Store { target, value: store.value });
            }
            if nest.extents.len() > MAX_DEPTH {
                return Err((format!("nests[{n}].extents"), format!("more than {MAX_DEPTH} loops inside one another")));
            }
            program.nests.push(Nest::over(nest.extents, stores));
        }
        Ok(program)
    }
}
