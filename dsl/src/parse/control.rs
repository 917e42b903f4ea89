//! Controllers.

use pest::iterators::Pair;

use super::declaration::{fill, only_expr, range};
use super::{Children, Context, Fallible, Rule, expression};
use crate::diagnostic::{Diagnostic, codes};
use crate::syntax::{Control, Expr, StatementKind};

/// Clauses in the order of the text, each at most once.
#[derive(Default)]
struct Clauses {
    measured: Option<Expr>,
    setpoint: Option<Expr>,
    gain: Option<Expr>,
    reset: Option<Expr>,
    limits: Option<(Expr, Expr)>,
    manual: Option<(Option<Expr>, Expr)>,
    every: Option<Expr>,
}

/// `control u from y setpoint r gain K reset T limits a..b manual v when c every 3 [s] for k in s`
pub(super) fn control(context: &Context<'_>, mut children: Children<'_>) -> Fallible<StatementKind> {
    let output = expression::place(context, children.expect(context, Rule::place)?)?;
    let mut clauses = Clauses::default();
    while let Some(clause) = children.take(Rule::control_clause) {
        clauses.add(context, clause)?;
    }
    let binders = expression::for_clause(context, &mut children)?;
    let missing = |word: &str| {
        let fault = Diagnostic::error(codes::MISSING_CLAUSE, format!("this controller has no `{word}`"), output.span);
        Box::new(fault.help("write `control u from y setpoint r gain K every 3 [s]`"))
    };
    let Clauses { measured, setpoint, gain, reset, limits, manual, every } = clauses;
    Ok(StatementKind::Control(Control {
        measured: measured.ok_or_else(|| missing("from"))?,
        setpoint: setpoint.ok_or_else(|| missing("setpoint"))?,
        gain: gain.ok_or_else(|| missing("gain"))?,
        every: every.ok_or_else(|| missing("every"))?,
        output,
        reset,
        limits,
        manual,
        binders,
        text: children.text(),
    }))
}

impl Clauses {
    fn add(&mut self, context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<()> {
        let place = pair.clone();
        let mut children = Children::new(pair);
        if let Some(limits) = children.take(Rule::control_limits) {
            let mut inner = Children::new(limits);
            inner.skip(Rule::kw_limits);
            return fill(context, &mut self.limits, range(context, &mut inner)?, "limits", &place);
        }
        if let Some(manual) = children.take(Rule::control_manual) {
            return fill(context, &mut self.manual, manual_of(context, Children::new(manual))?, "manual", &place);
        }
        let word = children.expect(context, Rule::control_word)?;
        let slot = match word.as_str() {
            "from" => &mut self.measured,
            "setpoint" => &mut self.setpoint,
            "gain" => &mut self.gain,
            "reset" => &mut self.reset,
            _ => &mut self.every,
        };
        fill(context, slot, only_expr(context, place.clone())?, word.as_str(), &place)
    }
}

/// `manual 50 [%] when stopped`, `manual when stopped`
fn manual_of(context: &Context<'_>, mut children: Children<'_>) -> Fallible<(Option<Expr>, Expr)> {
    children.skip(Rule::kw_manual);
    let value = match children.peek() {
        Some(Rule::expr) => Some(expression::expr(context, children.expect(context, Rule::expr)?)?),
        _ => None,
    };
    children.skip(Rule::kw_when);
    Ok((value, expression::expr(context, children.expect(context, Rule::expr)?)?))
}
