//! `smpl lint`

use std::path::Path;

use clap::Args;
use smpl_dsl::diagnostic::{Diagnostic, printable};
use smpl_dsl::span::FileId;
use smpl_runtime::load::{LoadOptions, load};

use super::report::{self, Failed};
use super::{Files, ModelArguments, say};
use crate::lint;

#[derive(Debug, Args)]
pub(super) struct LintArguments {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    model: ModelArguments,
    /// Exit with status 1 if there are warnings
    #[arg(long)]
    deny: bool,
}

/// Warns of what is legal and unwise in all files.
pub(super) fn run(arguments: &LintArguments) -> Result<(), Failed> {
    let (mut faulty, mut warnings) = (false, 0);
    for file in &arguments.files.files {
        match lints(file, &arguments.model) {
            Ok(count) => {
                warnings += count;
                let text =
                    if count == 0 { "no warnings".to_owned() } else { format!("{count} warning{}", if count == 1 { "" } else { "s" }) };
                say(printable(&format!("{}: {text}\n", file.display())))?;
            }
            Err(failed) => {
                faulty = true;
                failed.print();
            }
        }
    }
    if faulty || arguments.deny && warnings > 0 { Err(Failed::Quiet(1)) } else { Ok(()) }
}

/// Prints the warnings of a file, those of `smpl check` among them, and counts them.
fn lints(file: &Path, model: &ModelArguments) -> Result<usize, Failed> {
    let loaded = load(file, &LoadOptions { lints: true, ..model.options() })?;
    let text = loaded.sources.file(FileId(0)).map_or("", |source| source.text());
    let tree = smpl_dsl::parse(text, FileId(0)).file;
    let mut found: Vec<Diagnostic> = loaded.warnings.clone();
    found.extend(lint::lints(&tree, loaded.model.interface()));
    found.sort_by_key(|warning| (warning.primary.span.file, warning.primary.span.start));
    let found = lint::allowed(found, &loaded.sources);
    report::print_diagnostics(&found, &loaded.sources);
    Ok(found.len())
}
