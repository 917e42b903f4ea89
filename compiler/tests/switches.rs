//! Switches of equations, and bounds of root functions, against values at points.

mod running;

use running::{Running, flat};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel, WatchRole};

/// A model with a state `x`, a clock `k` and a rate of `y`.
fn rate(rate: &str) -> CompiledModel {
    let text = format!(
        "time t : 1
         table steps : 1 over q : 1 from {{ 0: 0, 1: 2, 3: 5 }}
         table lines : 1 over q : 1 linear {{ 0: 0, 1: 2, 3: 5 }}
         table late : 1 over t : 1 until {{ 10: 0, 30: 3 }}
         param a = 1.5
         action u = 1 in 0..2
         state x = 0
         state k = 0
         state y = 0
         eq d/dt x = 1
         eq d/dt k = 1
         eq d/dt y = {rate}"
    );
    CompiledModel::build(flat(&text), &BackEndSettings::default()).expect("a model")
}

/// Numbers of jumps and kinks.
fn switches(text: &str) -> (usize, usize) {
    let model = rate(text);
    let jumps = model.watched().iter().filter(|kind| kind.role == WatchRole::Jump).count();
    (jumps, model.watched().len() - jumps)
}

#[test]
fn branches_that_differ_at_the_threshold_are_jumps() {
    for text in [
        "if x > a then 1 else 0",
        "if x > a then x else a + 0.1",
        "sign(x)",
        "floor(x)",
        "if x > k then 1 else 2",
        "if exp(t) > 3 then 1 else 0",
    ] {
        assert_eq!(switches(text), (1, 0), "{text}");
    }
    assert_eq!(switches("steps(x)"), (2, 0));
    assert_eq!(switches("mod(x, 2)"), (1, 0));
}

#[test]
fn branches_that_meet_at_the_threshold_are_kinks() {
    let texts = [
        "if x > a then x else a",
        "if x > 0 then sqrt(x) else 0",
        "if x > k then sqrt(x - k) else -sqrt(k - x)",
        "abs(x)",
        "max(x, k)",
        "min(sin(x), 0.5)",
    ];
    for text in texts {
        assert_eq!(switches(text), (0, 1), "{text}");
    }
    // The absolute value is another one.
    assert_eq!(switches("sign(x - k)*sqrt(abs(x - k))"), (0, 2));
    assert_eq!(switches("lines(x)"), (0, 3));
}

#[test]
fn a_factor_that_is_zero_somewhere_hides_no_jump() {
    let jump = "(if x > a then 1 else 0.15)";
    // Factors, and the least number of switches in each; one that time moves is a break.
    let factors = [
        ("max(t - 10, 0)", 0),
        ("max(k - 10, 0)", 1),
        ("min(k + 10, 0)", 1),
        ("lines(k + 10)", 3),
        ("(if k > 7 then k - 7 else 0)", 1),
        ("(if k > 7 and t < 30 then k - 7 else 0)", 1),
    ];
    for (factor, own) in factors {
        let (jumps, kinks) = switches(&format!("{jump}*{factor}"));
        let (of_factor, bends) = switches(factor);
        assert_eq!((jumps, kinks), (1 + of_factor, bends), "{factor}");
        assert!(of_factor + bends >= own, "{factor}");
    }
    assert_eq!(switches(&format!("{jump}*late(t)")), (1, 0));
    assert_eq!(switches(&format!("{jump}*floor(t/100)")).0, 1 + switches("floor(t/100)").0);
}

#[test]
fn what_does_not_move_within_a_step_or_is_smooth_or_a_break_has_no_switch() {
    for text in ["if u > a then 1 else 0", "smooth(if x > a then 1 else 0)", "if t > a then 1 else 0", "steps(2*t)", "max(u, a)*x"] {
        assert_eq!(switches(text), (0, 0), "{text}");
    }
}

#[test]
fn bounds_of_events_hold_all_values_in_the_box() {
    let conditions = [
        "x*k > 0.3",
        "x/(k + 3) > 0.3",
        "sin(3*x) + cos(k) > 0.5",
        "tan(x/4) > k",
        "exp(-sq((x - 0.2)/0.1)) > 0.5",
        "sqrt(abs(x)) - x^3 + k^2 > 0",
        "max(x, k) - min(x, 2*k) > 0.1",
        "(if x > 0.3 then k else -x) > 0",
        "steps(x) + lines(k) > 1",
        "floor(3*x) + sign(k) - mod(x, 0.7) > 0",
        "tanh(x) * atan(k) + ln(4 + x) > 1",
        "min(x - 0.1, 0.5 - k) > 0",
        "(2 + x)^(1.5 + k) + cosh(x)/(k + 2.5) > 3",
        "sin(2*t) > x",
    ];
    for condition in conditions {
        let text = format!(
            "time t : 1
             table steps : 1 over q : 1 from {{ 0: 0, 1: 2, 3: 5 }}
             table lines : 1 over q : 1 linear {{ 0: 0, 1: 2, 3: 5 }}
             state x = 0
             state k = 0
             eq d/dt x = 1
             eq d/dt k = 1
             fail e event {condition}"
        );
        let Running { model, mut memory, .. } = Running::new(&text);
        let count = model.watched().len();
        let (mut bounds, mut values) = (vec![0.0; 2 * count], vec![0.0; count]);
        // A lattice of boxes in -2..2, of several widths.
        for (i, width) in (0..400).zip([0.0, 0.01, 0.3, 1.7].into_iter().cycle()) {
            let corner = |prime: u32| -2.0 + 4.0 * f64::from((i * prime) % 101) / 101.0;
            let (least, begin) = ([corner(37), corner(59)], corner(17) + 2.0);
            let most = least.map(|x| x + width);
            model.bounds(&mut memory, (begin, begin + width), (&least, &most), &mut bounds);
            for j in 0..27 {
                let inside = |part: u32| width * f64::from(part) / 2.0;
                let y = [least[0] + inside(j % 3), least[1] + inside(j / 3 % 3)];
                model.roots(&mut memory, begin + inside(j / 9), &y, &[0.0; 2], &mut values);
                for ((value, low), high) in values.iter().zip(&bounds[..count]).zip(&bounds[count..]) {
                    let slack = 1e-12 * (1.0 + value.abs());
                    // A bound or a value that is not a number says nothing.
                    let outside = *value < low - slack || *value > high + slack;
                    assert!(!outside, "{condition}: {value} is not in {low}..{high} at {y:?}");
                }
            }
        }
    }
}
