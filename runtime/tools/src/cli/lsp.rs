//! `smpl lsp`

use clap::Args;

use super::report::Failed;
use crate::lsp::{SessionOptions, serve};

#[derive(Debug, Args)]
pub(super) struct LspArguments {
    /// Accepted for editors that pass it; standard input and output are always used
    #[arg(long, hide = true)]
    stdio: bool,
}

/// Serves one client until it exits.
pub(super) fn run(_: &LspArguments) -> Result<(), Failed> {
    let command = std::env::args().next().into_iter().collect();
    serve(SessionOptions::from_environment(command)).map_err(|error| Failed::Message(format!("cannot read standard input: {error}")))
}
