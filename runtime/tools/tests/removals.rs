//! Statements that variants take out, the error reward by its name, general powers of quantities.

mod shell;

use shell::{beside, file, name, smpl, status, text};

/// A decaying state with a failure, an observation and two starts.
const DECAY: &str = "time t : s\nparam k : 1/s = 1\nstate x = 2 in 0..10\neq d/dt x = -k*x\nvar y\neq y = 2*x\ninitial x = 4\n\
                     observe x, y in 0..20\nreward r default = x\nfail low when x < 3\n\
                     episode { step = 1 [s], max_steps = 3, error_reward = -7 }\n";

/// Output of a run, and its table.
fn run(test: &str, source: &str, more: &[&str]) -> (String, String) {
    let path = file(test, "m.eq", source);
    let out = beside(&path, "out.csv");
    let output = smpl(&[&["simulate", name(&path), "--start", "nominal", "--out", name(&out)], more].concat());
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    (text(&output.stdout), std::fs::read_to_string(&out).expect("a table"))
}

#[test]
fn a_variant_takes_statements_out() {
    let source = format!(
        "{DECAY}variant endless {{ remove fail low }}\nvariant low_start {{ remove initial x }}\nvariant blind {{ remove observe y; remove low }}\n\
         variant given {{ remove y; remove eq y; remove low }}\n"
    );
    assert!(run("plain", &source, &[]).0.contains("failed: low"));
    let (told, table) = run("endless", &source, &["--variant", "endless"]);
    assert!(!told.contains("failed"), "{told}");
    assert_eq!(table.lines().count(), 5);
    let (_, table) = run("low_start", &source, &["--variant", "low_start", "--variant", "endless"]);
    assert!(table.lines().nth(1).expect("a row").starts_with("0,0,2,"), "{table}");
    let header = |variant: &str| run(variant, &source, &["--variant", variant]).1.lines().next().expect("a header").to_owned();
    assert!(header("blind").contains(",y,") && !header("blind").contains("obs.y"));
    assert!(!header("given").contains("y,"), "{}", header("given"));
}

#[test]
fn a_variant_takes_a_controller_out() {
    let source = format!(
        "{DECAY}discrete u = 1 in 0..10\ncontrol u from x setpoint 5 gain 1 every 1 [s]\nvariant open {{ remove control u; remove low }}\n\
         variant closed {{ remove low }}\n"
    );
    let last = |variant: &str| {
        let table = run(variant, &source, &["--variant", variant]).1;
        let at = table.lines().next().expect("a header").split(',').position(|name| name == "u").expect("a column");
        table.lines().last().expect("a row").split(',').nth(at).expect("a cell").parse::<f64>().expect("a number")
    };
    assert_eq!(last("open"), 1.0);
    assert!(last("closed") > 3.0);
}

/// x decays from 4 as 4 exp(-t), and would be 6 after an event, or 1 more after each instant.
#[test]
fn a_variant_takes_blocks_of_instants_and_events_out() {
    let source = format!(
        "{DECAY}discrete n_hits = 0\nevent half when x <= 2\nat half {{ reset x = 6; next n_hits = n_hits + 1 }}\n\
         at every 0.5 [s] {{ reset x = x + 1 }}\nat end {{ next n_ends = n_ends + 1 }}\ndiscrete n_ends = 0\n\
         variant quiet {{ remove half; remove at every 0.5 [s]; remove at end; remove low }}\n\
         variant still {{ remove at half; remove at every 0.5 [s]; remove low }}\nvariant loud {{ remove at every 0.5 [s]; remove low }}\n"
    );
    let last = |variant: &str, column: &str| {
        let table = run(variant, &source, &["--variant", variant]).1;
        let at = table.lines().next().expect("a header").split(',').position(|name| name == column).expect("a column");
        table.lines().last().expect("a row").split(',').nth(at).expect("a cell").parse::<f64>().expect("a number")
    };
    for (variant, ends) in [("quiet", 0.0), ("still", 3.0)] {
        assert!((last(variant, "x") - 4.0 * (-3.0_f64).exp()).abs() < 1e-5, "{variant}");
        assert_eq!((last(variant, "n_ends"), last(variant, "n_hits")), (ends, 0.0));
    }
    // Events at ln 2, then at each ln 3: at 0.693, 1.792 and 2.890.
    assert!((last("loud", "x") - 6.0 * (2.0_f64.ln() + 2.0 * 3.0_f64.ln() - 3.0).exp()).abs() < 1e-4);
    assert_eq!(last("loud", "n_hits"), 3.0);
}

/// A tank behind another one, or fed by a source of 0.5: it tends to 1 or to 0.5.
#[test]
fn a_variant_takes_a_connection_out() {
    let source = "time t : s\nconnector S { q }\n\
         component Tank { port a, b : S\nstate x = 0 in 0..2\neq d/dt x = (a.q - x)/0.1 [s]\neq b.q = x }\n\
         component Feed { param q = 1\nport b : S\neq b.q = q }\nuse Feed as f\nuse Tank as one, two\nconnect f.b -> one.a\n\
         connect one.b -> two.a\nvariant split { remove connect one.b -> two.a\nuse Feed as g(q = 0.5)\nconnect g.b -> two.a }\n\
         episode { step = 1 [s], max_steps = 3 }\n";
    let last = |more: &[&str]| {
        let table = run("connection", source, more).1;
        let at = table.lines().next().expect("a header").split(',').position(|name| name == "two.x").expect("a column");
        table.lines().last().expect("a row").split(',').nth(at).expect("a cell").parse::<f64>().expect("a number")
    };
    assert!((last(&[]) - 1.0).abs() < 1e-6 && (last(&["--variant", "split"]) - 0.5).abs() < 1e-6);
}

#[test]
fn a_removal_without_a_statement_is_refused() {
    for line in [
        "variant v { remove fail hihg }",
        "variant v { remove eq d/dt y }",
        "variant v { remove reward low }",
        "variant v { remove at strat }",
        "variant v { remove connect a -> b }",
        "remove low",
    ] {
        let output = smpl(&["check", name(&file("nothing", "m.eq", format!("{DECAY}{line}\n"))), "--variant", "v"]);
        let output =
            if line.starts_with("remove") { smpl(&["check", name(&file("nothing", "m.eq", format!("{DECAY}{line}\n")))]) } else { output };
        let told = text(&output.stderr);
        assert!(status(&output) == 1 && told.contains("there is no such statement to remove"), "{line}\n{told}");
    }
}

#[test]
fn the_error_reward_has_a_name_in_rewards_and_failures() {
    let source = DECAY
        .replace("fail low when x < 3", "fail floor when reward <= error_reward")
        .replace("default = x", "default = max(error_reward, x - 8)");
    let (told, table) = run("named", &source, &[]);
    // x: 4, 1.47, 0.54; the reward is -6.53, then limited to -7.
    assert!(told.contains("failed: floor"), "{told}");
    assert_eq!(table.lines().count(), 4);
    let (told, _) = run("named", &source, &["--set", "error_reward=-9"]);
    assert!(!told.contains("failed"), "{told}");
}

#[test]
fn powers_with_two_decimals_have_the_unit_that_fits() {
    let source = "time t : s\nparam k : (mol/m^3)^(-0.32)/s = 0.5\nstate c : mol/L = 3 in 0..10\neq d/dt c = -k*c^1.32\n\
                  let r : mol/(m^3 s) = k*c^1.32\nepisode { step = 1 [s], max_steps = 2 }\nsolver { rtol = 1e-10 }\n";
    let (_, table) = run("power", source, &[]);
    // Closed form in mol/m3: c^(-0.32) = 3000^(-0.32) + 0.32*0.5*t.
    let c = (3000_f64.powf(-0.32) + 0.32 * 0.5 * 2.0).powf(-1.0 / 0.32);
    let row: Vec<f64> = table.lines().last().expect("a row").split(',').take(4).map(|cell| cell.parse().expect("a number")).collect();
    assert!((1000.0 * row[2] - c).abs() < 1e-6 * c, "{row:?} {c}");
    assert!((row[3] - 0.5 * c.powf(1.32)).abs() < 1e-6 * row[3], "{row:?}");
}
