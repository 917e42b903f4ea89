//! Expressions as a list of nodes, operands before their users. A node is a list of its kind and
//! its operands, `["multiply", 0, 4]`.

use std::fmt;

use cranelift_entity::EntityRef;
use serde::de::value::StrDeserializer;
use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::address::Address;
use crate::ir::{Expr, ExprId, Exprs, FastMap, List, LoopVar, MAX_DEPTH, Side};
use crate::model::number::Number;

/// Most nodes inside one another: passes follow them.
const MAX_NESTING: u32 = 10_000;

/// A node. Its operands are positions in the list of nodes.
pub(super) struct Node {
    /// The expression; of a list that it looks up, its length alone counts.
    expr: Expr,
    /// The list that it looks up.
    list: Vec<Number>,
}

/// The nodes that some expressions are made of, and the position of each.
pub(super) fn written(exprs: &Exprs, used: Vec<ExprId>) -> (Vec<Node>, FastMap<ExprId, ExprId>) {
    let order = exprs.below_in_order(used);
    let positions: FastMap<ExprId, ExprId> = order.iter().enumerate().map(|(i, e)| (*e, ExprId::new(i))).collect();
    let node = |&e: &ExprId| {
        let expr = exprs.node(e);
        let list = match expr {
            Expr::Passed(list, ..) | Expr::Entry(list, _) => exprs.lists().of(list).iter().map(|&x| Number(x)).collect(),
            _ => Vec::new(),
        };
        Node { expr: expr.with_operands(|operand| positions[&operand]), list }
    };
    (order.iter().map(node).collect(), positions)
}

/// Expressions of a list of nodes, and the expression at each position.
///
/// # Errors
/// The position of a node that cannot be one, and the reason.
pub(super) fn read(nodes: Vec<Node>) -> Result<(Exprs, Vec<ExprId>), (usize, String)> {
    let (mut exprs, mut ids, mut nesting) = (Exprs::default(), Vec::<ExprId>::new(), Vec::<u32>::new());
    for (position, Node { mut expr, list }) in nodes.into_iter().enumerate() {
        let mut deepest = 0;
        for operand in Exprs::operands_of(expr) {
            let Some(below) = nesting.get(operand.index()) else {
                return Err((position, format!("there is no node {} before it", operand.index())));
            };
            deepest = deepest.max(below + 1);
        }
        if deepest > MAX_NESTING {
            return Err((position, format!("more than {MAX_NESTING} expressions inside one another")));
        }
        let numbers: Vec<f64> = list.into_iter().map(|x| x.0).collect();
        match &mut expr {
            Expr::Passed(..) | Expr::Entry(..) if numbers.is_empty() => return Err((position, "its list is empty".into())),
            Expr::Passed(limits, ..) if numbers.iter().all(|x| x.is_finite()) && numbers.is_sorted() => {
                *limits = exprs.lists_mut().add_limits(&numbers);
            }
            Expr::Passed(..) => return Err((position, "limits are finite numbers in ascending order".into())),
            Expr::Entry(list, _) => *list = exprs.lists_mut().add(&numbers),
            _ => {}
        }
        ids.push(exprs.raw(expr.with_operands(|operand| ids[operand.index()])));
        nesting.push(deepest);
    }
    Ok((exprs, ids))
}

impl Serialize for Node {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self.expr {
            Expr::Const(bits) => ("constant", Number(f64::from_bits(bits))).serialize(s),
            Expr::Truth(truth) => ("truth", truth).serialize(s),
            Expr::Time => ["time"].serialize(s),
            Expr::Counter(counter) => ("counter", counter).serialize(s),
            Expr::Load { var, flavour, at } => ("load", var, flavour, Address(at)).serialize(s),
            Expr::Unary(f, a) => (f, a).serialize(s),
            Expr::Binary(f, a, b) => (f, a, b).serialize(s),
            Expr::PowInt(a, exponent) => ("integer_power", a, exponent).serialize(s),
            Expr::Passed(_, side, a) => (side, a, &self.list).serialize(s),
            Expr::Entry(_, a) => ("entry", a, &self.list).serialize(s),
            Expr::Compare(f, a, b) => (f, a, b).serialize(s),
            Expr::And(a, b) => ("and", a, b).serialize(s),
            Expr::Or(a, b) => ("or", a, b).serialize(s),
            Expr::Not(a) => ("not", a).serialize(s),
            Expr::Select(c, a, b) => ("select", c, a, b).serialize(s),
            Expr::Reduce { op, depth, extent, body } => (op, depth, extent, body).serialize(s),
        }
    }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(NodeVisitor)
    }
}

/// Reads a node.
struct NodeVisitor;

impl<'de> Visitor<'de> for NodeVisitor {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of a kind of node and its operands")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, parts: A) -> Result<Node, A::Error> {
        let mut rest = Remaining { parts, taken: 0 };
        let (kind, mut list) = (rest.take::<String>()?, Vec::new());
        let expr = match kind.as_str() {
            "constant" => Expr::Const(rest.take::<Number>()?.0.to_bits()),
            "truth" => Expr::Truth(rest.take()?),
            "time" => Expr::Time,
            "counter" => Expr::Counter(rest.counter()?),
            "load" => Expr::Load { var: rest.take()?, flavour: rest.take()?, at: rest.take::<Address>()?.0 },
            "integer_power" => Expr::PowInt(rest.take()?, rest.take()?),
            "entry" => {
                let index = rest.take()?;
                list = rest.take()?;
                Expr::Entry(List { first: 0, len: 0 }, index)
            }
            "and" => Expr::And(rest.take()?, rest.take()?),
            "or" => Expr::Or(rest.take()?, rest.take()?),
            "not" => Expr::Not(rest.take()?),
            "select" => Expr::Select(rest.take()?, rest.take()?, rest.take()?),
            word => {
                if let Some(f) = meaning(word) {
                    Expr::Unary(f, rest.take()?)
                } else if let Some(f) = meaning(word) {
                    Expr::Binary(f, rest.take()?, rest.take()?)
                } else if let Some(f) = meaning(word) {
                    Expr::Compare(f, rest.take()?, rest.take()?)
                } else if let Some(op) = meaning(word) {
                    Expr::Reduce { op, depth: rest.counter()?, extent: rest.take()?, body: rest.take()? }
                } else if let Some(side) = meaning::<Side>(word) {
                    let number = rest.take()?;
                    list = rest.take()?;
                    Expr::Passed(List { first: 0, len: 0 }, side, number)
                } else {
                    return Err(A::Error::custom(format!("unknown kind of node `{}`", word.chars().take(40).collect::<String>())));
                }
            }
        };
        match rest.parts.next_element::<IgnoredAny>()? {
            Some(_) => Err(A::Error::custom(format!("`{kind}` is followed by more than {}", rest.taken - 1))),
            None => Ok(Node { expr, list }),
        }
    }
}

/// The parts of a node that are not read yet.
struct Remaining<A> {
    parts: A,
    taken: usize,
}

impl<'de, A: SeqAccess<'de>> Remaining<A> {
    fn take<T: Deserialize<'de>>(&mut self) -> Result<T, A::Error> {
        self.taken += 1;
        self.parts.next_element()?.ok_or_else(|| A::Error::custom(format!("a node has more than {} parts", self.taken - 1)))
    }

    fn counter(&mut self) -> Result<LoopVar, A::Error> {
        let depth = self.take::<u8>()?;
        if usize::from(depth) < MAX_DEPTH {
            Ok(LoopVar(depth))
        } else {
            Err(A::Error::custom(format!("there is no loop at depth {depth}")))
        }
    }
}

/// The meaning of a word.
fn meaning<'de, T: Deserialize<'de>>(word: &'de str) -> Option<T> {
    T::deserialize(StrDeserializer::<serde::de::value::Error>::new(word)).ok()
}
