//! Inactive parts are checked too: variants that are off, options that are not chosen.

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::SourceMap;

/// Codes, marked texts and notes of the warnings about what is not in force.
fn told(text: &str) -> Vec<(String, String, String)> {
    let mut sources = SourceMap::new();
    let main = sources.add("m.eq", format!("model M\ntime t : s\nepisode {{ step = 1 [s], max_steps = 2 }}\n{text}"));
    let options = Options { lints: true, ..Options::default() };
    let (_, warnings) = flatten(&mut sources, main, &mut |_| None, &options).expect("what is in force has no fault");
    let told = warnings.iter().filter(|d| d.code.to_string().starts_with('E'));
    told.map(|d| (d.code.to_string(), sources.text(d.primary.span).to_owned(), d.notes.concat())).collect()
}

const DECAY: &str = "choice law = linear | square | cubic\nstate x = 1 in 0..2\neq d/dt x = -x / 1 [s]\nobserve x\n";

#[test]
fn an_unknown_name_in_a_variant_that_is_off_is_told() {
    let found = told(&format!("{DECAY}variant fast {{ eq d/dt x = -10*y / 1 [s] }}\nvariant faster {{ eq d/dt x = -20*x / 1 [s] }}"));
    assert_eq!(found.len(), 1, "{found:?}");
    let (code, text, note) = &found[0];
    assert_eq!((code.as_str(), text.as_str()), ("E0201-unknown-name", "y"));
    assert!(note.contains("`fast`"), "{note}");
}

#[test]
fn a_wrong_unit_in_an_option_that_is_not_chosen_is_told() {
    let found = told(&format!("{DECAY}when law = cubic {{ eq d/dt x = -x^3 / 1 [m] }}\nwhen law = square {{ eq d/dt x = -x^2 / 1 [s] }}"));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].0.starts_with("E0302") && found[0].2.contains("`law = cubic`"), "{found:?}");
}

#[test]
fn a_fault_two_levels_deep_is_told_once_with_all_that_it_takes() {
    let found = told(&format!("{DECAY}variant fast {{ param k = 2\n  when law = square {{ eq d/dt x = -k*nothing*x^2 / 1 [s] }} }}"));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].1 == "nothing" && found[0].2.contains("`fast`, `law = square`"), "{found:?}");
}

#[test]
fn components_that_a_choice_may_give_are_checked() {
    let found = told(
        "component Ideal { def f(x) = x }\ncomponent Wrong { def g(x) = x }\ncomponent Heavy { def f(x) = x*1 [m] }\n\
         choice law = Ideal | Wrong | Heavy\n\
         component Flash(model = Ideal) { state T = 3 in 0..5; eq d/dt T = -f(T) / 1 [s] }\n\
         use Flash as one(model = law)\nobserve one.T\n",
    );
    let [heavy, wrong] = &found[..] else { panic!("{found:?}") };
    assert!(heavy.0.starts_with("E0302") && heavy.2.contains("`law = Heavy`"), "{heavy:?}");
    assert!(wrong.0.starts_with("E0206") && wrong.1 == "law" && wrong.2.contains("`law = Wrong`"), "{wrong:?}");
}

#[test]
fn what_another_variant_declares_is_no_unknown_name() {
    let found = told(&format!("{DECAY}variant with_k {{ param k = 2 }}\nvariant uses_k {{ eq d/dt x = -k*x / 1 [s] }}"));
    assert_eq!(found, []);
}

#[test]
fn what_is_right_is_not_told_and_the_model_is_the_same() {
    let text = format!("{DECAY}variant fast {{ eq d/dt x = -10*x / 1 [s] }}\nwhen law = square {{ eq d/dt x = -x^2 / 1 [s] }}");
    assert_eq!(told(&text), []);
}

#[test]
fn of_a_great_many_variants_the_last_are_not_checked_and_that_is_told() {
    let variants = |factor| (0..4000).map(|i| format!("variant v{i} {{ eq d/dt x = -{i}*{factor} / 1 [s] }}\n")).collect::<String>();
    let codes = |text: String| told(&format!("{DECAY}{text}")).into_iter().map(|(code, ..)| code).collect::<Vec<_>>();
    assert_eq!(codes(variants("x")), ["E0105-too-large"]);
    assert!(codes(variants("1 [m]")).contains(&"E0105-too-large".to_owned()));
    // So many faults are not reported one by one.
    assert!(codes(variants("y")).len() > 10);
}
