//! From an SBML model to the text of a model of the language.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::mem::Discriminant;

use super::document::{Event, Rule, Sbml, Symbol, SymbolRole, Target};
use super::initial::First;
use super::lookup::Lookup;
use super::math::{DELAY, Math};
use super::names::Names;
use super::roles::{self, Role, Roles};
use super::tickets::Tickets;
use super::units::{self, Product};
use super::writer::{Writer, shown, sum_of};
use super::xml::Fault;

/// Before the text of a unit that replaces an id.
pub(super) const LITERAL: char = '=';

/// Comment on the file at the head of the text.
pub(super) struct Head<'a> {
    /// Name of the file.
    pub(super) file: &'a str,
    /// Reason why units are in descriptions only; `None` if they are declared.
    pub(super) bare: Option<&'a str>,
}

/// A conversion under way.
pub(super) struct Conversion<'s> {
    pub(super) sbml: &'s Sbml,
    pub(super) lookup: Lookup<'s>,
    pub(super) roles: Roles,
    pub(super) names: Names,
    time: String,
    pub(super) bare: bool,
    /// Steps of following symbols to their starts, which have a limit.
    pub(super) steps: Cell<u32>,
    /// The smallest starts of states that do not start at zero, by kind.
    pub(super) smallest: RefCell<HashMap<Discriminant<SymbolRole>, Option<f64>>>,
    /// Symbols that events set.
    pub(super) targets: HashSet<String>,
    /// The events at the start of a run.
    pub(super) first: First,
    /// The random order of events with one priority.
    pub(super) tickets: Tickets,
    /// Dead times that change.
    pub(super) lags: RefCell<Vec<Math>>,
    out: String,
}

pub(super) fn at(at: usize, message: impl Into<String>) -> Fault {
    Fault { at, message: message.into() }
}

/// The text of the model.
pub(super) fn write(sbml: &Sbml, head: &Head<'_>) -> Result<String, Fault> {
    let roles = roles::find(sbml)?;
    let mut names = Names::default();
    for symbol in &sbml.symbols {
        names.give(&symbol.id);
    }
    sbml.reactions.iter().for_each(|r| names.give(&r.id));
    sbml.events.iter().filter(|e| !e.id.is_empty()).for_each(|e| names.give(&e.id));
    let time = names.fresh("t");
    let targets = sbml.events.iter().flat_map(Event::targets).map(str::to_owned).collect();
    let mut c = Conversion {
        sbml,
        lookup: Lookup::of(sbml),
        roles,
        names,
        time,
        bare: head.bare.is_some(),
        steps: Cell::new(0),
        smallest: RefCell::default(),
        targets,
        first: First::default(),
        tickets: Tickets::default(),
        lags: RefCell::default(),
        out: String::new(),
    };
    c.head(head);
    c.run_first_events();
    c.symbols()?;
    c.rules()?;
    c.reactions()?;
    c.rates()?;
    c.events()?;
    c.constraints()?;
    c.bounds_of_lags()?;
    c.out.push_str("\n# SBML says nothing of how long: choose.\nepisode { step = 1, max_steps = 100 }\n");
    Ok(c.out)
}

/// Returns `true` if all units of the model have symbols in the language; else the first that has
/// none.
pub(super) fn unit_without_symbols(sbml: &Sbml) -> Option<String> {
    let own = sbml.symbols.iter().flat_map(|s| {
        let substance = if let SymbolRole::Species { substance, .. } = &s.kind { substance.clone() } else { None };
        s.unit.clone().into_iter().chain(substance)
    });
    let of_model = [&sbml.substance, &sbml.extent, &sbml.volume, &sbml.area, &sbml.length, &sbml.time];
    let mut ids = own.chain(of_model.into_iter().flatten().cloned());
    ids.find(|id| units::product(sbml, id).is_none())
}

/// A text between quotes.
pub(super) fn quoted(text: &str, most: usize) -> String {
    let clean: String = text.chars().map(|c| if c == '"' { '\'' } else { c }).filter(|c| !c.is_control()).collect();
    if clean.chars().count() <= most { clean } else { clean.chars().take(most - 3).chain("...".chars()).collect() }
}

/// The name of an event as a comment.
pub(super) fn comment(event: &Event) -> String {
    if event.name.is_empty() { String::new() } else { format!("    # {}", quoted(&event.name, 80)) }
}

impl Conversion<'_> {
    pub(super) fn line(&mut self, text: &str) {
        self.out.push_str(text);
        self.out.push('\n');
    }

    fn head(&mut self, head: &Head<'_>) {
        let sbml = self.sbml;
        let stem = std::path::Path::new(head.file).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let wish = if sbml.id.is_empty() { &stem } else { &sbml.id };
        let model = self.names.fresh(wish);
        let title = if sbml.name.is_empty() { &sbml.id } else { &sbml.name };
        let title = if title.is_empty() { String::new() } else { format!(" \"{}\"", quoted(title, 100)) };
        self.line(&format!("model {model}{title}"));
        self.line(&format!("\n# From SBML Level {} Version {}, {}.", sbml.level, sbml.version, quoted(head.file, 100)));
        let notes = quoted(&sbml.notes, 600);
        let mut row = String::from("#");
        for word in notes.split_whitespace() {
            if row.len() + word.len() > 118 {
                self.line(&std::mem::replace(&mut row, String::from("#")));
            }
            let _ = write!(row, " {word}");
        }
        if row.len() > 1 {
            self.line(&row);
        }
        for package in &sbml.packages {
            self.line(&format!("# The package `{}` is not carried: it does not change the equations.", quoted(package, 60)));
        }
        let changed: Vec<String> =
            self.names.changed.iter().map(|(id, name)| format!("{} is {name}", id.replace('.', " of ").trim())).collect();
        let changed: Vec<String> = changed.into_iter().filter(|c| !c.contains(" of ")).collect();
        if !changed.is_empty() {
            self.line(&format!("# Other names than in the file: {}.", changed.join(", ")));
        }
        if let Some(why) = head.bare {
            self.line(&format!("# Units are in descriptions only, and everything is a number: {}", quoted(why, 300)));
        }
        let unit = self.time_unit();
        let shown = if self.bare { "1" } else { unit.as_str() };
        self.out.push('\n');
        let (time, text) = (self.time.clone(), if self.bare && unit != "1" { format!("    # {unit}") } else { String::new() });
        self.line(&format!("time {time} : {shown}{text}"));
    }

    /// The unit of the time.
    pub(super) fn time_unit(&self) -> String {
        self.unit_id(self.usual(&self.sbml.time, "time").as_deref())
    }

    pub(super) fn time_name(&self) -> &str {
        &self.time
    }

    pub(super) fn product_of(&self, id: Option<&str>) -> Product {
        id.and_then(|id| units::product(self.sbml, id)).unwrap_or_default()
    }

    /// The text of a unit; what cannot be written keeps its id.
    pub(super) fn unit_id(&self, id: Option<&str>) -> String {
        match id {
            None => "1".into(),
            Some(id) => units::product(self.sbml, id).map_or_else(|| id.to_owned(), |p| units::text(&p)),
        }
    }

    fn usual(&self, given: &Option<String>, level2: &'static str) -> Option<String> {
        given.clone().or(if self.sbml.level == 2 { Some(level2.to_owned()) } else { None })
    }

    pub(super) fn size_unit(&self, symbol: &Symbol) -> Option<String> {
        let SymbolRole::Compartment { dimensions, .. } = &symbol.kind else { return None };
        symbol.unit.clone().or_else(|| match dimensions {
            3.0 => self.usual(&self.sbml.volume, "volume"),
            2.0 => self.usual(&self.sbml.area, "area"),
            1.0 => self.usual(&self.sbml.length, "length"),
            _ => None,
        })
    }

    pub(super) fn substance(&self, symbol: &Symbol) -> Product {
        let SymbolRole::Species { substance, .. } = &symbol.kind else { return vec![] };
        self.product_of(substance.clone().or_else(|| self.usual(&self.sbml.substance, "substance")).as_deref())
    }

    /// The unit of a symbol as the mathematics mean it.
    pub(super) fn unit(&self, symbol: &Symbol) -> String {
        let product = match &symbol.kind {
            SymbolRole::Parameter | SymbolRole::Stoichiometry => return self.unit_id(symbol.unit.as_deref()),
            SymbolRole::Compartment { .. } => return self.unit_id(self.size_unit(symbol).as_deref()),
            SymbolRole::Species { compartment, amount, .. } => {
                let size = self.symbol(compartment).and_then(|c| self.size_unit(c));
                let size = if *amount { vec![] } else { self.product_of(size.as_deref()) };
                units::times(&self.substance(symbol), &size, -1.0)
            }
        };
        units::text(&product)
    }

    pub(super) fn symbol(&self, id: &str) -> Option<&Symbol> {
        self.lookup.symbol(id)
    }

    /// Name, unit and text of a declaration.
    pub(super) fn declaration(&self, name: &str, unit: &str, value: &str, text: &str) -> String {
        let mut line = name.to_owned();
        if !self.bare && unit != "1" {
            let _ = write!(line, " : {unit}");
        }
        if !value.is_empty() {
            let _ = write!(line, " = {value}");
        }
        let unit = if self.bare && unit != "1" { format!("in {unit}") } else { String::new() };
        let text = quoted(text, 100);
        let text = [text, unit].into_iter().filter(|t| !t.is_empty()).collect::<Vec<_>>().join(", ");
        if !text.is_empty() {
            let _ = write!(line, "    \"{text}\"");
        }
        line
    }

    pub(super) fn text(&self, place: usize, math: &Math) -> Result<String, Fault> {
        self.with_writer(|w| w.text(&math.typed(false))).map_err(|why| at(place, why))
    }

    pub(super) fn factor(&self, place: usize, math: &Math) -> Result<String, Fault> {
        self.with_writer(|w| w.factor(&math.typed(false))).map_err(|why| at(place, why))
    }

    /// The text of a truth value.
    pub(super) fn truth(&self, place: usize, math: &Math) -> Result<String, Fault> {
        self.with_writer(|w| w.text(&math.typed(true))).map_err(|why| at(place, why))
    }

    fn with_writer<T>(&self, work: impl FnOnce(&Writer<'_>) -> T) -> T {
        let text = |id: &str| id.strip_prefix(LITERAL).map_or_else(|| self.unit_id(Some(id)), str::to_owned);
        let units = |id: &str| if self.bare { String::new() } else { Some(text(id)).filter(|u| u != "1").unwrap_or_default() };
        work(&Writer { names: &|id| self.names.of(id), units: &units, time: &self.time })
    }

    /// Rates of symbols that are not states have no name in the language.
    pub(super) fn checked(&self, place: usize, math: &Math) -> Result<Math, Fault> {
        // The rule of a concentration whose amount is the state.
        let rate = |id: &str| {
            let mut rules = self.sbml.rules.iter();
            let rule = rules.find(|r| matches!(&r.target, Target::Rate(own) if own == id));
            rule.map(|rule| &rule.math).filter(|math| !math.has_rates())
        };
        let changed = math.map(&mut |part| match &part {
            Math::RateOf(id) => match self.roles.of(id) {
                Some(Role::Parameter | Role::Discrete) if !self.roles.amounts.contains(id) => Ok(Math::Number(0.0, None)),
                Some(Role::State) if !self.roles.amounts.contains(id) => Ok(part),
                Some(Role::State) if rate(id).is_some() => Ok(rate(id).cloned().unwrap_or(part)),
                _ => Err(format!("`rateOf` of `{id}`, which is not a state")),
            },
            Math::Apply(DELAY, _) => Ok(self.bounded_delay(part)),
            _ => Ok(part),
        });
        changed.map_err(|why| at(place, why))
    }

    pub(super) fn compartment_name(&self, symbol: &Symbol) -> Option<String> {
        match &symbol.kind {
            SymbolRole::Species { compartment, .. } => {
                let kind = self.symbol(compartment).map(|c| &c.kind);
                (!matches!(kind, Some(SymbolRole::Compartment { point: true, .. }))).then(|| self.names.of(compartment))
            }
            _ => None,
        }
    }

    /// The state's own name: that of the amount where the amount is what is kept.
    pub(super) fn kept(&self, id: &str) -> String {
        let name = self.names.of(id);
        if self.roles.amounts.contains(id) { format!("{name}_amount") } else { name }
    }

    fn symbols(&mut self) -> Result<(), Fault> {
        let titles = ["compartments", "species", "parameters", "stoichiometries"];
        let group = |s: &Symbol| match s.kind {
            SymbolRole::Compartment { .. } => 0,
            SymbolRole::Species { .. } => 1,
            SymbolRole::Parameter => 2,
            SymbolRole::Stoichiometry => 3,
        };
        for number in [0, 2, 3, 1] {
            let symbols: Vec<&Symbol> = self.sbml.symbols.iter().filter(|s| group(s) == number).collect();
            let declared: Vec<&Symbol> = symbols.into_iter().filter(|s| self.roles.of(&s.id) != Some(Role::Let)).collect();
            if !declared.is_empty() {
                self.line(&format!("\n# {}", titles[number]));
            }
            for symbol in declared {
                self.symbol_declared(symbol)?;
            }
        }
        Ok(())
    }

    fn symbol_declared(&mut self, symbol: &Symbol) -> Result<(), Fault> {
        let role = self.roles.of(&symbol.id).unwrap_or(Role::Parameter);
        let as_amount = self.roles.amounts.contains(&symbol.id);
        let name = self.kept(&symbol.id);
        let unit = if as_amount { units::text(&self.substance(symbol)) } else { self.unit(symbol) };
        let text = if as_amount {
            format!("amount of {}", if symbol.name.is_empty() { &symbol.id } else { &symbol.name })
        } else {
            symbol.name.clone()
        };
        let start = self.start(symbol)?;
        let missing = || at(symbol.at, format!("`{}` has no value: neither a number nor a rule nor an initial assignment", symbol.id));
        let (value, plain) = match (start, role) {
            (Some(start), _) => start,
            (None, Role::Variable) => (shown(1.0), true),
            (None, _) => return Err(missing()),
        };
        let keyword = match role {
            Role::Parameter | Role::Let => "param",
            Role::State => "state",
            Role::Variable => "var",
            Role::Discrete => "discrete",
        };
        let scale = match role {
            Role::State => self.magnitude(symbol).filter(|m| *m != 1.0).map(|m| format!(" scale {}", shown(m))),
            _ => None,
        };
        let later = role == Role::State && !plain;
        let shown_value = if later { String::from("0") } else { value.clone() };
        let mut line = self.declaration(&name, &unit, &shown_value, "");
        let words = self.declaration("", &unit, "", &text);
        if self.bare
            && let Some(cut) = line.find("    \"")
        {
            line.truncate(cut);
        }
        line.push_str(&scale.unwrap_or_default());
        if let Some(cut) = words.find("    \"") {
            line.push_str(&words[cut..]);
        }
        self.line(&format!("{keyword} {line}"));
        if later {
            self.line(&format!("initial {name} = {value}"));
        }
        if as_amount {
            let amount = self.moved_amount(symbol, name);
            let size = self.size_of_amount(symbol);
            let value = size.map_or_else(|| amount.clone(), |size| format!("{amount}/{size}"));
            let own = self.let_line(&self.names.of(&symbol.id), &self.unit(symbol), &value, &symbol.name);
            self.line(&own);
        }
        Ok(())
    }

    fn let_line(&self, name: &str, unit: &str, value: &str, text: &str) -> String {
        let shown = if self.bare { "1" } else { unit };
        let told = if self.bare && unit != "1" { format!("in {unit}") } else { String::new() };
        let text = [quoted(text, 100), told].into_iter().filter(|t| !t.is_empty()).collect::<Vec<_>>().join(", ");
        let text = if text.is_empty() { text } else { format!("    \"{text}\"") };
        format!("let {name} : {shown} = {value}{text}")
    }

    fn rules(&mut self) -> Result<(), Fault> {
        let assignments: Vec<_> = self.sbml.rules.iter().filter(|r| !matches!(r.target, Target::Rate(_))).collect();
        if !assignments.is_empty() {
            self.line("\n# rules");
        }
        for rule in assignments {
            let math = self.checked(rule.at, &rule.math)?;
            let value = self.text(rule.at, &math)?;
            let line = match &rule.target {
                Target::Assignment(id) => {
                    let symbol = self.symbol(id).ok_or_else(|| at(rule.at, format!("unknown symbol `{id}`")))?;
                    self.let_line(&self.names.of(id), &self.unit(symbol), &value, &symbol.name)
                }
                _ => format!("eq {value} = 0"),
            };
            self.line(&line);
        }
        Ok(())
    }

    pub(super) fn extent(&self) -> Product {
        let extent = self.sbml.extent.clone().or_else(|| self.usual(&self.sbml.substance, "substance"));
        self.product_of(extent.as_deref())
    }

    fn reactions(&mut self) -> Result<(), Fault> {
        if !self.sbml.reactions.is_empty() {
            self.line("\n# rates of the reactions");
        }
        let time = self.product_of(self.usual(&self.sbml.time, "time").as_deref());
        let unit = units::text(&units::times(&self.extent(), &time, -1.0));
        for reaction in &self.sbml.reactions {
            let math = self.checked(reaction.at, &reaction.rate)?;
            let value = self.text(reaction.at, &math)?;
            let side = |sign: f64| {
                let parts = reaction.parts.iter().filter(|p| p.sign == sign).map(|p| match &p.number {
                    Math::Number(1.0, _) => self.names.of(&p.species),
                    Math::Number(x, _) => format!("{} {}", shown(*x), self.names.of(&p.species)),
                    _ => format!("... {}", self.names.of(&p.species)),
                });
                parts.collect::<Vec<_>>().join(" + ")
            };
            let arrow = if reaction.reversible { "<->" } else { "->" };
            let scheme = format!("{} {arrow} {}", side(-1.0), side(1.0)).trim().to_owned();
            let text = if reaction.name.is_empty() { scheme } else { format!("{}: {scheme}", reaction.name) };
            let line = self.let_line(&self.names.of(&reaction.id), &unit, &value, &text);
            self.line(&line);
        }
        self.equilibria()
    }

    /// Rates of states: those of rules, then sums of reactions.
    fn rates(&mut self) -> Result<(), Fault> {
        let states: Vec<&Symbol> = self.sbml.symbols.iter().filter(|s| self.roles.of(&s.id) == Some(Role::State)).collect();
        self.line("\n# balances");
        if states.is_empty() {
            self.line("# A model has a state: here it is the time that has passed.");
            let (name, unit) = (self.names.fresh("elapsed"), self.time_unit());
            let line = self.declaration(&name, &unit, "0", "");
            self.line(&format!("state {line}"));
            self.line(&format!("eq d/dt {name} = 1"));
        }
        for symbol in states {
            let rule = self.sbml.rules.iter().find(|r| matches!(&r.target, Target::Rate(id) if *id == symbol.id));
            let value = match rule {
                Some(rule) => self.rate_of_rule(symbol, rule)?,
                None => self.sum_of_reactions(symbol)?,
            };
            let line = format!("eq d/dt {} = {value}", self.kept(&symbol.id));
            self.line(&line);
        }
        Ok(())
    }

    /// The rate that a rule gives; of an amount, where the rule is that of the concentration.
    fn rate_of_rule(&self, symbol: &Symbol, rule: &Rule) -> Result<String, Fault> {
        let math = self.checked(rule.at, &rule.math)?;
        let (SymbolRole::Species { compartment, .. }, true) = (&symbol.kind, self.roles.amounts.contains(&symbol.id)) else {
            return self.text(rule.at, &math);
        };
        let (size, own) = (self.names.of(compartment), self.names.of(&symbol.id));
        let grows = if self.roles.of(compartment) == Some(Role::State) { format!(" + {own}*der({size})") } else { String::new() };
        Ok(format!("{size}*{}{grows}", self.factor(rule.at, &math)?))
    }

    fn sum_of_reactions(&self, symbol: &Symbol) -> Result<String, Fault> {
        let mut list = Vec::new();
        for reaction in self.sbml.reactions.iter().filter(|reaction| !reaction.fast) {
            for part in reaction.parts.iter().filter(|p| p.species == symbol.id) {
                let rate = self.names.of(&reaction.id);
                let (sign, term) = match &part.number {
                    Math::Number(x, _) if x.abs() == 1.0 => (part.sign * x, rate),
                    Math::Number(x, _) => (part.sign * x, format!("{}*{rate}", shown(x.abs()))),
                    other => (part.sign, format!("{}*{rate}", self.factor(part.at, &self.checked(part.at, other)?)?)),
                };
                list.push((sign < 0.0, term));
            }
        }
        let (terms, sum) = (list.len(), sum_of(&list));
        let SymbolRole::Species { amount, factor, .. } = &symbol.kind else { return Ok("0".into()) };
        let per_size = !*amount && !self.roles.amounts.contains(&symbol.id);
        let size = self.compartment_name(symbol).filter(|_| per_size);
        let factor = factor.as_ref().or(self.sbml.factor.as_ref()).map(|id| self.names.of(id));
        let enclosed = if terms > 1 && (size.is_some() || factor.is_some()) { format!("({sum})") } else { sum };
        let scaled = match (factor, enclosed.strip_prefix('-')) {
            (None, _) => enclosed,
            (Some(factor), Some(rest)) => format!("-{factor}*{rest}"),
            (Some(factor), None) => format!("{factor}*{enclosed}"),
        };
        Ok(match size {
            _ if terms == 0 => "0".into(),
            Some(size) => format!("{scaled}/{size}"),
            None => scaled,
        })
    }
}
