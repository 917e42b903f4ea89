//! A statement of a variant replaces the one that it repeats and no other. A model is the same as the one with both statements, or with
//! the second one alone, in its text.

mod running;

use running::flat;
use smpl_compiler::emit;

/// Text around the statements.
const REST: &str = "
component Tap { port o : Stream ; var Q ; eq o.Q = Q ; eq Q = 1 }
component Drain { port i : Stream ; state V = 0 in 0..10 ; eq d/dt V = i.Q / 1 [s] }
connector Stream { Q : 1 }
choice more = true | false
set k = 1..4
set s = { one, two }
param p = 1
state x[i in k] = 1 in 0..10
state y = 1 in 0..10
state y_2 = 1 in 0..10
state y_3 = 1 in 0..10
state q[j in s] = 1 in 0..10
discrete d[i in k] = 0 in 0..10
domain z in 0 [m]..1 [m] cells 6
domain w in 0 [m]..1 [m] cells 6
action a_0 = 1 in 0..2
event low when y <= 0.1
eq d/dt y = -y / 1 [s]
eq d/dt y_2 = -y / 1 [s]
eq d/dt y_3 = -y / 1 [s]
eq d/dt q[j] = -q[j] / 1 [s] for j in s
";

const RATES: &str = "eq d/dt x[i] = -x[i] / 1 [s] for i in k\n";
const TWO_UNKNOWNS: &str = "eq d/dt x[i] = -a*b*x[i] / 1 [s] for i in k\nvar a\nvar b\n";

/// Programs and interface of a model.
fn ir(lines: &str) -> String {
    let model = flat(&format!("{REST}{lines}\n"));
    format!("{}\n{:?}", emit::ir(&model), model.interface)
}

/// `second` in a block is added to `first`.
fn added(rest: &str, first: &str, second: &str) {
    let block = ir(&format!("{rest}{first}\nwhen more = true {{ {second} }}"));
    let both = ir(&format!("{rest}{first}\n{second}"));
    assert_eq!(block, both, "{second} in a block replaces {first}");
}

/// `second` in a block takes the place of `first`.
fn replaced(rest: &str, first: &str, second: &str) {
    let block = ir(&format!("{rest}{first}\nwhen more = true {{ {second} }}"));
    assert_eq!(block, ir(&format!("{rest}{second}")), "{second} in a block does not replace {first}");
    assert_ne!(block, ir(&format!("{rest}{first}")), "{first} and {second} mean the same");
}

#[test]
fn equations_with_other_left_sides_are_added() {
    let pairs = [
        ("eq 2 [m] = a * 1 [m]", "eq 2 [km] = b * 1 [m]"),
        ("eq (p as [m]) = a * 1 [m]", "eq (p as [km]) = b * 1 [m]"),
        ("eq (2 as [unit(x[1])]) = a", "eq (2 as [unit(x[2])]) = b"),
        ("eq sum(a + i*b for i in 1..2) = 3", "eq sum(a + i*b for i in 3..4) = 5"),
        ("eq sum(a + i*b for i in k if i == 1) = 3", "eq sum(a + i*b for i in k if i == 2) = 5"),
        ("eq sum(a + i*b for i in k) = 3", "eq sum(a + i*b for i in k if i == 2) = 5"),
        ("eq sum(u for u in (a, b)) = 3", "eq sum(u for u in (a, -b)) = 5"),
        ("eq sum(width(z)*a + b * 1 [m] for z in 1..2) = 3 [m]", "eq sum(width(w)*a - b * 1 [m] for w in 1..2) = 5 [m]"),
        ("eq sum(a*x[i] + b for i in 1..2) = 3", "eq sum(a*x[j] - b for j in 1..2) = 5"),
        ("eq max(a, 1) = 3", "eq min(a, 1) + b = 5"),
        ("eq -a = 3", "eq +a = b"),
    ];
    for (first, second) in pairs {
        added(TWO_UNKNOWNS, first, second);
    }
    added("var v[i in k]\neq d/dt x[i] = v[i] / 1 [s] for i in k\n", "eq v[i] = 1 for i in 1..2", "eq v[i] = 2 for i in 3..4");
}

#[test]
fn other_statements_with_other_targets_are_added() {
    let pairs = [
        ("initial x[i] = 2 for i in 1..2", "initial x[i] = 3 for i in 3..4"),
        ("initial u = 2 for u in (y, y_2)", "initial u = 3 for u in (y_3, q)"),
        ("observe x[i] for i in 1..2", "observe x[i] for i in 3..4"),
        ("observe x[1]", "observe x[2]"),
        ("at start { next d[i] = 1 for i in 1..2 }", "at start { next d[i] = 2 for i in 3..4 }"),
        ("at end { reset x[i] = 1 for i in 1..2 }", "at end { reset x[i] = 2 for i in 3..4 }"),
        ("at low { reset x[i] = 1 for i in 1..2 }", "at low { reset x[i] = 2 for i in 3..4 }"),
        ("at low { reset y = 1 }", "at end { reset y = 2 }"),
        ("at end { clamp x[i] at 1 when x[i] < 1 for i in 1..2 }", "at end { clamp x[i] at 2 when x[i] < 2 for i in 3..4 }"),
        ("at end { reset x[1] = 1 }", "at end { clamp x[1] at 2 when x[1] < 2 }"),
    ];
    for (first, second) in pairs {
        added(RATES, first, second);
    }
    let plant = format!("{RATES}use Tap as taps[i in k]\nuse Drain as drains[i in 1..2]\n");
    added(&plant, "connect taps[1].o -> drains[1].i", "connect taps[1].o -> drains[2].i");
}

#[test]
fn the_same_target_is_replaced_whatever_its_indices_are_called() {
    let pairs = [
        ("initial x[i] = 2 for i in k", "initial x[j] = 3 for j in k"),
        ("initial u = 2 for u in (y, y_2)", "initial v = 3 for v in (y, y_2)"),
        ("initial y = 2", "initial y = 3"),
        ("at start { next d[i] = 1 for i in k }", "at start { next d[j] = 2 for j in k }"),
        ("at end { reset x[i] = 1 for i in k }", "at end { reset x[j] = 2 for j in k }"),
        ("at end { clamp x[i] at 1 when x[i] < 1 for i in k }", "at end { clamp x[j] at 2 when x[j] < 2 for j in k }"),
        ("observe x[i] in 0..1 for i in k", "observe x[i] for i in k noise normal(0, 1)"),
        ("observe y", "observe y = 2*y in 0..20"),
        ("reward r = y", "reward r = 2*y"),
        ("fail f when y > 2", "fail f when y > 3"),
        ("success f when y > 2", "success f when y > 3"),
        ("constraint f when y > 2", "constraint f when y > 3"),
        ("invariant f = y", "invariant f = 2*y"),
        ("policy f { a_0 = 1 }", "policy f { a_0 = 2 }"),
    ];
    for (first, second) in pairs {
        replaced(RATES, first, second);
    }
    replaced("", RATES.trim(), "eq d/dt x[j] = -2*x[j] / 1 [s] for j in k");
    let sum = "var a\neq d/dt x[i] = -a*x[i] / 1 [s] for i in k\n";
    replaced(sum, "eq sum(a*q[i] for i in s) = 1", "eq sum(a*q[j] for j in s) = 2");
}
