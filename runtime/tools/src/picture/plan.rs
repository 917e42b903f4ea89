//! Panels of a picture: those of `--show`, or a default selection.

use std::sync::Arc;

use super::instances::{family, gathered};
use super::items::{Item, Member, Role, Space, UNNAMED, base, index_of};
use smpl_runtime::catalogue::UnknownName;
use smpl_runtime::environment::Followed;

/// Most lines of a panel.
pub(super) const MOST_LINES: usize = 8;
/// Most quantities of a part of the page from which those that vary most are chosen.
const MOST_CANDIDATES: usize = 200;

/// Most panels of a page, whoever asks for them.
const MOST_OF_PAGE: usize = 200;

/// Reason why a picture cannot show what is asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShowError {
    /// A name that there is not.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// More than fits.
    #[error("{panels} panels are asked for, and a page has at most {MOST_OF_PAGE}; name fewer quantities")]
    TooMany {
        /// Their number.
        panels: usize,
    },
}

/// One panel before there are numbers.
#[derive(Clone, Debug)]
pub struct PanelPlan {
    /// Name of what it shows.
    pub name: String,
    /// Unit as declared.
    pub unit: String,
    /// Describing text.
    pub text: String,
    /// Kind.
    pub role: Role,
    /// Form of display.
    pub kind: PlotKind,
    /// Positions of the shown cells, if known.
    pub space: Option<Arc<Space>>,
    /// Left out where there is no room and nothing changes.
    pub dispensable: bool,
    /// Name of the coordinate where `space` is not known: `cell`, or the name of a set.
    pub index: String,
    /// Name of the quantity in any instance of its component: `col[*].c`.
    pub family: String,
    /// Part of the page.
    pub part: PageSection,
    /// Rank within a part: where there are more panels than fit, those of rank 0 stay first.
    pub rank: u8,
}

/// Parts of a page, each with its own room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageSection {
    /// Observed quantities, states, outputs.
    Curves,
    /// Fields over space.
    Fields,
    /// Actions.
    Actions,
    /// Discrete variables, disturbances.
    Others,
    /// The reward.
    Reward,
}

/// Format of numbers.
#[derive(Clone, Debug)]
pub enum PlotKind {
    /// Curves over time; the most changing ones where there are more than fit.
    Lines(Vec<Line>),
    /// Space over time, first cell lowest.
    Map(Vec<Member>),
    /// Curves over space at the end of the run, one a group of cells.
    Profile(Vec<(String, Vec<Member>)>),
    /// Curves over space at several times.
    Course(Vec<Member>),
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name in the panel's legend.
    pub label: String,
    /// Kind.
    pub role: Role,
    /// Its number.
    pub member: Member,
    /// Single points, as of readings.
    pub dots: bool,
}

/// A list as the command line takes it: names between commas, but not within brackets.
#[must_use]
pub fn split_names(list: &str) -> Vec<String> {
    split(list, ',')
}

fn split(list: &str, separator: char) -> Vec<String> {
    let (mut depth, mut names) = (0_i32, vec![String::new()]);
    for c in list.chars() {
        depth += i32::from(c == '[') - i32::from(c == ']');
        match names.last_mut() {
            Some(last) if c != separator || depth > 0 => last.push(c),
            _ => names.push(String::new()),
        }
    }
    names.iter().map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

/// The panels that the names ask for; a sensible choice if missing.
///
/// A name is that of a quantity (`T`, `R1.c`), of an element (`R1.c[tropine,3]`), of some elements
/// (`R1.c[tropine,*]`), of a column (`obs.T`, `reward.yield`), of a role (`states`), or `all`.
/// `profile:col.c` are curves over space, `T+T_c` share a panel.
///
/// # Errors
/// See [`ShowError`].
pub fn plan(items: &[Item], show: &[String]) -> Result<Vec<PanelPlan>, ShowError> {
    if show.is_empty() {
        return Ok(usual(items));
    }
    let asked: Result<Vec<Vec<PanelPlan>>, UnknownName> = show.iter().map(|name| named(items, name)).collect();
    let panels: Vec<PanelPlan> = asked?.into_iter().flatten().collect();
    if panels.len() > MOST_OF_PAGE { Err(ShowError::TooMany { panels: panels.len() }) } else { Ok(panels) }
}

fn named(items: &[Item], name: &str) -> Result<Vec<PanelPlan>, UnknownName> {
    if let Some(name) = name.strip_prefix("profile:") {
        let item = found(items, name)?;
        return if over_space(&item) { Ok(vec![course(&item)]) } else { Err(no_field(items, name)) };
    }
    if name == "all" {
        return Ok(items.iter().filter(|i| i.role != Role::Observation || !is_shadow(items, i)).flat_map(expanded).collect());
    }
    if let Some((_, role)) = Role::CHOICES.iter().find(|(choice, _)| *choice == name) {
        let chosen: Vec<PanelPlan> = items.iter().filter(|i| i.role == *role).flat_map(expanded).collect();
        return if chosen.is_empty() { Err(unknown(items, name)) } else { Ok(chosen) };
    }
    let parts = split(name, '+');
    if parts.len() > 1 {
        let parts: Result<Vec<Item>, UnknownName> = parts.iter().map(|part| found(items, part)).collect();
        return Ok(vec![together(name, &parts?)]);
    }
    Ok(expanded(&found(items, name)?))
}

fn unknown(items: &[Item], name: &str) -> UnknownName {
    let of_item = |item: &Item| match item.role {
        Role::Observation => format!("obs.{}", item.name),
        _ => item.name.clone(),
    };
    let known: Vec<String> = items.iter().map(of_item).chain(Role::CHOICES.iter().map(|(name, _)| (*name).to_owned())).collect();
    UnknownName::new("quantity to show", name, known.iter().map(String::as_str))
}

fn over_space(item: &Item) -> bool {
    item.indices.last().is_some_and(super::items::Index::is_space)
}

/// There is such a quantity, but it has no cells.
fn no_field(items: &[Item], name: &str) -> UnknownName {
    UnknownName::new("field over space", name, items.iter().filter(|item| over_space(item)).map(|item| item.name.as_str()))
}

/// There is such an array, but it has no such numbers.
fn no_element(item: &Item, name: &str) -> UnknownName {
    let labels: Vec<String> = item.members.iter().map(|member| format!("{}[{}]", item.name, member.label)).collect();
    let known: Vec<&str> = if item.indices.is_empty() { vec![&item.name] } else { labels.iter().map(String::as_str).collect() };
    UnknownName::new("element", name, known.into_iter())
}

/// The quantity of a name, with those of its numbers that the name means.
fn found(items: &[Item], name: &str) -> Result<Item, UnknownName> {
    let name = name.replace(' ', "");
    let whole = |item: &&Item| item.name == name || (item.role == Role::Observation && name == format!("obs.{}", item.name));
    if let Some(item) = items.iter().find(whole) {
        return Ok(item.clone());
    }
    let (array, pattern) = (base(&name), index_of(&name));
    let of_name = |item: &&Item| match array.strip_prefix("obs.") {
        Some(array) => item.role == Role::Observation && item.name == array,
        None => item.name == array,
    };
    let by_column = || items.iter().find_map(|item| Some((item, item.members.iter().find(|m| m.column == name)?)));
    if let Some((item, member)) = by_column() {
        return Ok(part_of(item, &name, vec![member.clone()]));
    }
    for item in items.iter().filter(of_name) {
        let Some(pattern) = pattern.filter(|_| !item.indices.is_empty()) else { continue };
        let members: Vec<Member> = item.members.iter().filter(|m| matches(&m.label, pattern)).cloned().collect();
        if !members.is_empty() {
            return Ok(part_of(item, &name, members));
        }
    }
    match items.iter().find(of_name) {
        Some(item) if pattern.is_some() => Err(no_element(item, &name)),
        _ => Err(unknown(items, &name)),
    }
}

/// Returns `true` if a label fits a pattern: `*` stands for any index, and indices that are left
/// out too.
fn matches(label: &str, pattern: &str) -> bool {
    let (labels, patterns): (Vec<&str>, Vec<&str>) = (label.split(',').collect(), pattern.split(',').collect());
    patterns.len() <= labels.len() && labels.iter().zip(&patterns).all(|(label, pattern)| *pattern == "*" || pattern == label)
}

/// Some numbers of a quantity, as a quantity of the indices in which they differ.
fn part_of(item: &Item, name: &str, members: Vec<Member>) -> Item {
    let kept = |axis: usize| {
        let mut index = item.indices[axis].clone();
        index.labels.retain(|l| members.iter().any(|m| m.label.split(',').nth(axis) == Some(l)));
        index
    };
    let is_product = item.indices.iter().map(|i| i.labels.len()).product::<usize>() == item.members.len();
    let indices = (0..if is_product { item.indices.len() } else { 0 }).map(kept).filter(|index| index.labels.len() > 1).collect();
    let name = name.strip_prefix("obs.").unwrap_or(name).to_owned();
    let members = if members.len() == 1 { vec![Member { label: String::new(), ..members[0].clone() }] } else { members };
    Item { name, indices, members, ..item.clone() }
}

fn panel(item: &Item, kind: PlotKind) -> PanelPlan {
    let (unit, text) = (item.unit.clone(), item.text.clone());
    let space = item.indices.last().and_then(|index| index.space.clone());
    let index = item.indices.last().map_or(UNNAMED, |index| index.name.as_str()).to_owned();
    let (name, family, role) = (item.name.clone(), family(&item.name), item.role);
    PanelPlan { name, unit, text, role, kind, space, dispensable: false, index, family, part: PageSection::Curves, rank: 0 }
}

/// Panels for all numbers of a quantity.
fn expanded(item: &Item) -> Vec<PanelPlan> {
    match item.indices.last() {
        Some(last) if last.is_space() => vec![in_space(item)],
        _ => item.members.chunks(MOST_LINES).map(|part| panel(item, PlotKind::Lines(lines(item, part)))).collect(),
    }
}

fn lines(item: &Item, members: &[Member]) -> Vec<Line> {
    let line = |member: &Member| Line { label: member.label.clone(), role: item.role, member: member.clone(), dots: false };
    members.iter().map(line).collect()
}

/// A field over a domain: a map; of several fields, or of one over two domains, what a page can
/// show of it.
fn in_space(item: &Item) -> PanelPlan {
    let cells = item.indices.last().map_or(1, |last| last.labels.len());
    match item.indices.len() {
        1 => panel(item, PlotKind::Map(item.members.clone())),
        _ if item.indices[item.indices.len() - 2].is_space() => {
            let outer = |member: &Member| Member { label: leading(&member.label), ..member.clone() };
            let rim: Vec<Member> = item.members.chunks(cells).filter_map(|chunk| chunk.last().map(outer)).collect();
            let last = item.indices.last().and_then(|i| i.labels.last()).cloned().unwrap_or_default();
            let mut outer = Item { members: rim, ..item.clone() };
            outer.indices.pop();
            outer.name = format!("{}[{}{last}]", item.name, "*,".repeat(outer.indices.len()));
            in_space(&outer)
        }
        _ => {
            let group = |chunk: &[Member]| (leading(&chunk[0].label), chunk.to_vec());
            panel(item, PlotKind::Profile(item.members.chunks(cells).map(group).collect()))
        }
    }
}

/// A label without its last index.
fn leading(label: &str) -> String {
    label.rsplit_once(',').map_or(label, |(leading, _)| leading).to_owned()
}

fn course(item: &Item) -> PanelPlan {
    match item.indices.len() {
        0 | 1 => panel(item, PlotKind::Course(item.members.clone())),
        _ => in_space(item),
    }
}

/// One panel for several quantities.
fn together(name: &str, items: &[Item]) -> PanelPlan {
    let named = |item: &Item, member: &Member| match member.label.as_str() {
        "" => item.name.clone(),
        label => format!("{}[{label}]", item.name),
    };
    let of_item = |item: &Item| -> Vec<Line> {
        let line = |member: &Member| Line { label: named(item, member), role: item.role, member: member.clone(), dots: false };
        item.members.iter().map(line).collect()
    };
    let units: Vec<&str> = items.iter().map(|item| item.unit.as_str()).collect();
    let unit = if units.windows(2).all(|pair| pair[0] == pair[1]) { units.first().copied().unwrap_or_default() } else { "" };
    PanelPlan {
        name: name.replace('+', ", "),
        unit: unit.to_owned(),
        text: String::new(),
        role: items.first().map_or(Role::Other, |item| item.role),
        kind: PlotKind::Lines(items.iter().flat_map(of_item).collect()),
        space: None,
        dispensable: false,
        index: UNNAMED.to_owned(),
        family: name.to_owned(),
        part: PageSection::Curves,
        rank: 0,
    }
}

/// Returns `true` if an observation is of a quantity that is there itself.
fn is_shadow(items: &[Item], observation: &Item) -> bool {
    items.iter().any(|i| i.role != Role::Observation && i.role != Role::Reward && i.name == observation.name)
}

/// Panels where no names are given: what is observed, the states, the outputs, fields, the actions,
/// what is discrete, the reward. Those that do not fit a page leave it once there are numbers (see
/// `choose`).
fn usual(items: &[Item]) -> Vec<PanelPlan> {
    let items = &gathered(items);
    let schedule = |name: &str| matches!(name, "phase" | "phase_start" | "phase_time") && items.iter().any(|i| i.name == "phase");
    let of = |role: Role, observed: bool| {
        let fits = move |i: &&Item| i.role == role && i.observed == observed && !schedule(&i.name);
        items.iter().filter(fits).filter_map(move |item| {
            let rank = rank(item);
            summary(items, item).map(|panel| PanelPlan { rank, dispensable: true, ..panel })
        })
    };
    let seen = [Role::State, Role::Output].into_iter().flat_map(|role| of(role, true));
    let own = of(Role::Observation, true)
        .filter(|panel| !items.iter().any(|i| i.role == Role::Observation && i.name == panel.name && is_shadow(items, i)));
    let first = seen.chain(own).chain(of(Role::State, false)).chain(of(Role::Other, false)).chain(of(Role::Output, false));
    let (curves, fields): (Vec<PanelPlan>, Vec<PanelPlan>) = first.partition(|panel| matches!(panel.kind, PlotKind::Lines(_)));
    let actions = of(Role::Action, false).chain(of(Role::Action, true));
    let discretes = of(Role::Discrete, true).chain(of(Role::Discrete, false));
    let others = discretes.chain(of(Role::Disturbance, true)).chain(of(Role::Disturbance, false));
    let reward = items.iter().filter(|i| i.role == Role::Reward).take(1).flat_map(expanded);
    let part = |part: PageSection| move |panel: PanelPlan| PanelPlan { part, dispensable: true, ..panel };
    let curves = curves.into_iter().take(MOST_CANDIDATES).map(part(PageSection::Curves));
    let fields = fields.into_iter().take(MOST_CANDIDATES).map(part(PageSection::Fields));
    let actions = actions.take(MOST_CANDIDATES).map(part(PageSection::Actions));
    let others = others.take(MOST_CANDIDATES).map(part(PageSection::Others));
    curves.chain(fields).chain(actions).chain(others).chain(reward.map(part(PageSection::Reward))).collect()
}

/// Rank of what is neither observed nor bounded nor a state.
pub(super) const OUTPUT: u8 = 3;

/// Observed quantities come first, then those that have a bound or a set-point, then states.
fn rank(item: &Item) -> u8 {
    let is_guided = item.members.iter().any(|m| m.target.is_some() || m.high.is_finite());
    match item.role {
        _ if item.observed => 0,
        _ if is_guided => 1,
        Role::State => 2,
        _ => OUTPUT,
    }
}

/// One panel for a quantity, with the readings of it.
fn summary(items: &[Item], item: &Item) -> Option<PanelPlan> {
    if item.indices.last().is_some_and(super::items::Index::is_space) {
        return Some(in_space(item));
    }
    let mut all = lines(item, &item.members);
    let readings = items.iter().find(|i| i.role == Role::Observation && i.name == item.name && i.role != item.role);
    if let ([_], Some([reading])) = (item.members.as_slice(), readings.map(|r| r.members.as_slice())) {
        let member = Member { source: None::<Followed>, ..reading.clone() };
        all.push(Line { label: "observed".into(), role: Role::Observation, member, dots: true });
    }
    (!all.is_empty()).then(|| panel(item, PlotKind::Lines(all)))
}

#[cfg(test)]
mod tests {
    use super::super::items::of_columns;
    use super::*;

    fn items() -> Vec<Item> {
        let mut names: Vec<String> = ["step", "time", "T", "u", "obs.T"].map(String::from).to_vec();
        names.extend((1..=10).map(|i| format!("c[{i}]")));
        names.extend(["a", "b"].iter().flat_map(|s| (1..=10).map(move |i| format!("R.c[{s},{i}]"))));
        names.extend(["reward", "reward.yield"].map(String::from));
        of_columns(&names, |name| name == "u")
    }

    fn kinds(show: &[&str]) -> Vec<(String, &'static str, usize)> {
        let show: Vec<String> = show.iter().map(|s| (*s).to_owned()).collect();
        let panels = plan(&items(), &show).expect("names there are");
        let kind = |k: &PlotKind| match k {
            PlotKind::Lines(lines) => ("lines", lines.len()),
            PlotKind::Map(cells) => ("map", cells.len()),
            PlotKind::Profile(groups) => ("profile", groups.len()),
            PlotKind::Course(cells) => ("course", cells.len()),
        };
        panels.into_iter().map(|p| (p.name, kind(&p.kind).0, kind(&p.kind).1)).collect()
    }

    #[test]
    fn names_are_split_at_commas_outside_of_brackets() {
        assert_eq!(split_names("T, R.c[a,3],obs.T"), ["T", "R.c[a,3]", "obs.T"]);
        assert_eq!(split_names(""), Vec::<String>::new());
    }

    #[test]
    fn a_name_asks_for_what_it_names() {
        assert_eq!(kinds(&["T"]), [("T".into(), "lines", 1)]);
        assert_eq!(kinds(&["obs.T"]), [("T".into(), "lines", 1)]);
        assert_eq!(kinds(&["c"]), [("c".into(), "map", 10)]);
        assert_eq!(kinds(&["c[3]"]), [("c[3]".into(), "lines", 1)]);
        assert_eq!(kinds(&["R.c"]), [("R.c".into(), "profile", 2)]);
        assert_eq!(kinds(&["R.c[a]", "R.c[b,*]"]), [("R.c[a]".into(), "map", 10), ("R.c[b,*]".into(), "map", 10)]);
        assert_eq!(kinds(&["R.c[*,10]"]), [("R.c[*,10]".into(), "lines", 2)]);
        assert_eq!(kinds(&["profile:c"]), [("c".into(), "course", 10)]);
        assert_eq!(kinds(&["T+u"]), [("T, u".into(), "lines", 2)]);
        assert_eq!(kinds(&["actions", "reward.yield"]), [("u".into(), "lines", 1), ("reward.yield".into(), "lines", 1)]);
    }

    #[test]
    fn more_than_fits_a_page_is_refused() {
        let show = vec!["all".to_owned(); 100];
        assert!(matches!(plan(&items(), &show), Err(ShowError::TooMany { panels }) if panels > 200));
    }

    #[test]
    fn a_name_that_is_not_there_is_refused_with_a_near_one() {
        let error = plan(&items(), &["obs.TT".into()]).expect_err("no such name").to_string();
        assert!(error.contains("unknown quantity to show `obs.TT`") && error.contains("did you mean `obs.T`?"), "{error}");
    }

    #[test]
    fn an_element_that_is_not_there_and_a_profile_of_one_number_are_refused() {
        let message = |name: &str| plan(&items(), &[name.to_owned()]).expect_err("no such thing").to_string();
        assert!(message("R.c[x]").contains("unknown element `R.c[x]`"), "{}", message("R.c[x]"));
        assert!(message("c[11]").contains("c[1]"), "{}", message("c[11]"));
        assert!(message("T[1]").contains("unknown element `T[1]`"), "{}", message("T[1]"));
        assert!(message("profile:T").contains("unknown field over space `T`; known: c, R.c"), "{}", message("profile:T"));
    }
}
