//! Turns runs of stores that differ only in their addresses back into loops.
//!
//! Resets, bounds and observations are often written element by element: `c[0] := f(c[0])`, `c[1]
//! := f(c[1])`, and so on. Each run of at least [`SHORTEST`] such stores with addresses in
//! arithmetic sequence becomes one loop, with passes in the order of the stores.

use super::staged::Staged;
use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, MAX_DEPTH, Nest, Place, Rewritten, Store, Target};

/// Fewer stores stay as they are.
const SHORTEST: usize = 4;
/// Larger expressions are not compared.
const LARGEST: usize = 300;

/// A store without its addresses.
struct Shape {
    /// Nodes in the order of a walk, operands by their places in it.
    tokens: Vec<Token>,
    /// Places of the loads in `tokens`.
    loads: Vec<ExprId>,
    /// Constant part of the address of each load, then of the target.
    offsets: Vec<i64>,
    /// Counters that occur, one bit each.
    counters: u8,
}

#[derive(PartialEq)]
enum Token {
    /// A node whose operands and offset are left out.
    Node(Expr),
    /// A place in the walk.
    Operand(u32),
    /// Destination of the value.
    Target(Place, [i64; MAX_DEPTH]),
}

/// The staged program with runs of stores as loops.
#[must_use]
pub(crate) fn reroll(staged: Staged, exprs: &mut Exprs) -> Staged {
    if staged.in_place { in_place(staged, exprs) } else { shared(staged, exprs) }
}

/// Stages of one scalar store each are candidates; their order stays.
fn in_place(staged: Staged, exprs: &mut Exprs) -> Staged {
    let mut stages = vec![];
    let mut run = vec![];
    for stage in staged.stages {
        match stage.as_slice() {
            [nest] if nest.loops.is_empty() && nest.stores.len() == 1 => run.push(nest.stores[0]),
            _ => {
                stages.extend(loops(&std::mem::take(&mut run), exprs).into_iter().map(|t| vec![t]));
                stages.push(stage);
            }
        }
    }
    stages.extend(loops(&run, exprs).into_iter().map(|t| vec![t]));
    Staged { stages, in_place: true }
}

/// All scalar stores of a stage are candidates.
fn shared(mut staged: Staged, exprs: &mut Exprs) -> Staged {
    for stage in &mut staged.stages {
        let (scalar, mut rest): (Vec<Nest>, Vec<Nest>) = std::mem::take(stage).into_iter().partition(|t| t.loops.is_empty());
        let stores: Vec<Store> = scalar.into_iter().flat_map(|t| t.stores).collect();
        rest.extend(loops(&stores, exprs));
        *stage = rest;
    }
    staged
}

/// The stores as loops where they are runs, one by one elsewhere.
fn loops(stores: &[Store], exprs: &mut Exprs) -> Vec<Nest> {
    let kinds: Vec<[NodeKind; 3]> = stores.iter().map(|store| kinds(exprs, store.value)).collect();
    let alike = |i: usize| i + 1 < kinds.len() && kinds[i] == kinds[i + 1];
    // What differs from both of its neighbours at first sight is in no run.
    let shape = |i: usize| (alike(i) || i > 0 && alike(i - 1)).then(|| shape(exprs, stores[i])).flatten();
    let shapes: Vec<Option<Shape>> = (0..stores.len()).map(shape).collect();
    let mut nests = vec![];
    let mut start = 0;
    while start < stores.len() {
        let length = run_length(&shapes[start..]);
        let looped = (length >= SHORTEST).then(|| looped(exprs, stores[start], &shapes[start..], length)).flatten();
        match looped {
            Some(nest) => {
                nests.push(nest);
                start += length;
            }
            None => {
                nests.push(Nest { loops: vec![], stores: vec![stores[start]] });
                start += 1;
            }
        }
    }
    nests
}

/// Operation of a node.
type NodeKind = Option<std::mem::Discriminant<Expr>>;

/// The operation of a node and of its first two operands.
fn kinds(exprs: &Exprs, value: ExprId) -> [NodeKind; 3] {
    let kind = |e: ExprId| std::mem::discriminant(&exprs.node(e));
    let mut operands = exprs.operands(value);
    [Some(kind(value)), operands.next().map(kind), operands.next().map(kind)]
}

/// Number of the first shapes that are alike, with addresses in arithmetic sequence.
fn run_length(shapes: &[Option<Shape>]) -> usize {
    let [Some(first), Some(second), ..] = shapes else { return 1 };
    let step = |a: &Shape, b: &Shape| a.offsets.iter().zip(&b.offsets).map(|(a, b)| b - a).collect::<Vec<i64>>();
    if first.tokens != second.tokens {
        return 1;
    }
    let expected = step(first, second);
    let continues = |pair: &&[Option<Shape>]| match pair {
        [Some(a), Some(b)] => a.tokens == b.tokens && step(a, b) == expected,
        _ => false,
    };
    1 + shapes.windows(2).take_while(continues).count()
}

/// The first store of a run over all its passes.
fn looped(exprs: &mut Exprs, Store { target, value }: Store, shapes: &[Option<Shape>], length: usize) -> Option<Nest> {
    let [Some(first), Some(second), ..] = shapes else { return None };
    let counter = (0..MAX_DEPTH as u8).find(|c| first.counters & (1 << c) == 0)?;
    let steps: Vec<i64> = first.offsets.iter().zip(&second.offsets).map(|(a, b)| b - a).collect();
    let along = |mut at: Affine, step: i64| {
        at.strides[counter as usize] = step;
        at
    };
    let step_of: FastMap<ExprId, i64> = first.loads.iter().copied().zip(steps.iter().copied()).collect();
    let value = exprs.rewrite(value, &mut Rewritten::default(), &mut |exprs, node| match node {
        Expr::Load { var, flavour, at } => {
            let step = step_of.get(&exprs.raw(node)).copied().unwrap_or(0);
            Some(exprs.load(var, flavour, along(at, step)))
        }
        _ => None,
    });
    let step = *steps.last()?;
    let target = Target { at: along(target.at, step), ..target };
    Some(Nest { loops: vec![(counter, length as u32)], stores: vec![Store { target, value }] })
}

fn shape(exprs: &Exprs, Store { target: Target { place, at }, value }: Store) -> Option<Shape> {
    if let Place::Table { .. } = place {
        return None;
    }
    let mut shape = Shape { tokens: vec![], loads: vec![], offsets: vec![], counters: 0 };
    let mut places: FastMap<ExprId, u32> = FastMap::default();
    let mut stack = vec![(value, false)];
    let mut entries = 0;
    while let Some((expr, entered)) = stack.pop() {
        if places.contains_key(&expr) {
            continue;
        }
        if !entered {
            // A chain is entered to its end before its first node has a place.
            entries += 1;
            if entries > 2 * LARGEST {
                return None;
            }
            stack.push((expr, true));
            stack.extend(exprs.operands(expr).map(|o| (o, false)));
            continue;
        }
        if places.len() > LARGEST {
            return None;
        }
        shape.node(exprs, expr);
        shape.tokens.extend(exprs.operands(expr).filter_map(|o| places.get(&o)).map(|&p| Token::Operand(p)));
        places.insert(expr, places.len() as u32);
    }
    shape.tokens.push(Token::Target(place, at.strides));
    shape.offsets.push(at.offset);
    Some(shape)
}

impl Shape {
    /// Appends a node without its operands.
    fn node(&mut self, exprs: &Exprs, expr: ExprId) {
        let none = ExprId::from_u32(0);
        let bare = match exprs.node(expr) {
            Expr::Load { var, flavour, at } => {
                self.loads.push(expr);
                self.offsets.push(at.offset);
                Expr::Load { var, flavour, at: Affine { offset: 0, ..at } }
            }
            Expr::Unary(f, _) => Expr::Unary(f, none),
            Expr::Binary(f, ..) => Expr::Binary(f, none, none),
            Expr::PowInt(_, n) => Expr::PowInt(none, n),
            Expr::Compare(op, ..) => Expr::Compare(op, none, none),
            Expr::And(..) => Expr::And(none, none),
            Expr::Or(..) => Expr::Or(none, none),
            Expr::Not(_) => Expr::Not(none),
            Expr::Passed(limits, side, _) => Expr::Passed(limits, side, none),
            Expr::Entry(list, _) => Expr::Entry(list, none),
            Expr::Select(..) => Expr::Select(none, none, none),
            Expr::Reduce { op, depth, extent, .. } => {
                self.counters |= 1 << depth.0;
                Expr::Reduce { op, depth, extent, body: none }
            }
            leaf => leaf,
        };
        self.counters |= exprs.free(expr);
        self.tokens.push(Token::Node(bare));
    }
}
