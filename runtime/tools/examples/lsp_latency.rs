//! Latencies of the language server while one types: `lsp_latency models/pensim.eq models/atropine.eq`.
//!
//! A session in process gets every keystroke of a few statements as a change, each followed by the requests that an editor sends. Printed are
//! the time until the session is ready, and for each request the median, the 95th percentile and the maximum. `--edits N` makes N changes
//! and prints the resident memory along the way.

use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use lsp_server::{Message, Notification, Request, RequestId};
use serde_json::{Value, json};
use smpl_tools::lsp::{Session, SessionOptions};

const TYPED: &str = "let typed = 2*sqrt(3) + exp(-1)\neq d/dt x = 1 [1/h] * (2 - x)\n";

struct Client {
    session: Session,
    messages: Receiver<Message>,
    next: i32,
    version: i32,
    uri: String,
}

impl Client {
    fn new(path: &Path) -> Client {
        let (out, messages) = channel();
        let session = Session::new(out, SessionOptions::default());
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let mut client = Client { session, messages, next: 0, version: 1, uri: format!("file://{}", path.display()) };
        client.request("initialize", json!({ "capabilities": { "general": { "positionEncodings": ["utf-16"] } } }));
        client
    }

    fn notify(&mut self, method: &str, params: Value) {
        self.session.handle(Notification { method: method.to_owned(), params }.into());
    }

    /// Sends a request; the time until its answer.
    fn request(&mut self, method: &str, params: Value) -> Duration {
        self.next += 1;
        let id = RequestId::from(self.next);
        let start = Instant::now();
        self.session.handle(Request { id: id.clone(), method: method.to_owned(), params }.into());
        while let Ok(message) = self.messages.recv() {
            if matches!(&message, Message::Response(response) if response.id == id) {
                break;
            }
        }
        start.elapsed()
    }

    fn open(&mut self, text: &str) -> Duration {
        let document = json!({ "uri": self.uri, "languageId": "smpl", "version": 1, "text": text });
        self.notify("textDocument/didOpen", json!({ "textDocument": document }));
        self.published()
    }

    /// Waits for the diagnostics of the newest version.
    fn published(&mut self) -> Duration {
        let start = Instant::now();
        while let Ok(message) = self.messages.recv() {
            if matches!(&message, Message::Notification(n) if n.method.ends_with("publishDiagnostics") && n.params["version"] == self.version)
            {
                break;
            }
        }
        start.elapsed()
    }

    fn insert(&mut self, line: usize, character: usize, text: &str) -> Duration {
        self.version += 1;
        let at = json!({ "line": line, "character": character });
        let changes = json!([{ "range": { "start": at, "end": at }, "text": text }]);
        let start = Instant::now();
        self.notify(
            "textDocument/didChange",
            json!({ "textDocument": { "uri": self.uri, "version": self.version }, "contentChanges": changes }),
        );
        start.elapsed()
    }
}

fn print(name: &str, times: &mut [Duration]) {
    times.sort();
    let at =
        |share: f64| times.get(((times.len() as f64 * share) as usize).min(times.len().saturating_sub(1))).copied().unwrap_or_default();
    println!("  {name:<32} {:>9.2?} {:>9.2?} {:>9.2?}", at(0.5), at(0.95), at(1.0));
}

fn measure(path: &Path, text: &str) {
    let start = Instant::now();
    let mut client = Client::new(path);
    println!("{}: ready in {:.2?}", path.display(), start.elapsed());
    println!("  first diagnostics after {:.2?}", client.open(text));
    let requests = ["textDocument/completion", "textDocument/hover", "textDocument/signatureHelp"];
    let whole = ["textDocument/semanticTokens/full", "textDocument/documentSymbol", "textDocument/inlayHint", "textDocument/foldingRange"];
    let names: Vec<&str> = ["textDocument/didChange"].into_iter().chain(requests).chain(whole).collect();
    let mut times: Vec<Vec<Duration>> = vec![Vec::new(); names.len()];
    let (mut line, mut character) = (text.lines().count() / 2, 0);
    let middle = text.lines().enumerate().skip(line).find(|(_, l)| l.trim().is_empty()).map_or(line, |(i, _)| i);
    line = middle;
    let uri = client.uri.clone();
    for typed in TYPED.chars() {
        times[0].push(client.insert(line, character, &typed.to_string()));
        (line, character) = if typed == '\n' { (line + 1, 0) } else { (line, character + 1) };
        for (i, name) in names.iter().enumerate().skip(1) {
            let params = json!({
                "textDocument": { "uri": uri }, "position": { "line": line, "character": character },
                "range": { "start": { "line": 0, "character": 0 }, "end": { "line": 9999, "character": 0 } },
            });
            times[i].push(client.request(name, params));
        }
    }
    println!("  {:<32} {:>9} {:>9} {:>9}", "", "median", "95 %", "largest");
    names.iter().zip(&mut times).for_each(|(name, times)| print(name, times));
    print("all", &mut times.concat());
    let mut last: Vec<Duration> = (0..20)
        .map(|_| {
            client.insert(line, character, "#");
            client.published()
        })
        .collect();
    print("diagnostics of a pause", &mut last);
}

fn memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|number| number.parse().ok()).unwrap_or(0)
}

fn edit(path: &Path, text: &str, edits: usize) {
    let mut client = Client::new(path);
    client.open(text);
    for round in 1..=edits {
        let remove = round % 2 == 0;
        client.version += 1;
        let end = json!({ "line": 1, "character": usize::from(remove) });
        let range = json!({ "start": { "line": 1, "character": 0 }, "end": end });
        let changes = json!([{ "range": range, "text": if remove { "" } else { "#" } }]);
        client.notify(
            "textDocument/didChange",
            json!({ "textDocument": { "uri": client.uri, "version": client.version }, "contentChanges": changes }),
        );
        while client.messages.try_recv().is_ok() {}
        if round % (edits / 5).max(1) == 0 {
            println!("  {round} edits: {} MB", memory() / 1024);
        }
    }
}

fn main() {
    let mut edits = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--edits" {
            edits = arguments.next().and_then(|number| number.parse().ok());
            continue;
        }
        let path = Path::new(&argument);
        match std::fs::read_to_string(path) {
            Ok(text) => match edits {
                Some(edits) => edit(path, &text, edits),
                None => measure(path, &text),
            },
            Err(error) => eprintln!("{argument}: {error}"),
        }
    }
}
