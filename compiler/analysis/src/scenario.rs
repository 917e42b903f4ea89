//! Scenario files: keys that name symbols of a model.

use std::ops::Range;

use crate::check::Facts;
use crate::complete::{Completion, Proposal, ProposalKind};
use crate::hover::{Hover, describe, unit_of};
use crate::program::Program;
use crate::symbols::{SymbolId, SymbolKind};
use crate::token::{is_word, word_at};

/// Keys of a scenario, with what each holds.
pub const SECTIONS: &[(&str, &str)] = &[
    ("parameters", "values of parameters in their declared units"),
    ("settings", "values of settings: grid sizes, choices, entries of `episode` and `solver`"),
    ("variants", "variants that are on and options of choices, `name` or `choice=option`"),
    ("grid", "numbers of cells"),
    ("initial", "initial values or distributions of states"),
    ("disturbances", "`true`, `false`, or recorded values"),
    ("reward", "the reward that is returned"),
    ("observation", "the level of observation"),
    ("noise", "`true`, `false`, or standard deviations of observations"),
    ("solver", "options of the solver"),
    ("max_steps", "number of steps of an episode"),
];

/// A key or item under a section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// Section, such as `parameters`.
    pub section: String,
    /// Bytes of the name; of a section without entries its scalar value.
    pub name: Range<usize>,
}

/// Keys of a scenario file, line by line; texts that are not YAML give what can be recognised.
#[must_use]
pub fn keys(text: &str) -> Vec<Key> {
    let mut out = Vec::new();
    let mut section = String::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let content = &line[..comment_start(line)];
        let indent = content.len() - content.trim_start().len();
        if !content.trim().is_empty() {
            if indent == 0
                && !content.starts_with('-')
                && let Some((name, rest)) = content.split_once(':')
            {
                section = name.trim().to_owned();
                inline(rest, start + content.len() - rest.len(), &section, &mut out);
            } else {
                let dash = content.trim_start().starts_with('-');
                let from = indent + usize::from(dash);
                entry(&content[from..], start + from, &section, &mut out);
            }
        }
        start += line.len();
    }
    out
}

/// Offset of the comment of a line.
fn comment_start(line: &str) -> usize {
    let mut quote = None;
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (None, '"' | '\'') => quote = Some(c),
            (Some(q), c) if q == c => quote = None,
            (None, '#') if at == 0 || line[..at].ends_with([' ', '\t']) => return at,
            _ => {}
        }
    }
    line.len()
}

/// `{a: 1, b: 2}`, `[x, y=z]` or a scalar behind a key.
fn inline(rest: &str, start: usize, section: &str, out: &mut Vec<Key>) {
    let trimmed = rest.trim();
    let lead = start + rest.len() - rest.trim_start().len();
    match trimmed.chars().next() {
        Some('{' | '[') => {
            let inner = trimmed[1..].trim_end_matches(['}', ']']);
            let mut at = lead + 1;
            for part in parts(inner) {
                entry(part, at, section, out);
                at += part.len() + 1;
            }
        }
        Some(_) if matches!(section, "reward" | "observation") => entry(rest, start, section, out),
        _ => {}
    }
}

/// Parts between commas outside of brackets.
fn parts(text: &str) -> Vec<&str> {
    let (mut depth, mut from, mut out) = (0_i32, 0, Vec::new());
    for (at, c) in text.char_indices() {
        match c {
            '[' | '{' | '(' => depth += 1,
            ']' | '}' | ')' => depth -= 1,
            ',' if depth == 0 => {
                out.push(&text[from..at]);
                from = at + 1;
            }
            _ => {}
        }
    }
    out.push(&text[from..]);
    out
}

/// `name: value`, `choice=option` or `name`.
fn entry(text: &str, start: usize, section: &str, out: &mut Vec<Key>) {
    let from = text.len() - text.trim_start().len();
    let rest = text.trim_start();
    let (quoted, rest, from) = match rest.strip_prefix(['"', '\'']) {
        Some(inner) => (true, inner, from + 1),
        None => (false, rest, from),
    };
    let end = if quoted { rest.find(['"', '\'']) } else { end_of_key(rest) };
    let length = rest[..end.unwrap_or(rest.len())].trim_end().len();
    if length > 0 {
        out.push(Key { section: section.to_owned(), name: start + from..start + from + length });
    }
}

/// A colon outside of brackets that a blank or the end follows.
fn end_of_key(text: &str) -> Option<usize> {
    text.char_indices().find(|&(at, c)| c == ':' && text[at + 1..].chars().next().is_none_or(char::is_whitespace)).map(|(at, _)| at)
}

/// Names in a scenario with the symbols of the model that they mean.
#[must_use]
pub fn names(program: &Program, text: &str) -> Vec<(Range<usize>, SymbolId)> {
    let mut out = Vec::new();
    for key in keys(text) {
        path(program, text, &key, &mut out);
    }
    out
}

/// Symbols of a flattened name, `R1.c[tropine,3]`, or of `choice=option`.
fn path(program: &Program, text: &str, key: &Key, out: &mut Vec<(Range<usize>, SymbolId)>) {
    let symbols = program.symbols();
    let mut scope = None;
    let mut current: Option<SymbolId> = None;
    let mut position = 0;
    let mut at = key.name.start;
    let mut sign = ' ';
    while at < key.name.end {
        let c = text[at..].chars().next().unwrap_or(' ');
        if !is_word(c) {
            position = if c == '[' { 0 } else { position + usize::from(c == ',') };
            if !c.is_whitespace() {
                sign = c;
            }
            at += c.len_utf8();
            continue;
        }
        let range = at..key.name.end.min(at + text[at..].find(|c: char| !is_word(c)).unwrap_or(text.len() - at));
        let word = &text[range.clone()];
        at = range.end;
        let found = match sign {
            '[' | ',' => current.and_then(|id| {
                let set = symbols.lookup(symbols.get(id).within, symbols.get(id).indices.get(position)?)?;
                symbols.find(Some(set), true, word)
            }),
            '.' | '=' => scope.and_then(|scope| symbols.find(Some(scope), true, word)),
            _ => symbols
                .find(None, !matches!(key.section.as_str(), "reward" | "observation" | "noise"), word)
                .or_else(|| symbols.lookup(None, word)),
        };
        if let Some(id) = found {
            out.push((range, id));
        }
        if !matches!(sign, '[' | ',') {
            current = found;
            scope = found.and_then(|id| symbols.scope_of(id));
        }
        sign = ' ';
    }
}

/// The symbol around a byte of a scenario.
#[must_use]
pub fn symbol_at(program: &Program, text: &str, offset: usize) -> Option<(Range<usize>, SymbolId)> {
    names(program, text).into_iter().find(|(range, _)| range.start <= offset && offset <= range.end)
}

/// Describes the symbol or the section at a byte.
#[must_use]
pub fn hover(program: &Program, facts: &Facts, text: &str, offset: usize) -> Option<Hover> {
    if let Some((range, id)) = symbol_at(program, text, offset) {
        return Some(Hover { range, markdown: describe(program, facts, id) });
    }
    let range = word_at(text, offset);
    let (name, meaning) = SECTIONS.iter().find(|(name, _)| *name == &text[range.clone()])?;
    Some(Hover { range, markdown: format!("`{name}`: {meaning}") })
}

/// Completions at a byte: sections at the begin of a line, names of the model inside of a section.
#[must_use]
pub fn complete(program: &Program, facts: &Facts, text: &str, offset: usize) -> Completion {
    let offset = text.floor_char_boundary(offset.min(text.len()));
    let word = word_at(text, offset);
    let line = text[..offset].rfind('\n').map_or(0, |at| at + 1);
    let replaces = word.start..offset;
    let head = &text[line..word.start];
    let plain = |label: &str, detail: &str, insert: String| Proposal {
        label: label.to_owned(),
        kind: ProposalKind::Word,
        detail: detail.to_owned(),
        insert,
        snippet: false,
        rank: 0,
    };
    if head.is_empty() {
        let proposals = SECTIONS.iter().map(|(name, meaning)| plain(name, meaning, format!("{name}: "))).collect();
        return Completion { replaces, proposals };
    }
    let section = text[..offset].lines().rev().find(|l| !l.starts_with([' ', '-', '#', '\t']) && l.contains(':'));
    let section = section.and_then(|l| l.split_once(':')).map_or("", |(name, _)| name.trim());
    let fits = |kind: SymbolKind| match section {
        "parameters" => matches!(kind, SymbolKind::Variable(smpl_dsl::syntax::Role::Param)),
        "settings" => matches!(kind, SymbolKind::Variable(smpl_dsl::syntax::Role::Param) | SymbolKind::Choice),
        "grid" => matches!(kind, SymbolKind::Variable(smpl_dsl::syntax::Role::Param)),
        "initial" => matches!(kind, SymbolKind::Variable(smpl_dsl::syntax::Role::State)),
        "disturbances" => matches!(kind, SymbolKind::Variable(smpl_dsl::syntax::Role::Disturbance)),
        "variants" => matches!(kind, SymbolKind::Variant | SymbolKind::Choice),
        "reward" => kind == SymbolKind::Reward,
        "observation" => kind == SymbolKind::Level,
        "noise" => kind == SymbolKind::Observation,
        _ => false,
    };
    let symbols = program.symbols();
    let found = symbols.members(None).filter(|(_, symbol)| fits(symbol.kind));
    let proposals = found.map(|(id, symbol)| {
        let unit = unit_of(program, symbol, facts.get(&symbols.path(id))).filter(|unit| !unit.is_one()).map(|unit| format!("[{unit}] "));
        let detail = unit.unwrap_or_default() + symbol.text.as_deref().unwrap_or_default();
        Proposal { kind: ProposalKind::Symbol(symbol.kind), ..plain(&symbol.name, &detail, symbol.name.clone()) }
    });
    Completion { replaces, proposals: proposals.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_in_blocks_and_in_braces() {
        let text = "parameters: {visc_exp: 0, \"R1.V\": 2}  # a: b\nvariants:\n  - long_step\n  - coupling=held\ngrid:\n  n_z: 20\nreward: yield\n";
        let found: Vec<(String, &str)> = keys(text).into_iter().map(|key| (key.section, &text[key.name])).collect();
        let found: Vec<(&str, &str)> = found.iter().map(|(section, name)| (section.as_str(), *name)).collect();
        assert_eq!(
            found,
            [
                ("parameters", "visc_exp"),
                ("parameters", "R1.V"),
                ("variants", "long_step"),
                ("variants", "coupling=held"),
                ("grid", "n_z"),
                ("reward", "yield")
            ]
        );
    }
}
