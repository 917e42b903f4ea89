//! Matching of equations to unknowns, and the rows that result.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;

use super::algebraic::{Element, Plan};
use super::common::{passes, replace_everywhere};
use super::faults::{self, Findings, LeftOver};
use super::rates::Rates;
use super::reduce::{self, Reduced};
use crate::elaborate::{Equation, EquationForm, for_each_element};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, Rewritten, Role, VarId};
use crate::model::{AlgebraicCounts, Model, Quantity, Row, Variable};

/// Most unknowns without an equation for which others that may lack it instead are looked for.
const MOST_SOUGHT: usize = 20;

/// Largest number of iterations of an implicit equation that is unrolled for matching.
const WRITTEN_OUT: i64 = 20_000;

/// Rows for all unknowns; solved algebraic variables are appended to the unknowns. `written` are
/// the equations before substitutions, for messages. The index is reduced if equations bind states.
///
/// # Errors
/// Unknowns without an equation, equations without an unknown.
pub(crate) fn rows(
    model: &mut Model,
    equations: Vec<Equation>,
    written: &[Equation],
    plan: &Plan,
    rates: &Rates,
) -> Result<Vec<Row>, Faults> {
    let unknown = |var: VarId| !plan.arrays.contains_key(&var);
    let needed = reduce::is_needed(model, &equations, &unknown);
    let direct = (!needed).then(|| matched_rows(model, equations.clone(), written, plan, rates));
    if let Some(Ok(rows)) = direct {
        return Ok(complete(model, rows, &[]));
    }
    let refused = match reduce::reduce(model, &equations, plan) {
        Ok(Reduced { model: reduced, rows, helpers }) => {
            *model = reduced;
            return Ok(complete(model, rows, &helpers));
        }
        Err(refused) => refused,
    };
    if let Some(fault) = refused.or_else(|| reduce::left_rates(model, &equations)) {
        let mut faults = Faults::default();
        faults.push(fault);
        return Err(faults);
    }
    let direct = direct.unwrap_or_else(|| matched_rows(model, equations, written, plan, rates));
    direct.map(|rows| complete(model, rows, &[]))
}

/// Rows for all unknowns by matching each equation.
fn matched_rows(model: &mut Model, equations: Vec<Equation>, written: &[Equation], plan: &Plan, rates: &Rates) -> Result<Vec<Row>, Faults> {
    let mut rows = Vec::new();
    let mut definitions = Vec::new();
    let mut implicit = Vec::new();
    for equation in equations {
        match equation.form {
            EquationForm::Rate { var, at, value } => {
                let own = model.exprs.load(var, Flavour::Derivative, at);
                let residual = model.exprs.sub(value, own);
                rows.push(Row { extents: equation.extents, var, at, residual, span: equation.span });
            }
            EquationForm::Definition { var, at, value } => {
                let own = model.exprs.load(var, Flavour::Value, at);
                let residual = model.exprs.sub(value, own);
                definitions.push(Row { extents: equation.extents, var, at, residual, span: equation.span });
            }
            EquationForm::Implicit { residual } => implicit.push((equation.extents, residual, equation.span, equation.repeats)),
        }
    }
    let mut unknown = unknown_elements(model, plan, rates);
    let mut determined: FastMap<Element, Span> = plan.spans.clone();
    let mut matched: Vec<Row> = Vec::new();
    // A definition that is kept determines its own variable; with one more for the same element
    // either may determine another one.
    for row in definitions {
        let mut fits = true;
        for_each_element(&row.extents, row.at, &mut |i| fits &= unknown.contains(&(row.var, i)));
        if fits {
            for_each_element(&row.extents, row.at, &mut |i| {
                unknown.remove(&(row.var, i));
                determined.insert((row.var, i), row.span);
            });
            matched.push(row);
        } else {
            let part = plan.arrays.get(&row.var).and_then(|whole| whole.locate(row.at));
            let own = (row.var, part.map_or(row.at.offset, |(part, _)| -1 - part as i64));
            if let Some(first) = matched.iter().position(|m| m.var == row.var && m.at == row.at && m.extents.is_empty()) {
                let first = matched.swap_remove(first);
                unknown.insert((first.var, first.at.offset));
                implicit.push((first.extents, first.residual, first.span, None));
            }
            implicit.push((row.extents, row.residual, row.span, Some(own)));
        }
    }
    let mut problem = Matching { equations: written, determined, ..Matching::default() };
    for (extents, residual, span, own) in implicit {
        problem.equation(model, extents, residual, span, own);
    }
    problem.solve(model, &unknown, &mut matched)?;
    rows.extend(matched);
    Ok(rows)
}

/// Elements that need an equation: algebraic ones that are not substituted, states without an
/// explicit rate.
fn unknown_elements(model: &Model, plan: &Plan, rates: &Rates) -> BTreeSet<Element> {
    let mut out = BTreeSet::new();
    for (var, v) in model.vars.iter() {
        match v.role {
            Role::Algebraic if !plan.arrays.contains_key(&var) => {
                out.extend((0..i64::from(v.len)).map(|i| (var, i)).filter(|e| !plan.substituted.contains_key(e)));
            }
            Role::State => {
                let covered = rates.covered.get(&var);
                out.extend((0..i64::from(v.len)).filter(|&i| !covered.is_some_and(|c| c[i as usize])).map(|i| (var, i)));
            }
            _ => {}
        }
    }
    out
}

/// Bipartite matching of implicit equations, unrolled, to unknowns.
#[derive(Default)]
struct Matching<'m> {
    /// The equations of the text.
    equations: &'m [Equation],
    residuals: Vec<ExprId>,
    spans: Vec<Span>,
    /// Unknown for which an equation `v = ...` is written, if another one determines `v`.
    written_for: Vec<Option<Element>>,
    /// The equations that determine elements.
    determined: FastMap<Element, Span>,
    candidates: Vec<Vec<Element>>,
    too_large: Vec<Span>,
}

impl Matching<'_> {
    fn equation(&mut self, model: &mut Model, extents: Vec<u32>, residual: ExprId, span: Span, own: Option<Element>) {
        if passes(&extents) > WRITTEN_OUT {
            self.too_large.push(span);
            return;
        }
        let mut counters = vec![0_i64; extents.len()];
        loop {
            let mut e = residual;
            for (d, &pass) in counters.iter().enumerate() {
                e = model.exprs.shift(e, LoopVar(d as u8), pass);
            }
            self.candidates.push(incidence(model, e));
            self.residuals.push(e);
            self.spans.push(span);
            self.written_for.push(own);
            // Next pass, the innermost counter first.
            let mut d = extents.len();
            loop {
                if d == 0 {
                    return;
                }
                d -= 1;
                counters[d] += 1;
                if counters[d] < i64::from(extents[d]) {
                    break;
                }
                counters[d] = 0;
            }
        }
    }

    fn solve(&self, model: &mut Model, unknown: &BTreeSet<Element>, out: &mut Vec<Row>) -> Result<(), Faults> {
        let mut pairs = Pairs { owner: FastMap::default(), own: vec![None; self.residuals.len()], closed: FastMap::default() };
        let unmatched: Vec<_> = (0..self.residuals.len()).filter_map(|e| Some((e, self.augment(e, unknown, &mut pairs)?))).collect();
        let owner = pairs.owner;
        let missing: Vec<Element> = unknown.iter().filter(|e| !owner.contains_key(*e)).copied().collect();
        let mut refused = Faults::default();
        for &span in &self.too_large {
            let fault = Diagnostic::error(codes::TOO_LARGE, "an implicit equation over very many cells", span);
            refused.push(fault.help("give each variable its own equation: `eq v[z] = ...`"));
        }
        if !(unmatched.is_empty() && missing.is_empty()) {
            refused.append(faults::faults(model, &self.findings(unmatched, missing, unknown, &owner)));
        }
        if !refused.is_empty() {
            return Err(refused);
        }
        for (element, equation) in owner {
            out.push(Row {
                extents: Vec::new(),
                var: element.0,
                at: Affine::constant(element.1),
                residual: self.residuals[equation],
                span: self.spans[equation],
            });
        }
        Ok(())
    }

    /// Unmatched equations and unknowns.
    fn findings(
        &self,
        unmatched: Vec<(usize, Rc<[Element]>)>,
        missing: Vec<Element>,
        unknown: &BTreeSet<Element>,
        owner: &FastMap<Element, usize>,
    ) -> Findings<'_> {
        let left = unmatched.into_iter().map(|(at, reach)| LeftOver {
            span: self.spans[at],
            residual: self.residuals[at],
            written_for: self.written_for[at].and_then(|own| Some((own, *self.determined.get(&own)?))),
            reach,
        });
        let left = left.collect();
        let owners = owner.iter().map(|(&element, &equation)| (element, self.spans[equation])).collect();
        let instead = if missing.len() <= MOST_SOUGHT { self.alternatives(&missing, unknown, owner) } else { FastMap::default() };
        Findings { equations: self.equations, left, missing, instead, owners }
    }

    /// For each unknown without an equation the ones that could be without it instead: those on
    /// alternating paths from it.
    fn alternatives(
        &self,
        missing: &[Element],
        unknown: &BTreeSet<Element>,
        owner: &FastMap<Element, usize>,
    ) -> FastMap<Element, Vec<Element>> {
        let mut own: Vec<Option<Element>> = vec![None; self.residuals.len()];
        owner.iter().for_each(|(&element, &equation)| own[equation] = Some(element));
        let mut containing: FastMap<Element, Vec<usize>> = FastMap::default();
        for (at, list) in self.candidates.iter().enumerate() {
            list.iter().filter(|e| unknown.contains(*e)).for_each(|e| containing.entry(*e).or_default().push(at));
        }
        let mut out = FastMap::default();
        for &start in missing {
            let mut seen = BTreeSet::from([start]);
            let mut stack = vec![start];
            while let Some(element) = stack.pop() {
                for &equation in containing.get(&element).into_iter().flatten() {
                    stack.extend(own[equation].filter(|&next| seen.insert(next)));
                }
            }
            seen.remove(&start);
            out.insert(start, seen.into_iter().collect());
        }
        out
    }

    /// An augmenting path from an equation; without one, the unknowns that it can reach. Iterative,
    /// since paths may be long.
    fn augment(&self, start: usize, unknown: &BTreeSet<Element>, pairs: &mut Pairs) -> Option<Rc<[Element]>> {
        let mut from: FastMap<Element, usize> = FastMap::default();
        let mut reached: Option<Rc<[Element]>> = None;
        let mut queue = vec![start];
        while let Some(equation) = queue.pop() {
            for &element in self.candidates[equation].iter().filter(|e| unknown.contains(*e)) {
                // No path leads on from what an earlier equation reached in vain.
                if let Some(closed) = pairs.closed.get(&element) {
                    reached.get_or_insert_with(|| Rc::clone(closed));
                    continue;
                }
                if from.contains_key(&element) {
                    continue;
                }
                from.insert(element, equation);
                if let Some(&next) = pairs.owner.get(&element) {
                    queue.push(next);
                    continue;
                }
                pairs.turn(element, start, &from);
                return None;
            }
        }
        if from.is_empty() {
            return Some(reached.unwrap_or_default());
        }
        let mut all: Vec<Element> = from.keys().chain(reached.iter().flat_map(|r| r.iter())).copied().collect();
        all.sort_unstable();
        let all: Rc<[Element]> = all.into();
        pairs.closed.extend(from.into_keys().map(|element| (element, Rc::clone(&all))));
        Some(all)
    }
}

/// Unknowns and equations that belong together so far.
struct Pairs {
    owner: FastMap<Element, usize>,
    /// The unknown of each equation.
    own: Vec<Option<Element>>,
    /// Unknowns from which no path leads to a free one, with all that are reached together with
    /// them.
    closed: FastMap<Element, Rc<[Element]>>,
}

impl Pairs {
    /// Turns a path round that ends in a free unknown.
    fn turn(&mut self, free: Element, start: usize, from: &FastMap<Element, usize>) {
        let mut at = free;
        loop {
            let equation = from[&at];
            let before = self.own[equation].replace(at);
            self.owner.insert(at, equation);
            match before.filter(|_| equation != start) {
                Some(element) => at = element,
                None => return,
            }
        }
    }
}

/// Unknowns that an equation could determine: algebraic values and derivatives.
fn incidence(model: &Model, e: ExprId) -> Vec<Element> {
    model
        .exprs
        .loads(e, |v, f| match f {
            Flavour::Value => model.vars[v].role == Role::Algebraic,
            Flavour::Derivative => model.vars[v].role == Role::State,
            _ => false,
        })
        .into_iter()
        .filter(|l| l.2.is_constant())
        .map(|(v, _, at)| (v, at.offset))
        .collect()
}

/// Adds the solved algebraic variables to the unknowns. Single elements of arrays become separate
/// variables. `helpers` are quantities of unknowns that are not outputs.
fn complete(model: &mut Model, mut rows: Vec<Row>, helpers: &[Quantity]) -> Vec<Row> {
    // How much of each algebraic variable is solved for, and where.
    let mut parts: BTreeMap<VarId, (i64, Vec<i64>)> = BTreeMap::new();
    for row in rows.iter().filter(|row| model.vars[row.var].role == Role::Algebraic) {
        let (count, offsets) = parts.entry(row.var).or_default();
        *count += passes(&row.extents);
        offsets.push(row.at.offset);
    }
    let known = model.interface.quantities.algebraics.iter().chain(helpers);
    let quantities: FastMap<VarId, Quantity> = known.filter_map(|q| Some((q.var?, q.clone()))).collect();
    let mut renamed: FastMap<Element, VarId> = FastMap::default();
    let declared: u32 = model.interface.quantities.algebraics.iter().map(|q| q.len() as u32).sum();
    let declared_vars: FastSet<VarId> = model.interface.quantities.algebraics.iter().filter_map(|q| q.var).collect();
    let (mut solved, mut solved_declared) = (0, 0);
    for (var, (count, mut offsets)) in parts {
        solved += count as u32;
        let Some(quantity) = quantities.get(&var).cloned() else { continue };
        solved_declared += if declared_vars.contains(&var) { count as u32 } else { 0 };
        if count == i64::from(model.vars[var].len) {
            model.unknowns.push(var);
            model.interface.quantities.solved.push(quantity);
            continue;
        }
        offsets.sort_unstable();
        renamed.extend(offsets.into_iter().map(|i| ((var, i), element_as_unknown(model, var, i, &quantity))));
    }
    let parts = model.interface.reduction.demoted.iter().filter(|demoted| !demoted.whole);
    solved_declared += parts.map(|demoted| demoted.elements.len() as u32).sum::<u32>();
    model.interface.quantities.algebraic_counts =
        AlgebraicCounts { declared, solved, substituted: declared.saturating_sub(solved_declared) };
    if !renamed.is_empty() {
        rename_elements(model, &mut rows, &renamed);
    }
    // Rows in the order of the unknowns.
    let position: FastMap<VarId, usize> = model.unknowns.iter().enumerate().map(|(i, &v)| (v, i)).collect();
    rows.sort_by_key(|r| (position.get(&r.var).copied().unwrap_or(usize::MAX), r.at.offset));
    rows
}

/// A new unknown for one element of an algebraic array.
fn element_as_unknown(model: &mut Model, var: VarId, i: i64, of: &Quantity) -> VarId {
    let at = i.max(0) as usize;
    let name = of.element_name(at);
    let span = model.vars[var].span;
    let new = model.vars.push(Variable { name: name.clone(), role: Role::Algebraic, len: 1, span });
    model.unknowns.push(new);
    let pick = |list: &[f64]| vec![Quantity::pick(list, at)];
    let (low, high, default, scale) = (pick(&of.low), pick(&of.high), pick(&of.default), pick(&of.scale));
    let one = Quantity { var: Some(new), name, axes: Vec::new(), pattern: None, low, high, default, scale, ..of.clone() };
    model.interface.quantities.solved.push(one);
    new
}

/// Puts the new variables in the place of the elements that they stand for.
fn rename_elements(model: &mut Model, rows: &mut [Row], renamed: &FastMap<Element, VarId>) {
    let mut done = Rewritten::default();
    let mut replace = |exprs: &mut Exprs, node: Expr| match node {
        Expr::Load { var, flavour, at } if at.is_constant() => {
            renamed.get(&(var, at.offset)).map(|&new| exprs.load(new, flavour, Affine::default()))
        }
        _ => None,
    };
    replace_everywhere(model, &mut [], &mut done, &|_, _| true, &mut replace);
    for row in rows {
        row.residual = model.exprs.rewrite(row.residual, &mut done, &mut replace);
        if let Some(&new) = renamed.get(&(row.var, row.at.offset)) {
            row.var = new;
            row.at = Affine::default();
        }
    }
}
