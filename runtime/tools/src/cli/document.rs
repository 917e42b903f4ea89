//! `smpl fmt` and `smpl doc`, and the stages of `compile --emit` that need the text alone.

use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use smpl_dsl::diagnostic::SourceMap;

use super::report::Failed;
use super::{Files, ModelArguments, say};
use crate::document::{self, Figure, Source};
use crate::picture::{self, NominalError};
use smpl_runtime::files::{plain, read_text, write_whole};
use smpl_runtime::load::Loaded;
use smpl_runtime::setup::Setup;

#[derive(Debug, Args)]
pub(super) struct FormatArguments {
    #[command(flatten)]
    files: Files,
    /// Change nothing; exit with 1 if a file is not in the canonical layout
    #[arg(long)]
    check: bool,
}

#[derive(Debug, Args)]
pub(super) struct DocArguments {
    /// Model
    #[arg(value_name = "FILE.eq")]
    file: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// File of the Markdown (default: standard output)
    #[arg(short, long, value_name = "FILE.md")]
    output: Option<PathBuf>,
    /// Draw the flowsheet and an episode under the nominal policy into this folder, and show them
    /// on the page
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
    /// Quantities in the picture of the episode: names, `states`, `actions`, ...
    #[arg(long, value_name = "NAME,...", requires = "pictures")]
    show: Vec<String>,
}

/// Lays files out; all of them, whatever is wrong with some.
pub(super) fn format(arguments: &FormatArguments) -> Result<(), Failed> {
    let mut faulty = false;
    for file in &arguments.files.files {
        match format_file(file, arguments.check) {
            Ok(true) if arguments.check => {
                faulty = true;
                say(format!("{}: not in the canonical layout\n", file.display()))?;
            }
            Ok(true) => say(format!("{}: formatted\n", file.display()))?,
            Ok(false) => {}
            Err(failed) => {
                faulty = true;
                failed.print();
            }
        }
    }
    if faulty { Err(Failed::Quiet(1)) } else { Ok(()) }
}

/// Returns `true` if the file's layout is (or was) not the canonical one.
fn format_file(file: &Path, check: bool) -> Result<bool, Failed> {
    let text = read(file)?;
    let formatted = smpl_dsl::format::format(&text).map_err(|diagnostics| {
        let mut sources = SourceMap::new();
        sources.add(file.display().to_string(), text.clone());
        Failed::Diagnostics(diagnostics, Arc::new(sources))
    })?;
    let differs = formatted != text;
    if differs && !check {
        write_whole(file, |out| out.write_all(formatted.as_bytes()))?;
    }
    Ok(differs)
}

/// Describes a model in Markdown.
pub(super) fn describe(arguments: &DocArguments) -> Result<(), Failed> {
    let loaded = arguments.model.load(&arguments.file)?;
    let source = Source::read(&arguments.file);
    let model = Arc::clone(&loaded.model);
    let pictures = Pictures::new(arguments);
    let read: Vec<PathBuf> = super::outputs::names(&loaded.sources).chain([arguments.file.clone()]).collect();
    let outputs =
        [arguments.output.as_deref(), pictures.as_ref().map(|p| p.flowsheet.as_path()), pictures.as_ref().map(|p| p.run.as_path())];
    super::outputs::check(&outputs, read.into_iter())?;
    let figures = match &pictures {
        Some(pictures) => pictures.draw(arguments, loaded, source.as_ref())?,
        None => Vec::new(),
    };
    let text = document::markdown(&model, source.as_ref(), &figures);
    match &arguments.output {
        Some(path) => Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?),
        None => say(text),
    }
}

/// The pictures of a page.
struct Pictures {
    flowsheet: PathBuf,
    run: PathBuf,
    /// Their folder as the page finds it.
    from_page: PathBuf,
}

impl Pictures {
    fn new(arguments: &DocArguments) -> Option<Self> {
        let folder = arguments.pictures.as_ref()?;
        let stem = arguments.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let page = arguments.output.as_deref().and_then(Path::parent).unwrap_or_else(|| Path::new(""));
        let from_page = relative(page, folder);
        Some(Self { flowsheet: folder.join(format!("{stem}-flowsheet.svg")), run: folder.join(format!("{stem}-run.svg")), from_page })
    }

    fn draw(&self, arguments: &DocArguments, loaded: Loaded, source: Option<&Source>) -> Result<Vec<Figure>, Failed> {
        let at = |file: &Path| self.from_page.join(file.file_name().unwrap_or_default()).display().to_string().replace('\\', "/");
        let folder = self.run.parent().unwrap_or_else(|| Path::new(""));
        std::fs::create_dir_all(folder).map_err(|e| Failed::Message(format!("{}: {}", folder.display(), plain(&e))))?;
        let mut figures = Vec::new();
        let interface = loaded.model.interface();
        let name = interface.name.clone();
        if let Some(drawing) = source.and_then(|source| document::flowsheet(source, interface)) {
            write_whole(&self.flowsheet, |out| out.write_all(picture::svg_text(&drawing).as_bytes()))?;
            figures.push(Figure { text: format!("{name}: units and what flows between them"), path: at(&self.flowsheet) });
        }
        let setup = Arc::new(Setup::new(loaded.model, loaded.options, Some(loaded.sources))?);
        let run = picture::nominal(&setup, &super::plot::names(&arguments.show), u32::MAX)?;
        run.write(&self.run)?;
        figures.push(Figure { text: format!("{name}: an episode under the nominal policy"), path: at(&self.run) });
        Ok(figures)
    }
}

impl From<NominalError> for Failed {
    fn from(error: NominalError) -> Self {
        match error {
            NominalError::Show(error) => error.into(),
            NominalError::Setup(error) => error.into(),
            NominalError::Reset(error) => error.into(),
            NominalError::Step(error) => error.into(),
        }
    }
}

/// A folder as it is reached from another; both from the working folder, or both from the root.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    from[common..].iter().map(|_| Component::ParentDir).chain(to[common..].iter().copied()).collect()
}

/// The equations of a model's text, typeset.
pub(super) fn equations(file: &Path) -> Result<String, Failed> {
    let (parsed, _) = parse(file)?;
    Ok(document::latex(&parsed))
}

/// The syntax tree as text.
pub(super) fn syntax_tree(file: &Path) -> Result<String, Failed> {
    let (parsed, _) = parse(file)?;
    Ok(format!("{parsed:#?}\n"))
}

fn parse(file: &Path) -> Result<(smpl_dsl::syntax::File, SourceMap), Failed> {
    let text = read(file)?;
    let mut sources = SourceMap::new();
    let id = sources.add(file.display().to_string(), text.clone());
    let parsed = smpl_dsl::parse(&text, id);
    if parsed.diagnostics.iter().any(smpl_dsl::diagnostic::Diagnostic::is_error) {
        return Err(Failed::Diagnostics(parsed.diagnostics.shown(), Arc::new(sources)));
    }
    Ok((parsed.file, sources))
}

fn read(file: &Path) -> Result<String, Failed> {
    read_text(file).map_err(|error| Failed::Message(format!("{}: {}", file.display(), plain(&error))))
}
