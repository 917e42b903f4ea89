//! Nests of loops over binders, the order of declarations, and the numbers that declarations give.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Declaration, Expr};
use smpl_dsl::units::Unit;

use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::defaults::mentions;
use crate::elaborate::lower::loops::Piece;
use crate::elaborate::lower::nests::for_each_element;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::{Lowering, defaults, nests, units};
use crate::elaborate::outside::{check_initial, check_range, check_settings};
use crate::elaborate::symbols::{Axis, SymbolId, SymbolKind};
use crate::ir::{Affine, ExprId, Role, VarId};
use crate::model::Quantity;

/// Numbers of every declared variable: bounds, default, scale. Parameters come first, since others
/// may depend on them.
pub(in crate::elaborate) fn declare_defaults(l: &mut Lowering<'_, '_>) {
    let symbols: Vec<(SymbolId, VarId)> = l
        .symbols
        .list
        .iter()
        .filter_map(|(id, s)| match s.kind {
            SymbolKind::Variable { var, .. } => Some((id, var)),
            _ => None,
        })
        .collect();
    for &(symbol, var) in &symbols {
        if l.symbols.vars[var].role == Role::Param {
            defaults::know(l, symbol);
        }
    }
    for (symbol, var) in symbols {
        let quantity = quantity(l, symbol);
        l.quantities.insert(var, quantity);
    }
    check_settings(l);
    check_initial(l);
}

/// Bounds, default and scale of a variable as numbers.
fn quantity(l: &mut Lowering<'_, '_>, symbol: SymbolId) -> Quantity {
    let SymbolKind::Variable { var, axes, unit, declaration } = l.symbols[symbol].kind.clone() else {
        return empty_quantity();
    };
    let path = l.symbols[symbol].path.clone();
    let role = l.symbols.vars[var].role;
    let declared = Declared { symbol, var, axes: &axes, declaration };
    let default = default(l, &declared, role);
    let (low, high) = bounds(l, &declared, &unit, &path);
    let scale = scale(l, &declared, &unit, &path, (&low, &high));
    if role == Role::Action {
        l.ledger.check_action(&path, declaration, &low, &high, &default);
    }
    let quantity = Quantity {
        var: Some(var),
        name: path,
        axes: l.symbols.model_axes(&axes),
        pattern: declaration.pattern.clone(),
        unit: unit.to_string(),
        text: declaration.text.clone().unwrap_or_default(),
        low,
        high,
        default,
        scale,
        affine_unit: units::is_point(&unit),
        structural: false,
        nonnegative: declaration.nonnegative.is_some(),
    };
    if role == Role::Param {
        check_range(l, symbol, &quantity);
    }
    if role == Role::State {
        check_nonnegative(l.ledger, declaration, &quantity);
    }
    quantity
}

/// Reports a nonnegative state that cannot be one: of a unit with an offset, with an upper bound or
/// a start below zero.
fn check_nonnegative(ledger: &mut Ledger, d: &Declaration, quantity: &Quantity) {
    let Some(word) = d.nonnegative else { return };
    let name = &d.name.text;
    let negative = |numbers: &[f64]| numbers.iter().copied().find(|x| *x < 0.0);
    let (message, span, help) = if quantity.affine_unit {
        let message = format!("`{name}` is in {}, where zero is not the least value", quantity.unit);
        (message, word, "declare the state in K, or remove `nonnegative`")
    } else if let Some(high) = negative(&quantity.high) {
        let span = d.bounds.as_ref().map_or(word, |(_, high)| high.span);
        (format!("`{name}` is `nonnegative`, and its upper bound is {high}"), span, "raise the upper bound above zero")
    } else if let Some(start) = negative(&quantity.default) {
        let span = d.value.as_ref().map_or(word, |value| value.span);
        (format!("`{name}` is `nonnegative` and starts at {start}"), span, "start at zero or above, or remove `nonnegative`")
    } else {
        return;
    };
    ledger.report(Diagnostic::error(codes::NOT_NONNEGATIVE, message, span).help(help));
}

/// A variable whose declaration is read.
struct Declared<'d> {
    symbol: SymbolId,
    var: VarId,
    axes: &'d [Axis],
    declaration: &'d Declaration,
}

/// Defaults, where a declaration gives any that an episode begins with.
fn default(l: &mut Lowering<'_, '_>, declared: &Declared<'_>, role: Role) -> Vec<f64> {
    if role == Role::Discrete {
        return vec![f64::NAN];
    }
    let reports = l.ledger.reports.diagnostics.len();
    let pieces = defaults::default_pieces(l, declared.symbol, Site::Reset);
    let no_number = pieces.iter().any(|piece| defaults::constant_value(l, piece.value.1).is_some_and(f64::is_nan));
    if no_number && !l.ledger.reports.has_errors() {
        let (name, span) =
            (&declared.declaration.name.text, declared.declaration.value.as_ref().map_or(declared.declaration.span, |e| e.span));
        l.ledger.report(Diagnostic::error(codes::BAD_SETTING, format!("the value of `{name}` is not a number"), span));
    }
    let numbers = numbers(l, declared.var, pieces);
    if let Some(e) = &declared.declaration.value
        && role == Role::Action
        && numbers.iter().any(|x| x.is_nan())
        && l.ledger.reports.diagnostics.len() == reports
    {
        l.ledger.missing_value("a nominal value", e.span);
    }
    numbers
}

/// The lower and the upper bounds, infinite if undeclared.
fn bounds(l: &mut Lowering<'_, '_>, declared: &Declared<'_>, unit: &Unit, path: &str) -> (Vec<f64>, Vec<f64>) {
    let bounds = declared.declaration.bounds.as_ref();
    let low = declared_number(l, declared, unit, bounds.map(|b| &b.0), f64::NEG_INFINITY);
    let high = declared_number(l, declared, unit, bounds.map(|b| &b.1), f64::INFINITY);
    if let Some((a, b)) = bounds
        && (0..low.len().max(high.len())).any(|i| Quantity::pick(&low, i) > Quantity::pick(&high, i))
    {
        let message = format!("the bounds of `{path}` are the wrong way round");
        l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, a.span.to(b.span)));
    }
    (low, high)
}

/// The declared scale; otherwise the width between finite bounds, or one.
fn scale(l: &mut Lowering<'_, '_>, declared: &Declared<'_>, unit: &Unit, path: &str, (low, high): (&[f64], &[f64])) -> Vec<f64> {
    let difference = units::difference(unit);
    let given = declared.declaration.scale.as_ref();
    let scale = declared_number(l, declared, &difference, given, f64::NAN);
    if let Some(e) = given
        && let Some(bad) = scale.iter().find(|s| s.is_infinite() || **s <= 0.0)
    {
        let message = format!("the scale of `{path}` must be a positive number, it is {bad}");
        l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, e.span));
    }
    if !scale.iter().any(|s| s.is_nan()) {
        return scale;
    }
    let width = |i| Quantity::pick(high, i) - Quantity::pick(low, i);
    let or_one = |range: f64| if range.is_finite() && range > 0.0 { range } else { 1.0 };
    (0..scale.len().max(low.len()).max(high.len())).map(|i| or_one(width(i))).collect()
}

/// Numbers of the elements; one for all where they are equal.
fn numbers(l: &mut Lowering<'_, '_>, var: VarId, pieces: Vec<Piece<(Affine, ExprId)>>) -> Vec<f64> {
    if let [piece] = pieces.as_slice() {
        let value = piece.value.1;
        return vec![defaults::constant_value(l, value).unwrap_or(f64::NAN)];
    }
    let mut out = vec![f64::NAN; l.symbols.vars[var].len as usize];
    for piece in pieces {
        let (at, value) = piece.value;
        let Some(x) = defaults::constant_value(l, value) else { continue };
        for_each_element(&piece.extents, at, &mut |i| {
            if let Some(slot) = out.get_mut(i as usize) {
                *slot = x;
            }
        });
    }
    out
}

/// The numbers of a bound or a scale; `absent` if it is undeclared.
fn declared_number(l: &mut Lowering<'_, '_>, declared: &Declared<'_>, unit: &Unit, e: Option<&Expr>, absent: f64) -> Vec<f64> {
    let Some(e) = e else { return vec![absent] };
    let &Declared { symbol, var, axes, declaration: d } = declared;
    let place = Place::new(l.symbols[symbol].scope, Site::Dynamics);
    let what = format!("`{}`", d.name.text);
    let mut pieces = Vec::new();
    if axes.is_empty() || !mentions(e, &d.indices) {
        let value = l.number_in(e, unit, &what, d.span, &place);
        pieces.push(l.symbols.whole(var, value));
    } else {
        pieces = nests::nest(l, &d.indices, &place, &mut |s, inner| {
            (s.symbols.bound_address(axes, &d.indices, inner), s.number_in(e, unit, &what, d.span, inner))
        });
    }
    let numbers = numbers(l, var, pieces);
    if numbers.iter().any(|x| x.is_nan()) && !l.ledger.reports.has_errors() {
        l.ledger.missing_value("a bound or scale", e.span);
    }
    numbers
}

impl Ledger {
    fn check_action(&mut self, path: &str, d: &Declaration, low: &[f64], high: &[f64], nominal: &[f64]) {
        if !low.iter().chain(high).all(|x| x.is_finite()) {
            self.report(
                Diagnostic::error(codes::MISSING_CLAUSE, format!("the action `{path}` needs finite bounds"), d.name.span)
                    .help("write `in low..high`"),
            );
        } else if nominal.iter().enumerate().any(|(i, &x)| x < Quantity::pick(low, i) || x > Quantity::pick(high, i)) {
            self.report(Diagnostic::warning(
                codes::BAD_SETTING,
                format!("the nominal value of `{path}` is outside its bounds"),
                d.name.span,
            ));
        }
    }
}

/// A quantity of nothing.
fn empty_quantity() -> Quantity {
    Quantity {
        var: None,
        name: String::new(),
        axes: Vec::new(),
        pattern: None,
        unit: String::new(),
        text: String::new(),
        low: Vec::new(),
        high: Vec::new(),
        default: Vec::new(),
        scale: Vec::new(),
        affine_unit: false,
        structural: false,
        nonnegative: false,
    }
}
