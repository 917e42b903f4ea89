//! Published test problems, written in the language under `tests/problems`, against their published reference values.
//!
//! The values are those of the Test Set for Initial Value Problem Solvers (F. Mazzia, C. Magherini, release 2.4).

use std::path::{Path, PathBuf};
use std::process::Command;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/problems")
}

/// Solves a problem to its end and gives back the columns of the last row.
fn solve(name: &str) -> Vec<(String, f64)> {
    let out = std::env::temp_dir().join(format!("smpl-problem-{}-{name}.csv", std::process::id()));
    let model = folder().join(format!("{name}.eq"));
    let output = Command::new(env!("CARGO_BIN_EXE_smpl")).arg("simulate").arg(model).arg("--out").arg(&out).output();
    let output = output.expect("smpl runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(&out).expect("a table");
    let _ = std::fs::remove_file(&out);
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let last: Vec<&str> = lines.last().expect("rows").split(',').collect();
    header.iter().zip(last).filter_map(|(name, cell)| Some(((*name).to_owned(), cell.parse().ok()?))).collect()
}

/// Compares with reference values: six digits, or `small` absolutely.
fn check(name: &str, reference: &[(&str, f64)], small: f64) {
    let solution = solve(name);
    for (variable, expected) in reference {
        let value = solution.iter().find(|(n, _)| n == variable).unwrap_or_else(|| panic!("{name} has no {variable}")).1;
        let error = (value - expected).abs();
        assert!(error <= 1e-6 * expected.abs() + small, "{name}, {variable}: {value}, published {expected}");
    }
}

const ROBERTSON: [(&str, f64); 3] =
    [("y_1", 0.208_334_014_970_125_5e-7), ("y_2", 0.833_336_077_033_471_3e-13), ("y_3", 0.999_999_979_166_505)];

#[test]
fn robertson_as_differential_equations() {
    check("robertson", &ROBERTSON, 0.0);
}

#[test]
fn robertson_with_its_conservation_law() {
    check("robertson_dae", &ROBERTSON, 0.0);
}

#[test]
fn van_der_pol() {
    check("van_der_pol", &[("x", 0.170_616_773_217_048_3e1), ("v", -0.892_809_701_024_797_5)], 0.0);
}

#[test]
fn hires() {
    let reference = [
        ("y1", 0.737_131_257_332_566_8e-3),
        ("y2", 0.144_248_572_631_618_5e-3),
        ("y3", 0.588_872_974_096_757_5e-4),
        ("y4", 0.117_565_134_328_314_9e-2),
        ("y5", 0.238_635_619_883_133_1e-2),
        ("y6", 0.623_896_825_274_279_6e-2),
        ("y7", 0.284_999_839_518_576_9e-2),
        ("y8", 0.285_000_160_481_423_1e-2),
    ];
    check("hires", &reference, 0.0);
}

#[test]
fn pollution() {
    let reference = [
        ("y1", 0.564_625_548_002_276_9e-1),
        ("y2", 0.134_248_413_042_233_9),
        ("y3", 0.413_973_433_109_942_7e-8),
        ("y4", 0.552_314_020_748_435_9e-2),
        ("y5", 0.201_897_726_230_219_6e-6),
        ("y6", 0.146_454_186_349_396_6e-6),
        ("y7", 0.778_424_911_899_796_4e-1),
        ("y8", 0.324_507_535_339_601_8),
        ("y9", 0.749_401_338_388_040_6e-2),
        ("y10", 0.162_229_315_730_156_1e-7),
        ("y11", 0.113_586_383_325_707_5e-7),
        ("y12", 0.223_050_597_572_135_9e-2),
        ("y13", 0.208_716_288_279_863e-3),
        ("y14", 0.139_692_101_684_015_8e-4),
        ("y15", 0.896_488_485_689_829_5e-2),
        ("y16", 0.435_284_636_933_010_3e-17),
        ("y17", 0.689_921_969_626_340_5e-2),
        ("y18", 0.100_780_303_736_594_6e-3),
        ("y19", 0.177_214_651_396_998_4e-5),
        ("y20", 0.568_294_329_231_639_2e-4),
    ];
    check("pollution", &reference, 1e-22);
}
