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

impl Lowering<'_, '_> {
    /// `phase` as a number, `phase_time` as a time; `None` for other names.
    pub(in crate::elaborate) fn schedule_name(&mut self, name: &Ident) -> Option<Value> {
        let schedule = self.symbols.schedule.as_ref()?;
        match name.text.as_str() {
            "phase" => Some(Value::bare(self.values().discrete(schedule.current))),
            "phase_time" => {
                let (t, since) = (self.exprs.time(), self.values().discrete(schedule.since));
                let expr = self.exprs.sub(t, since);
                Some(Value::of(expr, self.symbols.time_unit.clone()))
            }
            _ => None,
        }
    }

    /// `phase == elute`: outer `None` where neither side is `phase`.
    pub(in crate::elaborate) fn phase_comparison(&mut self, a: &Expr, b: &Expr, place: &Place) -> Option<Value> {
        let schedule = self.symbols.schedule.as_ref()?;
        let is_phase = |s: &Self, e: &Expr| {
            matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
                && s.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(s.symbols[id].kind, SymbolKind::Phase(_))))
        };
        let other = match (is_phase(self, a), is_phase(self, b)) {
            (true, false) => b,
            (false, true) => a,
            _ => return None,
        };
        let ExprKind::Name(name) = &other.kind else { return None };
        let Some(at) = schedule.phases.iter().position(|p| p.name.text == name.text) else {
            if self.symbols.lookup(place.scope, &name.text).is_some() {
                return None;
            }
            let known = schedule.phases.iter().map(|p| p.name.text.as_str());
            let help = did_you_mean(&name.text, known);
            let d = Diagnostic::error(codes::UNKNOWN_NAME, format!("no phase is called `{}`", name.text), name.span);
            return Some(self.fault(d.maybe_help(help)));
        };
        let (current, number) = (self.values().discrete(schedule.current), self.exprs.constant(at as f64 + 1.0));
        let expr = self.exprs.compare(Compare::Eq, current, number);
        Some(Value::truth(expr))
    }

    /// Whether one of the indices is the phase in force; then the value is chosen among those of all phases.
    pub(in crate::elaborate) fn by_phase(&mut self, symbol: SymbolId, index: &[Expr], span: Span, place: &Place) -> Option<Value> {
        let schedule = self.symbols.schedule.as_ref()?;
        let at = index.iter().position(|e| {
            matches!(&e.kind, ExprKind::Name(n) if n.text == "phase" && place.bound("phase").is_none()
                && self.symbols.lookup(place.scope, "phase").is_some_and(|id| matches!(self.symbols[id].kind, SymbolKind::Phase(_))))
        })?;
        let current = self.values().discrete(schedule.current);
        let mut chosen: Option<Value> = None;
        for (i, phase) in schedule.phases.iter().enumerate().rev() {
            let mut index = index.to_vec();
            index[at] = Expr { span: index[at].span, kind: ExprKind::Name(phase.name.clone()) };
            let value = self.symbol_value(symbol, &index, span, place);
            chosen = Some(match chosen {
                None => value,
                Some(rest) => {
                    let number = self.exprs.constant(i as f64 + 1.0);
                    let here = self.exprs.compare(Compare::Eq, current, number);
                    self.values().choose(here, (value, span), (rest, span), span)
                }
            });
        }
        chosen
    }
}

impl Values<'_> {
    pub(in crate::elaborate) fn discrete(&mut self, var: VarId) -> ExprId {
        self.exprs.load(var, Flavour::Value, Affine::default())
    }
}
