//! One page: its texts, its requests, and the threads that answer them.

use std::io;
use std::net::TcpStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
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
use super::texts::{Change, Texts};
use super::wire::{Answer, Fault, Kind, answer, message_of, notification, parameters};
use super::{describe, equations, export, run, steady, structure};

/// Time between two looks at the files.
const LOOK: Duration = Duration::from_secs(1);
/// Time before a run reports its progress, and between two reports.
const QUIET: Duration = Duration::from_millis(200);
const REPORTS: Duration = Duration::from_millis(100);
/// Frames that make no sense before the connection ends.
const MOST_NONSENSE: usize = 100;
/// Address space of the stack of a thread that compiles.
const STACK: usize = 64 << 20;

/// What the threads of a connection share.
struct Page {
    folder: Folder,
    texts: Texts,
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
    let page = Arc::new(Page {
        folder,
        texts: Texts::default(),
        models: Models::default(),
        outbox: Outbox::default(),
        compute: Lane::default(),
        describe: Lane::default(),
        watch: Mutex::default(),
    });
    std::thread::scope(|scope| {
        let threads = [
            std::thread::Builder::new().name("live write".into()).spawn_scoped(scope, || page.outbox.write_to(writer)),
            std::thread::Builder::new().name("live run".into()).stack_size(STACK).spawn_scoped(scope, || page.compute_lane()),
            std::thread::Builder::new().name("live describe".into()).stack_size(STACK).spawn_scoped(scope, || page.describe_lane()),
        ];
        let started = threads.into_iter().collect::<io::Result<Vec<_>>>().map(drop);
        if started.is_ok() {
            page.read_from(reader, read);
        }
        page.outbox.close();
        page.compute.close();
        page.describe.close();
        started
    })
}

impl Page {
    fn read_from(&self, reader: Wire, read: Vec<u8>) {
        let mut socket = reader.socket(read);
        let (mut looked, mut nonsense) = (Instant::now(), 0);
        while nonsense < MOST_NONSENSE {
            match socket.read() {
                Ok(tungstenite::Message::Text(text)) => nonsense += usize::from(!self.take(text.as_str())),
                Ok(tungstenite::Message::Binary(_)) => nonsense += 1,
                Ok(tungstenite::Message::Close(_)) => break,
                Ok(_) => {}
                Err(tungstenite::Error::Io(error)) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                Err(_) => break,
            }
            if looked.elapsed() >= LOOK {
                looked = Instant::now();
                self.look_at_files();
            }
        }
        let _ = socket.close(None);
        let _ = socket.flush();
        let _ = socket.get_ref().stream().shutdown(std::net::Shutdown::Both);
    }

    fn look_at_files(&self) {
        let changes = self.watch.lock().unwrap_or_else(PoisonError::into_inner).changes();
        for change in changes {
            self.outbox.send(&notification("smpl/changed", change));
        }
    }

    /// Takes a frame; `false` if it is not a message.
    fn take(&self, text: &str) -> bool {
        match message_of(text) {
            Some(Message::Request(request)) => self.request(request),
            Some(Message::Notification(notification)) => self.notified(notification),
            Some(Message::Response(_)) => {}
            None => return false,
        }
        true
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
        let channel = channel(&method, &params);
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
            _ => Err(Fault::new(Kind::UnknownMethod, format!("unknown method `{method}`"))),
        }
    }

    fn notified(&self, message: Notification) {
        if message.method == "$/cancelRequest" {
            return self.cancel(&message.params);
        }
        if let Err(fault) = self.document(message) {
            self.outbox.send(&notification("window/showMessage", json!({"type": 1, "message": fault.message})));
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
                self.outbox.send(&answer(id.clone(), Err(Fault::new(Kind::Cancelled, "cancelled"))));
            }
        }
    }

    /// Texts that are opened, changed and closed.
    fn document(&self, message: Notification) -> Result<(), Fault> {
        #[derive(Deserialize)]
        struct Document {
            uri: String,
            #[serde(default)]
            version: i32,
            text: Option<String>,
        }
        #[derive(Deserialize)]
        #[serde(rename_all = "camelCase")]
        struct Changed {
            text_document: Document,
            #[serde(default)]
            content_changes: Vec<Change>,
        }
        if !message.method.starts_with("textDocument/did") {
            return Ok(());
        }
        let Changed { text_document: Document { uri, version, text }, content_changes } = parameters(message.params)?;
        let path = self.folder.allowed(&uri)?.path;
        match message.method.as_str() {
            "textDocument/didOpen" => {
                let text = text.unwrap_or_default();
                if text.len() > MOST_BYTES {
                    return Err(too_large());
                }
                self.watch.lock().unwrap_or_else(PoisonError::into_inner).open(&path);
                self.texts.open(&path, version, &text);
            }
            "textDocument/didChange" => self.texts.change(&path, version, content_changes),
            "textDocument/didClose" => {
                self.watch.lock().unwrap_or_else(PoisonError::into_inner).close(&path);
                self.texts.close(&path);
            }
            _ => {}
        }
        Ok(())
    }

    fn compute_lane(&self) {
        let benches = Mutex::new(Benches::default());
        self.compute.work(|job| {
            let mut benches = benches.lock().unwrap_or_else(PoisonError::into_inner);
            smpl_runtime::interrupt::follow(job.stop.flag());
            let result = guarded(|| self.compute(&job, &mut benches));
            self.outbox.send(&answer(job.id, result));
        });
    }

    fn describe_lane(&self) {
        self.describe.work(|job| {
            smpl_runtime::interrupt::follow(job.stop.flag());
            let result = guarded(|| self.describe(&job));
            self.outbox.send(&answer(job.id, result));
        });
    }

    fn path(&self, uri: &str) -> Result<PathBuf, Fault> {
        Ok(self.folder.allowed(uri)?.path)
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
fn channel(method: &str, params: &Value) -> Option<String> {
    match method {
        "smpl/run" => Some(format!("run {}", params["channel"].as_str().unwrap_or("main"))),
        "smpl/export" => None,
        _ => Some(format!("{method} {}", params["uri"].as_str().unwrap_or_default())),
    }
}

/// The answer of a request, also where the work panics.
fn guarded(work: impl FnOnce() -> Answer) -> Answer {
    let failed = || Fault::new(Kind::Internal, "internal error; please report it with the model that caused it");
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
