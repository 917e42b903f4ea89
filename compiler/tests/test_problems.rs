//! The published test problems are models: their right sides at the start against the values worked out from the publications.

mod running;

use running::Running;

fn problem(name: &str) -> Running {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/problems").join(name);
    Running::new(&std::fs::read_to_string(path).expect("the problem"))
}

#[test]
fn every_problem_compiles() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/problems");
    let names = std::fs::read_dir(folder).expect("the problems").map(|e| e.expect("an entry").file_name().into_string().expect("a name"));
    let mut count = 0;
    for name in names.filter(|n| n.ends_with(".eq")) {
        let rates = problem(&name).rates();
        assert!(rates.iter().all(|r| r.is_finite()), "{name}: {rates:?}");
        count += 1;
    }
    assert!(count >= 6);
}

#[test]
fn hires_starts_with_its_rates() {
    let rates = problem("hires.eq").rates();
    let expected = [-1.7093, 1.71, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    rates.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{rates:?}"));
}

#[test]
fn the_oregonator_starts_with_its_rates() {
    let rates = problem("orego.eq").rates();
    let expected = [77.27 * (2.0 + (1.0 - 8.375e-6 - 2.0)), (3.0 - 4.0) / 77.27, 0.161 * -2.0];
    rates.iter().zip(expected).for_each(|(a, b): (&f64, f64)| assert!((a - b).abs() < 1e-13, "{rates:?}"));
}
