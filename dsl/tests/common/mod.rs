//! Texts that the tests share: the models, the examples of the language reference, and generated programs.

#![allow(dead_code, reason = "each test uses a part")]

use std::path::{Path, PathBuf};

use proptest::prelude::*;
use proptest::strategy::BoxedStrategy;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Name and text of every model that ships with smpl.
pub fn models() -> Vec<(String, String)> {
    let entries = std::fs::read_dir(repository().join("models")).expect("the models' folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let sources = paths.filter(|path| path.extension().is_some_and(|extension| extension == "eq"));
    sources.map(|path| (path.display().to_string(), std::fs::read_to_string(&path).expect("a model"))).collect()
}

/// The code blocks of a Markdown file.
pub fn blocks(path: &str, fence: &str) -> Vec<String> {
    let text = std::fs::read_to_string(repository().join(path)).expect("a Markdown file");
    let opening = format!("{fence}\n");
    let mut parts = text.split(opening.as_str()).skip(1);
    let mut blocks = Vec::new();
    while let Some(part) = parts.next() {
        blocks.push(part.split("```").next().unwrap_or("").to_owned());
        if fence == "```" {
            parts.next();
        }
    }
    blocks
}

/// Models and examples.
pub fn corpus() -> Vec<String> {
    let mut texts: Vec<String> = models().into_iter().map(|(_, text)| text).collect();
    texts.extend(blocks("docs/language.md", "```"));
    for file in ["statements", "expressions", "layout", "tables"] {
        texts.extend(blocks(&format!("tests/language/syntax/{file}.md"), "```eq"));
    }
    texts
}

fn one_of(items: &'static [&'static str]) -> BoxedStrategy<String> {
    proptest::sample::select(items).prop_map(str::to_owned).boxed()
}

fn blank() -> BoxedStrategy<String> {
    one_of(&["", " ", "  "])
}

/// An expression, with blanks here and there.
pub fn expression() -> BoxedStrategy<String> {
    let leaf = prop_oneof![
        one_of(&["x", "y_1", "T", "rate", "step", "z.last", "c[i, z-1]", "M1.inlet.Q", "d/dt x", "true"]),
        one_of(&["1", "0.5", "1e-8", "3 [m]", "2 [kJ/(min m^2 K)]", "20[degC]", "5 [%]"]),
    ];
    leaf.prop_recursive(4, 32, 3, |inner| {
        let operator = one_of(&["+", "-", "*", "/", "^", " and ", " or "]);
        let comparison = one_of(&["<", "<=", "==", "!=", ">"]);
        prop_oneof![
            (inner.clone(), blank(), operator, blank(), inner.clone())
                .prop_map(|(a, left, op, right, b)| format!("({a}){left}{op}{right}({b})")),
            // In parentheses: comparisons do not chain.
            (inner.clone(), blank(), comparison, blank(), inner.clone())
                .prop_map(|(a, left, op, right, b)| format!("(({a}){left}{op}{right}({b}))")),
            (inner.clone(), blank(), inner.clone()).prop_map(|(a, gap, b)| format!("{a}{gap}*{gap}{b}")),
            inner.clone().prop_map(|a| format!("-{a}")),
            inner.clone().prop_map(|a| format!("exp( {a} )")),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| format!("max({a},{b})")),
            (inner.clone(), inner.clone(), inner.clone()).prop_map(|(a, b, c)| format!("(if {a} then {b}\n else {c})")),
            inner.clone().prop_map(|a| format!("sum({a} for i in s, z)")),
            inner.prop_map(|a| format!("({a}) as [1/h]")),
        ]
    })
    .boxed()
}

/// A statement.
pub fn statement() -> BoxedStrategy<String> {
    let text = one_of(&["", " \"text\"", "\n   \"text\"", " # comment", "   \"a # b\"  # c"]);
    let role = one_of(&["param", "state", "let", "action", "discrete  "]);
    let name = one_of(&["a", "b_long_name", "c[i in s, z]", "T"]);
    let unit = one_of(&["", ": m", " : kJ/(min m^2 K)", ": 1"]);
    let declaration = (role, name.clone(), unit, expression(), one_of(&["", " in 0..1", " in -1e3 .. inf scale 2"]), text);
    let declaration = declaration.prop_map(|(role, name, unit, value, bounds, text)| format!("{role} {name}{unit}={value}{bounds}{text}"));
    let equation = (name, expression(), one_of(&["", " for i in s", "\n for i in s, z in 2..5"]));
    let equation = equation.prop_map(|(name, value, binders)| format!("eq {}  = {value}{binders}", name.replace("i in s", "i")));
    let entries = (expression(), expression()).prop_map(|(a, b)| format!("steady {{ a = {a}\n # c\n b = {b}, d = 1 }}"));
    let simple = prop_oneof![4 => declaration, 3 => equation, 1 => entries, 1 => one_of(&["# comment", "", "\n", "observe a, T in 0..1 every 3", "use M as A, B"])];
    let block = (proptest::collection::vec(simple.clone(), 0..4), one_of(&["\n", "\n\n\n"]));
    let block = block.prop_map(|(inner, end)| format!("variant v {{ {}{end}}}", inner.join(&end)));
    prop_oneof![6 => simple, 1 => block].boxed()
}

/// A program.
pub fn program() -> BoxedStrategy<String> {
    (proptest::collection::vec(statement(), 0..8), one_of(&["\n", "\n\n", "\n\n\n   "])).prop_map(|(parts, end)| parts.join(&end)).boxed()
}
