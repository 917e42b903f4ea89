//! Listing of an index reduction.

use std::fmt::Write as _;

use smpl_compiler::model::Interface;
use smpl_dsl::diagnostic::SourceMap;

/// Most names that one line shows.
const SHOWN: usize = 8;

/// Lists the equations that were differentiated, with their lines, and the states that became
/// algebraic; nothing where the index was not reduced.
pub(super) fn listing(interface: &Interface, sources: &SourceMap) -> String {
    let mut text = String::new();
    let reduction = &interface.reduction;
    // Writing into a string cannot fail.
    for one in &reduction.differentiated {
        let often = match one.times {
            1 => "once".to_owned(),
            2 => "twice".to_owned(),
            n => format!("{n} times"),
        };
        let place = format!("{}:{}", sources.name(one.span.file), sources.locate(one.span).line);
        let equation = sources.text(one.span).split_whitespace().collect::<Vec<_>>().join(" ");
        let _ = writeln!(text, "  differentiated {often:<6} {place}  {equation}");
    }
    let mut kept: Vec<&str> = reduction.projected.iter().flat_map(|p| &p.states).map(String::as_str).collect();
    kept.sort_unstable();
    kept.dedup();
    if !kept.is_empty() {
        let _ = writeln!(text, "  states projected      {}", shown(&kept));
    }
    let names: Vec<&str> = reduction.demoted.iter().flat_map(|d| &d.elements).map(String::as_str).collect();
    if !names.is_empty() {
        let _ = writeln!(text, "  states that follow    {}", shown(&names));
        let free: Vec<String> = interface.quantities.states.iter().flat_map(|q| (0..q.len()).map(|i| q.element_name(i))).collect();
        let free: Vec<&str> = free.iter().map(String::as_str).collect();
        let _ = writeln!(text, "  free at the start     {}", if free.is_empty() { "nothing".to_owned() } else { shown(&free) });
    }
    text
}

fn shown(names: &[&str]) -> String {
    let more = if names.len() > SHOWN { format!(" and {} more", names.len() - SHOWN) } else { String::new() };
    names[..names.len().min(SHOWN)].join(", ") + &more
}
