//! Expressions written in the language, with no more parentheses than they need.

use std::fmt::Write as _;

use super::math::{DELAY, Math};

/// Terms of a sum that is written without groups.
const LONGEST: usize = 100;

/// A sum of terms, `true` for negative ones.
///
/// A long sum is in groups, because a flat one is as deep as it has terms.
pub(super) fn sum_of(terms: &[(bool, String)]) -> String {
    if terms.len() > LONGEST {
        let groups: Vec<_> = terms.chunks(LONGEST).map(|group| (false, format!("({})", sum_of(group)))).collect();
        return sum_of(&groups);
    }
    let mut sum = String::new();
    for (i, (minus, term)) in terms.iter().enumerate() {
        sum.push_str(match (i, minus) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => " + ",
            (_, true) => " - ",
        });
        sum.push_str(term);
    }
    sum
}

/// Binding strength of an expression.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    If,
    Or,
    And,
    Not,
    Compare,
    Sum,
    Product,
    Sign,
    Power,
    Atom,
}

/// Writes expressions in the language.
pub(super) struct Writer<'a> {
    /// The name here of a symbol there.
    pub(super) names: &'a dyn Fn(&str) -> String,
    /// The unit of a number by its id; empty where none is written.
    pub(super) units: &'a dyn Fn(&str) -> String,
    /// Name of the time.
    pub(super) time: &'a str,
}

/// A number as the language writes it.
pub(super) fn shown(x: f64) -> String {
    let size = x.abs();
    if x.is_nan() {
        "(inf - inf)".into()
    } else if x == 0.0 {
        "0".into()
    } else if (1e-4..1e7).contains(&size) {
        format!("{x}")
    } else {
        format!("{x:e}")
    }
}

impl Writer<'_> {
    /// The text of an expression.
    pub(super) fn text(&self, math: &Math) -> Result<String, String> {
        Ok(self.write(math)?.0)
    }

    /// The text as a factor of a product, or what is taken off.
    pub(super) fn factor(&self, math: &Math) -> Result<String, String> {
        self.within(math, Level::Product)
    }

    fn within(&self, math: &Math, least: Level) -> Result<String, String> {
        let (text, level) = self.write(math)?;
        Ok(if level < least { format!("({text})") } else { text })
    }

    fn write(&self, math: &Math) -> Result<(String, Level), String> {
        Ok(match math {
            Math::Number(x, unit) => {
                let unit = unit.as_deref().map(self.units).unwrap_or_default();
                let unit = if unit.is_empty() { unit } else { format!(" [{unit}]") };
                (format!("{}{unit}", shown(*x)), if *x < 0.0 { Level::Sign } else { Level::Atom })
            }
            Math::Name(id) => ((self.names)(id), Level::Atom),
            Math::Time => (self.time.to_owned(), Level::Atom),
            Math::Constant(c) => ((*c).to_owned(), Level::Atom),
            Math::RateOf(id) => (format!("der({})", (self.names)(id)), Level::Atom),
            Math::Call(name, _) => return Err(format!("unknown function `{name}`")),
            Math::Piecewise(pieces, otherwise) => self.piecewise(pieces, otherwise)?,
            Math::Apply(f, arguments) => self.apply(f, arguments)?,
        })
    }

    fn piecewise(&self, pieces: &[(Math, Math)], otherwise: &Math) -> Result<(String, Level), String> {
        let mut text = String::new();
        for (value, condition) in pieces {
            let _ = write!(text, "if {} then {} else ", self.condition(condition, Level::Or)?, self.within(value, Level::Or)?);
        }
        let _ = write!(text, "{}", self.within(otherwise, Level::Or)?);
        Ok((text, if pieces.is_empty() { Level::Or } else { Level::If }))
    }

    fn condition(&self, math: &Math, least: Level) -> Result<String, String> {
        if math.is_condition() { self.within(math, least) } else { Err("a number instead of a condition".into()) }
    }

    fn joined(&self, arguments: &[Math], sign: &str, level: Level) -> Result<(String, Level), String> {
        let parts: Vec<String> = arguments.iter().map(|a| self.within(a, level)).collect::<Result<_, _>>()?;
        Ok((parts.join(sign), level))
    }

    fn apply(&self, f: &'static str, arguments: &[Math]) -> Result<(String, Level), String> {
        let call = |name: &str| Ok((format!("{name}({})", self.list(arguments)?), Level::Atom));
        let of = |text: String| -> Result<(String, Level), String> { Ok((text, Level::Product)) };
        let one = || self.list(arguments);
        match (f, arguments) {
            ("+", []) => Ok(("0".into(), Level::Atom)),
            ("*", []) => Ok(("1".into(), Level::Atom)),
            ("and", []) => Ok(("true".into(), Level::Atom)),
            ("or", []) => Ok(("false".into(), Level::Atom)),
            ("+" | "*" | "and" | "or" | "max" | "min", [one]) => self.write(one),
            ("+", _) => self.sum(arguments),
            ("*", _) => self.joined(arguments, "*", Level::Product),
            ("-", [a]) => Ok((format!("-{}", self.within(a, Level::Power)?), Level::Sign)),
            ("-", [a, b]) => Ok((format!("{} - {}", self.within(a, Level::Sum)?, self.within(b, Level::Product)?), Level::Sum)),
            ("/", [a, b]) => Ok((format!("{}/{}", self.within(a, Level::Product)?, self.within(b, Level::Power)?), Level::Product)),
            ("^", [a, b]) => Ok((format!("{}^{}", self.within(a, Level::Atom)?, self.within(b, Level::Atom)?), Level::Power)),
            ("and", _) => self.conditions(arguments, " and ", Level::And),
            ("or", _) => self.conditions(arguments, " or ", Level::Or),
            ("not", [a]) => Ok((format!("not ({})", self.condition(a, Level::If)?), Level::Not)),
            ("xor", [a, b]) => {
                let (a, b) = (self.condition(a, Level::If)?, self.condition(b, Level::If)?);
                Ok((format!("({a}) and not ({b}) or not ({a}) and ({b})"), Level::Or))
            }
            ("implies", [a, b]) => {
                Ok((format!("not ({}) or ({})", self.condition(a, Level::If)?, self.condition(b, Level::If)?), Level::Or))
            }
            ("==" | "!=" | ">" | "<" | ">=" | "<=", _) => self.comparisons(f, arguments),
            (DELAY, [x, lag, before]) => {
                Ok((format!("delay({}, {}, before = {})", self.text(x)?, self.text(lag)?, self.text(before)?), Level::Atom))
            }
            ("sec", _) => of(format!("1/cos({})", one()?)),
            ("csc", _) => of(format!("1/sin({})", one()?)),
            ("cot", _) => of(format!("1/tan({})", one()?)),
            ("sech", _) => of(format!("1/cosh({})", one()?)),
            ("csch", _) => of(format!("1/sinh({})", one()?)),
            ("coth", _) => of(format!("1/tanh({})", one()?)),
            ("arcsec", [a]) => Ok((format!("acos(1/{})", self.within(a, Level::Atom)?), Level::Atom)),
            ("arccsc", [a]) => Ok((format!("asin(1/{})", self.within(a, Level::Atom)?), Level::Atom)),
            ("arccot", [a]) => Ok((format!("atan(1/{})", self.within(a, Level::Atom)?), Level::Atom)),
            ("arcsinh", [a]) => {
                let x = self.within(a, Level::Atom)?;
                // Of the absolute value: the sum of a negative number and the root would vanish.
                of(format!("sign({x})*ln(abs({x}) + sqrt(sq({x}) + 1))"))
            }
            ("arccosh", [a]) => {
                let x = self.within(a, Level::Atom)?;
                Ok((format!("ln({x} + sqrt({x} - 1)*sqrt({x} + 1))"), Level::Atom))
            }
            ("arccoth", [a]) => {
                let x = self.within(a, Level::Atom)?;
                of(format!("ln(({x} + 1)/({x} - 1))/2"))
            }
            ("arcsech" | "arccsch", [a]) => {
                let inverse = Math::Apply("/", vec![Math::Number(1.0, None), a.clone()]);
                self.apply(if f == "arcsech" { "arccosh" } else { "arcsinh" }, &[inverse])
            }
            ("factorial", [a]) => {
                let number = a.constant().filter(|x| x.fract() == 0.0 && (0.0..=170.0).contains(x));
                let number = number.ok_or("`factorial` of anything but a whole number from 0 to 170 has no counterpart")?;
                Ok((shown((1..=number as u32).map(f64::from).product()), Level::Atom))
            }
            ("arctanh", [a]) => {
                let x = self.within(a, Level::Atom)?;
                of(format!("ln((1 + {x})/(1 - {x}))/2"))
            }
            ("quotient" | "rem", [a, b]) => {
                let (x, y) = (self.within(a, Level::Power)?, self.within(b, Level::Power)?);
                let whole = format!("(if {x}/{y} < 0 then ceil({x}/{y}) else floor({x}/{y}))");
                Ok(if f == "rem" { (format!("{x} - {y}*{whole}"), Level::Sum) } else { (whole, Level::Atom) })
            }
            (name, _) => call(name),
        }
    }

    /// A sum: what is negative is taken off.
    fn sum(&self, arguments: &[Math]) -> Result<(String, Level), String> {
        let mut text = String::new();
        for argument in arguments {
            let (sign, part) = match argument {
                Math::Apply("-", inner) if inner.len() == 1 && !text.is_empty() => (" - ", self.within(&inner[0], Level::Product)?),
                Math::Number(x, unit) if *x < 0.0 && !text.is_empty() => {
                    (" - ", self.within(&Math::Number(-x, unit.clone()), Level::Product)?)
                }
                other => (if text.is_empty() { "" } else { " + " }, self.within(other, Level::Sum)?),
            };
            text.push_str(sign);
            text.push_str(&part);
        }
        Ok((text, Level::Sum))
    }

    fn list(&self, arguments: &[Math]) -> Result<String, String> {
        let parts: Vec<String> = arguments.iter().map(|a| self.text(a)).collect::<Result<_, _>>()?;
        Ok(parts.join(", "))
    }

    fn conditions(&self, arguments: &[Math], sign: &str, level: Level) -> Result<(String, Level), String> {
        let parts: Vec<String> = arguments.iter().map(|a| self.condition(a, level)).collect::<Result<_, _>>()?;
        Ok((parts.join(sign), level))
    }

    /// `a < b < c` is `a < b and b < c`.
    fn comparisons(&self, f: &str, arguments: &[Math]) -> Result<(String, Level), String> {
        let parts: Vec<String> = arguments.iter().map(|a| self.within(a, Level::Sum)).collect::<Result<_, _>>()?;
        let pairs: Vec<String> = parts.windows(2).map(|pair| format!("{} {f} {}", pair[0], pair[1])).collect();
        Ok((pairs.join(" and "), if pairs.len() > 1 { Level::And } else { Level::Compare }))
    }
}
