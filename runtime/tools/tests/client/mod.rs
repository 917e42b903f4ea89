//! A client of `smpl live`: a page without a browser.
#![allow(dead_code, reason = "not every file of tests needs everything")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine;
use serde_json::{Value, json};
use tungstenite::WebSocket;
use tungstenite::protocol::{Role, WebSocketConfig};

/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder that is removed at the end.
pub struct Folder(pub tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    pub fn path(&self) -> PathBuf {
        self.0.path().canonicalize().expect("a path")
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(&path, content).expect("a file");
        path
    }
}

/// The command with its own page, and without the user's files.
pub fn command(state: &Folder) -> Command {
    let dist = state.path().join("dist");
    std::fs::create_dir_all(&dist).expect("a folder");
    std::fs::write(dist.join("index.html"), "<!doctype html><script src=\"live.js\"></script>").expect("a file");
    std::fs::write(dist.join("live.js"), "1").expect("a file");
    // The example that measures latencies has no such variable.
    let mut command = Command::new(option_env!("CARGO_BIN_EXE_smpl").unwrap_or("target/release/smpl"));
    command.arg("live").env("SMPL_LIVE_DIST", dist).env("XDG_STATE_HOME", state.path().join("state")).env_remove("SMPL_LIBRARY");
    command
}

/// A running server.
pub struct Live {
    child: Child,
    pub port: u16,
    pub token: String,
    state: Folder,
}

impl Live {
    pub fn start(arguments: &[&str]) -> Self {
        Self::start_with(arguments, |_| {})
    }

    pub fn start_with(arguments: &[&str], change: impl FnOnce(&mut Command)) -> Self {
        let state = Folder::new();
        let mut command = command(&state);
        change(&mut command);
        let mut child = command.arg("--no-open").args(arguments).stdout(Stdio::piped()).spawn().expect("smpl runs");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
        let rest = line.trim().strip_prefix("http://127.0.0.1:").unwrap_or_else(|| panic!("no address: {line}"));
        let (port, path) = rest.split_once('/').expect("a path");
        let token = path.trim_end_matches('/').to_owned();
        Self { child, port: port.parse().expect("a port"), token, state }
    }

    /// The head and the body of the answer to a request.
    pub fn request(&self, head: &str) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("a connection");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        stream.write_all(format!("{head}\r\n\r\n").as_bytes()).expect("written");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}", self.port)
    }

    pub fn status(&self, head: &str) -> u16 {
        status_of(&self.request(head))
    }

    /// A page that is connected.
    pub fn page(&self) -> Page {
        self.try_page().unwrap_or_else(|status| panic!("refused: {status}"))
    }

    pub fn try_page(&self) -> Result<Page, u16> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("a connection");
        let head = format!(
            "GET /{}/ws HTTP/1.1\r\n{}\r\nOrigin: http://127.0.0.1:{}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            self.token,
            self.host(),
            self.port
        );
        stream.write_all(head.as_bytes()).expect("written");
        let mut answer = Vec::new();
        let mut byte = [0];
        while !answer.ends_with(b"\r\n\r\n") && stream.read(&mut byte).expect("an answer") == 1 {
            answer.push(byte[0]);
        }
        let answer = String::from_utf8_lossy(&answer).into_owned();
        if status_of(&answer) != 101 {
            return Err(status_of(&answer));
        }
        // The example of RFC 6455, section 1.3.
        assert!(answer.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{answer}");
        stream.set_read_timeout(Some(Duration::from_millis(200))).expect("a timeout");
        stream.set_nodelay(true).expect("an option");
        let settings = WebSocketConfig::default().max_message_size(None).max_frame_size(None);
        let socket = WebSocket::from_raw_socket(stream, Role::Client, Some(settings));
        Ok(Page { socket, next: 0, others: Vec::new() })
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn status_of(answer: &str) -> u16 {
    answer.split_whitespace().nth(1).and_then(|status| status.parse().ok()).unwrap_or_default()
}

/// A page.
pub struct Page {
    pub socket: WebSocket<TcpStream>,
    next: i32,
    /// Messages that were not waited for.
    others: Vec<Value>,
}

impl Page {
    pub fn send(&mut self, message: &Value) {
        self.socket.send(tungstenite::Message::text(message.to_string())).expect("sent");
    }

    pub fn notify(&mut self, method: &str, params: Value) {
        self.send(&json!({"jsonrpc": "2.0", "method": method, "params": params}));
    }

    /// Sends a request; its number.
    pub fn ask(&mut self, method: &str, params: Value) -> i32 {
        self.next += 1;
        self.send(&json!({"jsonrpc": "2.0", "id": self.next, "method": method, "params": params}));
        self.next
    }

    /// The next message that fits.
    pub fn wait(&mut self, what: &str, fits: impl Fn(&Value) -> bool) -> Value {
        if let Some(at) = self.others.iter().position(&fits) {
            return self.others.remove(at);
        }
        let begin = Instant::now();
        loop {
            match self.socket.read() {
                Ok(tungstenite::Message::Text(text)) => {
                    let message: Value = serde_json::from_str(&text).expect("JSON");
                    assert_eq!(message["jsonrpc"], "2.0");
                    if fits(&message) {
                        return message;
                    }
                    self.others.push(message);
                }
                Ok(_) => {}
                Err(tungstenite::Error::Io(error)) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                Err(error) => panic!("{what}: {error}"),
            }
            assert!(begin.elapsed() < PATIENCE, "no {what}; there are {:?}", self.others);
        }
    }

    /// The result of a request, or its error.
    pub fn answer(&mut self, id: i32) -> Result<Value, (i64, String)> {
        let message = self.wait("answer", |message| message["id"] == id);
        match message.get("error") {
            Some(error) => Err((error["code"].as_i64().expect("a code"), error["message"].as_str().unwrap_or_default().to_owned())),
            None => Ok(message["result"].clone()),
        }
    }

    pub fn call(&mut self, method: &str, params: Value) -> Result<Value, (i64, String)> {
        let id = self.ask(method, params);
        self.answer(id)
    }

    pub fn result(&mut self, method: &str, params: Value) -> Value {
        self.call(method, params).unwrap_or_else(|error| panic!("{method}: {error:?}"))
    }

    pub fn open(&mut self, path: &Path, text: &str) -> String {
        let uri = uri(path);
        let document = json!({"uri": uri, "languageId": "smpl", "version": 1, "text": text});
        self.notify("textDocument/didOpen", json!({"textDocument": document}));
        uri
    }

    pub fn change(&mut self, uri: &str, version: i32, text: &str) {
        let params = json!({"textDocument": {"uri": uri, "version": version}, "contentChanges": [{"text": text}]});
        self.notify("textDocument/didChange", params);
    }

    pub fn run(&mut self, uri: &str, settings: Value) -> Value {
        self.result("smpl/run", json!({"uri": uri, "settings": settings}))
    }
}

pub fn uri(path: &Path) -> String {
    format!("file://{}", path.display())
}

/// The numbers of a curve.
pub fn curve(value: &Value) -> Vec<f64> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(value.as_str().expect("a curve")).expect("base64");
    bytes.chunks(8).map(|eight| f64::from_le_bytes(eight.try_into().expect("eight bytes"))).collect()
}

/// Times and values of a column of a run.
pub fn column(run: &Value, name: &str) -> (Vec<f64>, Vec<f64>) {
    let columns = run["columns"].as_array().expect("columns");
    let column = columns.iter().find(|column| column["name"] == name).unwrap_or_else(|| panic!("no {name}"));
    let grid = column["grid"].as_str().expect("a grid");
    (curve(&run["grids"][grid]), curve(&column["values"]))
}
