//! Units of measure: conversions against published values, and the algebra against its laws.

#![allow(clippy::result_large_err, reason = "the callback gives diagnostics")]

use proptest::prelude::*;
use smpl_dsl::parse;
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::{StatementKind, UnitExpr};
use smpl_dsl::units::{OwnUnits, Rational, Unit, resolve, symbols};

fn written(text: &str) -> UnitExpr {
    let source = format!("time t : {text}");
    let parsed = parse(&source, FileId(0));
    assert!(parsed.is_ok(), "{text}: {:?}", parsed.diagnostics);
    match &parsed.file.statements[0].kind {
        StatementKind::Time { unit, .. } => unit.clone(),
        other => panic!("not a time: {other:?}"),
    }
}

fn unit(text: &str) -> Unit {
    resolve(&written(text), &OwnUnits::default(), &mut |_| Ok(Unit::one())).unwrap_or_else(|fault| panic!("{text}: {fault:?}"))
}

#[test]
fn declared_units_convert_by_their_sizes() {
    let text = "unit kUSD = 1000 [USD]\nunit USD\nunit rate = 2.5 [kUSD/h]\n";
    let file = parse(text, FileId(0)).file;
    let (own, faults) = OwnUnits::declared(file.statements.iter().map(|statement| &statement.kind));
    assert!(faults.is_empty(), "{faults:?}");
    let unit = |text: &str| resolve(&written(text), &own, &mut |_| Ok(Unit::one())).unwrap_or_else(|fault| panic!("{text}: {fault:?}"));
    // Computed manually: 2.5 * 1000 USD in an hour are 2500 * 24 USD a day.
    assert_eq!(unit("rate").factor_to(&unit("USD/d")), Some(60_000.0));
    assert_eq!(unit("USD^2/kUSD").factor_to(&unit("USD")), Some(1e-3));
    assert_eq!(unit("USD").factor_to(&unit("kg")), None);
    assert_eq!(unit("USD/kUSD").dimension(), Unit::one().dimension());
    assert_eq!(unit("USD kg/h^2").describe(), "USD mass per time^2 [USD kg/h^2]");
    assert_eq!(unit("USD^(1/2)").power(Rational::integer(2)), Some(unit("USD")));
}

#[test]
fn factors_agree_with_published_values() {
    // NIST Special Publication 811 (2008), appendix B; CODATA for the calorie.
    let table = [
        ("atm", "Pa", 101_325.0),
        ("bar", "atm", 1.0 / 1.01325),
        ("cal", "J", 4.184),
        ("cP", "Pa s", 1e-3),
        ("L", "m^3", 1e-3),
        ("M", "mol/m^3", 1000.0),
        ("mM", "mol/L", 1e-3),
        ("kmol/m^3", "mol/L", 1.0),
        ("h", "s", 3600.0),
        ("week", "d", 7.0),
        ("kJ/(min m^2 K)", "W/(m^2 K)", 1000.0 / 60.0),
        ("g h/L", "kg s/m^3", 3600.0),
        ("t/ha", "kg/m^2", 0.1),
        ("ppm", "%", 1e-4),
        ("mL/min", "m^3/s", 1e-6 / 60.0),
        ("kcal/(mol K)", "J/(kmol K)", 4.184e6),
        ("degF", "K", 5.0 / 9.0),
        ("m^2.5/min", "dm^(5/2)/min", 10_f64.powf(2.5)),
        ("deg", "rad", std::f64::consts::PI / 180.0),
        ("100 mL", "L", 0.1),
        ("\u{b0}C/min", "K/s", 1.0 / 60.0),
        // Those that are exact by definition: all digits of the publication.
        ("inch", "m", 2.54e-2),
        ("ft", "m", 3.048e-1),
        ("lb", "kg", 4.535_923_7e-1),
        ("lbf", "N", 4.448_221_615_260_5),
        ("lbmol", "mol", 4.535_923_7e2),
        ("gal", "m^3", 3.785_411_784e-3),
        ("BTU", "J", 1.055_055_852_62e3),
        ("kWh", "J", 3.6e6),
        ("cSt", "m^2/s", 1e-6),
        ("kohm", "V/A", 1e3),
        ("mS/cm", "S/m", 0.1),
        ("ohm m", "kg m^3/(s^3 A^2)", 1.0),
        ("S ohm", "1", 1.0),
        ("year", "s", 3.1536e7),
        ("torr", "Pa", 101_325.0 / 760.0),
    ];
    for (from, to, expected) in table {
        let factor = unit(from).factor_to(&unit(to)).unwrap_or(f64::NAN);
        assert!((factor / expected - 1.0).abs() < 1e-15, "{from} in {to}: {factor}, expected {expected}");
    }
}

#[test]
fn factors_that_are_published_rounded_agree_to_their_digits() {
    let table = [
        // NIST Special Publication 811 (2008), B.8, seven digits.
        ("psi", "Pa", 6.894_757e3, 5e-7),
        ("mmHg", "Pa", 1.333_224e2, 5e-7),
        ("torr", "Pa", 1.333_224e2, 5e-7),
        ("hp", "W", 7.456_999e2, 5e-7),
        ("rpm", "rad/s", 1.047_198e-1, 5e-7),
        ("BTU/(h ft^2 degF)", "W/(m^2 K)", 5.678_263, 5e-7),
        ("gal/min", "m^3/s", 6.309_020e-5, 5e-7),
        ("lb/ft^3", "kg/m^3", 1.601_846e1, 5e-7),
        // CODATA 2018, molar volume of an ideal gas at 273.15 K and 101.325 kPa: 22.41396954e-3 m^3/mol.
        ("Nm3", "mol", 1.0 / 22.413_969_54e-3, 1e-9),
        ("NL", "mmol", 1e3 / 22.413_969_54, 1e-9),
    ];
    for (from, to, expected, digits) in table {
        let factor = unit(from).factor_to(&unit(to)).unwrap_or(f64::NAN);
        assert!((factor / expected - 1.0).abs() < digits, "{from} in {to}: {factor}, expected {expected}");
    }
}

#[test]
fn degrees_are_written_with_their_sign_too() {
    for (sign, word) in [("\u{b0}C", "degC"), ("\u{b0}F", "degF")] {
        assert!(unit(sign).is_point());
        assert_eq!(unit(sign).conversion_to(&unit("K")), unit(word).conversion_to(&unit("K")));
    }
}

#[test]
fn temperatures_agree_with_the_fixed_points_of_the_scales() {
    // Water boils at 100 degC = 212 degF = 373.15 K; the scales meet at -40.
    let convert = |from: &str, to: &str, value: f64| {
        let conversion = unit(from).conversion_to(&unit(to)).unwrap_or_else(|| panic!("{from} to {to}"));
        conversion.factor * value + conversion.offset
    };
    assert_eq!(convert("degC", "K", 100.0), 373.15);
    assert!((convert("degC", "degF", 100.0) - 212.0).abs() < 1e-10);
    assert!((convert("degF", "degC", -40.0) + 40.0).abs() < 1e-10);
    assert_eq!(convert("K", "degC", 273.15), 0.0);
}

#[test]
fn a_point_unit_in_a_product_stands_for_differences() {
    assert!(unit("degC").is_point());
    assert!(!unit("W/(m^2 degC)").is_point());
    assert_eq!(unit("W/(m^2 degC)"), unit("W/(m^2 K)"));
    assert_eq!(unit("degC").difference(), unit("K"));
}

#[test]
fn a_slash_divides_by_the_next_factor_only() {
    assert_eq!(unit("g h/L"), unit("g h L^-1"));
    assert_eq!(unit("m/s kg"), unit("m kg/s"));
    assert_eq!(unit("1/h"), unit("h^-1"));
}

#[test]
fn units_are_shown_as_they_are_written() {
    assert_eq!(unit("kmol/(m^3 min)").to_string(), "kmol/(m^3 min)");
    assert_eq!(unit("m^2.5/min").to_string(), "m^2.5/min");
    assert_eq!(unit("1/h").to_string(), "1/h");
    assert_eq!(unit("1").to_string(), "1");
    let product = unit("kmol/m^3").multiply(&unit("m^3/min"));
    assert_eq!(product.map(|unit| unit.to_string()).as_deref(), Some("kmol/min"));
}

#[test]
fn dimensions_are_described_in_words() {
    assert_eq!(unit("K/min").describe(), "temperature per time [K/min]");
    assert_eq!(unit("kPa").describe(), "pressure [kPa]");
    assert_eq!(unit("1").describe(), "dimensionless");
    assert_eq!(unit("mol/(L h)").describe(), "concentration per time [mol/(L h)]");
    assert_eq!(unit("m^2.5/min").describe(), "length^2.5 per time [m^2.5/min]");
}

#[test]
fn unknown_units_come_with_what_was_meant() {
    let cases = [
        ("sec", "did you mean `s`?"),
        ("m3", "a power is written `m^3`"),
        ("kgm", "did you mean"),
        ("Kmol", "did you mean `kmol`?"),
        ("minn", "did you mean `min`?"),
        ("Torr", "did you mean `torr`?"),
        ("gallons", "did you mean `gal`?"),
        ("mmHG", "did you mean `mmHg`?"),
        ("furlong", "with prefixes"),
    ];
    for (text, help) in cases {
        let fault = resolve(&written(text), &OwnUnits::default(), &mut |_| Ok(Unit::one())).expect_err(text);
        assert_eq!(fault.code.id(), "E0301-unknown-unit");
        assert!(fault.help.as_deref().is_some_and(|given| given.starts_with(help)), "{text}: {:?}", fault.help);
    }
}

#[test]
fn absurd_exponents_are_refused_not_wrapped() {
    let fault = resolve(&written("m^900 m^900"), &OwnUnits::default(), &mut |_| Ok(Unit::one())).expect_err("too large");
    assert_eq!(fault.code.id(), "E0305-unit-overflow");
    assert!(resolve(&written("km^999"), &OwnUnits::default(), &mut |_| Ok(Unit::one())).is_err());
}

fn any_unit() -> impl Strategy<Value = Unit> {
    let count = symbols().len();
    proptest::collection::vec((0..count, -3_i32..=3), 0..4).prop_map(|parts| {
        parts.into_iter().fold(Unit::one(), |product, (index, exponent)| {
            let unit = Unit::named(symbols()[index].symbol).and_then(|unit| unit.power(Rational::integer(exponent)));
            unit.and_then(|unit| product.multiply(&unit)).unwrap_or(product)
        })
    })
}

fn close(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 1e-12
}

proptest! {
    #[test]
    fn a_unit_over_itself_is_one(unit in any_unit()) {
        let quotient = unit.divide(&unit).expect("in range");
        prop_assert!(quotient.dimension().is_none());
        prop_assert!(close(quotient.scale().value(), 1.0));
        prop_assert_eq!(quotient.to_string(), "1");
        prop_assert_eq!(unit.factor_to(&unit), Some(1.0));
    }

    #[test]
    fn products_commute_and_quotients_undo_them(a in any_unit(), b in any_unit()) {
        let (ab, ba) = (a.multiply(&b).expect("in range"), b.multiply(&a).expect("in range"));
        prop_assert_eq!(ab.dimension(), ba.dimension());
        prop_assert!(close(ab.scale().value(), ba.scale().value()));
        let back = ab.divide(&b).expect("in range");
        prop_assert_eq!(back.dimension(), a.dimension());
        prop_assert!(close(back.scale().value(), a.scale().value()));
    }

    #[test]
    fn powers_of_powers_multiply_their_exponents(unit in any_unit(), p in -3_i32..=3, q in 1_i32..=3) {
        let (p, q) = (Rational::integer(p), Rational::integer(q));
        let twice = unit.power(p).and_then(|power| power.power(q));
        let once = unit.power(p.multiply(q).expect("in range"));
        // A factor beyond double precision is refused on either way.
        prop_assert_eq!(twice.is_some(), once.is_some());
        if let (Some(twice), Some(once)) = (twice, once) {
            prop_assert_eq!(twice.dimension(), once.dimension());
            prop_assert!(close(twice.scale().value(), once.scale().value()));
        }
    }

    #[test]
    fn factors_there_and_back_cancel(a in any_unit(), b in any_unit()) {
        if let (Some(there), Some(back)) = (a.factor_to(&b), b.factor_to(&a)) {
            prop_assert!(close(there * back, 1.0));
        } else {
            prop_assert!(!a.commensurable(&b));
        }
    }
}
