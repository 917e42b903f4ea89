//! One page: its texts, its requests, and the threads that answer them.

use std::io;
use std::net::TcpStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use lsp_server::{Message, Notification, Request};
use serde::Deserialize;
use serde_json::{Value, json};

use super::folder::{Folder, MOST_BYTES, Watch, too_large};
use super::jobs::{Job, Lane, Stop};
use super::models::{Found, Models};
use super::outbox::{Outbox, Wire};
use super::run::Benches;
use super::settings::Settings;
use super::uri::uri_of;
use super::wire::{Answer, Fault, FaultKind, answer, notification, parameters};
use super::{describe, equations, export, run, steady, structure};
use crate::lsp::{OpenTexts, Session, SessionOptions, parse_message};

/// Time between two looks at the files.
const LOOK: Duration = Duration::from_secs(1);
/// Time before a run reports its progress, and between two reports.
const QUIET: Duration = Duration::from_millis(200);
const REPORTS: Duration = Duration::from_millis(100);
/// Frames that make no sense before the connection ends.
const MOST_NONSENSE: usize = 100;
/// Address space of the stack of a thread that compiles.
const STACK: usize = 64 << 20;
const SMALL_STACK: usize = 1 << 20;

/// State that the threads of a connection share.
struct Page {
    folder: Folder,
    texts: Arc<OpenTexts>,
    models: Models,
    outbox: Outbox,
    /// Runs and steady states.
    compute: Lane,
    /// Descriptions of models, which do not wait for runs.
    describe: Lane,
    watch: Mutex<Watch>,
}

/// The file that a request is about.
#[derive(Deserialize)]
struct OfFile {
    uri: String,
    #[serde(default)]
    settings: Settings,
}

/// Serves a page until it closes the connection.
///
/// # Errors
/// Where the operating system gives no thread or no handle.
pub(crate) fn serve(stream: TcpStream, read: Vec<u8>, folder: Folder) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(LOOK))?;
    let (reader, writer) = Wire::pair(stream)?;
    let (out, messages) = channel();
    let within = Some(folder.root.clone());
    let session = Session::new(out, SessionOptions { library: folder.library.clone(), within, ..SessionOptions::default() });
    let page = Arc::new(Page {
        folder,
        texts: session.texts(),
        models: Models::default(),
        outbox: Outbox::default(),
        compute: Lane::default(),
        describe: Lane::default(),
        watch: Mutex::default(),
    });
    std::thread::scope(|scope| {
        let start = |name: &str, stack: usize| std::thread::Builder::new().name(name.into()).stack_size(stack);
        let threads = [
            start("live write", SMALL_STACK).spawn_scoped(scope, || page.outbox.write_to(writer)),
            start("live language", SMALL_STACK).spawn_scoped(scope, || messages.into_iter().for_each(|message| page.outbox.send(&message))),
            start("live run", STACK).spawn_scoped(scope, || page.compute_lane()),
            start("live describe", STACK).spawn_scoped(scope, || page.describe_lane()),
        ];
        let started = threads.into_iter().collect::<io::Result<Vec<_>>>().map(drop);
        if started.is_ok() {
            Reader { page: &page, session }.read_from(reader, read);
        } else {
            drop(session);
        }
        page.outbox.close();
        page.compute.close();
        page.describe.close();
        started
    })
}

/// Messages of the page, in their order.
struct Reader<'p> {
    page: &'p Page,
    session: Session,
}

impl Reader<'_> {
    fn read_from(&mut self, reader: Wire, read: Vec<u8>) {
        let mut socket = reader.socket(read);
        let (mut looked, mut nonsense) = (Instant::now(), 0);
        while nonsense < MOST_NONSENSE {
            match socket.read() {
                Ok(tungstenite::Message::Text(text)) => match parse_message(text.as_str()) {
                    Ok(message) => self.take(message),
                    Err(_) => nonsense += 1,
                },
                Ok(tungstenite::Message::Binary(_)) => nonsense += 1,
                Ok(tungstenite::Message::Close(_)) => break,
                Ok(_) => {}
                Err(tungstenite::Error::Io(error)) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                Err(_) => break,
            }
            if looked.elapsed() >= LOOK {
                looked = Instant::now();
                self.page.look_at_files();
            }
        }
        let _ = socket.close(None);
        let _ = socket.flush();
        let _ = socket.get_ref().stream().shutdown(std::net::Shutdown::Both);
    }

    /// Requests of the page are answered here, all else by the session of the language server, if
    /// it is about files that the page may see.
    fn take(&mut self, message: Message) {
        match message {
            Message::Request(request) if request.method.starts_with("smpl/") => self.page.request(request),
            Message::Request(mut request) => match self.page.permitted(&request.method, &mut request.params) {
                Ok(()) => drop(self.session.handle(Message::Request(request))),
                Err(fault) => self.page.outbox.send(&answer(request.id, Err(fault))),
            },
            Message::Notification(message) if message.method == "exit" => {}
            Message::Notification(mut message) => match self.page.permitted(&message.method, &mut message.params) {
                Ok(()) => {
                    self.page.notified(&message);
                    self.session.handle(Message::Notification(message));
                }
                Err(fault) => {
                    self.page.outbox.send(&notification("window/showMessage", json!({"type": 1, "message": fault.message})));
                }
            },
            Message::Response(_) => {}
        }
    }
}

impl Page {
    fn look_at_files(&self) {
        let changes = self.watch.lock().unwrap_or_else(PoisonError::into_inner).changes();
        for change in changes {
            self.outbox.send(&notification("smpl/changed", change));
        }
    }

    /// Lets a message to the language server through, with the opened folder as its workspace.
    ///
    /// # Errors
    /// A file outside of the folder, or a text that is too large.
    fn permitted(&self, method: &str, params: &mut Value) -> Result<(), Fault> {
        if method == "initialize" && params.is_object() {
            let root = uri_of(&self.folder.root);
            params["workspaceFolders"] = json!([{"uri": root, "name": "opened"}]);
            params["rootUri"] = root.into();
        }
        let size = |text: &Value| text.as_str().map_or(0, str::len);
        let changes = params["contentChanges"].as_array().map_or(0, |changes| changes.iter().map(|change| size(&change["text"])).sum());
        if size(&params["textDocument"]["text"]).max(changes) > MOST_BYTES {
            return Err(too_large());
        }
        match params["textDocument"]["uri"].as_str() {
            Some(uri) => self.folder.allowed(uri).map(drop),
            None => Ok(()),
        }
    }

    fn request(&self, request: Request) {
        let Request { id, method, params } = request;
        let lane = match method.as_str() {
            "smpl/run" | "smpl/steady" | "smpl/export" => &self.compute,
            "smpl/model" | "smpl/structure" | "smpl/equations" => &self.describe,
            _ => {
                let result = guarded(|| self.at_once(&method, params));
                return self.outbox.send(&answer(id, result));
            }
        };
        let channel = channel_of(&method, &params);
        for (id, fault) in lane.push(Job { id, method, params, channel, stop: Stop::new() }) {
            self.outbox.send(&answer(id, Err(fault)));
        }
    }

    /// Requests that take no time.
    fn at_once(&self, method: &str, params: Value) -> Answer {
        #[derive(Deserialize)]
        struct Save {
            uri: String,
            text: String,
            digest: Option<String>,
            #[serde(default)]
            force: bool,
        }
        match method {
            "smpl/ping" => Ok(json!({})),
            "smpl/files" => Ok(self.folder.files()),
            "smpl/read" => self.folder.read(&parameters::<OfFile>(params)?.uri),
            "smpl/save" => {
                let Save { uri, text, digest, force } = parameters(params)?;
                let saved = self.folder.save(&uri, &text, digest.as_deref(), force)?;
                if let (Ok(allowed), Some(digest)) = (self.folder.allowed(&uri), saved["digest"].as_str()) {
                    self.watch.lock().unwrap_or_else(PoisonError::into_inner).written(&allowed.path, digest);
                }
                Ok(saved)
            }
            _ => Err(Fault::new(FaultKind::UnknownMethod, format!("unknown method `{method}`"))),
        }
    }

    /// Takes note of what concerns this side too: cancelled requests, and files to watch.
    fn notified(&self, message: &Notification) {
        if message.method == "$/cancelRequest" {
            return self.cancel(&message.params);
        }
        let Some(allowed) = message.params["textDocument"]["uri"].as_str().and_then(|uri| self.folder.allowed(uri).ok()) else { return };
        let mut watch = self.watch.lock().unwrap_or_else(PoisonError::into_inner);
        match message.method.as_str() {
            "textDocument/didOpen" => watch.open(&allowed.path),
            "textDocument/didClose" => watch.close(&allowed.path),
            _ => {}
        }
    }

    fn cancel(&self, params: &Value) {
        #[derive(Deserialize)]
        struct Cancel {
            id: lsp_server::RequestId,
        }
        let Ok(Cancel { id }) = serde_json::from_value(params.clone()) else { return };
        for lane in [&self.compute, &self.describe] {
            if lane.cancel(&id) {
                self.outbox.send(&answer(id.clone(), Err(Fault::new(FaultKind::Cancelled, "cancelled"))));
            }
        }
    }

    fn compute_lane(&self) {
        let benches = Mutex::new(Benches::default());
        self.compute.work(|job| {
            let mut benches = benches.lock().unwrap_or_else(PoisonError::into_inner);
            smpl_runtime::interrupt::follow(job.stop.flag());
            let result = guarded(|| self.compute(&job, &mut benches)).map_err(|fault| job.stop.or(fault));
            self.outbox.send(&answer(job.id, result));
        });
    }

    fn describe_lane(&self) {
        self.describe.work(|job| {
            smpl_runtime::interrupt::follow(job.stop.flag());
            let result = guarded(|| self.describe(&job)).map_err(|fault| job.stop.or(fault));
            self.outbox.send(&answer(job.id, result));
        });
    }

    fn path(&self, uri: &str) -> Result<PathBuf, Fault> {
        Ok(self.folder.allowed(uri)?.asked)
    }

    fn compute(&self, job: &Job, benches: &mut Benches) -> Answer {
        let OfFile { uri, .. } = parameters(job.params.clone())?;
        let path = self.path(&uri)?;
        let find = |settings: &Settings| -> Result<Found, Fault> { self.models.find(&path, settings, &self.texts) };
        let mut pace = Pace::new();
        let mut report = |done: u64, total: u64| {
            if pace.is_due() {
                let params = json!({"id": job.id, "channel": job.channel, "done": done, "total": total});
                self.outbox.send(&notification("smpl/progress", params));
            }
        };
        let mut result = match job.method.as_str() {
            "smpl/run" => run::answer(&parameters(job.params.clone())?, &find, benches, &job.stop, &mut report)?,
            "smpl/steady" => {
                let request: steady::SteadyRequest = parameters(job.params.clone())?;
                steady::answer(&request, &find(&request.settings)?, &job.stop)?
            }
            _ => export::answer(&parameters(job.params.clone())?, &path, &find, benches, &job.stop, &mut report)?,
        };
        result["uri"] = uri.into();
        Ok(result)
    }

    fn describe(&self, job: &Job) -> Answer {
        let OfFile { uri, settings } = parameters(job.params.clone())?;
        let path = self.path(&uri)?;
        let mut result = match job.method.as_str() {
            "smpl/model" => describe::answer(&self.models.find(&path, &settings, &self.texts)?, &settings)?,
            "smpl/structure" => structure::answer(&self.models.find(&path, &settings, &self.texts)?, &settings)?,
            _ => equations::answer(&path, &self.texts)?,
        };
        result["uri"] = uri.into();
        Ok(result)
    }
}

/// The channel of a request: one of runs by its name, one for each other kind of request.
fn channel_of(method: &str, params: &Value) -> Option<String> {
    match method {
        "smpl/run" => Some(format!("run {}", params["channel"].as_str().unwrap_or("main"))),
        "smpl/export" => None,
        _ => Some(format!("{method} {}", params["uri"].as_str().unwrap_or_default())),
    }
}

/// The answer of a request, also where the work panics.
fn guarded(work: impl FnOnce() -> Answer) -> Answer {
    let failed = || Fault::new(FaultKind::Internal, "internal error; please report it with the model that caused it");
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(failed()))
}

/// Times at which progress is reported.
struct Pace {
    next: Instant,
}

impl Pace {
    fn new() -> Self {
        Self { next: Instant::now() + QUIET }
    }

    fn is_due(&mut self) -> bool {
        let now = Instant::now();
        let due = now >= self.next;
        if due {
            self.next = now + REPORTS;
        }
        due
    }
}
