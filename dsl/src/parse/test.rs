//! Statements inside of `test "name" { ... }`.

use pest::Parser;
use pest::iterators::Pair;

use super::grammar::Grammar;
use super::{Children, Context, Fallible, Rule, expression, message};
use crate::diagnostic::{Diagnostic, codes, did_you_mean};
use crate::layout::RawStatement;
use crate::span::{FileId, span};
use crate::syntax::{Expect, Ident, Statement, StatementKind, TestStep};
use crate::words::{IN_TESTS, keywords};

/// `test "rises" { ... }`
pub(super) fn test(context: &Context<'_>, mut children: Children<'_>, body: Vec<Statement>) -> Fallible<StatementKind> {
    let text = children.expect(context, Rule::text)?;
    let (name, quoted) = (Context::text(&text), context.span(&text));
    let name_span = crate::span::Span { start: quoted.start + 1, end: quoted.end.saturating_sub(1), ..quoted };
    Ok(StatementKind::Test { name, name_span, body })
}

/// A statement of a test; a run behind it, `for 40 [h]`, is a separate statement.
pub(super) fn statement(file: FileId, raw: &RawStatement, text: &str, word: &str) -> Fallible<Vec<StatementKind>> {
    let rest = text[word.len()..].trim_start();
    let assigns = rest.starts_with(['[', '.']) || rest.starts_with('=') && !rest.starts_with("==");
    let known = IN_TESTS.iter().chain(&["expect"]).find(|known| **known == word);
    let (rule, text) = match known {
        Some(_) if assigns => (Rule::assign, text),
        Some(&"expect") => (Rule::expect, rest),
        Some(&("steps" | "for")) => (Rule::run, rest),
        Some(_) => (Rule::choose, rest),
        None if assigns => (Rule::assign, text),
        None => return Err(Box::new(unknown(file, raw, word))),
    };
    let context = Context { file, offset: raw.end - text.len(), keyword: known.map_or("test", |known| known) };
    let pairs = Grammar::parse(rule, text).map_err(|error| Box::new(message::syntax_error(&error, text, &context, raw.start)))?;
    let mut children = Children::of_statement(pairs);
    let word = Ident { text: word.to_owned(), span: span(file, raw.start, raw.start + word.len()) };
    let mut steps = vec![match rule {
        Rule::assign => assign(&context, &mut children)?,
        Rule::expect => TestStep::Expect(expect(&context, &mut children)?),
        Rule::run => run(&context, &word, &mut children)?,
        _ => choose(&context, word, &mut children)?,
    }];
    children.skip(Rule::text);
    if let Some(pair) = children.take(Rule::run_for) {
        steps.push(TestStep::For(super::declaration::only_expr(&context, pair)?));
    }
    Ok(steps.into_iter().map(StatementKind::TestStep).collect())
}

fn unknown(file: FileId, raw: &RawStatement, word: &str) -> Diagnostic {
    let place = span(file, raw.start, raw.start + word.len().max(1));
    let (message, help) = if keywords().any(|known| known == word) {
        (format!("`{word}` does not belong in a test"), "move it out of the test".to_owned())
    } else {
        let near = did_you_mean(word, IN_TESTS.iter().copied().chain(["expect"]));
        let words = "write `start`, `NAME = value`, `steps`, `for` or `expect`".to_owned();
        (format!("`{word}` begins no statement of a test"), near.unwrap_or(words))
    };
    Diagnostic::error(codes::UNKNOWN_STATEMENT, message, place).label("not a statement of a test").help(help)
}

fn assign(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<TestStep> {
    let target = expression::place(context, children.expect(context, Rule::place)?)?;
    children.skip(Rule::equals);
    Ok(TestStep::Assign { target, value: expression::expr(context, children.expect(context, Rule::expr)?)? })
}

fn run(context: &Context<'_>, word: &Ident, children: &mut Children<'_>) -> Fallible<TestStep> {
    let amount = expression::expr(context, children.expect(context, Rule::expr)?)?;
    Ok(if word.text == "steps" { TestStep::Steps(amount) } else { TestStep::For(amount) })
}

fn choose(context: &Context<'_>, word: Ident, children: &mut Children<'_>) -> Fallible<TestStep> {
    let name = match children.take(Rule::text) {
        Some(text) => Ident { text: Context::text(&text), span: context.span(&text) },
        None => children.name(context)?,
    };
    let option = if children.skip(Rule::equals) { Some(context.word(&children.expect(context, Rule::option)?)) } else { None };
    if let Some(option) = option.as_ref().filter(|_| word.text != "variant") {
        let fault = Diagnostic::error(codes::SYNTAX, format!("`{}` takes a name alone", word.text), option.span);
        return Err(Box::new(fault.help(format!("write `{} {}`", word.text, name.text))));
    }
    Ok(match word.text.as_str() {
        "start" => TestStep::Start(name),
        "policy" => TestStep::Policy(name),
        _ => TestStep::Choose { word, name, option },
    })
}

fn expect(context: &Context<'_>, children: &mut Children<'_>) -> Fallible<Expect> {
    if let Some(pair) = children.take(Rule::outcome) {
        return outcome(context, pair);
    }
    let value = expression::expr(context, children.expect(context, Rule::expr)?)?;
    let Some(within) = children.take(Rule::within) else { return Ok(Expect::Holds(value)) };
    let mut within = Children::new(within);
    within.skip(Rule::kw_within);
    let tolerance = expression::expr(context, within.expect(context, Rule::expr)?)?;
    within.skip(Rule::kw_of);
    Ok(Expect::Within { value, tolerance, target: expression::expr(context, within.expect(context, Rule::expr)?)? })
}

fn outcome(context: &Context<'_>, pair: Pair<'_, Rule>) -> Fallible<Expect> {
    let place = context.span(&pair);
    let mut children = Children::new(pair);
    let word = children.expect(context, Rule::outcome_word)?;
    let name = children.take(Rule::name).map(|name| context.ident(&name)).transpose()?;
    let tolerance = match children.take(Rule::kw_within) {
        Some(_) => Some(expression::expr(context, children.expect(context, Rule::expr)?)?),
        None => None,
    };
    match (word.as_str(), name, tolerance) {
        ("failure", name, None) => Ok(Expect::Failure(name)),
        ("success", name, None) => Ok(Expect::Success(name)),
        ("steady", None, tolerance) => Ok(Expect::Steady(tolerance)),
        (word, ..) => {
            let message = format!("`expect {word}` with a part that it does not take");
            let help = "write `expect failure NAME`, `expect success NAME` or `expect steady within 1e-6`";
            Err(Box::new(Diagnostic::error(codes::SYNTAX, message, place).help(help)))
        }
    }
}
