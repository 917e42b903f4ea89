//! Reason why there is no steady state, in words.

use std::fmt;

use crate::catalogue::UnknownName;
use crate::failure::{Short, unit_suffix};
use crate::solver::SolveError;

/// Reason why no steady state was found.
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
        /// Variables at their bounds there.
        aside: Option<AtBound>,
    },
    /// The solution exceeds the declared bounds.
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
    /// A state that is not held moves with one that is.
    #[error("`{name}` is not at rest: d/dt {name} = {}, as its rate is coupled with that of a held state; hold other states", Short(*rate))]
    Moving {
        /// The state.
        name: String,
        /// Its rate.
        rate: f64,
    },
    /// The equations do not determine all unknowns.
    #[error("{0}")]
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
        /// Reason.
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

/// Free unknowns of the equations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Freedom {
    /// States whose values, all together, would determine the rest.
    pub states: Vec<String>,
    /// Sums that nothing changes.
    pub sums: Vec<ConservedSum>,
    /// Algebraic variables that their own equations leave free.
    pub algebraics: Vec<String>,
    /// Sums of states that change whatever the state of the model is: with these actions and
    /// parameters nothing rests.
    pub drifts: Vec<Drift>,
    /// The actions that act on them.
    pub moved_by: Vec<String>,
}

/// A sum of states, or a single one, with a rate that no state changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Drift {
    /// States and their factors.
    pub terms: Vec<(f64, String)>,
    /// The rate.
    pub rate: f64,
    /// Its unit, if the states have one in common.
    pub unit: Option<String>,
}

impl fmt::Display for Drift {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("d/dt ")?;
        match self.terms.as_slice() {
            [(1.0, name)] => f.write_str(name)?,
            terms => write!(f, "({})", Sum(terms))?,
        }
        write!(f, " = {}{}", Short(self.rate), unit_suffix(self.unit.as_deref().unwrap_or("")))
    }
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
        Sum(&self.terms).fmt(f)
    }
}

/// Terms as a sum.
struct Sum<'a>(&'a [(f64, String)]);

impl fmt::Display for Sum<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (factor, name)) in self.0.iter().enumerate() {
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
        if !self.drifts.is_empty() {
            return self.without_rest(f);
        }
        f.write_str("the steady state is not determined")?;
        if self.states.is_empty() {
            return match self.algebraics.as_slice() {
                [] => f.write_str(": the equations at rest are singular"),
                [name] => write!(f, ": the algebraic equations leave {name} free, at any state"),
                names => write!(f, ": the algebraic equations leave {} free, at any state", names.join(", ")),
            };
        }
        if !self.sums.is_empty() {
            f.write_str(": ")?;
            self.conserved(f)?;
        }
        let what = match (self.states.len(), self.sums.is_empty()) {
            (1, true) => "fix a state that integrates".to_owned(),
            (n, true) => format!("fix {n} states that integrate, all of them"),
            (1, false) => "give its value, or fix a state".to_owned(),
            (n, false) => format!("give their values, or fix {n} states, all of them"),
        };
        write!(f, ": {what}, ")?;
        self.ways(f)
    }
}

impl Freedom {
    /// Reason why the point is not at rest, and the nearest one that is.
    fn without_rest(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (one, drifts) = (self.drifts.len() == 1, and(self.drifts.iter()));
        let (acted, word) = if one { ("it", "a state") } else { ("them", "states") };
        write!(f, "there is no steady state with these actions and parameters: {drifts}, whatever the state; ")?;
        match self.moved_by.as_slice() {
            [] => write!(f, "no action acts on {acted}: only other parameters may bring {acted} to zero")?,
            [name] => write!(f, "the action {name} acts on {acted}: give it another value")?,
            names => write!(f, "the actions {} act on {acted}: give them other values", and(names.iter()))?,
        }
        if !self.sums.is_empty() {
            f.write_str("; ")?;
            self.conserved(f)?;
        }
        write!(f, "; or hold {word}, ")?;
        self.ways(f)
    }

    /// `A + B (1 mol at the first guess) is conserved`.
    fn conserved(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = |sum: &ConservedSum| unit_suffix(sum.unit.as_deref().unwrap_or(""));
        let sums = self.sums.iter().map(|sum| format!("{sum} ({}{} at the first guess)", Short(sum.value), unit(sum)));
        write!(f, "{} {} conserved", and(sums), if self.sums.len() == 1 { "is" } else { "are" })
    }

    /// Way to give the states or the sums.
    fn ways(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fixed = |join: &str, before: &str, after: &str| {
            let entries: Vec<String> = self.states.iter().map(|name| format!("{before}{name}{after}")).collect();
            entries.join(join)
        };
        write!(f, "`steady {{ {} }}` in the model", fixed(", ", "", " = ..."))?;
        let shown = |sum: &&ConservedSum| sum.unit.is_some();
        let sums: Vec<String> = self.sums.iter().filter(shown).map(|sum| format!("{sum} = {}", Short(sum.value))).collect();
        if !sums.is_empty() && self.drifts.is_empty() {
            write!(f, ", or `steady {{ {} }}`", sums.join(", "))?;
        }
        write!(f, ", or `{}`", fixed(" ", "--fix ", "=..."))
    }
}

/// `a`, `a and b`, `a and b and c`.
fn and(parts: impl Iterator<Item = impl fmt::Display>) -> String {
    parts.map(|part| part.to_string()).collect::<Vec<_>>().join(" and ")
}
