//! Rates and algebraic variables: what is substituted, what is solved for, and the numbers that come out.

mod running;

use running::{Running, assert_close, flat};
use smpl_compiler::model::AlgebraicCounts;

#[test]
fn an_equation_gets_the_factor_of_its_units() {
    let mut r = Running::new(
        "time t : h
         param q : mL/min = 5
         state V : L = 1
         eq d/dt V = q",
    );
    assert_close(r.rate("V"), 0.3);
}

#[test]
fn a_rate_with_a_factor_is_solved_for() {
    let mut r = Running::new(
        "param V : L = 4
         state c = 2
         eq V * d/dt c + 3 [L/s] = -c * 1 [L/s] - V * d/dt c",
    );
    assert!(r.model.explicit());
    assert_close(r.rate("c"), -5.0 / 8.0);
}

#[test]
fn derivatives_on_right_sides_are_the_rates() {
    let mut r = Running::new(
        "state x = 2
         state y = 3
         state z = 5
         eq d/dt z = der(y) + d/dt x
         eq d/dt y = 2 * der(x)
         eq d/dt x = -x / 1 [s]
         let w : 1/s = der(z)",
    );
    assert!(r.model.explicit());
    assert_close(r.rate("z"), -6.0);
    assert_close(r.output("w"), -6.0);
}

#[test]
fn derivatives_of_neighbouring_cells_are_their_rates() {
    let mut r = Running::new(
        "domain z in 0..1 cells 4
         state c[z] = 1
         state q[z] = 1
         eq d/dt q[z] = -der(c[z]) for z
         eq d/dt c[z] = -z * c[z] / 1 [s] for z",
    );
    assert!(r.model.explicit());
    assert_close(r.rate("q[3]"), 0.625);
}

#[test]
fn coupled_rates_stay_implicit() {
    let mut r = Running::new(
        "state x = 1
         state y = 2
         eq d/dt x + d/dt y = 3 / 1 [s]
         eq d/dt x - d/dt y = 1 / 1 [s]",
    );
    assert!(!r.model.explicit());
    r.yp.copy_from_slice(&[2.0, 1.0]);
    r.rates().into_iter().for_each(|f| assert_close(f, 0.0));
}

#[test]
fn explicit_variables_vanish_in_any_order() {
    let model = flat(
        "state x = 2
         var a = 0
         var b = 0
         var c = 0
         eq d/dt x = -c / 1 [s]
         eq c = b + a
         eq a = 3 * x
         eq b = a^2",
    );
    assert_eq!(model.interface.quantities.algebraic_counts, AlgebraicCounts { declared: 3, solved: 0, substituted: 3 });
    let mut r = Running::of(model);
    assert_close(r.rate("x"), -42.0);
    assert_close(r.output("b"), 36.0);
}

#[test]
fn a_loop_of_definitions_keeps_one_unknown() {
    let model = flat(
        "state x = 2
         var a = 0
         var b = 0
         eq d/dt x = -a / 1 [s]
         eq a = x - b / 2
         eq b = x - a / 3",
    );
    assert_eq!(model.interface.quantities.algebraic_counts, AlgebraicCounts { declared: 2, solved: 1, substituted: 1 });
    let mut r = Running::of(model);
    let solved = r.names()[1].clone();
    // a = x - b/2, b = x - a/3: a = 6/5, b = 8/5 at x = 2.
    r.set(&solved, if solved == "a" { 1.2 } else { 1.6 });
    assert!(r.rate(&solved).abs() < 1e-15);
    assert!((r.rate("x") + 1.2).abs() < 1e-15);
}

/// A variable alone on one side is what the equation determines, unless something else fits better.
#[test]
fn a_second_equation_for_a_variable_determines_another_one() {
    let of = |lines: &str| Running::new(&format!("param M = 2\nstate x = 3\nvar a\nvar b\n{lines}"));
    let mut mass = of("eq M * d/dt x = a / 1 [s]\neq a = 3*b\neq b = x");
    assert_eq!(mass.model.unknowns(), 1);
    assert_close(mass.rate("x"), 4.5);
    for (lines, a, b) in [
        ("eq a = b\neq a = 2*x", 6.0, 6.0),
        ("eq a = 2*x\neq a = b", 6.0, 6.0),
        ("eq a^3 + b = a\neq a = x", 3.0, -24.0),
        ("eq a = b^3 + b\neq a = x + 7", 10.0, 2.0),
    ] {
        let mut r = of(&format!("{lines}\neq d/dt x = -x / 1 [s]"));
        for name in r.names().split_off(1) {
            r.set(&name, if name == "a" { a } else { b });
        }
        assert!(r.model.unknowns() > 1 && r.rates()[1..].iter().all(|residual| residual.abs() < 1e-14), "{lines}");
    }
}

#[test]
fn initial_values_follow_those_that_they_read() {
    let r = Running::new(
        "state y = 2*x[1]
         state x[i in 1..2] = 1
         initial x[i] = 0.5*i for i in 1..2
         eq d/dt x[i] = 0 for i in 1..2
         eq d/dt y = 0",
    );
    assert_eq!(["x[1]", "x[2]", "y"].map(|name| r.get(name)), [0.5, 1.0, 1.0]);
}

#[test]
fn implicit_variables_are_matched_to_the_equations_that_contain_them() {
    let mut r = Running::new(
        "state x = 2
         var a = 1
         var b = 1
         eq d/dt x = -a / 1 [s]
         eq a^2 + b^2 = 5
         eq a * b = 2",
    );
    assert_eq!(r.model.unknowns(), 3);
    r.set("a", 1.0).set("b", 2.0);
    assert_eq!(r.rate("a"), 0.0);
    assert_eq!(r.rate("b"), 0.0);
}

#[test]
fn variables_of_cells_are_solved_cell_by_cell() {
    let mut r = Running::new(
        "domain z in 0..1 cells 50
         state c[z] = 1
         var p[z] = 1
         eq d/dt c[z] = -p[z] / 1 [s] for z
         eq p[z]^3 + p[z] = c[z] for z",
    );
    assert_eq!(r.model.unknowns(), 100);
    r.set("p[7]", 2.0).set("c[7]", 10.0);
    assert_eq!(r.rate("p[7]").abs(), 0.0);
}

#[test]
fn a_variable_read_by_very_many_rows_is_kept() {
    let source = |n: usize| {
        format!(
            "domain z in 0..1 cells {n}
             state c[z] = 1
             var total = 1
             eq total = sum(c[z]^2 for z) / z.cells
             eq d/dt c[z] = -total * c[z] / 1 [s] for z"
        )
    };
    let large = Running::new(&source(500));
    assert!(large.model.pattern().nonzeros() < 3 * 501, "{} non-zeros: substituted", large.model.pattern().nonzeros());
}

#[test]
fn connections_convert_and_chain() {
    let mut r = Running::new(
        "connector A { Q : L/min, c : mol/L }
         component Source { port outlet : A ; eq outlet.Q = 6 [L/h] ; eq outlet.c = 2 [mmol/L] }
         component Tank { param V : L = 1
           port inlet, outlet : A
           state c : mol/m^3 = 0
           eq d/dt c = inlet.Q / V * (inlet.c - c)
           eq outlet.Q = inlet.Q
           eq outlet.c = c }
         use Source as S
         use Tank as T[k in 1..3](V = k * 1 [L])
         connect S.outlet -> T[1].inlet
         connect T[1].outlet -> T[2].inlet
         connect T[2].outlet -> T[3].inlet",
    );
    r.set("T[1].c", 1.0).set("T[2].c", 0.5);
    // 6 L/h through 1, 2 and 3 L; 2 mmol/L is 2 mol/m^3.
    assert_close(r.rate("T[1].c"), 6.0 / 3600.0);
    assert_close(r.rate("T[2].c"), 6.0 / 3600.0 / 2.0 * 0.5);
    assert_close(r.rate("T[3].c"), 6.0 / 3600.0 / 3.0 * 0.5);
}

/// A port's members are outputs; one that is nothing but an action, a parameter or a state, number by number, says so.
#[test]
fn ports_show_their_members() {
    let model = flat(
        "set species = {A, B}
         connector Stream { Q : L/min, c[species] : mol/L, T : K }
         connector Profile { T[z] : K }
         component Feed { param feed[species] : mol/L = 2 ; port outlet : Stream
           eq outlet.Q = pumped ; eq outlet.c[i] = feed[i] for i in species ; eq outlet.T = 300 [K] }
         component Tank { port inlet, outlet : Stream ; domain z in 0..1 [m] cells 5 ; port wall : Profile ; state n[species] : mol/L = 1
           state T[z] : K = 300
           eq d/dt n[i] = inlet.Q / 1 [L] * (inlet.c[i] - n[i]) for i in species
           eq d/dt T[z] = (inlet.T - T[z]) / 1 [min] for z
           eq outlet.Q = 2*inlet.Q ; eq outlet.c[i] = n[i] for i in species ; eq outlet.T = T[z.last] ; eq wall.T[z] = T[z] for z }
         action pumped : L/min = 1 in 0..2
         use Feed as F
         use Tank as R
         connect F.outlet -> R.inlet",
    );
    let interface = &model.interface;
    let ports: Vec<_> = interface.ports.iter().map(|port| (port.name.as_str(), port.connector.as_str())).collect();
    assert_eq!(ports, [("F.outlet", "Stream"), ("R.inlet", "Stream"), ("R.outlet", "Stream"), ("R.wall", "Profile")]);
    let members = interface.ports.iter().flat_map(|port| &port.members);
    let members: Vec<_> = members.map(|m| (m.output.as_str(), m.name.as_str(), m.equals.as_deref())).collect();
    let expected = [
        ("F.outlet.Q", "Q", Some("pumped")),
        ("F.outlet.c", "c", Some("F.feed")),
        ("F.outlet.T", "T", None),
        ("R.inlet.Q", "Q", Some("pumped")),
        ("R.inlet.c", "c", Some("F.feed")),
        ("R.inlet.T", "T", None),
        ("R.outlet.Q", "Q", None),
        ("R.outlet.c", "c", Some("R.n")),
        ("R.outlet.T", "T", None),
        ("R.wall.T", "T", Some("R.T")),
    ];
    assert_eq!(members, expected);
    let units: Vec<_> = interface.quantities.algebraics.iter().map(|q| (q.name.as_str(), q.unit.as_str(), q.len())).collect();
    assert_eq!(units[..3], [("F.outlet.Q", "L/min", 1), ("F.outlet.c", "mol/L", 2), ("F.outlet.T", "K", 1)]);
    assert_eq!(units.last(), Some(&("R.wall.T", "K", 5)));
    let mut r = Running::of(model);
    r.set("R.n[B]", 0.25).set("R.T[5]", 310.0);
    assert_close(r.output("R.outlet.c[B]"), 0.25);
    assert_close(r.output("R.outlet.T"), 310.0);
    assert_close(r.output("R.wall.T[5]"), 310.0);
    assert_close(r.output("R.outlet.Q"), 2.0);
}

#[test]
fn instances_have_their_own_variables() {
    let mut r = Running::new(
        "param k : 1/s = 10
         component A { param k : 1/s = 2 ; state x = 1 ; let y : 1 = 3 * x ; eq d/dt x = -k * x }
         component B { state x = 1 ; use A as inner(k = 5 [1/min]) ; eq d/dt x = -k * inner.x }
         use A as a
         use B as b",
    );
    assert_close(r.rate("a.x"), -2.0);
    assert_close(r.rate("b.x"), -10.0);
    assert_close(r.rate("b.inner.x"), -5.0 / 60.0);
    assert_close(r.output("b.inner.y"), 3.0);
}

#[test]
fn states_of_one_domain_lie_cell_by_cell_outside() {
    let model = flat(
        "set s = { a, b }
         domain z in 0..1 cells 3
         state p = 1
         state c[s, z] = 1
         state q[z] = 1
         state r = 1
         eq d/dt p = -p / 1 [s]
         eq d/dt c[i, z] = -c[i, z] / 1 [s] for i in s, z
         eq d/dt q[z] = -q[z] / 1 [s] for z
         eq d/dt r = -r / 1 [s]
         observe states",
    );
    let names: Vec<&str> = model.interface.finish.observations.iter().map(|o| o.name.as_str()).collect();
    let expected = ["p", "c[a,1]", "c[b,1]", "q[1]", "c[a,2]", "c[b,2]", "q[2]", "c[a,3]", "c[b,3]", "q[3]", "r"];
    assert_eq!(names, expected);
    // Inside arrays stay whole: p, c[a,..], c[b,..], q, r.
    assert_eq!(model.interface.quantities.state_order, Some(vec![0, 1, 4, 7, 2, 5, 8, 3, 6, 9, 10]));
}

#[test]
fn variants_and_choices_replace_by_name() {
    use smpl_compiler::elaborate::Options;
    let source = "choice law = linear | square
         state x = 3
         param k : 1/s = 2
         let r = x
         eq d/dt x = -k * r
         when law = square { let r = x^2 }
         variant fast { param k : 1/s = 20 }
         variant both { eq d/dt x = -x / 1 [s] + (if law == square then 1 [1/s] else 0) }";
    let rate = |variants: &[(&str, &str)]| {
        let variants = variants.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        let model = running::flat_with(source, &Options { variants, ..Options::default() });
        Running::of(model).rate("x")
    };
    assert_close(rate(&[]), -6.0);
    assert_close(rate(&[("law", "square")]), -18.0);
    assert_close(rate(&[("fast", "true")]), -60.0);
    assert_close(rate(&[("fast", "true"), ("law", "square")]), -180.0);
    assert_close(rate(&[("both", "true"), ("law", "square")]), -2.0);
}

#[test]
fn what_the_trajectory_shows_counts_as_a_declared_algebraic_variable() {
    let r = Running::new(
        "state x = 1
         var a = 0
         var s = 1
         let b : 1 = 2 * a
         let short = 3 * b
         eq d/dt x = -short / 1 [s]
         eq a = x + 1
         eq s^2 = x",
    );
    let interface = r.model.interface();
    assert_eq!(interface.quantities.algebraics.iter().map(|q| q.name.as_str()).collect::<Vec<_>>(), ["a", "s", "b"]);
    // Declared, solved, substituted.
    assert_eq!(interface.quantities.algebraic_counts, AlgebraicCounts { declared: 3, solved: 1, substituted: 2 });
}

/// A model over `1..20` whose rates read time, and what `by_time` gives at t = 0.7 s; `None` where it is not known.
fn by_time(rate: &str) -> Option<Vec<f64>> {
    let mut r = Running::new(&format!(
        "time t : s
         set s = 1..20
         table feed : 1 over time : s linear {{ 0: 1, 0.5: 2, 1: 5 }}
         state x[i in s] = 0.1*i
         eq d/dt x[i] = ({rate}) / 1 [s] for i in s"
    ));
    let mut out = vec![f64::NAN; 20];
    r.model.by_time(&mut r.memory, 0.7, &r.y, &r.yp, &mut out).then_some(out)
}

#[test]
fn derivatives_by_time_are_those_of_what_time_moves() {
    let numbered = |slope: &dyn Fn(f64) -> f64| (1..=20).map(|i| slope(f64::from(i))).collect::<Vec<_>>();
    let angle = "2*t/1 [s]";
    for (rate, slope) in [
        (format!("i*sin({angle})*x[i]"), numbered(&|i| i * 2.0 * 1.4_f64.cos() * 0.1 * i)),
        (
            "sum(cos(j*t/1 [s])*x[j] for j in s)".to_owned(),
            numbered(&|_| (1..=20).map(|j| -0.1 * f64::from(j * j) * (0.7 * f64::from(j)).sin()).sum()),
        ),
        ("feed(t) + x[i]".to_owned(), numbered(&|_| 6.0)),
        (format!("if t < 0.5 [s] then 0 else exp(-{angle})"), numbered(&|_| -2.0 * (-1.4_f64).exp())),
        ("min(j*t/1 [s] for j in s) - x[i]".to_owned(), numbered(&|_| 1.0)),
        (format!("x[i]^2/({angle})"), numbered(&|i| -2.0 * (0.1 * i).powi(2) / 1.4_f64.powi(2))),
    ] {
        let found = by_time(&rate).unwrap_or_else(|| panic!("{rate}"));
        found.iter().zip(&slope).for_each(|(found, slope)| assert_close(*found, *slope));
    }
    assert_eq!(by_time("-x[i]"), None, "time does not occur");
}
