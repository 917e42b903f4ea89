//! Parts of tables that declarations share: files of data and labels of rows.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule};
use crate::syntax::{Ident, TimeTableKind};

/// The member that a row or cell belongs to: a name, or an integer of a numbered set.
pub(super) fn label(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Ident> {
    match children.take(Rule::integer) {
        Some(integer) => Ok(context.word(&integer)),
        None => children.name(context),
    }
}

/// `from "k.csv" linear outside refused`: the path, and how the data are read.
pub(super) fn file(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<(Ident, TimeTableKind, Option<Ident>)> {
    let mut children = Children::new(pair);
    children.skip(Rule::kw_from);
    let path = children.expect(context, Rule::text)?;
    let path = Ident { text: Context::text(&path), span: context.span(&path) };
    let (kind, outside) = reading(context, &mut children)?;
    Ok((path, kind, outside))
}

/// `linear outside refused`
pub(super) fn reading(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<(TimeTableKind, Option<Ident>)> {
    let kind = match children.expect(context, Rule::time_kind)?.as_str() {
        "until" => TimeTableKind::Until,
        "from" | "step" => TimeTableKind::From,
        "cubic" => TimeTableKind::Cubic,
        _ => TimeTableKind::Linear,
    };
    let Some(outside) = children.take(Rule::table_outside) else { return Ok((kind, None)) };
    let mut outside = Children::new(outside);
    outside.skip(Rule::kw_outside);
    Ok((kind, Some(outside.name(context)?)))
}
