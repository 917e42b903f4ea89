//! Quantities that can be shown: those of a model, or the columns of a table of which only the
//! names are known.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use smpl_compiler::ir::VarId;
use smpl_compiler::model::{Axis, Grid, Quantity};

use smpl_runtime::catalogue::Family;
use smpl_runtime::environment::Followed;
use smpl_runtime::setup::Setup;

/// Kind of a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Observed.
    Observation,
    /// Differential state.
    State,
    /// Algebraic variable or named expression.
    Output,
    /// Held over a step.
    Action,
    /// Changes at instants.
    Discrete,
    /// Comes from outside.
    Disturbance,
    /// Reward.
    Reward,
    /// A column of a table that names neither.
    Other,
}

impl Role {
    /// Names by which all quantities of a role are chosen.
    pub(crate) const CHOICES: [(&'static str, Role); 7] = [
        ("observations", Role::Observation),
        ("states", Role::State),
        ("outputs", Role::Output),
        ("actions", Role::Action),
        ("discretes", Role::Discrete),
        ("disturbances", Role::Disturbance),
        ("rewards", Role::Reward),
    ];

    /// Returns `true` if values hold over the step that ends where they are.
    pub(super) fn is_held(self) -> bool {
        matches!(self, Role::Action | Role::Disturbance | Role::Reward)
    }
}

/// One number of a quantity.
#[derive(Clone, Debug)]
pub struct Member {
    /// Index as written; empty for a scalar.
    pub label: String,
    /// Its column in a table.
    pub column: String,
    /// Lower bound, -inf where none.
    pub low: f64,
    /// Upper bound, +inf where none.
    pub high: f64,
    /// Its set-point, where it has one.
    pub target: Option<f64>,
    /// Source of its values within steps.
    pub(crate) source: Option<Followed>,
}

/// An index of a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Index {
    /// Name of the set; `cell` for cells, `index` where the set is not known.
    pub name: String,
    /// Its members.
    pub labels: Vec<String>,
    /// They are numbers one after another, as those of cells are.
    pub numbers: bool,
    /// Positions of the cells of a domain.
    pub space: Option<Arc<Space>>,
}

/// Positions of the cells of a domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Name of the domain.
    pub name: String,
    /// Unit of its coordinate.
    pub unit: String,
    /// Increasing faces, one more than there are cells.
    pub faces: Vec<f64>,
}

/// Name of the members of an index whose set is not known.
pub(super) const UNNAMED: &str = "index";

/// Least members of an index of numbers that is treated as the cells of a domain.
const LEAST_CELLS: usize = 8;

impl Index {
    /// Returns `true` if it counts the cells of a domain.
    #[must_use]
    pub(crate) fn is_space(&self) -> bool {
        self.numbers && self.labels.len() >= LEAST_CELLS
    }
}

/// A quantity: a scalar or an array.
#[derive(Clone, Debug)]
pub struct Item {
    /// Name without indices.
    pub name: String,
    /// Kind.
    pub role: Role,
    /// Unit as declared; empty where it is not known.
    pub unit: String,
    /// Describing text.
    pub text: String,
    /// Its indices, outermost first.
    pub indices: Vec<Index>,
    /// Its numbers, the last index fastest.
    pub members: Vec<Member>,
    /// True if the agent sees it, or some of it.
    pub observed: bool,
}

/// The quantities of a model, in the order of the columns of its tables.
#[must_use]
pub fn of_model(setup: &Setup) -> Vec<Item> {
    let interface = setup.model().interface();
    let catalogue = &setup.catalogue;
    let targets = setup.steady_state();
    let has_target = interface.steady.is_some() && setup.no_steady().is_none();
    let target = |at: usize| targets.get(at).copied().filter(|x| has_target && x.is_finite());
    let observed = |name: &str| interface.finish.observations.iter().any(|o| base(&o.name) == name);
    let spaces = spaces(&interface.grids);
    let mut items = Vec::new();
    let mut family = |role: Role, quantities: &[Quantity], family: &Family, source: fn(usize) -> Option<Followed>| {
        items.extend(quantities.iter().map(|quantity| {
            let of_state = |at: usize| if role == Role::State { target(at) } else { None };
            let members = members(quantity, family, &source, &of_state);
            Item { members, observed: observed(&quantity.name), ..blank(quantity, role, &spaces) }
        }));
    };
    family(Role::State, &interface.quantities.states, &catalogue.states, |at| Some(Followed::Unknown(at)));
    family(Role::Output, &interface.quantities.algebraics, &catalogue.algebraics, |at| Some(Followed::Output(at)));
    family(Role::Discrete, &interface.quantities.discretes, &catalogue.discretes, |at| Some(Followed::Discrete(at)));
    family(Role::Disturbance, &interface.quantities.disturbances, &catalogue.disturbances, |_| None);
    family(Role::Action, &interface.quantities.actions, &catalogue.actions, |_| None);
    // An array that is observed as a whole has the indices of what is observed.
    let alike = |seen: &Item| items.iter().find(|item: &&Item| item.name == seen.name && item.members.len() == seen.members.len());
    let indexed = |seen: Item| Item { indices: alike(&seen).map_or(seen.indices.clone(), |item| item.indices.clone()), ..seen };
    let seen: Vec<Item> = observations(setup).into_iter().map(indexed).collect();
    items.extend(seen);
    items.extend(rewards(setup));
    items
}

/// The domains whose places are known, by their numbers.
fn spaces(grids: &[Grid]) -> Vec<Option<Arc<Space>>> {
    let space = |grid: &Grid| Space { name: grid.name.clone(), unit: grid.unit.clone(), faces: grid.faces.clone() };
    grids.iter().map(|grid| (!grid.faces.is_empty()).then(|| Arc::new(space(grid)))).collect()
}

/// Returns `true` if cells lie where the compiled model says: the parameters that it computed them
/// from have the values that they had.
#[must_use]
pub fn knows_space(setup: &Setup, parameters: &[f64]) -> bool {
    let model = setup.model();
    let holds = |(var, element, value): &(VarId, u32, f64)| {
        let now = model.offset(*var).and_then(|first| parameters.get(first + *element as usize));
        now.is_some_and(|now| (now - value).abs() <= 1e-9 * value.abs())
    };
    model.interface().grids.iter().flat_map(|grid| &grid.parameters).all(holds)
}

fn blank(quantity: &Quantity, role: Role, spaces: &[Option<Arc<Space>>]) -> Item {
    let index = |axis: &Axis| Index {
        name: match axis {
            Axis::Cells { .. } => "cell".to_owned(),
            Axis::Numbers { set, .. } if !set.is_empty() => set.clone(),
            _ => UNNAMED.to_owned(),
        },
        labels: (0..axis.len()).map(|i| axis.label(i)).collect(),
        numbers: !matches!(axis, Axis::Names(_)),
        space: match axis {
            Axis::Cells { grid, .. } => spaces.get(*grid as usize).cloned().flatten(),
            _ => None,
        },
    };
    Item {
        name: quantity.name.clone(),
        role,
        unit: quantity.unit.clone(),
        text: quantity.text.clone(),
        indices: quantity.axes.iter().map(index).collect(),
        members: Vec::new(),
        observed: false,
    }
}

fn members(
    quantity: &Quantity,
    family: &Family,
    source: &dyn Fn(usize) -> Option<Followed>,
    target: &dyn Fn(usize) -> Option<f64>,
) -> Vec<Member> {
    let member = |element: usize| {
        let column = quantity.element_name(element);
        let at = family.find(&column).map(|e| e.at);
        Member {
            label: label(&quantity.axes, element),
            low: Quantity::pick(&quantity.low, element),
            high: Quantity::pick(&quantity.high, element),
            target: at.and_then(target),
            source: at.and_then(source),
            column,
        }
    };
    (0..quantity.len()).map(member).collect()
}

/// The indices of an element, `tropine,3`, however its name shows them.
fn label(axes: &[Axis], element: usize) -> String {
    let mut rest = element;
    let mut labels: Vec<String> = Vec::with_capacity(axes.len());
    for axis in axes.iter().rev() {
        labels.push(axis.label(rest % axis.len().max(1)));
        rest /= axis.len().max(1);
    }
    labels.reverse();
    labels.join(",")
}

/// Observations, those of one array together.
fn observations(setup: &Setup) -> Vec<Item> {
    let observations = &setup.model().interface().finish.observations;
    let columns = observations.iter().map(|o| (format!("obs.{}", o.name), o.low, o.high));
    let mut items = grouped(columns, Role::Observation);
    let units: HashMap<&str, &str> = observations.iter().map(|o| (base(&o.name), o.unit.as_str())).collect();
    for item in &mut items {
        item.unit = units.get(item.name.as_str()).map_or_else(String::new, |unit| (*unit).to_owned());
        item.observed = true;
    }
    items
}

fn rewards(setup: &Setup) -> impl Iterator<Item = Item> {
    let interface = setup.model().interface();
    let chosen = interface.finish.rewards.get(setup.reward);
    let own = chosen.map(|r| ("reward".to_owned(), r.unit.clone(), format!("{}: {}", r.name, r.text).trim_end_matches(": ").to_owned()));
    let each = interface.finish.rewards.iter().map(|r| (format!("reward.{}", r.name), r.unit.clone(), r.text.clone()));
    own.into_iter().chain(each).map(|(column, unit, text)| {
        let mut items = grouped(std::iter::once((column, f64::NEG_INFINITY, f64::INFINITY)), Role::Reward);
        let item = items.pop();
        item.map_or_else(|| plain(String::new(), Role::Reward), |item| Item { unit, text, ..item })
    })
}

fn plain(name: String, role: Role) -> Item {
    Item { name, role, unit: String::new(), text: String::new(), indices: Vec::new(), members: Vec::new(), observed: false }
}

/// The quantities of the columns of a table. `is_action` shows the columns that are empty in the
/// first row and full after it.
#[must_use]
pub fn of_columns(names: &[String], is_action: impl Fn(&str) -> bool) -> Vec<Item> {
    const KEYS: [&str; 9] = ["step", "time", "terminated", "truncated", "run", "scenario", "seed", "episode", "variant"];
    let shown = names.iter().filter(|name| !KEYS.contains(&name.as_str()) && !name.starts_with("param.") && !name.starts_with("sweep."));
    let role = |name: &str| match name {
        name if name.starts_with("obs.") => Role::Observation,
        name if name == "reward" || name.starts_with("reward.") => Role::Reward,
        name if is_action(name) => Role::Action,
        _ => Role::Other,
    };
    let columns: Vec<(Role, String)> = shown.map(|name| (role(name), name.clone())).collect();
    let mut items: Vec<Item> = Vec::new();
    for part in columns.chunk_by(|a, b| a.0 == b.0) {
        let names = part.iter().map(|(_, name)| (name.clone(), f64::NEG_INFINITY, f64::INFINITY));
        items.extend(grouped(names, part[0].0));
    }
    items
}

/// Columns one after another of the same name but for the index, as one quantity.
fn grouped(columns: impl Iterator<Item = (String, f64, f64)>, role: Role) -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for (column, low, high) in columns {
        let plain_name = column.strip_prefix("obs.").unwrap_or(&column);
        let (name, label) = (base(plain_name).to_owned(), index_of(plain_name).unwrap_or_default().to_owned());
        let member = Member { label, column: column.clone(), low, high, target: None, source: None };
        match items.last_mut().filter(|last| last.name == name && !member.label.is_empty()) {
            Some(last) => last.members.push(member),
            None => items.push(Item { members: vec![member], ..plain(name, role) }),
        }
    }
    for item in &mut items {
        item.indices = indices(&item.members);
    }
    items
}

/// The indices whose product the labels are; one index of all labels if they are not a product.
fn indices(members: &[Member]) -> Vec<Index> {
    if let [Member { label, .. }] = members
        && label.is_empty()
    {
        return Vec::new();
    }
    let parts: Vec<Vec<&str>> = members.iter().map(|m| m.label.split(',').collect()).collect();
    let depth = parts.first().map_or(0, Vec::len);
    let distinct = |axis: usize| {
        let mut seen = HashSet::new();
        let labels = parts.iter().filter_map(|part| part.get(axis)).filter(|label| seen.insert(**label));
        let labels: Vec<String> = labels.map(|label| (*label).to_owned()).collect();
        let values: Option<Vec<i64>> = labels.iter().map(|l| l.parse().ok()).collect();
        let numbers = values.is_some_and(|v| v.windows(2).all(|pair| pair[1] == pair[0] + 1));
        Index { name: UNNAMED.to_owned(), labels, numbers, space: None }
    };
    let axes: Vec<Index> = (0..depth).map(distinct).collect();
    let is_product = axes.iter().map(|a| a.labels.len()).product::<usize>() == members.len();
    if is_product && parts.iter().all(|p| p.len() == depth) {
        return axes;
    }
    vec![Index { name: UNNAMED.to_owned(), labels: members.iter().map(|m| m.label.clone()).collect(), numbers: false, space: None }]
}

/// `col[1].c` of `col[1].c[tropine,3]`.
pub(crate) fn base(name: &str) -> &str {
    name.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')).map_or(name, |(base, _)| base)
}

/// `tropine,3` of `col[1].c[tropine,3]`.
pub(super) fn index_of(name: &str) -> Option<&str> {
    name.strip_suffix(']').and_then(|rest| rest.rsplit_once('[')).map(|(_, index)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|s| (*s).to_owned()).collect()
    }

    #[test]
    fn columns_of_an_array_are_one_quantity_with_its_indices() {
        let columns: Vec<String> = ["a", "b"].iter().flat_map(|s| (1..=9).map(move |i| format!("R1.c[{s},{i}]"))).collect();
        let items = of_columns(&columns, |_| false);
        assert_eq!(items.len(), 1);
        assert_eq!(items[0].name, "R1.c");
        assert_eq!(items[0].indices[0], Index { name: "index".into(), labels: names(&["a", "b"]), numbers: false, space: None });
        assert!(items[0].indices[1].is_space() && items[0].members.len() == 18);
    }

    #[test]
    fn the_index_is_the_last_one_in_brackets() {
        assert_eq!((base("col[1].c[2,3]"), index_of("col[1].c[2,3]")), ("col[1].c", Some("2,3")));
        assert_eq!((base("col[1].c"), index_of("col[1].c")), ("col[1].c", None));
    }

    #[test]
    fn keys_are_no_quantities_and_prefixes_tell_roles() {
        let columns = names(&["step", "time", "x", "u", "obs.x", "reward", "reward.yield", "terminated", "truncated", "param.k"]);
        let items = of_columns(&columns, |name| name == "u");
        let roles: Vec<(&str, Role)> = items.iter().map(|i| (i.name.as_str(), i.role)).collect();
        let (other, action, reward) = (Role::Other, Role::Action, Role::Reward);
        assert_eq!(roles, [("x", other), ("u", action), ("x", Role::Observation), ("reward", reward), ("reward.yield", reward)]);
    }

    #[test]
    fn labels_that_are_no_product_stand_in_one_index() {
        let items = of_columns(&names(&["c[a,1]", "c[a,2]", "c[b,1]"]), |_| false);
        assert_eq!(items[0].indices.len(), 1);
        assert_eq!(items[0].indices[0].labels, ["a,1", "a,2", "b,1"]);
    }
}
