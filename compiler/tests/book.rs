//! The book's table of built-in functions is the compiler's.
//!
//! `BLESS=1` writes it into the page.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use smpl_compiler::elaborate::{BUILTINS, Builtin};

const BEGIN: &str = "<!-- functions -->\n";
const END: &str = "<!-- end of functions -->\n";

/// Functions with the same meaning share a row.
fn table() -> String {
    let rows = BUILTINS.chunk_by(|a, b| a.meaning == b.meaning);
    rows.fold(String::from("| function | meaning |\n|---|---|\n"), |mut table, row: &[Builtin]| {
        let usages: Vec<String> = row.iter().map(|b| format!("`{}`", b.usage)).collect();
        let _ = writeln!(table, "| {} | {} |", usages.join(", "), row[0].meaning);
        table
    })
}

#[test]
fn the_book_lists_every_built_in_function() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/language.md");
    let page = fs::read_to_string(&path).expect("the page");
    let (before, rest) = page.split_once(BEGIN).expect("the table's beginning");
    let (found, after) = rest.split_once(END).expect("the table's end");
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, format!("{before}{BEGIN}{}{END}{after}", table())).expect("a writable page");
        return;
    }
    assert_eq!(found, table(), "run with BLESS=1 to renew docs/language.md");
}
