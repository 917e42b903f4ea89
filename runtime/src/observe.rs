//! From what the process is to what an agent sees: sampling interval, noise, delay, clipping,
//! normalisation.

use serde::{Deserialize, Serialize};
use smpl_compiler::model::{Observed, Variate};

use crate::catalogue::Element;
use crate::random::{AT_RESET, EpisodeKey, Stream, hash};

/// The measuring chain of one instance.
#[derive(Clone, Debug)]
pub(crate) struct Sensors {
    channels: Vec<Channel>,
    /// No channel samples, delays or adds noise.
    plain: bool,
}

/// Measurements of the measuring chain.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Readings {
    /// Present readings, physical units, unclipped.
    pub present: Vec<f64>,
    /// Those without a finite value: the last one is kept.
    pub missing: Vec<bool>,
    /// Values on their way to be reported, channel after channel.
    pub pipeline: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    low: f64,
    high: f64,
    every: u32,
    /// Place and length of the channel's ring in the pipeline.
    ring: (usize, usize),
    noise: f64,
    stream: u64,
}

impl Sensors {
    pub(crate) fn new(observations: &[Observed], noise: &[f64]) -> Self {
        let mut start = 0;
        let channels: Vec<Channel> = observations
            .iter()
            .zip(noise)
            .map(|(o, &noise)| {
                let length = o.delay as usize;
                let channel = Channel {
                    low: o.low,
                    high: o.high,
                    every: o.every.max(1),
                    ring: (start, length),
                    noise,
                    stream: hash(&format!("noise:{}", o.name)),
                };
                start += length;
                channel
            })
            .collect();
        let plain = channels.iter().all(|c| c.every == 1 && c.ring.1 == 0 && c.noise == 0.0);
        Self { plain, channels }
    }

    /// Readings of zero, of the right lengths.
    pub(crate) fn blank(&self) -> Readings {
        let delayed = self.channels.iter().map(|c| c.ring.1).sum();
        let channels = self.channels.len();
        Readings { present: vec![0.0; channels], missing: vec![false; channels], pipeline: vec![0.0; delayed] }
    }

    /// First readings of an episode; a delayed channel reports them until its first sample arrives.
    pub(crate) fn reset(&self, readings: &mut Readings, key: Option<EpisodeKey>, values: &[f64]) {
        for (i, (channel, &value)) in self.channels.iter().zip(values).enumerate() {
            let reading = value + channel.error(key, AT_RESET);
            readings.present[i] = reading;
            readings.missing[i] = false;
            readings.pipeline[channel.ring.0..channel.ring.0 + channel.ring.1].fill(reading);
        }
    }

    /// Readings after `steps` completed steps.
    pub(crate) fn read(&self, readings: &mut Readings, key: Option<EpisodeKey>, steps: u32, values: &[f64]) {
        for ((missing, present), &value) in readings.missing.iter_mut().zip(&mut readings.present).zip(values) {
            *missing = !value.is_finite();
            if self.plain && !*missing {
                *present = value;
            }
        }
        if self.plain {
            return;
        }
        for (i, (channel, &value)) in self.channels.iter().zip(values).enumerate() {
            let value = if value.is_finite() { value } else { readings.present[i] };
            let (start, delay) = channel.ring;
            let due = |step: u32| step.is_multiple_of(channel.every);
            if delay == 0 {
                if due(steps) {
                    readings.present[i] = value + channel.error(key, steps);
                }
                continue;
            }
            // The slot of this step holds what was sampled `delay` steps ago.
            let slot = start + steps as usize % delay;
            if steps as usize >= delay && due(steps - delay as u32) {
                readings.present[i] = readings.pipeline[slot];
            }
            readings.pipeline[slot] = value + if due(steps) { channel.error(key, steps) } else { 0.0 };
        }
    }

    /// Writes the readings, clipped to their boxes.
    pub(crate) fn write<T: Number>(&self, readings: &Readings, normalised: bool, out: &mut [T]) {
        for ((channel, &reading), out) in self.channels.iter().zip(&readings.present).zip(out) {
            let value = channel.clip(reading);
            *out = T::from_f64(if normalised { normalise(value, channel.low, channel.high) } else { value }, channel.within(normalised));
        }
    }
}

impl Channel {
    /// Error of a measurement; none without a key.
    fn error(&self, key: Option<EpisodeKey>, step: u32) -> f64 {
        match key {
            Some(key) if self.noise != 0.0 => self.noise * Stream::from_hash(key, self.stream).normal(step, 0),
            _ => 0.0,
        }
    }

    /// Inside the box. Readings are numbers.
    fn clip(&self, value: f64) -> f64 {
        if value > self.high {
            self.high
        } else if value < self.low {
            self.low
        } else {
            value
        }
    }

    fn within(&self, normalised: bool) -> (f64, f64) {
        if normalised && (self.high - self.low).is_finite() { (-1.0, 1.0) } else { (self.low, self.high) }
    }
}

/// A value in [-1, 1]; unchanged where the bounds are open, 0 where they are one number.
#[must_use]
pub fn normalise(value: f64, low: f64, high: f64) -> f64 {
    let range = high - low;
    if !range.is_finite() {
        value
    } else if range > 0.0 {
        (2.0 * value - (high + low)) / range
    } else {
        0.0
    }
}

/// Scale of the actions and observations that a caller sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normalisation {
    /// Physical units.
    Off,
    /// Bounds are -1 and 1.
    Box,
    /// As [`Box`](Self::Box), but 0 of an action is its default.
    Nominal,
}

impl Normalisation {
    /// Returns `true` if observations are in [-1, 1].
    #[must_use]
    pub fn scales(self) -> bool {
        self != Self::Off
    }

    /// An action in physical units.
    #[must_use]
    pub fn physical(self, value: f64, element: &Element) -> f64 {
        match self {
            Self::Off => value,
            Self::Box => denormalise(value, element.low, element.high),
            Self::Nominal => around(value, element.low, element.default, element.high),
        }
    }
}

/// A value by its share of the way from a middle to one of its bounds: exactly these at -1, 0, 1.
fn around(share: f64, low: f64, middle: f64, high: f64) -> f64 {
    let end = if share < 0.0 { low } else { high };
    (1.0 - share.abs()) * middle + share.abs() * end
}

/// The inverse of [`normalise`]: where the bounds are one number, that number. NaN stays NaN.
#[must_use]
pub fn denormalise(value: f64, low: f64, high: f64) -> f64 {
    let range = high - low;
    if range.is_finite() { (value * range + high + low) / 2.0 } else { value }
}

/// Numbers that observations are written as.
pub trait Number: Copy + Send + Sync {
    /// The nearest number inside the box that a caller would form of (low, high) by rounding.
    fn from_f64(value: f64, within: (f64, f64)) -> Self;
}

impl Number for f64 {
    fn from_f64(value: f64, within: (f64, f64)) -> Self {
        if value > within.1 {
            within.1
        } else if value < within.0 {
            within.0
        } else {
            value
        }
    }
}

impl Number for f32 {
    fn from_f64(value: f64, within: (f64, f64)) -> Self {
        let (low, high) = (within.0 as f32, within.1 as f32);
        let value = value as f32;
        if value > high {
            high
        } else if value < low {
            low
        } else {
            value
        }
    }
}

/// One variate of a stream.
pub(crate) fn variate(stream: &Stream, kind: Variate, step: u32, element: u32) -> f64 {
    match kind {
        Variate::Uniform => stream.uniform(step, element),
        Variate::Normal => stream.normal(step, element),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observed(every: u32, delay: u32) -> Observed {
        Observed { name: "x".into(), unit: "1".into(), low: 0.0, high: 10.0, every, delay, noise: 0.0 }
    }

    fn readings(every: u32, delay: u32, steps: u32) -> Vec<f64> {
        let sensors = Sensors::new(&[observed(every, delay)], &[0.0]);
        let mut readings = sensors.blank();
        sensors.reset(&mut readings, None, &[0.0]);
        (1..=steps)
            .map(|step| {
                sensors.read(&mut readings, None, step, &[f64::from(step)]);
                readings.present[0]
            })
            .collect()
    }

    #[test]
    fn a_delayed_channel_reports_what_was_some_steps_ago() {
        assert_eq!(readings(1, 2, 5), [0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_sampled_channel_holds_its_value() {
        assert_eq!(readings(3, 0, 7), [0.0, 0.0, 3.0, 3.0, 3.0, 6.0, 6.0]);
    }

    #[test]
    fn a_sample_arrives_late_and_is_held() {
        assert_eq!(readings(3, 2, 9), [0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 6.0, 6.0]);
    }

    #[test]
    fn bounds_of_one_number_are_that_number() {
        for value in [-1.0, 0.0, 0.25, 1.0, 7.0] {
            assert_eq!((denormalise(value, 3.0, 3.0), normalise(value, 3.0, 3.0)), (3.0, 0.0));
            assert_eq!((denormalise(value, 1.0, f64::INFINITY), normalise(value, 1.0, f64::INFINITY)), (value, value));
        }
        assert!(denormalise(f64::NAN, 3.0, 3.0).is_nan());
        assert_eq!((denormalise(-0.5, 2.0, 6.0), normalise(3.0, 2.0, 6.0)), (3.0, -0.5));
    }

    #[test]
    fn actions_around_the_default_meet_it_and_the_bounds_exactly() {
        let ends = (15.0, 26.85, 35.0);
        let scaled = |share| around(share, ends.0, ends.1, ends.2);
        assert_eq!((scaled(-1.0), scaled(0.0), scaled(1.0)), ends);
        assert!((scaled(0.5) - 30.925).abs() < 1e-14 && (scaled(-0.5) - 20.925).abs() < 1e-14);
        assert!(scaled(2.0) > ends.2 && scaled(-2.0) < ends.0 && scaled(f64::NAN).is_nan());
    }

    #[test]
    fn observations_are_clipped_to_their_box_and_kept_where_there_is_none() {
        for (every, delay) in [(1, 0), (1, 1), (2, 0)] {
            let sensors = Sensors::new(&[observed(every, delay)], &[0.0]);
            let mut readings = sensors.blank();
            sensors.reset(&mut readings, None, &[5.0]);
            for (step, (value, expected)) in
                [(12.0, 1.0), (f64::NAN, 1.0), (-1.0, -1.0), (f64::INFINITY, -1.0), (2.5, -0.5)].iter().enumerate()
            {
                for repeated in 0..2 {
                    sensors.read(&mut readings, None, 2 * step as u32 + repeated, &[*value]);
                }
                let mut out = [0.0_f32];
                sensors.write(&readings, true, &mut out);
                assert_eq!((f64::from(out[0]), readings.missing[0]), (*expected, !value.is_finite()), "{every} {delay} {value}");
            }
        }
    }
}
