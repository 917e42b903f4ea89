//! Events and constraints.

use super::convert::{Conversion, at, comment};
use super::document::{Event, Symbol, SymbolRole, Target};
use super::math::Math;
use super::order;
use super::roles::Role;
use super::staged::Plan;
use super::trigger::trigger;
use super::xml::Fault;

impl Conversion<'_> {
    pub(super) fn events(&mut self) -> Result<(), Fault> {
        if self.sbml.events.is_empty() {
            return Ok(());
        }
        self.line("\n# events");
        let rivals = order::rivals(self);
        let plans: Vec<Option<Plan>> = (0..rivals.len()).map(|number| self.plan(number, rivals[number].clone())).collect();
        let settling = self.settling(&plans);
        self.declare_tickets(&rivals);
        for (number, event) in self.sbml.events.iter().enumerate() {
            match &plans[number] {
                Some(plan) => self.staged(event, plan, &plans, &settling)?,
                None => self.simple(number, event)?,
            }
        }
        Ok(())
    }

    /// The condition of an event as the language takes it: one comparison.
    pub(super) fn condition(&self, event: &Event, negated: bool) -> Result<String, Fault> {
        let refused = |why: String| at(event.at, format!("the trigger of the event `{}` {why}", event.id));
        let math = self.checked(event.at, &event.trigger)?;
        let made = trigger(&math, negated, &|math| self.steps(math)).map_err(refused)?;
        if made.plain {
            return self.truth(event.at, &math);
        }
        let value = match &made.value {
            Math::Piecewise(..) => self.factor(event.at, &made.value)?,
            value => self.text(event.at, value)?,
        };
        Ok(format!("{value} {} 0", if made.at_zero { ">=" } else { ">" }))
    }

    /// Returns true for an expression that changes at events only.
    fn steps(&self, math: &Math) -> bool {
        let still = |id: &String| !matches!(self.roles.of(id), Some(Role::State | Role::Variable));
        let behind = |id: &String| {
            let rule = self.sbml.rules.iter().find(|r| r.target.id() == Some(id));
            let rate = self.sbml.reactions.iter().find(|r| r.id == *id);
            rule.map(|r| &r.math).into_iter().chain(rate.map(|r| &r.rate)).all(|math| !math.is_timed())
        };
        !math.is_timed() && self.read_by(math).iter().all(|id| still(id) && behind(id))
    }

    /// Declares whether an event has been without its condition, where that is a question: what
    /// holds from the start on has not become true. The name of the variable.
    pub(super) fn armed(&mut self, number: usize, event: &Event, name: &str) -> Result<Option<String>, Fault> {
        let starts = event.trigger.value(&mut |id| self.start_value(id, 0));
        let delayed = self.first.delayed.get(&number).map(|delayed| &delayed.condition);
        let ran = self.first.ran.get(&number).or(delayed).cloned();
        if ran.is_none() && (!event.starts_true || starts == Some(0.0)) {
            return Ok(None);
        }
        let now = self.after(event.at, &event.trigger, &self.first.values)?;
        let before = match ran {
            Some(condition) => condition,
            None => self.after(event.at, &event.trigger, &Default::default())?,
        };
        let both = if now == before || before.names().is_empty() { now } else { Math::Apply("and", vec![before, now]) };
        let armed = self.names.fresh(&format!("{name}_armed"));
        let value = match both.constant() {
            Some(holds) => if holds == 0.0 { "1" } else { "0" }.to_owned(),
            None => format!("if {} then 0 else 1", self.truth(event.at, &both)?),
        };
        self.line("# What holds from the start on has not become true: the event waits until it has ceased to hold.");
        self.line(&format!("discrete {armed} = {value}"));
        Ok(Some(armed))
    }

    /// An event that acts at once.
    fn simple(&mut self, number: usize, event: &Event) -> Result<(), Fault> {
        let name = self.names.of(&event.id);
        let armed = if event.assignments.is_empty() { None } else { self.armed(number, event, &name)? };
        let comment = comment(event);
        let condition = self.condition(event, false)?;
        self.line(&format!("event {name} when {condition}{comment}"));
        let mut lines = vec![];
        for (place, id, math) in &event.assignments {
            let mut value = self.assigned(*place, id, math)?;
            let kept = self.kept(id);
            if let Some(armed) = &armed {
                value = format!("if {armed} > 0.5 then {value} else {kept}");
            }
            lines.push(format!("{} {kept} = {value}", self.keyword(id)));
        }
        lines.sort_by_key(|line| line.starts_with("reset"));
        lines.extend(armed.map(|armed| format!("next {armed} = 1")));
        self.block(&name, &lines);
        Ok(())
    }

    /// The keyword that changes a symbol at an event.
    pub(super) fn keyword(&self, id: &str) -> &'static str {
        if self.roles.of(id) == Some(Role::State) { "reset" } else { "next" }
    }

    /// `at` an event, unless nothing happens there.
    pub(super) fn block(&mut self, name: &str, lines: &[String]) {
        if !lines.is_empty() {
            self.line(&format!("at {name} {{\n{}}}", lines.iter().map(|l| format!("  {l}\n")).collect::<String>()));
        }
    }

    /// The value that an event gives to a symbol, or to its amount.
    pub(super) fn assigned(&self, place: usize, id: &str, math: &Math) -> Result<String, Fault> {
        let math = self.checked(place, math)?;
        match self.own_size(id) {
            Some(size) => Ok(format!("{}*{size}", self.factor(place, &math)?)),
            None => self.text(place, &math),
        }
    }

    /// The size by which a concentration is multiplied to make the amount that is kept.
    pub(super) fn own_size(&self, id: &str) -> Option<String> {
        let symbol = self.symbol(id).filter(|_| self.roles.amounts.contains(id))?;
        self.compartment_name(symbol)
    }

    /// Returns true for an event that sets a symbol from another one that it sets, of which it
    /// takes the value from before.
    pub(super) fn is_mixed(&self, event: &Event) -> bool {
        let reads = |id: &str, math: &Math| {
            let mut reads = self.read_by(math);
            if let Some(Symbol { kind: SymbolRole::Species { compartment, .. }, .. }) = self.symbol(id)
                && self.roles.amounts.contains(id)
            {
                reads.push(compartment.clone());
            }
            reads
        };
        event.assignments.iter().any(|(_, id, math)| {
            let reads = reads(id, math);
            event.targets().any(|target| target != id && reads.iter().any(|read| read == target))
        })
    }

    /// Names that an expression reads, including those of named expressions.
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
            if let Some(Symbol { kind: SymbolRole::Species { compartment, .. }, .. }) = self.symbol(&id)
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
            let text = self.truth(*place, &self.checked(*place, math)?)?;
            let name = self.names.fresh(&format!("constraint_{}", number + 1));
            self.line(&format!("constraint {name} when not ({text})"));
        }
        Ok(())
    }
}
