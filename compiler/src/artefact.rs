//! Compiled models as bytes, to be loaded again by the same user on the same kind of machine.
//!
//! An artefact holds machine code. It is therefore sealed with a secret of the user ([`Key`],
//! BLAKE3 in keyed mode). Files of other users, downloads and damaged files are refused before
//! anything of them is decoded. The header names the format, the compiler, the processor's features
//! and a [`fingerprint`] of source texts and options, so that a cache knows what it holds.

use std::io;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::compiled::{BackEndError, CompiledModel, Parts};
use crate::generate::{GenerateError, target};

mod key;

pub use key::Key;

/// First bytes of an artefact.
const MAGIC: &[u8; 8] = b"smplc\0\x01\n";
/// Changes with the layout of the content.
const FORMAT: u32 = 11;
const SEAL: usize = blake3::OUT_LEN;

/// Header of an artefact.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the layout.
    pub format: u32,
    /// Version of the compiler.
    pub compiler: String,
    /// Platform and features of the processor that the code needs.
    pub target: String,
    /// [`fingerprint`] of what was compiled.
    pub fingerprint: [u8; blake3::OUT_LEN],
    /// Options in addition to the text.
    pub circumstances: Circumstances,
}

/// Options of a compilation in addition to the model's text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Circumstances {
    /// Name and text of the scenario.
    pub scenario: Option<(String, String)>,
    /// Variants, `NAME` or `NAME=OPTION`.
    pub variants: Vec<String>,
    /// Parameters and settings by name, as a command line would write their values.
    pub settings: Vec<(String, String)>,
}

/// Reason why bytes are not a usable artefact.
#[derive(Debug, Error)]
pub enum ArtefactError {
    /// Not an artefact at all.
    #[error("not a compiled model (.smplc)")]
    NotAnArtefact,
    /// Sealed by somebody else, or changed since.
    #[error("the compiled model was not made by this user, or was changed since; compile it again")]
    Seal,
    /// Another version of the format or of the compiler.
    #[error("compiled by version {found}, this is {expected}; compile it again")]
    Version {
        /// Version in the artefact.
        found: String,
        /// Version of this program.
        expected: String,
    },
    /// Compiled for another processor.
    #[error("compiled for another processor ({found}); compile it again")]
    Target {
        /// Its target.
        found: String,
    },
    /// Decoding failed.
    #[error("damaged compiled model: {0}")]
    Encoding(#[from] postcard::Error),
    /// The key cannot be read or made.
    #[error("the key for compiled models at {} cannot be used: {source}", path.display())]
    Key {
        /// Its file.
        path: PathBuf,
        /// Message of the system.
        source: io::Error,
    },
    /// No place for the key is known.
    #[error("no home directory for the key of compiled models")]
    NoHome,
    /// The code cannot be mapped.
    #[error(transparent)]
    BackEnd(#[from] BackEndError),
    /// No code generator for this processor.
    #[error(transparent)]
    Generate(#[from] GenerateError),
}

/// Hash of source texts and of the options that they were compiled with.
#[must_use]
pub fn fingerprint(texts: &[&str], options: &[u8]) -> [u8; blake3::OUT_LEN] {
    let mut hasher = blake3::Hasher::new();
    for part in texts.iter().map(|t| t.as_bytes()).chain([options]) {
        // Lengths keep apart what is in which text.
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    *hasher.finalize().as_bytes()
}

/// The bytes of a compiled model, sealed with a key.
///
/// # Errors
/// If the processor is unknown or the content cannot be encoded.
pub fn write(
    model: &CompiledModel,
    fingerprint: [u8; blake3::OUT_LEN],
    circumstances: &Circumstances,
    key: &Key,
) -> Result<Vec<u8>, ArtefactError> {
    let (compiler, circumstances) = (env!("CARGO_PKG_VERSION").into(), circumstances.clone());
    let header = Header { format: FORMAT, compiler, target: target()?, fingerprint, circumstances };
    let content = postcard::to_extend(&header, vec![])?;
    let content = postcard::to_extend(model.parts(), content)?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(key.seal(&content).as_bytes());
    bytes.extend(content);
    Ok(bytes)
}

/// The header of an artefact whose seal is right.
///
/// # Errors
/// If it is not an artefact, or the seal is not this key's.
pub fn header(bytes: &[u8], key: &Key) -> Result<Header, ArtefactError> {
    Ok(open(bytes, key)?.0)
}

/// The header of an artefact sealed with this user's key.
///
/// # Errors
/// As [`header`], and if there is no key.
pub fn header_of_user(bytes: &[u8]) -> Result<Header, ArtefactError> {
    header(bytes, &Key::of_user()?)
}

/// The compiled model of an artefact.
///
/// # Errors
/// If the seal, the version or the processor is not right, or the code cannot be mapped.
pub fn read(bytes: &[u8], key: &Key) -> Result<CompiledModel, ArtefactError> {
    let (header, content) = open(bytes, key)?;
    let expected = env!("CARGO_PKG_VERSION");
    if header.format != FORMAT || header.compiler != expected {
        let found = format!("{} (format {})", header.compiler, header.format);
        return Err(ArtefactError::Version { found, expected: format!("{expected} (format {FORMAT})") });
    }
    if header.target != target()? {
        return Err(ArtefactError::Target { found: header.target });
    }
    let parts: Parts = postcard::from_bytes(content)?;
    Ok(CompiledModel::assemble(parts)?)
}

/// Checks the seal, then decodes the header; the rest is returned as it is.
fn open<'b>(bytes: &'b [u8], key: &Key) -> Result<(Header, &'b [u8]), ArtefactError> {
    let rest = bytes.strip_prefix(MAGIC).ok_or(ArtefactError::NotAnArtefact)?;
    let (seal, content) = rest.split_first_chunk::<SEAL>().ok_or(ArtefactError::NotAnArtefact)?;
    // Comparison of hashes takes the same time wherever they differ.
    if key.seal(content) != blake3::Hash::from_bytes(*seal) {
        return Err(ArtefactError::Seal);
    }
    Ok(postcard::take_from_bytes(content)?)
}

impl CompiledModel {
    /// Hash of the flat equations, of their data in memory, and of the compiler's version. It is
    /// the same for compilations of a text with the same options, on any processor.
    ///
    /// # Errors
    /// If the model cannot be encoded.
    pub fn checksum(&self) -> Result<[u8; blake3::OUT_LEN], ArtefactError> {
        Ok(fingerprint(&[env!("CARGO_PKG_VERSION")], &postcard::to_stdvec(self.model())?))
    }

    /// The model as bytes, sealed with the key of this user.
    ///
    /// # Errors
    /// If there is no key and none can be made, or the content cannot be encoded.
    pub fn to_bytes(&self, fingerprint: [u8; blake3::OUT_LEN], circumstances: &Circumstances) -> Result<Vec<u8>, ArtefactError> {
        write(self, fingerprint, circumstances, &Key::of_user()?)
    }

    /// A model from bytes that [`CompiledModel::to_bytes`] of this user made.
    ///
    /// # Errors
    /// If they are anything else, or made for another version or processor.
    pub fn from_bytes(bytes: &[u8]) -> Result<CompiledModel, ArtefactError> {
        read(bytes, &Key::of_user()?)
    }
}
