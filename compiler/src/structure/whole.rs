//! Arrays that loops define as wholes.

use super::common::{passes, programs_mut};
use crate::elaborate::{Equation, EquationForm};
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, FastSet, LoopVar, Loops, MAX_DEPTH, Nest, Store, Target, VarId, loops_of};
use crate::model::Model;

/// An algebraic variable whose elements are defined by loops over equal parts of it: one loop nest
/// a part.
#[derive(Clone, Debug)]
pub(crate) struct Whole {
    /// The equation of each part.
    pub equations: Vec<usize>,
    /// Extents of the loops of a part.
    extents: Vec<u32>,
    /// Parts lie side by side (`c[i in trays, j in species]`, a part for each species), not one
    /// after another.
    interleaved: bool,
}

/// The variables that loops define as wholes.
pub(crate) fn wholes(model: &Model, equations: &[Equation]) -> FastMap<VarId, Whole> {
    let mut pieces: FastMap<VarId, Vec<usize>> = FastMap::default();
    for (i, equation) in equations.iter().enumerate() {
        if let EquationForm::Definition { var, .. } = equation.form {
            pieces.entry(var).or_default().push(i);
        }
    }
    let mut out: FastMap<VarId, Whole> = FastMap::default();
    for (var, list) in pieces {
        out.extend(Whole::of(i64::from(model.vars[var].len), &list, equations).map(|whole| (var, whole)));
    }
    out
}

impl Whole {
    pub(super) fn of(len: i64, pieces: &[usize], equations: &[Equation]) -> Option<Whole> {
        let extents = &equations[*pieces.first()?].extents;
        let size = passes(extents);
        if extents.is_empty() || size * pieces.len() as i64 != len {
            return None;
        }
        let count = pieces.len() as i64;
        let mut parts = vec![None; pieces.len()];
        let in_rows = row_major(extents);
        let side_by_side = Affine::along(0, LoopVar(0), count);
        let mut interleaved = None;
        for &i in pieces {
            let EquationForm::Definition { at, .. } = equations[i].form else { return None };
            let start = Affine::constant(at.offset);
            let is_interleaved = !(at == in_rows.plus(start) && at.offset % size == 0);
            if equations[i].extents != *extents
                || *interleaved.get_or_insert(is_interleaved) != is_interleaved
                || (is_interleaved && !(extents.len() == 1 && at == side_by_side.plus(start)))
            {
                return None;
            }
            let part = if is_interleaved { at.offset } else { at.offset / size };
            let slot = parts.get_mut(usize::try_from(part).ok()?)?;
            // A second definition of a part stays an equation; matching will find it one too many.
            if slot.replace(i).is_some() {
                return None;
            }
        }
        let equations: Option<Vec<usize>> = parts.into_iter().collect();
        Some(Whole { equations: equations?, extents: extents.clone(), interleaved: interleaved? })
    }

    /// The part in which the element of the first pass lies, and its index along each of its loops;
    /// `None` if others lie elsewhere whatever the extents of loops are. Elements of further passes
    /// [may](Self::holds) lie in other parts.
    pub(crate) fn locate(&self, at: Affine) -> Option<(usize, Vec<Affine>)> {
        let count = self.equations.len() as i64;
        let mut indices;
        let part;
        if self.interleaved {
            part = at.offset.rem_euclid(count);
            if at.strides.iter().any(|s| s % count != 0) {
                return None;
            }
            indices = vec![Affine { offset: at.offset.div_euclid(count), strides: at.strides.map(|s| s / count) }];
        } else {
            indices = self.indices(at);
            part = indices[0].offset.div_euclid(self.rows());
            indices[0].offset -= part * self.rows();
            if count > 1 && indices[0].strides.iter().any(|s| s.abs() >= self.rows()) {
                return None;
            }
        }
        (0..count).contains(&part).then_some((part as usize, indices))
    }

    /// Returns `true` if the elements of all passes lie in one part.
    pub(crate) fn holds(&self, at: Affine, loops: &Loops) -> bool {
        let inside = |(index, &n): (&Affine, &u32)| {
            let (low, high) = index.reach(loops);
            low >= 0 && high < i64::from(n)
        };
        self.locate(at).is_some_and(|(_, indices)| indices.iter().zip(&self.extents).all(inside))
    }

    /// Passes of the loop at `depth` before which it goes over to another part, where no other loop
    /// moves it between parts.
    pub(crate) fn turns(&self, at: Affine, depth: usize, extent: u32) -> Vec<i64> {
        if !self.is_in_parts() {
            return Vec::new();
        }
        let row = self.indices(at)[0];
        let step = row.strides[depth];
        if row.counters() != 1 << depth {
            return Vec::new();
        }
        let turn = |part: i64| {
            let ahead = part * self.rows() - row.offset;
            if step > 0 { (ahead + step - 1).div_euclid(step) } else { (-ahead).div_euclid(-step) + 1 }
        };
        let mut turns: Vec<i64> = (1..self.equations.len() as i64).map(turn).filter(|t| (1..i64::from(extent)).contains(t)).collect();
        turns.sort_unstable();
        turns.dedup();
        turns
    }

    /// Returns `true` if it has several parts, one after another.
    pub(crate) fn is_in_parts(&self) -> bool {
        !self.interleaved && self.equations.len() > 1
    }

    /// Length of a part along its outermost loop.
    fn rows(&self) -> i64 {
        i64::from(self.extents[0])
    }

    /// The index along each loop of parts that lie one after another, counted through all of them.
    fn indices(&self, at: Affine) -> Vec<Affine> {
        let mut indices = vec![Affine::default(); self.extents.len()];
        let mut rest = at;
        for (index, &extent) in indices.iter_mut().zip(&self.extents).skip(1).rev() {
            let n = i64::from(extent);
            index.offset = rest.offset.rem_euclid(n);
            rest.offset = rest.offset.div_euclid(n);
            for (own, stride) in index.strides.iter_mut().zip(&mut rest.strides) {
                // The shortest way: one back in a row is not a row back and all but one ahead.
                let ahead = stride.rem_euclid(n);
                *own = if 2 * ahead > n { ahead - n } else { ahead };
                *stride = (*stride - *own) / n;
            }
        }
        indices[0] = rest;
        indices
    }

    /// The addresses of the elements of each part, with the extents of their loops.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (Vec<u32>, Affine)> + '_ {
        let (size, count) = (passes(&self.extents), self.equations.len() as i64);
        let inner = if self.interleaved { Affine::along(0, LoopVar(0), count) } else { row_major(&self.extents) };
        let step = if self.interleaved { 1 } else { size };
        (0..count).map(move |part| (self.extents.clone(), inner.plus(Affine::constant(part * step))))
    }
}

/// Addresses in the order of a nest of loops.
fn row_major(extents: &[u32]) -> Affine {
    let mut at = Affine::default();
    for (d, &n) in extents.iter().enumerate() {
        at = at.times(i64::from(n)).plus(Affine::along(0, LoopVar(d as u8), 1));
    }
    at
}

/// Makes the loops of programs fit substitutions. Loops over a whole array become one for each of
/// its parts; loops that read elements `defined` one by one are unrolled.
pub(crate) fn take_apart(model: &mut Model, arrays: &FastMap<VarId, Whole>, defined: &FastSet<VarId>) {
    if arrays.is_empty() && defined.is_empty() {
        return;
    }
    let (exprs, vars) = (&mut model.exprs, &model.vars);
    for program in programs_mut(&mut model.programs) {
        let mut waiting: Vec<Nest> = std::mem::take(&mut program.nests);
        waiting.reverse();
        while let Some(nest) = waiting.pop() {
            let Some((var, at)) = across(exprs, &nest, arrays, defined) else {
                program.nests.push(nest);
                continue;
            };
            let all = nest.extents() == [vars[var].len] && at == Affine::along(0, LoopVar(0), 1);
            let pieces = arrays.get(&var).filter(|_| all).and_then(|whole| in_parts(exprs, &nest, whole));
            let pieces = pieces.unwrap_or_else(|| one_by_one(exprs, &nest));
            waiting.extend(pieces.into_iter().rev());
        }
    }
}

/// A load in a nest that goes across parts of an array, or through elements that are defined one by
/// one.
fn across(exprs: &Exprs, nest: &Nest, arrays: &FastMap<VarId, Whole>, defined: &FastSet<VarId>) -> Option<(VarId, Affine)> {
    let concerned = |v: VarId| arrays.contains_key(&v) || defined.contains(&v);
    let looped = |at: &Affine| (0..nest.loops.len()).any(|d| at.strides[d] != 0);
    let goes_across = |var: VarId, at: Affine| {
        let Some(whole) = arrays.get(&var) else { return true };
        !whole.holds(at, &loops_of(&nest.extents()))
    };
    let found = nest.stores.iter().flat_map(|s| exprs.loads(s.value, |v, _| concerned(v)));
    let mut found = found.filter(|(_, _, at)| looped(at));
    found.find(|&(var, _, at)| goes_across(var, at)).map(|(var, _, at)| (var, at))
}

/// The loop over a whole array as one for each part of it.
fn in_parts(exprs: &mut Exprs, nest: &Nest, whole: &Whole) -> Option<Vec<Nest>> {
    let parts: Vec<(Vec<u32>, Affine)> = whole.parts().collect();
    let mut out = Vec::with_capacity(parts.len());
    for (extents, element) in parts {
        let mut stores = Vec::with_capacity(nest.stores.len());
        for store in &nest.stores {
            let value = placed(exprs, store.value, &[element])?;
            let at = Affine::constant(store.target.at.offset).plus(element.times(store.target.at.strides[0]));
            stores.push(Store { target: Target { at, ..store.target }, value });
        }
        out.push(Nest::over(extents, stores));
    }
    Some(out)
}

/// Every pass of a nest by itself.
fn one_by_one(exprs: &mut Exprs, nest: &Nest) -> Vec<Nest> {
    let mut passes = vec![nest.stores.clone()];
    for (d, &extent) in nest.extents().iter().enumerate() {
        let mut next = Vec::with_capacity(passes.len() * extent as usize);
        for stores in &passes {
            for pass in 0..i64::from(extent) {
                let at_pass = |s: &Store| {
                    let value = exprs.shift(s.value, LoopVar(d as u8), pass);
                    Store { target: Target { at: s.target.at.at_pass(d, pass), ..s.target }, value }
                };
                next.push(stores.iter().map(at_pass).collect::<Vec<_>>());
            }
        }
        passes = next;
    }
    passes.into_iter().map(|stores| Nest { loops: Vec::new(), stores }).collect()
}

/// A definition with the counters of its loops in the place of `indices`; its sums count with
/// counters that these do not use. `None` where the loops would nest too deeply.
pub(super) fn placed(exprs: &mut Exprs, value: ExprId, indices: &[Affine]) -> Option<ExprId> {
    let mut map = [Affine::default(); MAX_DEPTH];
    map[..indices.len()].copy_from_slice(indices);
    let used = indices.iter().flat_map(|at| (0..MAX_DEPTH).filter(|&d| at.strides[d] != 0)).max();
    moved(exprs, value, &map, used.map_or(0, |d| d + 1))
}

fn moved(exprs: &mut Exprs, value: ExprId, map: &[Affine; MAX_DEPTH], next: usize) -> Option<ExprId> {
    let mut fits = true;
    let moved_value = exprs.rewrite(value, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
        Expr::Counter(v) => Some(number(exprs, map[usize::from(v.0)])),
        Expr::Load { var, flavour, at } if !at.is_constant() => {
            let mut there = Affine::constant(at.offset);
            for (index, &stride) in map.iter().zip(&at.strides) {
                there = there.plus(index.times(stride));
            }
            Some(exprs.load(var, flavour, there))
        }
        Expr::Reduce { op, depth, extent, body } => {
            let mut inner = *map;
            let body = (next < MAX_DEPTH).then(|| {
                inner[usize::from(depth.0)] = Affine::along(0, LoopVar(next as u8), 1);
                moved(exprs, body, &inner, next + 1)
            });
            match body.flatten() {
                Some(body) => Some(exprs.reduce(op, LoopVar(next as u8), extent, body)),
                None => {
                    fits = false;
                    Some(exprs.constant(f64::NAN))
                }
            }
        }
        _ => None,
    });
    fits.then_some(moved_value)
}

/// An address as a number.
pub(super) fn number(exprs: &mut Exprs, at: Affine) -> ExprId {
    let mut e = exprs.constant(at.offset as f64);
    for (d, &stride) in at.strides.iter().enumerate() {
        if stride != 0 {
            let (counter, factor) = (exprs.counter(LoopVar(d as u8)), exprs.constant(stride as f64));
            let term = exprs.mul(counter, factor);
            e = exprs.add(e, term);
        }
    }
    e
}
