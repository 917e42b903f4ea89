//! The layout pass: one scan over the text that finds comments, texts and brackets, decides which
//! newlines end a statement and splits the file into a tree of statements.
//!
//! The grammar then sees one statement at a time, in a copy of the text where everything without
//! meaning is a blank: comments, tabs, and the newlines that end nothing. The copy has the length
//! of the original, so that offsets agree. A newline that is left separates two entries of a block.
//!
//! A bracket that is never closed would swallow the rest of the file. It is given up where a line
//! begins the way only a statement does: with a statement's keyword followed by another word.

mod scanner;
mod words;

use scanner::Scanner;
pub(crate) use words::has_block;

use std::ops::Range;

use crate::diagnostic::{Diagnostic, Faults, codes};
use crate::span::{FileId, Span, span};

/// Deepest nesting of brackets, blocks and conditions.
pub(crate) const MAX_NESTING: usize = 200;
/// Largest file in bytes.
pub(crate) const MAX_BYTES: usize = 16 << 20;

/// Result of the layout pass.
#[derive(Debug, Default)]
pub(crate) struct Layout {
    /// The text with everything that carries no meaning blanked; as long as the original.
    pub(crate) text: String,
    /// The statements of the file.
    pub(crate) statements: Vec<RawStatement>,
    /// Places of comments, without the newline.
    pub(crate) comments: Vec<Range<usize>>,
    /// Faults of brackets, texts and characters.
    pub(crate) diagnostics: Faults,
}

/// A statement: its own text, and the statements of its block.
#[derive(Debug)]
pub(crate) struct RawStatement {
    /// First byte.
    pub(crate) start: usize,
    /// One past the last byte of its text (the block excluded).
    pub(crate) end: usize,
    /// Its block, for the kinds of statement that hold statements.
    pub(crate) body: Option<RawBody>,
    /// A fault of its text has been reported already.
    pub(crate) damaged: bool,
}

/// `{ ... }` with statements.
#[derive(Debug)]
pub(crate) struct RawBody {
    /// Byte of the opening brace.
    pub(crate) open: usize,
    /// One past the closing brace.
    pub(crate) close: usize,
    /// Text in between.
    pub(crate) statements: Vec<RawStatement>,
}

/// Splits a text.
pub(crate) fn layout(text: &str, file: FileId) -> Layout {
    if text.len() > MAX_BYTES {
        let message = format!("the file has {} bytes; a model may have {MAX_BYTES}", text.len());
        let fault = Diagnostic::error(codes::TOO_LARGE, message, Span { file, start: 0, end: 0 });
        return Layout { diagnostics: vec![fault].into(), ..Layout::default() };
    }
    if let Some(at) = lone_carriage_return(text.as_bytes()) {
        let message = "a line ends in a carriage return alone";
        let fault = Diagnostic::error(codes::UNEXPECTED_CHARACTER, message, span(file, at, at + 1))
            .help("save the file with line ends LF or CR LF; a carriage return alone ends no line, and a comment would go on beyond it");
        return Layout { diagnostics: vec![fault].into(), ..Layout::default() };
    }
    Scanner::new(text, file).run()
}

/// The first carriage return that something else than a newline follows.
fn lone_carriage_return(bytes: &[u8]) -> Option<usize> {
    let mut returns = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\r').map(|(at, _)| at);
    returns.find(|&at| bytes[at + 1..].iter().find(|byte| **byte != b'\r').is_some_and(|next| *next != b'\n'))
}
