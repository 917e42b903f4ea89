//! From which side the face values of a flux come.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;

use crate::elaborate::lower::{Lowering, units};
use crate::elaborate::space::faces::FaceValue;
use crate::elaborate::space::flow::{Direction, Flow, forward};
use crate::elaborate::space::interval::Interval;
use crate::elaborate::space::marks::{Marks, Term};
use crate::elaborate::space::{marks, placed, terms};
use crate::ir::ExprId;

/// The directions of all face values of a flux.
pub(in crate::elaborate::space) fn flow(l: &mut Lowering<'_, '_>, e: ExprId, span: Span) -> Result<Flow, Box<Diagnostic>> {
    let (terms, bare) = terms::flux_terms(l, e);
    let faces = l.fluxes.faces.clone().unwrap_or_default();
    check_brackets(l, &terms, &faces, span)?;
    let mut directions: Vec<Option<Direction>> =
        faces.iter().map(|f| f.told.map(Direction::When).or(f.velocity.then_some(Direction::Mean))).collect();
    for term in &terms {
        if term.marks == Marks::Many {
            for (mark, direction) in together(l, term, &faces, span)? {
                settle(&mut directions, &faces, mark, direction)?;
            }
        }
    }
    for mark in 0..faces.len() {
        let own: Vec<Term> = terms.iter().filter(|t| t.marks == Marks::One(mark)).cloned().collect();
        if !own.is_empty() {
            for direction in alone(l, &own, mark) {
                settle(&mut directions, &faces, mark, direction)?;
            }
        }
    }
    let directions = directions.into_iter().map(|d| d.unwrap_or(Direction::Below)).collect();
    Ok(Flow { terms, bare, directions })
}

/// Fields behind one factor in brackets, or with equal factors, flow with each other or against
/// each other: if both are possible, the text must state it.
fn check_brackets(l: &mut Lowering<'_, '_>, terms: &[Term], faces: &[FaceValue], span: Span) -> Result<(), Box<Diagnostic>> {
    let fields: Vec<Vec<usize>> = terms.iter().map(|t| marks::reading(l).marks_in(t.rest)).collect();
    let keys: Vec<(Vec<(ExprId, bool)>, Interval)> = terms
        .iter()
        .map(|t| {
            let (numbers, mut others): (Vec<_>, Vec<_>) = t.factors.iter().partition(|f| l.exprs.as_const(f.0).is_some());
            others.sort_unstable();
            (others, marks::reading(l).factor_range(&numbers))
        })
        .collect();
    for (i, a) in terms.iter().enumerate() {
        for (j, b) in terms.iter().enumerate().take(i) {
            if fields[i] == fields[j] {
                continue;
            }
            let agree =
                |x: Interval, y: Interval| (x.is_not_negative() && y.is_not_negative()) || (x.is_not_positive() && y.is_not_positive());
            let together = match (a.bracket, b.bracket) {
                (Some((m, x)), Some((n, y))) if m == n => agree(x, y),
                _ => keys[i].0 != keys[j].0 || agree(keys[i].1, keys[j].1),
            };
            let first = |k: usize| fields[k].iter().copied().find(|m| fields[i + j - k].iter().all(|n| n != m));
            let (Some(x), Some(y)) = (first(j).or(fields[j].first().copied()), first(i).or(fields[i].first().copied())) else {
                continue;
            };
            let is_said = |f: &FaceValue| f.velocity || f.told.is_some();
            if !together && !is_said(&faces[x]) && !is_said(&faces[y]) {
                return Err(marks::reading(l).both_ways(&faces[x], &faces[y], span));
            }
        }
    }
    Ok(())
}

/// Directions of the face values of a product (or another function) of several fields: they come
/// from one side.
fn together<'m, 'a>(
    l: &mut Lowering<'m, 'a>,
    term: &Term,
    faces: &[FaceValue],
    span: Span,
) -> Result<Vec<(usize, Direction)>, Box<Diagnostic>> {
    let parts = marks::reading(l).parts(term.rest);
    let unknown: Vec<ExprId> = parts.iter().copied().filter(|&p| !marks::reading(l).interval(p).is_not_negative()).collect();
    let is_velocity = |s: &Lowering<'m, 'a>, part: ExprId| marks::reading(s).reaches(part, &mut |s, node| s.may_be_velocity(node));
    let fields = marks::reading(l).marks_in(term.rest);
    let velocities: Vec<ExprId> = unknown.iter().copied().filter(|&p| is_velocity(l, p)).collect();
    let timeless = units::is_dimensionless(&l.symbols.time_unit);
    let mut factors = term.factors.clone();
    let mut carriers = Vec::new();
    match velocities.as_slice() {
        [] if unknown.is_empty() || !timeless => {}
        [velocity] => {
            carriers = marks::reading(l).marks_in(*velocity);
            let pure = carriers.iter().all(|&m| faces[m].odd || faces[m].velocity);
            let twice = parts.iter().filter(|&&p| marks::reading(l).marks_in(p).iter().any(|m| carriers.contains(m))).count() > 1;
            if !pure || twice {
                return Err(marks::reading(l).no_velocity(&fields, faces, span));
            }
            let mean = placed::replaced(l, *velocity, faces, &mut |s, m| placed::mean_of(s, &faces[m]));
            factors.push((mean, false));
        }
        _ => return Err(marks::reading(l).no_velocity(&fields, faces, span)),
    }
    let sign = terms::sign_of(l, &factors);
    let direction = forward(l, sign);
    Ok(fields.into_iter().map(|m| (m, if carriers.contains(&m) { Direction::Mean } else { direction })).collect())
}

/// Directions of a face value by the terms that depend on it alone.
fn alone(l: &mut Lowering<'_, '_>, terms: &[Term], mark: usize) -> Vec<Direction> {
    let ranges = terms.iter().map(|t| marks::reading(l).factor_range(&t.factors).times(marks::reading(l).slope(t.rest, mark)));
    let range = ranges.fold(Interval::of(0.0), Interval::plus);
    if range.is_not_negative() {
        return vec![Direction::Below];
    }
    if range.is_not_positive() {
        return vec![Direction::Above];
    }
    let rests: Vec<Interval> = terms.iter().map(|t| marks::reading(l).slope(t.rest, mark)).collect();
    if terms.len() == 1 && rests[0].is_not_negative() || terms.iter().all(|t| !t.sums.is_empty()) {
        let signs: Vec<ExprId> = terms.iter().map(|t| terms::sign_of(l, &t.factors)).collect();
        return signs.into_iter().map(|s| forward(l, s)).collect();
    }
    let is_linear = rests.iter().all(|&r| r == Interval::of(1.0));
    if !is_linear || terms.iter().any(|t| !t.sums.is_empty()) {
        return vec![Direction::Slope];
    }
    let one = l.exprs.constant(1.0);
    let mut total = l.exprs.constant(0.0);
    for term in terms {
        let factor = terms::multiplied(l, &term.factors, one);
        total = l.exprs.add(total, factor);
    }
    vec![forward(l, total)]
}

/// Notes the direction of a face value; two that differ cannot both hold.
fn settle(directions: &mut [Option<Direction>], faces: &[FaceValue], mark: usize, direction: Direction) -> Result<(), Box<Diagnostic>> {
    match directions[mark] {
        Some(_) if faces[mark].told.is_some() => {}
        Some(Direction::Mean) => {}
        None => directions[mark] = Some(direction),
        Some(_) if direction == Direction::Mean => directions[mark] = Some(direction),
        Some(known) if known == direction => {}
        Some(_) => {
            return Err(Box::new(
                Diagnostic::error(
                    codes::WRONG_KIND,
                    "two terms of this flux carry this field, each with its own velocity",
                    faces[mark].span,
                )
                .label("from which of both cells does it come?")
                .help("say it for each term: `v*upwind(v, c[z]) + w*upwind(w, c[z]*b[z])`"),
            ));
        }
    }
    Ok(())
}
