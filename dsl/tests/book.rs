//! The book's table of diagnostics is the registry's.
//!
//! `BOOK_BLESS=1` writes it into the page.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use smpl_dsl::diagnostic::codes;

const BEGIN: &str = "<!-- codes -->\n";
const END: &str = "<!-- end of codes -->\n";

fn table() -> String {
    codes::ALL.iter().fold(String::from("| code | meaning |\n|---|---|\n"), |mut table, code| {
        let _ = writeln!(table, "| `{}` | {} |", code.id(), code.explanation().replace('|', "\\|"));
        table
    })
}

#[test]
fn the_book_lists_every_diagnostic_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/diagnostics.md");
    let page = fs::read_to_string(&path).expect("the page");
    let (before, rest) = page.split_once(BEGIN).expect("the table's beginning");
    let (found, after) = rest.split_once(END).expect("the table's end");
    if std::env::var_os("BOOK_BLESS").is_some() {
        fs::write(&path, format!("{before}{BEGIN}{}{END}{after}", table())).expect("a writable page");
        return;
    }
    assert_eq!(found, table(), "run with BOOK_BLESS=1 to renew docs/diagnostics.md");
}
