//! Many faults: the first are shown, the rest is counted.

use super::{Diagnostic, Severity, codes};

/// Most diagnostics that are shown of one compilation; the rest is counted.
pub const SHOWN: usize = 50;

/// Most diagnostics that are kept with their text, so that those shown are the first ones in the
/// order of the text.
const KEPT: usize = 1000;

/// Longer messages are cut in the middle.
const LONGEST: usize = 800;

/// Diagnostics as they are found: a thousand are kept, the rest is counted.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    kept: Vec<Diagnostic>,
    more: usize,
}

impl Faults {
    /// Adds one.
    pub fn push(&mut self, diagnostic: Diagnostic) {
        self.push_with(|| diagnostic);
    }

    /// Adds one that is made only if it is kept.
    pub fn push_with(&mut self, make: impl FnOnce() -> Diagnostic) {
        if self.has_room() {
            self.kept.push(make());
        } else {
            self.more += 1;
        }
    }

    /// Adds those of another list.
    pub fn append(&mut self, other: Faults) {
        self.more += other.more;
        other.kept.into_iter().for_each(|diagnostic| self.push(diagnostic));
    }

    /// Number of diagnostics, including those that are only counted.
    #[must_use]
    pub fn len(&self) -> usize {
        self.kept.len() + self.more
    }

    /// Returns `true` without diagnostics.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Returns `true` if one more would be kept.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.kept.len() < KEPT
    }

    /// Number of diagnostics that are only counted.
    #[must_use]
    pub fn more(&self) -> usize {
        self.more
    }

    /// Those that are kept.
    pub fn iter(&self) -> std::slice::Iter<'_, Diagnostic> {
        self.kept.iter()
    }

    /// Those that are kept, to be added to.
    pub fn iter_mut(&mut self) -> std::slice::IterMut<'_, Diagnostic> {
        self.kept.iter_mut()
    }

    /// The first one that a test accepts.
    pub fn find_mut(&mut self, accept: impl Fn(&Diagnostic) -> bool) -> Option<&mut Diagnostic> {
        self.kept.iter_mut().find(|d| accept(d))
    }

    /// Forgets all but the first `len`.
    pub fn truncate(&mut self, len: usize) {
        self.more = self.more.min(len.saturating_sub(self.kept.len()));
        self.kept.truncate(len);
    }

    /// Keeps all of the first `len`, and of the others those that a test accepts; what is only
    /// counted stays.
    pub fn retain_after(&mut self, len: usize, mut accept: impl FnMut(&Diagnostic) -> bool) {
        let mut at = 0;
        self.kept.retain(|diagnostic| {
            at += 1;
            at <= len || accept(diagnostic)
        });
    }

    /// Keeps those that a test accepts; what is only counted stays.
    pub fn retain(&mut self, accept: impl FnMut(&Diagnostic) -> bool) {
        self.kept.retain(accept);
    }

    /// Errors before warnings, both in the order of the text.
    pub fn sort(&mut self) {
        let place = |d: &Diagnostic| (d.severity != Severity::Error, d.primary.span.file, d.primary.span.start, d.primary.span.end);
        self.kept.sort_by_key(place);
    }

    /// The first ones; one more entry says how many follow, where they are too many to be read.
    #[must_use]
    pub fn shown(mut self) -> Vec<Diagnostic> {
        let rest = self.len() - self.kept.len().min(SHOWN);
        if rest > 0 {
            let place = self.kept.get(SHOWN).map_or_else(Default::default, |first| first.primary.span);
            self.kept.truncate(SHOWN);
            let what = if self.kept.iter().any(Diagnostic::is_error) { "fault" } else { "warning" };
            let message = if rest == 1 { format!("one more {what} is not shown") } else { format!("{rest} more {what}s are not shown") };
            let mut count = Diagnostic::warning(codes::MORE_FAULTS, message, place);
            count.severity = Severity::Info;
            self.kept.push(count.label("the first of them"));
        }
        self.kept.iter_mut().for_each(shorten);
        self.kept
    }
}

/// Cuts messages that quote very long names.
fn shorten(diagnostic: &mut Diagnostic) {
    let labels = diagnostic.secondary.iter_mut().chain([&mut diagnostic.primary]).map(|label| &mut label.text);
    for text in labels.chain([&mut diagnostic.message]).chain(&mut diagnostic.help).chain(&mut diagnostic.notes) {
        if text.len() > LONGEST {
            let (head, tail) = (text.floor_char_boundary(LONGEST / 2), text.ceil_char_boundary(text.len() - LONGEST / 2));
            *text = format!("{} ... {}", &text[..head], &text[tail..]);
        }
    }
}

impl<'f> IntoIterator for &'f Faults {
    type Item = &'f Diagnostic;
    type IntoIter = std::slice::Iter<'f, Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl std::ops::Index<usize> for Faults {
    type Output = Diagnostic;

    fn index(&self, at: usize) -> &Diagnostic {
        &self.kept[at]
    }
}

impl From<Vec<Diagnostic>> for Faults {
    fn from(list: Vec<Diagnostic>) -> Self {
        let mut faults = Self::default();
        list.into_iter().for_each(|diagnostic| faults.push(diagnostic));
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::{FileId, Span};

    fn fault(at: u32) -> Diagnostic {
        Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown name `a{at}`"), Span { file: FileId(0), start: at, end: at + 1 })
    }

    #[test]
    fn a_list_that_can_be_read_is_shown_wholly() {
        let faults = Faults::from((0..SHOWN as u32).map(fault).collect::<Vec<_>>());
        assert_eq!(faults.shown().len(), SHOWN);
    }

    #[test]
    fn what_is_too_much_to_read_is_counted() {
        let mut faults = Faults::from((0..70_000).rev().map(fault).collect::<Vec<_>>());
        assert_eq!((faults.len(), faults.more()), (70_000, 69_000));
        faults.sort();
        let shown = faults.shown();
        assert_eq!(shown.len(), SHOWN + 1);
        assert!(shown.windows(2).all(|pair| pair[0].primary.span.start < pair[1].primary.span.start));
        assert_eq!(shown[SHOWN].message, "69950 more faults are not shown");
        assert_eq!(shown[SHOWN].severity, Severity::Info);
    }

    #[test]
    fn what_is_forgotten_is_not_counted() {
        let mut faults = Faults::from((0..1500).map(fault).collect::<Vec<_>>());
        faults.truncate(1200);
        assert_eq!(faults.len(), 1200);
        faults.truncate(3);
        assert_eq!(faults.len(), 3);
    }
}
