//! The set of phases and the variables of the schedule.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::{Phase, Statement, StatementKind};

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{Schedule, ScopeId, Set, Symbol, SymbolKind};
use crate::ir::Role;
use crate::model::Variable;

impl<'a> Declaring<'_, 'a> {
    /// Declares the set of phases and the variables of the schedule.
    pub(in crate::elaborate) fn declare_phases(&mut self, scope: ScopeId, list: &[Item<'a>]) {
        let phases: Vec<&'a Phase> = list
            .iter()
            .filter_map(|item| match item {
                Item::Other(Statement { kind: StatementKind::Phase(phase), .. }) => Some(phase),
                _ => None,
            })
            .collect();
        let Some(first) = phases.first() else { return };
        if self.symbols.schedule.is_some() {
            self.work.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, "a model has one schedule of phases", first.name.span));
            return;
        }
        if let Some(phase) = phases.iter().find(|p| p.name.text == "phase") {
            let text = "a phase cannot be called `phase`: that is the phase in force";
            self.work.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, phase.name.span).help("give the phase another name"));
            // `x[phase]` would be an element and all of them at once.
            self.symbols.declare("phase", Symbol { path: "phase".to_owned(), scope, span: phase.name.span, kind: SymbolKind::Faulty }).ok();
            return;
        }
        let labels: Vec<String> = phases.iter().map(|p| p.name.text.clone()).collect();
        for (i, phase) in phases.iter().enumerate() {
            if labels[..i].contains(&phase.name.text) {
                let text = format!("two phases are called `{}`", phase.name.text);
                self.work.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, phase.name.span));
            }
        }
        let set = self.symbols.sets.push(Set::new("phase".to_owned(), labels, None));
        let mut variable =
            |name: &str| self.symbols.vars.push(Variable { name: name.to_owned(), role: Role::Discrete, len: 1, span: first.name.span });
        let (current, since, leaving) = (variable("phase"), variable("phase_start"), variable("phase_left"));
        let symbol = Symbol { path: "phase".to_owned(), scope, span: first.name.span, kind: SymbolKind::Phase(set) };
        if self.symbols.declare("phase", symbol).is_err() {
            let text = "`phase` is the name of the phase in force and cannot be declared";
            self.work.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, first.name.span));
        }
        self.work.ledger.check_reachable(&phases);
        self.symbols.schedule = Some(Schedule { current, since, leaving, scope, phases });
    }
}

impl Ledger {
    /// Every phase but the first must follow another one, and every follower must exist.
    fn check_reachable(&mut self, phases: &[&Phase]) {
        let names: Vec<&str> = phases.iter().map(|p| p.name.text.as_str()).collect();
        for (i, phase) in phases.iter().enumerate() {
            let follows = phases.iter().any(|p| p.next.as_ref().is_some_and(|n| n.text == phase.name.text));
            if i > 0 && !follows {
                let text = format!("no phase leads to `{}`", phase.name.text);
                let d = Diagnostic::error(codes::UNREACHABLE_PHASE, text, phase.name.span);
                self.report(d.help(format!("let another one end `then {}`", phase.name.text)));
            }
            let Some(next) = &phase.next else { continue };
            if !names.contains(&next.text.as_str()) {
                let help = did_you_mean(&next.text, names.iter().copied());
                let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("no phase is called `{}`", next.text), next.span);
                self.report(d.maybe_help(help));
            }
            if phase.duration.is_none() && phase.until.is_none() {
                let text = format!("`{}` has a phase after it, but no end", phase.name.text);
                let d = Diagnostic::error(codes::MISSING_CLAUSE, text, phase.name.span);
                self.report(d.help("write `for 60 [min]` or `until condition`"));
            }
        }
    }
}
