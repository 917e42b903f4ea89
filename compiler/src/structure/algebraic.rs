//! Explicit algebraic variables: which are substituted, which stay unknowns.

use smpl_dsl::span::Span;

use super::{loads, passes, replace_everywhere};
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, Rewritten, Role, VarId};
use crate::model::Model;

/// An element of an algebraic variable.
pub type Element = (VarId, i64);

/// What becomes of the algebraic variables.
#[derive(Debug, Default)]
pub struct Plan {
    /// Elements whose definition is substituted, by equation.
    pub substituted: FastMap<Element, usize>,
    /// Arrays defined by one loop that covers them, substituted as wholes.
    pub arrays: FastMap<VarId, usize>,
    /// Every element (and array, under -1) after those that its definition needs.
    pub order: Vec<Element>,
    /// The equations of both, for messages; whole arrays under -1.
    pub spans: FastMap<Element, Span>,
}

/// An unknown that is used in at least this many rows may be worth keeping.
const MANY_USES: i64 = 64;

/// Decides what is substituted.
pub fn plan(model: &mut Model, equations: &[Equation]) -> Plan {
    let mut candidates: FastMap<Element, usize> = FastMap::default();
    let mut arrays: FastMap<VarId, usize> = FastMap::default();
    let mut pieces: FastMap<VarId, usize> = FastMap::default();
    for (i, equation) in equations.iter().enumerate() {
        let EquationForm::Definition { var, at, .. } = equation.form else { continue };
        *pieces.entry(var).or_default() += 1;
        if equation.extents.is_empty() {
            // A second definition of an element stays an equation; matching will find it one too many.
            candidates.entry((var, at.offset)).or_insert(i);
        } else if equation.extents.len() == 1
            && equation.extents[0] == model.vars[var].len
            && at == Affine::along(0, crate::ir::LoopVar(0), 1)
        {
            arrays.entry(var).or_insert(i);
        }
    }
    // An array that is also defined element by element is left to matching.
    arrays.retain(|var, _| pieces.get(var) == Some(&1));
    candidates.retain(|(var, _), _| !arrays.contains_key(var));
    // Elements that some expression reads by a loop cannot be substituted one by one.
    let looped = looped_loads(model, equations);
    candidates.retain(|(var, _), _| !looped.contains(var));
    let mut walk = Walk {
        exprs: &model.exprs,
        vars: &model.vars,
        equations,
        candidates: &candidates,
        arrays: &arrays,
        state: FastMap::default(),
        kept: FastSet::default(),
        order: Vec::new(),
    };
    let mut elements: Vec<Element> = candidates.keys().copied().collect();
    elements.sort_unstable();
    for element in elements {
        walk.visit(element);
    }
    let mut array_list: Vec<VarId> = arrays.keys().copied().collect();
    array_list.sort_unstable();
    for var in array_list {
        walk.visit((var, -1));
    }
    let order = std::mem::take(&mut walk.order);
    let mut kept = std::mem::take(&mut walk.kept);
    keep_for_sparsity(model, equations, &candidates, &order, &mut kept);
    let of = |e: &Element, i: &usize| (*e, equations[*i].span);
    let spans = candidates.iter().map(|(e, i)| of(e, i)).chain(arrays.iter().map(|(v, i)| of(&(*v, -1), i))).collect();
    Plan {
        order,
        spans,
        substituted: candidates.into_iter().filter(|(e, _)| !kept.contains(e)).collect(),
        arrays: arrays.into_iter().filter(|(v, _)| !kept.contains(&(*v, -1))).collect(),
    }
}

fn looped_loads(model: &Model, equations: &[Equation]) -> FastSet<VarId> {
    let mut out = FastSet::default();
    let mut seen = FastSet::default();
    let mut stack: Vec<ExprId> = Vec::new();
    for equation in equations {
        match equation.form {
            EquationForm::Rate { value, .. } | EquationForm::Definition { value, .. } => stack.push(value),
            EquationForm::Implicit { residual } => stack.push(residual),
        }
    }
    let p = &model.programs;
    for program in [&p.start, &p.end, &p.finish, &p.outputs, &p.invariants, &p.boxes, &p.initial_discretes].into_iter().chain(&p.events) {
        stack.extend(program.nests.iter().flat_map(|n| n.stores.iter().map(|s| s.value)));
    }
    stack.extend(model.roots.iter().map(|r| r.value));
    stack.extend(&model.quadratures);
    while let Some(e) = stack.pop() {
        if !seen.insert(e) {
            continue;
        }
        if let Expr::Load { var, at, .. } = model.exprs.node(e)
            && !at.is_constant()
            && model.vars[var].role == Role::Algebraic
        {
            out.insert(var);
        }
        stack.extend(model.exprs.operands(e));
    }
    out
}

/// Finds loops of definitions: the element at which a loop closes is kept as an unknown.
struct Walk<'m> {
    exprs: &'m Exprs,
    vars: &'m cranelift_entity::PrimaryMap<VarId, crate::model::Variable>,
    equations: &'m [Equation],
    candidates: &'m FastMap<Element, usize>,
    arrays: &'m FastMap<VarId, usize>,
    state: FastMap<Element, bool>,
    kept: FastSet<Element>,
    order: Vec<Element>,
}

impl Walk<'_> {
    /// Depth-first with an explicit stack: chains of connections may be long.
    fn visit(&mut self, start: Element) {
        let mut stack = vec![(start, false)];
        while let Some((element, leaving)) = stack.pop() {
            if leaving {
                self.state.insert(element, true);
                self.order.push(element);
                continue;
            }
            match self.state.get(&element) {
                Some(true) => continue,
                Some(false) => {
                    self.kept.insert(element);
                    continue;
                }
                None => {}
            }
            self.state.insert(element, false);
            stack.push((element, true));
            for next in self.needs(element) {
                match self.state.get(&next) {
                    Some(false) => {
                        self.kept.insert(next);
                    }
                    Some(true) => {}
                    None => stack.push((next, false)),
                }
            }
        }
    }

    fn needs(&self, element: Element) -> Vec<Element> {
        let equation = if element.1 < 0 { self.arrays.get(&element.0) } else { self.candidates.get(&element) };
        let Some(EquationForm::Definition { value, .. }) = equation.map(|&i| self.equations[i].form) else { return Vec::new() };
        loads(self.exprs, value, |v, f| f == Flavour::Value && self.vars[v].role == Role::Algebraic)
            .into_iter()
            .filter_map(|(v, _, at)| {
                if self.arrays.contains_key(&v) {
                    return Some((v, -1));
                }
                let e = (v, at.offset);
                (at.is_constant() && self.candidates.contains_key(&e)).then_some(e)
            })
            .collect()
    }
}

/// Keeps an element as an unknown where substitution would put (what it depends on) × (where it is used) entries into the Jacobian
/// in place of their sum.
fn keep_for_sparsity(
    model: &Model,
    equations: &[Equation],
    candidates: &FastMap<Element, usize>,
    order: &[Element],
    kept: &mut FastSet<Element>,
) {
    let exprs = &model.exprs;
    let unknowns = |e: ExprId| loads(exprs, e, |v, f| f == Flavour::Value && matches!(model.vars[v].role, Role::State | Role::Algebraic));
    let needs: FastMap<Element, Vec<(VarId, Flavour, Affine)>> = candidates
        .iter()
        .filter_map(|(&element, &i)| match equations[i].form {
            EquationForm::Definition { value, .. } => Some((element, unknowns(value))),
            _ => None,
        })
        .collect();
    let mut inputs = Inputs::new(model, &needs);
    let uses = inputs.uses(equations, kept, &unknowns);
    for &element in order.iter().filter(|e| needs.contains_key(e)) {
        let fan_out = inputs.known(element).map_or(0, |number| uses[number]);
        if fan_out >= MANY_USES {
            let fan_in = inputs.of(element);
            if fan_in >= 2 && fan_in * fan_out > 2 * (fan_in + fan_out) {
                kept.insert(element);
            }
        }
        if !kept.contains(&element) {
            inputs.substitute(element);
        }
    }
}

/// What definitions depend on, by number.
struct Inputs {
    numbers: FastMap<(VarId, Affine), usize>,
    /// Elements that each input stands for: a load inside a reduction for all that the loop passes.
    elements: Vec<i64>,
    /// Inputs of each definition.
    needs: Vec<Vec<usize>>,
    substituted: Vec<bool>,
}

impl Inputs {
    fn new(model: &Model, needs: &FastMap<Element, Vec<(VarId, Flavour, Affine)>>) -> Inputs {
        let mut inputs = Inputs { numbers: FastMap::default(), elements: vec![], needs: vec![], substituted: vec![] };
        for (&(var, offset), own) in needs {
            let definition = inputs.number(model, var, Affine::constant(offset));
            let own = own.iter().map(|&(v, _, at)| inputs.number(model, v, at)).collect();
            inputs.needs[definition] = own;
        }
        inputs
    }

    fn number(&mut self, model: &Model, var: VarId, at: Affine) -> usize {
        let next = self.elements.len();
        let number = *self.numbers.entry((var, at)).or_insert(next);
        if number == next {
            self.elements.push(if at.is_constant() { 1 } else { i64::from(model.vars[var].len) });
            self.needs.push(vec![]);
            self.substituted.push(false);
        }
        number
    }

    fn known(&self, (var, offset): Element) -> Option<usize> {
        self.numbers.get(&(var, Affine::constant(offset))).copied()
    }

    fn substitute(&mut self, element: Element) {
        if let Some(number) = self.known(element) {
            self.substituted[number] = true;
        }
    }

    /// In how many rows each input is used, directly or through what is substituted.
    fn uses(
        &self,
        equations: &[Equation],
        kept: &FastSet<Element>,
        unknowns: &dyn Fn(ExprId) -> Vec<(VarId, Flavour, Affine)>,
    ) -> Vec<i64> {
        let mut uses = vec![0; self.elements.len()];
        let mut is_kept = vec![false; self.elements.len()];
        kept.iter().filter_map(|&e| self.known(e)).for_each(|number| is_kept[number] = true);
        // The last row that was found to use an input.
        let mut used_by = vec![usize::MAX; self.elements.len()];
        let mut stack = vec![];
        for (row, equation) in equations.iter().enumerate() {
            let root = match equation.form {
                EquationForm::Rate { value, .. } => value,
                EquationForm::Implicit { residual } => residual,
                EquationForm::Definition { .. } => continue,
            };
            stack.extend(unknowns(root).iter().filter_map(|&(v, _, at)| self.numbers.get(&(v, at)).copied()));
            while let Some(input) = stack.pop() {
                if std::mem::replace(&mut used_by[input], row) == row {
                    continue;
                }
                uses[input] += passes(&equation.extents);
                if !is_kept[input] {
                    stack.extend(&self.needs[input]);
                }
            }
        }
        uses
    }

    /// On how many elements a definition depends, directly or through what is substituted.
    fn of(&self, element: Element) -> i64 {
        let mut seen = vec![false; self.elements.len()];
        let mut stack: Vec<usize> = self.known(element).into_iter().collect();
        let mut count = 0;
        while let Some(definition) = stack.pop() {
            for &input in &self.needs[definition] {
                if std::mem::replace(&mut seen[input], true) {
                    continue;
                }
                if self.substituted[input] {
                    stack.push(input);
                } else {
                    count += self.elements[input];
                }
            }
        }
        count
    }
}

/// Substitutes everywhere and drops the definitions that were substituted.
pub fn substitute(model: &mut Model, equations: &mut Vec<Equation>, plan: &Plan) {
    let roles: Vec<Role> = model.vars.values().map(|v| v.role).collect();
    let role = |var: VarId| roles[var.as_u32() as usize];
    let mut expander = Expander::default();
    let algebraic = with_algebraic(&model.exprs, &role);
    // Nodes that are made on the way are not in the table.
    let concerned = |_: &Exprs, e: ExprId| algebraic.get(e.as_u32() as usize).copied().unwrap_or(true);
    // Each definition after those that it needs: what is written in it is final, and so is whatever `done` holds.
    let mut done = Rewritten::default();
    for &element in &plan.order {
        let equation = if element.1 < 0 { plan.arrays.get(&element.0) } else { plan.substituted.get(&element) };
        let Some(value) = equation.and_then(|&i| definition(equations, i)) else { continue };
        let value = model.exprs.rewrite_where(value, &mut done, &concerned, &mut |exprs, node| match node {
            Expr::Load { var, flavour, at } if role(var) == Role::Algebraic => expander.element(exprs, &role, var, flavour, at),
            _ => None,
        });
        expander.values.insert(element, value);
    }
    replace_everywhere(model, equations, &mut done, &concerned, &mut |exprs, node| match node {
        Expr::Load { var, flavour, at } if role(var) == Role::Algebraic => expander.element(exprs, &role, var, flavour, at),
        _ => None,
    });
    let dropped: FastSet<usize> = plan.substituted.values().chain(plan.arrays.values()).copied().collect();
    let mut i = 0;
    equations.retain(|_| {
        i += 1;
        !dropped.contains(&(i - 1))
    });
}

/// For each node whether it contains an algebraic variable; operands stand before their users.
fn with_algebraic(exprs: &Exprs, role: &dyn Fn(VarId) -> Role) -> Vec<bool> {
    let mut out: Vec<bool> = Vec::with_capacity(exprs.len());
    for e in (0..exprs.len() as u32).map(ExprId::from_u32) {
        let own = matches!(exprs.node(e), Expr::Load { var, .. } if role(var) == Role::Algebraic);
        out.push(own || exprs.operands(e).any(|o| out[o.as_u32() as usize]));
    }
    out
}

fn definition(equations: &[Equation], i: usize) -> Option<ExprId> {
    match equations.get(i)?.form {
        EquationForm::Definition { value, .. } => Some(value),
        _ => None,
    }
}

/// Final values of substituted elements; whole arrays under -1.
#[derive(Default)]
struct Expander {
    values: FastMap<Element, ExprId>,
    moved: FastMap<(VarId, Affine), ExprId>,
    flavoured: FastMap<Flavour, Rewritten>,
}

impl Expander {
    fn element(&mut self, exprs: &mut Exprs, role: &dyn Fn(VarId) -> Role, var: VarId, flavour: Flavour, at: Affine) -> Option<ExprId> {
        let value = match self.values.get(&(var, at.offset)).filter(|_| at.is_constant()) {
            Some(&value) => value,
            None => {
                let &whole = self.values.get(&(var, -1))?;
                *self.moved.entry((var, at)).or_insert_with(|| at_address(exprs, whole, at))
            }
        };
        Some(if flavour == Flavour::Value { value } else { self.in_flavour(exprs, role, value, flavour) })
    }

    fn in_flavour(&mut self, exprs: &mut Exprs, role: &dyn Fn(VarId) -> Role, e: ExprId, flavour: Flavour) -> ExprId {
        let done = self.flavoured.entry(flavour).or_default();
        exprs.rewrite(e, done, &mut |exprs, node| match node {
            Expr::Load { var, flavour: Flavour::Value, at } => {
                let has_frames = matches!(role(var), Role::State | Role::Algebraic | Role::Action | Role::Discrete | Role::Disturbance);
                has_frames.then(|| exprs.load(var, flavour, at))
            }
            _ => None,
        })
    }
}

/// A definition over `l0` at the address `at`: the counter becomes the address itself.
fn at_address(exprs: &mut Exprs, value: ExprId, at: Affine) -> ExprId {
    exprs.rewrite(value, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
        Expr::Counter(v) if v.0 == 0 => Some(number(exprs, at)),
        Expr::Load { var, flavour, at: own } if own.strides[0] != 0 => {
            let mut rest = own;
            rest.strides[0] = 0;
            Some(exprs.load(var, flavour, rest.plus(at.times(own.strides[0]))))
        }
        _ => None,
    })
}

/// An address as a number.
fn number(exprs: &mut Exprs, at: Affine) -> ExprId {
    let mut e = exprs.constant(at.offset as f64);
    for (d, &stride) in at.strides.iter().enumerate() {
        if stride != 0 {
            let (counter, factor) = (exprs.counter(crate::ir::LoopVar(d as u8)), exprs.constant(stride as f64));
            let term = exprs.mul(counter, factor);
            e = exprs.add(e, term);
        }
    }
    e
}
