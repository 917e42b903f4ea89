//! The steady problem and the start of an episode.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Clip, Expr, ExprKind, Statement, StatementKind};

use super::super::blocks::Piece;
use super::super::items::Item;
use super::super::names::{ScopeId, SymbolId, SymbolKind};
use super::super::{Elaborator, Place, Site};
use super::order::ordered_initial;
use super::{each, store, stream_name};
use crate::ir::{Affine, ExprId, Exprs, FastMap, FastSet, Flavour, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{Instant, Quantity};

impl<'a> Elaborator<'a> {
    pub(super) fn steady_program(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut given: FastMap<(VarId, i64), ExprId> = FastMap::default();
        let mut conditions = Vec::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Steady { entries }, .. }) = item else { continue };
            self.model.interface.has_steady = true;
            let place = self.place(scope, Site::Instant);
            for (target, value) in entries {
                if !is_place(target) {
                    conditions.push(self.steady_condition(target, value, &place));
                    continue;
                }
                if self.steady_instance(target, value, &place, &mut given) {
                    continue;
                }
                let Some((symbol, at)) = self.target(target, &place, &[Role::Action, Role::State]) else { continue };
                let SymbolKind::Variable { var, unit, .. } = self.names.symbols[symbol].kind.clone() else { continue };
                let expr = self.number_in(value, &unit, "the steady value", target.span, &place);
                let elements = match at {
                    Some(at) => at.offset..at.offset + 1,
                    None => 0..i64::from(self.vars[var].len),
                };
                given.extend(elements.map(|i| ((var, i), expr)));
            }
        }
        let mut stores = Vec::new();
        let actions: Vec<VarId> = self.variables_of(Role::Action);
        for var in actions {
            for i in 0..i64::from(self.vars[var].len) {
                let value = match given.get(&(var, i)) {
                    Some(&e) => e,
                    None => {
                        let x = self.quantities.get(&var).map_or(f64::NAN, |q| Quantity::pick(&q.default, i as usize));
                        self.exprs.constant(x)
                    }
                };
                stores.push(store(Memory::Out, Affine::constant(stores.len() as i64), value));
            }
        }
        let mut base = 0_i64;
        let mut fixed = Vec::new();
        let states = self.variables_of(Role::State);
        for var in states {
            for i in 0..i64::from(self.vars[var].len) {
                if let Some(&value) = given.get(&(var, i)) {
                    fixed.push((base + i) as u32);
                    stores.push(store(Memory::Out, Affine::constant(stores.len() as i64), value));
                }
            }
            base += i64::from(self.vars[var].len);
        }
        self.model.interface.steady_conditions = conditions.len() as u32;
        for condition in conditions {
            stores.push(store(Memory::Out, Affine::constant(stores.len() as i64), condition));
        }
        self.model.interface.steady_given = base > 0 && fixed.len() as i64 == base;
        self.model.interface.steady_fixed = fixed;
        self.model.programs.steady = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: false };
    }

    /// `A + B = 1`: left less right.
    fn steady_condition(&mut self, left: &Expr, right: &Expr, place: &Place) -> ExprId {
        let reports = self.diagnostics.len();
        let value = self.value(left, place);
        let unit = value.unit.unit();
        let value = self.in_unit(value, &unit, left.span, "this value", left.span);
        let right = self.number_in(right, &unit, "the steady value", left.span, place);
        let difference = self.exprs.sub(value, right);
        if self.diagnostics.len() == reports && !self.reads_unknown(difference) {
            let message = "no state stands in this condition on the steady state";
            self.report(
                Diagnostic::error(codes::WRONG_KIND, message, left.span).help("give a state, or an expression of states, its value"),
            );
        }
        difference
    }

    fn reads_unknown(&self, e: ExprId) -> bool {
        let mut seen = FastSet::default();
        let mut stack = vec![e];
        while let Some(e) = stack.pop() {
            if let crate::ir::Expr::Load { var, flavour: Flavour::Value, .. } = self.exprs.node(e)
                && matches!(self.vars[var].role, Role::State | Role::Algebraic)
            {
                return true;
            }
            if seen.insert(e) {
                stack.extend(self.exprs.operands(e));
            }
        }
        false
    }

    /// `col = 0`: every state of an instance, or of the instances of an array.
    fn steady_instance(&mut self, target: &Expr, value: &Expr, place: &Place, given: &mut FastMap<(VarId, i64), ExprId>) -> bool {
        let ExprKind::Name(name) = &target.kind else { return false };
        let Some(symbol) = self.names.lookup(place.scope, &name.text) else { return false };
        if !matches!(self.names.symbols[symbol].kind, SymbolKind::Instance(_) | SymbolKind::Instances(_)) {
            return false;
        }
        let path = self.names.symbols[symbol].path.clone();
        for var in self.state_variables() {
            let rest = self.vars[var].name.strip_prefix(&path);
            if !rest.is_some_and(|r| r.starts_with(['.', '['])) {
                continue;
            }
            let Some(SymbolKind::Variable { unit, .. }) = self.symbol_of.get(&var).map(|&s| self.names.symbols[s].kind.clone()) else {
                continue;
            };
            let expr = self.number_in(value, &unit, "the steady value", target.span, place);
            given.extend((0..i64::from(self.vars[var].len)).map(|i| ((var, i), expr)));
        }
        true
    }

    /// Variables of a role in the order of the region (identifiers grow); states in the order of the text.
    pub(in crate::elaborate) fn variables_of(&self, role: Role) -> Vec<VarId> {
        if role == Role::State {
            return self.state_variables();
        }
        self.vars.iter().filter(|(_, v)| v.role == role).map(|(id, _)| id).collect()
    }

    pub(in crate::elaborate) fn state_variables(&self) -> Vec<VarId> {
        self.in_text_order()
            .into_iter()
            .filter_map(|s| match self.names.symbols[s].kind {
                SymbolKind::Variable { var, .. } if self.vars[var].role == Role::State => Some(var),
                _ => None,
            })
            .collect()
    }

    pub(super) fn initial_programs(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut states = Program { nests: Vec::new(), in_place: true };
        let mut discretes = Program { nests: Vec::new(), in_place: true };
        let symbols = self.in_text_order();
        let mut plain = Vec::new();
        let mut plain_discretes = Vec::new();
        let mut given: FastMap<(ScopeId, VarId, Option<i64>), Span> = FastMap::default();
        for symbol in symbols {
            let SymbolKind::Variable { var, .. } = self.names.symbols[symbol].kind else { continue };
            let (list, nests, site) = match self.vars[var].role {
                Role::State => (&mut plain, &mut states.nests, Site::Reset),
                Role::Discrete | Role::Disturbance => (&mut plain_discretes, &mut discretes.nests, Site::Instant),
                _ => continue,
            };
            let path = self.names.symbols[symbol].path.clone();
            let pieces = match self.options.initial.get(&path) {
                Some(&x) => {
                    let value = self.exprs.constant(x);
                    vec![self.whole(var, value)]
                }
                None => self.default_pieces(symbol, site),
            };
            let span = self.names.symbols[symbol].span;
            for piece in pieces {
                let (at, value) = piece.value;
                self.check_start(value, var, at, span);
                let s = store(Memory::Var(var), at, value);
                if piece.extents.is_empty() {
                    list.push(s);
                } else {
                    nests.push(Nest { extents: piece.extents, stores: vec![s] });
                }
            }
        }
        states.nests.insert(0, Nest { extents: Vec::new(), stores: plain });
        plain_discretes.extend(self.schedule_initial());
        discretes.nests.insert(0, Nest { extents: Vec::new(), stores: plain_discretes });
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Initial { target, random, value, clip, binders }, .. }) = item else {
                continue;
            };
            let place = self.place(scope, Site::Reset);
            if binders.is_empty() {
                self.check_single(&mut given, scope, target, &place);
            }
            let pieces = self.nest(binders, &place, &mut |s, inner| s.initial(target, *random, value, clip.as_ref(), inner));
            for piece in pieces {
                let Some((var, list)) = piece.value else { continue };
                let nests = if self.vars[var].role == Role::State { &mut states.nests } else { &mut discretes.nests };
                for p in list {
                    let (at, value) = p.value;
                    let mut extents = piece.extents.clone();
                    extents.extend(p.extents);
                    nests.push(Nest { extents, stores: vec![store(Memory::Var(var), at, value)] });
                }
            }
        }
        for symbol in self.names.symbols.keys().collect::<Vec<_>>() {
            let SymbolKind::Variable { var, .. } = self.names.symbols[symbol].kind else { continue };
            let nests = match self.vars[var].role {
                Role::State => &mut states.nests,
                Role::Discrete => &mut discretes.nests,
                _ => continue,
            };
            for (at, x) in self.initial_elements(symbol) {
                let value = self.exprs.constant(x);
                nests.push(Nest { extents: Vec::new(), stores: vec![store(Memory::Var(var), Affine::constant(at), value)] });
            }
        }
        let (nests, cycles) = ordered_initial(states.nests, &self.exprs, &self.vars);
        states.nests = nests;
        cycles.into_iter().for_each(|d| self.report(d));
        self.model.programs.initial_states = states;
        self.model.programs.initial_discretes = discretes;
    }

    /// Reports a start value that reads what it sets, or elements that the same loop sets in its later passes: the declared values would be
    /// read, which are replaced.
    fn check_start(&mut self, value: ExprId, var: VarId, at: Affine, span: Span) {
        let passes: Vec<i64> = self.loops.iter().map(|l| l.passes).collect();
        if !reads(&self.exprs, value, var).iter().any(|&read| is_set_later(read, at, &passes)) {
            return;
        }
        let name = self.vars[var].name.clone();
        let itself = if at.is_constant() { "itself" } else { "elements that are set with it or after it" };
        self.report(
            Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the initial value of `{name}` reads {itself}"), span)
                .label(format!("`{name}` has no value yet"))
                .help(format!("write the value out, or name it: `param {name}_0 : unit = ...`, then `{name}_0` in place of `{name}`")),
        );
    }

    /// Reports a second `initial` of one variable or element in one block: the order of statements has no meaning.
    fn check_single(&mut self, given: &mut FastMap<(ScopeId, VarId, Option<i64>), Span>, scope: ScopeId, target: &Expr, place: &Place) {
        let Some((symbol, at)) = self.target(target, place, &[Role::State, Role::Discrete, Role::Disturbance]) else { return };
        let SymbolKind::Variable { var, .. } = self.names.symbols[symbol].kind else { return };
        if let Some(first) = given.insert((scope, var, at.map(|at| at.offset)), target.span) {
            let path = self.names.symbols[symbol].path.clone();
            self.report(
                Diagnostic::error(codes::DUPLICATE_NAME, format!("`{path}` has two initial values"), target.span)
                    .secondary(first, "the first one")
                    .help("keep one of them"),
            );
        }
    }

    /// One `initial` statement at one place: a scalar, an element, or a whole array.
    #[allow(clippy::type_complexity, reason = "a variable and pieces of it")]
    pub(in crate::elaborate) fn initial(
        &mut self,
        target: &Expr,
        random: bool,
        value: &Expr,
        clip: Option<&Clip>,
        place: &Place,
    ) -> Option<(VarId, Vec<Piece<(Affine, ExprId)>>)> {
        let (symbol, at) = self.target(target, place, &[Role::State, Role::Discrete, Role::Disturbance])?;
        let SymbolKind::Variable { var, unit, .. } = self.names.symbols[symbol].kind.clone() else { return None };
        let path = self.names.symbols[symbol].path.clone();
        if let Some(&x) = self.options.initial.get(&path) {
            let value = self.exprs.constant(x);
            return Some((var, vec![self.whole(var, value)]));
        }
        let len = self.vars[var].len;
        let mut place = place.clone();
        if self.vars[var].role != Role::State {
            place.site = Site::Instant;
        }
        let make = |s: &mut Self, at: Affine, inner: &Place| {
            let outer = random.then(|| s.random_site.replace((stream_name(&path, at, len), Instant::Reset)));
            let v = s.number_in(value, &unit, &format!("`{path}`"), target.span, inner);
            if let Some(outer) = outer {
                s.random_site = outer;
            }
            s.check_start(v, var, at, value.span);
            s.clipped(v, var, at, clip, &unit, inner)
        };
        match at {
            Some(at) => {
                let v = make(self, at, &place);
                Some((var, vec![Piece { extents: Vec::new(), value: (at, v) }]))
            }
            None => {
                // The whole array: one loop over its elements.
                let pieces = self.cells(0, i64::from(len) - 1, target.span, &place, &mut |s, cell, inner| {
                    let at = cell.affine();
                    (at, make(s, at, inner))
                });
                let list = pieces
                    .into_iter()
                    .map(|(cell, value)| Piece { extents: cell.along.map(|_| cell.count as u32).into_iter().collect(), value })
                    .collect();
                Some((var, list))
            }
        }
    }

    /// The variable that a statement assigns: a symbol, and the element unless the whole array is meant.
    pub(super) fn target(&mut self, e: &Expr, place: &Place, roles: &[Role]) -> Option<(SymbolId, Option<Affine>)> {
        if let ExprKind::Name(name) = &e.kind
            && let Some(super::super::Bound::Element(symbol, at)) = place.bound(&name.text)
        {
            return Some((*symbol, Some(*at)));
        }
        let (base, index): (&Expr, &[Expr]) = match &e.kind {
            ExprKind::Index(base, index) => (base, index),
            _ => (e, &[]),
        };
        let symbol = match self.resolve(base, place) {
            super::super::indices::Target::Symbol(symbol) => symbol,
            super::super::indices::Target::Value(v) => {
                if !v.is_poison() {
                    self.report(Diagnostic::error(codes::WRONG_KIND, "a variable is needed here", e.span));
                }
                return None;
            }
            super::super::indices::Target::Nothing => return None,
        };
        let SymbolKind::Variable { var, axes, .. } = self.names.symbols[symbol].kind.clone() else {
            if !matches!(self.names.symbols[symbol].kind, SymbolKind::Faulty) {
                let path = self.names.symbols[symbol].path.clone();
                self.report(Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is no variable that can be assigned"), e.span));
            }
            return None;
        };
        if !roles.contains(&self.vars[var].role) {
            let (path, declared) = (self.names.symbols[symbol].path.clone(), self.names.symbols[symbol].span);
            let what = match self.vars[var].role {
                Role::Param => "a parameter",
                Role::Action => "an action",
                Role::Algebraic => "an algebraic variable",
                Role::State => "a state",
                Role::Discrete => "a discrete variable",
                Role::Disturbance => "a disturbance",
                _ => "a variable of another kind",
            };
            let help = match (self.vars[var].role, roles) {
                (Role::State, [Role::Discrete]) => Some("states are set by `reset`".to_owned()),
                (Role::Discrete, [Role::State]) => Some("discrete variables are set by `next`".to_owned()),
                _ => None,
            };
            self.report(
                Diagnostic::error(codes::WRONG_KIND, format!("`{path}` is {what}, which cannot be set here"), e.span)
                    .secondary(declared, "declared here")
                    .maybe_help(help),
            );
            return None;
        }
        if index.is_empty() && !axes.is_empty() {
            return Some((symbol, None));
        }
        let (at, _) = self.address(symbol, &axes, index, e.span, place)?;
        Some((symbol, Some(at)))
    }
}

/// Elements of a variable whose values an expression reads.
fn reads(exprs: &Exprs, e: ExprId, var: VarId) -> Vec<Affine> {
    let mut seen = FastSet::default();
    let mut stack = vec![e];
    let mut out = Vec::new();
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        match exprs.node(e) {
            crate::ir::Expr::Load { var: v, flavour: Flavour::Value, at } if v == var => out.push(at),
            _ => stack.extend(exprs.operands(e)),
        }
    }
    out
}

/// Whether the element `read` is the element `set`, or one that a later pass of the loops around sets.
fn is_set_later(read: Affine, set: Affine, passes: &[i64]) -> bool {
    let ahead = read.offset - set.offset;
    if read.strides != set.strides {
        return false;
    }
    match set.strides.iter().filter(|s| **s != 0).collect::<Vec<_>>()[..] {
        [&stride] => {
            let along = set.strides.iter().position(|s| *s == stride).unwrap_or(0);
            ahead % stride == 0 && (0..passes.get(along).copied().unwrap_or(1)).contains(&(ahead / stride))
        }
        _ => ahead == 0,
    }
}

/// Whether an expression names a variable or an element of one.
fn is_place(e: &Expr) -> bool {
    match &e.kind {
        ExprKind::Name(_) => true,
        ExprKind::Member(base, _) | ExprKind::Index(base, _) => is_place(base),
        _ => false,
    }
}
