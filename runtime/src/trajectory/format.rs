//! Numbers as text.

use std::fmt::Write;

use super::Cell;

/// Appends a cell that is not a text.
pub(super) fn cell(cell: Cell, out: &mut String) {
    // Writing into a string cannot fail.
    let _ = match cell {
        Cell::Empty | Cell::Text(_) => Ok(()),
        Cell::Integer(i) => write!(out, "{i}"),
        Cell::Natural(n) => write!(out, "{n}"),
        Cell::Flag(flag) => write!(out, "{flag}"),
        Cell::Number(x) => {
            seventeen_digits(x, out);
            Ok(())
        }
    };
}

/// Appends a number with 17 significant digits, as C's `%.17g` does: what is read back is the same
/// double.
pub fn seventeen_digits(x: f64, out: &mut String) {
    if !x.is_finite() {
        out.push_str(if x.is_nan() {
            "NaN"
        } else if x > 0.0 {
            "inf"
        } else {
            "-inf"
        });
        return;
    }
    let text = format!("{x:.16e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-5..17).contains(&exponent) {
        let decimals = (16 - exponent) as usize;
        out.push_str(without_idle_zeros(&format!("{x:.decimals$}")));
    } else {
        let sign = if exponent < 0 { '-' } else { '+' };
        // Writing into a string cannot fail.
        let _ = write!(out, "{}e{sign}{:02}", without_idle_zeros(mantissa), exponent.abs());
    }
}

fn without_idle_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(x: f64) -> String {
        let mut out = String::new();
        seventeen_digits(x, &mut out);
        out
    }

    /// Right sides: Python's `'%.17g' % x`.
    #[test]
    fn numbers_have_seventeen_significant_digits() {
        let cases = [
            (0.1, "0.10000000000000001"),
            (0.0, "0"),
            (-2.0, "-2"),
            (51.346_608_37, "51.346608369999998"),
            (1e-8, "1e-08"),
            (7.2e10, "72000000000"),
            (1.0 / 3.0, "0.33333333333333331"),
            (1e300, "1.0000000000000001e+300"),
        ];
        for (x, expected) in cases {
            assert_eq!(text(x), expected);
        }
    }

    #[test]
    fn every_double_comes_back() {
        let mut bits = 0x3ff0_0000_0000_0001_u64;
        for _ in 0..20_000 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let x = f64::from_bits(bits);
            if x.is_finite() {
                assert_eq!(text(x).parse(), Ok(x));
            }
        }
    }
}
