//! Chapter on the index reduction of a model.

use super::markdown::{code, table};
use crate::reduction::{Summary, often, shown};

/// Equations that were differentiated, states that follow, states that a start chooses.
pub(super) fn page(summary: &Summary<'_>) -> String {
    let equation = |one: &smpl_compiler::model::Differentiated| {
        vec![format!("differentiated {}", often(one.times)), format!("{} ({})", code(&one.text), code(&one.place))]
    };
    let mut rows: Vec<Vec<String>> = summary.differentiated.iter().map(equation).collect();
    let names = |names: &[&str]| {
        let codes: Vec<String> = names.iter().map(|name| code(name)).collect();
        shown(&codes.iter().map(String::as_str).collect::<Vec<_>>())
    };
    rows.extend(summary.rows(&names).into_iter().map(|(what, which)| vec![what.to_owned(), which]));
    let note = "Equations bind states to each other: the compiler differentiated them, and states follow from them.";
    format!("\n## Index reduction\n\n{note}\n\n{}", table(&["effect", "which"], &rows))
}
