//! The command `smpl`.
//!
//! [`run`] takes the arguments and gives the exit status: 0 done, 1 a file is missing or invalid, 2
//! the command line is invalid. Results go to standard output, everything else to standard error.

mod check;
mod compile;
mod diagnose;
mod document;
mod excerpt;
mod excursion;
mod explain;
mod export;
mod import;
mod lint;
mod live;
mod lsp;
mod new;
mod outputs;
mod plot;
mod python;
mod report;
mod runs;
mod simulate;
mod steady;
mod test;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use report::Failed;
use smpl_runtime::load::{self, LoadOptions, Loaded};
use smpl_runtime::scenario::{Value, Variant};

const ABOUT: &str = "Compiles and simulates process models written as equations";

const EXAMPLES: &str = "\
Examples:
  smpl check models/reactor.eq
  smpl simulate models/reactor.eq --actions a.csv --out t.csv
  smpl simulate models/beer.eq --policy profile --scenario legacy --plot beer.svg
  smpl steady models/reactor.eq --action T_c=28 --fix h=0.7
  smpl compile models/pensim.eq --variant vacuole_flux --set paa_schedule=minutes
  smpl export models/reactor.eq --to c -o reactor.c
  smpl fmt --check models/*.eq";

/// The command line.
#[derive(Debug, Parser)]
#[command(name = "smpl", version, about = ABOUT, after_help = EXAMPLES, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Write a small model that runs, to begin with
    New(new::NewArguments),
    /// Check models: syntax, names, units, structure
    Check(check::CheckArguments),
    /// Compile a model to machine code and say what was compiled
    Compile(compile::CompileArguments),
    /// Run one episode, or many
    Simulate(simulate::SimulateArguments),
    /// Show a model in the browser while it is written
    Live(live::LiveArguments),
    /// Draw tables of runs
    Plot(plot::PlotArguments),
    /// Describe structure, scaling, conditioning, the start and the nominal episode of a model
    Diagnose(diagnose::DiagnoseArguments),
    /// Find a steady state and describe it
    Steady(steady::SteadyArguments),
    /// Warn of what is legal and unwise in models
    Lint(lint::LintArguments),
    /// Run the tests of models
    Test(test::TestArguments),
    /// Find parameters from recorded runs (by the Python package)
    #[command(disable_help_flag = true)]
    Fit(python::PythonArguments),
    /// Write a controller or policy as C, ONNX or FMU (by the Python package)
    #[command(disable_help_flag = true)]
    ExportPolicy(python::PythonArguments),
    /// Replay the episodes of a result and compare the scores (by the Python package)
    #[command(disable_help_flag = true)]
    Verify(python::PythonArguments),
    /// Serve a plant over OPC UA (by the Python package)
    #[command(disable_help_flag = true)]
    Serve(python::PythonArguments),
    /// Write a model in the form of another tool
    Export(export::ExportArguments),
    /// Write a model of another tool (SBML) as text
    Import(import::ImportArguments),
    /// Lay models out in the canonical way
    Fmt(document::FormatArguments),
    /// Describe a model in Markdown, with its equations typeset
    Doc(document::DocArguments),
    /// Explain a diagnostic: meaning, a wrong and a right example
    Explain(explain::ExplainArguments),
    /// Serve an editor on standard input and output (language server)
    Lsp(lsp::LspArguments),
}

/// Options of every command that takes a model.
#[derive(Debug, Args)]
struct ModelArguments {
    /// Scenario: a name (FILE.NAME.yaml next to the model) or a YAML file
    #[arg(long, value_name = "NAME|S.yaml")]
    scenario: Option<String>,
    /// Variant to turn on, or option of a choice; repeatable
    #[arg(long = "variant", value_name = "NAME[=CHOICE]")]
    variants: Vec<String>,
    /// Parameter (declared unit) or setting; overrides a random draw; repeatable
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting)]
    settings: Vec<(String, Value)>,
    /// Statements that follow those of the file, such as 'reward full = h / 1 [m]'
    #[arg(long, value_name = "STATEMENTS")]
    extra: Option<String>,
}

/// Format of a plain result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Format {
    /// For people.
    #[default]
    Text,
    /// For programs.
    Json,
}

fn setting(text: &str) -> Result<(String, Value), String> {
    let (name, value) = text.split_once('=').ok_or_else(|| format!("expected NAME=VALUE, found `{text}`"))?;
    let (name, value) = (name.trim(), value.trim());
    if name.is_empty() || value.is_empty() {
        return Err(format!("expected NAME=VALUE, found `{text}`"));
    }
    Ok((name.to_owned(), Value::parse(value)))
}

/// `NAME=VALUE` with a finite number.
fn number(text: &str) -> Result<(String, f64), String> {
    match setting(text)? {
        (name, Value::Number(value)) if value.is_finite() => Ok((name, value)),
        (name, value) => Err(format!("the value of `{name}` must be a number, not `{value}`")),
    }
}

impl ModelArguments {
    fn options(&self) -> LoadOptions {
        LoadOptions {
            scenario: self.scenario.clone(),
            variants: self.variants.iter().map(|v| Variant::parse(v)).collect(),
            settings: self.settings.iter().cloned().collect(),
            extra: self.extra.clone(),
            ..LoadOptions::default()
        }
    }

    fn load(&self, file: &std::path::Path) -> Result<Loaded, Failed> {
        self.load_with(file, false)
    }

    /// Loads a model; `texts` keeps the back end's intermediate texts. Warnings are shown.
    fn load_with(&self, file: &std::path::Path, texts: bool) -> Result<Loaded, Failed> {
        let loaded = load::load(file, &LoadOptions { texts, ..self.options() })?;
        report::print_diagnostics(&loaded.warnings, &loaded.sources);
        if load::is_made(file) && !loaded.made_for().is_empty() {
            report::note(&format!("note: {} was compiled for {}\n", file.display(), loaded.made_for()));
        }
        Ok(loaded)
    }
}

/// Runs the command line `arguments` (the program's name first) and gives the exit status.
pub fn run(arguments: impl Iterator<Item = OsString>) -> i32 {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Nothing is left to say where a message cannot be printed.
            let _ = error.print();
            return error.exit_code();
        }
    };
    on_a_deep_stack(move || match dispatch(arguments.command) {
        Ok(()) => 0,
        Err(failed) => failed.print(),
    })
}

fn dispatch(command: Command) -> Result<(), Failed> {
    match command {
        Command::New(arguments) => new::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Compile(arguments) => compile::run(&arguments),
        Command::Simulate(arguments) if arguments.is_many() => runs::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Plot(arguments) => plot::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Steady(arguments) => steady::run(&arguments),
        Command::Lint(arguments) => lint::run(&arguments),
        Command::Test(arguments) => test::run(&arguments),
        Command::Fit(arguments) => python::run(python::FIT, &arguments),
        Command::ExportPolicy(arguments) => python::run(python::EXPORT_POLICY, &arguments),
        Command::Verify(arguments) => python::run(python::VERIFY, &arguments),
        Command::Serve(arguments) => python::run(python::SERVE, &arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Fmt(arguments) => document::format(&arguments),
        Command::Doc(arguments) => document::describe(&arguments),
        Command::Explain(arguments) => explain::run(&arguments),
        Command::Lsp(arguments) => lsp::run(&arguments),
    }
}

/// Deeply nested text makes deep recursions; and whatever goes wrong inside, a message is all that
/// comes out.
fn on_a_deep_stack(work: impl FnOnce() -> i32 + Send) -> i32 {
    std::panic::set_hook(Box::new(|info| {
        let at = info.location().map(|l| format!(" at {}:{}", l.file(), l.line())).unwrap_or_default();
        let _ = writeln!(io::stderr(), "error: internal error{at}; please report it with the model that caused it");
    }));
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| smpl_dsl::stack::on_own_stack(work))).unwrap_or(1)
}

/// Writes to standard output. A reader that has gone away is not a fault: the command is done then.
fn say(text: impl AsRef<str>) -> Result<(), Failed> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_ref().as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(Failed::Quiet(0)),
        Err(error) => Err(Failed::Message(format!("cannot write to standard output: {error}"))),
        Ok(()) => Ok(()),
    }
}

/// A list of model files.
#[derive(Debug, Args)]
struct Files {
    /// Models
    #[arg(required = true, value_name = "FILE.eq")]
    files: Vec<PathBuf>,
}
