//! From a file to a model ready to run.
//!
//! This is the one place that calls the front end: source text, scenario, variants and settings go in, a compiled model and the options of
//! its environments come out. A compiled model written by `smpl compile` is read as it is; it takes parameters, but no variants.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::{Options, Setting};
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes, suggest};
use smpl_dsl::span::{FileId, Span};

use crate::catalogue::{self, Family};
use crate::scenario::{self, Disturbances, Noise, Recorded, Scenario, Value, Variant};
use crate::setup::EnvironmentOptions;

/// Code of the diagnostic of a file that cannot be read.
pub const UNREADABLE: &str = "E0700-unreadable";

/// Ending of files that hold a compiled model.
pub const ARTEFACT_EXTENSION: &str = "smplc";

/// What is asked of a model beside its text.
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
    /// Keep intermediate text and assembly.
    pub texts: bool,
}

/// A model ready to run.
pub struct Loaded {
    /// The compiled model.
    pub model: Arc<CompiledModel>,
    /// What its environments take from the scenario and the settings.
    pub options: EnvironmentOptions,
    /// All texts.
    pub sources: Arc<SourceMap>,
    /// Warnings of the compilation.
    pub warnings: Vec<Diagnostic>,
}

/// Why a model cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file cannot be read.
    #[error("{}: {message}{advice}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What kind of fault it is; `InvalidData` where the text is not UTF-8.
        kind: std::io::ErrorKind,
        /// Why.
        message: String,
        /// What to do; may be empty.
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
        /// What is wrong and what would be right.
        message: String,
    },
    /// A compiled model that cannot be used.
    #[error("{}: {message}", path.display())]
    Artefact {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
}

fn summary(diagnostics: &[Diagnostic]) -> String {
    let texts: Vec<&str> = diagnostics.iter().filter(|d| d.is_error()).map(|d| d.message.as_str()).collect();
    texts.join("; ")
}

/// Loads a model from a file: text (`.eq`) or a compiled model.
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
        message: format!("not UTF-8 at byte {}", error.utf8_error().valid_up_to()),
        advice: String::new(),
    })?;
    load_text(path, text, options)
}

/// Loads a model from text; `path` names it and says where scenarios and imports are looked for.
///
/// # Errors
/// See [`LoadError`].
pub fn load_text(path: &Path, text: String, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let mut sources = SourceMap::new();
    let main = sources.add(path.display().to_string(), text);
    let scenario = match load_scenario(path, options, &mut sources) {
        Ok(scenario) => scenario,
        Err(ScenarioFault::Load(error)) => return Err(error),
        Err(ScenarioFault::Diagnostic(d)) => {
            return Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics: vec![*d] });
        }
    };
    match front_end(&mut sources, main, &scenario, options) {
        Ok((model, warnings)) => finish(model, warnings, sources, &scenario, options),
        Err(mut diagnostics) => {
            place_scenario_faults(&mut diagnostics, &scenario, &sources);
            Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics })
        }
    }
}

/// The front end knows names and values of a scenario, but not where they stand: each fault is moved to the name in the scenario's file,
/// if it is from there, and said once.
fn place_scenario_faults(diagnostics: &mut Vec<Diagnostic>, scenario: &Scenario, sources: &SourceMap) {
    let mut said = BTreeSet::new();
    diagnostics.retain(|d| d.code != codes::BAD_SCENARIO || said.insert(d.message.clone()));
    for diagnostic in diagnostics.iter_mut().filter(|d| d.code == codes::BAD_SCENARIO) {
        let names = diagnostic.message.split('`').skip(1).step_by(2);
        if let Some(span) = names.filter_map(|name| scenario.place_of(sources, name)).next() {
            diagnostic.primary.span = span;
        }
    }
}

/// Compiles a text with everything that the scenario and the options say about it.
fn front_end(
    sources: &mut SourceMap,
    main: FileId,
    scenario: &Scenario,
    options: &LoadOptions,
) -> Result<(CompiledModel, Vec<Diagnostic>), Vec<Diagnostic>> {
    let folder = Path::new(sources.name(main)).parent().map(Path::to_owned).unwrap_or_default();
    let asked = compile_options(sources, scenario, options)?;
    let mut loader = |path: &str| import(&folder, path);
    let (model, warnings) = smpl_compiler::front::flatten(sources, main, &mut loader, &asked)?;
    let settings = BackEndSettings { texts: options.texts, ..BackEndSettings::default() };
    let built = CompiledModel::build(model, &settings);
    let whole = Span { file: main, start: 0, end: 0 };
    built.map(|model| (model, warnings)).map_err(|e| vec![Diagnostic::error(codes::BACK_END, e.to_string(), whole)])
}

/// The text that `use "path"` means: a file beside the model or in the library (`SMPL_LIBRARY`), never outside them.
fn import(folder: &Path, path: &str) -> Option<(String, String)> {
    let library = std::env::var_os("SMPL_LIBRARY").map(PathBuf::from);
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    [Some(here.to_owned()), library].into_iter().flatten().find_map(|root| {
        let root = root.canonicalize().ok()?;
        let file = root.join(path).canonicalize().ok()?;
        let text = file.starts_with(&root).then(|| fs::read_to_string(&file).ok())??;
        Some((folder.join(path).display().to_string(), text))
    })
}

/// What scenario and options ask of the front end; later ones win.
fn compile_options(sources: &mut SourceMap, scenario: &Scenario, options: &LoadOptions) -> Result<Options, Vec<Diagnostic>> {
    let mut out = Options { observation: options.observation.clone().or_else(|| scenario.observation.clone()), ..Options::default() };
    out.reward = options.reward.clone().or_else(|| scenario.reward.clone());
    out.max_steps = scenario.max_steps;
    for variant in scenario.variants.iter().chain(&options.variants) {
        out.variants.push((variant.name.clone(), variant.option.clone().unwrap_or_else(|| "true".into())));
    }
    for (name, cells) in &scenario.grid {
        out.settings.insert(name.clone(), Setting::Number(f64::from(*cells)));
    }
    for (name, value) in scenario.parameters.iter().chain(&scenario.settings).chain(&options.settings) {
        let setting = match value.number() {
            Some(number) if !number.is_finite() => {
                let message = format!("`{name}` takes a finite number, not `{number}`");
                return Err(vec![Diagnostic::error(codes::BAD_SCENARIO, message, Span::default())]);
            }
            Some(number) => Setting::Number(number),
            None => Setting::Text(value.to_string()),
        };
        out.settings.insert(name.clone(), setting);
    }
    // Distributions of a scenario are statements of the language.
    let mut text = String::new();
    for (name, value) in &scenario.initial {
        match value.number() {
            Some(number) => {
                out.initial.insert(name.clone(), number);
            }
            None => text.push_str(&format!("initial {name} ~ {value}\n")),
        }
    }
    if !text.is_empty() {
        let file = sources.add("initial of the scenario", text.clone());
        let parsed = smpl_dsl::parse(&text, file);
        if parsed.diagnostics.iter().any(Diagnostic::is_error) {
            return Err(parsed.diagnostics.shown());
        }
        out.overlay = parsed.file.statements;
    }
    Ok(out)
}

/// Hash of all texts of a compilation but those of scenarios: what a compiled model belongs to.
#[must_use]
pub fn fingerprint(sources: &SourceMap) -> [u8; 32] {
    let of_model = |id: &FileId| Path::new(sources.name(*id)).extension().is_some_and(|e| e == "eq");
    let mut texts: Vec<&str> =
        (0..sources.len()).map(|i| FileId(i as u16)).filter(of_model).filter_map(|id| Some(sources.file(id)?.text())).collect();
    texts.sort_unstable();
    smpl_compiler::artefact::fingerprint(&texts, &[])
}

/// Refuses a compiled model whose source beside it has changed since.
fn check_source(path: &Path, bytes: &[u8]) -> Result<(), LoadError> {
    let source = path.with_extension("eq");
    let Ok(text) = fs::read_to_string(&source) else { return Ok(()) };
    let stale = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let mut sources = SourceMap::new();
    let main = sources.add(source.display().to_string(), text);
    let folder = source.parent().map(Path::to_owned).unwrap_or_default();
    smpl_compiler::front::read(&mut sources, main, &mut |name| import(&folder, name));
    let header = smpl_compiler::artefact::header_of_user(bytes).map_err(|error| stale(error.to_string()))?;
    if header.fingerprint == fingerprint(&sources) {
        return Ok(());
    }
    Err(stale(format!("{} has changed since; run `smpl compile` again", source.display())))
}

fn load_artefact(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Loaded, LoadError> {
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let model = CompiledModel::from_bytes(bytes).map_err(|error| refuse(error.to_string()))?;
    check_source(path, bytes)?;
    if !options.variants.is_empty() || options.scenario.as_deref().is_some_and(|s| s != "default") {
        return Err(refuse("a compiled model takes neither scenario nor variants: give the `.eq` file".into()));
    }
    finish(model, Vec::new(), SourceMap::new(), &Scenario::default(), options)
}

fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    let fault = |error: std::io::Error| LoadError::Read {
        path: path.to_owned(),
        kind: error.kind(),
        message: plain(&error),
        advice: String::new(),
    };
    fs::read(path).map_err(fault)
}

/// The error without the operating system's number.
pub(crate) fn plain(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "no such file".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        std::io::ErrorKind::IsADirectory => "is a directory".into(),
        _ => error.to_string(),
    }
}

enum ScenarioFault {
    Load(LoadError),
    Diagnostic(Box<Diagnostic>),
}

fn load_scenario(model: &Path, options: &LoadOptions, sources: &mut SourceMap) -> Result<Scenario, ScenarioFault> {
    let Some(name) = options.scenario.as_deref().filter(|name| *name != "default") else {
        return Ok(Scenario::default());
    };
    let path = scenario::find_file(model, name);
    let text = fs::read_to_string(&path).map_err(|error| {
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
    let file = sources.add(path.display().to_string(), text);
    Scenario::parse(sources, file).map_err(ScenarioFault::Diagnostic)
}

/// Options of the environments: what of scenario and settings is not in the compiled model.
fn finish(
    model: CompiledModel,
    warnings: Vec<Diagnostic>,
    sources: SourceMap,
    scenario: &Scenario,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let parameters = catalogue::parameters(&model);
    let mut environment = EnvironmentOptions {
        reward: options.reward.clone().or_else(|| scenario.reward.clone()),
        max_steps: scenario.max_steps,
        rtol: scenario.solver.rtol,
        atol_factor: scenario.solver.atol_factor,
        max_order: scenario.solver.max_order,
        solver_steps: scenario.solver.max_steps,
        linear_solver: scenario.solver.linear_solver.clone(),
        ..EnvironmentOptions::default()
    };
    for (name, value) in scenario.parameters.iter().chain(&options.settings) {
        match (parameters.find(name), value.number()) {
            (Some(_), Some(number)) => {
                environment.parameters.insert(name.clone(), number);
            }
            (Some(element), None) if options.settings.contains_key(name) => {
                let message = format!("parameter `{name}` must be a number (in {}), not `{value}`", element.unit);
                return Err(LoadError::Setting { message });
            }
            _ => {}
        }
    }
    environment.disturbances = recorded(scenario, &model);
    environment.noise = match &scenario.noise {
        None | Some(Noise::Switch(true)) => BTreeMap::new(),
        Some(Noise::Switch(false)) => model.interface().observations.iter().map(|o| (o.name.clone(), 0.0)).collect(),
        Some(Noise::Deviations(deviations)) => deviations.clone(),
    };
    let known = |name: &str| knows_setting(&model, &parameters, name);
    if let Some(name) = options.settings.keys().find(|name| !known(name)) {
        return Err(LoadError::Setting { message: unknown_setting(&model, &parameters, name) });
    }
    Ok(Loaded { model: Arc::new(model), options: environment, sources: Arc::new(sources), warnings })
}

fn recorded(scenario: &Scenario, model: &CompiledModel) -> BTreeMap<String, Vec<f64>> {
    match &scenario.disturbances {
        None | Some(Disturbances::Switch(true)) => BTreeMap::new(),
        Some(Disturbances::Switch(false)) => {
            let elements = catalogue::disturbances(model);
            elements.elements().iter().map(|e| (e.name.clone(), vec![if e.default.is_finite() { e.default } else { 0.0 }])).collect()
        }
        Some(Disturbances::Values(values)) => values
            .iter()
            .map(|(name, recorded)| match recorded {
                Recorded::Constant(x) => (name.clone(), vec![*x]),
                Recorded::Sequence(xs) => (name.clone(), xs.clone()),
            })
            .collect(),
    }
}

/// Whether the compiled model has a parameter, choice or variant of that name. Names of grids were settled by the front end.
fn knows_setting(model: &CompiledModel, parameters: &Family, name: &str) -> bool {
    let interface = model.interface();
    parameters.find(name).is_some()
        || smpl_compiler::elaborate::ENTRY_SETTINGS.contains(&name)
        || interface.choices.iter().any(|(n, ..)| n == name)
        || interface.variants.iter().any(|(n, _)| n == name)
}

fn unknown_setting(model: &CompiledModel, parameters: &Family, name: &str) -> String {
    let interface = model.interface();
    let choices = interface.choices.iter().map(|(n, ..)| n.as_str());
    crate::catalogue::UnknownName::new("setting", name, choices.chain(parameters.names())).to_string()
}
