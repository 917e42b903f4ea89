//! The book's table of diagnostics is the registry's, with a link to each example or the reason of its absence.
//!
//! `BLESS=1` writes it into the page.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use smpl_dsl::diagnostic::codes;

const BEGIN: &str = "<!-- codes -->\n";
const END: &str = "<!-- end of codes -->\n";

fn table(examples: &str) -> String {
    codes::ALL.iter().fold(String::from("| code | meaning | example |\n|---|---|---|\n"), |mut table, code| {
        let (id, meaning) = (code.id(), code.explanation().replace('|', "\\|"));
        let section = examples.split("\n## ").find_map(|section| section.strip_prefix(id)).expect("a section of each code");
        let example = match section.split_once("No example: ") {
            Some((_, reason)) => reason.trim().to_owned(),
            None => format!("[texts](diagnostics-examples.md#{})", id.to_lowercase()),
        };
        let _ = writeln!(table, "| `{id}` | {meaning} | {example} |");
        table
    })
}

#[test]
fn the_book_lists_every_diagnostic_code() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let path = docs.join("diagnostics.md");
    let page = fs::read_to_string(&path).expect("the page");
    let table = table(&fs::read_to_string(docs.join("diagnostics-examples.md")).expect("the examples"));
    let (before, rest) = page.split_once(BEGIN).expect("the table's beginning");
    let (found, after) = rest.split_once(END).expect("the table's end");
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, format!("{before}{BEGIN}{table}{END}{after}")).expect("a writable page");
        return;
    }
    assert_eq!(found, table, "run with BLESS=1 to renew docs/diagnostics.md");
}
