//! A flux with the values of one side, or a choice, in place of its marks.

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::value::{Measure, Value};
use crate::elaborate::space::directions::{Direction, Flow};
use crate::elaborate::space::faces::FaceValue;
use crate::elaborate::space::marks::{Marks, Term};
use crate::ir::{BinaryFn, Compare, Expr as Node, ExprId, FastMap, FastSet, Rewritten, UnaryFn};
impl Lowering<'_, '_> {
    /// The flux with the marks replaced.
    pub(in crate::elaborate::space) fn placed(&mut self, v: Value, flow: &Flow) -> Option<Value> {
        let faces = self.fluxes.faces.clone().unwrap_or_default();
        let mut values = Vec::with_capacity(faces.len());
        for (mark, face) in faces.iter().enumerate() {
            values.push(match flow.directions[mark] {
                Direction::Below => self.side(face, true)?,
                Direction::Above => self.side(face, false)?,
                Direction::Mean => self.mean_of(face),
                Direction::When(holds) => {
                    let (below, above) = (self.side(face, true)?, self.side(face, false)?);
                    self.exprs.select(holds, below, above)
                }
                Direction::Slope => {
                    let (below, above) = (self.side(face, true)?, self.side(face, false)?);
                    let holds = self.mean_slope(&flow.terms, mark, &faces, (below, above));
                    self.exprs.select(holds, below, above)
                }
            });
        }
        let expr = self.replaced(v.expr, &faces, &mut |_, m| values[m]);
        Some(Value { expr, unit: v.unit })
    }

    /// Whether what depends on one face value alone rises from one side's value to the other's.
    fn mean_slope(&mut self, terms: &[Term], mark: usize, faces: &[FaceValue], (below, above): (ExprId, ExprId)) -> ExprId {
        let mut total = self.exprs.constant(0.0);
        for term in terms.iter().filter(|t| t.marks == Marks::One(mark)) {
            let e = self.term(term);
            total = self.exprs.add(total, e);
        }
        let f = [below, above].map(|value| self.replaced(total, faces, &mut |_, _| value));
        let (rise, run) = (self.exprs.sub(f[1], f[0]), self.exprs.sub(above, below));
        let product = self.exprs.mul(rise, run);
        let zero = self.exprs.constant(0.0);
        self.exprs.compare(Compare::Le, zero, product)
    }

    /// An expression with other nodes in place of the marks.
    pub(in crate::elaborate::space) fn replaced(
        &mut self,
        e: ExprId,
        faces: &[FaceValue],
        by: &mut dyn FnMut(&mut Self, usize) -> ExprId,
    ) -> ExprId {
        let marks = self.reading().marks_in(e);
        let map: FastMap<ExprId, ExprId> = marks.into_iter().map(|m| (faces[m].mark, by(self, m))).collect();
        self.exprs.rewrite(e, &mut map.into_iter().collect::<Rewritten>(), &mut |_, _| None)
    }

    /// A field at its face from one side; `None` where the loop has to be cut.
    fn side(&mut self, f: &FaceValue, below: bool) -> Option<ExprId> {
        let faces = self.fluxes.faces.take();
        let v = self.value_from_side(f.face, below, &mut |s, by| {
            s.in_cell(f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place)
        });
        self.fluxes.faces = faces;
        (!v.is_poison()).then_some(v.expr)
    }

    pub(in crate::elaborate::space) fn mean_of(&mut self, f: &FaceValue) -> ExprId {
        let cell = |s: &mut Self, by| s.in_cell(f.symbol, &f.index, f.span, f.face.at.shifted(by), f.face.domain, &f.place).expr;
        let n = self.symbols.domains[f.face.domain].cells;
        if f.face.at.count == 1 && (f.face.at.first == 0 || f.face.at.first == n) {
            return f.beside;
        }
        let (l, r) = (cell(self, -1), cell(self, 0));
        self.interpolate(f.face, l, r)
    }

    /// A flux given at an end with what the flow carries out while it leaves there; `None` where nothing has to be changed.
    pub(in crate::elaborate::space) fn turning(&mut self, given: &Value, inner: Value, flow: &Flow, is_low: bool) -> Option<Value> {
        let faces = self.fluxes.faces.clone().unwrap_or_default();
        let mut conditions: Vec<ExprId> = Vec::new();
        for direction in &flow.directions {
            if let Direction::When(holds) = direction
                && !conditions.contains(holds)
            {
                conditions.push(*holds);
            }
        }
        let given_expr = match (&given.unit, &inner.unit) {
            (Measure::Of(a), Measure::Of(b)) => self.values().convert(given.expr, &a.clone(), &b.clone())?,
            _ => given.expr,
        };
        let velocities: Vec<FastSet<ExprId>> = conditions.iter().map(|&holds| self.reading().velocities(holds)).collect();
        let mut rest: Vec<ExprId> = self.summands(given_expr, &velocities);
        let mut total = None;
        for (holds, velocities) in conditions.into_iter().zip(&velocities) {
            let carried: Vec<&FaceValue> =
                faces.iter().zip(&flow.directions).filter(|(_, d)| **d == Direction::When(holds)).map(|(f, _)| f).collect();
            let (turns, stays): (Vec<ExprId>, Vec<ExprId>) = rest.iter().partition(|&&e| {
                let value = self.reading().beside_velocity(e, velocities);
                let reads = |e: ExprId| carried.iter().any(|f| self.reading().reaches(e, &mut |_, node| node == f.beside));
                value.is_some_and(|factors| !factors.into_iter().any(reads))
            });
            if turns.is_empty() {
                continue;
            }
            rest = stays;
            let mut out = self.exprs.constant(0.0);
            for term in &flow.terms {
                if self.reading().marks_in(term.rest).iter().any(|&m| flow.directions[m] == Direction::When(holds)) {
                    let e = self.term(term);
                    let e = self.replaced(e, &faces, &mut |_, m| faces[m].beside);
                    out = self.exprs.add(out, e);
                }
            }
            let into = self.total(&turns);
            let e = if is_low { self.exprs.select(holds, into, out) } else { self.exprs.select(holds, out, into) };
            total = Some(total.map_or(e, |t| self.exprs.add(t, e)));
        }
        let total = total?;
        let rest = self.total(&rest);
        let expr = self.exprs.add(rest, total);
        Some(Value { expr, unit: if matches!(inner.unit, Measure::Of(_)) { inner.unit } else { given.unit.clone() } })
    }

    fn total(&mut self, list: &[ExprId]) -> ExprId {
        let zero = self.exprs.constant(0.0);
        list.iter().fold(zero, |sum, &e| self.exprs.add(sum, e))
    }

    /// The terms of a sum; a velocity that is a sum itself is one.
    fn summands(&mut self, e: ExprId, velocities: &[FastSet<ExprId>]) -> Vec<ExprId> {
        let mut stack = vec![(e, false)];
        let mut out = Vec::new();
        while let Some((e, negative)) = stack.pop() {
            match self.exprs.node(e) {
                _ if velocities.iter().any(|v| v.contains(&e)) => out.push(if negative { self.exprs.neg(e) } else { e }),
                Node::Binary(BinaryFn::Add, a, b) => stack.extend([(b, negative), (a, negative)]),
                Node::Binary(BinaryFn::Sub, a, b) => stack.extend([(b, !negative), (a, negative)]),
                Node::Unary(UnaryFn::Neg, a) => stack.push((a, !negative)),
                _ => out.push(if negative { self.exprs.neg(e) } else { e }),
            }
        }
        out
    }
}
