//! Parameters given by name: precedence, element by element, and checks of the values.

use std::collections::BTreeMap;

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::layout::Region;
use smpl_compiler::model::OutsideBounds;

use crate::catalogue::{Element, Family, UnknownName, positions_of};
use crate::scenario::Value;
use crate::system::CompiledSystem;

/// Reason why a parameter cannot have a value.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// A name that the model does not have.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// A value of another kind, or a list of another length than the array.
    #[error("parameter `{name}` must be {expected}, not `{value}`")]
    Value {
        /// Its name.
        name: String,
        /// Expected value.
        expected: String,
        /// The value as text.
        value: String,
    },
    /// A value that is NaN or infinite.
    #[error("parameter `{name}` must be finite")]
    NotFinite {
        /// Its name.
        name: String,
    },
    /// Another value of a parameter that gave the model sizes or indices when it was compiled.
    #[error("`{name}` shapes the model, compiled with {value}: give another value where the model is compiled, among its settings")]
    Structural {
        /// Its name.
        name: String,
        /// Value of the compiled model.
        value: f64,
    },
    /// A given value outside its bounds.
    #[error("parameter {0}")]
    OutsideBounds(OutsideBounds),
    /// A drawn or computed value outside its bounds.
    #[error("parameter {0}; it was computed or drawn (`clip bounds` after a distribution keeps what is drawn inside)")]
    Computed(OutsideBounds),
}

/// ParameterNumbers that a caller gives to a parameter.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ParameterNumbers<'a> {
    /// One number for every element.
    Every(f64),
    /// One number for each element.
    Each(&'a [f64]),
}

/// A parameter by its name, in a layer: later layers override earlier ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GivenParameter<'a> {
    /// Number of the layer.
    pub layer: usize,
    /// Name of an array, or of an element.
    pub name: &'a str,
    /// Its numbers.
    pub numbers: ParameterNumbers<'a>,
}

/// One number for each of several names, in one layer.
pub(crate) fn by_name(values: &BTreeMap<String, f64>) -> Vec<GivenParameter<'_>> {
    values.iter().map(|(name, &value)| GivenParameter { layer: 0, name, numbers: ParameterNumbers::Every(value) }).collect()
}

/// Elements that names determine: position of each, number of its name in the list, and place of
/// the element in the array of that name.
///
/// A name of a later layer overrides earlier layers, a whole array also those of its elements. In
/// the same layer an element overrides its array.
///
/// # Errors
/// [`UnknownName`] for a name that is neither a parameter nor an element of one.
pub fn determined(
    model: &CompiledModel,
    parameters: &Family,
    names: &[(usize, &str)],
) -> Result<BTreeMap<usize, (usize, usize)>, UnknownName> {
    let unknown = |name: &str| UnknownName::new("parameter", name, parameters.names());
    let find = |&(_, name): &(usize, &str)| positions_of(model, parameters, name).ok_or_else(|| unknown(name));
    let positions: Vec<_> = names.iter().map(find).collect::<Result<_, _>>()?;
    let is_element = |name: &str| parameters.position(&name.replace(' ', "")).is_some();
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|&i| (names[i].0, is_element(names[i].1)));
    let elements = order.into_iter().flat_map(|i| positions[i].clone().enumerate().map(move |(offset, at)| (at, (i, offset))));
    Ok(elements.collect())
}

/// The value of each given parameter, element by element; see [`determined`] for the precedence.
///
/// # Errors
/// An unknown name, a list of another length than the array, or a value that the parameter cannot
/// have.
pub(crate) fn resolve<'f>(
    model: &CompiledModel,
    parameters: &'f Family,
    given: &[GivenParameter<'_>],
) -> Result<Vec<(&'f Element, f64)>, ParameterError> {
    for &GivenParameter { name, numbers, .. } in given {
        let (ParameterNumbers::Each(list), Some(positions)) = (numbers, positions_of(model, parameters, name)) else { continue };
        if list.len() != positions.len() {
            let (name, value) = (name.to_owned(), Value::List(list.to_vec()).to_string());
            return Err(ParameterError::Value { name, expected: format!("a list of {}", positions.len()), value });
        }
    }
    let names: Vec<_> = given.iter().map(|given| (given.layer, given.name)).collect();
    let value = |(at, (i, offset)): (usize, (usize, usize))| {
        let element = &parameters.elements()[at];
        let value = match given[i].numbers {
            ParameterNumbers::Every(x) => x,
            ParameterNumbers::Each(list) => list[offset],
        };
        check(element, value).map(|()| (element, value))
    };
    determined(model, parameters, &names)?.into_iter().map(value).collect()
}

/// Checks that a parameter may be given a value.
///
/// # Errors
/// A value that is not finite, is outside the bounds, or needs another compilation.
pub fn check(element: &Element, value: f64) -> Result<(), ParameterError> {
    let name = || element.name.clone();
    if !value.is_finite() {
        return Err(ParameterError::NotFinite { name: name() });
    }
    if element.structural && value != element.default {
        return Err(ParameterError::Structural { name: name(), value: element.default });
    }
    element.check_bounds(value).map_err(ParameterError::OutsideBounds)
}

/// Checks the values of all parameters, those that were drawn or computed too.
///
/// # Errors
/// [`ParameterError::Computed`] for the first outside its bounds.
pub fn check_computed(parameters: &Family, system: &CompiledSystem) -> Result<(), ParameterError> {
    let values = system.region(Region::Param);
    let mut bounded = parameters.elements().iter().filter(|e| e.low.is_finite() || e.high.is_finite());
    bounded.try_for_each(|element| element.check_bounds(values[element.at])).map_err(ParameterError::Computed)
}
