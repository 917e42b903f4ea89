//! Initial values: numbers, amounts for concentrations and the other way round, what follows from
//! what else is known at the start.

use std::collections::HashMap;

use super::convert::{Conversion, LITERAL, at};
use super::document::{Symbol, SymbolRole, Target};
use super::math::Math;
use super::roles::Role;
use super::units::{self, Product};
use super::writer::shown;
use super::xml::Fault;

/// Symbols that follow from one another.
const DEEPEST: usize = 60;

/// Steps of following them in one model: what follows from two others at each level doubles.
const MOST_STEPS: u32 = 1_000_000;

impl Conversion<'_> {
    /// Counts a step; whether there may be more.
    fn goes_on(&self) -> bool {
        self.steps.set(self.steps.get() + 1);
        self.steps.get() <= MOST_STEPS
    }

    /// The initial value of a symbol, or of its amount where that is what is kept; whether it is a
    /// mere number.
    pub(super) fn start(&self, symbol: &Symbol) -> Result<Option<(String, bool)>, Fault> {
        let as_amount = self.roles.amounts.contains(&symbol.id);
        let (amount_meant, starts_as_amount) = match &symbol.kind {
            SymbolRole::Species { amount, starts_as_amount, .. } => (*amount || as_amount, *starts_as_amount),
            _ => (false, false),
        };
        if let Some(math) = self.first.values.get(&symbol.id).filter(|_| self.set_at_the_start(&symbol.id)) {
            let Some(size) = self.size_after_first_events(symbol)?.filter(|_| self.is_divided(symbol)) else {
                return Ok(Some((self.text(symbol.at, math)?, matches!(math, Math::Number(_, None)))));
            };
            return Ok(Some((format!("{}*{size}", self.factor(symbol.at, math)?), false)));
        }
        let size = self.size_at_the_start(symbol)?;
        let is_species = matches!(symbol.kind, SymbolRole::Species { .. });
        if let Some(math) = self.sbml.initial.get(&symbol.id) {
            let math = self.at_the_start(symbol.at, &self.checked(symbol.at, math)?, 0)?;
            if let Some(size) = self.is_divided(symbol).then(|| size.unwrap_or_else(|| "1".into())) {
                return Ok(Some((format!("{}*{size}", self.factor(symbol.at, &math)?), false)));
            }
            let plain = matches!(math, Math::Number(_, None));
            return Ok(Some((self.text(symbol.at, &math)?, plain)));
        }
        let Some(value) = symbol.value else { return Ok(None) };
        let unit = |product: &Product| if self.bare || product.is_empty() { String::new() } else { format!(" [{}]", units::text(product)) };
        match size.filter(|_| is_species && amount_meant != starts_as_amount && value != 0.0) {
            Some(size) if starts_as_amount => Ok(Some((format!("{}{}/{size}", shown(value), unit(&self.substance(symbol))), false))),
            Some(size) => {
                let compartment = if let SymbolRole::Species { compartment, .. } = &symbol.kind { self.symbol(compartment) } else { None };
                let own = compartment.and_then(|c| self.size_unit(c));
                let concentration = units::times(&self.substance(symbol), &self.product_of(own.as_deref()), -1.0);
                Ok(Some((format!("{}{}*{size}", shown(value), unit(&concentration)), false)))
            }
            None => Ok(Some((shown(value), true))),
        }
    }

    /// Returns true for a symbol that an event at the start sets.
    fn set_at_the_start(&self, id: &str) -> bool {
        self.first.ran.keys().any(|event| self.sbml.events[*event].targets().any(|target| target == id))
    }

    /// The size of a species' compartment after the events at the start.
    fn size_after_first_events(&self, symbol: &Symbol) -> Result<Option<String>, Fault> {
        let SymbolRole::Species { compartment, .. } = &symbol.kind else { return Ok(None) };
        match self.first.values.get(compartment) {
            Some(size) => self.factor(symbol.at, size).map(Some),
            None => self.size_at_the_start(symbol),
        }
    }

    /// The size of a species' compartment as initial values may read it.
    pub(super) fn size_at_the_start(&self, symbol: &Symbol) -> Result<Option<String>, Fault> {
        match &symbol.kind {
            SymbolRole::Species { compartment, .. } if self.compartment_name(symbol).is_some() => {
                let size = self.at_the_start(symbol.at, &Math::Name(compartment.clone()), 0)?;
                self.factor(symbol.at, &size).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// An expression as initial values may read it: time is 0; discrete variables get their values
    /// after the states, so what they start from stands for them.
    pub(super) fn at_the_start(&self, place: usize, math: &Math, depth: usize) -> Result<Math, Fault> {
        self.at_the_start_after(place, math, &HashMap::new(), depth)
    }

    /// The same where some symbols have been given other values.
    pub(super) fn at_the_start_after(&self, place: usize, math: &Math, now: &HashMap<String, Math>, depth: usize) -> Result<Math, Fault> {
        if depth > DEEPEST || !self.goes_on() {
            return Err(at(place, "initial values that follow from one another without end"));
        }
        let moves = |id: &str| self.roles.of(id) == Some(Role::Discrete) || self.first.before && self.targets.contains(id);
        let late = |id: &str| self.read_by(&Math::Name(id.to_owned())).iter().any(|id| moves(id.as_str()));
        let changed = math.past(&Math::Number(0.0, None)).map(&mut |part| {
            let id = match &part {
                Math::Time => return Ok(Math::Number(0.0, None)),
                Math::RateOf(id) => {
                    let rule = self.sbml.rules.iter().find(|r| matches!(&r.target, Target::Rate(own) if own == id));
                    return match rule.filter(|rule| self.first.before && !rule.math.has_rates()) {
                        Some(rule) => {
                            let math = self.at_the_start_after(place, &rule.math, now, depth + 1);
                            math.map_err(|fault| fault.message)
                        }
                        None => Ok(part),
                    };
                }
                Math::Name(id) => id,
                _ => return Ok(part),
            };
            if let Some(value) = now.get(id) {
                return Ok(value.clone());
            }
            if !late(id) {
                return Ok(part);
            }
            let below = |math: &Math, now: &HashMap<String, Math>| {
                let checked = self.checked(place, math).and_then(|math| self.at_the_start_after(place, &math, now, depth + 1));
                checked.map_err(|fault| fault.message)
            };
            let rule = self.sbml.rules.iter().find(|r| matches!(&r.target, Target::Assignment(own) if own == id)).map(|r| &r.math);
            let rate = self.sbml.reactions.iter().find(|r| r.id == *id).map(|r| &r.rate);
            if let Some(math) = rule.or(rate) {
                return below(math, now);
            }
            let below = |math: &Math| below(math, &HashMap::new());
            if let Some(math) = self.sbml.initial.get(id) {
                return below(math);
            }
            let symbol = self.symbol(id).ok_or_else(|| format!("unknown symbol `{id}`"))?;
            let value = symbol.value.ok_or_else(|| format!("`{id}` has no value"))?;
            let literal = |value: f64, unit: String| Math::Number(value, Some(format!("{LITERAL}{unit}")));
            let SymbolRole::Species { compartment, amount, starts_as_amount, .. } = &symbol.kind else {
                return Ok(literal(value, self.unit(symbol)));
            };
            if amount == starts_as_amount || self.compartment_name(symbol).is_none() {
                return Ok(literal(value, self.unit(symbol)));
            }
            let size = below(&Math::Name(compartment.clone()))?;
            if *starts_as_amount {
                return Ok(Math::Apply("/", vec![literal(value, units::text(&self.substance(symbol))), size]));
            }
            let own = self.symbol(compartment).and_then(|c| self.size_unit(c));
            let unit = units::text(&units::times(&self.substance(symbol), &self.product_of(own.as_deref()), -1.0));
            Ok(Math::Apply("*", vec![literal(value, unit), size]))
        });
        changed.map_err(|why| at(place, why))
    }

    /// Magnitude of a state for tolerances: its start, or the smallest start of the others where it
    /// starts from zero.
    pub(super) fn magnitude(&self, symbol: &Symbol) -> Option<f64> {
        let own = |s: &Symbol| {
            let id = s.id.clone();
            let value = self.start_value(&id, 0)?;
            let size = self.size_at_start(s);
            let x = (if self.is_divided(s) { value * size? } else { value }).abs();
            (x > 0.0 && x.is_finite()).then_some(x)
        };
        let kind = std::mem::discriminant(&symbol.kind);
        let others = || {
            let known = self.smallest.borrow().get(&kind).copied();
            known.unwrap_or_else(|| {
                let alike = self.sbml.symbols.iter().filter(|s| std::mem::discriminant(&s.kind) == kind);
                let found = alike.filter(|s| self.roles.of(&s.id) == Some(Role::State)).filter_map(own).min_by(f64::total_cmp);
                self.smallest.borrow_mut().insert(kind, found);
                found
            })
        };
        own(symbol).or_else(others).map(|x| 10_f64.powf(x.log10().floor()))
    }

    pub(super) fn size_at_start(&self, symbol: &Symbol) -> Option<f64> {
        match &symbol.kind {
            SymbolRole::Species { compartment, .. } => self.start_value(compartment, 0),
            _ => Some(1.0),
        }
    }

    /// The number that a symbol has at the start, where it can be determined.
    pub(super) fn start_value(&self, id: &str, depth: usize) -> Option<f64> {
        if depth > DEEPEST || !self.goes_on() {
            return None;
        }
        if let Some(math) = self.lookup.value(id) {
            return math.value(&mut |name| self.start_value(name, depth + 1));
        }
        let symbol = self.symbol(id)?;
        if self.roles.of(id) == Some(Role::Variable) {
            return None;
        }
        let value = symbol.value?;
        match &symbol.kind {
            SymbolRole::Species { compartment, amount, starts_as_amount, .. } if amount != starts_as_amount => {
                let size = if self.compartment_name(symbol).is_some() { self.start_value(compartment, depth + 1)? } else { 1.0 };
                Some(if *amount { value * size } else { value / size })
            }
            _ => Some(value),
        }
    }
}
