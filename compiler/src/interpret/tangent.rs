//! Evaluation with derivatives: every value carries its derivatives along several directions
//! (forward automatic differentiation).
//!
//! For what runs once a step or at an event: updates, resets, rewards, observations, root
//! functions. Comparisons decide by values and have no derivative. Where a derivative is infinite
//! (`sqrt(x)` at 0) it is zero, as everywhere in the compiler.

use super::{Destination, Operand, Run, Tape};
use crate::ir::{Affine, Arithmetic, BinaryFn, Expr, MAX_DEPTH, ReduceFn, Slope, UnaryFn, slope};
use crate::kernels;
use crate::layout::Base;

/// Directions at once.
pub const LANES: usize = 8;

/// Derivatives of a number along the directions.
pub type Tangent = [f64; LANES];

/// No change along any direction.
pub const STILL: Tangent = [0.0; LANES];

/// Memory of a tape, each number with its derivatives.
#[derive(Debug)]
pub struct TangentView<'a> {
    /// Time.
    pub time: (f64, Tangent),
    /// The unknowns.
    pub y: (&'a mut [f64], &'a mut [Tangent]),
    /// Their derivatives by time.
    pub yp: (&'a [f64], &'a [Tangent]),
    /// The workspace.
    pub work: (&'a mut [f64], &'a mut [Tangent]),
    /// The output.
    pub out: (&'a mut [f64], &'a mut [Tangent]),
    /// Position tables.
    pub tables: &'a [u32],
    /// Space for what is worked out on the way.
    pub registers: &'a mut Vec<Dual>,
}

/// A number with its derivatives along the directions.
pub type Dual = (f64, Tangent);

impl Tape {
    /// Runs the function on values and derivatives.
    pub fn run_tangent(&self, view: &mut TangentView<'_>) {
        view.registers.clear();
        view.registers.resize(self.registers, (0.0, STILL));
        let mut machine = Machine { counters: [0; MAX_DEPTH], numbers: &self.numbers, view };
        machine.run(&self.steps);
    }
}

struct Machine<'a, 'v> {
    counters: [i64; MAX_DEPTH],
    numbers: &'a [f64],
    view: &'a mut TangentView<'v>,
}

impl Machine<'_, '_> {
    fn load(&self, base: Base, at: Affine) -> Dual {
        let i = at.at(&self.counters) as usize;
        match base {
            Base::Y => (self.view.y.0[i], self.view.y.1[i]),
            Base::Yp => (self.view.yp.0[i], self.view.yp.1[i]),
            Base::Work => (self.view.work.0[i], self.view.work.1[i]),
            Base::Out => (self.view.out.0[i], self.view.out.1[i]),
            Base::Factor => (1.0, STILL),
        }
    }
}

impl Run for Machine<'_, '_> {
    type Number = Dual;

    fn counters(&mut self) -> &mut [i64; MAX_DEPTH] {
        &mut self.counters
    }

    fn set(&mut self, register: u32, value: Dual) {
        self.view.registers[register as usize] = value;
    }

    fn nothing(op: ReduceFn) -> Dual {
        (op.identity(), STILL)
    }

    fn reduced(op: ReduceFn, first: bool, sum: Dual, term: Dual) -> Dual {
        // The identity of an extremum is infinite: there is nothing to weigh yet.
        if first && op != ReduceFn::Sum { term } else { binary(op.binary(), sum, term) }
    }

    fn get(&self, operand: Operand) -> Dual {
        match operand {
            Operand::Const(x) => (x, STILL),
            Operand::Register(r) => self.view.registers[r as usize],
        }
    }

    fn eval(&self, node: Expr, operands: &[Operand; 3], source: Option<(Base, Affine)>) -> Dual {
        let [a, b, c] = operands.map(|o| self.get(o));
        match node {
            Expr::Time => self.view.time,
            Expr::Counter(v) => (self.counters[v.0 as usize] as f64, STILL),
            Expr::Load { .. } => source.map_or((f64::NAN, STILL), |(base, at)| self.load(base, at)),
            Expr::Unary(f, _) => unary(f, a),
            Expr::Binary(f, ..) => binary(f, a, b),
            Expr::PowInt(_, n) => {
                let slope = if n == 1 { 1.0 } else { f64::from(n) * kernels::powi(a.0, n - 1) };
                (kernels::powi(a.0, n), scaled(slope, a.1))
            }
            Expr::Select(..) => {
                if a.0 != 0.0 {
                    b
                } else {
                    c
                }
            }
            _ => (super::apply(node, [a.0, b.0, c.0], self.numbers), STILL),
        }
    }

    fn store(&mut self, to: Destination, value: Operand) {
        let (value, tangent) = self.get(value);
        let (i, base, add) = match to {
            Destination::Place(base, at) => (at.at(&self.counters) as usize, base, false),
            Destination::Table { table, index, plus, add } => {
                let entry = self.view.tables[table as usize + index.at(&self.counters) as usize];
                ((i64::from(entry) + plus.at(&self.counters)) as usize, Base::Out, add)
            }
        };
        let (values, tangents) = match base {
            Base::Y => (&mut self.view.y.0, &mut self.view.y.1),
            Base::Work => (&mut self.view.work.0, &mut self.view.work.1),
            Base::Out => (&mut self.view.out.0, &mut self.view.out.1),
            Base::Yp | Base::Factor => return,
        };
        if add {
            values[i] += value;
            tangents[i] = sum(1.0, tangents[i], 1.0, tangent);
        } else {
            (values[i], tangents[i]) = (value, tangent);
        }
    }
}

fn scaled(factor: f64, a: Tangent) -> Tangent {
    // What does not move stays where it is, whatever the slope.
    a.map(|a| if a == 0.0 { 0.0 } else { factor * a })
}

fn sum(f: f64, a: Tangent, g: f64, b: Tangent) -> Tangent {
    let (a, b) = (scaled(f, a), scaled(g, b));
    std::array::from_fn(|lane| a[lane] + b[lane])
}

/// Rules of differentiation in numbers.
struct Numbers;

impl Arithmetic for Numbers {
    type Number = f64;

    fn constant(&mut self, x: f64) -> f64 {
        x
    }

    fn unary(&mut self, f: UnaryFn, a: f64) -> f64 {
        f.apply(a)
    }

    fn binary(&mut self, f: BinaryFn, a: f64, b: f64) -> f64 {
        f.apply(a, b)
    }

    fn powi(&mut self, a: f64, n: i32) -> f64 {
        kernels::powi(a, n)
    }

    fn where_equal(&mut self, (a, b): (f64, f64), then: f64, otherwise: f64) -> f64 {
        if a == b { then } else { otherwise }
    }
}

fn unary(f: UnaryFn, (x, dx): Dual) -> Dual {
    let value = f.apply(x);
    let slope = match slope(&mut Numbers, f, x, value) {
        Slope::Zero => 0.0,
        Slope::MinusOne => -1.0,
        Slope::Sign if x < 0.0 => -1.0,
        Slope::Sign => 1.0,
        Slope::Factor(slope) => slope,
    };
    (value, scaled(slope, dx))
}

fn binary(f: BinaryFn, (x, dx): Dual, (y, dy): Dual) -> Dual {
    let value = f.apply(x, y);
    let tangent = match f {
        BinaryFn::Add => sum(1.0, dx, 1.0, dy),
        BinaryFn::Sub => sum(1.0, dx, -1.0, dy),
        BinaryFn::Mul => sum(y, dx, x, dy),
        BinaryFn::Div => sum(1.0 / y, dx, -value / y, dy),
        BinaryFn::Pow if x == 0.0 => STILL,
        BinaryFn::Pow => sum(y * value / x, dx, value * UnaryFn::Ln.apply(x), dy),
        BinaryFn::Min => {
            if x < y {
                dx
            } else {
                dy
            }
        }
        BinaryFn::Max => {
            if x > y {
                dx
            } else {
                dy
            }
        }
        BinaryFn::Atan2 => sum(y / (x * x + y * y), dx, -x / (x * x + y * y), dy),
    };
    (value, tangent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::{Affine, Flavour, LoopVar, Role};
    use crate::layout::Layout;
    use crate::model::{Model, Variable};
    use crate::schedule::{Access, Staged};

    const SMALL: f64 = 1e-6;

    fn near(got: f64, expected: f64) -> bool {
        (got - expected).abs() <= 1e-8 * (1.0 + expected.abs())
    }

    fn one(slope: f64) -> Tangent {
        let mut tangent = STILL;
        tangent[3] = slope;
        tangent
    }

    #[test]
    fn functions_of_one_number_have_the_slope_of_their_differences() {
        use UnaryFn::*;
        // Rounding to single precision has no differences of this size.
        for &f in UnaryFn::ALL.iter().filter(|&&f| f != Single) {
            let x = 0.37;
            let difference = (f.apply(x + SMALL) - f.apply(x - SMALL)) / (2.0 * SMALL);
            let (value, tangent) = unary(f, (x, one(2.0)));
            assert_eq!(value, f.apply(x));
            assert!(near(tangent[3], 2.0 * difference), "{f:?}: {} {difference}", tangent[3]);
            assert_eq!(tangent[0], 0.0);
        }
    }

    #[test]
    fn functions_of_two_numbers_have_the_slopes_of_their_differences() {
        use BinaryFn::*;
        for f in [Add, Sub, Mul, Div, Pow, Min, Max, Atan2] {
            for (x, y) in [(0.7, 1.9), (1.9, 0.7)] {
                let along = |k: f64| f.apply(x + k * SMALL, y - 3.0 * k * SMALL);
                let difference = (along(1.0) - along(-1.0)) / (2.0 * SMALL);
                let (_, tangent) = binary(f, (x, one(1.0)), (y, one(-3.0)));
                assert!(near(tangent[3], difference), "{f:?}: {} {difference}", tangent[3]);
            }
        }
    }

    /// Reductions and whole powers of an array, and what does not move beside a slope that is
    /// infinite.
    #[test]
    fn tapes_carry_derivatives_through_loops() {
        let mut model = Model::default();
        let span = smpl_dsl::span::Span::default();
        let x = model.vars.push(Variable { name: "x".into(), role: Role::State, len: 3, span });
        model.unknowns.push(x);
        let mut at = Affine::default();
        at.strides[0] = 1;
        let element = model.exprs.load(x, Flavour::Value, at);
        let cubed = model.exprs.powi(element, 3);
        let reductions = [ReduceFn::Sum, ReduceFn::Product, ReduceFn::Min, ReduceFn::Max];
        let values: Vec<_> = reductions.map(|op| model.exprs.reduce(op, LoopVar(0), 3, cubed)).into();
        let layout = Layout::new(&model, 0);
        let access = Access { name: "test", y: true, yp: false, out: 4 };
        let tape = Tape::new(&Staged::of_numbers(values), &model.exprs, &layout, access).expect("a tape");
        let mut y = [2.0, -1.0, 0.5];
        let mut dy = [one(1.0), one(0.0), one(-2.0)];
        let (mut work, mut dwork) = (vec![0.0; layout.len()], vec![STILL; layout.len()]);
        let (mut out, mut dout) = ([0.0; 4], [STILL; 4]);
        tape.run_tangent(&mut TangentView {
            time: (0.0, STILL),
            y: (&mut y, &mut dy),
            yp: (&[], &[]),
            work: (&mut work, &mut dwork),
            out: (&mut out, &mut dout),
            tables: &[],
            registers: &mut Vec::new(),
        });
        assert_eq!(out, [8.0 - 1.0 + 0.125, -1.0, -1.0, 8.0]);
        // d(x^3) = 3 x^2 dx: 12, 0 and -1.5.
        let expected = [12.0 - 1.5, 12.0 * -0.125 + 8.0 * 1.5, 0.0, 12.0];
        for (tangent, expected) in dout.iter().zip(expected) {
            assert!(near(tangent[3], expected), "{} {expected}", tangent[3]);
        }
        assert_eq!(unary(UnaryFn::Sqrt, (0.0, STILL)), (0.0, STILL));
        assert_eq!(unary(UnaryFn::Ln, (0.0, STILL)).1, STILL);
    }
}
