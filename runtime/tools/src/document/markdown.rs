//! Pieces of Markdown: text, units, tables.

use std::fmt::Write;

/// Text of a model as Markdown without links, images, HTML, mathematics or emphasis.
///
/// Pairs of single back-ticks mark code, in which Markdown knows no escapes; others are literal.
pub(super) fn prose(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let fences = text.contains("~~~");
    let paired = text.matches('`').count().is_multiple_of(2) && !text.contains("``");
    let mut in_code = false;
    for c in text.chars() {
        match c {
            _ if c.is_control() => out.push(' '),
            '`' if paired => {
                in_code = !in_code;
                out.push(c);
            }
            _ if in_code => out.push(c),
            '*' | '_' | '$' | '\\' | '#' | '[' | ']' | '{' | '}' | '`' => out.extend(['\\', c]),
            '~' if fences => out.extend(['\\', c]),
            '<' => out.push_str("&lt;"),
            '&' => out.push_str("&amp;"),
            _ => out.push(c),
        }
    }
    out
}

/// A name as it is written in a program, between more back-ticks than it has in a row.
pub(super) fn code(name: &str) -> String {
    let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let longest = name.split(|c| c != '`').map(str::len).max().unwrap_or(0);
    match longest {
        0 => format!("`{name}`"),
        _ => format!("{fence} {name} {fence}", fence = "`".repeat(longest + 1)),
    }
}

/// A unit for a line of text: `kJ/(min m² K)`, `°C`; nothing for numbers.
pub(super) fn unit(text: &str) -> String {
    if text == "1" {
        return String::new();
    }
    let mut out = String::new();
    let (mut raised, mut grouped) = (false, false);
    for c in text.chars() {
        match c {
            '^' => raised = true,
            // An exponent of more than a number: `m^(1/2)`.
            '(' if raised && !grouped => grouped = true,
            ')' if grouped => (raised, grouped) = (false, false),
            '0'..='9' if raised => out.extend("⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(c as usize - '0' as usize)),
            '-' if raised => out.push('⁻'),
            '.' if raised => out.push('·'),
            _ => {
                raised = grouped;
                out.push(c);
            }
        }
    }
    prose(&out.replace("degC", "°C").replace("degF", "°F"))
}

/// A display of mathematics.
pub(super) fn display(latex: &str) -> String {
    format!("$$\n{}\n$$\n", degrees(latex))
}

/// Mathematics within a line.
pub(super) fn math(latex: &str) -> String {
    format!("${}$", degrees(latex))
}

/// Degrees with their sign.
fn degrees(latex: &str) -> String {
    latex.replace("\\mathrm{degC}", "{}^{\\circ}\\mathrm{C}").replace("\\mathrm{degF}", "{}^{\\circ}\\mathrm{F}")
}

/// A table; columns without any entry are left out.
pub(super) fn table(heading: &[&str], rows: &[Vec<String>]) -> String {
    let filled: Vec<usize> =
        (0..heading.len()).filter(|&i| rows.iter().any(|row| row.get(i).is_some_and(|cell| !cell.is_empty()))).collect();
    let mut out = String::new();
    let mut line = |cells: &mut dyn Iterator<Item = String>| {
        // Writing into a string cannot fail.
        let _ = writeln!(out, "| {} |", cells.map(|cell| cell.replace('|', "\\|")).collect::<Vec<_>>().join(" | "));
    };
    line(&mut filled.iter().map(|&i| heading[i].to_owned()));
    line(&mut filled.iter().map(|_| "---".to_owned()));
    for row in rows {
        line(&mut filled.iter().map(|&i| row.get(i).cloned().unwrap_or_default()));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_written_as_in_a_paper() {
        let cases = [
            ("kJ/(min m^2 K)", "kJ/(min m² K)"),
            ("1/(m^2)", "1/(m²)"),
            ("m^2.5/min", "m²·⁵/min"),
            ("s^-1", "s⁻¹"),
            ("m^(1/2) s", "m¹/² s"),
        ];
        for (text, expected) in cases.into_iter().chain([("degC", "°C"), ("1", "")]) {
            assert_eq!(unit(text), expected);
        }
    }

    #[test]
    fn text_of_a_model_has_no_markup() {
        let cases = [
            ("[x](javascript:alert(1))", "\\[x\\](javascript:alert(1))"),
            ("![x](https://a.example/b.png)", "!\\[x\\](https://a.example/b.png)"),
            ("<https://a.example>", "&lt;https://a.example>"),
            ("\\[x](y)", "\\\\\\[x\\](y)"),
            ("&lt;b>", "&amp;lt;b>"),
            ("x {: onclick=y}", "x \\{: onclick=y\\}"),
            ("a\n\n# b", "a  \\# b"),
            ("```html", "\\`\\`\\`html"),
            ("none with `gross_uptake`, _or_", "none with `gross_uptake`, \\_or\\_"),
            ("`c[i] < {a}`, [x](y)", "`c[i] < {a}`, \\[x\\](y)"),
            ("`[`c](https://a.example)", "`[`c\\](https://a.example)"),
            ("one ` [x](y)", "one \\` \\[x\\](y)"),
            ("``[x](y)`` `", "\\`\\`\\[x\\](y)\\`\\` \\`"),
        ];
        for (text, expected) in cases {
            assert_eq!(prose(text), expected);
        }
        assert_eq!(code("a` [x](y) `b"), "`` a` [x](y) `b ``");
    }

    #[test]
    fn tables_leave_out_empty_columns_and_keep_bars() {
        let rows = [vec!["a|b".to_owned(), String::new(), "c".to_owned()]];
        assert_eq!(table(&["x", "y", "z"], &rows), "| x | z |\n| --- | --- |\n| a\\|b | c |\n");
    }
}
