//! Nests of loops over binders, the order of declarations, and the numbers that declarations give.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Declaration, Expr, StatementKind};
use smpl_dsl::units::Unit;

use crate::elaborate::declare::symbols::{Axis, ScopeId, SymbolId, SymbolKind, Symbols};
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::cells::Cell;
use crate::elaborate::lower::functions::BinderValue;
use crate::elaborate::lower::units;
use crate::elaborate::select::items::Item;
use crate::elaborate::{Bound, Elaborator, Place, Site};
use crate::ir::{Affine, Expr as Node, ExprId, Exprs, FastMap, FastSet, LoopVar, Role, VarId};
use crate::model::{self, Quantity};

/// Something elaborated inside a nest of loops.
#[derive(Clone, Debug)]
pub struct Piece<T> {
    /// Extents of the loops, the outermost first.
    pub extents: Vec<u32>,
    /// What was made.
    pub value: T,
}

impl<'a> Elaborator<'a> {
    /// Elaborates `body` for everything that the binders run over: sets written out, cells as loops.
    pub(in crate::elaborate) fn nest<T>(
        &mut self,
        binders: &[Binder],
        place: &Place,
        body: &mut dyn FnMut(&mut Self, &Place) -> T,
    ) -> Vec<Piece<T>> {
        self.nest_of(binders, place, false, body)
    }

    /// As [`Self::nest`], with ranges of numbers as loops where `body` does not [refuse](Self::refuse).
    pub(in crate::elaborate) fn looped_nest<T>(
        &mut self,
        binders: &[Binder],
        place: &Place,
        body: &mut dyn FnMut(&mut Self, &Place) -> T,
    ) -> Vec<Piece<T>> {
        self.nest_of(binders, place, true, body)
    }

    fn nest_of<T>(&mut self, binders: &[Binder], place: &Place, runs: bool, body: &mut dyn FnMut(&mut Self, &Place) -> T) -> Vec<Piece<T>> {
        let Some((binder, rest)) = binders.split_first() else {
            return vec![Piece { extents: Vec::new(), value: body(self, place) }];
        };
        if runs
            && let Some(range) = self.run_of(binder, place)
            && let Some(pieces) =
                self.attempt(|s| s.looped(binder, range, Bound::Run, place, &mut |s, inner| s.nest_of(rest, inner, runs, body)))
        {
            return pieces;
        }
        let mut out = Vec::new();
        for value in self.bindings_of(binder, place) {
            if !self.ledger.may_write_out(binder.span) {
                break;
            }
            let (low, high) = match &value {
                BinderValue::One(bound) => {
                    let inner = place.bind(&binder.name.text, bound.clone());
                    out.extend(self.nest_of(rest, &inner, runs, body));
                    continue;
                }
                BinderValue::Cells(_, low, high) => (*low, *high),
                BinderValue::Elements(_, len) => (0, len - 1),
            };
            let bound = |cell: Cell| match &value {
                BinderValue::Elements(symbol, _) => Bound::Element(*symbol, cell.affine()),
                BinderValue::Cells(domain, ..) => Bound::Cell(*domain, cell),
                BinderValue::One(bound) => bound.clone(),
            };
            out.extend(self.looped(binder, (low, high), bound, place, &mut |s, inner| s.nest_of(rest, inner, runs, body)));
        }
        out
    }

    /// The pieces of a loop, with what `body` makes in it.
    fn looped<T>(
        &mut self,
        binder: &Binder,
        (low, high): (i64, i64),
        bound: impl Fn(Cell) -> Bound,
        place: &Place,
        body: &mut dyn FnMut(&mut Self, &Place) -> Vec<Piece<T>>,
    ) -> Vec<Piece<T>> {
        let mut out = Vec::new();
        let pieces = self.cells(low, high, binder.span, place, &mut |s, cell, inner| body(s, &inner.bind(&binder.name.text, bound(cell))));
        for (cell, list) in pieces {
            for piece in list {
                let mut extents = Vec::with_capacity(piece.extents.len() + 1);
                extents.extend(cell.along.map(|_| cell.count as u32));
                extents.extend(piece.extents);
                out.push(Piece { extents, value: piece.value });
            }
        }
        out
    }

    /// Symbols of variables and outputs in the order of the text, instances where they stand.
    pub(in crate::elaborate) fn in_text_order(&self) -> Vec<SymbolId> {
        let mut out = Vec::new();
        let blocks = self.instances.blocks.iter().map(|(scope, items)| (*scope, items.as_slice())).collect();
        self.symbols.walk(ScopeId::from_u32(0), &blocks, &mut out);
        out
    }

    /// Numbers of every declared variable: bounds, default, scale. Parameters come first, since others may depend on them.
    pub(in crate::elaborate) fn declare_defaults(&mut self) {
        let symbols: Vec<(SymbolId, VarId)> = self
            .symbols
            .list
            .iter()
            .filter_map(|(id, s)| match s.kind {
                SymbolKind::Variable { var, .. } => Some((id, var)),
                _ => None,
            })
            .collect();
        for &(symbol, var) in &symbols {
            if self.symbols.vars[var].role == Role::Param {
                self.know(symbol);
            }
        }
        for (symbol, var) in symbols {
            let quantity = self.quantity(symbol);
            self.symbols.quantities.insert(var, quantity);
        }
        self.check_settings();
        self.check_initial();
    }

    /// Definition of a parameter, state or discrete variable: for each piece of its elements the address and the value in its unit. What is
    /// set from outside comes last.
    pub(in crate::elaborate) fn default_pieces(&mut self, symbol: SymbolId, site: Site) -> Vec<Piece<(Affine, ExprId)>> {
        let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { return Vec::new() };
        if self.symbols.vars[var].role != Role::Param {
            return self.declared_pieces(symbol, site);
        }
        let (is_whole, set) = self.set_from_outside(symbol);
        let mut pieces = if is_whole { Vec::new() } else { self.declared_pieces(symbol, site) };
        for (element, x) in set {
            let value = self.exprs.constant(x);
            pieces.push(match element {
                Some(at) => Piece { extents: Vec::new(), value: (Affine::constant(at), value) },
                None => self.symbols.whole(var, value),
            });
        }
        pieces
    }

    fn declared_pieces(&mut self, symbol: SymbolId, site: Site) -> Vec<Piece<(Affine, ExprId)>> {
        let SymbolKind::Variable { var, axes, unit, declaration } = self.symbols[symbol].kind.clone() else {
            return Vec::new();
        };
        let (path, scope, span) = {
            let s = &self.symbols[symbol];
            (s.path.clone(), s.scope, s.span)
        };
        let given = self.instances.given.get(&(scope, declaration.name.text.clone())).cloned();
        let (e, place) = match given {
            Some((e, outer)) => (e, outer),
            None => match &declaration.value {
                Some(e) => (e, Place::new(scope, site)),
                None => {
                    let value = match self.symbols.vars[var].role {
                        Role::Algebraic | Role::Disturbance => 0.0,
                        Role::Param if self.instances.samples.taken() => crate::elaborate::check::unused::SAMPLE,
                        role => {
                            self.missing_default(&path, role, span, scope);
                            f64::NAN
                        }
                    };
                    let value = self.exprs.constant(value);
                    return vec![self.symbols.whole(var, value)];
                }
            },
        };
        let what = format!("`{path}`");
        if axes.is_empty() || !mentions(e, &declaration.indices) {
            let value = self.number_in(e, &unit, &what, span, &place);
            return vec![self.symbols.whole(var, value)];
        }
        let mut place = place;
        place.scope = scope;
        self.nest(&declaration.indices, &place, &mut |s, inner| {
            let at = s.symbols.bound_address(&axes, &declaration.indices, inner);
            (at, s.number_in(e, &unit, &what, span, inner))
        })
    }

    fn missing_default(&mut self, path: &str, role: Role, span: Span, scope: ScopeId) {
        let (what, help) = match role {
            Role::Param => ("no value", "write `= value`, or give it where the component is used"),
            Role::State => ("no initial value", "write `= value`"),
            Role::Action => ("no nominal value", "write `= value`"),
            _ => ("no initial value", "write `= value`"),
        };
        let mut d = Diagnostic::error(codes::MISSING_DEFAULT, format!("`{path}` has {what}"), span).help(help);
        if let Some(&used) = self.instances.used_at.get(&scope) {
            d = d.secondary(used, "used here");
        }
        self.ledger.report(d);
    }

    /// Makes the default of a parameter known to constant evaluation, after those that it needs (with an explicit stack: chains may be
    /// long).
    pub(in crate::elaborate) fn know(&mut self, symbol: SymbolId) {
        let mut stack = vec![(symbol, None)];
        while let Some((symbol, pieces)) = stack.pop() {
            let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { continue };
            if let Some(pieces) = pieces {
                self.remember(var, pieces);
                continue;
            }
            if !self.constants.begin(var) {
                continue;
            }
            let outer = self.hidden.draws.site.replace((String::new(), model::Instant::Reset));
            let pieces = self.default_pieces(symbol, Site::Reset);
            self.hidden.draws.site = outer;
            let mut needed = Vec::new();
            for piece in &pieces {
                for (needs, _) in self.symbols.parameters_in(&self.exprs, piece.value.1) {
                    self.constants.note_need(var, needs);
                    let var = needs;
                    if let Some(&symbol) = self.symbols.of_var.get(&var).filter(|_| !self.constants.is_begun(var)) {
                        needed.push((symbol, None));
                    }
                }
            }
            stack.push((symbol, Some(pieces)));
            stack.extend(needed);
        }
    }

    fn remember(&mut self, var: VarId, pieces: Vec<Piece<(Affine, ExprId)>>) {
        for piece in pieces {
            let (at, value) = piece.value;
            let Some(x) = self.folded(value) else { continue };
            if piece.extents.is_empty() {
                self.constants.set(var, at.offset, x);
            } else {
                for i in 0..i64::from(self.symbols.vars[var].len) {
                    self.constants.set(var, i, x);
                }
            }
        }
    }

    /// Bounds, default and scale of a variable as numbers.
    fn quantity(&mut self, symbol: SymbolId) -> Quantity {
        let SymbolKind::Variable { var, axes, unit, declaration } = self.symbols[symbol].kind.clone() else {
            return empty_quantity();
        };
        let path = self.symbols[symbol].path.clone();
        let role = self.symbols.vars[var].role;
        let is_port = self.symbols.ports.contains(&var);
        let mut default = vec![f64::NAN];
        if !is_port && !matches!(role, Role::Discrete) {
            let pieces = self.default_pieces(symbol, Site::Reset);
            default = self.numbers(var, pieces);
        }
        let bounds = declaration.bounds.as_ref();
        let low = self.declared_number(symbol, &axes, &unit, declaration, bounds.map(|b| &b.0), f64::NEG_INFINITY);
        let high = self.declared_number(symbol, &axes, &unit, declaration, bounds.map(|b| &b.1), f64::INFINITY);
        if let Some((a, b)) = bounds
            && low.iter().zip(&high).any(|(l, h)| l > h)
        {
            self.ledger.report(Diagnostic::error(
                codes::BAD_SETTING,
                format!("the bounds of `{path}` are the wrong way round"),
                a.span.to(b.span),
            ));
        }
        let difference = units::difference(&unit);
        let mut scale = self.declared_number(symbol, &axes, &difference, declaration, declaration.scale.as_ref(), f64::NAN);
        if let Some(e) = &declaration.scale
            && let Some(bad) = scale.iter().find(|s| s.is_infinite() || **s <= 0.0)
        {
            let message = format!("the scale of `{path}` must be a positive number, it is {bad}");
            self.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, e.span));
        }
        let n = scale.len().max(low.len()).max(high.len());
        if scale.iter().any(|s| s.is_nan()) {
            scale = (0..n)
                .map(|i| {
                    let range = Quantity::pick(&high, i) - Quantity::pick(&low, i);
                    if range.is_finite() && range > 0.0 { range } else { 1.0 }
                })
                .collect();
        }
        if role == Role::Action {
            self.ledger.check_action(&path, declaration, &low, &high, &default);
        }
        let quantity = Quantity {
            var: Some(var),
            name: path,
            axes: self.symbols.model_axes(&axes),
            pattern: declaration.pattern.clone(),
            unit: unit.to_string(),
            text: declaration.text.clone().unwrap_or_default(),
            low,
            high,
            default,
            scale,
            affine_unit: units::is_point(&unit),
            structural: false,
        };
        if role == Role::Param {
            self.check_range(symbol, &quantity);
        }
        quantity
    }

    /// Numbers of the elements; one for all where they are equal.
    fn numbers(&mut self, var: VarId, pieces: Vec<Piece<(Affine, ExprId)>>) -> Vec<f64> {
        if let [piece] = pieces.as_slice() {
            let value = piece.value.1;
            return vec![self.constant_value(value).unwrap_or(f64::NAN)];
        }
        let mut out = vec![f64::NAN; self.symbols.vars[var].len as usize];
        for piece in pieces {
            let (at, value) = piece.value;
            let Some(x) = self.constant_value(value) else { continue };
            for_each_element(&piece.extents, at, &mut |i| {
                if let Some(slot) = out.get_mut(i as usize) {
                    *slot = x;
                }
            });
        }
        out
    }

    fn declared_number(
        &mut self,
        symbol: SymbolId,
        axes: &[Axis],
        unit: &Unit,
        d: &Declaration,
        e: Option<&Expr>,
        absent: f64,
    ) -> Vec<f64> {
        let Some(e) = e else { return vec![absent] };
        let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { return vec![absent] };
        let place = Place::new(self.symbols[symbol].scope, Site::Dynamics);
        let what = format!("`{}`", d.name.text);
        let mut pieces = Vec::new();
        if axes.is_empty() || !mentions(e, &d.indices) {
            let value = self.number_in(e, unit, &what, d.span, &place);
            pieces.push(self.symbols.whole(var, value));
        } else {
            pieces = self.nest(&d.indices, &place, &mut |s, inner| {
                (s.symbols.bound_address(axes, &d.indices, inner), s.number_in(e, unit, &what, d.span, inner))
            });
        }
        let numbers = self.numbers(var, pieces);
        if numbers.iter().any(|x| x.is_nan()) && !self.ledger.reports.has_errors() {
            self.ledger.missing_value("a bound or scale", e.span);
        }
        numbers
    }
}

impl Symbols<'_> {
    /// What an expression depends on that is no parameter, for messages.
    pub(in crate::elaborate) fn varying(&self, exprs: &Exprs, e: ExprId) -> Option<String> {
        let mut seen = std::collections::HashSet::new();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            match exprs.node(e) {
                Node::Time => return Some(format!("the time `{}`", self.time_name)),
                Node::Load { var, .. } => {
                    let name = &self.vars[var].name;
                    let what = match self.vars[var].role {
                        Role::State => "the state",
                        Role::Algebraic => "the algebraic variable",
                        Role::Action => "the action",
                        Role::Discrete => "the discrete variable",
                        Role::Disturbance => "the disturbance",
                        Role::Builtin => return Some("the clock".to_owned()),
                        Role::Quadrature => return Some("an integral over the step".to_owned()),
                        _ => continue,
                    };
                    return Some(format!("{what} `{name}`"));
                }
                _ => stack.extend(exprs.operands(e)),
            }
        }
        None
    }
}

impl Symbols<'_> {
    /// Elements of parameters that an expression loads.
    pub(in crate::elaborate) fn parameters_in(&self, exprs: &Exprs, e: ExprId) -> Vec<(VarId, Affine)> {
        let mut seen = FastSet::default();
        let mut stack = vec![e];
        let mut out = Vec::new();
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            if let Node::Load { var, at, .. } = exprs.node(e)
                && self.vars[var].role == Role::Param
            {
                out.push((var, at));
            }
            stack.extend(exprs.operands(e));
        }
        out
    }
}

impl<'a> Symbols<'a> {
    /// Address of the element that bound index names mean.
    pub(in crate::elaborate) fn bound_address(&self, axes: &[Axis], indices: &[Binder], place: &Place) -> Affine {
        let mut at = Affine::default();
        for (&axis, binder) in axes.iter().zip(indices) {
            let part = match place.bound(&binder.name.text) {
                Some(Bound::Member(_, i)) => Affine::constant(*i as i64),
                Some(Bound::Cell(_, c)) => c.affine(),
                Some(Bound::Run(numbers)) => match axis {
                    Axis::Set(set) => numbers.shifted(-self.sets[set].first.unwrap_or(0)).affine(),
                    Axis::Domain(_) => numbers.shifted(-1).affine(),
                },
                _ => Affine::default(),
            };
            at = at.times(self.axis_len(axis)).plus(part);
        }
        at
    }

    fn walk(&self, scope: ScopeId, blocks: &FastMap<ScopeId, &[Item<'a>]>, out: &mut Vec<SymbolId>) {
        let Some(items) = blocks.get(&scope) else {
            // A port: its members in the order of declaration.
            let mut members: Vec<SymbolId> = self.scopes[scope].names.values().copied().collect();
            members.sort_unstable();
            out.extend(members);
            return;
        };
        let own = |name: &str| self.scopes[scope].names.get(name).copied();
        for item in *items {
            match item {
                Item::Declare(_, d) => out.extend(own(&d.name.text)),
                Item::Other(statement) => match &statement.kind {
                    StatementKind::Instance { name, .. } => match own(&name.text).map(|s| &self[s].kind) {
                        Some(SymbolKind::Instance(inner)) => self.walk(*inner, blocks, out),
                        Some(SymbolKind::Instances(row)) => {
                            for (_, inner) in &row.list {
                                self.walk(*inner, blocks, out);
                            }
                        }
                        _ => {}
                    },
                    StatementKind::Port { names, .. } => {
                        for name in names {
                            if let Some(SymbolKind::Instance(port)) = own(&name.text).map(|s| &self[s].kind) {
                                self.walk(*port, blocks, out);
                            }
                        }
                    }
                    _ => {}
                },
                _ => {}
            }
        }
    }

    /// One value for all elements of a variable.
    pub(in crate::elaborate) fn whole(&self, var: VarId, value: ExprId) -> Piece<(Affine, ExprId)> {
        match self.vars[var].len {
            1 => Piece { extents: Vec::new(), value: (Affine::default(), value) },
            len => Piece { extents: vec![len], value: (Affine::along(0, LoopVar(0), 1), value) },
        }
    }

    pub(in crate::elaborate) fn model_axes(&self, axes: &[Axis]) -> Vec<model::Axis> {
        axes.iter()
            .map(|&axis| match axis {
                Axis::Domain(d) => model::Axis::Numbers { first: 1, count: self.domains[d].cells as u32 },
                Axis::Set(s) => {
                    let set = &self.sets[s];
                    match set.first {
                        Some(first) => model::Axis::Numbers { first, count: set.labels.len() as u32 },
                        None => model::Axis::Names(set.labels.clone()),
                    }
                }
            })
            .collect()
    }
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
                format!("the nominal value of `{path}` lies outside its bounds"),
                d.name.span,
            ));
        }
    }
}

/// Calls `f` with the address of every pass of a nest.
pub fn for_each_element(extents: &[u32], at: Affine, f: &mut dyn FnMut(i64)) {
    fn pass(extents: &[u32], depth: usize, at: i64, strides: &[i64], f: &mut dyn FnMut(i64)) {
        match extents.get(depth) {
            None => f(at),
            Some(&n) => {
                for i in 0..i64::from(n) {
                    pass(extents, depth + 1, at + i * strides[depth], strides, f);
                }
            }
        }
    }
    pass(extents, 0, at.offset, &at.strides, f);
}

/// Whether an expression uses one of the index names.
fn mentions(e: &Expr, binders: &[Binder]) -> bool {
    binders.iter().any(|b| e.mentions(&b.name.text))
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
    }
}
