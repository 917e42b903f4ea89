//! Results of passes for small models, as in `tests/passes/*.md`; `BLESS=1` rewrites the blocks, to
//! be read before they are kept.
//!
//! An `eq` block is a model, each block after it what the pass of its name makes of that model.

use std::fs;
use std::path::Path;

use smpl_dsl::diagnostic::SourceMap;

use super::{differentiate, flatten, planned};
use crate::elaborate::Options;
use crate::emit::passes;
use crate::functions::Function;

/// The text of what a pass makes of a model.
fn made(source: &str, pass: &str) -> String {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", source);
    let options = Options { verify: true, ..Options::default() };
    let flat = flatten(&mut sources, main, &mut |_| None, &options);
    let (mut model, _) = flat.unwrap_or_else(|faults| panic!("{faults:?}\n{source}"));
    match pass {
        "structure" => passes::structure(&model),
        "differentiate" => {
            let rows = differentiate::rows(&mut model).expect("derivatives");
            let entries = differentiate::jacobian(&mut model, &rows);
            passes::entries(&model, &entries)
        }
        "schedule" => {
            let planned = planned(&mut model).expect("a plan");
            let shown = [Function::PrepareStep, Function::Residual, Function::Jacobian];
            let functions = planned.functions.iter().filter(|(function, _)| shown.contains(function));
            let first = passes::staged(&model, "prepare_parameters", &planned.prepare_parameters);
            functions.fold(first, |text, (function, staged)| text + &passes::staged(&model, function.name(), staged))
        }
        other => panic!("no pass is called {other}"),
    }
}

/// A file with its blocks written anew, and their number.
fn renewed(text: &str) -> (String, usize) {
    let (mut out, mut source, mut blocks) = (String::new(), String::new(), 0);
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        out += line;
        out.push('\n');
        let Some(kind) = line.strip_prefix("```") else { continue };
        let body: String = lines.by_ref().take_while(|line| *line != "```").flat_map(|line| [line, "\n"]).collect();
        if kind == "eq" {
            out += &body;
            source = body;
        } else {
            out += &made(&source, kind);
            blocks += 1;
        }
        out += "```\n";
    }
    (out, blocks)
}

#[test]
fn passes_make_what_the_files_say() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/passes");
    for name in ["structure", "differentiate", "schedule"] {
        let path = folder.join(name).with_extension("md");
        let text = fs::read_to_string(&path).expect("a file of cases");
        let (renewed, blocks) = renewed(&text);
        assert!(blocks >= 4, "{name}.md has {blocks} blocks");
        if std::env::var_os("BLESS").is_some() {
            fs::write(&path, renewed).expect("the file can be written");
            continue;
        }
        let differing = renewed.lines().zip(text.lines()).enumerate().find(|(_, (new, old))| new != old);
        if let Some((at, (new, old))) = differing {
            panic!("{name}.md, line {}:\nexpected {old}\nmade     {new}", at + 1);
        }
        assert_eq!(renewed.lines().count(), text.lines().count(), "{name}.md has lines that are not made, or lacks some");
    }
}
