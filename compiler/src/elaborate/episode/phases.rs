//! Phases of a schedule.
//!
//! The phases of a model are a set named `phase`, numbered from 1 in the order of the text; the first is in force at the start. The name
//! `phase` by itself is the one in force: it is compared with a phase (`phase == elute`) and used as an index (`Q[phase]`).
//! `phase_time` is the time since the phase began.
//!
//! A schedule becomes three discrete variables (the phase, the time of its beginning, and the phase being left while a
//! transition runs), one root function a phase, and one program that all transitions share: first what the phase says for its end, then the
//! next phase. A duration is a root linear in time, so that the integration stops exactly there. A condition that holds when a step starts
//! (a request) ends the phase before the integration.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Ident, Phase, Statement, StatementKind};

use crate::elaborate::declare::symbols::{ScopeId, Set, Symbol, SymbolId, SymbolKind, Symbols};
use crate::elaborate::episode::store;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::select::items::Item;
use crate::elaborate::{Elaborator, Place, Site};
use crate::ir::{Affine, Compare, ExprId, Exprs, Flavour, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Quantity, Root, RootAction, Variable};

/// The schedule of a model.
#[derive(Clone, Debug)]
pub(in crate::elaborate) struct Schedule<'a> {
    /// Number of the phase in force.
    current: VarId,
    /// When it began.
    since: VarId,
    /// Number of the phase being left, 0 outside a transition.
    leaving: VarId,
    scope: ScopeId,
    phases: Vec<&'a Phase>,
}

impl<'a> Elaborator<'a> {
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
        if self.episode.schedule.is_some() {
            self.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, "a model has one schedule of phases", first.name.span));
            return;
        }
        if let Some(phase) = phases.iter().find(|p| p.name.text == "phase") {
            let text = "a phase cannot be called `phase`: that is the phase in force";
            self.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, phase.name.span).help("give the phase another name"));
            // `x[phase]` would be an element and all of them at once.
            self.symbols.declare("phase", Symbol { path: "phase".to_owned(), scope, span: phase.name.span, kind: SymbolKind::Faulty }).ok();
            return;
        }
        let labels: Vec<String> = phases.iter().map(|p| p.name.text.clone()).collect();
        for (i, phase) in phases.iter().enumerate() {
            if labels[..i].contains(&phase.name.text) {
                let text = format!("two phases are called `{}`", phase.name.text);
                self.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, phase.name.span));
            }
        }
        let set = self.symbols.sets.push(Set::new("phase".to_owned(), labels, None));
        let mut variable =
            |name: &str| self.symbols.vars.push(Variable { name: name.to_owned(), role: Role::Discrete, len: 1, span: first.name.span });
        let (current, since, leaving) = (variable("phase"), variable("phase_start"), variable("phase_left"));
        let symbol = Symbol { path: "phase".to_owned(), scope, span: first.name.span, kind: SymbolKind::Phase(set) };
        if self.symbols.declare("phase", symbol).is_err() {
            let text = "`phase` is the name of the phase in force and cannot be declared";
            self.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, text, first.name.span));
        }
        self.ledger.check_reachable(&phases);
        self.episode.schedule = Some(Schedule { current, since, leaving, scope, phases });
    }

    /// Discrete variables of the schedule with their initial values.
    pub(in crate::elaborate) fn schedule_initial(&mut self) -> Vec<crate::ir::Store> {
        let Some(schedule) = self.episode.schedule.clone() else { return Vec::new() };
        let values = [(schedule.current, 1.0), (schedule.since, 0.0), (schedule.leaving, 0.0)];
        values
            .into_iter()
            .map(|(var, x)| {
                let value = self.exprs.constant(x);
                store(Memory::Var(var), Affine::default(), value)
            })
            .collect()
    }

    /// Names of the phases in their order.
    pub(in crate::elaborate) fn schedule_phases(&self) -> Vec<String> {
        self.episode.schedule.iter().flat_map(|s| &s.phases).map(|p| p.name.text.clone()).collect()
    }

    /// What the outside sees of the schedule.
    pub(in crate::elaborate) fn schedule_quantities(&self) -> Vec<Quantity> {
        let Some(schedule) = &self.episode.schedule else { return Vec::new() };
        let quantity = |var, name: &str, unit: String, text: &str, high: f64, default: f64| Quantity {
            var: Some(var),
            name: name.to_owned(),
            axes: Vec::new(),
            pattern: None,
            unit,
            text: text.to_owned(),
            low: vec![default],
            high: vec![high],
            default: vec![default],
            scale: vec![1.0],
            affine_unit: false,
            structural: false,
        };
        let names: Vec<&str> = schedule.phases.iter().map(|p| p.name.text.as_str()).collect();
        vec![
            quantity(schedule.current, "phase", "1".to_owned(), &names.join(", "), names.len() as f64, 1.0),
            quantity(schedule.since, "phase_start", self.symbols.time_unit.to_string(), "when the phase began", f64::INFINITY, 0.0),
        ]
    }

    /// `phase` as a number, `phase_time` as a time; `None` for other names.
    pub(in crate::elaborate) fn schedule_name(&mut self, name: &Ident) -> Option<Value> {
        let schedule = self.episode.schedule.clone()?;
        match name.text.as_str() {
            "phase" => Some(Value::bare(self.values().discrete(schedule.current))),
            "phase_time" => {
                let (t, since) = (self.exprs.time(), self.values().discrete(schedule.since));
                let expr = self.exprs.sub(t, since);
                Some(Value::of(expr, self.symbols.time_unit.clone()))
            }
            _ => None,
        }
    }

    /// `phase == elute`: outer `None` where neither side is `phase`.
    pub(in crate::elaborate) fn phase_comparison(&mut self, a: &Expr, b: &Expr, place: &Place) -> Option<Value> {
        let schedule = self.episode.schedule.clone()?;
        let is_phase = |s: &Self, e: &Expr| {
            matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
                && s.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(s.symbols[id].kind, SymbolKind::Phase(_))))
        };
        let other = match (is_phase(self, a), is_phase(self, b)) {
            (true, false) => b,
            (false, true) => a,
            _ => return None,
        };
        let ExprKind::Name(name) = &other.kind else { return None };
        let Some(at) = schedule.phases.iter().position(|p| p.name.text == name.text) else {
            if self.symbols.lookup(place.scope, &name.text).is_some() {
                return None;
            }
            let known = schedule.phases.iter().map(|p| p.name.text.as_str());
            let help = did_you_mean(&name.text, known);
            let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("no phase is called `{}`", name.text), name.span);
            return Some(self.fault(d.maybe_help(help)));
        };
        let (current, number) = (self.values().discrete(schedule.current), self.exprs.constant(at as f64 + 1.0));
        let expr = self.exprs.compare(Compare::Eq, current, number);
        Some(Value::truth(expr))
    }

    /// Whether one of the indices is the phase in force; then the value is chosen among those of all phases.
    pub(in crate::elaborate) fn by_phase(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Option<Value> {
        let schedule = self.episode.schedule.clone()?;
        let at = index.iter().position(|e| {
            matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
                && self.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(self.symbols[id].kind, SymbolKind::Phase(_))))
        })?;
        let current = self.values().discrete(schedule.current);
        let mut chosen: Option<Value> = None;
        for (i, phase) in schedule.phases.iter().enumerate().rev() {
            let mut index = index.to_vec();
            index[at] = Expr { span: index[at].span, kind: ExprKind::Name(phase.name.clone()) };
            let value = self.symbol_value(symbol, &index, span, place);
            chosen = Some(match chosen {
                None => value,
                Some(rest) => {
                    let number = self.exprs.constant(i as f64 + 1.0);
                    let here = self.exprs.compare(Compare::Eq, current, number);
                    self.values().choose(here, (value, span), (rest, span), span)
                }
            });
        }
        chosen
    }

    /// Roots, event programs and the part of `at start` that end phases.
    pub(in crate::elaborate) fn schedule_programs(&mut self) {
        let Some(schedule) = self.episode.schedule.clone() else { return };
        let place = Place::new(schedule.scope, Site::Instant);
        let transition = self.transition(&schedule, &place);
        let mut leaving = self.exprs.constant(0.0);
        for (i, phase) in schedule.phases.iter().enumerate().rev() {
            let number = i as f64 + 1.0;
            let (current, own) = (self.values().discrete(schedule.current), self.exprs.constant(number));
            let here = self.exprs.compare(Compare::Eq, current, own);
            if let Some(duration) = &phase.duration {
                let d = self.value(duration, &place);
                let unit = self.symbols.time_unit.clone();
                let d = self.values().strictly_in(d, &unit, duration.span, "a duration", phase.name.span);
                let (t, since) = (self.exprs.time(), self.values().discrete(schedule.since));
                let elapsed = self.exprs.sub(t, since);
                let value = self.exprs.sub(elapsed, d);
                self.phase_root(&schedule, i, here, (value, false), &transition);
            }
            let Some(until) = &phase.until else { continue };
            let holds = self.condition(until, &place);
            let now = self.exprs.and(here, holds);
            leaving = self.exprs.select(now, own, leaving);
            // A comparison of what moves during a step is a root as well; a request made at its start is not.
            if let ExprKind::Binary(BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge, ..) = until.kind
                && let Some((value, strict)) = self.root_of(until, &place)
                && self.symbols.is_dynamic(&self.exprs, value)
            {
                self.phase_root(&schedule, i, here, (value, strict), &transition);
            }
        }
        if self.exprs.as_const(leaving).is_none() {
            let start = &mut self.model.programs.start;
            let stores = vec![store(Memory::Var(schedule.leaving), Affine::default(), leaving)];
            start.nests.push(Nest { extents: Vec::new(), stores });
            start.nests.extend(transition.nests.iter().cloned());
            start.in_place = true;
            self.model.interface.start_resets = true;
        }
    }

    fn phase_root(&mut self, schedule: &Schedule<'a>, i: usize, here: ExprId, (value, strict): (ExprId, bool), transition: &Program) {
        // Outside its phase the condition does not hold: it becomes true anew each time.
        let away = self.exprs.constant(-1.0);
        let value = self.exprs.select(here, value, away);
        let number = self.exprs.constant(i as f64 + 1.0);
        let stores = vec![store(Memory::Var(schedule.leaving), Affine::default(), number)];
        let mut program = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: true };
        program.nests.extend(transition.nests.iter().cloned());
        self.model.programs.events.push(program);
        let action = RootAction::Run(self.model.programs.events.len() as u32 - 1);
        let name = schedule.phases[i].name.text.clone();
        self.model.roots.push(Root { name, value, strict, action });
    }

    /// What runs when a phase is left, for whichever it is.
    fn transition(&mut self, schedule: &Schedule<'a>, place: &Place) -> Program {
        let mut program = Program { nests: Vec::new(), in_place: true };
        let (current, since) = (self.values().discrete(schedule.current), self.values().discrete(schedule.since));
        let leaving = self.values().discrete(schedule.leaving);
        let mut group = Vec::new();
        let (mut next, mut left) = (current, self.exprs.truth(false));
        for (i, phase) in schedule.phases.iter().enumerate() {
            let number = self.exprs.constant(i as f64 + 1.0);
            let is_left = self.exprs.compare(Compare::Eq, leaving, number);
            self.episode.guard = Some(is_left);
            for statement in &phase.body {
                self.instant_statement(place.scope, statement, &mut program, &mut group, &phase.name.text);
            }
            self.episode.guard = None;
            let follower = phase.next.as_ref().and_then(|n| schedule.phases.iter().position(|p| p.name.text == n.text));
            if let Some(to) = follower {
                let to = self.exprs.constant(to as f64 + 1.0);
                next = self.exprs.select(is_left, to, next);
                left = self.exprs.or(left, is_left);
            }
        }
        let t = self.exprs.time();
        let since_value = self.exprs.select(left, t, since);
        let zero = self.exprs.constant(0.0);
        let stores = [(schedule.current, next), (schedule.since, since_value), (schedule.leaving, zero)]
            .map(|(var, value)| store(Memory::Var(var), Affine::default(), value));
        program.nests.push(Nest { extents: Vec::new(), stores: stores.to_vec() });
        program
    }
}

impl Symbols<'_> {
    /// Whether a value changes within a step.
    fn is_dynamic(&self, exprs: &Exprs, e: ExprId) -> bool {
        let mut stack = vec![e];
        let mut seen = std::collections::HashSet::new();
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            match exprs.node(e) {
                crate::ir::Expr::Time => return true,
                crate::ir::Expr::Load { var, flavour: Flavour::Value | Flavour::Derivative, .. }
                    if matches!(self.vars[var].role, Role::State | Role::Algebraic) =>
                {
                    return true;
                }
                _ => stack.extend(exprs.operands(e)),
            }
        }
        false
    }
}

impl Values<'_> {
    fn discrete(&mut self, var: VarId) -> ExprId {
        self.exprs.load(var, Flavour::Value, Affine::default())
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
                let text = format!("`{}` has a phase after it, but nothing that ends it", phase.name.text);
                let d = Diagnostic::error(codes::MISSING_CLAUSE, text, phase.name.span);
                self.report(d.help("write `for 60 [min]` or `until condition`"));
            }
        }
    }
}
