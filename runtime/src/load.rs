//! From a file to a model ready to run.
//!
//! This is the one place that calls the front end: source text, scenario, variants and settings go
//! in, a compiled model and the options of its environments come out. A compiled model written by
//! `smpl compile` is read as it is; it takes parameters, but no variants.

mod asked;
mod faults;
mod layers;
mod made;
mod options;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use smpl_compiler::artefact::{self, Circumstances};
use smpl_compiler::compile::{Compiled, compile};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_compiler::model::Model;
use smpl_compiler::read::read_sources;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes, suggest};
use smpl_dsl::span::{FileId, Span};

use self::asked::compile_options;
use self::faults::{place_scenario_faults, settings_as_text};
use self::layers::Layers;
use self::made::{load_artefact, load_json};
use self::options::finish;
use crate::files::{self, plain};
use crate::scenario::{self, Scenario, Value, Variant};
use crate::setup::{EnvironmentOptions, start_diagnostics};

/// Code of the diagnostic of a file that cannot be read.
pub const UNREADABLE: &str = codes::UNREADABLE.id();

/// Ending of files that hold a compiled model.
pub const ARTEFACT_EXTENSION: &str = "smplc";

/// Ending of files that hold a checked model in the form that `smpl export --to json` writes.
pub(crate) const JSON_EXTENSION: &str = "json";

/// Returns `true` if a file holds a model that was made for a scenario, variants and settings
/// already.
#[must_use]
pub fn is_made(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == ARTEFACT_EXTENSION || e == JSON_EXTENSION)
}

/// Options of a model in addition to its text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// Name or path of a scenario; `None` and `default` are the model as it is.
    pub scenario: Option<String>,
    /// Variants, after those of the scenario.
    pub variants: Vec<Variant>,
    /// Parameters and settings; they override those of the scenario.
    pub settings: BTreeMap<String, Value>,
    /// The reward that is returned.
    pub reward: Option<String>,
    /// Level of observation.
    pub observation: Option<String>,
    /// Statements that follow those of the model's file.
    pub extra: Option<String>,
    /// Keep intermediate text and assembly.
    pub texts: bool,
    /// Names of the tests to compile with the model.
    pub tests: Option<Vec<String>>,
    /// Also report lints.
    pub lints: bool,
}

/// A model ready to run.
pub struct Loaded {
    /// The compiled model.
    pub model: Arc<CompiledModel>,
    /// Options of its environments from the scenario and the settings.
    pub options: EnvironmentOptions,
    /// Observation level, by the call or else by the scenario.
    pub level: String,
    /// All texts.
    pub sources: Arc<SourceMap>,
    /// Warnings of the compilation.
    pub warnings: Vec<Diagnostic>,
    /// Hash of the texts, that of the scenario included: what a compiled model belongs to.
    pub fingerprint: [u8; 32],
    /// Options of the compilation.
    pub circumstances: Circumstances,
}

impl Loaded {
    /// Differences of a compiled model from its text, as text; empty without any.
    #[must_use]
    pub fn made_for(&self) -> String {
        let Circumstances { scenario, variants, settings } = &self.circumstances;
        let scenario = scenario.iter().map(|(name, _)| format!("scenario {name}"));
        let settings = settings.iter().map(|(name, value)| format!("{name} = {value}"));
        scenario.chain(variants.iter().map(|v| format!("variant {v}"))).chain(settings).collect::<Vec<_>>().join(", ")
    }
}

/// Reason why a model cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file cannot be read.
    #[error("{}: {message}{advice}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Kind of the error; `InvalidData` if the text is not UTF-8.
        kind: std::io::ErrorKind,
        /// Reason.
        message: String,
        /// Correction; may be empty.
        advice: String,
    },
    /// Faults in the model or the scenario.
    #[error("{}", summary(diagnostics))]
    Diagnostics {
        /// The texts.
        sources: Arc<SourceMap>,
        /// The faults.
        diagnostics: Vec<Diagnostic>,
    },
    /// A setting that the model does not have, or that cannot have that value.
    #[error("{message}")]
    Setting {
        /// Error and correction.
        message: String,
    },
    /// A value that a parameter cannot have.
    #[error(transparent)]
    Parameter(#[from] crate::parameters::ParameterError),
    /// A compiled model that cannot be used.
    #[error("{}: {message}", path.display())]
    Artefact {
        /// The file.
        path: PathBuf,
        /// Reason.
        message: String,
    },
}

fn summary(diagnostics: &[Diagnostic]) -> String {
    let texts: Vec<&str> = diagnostics.iter().filter(|d| d.is_error()).map(|d| d.message.as_str()).collect();
    texts.join("; ")
}

/// Loads a model from a file: text (`.eq`), a compiled model (`.smplc`) or a checked one (`.json`).
///
/// # Errors
/// See [`LoadError`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let bytes = read(path)?;
    if path.extension().is_some_and(|e| e == ARTEFACT_EXTENSION) {
        return load_artefact(path, &bytes, options);
    }
    let text = String::from_utf8(bytes).map_err(|error| LoadError::Read {
        path: path.to_owned(),
        kind: std::io::ErrorKind::InvalidData,
        message: files::not_utf8(error.as_bytes()),
        advice: String::new(),
    })?;
    if path.extension().is_some_and(|e| e == JSON_EXTENSION) {
        return load_json(path, &text, options);
    }
    load_text(path, text, options)
}

/// Loads a model from text; `path` names it and says where scenarios and imports are looked for.
///
/// # Errors
/// See [`LoadError`].
pub fn load_text(path: &Path, text: String, options: &LoadOptions) -> Result<Loaded, LoadError> {
    load_open(path, text, options, &|_| None)
}

/// Texts that replace those of files, by their paths: those that an editor has open.
pub type OpenTexts<'a> = &'a (dyn Fn(&Path) -> Option<String> + Sync);

/// As [`load_text`], with open texts of imported files and scenarios.
///
/// # Errors
/// See [`LoadError`].
pub fn load_open(path: &Path, text: String, options: &LoadOptions, open: OpenTexts<'_>) -> Result<Loaded, LoadError> {
    let mut sources = SourceMap::new();
    let main = sources.add(path.display().to_string(), text);
    let scenario = match load_scenario(path, options, &mut sources, open) {
        Ok(scenario) => scenario,
        Err(ScenarioFault::Load(error)) => return Err(error),
        Err(ScenarioFault::Diagnostic(d)) => {
            return Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics: vec![*d] });
        }
    };
    let settings = settings_as_text(&mut sources, options);
    let extra = options.extra.as_ref().map(|text| sources.add("extra", text.clone()));
    let layers = [&scenario.parameters, &scenario.settings, &options.settings];
    match compiled(&mut sources, main, extra, &scenario, (options, Layers(&layers), open)) {
        Ok(Compiled { model, warnings, imports }) => {
            let texts = [main].into_iter().chain(extra).chain(imports).filter_map(|id| Some(sources.file(id)?.text()));
            let print = fingerprint(texts, scenario_text(&scenario, &sources));
            let circumstances = circumstances(&scenario, &sources, options);
            let loaded = finish(model, sources, &scenario, Layers(&layers), options)?;
            let found = if options.lints { start_diagnostics(&loaded.model, &loaded.options) } else { Vec::new() };
            if found.iter().any(Diagnostic::is_error) {
                return Err(LoadError::Diagnostics { sources: loaded.sources, diagnostics: found });
            }
            let warnings = warnings.into_iter().chain(found).collect();
            Ok(Loaded { warnings, fingerprint: print, circumstances, ..loaded })
        }
        Err(mut diagnostics) => {
            place_scenario_faults(&mut diagnostics, &scenario, &sources, settings);
            Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics })
        }
    }
}

/// Diagnostics of the conditions at the start of a flat model, as those that [`load`] reports with
/// [`LoadOptions::lints`]: for editors, whose texts are compiled no further.
#[must_use]
pub fn start_diagnostics_of_text(model: Model) -> Vec<Diagnostic> {
    if model.interface.start_conditions.is_empty() {
        return Vec::new();
    }
    let settings = BackEndSettings { quick: true, ..BackEndSettings::default() };
    let compiled = CompiledModel::build(model, &settings);
    compiled.map_or_else(|_| Vec::new(), |model| start_diagnostics(&Arc::new(model), &EnvironmentOptions::default()))
}

fn scenario_text<'s>(scenario: &Scenario, sources: &'s SourceMap) -> &'s str {
    scenario.file.and_then(|file| sources.file(file)).map_or("", |file| file.text())
}

fn circumstances(scenario: &Scenario, sources: &SourceMap, options: &LoadOptions) -> Circumstances {
    let name = options.scenario.clone().filter(|_| scenario.file.is_some());
    Circumstances {
        scenario: name.map(|name| (name, scenario_text(scenario, sources).to_owned())),
        variants: options.variants.iter().map(Variant::to_string).collect(),
        settings: options.settings.iter().map(|(name, value)| (name.clone(), value.to_string())).collect(),
    }
}

/// Compiles a text with everything that the scenario and the options say about it.
fn compiled(
    sources: &mut SourceMap,
    main: FileId,
    extra: Option<FileId>,
    scenario: &Scenario,
    (options, layers, open): (&LoadOptions, Layers<'_>, OpenTexts<'_>),
) -> Result<Compiled, Vec<Diagnostic>> {
    let folder = Path::new(sources.name(main)).parent().map(Path::to_owned).unwrap_or_default();
    let asked = Options { extra, ..compile_options(sources, scenario, layers, options)? };
    let settings = BackEndSettings { texts: options.texts, ..BackEndSettings::default() };
    compile(sources, main, &mut |path| import_open(&folder, path, open), &asked, &settings)
}

/// The text of `use "path"`: a file next to the model or in the library (`SMPL_LIBRARY`), never
/// outside them.
pub fn import(folder: &Path, path: &str) -> Option<(String, String)> {
    import_open(folder, path, &|_| None)
}

/// As [`import`], with open texts.
pub fn import_open(folder: &Path, path: &str, open: OpenTexts<'_>) -> Option<(String, String)> {
    let library = std::env::var_os("SMPL_LIBRARY").and_then(|root| Path::new(&root).canonicalize().ok());
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    [Some(here.to_owned()), library.clone()].into_iter().flatten().find_map(|root| {
        let root = root.canonicalize().ok()?;
        let file = root.join(path).canonicalize().ok()?;
        let text = file.starts_with(&root).then(|| open(&file).or_else(|| files::read_text(&file).ok()))??;
        let name = if Some(&root) == library.as_ref() { file } else { folder.join(path) };
        Some((name.display().to_string(), text))
    })
}

/// Hash of the texts of a model and of its scenario.
fn fingerprint<'t>(texts: impl Iterator<Item = &'t str>, scenario: &str) -> [u8; 32] {
    let mut texts: Vec<&str> = texts.collect();
    texts.sort_unstable();
    artefact::fingerprint(&texts, scenario.as_bytes())
}

fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    let fault = |error: std::io::Error| LoadError::Read {
        path: path.to_owned(),
        kind: error.kind(),
        message: plain(&error),
        advice: String::new(),
    };
    files::read(path).map_err(fault)
}

/// The file of a model and those that it imports, as far as they can be read.
#[must_use]
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let mut sources = SourceMap::new();
    if let Ok(text) = files::read_text(path) {
        let main = sources.add(path.display().to_string(), text);
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        read_sources(&mut sources, main, &[], &mut |name| import(&folder, name));
    }
    let imports = (1..sources.len()).map(|i| PathBuf::from(sources.name(FileId(i as u16))));
    [path.to_owned()].into_iter().chain(imports).collect()
}

enum ScenarioFault {
    Load(LoadError),
    Diagnostic(Box<Diagnostic>),
}

fn load_scenario(model: &Path, options: &LoadOptions, sources: &mut SourceMap, open: OpenTexts<'_>) -> Result<Scenario, ScenarioFault> {
    let Some(name) = options.scenario.as_deref().filter(|name| *name != "default") else {
        return Ok(Scenario::default());
    };
    let path = scenario::find_file(model, name);
    let bytes = open(&path).map_or_else(|| files::read(&path), |text| Ok(text.into_bytes())).map_err(|error| {
        let known = scenario::beside(model);
        let guess = suggest(name, known.iter().map(String::as_str)).map(|n| format!("did you mean `{n}`? "));
        let advice = format!("; {}scenarios of this model: {}", guess.unwrap_or_default(), known.join(", "));
        ScenarioFault::Load(LoadError::Read {
            kind: error.kind(),
            message: format!("unknown scenario `{name}`: {}", plain(&error)),
            path: path.clone(),
            advice,
        })
    })?;
    let valid = std::str::from_utf8(&bytes).map_err(|error| error.valid_up_to());
    let file = sources.add(path.display().to_string(), String::from_utf8_lossy(&bytes));
    match valid {
        Ok(_) => Scenario::parse(sources, file).map_err(ScenarioFault::Diagnostic),
        Err(at) => {
            let span = Span { file, start: at as u32, end: (at + '\u{fffd}'.len_utf8()) as u32 };
            let fault = Diagnostic::error(codes::BAD_SCENARIO, "the file is not UTF-8", span).label("this byte begins no character");
            Err(ScenarioFault::Diagnostic(Box::new(fault.help("save the file in UTF-8"))))
        }
    }
}
