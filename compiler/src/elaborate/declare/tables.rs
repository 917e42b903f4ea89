//! Tables: over sets, with columns, over time.

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, Ident, Table, TableCells, TimeTable};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::symbols::{Axis, ScopeId, SetId, SymbolKind};
use crate::elaborate::{Elaborator, Place, Site};

impl<'a> Elaborator<'a> {
    pub(in crate::elaborate) fn declare_table(&mut self, scope: ScopeId, table: &'a Table) {
        let mut sets = Vec::new();
        for index in &table.indices {
            let Some(set) = self.set_named(scope, index) else {
                for column in &table.columns {
                    self.faulty(scope, &column.name);
                }
                return;
            };
            sets.push(set);
        }
        let place = Place::new(scope, Site::Dynamics);
        let columns = table.columns.len().max(1);
        let inner: usize = sets.iter().skip(1).map(|&s| self.symbols.sets[s].labels.len()).product();
        let outer = sets.first().map_or(1, |&s| self.symbols.sets[s].labels.len());
        // One table of several columns, or one table of one or two indices.
        let width = if columns > 1 { columns } else { inner };
        let mut values = vec![vec![f64::NAN; outer * inner]; columns];
        let mut tables_units = Vec::new();
        for column in &table.columns {
            let unit = match &column.unit {
                Some(u) => self.unit(u, &place),
                None => Some(Unit::one()),
            };
            tables_units.push(unit.unwrap_or_else(Unit::one));
        }
        if let Some(e) = &table.default
            && let Some(x) = self.table_number(e, tables_units.first(), &place)
        {
            for v in &mut values {
                v.fill(x);
            }
        }
        let before = self.reports.diagnostics.len();
        for row in &table.rows {
            let Some(i) = sets.first().and_then(|&s| self.row_member(s, &row.label)) else { continue };
            match &row.cells {
                TableCells::Values(cells) => {
                    if cells.len() != width {
                        self.report(
                            Diagnostic::error(codes::WRONG_SHAPE, format!("this row has {} values, not {width}", cells.len()), row.span)
                                .help("one value a column, or a member of the second set"),
                        );
                        continue;
                    }
                    for (j, e) in cells.iter().enumerate() {
                        let (table, at) = if columns > 1 { (j, i) } else { (0, i * inner + j) };
                        if let Some(x) = self.table_number(e, tables_units.get(table), &place) {
                            values[table][at] = x;
                        }
                    }
                }
                TableCells::Sparse(cells) => {
                    let Some(&second) = sets.get(1) else {
                        self.report(Diagnostic::error(codes::WRONG_SHAPE, "`member = value` needs a table over two sets", row.span));
                        continue;
                    };
                    for (label, e) in cells {
                        let Some(j) = self.row_member(second, label) else { continue };
                        if let Some(x) = self.table_number(e, tables_units.first(), &place) {
                            values[0][i * inner + j] = x;
                        }
                    }
                }
            }
        }
        // What a faulty row would have given is not missing.
        if self.reports.diagnostics.len() == before {
            self.check_table(table, &sets, &values);
        }
        let axes: Rc<[Axis]> = sets.iter().map(|&s| Axis::Set(s)).collect();
        for ((column, unit), values) in table.columns.iter().zip(tables_units).zip(values) {
            self.declare(scope, &column.name, SymbolKind::Table { axes: Rc::clone(&axes), unit, values: values.into() });
        }
    }

    fn row_member(&mut self, set: SetId, label: &Ident) -> Option<usize> {
        let found = self.symbols.sets[set].position(&label.text);
        if found.is_none() {
            let name = self.symbols.sets[set].name.clone();
            let help = self.reports.did_you_mean(&label.text, self.symbols.sets[set].labels.iter().map(String::as_str));
            self.report(
                Diagnostic::error(codes::OUT_OF_RANGE, format!("`{}` is no member of `{name}`", label.text), label.span).maybe_help(help),
            );
        }
        found
    }

    fn table_number(&mut self, e: &Expr, unit: Option<&Unit>, place: &crate::elaborate::Place) -> Option<f64> {
        let one = Unit::one();
        let expr = self.number_in(e, unit.unwrap_or(&one), "the table's entry", Span::default(), place);
        let reports = self.reports.diagnostics.len();
        let value = self.constant_value(expr);
        if value.is_none() && reports == self.reports.diagnostics.len() {
            self.missing_value("an entry of a table", e.span);
        }
        value.filter(|v| !v.is_nan())
    }

    pub(in crate::elaborate) fn declare_time_table(&mut self, scope: ScopeId, table: &'a TimeTable) {
        let place = Place::new(scope, Site::Dynamics);
        let unit = match &table.unit {
            Some(u) => self.unit(u, &place).unwrap_or_else(Unit::one),
            None => Unit::one(),
        };
        let time_unit = self.unit(&table.time_unit, &place).unwrap_or_else(Unit::one);
        let mut points = Vec::with_capacity(table.entries.len());
        for (time, value) in &table.entries {
            let t = self.table_number(time, Some(&time_unit), &place);
            let v = self.table_number(value, Some(&unit), &place);
            if let (Some(t), Some(v)) = (t, v) {
                if points.last().is_some_and(|&(before, _): &(f64, f64)| before >= t) {
                    self.report(Diagnostic::error(codes::BAD_SETTING, "times of a table must increase", time.span));
                }
                points.push((t, v));
            }
        }
        if points.is_empty() {
            self.report(Diagnostic::error(codes::EMPTY_SET, format!("the table `{}` is empty", table.name.text), table.name.span));
        }
        self.declare(scope, &table.name, SymbolKind::TimeTable { unit, time_unit, kind: table.kind, points: points.into() });
    }
}
