//! Results are the same bits on every thread, with every instruction set, and whatever an instance did before.

use std::thread;

use smpl_runtime::solver::problems::{self, Problem};
use smpl_runtime::solver::{FirstStep, Ida, Integrator, LinearSolver, Method, Settings, System, integrator};

/// Method of a kind of episode, its problem and its linear solver.
fn problem(kind: usize) -> (Problem, LinearSolver) {
    match kind % 5 {
        0 => (problems::stirred_tank(), LinearSolver::Dense),
        1 => (problems::hires(), LinearSolver::Klu),
        2 => (problems::robertson_dae(), LinearSolver::Auto),
        3 => (problems::tubular_reactor(40), LinearSolver::Auto),
        _ => (problems::tubular_reactor(40), LinearSolver::Klu),
    }
}

fn settings(problem: &Problem, kind: usize, first_step: FirstStep) -> Settings {
    let mut settings = Settings::new(1e-6, vec![1e-8; problem.dimension()]);
    let (_, choice) = self::problem(kind);
    settings.method = [Method::Ida, Method::Rosenbrock, Method::Auto][kind / 5];
    settings.linear_solver = choice;
    settings.first_step = first_step;
    settings
}

/// An episode of 15 control steps; the bits of all states and times.
fn episode(ida: &mut dyn Integrator, problem: &mut Problem, shift: f64) -> Vec<u64> {
    ida.forget();
    let mut state = problem.start.clone();
    let mut bits = vec![];
    for step in 0..15 {
        if let Some(input) = problem.inputs.first_mut() {
            *input += if step % 2 == 0 { shift } else { -shift };
        }
        let t = 0.05 * f64::from(step);
        ida.restart(problem, t, &state, None).expect("consistent");
        ida.advance(problem, t + 0.05).expect("reaches the end");
        state.copy_from_slice(ida.state());
        bits.extend(state.iter().map(|x| x.to_bits()));
    }
    if let Some(input) = problem.inputs.first_mut() {
        *input -= shift;
    }
    bits
}

fn episode_of_a_new_instance(kind: usize, first_step: FirstStep) -> Vec<u64> {
    let (mut problem, _) = problem(kind);
    let settings = settings(&problem, kind, first_step);
    let mut ida = integrator(&problem, settings).expect("valid");
    episode(&mut *ida, &mut problem, 0.5)
}

#[test]
fn instances_on_several_threads_give_the_same_bits() {
    for kind in 0..15 {
        let alone = episode_of_a_new_instance(kind, FirstStep::default());
        let threads: Vec<_> = (0..8)
            .map(|_| thread::spawn(move || (0..4).map(|_| episode_of_a_new_instance(kind, FirstStep::default())).collect::<Vec<_>>()))
            .collect();
        for thread in threads {
            for bits in thread.join().expect("no panic") {
                assert_eq!(bits, alone);
            }
        }
    }
}

#[test]
fn a_forgetful_instance_repeats_the_bits_of_a_new_one() {
    for first_step in [FirstStep::default(), FirstStep::Scaled { factor: 0.1 }, FirstStep::Ida] {
        for kind in 0..15 {
            let (mut problem, _) = problem(kind);
            let settings = settings(&problem, kind, first_step);
            let mut ida = integrator(&problem, settings).expect("valid");
            let first = episode(&mut *ida, &mut problem, 0.5);
            episode(&mut *ida, &mut problem, -0.2);
            let (mut fresh, _) = self::problem(kind);
            assert_eq!(episode(&mut *ida, &mut fresh, 0.5), first);
        }
    }
}

#[test]
fn the_portable_loops_give_the_same_bits_as_the_fast_ones() {
    for kind in 0..5 {
        let (mut problem, _) = problem(kind);
        let settings = settings(&problem, kind, FirstStep::default());
        let mut ida = Ida::portable(&problem, settings).expect("valid");
        let portable = episode(&mut ida, &mut problem, 0.5);
        assert_eq!(portable, episode_of_a_new_instance(kind, FirstStep::default()));
    }
}
