//! Instances of one component: the same quantity of each is one quantity with the instances as its
//! first index.

use super::items::{Index, Item, Member, Role, UNNAMED};

/// Fewest instances with their own names, `T1` to `T4`, that share a panel; those of an array
/// always do.
const LEAST_NAMED: usize = 4;

/// The name of a quantity in any instance: `col[*].c` for `col[2].c`, `T*.h` for `T12.h`; the name
/// itself where no instance has a number.
pub(super) fn family(name: &str) -> String {
    parts(name).map_or_else(|| name.to_owned(), |part| part.family())
}

/// A name with the number of its instance.
struct Numbered<'n> {
    stem: &'n str,
    number: i64,
    rest: &'n str,
    /// The instance is an element of an array.
    in_array: bool,
}

impl Numbered<'_> {
    fn family(&self) -> String {
        if self.in_array { format!("{}[*]{}", self.stem, self.rest) } else { format!("{}*{}", self.stem, self.rest) }
    }
}

fn parts(name: &str) -> Option<Numbered<'_>> {
    let (instance, _) = name.split_once('.')?;
    let rest = &name[instance.len()..];
    if let Some((stem, number)) = instance.strip_suffix(']').and_then(|open| open.rsplit_once('[')) {
        return Some(Numbered { stem, number: number.parse().ok()?, rest, in_array: true });
    }
    let stem = instance.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = instance[stem.len()..].parse().ok()?;
    (!stem.is_empty()).then_some(Numbered { stem, number, rest, in_array: false })
}

/// The quantities, those that instances of one component have in common as one; fields over space
/// stay what they are.
pub(super) fn gathered(items: &[Item]) -> Vec<Item> {
    let is_field = |item: &Item| item.indices.last().is_some_and(Index::is_space);
    let alike = |a: &Item, b: &Item| {
        let same = (a.role, &a.unit, &a.text, &a.indices) == (b.role, &b.unit, &b.text, &b.indices);
        same && family(&a.name) == family(&b.name) && !is_field(b)
    };
    let mut out: Vec<Item> = Vec::new();
    let mut done: Vec<String> = Vec::new();
    for item in items {
        let Some(part) = parts(&item.name).filter(|_| !is_field(item) && item.role != Role::Reward) else {
            out.push(item.clone());
            continue;
        };
        let key = format!("{:?} {}", item.role, part.family());
        if done.contains(&key) {
            continue;
        }
        let mut together: Vec<(i64, &Item)> =
            items.iter().filter(|other| alike(item, other)).filter_map(|other| Some((parts(&other.name)?.number, other))).collect();
        let of_family = items.iter().filter(|other| other.role == item.role && family(&other.name) == part.family()).count();
        let least = if part.in_array { 2 } else { LEAST_NAMED };
        if together.len() < least || together.len() < of_family {
            out.push(item.clone());
            continue;
        }
        together.sort_by_key(|(number, _)| *number);
        out.push(one(&part, &together));
        done.push(key);
    }
    out
}

/// One quantity for those of several instances.
fn one(part: &Numbered<'_>, together: &[(i64, &Item)]) -> Item {
    let first = together[0].1;
    let label = |number: i64| if part.in_array { format!("{}[{number}]", part.stem) } else { format!("{}{number}", part.stem) };
    let follows = together.windows(2).all(|pair| pair[1].0 == pair[0].0 + 1);
    let labels: Vec<String> = together.iter().map(|(number, _)| number.to_string()).collect();
    let index =
        Index { name: if part.stem.is_empty() { UNNAMED.to_owned() } else { part.stem.to_owned() }, labels, numbers: follows, space: None };
    let is_map = first.indices.is_empty() && index.is_space();
    let named = |number: i64, member: &Member| match member.label.as_str() {
        "" if is_map => number.to_string(),
        "" => label(number),
        own => format!("{}, {own}", label(number)),
    };
    let members = together.iter().flat_map(|(number, item)| {
        let member = |member: &Member| Member { label: named(*number, member), ..member.clone() };
        item.members.iter().map(member).collect::<Vec<_>>()
    });
    let indices = if is_map { vec![index] } else { vec![Index { numbers: false, ..index }] };
    Item {
        name: part.family(),
        members: members.collect(),
        indices,
        observed: together.iter().any(|(_, item)| item.observed),
        ..first.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::super::items::of_columns;
    use super::*;

    fn gathered_names(columns: &[String]) -> Vec<(String, Vec<String>)> {
        let items = gathered(&of_columns(columns, |_| false));
        items.into_iter().map(|item| (item.name, item.members.into_iter().map(|m| m.label).collect())).collect()
    }

    #[test]
    fn the_same_quantity_of_instances_is_one_quantity() {
        let columns: Vec<String> = (1..=3).flat_map(|i| ["h", "q"].map(|own| format!("tank[{i}].{own}"))).collect();
        let labels = || ["tank[1]", "tank[2]", "tank[3]"].map(String::from).to_vec();
        assert_eq!(gathered_names(&columns), [("tank[*].h".to_owned(), labels()), ("tank[*].q".to_owned(), labels())]);
    }

    #[test]
    fn twenty_instances_are_a_map_over_their_numbers() {
        let columns: Vec<String> = (1..=20).map(|i| format!("tank[{i}].h")).collect();
        let items = gathered(&of_columns(&columns, |_| false));
        assert_eq!(items.len(), 1);
        assert!(items[0].indices[0].is_space() && items[0].indices[0].name == "tank");
    }

    #[test]
    fn a_few_instances_with_names_of_their_own_stay_apart() {
        let columns: Vec<String> = (1..=3).map(|i| format!("R{i}.T")).collect();
        assert_eq!(gathered_names(&columns).len(), 3);
        let columns: Vec<String> = (1..=4).map(|i| format!("R{i}.T")).collect();
        assert_eq!(gathered_names(&columns)[0].0, "R*.T");
    }
}
