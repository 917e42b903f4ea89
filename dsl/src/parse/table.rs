//! Sets, tables and time tables.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, data, declaration, expression, unit};
use crate::syntax::{Ident, SetMembers, StatementKind, Table, TableCells, TableColumn, TablePoints, TableRow, TimeTable, UnitExpr};

/// `set species = { a, b }`, `set class = 1..9`
pub(super) fn set(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    children.skip(Rule::equals);
    let mut formulas = Vec::new();
    let members = match children.take(Rule::set_names) {
        Some(pair) => {
            let mut names = Vec::new();
            for part in pair.into_inner().filter(|part| part.as_rule() == Rule::set_member) {
                let mut member = Children::new(part);
                let name = member.name(context)?;
                if let Some(formula) = member.take(Rule::text) {
                    formulas.push((name.clone(), Ident { text: Context::text(&formula), span: context.span(&formula) }));
                }
                names.push(name);
            }
            SetMembers::Names(names)
        }
        None => match children.take(Rule::set_sum) {
            Some(sum) => SetMembers::Of(expression::set_sum(context, sum, 0)?),
            None => {
                let low = expression::expr(context, children.expect(context, Rule::expr)?)?;
                if children.skip(Rule::dots) {
                    SetMembers::Range(low, expression::expr(context, children.expect(context, Rule::expr)?)?)
                } else {
                    SetMembers::Of(low)
                }
            }
        },
    };
    Ok(StatementKind::Set { name, members, formulas, text: children.text() })
}

/// All names among the parts of a rule.
pub(super) fn names(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Vec<Ident>> {
    pair.into_inner().filter(|part| part.as_rule() == Rule::name).map(|part| context.ident(&part)).collect()
}

/// The three forms of `table`.
pub(super) fn table(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    children.skip(Rule::kw_over);
    let name = children.name(context)?;
    if let Some(pair) = children.take(Rule::time_table) {
        let mut table = time_table(context, name, pair)?;
        table.text = children.text();
        return Ok(StatementKind::TimeTable(table));
    }
    let mut table = match children.take(Rule::columns_table) {
        Some(pair) => columns_table(context, name, pair)?,
        None => plain_table(context, name, children.expect(context, Rule::plain_table)?)?,
    };
    table.text = table.text.or(children.text());
    Ok(StatementKind::Table(table))
}

fn columns_table(context: &Context<'_>, set: Ident, pair: Pair<'_, Rule>) -> Fallible<Table> {
    let mut children = Children::new(pair);
    let text = children.text();
    let mut columns = Vec::new();
    let mut rows = Vec::new();
    for part in children.pairs {
        match part.as_rule() {
            Rule::column => columns.push(column(context, part)?),
            Rule::row => rows.push(row(context, part)?),
            _ => {}
        }
    }
    Ok(Table { columns, indices: vec![set], default: None, rows, text })
}

fn column(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<TableColumn> {
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    let unit = children.take(Rule::unit_brackets).map(|pair| unit::brackets(context, pair)).transpose()?;
    Ok(TableColumn { name, unit })
}

fn plain_table(context: &Context<'_>, name: Ident, pair: Pair<'_, Rule>) -> Fallible<Table> {
    let mut children = Children::new(pair);
    let indices = names(context, children.expect(context, Rule::table_sets)?)?;
    let unit = unit::declared(context, &mut children)?;
    let default = declaration::clause(context, &mut children, Rule::table_default)?;
    let text = children.text();
    let rows = children.pairs.filter(|part| part.as_rule() == Rule::row);
    let rows = rows.map(|part| row(context, part)).collect::<Fallible<Vec<_>>>()?;
    Ok(Table { columns: vec![TableColumn { name, unit }], indices, default, rows, text })
}

fn row(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<TableRow> {
    let span = context.span(&pair);
    let mut children = Children::new(pair);
    let label = data::label(context, &mut children)?;
    children.skip(Rule::colon);
    let cells = if children.peek() == Some(Rule::sparse_cell) {
        TableCells::Sparse(children.pairs.map(|part| sparse_cell(context, part)).collect::<Fallible<_>>()?)
    } else {
        TableCells::Values(children.pairs.map(|part| expression::expr(context, part)).collect::<Fallible<_>>()?)
    };
    Ok(TableRow { label, cells, span })
}

fn sparse_cell(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<(Ident, crate::syntax::Expr)> {
    let mut children = Children::new(pair);
    let label = data::label(context, &mut children)?;
    children.skip(Rule::equals);
    Ok((label, expression::expr(context, children.expect(context, Rule::expr)?)?))
}

fn time_table(context: &Context<'_>, name: Ident, pair: Pair<'_, Rule>) -> Fallible<TimeTable> {
    let mut children = Children::new(pair);
    let unit = unit::declared(context, &mut children)?;
    children.skip(Rule::kw_over);
    let time_unit = argument_unit(context, children.expect(context, Rule::table_argument)?)?;
    let second_unit = children.take(Rule::table_argument).map(|pair| argument_unit(context, pair)).transpose()?;
    if let Some(file) = children.take(Rule::table_file) {
        let (path, kind, outside) = data::file(context, file)?;
        let points = TablePoints::File { path: path.text, span: path.span };
        return Ok(TimeTable { name, unit, time_unit, second_unit, kind, outside, points, text: None });
    }
    let (kind, outside) = data::reading(context, &mut children)?;
    let points = points(context, children.expect(context, Rule::table_points)?)?;
    Ok(TimeTable { name, unit, time_unit, second_unit, kind, outside, points, text: None })
}

/// `T : degC`
fn argument_unit(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<UnitExpr> {
    let mut children = Children::new(pair);
    children.skip(Rule::name);
    children.skip(Rule::colon);
    unit::unit(context, children.expect(context, Rule::unit)?)
}

/// The points between the braces.
fn points(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<TablePoints> {
    let mut children = Children::new(pair);
    children.skip(Rule::open);
    let Some(head) = children.take(Rule::grid_columns) else {
        let entries = children.pairs.filter(|part| part.as_rule() == Rule::time_entry);
        return Ok(TablePoints::Entries(entries.map(|part| time_entry(context, part)).collect::<Fallible<_>>()?));
    };
    let exprs = |pair: Pair<'_, Rule>| {
        let parts = pair.into_inner().filter(|part| part.as_rule() == Rule::expr);
        parts.map(|part| expression::expr(context, part)).collect::<Fallible<Vec<_>>>()
    };
    let columns = exprs(head)?;
    let mut rows = Vec::new();
    for row in children.pairs.filter(|part| part.as_rule() == Rule::grid_row) {
        let mut cells = exprs(row)?;
        let values = cells.split_off(1);
        rows.extend(cells.pop().map(|first| (first, values)));
    }
    Ok(TablePoints::Grid { columns, rows })
}

fn time_entry(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<(crate::syntax::Expr, crate::syntax::Expr)> {
    let mut children = Children::new(pair);
    let time = expression::expr(context, children.expect(context, Rule::expr)?)?;
    children.skip(Rule::colon);
    Ok((time, expression::expr(context, children.expect(context, Rule::expr)?)?))
}
