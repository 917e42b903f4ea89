//! Layers of the values that scenario and call give to parameters and settings.

use std::collections::BTreeMap;

use smpl_compiler::compiled::CompiledModel;

use super::LoadError;
use crate::catalogue;
use crate::parameters::{GivenParameter, ParameterError, ParameterNumbers, resolve};
use crate::scenario::Value;

/// Values by name, in layers: a value of a later layer overrides the earlier ones.
#[derive(Clone, Copy)]
pub(super) struct Layers<'a>(pub &'a [&'a BTreeMap<String, Value>]);

impl<'a> Layers<'a> {
    /// The value of each name and the number of its layer. An array and its elements are separate
    /// names here, since only a model knows the names of elements.
    pub(super) fn names(self) -> BTreeMap<&'a str, (usize, &'a Value)> {
        let layers = self.0.iter().enumerate();
        layers.flat_map(|(number, layer)| layer.iter().map(move |(name, value)| (name.as_str(), (number, value)))).collect()
    }

    /// The value of each parameter, element by element; other names are those of settings.
    ///
    /// # Errors
    /// A value that the parameter cannot have.
    pub(super) fn parameters(self, model: &CompiledModel) -> Result<BTreeMap<String, f64>, LoadError> {
        let parameters = catalogue::parameters(model);
        let mut given = Vec::new();
        for (name, (layer, value)) in self.names() {
            let [element, ..] = catalogue::elements_of(model, &parameters, name) else { continue };
            let numbers = match value {
                Value::Number(x) => ParameterNumbers::Every(*x),
                Value::List(list) => ParameterNumbers::Each(list),
                Value::Flag(_) | Value::Text(_) => {
                    let (expected, value) = (format!("a number (in {})", element.unit), value.to_string());
                    return Err(ParameterError::Value { name: name.to_owned(), expected, value }.into());
                }
            };
            given.push(GivenParameter { layer, name, numbers });
        }
        let values = resolve(model, &parameters, &given)?;
        Ok(values.into_iter().map(|(element, value)| (element.name.clone(), value)).collect())
    }
}
