//! Looking up in lists of numbers.

/// Number of ascending limits below a number, and with `up_to` the one equal to it.
#[must_use]
pub fn passed(limits: &[f64], up_to: bool, x: f64) -> f64 {
    if x.is_nan() {
        return x;
    }
    limits.partition_point(|&limit| if up_to { limit <= x } else { limit < x }) as f64
}

/// The number at an index, the first or the last beyond the ends; NaN for a NaN index or without
/// numbers.
#[must_use]
pub fn entry(numbers: &[f64], index: f64) -> f64 {
    let last = numbers.len().saturating_sub(1);
    if index.is_nan() { index } else { numbers.get((index as usize).min(last)).copied().unwrap_or(f64::NAN) }
}
