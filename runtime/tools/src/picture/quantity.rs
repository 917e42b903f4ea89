//! Numbers, units and times as text, the same in every picture: significant digits, SI prefixes,
//! one unit of time.

use smpl_dsl::units;

/// A unit as people write it: `m³`, `°C`; nothing for a number.
pub(super) fn unit(unit: &str) -> String {
    if unit == "1" {
        return String::new();
    }
    let mut out = String::new();
    let mut rest = unit;
    while let Some(at) = rest.find('^') {
        out.push_str(&rest[..at]);
        let exponent = &rest[at + 1..];
        let end = exponent.find(|c: char| !(c.is_ascii_digit() || c == '-' || c == '.')).unwrap_or(exponent.len());
        let (digits, after) = exponent.split_at(end);
        if digits.is_empty() || digits.contains('.') {
            out.push('^');
            out.push_str(digits);
        } else {
            out.extend(digits.chars().map(superscript));
        }
        rest = after;
    }
    out.push_str(rest);
    out.replace("degC", "\u{b0}C").replace("degF", "\u{b0}F")
}

fn superscript(digit: char) -> char {
    match digit {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        d => d.to_digit(10).and_then(|d| char::from_u32(0x2070 + d)).unwrap_or(d),
    }
}

/// Unit of an axis whose labels are in powers of ten: `[MJ/kg]`, `[10³ L]`, with its brackets;
/// nothing for plain numbers.
pub(super) fn bracketed(unit_text: &str, exponent: i32) -> String {
    let scaled = scaled(unit_text, exponent);
    if scaled.is_empty() { scaled } else { format!("[{scaled}]") }
}

/// The unit `10^exponent` times as large: with an SI prefix where the unit takes it, else with the
/// power before it.
pub(super) fn scaled(unit_text: &str, exponent: i32) -> String {
    if exponent == 0 {
        return unit_text.to_owned();
    }
    let power = || format!("10{} {unit_text}", exponent.to_string().chars().map(superscript).collect::<String>());
    prefixed(unit_text, exponent).unwrap_or_else(|| power().trim_end().to_owned())
}

/// Prefixes that pictures use: powers of a thousand.
const PREFIXES: [(&str, i32); 9] = [("p", -12), ("n", -9), ("\u{b5}", -6), ("m", -3), ("", 0), ("k", 3), ("M", 6), ("G", 9), ("T", 12)];
/// Units of which larger multiples are not in use, with the largest one: kg, km, but L, s and K.
const LARGEST: [(&str, i32); 5] = [("g", 3), ("m", 3), ("L", 0), ("s", 0), ("K", 0)];

/// A unit with the prefix that makes it `10^exponent` times as large; `None` where its first symbol
/// does not take it.
fn prefixed(unit_text: &str, exponent: i32) -> Option<String> {
    let end = unit_text.find(|c: char| !(c.is_alphabetic() || c == '\u{b5}')).unwrap_or(unit_text.len());
    let (symbol, rest) = unit_text.split_at(end);
    let takes = |symbol: &str| units::symbols().iter().any(|unit| unit.prefixed && unit.symbol == symbol);
    // A power belongs to the prefix too: a thousand cubic metres are not a cubic kilometre.
    if rest.starts_with('^')
        || rest.chars().next().is_some_and(is_superscript)
        || units::symbols().iter().any(|u| u.symbol == symbol && !u.prefixed)
    {
        return None;
    }
    let plain = takes(symbol).then_some((symbol, 0));
    let (base, now) = plain
        .or_else(|| PREFIXES.iter().find_map(|(prefix, power)| Some((symbol.strip_prefix(prefix).filter(|base| takes(base))?, *power))))?;
    let (prefix, power) = PREFIXES.iter().find(|(_, power)| *power == now + exponent)?;
    let fits = LARGEST.iter().all(|(unit, most)| *unit != base || power <= most);
    fits.then(|| format!("{prefix}{base}{rest}"))
}

/// Power of a thousand below a positive number.
pub(super) fn power_of_thousand(value: f64) -> i32 {
    3 * (value.log10() / 3.0 + 1e-9).floor() as i32
}

/// A number with five significant digits at most: `0.6590` is `0.659`, `2433073` is
/// `2.4331\u{d7}10\u{2076}`.
pub(crate) fn short(value: f64) -> String {
    const DIGITS: i32 = 5;
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0).replace('-', "\u{2212}");
    }
    let text = format!("{value:.*e}", DIGITS as usize - 1);
    let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = power.parse().unwrap_or_default();
    let out = if (-4..6).contains(&exponent) {
        trimmed(&format!("{value:.*}", (DIGITS - 1 - exponent).max(0) as usize)).to_owned()
    } else {
        let power: String = power.chars().map(superscript).collect();
        match trimmed(mantissa) {
            "1" => format!("10{power}"),
            "-1" => format!("-10{power}"),
            factor => format!("{factor}\u{d7}10{power}"),
        }
    };
    out.replace('-', "\u{2212}")
}

/// A number with its unit, in which it has few digits: `4.2 MJ/kg`, not `4200000 J/kg`.
pub(super) fn quantity(value: f64, unit_text: &str) -> String {
    let size = value.abs();
    let plain = size == 0.0 || !size.is_finite() || (1e-3..1e5).contains(&size);
    let exponent = if plain { 0 } else { power_of_thousand(size) };
    match prefixed(unit_text, exponent).filter(|_| exponent != 0) {
        Some(unit_text) => format!("{} {unit_text}", short(value / 10_f64.powi(exponent))),
        None => format!("{} {unit_text}", short(value)).trim_end().to_owned(),
    }
}

/// A time in the unit that the axis of a run of this length has.
pub(crate) fn duration(given_unit: &str, time: f64) -> String {
    let (name, factor) = readable_time(given_unit, time);
    format!("{} {}", short(time * factor), unit(&name)).trim_end().to_owned()
}

/// A number without zeros at the end of its decimals.
fn trimmed(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

fn is_superscript(c: char) -> bool {
    matches!(c, '\u{207b}' | '\u{b9}' | '\u{b2}' | '\u{b3}' | '\u{2070}'..='\u{2079}')
}

/// Units of time from short to long, in seconds.
const TIMES: [(&str, f64); 4] = [("s", 1.0), ("min", 60.0), ("h", 3600.0), ("d", 86_400.0)];

/// The unit in which a length of time is a number between about 1 and 500, and the factor to it;
/// the given one for unusual units.
pub(super) fn readable_time(given: &str, length: f64) -> (String, f64) {
    let Some(&(_, size)) = TIMES.iter().find(|(name, _)| *name == given) else { return (given.to_owned(), 1.0) };
    let fits = |&&(_, unit): &&(&str, f64)| (1.0..500.0).contains(&(length * size / unit));
    let keeps = (0.5..500.0).contains(&length);
    match TIMES.iter().find(fits) {
        Some(&(name, unit)) if !keeps => (name.to_owned(), size / unit),
        _ => (given.to_owned(), 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_written_as_people_do() {
        assert_eq!(unit("kmol/(m^3 min)"), "kmol/(m\u{b3} min)");
        assert_eq!(unit("kJ/(min m^2 degC)"), "kJ/(min m\u{b2} \u{b0}C)");
        assert_eq!(unit("m^2.5/min"), "m^2.5/min");
        assert_eq!(unit("m^-1"), "m\u{207b}\u{b9}");
        assert_eq!(unit("1"), "");
        assert_eq!(bracketed("cell/L", 9), "[10\u{2079} cell/L]");
        assert_eq!(bracketed("", 0), "");
    }

    #[test]
    fn long_times_are_told_in_longer_units() {
        assert_eq!(readable_time("min", 12_000.0), ("h".into(), 1.0 / 60.0));
        assert_eq!(readable_time("min", 10.0), ("min".into(), 1.0));
        assert_eq!(readable_time("h", 230.0), ("h".into(), 1.0));
        assert_eq!(readable_time("s", 86_400.0), ("h".into(), 1.0 / 3600.0));
        assert_eq!(readable_time("step", 1e9), ("step".into(), 1.0));
    }

    #[test]
    fn powers_of_a_thousand_are_prefixes_where_the_unit_takes_them() {
        let cases = [
            ("J/kg", 6, "MJ/kg"),
            ("L/min", -6, "\u{b5}L/min"),
            ("mL/min", -3, "\u{b5}L/min"),
            ("mg/L", 3, "g/L"),
            ("kJ", 3, "MJ"),
            ("mol/L", -9, "nmol/L"),
            ("Pa", 6, "MPa"),
            ("m", -3, "mm"),
            // Not in use, not prefixed, or a power of the unit.
            ("L", 3, "10\u{b3} L"),
            ("kg", 3, "10\u{b3} kg"),
            ("min", 3, "10\u{b3} min"),
            ("m\u{b3}/s", 3, "10\u{b3} m\u{b3}/s"),
            ("m^2.5/min", -3, "10\u{207b}\u{b3} m^2.5/min"),
            ("1/(cm L)", 6, "10\u{2076} 1/(cm L)"),
            ("", -3, "10\u{207b}\u{b3}"),
        ];
        for (unit, exponent, expected) in cases {
            assert_eq!(scaled(unit, exponent), expected, "{unit}, {exponent}");
        }
    }

    #[test]
    fn numbers_have_five_digits_and_a_prefix_in_place_of_a_power() {
        let cases = [
            (1999.9994, "2000"),
            (0.659, "0.659"),
            (-28.32715, "\u{2212}28.327"),
            (2_433_073.0, "2.4331\u{d7}10\u{2076}"),
            (4.9637e-6, "4.9637\u{d7}10\u{207b}\u{2076}"),
            (1e-8, "10\u{207b}\u{2078}"),
            (0.0, "0"),
        ];
        for (value, expected) in cases {
            assert_eq!(short(value), expected);
        }
        assert_eq!(quantity(2_433_073.0, "mg/h"), "2.4331 kg/h");
        assert_eq!(quantity(4.2e6, "J/kg"), "4.2 MJ/kg");
        assert_eq!(quantity(4.9637e-6, "s"), "4.9637 \u{b5}s");
        assert_eq!(quantity(26.85, "\u{b0}C"), "26.85 \u{b0}C");
        assert_eq!(quantity(0.0, "mL/min"), "0 mL/min");
    }

    #[test]
    fn a_duration_has_the_unit_of_the_axis() {
        assert_eq!(duration("min", 600.0), "10 h");
        assert_eq!(duration("s", 1800.0), "30 min");
        assert_eq!(duration("h", 12.0), "12 h");
        assert_eq!(duration("", 3.0), "3");
    }
}
