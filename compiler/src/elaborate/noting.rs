//! Notes for editors, of what has been lowered.

use smpl_dsl::units::Unit;

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::value::Measure;
use crate::elaborate::notes::Notes;
use crate::elaborate::symbols::SymbolKind;
use crate::ir::FastMap;

/// The notes of what has been lowered.
pub(super) fn collected(l: &Lowering<'_, '_>) -> Notes {
    let mut notes = Notes::default();
    for symbol in l.symbols.list.values() {
        match &symbol.kind {
            SymbolKind::Variable { var, .. } => {
                notes.quantities.extend(l.quantities.get(var).map(|quantity| (symbol.span, quantity.clone())));
            }
            SymbolKind::Let { unit: Some(unit), .. } => notes.units.push((symbol.span, unit.clone())),
            SymbolKind::Domain(domain) => notes.sizes.push((symbol.span, l.symbols.domains[*domain].cells.unsigned_abs() as usize)),
            SymbolKind::Set(set) => notes.sizes.push((symbol.span, l.symbols.sets[*set].labels.len())),
            _ => {}
        }
    }
    let mut derived = FastMap::default();
    for (symbol, value) in l.expansions.values() {
        match &value.unit {
            Measure::Of(unit) => {
                derived.insert(l.symbols[symbol].span, unit.clone());
            }
            Measure::Bare | Measure::Zero => {
                derived.entry(l.symbols[symbol].span).or_insert_with(Unit::one);
            }
            Measure::Truth | Measure::Nothing | Measure::Poison => {}
        }
    }
    notes.units.extend(derived);
    notes
}
