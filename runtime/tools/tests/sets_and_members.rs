//! Sets made of sets, membership, named tuples of variables, ends of ranges, values by member.

mod shell;

use shell::{beside, columns, file, name, smpl, status, text};

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
fn sums_of_sets_and_lists_serve_wherever_an_index_is_bound_or_tested() {
    let source = format!(
        "{HEAD}table k[species] = {{ A: 1, B: 20, C: 300, D: 4000 }}\n\
         set q = species - {{ B }}\nset r = {{ A }} + solids\nset u = species - (solids + {{ A }})\n\
         set w = species - {{\n  A\n  solids\n}}\n\
         let a : 1 = sum(k[i] for i in q)\nlet b : 1 = sum(k[i] for i in r)\nlet c : 1 = sum(k[i] for i in u)\n\
         let d : 1 = sum(k[i] for i in w)\nlet e1 : 1 = sum(k[i] for i in species - {{A, D}})\n\
         let f : 1 = sum(if i in species - solids then k[i] else 0 for i in species)\n\
         let g : 1 = sum(k[i] for i in species if i in (solids - C) + {{A}})\n\
         let h : 1 = sum(k[i] for i in species if not i in species - {{ B, C }} and i != A)\n{TAIL}"
    );
    let found = last("lists", &source, &["a", "b", "c", "d", "e1", "f", "g", "h"]);
    assert_eq!(found, [4301.0, 4301.0, 20.0, 20.0, 320.0, 21.0, 4001.0, 320.0]);
}

/// Heat between all pairs of bodies: the sum is conserved, and the differences from the mean decay by exp(-n k t).
#[test]
fn equations_hold_for_the_indices_that_a_condition_leaves() {
    for n in [3, 20] {
        let source = format!(
            "time t : s\nset s = 1..{n}\nparam k : 1/s = 0.1\nstate T[i in s] : K = i*1 [K]\nvar Q[i in s, j in s] : K/s\n\
             eq Q[i, j] = k*(T[j] - T[i]) for i in s, j in s if i != j\neq Q[i, i] = 0 for i in s\n\
             eq d/dt T[i] = sum(Q[i, j] for j in s) for i in s\nepisode {{ step = 1 [s], max_steps = 1 }}\n\
             solver {{ rtol = 1e-9 }}\n"
        );
        let found = last("pairs", &source, &["T[1]", &format!("T[{n}]")]);
        let (n, decay) = (f64::from(n), (-0.1 * f64::from(n)).exp());
        let mean = (n + 1.0) / 2.0;
        for (value, start) in found.iter().zip([1.0, n]) {
            assert!((value - (mean + (start - mean) * decay)).abs() < 1e-6, "{n}: {found:?}");
        }
    }
}

#[test]
fn conditions_on_indices_cut_loops_over_cells_and_ranges() {
    let source = "time t : s\ndomain z in 0..1 cells 30\nstate c[z] = 5\nstate y[k in 1..30] = 2\nset s = { A, B, C }\nstate x[s] = 1\n\
         eq d/dt c[z] = -c[z]/1 [s] for z if z != z.first\neq d/dt c[1] = 1/1 [s]\n\
         eq d/dt y[k] = -y[k]/1 [s] for k in 1..30 if k <= 10 or k > 20\neq d/dt y[k] = 0 for k in 11..20\n\
         eq d/dt x[i] = 0 for i in s\ninitial x[i] = 3 for i in s if not i in {A, C}\ninitial y[k] = 4 for k in 1..30 if k == 5\n\
         discrete d[s] = 0\nat start { next d[i] = 7 for i in s if i != B ; reset c[z] = 6 for z if z == z.last }\n\
         observe x[i] for i in s if i != B\nepisode { step = 1 [s], max_steps = 1 }\nsolver { rtol = 1e-9 }\n";
    let names = ["c[1]", "c[2]", "c[30]", "y[1]", "y[5]", "y[15]", "y[30]", "x[A]", "x[B]", "obs.x[C]", "d[A]", "d[B]"];
    let found = last("cuts", source, &names);
    let e = (-1.0_f64).exp();
    let expected = [6.0, 5.0 * e, 6.0 * e, 2.0 * e, 4.0 * e, 2.0, 2.0 * e, 1.0, 3.0, 1.0, 7.0, 0.0];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}\n{expected:?}");
}

/// x[2] rests at 2 s * 1/s = 2, the others start at 5; in the chain y[C] rests where 3 y[C] = y[A] + y[B].
#[test]
fn a_steady_start_holds_for_one_member() {
    let source = "time t : s\nstate x[k in 1..20] = 5\neq d/dt x[k] = 1/1 [s] - x[k]/(k*1 [s]) for k in 1..20\n\
         set s = { A, B, C }\nstate y[i in s] = { A: 4, B: 5, C: 1 }\neq d/dt y[A] = -y[A]/1 [s]\neq d/dt y[B] = -y[B]/2 [s]\n\
         eq d/dt y[C] = (y[A] + y[B] - 3*y[C])/1 [s]\ninitial steady for x[2], y[C]\nepisode { step = 1 [s], max_steps = 1 }\n";
    let path = file("one member", "m.eq", source);
    let rows = columns(&path, &["x[1]", "x[2]", "x[20]", "y[A]", "y[C]"], &["--start", "nominal"]);
    let start: Vec<f64> = rows.iter().map(|column| column[0]).collect();
    assert!(start.iter().zip([5.0, 2.0, 5.0, 4.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{start:?}");
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
        ("set q = species - { solid }", "did you mean `solids`?"),
        ("let a : 1 = sum(1 for i in species - solid)", "did you mean `solids`?"),
        ("let a : 1 = sum(1 for i in species if i in solids - { Ax })", "unknown set `Ax`"),
        ("var w[i in species]\neq w[i] = z for i in species if z > 0", "must be known to the compiler"),
        ("var w[i in species]\neq w[i] = z for i in species if 2", "a condition is needed here"),
        ("var w = 1 ~ normal(0, 1)\neq w = z", "has no value at the start that `~` could draw"),
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
    let source = "set fluids = species - solids\nset box = (x, y)\nstate x[i in s] : L = { A: 1, B: 2 } in 0..3    \"text\"\nlet a = sum(1 for i in a - b if i in c)\nset q = s - { W, X }\n\
                  eq x[i, j] = 0    for i in s, j in s - { W } if i != j and i in a - { B }\n";
    let path = file("format", "m.eq", source);
    assert_eq!(status(&smpl(&["fmt", name(&path)])), 0);
    assert_eq!(std::fs::read_to_string(&path).expect("a text"), source);
}

/// Means and standard deviations of 100 starts; `initial` overrides a draw in place, and the nominal start is the mean.
#[test]
fn starts_are_drawn_where_they_are_declared() {
    let source = "time t : s\nset s = { A, B }\nstate x = 3 ~ normal(2, 0.5) clip bounds in 0..9\nstate y[i in s] = 1 ~ uniform(0, 2)*(if i == A then 1 else 10)\n\
         discrete d = 5 ~ normal(7, 0.1)\nstate z = 1 ~ normal(50, 1)\ninitial z = 4\n\
         eq d/dt x = 0\neq d/dt z = 0\neq d/dt y[i] = 0 for i in s\nepisode { step = 1 [s], max_steps = 1 }\n";
    let path = file("drawn", "m.eq", source);
    let names = ["x", "y[A]", "y[B]", "d", "z"];
    let starts = |more: &[&str]| columns(&path, &names, more).iter().map(|column| column[0]).collect::<Vec<f64>>();
    assert_eq!(starts(&["--start", "nominal"]), [2.0, 1.0, 10.0, 7.0, 4.0]);
    let runs: Vec<Vec<f64>> = (0..100).map(|seed| starts(&["--seed", &seed.to_string()])).collect();
    let mean = |k: usize| runs.iter().map(|run| run[k]).sum::<f64>() / 100.0;
    let deviation = |k: usize| (runs.iter().map(|run| (run[k] - mean(k)).powi(2)).sum::<f64>() / 100.0).sqrt();
    let expected = [(2.0, 0.5), (1.0, 1.0 / 3.0_f64.sqrt()), (10.0, 10.0 / 3.0_f64.sqrt()), (7.0, 0.1), (4.0, 0.0)];
    for (k, (centre, spread)) in expected.into_iter().enumerate() {
        assert!((mean(k) - centre).abs() <= 4.0 * spread / 10.0, "{}: {}", names[k], mean(k));
        assert!((deviation(k) - spread).abs() <= 0.3 * spread, "{}: {}", names[k], deviation(k));
    }
}

/// p = N T: the condition moves both alike, so that the first one follows.
#[test]
fn the_check_warns_of_conditions_that_replace_a_declared_value_unnamed() {
    let vessel = "time t : s\nstate N : mol = 1\nstate T : K = 300\nvar p : mol*K\neq p = N*T\neq d/dt N = -N/1 [s]\neq d/dt T = 0\n\
                  episode { step = 1 [s], max_steps = 1 }\n";
    let path = |condition: &str| file("replaced", "m.eq", format!("{vessel}initial {condition}\n"));
    let of = |condition: &str| smpl(&["check", name(&path(condition))]);
    let output = of("eq p = 600 [mol K]");
    let shown = text(&output.stderr);
    assert!(status(&output) == 0 && text(&output.stdout).contains("1 warning"), "{shown}");
    let expected = ["W0611-replaced-start", "this condition determines `N`, whose declared value 1 mol is only a guess", "declared here"];
    assert!(expected.iter().all(|part| shown.contains(part)), "{shown}");
    for condition in ["eq p = 600 [mol K] free N", "d/dt N = -2 [mol/s]", "steady for N"] {
        assert_eq!(text(&of(condition).stderr), "", "{condition}");
    }
    let scenario = beside(&path("eq p = 600 [mol K]"), "m.cold.yaml");
    std::fs::write(&scenario, "initial: { N: 3 }\n").expect("a file");
    let held = smpl(&["check", name(&path("eq p = 600 [mol K]")), "--scenario", "cold"]);
    assert_eq!((status(&held), text(&held.stderr)), (0, String::new()));
    let starts = columns(&path("eq p = 600 [mol K]"), &["N", "T", "p"], &["--scenario", "cold"]);
    assert_eq!(starts.iter().map(|column| column[0]).collect::<Vec<_>>(), [3.0, 300.0, 900.0]);
    let compiled = smpl(&["compile", name(&path("eq p = 600 [mol K]"))]);
    assert!(text(&compiled.stdout).contains("set by conditions     N (guess 1 mol)"), "{}", text(&compiled.stdout));
}

#[test]
fn the_check_finds_conditions_at_the_start_that_are_too_many() {
    let vessel = "time t : s\nstate N : mol = 1\nstate T : K = 300\nvar p : mol*K\neq p = N*T\neq d/dt N = -N/1 [s]\neq d/dt T = 0\n";
    let of = |conditions: &str| smpl(&["check", name(&file("starts", "m.eq", format!("{vessel}{conditions}")))]);
    assert_eq!(status(&of("initial eq p = 2 [mol K]\ninitial eq N = 2 [mol]\n")), 0);
    for conditions in ["initial eq N = 2 [mol]\ninitial eq 2*N = 3 [mol]\n", "initial eq N = 2 [mol] free T\n"] {
        let output = of(conditions);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains("no state is left for this one") && shown.contains("m.eq:"), "{shown}");
        assert_eq!(shown.matches('×').count(), 1, "{shown}");
    }
}
