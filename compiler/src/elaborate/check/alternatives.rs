//! Checks of unselected parts: bodies of variants that are off, bodies of options that another one
//! precedes, and components that a choice may give to an instance.
//!
//! Each of them is put in force in turn, with its enclosing blocks, and the model elaborated anew;
//! faults inside of the body are reported as warnings. A body may name what another variant
//! declares: a fault that disappears with all variants on is ignored, except for a name without any
//! declaration.

use std::collections::{HashMap, HashSet};

use smpl_dsl::diagnostic::{Diagnostic, Faults, Severity, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, File, Ident, Statement, StatementKind};

use crate::elaborate::budget::is_spent;
use crate::elaborate::options::Options;
use crate::elaborate::select::variants::structural_switches;

/// Work that a statement counts for, each time that it is read again.
const STATEMENT: usize = 30;

/// The faults of the model under options, if there are any, and the work spent so far; with the
/// work of reading, beforehand.
pub(in crate::elaborate) type FaultsWith<'w> = dyn FnMut(&Options, u32) -> (Option<Faults>, u32) + 'w;

/// Names and options.
type Asked = Vec<(String, String)>;

/// A body that is not in force.
struct Body<'a> {
    /// Selections that it needs, the outermost first.
    asked: Asked,
    /// Places whose faults count.
    spans: Vec<Span>,
    statements: &'a [Statement],
}

/// A statement `use`, its component and its arguments.
type Use<'a> = (Span, &'a str, &'a [(Ident, Expr)]);

/// Faults in what is not in force, as warnings; `chosen` returns the option of a variant or choice,
/// and `spent` is the work that the model took.
pub(in crate::elaborate) fn faults_in_alternatives(
    files: &[File],
    options: &Options,
    chosen: &HashMap<String, String>,
    spent: u32,
    faults_with: &mut FaultsWith<'_>,
) -> Faults {
    let mut bodies = Vec::new();
    let own = structural_switches(files);
    files.iter().for_each(|file| collect(&file.statements, (chosen, &own), &Asked::new(), &mut bodies));
    components_to_choose(files, chosen, &mut bodies);
    let mut declared = HashSet::new();
    bodies.iter().flat_map(|body| body.statements).for_each(|statement| {
        declared.extend(statement.kind.declares().into_iter().map(|name| name.text.as_str()));
    });
    let statements = files.iter().map(|file| count(&file.statements)).sum();
    let mut check = Check { options, switches: switches(files), declared, statements, spent, faults_with };
    let mut faults = Faults::default();
    for body in &bodies {
        if is_spent(check.spent) {
            faults.push(not_checked(body));
            break;
        }
        check.body(body).into_iter().for_each(|fault| faults.push(fault));
    }
    faults
}

/// The bodies that are not in force. Statements of one name and option are one body, as far as what
/// is asked for is concerned, but each has its place.
fn collect<'a>(
    statements: &'a [Statement],
    (chosen, own): (&HashMap<String, String>, &HashSet<&str>),
    outer: &Asked,
    out: &mut Vec<Body<'a>>,
) {
    for statement in statements {
        let (name, option, body) = match &statement.kind {
            StatementKind::Variant { name, body, .. } => (&name.text, "true", body),
            StatementKind::When { choice, option, body } => (&choice.text, option.text.as_str(), body),
            StatementKind::Component { body, .. } => {
                collect(body, (chosen, own), outer, out);
                continue;
            }
            _ => continue,
        };
        // A switch of a component is that of each instance.
        if own.contains(name.as_str()) && !chosen.contains_key(name) {
            collect(body, (chosen, own), outer, out);
            continue;
        }
        let in_force = chosen.get(name).map_or("false", String::as_str) == option;
        let mut asked = outer.clone();
        if !in_force {
            asked.push((name.clone(), option.to_owned()));
        }
        if !asked.is_empty() {
            out.push(Body { asked: asked.clone(), spans: vec![statement.span], statements: body });
        }
        collect(body, (chosen, own), &asked, out);
    }
}

/// Options that are components and not in force, where an instance has the choice as an argument:
/// their faults are those of the instance and of its component.
fn components_to_choose<'a>(files: &'a [File], chosen: &HashMap<String, String>, out: &mut Vec<Body<'a>>) {
    let all = || files.iter().flat_map(|file| &file.statements);
    let mut uses = Vec::new();
    all().for_each(|statement| instances(statement, &mut uses));
    let component = |statement: &'a Statement| match &statement.kind {
        StatementKind::Component { name, .. } => Some((name.text.as_str(), statement.span)),
        _ => None,
    };
    let components: HashMap<&str, Span> = all().filter_map(component).collect();
    for statement in all() {
        let StatementKind::Choice { name, options, .. } = &statement.kind else { continue };
        let is_argument = |(_, e): &(Ident, Expr)| matches!(&e.kind, ExprKind::Name(given) if given.text == name.text);
        let given = uses.iter().filter(|(.., arguments)| arguments.iter().any(is_argument));
        let spans: Vec<Span> = given.flat_map(|(span, of, _)| [Some(*span), components.get(of).copied()]).flatten().collect();
        let others = options.iter().filter(|option| chosen.get(&name.text) != Some(&option.text));
        for option in others.filter(|option| !spans.is_empty() && components.contains_key(option.text.as_str())) {
            out.push(Body { asked: vec![(name.text.clone(), option.text.clone())], spans: spans.clone(), statements: &[] });
        }
    }
}

/// The statements `use` in a statement.
fn instances<'a>(statement: &'a Statement, out: &mut Vec<Use<'a>>) {
    if let StatementKind::Instance { component, arguments, .. } = &statement.kind {
        out.push((statement.span, &component.text, arguments));
    }
    statement.kind.block().iter().for_each(|inner| instances(inner, out));
}

fn count(statements: &[Statement]) -> usize {
    statements.iter().map(|statement| 1 + count(statement.kind.block())).sum()
}

/// All variants, on.
fn switches(files: &[File]) -> Asked {
    fn of(statements: &[Statement], out: &mut Asked) {
        for statement in statements {
            if let StatementKind::Variant { name, .. } = &statement.kind {
                out.push((name.text.clone(), "true".into()));
            }
            of(statement.kind.block(), out);
        }
    }
    let mut out = Asked::new();
    files.iter().for_each(|file| of(&file.statements, &mut out));
    out
}

struct Check<'a, 'w> {
    options: &'a Options,
    switches: Asked,
    /// Names that bodies declare.
    declared: HashSet<&'a str>,
    /// Number of all statements.
    statements: usize,
    spent: u32,
    faults_with: &'a mut FaultsWith<'w>,
}

impl Check<'_, '_> {
    /// Faults inside of a body.
    fn body(&mut self, body: &Body<'_>) -> Vec<Diagnostic> {
        let mut found = self.faults(&body.asked, body);
        if found.iter().any(|fault| !self.is_unknown(fault)) && self.switches.iter().any(|switch| !body.asked.contains(switch)) {
            let all: Asked = self.switches.iter().chain(&body.asked).cloned().collect();
            let with_all = self.faults(&all, body);
            let stays =
                |fault: &Diagnostic| with_all.iter().any(|other| (other.code, other.primary.span) == (fault.code, fault.primary.span));
            found.retain(|fault| self.is_unknown(fault) || stays(fault));
        }
        let inner = |fault: &Diagnostic| body.statements.iter().any(|s| is_alternative(s) && s.span.contains(fault.primary.span));
        found.into_iter().filter(|fault| !inner(fault)).map(|fault| told(fault, &body.asked)).collect()
    }

    /// Returns `true` if a fault is a name that no other body declares.
    fn is_unknown(&self, fault: &Diagnostic) -> bool {
        let name = fault.message.split('`').nth(1);
        fault.code == codes::UNKNOWN_NAME && name.is_some_and(|name| !self.declared.contains(name))
    }

    /// Faults inside of a body where something is asked for.
    fn faults(&mut self, asked: &Asked, body: &Body<'_>) -> Vec<Diagnostic> {
        let mut options = Options { lints: false, ..self.options.clone() };
        options.settings.retain(|name, _| !asked.iter().any(|(other, _)| other == name));
        options.variants.extend(asked.iter().cloned());
        // Each that is asked for is looked for among all.
        let reading = self.statements * STATEMENT + asked.len() * self.switches.len();
        let (faults, spent) = (self.faults_with)(&options, reading as u32);
        self.spent = spent;
        let Some(faults) = faults else { return Vec::new() };
        let here = |fault: &Diagnostic| fault.is_error() && body.spans.iter().any(|span| span.contains(fault.primary.span));
        faults.shown().into_iter().filter(here).collect()
    }
}

fn is_alternative(statement: &Statement) -> bool {
    matches!(statement.kind, StatementKind::Variant { .. } | StatementKind::When { .. })
}

/// A fault of what is not in force does not keep the model from running.
fn told(fault: Diagnostic, asked: &Asked) -> Diagnostic {
    let names: Vec<String> =
        asked.iter().map(|(name, option)| if option == "true" { name.clone() } else { format!("{name} = {option}") }).collect();
    let mut told = Diagnostic { severity: Severity::Warning, ..fault };
    told.notes.push(format!("with `{}`, which is not in force", names.join("`, `")));
    told
}

fn not_checked(body: &Body<'_>) -> Diagnostic {
    Diagnostic::warning(codes::TOO_LARGE, "this and what is not in force below is not checked: there is too much of it", body.spans[0])
        .help("check it with `--variant`")
}
