//! Why there is no steady state, in words.

use std::fmt;

use crate::catalogue::UnknownName;
use crate::failure::{Short, unit_suffix};
use crate::solver::SolveError;

/// Why no steady state was found.
#[derive(Clone, Debug, thiserror::Error)]
pub enum SteadyError {
    /// Neither Newton's method nor the process itself came to rest.
    #[error(
        "no steady state was found: after {iterations} iterations the largest residual is {}, in the {equation}{}; with these actions and parameters there may be \
         none, else give a better initial value",
        Short(*residual), aside.as_ref().map(|aside| format!(", where {aside}")).unwrap_or_default()
    )]
    NotFound {
        /// Iterations made.
        iterations: u32,
        /// Largest residual.
        residual: f64,
        /// Its equation.
        equation: String,
        /// What has come to the end of its bounds there.
        aside: Option<AtBound>,
    },
    /// What was found is outside of the declared bounds.
    #[error(
        "no steady state was found inside of the declared bounds: {name} = {}{} is {} {}{}; give a better initial value, or other bounds",
        Short(*value), unit_suffix(unit), if *below { "below" } else { "above" }, Short(*bound), unit_suffix(unit)
    )]
    Outside {
        /// The state or variable.
        name: String,
        /// Its value.
        value: f64,
        /// Its unit.
        unit: String,
        /// The bound that it breaks.
        bound: f64,
        /// It is below that bound.
        below: bool,
    },
    /// The equations do not determine all unknowns.
    #[error("the steady state is not determined{0}")]
    Undetermined(Freedom),
    /// An equation is NaN or infinite at the first guess.
    #[error("the {equation} is not finite at the first guess")]
    NotFinite {
        /// The equation.
        equation: String,
    },
    /// A condition of the `steady` block cannot be used, or an equation cannot be differentiated.
    #[error("{message}")]
    Condition {
        /// Why.
        message: String,
    },
    /// Somebody wanted the search to stop, see [`crate::interrupt`].
    #[error("the search was interrupted")]
    Interrupted,
    /// A name that the model does not have.
    #[error(transparent)]
    UnknownName(#[from] UnknownName),
    /// The linear solver.
    #[error(transparent)]
    Solver(#[from] SolveError),
}

/// A state or variable at the end of its bounds, or beyond.
#[derive(Clone, Debug, PartialEq)]
pub struct AtBound {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// The bound.
    pub bound: f64,
}

impl fmt::Display for AtBound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = unit_suffix(&self.unit);
        write!(f, "{} = {}{unit} has come to its bound {}{unit}", self.name, Short(self.value), Short(self.bound))
    }
}

/// What the equations leave free.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Freedom {
    /// States whose values, all together, would determine the rest.
    pub states: Vec<String>,
    /// Sums that nothing changes.
    pub sums: Vec<ConservedSum>,
    /// Algebraic variables that their own equations leave free.
    pub algebraics: Vec<String>,
    /// States that change whatever the state of the model is, with their rates in the model's units.
    pub drifts: Vec<(String, f64)>,
}

/// A sum of states that nothing changes.
#[derive(Clone, Debug, PartialEq)]
pub struct ConservedSum {
    /// States and their factors.
    pub terms: Vec<(f64, String)>,
    /// Its value at the first guess.
    pub value: f64,
    /// The common unit of its states, if they have one.
    pub unit: Option<String>,
}

impl fmt::Display for ConservedSum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (factor, name)) in self.terms.iter().enumerate() {
            let sign = match (i, *factor < 0.0) {
                (0, false) => "",
                (0, true) => "-",
                (_, false) => " + ",
                (_, true) => " - ",
            };
            f.write_str(sign)?;
            if factor.abs() != 1.0 {
                write!(f, "{}*", Short(factor.abs()))?;
            }
            f.write_str(name)?;
        }
        Ok(())
    }
}

impl fmt::Display for Freedom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.states.is_empty() {
            return match self.algebraics.as_slice() {
                [] => f.write_str(": the equations at rest are singular"),
                [name] => write!(f, ": the algebraic equations leave {name} free, at any state"),
                names => write!(f, ": the algebraic equations leave {} free, at any state", names.join(", ")),
            };
        }
        for (i, sum) in self.sums.iter().enumerate() {
            let unit = unit_suffix(sum.unit.as_deref().unwrap_or(""));
            write!(f, "{} {sum} ({}{unit} at the first guess)", if i == 0 { ":" } else { " and" }, Short(sum.value))?;
        }
        match self.sums.len() {
            0 => {}
            1 => f.write_str(" is conserved")?,
            _ => f.write_str(" are conserved")?,
        }
        let one = self.states.len() == 1;
        let fixed = |join: &str, before: &str| {
            let entries: Vec<String> = self.states.iter().map(|name| format!("{before}{name}=...")).collect();
            entries.join(join)
        };
        let what = match (one, self.sums.is_empty()) {
            (true, true) => "fix a state that integrates".to_owned(),
            (false, true) => format!("fix {} states that integrate, all of them", self.states.len()),
            (true, false) => "give its value, or fix a state".to_owned(),
            (false, false) => format!("give their values, or fix {} states, all of them", self.states.len()),
        };
        write!(f, ": {what}, `steady {{ {} }}` in the model", fixed(", ", "").replace('=', " = "))?;
        let shown = |sum: &&ConservedSum| sum.unit.is_some();
        let sums: Vec<String> = self.sums.iter().filter(shown).map(|sum| format!("{sum} = {}", Short(sum.value))).collect();
        if !sums.is_empty() {
            write!(f, ", or `steady {{ {} }}`", sums.join(", "))?;
        }
        write!(f, ", or `{}`", fixed(" ", "--fix "))?;
        for (i, (name, rate)) in self.drifts.iter().enumerate() {
            write!(
                f,
                "{} d/dt {name} is {}",
                if i == 0 { "; whatever the state, with these actions and parameters" } else { "," },
                Short(*rate)
            )?;
        }
        Ok(())
    }
}
