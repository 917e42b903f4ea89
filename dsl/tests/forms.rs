//! Expressions visited and compared: every part counts, places and names of bound indices do not.

use smpl_dsl::parse;
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::{Expr, ExprKind, Form, StatementKind};

fn expression(text: &str) -> Expr {
    let parsed = parse(&format!("eq y = {text}"), FileId(0));
    assert!(parsed.is_ok(), "{text}: {:?}", parsed.diagnostics);
    match parsed.file.statements.into_iter().next().map(|s| s.kind) {
        Some(StatementKind::Equation { rhs, .. }) => rhs,
        other => panic!("not an equation: {other:?}"),
    }
}

/// One expression of each kind, with every part that a kind can have; each `q..` is a name in an expression.
const KINDS: &[(&str, usize)] = &[
    ("3 [unit(q1)]", 1),
    ("q1.m", 1),
    ("q1[q2, q3]", 3),
    ("f(q1, q2)", 2),
    ("sum(q1*i for i in s)", 1),
    ("sum(q1 for i in q2..q3, j in (q4, q5) if q6 > q7)", 7),
    ("der(q1)", 1),
    ("d/dt q1", 1),
    ("-q1", 1),
    ("q1 and not q2", 2),
    ("if q1 > q2 then q3 else q4", 4),
    ("q1 as [m unit(q2)]", 2),
    ("max(v for v in (q1, q2))", 2),
];

#[test]
fn a_walk_meets_every_part() {
    for (text, count) in KINDS {
        let e = expression(text);
        let mut names = Vec::new();
        e.walk(&mut |e| {
            if let ExprKind::Name(n) = &e.kind
                && n.text.starts_with('q')
            {
                names.push(n.text.clone());
            }
        });
        names.sort();
        let expected: Vec<String> = (1..=*count).map(|i| format!("q{i}")).collect();
        assert_eq!(names, expected, "{text}");
        assert!(expected.iter().all(|name| e.mentions(name)) && !e.mentions("q9"), "{text}");
    }
}

#[test]
fn every_part_counts() {
    for (text, count) in KINDS {
        for i in 1..=*count {
            let other = text.replace(&format!("q{i}"), "q9");
            assert_ne!(Form::of(&expression(text)), Form::of(&expression(&other)), "{text} and {other}");
        }
    }
    let different = [
        ("2", "3"),
        ("2", "-2"),
        ("2 [m]", "2"),
        ("2 [m]", "2 [kg]"),
        ("2 [m]", "2 [m^2]"),
        ("1 [m]", "100 [cm]"),
        ("2 [unit(a)]", "2 [unit(b)]"),
        ("x as [m]", "x as [s]"),
        ("x as [m]", "x"),
        ("true", "false"),
        ("a + b", "a - b"),
        ("a + b", "b + a"),
        ("(a + b) + c", "a + (b + c)"),
        ("-a", "+a"),
        ("f(a, b)", "f(b, a)"),
        ("f(a)", "g(a)"),
        ("a[i]", "a[j]"),
        ("a.m", "a.n"),
        ("a.i", "a[i]"),
        ("sum(v[i] for i in 1..2)", "sum(v[i] for i in 3..4)"),
        ("sum(v[i] for i in s)", "sum(v[i] for i in r)"),
        ("sum(v[i] for i in s)", "product(v[i] for i in s)"),
        ("sum(v[i] for i in s)", "sum(v[i] for i in s if i == a)"),
        ("sum(v[i] for i in s if i == a)", "sum(v[i] for i in s if i == b)"),
        ("sum(m[i, j] for i in s, j in s)", "sum(m[j, i] for i in s, j in s)"),
        ("sum(v for v in (a, b))", "sum(v for v in (a, b, b))"),
        // The name of a range may be that of a domain, whose cells it counts then.
        ("sum(width(z) for z in 1..2)", "sum(width(r) for r in 1..2)"),
        ("sum(i for j in s)", "sum(j for j in s)"),
    ];
    for (a, b) in different {
        assert_ne!(Form::of(&expression(a)), Form::of(&expression(b)), "{a} and {b}");
    }
}

#[test]
fn places_and_names_of_indices_do_not_count() {
    let equal = [
        ("a+b*c", "  a + (b *  c)"),
        ("2.0 [m/s]", "2 [m/s]"),
        ("d/dt x", "der(x)"),
        ("sum(v[i] for i in s)", "sum(v[j] for j in s)"),
        ("sum(v[z] for z)", "sum(v[k] for k in z)"),
        ("sum(m[i, j] for i in s, j in s if i != j)", "sum(m[k, i] for k in s, i in s if k != i)"),
        ("sum(max(x[i] for i in s) - x[i] for i in s)", "sum(max(x[j] for j in s) - x[k] for k in s)"),
        ("sum(u for u in (a, b))", "sum(w for w in (a, b))"),
    ];
    for (a, b) in equal {
        let (a, b) = (expression(a), expression(b));
        assert_eq!(Form::of(&a), Form::of(&b));
        let hash = |e: &Expr| {
            use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};
            BuildHasherDefault::<DefaultHasher>::default().hash_one(Form::of(e))
        };
        assert_eq!(hash(&a), hash(&b));
    }
}
