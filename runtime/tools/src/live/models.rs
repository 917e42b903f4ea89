//! Compiled models of a connection, kept by the texts and choices that they were compiled from.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use smpl_dsl::diagnostic::JsonDiagnostic;
use smpl_runtime::interrupt;
use smpl_runtime::load::{LoadError, LoadOptions, Loaded, OpenTexts, load_open};
use smpl_runtime::scenario;
use smpl_runtime::setup::{EnvironmentOptions, Setup, SetupError};

use super::settings::Settings;
use super::wire::{Fault, FaultKind};
use crate::lsp::OpenTexts as Texts;

/// Most models that are kept.
const MOST: usize = 24;
/// Time for which the faults of a text are kept: a file that it misses may come to be.
const FAULTS_LAST: Duration = Duration::from_secs(2);

/// A compiled model with the texts that it came from.
pub(crate) struct Compiled {
    pub(crate) loaded: Loaded,
    pub(crate) path: PathBuf,
    /// Version of the open text.
    pub(crate) version: Option<i32>,
    /// Time that the compilation took.
    pub(crate) took: Duration,
    setups: Mutex<Vec<(String, Arc<Setup>)>>,
}

/// Subject of a request: a model, and whether its text is an older one.
#[derive(Clone)]
pub(crate) struct Found {
    pub(crate) compiled: Arc<Compiled>,
    pub(crate) stale: bool,
}

enum CachedCompile {
    Good(Arc<Compiled>),
    Bad(Arc<LoadError>, Instant),
}

struct Entry {
    path: PathBuf,
    options: LoadOptions,
    /// Files that were read, with digests of their texts.
    read: Vec<(PathBuf, blake3::Hash)>,
    outcome: CachedCompile,
    used: Instant,
}

/// The models of a connection.
#[derive(Default)]
pub(crate) struct Models {
    entries: Mutex<Vec<Entry>>,
    /// Texts of the last valid state of a model, by its path.
    valid: Mutex<HashMap<PathBuf, Arc<BTreeMap<PathBuf, String>>>>,
    /// One compilation at a time: two requests for one model compile it once.
    compiling: Mutex<()>,
}

impl Models {
    /// The model of a file under settings; that of the last valid text where the present one is
    /// invalid.
    ///
    /// # Errors
    /// [`FaultKind::Invalid`] with the diagnostics where there was never a valid text.
    pub(crate) fn find(&self, path: &Path, settings: &Settings, texts: &Texts) -> Result<Found, Fault> {
        check_scenario(path, settings)?;
        let now = |path: &Path| texts.text(path).map(|text| text.to_string());
        match self.with_structural(path, settings, &now, texts.version(path)) {
            Ok(compiled) => {
                self.keep_valid(&compiled);
                Ok(Found { compiled, stale: false })
            }
            Err(error) => self.find_stale(path, settings, &error),
        }
    }

    fn find_stale(&self, path: &Path, settings: &Settings, error: &LoadError) -> Result<Found, Fault> {
        let last = self.valid.lock().unwrap_or_else(PoisonError::into_inner).get(path).cloned();
        let Some(last) = last else { return Err(fault(error)) };
        let then = |path: &Path| last.get(path).cloned();
        match self.with_structural(path, settings, &then, None) {
            Ok(compiled) => Ok(Found { compiled, stale: true }),
            // The settings do not fit the old text either: they are what is wrong.
            Err(error) => Err(fault(&error)),
        }
    }

    fn keep_valid(&self, compiled: &Compiled) {
        let mut texts: BTreeMap<PathBuf, String> = texts_of(&compiled.loaded).collect();
        // The page may name the file by a path with links.
        if let Some(main) = compiled.loaded.sources.file(smpl_dsl::span::FileId(0)) {
            texts.insert(compiled.path.clone(), main.text().to_owned());
        }
        self.valid.lock().unwrap_or_else(PoisonError::into_inner).insert(compiled.path.clone(), Arc::new(texts));
    }

    /// Compiles anew where a parameter that shapes the model has another value.
    fn with_structural(
        &self,
        path: &Path,
        settings: &Settings,
        text: OpenTexts<'_>,
        version: Option<i32>,
    ) -> Result<Arc<Compiled>, Arc<LoadError>> {
        let compiled = self.compiled(path, &settings.load_options(&BTreeMap::new()), text, version)?;
        let parameters = smpl_runtime::catalogue::parameters(&compiled.loaded.model);
        let shapes = |(name, value): &(&String, &f64)| parameters.find(name).is_some_and(|e| e.structural && e.default != **value);
        let structural: BTreeMap<String, f64> =
            settings.parameters.iter().filter(shapes).map(|(name, value)| (name.clone(), *value)).collect();
        if structural.is_empty() {
            return Ok(compiled);
        }
        self.compiled(path, &settings.load_options(&structural), text, version)
    }

    fn compiled(
        &self,
        path: &Path,
        options: &LoadOptions,
        text: OpenTexts<'_>,
        version: Option<i32>,
    ) -> Result<Arc<Compiled>, Arc<LoadError>> {
        let _one = self.compiling.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(outcome) = self.known(path, options, text) {
            return outcome;
        }
        let begin = Instant::now();
        let result = match text(path).map_or_else(|| smpl_runtime::files::read_text(path), Ok) {
            Ok(main) => load_open(path, main, options, text),
            Err(error) => {
                let message = smpl_runtime::files::plain(&error);
                Err(LoadError::Read { path: path.to_owned(), kind: error.kind(), message, advice: String::new() })
            }
        };
        let (outcome, read) = match result {
            Ok(loaded) => {
                let read = texts_of(&loaded).map(|(path, text)| (path, blake3::hash(text.as_bytes()))).collect();
                let (path, took) = (path.to_owned(), begin.elapsed());
                let compiled = Compiled { loaded, path, version, took, setups: Mutex::default() };
                (CachedCompile::Good(Arc::new(compiled)), read)
            }
            Err(error) => {
                let read = text(path).map(|text| (path.to_owned(), blake3::hash(text.as_bytes())));
                (CachedCompile::Bad(Arc::new(error), begin), read.into_iter().collect())
            }
        };
        let answer = outcome.result();
        let entry = Entry { path: path.to_owned(), options: options.clone(), read, outcome, used: begin };
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|known| !(known.path == entry.path && known.options == entry.options));
        if entries.len() >= MOST {
            let oldest = entries.iter().enumerate().min_by_key(|(_, entry)| entry.used).map(|(at, _)| at);
            oldest.map(|at| entries.swap_remove(at));
        }
        entries.push(entry);
        answer
    }

    /// Model compiled from the same texts with the same options.
    fn known(&self, path: &Path, options: &LoadOptions, text: OpenTexts<'_>) -> Option<Result<Arc<Compiled>, Arc<LoadError>>> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = entries.iter_mut().find(|entry| entry.path == path && entry.options == *options)?;
        let same = |(path, digest): &(PathBuf, blake3::Hash)| {
            let text = text(path).or_else(|| smpl_runtime::files::read_text(path).ok());
            text.is_some_and(|text| blake3::hash(text.as_bytes()) == *digest)
        };
        let lasts = match &entry.outcome {
            CachedCompile::Good(_) => true,
            CachedCompile::Bad(_, since) => since.elapsed() < FAULTS_LAST,
        };
        if !lasts || entry.read.is_empty() || !entry.read.iter().all(same) {
            return None;
        }
        entry.used = Instant::now();
        Some(entry.outcome.result())
    }
}

impl CachedCompile {
    fn result(&self) -> Result<Arc<Compiled>, Arc<LoadError>> {
        match self {
            Self::Good(compiled) => Ok(Arc::clone(compiled)),
            Self::Bad(error, _) => Err(Arc::clone(error)),
        }
    }
}

impl Compiled {
    /// The model under options of an environment; made once for each.
    ///
    /// # Errors
    /// Options that the model does not take.
    pub(crate) fn setup(&self, options: EnvironmentOptions, steady: bool) -> Result<Arc<Setup>, SetupError> {
        const MOST_SETUPS: usize = 8;
        let key = format!("{options:?} {steady}");
        let mut setups = self.setups.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, setup)) = setups.iter().find(|(known, _)| *known == key) {
            return Ok(Arc::clone(setup));
        }
        let (model, sources) = (Arc::clone(&self.loaded.model), Some(Arc::clone(&self.loaded.sources)));
        let setup = if steady { Setup::without_steady(model, options, sources) } else { Setup::new(model, options, sources) }?;
        // A search for the steady state that was interrupted has found nothing.
        if interrupt::requested() {
            return Ok(setup);
        }
        if setups.len() >= MOST_SETUPS {
            setups.remove(0);
        }
        setups.push((key, Arc::clone(&setup)));
        Ok(setup)
    }

    /// The model under the solver's options and the length of a run.
    ///
    /// # Errors
    /// [`FaultKind::Setting`].
    pub(crate) fn setup_of(&self, settings: &Settings) -> Result<Arc<Setup>, Fault> {
        let mut options = self.loaded.options.clone();
        options.solver = settings.solver(options.solver)?;
        options.max_steps = settings.steps.or(options.max_steps);
        self.setup(options, false).map_err(Fault::setting)
    }
}

/// The files of a model with their texts; texts that are not files are left out.
fn texts_of(loaded: &Loaded) -> impl Iterator<Item = (PathBuf, String)> {
    let files = (0..loaded.sources.len()).filter_map(|i| loaded.sources.file(smpl_dsl::span::FileId(i as u16)));
    files.filter(|file| Path::new(file.name()).is_absolute()).map(|file| {
        let path = Path::new(file.name());
        (path.canonicalize().unwrap_or_else(|_| path.to_owned()), file.text().to_owned())
    })
}

/// Only the scenarios of the model's own folder can be chosen.
fn check_scenario(path: &Path, settings: &Settings) -> Result<(), Fault> {
    let Some(name) = &settings.scenario else { return Ok(()) };
    let known = scenario::beside(path);
    if known.contains(name) {
        return Ok(());
    }
    Err(Fault::setting(smpl_runtime::catalogue::UnknownName::new("scenario", name, known.iter().map(String::as_str))))
}

/// An error of loading as an answer.
fn fault(error: &LoadError) -> Fault {
    match error {
        LoadError::Diagnostics { sources, diagnostics } => {
            let shown: Vec<JsonDiagnostic<'_>> = diagnostics.iter().map(|d| JsonDiagnostic::new(d, sources)).collect();
            let data = json!({"diagnostics": serde_json::to_value(shown).unwrap_or(Value::Null)});
            Fault { data: Some(data), ..Fault::new(FaultKind::Invalid, error.to_string()) }
        }
        LoadError::Read { .. } => Fault::new(FaultKind::File, error.to_string()),
        LoadError::Setting { .. } | LoadError::Parameter(_) | LoadError::Artefact { .. } => Fault::setting(error),
    }
}
