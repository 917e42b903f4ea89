//! Edits from one text to another, line by line.

use std::ops::Range;

use smpl_analysis::position::Lines;

/// Replacements of bytes that make `new` of `old`, as small as whole lines allow.
pub(super) fn between(old: &str, new: &str) -> Vec<(Range<usize>, String)> {
    let lines = Lines::new(old);
    let (before, after): (Vec<&str>, Vec<&str>) = (old.split_inclusive('\n').collect(), new.split_inclusive('\n').collect());
    let start = |line: usize| lines.start(line);
    if before.len() == after.len() {
        let changed = before.iter().zip(&after).enumerate().filter(|(_, (a, b))| a != b);
        return changed.map(|(i, (a, b))| (start(i)..start(i) + a.len(), (*b).to_owned())).collect();
    }
    let same = before.iter().zip(&after).take_while(|(a, b)| a == b).count();
    let rest = before.len().min(after.len()) - same;
    let tail = before.iter().rev().zip(after.iter().rev()).take(rest).take_while(|(a, b)| a == b).count();
    let end = if before.len() - tail == before.len() { old.len() } else { start(before.len() - tail) };
    vec![(start(same)..end, after[same..after.len() - tail].concat())]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worked_in(old: &str, new: &str) -> String {
        let mut text = old.to_owned();
        for (range, with) in between(old, new).into_iter().rev() {
            text.replace_range(range, &with);
        }
        text
    }

    #[test]
    fn edits_lead_from_one_text_to_the_other() {
        let texts = ["", "a\n", "a\nb\nc\n", "a\nx\nc\n", "a\nc\n", "b\nc\nd", "a\n\nb\nc", "c\n"];
        for old in texts {
            for new in texts {
                assert_eq!(worked_in(old, new), new, "{old:?}");
            }
        }
    }
}
