//! Earlier values: what `delay` reads before the start, and dead times that change.
//!
//! Before the start rules hold, initial assignments give the values at their times, and all else is
//! as at the start. `delay` gets that as its third argument.

use std::collections::{HashMap, HashSet};

use super::convert::Conversion;
use super::document::{Sbml, Target};
use super::math::{DELAY, Math};
use super::roles::Role;
use super::xml::Fault;

/// Symbols that follow from one another.
const DEEPEST: usize = 60;

/// Dead times that change lie between these numbers: below the first one the value is the present
/// one, and above the second one the run ends.
const SHORTEST: f64 = 1e-6;
const LONGEST: f64 = 1e6;

fn number(x: f64) -> Math {
    Math::Number(x, None)
}

impl Math {
    /// The expression at another time, which is not later than the start: delayed values are those
    /// before the start.
    pub(super) fn past(&self, time: &Math) -> Math {
        let all = |list: &[Math]| list.iter().map(|part| part.past(time)).collect();
        match self {
            Math::Time => time.clone(),
            Math::Apply(DELAY, parts) => match &parts[..] {
                [value, lag, rest @ ..] => {
                    let earlier = Math::Apply("-", vec![time.clone(), lag.past(time)]);
                    rest.first().unwrap_or(value).past(&earlier)
                }
                _ => self.clone(),
            },
            Math::Apply(f, parts) => Math::Apply(f, all(parts)),
            Math::Call(f, parts) => Math::Call(f.clone(), all(parts)),
            Math::Piecewise(pieces, otherwise) => {
                let pieces = pieces.iter().map(|(value, condition)| (value.past(time), condition.past(time)));
                Math::Piecewise(pieces.collect(), Box::new(otherwise.past(time)))
            }
            other => other.clone(),
        }
    }
}

/// Expressions that give symbols before the start.
pub(super) struct Before {
    gives: HashMap<String, Math>,
    /// Symbols whose initial assignments read a rate.
    rated: HashSet<String>,
}

impl Before {
    /// Those of a model whose functions are put in.
    pub(super) fn of(sbml: &Sbml) -> Self {
        let rated = sbml.initial.iter().filter(|(_, math)| math.has_rates()).map(|(id, _)| id.clone()).collect();
        let mut gives = sbml.initial.clone();
        gives.extend(sbml.reactions.iter().map(|reaction| (reaction.id.clone(), reaction.rate.clone())));
        gives.extend(sbml.rules.iter().filter_map(|rule| match &rule.target {
            Target::Assignment(id) => Some((id.clone(), rule.math.clone())),
            _ => None,
        }));
        Self { gives, rated }
    }

    /// An expression with the values before the start in each of its delays.
    ///
    /// # Errors
    /// In words, for a symbol that has no past.
    pub(super) fn put_in(&self, math: &Math) -> Result<Math, String> {
        math.map(&mut |part| match part {
            Math::Apply(DELAY, mut parts) if parts.len() == 2 => {
                let before = self.before(&parts[0], 0)?.past(&Math::Time);
                parts.push(before);
                Ok(Math::Apply(DELAY, parts))
            }
            part => Ok(part),
        })
    }

    /// Returns true for a symbol that changes before the start.
    fn moves(&self, id: &str) -> bool {
        let (mut stack, mut seen) = (vec![id.to_owned()], vec![]);
        while let Some(id) = stack.pop() {
            if seen.contains(&id) {
                continue;
            }
            let math = self.gives.get(&id);
            if math.is_some_and(Math::is_timed) {
                return true;
            }
            stack.extend(math.map(Math::names).unwrap_or_default());
            seen.push(id);
        }
        false
    }

    /// An expression before the start: what is not given by rules or initial assignments has its
    /// first value.
    fn before(&self, math: &Math, depth: usize) -> Result<Math, String> {
        if depth > DEEPEST {
            return Err("values before the start that follow from one another without end".into());
        }
        math.map(&mut |part| match &part {
            Math::RateOf(_) => Ok(number(0.0)),
            Math::Name(id) if self.rated.contains(id) => {
                Err(format!("a delay of `{id}`, whose initial assignment reads a rate, has no counterpart"))
            }
            Math::Name(id) if self.moves(id) => self.gives.get(id).map_or(Ok(part.clone()), |math| self.before(math, depth + 1)),
            _ => Ok(part),
        })
    }
}

impl Conversion<'_> {
    /// A delay as the language takes it: a dead time that changes is bounded.
    pub(super) fn bounded_delay(&self, delay: Math) -> Math {
        let Math::Apply(_, parts) = &delay else { return delay };
        let [value, lag, before] = &parts[..] else { return delay };
        if !lag.is_timed() && self.read_by(lag).iter().all(|id| self.roles.of(id) == Some(Role::Parameter)) {
            return delay;
        }
        let mut lags = self.lags.borrow_mut();
        if !lags.contains(lag) {
            lags.push(lag.clone());
        }
        let all = |f, parts: [Math; 2]| Math::Apply(f, parts.to_vec());
        let positive = all(">", [lag.clone(), number(SHORTEST)]);
        let either = |value: Math, otherwise: Math| Math::Piecewise(vec![(value, positive.clone())], Box::new(otherwise));
        let bounded = all("min", [all("max", [lag.clone(), number(SHORTEST)]), number(LONGEST)]);
        // A dead time that is not used must not shorten the steps.
        let delayed = Math::Apply(DELAY, vec![value.clone(), either(bounded, number(1.0)), before.clone()]);
        either(delayed, value.clone())
    }

    /// Failures where a dead time that changes leaves its range.
    pub(super) fn bounds_of_lags(&mut self) -> Result<(), Fault> {
        let lags = self.lags.take();
        if !lags.is_empty() {
            self.line(&format!("\n# Dead times that change: one below {SHORTEST} counts as 0."));
        }
        for (k, lag) in lags.iter().enumerate() {
            let name = self.names.fresh(&format!("dead_time_{}", k + 1));
            let text = self.factor(0, lag)?;
            self.line(&format!("fail {name} event max(-{text}, {text} - {LONGEST}) > 0"));
        }
        Ok(())
    }
}
