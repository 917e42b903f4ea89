//! Active variants and chosen options.

use std::collections::HashSet;

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes, did_you_mean};
use smpl_dsl::syntax::{Expr, ExprKind, File, Ident, Statement, StatementKind};

use crate::elaborate::options::{Options, Setting};
use crate::elaborate::reports::scenario_fault;
use crate::elaborate::select::items::Selection;
use crate::model::{Alternatives, Choice, Variant};

/// Choices of a model.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Choices<'a> {
    /// Variants, by name, with those that they extend.
    switches: Vec<(&'a str, Option<&'a Ident>)>,
    /// Choices with their options.
    choices: Vec<(&'a str, &'a [Ident])>,
}

/// Chosen options.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Chosen {
    /// Options and variants.
    pub selection: Selection,
    /// Settings that were choices.
    pub settings: Vec<String>,
    /// Invalid choices.
    pub faults: Faults,
}

impl<'a> Choices<'a> {
    /// The variants and choices of all files.
    pub(in crate::elaborate) fn of(files: &'a [File]) -> Choices<'a> {
        let mut out = Choices::default();
        files.iter().for_each(|file| out.collect(&file.statements));
        out
    }

    fn collect(&mut self, statements: &'a [Statement]) {
        for statement in statements {
            match &statement.kind {
                StatementKind::Variant { name, extends, body, .. } => {
                    match self.switches.iter_mut().find(|(known, _)| *known == name.text) {
                        Some((_, base)) => *base = base.or(extends.as_ref()),
                        None => self.switches.push((&name.text, extends.as_ref())),
                    }
                    self.collect(body);
                }
                StatementKind::Choice { name, options, .. } if self.options(&name.text).is_none() => {
                    self.choices.push((&name.text, options));
                }
                StatementKind::When { body, .. } | StatementKind::Component { body, .. } => self.collect(body),
                _ => {}
            }
        }
    }

    fn is_switch(&self, name: &str) -> bool {
        self.switches.iter().any(|(known, _)| *known == name)
    }

    fn options(&self, choice: &str) -> Option<&'a [Ident]> {
        self.choices.iter().find(|(name, _)| *name == choice).map(|(_, options)| *options)
    }

    /// Selections of the options, with their public data (the levels of observation are not known
    /// here); unknown names are faults.
    pub(in crate::elaborate) fn select(&self, files: &[File], options: &Options) -> (Chosen, Alternatives) {
        let mut faults = Faults::default();
        let switches = structural_switches(files);
        files.iter().for_each(|file| self.check_whens(&file.statements, (&switches, false), &mut faults));
        self.check_bases(&mut faults);
        let mut chosen = self.choose(options);
        self.turn_on_bases(&mut chosen.selection);
        faults.append(std::mem::take(&mut chosen.faults));
        chosen.faults = faults;
        let (variants, choices) = (self.shown_variants(&chosen.selection), self.shown_choices(&chosen.selection));
        let shown = Alternatives { variants, choices, ..Alternatives::default() };
        (chosen, shown)
    }

    /// Faults of variants that extend unknown ones or themselves.
    fn check_bases(&self, faults: &mut Faults) {
        for (name, base) in &self.switches {
            let Some(base) = base else { continue };
            if !self.is_switch(&base.text) {
                let message = format!("unknown variant `{}`", base.text);
                let near = did_you_mean(&base.text, self.switches.iter().map(|(name, _)| *name));
                faults.push(Diagnostic::error(codes::UNKNOWN_NAME, message, base.span).maybe_help(near));
            } else if self.bases(name).any(|base| base == *name) {
                let message = format!("the variant `{name}` extends itself");
                faults.push(Diagnostic::error(codes::CYCLIC_DEFINITION, message, base.span));
            }
        }
    }

    /// The variants that one extends, the nearest first.
    fn bases(&self, name: &str) -> impl Iterator<Item = &'a str> + '_ {
        let base = |name: &str| self.switches.iter().find(|(known, _)| *known == name)?.1.map(|base| base.text.as_str());
        std::iter::successors(base(name), move |name| base(name)).take(self.switches.len())
    }

    /// A variant that is on puts those in force that it extends.
    fn turn_on_bases(&self, selection: &mut Selection) {
        let on: Vec<&str> = self.switches.iter().map(|(name, _)| *name).filter(|name| selection.holds(name, "true")).collect();
        for base in on.into_iter().flat_map(|name| self.bases(name)) {
            if self.is_switch(base) {
                selection.chosen.insert(base.to_owned(), "true".to_owned());
            }
        }
    }

    fn shown_variants(&self, selection: &Selection) -> Vec<Variant> {
        let is_on = |name: &str| selection.chosen.get(name).is_some_and(|v| v == "true");
        self.switches.iter().map(|(name, _)| Variant { name: (*name).to_owned(), on: is_on(name) }).collect()
    }

    fn shown_choices(&self, selection: &Selection) -> Vec<Choice> {
        let shown = |(name, options): &(&str, &[Ident])| {
            let labels: Vec<String> = options.iter().map(|o| o.text.clone()).collect();
            let at = selection.chosen.get(*name).and_then(|c| labels.iter().position(|l| l == c)).unwrap_or(0);
            Choice { name: (*name).to_owned(), options: labels, at: at as u32 }
        };
        self.choices.iter().map(shown).collect()
    }

    /// Selections of the options; by default the first option of a choice.
    fn choose(&self, options: &Options) -> Chosen {
        let mut out = Chosen::default();
        for (name, options) in &self.choices {
            if let Some(first) = options.first() {
                out.selection.chosen.insert((*name).to_owned(), first.text.clone());
            }
        }
        let mut asked: Vec<(String, String)> = options.variants.clone();
        for (name, value) in &options.settings {
            if self.options(name).is_some() || self.is_switch(name) {
                out.settings.push(name.clone());
                asked.push((name.clone(), label(value)));
            }
        }
        for (name, option) in asked {
            match self.check(&name, &option) {
                Ok(()) => {
                    out.selection.chosen.insert(name, option);
                }
                Err(fault) => out.faults.push(fault),
            }
        }
        out
    }

    /// Returns `true` if something can be chosen so.
    fn check(&self, name: &str, option: &str) -> Result<(), Diagnostic> {
        if let Some(options) = self.options(name) {
            if options.iter().any(|o| o.text == option) {
                return Ok(());
            }
            let known: Vec<&str> = options.iter().map(|o| o.text.as_str()).collect();
            return Err(scenario_fault(name, format!("`{name}` cannot be `{option}`; it is one of {}", known.join(", ")), None));
        }
        if self.is_switch(name) {
            let message = || format!("the variant `{name}` is a switch: it takes true or false, not `{option}`");
            return if matches!(option, "true" | "false") { Ok(()) } else { Err(scenario_fault(name, message(), None)) };
        }
        let known: Vec<&str> = self.names().collect();
        let list = if known.is_empty() { "the model has none".to_owned() } else { format!("the model has {}", known.join(", ")) };
        Err(scenario_fault(name, format!("unknown variant `{name}`: {list}"), did_you_mean(name, known)))
    }

    fn names(&self) -> impl Iterator<Item = &'a str> + '_ {
        self.switches.iter().map(|(name, _)| *name).chain(self.choices.iter().map(|(name, _)| *name))
    }

    /// The `when` blocks that no choice, and inside of a component no switch of it, can fulfil.
    fn check_whens(&self, statements: &[Statement], (switches, inside): (&HashSet<&str>, bool), faults: &mut Faults) {
        for statement in statements {
            match &statement.kind {
                StatementKind::When { choice, option, body } => {
                    let own = inside && switches.contains(choice.text.as_str()) && matches!(option.text.as_str(), "true" | "false");
                    if !own {
                        self.check_when(choice, option, faults);
                    }
                    self.check_whens(body, (switches, inside), faults);
                }
                StatementKind::Variant { body, .. } => self.check_whens(body, (switches, inside), faults),
                StatementKind::Component { body, .. } => self.check_whens(body, (switches, true), faults),
                _ => {}
            }
        }
    }

    fn check_when(&self, choice: &Ident, option: &Ident, faults: &mut Faults) {
        match self.options(&choice.text) {
            Some(options) if options.iter().any(|o| o.text == option.text) => {}
            Some(options) => faults.push_with(|| {
                let list: Vec<&str> = options.iter().map(|o| o.text.as_str()).collect();
                let message = format!("`{}` has no option `{}`: {}", choice.text, option.text, list.join(", "));
                Diagnostic::error(codes::UNKNOWN_NAME, message, option.span).maybe_help(did_you_mean(&option.text, list))
            }),
            None if self.is_switch(&choice.text) && matches!(option.text.as_str(), "true" | "false") => {}
            None => faults.push_with(|| {
                let known = self.choices.iter().map(|(name, _)| *name).chain(self.switches.iter().map(|(name, _)| *name));
                let message = format!("unknown choice `{}`", choice.text);
                Diagnostic::error(codes::UNKNOWN_NAME, message, choice.span).maybe_help(did_you_mean(&choice.text, known))
            }),
        }
    }
}

/// Names of the structural parameters of components that are switches.
pub(in crate::elaborate) fn structural_switches(files: &[File]) -> HashSet<&str> {
    let parameters = files.iter().flat_map(|file| &file.statements).filter_map(|statement| match &statement.kind {
        StatementKind::Component { parameters, .. } => Some(parameters),
        _ => None,
    });
    let is_switch = |value: &Option<Expr>| matches!(value, Some(Expr { kind: ExprKind::Bool(_), .. }));
    parameters.flatten().filter(|(_, value)| is_switch(value)).map(|(name, _)| name.text.as_str()).collect()
}

/// A setting as the name of an option.
fn label(value: &Setting) -> String {
    match value {
        Setting::Text(text) => text.clone(),
        Setting::Number(x) => x.to_string(),
        Setting::List(list) => format!("{list:?}"),
    }
}
