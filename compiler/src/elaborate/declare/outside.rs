//! What scenarios and settings say of the variables: parameters and initial values by name, whole arrays and their elements.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};

use crate::elaborate::declare::naming::Naming;
use crate::elaborate::declare::symbols::{Axis, SymbolId, SymbolKind, Symbols};
use crate::elaborate::{ENTRY_SETTINGS, Elaborator, Setting};
use crate::ir::Role;
use crate::model::Quantity;

/// Names that a message lists.
const SHOWN: usize = 20;

/// An element, or all of them, and its number.
type Set = (Option<i64>, f64);

impl Elaborator<'_> {
    /// What is set of a parameter, the whole before its elements, and whether nothing of its declaration is left.
    pub(in crate::elaborate) fn set_from_outside(&mut self, symbol: SymbolId) -> (bool, Vec<Set>) {
        let path = self.symbols[symbol].path.clone();
        let options = self.input.options;
        let mut set = Vec::new();
        if let Some(value) = options.settings.get(&path) {
            self.input.used_settings.insert(path.clone());
            match value {
                Setting::Number(x) => set.push((None, *x)),
                Setting::List(list) => set.extend(self.naming().elements_of_list(symbol, list)),
                Setting::Text(text) => {
                    self.ledger.reports.scenario_fault(format!("the parameter `{path}` takes a number, not `{text}`"), None)
                }
            }
        } else if let Some(x) = options.parameters.get(&path) {
            self.input.used_settings.insert(path.clone());
            set.push((None, *x));
        }
        let is_whole = !set.is_empty();
        let numbers = options.settings.iter().filter_map(|(name, value)| match value {
            Setting::Number(x) => Some((name, *x)),
            _ => None,
        });
        for (name, x) in numbers.chain(options.parameters.iter().map(|(name, x)| (name, *x))) {
            if let Some(at) = self.symbols.element_named(symbol, name) {
                self.input.used_settings.insert(name.clone());
                set.push((Some(at), x));
            }
        }
        (is_whole, set)
    }

    /// Settings that nothing used are faults.
    pub(in crate::elaborate) fn check_settings(&mut self) {
        let options = self.input.options;
        let names = options.settings.keys().chain(options.parameters.keys());
        let unused: Vec<&String> =
            names.filter(|k| !self.input.used_settings.contains(*k) && !ENTRY_SETTINGS.contains(&k.as_str())).collect();
        for name in unused {
            if let Some((what, help)) = self.symbols.other_kind(name) {
                self.ledger.reports.scenario_fault(format!("`{name}` is {what}, not a parameter or setting"), Some(help.to_owned()));
                continue;
            }
            let parameters = self.symbols.variables([Role::Param]).map(|(_, s)| self.symbols[s].path.as_str());
            let known: Vec<&str> = parameters.chain(self.input.selection.chosen.keys().map(String::as_str)).collect();
            let base = name.split('[').next().unwrap_or_default();
            let text = if name.contains('[') && known.contains(&base) {
                format!("`{name}` is no element of the parameter `{base}`; it has {}", self.symbols.elements(base))
            } else {
                let hint = did_you_mean(name, known.iter().copied()).unwrap_or_else(|| listing(&known));
                format!("unknown parameter or setting `{name}`: {hint}")
            };
            self.ledger.reports.scenario_fault(text, None);
        }
    }

    /// Initial values from outside are those of states and discrete variables, within their bounds.
    pub(in crate::elaborate) fn check_initial(&mut self) {
        let options = self.input.options;
        for (name, &x) in &options.initial {
            let roles = [Role::State, Role::Discrete];
            let found = self
                .symbols
                .variables(roles)
                .find(|(_, s)| self.symbols[*s].path == *name || self.symbols.element_named(*s, name).is_some());
            let Some((_, symbol)) = found else {
                let known: Vec<&str> = self.symbols.variables(roles).map(|(_, s)| self.symbols[s].path.as_str()).collect();
                let hint = did_you_mean(name, known.iter().copied()).unwrap_or_else(|| listing(&known));
                self.ledger.reports.scenario_fault(format!("unknown state or discrete variable `{name}`: {hint}"), None);
                continue;
            };
            let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { continue };
            let element = self.symbols.element_named(symbol, name);
            let Some(quantity) = self.symbols.quantities.get(&var) else { continue };
            let elements = element.map_or(0..quantity.len(), |at| at as usize..at as usize + 1);
            let outside = elements.into_iter().find(|&i| !admits(quantity, i, x));
            if let Some(message) = outside.map(|i| outside_bounds(quantity, i, x)) {
                self.ledger.reports.scenario_fault(message, None);
            }
        }
    }

    /// Initial values of elements that are given from outside.
    pub(in crate::elaborate) fn initial_elements(&self, symbol: SymbolId) -> Vec<(i64, f64)> {
        self.input.options.initial.iter().filter_map(|(name, &x)| Some((self.symbols.element_named(symbol, name)?, x))).collect()
    }

    /// A parameter has a value within its bounds, wherever that value comes from.
    pub(in crate::elaborate) fn check_range(&mut self, symbol: SymbolId, quantity: &Quantity) {
        let value = |i: usize| Quantity::pick(&quantity.default, i);
        let outside = (0..quantity.len()).find(|&i| value(i).is_finite() && !admits(quantity, i, value(i)));
        let Some(i) = outside else { return };
        let message = outside_bounds(quantity, i, value(i));
        let (scope, declared) = (self.symbols[symbol].scope, self.symbols[symbol].span);
        let SymbolKind::Variable { declaration, .. } = &self.symbols[symbol].kind else { return };
        // A value of a wrong unit is told as such.
        if self.ledger.reports.diagnostics.iter().any(|d| declaration.span.contains(d.primary.span)) {
            return;
        }
        let (element, given) = (quantity.element_name(i), self.instances.given.get(&(scope, declaration.name.text.clone())));
        if [&element, &quantity.name]
            .iter()
            .any(|name| self.input.options.settings.contains_key(*name) || self.input.options.parameters.contains_key(*name))
        {
            self.ledger.reports.scenario_fault(message, None);
            return;
        }
        let written = given.map(|(e, _)| e.span).or(declaration.value.as_ref().map(|e| e.span));
        self.ledger
            .report(Diagnostic::error(codes::BAD_SETTING, message, written.unwrap_or(declared)).secondary(declared, "declared here"));
    }
}

impl<'a> Naming<'_, 'a> {
    fn elements_of_list(&mut self, symbol: SymbolId, list: &[f64]) -> Vec<Set> {
        let SymbolKind::Variable { var, .. } = self.symbols[symbol].kind else { return Vec::new() };
        let (path, len) = (&self.symbols[symbol].path, self.symbols.vars[var].len as usize);
        if list.len() != len {
            let elements = if len == 1 { "one element".to_owned() } else { format!("{len} elements") };
            self.ledger.reports.scenario_fault(format!("the parameter `{path}` has {elements}, not {}", list.len()), None);
            return Vec::new();
        }
        list.iter().enumerate().map(|(i, x)| (Some(i as i64), *x)).collect()
    }
}

impl<'a> Symbols<'a> {
    /// The element of an array that a flattened name means: `c[water,3]`, or `n7` where the names are made so.
    fn element_named(&self, symbol: SymbolId, name: &str) -> Option<i64> {
        let SymbolKind::Variable { axes, declaration, .. } = &self[symbol].kind else { return None };
        let (before, after) = match &declaration.pattern {
            Some(pattern) => pattern.split_once("{}")?,
            None => (self[symbol].path.as_str(), ""),
        };
        let mut inner = name.strip_prefix(before)?.strip_suffix(after)?;
        if declaration.pattern.is_none() {
            inner = inner.strip_prefix('[')?.strip_suffix(']')?;
        }
        let labels: Vec<&str> = inner.split(',').map(str::trim).collect();
        if axes.is_empty() || labels.len() != axes.len() {
            return None;
        }
        axes.iter().zip(labels).try_fold(0, |at, (&axis, label)| {
            let len = self.axis_len(axis);
            let member = match axis {
                Axis::Set(set) => self.sets[set].labels.iter().position(|l| l == label).map(|i| i as i64),
                Axis::Domain(_) => label.parse::<i64>().ok().map(|i| i - 1),
            };
            member.filter(|i| (0..len).contains(i)).map(|i| at * len + i)
        })
    }

    /// Whether the model has a parameter of that name.
    pub(in crate::elaborate) fn parameters_named(&self, name: &str) -> bool {
        self.variables([Role::Param]).any(|(_, s)| self[s].path == name)
    }

    fn variables<const N: usize>(&self, roles: [Role; N]) -> impl Iterator<Item = (Role, SymbolId)> + '_ {
        let of = move |s: SymbolId| match &self[s].kind {
            SymbolKind::Variable { var, .. } => Some((self.vars[*var].role, s)).filter(|(role, _)| roles.contains(role)),
            _ => None,
        };
        self.list.keys().filter_map(of)
    }

    /// What else a name may stand for, and how that is given.
    fn other_kind(&self, name: &str) -> Option<(&'static str, &'static str)> {
        let base = name.split('[').next().unwrap_or_default();
        let symbol = self.list.values().find(|s| s.path == name || s.path == base)?;
        let role = match &symbol.kind {
            SymbolKind::Variable { var, .. } => self.vars[*var].role,
            SymbolKind::Let { .. } => Role::Algebraic,
            _ => return None,
        };
        Some(match role {
            Role::Action => ("an action", "actions are given step by step: by a table (`--actions`), a policy, or to `step` in Python"),
            Role::State | Role::Discrete => {
                let what = if role == Role::State { "a state" } else { "a discrete variable" };
                (what, "initial values are given under `initial` in a scenario, by `--init`, or by the options of `reset` in Python")
            }
            Role::Disturbance => {
                ("a disturbance", "recorded disturbances are given under `disturbances` in a scenario, or by `--disturbances`")
            }
            Role::Algebraic => ("computed by the model", "set the parameters that it is computed from"),
            _ => return None,
        })
    }

    /// `fault[1], fault[2]`, cut after some.
    fn elements(&self, path: &str) -> String {
        let quantity = self.quantities.values().find(|q| q.name == path);
        let count = quantity.map_or(0, Quantity::len);
        let shown = quantity.into_iter().flat_map(|q| (0..count.min(SHOWN)).map(|i| q.element_name(i))).collect::<Vec<_>>().join(", ");
        match count {
            0 | 1 => "no elements".to_owned(),
            n if n > SHOWN => format!("{shown}, ... ({n} in all)"),
            _ => shown,
        }
    }
}

fn admits(quantity: &Quantity, i: usize, x: f64) -> bool {
    Quantity::admits(Quantity::pick(&quantity.low, i), Quantity::pick(&quantity.high, i), x)
}

/// `k = 5 lies outside of its bounds 0..2 1/min`.
fn outside_bounds(quantity: &Quantity, i: usize, x: f64) -> String {
    let (low, high) = (Quantity::pick(&quantity.low, i), Quantity::pick(&quantity.high, i));
    let unit = if quantity.unit == "1" { String::new() } else { format!(" {}", quantity.unit) };
    format!("`{}` = {x} lies outside of its bounds {low}..{high}{unit}", quantity.element_name(i))
}

/// What there is, cut after some.
fn listing(known: &[&str]) -> String {
    match known.len() {
        0 => "the model has none".to_owned(),
        n if n > SHOWN => format!("the model has {}, ... ({n} in all)", known[..SHOWN].join(", ")),
        _ => format!("the model has {}", known.join(", ")),
    }
}
