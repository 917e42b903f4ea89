//! Subscripts: affine in the counters where that is what the positions are, else looked up in a
//! table.

use std::fmt::Write as _;

use crate::differentiate::pattern::each;
use crate::export::sheet::Loops;
use crate::ir::{Affine, FastMap, MAX_DEPTH};
use crate::schedule::row_major;

/// Position tables of a file; equal ones are one.
#[derive(Default)]
pub(super) struct Tables {
    list: Vec<Vec<u32>>,
    known: FastMap<Vec<u32>, usize>,
    /// Lists that numbers are looked up in, as text.
    numbers: Vec<String>,
}

impl Tables {
    fn name(&mut self, numbers: &[u32]) -> String {
        let next = self.list.len();
        let number = *self.known.entry(numbers.to_vec()).or_insert(next);
        if number == next {
            self.list.push(numbers.to_vec());
        }
        format!("index_{number}")
    }

    /// The name of a list of numbers.
    pub(super) fn numbers(&mut self, list: &[f64]) -> String {
        let text = format!("[{}] = {{{}}}", list.len(), wrapped(list.iter().map(|&x| number(x))));
        let at = self.numbers.iter().position(|known| *known == text).unwrap_or_else(|| {
            self.numbers.push(text);
            self.numbers.len() - 1
        });
        format!("list_{at}")
    }

    /// The definitions of all tables.
    pub(super) fn print(&self) -> String {
        let mut text = String::new();
        for (at, list) in self.numbers.iter().enumerate() {
            let _ = writeln!(text, "static const double list_{at}{list};");
        }
        for (number, numbers) in self.list.iter().enumerate() {
            // Writing into a string does not fail.
            let _ = writeln!(text, "static const int index_{number}[{}] = {{{}}};", numbers.len(), wrapped(numbers.iter()));
        }
        text
    }
}

/// Numbers with commas, broken into lines.
pub(in crate::export) fn wrapped<T: ToString>(items: impl Iterator<Item = T>) -> String {
    let mut text = String::new();
    let mut column = 0;
    for item in items {
        let item = item.to_string();
        if !text.is_empty() {
            text.push(',');
            column += 1;
        }
        if column + item.len() > 100 {
            text.push_str("\n    ");
            column = 4;
        } else if !text.is_empty() {
            text.push(' ');
        }
        column += item.len();
        text.push_str(&item);
    }
    text
}

/// The subscript that gives a position for every pass.
pub(super) fn subscript(loops: &Loops, positions: &[u32], tables: &mut Tables) -> String {
    if let Some(affine) = affine(loops, positions) {
        return print(affine);
    }
    if let Some((starts, step, (inner, outer))) = regular(loops, positions) {
        let mut along = Affine::default();
        along.strides[inner as usize] = step;
        let table = tables.name(&starts);
        return format!("{table}[{}] + {}", print(row_major(&outer)), print(along));
    }
    let table = tables.name(positions);
    format!("{table}[{}]", print(row_major(loops)))
}

/// Positions as one affine address, if they are.
fn affine(loops: &Loops, positions: &[u32]) -> Option<Affine> {
    let order = row_major(loops);
    let at = |pass: i64| positions.get(pass as usize).map(|&p| i64::from(p));
    let first = at(0)?;
    let mut affine = Affine::constant(first);
    for &(counter, _) in loops.iter().filter(|l| l.1 > 1) {
        let d = counter as usize;
        affine.strides[d] = at(order.strides[d])? - first;
    }
    let mut pass = 0;
    let mut same = true;
    each(loops, |counters| {
        same &= at(pass) == Some(affine.at(counters));
        pass += 1;
    });
    same.then_some(affine)
}

/// First positions and step of the innermost loop, its counter, and the loops around it.
type Regular = (Vec<u32>, i64, (u8, Loops));

/// Positions that are as far apart in every run of the innermost loop.
fn regular(loops: &Loops, positions: &[u32]) -> Option<Regular> {
    let (&(inner, extent), outer) = loops.split_last()?;
    let extent = extent as usize;
    if outer.is_empty() || extent < 2 {
        return None;
    }
    let step = i64::from(*positions.get(1)?) - i64::from(positions[0]);
    let even = |run: &[u32]| run.windows(2).all(|pair| i64::from(pair[1]) - i64::from(pair[0]) == step);
    let starts = positions.iter().step_by(extent).copied().collect();
    positions.chunks(extent).all(even).then(|| (starts, step, (inner, outer.to_vec())))
}

/// `3 + 40*i0 + i1`
fn print(at: Affine) -> String {
    let mut text = String::new();
    if at.offset != 0 || at.strides == [0; MAX_DEPTH] {
        text = at.offset.to_string();
    }
    for (d, &stride) in at.strides.iter().enumerate().filter(|(_, s)| **s != 0) {
        let sign = match (text.is_empty(), stride < 0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        let factor = if stride.abs() == 1 { String::new() } else { format!("{}*", stride.abs()) };
        text += &format!("{sign}{factor}i{d}");
    }
    text
}

/// A number that C reads back to the same bits.
pub(in crate::export) fn number(x: f64) -> String {
    if x.is_nan() {
        "NAN".to_owned()
    } else if x.is_infinite() {
        if x > 0.0 { "INFINITY".to_owned() } else { "(-INFINITY)".to_owned() }
    } else if x < 0.0 {
        format!("({x:?})")
    } else {
        format!("{x:?}")
    }
}
