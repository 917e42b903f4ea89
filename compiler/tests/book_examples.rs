//! The book's examples of diagnostics: for every code that a text can give, one that does, and one that is right.
//!
//! `BOOK_BLESS=1` writes the page anew, with what its examples give.

use std::fs;
use std::path::Path;

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::{Code, Diagnostic, SourceMap, codes};

/// Codes of what is no model's text, or of no single fault of it.
const NO_TEXT: [Code; 5] = [codes::MORE_FAULTS, codes::BACK_END, codes::UNREADABLE, codes::BAD_SCENARIO, codes::BAD_DATA];

/// The examples of one code.
struct Example {
    id: String,
    wrong: String,
    right: String,
}

impl Example {
    /// A section of the page: code, meaning, wrong text, what is said of it, right text.
    fn read(section: &str) -> Example {
        let id = section.lines().next().expect("a heading").to_owned();
        let mut blocks = section.split("```eq\n").skip(1).map(|rest| rest.split("```").next().unwrap_or_default().to_owned());
        Example { id, wrong: blocks.next().expect("a wrong text"), right: blocks.next().expect("a right text") }
    }

    fn written(&self) -> String {
        let code = Code::find(&self.id).expect("a code of the registry");
        let found = faults(&self.wrong, code);
        assert!(found.iter().all(|fault| fault.code == code), "{}: the wrong text gives {found:?}", self.id);
        let [fault] = found.as_slice() else { panic!("{}: the wrong text gives {} diagnostics", self.id, found.len()) };
        let right = faults(&self.right, code);
        assert!(right.is_empty(), "{}: the right text gives {right:?}", self.id);
        let (meaning, told) = (code.explanation(), told(&self.wrong, fault));
        format!("## {}\n\n{meaning}\n\n```eq\n{}```\n\n```text\n{told}```\n\n```eq\n{}```\n", self.id, self.wrong, self.right)
    }
}

/// What is said of a text; that it has no `episode` is of interest where the example is one of that.
fn faults(text: &str, code: Code) -> Vec<Diagnostic> {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", text);
    let options = Options { lints: true, ..Options::default() };
    let found = match flatten(&mut sources, main, &mut |_: &str| None, &options) {
        Ok((_, warnings)) => warnings,
        Err(faults) => faults,
    };
    found.into_iter().filter(|fault| fault.code == code || fault.code != codes::NO_EPISODE).collect()
}

fn told(text: &str, fault: &Diagnostic) -> String {
    let mut sources = SourceMap::new();
    sources.add("model.eq", text);
    let at = sources.locate(fault.primary.span);
    let help = fault.help.as_ref().map_or(String::new(), |help| format!("help: {help}\n"));
    format!("{}:{} {}\n{help}", at.line, at.column, fault.message)
}

#[test]
fn every_code_of_a_text_has_a_wrong_and_a_right_example() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/diagnostics-examples.md");
    let page = fs::read_to_string(&path).expect("the page");
    let (intro, rest) = page.split_once("\n## ").expect("sections");
    let examples: Vec<Example> = rest.split("\n## ").map(Example::read).collect();
    let ids: Vec<&str> = examples.iter().map(|example| example.id.as_str()).collect();
    let wanted: Vec<&str> = codes::ALL.iter().filter(|code| !NO_TEXT.contains(code)).map(|code| code.id()).collect();
    assert_eq!(ids, wanted, "an example for each code, in their order");
    let written: Vec<String> = examples.iter().map(Example::written).collect();
    let written = format!("{intro}\n{}", written.join("\n"));
    if std::env::var_os("BOOK_BLESS").is_some() {
        fs::write(&path, written).expect("a writable page");
        return;
    }
    assert_eq!(page, written, "run with BOOK_BLESS=1 to renew docs/diagnostics-examples.md");
}
