//! Options of a compilation in addition to the text.

use std::collections::BTreeMap;

use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax;

use super::notes::Observer;

/// Options of a compilation in addition to the text.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Variants that are on and options of choices: name and option (`true` for a variant).
    pub variants: Vec<(String, String)>,
    /// Values of parameters, in their declared units; they replace default and distribution.
    pub parameters: BTreeMap<String, f64>,
    /// Settings by name: a parameter, a choice, a grid size, or an entry of `episode` or `solver`.
    pub settings: BTreeMap<String, Setting>,
    /// Layer of each setting, 0 where left out. Of a whole array and one of its elements, that of
    /// the higher layer applies; in the same layer the element.
    pub layers: BTreeMap<String, usize>,
    /// Replacements of initial values: `name -> text of an expression` from a scenario.
    pub initial: BTreeMap<String, f64>,
    /// Data that disturbances follow instead of their files, by their paths.
    pub measured: BTreeMap<String, Given>,
    /// Observation level; `None` is `default`.
    pub observation: Option<String>,
    /// Reward that is the default.
    pub reward: Option<String>,
    /// Statements that replace those of the model with the same key, as a variant does.
    pub overlay: Vec<syntax::Statement>,
    /// A text among the sources whose statements follow those of the main file.
    pub extra: Option<FileId>,
    /// Overrides `max_steps`.
    pub max_steps: Option<u32>,
    /// Names of the tests to compile with the model.
    pub tests: Option<Vec<String>>,
    /// Also report lints.
    pub lints: bool,
    /// Ends the elaboration early, and receives notes for editors.
    pub observer: Option<Observer>,
    /// Check the invariants of the model after each pass; a violation panics. Builds with debug
    /// assertions always do.
    pub verify: bool,
}

/// Value of a setting.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// An option of a choice.
    Text(String),
    /// The elements of an array of parameters, in their order.
    List(Vec<f64>),
}

/// Data of a disturbance that replace those of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// The data.
    pub data: GivenData,
    /// Interpolation; as declared where left out.
    pub kind: Option<syntax::TimeTableKind>,
    /// Word after `outside`; as declared where left out.
    pub outside: Option<syntax::Ident>,
}

/// Data of a disturbance.
#[derive(Clone, Debug, PartialEq)]
pub enum GivenData {
    /// The same at all times.
    Constant(f64),
    /// A file, and the place that names it.
    File(String, Span),
}

impl Options {
    /// Paths of files of data that the text does not name.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.measured.values().filter_map(|given| match &given.data {
            GivenData::File(path, _) => Some(path.as_str()),
            GivenData::Constant(_) => None,
        })
    }
}
