//! The command on shipped models.

use std::path::{Path, PathBuf};
use std::process::Command;

#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../tests/support/reference.rs"]
mod reference;

/// The file of a shipped model.
fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(name)
}

/// Values of a column, as text.
fn column(path: &Path, name: &str) -> Vec<String> {
    let mut reader = csv::Reader::from_path(path).expect("the table");
    let at = reader.headers().expect("a heading").iter().position(|h| h == name);
    let at = at.unwrap_or_else(|| panic!("no column {name}"));
    reader.records().map(|r| r.expect("a row")[at].to_owned()).collect()
}

/// The options of the contract together: a reference episode through the command.
#[test]
#[cfg_attr(not(references), ignore = "needs the reference trajectories (SMPL_REFERENCE)")]
fn the_command_replays_a_reference_episode() {
    let Some(table) = reference::table("pensim_2_default.csv") else {
        return;
    };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let (drawn, out) = (reference::table("pensim_parameters.csv"), folder.join("pensim_2.csv"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_smpl"));
    command.arg("simulate").arg(model("pensim.eq")).args(["--start", "nominal", "--steps", "60", "--rtol", "1e-9"]);
    for option in ["actions", "disturbances"] {
        command.arg(format!("--{option}")).arg(reference::path("pensim_2_default.csv").expect("installed"));
    }
    command.arg("--init").arg(reference::path("pensim_2_init.csv").expect("installed"));
    command.args(["--set", "paa_schedule=minutes"]);
    for name in ["mu_p", "mux_max", "alpha_kla", "N_conc_paa", "PAA_c"] {
        let value = drawn.as_ref().expect("installed").get(1, name);
        command.args(["--set", &format!("{name}={value}")]);
    }
    let done = command.arg("--out").arg(&out).output().expect("the command runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    for name in ["V", "S", "Fpaa", "n9", "reward"] {
        let reference = if name == "reward" { "yield.tight".into() } else { format!("{name}.tight") };
        let values = column(&out, name);
        assert_eq!(values.len(), 61);
        for (row, value) in values.iter().enumerate().skip(1) {
            let (got, expected): (f64, f64) = (value.parse().expect("a number"), table.get(row, &reference));
            assert!((got - expected).abs() <= 1e-6 * expected.abs().max(1.0), "{name}, {row}: {got} {expected}");
        }
    }
    assert_eq!(column(&out, "truncated").last().map(String::as_str), Some("true"));
}

#[test]
fn the_phases_are_named_in_pictures() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let plot = folder.join("plant.svg");
    let mut command = Command::new(env!("CARGO_BIN_EXE_smpl"));
    let done =
        command.arg("simulate").arg(model("mab_plant.eq")).args(["--steps", "2", "--plot"]).arg(&plot).output().expect("the command runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let picture = std::fs::read_to_string(plot).expect("a picture");
    assert!(picture.contains(">idle</text>"), "no band of the phase");
}
