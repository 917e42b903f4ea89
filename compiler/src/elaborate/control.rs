//! The control problem: episode, initial values, sampling instants, steady state, conditions and rewards.

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{BinaryOp, Binder, Clip, Expr, ExprKind, Ident, Statement, StatementKind};
use smpl_dsl::units::Unit;

use super::blocks::Piece;
use super::items::Item;
use super::names::{ScopeId, SymbolId, SymbolKind};
use super::quantity::{Measure, Value};
use super::{Elaborator, Place, Setting, Site, units};
use crate::ir::{Affine, BinaryFn, Builtin, Compare, ExprId, Flavour, Nest, Place as Memory, Program, Role, Store, Target, VarId};
use crate::model::{BoxItem, Episode, Failure, Instant, Quantity, Reward, Root, RootAction, Solver};

/// What the names `success`, `failure`, `timeout` and `reward` stand for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outcome {
    success: ExprId,
    failure: ExprId,
    timeout: ExprId,
    reward: Option<ExprId>,
}

/// A condition that ends or costs something.
pub(super) struct Condition {
    /// Whether it holds.
    pub holds: ExprId,
    /// By how much, relative to a range.
    pub excess: ExprId,
    /// Members of its box.
    pub items: Vec<(BoxItem, ExprId)>,
}

impl<'a> Elaborator<'a> {
    pub(super) fn elaborate_control(&mut self) {
        let blocks = std::mem::take(&mut self.blocks);
        self.blocks = blocks.clone();
        self.settings(&blocks);
        self.parameter_program();
        self.steady_program(&blocks);
        self.initial_programs(&blocks);
        self.disturbance_program();
        self.instant_programs(&blocks);
        self.policies(&blocks);
        self.finish_program(&blocks);
        self.output_program();
        self.invariants(&blocks);
        self.interface();
    }

    // --- settings -----------------------------------------------------------------------------------------------------------------

    fn settings(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut episode = Episode::default();
        let mut solver = Solver::default();
        let mut integrate = None;
        for (scope, item) in each(blocks) {
            let Item::Other(statement) = item else { continue };
            let place = self.place(scope, Site::Dynamics);
            match &statement.kind {
                StatementKind::Episode { entries } => {
                    for (name, e) in entries {
                        self.episode_entry(name, e, &place, &mut episode, &mut integrate);
                    }
                }
                StatementKind::Solver { entries } => {
                    for (name, e) in entries {
                        self.solver_entry(name, e, &place, &mut solver);
                    }
                }
                _ => {}
            }
        }
        for (name, value) in &self.options.settings {
            match (name.as_str(), value) {
                ("max_steps", Setting::Number(x)) if *x >= 1.0 => episode.max_steps = *x as u32,
                ("error_reward", Setting::Number(x)) => episode.error_reward = *x,
                ("step", Setting::Number(x)) if *x > 0.0 => episode.step = *x,
                ("integrate", Setting::Number(x)) if *x > 0.0 => integrate = Some(*x),
                ("rtol", Setting::Number(x)) if *x > 0.0 => solver.rtol = *x,
                ("atol_factor", Setting::Number(x)) if *x > 0.0 => solver.atol_factor = *x,
                ("max_order", Setting::Number(x)) if (1.0..=5.0).contains(x) => solver.max_order = *x as u32,
                ("linear_solver", Setting::Text(text)) => solver.linear_solver.clone_from(text),
                ("max_internal_steps", Setting::Number(x)) if *x >= 1.0 => solver.max_steps = *x as u32,
                _ => {}
            }
        }
        if let Some(n) = self.options.max_steps {
            episode.max_steps = n;
        }
        episode.integrate = integrate.unwrap_or(episode.step);
        self.model.interface.episode = episode;
        self.model.interface.solver = solver;
    }

    fn setting_number(&mut self, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
        let reports = self.diagnostics.len();
        let expr = self.number_in(e, unit, &format!("`{}`", name.text), name.span, place);
        let value = self.constant_value(expr).filter(|x| !x.is_nan());
        if self.diagnostics.len() != reports {
            return None;
        }
        if value.is_none() {
            self.missing_value(&format!("`{}`", name.text), e.span);
        }
        value
    }

    fn positive(&mut self, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
        let x = self.setting_number(name, e, unit, place)?;
        if x > 0.0 {
            return Some(x);
        }
        self.report(Diagnostic::error(codes::BAD_SETTING, format!("`{}` must be positive, it is {x}", name.text), e.span));
        None
    }

    fn whole_number(&mut self, name: &Ident, e: &Expr, place: &Place) -> Option<u32> {
        let x = self.setting_number(name, e, &Unit::one(), place)?;
        if x >= 1.0 && x.fract() == 0.0 && x < 4e9 {
            return Some(x as u32);
        }
        self.report(Diagnostic::error(
            codes::BAD_SETTING,
            format!("`{}` must be a whole number of at least 1, it is {x}", name.text),
            e.span,
        ));
        None
    }

    /// Whether a condition of a setting is true.
    fn holds(&mut self, e: &Expr, place: &Place) -> bool {
        let c = self.condition(e, place);
        matches!(self.exprs.node(c), crate::ir::Expr::Truth(true))
    }

    fn episode_entry(&mut self, name: &Ident, e: &Expr, place: &Place, episode: &mut Episode, integrate: &mut Option<f64>) {
        let time = self.time_unit.clone();
        match name.text.as_str() {
            "step" => episode.step = self.positive(name, e, &time, place).unwrap_or(episode.step),
            "integrate" => *integrate = self.positive(name, e, &time, place),
            "max_steps" => episode.max_steps = self.whole_number(name, e, place).unwrap_or(episode.max_steps),
            "error_reward" => {
                // Rewards carry their own units; the number is taken in each.
                let v = self.value(e, place);
                episode.error_reward = self.constant_value(v.expr).unwrap_or(episode.error_reward);
            }
            "end_is_success" => episode.end_is_success = self.holds(e, place),
            "single_precision" => episode.single_precision = self.holds(e, place),
            _ => {
                let known = ["step", "integrate", "max_steps", "error_reward", "end_is_success", "single_precision"];
                self.unknown_entry(name, "episode", &known);
            }
        }
    }

    fn solver_entry(&mut self, name: &Ident, e: &Expr, place: &Place, solver: &mut Solver) {
        match name.text.as_str() {
            "rtol" => solver.rtol = self.positive(name, e, &Unit::one(), place).unwrap_or(solver.rtol),
            "atol_factor" => solver.atol_factor = self.positive(name, e, &Unit::one(), place).unwrap_or(solver.atol_factor),
            "max_order" => solver.max_order = self.whole_number(name, e, place).unwrap_or(5).min(5),
            "max_steps" => solver.max_steps = self.whole_number(name, e, place).unwrap_or(solver.max_steps),
            "quadrature_error_control" => {
                let c = self.condition(e, place);
                self.model.quadrature_error_control = matches!(self.exprs.node(c), crate::ir::Expr::Truth(true));
            }
            "linear_solver" => match &e.kind {
                ExprKind::Name(n) if matches!(n.text.as_str(), "auto" | "dense" | "klu") => solver.linear_solver.clone_from(&n.text),
                _ => self.report(Diagnostic::error(codes::BAD_SETTING, "the linear solver is auto, dense or klu", e.span)),
            },
            _ => self.unknown_entry(
                name,
                "solver",
                &["rtol", "atol_factor", "max_order", "max_steps", "linear_solver", "quadrature_error_control"],
            ),
        }
    }

    fn unknown_entry(&mut self, name: &Ident, block: &str, known: &[&str]) {
        let help = did_you_mean(&name.text, known.iter().copied());
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("`{block}` has no entry `{}`", name.text), name.span)
                .maybe_help(help)
                .note(format!("it takes {}", known.join(", "))),
        );
    }

    // --- parameters -----------------------------------------------------------------------------------------------------------------

    /// Parameters that are drawn or computed from others, those that others need first.
    fn parameter_program(&mut self) {
        let mut pieces: Vec<(VarId, Piece<(Affine, ExprId)>)> = Vec::new();
        let symbols: Vec<SymbolId> = self.names.symbols.keys().collect();
        for symbol in symbols {
            let SymbolKind::Variable { var, unit, declaration, axes } = self.names.symbols[symbol].kind.clone() else { continue };
            if self.vars[var].role != Role::Param {
                continue;
            }
            let path = self.names.symbols[symbol].path.clone();
            let overridden = self.options.parameters.contains_key(&path) || self.options.settings.contains_key(&path);
            let scope = self.names.symbols[symbol].scope;
            let given = self.given.contains_key(&(scope, declaration.name.text.clone()));
            if let Some(sample) = declaration.sample.as_ref().filter(|_| !overridden && !given) {
                let place = self.place(scope, Site::Reset);
                let span = declaration.span;
                let list = self.nest(&declaration.indices, &place, &mut |s, inner| {
                    let at = s.element_address(&axes, &declaration.indices, inner);
                    let outer = s.random_site.replace((stream_name(&path, at, s.vars[var].len), Instant::Reset));
                    let v = s.number_in(sample, &unit, &path, span, inner);
                    s.random_site = outer;
                    let v = s.clipped(v, var, at, declaration.clip.as_ref(), &unit, inner);
                    (at, v)
                });
                pieces.extend(list.into_iter().map(|p| (var, p)));
                continue;
            }
            for piece in self.default_pieces(symbol, Site::Reset) {
                if self.exprs.as_const(piece.value.1).is_some() {
                    continue;
                }
                if let Some(what) = self.varying(piece.value.1) {
                    let span = declaration.value.as_ref().map_or(declaration.span, |e| e.span);
                    self.report(
                        Diagnostic::error(codes::WRONG_KIND, format!("the parameter `{path}` cannot depend on {what}"), span)
                            .label("changes while the model runs")
                            .help(format!("make it a `let`: `let {} = ...`", declaration.name.text)),
                    );
                    continue;
                }
                pieces.push((var, piece));
            }
        }
        let order = self.dependency_order(&pieces);
        let mut program = Program { nests: Vec::new(), in_place: true };
        for i in order {
            let (var, piece) = &pieces[i];
            let (at, value) = piece.value;
            let offset = self.role_offset(*var);
            let given = self.exprs.load(self.param_given, Flavour::Value, Affine::constant(offset).plus(at));
            let zero = self.exprs.constant(0.0);
            let keep = self.exprs.compare(Compare::Lt, zero, given);
            let present = self.exprs.load(*var, Flavour::Value, at);
            let value = self.exprs.select(keep, present, value);
            program.nests.push(Nest { extents: piece.extents.clone(), stores: vec![store(Memory::Var(*var), at, value)] });
        }
        self.model.programs.parameters = program;
    }

    fn element_address(&self, axes: &[super::names::Axis], indices: &[Binder], place: &Place) -> Affine {
        let mut at = Affine::default();
        for (&axis, binder) in axes.iter().zip(indices) {
            let part = match place.bound(&binder.name.text) {
                Some(super::Bound::Member(_, i)) => Affine::constant(*i as i64),
                Some(super::Bound::Cell(_, c)) => c.affine(),
                _ => Affine::default(),
            };
            at = at.times(self.names.axis_len(axis)).plus(part);
        }
        at
    }

    /// Position of a variable in the region of its role.
    fn role_offset(&self, var: VarId) -> i64 {
        let role = self.vars[var].role;
        self.vars.iter().take_while(|(v, _)| *v < var).filter(|(_, v)| v.role == role).map(|(_, v)| i64::from(v.len)).sum()
    }

    fn dependency_order(&mut self, pieces: &[(VarId, Piece<(Affine, ExprId)>)]) -> Vec<usize> {
        let mut order = Vec::with_capacity(pieces.len());
        let mut state = vec![0_u8; pieces.len()];
        for i in 0..pieces.len() {
            self.visit_parameter(i, pieces, &mut state, &mut order);
        }
        order
    }

    fn visit_parameter(&mut self, i: usize, pieces: &[(VarId, Piece<(Affine, ExprId)>)], state: &mut [u8], order: &mut Vec<usize>) {
        if state[i] == 2 {
            return;
        }
        if state[i] == 1 {
            let span = self.vars[pieces[i].0].span;
            let name = self.vars[pieces[i].0].name.clone();
            self.report(Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the value of `{name}` needs itself"), span));
            return;
        }
        state[i] = 1;
        for var in self.parameters_in(pieces[i].1.value.1) {
            for j in 0..pieces.len() {
                if pieces[j].0 == var && (j != i || state[j] != 1 || var == pieces[i].0) && !(j == i) {
                    self.visit_parameter(j, pieces, state, order);
                }
            }
            if var == pieces[i].0 && pieces.iter().filter(|p| p.0 == var).count() == 1 {
                let (span, name) = (self.vars[var].span, self.vars[var].name.clone());
                self.report(Diagnostic::error(codes::CYCLIC_DEFINITION, format!("the value of `{name}` needs itself"), span));
            }
        }
        state[i] = 2;
        order.push(i);
    }

    /// A value limited as a `clip` clause says.
    fn clipped(&mut self, v: ExprId, var: VarId, at: Affine, clip: Option<&Clip>, unit: &Unit, place: &Place) -> ExprId {
        let (low, high) = match clip {
            None => return v,
            Some(Clip::Range(a, b)) => {
                (self.number_in(a, unit, "the limit", a.span, place), self.number_in(b, unit, "the limit", b.span, place))
            }
            Some(Clip::Bounds(span)) => {
                let Some(q) = self.quantities.get(&var) else { return v };
                let i = at.offset.max(0) as usize;
                let uniform = |list: &[f64]| list.windows(2).all(|w| w[0] == w[1]);
                if !at.is_constant() && !(uniform(&q.low) && uniform(&q.high)) {
                    let span = *span;
                    self.report(Diagnostic::error(codes::WRONG_SHAPE, "the bounds differ from element to element", span));
                    return v;
                }
                let (low, high) = (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
                if !low.is_finite() && !high.is_finite() {
                    let (name, declared) = (q.name.clone(), self.vars[var].span);
                    self.report(
                        Diagnostic::error(codes::MISSING_CLAUSE, format!("`{name}` has no bounds to clip to"), *span)
                            .secondary(declared, "declared here")
                            .help("write `in low..high` in its declaration, or `clip low..high`"),
                    );
                    return v;
                }
                (self.exprs.constant(low), self.exprs.constant(high))
            }
        };
        let v = self.exprs.binary(BinaryFn::Max, v, low);
        self.exprs.binary(BinaryFn::Min, v, high)
    }

    // --- steady state -----------------------------------------------------------------------------------------------------------------

    fn steady_program(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut given: HashMap<(VarId, i64), ExprId> = HashMap::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Steady { entries }, .. }) = item else { continue };
            self.model.interface.has_steady = true;
            let place = self.place(scope, Site::Instant);
            for (target, value) in entries {
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
        self.model.interface.steady_given = base > 0 && fixed.len() as i64 == base;
        self.model.interface.steady_fixed = fixed;
        self.model.programs.steady = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: false };
    }

    /// `col = 0`: every state of an instance, or of the instances of an array.
    fn steady_instance(&mut self, target: &Expr, value: &Expr, place: &Place, given: &mut HashMap<(VarId, i64), ExprId>) -> bool {
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
    pub(super) fn variables_of(&self, role: Role) -> Vec<VarId> {
        if role == Role::State {
            return self.state_variables();
        }
        self.vars.iter().filter(|(_, v)| v.role == role).map(|(id, _)| id).collect()
    }

    fn state_variables(&self) -> Vec<VarId> {
        self.in_text_order()
            .into_iter()
            .filter_map(|s| match self.names.symbols[s].kind {
                SymbolKind::Variable { var, .. } if self.vars[var].role == Role::State => Some(var),
                _ => None,
            })
            .collect()
    }

    // --- initial values ---------------------------------------------------------------------------------------------------------------

    fn initial_programs(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut states = Program { nests: Vec::new(), in_place: true };
        let mut discretes = Program { nests: Vec::new(), in_place: true };
        let symbols = self.in_text_order();
        let mut plain = Vec::new();
        let mut plain_discretes = Vec::new();
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
            for piece in pieces {
                let (at, value) = piece.value;
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
        states.nests = self.ordered(states.nests);
        self.model.programs.initial_states = states;
        self.model.programs.initial_discretes = discretes;
    }

    /// Nests of initial values so that each follows those whose results it reads; scalars that read nothing stay together, first.
    fn ordered(&mut self, nests: Vec<Nest>) -> Vec<Nest> {
        let mut list = Vec::with_capacity(nests.len());
        for mut nest in nests {
            if nest.extents.is_empty() && nest.stores.len() > 1 {
                let (dependent, free): (Vec<Store>, Vec<Store>) =
                    std::mem::take(&mut nest.stores).into_iter().partition(|s| !self.states_read(s.value).is_empty());
                nest.stores = free;
                list.push(nest);
                list.extend(dependent.into_iter().map(|s| Nest { extents: Vec::new(), stores: vec![s] }));
            } else {
                list.push(nest);
            }
        }
        let reads: Vec<Vec<(VarId, Affine)>> =
            list.iter().map(|n| n.stores.iter().flat_map(|s| self.states_read(s.value)).collect()).collect();
        if reads.iter().all(Vec::is_empty) {
            return list;
        }
        let writes: Vec<Vec<(VarId, Affine)>> = list
            .iter()
            .map(|n| {
                let target = |s: &Store| match s.target.place {
                    Memory::Var(var) => Some((var, s.target.at)),
                    _ => None,
                };
                n.stores.iter().filter_map(target).collect()
            })
            .collect();
        let meets = |a: &(VarId, Affine), b: &(VarId, Affine)| a.0 == b.0 && (a.1 == b.1 || !a.1.is_constant() || !b.1.is_constant());
        let mut state = vec![0_u8; list.len()];
        let mut order = Vec::with_capacity(list.len());
        let mut stack: Vec<usize> = (0..list.len()).rev().collect();
        while let Some(&i) = stack.last() {
            if state[i] > 0 {
                stack.pop();
                if state[i] == 1 {
                    state[i] = 2;
                    order.push(i);
                }
                continue;
            }
            state[i] = 1;
            for j in 0..list.len() {
                let own = writes[j].iter().any(|w| writes[i].iter().any(|v| meets(v, w)));
                if j == i || own || !reads[i].iter().any(|r| writes[j].iter().any(|w| meets(r, w))) {
                    continue;
                }
                match state[j] {
                    0 => stack.push(j),
                    1 => {
                        let names: Vec<String> =
                            [i, j].iter().filter_map(|&k| writes[k].first()).map(|w| format!("`{}`", self.vars[w.0].name)).collect();
                        let span = writes[i].first().map_or_else(Span::default, |w| self.vars[w.0].span);
                        self.report(Diagnostic::error(
                            codes::CYCLIC_DEFINITION,
                            format!("the initial values of {} need each other", names.join(" and ")),
                            span,
                        ));
                    }
                    _ => {}
                }
            }
        }
        let mut slots: Vec<Option<Nest>> = list.into_iter().map(Some).collect();
        order.into_iter().filter_map(|i| slots[i].take()).collect()
    }

    /// States that an initial value reads.
    fn states_read(&self, e: ExprId) -> Vec<(VarId, Affine)> {
        let mut seen = std::collections::HashSet::new();
        let mut stack = vec![e];
        let mut out = Vec::new();
        while let Some(e) = stack.pop() {
            if !seen.insert(e) {
                continue;
            }
            if let crate::ir::Expr::Load { var, flavour: Flavour::Value, at } = self.exprs.node(e)
                && self.vars[var].role == Role::State
            {
                out.push((var, at));
            }
            stack.extend(self.exprs.operands(e));
        }
        out
    }

    /// One `initial` statement at one place: a scalar, an element, or a whole array.
    #[allow(clippy::type_complexity, reason = "a variable and pieces of it")]
    fn initial(
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
            && let Some(super::Bound::Element(symbol, at)) = place.bound(&name.text)
        {
            return Some((*symbol, Some(*at)));
        }
        let (base, index): (&Expr, &[Expr]) = match &e.kind {
            ExprKind::Index(base, index) => (base, index),
            _ => (e, &[]),
        };
        let symbol = match self.resolve(base, place) {
            super::indices::Target::Symbol(symbol) => symbol,
            super::indices::Target::Value(v) => {
                if !v.is_poison() {
                    self.report(Diagnostic::error(codes::WRONG_KIND, "a variable is needed here", e.span));
                }
                return None;
            }
            super::indices::Target::Nothing => return None,
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

    fn disturbance_program(&mut self) {
        let mut program = Program { nests: Vec::new(), in_place: true };
        let symbols: Vec<SymbolId> = self.names.symbols.keys().collect();
        let mut scalars = Vec::new();
        for symbol in symbols {
            let SymbolKind::Variable { var, unit, declaration, axes } = self.names.symbols[symbol].kind.clone() else { continue };
            if self.vars[var].role != Role::Disturbance {
                continue;
            }
            let Some(rule) = &declaration.sample else { continue };
            let path = self.names.symbols[symbol].path.clone();
            let place = self.place(self.names.symbols[symbol].scope, Site::Disturb);
            let pieces = self.nest(&declaration.indices, &place, &mut |s, inner| {
                let at = s.element_address(&axes, &declaration.indices, inner);
                let outer = s.random_site.replace((stream_name(&path, at, s.vars[var].len), Instant::Step));
                let v = s.number_in(rule, &unit, &path, declaration.span, inner);
                s.random_site = outer;
                (at, s.clipped(v, var, at, declaration.clip.as_ref(), &unit, inner))
            });
            for piece in pieces {
                let s = store(Memory::Var(var), piece.value.0, piece.value.1);
                if piece.extents.is_empty() {
                    scalars.push(s);
                } else {
                    program.nests.push(Nest { extents: piece.extents, stores: vec![s] });
                }
            }
        }
        if !scalars.is_empty() {
            program.nests.insert(0, Nest { extents: Vec::new(), stores: scalars });
        }
        self.model.programs.disturb = program;
    }

    // --- sampling instants and events -----------------------------------------------------------------------------------------------

    fn instant_programs(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut start = Program { nests: Vec::new(), in_place: true };
        let mut end = Program { nests: Vec::new(), in_place: true };
        let mut events: Vec<(ScopeId, &'a str, Program)> = Vec::new();
        let mut next_group: Vec<(String, usize)> = Vec::new();
        // Parts before the whole: what a component updates at the end of a step is seen by the `at end` of what it is used in.
        let mut inner_first: Vec<&(ScopeId, Vec<Item<'a>>)> = blocks.iter().collect();
        inner_first.sort_by_key(|(scope, _)| std::cmp::Reverse(self.names.scopes[*scope].prefix.matches('.').count()));
        let mut last_end: Option<Span> = None;
        for (scope, item) in inner_first.into_iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i))) {
            let Item::At(Ident { text: instant, span: block }, statement) = item else { continue };
            let instant = instant.as_str();
            if instant == "end" && last_end.replace(*block).is_some_and(|last| last != *block) {
                next_group.retain(|(name, _)| name != instant);
            }
            let program = match instant {
                "start" => &mut start,
                "end" => &mut end,
                name => {
                    let at = match events.iter().position(|(s, n, _)| *n == name && *s == scope) {
                        Some(at) => at,
                        None => {
                            events.push((scope, name, Program { nests: Vec::new(), in_place: true }));
                            events.len() - 1
                        }
                    };
                    &mut events[at].2
                }
            };
            let mut taken = std::mem::take(program);
            if instant == "start" && matches!(statement.kind, StatementKind::Reset { .. }) {
                self.model.interface.start_resets = true;
            }
            self.instant_statement(scope, statement, &mut taken, &mut next_group, instant);
            match instant {
                "start" => start = taken,
                "end" => end = taken,
                name => {
                    if let Some(e) = events.iter_mut().find(|(s, n, _)| *n == name && *s == scope) {
                        e.2 = taken;
                    }
                }
            }
        }
        self.model.programs.start = start;
        self.model.programs.end = end;
        self.events(blocks, events);
        self.schedule_programs();
    }

    /// `next`, `reset`, `clamp`. Consecutive `next`s of scalars share a nest, so that they assign together.
    pub(super) fn instant_statement(
        &mut self,
        scope: ScopeId,
        statement: &Statement,
        program: &mut Program,
        group: &mut Vec<(String, usize)>,
        instant: &str,
    ) {
        let place = self.place(scope, Site::Instant);
        let (target, value, condition, binders, roles): (_, _, Option<&Expr>, _, &[Role]) = match &statement.kind {
            StatementKind::Next { target, value, binders } => (target, value, None, binders, &[Role::Discrete]),
            StatementKind::Reset { target, value, binders } => (target, value, None, binders, &[Role::State]),
            StatementKind::Clamp { target, value, condition, binders } => {
                (target, value, Some(condition), binders, &[Role::State, Role::Discrete])
            }
            _ => {
                self.report(Diagnostic::error(
                    codes::MISPLACED_BLOCK,
                    "only `next`, `reset` and `clamp` may stand in `at`",
                    statement.span,
                ));
                return;
            }
        };
        let is_next = matches!(statement.kind, StatementKind::Next { .. });
        let pieces = self.nest(binders, &place, &mut |s, inner| s.assignment(target, value, condition, roles, inner));
        for piece in pieces {
            let Some((var, at, v, whole)) = piece.value else { continue };
            let mut extents = piece.extents;
            extents.extend(whole);
            let s = store(Memory::Var(var), at, v);
            // The nest that collects the `next`s of this instant since its last other statement.
            // At the start all `next`s come together, before the resets.
            if is_next && extents.is_empty() && instant == "start" {
                match program.nests.first_mut().filter(|_| group.iter().any(|(name, _)| name == instant)) {
                    Some(first) => first.stores.push(s),
                    None => {
                        program.nests.insert(0, Nest { extents, stores: vec![s] });
                        group.push((instant.to_owned(), 0));
                    }
                }
                continue;
            }
            let open = group.iter().find(|(name, _)| name == instant).map(|(_, at)| *at);
            if is_next && extents.is_empty() {
                match open.filter(|&at| at + 1 == program.nests.len()) {
                    Some(at) => program.nests[at].stores.push(s),
                    None => {
                        program.nests.push(Nest { extents, stores: vec![s] });
                        group.retain(|(name, _)| name != instant);
                        group.push((instant.to_owned(), program.nests.len() - 1));
                    }
                }
            } else {
                program.nests.push(Nest { extents, stores: vec![s] });
            }
        }
    }

    #[allow(clippy::type_complexity, reason = "variable, element, value, and the extent of a whole array")]
    fn assignment(
        &mut self,
        target: &Expr,
        value: &Expr,
        condition: Option<&Expr>,
        roles: &[Role],
        place: &Place,
    ) -> Option<(VarId, Affine, ExprId, Option<u32>)> {
        let (symbol, at) = self.target(target, place, roles)?;
        let SymbolKind::Variable { var, unit, .. } = self.names.symbols[symbol].kind.clone() else { return None };
        let declared = self.names.symbols[symbol].span;
        let what = format!("`{}`", self.names.symbols[symbol].path);
        let (at, whole) = match at {
            Some(at) => (at, None),
            None => {
                let len = self.vars[var].len;
                let depth = crate::ir::LoopVar(place.depth);
                if len == 1 { (Affine::default(), None) } else { (Affine::along(0, depth, 1), Some(len)) }
            }
        };
        let v = self.value(value, place);
        let mut e = self.strictly_or_bare(v, &unit, value.span, &what, declared);
        if let Some(c) = condition {
            let holds = self.condition(c, place);
            let present = self.exprs.load(var, Flavour::Value, at);
            e = self.exprs.select(holds, e, present);
        }
        if let Some(guard) = self.guard {
            let present = self.exprs.load(var, Flavour::Value, at);
            e = self.exprs.select(guard, e, present);
        }
        Some((var, at, e, whole))
    }

    /// A literal number is taken in the target's unit, anything else must have it.
    fn strictly_or_bare(&mut self, v: Value, unit: &Unit, span: Span, what: &str, declared: Span) -> ExprId {
        if matches!(v.unit, Measure::Bare) {
            return self.in_unit(v, unit, span, what, declared);
        }
        self.strictly_in(v, unit, span, what, declared)
    }

    /// `event name when condition`, with what happens `at name`.
    fn events(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)], programs: Vec<(ScopeId, &'a str, Program)>) {
        let mut used = vec![false; programs.len()];
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Event { name, condition, .. }, .. }) = item else { continue };
            let place = self.place(scope, Site::Instant);
            let Some((value, direction)) = self.root_of(condition, &place) else { continue };
            let program = programs.iter().position(|(s, n, _)| *n == name.text && *s == scope);
            let action = match program {
                Some(at) => {
                    used[at] = true;
                    self.model.programs.events.push(programs[at].2.clone());
                    RootAction::Run(self.model.programs.events.len() as u32 - 1)
                }
                None => RootAction::Restart,
            };
            let name = self.path_of(scope, name);
            self.model.roots.push(Root { name, value, direction, action });
        }
        for ((_, name, _), used) in programs.iter().zip(used) {
            if !used {
                let known: Vec<&str> = blocks
                    .iter()
                    .flat_map(|(_, items)| items)
                    .filter_map(|i| match i {
                        Item::Other(Statement { kind: StatementKind::Event { name, .. }, .. }) => Some(name.text.as_str()),
                        _ => None,
                    })
                    .chain(["start", "end"])
                    .collect();
                let span = blocks
                    .iter()
                    .flat_map(|(_, items)| items)
                    .find_map(|i| match i {
                        Item::At(n, _) if n.text == *name => Some(n.span),
                        _ => None,
                    })
                    .unwrap_or_default();
                let help = did_you_mean(name, known);
                self.report(Diagnostic::error(codes::UNKNOWN_NAME, format!("no event is called `{name}`"), span).maybe_help(help));
            }
        }
    }

    /// Root function and direction of a comparison: its zero is where the condition becomes true.
    pub(super) fn root_of(&mut self, condition: &Expr, place: &Place) -> Option<(ExprId, i8)> {
        let ExprKind::Binary(op, a, b) = &condition.kind else {
            self.report(
                Diagnostic::error(codes::WRONG_KIND, "an event is a comparison of two quantities", condition.span)
                    .help("for example `h <= 0 [m]`"),
            );
            return None;
        };
        let direction = match op {
            BinaryOp::Lt | BinaryOp::Le => -1,
            BinaryOp::Gt | BinaryOp::Ge => 1,
            _ => {
                self.report(Diagnostic::error(codes::WRONG_KIND, "an event is a comparison with `<`, `<=`, `>` or `>=`", condition.span));
                return None;
            }
        };
        let (x, y) = (self.value(a, place), self.value(b, place));
        let (l, r) = self.common(&x, a.span, &y, b.span, condition.span)?;
        Some((self.exprs.sub(l, r), direction))
    }

    // --- conditions and rewards -------------------------------------------------------------------------------------------------------

    /// `success`, `failure`, `timeout`, `reward` in an expression.
    pub(super) fn outcome_name(&mut self, name: &Ident, _place: &Place) -> Option<Value> {
        let outcome = self.outcome?;
        Some(match name.text.as_str() {
            "success" => Value::truth(outcome.success),
            "failure" => Value::truth(outcome.failure),
            "timeout" => Value::truth(outcome.timeout),
            _ => Value { expr: outcome.reward?, unit: Measure::Bare },
        })
    }

    /// A name with the path of its instance.
    fn path_of(&self, scope: ScopeId, name: &Ident) -> String {
        format!("{}{}", self.names.scopes[scope].prefix, name.text)
    }

    fn builtin(&mut self, b: Builtin) -> ExprId {
        self.exprs.load(self.builtins, Flavour::Value, Affine::constant(b as i64))
    }

    fn flag(&mut self, b: Builtin) -> ExprId {
        let (e, half) = (self.builtin(b), self.exprs.constant(0.5));
        self.exprs.compare(Compare::Lt, half, e)
    }

    /// Failures, successes, constraints, rewards and observations, in the layout of [`crate::model::Finish`].
    fn finish_program(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let observed = self.observations(blocks);
        let mut failures: Vec<(usize, Condition, Failure)> = Vec::new();
        let mut on_reward = Vec::new();
        let mut successes = Vec::new();
        let mut order = 0;
        for (scope, item) in each(blocks) {
            let Item::Other(statement) = item else { continue };
            let place = self.place(scope, Site::Instant);
            match &statement.kind {
                StatementKind::Fail { name, event, condition, text } => {
                    let failure = Failure {
                        name: self.path_of(scope, name),
                        text: text.clone().unwrap_or_default(),
                        event: *event,
                        items: Vec::new(),
                        on_reward: mentions_name(condition, "reward"),
                    };
                    if ["action_box", "solver"].contains(&name.text.as_str()) {
                        self.report(Diagnostic::error(
                            codes::DUPLICATE_NAME,
                            format!("`{}` is the name of a failure that every model has", name.text),
                            name.span,
                        ));
                    }
                    if failure.on_reward {
                        on_reward.push((order, place, condition, failure));
                    } else {
                        let c = self.failing(condition, &place);
                        if *event && let Some((value, direction)) = self.root_of(condition, &place) {
                            let name = self.path_of(scope, name);
                            self.model.roots.push(Root { name, value, direction, action: RootAction::Fail(order as u32) });
                        }
                        failures.push((order, c, failure));
                    }
                    order += 1;
                }
                StatementKind::Success { name, condition, .. } => {
                    let c = self.condition(condition, &place);
                    successes.push((self.path_of(scope, name), c));
                }
                _ => {}
            }
        }
        let failure = {
            let mut any = self.flag(Builtin::Failed);
            for (_, c, _) in &failures {
                any = self.exprs.or(any, c.holds);
            }
            any
        };
        let no_failure = self.exprs.not(failure);
        let mut success = self.exprs.truth(false);
        for (_, c) in &successes {
            success = self.exprs.or(success, *c);
        }
        let last = self.flag(Builtin::LastStep);
        let end_is_success = self.model.interface.episode.end_is_success;
        if end_is_success {
            success = self.exprs.or(success, last);
        }
        let success = self.exprs.and(no_failure, success);
        let no_success = self.exprs.not(success);
        let timeout = self.exprs.and(no_failure, no_success);
        let timeout = self.exprs.and(timeout, last);
        self.outcome = Some(Outcome { success, failure, timeout, reward: None });
        let rewards = self.rewards(blocks);
        if let Some(outcome) = &mut self.outcome {
            outcome.reward = rewards.get(self.model.interface.default_reward as usize).copied();
        }
        for (at, place, condition, failure) in on_reward {
            let c = self.failing(condition, &place);
            failures.push((at, c, failure));
        }
        failures.sort_by_key(|f| f.0);
        let constraints = self.constraints(blocks);

        let mut scalars: Vec<ExprId> = Vec::new();
        for (_, c, _) in &failures {
            scalars.push(c.holds);
            scalars.push(c.excess);
        }
        scalars.extend(successes.iter().map(|s| s.1));
        scalars.extend(constraints.iter().map(|c| c.1));
        scalars.extend(&rewards);
        let finish = &mut self.model.interface.finish;
        finish.failures = failures.len() as u32;
        finish.successes = successes.len() as u32;
        finish.constraints = constraints.len() as u32;
        finish.rewards = rewards.len() as u32;
        finish.observations = observed.names.len() as u32;
        let stores = scalars.iter().enumerate().map(|(i, &e)| store(Memory::Out, Affine::constant(i as i64), e)).collect();
        let mut program = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: false };
        let base = scalars.len() as i64;
        for nest in observed.nests {
            let stores = nest
                .stores
                .into_iter()
                .map(|mut s| {
                    s.target.at.offset += base;
                    s
                })
                .collect();
            match (nest.extents.is_empty(), program.nests.first_mut()) {
                (true, Some(first)) => first.stores.extend::<Vec<Store>>(stores),
                _ => program.nests.push(Nest { extents: nest.extents, stores }),
            }
        }
        self.model.programs.finish = program;

        let mut boxes = Vec::new();
        for (_, c, failure) in &mut failures {
            for (item, e) in std::mem::take(&mut c.items) {
                failure.items.push(item);
                boxes.push(store(Memory::Out, Affine::constant(boxes.len() as i64), e));
            }
        }
        self.model.programs.boxes = Program { nests: vec![Nest { extents: Vec::new(), stores: boxes }], in_place: false };
        self.model.interface.failures = failures.into_iter().map(|f| f.2).collect();
        self.model.interface.successes = successes.into_iter().map(|s| s.0).collect();
        self.model.interface.constraints = constraints.into_iter().map(|c| c.0).collect();
        self.model.interface.observations = observed.names;
    }

    fn rewards(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<ExprId> {
        let mut out = Vec::new();
        let mut chosen = None;
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Reward { name, unit, default, value, text }, .. }) = item else { continue };
            let place = self.place(scope, Site::Instant);
            let unit = match unit {
                Some(u) => self.unit(u, &place).unwrap_or_else(Unit::one),
                None => Unit::one(),
            };
            if *default {
                chosen = Some(out.len());
            }
            let v = self.value(value, &place);
            let what = format!("the reward `{}`", name.text);
            out.push(self.strictly_or_bare(v, &unit, value.span, &what, name.span));
            let name = self.path_of(scope, name);
            self.model.interface.rewards.push(Reward { name, unit: unit.to_string(), text: text.clone().unwrap_or_default() });
        }
        if let Some(wanted) = &self.options.reward {
            let names: Vec<String> = self.model.interface.rewards.iter().map(|r| r.name.clone()).collect();
            match names.iter().position(|n| n == wanted) {
                Some(at) => chosen = Some(at),
                None => self.scenario_fault(format!("unknown reward `{wanted}`; the model has {}", names.join(", "))),
            }
        }
        self.model.interface.default_reward = chosen.unwrap_or(0) as u32;
        out
    }

    fn constraints(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Vec<(String, ExprId)> {
        let mut out = Vec::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Constraint { name, condition, .. }, .. }) = item else { continue };
            let place = self.place(scope, Site::Instant);
            let c = self.failing(condition, &place);
            out.push((self.path_of(scope, name), c.excess));
        }
        out
    }

    /// A failing condition with its violation.
    fn failing(&mut self, e: &Expr, place: &Place) -> Condition {
        let zero = self.exprs.constant(0.0);
        if let ExprKind::Call { function, arguments } = &e.kind
            && function.text == "outside"
            && let [inner] = arguments.as_slice()
        {
            let (excess, items) = self.box_excess(inner, place);
            let holds = self.beyond(excess);
            let excess = self.exprs.select(holds, excess, zero);
            return Condition { holds, excess, items };
        }
        let holds = self.condition(e, place);
        let amount = self.amount(e, place);
        let excess = match amount {
            Some(amount) => self.exprs.binary(BinaryFn::Max, amount, zero),
            None => self.exprs.constant(1.0),
        };
        let excess = self.exprs.select(holds, excess, zero);
        Condition { holds, excess, items: Vec::new() }
    }

    /// Beyond the slack, or not a number.
    pub(super) fn beyond(&mut self, excess: ExprId) -> ExprId {
        let slack = self.exprs.constant(1e-6);
        let inside = self.exprs.compare(Compare::Le, excess, slack);
        self.exprs.not(inside)
    }

    /// By how much a comparison holds, relative to the range of its left side.
    fn amount(&mut self, e: &Expr, place: &Place) -> Option<ExprId> {
        let ExprKind::Binary(op, a, b) = &e.kind else { return None };
        match op {
            BinaryOp::And | BinaryOp::Or => {
                let (x, y) = (self.amount(a, place)?, self.amount(b, place)?);
                let f = if *op == BinaryOp::And { BinaryFn::Min } else { BinaryFn::Max };
                Some(self.exprs.binary(f, x, y))
            }
            BinaryOp::Lt | BinaryOp::Le | BinaryOp::Gt | BinaryOp::Ge => {
                let (x, y) = (self.value(a, place), self.value(b, place));
                let (l, r) = self.common(&x, a.span, &y, b.span, e.span)?;
                let range = self.range_of(l).or_else(|| self.constant_value(r).map(f64::abs)).filter(|r| *r > 0.0 && r.is_finite());
                let range = self.exprs.constant(range.unwrap_or(1.0));
                let difference = if matches!(op, BinaryOp::Lt | BinaryOp::Le) { self.exprs.sub(r, l) } else { self.exprs.sub(l, r) };
                Some(self.exprs.div(difference, range))
            }
            _ => None,
        }
    }

    fn range_of(&self, e: ExprId) -> Option<f64> {
        let crate::ir::Expr::Load { var, at, .. } = self.exprs.node(e) else { return None };
        let q = self.quantities.get(&var)?;
        let i = at.offset.max(0) as usize;
        let range = Quantity::pick(&q.high, i) - Quantity::pick(&q.low, i);
        (range.is_finite() && range > 0.0).then_some(range)
    }

    /// `outside bounds(...)`, `inside bounds(...)` as a condition.
    pub(super) fn box_condition(&mut self, function: &Ident, a: &Expr, place: &Place) -> Value {
        let (excess, _) = self.box_excess(a, place);
        let outside = self.beyond(excess);
        let expr = if function.text == "outside" { outside } else { self.exprs.not(outside) };
        Value::truth(expr)
    }

    /// Largest excess over a box, relative to each range, and its members.
    fn box_excess(&mut self, e: &Expr, place: &Place) -> (ExprId, Vec<(BoxItem, ExprId)>) {
        let zero = self.exprs.constant(0.0);
        let arguments = match &e.kind {
            ExprKind::Call { function, arguments } if function.text == "bounds" => arguments,
            _ => {
                self.report(Diagnostic::error(codes::WRONG_ARGUMENTS, "a box is needed here", e.span).help("`outside bounds(x, y)`"));
                return (zero, Vec::new());
            }
        };
        let mut members = Vec::new();
        for argument in arguments {
            self.box_members(argument, place, &mut members);
        }
        let mut excess: Option<ExprId> = None;
        for (item, value) in &members {
            let range = item.high - item.low;
            let range = self.exprs.constant(if range.is_finite() && range > 0.0 { range } else { 1.0 });
            for (bound, sign) in [(item.low, 1), (item.high, -1)] {
                if !bound.is_finite() {
                    continue;
                }
                let bound = self.exprs.constant(bound);
                let d = if sign > 0 { self.exprs.sub(bound, *value) } else { self.exprs.sub(*value, bound) };
                let d = self.exprs.div(d, range);
                excess = Some(match excess {
                    Some(e) => self.exprs.binary(BinaryFn::Max, e, d),
                    None => d,
                });
            }
        }
        (excess.unwrap_or(zero), members)
    }

    fn box_members(&mut self, e: &Expr, place: &Place, out: &mut Vec<(BoxItem, ExprId)>) {
        if let ExprKind::Name(name) = &e.kind
            && name.text == "observations"
            && self.names.lookup(place.scope, "observations").is_none()
        {
            out.extend(self.observed_members.clone());
            return;
        }
        let symbols: Vec<SymbolId> = match &e.kind {
            ExprKind::Name(n) if n.text == "states" && self.names.lookup(place.scope, "states").is_none() => {
                self.state_variables().iter().filter_map(|v| self.symbol_of.get(v).copied()).collect()
            }
            _ => match self.target(e, place, &[Role::State, Role::Algebraic, Role::Discrete, Role::Action, Role::Disturbance]) {
                Some((symbol, Some(at))) => {
                    self.box_element(symbol, at, e.span, out);
                    return;
                }
                Some((symbol, None)) => vec![symbol],
                None => return,
            },
        };
        for symbol in symbols {
            let SymbolKind::Variable { var, .. } = self.names.symbols[symbol].kind else { continue };
            for i in 0..i64::from(self.vars[var].len) {
                self.box_element(symbol, Affine::constant(i), e.span, out);
            }
        }
    }

    fn box_element(&mut self, symbol: SymbolId, at: Affine, span: Span, out: &mut Vec<(BoxItem, ExprId)>) {
        let SymbolKind::Variable { var, .. } = self.names.symbols[symbol].kind else { return };
        let Some(q) = self.quantities.get(&var) else { return };
        let i = at.offset.max(0) as usize;
        let item =
            BoxItem { name: q.element_name(i), unit: q.unit.clone(), low: Quantity::pick(&q.low, i), high: Quantity::pick(&q.high, i) };
        if !item.low.is_finite() && !item.high.is_finite() {
            let (name, declared) = (item.name.clone(), self.names.symbols[symbol].span);
            self.report(
                Diagnostic::error(codes::MISSING_CLAUSE, format!("`{name}` has no bounds"), span)
                    .secondary(declared, "declared here")
                    .help("write `in low..high` in its declaration"),
            );
            return;
        }
        let value = self.load(symbol, at);
        out.push((item, value.expr));
    }

    // --- policies and invariants ------------------------------------------------------------------------------------------------------

    fn policies(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let actions: Vec<(VarId, i64)> =
            self.variables_of(Role::Action).into_iter().flat_map(|v| (0..i64::from(self.vars[v].len)).map(move |i| (v, i))).collect();
        let nominal: Vec<ExprId> = actions
            .iter()
            .map(|(var, i)| {
                let x = self.quantities.get(var).map_or(f64::NAN, |q| Quantity::pick(&q.default, *i as usize));
                self.exprs.constant(x)
            })
            .collect();
        let program = |values: &[ExprId]| Program {
            nests: vec![Nest {
                extents: Vec::new(),
                stores: values.iter().enumerate().map(|(i, &e)| store(Memory::Out, Affine::constant(i as i64), e)).collect(),
            }],
            in_place: false,
        };
        let mut list = vec![("nominal".to_owned(), program(&nominal))];
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Policy { name, entries, .. }, .. }) = item else { continue };
            let place = self.place(scope, Site::Instant);
            let mut values = nominal.clone();
            for (target, e) in entries {
                let Some((symbol, at)) = self.target(target, &place, &[Role::Action]) else { continue };
                let SymbolKind::Variable { var, unit, .. } = self.names.symbols[symbol].kind.clone() else { continue };
                let value = self.number_in(e, &unit, "the action", target.span, &place);
                for (slot, (v, i)) in values.iter_mut().zip(&actions) {
                    if *v == var && at.is_none_or(|at| at.offset == *i) {
                        *slot = value;
                    }
                }
            }
            let made = program(&values);
            if name.text == "nominal" {
                list[0].1 = made;
            } else {
                list.push((name.text.clone(), made));
            }
        }
        self.model.programs.policies = list;
    }

    fn invariants(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut stores = Vec::new();
        for (scope, item) in each(blocks) {
            let Item::Other(Statement { kind: StatementKind::Invariant { name, value, rate, text }, .. }) = item else { continue };
            let place = self.place(scope, Site::Instant);
            let v = self.value(value, &place);
            let unit = v.unit.unit();
            let rate_expr = match rate {
                Some(e) => {
                    let wanted = units::rate(&unit, &self.time_unit);
                    let r = self.value(e, &place);
                    self.strictly_in(r, &wanted, e.span, &format!("the rate of `{}`", name.text), name.span)
                }
                None => self.exprs.constant(0.0),
            };
            for e in [v.expr, rate_expr] {
                stores.push(store(Memory::Out, Affine::constant(stores.len() as i64), e));
            }
            let name = self.path_of(scope, name);
            self.model.interface.invariants.push((name, text.clone().unwrap_or_default()));
        }
        self.model.programs.invariants = Program { nests: vec![Nest { extents: Vec::new(), stores }], in_place: false };
    }
}

/// All items with their scopes.
pub(super) fn each<'a, 'b>(blocks: &'b [(ScopeId, Vec<Item<'a>>)]) -> impl Iterator<Item = (ScopeId, Item<'a>)> + 'b {
    blocks.iter().flat_map(|(scope, items)| items.iter().map(move |i| (*scope, *i)))
}

/// A store.
pub(super) fn store(place: Memory, at: Affine, value: ExprId) -> Store {
    Store { target: Target { place, at }, value }
}

/// Name of the random stream of an element.
fn stream_name(path: &str, at: Affine, len: u32) -> String {
    if len == 1 || !at.is_constant() { path.to_owned() } else { format!("{path}[{}]", at.offset) }
}

fn mentions_name(e: &Expr, name: &str) -> bool {
    match &e.kind {
        ExprKind::Name(n) => n.text == name,
        ExprKind::Member(a, _) | ExprKind::Derivative(a) | ExprKind::Unary(_, a) | ExprKind::As(a, _) => mentions_name(a, name),
        ExprKind::Index(a, list) => mentions_name(a, name) || list.iter().any(|e| mentions_name(e, name)),
        ExprKind::Call { arguments, .. } | ExprKind::Tuple(arguments) => arguments.iter().any(|e| mentions_name(e, name)),
        ExprKind::Reduce { body, condition, .. } => mentions_name(body, name) || condition.as_ref().is_some_and(|c| mentions_name(c, name)),
        ExprKind::Binary(_, a, b) => mentions_name(a, name) || mentions_name(b, name),
        ExprKind::If(c, a, b) => mentions_name(c, name) || mentions_name(a, name) || mentions_name(b, name),
        ExprKind::Number { .. } | ExprKind::Bool(_) => false,
    }
}
