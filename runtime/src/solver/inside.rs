//! The search for what happens inside of an accepted step.
//!
//! Root functions are known where a step begins and ends. In between they are bounded over parts of
//! the step, by bounds of the unknowns and by the compiled bounds of the functions. A part in which
//! the sign of each is certain contains no event; others are halved, until none is open or parts
//! are [`NARROWEST`] of the step. Parts that stay open are evaluated at their two ends. Only a
//! condition that becomes true and ceases to hold within such a part is not found.

use super::watch::{Closely, Open, Watch};

/// Width of a part that is not divided further, in parts of the step.
pub(crate) const NARROWEST: f64 = 1.0 / (1_u32 << 20) as f64;

/// Open parts that are kept at once: what comes later is looked at later.
const MOST_OPEN: usize = 32;

/// Bounds that are worked out at most in one step: beyond, parts are no longer divided.
const MOST_BOUNDS: u32 = 20_000;

/// Parts of a step at whose ends root functions are looked at that have no bounds.
const SAMPLES: u32 = 16;

/// A step of which the inside can be looked at.
pub(crate) trait Inside {
    /// Type of errors.
    type Error;

    /// Conditions and their values.
    fn watch(&mut self) -> &mut Watch;

    /// Writes the bounds of the root functions between two times within the step.
    fn bound(&mut self, from: f64, to: f64) -> Result<(), Self::Error>;

    /// Writes the root functions at a time within the step.
    fn look(&mut self, t: f64) -> Result<(), Self::Error>;
}

/// Returns whether kinks that are looked at in every step have not been passed in one that events
/// and jumps do not concern. The values are those at its end afterwards.
pub(crate) fn stays<I: Inside>(step: &mut I, (from, to): (f64, f64)) -> Result<bool, I::Error> {
    if step.watch().stale {
        step.look(from)?;
    }
    let watch = step.watch();
    watch.stale = false;
    std::mem::swap(&mut watch.begin, &mut watch.values);
    step.look(from + 0.5 * (to - from))?;
    let watch = step.watch();
    std::mem::swap(&mut watch.ahead, &mut watch.values);
    step.look(to)?;
    let watch = step.watch();
    let still = watch.is_loose_still();
    if still {
        watch.note_quiet((from, to));
    }
    Ok(still)
}

/// Looks into a step whose bounds leave something open; whether something happens in it. The bounds
/// of what is watched are those within the tolerances of the unknowns at its end.
pub(crate) fn looks_into<I: Inside>(step: &mut I, (from, to): (f64, f64), (open, closely): (Open, Closely)) -> Result<bool, I::Error> {
    // The values at the end are looked at again where the search comes there.
    let watch = step.watch();
    std::mem::swap(&mut watch.ahead, &mut watch.values);
    for (k, t) in [(0, from), (1, from + 0.25 * (to - from)), (2, from + 0.5 * (to - from)), (3, from + 0.75 * (to - from))] {
        step.look(t)?;
        let watch = step.watch();
        let place = if k == 0 { &mut watch.begin } else { &mut watch.samples[k - 1] };
        std::mem::swap(&mut watch.values, place);
    }
    let watch = step.watch();
    std::mem::swap(&mut watch.ahead, &mut watch.values);
    watch.begin_search(closely);
    if !watch.is_search_due(open) && !watch.has_unbounded() {
        return Ok(watch.accept(to));
    }
    happens(step, (from, to))
}

/// A part of a step.
#[derive(Clone, Copy, Default)]
struct Subinterval {
    from: f64,
    to: f64,
}

/// Looks for the first thing that happens in a step; whether there is something. What is watched
/// has accepted the beginning, and afterwards what was looked at last before something happened.
fn happens<I: Inside>(step: &mut I, (from, to): (f64, f64)) -> Result<bool, I::Error> {
    let samples = if step.watch().has_unbounded() { SAMPLES } else { 1 };
    let mut left = MOST_BOUNDS;
    let mut begin = from;
    for k in 1..=samples {
        let end = if k == samples { to } else { from + (to - from) * f64::from(k) / f64::from(samples) };
        let mut whole = Subinterval { from: begin, to: end };
        while whole.from < end {
            let (open, count, until) = open_parts(step, whole, NARROWEST * (to - from), &mut left)?;
            for part in &open[..count] {
                for t in [part.from, part.to] {
                    step.look(t)?;
                    if step.watch().accept(t) {
                        return Ok(true);
                    }
                }
            }
            whole.from = until;
        }
        step.look(end)?;
        if step.watch().accept(end) {
            return Ok(true);
        }
        begin = end;
    }
    Ok(false)
}

/// The first parts that stay open when they are as narrow as this, their number, and the time up to
/// which there are no others.
fn open_parts<I: Inside>(
    step: &mut I,
    whole: Subinterval,
    narrowest: f64,
    left: &mut u32,
) -> Result<([Subinterval; MOST_OPEN], usize, f64), I::Error> {
    let mut open = [Subinterval::default(); MOST_OPEN];
    let (mut count, mut until) = (0, whole.to);
    if is_open(step, whole, left)? {
        (open[0], count) = (whole, 1);
    }
    while count > 0 && open[0].to - open[0].from > narrowest && *left > 0 {
        let mut next = [Subinterval::default(); MOST_OPEN];
        let mut found = 0;
        'parts: for part in &open[..count] {
            let middle = part.from + (part.to - part.from) / 2.0;
            for half in [Subinterval { from: part.from, to: middle }, Subinterval { from: middle, to: part.to }] {
                if !is_open(step, half, left)? {
                    continue;
                }
                if found == MOST_OPEN {
                    until = half.from;
                    break 'parts;
                }
                next[found] = half;
                found += 1;
            }
        }
        (open, count) = (next, found);
    }
    Ok((open, count, until))
}

/// Returns whether the bounds over a part leave a sign open. A part that can no longer be bounded
/// is open.
fn is_open<I: Inside>(step: &mut I, part: Subinterval, left: &mut u32) -> Result<bool, I::Error> {
    if *left == 0 {
        return Ok(true);
    }
    *left -= 1;
    step.bound(part.from, part.to)?;
    Ok(step.watch().may_change())
}
