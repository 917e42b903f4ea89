//! Bodies of C functions: each value is computed in the innermost loop whose counter it depends on,
//! once.
//!
//! The loops around the present place are a stack of texts. A value is written into the text of its
//! loop, before any open loop inside of it. When a loop is closed its text goes into the one around
//! it.

use std::fmt::Write as _;

use super::index::{Tables, number, subscript};
use super::names::spelling;
use crate::export::ExportError;
use crate::export::functions::extents;
use crate::export::sheet::{Array, Extents, Function, Loops, Nest, Sheet, Store};
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, FastMap, FastSet, Flavour, List, LoopVar, ReduceFn, Side, UnaryFn, VarId};
use crate::kernels::power_chain;

/// A block of the text.
#[derive(Default)]
struct Scope {
    /// The loop; `None` for a plain block.
    counter: Option<(u8, u32)>,
    text: String,
    /// Names of the values computed here.
    known: FastMap<ExprId, String>,
}

/// The body of a function in the making.
pub(super) struct Body<'s> {
    sheet: &'s Sheet,
    tables: &'s mut Tables,
    prefix: &'s str,
    scopes: Vec<Scope>,
    /// Nothing is placed further out: what is read there may change meanwhile.
    floor: usize,
    names: usize,
}

impl<'s> Body<'s> {
    pub(super) fn new(sheet: &'s Sheet, tables: &'s mut Tables, prefix: &'s str) -> Self {
        Body { sheet, tables, prefix, scopes: vec![Scope::default()], floor: 0, names: 0 }
    }

    /// The statements of a function.
    pub(super) fn print(mut self, function: &Function) -> Result<String, ExportError> {
        if function.update {
            for nest in &function.nests {
                self.update(nest)?;
            }
        } else {
            self.values(&function.nests)?;
        }
        Ok(self.text())
    }

    /// Nests that read nothing of what they store, those over the same loops together.
    pub(super) fn values(&mut self, nests: &[Nest]) -> Result<(), ExportError> {
        let mut groups: Vec<(&Loops, Vec<&Store>)> = vec![];
        for nest in nests {
            match groups.iter_mut().find(|(loops, _)| **loops == nest.loops) {
                Some((_, stores)) => stores.extend(&nest.stores),
                None => groups.push((&nest.loops, nest.stores.iter().collect())),
            }
        }
        for (loops, stores) in groups {
            self.open(loops);
            for store in stores {
                self.place(store.value)?;
                self.store(loops, store);
            }
            self.close(loops.len());
        }
        Ok(())
    }

    /// The text so far.
    pub(super) fn text(mut self) -> String {
        self.scopes.swap_remove(0).text
    }

    /// A nest that may read what others have stored: its values are all read in place, then stored.
    fn update(&mut self, nest: &Nest) -> Result<(), ExportError> {
        self.open(&nest.loops);
        self.scopes.push(Scope::default());
        self.floor = self.scopes.len() - 1;
        for store in &nest.stores {
            self.place(store.value)?;
        }
        for store in &nest.stores {
            self.store(&nest.loops, store);
        }
        self.floor = 0;
        self.close(nest.loops.len() + 1);
        Ok(())
    }

    fn open(&mut self, loops: &Loops) {
        self.scopes.extend(loops.iter().map(|&counter| Scope { counter: Some(counter), ..Scope::default() }));
    }

    /// Ends the innermost scopes.
    fn close(&mut self, count: usize) {
        for _ in 0..count {
            let Some(scope) = self.scopes.pop() else { return };
            let indent = "    ".repeat(self.scopes.len());
            let head = match scope.counter {
                Some((d, extent)) => format!("for (int i{d} = 0; i{d} < {extent}; ++i{d}) {{"),
                None => "{".to_owned(),
            };
            if let Some(outer) = self.scopes.last_mut() {
                let _ = writeln!(outer.text, "{indent}{head}\n{}{indent}}}", scope.text);
            }
        }
    }

    fn line(&mut self, scope: usize, content: &str) {
        let indent = "    ".repeat(scope + 1);
        let _ = writeln!(self.scopes[scope].text, "{indent}{content}");
    }

    fn store(&mut self, loops: &Loops, store: &Store) {
        let at = subscript(loops, &store.positions, self.tables);
        let array = store.array.map_or("out", name);
        let value = self.operand(store.value);
        let value = if self.sheet.model.exprs.is_truth(store.value) { format!("{value} ? 1.0 : 0.0") } else { value };
        let sign = if store.add { "+=" } else { "=" };
        self.line(self.scopes.len() - 1, &format!("{array}[{at}] {sign} {value};"));
    }

    /// The scope where a value that is needed here belongs.
    fn home(&self, expr: ExprId) -> usize {
        let free = self.sheet.model.exprs.free(expr);
        let bound = |scope: &Scope| scope.counter.is_some_and(|(d, _)| free & (1 << d) != 0);
        self.scopes.iter().rposition(bound).unwrap_or(0).max(self.floor.min(self.scopes.len() - 1))
    }

    fn known(&self, expr: ExprId) -> Option<&String> {
        self.scopes[self.home(expr)].known.get(&expr)
    }

    /// Computes a value and all it needs; only reductions recurse.
    fn place(&mut self, root: ExprId) -> Result<(), ExportError> {
        let exprs = &self.sheet.model.exprs;
        let mut missing = FastSet::default();
        let mut stack = vec![root];
        while let Some(expr) = stack.pop() {
            let node = exprs.node(expr);
            let written = matches!(node, Expr::Const(_) | Expr::Truth(_)) || self.known(expr).is_some();
            if !written && missing.insert(expr) && !matches!(node, Expr::Reduce { .. }) {
                stack.extend(exprs.operands(expr));
            }
        }
        // Operands have smaller numbers than what uses them.
        let mut missing: Vec<ExprId> = missing.into_iter().collect();
        missing.sort_unstable();
        missing.into_iter().try_for_each(|expr| self.define(expr))
    }

    /// Writes the statement of a value whose operands are there.
    fn define(&mut self, expr: ExprId) -> Result<(), ExportError> {
        let home = self.home(expr);
        let node = self.sheet.model.exprs.node(expr);
        let value = match node {
            Expr::Load { var, flavour, at } => {
                let text = self.load(var, flavour, at)?;
                if self.floor == 0 { text } else { self.name(home, "double", &text) }
            }
            Expr::Time => "t".to_owned(),
            Expr::Counter(LoopVar(d)) => format!("(double)i{d}"),
            Expr::PowInt(a, n) => self.power(home, a, n),
            Expr::Passed(list, side, a) => {
                let function = if side == Side::UpTo { "passed_up_to" } else { "passed_below" };
                self.look_up(home, function, list, a)
            }
            Expr::Entry(list, a) => self.look_up(home, "entry", list, a),
            Expr::Reduce { op, depth, extent, body } => self.reduce(home, op, (depth.0, extent), body)?,
            _ => {
                let kind = if self.sheet.model.exprs.is_truth(expr) { "int" } else { "double" };
                let text = self.operation(node);
                self.name(home, kind, &text)
            }
        };
        self.scopes[home].known.insert(expr, value);
        Ok(())
    }

    fn name(&mut self, scope: usize, kind: &str, value: &str) -> String {
        let name = format!("v{}", self.names);
        self.names += 1;
        self.line(scope, &format!("const {kind} {name} = {value};"));
        name
    }

    /// The text of a value that is there.
    fn operand(&self, expr: ExprId) -> String {
        match self.sheet.model.exprs.node(expr) {
            Expr::Const(bits) => number(f64::from_bits(bits)),
            Expr::Truth(t) => u8::from(t).to_string(),
            // Every value is placed before its use; NAN would show a fault at once.
            _ => self.known(expr).cloned().unwrap_or_else(|| "NAN".into()),
        }
    }

    fn load(&mut self, var: VarId, flavour: Flavour, at: Affine) -> Result<String, ExportError> {
        let read = self.sheet.read(var, flavour, at, &self.around())?;
        if read.array == Array::Factor {
            return Ok("cj".to_owned());
        }
        let at = subscript(&read.loops, &read.positions, self.tables);
        Ok(format!("{}[{at}]", name(read.array)))
    }

    /// Passes of the loops around, the innermost of each counter.
    fn around(&self) -> Extents {
        extents(&self.scopes.iter().filter_map(|scope| scope.counter).collect())
    }

    fn look_up(&mut self, home: usize, function: &str, list: List, a: ExprId) -> String {
        let numbers = self.tables.numbers(self.sheet.model.exprs.lists().of(list));
        let text = format!("{}_{function}({}, {numbers}, {})", self.prefix, self.operand(a), list.len);
        self.name(home, "double", &text)
    }

    /// `x^n` by the multiplications of the machine code.
    fn power(&mut self, home: usize, a: ExprId, n: i32) -> String {
        let base = self.operand(a);
        let mut values = vec![base];
        let chained = power_chain(n.unsigned_abs(), 0, |x: usize, y: usize| {
            let product = format!("{} * {}", values[x], values[y]);
            let name = self.name(home, "double", &product);
            values.push(name);
            values.len() - 1
        });
        let power = chained.map_or_else(|| "1.0".to_owned(), |at| values[at].clone());
        if n < 0 { self.name(home, "double", &format!("1.0 / {power}")) } else { power }
    }

    fn reduce(&mut self, home: usize, op: ReduceFn, counter: (u8, u32), body: ExprId) -> Result<String, ExportError> {
        let name = format!("v{}", self.names);
        self.names += 1;
        self.line(home, &format!("double {name} = {};", number(op.identity())));
        let inside = self.scopes.split_off(home + 1);
        self.scopes.push(Scope { counter: Some(counter), ..Scope::default() });
        self.place(body)?;
        let term = self.operand(body);
        let prefix = self.prefix;
        let step = match op {
            ReduceFn::Sum => format!("{name} += {term};"),
            ReduceFn::Product => format!("{name} *= {term};"),
            ReduceFn::Min => format!("{name} = {prefix}_min({name}, {term});"),
            ReduceFn::Max => format!("{name} = {prefix}_max({name}, {term});"),
        };
        self.line(home + 1, &step);
        self.close(1);
        self.scopes.extend(inside);
        Ok(name)
    }

    fn operation(&self, node: Expr) -> String {
        let o = |e| self.operand(e);
        let prefix = self.prefix;
        match node {
            Expr::Unary(f, a) => unary(f, &o(a), prefix),
            Expr::Binary(f, a, b) => match f {
                BinaryFn::Add => format!("{} + {}", o(a), o(b)),
                BinaryFn::Sub => format!("{} - {}", o(a), o(b)),
                BinaryFn::Mul => format!("{} * {}", o(a), o(b)),
                BinaryFn::Div => format!("{} / {}", o(a), o(b)),
                BinaryFn::Pow => format!("pow({}, {})", o(a), o(b)),
                BinaryFn::Atan2 => format!("atan2({}, {})", o(a), o(b)),
                BinaryFn::Min => format!("{prefix}_min({}, {})", o(a), o(b)),
                BinaryFn::Max => format!("{prefix}_max({}, {})", o(a), o(b)),
            },
            Expr::Compare(f, a, b) => {
                let sign = match f {
                    Compare::Lt => "<",
                    Compare::Le => "<=",
                    Compare::Eq => "==",
                    Compare::Ne => "!=",
                };
                format!("{} {sign} {}", o(a), o(b))
            }
            Expr::And(a, b) => format!("{} && {}", o(a), o(b)),
            Expr::Or(a, b) => format!("{} || {}", o(a), o(b)),
            Expr::Not(a) => format!("!{}", o(a)),
            Expr::Select(c, a, b) => format!("{} ? {} : {}", o(c), o(a), o(b)),
            // The others have been written already.
            _ => "NAN".to_owned(),
        }
    }
}

fn unary(f: UnaryFn, a: &str, prefix: &str) -> String {
    let spelling = spelling(f);
    let prefix = if spelling.name.starts_with('_') { prefix } else { "" };
    format!("{prefix}{}", spelling.applied(a))
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
