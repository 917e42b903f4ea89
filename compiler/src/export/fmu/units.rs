//! Units of a model in the SI, for the definitions of units.

use smpl_dsl::parse;
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::StatementKind;
use smpl_dsl::units::{BASES, OwnUnits, Unit, UnitKind, resolve};

/// Unit in the SI.
pub(super) struct Si {
    /// Base units with their exponents.
    pub exponents: Vec<(&'static str, i64)>,
    /// Factor of a number.
    pub factor: f64,
    /// Offset.
    pub offset: f64,
}

/// The unit of a text that a model showed; `None` for one that the model declares, which the SI
/// does not know.
pub(super) fn unit(text: &str) -> Option<Unit> {
    let file = parse(&format!("param u : {text}\n"), FileId(0)).file;
    let statement = file.statements.into_iter().next()?;
    let StatementKind::Declare { declarations, .. } = statement.kind else { return None };
    resolve(declarations.first()?.unit.as_ref()?, &OwnUnits::default(), &mut |_| Ok(Unit::one())).ok()
}

/// A unit in the SI; `None` if it has parts that the SI does not know (cells, units of activity) or
/// exponents that are not integers.
pub(super) fn si(unit: &Unit) -> Option<Si> {
    const KNOWN: [&str; 7] = ["m", "kg", "s", "A", "K", "mol", "cd"];
    let mut exponents = vec![];
    for ((_, base), exponent) in BASES.iter().zip(unit.dimension().exponents()) {
        let number = exponent.to_f64();
        if number == 0.0 {
            continue;
        }
        let known = KNOWN.iter().find(|known| *known == base)?;
        if number.fract() != 0.0 {
            return None;
        }
        exponents.push((*known, number as i64));
    }
    let offset = match unit.kind() {
        UnitKind::Linear => 0.0,
        UnitKind::Point { zero } => zero,
    };
    Some(Si { exponents, factor: unit.scale().value(), offset })
}

/// The unit of a rate: a difference over the unit of time.
pub(super) fn rate(of: &str, time: &str) -> Option<String> {
    let rate = unit(of)?.difference().divide(&unit(time)?)?;
    let text = rate.to_string();
    Some(if text.is_empty() { "1".to_owned() } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_have_an_offset_and_their_rates_have_none() {
        let celsius = si(&unit("degC").expect("a unit")).expect("known");
        assert_eq!((celsius.exponents.as_slice(), celsius.factor, celsius.offset), (&[("K", 1)][..], 1.0, 273.15));
        assert_eq!(rate("degC", "min").as_deref(), Some("K/min"));
        let flow = si(&unit("L/min").expect("a unit")).expect("known");
        assert_eq!(flow.exponents, [("m", 3), ("s", -1)]);
        assert!((flow.factor - 1e-3 / 60.0).abs() < 1e-18);
    }

    #[test]
    fn cells_are_nothing_of_the_si() {
        assert!(si(&unit("cell/L").expect("a unit")).is_none());
        assert!(unit("no unit at all").is_none());
    }
}
