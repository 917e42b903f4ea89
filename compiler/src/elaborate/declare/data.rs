//! Tables of numbers in files: `k.csv` with the header `T [degC],k [1/min]`.

use std::ops::Range;

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Ident, UnitExpr};

/// Most bytes of a file of data.
const MAX_BYTES: usize = 16 << 20;
/// Most points of a table.
pub(super) const MAX_POINTS: usize = 200_000;

/// A cell and its place.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell<'t> {
    pub text: &'t str,
    pub span: Span,
}

/// The rows of a file, the header first. Empty lines and lines that begin with `#` are left out.
pub(super) fn rows(text: &str, file: FileId) -> Result<Vec<Vec<Cell<'_>>>, Diagnostic> {
    if text.len() > MAX_BYTES {
        let message = format!("the file has {} bytes; a table may have {MAX_BYTES}", text.len());
        return Err(Diagnostic::error(codes::TOO_LARGE, message, Span { file, start: 0, end: 0 }));
    }
    let mut out = Vec::new();
    let mut at = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
    for line in text[at..].split_inclusive('\n') {
        let content = line.trim_end_matches(['\n', '\r']);
        if !content.trim().is_empty() && !content.trim_start().starts_with('#') {
            out.push(cells(content, at, file));
        }
        at += line.len();
    }
    if out.len() > MAX_POINTS {
        let message = format!("the file has {} rows; a table may have {MAX_POINTS}", out.len());
        return Err(Diagnostic::error(codes::TOO_LARGE, message, Span { file, start: 0, end: 0 }));
    }
    Ok(out)
}

/// The cells of a line that begins at a byte of its file. A cell may be in quotes.
fn cells(line: &str, start: usize, file: FileId) -> Vec<Cell<'_>> {
    let (mut out, mut from, mut quoted) = (Vec::new(), 0, false);
    let mut push = |range: Range<usize>| {
        let raw = &line[range.clone()];
        let inner = raw.trim().trim_matches('"').trim();
        let skipped = if inner.is_empty() { 0 } else { raw.find(inner).unwrap_or(0) };
        let first = (start + range.start + skipped) as u32;
        out.push(Cell { text: inner, span: Span { file, start: first, end: first + inner.len() as u32 } });
    };
    for (i, byte) in line.bytes().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            b',' if !quoted => {
                push(from..i);
                from = i + 1;
            }
            _ => {}
        }
    }
    push(from..line.len());
    out
}

/// The number in a cell.
pub(super) fn number(cell: &Cell<'_>, row: &[Cell<'_>]) -> Result<f64, Diagnostic> {
    // An empty cell at the end of a line has no separate place.
    let line = row.first().map_or(cell.span, |first| Span { end: cell.span.end, ..first.span });
    if cell.text.is_empty() {
        let fault = Diagnostic::error(codes::BAD_DATA, "a cell of the table is empty", line);
        return Err(fault.help("fill the gap or remove the row"));
    }
    match cell.text.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => {
            let message = format!("`{}` is not a finite number", cell.text);
            Err(Diagnostic::error(codes::BAD_DATA, message, cell.span).help("a cell holds one number with a decimal point"))
        }
    }
}

/// The name and the unit of a column: `k [1/min]`. The unit is that of the text between the
/// brackets, if any.
pub(super) fn column<'t>(cell: &Cell<'t>) -> Result<(&'t str, Option<UnitExpr>), Diagnostic> {
    let Some((name, rest)) = cell.text.split_once('[') else { return Ok((cell.text, None)) };
    let unit = rest.trim_end().strip_suffix(']');
    let at = cell.span.start as usize + name.len() + 1;
    match unit.and_then(|unit| smpl_dsl::parse_unit(unit, cell.span.file, at)) {
        Some(unit) => Ok((name.trim(), Some(unit))),
        None => {
            let message = format!("`{}` is not a column with its unit", cell.text);
            Err(Diagnostic::error(codes::BAD_DATA, message, cell.span).help("write a column as `k [1/min]`"))
        }
    }
}

/// The position of the column with the name of a table; the first column is the argument.
pub(super) fn position(columns: &[&str], name: &Ident, path: &str, header: &[Cell<'_>]) -> Result<usize, Diagnostic> {
    if let Some(at) = columns.iter().skip(1).position(|column| *column == name.text) {
        return Ok(at + 1);
    }
    let span = header.first().map_or(name.span, |first| first.span);
    let span = header.last().map_or(span, |last| Span { end: last.span.end, ..span });
    let fault = Diagnostic::error(codes::BAD_DATA, format!("`{path}` has no column `{}`", name.text), name.span);
    let near = did_you_mean(&name.text, columns.iter().skip(1).copied());
    let help = near.unwrap_or_else(|| "the first column is the argument, the one with the name of the table its value".to_owned());
    Err(fault.secondary(span, "the columns of the file").help(help))
}
