//! Choice of the states that follow from constraints: dummy derivatives (Mattsson and Söderlind,
//! SIAM J. Sci. Comput. 14 (1993) 677-692).
//!
//! Each differentiated equation stays in the system, and one unknown of lower order or one state
//! follows from it.

use std::collections::BTreeMap;

use super::bounds::cannot_vanish;
use super::correct::Constraints;
use super::pantelides::System;
use super::project::{Group, states_of};
use super::start::Start;
use super::system::{Matching, Node, Pool, Search, Settled, Wishes, by_element, scale};
use crate::elaborate::for_each_element;
use crate::ir::{Affine, Expr, ExprId, FastMap, FastSet, Flavour, LoopVar, Role, VarId};
use crate::model::Model;

/// Elements of variables.
type Elements = FastSet<(VarId, i64)>;
/// Order of pivots, the least first: wish, whether it varies, its negative size, position.
type Rank = (u8, bool, f64, usize);
/// Order of the variables that an equation may determine, the least first: kind and wish, whether
/// its slope varies, its negative size, position.
type Preference = (u8, u8, bool, f64, usize);

/// Part of the largest entry that a pivot must have.
const LEAST: f64 = 1e-2;
/// Places around the start at which the sign of a derivative is looked at.
const SAMPLES: i64 = 32;
/// Entry, relative to the others of its row, that counts as none.
const NONE: f64 = 1e-9;

/// Treatment of constraints.
#[derive(Default)]
pub(super) struct SettledConstraints {
    /// Those from which something follows.
    pub(super) settled: Vec<Settled>,
    /// Those that states are projected to in closed form.
    pub(super) groups: Vec<Group>,
    /// Those that states are projected to by corrections.
    pub(super) corrected: Vec<Constraints>,
}

/// Settles each constraint; `None` if no choice of states was found.
pub(super) fn settle(model: &mut Model, system: &System, wishes: &Wishes, correct: bool) -> Option<SettledConstraints> {
    let numbers: Vec<usize> = (0..system.nodes.len()).filter(|&i| system.nodes[i].derivative.is_some()).collect();
    let nodes: Vec<Node> = numbers.iter().map(|&i| system.nodes[i].clone()).collect();
    let found = if nodes.iter().all(|node| node.extents.is_empty()) {
        let fresh = fresh_states(model, system, &numbers);
        let start = Start::of(model);
        let found = by_numbers(model, (&nodes, &fresh), &system.lower, wishes, &start);
        found.or_else(|| by_numbers(model, (&nodes, &fresh), &system.lower, wishes, &Start::anywhere()))?
    } else {
        let settled = by_structure(model, nodes, &system.lower, wishes)?;
        settled.into_iter().map(|s| Settled { varies: may_vanish(model, &s), ..s }).collect()
    };
    let forced = found.iter().filter(|s| model.vars[s.var].role == Role::Algebraic).map(|s| s.node.count()).sum::<i64>();
    if forced != system.lower.elements().len() as i64 {
        return None;
    }
    let (mut outcome, rest) = apart(model, system, wishes, found);
    if correct {
        by_corrections(model, system, wishes, rest, &mut outcome);
    } else {
        outcome.settled = rest;
    }
    Some(outcome)
}

/// The states that each constraint should determine: of a time derivative those that do not occur
/// in what it is the derivative of.
fn fresh_states(model: &Model, system: &System, numbers: &[usize]) -> Vec<FastSet<(VarId, i64)>> {
    let states = |i: usize| states_of(model, std::slice::from_ref(&system.nodes[i])).into_iter().collect::<FastSet<_>>();
    let before: FastMap<usize, usize> = numbers.iter().filter_map(|&i| Some((system.nodes[i].derivative?, i))).collect();
    let fresh = |&i: &usize| {
        let all = states(i);
        let mut new = all.clone();
        let mut at = i;
        while let Some(&parent) = before.get(&at) {
            states(parent).iter().for_each(|state| {
                new.remove(state);
            });
            at = parent;
        }
        if new.is_empty() { all } else { new }
    };
    numbers.iter().map(fresh).collect()
}

/// Returns `true` if the derivative of a constraint by what follows from it could be zero.
fn may_vanish(model: &mut Model, s: &Settled) -> bool {
    let slope = by_element(&mut model.exprs, s.node.extents.len(), s.node.residual, (s.var, s.at));
    slope.is_none_or(|slope| !is_constant(model, slope) && !cannot_vanish(model, slope))
}

/// Takes the constraints apart that share no state: those of which a pivot could vanish are
/// projected in closed form where that serves; the others.
fn apart(model: &Model, system: &System, wishes: &Wishes, found: Vec<Settled>) -> (SettledConstraints, Vec<Settled>) {
    let states: Vec<Vec<(VarId, i64)>> = found.iter().map(|s| states_of(model, std::slice::from_ref(&s.node))).collect();
    let (mut outcome, mut rest) = (SettledConstraints::default(), Vec::new());
    for part in sharing(&states) {
        let only_states = part.iter().all(|&i| model.vars[found[i].var].role == Role::State);
        let group = (only_states && part.iter().any(|&i| found[i].varies)).then(|| {
            let nodes: Vec<Node> = part.iter().map(|&i| found[i].node.clone()).collect();
            Group::of(model, nodes)
        });
        match group.flatten().filter(|group| group.may_be_projected(&system.slopes, wishes)) {
            Some(group) => outcome.groups.push(group),
            None => rest.extend(part.iter().map(|&i| found[i].clone())),
        }
    }
    (outcome, rest)
}

/// Parts of a list whose members share elements.
fn sharing(elements: &[Vec<(VarId, i64)>]) -> Vec<Vec<usize>> {
    let mut with: FastMap<(VarId, i64), Vec<usize>> = FastMap::default();
    elements.iter().enumerate().for_each(|(i, list)| list.iter().for_each(|&element| with.entry(element).or_default().push(i)));
    let next = elements.iter().map(|list| {
        let mut next: Vec<usize> = list.iter().flat_map(|element| with[element].iter().copied()).collect();
        next.sort_unstable();
        next.dedup();
        next
    });
    crate::graph::connected(&next.collect::<Vec<_>>())
}

/// Projects by corrections where a pivot could vanish, each part that shares no state and no
/// unknown of lower order with others; what is left is settled.
fn by_corrections(model: &mut Model, system: &System, wishes: &Wishes, rest: Vec<Settled>, outcome: &mut SettledConstraints) {
    let elements = |s: &Settled| {
        let mut list = states_of(model, std::slice::from_ref(&s.node));
        for read in s.node.reads(model, Role::Algebraic) {
            read.each(&mut |i| list.extend(system.lower.has(read.var, i).then_some((read.var, i))));
        }
        list
    };
    let elements: Vec<_> = rest.iter().map(elements).collect();
    let start = Start::of(model);
    let mut parts: Vec<(Vec<usize>, Option<Constraints>)> = Vec::new();
    for part in sharing(&elements) {
        let members: Vec<&Settled> = part.iter().map(|&i| &rest[i]).collect();
        let found = is_doubtful(model, &members, &start).then(|| Constraints::of(model, &system.slopes, wishes, &members));
        parts.push((part, found.flatten()));
    }
    // A state of which some elements follow is no longer one whole: it cannot be moved.
    loop {
        let followers = parts.iter().filter(|(_, found)| found.is_none()).flat_map(|(part, _)| part).map(|&i| rest[i].var);
        let follow: FastSet<VarId> = followers.filter(|&var| model.vars[var].role == Role::State).collect();
        let mut shared = false;
        for (_, found) in &mut parts {
            if found.as_ref().is_some_and(|found| found.states().iter().any(|var| follow.contains(var))) {
                (*found, shared) = (None, true);
            }
        }
        if !shared {
            break;
        }
    }
    let left: FastSet<usize> = parts.iter().filter(|(_, found)| found.is_none()).flat_map(|(part, _)| part.iter().copied()).collect();
    outcome.corrected = parts.into_iter().filter_map(|(_, found)| found).collect();
    outcome.settled = rest.into_iter().enumerate().filter(|(i, _)| left.contains(i)).map(|(_, s)| s).collect();
}

/// Returns `true` if an unknown may come to follow from another constraint. The derivative of its
/// own by it has both signs around the start, and the constraint of a state reads it.
fn changes_hands(model: &mut Model, members: &[&Settled], start: &Start) -> bool {
    let is_state = |model: &Model, s: &Settled| model.vars[s.var].role == Role::State;
    let of_states: Vec<&&Settled> = members.iter().filter(|s| is_state(model, s)).collect();
    let read: FastSet<VarId> = of_states.iter().flat_map(|s| s.node.reads(model, Role::Algebraic)).map(|read| read.var).collect();
    let unknowns: Vec<&&Settled> = members.iter().filter(|s| !is_state(model, s) && read.contains(&s.var)).collect();
    unknowns.into_iter().any(|s| {
        if !may_vanish(model, s) {
            return false;
        }
        let slope = by_element(&mut model.exprs, s.node.extents.len(), s.node.residual, (s.var, s.at));
        let Some(slope) = slope else { return false };
        let signs = (0..SAMPLES).map(|sample| start.scattered(model, sample).value(&mut model.exprs, slope).signum());
        let (mut above, mut below) = (false, false);
        signs.for_each(|sign| (above, below) = (above | (sign > 0.0), below | (sign < 0.0)));
        above && below
    })
}

/// Returns `true` if a state follows from some constraints that may stop to determine it.
fn is_doubtful(model: &mut Model, members: &[&Settled], start: &Start) -> bool {
    let is_state = |model: &Model, s: &Settled| model.vars[s.var].role == Role::State;
    if !members.iter().any(|s| is_state(model, s)) {
        return false;
    }
    if members.iter().any(|s| s.varies && is_state(model, s)) || changes_hands(model, members, start) {
        return true;
    }
    // A state that its own constraint does not read follows from several of them together.
    let is_read = |model: &mut Model, s: &Settled| {
        let slope = by_element(&mut model.exprs, s.node.extents.len(), s.node.residual, (s.var, s.at));
        slope.is_some_and(|slope| model.exprs.as_const(slope) != Some(0.0))
    };
    if members.iter().all(|s| !is_state(model, s) || is_read(model, s)) {
        return false;
    }
    let determined: FastSet<VarId> = members.iter().map(|s| s.var).collect();
    members.iter().any(|s| {
        let read = [Role::State, Role::Algebraic].into_iter().flat_map(|role| s.node.candidates(model, role));
        let read: Vec<(VarId, Affine)> = read.filter(|(var, _)| determined.contains(var)).collect();
        read.into_iter().any(|(var, at)| may_vanish(model, &Settled { var, at, ..(*s).clone() }))
    })
}

/// Returns `true` if an expression is constant during an episode.
pub(super) fn is_constant(model: &Model, e: ExprId) -> bool {
    model.exprs.below([e]).all(|e| match model.exprs.node(e) {
        Expr::Time => false,
        Expr::Load { var, flavour, .. } => model.vars[var].role == Role::Param && flavour == Flavour::Value,
        _ => true,
    })
}

/// A candidate of an equation.
#[derive(Clone, Copy, Debug)]
struct Column {
    var: VarId,
    at: Affine,
    keep: u8,
    scale: f64,
}

fn column(model: &Model, wishes: &Wishes, var: VarId, at: Affine) -> Column {
    Column { var, at, keep: wishes.keep.get(&var).copied().unwrap_or(0), scale: scale(model, var, at) }
}

/// Elimination with pivots chosen by the numbers at the start.
fn by_numbers(
    model: &mut Model,
    (nodes, fresh): (&[Node], &[Elements]),
    lower: &Pool,
    wishes: &Wishes,
    start: &Start,
) -> Option<Vec<Settled>> {
    let mut columns: Vec<Column> = Vec::new();
    let mut number: FastMap<(VarId, i64), usize> = FastMap::default();
    let mut rows: Vec<BTreeMap<usize, f64>> = Vec::new();
    let mut varies: FastSet<(usize, usize)> = FastSet::default();
    for (row, node) in nodes.iter().enumerate() {
        let forced = node.candidates(model, Role::Algebraic).into_iter().filter(|(var, at)| lower.has(*var, at.offset));
        let states = node.candidates(model, Role::State).into_iter().filter(|(var, at)| fresh[row].contains(&(*var, at.offset)));
        let all: Vec<_> = forced.chain(states).collect();
        let mut entries = BTreeMap::new();
        for (var, at) in all {
            let Some(slope) = by_element(&mut model.exprs, 0, node.residual, (var, at)) else { continue };
            let next = columns.len();
            let at_column = *number.entry((var, at.offset)).or_insert(next);
            if at_column == next {
                columns.push(column(model, wishes, var, at));
            }
            let value = start.value(&mut model.exprs, slope) * columns[at_column].scale;
            if value != 0.0 {
                entries.insert(at_column, value);
            }
            if !is_constant(model, slope) && !cannot_vanish(model, slope) {
                varies.insert((row, at_column));
            }
        }
        let size = entries.values().fold(0.0_f64, |size, x| size.max(x.abs()));
        entries.values_mut().for_each(|x| *x /= size);
        rows.push(entries);
    }
    let is_forced = |c: &Column| model.vars[c.var].role == Role::Algebraic;
    let forced: Vec<usize> = (0..columns.len()).filter(|&c| is_forced(&columns[c])).collect();
    let mut elimination = Elimination { rows, used: vec![None; nodes.len()] };
    for &c in &forced {
        let row = elimination.largest_in(c)?;
        elimination.pivot(row, c);
    }
    while elimination.used.iter().any(Option::is_none) {
        let (row, c) = elimination.best(&columns, &varies)?;
        elimination.pivot(row, c);
    }
    let settled = nodes.iter().zip(&elimination.used).enumerate().map(|(row, (node, c))| {
        let c = (*c)?;
        Some(Settled { node: node.clone(), var: columns[c].var, at: columns[c].at, varies: varies.contains(&(row, c)) })
    });
    settled.collect()
}

struct Elimination {
    rows: Vec<BTreeMap<usize, f64>>,
    /// The column of each row that has one.
    used: Vec<Option<usize>>,
}

impl Elimination {
    /// The free row with the largest entry in a column.
    fn largest_in(&self, c: usize) -> Option<usize> {
        let free = (0..self.rows.len()).filter(|&row| self.used[row].is_none());
        let size = |row: usize| self.rows[row].get(&c).map_or(0.0, |x| x.abs());
        free.filter(|&row| size(row) > NONE).max_by(|a, b| size(*a).total_cmp(&size(*b)).then(b.cmp(a)))
    }

    /// The best entry of the free rows: by wish, then one that does not vary, then by size, or of
    /// those that stay the last one.
    fn best(&self, columns: &[Column], varies: &FastSet<(usize, usize)>) -> Option<(usize, usize)> {
        let taken: FastSet<usize> = self.used.iter().flatten().copied().collect();
        let free = (0..self.rows.len()).filter(|&row| self.used[row].is_none());
        let mut found: Option<(Rank, (usize, usize))> = None;
        for row in free {
            let entries = self.rows[row].iter().filter(|(c, x)| !taken.contains(*c) && x.abs() > NONE);
            let size = entries.clone().fold(0.0_f64, |size, (_, x)| size.max(x.abs()));
            for (&c, x) in entries.filter(|(_, x)| x.abs() >= LEAST * size) {
                let moves = varies.contains(&(row, c));
                let rank = (columns[c].keep, moves, if moves { -x.abs() / size } else { 0.0 }, usize::MAX - c);
                let better = found.as_ref().is_none_or(|(best, _)| {
                    (rank.0, rank.1).cmp(&(best.0, best.1)).then(rank.2.total_cmp(&best.2)).then(rank.3.cmp(&best.3)).is_lt()
                });
                if better {
                    found = Some((rank, (row, c)));
                }
            }
        }
        found.map(|(_, place)| place)
    }

    fn pivot(&mut self, row: usize, c: usize) {
        self.used[row] = Some(c);
        let pivot = self.rows[row].clone();
        let own = pivot[&c];
        for other in 0..self.rows.len() {
            if self.used[other].is_some() {
                continue;
            }
            let Some(factor) = self.rows[other].get(&c).map(|x| x / own) else { continue };
            for (&k, x) in &pivot {
                let entry = self.rows[other].entry(k).or_insert(0.0);
                let (before, part) = (*entry, factor * x);
                *entry = before - part;
                if entry.abs() <= 1e-13 * (before.abs() + part.abs()) {
                    self.rows[other].remove(&k);
                }
            }
            self.rows[other].remove(&c);
        }
    }
}

/// A matching that loops take part in, each as one.
fn by_structure(model: &mut Model, nodes: Vec<Node>, lower: &Pool, wishes: &Wishes) -> Option<Vec<Settled>> {
    let start = Start::of(model);
    let mut pool = lower.clone();
    let mut candidates: FastMap<usize, Vec<(VarId, Affine)>> = FastMap::default();
    for (i, node) in nodes.iter().enumerate() {
        let mut list: Vec<(Preference, (VarId, Affine))> = Vec::new();
        for (var, at) in node.candidates(model, Role::Algebraic) {
            let mut fits = true;
            for_each_element(&node.extents, at, &mut |i| fits &= lower.has(var, i));
            if fits {
                list.push(((0, 0, false, 0.0, 0), (var, at)));
            }
        }
        for (order, (var, at)) in node.candidates(model, Role::State).into_iter().enumerate() {
            let len = i64::from(model.vars[var].len);
            for element in 0..len {
                if !pool.has(var, element) {
                    pool.set(model, var, element, true);
                }
            }
            let depth = node.extents.len();
            let slope = by_element(&mut model.exprs, depth, node.residual, (var, at));
            // The address of a sum is not one element.
            let (varies, size) = match slope.filter(|&slope| model.exprs.as_const(slope) != Some(0.0)) {
                Some(slope) => (!is_constant(model, slope), start.value(&mut model.exprs, slope).abs()),
                None => (false, 1.0),
            };
            let wish = column(model, wishes, var, at);
            let size = if varies { -size * wish.scale } else { 0.0 };
            list.push(((1, wish.keep, varies, size, usize::MAX - order), (var, at)));
        }
        list.sort_by(|(a, _), (b, _)| (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)).then(a.3.total_cmp(&b.3)).then(a.4.cmp(&b.4)));
        candidates.insert(i, list.into_iter().map(|(_, candidate)| candidate).collect());
    }
    let search = Search { nodes: &nodes, candidates: &candidates, pool: &pool };
    let mut matching = Matching::default();
    for node in 0..nodes.len() {
        if !matching.augment(&search, node, &mut FastSet::default(), 0) {
            return None;
        }
    }
    let mut settled: Vec<Settled> = (0..nodes.len())
        .map(|i| matching.of.get(&i).map(|&(var, at)| Settled { node: nodes[i].clone(), var, at, varies: false }))
        .collect::<Option<_>>()?;
    for (var, element) in lower.elements() {
        if !holds(&settled, var, element) && !give(model, &mut settled, (var, element), &mut FastSet::default()) {
            return None;
        }
    }
    Some(settled)
}

fn holds(settled: &[Settled], var: VarId, element: i64) -> bool {
    let mut found = false;
    for s in settled.iter().filter(|s| s.var == var) {
        for_each_element(&s.node.extents, s.at, &mut |i| found |= i == element);
    }
    found
}

/// Lets an equation that determines a state determine an unknown of lower order instead; one pass
/// of a loop where that is enough.
fn give(model: &mut Model, settled: &mut Vec<Settled>, (var, element): (VarId, i64), seen: &mut FastSet<(VarId, i64)>) -> bool {
    if !seen.insert((var, element)) {
        return false;
    }
    let reading: Vec<(usize, Affine)> = settled
        .iter()
        .enumerate()
        .flat_map(|(i, s)| s.node.reads(model, Role::Algebraic).into_iter().map(move |read| (i, read)))
        .filter(|(_, read)| {
            let mut found = false;
            read.each(&mut |i| found |= i == element);
            read.var == var && found
        })
        .map(|(i, read)| (i, read.at))
        .collect();
    let at = Affine::constant(element);
    for &(i, read) in &reading {
        let Some(single) = alone(model, settled, i, read, element) else { continue };
        if model.vars[settled[single].var].role == Role::State {
            settled[single] = Settled { var, at, ..settled[single].clone() };
            return true;
        }
        let displaced = (settled[single].var, settled[single].at.offset);
        let before = settled[single].clone();
        settled[single] = Settled { var, at, ..before.clone() };
        if give(model, settled, displaced, seen) {
            return true;
        }
        settled[single] = before;
    }
    false
}

/// The pass of a loop that reads an element as a separate equation; `None` where loops nest.
fn alone(model: &mut Model, settled: &mut Vec<Settled>, i: usize, read: Affine, element: i64) -> Option<usize> {
    let s = settled[i].clone();
    let pass = match s.node.extents[..] {
        [] => return Some(i),
        [_] if read.strides[0] == 0 => 0,
        [n] => {
            let ahead = element - read.offset;
            let pass = ahead / read.strides[0];
            if ahead % read.strides[0] != 0 || !(0..i64::from(n)).contains(&pass) {
                return None;
            }
            pass
        }
        _ => return None,
    };
    let n = i64::from(s.node.extents[0]);
    let part = |model: &mut Model, first: i64, count: i64| {
        let residual = super::super::cuts::advanced(&mut model.exprs, s.node.residual, LoopVar(0), first);
        let node = Node { extents: vec![count as u32], residual, ..s.node.clone() };
        Settled { node, var: s.var, at: s.at.advanced(0, first), varies: s.varies }
    };
    let residual = model.exprs.shift(s.node.residual, LoopVar(0), pass);
    let node = Node { extents: Vec::new(), residual, ..s.node.clone() };
    let single = Settled { node, var: s.var, at: s.at.at_pass(0, pass), varies: s.varies };
    for (first, count) in [(0, pass), (pass + 1, n - pass - 1)] {
        if count > 0 {
            let piece = part(model, first, count);
            settled.push(piece);
        }
    }
    settled[i] = single;
    Some(i)
}
