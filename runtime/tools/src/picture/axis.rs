//! Axes: round ticks, labels with as many digits as they need, and units as people write them.

/// An axis from `low` to `high` with its ticks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Places of the ticks.
    pub ticks: Vec<f64>,
    /// Labels are in units of ten to this.
    pub exponent: i32,
    decimals: usize,
}

impl Axis {
    /// An axis with about `most` ticks at most.
    pub(super) fn new(low: f64, high: f64, most: usize) -> Self {
        let step = round_step((high - low) / most.max(1) as f64);
        let first = (low / step - 1e-9).ceil();
        let count = ((high / step + 1e-9).floor() - first).clamp(0.0, 50.0) as usize;
        // A tick at zero is zero, not a rounding error.
        let ticks = (0..=count).map(|i| (first + i as f64) * step).map(|t| if t == 0.0 { 0.0 } else { t }).collect();
        let exponent = exponent(low.abs().max(high.abs()));
        let decimals = (f64::from(exponent) - step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
        Self { low, high, ticks, exponent, decimals }
    }

    /// Where a value lies, from 0 to 1.
    pub(super) fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Label of a tick.
    pub(super) fn label(&self, tick: f64) -> String {
        let text = format!("{:.*}", self.decimals, tick / 10_f64.powi(self.exponent));
        let zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
        // The minus sign proper is as wide as a plus.
        if zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "\u{2212}") }
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    if !(least.is_finite() && least > 0.0) {
        return 1.0;
    }
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// Powers of a thousand where numbers would have many digits.
fn exponent(largest: f64) -> i32 {
    if largest > 0.0 && largest.is_finite() && !(0.01..1e4).contains(&largest) {
        3 * (largest.log10() / 3.0 + 1e-9).floor() as i32
    } else {
        0
    }
}

/// The range for values: a little wider than they are, and never so narrow that labels need more than five digits. `None` where there is no value.
pub(super) fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return None;
    }
    let size = low.abs().max(high.abs());
    let changes = high - low > 1e-9 * size;
    let least = if size > 0.0 { size * if changes { 2e-3 } else { 0.1 } } else { 1.0 };
    let (middle, half) = (0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low).max(0.5 * least));
    Some((middle - 1.06 * half, middle + 1.06 * half))
}

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

/// Unit of an axis whose labels are in powers of ten: `[10³ L]`, with its brackets; nothing for plain numbers.
pub(super) fn bracketed(unit_text: &str, exponent: i32) -> String {
    let power = format!("10{}", exponent.to_string().chars().map(superscript).collect::<String>());
    match (unit_text.is_empty(), exponent) {
        (true, 0) => String::new(),
        (true, _) => format!("[{power}]"),
        (false, 0) => format!("[{unit_text}]"),
        (false, _) => format!("[{power} {unit_text}]"),
    }
}

/// A number for people: four significant digits.
pub(super) fn short(value: f64) -> String {
    smpl_runtime::failure::Short(value).to_string().replace('-', "\u{2212}")
}

/// Units of time from short to long, in seconds.
const TIMES: [(&str, f64); 4] = [("s", 1.0), ("min", 60.0), ("h", 3600.0), ("d", 86_400.0)];

/// The unit in which a length of time is a number between about 1 and 500, and the factor to it; the given one where it is none of the usual.
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

    fn labels(low: f64, high: f64, most: usize) -> Vec<String> {
        let axis = Axis::new(low, high, most);
        axis.ticks.iter().map(|t| axis.label(*t)).collect()
    }

    #[test]
    fn ticks_are_round_and_labels_have_the_digits_they_need() {
        assert_eq!(labels(0.0, 10.0, 5), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(-0.31, 0.29, 4), ["\u{2212}0.2", "0.0", "0.2"]);
        assert_eq!(labels(26.7, 27.0, 4), ["26.7", "26.8", "26.9", "27.0"]);
        assert_eq!(labels(0.0, 3.8e6, 4), ["0", "1", "2", "3"]);
        assert_eq!(Axis::new(0.0, 3.8e6, 4).exponent, 6);
        assert_eq!(Axis::new(0.0, 4.2e-5, 4).exponent, -6);
        assert_eq!(labels(0.0, 4.2e-5, 4), ["0", "20", "40"]);
    }

    #[test]
    fn a_constant_has_an_axis_of_few_digits() {
        let (low, high) = span([26.85, 26.85].into_iter()).expect("a value");
        assert!(low < 26.85 && 26.85 < high);
        assert!(labels(low, high, 5).iter().all(|label| label.len() <= 4), "{:?}", labels(low, high, 5));
        assert_eq!(span([f64::NAN].into_iter()), None);
        let (low, high) = span([0.0].into_iter()).expect("a value");
        assert!(low < 0.0 && high > 0.0);
    }

    #[test]
    fn the_range_of_the_largest_doubles_is_finite() {
        let (low, high) = span([-f64::MAX / 4.0, f64::MAX / 4.0].into_iter()).expect("values");
        assert!(low.is_finite() && high.is_finite());
    }

    #[test]
    fn units_are_written_as_people_do() {
        assert_eq!(unit("kmol/(m^3 min)"), "kmol/(m\u{b3} min)");
        assert_eq!(unit("kJ/(min m^2 degC)"), "kJ/(min m\u{b2} \u{b0}C)");
        assert_eq!(unit("m^2.5/min"), "m^2.5/min");
        assert_eq!(unit("m^-1"), "m\u{207b}\u{b9}");
        assert_eq!(unit("1"), "");
        assert_eq!(bracketed("L", -6), "[10\u{207b}\u{2076} L]");
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
}
