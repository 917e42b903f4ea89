//! Fluxes on grids: order of accuracy on exact profiles, conservation, and sizes that do not grow with the grid.

mod running;

use running::Running;

/// Largest error of the rates against the exact ones, over the cells that `inner` keeps.
fn error(
    source: &str,
    n: usize,
    profile: &dyn Fn(f64) -> f64,
    exact: &dyn Fn(f64) -> f64,
    centre: &dyn Fn(usize) -> f64,
    skip: usize,
) -> f64 {
    let mut r = Running::new(source);
    (0..n).for_each(|i| r.y[i] = profile(centre(i)));
    let rates = r.rates();
    (skip..n - skip).map(|i| (rates[i] - exact(centre(i))).abs()).fold(0.0, f64::max)
}

/// log2 of the ratio of the errors on n and 2n cells.
fn order(make: &dyn Fn(usize) -> f64, n: usize) -> f64 {
    (make(n) / make(2 * n)).log2()
}

fn advection(scheme: &str, n: usize) -> f64 {
    let source = format!(
        "domain z in 0..1 cells {n} scheme {scheme}
         state c[z] = 0
         flux J[z] = c[z], low = 0, high = 0
         eq d/dt c[z] = -div(J[z]) / 1 [s] for z"
    );
    let centre = |i: usize| (i as f64 + 0.5) / n as f64;
    // Monotone inside, so that the limiter keeps its order.
    error(&source, n, &|x| (1.5 * x).exp(), &|x| -1.5 * (1.5 * x).exp(), &centre, 3)
}

#[test]
fn schemes_have_their_order_on_a_smooth_profile() {
    for (scheme, expected) in [("upwind", 1.0), ("downwind", 1.0), ("central", 2.0), ("upwind2", 2.0), ("limited", 2.0)] {
        let found = order(&|n| advection(scheme, n), 160);
        assert!((found - expected).abs() < 0.15, "{scheme}: order {found}");
    }
}

fn diffusion(geometry: &str, power: i32, n: usize) -> f64 {
    let source = format!(
        "domain r in 0..2 cells {n} scheme central geometry {geometry}
         state c[r] = 0
         flux J[r] = -grad(c[r])
         eq d/dt c[r] = -div(J[r]) / 1 [s] for r"
    );
    let centre = |i: usize| 2.0 * (i as f64 + 0.5) / n as f64;
    // x^-p (x^p u')' of u = cos x
    let exact = move |x: f64| -x.cos() - f64::from(power) * x.sin() / x;
    let mut r = Running::new(&source);
    (0..n).for_each(|i| r.y[i] = centre(i).cos());
    let rates = r.rates();
    // The volume-weighted error: centres are not centroids, so single cells near the axis are of lower order.
    let weight =
        |i: usize| ((2.0 * (i + 1) as f64 / n as f64).powi(power + 1) - (2.0 * i as f64 / n as f64).powi(power + 1)) / f64::from(power + 1);
    (0..n - 1).map(|i| (rates[i] - exact(centre(i))).abs() * weight(i)).sum()
}

#[test]
fn diffusion_is_of_second_order_in_every_geometry() {
    for (geometry, power) in [("planar", 0), ("cylindrical", 1), ("spherical", 2)] {
        let found = order(&|n| diffusion(geometry, power, n), 200);
        assert!(found > 1.8, "{geometry}: order {found}");
    }
}

#[test]
fn a_linear_profile_is_exact_on_a_stretched_grid() {
    let mut r = Running::new(
        "domain z in 0 [m]..2 [m] cells 12 scheme central stretch 1.3
         state c[z] = z / 1 [m]
         flux J[z] = c[z] * 1 [m/s] - 3 [m^2/s] * grad(c[z]), low = -3 [m/s], high = -1 [m/s]
         eq d/dt c[z] = -div(J[z]) for z
         let length : m = sum(width(z) for z)",
    );
    assert!((r.output("length") - 2.0).abs() < 1e-14);
    // The advective part of a linear profile has the divergence 1, diffusion none.
    r.rates().iter().for_each(|f| assert!((f + 1.0).abs() < 1e-12, "{f}"));
}

#[test]
fn steady_advection_and_diffusion_converge_to_the_exact_profile() {
    // v c' = D c'', c(0) = 0, c(1) = 1: c = (e^(Pe x) - 1)/(e^Pe - 1), flux constant.
    let residual = |n: usize| {
        let source = format!(
            "domain z in 0 [m]..1 [m] cells {n} scheme central
             state c[z] = 0
             flux J[z] = 1 [m/s]*c[z] - 0.2 [m^2/s]*grad(c[z]), low = j, high = j
             param j : m/s = -1 / (exp(5) - 1)
             eq d/dt c[z] = -div(J[z]) for z"
        );
        let exact = |x: f64| ((5.0 * x).exp() - 1.0) / (5_f64.exp() - 1.0);
        let mut r = Running::new(&source);
        (0..n).for_each(|i| r.y[i] = exact((i as f64 + 0.5) / n as f64));
        // The residual integrated over the cells: the error of the fluxes.
        r.rates()
            .iter()
            .scan(0.0, |sum, f| {
                *sum += f / n as f64;
                Some(f64::abs(*sum))
            })
            .fold(0.0, f64::max)
    };
    let found = order(&residual, 100);
    assert!((found - 2.0).abs() < 0.1, "order {found}");
}

/// Sum of the cells' balances against what crosses the ends.
fn conserves(domain: &str, measure: &dyn Fn(usize, usize) -> f64, low_area: f64, high_area: f64) {
    let n = 40;
    let source = format!(
        "domain z in 1..3 cells {n} {domain}
         state c[z] = 0
         flux J[z] = c[z]^2 - 0.7*grad(c[z]), low = 2.5, high = 0.75
         eq d/dt c[z] = -div(J[z]) / 1 [s] for z"
    );
    let mut r = Running::new(&source);
    (0..n).for_each(|i| r.y[i] = (7.3 * i as f64).sin());
    let total: f64 = r.rates().iter().enumerate().map(|(i, f)| f * measure(i, n)).sum();
    let expected = 2.5 * low_area - 0.75 * high_area;
    assert!((total - expected).abs() < 1e-12 * 40.0, "{domain}: {total} instead of {expected}");
}

#[test]
fn what_leaves_one_cell_enters_the_next() {
    let face = |k: usize, n: usize| 1.0 + 2.0 * k as f64 / n as f64;
    for scheme in ["upwind", "downwind", "central", "upwind2", "limited"] {
        conserves(&format!("scheme {scheme}"), &|i, n| face(i + 1, n) - face(i, n), 1.0, 1.0);
        conserves(&format!("scheme {scheme} geometry cylindrical"), &|i, n| (face(i + 1, n).powi(2) - face(i, n).powi(2)) / 2.0, 1.0, 3.0);
        conserves(&format!("scheme {scheme} geometry spherical"), &|i, n| (face(i + 1, n).powi(3) - face(i, n).powi(3)) / 3.0, 1.0, 9.0);
        let graded = |k: usize, n: usize| 1.0 + 2.0 * (1.1_f64.powi(k as i32) - 1.0) / (1.1_f64.powi(n as i32) - 1.0);
        conserves(&format!("scheme {scheme} stretch 1.1"), &|i, n| graded(i + 1, n) - graded(i, n), 1.0, 1.0);
    }
    conserves(
        "scheme upwind faces 1 + 2*(k/40)^2",
        &|i, n| 2.0 * (((i + 1) as f64 / n as f64).powi(2) - (i as f64 / n as f64).powi(2)),
        1.0,
        1.0,
    );
}

#[test]
fn a_constant_field_is_left_alone_by_every_scheme() {
    for scheme in ["upwind", "downwind", "central", "upwind2", "limited"] {
        for geometry in ["planar", "cylindrical", "spherical"] {
            let mut r = Running::new(&format!(
                "domain z in 1..3 cells 9 scheme {scheme} geometry {geometry}
                 state c[z] = 4
                 flux J[z] = -grad(c[z])
                 eq d/dt c[z] = -div(J[z]) / 1 [s] for z"
            ));
            r.rates().iter().for_each(|f| assert!(f.abs() < 1e-13, "{scheme}, {geometry}: {f}"));
        }
    }
}

#[test]
fn the_limiter_makes_no_new_extremum() {
    let mut r = Running::new(
        "domain z in 0 [m]..1 [m] cells 20 scheme limited
         state c[z] = 0
         flux J[z] = 1 [m/s] * c[z], low = 1 [m/s]
         eq d/dt c[z] = -div(J[z]) for z",
    );
    // A front, stepped forward explicitly at a Courant number of 0.25.
    for _ in 0..60 {
        let rates = r.rates();
        r.y.iter_mut().zip(rates).for_each(|(c, f)| *c += 0.25 / 20.0 * f);
        assert!(r.y.iter().all(|c| (-1e-12..=1.0 + 1e-12).contains(c)), "{:?}", r.y);
    }
}

#[test]
fn a_bead_in_a_bed_takes_up_what_the_bed_loses() {
    let mut r = Running::new(
        "param R : m = 0.5
         param k : m/s = 0.3
         domain z in 0 [m]..1 [m] cells 6 scheme upwind
         domain r in 0..R cells 5 scheme central geometry spherical
         state c[z] : mol/m^3 = 0
         state q[z, r] : mol/m^3 = 0
         let N[z] = k * (c[z] - q[z, r.last])
         flux J[z] = 2 [m/s]*c[z], low = 0, high = 0
         flux G[z, r] = -0.1 [m^2/s]*grad(q[z, r]), low = 0, high = -N[z]
         eq 0.4 * d/dt c[z] = -div(J[z]) - 0.6*3/R*N[z] for z
         eq d/dt q[z, r] = -div(G[z, r]) for z, r
         let rate : mol/(m^2 s) = sum(width(z) * (0.4*der(c[z]) + 0.6 * sum(volume(r)*der(q[z, r]) for r) / sum(volume(r) for r)) for z)",
    );
    for (i, y) in r.y.iter_mut().enumerate() {
        *y = (1.7 * i as f64).cos() + 2.0;
    }
    assert!(r.output("rate").abs() < 1e-13, "{}", r.output("rate"));
}

fn bed(n: usize) -> String {
    format!(
        "set s = {{ a, b }}
         param L : m = 1
         domain z in 0..L cells {n} scheme limited
         domain r in 0 [m]..1 [m] cells 4 scheme central geometry spherical
         state c[s, z] : mol/m^3 = 0
         state q[z, r] : mol/m^3 = 0
         let N[z] = 1 [m/s] * (c[a, z] - q[z, r.last])
         flux J[i in s, z] = 1 [m/s]*c[i, z] - 0.1 [m^2/s]*grad(c[i, z]), low = 1 [mol/(m^2 s)]
         flux G[z, r] = -0.1 [m^2/s]*grad(q[z, r]), low = 0, high = -N[z]
         eq d/dt c[i, z] = -div(J[i, z]) - N[z] / 1 [m] for i in s, z
         eq d/dt q[z, r] = -div(G[z, r]) for z, r"
    )
}

#[test]
fn expressions_and_code_do_not_grow_with_the_grid() {
    let (small, large) = (running::flat(&bed(20)), running::flat(&bed(2000)));
    assert_eq!(small.exprs.len(), large.exprs.len());
    assert_eq!(small.rows.len(), large.rows.len());
    let (small, large) = (Running::of(small), Running::of(large));
    let ratio = large.model.code_len() as f64 / small.model.code_len() as f64;
    assert!(ratio < 1.2, "{} and {} bytes", small.model.code_len(), large.model.code_len());
}

#[test]
fn seventeen_thousand_cells_compile_at_once() {
    let start = std::time::Instant::now();
    let r = Running::new(&bed(17_000));
    assert_eq!(r.model.unknowns(), 17_000 * 6);
    // No slow or busy machine takes that long.
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}
