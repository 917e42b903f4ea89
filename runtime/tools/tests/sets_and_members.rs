//! Sets made of sets, membership, named tuples of variables, ends of ranges, values by member.

mod shell;

use shell::{columns, file, name, smpl, status, text};

/// The last row of a run, by column.
fn last(test: &str, source: &str, wanted: &[&str]) -> Vec<f64> {
    let rows = columns(&file(test, "m.eq", source), wanted, &["--start", "nominal"]);
    rows.iter().map(|column| *column.last().expect("a row")).collect()
}

const HEAD: &str = "time t : s\nset species = { A, B, C, D }\nset solids = { C, D }\n";
const TAIL: &str = "state z = 0\neq d/dt z = 0\nepisode { step = 1 [s], max_steps = 1 }\n";

#[test]
fn sums_and_differences_of_sets_have_the_members_of_set_theory() {
    let source = format!(
        "{HEAD}table k[species] = {{ A: 1, B: 20, C: 300, D: 4000 }}\n\
         set fluids = species - solids\nset all = solids + fluids\nset others = species - B - solids\n\
         let a : 1 = sum(k[i] for i in fluids)\nlet b : 1 = sum(k[i] for i in species - solids)\n\
         let c : 1 = sum(k[i] for i in all)\nlet d : 1 = sum(k[i] for i in others)\n\
         let f : 1 = sum(k[i] for i in solids + fluids - A)\nlet g : 1 = sum(k[i] for i in {{A, solids}})\n\
         state x[fluids] = 1\neq d/dt x[i] = k[i]/1 [s] for i in fluids\n{TAIL}"
    );
    let found = last("algebra", &source, &["a", "b", "c", "d", "f", "g", "x[B]"]);
    assert_eq!(found[..6], [21.0, 21.0, 4321.0, 1.0, 4320.0, 4301.0]);
    assert!((found[6] - 21.0).abs() < 1e-9);
}

#[test]
fn membership_decides_equations_and_terms() {
    let source = format!(
        "{HEAD}set odd = 1..5\nset few = 2..3\nlet w[i in species] : 1 = if i in solids then 5 else 7\n\
         let s : 1 = sum(w[i] for i in species if not i in solids) + (if D in solids and A in solids then 100 else 0)\n\
         let t1 : 1 = sum(1 for i in species if i in {{A, D}})\nlet n : 1 = sum(k for k in odd if k in few)\n\
         param p = 2 in 0..3\nparam low = 0\nparam high = 4\nparam q = p in low..high\n{TAIL}"
    );
    assert_eq!(last("membership", &source, &["w[A]", "w[C]", "s", "t1", "n"]), [7.0, 5.0, 14.0, 2.0, 5.0]);
}

#[test]
fn named_tuples_of_variables_serve_starts_bounds_observations_and_steady_states() {
    let source = "time t : s\nstate x = 1 in 0..10\nstate y = 2 in 0..20\nset box = (x, y)\naction u = 1 in 0..2\n\
                  eq d/dt x = (u - x)/1 [s]\neq d/dt y = (x - y)/1 [s]\n\
                  initial v = 3*nominal(v) for v in box\nobserve box\nfail out when outside bounds(box)\n\
                  let total : 1 = sum(v for v in box)\nlet rest : 1 = steady(x + y)\nsteady { box = 0.5 }\n\
                  episode { step = 0.1 [s], max_steps = 1 }\n";
    let found = last("tuples", source, &["obs.x", "obs.y", "total", "rest"]);
    let e = (-0.1_f64).exp();
    let (x, y) = (1.0 + 2.0 * e, 1.0 + e * (5.0 + 2.0 * 0.1));
    assert!((found[0] - x).abs() < 1e-5 && (found[1] - y).abs() < 1e-5 && (found[2] - x - y).abs() < 1e-5, "{found:?}");
    assert_eq!(found[3], 1.0);
}

#[test]
fn ranges_have_a_first_and_a_last_number() {
    for n in [4, 40] {
        let source = format!(
            "time t : s\nset trays = 3..{n}\nstate x[k in trays] = k\n\
             eq d/dt x[k] = (if k == trays.last then 0 else x[k+1] - x[k])/1 [s] for k in trays\n\
             let top : 1 = x[trays.last]\nlet low : 1 = x[trays.first]\nlet ends : 1 = trays.first + 100*trays.last\n\
             let s : 1 = sum(x[k] for k in trays if k == k.first)\nepisode {{ step = 1 [s], max_steps = 1 }}\n"
        );
        let found = last("ends", &source, &["top", "ends"]);
        assert_eq!(found, [f64::from(n), f64::from(3 + 100 * n)]);
    }
}

#[test]
fn arrays_take_values_by_member() {
    let source = format!(
        "{HEAD}param k[species] : 1/min = {{ A: 1, B: 120, default: 6 }}\n\
         state x[i in species] : L = {{\n  A: 1\n  B: 500 [mL], C: 2*1.5\n  D: 0\n}} in 0..10\n\
         let r[j in species] : L/s = {{ A: k[j]*x[j], B: -k[A]*x[A], default: 0 }}\neq d/dt x[i] = 0*r[i] for i in species\n\
         set cells = 1..3\nlet y[c in cells] = {{ 1: 10, default: 7 }}\nlet y_sum : 1 = sum(y[c] for c in cells)\n{TAIL}"
    );
    let found = last("members", &source, &["x[A]", "x[B]", "x[C]", "x[D]", "r[A]", "r[B]", "r[D]", "y_sum"]);
    assert_eq!(found[..4], [1.0, 0.5, 3.0, 0.0]);
    assert!((found[4] - 1.0 / 60.0).abs() < 1e-15 && (found[5] + 1.0 / 60.0).abs() < 1e-15);
    assert_eq!(found[6..], [0.0, 24.0]);
}

#[test]
fn faults_of_sets_and_members_have_their_place_and_a_way_out() {
    for (line, message) in [
        ("set f = species - solid", "the set `f` is made of sets, this is not one"),
        ("set f = solids - species", "the set `f` has no members"),
        ("let a : 1 = sum(1 for i in species if i in solid)", "did you mean `solids`?"),
        ("let a : 1 = if z in solids then 1 else 0", "only an index over a set is among the members of a set"),
        ("param k[species] = { A: 1, B: 2, C: 3 }", "the member `D` has no value"),
        ("param k[species] = { A: 1, B: 2, Q: 3, default: 0 }", "`Q` is not a member of `species`"),
        ("param k = { A: 1 }", "values by member belong to an array over a set"),
        ("param k[species] = { A: 1, A: 2, default: 3 }", "`A` is twice in the values"),
        ("state y[i in species - solids] = 1", "name the members: `set fluids = species - solids`"),
        ("let a : 1 = species.last", "`species` is a set of names, which have no numbers"),
        ("set pair = (z, w)\nlet a : 1 = sum(x for x in pair)", "unknown name `w`"),
    ] {
        let output = smpl(&["check", name(&file("faults", "m.eq", format!("{HEAD}{line}\n{TAIL}")))]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message), "{line}\n{shown}");
        assert_eq!(shown.matches('×').count(), 1, "one cause is one diagnostic: {shown}");
    }
}

#[test]
fn the_formatter_keeps_sets_and_values_by_member() {
    let source = "set fluids = species - solids\nset box = (x, y)\nstate x[i in s] : L = { A: 1, B: 2 } in 0..3    \"text\"\nlet a = sum(1 for i in a - b if i in c)\n";
    let path = file("format", "m.eq", source);
    assert_eq!(status(&smpl(&["fmt", name(&path)])), 0);
    assert_eq!(std::fs::read_to_string(&path).expect("a text"), source);
}
