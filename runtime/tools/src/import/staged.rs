//! Events in stages: a trigger, a delay, an execution one by one.
//!
//! The trigger sets the values aside and notes that the event is due, now or after its delay; a
//! separate event executes it. What may act on one another is executed one by one: `settling` is 1
//! for one more round of events, in which triggers see what has changed.

use super::convert::{Conversion, at, comment};
use super::document::Event;
use super::math::Math;
use super::order::Rival;
use super::roles::Role;
use super::xml::Fault;

/// A time that does not come.
const NEVER: &str = "1e300";

/// The number of executions of one event that can wait at once, if its condition may become true
/// again before the first.
const SLOTS: usize = 4;

/// Names of the parts of a staged event.
pub(super) struct Plan {
    number: usize,
    name: String,
    slots: Vec<Slot>,
    /// Other events that it may meet at one instant.
    rivals: Vec<Rival>,
    /// Its condition may become true again while all slots are taken.
    overlaps: bool,
}

/// One execution that waits.
struct Slot {
    name: String,
    /// It is to be executed now; none where the time decides alone.
    due: Option<String>,
    /// Time of the execution of a delayed event.
    time: Option<String>,
}

impl Conversion<'_> {
    /// Names the parts of an event that cannot act at once; `None` for one that can.
    pub(super) fn plan(&mut self, number: usize, rivals: Vec<Rival>) -> Option<Plan> {
        let event = &self.sbml.events[number];
        let mixed = self.is_mixed(event);
        if event.assignments.is_empty() || rivals.is_empty() && event.delay.is_none() && !mixed {
            return None;
        }
        let name = self.names.of(&event.id);
        let reads = self.read_by(&event.trigger);
        let others = self.sbml.events.iter().enumerate().filter(|(other, _)| *other != number);
        let disturbed = others.flat_map(|(_, event)| event.targets()).any(|id| reads.iter().any(|read| read == id));
        let once = match &event.trigger {
            Math::Apply(">" | ">=", sides) => sides.len() == 2 && sides[0] == Math::Time && self.is_fixed(&sides[1]),
            Math::Apply("<" | "<=", sides) => sides.len() == 2 && sides[1] == Math::Time && self.is_fixed(&sides[0]),
            _ => false,
        };
        let overlaps = if event.delay.is_some() { !once } else { event.persistent && disturbed };
        let count = if overlaps && event.delay.is_some() { SLOTS } else { 1 };
        let ordered = !rivals.is_empty();
        let slots = (1..=count).map(|k| {
            let suffix = if count == 1 { String::new() } else { format!("_{k}") };
            let mut fresh = |what: &str| self.names.fresh(&format!("{name}_{what}{suffix}"));
            Slot {
                due: (event.delay.is_none() || ordered || mixed && !event.early_values).then(|| fresh("due")),
                time: event.delay.is_some().then(|| fresh("time")),
                name: if k == 1 { name.clone() } else { self.names.fresh(&format!("{name}{suffix}")) },
            }
        });
        let slots = slots.collect();
        Some(Plan { number, name, slots, rivals, overlaps })
    }

    /// Returns true for a number or a parameter.
    fn is_fixed(&self, math: &Math) -> bool {
        matches!(math, Math::Number(..)) || matches!(math, Math::Name(id) if self.roles.of(id) == Some(Role::Parameter))
    }

    /// Declares the flags by which events run one by one: one for executions, one for what they set
    /// in a separate round.
    pub(super) fn settling(&mut self, plans: &[Option<Plan>]) -> Vec<String> {
        let ordered = |plan: &&Plan| !plan.rivals.is_empty();
        let in_two = |plan: &Plan| {
            let event = &self.sbml.events[plan.number];
            !event.early_values && self.is_mixed(event)
        };
        let rounds = match plans.iter().flatten().filter(ordered).any(in_two) {
            true => 2,
            false => usize::from(plans.iter().flatten().any(|plan| ordered(&plan))),
        };
        if rounds > 0 {
            self.line("# Events that may act on one another run one by one, and triggers are looked at in between.");
        }
        let mut flags = vec![];
        for _ in 0..rounds {
            let (flag, event) = (self.names.fresh("settling"), self.names.fresh("settled"));
            self.line(&format!("discrete {flag} = 0"));
            self.line(&format!("event {event} when {flag} > 0.5"));
            self.line(&format!("at {event} {{ next {flag} = 0 }}"));
            flags.push(flag);
        }
        flags
    }

    pub(super) fn staged(&mut self, event: &Event, plan: &Plan, plans: &[Option<Plan>], settling: &[String]) -> Result<(), Fault> {
        let mixed = self.is_mixed(event);
        let late = !event.early_values;
        let ordered = !plan.rivals.is_empty();
        let armed = self.armed(plan.number, event, &plan.name)?;
        let unit = self.time_unit();
        let mut aside = vec![];
        for (k, slot) in plan.slots.iter().enumerate() {
            let (start, time_start) = if k == 0 { self.first_slot(event, plan.number)? } else { (vec![], NEVER.to_owned()) };
            let kept = if late && !mixed { vec![] } else { self.set_aside(event, slot, &start)? };
            if let Some(due) = &slot.due {
                self.line(&format!("discrete {due} = 0"));
            }
            if let Some(time) = &slot.time {
                let line = self.declaration(time, &unit, &time_start, "");
                self.line(&format!("discrete {line}"));
            }
            aside.push(kept);
        }
        self.triggered(event, plan, &aside, armed.as_deref())?;
        for (k, slot) in plan.slots.iter().enumerate() {
            let capture = if late && mixed && !ordered && event.delay.is_some() { self.captured(event, &aside[k])? } else { vec![] };
            self.arrival(slot, capture);
            let condition = self.turn(plan, k, plans, settling)?;
            let note = if k == 0 { comment(event) } else { String::new() };
            self.line(&format!("event {} when {condition}{note}", slot.name));
            let flag = settling.first().filter(|_| ordered);
            let ends = slot.due.iter().map(|due| format!("next {due} = 0"));
            let ends = ends.chain(flag.map(|flag| format!("next {flag} = 1"))).chain(self.tickets.advance(plan.number)).collect();
            match settling.last() {
                Some(last) if late && mixed && ordered => self.in_two_rounds(event, slot, &aside[k], last, ends)?,
                _ => {
                    let lines = self.executed_lines(event, slot, &aside[k], ends)?;
                    self.block(&slot.name, &lines);
                }
            }
        }
        Ok(())
    }

    /// An execution that first sets its values aside, all from before it, and sets the symbols in
    /// the next round of events.
    fn in_two_rounds(&mut self, event: &Event, slot: &Slot, aside: &[String], settling: &str, ends: Vec<String>) -> Result<(), Fault> {
        let (flag, sets) = (self.names.fresh(&format!("{}_taken", slot.name)), self.names.fresh(&format!("{}_sets", slot.name)));
        let mut lines: Vec<String> = self.captured(event, aside)?.into_iter().map(|(own, value)| format!("next {own} = {value}")).collect();
        lines.extend(ends);
        lines.push(format!("next {flag} = 1"));
        self.block(&slot.name, &lines);
        self.line(&format!("discrete {flag} = 0"));
        self.line(&format!("event {sets} when {flag} > 0.5"));
        let ends = vec![format!("next {flag} = 0"), format!("next {settling} = 1")];
        let lines = self.executed_lines(event, slot, aside, ends)?;
        self.block(&sets, &lines);
        Ok(())
    }

    /// The values set aside and the time of an execution that waits from the start on.
    fn first_slot(&self, event: &Event, number: usize) -> Result<(Vec<String>, String), Fault> {
        let Some(first) = self.first.delayed.get(&number) else { return Ok((vec![], NEVER.to_owned())) };
        let values = first.values.iter().map(|value| self.text(event.at, value)).collect::<Result<_, _>>()?;
        let time = self.text(event.at, &first.time)?;
        if first.condition.names().is_empty() {
            return Ok((values, time));
        }
        let never = self.never();
        Ok((values, format!("if {} then {time} else {never}", self.truth(event.at, &first.condition)?)))
    }

    /// A time that does not come, with its unit.
    fn never(&self) -> String {
        let unit = self.time_unit();
        if self.bare || unit == "1" { NEVER.to_owned() } else { format!("{NEVER} [{unit}]") }
    }

    /// Declares a variable for each value that is set aside.
    fn set_aside(&mut self, event: &Event, slot: &Slot, start: &[String]) -> Result<Vec<String>, Fault> {
        let mut names = vec![];
        for (k, (place, id, _)) in event.assignments.iter().enumerate() {
            let symbol = self.symbol(id).ok_or_else(|| at(*place, format!("unknown symbol `{id}`")))?.clone();
            let name = self.names.fresh(&format!("{}_at_{}", self.names.of(id), slot.name));
            let line = self.declaration(&name, &self.unit(&symbol), start.get(k).map_or("0", String::as_str), "set aside by the event");
            self.line(&format!("discrete {line}"));
            names.push(name);
        }
        Ok(names)
    }

    /// Variables that keep the values of an event, with these values.
    fn captured(&self, event: &Event, aside: &[String]) -> Result<Vec<(String, String)>, Fault> {
        let with_values = event.assignments.iter().zip(aside);
        with_values.map(|((place, _, math), name)| Ok((name.clone(), self.text(*place, &self.checked(*place, math)?)?))).collect()
    }

    /// The trigger: notes when the event is due, in the first slot that is free.
    fn triggered(&mut self, event: &Event, plan: &Plan, aside: &[Vec<String>], armed: Option<&str>) -> Result<(), Fault> {
        let name = self.names.fresh(&format!("{}_trigger", plan.name));
        let delay = match &event.delay {
            Some(math) => Some(format!("{} + {}", self.time_name(), self.factor(event.at, &self.checked(event.at, math)?)?)),
            None => None,
        };
        let early = event.early_values || self.is_mixed(event) && delay.is_none() && plan.rivals.is_empty();
        let (mut lines, mut before) = (vec![], vec![]);
        before.extend(armed.map(|armed| format!("{armed} > 0.5")));
        for (slot, aside) in plan.slots.iter().zip(aside) {
            let mut taken = before.clone();
            if plan.slots.len() > 1 {
                taken.push(format!("not ({})", slot.taken()));
            }
            let mut set = if early { self.captured(event, aside)? } else { vec![] };
            match (&delay, &slot.time, &slot.due) {
                (Some(delay), Some(time), _) => set.push((time.clone(), delay.clone())),
                (_, _, Some(due)) => set.push((due.clone(), "1".into())),
                _ => {}
            }
            let when = taken.join(" and ");
            let guarded = |value: String, own: &str| if when.is_empty() { value } else { format!("if {when} then {value} else {own}") };
            lines.extend(set.into_iter().map(|(own, value)| format!("next {own} = {}", guarded(value, &own))));
            before.push(format!("({})", slot.taken()));
        }
        let lost = self.lost(plan, &before, &mut lines);
        lines.extend(armed.map(|armed| format!("next {armed} = 1")));
        let condition = self.condition(event, false)?;
        self.line(&format!("event {name} when {condition}"));
        self.block(&name, &lines);
        if let Some(lost) = lost {
            let failure = self.names.fresh(&format!("{}_overlap", plan.name));
            self.line("# More executions wait at once than there is room for.");
            self.line(&format!("fail {failure} event {lost} > 0.5"));
        }
        if !event.persistent {
            let ceases = self.names.fresh(&format!("{}_ceases", plan.name));
            let condition = self.condition(event, true)?;
            self.line(&format!("event {ceases} when {condition}"));
            let lines: Vec<String> = plan.slots.iter().flat_map(|slot| self.forgotten(slot)).collect();
            self.block(&ceases, &lines);
        }
        Ok(())
    }

    /// Declares the variable that notes an execution without a free slot.
    fn lost(&mut self, plan: &Plan, taken: &[String], lines: &mut Vec<String>) -> Option<String> {
        if !plan.overlaps {
            return None;
        }
        let lost = self.names.fresh(&format!("{}_lost", plan.name));
        self.line(&format!("discrete {lost} = 0"));
        lines.push(format!("next {lost} = if {} then 1 else {lost}", taken.join(" and ")));
        Some(lost)
    }

    /// Statements that empty a slot.
    fn forgotten(&self, slot: &Slot) -> Vec<String> {
        let never = self.never();
        let due = slot.due.iter().map(|due| format!("next {due} = 0"));
        due.chain(slot.time.iter().map(|time| format!("next {time} = {never}"))).collect()
    }

    /// The end of a delay, where the execution waits for its turn after it.
    fn arrival(&mut self, slot: &Slot, captured: Vec<(String, String)>) {
        let (Some(due), Some(time)) = (&slot.due, &slot.time) else { return };
        let name = self.names.fresh(&format!("{}_arrives", slot.name));
        self.line(&format!("event {name} when {} >= {time}", self.time_name()));
        let mut lines: Vec<String> = captured.into_iter().map(|(own, value)| format!("next {own} = {value}")).collect();
        lines.extend(self.forgotten(slot).into_iter().filter(|line| !line.starts_with(&format!("next {due} "))));
        lines.push(format!("next {due} = 1"));
        self.block(&name, &lines);
    }

    /// When it is the turn of a slot: it is due, and no earlier one is.
    fn turn(&self, plan: &Plan, slot: usize, plans: &[Option<Plan>], settling: &[String]) -> Result<String, Fault> {
        let own = &plan.slots[slot];
        let due = match (&own.due, &own.time) {
            (Some(due), _) => due,
            (None, Some(time)) => return Ok(format!("{} >= {time}", self.time_name())),
            (None, None) => return Ok("0 > 1".into()),
        };
        let mut first: Vec<String> = vec![];
        if !plan.rivals.is_empty() {
            first.extend_from_slice(settling);
        }
        first.extend(plan.slots[..slot].iter().filter_map(|s| s.due.clone()));
        for (rival, other) in plan.rivals.iter().filter_map(|rival| Some((rival, plans[rival.number].as_ref()?))) {
            let dues = other.slots.iter().filter_map(|s| s.due.as_ref());
            match self.goes_before(rival, plan.number)? {
                Before::Always => first.extend(dues.cloned()),
                Before::When(condition) => first.extend(dues.map(|due| format!("if {condition} then {due} else 0"))),
                Before::Never => {}
            }
        }
        Ok(match &first[..] {
            [] => format!("{due} > 0.5"),
            [one] if one.starts_with("if ") => format!("{due} - ({one}) > 0.5"),
            [one] => format!("{due} - {one} > 0.5"),
            many => format!("{due} - max({}) > 0.5", many.join(", ")),
        })
    }

    /// The condition under which an event is executed before another one that is due as well.
    fn goes_before(&self, rival: &Rival, own: usize) -> Result<Before, Fault> {
        let (first, second) = (&self.sbml.events[rival.number], &self.sbml.events[own]);
        let earlier = rival.number < own;
        let (a, b) = match (&first.priority, &second.priority) {
            (None, None) => return Ok(if earlier { Before::Always } else { Before::Never }),
            (Some(_), None) => return Ok(Before::Always),
            (None, Some(_)) => return Ok(Before::Never),
            (Some(a), Some(b)) => (a, b),
        };
        let ticket = self.tickets.larger(rival.number, own);
        if let (Some(a), Some(b)) = (a.constant(), b.constant()) {
            return Ok(match ticket.filter(|_| a == b) {
                Some(larger) => Before::When(larger),
                None if a > b || a == b && earlier => Before::Always,
                None => Before::Never,
            });
        }
        let text = |event: &Event, math: &Math| self.factor(event.at, &self.checked(event.at, math)?);
        let (a, b) = (text(first, a)?, text(second, b)?);
        Ok(Before::When(match ticket {
            Some(larger) => format!("({a}) > ({b}) or ({a}) >= ({b}) and {larger}"),
            None => format!("({a}) {} ({b})", if earlier { ">=" } else { ">" }),
        }))
    }

    /// The execution. Amounts come first: they are made with the sizes before the event.
    fn executed_lines(&self, event: &Event, slot: &Slot, aside: &[String], ends: Vec<String>) -> Result<Vec<String>, Fault> {
        let mut lines: Vec<(u8, String)> = vec![];
        for (number, (place, id, math)) in event.assignments.iter().enumerate() {
            let size = self.own_size(id);
            let value = match (aside.get(number), &size) {
                (Some(aside), Some(size)) => format!("{aside}*{size}"),
                (Some(aside), None) => aside.clone(),
                (None, _) => self.assigned(*place, id, math)?,
            };
            let keyword = self.keyword(id);
            let rank = if keyword == "next" { 0 } else { 2 - u8::from(size.is_some()) };
            lines.push((rank, format!("{keyword} {} = {value}", self.kept(id))));
        }
        lines.sort_by_key(|(rank, _)| *rank);
        let mut lines: Vec<String> = lines.into_iter().map(|(_, line)| line).collect();
        if slot.due.is_none() {
            lines.extend(self.forgotten(slot));
        }
        lines.extend(ends);
        Ok(lines)
    }
}

/// The order of two events.
enum Before {
    Always,
    Never,
    When(String),
}

impl Slot {
    /// The condition that an execution waits in it.
    fn taken(&self) -> String {
        let due = self.due.iter().map(|due| format!("{due} > 0.5"));
        let time = self.time.iter().map(|time| format!("value({time}) < 1e299"));
        due.chain(time).collect::<Vec<_>>().join(" or ")
    }
}
