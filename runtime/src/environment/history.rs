//! The past of an episode that is given from outside.

use super::Environment;
use super::reset::{ResetError, ResetOptions};
use crate::catalogue::Family;
use crate::past::{History, Samples};

impl Environment {
    /// Replaces the past that follows from the start by the given one, which the start may read.
    pub(super) fn take_history(&mut self, options: &ResetOptions) -> Result<(), ResetError> {
        let Some(history) = &options.history else { return Ok(()) };
        let refused = |message: &str| Err(ResetError::History { message: message.to_owned() });
        if self.system.model().model().delayed() == 0 {
            return refused("the model has no `delay` that reads one");
        }
        let History { times, states, actions } = history;
        let rises = times.windows(2).all(|pair| pair[0] < pair[1]);
        if !(rises && times.iter().all(|time| time.is_finite() && *time < 0.0) && !times.is_empty()) {
            return refused("times must increase and be before the start, below 0");
        }
        let setup = std::sync::Arc::clone(&self.setup);
        let start = self.time();
        let samples = Samples {
            times: times.iter().map(|time| start + time).collect(),
            states: rows(&setup.catalogue.states, states, (times.len(), setup.model().states()))?,
            actions: rows(&setup.catalogue.actions, actions, (times.len(), setup.catalogue.actions.len()))?,
        };
        self.system.record_samples(start, &self.progress.y, &self.progress.yp, &samples)?;
        self.initial_values(options)?;
        self.refuse_broken_start()
    }
}

/// Rows in internal order, of so many numbers each.
fn rows(family: &Family, given: &[f64], (count, width): (usize, usize)) -> Result<Vec<f64>, ResetError> {
    if given.is_empty() {
        return Ok(Vec::new());
    }
    let elements = family.elements();
    if given.len() != count * elements.len() {
        let message = format!("{} numbers for {count} times, expected {}", given.len(), count * elements.len());
        return Err(ResetError::History { message });
    }
    let mut rows = vec![0.0; count * width];
    for (row, given) in rows.chunks_exact_mut(width).zip(given.chunks_exact(elements.len())) {
        for (element, &value) in elements.iter().zip(given) {
            if !value.is_finite() {
                return Err(ResetError::NotFinite { what: format!("history of `{}`", element.name) });
            }
            row[element.at] = value;
        }
    }
    Ok(rows)
}
