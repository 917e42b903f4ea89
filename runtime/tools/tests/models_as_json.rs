//! A model written as JSON is read as the same model; a damaged text is an error or a model, never a panic and never without an end.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use proptest::prelude::*;
use serde_json::Value;
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::export::Target;
use smpl_compiler::json::{ReadError, read};
use smpl_runtime::load::{LoadOptions, load};
use smpl_tools::export::export;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn text_of(file: &str) -> String {
    let loaded = load(&root().join(file), &LoadOptions::default()).expect("compiles");
    export(&loaded, Target::Json, None, None).expect("is written").remove(0).text
}

#[test]
fn what_is_read_computes_the_same_bits() {
    for file in ["models/reactor.eq", "models/pensim.eq", "models/atropine.eq", "tests/problems/transistor_amplifier.eq"] {
        let first = load(&root().join(file), &LoadOptions::default()).expect("compiles").model;
        let again = CompiledModel::build(read(&text_of(file)).expect("is read").model, &BackEndSettings::default()).expect("builds");
        // As text: a default that there is not is NaN, which equals nothing.
        assert_eq!(format!("{:?}", again.interface()), format!("{:?}", first.interface()), "{file}");
        assert_eq!(again.pattern().row_indices, first.pattern().row_indices, "{file}");
        let n = first.unknowns();
        let mut state = 1_u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0
        };
        for _ in 0..20 {
            let (y, yp): (Vec<f64>, Vec<f64>) = (0..n).map(|_| (random(), random())).unzip();
            let values = |model: &CompiledModel| {
                let (mut memory, mut f, mut j) = (model.memory(), vec![0.0; n], vec![0.0; model.pattern().row_indices.len()]);
                model.prepare_parameters(&mut memory);
                model.prepare_step(&mut memory);
                model.residual(&mut memory, 0.5, &y, &yp, &mut f);
                model.jacobian(&mut memory, 0.5, &y, &yp, 3.0, &mut j);
                f.into_iter().chain(j).map(f64::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(values(&first), values(&again), "{file}");
        }
    }
}

#[test]
fn models_that_are_read_are_written_as_the_same_bytes() {
    let folders = ["models", "models/gallery", "tests/problems"];
    let files = folders.into_iter().flat_map(|folder| std::fs::read_dir(root().join(folder)).expect("a folder"));
    let mut texts: Vec<PathBuf> = files.map(|file| file.expect("a file").path()).collect();
    texts.retain(|path| path.extension().is_some_and(|ending| ending == "eq"));
    assert!(texts.len() > 40);
    let json = |path: &Path| {
        let loaded = load(path, &LoadOptions::default()).expect("compiles");
        export(&loaded, Target::Json, None, None).expect("is written").remove(0).text
    };
    for path in texts {
        let first = json(&path);
        let copy = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("again.json");
        std::fs::write(&copy, &first).expect("is written");
        assert!(json(&copy) == first, "{}", path.display());
    }
}

/// Content of a place, by number; `None` removes the place.
fn filling(kind: usize, old: &Value) -> Option<Value> {
    Some(match kind {
        0 => return None,
        1 => Value::Null,
        2 => (-1).into(),
        3 => 0.into(),
        4 => 7.into(),
        5 => u32::MAX.into(),
        6 => u64::MAX.into(),
        7 => i64::MIN.into(),
        8 => 1e300.into(),
        9 => 0.5.into(),
        10 => "inf".into(),
        11 => "nan".into(),
        12 => "multiply".into(),
        13 => Value::Array(vec![]),
        14 => Value::Object(serde_json::Map::new()),
        15 => true.into(),
        _ => match old {
            Value::Number(n) => n.as_i64().map_or(2.5.into(), |n| n.wrapping_add(1).into()),
            Value::Array(items) => items.iter().cloned().chain(items.first().cloned()).collect(),
            Value::Bool(b) => (!b).into(),
            _ => "x".into(),
        },
    })
}

/// Changes one place: at each level the child that the next number chooses.
fn damage(value: &mut Value, way: &[usize], kind: usize) {
    let count = match value {
        Value::Array(items) => items.len(),
        Value::Object(fields) => fields.len(),
        _ => 0,
    };
    let Some((&first, rest)) = way.split_first().filter(|_| count > 0) else {
        *value = filling(kind, value).unwrap_or(Value::Null);
        return;
    };
    let at = first % count;
    let last = rest.is_empty() && kind == 0;
    match value {
        Value::Array(items) if last => drop(items.remove(at)),
        Value::Array(items) => damage(&mut items[at], rest, kind),
        Value::Object(fields) => {
            let name = fields.keys().nth(at).cloned().unwrap_or_default();
            match fields.get_mut(&name) {
                Some(_) if last => drop(fields.remove(&name)),
                Some(field) => damage(field, rest, kind),
                None => {}
            }
        }
        _ => {}
    }
}

/// Reads and compiles a text; gives whether it is a model.
fn is_a_model(text: &str) -> bool {
    let begin = Instant::now();
    let settings = BackEndSettings { quick: true, ..BackEndSettings::default() };
    let outcome = read(text).map(|found| CompiledModel::build(found.model, &settings).map(|_| ()));
    assert!(begin.elapsed() < Duration::from_secs(20));
    match outcome {
        Ok(built) => built.is_ok(),
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_place_that_is_changed_gives_an_error_or_a_model(file in 0_usize..4, way in prop::collection::vec(0_usize..100_000, 1..9), kind in 0_usize..17) {
        let mut value: Value = serde_json::from_str(&TEXTS[file]).expect("is JSON");
        damage(&mut value, &way, kind);
        is_a_model(&value.to_string());
    }

    #[test]
    fn a_byte_that_is_changed_gives_an_error_or_a_model(file in 0_usize..4, at in 0_usize..1_000_000, byte in 0_u8..128) {
        let mut bytes = TEXTS[file].clone().into_bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        is_a_model(&String::from_utf8_lossy(&bytes));
        is_a_model(&String::from_utf8_lossy(&bytes[..at]));
    }
}

static TEXTS: std::sync::LazyLock<[String; 4]> = std::sync::LazyLock::new(|| {
    ["models/reactor.eq", "tests/problems/robertson_dae.eq", "tests/problems/van_de_vusse.eq", "tests/problems/orego.eq"].map(text_of)
});

#[test]
fn errors_name_the_place() {
    let value: Value = serde_json::from_str(&text_of("tests/problems/robertson_dae.eq")).expect("is JSON");
    let wording = |change: &dyn Fn(&mut Value)| {
        let mut changed = value.clone();
        change(&mut changed);
        read(&changed.to_string()).err().map(|error| error.to_string()).unwrap_or_default()
    };
    assert!(wording(&|v| v["version"] = 1.into()).starts_with("version 1 of the form; this program reads version 3"));
    assert_eq!(wording(&|v| v["episode"]["step"] = (-1.0).into()), "episode.step: expected a number that is positive and finite, found -1");
    let port = |output: &str, equals: &str| {
        let member = serde_json::json!({"name": "Q", "output": output, "equals": equals});
        Value::Array(vec![serde_json::json!({"name": "R.inlet", "connector": "Stream", "members": [member]})])
    };
    assert_eq!(wording(&|v| v["ports"] = port("nothing", "nothing")), "ports[0].members[0].output: there is no such output");
    assert!(wording(&|v| v["surplus"] = 1.into()).contains("unknown field `surplus`, expected one of `format`, "));
    assert!(wording(&|v| v["expressions"][0] = Value::Array(vec!["cosine".into(), 0.into()])).contains("expressions[0]: unknown kind"));
    let after = |at: usize| Value::Array(vec!["sqrt".into(), at.into()]);
    assert!(wording(&|v| v["expressions"][1] = after(1)).starts_with("expressions[1]: there is no node 1"));
    assert!(wording(&|v| v["equations"][0]["extents"] = Value::Array(vec![2.into()])).contains("equations[0]"));
    assert!(wording(&|v| drop(v["equations"].as_array_mut().map(Vec::pop))).contains("no equation for element 0 of `"));
    assert!(wording(&|v| v["elements"]["states"][0]["unit"] = "kg".into()).starts_with("elements.states[0].unit: the `quantities` state"));
    assert!(wording(&|v| v["explicit"] = (!v["explicit"].as_bool().unwrap_or(true)).into()).starts_with("explicit: "));
    assert!(wording(&|v| v["episode"]["step"] = "long".into()).starts_with("episode.step: invalid type: string \"long\""));
    assert!(wording(&|v| v["equations"][0]["residual"] = 100_000.into()).starts_with("equations[0]: there is no node 100000"));
    assert!(wording(&|v| v["unknowns"][0] = 100_000.into()).starts_with("unknowns[0]: there is no variable 100000"));
    assert!(wording(&|v| v["variables"][0]["role"] = "cache".into()).starts_with("variables[0].role: caches"));
    assert!(matches!(read("{"), Err(ReadError::Syntax(_))));
}

#[test]
fn nodes_inside_one_another_have_a_limit_that_the_compiler_bears() {
    let mut value: Value = serde_json::from_str(&text_of("tests/problems/robertson_dae.eq")).expect("is JSON");
    let mut deep = |levels: usize| {
        let nodes = value["expressions"].as_array_mut().expect("nodes");
        let mut top = nodes.iter().position(|node| node[0] == "load").expect("a load");
        for _ in 0..levels {
            nodes.push(Value::Array(vec!["sin".into(), top.into()]));
            top = nodes.len() - 1;
        }
        value["integrals"] = Value::Array(vec![]);
        let residual = value["equations"][0]["residual"].clone();
        value["expressions"].as_array_mut().expect("nodes").push(Value::Array(vec!["add".into(), residual, top.into()]));
        value["equations"][0]["residual"] = (value["expressions"].as_array().expect("nodes").len() - 1).into();
        value["explicit"] = false.into();
        value.to_string()
    };
    is_a_model(&deep(9_000));
    assert!(read(&deep(11_000)).is_err());
}
