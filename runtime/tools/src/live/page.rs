//! One self-contained page to send: the picture of the runs, the equations, the text of the model.

use smpl_compiler::model::Interface;

use crate::picture::escaped;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1b1f24;background:#fff}\
    pre{background:#f6f8fa;padding:1rem;overflow:auto;font:13px/1.45 ui-monospace,monospace}.eq{overflow-x:auto;margin:.4rem 0}\
    h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2rem}\
    @media(prefers-color-scheme:dark){body{background:#111418;color:#e6e8eb}pre{background:#1b2027}.smpl-picture{background:#fff;color:#000}}";

/// The page. `mathml` are the equations as the live page has typeset them; only elements of MathML
/// are taken over.
pub(crate) fn page(interface: &Interface, text: &str, mathml: &[String], picture: &str) -> String {
    let title = if interface.text.is_empty() { interface.name.clone() } else { format!("{}: {}", interface.name, interface.text) };
    let equations: String = mathml.iter().filter(|one| is_mathml(one)).map(|one| format!("<div class=\"eq\">{one}</div>\n")).collect();
    let equations = if equations.is_empty() { String::new() } else { format!("<h2>Equations</h2>\n{equations}") };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{picture}\n{equations}<h2>Model</h2>\n<pre>{}</pre>\n</body>\n</html>\n",
        escaped(text),
        title = escaped(&title),
    )
}

/// Elements of presentation MathML.
const ELEMENTS: [&str; 27] = [
    "math",
    "semantics",
    "mrow",
    "mi",
    "mn",
    "mo",
    "ms",
    "mtext",
    "mspace",
    "mfrac",
    "msqrt",
    "mroot",
    "mstyle",
    "merror",
    "mpadded",
    "mphantom",
    "msub",
    "msup",
    "msubsup",
    "munder",
    "mover",
    "munderover",
    "mmultiscripts",
    "mtable",
    "mtr",
    "mtd",
    "menclose",
];

/// Returns whether a text has elements of MathML only, and no attribute that runs a script or leads
/// elsewhere.
fn is_mathml(text: &str) -> bool {
    let mut parts = text.split('<');
    let starts_with_a_tag = parts.next().is_some_and(|before| before.trim().is_empty());
    starts_with_a_tag
        && parts.all(|part| {
            let Some((tag, _)) = part.split_once('>') else { return false };
            let tag = tag.trim_start_matches('/').trim_end_matches('/');
            let mut words = tag.split_whitespace();
            let known = words.next().is_some_and(|name| ELEMENTS.contains(&name));
            let rest = tag.to_ascii_lowercase();
            known && ![" on", "href", "src", "javascript:", "url("].iter().any(|bad| rest.contains(bad))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_mathml_is_taken_over() {
        assert!(is_mathml("<math display=\"block\"><mfrac><mi>a</mi><mn>2</mn></mfrac></math>"));
        for bad in ["<script>x</script>", "<math><mi onclick=\"x\">a</mi></math>", "<math href=\"x\"/>", "text", "<math", "<img/>"] {
            assert!(!is_mathml(bad), "{bad}");
        }
    }

    #[test]
    fn texts_are_never_html() {
        let interface = Interface { name: "A".into(), text: "<b>".into(), ..Interface::default() };
        let page = page(&interface, "x < 1 & </pre><script>", &["<script>1</script>".into()], "");
        assert!(page.contains("A: &lt;b&gt;") && page.contains("x &lt; 1 &amp; &lt;/pre&gt;&lt;script&gt;"));
        assert!(!page.contains("<script>"));
    }
}
