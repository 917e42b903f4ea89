//! Triggers of events as one comparison, which is the form that an event of the language takes.
//!
//! `a > 1 and b < 2` is `min(a - 1, 2 - b) > 0`: a function that is continuous where its parts are,
//! so that its zeros are found. Conditions without such a function jump from -1 to 1.

use super::math::Math;

/// A trigger as a function that is positive where the condition holds, and whether it holds at
/// zero.
pub(super) struct Trigger {
    pub(super) value: Math,
    pub(super) at_zero: bool,
    /// The condition is one comparison, unchanged.
    pub(super) plain: bool,
}

/// Comparisons of a condition.
struct Seen<'a> {
    strict: bool,
    weak: bool,
    comparisons: usize,
    strict_time: bool,
    /// Returns true for an expression that changes at events only.
    steps: &'a dyn Fn(&Math) -> bool,
}

/// The trigger of a condition, or of its negation; `steps` is whether an expression changes at
/// events only.
///
/// # Errors
/// In words, if the condition has no such function.
pub(super) fn trigger(condition: &Math, negated: bool, steps: &dyn Fn(&Math) -> bool) -> Result<Trigger, String> {
    let mut seen = Seen { strict: false, weak: false, comparisons: 0, strict_time: false, steps };
    let value = function(condition, negated, &mut seen)?;
    if seen.strict && seen.weak {
        // At the thresholds no one comparison says both.
        return Ok(Trigger { value: jump(condition, negated), at_zero: false, plain: false });
    }
    let at_zero = if seen.strict || seen.weak { seen.weak } else { !seen.strict_time };
    let plain = seen.comparisons == 1 && !negated && matches!(condition, Math::Apply("<" | ">" | "<=" | ">=", _));
    Ok(Trigger { value, at_zero, plain })
}

/// 1 where the condition holds, else -1, or the other way round.
fn jump(condition: &Math, negated: bool) -> Math {
    let (holds, otherwise) = if negated { (-1.0, 1.0) } else { (1.0, -1.0) };
    let number = |x: f64| Math::Number(x, None);
    Math::Piecewise(vec![(number(holds), condition.clone())], Box::new(number(otherwise)))
}

fn function(condition: &Math, negated: bool, seen: &mut Seen<'_>) -> Result<Math, String> {
    let mut list = |list: &[Math], negated: bool| list.iter().map(|c| function(c, negated, seen)).collect::<Result<Vec<_>, _>>();
    match condition {
        Math::Apply("not", inner) => function(&inner[0], !negated, seen),
        Math::Apply(f @ ("and" | "or"), inner) if !inner.is_empty() => {
            let all = list(inner, negated)?;
            Ok(Math::Apply(if (*f == "and") != negated { "min" } else { "max" }, all))
        }
        Math::Apply("implies", inner) => {
            let either = Math::Apply("or", vec![Math::Apply("not", vec![inner[0].clone()]), inner[1].clone()]);
            function(&either, negated, seen)
        }
        Math::Apply("xor", inner) => {
            let not = |i: usize| Math::Apply("not", vec![inner[i].clone()]);
            let one = |a: Math, b: Math| Math::Apply("and", vec![a, b]);
            let either = Math::Apply("or", vec![one(inner[0].clone(), not(1)), one(not(0), inner[1].clone())]);
            function(&either, negated, seen)
        }
        Math::Apply(f @ ("<" | ">" | "<=" | ">="), sides) if !sides.iter().any(Math::is_condition) => {
            let pairs = sides.windows(2).map(|pair| {
                let timed = pair.contains(&Math::Time);
                let strict = f.len() == 1;
                // At the threshold of time alone nothing can rest.
                if timed {
                    seen.strict_time |= strict != negated;
                } else if strict != negated {
                    seen.strict = true;
                } else {
                    seen.weak = true;
                }
                seen.comparisons += 1;
                let greater = f.starts_with('>') != negated;
                let (high, low) = if greater { (&pair[0], &pair[1]) } else { (&pair[1], &pair[0]) };
                Math::Apply("-", vec![high.clone(), low.clone()])
            });
            let mut all: Vec<Math> = pairs.collect();
            Ok(match all.len() {
                1 => all.remove(0),
                _ => Math::Apply(if negated { "max" } else { "min" }, all),
            })
        }
        other if (seen.steps)(other) => Ok(jump(other, negated)),
        Math::Apply("==" | "!=", _) => Err("asks for equality, which has no instant".into()),
        other if other.is_condition() && !other.has_equality() => Ok(jump(other, negated)),
        _ => Err("is not a comparison".into()),
    }
}
