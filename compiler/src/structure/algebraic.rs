//! Explicit algebraic variables: which are substituted, which stay unknowns.

use smpl_dsl::span::Span;

use super::common::{passes, replace_everywhere};
use super::reads::looped_reads;
use super::totals::derived;
use super::whole::{Whole, placed, take_apart, wholes};
use crate::elaborate::{Equation, EquationForm};
use crate::graph::{Order, after_needs};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, Rewritten, Role, VarId};
use crate::model::Model;

/// An element of an algebraic variable; a part of a whole array under -1, -2 and so on.
pub(super) type Element = (VarId, i64);

/// Treatment of the algebraic variables.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    /// Elements whose definition is substituted, by equation.
    pub substituted: FastMap<Element, usize>,
    /// Arrays defined by loops that cover them, substituted as wholes.
    pub arrays: FastMap<VarId, Whole>,
    /// Every element (and part of an array) after those that its definition needs.
    pub order: Vec<Element>,
    /// The equations of both, for messages.
    pub spans: FastMap<Element, Span>,
}

/// An unknown that is used in at least this many rows may be worth keeping.
const MANY_USES: i64 = 64;

/// Decides what is substituted.
pub(crate) fn plan(model: &mut Model, equations: &mut [Equation]) -> Plan {
    let mut candidates: FastMap<Element, usize> = FastMap::default();
    for (i, equation) in equations.iter().enumerate() {
        if let EquationForm::Definition { var, at, .. } = equation.form
            && equation.extents.is_empty()
        {
            // A second definition of an element stays an equation; matching will find it one too
            // many.
            candidates.entry((var, at.offset)).or_insert(i);
        }
    }
    // Elements that some expression reads by a loop cannot be substituted one by one, nor parts of
    // arrays that one goes across.
    let mut arrays = wholes(model, equations);
    let mut in_loops: FastSet<VarId> = FastSet::default();
    for equation in equations.iter().filter(|e| !e.extents.is_empty()) {
        if let EquationForm::Definition { var, .. } = equation.form {
            in_loops.insert(var);
        }
    }
    for read in looped_reads(model, equations) {
        in_loops.insert(read.var);
        if arrays.get(&read.var).is_some_and(|whole| !whole.holds(read.at, &read.loops)) {
            arrays.remove(&read.var);
        }
    }
    candidates.retain(|(var, _), _| !in_loops.contains(var));
    let defined: FastSet<VarId> = candidates.keys().map(|e| e.0).collect();
    take_apart(model, &arrays, &defined);
    let definitions = Definitions { exprs: &model.exprs, vars: &model.vars, equations, candidates: &candidates, arrays: &arrays };
    let Order { order, closing } = after_needs(definitions.elements().into_iter(), |element| definitions.needs(element));
    // The element at which a loop of definitions closes is kept as an unknown.
    let mut kept: FastSet<Element> = closing.into_iter().map(|(_, needed)| needed).collect();
    keep_for_sparsity(model, equations, &candidates, &order, &mut kept);
    let of = |e: &Element, i: &usize| (*e, equations[*i].span);
    let parts = |(v, whole): (&VarId, &Whole)| whole.equations.iter().zip(1..).map(|(i, n)| of(&(*v, -n), i)).collect::<Vec<_>>();
    let spans = candidates.iter().map(|(e, i)| of(e, i)).chain(arrays.iter().flat_map(parts)).collect();
    let plan = Plan {
        order,
        spans,
        substituted: candidates.into_iter().filter(|(e, _)| !kept.contains(e)).collect(),
        arrays: arrays.into_iter().filter(|(v, whole)| (1..=whole.equations.len() as i64).all(|n| !kept.contains(&(*v, -n)))).collect(),
    };
    second_definitions(model, equations, &plan);
    plan
}

/// A second definition of what is substituted becomes an equation for something else.
fn second_definitions(model: &mut Model, equations: &mut [Equation], plan: &Plan) {
    for (i, equation) in equations.iter_mut().enumerate() {
        let EquationForm::Definition { var, at, value } = equation.form else { continue };
        let first = match plan.arrays.get(&var).map(|whole| (whole, whole.locate(at))) {
            Some((whole, Some((part, _)))) => Some(((var, -1 - part as i64), whole.equations[part])),
            Some((_, None)) => None,
            None => plan.substituted.get(&(var, at.offset)).map(|&first| ((var, at.offset), first)),
        };
        if let Some((element, _)) = first.filter(|&(_, first)| first != i) {
            let own = model.exprs.load(var, Flavour::Value, at);
            equation.form = EquationForm::Implicit { residual: model.exprs.sub(value, own) };
            equation.repeats = Some(element);
        }
    }
}

/// Variables that may be substituted.
struct Definitions<'m> {
    exprs: &'m Exprs,
    vars: &'m cranelift_entity::PrimaryMap<VarId, crate::model::Variable>,
    equations: &'m [Equation],
    candidates: &'m FastMap<Element, usize>,
    arrays: &'m FastMap<VarId, Whole>,
}

impl Definitions<'_> {
    /// All elements and parts of arrays, in the order of their variables.
    fn elements(&self) -> Vec<Element> {
        let mut elements: Vec<Element> = self.candidates.keys().copied().collect();
        elements.sort_unstable();
        let mut arrays: Vec<VarId> = self.arrays.keys().copied().collect();
        arrays.sort_unstable();
        elements.extend(arrays.iter().flat_map(|var| (0..self.arrays[var].equations.len() as i64).map(|part| (*var, -1 - part))));
        elements
    }

    fn needs(&self, element: Element) -> Vec<Element> {
        let equation = part_of(self.arrays, element).or_else(|| self.candidates.get(&element).copied());
        let Some(EquationForm::Definition { value, .. }) = equation.map(|i| self.equations[i].form) else { return Vec::new() };
        self.exprs
            .loads(value, |v, f| matches!(f, Flavour::Value | Flavour::Derivative) && self.vars[v].role == Role::Algebraic)
            .into_iter()
            .filter_map(|(v, _, at)| {
                if let Some(whole) = self.arrays.get(&v) {
                    return whole.locate(at).map(|(part, _)| (v, -1 - part as i64));
                }
                let e = (v, at.offset);
                (at.is_constant() && self.candidates.contains_key(&e)).then_some(e)
            })
            .collect()
    }
}

/// The equation of a part of an array.
fn part_of(arrays: &FastMap<VarId, Whole>, (var, part): Element) -> Option<usize> {
    let number = usize::try_from(-1 - part).ok()?;
    arrays.get(&var)?.equations.get(number).copied()
}

/// Keeps an element as an unknown if substitution would put (its dependencies) × (its uses) entries
/// into the Jacobian instead of their sum.
fn keep_for_sparsity(
    model: &Model,
    equations: &[Equation],
    candidates: &FastMap<Element, usize>,
    order: &[Element],
    kept: &mut FastSet<Element>,
) {
    let exprs = &model.exprs;
    let unknowns = |e: ExprId| exprs.loads(e, |v, f| f == Flavour::Value && matches!(model.vars[v].role, Role::State | Role::Algebraic));
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

/// Dependencies of definitions, by number.
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
pub(crate) fn substitute(model: &mut Model, equations: &mut Vec<Equation>, plan: &Plan) {
    let roles: Vec<Role> = model.vars.values().map(|v| v.role).collect();
    let role = |var: VarId| roles[var.as_u32() as usize];
    let mut expander = Expander::new(&plan.arrays, model.builtins());
    let algebraic = with_algebraic(&model.exprs, &role);
    // Nodes that are made on the way are not in the table.
    let concerned = |_: &Exprs, e: ExprId| algebraic.get(e.as_u32() as usize).copied().unwrap_or(true);
    // Each definition after those that it needs: what is written in it is final, and so is whatever
    // `done` holds.
    let mut done = Rewritten::default();
    for &element in &plan.order {
        let equation = part_of(&plan.arrays, element).or_else(|| plan.substituted.get(&element).copied());
        let Some(value) = equation.and_then(|i| definition(equations, i)) else { continue };
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
    let dropped: FastSet<usize> = plan.substituted.values().chain(plan.arrays.values().flat_map(|w| &w.equations)).copied().collect();
    let mut i = 0;
    equations.retain(|_| {
        i += 1;
        !dropped.contains(&(i - 1))
    });
}

/// For each node whether it contains an algebraic variable; operands precede their users.
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

/// Final values of substituted elements and parts of arrays.
struct Expander<'p> {
    arrays: &'p FastMap<VarId, Whole>,
    values: FastMap<Element, ExprId>,
    moved: FastMap<(VarId, Affine), ExprId>,
    flavoured: FastMap<Flavour, Rewritten>,
    builtins: Option<VarId>,
}

impl<'p> Expander<'p> {
    fn new(arrays: &'p FastMap<VarId, Whole>, builtins: Option<VarId>) -> Self {
        let (values, moved, flavoured) = <(FastMap<_, _>, FastMap<_, _>, FastMap<_, _>)>::default();
        Self { arrays, values, moved, flavoured, builtins }
    }

    fn element(&mut self, exprs: &mut Exprs, role: &dyn Fn(VarId) -> Role, var: VarId, flavour: Flavour, at: Affine) -> Option<ExprId> {
        let value = match self.values.get(&(var, at.offset)).filter(|_| at.is_constant()) {
            Some(&value) => value,
            None => match self.moved.get(&(var, at)) {
                Some(&value) => value,
                None => {
                    let (part, indices) = self.arrays.get(&var)?.locate(at)?;
                    let value = placed(exprs, *self.values.get(&(var, -1 - part as i64))?, &indices)?;
                    self.moved.insert((var, at), value);
                    value
                }
            },
        };
        match flavour {
            Flavour::Value => Some(value),
            Flavour::Derivative => derived(exprs, usize::from(at.depth()), value, &|var| Some(role(var))),
            _ => Some(self.in_flavour(exprs, role, value, flavour)),
        }
    }

    fn in_flavour(&mut self, exprs: &mut Exprs, role: &dyn Fn(VarId) -> Role, e: ExprId, flavour: Flavour) -> ExprId {
        let done = self.flavoured.entry(flavour).or_default();
        // What has no value at another instant was refused where the text says so.
        let at_frame = self.builtins.and_then(|builtins| exprs.in_frame(e, flavour, role, builtins, done).ok());
        at_frame.unwrap_or(e)
    }
}
