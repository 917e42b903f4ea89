//! Functions of the model, expanded where they are called.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, BinderSet, Expr, Ident, Local, ParameterKind};

use crate::elaborate::lower::place::{Bound, Place, Target};
use crate::elaborate::lower::value::Value;
use crate::elaborate::lower::{Lowering, indices, paths, units};
use crate::elaborate::symbols::{Axis, ScopeId, SymbolId, SymbolKind};

/// The value of a call.
pub(in crate::elaborate) fn expand(l: &mut Lowering<'_, '_>, span: Span, symbol: SymbolId, arguments: &[Expr], place: &Place) -> Value {
    let SymbolKind::Def { parameters, locals, body } = l.symbols[symbol].kind else { return l.poison() };
    if !l.ledger.may_write_out(span) {
        return l.poison();
    }
    let path = l.symbols[symbol].path.clone();
    if parameters.len() != arguments.len() {
        let declared = l.symbols[symbol].span;
        let message = format!("`{path}` takes {} arguments, not {}", parameters.len(), arguments.len());
        return l.fault(Diagnostic::error(codes::WRONG_ARGUMENTS, message, span).secondary(declared, "declared here"));
    }
    if l.expansions.is_open(symbol) {
        let declared = l.symbols[symbol].span;
        let chain = l.expansions.cycle(symbol, l.symbols);
        return l.fault(
            Diagnostic::error(codes::CYCLIC_DEFINITION, format!("`{path}` calls itself{chain}"), declared)
                .help("functions are expanded where they are called, so none can call itself"),
        );
    }
    let mut inner = place.clone();
    inner.scope = l.symbols[symbol].scope;
    inner.bindings = None;
    for (parameter, argument) in parameters.iter().zip(arguments) {
        let bound = match &parameter.kind {
            ParameterKind::Value => Some(Bound::Value(l.value(argument, place))),
            ParameterKind::Index(set) => index(l, set, argument, (&inner, place)),
            ParameterKind::Array(binders) => {
                let sets = array(l, (&parameter.name, binders), argument, (&inner, place));
                let alias = sets.is_some().then(|| Bound::Alias(argument.clone(), place.scope, place.bindings.clone()));
                sets.into_iter().flatten().for_each(|(name, axis)| inner = inner.bind(&name, Bound::Axis(axis)));
                alias
            }
        };
        let Some(bound) = bound else { return l.poison() };
        inner = inner.bind(&parameter.name.text, bound);
    }
    l.expansions.note_use(symbol);
    l.expansions.enter(symbol);
    l.ledger.reports.calls.push(span);
    let inner = with_locals(l, locals, inner);
    let v = l.value(body, &inner);
    l.ledger.reports.calls.pop();
    l.expansions.leave();
    v
}

/// The place with the local names of a function bound, each of which sees those before it.
pub(in crate::elaborate) fn with_locals(l: &mut Lowering<'_, '_>, locals: &[Local], mut place: Place) -> Place {
    for local in locals {
        let value = match local.unit.as_ref().map(|written| units::unit(l, written, &place)) {
            Some(Some(unit)) => {
                let (what, declared) = (format!("`{}`", local.name.text), local.name.span);
                let taken = &mut |s: &mut Lowering<'_, '_>, v: Value, span| s.values().strictly_or_bare(v, &unit, span, &what, declared);
                l.declared_value(&local.value, &place, taken, &unit)
            }
            Some(None) => l.poison(),
            None => l.value(&local.value, &place),
        };
        place = place.bind(&local.name.text, Bound::Value(value));
    }
    place
}

/// The index that an argument is: a member, a number or a cell.
fn index(l: &mut Lowering<'_, '_>, set: &Ident, argument: &Expr, (inner, place): (&Place, &Place)) -> Option<Bound> {
    let axis = axis_named(l, set, inner)?;
    indices::bound_index(l, axis, argument, place)
}

/// The axis of a set or domain that a function names; reports what is neither.
fn axis_named(l: &mut Lowering<'_, '_>, set: &Ident, place: &Place) -> Option<Axis> {
    if let Some(Bound::Axis(axis)) = place.bound(&set.text) {
        return Some(*axis);
    }
    let known = l.symbols.lookup(place.scope, &set.text).map(|symbol| l.symbols[symbol].kind.clone());
    match known {
        Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => Some(Axis::Set(set)),
        Some(SymbolKind::Domain(domain)) => Some(Axis::Domain(domain)),
        Some(SymbolKind::Faulty) => None,
        _ => {
            let sets = l.symbols.sets.values().map(|set| set.name.clone()).collect::<Vec<_>>();
            let help = l.ledger.reports.did_you_mean(&set.text, sets.iter().map(String::as_str));
            let fault = Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set or domain `{}`", set.text), set.span);
            l.ledger.report(fault.maybe_help(help));
            None
        }
    }
}

/// Checks that an argument is an array over what a parameter says, and gives the sets that the
/// parameter names and the model does not declare.
fn array(
    l: &mut Lowering<'_, '_>,
    (name, binders): (&Ident, &[Binder]),
    argument: &Expr,
    (inner, place): (&Place, &Place),
) -> Option<Vec<(String, Axis)>> {
    let axes = axes_of(l, argument, place)?;
    if axes.len() != binders.len() {
        let over: Vec<&str> = binders.iter().map(|binder| over(binder).map_or("...", |set| set.text.as_str())).collect();
        let found = if axes.is_empty() { "a single value".to_owned() } else { format!("an array with {} indices", axes.len()) };
        let message = format!("`{}[{}]` takes an array, this is {found}", name.text, over.join(", "));
        let fault = Diagnostic::error(codes::WRONG_SHAPE, message, argument.span).secondary(name.span, "declared here");
        l.ledger.report(fault.help("pass the name of an array without its indices"));
        return None;
    }
    let mut made: Vec<(String, Axis)> = Vec::new();
    for (binder, axis) in binders.iter().zip(axes) {
        let Some(set) = over(binder) else {
            let message = "a parameter that is an array runs over a set or a domain";
            l.ledger.report(Diagnostic::error(codes::BAD_BINDER, message, binder.span));
            return None;
        };
        let earlier = made.iter().find(|(name, _)| *name == set.text).map(|(_, axis)| *axis);
        let bound = match inner.bound(&set.text) {
            Some(Bound::Axis(axis)) => Some(*axis),
            _ => None,
        };
        let known = match earlier.or(bound) {
            Some(axis) => Some(axis),
            None if is_generic(l, set, inner.scope) => None,
            None => Some(axis_named(l, set, inner)?),
        };
        match known {
            Some(known) if known != axis => {
                let (wanted, found) = (l.symbols.axis_name(known).to_owned(), l.symbols.axis_name(axis).to_owned());
                let message = format!("`{}` takes an array over `{wanted}`, this one is over `{found}`", name.text);
                let fault = Diagnostic::error(codes::WRONG_SHAPE, message, argument.span);
                l.ledger.report(fault.secondary(binder.span, "declared here"));
                return None;
            }
            Some(_) => {}
            None => made.push((set.text.clone(), axis)),
        }
    }
    Some(made)
}

/// The set or domain that an index of a parameter names.
fn over(binder: &Binder) -> Option<&Ident> {
    match &binder.over {
        BinderSet::Itself => Some(&binder.name),
        BinderSet::Set(set) => Some(set),
        BinderSet::Range(..) | BinderSet::Tuple(_) => None,
    }
}

/// Returns whether a name is not a declared set: it stands for the set of the argument.
pub(in crate::elaborate) fn is_generic(l: &Lowering<'_, '_>, set: &Ident, scope: ScopeId) -> bool {
    l.symbols.lookup(scope, &set.text).is_none()
}

/// Names of the sets in parameters that the model does not declare.
pub(in crate::elaborate) fn generic_sets<'p>(l: &Lowering<'_, '_>, kind: &'p ParameterKind, scope: ScopeId) -> Vec<&'p Ident> {
    let ParameterKind::Array(binders) = kind else { return Vec::new() };
    binders.iter().filter_map(over).filter(|set| is_generic(l, set, scope)).collect()
}

/// The sets and domains over which an argument is an array; none for a single value.
fn axes_of(l: &mut Lowering<'_, '_>, argument: &Expr, place: &Place) -> Option<Vec<Axis>> {
    match paths::resolve(l, argument, place) {
        Target::Symbol(symbol) => Some(match &l.symbols[symbol].kind {
            SymbolKind::Variable { axes, .. } | SymbolKind::Let { axes, .. } | SymbolKind::Table { axes, .. } => axes.to_vec(),
            SymbolKind::Faulty => return None,
            _ => Vec::new(),
        }),
        Target::Value(v) => (!v.is_poison()).then(Vec::new),
        Target::Nothing => None,
    }
}
