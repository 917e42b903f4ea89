//! Public quantities: observations, algebraic outputs, the interface.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Binder, Declaration, Expr, ExprKind, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::episode::assembly::Assembly;
use crate::elaborate::episode::common::store;
use crate::elaborate::episode::phases::schedule_quantities;
use crate::elaborate::episode::positions::state_positions;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::{Lowering, nests};
use crate::elaborate::symbols::{self, Axis, Symbol, SymbolId, SymbolKind};
use crate::ir::{Affine, FastSet, LoopVar, Place as Memory, Program, Role, VarId};
use crate::model::{Port, PortMember, Quantities, Quantity};

/// Declared algebraic variables and `let`s with a unit, and behind them the members of ports.
pub(in crate::elaborate) fn output_program(l: &mut Lowering<'_, '_>) -> (Program, Vec<Quantity>) {
    let mut program = Assembly::default();
    let mut at = 0_i64;
    let mut list = Vec::new();
    let members: Vec<SymbolId> = l.symbols.ports.iter().flat_map(|port| &port.members).copied().collect();
    let known: FastSet<SymbolId> = members.iter().copied().collect();
    for symbol in l.in_text_order().into_iter().filter(|symbol| !known.contains(symbol)).chain(members) {
        match l.symbols[symbol].kind.clone() {
            SymbolKind::Variable { var, axes, .. } if l.symbols.vars[var].role == Role::Algebraic => {
                let Some(q) = l.quantities.get(&var).cloned() else { continue };
                variable_output(l, var, &axes, at, &mut program);
                at += i64::from(l.symbols.vars[var].len);
                list.push(q);
            }
            SymbolKind::Let { axes, unit: Some(unit), declaration, .. } if axes.iter().all(|a| matches!(a, Axis::Set(_))) => {
                let_output(l, symbol, &axes, declaration, at, &mut program);
                let count = axes.iter().map(|&a| l.symbols.axis_len(a)).product::<i64>();
                at += count;
                if count > 0 {
                    list.push(let_quantity(l, symbol, &axes, &unit, declaration));
                }
            }
            _ => {}
        }
    }
    (program.program(), list)
}

/// The elements of an algebraic variable from a place of the output on.
fn variable_output(l: &mut Lowering<'_, '_>, var: VarId, axes: &[Axis], at: i64, program: &mut Assembly) {
    let len = l.symbols.vars[var].len;
    let mut load = |element: Affine| {
        let value = l.exprs.load(var, crate::ir::Flavour::Value, element);
        store(Memory::Out, Affine::constant(at).plus(element), value)
    };
    if !axes.iter().any(|&a| l.symbols.may_run(a)) {
        // Element by element, so that each definition can be substituted.
        program.single.extend((0..i64::from(len)).map(|i| load(Affine::constant(i))));
    } else if len == 1 {
        program.single.push(load(Affine::default()));
    } else {
        program.push(vec![len], load(Affine::along(0, LoopVar(0), 1)));
    }
}

/// The elements of a `let` from a place of the output on.
fn let_output(l: &mut Lowering<'_, '_>, symbol: SymbolId, axes: &[Axis], declaration: &Declaration, at: i64, program: &mut Assembly) {
    for Piece { extents, value: (element, value) } in let_pieces(l, symbol, axes, declaration) {
        let value = l.exprs.number(value.expr);
        program.push(extents, store(Memory::Out, Affine::constant(at).plus(element), value));
    }
}

/// The elements of a `let` and their values, in loops.
pub(super) fn let_pieces(
    l: &mut Lowering<'_, '_>,
    symbol: SymbolId,
    axes: &[Axis],
    declaration: &Declaration,
) -> Vec<Piece<(Affine, Value)>> {
    let place = Place::new(l.symbols[symbol].scope, Site::Instant);
    let binders = &declaration.indices;
    let name = |b: &Binder| Expr { span: b.span, kind: ExprKind::Name(Ident { text: b.name.text.clone(), span: b.span }) };
    let index: Vec<Expr> = binders.iter().map(name).collect();
    nests::looped_nest(l, binders, &place, &mut |s, inner| {
        let value = s.symbol_value(symbol, &index, declaration.span, inner);
        if value.is_poison() {
            s.ledger.speculation.refuse();
        }
        (s.symbols.bound_address(axes, binders, inner), value)
    })
}

/// A `let` as a quantity: its name, indices and unit.
pub(super) fn let_quantity(l: &Lowering<'_, '_>, symbol: SymbolId, axes: &[Axis], unit: &Unit, declaration: &Declaration) -> Quantity {
    Quantity {
        var: None,
        name: l.symbols[symbol].path.clone(),
        axes: l.symbols.model_axes(axes),
        pattern: declaration.pattern.clone(),
        unit: unit.to_string(),
        text: declaration.text.clone().unwrap_or_default(),
        low: vec![f64::NEG_INFINITY],
        high: vec![f64::INFINITY],
        default: vec![f64::NAN],
        scale: vec![1.0],
        affine_unit: unit.is_point(),
        structural: false,
        nonnegative: false,
    }
}

/// The states in the order of declaration, by their own numbers; `None` where that is their own
/// order.
fn state_order(l: &Lowering<'_, '_>) -> Option<Vec<u32>> {
    let positions = state_positions(l).into_iter().flat_map(|(_, list)| list);
    let mut order: Vec<(u32, u32)> = positions.zip(0..).collect();
    order.sort_unstable();
    let order: Vec<u32> = order.into_iter().map(|(_, own)| own).collect();
    let is_own = order.iter().zip(0..).all(|(&own, i)| own == i);
    (!is_own).then_some(order)
}

/// Paths of the disturbances that follow data over time; warns of data outside of the declared
/// bounds.
pub(in crate::elaborate) fn measured(l: &mut Lowering<'_, '_>) -> Vec<String> {
    let mut out = Vec::new();
    for symbol in l.in_text_order() {
        let Symbol { path, scope, kind: SymbolKind::Variable { var, declaration, .. }, .. } = &l.symbols[symbol] else { continue };
        let Some(measured) = &declaration.measured else { continue };
        out.push(path.clone());
        let ExprKind::Call { function, .. } = &measured.read.kind else { continue };
        let table = l.symbols.lookup(*scope, &function.text).map(|table| &l.symbols[table].kind);
        let (Some(SymbolKind::TimeTable { points, .. }), Some(q)) = (table, l.quantities.get(var)) else { continue };
        let (low, high) = (Quantity::pick(&q.low, 0), Quantity::pick(&q.high, 0));
        if let Some((at, x)) = points.iter().find(|(_, x)| !Quantity::admits(low, high, *x)) {
            let message = format!("the data of `{path}` leave its bounds {low}..{high}: {x} at {at} {}", l.symbols.time_unit);
            let warning = Diagnostic::warning(codes::BAD_DATA, message, measured.path_span);
            l.ledger.report(warning.help("correct the data, or widen the bounds"));
        }
    }
    out
}

/// The ports; what their members are equal to is known once the equations are solved.
pub(in crate::elaborate) fn ports(l: &Lowering<'_, '_>) -> Vec<Port> {
    let member = |symbol: SymbolId, flow: bool| {
        let SymbolKind::Variable { declaration, .. } = &l.symbols[symbol].kind else { return None };
        Some(PortMember { name: declaration.name.text.clone(), output: l.symbols[symbol].path.clone(), equals: None, flow })
    };
    let port = |port: &symbols::Port| Port {
        name: port.path.clone(),
        connector: port.connector.clone(),
        members: port.members.iter().filter_map(|&symbol| member(symbol, port.flows.contains(&symbol))).collect(),
    };
    l.symbols.ports.iter().map(port).collect()
}

/// The quantities but for algebraic ones.
pub(in crate::elaborate) fn quantities(l: &mut Lowering<'_, '_>) -> Quantities {
    let quantity = |s: &Lowering<'_, '_>, v: VarId| s.quantities.get(&v).cloned();
    let of =
        |s: &Lowering<'_, '_>, role: Role| -> Vec<Quantity> { s.variables_of(role).into_iter().filter_map(|v| quantity(s, v)).collect() };
    let lists = [Role::State, Role::Discrete, Role::Action, Role::Disturbance, Role::Param].map(|r| of(l, r));
    let [states, mut discretes, actions, disturbances, mut parameters] = lists;
    for quantity in &mut parameters {
        quantity.structural = quantity.var.is_some_and(|var| l.constants.is_structural(var));
    }
    discretes.extend(schedule_quantities(l));
    Quantities { states, state_order: state_order(l), discretes, actions, disturbances, parameters, ..Quantities::default() }
}
