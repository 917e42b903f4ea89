//! Names and numbers as symbols.

/// Names of Greek letters that LaTeX knows by the same name.
const GREEK: &[&str] = &[
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi", "pi", "rho",
    "sigma", "tau", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
];

/// A name as a symbol: `c_A` is `c_{\mathrm{A}}`, `mu` is `\mu`, `rate` is upright, `q5` is
/// `q_{5}`.
#[must_use]
pub fn name(text: &str) -> String {
    subscripted(text, &[])
}

/// A name with further subscripts behind its own.
pub(super) fn subscripted(text: &str, further: &[String]) -> String {
    let mut parts = text.split('_').filter(|part| !part.is_empty());
    let (base, digits) = split_digits(parts.next().unwrap_or(text));
    let own = (!digits.is_empty()).then(|| digits.to_owned()).into_iter().chain(parts.map(subscript));
    let below: Vec<String> = own.chain(further.iter().cloned()).collect();
    let symbol = base_symbol(base);
    if below.is_empty() { symbol } else { format!("{symbol}_{{{}}}", below.join(",")) }
}

/// `q5` is `q` and `5`; words keep their digits.
fn split_digits(part: &str) -> (&str, &str) {
    let letters = part.trim_end_matches(|c: char| c.is_ascii_digit());
    if letters.len() == 1 || GREEK.contains(&letters) { part.split_at(letters.len()) } else { (part, "") }
}

fn base_symbol(part: &str) -> String {
    match part {
        _ if GREEK.contains(&part) => format!("\\{part}"),
        "inf" => "\\infty".to_owned(),
        _ if part.chars().count() == 1 => escape(part),
        _ => format!("\\mathrm{{{}}}", escape(part)),
    }
}

fn subscript(part: &str) -> String {
    match part {
        _ if GREEK.contains(&part) => format!("\\{part}"),
        _ if part.bytes().all(|b| b.is_ascii_digit()) => part.to_owned(),
        _ => format!("\\mathrm{{{}}}", escape(part)),
    }
}

/// A number: with a power of ten where it is large or small.
#[must_use]
pub fn number(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (1e-3..1e6).contains(&magnitude) || !value.is_finite() {
        return format!("{value}");
    }
    let text = format!("{value:e}");
    match text.split_once('e') {
        Some(("1", exponent)) => format!("10^{{{exponent}}}"),
        Some((mantissa, exponent)) => format!("{mantissa} \\times 10^{{{exponent}}}"),
        None => text,
    }
}

/// Characters that LaTeX would take for commands.
pub(super) fn escape(text: &str) -> String {
    text.chars().map(|c| if matches!(c, '_' | '%' | '#' | '&' | '$' | '{' | '}') { format!("\\{c}") } else { c.to_string() }).collect()
}
