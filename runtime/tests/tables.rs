//! Tables: the columns of the contract, what is read back, faults with their lines, files written whole.

mod support;

use std::path::PathBuf;

use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::setup::EnvironmentOptions;
use smpl_runtime::trajectory::{Between, Clock, Recorder, read_actions, read_columns, read_initial};
use support::{beer, environment};

/// Steps of the beer model, whose sampling interval is one hour.
const CLOCK: Clock = Clock { step: 1.0, between: Between::Hold, most: 200 };

fn folder(test: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("smpl-tables-{}-{test}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn make() -> Environment {
    let mut env = environment(beer::model(1.0, 200), EnvironmentOptions::default());
    env.reset(Some(3), &ResetOptions::default()).expect("resets");
    env
}

fn recorded(env: &mut Environment, steps: usize) -> Recorder {
    let mut recorder = Recorder::new(env);
    recorder.record(env, None);
    for _ in 0..steps {
        let result = env.step(&[13.5]).expect("steps");
        recorder.record(env, Some(&result));
    }
    recorder
}

#[test]
fn a_trajectory_has_the_columns_of_the_contract_and_can_be_replayed() {
    let path = folder("columns").join("t.csv");
    let mut env = make();
    recorded(&mut env, 3).table().write(&path).expect("writes");
    let text = std::fs::read_to_string(&path).expect("reads");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "step,time,X_A,X_L,X_D,S,EtOH,DY,EA,biomass,elapsed,biomass_before,T,obs.X_A,obs.X_L,obs.X_D,obs.S,obs.EtOH,obs.DY,obs.EA,\
         obs.elapsed,reward,reward.finish,terminated,truncated"
    );
    assert_eq!(lines.len(), 5);
    let cells: Vec<&str> = lines[1].split(',').collect();
    assert_eq!((cells[0], cells[12], cells[21], cells[23]), ("0", "", "", "false"), "row 0 has neither action nor reward");
    assert_eq!(read_actions(&path, env.catalogue(), CLOCK).expect("reads").sequences, vec![vec![13.5; 3]]);
    let left: Vec<_> = std::fs::read_dir(path.parent().expect("a folder")).expect("lists").collect();
    assert_eq!(left.len(), 1, "no temporary file is left");
}

#[test]
fn a_parquet_file_is_framed_as_such() {
    let path = folder("parquet").join("t.parquet");
    let mut env = make();
    recorded(&mut env, 3).table().write(&path).expect("writes");
    let bytes = std::fs::read(&path).expect("reads");
    assert_eq!((&bytes[..4], &bytes[bytes.len() - 4..]), (b"PAR1".as_slice(), b"PAR1".as_slice()));
}

#[test]
fn a_table_is_the_same_in_parquet_and_in_csv_and_is_replayed_from_either() {
    let folder = folder("both");
    let (csv, parquet) = (folder.join("t.csv"), folder.join("t.parquet"));
    let mut env = make();
    let recorder = recorded(&mut env, 3);
    recorder.table().write(&csv).expect("writes");
    recorder.table().write(&parquet).expect("writes");
    let (first, second) = (read_columns(&csv).expect("reads"), read_columns(&parquet).expect("reads"));
    assert_eq!((&first.names, &first.keys), (&second.names, &second.keys));
    let bits = |values: &[Vec<f64>]| values.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&first.values), bits(&second.values));
    assert_eq!(read_actions(&parquet, env.catalogue(), CLOCK).expect("reads").sequences, vec![vec![13.5; 3]]);
}

#[test]
fn what_is_no_parquet_file_is_refused_by_name() {
    let folder = folder("damaged");
    let path = folder.join("t.parquet");
    let mut env = make();
    recorded(&mut env, 3).table().write(&path).expect("writes");
    let whole = std::fs::read(&path).expect("reads");
    for bytes in [b"step,T\n1,13\n".as_slice(), b"PAR1", &whole[..whole.len() / 2], &whole[whole.len() / 2..], &[]] {
        std::fs::write(&path, bytes).expect("writes");
        let message = read_columns(&path).map(|columns| columns.names).expect_err("no table").to_string();
        assert!(message.contains("t.parquet:1: the file cannot be read as Parquet"), "{message}");
    }
}

#[test]
fn faults_of_data_files_are_named_with_their_lines() {
    let folder = folder("faults");
    let env = make();
    let cases = [
        ("step,T\n1,13\n2,warm\n", ":3: column `T`: `warm` is not a finite number"),
        ("step,T\n1,13\n2\n", ":3: the row has 1 cells, the heading has 2"),
        ("step,T_c\n1,13\n", ":1: missing column T; the file has: step, T_c"),
        ("step;T\n1;13,5\n", ":1: the columns are separated by semicolons; a table has commas between them and points in its numbers"),
        ("T\n", ": no rows"),
        ("T\n13\nNaN\n", ":3: column `T`: `NaN` is not a finite number"),
        ("T,u\n13,1\n,2\n", ":3: column `T`: an empty cell is not a finite number"),
    ];
    for (i, (content, expected)) in cases.iter().enumerate() {
        let path = folder.join(format!("{i}.csv"));
        std::fs::write(&path, content).expect("writes");
        let message = read_actions(&path, env.catalogue(), CLOCK).expect_err("a fault").to_string();
        assert!(message.ends_with(expected), "{message}");
    }
    assert!(read_actions(&folder.join("none.csv"), env.catalogue(), CLOCK).is_err());
}

#[test]
fn initial_values_are_states_and_discrete_variables() {
    let path = folder("initial").join("i.csv");
    let env = make();
    std::fs::write(&path, "X_A,elapsed,S\n0.5,7,\n").expect("writes");
    let initial = read_initial(&path, env.catalogue()).expect("reads");
    assert_eq!((initial.unknowns["X_A"], initial.discretes["elapsed"], initial.unknowns.len()), (0.5, 7.0, 1));
    std::fs::write(&path, "name,unit,value\nX_A,g,0.5\nelapsed,h,7\n").expect("writes");
    assert_eq!(read_initial(&path, env.catalogue()).expect("reads"), initial);
    std::fs::write(&path, "X_B\n0.5\n").expect("writes");
    let message = read_initial(&path, env.catalogue()).expect_err("unknown").to_string();
    assert!(message.contains("unknown state, algebraic or discrete variable `X_B`"), "{message}");
}
