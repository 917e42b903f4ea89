//! Names, units, bounds and places of the single numbers of a model, in declaration order.

use crate::ir::{Flavour, VarId};
use crate::layout::{Base, Layout};
use crate::model::{Model, Quantity};

/// One number with a public name.
#[derive(Clone, Debug)]
pub struct Element {
    /// Flattened name, `R1.c[tropine,3]`.
    pub name: String,
    /// Unit as declared; `1` when dimensionless.
    pub unit: String,
    /// Describing text of its quantity.
    pub text: String,
    /// Lower bound, at least zero for nonnegative states; -inf where none.
    pub low: f64,
    /// Upper bound; inf where none.
    pub high: f64,
    /// Magnitude for tolerances.
    pub scale: f64,
    /// Value at the nominal point.
    pub nominal: f64,
    /// The model was shaped by its value, which is part of the export: another one needs another
    /// export.
    pub structural: bool,
    /// Place; `None` without a separate variable.
    pub place: Option<(VarId, u32)>,
}

/// A point of a model: what exports give as nominal values.
pub struct Nominal<'a> {
    /// Places of all parts.
    pub layout: &'a Layout,
    /// The unknowns.
    pub y: &'a [f64],
    /// The workspace.
    pub work: &'a [f64],
    /// Algebraic outputs.
    pub outputs: &'a [f64],
}

impl Nominal<'_> {
    /// A number of the point; NaN where it has none.
    #[must_use]
    pub fn value(&self, var: VarId, flavour: Flavour, element: u32) -> f64 {
        let Some(address) = self.layout.address(var, flavour) else { return f64::NAN };
        let numbers = match address.base {
            Base::Y => self.y,
            Base::Work => self.work,
            Base::Yp | Base::Out | Base::Factor => return f64::NAN,
        };
        numbers.get((address.offset + element) as usize).copied().unwrap_or(f64::NAN)
    }
}

/// The elements of each role.
#[derive(Clone, Debug, Default)]
pub struct Families {
    /// Differential states.
    pub states: Vec<Element>,
    /// Solved algebraic unknowns.
    pub solved: Vec<Element>,
    /// Algebraic outputs.
    pub outputs: Vec<Element>,
    /// Discrete variables.
    pub discretes: Vec<Element>,
    /// Actions.
    pub actions: Vec<Element>,
    /// Disturbances.
    pub disturbances: Vec<Element>,
    /// Parameters.
    pub parameters: Vec<Element>,
}

impl Families {
    /// The families of a model.
    #[must_use]
    pub fn new(model: &Model, nominal: &Nominal<'_>) -> Families {
        let interface = &model.interface;
        let family = |quantities: &[Quantity]| flatten(quantities, nominal);
        let mut states = family(&interface.quantities.states);
        // The quantities list states in the order of `y`.
        let mut start = 0;
        let mut places = vec![];
        for &var in &model.unknowns {
            places.extend((0..model.vars[var].len).map(|element| (var, element)));
        }
        for element in &mut states {
            element.place = element.place.or_else(|| places.get(start).copied());
            start += 1;
        }
        let mut solved = family(&interface.quantities.solved);
        for (element, place) in solved.iter_mut().zip(places.iter().skip(start)) {
            element.place = Some(*place);
            element.nominal = nominal.value(place.0, Flavour::Value, place.1);
        }
        if let Some(order) = &interface.quantities.state_order {
            states = order.iter().filter_map(|&at| states.get(at as usize).cloned()).collect();
        }
        let mut outputs = family(&interface.quantities.algebraics);
        outputs.iter_mut().zip(nominal.outputs).for_each(|(element, value)| element.nominal = *value);
        Families {
            states,
            solved,
            outputs,
            discretes: family(&interface.quantities.discretes),
            actions: family(&interface.quantities.actions),
            disturbances: family(&interface.quantities.disturbances),
            parameters: family(&interface.quantities.parameters),
        }
    }
}

fn flatten(quantities: &[Quantity], nominal: &Nominal<'_>) -> Vec<Element> {
    let mut elements = Vec::with_capacity(quantities.iter().map(Quantity::len).sum());
    for quantity in quantities {
        for i in 0..quantity.len() {
            let pick = |values: &[f64]| Quantity::pick(values, i);
            let place = quantity.var.map(|var| (var, i as u32));
            elements.push(Element {
                name: quantity.element_name(i),
                unit: quantity.unit.clone(),
                text: quantity.text.clone(),
                low: quantity.least(i),
                high: pick(&quantity.high),
                scale: pick(&quantity.scale),
                nominal: place.map_or(pick(&quantity.default), |(var, i)| nominal.value(var, Flavour::Value, i)),
                structural: quantity.structural,
                place,
            });
        }
    }
    elements
}
