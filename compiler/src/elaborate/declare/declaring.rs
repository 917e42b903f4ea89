//! Data of declaring, and the names that it makes.

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{self, Binder, Declaration, Ident};
use smpl_dsl::units::Unit;

use crate::elaborate::instances::Instances;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::binders::IndexOver;
use crate::elaborate::lower::place::Place;
use crate::elaborate::lower::{Lowering, Work, binders};
use crate::elaborate::naming::Naming;
use crate::elaborate::select::Input;
use crate::elaborate::symbols::{Axis, ScopeId, Set, Symbol, SymbolId, SymbolKind, Symbols};
use crate::ir::{Role, VarId};
use crate::model::Variable;
/// Most elements of one variable.
pub(in crate::elaborate::declare) const MAX_ELEMENTS: i64 = 10_000_000;

/// Name and description of a model.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct About {
    /// Its name.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// Statements to symbols. Sizes are expressions: what is declared so far is what they are lowered
/// over.
pub(in crate::elaborate) struct Declaring<'m, 'a> {
    pub input: &'m Input<'a>,
    /// Meaning of names.
    pub symbols: Symbols<'a>,
    /// Components and their instances.
    pub instances: Instances<'a>,
    /// Name and description of the model.
    pub about: About,
    /// Output of lowering.
    pub work: Work,
}

impl<'m, 'a> Declaring<'m, 'a> {
    /// Nothing declared yet.
    pub(crate) fn new(input: &'m Input<'a>, ledger: Ledger) -> Declaring<'m, 'a> {
        let mut symbols = Symbols::default();
        let work = Work::new(ledger, &mut symbols.vars);
        Declaring { input, symbols, instances: Instances::default(), about: About::default(), work }
    }

    /// Lowering over what is declared so far.
    pub(in crate::elaborate::declare) fn lowering(&mut self) -> Lowering<'_, 'a> {
        Lowering::new(self.input, &self.symbols, &self.instances, &mut self.work)
    }

    pub(in crate::elaborate::declare) fn naming(&mut self) -> Naming<'_, 'a> {
        Naming { symbols: &self.symbols, ledger: &mut self.work.ledger }
    }

    /// Axes and binder names of an index list (`i in species, z`).
    pub(in crate::elaborate::declare) fn axes(&mut self, binders: &[Binder], place: &Place) -> Option<(Vec<Axis>, Vec<String>)> {
        let mut axes = Vec::with_capacity(binders.len());
        for binder in binders {
            axes.push(match binders::index_over(&mut self.lowering(), binder, place)? {
                IndexOver::Axis(axis) => axis,
                IndexOver::New { name, low, high } => {
                    let labels = (low..=high).map(|i| i.to_string()).collect();
                    Axis::Set(self.symbols.sets.push(Set::new(name, labels, Some(low))))
                }
            });
        }
        Some((axes, binders.iter().map(|b| b.name.text.clone()).collect()))
    }

    /// Declares a symbol; a second one of that name is a fault.
    pub(in crate::elaborate::declare) fn declare(&mut self, scope: ScopeId, name: &Ident, kind: SymbolKind<'a>) -> Option<SymbolId> {
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, name.text);
        match self.symbols.declare(&name.text, Symbol { path, scope, span: name.span, kind }) {
            Ok(id) => Some(id),
            Err(before) => {
                let at = self.symbols[before].span;
                self.work.ledger.duplicate(name, at);
                // It is unknown which of both is intended: consequences are not reported.
                self.symbols[before].kind = SymbolKind::Faulty;
                None
            }
        }
    }

    /// A name whose declaration is invalid: its uses cause no further report.
    pub(in crate::elaborate::declare) fn faulty(&mut self, scope: ScopeId, name: &Ident) {
        self.declare(scope, name, SymbolKind::Faulty);
    }

    pub(in crate::elaborate::declare) fn new_set(&mut self, scope: ScopeId, name: &Ident, labels: Vec<String>, first: Option<i64>) {
        let set = self.symbols.sets.push(Set::new(name.text.clone(), labels, first));
        self.declare(scope, name, SymbolKind::Set(set));
    }

    pub(in crate::elaborate::declare) fn declare_poison(
        &mut self,
        scope: ScopeId,
        role: syntax::Role,
        d: &'a Declaration,
        axes: Vec<Axis>,
        binders: Vec<String>,
    ) {
        if matches!(role, syntax::Role::Let | syntax::Role::Random) {
            if let Some(definition) = d.value.as_ref().or(d.sample.as_ref()) {
                self.declare(
                    scope,
                    &d.name,
                    SymbolKind::Let { axes: axes.into(), binders: binders.into(), unit: None, definition, random: false, declaration: d },
                );
            }
            return;
        }
        self.declare(scope, &d.name, SymbolKind::Faulty);
    }

    pub(in crate::elaborate::declare) fn new_variable(
        &mut self,
        scope: ScopeId,
        name: &Ident,
        role: Role,
        axes: Vec<Axis>,
        unit: Unit,
        d: &'a Declaration,
    ) -> Option<VarId> {
        let len = axes.iter().try_fold(1_i64, |n, &a| n.checked_mul(self.symbols.axis_len(a))).unwrap_or(i64::MAX);
        if len > MAX_ELEMENTS {
            self.work.ledger.report(
                Diagnostic::error(codes::TOO_LARGE, format!("`{}` would have {len} elements", name.text), d.span)
                    .label("at most 10 million"),
            );
            self.faulty(scope, name);
            return None;
        }
        let path = format!("{}{}", self.symbols.scopes[scope].prefix, name.text);
        let var = self.symbols.vars.push(Variable { name: path, role, len: len as u32, span: d.span });
        let symbol = self.declare(scope, name, SymbolKind::Variable { var, axes: axes.into(), unit, declaration: d })?;
        self.symbols.of_var.insert(var, symbol);
        Some(var)
    }
}
