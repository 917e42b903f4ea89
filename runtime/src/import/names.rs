//! Names that the language takes, from ids that it may not.

use std::collections::{HashMap, HashSet};

/// Words with a meaning of their own in the language.
const TAKEN: &[&str] = &[
    // what cannot be a name
    "if",
    "then",
    "else",
    "and",
    "or",
    "not",
    "for",
    "in",
    "as",
    "true",
    "false",
    // what begins a statement
    "model",
    "use",
    "time",
    "set",
    "table",
    "def",
    "param",
    "action",
    "state",
    "var",
    "let",
    "discrete",
    "disturbance",
    "random",
    "eq",
    "domain",
    "flux",
    "connector",
    "component",
    "port",
    "connect",
    "initial",
    "steady",
    "observe",
    "level",
    "reward",
    "fail",
    "success",
    "constraint",
    "invariant",
    "episode",
    "solver",
    "policy",
    "at",
    "next",
    "reset",
    "clamp",
    "event",
    "phase",
    "variant",
    "choice",
    "when",
    // what is built in
    "pi",
    "e",
    "inf",
    "n",
    "step",
    "clock",
    "failure",
    "timeout",
    "states",
    "actions",
    "observations",
    "phase_time",
    "dt",
    "exp",
    "ln",
    "log10",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "atan2",
    "sqrt",
    "sq",
    "abs",
    "sign",
    "floor",
    "ceil",
    "round",
    "single",
    "mod",
    "clip",
    "min",
    "max",
    "sum",
    "product",
    "mean",
    "any",
    "all",
    "previous",
    "integral",
    "der",
    "kelvin",
    "celsius",
    "value",
    "low",
    "high",
    "scale",
    "nominal",
    "outside",
    "inside",
    "uniform",
    "normal",
    "lognormal",
    "div",
    "grad",
    "upwind",
    "width",
    "volume",
    "unit",
    "default",
    "noise",
    "every",
    "delay",
    "named",
    "rate",
    "until",
    "over",
    "cells",
    "from",
    "linear",
    "bounds",
];

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
        while TAKEN.contains(&name.as_str()) || self.taken.contains(&name) {
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
