//! Space: grids, values at faces, fluxes, divergence.
//!
//! Face `k` lies below cell `k` (both counted from 0): faces 0 and `n` are the ends. A flux is
//! evaluated at a face. The divergence of a cell takes the fluxes of its two faces, weighted with
//! their areas, over the cell's measure, so that sums over cells telescope.

pub(in crate::elaborate) mod backwards;
mod directions;
pub(in crate::elaborate) mod ends;
pub(in crate::elaborate) mod faces;
pub(in crate::elaborate) mod field;
mod flow;
pub(in crate::elaborate) mod flux;
pub(in crate::elaborate) mod grid;
pub(in crate::elaborate) mod grids;
pub(in crate::elaborate) mod interval;
mod marks;
mod placed;
mod terms;
mod transport;

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::Expr;

use crate::elaborate::lower::loops::Cell;
use crate::elaborate::lower::values::Values;
use crate::elaborate::naming::Naming;
use crate::elaborate::symbols::{Axis, DomainId, SymbolId, SymbolKind, Symbols};
use crate::ir::{Compare, ExprId, UnaryFn};

impl Values<'_> {
    /// The number of a cell or face as a node.
    fn number(&mut self, cell: Cell, plus: f64) -> ExprId {
        let first = self.exprs.constant(cell.first as f64 + plus);
        match cell.along {
            None => first,
            Some(v) => {
                let counter = self.exprs.counter(v);
                self.exprs.add(counter, first)
            }
        }
    }

    /// A straight line through two values, so many of their distances beyond the second.
    fn extrapolate(&mut self, ll: ExprId, l: ExprId, share: ExprId) -> ExprId {
        let difference = self.exprs.sub(l, ll);
        let step = self.exprs.mul(share, difference);
        self.exprs.add(l, step)
    }

    /// Van Leer's limiter: the harmonic mean of both differences where they have one sign, else
    /// first order.
    fn limited(&mut self, ll: ExprId, l: ExprId, r: ExprId) -> ExprId {
        let (a, b) = (self.exprs.sub(l, ll), self.exprs.sub(r, l));
        let product = self.exprs.mul(a, b);
        let sum = self.exprs.add(a, b);
        let zero = self.exprs.constant(0.0);
        let same_sign = self.exprs.compare(Compare::Lt, zero, product);
        let step = self.exprs.div(product, sum);
        let step = self.exprs.select(same_sign, step, zero);
        let step = self.exprs.unary(UnaryFn::Smooth, step);
        self.exprs.add(l, step)
    }

    /// A quotient by a length of the grid: its reciprocal is known before the solve, and a product
    /// takes a tenth of the time.
    fn over_fixed(&mut self, value: ExprId, length: ExprId) -> ExprId {
        let one = self.exprs.constant(1.0);
        let reciprocal = self.exprs.div(one, length);
        self.exprs.mul(value, reciprocal)
    }
}

impl<'a> Naming<'_, 'a> {
    fn flux_axes<'e>(&mut self, symbol: SymbolId, index: &'e [Expr], span: Span) -> Option<(Rc<[Axis]>, &'e Expr)> {
        let SymbolKind::Flux { axes, .. } = &self.symbols[symbol].kind else { return None };
        let axes = axes.clone();
        match index.last() {
            Some(last) if index.len() == axes.len() => Some((axes, last)),
            _ => {
                let path = self.symbols[symbol].path.clone();
                let wanted: Vec<&str> = axes.iter().map(|&a| self.symbols.axis_name(a)).collect();
                let help = format!("write `{path}[{}]`", wanted.join(", "));
                self.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, format!("`{path}` needs its indices"), span).help(help));
                None
            }
        }
    }
}

impl<'a> Symbols<'a> {
    /// Returns `true` if all cells have one width.
    fn is_uniform(&self, domain: DomainId) -> bool {
        let d = self.domains[domain].declaration;
        d.stretch.is_none() && d.faces.is_none()
    }

    /// Returns `true` if the first cell of a domain follows its last one.
    pub(in crate::elaborate) fn is_periodic(&self, domain: DomainId) -> bool {
        self.domains[domain].declaration.periodic.is_some()
    }
}
