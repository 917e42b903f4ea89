//! Lints: allowed texts that are rarely intended.

use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Expr, ExprKind, Statement, StatementKind};

use crate::elaborate::episode::{Control, each};
use crate::elaborate::lower::nests::for_each_element;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, defaults};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{ScopeId, SymbolKind, Symbols};
use crate::ir::{FastMap, FastSet, Nest, Place as Memory, Role, VarId};
use crate::model::{Episode, Model, Quantity};

/// Looks for valid statements that are probably mistakes.
pub(in crate::elaborate) fn lint(l: &mut Lowering<'_, '_>, control: &Control) {
    lint_starts(l, &control.programs.initial_states.nests);
    lint_steady(l);
    lint_episode(l, &control.interface.episode);
}

/// States that start outside of their bounds, as far as their start is known.
fn lint_starts(l: &mut Lowering<'_, '_>, nests: &[Nest]) {
    let mut starts: FastMap<(VarId, i64), f64> = FastMap::default();
    for nest in nests {
        for store in &nest.stores {
            let Memory::Var(var) = store.target.place else { continue };
            let x = defaults::constant_value(l, store.value).unwrap_or(f64::NAN);
            for_each_element(&nest.extents(), store.target.at, &mut |i| {
                starts.insert((var, i), x);
            });
        }
    }
    for var in l.variables_of(Role::State) {
        let Some(q) = l.quantities.get(&var) else { continue };
        let start = |i: usize| starts.get(&(var, i as i64)).copied().unwrap_or(f64::NAN);
        let bounds = |i: usize| (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
        let outside = |i: &usize| start(*i).is_finite() && !Quantity::admits(bounds(*i).0, bounds(*i).1, start(*i));
        if let Some(i) = (0..q.len()).find(outside) {
            let (low, high) = bounds(i);
            let message = format!("`{}` starts at {}, outside its bounds {low}..{high}", q.element_name(i), start(i));
            let declared = l.symbols.vars[var].span;
            let help = "change the initial value or the bounds";
            let warning = match initial_of(l, var) {
                Some(span) => Diagnostic::warning(codes::START_OUTSIDE_BOUNDS, message, span).secondary(declared, "declared here"),
                None => Diagnostic::warning(codes::START_OUTSIDE_BOUNDS, message, declared),
            };
            l.ledger.report(warning.help(help));
        }
    }
}

/// The last `initial` statement that sets a state by its name.
fn initial_of(l: &Lowering<'_, '_>, var: VarId) -> Option<Span> {
    let symbol = l.symbols.of_var.get(&var)?;
    if l.input.options.initial.contains_key(&l.symbols[*symbol].path) {
        return None;
    }
    let of = |(scope, item): (ScopeId, Item<'_>)| {
        let Item::Other(Statement { kind: StatementKind::Initial { target, .. }, span }) = item else { return None };
        let base = if let ExprKind::Index(base, _) = &target.kind { base } else { target };
        (l.symbols.variable_of(base, &Place::new(scope, Site::Reset)) == Some(var)).then_some(*span)
    };
    each(&l.instances.blocks).filter_map(of).last()
}

/// Actions that a `steady` block leaves out, where it names others: one without any is a rest at
/// the nominal actions.
fn lint_steady(l: &mut Lowering<'_, '_>) {
    let mut named: FastSet<VarId> = FastSet::default();
    let mut at: Option<Span> = None;
    for (scope, item) in each(&l.instances.blocks) {
        let Item::Other(Statement { kind: StatementKind::Steady { entries, .. }, span }) = item else { continue };
        at.get_or_insert(*span);
        let place = Place::new(scope, Site::Instant);
        for (target, _) in entries {
            let base = match &target.kind {
                ExprKind::Index(base, _) => base,
                _ => target,
            };
            named.extend(l.symbols.variable_of(base, &place));
        }
    }
    let Some(span) = at else { return };
    let actions = l.variables_of(Role::Action);
    let left: Vec<&Quantity> = actions.iter().filter(|v| !named.contains(v)).filter_map(|v| l.quantities.get(v)).collect();
    if left.is_empty() || left.len() == actions.len() {
        return;
    }
    let entry = |q: &&Quantity| format!("{} = {}", q.name, Quantity::pick(&q.default, 0));
    let entries = left.iter().map(entry).collect::<Vec<_>>().join(", ");
    let names = left.iter().map(|q| format!("`{}`", q.name)).collect::<Vec<_>>().join(", ");
    let verb = if left.len() == 1 { "is" } else { "are" };
    l.ledger.report(
        Diagnostic::warning(codes::INCOMPLETE_STEADY, format!("`steady` does not name {names}, which {verb} taken as nominal"), span)
            .help(format!("write `{entries}` in the block")),
    );
}

/// A model without an `episode` block.
fn lint_episode(l: &mut Lowering<'_, '_>, episode: &Episode) {
    let of = |wanted: fn(&StatementKind) -> bool| {
        let mut items = l.instances.blocks.iter().flat_map(|(_, items)| items);
        items.find_map(|item| match item {
            Item::Other(statement) if wanted(&statement.kind) => Some(statement.span),
            _ => None,
        })
    };
    if of(|kind| matches!(kind, StatementKind::Episode { .. })).is_some() {
        return;
    }
    let span = of(|kind| matches!(kind, StatementKind::Model { .. })).unwrap_or_default();
    let (step, limit) = (episode.step, episode.max_steps);
    let message = format!("the model has no `episode` block: it is sampled every {step} {} over {limit} steps", l.symbols.time_unit);
    let help = format!("write `episode {{ step = {step} [{}], max_steps = {limit} }}`", l.symbols.time_unit);
    l.ledger.report(Diagnostic::warning(codes::NO_EPISODE, message, span).help(help));
}

impl<'a> Symbols<'a> {
    fn variable_of(&self, e: &Expr, place: &Place) -> Option<VarId> {
        let ExprKind::Name(name) = &e.kind else { return None };
        match self[self.lookup(place.scope, &name.text)?].kind {
            SymbolKind::Variable { var, .. } => Some(var),
            _ => None,
        }
    }
}

/// Parameters of the main file whose name occurs only in their declaration, comments and texts
/// aside.
pub(crate) fn unused_parameters(model: &Model, sources: &SourceMap, main: FileId, files: &[FileId]) -> Vec<Diagnostic> {
    let mut count: FastMap<&str, usize> = FastMap::default();
    for file in files.iter().filter_map(|id| sources.file(*id)) {
        for word in words(file.text()) {
            *count.entry(word).or_default() += 1;
        }
    }
    let mut declared: FastMap<&str, FastSet<Span>> = FastMap::default();
    for quantity in &model.interface.quantities.parameters {
        let Some(var) = quantity.var else { continue };
        let name = quantity.name.rsplit('.').next().unwrap_or_default();
        declared.entry(name).or_default().insert(model.vars[var].span);
    }
    let unused = declared.iter().filter(|(name, spans)| count.get(*name).copied().unwrap_or(0) <= spans.len());
    let places = unused.flat_map(|(name, spans)| spans.iter().map(move |span| (*name, *span)));
    let mut out: Vec<Diagnostic> = places
        .filter(|(_, span)| span.file == main)
        .map(|(name, span)| {
            let message = format!("the parameter `{name}` is not used");
            Diagnostic::warning(codes::UNUSED_PARAMETER, message, span).help("use it, or take it away")
        })
        .collect();
    out.sort_by_key(|d| d.primary.span.start);
    out
}

/// Words of a text, without comments and texts in quotes.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let code = text.lines().flat_map(|line| {
        let mut in_quotes = false;
        let end = line.char_indices().find(|&(_, c)| {
            in_quotes ^= c == '"';
            c == '#' && !in_quotes
        });
        line[..end.map_or(line.len(), |(at, _)| at)].split('"').step_by(2)
    });
    code.flat_map(|part| part.split(|c: char| !c.is_alphanumeric() && c != '_')).filter(|word| !word.is_empty())
}
