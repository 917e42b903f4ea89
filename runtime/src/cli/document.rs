//! `smpl fmt` and `smpl doc`, and the stages of `compile --emit` that need the text alone.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use smpl_dsl::diagnostic::SourceMap;

use super::report::Failed;
use super::{Files, ModelArguments, say};
use crate::files::{read_text, write_whole};
use crate::{document, load};

#[derive(Debug, Args)]
pub(super) struct FormatArguments {
    #[command(flatten)]
    files: Files,
    /// Change nothing; exit with 1 if a file is not in the canonical layout
    #[arg(long)]
    check: bool,
}

#[derive(Debug, Args)]
pub(super) struct DocArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// Where the Markdown goes (default: standard output)
    #[arg(short, long, value_name = "FILE.md")]
    output: Option<PathBuf>,
}

/// Lays files out; all of them, whatever is wrong with some.
pub(super) fn format(arguments: &FormatArguments) -> Result<(), Failed> {
    let mut faulty = false;
    for file in &arguments.files.files {
        match format_file(file, arguments.check) {
            Ok(true) if arguments.check => {
                faulty = true;
                say(format!("{}: not in the canonical layout\n", file.display()))?;
            }
            Ok(true) => say(format!("{}: formatted\n", file.display()))?,
            Ok(false) => {}
            Err(failed) => {
                faulty = true;
                failed.print();
            }
        }
    }
    if faulty { Err(Failed::Quiet(1)) } else { Ok(()) }
}

/// Whether the file's layout is (or was) not the canonical one.
fn format_file(file: &Path, check: bool) -> Result<bool, Failed> {
    let text = read(file)?;
    let formatted = smpl_dsl::format::format(&text).map_err(|diagnostics| {
        let mut sources = SourceMap::new();
        sources.add(file.display().to_string(), text.clone());
        Failed::Diagnostics(diagnostics, Arc::new(sources))
    })?;
    let differs = formatted != text;
    if differs && !check {
        write_whole(file, |out| out.write_all(formatted.as_bytes()))?;
    }
    Ok(differs)
}

/// Describes a model in Markdown.
pub(super) fn describe(arguments: &DocArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let equations = equations(&arguments.file).unwrap_or_default();
    let text = document::markdown(&loaded.model, &equations);
    let read = super::outputs::names(&loaded.sources).chain([arguments.file.clone()]);
    super::outputs::check(&[arguments.output.as_deref()], read)?;
    match &arguments.output {
        Some(path) => Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?),
        None => say(text),
    }
}

/// The equations of a model's text, typeset.
pub(super) fn equations(file: &Path) -> Result<String, Failed> {
    let (parsed, _) = parse(file)?;
    Ok(document::latex(&parsed))
}

/// The syntax tree as text.
pub(super) fn syntax_tree(file: &Path) -> Result<String, Failed> {
    let (parsed, _) = parse(file)?;
    Ok(format!("{parsed:#?}\n"))
}

fn parse(file: &Path) -> Result<(smpl_dsl::syntax::File, SourceMap), Failed> {
    let text = read(file)?;
    let mut sources = SourceMap::new();
    let id = sources.add(file.display().to_string(), text.clone());
    let parsed = smpl_dsl::parse(&text, id);
    if parsed.diagnostics.iter().any(smpl_dsl::diagnostic::Diagnostic::is_error) {
        return Err(Failed::Diagnostics(parsed.diagnostics.shown(), Arc::new(sources)));
    }
    Ok((parsed.file, sources))
}

fn read(file: &Path) -> Result<String, Failed> {
    read_text(file).map_err(|error| Failed::Message(format!("{}: {}", file.display(), load::plain(&error))))
}
