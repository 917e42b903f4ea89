//! Recorded values: polynomials over pieces of the past.

use serde::{Deserialize, Serialize};

use crate::solver::nodes::NODES;
pub(super) use crate::solver::nodes::shares as nodes;

/// Coefficients of a polynomial in Chebyshev's basis.
pub(super) const TERMS: usize = NODES;

/// Roundings of the present time by which an earlier time may miss the beginning of a piece.
pub(super) const ROUNDINGS: f64 = 4.0 * f64::EPSILON;

/// A span of time over which all recorded values are polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Piece {
    /// Times between which it holds.
    pub from: f64,
    pub to: f64,
    /// Beginning and length of the span that the polynomials are made for: it begins roundings
    /// behind a break.
    begin: f64,
    length: f64,
}

/// Place within a piece, with the basis there.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    piece: usize,
    basis: [f64; TERMS],
    rates: [f64; TERMS],
    /// Time beyond the end of what is recorded; negative before its beginning.
    pub beyond: f64,
}

/// The past of some values.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Record {
    /// Number of values.
    width: usize,
    pieces: Vec<Piece>,
    /// Coefficients, piece after piece and value after value.
    terms: Vec<f64>,
    /// Largest size of each value.
    sizes: Vec<f64>,
}

/// Coefficients of the polynomial through values at the nodes. Those of equal values are exact.
fn coefficients(values: impl Fn(usize) -> f64) -> [f64; TERMS] {
    let last = TERMS - 1;
    let first = values(0);
    let differences: [f64; TERMS] = std::array::from_fn(|k| values(k) - first);
    let mut terms: [f64; TERMS] = std::array::from_fn(|n| {
        let term = |k: usize| {
            // Nodes rise where the cosine falls.
            let cosine = (std::f64::consts::PI * (n * (last - k)) as f64 / last as f64).cos();
            let weight = if k == 0 || k == last { 0.5 } else { 1.0 };
            weight * differences[k] * cosine
        };
        let sum: f64 = (0..TERMS).map(term).sum();
        sum * if n == 0 || n == last { 1.0 } else { 2.0 } / last as f64
    });
    terms[0] += first;
    terms
}

impl Record {
    /// An empty past of so many values.
    pub(super) fn new(width: usize) -> Self {
        Self { width, pieces: Vec::new(), terms: Vec::new(), sizes: vec![0.0; width] }
    }

    pub(super) fn clear(&mut self) {
        self.pieces.clear();
        self.terms.clear();
        self.sizes.fill(0.0);
    }

    /// The end of what is recorded.
    pub(super) fn end(&self) -> f64 {
        self.pieces.last().map_or(f64::NEG_INFINITY, |piece| piece.to)
    }

    /// Spans of time of the pieces.
    pub(super) fn spans(&self) -> Vec<(f64, f64)> {
        self.pieces.iter().map(|piece| (piece.from, piece.to)).collect()
    }

    /// Largest size of a value so far.
    pub(super) fn size(&self, value: usize) -> f64 {
        self.sizes[value]
    }

    /// Adds a piece through values at its nodes from `begin` on, node after node.
    pub(super) fn push(&mut self, from: f64, (begin, to): (f64, f64), samples: &[f64]) {
        for value in 0..self.width {
            self.terms.extend(coefficients(|node| samples[node * self.width + value]));
            let largest = (0..TERMS).map(|node| samples[node * self.width + value].abs()).fold(0.0, f64::max);
            self.sizes[value] = self.sizes[value].max(largest);
        }
        self.pieces.push(Piece { from, to, begin, length: to - begin });
    }

    /// Returns `true` if the last terms of the polynomials of the last piece are small: in parts of
    /// the size of each value.
    pub(super) fn is_resolved(&self, tolerance: f64) -> bool {
        let last = &self.terms[self.terms.len() - TERMS * self.width..];
        last.chunks_exact(TERMS).zip(&self.sizes).all(|(terms, size)| {
            let rest = terms[TERMS - 1].abs() + terms[TERMS - 2].abs();
            rest <= tolerance * size || !rest.is_finite()
        })
    }

    /// Takes the last piece back.
    pub(super) fn pop(&mut self) {
        self.pieces.pop();
        self.terms.truncate(self.pieces.len() * TERMS * self.width);
    }

    /// Forgets what is later than a time.
    pub(super) fn cut(&mut self, time: f64) {
        while self.pieces.len() > 1 && self.pieces.last().is_some_and(|piece| piece.from >= time) {
            self.pop();
        }
        if let Some(piece) = self.pieces.last_mut() {
            piece.to = piece.to.min(time.max(piece.from));
        }
    }

    /// Removes very short pieces at the end, over which the piece before them continues: steps on
    /// both sides of an event.
    pub(super) fn forget_short(&mut self, least: f64) {
        while self.pieces.len() > 1 && self.pieces.last().is_some_and(|piece| piece.to - piece.from <= least) {
            self.pop();
        }
    }

    /// Forgets what is earlier than a time.
    pub(super) fn trim(&mut self, time: f64) {
        let gone = self.pieces.partition_point(|piece| piece.to < time).min(self.pieces.len().saturating_sub(1));
        self.pieces.drain(..gone);
        self.terms.drain(..gone * TERMS * self.width);
    }

    /// The place of an earlier time, which is in a piece that begins within this reach behind it.
    pub(super) fn locate(&self, at: f64, reach: f64) -> Spot {
        let piece = self.pieces.partition_point(|piece| piece.from <= at + reach).saturating_sub(1);
        let mut spot = Spot { piece, basis: [0.0; TERMS], rates: [0.0; TERMS], beyond: 0.0 };
        let Some(&Piece { from, begin, length, .. }) = self.pieces.get(piece) else { return spot };
        let end = if piece + 1 == self.pieces.len() { self.end() } else { f64::INFINITY };
        spot.beyond = if at < from && piece == 0 { at - from } else { (at - end).max(0.0) };
        let share = (at.min(end).max(from) - begin) / length;
        let x = 2.0 * share - 1.0;
        let slope = 2.0 / length;
        (spot.basis[0], spot.basis[1], spot.rates[1]) = (1.0, x, slope);
        for n in 2..TERMS {
            spot.basis[n] = 2.0 * x * spot.basis[n - 1] - spot.basis[n - 2];
            spot.rates[n] = 2.0 * (slope * spot.basis[n - 1] + x * spot.rates[n - 1]) - spot.rates[n - 2];
        }
        spot
    }

    /// Value and rate at a place; beyond the end they go on along a straight line, before the
    /// beginning the value stays.
    pub(super) fn at(&self, spot: &Spot, value: usize) -> (f64, f64) {
        let first = (spot.piece * self.width + value) * TERMS;
        let Some(terms) = self.terms.get(first..first + TERMS) else { return (f64::NAN, f64::NAN) };
        let sum = |basis: &[f64; TERMS]| (0..TERMS).rev().map(|n| terms[n] * basis[n]).sum::<f64>();
        let (now, rate) = (sum(&spot.basis), sum(&spot.rates));
        match spot.beyond {
            beyond if beyond < 0.0 => (now, 0.0),
            beyond if beyond > 0.0 => (now + beyond * rate, rate),
            _ => (now, rate),
        }
    }

    /// Bounds of a value between two times; infinite beyond what is recorded.
    pub(super) fn bounds(&self, (from, to): (f64, f64), value: usize) -> (f64, f64) {
        if to > self.end() {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        let first = self.pieces.partition_point(|piece| piece.to < from);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (at, piece) in self.pieces.iter().enumerate().skip(first.saturating_sub(1)).take_while(|(_, piece)| piece.from <= to) {
            let (begin, end) = (from.clamp(piece.from, piece.to), to.clamp(piece.from, piece.to));
            let terms = &self.terms[(at * self.width + value) * TERMS..][..TERMS];
            let sum = |weight: fn(usize) -> f64| (1..TERMS).map(|n| weight(n) * terms[n].abs()).sum::<f64>();
            let middle = 0.5 * (begin + end);
            let (centre, _) = self.at(&Spot { piece: at, ..self.inside(at, middle) }, value);
            let reach = 0.5 * (end - begin) * sum(|n| (n * n) as f64) * 2.0 / piece.length;
            let whole = sum(|_| 1.0);
            low = low.min((centre - reach).max(terms[0] - whole));
            high = high.max((centre + reach).min(terms[0] + whole));
        }
        (low, high)
    }

    /// The place of a time in a piece.
    fn inside(&self, piece: usize, time: f64) -> Spot {
        let one = &self.pieces[piece];
        let x = 2.0 * (time - one.begin) / one.length - 1.0;
        let mut basis = [1.0, x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        (2..TERMS).for_each(|n| basis[n] = 2.0 * x * basis[n - 1] - basis[n - 2]);
        Spot { piece, basis, rates: [0.0; TERMS], beyond: 0.0 }
    }

    /// Returns `true` if the numbers belong together, and are of so many values.
    pub(super) fn fits(&self, width: usize) -> bool {
        let rises = self.pieces.windows(2).all(|pair| pair[0].from < pair[1].from);
        let sized = self.pieces.iter().all(|piece| piece.length > 0.0 && piece.from <= piece.to);
        self.width == width && self.sizes.len() == width && rises && sized && self.terms.len() == self.pieces.len() * TERMS * width
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The past of one function over pieces with these ends.
    fn record(f: fn(f64) -> f64, ends: &[f64]) -> Record {
        let mut record = Record::new(1);
        for pair in ends.windows(2) {
            let samples = nodes().map(|node| f(pair[0] + node * (pair[1] - pair[0])));
            record.push(pair[0], (pair[0], pair[1]), &samples);
        }
        record
    }

    #[test]
    fn polynomials_of_degree_seven_are_kept_with_their_rates() {
        let kept = record(|t| t.powi(7) - 3.0 * t.powi(2), &[-1.0, 0.0, 2.0]);
        for i in 0..=30 {
            let t = -1.0 + 0.1 * f64::from(i);
            let (value, rate) = kept.at(&kept.locate(t, 0.0), 0);
            assert!((value - (t.powi(7) - 3.0 * t * t)).abs() < 1e-12, "{t}: {value}");
            assert!((rate - (7.0 * t.powi(6) - 6.0 * t)).abs() < 1e-10, "{t}: {rate}");
        }
    }

    #[test]
    fn equal_values_are_kept_exactly() {
        let kept = record(|_| 0.1, &[0.0, 0.3]);
        assert_eq!(kept.at(&kept.locate(0.1, 0.0), 0), (0.1, 0.0));
    }

    #[test]
    fn bounds_contain_the_values_and_become_narrow_with_the_span() {
        let kept = record(f64::sin, &[0.0, 1.0, 2.0, 3.0]);
        let (low, high) = kept.bounds((0.5, 2.5), 0);
        assert!(low <= 0.5_f64.sin() && high >= 1.0 && low > -0.5 && high < 1.5, "{low} {high}");
        let (low, high) = kept.bounds((1.0, 1.0 + 1e-9), 0);
        assert!(high - low < 1e-8, "{low} {high}");
        assert_eq!(kept.bounds((2.0, 3.5), 0), (f64::NEG_INFINITY, f64::INFINITY));
    }

    #[test]
    fn a_cut_and_a_trim_leave_what_is_between() {
        let mut kept = record(f64::sin, &[0.0, 1.0, 2.0, 3.0]);
        kept.cut(1.5);
        kept.trim(1.2);
        assert!(kept.fits(1) && kept.end() == 1.5);
        let (value, _) = kept.at(&kept.locate(1.4, 0.0), 0);
        assert!((value - 1.4_f64.sin()).abs() < 1e-9);
    }
}
