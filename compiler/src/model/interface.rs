//! What is seen of a model from outside: names, units, bounds, what is reported.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Episode, Grid, Quantity, Solver};

/// Layout of the output of [`super::Programs::finish`]: the parts one after another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finish {
    /// For each failure two numbers: 1 if it holds, NaN if that is unknown, and the violation (largest excess over the range, 0 when kept).
    pub failures: u32,
    /// For each success condition one number, 1 if it holds, NaN if that is unknown.
    pub successes: u32,
    /// For each constraint one number, the violation, NaN if it is unknown.
    pub constraints: u32,
    /// One number a reward, before the error reward of failures.
    pub rewards: u32,
    /// One number an observation, physical units, unclipped.
    pub observations: u32,
}

impl Finish {
    /// How many numbers there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.observations().end
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where the failures stand: condition and violation of each.
    #[must_use]
    pub fn failures(&self) -> Range<usize> {
        behind(0, 2 * self.failures)
    }

    /// Where the conditions of success stand.
    #[must_use]
    pub fn successes(&self) -> Range<usize> {
        behind(self.failures().end, self.successes)
    }

    /// Where the violations of constraints stand.
    #[must_use]
    pub fn constraints(&self) -> Range<usize> {
        behind(self.successes().end, self.constraints)
    }

    /// Where the rewards stand.
    #[must_use]
    pub fn rewards(&self) -> Range<usize> {
        behind(self.constraints().end, self.rewards)
    }

    /// Where the observations stand.
    #[must_use]
    pub fn observations(&self) -> Range<usize> {
        behind(self.rewards().end, self.observations)
    }
}

fn behind(start: usize, count: u32) -> Range<usize> {
    start..start + count as usize
}

/// All that is seen from outside. It has many fields: one for each kind of thing that a model declares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Interface {
    /// Name of the model.
    pub name: String,
    /// Its describing text.
    pub text: String,
    /// The independent variable.
    pub time: Time,
    /// Differential states.
    pub states: Vec<Quantity>,
    /// Positions in `y` of the state elements in the order of the outside; `None` where it is the identity.
    pub state_order: Option<Vec<u32>>,
    /// Algebraic outputs: declared algebraic variables and `let`s with a unit.
    pub algebraics: Vec<Quantity>,
    /// Solved algebraic unknowns (the part of `y` after the states).
    pub solved: Vec<Quantity>,
    /// Elements of algebraic variables: declared (those of [`Interface::algebraics`]), solved for (members of ports too), and of the
    /// declared ones substituted.
    pub algebraic_counts: [u32; 3],
    /// Discrete variables.
    pub discretes: Vec<Quantity>,
    /// Domains in space.
    pub grids: Vec<Grid>,
    /// Names of the phases in their order, whose number (from 1) the discrete variable `phase` holds; empty without a schedule.
    pub phases: Vec<String>,
    /// Actions.
    pub actions: Vec<Quantity>,
    /// Disturbances.
    pub disturbances: Vec<Quantity>,
    /// Parameters.
    pub parameters: Vec<Quantity>,
    /// Random numbers: element i of the variable of role `Draw`.
    pub draws: Vec<Draw>,
    /// Observations of the chosen level.
    pub observations: Vec<Observed>,
    /// Names of the observation levels (`default` first, `full` last).
    pub levels: Vec<String>,
    /// Rewards.
    pub rewards: Vec<Reward>,
    /// Index of the default reward.
    pub default_reward: u32,
    /// Failures that the model declares.
    pub failures: Vec<Failure>,
    /// Names of the success conditions.
    pub successes: Vec<String>,
    /// Names of the constraints that end nothing.
    pub constraints: Vec<String>,
    /// Layout of the `finish` program.
    pub finish: Finish,
    /// Invariants: name and text.
    pub invariants: Vec<(String, String)>,
    /// State elements (positions in `y`) whose values the steady problem fixes; the program `steady` gives them.
    pub steady_fixed: Vec<u32>,
    /// Number of conditions on the steady state, `A + B = 1`; the program `steady` gives their differences, left less right, last.
    pub steady_conditions: u32,
    /// The steady state is given in full, nothing is solved.
    pub steady_given: bool,
    /// A `steady` block exists, or `steady()` is used.
    pub has_steady: bool,
    /// Episode settings.
    pub episode: Episode,
    /// Solver settings.
    pub solver: Solver,
    /// Names of variants (switches) with whether they are on.
    pub variants: Vec<(String, bool)>,
    /// Choices: name, options, index of the chosen one.
    pub choices: Vec<(String, Vec<String>, u32)>,
    /// Some `at start` program resets states.
    pub start_resets: bool,
}

/// One random number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Name of its stream: what it is drawn for; the same name and element give the same number in every run.
    pub stream: String,
    /// Standard variate.
    pub kind: Variate,
    /// When it is drawn.
    pub instant: Instant,
}

/// Kinds of standard variate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Variate {
    /// Uniform on (0, 1); mean 1/2.
    Uniform,
    /// Standard normal; mean 0.
    Normal,
}

/// When a random number is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Instant {
    /// At reset.
    Reset,
    /// At every step.
    Step,
}

/// One observed number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observed {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Lower bound of its box.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Sampled every so many steps and held (1: every step).
    pub every: u32,
    /// Reported so many steps late.
    pub delay: u32,
    /// Standard deviation of the Gaussian noise (0: none).
    pub noise: f64,
}

/// One reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reward {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Describing text.
    pub text: String,
}

/// One failure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// Identifier that starts the message.
    pub name: String,
    /// Describing text.
    pub text: String,
    /// It is found by a root function inside the step.
    pub event: bool,
    /// What the box holds, for messages; empty for other conditions.
    pub items: Vec<BoxItem>,
    /// Depends on the reward.
    pub on_reward: bool,
}

/// One member of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoxItem {
    /// Flattened name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Bounds.
    pub low: f64,
    /// Bounds.
    pub high: f64,
}

/// The independent variable.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
}

impl Interface {
    /// Whether a choice has an option, or a variant is on (`true`) or off (`false`).
    #[must_use]
    pub fn has_chosen(&self, name: &str, option: &str) -> bool {
        let choice = self.choices.iter().find(|(choice, ..)| choice == name);
        match choice.and_then(|(_, options, at)| options.get(*at as usize)) {
            Some(chosen) => chosen == option,
            None => self.variants.iter().any(|(variant, on)| variant == name && option.parse() == Ok(*on)),
        }
    }
}
