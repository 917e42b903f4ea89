//! The first pass: text to syntax trees, of the main file and of what it imports.

use std::collections::{HashMap, HashSet};

use smpl_dsl::diagnostic::{Diagnostic, Faults, SourceMap, codes};
use smpl_dsl::span::FileId;
use smpl_dsl::stack::on_own_stack;
use smpl_dsl::syntax::{File, Statement, StatementKind, TablePoints, TimeTable};

/// Finds the text of a `use "path"`: its name for messages and its content. Refusing paths outside
/// the model's folder and the library is the loader's duty.
pub type Loader<'l> = dyn FnMut(&str) -> Option<(String, String)> + Send + 'l;

/// Most files of one model.
const MAX_FILES: usize = 256;

/// The syntax trees of a model's files.
pub struct Read {
    /// Trees of the files, the main one first.
    pub files: Vec<File>,
    /// Number of the file that each `use "path"` means.
    pub imports: HashMap<String, usize>,
    /// Place of each file among the sources.
    pub ids: Vec<FileId>,
    /// Files of data among the sources, by the paths of `table ... from "path"`.
    pub data: Data,
    /// Faults of the texts.
    pub faults: Faults,
}

/// Files of data by the paths that name them: where each is among the sources, and its text.
pub type Data = HashMap<String, (FileId, String)>;

/// Reads the main file, what it imports, and further files of data into `sources`, without parsing
/// more than that takes.
pub fn read_sources(sources: &mut SourceMap, main: FileId, more: &[String], loader: &mut Loader) {
    on_own_stack(|| read(sources, main, None, more, loader));
}

/// The main file and what it imports, each once. The statements of `extra` follow those of the main
/// file as if they stood there; `more` are paths of data that they do not name.
pub fn read(sources: &mut SourceMap, main: FileId, extra: Option<FileId>, more: &[String], loader: &mut Loader) -> Read {
    let mut out = Read { files: Vec::new(), imports: HashMap::new(), ids: vec![main], data: Data::new(), faults: Faults::default() };
    let mut at = 0;
    while let Some(&id) = out.ids.get(at) {
        let mut file = parsed(sources, id, &mut out.faults);
        if let Some(extra) = extra.filter(|_| at == 0) {
            file.statements.append(&mut parsed(sources, extra, &mut out.faults).statements);
        }
        at += 1;
        let mut paths = Vec::new();
        imported(&file.statements, &mut paths);
        out.files.push(file);
        for path in paths {
            if out.imports.contains_key(&path) || out.ids.len() >= MAX_FILES {
                continue;
            }
            if let Some((name, text)) = loader(&path) {
                out.ids.push(sources.add(name, text));
                out.imports.insert(path, out.ids.len() - 1);
            }
        }
    }
    // Data come last: files of the language are numbered from 0 on.
    let mut paths = more.to_vec();
    out.files.iter().for_each(|file| data_of(&file.statements, &mut paths));
    for path in paths {
        if out.data.contains_key(&path) || out.ids.len() + out.data.len() >= MAX_FILES {
            continue;
        }
        if let Some((name, text)) = loader(&path) {
            let id = sources.add(name, text.clone());
            out.data.insert(path, (id, text));
        }
    }
    out
}

/// Paths of the files of data that statements name.
fn data_of(statements: &[Statement], out: &mut Vec<String>) {
    for statement in statements {
        match &statement.kind {
            StatementKind::TimeTable(TimeTable { points: TablePoints::File { path, .. }, .. }) => out.push(path.clone()),
            StatementKind::Declare { declarations, .. } => {
                out.extend(declarations.iter().filter_map(|d| d.measured.as_ref()).map(|measured| measured.path.clone()));
            }
            StatementKind::Variant { body, .. } | StatementKind::When { body, .. } | StatementKind::Component { body, .. } => {
                data_of(body, out);
            }
            _ => {}
        }
    }
}

fn parsed(sources: &SourceMap, id: FileId, faults: &mut Faults) -> File {
    let text = sources.file(id).map(|f| f.text().to_owned()).unwrap_or_default();
    let parsed = smpl_dsl::parse(&text, id);
    faults.append(parsed.diagnostics);
    parsed.file
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

/// The faults of texts and those of the next pass that do not follow from them: what a faulty
/// statement would have declared is not missing.
pub(crate) fn independent(sources: &SourceMap, mut faults: Faults, mut later: Faults) -> Faults {
    let broken = words_of(sources, &faults);
    later.retain(|d: &Diagnostic| {
        broken.is_empty()
            || match d.code {
                codes::UNKNOWN_NAME | codes::WRONG_KIND => !broken.contains(sources.text(d.primary.span)),
                codes::MISSING_DEFAULT | codes::UNDERDETERMINED | codes::OVERDETERMINED | codes::EMPTY_SET => false,
                _ => true,
            }
    });
    faults.append(later);
    faults.sort();
    faults
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
