//! Pictures: what is in them, that it can be read, and that it is true.

use std::path::PathBuf;
use std::sync::Arc;

use proptest::prelude::*;
use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{self, LoadOptions};
use smpl_runtime::setup::Setup;
use smpl_runtime::trajectory::{Cell, ColumnType, Recorder, Table};
use smpl_tools::picture::drawing::Frame;
use smpl_tools::picture::items::Role;
use smpl_tools::picture::{Follower, Format, Heading, Picture, Run, heading, items, plan, split_names};

fn setup_of_text(text: &str) -> Arc<Setup> {
    let loaded = load::load_text(&PathBuf::from("test.eq"), text.to_owned(), &LoadOptions::default());
    let loaded = loaded.unwrap_or_else(|error| panic!("{error}"));
    Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("ready")
}

fn setup_of_model(name: &str) -> Arc<Setup> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models").join(name).with_extension("eq");
    let loaded = load::load(&path, &LoadOptions::default()).expect("a model that is shipped");
    Setup::new(loaded.model, loaded.options, Some(loaded.sources)).expect("ready")
}

/// A run with nominal actions, followed within steps, and what `show` asks for of it.
fn run_of(setup: &Arc<Setup>, steps: u32, show: &str) -> (Run, Picture) {
    let plans = plan(&items::of_model(setup), &split_names(show)).expect("names there are");
    let mut environment = Environment::new(Arc::clone(setup)).expect("an environment");
    environment.set_keep_going(true);
    environment.reset(Some(1), &ResetOptions::default()).expect("a start");
    let mut recorder = Recorder::new(&environment);
    recorder.record(&mut environment, None);
    let mut follower = Follower::new(setup, &plans, steps).expect("a follower");
    let action: Vec<f64> = setup.catalogue.actions.elements().iter().map(|e| e.default).collect();
    for _ in 0..steps {
        if let Some(follower) = &mut follower {
            follower.follow(&environment, &action).expect("a step");
        }
        let result = environment.step(&action).expect("a step");
        recorder.record(&mut environment, Some(&result));
    }
    let mut run = Run::of_table("run", recorder.table());
    if let Some(follower) = follower {
        run.refine(follower.finish());
    }
    let picture = Picture::new(&plans, std::slice::from_ref(&run), &heading(setup, "a note".into()), &setup.model().interface().time.unit);
    (run, picture)
}

/// Texts that overlap or exceed the page.
fn faults(picture: &Picture) -> Vec<String> {
    let drawing = picture.drawing();
    let texts: Vec<_> = drawing.texts().map(|text| (text.letters.as_str(), text.frame())).collect();
    let page = Frame { x: 0.0, y: 0.0, width: drawing.width, height: drawing.height };
    let outside = |f: &Frame| f.x < page.x || f.y < page.y || f.right() > page.right() || f.bottom() > page.bottom();
    let mut faults: Vec<String> =
        texts.iter().filter(|(_, f)| outside(f)).map(|(text, f)| format!("`{text}` beyond the page: {f:?}")).collect();
    for (i, (a, first)) in texts.iter().enumerate() {
        for (b, second) in texts[..i].iter().filter(|(_, second)| first.overlaps(second)) {
            faults.push(format!("`{a}` over `{b}`: {first:?}, {second:?}"));
        }
    }
    faults
}

fn texts_of_svg(svg: &str) -> Vec<String> {
    let tree = roxmltree::Document::parse(svg).expect("XML");
    let texts = tree.descendants().filter(|node| node.has_tag_name("text"));
    texts.filter_map(|node| node.text().map(str::to_owned)).collect()
}

fn check(setup: &Arc<Setup>, steps: u32, show: &str) {
    let (_, picture) = run_of(setup, steps, show);
    assert_eq!(faults(&picture), Vec::<String>::new(), "{show}");
    let svg = picture.svg();
    let texts = texts_of_svg(&svg);
    let constants = texts.iter().filter(|text| text.contains(" = ")).cloned().collect::<Vec<_>>().join(" ");
    for name in picture.names() {
        assert!(texts.iter().any(|text| text == name) || constants.contains(name), "`{name}` is not in the picture");
    }
    assert!(picture.names().count() > 0, "{show}: nothing is shown");
    let (_, again) = run_of(setup, steps, show);
    for (_, format) in Format::ENDINGS {
        let (first, second) = (picture.bytes(format).expect("a file"), again.bytes(format).expect("a file"));
        assert!(first == second, "{format:?} differs from one time to the next");
    }
}

#[test]
fn labels_of_the_reactor_and_the_beer_stand_apart_and_every_name_stands_in_the_picture() {
    for name in ["reactor", "beer"] {
        let setup = setup_of_model(name);
        check(&setup, 30, "");
        check(&setup, 30, "all");
        check(&setup, 30, "actions");
    }
}

#[test]
fn labels_of_pensim_and_atropine_stand_apart_and_every_name_stands_in_the_picture() {
    check(&setup_of_model("pensim"), 60, "");
    let atropine = setup_of_model("atropine");
    check(&atropine, 3, "");
    check(&atropine, 3, "R1.c,R2.c[tropine],profile:R3.c[atropine],SEP.c");
}

#[test]
fn labels_of_the_columns_stand_apart_and_every_name_stands_in_the_picture() {
    check(&setup_of_model("mab"), 2, "");
    check(&setup_of_model("mab"), 2, "col.c,col.cp,profile:col.q1,h+T");
    check(&setup_of_model("mab_plant"), 2, "");
}

const ROD: &str = "model M\ntime t : s\nparam L : m = 2\nparam q : 1 = 1.2\ndomain z in 0..L cells 10\ndomain y in 0.002 [m]..0.009 [m] cells 8 stretch q\n\
    state c[z] = 1\nstate b[y] = 0\neq d/dt c[z] = -c[z] / 1 [s] for z\neq d/dt b[y] = value(y) / 1 [s] for y\nobserve c in 0..1\nreward r = 0\n\
    episode { step = 1 [s], max_steps = 3 }";

#[test]
fn a_field_is_drawn_over_the_coordinate_of_its_domain() {
    let setup = setup_of_text(ROD);
    let (_, picture) = run_of(&setup, 3, "c,b,obs.c,profile:b");
    let texts = texts_of_svg(&picture.svg());
    assert_eq!(texts.iter().filter(|text| *text == "z [m]").count(), 2, "{texts:?}");
    assert_eq!(texts.iter().filter(|text| *text == "y [mm]").count(), 2, "{texts:?}");
    for tick in ["0.5", "1.5", "4"] {
        assert!(texts.iter().any(|text| text == tick), "no tick at {tick}: {texts:?}");
    }
    assert_eq!(faults(&picture), Vec::<String>::new());
    // The page shows for the lowest row the centre of the lowest cell of a grid whose cells grow by a fifth.
    let page = String::from_utf8(picture.bytes(Format::Html).expect("a file")).expect("text");
    let shown = page.split("\"y = ").nth(1).and_then(|rest| rest.split(' ').next()).and_then(|x| x.parse::<f64>().ok()).expect("a place");
    let ratio: f64 = 1.2;
    let centre = 0.002 + 0.5 * 0.007 * (ratio - 1.0) / (ratio.powi(8) - 1.0);
    assert!((shown - centre).abs() < 1e-3 * centre, "{shown}, not {centre}");
}

#[test]
fn between_sampling_instants_a_field_is_that_of_the_equations() {
    let setup = setup_of_text(ROD);
    let (_, picture) = run_of(&setup, 3, "c");
    let page = String::from_utf8(picture.bytes(Format::Html).expect("a file")).expect("text");
    let columns = page.split("\"columns\":").nth(1).and_then(|rest| rest.split(',').next()).and_then(|n| n.parse::<u32>().ok());
    assert!(columns.is_some_and(|n| n > 30), "{columns:?} columns of a run of three steps");
}

#[test]
fn where_another_length_was_set_cells_have_numbers() {
    let setup = setup_of_text(ROD);
    let plans = plan(&items::of_model(&setup), &["c".to_owned()]).expect("names there are");
    let (run, _) = run_of(&setup, 3, "c");
    let mut environment = Environment::new(Arc::clone(&setup)).expect("an environment");
    environment.reset(Some(1), &ResetOptions::default()).expect("a start");
    assert!(items::knows_space(&setup, environment.parameters()));
    let parameters = [("L".to_owned(), 3.0)].into();
    environment.reset(Some(1), &ResetOptions { parameters, ..ResetOptions::default() }).expect("a start");
    assert!(!items::knows_space(&setup, environment.parameters()));
    let moved = run.with_moved(true);
    let picture = Picture::new(&plans, &[moved], &heading(&setup, String::new()), "s");
    let texts = texts_of_svg(&picture.svg());
    assert!(texts.iter().any(|text| text == "cell") && !texts.iter().any(|text| text == "z [m]"), "{texts:?}");
}

#[test]
fn a_curve_between_sampling_instants_is_that_of_the_equations() {
    let setup = setup_of_text(
        "model M\nstate x = 1\nlet y : 1 = 2 * x\neq d/dt x = -x / 1 [s]\nreward r = 0\nepisode { step = 1 [s], max_steps = 3 }",
    );
    let (run, _) = run_of(&setup, 3, "x,y");
    for (column, factor) in [("x", 1.0), ("y", 2.0)] {
        let (times, values) = run.curve(column, Role::State);
        assert!(times.len() > 100, "{} points", times.len());
        let worst = times.iter().zip(&values).map(|(t, v)| (v - factor * (-t).exp()).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-6, "{column}: {worst}");
    }
}

#[test]
fn events_are_marked_where_they_happen() {
    // A ball falls from 5 m: it meets the ground at sqrt(2 h / g), and again after twice the time of its rise.
    let setup = setup_of_text(
        "model Ball\nstate h : m = 5\nstate v : m/s = 0\neq d/dt h = v\neq d/dt v = -10 [m/s^2]\n\
         event bounce when h < 0\nat bounce { reset v = -0.5 * v\n reset h = 0 }\nreward r = 0\nepisode { step = 0.7 [s], max_steps = 3 }",
    );
    let (run, picture) = run_of(&setup, 3, "h");
    let times: Vec<f64> = run.events.iter().map(|(t, _)| *t).collect();
    assert!(times.len() >= 2, "{times:?}");
    assert!((times[0] - 1.0).abs() < 1e-6 && (times[1] - 2.0).abs() < 1e-6, "{times:?}");
    assert!(texts_of_svg(&picture.svg()).contains(&"bounce".to_owned()));
    assert_eq!(faults(&picture), Vec::<String>::new());
}

#[test]
fn phases_are_bands_from_where_they_begin() {
    let setup = setup_of_text(
        "model P\nstate x = 0\neq d/dt x = 1 / 1 [s]\nphase fill for 1.5 [s] then drain\nphase drain for 1 [s] then fill\n\
         reward r = 0\nepisode { step = 1 [s], max_steps = 4 }",
    );
    let (run, picture) = run_of(&setup, 4, "x");
    let expected = [(0.0, 0), (1.5, 1), (2.5, 0)];
    assert!(run.phases.len() >= expected.len(), "{:?}", run.phases);
    for ((t, phase), (exact, number)) in run.phases.iter().zip(expected) {
        assert!((t - exact).abs() < 1e-9 && *phase == number, "{:?}", run.phases);
    }
    let texts = texts_of_svg(&picture.svg());
    assert!(texts.contains(&"fill".to_owned()) && texts.contains(&"drain".to_owned()), "{texts:?}");
}

#[test]
fn runs_over_one_another_have_a_legend() {
    let setup = setup_of_model("reactor");
    let (run, _) = run_of(&setup, 5, "T");
    let plans = plan(&items::of_model(&setup), &["T".to_owned(), "q_out".to_owned()]).expect("names there are");
    let named = |label: &str| {
        let mut run = run.clone();
        run.label = label.to_owned();
        run
    };
    let runs = ["first", "second", "a third one"].map(named);
    let picture = Picture::new(&plans, &runs, &heading(&setup, String::new()), "min");
    let texts = texts_of_svg(&picture.svg());
    assert!(runs.iter().all(|run| texts.contains(&run.label)), "{texts:?}");
    assert_eq!(faults(&picture), Vec::<String>::new());
}

#[test]
fn values_that_are_missing_or_beyond_measure_still_make_a_picture() {
    let text = "model M\nstate x = 1\ndiscrete big : 1 = 1e300\nlet gap : 1 = if x > 0.5 then x else x / (x - x)\neq d/dt x = -x / 1 [s]\n\
                at end { next big = -big }\nreward r = 0\nepisode { step = 1 [s], max_steps = 4 }";
    let (_, picture) = run_of(&setup_of_text(text), 4, "x,big,gap,x+big");
    assert_eq!(faults(&picture), Vec::<String>::new());
    for (_, format) in Format::ENDINGS {
        assert!(!picture.bytes(format).expect("a file").is_empty());
    }
}

/// A table of columns with these names; the values of each go from `low` to `low + width`.
fn table_of(columns: &[(String, f64, f64)], end: f64) -> Table {
    const ROWS: usize = 12;
    let names = ["step", "time"].into_iter().chain(columns.iter().map(|(name, ..)| name.as_str()));
    let mut table = Table::new(names.map(|name| (name.to_owned(), ColumnType::Number)).collect());
    for row in 0..ROWS {
        let share = row as f64 / (ROWS - 1) as f64;
        let values = columns.iter().map(|(_, low, width)| low + width * share);
        table.push([row as f64, end * share].into_iter().chain(values).map(Cell::Number));
    }
    table
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

    #[test]
    fn labels_stand_apart_whatever_the_names_and_numbers(
        columns in proptest::collection::vec(("[a-zA-Z_]{1,60}", -1.0..1.0, 0.0..1.0, -9..10_i32, 0..4_i32), 1..30),
        end in 1e-3..1e6,
        runs in 1..12_usize,
        array in 0..12_usize,
    ) {
        let size = |exponent: i32| 10_f64.powi(exponent);
        let scalars = columns.iter().enumerate().map(|(i, (name, low, width, exponent, narrow))| {
            (format!("{name}{i}"), low * size(*exponent), width * size(exponent - narrow))
        });
        let members = (0..array).map(|i| (format!("many[a_rather_long_name_{i}]"), i as f64, 1.0));
        let columns: Vec<(String, f64, f64)> = scalars.chain(members).collect();
        let table = table_of(&columns, end);
        let named = |i: usize| Run::of_table(&format!("run number {i} of those"), &table);
        let runs: Vec<Run> = (0..runs).map(named).collect();
        let plans = plan(&items::of_columns(runs[0].names(), |_| false), &[]).expect("a choice");
        let heading = Heading { title: "A title".into(), ..Heading::default() };
        let picture = Picture::new(&plans, &runs, &heading, "min");
        prop_assert_eq!(faults(&picture), Vec::<String>::new());
    }
}

#[test]
fn the_page_of_html_needs_nothing_else() {
    let (_, picture) = run_of(&setup_of_model("reactor"), 5, "T");
    let page = picture.html();
    let addresses: Vec<&str> = page.split("http").skip(1).map(|rest| rest.split(['"', ' ']).next().unwrap_or_default()).collect();
    assert!(addresses.iter().all(|rest| rest.starts_with("://www.w3.org/2000/svg")), "{addresses:?}");
    assert!(page.contains("<script>") && !page.contains("src="));
}

fn texts_of_model(text: &str, steps: u32, show: &str) -> Vec<String> {
    let (_, picture) = run_of(&setup_of_text(text), steps, show);
    assert_eq!(faults(&picture), Vec::<String>::new());
    texts_of_svg(&picture.svg())
}

fn has(texts: &[String], part: &str) -> bool {
    texts.iter().any(|text| text.contains(part))
}

const EPISODE: &str = "reward r = 0\nepisode { step = 1 [s], max_steps = 5 }\n";

#[test]
fn rows_over_a_set_of_numbers_have_the_name_of_the_set() {
    let model = format!("model M\nset class = 1..9\nstate n[k in class] = k\neq d/dt n[k] = -k*n[k] / 1 [s] for k in class\n{EPISODE}");
    for show in ["", "n"] {
        let texts = texts_of_model(&model, 5, show);
        assert!(texts.iter().any(|text| text == "class") && !has(&texts, "cell"), "{texts:?}");
    }
}

#[test]
fn twenty_instances_share_a_panel_with_one_scale() {
    let model = format!(
        "model M\ncomponent Tank {{ param h_0 = 1\nstate h = h_0\neq d/dt h = -h / 1 [s] }}\nuse Tank as tank[k in 1..20](h_0 = k)\n{EPISODE}"
    );
    let (_, picture) = run_of(&setup_of_text(&model), 5, "");
    let names: Vec<&str> = picture.names().collect();
    assert_eq!(names.iter().filter(|name| name.contains("tank")).collect::<Vec<_>>(), [&"tank[*].h"], "{names:?}");
    let texts = texts_of_svg(&picture.svg());
    assert!(texts.iter().any(|text| text == "tank"), "{texts:?}");
    assert_eq!(faults(&picture), Vec::<String>::new());
}

#[test]
fn a_note_counts_what_has_no_panel_and_what_varies_most_has_one() {
    let state = |name: &str, rate: f64| format!("state {name} = 1\neq d/dt {name} = -{rate} * {name} / 1 [s]\n");
    let slow: String =
        (0..40).map(|i| state(&format!("slow_{}", (b'a' + i % 26) as char).repeat(1 + usize::from(i / 26)), 0.001)).collect();
    let model = format!("model M\n{slow}{}{EPISODE}", state("fast", 1.0));
    let (_, picture) = run_of(&setup_of_text(&model), 5, "");
    let shown = picture.names().count();
    assert!(picture.names().any(|name| name == "fast"), "{:?}", picture.names().collect::<Vec<_>>());
    let texts = texts_of_svg(&picture.svg());
    // 41 states, of which those that are shown share the page with the reward.
    let note = format!("Not shown, name them in --show ({})", 41 - (shown - 1));
    assert!(has(&texts, &note), "`{note}`: {texts:?}");
    assert_eq!(faults(&picture), Vec::<String>::new());
}

#[test]
fn a_field_with_one_value_is_a_line_of_text_and_no_map() {
    let model = format!("model M\ndomain z in 0 [m]..1 [m] cells 12\nstate c[z] : J/kg = 1.9e6\neq d/dt c[z] = 0 [W/kg] for z\n{EPISODE}");
    let texts = texts_of_model(&model, 5, "");
    assert!(has(&texts, "c = 1.9 MJ/kg"), "{texts:?}");
    assert!(!texts.iter().any(|text| text == "z [m]"), "{texts:?}");
}

#[test]
fn units_of_axes_have_prefixes_and_bounds_have_numbers() {
    let model = format!("model M\nstate u : J/kg = 2e6 in 0.3e6..7.3e6\neq d/dt u = (7e6 [J/kg] - u) / 1 [s]\n{EPISODE}");
    let texts = texts_of_model(&model, 5, "u");
    assert!(texts.iter().any(|text| text == "[MJ/kg]"), "{texts:?}");
    assert!(texts.iter().any(|text| text == "7.3"), "{texts:?}");
}

#[test]
fn heading_and_axis_have_one_unit_of_time() {
    let setup =
        setup_of_text("model M\ntime t : s\nstate x = 1\neq d/dt x = -x / 1 [h]\nreward r = 0\nepisode { step = 600 [s], max_steps = 60 }");
    let picture = smpl_tools::picture::nominal(&setup, &[], u32::MAX).expect("an episode");
    let texts = texts_of_svg(&picture.svg());
    assert!(has(&texts, "t = 10 h") && texts.iter().any(|text| text == "time [h]"), "{texts:?}");
}
