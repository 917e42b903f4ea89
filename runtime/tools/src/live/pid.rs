//! A PID loop on one pair: the positional form of `smpl.controllers.PID` with back calculation, so
//! that both give the same actions.

use smpl_runtime::catalogue::UnknownName;
use smpl_runtime::environment::Environment;

use super::settings::PidSettings;
use super::wire::Fault;

/// Largest gain of the derivative over that of the loop.
const FILTER: f64 = 10.0;

/// The place of the measured variable.
#[derive(Clone, Copy, Debug)]
enum Measured {
    Observation(usize),
    State(usize),
}

/// The running loop.
pub(crate) struct Pid {
    measured: Measured,
    /// Place of the action among the actions.
    pub(crate) action: usize,
    gain: f64,
    integral_time: f64,
    derivative_time: f64,
    set_point: f64,
    interval: f64,
    limits: (f64, f64),
    integral: f64,
    derivative: f64,
    last: Option<f64>,
    readings: Vec<f64>,
}

impl Pid {
    /// A loop at the beginning of an episode. Without a set-point it regulates to the steady state,
    /// else to the present value.
    ///
    /// # Errors
    /// Unknown names, or settings that are not numbers of the right sign.
    pub(crate) fn new(settings: &PidSettings, environment: &Environment, base: &[f64]) -> Result<Self, Fault> {
        let (measured, action) = places(settings, environment)?;
        let integral_time = settings.integral_time.unwrap_or(f64::INFINITY);
        if !(settings.gain.is_finite() && integral_time > 0.0 && settings.derivative_time >= 0.0 && settings.derivative_time.is_finite()) {
            return Err(Fault::setting("the loop needs a finite gain, a positive integral time and a derivative time of at least 0"));
        }
        let element = &environment.catalogue().actions.elements()[action];
        let mut pid = Self {
            measured,
            action,
            gain: settings.gain,
            integral_time,
            derivative_time: settings.derivative_time,
            set_point: 0.0,
            interval: environment.setup().model().interface().episode.step,
            limits: (element.low, element.high),
            integral: base[action],
            derivative: 0.0,
            last: None,
            readings: vec![0.0; environment.observation_len()],
        };
        pid.set_point = settings.set_point.unwrap_or_else(|| pid.rest(environment));
        Ok(pid)
    }

    /// The set-point.
    pub(crate) fn set_point(&self) -> f64 {
        self.set_point
    }

    /// The value in the steady state, else the present one.
    fn rest(&mut self, environment: &Environment) -> f64 {
        let name = match self.measured {
            Measured::State(at) => return rest_of(environment, at).unwrap_or_else(|| self.value(environment)),
            Measured::Observation(at) => &environment.setup().model().interface().finish.observations[at].name,
        };
        let state = environment.catalogue().states.find(name).and_then(|state| rest_of(environment, state.at));
        state.unwrap_or_else(|| self.value(environment))
    }

    fn value(&mut self, environment: &Environment) -> f64 {
        match self.measured {
            Measured::State(at) => environment.unknowns()[at],
            Measured::Observation(at) => {
                environment.observe(false, &mut self.readings);
                self.readings[at]
            }
        }
    }

    /// The action for the coming step.
    pub(crate) fn next(&mut self, environment: &Environment) -> f64 {
        let measurement = self.value(environment);
        let error = self.set_point - measurement;
        self.differentiate(measurement);
        let wanted = self.gain * error + self.integral + self.derivative;
        let action = wanted.max(self.limits.0).min(self.limits.1);
        self.integral += self.gain * self.interval / self.integral_time * error;
        if self.integral_time.is_finite() {
            let natural = if self.derivative_time > 0.0 { (self.integral_time * self.derivative_time).sqrt() } else { self.integral_time };
            self.integral += self.interval / natural.max(self.interval) * (action - wanted);
        }
        action
    }

    fn differentiate(&mut self, measurement: f64) {
        let last = self.last.unwrap_or(measurement);
        if self.derivative_time > 0.0 {
            let (time, slope) = (self.derivative_time, FILTER * self.interval);
            self.derivative = (time * self.derivative - self.gain * time * FILTER * (measurement - last)) / (time + slope);
        }
        self.last = Some(measurement);
    }
}

/// The value of a state in the steady state, where there is one.
fn rest_of(environment: &Environment, at: usize) -> Option<f64> {
    let declared = environment.setup().model().interface().steady.is_some();
    environment.steady_state().get(at).copied().filter(|x| declared && x.is_finite())
}

fn places(settings: &PidSettings, environment: &Environment) -> Result<(Measured, usize), Fault> {
    let catalogue = environment.catalogue();
    let observations = &environment.setup().model().interface().finish.observations;
    let name = settings.measured.as_str();
    let observed = name.strip_prefix("obs.").and_then(|name| observations.iter().position(|o| o.name == name));
    let measured = observed
        .map(Measured::Observation)
        .or_else(|| catalogue.states.find(name).map(|element| Measured::State(element.at)))
        .ok_or_else(|| {
        let known: Vec<String> = observations.iter().map(|o| format!("obs.{}", o.name)).collect();
        let known = known.iter().map(String::as_str).chain(catalogue.states.names());
        Fault::setting(UnknownName::new("measured variable", name, known))
    })?;
    let action = catalogue
        .actions
        .position(&settings.action)
        .ok_or_else(|| Fault::setting(UnknownName::new("action", &settings.action, catalogue.actions.names())))?;
    Ok((measured, action))
}
