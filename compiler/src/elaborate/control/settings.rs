//! Settings of the episode and the solver.

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::syntax::{Expr, ExprKind, Ident, StatementKind};
use smpl_dsl::units::Unit;

use super::super::items::Item;
use super::super::names::ScopeId;
use super::super::{Elaborator, Place, Setting, Site};
use super::each;
use crate::model::{Episode, Solver};

impl<'a> Elaborator<'a> {
    pub(super) fn settings(&mut self, blocks: &[(ScopeId, Vec<Item<'a>>)]) {
        let mut episode = Episode::default();
        let mut solver = Solver::default();
        let mut integrate = None;
        for (scope, item) in each(blocks) {
            let Item::Other(statement) = item else { continue };
            let place = self.place(scope, Site::Dynamics);
            match &statement.kind {
                StatementKind::Episode { entries } => {
                    for (name, e) in entries {
                        self.episode_entry(name, e, &place, &mut episode, &mut integrate);
                    }
                }
                StatementKind::Solver { entries } => {
                    for (name, e) in entries {
                        self.solver_entry(name, e, &place, &mut solver);
                    }
                }
                _ => {}
            }
        }
        for (name, value) in &self.options.settings {
            match (name.as_str(), value) {
                ("max_steps", Setting::Number(x)) if *x >= 1.0 => episode.max_steps = *x as u32,
                ("error_reward", Setting::Number(x)) => episode.error_reward = *x,
                ("step", Setting::Number(x)) if *x > 0.0 => episode.step = *x,
                ("integrate", Setting::Number(x)) if *x > 0.0 => integrate = Some(*x),
                ("rtol", Setting::Number(x)) if *x > 0.0 => solver.rtol = *x,
                ("atol_factor", Setting::Number(x)) if *x > 0.0 => solver.atol_factor = *x,
                ("max_order", Setting::Number(x)) if (1.0..=5.0).contains(x) => solver.max_order = *x as u32,
                ("max_step", Setting::Number(x)) if *x > 0.0 => solver.max_step = *x,
                ("linear_solver", Setting::Text(text)) => solver.linear_solver.clone_from(text),
                ("max_internal_steps", Setting::Number(x)) if *x >= 1.0 => solver.max_steps = *x as u32,
                _ => {}
            }
        }
        if let Some(n) = self.options.max_steps {
            episode.max_steps = n;
        }
        episode.integrate = integrate.unwrap_or(episode.step);
        self.model.interface.episode = episode;
        self.model.interface.solver = solver;
    }

    fn setting_number(&mut self, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
        let reports = self.diagnostics.len();
        let expr = self.number_in(e, unit, &format!("`{}`", name.text), name.span, place);
        let value = self.constant_value(expr).filter(|x| !x.is_nan());
        if self.diagnostics.len() != reports {
            return None;
        }
        if value.is_none() {
            self.missing_value(&format!("`{}`", name.text), e.span);
        }
        value
    }

    fn positive(&mut self, name: &Ident, e: &Expr, unit: &Unit, place: &Place) -> Option<f64> {
        let x = self.setting_number(name, e, unit, place)?;
        if x > 0.0 {
            return Some(x);
        }
        self.report(Diagnostic::error(codes::BAD_SETTING, format!("`{}` must be positive, it is {x}", name.text), e.span));
        None
    }

    fn whole_number(&mut self, name: &Ident, e: &Expr, place: &Place) -> Option<u32> {
        let x = self.setting_number(name, e, &Unit::one(), place)?;
        if x >= 1.0 && x.fract() == 0.0 && x < 4e9 {
            return Some(x as u32);
        }
        self.report(Diagnostic::error(
            codes::BAD_SETTING,
            format!("`{}` must be a whole number of at least 1, it is {x}", name.text),
            e.span,
        ));
        None
    }

    /// Whether a condition of a setting is true.
    fn holds(&mut self, e: &Expr, place: &Place) -> bool {
        let c = self.condition(e, place);
        matches!(self.exprs.node(c), crate::ir::Expr::Truth(true))
    }

    fn episode_entry(&mut self, name: &Ident, e: &Expr, place: &Place, episode: &mut Episode, integrate: &mut Option<f64>) {
        let time = self.time_unit.clone();
        match name.text.as_str() {
            "step" => episode.step = self.positive(name, e, &time, place).unwrap_or(episode.step),
            "integrate" => *integrate = self.positive(name, e, &time, place),
            "max_steps" => episode.max_steps = self.whole_number(name, e, place).unwrap_or(episode.max_steps),
            "error_reward" => {
                // Rewards carry their own units; the number is taken in each.
                let v = self.value(e, place);
                episode.error_reward = self.constant_value(v.expr).unwrap_or(episode.error_reward);
            }
            "end_is_success" => episode.end_is_success = self.holds(e, place),
            "failure_pays_alone" => episode.failure_pays_alone = self.holds(e, place),
            "single_precision" => episode.single_precision = self.holds(e, place),
            _ => {
                let known = ["step", "integrate", "max_steps", "error_reward", "end_is_success", "failure_pays_alone", "single_precision"];
                self.unknown_entry(name, "episode", &known);
            }
        }
    }

    fn solver_entry(&mut self, name: &Ident, e: &Expr, place: &Place, solver: &mut Solver) {
        match name.text.as_str() {
            "rtol" => solver.rtol = self.positive(name, e, &Unit::one(), place).unwrap_or(solver.rtol),
            "atol_factor" => solver.atol_factor = self.positive(name, e, &Unit::one(), place).unwrap_or(solver.atol_factor),
            "safety" => solver.safety = self.positive(name, e, &Unit::one(), place).unwrap_or(solver.safety),
            "max_order" => solver.max_order = self.whole_number(name, e, place).unwrap_or(5).min(5),
            "max_steps" => solver.max_steps = self.whole_number(name, e, place).unwrap_or(solver.max_steps),
            "max_step" => {
                let time = self.time_unit.clone();
                solver.max_step = self.positive(name, e, &time, place).unwrap_or(solver.max_step);
            }
            "algebraic_error_control" => solver.algebraic_error_control = self.holds(e, place),
            "quadrature_error_control" => solver.quadrature_error_control = self.holds(e, place),
            "linear_solver" => match &e.kind {
                ExprKind::Name(n) if matches!(n.text.as_str(), "auto" | "dense" | "banded" | "block" | "klu") => {
                    solver.linear_solver.clone_from(&n.text)
                }
                _ => self.report(Diagnostic::error(codes::BAD_SETTING, "the linear solver is auto, dense, banded, block or klu", e.span)),
            },
            _ => self.unknown_entry(
                name,
                "solver",
                &[
                    "rtol",
                    "atol_factor",
                    "safety",
                    "max_order",
                    "max_steps",
                    "max_step",
                    "linear_solver",
                    "algebraic_error_control",
                    "quadrature_error_control",
                ],
            ),
        }
    }

    fn unknown_entry(&mut self, name: &Ident, block: &str, known: &[&str]) {
        let help = did_you_mean(&name.text, known.iter().copied());
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("`{block}` has no entry `{}`", name.text), name.span)
                .maybe_help(help)
                .note(format!("it takes {}", known.join(", "))),
        );
    }
}
