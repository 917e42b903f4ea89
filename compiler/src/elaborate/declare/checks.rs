//! Faults of declarations: names that are there twice, members, options, tables.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Form, Ident, Statement, StatementKind, Table, TableCells};

use crate::elaborate::ledger::Ledger;
use crate::elaborate::naming::Naming;
use crate::elaborate::select::items::{Item, observed, reference};
use crate::elaborate::symbols::{ScopeId, SetId, SymbolKind};
use crate::ir::FastMap;
impl Naming<'_, '_> {
    pub(in crate::elaborate) fn set_named(&mut self, scope: ScopeId, name: &Ident) -> Option<SetId> {
        match self.symbols.lookup(scope, &name.text).map(|s| self.symbols[s].kind.clone()) {
            Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => Some(set),
            Some(SymbolKind::Faulty) => None,
            _ => {
                let help = self.ledger.reports.did_you_mean(&name.text, self.symbols.sets.values().map(|s| s.name.as_str()));
                self.ledger
                    .report(Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set `{}`", name.text), name.span).maybe_help(help));
                None
            }
        }
    }

    /// Reports the first entry that has no value.
    pub(in crate::elaborate) fn check_table(&mut self, table: &Table, sets: &[SetId], values: &[Vec<f64>]) {
        for (column, values) in table.columns.iter().zip(values) {
            let Some(at) = values.iter().position(|v| v.is_nan()) else { continue };
            let mut rest = at;
            let mut labels = Vec::new();
            for &set in sets.iter().rev() {
                let members = &self.symbols.sets[set].labels;
                labels.push(members[rest % members.len().max(1)].clone());
                rest /= members.len().max(1);
            }
            labels.reverse();
            self.ledger.report(
                Diagnostic::error(
                    codes::MISSING_DEFAULT,
                    format!("`{}` has no value for `{}`", column.name.text, labels.join(", ")),
                    column.name.span,
                )
                .help("give every member a row, or the table a `default`"),
            );
            // The other columns lack the same rows.
            return;
        }
    }
}

impl Ledger {
    pub(in crate::elaborate) fn duplicate(&mut self, name: &Ident, before: Span) {
        // Kinds are declared one after another; the reader goes by the order of the text.
        let position = |s: Span| (s.file, s.start);
        let (before, second) = if position(before) <= position(name.span) { (before, name.span) } else { (name.span, before) };
        self.report(
            Diagnostic::error(codes::DUPLICATE_NAME, format!("`{}` is declared twice", name.text), second)
                .label("second declaration")
                .secondary(before, "first declaration"),
        );
    }

    fn two_of(&mut self, what: &str, name: &str, first: Span, second: Span) {
        self.report(
            Diagnostic::error(codes::DUPLICATE_NAME, format!("two {what} are called `{name}`"), second).secondary(first, "the first one"),
        );
    }

    /// Statements with their own names: two with one name are a fault.
    pub(in crate::elaborate) fn check_names(&mut self, list: &[Item<'_>]) {
        let mut seen: FastMap<String, Span> = FastMap::default();
        let mut unnamed: FastMap<Form, Span> = FastMap::default();
        for item in list {
            let (what, name, span) = match item {
                Item::Observe(o) => match observed(o) {
                    Ok(name) => ("observations", name.to_owned(), o.span),
                    Err(form) => {
                        if let Some(first) = unnamed.insert(form, o.span) {
                            self.two_of("observations", &reference(&o.value), first, o.span);
                        }
                        continue;
                    }
                },
                Item::Other(s) => match &s.kind {
                    StatementKind::Reward { name, .. } => ("rewards", name.text.clone(), name.span),
                    StatementKind::Fail { name, .. } => ("failures", name.text.clone(), name.span),
                    StatementKind::Success { name, .. } => ("successes", name.text.clone(), name.span),
                    StatementKind::Constraint { name, .. } => ("constraints", name.text.clone(), name.span),
                    StatementKind::Invariant { name, .. } => ("invariants", name.text.clone(), name.span),
                    StatementKind::Policy { name, .. } => ("policies", name.text.clone(), name.span),
                    StatementKind::Level { name, .. } => ("levels", name.text.clone(), name.span),
                    StatementKind::Event { name, .. } => ("events", name.text.clone(), name.span),
                    _ => continue,
                },
                Item::Declare(..) | Item::At(..) => continue,
            };
            if let Some(first) = seen.insert(format!("{what} {name}"), span) {
                self.two_of(what, &name, first, span);
            }
        }
        let mut defaults = list.iter().filter_map(|i| match i {
            Item::Other(Statement { kind: StatementKind::Reward { name, default: true, .. }, .. }) => Some(name.span),
            _ => None,
        });
        if let (Some(first), Some(second)) = (defaults.next(), defaults.next()) {
            self.report(
                Diagnostic::error(codes::DUPLICATE_CLAUSE, "two rewards are the default", second).secondary(first, "the first one"),
            );
        }
    }

    /// Members of a set, options of a choice and rows of a table are distinct.
    pub(in crate::elaborate) fn check_members<'n>(&mut self, what: &str, names: impl IntoIterator<Item = &'n Ident>) {
        let mut seen: FastMap<&str, Span> = FastMap::default();
        for name in names {
            if let Some(&first) = seen.get(name.text.as_str()) {
                self.report(
                    Diagnostic::error(codes::DUPLICATE_NAME, format!("`{}` is twice in the {what}", name.text), name.span)
                        .secondary(first, "first here"),
                );
            }
            seen.entry(&name.text).or_insert(name.span);
        }
    }

    /// A table has one row for a member, and a row one value for each.
    pub(in crate::elaborate) fn check_rows(&mut self, table: &Table) {
        self.check_members("table", table.rows.iter().map(|row| &row.label));
        for row in &table.rows {
            if let TableCells::Sparse(cells) = &row.cells {
                self.check_members("row", cells.iter().map(|(name, _)| name));
            }
        }
    }

    pub(in crate::elaborate) fn option<T: Copy>(&mut self, written: Option<&Ident>, what: &str, default: T, known: &[(&str, T)]) -> T {
        let Some(name) = written else { return default };
        if let Some((_, value)) = known.iter().find(|(k, _)| *k == name.text) {
            return *value;
        }
        let list: Vec<&str> = known.iter().map(|(k, _)| *k).collect();
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("unknown {what} `{}`", name.text), name.span)
                .help(format!("it is one of {}", list.join(", "))),
        );
        default
    }
}
