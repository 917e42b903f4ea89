//! Texts of what passes make, for tests.

use super::infix::{Printer, affine};
use super::{COUNTERS, destination, equations, line};
use crate::differentiate::Entry;
use crate::model::Model;
use crate::schedule::Staged;

/// The unknowns, each with its first column, and the equations.
pub(crate) fn structure(model: &Model) -> String {
    let mut text = String::new();
    let mut column = 0;
    for &unknown in &model.unknowns {
        let variable = &model.vars[unknown];
        line(&mut text, 0, &format!("column {column}: {}[{}]", variable.name, variable.len));
        column += variable.len;
    }
    equations(&mut text, model);
    text
}

/// The entries of a matrix, row and column first.
pub(crate) fn entries(model: &Model, entries: &[Entry]) -> String {
    let mut text = String::new();
    for entry in entries {
        looped(&mut text, model, &entry.loops, 0, |p| {
            format!("[{}, {}] += {}", affine(entry.row), affine(entry.column), p.value(entry.value))
        });
    }
    text
}

/// The stages of a staged program; nothing where it does nothing.
pub(crate) fn staged(model: &Model, name: &str, staged: &Staged) -> String {
    let mut text = String::new();
    for (i, stage) in staged.stages.iter().enumerate().filter(|(_, stage)| !stage.is_empty()) {
        line(&mut text, 0, &format!("{name}, stage {i}"));
        for nest in stage {
            looped(&mut text, model, &nest.loops, 1, |p| {
                let stores = nest.stores.iter().map(|s| format!("{} {}", destination(model, s.target), p.value(s.value)));
                stores.collect::<Vec<_>>().join("\n")
            });
        }
    }
    text
}

/// Loop headers, named common parts, then the lines of `content`.
fn looped(text: &mut String, model: &Model, loops: &[(u8, u32)], indent: usize, content: impl Fn(&mut Printer<'_>) -> String) {
    for (depth, &(counter, extent)) in loops.iter().enumerate() {
        line(text, indent + depth, &format!("for {} in 0..{extent}", COUNTERS.get(usize::from(counter)).unwrap_or(&"?")));
    }
    let mut printer = Printer::new(model, loops.iter().map(|&(counter, _)| usize::from(counter) + 1).max().unwrap_or(0));
    let lines = content(&mut printer);
    for part in printer.parts.iter().map(String::as_str).chain(lines.lines()) {
        line(text, indent + loops.len(), part);
    }
}
