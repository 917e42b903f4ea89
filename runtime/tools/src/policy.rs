//! Policies without feedback: those of the command line and of the live page.

use smpl_runtime::catalogue::UnknownName;
use smpl_runtime::environment::Environment;
use smpl_runtime::random::{EpisodeKey, Stream};
use smpl_runtime::setup::Setup;

/// Source of actions.
pub(crate) enum Policy {
    /// The actions' nominal values.
    Nominal,
    /// A program of the model.
    Declared(usize),
    /// Uniform in the action box.
    Random(Stream),
    /// A table.
    Recorded(Vec<Vec<f64>>),
}

/// Policies that every model has.
const EVERYWHERE: [&str; 2] = ["nominal", "random"];

/// Names of the policies of a model, those that every model has first.
pub(crate) fn names(setup: &Setup) -> impl Iterator<Item = &str> {
    let declared = setup.model().model().programs.policies.iter().map(|(name, _)| name.as_str()).filter(|name| !EVERYWHERE.contains(name));
    EVERYWHERE.into_iter().chain(declared)
}

impl Policy {
    /// The policy of a name. `nominal` is the model's own of that name, else its nominal actions.
    ///
    /// # Errors
    /// [`UnknownName`] with the names that there are.
    pub(crate) fn named(name: &str, seed: u64, setup: &Setup) -> Result<Self, UnknownName> {
        let declared = setup.model().model().programs.policies.iter().position(|(known, _)| known == name);
        match (name, declared) {
            ("random", _) => Ok(Self::Random(Stream::new(EpisodeKey::seeded(seed), "policy:random"))),
            (_, Some(index)) => Ok(Self::Declared(index)),
            ("nominal", None) => Ok(Self::Nominal),
            (name, None) => Err(UnknownName::new("policy", name, names(setup))),
        }
    }

    /// Number of steps that it has actions for, where it ends.
    pub(crate) fn length(&self) -> Option<u32> {
        match self {
            Policy::Recorded(rows) => Some(rows.len() as u32),
            _ => None,
        }
    }

    /// Writes the action of the coming step.
    pub(crate) fn choose(&mut self, environment: &mut Environment, action: &mut [f64]) {
        let step = environment.steps();
        match self {
            Policy::Declared(index) => environment.policy(*index, action),
            Policy::Recorded(rows) => {
                if let Some(row) = rows.get(step as usize) {
                    action.copy_from_slice(row);
                }
            }
            Policy::Nominal => {
                for (a, element) in action.iter_mut().zip(environment.catalogue().actions.elements()) {
                    *a = element.default;
                }
            }
            Policy::Random(stream) => {
                for (i, (a, element)) in action.iter_mut().zip(environment.catalogue().actions.elements()).enumerate() {
                    let u = stream.uniform(step, i as u32);
                    *a = if (element.high - element.low).is_finite() {
                        element.low + u * (element.high - element.low)
                    } else {
                        element.default
                    };
                }
            }
        }
    }
}
