//! The bindings of SUNDIALS that were written before (`runtime/bindgen`) are those of the installed library: a compiler of C says so.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The include folder of SUNDIALS, and its major and minor version.
fn installed() -> Option<(PathBuf, String)> {
    let folders = ["/usr/local/include", "/usr/include"].map(PathBuf::from);
    let folder = folders.into_iter().find(|folder| folder.join("sundials/sundials_config.h").is_file())?;
    let config = std::fs::read_to_string(folder.join("sundials/sundials_config.h")).ok()?;
    let number = |name: &str| Some(config.lines().find(|line| line.contains(name))?.split_whitespace().last()?.to_owned());
    let version = format!("{}.{}", number("define SUNDIALS_VERSION_MAJOR")?, number("define SUNDIALS_VERSION_MINOR")?);
    Some((folder, version))
}

/// Sizes and offsets of the bindings, as in C.
fn assertions(bindings: &str) -> Vec<String> {
    let structure =
        |name: &str| if name.starts_with("_generic") || name.ends_with("_struct") { format!("struct {name}") } else { name.to_owned() };
    let number = |line: &str| Some(line.rsplit_once("- ")?.1.split("usize").next()?.to_owned());
    let assertion = |line: &str| {
        let told = line.trim().strip_prefix("[\"")?.split('"').next()?;
        if told.contains("_IO_") {
            return None;
        }
        let (kind, of) = told.rsplit_once(": ").or_else(|| told.rsplit_once(" of "))?;
        let value = match (kind, of.split_once("::")) {
            ("Offset of field", Some((outer, field))) => format!("offsetof({}, {field})", structure(outer)),
            ("Size", None) => format!("sizeof({})", structure(of)),
            ("Alignment", None) => format!("_Alignof({})", structure(of)),
            _ => return None,
        };
        Some((value, number(line)))
    };
    // An assertion that is too long for a line has its number in the next one.
    let lines: Vec<&str> = bindings.lines().collect();
    let found = lines.iter().enumerate().filter_map(|(i, line)| {
        let (value, known) = assertion(line)?;
        let known = known.or_else(|| lines[i + 1..].iter().take(3).find_map(|next| number(next)))?;
        Some(format!("_Static_assert({value} == {known}, \"{value}\");"))
    });
    found.collect()
}

#[test]
fn sizes_and_places_are_those_of_the_installed_headers() {
    let Some((folder, version)) = installed() else { return eprintln!("skipped: SUNDIALS is not installed") };
    let bindings = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("bindgen/bindings/sundials-{version}.rs"));
    let bindings = std::fs::read_to_string(&bindings).unwrap_or_else(|error| panic!("{}: {error}", bindings.display()));
    let assertions = assertions(&bindings);
    assert!(assertions.len() > 150, "{} assertions", assertions.len());
    let mut text = String::from("#include <stddef.h>\n#include <idas/idas.h>\n#include <sunlinsol/sunlinsol_klu.h>\n");
    for assertion in &assertions {
        let _ = writeln!(text, "{assertion}");
    }
    let place = std::env::temp_dir().join(format!("smpl-bindings-{}", std::process::id()));
    std::fs::create_dir_all(&place).expect("a folder");
    let compiles = |text: &str| {
        std::fs::write(place.join("layout.c"), text).expect("writes");
        let suitesparse = folder.join("suitesparse");
        let mut command = Command::new("cc");
        command.arg("-std=c11").arg("-fsyntax-only").arg("-I").arg(&folder).arg("-I").arg(suitesparse).arg(place.join("layout.c"));
        command.output().expect("a compiler of C")
    };
    let output = compiles(&text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // The compiler does look at them.
    let wrong = format!("{text}_Static_assert(sizeof(struct _generic_N_Vector_Ops) == 1, \"wrong\");\n");
    assert!(!compiles(&wrong).status.success());
    std::fs::remove_dir_all(&place).expect("removes");
}
