//! Takes the place of `bindgen` in the build scripts of `sundials-sys` and `suitesparse_sys`: bindings that the real one wrote before, so that
//! a build needs no libclang. See `docs/decisions/bindings.md`; `.ci/bindings` writes them.
//!
//! Only what those two build scripts call is here, under its names there.

use std::collections::HashMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// Callbacks of the real bindgen; nothing calls them, since they had their say when the bindings were written.
pub mod callbacks {
    use std::fmt;

    /// Treatment of a macro.
    #[derive(Debug)]
    pub enum MacroParsingBehavior {
        /// It is left out.
        Ignore,
        /// It is taken.
        Default,
    }

    /// Types of constants.
    #[derive(Debug)]
    pub enum IntKind {
        /// `int` of C.
        Int,
    }

    /// Decisions of a build script.
    pub trait ParseCallbacks: fmt::Debug {
        /// Treatment of the macro of this name.
        fn will_parse_macro(&self, _name: &str) -> MacroParsingBehavior {
            MacroParsingBehavior::Default
        }
        /// The type of a constant.
        fn int_macro(&self, _name: &str, _value: i64) -> Option<IntKind> {
            None
        }
    }
}

/// SUNDIALS whose bindings are here: major and minor version.
const SUNDIALS: [((u32, u32), &str); 2] =
    [((6, 4), include_str!("../bindings/sundials-6.4.rs")), ((7, 1), include_str!("../bindings/sundials-7.1.rs"))];
const KLU: &str = include_str!("../bindings/klu.rs");

/// Request of a build script.
#[derive(Debug, Default)]
pub struct Builder {
    arguments: Vec<String>,
}

impl Builder {
    /// The header; which library is wanted, the arguments tell.
    pub fn header(self, _name: impl Into<String>) -> Self {
        self
    }

    /// An argument of the C compiler.
    pub fn clang_arg(mut self, argument: impl Into<String>) -> Self {
        self.arguments.push(argument.into());
        self
    }

    /// Several of them.
    pub fn clang_args<I: IntoIterator>(mut self, arguments: I) -> Self
    where
        I::Item: AsRef<str>,
    {
        self.arguments.extend(arguments.into_iter().map(|argument| argument.as_ref().to_owned()));
        self
    }

    /// Nothing to do any more.
    pub fn parse_callbacks(self, _callbacks: Box<dyn callbacks::ParseCallbacks>) -> Self {
        self
    }

    /// Nothing to do any more.
    pub fn blocklist_function(self, _pattern: impl AsRef<str>) -> Self {
        self
    }

    /// The bindings of the installed library.
    ///
    /// # Errors
    /// No header is found.
    ///
    /// # Panics
    /// The library is one whose bindings are not here: what goes on without them would be another library than the installed one.
    pub fn generate(self) -> Result<Bindings, BindgenError> {
        if cfg!(not(all(target_os = "linux", target_pointer_width = "64"))) {
            panic!("the bindings of SUNDIALS and KLU in runtime/bindgen are those of 64-bit Linux: write them by .ci/bindings");
        }
        if !self.arguments.iter().any(|argument| argument.starts_with("-DUSE_IDAS")) {
            return Ok(Bindings(KLU));
        }
        let header = self.config().ok_or(BindgenError::NoHeader)?;
        println!("cargo:rerun-if-changed={}", header.display());
        let text = fs::read_to_string(&header).map_err(|_| BindgenError::NoHeader)?;
        let (version, fault) = (version(&text), fault(&text, &self.arguments));
        let known = SUNDIALS.iter().find(|(known, _)| Some(*known) == version);
        match (known, fault) {
            (Some((_, bindings)), None) => Ok(Bindings(bindings)),
            (_, Some(fault)) => panic!("{}: {fault}; build with the feature `vendored`", header.display()),
            (None, None) => {
                let all: Vec<String> = SUNDIALS.iter().map(|((major, minor), _)| format!("{major}.{minor}")).collect();
                panic!(
                    "{}: there are bindings for SUNDIALS {}, not for this version; write them by .ci/bindings, or build with the feature `vendored`",
                    header.display(),
                    all.join(" and ")
                )
            }
        }
    }

    /// The file in which SUNDIALS records its configuration.
    fn config(&self) -> Option<PathBuf> {
        let given = self.arguments.iter().filter_map(|argument| argument.strip_prefix("-I"));
        let variables = ["CPATH", "C_INCLUDE_PATH"].map(|name| std::env::var(name).unwrap_or_default());
        let of_variables = variables.iter().flat_map(|list| list.split(':')).filter(|folder| !folder.is_empty());
        let mut folders = given.chain(of_variables).chain(["/usr/local/include", "/usr/include"]);
        let file = |folder: &str| Path::new(folder).join("sundials/sundials_config.h");
        folders.find_map(|folder| Some(file(folder)).filter(|file| file.is_file()))
    }
}

/// `#define NAME VALUE` of a header.
fn definitions(text: &str) -> HashMap<&str, &str> {
    text.lines().filter_map(definition).collect()
}

fn definition(line: &str) -> Option<(&str, &str)> {
    let mut words = line.trim_start().strip_prefix('#')?.trim_start().strip_prefix("define")?.split_whitespace();
    Some((words.next()?, words.next().unwrap_or_default()))
}

fn version(text: &str) -> Option<(u32, u32)> {
    let definitions = definitions(text);
    let number = |name: &str| definitions.get(name)?.parse().ok();
    Some((number("SUNDIALS_VERSION_MAJOR")?, number("SUNDIALS_VERSION_MINOR")?))
}

/// Reason for which a library of the same version differs from that of the bindings.
fn fault(text: &str, arguments: &[String]) -> Option<&'static str> {
    let definitions = definitions(text);
    let version_7 = version(text).is_some_and(|(major, _)| major >= 7);
    if !definitions.contains_key("SUNDIALS_DOUBLE_PRECISION") {
        return Some("this SUNDIALS does not compute in double precision");
    }
    if !definitions.contains_key("SUNDIALS_INT64_T") {
        return Some("this SUNDIALS has no 64-bit indices");
    }
    if version_7 && definitions.get("SUNDIALS_MPI_ENABLED").is_some_and(|on| *on == "1") {
        return Some("this SUNDIALS was built for MPI");
    }
    let other = ["ARKODE", "CVODE", "CVODES", "IDA", "KINSOL", "OPENMP", "PTHREADS"];
    other
        .iter()
        .any(|solver| arguments.iter().any(|argument| argument == &format!("-DUSE_{solver}=1")))
        .then_some("only IDAS and KLU have bindings in runtime/bindgen")
}

/// Bindings as text.
#[derive(Debug)]
pub struct Bindings(&'static str);

impl Bindings {
    /// Writes them.
    ///
    /// # Errors
    /// Those of writing a file.
    pub fn write_to_file(&self, path: impl AsRef<Path>) -> std::io::Result<()> {
        fs::write(path, self.0)
    }
}

/// Reason of missing bindings.
#[derive(Debug)]
pub enum BindgenError {
    /// SUNDIALS is not installed.
    NoHeader,
}

impl fmt::Display for BindgenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("sundials/sundials_config.h is not installed: libsundials-dev has it")
    }
}

impl std::error::Error for BindgenError {}
