//! Declarations and their clauses.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, data, expression, unit};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{BY_MEMBER, Binder, Clip, Declaration, Expr, ExprKind, Ident, Measured};

/// `name[i in set] named "n{}" : unit from "file" linear = value ~ sample clip bounds in low..high
/// scale s nonnegative prefer "text"`
pub(super) fn declaration(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Declaration> {
    let span = context.span(&pair);
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    let indices = indices(context, &mut children)?;
    Ok(Declaration {
        name: name.clone(),
        pattern: children.take(Rule::named).and_then(|named| {
            let mut inner = Children::new(named);
            inner.skip(Rule::kw_named);
            inner.text()
        }),
        unit: unit::declared(context, &mut children)?,
        measured: children.take(Rule::table_file).map(|file| measured(context, &name, file)).transpose()?,
        value: children.take(Rule::value).map(|pair| value(context, &indices, pair)).transpose()?,
        sample: clause(context, &mut children, Rule::sample)?,
        clip: clip(context, &mut children)?,
        bounds: bounds(context, &mut children)?,
        scale: clause(context, &mut children, Rule::scale)?,
        nonnegative: children.take(Rule::kw_nonnegative).map(|word| context.span(&word)),
        prefer: children.take(Rule::kw_prefer).map(|word| context.span(&word)),
        text: children.text(),
        indices,
        span,
    })
}

/// `= expr`, `= { A: 1, B: 2 }`
fn value(context: &Context<'_>, indices: &[Binder], pair: Pair<'_, Rule>) -> Fallible<Expr> {
    let mut children = Children::new(pair.clone());
    children.skip(Rule::equals);
    let Some(members) = children.take(Rule::member_values) else { return only_expr(context, pair) };
    let span = context.span(&members);
    let named = |name: &Ident| Expr { span: name.span, kind: ExprKind::Name(name.clone()) };
    let of = indices.iter().map(|binder| named(&binder.name)).collect();
    let mut arguments = vec![Expr { span, kind: ExprKind::Tuple(of) }];
    for part in members.into_inner().filter(|part| part.as_rule() == Rule::member_value) {
        let mut member = Children::new(part);
        let label = data::label(context, &mut member)?;
        member.skip(Rule::colon);
        let value = expression::expr(context, member.expect(context, Rule::expr)?)?;
        arguments.extend([named(&label), value]);
    }
    Ok(Expr { span, kind: ExprKind::Call { function: Ident { text: BY_MEMBER.to_owned(), span }, arguments } })
}

/// `from "weather.csv" linear outside cyclic` of the disturbance `name`.
fn measured(context: &Context<'_>, name: &Ident, file: Pair<'_, Rule>) -> Fallible<Box<Measured>> {
    let (path, kind, outside) = data::file(context, file)?;
    let function = Ident { text: format!("{} of its data", name.text), span: name.span };
    let read = Expr { span: name.span, kind: ExprKind::Call { function, arguments: Vec::new() } };
    Ok(Box::new(Measured { path: path.text, path_span: path.span, kind, outside, read }))
}

/// All declarations among the parts of a rule.
pub(super) fn declarations(context: &Context<'_>, children: Children<'_>) -> Fallible<Vec<Declaration>> {
    let parts = children.pairs.filter(|part| part.as_rule() == Rule::declaration);
    parts.map(|part| declaration(context, part)).collect()
}

/// `[i in species, z]`, where it was written.
pub(super) fn indices(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Vec<Binder>> {
    children.take(Rule::indices).map_or_else(|| Ok(Vec::new()), |pair| expression::binders(context, pair))
}

/// The one expression of a clause, where the clause was written.
pub(super) fn clause(context: &Context<'_>, children: &mut Children<'_>, rule: Rule) -> Fallible<Option<Expr>> {
    children.take(rule).map(|pair| only_expr(context, pair)).transpose()
}

/// The one expression among the parts of a rule.
pub(super) fn only_expr(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Expr> {
    let mut children = Children::new(pair);
    while children.peek().is_some_and(|rule| rule != Rule::expr) {
        children.pairs.next();
    }
    expression::expr(context, children.expect(context, Rule::expr)?)
}

/// `low..high`, standing next.
pub(super) fn range(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<(Expr, Expr)> {
    let low = expression::expr(context, children.expect(context, Rule::expr)?)?;
    children.expect(context, Rule::dots)?;
    Ok((low, expression::expr(context, children.expect(context, Rule::expr)?)?))
}

/// `in low..high`, where it was written.
pub(super) fn bounds(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Option<(Expr, Expr)>> {
    let Some(pair) = children.take(Rule::bounds) else { return Ok(None) };
    let mut inner = Children::new(pair);
    inner.skip(Rule::kw_in);
    range(context, &mut inner).map(Some)
}

/// `clip bounds` or `clip low..high`, where it was written.
pub(super) fn clip(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Option<Clip>> {
    let Some(pair) = children.take(Rule::clip) else { return Ok(None) };
    let mut inner = Children::new(pair);
    inner.skip(Rule::kw_clip);
    if let Some(word) = inner.take(Rule::kw_bounds) {
        return Ok(Some(Clip::Bounds(context.span(&word))));
    }
    let (low, high) = range(context, &mut inner)?;
    Ok(Some(Clip::Range(low, high)))
}

/// `name = expr`, several.
pub(super) fn arguments(context: &Context<'_>, children: Children<'_>) -> Fallible<Vec<(Ident, Expr)>> {
    let mut list: Vec<(Ident, Expr)> = Vec::new();
    for part in children.pairs.filter(|part| part.as_rule() == Rule::argument) {
        let name = Children::new(part.clone()).name(context)?;
        if let Some((first, _)) = list.iter().find(|(known, _)| known.text == name.text) {
            let fault = Diagnostic::error(codes::DUPLICATE_CLAUSE, format!("`{}` is given twice", name.text), name.span);
            return Err(Box::new(fault.label("a second time").secondary(first.span, "first here").help("keep one of the two")));
        }
        list.push((name, only_expr(context, part)?));
    }
    Ok(list)
}

/// Sets a clause that may be given once.
pub(super) fn fill<T>(context: &Context<'_>, slot: &mut Option<T>, value: T, name: &str, pair: &Pair<'_, Rule>) -> Fallible<()> {
    if slot.replace(value).is_some() {
        let fault = Diagnostic::error(codes::DUPLICATE_CLAUSE, format!("`{name}` is given twice"), context.span(pair));
        return Err(Box::new(fault.label("a second time").help("keep one of the two")));
    }
    Ok(())
}

/// `extends A`
pub(super) fn extends(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Option<Ident>> {
    let Some(pair) = children.take(Rule::extends) else { return Ok(None) };
    let mut inner = Children::new(pair);
    inner.skip(Rule::kw_extends);
    inner.name(context).map(Some)
}
