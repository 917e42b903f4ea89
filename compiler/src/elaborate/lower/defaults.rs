//! Numbers of parameters while the model is compiled, and the values that declarations give.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr, ExprKind};

use crate::elaborate::instances::SAMPLE;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, nests};
use crate::elaborate::naming::Naming;
use crate::elaborate::options::Setting;
use crate::elaborate::symbols::{ScopeId, SymbolId, SymbolKind};
use crate::ir::{Affine, ExprId, Role, VarId};
use crate::model;

/// An element, or all of them, and its number.
type Set = (Option<i64>, f64);

/// Definition of a parameter, state or discrete variable: for each piece of its elements the
/// address and the value in its unit. What is set from outside comes last.
pub(in crate::elaborate) fn default_pieces(l: &mut Lowering<'_, '_>, symbol: SymbolId, site: Site) -> Vec<Piece<(Affine, ExprId)>> {
    let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { return Vec::new() };
    if l.symbols.vars[var].role != Role::Param {
        return declared_pieces(l, symbol, site);
    }
    let (is_whole, set) = set_from_outside(l, symbol);
    let mut pieces = if is_whole { Vec::new() } else { declared_pieces(l, symbol, site) };
    for (element, x) in set {
        let value = l.exprs.constant(x);
        pieces.push(match element {
            Some(at) => Piece { extents: Vec::new(), value: (Affine::constant(at), value) },
            None => l.symbols.whole(var, value),
        });
    }
    pieces
}

fn declared_pieces(l: &mut Lowering<'_, '_>, symbol: SymbolId, site: Site) -> Vec<Piece<(Affine, ExprId)>> {
    let SymbolKind::Variable { var, axes, unit, declaration } = l.symbols[symbol].kind.clone() else {
        return Vec::new();
    };
    let (path, scope, span) = {
        let s = &l.symbols[symbol];
        (s.path.clone(), s.scope, s.span)
    };
    let given = l.instances.given.get(&(scope, declaration.name.text.clone())).cloned();
    let (e, place) = match given {
        Some((e, outer)) => (e, outer),
        None => match &declaration.value {
            Some(e) => (e, Place::new(scope, site)),
            None => {
                let value = match l.symbols.vars[var].role {
                    Role::Algebraic | Role::Disturbance => 0.0,
                    Role::Param if l.instances.samples.taken() => SAMPLE,
                    role => {
                        missing_default(l, &path, role, span, scope);
                        f64::NAN
                    }
                };
                let value = l.exprs.constant(value);
                return vec![l.symbols.whole(var, value)];
            }
        },
    };
    let what = format!("`{path}`");
    if !axes.is_empty()
        && let Some(indexed) = whole_array(l, e, &declaration.indices, &place)
    {
        return nests::nest(l, &declaration.indices, &Place::new(scope, site), &mut |s, inner| {
            let at = s.symbols.bound_address(&axes, &declaration.indices, inner);
            let bound = declaration.indices.iter().filter_map(|b| Some((b.name.text.as_str(), inner.bound(&b.name.text)?.clone())));
            let there = bound.fold(place.clone(), |there, (name, to)| there.bind(name, to));
            (at, s.number_in(&indexed, &unit, &what, span, &Place { depth: inner.depth, ..there }))
        });
    }
    if axes.is_empty() || !mentions(e, &declaration.indices) {
        let value = l.number_in(e, &unit, &what, span, &place);
        return vec![l.symbols.whole(var, value)];
    }
    let mut place = place;
    place.scope = scope;
    nests::nest(l, &declaration.indices, &place, &mut |s, inner| {
        let at = s.symbols.bound_address(&axes, &declaration.indices, inner);
        (at, s.number_in(e, &unit, &what, span, inner))
    })
}

/// The element of an array that an expression names as a whole: `n_0` for `n_0[species]`.
fn whole_array(l: &Lowering<'_, '_>, e: &Expr, indices: &[Binder], place: &Place) -> Option<Expr> {
    let ExprKind::Name(name) = &e.kind else { return None };
    let symbol = place.bound(&name.text).is_none().then(|| l.symbols.lookup(place.scope, &name.text)).flatten()?;
    let axes = match &l.symbols[symbol].kind {
        SymbolKind::Variable { axes, .. } | SymbolKind::Table { axes, .. } | SymbolKind::Let { axes, .. } => axes,
        _ => return None,
    };
    let index = |b: &Binder| Expr { span: e.span, kind: ExprKind::Name(b.name.clone()) };
    let list = indices.iter().map(index).collect();
    (axes.len() == indices.len()).then(|| Expr { span: e.span, kind: ExprKind::Index(Box::new(e.clone()), list) })
}

fn missing_default(l: &mut Lowering<'_, '_>, path: &str, role: Role, span: Span, scope: ScopeId) {
    // A misspelt argument, which was reported, is intended for it.
    if role == Role::Param && l.instances.misspelt.contains(&scope) {
        return;
    }
    let (what, help) = match role {
        Role::Param => ("no value", "write `= value`, or give it where the component is used"),
        Role::State => ("no initial value", "write `= value`"),
        Role::Action => ("no nominal value", "write `= value`"),
        _ => ("no initial value", "write `= value`"),
    };
    let mut d = Diagnostic::error(codes::MISSING_DEFAULT, format!("`{path}` has {what}"), span).help(help);
    if let Some(&used) = l.instances.used_at.get(&scope) {
        d = d.secondary(used, "used here");
    }
    l.ledger.report(d);
}

/// Makes the default of a parameter known to constant evaluation, after those that it needs (with
/// an explicit stack: chains may be long).
pub(in crate::elaborate) fn know(l: &mut Lowering<'_, '_>, symbol: SymbolId) {
    let mut stack = vec![(symbol, None)];
    while let Some((symbol, pieces)) = stack.pop() {
        let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
        if let Some(pieces) = pieces {
            remember(l, var, pieces);
            continue;
        }
        if !l.constants.begin(var) {
            continue;
        }
        let outer = l.hidden.draws.site.replace((String::new(), model::Instant::Reset));
        let pieces = default_pieces(l, symbol, Site::Reset);
        l.hidden.draws.site = outer;
        let mut needed = Vec::new();
        for piece in &pieces {
            for (needs, _) in l.symbols.parameters_in(l.exprs, piece.value.1) {
                l.constants.note_need(var, needs);
                let var = needs;
                if let Some(&symbol) = l.symbols.of_var.get(&var).filter(|_| !l.constants.is_begun(var)) {
                    needed.push((symbol, None));
                }
            }
        }
        stack.push((symbol, Some(pieces)));
        stack.extend(needed);
    }
}

fn remember(l: &mut Lowering<'_, '_>, var: VarId, pieces: Vec<Piece<(Affine, ExprId)>>) {
    for piece in pieces {
        let (at, value) = piece.value;
        let Some(x) = folded(l, value) else { continue };
        if piece.extents.is_empty() {
            l.constants.set(var, at.offset, x);
        } else {
            for i in 0..i64::from(l.symbols.vars[var].len) {
                l.constants.set(var, i, x);
            }
        }
    }
}

/// The number that an expression of constants and parameters has with the parameters' defaults and
/// means of random numbers.
pub(in crate::elaborate) fn constant_value(l: &mut Lowering<'_, '_>, e: ExprId) -> Option<f64> {
    if let Some(x) = l.exprs.as_const(e) {
        return Some(x);
    }
    for (var, _) in l.symbols.parameters_in(l.exprs, e) {
        if let Some(&symbol) = l.symbols.of_var.get(&var) {
            know(l, symbol);
        }
    }
    folded(l, e)
}

/// The number of an expression with what is known of the parameters.
fn folded(l: &mut Lowering<'_, '_>, e: ExprId) -> Option<f64> {
    l.constants.fold(l.exprs, &l.symbols.vars, &l.hidden.draws, e)
}

/// Notes that sizes or indices were computed from an expression: its parameters keep their numbers.
pub(in crate::elaborate) fn mark_structural(l: &mut Lowering<'_, '_>, e: ExprId) {
    let parameters = l.symbols.parameters_in(l.exprs, e);
    l.constants.mark_structural(parameters.into_iter().map(|p| p.0));
}

/// Set values of a parameter, the whole before its elements, and whether they replace all of its
/// declaration.
pub(in crate::elaborate) fn set_from_outside(l: &mut Lowering<'_, '_>, symbol: SymbolId) -> (bool, Vec<Set>) {
    let path = l.symbols[symbol].path.clone();
    let options = l.input.options;
    let mut set = Vec::new();
    if let Some(value) = options.settings.get(&path) {
        l.constants.taken.insert(path.clone());
        match value {
            Setting::Number(x) => set.push((None, *x)),
            Setting::List(list) => set.extend(l.naming().elements_of_list(symbol, list)),
            Setting::Text(text) => {
                l.ledger.reports.scenario_fault(&path, format!("the parameter `{path}` takes a number, not `{text}`"), None)
            }
        }
    } else if let Some(x) = options.parameters.get(&path) {
        l.constants.taken.insert(path.clone());
        set.push((None, *x));
    }
    let is_whole = !set.is_empty();
    let layer = |name: &str| options.layers.get(name).copied().unwrap_or_default();
    let numbers = options.settings.iter().filter_map(|(name, value)| match value {
        Setting::Number(x) => Some((name, *x)),
        _ => None,
    });
    let mut elements: Vec<(usize, i64, f64)> = Vec::new();
    for (name, x) in numbers.chain(options.parameters.iter().map(|(name, x)| (name, *x))) {
        if let Some(at) = l.symbols.element_named(symbol, name) {
            l.constants.taken.insert(name.clone());
            elements.push((layer(name), at, x));
        }
    }
    elements.retain(|&(own, ..)| !is_whole || own >= layer(&path));
    elements.sort_by_key(|&(own, ..)| own);
    set.extend(elements.into_iter().map(|(_, at, x)| (Some(at), x)));
    (is_whole, set)
}

impl Naming<'_, '_> {
    fn elements_of_list(&mut self, symbol: SymbolId, list: &[f64]) -> Vec<Set> {
        let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { return Vec::new() };
        let (path, len) = (&self.symbols[symbol].path, self.symbols.vars[var].len as usize);
        if list.len() != len {
            let elements = if len == 1 { "one element".to_owned() } else { format!("{len} elements") };
            self.ledger.reports.scenario_fault(path, format!("the parameter `{path}` has {elements}, not {}", list.len()), None);
            return Vec::new();
        }
        list.iter().enumerate().map(|(i, x)| (Some(i as i64), *x)).collect()
    }
}

/// Returns `true` if an expression uses one of the index names.
pub(in crate::elaborate) fn mentions(e: &Expr, binders: &[Binder]) -> bool {
    binders.iter().any(|b| e.mentions(&b.name.text))
}
