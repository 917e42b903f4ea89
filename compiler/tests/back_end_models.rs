//! Whole models through the back end, checked against formulas and differences.

mod problems;

use problems::{advection_reaction, reactor};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel, Derived, WithRespectTo};
use smpl_compiler::layout::{Memory, Region};
use smpl_compiler::model::Model;

fn build(model: Model) -> CompiledModel {
    CompiledModel::build(model, &BackEndSettings::default()).expect("the model compiles")
}

fn ready(model: &CompiledModel) -> Memory {
    let mut memory = model.memory();
    model.prepare_parameters(&mut memory);
    model.prepare_step(&mut memory);
    memory
}

/// Dense Jacobian, column by column, by central differences of the residual.
fn differences(model: &CompiledModel, m: &mut Memory, y: &[f64], yp: &[f64], cj: f64) -> Vec<Vec<f64>> {
    let n = model.unknowns();
    let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
    (0..n)
        .map(|column| {
            let h = 1e-6 * y[column].abs().max(1e-3);
            let shifted = |sign: f64| {
                let (mut y, mut yp) = (y.to_vec(), yp.to_vec());
                y[column] += sign * h;
                yp[column] += sign * h * cj;
                (y, yp)
            };
            let (y1, yp1) = shifted(1.0);
            model.residual(m, 0.3, &y1, &yp1, &mut up);
            let (y0, yp0) = shifted(-1.0);
            model.residual(m, 0.3, &y0, &yp0, &mut down);
            up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * h)).collect()
        })
        .collect()
}

fn assert_jacobian(model: &CompiledModel, y: &[f64], yp: &[f64], cj: f64, tolerance: f64) {
    let mut m = ready(model);
    let mut values = vec![f64::NAN; model.pattern().nonzeros()];
    model.jacobian(&mut m, 0.3, y, yp, cj, &mut values);
    let expected = differences(model, &mut m, y, yp, cj);
    for (column, rows) in expected.iter().enumerate() {
        let scale = rows.iter().fold(1e-3f64, |s, v| s.max(v.abs()));
        for (row, expected) in rows.iter().enumerate() {
            let value = model.pattern().position(row, column).map_or(0.0, |p| values[p]);
            let off = (value - expected).abs();
            assert!(off <= tolerance * scale, "entry ({row}, {column}): {value} against {expected}");
        }
    }
}

/// Points of the reference table of the reactor's specification: c_A, T, h, T_c, q_out and the three rates.
const REACTOR_POINTS: [[f64; 8]; 3] = [
    [
        0.91991794148119,
        67.15540839322313,
        0.7660266182427179,
        17.7862913620547,
        0.06309793219844001,
        -0.3818656393964175,
        -0.8382237611269687,
        0.24491342970040428,
    ],
    [
        0.7901220374561269,
        39.027433396069505,
        0.5640144304021693,
        19.80470351736012,
        0.13181343883638574,
        0.20875329124616207,
        12.146387271048631,
        -0.21114097068711934,
    ],
    [
        0.4065489586430903,
        73.65207796789836,
        0.8448459440271351,
        26.769622850933658,
        0.09442318460500396,
        0.1433728399888885,
        -28.37225045233349,
        0.037012478339676066,
    ],
];

#[test]
fn reactor_residual_equals_the_reference_rates() {
    let model = build(reactor());
    assert_eq!((model.unknowns(), model.states(), model.explicit()), (3, 3, true));
    for point in REACTOR_POINTS {
        let mut m = ready(&model);
        m.region_mut(Region::Action).copy_from_slice(&point[3..5]);
        model.prepare_step(&mut m);
        let (yp, mut out) = ([0.1, -0.2, 0.3], [0.0; 3]);
        model.residual(&mut m, 0.0, &point[..3], &yp, &mut out);
        for i in 0..3 {
            let rate = out[i] + yp[i];
            assert!((rate - point[5 + i]).abs() <= 1e-12 * point[5 + i].abs().max(1.0), "{rate} {}", point[5 + i]);
        }
    }
}

#[test]
fn reactor_parameters_change_the_residual_after_they_are_prepared_again() {
    let model = build(reactor());
    let mut m = ready(&model);
    let (y, yp, mut out) = ([0.5, 70.0, 0.6], [0.0; 3], [0.0; 3]);
    m.region_mut(Region::Param)[3] = 0.3;
    model.prepare_parameters(&mut m);
    model.prepare_step(&mut m);
    m.region_mut(Region::Action)[1] = 0.15;
    model.prepare_step(&mut m);
    model.residual(&mut m, 0.0, &y, &yp, &mut out);
    let level = (0.1 - 0.15) / (std::f64::consts::PI * 0.09);
    assert!((out[2] - level).abs() < 1e-14);
}

#[test]
fn reactor_jacobian_equals_differences() {
    let model = build(reactor());
    for cj in [0.0, 17.0] {
        assert_jacobian(&model, &[0.55, 72.0, 0.64], &[0.1, 0.2, 0.3], cj, 1e-8);
    }
}

#[test]
fn reactor_derivatives_for_inputs_equal_closed_formulas() {
    let model = build(reactor());
    let mut m = ready(&model);
    let (y, yp) = ([0.55, 72.0, 0.64], [0.0; 3]);
    let actions = model.derivative(Derived::Rows, WithRespectTo::Actions, &mut m, 0.0, (&y, &yp)).expect("smooth");
    let area = std::f64::consts::PI * 0.219 * 0.219;
    let wall = 2.0 * 54.94 / (0.219 * 1000.0 * 0.239);
    let find = |row, column| actions.iter().filter(|t| (t.0, t.1) == (row, column)).map(|t| t.2).sum::<f64>();
    assert!((find(1, 0) - wall).abs() < 1e-13 && (find(2, 1) + 1.0 / area).abs() < 1e-13);
    assert_eq!(actions.len(), 2);
    let parameters = model.derivative(Derived::Rows, WithRespectTo::Parameters, &mut m, 0.0, (&y, &yp)).expect("smooth");
    let volume = area * 0.64 + 1e-8;
    let feed: f64 = parameters.iter().filter(|t| (t.0, t.1) == (0, 2)).map(|t| t.2).sum();
    assert!((feed - 0.1 / volume).abs() < 1e-14);
    let rates = model.derivative(Derived::Rows, WithRespectTo::Derivatives, &mut m, 0.0, (&y, &yp)).expect("smooth");
    assert_eq!(rates, [(0, 0, -1.0), (1, 1, -1.0), (2, 2, -1.0)]);
}

/// A smooth profile of A, B, C, T.
fn profile(n: usize) -> Vec<f64> {
    let value = |i: usize| {
        let z = (i % n) as f64 / n as f64;
        match i / n {
            0 => 1.0 - 0.4 * z,
            1 => 1.2 - 0.4 * z,
            2 => 0.4 * z,
            _ => 350.0 + 16.0 * z,
        }
    };
    (0..4 * n).map(value).collect()
}

/// The rates of problem B, written down once more.
fn advection_reaction_rates(n: usize, y: &[f64]) -> Vec<f64> {
    let feed = [1.0, 1.2, 0.0, 350.0];
    let mut rates = vec![0.0; 4 * n];
    for z in 0..n {
        let (a, b, t) = (y[z], y[n + z], y[3 * n + z]);
        let rate = 1e6 * (-6000.0 / t).exp() * a * b;
        for s in 0..4 {
            let before = if z == 0 { feed[s] } else { y[s * n + z - 1] };
            rates[s * n + z] = n as f64 * (before - y[s * n + z]) + [-1.0, -1.0, 1.0, 40.0][s] * rate;
        }
    }
    rates
}

#[test]
fn advection_reaction_residual_equals_the_formula_for_odd_and_even_cells() {
    for n in [2, 3, 5, 40, 41] {
        let model = build(advection_reaction(n as u32));
        let (mut m, y) = (ready(&model), profile(n));
        let yp: Vec<f64> = (0..4 * n).map(|i| (i as f64).sin()).collect();
        let mut out = vec![f64::NAN; 4 * n];
        model.residual(&mut m, 0.0, &y, &yp, &mut out);
        for (i, rate) in advection_reaction_rates(n, &y).into_iter().enumerate() {
            assert!((out[i] - (rate - yp[i])).abs() <= 1e-13 * rate.abs().max(100.0), "n = {n}, row {i}");
        }
    }
}

#[test]
fn advection_reaction_jacobian_equals_differences_and_has_no_superfluous_entry() {
    for n in [2usize, 3, 12, 13] {
        let model = build(advection_reaction(n as u32));
        let y = profile(n);
        assert_jacobian(&model, &y, &vec![0.5; 4 * n], 3.0, 1e-7);
        // A, B: A, B, T here and one neighbour; C: also itself; T: A, B, T here and a neighbour.
        let expected = (3 + 3 + 4 + 3) * n + 4 * (n - 1);
        assert_eq!(model.pattern().nonzeros(), expected);
    }
}

#[test]
fn code_size_does_not_depend_on_the_number_of_cells() {
    let bytes = |n| build(advection_reaction(n)).statistics().code_bytes as f64;
    let (small, large) = (bytes(40), bytes(4000));
    assert!(large <= small * 1.1, "{small} bytes for 40 cells, {large} for 4000");
}

#[test]
fn a_compiled_model_is_shared_by_threads() {
    let model = build(reactor());
    let run = || {
        let (mut m, mut out) = (ready(&model), [0.0; 3]);
        model.residual(&mut m, 0.0, &[0.5, 70.0, 0.6], &[0.0; 3], &mut out);
        out
    };
    let here = run();
    std::thread::scope(|scope| {
        let others: Vec<_> = (0..4).map(|_| scope.spawn(run)).collect();
        assert!(others.into_iter().all(|o| o.join().is_ok_and(|o| o == here)));
    });
}
