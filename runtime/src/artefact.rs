//! Compiled models on disk, and the intermediate stages as text: what the back end offers of both.

use smpl_compiler::compiled::CompiledModel;

/// What this build cannot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this build has no {0}")]
pub struct Unavailable(pub &'static str);

/// A compiled model as bytes.
///
/// # Errors
/// If the back end cannot write artefacts.
pub fn to_bytes(model: &CompiledModel) -> Result<Vec<u8>, Unavailable> {
    let _ = model;
    Err(Unavailable("artefacts"))
}

/// A compiled model from bytes; integrity and origin are checked.
///
/// # Errors
/// If the bytes are no artefact of this program.
pub fn from_bytes(bytes: &[u8]) -> Result<CompiledModel, Unavailable> {
    let _ = bytes;
    Err(Unavailable("artefacts"))
}

/// Cranelift's intermediate form.
///
/// # Errors
/// If the back end does not keep it.
pub fn clif(model: &CompiledModel) -> Result<String, Unavailable> {
    let _ = model;
    Err(Unavailable("text of the intermediate form"))
}

/// Machine code.
///
/// # Errors
/// If the back end does not keep it.
pub fn assembly(model: &CompiledModel) -> Result<String, Unavailable> {
    let _ = model;
    Err(Unavailable("text of the machine code"))
}
