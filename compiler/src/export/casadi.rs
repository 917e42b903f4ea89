//! A Python module that builds CasADi functions.

use std::fmt::Write as _;

use super::module::{Module, string};
use super::python::Library;
use super::spelling::{Spelling, definitions};
use super::{ExportError, Nominal, Origin};
use crate::ir::UnaryFn;
use crate::model::Model;

/// Models whose functions compute fewer numbers are built of scalars: these run faster than
/// operations on short vectors.
const LARGEST_OF_SCALARS: usize = 6000;

/// The text of the module.
pub(super) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<String, ExportError> {
    let module = Module::new(model, nominal, (Library::Casadi, spelling))?;
    let kind = if module.size <= LARGEST_OF_SCALARS { "SX" } else { "MX" };
    let mut text = module.head(origin, ABOUT, "import casadi as ca");
    let _ = writeln!(text, "# Default kind of the symbols of the functions.\nKIND = \"{kind}\"\n");
    text += &module.lists.print(str::to_owned);
    text += HELPERS;
    text += &definitions(spelling);
    text += "\n";
    text += &module.text;
    text += "\n# Name of each function: what builds it, its arguments, what it gives.\n_FUNCTIONS = {\n";
    for made in &module.made {
        let arguments: Vec<String> = made.arguments.iter().map(|a| string(a)).collect();
        let results = if made.update { "\"x_next\", \"z_next\", \"p_next\"" } else { "\"out\"" };
        let _ = writeln!(text, "    {}: (_{}, [{}], [{results}]),", string(&made.name), made.name, arguments.join(", "));
    }
    Ok(text + "}\n" + BUILD)
}

/// Names in CasADi.
fn spelling(f: UnaryFn) -> Spelling {
    let name = match f {
        UnaryFn::Neg => "-",
        UnaryFn::Abs => "_abs",
        UnaryFn::Sign => "_sign",
        UnaryFn::Sqrt => "ca.sqrt",
        UnaryFn::Exp => "ca.exp",
        UnaryFn::Ln => "ca.log",
        UnaryFn::Log10 => "ca.log10",
        UnaryFn::Sin => "ca.sin",
        UnaryFn::Cos => "ca.cos",
        UnaryFn::Tan => "ca.tan",
        UnaryFn::Asin => "ca.asin",
        UnaryFn::Acos => "ca.acos",
        UnaryFn::Atan => "ca.atan",
        UnaryFn::Sinh => "ca.sinh",
        UnaryFn::Cosh => "ca.cosh",
        UnaryFn::Tanh => "ca.tanh",
        UnaryFn::Erf => "ca.erf",
        UnaryFn::Floor => "ca.floor",
        UnaryFn::Ceil => "ca.ceil",
        UnaryFn::Round => return Spelling { name: "_round", definition: ROUND },
        UnaryFn::Single => return Spelling { name: "_single", definition: SINGLE },
        UnaryFn::Smooth => "",
    };
    Spelling::known(name)
}

const ROUND: &str = r#"
def _round(a):
    """To the nearest integer, ties to even."""
    low = ca.floor(a)
    up = ca.logic_or(a - low > 0.5, ca.logic_and(a - low == 0.5, low / 2.0 != ca.floor(low / 2.0)))
    return low + up
"#;

const SINGLE: &str = r#"
def _single(a):
    """To the nearest number of single precision, by Veltkamp's splitting."""
    big = 536870913.0 * a
    return big - (big - a)
"#;

const ABOUT: &str =
    "`build()` makes the functions: of column vectors x (states), z (algebraic variables), u (actions), p (parameters, discrete
variables, disturbances, and time last where the model depends on it), dx (rates of x), c (what functions of a whole step
need in addition). The tables below name the elements of each.
";

const HELPERS: &str = r#"
# Width over which switches are smooth, in the unit of what is compared; 0: exact.
_width = 0.0


def _join(parts):
    return ca.vertcat(*parts)


def _set(vector, where, values):
    vector = type(vector)(vector)
    vector[where] = values
    return vector


def _less(a, b):
    return 0.5 + 0.5 * ca.tanh((b - a) / _width) if _width else a < b


def _less_equal(a, b):
    return 0.5 + 0.5 * ca.tanh((b - a) / _width) if _width else a <= b


def _and(a, b):
    return a * b if _width else ca.logic_and(a, b)


def _or(a, b):
    return a + b - a * b if _width else ca.logic_or(a, b)


def _not(a):
    return 1.0 - a if _width else ca.logic_not(a)


def _where(condition, a, b):
    if _width:
        return condition * a + (1.0 - condition) * b
    return ca.if_else(condition, a, b)


def _abs(a):
    return ca.sqrt(a**2 + _width**2) if _width else ca.fabs(a)


def _sign(a):
    return ca.tanh(a / _width) if _width else ca.sign(a)


def _min(a, b):
    return 0.5 * (a + b - ca.sqrt((a - b) ** 2 + _width**2)) if _width else ca.fmin(a, b)


def _max(a, b):
    return 0.5 * (a + b + ca.sqrt((a - b) ** 2 + _width**2)) if _width else ca.fmax(a, b)


def _product(a, b):
    return a * b


def _fold(function, matrix):
    """Reduce the rows of a matrix to one, as a column."""
    row = matrix[0, :]
    for i in range(1, matrix.shape[0]):
        row = function(row, matrix[i, :])
    return row.T


def _passed(limits, a, up_to):
    """How many of ascending limits each of a column of numbers has left behind."""
    rows, columns = ca.repmat(ca.DM(limits), 1, a.numel()), ca.repmat(a.T, len(limits), 1)
    return ca.sum1(_less_equal(rows, columns) if up_to else _less(rows, columns)).T


def _entry(numbers, index):
    """The numbers of a list at a column of indices, with straight lines in between (where switches are smooth)."""
    rows, columns = ca.DM(range(len(numbers))), ca.repmat(index.T, len(numbers), 1)
    near = ca.fmax(0.0, 1.0 - ca.fabs(ca.repmat(rows, 1, index.numel()) - columns))
    return ca.mtimes(near.T, ca.DM(numbers))
"#;

const BUILD: &str = r#"

def build(kind=KIND, smooth=0.0):
    """Make the functions.

    Args:
        kind: "MX" keeps loops as operations on vectors, "SX" writes every number out.
        smooth: width over which switches, absolute values, minima and maxima are made smooth, in the unit of what is
            compared; 0 leaves them exact.

    Returns:
        Functions by name. `dae(x, z, u, p)` gives rates and algebraic residual of a model that is explicit in its rates,
        `rhs(x, u, p)` the rates of one without algebraic variables; `rewards` maps names to functions.
    """
    global _width
    if kind not in ("MX", "SX"):
        raise ValueError(f"kind is {kind!r}, expected 'MX' or 'SX'")
    symbol = getattr(ca, kind).sym
    lengths = {"dx": STATES, "x": STATES, "z": ALGEBRAIC, "u": ACTIONS, "p": PARAMETERS, "c": CONTEXT}
    symbols = {name: symbol(name, len(table)) for name, table in lengths.items()}
    _width = float(smooth)
    try:
        made, values = {}, {}
        for name, (function, arguments, results) in _FUNCTIONS.items():
            inputs = [symbols[argument] for argument in arguments]
            values[name] = function(*inputs)
            outputs = list(values[name]) if len(results) > 1 else [values[name]]
            made[name] = ca.Function(name, inputs, outputs, arguments, results)
        x, u, p, nothing = symbols["x"], symbols["u"], symbols["p"], getattr(ca, kind)(0, 1)
        if "residual" not in made:
            arguments = ["dx", "x", "z", "u", "p"]
            made["residual"] = ca.Function("residual", [symbols[name] for name in arguments], [nothing], arguments, ["out"])
        if "rates" in values and not ALGEBRAIC:
            made["rhs"] = ca.Function("rhs", [x, u, p], [_rates(x, nothing, u, p)], ["x", "u", "p"], ["ode"])
    finally:
        _width = 0.0
    if EXPLICIT:
        z, rates, algebraic = symbols["z"], values.get("rates", nothing), values.get("algebraic", nothing)
        made["dae"] = ca.Function("dae", [x, z, u, p], [rates, algebraic], ["x", "z", "u", "p"], ["ode", "alg"])
    count = len(NAMES.get("rewards", []))
    made["rewards"] = {NAMES["rewards"][i]: made.pop(f"reward_{i}") for i in range(count)}
    return made
"#;
