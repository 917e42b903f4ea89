//! `smpl live`: the page that shows a model while it is written.
//!
//! A thread listens on 127.0.0.1. [`http`] lets through what the page itself asks for, by a secret
//! in the address, and sends the page's own files ([`bundle`]). Each page has a [`connection`]: a
//! WebSocket with messages of the language server and requests of the page. Requests that take time
//! wait in [`jobs`], in which newer ones replace older ones. [`models`] keeps what was compiled, so
//! that a slider only runs a model again ([`run`]); [`folder`] is all that a page may read and
//! write.

mod bundle;
mod connection;
mod describe;
mod episode;
mod equations;
mod export;
mod folder;
mod http;
mod jobs;
mod models;
mod outbox;
mod page;
mod panels;
mod pid;
mod recent;
mod run;
mod script;
mod settings;
mod steady;
mod structure;
mod uri;
mod wire;

use std::io;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use self::bundle::Bundle;
use self::folder::Folder;
use self::http::{Refusal, Request, Site};

/// Most pages at a time.
const MOST_PAGES: usize = 16;
/// Most requests that are read at a time.
const MOST_REQUESTS: usize = 64;

/// A server that listens.
pub(crate) struct Server {
    listener: TcpListener,
    site: Site,
    folder: Folder,
    bundle: Bundle,
    pages: AtomicUsize,
    requests: AtomicUsize,
}

/// One of a limited number.
struct Place<'c>(&'c AtomicUsize);

impl<'c> Place<'c> {
    fn take(count: &'c AtomicUsize, most: usize) -> Option<Self> {
        let place = Place(count);
        (count.fetch_add(1, Ordering::Relaxed) < most).then_some(place)
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Server {
    /// Listens on a port of 127.0.0.1, a free one for 0. `path` is a model, a folder, or nothing:
    /// the working folder.
    ///
    /// # Errors
    /// One sentence on a path without models, a port in use, or a program without the page.
    pub(crate) fn new(path: Option<&Path>, port: u16) -> Result<Arc<Self>, String> {
        let folder = folder_of(path)?;
        let bundle = Bundle::of_program().ok_or(
            "this program was built without the live page; build `runtime/tools/live` (.ci/setup does) and then the program again",
        )?;
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|error| match error.kind() {
            io::ErrorKind::AddrInUse => format!("port {port} is in use; give another one, or `--port 0` for a free one"),
            _ => format!("cannot listen on port {port}: {}", smpl_runtime::files::plain(&error)),
        })?;
        let port = listener.local_addr().map_err(|error| error.to_string())?.port();
        let site = Site { port, token: token()? };
        Ok(Arc::new(Self { listener, site, folder, bundle, pages: AtomicUsize::new(0), requests: AtomicUsize::new(0) }))
    }

    /// The address of the page.
    pub(crate) fn address(&self) -> String {
        self.site.address()
    }

    /// Serves pages, each in its own threads; does not return.
    pub(crate) fn serve(self: &Arc<Self>) {
        for stream in self.listener.incoming() {
            match stream {
                Ok(stream) => {
                    let server = Arc::clone(self);
                    // Without a thread the connection is dropped.
                    let _ = std::thread::Builder::new().name("live".into()).spawn(move || server.handle(stream));
                }
                // No more handles, for example: they come back as pages close.
                Err(_) => std::thread::sleep(std::time::Duration::from_millis(50)),
            }
        }
    }

    fn handle(&self, mut stream: TcpStream) {
        let Some(place) = Place::take(&self.requests, MOST_REQUESTS) else {
            let _ = http::refuse(&mut stream, Refusal(503, "Service Unavailable"));
            return;
        };
        // The page may be gone before it has its answer.
        let _ = match http::read(&mut stream, &self.site) {
            Ok(Request::File(name)) => http::send_file(&mut stream, &self.bundle, &name),
            Ok(Request::Socket(key, rest)) => {
                drop(place);
                match Place::take(&self.pages, MOST_PAGES) {
                    Some(_page) => http::accept_socket(&mut stream, &key).and_then(|()| connection::serve(stream, rest, self.folder())),
                    None => http::refuse(&mut stream, Refusal(503, "Service Unavailable")),
                }
            }
            Err(refusal) => http::refuse(&mut stream, refusal),
        };
    }

    fn folder(&self) -> Folder {
        Folder { recent: recent::list(), ..self.folder.clone() }
    }
}

/// The folder of a model or a folder of models; the working folder where none is given.
fn folder_of(path: Option<&Path>) -> Result<Folder, String> {
    let given = path.unwrap_or(Path::new("."));
    let plain = given.canonicalize().map_err(|error| format!("{}: {}", given.display(), smpl_runtime::files::plain(&error)))?;
    let library = folder::library();
    if plain.is_dir() {
        let folder = Folder { root: plain, library, opened: None, recent: Vec::new() };
        if path.is_some() && !folder.has_models() {
            return Err(format!("{}: the folder holds no models (*.eq); `smpl new NAME` writes one", given.display()));
        }
        return Ok(folder);
    }
    if plain.extension().is_none_or(|ending| ending != "eq") {
        return Err(format!("{}: the name of a model ends in .eq", given.display()));
    }
    folder::content(&plain).map_err(|fault| fault.message)?;
    recent::note(&plain);
    let root = plain.parent().map(Path::to_owned).unwrap_or_default();
    Ok(Folder { root, library, opened: Some(plain), recent: Vec::new() })
}

/// A secret of 128 random bits.
fn token() -> Result<String, String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|error| format!("no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
