//! Forms of the parts of a model, for both directions: types whose fields a text has under other
//! names, without places in sources, or as other values. Types without one here are written as they
//! are.

mod quantity;

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use smpl_dsl::span::Span;

use self::quantity::{GridForm, QuantityForm};
use super::address;
use crate::artefact::Circumstances;
use crate::ir::{Affine, ExprId, Role, VarId};
use crate::model::number::present;
use crate::model::{
    Choice, Correction, Delay, Demoted, Differentiated, Failure, Finish, Grid, Guard, Lag, Observed, Projected, Quantity, Reduction,
    Reward, Root, RootAction, Row, StartCondition, Unsteady, Variable,
};

/// Modules that write and read lists of a type in its form.
macro_rules! lists {
    ($($module:ident: $type:ty as $form:literal;)*) => {$(
        pub(super) mod $module {
            use super::*;

            pub(in crate::json) fn serialize<S: Serializer>(list: &[$type], serializer: S) -> Result<S::Ok, S::Error> {
                #[derive(Serialize)]
                struct Written<'a>(#[serde(with = $form)] &'a $type);
                serializer.collect_seq(list.iter().map(Written))
            }

            pub(in crate::json) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<$type>, D::Error> {
                #[derive(Deserialize)]
                struct ReadItem(#[serde(with = $form)] $type);
                Ok(Vec::<ReadItem>::deserialize(deserializer)?.into_iter().map(|item| item.0).collect())
            }
        }
    )*};
}

lists! {
    variables: Variable as "VariableForm";
    quantities: Quantity as "QuantityForm";
    grids: Grid as "GridForm";
    roots: Root as "RootForm";
    delays: Delay as "DelayForm";
    conditions: StartCondition as "ConditionForm";
    projected: Projected as "ProjectedForm";
    differentiated: Differentiated as "DifferentiatedForm";
    guards: Guard as "GuardForm";
    unsteady: Unsteady as "UnsteadyForm";
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Variable", deny_unknown_fields)]
struct VariableForm {
    name: String,
    role: Role,
    #[serde(rename = "length")]
    len: u32,
    #[serde(skip)]
    span: Span,
}

/// An equation of an element of an unknown.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RowForm {
    extents: Vec<u32>,
    unknown: ElementAddress,
    residual: ExprId,
}

/// An element of a variable.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ElementAddress {
    variable: VarId,
    #[serde(with = "address")]
    at: Affine,
}

impl From<&Row> for RowForm {
    fn from(row: &Row) -> Self {
        let &Row { ref extents, var: variable, at, residual, span: _ } = row;
        RowForm { extents: extents.clone(), unknown: ElementAddress { variable, at }, residual }
    }
}

impl From<RowForm> for Row {
    fn from(RowForm { extents, unknown: ElementAddress { variable: var, at }, residual }: RowForm) -> Self {
        Row { extents, var, at, residual, span: Span::default() }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Root", deny_unknown_fields)]
struct RootForm {
    name: String,
    value: ExprId,
    strict: bool,
    #[serde(rename = "does", with = "ActionForm")]
    action: RootAction,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "RootAction", rename_all = "lowercase")]
enum ActionForm {
    Fail(u32),
    Run(#[serde(with = "event")] u32),
    Restart,
    Succeed(u32),
}

/// Names of the programs of events, `event 0`.
pub(super) mod event {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(in crate::json) fn serialize<S: Serializer>(number: &u32, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("event {number}"))
    }

    pub(in crate::json) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
        let name = String::deserialize(deserializer)?;
        let number = name.strip_prefix("event ").and_then(|number| number.parse().ok());
        number.ok_or_else(|| D::Error::custom("expected `event` and the number of the program"))
    }
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Delay", deny_unknown_fields)]
struct DelayForm {
    name: String,
    count: u32,
    #[serde(with = "range")]
    bounds: (f64, f64),
    #[serde(rename = "changes")]
    lag: Lag,
    before: bool,
    #[serde(skip)]
    span: Span,
}

/// Bounds, `null` for infinite ones.
mod range {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in crate::json) fn serialize<S: Serializer>(bounds: &(f64, f64), serializer: S) -> Result<S::Ok, S::Error> {
        bounds.1.is_finite().then_some(bounds).serialize(serializer)
    }

    pub(in crate::json) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<(f64, f64), D::Error> {
        Ok(Option::deserialize(deserializer)?.unwrap_or((f64::INFINITY, f64::INFINITY)))
    }
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "StartCondition", deny_unknown_fields)]
struct ConditionForm {
    #[serde(skip)]
    span: Span,
    count: u32,
    free: Vec<String>,
    only: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Projected", deny_unknown_fields)]
struct ProjectedForm {
    #[serde(skip)]
    span: Span,
    order: u32,
    states: Vec<String>,
    invariant: u32,
    count: u32,
    set: bool,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    corrected: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Differentiated", deny_unknown_fields)]
struct DifferentiatedForm {
    #[serde(skip)]
    span: Span,
    place: String,
    #[serde(rename = "equation")]
    text: String,
    times: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Guard", deny_unknown_fields)]
struct GuardForm {
    failure: u32,
    names: Vec<String>,
    #[serde(skip)]
    spans: Vec<Span>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Unsteady", deny_unknown_fields)]
struct UnsteadyForm {
    failure: u32,
    of: String,
    #[serde(skip)]
    span: Span,
}

/// Record of index reduction.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ReductionForm {
    #[serde(with = "differentiated")]
    differentiated: Vec<Differentiated>,
    follow: Vec<Demoted>,
    #[serde(with = "projected")]
    projected: Vec<Projected>,
    #[serde(default, skip_serializing_if = "is_zero")]
    conditions: u32,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    corrections: Vec<Correction>,
    #[serde(with = "guards")]
    guards: Vec<Guard>,
    #[serde(default, with = "unsteady", skip_serializing_if = "Vec::is_empty")]
    unsteady: Vec<Unsteady>,
}

impl From<&Reduction> for ReductionForm {
    fn from(r: &Reduction) -> Self {
        let Reduction { differentiated, demoted, projected, conditions, corrections, preferred: _, guards, unsteady } = r.clone();
        ReductionForm { differentiated, follow: demoted, projected, conditions, corrections, guards, unsteady }
    }
}

impl From<ReductionForm> for Reduction {
    fn from(r: ReductionForm) -> Self {
        let ReductionForm { differentiated, follow, projected, conditions, corrections, guards, unsteady } = r;
        Reduction { differentiated, demoted: follow, projected, conditions, corrections, preferred: Vec::new(), guards, unsteady }
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
fn is_zero(n: &u32) -> bool {
    *n == 0
}

/// End of a step; the default reward by its name.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FinishForm {
    failures: Vec<Failure>,
    successes: Vec<String>,
    constraints: Vec<String>,
    rewards: Vec<Reward>,
    #[serde(deserialize_with = "present")]
    default_reward: Option<String>,
    observations: Vec<Observed>,
}

impl From<&Finish> for FinishForm {
    fn from(finish: &Finish) -> Self {
        let default_reward = finish.rewards.get(finish.default_reward as usize).map(|reward| reward.name.clone());
        let Finish { failures, successes, constraints, rewards, default_reward: _, observations } = finish.clone();
        FinishForm { failures, successes, constraints, rewards, default_reward, observations }
    }
}

impl FinishForm {
    /// The end of a step.
    ///
    /// # Errors
    /// The name of a default reward that there is not.
    pub(super) fn finish(self) -> Result<Finish, String> {
        let FinishForm { failures, successes, constraints, rewards, default_reward, observations } = self;
        let default_reward = match default_reward {
            None if rewards.is_empty() => 0,
            None => return Err("null".into()),
            Some(name) => rewards.iter().position(|reward| reward.name == name).ok_or(name)? as u32,
        };
        Ok(Finish { failures, successes, constraints, rewards, default_reward, observations })
    }
}

/// The steady problem; fixed states by their names.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SteadyForm {
    pub(super) fixed: Vec<String>,
    pub(super) conditions: u32,
    pub(super) given: bool,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) free: Vec<u32>,
}

/// Settings of the episode; a missing period is absent.
pub(super) mod episode {
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::model::Episode;

    pub(in crate::json) fn serialize<S: Serializer>(episode: &Episode, serializer: S) -> Result<S::Ok, S::Error> {
        let mut form = serde_json::to_value(episode).map_err(S::Error::custom)?;
        if episode.cycle.is_none() {
            form.as_object_mut().map(|entries| entries.remove("cycle"));
        }
        form.serialize(serializer)
    }

    pub(in crate::json) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Episode, D::Error> {
        Episode::deserialize(deserializer)
    }
}

/// Settings of the solver, without the approximations of delays, which are part of the equations.
pub(super) mod solver {
    use serde::de::Error as _;
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::model::Solver;

    pub(in crate::json) fn serialize<S: Serializer>(solver: &Solver, serializer: S) -> Result<S::Ok, S::Error> {
        let mut form = serde_json::to_value(solver).map_err(S::Error::custom)?;
        form.as_object_mut().map(|entries| entries.remove("pade"));
        form.serialize(serializer)
    }

    pub(in crate::json) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Solver, D::Error> {
        let solver = Solver::deserialize(deserializer)?;
        if solver.pade == 0 { Ok(solver) } else { Err(D::Error::custom("`pade` is 0: its approximations are part of the equations")) }
    }
}

/// A choice; the chosen option by its name.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ChoiceForm {
    name: String,
    options: Vec<String>,
    #[serde(deserialize_with = "present")]
    chosen: Option<String>,
}

impl From<&Choice> for ChoiceForm {
    fn from(choice: &Choice) -> Self {
        let chosen = choice.chosen().map(str::to_owned);
        ChoiceForm { name: choice.name.clone(), options: choice.options.clone(), chosen }
    }
}

impl From<ChoiceForm> for Choice {
    fn from(ChoiceForm { name, options, chosen }: ChoiceForm) -> Self {
        // An option that there is not has no place among them, which the check of the model finds.
        let at = options.iter().position(|option| Some(option) == chosen.as_ref()).unwrap_or(options.len());
        Choice { name, options, at: at as u32 }
    }
}

/// Options of the compilation, as stored by a compiled model.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CircumstancesForm {
    #[serde(deserialize_with = "present")]
    scenario: Option<ScenarioForm>,
    variants: Vec<String>,
    settings: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScenarioForm {
    name: String,
    text: String,
}

impl From<&Circumstances> for CircumstancesForm {
    fn from(made_for: &Circumstances) -> Self {
        let Circumstances { scenario, variants, settings } = made_for.clone();
        let scenario = scenario.map(|(name, text)| ScenarioForm { name, text });
        CircumstancesForm { scenario, variants, settings: settings.into_iter().collect() }
    }
}

impl From<CircumstancesForm> for Circumstances {
    fn from(CircumstancesForm { scenario, variants, settings }: CircumstancesForm) -> Self {
        let scenario = scenario.map(|ScenarioForm { name, text }| (name, text));
        Circumstances { scenario, variants, settings: settings.into_iter().collect() }
    }
}
