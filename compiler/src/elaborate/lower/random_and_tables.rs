//! Tables over time and random numbers.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Expr, TimeTableKind};

use crate::elaborate::lower::builtins::Distribution;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::lower::{Lowering, interpolation, operators, reads};
use crate::elaborate::symbols::{Outside, SymbolId, SymbolKind};
use crate::ir::{Affine, Compare, ExprId, Flavour, LoopVar, Side, UnaryFn};
use crate::model::{Draw, Instant, Variate};

/// Times this near each other, relative to their size or to 1, are one: a clock that counts in
/// steps is a sum of roundings. Short enough that what happens in between is below every tolerance.
const SLACK: f64 = 1e-12;

/// A table over time of as many points is searched; shorter ones become conditions.
const LOOKED_UP: usize = 33;

/// `uniform(a, b)`, `normal(mean, sd)`, `lognormal(mu, sigma)`: a standard variate in its own slot,
/// scaled.
pub(in crate::elaborate) fn random(
    l: &mut Lowering<'_, '_>,
    span: Span,
    name: &str,
    distribution: Distribution,
    (first, second): (&Expr, &Expr),
    place: &Place,
) -> Value {
    let Some((stream, instant)) = l.hidden.draws.site.clone() else {
        return l.fault(
            Diagnostic::error(codes::MISPLACED_FUNCTION, format!("`{name}` has no meaning here"), span)
                .help("random numbers are drawn in `param ... ~`, `initial ... ~`, `random ... ~`, `disturbance ... ~` and `noise`"),
        );
    };
    let kind = if distribution == Distribution::Uniform { Variate::Uniform } else { Variate::Normal };
    let (a, b) = (l.value(first, place), l.value(second, place));
    if distribution != Distribution::Uniform && is_negative(l, b.expr) {
        return l.fault(
            Diagnostic::error(codes::WRONG_ARGUMENTS, format!("the second argument of `{name}` is negative"), second.span)
                .help("it is a standard deviation"),
        );
    }
    let draw = draw(l, &stream, kind, instant, place);
    let draw = (Value::bare(draw), span);
    let (a, b) = ((a, first.span), (b, second.span));
    if distribution == Distribution::Uniform {
        let width = operators::arithmetic(l, BinaryOp::Sub, b, a.clone(), span);
        if is_negative(l, width.expr) {
            return l.fault(
                Diagnostic::error(codes::WRONG_ARGUMENTS, "the upper end of `uniform` lies below the lower one", span)
                    .help("the form is `uniform(low, high)`"),
            );
        }
        let part = operators::arithmetic(l, BinaryOp::Mul, (width, span), draw, span);
        return operators::arithmetic(l, BinaryOp::Add, a, (part, span), span);
    }
    let part = operators::arithmetic(l, BinaryOp::Mul, b, draw, span);
    let x = operators::arithmetic(l, BinaryOp::Add, a, (part, span), span);
    if distribution == Distribution::Normal {
        return x;
    }
    match l.values().dimensionless(&x, span, "lognormal") {
        Some(e) => {
            let expr = l.exprs.unary(UnaryFn::Exp, e);
            Value::bare(expr)
        }
        None => l.poison(),
    }
}

/// Returns `true` if a number without parameters is negative.
fn is_negative(l: &Lowering<'_, '_>, e: ExprId) -> bool {
    l.exprs.as_const(e).is_some_and(|x| x < 0.0)
}

/// New slots for a random number: one for every pass of the loops around.
fn draw(l: &mut Lowering<'_, '_>, stream: &str, kind: Variate, instant: Instant, place: &Place) -> ExprId {
    let passes: i64 = l.loops.frames.iter().take(place.depth as usize).map(|l| l.passes).product();
    let first = l.hidden.draws.list.len() as i64;
    for i in 0..passes {
        let stream = if passes == 1 { stream.to_owned() } else { format!("{stream}#{i}") };
        l.hidden.draws.list.push(Draw { stream, kind, instant });
    }
    let mut at = Affine::constant(0);
    for d in 0..place.depth {
        let passes = l.loops.frames.get(d as usize).map_or(1, |l| l.passes);
        at = at.times(passes).plus(Affine::along(0, LoopVar(d), 1));
    }
    at.offset = first;
    l.exprs.load(l.hidden.draws.var, Flavour::Value, at)
}

/// A table over time or another quantity, read at an expression.
pub(in crate::elaborate) fn time_table(l: &mut Lowering<'_, '_>, span: Span, symbol: SymbolId, arguments: &[Expr], place: &Place) -> Value {
    let path = l.symbols[symbol].path.clone();
    let SymbolKind::TimeTable { unit, time_unit, kind, outside, points } = l.symbols[symbol].kind.clone() else {
        return l.poison();
    };
    let t = match arguments {
        [argument] => interpolation::table_argument(l, argument, &time_unit, symbol, place),
        // The data of a disturbance, whose function no text names.
        [] if l.symbols.is_data(symbol) => l.exprs.time(),
        _ => return l.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, format!("`{path}` takes a time"), span)),
    };
    let t = if outside == Outside::Cyclic { interpolation::in_period(l.exprs, t, &points) } else { t };
    let expr = match (kind, outside) {
        (TimeTableKind::Linear, Outside::Constant | Outside::Refused | Outside::Cyclic) => l.values().linear_table(t, &points),
        (TimeTableKind::Linear | TimeTableKind::Cubic, _) => {
            interpolation::curve(l.exprs, t, &points, kind == TimeTableKind::Cubic, outside)
        }
        _ => l.values().step_table(t, &points, kind == TimeTableKind::Until),
    };
    let ends = points.first().zip(points.last()).map(|(first, last)| (first.0, last.0));
    let expr = match ends.filter(|_| outside == Outside::Refused) {
        Some(ends) => reads::refused(l, symbol, &[(t, ends)], expr, place),
        None => expr,
    };
    Value::of(expr, unit)
}

impl Values<'_> {
    /// Steps: up to and including a time (`until`), or from it on.
    fn step_table(&mut self, t: ExprId, points: &[(f64, f64)], until: bool) -> ExprId {
        if points.len() >= LOOKED_UP {
            return self.step_list(t, points, until);
        }
        let mut list = points.iter().rev();
        let Some(&(_, last)) = list.next() else { return self.exprs.constant(f64::NAN) };
        if until {
            let mut expr = self.exprs.constant(last);
            for &(time, value) in list {
                // A hair past the time still belongs to it.
                let limit = self.exprs.constant(time + SLACK * time.abs().max(1.0));
                let holds = self.exprs.compare(Compare::Le, t, limit);
                let value = self.exprs.constant(value);
                expr = self.exprs.select(holds, value, expr);
            }
            return expr;
        }
        let mut expr = self.exprs.constant(points.first().map_or(f64::NAN, |p| p.1));
        for &(time, value) in points.iter().skip(1) {
            let limit = self.exprs.constant(time - SLACK * time.abs().max(1.0));
            let reached = self.exprs.compare(Compare::Le, limit, t);
            let value = self.exprs.constant(value);
            expr = self.exprs.select(reached, value, expr);
        }
        expr
    }

    /// The same, by a search.
    fn step_list(&mut self, t: ExprId, points: &[(f64, f64)], until: bool) -> ExprId {
        let values: Vec<f64> = points.iter().map(|p| p.1).collect();
        let slack = |time: f64| SLACK * time.abs().max(1.0);
        let (limits, side): (Vec<f64>, _) = if until {
            (points[..points.len() - 1].iter().map(|p| p.0 + slack(p.0)).collect(), Side::Below)
        } else {
            (points[1..].iter().map(|p| p.0 - slack(p.0)).collect(), Side::UpTo)
        };
        let (limits, values) = (self.exprs.lists_mut().add_limits(&limits), self.exprs.lists_mut().add(&values));
        let piece = self.exprs.passed(limits, side, t);
        self.exprs.entry(values, piece)
    }

    /// Straight lines between points, constant before the first and behind the last, by a search.
    fn linear_list(&mut self, t: ExprId, points: &[(f64, f64)]) -> ExprId {
        let limits: Vec<f64> = points.iter().map(|p| p.0).collect();
        // What each piece begins at, its value there, its slope: the two ends are flat.
        let ((first, v_first), (_, v_last)) = (points[0], points[points.len() - 1]);
        let mut pieces = vec![[first, v_first, 0.0]];
        pieces.extend(points.windows(2).map(|pair| [pair[0].0, pair[0].1, (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0)]));
        pieces.push([first, v_last, 0.0]);
        let limits = self.exprs.lists_mut().add_limits(&limits);
        let piece = self.exprs.passed(limits, Side::UpTo, t);
        let [start, value, slope] = [0, 1, 2].map(|column| {
            let column: Vec<f64> = pieces.iter().map(|piece| piece[column]).collect();
            let list = self.exprs.lists_mut().add(&column);
            self.exprs.entry(list, piece)
        });
        let since = self.exprs.sub(t, start);
        let rise = self.exprs.mul(slope, since);
        self.exprs.add(value, rise)
    }

    fn linear_table(&mut self, t: ExprId, points: &[(f64, f64)]) -> ExprId {
        if points.len() >= LOOKED_UP {
            return self.linear_list(t, points);
        }
        let Some(&(_, last)) = points.last() else { return self.exprs.constant(f64::NAN) };
        let mut expr = self.exprs.constant(last);
        for pair in points.windows(2).rev() {
            let ((t0, v0), (t1, v1)) = (pair[0], pair[1]);
            let slope = self.exprs.constant((v1 - v0) / (t1 - t0));
            let (start, v0, end) = (self.exprs.constant(t0), self.exprs.constant(v0), self.exprs.constant(t1));
            let since = self.exprs.sub(t, start);
            let rise = self.exprs.mul(slope, since);
            let inside = self.exprs.add(v0, rise);
            let before = self.exprs.compare(Compare::Lt, t, end);
            expr = self.exprs.select(before, inside, expr);
        }
        if let Some(&(t0, v0)) = points.first() {
            let (start, v0) = (self.exprs.constant(t0), self.exprs.constant(v0));
            let before = self.exprs.compare(Compare::Lt, t, start);
            expr = self.exprs.select(before, v0, expr);
        }
        expr
    }
}
