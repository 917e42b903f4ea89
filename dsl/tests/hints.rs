//! What the parser advises for common slips.

use smpl_dsl::parse;
use smpl_dsl::span::FileId;

#[test]
fn common_slips_come_with_the_right_spelling() {
    let cases = [
        ("parma a = 1", "did you mean `param`?"),
        ("x = 3", "to define write `let x = ...`; an equation begins with `eq`"),
        ("d/dt x = 3", "an equation begins with `eq`: `eq d/dt x = ...`"),
        ("let x := 3", "write `=`; there is no `:=`"),
        ("let x = y ** 2", "a power is written `^`: `x^2`"),
        ("let x = 2 y", "to multiply write `*`; a unit stands in brackets: `[y]`"),
        ("param x = 3 m", "to multiply write `*`; a unit stands in brackets: `[m]`"),
        ("let x = (a) b", "to multiply write `*`"),
        ("fail f when a = 1", "to compare write `==`"),
        ("eq x == 3", "here `=` defines; `==` compares"),
        ("eq d x/dt = 3", "a rate is written `d/dt x`"),
        ("let x = .5", "a number begins with a digit: `0.5`"),
        ("let x = 1.", "a number has digits on both sides of the point: `1.0`"),
        ("let x = a || b", "write `or`"),
        ("let x = a && b", "write `and`"),
        ("let x = !b", "write `not`"),
        ("let x = 3 \u{d7} 4", "write `*` to multiply"),
        ("let x = (1 + 2", "add `)`"),
        ("connect a", "the form is `connect M1.outlet -> R1.inlet`"),
    ];
    let advice = |text: &str| parse(text, FileId(0)).diagnostics.iter().filter_map(|fault| fault.help.clone()).collect::<Vec<_>>();
    let wrong: Vec<_> = cases.iter().filter(|(text, help)| advice(text) != [*help]).map(|(text, _)| (text, advice(text))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
