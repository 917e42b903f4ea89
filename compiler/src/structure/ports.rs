//! Members of ports that equal another quantity: a member connected to an action is that action.

use crate::elaborate::for_each_element;
use crate::ir::{Expr, FastMap, Flavour, Place, VarId};
use crate::model::{Model, Quantity};

/// Names what the members of ports are equal to, by the program that gives the outputs.
pub(crate) fn identify(model: &mut Model) {
    if model.interface.ports.is_empty() {
        return;
    }
    let loaded = plain_loads(model);
    let names = names(model);
    let mut equal: FastMap<String, Option<String>> = FastMap::default();
    let mut first = 0;
    for output in &model.interface.quantities.algebraics {
        let elements = first..first + output.len() as i64;
        first = elements.end;
        let whole = whole(&loaded, elements, model);
        equal.insert(output.name.clone(), whole.and_then(|var| names.get(&var).cloned()));
    }
    for member in model.interface.ports.iter_mut().flat_map(|port| &mut port.members) {
        member.equals = equal.get(&member.output).cloned().flatten();
    }
}

/// The element that each output loads where it does nothing else.
fn plain_loads(model: &Model) -> FastMap<i64, (VarId, i64)> {
    let mut loaded = FastMap::default();
    for nest in &model.programs.outputs.nests {
        for store in nest.stores.iter().filter(|store| store.target.place == Place::Out) {
            let Expr::Load { var, flavour: Flavour::Value, at } = model.exprs.node(store.value) else { continue };
            let mut elements = Vec::new();
            for_each_element(&nest.extents(), at, &mut |element| elements.push(element));
            let mut elements = elements.into_iter();
            for_each_element(&nest.extents(), store.target.at, &mut |out| {
                loaded.extend(elements.next().map(|element| (out, (var, element))))
            });
        }
    }
    loaded
}

/// The variable that outputs load element by element, all of it.
fn whole(loaded: &FastMap<i64, (VarId, i64)>, outputs: std::ops::Range<i64>, model: &Model) -> Option<VarId> {
    let &(var, _) = loaded.get(&outputs.start)?;
    let all = i64::from(model.vars[var].len) == outputs.end - outputs.start;
    (all && outputs.zip(0..).all(|(out, element)| loaded.get(&out) == Some(&(var, element)))).then_some(var)
}

/// Names of the quantities other than outputs, by what holds them.
fn names(model: &Model) -> FastMap<VarId, String> {
    let q = &model.interface.quantities;
    let lists: [&[Quantity]; 5] = [&q.states, &q.actions, &q.disturbances, &q.parameters, &q.discretes];
    lists.into_iter().flatten().filter_map(|q| Some((q.var?, q.name.clone()))).collect()
}
