//! Names that the language takes, from ids that it may not.

use std::collections::{HashMap, HashSet};

use smpl_compiler::elaborate::is_built_in;
use smpl_dsl::words::is_word;

/// Names given so far.
#[derive(Default)]
pub(super) struct Names {
    taken: HashSet<String>,
    of: HashMap<String, String>,
    /// Ids that have another name here.
    pub(super) changed: Vec<(String, String)>,
}

impl Names {
    /// A name that nothing has, close to the wish.
    pub(super) fn fresh(&mut self, wish: &str) -> String {
        let mut name: String = wish.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
            name.insert(0, 'x');
        }
        while is_word(&name) || is_built_in(&name) || self.taken.contains(&name) {
            name.push('_');
        }
        self.taken.insert(name.clone());
        name
    }

    /// Gives an id its name.
    pub(super) fn give(&mut self, id: &str) {
        let name = self.fresh(id);
        if name != id {
            self.changed.push((id.to_owned(), name.clone()));
        }
        self.of.insert(id.to_owned(), name);
    }

    /// The name of an id.
    pub(super) fn of(&self, id: &str) -> String {
        self.of.get(id).cloned().unwrap_or_else(|| id.to_owned())
    }
}
