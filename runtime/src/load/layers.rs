//! Precedence of the values that scenario and call give to parameters and settings.

use std::collections::BTreeMap;

use smpl_compiler::compiled::CompiledModel;

use super::LoadError;
use crate::catalogue;
use crate::scenario::Value;

/// Values by name, in layers: a value of a later layer overrides the earlier ones, a whole array
/// also those of its elements. In the same layer an element overrides its array.
#[derive(Clone, Copy)]
pub(super) struct Layers<'a>(pub &'a [&'a BTreeMap<String, Value>]);

impl<'a> Layers<'a> {
    /// The value of each name and the number of its layer. An array and its elements are separate
    /// names here, since only a model knows the names of elements.
    pub(super) fn names(self) -> BTreeMap<&'a str, (usize, &'a Value)> {
        let layers = self.0.iter().enumerate();
        layers.flat_map(|(number, layer)| layer.iter().map(move |(name, value)| (name.as_str(), (number, value)))).collect()
    }

    /// The value of each parameter, element by element.
    ///
    /// # Errors
    /// A value that is not a number, or a list of another length than the array.
    pub(super) fn parameters(self, model: &CompiledModel) -> Result<BTreeMap<String, f64>, LoadError> {
        let parameters = catalogue::parameters(model);
        let mut given: Vec<_> = self.names().into_iter().map(|(name, (layer, value))| (layer, name, value)).collect();
        let is_element = |name: &str| parameters.position(&name.replace(' ', "")).is_some();
        given.sort_by_key(|&(layer, name, _)| (layer, is_element(name)));
        let mut out = BTreeMap::new();
        for (_, name, value) in given {
            let elements = catalogue::elements_of(model, &parameters, name);
            let wrong = |expected: String| LoadError::Setting { message: format!("parameter `{name}` must be {expected}, not `{value}`") };
            match (elements, value) {
                ([], _) => {}
                (elements, Value::Number(x)) => out.extend(elements.iter().map(|e| (e.name.clone(), *x))),
                (elements, Value::List(list)) if list.len() == elements.len() => {
                    out.extend(elements.iter().zip(list).map(|(e, x)| (e.name.clone(), *x)));
                }
                (elements, Value::List(_)) => return Err(wrong(format!("a list of {}", elements.len()))),
                ([element, ..], _) => return Err(wrong(format!("a number (in {})", element.unit))),
            }
        }
        Ok(out)
    }
}
