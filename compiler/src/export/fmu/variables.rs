//! The variables of an FMU: one for each quantity of the model, arrays as arrays.

use crate::export::sheet::{Array, Sheet};
use crate::export::{Element, ExportError};
use crate::ir::FastSet;
use crate::model::{Quantity, Time};

use super::units;

/// Storage of a variable, by the names of the tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Time,
    Y,
    Z,
    Yp,
    U,
    P,
    Out,
    Observed,
    Event,
    Switch,
}

/// Public role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FmuRole {
    Time,
    State,
    /// Rate of the state of that value reference.
    Rate(usize),
    Input,
    Output,
    /// Computed, and no output.
    Local,
    Discrete,
    Parameter,
    /// A parameter that shaped the model or its steady state.
    Shaped,
    Switch,
}

/// A variable; its value reference is its place in the list.
pub(super) struct Variable {
    pub name: String,
    pub text: String,
    pub unit: String,
    pub source: Source,
    pub kind: FmuRole,
    /// Lengths of its axes; none for a scalar.
    pub shape: Vec<usize>,
    pub elements: Vec<Element>,
    /// Places of the elements in their storage.
    pub places: Vec<u32>,
    /// A state with elements that an event or a sampling instant sets.
    pub reinit: bool,
}

pub(super) struct Variables {
    pub list: Vec<Variable>,
    /// The states in the order of the FMU: where each is in `y`.
    pub states: Vec<u32>,
}

/// Observations beyond this number are one array.
const MOST_OBSERVATIONS: usize = 200;

impl Variables {
    pub(super) fn new(sheet: &Sheet, reads_steady: bool) -> Result<Variables, ExportError> {
        let mut variables = Variables { list: vec![], states: vec![] };
        variables.add_time(sheet);
        variables.add_states(sheet);
        let (i, f) = (&sheet.model.interface, &sheet.families);
        let (parameters, discretes) = (f.parameters.len() as u32, f.discretes.len() as u32);
        let parameter = |q: &Quantity| if q.structural || reads_steady { FmuRole::Shaped } else { FmuRole::Parameter };
        variables.add(&i.quantities.actions, &f.actions, (Source::U, 0), |_| FmuRole::Input);
        variables.add(&i.quantities.disturbances, &f.disturbances, (Source::P, parameters + discretes), |_| FmuRole::Input);
        variables.add(&i.quantities.algebraics, &f.outputs, (Source::Out, 0), |_| FmuRole::Output);
        variables.add(&i.quantities.solved, &f.solved, (Source::Z, f.states.len() as u32), |_| FmuRole::Local);
        variables.add(&i.quantities.discretes, &f.discretes, (Source::P, parameters), |_| FmuRole::Discrete);
        variables.add(&i.quantities.parameters, &f.parameters, (Source::P, 0), parameter);
        variables.add_observations(sheet);
        variables.add_events(sheet);
        variables.make_unique();
        variables.check_starts()?;
        Ok(variables)
    }

    fn add_time(&mut self, sheet: &Sheet) {
        let Time { name, unit } = &sheet.model.interface.time;
        self.list.push(Variable { kind: FmuRole::Time, ..scalar(name, "time", unit, Source::Time) });
    }

    /// States with their rates behind them.
    fn add_states(&mut self, sheet: &Sheet) {
        let (i, f) = (&sheet.model.interface, &sheet.families);
        let reset = reset_states(sheet);
        // Where the states of `y` in the order of the quantities are outside.
        let mut outside: Vec<u32> = (0..f.states.len() as u32).collect();
        if let Some(order) = &i.quantities.state_order {
            (0..).zip(order).for_each(|(public, &own)| outside[own as usize] = public);
        }
        let mut first = 0;
        for quantity in &i.quantities.states {
            let places = outside[first..first + quantity.len()].to_vec();
            first += quantity.len();
            let elements: Vec<Element> = places.iter().map(|&at| f.states[at as usize].clone()).collect();
            self.states.extend(&places);
            let state = self.list.len();
            let own = variable(quantity, elements.clone(), places.clone(), (Source::Y, FmuRole::State));
            self.list.push(Variable { reinit: places.iter().any(|place| reset.contains(place)), ..own });
            let mut rate = variable(quantity, elements, places, (Source::Yp, FmuRole::Rate(state)));
            rate.name = format!("der({})", rate.name);
            rate.text = format!("rate of {}", quantity.name);
            rate.unit = units::rate(&quantity.unit, &i.time.unit).unwrap_or_default();
            self.list.push(rate);
        }
    }

    fn add(&mut self, quantities: &[Quantity], elements: &[Element], (source, first): (Source, u32), kind: impl Fn(&Quantity) -> FmuRole) {
        let mut at = 0;
        for quantity in quantities {
            let range = at..at + quantity.len();
            at = range.end;
            let places = range.clone().map(|place| first + place as u32).collect();
            self.list.push(variable(quantity, elements[range].to_vec(), places, (source, kind(quantity))));
        }
    }

    fn add_observations(&mut self, sheet: &Sheet) {
        let observed = &sheet.model.interface.finish.observations;
        let element = |o: &crate::model::Observed| Element {
            name: o.name.clone(),
            unit: o.unit.clone(),
            text: String::new(),
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
            scale: f64::NAN,
            nominal: f64::NAN,
            structural: false,
            place: None,
        };
        if observed.len() > MOST_OBSERVATIONS {
            let all = scalar("observations", "what is observed, in the order of resources/elements.csv", "", Source::Observed);
            let elements: Vec<Element> = observed.iter().map(element).collect();
            let places = (0..observed.len() as u32).collect();
            self.list.push(Variable { kind: FmuRole::Output, shape: vec![observed.len()], elements, places, ..all });
            return;
        }
        for (at, o) in (0..).zip(observed) {
            let text = format!("observed {}, without noise and delay", o.name);
            let one = scalar(&format!("obs_{}", o.name), &text, &o.unit, Source::Observed);
            self.list.push(Variable { kind: FmuRole::Output, elements: vec![element(o)], places: vec![at], ..one });
        }
    }

    fn add_events(&mut self, sheet: &Sheet) {
        let roots = &sheet.model.roots;
        for (at, root) in (0..).zip(roots) {
            let text = format!("condition of {}, positive where it holds", root.name);
            let one = scalar(&format!("event_indicator[{}]", at + 1), &text, "", Source::Event);
            self.list.push(Variable { places: vec![at], ..one });
        }
        if !roots.is_empty() || !sheet.model.interface.finish.failures.is_empty() {
            let text = "whether a failure of the model ends the simulation";
            self.list.push(Variable { kind: FmuRole::Switch, ..scalar("stop_at_failure", text, "", Source::Switch) });
        }
    }

    /// Renames variables with the name of an earlier one, such as an algebraic variable that is an
    /// output too.
    fn make_unique(&mut self) {
        let mut known: FastSet<String> = FastSet::default();
        for variable in &mut self.list {
            while !known.insert(variable.name.clone()) {
                variable.name.push('\'');
            }
        }
    }

    fn check_starts(&self) -> Result<(), ExportError> {
        let needs =
            |v: &&Variable| !matches!(v.kind, FmuRole::Time | FmuRole::Rate(_) | FmuRole::Output | FmuRole::Local | FmuRole::Switch);
        let mut elements = self.list.iter().filter(needs).flat_map(|v| &v.elements);
        match elements.find(|e| !e.nominal.is_finite()) {
            Some(e) => Err(ExportError::NoStart { name: e.name.clone() }),
            None => Ok(()),
        }
    }
}

/// Places in `y` that updates of the model set after the start.
fn reset_states(sheet: &Sheet) -> FastSet<u32> {
    let updates = sheet.functions.iter().filter(|f| f.update && (matches!(&*f.name, "start" | "end") || f.name.starts_with("event_")));
    let stores = updates.flat_map(|f| &f.nests).flat_map(|nest| &nest.stores);
    stores.filter(|store| store.array == Some(Array::Y)).flat_map(|store| store.positions.iter().copied()).collect()
}

fn scalar(name: &str, text: &str, unit: &str, source: Source) -> Variable {
    Variable {
        name: name.to_owned(),
        text: text.to_owned(),
        unit: unit.to_owned(),
        source,
        kind: FmuRole::Local,
        shape: vec![],
        elements: vec![],
        places: vec![0],
        reinit: false,
    }
}

fn variable(quantity: &Quantity, elements: Vec<Element>, places: Vec<u32>, (source, kind): (Source, FmuRole)) -> Variable {
    let shape = quantity.axes.iter().map(crate::model::Axis::len).collect();
    let unit = quantity.unit.clone();
    Variable { name: quantity.name.clone(), text: quantity.text.clone(), unit, source, kind, shape, elements, places, reinit: false }
}
