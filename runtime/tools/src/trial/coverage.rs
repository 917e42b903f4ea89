//! Parts of a model that its tests reach.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

use smpl_compiler::compiled::WatchRole;
use smpl_compiler::model::{Interface, RootAction};
use smpl_runtime::environment::Environment;
use smpl_runtime::load::{LoadOptions, Loaded};

/// Kinds of parts in the order in which they are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum PartKind {
    Event,
    Failure,
    Success,
    Phase,
    Variant,
    Level,
}

impl PartKind {
    fn plural(self) -> &'static str {
        match self {
            Self::Event => "events",
            Self::Failure => "failures",
            Self::Success => "successes",
            Self::Phase => "phases",
            Self::Variant => "variants",
            Self::Level => "levels",
        }
    }
}

/// The parts of a model by kind and name, and whether a test has reached them.
#[derive(Debug, Default)]
pub(crate) struct Coverage {
    reached: BTreeMap<(PartKind, String), bool>,
    /// For each compilation and root function, the sides that were seen at ends of steps (negative,
    /// positive) if it is a switch of the equations.
    sides: Vec<Vec<Option<[bool; 2]>>>,
    /// Root functions of the present state.
    roots: Vec<f64>,
}

impl Coverage {
    /// Adds the parts of a compiled model; its variants and its level are reached.
    pub(crate) fn declare(&mut self, loaded: &Loaded, options: &LoadOptions) {
        let is_event = |role: WatchRole| matches!(role, WatchRole::Event(_));
        self.sides.push(loaded.model.watched().iter().map(|kind| (!is_event(kind.role)).then_some([false; 2])).collect());
        let interface = loaded.model.interface();
        let finish = &interface.finish;
        finish.failures.iter().for_each(|failure| self.add(PartKind::Failure, &failure.name, false));
        finish.successes.iter().for_each(|name| self.add(PartKind::Success, name, false));
        interface.phases.iter().for_each(|name| self.add(PartKind::Phase, name, false));
        for variant in &interface.alternatives.variants {
            self.add(PartKind::Variant, &variant.name, variant.on);
        }
        for choice in &interface.alternatives.choices {
            for option in &choice.options {
                self.add(PartKind::Variant, &format!("{} = {option}", choice.name), choice.chosen() == Some(option));
            }
        }
        // The last level is that of all quantities, which every model has.
        if let [declared @ .., _] = interface.alternatives.levels.as_slice()
            && declared.len() > 1
        {
            let level = options.observation.as_deref().unwrap_or("default");
            declared.iter().for_each(|name| self.add(PartKind::Level, name, name == level));
        }
        for root in loaded.model.roots_info() {
            if let Some(kind) = part(interface, &root.name, root.action) {
                self.add(kind, &root.name, false);
            }
        }
    }

    /// Notes what the last step has reached.
    pub(crate) fn note(&mut self, environment: &mut Environment) {
        let setup = Arc::clone(environment.setup());
        let (interface, roots) = (setup.model().interface(), setup.model().roots_info());
        for root in environment.happened().map(|number| &roots[number]) {
            if let Some(kind) = part(interface, &root.name, root.action) {
                self.add(kind, &root.name, true);
            }
        }
        if let Some(sides) = self.sides.last_mut() {
            self.roots.resize(sides.len(), 0.0);
            environment.watched(&mut self.roots);
            for (seen, root) in sides.iter_mut().zip(&self.roots) {
                if let Some([negative, positive]) = seen {
                    *negative |= *root < 0.0;
                    *positive |= *root > 0.0;
                }
            }
        }
        if let Some(name) = environment.phase().and_then(|number| interface.phases.get(number)) {
            self.add(PartKind::Phase, name, true);
        }
        let Some(last) = environment.last() else { return };
        let failure = last.failure.map(|failure| failure.name(interface));
        if let Some(name) = failure.filter(|name| self.has(PartKind::Failure, name)) {
            self.add(PartKind::Failure, name, true);
        }
        if last.success && self.has(PartKind::Success, environment.success_name()) {
            self.add(PartKind::Success, environment.success_name(), true);
        }
    }

    /// One line for each kind that the model has; empty for a model without such parts.
    pub(crate) fn lines(&self) -> String {
        let mut kinds: BTreeMap<PartKind, (usize, Vec<&str>)> = BTreeMap::new();
        for ((kind, name), reached) in &self.reached {
            let (count, missing) = kinds.entry(*kind).or_default();
            *count += 1;
            if !reached {
                missing.push(name);
            }
        }
        let mut text = String::new();
        for (kind, (count, missing)) in kinds {
            let _ = write!(text, "       {:<9} {} of {count}", kind.plural(), count - missing.len());
            let missing = if missing.is_empty() { String::new() } else { format!(", not reached: {}", missing.join(", ")) };
            let _ = writeln!(text, "{missing}");
        }
        let sides = || self.sides.iter().flatten().flatten();
        if sides().next().is_some() {
            let both = sides().filter(|seen| **seen == [true; 2]).count();
            let _ = writeln!(text, "       {:<9} {both} of {} seen on both sides", "switches", sides().count());
        }
        text
    }

    fn has(&self, kind: PartKind, name: &str) -> bool {
        self.reached.contains_key(&(kind, name.to_owned()))
    }

    fn add(&mut self, kind: PartKind, name: &str, reached: bool) {
        *self.reached.entry((kind, name.to_owned())).or_default() |= reached;
    }
}

/// The kind of a root function; none for one of a phase, which `phase` shows, and for regular
/// instants, which have a text instead of a name.
fn part(interface: &Interface, name: &str, action: RootAction) -> Option<PartKind> {
    match action {
        RootAction::Fail(_) => Some(PartKind::Failure),
        RootAction::Succeed(_) => Some(PartKind::Success),
        RootAction::Run(_) if name.is_empty() || name.contains(' ') || interface.phases.iter().any(|phase| phase == name) => None,
        RootAction::Run(_) => Some(PartKind::Event),
        RootAction::Restart => None,
    }
}
