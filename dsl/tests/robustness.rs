//! No text makes the parser or the formatter panic, overflow the stack or take more than linear time.

mod common;

use std::time::{Duration, Instant};

use proptest::prelude::*;
use smpl_dsl::diagnostic::{JsonDiagnostic, SourceMap};
use smpl_dsl::format::format;
use smpl_dsl::parse;
use smpl_dsl::span::FileId;

/// Soon: no slow or busy machine takes that long over a megabyte, and what grows with its square takes longer.
const SOON: Duration = Duration::from_secs(60);

/// Parses, and looks at every place that a diagnostic names.
fn survive(text: &str) -> usize {
    let parsed = parse(text, FileId(0));
    let mut sources = SourceMap::new();
    sources.add("text.eq", text);
    for fault in &parsed.diagnostics {
        let json = JsonDiagnostic::new(fault, &sources);
        assert!(json.line >= 1 && json.end_line >= json.line && !json.message.is_empty());
        assert!(fault.primary.span.end as usize <= text.len());
        assert!(text.is_char_boundary(fault.primary.span.start as usize) && text.is_char_boundary(fault.primary.span.end as usize));
    }
    parsed.diagnostics.len()
}

fn timed(text: &str) -> Duration {
    let start = Instant::now();
    survive(text);
    start.elapsed()
}

#[test]
fn a_megabyte_of_anything_parses_soon() {
    let model = &common::models()[0].1;
    let units = [
        "(",
        "[",
        "{",
        "a + ",
        "eq x = (\n",
        "if ",
        "# c\n",
        "\"",
        "x[",
        "let a = 1 +\n# c\n",
        "- ",
        "a.",
        "^x",
        "table t[a] = {\n",
        "}\n",
        "1..",
        "variant a {\n",
        "steady { a = 1\n",
        "param a = 1, ",
        "sum(x for i in s, ",
        "f(",
        "é",
        "}",
        "; ",
        "x = 1; ",
        "\\",
        "\"\" ",
    ];
    for unit in units {
        let text = unit.repeat((1 << 20) / unit.len());
        let time = timed(&text);
        assert!(time < SOON, "{unit:?}: {time:?}");
        let behind = format!("let x = {text}");
        let time = timed(&behind);
        assert!(time < SOON, "let x = {unit:?}: {time:?}");
    }
    let time = timed(&model.repeat((1 << 20) / model.len()));
    assert!(time < SOON, "models: {time:?}");
}

#[test]
fn nesting_beyond_reason_is_refused() {
    for (open, close) in [("(", ")"), ("f(", ")"), ("x[", "]"), ("-(", ")"), ("if a then ", " else b"), ("(if a then b else ", ")")] {
        let text = format!("let a = {}x{}", open.repeat(5000), close.repeat(5000));
        let fault = &parse(&text, FileId(0)).diagnostics[0];
        assert_eq!(fault.code.id(), "E0105-too-large", "{open}");
        let fine = format!("let a = {}x{}", open.repeat(90), close.repeat(90));
        assert!(parse(&fine, FileId(0)).is_ok(), "{open}: {:?}", parse(&fine, FileId(0)).diagnostics);
    }
    for chain in ["- ", "x ^ ", "not ", "x + ", "if a then b else "] {
        let text = format!("let a = {}x", chain.repeat(100_000));
        assert_eq!(parse(&text, FileId(0)).diagnostics[0].code.id(), "E0105-too-large", "{chain}");
    }
    let blocks = format!("{}{}", "variant a {\n".repeat(1000), "}\n".repeat(1000));
    assert_eq!(parse(&blocks, FileId(0)).diagnostics[0].code.id(), "E0105-too-large");
}

#[test]
fn the_deepest_trees_fit_a_megabyte_of_stack() {
    let parenthesised = format!("let a = {}x{}", "(".repeat(195), ")".repeat(195));
    let calls = format!("let a = {}x{}", "f(1 + x[".repeat(95), "])".repeat(95));
    let sum = format!("let a = x{}", " + x".repeat(900));
    let conditions = format!("let a = {}x", "(if a then b else ".repeat(95)) + &")".repeat(95);
    let texts = [parenthesised, calls, sum, conditions];
    let all = move || texts.iter().all(|text| parse(text, FileId(0)).is_ok() && format(text).is_ok());
    let thread = std::thread::Builder::new().stack_size(1 << 20).spawn(all).expect("a thread");
    assert!(thread.join().expect("no overflow"));
}

#[test]
fn files_beyond_the_limit_are_refused() {
    let text = " ".repeat((16 << 20) + 1);
    assert_eq!(parse(&text, FileId(0)).diagnostics[0].code.id(), "E0105-too-large");
}

/// A text with a few characters deleted, doubled or replaced.
fn mutated() -> impl Strategy<Value = String> {
    let edits = proptest::collection::vec((any::<proptest::sample::Index>(), 0..3_u8, "[ -~\n\u{e9}]"), 1..6);
    (proptest::sample::select(common::corpus()), edits).prop_map(|(text, edits)| {
        let mut characters: Vec<char> = text.chars().collect();
        for (index, kind, replacement) in edits {
            if characters.is_empty() {
                break;
            }
            let at = index.index(characters.len());
            let new = replacement.chars().next().unwrap_or(' ');
            match kind {
                0 => drop(characters.remove(at)),
                1 => characters.insert(at, new),
                _ => characters[at] = new,
            }
        }
        characters.into_iter().collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]
    #[test]
    fn arbitrary_texts_never_panic(text in "\\PC*") {
        survive(&text);
    }

    #[test]
    fn texts_of_the_language_s_characters_never_panic(text in "(let |eq |table |steady |at |[a-e0-3(){}\\[\\].,:;=+*/^<>~|\"#\n \\-]){0,80}") {
        survive(&text);
    }

    #[test]
    fn mutated_models_never_panic_and_format_idempotently(text in mutated()) {
        survive(&text);
        if let Ok(once) = format(&text) {
            prop_assert_eq!(format(&once), Ok(once));
        }
    }
}
