//! Exports of the page: tables, pictures, the scenario of the settings, a Python script, one
//! self-contained page.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;
use smpl_runtime::catalogue::Family;
use smpl_runtime::environment::Environment;
use smpl_runtime::setup::Setup;
use smpl_runtime::trajectory::Table;

use super::episode::{Episode, run};
use super::jobs::Stop;
use super::models::Found;
use super::run::{Benches, Report, RunRequest, setup_for};
use super::settings::{Settings, Single, kind_of};
use super::wire::{Answer, Fault, FaultKind, download};
use super::{page, script};
use crate::picture::{Format, PanelPlan, Picture, Run, followed, heading, items, plan};

/// Parameters of `smpl/export`.
#[derive(Debug, Deserialize)]
pub(crate) struct ExportRequest {
    format: String,
    #[serde(flatten)]
    run: RunRequest,
    /// The equations as the page has typeset them.
    #[serde(default)]
    mathml: Vec<String>,
}

/// Runs with what is known of them.
struct Runs {
    setup: Arc<Setup>,
    plans: Vec<PanelPlan>,
    episodes: Vec<(Single, Episode)>,
}

/// The answer to `smpl/export`.
///
/// # Errors
/// Settings that the model does not take, an unknown format, or a stop.
pub(crate) fn answer(
    request: &ExportRequest,
    path: &Path,
    find: &dyn Fn(&Settings) -> Result<Found, Fault>,
    benches: &mut Benches,
    stop: &Stop,
    report: Report<'_>,
) -> Answer {
    let settings = &request.run.settings;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let named = |ending: &str| format!("{stem}.{ending}");
    let found = find(settings)?;
    let mut runs = || runs(&request.run, &found, find, benches, stop, report);
    let shown = |format: Format, runs: &Runs| picture(runs).bytes(format).map_err(|error| Fault::new(FaultKind::Internal, error));
    Ok(match request.format.as_str() {
        "csv" => download(named("csv"), "text/csv", table_bytes(&runs()?, "csv")?),
        "parquet" => download(named("parquet"), "application/vnd.apache.parquet", table_bytes(&runs()?, "parquet")?),
        "svg" => download(named("svg"), "image/svg+xml", shown(Format::Svg, &runs()?)?),
        "png" => download(named("png"), "image/png", shown(Format::Png, &runs()?)?),
        "pdf" => download(named("pdf"), "application/pdf", shown(Format::Pdf, &runs()?)?),
        "html" => {
            let picture = picture(&runs()?).html_part("run");
            let text = found.compiled.loaded.sources.file(smpl_dsl::span::FileId(0)).map_or("", |file| file.text());
            let interface = found.compiled.loaded.model.interface();
            download(named("html"), "text/html", page::page(interface, text, &request.mathml, &picture).into_bytes())
        }
        "yaml" => {
            let name = settings.scenario.as_deref().filter(|name| *name != "default");
            let text = script::scenario(settings, &base_of(&found, name))?;
            download(format!("{stem}.live.yaml"), "application/yaml", text.into_bytes())
        }
        "python" => {
            let setup = found.compiled.setup_of(settings)?;
            let recorded = match settings.policy.as_deref() {
                Some("random") => Some(recorded_actions(&runs()?)),
                _ => None,
            };
            download(named("py"), "text/x-python", script::python(settings, path, &setup, recorded.as_ref()).into_bytes())
        }
        other => {
            return Err(Fault::setting(format!("unknown format `{other}`; there are csv, parquet, svg, png, pdf, html, yaml, python")));
        }
    })
}

/// The text of the scenario that the settings begin with.
fn base_of(found: &Found, name: Option<&str>) -> String {
    let Some(name) = name else { return String::new() };
    let ending = format!(".{name}.yaml");
    let sources = &found.compiled.loaded.sources;
    let files = (0..sources.len()).filter_map(|i| sources.file(smpl_dsl::span::FileId(i as u16)));
    files.filter(|file| file.name().ends_with(&ending)).map(|file| file.text().to_owned()).next().unwrap_or_default()
}

fn runs(
    request: &RunRequest,
    found: &Found,
    find: &dyn Fn(&Settings) -> Result<Found, Fault>,
    benches: &mut Benches,
    stop: &Stop,
    report: Report<'_>,
) -> Result<Runs, Fault> {
    let first = found.compiled.setup_of(&request.settings)?;
    let plans = plan(&items::of_model(&first), request.columns.as_deref().unwrap_or_default()).map_err(Fault::setting)?;
    let singles = request.settings.singles(|name| kind_of(&first, name))?;
    let (mut episodes, count) = (Vec::new(), singles.len() as u64);
    for (index, single) in singles.into_iter().enumerate() {
        let setup = if request.settings.sweep.is_some() { setup_for(&single, found, find)? } else { Arc::clone(&first) };
        let mut environment: Environment = benches.take(&setup)?;
        let wanted = followed(&plans).collect();
        let steps = u64::from(setup.max_steps());
        let episode = run(&mut environment, &single, &wanted, stop, &mut |step| {
            report(index as u64 * steps + u64::from(step), count * steps);
        })?;
        benches.put(environment);
        episodes.push((single, episode));
    }
    Ok(Runs { setup: first, plans, episodes })
}

fn picture(runs: &Runs) -> Picture {
    let drawn = |(single, episode): &(Single, Episode)| {
        let mut run = Run::of_table(&single.label, &episode.table).with_moved(episode.moved);
        if let Some((tracing, trace)) = &episode.trace {
            run.refine(tracing.followings(&runs.setup, trace));
        }
        run
    };
    let drawn: Vec<Run> = runs.episodes.iter().map(drawn).collect();
    let note = runs.episodes.first().map_or_else(String::new, |(single, episode)| {
        format!("{}; {}", script::circumstances(&single.settings, single.seed), episode.end.message)
    });
    Picture::new(&runs.plans, &drawn, &heading(&runs.setup, note), &runs.setup.model().interface().time.unit)
}

/// The table of the runs, with a column that names the run where there are several.
fn table_bytes(runs: &Runs, ending: &str) -> Result<Vec<u8>, Fault> {
    let failed = |error: String| Fault::new(FaultKind::Internal, error);
    let tables: Vec<(&str, &Table)> = runs.episodes.iter().map(|(single, episode)| (single.label.as_str(), &episode.table)).collect();
    let together = match tables.as_slice() {
        [(_, single)] => (*single).clone(),
        many => Table::together("run", many),
    };
    let folder = tempfile::tempdir().map_err(|error| failed(error.to_string()))?;
    let path = folder.path().join(format!("table.{ending}"));
    together.write(&path).map_err(|error| failed(error.to_string()))?;
    smpl_runtime::files::read(&path).map_err(|error| failed(error.to_string()))
}

/// The actions of the first run, step after step, by name.
fn recorded_actions(runs: &Runs) -> BTreeMap<String, Vec<f64>> {
    let actions: &Family = &runs.setup.catalogue.actions;
    let of = |name: &str| {
        let values = runs.episodes.first().and_then(|(_, episode)| episode.table.numbers(name)).unwrap_or_default();
        (name.to_owned(), values.into_iter().skip(1).collect())
    };
    actions.names().map(of).collect()
}
