//! Derivatives of expressions with respect to variables, as loops.
//!
//! Forward and symbolic: the derivative of a node is a list of terms, one for each element pattern ([`Leaf`]) of the variables of
//! interest that it depends on; lists are kept for each node, so that rows share what they have in common. A sum over a loop
//! whose counter a leaf uses becomes an entry with one more loop: matrices are never scalarised.
//!
//! At points where a derivative is infinite (`sqrt(x)` and `x^a`, a < 1, at x = 0) zero is returned: a Newton iteration then goes
//! on from the rest of the row instead of failing at once.

use std::cmp::Ordering;
use std::rc::Rc;

use thiserror::Error;

use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, Exprs, FastMap, FastSet, Flavour, LoopVar, MAX_DEPTH, ReduceFn, UnaryFn, VarId};

pub mod pattern;
mod rows;
mod rules;

pub use rows::{jacobian, rows};

/// Reductions that are no sums are written out up to this many passes to be differentiated; longer ones stay loops.
const LONGEST_UNROLLED: u32 = 64;
/// Counters beside its own that the derivative of a long reduction needs.
const TWINS: u8 = 2;
/// Sums are written out up to this many passes, if the result stays small.
const SHORT_SUM: u32 = 8;
/// Largest number of nodes of a sum that is written out.
const SHORT_SUM_NODES: usize = 256;

/// Failures of differentiation.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum DifferentiateError {
    /// Loops nest too deeply.
    #[error("sums inside of arrays nest deeper than {MAX_DEPTH} loops")]
    TooDeep,
}

/// Rows of a nest: an expression and where it stands.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Extents of the loops.
    pub extents: Vec<u32>,
    /// The row as a function of the counters.
    pub row: Affine,
    /// Its expression.
    pub value: ExprId,
}

/// Entries of a matrix over a nest of loops; entries of several nests at one place are added.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Counter and passes of each loop.
    pub loops: Vec<(u8, u32)>,
    /// The row.
    pub row: Affine,
    /// The column.
    pub column: Affine,
    /// The value.
    pub value: ExprId,
}

/// The column of a variable's first element, and what the derivative is multiplied with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// First column.
    pub first: u32,
    /// Factor; `None` for 1.
    pub factor: Option<ExprId>,
}

/// A column pattern: elements along loop counters, of which those of sums are `bound` to extents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Leaf {
    column: Affine,
    bound: [u32; MAX_DEPTH],
}

#[derive(Clone, Copy, Debug)]
struct Term {
    leaf: Leaf,
    value: ExprId,
}

/// Derivatives of a node: a number and a factor common to all times terms, one for each leaf, ascending. Numbers and factors are
/// multiplied with each other on the way up and with the terms at last, where lists with different factors are added.
#[derive(Clone)]
struct Terms {
    list: Rc<[Term]>,
    scale: f64,
    /// `None` for 1.
    factor: Option<ExprId>,
}

impl Terms {
    fn new(list: impl Into<Rc<[Term]>>) -> Terms {
        Terms { list: list.into(), scale: 1.0, factor: None }
    }

    fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

/// Which loads are differentiated for.
pub type ColumnOf<'a> = dyn Fn(VarId, Flavour) -> Option<Column> + 'a;

/// Brings the reductions of a row into the form that [`entries`] wants: each binds a counter that is free in its surroundings, short
/// sums and other reductions over what depends on the columns are written out.
///
/// # Errors
/// If loops nest too deeply or a reduction is too long to be written out.
pub fn normalise(exprs: &mut Exprs, depth: usize, value: ExprId, column_of: &ColumnOf<'_>) -> Result<ExprId, DifferentiateError> {
    let mut map = [0; MAX_DEPTH];
    map.iter_mut().zip(0..).for_each(|(m, d)| *m = d);
    renumber(exprs, value, map, depth as u8, column_of)
}

fn renumber(
    exprs: &mut Exprs,
    value: ExprId,
    map: [u8; MAX_DEPTH],
    next: u8,
    column_of: &ColumnOf<'_>,
) -> Result<ExprId, DifferentiateError> {
    let identity = map.iter().zip(0..).all(|(&m, d)| m == d);
    let mut failure = None;
    let renamed = exprs.rewrite(value, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
        Expr::Counter(v) if !identity => Some(exprs.counter(LoopVar(map[v.0 as usize]))),
        Expr::Load { var, flavour, at } if !identity => {
            let mut moved = Affine::constant(at.offset);
            for (d, stride) in at.strides.into_iter().enumerate() {
                moved.strides[map[d] as usize] += stride;
            }
            Some(exprs.load(var, flavour, moved))
        }
        Expr::Reduce { op, depth, extent, body } => match renumber_reduce(exprs, (op, depth, extent, body), map, next, column_of) {
            Ok(reduced) => Some(reduced),
            Err(error) => {
                failure = Some(error);
                Some(body)
            }
        },
        _ => None,
    });
    failure.map_or(Ok(renamed), Err)
}

fn renumber_reduce(
    exprs: &mut Exprs,
    (op, depth, extent, body): (ReduceFn, LoopVar, u32, ExprId),
    mut map: [u8; MAX_DEPTH],
    next: u8,
    column_of: &ColumnOf<'_>,
) -> Result<ExprId, DifferentiateError> {
    if usize::from(next) >= MAX_DEPTH {
        return Err(DifferentiateError::TooDeep);
    }
    map[depth.0 as usize] = next;
    let written = body;
    let body = renumber(exprs, written, map, next + 1, column_of)?;
    let (size, depends) = survey(exprs, body, column_of);
    let short = op == ReduceFn::Sum && extent <= SHORT_SUM && size * extent as usize <= SHORT_SUM_NODES;
    if extent == 0 || !(short || (op != ReduceFn::Sum && depends)) {
        return Ok(exprs.reduce(op, LoopVar(next), extent, body));
    }
    if extent > LONGEST_UNROLLED {
        // Its derivative needs two more reductions over the same elements.
        let inner = next + 1 + TWINS;
        if usize::from(inner) > MAX_DEPTH {
            return Err(DifferentiateError::TooDeep);
        }
        let body = renumber(exprs, written, map, inner, column_of)?;
        return Ok(exprs.reduce(op, LoopVar(next), extent, body));
    }
    let combine = match op {
        ReduceFn::Sum => BinaryFn::Add,
        ReduceFn::Product => BinaryFn::Mul,
        ReduceFn::Min => BinaryFn::Min,
        ReduceFn::Max => BinaryFn::Max,
    };
    let first = exprs.shift(body, LoopVar(next), 0);
    Ok((1..extent).fold(first, |sum, i| {
        let item = exprs.shift(body, LoopVar(next), i64::from(i));
        exprs.binary(combine, sum, item)
    }))
}

/// Number of nodes, and whether any is a load of a column.
fn survey(exprs: &Exprs, root: ExprId, column_of: &ColumnOf<'_>) -> (usize, bool) {
    let mut seen = FastSet::default();
    let (mut stack, mut depends) = (vec![root], false);
    while let Some(e) = stack.pop() {
        if seen.insert(e) {
            if let Expr::Load { var, flavour, .. } = exprs.node(e) {
                depends |= column_of(var, flavour).is_some();
            }
            stack.extend(exprs.operands(e));
        }
    }
    (seen.len(), depends)
}

/// The matrix of derivatives of normalised rows.
pub fn entries(exprs: &mut Exprs, rows: &[Rows], column_of: &ColumnOf<'_>) -> Vec<Entry> {
    let uses = uses(exprs, rows);
    let mut pass = Differentiator { exprs, column_of, known: FastMap::default(), uses, nothing: Terms::new([]) };
    let mut entries = vec![];
    for row in rows {
        let terms = pass.terms(row.value);
        pass.used(row.value);
        for term in pass.expanded(&terms).iter() {
            let mut loops: Vec<(u8, u32)> = (0..).zip(row.extents.iter().copied()).collect();
            loops.extend((0..).zip(term.leaf.bound).filter(|&(_, extent)| extent > 0));
            entries.push(Entry { loops, row: row.row, column: term.leaf.column, value: term.value });
        }
    }
    entries
}

/// How often each node is an operand below rows, or a row.
fn uses(exprs: &Exprs, rows: &[Rows]) -> Vec<u32> {
    let mut uses = vec![0; exprs.len()];
    let mut stack: Vec<ExprId> = rows.iter().map(|row| row.value).collect();
    while let Some(e) = stack.pop() {
        let count: &mut u32 = &mut uses[e.as_u32() as usize];
        *count += 1;
        if *count == 1 {
            stack.extend(exprs.operands(e));
        }
    }
    uses
}

struct Differentiator<'a, 'c> {
    exprs: &'a mut Exprs,
    column_of: &'a ColumnOf<'c>,
    /// Derivatives that are still needed.
    known: FastMap<ExprId, Terms>,
    /// By how many nodes and rows those of each node are still needed.
    uses: Vec<u32>,
    nothing: Terms,
}

impl Differentiator<'_, '_> {
    /// Derivatives of a node, those of its operands first.
    fn terms(&mut self, root: ExprId) -> Terms {
        let mut stack = vec![(root, false)];
        while let Some((expr, entered)) = stack.pop() {
            if self.known.contains_key(&expr) {
                continue;
            }
            if entered {
                let terms = self.derive(expr);
                self.known.insert(expr, terms);
                // A sum of n terms has n partial sums: their lists together would take the square of it.
                self.exprs.operands(expr).for_each(|o| self.used(o));
            } else {
                stack.push((expr, true));
                stack.extend(self.exprs.operands(expr).map(|o| (o, false)));
            }
        }
        self.of(root)
    }

    /// Forgets the derivatives of a node with its last use.
    fn used(&mut self, expr: ExprId) {
        let left = &mut self.uses[expr.as_u32() as usize];
        *left = left.saturating_sub(1);
        if *left == 0 {
            self.known.remove(&expr);
        }
    }

    fn of(&self, expr: ExprId) -> Terms {
        self.known.get(&expr).unwrap_or(&self.nothing).clone()
    }

    fn derive(&mut self, expr: ExprId) -> Terms {
        match self.exprs.node(expr) {
            Expr::Load { var, flavour, at } => self.load(var, flavour, at),
            Expr::Unary(f, a) => self.unary(expr, f, a),
            Expr::Binary(f, a, b) => self.binary(expr, f, a, b),
            Expr::PowInt(a, n) => {
                let terms = self.of(a);
                if terms.is_empty() {
                    return terms;
                }
                let (power, n) = (self.exprs.powi(a, n - 1), self.exprs.constant(f64::from(n)));
                let factor = self.exprs.mul(n, power);
                self.scaled(&terms, factor)
            }
            Expr::Select(c, a, b) => {
                let (a, b) = (self.of(a), self.of(b));
                self.select(c, &a, &b)
            }
            Expr::Reduce { op, depth, extent, body } => {
                let terms = self.of(body);
                if terms.is_empty() {
                    return terms;
                }
                match op {
                    ReduceFn::Sum => self.sum(depth, extent, &terms),
                    ReduceFn::Min | ReduceFn::Max => self.extremum(op, (depth, extent), body, &terms),
                    ReduceFn::Product => self.product((depth, extent), body, &terms),
                }
            }
            _ => self.nothing.clone(),
        }
    }

    fn load(&mut self, var: VarId, flavour: Flavour, at: Affine) -> Terms {
        let Some(column) = (self.column_of)(var, flavour) else {
            return self.nothing.clone();
        };
        let leaf = Leaf { column: at.plus(Affine::constant(i64::from(column.first))), bound: [0; MAX_DEPTH] };
        let value = column.factor.unwrap_or_else(|| self.exprs.constant(1.0));
        Terms::new([Term { leaf, value }])
    }

    /// The body of a reduction with another counter.
    fn twin(&mut self, body: ExprId, depth: LoopVar, by: u8) -> (ExprId, LoopVar) {
        let (from, to) = (depth.0 as usize, LoopVar(depth.0 + by));
        let twin = self.exprs.rewrite(body, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
            Expr::Counter(v) if v == depth => Some(exprs.counter(to)),
            Expr::Load { var, flavour, mut at } if at.strides[from] != 0 => {
                at.strides[to.0 as usize] += std::mem::take(&mut at.strides[from]);
                Some(exprs.load(var, flavour, at))
            }
            _ => None,
        });
        (twin, to)
    }

    /// The derivative of the greatest (least) element; of several that are equal, the mean of theirs.
    fn extremum(&mut self, op: ReduceFn, (depth, extent): (LoopVar, u32), body: ExprId, terms: &Terms) -> Terms {
        let (second, over) = self.twin(body, depth, 2);
        let value = self.exprs.reduce(op, over, extent, second);
        let (first, counted) = self.twin(body, depth, 1);
        let (zero, one) = (self.exprs.constant(0.0), self.exprs.constant(1.0));
        let x = &mut *self.exprs;
        let (hit, equal) = (x.compare(Compare::Eq, body, value), x.compare(Compare::Eq, first, value));
        let each = x.select(equal, one, zero);
        let count = x.reduce(ReduceFn::Sum, counted, extent, each);
        // There is one at least, unless the value is no number.
        let count = x.binary(BinaryFn::Max, count, one);
        let share = x.div(one, count);
        let nothing = self.nothing.clone();
        let chosen = self.select(hit, terms, &nothing);
        let sum = self.sum(depth, extent, &chosen);
        self.scaled(&sum, share)
    }

    /// The derivative of a long product, which may have factors that are zero.
    fn product(&mut self, (depth, extent): (LoopVar, u32), body: ExprId, terms: &Terms) -> Terms {
        let (factor, counter) = self.twin(body, depth, 1);
        let (zero, one) = (self.exprs.constant(0.0), self.exprs.constant(1.0));
        let x = &mut *self.exprs;
        let is_zero = x.compare(Compare::Eq, factor, zero);
        let (others, each) = (x.select(is_zero, one, factor), x.select(is_zero, one, zero));
        let others = x.reduce(ReduceFn::Product, counter, extent, others);
        let zeros = x.reduce(ReduceFn::Sum, counter, extent, each);
        let (none, only) = (x.compare(Compare::Eq, zeros, zero), x.compare(Compare::Eq, zeros, one));
        let (here, rest) = (x.compare(Compare::Eq, body, zero), x.div(others, body));
        let (at_zero, elsewhere) = (x.select(only, others, zero), x.select(none, rest, zero));
        let slope = x.select(here, at_zero, elsewhere);
        let scaled = self.scaled(terms, slope);
        self.sum(depth, extent, &scaled)
    }

    fn sum(&mut self, depth: LoopVar, extent: u32, inner: &Terms) -> Terms {
        let d = depth.0 as usize;
        let inner = inner.clone();
        let stays = inner.factor.is_none_or(|f| self.exprs.free(f) & (1 << d) == 0);
        let inner = if stays { inner } else { Terms::new(self.expanded(&inner)) };
        let mut terms = vec![];
        for &term in inner.list.iter() {
            let mut term = term;
            if term.leaf.column.strides[d] != 0 {
                term.leaf.bound[d] = extent;
            } else {
                term.value = self.exprs.reduce(ReduceFn::Sum, depth, extent, term.value);
            }
            terms.push(term);
        }
        terms.sort_by_key(|t| t.leaf);
        Terms { list: Rc::from(terms), ..inner }
    }

    /// Terms times a factor.
    fn scaled(&mut self, terms: &Terms, factor: ExprId) -> Terms {
        match self.exprs.node(factor) {
            Expr::Const(bits) => {
                let scale = terms.scale * f64::from_bits(bits);
                if scale == 0.0 { self.nothing.clone() } else { Terms { scale, ..terms.clone() } }
            }
            Expr::Unary(UnaryFn::Neg, a) => {
                let minus = self.negated(terms);
                self.scaled(&minus, a)
            }
            _ => {
                let factor = terms.factor.map_or(factor, |f| self.exprs.mul(factor, f));
                Terms { factor: Some(factor), ..terms.clone() }
            }
        }
    }

    fn negated(&self, terms: &Terms) -> Terms {
        Terms { scale: -terms.scale, ..terms.clone() }
    }

    /// The list with the number and the factor in every term.
    fn expanded(&mut self, terms: &Terms) -> Rc<[Term]> {
        if terms.factor.is_none() && terms.scale == 1.0 {
            return Rc::clone(&terms.list);
        }
        let whole = self.times(terms.factor, terms.scale);
        let times = |t: &Term| {
            let value = match self.exprs.as_const(t.value) {
                Some(x) => self.times(terms.factor, terms.scale * x),
                None => self.exprs.mul(whole, t.value),
            };
            Term { leaf: t.leaf, value }
        };
        terms.list.iter().map(times).collect()
    }

    fn times(&mut self, factor: Option<ExprId>, scale: f64) -> ExprId {
        let scale = self.exprs.constant(scale);
        factor.map_or(scale, |f| self.exprs.mul(f, scale))
    }

    fn added(&mut self, a: &Terms, b: &Terms) -> Terms {
        if a.is_empty() {
            return b.clone();
        }
        if b.is_empty() {
            return a.clone();
        }
        if a.factor == b.factor && a.scale.abs() == b.scale.abs() {
            let join = if a.scale == b.scale { Exprs::add } else { Exprs::sub };
            return Terms { list: self.joined(&a.list, &b.list, join), ..a.clone() };
        }
        let (a, b) = (self.expanded(a), self.expanded(b));
        Terms::new(self.joined(&a, &b, Exprs::add))
    }

    /// Sum or difference of lists without factors.
    fn joined(&mut self, a: &[Term], b: &[Term], join: impl Fn(&mut Exprs, ExprId, ExprId) -> ExprId) -> Rc<[Term]> {
        self.merged(a, b, |exprs, x, y| match (x, y) {
            (Some(x), Some(y)) => join(exprs, x, y),
            (Some(x), None) => x,
            (None, y) => {
                let zero = exprs.constant(0.0);
                y.map_or(zero, |y| join(exprs, zero, y))
            }
        })
    }

    /// A factor must not reach what is not chosen: infinity times 0 is no number.
    fn select(&mut self, c: ExprId, a: &Terms, b: &Terms) -> Terms {
        let zero = self.exprs.constant(0.0);
        let (a, b) = (self.expanded(a), self.expanded(b));
        Terms::new(self.merged(&a, &b, |exprs, x, y| exprs.select(c, x.unwrap_or(zero), y.unwrap_or(zero))))
    }

    /// Both lists, leaf by leaf.
    fn merged(&mut self, a: &[Term], b: &[Term], join: impl Fn(&mut Exprs, Option<ExprId>, Option<ExprId>) -> ExprId) -> Rc<[Term]> {
        let (mut i, mut k) = (0, 0);
        let mut terms = Vec::with_capacity(a.len().max(b.len()));
        while i < a.len() || k < b.len() {
            let order = match (a.get(i), b.get(k)) {
                (Some(x), Some(y)) => x.leaf.cmp(&y.leaf),
                (Some(_), None) => Ordering::Less,
                _ => Ordering::Greater,
            };
            let (x, y) = (a.get(i).filter(|_| order.is_le()), b.get(k).filter(|_| order.is_ge()));
            let Some(leaf) = x.or(y).map(|t| t.leaf) else {
                break;
            };
            i += usize::from(x.is_some());
            k += usize::from(y.is_some());
            let value = join(self.exprs, x.map(|t| t.value), y.map(|t| t.value));
            if self.exprs.as_const(value) != Some(0.0) {
                terms.push(Term { leaf, value });
            }
        }
        Rc::from(terms)
    }
}
