//! C99: a header that documents itself and a source without dependencies but `<math.h>`; loops stay
//! loops.

use std::fmt::Write as _;

mod body;
mod index;
mod names;
mod prepare;

use body::Body;
use index::Tables;
pub(super) use index::number;
pub(super) use index::wrapped;
use names::spelling;

use super::jacobian::{Pattern, jacobian};
use super::sheet::{Function, Label, Nest, Sheet, is_dynamic};
use super::{Element, ExportError, Nominal, Origin, functions};
use crate::ir::UnaryFn;
use crate::model::Model;

/// Header and source, the source first.
pub(super) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<Vec<String>, ExportError> {
    let mut sheet = functions::sheet(model, nominal)?;
    let own = identifier(&sheet.model.interface.name);
    let stem = origin.stem.unwrap_or(&own);
    if stem.contains(|c: char| c == '"' || c.is_control()) {
        return Err(ExportError::Header { name: stem.to_owned() });
    }
    let text = write(&mut sheet, origin, stem)?;
    Ok(vec![text.source, text.header])
}

/// The files of a sheet, and the pattern of the Jacobian that they compute.
pub(super) struct Text {
    pub source: String,
    pub header: String,
    pub pattern: Pattern,
}

/// The functions of a sheet, and its Jacobian; names begin with that of the file.
pub(super) fn write(sheet: &mut Sheet, origin: &Origin<'_>, stem: &str) -> Result<Text, ExportError> {
    let prefix = identifier(stem);
    let (derivative, pattern) = jacobian(sheet)?;
    let at = sheet.functions.iter().position(|f| f.name == "residual").map_or(0, |at| at + 1);
    sheet.functions.insert(at, derivative);
    let (prepare, work) = prepare::hoist(sheet)?;
    let file = File { sheet, prefix: &prefix, stem, origin, pattern: &pattern, work };
    let (header, source) = (file.header(), file.source(&prepare)?);
    Ok(Text { source, header, pattern })
}

/// A name as a part of identifiers: small letters, digits, underscores.
pub(super) fn identifier(name: &str) -> String {
    let mut text: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect();
    if !text.starts_with(|c: char| c.is_ascii_alphabetic()) {
        text.insert_str(0, "m_");
    }
    text
}

struct File<'a> {
    sheet: &'a Sheet,
    prefix: &'a str,
    /// Name of the header.
    stem: &'a str,
    origin: &'a Origin<'a>,
    pattern: &'a Pattern,
    /// Length of `w`.
    work: u32,
}

/// A table of elements: name of the array, what they are.
type Table<'a> = (&'static str, &'static str, &'a [Element]);

impl File<'_> {
    fn tables(&self) -> [Table<'_>; 6] {
        let f = &self.sheet.families;
        [
            ("states", "the first elements of y", &f.states),
            ("algebraic", "the other elements of y", &f.solved),
            ("actions", "the elements of u", &f.actions),
            (
                "parameters",
                "the elements of p: parameters, discrete variables, disturbances, what else equations need",
                &self.sheet.parameters,
            ),
            ("context", "the elements of c: what only functions of a whole step need", &self.sheet.context),
            ("outputs", "what the function outputs writes", &f.outputs),
        ]
    }

    /// Functions whose outputs have names other than the elements above.
    fn labelled(&self) -> impl Iterator<Item = &Function> {
        let listed = ["residual", "rates", "algebraic", "jacobian", "outputs", "partials", "next_break"];
        self.sheet.functions.iter().filter(move |f| !f.update && !listed.contains(&f.name.as_str()))
    }

    fn header(&self) -> String {
        let (prefix, upper) = (self.prefix, self.prefix.to_uppercase());
        let i = &self.sheet.model.interface;
        let mut text = format!("/* {}\n", comment(&format!("{}: {}", i.name, i.text)));
        let made_for = if self.origin.made_for.is_empty() { String::new() } else { format!(", for {}", self.origin.made_for) };
        let _ = writeln!(text, " * Written by smpl {}{}.", env!("CARGO_PKG_VERSION"), comment(&made_for));
        let _ = writeln!(text, " *\n{} */", CONVENTIONS.replace("NAME", prefix).replace("TIME", &comment(&i.time.unit)));
        let _ = writeln!(text, "#ifndef {upper}_H\n#define {upper}_H\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n");
        for (name, what, elements) in self.tables() {
            let _ = writeln!(text, "#define {upper}_{} {} /* {what} */", name.to_uppercase(), elements.len());
        }
        let _ = writeln!(text, "#define {upper}_UNKNOWNS {} /* length of y */", self.sheet.unknowns());
        let _ = writeln!(text, "#define {upper}_WORK {} /* length of w */", self.work);
        let _ = writeln!(text, "#define {upper}_NONZEROS {} /* of the Jacobian */", self.pattern.rows.len());
        for function in self.labelled() {
            let _ = writeln!(
                text,
                "#define {upper}_{} {} /* written by {} */",
                function.name.to_uppercase(),
                function.outputs.len(),
                function.name
            );
        }
        text += &format!(
            "\n/* A number: name, unit, bounds, magnitude for tolerances, value at the nominal point. */\ntypedef struct {{\n    const char *name, *unit;\n    double low, high, scale, nominal;\n}} {prefix}_element;\n\n"
        );
        for (name, _, elements) in self.tables() {
            let _ = writeln!(text, "extern const {prefix}_element {prefix}_{name}_table[{}];", elements.len().max(1));
        }
        for function in self.labelled() {
            let _ = writeln!(text, "extern const char *const {prefix}_{}_names[{}];", function.name, function.outputs.len().max(1));
        }
        let (columns, rows) = (self.pattern.columns.len(), self.pattern.rows.len().max(1));
        let _ = writeln!(text, "\n/* Pattern of the Jacobian in compressed columns: start of each column, row of each non-zero. */");
        let _ =
            writeln!(text, "extern const int {prefix}_jacobian_columns[{columns}];\nextern const int {prefix}_jacobian_rows[{rows}];\n");
        let _ = writeln!(text, "/* What the other functions need of u and p, computed ahead: call it whenever u or p have changed. */");
        let _ = writeln!(text, "{};\n", self.prepare_head());
        for function in &self.sheet.functions {
            let _ = writeln!(text, "/* {} */\n{};\n", comment(&function.text), self.head(function));
        }
        text + "#ifdef __cplusplus\n}\n#endif\n\n#endif\n"
    }

    fn source(&self, prepare: &[Vec<Nest>]) -> Result<String, ExportError> {
        let (prefix, stem) = (self.prefix, self.stem);
        let mut tables = Tables::default();
        let mut bodies = String::new();
        let mut body = Body::new(self.sheet, &mut tables, prefix);
        for stage in prepare {
            body.values(stage)?;
        }
        bodies += &definition(&self.prepare_head(), &["u", "p", "w"], &body.text());
        for function in &self.sheet.functions {
            let text = Body::new(self.sheet, &mut tables, prefix).print(function)?;
            bodies += &definition(&self.head(function), arguments(function), &text);
        }
        let mut text = format!("/* See {stem}.h. */\n#include \"{stem}.h\"\n\n#include <math.h>\n#include <stddef.h>\n\n");
        // Names of functions of the export's own begin with `_`, after its prefix.
        let elementary = UnaryFn::ALL.iter().map(|&f| (spelling(f).name.trim_start_matches('_'), spelling(f).definition));
        for (name, helper) in elementary.chain(HELPERS) {
            let called = format!("{prefix}_{name}(");
            if bodies.contains(&called) {
                text += &helper.replace("NAME", prefix);
            }
        }
        for (name, _, elements) in self.tables() {
            let _ = writeln!(text, "const {prefix}_element {prefix}_{name}_table[{}] = {{", elements.len().max(1));
            text += &elements.iter().map(element).collect::<String>();
            text += if elements.is_empty() { "    {NULL, NULL, 0.0, 0.0, 0.0, 0.0},\n};\n\n" } else { "};\n\n" };
        }
        for function in self.labelled() {
            let names = function.outputs.iter().map(|label: &Label| format!("    \"{}\",\n", quoted(&label.name))).collect::<String>();
            let _ = writeln!(text, "const char *const {prefix}_{}_names[{}] = {{\n{names}}};\n", function.name, function.outputs.len());
        }
        text += &self.print_pattern();
        Ok(text + &tables.print() + "\n" + &bodies)
    }

    fn print_pattern(&self) -> String {
        let (prefix, pattern) = (self.prefix, self.pattern);
        let (columns, rows) = (wrapped(pattern.columns.iter()), wrapped(pattern.rows.iter()));
        let rows = if rows.is_empty() { "0".to_owned() } else { rows };
        let (n, m) = (pattern.columns.len(), pattern.rows.len().max(1));
        format!("const int {prefix}_jacobian_columns[{n}] = {{{columns}}};\nconst int {prefix}_jacobian_rows[{m}] = {{{rows}}};\n\n")
    }

    fn prepare_head(&self) -> String {
        format!("void {}_prepare(const double *u, const double *p, double *w)", self.prefix)
    }

    /// Declaration of a function.
    fn head(&self, function: &Function) -> String {
        let described = arguments(function).iter().map(|name| match *name {
            "t" | "cj" => format!("double {name}"),
            "out" => "double *out".to_owned(),
            "y" | "p" if function.update => format!("double *{name}"),
            _ => format!("const double *{name}"),
        });
        format!("void {}_{}({})", self.prefix, function.name, described.collect::<Vec<_>>().join(", "))
    }
}

/// The arguments of a function in their order.
fn arguments(function: &Function) -> &'static [&'static str] {
    match function.name.as_str() {
        "jacobian" => &["t", "y", "yp", "cj", "u", "p", "w", "out"],
        name if is_dynamic(name) => &["t", "y", "yp", "u", "p", "w", "out"],
        _ if function.update => &["t", "y", "u", "p", "c"],
        _ => &["t", "y", "yp", "u", "p", "c", "out"],
    }
}

fn definition(head: &str, arguments: &[&str], body: &str) -> String {
    let mut text = format!("{head}\n{{\n");
    for argument in arguments.iter().filter(|name| !is_used(body, name)) {
        let _ = writeln!(text, "    (void){argument};");
    }
    text + body + "}\n\n"
}

/// Returns `true` if a body mentions an argument.
fn is_used(body: &str, name: &str) -> bool {
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let before = |at: usize| body[..at].chars().next_back().is_none_or(|c| !word(c));
    let after = |at: usize| body[at + name.len()..].chars().next().is_none_or(|c| !word(c));
    body.match_indices(name).any(|(at, _)| before(at) && after(at))
}

fn element(e: &Element) -> String {
    let numbers = [e.low, e.high, e.scale, e.nominal].map(number).join(", ");
    let fixed = if e.structural { " /* shaped the model: has that value */" } else { "" };
    format!("    {{\"{}\", \"{}\", {numbers}}},{fixed}\n", quoted(&e.name), quoted(&e.unit))
}

/// Text inside of a string literal.
pub(super) fn quoted(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " ").replace("??", "?\\?")
}

/// Text inside of a comment.
fn comment(text: &str) -> String {
    text.replace("*/", "* /").replace("/*", "/ *").replace(['\n', '\\'], " ")
}

/// Functions that a body may call.
const HELPERS: [(&str, &str); 5] = [
    ("min", "static double NAME_min(double x, double y)\n{\n    return isnan(x) || x < y ? x : y;\n}\n\n"),
    ("max", "static double NAME_max(double x, double y)\n{\n    return isnan(x) || x > y ? x : y;\n}\n\n"),
    ("passed_below", PASSED_BELOW),
    ("passed_up_to", PASSED_UP_TO),
    ("entry", ENTRY),
];

const PASSED_BELOW: &str = "/* How many of n ascending limits are below x. */
static double NAME_passed_below(double x, const double *limits, int n)
{
    int low = 0, high = n;
    if (isnan(x)) return x;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (limits[middle] < x) low = middle + 1;
        else high = middle;
    }
    return low;
}

";

const PASSED_UP_TO: &str = "/* How many of n ascending limits are not above x. */
static double NAME_passed_up_to(double x, const double *limits, int n)
{
    int low = 0, high = n;
    if (isnan(x)) return x;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (limits[middle] <= x) low = middle + 1;
        else high = middle;
    }
    return low;
}

";

const ENTRY: &str = "/* The number at an index from 0, the first or the last beyond the ends. */
static double NAME_entry(double index, const double *numbers, int n)
{
    if (isnan(index)) return index;
    return numbers[index <= 0.0 ? 0 : index >= n - 1.0 ? n - 1 : (int)index];
}

";

const CONVENTIONS: &str = " * All numbers are in the units that the model declares; time t is in TIME. Vectors:
 *   y    unknowns: states (NAME_states_table), then algebraic variables (NAME_algebraic_table); yp their time derivatives
 *   u    actions (NAME_actions_table), held over a step
 *   p    parameters, discrete variables, disturbances (NAME_parameters_table); the nominal values are those of the model
 *   c    what only functions of a whole step need (NAME_context_table); NULL will do for functions that read none of it
 *   w    computed ahead by NAME_prepare
 *   out  result
 *
 * The functions keep nothing, allocate nothing and give the same bits for the same arguments; they may run in many threads at
 * once, each with its own w. Vectors that are written must not overlap with others.
";
