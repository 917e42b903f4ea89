//! Frames to the page, sent by a separate thread: whoever has something to send does not wait for
//! the network, until too much waits.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lsp_server::Message;
use tungstenite::protocol::{Role, WebSocket, WebSocketConfig};

use crate::lsp::write_message;

/// Most bytes of a frame of the page.
pub(crate) const MOST_BYTES: usize = 16 << 20;
/// Bytes that may wait before senders do.
const MOST_WAITING: usize = 64 << 20;
/// Messages that may wait before senders do.
const MOST_MESSAGES: usize = 512;
/// Time in which the page must take what is sent.
const PATIENCE: Duration = Duration::from_secs(20);

/// One end of a connection. Frames of two threads do not mix: each is written whole under a lock.
pub(crate) struct Wire {
    stream: TcpStream,
    lock: Arc<Mutex<()>>,
}

impl Wire {
    /// Two ends of one connection: to read, and to write.
    ///
    /// # Errors
    /// Where the operating system gives no second handle.
    pub(crate) fn pair(stream: TcpStream) -> io::Result<(Self, Self)> {
        let lock = Arc::new(Mutex::new(()));
        let other = stream.try_clone()?;
        Ok((Self { stream, lock: Arc::clone(&lock) }, Self { stream: other, lock }))
    }

    /// A WebSocket over it, of the server.
    pub(crate) fn socket(self, read: Vec<u8>) -> WebSocket<Self> {
        let mut settings = WebSocketConfig::default().read_buffer_size(16 << 10).write_buffer_size(0);
        settings = settings.max_message_size(Some(MOST_BYTES)).max_frame_size(Some(MOST_BYTES));
        WebSocket::from_partially_read(self, read, Role::Server, Some(settings))
    }

    pub(crate) fn stream(&self) -> &TcpStream {
        &self.stream
    }
}

impl Read for Wire {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.read(buffer)
    }
}

impl Write for Wire {
    /// Writes all of it: what is handed over at once are whole frames.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _whole = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        self.stream.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

#[derive(Default)]
struct State {
    frames: VecDeque<String>,
    bytes: usize,
    closed: bool,
}

/// Frames that wait to be sent.
#[derive(Default)]
pub(crate) struct Outbox {
    state: Mutex<State>,
    changed: Condvar,
}

impl Outbox {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a message; waits while too much waits already. After the end it is dropped.
    pub(crate) fn send(&self, message: &Message) {
        let frame = write_message(message);
        let mut state = self.lock();
        while !state.closed && (state.bytes > MOST_WAITING || state.frames.len() > MOST_MESSAGES) {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if state.closed {
            return;
        }
        state.bytes += frame.len();
        state.frames.push_back(frame);
        drop(state);
        self.changed.notify_all();
    }

    /// Ends it: what waits is dropped.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        state.frames.clear();
        drop(state);
        self.changed.notify_all();
    }

    fn next(&self) -> Option<String> {
        let mut state = self.lock();
        loop {
            if state.closed {
                return None;
            }
            if let Some(frame) = state.frames.pop_front() {
                state.bytes -= frame.len();
                drop(state);
                self.changed.notify_all();
                return Some(frame);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Sends frames until the end; a page that takes none is left.
    pub(crate) fn write_to(&self, wire: Wire) {
        let _ = wire.stream.set_write_timeout(Some(PATIENCE));
        let mut socket = wire.socket(Vec::new());
        while let Some(frame) = self.next() {
            if socket.send(tungstenite::Message::text(frame)).is_err() {
                break;
            }
        }
        self.close();
        let _ = socket.get_ref().stream.shutdown(Shutdown::Both);
    }
}
