//! Readable texts of a model at the stages of the compiler.

use std::fmt::Write;

use crate::compiled::CompiledModel;
use crate::functions::Function;
use crate::ir::{Affine, ExprId, Place, Program, Target, VarId};
use crate::model::Model;

mod infix;
#[cfg(test)]
pub(crate) mod passes;

use infix::Printer;

/// Names of loop counters by depth.
const COUNTERS: [&str; crate::ir::MAX_DEPTH] = ["i", "j", "k", "l", "m", "n"];

/// The flat model: variables, equations as loops, root functions, quadratures, programs. What
/// occurs several times is named `%n`; where it depends on the counters of sums it is a function of
/// them, `%n(j)`.
#[must_use]
pub fn ir(model: &Model) -> String {
    let mut text = String::new();
    for (id, variable) in model.vars.iter() {
        let (name, role, len) = (&variable.name, variable.role, variable.len);
        let unknown = if model.unknowns.contains(&id) { ", unknown" } else { "" };
        line(&mut text, 0, &format!("{id}: {role:?} {name}[{len}]{unknown}"));
    }
    line(&mut text, 0, "\nequations");
    equations(&mut text, model);
    let mut single = |title: &str, values: Vec<(String, ExprId)>| {
        if !values.is_empty() {
            line(&mut text, 0, &format!("\n{title}"));
        }
        for (name, value) in values {
            nest(&mut text, model, &[], |p| format!("{name} = {}", p.value(value)));
        }
    };
    single("roots", model.roots.iter().map(|r| (r.name.clone(), r.value)).collect());
    single("quadratures", model.quadratures.iter().enumerate().map(|(i, q)| (format!("rate {i}"), *q)).collect());
    for (name, program) in model.programs.named() {
        let name = name.strip_prefix("initial_").map_or(name.clone(), |rest| format!("initial {rest}"));
        print_program(&mut text, model, &name, program);
    }
    text
}

fn equations(text: &mut String, model: &Model) {
    for row in &model.rows {
        let printed = |p: &mut Printer<'_>| format!("0 = {}  # row of {}", p.value(row.residual), element(model, row.var, row.at));
        nest(text, model, &row.extents, printed);
    }
}

fn print_program(text: &mut String, model: &Model, name: &str, program: &Program) {
    if program.nests.is_empty() {
        return;
    }
    line(text, 0, &format!("\n{name}{}", if program.in_place { " (in place)" } else { "" }));
    for n in &program.nests {
        nest(text, model, &n.extents(), |p| {
            let stores = n.stores.iter().map(|s| format!("{} {}", destination(model, s.target), p.value(s.value)));
            stores.collect::<Vec<_>>().join("\n")
        });
    }
}

/// Destination of a value.
fn destination(model: &Model, Target { place, at }: Target) -> String {
    match place {
        Place::Out => format!("out[{}] :=", infix::affine(at)),
        Place::Table { table, plus, add } => {
            format!("out[table{table}[{}] + {}] {}", infix::affine(at), infix::affine(plus), if add { "+=" } else { ":=" })
        }
        Place::Var(var) => format!("{} :=", element(model, var, at)),
    }
}

fn element(model: &Model, var: VarId, at: Affine) -> String {
    format!("{}[{}]", model.vars[var].name, infix::affine(at))
}

/// Loop headers, named common parts, then the lines of `content`.
fn nest(text: &mut String, model: &Model, extents: &[u32], content: impl Fn(&mut Printer<'_>) -> String) {
    for (depth, extent) in extents.iter().enumerate() {
        line(text, depth, &format!("for {} in 0..{extent}", COUNTERS.get(depth).unwrap_or(&"?")));
    }
    let mut printer = Printer::new(model, extents.len());
    let lines = content(&mut printer);
    for part in printer.parts.iter().map(String::as_str).chain(lines.lines()) {
        line(text, extents.len(), part);
    }
}

fn line(text: &mut String, depth: usize, content: &str) {
    // Writing to a string does not fail.
    let _ = writeln!(text, "{:width$}{content}", "", width = 2 * depth);
}

/// Cranelift's intermediate text of all compiled functions; needs `BackEndSettings::texts`.
#[must_use]
pub fn clif(model: &CompiledModel) -> String {
    functions(model, |code| code.clif.clone())
}

/// Assembly of all compiled functions where `BackEndSettings::texts` kept it, else their bytes.
#[must_use]
pub fn assembly(model: &CompiledModel) -> String {
    functions(model, |code| match code.assembly.as_str() {
        "" => code.bytes.chunks(16).map(hexadecimal).collect(),
        text => text.to_owned(),
    })
}

fn functions(model: &CompiledModel, text_of: impl Fn(&crate::generate::Code) -> String) -> String {
    let mut text = String::new();
    for (function, codes) in Function::ALL.iter().zip(&model.parts().codes) {
        for code in codes {
            line(&mut text, 0, &format!("; {}, {} bytes", function.name(), code.bytes.len()));
            line(&mut text, 0, &text_of(code));
        }
    }
    text
}

fn hexadecimal(bytes: &[u8]) -> String {
    let mut text: String = bytes.iter().map(|b| format!("{b:02x} ")).collect();
    text.push('\n');
    text
}
