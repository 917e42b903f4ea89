//! Evaluation without machine code: for programs that run rarely, for constants, and as the oracle
//! of the code generator.
//!
//! A [`Tape`] is a schedule with a register for each value; it visits nodes in the order of the
//! compiled code.

use std::cell::Cell;

use crate::ir::{Affine, Expr, ExprId, Exprs, FastMap, Flavour, List, MAX_DEPTH, Place, ReduceFn, Side, Target, VarId};
use crate::kernels;
use crate::layout::{Base, Layout};
use crate::schedule::{Access, BlockId, Item, Schedule, ScheduleError, Staged, schedules};

pub mod tangent;

/// Memory of a tape.
#[derive(Debug)]
pub struct View<'a> {
    /// Time.
    pub time: f64,
    /// Factor of the derivatives (Jacobian only).
    pub factor: f64,
    /// The unknowns.
    pub y: &'a mut [f64],
    /// Their derivatives.
    pub yp: &'a [f64],
    /// The workspace.
    pub work: &'a mut [f64],
    /// The output.
    pub out: &'a mut [f64],
    /// Position tables.
    pub tables: &'a [u32],
}

/// A function ready to be interpreted.
#[derive(Clone, Debug, Default)]
pub struct Tape {
    steps: Vec<Instruction>,
    registers: usize,
    /// The lists that it looks up, all behind one another; nothing where it looks up none.
    numbers: Box<[f64]>,
}

#[derive(Clone, Copy, Debug)]
enum Operand {
    Const(f64),
    Register(u32),
}

#[derive(Clone, Debug)]
enum Instruction {
    Eval { to: u32, node: Expr, operands: [Operand; 3], source: Option<(Base, Affine)> },
    Reduce { to: u32, op: ReduceFn, counter: u8, extent: u32, body: Vec<Instruction>, value: Operand },
    Loop { counter: u8, extent: u32, body: Vec<Instruction> },
    Store { to: Destination, value: Operand },
}

#[derive(Clone, Copy, Debug)]
enum Destination {
    Place(Base, Affine),
    Table { table: u32, index: Affine, plus: Affine, add: bool },
}

thread_local! {
    /// Registers of the thread, kept so that a step allocates none.
    static REGISTERS: Cell<Vec<f64>> = const { Cell::new(Vec::new()) };
}

impl Tape {
    /// Prepares a function.
    ///
    /// # Errors
    /// If it addresses what it cannot have.
    pub fn new(staged: &Staged, exprs: &Exprs, layout: &Layout, access: Access) -> Result<Tape, ScheduleError> {
        let mut tape = Tape::default();
        for schedule in schedules(staged, exprs, layout, access)? {
            let mut recorder = Recorder { exprs, layout, schedule: &schedule, registers: FastMap::default(), next: 0, looks_up: false };
            let steps = recorder.block(0);
            tape.registers = tape.registers.max(recorder.next as usize);
            tape.steps.extend(steps);
            if recorder.looks_up && tape.numbers.is_empty() {
                tape.numbers = exprs.lists().all().into();
            }
        }
        Ok(tape)
    }

    /// Returns `true` if it does nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Runs the function.
    pub fn run(&self, view: &mut View<'_>) {
        // A function that is interpreted meanwhile finds none, and makes new ones.
        let mut registers = REGISTERS.take();
        registers.clear();
        registers.resize(self.registers, 0.0);
        let mut machine = Machine { registers, counters: [0; MAX_DEPTH], numbers: &self.numbers, view };
        machine.run(&self.steps);
        REGISTERS.set(machine.registers);
    }
}

struct Recorder<'a> {
    exprs: &'a Exprs,
    layout: &'a Layout,
    schedule: &'a Schedule,
    registers: FastMap<(BlockId, ExprId), u32>,
    next: u32,
    looks_up: bool,
}

impl Recorder<'_> {
    fn block(&mut self, block: BlockId) -> Vec<Instruction> {
        let here = &self.schedule.blocks[block];
        let mut steps: Vec<Instruction> = here.items.iter().map(|item| self.item(block, *item)).collect();
        for &child in &here.children {
            let Some(counter) = self.schedule.blocks[child].counter else {
                continue;
            };
            let extent = self.schedule.blocks[child].extent;
            steps.push(Instruction::Loop { counter, extent, body: self.block(child) });
        }
        steps
    }

    fn item(&mut self, block: BlockId, item: Item) -> Instruction {
        match item {
            Item::Eval(expr) => {
                let node = self.exprs.node(expr);
                let mut operands = [Operand::Const(0.0); 3];
                for (slot, o) in operands.iter_mut().zip(self.exprs.operands(expr)) {
                    *slot = self.operand(block, o);
                }
                self.looks_up |= matches!(node, Expr::Passed(..) | Expr::Entry(..));
                let source = match node {
                    Expr::Load { var, flavour, at } => self.source(var, flavour, at),
                    _ => None,
                };
                Instruction::Eval { to: self.register(block, expr), node, operands, source }
            }
            Item::Reduce { expr, op, body, block: inner } => {
                let steps = self.block(inner);
                let value = self.operand(inner, body);
                let here = &self.schedule.blocks[inner];
                let to = self.register(block, expr);
                Instruction::Reduce { to, op, counter: here.counter.unwrap_or(0), extent: here.extent, body: steps, value }
            }
            Item::Store(store) => Instruction::Store { to: self.destination(store.target), value: self.operand(block, store.value) },
        }
    }

    fn source(&self, var: VarId, flavour: Flavour, at: Affine) -> Option<(Base, Affine)> {
        if self.layout.is_factor(var, at.offset) {
            return Some((Base::Factor, at));
        }
        let address = self.layout.address(var, flavour)?;
        Some((address.base, at.plus(Affine::constant(i64::from(address.offset)))))
    }

    fn destination(&self, Target { place, at }: Target) -> Destination {
        match place {
            Place::Out => Destination::Place(Base::Out, at),
            Place::Var(var) => match self.source(var, Flavour::Value, at) {
                Some((base, at)) => Destination::Place(base, at),
                // The schedule has refused variables without memory.
                None => Destination::Place(Base::Out, at),
            },
            Place::Table { table, plus, add } => Destination::Table { table, index: at, plus, add },
        }
    }

    fn register(&mut self, block: BlockId, expr: ExprId) -> u32 {
        let register = self.next;
        self.next += 1;
        self.registers.insert((block, expr), register);
        register
    }

    fn operand(&self, block: BlockId, expr: ExprId) -> Operand {
        match self.exprs.node(expr) {
            Expr::Const(bits) => Operand::Const(f64::from_bits(bits)),
            Expr::Truth(t) => Operand::Const(f64::from(u8::from(t))),
            _ => {
                let home = self.schedule.home(self.exprs, block, expr);
                // Every value is placed before its use; NaN would show a fault at once.
                self.registers.get(&(home, expr)).map_or(Operand::Const(f64::NAN), |&r| Operand::Register(r))
            }
        }
    }
}

struct Machine<'a, 'v> {
    registers: Vec<f64>,
    counters: [i64; MAX_DEPTH],
    numbers: &'a [f64],
    view: &'a mut View<'v>,
}

impl Machine<'_, '_> {
    fn load(&self, base: Base, at: Affine) -> f64 {
        let i = at.at(&self.counters) as usize;
        match base {
            Base::Y => self.view.y[i],
            Base::Yp => self.view.yp[i],
            Base::Work => self.view.work[i],
            Base::Out => self.view.out[i],
            Base::Factor => self.view.factor,
        }
    }
}

/// Execution of a tape: with numbers, or with numbers that carry derivatives.
trait Run {
    /// A number.
    type Number: Copy;

    /// The counters of the loops.
    fn counters(&mut self) -> &mut [i64; MAX_DEPTH];

    /// An operand's value.
    fn get(&self, operand: Operand) -> Self::Number;

    /// Keeps a value in a register.
    fn set(&mut self, register: u32, value: Self::Number);

    /// The value of a node.
    fn eval(&self, node: Expr, operands: &[Operand; 3], source: Option<(Base, Affine)>) -> Self::Number;

    /// Writes a value.
    fn store(&mut self, to: Destination, value: Operand);

    /// The reduction of nothing.
    fn nothing(op: ReduceFn) -> Self::Number;

    /// A reduction with one more term, which is the `first` one or not.
    fn reduced(op: ReduceFn, first: bool, sum: Self::Number, term: Self::Number) -> Self::Number;

    /// Runs steps one after another.
    fn run(&mut self, steps: &[Instruction]) {
        for step in steps {
            match step {
                Instruction::Eval { to, node, operands, source } => {
                    let value = self.eval(*node, operands, *source);
                    self.set(*to, value);
                }
                Instruction::Reduce { to, op, counter, extent, body, value } => {
                    let outer = self.counters()[*counter as usize];
                    let mut sum = Self::nothing(*op);
                    for i in 0..*extent {
                        self.counters()[*counter as usize] = i64::from(i);
                        self.run(body);
                        sum = Self::reduced(*op, i == 0, sum, self.get(*value));
                    }
                    self.counters()[*counter as usize] = outer;
                    self.set(*to, sum);
                }
                Instruction::Loop { counter, extent, body } => {
                    for i in 0..*extent {
                        self.counters()[*counter as usize] = i64::from(i);
                        self.run(body);
                    }
                }
                Instruction::Store { to, value } => self.store(*to, *value),
            }
        }
    }
}

impl Run for Machine<'_, '_> {
    type Number = f64;

    fn counters(&mut self) -> &mut [i64; MAX_DEPTH] {
        &mut self.counters
    }

    fn set(&mut self, register: u32, value: f64) {
        self.registers[register as usize] = value;
    }

    fn nothing(op: ReduceFn) -> f64 {
        op.identity()
    }

    fn reduced(op: ReduceFn, _: bool, sum: f64, term: f64) -> f64 {
        op.binary().apply(sum, term)
    }

    fn get(&self, operand: Operand) -> f64 {
        match operand {
            Operand::Const(x) => x,
            Operand::Register(r) => self.registers[r as usize],
        }
    }

    fn eval(&self, node: Expr, operands: &[Operand; 3], source: Option<(Base, Affine)>) -> f64 {
        match node {
            Expr::Time => self.view.time,
            Expr::Counter(v) => self.counters[v.0 as usize] as f64,
            Expr::Load { .. } => source.map_or(f64::NAN, |(base, at)| self.load(base, at)),
            _ => apply(node, operands.map(|o| self.get(o)), self.numbers),
        }
    }

    fn store(&mut self, to: Destination, value: Operand) {
        let value = self.get(value);
        match to {
            Destination::Place(base, at) => {
                let i = at.at(&self.counters) as usize;
                match base {
                    Base::Y => self.view.y[i] = value,
                    Base::Work => self.view.work[i] = value,
                    Base::Out => self.view.out[i] = value,
                    Base::Yp | Base::Factor => {}
                }
            }
            Destination::Table { table, index, plus, add } => {
                let entry = self.view.tables[table as usize + index.at(&self.counters) as usize];
                let slot = &mut self.view.out[(i64::from(entry) + plus.at(&self.counters)) as usize];
                *slot = if add { *slot + value } else { value };
            }
        }
    }
}

/// The value of an expression of constants and of what `value_of` knows (variable, copy, element);
/// `None` if it uses anything else.
///
/// For parameters whose numbers are known while the model is built: extents, bounds, exponents.
#[must_use]
pub(crate) fn eval_constant(exprs: &Exprs, expr: ExprId, value_of: &dyn Fn(VarId, Flavour, i64) -> Option<f64>) -> Option<f64> {
    eval_at(exprs, expr, &mut [0; MAX_DEPTH], value_of)
}

/// The value of an expression at given counters; `None` where a value is not known.
pub(crate) fn eval_at(
    exprs: &Exprs,
    expr: ExprId,
    counters: &mut [i64; MAX_DEPTH],
    value_of: &dyn Fn(VarId, Flavour, i64) -> Option<f64>,
) -> Option<f64> {
    evaluate(exprs, expr, counters, (value_of, &|_, _| None), &mut FastMap::default())
}

/// The value of an expression at counters of zero, in which nodes have other values: `other` gives
/// one for a node and the values of its operands, or nothing.
pub(crate) fn eval_otherwise(
    exprs: &Exprs,
    expr: ExprId,
    value_of: &dyn Fn(VarId, Flavour, i64) -> Option<f64>,
    other: &Otherwise<'_>,
) -> Option<f64> {
    evaluate(exprs, expr, &mut [0; MAX_DEPTH], (value_of, other), &mut FastMap::default())
}

/// Values of nodes by the values of their operands.
type Otherwise<'a> = dyn Fn(Expr, [f64; 3]) -> Option<f64> + 'a;

/// Evaluates at given counters; `known` holds the values at these counters. Only reductions
/// recurse, at most as deep as loops nest.
fn evaluate(
    exprs: &Exprs,
    expr: ExprId,
    counters: &mut [i64; MAX_DEPTH],
    (value_of, other): (&dyn Fn(VarId, Flavour, i64) -> Option<f64>, &Otherwise<'_>),
    known: &mut FastMap<ExprId, f64>,
) -> Option<f64> {
    let mut stack = vec![expr];
    while let Some(&top) = stack.last() {
        if known.contains_key(&top) {
            stack.pop();
            continue;
        }
        let node = exprs.node(top);
        let missing = |o: &ExprId| !known.contains_key(o);
        let waits = match node {
            Expr::Reduce { .. } => None,
            _ => exprs.operands(top).find(missing),
        };
        if let Some(operand) = waits {
            stack.push(operand);
            continue;
        }
        let mut operands = [0.0; 3];
        for (slot, o) in operands.iter_mut().zip(exprs.operands(top)) {
            *slot = known.get(&o).copied().unwrap_or(f64::NAN);
        }
        if let Some(value) = other(node, operands) {
            known.insert(top, value);
            continue;
        }
        let value = match node {
            Expr::Const(bits) => f64::from_bits(bits),
            Expr::Truth(t) => f64::from(u8::from(t)),
            Expr::Time => return None,
            Expr::Counter(v) => counters[v.0 as usize] as f64,
            Expr::Load { var, flavour, at } => value_of(var, flavour, at.at(counters))?,
            Expr::Reduce { op, depth, extent, body } => {
                let d = depth.0 as usize;
                let outer = counters[d];
                let mut sum = op.identity();
                for i in 0..extent {
                    counters[d] = i64::from(i);
                    sum = op.binary().apply(sum, evaluate(exprs, body, counters, (value_of, other), &mut FastMap::default())?);
                }
                counters[d] = outer;
                sum
            }
            _ => apply(node, operands, exprs.lists().all()),
        };
        known.insert(top, value);
    }
    known.get(&expr).copied()
}

/// A node's value from its operands' values, and the numbers of all lists; NaN for leaves and
/// reductions, which have none.
fn apply(node: Expr, [a, b, c]: [f64; 3], numbers: &[f64]) -> f64 {
    let of = |list: List| numbers.get(list.range()).unwrap_or_default();
    let truth = |t: bool| f64::from(u8::from(t));
    match node {
        Expr::Unary(f, _) => f.apply(a),
        Expr::Binary(f, ..) => f.apply(a, b),
        Expr::PowInt(_, n) => kernels::powi(a, n),
        Expr::Compare(op, ..) => truth(op.apply(a, b)),
        Expr::And(..) => truth(a != 0.0 && b != 0.0),
        Expr::Or(..) => truth(a != 0.0 || b != 0.0),
        Expr::Not(_) => truth(a == 0.0),
        Expr::Select(..) if a != 0.0 => b,
        Expr::Select(..) => c,
        Expr::Passed(limits, side, _) => kernels::passed(of(limits), side == Side::UpTo, a),
        Expr::Entry(list, _) => kernels::entry(of(list), a),
        Expr::Const(_) | Expr::Truth(_) | Expr::Time | Expr::Counter(_) | Expr::Load { .. } | Expr::Reduce { .. } => f64::NAN,
    }
}
