//! `smpl diagnose`

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::report::Failed;
use super::{ModelArguments, say};
use smpl_runtime::diagnose::{Diagnosis, diagnose};
use smpl_runtime::failure::Short;
use smpl_runtime::setup::Setup;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl diagnose models/reactor.eq
  smpl diagnose models/atropine.eq --json")]
pub(super) struct DiagnoseArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// Print the findings as JSON
    #[arg(long)]
    json: bool,
}

/// Items of a list that are printed.
const SHOWN: usize = 12;

/// Diagnoses and prints.
pub(super) fn run(arguments: &DiagnoseArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let unit = loaded.model.interface().time.unit.clone();
    let setup = Setup::without_steady(loaded.model, loaded.options, Some(loaded.sources))?;
    let found = diagnose(&setup)?;
    if arguments.json {
        return say(serde_json::to_string_pretty(&found).map_err(|e| Failed::Message(e.to_string()))? + "\n");
    }
    say(table(&found, &unit))
}

/// One line a finding.
fn table(found: &Diagnosis, unit: &str) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{name:<26}{}", value.replace('\n', &format!("\n{:26}", "")));
    };
    line("states", found.states.to_string());
    line("algebraic variables", found.algebraic.to_string());
    let large: Vec<String> =
        found.blocks.iter().filter(|b| b.size > 1).map(|b| format!("{} ({})", b.size, b.unknowns.join(", "))).collect();
    let singles = found.blocks.iter().filter(|b| b.size == 1).count();
    line("blocks of one equation", singles.to_string());
    line("larger blocks", list(&large));
    if !found.freed.is_empty() {
        line("determined at the start", list(&found.freed));
    }
    if let Some(failure) = &found.start_failure {
        line("start", format!("no solution\n{failure}"));
        return text;
    }
    line("condition number", found.condition.map_or_else(|| "no algebraic equations".to_owned(), |c| format!("{c:.1e}")));
    let pairs: Vec<String> = found.parallel.iter().map(|(a, b)| format!("{a} and {b}")).collect();
    line("parallel equations", list(&pairs));
    line("wrong derivatives", list(&found.wrong_entries));
    line("at bounds at the start", list(&found.at_bounds));
    let value = |z: Option<(f64, f64)>| match z {
        None => "not computed".to_owned(),
        Some((re, 0.0)) => format!("{} 1/{unit}", Short(re)),
        Some((re, im)) => format!("{} ± {} i 1/{unit}", Short(re), Short(im.abs())),
    };
    line("slowest eigenvalue", value(found.slowest));
    line("fastest eigenvalue", value(found.fastest));
    let end = if found.failure.is_empty() { String::new() } else { format!(", {}", found.failure) };
    line("nominal episode", format!("{} steps{end}", found.steps));
    let scaled: Vec<String> =
        found.badly_scaled.iter().map(|s| format!("{} (size {}, scale {})", s.name, Short(s.size), Short(s.scale))).collect();
    line("far from their scale", list(&scaled));
    line("events that do not happen", list(&found.silent_events));
    text
}

fn list(items: &[String]) -> String {
    match items.len() {
        0 => "none".to_owned(),
        n if n > SHOWN => format!("{}\nand {} more", items[..SHOWN].join("\n"), n - SHOWN),
        _ => items.join("\n"),
    }
}
