//! Random order of events with one priority.
//!
//! SBML draws the order of such events. Here each of them has a ticket, and the larger one goes
//! first. Tickets are multiples of the state of a generator of whole numbers, modulo its period (S.
//! K. Park and K. W. Miller, *Commun. ACM* 31 (1988) 1192), which an execution advances. The reset
//! of an episode draws the first state.

/// Period of the generator, the prime number 2^31 - 1, and its multiplier.
pub(super) const PERIOD: u64 = 2_147_483_647;
const MULTIPLIER: u64 = 48_271;

/// The generator, and the tickets by the numbers of events.
#[derive(Default)]
pub(super) struct Tickets {
    pub(super) state: String,
    pub(super) of: Vec<Option<String>>,
}

impl Tickets {
    /// The condition under which the ticket of one event is larger than that of another; `None` if
    /// the order is that of the file.
    pub(super) fn larger(&self, first: usize, second: usize) -> Option<String> {
        let of = |number: usize| self.of.get(number)?.as_ref();
        Some(format!("{} > {}", of(first)?, of(second)?))
    }

    /// The statement by which an execution of an event advances the generator.
    pub(super) fn advance(&self, number: usize) -> Option<String> {
        self.of.get(number)?.as_ref()?;
        let state = &self.state;
        Some(format!("next {state} = mod({MULTIPLIER}*{state}, {PERIOD})"))
    }
}
