//! The control problem and what happens at instants.

use smpl_dsl::latex;
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Clip, Control, Expr, ExprKind, Ident, Observation, Phase, Statement, StatementKind};

use super::markdown::{self, code, display, math, prose};
use super::statements::{self, Writer};
use smpl_runtime::failure::Short;

const OBSERVED: &[&str] = &["observed", "unit", "is", "range", "noise", "sampled", "reported", "meaning"];
const PHASES: &[&str] = &["phase", "lasts", "then", "at its end"];
const CONTROLLERS: &[&str] = &["controller sets", "from", "set-point", "gain", "reset time", "limits", "manual", "every", "meaning"];
const SETTINGS: &[&str] = &["setting", "value"];

impl<'s> Writer<'s> {
    /// Statements of the control problem, of the start, and of instants.
    pub(super) fn control(&mut self, statement: &'s Statement) {
        match &statement.kind {
            StatementKind::Initial { target, random, value, clip, binders } => {
                let relation = if *random { "\\sim" } else { "=" };
                let line = format!("{}\\big|_{{t=0}} {relation} {}", latex::expression(target), latex::expression(value));
                self.start(over(line, binders), clip.as_ref());
            }
            StatementKind::StartEquation { lhs, rhs, binders, .. } => {
                let line = format!("\\left.{} = {}\\right|_{{t=0}}", latex::expression(lhs), latex::expression(rhs));
                self.start(over(line, binders), None);
            }
            StatementKind::StartSteady { targets } => targets.iter().for_each(|target| {
                self.start(format!("\\left.\\frac{{d}}{{dt}}{}\\right|_{{t=0}} = 0", latex::expression(target)), None);
            }),
            StatementKind::Steady { entries, free } => {
                let fixed: Vec<String> = entries.iter().map(|(left, right)| math(&assignment(left, right))).collect();
                let found: Vec<String> = free.iter().map(|action| math(&latex::expression(action))).collect();
                let found = if found.is_empty() { String::new() } else { format!("; found: {}", found.join(", ")) };
                self.block(&format!("Steady state: {}{found}.", fixed.join(", ")));
            }
            StatementKind::Observe { items } => items.iter().for_each(|item| self.observation(item)),
            StatementKind::Level { name, extends, text, body } => {
                let text = text.as_deref().map(|text| format!(": {}", prose(text))).unwrap_or_default();
                let base = statements::extending(extends.as_ref());
                self.block(&format!("Level of observation {}{base}{text}", code(&name.text)));
                body.iter().for_each(|inner| self.control(inner));
            }
            StatementKind::Reward { name, unit, default, value, text } => {
                let texts = default.then_some("the default").into_iter().chain(text.as_deref());
                self.label("Reward", &name.text, &self.unit(unit.as_ref()), &texts.collect::<Vec<_>>().join("; "));
                self.block(&display(&latex::expression(value)));
            }
            StatementKind::Fail { name, event, condition, text } => {
                let texts = text.as_deref().into_iter().chain(event.then_some("ends the step at that instant"));
                self.condition("Failure", name, condition, Some(&texts.collect::<Vec<_>>().join("; ")));
            }
            StatementKind::Success { name, event, condition, text } => {
                let texts = text.as_deref().into_iter().chain(event.then_some("ends the step at that instant"));
                self.condition("Success", name, condition, Some(&texts.collect::<Vec<_>>().join("; ")));
            }
            StatementKind::Constraint { name, condition, text } => {
                self.condition("Constraint, violated where", name, condition, text.as_deref())
            }
            StatementKind::Event { name, condition, text } => self.condition("Event", name, condition, text.as_deref()),
            StatementKind::Invariant { name, value, rate, text } => self.invariant(name, value, rate.as_ref(), text.as_deref()),
            StatementKind::Episode { entries } => self.settings("episode", entries),
            StatementKind::Solver { entries } => self.settings("solver", entries),
            StatementKind::Policy { name, entries } => {
                self.label("Policy", &name.text, "", policy_text(self, statement, name));
                entries.iter().for_each(|(left, right)| self.block(&display(&assignment(left, right))));
            }
            StatementKind::Remove { target, .. } => {
                let words = self.source.texts.text(statement.span).split_once(' ').map_or("", |(_, rest)| rest.trim());
                let words = if words.is_empty() { latex::expression(target) } else { code(words) };
                self.block(&format!("Without {words}."));
            }
            StatementKind::At { instant, every, body } => self.at(instant, every.as_ref(), body),
            StatementKind::Control(control) => self.controller(control),
            StatementKind::Next { .. } | StatementKind::Reset { .. } | StatementKind::Clamp { .. } => {
                if let Some(line) = change(statement) {
                    self.block(&display(&line));
                }
            }
            StatementKind::Phase(phase) => self.phase(phase),
            StatementKind::Test { name, .. } => {
                let text = self.source.texts.text(statement.span);
                self.block(&format!("Test \"{}\":\n\n```eq\n{text}\n```", prose(name)));
            }
            StatementKind::Model { .. }
            | StatementKind::Import { .. }
            | StatementKind::Time { .. }
            | StatementKind::Unit { .. }
            | StatementKind::Set { .. }
            | StatementKind::Table(_)
            | StatementKind::TimeTable(_)
            | StatementKind::Def { .. }
            | StatementKind::Declare { .. }
            | StatementKind::Equation { .. }
            | StatementKind::Domain(_)
            | StatementKind::Flux(_)
            | StatementKind::Reaction(_)
            | StatementKind::Connector { .. }
            | StatementKind::Component { .. }
            | StatementKind::Port { .. }
            | StatementKind::Instance { .. }
            | StatementKind::Connect { .. }
            | StatementKind::TestStep(_)
            | StatementKind::Variant { .. }
            | StatementKind::Choice { .. }
            | StatementKind::When { .. } => {}
        }
    }

    /// A start, and what it is kept within.
    fn start(&mut self, line: String, clip: Option<&Clip>) {
        self.block(&display(&line));
        if let Some(clip) = clip {
            let clip = self.clip(clip);
            self.block(&format!("This start is {}.", clip.trim_start_matches(", ")));
        }
    }

    /// Something with a name that depends on a condition.
    fn condition(&mut self, what: &str, name: &Ident, condition: &Expr, text: Option<&str>) {
        self.label(what, &name.text, "", text.unwrap_or(""));
        self.block(&display(&latex::expression(condition)));
    }

    fn invariant(&mut self, name: &Ident, value: &Expr, rate: Option<&Expr>, text: Option<&str>) {
        self.label("Invariant", &name.text, "", text.unwrap_or(""));
        let rate = rate.map_or_else(|| "0".to_owned(), latex::expression);
        self.block(&display(&format!("\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}} t}} \\left({}\\right) = {rate}", latex::expression(value))));
    }

    fn settings(&mut self, of: &str, entries: &[(Ident, Expr)]) {
        for (name, value) in entries {
            self.row(SETTINGS, vec![code(&format!("{of} {}", name.text)), self.inline(value)]);
        }
    }

    fn observation(&mut self, o: &Observation) {
        let written = self.source.texts.text(o.value.span).split_whitespace().collect::<Vec<_>>().join(" ");
        let named = o.name.as_ref().map(|name| code(&name.text));
        let is = if named.is_some() { over(latex::expression(&o.value), &o.binders) } else { latex::binders(&o.binders) };
        // A number without a unit counts steps.
        let count = |value: &Option<Expr>| {
            value.as_ref().map(|e| match e.kind {
                ExprKind::Number { unit: None, value: 1.0 } => "1 step".to_owned(),
                ExprKind::Number { unit: None, .. } => format!("{} steps", self.inline(e)),
                _ => self.inline(e),
            })
        };
        // Unit and range of what is observed by its own name are those of its declaration.
        let own = o.name.as_ref().map_or(written.as_str(), |name| name.text.as_str());
        let mut alike =
            self.interface.finish.observations.iter().filter(|known| without_indices(&known.name) == without_indices(own)).peekable();
        let known = alike.peek().copied();
        let same = alike.all(|one| known.is_some_and(|known| (one.low, one.high) == (known.low, known.high)));
        let unit = o.unit.as_ref().map_or_else(|| known.map(|k| markdown::unit(&k.unit)), |unit| Some(self.unit(Some(unit))));
        let range = known.filter(|_| same).map(|k| format!("{} to {}", Short(k.low), Short(k.high)).replace("inf", "∞"));
        let row = vec![
            named.unwrap_or_else(|| code(&written)),
            unit.unwrap_or_default(),
            if is.is_empty() { is } else { math(&is) },
            o.bounds.as_ref().map(|(low, high)| self.range(low, high)).or(range).unwrap_or_default(),
            o.noise.as_ref().map(|e| self.inline(e)).unwrap_or_default(),
            count(&o.every).map(|n| format!("every {n}")).unwrap_or_default(),
            count(&o.delay).map(|n| format!("{n} late")).unwrap_or_default(),
            prose(o.text.as_deref().unwrap_or("")),
        ];
        self.row(OBSERVED, row);
    }

    fn at(&mut self, instant: &Ident, every: Option<&Expr>, body: &[Statement]) {
        let when = match (instant.text.as_str(), every) {
            (_, Some(every)) => format!("Every {}:", self.inline(every)),
            ("start", _) => "At the start of a step:".to_owned(),
            ("end", _) => "At the end of a step:".to_owned(),
            (event, _) => format!("At the event {}:", code(event)),
        };
        self.block(&when);
        for line in body.iter().filter_map(change) {
            self.block(&display(&line));
        }
    }

    /// A controller as a row of their table.
    fn controller(&mut self, control: &Control) {
        let shown = |e: &Expr| self.inline(e);
        let sets = math(&over(latex::expression(&control.output), &control.binders));
        let limits = control.limits.as_ref().map(|(low, high)| self.range(low, high)).unwrap_or_default();
        let manual = control.manual.as_ref().map(|(value, condition)| {
            let value = value.as_ref().map(|value| format!("{} ", shown(value))).unwrap_or_default();
            format!("{value}if {}", shown(condition))
        });
        let reset = control.reset.as_ref().map(shown).unwrap_or_default();
        let cells = [&control.measured, &control.setpoint, &control.gain].map(shown);
        let rest = [reset, limits, manual.unwrap_or_default(), shown(&control.every), prose(control.text.as_deref().unwrap_or(""))];
        self.row(CONTROLLERS, [sets].into_iter().chain(cells).chain(rest).collect());
    }

    fn phase(&mut self, phase: &Phase) {
        let lasts = phase.duration.iter().map(|e| self.inline(e));
        let until = phase.until.iter().map(|e| format!("until {}", self.inline(e)));
        let then = phase.next.as_ref().map(|next| code(&next.text)).unwrap_or_default();
        let end: Vec<String> = phase.body.iter().filter_map(change).map(|line| math(&line)).collect();
        let lasts: Vec<String> = lasts.chain(until).collect();
        self.row(PHASES, vec![code(&phase.name.text), lasts.join(", "), then, end.join(", ")]);
    }
}

fn assignment(left: &Expr, right: &Expr) -> String {
    format!("{} = {}", latex::expression(left), latex::expression(right))
}

/// Target of a statement of an instant.
fn change(statement: &Statement) -> Option<String> {
    Some(match &statement.kind {
        StatementKind::Next { target, value, binders } | StatementKind::Reset { target, value, binders } => {
            over(format!("{} \\leftarrow {}", latex::expression(target), latex::expression(value)), binders)
        }
        StatementKind::Clamp { target, value, condition, binders } => {
            let line = format!("{} \\leftarrow {}", latex::expression(target), latex::expression(value));
            over(format!("{line} \\quad \\text{{if }} {}", latex::expression(condition)), binders)
        }
        _ => return None,
    })
}

/// A line with its indices behind it.
fn over(line: String, indices: &[Binder]) -> String {
    match latex::binders(indices) {
        list if list.is_empty() => line,
        list => format!("{line}, \\quad {list}"),
    }
}

/// The text of a policy, which is between its name and its block.
fn policy_text<'s>(writer: &Writer<'s>, statement: &Statement, name: &Ident) -> &'s str {
    let source = writer.source;
    let rest = source.texts.text(Span { start: name.span.end, ..statement.span });
    rest.trim_start().strip_prefix('"').and_then(|rest| rest.split('"').next()).unwrap_or("")
}

/// `col.c` of `col[1].c[tropine,3]`.
fn without_indices(name: &str) -> String {
    let mut depth = 0_i32;
    let outside = |c: &char| {
        depth += i32::from(*c == '[') - i32::from(*c == ']');
        depth == 0 && *c != ']'
    };
    name.chars().filter(outside).collect()
}
