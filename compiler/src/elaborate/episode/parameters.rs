//! Parameters that are drawn or computed from others, and disturbances.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Clip, Expr};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::common::{store, stream_name};
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, defaults, nests, units};
use crate::elaborate::symbols::{SymbolId, SymbolKind, Symbols};
use crate::graph::{Order, after_needs};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, FastMap, Flavour, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Instant, Quantity};

/// Parameters that are drawn or computed from others, those that others need first.
pub(in crate::elaborate) fn parameter_program(l: &mut Lowering<'_, '_>) -> Program {
    let mut pieces: Vec<(VarId, Piece<(Affine, ExprId)>)> = Vec::new();
    let symbols: Vec<SymbolId> = l.symbols.list.keys().collect();
    for symbol in symbols {
        let SymbolKind::Variable { var, declaration, .. } = l.symbols[symbol].kind else { continue };
        if l.symbols.vars[var].role != Role::Param {
            continue;
        }
        let path = l.symbols[symbol].path.clone();
        let overridden = l.input.options.parameters.contains_key(&path) || l.input.options.settings.contains_key(&path);
        let scope = l.symbols[symbol].scope;
        let given = l.instances.given.contains_key(&(scope, declaration.name.text.clone()));
        if let Some(sample) = declaration.sample.as_ref().filter(|_| !overridden && !given) {
            let list = drawn(l, symbol, sample);
            pieces.extend(list.into_iter().map(|p| (var, p)));
            continue;
        }
        for piece in defaults::default_pieces(l, symbol, Site::Reset) {
            if l.exprs.as_const(piece.value.1).is_some() {
                continue;
            }
            if let Some(what) = l.symbols.varying(l.exprs, piece.value.1) {
                let span = declaration.value.as_ref().map_or(declaration.span, |e| e.span);
                l.ledger.report(
                    Diagnostic::error(codes::WRONG_KIND, format!("the parameter `{path}` cannot depend on {what}"), span)
                        .label("changes while the model runs")
                        .help(format!("make it a `let`: `let {} = ...`", declaration.name.text)),
                );
                continue;
            }
            pieces.push((var, piece));
        }
    }
    let order = dependency_order(l, &pieces);
    let offsets = l.symbols.offsets_of(Role::Param);
    let mut program = Program { nests: Vec::new(), in_place: true };
    for i in order {
        let (var, piece) = &pieces[i];
        let (at, value) = piece.value;
        let offset = offsets.get(var).copied().unwrap_or_default();
        let given = l.exprs.load(l.hidden.param_given, Flavour::Value, Affine::constant(offset).plus(at));
        let zero = l.exprs.constant(0.0);
        let keep = l.exprs.compare(Compare::Lt, zero, given);
        let present = l.exprs.load(*var, Flavour::Value, at);
        let value = l.exprs.select(keep, present, value);
        program.nests.push(Nest::over(piece.extents.clone(), vec![store(Memory::Var(*var), at, value)]));
    }
    program
}

/// Quantities that a draw of a parameter may read.
const DRAWN: &str = "a parameter is drawn once, at reset: its distribution and limits read numbers and other parameters";

/// Quantities that the rule of a disturbance may read.
const RULE: &str = "a rule runs ahead of the step: it reads disturbances, discrete variables, actions, parameters and the time, and states at the end of the step before, `previous(x)`";

/// Reports a distribution, or its limits, that reads what is not known there.
fn refuse_reading(l: &mut Lowering<'_, '_>, whose: &str, what: &str, (rule, clip): (&Expr, Option<&Clip>), help: &str) {
    let span = match clip {
        Some(Clip::Range(_, high)) => rule.span.to(high.span),
        _ => rule.span,
    };
    let fault = Diagnostic::error(codes::WRONG_KIND, format!("{whose} cannot depend on {what}"), span);
    l.ledger.report(fault.label("not known when it is drawn").help(help));
}

/// The elements of a parameter that is drawn.
fn drawn(l: &mut Lowering<'_, '_>, symbol: SymbolId, sample: &Expr) -> Vec<Piece<(Affine, ExprId)>> {
    let SymbolKind::Variable { var, unit, declaration, axes } = l.symbols[symbol].kind.clone() else { return Vec::new() };
    let path = l.symbols[symbol].path.clone();
    let place = Place::new(l.symbols[symbol].scope, Site::Reset);
    nests::nest(l, &declaration.indices, &place, &mut |s, inner| {
        let at = s.symbols.bound_address(&axes, &declaration.indices, inner);
        let outer = s.hidden.draws.site.replace((stream_name(&path, at, s.symbols.vars[var].len), Instant::Reset));
        let v = s.number_in(sample, &unit, &path, declaration.span, inner);
        s.hidden.draws.site = outer;
        let v = clipped(s, v, var, at, declaration.clip.as_ref(), &unit, inner);
        if let Some(what) = s.symbols.varying(s.exprs, v) {
            refuse_reading(s, &format!("the parameter `{path}`"), &what, (sample, declaration.clip.as_ref()), DRAWN);
        }
        (at, v)
    })
}

/// The pieces so that each follows those that it needs.
fn dependency_order(l: &mut Lowering<'_, '_>, pieces: &[(VarId, Piece<(Affine, ExprId)>)]) -> Vec<usize> {
    let mut of: FastMap<VarId, Vec<usize>> = FastMap::default();
    for (i, (var, _)) in pieces.iter().enumerate() {
        of.entry(*var).or_default().push(i);
    }
    let meets = |a: Affine, b: Affine| a == b || !a.is_constant() || !b.is_constant();
    let needs = |i: usize| {
        let read = l.symbols.parameters_in(l.exprs, pieces[i].1.value.1);
        let needed = |(var, at): (VarId, Affine)| {
            let candidates = of.get(&var).into_iter().flatten().copied();
            candidates.filter(move |&j| meets(at, pieces[j].1.value.0))
        };
        read.into_iter().flat_map(needed).collect()
    };
    let Order { order, closing } = after_needs(0..pieces.len(), needs);
    for (_, j) in closing {
        let v = &l.symbols.vars[pieces[j].0];
        let d = Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the value of `{}` needs itself", v.name), v.span);
        l.ledger.report(d);
    }
    order
}

/// Limits in a unit; reports constant ones that are the wrong way round.
pub(in crate::elaborate) fn limits(
    l: &mut Lowering<'_, '_>,
    (a, b): (&Expr, &Expr),
    unit: &Unit,
    place: &Place,
    help: &str,
) -> (ExprId, ExprId) {
    let (low, high) = (l.number_in(a, unit, "the limit", a.span, place), l.number_in(b, unit, "the limit", b.span, place));
    if let [Some(x), Some(y)] = [low, high].map(|e| defaults::constant_value(l, e))
        && x > y
    {
        let unit = if units::is_dimensionless(unit) { String::new() } else { format!(" [{unit}]") };
        let message = format!("the limits are the wrong way round: {x}..{y}{unit}");
        l.ledger.report(Diagnostic::error(codes::WRONG_ARGUMENTS, message, a.span.to(b.span)).help(help));
    }
    (low, high)
}

/// A value limited as a `clip` clause says.
pub(in crate::elaborate) fn clipped(
    l: &mut Lowering<'_, '_>,
    v: ExprId,
    var: VarId,
    at: Affine,
    clip: Option<&Clip>,
    unit: &Unit,
    place: &Place,
) -> ExprId {
    let (low, high) = match clip {
        None => return v,
        Some(Clip::Range(a, b)) => limits(l, (a, b), unit, place, "the form is `clip low..high`"),
        Some(Clip::Bounds(span)) => {
            let Some(q) = l.quantities.get(&var) else { return v };
            let first = at.offset.max(0) as usize;
            let mut elements = if at.is_constant() { first..first + 1 } else { 0..q.low.len().max(q.high.len()) };
            if elements.all(|i| !Quantity::pick(&q.low, i).is_finite() && !Quantity::pick(&q.high, i).is_finite()) {
                let (name, declared) = (q.name.clone(), l.symbols.vars[var].span);
                l.ledger.report(
                    Diagnostic::error(codes::MISSING_CLAUSE, format!("`{name}` has no bounds to clip to"), *span)
                        .secondary(declared, "declared here")
                        .help("write `in low..high` in its declaration, or `clip low..high`"),
                );
                return v;
            }
            (l.exprs.entry_at(&q.low, at), l.exprs.entry_at(&q.high, at))
        }
    };
    let v = l.exprs.binary(BinaryFn::Max, v, low);
    l.exprs.binary(BinaryFn::Min, v, high)
}

/// Update of the disturbances at each step.
pub(in crate::elaborate) fn disturbance_program(l: &mut Lowering<'_, '_>) -> Program {
    let mut program = Program { nests: Vec::new(), in_place: true };
    let symbols: Vec<SymbolId> = l.symbols.list.keys().collect();
    let mut scalars = Vec::new();
    for symbol in symbols {
        let SymbolKind::Variable { var, unit, declaration, axes } = l.symbols[symbol].kind.clone() else { continue };
        if l.symbols.vars[var].role != Role::Disturbance {
            continue;
        }
        let Some(rule) = &declaration.sample else { continue };
        let path = l.symbols[symbol].path.clone();
        let place = Place::new(l.symbols[symbol].scope, Site::Disturb);
        let pieces = nests::nest(l, &declaration.indices, &place, &mut |s, inner| {
            let at = s.symbols.bound_address(&axes, &declaration.indices, inner);
            let outer = s.hidden.draws.site.replace((stream_name(&path, at, s.symbols.vars[var].len), Instant::Step));
            let v = s.number_in(rule, &unit, &path, declaration.span, inner);
            s.hidden.draws.site = outer;
            let v = clipped(s, v, var, at, declaration.clip.as_ref(), &unit, inner);
            if let Some(what) = s.symbols.unknown_now(s.exprs, v) {
                refuse_reading(s, &format!("the disturbance `{path}`"), &what, (rule, declaration.clip.as_ref()), RULE);
            }
            (at, v)
        });
        for piece in pieces {
            let s = store(Memory::Var(var), piece.value.0, piece.value.1);
            if piece.extents.is_empty() {
                scalars.push(s);
            } else {
                program.nests.push(Nest::over(piece.extents, vec![s]));
            }
        }
    }
    if !scalars.is_empty() {
        program.nests.insert(0, Nest { loops: Vec::new(), stores: scalars });
    }
    program
}

impl<'a> Symbols<'a> {
    /// Positions of the variables of a role in its region.
    fn offsets_of(&self, role: Role) -> FastMap<VarId, i64> {
        let mut offsets = FastMap::default();
        let mut next = 0;
        for (var, v) in self.vars.iter().filter(|(_, v)| v.role == role) {
            offsets.insert(var, next);
            next += i64::from(v.len);
        }
        offsets
    }
}
