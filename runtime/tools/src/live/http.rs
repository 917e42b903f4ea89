//! Requests of HTTP: the page's own files, and the way to a WebSocket.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::bundle::Bundle;

/// Most bytes of the head of a request.
const MOST_BYTES: usize = 16 << 10;
/// Time in which a head must have come.
const PATIENCE: Duration = Duration::from_secs(5);
/// Fields that every answer has: nothing from elsewhere, no frames, no guesses of types.
const SAFETY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; \
     img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; worker-src 'self' blob:; base-uri 'none'; \
     form-action 'none'; frame-ancestors 'none'\r\n\
     X-Content-Type-Options: nosniff\r\n\
     X-Frame-Options: DENY\r\n\
     Referrer-Policy: no-referrer\r\n\
     Cross-Origin-Resource-Policy: same-origin\r\n\
     Cross-Origin-Opener-Policy: same-origin\r\n\
     Cache-Control: no-store\r\n\
     Connection: close\r\n";

/// The names under which a browser of this machine knows the server, and the secret in its
/// addresses.
#[derive(Clone, Debug)]
pub(crate) struct Site {
    pub(crate) port: u16,
    pub(crate) token: String,
}

/// A request that was let through.
pub(crate) enum Request {
    /// A file of the page.
    File(String),
    /// A WebSocket with this key; what came after the head.
    Socket(String, Vec<u8>),
}

/// A refusal: status and reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Refusal(pub(crate) u16, pub(crate) &'static str);

impl Site {
    /// The address of the page.
    pub(crate) fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    fn is_host(&self, host: &str) -> bool {
        let names = ["127.0.0.1", "localhost"];
        names.iter().any(|name| host.strip_prefix(name).and_then(|rest| rest.strip_prefix(':')) == Some(self.port.to_string().as_str()))
    }

    fn is_origin(&self, origin: &str) -> bool {
        origin.strip_prefix("http://").is_some_and(|host| self.is_host(host))
    }

    /// The rest of a path after the token.
    fn after_token<'p>(&self, path: &'p str) -> Option<&'p str> {
        let path = path.split(['?', '#']).next()?.strip_prefix('/')?;
        let (token, rest) = path.split_once('/').unwrap_or((path, ""));
        is_equal(token.as_bytes(), self.token.as_bytes()).then_some(rest)
    }
}

/// Compares in a time that does not depend on the place of the first difference.
fn is_equal(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (x, y)| sum | (x ^ y)) == 0
}

/// Reads the head of a request and decides on it.
///
/// # Errors
/// A [`Refusal`] for whatever is not asked for by the page.
pub(crate) fn read(stream: &mut TcpStream, site: &Site) -> Result<Request, Refusal> {
    let (head, rest) = head(stream)?;
    let mut fields = [httparse::EMPTY_HEADER; 64];
    let mut request = httparse::Request::new(&mut fields);
    match request.parse(&head) {
        Ok(httparse::Status::Complete(_)) => decide(&request, site, rest),
        _ => Err(Refusal(400, "Bad Request")),
    }
}

fn decide(request: &httparse::Request<'_, '_>, site: &Site, rest: Vec<u8>) -> Result<Request, Refusal> {
    let all = |name: &str| -> Vec<&str> {
        let fields = request.headers.iter().filter(|field| field.name.eq_ignore_ascii_case(name));
        fields.map(|field| std::str::from_utf8(field.value).unwrap_or("\u{fffd}").trim()).collect()
    };
    if !matches!(all("host").as_slice(), [host] if site.is_host(host)) {
        return Err(Refusal(403, "Forbidden"));
    }
    if !all("origin").iter().all(|origin| site.is_origin(origin)) {
        return Err(Refusal(403, "Forbidden"));
    }
    let path = site.after_token(request.path.unwrap_or_default()).ok_or(Refusal(404, "Not Found"))?;
    if request.method != Some("GET") {
        return Err(Refusal(405, "Method Not Allowed"));
    }
    if path != "ws" {
        return Ok(Request::File(path.to_owned()));
    }
    let is_upgrade = all("upgrade").iter().any(|value| value.eq_ignore_ascii_case("websocket"));
    match (is_upgrade, all("sec-websocket-version").as_slice(), all("sec-websocket-key").as_slice()) {
        (true, ["13"], [key]) => Ok(Request::Socket((*key).to_owned(), rest)),
        _ => Err(Refusal(426, "Upgrade Required")),
    }
}

/// The bytes up to the empty line, and those after it.
fn head(stream: &mut TcpStream) -> Result<(Vec<u8>, Vec<u8>), Refusal> {
    let deadline = Instant::now() + PATIENCE;
    let mut bytes = Vec::new();
    let mut part = [0; 2048];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Err(Refusal(408, "Request Timeout"));
        }
        let count = match stream.read(&mut part) {
            Ok(0) => return Err(Refusal(400, "Bad Request")),
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(_) => return Err(Refusal(408, "Request Timeout")),
        };
        bytes.extend_from_slice(&part[..count]);
        if let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
            let rest = bytes.split_off(end + 4);
            return Ok((bytes, rest));
        }
        if bytes.len() > MOST_BYTES {
            return Err(Refusal(431, "Request Header Fields Too Large"));
        }
    }
}

/// Sends a file of the page.
pub(crate) fn send_file(stream: &mut TcpStream, bundle: &Bundle, name: &str) -> io::Result<()> {
    match bundle.file(if name.is_empty() { "index.html" } else { name }) {
        Some((kind, bytes)) => send(stream, 200, "OK", kind, &bytes),
        None => refuse(stream, Refusal(404, "Not Found")),
    }
}

/// Sends a refusal.
pub(crate) fn refuse(stream: &mut TcpStream, Refusal(status, reason): Refusal) -> io::Result<()> {
    send(stream, status, reason, "text/plain; charset=utf-8", reason.as_bytes())
}

fn send(stream: &mut TcpStream, status: u16, reason: &str, kind: &str, body: &[u8]) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let head = format!("HTTP/1.1 {status} {reason}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n{SAFETY}\r\n", body.len());
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)?;
    stream.flush()
}

/// Accepts a WebSocket.
pub(crate) fn accept_socket(stream: &mut TcpStream, key: &str) -> io::Result<()> {
    let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let head =
        format!("HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n");
    stream.write_all(head.as_bytes())?;
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decided(head: &str) -> Result<bool, u16> {
        let site = Site { port: 7000, token: "secret".into() };
        let mut fields = [httparse::EMPTY_HEADER; 64];
        let mut request = httparse::Request::new(&mut fields);
        let head = format!("{head}\r\n\r\n");
        request.parse(head.as_bytes()).expect("a head");
        decide(&request, &site, Vec::new()).map(|request| matches!(request, Request::Socket(..))).map_err(|refusal| refusal.0)
    }

    #[test]
    fn only_the_page_of_this_machine_is_let_through() {
        let socket = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: x";
        assert_eq!(decided("GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7000"), Ok(false));
        assert_eq!(decided("GET /secret/live.js?x HTTP/1.1\r\nHost: localhost:7000"), Ok(false));
        let origin = "Origin: http://127.0.0.1:7000";
        assert_eq!(decided(&format!("GET /secret/ws HTTP/1.1\r\nHost: 127.0.0.1:7000\r\n{origin}\r\n{socket}")), Ok(true));
        for (head, status) in [
            ("GET /secret/ HTTP/1.1", 403),
            ("GET /secret/ HTTP/1.1\r\nHost: evil.example:7000", 403),
            ("GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7001", 403),
            ("GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7000\r\nHost: evil.example", 403),
            ("GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7000\r\nOrigin: http://evil.example", 403),
            ("GET /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7000\r\nOrigin: null", 403),
            ("GET / HTTP/1.1\r\nHost: 127.0.0.1:7000", 404),
            ("GET /secre/ HTTP/1.1\r\nHost: 127.0.0.1:7000", 404),
            ("POST /secret/ HTTP/1.1\r\nHost: 127.0.0.1:7000", 405),
            ("GET /secret/ws HTTP/1.1\r\nHost: 127.0.0.1:7000", 426),
        ] {
            assert_eq!(decided(head), Err(status), "{head}");
        }
    }
}
