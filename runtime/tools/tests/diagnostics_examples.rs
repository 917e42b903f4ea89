//! The book's examples of diagnostics: for every code a text that causes it and a correct one, or the reason of their absence.
//!
//! `BLESS=1` writes the page anew, with what its examples give.

mod shell;

use std::fs;
use std::path::Path;

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::{Code, Diagnostic, SourceMap, codes};
use smpl_dsl::span::FileId;
use smpl_runtime::load::start_diagnostics_of_text;
use smpl_tools::lint;

use shell::{beside, file, name, smpl, status, text};

/// Before the reason why a code has no example.
const NONE: &str = "No example: ";

/// A part of a section between fences.
struct Block<'a> {
    language: &'a str,
    content: &'a str,
}

/// Content of a section.
enum Example<'a> {
    /// Texts of models, a wrong one and a right one.
    Texts(&'a str, &'a str),
    /// A model, a wrong file and a right one for it, and what they are written in.
    Files(&'a str, &'a str, &'a str, &'a str),
    /// Reason of the absence of examples.
    Reason(&'a str),
}

fn blocks(section: &str) -> Vec<Block<'_>> {
    let fenced = section.split("```").skip(1).step_by(2);
    fenced.map(|block| block.split_once('\n').expect("a language")).map(|(language, content)| Block { language, content }).collect()
}

impl<'a> Example<'a> {
    fn read(section: &'a str) -> Example<'a> {
        let blocks: Vec<(&str, &str)> = blocks(section).iter().map(|block| (block.language, block.content)).collect();
        match blocks[..] {
            [("eq", wrong), ("text", _), ("eq", right)] => Example::Texts(wrong, right),
            [("eq", model), (kind, wrong), ("text", _), (same, right)] if kind == same => Example::Files(model, kind, wrong, right),
            [] => Example::Reason(section.split_once(NONE).expect("examples, or a reason").1.trim()),
            _ => panic!("a wrong text, its diagnostics, and a right text: {section}"),
        }
    }

    /// A section of the page: code, meaning, wrong text, its diagnostics, right text.
    fn written(&self, code: Code) -> String {
        let head = format!("## {}\n\n{}\n\n", code.id(), code.explanation());
        head + &match *self {
            Example::Texts(wrong, right) => {
                format!("```eq\n{wrong}```\n\n```text\n{}```\n\n```eq\n{right}```\n", of_texts(code, wrong, right))
            }
            Example::Files(model, kind, wrong, right) => {
                let told = of_files(code, model, kind, wrong, right);
                format!("```eq\n{model}```\n\n```{kind}\n{wrong}```\n\n```text\n{told}```\n\n```{kind}\n{right}```\n")
            }
            Example::Reason(reason) => format!("{NONE}{reason}\n"),
        }
    }
}

/// Diagnostics of a wrong text; the right one has none.
fn of_texts(code: Code, wrong: &str, right: &str) -> String {
    let found = faults(wrong, code);
    let fault = match found.as_slice() {
        [fault] => fault,
        [.., last] if code == codes::MORE_FAULTS => last,
        _ => panic!("{}: the wrong text gives {found:?}", code.id()),
    };
    assert_eq!(fault.code, code, "{}", fault.message);
    let right = faults(right, code);
    assert!(right.is_empty(), "{}: the right text gives {right:?}", code.id());
    let mut sources = SourceMap::new();
    sources.add("model.eq", wrong);
    let at = sources.locate(fault.primary.span);
    let help = fault.help.as_ref().map_or(String::new(), |help| format!("help: {help}\n"));
    format!("{}:{} {}\n{help}", at.line, at.column, fault.message)
}

/// Diagnostics of a text; a missing `episode` counts only in its own example.
fn faults(text: &str, code: Code) -> Vec<Diagnostic> {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", text);
    let options = Options { lints: true, ..Options::default() };
    let found = match flatten(&mut sources, main, &mut |_: &str| None, &options) {
        Ok((model, mut warnings)) => {
            let tree = smpl_dsl::parse(text, FileId(0)).file;
            warnings.extend(lint::lints(&tree, &model.interface).into_iter().filter(|lint| lint.code == code));
            warnings.extend(start_diagnostics_of_text(model));
            warnings
        }
        Err(faults) => faults,
    };
    found.into_iter().filter(|fault| fault.code == code || fault.code != codes::NO_EPISODE).collect()
}

/// Diagnostics of a model with a wrong file; with the right one it runs.
fn of_files(code: Code, model: &str, kind: &str, wrong: &str, right: &str) -> String {
    let (given, arguments) = match kind {
        "yaml" => ("model.given.yaml", ["--scenario", "given"]),
        "csv" => ("given.csv", ["--actions", "given.csv"]),
        _ => panic!("no command reads {kind}"),
    };
    let path = file(code.id(), "model.eq", model);
    let run = |content: &str| {
        fs::write(beside(&path, given), content).expect("a file");
        let [option, value] = arguments;
        let value = if option == "--actions" { name(&beside(&path, value)).to_owned() } else { value.to_owned() };
        smpl(&["simulate", name(&path), option, &value, "--steps", "1"])
    };
    let output = run(right);
    assert_eq!(status(&output), 0, "{}: the right file gives {}", code.id(), text(&output.stderr));
    let output = run(wrong);
    let reported = text(&output.stderr);
    assert!(status(&output) == 1 && reported.starts_with(code.id()), "{}: the wrong file gives {reported}", code.id());
    let after = |mark: &str| reported.lines().find_map(|line| line.split_once(mark)).map(|(_, rest)| rest.trim_end_matches(']').to_owned());
    let help = after("help: ").map_or(String::new(), |help| format!("help: {help}\n"));
    format!("{} {}\n{help}", after(&format!("{given}:")).expect("a place"), after("× ").expect("a message"))
}

#[test]
fn every_code_has_a_wrong_and_a_right_example_or_a_reason() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/diagnostics-examples.md");
    let page = fs::read_to_string(&path).expect("the page");
    let (intro, rest) = page.split_once("\n## ").expect("sections");
    let sections: Vec<&str> = rest.split("\n## ").collect();
    let ids: Vec<&str> = sections.iter().filter_map(|section| section.lines().next()).collect();
    let wanted: Vec<&str> = codes::ALL.iter().map(|code| code.id()).collect();
    assert_eq!(ids, wanted, "a section for each code, in their order");
    let written: Vec<String> = sections.iter().zip(codes::ALL).map(|(section, code)| Example::read(section).written(*code)).collect();
    let written = format!("{intro}\n{}", written.join("\n"));
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, written).expect("a writable page");
        return;
    }
    assert_eq!(page, written, "run with BLESS=1 to renew docs/diagnostics-examples.md");
}
