//! Sweeps: names with the values that they are to take, and all combinations of several of them.

use smpl_runtime::scenario::Value;

/// A name and the values that it takes one after another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sweep {
    /// A parameter, setting, variant, choice, initial value, or `scenario` or `policy`.
    pub name: String,
    /// The values.
    pub values: Vec<Value>,
}

/// Most values of a sweep.
const MOST_VALUES: usize = 100_000;

impl Sweep {
    /// Reads `NAME=LOW..HIGH:COUNT` (evenly spaced, the ends included; `:COUNTlog` by equal
    /// factors) or `NAME=A,B,C`.
    ///
    /// # Errors
    /// In words, what is expected.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected NAME=LOW..HIGH:COUNT or NAME=VALUE,VALUE,..., found `{text}`");
        let (name, values) = text.split_once('=').ok_or_else(wrong)?;
        let (name, values) = (name.trim(), values.trim());
        if name.is_empty() || values.is_empty() {
            return Err(wrong());
        }
        let values = match values.split_once("..") {
            Some((low, rest)) => range(low, rest)?,
            None => list(values).ok_or_else(wrong)?,
        };
        Ok(Self { name: name.to_owned(), values: values.into_iter().collect() })
    }
}

/// Values between commas, but not those within brackets.
fn list(text: &str) -> Option<Vec<Value>> {
    let names = crate::picture::split_names(text);
    let separators = text.matches(',').count() - names.iter().map(|name| name.matches(',').count()).sum::<usize>();
    (separators + 1 == names.len()).then(|| names.iter().map(|value| Value::parse(value)).collect())
}

fn range(low: &str, rest: &str) -> Result<Vec<Value>, String> {
    let (high, count) = rest.split_once(':').ok_or("a range has a number of values: LOW..HIGH:COUNT")?;
    let number = |text: &str| {
        let number = text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| format!("`{}` is not a number", text.trim()))
    };
    let (low, high) = (number(low)?, number(high)?);
    let (count, logarithmic) = match count.trim().strip_suffix("log") {
        Some(count) => (count, true),
        None => (count.trim(), false),
    };
    let count: usize = count
        .parse()
        .ok()
        .filter(|n| (1..=MOST_VALUES).contains(n))
        .ok_or_else(|| format!("the number of values must be a whole number from 1 to {MOST_VALUES}, not `{count}`"))?;
    if logarithmic && !(low > 0.0 && high > 0.0) {
        return Err("the ends of a logarithmic range must be positive".into());
    }
    let at = |i: usize| match i {
        0 => low,
        i if i + 1 == count => high,
        i if logarithmic => low * (high / low).powf(i as f64 / (count - 1) as f64),
        i => low + (high - low) * (i as f64 / (count - 1) as f64),
    };
    Ok((0..count).map(|i| Value::Number(at(i))).collect())
}

/// Number of all combinations; `None` beyond what can be counted.
#[must_use]
pub(crate) fn combinations(sweeps: &[Sweep]) -> Option<usize> {
    sweeps.iter().try_fold(1_usize, |n, sweep| n.checked_mul(sweep.values.len()))
}

/// The combination of that number: one value a sweep; the last sweep goes fastest.
#[must_use]
pub(crate) fn combination(sweeps: &[Sweep], index: usize) -> Vec<&Value> {
    let mut rest = index;
    let mut values: Vec<&Value> = sweeps
        .iter()
        .rev()
        .map(|sweep| {
            let value = &sweep.values[rest % sweep.values.len()];
            rest /= sweep.values.len();
            value
        })
        .collect();
    values.reverse();
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<String> {
        Sweep::parse(text).expect("a sweep").values.iter().map(Value::to_string).collect()
    }

    #[test]
    fn ranges_have_both_ends_and_lists_their_values() {
        assert_eq!(values("k=1..2:5"), ["1", "1.25", "1.5", "1.75", "2"]);
        assert_eq!(values("k=1..100:3log"), ["1", "10", "100"]);
        assert_eq!(values("k=-1..1:1"), ["-1"]);
        assert_eq!(values("scenario=default, legacy"), ["default", "legacy"]);
        assert_eq!(values("v=[1, 2],[3, 4]").len(), 2);
    }

    #[test]
    fn what_is_no_sweep_is_refused() {
        for text in ["k", "k=", "=1..2:3", "k=1..2", "k=1..2:0", "k=a..2:3", "k=0..2:3log", "k=1,,2", "k=1..2:1e9"] {
            assert!(Sweep::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sweeps_are_crossed() {
        let sweeps = ["a=1,2", "b=3,4,5"].map(|text| Sweep::parse(text).expect("a sweep"));
        assert_eq!(combinations(&sweeps), Some(6));
        let all: Vec<String> =
            (0..6).map(|i| combination(&sweeps, i).iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" ")).collect();
        assert_eq!(all, ["1 3", "1 4", "1 5", "2 3", "2 4", "2 5"]);
    }
}
