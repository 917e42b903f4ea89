//! Tables: over sets, with columns, over time.

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, Ident, Table, TableCells};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{defaults, units};
use crate::elaborate::naming::Naming;
use crate::elaborate::symbols::{Axis, ScopeId, SetId, SymbolKind};

/// A table while its rows are read.
struct Numbers {
    /// Unit of each column.
    units: Vec<Unit>,
    /// Entries of each column, the last index fastest.
    values: Vec<Vec<f64>>,
    /// Entries of one member of the first set.
    inner: usize,
    place: Place,
}

impl<'a> Declaring<'_, 'a> {
    pub(in crate::elaborate) fn declare_table(&mut self, scope: ScopeId, table: &'a Table) {
        let sets: Option<Vec<SetId>> = table.indices.iter().map(|index| self.naming().set_named(scope, index)).collect();
        let Some(sets) = sets else {
            return table.columns.iter().for_each(|column| self.faulty(scope, &column.name));
        };
        let place = Place::new(scope, Site::Dynamics);
        let mut numbers = self.empty_table(table, &sets, place);
        if let Some(e) = &table.default
            && let Some(x) = self.table_number(e, "the table's entry", numbers.units.first(), &numbers.place)
        {
            numbers.values.iter_mut().for_each(|v| v.fill(x));
        }
        let before = self.work.ledger.reports.diagnostics.len();
        self.work.ledger.check_rows(table);
        for row in &table.rows {
            let Some(i) = sets.first().and_then(|&s| self.naming().row_member(s, &row.label)) else { continue };
            match &row.cells {
                TableCells::Values(cells) => self.row_of_values(&mut numbers, i, cells, row.span),
                TableCells::Sparse(cells) => self.row_of_members(&mut numbers, i, cells, sets.get(1).copied(), row.span),
            }
        }
        // What a faulty row would have given is not missing.
        if self.work.ledger.reports.diagnostics.len() == before {
            self.naming().check_table(table, &sets, &numbers.values);
        }
        let axes: Rc<[Axis]> = sets.iter().map(|&s| Axis::Set(s)).collect();
        for ((column, unit), values) in table.columns.iter().zip(numbers.units).zip(numbers.values) {
            self.declare(scope, &column.name, SymbolKind::Table { axes: Rc::clone(&axes), unit, values: values.into() });
        }
    }

    /// A table whose entries are not known yet.
    fn empty_table(&mut self, table: &Table, sets: &[SetId], place: Place) -> Numbers {
        let size = |&s: &SetId| self.symbols.sets[s].labels.len();
        let inner: usize = sets.iter().skip(1).map(size).product();
        let outer = sets.first().map_or(1, size);
        let values = vec![vec![f64::NAN; outer * inner]; table.columns.len().max(1)];
        let mut units = Vec::new();
        for column in &table.columns {
            let unit = match &column.unit {
                Some(u) => units::unit(&mut self.lowering(), u, &place),
                None => Some(Unit::one()),
            };
            units.push(unit.unwrap_or_else(Unit::one));
        }
        Numbers { units, values, inner, place }
    }

    /// `member: 1 2 3`: one value a column, or a member of the second set.
    fn row_of_values(&mut self, numbers: &mut Numbers, i: usize, cells: &[Expr], span: Span) {
        let (columns, inner) = (numbers.values.len(), numbers.inner);
        let width = if columns > 1 { columns } else { inner };
        if cells.len() != width {
            let message = format!("this row has {} values, not {width}", cells.len());
            let fault = Diagnostic::error(codes::WRONG_SHAPE, message, span);
            return self.work.ledger.report(fault.help("one value a column, or a member of the second set"));
        }
        for (j, e) in cells.iter().enumerate() {
            let (table, at) = if columns > 1 { (j, i) } else { (0, i * inner + j) };
            if let Some(x) = self.table_number(e, "the table's entry", numbers.units.get(table), &numbers.place) {
                numbers.values[table][at] = x;
            }
        }
    }

    /// `member: other = 1, another = 2`: some members of the second set.
    fn row_of_members(&mut self, numbers: &mut Numbers, i: usize, cells: &[(Ident, Expr)], second: Option<SetId>, span: Span) {
        let Some(second) = second else {
            let fault = Diagnostic::error(codes::WRONG_SHAPE, "`member = value` needs a table over two sets", span);
            return self.work.ledger.report(fault);
        };
        for (label, e) in cells {
            let Some(j) = self.naming().row_member(second, label) else { continue };
            if let Some(x) = self.table_number(e, "the table's entry", numbers.units.first(), &numbers.place) {
                numbers.values[0][i * numbers.inner + j] = x;
            }
        }
    }

    pub(super) fn table_number(&mut self, e: &Expr, what: &str, unit: Option<&Unit>, place: &Place) -> Option<f64> {
        let one = Unit::one();
        let expr = self.lowering().number_in(e, unit.unwrap_or(&one), what, Span::default(), place);
        let reports = self.work.ledger.reports.diagnostics.len();
        let value = defaults::constant_value(&mut self.lowering(), expr);
        if value.is_none() && reports == self.work.ledger.reports.diagnostics.len() {
            self.work.ledger.missing_value("an entry of a table", e.span);
        }
        value.filter(|v| !v.is_nan())
    }
}

impl<'a> Naming<'_, 'a> {
    fn row_member(&mut self, set: SetId, label: &Ident) -> Option<usize> {
        let found = self.symbols.sets[set].position(&label.text);
        if found.is_none() {
            let name = self.symbols.sets[set].name.clone();
            let help = self.ledger.reports.did_you_mean(&label.text, self.symbols.sets[set].labels.iter().map(String::as_str));
            self.ledger.report(
                Diagnostic::error(codes::OUT_OF_RANGE, format!("`{}` is not a member of `{name}`", label.text), label.span)
                    .maybe_help(help),
            );
        }
        found
    }
}
