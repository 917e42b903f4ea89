//! `smpl live`

use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::Args;

use super::report::Failed;
use super::say;
use crate::live::Server;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl live models/reactor.eq
  smpl live models/
  smpl live --port 8080 --no-open")]
pub(super) struct LiveArguments {
    /// A model, or a folder of models; the working folder by default
    #[arg(value_name = "FILE.eq|FOLDER")]
    path: Option<PathBuf>,
    /// Port of 127.0.0.1; 0 picks a free one
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Print the address only, and open no browser
    #[arg(long)]
    no_open: bool,
}

/// Serves the page until the program is stopped.
pub(super) fn run(arguments: &LiveArguments) -> Result<(), Failed> {
    let server = Server::new(arguments.path.as_deref(), arguments.port).map_err(Failed::Message)?;
    let address = server.address();
    say(format!("{address}\n"))?;
    if !arguments.no_open {
        open(&address);
    }
    server.serve();
    Ok(())
}

/// Opens the browser, where there is one; the address is printed in any case.
fn open(address: &str) {
    let (program, arguments): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/c", "start", ""]),
        _ => ("xdg-open", &[]),
    };
    let mut command = Command::new(program);
    command.args(arguments).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if let Ok(mut child) = command.spawn() {
        // A child that ended is taken note of, so that it does not stay as a zombie.
        let _ = std::thread::Builder::new().spawn(move || child.wait());
    }
}
