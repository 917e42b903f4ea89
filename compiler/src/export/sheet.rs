//! The functions of a model with the arrays that they read and write: what the generators of code
//! have in common.
//!
//! Every variable of the model becomes a part of a few vectors in public order: `y` (states, then
//! solved algebraic variables) with `y'`, actions `u`, parameters `p`, context `c`. Addresses stay
//! affine in loop counters inside of the model. [`Sheet::read`] has their public order element by
//! element, and each printer finds the shortest form of it.

use super::{Element, ExportError, Families, Nominal};
use crate::differentiate::pattern::each;
use crate::ir::{Affine, Builtin, Expr, ExprId, FastMap, FastSet, Flavour, MAX_DEPTH, Role, VarId};
use crate::model::Model;

/// Vectors that exported functions take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Array {
    /// Unknowns: states, then solved algebraic variables.
    Y,
    /// Their time derivatives.
    Yp,
    /// Actions.
    U,
    /// Parameters, discrete variables, disturbances, and what else the equations need.
    P,
    /// Values for functions of a whole step only.
    C,
    /// Values computed in advance.
    W,
    /// The factor of the derivatives in the Jacobian.
    Factor,
}

/// Counter and passes of loops, outermost first.
pub(super) type Loops = Vec<(u8, u32)>;

/// Stores in a nest of loops.
#[derive(Clone, Debug)]
pub(super) struct Nest {
    pub loops: Loops,
    pub stores: Vec<Store>,
}

/// One store.
#[derive(Clone, Debug)]
pub(super) struct Store {
    /// Destination; `None` is the output.
    pub array: Option<Array>,
    /// Element for each pass, the last loop fastest.
    pub positions: Vec<u32>,
    /// Add to what is there.
    pub add: bool,
    pub value: ExprId,
}

/// A number of an output.
#[derive(Clone, Debug, Default)]
pub(super) struct Label {
    pub name: String,
    pub unit: String,
}

/// A function of a model.
#[derive(Clone, Debug)]
pub(super) struct Function {
    /// Identifier.
    pub name: String,
    /// Computed expression.
    pub text: String,
    /// Nests in order.
    pub nests: Vec<Nest>,
    /// Changes `y` and `p` in place, nest after nest; no output then.
    pub update: bool,
    /// The numbers of the output.
    pub outputs: Vec<Label>,
}

/// Functions that an integrator calls: what they need in addition to states, actions and parameters
/// becomes a part of `p`.
pub(super) fn is_dynamic(name: &str) -> bool {
    matches!(name, "residual" | "rates" | "algebraic" | "outputs" | "events" | "integrals" | "jacobian" | "delayed" | "lags" | "before")
}

/// Source of a load.
pub(super) struct Read {
    pub array: Array,
    /// The loops that move it.
    pub loops: Loops,
    /// Element for each of their passes.
    pub positions: Vec<u32>,
}

/// Passes of the loops around, by counter; 0 without a loop.
pub(super) type Extents = [u32; MAX_DEPTH];

/// An element of a copy of a variable.
pub(super) type Copied = (VarId, Flavour, u32);

/// Place of a value: vector and element.
pub(super) type Spot = (Array, u32);

/// A model as vectors and functions.
pub(super) struct Sheet {
    pub model: Model,
    pub families: Families,
    /// The elements of `p`.
    pub parameters: Vec<Element>,
    /// The elements of `c`.
    pub context: Vec<Element>,
    pub functions: Vec<Function>,
    /// Vector and element of each element of a variable's copy; `u32::MAX` for one that no function
    /// reads.
    spots: FastMap<(VarId, Flavour), (Array, Vec<u32>)>,
    /// Extra elements of `p` and of `c`.
    extra: FastMap<Copied, Spot>,
}

impl Sheet {
    /// The vectors of a model, without functions.
    pub(super) fn new(model: &Model, nominal: &Nominal<'_>) -> Sheet {
        let mut sheet = Sheet {
            model: model.clone(),
            families: Families::new(model, nominal),
            parameters: vec![],
            context: vec![],
            functions: vec![],
            spots: FastMap::default(),
            extra: FastMap::default(),
        };
        sheet.place(nominal);
        sheet
    }

    /// Number of unknowns.
    pub(super) fn unknowns(&self) -> usize {
        self.families.states.len() + self.families.solved.len()
    }

    /// Number of states.
    pub(super) fn states(&self) -> usize {
        self.families.states.len()
    }

    /// The function of a name.
    pub(super) fn function(&self, name: &str) -> Option<&Function> {
        self.functions.iter().find(|f| f.name == name)
    }

    /// Returns `true` if time itself occurs in a function.
    pub(super) fn uses_time(&self, function: &Function) -> bool {
        let mut found = false;
        self.each_node(function, &mut |node| found |= node == Expr::Time);
        found
    }

    /// Returns `true` if a function reads a vector.
    pub(super) fn uses(&self, function: &Function, array: Array) -> bool {
        let mut found = false;
        self.each_node(function, &mut |node| {
            if let Expr::Load { var, flavour, at } = node {
                let element = at.offset as u32;
                found |= self.spot(var, flavour, element).is_some_and(|(of, _)| of == array);
            }
        });
        found
    }

    /// The copies of variables that a function reads.
    pub(super) fn loads(&self, function: &Function) -> Vec<(VarId, Flavour)> {
        let mut found = vec![];
        self.each_node(function, &mut |node| {
            if let Expr::Load { var, flavour, .. } = node {
                found.push((var, self.copy(var, flavour)));
            }
        });
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Vector and element that hold a value, if a function reads it.
    pub(super) fn place_of(&self, var: VarId, flavour: Flavour, element: u32) -> Option<(Array, u32)> {
        self.spot(var, flavour, element)
    }

    /// Values without a public name: copy, element and place.
    pub(super) fn extras(&self) -> Vec<(Copied, Spot)> {
        let mut extras: Vec<_> = self.extra.iter().map(|(key, spot)| (*key, *spot)).collect();
        extras.sort_unstable();
        extras
    }

    fn each_node(&self, function: &Function, visit: &mut dyn FnMut(Expr)) {
        let values = function.nests.iter().flat_map(|n| &n.stores).map(|s| s.value);
        self.model.exprs.below(values).for_each(|e| visit(self.model.exprs.node(e)));
    }

    /// Gives every element of a variable its place in public order.
    fn place(&mut self, nominal: &Nominal<'_>) {
        let f = &self.families;
        self.parameters = f.parameters.iter().chain(&f.discretes).chain(&f.disturbances).cloned().collect();
        let hidden = [Role::Param, Role::Discrete, Role::Disturbance].map(|role| self.unnamed(role, nominal));
        self.parameters.extend(hidden.into_iter().flatten());
        let y: Vec<Element> = self.families.states.iter().chain(&self.families.solved).cloned().collect();
        let actions = self.families.actions.clone();
        let p = self.parameters.clone();
        for (elements, copies) in [
            (&y, &[(Flavour::Value, Array::Y), (Flavour::Derivative, Array::Yp)][..]),
            (&actions, &[(Flavour::Value, Array::U)][..]),
            (&p, &[(Flavour::Value, Array::P)][..]),
        ] {
            for (at, (var, element)) in elements.iter().enumerate().filter_map(|(at, e)| Some((at, e.place?))) {
                for &(flavour, array) in copies {
                    let len = self.model.vars[var].len as usize;
                    let spots = self.spots.entry((var, flavour)).or_insert_with(|| (array, vec![u32::MAX; len]));
                    spots.1[element as usize] = at as u32;
                }
            }
        }
    }

    /// Variables of a role that have no public name.
    fn unnamed(&self, role: Role, nominal: &Nominal<'_>) -> Vec<Element> {
        let known: FastSet<VarId> = self.parameters.iter().filter_map(|e| Some(e.place?.0)).collect();
        let hidden = self.model.vars.iter().filter(|(id, v)| v.role == role && !known.contains(id));
        let elements = hidden.flat_map(|(id, v)| (0..v.len).map(move |i| (id, v, i)));
        elements.map(|(id, v, i)| extra_element(numbered(&v.name, i, v.len), nominal.value(id, Flavour::Value, i), (id, i))).collect()
    }

    /// Values that functions read in addition to states, actions and parameters: in `p` if an
    /// equation or an output needs them, else in `c`. The copy of a variable is not divided.
    pub(super) fn find_extra(&mut self, nominal: &Nominal<'_>) {
        let mut found: [Vec<(VarId, Flavour, u32)>; 2] = [vec![], vec![]];
        for function in &self.functions {
            let list = &mut found[usize::from(!is_dynamic(&function.name))];
            self.each_node(function, &mut |node| self.collect_extra(node, list));
        }
        let [mut dynamic, others] = found;
        let needed: FastSet<(VarId, Flavour)> = dynamic.iter().map(|&(var, flavour, _)| (var, flavour)).collect();
        let goes_along =
            |&(var, flavour, _): &(VarId, Flavour, u32)| needed.contains(&(var, flavour)) && self.model.vars[var].role != Role::Builtin;
        let (along, mut rest): (Vec<_>, Vec<_>) = others.into_iter().partition(goes_along);
        dynamic.extend(along);
        dynamic.sort_unstable();
        dynamic.dedup();
        rest.retain(|key| dynamic.binary_search(key).is_err());
        rest.sort_unstable();
        rest.dedup();
        for (array, keys) in [(Array::P, dynamic), (Array::C, rest)] {
            for (var, flavour, element) in keys {
                let name = self.extra_name((var, flavour, element), nominal);
                let unit = self.extra_unit((var, flavour, element));
                let made = Element { unit, ..extra_element(name, nominal.value(var, flavour, element), (var, element)) };
                let elements = if array == Array::P { &mut self.parameters } else { &mut self.context };
                self.extra.insert((var, flavour, element), (array, elements.len() as u32));
                elements.push(made);
            }
        }
    }

    fn collect_extra(&self, node: Expr, found: &mut Vec<(VarId, Flavour, u32)>) {
        let Expr::Load { var, flavour, at } = node else { return };
        let flavour = self.copy(var, flavour);
        if self.spots.contains_key(&(var, flavour)) || self.is_factor(var, at.offset) {
            return;
        }
        let all = if at.is_constant() { at.offset as u32..at.offset as u32 + 1 } else { 0..self.model.vars[var].len };
        found.extend(all.map(|i| (var, flavour, i)));
    }

    /// A value that does not change within an episode is its own copy at any instant.
    fn copy(&self, var: VarId, flavour: Flavour) -> Flavour {
        match self.model.vars[var].role {
            Role::State | Role::Algebraic | Role::Action | Role::Discrete | Role::Disturbance => flavour,
            _ => Flavour::Value,
        }
    }

    fn is_factor(&self, var: VarId, element: i64) -> bool {
        self.model.vars[var].role == Role::Builtin && element == Builtin::DerivativeFactor as i64
    }

    fn extra_name(&self, (var, flavour, element): (VarId, Flavour, u32), nominal: &Nominal<'_>) -> String {
        let variable = &self.model.vars[var];
        let copy = match flavour {
            Flavour::Value => None,
            Flavour::Derivative => Some("derivative"),
            Flavour::Initial => Some("initial"),
            Flavour::Previous => Some("previous"),
            Flavour::Steady => Some("steady"),
        };
        let f = &self.families;
        let named = [&f.states, &f.solved, &f.actions, &self.parameters].into_iter().flatten();
        let public = named.into_iter().find(|e| e.place == Some((var, element))).map(|e| e.name.clone());
        let name = match variable.role {
            Role::Builtin => BUILTINS.get(element as usize).map_or("builtin", |name| *name).to_owned(),
            Role::Draw => {
                let stream = self.model.interface.draws.get(element as usize).map_or("", |d| d.stream.as_str());
                format!("draw({stream},{})", element + 1)
            }
            Role::Quadrature => format!("integral({})", element + 1),
            Role::ParamGiven => format!("given({})", self.parameter_at(element, nominal)),
            _ => public.unwrap_or_else(|| numbered(&variable.name, element, variable.len)),
        };
        copy.map_or(name.clone(), |copy| format!("{copy}({name})"))
    }

    /// The unit of a copy of a variable, or of what only functions of a whole step need; empty
    /// where it is not known.
    fn extra_unit(&self, (var, flavour, element): (VarId, Flavour, u32)) -> String {
        let f = &self.families;
        let public = || {
            let named = [&f.states, &f.solved, &f.actions, &self.parameters].into_iter().flatten();
            named.into_iter().find(|e| e.place == Some((var, element))).map(|e| e.unit.clone())
        };
        match self.model.vars[var].role {
            Role::Builtin if TIMES.contains(&element) => self.model.interface.time.unit.clone(),
            Role::Quadrature => self.model.quadrature_units.get(element as usize).cloned().unwrap_or_default(),
            Role::Builtin | Role::Draw | Role::ParamGiven => "1".into(),
            _ if flavour == Flavour::Derivative => String::new(),
            _ => public().unwrap_or_default(),
        }
    }

    /// The name of the parameter at a place of their region.
    fn parameter_at(&self, at: u32, nominal: &Nominal<'_>) -> String {
        let here = |e: &&Element| {
            let of = |(var, element): (VarId, u32)| Some((self.model.vars[var].role, nominal.layout.offset(var)? as u32 + element));
            e.place.and_then(of) == Some((Role::Param, at))
        };
        self.parameters.iter().find(here).map_or_else(|| (at + 1).to_string(), |e| e.name.clone())
    }

    /// Vector and element that hold an element of a variable.
    fn spot(&self, var: VarId, flavour: Flavour, element: u32) -> Option<(Array, u32)> {
        if self.is_factor(var, i64::from(element)) {
            return Some((Array::Factor, 0));
        }
        let flavour = self.copy(var, flavour);
        if let Some((array, spots)) = self.spots.get(&(var, flavour)) {
            return spots.get(element as usize).filter(|&&at| at != u32::MAX).map(|&at| (*array, at));
        }
        self.extra.get(&(var, flavour, element)).copied()
    }

    /// Places of a variable that was made for what is computed ahead, one after another from
    /// `first` on.
    pub(super) fn place_cache(&mut self, var: VarId, first: u32) {
        let len = self.model.vars[var].len;
        self.spots.insert((var, Flavour::Value), (Array::W, (first..first + len).collect()));
    }

    /// The elements that an address means, pass after pass.
    ///
    /// # Errors
    /// If the variable has no place: no function of the outside has it.
    pub(super) fn read(&self, var: VarId, flavour: Flavour, at: Affine, extents: &Extents) -> Result<Read, ExportError> {
        let moved = (0..MAX_DEPTH).filter(|&d| at.strides[d] != 0);
        let loops: Loops = moved.map(|d| (d as u8, extents[d])).collect();
        let (mut array, mut positions, mut missing) = (None, vec![], false);
        each(&loops, |counters| match self.spot(var, flavour, at.at(counters) as u32) {
            Some((of, position)) if array.is_none_or(|a| a == of) => {
                array = Some(of);
                positions.push(position);
            }
            _ => missing = true,
        });
        match array {
            Some(array) if !missing => Ok(Read { array, loops, positions }),
            _ => Err(ExportError::Unavailable { variable: self.model.vars[var].name.clone() }),
        }
    }
}

/// Names of the elements of the builtin variable.
const BUILTINS: [&str; 8] = ["steps", "clock", "step_length", "last_step", "failed", "action_excess", "begin", "derivative_factor"];

/// Those of them that are times.
const TIMES: [u32; 3] = [Builtin::Clock as u32, Builtin::StepLength as u32, Builtin::Begin as u32];

fn numbered(name: &str, element: u32, len: u32) -> String {
    if len == 1 { name.to_owned() } else { format!("{name}[{}]", element + 1) }
}

fn extra_element(name: String, nominal: f64, place: (VarId, u32)) -> Element {
    let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
    Element { name, unit: "1".into(), text: String::new(), low, high, scale: 1.0, nominal, structural: false, place: Some(place) }
}
