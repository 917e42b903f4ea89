//! Models that were made before: compiled ones (`.smplc`) and checked ones (`.json`).

use std::path::Path;

use smpl_compiler::artefact::{self, Circumstances, Header};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::is_entry_setting;
use smpl_compiler::json;
use smpl_compiler::read::read_sources;
use smpl_dsl::diagnostic::SourceMap;
use smpl_dsl::span::FileId;

use super::layers::Layers;
use super::options::finish;
use super::{LoadError, LoadOptions, Loaded, fingerprint, import};
use crate::catalogue::{self, Family};
use crate::files::{self, plain};
use crate::scenario::{self, Scenario, Value, Variant};

/// Refuses a compiled model whose source or scenario has changed since, or cannot be read.
fn check_source(path: &Path, header: &Header) -> Result<(), LoadError> {
    let source = path.with_extension("eq");
    let refuse = |message: String| LoadError::Artefact { path: path.to_owned(), message };
    let look = |file: &Path| match files::read_text(file) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => {
            let message = format!("whether it belongs to {} is unknown, since that cannot be read: {}", file.display(), plain(&error));
            Err(refuse(message))
        }
    };
    let Some(text) = look(&source)? else { return Ok(()) };
    let scenario = match &header.circumstances.scenario {
        Some((name, text)) => look(&scenario::find_file(&source, name))?.unwrap_or_else(|| text.clone()),
        None => String::new(),
    };
    let data = scenario::data_of(&scenario);
    let mut sources = SourceMap::new();
    let main = sources.add(source.display().to_string(), text);
    let folder = source.parent().map(Path::to_owned).unwrap_or_default();
    read_sources(&mut sources, main, &data, &mut |name| import(&folder, name));
    let texts = (0..sources.len()).filter_map(|i| Some(sources.file(FileId(i as u16))?.text()));
    if header.fingerprint == fingerprint(texts, &scenario) {
        return Ok(());
    }
    let what = if header.circumstances.scenario.is_some() { " or its scenario" } else { "" };
    Err(refuse(format!("{}{what} has changed since; run `smpl compile` again", source.display())))
}

pub(super) fn load_artefact(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Loaded, LoadError> {
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

/// A checked model names its scenario, variants and settings: a call may repeat them, but not
/// change them.
pub(super) fn load_json(path: &Path, text: &str, options: &LoadOptions) -> Result<Loaded, LoadError> {
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
    let settings = made_for.settings.iter().map(|(name, value)| (name.clone(), Value::parse(value))).collect();
    let layers = [&scenario.parameters, &scenario.settings, &settings, &options.settings];
    finish(model, sources, &scenario, Layers(&layers), options)
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

/// A compiled model takes parameters alone: all else is decided.
fn unknown_setting(model: &CompiledModel, parameters: &Family, name: &str) -> String {
    let interface = model.interface();
    let decided = is_entry_setting(name) || interface.alternatives.names(name);
    if decided {
        return format!("a compiled model takes parameters: `{name}` is set where it is compiled");
    }
    crate::catalogue::UnknownName::new("parameter", name, parameters.names()).to_string()
}
