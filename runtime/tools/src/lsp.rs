//! The language server: `smpl lsp` on standard input and output, and the same session for other
//! transports.
//!
//! A [`Session`] takes messages of the language server protocol one by one, in their order, and
//! sends answers through a channel. Answers that need the syntax alone are given at once; texts are
//! compiled on a thread of the session's own, which abandons a text when a newer one arrives. The
//! questions themselves are those of the crate `smpl_analysis`.

mod answers;
mod commands;
mod convert;
mod edits;
mod session;
mod settings;
mod texts;
mod worker;

use std::io::{self, BufReader, Write};
use std::sync::mpsc::channel;

use lsp_server::Message;

pub use session::{Session, SessionOptions};
pub use texts::OpenTexts;

/// Reads a message from JSON.
///
/// # Errors
/// The reason, if the text is not a message.
pub fn parse_message(json: &str) -> Result<Message, String> {
    serde_json::from_str(json).map_err(|error| error.to_string())
}

/// Writes a message as JSON, without a header.
#[must_use]
pub fn write_message(message: &Message) -> String {
    let mut bytes = Vec::new();
    // Writing into memory cannot fail.
    let _ = message.write(&mut bytes);
    let text = String::from_utf8(bytes).unwrap_or_default();
    text.split_once("\r\n\r\n").map_or_else(String::new, |(_, body)| body.to_owned())
}

/// Serves one client on standard input and output until it exits or goes away.
///
/// # Errors
/// If standard input cannot be read.
pub fn serve(options: SessionOptions) -> io::Result<()> {
    let (out, messages) = channel::<Message>();
    let writer = std::thread::spawn(move || {
        let mut to = io::stdout().lock();
        for message in messages {
            if message.write(&mut to).and_then(|()| to.flush()).is_err() {
                return;
            }
        }
    });
    let mut session = Session::new(out, options);
    let mut from = BufReader::new(io::stdin());
    loop {
        match Message::read(&mut from) {
            Ok(Some(message)) => {
                if !session.handle(message) {
                    break;
                }
            }
            Ok(None) => break,
            // A message that is not valid is left out; the next header is looked for.
            Err(error) if error.kind() == io::ErrorKind::InvalidData => eprintln!("smpl lsp: {error}"),
            Err(error) => return Err(error),
        }
    }
    drop(session);
    let _ = writer.join();
    Ok(())
}
