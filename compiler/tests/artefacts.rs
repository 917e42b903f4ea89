//! Artefacts: what comes back, and what is refused.

mod problems;

use std::path::PathBuf;

use smpl_compiler::artefact::{self, ArtefactError, Circumstances, Key};
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::emit;

/// A folder of this test alone, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("smpl-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        Folder(path)
    }

    fn key(&self) -> Result<Key, ArtefactError> {
        Key::at(&self.0.join("smpl/key"))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn model() -> CompiledModel {
    CompiledModel::build(problems::advection_reaction(7), &BackEndSettings { texts: true, ..Default::default() }).expect("it compiles")
}

fn residual(model: &CompiledModel) -> (Vec<f64>, Vec<f64>) {
    let mut m = model.memory();
    model.prepare_parameters(&mut m);
    model.prepare_step(&mut m);
    let y: Vec<f64> = (0..28).map(|i| if i < 21 { 0.5 } else { 350.0 + f64::from(i) }).collect();
    let (mut out, mut values) = (vec![0.0; 28], vec![0.0; model.pattern().nonzeros()]);
    model.residual(&mut m, 0.0, &y, &y, &mut out);
    model.jacobian(&mut m, 0.0, &y, &y, 2.0, &mut values);
    (out, values)
}

#[test]
fn a_model_read_back_gives_the_same_bits() {
    let folder = Folder::new("same");
    let (model, key) = (model(), folder.key().expect("a new key"));
    let print = artefact::fingerprint(&["text"], b"options");
    let bytes = artefact::write(&model, print, &Circumstances::default(), &key).expect("bytes");
    assert_eq!(artefact::header(&bytes, &key).expect("a header").fingerprint, print);
    let again = artefact::read(&bytes, &folder.key().expect("the same key")).expect("a model");
    assert_eq!(residual(&model), residual(&again));
    assert_eq!(model.pattern(), again.pattern());
}

#[test]
fn any_changed_byte_is_refused() {
    let folder = Folder::new("changed");
    let key = folder.key().expect("a new key");
    let bytes = artefact::write(&model(), [0; 32], &Circumstances::default(), &key).expect("bytes");
    for position in (0..bytes.len()).step_by(bytes.len() / 97 + 1) {
        let mut changed = bytes.clone();
        changed[position] ^= 1;
        assert!(artefact::read(&changed, &key).is_err(), "byte {position}");
    }
    assert!(artefact::read(&bytes[..bytes.len() - 1], &key).is_err());
    assert!(matches!(artefact::read(b"MZ", &key), Err(ArtefactError::NotAnArtefact)));
}

#[test]
fn an_artefact_of_another_user_is_refused() {
    let (mine, other) = (Folder::new("mine"), Folder::new("other"));
    let bytes = artefact::write(&model(), [0; 32], &Circumstances::default(), &other.key().expect("a key")).expect("bytes");
    assert!(matches!(artefact::read(&bytes, &mine.key().expect("a key")), Err(ArtefactError::Seal)));
}

#[cfg(unix)]
#[test]
fn a_key_that_others_can_read_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("open");
    folder.key().expect("a new key");
    let path = folder.0.join("smpl/key");
    assert_eq!(std::fs::metadata(&path).expect("a file").permissions().mode() & 0o777, 0o600);
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).expect("a change");
    assert!(matches!(folder.key(), Err(ArtefactError::Key { .. })));
}

#[test]
fn fingerprints_tell_texts_and_options_apart() {
    let all = [
        artefact::fingerprint(&["ab", "c"], b""),
        artefact::fingerprint(&["a", "bc"], b""),
        artefact::fingerprint(&["abc"], b""),
        artefact::fingerprint(&["ab"], b"c"),
    ];
    assert!((1..4).all(|i| !all[..i].contains(&all[i])));
}

#[test]
fn texts_show_equations_as_loops_and_code() {
    let model = model();
    let ir = emit::ir(model.model());
    assert!(ir.contains("for i in 0..6\n  ") && ir.contains("exp(-(E_R / T[i + 1]))") && ir.contains("der(A[i + 1])"), "{ir}");
    let assembly = emit::assembly(&model);
    assert!(emit::clif(&model).contains("f64x2") && assembly.contains("; residual"));
    // Instructions, not bytes: each function ends by one.
    assert_eq!(
        assembly.lines().filter(|line| line.trim() == "retq" || line.trim() == "ret").count(),
        assembly.matches(" bytes\n").count(),
        "{assembly}"
    );
}
