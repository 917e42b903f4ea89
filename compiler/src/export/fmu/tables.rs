//! The tables that the C sources of an FMU read.

use std::fmt::Write as _;

use super::variables::{FmuRole, Source, Variable};
use super::{Parts, TOKEN};
use crate::export::c::{number, quoted, wrapped};
use crate::export::sheet::Array;
use crate::ir::{Builtin, DELAY_SLOTS, Flavour, Role, VarId};
use crate::layout::Layout;
use crate::model::{Lag, RootAction};

/// Functions that a model may lack.
const OPTIONAL: [&str; 11] =
    ["outputs", "observations", "events", "failures", "parameters", "disturb", "start", "end", "partials", "next_break", "before"];

/// Numbers of a delayed element that equations read: value, rate, time.
const PLACED: usize = 3;

/// Header and source.
pub(super) fn print(parts: &Parts<'_>) -> [String; 2] {
    let tables = Tables { parts, layout: Layout::new(&parts.sheet.model, 0) };
    let mut source = Text::default();
    tables.write(&mut source);
    [tables.header(&source), format!("/* The tables of the model. */\n#include \"tables.h\"\n\n{}", source.text)]
}

/// Tables with the numbers of their entries.
#[derive(Default)]
struct Text {
    text: String,
    head: String,
    lengths: Vec<(&'static str, usize)>,
}

impl Text {
    fn table(&mut self, (kind, name, length): (&str, &str, &'static str), entries: &[String]) {
        let n = entries.len().max(1);
        let body = if entries.is_empty() { "{0}".to_owned() } else { format!("{{\n    {}\n}}", entries.join(",\n    ")) };
        let _ = writeln!(self.text, "const {kind} {name}[{n}] = {body};\n");
        let _ = writeln!(self.head, "extern const {kind} {name}[{n}];");
        self.lengths.push((length, entries.len()));
    }

    /// Plain numbers, wrapped.
    fn numbers(&mut self, kind: &str, name: &str, numbers: &[String]) {
        let n = numbers.len().max(1);
        let body = if numbers.is_empty() { "0".to_owned() } else { wrapped(numbers.iter()) };
        let _ = writeln!(self.text, "const {kind} {name}[{n}] = {{{body}}};\n");
        let _ = writeln!(self.head, "extern const {kind} {name}[{n}];");
    }
}

struct Tables<'a> {
    parts: &'a Parts<'a>,
    layout: Layout,
}

fn strings<T: ToString>(numbers: impl IntoIterator<Item = T>) -> Vec<String> {
    numbers.into_iter().map(|n| n.to_string()).collect()
}

impl Tables<'_> {
    fn write(&self, text: &mut Text) {
        let (sheet, parts) = (self.parts.sheet, self.parts);
        self.write_variables(text);
        text.numbers("int", "smpl_order", &strings(parts.order));
        text.numbers("int", "smpl_states", &strings(&parts.variables.states));
        let scale = |e: &crate::export::Element| number(if e.scale.is_finite() && e.scale > 0.0 { e.scale } else { 1.0 });
        let scales: Vec<String> = sheet.families.states.iter().chain(&sheet.families.solved).map(scale).collect();
        text.numbers("double", "smpl_scale", &scales);
        text.numbers("int", "smpl_partial_rows", &strings(&parts.partials.rows));
        text.numbers("int", "smpl_partial_columns", &strings(&parts.partials.columns));
        self.write_context(text);
        self.write_events(text);
        if !sheet.model.delays.is_empty() {
            self.write_delays(text);
        }
    }

    /// Delayed expressions, and the elements of `p` and `c` that hold the earlier values.
    fn write_delays(&self, text: &mut Text) {
        let sheet = self.parts.sheet;
        let (mut entries, mut owners) = (vec![], vec![]);
        for (call, delay) in sheet.model.delays.iter().enumerate() {
            let (varies, most) = (u8::from(delay.lag == Lag::Varying), number(delay.bounds.1));
            entries.push(format!("{{\"{}\", {varies}, {}, {most}}}", quoted(&delay.name), u8::from(delay.before)));
            owners.extend(std::iter::repeat_n(call.to_string(), delay.count as usize));
        }
        text.table(("smpl_delay", "smpl_delay_table", "SMPL_DELAY_CALLS"), &entries);
        text.numbers("int", "smpl_delay_of", &owners);
        let mut slots = vec!["{0, -1}".to_owned(); PLACED * owners.len()];
        for ((var, _, element), (array, at)) in sheet.extras() {
            let (owner, slot) = ((element / DELAY_SLOTS) as usize, (element % DELAY_SLOTS) as usize);
            if sheet.model.vars[var].role == Role::Delayed && slot < PLACED {
                slots[PLACED * owner + slot] = format!("{{{}, {at}}}", u8::from(array == Array::P));
            }
        }
        text.table(("smpl_slot", "smpl_slots", "SMPL_SLOTS"), &slots);
    }

    fn write_variables(&self, text: &mut Text) {
        let (mut entries, mut places) = (vec![], vec![]);
        for variable in &self.parts.variables.list {
            let (first, count) = (places.len(), variable.places.len());
            places.extend(strings(&variable.places));
            entries.push(format!("{{{}, {}, {first}, {count}}}", source(variable.source), role(variable)));
        }
        text.table(("smpl_variable", "smpl_variables", "SMPL_VARIABLES"), &entries);
        text.numbers("int", "smpl_places", &places);
        let movable = |v: &&Variable| v.source == Source::P && matches!(v.kind, FmuRole::Discrete | FmuRole::Input);
        let movables: Vec<String> =
            self.parts.variables.list.iter().filter(movable).flat_map(|v| &v.places).map(ToString::to_string).collect();
        text.table(("int", "smpl_movables", "SMPL_MOVABLES"), &movables);
    }

    /// Elements of `p` and `c` that are updated from instant to instant.
    fn write_context(&self, text: &mut Text) {
        let sheet = self.parts.sheet;
        let (mut copies, mut builtins, mut givens) = (vec![], vec![], vec![]);
        for ((var, flavour, element), (array, at)) in sheet.extras() {
            let in_p = u8::from(array == Array::P);
            let role = sheet.model.vars[var].role;
            match (role, flavour) {
                (Role::Builtin, _) if element == Builtin::Steps as u32 => builtins.push(format!("{{0, {in_p}, {at}}}")),
                (Role::Builtin, _) if element == Builtin::Clock as u32 => builtins.push(format!("{{1, {in_p}, {at}}}")),
                (Role::Builtin, _) if element == Builtin::Begin as u32 => builtins.push(format!("{{2, {in_p}, {at}}}")),
                (Role::ParamGiven, _) => {
                    let parameter = self.parameter_at(element);
                    givens.extend(parameter.map(|parameter| format!("{{{parameter}, {in_p}, {at}}}")));
                }
                (_, Flavour::Initial | Flavour::Previous) => {
                    let instant = u8::from(flavour == Flavour::Previous);
                    let Some((from, place)) = sheet.place_of(var, Flavour::Value, element) else { continue };
                    let from = match from {
                        Array::Y => "SMPL_Y",
                        Array::U => "SMPL_U",
                        _ => "SMPL_P",
                    };
                    copies.push(format!("{{{instant}, {in_p}, {at}, {from}, {place}}}"));
                }
                _ => {}
            }
        }
        text.table(("smpl_copy", "smpl_copies", "SMPL_COPIES"), &copies);
        text.table(("smpl_builtin", "smpl_builtins", "SMPL_BUILTINS"), &builtins);
        text.table(("smpl_given", "smpl_givens", "SMPL_GIVENS"), &givens);
    }

    /// The element of `p` at a place of the region of parameters.
    fn parameter_at(&self, at: u32) -> Option<usize> {
        let of = |(var, element): (VarId, u32)| Some(self.layout.offset(var)? as u32 + element);
        let sheet = self.parts.sheet;
        let is = |place: (VarId, u32)| sheet.model.vars[place.0].role == Role::Param && of(place) == Some(at);
        sheet.parameters.iter().position(|e| e.place.is_some_and(is))
    }

    fn write_events(&self, text: &mut Text) {
        let sheet = self.parts.sheet;
        let mut entries = vec![];
        for root in &sheet.model.roots {
            let (kind, program) = match root.action {
                RootAction::Fail(_) => ("SMPL_FAILS", 0),
                RootAction::Run(program) => ("SMPL_RUNS", program),
                RootAction::Restart => ("SMPL_RESTARTS", 0),
                RootAction::Succeed(_) => ("SMPL_SUCCEEDS", 0),
            };
            entries.push(format!("{{\"{}\", {kind}, {program}, {}}}", quoted(&root.name), u8::from(root.strict)));
        }
        text.table(("smpl_root", "smpl_root_table", "SMPL_ROOTS"), &entries);
        let failures: Vec<String> = sheet.model.interface.finish.failures.iter().map(|f| format!("\"{}\"", quoted(&f.name))).collect();
        text.table(("char *const", "smpl_failure_names", "SMPL_FAILURES"), &failures);
        text.text += "void smpl_run_event(int program, double t, double *y, const double *u, double *p, const double *c)\n{\n";
        text.text += "    (void)t, (void)y, (void)u, (void)p, (void)c;\n    switch (program) {\n";
        for program in 0..sheet.model.programs.events.len() {
            if sheet.function(&format!("event_{program}")).is_some() {
                let _ = writeln!(text.text, "    case {program}: model_event_{program}(t, y, u, p, c); break;");
            }
        }
        text.text += "    default: break;\n    }\n}\n";
        text.head += "void smpl_run_event(int program, double t, double *y, const double *u, double *p, const double *c);\n";
    }

    fn header(&self, source: &Text) -> String {
        let (parts, sheet) = (self.parts, self.parts.sheet);
        let (s, e) = (parts.settings, &sheet.model.interface.episode);
        let shaped = if parts.steady.is_empty() {
            "it shaped the model".to_owned()
        } else {
            format!("it shaped the model, or the steady state that {} of it read", parts.steady.join(", "))
        };
        let flag = |on: bool| u8::from(on).to_string();
        let mut lines: Vec<(String, String)> = [
            ("TOKEN", format!("\"{TOKEN}\"")),
            ("SHAPED_BY", format!("\"{}\"", quoted(&shaped))),
            ("RTOL", number(s.rtol)),
            ("ATOL_FACTOR", number(s.atol_factor)),
            ("MAX_STEP", number(s.max_step)),
            ("MAX_STEPS", s.max_steps.to_string()),
            ("MAX_EVENTS", s.max_events.to_string()),
            ("ALGEBRAIC_ERRORS", flag(s.algebraic_errors)),
            ("STEP", number(e.step)),
            ("PACE", number(e.integrate / e.step)),
            ("SINGLE", flag(e.single_precision)),
            ("IMPLICIT", flag(!sheet.model.explicit)),
            ("TIMED", flag(parts.timed)),
            ("OBSERVATIONS", sheet.function("observations").map_or(0, |f| f.outputs.len()).to_string()),
            ("PARTIALS", parts.partials.rows.len().to_string()),
            ("PARTIAL_ROWS", parts.partials.height.to_string()),
            ("PARTIAL_COLUMNS", parts.partials.width.to_string()),
            ("DELAYS", sheet.model.delayed().to_string()),
            ("DELAYS_VARY", flag(sheet.model.delays.iter().any(|delay| delay.lag == Lag::Varying))),
            ("DELAYS_FOLLOW", flag(sheet.model.delays_follow())),
            ("HISTORY", parts.history.to_string()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
        lines.extend([("L_ROOM", parts.room[0]), ("U_ROOM", parts.room[1])].map(|(name, length)| (name.into(), length.to_string())));
        let rewards = sheet.function("rewards").filter(|f| !super::reads_integral(sheet, f));
        lines.push(("HAS_rewards".into(), flag(rewards.is_some())));
        lines.push(("REWARDS".into(), rewards.map_or(0, |f| f.outputs.len()).to_string()));
        lines.extend(OPTIONAL.map(|name| (format!("HAS_{name}"), flag(sheet.function(name).is_some()))));
        let mut text = "/* What the sources have to know of the model. */\n#ifndef SMPL_TABLES_H\n#define SMPL_TABLES_H\n\n".to_owned();
        text += "#include \"model.h\"\n#include \"types.h\"\n\n#include <math.h>\n\n";
        for (name, value) in &lines {
            let _ = writeln!(text, "#define SMPL_{name} {value}");
        }
        for (name, length) in &source.lengths {
            let _ = writeln!(text, "#define {name} {length}");
        }
        text + "\n" + &source.head + "\n#endif\n"
    }
}

fn source(source: Source) -> &'static str {
    match source {
        Source::Time => "SMPL_TIME",
        Source::Y => "SMPL_Y",
        Source::Z => "SMPL_Z",
        Source::Yp => "SMPL_YP",
        Source::U => "SMPL_U",
        Source::P => "SMPL_P",
        Source::Out => "SMPL_OUT",
        Source::Observed => "SMPL_OBSERVED",
        Source::Event => "SMPL_EVENT",
        Source::Switch => "SMPL_SWITCH",
    }
}

fn role(variable: &Variable) -> &'static str {
    match variable.kind {
        FmuRole::Input => "SMPL_INPUT",
        FmuRole::State if variable.reinit => "SMPL_RESET_STATE",
        FmuRole::State => "SMPL_STATE",
        FmuRole::Discrete => "SMPL_START",
        FmuRole::Parameter | FmuRole::Switch => "SMPL_PARAMETER",
        FmuRole::Shaped => "SMPL_SHAPED",
        _ => "SMPL_CALCULATED",
    }
}
