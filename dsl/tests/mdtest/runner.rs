//! Runs Markdown files that are specification and test at once.
//!
//! A `## heading` states a behaviour, an `eq` block below it holds a model, a `diagnostics` block the faults that it must give, one a line:
//! `code line:column message`. Where the block has lines `help: ...` or `note: ...`, the advice or the notes of every fault are compared too. Without a `diagnostics` block the
//! model must be free of faults. Text between is for the reader.
//!
//! `BLESS=1` writes what was found into the files; read the difference before you keep it.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use smpl_dsl::diagnostic::{Diagnostic, SourceMap};

/// One behaviour of a file.
struct Case {
    heading: String,
    source: String,
    expected: String,
    /// Lines of the file that hold the expected faults; empty after a model without faults.
    lines: std::ops::Range<usize>,
}

/// Runs every Markdown file of a folder. `check` gives the faults of a model whose file id in the map is 0.
///
/// # Panics
/// When a model gives other faults than it should, with all of them.
pub fn run(folder: &Path, check: impl Fn(&str) -> Vec<Diagnostic>) {
    let mut differences = String::new();
    let mut count = 0;
    for path in files(folder) {
        let text = fs::read_to_string(&path).expect("a readable file");
        let cases = cases(&text);
        count += cases.len();
        if std::env::var_os("BLESS").is_some() {
            fs::write(&path, blessed(&text, &cases, &check)).expect("a writable file");
        }
        for case in &cases {
            let found = shown(case, &check(&case.source));
            if found != case.expected {
                let _ = writeln!(differences, "{}: {}\nexpected:\n{}found:\n{found}", path.display(), case.heading, case.expected);
            }
        }
    }
    assert!(count > 0, "no cases in {}", folder.display());
    assert!(differences.is_empty(), "{differences}");
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("the folder of the tests");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    paths.sort();
    paths
}

fn cases(text: &str) -> Vec<Case> {
    let lines: Vec<&str> = text.lines().collect();
    let mut cases: Vec<Case> = Vec::new();
    let mut heading = String::new();
    let mut at = 0;
    while at < lines.len() {
        let line = lines[at];
        at += 1;
        if let Some(title) = line.strip_prefix("## ") {
            heading = title.to_owned();
        }
        let Some(kind) = line.strip_prefix("```") else { continue };
        let start = at;
        at += lines[start..].iter().take_while(|line| **line != "```").count();
        let block: String = lines[start..at].iter().map(|line| format!("{line}\n")).collect();
        at += 1;
        match (kind, cases.last_mut()) {
            ("eq", _) => cases.push(Case { heading: heading.clone(), source: block, expected: String::new(), lines: at..at }),
            ("diagnostics", Some(case)) => {
                case.expected = block;
                case.lines = start - 1..at;
            }
            _ => {}
        }
    }
    cases
}

fn shown(case: &Case, faults: &[Diagnostic]) -> String {
    let mut sources = SourceMap::new();
    sources.add("model.eq", &case.source);
    let has = |kind: &str| case.expected.lines().any(|line| line.starts_with(kind));
    let (advised, noted) = (has("help: "), has("note: "));
    let line = |fault: &Diagnostic| {
        let at = sources.locate(fault.primary.span);
        let help = fault.help.as_ref().filter(|_| advised).map_or(String::new(), |help| format!("help: {help}\n"));
        let notes: String = fault.notes.iter().filter(|_| noted).map(|note| format!("note: {note}\n")).collect();
        format!("{} {}:{} {}\n{help}{notes}", fault.code, at.line, at.column, fault.message)
    };
    faults.iter().map(line).collect()
}

fn blessed(text: &str, cases: &[Case], check: &impl Fn(&str) -> Vec<Diagnostic>) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let mut result = String::new();
    let mut at = 0;
    for case in cases {
        lines[at..case.lines.start].iter().for_each(|line| result.extend([line, "\n"]));
        let found = shown(case, &check(&case.source));
        if !found.is_empty() {
            let blank = if case.lines.is_empty() { "\n" } else { "" };
            let _ = write!(result, "{blank}```diagnostics\n{found}```\n");
        }
        at = case.lines.end;
    }
    lines[at..].iter().for_each(|line| result.extend([line, "\n"]));
    result
}
