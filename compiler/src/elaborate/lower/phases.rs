//! The phase in force in expressions: `phase == elute`, `Q[phase]`, `phase_time`.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Expr, ExprKind, Ident};

use crate::elaborate::lower::Lowering;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::values::Values;
use crate::elaborate::symbols::{SymbolId, SymbolKind};
use crate::ir::{Affine, Compare, ExprId, Flavour, VarId};

/// `phase` as a number, `phase_time` as a time; `None` for other names.
pub(in crate::elaborate) fn schedule_name(l: &mut Lowering<'_, '_>, name: &Ident) -> Option<Value> {
    let schedule = l.symbols.schedule.as_ref()?;
    match name.text.as_str() {
        "phase" => Some(Value::bare(l.values().discrete(schedule.current))),
        "phase_time" => {
            let (t, since) = (l.exprs.time(), l.values().discrete(schedule.since));
            let expr = l.exprs.sub(t, since);
            Some(Value::of(expr, l.symbols.time_unit.clone()))
        }
        _ => None,
    }
}

/// `phase == elute`: outer `None` where neither side is `phase`.
pub(in crate::elaborate) fn phase_comparison<'m, 'a>(l: &mut Lowering<'m, 'a>, a: &Expr, b: &Expr, place: &Place) -> Option<Value> {
    let schedule = l.symbols.schedule.as_ref()?;
    let is_phase = |s: &Lowering<'m, 'a>, e: &Expr| {
        matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
            && s.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(s.symbols[id].kind, SymbolKind::Phase(_))))
    };
    let other = match (is_phase(l, a), is_phase(l, b)) {
        (true, false) => b,
        (false, true) => a,
        _ => return None,
    };
    let ExprKind::Name(name) = &other.kind else { return None };
    let Some(at) = schedule.phases.iter().position(|p| p.name.text == name.text) else {
        if l.symbols.lookup(place.scope, &name.text).is_some() {
            return None;
        }
        let known = schedule.phases.iter().map(|p| p.name.text.as_str());
        let help = did_you_mean(&name.text, known);
        let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("no phase is called `{}`", name.text), name.span);
        return Some(l.fault(d.maybe_help(help)));
    };
    let (current, number) = (l.values().discrete(schedule.current), l.exprs.constant(at as f64 + 1.0));
    let expr = l.exprs.compare(Compare::Eq, current, number);
    Some(Value::truth(expr))
}

/// Returns `true` if one of the indices is the phase in force; then the value is chosen among those
/// of all phases.
pub(in crate::elaborate) fn by_phase(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    index: &[Expr],
    span: Span,
    place: &Place,
) -> Option<Value> {
    let schedule = l.symbols.schedule.as_ref()?;
    let at = index.iter().position(|e| {
        matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
            && l.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(l.symbols[id].kind, SymbolKind::Phase(_))))
    })?;
    let current = l.values().discrete(schedule.current);
    let mut chosen: Option<Value> = None;
    for (i, phase) in schedule.phases.iter().enumerate().rev() {
        let mut index = index.to_vec();
        index[at] = Expr { span: index[at].span, kind: ExprKind::Name(phase.name.clone()) };
        let value = l.symbol_value(symbol, &index, span, place);
        chosen = Some(match chosen {
            None => value,
            Some(rest) => {
                let number = l.exprs.constant(i as f64 + 1.0);
                let here = l.exprs.compare(Compare::Eq, current, number);
                l.values().choose(here, (value, span), (rest, span), span)
            }
        });
    }
    chosen
}

impl Values<'_> {
    pub(in crate::elaborate) fn discrete(&mut self, var: VarId) -> ExprId {
        self.exprs.load(var, Flavour::Value, Affine::default())
    }
}
