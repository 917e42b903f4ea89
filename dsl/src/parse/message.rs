//! Syntax errors in words: what was expected, what is there, and what the slip probably was.

use pest::error::{Error, ErrorVariant, InputLocation};

use super::rules::{BRACKETS, END, EXPRESSION, OPERATOR, describe};
use super::{Context, Rule};
use crate::diagnostic::{Diagnostic, codes, did_you_mean, suggest};
use crate::span::span;
use crate::units::Unit;
use crate::words::form;

/// The diagnostic of a statement that the grammar refused.
pub(super) fn syntax_error(error: &Error<Rule>, text: &str, context: &Context<'_>, start: usize) -> Diagnostic {
    let at = match error.location {
        InputLocation::Pos(at) | InputLocation::Span((at, _)) => at.min(text.len()),
    };
    let found = token(&text[at..]);
    let place = if found.is_empty() || found == "\n" {
        span(context.file, context.offset + at, context.offset + at)
    } else {
        span(context.file, context.offset + at, context.offset + at + found.len())
    };
    if let Some((message, help)) = known_mistake(&text[..at], &text[at..], context.keyword) {
        return Diagnostic::error(codes::SYNTAX, message, place).help(help);
    }
    if found.is_empty()
        && context.keyword == "eq"
        && let Some(double) = text.find("==")
    {
        let place = span(context.file, context.offset + double, context.offset + double + 2);
        return Diagnostic::error(codes::SYNTAX, "an equation is written with `=`", place).help("write `=`; `==` compares");
    }
    let expected = expectation(error);
    let described = if found.is_empty() { "the end of the statement".to_owned() } else { shown(found) };
    let message = format!("expected {expected}, found {described}");
    let keyword = span(context.file, start, start + context.keyword.len());
    let mut fault = Diagnostic::error(codes::SYNTAX, message, place).label(format!("expected {expected}"));
    if !context.keyword.is_empty() {
        fault = fault.secondary(keyword, format!("in this `{}`", context.keyword));
    }
    fault.maybe_help(
        clause(error, found)
            .or_else(|| slip(&text[..at], &text[at..], context.keyword))
            .or_else(|| form(context.keyword).map(|form| format!("the form is `{form}`"))),
    )
}

/// Message and help for what is written elsewhere, and differently here.
fn known_mistake(before: &str, after: &str, keyword: &str) -> Option<(String, String)> {
    let found = token(after);
    let written = before.trim_end();
    let (message, help) = match found {
        "(" | ":" if keyword == "def" && !written.contains('=') => {
            let form =
                "write names only, `def f(a, b) = expression`: units are those of the arguments, and checked where the function is called";
            ("the parameters and the result of a `def` have no declared unit".to_owned(), form.to_owned())
        }
        _ if found.starts_with('"') && written.ends_with(['=', '!', '>', '<']) => {
            let name = found.trim_matches('"');
            let (left, operator) = comparison_before(written)?;
            ("a name is compared without quotes".to_owned(), format!("write `{left} {operator} {name}`"))
        }
        _ if matches!(keyword, "table" | "disturbance") && names_file(written) => {
            let known = ["step", "linear", "cubic"];
            let near = suggest(found, known).unwrap_or("linear");
            let file = &written[written.trim_end_matches('"').rfind('"').unwrap_or(0)..];
            (
                "the interpolation of the data is missing: `step`, `linear` or `cubic`".to_owned(),
                format!("write `from {file} {near}`; `step` holds each value until the next point"),
            )
        }
        ")" | "" | "\n" if lacks_else(before) => (
            "an `if` has an `else`, since it has a value in any case".to_owned(),
            "the form is `if condition then one else other`".to_owned(),
        ),
        _ if written.ends_with("d/dt") => return None,
        _ if found.starts_with(|c: char| c.is_ascii_alphabetic()) && rate_by_name(written).is_some() => {
            let variable = rate_by_name(written)?;
            let message = format!("`d/{variable}` is not an operator: a rate is written `d/dt`, whatever the time is called");
            (message, format!("write `d/dt {found}` for a rate, `div` of a flux or `grad` for a derivative along a domain"))
        }
        _ => return None,
    };
    Some((message, help))
}

/// Suggests a word of the grammar that is nearly what is there.
fn clause(error: &Error<Rule>, found: &str) -> Option<String> {
    let ErrorVariant::ParsingError { positives, .. } = &error.variant else { return None };
    let words = positives.iter().map(|rule| describe(*rule).trim_matches('`'));
    let words = words.filter(|word| word.len() > 3 && word.chars().all(|c| c.is_ascii_alphabetic()));
    if found.len() > 3 { did_you_mean(found, words) } else { None }
}

/// Returns `true` if a text ends in the name of a data file.
fn names_file(text: &str) -> bool {
    let rest = text.strip_suffix('"').and_then(|rest| rest.rfind('"').map(|at| &rest[..at]));
    rest.is_some_and(|rest| rest.trim_end().ends_with(" from"))
}

/// Left side and operator of a comparison that a text ends in.
fn comparison_before(text: &str) -> Option<(&str, &str)> {
    let operator = ["==", "!="].into_iter().find(|operator| text.ends_with(operator))?;
    let rest = text[..text.len() - operator.len()].trim_end();
    let start = rest.rfind(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != '.').map_or(0, |at| at + 1);
    let name = &rest[start..];
    (!name.is_empty()).then_some((name, operator))
}

/// `dz` of a text that ends in `d/dz`.
fn rate_by_name(text: &str) -> Option<&str> {
    let at = text.rfind("d/d")?;
    let apart = !text[..at].ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    let variable = &text[at + 2..];
    (apart && variable.len() > 1 && variable.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')).then_some(variable)
}

/// Returns `true` if a text has an `if .. then` without its `else`.
fn lacks_else(text: &str) -> bool {
    let words = || text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let count = |word: &str| words().filter(|w| *w == word).count();
    count("then") > count("else")
}

/// The token that a text begins with.
fn token(text: &str) -> &str {
    let Some(first) = text.chars().next() else { return "" };
    let length = match first {
        '"' => text[1..].find('"').map_or(text.len(), |end| end + 2),
        c if c.is_ascii_alphanumeric() => text.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(text.len()),
        c => ["->", "..", ":=", "**", "==", "<=", ">=", "!="]
            .iter()
            .find(|pair| text.starts_with(**pair))
            .map_or(c.len_utf8(), |pair| pair.len()),
    };
    &text[..length]
}

fn shown(token: &str) -> String {
    match token {
        "\n" => "the end of the line".to_owned(),
        _ if token.starts_with('"') => "a text".to_owned(),
        _ => format!("`{token}`"),
    }
}

/// Expected tokens, in at most a few words.
fn expectation(error: &Error<Rule>) -> String {
    let ErrorVariant::ParsingError { positives, .. } = &error.variant else { return "something else".to_owned() };
    let mut phrases: Vec<&str> = Vec::new();
    for phrase in positives.iter().map(|rule| describe(*rule)).filter(|phrase| !phrase.is_empty()) {
        if !phrases.contains(&phrase) {
            phrases.push(phrase);
        }
    }
    if phrases.len() > 3 && phrases.contains(&OPERATOR) {
        phrases.retain(|phrase| [OPERATOR, END].contains(phrase));
    }
    for (general, covered) in [(EXPRESSION, "a name"), ("a unit", EXPRESSION)] {
        if phrases.contains(&general) {
            phrases.retain(|phrase| *phrase != covered);
        }
    }
    if phrases.len() > 1 {
        phrases.retain(|phrase| *phrase != BRACKETS);
    }
    phrases.sort_by_key(|phrase| *phrase == END);
    phrases.truncate(5);
    match phrases.split_last() {
        None => "something else".to_owned(),
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
    }
}

/// The slip that most probably led here.
fn slip(before: &str, after: &str, keyword: &str) -> Option<String> {
    let found = token(after);
    let last = before.trim_end().chars().last().unwrap_or(' ');
    let next = found.chars().next().unwrap_or(' ');
    let hint = match found {
        ":=" => "write `=`; there is no `:=`",
        "=" if last == ':' => "write `=`; there is no `:=`",
        "**" | "*" if found == "**" || last == '*' => "a power is written `^`: `x^2`",
        "=" if matches!(keyword, "fail" | "success" | "constraint" | "event" | "clamp" | "reward" | "let") => "to compare write `==`",
        "{" if matches!(keyword, "eq" | "let" | "param") => "group with parentheses",
        "~" if before.contains(" in ") => "write the distribution before the bounds: `= value ~ uniform(a, b) in low..high`",
        "clip" if before.contains(" in ") => "put `clip` before the bounds: `~ uniform(a, b) clip bounds in low..high`",
        "" if keyword == "eq" && before.contains("==") => "here `=` defines; `==` compares",
        "==" => "here `=` defines; `==` compares",
        "else" if before.rfind("if ").is_some_and(|at| !before[at..].contains(" then ")) => {
            "the form is `if condition then one else other`"
        }
        "{" if keyword == "table" && before.contains(" over ") => {
            "the form is `table f : unit over time : h linear { 0: 1, 2: 3 }`, with `linear`, `from` or `until`"
        }
        _ if next.is_ascii_digit() && ends_in_decimal_comma(before) => "decimals follow a point: `1.5`; a comma separates declarations",
        "&" | "&&" => "write `and`",
        "|" => "write `or`",
        "elseif" | "elsif" | "elif" | "ELSEIF" => "write `else if`",
        "then" if keyword == "when" && !before.contains("==") => {
            "an event is declared by `event name when condition`; what happens then is in `at name { ... }`"
        }
        "!" => "write `not`",
        ";" => "entries are separated by commas or newlines",
        "(" if keyword == "use" && !before.contains(" as ") => "arguments follow the name of the instance: `use Bed as B(n = 2)`",
        "." if last.is_ascii_digit() => "a number has digits on both sides of the point: `1.0`",
        "." => "a number begins with a digit: `0.5`",
        "/" if before.trim_end().ends_with("d") || after.starts_with("/dt") => "a rate is written `d/dt x`",
        _ if keyword == "table" && before.contains(']') && before.trim_end().ends_with('=') => {
            "a table has a value for each member: `table a[set] = { first: 1, second: 2 }`, or one for all: `table a[set] default 1 { }`"
        }
        _ if is_rate_slip(before, after) => "a rate is written `d/dt x`",
        _ if last.is_ascii_digit() && Unit::named(found).is_some() => {
            let number = last_number(before);
            return Some(format!("a unit is written in brackets: `{number} [{found}]`; to multiply write `*`"));
        }
        "(" if last.is_ascii_digit() && Unit::named(inside(after)).is_some() => {
            let number = last_number(before);
            return Some(format!("a unit is written in brackets: `{number} [{}]`", inside(after)));
        }
        _ if last.is_ascii_digit() && next.is_ascii_alphabetic() => {
            return Some(format!("use `*` to multiply, or write a unit in brackets: `[{found}]`"));
        }
        "(" if last == ')' || last.is_ascii_digit() => "to multiply write `*`",
        _ if last == ')' && (next.is_ascii_alphanumeric()) => "to multiply write `*`",
        _ if next.is_ascii_digit() && (last.is_ascii_alphanumeric() || last == ')') => "to multiply write `*`",
        _ => return None,
    };
    Some(hint.to_owned())
}

/// The number that a text ends in.
fn last_number(text: &str) -> &str {
    let text = text.trim_end();
    let start = text.rfind(|c: char| !c.is_ascii_digit() && c != '.').map_or(0, |at| at + 1);
    &text[start..]
}

/// Content of the parentheses that a text begins with.
fn inside(text: &str) -> &str {
    text.strip_prefix('(').and_then(|rest| rest.split_once(')')).map_or("", |(inside, _)| inside.trim())
}

/// Returns `true` if a number and a comma are before.
fn ends_in_decimal_comma(before: &str) -> bool {
    before.strip_suffix(',').is_some_and(|number| number.ends_with(|c: char| c.is_ascii_digit()))
}

/// `d x/dt` and `dx/dt = ...` are read as names and divisions.
fn is_rate_slip(before: &str, after: &str) -> bool {
    let before = before.trim_end();
    before == "d" && after.contains("/dt")
}

/// Message for a line that does not begin with a keyword.
pub(super) fn statement_hint(word: &str, text: &str, around: &str) -> Option<String> {
    let rest = text[word.len()..].trim_start();
    if around == "at" && !word.is_empty() && text.contains('=') {
        let place = text.split('=').next().unwrap_or(word).trim();
        return Some(format!("what an instant sets begins with `next` (discrete variables) or `reset` (states): `reset {place} = ...`"));
    }
    let equation = text.starts_with("d/dt") || text.starts_with("der(");
    if equation {
        return Some("an equation begins with `eq`: `eq d/dt x = ...`".to_owned());
    }
    let hint = match word {
        "parameter" | "parameters" | "const" | "constant" => "parameters are declared with `param`",
        "variable" | "algebraic" => "algebraic variables are declared with `var`",
        "equation" | "equations" => "an equation begins with `eq`",
        "input" => "inputs that are manipulated are declared with `action`",
        "output" => "what is seen is listed with `observe`",
        "function" | "fn" => "a function is declared with `def`",
        "import" | "include" => "a file is imported with `use \"file.eq\"`",
        "init" => "initial values are set with `initial`",
        "reinit" => "at an instant a state is set by `reset x = ...`",
        "Real" | "Integer" | "Boolean" => "an unknown is declared with `state` where it has a rate, else with `var`",
        "extends" => "a component builds on another one by `component B extends A { ... }`",
        "annotation" => "a text that describes follows a declaration in double quotes; there are no annotations",
        "flow" => "a flow is declared in its connector: `connector Heat { T : K, flow Q : W }`",
        "else" => "a `when` has no `else`; write a second `when`",
        _ if word.is_empty() => return None,
        _ if rest.starts_with(":=") => "write `let name = expression`; there is no `:=`",
        _ if rest.starts_with('=') && !rest.starts_with("==") => {
            return Some(format!("to define write `let {word} = ...`; an equation begins with `eq`"));
        }
        _ => return None,
    };
    Some(hint.to_owned())
}
