//! Events at the start of a run. In SBML they belong to the start: its values are those after them.
//! In the language an event happens in the first step, so that initial values say what these events
//! set.
//!
//! The events are run here on numbers, to know which; initial values are expressions, with the
//! triggers as conditions. Where that cannot be done (a trigger whose value is not known here) the
//! events happen in the first step.

use std::collections::HashMap;

use super::convert::{Conversion, at};
use super::document::{Event, SymbolRole};
use super::initial::{Delayed, First};
use super::math::Math;
use super::order::{self, Rival};
use super::xml::Fault;

/// Runs of events at the start that are followed.
const MOST_RUNS: usize = 50;

/// A triggered event: its number, its condition, and the values from the time of the trigger.
struct Waiting {
    event: usize,
    condition: Math,
    values: Option<Vec<(String, Math)>>,
}

type Values = HashMap<String, Math>;

impl Conversion<'_> {
    /// Finds the events at the start and what they set.
    pub(super) fn run_first_events(&mut self) {
        self.first.before = true;
        let found = self.first_events().ok().flatten();
        self.first = found.filter(|first| !first.ran.is_empty()).unwrap_or_default();
    }

    fn first_events(&self) -> Result<Option<First>, Fault> {
        let events = &self.sbml.events;
        let mut held: Vec<bool> = events.iter().map(|event| event.starts_true).collect();
        let mut first = First { before: true, ..First::default() };
        let mut waiting: Vec<Waiting> = vec![];
        for _ in 0..MOST_RUNS {
            for (number, event) in events.iter().enumerate() {
                let condition = self.after(event.at, &event.trigger, &first.values)?;
                let Some(holds) = self.number_at_the_start(&condition) else { return Ok(None) };
                let holds = holds != 0.0;
                if holds && !held[number] {
                    let values = if event.early_values { Some(self.set_by(event, &first.values)?) } else { None };
                    match &event.delay {
                        None => waiting.push(Waiting { event: number, condition, values }),
                        Some(delay) => {
                            let time = self.after(event.at, delay, &first.values)?;
                            let values = values.into_iter().flatten().map(|(_, value)| value).collect();
                            if first.delayed.insert(number, Delayed { condition, time, values }).is_some() {
                                return Ok(None);
                            }
                        }
                    }
                } else if !holds && !event.persistent {
                    waiting.retain(|w| w.event != number);
                    first.delayed.remove(&number);
                }
                held[number] = holds;
            }
            let Some(next) = self.most_urgent(&waiting, &first.values)? else { return Ok(Some(first)) };
            let Waiting { event, condition, values } = waiting.remove(next);
            let values = values.map_or_else(|| self.set_by(&events[event], &first.values), Ok)?;
            first.values = self.executed(&events[event], &condition, values, &first.values)?;
            if first.ran.insert(event, condition).is_some() {
                return Ok(None);
            }
        }
        Ok(None)
    }

    fn number_at_the_start(&self, math: &Math) -> Option<f64> {
        math.value(&mut |id| self.start_value(id, 0)).filter(|x| !x.is_nan())
    }

    /// The waiting event of the highest priority, the first one of several that do not affect one
    /// another.
    fn most_urgent(&self, waiting: &[Waiting], now: &Values) -> Result<Option<usize>, Fault> {
        let events = &self.sbml.events;
        let mut best: Option<(usize, f64)> = None;
        let mut ranks: Vec<(usize, f64)> = vec![];
        for (place, entry) in waiting.iter().enumerate() {
            let event = &events[entry.event];
            let priority = match &event.priority {
                Some(math) => self.number_at_the_start(&self.after(event.at, math, now)?),
                None => Some(f64::NEG_INFINITY),
            };
            let priority = priority.ok_or_else(|| at(event.at, "a priority that is not known"))?;
            ranks.push((entry.event, priority));
            let number = |place: usize| waiting[place].event;
            if best.is_none_or(|(b, least)| priority > least || priority == least && number(place) < number(b)) {
                best = Some((place, priority));
            }
        }
        let Some((place, priority)) = best else { return Ok(None) };
        let chosen = waiting[place].event;
        let tie = |rival: &Rival| rival.direct && priority.is_finite() && ranks.contains(&(rival.number, priority));
        if let Some(rival) = order::rivals(self)[chosen].iter().find(|rival| tie(rival)) {
            return Err(at(events[rival.number].at, "a random order at the start"));
        }
        Ok(Some(place))
    }

    /// The values that an event sets, as expressions at the start.
    fn set_by(&self, event: &Event, now: &Values) -> Result<Vec<(String, Math)>, Fault> {
        let one = |(place, id, math): &(usize, String, Math)| Ok((id.clone(), self.after(*place, math, now)?));
        event.assignments.iter().map(one).collect()
    }

    /// The values after an event: what it sets, and concentrations where it changes sizes.
    fn executed(&self, event: &Event, condition: &Math, values: Vec<(String, Math)>, now: &Values) -> Result<Values, Fault> {
        let mut after = now.clone();
        let certain = condition.names().is_empty();
        for (id, value) in values {
            let before = self.after(event.at, &Math::Name(id.clone()), now)?;
            let guarded = if certain { value } else { Math::Piecewise(vec![(value, condition.clone())], Box::new(before)) };
            after.insert(id, guarded);
        }
        for symbol in self.sbml.symbols.iter().filter(|s| self.roles.amounts.contains(&s.id)) {
            let SymbolRole::Species { compartment, .. } = &symbol.kind else { continue };
            if !event.targets().any(|id| id == compartment) {
                continue;
            }
            let own = Math::Name(symbol.id.clone());
            let concentration = after.get(&symbol.id).cloned().map_or_else(|| self.after(event.at, &own, now), Ok)?;
            let sizes = [self.after(event.at, &Math::Name(compartment.clone()), now)?, after[compartment].clone()];
            let [old, new] = sizes;
            let amount = Math::Apply("*", vec![concentration, old]);
            after.insert(symbol.id.clone(), Math::Apply("/", vec![amount, new]));
        }
        Ok(after)
    }

    /// An expression after the events so far.
    pub(super) fn after(&self, place: usize, math: &Math, now: &Values) -> Result<Math, Fault> {
        self.at_the_start_after(place, &self.checked(place, math)?, now, 0)
    }
}
