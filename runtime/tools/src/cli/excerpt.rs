//! Excerpt of a text for a diagnostic: the lines around its marks, long ones shortened.

use std::borrow::Cow;

use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};
use smpl_dsl::diagnostic::printable;
use smpl_dsl::span::Span;

/// Longer lines are cut: they are unreadable, and the renderer cannot count their columns.
const LONG_LINE: usize = 400;
/// Length of the part of a line shown before its first mark.
const BEFORE: usize = 100;
/// Marks farther away from the first one than this are described in words.
const FAR: usize = 1000;
/// A mark over more lines is drawn on the first one only.
const TALL: usize = 8;

/// Some lines of a text under their own numbers.
#[derive(Debug)]
pub(super) struct Excerpt {
    name: String,
    text: String,
    /// Number of the first line, from 0.
    first: usize,
    lines: Vec<Line>,
}

/// A line of the text, and the part of it that is shown.
#[derive(Debug)]
struct Line {
    /// Start and end in the text.
    start: usize,
    end: usize,
    /// The part that is shown.
    from: usize,
    to: usize,
    /// Start of that part in the excerpt.
    at: usize,
}

impl Excerpt {
    /// The lines around marks, the first of which is shown in any case, and where the marks are in
    /// them; `None` for a mark that is not there.
    pub(super) fn new(name: &str, text: &str, marks: &[Span]) -> (Self, Vec<Option<SourceSpan>>) {
        let marks: Vec<(usize, usize)> = marks.iter().map(|mark| clipped(text, *mark)).collect();
        let main = marks.first().map_or(0, |mark| mark.0);
        let near = |at: usize| text[at.min(main)..at.max(main)].bytes().filter(|b| *b == b'\n').count() <= FAR;
        let starts: Vec<usize> = marks.iter().map(|mark| mark.0).filter(|&at| near(at)).collect();
        let lowest = starts.iter().copied().min().unwrap_or(0);
        let start = line_start(text, line_start(text, lowest).saturating_sub(1));
        let highest = marks.iter().filter(|mark| near(mark.0)).map(|mark| mark.1).max().unwrap_or(0);
        let end = line_end(text, (line_end(text, highest) + 1).min(text.len()));
        let mut excerpt =
            Self { name: printable(name).into_owned(), text: String::new(), first: count_lines(text, start), lines: Vec::new() };
        let mut at = start;
        for content in text[start..end].split('\n') {
            excerpt.push(text, at, content.len(), &starts);
            at += content.len() + 1;
        }
        let places = marks.iter().map(|&mark| excerpt.place(text, mark)).collect();
        (excerpt, places)
    }

    /// Adds a line, or the part of it around its first mark.
    fn push(&mut self, text: &str, start: usize, length: usize, marks: &[usize]) {
        let end = start + length;
        let (mut from, mut to) = (start, end);
        if length > LONG_LINE {
            let mark = marks.iter().copied().find(|mark| (start..=end).contains(mark)).unwrap_or(start);
            from = text.ceil_char_boundary(mark.saturating_sub(BEFORE).max(start));
            to = text.floor_char_boundary((from + LONG_LINE).min(end));
        }
        if !self.lines.is_empty() {
            self.text.push('\n');
        }
        self.lines.push(Line { start, end, from, to, at: self.text.len() });
        self.text.push_str(&shown(&text[from..to]));
    }

    /// A mark in the excerpt.
    fn place(&self, text: &str, (start, end): (usize, usize)) -> Option<SourceSpan> {
        let line_of = |at: usize| self.lines.iter().find(|line| (line.start..=line.end).contains(&at));
        let place_in = |line: &Line, at: usize| line.at + shown(&text[line.from..at.clamp(line.from, line.to)]).len();
        let first = line_of(start).filter(|line| (line.from..=line.to).contains(&start))?;
        let last = line_of(end)?;
        let (begin, stop) = (place_in(first, start), place_in(last, end));
        Some((begin, stop.saturating_sub(begin)).into())
    }
}

impl SourceCode for Excerpt {
    fn read_span<'a>(&'a self, span: &SourceSpan, before: usize, after: usize) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let contents = self.text.read_span(span, before, after)?;
        let line = contents.line();
        // A place that is asked for alone is described in words: the columns that were cut off
        // count.
        let cut = self.lines.get(line).filter(|_| before == 0).map_or(0, |line| line.from - line.start);
        let column = contents.column() + cut;
        let span = *contents.span();
        let all = MietteSpanContents::new_named(self.name.clone(), contents.data(), span, self.first + line, column, contents.line_count());
        Ok(Box::new(all))
    }
}

/// A mark within the text, on one line if it were too tall.
fn clipped(text: &str, mark: Span) -> (usize, usize) {
    let start = text.floor_char_boundary((mark.start as usize).min(text.len()));
    let end = text.floor_char_boundary((mark.end as usize).clamp(start, text.len()));
    let lines = text[start..end].bytes().filter(|b| *b == b'\n').count();
    (start, if lines > TALL { line_end(text, start) } else { end })
}

/// A part of a line as it is shown; of a line end of two characters nothing.
fn shown(part: &str) -> Cow<'_, str> {
    printable(part.trim_end_matches('\r'))
}

fn line_start(text: &str, at: usize) -> usize {
    text.as_bytes()[..at].iter().rposition(|b| *b == b'\n').map_or(0, |newline| newline + 1)
}

fn line_end(text: &str, at: usize) -> usize {
    text.as_bytes()[at..].iter().position(|b| *b == b'\n').map_or(text.len(), |length| at + length)
}

fn count_lines(text: &str, end: usize) -> usize {
    text.as_bytes()[..end].iter().filter(|b| **b == b'\n').count()
}
