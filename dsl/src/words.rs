//! The words of the language: one list for the layout, the formatter, the parser and for those who
//! write texts.

/// First words of statements, and how each is formed, by an example for messages.
const STATEMENTS: &[(&str, Option<&str>)] = &[
    ("model", Some("model Name \"text\"")),
    ("use", Some("use Component as name(parameter = value)")),
    ("time", Some("time t : min")),
    ("unit", Some("unit USD, or unit kUSD = 1000 [USD]")),
    ("set", Some("set species = { a, b }")),
    ("table", None),
    ("def", Some("def f(a, b) = expression")),
    ("param", Some("param p : unit = value in low..high \"text\"")),
    ("action", Some("action u : unit = nominal in low..high \"text\"")),
    ("state", Some("state x : unit = initial in low..high \"text\"")),
    ("var", None),
    ("let", None),
    ("discrete", None),
    ("disturbance", None),
    ("random", None),
    ("eq", Some("eq left = right for i in species")),
    ("domain", Some("domain z in 0..L cells n scheme upwind")),
    ("flux", Some("flux J[z] = inner, low = value, high = value")),
    ("reaction", Some("reaction growth: S + 2 O2 -> 1.1 X rate mu*X")),
    ("connector", None),
    ("component", None),
    ("port", Some("port inlet, outlet : Stream")),
    ("connect", Some("connect M1.outlet -> R1.inlet")),
    ("initial", Some("initial x = 2, initial x ~ uniform(0, 1), initial eq p = 2 [bar], or initial d/dt x = 0")),
    ("steady", Some("name = value, between `{` and `}`")),
    ("observe", None),
    ("level", Some("level name { observe x }")),
    ("reward", Some("reward name default = expression \"text\"")),
    ("fail", Some("fail name when condition")),
    ("success", Some("success name when condition")),
    ("constraint", Some("constraint name when condition")),
    ("invariant", Some("invariant name = expression rate expression")),
    ("episode", Some("name = value, between `{` and `}`")),
    ("solver", Some("name = value, between `{` and `}`")),
    ("policy", Some("policy name { action = expression }")),
    ("at", Some("at start { statements }, or at every 3 [s] { statements }")),
    ("control", Some("control u from y setpoint r gain K reset T every 3 [s]")),
    ("next", Some("next x = expression")),
    ("reset", Some("reset x = expression")),
    ("clamp", Some("clamp x at value when condition")),
    ("event", Some("event name when condition")),
    ("phase", Some("phase name for 60 [min] then other")),
    ("test", Some("test \"name\" { statements }")),
    ("expect", Some("expect condition, or expect x within 1e-6 of value")),
    ("remove", Some("remove name, or remove eq d/dt x")),
    ("variant", Some("variant name \"text\" { statements }")),
    ("choice", Some("choice name = first | second")),
    ("when", Some("when choice = option { statements }")),
];

/// First words of statements.
pub fn keywords() -> impl Iterator<Item = &'static str> {
    STATEMENTS.iter().map(|(word, _)| *word)
}

/// Form of a statement, as an example.
#[must_use]
pub fn form(keyword: &str) -> Option<&'static str> {
    STATEMENTS.iter().find(|(word, _)| *word == keyword)?.1
}

/// Words that cannot be names.
const RESERVED: &[&str] = &["if", "then", "else", "and", "or", "not", "for", "in", "as", "true", "false"];

/// Words that may follow a name inside a statement, so that a keyword before them is an ordinary
/// name.
pub(crate) const CLAUSES: &[&str] = &[
    "if",
    "then",
    "else",
    "and",
    "or",
    "for",
    "in",
    "as",
    "every",
    "delay",
    "noise",
    "scale",
    "clip",
    "named",
    "nonnegative",
    "prefer",
    "default",
    "when",
    "rate",
    "until",
    "over",
    "cells",
    "extends",
];

/// First words of statements inside of a test, next to `expect` and the names of what it sets.
pub const IN_TESTS: &[&str] = &["start", "scenario", "level", "variant", "policy", "steps", "for"];

/// Returns `true` if the word cannot be a name.
#[must_use]
pub fn is_reserved(word: &str) -> bool {
    RESERVED.contains(&word)
}

/// Words that mean something in one place only.
const INSIDE: &[&str] = &["from", "linear", "cubic", "outside", "bounds", "dt"];

/// Returns `true` if the word has its own meaning somewhere in the language. A name may be one
/// where it is not a reserved word, but a writer of texts does better without. What is built in is
/// not among them.
#[must_use]
pub fn is_word(name: &str) -> bool {
    keywords().any(|word| word == name) || [RESERVED, CLAUSES, INSIDE].iter().any(|list| list.contains(&name))
}

/// Length of the name, keyword or unit symbol that a text begins with; otherwise zero.
///
/// A degree sign begins a unit, and a percent sign ends one: `mol%` is its own unit, and a blank in
/// between makes it another.
#[must_use]
pub fn word(text: &str) -> usize {
    let first = text.chars().next().unwrap_or(' ');
    if first == '\u{b0}' {
        return text[2..].find(|c: char| !c.is_ascii_alphanumeric()).map_or(text.len(), |end| end + 2);
    }
    if !first.is_ascii_alphabetic() && first != '_' {
        return 0;
    }
    let end = text.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(text.len());
    end + usize::from(text[end..].starts_with('%'))
}

/// Length of the number that a text begins with, which is a digit.
#[must_use]
pub fn number(text: &str) -> usize {
    let digits = |from: usize| text[from..].bytes().take_while(u8::is_ascii_digit).count();
    let mut end = digits(0);
    if text[end..].starts_with('.') && digits(end + 1) > 0 {
        end += 1 + digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
        let exponent = digits(end + 1 + sign);
        if exponent > 0 {
            end += 1 + sign + exponent;
        }
    }
    end
}
