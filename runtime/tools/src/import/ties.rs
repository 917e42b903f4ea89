//! Tickets of events that may have one priority.

use super::convert::Conversion;
use super::document::Event;
use super::order::Rival;
use super::tickets::{PERIOD, Tickets};

/// Ratio of the multipliers of tickets, modulo a prime number that keeps products exact.
const RATIO: u64 = 16_807;
const LARGEST: u64 = 4_194_301;

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
}
