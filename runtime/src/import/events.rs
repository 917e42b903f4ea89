//! Events and constraints.

use super::convert::{Conversion, at, quoted};
use super::document::{Event, Kind, Symbol, Target};
use super::math::Math;
use super::roles::Role;
use super::trigger::trigger;
use super::units;
use super::xml::Fault;

impl Conversion<'_> {
    pub(super) fn events(&mut self) -> Result<(), Fault> {
        if !self.sbml.events.is_empty() {
            self.line("\n# events");
        }
        for event in &self.sbml.events {
            self.event(event)?;
        }
        Ok(())
    }

    /// The condition of an event as the language takes it: one comparison; and with `ready`, that it has not held from the start on.
    pub(super) fn condition(&self, event: &Event, negated: bool, ready: Option<&str>) -> Result<String, Fault> {
        let refused = |why: String| at(event.at, format!("the trigger of the event `{}` {why}", event.id));
        let math = self.checked(event.at, &event.trigger)?;
        let made = trigger(&math, negated).map_err(refused)?;
        match ready {
            None if made.plain => self.text(event.at, &math),
            None => Ok(format!("{} {} 0", self.text(event.at, &made.value)?, if made.at_zero { ">=" } else { ">" })),
            Some(ready) => {
                let sign = if made.at_zero { ">=" } else { ">" };
                Ok(format!("min({}, {ready} - 0.5) {sign} 0", self.text(event.at, &made.value)?))
            }
        }
    }

    pub(super) fn event(&mut self, event: &Event) -> Result<(), Fault> {
        let name = self.names.of(&event.id);
        let starts = event.trigger.value(&mut |id| self.start_value(id, 0));
        let comment = if event.name.is_empty() { String::new() } else { format!("    # {}", quoted(&event.name, 80)) };
        if event.starts_true && starts != Some(0.0) {
            // What holds from the start on has not become true: the event waits until it has ceased to.
            let ready = self.names.fresh(&format!("{name}_ready"));
            let again = self.names.fresh(&format!("{name}_again"));
            let first = self.at_the_start(event.at, &self.checked(event.at, &event.trigger)?, 0)?;
            let first = self.text(event.at, &first)?;
            let (ceased, holds) = (self.condition(event, true, None)?, self.condition(event, false, Some(&ready))?);
            self.line("# What holds from the start on has not become true: the event waits until it has ceased to.");
            self.line(&format!("discrete {ready} = if {first} then 0 else 1"));
            self.line(&format!("event {again} when {ceased}"));
            self.line(&format!("at {again} {{ next {ready} = 1 }}"));
            self.line(&format!("event {name} when {holds}{comment}"));
        } else {
            let condition = self.condition(event, false, None)?;
            self.line(&format!("event {name} when {condition}{comment}"));
        }
        let lines = self.assignments(event, &name)?;
        if !lines.is_empty() {
            self.line(&format!("at {name} {{\n{}}}", lines.iter().map(|l| format!("  {l}\n")).collect::<String>()));
        }
        Ok(())
    }

    /// All values are those from before the event: a state that is set from what the event changes is set by way of a discrete variable.
    pub(super) fn assignments(&mut self, event: &Event, name: &str) -> Result<Vec<String>, Fault> {
        let targets: Vec<&str> = event.assignments.iter().map(|(_, id, _)| id.as_str()).collect();
        let (mut nexts, mut resets) = (vec![], vec![]);
        for (place, id, math) in &event.assignments {
            let math = self.checked(*place, math)?;
            let symbol = self.symbol(id).ok_or_else(|| at(*place, format!("unknown symbol `{id}`")))?.clone();
            let mut value = self.text(*place, &math)?;
            if self.roles.amounts.contains(id) {
                let Kind::Species { compartment, .. } = &symbol.kind else { continue };
                if targets.contains(&compartment.as_str()) {
                    let message =
                        format!("the event `{}` sets `{id}` and its compartment: which of the two comes first is not said", event.id);
                    return Err(at(*place, message));
                }
                let size = self.compartment_name(&symbol).unwrap_or_else(|| "1".into());
                value = format!("{}*{size}", self.factor(*place, &math)?);
            }
            let kept = self.kept(id);
            let is_state = self.roles.of(id) == Some(Role::State);
            if !is_state {
                nexts.push(format!("next {kept} = {value}"));
                continue;
            }
            let reads = self.read_by(&math);
            let own_size = if let Kind::Species { compartment, .. } = &symbol.kind { Some(compartment.as_str()) } else { None };
            let amount = self.roles.amounts.contains(id);
            let mixed = targets.iter().any(|t| *t != id && (reads.iter().any(|r| r == t) || amount && own_size == Some(t)));
            if mixed {
                let aside = self.names.fresh(&format!("{kept}_at_{name}"));
                let unit = if amount { units::text(&self.substance(&symbol)) } else { self.unit(&symbol) };
                let line = self.declaration(&aside, &unit, "0", "set aside by the event");
                self.line(&format!("discrete {line}"));
                nexts.push(format!("next {aside} = {value}"));
                resets.push(format!("reset {kept} = {aside}"));
            } else {
                resets.push(format!("reset {kept} = {value}"));
            }
        }
        nexts.extend(resets);
        Ok(nexts)
    }

    /// What an expression reads, named expressions gone through.
    pub(super) fn read_by(&self, math: &Math) -> Vec<String> {
        let mut found: Vec<String> = vec![];
        let mut stack = math.names();
        while let Some(id) = stack.pop() {
            if found.contains(&id) {
                continue;
            }
            let rule = self.sbml.rules.iter().find(|r| matches!(&r.target, Target::Assignment(own) if *own == id));
            stack.extend(rule.map(|r| r.math.names()).unwrap_or_default());
            stack.extend(self.sbml.reactions.iter().find(|r| r.id == id).map(|r| r.rate.names()).unwrap_or_default());
            if let Some(Symbol { kind: Kind::Species { compartment, .. }, .. }) = self.symbol(&id)
                && self.roles.amounts.contains(&id)
            {
                stack.push(compartment.clone());
            }
            found.push(id);
        }
        found
    }

    pub(super) fn constraints(&mut self) -> Result<(), Fault> {
        for (number, (place, math)) in self.sbml.constraints.iter().enumerate() {
            if !math.is_condition() {
                return Err(at(*place, "a constraint that is no condition"));
            }
            let text = self.text(*place, &self.checked(*place, math)?)?;
            let name = self.names.fresh(&format!("constraint_{}", number + 1));
            self.line(&format!("constraint {name} when not ({text})"));
        }
        Ok(())
    }
}
