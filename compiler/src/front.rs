//! The front end as one call: text to flat model.

use std::collections::{HashMap, HashSet};

use smpl_dsl::diagnostic::{Diagnostic, Faults, SourceMap, codes};
use smpl_dsl::span::FileId;
use smpl_dsl::stack::on_own_stack;
use smpl_dsl::syntax::{File, Statement, StatementKind};

use crate::elaborate::{self, Options};
use crate::model::Model;
use crate::structure;

/// Finds the text of a `use "path"`: its name for messages and its content. Refusing paths outside the model's folder and the library is
/// the loader's duty.
pub type Loader<'l> = dyn FnMut(&str) -> Option<(String, String)> + Send + 'l;

/// Most files of one model.
const MAX_FILES: usize = 256;

/// Compiles a file of `sources` to a flat model, with the warnings, on a stack of its own: a caller's thread may have a small one.
///
/// # Errors
/// All independent faults of the text and of what it imports.
pub fn flatten(
    sources: &mut SourceMap,
    main: FileId,
    loader: &mut Loader,
    options: &Options,
) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    on_own_stack(|| flattened(sources, main, loader, options))
}

fn flattened(
    sources: &mut SourceMap,
    main: FileId,
    loader: &mut Loader,
    options: &Options,
) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let before = sources.len();
    let (files, imports, mut faults) = parse_all(sources, main, loader);
    let broken = words_of(sources, &faults);
    // Of so many faults not all are known, so that what follows from them could not be told from what does not.
    if faults.more() > 0 {
        return Err(faults.shown());
    }
    match elaborate::elaborate(&files, &imports, options) {
        Ok(elaborated) if faults.is_empty() => {
            let (model, mut warnings) = structure::analyse(elaborated).map_err(Faults::shown)?;
            if options.lints {
                let files: Vec<FileId> = [main].into_iter().chain((before..sources.len()).map(|i| FileId(i as u16))).collect();
                elaborate::unused_parameters(&model, sources, main, &files).into_iter().for_each(|w| warnings.push(w));
            }
            Ok((model, warnings.shown()))
        }
        Ok(_) => Err(faults.shown()),
        Err(mut more) => {
            // What a faulty statement would have declared is not missing.
            let independent = |d: &Diagnostic| {
                broken.is_empty()
                    || match d.code {
                        codes::UNKNOWN_NAME | codes::WRONG_KIND => !broken.contains(sources.text(d.primary.span)),
                        codes::MISSING_DEFAULT | codes::UNDERDETERMINED | codes::OVERDETERMINED | codes::EMPTY_SET => false,
                        _ => true,
                    }
            };
            more.retain(independent);
            faults.append(more);
            faults.sort();
            Err(faults.shown())
        }
    }
}

/// Reads the main file and what it imports into `sources`, without compiling.
pub fn read(sources: &mut SourceMap, main: FileId, loader: &mut Loader) {
    on_own_stack(|| parse_all(sources, main, loader));
}

/// The main file and what it imports, each once.
fn parse_all(sources: &mut SourceMap, main: FileId, loader: &mut Loader) -> (Vec<File>, HashMap<String, usize>, Faults) {
    let mut files = Vec::new();
    let mut imports = HashMap::new();
    let mut faults = Faults::default();
    let mut queue = vec![main];
    let mut at = 0;
    while at < queue.len() {
        let id = queue[at];
        at += 1;
        let text = sources.file(id).map(|f| f.text().to_owned()).unwrap_or_default();
        let parsed = smpl_dsl::parse(&text, id);
        faults.append(parsed.diagnostics);
        let mut paths = Vec::new();
        imported(&parsed.file.statements, &mut paths);
        files.push(parsed.file);
        for path in paths {
            if imports.contains_key(&path) || queue.len() >= MAX_FILES {
                continue;
            }
            if let Some((name, text)) = loader(&path) {
                queue.push(sources.add(name, text));
                imports.insert(path, queue.len() - 1);
            }
        }
    }
    (files, imports, faults)
}

fn imported(statements: &[Statement], out: &mut Vec<String>) {
    for statement in statements {
        match &statement.kind {
            StatementKind::Import { path, .. } => out.push(path.clone()),
            StatementKind::Variant { body, .. } | StatementKind::When { body, .. } => imported(body, out),
            _ => {}
        }
    }
}

/// Names that occur on the lines of faulty statements.
fn words_of(sources: &SourceMap, faults: &Faults) -> HashSet<String> {
    let mut out = HashSet::new();
    let mut seen = HashSet::new();
    for fault in faults.iter().filter(|f| f.is_error()) {
        let Some(file) = sources.file(fault.primary.span.file) else { continue };
        let (text, at) = (file.text(), fault.primary.span.start as usize);
        let line_start = text.get(..at).and_then(|t| t.rfind('\n')).map_or(0, |i| i + 1);
        // A line may hold thousands of faults.
        if !seen.insert((fault.primary.span.file, line_start)) {
            continue;
        }
        let line = text.get(line_start..).and_then(|t| t.lines().next()).unwrap_or_default();
        out.extend(line.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| !w.is_empty()).map(str::to_owned));
    }
    out
}
