//! `smpl explain`

use clap::Args;
use smpl_analysis::reference::{all_codes, explain};
use smpl_dsl::diagnostic::suggest;

use super::report::Failed;
use super::say;

#[derive(Debug, Args)]
pub(super) struct ExplainArguments {
    /// Code of a diagnostic, such as E0302 or E0302-unit-mismatch
    #[arg(value_name = "CODE")]
    code: String,
}

/// Prints the entry of a code.
pub(super) fn run(arguments: &ExplainArguments) -> Result<(), Failed> {
    if let Some(entry) = explain(&arguments.code) {
        return say(format!("# {}\n\n{}\n", entry.code.id(), entry.section));
    }
    let known: Vec<&str> = all_codes().map(|code| code.id()).collect();
    let numbers = known.iter().filter_map(|id| id.split('-').next());
    let upper = arguments.code.to_ascii_uppercase();
    let guess = suggest(&upper, numbers.chain(known.iter().copied()));
    let help = guess.map_or_else(|| "`docs/diagnostics.md` lists all codes".to_owned(), |code| format!("did you mean `{code}`?"));
    Err(Failed::Message(format!("unknown code `{}`: {help}", arguments.code)))
}
