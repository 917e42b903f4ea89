//! Random order of events with one priority.
//!
//! SBML draws the order of such events. Here each of them has a ticket, and the larger one goes
//! first. Tickets are multiples of the state of a generator of whole numbers, modulo its period (S.
//! K. Park and K. W. Miller, *Commun. ACM* 31 (1988) 1192), which an execution advances. The reset
//! of an episode draws the first state.

use super::convert::Conversion;
use super::document::Event;
use super::order::Rival;

/// Period of the generator, the prime number 2^31 - 1, and its multiplier.
const PERIOD: u64 = 2_147_483_647;
const MULTIPLIER: u64 = 48_271;

/// Ratio of the multipliers of tickets, modulo a prime number that keeps products exact.
const RATIO: u64 = 16_807;
const LARGEST: u64 = 4_194_301;

/// The generator, and the tickets by the numbers of events.
#[derive(Default)]
pub(super) struct Tickets {
    state: String,
    of: Vec<Option<String>>,
}

/// Returns true for two events whose priorities may be the same.
fn may_tie(first: &Event, second: &Event) -> bool {
    match (&first.priority, &second.priority) {
        (Some(a), Some(b)) => a.constant().is_none() || b.constant().is_none() || a.constant() == b.constant(),
        _ => false,
    }
}

impl Conversion<'_> {
    /// Declares the generator and the tickets of all events with a priority, if two of these may
    /// affect one another and have the same priority.
    pub(super) fn declare_tickets(&mut self, rivals: &[Vec<Rival>]) {
        let sbml = self.sbml;
        let events = &sbml.events;
        let ties = |own: usize, rival: &Rival| rival.direct && may_tie(&events[own], &events[rival.number]);
        if !rivals.iter().enumerate().any(|(own, rivals)| rivals.iter().any(|rival| ties(own, rival))) {
            return;
        }
        self.line("# Events with one priority run in random order: each has a ticket, and the larger one goes first.");
        let (start, state) = (self.names.fresh("draw"), self.names.fresh("dice"));
        self.line(&format!("random {start} ~ uniform(0, 1)"));
        self.line(&format!("discrete {state} = 1 + floor({}*{start})", PERIOD - 1));
        let (mut of, mut factor) = (vec![], RATIO);
        for (number, event) in events.iter().enumerate() {
            factor = factor * RATIO % LARGEST;
            let ranked = event.priority.is_some() && !rivals[number].is_empty();
            of.push(ranked.then(|| {
                let name = self.names.fresh(&format!("{}_ticket", self.names.of(&event.id)));
                self.line(&format!("let {name} : 1 = mod({factor}*{state}, {PERIOD})"));
                name
            }));
        }
        self.tickets = Tickets { state, of };
    }

    /// The condition under which the ticket of one event is larger than that of another; `None` if
    /// the order is that of the file.
    pub(super) fn has_larger_ticket(&self, first: usize, second: usize) -> Option<String> {
        let of = |number: usize| self.tickets.of.get(number)?.as_ref();
        Some(format!("{} > {}", of(first)?, of(second)?))
    }

    /// The statement by which an execution of an event advances the generator.
    pub(super) fn advance_tickets(&self, number: usize) -> Option<String> {
        self.tickets.of.get(number)?.as_ref()?;
        let state = &self.tickets.state;
        Some(format!("next {state} = mod({MULTIPLIER}*{state}, {PERIOD})"))
    }
}
