//! Every question is answered, without a panic, for any text: prefixes of models, as they are while one types, and random changes.

#[allow(dead_code, reason = "shared with the fuzzer, which uses all of it")]
#[path = "../../examples/fuzz/mutate.rs"]
mod mutate;

use std::path::Path;

use mutate::{Random, bytewise, changed, nested, spliced, words};
use smpl_analysis::check::{Checked, check};
use smpl_analysis::position::Encoding;
use smpl_analysis::program::Program;
use smpl_analysis::texts::Memory;
use smpl_analysis::{actions, complete, equations, hints, hover, outline, rename, scenario, signature};
use smpl_compiler::elaborate::notes::Observer;
use smpl_dsl::span::FileId;

const MAIN: &str = "model.eq";

const TANK: &str = include_str!("tank.eq");
const REACTOR: &str = include_str!("../../../models/reactor.eq");
const ATROPINE: &str = include_str!("../../../models/atropine.eq");
const PENSIM: &str = include_str!("../../../models/pensim.eq");

/// Asks everything about a place of a text.
fn ask(text: &str, offset: usize, compile: bool) {
    let texts = Memory::of([(MAIN, text), ("model.other.yaml", "parameters: {k: 1}\nvariants: [a=b]\n")]);
    let Some(program) = Program::new(Path::new(MAIN), &texts) else { panic!("the text is there") };
    let file = FileId(0);
    let checked =
        if compile { check(&program, &texts, &Observer::default(), &|_| Vec::new()).unwrap_or_default() } else { Checked::default() };
    let facts = &checked.facts;
    let _ = hover::hover(&program, facts, file, offset);
    let _ = complete::complete(&program, facts, &texts, file, offset);
    let _ = signature::signature(&program, file, offset);
    let _ = hints::hints(&program, facts, file);
    let _ = outline::outline(&program, file);
    let _ = outline::folds(&program, file);
    let _ = outline::selections(&program, file, offset);
    let _ = outline::links(&program, &texts);
    let _ = outline::colours(&program, file);
    let _ = equations::equations(&program);
    let _ = scenario::complete(&program, facts, text, offset);
    let _ = scenario::hover(&program, facts, text, offset);
    let lines = &program.files[0].lines;
    for encoding in [Encoding::Utf8, Encoding::Utf16, Encoding::Utf32] {
        let position = lines.position(text, offset, encoding);
        let _ = lines.offset(text, position, encoding);
    }
    if let Some(found) = program.occurrence_at(file, offset) {
        let _ = rename::rename(&program, found.symbol, "renamed", &texts);
    }
    if compile && let Some(d) = checked.diagnostics.first() {
        let _ = actions::fixes(&program, &checked.diagnostics, d, &texts, &Observer::default());
    }
}

#[test]
fn every_prefix_of_a_small_model_is_answered_and_compiled() {
    for (end, _) in TANK.char_indices() {
        ask(&TANK[..end], end, true);
    }
}

#[test]
fn prefixes_of_larger_models_are_answered() {
    for text in [REACTOR, ATROPINE, PENSIM] {
        let ends: Vec<usize> = text.char_indices().map(|(at, _)| at).collect();
        for end in ends.iter().step_by(ends.len() / 60) {
            ask(&text[..*end], *end, false);
        }
    }
}

#[test]
fn randomly_changed_models_are_answered_at_random_places() {
    let mut random = Random(7);
    let pool = words(ATROPINE);
    for round in 0..200 {
        let text = [TANK, REACTOR, ATROPINE][random.below(3)];
        let list = words(text);
        let text = match random.below(4) {
            0 => changed(&list, &pool, &mut random),
            1 => bytewise(text, &mut random),
            2 => nested(&list, &mut random),
            _ => spliced(text, PENSIM, &mut random),
        };
        let offset = text.floor_char_boundary(random.below(text.len() + 1));
        ask(&text, offset, round % 8 == 0);
    }
}
