//! Which variants are on and which options are chosen.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Ident, Statement, StatementKind};

use super::super::{Elaborator, Setting};

impl<'a> Elaborator<'a> {
    /// Decides which variants are on and which options are chosen; unknown names are faults.
    pub(in crate::elaborate) fn select_variants(&mut self) {
        let mut switches = Vec::new();
        let mut choices = Vec::new();
        for file in self.files {
            collect_variants(&file.statements, &mut switches, &mut choices);
        }
        for file in self.files {
            self.check_whens(&file.statements, &switches, &choices);
        }
        for (name, options) in &choices {
            if let Some(first) = options.first() {
                self.selection.chosen.insert((*name).to_owned(), first.text.clone());
            }
        }
        let mut asked: Vec<(String, String)> = self.options.variants.clone();
        for (name, value) in &self.options.settings {
            let is_choice = choices.iter().any(|(c, _)| c == name) || switches.iter().any(|s| s == name);
            if is_choice {
                self.used_parameters.insert(name.clone());
                asked.push((
                    name.clone(),
                    match value {
                        Setting::Text(text) => text.clone(),
                        Setting::Number(x) => x.to_string(),
                        Setting::List(list) => format!("{list:?}"),
                    },
                ));
            }
        }
        for (name, option) in asked {
            if let Some((_, options)) = choices.iter().find(|(c, _)| **c == name) {
                if options.iter().any(|o| o.text == option) {
                    self.selection.chosen.insert(name, option);
                } else {
                    let known: Vec<&str> = options.iter().map(|o| o.text.as_str()).collect();
                    self.scenario_fault(format!("`{name}` cannot be `{option}`; it is one of {}", known.join(", ")));
                }
            } else if switches.iter().any(|s| **s == name) {
                match option.as_str() {
                    "true" | "false" => {
                        self.selection.chosen.insert(name, option);
                    }
                    _ => self.scenario_fault(format!("the variant `{name}` is a switch: it takes true or false, not `{option}`")),
                }
            } else {
                let known: Vec<&str> = switches.iter().copied().chain(choices.iter().map(|(c, _)| *c)).collect();
                let hint = did_you_mean(&name, known.iter().copied());
                let list = if known.is_empty() { "the model has none".to_owned() } else { format!("the model has {}", known.join(", ")) };
                self.scenario_fault_with(format!("unknown variant `{name}`: {list}"), hint);
            }
        }
        let chosen = &self.selection.chosen;
        self.model.interface.variants = switches.iter().map(|s| ((*s).to_owned(), chosen.get(*s).is_some_and(|v| v == "true"))).collect();
        self.model.interface.choices = choices
            .iter()
            .map(|(name, options)| {
                let labels: Vec<String> = options.iter().map(|o| o.text.clone()).collect();
                let at = chosen.get(*name).and_then(|c| labels.iter().position(|l| l == c)).unwrap_or(0);
                ((*name).to_owned(), labels, at as u32)
            })
            .collect();
    }

    pub(in crate::elaborate) fn scenario_fault(&mut self, message: String) {
        self.scenario_fault_with(message, None);
    }

    pub(in crate::elaborate) fn scenario_fault_with(&mut self, message: String, help: Option<String>) {
        // Several may share the place (none): they are told apart by their text.
        self.diagnostics.push(Diagnostic::error(codes::BAD_SCENARIO, message, Span::default()).maybe_help(help));
    }
}

fn collect_variants<'a>(statements: &'a [Statement], switches: &mut Vec<&'a str>, choices: &mut Vec<(&'a str, &'a [Ident])>) {
    for statement in statements {
        match &statement.kind {
            StatementKind::Variant { name, body, .. } => {
                if !switches.contains(&name.text.as_str()) {
                    switches.push(&name.text);
                }
                collect_variants(body, switches, choices);
            }
            StatementKind::Choice { name, options, .. } if !choices.iter().any(|(c, _)| *c == name.text) => {
                choices.push((&name.text, options));
            }
            StatementKind::When { body, .. } | StatementKind::Component { body, .. } => collect_variants(body, switches, choices),
            _ => {}
        }
    }
}
