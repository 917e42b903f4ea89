//! Answers about valid and half-written texts. Expected values were read off the texts by hand.

use std::path::Path;

use smpl_analysis::check::{Checked, check};
use smpl_analysis::complete::{Completion, complete};
use smpl_analysis::hover::hover;
use smpl_analysis::program::Program;
use smpl_analysis::rename::{Edit, applied, rename};
use smpl_analysis::texts::{Memory, Texts};
use smpl_analysis::{actions, hints, scenario, signature};
use smpl_compiler::elaborate::notes::Observer;
use smpl_dsl::span::FileId;

const TANK: &str = include_str!("tank.eq");

const PLANT: &str = "\
model Plant
use \"units.eq\"
time t : min
set species = { acid, base }
param V_big : L = 2
use Stirred as R1(V = 3 [L])
use Stirred as R2(V = V_big)
connect R1.outlet -> R2.inlet
eq R1.inlet.Q = 1 [L/min]
eq R1.inlet.c[i] = 1 [mol/L] for i in species
observe R1.c[acid]
";

const UNITS: &str = "\
connector Stream { Q : L/min, c[species] : mol/L }
component Stirred \"well mixed\" {
  param V : L \"volume\"
  port inlet, outlet : Stream
  state c[species] : mol/L = 0
  eq d/dt c[i] = inlet.Q / V * (inlet.c[i] - c[i]) for i in species
  eq outlet.Q = inlet.Q
  eq outlet.c[i] = c[i] for i in species
}
";

const SCENARIO: &str = "parameters:\n  R1.V: 4\n  V_big: 5\ninitial: {\"R1.c[acid]\": 1}\n";

fn plant() -> Memory {
    Memory::of([("plant.eq", PLANT), ("units.eq", UNITS), ("plant.low.yaml", SCENARIO)])
}

fn program(texts: &Memory, path: &str) -> Program {
    Program::new(Path::new(path), texts).expect("a text of that name")
}

fn checked(program: &Program, texts: &Memory) -> Checked {
    check(program, texts, &Observer::default(), &|_| Vec::new()).expect("nothing cancels it")
}

/// The text without its mark `‸`, and where the mark was.
fn cursor(marked: &str) -> (String, usize) {
    let at = marked.find('‸').expect("a cursor");
    (marked.replacen('‸', "", 1), at)
}

fn completed(marked: &str) -> Completion {
    let (text, at) = cursor(marked);
    let texts = Memory::of([("plant.eq", text.as_str()), ("units.eq", UNITS), ("lib/more.eq", "")]);
    let program = program(&texts, "plant.eq");
    let facts = checked(&program, &texts).facts;
    complete(&program, &facts, &texts, FileId(0), at)
}

fn labels(marked: &str) -> Vec<String> {
    completed(marked).proposals.into_iter().map(|proposal| proposal.label).collect()
}

fn hovered(text: &str, at: usize) -> String {
    let texts = Memory::of([("plant.eq", text), ("units.eq", UNITS)]);
    let program = program(&texts, "plant.eq");
    let facts = checked(&program, &texts).facts;
    hover(&program, &facts, FileId(0), at).map(|hover| hover.markdown).unwrap_or_default()
}

#[test]
fn shipped_forms_of_the_test_models_are_valid() {
    for (texts, path) in [(plant(), "plant.eq"), (Memory::of([("tank.eq", TANK)]), "tank.eq")] {
        let program = program(&texts, path);
        let found = checked(&program, &texts);
        assert!(found.valid, "{:?}", found.diagnostics);
    }
}

#[test]
fn hover_shows_declaration_dimension_value_equation_and_uses() {
    let at = TANK.find("h : m").expect("the state");
    let text = hovered(TANK, at);
    for part in [
        "state h : m",
        "length [m]",
        "initial value 1 m",
        "bounds 0 .. 2",
        "level 😀²",
        r"\frac{\mathrm{d} h}",
        "determined by line 10",
        "used in 1 equation",
    ] {
        assert!(text.contains(part), "{part:?} is missing in {text}");
    }
}

#[test]
fn hover_shows_the_derived_unit_of_a_named_expression() {
    let text = hovered(TANK, TANK.find("out ").expect("the let"));
    assert!(text.contains("m^3/min"), "{text}");
}

#[test]
fn hover_explains_units_functions_keywords_and_codes() {
    assert!(hovered(TANK, TANK.find("m^2.5").expect("a unit")).contains("metre"));
    assert!(hovered(TANK, TANK.find("sqrt").expect("a function")).contains("square root"));
    assert!(hovered(TANK, TANK.find("observe").expect("a keyword")).contains("lists what the agent observes"));
    let text = format!("{TANK}# see E0302\n");
    assert!(hovered(&text, text.len() - 3).contains("two quantities of different dimensions"));
}

#[test]
fn hover_answers_in_a_statement_that_is_half_written() {
    let text = TANK.replace("(q - out) / A", "(q - out) / A * (k +");
    let at = text.find("(k +").expect("the place") + 1;
    assert!(hovered(&text, at).contains("valve constant"));
}

#[test]
fn a_line_begins_with_statement_keywords_as_snippets() {
    let found = completed("time t : min\nst‸");
    let state = found.proposals.iter().find(|p| p.label == "state").expect("a keyword");
    assert!(state.snippet && state.insert.starts_with("state ${1:x} : "));
    assert_eq!(found.replaces, 13..15);
}

#[test]
fn names_are_offered_with_unit_and_description() {
    let found = completed(&TANK.replace("(q - out) / A", "(q - ‸"));
    let level = found.proposals.iter().find(|p| p.label == "h").expect("the state");
    assert_eq!(level.detail, "[m] level 😀²");
    assert!(found.proposals.iter().any(|p| p.label == "sqrt" && p.insert == "sqrt($1)"));
}

#[test]
fn members_follow_a_point() {
    let list = labels(&PLANT.replace("observe R1.c[acid]", "observe R1.‸"));
    assert_eq!(list, ["V", "c", "inlet", "outlet"]);
    assert_eq!(labels(&PLANT.replace("observe R1.c[acid]", "observe R1.outlet.‸")), ["Q", "c"]);
}

#[test]
fn members_of_the_set_are_offered_in_an_index() {
    assert_eq!(labels(&PLANT.replace("observe R1.c[acid]", "observe R1.c[‸")), ["acid", "base"]);
}

#[test]
fn units_come_after_a_colon_and_in_brackets_with_commensurable_ones_first() {
    assert!(labels("param x : ‸").contains(&"kg/m^3".to_owned()));
    let list = labels(&PLANT.replace("V = 3 [L]", "V = 3 [‸"));
    assert_eq!(list[0], "L");
    let place = |unit: &str| list.iter().position(|label| label == unit).expect("a unit");
    assert!(place("mL") < place("kg") && place("m^3") < place("s"), "{list:?}");
}

#[test]
fn places_that_need_a_certain_kind_offer_that_kind_alone() {
    assert_eq!(labels("component Stirred { }\nuse ‸"), ["Stirred"]);
    assert_eq!(labels(&format!("{PLANT}use Stirred as R3(‸")), ["V"]);
    assert_eq!(labels(&format!("{PLANT}eq R1.inlet.Q = 1 [L/min] for i in ‸")), ["species"]);
    assert_eq!(labels("choice mode = fast | slow\nwhen mode = ‸"), ["fast", "slow"]);
    assert_eq!(labels("event full when true\nat ‸"), ["end", "full", "start"]);
    assert!(labels("episode { ‸").contains(&"max_steps".to_owned()));
    assert!(labels("solver { method = ‸").contains(&"rosenbrock".to_owned()));
    assert_eq!(labels("domain z in 0..1 cells 5 scheme ‸")[0], "central");
    assert_eq!(labels("use \"‸"), ["lib/more.eq", "units.eq"]);
}

#[test]
fn nothing_is_offered_in_comments_texts_and_new_names() {
    for marked in ["# a ‸", "param x = 1 \"text ‸", "param ‸", "state a = 1, ‸"] {
        assert_eq!(labels(marked), Vec::<String>::new(), "{marked}");
    }
}

#[test]
fn scenario_keys_are_completed_and_described() {
    let texts = plant();
    let program = program(&texts, "plant.eq");
    let facts = checked(&program, &texts).facts;
    let list = scenario::complete(&program, &facts, "parameters:\n  ", 14).proposals;
    assert_eq!(list.iter().map(|p| p.label.as_str()).collect::<Vec<_>>(), ["V_big"]);
    let at = SCENARIO.find("R1.V").expect("a key") + 3;
    assert!(scenario::hover(&program, &facts, SCENARIO, at).is_some_and(|hover| hover.markdown.contains("volume")));
}

#[test]
fn the_active_argument_of_a_call_is_shown() {
    let text = TANK.replace("(q - out) / A", "clip(q, low(h), ");
    let at = text.find("clip(q, low(h), ").expect("the call") + 16;
    let texts = Memory::of([("tank.eq", text.as_str())]);
    let program = program(&texts, "tank.eq");
    let found = signature::signature(&program, FileId(0), at).expect("a call");
    assert_eq!((found.label.as_str(), found.active), ("clip(x, low, high)", 2));
}

fn hint_labels(texts: &Memory, path: &str) -> Vec<String> {
    let program = program(texts, path);
    let facts = checked(&program, texts).facts;
    hints::hints(&program, &facts, FileId(0)).into_iter().map(|hint| hint.label).collect()
}

#[test]
fn hints_show_units_values_and_ranges() {
    let text = format!("{TANK}param twice : m^2 = 2*A\ndomain z in 0..1 cells 4\nlet x[z] = z\nvar y[z]\neq y[z] = 1 for z\n");
    let texts = Memory::of([("tank.eq", text.as_str())]);
    let list = hint_labels(&texts, "tank.eq");
    for wanted in [" : m^3/min", " = 1", " in 1..4"] {
        assert!(list.contains(&wanted.to_owned()), "{wanted:?} is missing in {list:?}");
    }
}

/// The texts after renaming what is named at a place.
fn renamed(texts: &Memory, path: &str, name: &str, nth: usize, new: &str) -> Result<Memory, String> {
    let program = program(texts, path);
    let text = texts.text(Path::new(path)).expect("a text");
    let at = text.match_indices(name).nth(nth).expect("the name").0;
    let symbol = program.occurrence_at(FileId(0), at).expect("a symbol").symbol;
    let edits = rename(&program, symbol, new, texts)?;
    let texts = texts.texts.iter().map(|(path, text)| {
        let of_file: Vec<&Edit> = edits.iter().filter(|edit| edit.path == *path).collect();
        (path.clone(), applied(text, of_file).into())
    });
    Ok(Memory { texts: texts.collect() })
}

fn text_of(texts: &Memory, path: &str) -> String {
    texts.text(Path::new(path)).expect("a text").as_ref().to_owned()
}

#[test]
fn a_member_of_a_component_is_renamed_in_imports_arguments_and_scenarios() {
    let after = renamed(&plant(), "units.eq", "V : L", 0, "holdup").expect("no reason against it");
    assert!(text_of(&after, "units.eq").contains("param holdup : L") && text_of(&after, "units.eq").contains("inlet.Q / holdup *"));
    assert!(text_of(&after, "plant.eq").contains("R1(holdup = 3 [L])") && text_of(&after, "plant.eq").contains("R2(holdup = V_big)"));
    assert!(text_of(&after, "plant.low.yaml").contains("R1.holdup: 4"));
    assert!(checked(&program(&after, "plant.eq"), &after).valid);
}

#[test]
fn connector_members_set_members_instances_and_ports_are_renamed_everywhere() {
    for (path, name, nth, new, parts) in [
        ("units.eq", "Q : L", 0, "flow", ["outlet.flow = inlet.flow", "eq R1.inlet.flow = 1"]),
        ("plant.eq", "acid", 0, "HCl", ["species = { HCl, base }", "observe R1.c[HCl]"]),
        ("plant.eq", "R1", 0, "first", ["as first(V", "connect first.outlet -> R2.inlet"]),
        ("units.eq", "outlet", 0, "exit", ["port inlet, exit", "connect R1.exit -> R2.inlet"]),
        ("plant.eq", "species", 0, "kinds", ["set kinds =", "state c[kinds]"]),
    ] {
        let after = renamed(&plant(), path, name, nth, new).expect("no reason against it");
        let all: String = after.texts.values().map(|text| text.as_ref()).collect();
        parts.iter().for_each(|part| assert!(all.contains(part), "{part:?} is missing in {all}"));
        assert!(checked(&program(&after, "plant.eq"), &after).valid, "{all}");
    }
}

#[test]
fn an_index_is_renamed_in_its_statement_alone() {
    let program = program(&plant(), "units.eq");
    let at = UNITS.find("for i").expect("an index") + 4;
    let symbol = program.occurrence_at(FileId(0), at).expect("a symbol").symbol;
    let edits = rename(&program, symbol, "k", &plant()).expect("no reason against it");
    let text = applied(UNITS, edits.iter());
    assert!(text.contains("d/dt c[k] = inlet.Q / V * (inlet.c[k] - c[k]) for k in species"));
    assert!(text.contains("outlet.c[i] = c[i] for i in species"));
}

#[test]
fn a_rename_that_changes_a_meaning_is_refused_with_the_reason() {
    for (new, reason) in [
        ("q", "already has a meaning on line"),
        ("1k", "is not a name"),
        ("for", "is a word of the language"),
        ("exp", "is a built-in name"),
        ("h", "is the present name"),
    ] {
        let found = renamed(&Memory::of([("tank.eq", TANK)]), "tank.eq", "h : m", 0, new).err().unwrap_or_default();
        assert!(found.contains(reason), "{new}: {found}");
    }
    // Inside of the component the name would be that of its parameter.
    let found = renamed(&plant(), "plant.eq", "V_big", 0, "V");
    assert!(found.is_ok());
    let text = UNITS.replace("inlet.Q / V", "inlet.Q / V * V_big / V_big");
    let texts = Memory::of([("plant.eq", PLANT), ("units.eq", text.as_str())]);
    assert!(renamed(&texts, "plant.eq", "V_big", 0, "V").is_err());
}

/// A fix for the first error of a text; the text after it.
fn fixed(text: &str, title: &str) -> String {
    let texts = Memory::of([("tank.eq", text)]);
    let program = program(&texts, "tank.eq");
    let found = checked(&program, &texts).diagnostics;
    let first = found.iter().find(|d| d.is_error()).or(found.first()).expect("a diagnostic");
    let fixes = actions::fixes(&program, &found, first, &texts, &Observer::default());
    let titles: Vec<&str> = fixes.iter().map(|fix| fix.title.as_str()).collect();
    let fix = fixes.iter().find(|fix| fix.title == title);
    let fix = fix.unwrap_or_else(|| panic!("{title:?} is not offered for {first:?}, but {titles:?}"));
    applied(text, [&fix.edit])
}

/// Ten mistakes of beginners with the edit that is offered; each removes its diagnostic, which `fixes` has tried.
#[test]
fn mistakes_of_beginners_are_offered_an_edit() {
    let rest = "eq d/dt h = (q - out) / A\n";
    for (text, title, part) in [
        (TANK.replace("(q - out)", "(q - outt)"), "Replace by `out`", "(q - out)"),
        (TANK.replace("param  k", "parma  k"), "Replace by `param`", "param  k"),
        (TANK.replace("out) / A", "outflow) / A"), "Declare `outflow` as a parameter", "param outflow = 1\neq"),
        (TANK.replace(" / A", " × 1 / A"), "Replace by `*`", " * 1 / A"),
        (TANK.replace("(h - 1 [m])", "(h - 1)"), "Add the unit [m]", "(h - 1 [m])"),
        (TANK.replace(rest, "eq d/dt h == (q - out) / A\n"), "Replace by `=`", "d/dt h = (q"),
        (TANK.replace("\"level 😀²\"", "\"level 😀²"), "Add the closing quote", "\"level 😀²\""),
        (TANK.replace("sqrt(h)", "sqrt(h"), "Add `)`", "sqrt(h)"),
        (TANK.replace("m^2.5/min", "m^2.5/minute"), "Replace by `min`", "m^2.5/min "),
        (format!("{TANK}set s = {{ a, b }}\nvar y[s]\neq y[i] = 1\n"), "Add `for i in s`", "eq y[i] = 1 for i in s"),
    ] {
        let after = fixed(&text, title);
        assert!(after.contains(part), "{part:?} is missing in {after}");
    }
}

#[test]
fn declared_units_are_proposed_explained_and_renamed() {
    let text = "unit USD \"dollar\"\nunit kUSD = 1000 [USD]\nparam p : kUSD = 1\n";
    let at = text.rfind("USD").expect("the last unit");
    let shown = hovered(text, at);
    assert!(shown.contains("unit kUSD = 1000 [USD]") && shown.contains("USD [kUSD]"), "{shown}");
    assert!(labels("unit USD\nparam p : kU‸SD = 1\n").contains(&"USD".to_owned()));
    let texts = Memory::of([("m.eq", text)]);
    let program = program(&texts, "m.eq");
    let id = program.occurrence_at(FileId(0), at).expect("a symbol").symbol;
    assert_eq!(rename(&program, id, "tUSD", &texts).map(|edits| edits.len()), Ok(2));
    assert!(rename(&program, id, "kmol", &texts).is_err());
}

#[test]
fn statements_of_tests_are_proposed_and_resolved() {
    let proposals = labels(&format!("{PLANT}test \"a\" {{\n  start nominal\n  ‸\n}}\n"));
    assert!(["steps", "expect", "V_big"].iter().all(|word| proposals.contains(&(*word).to_owned())), "{proposals:?}");
    let text = format!("{TANK}test \"a\" {{ h = 1; expect h > 0 [m] }}\n");
    let at = text.rfind("h > 0").expect("the state");
    assert!(hovered(&text, at).contains("state h : m"));
}

#[test]
fn clauses_of_controllers_and_members_of_arrays_of_ports_are_offered() {
    let found = labels("discrete u = 0\nstate y = 0\ncontrol u from y ‸");
    assert!(["setpoint", "gain", "reset", "limits", "manual", "every"].iter().all(|word| found.contains(&(*word).to_owned())), "{found:?}");
    let text = "set links = { a, b }\nconnector Heat { T : K, flow Q : W }\ncomponent Hub { port n[j in links] : Heat ; eq n[j].‸ = 1 }\nuse Hub as h\n";
    let found = labels(text);
    assert!(found.contains(&"T".to_owned()) && found.contains(&"Q".to_owned()), "{found:?}");
    let texts = Memory::of([(
        "m.eq",
        "discrete u = 0\nstate y = 0\ncontrol u from y setpoint 1 gain 2 every 3 [s]\nat every 3 [s] { next u = y }\n",
    )]);
    let renamed = renamed(&texts, "m.eq", "y", 1, "height").expect("renamed");
    assert_eq!(text_of(&renamed, "m.eq").matches("height").count(), 3);
}
