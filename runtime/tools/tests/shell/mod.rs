//! The command `smpl` from outside.
#![allow(dead_code, reason = "not every file of tests needs everything")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs the command.
pub fn smpl(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_smpl")).args(arguments).output().expect("smpl runs")
}

/// Its exit status.
pub fn status(output: &Output) -> i32 {
    output.status.code().expect("ends by itself")
}

/// Its output.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A file in a new folder.
pub fn file(test: &str, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("smpl-cli-{}-{test}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join(name);
    std::fs::write(&path, content).expect("a file");
    path
}

/// The folder of a file, for those next to it.
pub fn beside(path: &Path, name: &str) -> PathBuf {
    path.with_file_name(name)
}

/// A path as an argument.
pub fn name(path: &Path) -> &str {
    path.to_str().expect("utf-8")
}

/// Columns of a run: for each its number in every row.
pub fn columns(path: &Path, columns: &[&str], more: &[&str]) -> Vec<Vec<f64>> {
    let out = beside(path, "out.csv");
    let output = smpl(&[&["simulate", name(path), "--out", name(&out)], more].concat());
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let table = std::fs::read_to_string(&out).expect("a table");
    let header: Vec<&str> = table.lines().next().expect("a header").split(',').collect();
    let at = |column: &&str| header.iter().position(|c| c == column).unwrap_or_else(|| panic!("no {column} in {header:?}"));
    let cell = |row: &str, at: usize| row.split(',').nth(at).expect("a cell").parse().expect("a number");
    columns.iter().map(at).map(|at| table.lines().skip(1).map(|row| cell(row, at)).collect()).collect()
}

/// A model with parameters of every kind, a disturbance and noise.
pub const COOLER: &str = "model Cooler\ntime t : min\nset side = 1..3\nparam k : 1/min = 0.5 in 0..4\nparam fault[side] = 0 in 0..1\n\
                      param gain = 1 ~ uniform(0.5, 1.5)\nparam twice = 2*gain\nstate T : K = 10 in 0..100\naction F : K/min = 1 in 0..2\n\
                      disturbance w : K/min = 0 ~ normal(0, 1)\neq d/dt T = F + w - k*gain*twice*T*(1 - fault[1])*(1 - fault[2])*(1 - fault[3])\n\
                      reward r default = -T/1 [K]\nobserve T noise normal(0, 0.1)\nepisode { step = 1 [min], max_steps = 5 }\n";
