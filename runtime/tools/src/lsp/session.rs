//! A session: the state of one client, and what becomes of each message.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::sync::{Arc, LazyLock};

use lsp_server::{ErrorCode, Message, Notification, Request, RequestId, Response};
use lsp_types::{InitializeParams, PositionEncodingKind, TextDocumentContentChangeEvent, Uri};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use smpl_analysis::check::Facts;
use smpl_analysis::position::{Encoding, Lines};
use smpl_analysis::program::{Program, imports};
use smpl_analysis::reference::EXAMPLES;
use smpl_analysis::texts::{Texts, model_of_scenario};
use smpl_dsl::span::FileId;

use super::convert::{Places, TOKEN_MODIFIERS, TOKEN_TYPES, path_of};
use super::settings::Settings;
use super::texts::{Document, OpenTexts};
use super::worker::{CheckResult, Shared, Terms, Worker};

/// Set-up of a session.
#[derive(Clone, Debug, Default)]
pub struct SessionOptions {
    /// Folder of the library.
    pub library: Option<PathBuf>,
    /// Files outside of this folder and the library are not read.
    pub within: Option<PathBuf>,
    /// Address of the page of diagnostics, to which codes link.
    pub book: Option<String>,
    /// The command `smpl` with its first arguments, for code lenses; without it there are no
    /// lenses.
    pub command: Vec<String>,
}

impl SessionOptions {
    /// Options from the environment: `SMPL_LIBRARY`, and `SMPL_BOOK`, else a copy of the page in
    /// the user's cache.
    #[must_use]
    pub fn from_environment(command: Vec<String>) -> Self {
        let library = std::env::var_os("SMPL_LIBRARY").and_then(|path| Path::new(&path).canonicalize().ok());
        let book = std::env::var("SMPL_BOOK").ok().or_else(cached_page);
        Self { library, within: None, book, command }
    }
}

/// Writes the page of diagnostics into the user's cache, for links.
fn cached_page() -> Option<String> {
    let cache = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
    let cache = cache.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache")))?.join("smpl");
    let path = cache.join(format!("diagnostics-{}.md", env!("CARGO_PKG_VERSION")));
    if std::fs::read_to_string(&path).ok().as_deref() != Some(EXAMPLES) {
        std::fs::create_dir_all(&cache).ok()?;
        std::fs::write(&path, EXAMPLES).ok()?;
    }
    super::convert::uri_of(&path).map(|uri| uri.as_str().to_owned())
}

/// One client.
pub struct Session {
    pub(super) worker: Worker,
    pub(super) settings: Settings,
    pub(super) options: SessionOptions,
    pub(super) encoding: Encoding,
    /// The client can show documents.
    pub(super) shows_documents: bool,
    /// Programs of main files, until one of their texts changes.
    programs: HashMap<PathBuf, Arc<Program>>,
    /// Main files of library files.
    roots: HashMap<PathBuf, PathBuf>,
    stopped: bool,
}

/// Data for a request about a place: the program, the file in it, and what is known of its symbols.
pub(super) struct At {
    pub(super) program: Arc<Program>,
    pub(super) file: FileId,
    pub(super) outcome: Option<Arc<CheckResult>>,
    pub(super) encoding: Encoding,
}

impl At {
    pub(super) fn places(&self) -> Places<'_> {
        self.places_of(self.file)
    }

    pub(super) fn places_of(&self, file: FileId) -> Places<'_> {
        let file = &self.program.files[usize::from(file.0).min(self.program.files.len() - 1)];
        Places { text: &file.text, lines: &file.lines, encoding: self.encoding }
    }

    /// Facts that the compiler derived; none before the first check.
    pub(super) fn facts(&self) -> &Facts {
        static NOTHING: LazyLock<Facts> = LazyLock::new(Facts::default);
        self.outcome.as_ref().map_or(&NOTHING, |outcome| &outcome.checked.facts)
    }
}

/// The reason why a request is not answered.
pub(super) type Refused = (ErrorCode, String);

/// An answer; `None` if it comes later.
pub(super) type Answer = Result<Option<Value>, Refused>;

/// An answer from what it holds.
pub(super) fn answer(value: impl Serialize) -> Answer {
    serde_json::to_value(value).map(Some).map_err(|error| (ErrorCode::InternalError, error.to_string()))
}

impl Session {
    /// A session that sends its messages through `out`.
    #[must_use]
    pub fn new(out: Sender<Message>, options: SessionOptions) -> Self {
        let texts = Arc::new(OpenTexts::new(options.within.clone(), options.library.clone()));
        Self {
            worker: Worker::new(texts, out),
            settings: Settings::default(),
            options,
            encoding: Encoding::default(),
            shows_documents: false,
            programs: HashMap::new(),
            roots: HashMap::new(),
            stopped: false,
        }
    }

    /// The texts as the client sees them.
    #[must_use]
    pub fn texts(&self) -> Arc<OpenTexts> {
        Arc::clone(&self.worker.shared.texts)
    }

    pub(super) fn shared(&self) -> &Shared {
        &self.worker.shared
    }

    /// Handles a message; `false` once the client has asked to exit. A panic inside becomes an
    /// error answer.
    pub fn handle(&mut self, message: Message) -> bool {
        match message {
            Message::Request(request) => self.request(request),
            Message::Notification(notification) => {
                if notification.method == "exit" {
                    return false;
                }
                let method = notification.method.clone();
                if catch_unwind(AssertUnwindSafe(|| self.notification(notification))).is_err() {
                    self.shared().log(&format!("internal error in `{method}`"));
                }
            }
            Message::Response(_) => {}
        }
        true
    }

    fn request(&mut self, request: Request) {
        let (id, method) = (request.id.clone(), request.method.clone());
        let result = catch_unwind(AssertUnwindSafe(|| self.answer(request)));
        let response = match result {
            Ok(Ok(Some(value))) => Response::new_ok(id, value),
            Ok(Ok(None)) => return,
            Ok(Err((code, message))) => Response::new_err(id, code as i32, message),
            Err(_) => {
                self.shared().log(&format!("internal error in `{method}`"));
                Response::new_err(id, ErrorCode::InternalError as i32, format!("internal error in `{method}`"))
            }
        };
        self.shared().send(response);
    }

    fn answer(&mut self, request: Request) -> Answer {
        let Request { id, method, params } = request;
        if self.stopped && method != "shutdown" {
            return Err((ErrorCode::InvalidRequest, "the server was shut down".into()));
        }
        match method.as_str() {
            "initialize" => self.initialize(read(params)?),
            "shutdown" => {
                self.stopped = true;
                answer(Value::Null)
            }
            "textDocument/diagnostic" => self.pull(id, read(params)?),
            "textDocument/codeAction" => self.code_actions(id, read(params)?),
            "textDocument/hover" => self.hover(read(params)?),
            "textDocument/completion" => self.completion(read(params)?),
            "textDocument/signatureHelp" => self.signature(read(params)?),
            "textDocument/definition" => self.definition(read(params)?),
            "textDocument/references" => self.references(read(params)?),
            "textDocument/documentHighlight" => self.highlights(read(params)?),
            "textDocument/prepareRename" => self.prepare_rename(read(params)?),
            "textDocument/rename" => self.rename(read(params)?),
            "textDocument/documentSymbol" => self.outline(read(params)?),
            "workspace/symbol" => self.workspace_symbols(read(params)?),
            "textDocument/foldingRange" => self.folds(read(params)?),
            "textDocument/selectionRange" => self.selections(read(params)?),
            "textDocument/documentLink" => self.links(read(params)?),
            "textDocument/semanticTokens/full" => self.tokens(read(params)?),
            "textDocument/semanticTokens/range" => self.tokens_in_range(read(params)?),
            "textDocument/inlayHint" => self.hints(read(params)?),
            "textDocument/formatting" => self.format(read(params)?),
            "textDocument/rangeFormatting" => self.format_range(read(params)?),
            "textDocument/codeLens" => self.lenses(read(params)?),
            "workspace/executeCommand" => self.execute(read(params)?),
            "smpl/equations" => self.equations(read(params)?),
            _ => Err((ErrorCode::MethodNotFound, format!("unknown method `{method}`"))),
        }
    }

    fn initialize(&mut self, params: InitializeParams) -> Answer {
        let general = params.capabilities.general.as_ref();
        let offered = general.and_then(|general| general.position_encodings.clone()).unwrap_or_default();
        let known = [
            (PositionEncodingKind::UTF8, Encoding::Utf8),
            (PositionEncodingKind::UTF32, Encoding::Utf32),
            (PositionEncodingKind::UTF16, Encoding::Utf16),
        ];
        let (kind, encoding) =
            known.into_iter().find(|(kind, _)| offered.contains(kind)).unwrap_or((PositionEncodingKind::UTF16, Encoding::Utf16));
        self.encoding = encoding;
        if let Some(options) = &params.initialization_options {
            self.settings.read(options);
        }
        self.shows_documents = params.capabilities.window.as_ref().is_some_and(|window| window.show_document.is_some());
        let pulls = params.capabilities.text_document.as_ref().is_some_and(|documents| documents.diagnostic.is_some());
        self.shared().agree(Terms { encoding, pulls, book: self.options.book.clone() });
        let folders: Vec<PathBuf> = params.workspace_folders.iter().flatten().map(|folder| path_of(&folder.uri)).collect();
        self.shared().texts.set_folders(folders);
        answer(
            json!({ "capabilities": self.capabilities(&kind, pulls), "serverInfo": { "name": "smpl", "version": env!("CARGO_PKG_VERSION") } }),
        )
    }

    fn capabilities(&self, encoding: &PositionEncodingKind, pulls: bool) -> Value {
        let commands: &[&str] = if self.options.command.is_empty() { &[] } else { &["smpl.simulate", "smpl.steady", "smpl.live"] };
        let mut capabilities = json!({
            "positionEncoding": encoding,
            "textDocumentSync": { "openClose": true, "change": 2, "save": true },
            "hoverProvider": true,
            "completionProvider": { "triggerCharacters": [".", "[", ":", "\"", "(", "~"] },
            "signatureHelpProvider": { "triggerCharacters": ["(", ","] },
            "definitionProvider": true,
            "referencesProvider": true,
            "documentHighlightProvider": true,
            "documentSymbolProvider": true,
            "workspaceSymbolProvider": true,
            "codeActionProvider": { "codeActionKinds": ["quickfix"] },
            "codeLensProvider": {},
            "documentFormattingProvider": true,
            "documentRangeFormattingProvider": true,
            "renameProvider": { "prepareProvider": true },
            "foldingRangeProvider": true,
            "selectionRangeProvider": true,
            "documentLinkProvider": {},
            "inlayHintProvider": true,
            "semanticTokensProvider": {
                "legend": { "tokenTypes": TOKEN_TYPES, "tokenModifiers": TOKEN_MODIFIERS },
                "full": true,
                "range": true,
            },
            "executeCommandProvider": { "commands": commands },
            "workspace": { "workspaceFolders": { "supported": true } },
        });
        if pulls {
            capabilities["diagnosticProvider"] =
                json!({ "identifier": "smpl", "interFileDependencies": true, "workspaceDiagnostics": false });
        }
        capabilities
    }

    fn notification(&mut self, notification: Notification) {
        let Notification { method, params } = notification;
        let done = match method.as_str() {
            "textDocument/didOpen" => read(params).map(|params| self.open(params)),
            "textDocument/didChange" => read(params).map(|params| self.change(params)),
            "textDocument/didClose" => read(params).map(|params| self.close(params)),
            "workspace/didChangeConfiguration" => {
                self.settings.read(params.get("settings").unwrap_or(&Value::Null));
                Ok(())
            }
            "workspace/didChangeWatchedFiles" | "textDocument/didSave" => {
                self.shared().texts.changed_on_disk();
                self.start_anew();
                Ok(())
            }
            "$/cancelRequest" => {
                let id = match params.get("id") {
                    Some(Value::Number(number)) => number.as_i64().and_then(|n| i32::try_from(n).ok()).map(RequestId::from),
                    Some(Value::String(text)) => Some(RequestId::from(text.clone())),
                    _ => None,
                };
                id.iter().for_each(|id| self.shared().cancel(id));
                Ok(())
            }
            _ => Ok(()),
        };
        if let Err((_, message)) = done {
            self.shared().log(&format!("`{method}`: {message}"));
        }
    }

    fn open(&mut self, params: lsp_types::DidOpenTextDocumentParams) {
        let document = params.text_document;
        let path = path_of(&document.uri);
        self.shared().texts.set(path, Document { version: document.version, text: document.text.into() });
        self.start_anew();
    }

    fn change(&mut self, params: lsp_types::DidChangeTextDocumentParams) {
        let path = path_of(&params.text_document.uri);
        let texts = self.texts();
        if texts.version(&path).is_none() {
            return self.shared().log("a text was changed that is not open");
        }
        let mut text = texts.text(&path).unwrap_or_default().as_ref().to_owned();
        params.content_changes.into_iter().for_each(|change| apply(&mut text, change, self.encoding));
        texts.set(path.clone(), Document { version: params.text_document.version, text: text.into() });
        self.changed(&path);
    }

    fn close(&mut self, params: lsp_types::DidCloseTextDocumentParams) {
        let path = path_of(&params.text_document.uri);
        self.shared().texts.close(&path);
        self.shared().close(&path);
        self.start_anew();
    }

    /// Forgets all programs and checks all open files.
    fn start_anew(&mut self) {
        self.programs.clear();
        self.roots.clear();
        let mut roots: Vec<PathBuf> = Vec::new();
        for file in self.texts().open() {
            let root = self.root_of(&file);
            self.shared().set_root(&file, &root);
            roots.push(root);
        }
        roots.sort();
        roots.dedup();
        roots.iter().for_each(|root| self.check(root));
    }

    /// Checks the main files that read a changed file.
    fn changed(&mut self, path: &Path) {
        let mut readers: Vec<PathBuf> =
            self.programs.iter().filter(|(_, program)| program.file_of(path).is_some()).map(|(root, _)| root.clone()).collect();
        readers.iter().for_each(|root| {
            self.programs.remove(root);
        });
        let root = self.root_of(path);
        self.shared().set_root(path, &root);
        if !readers.contains(&root) {
            readers.push(root);
        }
        let open: Vec<PathBuf> = self.texts().open();
        let needed: Vec<PathBuf> = open.iter().map(|file| self.root_of(file)).collect();
        readers.iter().filter(|root| needed.contains(root)).for_each(|root| self.check(root));
        // Scenarios are checked with their model.
        for scenario in open.iter().filter(|file| model_of_scenario(file).is_some_and(|model| readers.contains(&model))) {
            self.shared().ask_scenario(scenario);
        }
    }

    fn check(&mut self, root: &Path) {
        if is_scenario(root) {
            return self.shared().ask_scenario(root);
        }
        if let Some(program) = self.program(root) {
            self.shared().ask(root, program);
        }
    }

    /// The program of a main file.
    pub(super) fn program(&mut self, root: &Path) -> Option<Arc<Program>> {
        if let Some(program) = self.programs.get(root) {
            return Some(Arc::clone(program));
        }
        let program = Arc::new(Program::new(root, self.texts().as_ref())?);
        self.programs.insert(root.to_owned(), Arc::clone(&program));
        Some(program)
    }

    /// The main file in which a file is read: itself, or for a part of models a model that imports
    /// it, an open one first.
    pub(super) fn root_of(&mut self, path: &Path) -> PathBuf {
        if let Some(root) = self.roots.get(path) {
            return root.clone();
        }
        let root = self.importer_of(path).unwrap_or_else(|| path.to_owned());
        self.roots.insert(path.to_owned(), root.clone());
        root
    }

    fn importer_of(&mut self, path: &Path) -> Option<PathBuf> {
        if is_scenario(path) || self.program(path)?.is_model() {
            return None;
        }
        let texts = self.texts();
        let open = texts.open().into_iter().filter(|file| !is_scenario(file));
        let candidates = open.chain(texts.models(path)).filter(|model| model != path);
        let mut found = None;
        for model in candidates.filter(|model| imports(model, texts.as_ref())) {
            let Some(program) = Program::new(&model, texts.as_ref()).filter(|program| program.file_of(path).is_some()) else { continue };
            if program.is_model() {
                return Some(model);
            }
            found.get_or_insert(model);
        }
        found
    }

    /// Data for a request about a file.
    pub(super) fn at(&mut self, uri: &Uri) -> Result<At, Refused> {
        let path = path_of(uri);
        let root = self.root_of(&path);
        let unknown = || (ErrorCode::InvalidParams, format!("{} is not open and cannot be read", path.display()));
        let program = self.program(&root).ok_or_else(unknown)?;
        let file = program.file_of(&path).ok_or_else(unknown)?;
        let outcome = self.shared().outcome(&root);
        Ok(At { program, file, outcome, encoding: self.encoding })
    }
}

/// Returns whether a file is a scenario.
pub(super) fn is_scenario(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "yaml" || e == "yml")
}

fn read<T: DeserializeOwned>(params: Value) -> Result<T, Refused> {
    serde_json::from_value(params).map_err(|error| (ErrorCode::InvalidParams, error.to_string()))
}

fn apply(text: &mut String, change: TextDocumentContentChangeEvent, encoding: Encoding) {
    match change.range {
        None => *text = change.text,
        Some(range) => {
            let lines = Lines::new(text);
            let bytes = Places { text, lines: &lines, encoding }.bytes(range);
            text.replace_range(bytes, &change.text);
        }
    }
}
