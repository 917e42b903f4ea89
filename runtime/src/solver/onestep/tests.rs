//! The coefficients against the order conditions of their methods, tree by tree, and the methods on
//! small problems with closed solutions.

use super::super::problems::Problem;
use super::super::{Advance, Carried, Integrator, Method, Pattern, Quadratures, Settings, Statistics, System};
use super::{OneStep, dop853, rodas5p, tsit5};

/// A rooted tree: the branches at its root.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Tree(Vec<Tree>);

impl Tree {
    fn order(&self) -> usize {
        1 + self.0.iter().map(Tree::order).sum::<usize>()
    }

    /// The density γ(t): what the elementary weight has to be the reciprocal of.
    fn density(&self) -> f64 {
        self.order() as f64 * self.0.iter().map(Tree::density).product::<f64>()
    }

    /// For each stage, the elementary weight of the branches at a vertex. A vertex with one branch
    /// takes it by `single`, else each by `several` (Hairer and Wanner, *Solving Ordinary
    /// Differential Equations II*, section IV.7, theorem 7.3).
    fn stages(&self, single: &[Vec<f64>], several: &[Vec<f64>]) -> Vec<f64> {
        let matrix = if self.0.len() == 1 { single } else { several };
        let mut product = vec![1.0; matrix.len()];
        for branch in &self.0 {
            let below = branch.stages(single, several);
            for (product, row) in product.iter_mut().zip(matrix) {
                *product *= dot(row, &below);
            }
        }
        product
    }
}

/// All trees of an order.
fn trees(order: usize) -> Vec<Tree> {
    fn forests(size: usize, most: Option<&Tree>, all: &[Vec<Tree>]) -> Vec<Vec<Tree>> {
        if size == 0 {
            return vec![vec![]];
        }
        let firsts = (1..=size).flat_map(|order| &all[order]).filter(|tree| most.is_none_or(|most| *tree <= most));
        firsts
            .flat_map(|first| {
                let rest = forests(size - first.order(), Some(first), all);
                rest.into_iter().map(|mut rest| {
                    rest.push(first.clone());
                    rest
                })
            })
            .collect()
    }
    let mut all: Vec<Vec<Tree>> = vec![vec![]];
    for size in 1..=order {
        let of_size = forests(size - 1, None, &all).into_iter().map(Tree).collect();
        all.push(of_size);
    }
    all.swap_remove(order)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Largest violation of the conditions of an order.
fn violation(order: usize, weights: &[f64], single: &[Vec<f64>], several: &[Vec<f64>], share: f64) -> f64 {
    let expected = |tree: &Tree| share.powi(order as i32) / tree.density();
    let worst = |tree: &Tree| (dot(weights, &tree.stages(single, several)) - expected(tree)).abs();
    trees(order).iter().map(worst).fold(0.0, f64::max)
}

#[test]
fn there_are_as_many_trees_as_cayley_counted() {
    let counts: Vec<usize> = (1..=8).map(|order| trees(order).len()).collect();
    assert_eq!(counts, [1, 1, 2, 4, 9, 20, 48, 115]);
}

/// A lower triangular matrix of eight stages from its rows below the diagonal.
fn lower(rows: [&[f64]; 8]) -> Vec<Vec<f64>> {
    rows.iter().map(|row| row.iter().copied().chain(std::iter::repeat(0.0)).take(8).collect()).collect()
}

fn product(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let column = |j: usize| b.iter().map(|row| row[j]).collect::<Vec<f64>>();
    a.iter().map(|row| (0..row.len()).map(|j| dot(row, &column(j))).collect()).collect()
}

/// Rodas5P as its paper writes it: α, β = α + Γ, and the conversion of weights of the stages U to
/// its own.
struct Classical {
    alpha: Vec<Vec<f64>>,
    beta: Vec<Vec<f64>>,
    gamma: Vec<Vec<f64>>,
    a: Vec<Vec<f64>>,
}

#[allow(clippy::needless_range_loop, reason = "as in the formula")]
fn classical() -> Classical {
    use rodas5p::*;
    let [mut a7, mut a8] = [A6.to_vec(), A6.to_vec()];
    a7.push(1.0);
    a8.extend([1.0, 1.0]);
    let a = lower([&[], &A2, &A3, &A4, &A5, &A6, &a7, &a8]);
    let c = lower([&[], &C2, &C3, &C4, &C5, &C6, &C7, &C8]);
    // Γ is the inverse of 1/γ - C, by forward substitution.
    let mut gamma = vec![vec![0.0; 8]; 8];
    for j in 0..8 {
        for i in j..8 {
            let unit = f64::from(u8::from(i == j));
            gamma[i][j] = GAMMA * (unit + (j..i).map(|k| c[i][k] * gamma[k][j]).sum::<f64>());
        }
    }
    let alpha = product(&a, &gamma);
    let beta = alpha.iter().zip(&gamma).map(|(a, g)| a.iter().zip(g).map(|(a, g)| a + g).collect()).collect();
    Classical { alpha, beta, gamma, a }
}

impl Classical {
    fn weights(&self, of_stages: &[f64]) -> Vec<f64> {
        (0..8).map(|j| (0..8).map(|i| of_stages[i] * self.gamma[i][j]).sum()).collect()
    }
}

#[test]
fn rodas5p_has_order_five_its_estimate_and_its_polynomial_order_four() {
    let method = classical();
    let mut end = method.a[7].clone();
    let embedded = method.weights(&end);
    end[7] = 1.0;
    let weights = method.weights(&end);
    for order in 1..=5 {
        assert!(violation(order, &weights, &method.beta, &method.alpha, 1.0) < 1e-13, "order {order}");
    }
    assert!(violation(6, &weights, &method.beta, &method.alpha, 1.0) > 1e-6);
    for order in 1..=4 {
        assert!(violation(order, &embedded, &method.beta, &method.alpha, 1.0) < 1e-13, "order {order}");
    }
    assert!(violation(5, &embedded, &method.beta, &method.alpha, 1.0) > 1e-6);
    for share in [0.1, 0.35, 0.5, 0.8] {
        let inner = |j: usize| rodas5p::H[0][j] + share * (rodas5p::H[1][j] + share * rodas5p::H[2][j]);
        let inside: Vec<f64> = (0..8).map(|j| share * (end[j] + (1.0 - share) * inner(j))).collect();
        for order in 1..=4 {
            assert!(violation(order, &method.weights(&inside), &method.beta, &method.alpha, share) < 1e-13, "order {order} at {share}");
        }
    }
}

#[test]
fn rodas5p_is_stiffly_accurate_and_its_nodes_are_its_row_sums() {
    let method = classical();
    let mut end = method.a[7].clone();
    end[7] = 1.0;
    for (weight, last) in method.weights(&end).iter().zip(&method.beta[7]) {
        assert!((weight - last).abs() < 1e-13);
    }
    for stage in 0..8 {
        let (node, slope) = (method.alpha[stage].iter().sum::<f64>(), method.gamma[stage].iter().sum::<f64>());
        assert!((node - rodas5p::NODES[stage]).abs() < 1e-13, "node {stage}");
        assert!((slope - rodas5p::SLOPES.get(stage).copied().unwrap_or(0.0)).abs() < 1e-13, "slope {stage}");
    }
}

/// DOP853's sixteen stages with the zeros filled in.
fn prince_and_dormand() -> Vec<Vec<f64>> {
    use dop853::*;
    let rows: [&[f64]; 16] = [&[], &A2, &A3, &A4, &A5, &A6, &A7, &A8, &A9, &A10, &A11, &A12, &B, &A14, &A15, &A16];
    let filled = |(row, stages): (&[f64], &[usize])| {
        let mut filled = vec![0.0; 16];
        stages.iter().zip(row).for_each(|(&stage, &factor)| filled[stage] = factor);
        filled
    };
    rows.into_iter().zip(STAGES).map(filled).collect()
}

/// Weights of the stages that the end, the estimates and the polynomial use.
fn spread(factors: &[f64]) -> Vec<f64> {
    let stages = [0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
    let mut weights = vec![0.0; 16];
    stages.into_iter().zip(factors).for_each(|(stage, &factor)| weights[stage] = factor);
    weights
}

#[test]
fn dop853_has_order_eight_and_estimates_of_orders_five_and_three() {
    let a = prince_and_dormand();
    let weights = spread(&dop853::B);
    for (stage, row) in a.iter().enumerate() {
        assert!((row.iter().sum::<f64>() - dop853::C[stage]).abs() < 1e-13, "node {stage}");
    }
    for order in 1..=8 {
        assert!(violation(order, &weights, &a, &a, 1.0) < 1e-13, "order {order}");
    }
    assert!(violation(9, &weights, &a, &a, 1.0) > 1e-8);
    for (errors, order) in [(&dop853::E5, 5), (&dop853::E3, 3)] {
        let lower: Vec<f64> = weights.iter().zip(spread(errors)).map(|(weight, error)| weight - error).collect();
        assert!((1..=order).all(|order| violation(order, &lower, &a, &a, 1.0) < 1e-13));
        assert!(violation(order + 1, &lower, &a, &a, 1.0) > 1e-8);
    }
}

/// Tsit5's seven stages with the zeros filled in.
fn tsitouras() -> Vec<Vec<f64>> {
    use tsit5::*;
    let rows: [&[f64]; 7] = [&[], &A2, &A3, &A4, &A5, &A6, &B];
    rows.into_iter().map(|row| row.iter().copied().chain(std::iter::repeat(0.0)).take(7).collect()).collect()
}

#[test]
fn tsit5_has_order_five_its_estimate_and_its_polynomial_order_four() {
    let a = tsitouras();
    let weights = &a[6];
    for (stage, row) in a.iter().enumerate() {
        assert!((row.iter().sum::<f64>() - tsit5::C[stage]).abs() < 1e-14, "node {stage}");
    }
    for order in 1..=5 {
        assert!(violation(order, weights, &a, &a, 1.0) < 1e-13, "order {order}");
    }
    assert!(violation(6, weights, &a, &a, 1.0) > 1e-6);
    let embedded: Vec<f64> = weights.iter().zip(&tsit5::E).map(|(weight, error)| weight - error).collect();
    let inside = |share: f64| {
        let power = |stage: usize| (0..4).rev().fold(0.0, |sum, power| share * (tsit5::D[power][stage] + sum));
        (0..7).map(power).collect::<Vec<f64>>()
    };
    let shares = [0.1, 0.35, 0.5, 0.8, 1.0].map(|share| (inside(share), share));
    for (weights, share) in shares.iter().map(|(weights, share)| (weights, *share)).chain([(&embedded, 1.0)]) {
        for order in 1..=4 {
            assert!(violation(order, weights, &a, &a, share) < 1e-13, "order {order} at {share}");
        }
    }
    assert!(violation(5, &embedded, &a, &a, 1.0) > 1e-6);
    // At its end the polynomial is the step.
    for (inner, weight) in inside(1.0).iter().zip(weights) {
        assert!((inner - weight).abs() < 1e-14);
    }
}

/// y' = f(t) + k (y - F(t)) for F = sin(3 t), of which y = F is the solution whatever k.
fn forced(stiffness: f64) -> Problem {
    Problem::ode(
        vec![0.0],
        vec![stiffness],
        Pattern::full(1),
        |t, y, yp, u, out| out[0] = 3.0 * (3.0 * t).cos() - u[0] * (y[0] - (3.0 * t).sin()) - yp[0],
        |_, _, cj, u, j| j[0] = -u[0] - cj,
    )
}

/// Errors at the end of an interval of one, step by step of a length, and of values inside of
/// steps.
fn errors(method: Method, mut problem: Problem, step: f64, exact: fn(f64) -> f64) -> f64 {
    let mut settings = Settings::new(1.0, vec![1e9; problem.dimension()]);
    settings.method = method;
    settings.max_step = step;
    let mut one = OneStep::new(&problem, settings).expect("valid");
    one.methods.forgo_short();
    let start = problem.start.clone();
    one.restart(&mut problem, 0.0, &start, None).expect("consistent");
    assert_eq!(one.advance(&mut problem, 1.0), Ok(Advance::Reached));
    (one.state()[0] - exact(1.0)).abs()
}

#[test]
fn errors_fall_with_the_power_of_the_step_that_the_order_says() {
    for (method, order, step) in [(Method::Rosenbrock, 5.0, 0.05), (Method::Explicit, 8.0, 0.25)] {
        let error = |step| errors(method, forced(1.0), step, |t| (3.0 * t).sin());
        let observed = (error(step) / error(step / 2.0)).log2();
        assert!((observed - order).abs() < 0.7, "{method}: order {observed}");
    }
}

/// Control steps of a length along y' = cos t - y / 2 + sin t / 2, with the solution sin t. Returns
/// evaluations of the last one, and the largest error of all.
fn control_steps(length: f64, rtol: f64, count: u32) -> (u64, f64) {
    let mut problem = Problem::ode(
        vec![0.0],
        vec![],
        Pattern::full(1),
        |t, y, yp, _, out| out[0] = t.cos() - 0.5 * (y[0] - t.sin()) - yp[0],
        |_, _, cj, _, j| j[0] = -0.5 - cj,
    );
    let mut settings = Settings::new(rtol, vec![rtol]);
    settings.method = Method::Explicit;
    let mut one = OneStep::new(&problem, settings).expect("valid");
    let (mut state, mut carried, mut evaluations, mut worst) = (vec![0.0], Carried::default(), 0, 0.0_f64);
    for k in 0..count {
        one.forget();
        one.carry(carried);
        let [from, to] = [k, k + 1].map(|k| f64::from(k) * length);
        one.restart(&mut problem, from, &state, None).expect("consistent");
        assert_eq!(one.advance(&mut problem, to), Ok(Advance::Reached));
        (state, carried, evaluations) = (one.state().to_vec(), one.carried(), one.statistics().residuals);
        worst = worst.max((state[0] - to.sin()).abs());
    }
    (evaluations, worst)
}

#[test]
fn the_pair_of_order_five_takes_a_control_step_that_one_step_of_it_covers() {
    // Seven evaluations, one of them at the end, instead of thirteen; and forcings are looked at by
    // evaluations that are not counted.
    let (few, error) = control_steps(0.1, 1e-6, 50);
    assert_eq!(few, 7);
    assert!(error < 1e-6, "{error}");
    // Where it would need two, DOP853 needs one.
    let (more, error) = control_steps(1.0, 1e-6, 50);
    assert_eq!(more, 13);
    assert!(error < 1e-5, "{error}");
}

/// x'' = -x; if it is `watched`, with an event at x = 0.9, if `integrated`, with the integral of
/// x².
struct Swing {
    problem: Problem,
    watched: bool,
    integrated: bool,
}

impl Swing {
    fn new() -> Self {
        let problem = Problem::ode(
            vec![0.0, 1.0],
            vec![],
            Pattern::full(2),
            |_, y, yp, _, out| out.copy_from_slice(&[y[1] - yp[0], -y[0] - yp[1]]),
            |_, _, cj, _, j| j.copy_from_slice(&[-cj, -1.0, 1.0, -cj]),
        );
        Self { problem, watched: false, integrated: false }
    }
}

impl System for Swing {
    fn differential(&self) -> &[bool] {
        self.problem.differential()
    }
    fn is_explicit(&self) -> bool {
        true
    }
    fn depends_on_time(&self) -> bool {
        false
    }
    fn forcing_count(&self) -> usize {
        0
    }
    fn pattern(&self) -> &Pattern {
        self.problem.pattern()
    }
    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        self.problem.residual(t, y, yp, out);
    }
    fn jacobian(&mut self, t: f64, y: &[f64], yp: &[f64], cj: f64, values: &mut [f64]) {
        self.problem.jacobian(t, y, yp, cj, values);
    }
    fn root_count(&self) -> usize {
        usize::from(self.watched)
    }
    fn roots(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = y[0] - 0.9;
    }
    fn quadrature_count(&self) -> usize {
        usize::from(self.integrated)
    }
    fn quadratures(&mut self, _: f64, y: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = y[0] * y[0];
    }
}

#[test]
fn a_state_inside_of_a_step_of_the_pair_is_on_its_polynomial() {
    // An event in the last of the control steps, which ends at 1.2: sin t = 0.9 at
    // 1.1197695149986342.
    let mut swing = Swing { watched: true, ..Swing::new() };
    let mut settings = Settings::new(1e-6, vec![1e-6; 2]);
    settings.method = Method::Explicit;
    let mut one = OneStep::new(&swing, settings).expect("valid");
    let (mut state, mut carried) = (vec![0.0, 1.0], Carried::default());
    for k in 0..4 {
        one.forget();
        one.carry(carried);
        one.restart(&mut swing, 0.3 * f64::from(k), &state, None).expect("consistent");
        let advance = one.advance(&mut swing, 0.3 * f64::from(k + 1));
        assert_eq!(advance, Ok(if k == 3 { Advance::Event } else { Advance::Reached }));
        (state, carried) = (one.state().to_vec(), one.carried());
    }
    assert_eq!(one.statistics().residuals, 7 + 1, "by the pair, and the rates where it happens");
    assert!((one.time() - 0.9_f64.asin()).abs() < 1e-6, "{}", one.time());
    assert!((state[1] - 0.19_f64.sqrt()).abs() < 1e-6, "{state:?}");
}

#[test]
fn a_stiff_equation_costs_a_rosenbrock_method_no_accuracy_worth_a_name() {
    let error = errors(Method::Rosenbrock, forced(1e8), 0.05, |t| (3.0 * t).sin());
    assert!(error < 1e-9, "{error}");
}

#[test]
fn an_integral_along_the_polynomial_is_right_to_the_tolerance() {
    for method in [Method::Rosenbrock, Method::Explicit, Method::Auto] {
        let mut swing = Swing { integrated: true, ..Swing::new() };
        let mut settings = Settings::new(1e-8, vec![1e-10; 2]);
        settings.method = method;
        settings.quadratures = Quadratures::Checked { rtol: 1e-8, atol: 1e-10 };
        let mut one = OneStep::new(&swing, settings).expect("valid");
        one.restart(&mut swing, 0.0, &[0.0, 1.0], None).expect("consistent");
        one.advance(&mut swing, 10.0).expect("reaches the end");
        let exact = 5.0 - 20.0_f64.sin() / 4.0;
        assert!((one.quadratures()[0] - exact).abs() < 1e-6, "{method}: {} is not {exact}", one.quadratures()[0]);
    }
}

/// y' = -y from 1 and exp(s y) (z³ + z - y) = 0 to t = 3: what z is off by there, and the work.
fn follower(steepness: f64) -> (f64, Statistics) {
    let mut problem = Problem::ode(
        vec![1.0, 0.0],
        vec![steepness],
        Pattern::full(2),
        |_, y, yp, s, out| out.copy_from_slice(&[-y[0] - yp[0], (s[0] * y[0]).exp() * (y[1].powi(3) + y[1] - y[0])]),
        |_, y, cj, s, j| {
            let (factor, off) = ((s[0] * y[0]).exp(), y[1].powi(3) + y[1] - y[0]);
            j.copy_from_slice(&[-1.0 - cj, factor * (s[0] * off - 1.0), 0.0, factor * (3.0 * y[1] * y[1] + 1.0)]);
        },
    )
    .with_structure(vec![true, false], true);
    let mut settings = Settings::new(1e-6, vec![1e-8; 2]);
    settings.method = Method::Rosenbrock;
    let mut one = OneStep::new(&problem, settings).expect("valid");
    let start = problem.start.clone();
    one.restart(&mut problem, 0.0, &start, None).expect("consistent");
    assert_eq!(one.advance(&mut problem, 3.0), Ok(Advance::Reached));
    let (y, z) = (one.state()[0], one.state()[1]);
    (z.powi(3) + z - y, one.statistics())
}

#[test]
fn algebraic_unknowns_follow_by_the_factors_of_before_where_those_serve() {
    let (off, work) = follower(0.0);
    assert!(off.abs() < 1e-8, "{off}");
    assert!(work.steps > 10 && work.jacobians < work.steps + work.error_test_failures + 10, "{work:?}");
    // Where the equation's weight falls by 16 powers of ten, a correction by the old one is far too
    // small.
    let (off, work) = follower(40.0);
    assert!(off.abs() < 1e-8, "{off}");
    assert!(work.jacobians > work.steps, "{work:?}");
}
