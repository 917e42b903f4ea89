//! Roles of variables for users of a model, by their names in Python.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smpl_runtime::catalogue::{Catalogue, Family};
use smpl_runtime::environment::Environment;

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// An unknown with a rate.
    State,
    /// An algebraic variable that is solved for.
    Solved,
    /// Any algebraic variable.
    Algebraic,
    /// Variables that change at instants and events.
    Discrete,
    /// An input that is not chosen.
    Disturbance,
    /// An input that is chosen.
    Action,
    /// Fixed within an episode.
    Parameter,
}

impl Role {
    const NAMES: [(&'static str, Role); 7] = [
        ("state", Role::State),
        ("solved", Role::Solved),
        ("algebraic", Role::Algebraic),
        ("discrete", Role::Discrete),
        ("disturbance", Role::Disturbance),
        ("action", Role::Action),
        ("parameter", Role::Parameter),
    ];

    /// The role of a name.
    ///
    /// # Errors
    /// If the role is unknown.
    pub fn of(name: &str) -> PyResult<Role> {
        let known = Self::NAMES.iter().find(|(known, _)| *known == name);
        known.map(|(_, role)| *role).ok_or_else(|| role_error(name))
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, role)| *role == self).map_or("", |(name, _)| name)
    }

    /// The variables of the role.
    pub fn family(self, catalogue: &Catalogue) -> &Family {
        match self {
            Role::State => &catalogue.states,
            Role::Solved => &catalogue.solved,
            Role::Algebraic => &catalogue.algebraics,
            Role::Discrete => &catalogue.discretes,
            Role::Disturbance => &catalogue.disturbances,
            Role::Action => &catalogue.actions,
            Role::Parameter => &catalogue.parameters,
        }
    }

    /// Present values in an environment, at the places of their elements; algebraic variables are
    /// computed.
    pub fn region(self, environment: &Environment) -> Option<&[f64]> {
        match self {
            Role::State | Role::Solved => Some(environment.unknowns()),
            Role::Algebraic => None,
            Role::Discrete => Some(environment.discretes()),
            Role::Disturbance => Some(environment.disturbances()),
            Role::Action => Some(environment.actions()),
            Role::Parameter => Some(environment.parameters()),
        }
    }
}

/// The exception of a role that there is not.
pub fn role_error(role: &str) -> PyErr {
    PyValueError::new_err(format!("unknown role `{role}`"))
}

impl<'py> FromPyObject<'_, 'py> for Role {
    type Error = PyErr;

    fn extract(name: Borrowed<'_, 'py, PyAny>) -> PyResult<Role> {
        Role::of(name.extract::<&str>()?)
    }
}
