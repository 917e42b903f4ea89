//! Record of an index reduction for readers: the command line, the page of a model, the live page.

use std::fmt::Write as _;

use serde_json::{Value, json};
use smpl_compiler::model::{Differentiated, Interface};

/// Most names that one line shows.
const SHOWN: usize = 8;

/// Effects of index reduction.
pub(crate) struct Summary<'i> {
    /// Equations of which time derivatives were added.
    pub(crate) differentiated: &'i [Differentiated],
    /// States that became algebraic variables.
    follow: Vec<&'i str>,
    /// States that are projected to constraints.
    projected: Vec<&'i str>,
    /// States that a start may set.
    free: Vec<String>,
    /// Number of values that a start may choose.
    freedom: usize,
}

impl<'i> Summary<'i> {
    /// The record of a model; `None` if its index was not reduced.
    pub(crate) fn of(interface: &'i Interface) -> Option<Self> {
        let reduction = &interface.reduction;
        if !reduction.has_reduced() {
            return None;
        }
        let mut projected: Vec<&str> = reduction.projected.iter().flat_map(|p| &p.states).map(String::as_str).collect();
        projected.sort_unstable();
        projected.dedup();
        let follow = reduction.demoted.iter().flat_map(|d| &d.elements).map(String::as_str).collect();
        let free: Vec<String> = interface.quantities.states.iter().flat_map(|q| (0..q.len()).map(|i| q.element_name(i))).collect();
        let freedom = free.len().saturating_sub(reduction.conditions as usize);
        Some(Self { differentiated: &reduction.differentiated, follow, projected, free, freedom })
    }

    /// The rows of the record: what, and which.
    pub(crate) fn rows(&self, names: &dyn Fn(&[&str]) -> String) -> Vec<(&'static str, String)> {
        let mut rows = Vec::new();
        if !self.projected.is_empty() {
            rows.push(("states projected", names(&self.projected)));
        }
        if !self.follow.is_empty() {
            rows.push(("states that follow", names(&self.follow)));
        }
        let free: Vec<&str> = self.free.iter().map(String::as_str).collect();
        let free = match (free.len(), self.freedom) {
            (0, _) => "nothing".to_owned(),
            (all, some) if some < all => format!("{some} of {}", names(&free)),
            _ => names(&free),
        };
        rows.push(("free at the start", free));
        rows
    }

    /// Lines for a terminal.
    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        // Writing into a string cannot fail.
        for one in self.differentiated {
            let _ = writeln!(text, "  differentiated {:<6} {}  {}", often(one.times), one.place, one.text);
        }
        for (what, which) in self.rows(&shown) {
            let _ = writeln!(text, "  {what:<21} {which}");
        }
        text
    }

    /// The record as data.
    pub(crate) fn json(&self) -> Value {
        let equation = |one: &Differentiated| json!({"times": one.times, "place": one.place, "equation": one.text});
        json!({
            "differentiated": self.differentiated.iter().map(equation).collect::<Vec<_>>(),
            "follow": self.follow,
            "projected": self.projected,
            "free": self.free,
            "freedom": self.freedom,
        })
    }
}

/// Number of differentiations in words.
pub(crate) fn often(times: u32) -> String {
    match times {
        1 => "once".to_owned(),
        2 => "twice".to_owned(),
        n => format!("{n} times"),
    }
}

/// Names with commas, the first ones of many.
pub(crate) fn shown(names: &[&str]) -> String {
    let more = if names.len() > SHOWN { format!(" and {} more", names.len() - SHOWN) } else { String::new() };
    names[..names.len().min(SHOWN)].join(", ") + &more
}
