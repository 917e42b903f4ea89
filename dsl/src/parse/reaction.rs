//! Reactions.

use pest::iterators::Pair;

use super::{Children, Context, Fallible, Rule, declaration, expression};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Binder, Declaration, Expr, ExprKind, Ident, Reaction, ReactionTerm, StatementKind};

/// `growth[z]: S + 2 O2 -> 1.1 X rate mu*X[z] "text"`
pub(super) fn reaction(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let name = children.name(context)?;
    let indices = declaration::indices(context, &mut children)?;
    children.skip(Rule::colon);
    let mut terms = Vec::new();
    if let Some(side) = children.take(Rule::reaction_side) {
        self::side(context, side, true, &mut terms)?;
    }
    children.skip(Rule::arrow);
    if let Some(side) = children.take(Rule::reaction_side) {
        self::side(context, side, false, &mut terms)?;
    }
    if terms.is_empty() {
        let fault = Diagnostic::error(codes::SYNTAX, format!("the reaction `{}` has no species", name.text), name.span);
        return Err(Box::new(fault.help("write `reaction growth: S -> 0.5 X rate mu*X`")));
    }
    let rate = declaration::clause(context, &mut children, Rule::reaction_rate)?;
    let rated = rate.is_some();
    let value = Some(rate.unwrap_or_else(|| element_of_rate(&name, &indices)));
    let span = children.whole.as_ref().map_or(name.span, |pair| context.span(pair));
    let text = children.text();
    let declaration = Declaration {
        name,
        indices,
        pattern: None,
        unit: None,
        measured: None,
        value,
        sample: None,
        clip: None,
        bounds: None,
        scale: None,
        nonnegative: None,
        prefer: None,
        text,
        span,
    };
    Ok(StatementKind::Reaction(Reaction { declaration, rated, terms }))
}

fn side(context: &Context<'_>, pair: Pair<'_, Rule>, consumed: bool, terms: &mut Vec<ReactionTerm>) -> Fallible<()> {
    for part in pair.into_inner().filter(|part| part.as_rule() == Rule::reaction_term) {
        let mut children = Children::new(part);
        let coefficient = children.take(Rule::coefficient).map(|pair| expression::expr(context, pair)).transpose()?;
        terms.push(ReactionTerm { consumed, coefficient, species: children.name(context)? });
    }
    Ok(())
}

/// `rate[growth, z]`: the rate of a reaction that writes none.
fn element_of_rate(name: &Ident, indices: &[Binder]) -> Expr {
    let named = |text: &str| Expr { span: name.span, kind: ExprKind::Name(Ident { text: text.to_owned(), span: name.span }) };
    let index = std::iter::once(named(&name.text)).chain(indices.iter().map(|binder| named(&binder.name.text))).collect();
    Expr { span: name.span, kind: ExprKind::Index(Box::new(named("rate")), index) }
}
