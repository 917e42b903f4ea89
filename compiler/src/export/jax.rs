//! A Python module of pure functions for JAX.

use std::fmt::Write as _;

use super::module::{Module, string};
use super::python::Library;
use super::spelling::{Spelling, definitions};
use super::{ExportError, Nominal, Origin};
use crate::ir::UnaryFn;
use crate::model::Model;

/// The text of the module.
pub(super) fn print(model: &Model, nominal: &Nominal<'_>, origin: &Origin<'_>) -> Result<String, ExportError> {
    let module = Module::new(model, nominal, (Library::Jax, spelling))?;
    let mut text = module.head(origin, ABOUT, "import jax.numpy as jnp\nimport numpy as np");
    text += "\n";
    text += &module.lists.print(|list| format!("np.array({list})"));
    text += HELPERS;
    text += &definitions(spelling);
    text += ALIASES;
    text += &module.text;
    text += "\n# Functions by name.\nFUNCTIONS = {\n";
    for made in &module.made {
        let _ = writeln!(text, "    {}: _{},", string(&made.name), made.name);
    }
    text += "}\n";
    if module.sheet.model.explicit {
        let families = &module.sheet.families;
        text += match (families.states.is_empty(), families.solved.is_empty()) {
            (true, _) => "",
            (false, true) => RHS,
            (false, false) => DAE,
        };
    }
    Ok(text)
}

/// Names in `jax.numpy`.
fn spelling(f: UnaryFn) -> Spelling {
    let name = match f {
        UnaryFn::Neg => "-",
        UnaryFn::Abs => "_abs",
        UnaryFn::Sign => "_sign",
        UnaryFn::Sqrt => "jnp.sqrt",
        UnaryFn::Exp => "jnp.exp",
        UnaryFn::Ln => "jnp.log",
        UnaryFn::Log10 => "jnp.log10",
        UnaryFn::Sin => "jnp.sin",
        UnaryFn::Cos => "jnp.cos",
        UnaryFn::Tan => "jnp.tan",
        UnaryFn::Asin => "jnp.arcsin",
        UnaryFn::Acos => "jnp.arccos",
        UnaryFn::Atan => "jnp.arctan",
        UnaryFn::Sinh => "jnp.sinh",
        UnaryFn::Cosh => "jnp.cosh",
        UnaryFn::Tanh => "jnp.tanh",
        UnaryFn::Erf => return Spelling { name: "_erf", definition: ERF },
        UnaryFn::Floor => "jnp.floor",
        UnaryFn::Ceil => "jnp.ceil",
        UnaryFn::Round => "_round",
        UnaryFn::Single => return Spelling { name: "_single", definition: SINGLE },
        UnaryFn::Smooth => "",
    };
    Spelling::known(name)
}

const ERF: &str = "
from jax.scipy.special import erf as _erf  # noqa: E402
";

const SINGLE: &str = "
def _single(a):
    return jnp.asarray(a, dtype=jnp.float32).astype(jnp.asarray(a).dtype)
";

const ABOUT: &str =
    "Pure functions of time t and of vectors x (states), z (algebraic variables), u (actions), p (parameters, discrete variables,
disturbances), dx (rates of x), c (what functions of a whole step need in addition), to be jitted, mapped over batches and
differentiated. The tables below name the elements of each. They compute in the precision of their arguments:
`jax.config.update(\"jax_enable_x64\", True)` before any of them for double precision.
";

const HELPERS: &str = r#"

def _join(parts):
    return jnp.concatenate([jnp.ravel(part) for part in parts])


def _number(truth):
    return jnp.where(truth, 1.0, 0.0)


def _passed(limits, a, up_to):
    return jnp.searchsorted(limits, a, side="right" if up_to else "left").astype(jnp.result_type(a, float))


def _entry(numbers, index):
    return jnp.asarray(numbers, dtype=jnp.result_type(index))[jnp.asarray(index).astype(int)]
"#;

const ALIASES: &str = r#"

_and, _or, _not, _where = jnp.logical_and, jnp.logical_or, jnp.logical_not, jnp.where
_abs, _sign, _round, _min, _max = jnp.abs, jnp.sign, jnp.round, jnp.minimum, jnp.maximum

"#;

const DAE: &str = r#"

def dae(t, x, z, u, p):
    """Rates of the states and residual of the algebraic equations."""
    return _rates(t, x, z, u, p), _algebraic(t, x, z, u, p)
"#;

const RHS: &str = r#"

def rhs(t, x, u, p):
    """Rates of the states."""
    return _rates(t, x, jnp.zeros(0), u, p)


def dae(t, x, z, u, p):
    """Rates of the states; there are no algebraic equations."""
    return _rates(t, x, z, u, p), jnp.zeros(0)
"#;
