//! Expressions of SBML: read from MathML, checked, worked out at the start.

use std::collections::HashMap;

use roxmltree::Node;

use super::xml::{Fault, attribute, children, fault, number, tag};

/// Elements of MathML inside one another.
const DEEPEST: usize = 200;

/// Name of the operator that gives an earlier value.
pub(super) const DELAY: &str = "delay";

/// Nodes of one expression with its functions put in.
const MOST_NODES: usize = 100_000;

/// An expression.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Math {
    /// A number, with the id of its unit where it has one.
    Number(f64, Option<String>),
    /// A symbol of the model by its id.
    Name(String),
    Time,
    /// A constant of the language.
    Constant(&'static str),
    /// The time derivative of a symbol.
    RateOf(String),
    /// A function or operator with its arguments.
    Apply(&'static str, Vec<Math>),
    /// Values with their conditions, then what holds otherwise.
    Piecewise(Vec<(Math, Math)>, Box<Math>),
    /// A function of the model, until it is put in.
    Call(String, Vec<Math>),
}

/// A function definition: names of its arguments, and its value.
pub(super) type Functions = HashMap<String, (Vec<String>, Math)>;

/// Operators and functions of MathML: name there, name here, fewest and most arguments.
const OPERATORS: [(&str, &str, usize, usize); 50] = [
    ("plus", "+", 0, usize::MAX),
    ("times", "*", 0, usize::MAX),
    ("minus", "-", 1, 2),
    ("divide", "/", 2, 2),
    ("power", "^", 2, 2),
    ("exp", "exp", 1, 1),
    ("ln", "ln", 1, 1),
    ("abs", "abs", 1, 1),
    ("floor", "floor", 1, 1),
    ("ceiling", "ceil", 1, 1),
    ("sin", "sin", 1, 1),
    ("cos", "cos", 1, 1),
    ("tan", "tan", 1, 1),
    ("sec", "sec", 1, 1),
    ("csc", "csc", 1, 1),
    ("cot", "cot", 1, 1),
    ("sinh", "sinh", 1, 1),
    ("cosh", "cosh", 1, 1),
    ("tanh", "tanh", 1, 1),
    ("sech", "sech", 1, 1),
    ("csch", "csch", 1, 1),
    ("coth", "coth", 1, 1),
    ("arcsin", "asin", 1, 1),
    ("arccos", "acos", 1, 1),
    ("arctan", "atan", 1, 1),
    ("arcsinh", "arcsinh", 1, 1),
    ("arccosh", "arccosh", 1, 1),
    ("arctanh", "arctanh", 1, 1),
    ("arccot", "arccot", 1, 1),
    ("arcsec", "arcsec", 1, 1),
    ("arccsc", "arccsc", 1, 1),
    ("arccoth", "arccoth", 1, 1),
    ("arcsech", "arcsech", 1, 1),
    ("arccsch", "arccsch", 1, 1),
    ("factorial", "factorial", 1, 1),
    ("eq", "==", 2, usize::MAX),
    ("neq", "!=", 2, 2),
    ("gt", ">", 2, usize::MAX),
    ("lt", "<", 2, usize::MAX),
    ("geq", ">=", 2, usize::MAX),
    ("leq", "<=", 2, usize::MAX),
    ("and", "and", 0, usize::MAX),
    ("or", "or", 0, usize::MAX),
    ("xor", "xor", 0, usize::MAX),
    ("not", "not", 1, 1),
    ("implies", "implies", 2, 2),
    ("max", "max", 1, usize::MAX),
    ("min", "min", 1, usize::MAX),
    ("quotient", "quotient", 2, 2),
    ("rem", "rem", 2, 2),
];

/// Reads the expression of an element `math`.
pub(super) fn read(math: Node<'_, '_>) -> Result<Math, Fault> {
    let inside: Vec<Node<'_, '_>> = children(math).collect();
    match inside[..] {
        [one] => expression(one, 0),
        _ => Err(fault(math, "`math` holds one expression")),
    }
}

/// The arguments and the value of a function definition.
pub(super) fn read_function(math: Node<'_, '_>) -> Result<(Vec<String>, Math), Fault> {
    let inside: Vec<Node<'_, '_>> = children(math).collect();
    let lambda = match inside[..] {
        [one] if tag(one) == "lambda" => Some(one),
        _ => None,
    };
    let lambda = lambda.ok_or_else(|| fault(math, "a function definition holds a `lambda`"))?;
    let mut arguments = vec![];
    let mut value = None;
    for part in children(lambda) {
        if tag(part) == "bvar" {
            let name = children(part).next().ok_or_else(|| fault(part, "`bvar` without a name"))?;
            arguments.push(text(name));
        } else if value.replace(expression(part, 0)?).is_some() {
            return Err(fault(part, "a second value in a `lambda`"));
        }
    }
    Ok((arguments, value.ok_or_else(|| fault(lambda, "a `lambda` without a value"))?))
}

fn text(node: Node<'_, '_>) -> String {
    node.text().unwrap_or_default().trim().to_owned()
}

fn expression(node: Node<'_, '_>, depth: usize) -> Result<Math, Fault> {
    if depth > DEEPEST {
        return Err(fault(node, format!("more than {DEEPEST} elements of MathML inside one another")));
    }
    Ok(match tag(node) {
        "cn" => constant(node)?,
        "ci" => Math::Name(text(node)),
        "csymbol" => symbol(node)?,
        "apply" => apply(node, depth)?,
        "piecewise" => piecewise(node, depth)?,
        "true" => Math::Constant("true"),
        "false" => Math::Constant("false"),
        "pi" => Math::Constant("pi"),
        "exponentiale" => Math::Constant("e"),
        "infinity" => Math::Constant("inf"),
        "notanumber" => Math::Number(f64::NAN, None),
        "semantics" => match children(node).next() {
            Some(inner) => expression(inner, depth + 1)?,
            None => return Err(fault(node, "`semantics` without an expression")),
        },
        other => return Err(fault(node, format!("`{other}` of MathML has no counterpart"))),
    })
}

fn constant(node: Node<'_, '_>) -> Result<Math, Fault> {
    let parts: Vec<&str> = node.children().filter(Node::is_text).map(|n| n.text().unwrap_or_default().trim()).collect();
    let parts: Vec<f64> = parts.iter().filter(|p| !p.is_empty()).map(|p| number(node, p)).collect::<Result<_, _>>()?;
    if let Some(base) = attribute(node, "base").filter(|base| base.trim() != "10") {
        return Err(fault(node, format!("a number to the base {base} is not read")));
    }
    let value = match (attribute(node, "type").unwrap_or("real"), &parts[..]) {
        ("real" | "integer", [x]) => *x,
        ("e-notation", [m, e]) => format!("{m}e{e}").parse().unwrap_or(f64::NAN),
        ("rational", [p, q]) => p / q,
        (kind, _) => return Err(fault(node, format!("a number of type `{kind}` that cannot be read"))),
    };
    if !value.is_finite() {
        return Err(fault(node, "a number that is not finite"));
    }
    Ok(Math::Number(value, attribute(node, "units").map(str::to_owned)))
}

fn symbol(node: Node<'_, '_>) -> Result<Math, Fault> {
    let url = attribute(node, "definitionURL").unwrap_or_default();
    match url.rsplit('/').next().unwrap_or_default() {
        "time" => Ok(Math::Time),
        // The value that SBML Level 3 fixes.
        "avogadro" => Ok(Math::Number(6.022_141_79e23, None)),
        other => Err(fault(node, format!("the symbol `{other}` has no counterpart"))),
    }
}

fn apply(node: Node<'_, '_>, depth: usize) -> Result<Math, Fault> {
    let mut parts = children(node);
    let head = parts.next().ok_or_else(|| fault(node, "`apply` without an operator"))?;
    let rest: Vec<Node<'_, '_>> = parts.collect();
    let arguments = |nodes: &[Node<'_, '_>]| nodes.iter().map(|n| expression(*n, depth + 1)).collect::<Result<Vec<_>, _>>();
    match tag(head) {
        "ci" => return Ok(Math::Call(text(head), arguments(&rest)?)),
        "csymbol" if attribute(head, "definitionURL").is_some_and(|url| url.ends_with("rateOf")) => {
            return match arguments(&rest)?.as_slice() {
                [Math::Name(id)] => Ok(Math::RateOf(id.clone())),
                _ => Err(fault(node, "`rateOf` takes one symbol")),
            };
        }
        "csymbol" if attribute(head, "definitionURL").is_some_and(|url| url.ends_with("delay")) => {
            return match arguments(&rest)? {
                both if both.len() == 2 => Ok(Math::Apply(DELAY, both)),
                _ => Err(fault(node, "`delay` takes an expression and a time")),
            };
        }
        "csymbol" => return symbol(head),
        "root" => {
            return qualified(node, &rest, depth, "degree", 2.0, |degree, x| {
                Math::Apply("^", vec![x, Math::Apply("/", vec![Math::Number(1.0, None), degree])])
            });
        }
        "log" => {
            return qualified(node, &rest, depth, "logbase", 10.0, |base, x| {
                Math::Apply("/", vec![Math::Apply("ln", vec![x]), Math::Apply("ln", vec![base])])
            });
        }
        _ => {}
    }
    let name = tag(head);
    let Some((_, here, fewest, most)) = OPERATORS.iter().find(|(there, ..)| *there == name) else {
        return Err(fault(head, format!("the operator `{name}` of MathML has no counterpart")));
    };
    if rest.len() < *fewest || rest.len() > *most {
        return Err(fault(node, format!("`{name}` with {} arguments", rest.len())));
    }
    Ok(folded(here, arguments(&rest)?))
}

/// An operator of MathML; `xor` of any number of arguments by that of two.
fn folded(name: &'static str, mut arguments: Vec<Math>) -> Math {
    if name != "xor" || arguments.len() == 2 {
        return Math::Apply(name, arguments);
    }
    let Some(last) = arguments.pop() else { return Math::Constant("false") };
    if arguments.is_empty() { last } else { Math::Apply("xor", vec![folded("xor", arguments), last]) }
}

/// `root` and `log`: the first argument may be a qualifier.
fn qualified(
    node: Node<'_, '_>,
    rest: &[Node<'_, '_>],
    depth: usize,
    qualifier: &str,
    usual: f64,
    general: impl Fn(Math, Math) -> Math,
) -> Result<Math, Fault> {
    let (given, value) = match rest {
        [x] => (None, *x),
        [q, x] if tag(*q) == qualifier => {
            let inside = children(*q).next().ok_or_else(|| fault(*q, format!("`{qualifier}` without a value")))?;
            (Some(expression(inside, depth + 1)?), *x)
        }
        _ => return Err(fault(node, format!("one argument is expected, after `{qualifier}` where it is given"))),
    };
    let value = expression(value, depth + 1)?;
    Ok(match given.unwrap_or(Math::Number(usual, None)) {
        Math::Number(x, _) if x == 2.0 && qualifier == "degree" => Math::Apply("sqrt", vec![value]),
        Math::Number(x, _) if x == 10.0 && qualifier == "logbase" => Math::Apply("log10", vec![value]),
        other => general(other, value),
    })
}

fn piecewise(node: Node<'_, '_>, depth: usize) -> Result<Math, Fault> {
    let mut pieces = vec![];
    let mut otherwise = None;
    for part in children(node) {
        let inside: Vec<Node<'_, '_>> = children(part).collect();
        match (tag(part), &inside[..]) {
            ("piece", [value, condition]) => pieces.push((expression(*value, depth + 1)?, expression(*condition, depth + 1)?)),
            ("otherwise", _) if otherwise.is_some() => return Err(fault(part, "a second `otherwise` in `piecewise`")),
            ("otherwise", [value]) => otherwise = Some(expression(*value, depth + 1)?),
            _ => return Err(fault(part, "`piecewise` holds pieces of a value and a condition, and `otherwise` with a value")),
        }
    }
    if otherwise.is_none() && pieces.iter().any(|(value, _)| value.is_condition()) {
        return Err(fault(node, "a truth value by `piecewise` without `otherwise` is unknown where no condition holds"));
    }
    let otherwise = otherwise.unwrap_or(Math::Number(f64::NAN, None));
    Ok(Math::Piecewise(pieces, Box::new(otherwise)))
}

impl Math {
    /// Calls `visit` with every part.
    pub(super) fn each(&self, visit: &mut dyn FnMut(&Math)) {
        visit(self);
        match self {
            Math::Apply(_, arguments) | Math::Call(_, arguments) => arguments.iter().for_each(|a| a.each(visit)),
            Math::Piecewise(pieces, otherwise) => {
                pieces.iter().for_each(|(value, condition)| {
                    value.each(visit);
                    condition.each(visit);
                });
                otherwise.each(visit);
            }
            _ => {}
        }
    }

    /// The symbols in it.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names = vec![];
        self.each(&mut |part| {
            if let Math::Name(name) | Math::RateOf(name) = part {
                names.push(name.clone());
            }
        });
        names
    }

    /// Returns true for comparisons for equality, and numbers as truth values.
    pub(super) fn has_equality(&self) -> bool {
        let mut found = false;
        self.each(&mut |part| {
            found |= match part {
                Math::Apply("==" | "!=", _) => true,
                Math::Apply("and" | "or" | "xor" | "not" | "implies", parts) => parts.iter().any(|p| !p.is_condition()),
                Math::Piecewise(pieces, _) => pieces.iter().any(|(_, condition)| !condition.is_condition()),
                _ => false,
            }
        });
        found
    }

    /// The expression with truth values and numbers where the language takes them: truth is 1 and 0
    /// as a number, and a number other than 0 is true.
    pub(super) fn typed(&self, truth: bool) -> Math {
        let number = |x: f64| Math::Number(x, None);
        let all = |list: &[Math], truth: bool| list.iter().map(|part| part.typed(truth)).collect::<Vec<_>>();
        let made = match self {
            Math::Piecewise(pieces, otherwise) => {
                let pieces = pieces.iter().map(|(value, condition)| (value.typed(truth), condition.typed(true))).collect();
                return Math::Piecewise(pieces, Box::new(otherwise.typed(truth)));
            }
            Math::Apply(f @ ("and" | "or" | "xor" | "not" | "implies"), parts) => Math::Apply(f, all(parts, true)),
            Math::Apply(f, parts) => Math::Apply(f, all(parts, false)),
            other => other.clone(),
        };
        match (truth, made.is_condition()) {
            (true, false) => Math::Apply("!=", vec![made, number(0.0)]),
            (false, true) => Math::Piecewise(vec![(number(1.0), made)], Box::new(number(0.0))),
            _ => made,
        }
    }

    /// Returns true for an expression that reads the time, an earlier one, or a rate.
    pub(super) fn is_timed(&self) -> bool {
        let mut found = self.has_rates() || self.has_delay();
        self.each(&mut |part| found |= *part == Math::Time);
        found
    }

    /// Returns true for an expression that reads an earlier time.
    pub(super) fn has_delay(&self) -> bool {
        let mut found = false;
        self.each(&mut |part| found |= matches!(part, Math::Apply(DELAY, _)));
        found
    }

    /// The value of an expression of numbers alone.
    pub(super) fn constant(&self) -> Option<f64> {
        if self.is_timed() { None } else { self.value(&mut |_| None) }
    }

    /// Returns true for an expression that reads a rate.
    pub(super) fn has_rates(&self) -> bool {
        let mut found = false;
        self.each(&mut |part| found |= matches!(part, Math::RateOf(_)));
        found
    }

    /// The expression with every part replaced from below.
    pub(super) fn map(&self, change: &mut dyn FnMut(Math) -> Result<Math, String>) -> Result<Math, String> {
        let mut list = |list: &[Math]| list.iter().map(|a| a.map(change)).collect::<Result<Vec<_>, _>>();
        let inner = match self {
            Math::Apply(f, arguments) => Math::Apply(f, list(arguments)?),
            Math::Call(f, arguments) => Math::Call(f.clone(), list(arguments)?),
            Math::Piecewise(pieces, otherwise) => {
                let mut made = vec![];
                for (value, condition) in pieces {
                    made.push((value.map(change)?, condition.map(change)?));
                }
                Math::Piecewise(made, Box::new(otherwise.map(change)?))
            }
            other => other.clone(),
        };
        change(inner)
    }

    /// The expression with the functions of the model put in.
    pub(super) fn put_in(&self, functions: &Functions) -> Result<Math, String> {
        self.put_in_below(functions, 0, &mut 0)
    }

    fn put_in_below(&self, functions: &Functions, depth: usize, nodes: &mut usize) -> Result<Math, String> {
        self.map(&mut |part| {
            *nodes += 1;
            if *nodes > MOST_NODES || depth > 50 {
                return Err("function definitions that call themselves or grow beyond reason".into());
            }
            let Math::Call(name, arguments) = part else { return Ok(part) };
            let (names, value) = functions.get(&name).ok_or_else(|| format!("unknown function `{name}`"))?;
            if names.len() != arguments.len() {
                return Err(format!("`{name}` takes {} arguments, not {}", names.len(), arguments.len()));
            }
            let value = value.put_in_below(functions, depth + 1, nodes)?;
            value.map(&mut |part| {
                *nodes += 1;
                if *nodes > MOST_NODES {
                    return Err("function definitions that grow beyond reason".into());
                }
                let place = match &part {
                    Math::Name(own) | Math::RateOf(own) => names.iter().position(|n| n == own),
                    _ => None,
                };
                match (part, place.map(|at| &arguments[at])) {
                    (Math::RateOf(_), Some(Math::Name(id))) => Ok(Math::RateOf(id.clone())),
                    (Math::RateOf(own), Some(_)) => Err(format!("`rateOf` of the argument `{own}`, which is not a symbol here")),
                    (part, argument) => Ok(argument.cloned().unwrap_or(part)),
                }
            })
        })
    }

    /// Returns `true` if it is a truth value.
    pub(super) fn is_condition(&self) -> bool {
        match self {
            Math::Apply(f, _) => matches!(*f, "==" | "!=" | ">" | "<" | ">=" | "<=" | "and" | "or" | "xor" | "not" | "implies"),
            Math::Constant(c) => matches!(*c, "true" | "false"),
            Math::Piecewise(pieces, otherwise) => otherwise.is_condition() && pieces.iter().all(|(value, _)| value.is_condition()),
            _ => false,
        }
    }

    /// The value where symbols have those of `value_of`; truth is 1 and 0. None where it has none.
    pub(super) fn value(&self, value_of: &mut dyn FnMut(&str) -> Option<f64>) -> Option<f64> {
        Some(match self {
            Math::Number(x, _) => *x,
            Math::Name(name) => value_of(name)?,
            Math::Time => 0.0,
            Math::Constant(c) => match *c {
                "true" => 1.0,
                "pi" => std::f64::consts::PI,
                "e" => std::f64::consts::E,
                "inf" => f64::INFINITY,
                _ => 0.0,
            },
            Math::RateOf(_) | Math::Call(..) => return None,
            Math::Apply(DELAY, _) => self.past(&Math::Number(0.0, None)).value(value_of)?,
            Math::Piecewise(pieces, otherwise) => {
                for (value, condition) in pieces {
                    if condition.value(value_of)? != 0.0 {
                        return value.value(value_of);
                    }
                }
                otherwise.value(value_of)?
            }
            Math::Apply(f, arguments) => {
                let x: Vec<f64> = arguments.iter().map(|a| a.value(value_of)).collect::<Option<_>>()?;
                evaluate(f, &x)?
            }
        })
    }
}

fn evaluate(f: &str, x: &[f64]) -> Option<f64> {
    let truth = |holds: bool| f64::from(u8::from(holds));
    let chain = |holds: &dyn Fn(f64, f64) -> bool| truth(x.windows(2).all(|pair| holds(pair[0], pair[1])));
    Some(match (f, x) {
        ("+", _) => x.iter().sum(),
        ("*", _) => x.iter().product(),
        ("-", [a]) => -a,
        ("-", [a, b]) => a - b,
        ("/", [a, b]) => a / b,
        ("^", [a, b]) => a.powf(*b),
        ("sqrt", [a]) => a.sqrt(),
        ("exp", [a]) => a.exp(),
        ("ln", [a]) => a.ln(),
        ("log10", [a]) => a.log10(),
        ("abs", [a]) => a.abs(),
        ("floor", [a]) => a.floor(),
        ("ceil", [a]) => a.ceil(),
        ("sin", [a]) => a.sin(),
        ("cos", [a]) => a.cos(),
        ("tan", [a]) => a.tan(),
        ("sinh", [a]) => a.sinh(),
        ("cosh", [a]) => a.cosh(),
        ("tanh", [a]) => a.tanh(),
        ("asin", [a]) => a.asin(),
        ("acos", [a]) => a.acos(),
        ("atan", [a]) => a.atan(),
        ("implies", [a, b]) => truth(*a == 0.0 || *b != 0.0),
        ("==", _) => chain(&|a, b| a == b),
        ("!=", [a, b]) => truth(a != b),
        (">", _) => chain(&|a, b| a > b),
        ("<", _) => chain(&|a, b| a < b),
        (">=", _) => chain(&|a, b| a >= b),
        ("<=", _) => chain(&|a, b| a <= b),
        ("and", _) => truth(x.iter().all(|a| *a != 0.0)),
        ("or", _) => truth(x.iter().any(|a| *a != 0.0)),
        ("xor", [a, b]) => truth((*a != 0.0) != (*b != 0.0)),
        ("not", [a]) => truth(*a == 0.0),
        ("max", _) => x.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ("min", _) => x.iter().copied().fold(f64::INFINITY, f64::min),
        _ => return None,
    })
}
