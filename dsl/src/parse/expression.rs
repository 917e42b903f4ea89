//! Expressions: the grammar gives operands and operators in a flat list; here they get their
//! structure by precedence climbing.
//!
//! Depth is counted as the tree grows (every operator of a list may add one level). No input makes
//! a tree too deep for later recursive passes.

use pest::iterators::{Pair, Pairs};

use super::{Children, Context, Fallible, Rule};
use crate::diagnostic::{Diagnostic, codes};
use crate::span::Span;
use crate::syntax::{BinaryOp, Binder, BinderSet, Expr, ExprKind, Ident, UnaryOp};

/// Deepest expression tree.
const MAX_DEPTH: usize = 1000;

const NOT: u8 = 3;
const COMPARISON: u8 = 4;
const NEGATION: u8 = 7;
const POWER: u8 = 8;

/// An expression.
pub(super) fn expr(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Expr> {
    nested(context, pair, 0)
}

/// An expression inside another of the depth given.
fn nested(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<Expr> {
    let place = context.span(&pair);
    let pairs = pair.into_inner();
    let depth = depth + 1 + pairs.len() / 2;
    if depth > MAX_DEPTH {
        let message = "this expression is too long";
        let fault = Diagnostic::error(codes::TOO_LARGE, message, place).label(format!("more than {MAX_DEPTH} operations in one another"));
        return Err(Box::new(fault.help("name parts of it with `let`, or use `sum` over a set")));
    }
    Climber { context, pairs, depth }.climb(0)
}

struct Climber<'c, 't> {
    context: &'c Context<'c>,
    pairs: Pairs<'t, Rule>,
    depth: usize,
}

impl<'t> Climber<'_, 't> {
    /// An operand and the operators behind it that bind at least as tightly as `minimum`.
    fn climb(&mut self, minimum: u8) -> Fallible<Expr> {
        let mut left = self.operand()?;
        let mut compared: Option<Span> = None;
        while let Some((op, power, place)) = self.peek_infix() {
            if power < minimum {
                break;
            }
            self.pairs.next();
            if power == COMPARISON
                && let Some(first) = compared.replace(place)
            {
                return Err(Box::new(chained_comparison(first, place)));
            }
            let right = self.climb(if power == POWER { POWER } else { power + 1 })?;
            left = Expr { span: left.span.to(right.span), kind: ExprKind::Binary(op, Box::new(left), Box::new(right)) };
        }
        Ok(left)
    }

    fn peek_infix(&self) -> Option<(BinaryOp, u8, Span)> {
        let pair = self.pairs.peek().filter(|pair| pair.as_rule() == Rule::infix)?;
        let (op, power) = binary(pair.as_str());
        Some((op, power, self.context.span(&pair)))
    }

    fn operand(&mut self) -> Fallible<Expr> {
        let Some(pair) = self.pairs.next() else { return Err(self.missing_operand()) };
        if pair.as_rule() == Rule::prefix {
            return self.prefixed(&pair);
        }
        let mut operand = self.primary(pair)?;
        while let Some(rule) = self.pairs.peek().map(|pair| pair.as_rule()) {
            if !matches!(rule, Rule::index | Rule::member | Rule::as_unit) {
                break;
            }
            if let Some(pair) = self.pairs.next() {
                operand = self.postfix(operand, pair)?;
            }
        }
        Ok(operand)
    }

    fn prefixed(&mut self, pair: &Pair<'t, Rule>) -> Fallible<Expr> {
        let (op, power) = match pair.as_str() {
            "-" => (UnaryOp::Neg, NEGATION),
            "+" => (UnaryOp::Plus, NEGATION),
            _ => (UnaryOp::Not, NOT),
        };
        let operand = self.climb(power)?;
        Ok(Expr { span: self.context.span(pair).to(operand.span), kind: ExprKind::Unary(op, Box::new(operand)) })
    }

    fn primary(&mut self, pair: Pair<'t, Rule>) -> Fallible<Expr> {
        let context = self.context;
        let place = context.span(&pair);
        let kind = match pair.as_rule() {
            Rule::number => return self.number(&pair),
            Rule::paren => return self.paren(pair),
            Rule::name => return self.name(&pair),
            Rule::if_expr => return conditional(context, pair, self.depth),
            Rule::derivative => ExprKind::Derivative(Box::new(self.inner_operand(pair)?)),
            Rule::region => region(context, pair, self.depth)?,
            Rule::membership => membership(context, pair, self.depth)?,
            _ => return Err(self.missing_operand()),
        };
        Ok(Expr { span: place, kind })
    }

    fn number(&mut self, pair: &Pair<'t, Rule>) -> Fallible<Expr> {
        let context = self.context;
        let mut place = context.span(pair);
        let value = number_value(context, pair)?;
        let brackets = if self.next_is(Rule::unit_brackets) { self.pairs.next() } else { None };
        let unit = match brackets {
            Some(brackets) => {
                place = place.to(context.span(&brackets));
                Some(super::unit::brackets(context, brackets)?)
            }
            None => None,
        };
        Ok(Expr { span: place, kind: ExprKind::Number { value, unit } })
    }

    fn paren(&self, pair: Pair<'t, Rule>) -> Fallible<Expr> {
        let place = self.context.span(&pair);
        let mut items = list(self.context, pair, self.depth)?;
        let kind = match items.pop() {
            Some(single) if items.is_empty() => single.kind,
            Some(last) => {
                items.push(last);
                ExprKind::Tuple(items)
            }
            None => ExprKind::Tuple(items),
        };
        Ok(Expr { span: place, kind })
    }

    fn name(&mut self, pair: &Pair<'t, Rule>) -> Fallible<Expr> {
        let context = self.context;
        let place = context.span(pair);
        let kind = match pair.as_str() {
            "true" => ExprKind::Bool(true),
            "false" => ExprKind::Bool(false),
            _ => {
                let name = context.ident(pair)?;
                match self.next_is(Rule::arguments).then(|| self.pairs.next()).flatten() {
                    Some(arguments) => return call(context, name, arguments, self.depth),
                    None => ExprKind::Name(name),
                }
            }
        };
        Ok(Expr { span: place, kind })
    }

    fn next_is(&self, rule: Rule) -> bool {
        self.pairs.peek().is_some_and(|pair| pair.as_rule() == rule)
    }

    /// The operand behind `d/dt`.
    fn inner_operand(&self, pair: Pair<'t, Rule>) -> Fallible<Expr> {
        let mut pairs = pair.into_inner();
        pairs.next();
        Climber { context: self.context, depth: self.depth + pairs.len(), pairs }.operand()
    }

    fn postfix(&self, operand: Expr, pair: Pair<'t, Rule>) -> Fallible<Expr> {
        let place = operand.span.to(self.context.span(&pair));
        let operand = Box::new(operand);
        let kind = match pair.as_rule() {
            Rule::index => ExprKind::Index(operand, list(self.context, pair, self.depth)?),
            Rule::member => ExprKind::Member(operand, Children::new(pair).name(self.context)?),
            _ => {
                let mut children = Children::new(pair);
                children.skip(Rule::kw_as);
                let unit = children.expect(self.context, Rule::unit_brackets)?;
                ExprKind::As(operand, super::unit::brackets(self.context, unit)?)
            }
        };
        Ok(Expr { span: place, kind })
    }

    fn missing_operand(&self) -> Box<Diagnostic> {
        let place = crate::span::span(self.context.file, self.context.offset, self.context.offset);
        Box::new(Diagnostic::error(codes::SYNTAX, "expected an expression", place))
    }
}

fn chained_comparison(first: Span, second: Span) -> Diagnostic {
    Diagnostic::error(codes::CHAINED_COMPARISON, "comparisons do not chain", second)
        .label("second comparison")
        .secondary(first, "first comparison")
        .help("write `a < b and b < c`")
}

/// Operator and binding power.
fn binary(text: &str) -> (BinaryOp, u8) {
    match text {
        "or" => (BinaryOp::Or, 1),
        "and" => (BinaryOp::And, 2),
        "<" => (BinaryOp::Lt, COMPARISON),
        "<=" => (BinaryOp::Le, COMPARISON),
        ">" => (BinaryOp::Gt, COMPARISON),
        ">=" => (BinaryOp::Ge, COMPARISON),
        "==" => (BinaryOp::Eq, COMPARISON),
        "!=" => (BinaryOp::Ne, COMPARISON),
        "+" => (BinaryOp::Add, 5),
        "-" => (BinaryOp::Sub, 5),
        "*" => (BinaryOp::Mul, 6),
        "/" => (BinaryOp::Div, 6),
        _ => (BinaryOp::Pow, POWER),
    }
}

/// A number with its unit.
pub(super) fn size(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Expr> {
    let span = context.span(&pair);
    let mut children = Children::new(pair);
    let value = number_value(context, &children.expect(context, Rule::number)?)?;
    let unit = super::unit::brackets(context, children.expect(context, Rule::unit_brackets)?)?;
    Ok(Expr { span, kind: ExprKind::Number { value, unit: Some(unit) } })
}

/// The value of a number; one that is too large for double precision is refused.
pub(super) fn number_value(context: &Context<'_>, pair: &Pair<'_, Rule>) -> Fallible<f64> {
    let value = pair.as_str().parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| {
        let message = format!("`{}` is beyond double precision", pair.as_str());
        Box::new(Diagnostic::error(codes::BAD_NUMBER, message, context.span(pair)).help("write `inf` for infinity"))
    })
}

/// All expressions among the parts of a rule.
fn list(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<Vec<Expr>> {
    pair.into_inner().filter(|part| part.as_rule() == Rule::expr).map(|part| nested(context, part, depth)).collect()
}

fn call(context: &Context<'_>, function: Ident, pair: Pair<'_, Rule>, depth: usize) -> Fallible<Expr> {
    let place = function.span.to(context.span(&pair));
    let mut arguments = Vec::new();
    let mut reduction = None;
    for part in pair.into_inner() {
        match part.as_rule() {
            Rule::reduction => reduction = Some(part),
            Rule::named_argument => {
                let (name, value) = named(context, part, depth)?;
                match (function.text.as_str(), arguments.len(), name.text.as_str()) {
                    ("delay", 2, "before") => arguments.push(value),
                    ("interp", 1, _) => return Ok(Expr { span: place, kind: interpolation(function, arguments, name, value) }),
                    _ => return Err(Box::new(misnamed(&name))),
                }
            }
            _ => arguments.push(nested(context, part, depth)?),
        }
    }
    let kind = match (reduction, arguments.pop()) {
        (Some(pair), Some(body)) => reduce(context, function, body, pair, depth)?,
        (_, Some(single)) if arguments.is_empty() && function.text == "der" => ExprKind::Derivative(Box::new(single)),
        (_, last) => {
            arguments.extend(last);
            ExprKind::Call { function, arguments }
        }
    };
    Ok(Expr { span: place, kind })
}

/// `before = e`, `z = x`
fn named(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<(Ident, Expr)> {
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    children.skip(Rule::equals);
    let value = children.expect(context, Rule::expr).and_then(|value| nested(context, value, depth))?;
    Ok((name, value))
}

/// The fault of a named argument of a function that has none of this name there.
fn misnamed(name: &Ident) -> Diagnostic {
    let message = format!("`{} = ...` is not an argument of this function", name.text);
    let fault = Diagnostic::error(codes::SYNTAX, message, name.span);
    fault.help("the named arguments are `delay(e, theta, before = e0)` and `interp(T[z], z = x)`")
}

/// `interp(T[z], z = x)`: over the cells `z`, with the position in the place of the condition.
fn interpolation(function: Ident, body: Vec<Expr>, name: Ident, at: Expr) -> ExprKind {
    let binder = Binder { span: name.span.to(at.span), name, over: BinderSet::Itself, condition: None };
    let body = body.into_iter().next().map(Box::new).unwrap_or_else(|| Box::new(at.clone()));
    ExprKind::Reduce { function, body, binders: vec![binder], condition: Some(Box::new(at)) }
}

fn reduce(context: &Context<'_>, function: Ident, body: Expr, pair: Pair<'_, Rule>, depth: usize) -> Fallible<ExprKind> {
    let mut binders = Vec::new();
    let mut condition = None;
    for part in pair.into_inner() {
        match part.as_rule() {
            Rule::binder => binders.push(binder(context, part)?),
            Rule::expr => condition = Some(Box::new(nested(context, part, depth)?)),
            _ => {}
        }
    }
    Ok(ExprKind::Reduce { function, body: Box::new(body), binders, condition })
}

/// `if a then x else if b then y else z`: the list of conditions and values, folded from its end.
fn conditional(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<Expr> {
    let end = context.span(&pair).end;
    let branches = pair.clone().into_inner().filter(|part| part.as_rule() == Rule::kw_if).count();
    let starts: Vec<Span> =
        pair.clone().into_inner().filter(|part| part.as_rule() == Rule::kw_if).map(|part| context.span(&part)).collect();
    let mut parts = list(context, pair, depth + branches)?;
    let mut result = parts.pop().ok_or_else(|| Box::new(Diagnostic::error(codes::SYNTAX, "expected an expression", Span::default())))?;
    for start in starts.into_iter().rev() {
        let (Some(value), Some(condition)) = (parts.pop(), parts.pop()) else { break };
        let kind = ExprKind::If(Box::new(condition), Box::new(value), Box::new(result));
        result = Expr { span: Span { end, ..start }, kind };
    }
    Ok(result)
}

/// `outside bounds(x)`: a call of `outside` with one argument.
fn region(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<ExprKind> {
    let mut pairs = pair.into_inner();
    let word = pairs.next();
    let argument = Climber { context, depth: depth + pairs.len(), pairs }.operand()?;
    let span = word.as_ref().map_or(argument.span, |word| Span { end: context.span(word).start + 7, ..context.span(word) });
    let inside = word.is_some_and(|word| word.as_str().starts_with("inside"));
    let function = if inside {
        Ident { text: "inside".into(), span: Span { end: span.start + 6, ..span } }
    } else {
        Ident { text: "outside".into(), span }
    };
    Ok(ExprKind::Call { function, arguments: vec![argument] })
}

/// `i in solids`, `i in {A, B}`: a call of `in` with the index and what may be its members.
fn membership(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<ExprKind> {
    let mut arguments = Vec::new();
    let mut function = Ident { text: "in".to_owned(), span: context.span(&pair) };
    for part in pair.into_inner() {
        match part.as_rule() {
            Rule::kw_member => function.span = context.span(&part),
            Rule::set_sum => match set_sum(context, part, depth)? {
                Expr { kind: ExprKind::Tuple(list), .. } => arguments.extend(list),
                sum => arguments.push(sum),
            },
            _ => {
                let name = context.ident(&part)?;
                arguments.push(Expr { span: name.span, kind: ExprKind::Name(name) });
            }
        }
    }
    Ok(ExprKind::Call { function, arguments })
}

/// `species - solids`, `{A, B} + (s - {C})`: sums and differences of names and tuples.
pub(super) fn set_sum(context: &Context<'_>, pair: Pair<'_, Rule>, depth: usize) -> Fallible<Expr> {
    let whole = context.span(&pair);
    let (mut sum, mut op): (Option<Expr>, _) = (None, BinaryOp::Add);
    for part in pair.into_inner() {
        let place = context.span(&part);
        let term = match part.as_rule() {
            Rule::set_sign => {
                op = if part.as_str() == "-" { BinaryOp::Sub } else { BinaryOp::Add };
                continue;
            }
            Rule::set_sum => set_sum(context, part, depth)?,
            Rule::set_list => Expr { span: place, kind: ExprKind::Tuple(list(context, part, depth)?) },
            _ => Expr { span: place, kind: ExprKind::Name(context.ident(&part)?) },
        };
        sum = Some(match sum {
            None => term,
            Some(left) => Expr { span: left.span.to(term.span), kind: ExprKind::Binary(op, Box::new(left), Box::new(term)) },
        });
    }
    sum.ok_or_else(|| Box::new(Diagnostic::error(codes::SYNTAX, "expected a set", whole)))
}

/// A place such as `c[i, z]` or `M1.inlet.Q`: what may be assigned, connected or prescribed.
pub(super) fn place(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Expr> {
    let pairs = pair.into_inner();
    Climber { context, depth: pairs.len(), pairs }.operand()
}

/// `i in species`, `z`, `z in 2..n`, `x in (c_A, T)`
pub(super) fn binder(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Binder> {
    let span = context.span(&pair);
    let mut children = Children::new(pair);
    let name = children.name(context)?;
    if !children.skip(Rule::kw_in) {
        return Ok(Binder { name, over: BinderSet::Itself, condition: None, span });
    }
    if let Some(tuple) = children.take(Rule::binder_tuple) {
        return Ok(Binder { name, over: BinderSet::Tuple(list(context, tuple, 0)?), condition: None, span });
    }
    if let Some(sum) = children.take(Rule::set_sum) {
        let sum = set_sum(context, sum, 0)?;
        let over = match sum.kind {
            ExprKind::Name(set) => BinderSet::Set(set),
            ExprKind::Tuple(list) => BinderSet::Tuple(list),
            kind => BinderSet::Tuple(vec![Expr { span: sum.span, kind }]),
        };
        return Ok(Binder { name, over, condition: None, span });
    }
    let low = expr(context, children.expect(context, Rule::expr)?)?;
    let over = match (children.skip(Rule::dots), low.kind) {
        (true, kind) => {
            let high = expr(context, children.expect(context, Rule::expr)?)?;
            BinderSet::Range(Box::new(Expr { span: low.span, kind }), Box::new(high))
        }
        (false, _) => return Err(Box::new(bad_binder(low.span))),
    };
    Ok(Binder { name, over, condition: None, span })
}

fn bad_binder(span: Span) -> Diagnostic {
    Diagnostic::error(codes::BAD_BINDER, "an index runs over a set, a range or a list", span)
        .label("none of these")
        .help("write `i in species`, `z in 2..5` or `x in (c_A, T)`")
}

/// `for i in species, z`, where it was written.
pub(super) fn for_clause(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Vec<Binder>> {
    children.take(Rule::for_clause).map_or_else(|| Ok(Vec::new()), |pair| binders(context, pair))
}

/// All binders among the parts of a rule, the last one with the condition on them.
pub(super) fn binders(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Vec<Binder>> {
    let mut found: Vec<Binder> = Vec::new();
    for part in pair.into_inner() {
        match part.as_rule() {
            Rule::binder | Rule::set_binder => found.push(binder(context, part)?),
            Rule::only_if => {
                let mut inner = Children::new(part);
                inner.skip(Rule::kw_if);
                let condition = expr(context, inner.expect(context, Rule::expr)?)?;
                if let Some(last) = found.last_mut() {
                    last.condition = Some(Box::new(condition));
                }
            }
            _ => {}
        }
    }
    Ok(found)
}
