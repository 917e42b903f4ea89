//! What is seen from outside: observations, algebraic outputs, the interface.

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind, Ident, Observation, Statement, StatementKind};
use smpl_dsl::units::Unit;

use super::blocks::Piece;
use super::control::{each, store};
use super::items::{Item, items};
use super::names::{Axis, ScopeId, SymbolId, SymbolKind};
use super::quantity::Measure;
use super::{Bound, Elaborator, Place, Site};
use crate::ir::{Affine, ExprId, LoopVar, Nest, Place as Memory, Program, Role, VarId};
use crate::model::{BoxItem, Observed, Quantity};

/// The observations of a level with the nests that compute them.
#[derive(Default)]
pub(super) struct Observations {
    /// One entry a number.
    pub names: Vec<Observed>,
    /// Stores into the output vector, counted from the first observation.
    pub nests: Vec<Nest>,
}

/// What an observation says beside its value.
struct Attributes {
    bounds: Option<(f64, f64)>,
    every: u32,
    delay: u32,
    noise: f64,
}

impl<'a> Elaborator<'a> {
    pub(super) fn observations(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) -> Observations {
        let mut levels = vec!["default".to_owned()];
        let mut chosen: Vec<(ScopeId, &'a Observation)> = Vec::new();
        let wanted = self.options.observation.clone().unwrap_or_else(|| "default".to_owned());
        for (scope, item) in each(blocks) {
            match item {
                Item::Observe(o) if wanted == "default" || wanted == "full" => chosen.push((scope, o)),
                Item::Other(Statement { kind: StatementKind::Level { name, body, .. }, .. }) => {
                    levels.push(name.text.clone());
                    if name.text == wanted {
                        for item in items(body, &self.selection) {
                            if let Item::Observe(o) = item {
                                chosen.push((scope, o));
                            }
                        }
                    }
                }
                _ => {}
            }
        }
        if !levels.iter().any(|l| l == "full") {
            levels.push("full".to_owned());
        }
        if !levels.contains(&wanted) {
            let hint = did_you_mean(&wanted, levels.iter().map(String::as_str)).unwrap_or_default();
            self.scenario_fault(format!("unknown observation level `{wanted}`; the model has {} {hint}", levels.join(", ")));
        }
        let mut out = Observations::default();
        for (scope, o) in chosen {
            let place = self.place(scope, Site::Instant);
            self.observation(o, &place, &mut out);
        }
        if wanted == "full" && levels.last().is_some_and(|l| l == "full") {
            self.observe_states(&mut out);
        }
        if !levels.contains(&wanted) {
            return out;
        }
        self.model.interface.levels = levels;
        out
    }

    /// Works out the observations of a level that is not chosen.
    pub(super) fn check_level(&mut self, scope: ScopeId, level: Vec<Item<'a>>) {
        let place = self.place(scope, Site::Instant);
        let mut out = Observations::default();
        for item in level {
            if let Item::Observe(o) = item {
                self.observation(o, &place, &mut out);
            }
        }
    }

    fn attributes(&mut self, o: &Observation, unit: &Unit, place: &Place) -> Attributes {
        let bounds = o.bounds.as_ref().map(|(a, b)| {
            let mut number = |e: &Expr| {
                let expr = self.number_in(e, unit, "the bound", e.span, place);
                match self.constant_value(expr) {
                    Some(x) => x,
                    None => {
                        self.missing_value("a bound", e.span);
                        f64::NAN
                    }
                }
            };
            (number(a), number(b))
        });
        let count = |s: &mut Self, e: &Option<Expr>, least: i64| match e {
            Some(e) => match s.integer(e, place) {
                Some(n) if n >= least && n < 1_000_000 => n as u32,
                Some(n) => {
                    s.report(Diagnostic::error(
                        codes::BAD_SETTING,
                        format!("a number of steps from {least} on is needed, not {n}"),
                        e.span,
                    ));
                    least as u32
                }
                None => least as u32,
            },
            None => least as u32,
        };
        let (every, delay) = (count(self, &o.every, 1), count(self, &o.delay, 0));
        let noise = o.noise.as_ref().map_or(0.0, |e| self.noise(e, unit, place));
        Attributes { bounds, every, delay, noise }
    }

    /// Standard deviation of `normal(0, sd)`.
    fn noise(&mut self, e: &Expr, unit: &Unit, place: &Place) -> f64 {
        if let ExprKind::Call { function, arguments } = &e.kind
            && function.text == "normal"
            && let [_, sd] = arguments.as_slice()
        {
            let expr = self.number_in(sd, unit, "the noise", e.span, place);
            if let Some(x) = self.constant_value(expr).filter(|x| *x >= 0.0) {
                return x;
            }
        }
        self.report(Diagnostic::error(codes::WRONG_ARGUMENTS, "noise is given as `normal(0, standard deviation)`", e.span).help(
            "noise is added to what is observed, with mean zero; what is drawn otherwise can be a `disturbance` in the observed expression",
        ));
        0.0
    }

    fn observation(&mut self, o: &Observation, place: &Place, out: &mut Observations) {
        if let ExprKind::Name(name) = &o.value.kind
            && name.text == "states"
            && self.names.lookup(place.scope, "states").is_none()
        {
            self.observe_states(out);
            return;
        }
        // `observe x for x in states`
        if let ([Binder { name: x, over: BinderSet::Set(set), .. }], ExprKind::Name(n)) = (o.binders.as_slice(), &o.value.kind)
            && x.text == n.text
            && set.text == "states"
            && self.names.lookup(place.scope, "states").is_none()
        {
            self.observe_states(out);
            return;
        }
        if o.binders.is_empty()
            && let Some((symbol, axes)) = self.whole_array(&o.value, place)
        {
            self.observe_array(o, symbol, &axes, place, out);
            return;
        }
        let pieces = self.nest(&o.binders, place, &mut |s, inner| {
            let v = s.value(&o.value, inner);
            // What else is said of it makes no sense yet.
            if v.is_poison() {
                return None;
            }
            let unit = match &o.unit {
                Some(u) => s.unit(u, inner),
                None => Some(v.unit.unit()),
            };
            let unit = unit.unwrap_or_else(Unit::one);
            let what = "the observation".to_owned();
            let expr = match v.unit {
                Measure::Bare => v.expr,
                _ => s.strictly_in(v, &unit, o.value.span, &what, o.span),
            };
            let name = s.observation_name(o, inner);
            let mut attributes = s.attributes(o, &unit, inner);
            if attributes.bounds.is_none() {
                attributes.bounds = s.bounds_of_element(expr);
            }
            Some((name, unit, expr, attributes))
        });
        for Piece { extents, value } in pieces {
            let Some((name, unit, expr, attributes)) = value else { continue };
            if !extents.is_empty() {
                self.report(
                    Diagnostic::error(codes::WRONG_SHAPE, "an observation over the cells of a domain", o.span)
                        .help("observe the whole array, `observe c`, or single cells"),
                );
                continue;
            }
            self.push_observation(name, &unit.to_string(), expr, &attributes, o, out);
        }
    }

    fn push_observation(&mut self, name: String, unit: &str, expr: ExprId, a: &Attributes, o: &Observation, out: &mut Observations) {
        let (low, high) = a.bounds.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        if a.bounds.is_none() {
            self.report(
                Diagnostic::warning(codes::MISSING_CLAUSE, format!("the observation `{name}` has no bounds"), o.span)
                    .help("write `in low..high`: learners need a finite box"),
            );
        }
        let at = Affine::constant(out.names.len() as i64);
        let s = store(Memory::Out, at, expr);
        match out.nests.first_mut().filter(|n| n.extents.is_empty()) {
            Some(first) => first.stores.push(s),
            None => out.nests.insert(0, Nest { extents: Vec::new(), stores: vec![s] }),
        }
        self.observed_members.push((BoxItem { name: name.clone(), unit: unit.to_owned(), low, high }, expr));
        out.names.push(Observed { name, unit: unit.to_owned(), low, high, every: a.every, delay: a.delay, noise: a.noise });
    }

    fn bounds_of_element(&self, e: ExprId) -> Option<(f64, f64)> {
        let crate::ir::Expr::Load { var, at, .. } = self.exprs.node(e) else { return None };
        let q = self.quantities.get(&var)?;
        let i = at.offset.max(0) as usize;
        let (low, high) = (Quantity::pick(&q.low, i), Quantity::pick(&q.high, i));
        (low.is_finite() || high.is_finite()).then_some((low, high))
    }

    /// Own name, else that of the variable with its indices.
    fn observation_name(&mut self, o: &Observation, place: &Place) -> String {
        let base = match &o.name {
            Some(name) => format!("{}{}", self.names.scopes[place.scope].prefix, name.text),
            None => match &o.value.kind {
                ExprKind::Name(name) => match self.names.lookup(place.scope, &name.text).filter(|_| place.bound(&name.text).is_none()) {
                    Some(symbol) => self.names.symbols[symbol].path.clone(),
                    None => name.text.clone(),
                },
                ExprKind::Index(base, index) => {
                    if let super::indices::Target::Symbol(symbol) = self.resolve(base, place)
                        && let Some(name) = self.element_name(symbol, index, place)
                    {
                        return name;
                    }
                    super::items::reference(&o.value)
                }
                ExprKind::Member(..) => match self.resolve(&o.value, place) {
                    super::indices::Target::Symbol(symbol) => self.names.symbols[symbol].path.clone(),
                    _ => super::items::reference(&o.value),
                },
                _ => {
                    self.report(
                        Diagnostic::error(codes::MISSING_CLAUSE, "an observed expression needs a name", o.span)
                            .help("write `observe name = expression in low..high`"),
                    );
                    "observation".to_owned()
                }
            },
        };
        if o.binders.is_empty() {
            return base;
        }
        let labels: Vec<String> = o.binders.iter().map(|b| self.bound_label(&b.name.text, place)).collect();
        format!("{base}[{}]", labels.join(","))
    }

    fn bound_label(&self, name: &str, place: &Place) -> String {
        match place.bound(name) {
            Some(Bound::Member(set, i)) => self.names.sets[*set].labels[*i].clone(),
            Some(Bound::Cell(_, c)) => (c.first + 1).to_string(),
            _ => String::new(),
        }
    }

    fn element_name(&mut self, symbol: SymbolId, index: &[Expr], place: &Place) -> Option<String> {
        let (axes, pattern) = match &self.names.symbols[symbol].kind {
            SymbolKind::Variable { axes, declaration, .. } | SymbolKind::Let { axes, declaration, .. } => {
                (axes.clone(), declaration.pattern.clone())
            }
            SymbolKind::Table { axes, .. } => (Rc::clone(axes), None),
            _ => return None,
        };
        let path = self.names.symbols[symbol].path.clone();
        let (_, bounds) = self.address(symbol, &axes, index, index.first()?.span, place)?;
        let labels: Vec<String> = bounds
            .iter()
            .map(|b| match b {
                Bound::Member(set, i) => self.names.sets[*set].labels[*i].clone(),
                Bound::Cell(_, c) => (c.first + 1).to_string(),
                _ => String::new(),
            })
            .collect();
        let joined = labels.join(",");
        Some(match pattern {
            Some(pattern) => pattern.replace("{}", &joined),
            None => format!("{path}[{joined}]"),
        })
    }

    /// The array that a bare name means.
    fn whole_array(&mut self, e: &Expr, place: &Place) -> Option<(SymbolId, Rc<[Axis]>)> {
        if !matches!(e.kind, ExprKind::Name(_) | ExprKind::Member(..)) {
            return None;
        }
        if let ExprKind::Name(n) = &e.kind
            && (place.bound(&n.text).is_some() || self.names.lookup(place.scope, &n.text).is_none())
        {
            return None;
        }
        let super::indices::Target::Symbol(symbol) = self.resolve(e, place) else { return None };
        match &self.names.symbols[symbol].kind {
            SymbolKind::Variable { axes, .. } | SymbolKind::Let { axes, .. } if !axes.is_empty() => Some((symbol, axes.clone())),
            _ => None,
        }
    }

    fn observe_array(&mut self, o: &Observation, symbol: SymbolId, axes: &[Axis], place: &Place, out: &mut Observations) {
        let var = match &self.names.symbols[symbol].kind {
            SymbolKind::Variable { var, .. } => Some(*var),
            _ => None,
        };
        if let Some(var) = var
            && let Some(q) = self.quantities.get(&var).cloned()
        {
            let SymbolKind::Variable { unit, .. } = &self.names.symbols[symbol].kind else { return };
            let unit = unit.clone();
            let a = self.attributes(o, &unit, place);
            self.observe_elements(var, &q, &a, out);
            return;
        }
        // An indexed `let`: one observation a member.
        let mut binders = Vec::new();
        let mut index = Vec::new();
        for &axis in axes {
            let name = Ident { text: self.names.axis_name(axis).to_owned(), span: o.value.span };
            index.push(Expr { span: o.value.span, kind: ExprKind::Name(name.clone()) });
            binders.push(Binder { name, over: BinderSet::Itself, span: o.value.span });
        }
        let value = Expr { span: o.value.span, kind: ExprKind::Index(Box::new(o.value.clone()), index) };
        let each = Observation { value, binders: Vec::new(), name: None, ..o.clone() };
        let pieces = self.nest(&binders, place, &mut |s, inner| {
            let v = s.value(&each.value, inner);
            let unit = v.unit.unit();
            let name = s.observation_name(&each, inner);
            let a = s.attributes(&each, &unit, inner);
            (name, unit, v.expr, a)
        });
        for Piece { extents, value: (name, unit, expr, a) } in pieces {
            if extents.is_empty() {
                self.push_observation(name, &unit.to_string(), expr, &a, o, out);
            }
        }
    }

    /// All elements of a variable in storage order, as one loop.
    fn observe_elements(&mut self, var: VarId, q: &Quantity, a: &Attributes, out: &mut Observations) {
        let base = out.names.len() as i64;
        let len = self.vars[var].len;
        let (extents, offset) = if len == 1 { (Vec::new(), Affine::default()) } else { (vec![len], Affine::along(0, LoopVar(0), 1)) };
        let value = self.exprs.load(var, crate::ir::Flavour::Value, offset);
        let s = store(Memory::Out, Affine::constant(base).plus(offset), value);
        out.nests.push(Nest { extents, stores: vec![s] });
        for i in 0..len as usize {
            out.names.push(observed(q, i, a));
        }
    }

    /// Every state, in the order of the outside.
    fn observe_states(&mut self, out: &mut Observations) {
        let base = out.names.len();
        let order = self.state_positions();
        let total: usize = order.iter().map(|(_, list)| list.len()).sum();
        let none = Attributes { bounds: None, every: 1, delay: 0, noise: 0.0 };
        let mut names: Vec<Option<Observed>> = vec![None; total];
        for (var, positions) in order {
            let Some(q) = self.quantities.get(&var).cloned() else { continue };
            let slots: Vec<u32> = positions.iter().map(|&p| (base + p as usize) as u32).collect();
            for (i, &p) in positions.iter().enumerate() {
                names[p as usize] = Some(observed(&q, i, &none));
            }
            let len = slots.len() as u32;
            let (extents, at) = if len == 1 { (Vec::new(), Affine::default()) } else { (vec![len], Affine::along(0, LoopVar(0), 1)) };
            let value = self.exprs.load(var, crate::ir::Flavour::Value, at);
            let step = slots.get(1).map_or(0, |s| i64::from(*s) - i64::from(slots[0]));
            let regular = slots.windows(2).all(|w| i64::from(w[1]) - i64::from(w[0]) == step);
            let offset =
                if len == 1 { Affine::constant(i64::from(slots[0])) } else { Affine::along(i64::from(slots[0]), LoopVar(0), step) };
            if regular {
                out.nests.push(Nest { extents, stores: vec![store(Memory::Out, offset, value)] });
            } else {
                // Two sets inside one cell: one loop a row keeps the positions affine.
                for (i, &slot) in slots.iter().enumerate() {
                    let value = self.exprs.load(var, crate::ir::Flavour::Value, Affine::constant(i as i64));
                    let s = store(Memory::Out, Affine::constant(i64::from(slot)), value);
                    match out.nests.first_mut().filter(|n| n.extents.is_empty()) {
                        Some(first) => first.stores.push(s),
                        None => out.nests.insert(0, Nest { extents: Vec::new(), stores: vec![s] }),
                    }
                }
            }
        }
        out.names.extend(names.into_iter().flatten());
    }

    /// For each state variable the positions of its elements in the order of the outside: scopes in the order of the text; inside a scope
    /// the arrays over one domain are taken together, cell after cell.
    pub(super) fn state_positions(&self) -> Vec<(VarId, Vec<u32>)> {
        let states = self.variables_of(Role::State);
        let mut positions: Vec<(VarId, Vec<u32>)> = states.iter().map(|&v| (v, vec![0_u32; self.vars[v].len as usize])).collect();
        let domain = |v: VarId| -> Option<(ScopeId, super::names::DomainId, usize, Vec<usize>)> {
            let symbol = *self.symbol_of.get(&v)?;
            let SymbolKind::Variable { axes, .. } = &self.names.symbols[symbol].kind else { return None };
            let at = axes.iter().position(|a| matches!(a, Axis::Domain(_)))?;
            let Axis::Domain(d) = axes[at] else { return None };
            let lens = axes.iter().map(|&a| self.names.axis_len(a) as usize).collect();
            Some((self.names.symbols[symbol].scope, d, at, lens))
        };
        let mut next = 0_u32;
        let mut i = 0;
        let mut done = vec![false; states.len()];
        while i < states.len() {
            if done[i] {
                i += 1;
                continue;
            }
            match domain(states[i]) {
                None => {
                    for p in &mut positions[i].1 {
                        *p = next;
                        next += 1;
                    }
                    done[i] = true;
                }
                Some((scope, d, _, _)) => {
                    let group: Vec<(usize, usize, Vec<usize>)> = (i..states.len())
                        .filter_map(|j| {
                            let (s, dj, at, lens) = domain(states[j])?;
                            (s == scope && dj == d && !done[j]).then_some((j, at, lens))
                        })
                        .collect();
                    let cells = group.first().map_or(0, |(_, at, lens)| lens[*at]);
                    for cell in 0..cells {
                        for (j, at, lens) in &group {
                            let inner: usize = lens[at + 1..].iter().product();
                            let outer: usize = lens[..*at].iter().product();
                            for o in 0..outer {
                                for k in 0..inner {
                                    let element = (o * lens[*at] + cell) * inner + k;
                                    positions[*j].1[element] = next;
                                    next += 1;
                                }
                            }
                        }
                    }
                    for (j, ..) in &group {
                        done[*j] = true;
                    }
                }
            }
            i += 1;
        }
        positions
    }

    /// Declared algebraic variables and `let`s with a unit.
    pub(super) fn output_program(&mut self) {
        let mut program = Program::default();
        let mut scalars = Vec::new();
        let mut at = 0_i64;
        let mut list = Vec::new();
        for symbol in self.in_text_order() {
            match self.names.symbols[symbol].kind.clone() {
                SymbolKind::Variable { var, axes, .. } if self.vars[var].role == Role::Algebraic && !self.port_variables.contains(&var) => {
                    let Some(q) = self.quantities.get(&var).cloned() else { continue };
                    let len = self.vars[var].len;
                    if !axes.iter().any(|&a| self.may_run(a)) {
                        // Element by element, so that each definition can be substituted.
                        for i in 0..i64::from(len) {
                            let value = self.exprs.load(var, crate::ir::Flavour::Value, Affine::constant(i));
                            scalars.push(store(Memory::Out, Affine::constant(at), value));
                            at += 1;
                        }
                        list.push(q);
                        continue;
                    }
                    let piece = if len == 1 { (Vec::new(), Affine::default()) } else { (vec![len], Affine::along(0, LoopVar(0), 1)) };
                    let value = self.exprs.load(var, crate::ir::Flavour::Value, piece.1);
                    let s = store(Memory::Out, Affine::constant(at).plus(piece.1), value);
                    if len == 1 {
                        scalars.push(s);
                    } else {
                        program.nests.push(Nest { extents: piece.0, stores: vec![s] });
                    }
                    at += i64::from(len);
                    list.push(q);
                }
                SymbolKind::Let { axes, unit: Some(unit), declaration, .. } if axes.iter().all(|a| matches!(a, Axis::Set(_))) => {
                    let path = self.names.symbols[symbol].path.clone();
                    let count = axes.iter().map(|&a| self.names.axis_len(a)).product::<i64>();
                    let place = self.place(self.names.symbols[symbol].scope, Site::Instant);
                    let binders = declaration.indices.clone();
                    let index: Vec<Expr> = binders
                        .iter()
                        .map(|b| Expr { span: b.span, kind: ExprKind::Name(Ident { text: b.name.text.clone(), span: b.span }) })
                        .collect();
                    let pieces = self.looped_nest(&binders, &place, &mut |s, inner| {
                        let value = s.symbol_value(symbol, &index, declaration.span, inner);
                        if value.is_poison() {
                            s.refuse();
                        }
                        (s.bound_address(&axes, &binders, inner), value.expr)
                    });
                    for Piece { extents, value: (element, value) } in pieces {
                        let value = self.exprs.number(value);
                        let store = store(Memory::Out, Affine::constant(at).plus(element), value);
                        if extents.is_empty() {
                            scalars.push(store);
                        } else {
                            program.nests.push(Nest { extents, stores: vec![store] });
                        }
                    }
                    at += count;
                    if count > 0 {
                        list.push(Quantity {
                            var: None,
                            name: path,
                            axes: self.model_axes(&axes),
                            pattern: declaration.pattern.clone(),
                            unit: unit.to_string(),
                            text: declaration.text.clone().unwrap_or_default(),
                            low: vec![f64::NEG_INFINITY],
                            high: vec![f64::INFINITY],
                            default: vec![f64::NAN],
                            scale: vec![1.0],
                            affine_unit: unit.is_point(),
                            structural: false,
                        });
                    }
                }
                _ => {}
            }
        }
        program.nests.insert(0, Nest { extents: Vec::new(), stores: scalars });
        self.model.programs.outputs = program;
        self.model.interface.algebraics = list;
    }

    /// Lists of quantities.
    pub(super) fn interface(&mut self) {
        let quantity = |s: &Self, v: VarId| s.quantities.get(&v).cloned();
        let in_order: Vec<VarId> = self
            .in_text_order()
            .into_iter()
            .filter_map(|s| match self.names.symbols[s].kind {
                SymbolKind::Variable { var, .. } => Some(var),
                _ => None,
            })
            .collect();
        let of = |s: &Self, role: Role| -> Vec<Quantity> {
            let list: Vec<VarId> = match role {
                Role::State => s.variables_of(Role::State),
                _ => in_order.iter().copied().filter(|&v| s.vars[v].role == role).collect(),
            };
            list.into_iter().filter_map(|v| quantity(s, v)).collect()
        };
        let lists = [Role::State, Role::Discrete, Role::Action, Role::Disturbance, Role::Param].map(|r| of(self, r));
        let [states, mut discretes, actions, disturbances, mut parameters] = lists;
        for quantity in &mut parameters {
            quantity.structural = quantity.var.is_some_and(|var| self.structural.contains(&var));
        }
        discretes.extend(self.schedule_quantities());
        self.model.interface.phases = self.schedule_phases();
        if states.is_empty() && !self.has_errors() {
            self.report(Diagnostic::error(codes::UNDERDETERMINED, "the model has no state", smpl_dsl::span::Span::default()).help(
                "declare one, `state x = 0`, with an equation `eq d/dt x = ...`; a model that is algebraic throughout (a flash) is \
                         stepped with `state idle = 0` and `eq d/dt idle = 0`",
            ));
        }
        let positions = self.state_positions();
        let mut order = Vec::new();
        let mut internal = 0_u32;
        for (_, list) in &positions {
            for &p in list {
                order.push((p, internal));
                internal += 1;
            }
        }
        order.sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, i)| i).collect();
        let identity = order.iter().enumerate().all(|(i, &o)| i as u32 == o);
        self.model.unknowns = self.variables_of(Role::State);
        self.model.interface.has_steady |= self.uses_steady;
        let interface = &mut self.model.interface;
        interface.states = states;
        interface.state_order = (!identity).then_some(order);
        interface.discretes = discretes;
        interface.actions = actions;
        interface.disturbances = disturbances;
        interface.parameters = parameters;
    }
}

fn observed(q: &Quantity, i: usize, a: &Attributes) -> Observed {
    let (low, high) = a.bounds.unwrap_or((Quantity::pick(&q.low, i), Quantity::pick(&q.high, i)));
    Observed { name: q.element_name(i), unit: q.unit.clone(), low, high, every: a.every, delay: a.delay, noise: a.noise }
}
