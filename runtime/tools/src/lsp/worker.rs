//! The thread that compiles texts and publishes diagnostics.
//!
//! For each main file the newest text counts: a check that a newer text has overtaken is cancelled,
//! and nothing of it is published.

use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use lsp_server::{Message, Notification, RequestId, Response};
use lsp_types::{
    CodeDescription, Diagnostic, DiagnosticRelatedInformation, DiagnosticSeverity, DiagnosticTag, Location, NumberOrString,
    PublishDiagnosticsParams, Uri,
};
use serde_json::{Value, json};
use smpl_analysis::check::{Checked, check};
use smpl_analysis::position::{Encoding, Lines};
use smpl_analysis::program::Program;
use smpl_analysis::reference::anchor;
use smpl_analysis::texts::model_of_scenario;
use smpl_compiler::elaborate::notes::Observer;
use smpl_dsl::diagnostic::{self, Severity, SourceMap, codes};
use smpl_dsl::span::{FileId, Span};
use smpl_runtime::load::{LoadError, LoadOptions, load_text, start_diagnostics_of_text};

use super::convert::{Places, uri_of};
use super::texts::OpenTexts;

/// The result of a check.
pub(super) struct CheckResult {
    pub(super) program: Arc<Program>,
    pub(super) checked: Checked,
}

/// Subject of a check.
enum Job {
    Model(Arc<Program>),
    Scenario,
}

/// Agreements with the client, known once it has initialised.
#[derive(Clone, Debug, Default)]
pub(super) struct Terms {
    pub(super) encoding: Encoding,
    /// The client asks for diagnostics itself.
    pub(super) pulls: bool,
    /// Address of the page of diagnostics.
    pub(super) book: Option<String>,
}

#[derive(Default)]
struct State {
    terms: Terms,
    jobs: BTreeMap<PathBuf, Job>,
    /// Check in progress.
    current: Option<(PathBuf, Observer)>,
    results: HashMap<PathBuf, Arc<CheckResult>>,
    /// Diagnostics of the newest check, by main file and file.
    found: HashMap<PathBuf, BTreeMap<PathBuf, Vec<Diagnostic>>>,
    /// Published last, with the version.
    published: HashMap<PathBuf, (Option<i32>, Vec<Diagnostic>)>,
    /// Requests for diagnostics, answered after the next check.
    waiting: Vec<(RequestId, PathBuf, PathBuf)>,
    /// Main file of each open file.
    roots: HashMap<PathBuf, PathBuf>,
    stopped: bool,
}

/// State that the session and its thread share.
pub(super) struct Shared {
    pub(super) texts: Arc<OpenTexts>,
    out: Sender<Message>,
    state: Mutex<State>,
    changed: Condvar,
}

/// The thread and what it shares with the session; it ends with this value.
pub(super) struct Worker {
    pub(super) shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    pub(super) fn new(texts: Arc<OpenTexts>, out: Sender<Message>) -> Self {
        let shared = Arc::new(Shared { texts, out, state: Mutex::default(), changed: Condvar::new() });
        let for_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("smpl-check".into()).spawn(move || for_thread.work()).ok();
        Self { shared, thread }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let mut state = self.shared.state();
        state.stopped = true;
        if let Some((_, observer)) = &state.current {
            observer.cancelled.store(true, Ordering::Relaxed);
        }
        drop(state);
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn agree(&self, terms: Terms) {
        self.state().terms = terms;
    }

    pub(super) fn terms(&self) -> Terms {
        self.state().terms.clone()
    }

    pub(super) fn send(&self, message: impl Into<Message>) {
        // A client that has gone away needs no answers.
        let _ = self.out.send(message.into());
    }

    pub(super) fn notify(&self, method: &str, params: Value) {
        self.send(Notification { method: method.to_owned(), params });
    }

    /// The newest result for a main file.
    pub(super) fn outcome(&self, root: &Path) -> Option<Arc<CheckResult>> {
        self.state().results.get(root).cloned()
    }

    /// Asks for a check of a main file; one in progress for it is cancelled.
    pub(super) fn ask(&self, root: &Path, program: Arc<Program>) {
        self.push(root, Job::Model(program));
    }

    /// Asks for a check of a scenario.
    pub(super) fn ask_scenario(&self, path: &Path) {
        self.push(path, Job::Scenario);
    }

    fn push(&self, root: &Path, job: Job) {
        let mut state = self.state();
        state.jobs.insert(root.to_owned(), job);
        if let Some((path, observer)) = &state.current
            && path == root
        {
            observer.cancelled.store(true, Ordering::Relaxed);
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Notes the main file of an open file.
    pub(super) fn set_root(&self, file: &Path, root: &Path) {
        self.state().roots.insert(file.to_owned(), root.to_owned());
    }

    /// Forgets a file that was closed, and its main file if no other open file needs it.
    pub(super) fn close(&self, file: &Path) {
        let mut state = self.state();
        let Some(root) = state.roots.remove(file) else { return };
        let mut cleared = vec![file.to_owned()];
        if !state.roots.values().any(|other| *other == root) {
            state.jobs.remove(&root);
            state.results.remove(&root);
            cleared.extend(state.found.remove(&root).into_iter().flat_map(BTreeMap::into_keys));
        }
        for path in cleared {
            if let Some((_, list)) = state.published.remove(&path)
                && !list.is_empty()
            {
                self.publish(&path, None, Vec::new());
            }
        }
    }

    /// Answers a request for diagnostics: at once if nothing is being checked, else after the
    /// check.
    pub(super) fn pull(&self, id: RequestId, file: &Path, root: &Path) {
        let mut state = self.state();
        let busy = state.jobs.contains_key(root) || state.current.as_ref().is_some_and(|(path, _)| path == root);
        if busy || !state.found.contains_key(root) && state.roots.values().any(|known| known == root) {
            state.waiting.push((id, file.to_owned(), root.to_owned()));
        } else {
            let items = state.found.get(root).and_then(|of| of.get(file)).cloned().unwrap_or_default();
            self.send(report(id, &items));
        }
    }

    /// Withdraws a request that waits.
    pub(super) fn cancel(&self, id: &RequestId) {
        let mut state = self.state();
        let before = state.waiting.len();
        state.waiting.retain(|(waiting, ..)| waiting != id);
        if state.waiting.len() < before {
            let code = lsp_server::ErrorCode::RequestCanceled as i32;
            self.send(Response::new_err(id.clone(), code, "cancelled".into()));
        }
    }

    fn work(&self) {
        while let Some((root, job, observer)) = self.next() {
            let outcome = catch_unwind(AssertUnwindSafe(|| self.run(&root, &job, &observer)));
            let mut state = self.state();
            state.current = None;
            match outcome {
                Ok(Some(found)) if !observer.cancelled.load(Ordering::Relaxed) => {
                    self.keep(&mut state, &root, found);
                }
                Ok(_) => {}
                Err(_) => {
                    self.log(&format!("internal error while checking {}", root.display()));
                    self.keep(&mut state, &root, (None, BTreeMap::new()));
                }
            }
        }
    }

    fn next(&self) -> Option<(PathBuf, Job, Observer)> {
        let mut state = self.state();
        loop {
            if state.stopped {
                return None;
            }
            if let Some((root, job)) = state.jobs.pop_first() {
                let observer = Observer::default();
                state.current = Some((root.clone(), observer.clone()));
                return Some((root, job, observer));
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn run(&self, root: &Path, job: &Job, observer: &Observer) -> Option<Found> {
        let terms = self.terms();
        match job {
            Job::Model(program) => {
                let checked = check(program, self.texts.as_ref(), observer, &start_diagnostics_of_text)?;
                let mut by_file: BTreeMap<PathBuf, Vec<Diagnostic>> =
                    program.files.iter().map(|file| (file.path.clone(), Vec::new())).collect();
                for d in &checked.diagnostics {
                    if let Some((path, diagnostic)) = in_program(program, d, &terms) {
                        by_file.entry(path).or_default().push(diagnostic);
                    }
                }
                Some((Some(CheckResult { program: Arc::clone(program), checked }), by_file))
            }
            Job::Scenario => Some((None, BTreeMap::from([(root.to_owned(), self.scenario(root, &terms))]))),
        }
    }

    /// Keeps what was found and publishes what is new in it.
    fn keep(&self, state: &mut State, root: &Path, (outcome, by_file): Found) {
        let program = outcome.as_ref().map(|outcome| Arc::clone(&outcome.program));
        if let Some(outcome) = outcome {
            // Values of the last valid text are kept while the present one is invalid.
            let before = state.results.get(root).filter(|_| outcome.checked.facts.is_empty());
            let facts = before.map_or(outcome.checked.facts, |before| before.checked.facts.clone());
            let checked = Checked { facts, ..outcome.checked };
            state.results.insert(root.to_owned(), Arc::new(CheckResult { checked, ..outcome }));
        }
        let old = state.found.insert(root.to_owned(), by_file.clone()).unwrap_or_default();
        if !state.terms.pulls {
            let gone = old.into_keys().filter(|path| !by_file.contains_key(path)).map(|path| (path, Vec::new()));
            for (path, list) in by_file.clone().into_iter().chain(gone.collect::<Vec<_>>()) {
                if state.roots.get(&path).is_some_and(|other| other != root) {
                    continue;
                }
                let version = self.texts.version(&path);
                // A text that has changed since gets its own check.
                let checked = program.as_ref().and_then(|program| program.files.iter().find(|file| file.path == path));
                if checked.is_some_and(|file| self.texts.text(&path).as_deref() != Some(&*file.text)) {
                    continue;
                }
                let entry = (version, list);
                let known = state.published.get(&path);
                if known != Some(&entry) && !(known.is_none() && entry.1.is_empty() && version.is_none()) {
                    self.publish(&path, version, entry.1.clone());
                    state.published.insert(path, entry);
                }
            }
        }
        let (ready, waiting) = std::mem::take(&mut state.waiting).into_iter().partition(|(_, _, of)| of == root);
        state.waiting = waiting;
        for (id, file, _) in ready {
            let items = by_file.get(&file).cloned().unwrap_or_default();
            self.send(report(id, &items));
        }
    }

    fn publish(&self, path: &Path, version: Option<i32>, diagnostics: Vec<Diagnostic>) {
        let Some(uri) = uri_of(path) else { return };
        let params = PublishDiagnosticsParams { uri, diagnostics, version };
        self.notify("textDocument/publishDiagnostics", serde_json::to_value(params).unwrap_or_default());
    }

    pub(super) fn log(&self, message: &str) {
        self.notify("window/logMessage", json!({ "type": 1, "message": message }));
    }

    /// Diagnostics of a scenario with its model.
    fn scenario(&self, path: &Path, terms: &Terms) -> Vec<Diagnostic> {
        let (Some(text), Some(model)) = (self.texts.text(path), model_of_scenario(path)) else { return Vec::new() };
        let Some(model_text) = self.texts.text(&model) else { return Vec::new() };
        // The loader reads scenarios from files.
        let Ok(file) = tempfile::Builder::new().suffix(".yaml").tempfile() else { return Vec::new() };
        if std::fs::write(file.path(), text.as_bytes()).is_err() {
            return Vec::new();
        }
        let scenario = file.path().display().to_string();
        let options = LoadOptions { scenario: Some(scenario.clone()), ..LoadOptions::default() };
        let lines = Lines::new(&text);
        let places = Places { text: &text, lines: &lines, encoding: terms.encoding };
        let whole = |message: String| {
            let d = diagnostic::Diagnostic::error(codes::BAD_SCENARIO, message, Span::default());
            converted(&d, places.range(&(0..0)), Vec::new(), terms)
        };
        match load_text(&model, model_text.as_ref().to_owned(), &options) {
            Ok(_) => Vec::new(),
            Err(LoadError::Diagnostics { sources, diagnostics }) => {
                let own = file_named(&sources, &scenario);
                let of_file = |d: &&diagnostic::Diagnostic| Some(d.primary.span.file) == own && d.primary.span != Span::default();
                diagnostics.iter().filter(of_file).map(|d| converted(d, places.range(&bytes(d.primary.span)), Vec::new(), terms)).collect()
            }
            Err(error @ (LoadError::Setting { .. } | LoadError::Parameter(_))) => vec![whole(error.to_string())],
            Err(_) => Vec::new(),
        }
    }
}

/// A result with the diagnostics of each file.
type Found = (Option<CheckResult>, BTreeMap<PathBuf, Vec<Diagnostic>>);

fn file_named(sources: &SourceMap, name: &str) -> Option<FileId> {
    (0..sources.len()).map(|i| FileId(i as u16)).find(|id| sources.name(*id) == name)
}

fn bytes(span: Span) -> std::ops::Range<usize> {
    span.start as usize..span.end as usize
}

fn report(id: RequestId, items: &[Diagnostic]) -> Response {
    Response::new_ok(id, json!({ "kind": "full", "items": items }))
}

/// A diagnostic of a program with the file that it is for.
fn in_program(program: &Program, d: &diagnostic::Diagnostic, terms: &Terms) -> Option<(PathBuf, Diagnostic)> {
    let place = |span: Span| {
        let file = program.file(span.file)?;
        let places = Places { text: &file.text, lines: &file.lines, encoding: terms.encoding };
        Some((file.path.clone(), places.range(&bytes(span))))
    };
    let (path, range) = place(d.primary.span).or_else(|| place(Span::default()))?;
    let related = d.secondary.iter().filter_map(|label| {
        let (path, range) = place(label.span)?;
        Some(DiagnosticRelatedInformation { location: Location { uri: uri_of(&path)?, range }, message: label.text.clone() })
    });
    Some((path, converted(d, range, related.collect(), terms)))
}

fn converted(d: &diagnostic::Diagnostic, range: lsp_types::Range, related: Vec<DiagnosticRelatedInformation>, terms: &Terms) -> Diagnostic {
    let notes = d.notes.iter().map(|note| format!("\nnote: {note}"));
    let help = d.help.iter().map(|help| format!("\nhelp: {help}"));
    let message = std::iter::once(d.message.clone()).chain(notes).chain(help).collect();
    let page = terms.book.as_ref().and_then(|book| format!("{book}#{}", anchor(d.code)).parse::<Uri>().ok());
    Diagnostic {
        range,
        severity: Some(match d.severity {
            Severity::Error => DiagnosticSeverity::ERROR,
            Severity::Warning => DiagnosticSeverity::WARNING,
            Severity::Info => DiagnosticSeverity::INFORMATION,
        }),
        code: Some(NumberOrString::String(d.code.id().to_owned())),
        code_description: page.map(|href| CodeDescription { href }),
        source: Some("smpl".into()),
        message,
        related_information: (!related.is_empty()).then_some(related),
        tags: (d.code == codes::UNUSED_PARAMETER).then(|| vec![DiagnosticTag::UNNECESSARY]),
        data: None,
    }
}
