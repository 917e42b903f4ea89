//! Options of a scenario and a call for the front end.

use smpl_compiler::elaborate::{Given, GivenData, Options, Setting};
use smpl_dsl::diagnostic::{Diagnostic, SourceMap, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Ident, Statement, StatementKind, TimeTableKind};

use super::LoadOptions;
use super::layers::Layers;
use crate::scenario::{Disturbances, Recorded, Scenario, Value, shortened};

/// Options of scenario and call for the front end; later ones override earlier ones.
pub(super) fn compile_options(
    sources: &mut SourceMap,
    scenario: &Scenario,
    layers: Layers<'_>,
    options: &LoadOptions,
) -> Result<Options, Vec<Diagnostic>> {
    let mut out = Options { observation: options.observation.clone().or_else(|| scenario.observation.clone()), ..Options::default() };
    out.reward = options.reward.clone().or_else(|| scenario.reward.clone());
    out.max_steps = scenario.max_steps;
    for variant in scenario.variants.iter().chain(&options.variants) {
        out.variants.push((variant.name.clone(), variant.option.clone().unwrap_or_else(|| "true".into())));
    }
    for (name, cells) in &scenario.grid {
        out.settings.insert(name.clone(), Setting::Number(f64::from(*cells)));
    }
    for (name, (layer, value)) in layers.names() {
        out.settings.insert(name.to_owned(), setting(name, value)?);
        out.layers.insert(name.to_owned(), layer);
    }
    for (name, value) in &scenario.initial {
        match value.number() {
            Some(number) => {
                out.initial.insert(name.clone(), number);
            }
            None => out.overlay.push(distribution(sources, scenario, name, value).map_err(|d| vec![*d])?),
        }
    }
    if let Some(Disturbances::Values(values)) = &scenario.disturbances {
        for (name, recorded) in values {
            let place = scenario.place_under(sources, "disturbances", name);
            out.measured.extend(given(recorded, place).map_err(|fault| vec![*fault])?.map(|given| (name.clone(), given)));
        }
    }
    out.lints = options.lints;
    out.tests.clone_from(&options.tests);
    Ok(out)
}

/// Data of a disturbance that may follow a file; `None` for one value a step.
fn given(recorded: &Recorded, place: Span) -> Result<Option<Given>, Box<Diagnostic>> {
    let (path, reading, outside) = match recorded {
        Recorded::Constant(x) => return Ok(Some(Given { data: GivenData::Constant(*x), kind: None, outside: None })),
        Recorded::Sequence { .. } => return Ok(None),
        Recorded::File { path, reading, outside } => (path, reading, outside),
    };
    let kind = match reading.as_deref() {
        None => None,
        Some("step") => Some(TimeTableKind::From),
        Some("linear") => Some(TimeTableKind::Linear),
        Some("cubic") => Some(TimeTableKind::Cubic),
        Some(other) => {
            let message = format!("unknown reading `{}` of `{path}`", shortened(other));
            let fault = Diagnostic::error(codes::BAD_SCENARIO, message, place);
            return Err(Box::new(fault.help("it is one of step, linear, cubic")));
        }
    };
    let outside = outside.as_ref().map(|word| Ident { text: word.clone(), span: place });
    Ok(Some(Given { data: GivenData::File(path.clone(), place), kind, outside }))
}

fn setting(name: &str, value: &Value) -> Result<Setting, Vec<Diagnostic>> {
    if let Some(number) = value.numbers().iter().find(|x| !x.is_finite()) {
        let message = format!("`{name}` takes a finite number, not `{number}`");
        return Err(vec![Diagnostic::error(codes::BAD_SCENARIO, message, Span::default()).asked(name)]);
    }
    Ok(match value {
        Value::Number(number) => Setting::Number(*number),
        Value::List(list) => Setting::List(list.clone()),
        Value::Flag(_) | Value::Text(_) => Setting::Text(value.to_string()),
    })
}

/// A distribution of a scenario is one expression of the language, inside a generated statement.
fn distribution(sources: &mut SourceMap, scenario: &Scenario, name: &str, value: &Value) -> Result<Statement, Box<Diagnostic>> {
    let text = format!("initial {name} ~ {value}");
    let file = sources.add("initial of the scenario", text.clone());
    let parsed = smpl_dsl::parse(&text, file);
    let alone = |kind: &StatementKind| matches!(kind, StatementKind::Initial { clip: None, binders, .. } if binders.is_empty());
    let fault = parsed.diagnostics.shown().into_iter().find(Diagnostic::is_error).map(|d| d.message);
    match (fault, <[Statement; 1]>::try_from(parsed.file.statements)) {
        (None, Ok([statement])) if alone(&statement.kind) && !text.contains(['\n', '{', '#']) => Ok(statement),
        (fault, _) => {
            let why = fault.map(|fault| format!(": {fault}")).unwrap_or_default();
            let message = format!("the initial value of `{name}` must be a number or one expression such as `uniform(0.5, 1)`{why}");
            Err(Box::new(Diagnostic::error(codes::BAD_SCENARIO, message, scenario.place_under(sources, "initial", name))))
        }
    }
}
