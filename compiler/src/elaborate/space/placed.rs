//! A flux with its marks replaced by the values of one side, or by a choice.

use smpl_dsl::syntax::{Expr, ExprKind};

use crate::elaborate::lower::place::{Place, Site, Target};
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::lower::{Lowering, paths};
use crate::elaborate::space::faces::FaceValue;
use crate::elaborate::space::flow::{Direction, Flow};
use crate::elaborate::space::marks::{Marks, Term};
use crate::elaborate::space::{field, marks, terms};
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{BinaryFn, Compare, Expr as Node, ExprId, FastMap, FastSet, Rewritten, UnaryFn, VarId};

/// The flux with the marks replaced.
pub(in crate::elaborate::space) fn placed(l: &mut Lowering<'_, '_>, v: Value, flow: &Flow) -> Option<Value> {
    let faces = l.fluxes.faces.clone().unwrap_or_default();
    let mut values = Vec::with_capacity(faces.len());
    for (mark, face) in faces.iter().enumerate() {
        values.push(match flow.directions[mark] {
            Direction::Below => side(l, face, true)?,
            Direction::Above => side(l, face, false)?,
            Direction::Mean => mean_of(l, face),
            Direction::When(holds) => {
                let (below, above) = (side(l, face, true)?, side(l, face, false)?);
                l.exprs.select(holds, below, above)
            }
            Direction::Slope => {
                let (below, above) = (side(l, face, true)?, side(l, face, false)?);
                let holds = mean_slope(l, &flow.terms, mark, &faces, (below, above));
                l.exprs.select(holds, below, above)
            }
        });
    }
    let expr = replaced(l, v.expr, &faces, &mut |_, m| values[m]);
    Some(Value { expr, unit: v.unit })
}

/// Returns `true` if what depends on one face value alone rises from one side's value to the
/// other's.
fn mean_slope(l: &mut Lowering<'_, '_>, terms: &[Term], mark: usize, faces: &[FaceValue], (below, above): (ExprId, ExprId)) -> ExprId {
    let mut total = l.exprs.constant(0.0);
    for term in terms.iter().filter(|t| t.marks == Marks::One(mark)) {
        let e = terms::term(l, term);
        total = l.exprs.add(total, e);
    }
    let f = [below, above].map(|value| replaced(l, total, faces, &mut |_, _| value));
    let (rise, run) = (l.exprs.sub(f[1], f[0]), l.exprs.sub(above, below));
    let product = l.exprs.mul(rise, run);
    let zero = l.exprs.constant(0.0);
    l.exprs.compare(Compare::Le, zero, product)
}

/// An expression with its marks replaced by other nodes.
pub(in crate::elaborate::space) fn replaced<'m, 'a>(
    l: &mut Lowering<'m, 'a>,
    e: ExprId,
    faces: &[FaceValue],
    by: &mut dyn FnMut(&mut Lowering<'m, 'a>, usize) -> ExprId,
) -> ExprId {
    let marks = marks::reading(l).marks_in(e);
    let map: FastMap<ExprId, ExprId> = marks.into_iter().map(|m| (faces[m].mark, by(l, m))).collect();
    l.exprs.rewrite(e, &mut map.into_iter().collect::<Rewritten>(), &mut |_, _| None)
}

/// A field at its face from one side; `None` where the loop has to be cut.
fn side(l: &mut Lowering<'_, '_>, f: &FaceValue, below: bool) -> Option<ExprId> {
    let faces = l.fluxes.faces.take();
    let v = field::value_from_side(l, f.face, below, &mut |s, by| {
        field::in_cell(s, f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place)
    });
    l.fluxes.faces = faces;
    (!v.is_poison()).then_some(v.expr)
}

pub(in crate::elaborate::space) fn mean_of<'m, 'a>(l: &mut Lowering<'m, 'a>, f: &FaceValue) -> ExprId {
    let cell =
        |s: &mut Lowering<'m, 'a>, by| field::in_cell(s, f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place).expr;
    let n = l.symbols.domains[f.face.domain].cells;
    if f.face.at.count == 1 && (f.face.at.first == 0 || f.face.at.first == n) && !l.symbols.is_periodic(f.face.domain) {
        return f.beside;
    }
    let (left, right) = (cell(l, -1), cell(l, 0));
    field::interpolate(l, f.face, left, right)
}

/// A flux given at an end with what the flow carries out while it leaves there; `None` where
/// nothing has to be changed.
pub(in crate::elaborate::space) fn turning(
    l: &mut Lowering<'_, '_>,
    (given, text, outer): (&Value, &Expr, &Place),
    inner: Value,
    flow: &Flow,
    is_low: bool,
) -> Option<Value> {
    let faces = l.fluxes.faces.clone().unwrap_or_default();
    let turns = turns(l, flow);
    let given_expr = match (&given.unit, &inner.unit) {
        (Measure::Of(a), Measure::Of(b)) => l.values().convert(given.expr, &a.clone(), &b.clone())?,
        _ => given.expr,
    };
    let velocities: Vec<FastSet<ExprId>> = turns.iter().map(|(_, velocities)| velocities.clone()).collect();
    let mut rest: Vec<ExprId> = summands(l, given_expr, &velocities);
    // `v*c_in` with a `c_in` of 0 is not a wall.
    let is_nothing = l.exprs.as_const(given_expr) == Some(0.0);
    let mut total = None;
    for (holds, velocities) in &turns {
        // Streams that pass each other on one velocity: each takes what has its sign.
        let is_shared = turns.iter().any(|(other, theirs)| other != holds && !theirs.is_disjoint(velocities));
        let carried: Vec<&FaceValue> =
            faces.iter().zip(&flow.directions).filter(|(_, d)| **d == Direction::When(*holds)).map(|(f, _)| f).collect();
        let (turned, stays): (Vec<ExprId>, Vec<ExprId>) = rest.iter().partition(|&&e| {
            let value = marks::reading(l).beside_velocity(e, velocities);
            let reads = |e: ExprId| carried.iter().any(|f| marks::reading(l).reaches(e, &mut |_, node| node == f.beside));
            (!is_shared || is_negative(l, e) == is_reverse(l, *holds)) && value.is_some_and(|factors| !factors.into_iter().any(reads))
        });
        if turned.is_empty() && !(is_nothing && is_multiple(l, text, outer, &variables(l, velocities, &faces))) {
            continue;
        }
        rest = stays;
        let bare = carried_bare(l, flow, velocities);
        if is_shared && !bare.is_empty() {
            // The stream of the datum is unknown.
            return None;
        }
        let out = carried_out(l, flow, &faces, *holds, &bare);
        let into = sum_of(l, &turned);
        let e = if is_low { l.exprs.select(*holds, into, out) } else { l.exprs.select(*holds, out, into) };
        total = Some(total.map_or(e, |t| l.exprs.add(t, e)));
    }
    let total = total?;
    let rest = sum_of(l, &rest);
    let expr = l.exprs.add(rest, total);
    Some(Value { expr, unit: if matches!(inner.unit, Measure::Of(_)) { inner.unit } else { given.unit.clone() } })
}

/// The variables that velocities are made of.
fn variables(l: &Lowering<'_, '_>, velocities: &FastSet<ExprId>, faces: &[FaceValue]) -> FastSet<VarId> {
    let reading = marks::reading(l);
    let marks = velocities.iter().flat_map(|&e| reading.marks_in(e)).map(|m| faces[m].beside);
    let nodes: Vec<ExprId> = velocities.iter().copied().chain(marks).collect();
    let variable = |e: ExprId| match l.exprs.node(e) {
        Node::Load { var, .. } => Some(var),
        _ => None,
    };
    l.exprs.below(nodes).filter_map(variable).collect()
}

/// Returns `true` if one of some variables occurs in a text, or in the definitions of its names.
fn is_multiple(l: &mut Lowering<'_, '_>, text: &Expr, place: &Place, of: &FastSet<VarId>) -> bool {
    let mut seen: FastSet<SymbolId> = FastSet::default();
    let mut stack = vec![(text, place.clone())];
    while let Some((text, place)) = stack.pop() {
        let mut paths: Vec<&Expr> = Vec::new();
        text.walk(&mut |e| {
            if matches!(e.kind, ExprKind::Name(_) | ExprKind::Member(..)) {
                paths.push(e);
            }
        });
        for path in paths {
            let Some(symbol) = symbol_of(l, path, &place).filter(|&symbol| seen.insert(symbol)) else { continue };
            match &l.symbols[symbol].kind {
                SymbolKind::Variable { var, .. } if of.contains(var) => return true,
                SymbolKind::Let { definition, .. } => stack.push((definition, Place::new(l.symbols[symbol].scope, Site::Dynamics))),
                _ => {}
            }
        }
    }
    false
}

/// The symbol of a path in a text that has been read before.
fn symbol_of(l: &mut Lowering<'_, '_>, path: &Expr, place: &Place) -> Option<SymbolId> {
    match &path.kind {
        ExprKind::Name(name) if place.bound(&name.text).is_none() => l.symbols.lookup(place.scope, &name.text),
        ExprKind::Member(..) => match paths::resolve(l, path, place) {
            Target::Symbol(symbol) => Some(symbol),
            _ => None,
        },
        _ => None,
    }
}

/// The conditions that face values of a flux turn by, each with what they turn by.
fn turns(l: &Lowering<'_, '_>, flow: &Flow) -> Vec<(ExprId, FastSet<ExprId>)> {
    let mut found: Vec<(ExprId, FastSet<ExprId>)> = Vec::new();
    for direction in &flow.directions {
        if let Direction::When(holds) = direction
            && found.iter().all(|(known, _)| known != holds)
        {
            found.push((*holds, marks::reading(l).velocities(*holds)));
        }
    }
    found
}

/// Terms without a field that velocities carry, as the datum of an enthalpy.
fn carried_bare(l: &mut Lowering<'_, '_>, flow: &Flow, velocities: &FastSet<ExprId>) -> Vec<ExprId> {
    let all: Vec<ExprId> = flow.bare.iter().map(|term| terms::term(l, term)).collect();
    all.into_iter().filter(|&e| marks::reading(l).beside_velocity(e, velocities).is_some()).collect()
}

/// Outflow at an end under the condition `holds`: the terms whose fields come from there, and
/// `bare` ones.
fn carried_out(l: &mut Lowering<'_, '_>, flow: &Flow, faces: &[FaceValue], holds: ExprId, bare: &[ExprId]) -> ExprId {
    let mut out = sum_of(l, bare);
    for term in &flow.terms {
        if marks::reading(l).marks_in(term.rest).iter().any(|&m| flow.directions[m] == Direction::When(holds)) {
            let e = terms::term(l, term);
            let e = replaced(l, e, faces, &mut |_, m| faces[m].beside);
            out = l.exprs.add(out, e);
        }
    }
    out
}

/// Returns `true` if a condition holds where its velocity is negative.
fn is_reverse(l: &Lowering<'_, '_>, holds: ExprId) -> bool {
    matches!(l.exprs.node(holds), Node::Compare(_, _, b) if l.exprs.as_const(b).is_some())
}

/// Returns `true` if a product has an odd number of negative signs and numbers in it.
fn is_negative(l: &Lowering<'_, '_>, e: ExprId) -> bool {
    let (mut stack, mut negative) = (vec![e], false);
    while let Some(e) = stack.pop() {
        match l.exprs.node(e) {
            Node::Binary(BinaryFn::Mul | BinaryFn::Div, a, b) => stack.extend([a, b]),
            Node::Unary(UnaryFn::Neg, a) => {
                negative = !negative;
                stack.push(a);
            }
            _ => negative ^= l.exprs.as_const(e).is_some_and(|x| x < 0.0),
        }
    }
    negative
}

fn sum_of(l: &mut Lowering<'_, '_>, list: &[ExprId]) -> ExprId {
    let zero = l.exprs.constant(0.0);
    list.iter().fold(zero, |sum, &e| l.exprs.add(sum, e))
}

/// The terms of a sum; a velocity that is a sum itself is one.
fn summands(l: &mut Lowering<'_, '_>, e: ExprId, velocities: &[FastSet<ExprId>]) -> Vec<ExprId> {
    let mut stack = vec![(e, false)];
    let mut out = Vec::new();
    while let Some((e, negative)) = stack.pop() {
        match l.exprs.node(e) {
            _ if velocities.iter().any(|v| v.contains(&e)) => out.push(if negative { l.exprs.neg(e) } else { e }),
            Node::Binary(BinaryFn::Add, a, b) => stack.extend([(b, negative), (a, negative)]),
            Node::Binary(BinaryFn::Sub, a, b) => stack.extend([(b, !negative), (a, negative)]),
            Node::Unary(UnaryFn::Neg, a) => stack.push((a, !negative)),
            _ => out.push(if negative { l.exprs.neg(e) } else { e }),
        }
    }
    out
}
