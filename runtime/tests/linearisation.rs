//! Linearisation and steady states against the specification and differences.

mod support;

use smpl_runtime::linearize::linearize;
use smpl_runtime::setup::EnvironmentOptions;
use smpl_runtime::spectrum::eigenvalues;
use smpl_runtime::steady;
use smpl_runtime::system::CompiledSystem;
use support::{compile, reactor, setup};

/// Eigenvalues of the specification, section 2; the level integrates.
#[test]
fn eigenvalues_are_those_of_the_specification() {
    let cases = [
        ([0.877_825, 51.3466, 0.659], [(0.0, 0.0), (-1.057, -0.540), (-1.057, 0.540)]),
        ([0.501_894, 76.844, 0.659], [(2.846, 0.0), (0.0, 0.0), (-0.463, 0.0)]),
        ([0.206_553, 96.8755, 0.659], [(1.351, -1.601), (1.351, 1.601), (0.0, 0.0)]),
    ];
    let setup = setup(reactor::model(), EnvironmentOptions::default());
    let model = compile(reactor::model());
    for (guess, expected) in cases {
        let mut system = CompiledSystem::new(std::sync::Arc::clone(&model)).expect("a system");
        let (m, memory) = system.parts();
        m.prepare_parameters(memory);
        let mut y = guess.to_vec();
        let report = steady::solve(&mut system, &setup.catalogue, &[26.85, 0.1], &[(2, 0.659)], &mut y).expect("found");
        assert!(report.residual_norm < 1e-10, "{}", report.residual_norm);
        assert!(y.iter().zip(guess).all(|(a, b)| (a - b).abs() < 1e-3 * b), "the state near the guess: {y:?}");
        let linear = linearize(&mut system, &setup.catalogue, 0.0, &y).expect("linearises");
        let values = eigenvalues(&linear.a).expect("converges").values;
        for (value, (re, im)) in values.iter().zip(expected) {
            assert!((value.re - re).abs() < 2e-3 && (value.im.abs() - f64::abs(im)).abs() < 2e-3, "{values:?}");
        }
    }
}

/// dT/dt has the jacket's 2.09931029212281 1/min for T_c; dh/dt has -1/area for q_out (specification, "Derived").
#[test]
fn the_input_matrix_has_the_derived_constants() {
    let setup = setup(reactor::model(), EnvironmentOptions::default());
    let mut system = CompiledSystem::new(compile(reactor::model())).expect("a system");
    let (m, memory) = system.parts();
    m.prepare_parameters(memory);
    m.prepare_step(memory);
    let linear = linearize(&mut system, &setup.catalogue, 0.0, setup.steady_state()).expect("linearises");
    assert!((linear.b[(1, 0)] - 2.099_310_292_122_81).abs() < 1e-12);
    assert!((linear.b[(2, 1)] + 1.0 / 0.150_673_925_258_820_06).abs() < 1e-12);
    assert_eq!(linear.c, nalgebra::DMatrix::identity(3, 3));
    assert_eq!(linear.d, nalgebra::DMatrix::zeros(3, 2));
}

#[test]
fn a_level_that_integrates_must_be_fixed() {
    let setup = setup(reactor::model(), EnvironmentOptions::default());
    let mut system = CompiledSystem::new(compile(reactor::model())).expect("a system");
    let (m, memory) = system.parts();
    m.prepare_parameters(memory);
    let mut y = vec![0.87, 51.0, 0.659];
    let error = steady::solve(&mut system, &setup.catalogue, &[26.85, 0.1], &[], &mut y).expect_err("singular");
    assert!(error.to_string().contains("fix a state that integrates"), "{error}");
}
