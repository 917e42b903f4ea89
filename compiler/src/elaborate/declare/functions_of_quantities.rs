//! Tables over time or another quantity, and over two of them: points in the text or in a file.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Declaration, Expr, ExprKind, Ident, Measured, TablePoints, TimeTable, TimeTableKind, UnitExpr};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::data::{self, Cell};
use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::units;
use crate::elaborate::options::GivenData;
use crate::elaborate::symbols::{Grid, Outside, ScopeId, Symbol, SymbolKind};

/// Words after `outside`.
const OUTSIDE: [(&str, Outside); 4] =
    [("constant", Outside::Constant), ("linear", Outside::Linear), ("refused", Outside::Refused), ("cyclic", Outside::Cyclic)];

/// A factor and an offset from the numbers of a file to those of the table.
type Conversion = (f64, f64);

impl<'a> Declaring<'_, 'a> {
    pub(in crate::elaborate) fn declare_time_table(&mut self, scope: ScopeId, table: &'a TimeTable) {
        let place = Place::new(scope, Site::Dynamics);
        let outside = self.work.ledger.option(table.outside.as_ref(), "reading outside of a table", Outside::Constant, &OUTSIDE);
        self.refuse_lines_of_steps((&table.name, table.kind, table.outside.as_ref()), outside);
        if table.second_unit.is_some() {
            self.refuse_steps_of_surfaces(table, outside);
        }
        let before = self.work.ledger.reports.diagnostics.len();
        let kind = match &table.second_unit {
            None => self.curve(table, outside, &place),
            Some(second) => self.surface(table, second, outside, &place),
        };
        let Some(kind) = kind else { return self.faulty(scope, &table.name) };
        // Faults of the points are reported once: reading the table causes no others.
        let faults = self.work.ledger.reports.diagnostics.len() > before && matches!(table.points, TablePoints::File { .. });
        self.declare(scope, &table.name, if faults { SymbolKind::Faulty } else { kind });
    }

    /// Declares the data of a disturbance, which is read at the present time. A scenario may name
    /// another file.
    pub(in crate::elaborate::declare) fn declare_measured(
        &mut self,
        scope: ScopeId,
        d: &'a Declaration,
        measured: &'a Measured,
        unit: &Unit,
    ) {
        let place = Place::new(scope, Site::Dynamics);
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, d.name.text);
        let given = self.input.options.measured.get(&path);
        let word = given.and_then(|given| given.outside.as_ref()).or(measured.outside.as_ref());
        let outside = self.work.ledger.option(word, "reading outside of the data", Outside::Constant, &OUTSIDE);
        let kind = given.and_then(|given| given.kind).unwrap_or(measured.kind);
        self.refuse_lines_of_steps((&d.name, kind, word), outside);
        let time_unit = self.symbols.time_unit.clone();
        let points = match given.map(|given| &given.data) {
            Some(GivenData::Constant(x)) => Some(vec![(0.0, *x)]),
            Some(GivenData::File(path, span)) => {
                self.points_of_file(&d.name, Some(unit), (path, *span), &time_unit, &place).map(|(p, _)| p)
            }
            None => {
                let file = (measured.path.as_str(), measured.path_span);
                self.points_of_file(&d.name, Some(unit), file, &time_unit, &place).map(|(p, _)| p)
            }
        };
        let outside = if matches!(points.as_deref(), Some([_])) && given.is_some() { Outside::Constant } else { outside };
        let kind = match points {
            Some(points) if self.may_repeat(&d.name, &points, outside) => {
                SymbolKind::TimeTable { unit: unit.clone(), time_unit, kind, outside, points: points.into() }
            }
            _ => SymbolKind::Faulty,
        };
        let ExprKind::Call { function, .. } = &measured.read.kind else { return };
        let symbol = Symbol { path, scope, span: d.name.span, kind };
        let _ = self.symbols.declare(&function.text, symbol);
    }

    /// Returns whether points can repeat, where they do; reports the ones that cannot.
    fn may_repeat(&mut self, name: &Ident, points: &[(f64, f64)], outside: Outside) -> bool {
        if outside != Outside::Cyclic || points.len() > 1 {
            return true;
        }
        let message = format!("`{}` repeats from its first point to its last, and has one point", name.text);
        self.work
            .ledger
            .report(Diagnostic::error(codes::BAD_SETTING, message, name.span).help("give two points or more, or write `constant`"));
        false
    }

    /// A table of steps has no slope.
    fn refuse_lines_of_steps(&mut self, (name, kind, word): (&Ident, TimeTableKind, Option<&Ident>), outside: Outside) {
        let steps = matches!(kind, TimeTableKind::Until | TimeTableKind::From);
        if let Some(word) = word.filter(|_| steps && outside == Outside::Linear) {
            let message = format!("the table `{}` holds its values and has no slope outside of its points", name.text);
            self.work.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, word.span).help("write `constant` or `refused`"));
        }
    }

    fn refuse_steps_of_surfaces(&mut self, table: &TimeTable, outside: Outside) {
        if matches!(table.kind, TimeTableKind::Until | TimeTableKind::From) {
            let message = format!("the table `{}` over two quantities is `linear` or `cubic`", table.name.text);
            self.work.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, table.name.span));
        }
        if let Some(word) = table.outside.as_ref().filter(|_| outside == Outside::Cyclic) {
            let message = format!("the table `{}` over two quantities does not repeat", table.name.text);
            self.work
                .ledger
                .report(Diagnostic::error(codes::BAD_SETTING, message, word.span).help("write `constant`, `linear` or `refused`"));
        }
    }

    fn unit_of(&mut self, unit: Option<&UnitExpr>, place: &Place) -> Unit {
        unit.and_then(|unit| units::unit(&mut self.lowering(), unit, place)).unwrap_or_else(Unit::one)
    }

    /// A table over one quantity.
    fn curve(&mut self, table: &'a TimeTable, outside: Outside, place: &Place) -> Option<SymbolKind<'a>> {
        let mut unit = self.unit_of(table.unit.as_ref(), place);
        let time_unit = self.unit_of(Some(&table.time_unit), place);
        let points = match &table.points {
            TablePoints::Entries(entries) => self.entries(entries, (&time_unit, &unit), place),
            TablePoints::File { path, span } => {
                let declared = table.unit.is_some().then_some(&unit);
                let (points, own) = self.points_of_file(&table.name, declared, (path, *span), &time_unit, place)?;
                unit = own;
                points
            }
            TablePoints::Grid { columns, .. } => {
                let span = columns.first().map_or(table.name.span, |column| column.span);
                let message = format!("the table `{}` is over one quantity and takes one value a point", table.name.text);
                let fault = Diagnostic::error(codes::WRONG_SHAPE, message, span);
                self.work.ledger.report(fault.help("name both quantities: `over (T : degC, p : bar)`"));
                return None;
            }
        };
        if points.is_empty() {
            let message = format!("the table `{}` is empty", table.name.text);
            self.work.ledger.report(Diagnostic::error(codes::EMPTY_SET, message, table.name.span));
        }
        self.may_repeat(&table.name, &points, outside).then(|| SymbolKind::TimeTable {
            unit,
            time_unit,
            kind: table.kind,
            outside,
            points: points.into(),
        })
    }

    /// Points in the text.
    fn entries(&mut self, entries: &[(Expr, Expr)], (time_unit, unit): (&Unit, &Unit), place: &Place) -> Vec<(f64, f64)> {
        let mut points = Vec::with_capacity(entries.len());
        for (time, value) in entries {
            let t = self.table_number(time, "the point of an entry", Some(time_unit), place);
            let v = self.table_number(value, "the table's entry", Some(unit), place);
            let (Some(t), Some(v)) = (t, v) else { continue };
            self.refuse_infinite([(t, time.span), (v, value.span)]);
            if points.last().is_some_and(|&(before, _): &(f64, f64)| before >= t) {
                self.work.ledger.report(Diagnostic::error(codes::BAD_SETTING, "times of a table must increase", time.span));
            }
            points.push((t, v));
        }
        points
    }

    fn refuse_infinite(&mut self, numbers: impl IntoIterator<Item = (f64, Span)>) {
        for (x, span) in numbers.into_iter().filter(|(x, _)| !x.is_finite()) {
            let message = format!("times and values of a table over time are finite, this is {x}");
            self.work.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, span));
        }
    }

    /// A table over two quantities.
    fn surface(&mut self, table: &'a TimeTable, second: &UnitExpr, outside: Outside, place: &Place) -> Option<SymbolKind<'a>> {
        let unit = self.unit_of(table.unit.as_ref(), place);
        let units = [self.unit_of(Some(&table.time_unit), place), self.unit_of(Some(second), place)];
        let grid = match &table.points {
            TablePoints::Grid { columns, rows } => self.grid(columns, rows, (&units, &unit), place)?,
            TablePoints::File { path, span } => self.grid_of_file((path, *span))?,
            TablePoints::Entries(_) => {
                let message = format!("the table `{}` over two quantities has no values of the second one", table.name.text);
                let fault = Diagnostic::error(codes::WRONG_SHAPE, message, table.name.span);
                self.work.ledger.report(fault.help("begin with a row `columns: 1, 2`"));
                return None;
            }
        };
        if grid.values.is_empty() {
            let message = format!("the table `{}` is empty", table.name.text);
            self.work.ledger.report(Diagnostic::error(codes::EMPTY_SET, message, table.name.span));
            return None;
        }
        Some(SymbolKind::Surface { unit, units: units.into(), cubic: table.kind == TimeTableKind::Cubic, outside, grid: grid.into() })
    }

    /// A rectangle of values in the text.
    fn grid(&mut self, columns: &[Expr], rows: &[(Expr, Vec<Expr>)], (units, unit): (&[Unit; 2], &Unit), place: &Place) -> Option<Grid> {
        let mut grid = Grid::default();
        let mut spans = [Vec::new(), Vec::new()];
        for column in columns {
            grid.second.push(self.table_number(column, "the value of a column", Some(&units[1]), place)?);
            spans[1].push(column.span);
        }
        for (first, cells) in rows {
            grid.first.push(self.table_number(first, "the value of a row", Some(&units[0]), place)?);
            spans[0].push(first.span);
            if cells.len() != columns.len() {
                let message = format!("this row has {} values, not {}", cells.len(), columns.len());
                let fault = Diagnostic::error(codes::WRONG_SHAPE, message, first.span);
                self.work.ledger.report(fault.help("give one value for each of `columns`"));
                return None;
            }
            for cell in cells {
                let value = self.table_number(cell, "the table's entry", Some(unit), place)?;
                self.refuse_infinite([(value, cell.span)]);
                grid.values.push(value);
            }
        }
        let sorted = self.increasing(&grid.first, &spans[0]) && self.increasing(&grid.second, &spans[1]);
        sorted.then_some(grid)
    }

    /// Returns whether the arguments of a table increase; reports the first that does not.
    fn increasing(&mut self, arguments: &[f64], spans: &[Span]) -> bool {
        let Some(at) = arguments.windows(2).position(|pair| pair[0] >= pair[1]) else { return true };
        let message = format!("the arguments of a table must increase: {} follows {}", arguments[at + 1], arguments[at]);
        let span = spans.get(at + 1).copied().unwrap_or_default();
        self.work
            .ledger
            .report(Diagnostic::error(codes::BAD_DATA, message, span).help("sort the points, and keep one of two for one argument"));
        false
    }

    /// The text of a file of data.
    fn rows_of_file(&mut self, (path, span): (&str, Span)) -> Option<Vec<Vec<Cell<'a>>>> {
        let Some((file, text)) = self.input.data.get(path) else {
            let message = format!("the file `{path}` cannot be read in the folder of the model or in the library");
            let help = "give the path of a text file from the folder of the model; links that lead out of it are refused";
            self.work.ledger.report(Diagnostic::error(codes::UNREADABLE, message, span).help(help));
            return None;
        };
        let rows = self.checked(data::rows(text, *file))?;
        if rows.len() < 2 {
            let message = format!("`{path}` has no rows below its header");
            self.work.ledger.report(Diagnostic::error(codes::BAD_DATA, message, span));
            return None;
        }
        let width = rows[0].len();
        if let Some(row) = rows.iter().find(|row| row.len() != width) {
            let whole = row.first().zip(row.last()).map_or(span, |(first, last)| Span { end: last.span.end, ..first.span });
            let message = format!("this row has {} cells, the header {width}", row.len());
            self.work.ledger.report(Diagnostic::error(codes::BAD_DATA, message, whole).help("separate cells by commas"));
            return None;
        }
        Some(rows)
    }

    fn checked<T>(&mut self, result: Result<T, Diagnostic>) -> Option<T> {
        result.map_err(|fault| self.work.ledger.report(fault)).ok()
    }

    /// The points of a column of a file, and the unit of the table.
    fn points_of_file(
        &mut self,
        name: &Ident,
        declared: Option<&Unit>,
        file: (&str, Span),
        time_unit: &Unit,
        place: &Place,
    ) -> Option<(Vec<(f64, f64)>, Unit)> {
        let rows = self.rows_of_file(file)?;
        let header = &rows[0];
        let columns: Vec<_> =
            header.iter().map(data::column).collect::<Result<_, _>>().map_err(|fault| self.work.ledger.report(fault)).ok()?;
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let at = self.checked(data::position(&names, name, file.0, header))?;
        let argument = self.conversion(columns[0].1.as_ref(), time_unit, "the argument", place)?;
        let own = columns[at].1.as_ref();
        let (unit, value) = match declared {
            None => (self.header_unit(own, place)?, (1.0, 0.0)),
            Some(unit) => (unit.clone(), self.conversion(own, unit, "the table", place)?),
        };
        let mut points = Vec::with_capacity(rows.len());
        let mut spans = Vec::with_capacity(rows.len());
        for row in &rows[1..] {
            let t = self.checked(data::number(&row[0], row))?;
            let v = self.checked(data::number(&row[at], row))?;
            points.push((converted(t, argument), converted(v, value)));
            spans.push(row[0].span);
        }
        let arguments: Vec<f64> = points.iter().map(|point| point.0).collect();
        self.increasing(&arguments, &spans).then_some((points, unit))
    }

    fn header_unit(&mut self, unit: Option<&UnitExpr>, place: &Place) -> Option<Unit> {
        match unit {
            Some(unit) => units::unit(&mut self.lowering(), unit, place),
            None => Some(Unit::one()),
        }
    }

    /// From the unit of a header to that of a declaration; a header without a unit has that one.
    fn conversion(&mut self, header: Option<&UnitExpr>, declared: &Unit, what: &str, place: &Place) -> Option<Conversion> {
        let Some(header) = header else { return Some((1.0, 0.0)) };
        let unit = self.header_unit(Some(header), place)?;
        let found = units::conversion(&unit, declared);
        if found.is_none() {
            self.work.ledger.report(units::mismatch(&unit, declared, header.span, what, Span::default()));
        }
        found
    }

    /// A rectangle of values in a file: the first row has the values of the second argument, the
    /// first column those of the first.
    fn grid_of_file(&mut self, file: (&str, Span)) -> Option<Grid> {
        let rows = self.rows_of_file(file)?;
        let mut grid = Grid::default();
        let mut spans = [Vec::new(), Vec::new()];
        for cell in &rows[0][1..] {
            grid.second.push(self.checked(data::number(cell, &rows[0]))?);
            spans[1].push(cell.span);
        }
        for row in &rows[1..] {
            grid.first.push(self.checked(data::number(&row[0], row))?);
            spans[0].push(row[0].span);
            for cell in &row[1..] {
                grid.values.push(self.checked(data::number(cell, row))?);
            }
        }
        let sorted = self.increasing(&grid.first, &spans[0]) && self.increasing(&grid.second, &spans[1]);
        sorted.then_some(grid)
    }
}

fn converted(x: f64, (factor, offset): Conversion) -> f64 {
    if factor == 1.0 && offset == 0.0 { x } else { x * factor + offset }
}
