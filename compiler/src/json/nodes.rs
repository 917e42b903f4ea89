//! Expressions, addresses and programs of a JSON text.

use cranelift_entity::{EntityRef, PrimaryMap};

use super::cursor::{At, ReadError};
use super::words::meaning;
use crate::ir::{Affine, Expr, ExprId, Exprs, Flavour, List, LoopVar, MAX_DEPTH, Nest, Place, Program, Role, Side, Store, Target, VarId};
use crate::model::Variable;

/// Most nodes inside one another: passes follow them.
const MAX_NESTING: u32 = 10_000;

/// Most passes of one loop.
const MAX_EXTENT: u32 = 100_000_000;

/// Largest offset and factor of an address: sums of products with passes stay far from the ends of
/// 64 bits.
const MAX_STRIDE: i64 = 1 << 32;

/// The nodes of a text: each with its place among the expressions.
pub(super) struct Nodes {
    pub(super) exprs: Exprs,
    ids: Vec<ExprId>,
    /// Nodes inside one another below each.
    nesting: Vec<u32>,
}

impl Nodes {
    /// Reads the list.
    pub(super) fn read(list: &At<'_>, vars: &PrimaryMap<VarId, Variable>) -> Result<Nodes, ReadError> {
        let mut nodes = Nodes { exprs: Exprs::default(), ids: vec![], nesting: vec![] };
        for item in list.items()? {
            let looked_up = nodes.list(&item)?;
            let (node, nesting) = nodes.node(&item, looked_up, vars)?;
            if nesting > MAX_NESTING {
                return Err(item.fault(format!("more than {MAX_NESTING} expressions inside one another")));
            }
            let id = nodes.exprs.raw(node);
            nodes.ids.push(id);
            nodes.nesting.push(nesting);
        }
        Ok(nodes)
    }

    /// The node at a position, which has to be a number.
    pub(super) fn number(&self, at: &At<'_>) -> Result<ExprId, ReadError> {
        self.operand(at, false)
    }

    /// The node at a position; what is stored may be a truth value.
    fn any(&self, at: &At<'_>) -> Result<ExprId, ReadError> {
        Ok(self.ids[at.index(self.ids.len(), "node")?])
    }

    fn operand(&self, at: &At<'_>, truth: bool) -> Result<ExprId, ReadError> {
        let id = self.any(at)?;
        if self.exprs.is_truth(id) == truth {
            return Ok(id);
        }
        let (is, wanted) = if truth { ("a number", "a truth value") } else { ("a truth value", "a number") };
        Err(at.fault(format!("node {} is {is}, {wanted} is expected", at.value())))
    }

    /// The list that a node looks something up in.
    fn list(&mut self, item: &At<'_>) -> Result<Option<List>, ReadError> {
        let parts: Vec<At<'_>> = item.items()?.collect();
        let [kind, _, list] = parts.as_slice() else { return Ok(None) };
        let kind = kind.text()?;
        if kind == "entry" {
            let numbers = list.list(|x| x.number())?;
            return if numbers.is_empty() {
                Err(list.fault("a list of no numbers"))
            } else {
                Ok(Some(self.exprs.lists_mut().add(&numbers)))
            };
        }
        if meaning::<Side>(kind).is_none() {
            return Ok(None);
        }
        let limits = list.list(|limit| limit.number_that("finite", f64::is_finite))?;
        if limits.is_empty() || !limits.is_sorted() {
            return Err(list.fault("limits are numbers that ascend, one at least"));
        }
        Ok(Some(self.exprs.lists_mut().add_limits(&limits)))
    }

    /// A node and how deep it is.
    fn node(&self, item: &At<'_>, looked_up: Option<List>, vars: &PrimaryMap<VarId, Variable>) -> Result<(Expr, u32), ReadError> {
        let parts: Vec<At<'_>> = item.items()?.collect();
        let Some((head, rest)) = parts.split_first() else { return Err(item.fault("a node begins with its kind")) };
        let kind = head.text()?;
        let takes = |count: usize| {
            if rest.len() == count { Ok(()) } else { Err(item.fault(format!("`{kind}` is followed by {count}, here by {}", rest.len()))) }
        };
        let number = |i: usize| self.operand(&rest[i], false);
        let truth = |i: usize| self.operand(&rest[i], true);
        let node = match kind {
            "constant" => takes(1).and_then(|()| Ok(Expr::Const(rest[0].number()?.to_bits())))?,
            "truth" => takes(1).and_then(|()| Ok(Expr::Truth(rest[0].flag()?)))?,
            "time" => takes(0).map(|()| Expr::Time)?,
            "counter" => takes(1).and_then(|()| Ok(Expr::Counter(counter(&rest[0])?)))?,
            "load" => takes(3).and_then(|()| load(rest, vars))?,
            "integer_power" => takes(2).and_then(|()| Ok(Expr::PowInt(number(0)?, rest[1].integer(i64::from(i32::MAX))? as i32)))?,
            "and" => takes(2).and_then(|()| Ok(Expr::And(truth(0)?, truth(1)?)))?,
            "or" => takes(2).and_then(|()| Ok(Expr::Or(truth(0)?, truth(1)?)))?,
            "not" => takes(1).and_then(|()| Ok(Expr::Not(truth(0)?)))?,
            "select" => takes(3).and_then(|()| Ok(Expr::Select(truth(0)?, number(1)?, number(2)?)))?,
            word => {
                if let (Some(list), Some(side)) = (looked_up, meaning(word)) {
                    Expr::Passed(list, side, number(0)?)
                } else if let (Some(list), "entry") = (looked_up, word) {
                    Expr::Entry(list, number(0)?)
                } else if let Some(f) = meaning(word) {
                    takes(1).and_then(|()| Ok(Expr::Unary(f, number(0)?)))?
                } else if let Some(f) = meaning(word) {
                    takes(2).and_then(|()| Ok(Expr::Binary(f, number(0)?, number(1)?)))?
                } else if let Some(f) = meaning(word) {
                    takes(2).and_then(|()| Ok(Expr::Compare(f, number(0)?, number(1)?)))?
                } else if let Some(op) = meaning(word) {
                    takes(3).and_then(|()| {
                        Ok(Expr::Reduce { op, depth: counter(&rest[0])?, extent: rest[1].count(MAX_EXTENT)?, body: number(2)? })
                    })?
                } else {
                    return Err(head.fault(format!("unknown kind of node `{}`", word.chars().take(40).collect::<String>())));
                }
            }
        };
        // Operands are positions among the nodes before; of other numbers none is a position of a
        // deep node by chance that counts.
        let operands = match kind {
            "constant" | "truth" | "time" | "counter" | "load" => &rest[..0],
            "integer_power" | "passed_below" | "passed_up_to" | "entry" => &rest[..1],
            "sum" | "product" | "minimum" | "maximum" => &rest[2..],
            _ => rest,
        };
        let below = operands.iter().filter_map(|at| at.index(self.nesting.len(), "node").ok()).map(|i| self.nesting[i]).max();
        Ok((node, below.map_or(0, |n| n + 1)))
    }

    /// A program.
    pub(super) fn program(&self, at: &At<'_>, vars: &PrimaryMap<VarId, Variable>) -> Result<Program, ReadError> {
        at.only(&["in_place", "nests"])?;
        let nest = |nest: &At<'_>| {
            nest.only(&["extents", "stores"])?;
            let stores = nest.field("stores")?.list(|store| self.store(store, vars))?;
            Ok(Nest::over(extents(&nest.field("extents")?)?, stores))
        };
        Ok(Program { nests: at.field("nests")?.list(nest)?, in_place: at.field("in_place")?.flag()? })
    }

    fn store(&self, at: &At<'_>, vars: &PrimaryMap<VarId, Variable>) -> Result<Store, ReadError> {
        at.only(&["out", "variable", "at", "value"])?;
        let value = self.any(&at.field("value")?)?;
        let target = match at.maybe("out")? {
            Some(out) => Target { place: Place::Out, at: address(&out)? },
            None => {
                let var = variable(&at.field("variable")?, vars)?;
                Target { place: Place::Var(var), at: address(&at.field("at")?)? }
            }
        };
        Ok(Store { target, value })
    }
}

/// The variable at a position.
pub(super) fn variable(at: &At<'_>, vars: &PrimaryMap<VarId, Variable>) -> Result<VarId, ReadError> {
    at.index(vars.len(), "variable").map(VarId::new)
}

/// Offset, then factors of the loop counters.
pub(super) fn address(at: &At<'_>) -> Result<Affine, ReadError> {
    let mut numbers = at.items()?;
    if numbers.len() == 0 || numbers.len() > MAX_DEPTH + 1 {
        return Err(at.fault(format!("an address has an offset and up to {MAX_DEPTH} factors")));
    }
    let mut address = Affine::default();
    if let Some(offset) = numbers.next() {
        address.offset = offset.integer(MAX_STRIDE)?;
    }
    for (stride, factor) in address.strides.iter_mut().zip(numbers) {
        *stride = factor.integer(MAX_STRIDE)?;
    }
    Ok(address)
}

/// Passes of each loop of a nest.
pub(super) fn extents(at: &At<'_>) -> Result<Vec<u32>, ReadError> {
    if at.items()?.len() > MAX_DEPTH {
        return Err(at.fault(format!("more than {MAX_DEPTH} loops inside one another")));
    }
    at.list(|extent| extent.count(MAX_EXTENT))
}

fn counter(at: &At<'_>) -> Result<LoopVar, ReadError> {
    at.index(MAX_DEPTH, "loop at depth").map(|depth| LoopVar(depth as u8))
}

fn load(rest: &[At<'_>], vars: &PrimaryMap<VarId, Variable>) -> Result<Expr, ReadError> {
    let var = variable(&rest[0], vars)?;
    let flavour = rest[1].word()?;
    let has = match (vars[var].role, flavour) {
        (_, Flavour::Value) => true,
        (Role::State | Role::Algebraic, _) => true,
        (Role::Action | Role::Discrete | Role::Disturbance, flavour) => flavour != Flavour::Derivative,
        _ => false,
    };
    if !has {
        return Err(rest[1].fault(format!("variable {} (`{}`) has no such copy", var.index(), vars[var].name)));
    }
    Ok(Expr::Load { var, flavour, at: address(&rest[2])? })
}
