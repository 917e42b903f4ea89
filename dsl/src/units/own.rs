//! Units that a model declares: `unit USD`, `unit kUSD = 1000 [USD]`.

use std::collections::BTreeMap;

use super::{Unit, UnitKind, resolve};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Expr, ExprKind, Ident, StatementKind};

/// Declared units by their symbols.
#[derive(Clone, Debug, Default)]
pub struct OwnUnits {
    units: BTreeMap<String, Unit>,
}

/// A declaration: its name, and its size unless it is a unit of a new dimension.
type Declared<'a> = (&'a Ident, Option<&'a Expr>);

impl OwnUnits {
    /// The units that statements declare, in any order, and the faults of their declarations.
    ///
    /// A second declaration of one name is a fault, and so is the symbol of a built-in unit,
    /// prefixes included.
    pub fn declared<'a>(statements: impl IntoIterator<Item = &'a StatementKind>) -> (Self, Vec<Diagnostic>) {
        let (mut own, mut faults, mut waiting) = (Self::default(), Vec::new(), Vec::<Declared<'a>>::new());
        for kind in statements {
            let StatementKind::Unit { name, size, .. } = kind else { continue };
            let before = waiting.iter().find(|(other, _)| other.text == name.text);
            match refused(name, before.map(|(other, _)| *other)) {
                Some(fault) => faults.push(fault),
                None => waiting.push((name, size.as_ref())),
            }
        }
        while !waiting.is_empty() {
            let known = |size: &Expr| symbols(size).all(|symbol| !waiting.iter().any(|(name, _)| name.text == *symbol));
            let (ready, rest): (Vec<_>, Vec<_>) = waiting.iter().partition(|(_, size)| size.is_none_or(known));
            if ready.is_empty() {
                faults.extend(rest.iter().map(|(name, _)| cyclic(name)));
                // Uses of a unit without a size cause no further faults.
                rest.iter().for_each(|(name, _)| own.insert(name, Unit::one()));
                break;
            }
            for (name, size) in ready {
                let unit = own.unit(name, size).unwrap_or_else(|fault| {
                    faults.push(*fault);
                    Unit::declared(&name.text, None)
                });
                own.insert(name, unit);
            }
            waiting = rest;
        }
        (own, faults)
    }

    /// The unit of a declared symbol.
    #[must_use]
    pub fn get(&self, symbol: &str) -> Option<&Unit> {
        self.units.get(symbol)
    }

    /// Symbols and units, by symbol.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Unit)> {
        self.units.iter().map(|(symbol, unit)| (symbol.as_str(), unit))
    }

    fn insert(&mut self, name: &Ident, unit: Unit) {
        self.units.insert(name.text.clone(), unit);
    }

    fn unit(&self, name: &Ident, size: Option<&Expr>) -> Result<Unit, Box<Diagnostic>> {
        let Some(size) = size else { return Ok(Unit::declared(&name.text, None)) };
        let ExprKind::Number { value, unit: Some(written) } = &size.kind else { return Err(Box::new(not_a_size(size))) };
        let unit = resolve(written, self, &mut |_| Err(not_a_size(size))).map_err(Box::new)?;
        if !matches!(unit.kind(), UnitKind::Linear) {
            let fault = Diagnostic::error(codes::AFFINE_UNIT, "a unit cannot be a multiple of a point on a temperature scale", size.span);
            return Err(Box::new(fault.help("use `K`, the unit of differences")));
        }
        let scaled = Unit::number(*value).and_then(|number| number.multiply(&unit));
        scaled.map(|scaled| Unit::declared(&name.text, Some(&scaled))).ok_or_else(|| Box::new(not_a_size(size)))
    }
}

/// Symbols in the unit of a size.
fn symbols(size: &Expr) -> impl Iterator<Item = &String> {
    let factors = match &size.kind {
        ExprKind::Number { unit: Some(unit), .. } => unit.factors.as_slice(),
        _ => &[],
    };
    factors.iter().filter_map(|factor| match &factor.base {
        crate::syntax::UnitBase::Symbol(symbol) => Some(&symbol.text),
        _ => None,
    })
}

/// The fault of a name that cannot be declared as a unit.
fn refused(name: &Ident, before: Option<&Ident>) -> Option<Diagnostic> {
    if let Some(before) = before {
        let fault = Diagnostic::error(codes::DUPLICATE_NAME, format!("the unit `{}` is declared twice", name.text), name.span);
        return Some(fault.label("second declaration").secondary(before.span, "first declaration"));
    }
    let built_in = Unit::named(&name.text)?;
    let message = format!("`{}` is a built-in unit: {}", name.text, built_in.dimension().describe());
    Some(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span).help("choose another symbol"))
}

fn cyclic(name: &Ident) -> Diagnostic {
    Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the size of the unit `{}` depends on the unit itself", name.text), name.span)
        .help("leave out the size of one of the units: it begins a new dimension")
}

fn not_a_size(size: &Expr) -> Diagnostic {
    Diagnostic::error(codes::UNIT_OVERFLOW, "the size of a unit must be a positive number with a unit", size.span)
        .help("for example `unit kUSD = 1000 [USD]`")
}
