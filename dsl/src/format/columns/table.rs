//! Columns of tables.
//!
//! Rows of plain numbers are aligned by their starts. Rows of a table that the author has aligned
//! with the names of the columns, by ends or by decimal points, stay aligned so.

/// Cells are compared again after each change, since what is put right may line up with more; this
/// often.
const TURNS: usize = 4;

/// The lines of a table, its rows in columns.
pub(super) fn aligned(lines: Vec<String>, source: &str) -> Vec<String> {
    let mut lines = plain(lines);
    let written: Vec<&str> = source.lines().filter(|line| !line.trim().is_empty()).collect();
    if written.len() == lines.len() {
        lines = as_in(&lines, &written).unwrap_or(lines);
    }
    for _ in 0..TURNS {
        let like: Vec<&str> = lines.iter().map(String::as_str).collect();
        match as_in(&lines, &like) {
            Some(next) if next != lines => lines = next,
            _ => break,
        }
    }
    lines
}

/// Aligns the values of rows such as `tropine: 141.21, 1020, 1e-10`.
fn plain(mut lines: Vec<String>) -> Vec<String> {
    let is_plain = |row: &RowOf| row.label.trim() != "columns:" && row.comment.is_empty() && row.cells.iter().all(Cell::is_plain);
    let rows: Vec<(usize, RowOf)> = rows_of(lines.iter().map(String::as_str)).filter(|(_, row)| is_plain(row)).collect();
    let modes = vec![Mode::Start; rows.iter().map(|(_, row)| row.cells.len()).max().unwrap_or(0)];
    let made = grid(&rows, &modes);
    made.into_iter().for_each(|(i, line)| lines[i] = line);
    lines
}

/// The lines with their rows aligned as those of `like` are; `None` where these are not.
fn as_in(lines: &[String], like: &[&str]) -> Option<Vec<String>> {
    let heads = [true, false];
    heads.into_iter().find_map(|with_head| {
        let wanted = |row: &RowOf| with_head || row.label.trim() != "columns:";
        let own: Vec<(usize, RowOf)> = rows_of(lines.iter().map(String::as_str)).filter(|(_, row)| wanted(row)).collect();
        let theirs: Vec<(usize, RowOf)> = rows_of(like.iter().copied()).filter(|(_, row)| wanted(row)).collect();
        let alike = own.iter().zip(&theirs).all(|(a, b)| a.0 == b.0 && a.1.cells.len() == b.1.cells.len());
        if !alike || own.len() != theirs.len() || own.len() < 2 {
            return None;
        }
        let columns = theirs.iter().map(|(_, row)| row.cells.len()).max()?;
        let modes: Vec<Mode> = (0..columns).map(|j| Mode::of(&theirs, j)).collect::<Option<_>>()?;
        let mut out = lines.to_vec();
        grid(&own, &modes).into_iter().for_each(|(i, line)| out[i] = line);
        Some(out)
    })
}

/// Content of one column of characters.
#[derive(Clone, Copy)]
enum Mode {
    Start,
    End,
    Point,
}

impl Mode {
    /// Alignment of a column of rows; by ends or points only if the author put blanks for it.
    fn of(rows: &[(usize, RowOf)], column: usize) -> Option<Mode> {
        let cells: Vec<&Cell> = rows.iter().filter_map(|(_, row)| row.cells.get(column)).collect();
        let padded = cells.iter().any(|cell| cell.padded);
        [Mode::Start, Mode::End, Mode::Point].into_iter().find(|mode| {
            let mut places = cells.iter().map(|cell| cell.start + mode.anchor(cell));
            let first = places.next();
            (matches!(mode, Mode::Start) || padded) && places.all(|place| Some(place) == first)
        })
    }

    /// Aligned position, in characters from the start of the cell.
    fn anchor(self, cell: &Cell) -> usize {
        let end = cell.text.chars().count();
        match self {
            Mode::Start => 0,
            Mode::End => end,
            Mode::Point => cell.text.chars().position(|c| c == '.').filter(|_| cell.is_plain()).unwrap_or(end),
        }
    }
}

/// A row on one line: label with its colon and the blanks before, cells, comment.
struct RowOf<'t> {
    label: &'t str,
    cells: Vec<Cell<'t>>,
    comment: &'t str,
}

struct Cell<'t> {
    text: &'t str,
    start: usize,
    comma: bool,
    /// True if more than one blank is before it.
    padded: bool,
}

impl Cell<'_> {
    fn is_plain(&self) -> bool {
        self.text.bytes().all(|b| b.is_ascii_alphanumeric() || b"_.+-".contains(&b))
    }
}

/// Rows with the number of their line.
fn rows_of<'t>(lines: impl Iterator<Item = &'t str>) -> impl Iterator<Item = (usize, RowOf<'t>)> {
    lines.enumerate().filter_map(|(i, line)| row_of(line).map(|row| (i, row)))
}

fn row_of(line: &str) -> Option<RowOf<'_>> {
    let (row, comment) = line.split_at(line.find('#').unwrap_or(line.len()));
    let (label, rest) = row.split_once(':').filter(|(_, rest)| rest.starts_with(' '))?;
    let is_name = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"_.+-".contains(&b));
    if !is_name(label.trim()) || row.contains(['{', '}', '"']) || rest.contains(':') {
        return None;
    }
    let mut cells = Vec::new();
    let mut depth = 0_i32;
    let mut at = label.len() + 1;
    let ends = rest.char_indices().filter_map(|(i, c)| {
        depth += i32::from(matches!(c, '(' | '[')) - i32::from(matches!(c, ')' | ']'));
        (c == ',' && depth == 0).then_some(label.len() + 1 + i)
    });
    for end in ends.collect::<Vec<_>>() {
        cells.push(cell_of(row, at, end, true));
        at = end + 1;
    }
    if !row[at..].trim().is_empty() {
        cells.push(cell_of(row, at, row.len(), false));
    }
    (!cells.is_empty()).then_some(RowOf { label: &row[..=label.len()], cells, comment })
}

fn cell_of(row: &str, from: usize, to: usize, comma: bool) -> Cell<'_> {
    let text = row[from..to].trim();
    let blanks = row[from..to].len() - row[from..to].trim_start().len();
    Cell { text, start: row[..from + blanks].chars().count(), comma, padded: blanks > 1 }
}

/// The rows with their cells in columns, each as narrow as it can be.
fn grid(rows: &[(usize, RowOf)], modes: &[Mode]) -> Vec<(usize, String)> {
    let label = rows.iter().map(|(_, row)| row.label.chars().count()).max().unwrap_or(0);
    let column = |j: usize| rows.iter().filter_map(move |(_, row)| row.cells.get(j));
    let anchors: Vec<usize> = (0..modes.len()).map(|j| column(j).map(|cell| modes[j].anchor(cell)).max().unwrap_or(0)).collect();
    let padded = |j: usize, cell: &Cell| {
        let comma = if cell.comma { "," } else { "" };
        format!("{:blanks$}{}{comma}", "", cell.text, blanks = anchors[j] - modes[j].anchor(cell))
    };
    let widths: Vec<usize> = (0..modes.len()).map(|j| column(j).map(|cell| padded(j, cell).chars().count()).max().unwrap_or(0)).collect();
    let line = |row: &RowOf| {
        let cells = row.cells.iter().enumerate().map(|(j, cell)| format!(" {:width$}", padded(j, cell), width = widths[j]));
        let text = format!("{:label$}{}", row.label, cells.collect::<String>());
        let gap = if row.comment.is_empty() { "" } else { "    " };
        format!("{}{gap}{}", text.trim_end(), row.comment)
    };
    rows.iter().map(|(i, row)| (*i, line(row))).collect()
}
