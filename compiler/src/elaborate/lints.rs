//! What is allowed and hardly meant.

use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Expr, ExprKind, Statement, StatementKind};

use super::blocks::for_each_element;
use super::items::Item;
use super::{Elaborator, Site};
use crate::ir::{FastMap, FastSet, Place as Memory, Role, VarId};
use crate::model::{Model, Quantity};

impl Elaborator<'_> {
    /// Looks for what is allowed and hardly meant.
    pub(super) fn lint(&mut self) {
        self.lint_starts();
        self.lint_steady();
        self.lint_episode();
    }

    /// States that start outside of their bounds, as far as their start is known.
    fn lint_starts(&mut self) {
        let mut starts: FastMap<(VarId, i64), f64> = FastMap::default();
        let nests = self.model.programs.initial_states.nests.clone();
        for nest in &nests {
            for store in &nest.stores {
                let Memory::Var(var) = store.target.place else { continue };
                let x = self.constant_value(store.value).unwrap_or(f64::NAN);
                for_each_element(&nest.extents, store.target.at, &mut |i| {
                    starts.insert((var, i), x);
                });
            }
        }
        for var in self.state_variables() {
            let Some(q) = self.quantities.get(&var) else { continue };
            let start = |i: usize| starts.get(&(var, i as i64)).copied().unwrap_or(f64::NAN);
            let bounds = |i: usize| (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
            let outside = |i: &usize| start(*i).is_finite() && !Quantity::admits(bounds(*i).0, bounds(*i).1, start(*i));
            if let Some(i) = (0..q.len()).find(outside) {
                let (low, high) = bounds(i);
                let message = format!("`{}` starts at {}, outside of its bounds {low}..{high}", q.element_name(i), start(i));
                let declared = self.vars[var].span;
                let help = "change the initial value or the bounds";
                let warning = match self.initial_of(var) {
                    Some(span) => Diagnostic::warning(codes::START_OUTSIDE_BOUNDS, message, span).secondary(declared, "declared here"),
                    None => Diagnostic::warning(codes::START_OUTSIDE_BOUNDS, message, declared),
                };
                self.report(warning.help(help));
            }
        }
    }

    /// The last `initial` statement that sets a state by its name.
    fn initial_of(&self, var: VarId) -> Option<Span> {
        let symbol = self.symbol_of.get(&var)?;
        if self.options.initial.contains_key(&self.names.symbols[*symbol].path) {
            return None;
        }
        let of = |(scope, item): (super::ScopeId, Item<'_>)| {
            let Item::Other(Statement { kind: StatementKind::Initial { target, .. }, span }) = item else { return None };
            let base = if let ExprKind::Index(base, _) = &target.kind { base } else { target };
            (self.variable_of(base, &self.place(scope, Site::Reset)) == Some(var)).then_some(*span)
        };
        super::control::each(&self.blocks).filter_map(of).last()
    }

    /// Actions that a `steady` block leaves out, where it names others: one without any is a rest at the nominal actions.
    fn lint_steady(&mut self) {
        let mut named: FastSet<VarId> = FastSet::default();
        let mut at: Option<Span> = None;
        let blocks = self.blocks.clone();
        for (scope, item) in super::control::each(&blocks) {
            let Item::Other(Statement { kind: StatementKind::Steady { entries }, span }) = item else { continue };
            at.get_or_insert(*span);
            let place = self.place(scope, Site::Instant);
            for (target, _) in entries {
                let base = match &target.kind {
                    ExprKind::Index(base, _) => base,
                    _ => target,
                };
                named.extend(self.variable_of(base, &place));
            }
        }
        let Some(span) = at else { return };
        let actions = self.variables_of(Role::Action);
        let left: Vec<&Quantity> = actions.iter().filter(|v| !named.contains(v)).filter_map(|v| self.quantities.get(v)).collect();
        if left.is_empty() || left.len() == actions.len() {
            return;
        }
        let entry = |q: &&Quantity| format!("{} = {}", q.name, Quantity::pick(&q.default, 0));
        let entries = left.iter().map(entry).collect::<Vec<_>>().join(", ");
        let names = left.iter().map(|q| format!("`{}`", q.name)).collect::<Vec<_>>().join(", ");
        let verb = if left.len() == 1 { "is" } else { "are" };
        self.report(
            Diagnostic::warning(codes::INCOMPLETE_STEADY, format!("`steady` does not name {names}, which {verb} taken as nominal"), span)
                .help(format!("write `{entries}` in the block")),
        );
    }

    fn variable_of(&self, e: &Expr, place: &super::Place) -> Option<VarId> {
        let ExprKind::Name(name) = &e.kind else { return None };
        match self.names.symbols[self.names.lookup(place.scope, &name.text)?].kind {
            super::names::SymbolKind::Variable { var, .. } => Some(var),
            _ => None,
        }
    }

    /// A model without an `episode` block.
    fn lint_episode(&mut self) {
        let of = |wanted: fn(&StatementKind) -> bool| {
            let mut items = self.blocks.iter().flat_map(|(_, items)| items);
            items.find_map(|item| match item {
                Item::Other(statement) if wanted(&statement.kind) => Some(statement.span),
                _ => None,
            })
        };
        if of(|kind| matches!(kind, StatementKind::Episode { .. })).is_some() {
            return;
        }
        let span = of(|kind| matches!(kind, StatementKind::Model { .. })).unwrap_or_default();
        let episode = &self.model.interface.episode;
        let (step, limit) = (episode.step, episode.max_steps);
        let message = format!("the model has no `episode` block: it is sampled every {step} {} over {limit} steps", self.time_unit);
        let help = format!("write `episode {{ step = {step} [{}], max_steps = {limit} }}`", self.time_unit);
        self.report(Diagnostic::warning(codes::NO_EPISODE, message, span).help(help));
    }
}

/// Parameters of the main file whose name stands nowhere but in their declaration, comments and texts aside.
pub(crate) fn unused_parameters(model: &Model, sources: &SourceMap, main: FileId, files: &[FileId]) -> Vec<Diagnostic> {
    let mut count: FastMap<&str, usize> = FastMap::default();
    for file in files.iter().filter_map(|id| sources.file(*id)) {
        for word in words(file.text()) {
            *count.entry(word).or_default() += 1;
        }
    }
    let mut declared: FastMap<&str, FastSet<Span>> = FastMap::default();
    for quantity in &model.interface.parameters {
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
