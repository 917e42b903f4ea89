//! Sampling instants and events.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::{BinaryOp, Expr, ExprKind, Statement, StatementKind};

use crate::elaborate::episode::assignments::{Assignments, Instants, instant_statement};
use crate::elaborate::episode::common::each;
use crate::elaborate::episode::together::Draft;
use crate::elaborate::episode::{controllers, regular};
use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::select::items::{Item, Moment};
use crate::elaborate::symbols::ScopeId;
use crate::ir::{Affine, Builtin, Expr as Node, ExprId, Program, Rewritten};
use crate::model::{Root, RootAction};

/// The programs of instants as they are put together.
struct Drafts<'a> {
    start: Draft,
    end: Draft,
    /// Controllers at regular instants.
    controllers: Draft,
    /// Blocks at regular instants, after them.
    regular: Draft,
    /// By scope and name, in the order in which they are first mentioned.
    events: Vec<(ScopeId, &'a str, Draft)>,
}

impl<'a> Drafts<'a> {
    /// The program of an instant.
    fn of(&mut self, scope: ScopeId, moment: Moment<'a>) -> &mut Draft {
        match moment.name.text.as_str() {
            _ if moment.every.is_some() => &mut self.regular,
            "start" => &mut self.start,
            "end" => &mut self.end,
            name => {
                let known = self.events.iter().position(|(s, n, _)| *n == name && *s == scope);
                let at = known.unwrap_or_else(|| {
                    self.events.push((scope, name, Draft::default()));
                    self.events.len() - 1
                });
                &mut self.events[at].2
            }
        }
    }
}

/// The programs of `at start`, `at end`, of regular instants and of events.
pub(in crate::elaborate) fn instant_programs<'a>(l: &mut Lowering<'_, 'a>, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Instants {
    let mut out = Instants::default();
    let mut assignments = Assignments::default();
    let [start, controllers, regular] = [(); 3].map(|()| Draft::of_start());
    let mut drafts = Drafts { start, end: Draft::default(), controllers, regular, events: Vec::new() };
    // Parts before the whole: what a component updates at the end of a step is seen by the `at end`
    // of what it is used in.
    let mut inner_first: Vec<&(ScopeId, Vec<Item<'a>>)> = blocks.iter().collect();
    inner_first.sort_by_key(|(scope, _)| std::cmp::Reverse(l.symbols.scopes[*scope].prefix.matches('.').count()));
    for (scope, item) in inner_first.into_iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i))) {
        match item {
            Item::At(moment, statement) => {
                let (instant, block) = (moment.name.text.as_str(), moment.name.span);
                assignments.guard = match moment.every {
                    Some(every) => match regular::due(l, every, &Place::new(scope, Site::Instant)) {
                        None => continue,
                        due => due,
                    },
                    None => None,
                };
                let at_start = instant == "start" || moment.every.is_some();
                out.start_resets |= at_start && matches!(statement.kind, StatementKind::Reset { .. } | StatementKind::Clamp { .. });
                instant_statement(l, scope, statement, (drafts.of(scope, moment), block), &mut assignments, instant);
            }
            Item::Other(Statement { kind: StatementKind::Control(control), span }) => {
                controllers::controller(l, (scope, *span), control, &mut drafts.controllers, &mut assignments);
            }
            _ => {}
        }
    }
    (out.start, out.end) = (drafts.start.program(l), drafts.end.program(l));
    out.regular = drafts.controllers.program(l);
    out.regular.nests.extend(drafts.regular.program(l).nests);
    let events: Vec<_> = drafts.events.into_iter().map(|(scope, name, draft)| (scope, name, draft.program(l))).collect();
    watched_events(l, blocks, &events, &mut out);
    out
}

/// `event name when condition`, with what happens `at name`.
fn watched_events<'a>(
    l: &mut Lowering<'_, 'a>,
    blocks: &[(ScopeId, Vec<Item<'a>>)],
    programs: &[(ScopeId, &'a str, Program)],
    out: &mut Instants,
) {
    let mut used = vec![false; programs.len()];
    for (scope, item) in each(blocks) {
        let Item::Other(Statement { kind: StatementKind::Event { name, condition, .. }, .. }) = item else { continue };
        if matches!(name.text.as_str(), "start" | "end") {
            let message = format!("an event cannot be called `{}`: that is the {} of every step", name.text, name.text);
            l.ledger.report(Diagnostic::error(codes::DUPLICATE_NAME, message, name.span).help("give the event another name"));
            continue;
        }
        let program = programs.iter().position(|(s, n, _)| *n == name.text && *s == scope);
        program.iter().for_each(|&at| used[at] = true);
        let place = Place::new(scope, Site::Instant);
        let Some((value, strict)) = root_of(l, condition, &place) else { continue };
        let action = match program {
            Some(at) => out.push_event(programs[at].2.clone()),
            None => RootAction::Restart,
        };
        let name = l.symbols.path_of(scope, name);
        out.roots.push(Root { name, value, strict, action });
    }
    for ((_, name, _), _) in programs.iter().zip(used).filter(|(_, used)| !used) {
        refuse_event(l, blocks, name);
    }
}

/// Reports `at` a name that is not an event.
fn refuse_event(l: &mut Lowering<'_, '_>, blocks: &[(ScopeId, Vec<Item<'_>>)], name: &str) {
    let known: Vec<&str> = blocks
        .iter()
        .flat_map(|(_, items)| items)
        .filter_map(|i| match i {
            Item::Other(Statement { kind: StatementKind::Event { name, .. }, .. }) => Some(name.text.as_str()),
            _ => None,
        })
        .chain(["start", "end"])
        .collect();
    let span = blocks
        .iter()
        .flat_map(|(_, items)| items)
        .find_map(|i| match i {
            Item::At(moment, _) if moment.every.is_none() && moment.name.text == name => Some(moment.name.span),
            _ => None,
        })
        .unwrap_or_default();
    let failure = each(blocks).find_map(|(_, item)| match item {
        Item::Other(Statement { kind: StatementKind::Fail { name: failure, .. }, span }) if failure.text == name => Some(*span),
        _ => None,
    });
    let Some(failure) = failure else {
        let interval = (name == "every").then(|| "state the interval: `at every 3 [s] { ... }`".to_owned());
        let help = interval.or_else(|| did_you_mean(name, known));
        l.ledger.report(Diagnostic::error(codes::UNKNOWN_NAME, format!("no event is called `{name}`"), span).maybe_help(help));
        return;
    };
    l.ledger.report(
        Diagnostic::error(codes::WRONG_KIND, format!("`{name}` is a failure: the episode ends there, and nothing is set"), span)
            .secondary(failure, "declared here")
            .help(format!("declare `event` with the same condition under another name, and write `at` that name instead of `at {name}`")),
    );
}

/// Root function of a comparison, positive where it holds, and whether it is strict.
pub(in crate::elaborate) fn root_of(l: &mut Lowering<'_, '_>, condition: &Expr, place: &Place) -> Option<(ExprId, bool)> {
    let ExprKind::Binary(op, a, b) = &condition.kind else {
        let help = match &condition.kind {
            ExprKind::Call { function, .. } | ExprKind::Reduce { function, .. } if matches!(function.text.as_str(), "any" | "all") => {
                "compare the extreme of the elements: `max(T[z] for z) > T_max` instead of `any(T[z] > T_max for z)`"
            }
            _ => "for example `h <= 0 [m]`",
        };
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "an event is a comparison of two quantities", condition.span).help(help));
        return None;
    };
    let (rising, strict) = match op {
        BinaryOp::Lt => (false, true),
        BinaryOp::Le => (false, false),
        BinaryOp::Gt => (true, true),
        BinaryOp::Ge => (true, false),
        _ => {
            l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "an event is a comparison with `<`, `<=`, `>` or `>=`", condition.span));
            return None;
        }
    };
    let (x, y) = (l.value(a, place), l.value(b, place));
    let (left, right) = l.values().common(&x, a.span, &y, b.span, condition.span)?;
    let value = if rising { l.exprs.sub(left, right) } else { l.exprs.sub(right, left) };
    Some((moving_clock(l, value), strict))
}

/// The clock of a condition that is watched throughout the step runs; elsewhere it is the instant
/// of the program.
pub(in crate::elaborate) fn moving_clock(l: &mut Lowering<'_, '_>, e: ExprId) -> ExprId {
    let (builtins, at) = (l.hidden.builtins, Affine::constant(Builtin::Clock as i64));
    l.exprs.rewrite(e, &mut Rewritten::default(), &mut |exprs, node| match node {
        Node::Load { var, at: element, .. } if var == builtins && element == at => Some(exprs.time()),
        _ => None,
    })
}
