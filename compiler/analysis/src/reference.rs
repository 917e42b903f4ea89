//! Entries of the language's reference: built-in names, statement keywords, units and codes of
//! diagnostics.

use smpl_compiler::elaborate::{BUILTINS, Builtin, built_in_names};
use smpl_dsl::diagnostic::{Code, codes};
use smpl_dsl::units::{Unit, prefixes, symbols};
use smpl_dsl::words;

/// The page of the book with an example of every code.
pub const EXAMPLES: &str = include_str!("../../../docs/diagnostics-examples.md");

/// Statement keywords: what they do, and a snippet.
pub(crate) const STATEMENTS: &[(&str, &str, &str)] = &[
    ("model", "names the model", "model ${1:Name} \"${2:text}\""),
    ("use", "imports a file or makes an instance of a component", "use ${1:Component} as ${2:name}($3)"),
    ("time", "names the independent variable and its unit", "time ${1:t} : ${2:min}"),
    ("unit", "declares a unit of measure: one of a new dimension, or a multiple of another unit", "unit ${1:kUSD} = ${2:1000} [${3:USD}]"),
    ("set", "declares an index set", "set ${1:species} = { ${2:a, b} }"),
    ("table", "declares numbers over sets or over time", "table ${1:name}[${2:set}] : ${3:unit} = {\n  ${4:member}: ${5:0}\n}"),
    ("def", "declares a function", "def ${1:f}(${2:x}) = ${3:x}"),
    ("param", "declares a constant of an episode", "param ${1:k} : ${2:1/min} = ${3:1} \"${4:text}\""),
    ("action", "declares an input that is held over a step", "action ${1:u} : ${2:L/min} = ${3:0} in ${4:0}..${5:1} \"${6:text}\""),
    ("state", "declares a differential state", "state ${1:x} : ${2:mol/L} = ${3:0} in ${4:0}..${5:1} \"${6:text}\""),
    ("var", "declares an algebraic variable, determined by an equation", "var ${1:y} : ${2:mol/L} \"${3:text}\""),
    ("let", "names an expression", "let ${1:y} = ${2:expression}"),
    ("discrete", "declares a variable that changes at sampling instants", "discrete ${1:x} : ${2:1} = ${3:0} \"${4:text}\""),
    (
        "disturbance",
        "declares an exogenous sequence, drawn or from a file",
        "disturbance ${1:d} : ${2:1} = ${3:0} ~ ${4:normal(0, 1)} \"${5:text}\"",
    ),
    ("random", "declares a random number that is drawn at reset", "random ${1:zeta} ~ ${2:normal(0, 1)} \"${3:text}\""),
    ("eq", "states an equation", "eq ${1:d/dt x} = ${2:expression}"),
    ("domain", "declares a spatial domain", "domain ${1:z} in ${2:0}..${3:L} cells ${4:20} scheme ${5:upwind}"),
    ("flux", "declares a flux along a domain", "flux ${1:J}[${2:z}] = ${3:v*c[z]}, low = ${4:v*c_in}"),
    ("reaction", "declares a reaction of the species of a set, with its rate", "reaction ${1:growth}: ${2:S} -> ${3:0.5 X} rate ${4:mu*X}"),
    ("connector", "declares what flows through ports", "connector ${1:Stream} { ${2:Q : L/min} }"),
    ("component", "declares a unit that can be used many times", "component ${1:Name} \"${2:text}\" {\n  $0\n}"),
    ("port", "declares the ports of a component", "port ${1:inlet, outlet} : ${2:Stream}"),
    ("connect", "connects ports", "connect ${1:A.outlet} -> ${2:B.inlet}"),
    (
        "initial",
        "sets or draws the start of a state, or states a condition at the start: `initial eq p = 2 [bar]`",
        "initial ${1:x} ~ ${2:uniform(0.5, 1.5)}",
    ),
    ("steady", "sets actions and states of the steady state", "steady { ${1:u} = ${2:0} }"),
    ("observe", "lists what the agent observes", "observe ${1:x}"),
    ("level", "names a set of observations", "level ${1:online} \"${2:text}\" {\n  observe ${3:x}\n}"),
    ("reward", "declares a reward", "reward ${1:name} ${2:default} = ${3:expression} \"${4:text}\""),
    ("fail", "declares a condition that ends the episode as a failure", "fail ${1:name} when ${2:outside bounds(x)} \"${3:text}\""),
    ("success", "declares a condition that ends the episode as a success", "success ${1:name} when ${2:condition} \"${3:text}\""),
    ("constraint", "declares a limit whose violation is reported", "constraint ${1:name} when ${2:x > limit} \"${3:text}\""),
    ("invariant", "declares a quantity that the equations keep", "invariant ${1:name} = ${2:expression}"),
    ("episode", "sets the sampling interval and the length of an episode", "episode { step = ${1:1} [${2:min}], max_steps = ${3:100} }"),
    ("solver", "sets options of the solver", "solver { ${1:rtol} = ${2:1e-6} }"),
    ("policy", "names open-loop values of the actions", "policy ${1:nominal} { ${2:u} = ${3:0} }"),
    ("at", "holds what happens at an instant", "at ${1:start} {\n  $0\n}"),
    (
        "control",
        "sets a discrete variable by a PI controller at regular instants",
        "control ${1:u} from ${2:y} setpoint ${3:r} gain ${4:K} reset ${5:T} every ${6:3} [${7:s}]",
    ),
    ("next", "updates a discrete variable", "next ${1:x} = ${2:expression}"),
    ("reset", "sets a state at an instant", "reset ${1:x} = ${2:expression}"),
    ("clamp", "limits a state at an instant", "clamp ${1:x} at ${2:value} when ${3:condition}"),
    ("event", "names a condition that is located in time", "event ${1:name} when ${2:condition}"),
    ("phase", "declares a phase of a schedule", "phase ${1:name} for ${2:60} [${3:min}] then ${4:next}"),
    ("test", "declares a test that `smpl test` runs", "test \"${1:name}\" {\n  steps ${2:3}\n  expect ${3:x > 0}\n}"),
    ("expect", "states what a test expects", "expect ${1:x} within ${2:1e-6} of ${3:1}"),
    ("remove", "takes a statement out, inside of a variant", "remove ${1:name}"),
    ("variant", "declares an alternative that can be turned on", "variant ${1:name} \"${2:text}\" {\n  $0\n}"),
    ("choice", "declares alternatives of which one is chosen", "choice ${1:name} = ${2:first} | ${3:second} \"${4:text}\""),
    ("when", "holds the statements of an option", "when ${1:choice} = ${2:option} {\n  $0\n}"),
];

/// Effect of a statement keyword, in a few words.
#[must_use]
pub fn keyword_meaning(keyword: &str) -> &'static str {
    STATEMENTS.iter().find(|(word, ..)| *word == keyword).map_or("a statement", |(_, meaning, _)| meaning)
}

/// Returns whether a name or function is built in.
#[must_use]
pub fn is_built_in(name: &str) -> bool {
    smpl_compiler::elaborate::is_built_in(name) || matches!(name, "bounds" | "phase" | "steps")
}

/// A built-in function.
#[must_use]
pub fn function(name: &str) -> Option<&'static Builtin> {
    BUILTINS.iter().find(|builtin| builtin.name == name)
}

/// Usage of a built-in function without its second form: `value(x)`.
#[must_use]
pub fn usage(builtin: &Builtin) -> &'static str {
    builtin.usage.split('`').next().unwrap_or(builtin.usage)
}

/// The entry of a built-in name in Markdown.
#[must_use]
pub fn built_in(name: &str) -> Option<String> {
    if let Some(builtin) = function(name) {
        return Some(format!("```eq\n{}\n```\nBuilt-in function: {}.", usage(builtin), builtin.meaning));
    }
    let (name, meaning) = built_in_names().find(|(known, _)| *known == name)?;
    Some(format!("```eq\n{name}\n```\nBuilt-in name: {meaning}."))
}

/// The entry of a statement keyword in Markdown.
#[must_use]
pub fn keyword(word: &str) -> Option<String> {
    let keyword = words::keywords().find(|known| *known == word)?;
    let meaning = keyword_meaning(keyword);
    let form = words::form(keyword).map(|form| format!("```eq\n{form}\n```\n")).unwrap_or_default();
    Some(format!("{form}`{keyword}`: {meaning}."))
}

/// The entry of a unit symbol in Markdown.
#[must_use]
pub fn unit(symbol: &str) -> Option<String> {
    let plain = symbol.replace('°', "deg");
    let unit = Unit::named(&plain)?;
    let name = unit_name(&plain).unwrap_or_default();
    let dimension = unit.dimension();
    let si = dimension.to_string();
    let size = unit.scale().value();
    let size = if unit.is_point() { String::new() } else { format!(" = {} {si}", shown(size)) };
    Some(format!("`{symbol}`{size}\n\n{name}{}{}", if name.is_empty() { "" } else { ", unit of " }, dimension.describe()))
}

/// The name of a unit symbol in words, with its prefix.
fn unit_name(symbol: &str) -> Option<String> {
    if let Some(known) = symbols().iter().find(|known| known.symbol == symbol) {
        return Some(known.name.to_owned());
    }
    prefixes().iter().find_map(|prefix| {
        let rest = symbol.strip_prefix(prefix.symbol)?;
        let known = symbols().iter().find(|known| known.prefixed && known.symbol == rest)?;
        Some(format!("10^{} {}", prefix.exponent, known.name))
    })
}

/// A number as people write it: at most six digits.
#[must_use]
pub fn shown(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    let plain = rounded.to_string();
    if plain.len() <= 9 { plain } else { format!("{rounded:e}") }
}

/// The anchor of a code on the page of examples.
#[must_use]
pub fn anchor(code: Code) -> String {
    code.id().to_ascii_lowercase()
}

/// An entry of the book's page of diagnostics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Explanation {
    /// The code.
    pub code: Code,
    /// The section in Markdown, without its heading: meaning, wrong text, what is reported, right
    /// text.
    pub section: &'static str,
}

/// The entry of a code, by its number (`E0302`) or its whole identifier.
#[must_use]
pub fn explain(code: &str) -> Option<Explanation> {
    let code = Code::find(code)?;
    let heading = format!("\n## {}\n", code.id());
    let start = EXAMPLES.find(&heading)? + heading.len();
    let rest = &EXAMPLES[start..];
    let section = rest.find("\n## ").map_or(rest, |end| &rest[..end]).trim();
    Some(Explanation { code, section })
}

/// All codes.
pub fn all_codes() -> impl Iterator<Item = Code> {
    codes::ALL.iter().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_statement_keyword_has_a_snippet() {
        for keyword in words::keywords() {
            assert!(STATEMENTS.iter().any(|(word, ..)| *word == keyword), "{keyword}");
        }
    }

    #[test]
    fn every_code_has_an_entry_with_its_meaning() {
        for code in all_codes() {
            let entry = explain(code.id());
            assert!(entry.is_some_and(|entry| entry.section.starts_with(code.explanation())), "{}", code.id());
        }
    }

    #[test]
    fn units_are_explained_with_their_size_and_dimension() {
        assert_eq!(unit("kJ").as_deref(), Some("`kJ` = 1000 m^2 kg/s^2\n\n10^3 joule, unit of energy"));
        assert!(unit("°C").is_some_and(|text| text.contains("temperature")));
        assert_eq!(unit("parsec"), None);
    }
}
