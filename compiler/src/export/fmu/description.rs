//! `modelDescription.xml`, `buildDescription.xml`, and the table of all elements.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::Parts;
use super::units;
use super::variables::{FmuRole, Variable};
use crate::export::Origin;

/// Text in XML.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\n' | '\r' | '\t' => out.push(' '),
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out
}

/// The description of the model.
pub(super) fn model(parts: &Parts<'_>, origin: &Origin<'_>, token: &str) -> String {
    let i = &parts.sheet.model.interface;
    let (name, version) = (escaped(&i.name), env!("CARGO_PKG_VERSION"));
    let made_for = if origin.made_for.is_empty() { String::new() } else { format!(", for {}", origin.made_for) };
    let text = escaped(&format!("{}{made_for}", i.text));
    let identifier = parts.identifier;
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        xml,
        "<fmiModelDescription fmiVersion=\"3.0\" modelName=\"{name}\" instantiationToken=\"{token}\" description=\"{text}\" generationTool=\"smpl {version}\" variableNamingConvention=\"flat\">"
    );
    let common = format!(
        "modelIdentifier=\"{identifier}\" canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" providesDirectionalDerivatives=\"true\""
    );
    // The past of delayed expressions is that of the unit's own integrator.
    if parts.sheet.model.delays.is_empty() {
        let _ = writeln!(xml, "  <ModelExchange {common} needsCompletedIntegratorStep=\"true\"/>");
    }
    let _ = writeln!(xml, "  <CoSimulation {common} canHandleVariableCommunicationStepSize=\"true\"/>");
    xml += &unit_definitions(parts);
    xml += "  <LogCategories>\n    <Category name=\"logEvents\" description=\"events and failures of the model\"/>\n    <Category name=\"logStatusError\" description=\"what went wrong\"/>\n  </LogCategories>\n";
    let (step, stop) = (i.episode.step, i.episode.step * f64::from(parts.settings.episode));
    let tolerance = parts.settings.rtol;
    let _ = writeln!(xml, "  <DefaultExperiment startTime=\"0\" stopTime=\"{stop}\" tolerance=\"{tolerance}\" stepSize=\"{step}\"/>");
    xml += "  <ModelVariables>\n";
    for (reference, variable) in parts.variables.list.iter().enumerate() {
        xml += &describe(reference, variable, parts.settings.atol_factor);
    }
    xml += "  </ModelVariables>\n";
    xml += &structure(&parts.variables.list);
    xml + "</fmiModelDescription>\n"
}

fn unit_definitions(parts: &Parts<'_>) -> String {
    let used: BTreeSet<&str> = parts.variables.list.iter().map(|v| v.unit.as_str()).filter(|u| is_unit(u)).collect();
    let mut xml = String::from("  <UnitDefinitions>\n");
    for unit in &used {
        let name = escaped(unit);
        match units::unit(unit).as_ref().and_then(units::si) {
            Some(si) => {
                let exponents = si.exponents.iter().fold(String::new(), |mut text, (base, exponent)| {
                    let _ = write!(text, " {base}=\"{exponent}\"");
                    text
                });
                let offset = if si.offset == 0.0 { String::new() } else { format!(" offset=\"{:?}\"", si.offset) };
                let _ = writeln!(
                    xml,
                    "    <Unit name=\"{name}\">\n      <BaseUnit{exponents} factor=\"{:?}\"{offset}/>\n    </Unit>",
                    si.factor
                );
            }
            None => {
                let _ = writeln!(xml, "    <Unit name=\"{name}\"/>");
            }
        }
    }
    if used.is_empty() { String::new() } else { xml + "  </UnitDefinitions>\n" }
}

/// Numbers have no unit in a description.
fn is_unit(unit: &str) -> bool {
    !unit.is_empty() && unit != "1"
}

/// A bound that holds for all elements: the widest, if all have one and the start values keep it.
fn bound(variable: &Variable, of: impl Fn(&crate::export::Element) -> f64, widest: fn(f64, f64) -> f64) -> Option<f64> {
    let all = variable.elements.iter().map(of).reduce(widest)?;
    let inside = variable.elements.iter().all(|e| !e.nominal.is_finite() || widest(all, e.nominal) == all);
    (all.is_finite() && inside).then_some(all)
}

/// The nominal value of a state times the tolerance is what an importer's integrator takes as
/// absolute tolerance: it is the model's.
fn describe(reference: usize, variable: &Variable, atol_factor: f64) -> String {
    let tag = if variable.kind == FmuRole::Switch { "Boolean" } else { "Float64" };
    let mut xml = format!("    <{tag} name=\"{}\" valueReference=\"{reference}\"", escaped(&variable.name));
    if !variable.text.is_empty() {
        let _ = write!(xml, " description=\"{}\"", escaped(&variable.text));
    }
    xml += match variable.kind {
        FmuRole::Time => " causality=\"independent\" variability=\"continuous\"",
        FmuRole::State => " causality=\"local\" variability=\"continuous\" initial=\"exact\"",
        FmuRole::Rate(_) | FmuRole::Local => " causality=\"local\" variability=\"continuous\" initial=\"calculated\"",
        FmuRole::Input => " causality=\"input\" variability=\"continuous\"",
        FmuRole::Output => " causality=\"output\" variability=\"continuous\" initial=\"calculated\"",
        FmuRole::Discrete => " causality=\"local\" variability=\"discrete\" initial=\"exact\"",
        FmuRole::Parameter | FmuRole::Switch => " causality=\"parameter\" variability=\"tunable\" initial=\"exact\"",
        FmuRole::Shaped => " causality=\"local\" variability=\"constant\" initial=\"exact\"",
    };
    if let FmuRole::Rate(state) = variable.kind {
        let _ = write!(xml, " derivative=\"{state}\"");
    }
    if variable.reinit {
        xml += " reinit=\"true\"";
    }
    if is_unit(&variable.unit) {
        let _ = write!(xml, " unit=\"{}\"", escaped(&variable.unit));
    }
    if !matches!(variable.kind, FmuRole::Rate(_)) {
        if let Some(low) = bound(variable, |e| e.low, f64::min) {
            let _ = write!(xml, " min=\"{low:?}\"");
        }
        if let Some(high) = bound(variable, |e| e.high, f64::max) {
            let _ = write!(xml, " max=\"{high:?}\"");
        }
        let factor = if variable.kind == FmuRole::State { atol_factor } else { 1.0 };
        let scale = factor * variable.elements.iter().map(|e| e.scale).fold(0.0, f64::max);
        if scale.is_finite() && scale > 0.0 {
            let _ = write!(xml, " nominal=\"{scale:?}\"");
        }
    }
    if variable.kind == FmuRole::Switch {
        xml += " start=\"true\"";
    } else if matches!(variable.kind, FmuRole::State | FmuRole::Input | FmuRole::Discrete | FmuRole::Parameter | FmuRole::Shaped) {
        let starts: Vec<String> = variable.elements.iter().map(|e| format!("{:?}", e.nominal)).collect();
        let _ = write!(xml, " start=\"{}\"", starts.join(" "));
    }
    if variable.shape.is_empty() {
        return xml + "/>\n";
    }
    xml += ">\n";
    for length in &variable.shape {
        let _ = writeln!(xml, "      <Dimension start=\"{length}\"/>");
    }
    xml + "    </" + tag + ">\n"
}

/// Dependencies: everything may depend on every known value.
fn structure(list: &[Variable]) -> String {
    let mut xml = String::from("  <ModelStructure>\n");
    let mut tell = |tag: &str, wanted: &dyn Fn(&Variable) -> bool| {
        for (reference, _) in list.iter().enumerate().filter(|(_, v)| wanted(v)) {
            let _ = writeln!(xml, "    <{tag} valueReference=\"{reference}\"/>");
        }
    };
    let is_rate = |v: &Variable| matches!(v.kind, FmuRole::Rate(_));
    tell("Output", &|v| v.kind == FmuRole::Output);
    tell("ContinuousStateDerivative", &is_rate);
    tell("InitialUnknown", &|v| v.kind == FmuRole::Output || is_rate(v));
    tell("EventIndicator", &|v| v.source == super::variables::Source::Event);
    xml + "  </ModelStructure>\n"
}

/// Build instructions of the binary.
pub(super) fn build(parts: &Parts<'_>, sources: &[(String, String)]) -> String {
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiBuildDescription fmiVersion=\"3.0\">\n");
    let _ = writeln!(xml, "  <BuildConfiguration modelIdentifier=\"{}\">\n    <SourceFileSet language=\"C99\">", parts.identifier);
    for (name, _) in sources.iter().filter(|(name, _)| name.ends_with(".c")) {
        let _ = writeln!(xml, "      <SourceFile name=\"{name}\"/>");
    }
    xml + "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
}

/// One line for each number: variable, place in it from 0, name in the model, unit, bounds,
/// magnitude, start value.
pub(super) fn elements(parts: &Parts<'_>) -> String {
    let mut text = String::from("variable,place,name,unit,low,high,scale,start\n");
    let field = |text: &str| {
        let plain = !text.contains([',', '"', '\n']);
        if plain { text.to_owned() } else { format!("\"{}\"", text.replace('"', "\"\"")) }
    };
    let number = |x: f64| if x.is_nan() { String::new() } else { format!("{x:?}") };
    for variable in parts.variables.list.iter().filter(|v| !matches!(v.kind, FmuRole::Rate(_))) {
        for (place, e) in variable.elements.iter().enumerate() {
            let numbers = [e.low, e.high, e.scale, e.nominal].map(number).join(",");
            let _ = writeln!(text, "{},{place},{},{},{numbers}", field(&variable.name), field(&e.name), field(&e.unit));
        }
    }
    text
}
