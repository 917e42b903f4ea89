//! smpl-analysis: questions of an editor about a model's text as it is now, valid or not.
//!
//! | module | holds |
//! |---|---|
//! | [`texts`] | access to the texts: open ones over files, no other input or output |
//! | [`position`] | byte offsets and positions of editors in UTF-8, UTF-16 and UTF-32 |
//! | [`token`] | words, numbers and signs of a text, also where no statement can be parsed |
//! | [`program`] | a file with its imports: trees, symbols, and where each symbol occurs |
//! | [`check`] | diagnostics, and units and values that the compiler derived |
//! | [`hover`], [`complete`], [`rename`], [`actions`] | one question each |
//! | [`outline`], [`hints`], [`signature`], [`equations`] | likewise |
//! | [`scenario`] | scenario files: keys that name symbols of a model |
//!
//! A [`program::Program`] is made of the syntax trees alone, within milliseconds, and answers
//! everything except values and derived units. [`check::check`] compiles the text as far as the
//! flat model; it can be cancelled when a newer text arrives.

#![warn(unreachable_pub)]

pub mod actions;
pub mod check;
pub mod complete;
mod declare;
pub mod equations;
pub mod hints;
pub mod hover;
mod line;
pub mod outline;
pub mod position;
pub mod program;
pub mod reference;
pub mod rename;
mod resolve;
pub mod scenario;
pub mod signature;
pub mod symbols;
pub mod texts;
pub mod token;
