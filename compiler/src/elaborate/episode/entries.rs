//! The entries of `episode` and `solver`: one table for the text, for settings from outside, and
//! for what messages list.

use crate::model::{Episode, LinearSolver, Method, Solver};

/// A block of settings.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::elaborate) enum Block {
    /// `episode`
    Episode,
    /// `solver`
    Solver,
}

/// Entries of the blocks.
#[derive(Default)]
pub(in crate::elaborate) struct EntryValues {
    pub episode: Episode,
    pub solver: Solver,
    /// The interval of integration; else it is the step.
    pub integrate: Option<f64>,
}

/// An entry.
pub(in crate::elaborate) struct Entry {
    pub block: Block,
    /// Its name in the block.
    pub name: &'static str,
    /// Its name as a setting, if it is one.
    pub setting: Option<&'static str>,
    /// Accepted values.
    pub takes: Takes,
}

/// Accepted values of an entry, and their destination.
pub(in crate::elaborate) enum Takes {
    /// A positive time.
    Duration(fn(&mut EntryValues) -> &mut f64),
    /// The interval of integration, or another positive time; the function stores it.
    Interval(fn(&mut EntryValues) -> &mut Option<f64>),
    /// A positive number.
    Positive(fn(&mut EntryValues) -> &mut f64),
    /// A relative tolerance; the function stores it.
    Tolerance(fn(&mut EntryValues, f64)),
    /// A number.
    Number(fn(&mut EntryValues) -> &mut f64),
    /// An order of the method.
    Order(fn(&mut EntryValues) -> &mut u32),
    /// A whole number of at least 1, see [`is_count`].
    Count(fn(&mut EntryValues) -> &mut u32),
    /// A condition.
    Truth(fn(&mut EntryValues) -> &mut bool),
    /// One of several names.
    Name(&'static Names),
}

impl Takes {
    /// Returns the expected values in words if a number is not one of them.
    pub(in crate::elaborate) fn refuses(&self, x: f64) -> Option<&'static str> {
        let (holds, expected) = match self {
            Takes::Duration(_) | Takes::Interval(_) | Takes::Positive(_) => (x.is_finite() && x > 0.0, "a positive number"),
            Takes::Number(_) => (x.is_finite(), "a number"),
            Takes::Tolerance(_) => (Solver::RTOL.contains(&x), Solver::RTOL_TEXT),
            Takes::Order(_) => (is_order(x), ORDER_TEXT),
            Takes::Count(_) => (is_count(x), COUNT_TEXT),
            Takes::Truth(_) => (false, "a condition"),
            Takes::Name(names) => (false, names.text),
        };
        (!holds).then_some(expected)
    }
}

/// Names that an entry takes.
pub(in crate::elaborate) struct Names {
    pub what: &'static str,
    /// They as a text.
    pub text: &'static str,
    /// Puts what is of a name where it belongs; `false` where nothing is.
    pub put: fn(&mut EntryValues, &str) -> bool,
}

static LINEAR_SOLVERS: Names = Names {
    what: "linear solver",
    text: LinearSolver::TEXT,
    put: |values, name| put_found(&mut values.solver.linear_solver, LinearSolver::from_name(name)),
};
static METHODS: Names =
    Names { what: "method", text: Method::TEXT, put: |values, name| put_found(&mut values.solver.method, Method::from_name(name)) };

fn put_found<T>(to: &mut T, found: Option<T>) -> bool {
    found.map(|found| *to = found).is_some()
}

const fn episode(name: &'static str, setting: Option<&'static str>, takes: Takes) -> Entry {
    Entry { block: Block::Episode, name, setting, takes }
}

const fn solver(name: &'static str, setting: Option<&'static str>, takes: Takes) -> Entry {
    Entry { block: Block::Solver, name, setting, takes }
}

/// All of them. The `max_steps` of the solver is the setting `max_internal_steps`: `max_steps` is
/// that of the episode.
pub(in crate::elaborate) static ENTRIES: &[Entry] = &[
    episode("step", Some("step"), Takes::Duration(|s| &mut s.episode.step)),
    episode("integrate", Some("integrate"), Takes::Interval(|s| &mut s.integrate)),
    episode("cycle", Some("cycle"), Takes::Interval(|s| &mut s.episode.cycle)),
    episode("max_steps", Some("max_steps"), Takes::Count(|s| &mut s.episode.max_steps)),
    episode("error_reward", Some("error_reward"), Takes::Number(|s| &mut s.episode.error_reward)),
    episode("end_is_success", None, Takes::Truth(|s| &mut s.episode.end_is_success)),
    episode("failure_pays_alone", None, Takes::Truth(|s| &mut s.episode.failure_pays_alone)),
    episode("single_precision", None, Takes::Truth(|s| &mut s.episode.single_precision)),
    solver("rtol", Some("rtol"), Takes::Tolerance(|s, rtol| s.solver.rtol = rtol)),
    solver("one_step_rtol", Some("one_step_rtol"), Takes::Tolerance(|s, rtol| s.solver.one_step_rtol = Some(rtol))),
    solver("atol_factor", Some("atol_factor"), Takes::Positive(|s| &mut s.solver.atol_factor)),
    solver("safety", None, Takes::Positive(|s| &mut s.solver.safety)),
    solver("max_order", Some("max_order"), Takes::Order(|s| &mut s.solver.max_order)),
    solver("max_steps", Some("max_internal_steps"), Takes::Count(|s| &mut s.solver.max_steps)),
    solver("max_step", Some("max_step"), Takes::Duration(|s| &mut s.solver.max_step)),
    solver("pade", Some("pade"), Takes::Order(|s| &mut s.solver.pade)),
    solver("max_events", Some("max_events"), Takes::Count(|s| &mut s.solver.max_events)),
    solver("linear_solver", Some("linear_solver"), Takes::Name(&LINEAR_SOLVERS)),
    solver("method", None, Takes::Name(&METHODS)),
    solver("retry", None, Takes::Truth(|s| &mut s.solver.retry)),
    solver("algebraic_error_control", None, Takes::Truth(|s| &mut s.solver.algebraic_error_control)),
    solver("quadrature_error_control", None, Takes::Truth(|s| &mut s.solver.quadrature_error_control)),
];

/// Names of the entries of a block, `episode` or `solver`, with the words that an entry takes if it
/// takes words.
pub fn block_entries(block: &str) -> impl Iterator<Item = (&'static str, Option<&'static str>)> {
    let of = move |entry: &&Entry| match entry.block {
        Block::Episode => block == "episode",
        Block::Solver => block == "solver",
    };
    ENTRIES.iter().filter(of).map(|entry| match &entry.takes {
        Takes::Name(names) => (entry.name, Some(names.text)),
        _ => (entry.name, None),
    })
}

/// Counts that an entry takes.
pub(in crate::elaborate) const COUNT_TEXT: &str = "a whole number from 1 to 4000000000";

/// Returns `true` if a number is one of them.
pub(in crate::elaborate) fn is_count(x: f64) -> bool {
    (1.0..=4e9).contains(&x) && x.fract() == 0.0
}

/// Orders that the method has.
pub(in crate::elaborate) const ORDER_TEXT: &str = "a whole number from 1 to 5";

/// Returns `true` if a number is one of them.
pub(in crate::elaborate) fn is_order(x: f64) -> bool {
    (1.0..=5.0).contains(&x) && x.fract() == 0.0
}

/// The entry that a setting means.
pub(in crate::elaborate) fn setting_entry(name: &str) -> Option<&'static Entry> {
    ENTRIES.iter().find(|entry| entry.setting == Some(name))
}

/// Name of an entry of `solver` as a setting, or in the block if it is not a setting.
#[must_use]
pub fn solver_setting(name: &'static str) -> &'static str {
    solver_entry(name).and_then(|entry| entry.setting).unwrap_or(name)
}

/// Returns the expected values in words if a number is not one that an entry of `solver` accepts.
#[must_use]
pub fn refused_by_solver(name: &str, x: f64) -> Option<&'static str> {
    solver_entry(name)?.takes.refuses(x)
}

fn solver_entry(name: &str) -> Option<&'static Entry> {
    ENTRIES.iter().find(|entry| entry.block == Block::Solver && entry.name == name)
}

/// Returns `true` if a setting is an entry of `episode` or `solver`.
pub fn is_entry_setting(name: &str) -> bool {
    setting_entry(name).is_some()
}
