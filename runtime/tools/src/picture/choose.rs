//! Choice of the panels of a page, where no names are given, by their numbers.

use super::items::Role;
use super::panel::{Body, MOST_MAPS, Panel, Panels, is_constant, panels_of};
use super::plan::{OUTPUT, PageSection, PanelPlan, PlotKind};
use super::quantity::{quantity, readable_time, short, unit};
use super::run::Run;

/// More panels than this have no room for what does not change.
const ROOMY: usize = 12;

/// Most panels of a page where no names are given.
const MOST_PANELS: usize = 24;
/// Most outputs among them that are neither observed nor bounded, on a page of more panels than are
/// roomy.
const MOST_OUTPUTS: usize = 4;
const MOST_FIELDS: usize = 4;
const MOST_ACTIONS: usize = 6;
const MOST_OTHERS: usize = 4;

/// Fills the panels of a plan with the numbers of runs.
pub(super) fn fill(plans: &[PanelPlan], runs: &[Run], given_unit: &str) -> Panels {
    let times = || runs.iter().flat_map(Run::time).filter(|t| t.is_finite());
    let (low, high) = times().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
    let (low, high) = if low < high { (low, high) } else { (low.min(0.0), low.max(0.0) + 1.0) };
    let (low, high) = if low.is_finite() { (low, high) } else { (0.0, 1.0) };
    let (time_unit, factor) = readable_time(given_unit, high - low);
    let mut filled: Vec<(&PanelPlan, Panel)> = Vec::new();
    for plan in plans.iter().filter(|plan| !(plan.dispensable && counts_time(plan, runs))) {
        filled.extend(panels_of(plan, runs, factor, &time_unit).into_iter().map(|panel| (plan, panel)));
    }
    let crowded = filled.len() > ROOMY;
    let leaves = |(plan, panel): &(&PanelPlan, Panel)| {
        let is_field = matches!(plan.kind, PlotKind::Map(_));
        plan.dispensable && plan.role != Role::Reward && (crowded || is_field) && is_flat(panel)
    };
    let (flat, mut kept): (Vec<_>, Vec<_>) = filled.into_iter().partition(leaves);
    let constants = flat.iter().filter_map(|(_, panel)| constant(panel)).collect();
    let left_out = fit_page(&mut kept, runs.len().min(MOST_MAPS));
    share_scales(&mut kept);
    let panels = kept.into_iter().map(|(_, panel)| panel).collect();
    Panels { panels, time: (low * factor, high * factor), time_unit: unit(&time_unit), factor, constants, left_out }
}

/// Returns whether a quantity is the time or the number of the step, which the abscissa shows.
fn counts_time(plan: &PanelPlan, runs: &[Run]) -> bool {
    let PlotKind::Lines(lines) = &plan.kind else { return false };
    let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs().max(1.0));
    let is_clock = |run: &Run| {
        let Some(line) = lines.first() else { return false };
        let values = run.column(&line.member.column).unwrap_or_default();
        !values.is_empty() && (same(values, &run.time()) || run.column("step").is_some_and(|steps| same(values, steps)))
    };
    lines.iter().filter(|line| !line.dots).count() == 1 && runs.iter().all(is_clock)
}

fn is_flat(panel: &Panel) -> bool {
    matches!(&panel.body, Body::Curves(curves) if !panel.over_space && curves.series.iter().all(|s| is_constant(&s.y)))
}

/// `h = 0.659 m`; of several values the first four.
fn constant(panel: &Panel) -> Option<String> {
    let Body::Curves(curves) = &panel.body else { return None };
    let values: Vec<f64> = curves.series.iter().filter(|s| !s.dots).filter_map(|s| s.y.iter().copied().find(|y| y.is_finite())).collect();
    if let [value] = values[..] {
        return Some(format!("{} = {}", panel.name, quantity(value, &panel.unit)));
    }
    let shown: Vec<String> = values.iter().take(4).map(|v| short(*v)).collect();
    let more = if values.len() > 4 { ", ..." } else { "" };
    Some(format!("{} = {}{more} {}", panel.name, shown.join(", "), panel.unit).trim_end().to_owned())
}

/// Keeps those panels that fit a page, in their order, and returns the names of the others.
///
/// Each part of the page keeps the first ones by rank (observed, with bounds or set-point, states,
/// the rest). Within a rank, it keeps those that vary most relative to their size. `maps` is the
/// number of panels that a field has.
fn fit_page(panels: &mut Vec<(&PanelPlan, Panel)>, maps: usize) -> Vec<String> {
    let count = |part: PageSection, most: usize| {
        let of_part = panels.iter().filter(|(plan, _)| plan.dispensable && plan.part == part).count();
        of_part.min(most)
    };
    let fields = count(PageSection::Fields, MOST_FIELDS * maps.max(1));
    let (actions, others) = (count(PageSection::Actions, MOST_ACTIONS), count(PageSection::Others, MOST_OTHERS));
    let curves = MOST_PANELS.saturating_sub(fields + actions + others + count(PageSection::Reward, usize::MAX));
    let crowded = panels.len() > ROOMY;
    let mut leaves = vec![false; panels.len()];
    for (part, most) in
        [(PageSection::Curves, curves), (PageSection::Fields, fields), (PageSection::Actions, actions), (PageSection::Others, others)]
    {
        let mut order: Vec<usize> = (0..panels.len()).filter(|i| panels[*i].0.dispensable && panels[*i].0.part == part).collect();
        let worth = |i: &usize| (panels[*i].0.rank, -relative_variation(&panels[*i].1));
        order.sort_by(|a, b| {
            let (a, b) = (worth(a), worth(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let outputs = order.iter().copied().filter(|i| crowded && panels[*i].0.rank == OUTPUT).skip(MOST_OUTPUTS);
        order.iter().copied().skip(most).chain(outputs).for_each(|i| leaves[i] = true);
    }
    let mut names: Vec<String> = Vec::new();
    for ((_, panel), _) in panels.iter().zip(&leaves).filter(|(_, leaves)| **leaves) {
        if names.last() != Some(&panel.name) {
            names.push(panel.name.clone());
        }
    }
    let mut leaves = leaves.into_iter();
    panels.retain(|_| !leaves.next().unwrap_or_default());
    names
}

/// Range of the values over their size, from 0 to 2.
fn relative_variation(panel: &Panel) -> f64 {
    let (low, high) = match &panel.body {
        Body::Map(map) => map.range,
        Body::Curves(curves) => {
            let values = curves.series.iter().flat_map(|s| s.y.iter().copied()).filter(|y| y.is_finite());
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
        }
    };
    let size = low.abs().max(high.abs());
    if high > low && size > 0.0 { high / size - low / size } else { 0.0 }
}

/// Gives maps of one field of several instances, or of several runs, the same colours for the same
/// values.
fn share_scales(panels: &mut [(&PanelPlan, Panel)]) {
    let mut ranges: Vec<(String, (f64, f64))> = Vec::new();
    let key = |plan: &PanelPlan| format!("{} {}", plan.family, plan.unit);
    for (plan, panel) in panels.iter() {
        let Body::Map(map) = &panel.body else { continue };
        match ranges.iter_mut().find(|(known, _)| *known == key(plan)) {
            Some((_, range)) => *range = (range.0.min(map.range.0), range.1.max(map.range.1)),
            None => ranges.push((key(plan), map.range)),
        }
    }
    for (plan, panel) in panels {
        if let (Body::Map(map), Some((_, range))) = (&mut panel.body, ranges.iter().find(|(known, _)| *known == key(plan))) {
            map.range = *range;
        }
    }
}
