//! The events at the start of a run, and the values that they set.

use std::collections::HashMap;

use super::math::Math;

/// Events that run at the start.
#[derive(Default)]
pub(super) struct First {
    /// The values of symbols after these events, as expressions of those before.
    pub(super) values: HashMap<String, Math>,
    /// The events with the condition that each ran under.
    pub(super) ran: HashMap<usize, Math>,
    /// The events that wait for their delay.
    pub(super) delayed: HashMap<usize, Delayed>,
    /// Expressions at the start read the initial values of symbols that events set.
    pub(super) before: bool,
}

/// An event that is triggered at the start and runs after its delay.
pub(super) struct Delayed {
    pub(super) condition: Math,
    pub(super) time: Math,
    /// The values from the time of the trigger.
    pub(super) values: Vec<Math>,
}
