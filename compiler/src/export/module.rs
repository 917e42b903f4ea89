//! Common parts of Python modules for CasADi and JAX: tables, signatures, functions.

use std::fmt::Write as _;

use super::arrays::{Arrays, Op};
use super::python::{Body, Library, Lists};
use super::sheet::{Array, Function, Label, Sheet, is_dynamic};
use super::spelling::Spellings;
use super::{Element, ExportError, Nominal, Origin, functions};
use crate::model::Model;

/// The parts of a module.
pub(super) struct Module {
    pub sheet: Sheet,
    pub library: Library,
    spellings: Spellings,
    /// Index lists of all functions.
    pub lists: Lists,
    /// Definitions of the functions.
    pub text: String,
    /// Defined functions.
    pub made: Vec<Made>,
    /// Numbers that the largest function computes.
    pub size: usize,
    /// True if time is the last element of `p`.
    pub timed: bool,
}

/// A function of a module.
pub(super) struct Made {
    pub name: String,
    pub arguments: Vec<&'static str>,
    pub update: bool,
    /// The numbers of the output.
    pub outputs: Vec<Label>,
}

impl Module {
    /// The functions of a model in Python.
    pub(super) fn new(model: &Model, nominal: &Nominal<'_>, (library, spellings): (Library, Spellings)) -> Result<Module, ExportError> {
        let mut sheet = functions::sheet(model, nominal)?;
        let mut list = sheet.functions.clone();
        if library == Library::Casadi {
            list.extend(single_rewards(&mut sheet));
        }
        let timed = library == Library::Casadi && list.iter().any(|f| sheet.uses_time(f));
        let mut module = Module { sheet, library, spellings, lists: Lists::default(), text: String::new(), made: vec![], size: 0, timed };
        for function in &list {
            module.define(function)?;
        }
        Ok(module)
    }

    fn define(&mut self, function: &Function) -> Result<(), ExportError> {
        let arrays = Arrays::new(&mut self.sheet, function)?;
        self.size = self.size.max(arrays.size());
        let arguments = self.arguments(function);
        let _ = writeln!(self.text, "\ndef _{}({}):", function.name, arguments.join(", "));
        let _ = writeln!(self.text, "    \"\"\"{}.\"\"\"", docstring(&capital(&function.text)));
        self.text += &self.prologue(function, &arrays, &arguments)?;
        let length = (!function.update).then_some(function.outputs.len());
        self.text += &Body::new((self.library, self.spellings), &arrays, &mut self.lists).print(length);
        let states = self.sheet.states();
        let result = if function.update { format!("y[:{states}], y[{states}:], p") } else { "out".to_owned() };
        let _ = writeln!(self.text, "    return {result}\n");
        self.made.push(Made { name: function.name.clone(), arguments, update: function.update, outputs: function.outputs.clone() });
        Ok(())
    }

    /// The arguments of a function: time (JAX), rates, states, algebraic variables, actions,
    /// parameters, context.
    fn arguments(&self, function: &Function) -> Vec<&'static str> {
        let explicit = self.sheet.model.explicit;
        let rates = function.name == "residual" || !explicit && self.sheet.uses(function, Array::Yp);
        let context = !is_dynamic(&function.name) && self.sheet.uses(function, Array::C);
        let mut list = if self.library == Library::Jax { vec!["t"] } else { vec![] };
        list.extend(rates.then_some("dx"));
        list.extend(["x", "z", "u", "p"]);
        list.extend(context.then_some("c"));
        list
    }

    /// The vectors that a body reads, from the arguments.
    fn prologue(&self, function: &Function, arrays: &Arrays, arguments: &[&str]) -> Result<String, ExportError> {
        let mut text = String::new();
        let (mut y, mut yp, mut t) = (function.update, false, false);
        let states = self.sheet.states();
        for value in &arrays.values {
            match &value.op {
                Op::Time => t = true,
                Op::Load { array: Array::Y, .. } => y = true,
                Op::Load { array: Array::Yp, positions, .. } => {
                    yp = true;
                    if positions.iter().any(|&at| at as usize >= states) {
                        return Err(ExportError::AlgebraicDerivative { function: function.name.clone() });
                    }
                }
                _ => {}
            }
        }
        if t && self.library == Library::Casadi {
            let _ = writeln!(text, "    t = p[{}]", self.sheet.parameters.len());
        }
        if y {
            text += "    y = _join([x, z])\n";
        }
        if yp && arguments.contains(&"dx") {
            text += "    yp = dx\n";
        } else if yp {
            let same = if self.library == Library::Jax { "t, x, z, u, p" } else { "x, z, u, p" };
            let _ = writeln!(text, "    yp = _rates({same})");
        }
        if self.library == Library::Jax && function.update {
            text += "    p = jnp.asarray(p)\n";
        }
        Ok(text)
    }

    /// The head of the module: what it is, and tables of names.
    pub(super) fn head(&self, origin: &Origin<'_>, about: &str, imports: &str) -> String {
        let i = &self.sheet.model.interface;
        let made_for = if origin.made_for.is_empty() { String::new() } else { format!(", for {}", origin.made_for) };
        let mut text = format!("\"\"\"{}\n\n", docstring(&format!("{}: {}.", i.name, i.text.trim_end_matches('.'))));
        let _ = writeln!(text, "Written by smpl {}{}.\n\n{about}\"\"\"\n", env!("CARGO_PKG_VERSION"), docstring(&made_for));
        let _ = writeln!(text, "{imports}\ninf, nan = float(\"inf\"), float(\"nan\")\n");
        let _ = writeln!(text, "NAME = {}\nTIME = ({}, {})", string(&i.name), string(&i.time.name), string(&i.time.unit));
        let _ = writeln!(text, "STEP = {:?}\nEXPLICIT = {}\n", i.episode.step, if self.sheet.model.explicit { "True" } else { "False" });
        text += "# Elements of the vectors: name, unit, lower and upper bound, magnitude, nominal value.\n";
        let f = &self.sheet.families;
        for (name, elements) in [
            ("STATES", &f.states),
            ("ALGEBRAIC", &f.solved),
            ("ACTIONS", &f.actions),
            ("PARAMETERS", &self.sheet.parameters),
            ("CONTEXT", &self.sheet.context),
            ("OUTPUTS", &f.outputs),
        ] {
            let time = (name == "PARAMETERS" && self.timed).then(|| {
                let (name, unit) = (string(&i.time.name), string(&i.time.unit));
                format!("    ({name}, {unit}, -inf, inf, 1.0, 0.0),\n")
            });
            let rows: String = elements.iter().map(row).chain(time).collect();
            let _ = writeln!(text, "{name} = [\n{rows}]");
        }
        let fixed: Vec<String> = self.sheet.parameters.iter().filter(|e| e.structural).map(|e| string(&e.name)).collect();
        let _ = writeln!(text, "\n# Parameters that shaped the model: they have their nominal values.\nFIXED = [{}]", fixed.join(", "));
        text + &self.labels("NAMES", "Names", |label| &label.name) + &self.labels("UNITS", "Units", |label| &label.unit)
    }

    /// A table of what the functions give, by their names.
    fn labels(&self, table: &str, what: &str, of: impl Fn(&Label) -> &String) -> String {
        let mut text = format!("\n# {what} of the numbers that functions give.\n{table} = {{\n");
        for made in self.made.iter().filter(|m| !m.outputs.is_empty() && !m.name.starts_with("reward_")) {
            let items: Vec<String> = made.outputs.iter().map(|label| string(of(label))).collect();
            let _ = writeln!(text, "    {}: [{}],", string(&made.name), items.join(", "));
        }
        text + "}\n"
    }
}

/// The rewards one by one, each with what it needs alone.
fn single_rewards(sheet: &mut Sheet) -> Vec<Function> {
    let Some(all) = sheet.function("rewards").cloned() else { return vec![] };
    let mut list = vec![];
    for (number, label) in (0..).zip(&all.outputs) {
        let nests = all.nests.iter().flat_map(|nest| functions::cut(&mut sheet.model.exprs, nest, &(number..number + 1))).collect();
        let (name, text) = (format!("reward_{number}"), format!("the reward {}", label.name));
        list.push(Function { name, text, nests, update: false, outputs: vec![label.clone()] });
    }
    list
}

fn row(e: &Element) -> String {
    let numbers = [e.low, e.high, e.scale, e.nominal].map(|x| if x.is_nan() { "nan".to_owned() } else { format!("{x:?}") });
    format!("    ({}, {}, {}),\n", string(&e.name), string(&e.unit), numbers.join(", "))
}

/// A Python string.
pub(super) fn string(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}

/// Text inside of a docstring.
fn docstring(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "'")
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
