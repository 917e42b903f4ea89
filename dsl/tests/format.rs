//! The formatter changes nothing but layout, and a second pass changes nothing at all.

mod common;

use proptest::prelude::*;
use serde_json::Value;
use smpl_dsl::format::format;
use smpl_dsl::parse;
use smpl_dsl::span::FileId;

/// The syntax tree without places.
fn tree(text: &str) -> Value {
    let mut value = serde_json::to_value(parse(text, FileId(0)).file).expect("a tree");
    strip(&mut value);
    value
}

fn strip(value: &mut Value) {
    match value {
        Value::Object(fields) if fields.contains_key("file") && fields.contains_key("start") => *value = Value::Null,
        Value::Object(fields) => fields.values_mut().for_each(strip),
        Value::Array(items) => items.iter_mut().for_each(strip),
        _ => {}
    }
}

fn comments(text: &str) -> Vec<String> {
    let comments = text.lines().filter_map(|line| line.rsplit_once('#')).map(|(_, comment)| comment.trim().to_owned());
    comments.collect()
}

fn check(text: &str) {
    let Ok(once) = format(text) else { return };
    assert_eq!(tree(&once), tree(text), "the tree changed:\n{text}\n----\n{once}");
    assert_eq!(comments(&once).len(), comments(text).len(), "comments were lost:\n{text}\n----\n{once}");
    assert_eq!(format(&once).as_deref(), Ok(once.as_str()), "a second pass changed:\n{text}");
}

#[test]
fn models_and_examples_keep_their_meaning() {
    common::corpus().iter().for_each(|text| check(text));
}

#[test]
fn declarations_of_one_role_are_aligned() {
    let text = "param q_in : m^3/min=0.1 \"feed\"\nparam  r:m = 0.219 in 0.05..5   \"radius\"\n\n\n\nlet a=2*x+ 1 # why\n";
    let expected = "param q_in : m^3/min = 0.1                  \"feed\"\nparam r    : m       = 0.219  in 0.05..5    \"radius\"\n\nlet a = 2*x + 1    # why\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
}

#[test]
fn blocks_are_indented_and_long_lines_keep_their_breaks() {
    let text = "component A(n=3)  \"text\"{\nparam V:mL\nlet d = max(a,\n b)\nat start { next x=1 ;next y = 2 }\n}\npolicy p {\nT = if a then b\n else c\n}";
    let expected = "component A(n = 3) \"text\" {\n  param V : mL\n  let d = max(a,\n              b)\n  at start { next x = 1; next y = 2 }\n}\npolicy p {\n  T = if a then b\n      else c\n}\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
}

#[test]
fn clauses_of_equations_form_a_column_and_names_keep_their_pattern() {
    let text = "eq d/dt a[i] = -a[i] for i in s\neq d/dt bc[i] = 2 * a[i] for i in s\n\nstate nv[c] named \"n{}\" : m = 0 \"number\"\nstate bound[c] : kg = 0 \"other\"\n";
    let expected = "eq d/dt a[i]  = -a[i]       for i in s\neq d/dt bc[i] = 2 * a[i]    for i in s\n\nstate nv[c] named \"n{}\" : m  = 0    \"number\"\nstate bound[c]          : kg = 0    \"other\"\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
}

#[test]
fn entries_on_several_lines_stand_below_each_other() {
    let text = "policy p { a = 1\n           b = 2 +\n   3 }\n";
    let expected = "policy p {\n  a = 1\n  b = 2 +\n      3\n}\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
}

/// Found by fuzzing: what follows a keyword begins an expression, so that a sign is one with or without blanks.
#[test]
fn names_may_be_words_of_clauses() {
    for name in ["scale", "named", "every", "clip", "default", "noise", "nonnegative"] {
        check(&format!(
            "param  A : m^2 = 0.5   \"area\"\naction {name} : m^3/min = 0.1 in 0..0.3   \"inflow\"\nstate h : m = {name}*2 in 0..2 scale {name}\nparam b = 1, {name}_2 = 2\n"
        ));
    }
    // Columns begin where the clauses do.
    let text = "param scale : m = 1 in 0..2\nparam scale_2 : m = scale in 0..2\nstate x = 2 * scale in 0..1 scale 3\n";
    check(text);
    assert_eq!(
        format(text).expect("a layout"),
        "param scale   : m = 1      in 0..2\nparam scale_2 : m = scale  in 0..2\nstate x = 2 * scale in 0..1 scale 3\n"
    );
}

#[test]
fn nonnegative_states_have_a_column_after_bounds_and_scale() {
    let text = "state y nonnegative\nstate ab : mol = 1 in 0..2 scale 3 nonnegative \"amount\"\nstate c[i in 1..2] : mol = 1 in 0..2 nonnegative\n";
    check(text);
    assert_eq!(
        format(text).expect("a layout"),
        "state y                                         nonnegative\nstate ab           : mol = 1  in 0..2  scale 3  nonnegative    \"amount\"\nstate c[i in 1..2] : mol = 1  in 0..2           nonnegative\n"
    );
}

#[test]
fn controllers_and_regular_instants_keep_their_clauses() {
    let text = "control  u[k]  from y setpoint r gain -2/70 [%] limits -1 .. 2 manual -1 when c every 3 [s] for k in s\nat every 3[s]{next x=1}\n\
                connector Heat{T:K,flow Q:W}\nport n[j in links]:Heat\nconnect a->b for i in 1..2 if i!=2\n";
    let expected = "control u[k] from y setpoint r gain -2/70 [%] limits -1..2 manual -1 when c every 3 [s] for k in s\nat every 3 [s] { next x = 1 }\n\
                    connector Heat { T : K, flow Q : W }\nport n[j in links] : Heat\nconnect a -> b for i in 1..2 if i != 2\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
}

#[test]
fn units_that_end_in_a_percent_sign_stay_whole() {
    let text = "param a : mol% = 2\nstate x : wt%/h = 3 [vol%/min]\n";
    check(text);
    let laid_out = format(text).expect("a layout");
    assert!(["mol%", "wt%/h", "vol%/min"].iter().all(|unit| laid_out.contains(unit)), "{laid_out}");
}

#[test]
fn an_observation_may_begin_with_a_sign() {
    for text in ["observe -x noise normal(0, 1), y = x in 0..2\n", "observe - x noise normal(0, 1), y = x in 0..2\n"] {
        assert_eq!(format(text).as_deref(), Ok("observe -x noise normal(0, 1), y = x in 0..2\n"));
        check(text);
    }
}

/// Found by fuzzing: the sign was treated as an operator after a blank.
#[test]
fn an_equation_may_begin_with_a_sign() {
    for text in ["eq-d/dt x = y\n", "eq -d/dt x = y\n", "eq - d/dt x = y\n"] {
        assert_eq!(format(text).as_deref(), Ok("eq -d/dt x = y\n"));
        check(text);
    }
}

#[test]
fn a_text_with_faults_is_not_formatted() {
    assert_eq!(format("param = 3").map_err(|faults| faults.len()), Err(1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn generated_programs_keep_their_meaning(text in common::program()) {
        check(&text);
    }
}

/// Tables as their authors have aligned them, and as they are laid out.
const TABLES: &[(&str, &str)] = &[
    // Heads above the columns, units and expressions in them.
    (
        "table over s {\n  columns:  a [g/mol],  b [kJ/(kg K)]\n  x:        1.5*2,      1020 [J/(kg K)]\n  yy:       -3.0,       944\n}\n",
        "table over s {\n  columns: a [g/mol], b [kJ/(kg K)]\n  x:       1.5*2,     1020 [J/(kg K)]\n  yy:      -3.0,      944\n}\n",
    ),
    // Numbers by their ends, and by their points.
    (
        "table over s {\ncolumns: a, b\nx:   1020,   12.5\nyy:   944,    3\nz:     -1,  144.25\n}\n",
        "table over s {\n  columns: a, b\n  x:  1020,  12.5\n  yy:  944,   3\n  z:    -1, 144.25\n}\n",
    ),
    // Rows of members, with comments.
    (
        "table nu[r, s] default 0 {\n  r1:  a = -1,   b = 1    # one\n  r10: c = 2,    d = 1/2\n}\n",
        "table nu[r, s] default 0 {\n  r1:  a = -1, b = 1    # one\n  r10: c = 2,  d = 1/2\n}\n",
    ),
    // What is aligned in nothing stays in its lines; plain numbers by their starts.
    ("table over s {\n  columns: a, b\n  x: 1, 22\n  yy: 333, 4\n}\n", "table over s {\n  columns: a, b\n  x:  1,   22\n  yy: 333, 4\n}\n"),
    (
        "table nu[r, s] default 0 {\n  r1: a = -1, b = 1\n  r2: cc = 10, b = 1\n}\n",
        "table nu[r, s] default 0 {\n  r1: a = -1, b = 1\n  r2: cc = 10, b = 1\n}\n",
    ),
];

#[test]
fn statements_of_tests_keep_their_lines() {
    let text = "test   \"a\"  {\nstart nominal\n u[1]  =  2\nR.x=3   for 4  [h]\n  for 2 [h]\nexpect x   within 1e-6 of  6\n  expect u[1] > -1\n}\n";
    let expected =
        "test \"a\" {\n  start nominal\n  u[1] = 2\n  R.x = 3 for 4 [h]\n  for 2 [h]\n  expect x within 1e-6 of 6\n  expect u[1] > -1\n}\n";
    assert_eq!(format(text).as_deref(), Ok(expected));
    check(text);
    check("test \"a\" { steps 3; x = 1; expect x > 1 }\n");
}

#[test]
fn tables_keep_the_columns_that_their_authors_have_aligned() {
    for (text, expected) in TABLES {
        assert_eq!(format(text).as_deref(), Ok(*expected), "{text}");
        check(text);
    }
}

proptest! {
    #[test]
    fn tables_with_any_blanks_are_laid_out_once(rows in prop::collection::vec(prop::collection::vec((0..4_usize, 0..6_usize), 1..4), 1..5)) {
        let cells = ["1", "-2.5", "1.25e3", "x^2", "10 [m/s]", "f(1, 2)"];
        let rows = rows.iter().enumerate().map(|(i, row)| {
            let row: Vec<String> = row.iter().map(|(blanks, cell)| std::format!("{:blanks$}{}", "", cells[*cell])).collect();
            std::format!("  m{}: {}\n", 10_usize.pow(i as u32), row.join(","))
        });
        check(&std::format!("table over s {{\n  columns: a, b [m/s], c\n{}}}\n", rows.collect::<String>()));
    }
}
