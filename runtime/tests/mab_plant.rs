//! The integrated antibody plant: its batches against the recovery worked out in section 12d of its specification.

mod support;

use std::collections::BTreeMap;

use support::replay::Replay;

/// Fed, pooled, held, lost.
fn books(replay: &Replay) -> [f64; 4] {
    let losses = ["breakthrough", "wash_off", "cex_off"];
    let lost = losses.iter().map(|l| replay.get(&format!("m_lost[{l}]"))).sum();
    [replay.get("m_fed"), replay.get("m_pool"), replay.get("m_held"), lost]
}

#[test]
fn batches_recover_what_was_worked_out_repeat_and_lose_nothing_unseen() {
    let mut replay = Replay::new("mab_plant.eq", "default", None);
    replay.start(BTreeMap::new());
    let mut action = vec![0.0; replay.environment.catalogue().actions.len()];
    let mut batches: Vec<[f64; 4]> = Vec::new();
    for step in 1..=80 {
        replay.environment.policy(0, &mut action);
        let result = replay.step_with(&action);
        assert_eq!(result.failure, None, "step {step}");
        let [fed, pool, held, lost] = books(&replay);
        assert!((fed - pool - held - lost).abs() <= 1e-8 * fed, "step {step}: {}", fed - pool - held - lost);
        if step % 20 == 0 {
            batches.push([fed, pool, held, lost]);
        }
    }
    let difference = |at: usize, entry: usize| batches[at][entry] - batches[at - 1][entry];
    let recovery = difference(2, 1) / difference(2, 0);
    eprintln!("recovery of the second batch {recovery:.6}, repeated to {:.1e} mg", batches[3][2] - batches[2][2]);
    assert!((recovery - 0.9929).abs() < 1e-4, "{recovery}");
    assert!((batches[3][2] - batches[2][2]).abs() < 0.02);
    let breakthrough = replay.get("m_lost[breakthrough]") / replay.get("m_fed");
    assert!((breakthrough - 0.0014).abs() < 2e-4, "{breakthrough}");
}
