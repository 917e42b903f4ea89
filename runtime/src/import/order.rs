//! Events that may act on one another at one instant, which run one by one.
//!
//! Events of the language that become true at one instant run at once, in the order of the text, from the values that the ones before them left. SBML runs
//! one after another by their priorities, looks at the triggers in between, and takes values from the time of the trigger. Where two events have nothing to do
//! with each other both are the same.

use super::convert::Conversion;
use super::document::Event;
use super::math::Math;

/// The symbols that an event reads and writes.
struct Touched {
    writes: Vec<String>,
    /// In its values, with the sizes that its concentrations need.
    values: Vec<String>,
    trigger: Vec<String>,
}

fn meet(a: &[String], b: &[String]) -> bool {
    a.iter().any(|id| b.contains(id))
}

/// The time of an event that happens at a number of the time and without a delay.
fn instant(event: &Event) -> Option<f64> {
    let Math::Apply(">" | ">=" | "<" | "<=", sides) = &event.trigger else { return None };
    match (&sides[..], &event.delay) {
        ([Math::Time, Math::Number(time, _)] | [Math::Number(time, _), Math::Time], None) => Some(*time),
        _ => None,
    }
}

/// For each event, the others that it may meet at one instant.
pub(super) fn rivals(c: &Conversion<'_>) -> Vec<Vec<usize>> {
    let events = &c.sbml.events;
    let touched: Vec<Touched> = events.iter().map(|event| touched(c, event)).collect();
    let ranked = events.iter().any(|event| event.priority.is_some());
    let disturbs = |a: usize, b: usize| {
        let (first, second) = (&touched[a], &touched[b]);
        meet(&first.writes, &second.values)
            || meet(&first.writes, &second.writes)
            || (ranked || !events[b].persistent) && meet(&first.writes, &second.trigger)
    };
    let met = |a: usize, b: usize| touched.iter().any(|t| meet(&touched[a].writes, &t.trigger) && meet(&touched[b].writes, &t.trigger));
    let apart = |a: usize, b: usize| matches!((instant(&events[a]), instant(&events[b])), (Some(a), Some(b)) if a != b);
    let rival = |a: usize, b: usize| a != b && !apart(a, b) && (disturbs(a, b) || disturbs(b, a) || met(a, b));
    (0..events.len()).map(|a| (0..events.len()).filter(|&b| rival(a, b)).collect()).collect()
}

fn touched(c: &Conversion<'_>, event: &Event) -> Touched {
    let mut values = vec![];
    for (_, id, math) in &event.assignments {
        values.extend(c.read_by(math));
        if c.roles.amounts.contains(id) {
            values.extend(c.read_by(&Math::Name(id.clone())).into_iter().filter(|read| read != id));
        }
    }
    let mut trigger = c.read_by(&event.trigger);
    trigger.extend(event.priority.iter().chain(&event.delay).flat_map(|math| c.read_by(math)));
    Touched { writes: event.targets().map(str::to_owned).collect(), values, trigger }
}
