//! Advice of the parser for common slips.

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
        ("let x = 2 y", "use `*` to multiply, or write a unit in brackets: `[y]`"),
        ("param x = 3 m", "a unit is written in brackets: `3 [m]`; to multiply write `*`"),
        ("let x = (a) b", "to multiply write `*`"),
        ("fail f when a = 1", "to compare write `==`"),
        ("eq x == 3", "write `=`; `==` compares"),
        ("eq d x/dt = 3", "a rate is written `d/dt x`"),
        ("let x = .5", "a number begins with a digit: `0.5`"),
        ("use Bed(n = 2) as B", "arguments follow the name of the instance: `use Bed as B(n = 2)`"),
        ("let x = 1.", "a number has digits on both sides of the point: `1.0`"),
        ("let x = a || b", "write `or`"),
        ("let x = a && b", "write `and`"),
        ("let x = !b", "write `not`"),
        ("let x = 3 \u{d7} 4", "write `*` to multiply"),
        ("let x = (1 + 2", "add `)`"),
        ("at start { x = 2 }", "what an instant sets begins with `next` (discrete variables) or `reset` (states): `reset x = ...`"),
        ("param a = 1,5", "decimals follow a point: `1.5`; a comma separates declarations"),
        ("let a = if c (x) else 0", "the form is `if condition then one else other`"),
        (
            "table f over time { 0: 1, 1: 2 }",
            "the form is `table f : unit over time : h linear { 0: 1, 2: 3 }`, with `linear`, `from` or `until`",
        ),
        ("param a = 1 ~ uniform(0, 2) in 0..3 clip bounds", "put `clip` before the bounds: `~ uniform(a, b) clip bounds in low..high`"),
        ("connect a", "the form is `connect M1.outlet -> R1.inlet`"),
    ];
    let advice = |text: &str| parse(text, FileId(0)).diagnostics.iter().filter_map(|fault| fault.help.clone()).collect::<Vec<_>>();
    let wrong: Vec<_> = cases.iter().filter(|(text, help)| advice(text) != [*help]).map(|(text, _)| (text, advice(text))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// A comment would swallow the rest of such a text, and declarations with it.
#[test]
fn lines_that_end_in_a_carriage_return_alone_are_one_fault() {
    for text in ["model M\rparam a = 1 # one\rparam b = 2\r", "param a = 1 # one\rparam b = 2\n", "param a = 1\r\r"] {
        let parsed = parse(text, FileId(0));
        let faults: Vec<&str> = parsed.diagnostics.iter().map(|fault| fault.message.as_str()).collect();
        let expected: &[&str] = if text.ends_with("\r\r") { &[] } else { &["a line ends in a carriage return alone"] };
        assert_eq!(faults, expected, "{text:?}");
    }
    let windows = parse("param a = 1 # one\r\nparam b = 2\r\n", FileId(0));
    assert!(windows.is_ok() && windows.file.statements.len() == 2);
}
