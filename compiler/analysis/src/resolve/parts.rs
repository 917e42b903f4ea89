//! Names in functions, tables over quantities and tests.

use smpl_dsl::syntax::{BinderSet, Expect, Expr, Local, Parameter, ParameterKind, Reaction, TablePoints, TestStep, TimeTable};

use super::Resolver;
use crate::symbols::SymbolKind;

impl Resolver<'_> {
    pub(super) fn function(&mut self, parameters: &[Parameter], locals: &[Local], body: &Expr) {
        for parameter in parameters {
            match &parameter.kind {
                ParameterKind::Value => self.local(&parameter.name, SymbolKind::Argument, None),
                ParameterKind::Index(set) => {
                    self.global(set);
                    self.local(&parameter.name, SymbolKind::Index, Some(set.text.clone()));
                }
                ParameterKind::Array(binders) => {
                    // A set that is not declared stands for that of the argument.
                    for set in binders.iter().map(|binder| if let BinderSet::Set(set) = &binder.over { set } else { &binder.name }) {
                        match self.out.symbols.lookup(self.within, &set.text) {
                            Some(symbol) => self.use_of(set.span, symbol),
                            None => self.local(set, SymbolKind::Argument, None),
                        }
                    }
                    self.local(&parameter.name, SymbolKind::Argument, None);
                }
            }
        }
        for local in locals {
            local.unit.iter().for_each(|unit| self.unit(unit));
            self.expr(&local.value);
            self.local(&local.name, SymbolKind::Argument, None);
        }
        self.expr(body);
    }

    pub(super) fn reaction(&mut self, reaction: &Reaction) {
        let (d, locals) = (&reaction.declaration, self.locals.len());
        self.binders(&d.indices);
        for term in &reaction.terms {
            self.exprs(&term.coefficient);
            self.name(&term.species);
        }
        self.locals.truncate(locals);
        if reaction.rated {
            self.declaration(d);
        }
    }

    pub(super) fn table_of_quantities(&mut self, table: &TimeTable) {
        table.unit.iter().chain([&table.time_unit]).chain(&table.second_unit).for_each(|unit| self.unit(unit));
        match &table.points {
            TablePoints::Entries(entries) => entries.iter().for_each(|(time, value)| self.exprs([time, value])),
            TablePoints::Grid { columns, rows } => {
                self.exprs(columns);
                rows.iter().for_each(|(first, cells)| self.exprs(std::iter::once(first).chain(cells)));
            }
            TablePoints::File { .. } => {}
        }
    }

    pub(super) fn test_step(&mut self, step: &TestStep) {
        match step {
            TestStep::Start(_) => {}
            TestStep::Choose { word, name, option } => {
                // A scenario is a file.
                if word.text != "scenario" {
                    let chosen = self.global(name);
                    option.iter().for_each(|option| {
                        self.member(chosen, option);
                    });
                }
            }
            TestStep::Policy(name) => {
                self.global(name);
            }
            TestStep::Assign { target, value } => self.exprs([target, value]),
            TestStep::Steps(e) | TestStep::For(e) | TestStep::Expect(Expect::Holds(e)) => {
                self.expr(e);
            }
            TestStep::Expect(Expect::Within { value, tolerance, target }) => self.exprs([value, tolerance, target]),
            TestStep::Expect(Expect::Steady(e)) => self.exprs(e),
            TestStep::Expect(Expect::Failure(name) | Expect::Success(name)) => name.iter().for_each(|name| {
                self.global(name);
            }),
        }
    }
}
