//! Hints that an editor shows inside of lines: units, values, ranges of indices.

use smpl_dsl::span::FileId;
use smpl_dsl::syntax::{Binder, BinderSet, Declaration, ExprKind, Role, Statement, StatementKind};

use crate::check::{Fact, Facts};
use crate::program::Program;
use crate::reference::shown;
use crate::symbols::{SymbolId, SymbolKind};

/// Kinds of hint; an editor can turn each off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HintKind {
    /// Unit of a `let` that states none.
    Unit,
    /// Value of a computed parameter.
    Value,
    /// Range of an index that a `for` names without one.
    Index,
}

/// A hint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hint {
    /// Byte before which it is shown.
    pub offset: usize,
    /// Text.
    pub label: String,
    /// Kind.
    pub kind: HintKind,
}

/// Hints of a file.
#[must_use]
pub fn hints(program: &Program, facts: &Facts, file: FileId) -> Vec<Hint> {
    let Some(source) = program.file(file) else { return Vec::new() };
    let mut out = Hints { program, facts, text: &source.text, list: Vec::new() };
    out.statements(&source.tree.statements, None);
    out.list.sort_by_key(|hint| hint.offset);
    out.list
}

struct Hints<'p> {
    program: &'p Program,
    facts: &'p Facts,
    text: &'p str,
    list: Vec<Hint>,
}

impl Hints<'_> {
    fn statements(&mut self, statements: &[Statement], within: Option<SymbolId>) {
        for statement in statements {
            match &statement.kind {
                StatementKind::Declare { role, declarations } => declarations.iter().for_each(|d| self.declaration(*role, d, within)),
                StatementKind::Equation { binders, .. }
                | StatementKind::Connect { binders, .. }
                | StatementKind::Next { binders, .. }
                | StatementKind::Reset { binders, .. }
                | StatementKind::StartEquation { binders, .. }
                | StatementKind::Initial { binders, .. } => self.binders(binders, within),
                StatementKind::Control(control) => self.binders(&control.binders, within),
                StatementKind::Component { name, body, .. } => {
                    let component = self.program.symbols().find(None, true, &name.text);
                    self.statements(body, component);
                }
                _ => self.statements(statement.kind.block(), within),
            }
        }
    }

    fn fact(&self, within: Option<SymbolId>, name: &str) -> Option<&Fact> {
        let id = self.program.symbols().find(within, true, name)?;
        self.facts.get(&self.program.symbols().path(id))
    }

    fn declaration(&mut self, role: Role, d: &Declaration, within: Option<SymbolId>) {
        let Some(fact) = self.fact(within, &d.name.text) else { return };
        let hint = match role {
            Role::Let if d.unit.is_none() => {
                let Some(unit) = fact.unit.as_ref() else { return };
                Hint { offset: self.after_indices(d), label: format!(" : {unit}"), kind: HintKind::Unit }
            }
            Role::Param => {
                let Some(value) = d.value.as_ref().filter(|e| is_computed(&e.kind)) else { return };
                let numbers: Vec<&f64> = fact.quantities.iter().flat_map(|q| &q.default).take(2).collect();
                let [x] = numbers[..] else { return };
                if !x.is_finite() {
                    return;
                }
                Hint { offset: value.span.end as usize, label: format!(" = {}", shown(*x)), kind: HintKind::Value }
            }
            _ => return,
        };
        self.list.push(hint);
    }

    /// The byte after a declared name and its index list.
    fn after_indices(&self, d: &Declaration) -> usize {
        let end = d.indices.last().map_or(d.name.span.end, |last| last.span.end) as usize;
        if d.indices.is_empty() {
            return end;
        }
        self.text.get(end..).and_then(|rest| rest.find(']')).map_or(end, |at| end + at + 1)
    }

    fn binders(&mut self, binders: &[Binder], within: Option<SymbolId>) {
        for binder in binders.iter().filter(|binder| matches!(binder.over, BinderSet::Itself)) {
            let symbols = self.program.symbols();
            let Some(id) = symbols.lookup(within, &binder.name.text) else { continue };
            let size = self.facts.get(&symbols.path(id)).and_then(|fact| fact.size);
            let Some(size) = size.or_else(|| Some(symbols.members(Some(id)).count())).filter(|size| *size > 0) else { continue };
            let label = if symbols.get(id).kind == SymbolKind::Domain { format!(" in 1..{size}") } else { format!(" ({size} members)") };
            self.list.push(Hint { offset: binder.span.end as usize, label, kind: HintKind::Index });
        }
    }
}

/// Returns whether an expression is more than a number that is written out.
fn is_computed(kind: &ExprKind) -> bool {
    match kind {
        ExprKind::Number { .. } | ExprKind::Bool(_) => false,
        ExprKind::Unary(_, inner) => is_computed(&inner.kind),
        _ => true,
    }
}
