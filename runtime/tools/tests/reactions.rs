//! Reactions: source terms against closed forms, stoichiometry, balances and faults.

mod shell;

use shell::{beside, file, name, smpl, status, text};

/// Columns of a run, row by row.
fn run(test: &str, source: &str, columns: &[&str], more: &[&str]) -> Vec<Vec<f64>> {
    let path = file(test, "m.eq", source);
    let out = beside(&path, "out.csv");
    let output = smpl(&[&["simulate", name(&path), "--out", name(&out)], more].concat());
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let table = std::fs::read_to_string(&out).expect("a table");
    let header = table.lines().next().expect("a header");
    let at: Vec<usize> = columns
        .iter()
        .map(|column| {
            let before = header.find(&format!(",{column},")).or_else(|| header.find(&format!(",\"{column}\",")));
            let before = before.unwrap_or_else(|| panic!("no {column} in {header}"));
            // Commas inside of quoted names do not separate.
            let mut quoted = false;
            header[..=before]
                .chars()
                .filter(|c| {
                    quoted ^= *c == '"';
                    *c == ',' && !quoted
                })
                .count()
        })
        .collect();
    let cell = |row: &str, at: usize| row.split(',').nth(at).expect("a cell").parse().expect("a number");
    table.lines().skip(1).map(|row| at.iter().map(|&at| cell(row, at)).collect()).collect()
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() < tolerance * expected.abs().max(1.0), "{found} is not {expected}");
}

/// Growth on a substrate with oxygen, at a constant specific rate.
const GROWTH: &str = "time t : h\nset species = { S, O2, X }\nparam mu : 1/h = 0.3\n\
                      reaction growth: S + 2 O2 -> 1.1 X rate mu*c[X]\n\
                      state c[i in species] : mol/L = if i == X then 0.1 else 10 in 0..20\n\
                      eq d/dt c[i] = source[i] for i in species\n\
                      let nu_O : 1 = stoichiometry[growth, O2]\nlet nu_X : 1 = sum(stoichiometry[j, X] for j in reactions)\n\
                      let speed : mol/(L h) = growth\n\
                      episode { step = 0.7 [h], max_steps = 8 }\nsolver { rtol = 1e-10 }\n";

#[test]
fn species_follow_the_closed_form_of_exponential_growth_by_every_method() {
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let rows = run("growth", GROWTH, &["c[S]", "c[O2]", "c[X]", "speed", "nu_O", "nu_X"], &["--method", method]);
        for (step, row) in rows.iter().enumerate() {
            let x = 0.1 * (1.1 * 0.3 * 0.7 * step as f64).exp();
            let used = (x - 0.1) / 1.1;
            near(row[0], 10.0 - used, 1e-7);
            near(row[1], 10.0 - 2.0 * used, 1e-7);
            near(row[2], x, 1e-7);
            near(row[3], 0.3 * x, 1e-7);
            assert_eq!(row[4..], [-2.0, 1.1]);
        }
    }
}

#[test]
fn a_reaction_runs_in_every_cell_of_a_domain_and_for_every_member_of_a_set() {
    let source = "time t : s\nset species = { A, B, W }\nset solutes = { A, B }\nparam L : m = 1\ndomain z in 0..L cells 3\n\
                  table k[solutes] : 1/s = { A: 0.5, B: 0.2 }\n\
                  reaction decay[j in solutes, z]: j -> 2 W rate k[j]*c[j, z]\n\
                  reaction exchange: A -> B rate 0.01 [mol/(L s)]\n\
                  state c[i in species, z] : mol/L = z/L in 0..20\n\
                  eq d/dt c[i, z] = source[i, z] for i in species, z\n\
                  episode { step = 0.5 [s], max_steps = 4 }\nsolver { rtol = 1e-10 }\n";
    for row in run("fields", source, &["time", "c[A,1]", "c[B,3]", "c[W,2]", "c[A,2]", "c[B,2]"], &[]) {
        // dA/dt = -k A - r, from z/L; dB/dt = -k B + r.
        let line = |k: f64, r: f64, start: f64| (start - r / k) * (-k * row[0]).exp() + r / k;
        near(row[1], line(0.5, -0.01, 1.0 / 6.0), 1e-7);
        near(row[2], line(0.2, 0.01, 5.0 / 6.0), 1e-7);
        // W gains twice what A and B lose; the exchange moves A to B.
        near(row[3], 0.5 + 2.0 * (1.0 - row[4] - row[5]), 1e-7);
    }
}

#[test]
fn coefficients_may_be_parameters_and_carry_units() {
    let source = "time t : h\nset species = { S, O, X }\nparam Y = 0.5\nparam b : mol/g = 0.02\n\
                  reaction growth: (1/Y) S + b O -> X rate 0.4 [g/(L h)]\n\
                  reaction upkeep: 0.25 S + S -> 0.25 S rate 0.1 [g/(L h)]\n\
                  state S : g/L = 10\nstate O : mol/L = 1\nstate X : g/L = 0\n\
                  eq d/dt S = source[S]\neq d/dt O = source[O]\neq d/dt X = source[X]\n\
                  let nu : mol/g = stoichiometry[growth, O]\nlet none : 1 = stoichiometry[upkeep, X]\n\
                  episode { step = 1 [h], max_steps = 3 }\n";
    for row in run("units", source, &["time", "S", "O", "X", "nu", "none"], &[]) {
        let t = row[0];
        near(row[1], 10.0 - 0.9 * t, 1e-9);
        near(row[2], 1.0 - 0.008 * t, 1e-9);
        near(row[3], 0.4 * t, 1e-9);
        assert_eq!(row[4..], [-0.02, 0.0]);
    }
    let rows = run("units", source, &["S"], &["--set", "Y=0.8"]);
    near(rows[3][0], 10.0 - 3.0 * (0.5 + 0.1), 1e-9);
}

#[test]
fn rates_of_an_array_components_and_variants_work_with_reactions() {
    let source = "time t : s\nset species = { A, B }\n\
                  component Tank {\n  param k : 1/s = 1\n  state c[i in species] : mol/L = if i == A then 1 else 0 in 0..2\n\
                  \x20 reaction forward: A -> B\n  reaction backward: B -> A\n\
                  \x20 let rate[j in reactions] = if j == forward then k*c[A] else 0.5*k*c[B]\n\
                  \x20 eq d/dt c[i] = source[i] for i in species\n}\n\
                  use Tank as T1\nuse Tank as T2(k = 2 [1/s])\n\
                  reaction drip: -> A rate 0.1 [mol/(L s)]\nstate A : mol/L = 0\neq d/dt A = source[A]\n\
                  variant drain { reaction drip: A -> rate 0.1 [mol/(L s)] }\n\
                  episode { step = 0.3 [s], max_steps = 3 }\nsolver { rtol = 1e-10 }\n";
    let balance = |k: f64, t: f64| 1.0 / 3.0 + 2.0 / 3.0 * (-1.5 * k * t).exp();
    for row in run("parts", source, &["time", "T1.c[A]", "T2.c[A]", "A"], &[]) {
        near(row[1], balance(1.0, row[0]), 1e-7);
        near(row[2], balance(2.0, row[0]), 1e-7);
        near(row[3], 0.1 * row[0], 1e-9);
    }
    let rows = run("parts", source, &["A"], &["--variant", "drain"]);
    near(rows[3][0], -0.09, 1e-9);
}

#[test]
fn reactions_with_formulas_balance_in_elements_and_charge() {
    let set = "set species = { glucose \"C6H12O6\", O2 \"O2\", NH3 \"NH3\", NH4 \"NH4+\", H \"H+\", X \"CH1.8O0.5N0.2\", CO2 \"CO2\", H2O \"H2O\" }\n";
    // Coefficients computed manually from the balances of C, H, O and N for 3 X a glucose.
    let right = "reaction growth: glucose + 2.85 O2 + 0.6 NH3 -> 3 X + 3 CO2 + 4.2 H2O rate 1 [mol/(L h)]\nreaction acid: NH4 -> NH3 + H rate 0 [mol/(L h)]\n";
    let model = |text: &str| format!("time t : h\n{set}{text}state x : mol/L = 0\neq d/dt x = source[X]\n");
    let shown = |text: &str| {
        let output = smpl(&["check", name(&file("balance", "m.eq", model(text)))]);
        (status(&output), shell::text(&output.stderr))
    };
    let (code, message) = shown(right);
    assert_eq!(code, 0, "{message}");
    let (code, message) = shown(&right.replace("3 CO2", "2 CO2"));
    assert!(code == 1 && message.contains("the reaction `growth` does not balance in C (6 consumed, 5 produced), O"), "{message}");
    assert!(message.contains("add the species that are missing"), "{message}");
    let (code, message) = shown(&right.replace("NH3 + H rate", "NH3 rate"));
    assert!(
        code == 1 && message.contains("`acid` does not balance in H (4 consumed, 3 produced), charge (1 consumed, 0 produced)"),
        "{message}"
    );
    let (code, message) = shown(&right.replace("0.6 NH3", "0.59 NH3"));
    assert!(code == 1 && message.contains("N (0.59 consumed, 0.6 produced)"), "{message}");
}

#[test]
fn molar_masses_that_are_not_kept_are_a_warning() {
    let model = |nu: &str| {
        format!(
            "time t : s\ntable over species {{\n  columns: M [g/mol]\n  A: 30\n  B: 60\n}}\nreaction dimer: {nu} A -> B rate 1 [mol/(L s)]\n\
             state b : mol/L = 0\neq d/dt b = source[B]\nepisode {{ step = 1 [s], max_steps = 2 }}\n"
        )
    };
    let shown = |nu: &str| shell::text(&smpl(&["check", name(&file("mass", "m.eq", model(nu)))]).stderr);
    assert!(!shown("2").contains("W0610"), "{}", shown("2"));
    assert!(shown("3").contains("the reaction `dimer` consumes the mass 90 and produces 60 by its molar masses"), "{}", shown("3"));
}

#[test]
fn faults_of_reactions_have_their_place_and_a_way_out() {
    let head = "time t : h\nset species = { S, X }\nset other = { P, Q }\nstate x : g/L = 1\n";
    for (lines, message) in [
        ("reaction r: S -> Y rate x\neq d/dt x = source[X]", "the species `Y` is not a member of `species`"),
        ("reaction r: Z -> Y rate x\neq d/dt x = -x/1 [h]", "the species `Z` is not a member of a set"),
        ("reaction r: S -> P rate x\neq d/dt x = source[X]/1 [h]", "is not a member of `species`"),
        ("reaction r: S -> X rate x\neq d/dt x = source[X]", "g/L"),
        ("reaction r: S -> X rate x/1 [h]\neq d/dt x = source[Q]", "`Q`"),
        ("reaction r: S -> X rate x/1 [h]\neq d/dt x = source", "`source` is an array and needs 1 index"),
        ("reaction r: S -> X\neq d/dt x = source[X]", "the reaction `r` has no rate"),
        ("reaction r: -> rate x\neq d/dt x = -x/1 [h]", "the reaction `r` has no species"),
        ("reaction r: S -> X rate x/1 [h]\nreaction r: X -> S rate x/1 [h]\neq d/dt x = source[X]", "`r`"),
        ("reaction r: S -> X rate x/1 [h]\nlet source = 1\neq d/dt x = -x/1 [h]", "`source` is declared twice"),
        ("reaction r: S = X rate x/1 [h]\neq d/dt x = -x/1 [h]", "expected"),
        ("set wrong = { A \"Glucose!\" }\neq d/dt x = -x/1 [h]", "`Glucose!` is not the formula of a species"),
    ] {
        let output = smpl(&["check", name(&file("faults", "m.eq", format!("{head}{lines}\n")))]);
        let shown = text(&output.stderr);
        assert!(status(&output) == 1 && shown.contains(message), "{lines}\n{shown}");
        assert_eq!(shown.matches('×').count(), 1, "one cause is one diagnostic: {shown}");
    }
}

#[test]
fn the_formatter_and_the_page_of_a_model_know_reactions() {
    let rough = "time t : h\nset species={S \"CH2O\",X}\nreaction   growth[z] :S + 2   X->1.1 X   rate   x \"text\"\n";
    let path = file("format", "m.eq", rough);
    assert_eq!(status(&smpl(&["fmt", name(&path)])), 0);
    let formatted = std::fs::read_to_string(&path).expect("a text");
    assert!(
        formatted.contains("set species = { S \"CH2O\", X }\nreaction growth[z]: S + 2 X -> 1.1 X    rate x    \"text\""),
        "{formatted}"
    );
    let page = text(&smpl(&["doc", name(&file("page", "m.eq", GROWTH))]).stdout);
    assert!(page.contains("Reaction `growth`"), "{page}");
    assert!(page.contains("S + 2\\,") && page.contains("\\rightarrow 1.1\\,X"), "{page}");
}
