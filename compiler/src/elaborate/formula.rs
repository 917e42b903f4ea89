//! Formulas of species: `C6H12O6`, `CH1.8O0.5N0.2`, `Ca(OH)2`, `NH4+`, `SO4-2`.

use std::collections::BTreeMap;

/// The charge among the elements.
pub(super) const CHARGE: &str = "charge";

/// Elements with their numbers, in one molecule.
pub(super) type Formula = BTreeMap<String, f64>;

/// Reads a formula; `None` where the text is not one.
pub(super) fn read(text: &str) -> Option<Formula> {
    let (body, charge) = split_charge(text.trim())?;
    let mut reader = Reader { rest: body };
    let mut formula = reader.group(0)?;
    if !reader.rest.is_empty() || body.is_empty() {
        return None;
    }
    if charge != 0.0 {
        formula.insert(CHARGE.to_owned(), charge);
    }
    Some(formula)
}

/// The charge at the end: `+`, `--`, `+2`, `-0.5`.
fn split_charge(text: &str) -> Option<(&str, f64)> {
    let Some(at) = text.find(['+', '-']) else { return Some((text, 0.0)) };
    let (body, charge) = text.split_at(at);
    let sign = if charge.starts_with('+') { 1.0 } else { -1.0 };
    let signs = charge.len() - charge.trim_start_matches(&charge[..1]).len();
    match &charge[signs..] {
        "" => Some((body, sign * signs as f64)),
        number if signs == 1 => Some((body, sign * number.parse::<f64>().ok().filter(|x| x.is_finite() && *x > 0.0)?)),
        _ => None,
    }
}

/// Deepest parentheses.
const MAX_DEPTH: usize = 16;

struct Reader<'t> {
    rest: &'t str,
}

impl Reader<'_> {
    /// Elements and groups up to a closing parenthesis or the end.
    fn group(&mut self, depth: usize) -> Option<Formula> {
        let mut out = Formula::new();
        while let Some(first) = self.rest.chars().next().filter(|c| *c != ')') {
            let part = if first == '(' {
                self.rest = &self.rest[1..];
                let inner = if depth < MAX_DEPTH { self.group(depth + 1)? } else { return None };
                self.rest = self.rest.strip_prefix(')')?;
                inner
            } else {
                Formula::from([(self.element()?, 1.0)])
            };
            let number = self.number()?;
            for (element, n) in part {
                *out.entry(element).or_default() += n * number;
            }
        }
        Some(out)
    }

    /// A capital letter and the small ones behind it.
    fn element(&mut self) -> Option<String> {
        let bytes = self.rest.as_bytes();
        if !bytes.first()?.is_ascii_uppercase() {
            return None;
        }
        let length = 1 + bytes[1..].iter().take_while(|b| b.is_ascii_lowercase()).count();
        let (element, rest) = self.rest.split_at(length);
        self.rest = rest;
        (length <= 3).then(|| element.to_owned())
    }

    /// The number behind an element or a group; 1 if omitted.
    fn number(&mut self) -> Option<f64> {
        let length = self.rest.bytes().take_while(|b| b.is_ascii_digit() || *b == b'.').count();
        let (number, rest) = self.rest.split_at(length);
        self.rest = rest;
        if number.is_empty() { Some(1.0) } else { number.parse::<f64>().ok().filter(|x| x.is_finite()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Vec<(String, f64)> {
        read(text).map(|formula| formula.into_iter().collect()).unwrap_or_default()
    }

    fn list(parts: &[(&str, f64)]) -> Vec<(String, f64)> {
        parts.iter().map(|(element, n)| ((*element).to_owned(), *n)).collect()
    }

    #[test]
    fn elements_groups_and_charges_are_counted() {
        assert_eq!(of("C6H12O6"), list(&[("C", 6.0), ("H", 12.0), ("O", 6.0)]));
        assert_eq!(of("CH1.8O0.5N0.2"), list(&[("C", 1.0), ("H", 1.8), ("N", 0.2), ("O", 0.5)]));
        assert_eq!(of("Ca(OH)2"), list(&[("Ca", 1.0), ("H", 2.0), ("O", 2.0)]));
        assert_eq!(of("NH4+"), list(&[("H", 4.0), ("N", 1.0), ("charge", 1.0)]));
        assert_eq!(of("SO4--"), of("SO4-2"));
        assert_eq!(of("CH3COOH"), list(&[("C", 2.0), ("H", 4.0), ("O", 2.0)]));
    }

    #[test]
    fn other_texts_are_not_formulas() {
        for text in ["", "glucose", "6C", "C6H12O6)", "(C", "C..5", "C 6", "NaCl+-", "+", "Xyzzy"] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}
