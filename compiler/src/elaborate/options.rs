//! Options of a compilation in addition to the text.

use std::collections::BTreeMap;

use smpl_dsl::span::FileId;
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
    /// Replacements of initial values: `name -> text of an expression` from a scenario.
    pub initial: BTreeMap<String, f64>,
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
    /// Look for what is allowed but hardly meant, too.
    pub lints: bool,
    /// Ends the elaboration early, and receives notes for editors.
    pub observer: Option<Observer>,
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
