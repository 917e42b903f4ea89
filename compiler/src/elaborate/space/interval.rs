//! Bounds of the values of an expression, and of its slope in one of its nodes, from declared
//! bounds and constants.

use crate::ir::{Affine, BinaryFn, Expr, ExprId, Exprs, FastMap, Flavour, ReduceFn, UnaryFn, VarId};

/// Numbers between two bounds, which may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// Possible values of a variable's elements.
pub(crate) type Bounds<'a> = dyn Fn(VarId, Flavour, Affine) -> Interval + 'a;

impl Interval {
    /// Any number.
    pub(crate) const ALL: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
    const POSITIVE: Interval = Interval { low: 0.0, high: f64::INFINITY };
    const UNIT: Interval = Interval { low: -1.0, high: 1.0 };
    const ZERO: Interval = Interval::of(0.0);

    /// One number.
    pub(crate) const fn of(x: f64) -> Self {
        Interval { low: x, high: x }
    }

    /// Returns `true` if no number in it is negative.
    pub(crate) fn is_not_negative(self) -> bool {
        self.low >= 0.0
    }

    /// Returns `true` if no number in it is positive.
    pub(crate) fn is_not_positive(self) -> bool {
        self.high <= 0.0
    }

    /// Returns `true` if the sign is known.
    pub(crate) fn has_sign(self) -> bool {
        self.is_not_negative() || self.is_not_positive()
    }

    fn hull(self, other: Self) -> Self {
        Interval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// All sums.
    pub(crate) fn plus(self, other: Self) -> Self {
        Interval { low: self.low + other.low, high: self.high + other.high }
    }

    fn negated(self) -> Self {
        Interval { low: -self.high, high: -self.low }
    }

    /// All products.
    pub(crate) fn times(self, other: Self) -> Self {
        let product = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let (l, h) = (product(self.low, other.low), product(self.high, other.high));
        let (m, n) = (product(self.low, other.high), product(self.high, other.low));
        Interval { low: l.min(h).min(m).min(n), high: l.max(h).max(m).max(n) }
    }

    /// The reciprocals.
    pub(crate) fn reciprocal(self) -> Self {
        if self.is_not_negative() {
            return Interval { low: 1.0 / self.high, high: if self.low == 0.0 { f64::INFINITY } else { 1.0 / self.low } };
        }
        if self.is_not_positive() { self.negated().reciprocal().negated() } else { Self::ALL }
    }

    fn power(self, n: i32) -> Self {
        if n < 0 {
            return self.power(-n).reciprocal();
        }
        let (low, high) = (self.low.powi(n), self.high.powi(n));
        if n % 2 == 1 || self.is_not_negative() {
            Interval { low, high }
        } else if self.is_not_positive() {
            Interval { low: high, high: low }
        } else {
            Interval { low: 0.0, high: low.max(high) }
        }
    }

    /// No bound is NaN (as the sum of opposite infinities is).
    fn sound(self) -> Self {
        if self.low.is_nan() || self.high.is_nan() { Self::ALL } else { self }
    }
}

/// Values of a node, and of its derivative with respect to the node `by`.
#[derive(Clone, Copy)]
struct Known {
    value: Interval,
    slope: Interval,
}

/// Possible values of an expression.
pub(crate) fn values(exprs: &Exprs, e: ExprId, bounds: &Bounds<'_>) -> Interval {
    known(exprs, e, None, bounds).value
}

/// Possible values of the derivative of an expression with respect to a node in it.
pub(crate) fn slopes(exprs: &Exprs, e: ExprId, by: ExprId, bounds: &Bounds<'_>) -> Interval {
    known(exprs, e, Some(by), bounds).slope
}

fn known(exprs: &Exprs, root: ExprId, by: Option<ExprId>, bounds: &Bounds<'_>) -> Known {
    let mut done: FastMap<ExprId, Known> = FastMap::default();
    let mut stack = vec![(root, false)];
    while let Some((e, entered)) = stack.pop() {
        if done.contains_key(&e) {
            continue;
        }
        if !entered {
            stack.push((e, true));
            stack.extend(exprs.operands(e).map(|o| (o, false)));
            continue;
        }
        let of = |o: ExprId| done.get(&o).copied().unwrap_or(Known { value: Interval::ALL, slope: Interval::ALL });
        let mut k = node(exprs, e, &of, bounds);
        if by == Some(e) {
            k.slope = Interval::of(1.0);
        }
        done.insert(e, Known { value: k.value.sound(), slope: k.slope.sound() });
    }
    done.get(&root).copied().unwrap_or(Known { value: Interval::ALL, slope: Interval::ALL })
}

fn node(exprs: &Exprs, e: ExprId, of: &dyn Fn(ExprId) -> Known, bounds: &Bounds<'_>) -> Known {
    let leaf = |value| Known { value, slope: Interval::ZERO };
    match exprs.node(e) {
        Expr::Const(bits) => leaf(Interval::of(f64::from_bits(bits))),
        Expr::Counter(_) => leaf(Interval::POSITIVE),
        Expr::Load { var, flavour, at } => leaf(bounds(var, flavour, at)),
        Expr::Unary(f, a) => unary(f, of(a)),
        Expr::PowInt(a, n) => {
            let a = of(a);
            let slope = Interval::of(f64::from(n)).times(a.value.power(n - 1)).times(a.slope);
            Known { value: a.value.power(n), slope }
        }
        Expr::Binary(f, a, b) => binary(f, of(a), of(b)),
        Expr::Passed(..) => leaf(Interval::POSITIVE),
        Expr::Entry(list, _) => {
            leaf(exprs.lists().of(list).iter().map(|&x| Interval::of(x)).reduce(Interval::hull).unwrap_or(Interval::ALL))
        }
        Expr::Select(_, a, b) => {
            let (a, b) = (of(a), of(b));
            Known { value: a.value.hull(b.value), slope: a.slope.hull(b.slope) }
        }
        Expr::Reduce { op, extent, body, .. } => {
            let body = of(body);
            let times = Interval::of(f64::from(extent));
            match op {
                ReduceFn::Sum => Known { value: body.value.times(times), slope: body.slope.times(times) },
                ReduceFn::Min | ReduceFn::Max => body,
                ReduceFn::Product => {
                    let value = if body.value.is_not_negative() { Interval::POSITIVE } else { Interval::ALL };
                    Known { value, slope: anything(body.slope) }
                }
            }
        }
        _ => leaf(Interval::ALL),
    }
}

/// A slope of any size, unless it is zero.
fn anything(slope: Interval) -> Interval {
    if slope == Interval::ZERO { slope } else { Interval::ALL }
}

fn unary(f: UnaryFn, a: Known) -> Known {
    let rising = |by: Interval| by.times(a.slope);
    match f {
        UnaryFn::Neg => Known { value: a.value.negated(), slope: a.slope.negated() },
        UnaryFn::Abs if a.value.is_not_negative() => a,
        UnaryFn::Abs if a.value.is_not_positive() => unary(UnaryFn::Neg, a),
        UnaryFn::Abs => Known { value: Interval::POSITIVE, slope: rising(Interval::UNIT) },
        UnaryFn::Sign => Known { value: Interval::UNIT, slope: Interval::ZERO },
        UnaryFn::Sqrt => Known { value: Interval::POSITIVE, slope: rising(Interval::POSITIVE) },
        UnaryFn::Exp => Known { value: Interval::POSITIVE, slope: rising(Interval::POSITIVE) },
        UnaryFn::Ln | UnaryFn::Log10 => Known { value: Interval::ALL, slope: rising(Interval::POSITIVE) },
        UnaryFn::Sinh => Known { value: Interval::ALL, slope: rising(Interval::POSITIVE) },
        UnaryFn::Cosh => Known { value: Interval::POSITIVE, slope: anything(a.slope) },
        UnaryFn::Tanh => Known { value: Interval::UNIT, slope: rising(Interval { low: 0.0, high: 1.0 }) },
        UnaryFn::Erf => Known { value: Interval::UNIT, slope: rising(Interval { low: 0.0, high: std::f64::consts::FRAC_2_SQRT_PI }) },
        UnaryFn::Atan => Known { value: Interval::ALL, slope: rising(Interval { low: 0.0, high: 1.0 }) },
        UnaryFn::Sin | UnaryFn::Cos => Known { value: Interval::UNIT, slope: rising(Interval::UNIT) },
        UnaryFn::Single | UnaryFn::Smooth => a,
        UnaryFn::Floor | UnaryFn::Ceil | UnaryFn::Round => {
            let value = if a.value.is_not_negative() { Interval::POSITIVE } else { Interval::ALL };
            Known { value, slope: Interval::ZERO }
        }
        // Of others nothing is known, which serves any.
        _ => Known { value: Interval::ALL, slope: anything(a.slope) },
    }
}

fn binary(f: BinaryFn, a: Known, b: Known) -> Known {
    match f {
        BinaryFn::Add => Known { value: a.value.plus(b.value), slope: a.slope.plus(b.slope) },
        BinaryFn::Sub => Known { value: a.value.plus(b.value.negated()), slope: a.slope.plus(b.slope.negated()) },
        BinaryFn::Mul => Known { value: a.value.times(b.value), slope: a.slope.times(b.value).plus(a.value.times(b.slope)) },
        BinaryFn::Div => {
            let over = b.value.reciprocal();
            let value = a.value.times(over);
            Known { value, slope: a.slope.times(over).plus(value.times(over).times(b.slope.negated())) }
        }
        BinaryFn::Pow => {
            let value = if a.value.is_not_negative() { Interval::POSITIVE } else { Interval::ALL };
            let slope = if b.slope == Interval::ZERO && a.value.is_not_negative() {
                b.value.times(Interval::POSITIVE).times(a.slope)
            } else {
                anything(a.slope.hull(b.slope))
            };
            Known { value, slope }
        }
        BinaryFn::Min => {
            let value = Interval { low: a.value.low.min(b.value.low), high: a.value.high.min(b.value.high) };
            Known { value, slope: a.slope.hull(b.slope) }
        }
        BinaryFn::Max => {
            let value = Interval { low: a.value.low.max(b.value.low), high: a.value.high.max(b.value.high) };
            Known { value, slope: a.slope.hull(b.slope) }
        }
        BinaryFn::Atan2 => Known { value: Interval::ALL, slope: anything(a.slope.hull(b.slope)) },
    }
}
