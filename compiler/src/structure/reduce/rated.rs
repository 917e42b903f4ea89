//! Expressions whose rates are read, and the faults of those that jump.

use smpl_dsl::diagnostic::{Diagnostic, Faults, codes};
use smpl_dsl::span::Span;

use super::super::common::element_name;
use super::jumps::{self, Jump};
use super::slopes::all_loops;
use crate::ir::{ExprId, Role, VarId};
use crate::model::Model;

/// The fault of a variable that jumps and is differentiated.
pub(super) fn variable_fault(model: &Model, often: &str, var: VarId, span: Span) -> Diagnostic {
    let name = &model.vars[var].name;
    let what = match model.vars[var].role {
        Role::Action => "an action",
        Role::Disturbance => "a disturbance",
        Role::Delayed => "a delayed value",
        Role::State | Role::Algebraic => "a value of the step before",
        _ => "a discrete variable",
    };
    let message = format!("{often} has to be differentiated, but `{name}` in it is {what}, which jumps");
    Diagnostic::error(codes::HIGH_INDEX, message, span).secondary(model.vars[var].span, "declared here")
}

/// The fault of an expression that jumps and is differentiated.
pub(super) fn jump_fault(model: &Model, what: &str, jump: Jump, span: Span) -> Diagnostic {
    let time = &model.interface.time;
    let name = jump.of.map_or_else(|| time.name.clone(), |(var, element)| element_name(model, var, element));
    let at: f64 = format!("{:.6e}", jump.at).parse().unwrap_or(jump.at);
    let unit = if jump.of.is_none() && time.unit != "1" { format!(" {}", time.unit) } else { String::new() };
    let place = if jump.depends {
        format!("it jumps for some values of parameters and unknowns, where `{name}` passes a threshold")
    } else {
        format!("it jumps, for example where `{name}` is {at}{unit}")
    };
    Diagnostic::error(codes::HIGH_INDEX, format!("{what} has to be differentiated, but {place}"), span)
}

/// Watches expressions whose rates equations read.
///
/// # Errors
/// Expressions that jump: an impulse belongs to their rates.
pub(crate) fn watch_rates(model: &mut Model, rated: &[(ExprId, Span)]) -> Result<(), Faults> {
    let mut faults = Faults::default();
    for &(value, span) in rated {
        let loops = all_loops(&model.exprs, value, &[]);
        let watched = jumps::examine(model, value)
            .and_then(|doubts| jumps::watch::watch(model, &doubts, &loops, span).map_err(jumps::Doubt::refused));
        if let Err(jump) = watched {
            faults.push(jump_fault(model, "this expression", jump, span).help(
                "write the rates of the other factors out, use a `linear` table, or make a state that follows what jumps, as in `eq d/dt h_s = (h(t) - h_s)/tau`",
            ));
        } else if let Some(var) = jumps::jumping(model, value) {
            let name = &model.vars[var].name;
            let help = format!("write the rates of the other factors out, or make a state that follows `{name}`");
            faults.push(variable_fault(model, "this expression", var, span).help(help));
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}
