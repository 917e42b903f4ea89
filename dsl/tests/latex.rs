//! Typeset expressions, as a reader of the paper would write them.

mod common;

use proptest::prelude::*;
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::StatementKind;
use smpl_dsl::{latex, parse};

fn typeset(text: &str) -> String {
    let source = format!("eq y = {text}");
    let parsed = parse(&source, FileId(0));
    assert!(parsed.is_ok(), "{text}: {:?}", parsed.diagnostics);
    match &parsed.file.statements[0].kind {
        StatementKind::Equation { rhs, binders, .. } if binders.is_empty() => latex::expression(rhs),
        StatementKind::Equation { lhs, rhs, binders } => latex::equation(lhs, rhs, binders),
        other => panic!("not an equation: {other:?}"),
    }
}

#[test]
fn names_become_symbols() {
    let cases = [
        ("c_A", r"c_{\mathrm{A}}"),
        ("mu", r"\mu"),
        ("mu_x0", r"\mu_{\mathrm{x0}}"),
        ("k_0", r"k_{0}"),
        ("q5", r"q_{5}"),
        ("EtOH", r"\mathrm{EtOH}"),
        ("c[i, z-1]", r"c_{i,z - 1}"),
        ("R1.c[i]", r"c_{\mathrm{R1},i}"),
        ("M1.inlet.Q", r"Q_{\mathrm{M1.inlet}}"),
    ];
    for (text, expected) in cases {
        assert_eq!(typeset(text), expected);
    }
}

#[test]
fn operators_keep_the_meaning_with_the_fewest_parentheses() {
    let cases = [
        ("a + b * c", r"a + b \, c"),
        ("(a + b) * c", r"\left(a + b\right) \, c"),
        ("a - (b - c)", r"a - \left(b - c\right)"),
        ("(a + b) / c", r"\frac{a + b}{c}"),
        ("(a / b)^2", r"\left(\frac{a}{b}\right)^{2}"),
        ("-x^2", "-x^{2}"),
        ("(-x)^2", r"\left(-x\right)^{2}"),
        ("(a^b)^c", r"\left(a^{b}\right)^{c}"),
        ("a * (-b)", r"a \, \left(-b\right)"),
        ("a * 1e-8", r"a \cdot 10^{-8}"),
        ("2 * 3", r"2 \cdot 3"),
        ("exp(-E / T)", r"\exp\left(-\frac{E}{T}\right)"),
        ("sqrt(a + b)", r"\sqrt{a + b}"),
        ("abs(a - b)", r"\left\lvert a - b\right\rvert"),
        ("1e-8 [m^3/min]", r"10^{-8}\,\mathrm{m}^{3}\,\mathrm{min}^{-1}"),
        ("a < b and not c", r"a < b \land \lnot c"),
    ];
    for (text, expected) in cases {
        assert_eq!(typeset(text), expected, "{text}");
    }
}

#[test]
fn sums_and_conditions_have_their_own_forms() {
    assert_eq!(typeset("sum(nu[j, i] * r[j] for j in reactions)"), r"\sum_{j \in \mathrm{reactions}} \nu_{j,i} \, r_{j}");
    assert_eq!(typeset("sum(a[i] + b for i in 1..3)"), r"\sum_{i = 1, \ldots, 3} \left(a_{i} + b\right)");
    assert_eq!(typeset("integral(c[z] for z)"), r"\int c_{z}\,\mathrm{d} z");
    assert_eq!(typeset("integral(c[z] for z in 2..5)"), r"\int_{z = 2, \ldots, 5} c_{z}\,\mathrm{d} z");
    assert_eq!(typeset("integral(c[z] for z if c[z] > 1)"), r"\int_{\substack{z \\ c_{z} > 1}} c_{z}\,\mathrm{d} z");
    let cases = r"\begin{cases} a & \text{if } x < 1 \\ b & \text{if } x < 2 \\ c & \text{otherwise} \end{cases}";
    assert_eq!(typeset("if x < 1 then a else if x < 2 then b else c"), cases);
    assert_eq!(typeset("d/dt T"), r"\frac{\mathrm{d} T}{\mathrm{d} t}");
    assert_eq!(typeset("x[i] for i in s"), r"y = x_{i}, \quad i \in \mathrm{s}");
}

proptest! {
    #[test]
    fn braces_are_balanced_and_delimiters_paired(text in common::expression()) {
        let result = typeset(&text);
        prop_assert_eq!(result.matches('{').count(), result.matches('}').count());
        prop_assert_eq!(result.matches(r"\left").count(), result.matches(r"\right").count());
    }
}
