//! Balances of reactions: of elements by the formulas of species, of masses by their molar masses.

use std::collections::BTreeMap;
use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::units::Unit;

use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::Measure;
use crate::elaborate::lower::{Lowering, defaults, reactions, units};
use crate::elaborate::symbols::{Axis, OneReaction, Reactions, ScopeId, SetId, SymbolKind};
use crate::ir::FastSet;

/// Largest difference of both sides, relative to the larger one: coefficients are rounded.
const TOLERANCE: f64 = 5e-3;

/// Amounts that a reaction consumes and produces, of an element or of mass.
#[derive(Clone, Copy, Debug, Default)]
struct Sides {
    consumed: f64,
    produced: f64,
}

impl Sides {
    fn add(&mut self, amount: f64) {
        if amount < 0.0 { self.consumed -= amount } else { self.produced += amount }
    }

    fn balance(self) -> bool {
        (self.produced - self.consumed).abs() <= TOLERANCE * self.produced.max(self.consumed)
    }
}

/// Reports reactions of species with formulas in which an element or the charge does not balance.
pub(in crate::elaborate) fn check_elements(l: &mut Lowering<'_, '_>) {
    for (scope, set) in all(l) {
        for one in &set.list {
            let Some(coefficients) = coefficients(l, scope, &set, one) else { continue };
            let mut elements: BTreeMap<String, Sides> = BTreeMap::new();
            let complete = coefficients.iter().all(|(species, nu)| {
                let Some(formula) = l.symbols.formulas.get(&(set.species, *species)) else { return false };
                formula.iter().for_each(|(element, n)| elements.entry(element.clone()).or_default().add(nu * n));
                true
            });
            if complete {
                report_elements(l, one, &elements);
            }
        }
    }
}

fn report_elements(l: &mut Lowering<'_, '_>, one: &OneReaction<'_>, elements: &BTreeMap<String, Sides>) {
    let wrong: Vec<String> = elements
        .iter()
        .filter(|(_, sides)| !sides.balance())
        .map(|(element, Sides { consumed, produced })| format!("{element} ({} consumed, {} produced)", short(*consumed), short(*produced)))
        .collect();
    if !wrong.is_empty() {
        let name = &one.reaction.declaration.name;
        let message = format!("the reaction `{}` does not balance in {}", name.text, wrong.join(", "));
        let fault = Diagnostic::error(codes::UNBALANCED_REACTION, message, one.reaction.declaration.span);
        l.ledger.report(fault.help("correct the coefficients, or add the species that are missing"));
    }
}

/// Warns of reactions of species with molar masses that do not keep the mass.
pub(in crate::elaborate) fn lint_masses(l: &mut Lowering<'_, '_>) {
    for (scope, set) in all(l) {
        let Some(masses) = masses(l, set.species) else { continue };
        for one in &set.list {
            let Some(coefficients) = coefficients(l, scope, &set, one) else { continue };
            if coefficients.iter().all(|(species, _)| l.symbols.formulas.contains_key(&(set.species, *species))) {
                continue;
            }
            let mut sides = Sides::default();
            coefficients.iter().for_each(|(species, nu)| sides.add(nu * masses[*species]));
            if sides.balance() {
                continue;
            }
            let name = &one.reaction.declaration.name;
            let (consumed, produced) = (short(sides.consumed), short(sides.produced));
            let message = format!("the reaction `{}` consumes the mass {consumed} and produces {produced} by its molar masses", name.text);
            let warning = Diagnostic::warning(codes::UNBALANCED_MASS, message, one.reaction.declaration.span);
            l.ledger.report(warning.help("correct the coefficients, or add the species that are missing"));
        }
    }
}

fn short(x: f64) -> f64 {
    let digits = 10_f64.powi(4 - x.abs().max(1e-300).log10().ceil() as i32);
    if digits.is_finite() && digits > 0.0 { (x * digits).round() / digits } else { x }
}

/// All sets of reactions with their scopes; of the instances of a component the first.
fn all<'a>(l: &Lowering<'_, 'a>) -> Vec<(ScopeId, Rc<Reactions<'a>>)> {
    let mut seen = FastSet::default();
    let of = l.symbols.list.values().filter_map(|symbol| match &symbol.kind {
        SymbolKind::Source(set) if seen.insert(symbol.span) => Some((symbol.scope, Rc::clone(set))),
        _ => None,
    });
    of.collect()
}

/// Species and coefficients of a reaction, where these are known numbers without a unit.
fn coefficients(l: &mut Lowering<'_, '_>, scope: ScopeId, set: &Reactions<'_>, one: &OneReaction<'_>) -> Option<Vec<(usize, f64)>> {
    let mut out = Vec::new();
    for species in 0..l.symbols.sets[set.species].labels.len() {
        let place = reactions::bound(Place::new(scope, Site::Dynamics), one);
        let Some(value) = reactions::coefficient(l, set, one, species, &place) else { continue };
        let plain = match &value.unit {
            Measure::Of(unit) => units::is_plain_number(unit),
            other => other.is_plain() && !value.is_poison(),
        };
        out.push((species, defaults::constant_value(l, value.expr).filter(|x| plain && x.is_finite())?));
    }
    Some(out)
}

/// The molar masses of the species: the table over their set in a unit of mass per amount.
fn masses(l: &Lowering<'_, '_>, species: SetId) -> Option<Rc<[f64]>> {
    let molar = units::over(&Unit::named("g")?, &Unit::named("mol")?);
    l.symbols.list.values().find_map(|symbol| match &symbol.kind {
        SymbolKind::Table { axes, unit, values } if **axes == [Axis::Set(species)] && unit.commensurable(&molar) => Some(Rc::clone(values)),
        _ => None,
    })
}
