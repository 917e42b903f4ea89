//! `smpl test`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use smpl_dsl::diagnostic::{Diagnostic, printable};
use smpl_runtime::files;
use smpl_runtime::load::load;

use super::report::{self, Failed};
use super::{Files, ModelArguments, outputs, say};
use crate::trial::{self, Coverage, TestResult};

#[derive(Debug, Args)]
pub(super) struct TestArguments {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    model: ModelArguments,
    /// Run the tests whose names contain a text
    #[arg(long, value_name = "TEXT", default_value = "")]
    filter: String,
    /// List the events, failures, phases, variants and levels that the tests reach
    #[arg(long)]
    coverage: bool,
    /// Write the results as JUnit XML
    #[arg(long, value_name = "F.xml")]
    junit: Option<PathBuf>,
}

/// Results of a file.
struct Suite {
    file: PathBuf,
    outcomes: Vec<TestResult>,
    /// Reason why the model of some tests could not be compiled.
    error: Option<String>,
}

/// Runs the tests of all files, a line for each.
pub(super) fn run(arguments: &TestArguments) -> Result<(), Failed> {
    outputs::check(&[arguments.junit.as_deref()], arguments.files.files.iter().cloned())?;
    let mut suites = Vec::new();
    for file in &arguments.files.files {
        suites.push(suite(file, arguments)?);
    }
    let count = suites.iter().map(|suite| suite.outcomes.len()).sum::<usize>();
    let failed = suites.iter().flat_map(|suite| &suite.outcomes).filter(|outcome| !outcome.faults.is_empty()).count();
    let broken = suites.iter().filter(|suite| suite.error.is_some()).count();
    if let Some(path) = &arguments.junit {
        let text = junit(&suites);
        files::write_whole(path, |out| out.write_all(text.as_bytes())).map_err(|error| Failed::Message(error.to_string()))?;
    }
    let invalid = if broken > 0 { format!(", {broken} invalid {}", counted(broken, "file")) } else { String::new() };
    let line = format!("{count} {}, {} passed, {failed} failed{invalid}\n", counted(count, "test"), count - failed);
    outputs::conclude(&line, &[arguments.junit.as_deref()])?;
    if failed + broken > 0 { Err(Failed::Quiet(1)) } else { Ok(()) }
}

fn counted(count: usize, word: &str) -> String {
    if count == 1 { word.to_owned() } else { format!("{word}s") }
}

/// Runs the tests of a file. A file without tests is checked.
fn suite(file: &Path, arguments: &TestArguments) -> Result<Suite, Failed> {
    let mut suite = Suite { file: file.to_owned(), outcomes: Vec::new(), error: None };
    let text = match files::read_text(file) {
        Ok(text) => text,
        Err(error) => {
            suite.fail(Failed::Message(format!("{}: {}", file.display(), files::plain(&error))));
            return Ok(suite);
        }
    };
    let options = arguments.model.options();
    let groups = trial::groups(&text, &arguments.filter, &options);
    if groups.is_empty() {
        match load(file, &options) {
            Ok(_) => say(printable(&format!("{}: no tests\n", file.display())))?,
            Err(error) => suite.fail(error.into()),
        }
    }
    let mut shown: Vec<Diagnostic> = Vec::new();
    let mut coverage = Coverage::default();
    for group in &groups {
        let mut lines = Ok(());
        let result = trial::run(file, group, &mut coverage, &mut |outcome| {
            if lines.is_ok() {
                lines = say(printable(&line(file, &outcome)));
            }
            suite.outcomes.push(outcome);
        });
        lines?;
        match result {
            Ok(loaded) => {
                // Each compilation gives the warnings of the text again.
                let new: Vec<Diagnostic> = loaded.warnings.iter().filter(|warning| !shown.contains(warning)).cloned().collect();
                report::print_diagnostics(&new, &loaded.sources);
                shown.extend(new);
            }
            Err(error) => suite.fail(error.into()),
        }
    }
    if arguments.coverage {
        say(printable(&format!("     {}: reached by its tests\n{}", file.display(), coverage.lines())))?;
    }
    Ok(suite)
}

impl Suite {
    fn fail(&mut self, failed: Failed) {
        let text = match &failed {
            Failed::Diagnostics(diagnostics, _) => {
                diagnostics.iter().filter(|d| d.is_error()).map(|d| d.message.as_str()).collect::<Vec<_>>().join("; ")
            }
            Failed::Message(text) => text.clone(),
            Failed::Quiet(_) => String::new(),
        };
        failed.print();
        self.error.get_or_insert(text);
    }
}

/// A line for a test, and one for each expectation that does not hold.
fn line(file: &Path, outcome: &TestResult) -> String {
    let word = if outcome.faults.is_empty() { "ok  " } else { "FAIL" };
    let mut text = format!("{word} {}: {} ({})\n", file.display(), outcome.name, time(outcome.time));
    for fault in &outcome.faults {
        let _ = writeln!(text, "       {fault}");
    }
    text
}

fn time(time: Duration) -> String {
    format!("{:.3} s", time.as_secs_f64())
}

/// The results as JUnit XML.
fn junit(suites: &[Suite]) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for Suite { file, outcomes, error } in suites {
        let failures = outcomes.iter().filter(|outcome| !outcome.faults.is_empty()).count();
        let (name, seconds) = (escaped(&file.display().to_string()), outcomes.iter().map(|o| o.time.as_secs_f64()).sum::<f64>() + 0.0);
        let (errors, tests) = (usize::from(error.is_some()), outcomes.len() + usize::from(error.is_some()));
        let _ = writeln!(
            text,
            "  <testsuite name=\"{name}\" tests=\"{tests}\" failures=\"{failures}\" errors=\"{errors}\" time=\"{seconds:.6}\">"
        );
        for outcome in outcomes {
            let case = format!(
                "    <testcase classname=\"{name}\" name=\"{}\" file=\"{name}\" line=\"{}\" time=\"{:.6}\"",
                escaped(&outcome.name),
                outcome.line,
                outcome.time.as_secs_f64()
            );
            let _ = match outcome.faults.as_slice() {
                [] => writeln!(text, "{case}/>"),
                faults => writeln!(
                    text,
                    "{case}>\n      <failure message=\"{}\">{}</failure>\n    </testcase>",
                    escaped(&faults[0]),
                    escaped(&faults.join("\n"))
                ),
            };
        }
        if let Some(error) = error {
            let message = escaped(error);
            let _ = writeln!(
                text,
                "    <testcase classname=\"{name}\" name=\"compilation\" file=\"{name}\" time=\"0\">\n      <error message=\"{message}\"/>\n    </testcase>"
            );
        }
        text.push_str("  </testsuite>\n");
    }
    text + "</testsuites>\n"
}

/// A text of XML; characters that XML does not have are left out.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            _ if character.is_control() => {}
            _ => out.push(character),
        }
    }
    out
}
