//! Messages of the live page: JSON-RPC 2.0, numbers and curves as JSON, errors with the codes of
//! the protocol.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lsp_server::{Message, Notification, RequestId, Response, ResponseError};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// Kinds of errors, with the codes of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultKind {
    /// The server does not know the method.
    UnknownMethod = -32601,
    /// A parameter is missing or has another type.
    Parameters = -32602,
    /// The server failed, or has too much to do.
    Internal = -32603,
    /// The client cancelled the request.
    Cancelled = -32800,
    /// A newer request of the same channel replaced this one.
    Overtaken = -32801,
    /// The file on disk differs from the version that the page knows.
    Conflict = 1,
    /// The model is invalid and was never valid.
    Invalid = 2,
    /// A setting is invalid, or the run cannot begin.
    Setting = 3,
    /// The path is outside of the folder, or read only.
    Forbidden = 4,
    /// The file cannot be read or written.
    File = 5,
    /// The text is too large.
    TooLarge = 6,
}

/// An error answer.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    pub(crate) kind: FaultKind,
    pub(crate) message: String,
    pub(crate) data: Option<Value>,
}

impl Fault {
    pub(crate) fn new(kind: FaultKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), data: None }
    }

    /// An invalid setting.
    pub(crate) fn setting(message: impl std::fmt::Display) -> Self {
        Self::new(FaultKind::Setting, message.to_string())
    }
}

/// The result of a request.
pub(crate) type Answer = Result<Value, Fault>;

/// The message that answers a request.
pub(crate) fn answer(id: RequestId, answer: Answer) -> Message {
    let response_result = answer.map_err(|Fault { kind, message, data }| ResponseError { code: kind as i32, message, data });
    Message::Response(Response { id, response_result })
}

/// A notification of the server.
pub(crate) fn notification(method: &str, params: Value) -> Message {
    Message::Notification(Notification { method: method.to_owned(), params })
}

/// The parameters of a request.
///
/// # Errors
/// [`FaultKind::Parameters`] with the reason.
pub(crate) fn parameters<T: DeserializeOwned>(params: Value) -> Result<T, Fault> {
    serde_json::from_value(params).map_err(|error| Fault::new(FaultKind::Parameters, error.to_string()))
}

/// A number; `null` where it is not finite.
pub(crate) fn number(x: f64) -> Value {
    serde_json::Number::from_f64(x).map_or(Value::Null, Value::Number)
}

/// A curve: base64 of little-endian doubles.
pub(crate) fn curve(values: &[f64]) -> Value {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    Value::String(STANDARD.encode(bytes))
}

/// A file for the page to download.
pub(crate) fn download(name: String, mime: &str, bytes: Vec<u8>) -> Value {
    match String::from_utf8(bytes) {
        Ok(text) => json!({"name": name, "mime": mime, "text": text}),
        Err(error) => json!({"name": name, "mime": mime, "base64": STANDARD.encode(error.as_bytes())}),
    }
}
