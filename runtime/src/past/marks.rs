//! Times at which delayed values are not smooth.
//!
//! Where a value jumps at one time, delayed ones do a dead time later. Unknowns that follow them
//! have a kink there, and so on: each generation is smoother by one derivative (C. A. H. Paul,
//! *Math. Comput. Simul.* 37 (1994) 1-8). Those that a method would notice are breaks.

use serde::{Deserialize, Serialize};

/// Derivative that jumps: 0 for the value itself. Smoother places are left to the error test.
pub(super) type Level = u8;

/// The smoothest places that are breaks.
const SMOOTHEST: Level = 5;

/// Two times this near each other, in parts of the larger one, are one.
const NEAR: f64 = 2e-12;

/// A place at which a recorded value is not smooth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Mark {
    time: f64,
    level: Level,
    /// Distances of the first and the last jump that is one with it.
    #[serde(default)]
    reach: (f64, f64),
}

/// A place at which a delayed value is not smooth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Break {
    time: f64,
    /// The mark that it comes from.
    source: f64,
    level: Level,
    /// Left behind.
    done: bool,
    /// As of the mark.
    #[serde(default)]
    reach: (f64, f64),
}

/// Marks and breaks.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Marks {
    marks: Vec<Mark>,
    breaks: Vec<Break>,
}

/// Distance of two times that are one.
pub(super) fn near(time: f64) -> f64 {
    NEAR * time.abs()
}

/// Returns `true` if two times are one.
pub(super) fn are_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= near(b)
}

impl Marks {
    pub(super) fn clear(&mut self) {
        self.marks.clear();
        self.breaks.clear();
    }

    /// The next break.
    pub(super) fn next(&self) -> f64 {
        self.breaks.iter().filter(|b| !b.done).map(|b| b.time).fold(f64::INFINITY, f64::min)
    }

    /// Extent of the next breaks that are left behind together.
    pub(super) fn next_span(&self) -> (f64, f64) {
        let (mut first, mut last) = (self.next(), self.next());
        loop {
            let reach = last + near(last);
            let further = |last: f64, b: &Break| last.max(b.time + b.reach.1);
            let here = || self.breaks.iter().filter(|b| !b.done && b.time <= reach);
            first = here().map(|b| b.time + b.reach.0).fold(first, f64::min);
            let until = here().fold(last, further);
            if until <= last {
                return (first, last);
            }
            last = until;
        }
    }

    /// Breaks in a span of time at which delayed values jump: where each comes from, and how much
    /// later it is.
    pub(super) fn jumps_in(&self, (first, last): (f64, f64)) -> impl Iterator<Item = (f64, f64)> {
        let within = move |b: &&Break| b.time + b.reach.1 >= first && b.time + b.reach.0 <= last;
        let here = self.breaks.iter().filter(move |b| !b.done && b.level == 0 && within(b));
        here.map(|b| (b.source, b.time - b.source))
    }

    /// Notes a place with these distinct dead times behind it.
    pub(super) fn add(&mut self, time: f64, level: Level, lags: &[f64]) {
        if level > SMOOTHEST {
            return;
        }
        if let Some(mark) = self.marks.iter_mut().rev().find(|mark| (mark.time - time).abs() <= near(time)) {
            let distance = if level == 0 { time - mark.time } else { 0.0 };
            mark.level = mark.level.min(level);
            mark.reach = (mark.reach.0.min(distance), mark.reach.1.max(distance));
            let Mark { time, level, reach } = *mark;
            self.breaks.iter_mut().filter(|b| b.source == time).for_each(|b| (b.level, b.reach) = (level, reach));
            return;
        }
        let reach = (0.0, 0.0);
        self.marks.push(Mark { time, level, reach });
        self.breaks.extend(lags.iter().map(|lag| Break { time: time + lag, source: time, level, done: false, reach }));
    }

    /// An integration begins at a time: what was noted later is forgotten, and breaks up to there
    /// are left behind. Where delayed values read other delayed values `directly`, these are not
    /// smoother.
    pub(super) fn begin(&mut self, time: f64, directly: bool, lags: &[f64]) {
        let reach = time + near(time);
        self.marks.retain(|mark| mark.time <= reach);
        self.breaks.retain(|b| b.source <= reach);
        self.breaks.iter_mut().filter(|b| b.time > reach).for_each(|b| b.done = false);
        while let Some(at) = self.breaks.iter().position(|b| !b.done && b.time <= reach) {
            self.breaks[at].done = true;
            let Break { time, level, .. } = self.breaks[at];
            self.add(time, if directly { level } else { level + 1 }, lags);
        }
    }

    /// The dead times are others: breaks follow from the marks anew, as seen from a time.
    pub(super) fn renew(&mut self, time: f64, lags: &[f64]) {
        let reach = time + near(time);
        self.breaks.clear();
        for mark in &self.marks {
            let of = lags.iter().map(|lag| Break {
                time: mark.time + lag,
                source: mark.time,
                level: mark.level,
                done: false,
                reach: mark.reach,
            });
            self.breaks.extend(of.filter(|b| b.time > reach));
        }
    }

    /// Forgets what was earlier than a time and has no break later than that.
    pub(super) fn trim(&mut self, time: f64, longest: f64) {
        self.breaks.retain(|b| b.time >= time);
        self.marks.retain(|mark| mark.time + longest >= time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_generation_is_smoother_until_it_is_smooth_enough() {
        let (mut marks, lags) = (Marks::default(), [1.0]);
        marks.add(0.0, 1, &lags);
        let mut breaks = Vec::new();
        while marks.next().is_finite() {
            breaks.push(marks.next());
            marks.begin(marks.next(), false, &lags);
        }
        assert_eq!(breaks, [1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn a_break_that_was_passed_comes_again_where_the_integration_goes_back() {
        let (mut marks, lags) = (Marks::default(), [1.0]);
        marks.add(0.0, 0, &lags);
        marks.begin(1.0, false, &lags);
        assert_eq!(marks.next(), 2.0);
        marks.begin(0.5, false, &lags);
        assert_eq!(marks.next(), 1.0);
    }

    #[test]
    fn places_near_each_other_are_one() {
        let (mut marks, lags) = (Marks::default(), [1.0, 1.5]);
        marks.add(3.0, 2, &lags);
        marks.add(3.0 + 1e-12, 0, &lags);
        assert_eq!((marks.marks.len(), marks.breaks.len(), marks.breaks[0].level), (1, 2, 0));
        assert_eq!((marks.marks[0].time, marks.next()), (3.0, 4.0));
        assert_eq!(marks.next_span().1, 4.0 + (3.0 + 1e-12 - 3.0));
    }

    #[test]
    fn breaks_near_each_other_are_left_behind_together() {
        let (mut marks, lags) = (Marks::default(), [1.0, 0.5]);
        marks.add(1.0, 0, &lags);
        marks.add(1.5 + 1e-12, 0, &lags);
        marks.begin(1.5 + 2e-12, false, &lags);
        assert_eq!(marks.next_span(), (2.0, 2.0 + 1e-12));
        assert_eq!(marks.jumps_in(marks.next_span()).count(), 2);
        marks.begin(2.0 + 2e-12, false, &lags);
        assert_eq!(marks.next_span().0, 2.5);
    }
}
