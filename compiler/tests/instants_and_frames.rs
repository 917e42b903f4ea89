//! Statements at the instants of an episode, and values of other instants.

mod running;

use running::{Running, assert_close};
use smpl_compiler::compiled::Region;

#[test]
fn frames_are_read_through_lets_and_substituted_variables() {
    let mut r = Running::new(
        "state x = 1
         state w = 1
         var a = 0
         let b : 1 = 2 * a
         eq d/dt x = -x / 1 [s]
         eq d/dt w = -w / 1 [s]
         eq a = x + w
         reward now default = b
         reward start = initial(b)
         reward before = b - previous(b)
         reward set = steady(a) * 100",
    );
    r.y.copy_from_slice(&[3.0, 4.0]);
    r.set_frame(Region::Initial, &[5.0, 6.0]);
    r.set_frame(Region::Previous, &[0.5, 0.25]);
    r.set_frame(Region::Steady, &[0.01, 0.02]);
    assert_close(r.reward(0), 14.0);
    assert_close(r.reward(1), 22.0);
    assert_close(r.reward(2), 12.5);
    assert_close(r.reward(3), 3.0);
}

#[test]
fn all_next_of_the_start_assign_together() {
    let mut r = Running::new(
        "state x = 1
         discrete a = 1
         discrete b = 2
         eq d/dt x = (a - b - x) / 1 [s]
         at start {
           next a = b
           reset x = 10 * a
           next b = a
         }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.start(memory, 0.0, y);
    assert_close(r.discrete("a"), 2.0);
    assert_close(r.discrete("b"), 1.0);
    assert_close(r.get("x"), 20.0);
}

#[test]
fn updates_of_the_end_go_in_the_order_of_the_text() {
    let mut r = Running::new(
        "state x = 5
         discrete a = 1
         eq d/dt x = (a - x) / 1 [s]
         at end {
           clamp x at 3 when x > 3
           next a = x
         }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.end(memory, 0.0, y);
    assert_close(r.get("x"), 3.0);
    assert_close(r.discrete("a"), 3.0);
}

#[test]
fn a_reset_over_cells_sets_each_cell() {
    let mut r = Running::new(
        "domain z in 0..1 cells 5
         state c[z] = 1
         eq d/dt c[z] = -c[z] / 1 [s] for z
         at start { reset c[z] = z for z in 2..z.last }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.start(memory, 0.0, y);
    let expected = [1.0, 0.3, 0.5, 0.7, 0.9];
    r.y.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-15));
}

#[test]
fn an_initial_value_may_need_another_state_declared_later() {
    let r = Running::new(
        "state x = 2 * y
         state y = 3 * z
         state z = 1
         eq d/dt x = -x / 1 [s]
         eq d/dt y = -y / 1 [s]
         eq d/dt z = -z / 1 [s]",
    );
    assert_eq!(r.y, [6.0, 3.0, 1.0]);
}

#[test]
fn an_initial_statement_replaces_the_declared_value_for_all_who_read_it() {
    let r = Running::new(
        "initial y = 5
         state x = 2 * y
         state y = 3
         discrete d = x + y
         eq d/dt x = -x / 1 [s]
         eq d/dt y = -y / 1 [s]",
    );
    assert_eq!(r.y, [10.0, 5.0]);
    assert_close(r.discrete("d"), 15.0);
}

#[test]
fn the_violation_of_a_box_is_relative_to_its_range() {
    let mut r = Running::new(
        "state x = 1 in 0..10
         state y = 1 in 0..2
         eq d/dt x = -x / 1 [s]
         eq d/dt y = -y / 1 [s]
         fail box when outside bounds(x, y)
         constraint hot when x > 5
         success low when x < 0.5
         reward r default = if failure then -1 else if success then 1 else 0",
    );
    assert_eq!(r.finish(), [0.0, 0.0, 0.0, 0.0, 0.0]);
    r.set("x", 11.0);
    assert_eq!(r.finish(), [1.0, 0.1, 0.0, 0.6, -1.0]);
    r.set("x", 10.0 + 1e-6);
    assert_eq!(r.finish()[0], 0.0, "a millionth of the range is slack");
    r.set("x", 0.25);
    assert_eq!(r.finish(), [0.0, 0.0, 1.0, 0.0, 1.0]);
    r.set("x", f64::NAN);
    assert_eq!(r.finish()[0], 1.0, "not a number is outside");
}

#[test]
fn a_failing_step_is_no_success() {
    let mut r = Running::new(
        "state x = 20 in 0..10
         eq d/dt x = -x / 1 [s]
         fail box when outside bounds(x)
         success high when x > 15
         reward r default = if success then 1 else if failure then -1 else 0",
    );
    assert_close(r.reward(0), -1.0);
}

#[test]
fn a_policy_counts_steps_and_an_event_is_positive_where_it_holds() {
    let mut r = Running::new(
        "time t : h
         action u = 1 in 0..9
         state x = 1
         eq d/dt x = (u - x) / 1 [h]
         policy p { u = if n < 3 then 2 else 3 }
         event low when x <= 0.5
         event high when x >= 2
         at low { reset x = 7 }",
    );
    let mut out = [0.0];
    r.model.policy(1, &mut r.memory, 0.0, &r.y.clone(), &mut out);
    assert_eq!(out, [2.0]);
    let mut roots = [0.0; 2];
    r.model.roots(&mut r.memory, 0.0, &r.y.clone(), &r.yp.clone(), &mut roots);
    assert_eq!(roots, [-0.5, -1.0]);
    assert!(r.model.roots_info().iter().all(|root| !root.strict));
    let Running { model, memory, y, .. } = &mut r;
    model.event(0, memory, 0.0, y);
    assert_close(r.get("x"), 7.0);
}

#[test]
fn an_invariant_gives_value_and_rate() {
    let mut r = Running::new(
        "time t : min
         state m : kg = 2
         param q : g/s = 3
         eq d/dt m = q
         invariant mass = m rate q",
    );
    let mut out = [0.0; 2];
    r.model.invariants(&mut r.memory, 0.0, &r.y.clone(), &r.yp.clone(), &mut out);
    assert_close(out[0], 2.0);
    assert_close(out[1], 0.18);
}

#[test]
fn observations_are_converted_and_named() {
    let mut r = Running::new(
        "set s = { a, b }
         state x[s] : m = 2 in 0..9
         state T : degC = 25 in 0..100
         eq d/dt x[i] = -x[i] / 1 [s] for i in s
         eq d/dt T = (20 [degC] - T) / 1 [s]
         observe x, T, length : mm = x[a] in 0..9000",
    );
    assert_close(r.observation("x[b]"), 2.0);
    assert_close(r.observation("T"), 25.0);
    assert_close(r.observation("length"), 2000.0);
}

#[test]
fn a_reset_of_numbered_cells_is_one_loop_on_any_grid() {
    for cells in [4, 400] {
        let mut r = Running::new(&format!(
            "domain z in 0..1 cells {cells}
             state c[z] = 1
             state q[z] = 2
             eq d/dt c[z] = -c[z] / 1 [s] for z
             eq d/dt q[z] = -q[z] / 1 [s] for z
             at start {{ reset c[i] = 3 * q[i] for i in 2..{cells} }}"
        ));
        assert_eq!(r.model.model().programs.start.nests.len(), 1);
        let Running { model, memory, y, .. } = &mut r;
        model.start(memory, 0.0, y);
        assert_close(r.get("c[1]"), 1.0);
        assert_close(r.get("c[2]"), 6.0);
        assert_close(r.get(&format!("c[{cells}]")), 6.0);
    }
}

#[test]
fn resets_that_read_neighbours_see_the_values_before_all_of_them() {
    let mut r = Running::new(
        "domain z in 0..1 cells 4
         state c[z] = z
         eq d/dt c[z] = -c[z] / 1 [s] for z
         at start { reset c[i] = c[i - 1] + 1 for i in 2..4 }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.start(memory, 0.0, y);
    // The centres were 0.125, 0.375, 0.625, 0.875.
    let expected = [0.125, 1.125, 1.375, 1.625];
    r.y.iter().zip(expected).for_each(|(a, b)| assert_close(*a, b));
}

#[test]
fn resets_of_one_block_act_together() {
    let mut r = Running::new(
        "state a = 1
         state b = 2
         state c = 3
         discrete n = 5
         eq d/dt a = -a / 1 [s]
         eq d/dt b = -b / 1 [s]
         eq d/dt c = -c / 1 [s]
         event low when a <= 0.5
         at low {
           reset a = b
           next n = n + a
           reset b = a + n
           clamp b at 5 when b > 5
           reset c = b
         }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.event(0, memory, 0.0, y);
    // b = 1 + 5 is clamped to 5, and what follows the clamp sees that.
    assert_eq!(r.y, [2.0, 5.0, 5.0]);
    assert_close(r.discrete("n"), 6.0);
}

#[test]
fn resets_see_old_values_through_explicit_variables() {
    let mut r = Running::new(
        "state a = 1
         state b = 2
         var total = 3
         eq total = a + b
         eq d/dt a = -a / 1 [s]
         eq d/dt b = -b / 1 [s]
         at end {
           reset a = total - a
           reset b = total - b
         }",
    );
    let Running { model, memory, y, .. } = &mut r;
    model.end(memory, 0.0, y);
    assert_eq!(r.y, [2.0, 1.0]);
}

#[test]
fn arrays_are_exchanged_in_loops() {
    for cells in [3, 40] {
        let mut r = Running::new(&format!(
            "domain z in 0..1 cells {cells}
             state a[z] = z
             state b[z] = 2 + z
             eq d/dt a[z] = -a[z] / 1 [s] for z
             eq d/dt b[z] = -b[z] / 1 [s] for z
             at end {{
               reset a[z] = b[z] + sum(a[i] for i in 1..2) for z
               reset b = a[1]
               reset b[z] = a[z+1] for z in 1..z.last-1
             }}"
        ));
        let centre = |i: usize| (i as f64 + 0.5) / cells as f64;
        let Running { model, memory, y, .. } = &mut r;
        model.end(memory, 0.0, y);
        for i in 0..cells {
            assert_close(r.y[i], 2.0 + centre(i) + (centre(0) + centre(1)));
            let last = i + 1 == cells;
            assert_close(r.y[cells + i], if last { centre(0) } else { centre(i + 1) });
        }
    }
}
