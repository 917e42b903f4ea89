//! Events that may act on one another at one instant, which run one by one.
//!
//! Events of the language that become true at one instant run at once, in the order of the text,
//! from the values that the ones before them left. SBML runs one after another by their priorities,
//! looks at the triggers in between, and takes values from the time of the trigger. Where two
//! events have nothing to do with each other both are the same.

use std::collections::HashSet;

use super::convert::Conversion;
use super::document::{Event, Target};
use super::math::Math;
use super::roles::Role;

/// The symbols that an event reads and writes.
struct Touched {
    writes: HashSet<String>,
    /// In its values, with the sizes that its concentrations need.
    values: HashSet<String>,
    trigger: HashSet<String>,
}

fn meet(a: &HashSet<String>, b: &HashSet<String>) -> bool {
    !a.is_disjoint(b)
}

/// The time of an event that happens at a number of the time and without a delay.
fn instant(event: &Event) -> Option<f64> {
    let Math::Apply(">" | ">=" | "<" | "<=", sides) = &event.trigger else { return None };
    match (&sides[..], &event.delay) {
        ([Math::Time, Math::Number(time, _)] | [Math::Number(time, _), Math::Time], None) => Some(*time),
        _ => None,
    }
}

/// An event that another one may meet at one instant.
#[derive(Clone)]
pub(super) struct Rival {
    pub(super) number: usize,
    /// The one acts on the other, not only on what other events do in between.
    pub(super) direct: bool,
}

/// The other events that each event may meet at one instant.
pub(super) fn rivals(c: &Conversion<'_>) -> Vec<Vec<Rival>> {
    let events = &c.sbml.events;
    let touched: Vec<Touched> = events.iter().map(|event| touched(c, event)).collect();
    let ranked = events.iter().any(|event| event.priority.is_some());
    let disturbs = |a: usize, b: usize| {
        let (first, second) = (&touched[a], &touched[b]);
        meet(&first.writes, &second.values)
            || meet(&first.writes, &second.writes)
            || (ranked || !events[b].persistent) && meet(&first.writes, &second.trigger)
    };
    // Two events that write what one trigger reads: it may hold between them.
    let mut met: HashSet<(usize, usize)> = HashSet::new();
    for third in &touched {
        let writers: Vec<usize> = (0..events.len()).filter(|&a| meet(&touched[a].writes, &third.trigger)).collect();
        met.extend(writers.iter().flat_map(|&a| writers.iter().map(move |&b| (a, b))));
    }
    let apart = |a: usize, b: usize| matches!((instant(&events[a]), instant(&events[b])), (Some(a), Some(b)) if a != b);
    let rival = |a: usize, b: usize| a != b && !apart(a, b) && (disturbs(a, b) || disturbs(b, a) || met.contains(&(a, b)));
    let direct: Vec<Vec<usize>> = (0..events.len()).map(|a| (0..events.len()).filter(|&b| rival(a, b)).collect()).collect();
    // By priorities an event also waits for one that triggers a rival.
    let group = if ranked { groups(&direct) } else { vec![] };
    let together = |a: usize, b: usize| a != b && ranked && group[a] == group[b];
    let of = |a: usize| {
        let direct: HashSet<usize> = direct[a].iter().copied().collect();
        let all = (0..events.len()).filter(|&b| direct.contains(&b) || together(a, b));
        all.map(|number| Rival { number, direct: direct.contains(&number) }).collect()
    };
    (0..events.len()).map(of).collect()
}

/// The group of each event: those that are connected by rivals.
fn groups(direct: &[Vec<usize>]) -> Vec<usize> {
    let mut group = vec![usize::MAX; direct.len()];
    for start in 0..direct.len() {
        let mut stack = vec![start];
        while let Some(event) = stack.pop() {
            if group[event] == usize::MAX {
                group[event] = start;
                stack.extend(&direct[event]);
            }
        }
    }
    group
}

fn touched(c: &Conversion<'_>, event: &Event) -> Touched {
    let mut values = HashSet::new();
    for (_, id, math) in &event.assignments {
        values.extend(c.read_by(math));
        if c.roles.amounts.contains(id) {
            values.extend(c.read_by(&Math::Name(id.clone())).into_iter().filter(|read| read != id));
        }
    }
    let mut trigger: HashSet<String> = c.read_by(&event.trigger).into_iter().collect();
    trigger.extend(event.priority.iter().chain(&event.delay).flat_map(|math| c.read_by(math)));
    for read in [&mut values, &mut trigger] {
        if read.iter().any(|id| c.roles.of(id) == Some(Role::Variable)) {
            let rules = c.sbml.rules.iter().filter(|rule| matches!(rule.target, Target::Algebraic));
            read.extend(rules.flat_map(|rule| c.read_by(&rule.math)));
        }
    }
    Touched { writes: event.targets().map(str::to_owned).collect(), values, trigger }
}
