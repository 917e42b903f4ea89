//! Random events against an independent exact simulation.
//!
//! Rates, thresholds, resets and starts are multiples of 1/4, rates of states constant between events. Times and values of crossings are
//! multiples of [`GRID`], so that equal thresholds, starts at a threshold and events at one instant are exact. Events that approach a cycle
//! halve their distances again and again: the comparison ends where these leave the grid. `PROPTEST_CASES` sets how many models are tried.

use std::fmt::Write;
use std::path::Path;

use proptest::prelude::*;
use smpl_runtime::environment::{Environment, ResetOptions};
use smpl_runtime::load::{LoadOptions, load_text};
use smpl_runtime::setup::Setup;
use smpl_runtime::solver::Method;

const LIMIT: u32 = 400;
const STEPS: u32 = 4;
/// Far above the duration within which events are simultaneous, and far above rounding.
const GRID: f64 = 1.0 / 16_777_216.0;
/// Names of the rates and states.
const STATES: [&str; 2] = ["x", "y"];

/// `event when state op threshold`, and what it does.
#[derive(Clone, Debug)]
struct Event {
    state: usize,
    rises: bool,
    strict: bool,
    threshold: f64,
    /// A new rate of a state.
    rate: Option<(usize, f64)>,
    /// A new value of a state.
    reset: Option<(usize, f64)>,
}

#[derive(Clone, Debug)]
struct Case {
    start: [f64; 2],
    rates: [f64; 2],
    events: Vec<Event>,
    step: f64,
}

impl Event {
    fn condition(&self) -> String {
        let op = match (self.rises, self.strict) {
            (true, true) => ">",
            (true, false) => ">=",
            (false, true) => "<",
            (false, false) => "<=",
        };
        format!("{} {op} {}", STATES[self.state], self.threshold)
    }

    /// Positive where the condition holds.
    fn distance(&self, values: &[f64; 2]) -> f64 {
        let above = values[self.state] - self.threshold;
        if self.rises { above } else { -above }
    }

    fn motion(&self, rates: &[f64; 2]) -> f64 {
        if self.rises { rates[self.state] } else { -rates[self.state] }
    }
}

impl Case {
    fn text(&self) -> String {
        let mut text = format!(
            "model Random\ntime t : s\ndiscrete r_x = {}\ndiscrete r_y = {}\nstate x = {} in -1000..1000\nstate y = {} in -1000..1000\n\
             eq d/dt x = r_x / 1 [s]\neq d/dt y = r_y / 1 [s]\nobserve x in -1000..1000\n\
             episode {{ step = {} [s], max_steps = {STEPS} }}\nsolver {{ max_events = {LIMIT} }}\n",
            self.rates[0], self.rates[1], self.start[0], self.start[1], self.step
        );
        for (i, event) in self.events.iter().enumerate() {
            write!(text, "discrete n{i} = 0\nevent e{i} when {}\nat e{i} {{ next n{i} = n{i} + 1", event.condition()).expect("text");
            if let Some((state, rate)) = event.rate {
                write!(text, " ; next r_{} = {rate}", STATES[state]).expect("text");
            }
            if let Some((state, value)) = event.reset {
                write!(text, " ; reset {} = {value}", STATES[state]).expect("text");
            }
            text.push_str(" }\n");
        }
        text
    }
}

/// The exact simulation.
struct Exact<'a> {
    case: &'a Case,
    t: f64,
    values: [f64; 2],
    rates: [f64; 2],
    holds: Vec<bool>,
    counts: Vec<f64>,
}

impl<'a> Exact<'a> {
    fn new(case: &'a Case) -> Self {
        let none = vec![false; case.events.len()];
        Self { case, t: 0.0, values: case.start, rates: case.rates, holds: none, counts: vec![0.0; case.events.len()] }
    }

    fn distances(&self) -> Vec<f64> {
        self.case.events.iter().map(|e| e.distance(&self.values)).collect()
    }

    /// Runs what fired, in the order of the text.
    fn run(&mut self, fired: &[usize]) {
        for &i in fired {
            let event = &self.case.events[i];
            self.counts[i] += 1.0;
            if let Some((state, rate)) = event.rate {
                self.rates[state] = rate;
            }
            if let Some((state, value)) = event.reset {
                self.values[state] = value;
            }
        }
    }

    /// Conditions that become true at this instant by its actions; `None` if they have no end. `before` are the distances before the change.
    fn settle(&mut self, mut before: Option<Vec<f64>>) -> Option<()> {
        for _ in 0..LIMIT {
            let now = self.distances();
            let mut fired = Vec::new();
            for (i, event) in self.case.events.iter().enumerate() {
                let (motion, held) = (event.motion(&self.rates), self.holds[i]);
                let has_jumped = before.as_ref().is_none_or(|b| b[i] != 0.0);
                self.holds[i] = match now[i] {
                    0.0 if has_jumped => !event.strict || motion > 0.0,
                    0.0 if motion == 0.0 => held,
                    0.0 => motion > 0.0,
                    distance => distance > 0.0,
                };
                if self.holds[i] && !held {
                    fired.push(i);
                }
            }
            if fired.is_empty() {
                return Some(());
            }
            before = Some(now);
            self.run(&fired);
        }
        None
    }

    /// Returns whether the time and the values of the last event are exact, and those of all events before it.
    fn is_exact(&self) -> bool {
        self.values.iter().chain([&self.t]).all(|number| (number / GRID).fract() == 0.0)
    }

    /// To the last event before a time, or to the first one that is not exact; `None` where events have no end before it.
    fn advance(&mut self, end: f64) -> Option<()> {
        loop {
            if !self.is_exact() {
                return Some(());
            }
            let distances = self.distances();
            let arrivals = self.case.events.iter().zip(&distances).filter_map(|(event, distance)| {
                let motion = event.motion(&self.rates);
                (distance * motion < 0.0).then(|| -distance / motion)
            });
            let wait = arrivals.fold(f64::INFINITY, f64::min);
            if self.t + wait > end {
                return Some(());
            }
            self.values = self.values_at(self.t + wait);
            self.t += wait;
            let now = self.distances();
            let mut fired = Vec::new();
            for (i, event) in self.case.events.iter().enumerate() {
                let rises = event.motion(&self.rates) > 0.0;
                match (now[i], distances[i]) {
                    // What stood at its threshold has left it.
                    (distance, _) if distance < 0.0 => self.holds[i] = false,
                    (0.0, before) if before != 0.0 && rises && !event.strict => {
                        self.holds[i] = true;
                        fired.push(i);
                    }
                    (0.0, before) if before != 0.0 && !rises => self.holds[i] = false,
                    _ => {}
                }
            }
            self.run(&fired);
            self.settle(Some(now))?;
        }
    }

    /// Values at a time before the next event.
    fn values_at(&self, t: f64) -> [f64; 2] {
        std::array::from_fn(|i| self.values[i] + self.rates[i] * (t - self.t))
    }
}

fn quarters(range: std::ops::RangeInclusive<i32>) -> impl Strategy<Value = f64> {
    range.prop_map(|q| f64::from(q) / 4.0)
}

fn rate() -> impl Strategy<Value = f64> {
    prop::sample::select(vec![-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
}

fn event() -> impl Strategy<Value = Event> {
    let change = |value: BoxedStrategy<f64>| prop::option::of((0..2_usize, value));
    (0..2_usize, any::<bool>(), any::<bool>(), quarters(-4..=4), change(rate().boxed()), change(quarters(-4..=4).boxed()))
        .prop_map(|(state, rises, strict, threshold, rate, reset)| Event { state, rises, strict, threshold, rate, reset })
}

fn case() -> impl Strategy<Value = Case> {
    let pair = |s: BoxedStrategy<f64>| (s.clone(), s).prop_map(|(a, b)| [a, b]);
    // Of the first three no event falls on the end of a step; of the others many do.
    let step = prop::sample::select(vec![0.37, 1.1, 2.9, 0.25, 0.5, 0.75, 1.0]);
    (pair(quarters(-4..=4).boxed()), pair(rate().boxed()), prop::collection::vec(event(), 1..5), step)
        .prop_map(|(start, rates, events, step)| Case { start, rates, events, step })
}

/// The method: this module's name.
fn method() -> Method {
    module_path!().rsplit("::").next().and_then(Method::from_name).expect("the name of a method")
}

/// An environment of a text at its start, with the method of this module.
fn environment(text: &str) -> Result<Environment, String> {
    let loaded = load_text(Path::new("random.eq"), text.to_owned(), &LoadOptions::default()).map_err(|e| e.to_string())?;
    let mut options = loaded.options;
    options.solver.method = Some(method());
    let setup = Setup::new(loaded.model, options, Some(loaded.sources)).map_err(|e| e.to_string())?;
    let mut environment = Environment::new(setup).map_err(|e| e.to_string())?;
    environment.reset(Some(0), &ResetOptions::default()).map_err(|e| e.to_string())?;
    Ok(environment)
}

fn check(case: &Case) -> Result<(), TestCaseError> {
    let text = case.text();
    let mut environment = environment(&text).map_err(|e| TestCaseError::fail(format!("{e}\n{text}")))?;
    let mut exact = Exact::new(case);
    let mut ends = exact.settle(None);
    for step in 1..=STEPS {
        let result = environment.step(&[]).expect("a step");
        ends = ends.and_then(|()| exact.advance(f64::from(step) * case.step));
        if !exact.is_exact() {
            return Ok(());
        }
        let failed = result.failure.is_some();
        prop_assert_eq!(ends.is_none(), failed, "step {}, {}\n{}", step, environment.failure_message(), text);
        let place = |name: &str| environment.catalogue().discretes.find(name).expect("there").at;
        let mut found: Vec<f64> = environment.unknowns().to_vec();
        let mut expected = exact.values_at(f64::from(step) * case.step).to_vec();
        if failed {
            let message = environment.failure_message();
            prop_assert!(message.starts_with("events: "), "{message}\n{text}");
            prop_assert!((result.time - exact.t).abs() < 1e-8, "{} {}\n{text}", result.time, exact.t);
            return Ok(());
        }
        found.extend((0..case.events.len()).map(|i| environment.discretes()[place(&format!("n{i}"))]));
        expected.extend(&exact.counts);
        let distance = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        prop_assert!(distance < 1e-7, "step {step}: {found:?}, exact {expected:?}\n{text}");
    }
    Ok(())
}

/// A case whose events approach a cycle: each is a quarter as far from its limit as the one before. Values of each step, by arithmetic of
/// fractions: of `y`, and how often `e2` and `e3` happen.
fn cycle() -> (Case, [(f64, f64); 3]) {
    let event = |state, rises, strict, threshold, rate, reset| Event { state, rises, strict, threshold, rate, reset };
    let events = vec![
        event(1, true, false, -1.0, None, None),
        event(0, true, false, -0.75, Some((1, 2.0)), Some((0, -0.5))),
        event(1, false, true, 0.25, Some((1, 0.5)), None),
        event(0, false, false, 0.25, Some((1, -2.0)), Some((0, 0.5))),
    ];
    let case = Case { start: [0.25, 0.25], rates: [-2.0, 0.5], events, step: 1.1 };
    (case, [(0.287_500_190_734_863_3, 9.0), (0.274_999_999_999_272_4, 18.0), (0.2625, 27.0)])
}

/// A room that cools towards `cold` and is heated towards `hot`, switched at `low` and `high`, from a start anywhere.
#[derive(Clone, Debug)]
struct Room {
    cold: f64,
    low: f64,
    high: f64,
    hot: f64,
    start: f64,
    step: f64,
}

impl Room {
    fn text(&self) -> String {
        format!(
            "model Room\ntime t : h\ndiscrete heat = 0\ndiscrete n = 0\nstate x = {} in -100..100\nvar flow = 1\n             eq d/dt x = flow / 1 [h]\neq flow = {} + ({})*heat - x\nevent cold when x <= {}\nevent warm when x >= {}\n             at cold {{ next heat = 1 ; next n = n + 1 }}\nat warm {{ next heat = 0 ; next n = n + 1 }}\nobserve x in -100..100\n             episode {{ step = {} [h], max_steps = {STEPS} }}\nsolver {{ rtol = 1e-10 }}\n",
            self.start,
            self.cold,
            self.hot - self.cold,
            self.low,
            self.high,
            self.step
        )
    }

    /// Temperature, number of switches, and heating at a time; exponentials one after another.
    fn exact(&self, end: f64) -> [f64; 3] {
        let (mut t, mut x, mut heats, mut count) = (0.0, self.start, false, 0.0);
        if x <= self.low {
            (heats, count) = (true, 1.0);
        } else if x >= self.high {
            count = 1.0;
        }
        loop {
            let (target, limit) = if heats { (self.hot, self.high) } else { (self.cold, self.low) };
            let wait = ((x - target) / (limit - target)).ln();
            if t + wait > end {
                return [target + (x - target) * (t - end).exp(), count, f64::from(u8::from(heats))];
            }
            (t, x, heats, count) = (t + wait, limit, !heats, count + 1.0);
        }
    }
}

fn room() -> impl Strategy<Value = Room> {
    (-10.0..10.0, 0.5..5.0, 0.2..5.0, 0.5..5.0, -20.0..30.0, 0.1..5.0).prop_map(
        |(cold, a, b, c, start, step): (f64, f64, f64, f64, f64, f64)| Room {
            cold,
            low: cold + a,
            high: cold + a + b,
            hot: cold + a + b + c,
            start,
            step,
        },
    )
}

fn check_room(room: &Room) -> Result<(), TestCaseError> {
    let mut environment = environment(&room.text()).map_err(TestCaseError::fail)?;
    for step in 1..=STEPS {
        let failure = environment.step(&[]).expect("a step").failure;
        prop_assert_eq!(failure, None);
        let [x, count, heats] = room.exact(f64::from(step) * room.step);
        let place = |name: &str| environment.catalogue().discretes.find(name).expect("there").at;
        let found = [environment.unknowns()[0], environment.discretes()[place("n")], environment.discretes()[place("heat")]];
        prop_assert!(
            (found[0] - x).abs() < 1e-5 && found[1..] == [count, heats],
            "step {step}: {found:?}, exact {x} {count} {heats}\n{}",
            room.text()
        );
    }
    Ok(())
}

/// One event that falls on the end of a step, but for the rounding of its threshold and of the integration, or near it.
#[derive(Clone, Debug)]
struct Coincidence {
    step: f64,
    /// Change of the state in a step, and its start in such changes.
    change: f64,
    start: f64,
    /// The step at whose end it happens.
    number: u32,
    /// Further delay, in steps.
    later: f64,
    condition: usize,
    strict: bool,
}

impl Coincidence {
    fn text(&self) -> String {
        let (rate, start) = (self.change / self.step, self.start * self.change);
        let steps = f64::from(self.number) + self.later;
        let threshold = start + self.change * steps;
        let equals = if self.strict { "" } else { "=" };
        let rises = if self.change > 0.0 { ">" } else { "<" };
        let condition = match self.condition {
            0 => format!("x {rises}{equals} {threshold}"),
            1 => format!("z {rises}{equals} {threshold}"),
            2 => format!("{threshold} - x {}{equals} 0", if self.change > 0.0 { "<" } else { ">" }),
            3 => format!("t >{equals} {} [s]", self.step * steps),
            _ => format!("clock >{equals} {} [s]", self.step * steps),
        };
        format!(
            "model Coincidence\ntime t : s\ndiscrete n = 0\ndiscrete at_time = 0\nstate x = {start}\nvar z = {start}\neq d/dt x = {rate} [1/s]\n\
             eq z^3 = x^3\nevent e when {condition}\nat e {{ next n = n + 1 ; next at_time = t/(1 [s]) }}\nobserve x in -1..1\n\
             episode {{ step = {} [s], max_steps = 20 }}\n",
            self.step
        )
    }
}

fn coincidence() -> impl Strategy<Value = Coincidence> {
    let change = prop_oneof![0.01..100.0, -100.0..-0.01];
    let later = prop::sample::select(vec![0.0, 0.0, 0.0, 1e-13, -1e-13, 1e-11, -1e-11, 1e-10, -1e-10, 1e-9, -1e-9, 1e-7, -1e-7]);
    let kind = (0..5_usize, any::<bool>());
    (0.001..100.0, change, 0.5..8.0, 1..=6_u32, later, kind).prop_map(|(step, change, start, number, later, (condition, strict))| {
        Coincidence { step, change, start, number, later, condition, strict }
    })
}

fn check_coincidence(case: &Coincidence) -> Result<(), TestCaseError> {
    let text = case.text();
    let mut environment = environment(&text).map_err(|e| TestCaseError::fail(format!("{e}\n{text}")))?;
    let place = |name: &str| environment.catalogue().discretes.find(name).expect("there").at;
    let (n, at_time) = (place("n"), place("at_time"));
    for step in 1..=case.number + 3 {
        prop_assert_eq!(environment.step(&[]).expect("a step").failure, None);
        // What is later by 1e-10 of the step is at the border.
        let last = case.number + u32::from(case.later > 1e-11);
        let open = step == case.number && case.later == 1e-10;
        let expected = if step < last { 0.0 } else { 1.0 };
        let count = environment.discretes()[n];
        prop_assert!(count == expected || (open && count == 1.0), "{} after step {} of {:?}\n{}", count, step, case, text);
    }
    let distance = (environment.discretes()[at_time] - (f64::from(case.number) + case.later) * case.step).abs();
    prop_assert!(distance < 1e-9 * case.step, "{distance}\n{text}");
    Ok(())
}

#[test]
fn events_that_approach_a_cycle_are_counted() {
    let (case, steps) = cycle();
    check(&case).expect("the comparison ends");
    let mut environment = environment(&case.text()).expect("the solver takes it");
    let place = |name: &str| environment.catalogue().discretes.find(name).expect("there").at;
    let places = [place("n2"), place("n3")];
    for (y, count) in steps {
        assert_eq!(environment.step(&[]).expect("a step").failure, None);
        assert!((environment.unknowns()[1] - y).abs() < 1e-7, "{} instead of {y}", environment.unknowns()[1]);
        assert_eq!(places.map(|at| environment.discretes()[at]), [count; 2]);
    }
}

/// Cases that random numbers found: a state is set to a threshold, and the polynomial of the next step begins off it by rounding.
fn resets_to_thresholds() -> Vec<Case> {
    let event = |state, rises, strict, threshold, rate, reset| Event { state, rises, strict, threshold, rate, reset };
    vec![
        Case {
            start: [1.0, -0.5],
            rates: [-2.0, -1.0],
            step: 0.5,
            events: vec![
                event(1, false, false, -0.25, None, None),
                event(1, false, false, -0.75, None, Some((1, -0.25))),
                event(0, false, true, 0.25, None, Some((1, -0.5))),
                event(0, true, true, 0.5, Some((0, -2.0)), None),
            ],
        },
        Case {
            start: [1.0, -1.0],
            rates: [1.0, 1.0],
            step: 0.75,
            events: vec![
                event(0, false, false, -0.5, None, None),
                event(0, true, false, 0.0, Some((0, -0.5)), Some((0, -0.5))),
                event(0, false, true, 0.0, None, None),
                event(0, false, false, -0.75, Some((0, 2.0)), None),
            ],
        },
        Case {
            start: [-1.0, -0.25],
            rates: [1.0, 0.5],
            step: 0.37,
            events: vec![
                event(0, true, true, -0.75, None, Some((1, 0.0))),
                event(1, false, true, -0.75, None, Some((0, -1.0))),
                event(1, true, false, 0.0, Some((1, -1.0)), Some((1, -0.75))),
            ],
        },
        Case {
            start: [0.5, -0.25],
            rates: [0.5, 1.0],
            step: 2.9,
            events: vec![
                event(1, true, true, 0.5, Some((1, 0.5)), None),
                event(0, false, true, -0.5, Some((0, 1.0)), Some((1, -1.0))),
                event(0, true, false, -0.25, Some((0, -1.0)), Some((1, 0.5))),
                event(1, false, true, 1.0, None, None),
            ],
        },
        Case {
            start: [-1.0, -1.0],
            rates: [0.5, -2.0],
            step: 2.9,
            events: vec![
                event(0, false, true, 1.0, None, None),
                event(0, true, false, 0.25, None, None),
                event(0, true, true, -0.5, Some((1, -2.0)), Some((0, 0.25))),
                event(1, true, false, 0.25, Some((1, -0.5)), Some((0, -0.5))),
            ],
        },
        Case {
            start: [0.75, 0.0],
            rates: [2.0, 1.0],
            step: 1.0,
            events: vec![
                event(0, true, true, 1.0, Some((0, 1.0)), Some((0, 0.75))),
                event(1, true, true, 0.0, Some((1, -0.5)), None),
                event(0, true, true, 0.75, None, None),
            ],
        },
        Case {
            start: [-1.0, 0.0],
            rates: [1.0, -0.5],
            step: 2.9,
            events: vec![
                event(0, true, true, 0.25, None, Some((0, 0.25))),
                event(1, true, false, 0.25, Some((0, 2.0)), Some((0, 0.5))),
                event(1, false, false, -0.75, Some((0, -0.5)), None),
                event(1, false, true, -0.5, None, Some((0, 0.25))),
            ],
        },
        Case {
            start: [0.0, -0.25],
            rates: [-0.5, -2.0],
            step: 1.1,
            events: vec![
                event(0, false, false, -0.75, Some((0, -1.0)), Some((1, -0.75))),
                event(1, false, true, -1.0, None, Some((0, 0.75))),
                event(0, true, true, 0.5, None, Some((0, -0.75))),
            ],
        },
    ]
}

#[test]
fn a_condition_that_holds_before_and_after_a_reset_to_its_threshold_does_not_happen() {
    for case in resets_to_thresholds() {
        check(&case).expect("the exact events");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn events_of_states_with_constant_rates_are_those_of_an_exact_simulation(case in case()) {
        check(&case)?;
    }

    #[test]
    fn an_event_at_the_end_of_a_step_belongs_to_that_step_alone(case in coincidence()) {
        check_coincidence(&case)?;
    }

    #[test]
    fn a_room_between_two_temperatures_follows_the_exponentials(room in room()) {
        check_room(&room)?;
    }
}
