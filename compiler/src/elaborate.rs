//! Elaboration: from syntax trees to the flat indexed model.
//!
//! One pass does what belongs together at the place of writing: names are looked up, shapes and units are checked on what was
//! written, functions and `let`s are expanded, indices over enumerated sets are written out, and equations over the cells of a
//! domain become loops. Where a stencil meets the end of a domain, the loop is split on demand: [`cells`] elaborates a body
//! over a range of cells and starts again with a cut where the body asked for one, so that the first, the inner and the
//! last cells each get their own equation, however large the grid is.
//!
//! Faults are collected; a faulty expression becomes *poison*, which fits everywhere and causes no further report.

mod blocks;
mod cells;
mod control;
mod declare;
mod equations;
mod expression;
mod functions;
mod indices;
mod interval;
mod items;
mod lints;
mod names;
mod outputs;
mod outside;
mod phases;
mod quantity;
mod runs;
mod space;
mod transport;
mod units;
mod unused;

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::rc::Rc;

use cranelift_entity::PrimaryMap;
use smpl_dsl::diagnostic::{Code, Diagnostic, Faults, Label, Severity, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{self, Expr};
use smpl_dsl::units::Unit;

use crate::ir::{ExprId, Exprs, FastMap, FastSet, Role, VarId};
use crate::model::{Draw, Model, Quantity, Variable};
use items::{Item, Selection};
use names::{Names, ScopeId, SymbolId};
use quantity::{Measure, Value};

pub use blocks::for_each_element;
pub use control::ordered_initial;
pub use equations::{Equation, EquationForm};
pub(crate) use lints::unused_parameters;

/// Most terms, elements and calls that are written out in one model.
const MAX_WRITTEN_OUT: u32 = 1_000_000;

/// Most expressions that are elaborated in one model, those of attempts that fail included.
const MAX_WORK: u32 = 20_000_000;

/// Most names that are compared with unknown ones.
const MAX_COMPARED: usize = 3_000_000;

/// What a report counts among the expressions: its words take longer than they do.
const REPORT: u32 = 50;

/// Most nodes of the expressions of one model.
const MAX_NODES: usize = 4_000_000;

/// What a compilation is asked for beside the text.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Variants that are on and options of choices: name and option (`true` for a variant).
    pub variants: Vec<(String, String)>,
    /// Values of parameters, in their declared units; they replace default and distribution.
    pub parameters: BTreeMap<String, f64>,
    /// Settings by name: a parameter, a choice, a grid size, or an entry of `episode` or `solver`.
    pub settings: BTreeMap<String, Setting>,
    /// Replacements of initial values: `name -> text of an expression` from a scenario.
    pub initial: BTreeMap<String, f64>,
    /// Observation level; `None` is `default`.
    pub observation: Option<String>,
    /// Reward that is the default.
    pub reward: Option<String>,
    /// Statements that replace those of the model with the same key, as a variant does.
    pub overlay: Vec<syntax::Statement>,
    /// Overrides `max_steps`.
    pub max_steps: Option<u32>,
    /// Look for what is allowed but hardly meant, too.
    pub lints: bool,
}

/// Entries of `episode` and `solver` that are settings as well; `max_internal_steps` is `max_steps` of the solver.
pub const ENTRY_SETTINGS: &[&str] = &[
    "max_steps",
    "error_reward",
    "step",
    "integrate",
    "rtol",
    "atol_factor",
    "max_order",
    "max_step",
    "linear_solver",
    "max_internal_steps",
    "max_events",
];

/// Value of a setting.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// An option of a choice.
    Text(String),
    /// The elements of an array of parameters, in their order.
    List(Vec<f64>),
}

/// Result of elaboration: the model before structure analysis, and its equations.
#[derive(Debug)]
pub struct Elaborated {
    /// The model; rows are still empty.
    pub model: Model,
    /// All equations.
    pub equations: Vec<Equation>,
    /// Whether a range of numbers stayed a loop.
    pub runs: bool,
    /// Warnings.
    pub warnings: Faults,
}

/// Elaborates the main file `files[0]`; `imports` tells which file a `use "path"` means.
///
/// # Errors
/// All independent faults of the model.
pub fn elaborate(files: &[syntax::File], imports: &HashMap<String, usize>, options: &Options) -> Result<Elaborated, Faults> {
    let mut elaborator = Elaborator::new(files, imports, options);
    elaborator.run();
    elaborator.finish()
}

/// Where an expression stands, and what is bound there.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    scope: ScopeId,
    bindings: Option<Rc<Binding>>,
    /// Number of loops around.
    depth: u8,
    /// The face at which field values are taken, inside a flux.
    face: Option<cells::Face>,
    site: Site,
}

/// What kind of text an expression belongs to: decides which functions have a meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Site {
    /// Equations, `let`s, fluxes.
    Dynamics,
    /// Parameters, initial values: random numbers drawn at reset.
    Reset,
    /// Update of a disturbance: random numbers drawn at each step.
    Disturb,
    /// Sampling instants, rewards, conditions, policies, observations.
    Instant,
}

/// An index, argument or tuple element that is bound to a name.
#[derive(Debug)]
pub(crate) struct Binding {
    name: String,
    to: Bound,
    next: Option<Rc<Binding>>,
}

/// What a name is bound to.
#[derive(Clone, Debug)]
pub(crate) enum Bound {
    /// A member of a set.
    Member(names::SetId, usize),
    /// A cell of a domain.
    Cell(names::DomainId, cells::Cell),
    /// The face at which a flux is taken.
    Face(names::DomainId, cells::Cell),
    /// A value: argument of a function.
    Value(Value),
    /// An expression at its own place, with what is bound there: element of a tuple.
    Alias(Expr, ScopeId, Option<Rc<Binding>>),
    /// An element of a variable, by its linear address: element of `states` and the like.
    Element(SymbolId, crate::ir::Affine),
    /// A whole number: face or cell number of a prescribed grid.
    Number(ExprId),
    /// The numbers of a range that stays a loop.
    Run(cells::Cell),
}

/// Code and place of a fault, and its message where calls lead there.
type Reported = (Code, Span, Option<String>);

/// A `let` at what its indices are bound to, in a kind of text.
type Expansion = (SymbolId, Vec<indices::IndexKey>, Site);

pub(crate) struct Elaborator<'a> {
    files: &'a [syntax::File],
    imports: &'a HashMap<String, usize>,
    options: &'a Options,
    selection: Selection,
    diagnostics: Faults,
    reported: FastSet<Reported>,
    /// What was added to `reported` and to `unbound` since the outermost attempt began.
    reports: Vec<Reported>,
    /// Calls through which the places of faults in functions were reached.
    reached_by: FastMap<Reported, BTreeSet<Span>>,
    /// Expressions inside one another, definitions expanded.
    nesting: u32,
    /// Members of sets of numbers so far.
    members: i64,
    /// Terms, elements and calls written out so far.
    written_out: u32,
    /// Expressions elaborated so far.
    work: u32,
    /// Where that became too much: from there on nothing is elaborated or reported.
    exhausted: Option<Span>,
    /// Components that are being instantiated, one inside another.
    instantiating: Vec<&'a str>,
    /// Declarations made for instances so far.
    instantiated: usize,
    /// Names that were compared with unknown ones so far.
    compared: Cell<usize>,
    /// Calls of functions that are being expanded.
    calls: Vec<Span>,
    names: Names<'a>,
    exprs: Exprs,
    vars: PrimaryMap<VarId, Variable>,
    /// What is seen of each declared variable from outside.
    quantities: FastMap<VarId, Quantity>,
    /// Components by name with their declaring statement.
    components: FastMap<&'a str, &'a syntax::Statement>,
    connectors: FastMap<&'a str, &'a syntax::Statement>,
    /// Items of every scope in the order of instances; the file first.
    blocks: Vec<(ScopeId, Vec<Item<'a>>)>,
    time_unit: Unit,
    time_name: String,
    builtins: VarId,
    draws_var: VarId,
    draws: Vec<Draw>,
    quadratures_var: VarId,
    quadratures: Vec<ExprId>,
    param_given: VarId,
    /// Numeric defaults of parameters, for constant evaluation.
    known: FastMap<(VarId, i64), f64>,
    expanding: Vec<SymbolId>,
    /// `let`s, fluxes and functions that something has asked for.
    expanded: FastSet<SymbolId>,
    /// Components that have an instance.
    used_components: FastSet<&'a str>,
    samples: unused::Samples,
    /// The equation that is being elaborated.
    statement: Span,
    /// Index names reported as not bound, by statement.
    unbound: FastSet<(Span, String)>,
    unbound_names: Vec<(Span, String)>,
    memo: FastMap<Expansion, Value>,
    /// Ranges of numbers may stay loops.
    runs: bool,
    /// Parameters whose numbers gave sizes and indices.
    structural: FastSet<VarId>,
    /// Parameters that the default of a parameter needs.
    needed: FastMap<VarId, Vec<VarId>>,
    /// Elements that have a `next`, by scope and instant.
    assigned: FastMap<(ScopeId, String), FastMap<(VarId, i64), Span>>,
    /// A range stayed a loop.
    looped: bool,
    /// Passes of such loops.
    passes: i64,
    /// Attempts to keep a range a loop, one inside another.
    attempts: u32,
    /// The present attempt asked for more than a loop can give.
    refused: bool,
    /// What was added to `memo` since the outermost attempt began.
    remembered: Vec<Expansion>,
    random_site: Option<(String, crate::model::Instant)>,
    loops: Vec<cells::Loop>,
    /// Indices over ranges of numbers that only count cells, in the statement that is being elaborated.
    counted: Vec<(String, names::DomainId)>,
    equations: Vec<Equation>,
    model: Model,
    uses_steady: bool,
    outcome: Option<control::Outcome>,
    used_parameters: FastSet<String>,
    schedule: Option<phases::Schedule<'a>>,
    /// Assignments happen only where this holds: in the transition of a phase.
    guard: Option<ExprId>,
    symbol_of: FastMap<VarId, SymbolId>,
    /// Members of ports: connections, not outputs.
    port_variables: FastSet<VarId>,
    /// Where the component of each instance is used.
    used_at: FastMap<ScopeId, Span>,
    /// Arguments of instances.
    given: FastMap<(ScopeId, String), (&'a Expr, Place)>,
    /// Observed numbers with their boxes, for failures on the observation box.
    observed_members: Vec<(crate::model::BoxItem, ExprId)>,
    /// Face values of the flux that is being elaborated, where their directions are yet to be found.
    faces: Option<Vec<transport::FaceValue>>,
    /// Face values are means of both cells: in a velocity.
    averaging: bool,
    /// Parameters whose default is being worked out.
    knowing: FastSet<VarId>,
}

impl<'a> Elaborator<'a> {
    fn new(files: &'a [syntax::File], imports: &'a HashMap<String, usize>, options: &'a Options) -> Self {
        let mut vars = PrimaryMap::new();
        let mut hidden = |name: &str, role| vars.push(Variable { name: name.to_owned(), role, len: 0, span: Span::default() });
        let builtins = hidden("builtin", Role::Builtin);
        let draws_var = hidden("draw", Role::Draw);
        let quadratures_var = hidden("quadrature", Role::Quadrature);
        let param_given = hidden("given", Role::ParamGiven);
        vars[builtins].len = crate::ir::BUILTIN_COUNT;
        Elaborator {
            files,
            imports,
            options,
            selection: Selection::default(),
            diagnostics: Faults::default(),
            reported: FastSet::default(),
            reached_by: FastMap::default(),
            reports: Vec::new(),
            nesting: 0,
            members: 0,
            written_out: 0,
            work: 0,
            exhausted: None,
            instantiating: Vec::new(),
            compared: Cell::new(0),
            instantiated: 0,
            calls: Vec::new(),
            names: Names::default(),
            exprs: Exprs::default(),
            vars,
            quantities: FastMap::default(),
            components: FastMap::default(),
            connectors: FastMap::default(),
            blocks: Vec::new(),
            time_unit: Unit::one(),
            time_name: "t".to_owned(),
            builtins,
            draws_var,
            draws: Vec::new(),
            quadratures_var,
            quadratures: Vec::new(),
            param_given,
            known: FastMap::default(),
            expanding: Vec::new(),
            expanded: FastSet::default(),
            used_components: FastSet::default(),
            samples: unused::Samples::default(),
            statement: Span::default(),
            unbound: FastSet::default(),
            unbound_names: Vec::new(),
            memo: FastMap::default(),
            runs: false,
            structural: FastSet::default(),
            needed: FastMap::default(),
            assigned: FastMap::default(),
            looped: false,
            passes: 0,
            attempts: 0,
            refused: false,
            remembered: Vec::new(),
            random_site: None,
            loops: Vec::new(),
            counted: Vec::new(),
            equations: Vec::new(),
            model: Model::default(),
            uses_steady: false,
            outcome: None,
            used_parameters: FastSet::default(),
            schedule: None,
            guard: None,
            symbol_of: FastMap::default(),
            port_variables: FastSet::default(),
            used_at: FastMap::default(),
            given: FastMap::default(),
            observed_members: Vec::new(),
            faces: None,
            averaging: false,
            knowing: FastSet::default(),
        }
    }

    fn run(&mut self) {
        self.select_variants();
        self.declare_file();
        // What a missing file declares would be missed everywhere.
        if self.diagnostics.iter().any(|d| d.code == codes::UNKNOWN_IMPORT) {
            return;
        }
        self.declare_defaults();
        self.check_ends();
        self.runs = true;
        self.elaborate_equations();
        self.elaborate_control();
        self.check_unused();
        if self.options.lints && !self.has_errors() {
            self.lint();
        }
    }

    fn finish(mut self) -> Result<Elaborated, Faults> {
        if let Some(span) = self.exhausted.filter(|_| self.written_out <= MAX_WRITTEN_OUT) {
            self.diagnostics.push(
                Diagnostic::error(codes::TOO_LARGE, "the model is too large: it has tens of millions of terms", span)
                    .label("so far the compiler came")
                    .help("use a `domain` in place of a large set, and name with `let` what is used again and again"),
            );
        }
        self.name_calls();
        self.diagnostics.sort();
        if self.has_errors() {
            return Err(self.diagnostics);
        }
        self.vars[self.draws_var].len = self.draws.len() as u32;
        self.vars[self.quadratures_var].len = self.quadratures.len() as u32;
        self.vars[self.param_given].len = self.vars.values().filter(|v| v.role == Role::Param).map(|v| v.len).sum();
        let mut model = self.model;
        model.interface.draws = self.draws;
        model.quadratures = self.quadratures;
        model.exprs = self.exprs;
        model.vars = self.vars;
        Ok(Elaborated { model, equations: self.equations, runs: self.looped, warnings: self.diagnostics })
    }

    fn has_errors(&self) -> bool {
        self.diagnostics.iter().any(|d| d.severity == Severity::Error)
    }

    /// Reports a fault once: the same fault at the same place, met again in another cell, instance or call, is not repeated.
    fn report(&mut self, diagnostic: Diagnostic) {
        self.work = self.work.saturating_add(REPORT);
        if self.exhausted.is_some() {
            return;
        }
        let call = self.calls.first().copied().filter(|c| !c.contains(diagnostic.primary.span));
        let key = reported(&diagnostic, call.is_some());
        if let Some(call) = call {
            self.reached_by.entry(key.clone()).or_default().insert(call);
        }
        if self.reported.insert(key.clone()) {
            if self.attempts > 0 {
                self.reports.push(key);
            }
            self.diagnostics.push(diagnostic);
        }
    }

    /// Shows with faults in functions the calls that led there: of many, the first.
    fn name_calls(&mut self) {
        for diagnostic in self.diagnostics.iter_mut() {
            let Some(calls) = self.reached_by.get(&reported(diagnostic, true)) else { continue };
            diagnostic.secondary.extend(calls.first().map(|&span| Label { span, text: "in this call".to_owned() }));
            match calls.len() - 1 {
                0 => {}
                1 => diagnostic.notes.push("another call leads here too".to_owned()),
                more => diagnostic.notes.push(format!("{more} more calls lead here")),
            }
        }
    }

    /// Counts something that is written out: a term, an element, a call. `false` where the model is beyond reason, which is reported once.
    fn may_write_out(&mut self, span: Span) -> bool {
        if self.exhausted.is_some() {
            return false;
        }
        if self.written_out < MAX_WRITTEN_OUT {
            self.written_out += 1;
            return true;
        }
        if self.attempts > 0 {
            // What is too much in one pass of a loop is too much without the loop as well.
            self.exhausted = Some(span);
        } else if self.written_out == MAX_WRITTEN_OUT {
            self.written_out += 1;
            self.report(
                Diagnostic::error(codes::TOO_LARGE, "more than a million terms and elements would be written out", span)
                    .help("use a `domain` in place of a large set: its cells stay a loop"),
            );
        }
        false
    }

    /// Whether one more expression may be elaborated. What an attempt took is not given back.
    fn may_elaborate(&mut self, span: Span) -> bool {
        self.work = self.work.saturating_add(1);
        if self.exhausted.is_none() && (self.work > MAX_WORK || self.exprs.len() > MAX_NODES) {
            self.exhausted = Some(span);
        }
        self.exhausted.is_none()
    }

    /// Whether nothing more may be written out.
    fn is_full(&self) -> bool {
        self.written_out > MAX_WRITTEN_OUT || self.exhausted.is_some()
    }

    /// Whether one more diagnostic would be shown, so that a search for what was meant is worth its time.
    fn may_suggest(&self) -> bool {
        self.diagnostics.has_room() && self.compared.get() < MAX_COMPARED
    }

    /// "did you mean `k_0`?", where that would be shown.
    fn did_you_mean<'n>(&self, name: &str, known: impl IntoIterator<Item = &'n str>) -> Option<String> {
        let count = |_: &&str| self.compared.set(self.compared.get() + 1);
        if self.may_suggest() { smpl_dsl::diagnostic::did_you_mean(name, known.into_iter().inspect(count)) } else { None }
    }

    fn poison(&mut self) -> Value {
        Value { expr: self.exprs.constant(f64::NAN), unit: Measure::Poison }
    }

    fn fault(&mut self, diagnostic: Diagnostic) -> Value {
        self.report(diagnostic);
        self.poison()
    }

    fn place(&self, scope: ScopeId, site: Site) -> Place {
        Place { scope, bindings: None, depth: 0, face: None, site }
    }

    /// The number that an expression of constants and parameters has with the parameters' defaults and means of random numbers.
    fn constant_value(&mut self, e: ExprId) -> Option<f64> {
        if let Some(x) = self.exprs.as_const(e) {
            return Some(x);
        }
        for (var, _) in self.parameters_in(e) {
            if let Some(&symbol) = self.symbol_of.get(&var) {
                self.know(symbol);
            }
        }
        self.folded(e)
    }

    /// The number of an expression with what is known of the parameters.
    fn folded(&mut self, e: ExprId) -> Option<f64> {
        let known = &self.known;
        let draws = &self.draws;
        let (param_role, draws_var) = (&self.vars, self.draws_var);
        let mut exprs = std::mem::take(&mut self.exprs);
        let folded = exprs.rewrite(e, &mut crate::ir::Rewritten::default(), &mut |exprs, node| match node {
            crate::ir::Expr::Load { var, at, .. } if at.is_constant() => {
                if var == draws_var {
                    let mean = match draws.get(at.offset as usize).map(|d| d.kind) {
                        Some(crate::model::Variate::Uniform) => 0.5,
                        _ => 0.0,
                    };
                    return Some(exprs.constant(mean));
                }
                if param_role[var].role != Role::Param {
                    return None;
                }
                known.get(&(var, at.offset)).map(|&x| exprs.constant(x))
            }
            _ => None,
        });
        let value = exprs.as_const(folded).or_else(|| {
            let known_at = |var, flavour, at| if flavour == crate::ir::Flavour::Value { known.get(&(var, at)).copied() } else { None };
            if exprs.free(folded) == 0 { crate::interpret::eval_constant(&exprs, folded, &known_at) } else { None }
        });
        self.exprs = exprs;
        value
    }

    /// Notes that sizes or indices were computed from an expression: its parameters keep their numbers.
    fn mark_structural(&mut self, e: ExprId) {
        let mut stack: Vec<VarId> = self.parameters_in(e).into_iter().map(|p| p.0).collect();
        while let Some(var) = stack.pop() {
            if self.structural.insert(var) {
                stack.extend(self.needed.get(&var).into_iter().flatten());
            }
        }
    }

    fn missing_value(&mut self, what: &str, span: Span) {
        self.report(
            Diagnostic::error(codes::MISSING_DEFAULT, format!("{what} must be known when the model is compiled"), span)
                .label("depends on something that is not"),
        );
    }
}

/// What a reported fault is known by: in a function, where each call may have its own faults, the message belongs to it.
fn reported(diagnostic: &Diagnostic, in_call: bool) -> Reported {
    (diagnostic.code, diagnostic.primary.span, in_call.then(|| diagnostic.message.clone()))
}

impl Place {
    /// The place with one more name bound.
    fn bind(&self, name: &str, to: Bound) -> Place {
        let mut place = self.clone();
        place.bindings = Some(Rc::new(Binding { name: name.to_owned(), to, next: self.bindings.clone() }));
        place
    }

    /// Which loops around count numbers, by bit.
    fn runs(&self) -> u8 {
        let mut at = self.bindings.as_ref();
        let mut bits = 0;
        while let Some(binding) = at {
            if let Bound::Run(cells::Cell { along: Some(v), .. }) = &binding.to {
                bits |= 1 << v.0;
            }
            at = binding.next.as_ref();
        }
        bits
    }

    fn bound(&self, name: &str) -> Option<&Bound> {
        let mut at = self.bindings.as_ref();
        while let Some(binding) = at {
            if binding.name == name {
                return Some(&binding.to);
            }
            at = binding.next.as_ref();
        }
        None
    }
}
