//! Names of the single numbers of a model, and where each is kept.
//!
//! The compiler speaks of arrays; people and files speak of `R1.c[tropine,3]`. A [`Family`] holds
//! the elements of one role in the order of the outside and finds them by name.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::OnceLock;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::model::{Interface, OutsideBounds, Quantity};
use smpl_dsl::diagnostic::suggest;

/// One number of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Flattened name.
    pub name: String,
    /// Unit as declared.
    pub unit: String,
    /// Its place: in `y` (states, solved variables), in its region (parameters, actions, discretes,
    /// disturbances) or in the output vector (algebraic outputs).
    pub at: usize,
    /// Lower bound, -inf where none.
    pub low: f64,
    /// Upper bound, +inf where none.
    pub high: f64,
    /// Default, nominal or initial value.
    pub default: f64,
    /// Magnitude for tolerances.
    pub scale: f64,
    /// The default shapes the model: another value needs another compilation.
    pub structural: bool,
    /// A state that never falls below zero.
    pub nonnegative: bool,
}

impl Element {
    /// Width of the bounds; 1 where they are open, so that relative excesses stay meaningful.
    #[must_use]
    pub fn range(&self) -> f64 {
        let range = self.high - self.low;
        if range.is_finite() && range > 0.0 { range } else { 1.0 }
    }
}

/// The elements of one role, in declaration order.
#[derive(Clone, Debug, Default)]
pub struct Family {
    elements: Vec<Element>,
    /// Positions by name, made when a name is first looked up: a model may have a hundred thousand
    /// states.
    index: OnceLock<HashMap<String, usize>>,
}

impl Family {
    fn new(elements: Vec<Element>) -> Self {
        Self { elements, index: OnceLock::new() }
    }

    /// The elements.
    #[must_use]
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Returns `true` if it is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Position of a flattened name in declaration order.
    #[must_use]
    pub fn position(&self, name: &str) -> Option<usize> {
        let index = || self.elements.iter().enumerate().map(|(i, e)| (e.name.clone(), i)).collect::<HashMap<_, _>>();
        self.index.get_or_init(index).get(name).copied()
    }

    /// The element of a flattened name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&Element> {
        self.position(name).map(|i| &self.elements[i])
    }

    /// The element of a name, or an error that says which names there are.
    ///
    /// # Errors
    /// [`UnknownName`] if no element has the name.
    pub fn get(&self, name: &str, kind: &'static str) -> Result<&Element, UnknownName> {
        self.find(name).ok_or_else(|| UnknownName::new(kind, name, self.names()))
    }

    /// The flattened names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.elements.iter().map(|e| e.name.as_str())
    }
}

impl Element {
    /// Checks that a value is within the bounds; a state that never falls below zero is at least
    /// zero.
    ///
    /// # Errors
    /// [`OutsideBounds`] if it is not.
    pub fn check_bounds(&self, value: f64) -> Result<(), OutsideBounds> {
        let low = if self.nonnegative { self.low.max(0.0) } else { self.low };
        OutsideBounds::check(|| self.name.clone(), value, (low, self.high), &self.unit)
    }
}

/// A name that the model does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {kind} `{}`; {advice}", crate::scenario::shortened(name))]
pub struct UnknownName {
    /// Expected kind of the name.
    pub kind: &'static str,
    /// The name.
    pub name: String,
    /// The nearest name, and the list of the right ones.
    pub advice: String,
}

impl UnknownName {
    /// The error for `name` where `known` are the right names.
    pub fn new<'a>(kind: &'static str, name: &str, known: impl Iterator<Item = &'a str>) -> Self {
        let known: Vec<&str> = known.collect();
        let guess = suggest(name, known.iter().copied()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
        Self { kind, name: name.into(), advice: format!("{guess}{}", list(&known)) }
    }
}

/// "known: a, b, c", cut after a dozen.
fn list(known: &[&str]) -> String {
    const SHOWN: usize = 12;
    match known.len() {
        0 => "the model has none".into(),
        n if n <= SHOWN => format!("known: {}", known.join(", ")),
        n => format!("known: {}, ... ({n} in all)", known[..SHOWN].join(", ")),
    }
}

/// The elements of all roles.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    /// Differential states, places in `y`.
    pub states: Family,
    /// Solved algebraic variables, places in `y`.
    pub solved: Family,
    /// Those of them that were declared as states and follow from constraints.
    pub following: Family,
    /// Algebraic outputs, places in the output vector.
    pub algebraics: Family,
    /// Discrete variables, places in their region; so the following.
    pub discretes: Family,
    /// Actions.
    pub actions: Family,
    /// Disturbances.
    pub disturbances: Family,
    /// Names of disturbances that follow data over time.
    pub measured: Vec<String>,
    /// Parameters.
    pub parameters: Family,
}

impl Catalogue {
    /// The catalogue of a model.
    #[must_use]
    pub fn new(model: &CompiledModel) -> Self {
        let interface = model.interface();
        let solved = family(&interface.quantities.solved, |_, _, running| model.states() + running);
        let follow = interface.reduction.demoted.iter().flat_map(|demoted| &demoted.elements);
        let following = follow.filter_map(|name| solved.find(name).cloned()).collect();
        Self {
            states: states(interface),
            following: Family::new(following),
            solved,
            algebraics: family(&interface.quantities.algebraics, |_, _, running| running),
            discretes: region(model, &interface.quantities.discretes),
            actions: region(model, &interface.quantities.actions),
            disturbances: disturbances(model),
            measured: interface.measured.clone(),
            parameters: parameters(model),
        }
    }
}

impl Catalogue {
    /// A declared state by its name, also one that follows from a constraint.
    #[must_use]
    pub fn state(&self, name: &str) -> Option<&Element> {
        self.states.find(name).or_else(|| self.following.find(name))
    }
}

/// The parameters alone, places in their region.
#[must_use]
pub fn parameters(model: &CompiledModel) -> Family {
    region(model, &model.interface().quantities.parameters)
}

/// Positions of the elements of a parameter: of a whole array by its name, or of one of them.
#[must_use]
pub fn positions_of(model: &CompiledModel, parameters: &Family, name: &str) -> Option<Range<usize>> {
    // `c[water, 3]` is as good as `c[water,3]`.
    let name = name.replace(' ', "");
    if let Some(at) = parameters.position(&name) {
        return Some(at..at + 1);
    }
    let mut first = 0;
    for quantity in &model.interface().quantities.parameters {
        if quantity.name == name {
            return Some(first..first + quantity.len());
        }
        first += quantity.len();
    }
    None
}

/// The elements of a parameter: of a whole array by its name, or one of them; empty without such a
/// parameter.
#[must_use]
pub fn elements_of<'f>(model: &CompiledModel, parameters: &'f Family, name: &str) -> &'f [Element] {
    positions_of(model, parameters, name).map_or(&[], |positions| &parameters.elements()[positions])
}

/// The disturbances alone, places in their region.
#[must_use]
pub fn disturbances(model: &CompiledModel) -> Family {
    region(model, &model.interface().quantities.disturbances)
}

fn region(model: &CompiledModel, quantities: &[Quantity]) -> Family {
    family(quantities, |quantity, element, running| {
        let first = quantity.var.and_then(|var| model.offset(var));
        first.map_or(running, |first| first + element)
    })
}

/// The states in declaration order; the quantities list them in the order of `y`.
fn states(interface: &Interface) -> Family {
    let inside = family(&interface.quantities.states, |_, _, running| running);
    let Some(order) = &interface.quantities.state_order else {
        return inside;
    };
    let elements = order.iter().filter_map(|&at| inside.elements.get(at as usize));
    Family::new(elements.cloned().collect())
}

/// Flattens quantities; `place` gets the quantity, the element in it, and the running number.
fn family(quantities: &[Quantity], place: impl Fn(&Quantity, usize, usize) -> usize) -> Family {
    let mut elements = Vec::with_capacity(quantities.iter().map(Quantity::len).sum());
    for quantity in quantities {
        for element in 0..quantity.len() {
            let pick = |values: &[f64]| Quantity::pick(values, element);
            elements.push(Element {
                name: quantity.element_name(element),
                unit: quantity.unit.clone(),
                at: place(quantity, element, elements.len()),
                low: pick(&quantity.low),
                high: pick(&quantity.high),
                default: pick(&quantity.default),
                scale: pick(&quantity.scale),
                structural: quantity.structural,
                nonnegative: quantity.nonnegative,
            });
        }
    }
    Family::new(elements)
}

/// Name and unit of time as a message shows them: `min`.
#[must_use]
pub fn time_unit(interface: &Interface) -> &str {
    &interface.time.unit
}
