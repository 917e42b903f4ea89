//! From a file to a model ready to run.
//!
//! This is the one place that calls the front end: source text, scenario, variants and settings go in, a compiled model and the options of
//! its environments come out. A compiled model written by `smpl compile` is read as it is; it takes parameters, but no variants.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use smpl_compiler::artefact::{self, Circumstances, Header};
use smpl_compiler::compile::{Compiled, compile};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::{Options, Setting, is_entry_setting};
use smpl_compiler::json;
use smpl_compiler::read::read_sources;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes, suggest};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Statement, StatementKind};

use crate::catalogue::{self, Family};
use crate::files;
use crate::scenario::{self, Disturbances, Noise, Recorded, Scenario, Value, Variant};
use crate::setup::EnvironmentOptions;

/// Code of the diagnostic of a file that cannot be read.
pub const UNREADABLE: &str = codes::UNREADABLE.id();

/// Ending of files that hold a compiled model.
pub(crate) const ARTEFACT_EXTENSION: &str = "smplc";

/// Ending of files that hold a checked model in the form that `smpl export --to json` writes.
pub const JSON_EXTENSION: &str = "json";

/// Whether a file holds a model that was made for a scenario, variants and settings already.
#[must_use]
pub fn is_made(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == ARTEFACT_EXTENSION || e == JSON_EXTENSION)
}

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
    /// Statements that follow those of the model's file.
    pub extra: Option<String>,
    /// Keep intermediate text and assembly.
    pub texts: bool,
    /// Look for what is allowed but hardly meant, too.
    pub lints: bool,
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
    /// Hash of the texts, that of the scenario included: what a compiled model belongs to.
    pub fingerprint: [u8; 32],
    /// What the model is compiled for.
    pub circumstances: Circumstances,
}

impl Loaded {
    /// What of a compiled model is other than its text says, in words; empty where it is as it stands in the text.
    #[must_use]
    pub fn made_for(&self) -> String {
        let Circumstances { scenario, variants, settings } = &self.circumstances;
        let scenario = scenario.iter().map(|(name, _)| format!("scenario {name}"));
        let settings = settings.iter().map(|(name, value)| format!("{name} = {value}"));
        scenario.chain(variants.iter().map(|v| format!("variant {v}"))).chain(settings).collect::<Vec<_>>().join(", ")
    }
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
    let mut sources = SourceMap::new();
    let main = sources.add(path.display().to_string(), text);
    let scenario = match load_scenario(path, options, &mut sources) {
        Ok(scenario) => scenario,
        Err(ScenarioFault::Load(error)) => return Err(error),
        Err(ScenarioFault::Diagnostic(d)) => {
            return Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics: vec![*d] });
        }
    };
    let settings = settings_as_text(&mut sources, options);
    let extra = options.extra.as_ref().map(|text| sources.add("extra", text.clone()));
    match compiled(&mut sources, main, extra, &scenario, options) {
        Ok(Compiled { model, warnings, imports }) => {
            let texts = [main].into_iter().chain(extra).chain(imports).filter_map(|id| Some(sources.file(id)?.text()));
            let print = fingerprint(texts, scenario_text(&scenario, &sources));
            let circumstances = circumstances(&scenario, &sources, options);
            let loaded = finish(model, sources, &scenario, &options.settings, options)?;
            Ok(Loaded { warnings, fingerprint: print, circumstances, ..loaded })
        }
        Err(mut diagnostics) => {
            place_scenario_faults(&mut diagnostics, &scenario, &sources, settings);
            Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics })
        }
    }
}

/// Variants and settings of the call as a text of their own, for messages that point into it.
fn settings_as_text(sources: &mut SourceMap, options: &LoadOptions) -> Option<FileId> {
    let variants = options.variants.iter().map(|v| format!("{v}\n"));
    let settings = options.settings.iter().map(|(name, value)| format!("{name}={value}\n"));
    let text: String = variants.chain(settings).collect();
    (!text.is_empty()).then(|| sources.add("settings", text))
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

/// The front end knows names and values of a scenario and of settings, but not where they stand: each fault is moved to the name in the
/// scenario's file or in the settings, and said once.
fn place_scenario_faults(diagnostics: &mut Vec<Diagnostic>, scenario: &Scenario, sources: &SourceMap, settings: Option<FileId>) {
    let mut said = BTreeSet::new();
    diagnostics.retain(|d| d.code != codes::BAD_SCENARIO || said.insert(d.message.clone()));
    for diagnostic in diagnostics.iter_mut().filter(|d| d.code == codes::BAD_SCENARIO && d.primary.span == Span::default()) {
        let names: Vec<&str> = diagnostic.message.split('`').skip(1).step_by(2).collect();
        let line = |name: &&str| settings.and_then(|file| setting_line(sources, file, name));
        let place = names.iter().find_map(line).or_else(|| names.iter().find_map(|name| scenario.place_of(sources, name)));
        if let Some(span) = place.or_else(|| scenario.start().filter(|_| settings.is_none())) {
            diagnostic.primary.span = span;
        }
        diagnostic.message = scenario::shortened_names(&diagnostic.message);
    }
}

/// The line of the settings that a name begins.
fn setting_line(sources: &SourceMap, file: FileId, name: &str) -> Option<Span> {
    let mut start = 0;
    for line in sources.file(file)?.text().lines() {
        if line.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('=')) {
            return Some(Span { file, start, end: start + line.len() as u32 });
        }
        start += line.len() as u32 + 1;
    }
    None
}

/// Compiles a text with everything that the scenario and the options say about it.
fn compiled(
    sources: &mut SourceMap,
    main: FileId,
    extra: Option<FileId>,
    scenario: &Scenario,
    options: &LoadOptions,
) -> Result<Compiled, Vec<Diagnostic>> {
    let folder = Path::new(sources.name(main)).parent().map(Path::to_owned).unwrap_or_default();
    let asked = Options { extra, ..compile_options(sources, scenario, options)? };
    let settings = BackEndSettings { texts: options.texts, ..BackEndSettings::default() };
    compile(sources, main, &mut |path| import(&folder, path), &asked, &settings)
}

/// The text that `use "path"` means: a file beside the model or in the library (`SMPL_LIBRARY`), never outside them.
pub(crate) fn import(folder: &Path, path: &str) -> Option<(String, String)> {
    let library = std::env::var_os("SMPL_LIBRARY").and_then(|root| Path::new(&root).canonicalize().ok());
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    [Some(here.to_owned()), library.clone()].into_iter().flatten().find_map(|root| {
        let root = root.canonicalize().ok()?;
        let file = root.join(path).canonicalize().ok()?;
        let text = file.starts_with(&root).then(|| files::read_text(&file).ok())??;
        let name = if Some(&root) == library.as_ref() { file } else { folder.join(path) };
        Some((name.display().to_string(), text))
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
    for layer in [&scenario.parameters, &scenario.settings, &options.settings] {
        // A later whole array hides the elements of an earlier layer.
        let element = |known: &str| known.split_once('[').is_some_and(|(array, _)| layer.contains_key(array));
        out.settings.retain(|known, _| !element(known));
        for (name, value) in layer {
            out.settings.insert(name.clone(), setting(name, value)?);
        }
    }
    for (name, value) in &scenario.initial {
        match value.number() {
            Some(number) => {
                out.initial.insert(name.clone(), number);
            }
            None => out.overlay.push(distribution(sources, scenario, name, value).map_err(|d| vec![*d])?),
        }
    }
    out.lints = options.lints;
    Ok(out)
}

fn setting(name: &str, value: &Value) -> Result<Setting, Vec<Diagnostic>> {
    if let Some(number) = value.numbers().iter().find(|x| !x.is_finite()) {
        let message = format!("`{name}` takes a finite number, not `{number}`");
        return Err(vec![Diagnostic::error(codes::BAD_SCENARIO, message, Span::default())]);
    }
    Ok(match value {
        Value::Number(number) => Setting::Number(*number),
        Value::List(list) => Setting::List(list.clone()),
        Value::Flag(_) | Value::Text(_) => Setting::Text(value.to_string()),
    })
}

/// A distribution of a scenario is one expression of the language, which stands in a statement of our own and brings no other.
fn distribution(sources: &mut SourceMap, scenario: &Scenario, name: &str, value: &Value) -> Result<Statement, Box<Diagnostic>> {
    let text = format!("initial {name} ~ {value}");
    let file = sources.add("initial of the scenario", text.clone());
    let parsed = smpl_dsl::parse(&text, file);
    let alone = |kind: &StatementKind| matches!(kind, StatementKind::Initial { clip: None, binders, .. } if binders.is_empty());
    let fault = parsed.diagnostics.shown().into_iter().find(Diagnostic::is_error).map(|d| d.message);
    match (fault, <[Statement; 1]>::try_from(parsed.file.statements)) {
        (None, Ok([statement])) if alone(&statement.kind) && !text.contains(['\n', '{', '#']) => Ok(statement),
        (fault, _) => {
            let why = fault.map(|fault| format!(": {fault}")).unwrap_or_default();
            let message = format!("the initial value of `{name}` must be a number or one expression such as `uniform(0.5, 1)`{why}");
            Err(Box::new(Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, "initial", name))))
        }
    }
}

/// Hash of the texts of a model and of its scenario.
fn fingerprint<'t>(texts: impl Iterator<Item = &'t str>, scenario: &str) -> [u8; 32] {
    let mut texts: Vec<&str> = texts.collect();
    texts.sort_unstable();
    artefact::fingerprint(&texts, scenario.as_bytes())
}

/// Refuses a compiled model whose source or scenario beside it has changed since, or cannot be looked at.
fn check_source(path: &Path, header: &Header) -> Result<(), LoadError> {
    let source = path.with_extension("eq");
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let look = |file: &Path| match files::read_text(file) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => {
            let message = format!("whether it belongs to {} cannot be told, which cannot be read: {}", file.display(), plain(&error));
            Err(refuse(message))
        }
    };
    let Some(text) = look(&source)? else { return Ok(()) };
    let scenario = match &header.circumstances.scenario {
        Some((name, text)) => look(&scenario::find_file(&source, name))?.unwrap_or_else(|| text.clone()),
        None => String::new(),
    };
    let mut sources = SourceMap::new();
    let main = sources.add(source.display().to_string(), text);
    let folder = source.parent().map(Path::to_owned).unwrap_or_default();
    read_sources(&mut sources, main, &mut |name| import(&folder, name));
    let texts = (0..sources.len()).filter_map(|i| Some(sources.file(FileId(i as u16))?.text()));
    if header.fingerprint == fingerprint(texts, &scenario) {
        return Ok(());
    }
    let what = if header.circumstances.scenario.is_some() { " or its scenario" } else { "" };
    Err(refuse(format!("{}{what} has changed since; run `smpl compile` again", source.display())))
}

fn load_artefact(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Loaded, LoadError> {
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let model = CompiledModel::from_bytes(bytes).map_err(|error| refuse(error.to_string()))?;
    let header = artefact::header_of_user(bytes).map_err(|error| refuse(error.to_string()))?;
    if options.extra.is_some() {
        return Err(refuse("a compiled model takes no further statements: give `extra` with the model's text".into()));
    }
    check_source(path, &header)?;
    same_circumstances(&header.circumstances, options).map_err(refuse)?;
    let loaded = made(path, model, &header.circumstances, options)?;
    Ok(Loaded { fingerprint: header.fingerprint, circumstances: header.circumstances, ..loaded })
}

/// A checked model names what it was made for: that need not be said again, and nothing else may be.
fn load_json(path: &Path, text: &str, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    if options.extra.is_some() {
        return Err(refuse("a model in JSON takes no further statements: give `extra` with the model's text".into()));
    }
    let json::Read { model, circumstances } = json::read(text).map_err(|error| refuse(error.to_string()))?;
    if options.scenario.is_some() || !options.variants.is_empty() {
        same_circumstances(&circumstances, options).map_err(refuse)?;
    }
    let settings = BackEndSettings { texts: options.texts, ..BackEndSettings::default() };
    let model = CompiledModel::build(model, &settings).map_err(|error| refuse(error.to_string()))?;
    let loaded = made(path, model, &circumstances, options)?;
    Ok(Loaded { fingerprint: artefact::fingerprint(&[text], &[]), circumstances, ..loaded })
}

/// A model that was made for a scenario and settings, with those of the call on top.
fn made(path: &Path, model: CompiledModel, made_for: &Circumstances, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let mut sources = SourceMap::new();
    let scenario = match &made_for.scenario {
        None => Scenario::default(),
        Some((name, text)) => {
            let file = sources.add(name.clone(), text.clone());
            Scenario::parse(&sources, file).map_err(|d| refuse(d.message))?
        }
    };
    let parameters = catalogue::parameters(&model);
    for name in options.settings.keys() {
        if catalogue::elements_of(&model, &parameters, name).is_empty() {
            return Err(LoadError::Setting { message: unknown_setting(&model, &parameters, name) });
        }
    }
    let mut settings: BTreeMap<String, Value> = made_for.settings.iter().map(|(name, value)| (name.clone(), Value::parse(value))).collect();
    settings.extend(options.settings.clone());
    finish(model, sources, &scenario, &settings, options)
}

/// A compiled model runs under what it was compiled for, which has to be named again.
fn same_circumstances(made_for: &Circumstances, options: &LoadOptions) -> Result<(), String> {
    let asked = options.scenario.as_deref().filter(|name| *name != "default");
    let variants: Vec<String> = options.variants.iter().map(Variant::to_string).collect();
    let made = made_for.scenario.as_ref().map(|(name, _)| name.as_str());
    let named = |what: &str, names: &[String]| match names {
        [] => format!("no {what}"),
        names => format!("{what} {}", names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")),
    };
    let list = |name: Option<&str>| name.map(str::to_owned).into_iter().collect::<Vec<String>>();
    if asked != made {
        let (made, asked) = (named("scenario", &list(made)), named("scenario", &list(asked)));
        return Err(format!(
            "a compiled model takes neither scenario nor variants but its own: it was compiled for {made}, asked for is {asked}"
        ));
    }
    if variants != made_for.variants {
        let (made, asked) = (named("variant", &made_for.variants), named("variant", &variants));
        return Err(format!(
            "a compiled model takes neither scenario nor variants but its own: it was compiled for {made}, asked for is {asked}"
        ));
    }
    Ok(())
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
pub(crate) fn files_of(path: &Path) -> Vec<PathBuf> {
    let mut sources = SourceMap::new();
    if let Ok(text) = files::read_text(path) {
        let main = sources.add(path.display().to_string(), text);
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        read_sources(&mut sources, main, &mut |name| import(&folder, name));
    }
    let imports = (1..sources.len()).map(|i| PathBuf::from(sources.name(FileId(i as u16))));
    [path.to_owned()].into_iter().chain(imports).collect()
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
    let bytes = files::read(&path).map_err(|error| {
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

/// Options of the environments: what of scenario and settings is not in the compiled model.
fn finish(
    model: CompiledModel,
    sources: SourceMap,
    scenario: &Scenario,
    settings: &BTreeMap<String, Value>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let faults: Vec<Diagnostic> =
        names_of_scenario(scenario, &model, &sources).into_iter().chain(grid_faults(scenario, &model, &sources)).collect();
    if !faults.is_empty() {
        return Err(LoadError::Diagnostics { sources: Arc::new(sources), diagnostics: faults });
    }
    let mut environment = EnvironmentOptions {
        reward: options.reward.clone().or_else(|| scenario.reward.clone()),
        max_steps: scenario.max_steps,
        rtol: scenario.solver.rtol,
        atol_factor: scenario.solver.atol_factor,
        max_order: scenario.solver.max_order,
        max_step: scenario.solver.max_step,
        algebraic_error_control: scenario.solver.algebraic_error_control,
        quadrature_error_control: scenario.solver.quadrature_error_control,
        solver_steps: scenario.solver.max_steps,
        max_events: scenario.solver.max_events,
        linear_solver: scenario.solver.linear_solver.clone(),
        method: scenario.solver.method.clone(),
        parameters: given_parameters(&model, [&scenario.parameters, &scenario.settings, settings])?,
        ..EnvironmentOptions::default()
    };
    environment.disturbances = recorded(scenario, &model);
    environment.held = held(scenario);
    environment.noise = match &scenario.noise {
        None | Some(Noise::Switch(true)) => BTreeMap::new(),
        Some(Noise::Switch(false)) => model.interface().observations.iter().map(|o| (o.name.clone(), 0.0)).collect(),
        Some(Noise::Deviations(deviations)) => deviations.clone(),
    };
    Ok(Loaded {
        model: Arc::new(model),
        options: environment,
        sources: Arc::new(sources),
        warnings: Vec::new(),
        fingerprint: [0; 32],
        circumstances: Circumstances::default(),
    })
}

/// Values of parameters, element by element; later layers win.
fn given_parameters(model: &CompiledModel, layers: [&BTreeMap<String, Value>; 3]) -> Result<BTreeMap<String, f64>, LoadError> {
    let parameters = catalogue::parameters(model);
    let mut given = BTreeMap::new();
    for (name, value) in layers.into_iter().flatten() {
        let elements = catalogue::elements_of(model, &parameters, name);
        let wrong = |expected: String| LoadError::Setting { message: format!("parameter `{name}` must be {expected}, not `{value}`") };
        match (elements, value) {
            ([], _) => {}
            (elements, Value::Number(x)) => given.extend(elements.iter().map(|e| (e.name.clone(), *x))),
            (elements, Value::List(list)) if list.len() == elements.len() => {
                given.extend(elements.iter().zip(list).map(|(e, x)| (e.name.clone(), *x)));
            }
            (elements, Value::List(_)) => return Err(wrong(format!("a list of {}", elements.len()))),
            ([element, ..], _) => return Err(wrong(format!("a number (in {})", element.unit))),
        }
    }
    Ok(given)
}

/// Names of noise and disturbances that the model does not have, at their places.
fn names_of_scenario(scenario: &Scenario, model: &CompiledModel, sources: &SourceMap) -> Vec<Diagnostic> {
    let mut faults = Vec::new();
    let mut compare = |key: &str, kind, given: Vec<&String>, known: Vec<&str>| {
        for name in given.into_iter().filter(|name| !known.contains(&name.as_str())) {
            let message = crate::catalogue::UnknownName::new(kind, name, known.iter().copied()).to_string();
            faults.push(Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, key, name)));
        }
    };
    if let Some(Noise::Deviations(deviations)) = &scenario.noise {
        let known = model.interface().observations.iter().map(|o| o.name.as_str()).collect();
        compare("noise", "observation", deviations.keys().collect(), known);
    }
    if let Some(Disturbances::Values(values)) = &scenario.disturbances {
        let elements = catalogue::disturbances(model);
        compare("disturbances", "disturbance", values.keys().collect(), elements.names().collect());
    }
    faults
}

/// Parameters under `grid` that are no numbers of cells.
fn grid_faults(scenario: &Scenario, model: &CompiledModel, sources: &SourceMap) -> Vec<Diagnostic> {
    let shapes_nothing = |name: &&String| model.interface().parameters.iter().any(|p| p.name == **name && !p.structural);
    let fault = |name: &String| {
        let message = format!("`{name}` is no number of cells");
        Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, "grid", name))
            .help("values of parameters stand under `parameters`")
    };
    scenario.grid.keys().filter(shapes_nothing).map(fault).collect()
}

/// Recorded disturbances whose last value is to hold.
fn held(scenario: &Scenario) -> BTreeSet<String> {
    let Some(Disturbances::Values(values)) = &scenario.disturbances else { return BTreeSet::new() };
    let holds = |recorded: &Recorded| matches!(recorded, Recorded::Sequence { hold: true, .. } | Recorded::Constant(_));
    values.iter().filter(|(_, recorded)| holds(recorded)).map(|(name, _)| name.clone()).collect()
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
                Recorded::Sequence { values, .. } => (name.clone(), values.clone()),
            })
            .collect(),
    }
}

/// A compiled model takes parameters alone: all else is decided.
fn unknown_setting(model: &CompiledModel, parameters: &Family, name: &str) -> String {
    let interface = model.interface();
    let decided =
        is_entry_setting(name) || interface.choices.iter().any(|(n, ..)| n == name) || interface.variants.iter().any(|(n, _)| n == name);
    if decided {
        return format!("a compiled model takes parameters: `{name}` is set where it is compiled");
    }
    crate::catalogue::UnknownName::new("parameter", name, parameters.names()).to_string()
}
