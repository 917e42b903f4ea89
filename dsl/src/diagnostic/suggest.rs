//! "Did you mean": the nearest known name by edit distance.

/// The candidate nearest to `name`, if one is near enough: within a third of its length, at least
/// one edit. A difference of case or of underscores alone is always near enough. Names of one or
/// two letters are matched only so, or where a letter was doubled.
#[must_use]
pub fn suggest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = name.chars().count();
    let limit = if letters < 3 { 0 } else { (letters / 3).max(1) };
    let edits = |candidate: &str| {
        if folded(candidate).eq(folded(name)) || doubled(name, candidate) {
            return 0;
        }
        // No fewer edits than the difference of their lengths.
        if candidate.chars().count().abs_diff(letters) > limit { usize::MAX } else { distance(name, candidate) }
    };
    candidates
        .into_iter()
        .filter(|candidate| *candidate != name)
        .map(|candidate| (edits(candidate), candidate))
        .filter(|(edits, _)| *edits <= limit)
        .min_by(|a, b| a.0.cmp(&b.0).then_with(|| a.1.cmp(b.1)))
        .map(|(_, candidate)| candidate)
}

/// "did you mean `k_0`?" for the nearest candidate.
#[must_use]
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    suggest(name, candidates).map(|candidate| format!("did you mean `{candidate}`?"))
}

/// `rr` for `r`.
fn doubled(name: &str, candidate: &str) -> bool {
    let mut letters: Vec<char> = name.chars().collect();
    letters.dedup();
    letters.len() < name.chars().count() && letters.iter().copied().eq(candidate.chars())
}

/// The letters without case and underscores.
fn folded(name: &str) -> impl Iterator<Item = char> + '_ {
    name.chars().filter(|c| *c != '_').flat_map(char::to_lowercase)
}

/// Edits (insert, delete, replace, swap neighbours) between two words. Words that are longer than
/// any name are as far as they are long.
fn distance(a: &str, b: &str) -> usize {
    let (letters, others) = (a.chars().count(), b.chars().count());
    let longest = letters.max(others);
    if letters.abs_diff(others) > 8 || longest > 64 { longest } else { strsim::osa_distance(a, b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_underscore_or_swapped_letters_find_the_name() {
        assert_eq!(suggest("k0", ["k_1", "k_0"]), Some("k_0"));
        assert_eq!(suggest("parma", ["state", "param"]), Some("param"));
        assert_eq!(suggest("q_Out", ["q_in", "q_out"]), Some("q_out"));
    }

    #[test]
    fn a_doubled_letter_is_seen_in_short_names_too() {
        assert_eq!(suggest("rr", ["q", "r"]), Some("r"));
        assert_eq!(suggest("rr", ["q", "s"]), None);
    }

    #[test]
    fn unrelated_names_are_not_suggested() {
        assert_eq!(suggest("T", ["V", "h"]), None);
        assert_eq!(suggest("pressure", ["volume", "c_A"]), None);
    }
}
