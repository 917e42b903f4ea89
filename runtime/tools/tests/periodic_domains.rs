//! Periodic domains: discrete Fourier modes in closed form, conservation, neighbours, faults.

mod shell;

use std::f64::consts::PI;

use shell::{columns, file, name, smpl, status, text};

const N: usize = 24;

/// A wave on a ring with a flux or an equation.
fn ring(clauses: &str, equations: &str) -> String {
    format!(
        "time t : s\nparam v : m/s = 0.3\nparam D : m^2/s = 0.004\ndomain z in 0.5 [m]..2.5 [m] cells {N} {clauses} periodic\n\
         state c[z] : mol/m^3 = 0 in -9..9\n{equations}\ninitial c[z] = 1 + sin(2*pi*z/1 [m]) for z\n\
         let total : mol/m^2 = integral(c[z] for z)\nepisode {{ step = 0.25 [s], max_steps = 8 }}\nsolver {{ rtol = 1e-10 }}\n"
    )
}

/// A complex number.
type Complex = (f64, f64);

fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// The cells at the end, where the face value of `exp(i k z)` in cell 0 is `face` at its upper face: the rate of
/// the mode is `-v (1 - exp(-i k h)) face / h - D (2 - 2 cos(k h)) / h²`.
fn mode(face: Complex, v: f64, t: f64) -> Vec<f64> {
    let (h, k) = (2.0 / N as f64, 2.0 * PI);
    let (back, q) = ((1.0 - (k * h).cos(), (k * h).sin()), 0.004 * (2.0 - 2.0 * (k * h).cos()) / (h * h));
    let flux = times(back, face);
    let (decay, turn) = (-v * flux.0 / h - q, -v * flux.1 / h);
    (0..N).map(|j| 1.0 + (decay * t).exp() * (k * (0.5 + h * (j as f64 + 0.5)) + turn * t).sin()).collect()
}

fn cells(test: &str, source: &str, method: &str) -> (Vec<f64>, Vec<f64>) {
    let names: Vec<String> = (1..=N).map(|j| format!("c[{j}]")).chain(["total".to_owned()]).collect();
    let wanted: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut found = columns(&file(test, "m.eq", source), &wanted, &["--method", method]);
    let total = found.pop().expect("the total");
    (found.iter().map(|cell| *cell.last().expect("a row")).collect(), total)
}

fn near(found: &[f64], expected: &[f64]) {
    let away = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(away < 2e-8, "{away}: {found:?} {expected:?}");
}

#[test]
fn a_wave_goes_round_as_the_modes_of_each_scheme_do() {
    let kh = 2.0 * PI * 2.0 / N as f64;
    let cell = |by: f64| ((by * kh).cos(), (by * kh).sin());
    let mix = |a: f64, x: Complex, b: f64, y: Complex| (a * x.0 + b * y.0, a * x.1 + b * y.1);
    for (scheme, face, method) in [
        ("central", mix(0.5, cell(0.0), 0.5, cell(1.0)), "ida"),
        ("upwind", cell(0.0), "rosenbrock"),
        ("downwind", cell(1.0), "explicit"),
        ("upwind2", mix(1.5, cell(0.0), -0.5, cell(-1.0)), "auto"),
    ] {
        let source = ring(&format!("scheme {scheme}"), "flux J[z] = v*c[z] - D*grad(c[z])\neq d/dt c[z] = -div(J[z]) for z");
        let (found, total) = cells(scheme, &source, method);
        near(&found, &mode(face, 0.3, 2.0));
        assert!(total.iter().all(|m| (m - total[0]).abs() < 1e-9), "{total:?}");
    }
}

#[test]
fn a_flow_that_turns_takes_the_values_from_its_side_across_the_seam() {
    let source = ring(
        "scheme upwind",
        "state u : m/s = -0.3 in -1..1\neq d/dt u = 0*u/1 [s]\nflux J[z] = u*c[z] - D*grad(c[z])\neq d/dt c[z] = -div(J[z]) for z",
    );
    let kh = 2.0 * PI * 2.0 / N as f64;
    near(&cells("turning", &source, "ida").0, &mode((kh.cos(), kh.sin()), -0.3, 2.0));
}

#[test]
fn neighbours_of_the_end_cells_are_those_of_the_other_end() {
    let by_number = "eq d/dt c[z] = -v*(c[z+1] - c[z-1])/(2*width(z)) + D*(c[z+1] - 2*c[z] + c[z-1])/width(z)^2 for z";
    let kh = 2.0 * PI * 2.0 / N as f64;
    let face = (0.5 + 0.5 * kh.cos(), 0.5 * kh.sin());
    near(&cells("neighbours", &ring("", by_number), "ida").0, &mode(face, 0.3, 2.0));
    let far = "let d[z] : 1 = (c[z-3] + c[z+5] - c[z+2] - c[z-2])/1 [mol/m^3]\neq d/dt c[z] = 0*c[z]/1 [s] for z";
    let found = columns(&file("far", "m.eq", ring("", &format!("{far}\nlet a : 1 = d[z.first]\nlet b : 1 = d[z.last]"))), &["a", "b"], &[]);
    let at = |j: i32| 1.0 + (kh * (f64::from(j) - 0.5) + PI).sin();
    let d = |j: i32| at(j - 3) + at(j + 5) - at(j + 2) - at(j - 2);
    assert!((found[0][0] - d(1)).abs() < 1e-12 && (found[1][0] - d(24)).abs() < 1e-12, "{found:?}");
}

#[test]
fn a_ring_with_cells_of_other_widths_keeps_its_content_and_a_constant() {
    for scheme in ["central", "upwind", "upwind2", "limited"] {
        let clauses = format!("scheme {scheme} faces 0.5 [m] + 2 [m]*(k + 0.4*k*({N} - k)/{N})/{N}");
        let equations = "flux J[z] = v*c[z] - D*grad(c[z])\neq d/dt c[z] = -div(J[z]) for z";
        let (_, total) = cells("widths", &ring(&clauses, equations), "ida");
        assert!(total.iter().all(|m| (m - total[0]).abs() < 1e-9), "{total:?}");
        let flat = ring(&clauses, equations).replace("1 + sin(2*pi*z/1 [m])", "1.5");
        let (found, _) = cells("flat", &flat, "ida");
        assert!(found.iter().all(|c| (c - 1.5).abs() < 1e-9), "{scheme} {found:?}");
    }
}

#[test]
fn conditions_compare_a_cell_with_the_ends_of_its_domain() {
    let equation = "eq d/dt c[z] = (if z == z.first then 1 [mol/m^3] - c[z] else if z == z.last or z.number == 3 then -c[z] \
                    else 0 [mol/m^3])/1 [s] for z";
    let source = ring("", equation).replace(" periodic", "").replace("1 + sin(2*pi*z/1 [m])", "2");
    let (found, _) = cells("ends", &source, "ida");
    let e = (-2.0_f64).exp();
    assert!((found[0] - 1.0 - e).abs() < 1e-8 && (found[2] - 2.0 * e).abs() < 1e-8 && (found[N - 1] - 2.0 * e).abs() < 1e-8);
    assert_eq!(found[1], 2.0);
}

#[test]
fn faults_of_periodic_domains_have_their_place_and_a_way_out() {
    let flux = |ends: &str| format!("flux J[z] = v*c[z]{ends}\neq d/dt c[z] = -div(J[z]) for z");
    for (source, message) in [
        (ring("scheme upwind", &flux(", low = 0 [mol/(m^2 s)]")), "`z` is periodic and has no end where `J` could be given"),
        (ring("geometry cylindrical", &flux("")).replace("let total : mol/m^2", "let total"), "`z` is a radius, which is not periodic"),
        (ring("periodic", &flux("")), "`periodic` is given twice"),
    ] {
        let output = smpl(&["check", name(&file("faults", "m.eq", &source))]);
        let told = text(&output.stderr);
        assert!(status(&output) == 1 && told.contains(message), "{source}\n{told}");
        assert_eq!(told.matches('×').count(), 1, "one cause is one diagnostic: {told}");
    }
}
