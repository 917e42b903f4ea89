//! Scenarios: YAML files that say under which circumstances a model is run.
//!
//! A scenario `legacy` of `models/reactor.eq` is `models/reactor.legacy.yaml`. Names inside are
//! checked against the model after it is compiled; keys of the scenario itself are checked here,
//! with their place in the file.

mod places;
#[cfg(test)]
mod tests;
mod values;
mod words;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes, did_you_mean};
use smpl_dsl::span::{FileId, Span};

use crate::setup::SolverOverrides;
use places::{find_name, find_under, second_key};
use values::Entries;
pub(crate) use words::{shortened, shortened_names};

/// A value of a setting, a parameter or an initial value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Flag(bool),
    /// A number.
    Number(f64),
    /// A name of a choice, or an expression of the language.
    Text(String),
    /// The elements of an array, in their order.
    List(Vec<f64>),
}

impl Value {
    /// Value of a command-line argument: a number, a flag, `[1, 2]`, otherwise text.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let list = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
        let numbers = list.and_then(|list| list.split(',').map(|x| x.trim().parse().ok()).collect());
        if let Some(numbers) = numbers {
            return Value::List(numbers);
        }
        match (text, text.parse::<f64>()) {
            ("true", _) => Value::Flag(true),
            ("false", _) => Value::Flag(false),
            (_, Ok(number)) => Value::Number(number),
            _ => Value::Text(text.to_owned()),
        }
    }

    /// The number, if it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Number(x) => Some(*x),
            _ => None,
        }
    }

    /// All numbers in it.
    #[must_use]
    pub fn numbers(&self) -> &[f64] {
        match self {
            Value::Number(x) => std::slice::from_ref(x),
            Value::List(list) => list,
            Value::Flag(_) | Value::Text(_) => &[],
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Flag(flag) => write!(f, "{flag}"),
            Value::Number(x) => write!(f, "{x}"),
            Value::Text(text) => f.write_str(text),
            Value::List(list) => write!(f, "{list:?}"),
        }
    }
}

/// A variant that is on: a switch, or a choice with its option.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Name of the switch or the choice.
    pub name: String,
    /// The option of a choice.
    pub option: Option<String>,
}

impl Variant {
    /// From `NAME` or `NAME=OPTION`.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        match text.split_once('=') {
            Some((name, option)) => Self { name: name.trim().into(), option: Some(option.trim().into()) },
            None => Self { name: text.trim().into(), option: None },
        }
    }
}

impl std::fmt::Display for Variant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.option {
            Some(option) => write!(f, "{}={option}", self.name),
            None => f.write_str(&self.name),
        }
    }
}

/// An entry of `variants`: `vacuole_flux`, `axial_scheme=legacy` or `axial_scheme: legacy`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
enum VariantEntry {
    Name(String),
    Choice(Entries<Value>),
}

/// Disturbances of a scenario: on or off, or values that replace the drawn ones.
#[derive(Clone, Debug, PartialEq)]
pub enum Disturbances {
    /// All drawn (`true`) or all at their initial values (`false`).
    Switch(bool),
    /// One value for all steps, or one a step, by name.
    Values(BTreeMap<String, Recorded>),
}

/// A recorded disturbance.
#[derive(Clone, Debug, PartialEq)]
pub enum Recorded {
    /// The same in all steps.
    Constant(f64),
    /// One value a step.
    Sequence {
        /// The values.
        values: Vec<f64>,
        /// The last one holds from there on.
        hold: bool,
    },
    /// Data over time in a file, of a disturbance that the model declares with `from`.
    File {
        /// Path from the folder of the model.
        path: String,
        /// `step`, `linear` or `cubic`; as declared where left out.
        reading: Option<String>,
        /// Reading outside of the data; as declared where left out.
        outside: Option<String>,
    },
}

/// Noise of observations: on or off, or standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub enum Noise {
    /// As the model declares (`true`) or none (`false`).
    Switch(bool),
    /// Standard deviations by observation.
    Deviations(BTreeMap<String, f64>),
}

/// The file as it is written.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    parameters: Entries<Value>,
    #[serde(default)]
    settings: Entries<Value>,
    #[serde(default)]
    variants: Vec<VariantEntry>,
    #[serde(default)]
    grid: Entries<u32>,
    #[serde(default)]
    initial: Entries<Value>,
    disturbances: Option<Disturbances>,
    reward: Option<String>,
    observation: Option<String>,
    noise: Option<Noise>,
    #[serde(default)]
    solver: SolverOverrides,
    max_steps: Option<u32>,
}

/// Message for a repeated key of a mapping.
const TWICE: &str = "is given twice";

/// Under which circumstances a model is run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scenario {
    /// Parameters: numbers, or expressions.
    pub parameters: BTreeMap<String, Value>,
    /// Settings.
    pub settings: BTreeMap<String, Value>,
    /// Variants that are on.
    pub variants: Vec<Variant>,
    /// Numbers of cells.
    pub grid: BTreeMap<String, u32>,
    /// Initial values or distributions.
    pub initial: BTreeMap<String, Value>,
    /// Disturbances.
    pub disturbances: Option<Disturbances>,
    /// The reward that is returned.
    pub reward: Option<String>,
    /// Level of observation.
    pub observation: Option<String>,
    /// Noise of observations.
    pub noise: Option<Noise>,
    /// Solver settings.
    pub solver: SolverOverrides,
    /// Time limit in steps.
    pub max_steps: Option<u32>,
    /// The file it comes from; the default scenario has none.
    pub file: Option<FileId>,
}

impl Scenario {
    /// Reads a scenario whose text is in the source map.
    ///
    /// # Errors
    /// One diagnostic that points into the file.
    pub fn parse(sources: &SourceMap, file: FileId) -> Result<Self, Box<Diagnostic>> {
        let text = sources.file(file).map_or("", |f| f.text());
        if text.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#')) {
            return Ok(Self { file: Some(file), ..Self::default() });
        }
        if let Some(at) = too_deep(text) {
            let span = Span { file, start: at as u32, end: at as u32 + 1 };
            let message = format!("brackets inside one another, more than {MAX_NESTING} deep");
            return Err(Box::new(Diagnostic::error(codes::BAD_SCENARIO, message, span)));
        }
        let raw: File = serde_yaml::from_str(text).map_err(|error| Box::new(diagnose(&error, text, file)))?;
        let scenario = Self {
            parameters: raw.parameters.0,
            settings: raw.settings.0,
            variants: raw.variants.into_iter().flat_map(VariantEntry::into_variants).collect(),
            grid: raw.grid.0,
            initial: raw.initial.0,
            disturbances: raw.disturbances,
            reward: raw.reward,
            observation: raw.observation,
            noise: raw.noise,
            solver: raw.solver,
            max_steps: raw.max_steps,
            file: Some(file),
        };
        match scenario.bad_value() {
            None => Ok(scenario),
            Some((key, name, message)) => {
                Err(Box::new(Diagnostic::error(codes::BAD_SCENARIO, message, find_under(text, key, &name, file))))
            }
        }
    }

    /// The first name that is given under two keys, or with two options, which say what it is: the
    /// second key, and the name.
    fn twice(&self) -> Option<(&'static str, String)> {
        let first = |name: &str| self.variants.iter().position(|variant| variant.name == name);
        let mut variants = self.variants.iter().enumerate();
        if let Some((_, variant)) = variants.find(|(i, variant)| first(&variant.name) != Some(*i)) {
            return Some(("variants", variant.name.clone()));
        }
        let elsewhere = |name: &String| {
            self.parameters.contains_key(name)
                || self.variants.iter().any(|variant| variant.name == *name)
                || (name == "max_steps" && self.max_steps.is_some())
                || self.solver.names().any(|solver| solver == name)
        };
        self.settings.keys().find(|name| elsewhere(name)).map(|name| ("settings", name.clone()))
    }

    /// The first invalid number: its key, its name, and the reason.
    fn bad_value(&self) -> Option<(&'static str, String, String)> {
        let fault = |key, name: &str, message: String| Some((key, name.to_owned(), message));
        if self.max_steps == Some(0) {
            return fault("max_steps", "max_steps", "`max_steps` must be at least 1, not 0".into());
        }
        if let Some((key, name)) = self.twice() {
            return fault(key, &name, format!("`{}` {TWICE}", shortened(&name)));
        }
        if let Some((name, expected, given)) = self.solver.bad_value() {
            return fault("solver", name, format!("`{name}` must be {expected}, not {given}"));
        }
        for (key, values) in [("parameters", &self.parameters), ("settings", &self.settings), ("initial", &self.initial)] {
            let not_finite = |value: &Value| value.numbers().iter().copied().find(|x| !x.is_finite());
            if let Some((name, x)) = values.iter().find_map(|(name, value)| Some((name, not_finite(value)?))) {
                return fault(key, name, format!("`{}` takes a finite number, not `{x}`", shortened(name)));
            }
        }
        if let Some(Noise::Deviations(deviations)) = &self.noise
            && let Some((name, x)) = deviations.iter().find(|(_, x)| !(x.is_finite() && **x >= 0.0))
        {
            return fault("noise", name, format!("the noise of `{}` must be a standard deviation, not {x}", shortened(name)));
        }
        let Some(Disturbances::Values(values)) = &self.disturbances else { return None };
        let (name, message) = values.iter().find_map(|(name, recorded)| Some((name, recorded.fault()?)))?;
        fault("disturbances", name, format!("the disturbance `{}` {message}", shortened(name)))
    }
}

impl Recorded {
    /// One value a step; a constant is one, and a file has none.
    pub(crate) fn values(&self) -> &[f64] {
        match self {
            Recorded::File { .. } => &[],
            Recorded::Constant(x) => std::slice::from_ref(x),
            Recorded::Sequence { values, .. } => values,
        }
    }

    /// Error.
    fn fault(&self) -> Option<&'static str> {
        match self {
            Recorded::Constant(x) if !x.is_finite() => Some("takes finite numbers"),
            Recorded::Sequence { values, .. } if values.is_empty() => Some("has no values"),
            Recorded::Sequence { values, .. } if !values.iter().all(|x| x.is_finite()) => Some("takes finite numbers"),
            _ => None,
        }
    }
}

impl VariantEntry {
    fn into_variants(self) -> Vec<Variant> {
        match self {
            VariantEntry::Name(text) => vec![Variant::parse(&text)],
            VariantEntry::Choice(choices) => choices
                .0
                .into_iter()
                .map(|(name, option)| match option {
                    Value::Flag(true) => Variant { name, option: None },
                    option => Variant { name, option: Some(option.to_string()) },
                })
                .collect(),
        }
    }
}

/// The file of a scenario: a path, or a name of a file next to the model.
#[must_use]
pub(crate) fn find_file(model: &Path, scenario: &str) -> PathBuf {
    let is_path = scenario.ends_with(".yaml") || scenario.ends_with(".yml") || scenario.contains(std::path::is_separator);
    if is_path {
        return PathBuf::from(scenario);
    }
    let stem = model.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    model.with_file_name(format!("{stem}.{scenario}.yaml"))
}

/// Paths of files of data that the text of a scenario names; none where it is invalid.
pub(crate) fn data_of(text: &str) -> Vec<String> {
    let mut sources = SourceMap::new();
    let file = sources.add("scenario".to_owned(), text.to_owned());
    let Ok(Scenario { disturbances: Some(Disturbances::Values(values)), .. }) = Scenario::parse(&sources, file) else {
        return Vec::new();
    };
    let path = |recorded| if let Recorded::File { path, .. } = recorded { Some(path) } else { None };
    values.into_values().filter_map(path).collect()
}

/// Names of the scenarios next to a model, `default` first.
#[must_use]
pub fn beside(model: &Path) -> Vec<String> {
    let stem = model.file_stem().map(|s| format!("{}.", s.to_string_lossy())).unwrap_or_default();
    let folder = match model.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            Some(name.strip_prefix(&stem)?.strip_suffix(".yaml")?.to_owned())
        })
        .collect();
    names.sort();
    names.insert(0, "default".into());
    names
}

/// Deepest nest of brackets in a scenario, which needs two or three.
const MAX_NESTING: usize = 100;

/// Place of brackets that are nested too deep: the time of the YAML reader grows with the square of
/// the depth. Brackets in texts and comments count too; a hundred of them are not expected there.
fn too_deep(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    text.bytes().position(|byte| {
        match byte {
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth > MAX_NESTING
    })
}

/// Message of the YAML reader, as a diagnostic.
fn diagnose(error: &serde_yaml::Error, text: &str, file: FileId) -> Diagnostic {
    let full = error.to_string();
    let message = full.split(" at line ").next().unwrap_or(&full).to_owned();
    if let Some(key) = message.split('`').nth(1).filter(|_| message.contains("unknown field")) {
        // The reader lists what it knows in back-ticks, behind the key.
        let known: Vec<&str> = message.split('`').skip(3).step_by(2).collect();
        let place = match message.split(['.', ':']).next() {
            Some("solver") => " in `solver`",
            Some("disturbances") => " in a disturbance",
            _ => "",
        };
        let span = find_name(text, key, file);
        return Diagnostic::error(codes::BAD_SCENARIO, format!("unknown key `{}`{place}", shortened(key)), span)
            .label("not a key of a scenario")
            .help(did_you_mean(key, known.iter().copied()).unwrap_or_else(|| format!("the keys are {}", known.join(", "))));
    }
    if let Some(key) = message.split('`').nth(1).filter(|_| message.contains(TWICE) || message.contains("duplicate field")) {
        let span = second_key(text, key, error.location().map_or(0, |l| l.index()), file);
        let message = format!("`{}` {TWICE}", shortened(key));
        return Diagnostic::error(codes::BAD_SCENARIO, message, span).help("the intended one is not known");
    }
    let at = text.floor_char_boundary(error.location().map_or(0, |l| l.index()));
    let end = text[at..].find('\n').map_or(text.len(), |n| at + n).max(at + usize::from(at < text.len()));
    let span = Span { file, start: at as u32, end: end as u32 };
    Diagnostic::error(codes::BAD_SCENARIO, words::sentence(&message), span)
}
