//! Expressions over symbols: names, indices, calls, reductions and units, from the text to nodes.
//!
//! The meaning of an expression depends on its parts, so the files of this room and of
//! [`super::space`] call one another as the grammar does. No other code takes part in that
//! recursion. The symbols are frozen: nothing is declared here.

pub(in crate::elaborate) mod binders;
pub(in crate::elaborate) mod bounded;
pub(in crate::elaborate) mod boxes;
pub(in crate::elaborate) mod builtins;
pub(in crate::elaborate) mod cells;
pub(in crate::elaborate) mod defaults;
pub(in crate::elaborate) mod definitions;
pub(in crate::elaborate) mod delays;
pub(in crate::elaborate) mod expression;
pub(in crate::elaborate) mod functions;
pub(in crate::elaborate) mod indices;
pub(in crate::elaborate) mod interpolation;
pub(in crate::elaborate) mod loops;
pub(in crate::elaborate) mod membership;
pub(in crate::elaborate) mod nests;
pub(in crate::elaborate) mod operators;
pub(in crate::elaborate) mod outcome;
pub(in crate::elaborate) mod paths;
pub(in crate::elaborate) mod phases;
pub(in crate::elaborate) mod place;
mod places;
pub(in crate::elaborate) mod random_and_tables;
pub(in crate::elaborate) mod ranges;
pub(in crate::elaborate) mod reactions;
pub(in crate::elaborate) mod reads;
pub(in crate::elaborate) mod reductions;
pub(in crate::elaborate) mod structural;
pub(in crate::elaborate) mod units;
pub(in crate::elaborate) mod value;
pub(in crate::elaborate) mod values;

use cranelift_entity::PrimaryMap;

use crate::elaborate::constants::Constants;
use crate::elaborate::expansions::Expansions;
use crate::elaborate::hidden::Hidden;
use crate::elaborate::instances::Instances;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::naming::Naming;
use crate::elaborate::select::Input;
use crate::elaborate::space::ends::Grids;
use crate::elaborate::space::faces::Fluxes;
use crate::elaborate::symbols::{ScopeId, SymbolId, SymbolKind, Symbols};
use crate::ir::{Exprs, FastMap, Role, VarId};
use crate::model::{Quantity, Variable};
use loops::Loops;
use outcome::EpisodeNames;

/// Output of lowering, one part per concern.
#[derive(Debug)]
pub(in crate::elaborate) struct Work {
    /// Reports, used work, and data that may be undone.
    pub ledger: Ledger,
    /// The nodes.
    pub exprs: Exprs,
    /// Known values of parameters.
    pub constants: Constants,
    /// Definitions that are expanded where they are used.
    pub expansions: Expansions,
    /// Variables that nothing declares.
    pub hidden: Hidden,
    /// The loops around what is being elaborated.
    pub loops: Loops,
    /// The flux that is being elaborated.
    pub fluxes: Fluxes,
    /// Ends of domains.
    pub grids: Grids,
    /// Public data of each declared variable, once it is known.
    pub quantities: FastMap<VarId, Quantity>,
    /// Meaning of the names of the episode.
    pub names: EpisodeNames,
}

impl Work {
    /// Nothing done yet; declares the variables that nothing else does.
    pub(super) fn new(ledger: Ledger, vars: &mut PrimaryMap<VarId, Variable>) -> Work {
        Work {
            ledger,
            exprs: Exprs::default(),
            constants: Constants::default(),
            expansions: Expansions::default(),
            hidden: Hidden::new(vars),
            loops: Loops::default(),
            fluxes: Fluxes::default(),
            grids: Grids::default(),
            quantities: FastMap::default(),
            names: EpisodeNames::default(),
        }
    }
}

/// Data of lowering functions, their first argument. Its methods are the recursion itself: values
/// of expressions, of names and of reductions.
pub(in crate::elaborate) struct Lowering<'m, 'a> {
    /// Statements to elaborate.
    pub input: &'m Input<'a>,
    /// Meaning of names.
    pub symbols: &'m Symbols<'a>,
    /// Components and their instances.
    pub instances: &'m Instances<'a>,
    /// See [`Work`].
    pub ledger: &'m mut Ledger,
    /// See [`Work`].
    pub exprs: &'m mut Exprs,
    /// See [`Work`].
    pub constants: &'m mut Constants,
    /// See [`Work`].
    pub expansions: &'m mut Expansions,
    /// See [`Work`].
    pub hidden: &'m mut Hidden,
    /// See [`Work`].
    pub loops: &'m mut Loops,
    /// See [`Work`].
    pub fluxes: &'m mut Fluxes,
    /// See [`Work`].
    pub grids: &'m mut Grids,
    /// See [`Work`].
    pub quantities: &'m mut FastMap<VarId, Quantity>,
    /// See [`Work`].
    pub names: &'m mut EpisodeNames,
}

impl<'m, 'a> Lowering<'m, 'a> {
    /// Lowering over what is declared so far.
    pub(super) fn new(
        input: &'m Input<'a>,
        symbols: &'m Symbols<'a>,
        instances: &'m Instances<'a>,
        work: &'m mut Work,
    ) -> Lowering<'m, 'a> {
        let Work { ledger, exprs, constants, expansions, hidden, loops, fluxes, grids, quantities, names } = work;
        Lowering { input, symbols, instances, ledger, exprs, constants, expansions, hidden, loops, fluxes, grids, quantities, names }
    }

    /// Symbols of variables and outputs in the order of the text, instances at their places.
    pub(in crate::elaborate) fn in_text_order(&self) -> Vec<SymbolId> {
        let mut out = Vec::new();
        let blocks = self.instances.blocks.iter().map(|(scope, items)| (*scope, items.as_slice())).collect();
        self.symbols.walk(ScopeId::from_u32(0), &blocks, &mut out);
        out
    }

    /// Variables of a role in the order of the text, as the interface lists them; identifiers are
    /// in that of the region.
    pub(in crate::elaborate) fn variables_of(&self, role: Role) -> Vec<VarId> {
        self.in_text_order()
            .into_iter()
            .filter_map(|s| match self.symbols[s].kind {
                SymbolKind::Variable { var, .. } if self.symbols.vars[var].role == role => Some(var),
                _ => None,
            })
            .collect()
    }

    /// Data of a lookup.
    pub(in crate::elaborate) fn naming(&mut self) -> Naming<'_, 'a> {
        Naming { symbols: self.symbols, ledger: self.ledger }
    }
}
