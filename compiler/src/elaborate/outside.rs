//! Values of variables from scenarios and settings: parameters and initial values by name, whole
//! arrays and their elements.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::Declaration;

use crate::elaborate::episode::is_entry_setting;
use crate::elaborate::lower::Lowering;
use crate::elaborate::symbols::{SymbolId, SymbolKind, Symbols};
use crate::ir::{FastMap, Role, VarId};
use crate::model::Quantity;

/// Names that a message lists.
const SHOWN: usize = 20;

/// Settings that nothing used are faults.
pub(in crate::elaborate) fn check_settings(l: &mut Lowering<'_, '_>) {
    let options = l.input.options;
    let names = options.settings.keys().chain(options.parameters.keys());
    let unused: Vec<&String> = names.filter(|k| !l.constants.taken.contains(*k) && !is_entry_setting(k)).collect();
    for name in unused {
        if let Some((what, help)) = l.symbols.other_kind(name) {
            l.ledger.reports.scenario_fault(name, format!("`{name}` is {what}, not a parameter or setting"), Some(help.to_owned()));
            continue;
        }
        let parameters = l.symbols.variables([Role::Param]).map(|(_, s)| l.symbols[s].path.as_str());
        let known: Vec<&str> = parameters.chain(l.input.selection.chosen.keys().map(String::as_str)).collect();
        let base = name.split('[').next().unwrap_or_default();
        let text = if name.contains('[') && known.contains(&base) {
            format!("`{name}` is not an element of the parameter `{base}`; it has {}", l.symbols.elements(base, l.quantities))
        } else {
            let hint = did_you_mean(name, known.iter().copied()).unwrap_or_else(|| listing(&known));
            format!("unknown parameter or setting `{name}`: {hint}")
        };
        l.ledger.reports.scenario_fault(name, text, None);
    }
}

/// Initial values from outside are those of states and discrete variables, within their bounds.
pub(in crate::elaborate) fn check_initial(l: &mut Lowering<'_, '_>) {
    let options = l.input.options;
    for (name, &x) in &options.initial {
        let roles = [Role::State, Role::Discrete];
        let found = l.symbols.variables(roles).find(|(_, s)| l.symbols[*s].path == *name || l.symbols.element_named(*s, name).is_some());
        let Some((_, symbol)) = found else {
            let known: Vec<&str> = l.symbols.variables(roles).map(|(_, s)| l.symbols[s].path.as_str()).collect();
            let hint = did_you_mean(name, known.iter().copied()).unwrap_or_else(|| listing(&known));
            l.ledger.reports.scenario_fault(name, format!("unknown state or discrete variable `{name}`: {hint}"), None);
            continue;
        };
        let SymbolKind::Variable { var, .. } = l.symbols[symbol].kind else { continue };
        let element = l.symbols.element_named(symbol, name);
        let Some(quantity) = l.quantities.get(&var) else { continue };
        let elements = element.map_or(0..quantity.len(), |at| at as usize..at as usize + 1);
        if let Some(outside) = elements.into_iter().find_map(|i| quantity.check(i, x).err()) {
            l.ledger.reports.scenario_fault(name, outside.to_string(), None);
        }
    }
}

/// Initial values of elements that are given from outside.
pub(in crate::elaborate) fn initial_elements(l: &Lowering<'_, '_>, symbol: SymbolId) -> Vec<(i64, f64)> {
    l.input.options.initial.iter().filter_map(|(name, &x)| Some((l.symbols.element_named(symbol, name)?, x))).collect()
}

/// A parameter has a value within its bounds, wherever that value comes from.
pub(in crate::elaborate) fn check_range(l: &mut Lowering<'_, '_>, symbol: SymbolId, quantity: &Quantity) {
    let value = |i: usize| Quantity::pick(&quantity.default, i);
    let outside = |i| if f64::is_finite(value(i)) { Some((i, quantity.check(i, value(i)).err()?.to_string())) } else { None };
    let Some((i, message)) = (0..quantity.len()).find_map(outside) else { return };
    let (scope, declared) = (l.symbols[symbol].scope, l.symbols[symbol].span);
    let SymbolKind::Variable { declaration, .. } = &l.symbols[symbol].kind else { return };
    // A value of a wrong unit is reported as such.
    if l.ledger.reports.diagnostics.iter().any(|d| declaration.span.contains(d.primary.span)) {
        return;
    }
    let (element, given) = (quantity.element_name(i), l.instances.given.get(&(scope, declaration.name.text.clone())));
    let options = l.input.options;
    let is_given = |name: &&&String| options.settings.contains_key(**name) || options.parameters.contains_key(**name);
    if let Some(name) = [&element, &quantity.name].iter().find(is_given) {
        l.ledger.reports.scenario_fault(name, message, None);
        return;
    }
    let written = given.map(|(e, _)| e.span).or(declaration.value.as_ref().map(|e| e.span));
    l.ledger.report(Diagnostic::error(codes::BAD_SETTING, message, written.unwrap_or(declared)).secondary(declared, "declared here"));
}

impl<'a> Symbols<'a> {
    /// Other meaning of a name, and the way to give it.
    fn other_kind(&self, name: &str) -> Option<(&'static str, &'static str)> {
        let base = name.split('[').next().unwrap_or_default();
        let named = || self.list.values().filter(|s| s.path == name || s.path == base);
        if named().any(|s| matches!(s.kind, SymbolKind::Variable { declaration: Declaration { measured: Some(_), .. }, .. })) {
            let help = "a scenario names another file, `disturbances: {T_amb: {from: other.csv}}`, or one number";
            return Some(("a disturbance that follows a file", help));
        }
        let symbol = named().next()?;
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
    fn elements(&self, path: &str, quantities: &FastMap<VarId, Quantity>) -> String {
        let quantity = quantities.values().find(|q| q.name == path);
        let count = quantity.map_or(0, Quantity::len);
        let shown = quantity.into_iter().flat_map(|q| (0..count.min(SHOWN)).map(|i| q.element_name(i))).collect::<Vec<_>>().join(", ");
        match count {
            0 | 1 => "no elements".to_owned(),
            n if n > SHOWN => format!("{shown}, ... ({n} in all)"),
            _ => shown,
        }
    }
}

/// Available names, cut after some.
fn listing(known: &[&str]) -> String {
    match known.len() {
        0 => "the model has none".to_owned(),
        n if n > SHOWN => format!("the model has {}, ... ({n} in all)", known[..SHOWN].join(", ")),
        _ => format!("the model has {}", known.join(", ")),
    }
}
