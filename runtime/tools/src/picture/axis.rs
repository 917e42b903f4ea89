//! Axes: round ticks, and labels with as many digits as they need.

use super::quantity::{power_of_thousand, short};

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
    /// An axis with about `most` ticks, and never fewer than two: one tick gives no scale.
    pub(super) fn new(low: f64, high: f64, most: usize) -> Self {
        let steps = (most.max(1)..most.max(1) + 8).map(|n| round_step((high - low) / n as f64));
        let places = |step: f64| ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
        let (mut step, mut first, mut last) = (1.0, 0.0, 0.0);
        for finer in steps {
            step = finer;
            (first, last) = places(step);
            if last > first {
                break;
            }
        }
        let count = (last - first).clamp(0.0, 50.0) as usize;
        // A tick at zero is zero, not a rounding error.
        let ticks = (0..=count).map(|i| (first + i as f64) * step).map(|t| if t == 0.0 { 0.0 } else { t }).collect();
        let exponent = exponent(low.abs().max(high.abs()));
        let decimals = (f64::from(exponent) - step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
        Self { low, high, ticks, exponent, decimals }
    }

    /// Position of a value, from 0 to 1.
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

    /// Label of a value that no tick marks, as a bound; `None` where a tick has its place.
    pub(super) fn label_between(&self, value: f64) -> Option<String> {
        let near = 1e-9 * (self.high - self.low);
        let is_marked = self.ticks.iter().any(|tick| (tick - value).abs() <= near);
        (!is_marked).then(|| short(value / 10_f64.powi(self.exponent)))
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
    if largest > 0.0 && largest.is_finite() && !(0.01..1e4).contains(&largest) { power_of_thousand(largest) } else { 0 }
}

/// The range for values: a little wider than they are, and never so narrow that labels need more
/// than five digits. `None` where there is no value.
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
    fn every_axis_has_at_least_two_ticks() {
        for low in [-3.7, 0.0, 0.26, 0.93, 1.06, 12.4, 997.0] {
            for width in [0.011, 0.07, 0.19, 0.5, 0.96, 1.9, 3.3, 7.7, 88.0] {
                for most in 1..9 {
                    let axis = Axis::new(low, low + width, most);
                    assert!(axis.ticks.len() >= 2, "{low} to {}, {most}: {:?}", low + width, axis.ticks);
                    assert!(axis.ticks.iter().all(|t| *t >= low - 1e-9 * width && *t <= low + width * (1.0 + 1e-9)));
                }
            }
        }
    }
}
