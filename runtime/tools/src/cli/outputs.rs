//! Output files, which never replace an input of the command.

use std::path::{Path, PathBuf};

use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::span::FileId;

use super::report::Failed;
use super::say;
use smpl_runtime::files::{is_same, is_same_destination, is_standard_output};

/// A file for a table: CSV where the name has no ending. What is there already is looked at by
/// [`check`] first, which knows better what is wrong.
pub(super) fn table(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match other_ending(&path) {
        Some(message) if !path.exists() => Err(message),
        _ => Ok(path),
    }
}

/// Refuses tables whose ending is not one of a table.
pub(super) fn endings(tables: &[Option<&Path>]) -> Result<(), Failed> {
    let wrong = tables.iter().flatten().filter(|path| !is_standard_output(path)).find_map(|path| other_ending(path));
    wrong.map_or(Ok(()), |message| Err(Failed::Message(message)))
}

fn other_ending(path: &Path) -> Option<String> {
    let is_table = |ending: &std::ffi::OsStr| ["csv", "parquet"].iter().any(|known| ending.eq_ignore_ascii_case(known));
    let ending = path.extension().filter(|ending| !is_table(ending))?;
    let (ending, name) = (ending.display(), path.with_extension("csv"));
    Some(format!("tables end in .csv or .parquet, not in .{ending}; name it `{}`", name.display()))
}

/// The files of a compilation.
pub(super) fn names(sources: &SourceMap) -> impl Iterator<Item = PathBuf> {
    (0..sources.len()).map(|i| PathBuf::from(sources.name(FileId(i as u16))))
}

/// Refuses outputs that are one of the inputs, by whatever path, or twice the same file.
pub(super) fn check<'p>(outputs: &[Option<&'p Path>], inputs: impl Iterator<Item = PathBuf>) -> Result<(), Failed> {
    let outputs: Vec<&'p Path> = outputs.iter().copied().flatten().collect();
    for input in inputs {
        if let Some(output) = outputs.iter().find(|output| is_same(output, &input)) {
            return Err(Failed::Message(overwrites(output, &input)));
        }
    }
    let twice = |output: &Path| std::fs::metadata(output).map_or(true, |metadata| metadata.is_file());
    let before = |i: usize, output: &Path| outputs[..i].iter().any(|other| is_same_destination(other, output));
    match outputs.iter().enumerate().find(|(i, output)| before(*i, output) && twice(output)) {
        Some((_, output)) => {
            Err(Failed::Message(format!("{} is to hold two results; name another file for one of them", output.display())))
        }
        None => Ok(()),
    }
}

fn overwrites(output: &Path, input: &Path) -> String {
    let link = if output == input { String::new() } else { format!(", the same file as {},", input.display()) };
    format!("{}{link} is read by this command and would be overwritten; name another file", output.display())
}

/// Says what was done: on standard error where a result has taken the standard output.
pub(super) fn conclude(text: &str, outputs: &[Option<&Path>]) -> Result<(), Failed> {
    if outputs.iter().flatten().any(|output| is_standard_output(output)) {
        super::report::note(text);
        return Ok(());
    }
    say(smpl_dsl::diagnostic::printable(text))
}
