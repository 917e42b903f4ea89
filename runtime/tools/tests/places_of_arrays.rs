//! The index of an extreme and values between the places of an array, against closed forms.

mod shell;

use shell::{columns, file, name, smpl, status, text};

/// The last row of a run.
fn last(test: &str, source: &str, wanted: &[&str]) -> Vec<f64> {
    let rows = columns(&file(test, "m.eq", source), wanted, &[]);
    rows.iter().map(|column| *column.last().expect("a row")).collect()
}

const TAIL: &str = "state w = 0\neq d/dt w = 0\nepisode { step = 1 [s], max_steps = 1 }\n";

#[test]
fn the_index_of_an_extreme_is_a_number_a_position_or_a_place() {
    let source = format!(
        "time t : s\nset names = {{ A, B, C }}\ntable k[names] = {{ A: 1, B: 7, C: 7 }}\nset trays = 3..40\n\
         let y[j in trays] = (j - 20.2)^2\ndomain z in 1 [m]..3 [m] cells 50\nlet T[z] : degC = celsius(300 [K] - 10 [K/m^2]*(z - 2.21 [m])^2)\n\
         let a : 1 = argmax(k[i] for i in names)\nlet b : 1 = argmin(k[i] for i in names)\nlet c : 1 = argmax(k[i] for i in names if i != B)\n\
         let d : 1 = argmin(y[j] for j in trays)\nlet f : 1 = argmax(y[j] for j in trays if j > 10)\nlet g : m = argmax(T[z] for z)\n\
         let h : 1 = argmin(x for x in (w, 3, -2, 5))\nlet m : m = argmax(T[z] for z in 2..z.last-25)\n{TAIL}"
    );
    let found = last("index", &source, &["a", "b", "c", "d", "f", "g", "h", "m"]);
    for (found, expected) in found.iter().zip([2.0, 1.0, 3.0, 20.0, 40.0, 2.22, 3.0, 1.98]) {
        assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
    }
}

#[test]
fn an_equation_switches_where_another_element_becomes_the_greatest() {
    // x and y = 2 exp(-t) meet at ln 2; before it z falls, after it it rises.
    let source = "time t : s\nset pair = { X, Y }\nstate x[pair] = { X: 1, Y: 2 }\nstate z = 0 in -9..9\n\
                  eq d/dt x[i] = (if i == X then 0 else -x[i])/1 [s] for i in pair\n\
                  eq d/dt z = (if argmax(x[i] for i in pair) == 1 then 1 else -3)/1 [s]\n\
                  episode { step = 0.5 [s], max_steps = 4 }\nsolver { rtol = 1e-10 }\n";
    for method in ["ida", "rosenbrock", "explicit"] {
        let found = columns(&file("switch", "m.eq", source), &["z"], &["--method", method]);
        let meet = 2.0_f64.ln();
        for (step, z) in found[0].iter().enumerate() {
            let t = 0.5 * step as f64;
            let expected = -3.0 * t.min(meet) + (t - meet).max(0.0);
            assert!((z - expected).abs() < 1e-7, "{method}: {z} is not {expected}");
        }
    }
}

#[test]
fn values_between_cells_are_on_straight_lines_whatever_the_grid() {
    for clauses in ["cells 9", "cells 9 stretch 1.3", "cells 1", "cells 40 faces 1 [m] + 2 [m]*(k/40)^2"] {
        let source = format!(
            "time t : s\ndomain z in 1 [m]..3 [m] {clauses}\nlet T[z] : degC = celsius(300 [K] + 10 [K/m]*(z - 2 [m]))\n\
             param x : m = 1.77\nlet a : degC = interp(T[z], z = x)\nlet b : degC = interp(T[z], z = 2.2)\n\
             let c : degC = interp(T[z], z = 0)\nlet first : degC = T[z.first]\nlet d : degC = interp(T[z], z = 7 [m])\n\
             let end : degC = T[z.last]\nlet f : 1 = interp(z/1 [m] + t/1 [s], z = 1.9 [m] + 0.3 [m/s]*t)\n{TAIL}"
        );
        let found = last("between", &source, &["a", "b", "c", "first", "d", "end", "f"]);
        let one = clauses == "cells 1";
        let line = |x: f64| if one { 26.85 } else { 26.85 + 10.0 * (x - 2.0) };
        assert!((found[0] - line(1.77)).abs() < 1e-9 && (found[1] - line(2.2)).abs() < 1e-9, "{clauses} {found:?}");
        assert!((found[2] - found[3]).abs() < 1e-9 && (found[4] - found[5]).abs() < 1e-9, "{clauses} {found:?}");
        assert!((found[6] - if one { 3.0 } else { 3.2 }).abs() < 1e-9, "{clauses} {found:?}");
    }
}

#[test]
fn values_between_numbers_and_across_the_seam_of_a_ring() {
    let source = format!(
        "time t : s\nset few = 2..5\nset many = 1..40\nlet x[k in few] = k^2\nlet y[k in many] = 3*k\nparam p = 3.25\n\
         let a : 1 = interp(x[few], few = p)\nlet b : 1 = interp(y[many], many = 7.5)\nlet c : 1 = interp(x[few], few = 99)\n\
         domain z in 0 [m]..1 [m] cells 10 periodic\nlet u[z] : 1 = if z == z.first then 4 else if z == z.last then 1 else 0\n\
         let d : 1 = interp(u[z], z = 0.98 [m])\nlet f : 1 = interp(u[z], z = -1.98 [m])\nlet g : 1 = interp(u[z], z = 0.11 [m])\n{TAIL}"
    );
    let found = last("numbers", &source, &["a", "b", "c", "d", "f", "g"]);
    for (found, expected) in found.iter().zip([9.0 + 0.25 * 7.0, 22.5, 25.0, 1.9, 3.1, 1.6]) {
        assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
    }
}

#[test]
fn faults_of_places_have_a_way_out() {
    for (line, message) in [
        ("let a : 1 = argmax(u[i, j] for i in s, j in s)", "`argmax` takes one index"),
        ("let a : 1 = argmin(1 for i in s if i == 9)", "the index of the least or greatest of nothing"),
        ("let a : 1 = argmax(v)", "say over what: `argmax(x[i] for i in set)`"),
        ("let a : 1 = interp(v[s])", "say over what: `interp(T[z], z = x)`"),
        ("let a : 1 = interp(n[names], names = 2)", "`names` is neither a domain nor a set of numbers"),
        ("let a : 1 = interp(v[s], s = 1 [m])", "the position"),
        ("let a : 1 = max(v[A], s = 1)", "`s = ...` is not an argument of this function"),
    ] {
        let head =
            "time t : s\nset s = 1..3\nset names = { A, B }\nlet v[i in s] = i\nlet u[i in s, j in s] = i*j\nlet n[i in names] = 1\n";
        let output = smpl(&["check", name(&file("faults", "m.eq", format!("{head}{line}\n{TAIL}")))]);
        let told = text(&output.stderr);
        assert!(status(&output) == 1 && told.contains(message), "{line}\n{told}");
        assert_eq!(told.matches('×').count(), 1, "one cause is one diagnostic: {told}");
    }
}
