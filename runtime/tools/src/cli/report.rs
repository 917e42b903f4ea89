//! Errors of commands, and display of diagnostics.

use std::fmt;
use std::io::{IsTerminal, Write};
use std::path::Path;

use miette::{GraphicalReportHandler, GraphicalTheme, LabeledSpan};
use smpl_dsl::diagnostic::{Diagnostic, Label, Severity, SourceMap, codes, printable};
use smpl_dsl::span::Span;

use super::excerpt::Excerpt;
use smpl_runtime::catalogue::Element;
use smpl_runtime::environment::{ResetError, StepError};
use smpl_runtime::load::LoadError;
use smpl_runtime::setup::SetupError;
use smpl_runtime::trajectory::{DataError, WriteError};

/// Reason why a command ends early.
#[derive(Debug)]
pub(super) enum Failed {
    /// Everything was reported already.
    Quiet(i32),
    /// A file or a value is invalid.
    Message(String),
    /// Faults with places.
    Diagnostics(Vec<Diagnostic>, std::sync::Arc<SourceMap>),
}

impl Failed {
    /// Prints the message; the exit status.
    pub(super) fn print(self) -> i32 {
        let text = match self {
            Failed::Quiet(status) => return status,
            Failed::Message(text) => text,
            Failed::Diagnostics(diagnostics, sources) => {
                print_diagnostics(&diagnostics, &sources);
                return 1;
            }
        };
        // Nothing is left to say where standard error is closed.
        let _ = writeln!(std::io::stderr(), "error: {}", printable(&text));
        1
    }
}

impl From<LoadError> for Failed {
    fn from(error: LoadError) -> Self {
        match error {
            LoadError::Diagnostics { sources, diagnostics } => Failed::Diagnostics(diagnostics, sources),
            other => Failed::Message(other.to_string()),
        }
    }
}

macro_rules! failed_by_message {
    ($($error:ty),*) => {
        $(impl From<$error> for Failed {
            fn from(error: $error) -> Self {
                Failed::Message(error.to_string())
            }
        })*
    };
}
failed_by_message!(
    smpl_compiler::artefact::ArtefactError,
    SetupError,
    ResetError,
    StepError,
    smpl_runtime::steady::SteadyError,
    smpl_runtime::catalogue::UnknownName,
    crate::picture::ShowError
);

/// A reader of the standard output that has gone away is not a fault.
impl From<WriteError> for Failed {
    fn from(error: WriteError) -> Self {
        match error.source.kind() {
            std::io::ErrorKind::BrokenPipe if smpl_runtime::files::is_standard_output(&error.path) => Failed::Quiet(0),
            _ => Failed::Message(error.to_string()),
        }
    }
}

/// Writes to standard error; nothing is left to say where it is closed.
pub(super) fn note(text: &str) {
    let _ = std::io::stderr().write_all(printable(text).as_bytes());
}

/// Warns of given values outside of the bounds of their quantities; `source` is where they are
/// given.
pub(super) fn warn_of_bounds<'e>(source: &str, given: impl Iterator<Item = (&'e Element, f64)>) {
    const SHOWN: usize = 8;
    let outside: Vec<String> = given.filter_map(|(element, value)| Some(element.check_bounds(value).err()?.to_string())).collect();
    for text in outside.iter().take(SHOWN) {
        note(&format!("warning: {source}: {text}\n"));
    }
    if outside.len() > SHOWN {
        note(&format!("warning: {source}: {} more values are outside their bounds\n", outside.len() - SHOWN));
    }
}

/// A fault in a data file is shown at its place in the file.
impl From<DataError> for Failed {
    fn from(error: DataError) -> Self {
        let place = match &error {
            DataError::Malformed { path, line, .. } => Some((path, *line, "")),
            DataError::NotANumber { path, line, text, .. } => Some((path, *line, text.as_str())),
            DataError::MissingColumns { path, .. } => Some((path, 1, "")),
            DataError::UnknownColumn { path, error } => Some((path, 1, error.name.as_str())),
            DataError::Measured { path, name } => Some((path, 1, name.as_str())),
            DataError::Read { .. } | DataError::Empty { .. } | DataError::NoSteps { .. } | DataError::NoDisturbances { .. } => None,
        };
        let shown = place.and_then(|(path, line, word)| data_diagnostic(path, line, word, &error));
        shown.unwrap_or_else(|| Failed::Message(error.to_string()))
    }
}

fn data_diagnostic(path: &Path, line: u64, word: &str, error: &DataError) -> Option<Failed> {
    let bytes = smpl_runtime::files::read(path).ok()?;
    let text = String::from_utf8_lossy(&bytes).into_owned();
    // Invalid UTF-8 is shown as such.
    let word = if std::str::from_utf8(&bytes).is_err() && word.is_empty() { "\u{fffd}" } else { word };
    let start: usize = text.split_inclusive('\n').take(line.saturating_sub(1) as usize).map(str::len).sum();
    let content = text.get(start..)?.lines().next().unwrap_or_default().to_owned();
    let (at, length) = match content.find(word).filter(|_| !word.is_empty()) {
        Some(at) => (start + at, word.len()),
        None => (start, content.len()),
    };
    let full = error.to_string();
    let message = full.split_once(": ").map_or(full.as_str(), |(_, message)| message).to_owned();
    let mut sources = SourceMap::new();
    let file = sources.add(path.display().to_string(), text);
    let span = Span { file, start: at as u32, end: (at + length) as u32 };
    Some(Failed::Diagnostics(vec![Diagnostic::error(codes::BAD_DATA, message, span)], std::sync::Arc::new(sources)))
}

/// Prints diagnostics on standard error: place, source line underlined, what to do.
pub(super) fn print_diagnostics(diagnostics: &[Diagnostic], sources: &SourceMap) {
    let mut err = std::io::stderr().lock();
    for diagnostic in diagnostics {
        // Nothing is left to say where standard error is closed.
        let _ = err.write_all(render(diagnostic, sources, std::io::stderr().is_terminal()).as_bytes());
    }
}

/// A diagnostic as text.
pub(super) fn render(diagnostic: &Diagnostic, sources: &SourceMap, coloured: bool) -> String {
    let theme = if coloured { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
    let handler = GraphicalReportHandler::new_themed(theme).with_width(110).with_links(false);
    let mut text = String::new();
    match handler.render_report(&mut text, &Shown::new(diagnostic, sources)) {
        Ok(()) => text,
        // The place alone: better than nothing where the graphical form cannot be made.
        Err(_) => {
            let at = sources.locate(diagnostic.primary.span);
            let file = sources.name(diagnostic.primary.span.file);
            printable(&format!("{file}:{}:{}: {} [{}]\n", at.line, at.column, diagnostic.message, diagnostic.code.id())).into_owned()
        }
    }
}

/// A diagnostic in the words of the renderer.
#[derive(Debug)]
struct Shown {
    message: String,
    code: &'static str,
    severity: Severity,
    help: Option<String>,
    labels: Vec<LabeledSpan>,
    source: Excerpt,
}

impl Shown {
    fn new(diagnostic: &Diagnostic, sources: &SourceMap) -> Self {
        let file = diagnostic.primary.span.file;
        let text = sources.file(file).map_or("", |f| f.text());
        let (here, elsewhere): (Vec<_>, Vec<_>) = diagnostic.secondary.iter().partition(|l| l.span.file == file);
        // Marks within marks cannot be drawn: where labelled parts lie inside of the whole, they
        // are shown alone.
        let whole = diagnostic.primary.span;
        let inside = |l: &Label| whole.start <= l.span.start && l.span.end <= whole.end;
        let parts_alone = diagnostic.primary.text.is_empty() && here.iter().any(|l| inside(l));
        let marked: Vec<&Label> = (!parts_alone).then_some(&diagnostic.primary).into_iter().chain(here).collect();
        let spans: Vec<Span> = marked.iter().map(|label| label.span).collect();
        let (source, places) = Excerpt::new(sources.name(file), text, &spans);
        let mut labels = Vec::new();
        let mut remote: Vec<&Label> = elsewhere;
        for (&label, place) in marked.iter().zip(places) {
            let text = (!label.text.is_empty()).then(|| printable(&label.text).into_owned());
            match place {
                Some(place) if std::ptr::eq(label, &raw const diagnostic.primary) => {
                    labels.push(LabeledSpan::new_primary_with_span(text, place))
                }
                Some(place) => labels.push(LabeledSpan::new_with_span(text, place)),
                None => remote.push(label),
            }
        }
        let remote = remote.iter().filter(|l| !l.text.is_empty()).map(|l| {
            let at = sources.locate(l.span);
            format!("{} ({}:{}:{})", l.text, sources.name(l.span.file), at.line, at.column)
        });
        let help: Vec<String> = diagnostic.help.iter().cloned().chain(diagnostic.notes.iter().cloned()).chain(remote).collect();
        Self {
            message: printable(&diagnostic.message).into_owned(),
            code: diagnostic.code.id(),
            severity: diagnostic.severity,
            help: (!help.is_empty()).then(|| printable(&help.join("\n")).into_owned()),
            labels,
            source,
        }
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Shown {}

impl miette::Diagnostic for Shown {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(self.code))
    }

    fn severity(&self) -> Option<miette::Severity> {
        Some(match self.severity {
            Severity::Error => miette::Severity::Error,
            Severity::Warning => miette::Severity::Warning,
            Severity::Info => miette::Severity::Advice,
        })
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        Some(&self.source)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        Some(Box::new(self.labels.iter().cloned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use smpl_dsl::diagnostic::codes;

    /// The diagnostic at a word of a text, with a label at another one.
    fn shown(text: &str, word: &str, other: &str) -> String {
        let mut sources = SourceMap::new();
        let file = sources.add("m.eq", text);
        let span = |word: &str| {
            let at = text.rfind(word).expect("in the text");
            Span { file, start: at as u32, end: (at + word.len()) as u32 }
        };
        let fault = Diagnostic::error(codes::UNKNOWN_NAME, "unknown", span(word)).label("here").secondary(span(other), "and there");
        render(&fault, &sources, false)
    }

    /// Columns beyond 65,535 made the renderer panic; and all of the line was printed.
    #[test]
    fn a_mark_far_to_the_right_is_shown_with_what_is_near_it() {
        for filling in [" ", "\t", "1 + ", "\u{b5}"] {
            let before = format!("let a = first + {}", filling.repeat(70_000));
            let text = format!("state x = 1\n{before}nope + 2{}\nlet b = 1\n", " + 1".repeat(9000));
            let out = shown(&text, "nope", "first");
            assert!(out.len() < 4000, "{} bytes", out.len());
            assert!(out.contains("nope + 2") && !out.contains("first"), "{out}");
            assert!(out.contains("and there (m.eq:2:9)"), "{out}");
            let column = before.chars().count() + 1;
            let bytes = before.len() + 1;
            assert!(out.contains(&format!("m.eq:2:{column}]")) || out.contains(&format!("m.eq:2:{bytes}]")), "{out}");
        }
    }

    #[test]
    fn marks_of_distant_lines_are_told_under_their_numbers() {
        let text = format!("let first = 1\n{}let a = nope\n", "let b = 1\n".repeat(5000));
        let out = shown(&text, "nope", "first");
        assert!(out.contains("m.eq:5002:9") && out.contains("5002 ") && out.contains("and there (m.eq:1:5)"), "{out}");
        let near = shown("let first = 1\nlet b = 1\nlet c = 1\nlet d = 1\nlet e = 1\nlet a = nope", "nope", "first");
        assert!(near.contains(" 1 ") && near.contains(" 6 ") && near.contains("and there") && !near.contains("(m.eq"), "{near}");
    }
}
