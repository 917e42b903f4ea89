//! Numbers that the compiler evaluates have their units: the values are those of conversions by the SI.

mod running;

use running::{Running, assert_close, flat};
use smpl_compiler::model::Model;

const DECAY: &str = "time t : min\nstate x = 1 in 0..9\neq d/dt x = -x / 1 [min]\n";

fn model(text: &str) -> Model {
    flat(&format!("{DECAY}{text}"))
}

#[test]
fn times_of_observations_become_steps() {
    let model = model(
        "param late : h = 1
         param share : % = 300
         observe x every 3 [min] delay late
         observe y = x in 0..9 every 90 [s] delay share
         observe z = x in 0..9 every 4 delay 0.25 [h]
         episode { step = 0.5 [min] }",
    );
    let found: Vec<(u32, u32)> = model.interface.finish.observations.iter().map(|o| (o.every, o.delay)).collect();
    assert_eq!(found, [(6, 120), (3, 3), (4, 30)]);
}

#[test]
fn numbers_of_cells_and_members_are_converted() {
    let r = Running::new(
        "param L : m = 2
         param dz : cm = 1
         param N : % = 400
         set s = 1..N
         domain z in 0..L cells L/dz
         state x[i in s] = i
         state c[z] = 0
         eq d/dt x[i] = -x[i] / 1 [s] for i in s
         eq d/dt c[z] = -c[z] / 1 [s] for z
         observe last = x[N] in 0..9",
    );
    // 2 m are 200 cm; 400 % are 4.
    assert_eq!(r.y.len(), 4 + 200);
    let mut r = r;
    assert_close(r.observation("last"), 4.0);
}

#[test]
fn a_quotient_that_is_whole_but_for_rounding_is_whole() {
    // 0.3/0.1 is 2.9999999999999996 in double precision.
    let model = model(
        "param a : m = 0.3\nparam b : m = 0.1\ndomain z in 0..1 cells a/b\nobserve x every a/b\nepisode { max_steps = 2 [h] / 1 [min] }",
    );
    assert_eq!(model.interface.grids[0].faces.len(), 4);
    assert_eq!(model.interface.finish.observations[0].every, 3);
    assert_eq!(model.interface.episode.max_steps, 120);
}

#[test]
fn the_reward_of_an_error_is_converted_to_the_unit_of_the_rewards() {
    let of = |text: &str| model(&format!("param m : kg = 1\nreward a : kg = m*x\n{text}")).interface.episode.error_reward;
    assert_close(of("episode { error_reward = -1000 [g] }"), -1.0);
    assert_close(of("episode { error_reward = -7 }"), -7.0);
    assert_close(of("reward b : kg = m\nepisode { error_reward = -0.002 [t] }"), -2.0);
}

#[test]
fn per_cent_of_amount_mass_and_volume_are_ratios() {
    let mut r = Running::new(
        "state x = 1
         param a : mol% = 30
         param b : wt% = 20
         param c : vol% = 10
         param n : mol = 2
         eq d/dt x = -x / 1 [s]
         observe sum : 1 = a + b + c in 0..1
         observe amount : mol = a*n in 0..9",
    );
    assert_close(r.observation("sum"), 0.6);
    assert_close(r.observation("amount"), 0.6);
}
