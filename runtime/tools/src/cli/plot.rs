//! Pictures: of a run that is simulated (`--plot`), and of saved tables (`smpl plot`).

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;

use super::report::Failed;
use super::{ModelArguments, outputs};
use crate::picture::{Follower, Format, PanelPlan, Picture, Run, SavedError, heading, items, of_tables, plan, split_names};
use smpl_runtime::environment::Environment;
use smpl_runtime::setup::Setup;
use smpl_runtime::trajectory::Table;

/// A file for a picture.
pub(super) fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match (path.extension(), Format::of(&path)) {
        (Some(_), None) => {
            let endings: Vec<String> = Format::ENDINGS.iter().map(|(ending, _)| format!(".{ending}")).collect();
            Err(format!("pictures end in {}; name it `{}`", endings.join(", "), path.with_extension("svg").display()))
        }
        _ => Ok(path),
    }
}

/// The names of a list.
pub(super) fn names(lists: &[String]) -> Vec<String> {
    lists.iter().flat_map(|list| split_names(list)).collect()
}

/// The picture of a run that is simulated: what it shows, and what goes along with the run.
pub(super) struct Sketch {
    path: PathBuf,
    plans: Vec<PanelPlan>,
    follower: Option<Follower>,
}

impl Sketch {
    /// A sketch of what `show` names, for runs of a setup.
    pub(super) fn new(path: &Path, show: &[String], setup: &Arc<Setup>) -> Result<Self, Failed> {
        let plans = plan(&items::of_model(setup), &names(show))?;
        Ok(Self { path: path.to_owned(), plans, follower: None })
    }

    /// Goes along with a run of `steps` steps.
    pub(super) fn follow_run(&mut self, setup: &Arc<Setup>, steps: u32) -> Result<(), Failed> {
        self.follower = Follower::new(setup, &self.plans, steps)?;
        Ok(())
    }

    /// To be called before each step.
    pub(super) fn follow(&mut self, environment: &Environment, action: &[f64]) -> Result<(), Failed> {
        match &mut self.follower {
            Some(follower) => Ok(follower.follow(environment, action)?),
            None => Ok(()),
        }
    }

    /// Draws and writes the run of an environment, whose table this is.
    pub(super) fn write(self, table: &Table, environment: &Environment, note: String) -> Result<(), Failed> {
        let setup = environment.setup();
        let mut run = Run::of_table("", table).with_moved(!items::knows_space(setup, environment.parameters()));
        if let Some(follower) = self.follower {
            run.refine(follower.finish());
        }
        Self { follower: None, ..self }.write_runs(&[run], setup, note)
    }

    /// Draws and writes several runs over one another.
    pub(super) fn write_runs(self, runs: &[Run], setup: &Setup, note: String) -> Result<(), Failed> {
        let unit = &setup.model().interface().time.unit;
        Ok(Picture::new(&self.plans, runs, &heading(setup, note), unit).write(&self.path)?)
    }
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl plot run.csv -o run.svg
  smpl plot a.csv b.csv -o both.html --show T,h,reward
  smpl plot run.csv -o run.pdf --model models/reactor.eq --show states,actions")]
pub(super) struct PlotArguments {
    /// Tables that `smpl simulate --out` wrote, drawn over one another
    #[arg(required = true, value_name = "RUN.csv")]
    tables: Vec<PathBuf>,
    /// The picture
    #[arg(short, long, value_name = "P.svg|png|pdf|html", value_parser = picture)]
    output: PathBuf,
    /// Shown quantities: names of quantities or columns, `states`, `actions`, ...; see the
    /// documentation
    #[arg(long, value_name = "NAME,...")]
    show: Vec<String>,
    /// The model that made the tables: units, bounds, set-points and names of phases come from it
    #[arg(long = "model", value_name = "FILE.eq")]
    file: Option<PathBuf>,
    #[command(flatten)]
    model: ModelArguments,
}

/// Draws saved tables.
pub(super) fn run(arguments: &PlotArguments) -> Result<(), Failed> {
    let inputs = arguments.tables.iter().chain(&arguments.file).cloned();
    outputs::check(&[Some(arguments.output.as_path())], inputs)?;
    let setup = arguments.file.as_deref().map(|file| setup_of(file, &arguments.model)).transpose()?;
    let picture = of_tables(&arguments.tables, &names(&arguments.show), setup.as_deref())?;
    Ok(picture.write(&arguments.output)?)
}

impl From<SavedError> for Failed {
    fn from(error: SavedError) -> Self {
        match error {
            SavedError::Data(error) => error.into(),
            SavedError::Show(error) => error.into(),
        }
    }
}

fn setup_of(file: &Path, model: &ModelArguments) -> Result<Arc<Setup>, Failed> {
    let loaded = model.load(file)?;
    Ok(Setup::without_steady(loaded.model, loaded.options, Some(loaded.sources))?)
}
