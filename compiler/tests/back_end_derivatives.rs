//! Jacobians of rows with functions, choices, reductions and colliding entries, against differences of the residual.

mod problems;

use problems::{Maker, cell};
use proptest::prelude::*;
use smpl_compiler::compiled::{BackEndError, BackEndSettings, CompiledModel};
use smpl_compiler::differentiate::DifferentiateError;
use smpl_compiler::ir::{Affine, BinaryFn, Compare, ExprId, Exprs, Flavour, LoopVar, ReduceFn, Role, UnaryFn, VarId};
use smpl_compiler::model::Model;

const CELLS: u32 = 5;

fn build(model: Model) -> CompiledModel {
    CompiledModel::build(model, &BackEndSettings::default()).expect("the model compiles")
}

fn jacobian(model: &CompiledModel, y: &[f64], yp: &[f64], cj: f64) -> Vec<Vec<f64>> {
    let mut m = model.memory();
    model.prepare_parameters(&mut m);
    model.prepare_step(&mut m);
    let mut values = vec![f64::NAN; model.pattern().nonzeros()];
    model.jacobian(&mut m, 0.3, y, yp, cj, &mut values);
    let n = y.len();
    (0..n).map(|row| (0..n).map(|column| model.pattern().position(row, column).map_or(0.0, |p| values[p])).collect()).collect()
}

/// Differences of fourth order of the residual along each unknown, over steps of h and twice h.
fn differences(model: &CompiledModel, y: &[f64], yp: &[f64], cj: f64, h: f64) -> Vec<Vec<f64>> {
    let mut m = model.memory();
    model.prepare_parameters(&mut m);
    model.prepare_step(&mut m);
    let n = y.len();
    let mut matrix = vec![vec![0.0; n]; n];
    for column in 0..n {
        for (steps, weight) in [(2.0, -1.0), (1.0, 8.0), (-1.0, -8.0), (-2.0, 1.0)] {
            let (mut y, mut yp, mut out) = (y.to_vec(), yp.to_vec(), vec![0.0; n]);
            y[column] += steps * h;
            yp[column] += steps * h * cj;
            model.residual(&mut m, 0.3, &y, &yp, &mut out);
            (0..n).for_each(|row| matrix[row][column] += weight * out[row] / (12.0 * h));
        }
    }
    matrix
}

/// A smooth function of one number, tame near the points used.
fn smooth(e: &mut Exprs, kind: u8, a: ExprId) -> ExprId {
    let (half, two) = (e.constant(0.5), e.constant(2.0));
    let square = e.powi(a, 2);
    let positive = e.add(square, half);
    match kind % 16 {
        0 => e.unary(UnaryFn::Sin, a),
        1 => e.unary(UnaryFn::Cos, a),
        2 => e.unary(UnaryFn::Tanh, a),
        3 => e.unary(UnaryFn::Atan, a),
        4 => e.unary(UnaryFn::Sqrt, positive),
        5 => e.unary(UnaryFn::Ln, positive),
        6 => e.unary(UnaryFn::Log10, positive),
        7 => e.div(half, positive),
        8 => {
            let bounded = e.unary(UnaryFn::Tanh, a);
            e.unary(UnaryFn::Exp, bounded)
        }
        9 => {
            let bounded = e.unary(UnaryFn::Sin, a);
            let small = e.mul(half, bounded);
            e.unary(UnaryFn::Asin, small)
        }
        10 => {
            let bounded = e.unary(UnaryFn::Sin, a);
            let small = e.mul(half, bounded);
            e.unary(UnaryFn::Acos, small)
        }
        11 => {
            let exponent = e.constant(1.7);
            e.binary(BinaryFn::Pow, positive, exponent)
        }
        12 => {
            let bounded = e.unary(UnaryFn::Tanh, a);
            e.binary(BinaryFn::Pow, positive, bounded)
        }
        13 => e.powi(positive, -3),
        14 => {
            let bounded = e.unary(UnaryFn::Tanh, a);
            let (sinh, cosh) = (e.unary(UnaryFn::Sinh, bounded), e.unary(UnaryFn::Cosh, bounded));
            e.mul(sinh, cosh)
        }
        _ => {
            let shifted = e.add(positive, two);
            e.binary(BinaryFn::Atan2, a, shifted)
        }
    }
}

/// Joins two numbers.
fn join(e: &mut Exprs, kind: u8, a: ExprId, b: ExprId) -> ExprId {
    match kind % 7 {
        0 => e.add(a, b),
        1 => e.sub(a, b),
        2 => {
            let bounded = e.unary(UnaryFn::Sin, b);
            e.mul(a, bounded)
        }
        3 => e.binary(BinaryFn::Min, a, b),
        4 => e.binary(BinaryFn::Max, a, b),
        5 => {
            let third = e.constant(0.37);
            let c = e.compare(Compare::Lt, a, third);
            e.select(c, a, b)
        }
        _ => e.unary(UnaryFn::Abs, a),
    }
}

/// A sum or product whose body uses an element along its counter, bound at `depth`.
fn reduction(e: &mut Exprs, kind: u8, x: VarId, outside: ExprId, depth: u8) -> ExprId {
    let counter = LoopVar(depth);
    let element = e.load(x, Flavour::Value, Affine::along(0, counter, 1));
    let inner = smooth(e, kind, element);
    let weighted = e.mul(inner, outside);
    let number = e.counter(counter);
    let body = e.add(weighted, number);
    match kind % 4 {
        0 => e.reduce(ReduceFn::Product, counter, 3, inner),
        1 => e.reduce(ReduceFn::Max, counter, CELLS, body),
        _ => e.reduce(ReduceFn::Sum, counter, CELLS + 7, body),
    }
}

/// Rows over all cells whose right-hand sides are made from choices; the vector `x` has room for the reductions.
fn random_model(choices: &[(u8, u8, u8)], explicit: bool) -> Model {
    let mut m = Maker::new();
    let x = m.variable("x", Role::State, CELLS + 7);
    let p = m.input("p", Role::Param, 0.7);
    let u = m.input("u", Role::Action, 1.3);
    let mut numbers = vec![p, u];
    for offset in 0..3 {
        numbers.push(m.load(x, cell(offset)));
    }
    numbers.push(m.load(x, Affine::constant(2)));
    for &(kind, i, j) in choices {
        let pick = |n: u8| numbers[usize::from(n) % numbers.len()];
        let (a, b) = (pick(i), pick(j));
        let e = &mut m.model.exprs;
        let made = match kind % 8 {
            0..=2 => smooth(e, j, a),
            // Depth 0 binds the counter that the rows use: a scalar sum that was put into an array equation.
            3 if e.free(p) == 0 => reduction(e, j, x, p, 0),
            4 => reduction(e, j, x, a, 1),
            _ => join(e, kind / 8, a, b),
        };
        numbers.push(made);
    }
    let parts = numbers.len().saturating_sub(3);
    let e = &mut m.model.exprs;
    let total = numbers[parts..].iter().copied().reduce(|a, b| e.add(a, b)).unwrap_or(p);
    if explicit {
        m.rate(&[CELLS], x, cell(0), total);
    } else {
        m.model.explicit = false;
        let rate = m.model.exprs.load(x, Flavour::Derivative, cell(1));
        let wave = m.model.exprs.unary(UnaryFn::Sin, rate);
        let product = m.model.exprs.mul(wave, total);
        m.row(&[CELLS], x, cell(0), product);
    }
    let rest = m.load(x, cell(i64::from(CELLS)));
    let square = m.model.exprs.powi(rest, 2);
    m.rate(&[7], x, cell(i64::from(CELLS)), square);
    m.model
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn jacobians_of_random_rows_equal_differences(
        choices in prop::collection::vec(any::<(u8, u8, u8)>(), 1..12), explicit in any::<bool>(),
        y in prop::collection::vec(-1.0..1.0, 12), cj in 0.0..3.0,
    ) {
        let built = CompiledModel::build(random_model(&choices, explicit), &BackEndSettings::default());
        // Sums of sums of sums nest deeper than loops may: refused by name.
        prop_assume!(!matches!(built, Err(BackEndError::Differentiate(DifferentiateError::TooDeep))));
        let model = built.expect("the model compiles");
        let yp: Vec<f64> = y.iter().map(|y| 0.4 - 0.7 * y).collect();
        let exact = jacobian(&model, &y, &yp, cj);
        let scale = exact.iter().flatten().fold(1.0f64, |s, v| s.max(v.abs()));
        prop_assume!(scale < 1e4);
        // A long step is exact to rounding where the rows are smooth. It may reach across a kink of `min` or `abs` nearby: a short one does not.
        let estimates = [2e-4, 2e-6, 2e-8].map(|h| (differences(&model, &y, &yp, cj, h), (1e-14 / h).max(1e-6)));
        // A kink at the very point, where a tie has any derivative of either side: the Jacobian jumps around it.
        let near_kink = |row: usize| {
            (0..24u32).any(|pattern| {
                let sign = |i: usize| if pattern.wrapping_mul(2_654_435_761u32.wrapping_mul(i as u32 + 1)) >> 16 & 1 == 0 { 1e-3 } else { -1e-3 };
                let moved: Vec<f64> = y.iter().enumerate().map(|(i, y)| y + sign(i)).collect();
                let other = jacobian(&model, &moved, &yp, cj);
                other[row].iter().zip(&exact[row]).any(|(a, b)| (a - b).abs() > 0.02 * scale)
            })
        };
        for (row, entries) in exact.iter().enumerate() {
            for (column, value) in entries.iter().enumerate() {
                prop_assert!(!value.is_nan());
                let same = estimates.iter().any(|(estimate, error)| (value - estimate[row][column]).abs() <= error * scale);
                let found = estimates.iter().map(|(estimate, _)| estimate[row][column]);
                prop_assert!(same || near_kink(row), "({row}, {column}): {value}, by differences {:?}", found.collect::<Vec<_>>());
            }
        }
    }
}

/// `0 = Σ_i w x[i] · x[j] + 10 x[2] - x'[j]`: the sum's entries, the diagonal and the column of x[2] collide.
#[test]
fn entries_at_one_place_are_added() {
    let n = 12u32;
    let mut m = Maker::new();
    let x = m.variable("x", Role::State, n);
    let other = Affine::along(0, LoopVar(1), 1);
    let (here, there, second) = (m.load(x, cell(0)), m.load(x, other), m.load(x, Affine::constant(2)));
    let e = &mut m.model.exprs;
    let sum = e.reduce(ReduceFn::Sum, LoopVar(1), n, there);
    let product = e.mul(sum, here);
    let ten = e.constant(10.0);
    let term = e.mul(ten, second);
    let total = e.add(product, term);
    m.rate(&[n], x, cell(0), total);
    let model = build(m.model);
    let y: Vec<f64> = (0..n).map(|i| 0.1 + f64::from(i)).collect();
    let exact = jacobian(&model, &y, &y, 4.0);
    let total: f64 = y.iter().sum();
    for (row, entries) in exact.iter().enumerate() {
        for (column, value) in entries.iter().enumerate() {
            let diagonal = if row == column { total - 4.0 } else { 0.0 };
            let expected = y[row] + diagonal + if column == 2 { 10.0 } else { 0.0 };
            assert!((value - expected).abs() < 1e-12, "({row}, {column}): {value}, not {expected}");
        }
    }
    assert_eq!(model.pattern().nonzeros(), 144);
}

/// `0 = Σ_i Σ_k a[i,k] x[k] - x'[j]` with a as parameters: the inner leaf is summed over the outer loop.
#[test]
fn a_double_sum_gives_one_column_each() {
    let n = 10u32;
    let mut m = Maker::new();
    let x = m.variable("x", Role::State, n);
    let a = m.variable("a", Role::Discrete, n * n);
    let mut at = Affine::along(0, LoopVar(1), i64::from(n));
    at.strides[2] = 1;
    let (weight, value) = (m.load(a, at), m.load(x, Affine::along(0, LoopVar(2), 1)));
    let e = &mut m.model.exprs;
    let product = e.mul(weight, value);
    let inner = e.reduce(ReduceFn::Sum, LoopVar(2), n, product);
    let outer = e.reduce(ReduceFn::Sum, LoopVar(1), n, inner);
    m.rate(&[n], x, cell(0), outer);
    let model = build(m.model);
    let mut memory = model.memory();
    let weights = memory.region_mut(smpl_compiler::layout::Region::Discrete);
    weights.iter_mut().enumerate().for_each(|(i, w)| *w = (i as f64).sqrt());
    let weights = weights.to_vec();
    model.prepare_parameters(&mut memory);
    model.prepare_step(&mut memory);
    let (y, mut values) = (vec![1.0; 10], vec![0.0; model.pattern().nonzeros()]);
    model.jacobian(&mut memory, 0.0, &y, &y, 0.0, &mut values);
    for column in 0..10 {
        let expected: f64 = (0..10).map(|i| weights[10 * i + column]).sum();
        let value = model.pattern().position(3, column).map_or(0.0, |p| values[p]);
        assert!((value - expected).abs() < 1e-12, "{value} {expected}");
    }
}

#[test]
fn derivatives_at_singular_points_are_finite() {
    let mut m = Maker::new();
    let x = m.variable("x", Role::State, 3);
    let parts: Vec<ExprId> = (0..3).map(|i| m.load(x, Affine::constant(i))).collect();
    let e = &mut m.model.exprs;
    let (power, three) = (e.constant(0.6), e.constant(1.5));
    let values = [e.unary(UnaryFn::Sqrt, parts[0]), e.binary(BinaryFn::Pow, parts[1], power), e.binary(BinaryFn::Pow, parts[2], three)];
    for (i, value) in values.into_iter().enumerate() {
        m.rate(&[], x, Affine::constant(i as i64), value);
    }
    let model = build(m.model);
    assert!(jacobian(&model, &[0.0; 3], &[0.0; 3], 1.0).iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn too_few_equations_are_refused() {
    let mut m = Maker::new();
    m.variable("x", Role::State, 4);
    assert!(matches!(CompiledModel::build(m.model, &BackEndSettings::default()), Err(BackEndError::NotSquare { unknowns: 4, rows: 0 })));
}
