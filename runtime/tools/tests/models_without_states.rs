//! Models that are algebra only: a flash and an explicit one, by every method.

mod shell;

use shell::{beside, file, name, smpl, status, text};

/// An isothermal flash of two components. Closed form (Rachford and Rice): V = -(z_a k_a + z_b k_b)/(k_a k_b) with k = K - 1 and z = 1/2.
const FLASH: &str = "model Flash\ntime t : s\nset s = { a, b }\nparam z[s] = 0.5\ntable K[s] = { a: 2.5, b: 0.3 }\naction f = 1 in 0.5..1.5\n\
                     var V = 0.5 in 0..1\neq sum(z[i]*(f*K[i] - 1)/(1 + V*(f*K[i] - 1)) for i in s) = 0\nobserve V\n\
                     reward r default = V\nepisode { step = 1 [s], max_steps = 5 }\n";

fn fraction(f: f64) -> f64 {
    let (a, b) = (2.5 * f - 1.0, 0.3 * f - 1.0);
    -(0.5 * a + 0.5 * b) / (a * b)
}

fn last(path: &std::path::Path, options: &[&str]) -> Vec<String> {
    let out = beside(path, "out.csv");
    let output = smpl(&[&["simulate", name(path), "--out", name(&out)], options].concat());
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    std::fs::read_to_string(&out).expect("rows").lines().last().expect("a row").split(',').map(str::to_owned).collect()
}

#[test]
fn a_flash_is_solved_for_each_action_by_every_method_that_takes_algebra() {
    let path = file("flash", "flash.eq", FLASH);
    let actions = beside(&path, "actions.csv");
    std::fs::write(&actions, "f\n1\n1.2\n0.8\n").expect("actions");
    for method in ["ida", "rosenbrock", "auto"] {
        let row = last(&path, &["--method", method, "--actions", name(&actions)]);
        let found: f64 = row[2].parse().expect("a number");
        assert!((found - fraction(0.8)).abs() < 1e-12, "{method}: {found} is not {}", fraction(0.8));
    }
    let refused = smpl(&["simulate", name(&path), "--method", "explicit"]);
    assert!(status(&refused) == 1 && text(&refused.stderr).contains("`V` is an algebraic variable that is solved for"));
}

#[test]
fn the_steady_state_of_a_flash_is_its_solution() {
    let path = file("flash_steady", "flash.eq", FLASH);
    let output = smpl(&["steady", name(&path), "--action", "f=1.2"]);
    assert!((fraction(1.2) - 0.53125).abs() < 1e-12 && text(&output.stdout).contains("V = 0.53125"), "{}", text(&output.stdout));
}

#[test]
fn explicit_algebra_has_integrals_and_events_by_every_method() {
    let source = "time t : s\naction u = 2 in 0..5\nlet y : 1 = 3*u + sin(t/1 [s])\nlet q : 1 = integral(y)/1 [s]\nreward r default = q\n\
                  fail late event t >= 3.5 [s]\nepisode { step = 1 [s], max_steps = 5, error_reward = -1 }\n";
    let path = file("algebra", "m.eq", source);
    for method in ["ida", "rosenbrock", "explicit", "auto"] {
        let row = last(&path, &["--method", method]);
        let number = |at: usize| row[at].parse::<f64>().expect("a number");
        assert!((number(1) - 3.5).abs() < 1e-9 && (number(2) - (6.0 + 3.5_f64.sin())).abs() < 1e-9, "{method}: {row:?}");
        // The integral of 6 + sin(t) from 3 to 3.5.
        assert!((number(3) - (3.0 + 3.0_f64.cos() - 3.5_f64.cos())).abs() < 1e-6, "{method}: {row:?}");
        assert_eq!(&row[row.len() - 2..], ["true", "false"]);
    }
}

#[test]
fn a_compiled_and_an_exported_flash_run() {
    let path = file("flash_forms", "flash.eq", FLASH);
    let (compiled, json) = (beside(&path, "flash.smplc"), beside(&path, "flash.json"));
    assert_eq!(status(&smpl(&["compile", name(&path), "-o", name(&compiled)])), 0);
    assert_eq!(status(&smpl(&["export", name(&path), "--to", "json", "-o", name(&json)])), 0);
    for form in [&compiled, &json] {
        let output = smpl(&["simulate", name(form)]);
        assert!(text(&output.stdout).contains("5 steps") && text(&output.stdout).contains("time limit"), "{}", text(&output.stdout));
    }
}
