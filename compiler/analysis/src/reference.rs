//! Entries of the language's reference: built-in names, statement keywords, units and codes of diagnostics.

use smpl_compiler::elaborate::{BUILTINS, Builtin, built_in_names};
use smpl_dsl::diagnostic::{Code, codes};
use smpl_dsl::units::{Unit, prefixes, symbols};
use smpl_dsl::words;

/// The page of the book with an example of every code.
pub const EXAMPLES: &str = include_str!("../../../docs/diagnostics-examples.md");

/// Whether a name or function is built in.
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
    let meaning = crate::complete::keyword_meaning(keyword);
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
    /// The section in Markdown, without its heading: meaning, wrong text, what is reported, right text.
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
    fn every_code_has_an_entry_with_its_meaning() {
        for code in all_codes() {
            let entry = explain(code.id());
            assert!(entry.is_some_and(|entry| entry.section.starts_with(code.explanation())), "{}", code.id());
        }
    }

    #[test]
    fn units_are_explained_with_their_size_and_dimension() {
        assert_eq!(unit("kJ").as_deref(), Some("`kJ` = 1000 kg m^2/s^2\n\n10^3 joule, unit of energy"));
        assert!(unit("°C").is_some_and(|text| text.contains("temperature")));
        assert_eq!(unit("parsec"), None);
    }
}
