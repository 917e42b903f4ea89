//! Bodies of Python functions on arrays, for CasADi and for JAX.

use std::fmt::Write as _;
use std::rc::Rc;

use super::arrays::{ArrayOperation, Arrays, Id, Op, loops};
use super::functions::spread;
use super::sheet::{Array, Extents, Loops};
use super::spelling::Spellings;
use crate::ir::{BinaryFn, Compare, FastMap, MAX_DEPTH, ReduceFn};
use crate::schedule::row_major;

/// The library that the text is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Library {
    /// Values are columns, the last axis fastest.
    Casadi,
    /// Values have an axis of length 1 for each counter that they do not depend on; single numbers
    /// have no axes.
    Jax,
}

/// Index lists and lists of numbers of a module; equal ones are one.
#[derive(Default)]
pub(super) struct Lists {
    list: Vec<Vec<u32>>,
    known: FastMap<Vec<u32>, usize>,
    numbers: Vec<Rc<[f64]>>,
}

impl Lists {
    fn name(&mut self, numbers: Vec<u32>) -> String {
        let number = *self.known.entry(numbers.clone()).or_insert_with(|| {
            self.list.push(numbers);
            self.list.len() - 1
        });
        format!("_I{number}")
    }

    fn name_of_numbers(&mut self, numbers: &Rc<[f64]>) -> String {
        let equal = |known: &Rc<[f64]>| known.iter().map(|x| x.to_bits()).eq(numbers.iter().map(|x| x.to_bits()));
        let number = self.numbers.iter().position(equal).unwrap_or_else(|| {
            self.numbers.push(Rc::clone(numbers));
            self.numbers.len() - 1
        });
        format!("_T{number}")
    }

    /// The definitions of all lists; `wrap` is what they are made into.
    pub(super) fn print(&self, wrap: impl Fn(&str) -> String) -> String {
        let mut text = String::new();
        for (number, numbers) in self.numbers.iter().enumerate() {
            let list = format!("[{}]", numbers.iter().map(|x| self::number(*x)).collect::<Vec<_>>().join(", "));
            let _ = writeln!(text, "_T{number} = {}", wrap(&list));
        }
        for (number, numbers) in self.list.iter().enumerate() {
            let list = format!("[{}]", numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(", "));
            // Writing into a string does not fail.
            let _ = writeln!(text, "_I{number} = {}", wrap(&list));
        }
        text
    }

    /// A subscript: a number, a slice, or a list.
    fn subscript(&mut self, positions: &[u32]) -> String {
        let (Some(&first), Some(&last)) = (positions.first(), positions.last()) else { return "0:0".into() };
        let step = positions.get(1).map_or(1, |&second| i64::from(second) - i64::from(first));
        let even = positions.windows(2).all(|pair| i64::from(pair[1]) - i64::from(pair[0]) == step);
        match (positions.len(), even && step > 0, step) {
            (1, ..) => first.to_string(),
            (_, true, 1) => format!("{first}:{}", last + 1),
            (_, true, step) => format!("{first}:{}:{step}", last + 1),
            _ => self.name(positions.to_vec()),
        }
    }
}

/// Values of an output: their texts in order, and the position of each number.
#[derive(Default)]
struct Pieces {
    texts: Vec<String>,
    positions: Vec<u32>,
}

/// The statements of a function; an output is called `out`.
pub(super) struct Body<'a> {
    library: Library,
    spellings: Spellings,
    arrays: &'a Arrays,
    lists: &'a mut Lists,
    text: String,
    names: Vec<String>,
    /// Values spread over more axes.
    spreads: FastMap<(Id, Extents), String>,
    rank: usize,
    pieces: Pieces,
}

impl<'a> Body<'a> {
    pub(super) fn new((library, spellings): (Library, Spellings), arrays: &'a Arrays, lists: &'a mut Lists) -> Self {
        let reduced = |op: &Op| if let Op::Reduce { depth, .. } = op { *depth as usize + 1 } else { 0 };
        let deepest = |v: &super::arrays::Value| (0..MAX_DEPTH).rev().find(|&d| v.axes[d] > 0).map_or(0, |d| d + 1).max(reduced(&v.op));
        let rank = arrays.values.iter().map(deepest).max().unwrap_or(0);
        let names = vec![String::new(); arrays.values.len()];
        Body { library, spellings, arrays, lists, text: String::new(), names, spreads: FastMap::default(), rank, pieces: Pieces::default() }
    }

    /// The statements; `length` is that of the output, `None` for updates.
    pub(super) fn print(mut self, length: Option<usize>) -> String {
        for step in &self.arrays.steps {
            match step {
                ArrayOperation::Define(id) => self.define(*id),
                ArrayOperation::Store { array, loops, positions, value } => self.store(*array, loops, positions, *value),
            }
        }
        if let Some(length) = length {
            self.assemble(length);
        }
        self.text
    }

    fn line(&mut self, content: &str) {
        let _ = writeln!(self.text, "    {content}");
    }

    fn define(&mut self, id: Id) {
        let value = &self.arrays.values[id];
        let axes = value.axes;
        let o = |body: &mut Self, operand: Id| body.operand(operand, &axes);
        let text = match &value.op {
            Op::Const(x) => {
                self.names[id] = number(*x);
                return;
            }
            Op::Truth(t) => {
                self.names[id] = (if *t { "1.0" } else { "0.0" }).to_owned();
                return;
            }
            Op::Time => {
                self.names[id] = "t".to_owned();
                return;
            }
            Op::Counter(d) => self.counter(*d, axes[*d as usize]),
            Op::Load { array, loops, positions } => self.load(*array, loops, positions, &axes),
            Op::Unary(f, a) => (self.spellings)(*f).applied(&o(self, *a)),
            Op::Binary(f, a, b) => binary(self.library, *f, &o(self, *a), &o(self, *b)),
            Op::PowInt(a, n) => format!("{} ** {n}", o(self, *a)),
            Op::Passed(limits, up_to, a) => {
                let (a, limits) = (o(self, *a), self.lists.name_of_numbers(limits));
                format!("_passed({limits}, {a}, {})", if *up_to { "True" } else { "False" })
            }
            Op::Entry(list, a) => {
                let (a, list) = (o(self, *a), self.lists.name_of_numbers(list));
                format!("_entry({list}, {a})")
            }
            Op::Compare(f, a, b) => compare(self.library, *f, &o(self, *a), &o(self, *b)),
            Op::And(a, b) => format!("_and({}, {})", o(self, *a), o(self, *b)),
            Op::Or(a, b) => format!("_or({}, {})", o(self, *a), o(self, *b)),
            Op::Not(a) => format!("_not({})", o(self, *a)),
            Op::Select(c, a, b) => format!("_where({}, {}, {})", o(self, *c), o(self, *a), o(self, *b)),
            Op::Reduce { op, depth, extent, body } => self.reduce(*op, *depth, *extent, *body, &axes),
        };
        self.names[id] = format!("v{id}");
        self.line(&format!("v{id} = {text}"));
    }

    /// The text of a value where one with certain axes is computed.
    fn operand(&mut self, id: Id, axes: &Extents) -> String {
        let own = self.arrays.values[id].axes;
        if self.library == Library::Jax || own == *axes || own == [0; MAX_DEPTH] {
            return self.names[id].clone();
        }
        if let Some(known) = self.spreads.get(&(id, *axes)) {
            return known.clone();
        }
        let (from, to) = (loops(&own), loops(axes));
        let numbers: Vec<u32> = (0..count(&from)).collect();
        let subscript = self.lists.subscript(&spread(&to, &from, &numbers));
        let name = format!("s{}_{}", id, self.spreads.len());
        let text = format!("{name} = {}[{subscript}]", self.names[id]);
        self.line(&text);
        self.spreads.insert((id, *axes), name.clone());
        name
    }

    fn counter(&self, depth: u8, extent: u32) -> String {
        match self.library {
            Library::Casadi => format!("ca.DM(list(range({extent})))"),
            Library::Jax => {
                let mut axes = [0; MAX_DEPTH];
                axes[depth as usize] = extent;
                format!("np.arange({extent}.0){}", self.reshape(&axes))
            }
        }
    }

    fn load(&mut self, array: Array, loops: &Loops, positions: &[u32], axes: &Extents) -> String {
        let subscript = self.lists.subscript(positions);
        let single = loops.is_empty() || positions.len() == 1;
        let text = format!("{}[{subscript}]", name(array));
        match self.library {
            Library::Jax if single && loops.is_empty() => text,
            Library::Jax => format!("{text}{}", self.reshape(axes)),
            Library::Casadi => text,
        }
    }

    /// `.reshape(1, 40)`, or nothing where the shape is right already.
    fn reshape(&self, axes: &Extents) -> String {
        if self.rank == 1 && axes[0] > 1 { String::new() } else { format!(".reshape({})", self.shape(axes)) }
    }

    /// `1, 40`
    fn shape(&self, axes: &Extents) -> String {
        axes.iter().take(self.rank).map(|n| (*n).max(1).to_string()).collect::<Vec<_>>().join(", ")
    }

    fn reduce(&mut self, op: ReduceFn, depth: u8, extent: u32, body: Id, axes: &Extents) -> String {
        let (text, inside) = (self.names[body].clone(), self.arrays.values[body].axes);
        if inside[depth as usize] == 0 {
            return match op {
                ReduceFn::Sum => format!("{text} * {extent}.0"),
                ReduceFn::Product => format!("{text} ** {extent}"),
                ReduceFn::Min | ReduceFn::Max => text,
            };
        }
        match self.library {
            Library::Jax => {
                let function = match op {
                    ReduceFn::Sum => "sum",
                    ReduceFn::Product => "prod",
                    ReduceFn::Min => "min",
                    ReduceFn::Max => "max",
                };
                let whole = if *axes == [0; MAX_DEPTH] { ".reshape(())" } else { "" };
                format!("jnp.{function}({text}, axis={depth}, keepdims=True){whole}")
            }
            Library::Casadi => self.reduce_columns(op, depth, extent, &text, &inside),
        }
    }

    /// The reduced axis becomes the rows of a matrix, all others its columns.
    fn reduce_columns(&mut self, op: ReduceFn, depth: u8, extent: u32, text: &str, inside: &Extents) -> String {
        let (all, mut rest) = (loops(inside), loops(inside));
        rest.retain(|l| l.0 != depth);
        let columns = count(&rest);
        let is_last = all.last().is_some_and(|l| l.0 == depth);
        let mut ordered = text.to_owned();
        if !is_last {
            let numbers: Vec<u32> = (0..count(&all)).collect();
            let order: Loops = rest.iter().copied().chain([(depth, extent)]).collect();
            let index = row_major(&all);
            let mut positions = vec![];
            crate::differentiate::pattern::each(&order, |c| positions.push(numbers[index.at(c) as usize]));
            ordered = format!("{text}[{}]", self.lists.subscript(&positions));
        }
        let function = match op {
            ReduceFn::Sum if columns == 1 => return format!("ca.sum1({ordered})"),
            ReduceFn::Sum => return format!("ca.sum1(ca.reshape({ordered}, {extent}, {columns})).T"),
            ReduceFn::Product => "_product",
            ReduceFn::Min => "_min",
            ReduceFn::Max => "_max",
        };
        format!("_fold({function}, ca.reshape({ordered}, {extent}, {columns}))")
    }

    fn store(&mut self, array: Option<Array>, to: &Loops, positions: &[u32], value: Id) {
        let spread = self.spread_over(to, value);
        match array {
            None => {
                self.pieces.texts.push(spread);
                self.pieces.positions.extend(positions);
            }
            Some(array) => {
                let subscript = self.lists.subscript(positions);
                let name = name(array);
                self.line(&match self.library {
                    Library::Casadi => format!("{name} = _set({name}, {}, {spread})", slice(&subscript)),
                    Library::Jax => format!("{name} = {name}.at[{subscript}].set({spread})"),
                });
            }
        }
    }

    /// A value as numbers one after another, one for each pass.
    fn spread_over(&mut self, to: &Loops, value: Id) -> String {
        let mut axes = [0; MAX_DEPTH];
        to.iter().for_each(|&(d, extent)| axes[d as usize] = extent);
        let passes = count(to);
        let own = self.arrays.values[value].axes;
        let truth = self.arrays.values[value].truth && self.library == Library::Jax;
        let number = if truth { format!("_number({})", self.names[value]) } else { self.names[value].clone() };
        match self.library {
            Library::Casadi if own == [0; MAX_DEPTH] && passes > 1 => format!("ca.repmat({number}, {passes}, 1)"),
            Library::Casadi => self.operand(value, &axes),
            Library::Jax if to.is_empty() => number,
            Library::Jax if own == [0; MAX_DEPTH] => format!("jnp.full({passes}, {number})"),
            Library::Jax if own == axes => format!("{number}.ravel()"),
            Library::Jax => format!("jnp.broadcast_to({number}, ({},)).ravel()", self.shape(&axes)),
        }
    }

    /// The output from its pieces.
    fn assemble(&mut self, length: usize) {
        let mut pieces = std::mem::take(&mut self.pieces);
        let mut order = vec![u32::MAX; length];
        for (at, &position) in (0..).zip(&pieces.positions) {
            if let Some(slot) = order.get_mut(position as usize) {
                *slot = at;
            }
        }
        if order.contains(&u32::MAX) {
            // What nothing is stored to is zero.
            let zero = pieces.positions.len() as u32;
            order.iter_mut().filter(|at| **at == u32::MAX).for_each(|at| *at = zero);
            pieces.texts.push("0.0".into());
        }
        let joined = format!("_join([{}])", pieces.texts.join(", "));
        let in_order = order.len() == pieces.positions.len() && order.iter().zip(0..).all(|(&at, i)| at == i);
        let subscript = if in_order { String::new() } else { format!("[{}]", self.lists.subscript(&order)) };
        let text = match (self.library, order.len()) {
            _ if in_order => joined,
            (Library::Jax, 1) => format!("{joined}{subscript}.reshape(1)"),
            _ => format!("{joined}{subscript}"),
        };
        self.line(&format!("out = {text}"));
    }
}

/// A subscript as an argument.
fn slice(subscript: &str) -> String {
    if subscript.contains(':') { format!("slice({})", subscript.replace(':', ", ")) } else { subscript.to_owned() }
}

fn count(loops: &Loops) -> u32 {
    loops.iter().map(|l| l.1).product()
}

/// The vector of an array.
pub(super) fn name(array: Array) -> &'static str {
    match array {
        Array::Y => "y",
        Array::Yp => "yp",
        Array::U => "u",
        Array::P => "p",
        Array::C => "c",
        Array::W => "w",
        Array::Factor => "cj",
    }
}

/// A number that Python reads back to the same bits.
fn number(x: f64) -> String {
    if x.is_nan() {
        "nan".to_owned()
    } else if x.is_infinite() {
        (if x > 0.0 { "inf" } else { "(-inf)" }).to_owned()
    } else if x < 0.0 {
        format!("({x:?})")
    } else {
        format!("{x:?}")
    }
}

fn binary(library: Library, f: BinaryFn, a: &str, b: &str) -> String {
    match f {
        BinaryFn::Add => format!("{a} + {b}"),
        BinaryFn::Sub => format!("{a} - {b}"),
        BinaryFn::Mul => format!("{a} * {b}"),
        BinaryFn::Div => format!("{a} / {b}"),
        BinaryFn::Pow => format!("{a} ** {b}"),
        BinaryFn::Min => format!("_min({a}, {b})"),
        BinaryFn::Max => format!("_max({a}, {b})"),
        BinaryFn::Atan2 if library == Library::Casadi => format!("ca.atan2({a}, {b})"),
        BinaryFn::Atan2 => format!("jnp.arctan2({a}, {b})"),
    }
}

fn compare(library: Library, f: Compare, a: &str, b: &str) -> String {
    match (library, f) {
        (Library::Casadi, Compare::Lt) => format!("_less({a}, {b})"),
        (Library::Casadi, Compare::Le) => format!("_less_equal({a}, {b})"),
        (_, Compare::Lt) => format!("{a} < {b}"),
        (_, Compare::Le) => format!("{a} <= {b}"),
        (_, Compare::Eq) => format!("{a} == {b}"),
        (_, Compare::Ne) => format!("{a} != {b}"),
    }
}
