//! The function, component or table that is being called at a position.

use smpl_dsl::span::FileId;

use crate::line::Line;
use crate::program::Program;
use crate::reference;
use crate::symbols::SymbolKind;

/// A call with its arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// The whole form: `clip(x, low, high)`.
    pub label: String,
    /// Meaning.
    pub text: String,
    /// Arguments as they appear in the label.
    pub arguments: Vec<String>,
    /// Number of the argument at the position.
    pub active: usize,
}

/// The innermost call around a byte.
#[must_use]
pub fn signature(program: &Program, file: FileId, offset: usize) -> Option<Signature> {
    let source = program.file(file)?;
    let line = Line::new(&source.text, source.text.floor_char_boundary(offset.min(source.text.len())));
    let (open, name) = line.call()?;
    let active = line.commas_after(open);
    let scope = program.scope_at(file, offset);
    if let Some(id) = program.symbols().lookup(scope, &name) {
        return of_symbol(program, id, line.first_word(), active);
    }
    let builtin = reference::function(&name)?;
    let label = reference::usage(builtin).to_owned();
    let inner = label.split_once('(').and_then(|(_, rest)| rest.strip_suffix(')')).unwrap_or_default();
    let arguments: Vec<String> = inner.split(", ").map(str::to_owned).collect();
    Some(Signature { text: builtin.meaning.to_owned(), active: active.min(arguments.len().saturating_sub(1)), arguments, label })
}

fn of_symbol(program: &Program, id: crate::symbols::SymbolId, statement: &str, active: usize) -> Option<Signature> {
    let symbol = program.symbol(id);
    let component = match symbol.kind {
        SymbolKind::Function => {
            let label = format!("{}({})", symbol.name, symbol.arguments.join(", "));
            return Some(Signature { label, text: "function of the model".into(), arguments: symbol.arguments.clone(), active });
        }
        SymbolKind::TimeTable => {
            let arguments = if symbol.arguments.len() > 1 { symbol.arguments.clone() } else { vec!["t".into()] };
            let label = format!("{}({})", symbol.name, arguments.join(", "));
            let text = symbol.text.clone().unwrap_or_default();
            return Some(Signature { label, text, active: active.min(arguments.len() - 1), arguments });
        }
        SymbolKind::Component => id,
        SymbolKind::Instance if statement == "use" => program.symbols().scope_of(id)?,
        _ => return None,
    };
    let takes = |kind| matches!(kind, SymbolKind::Structural | SymbolKind::Variable(smpl_dsl::syntax::Role::Param));
    let arguments: Vec<String> =
        program.symbols().members(Some(component)).filter(|(_, s)| takes(s.kind)).map(|(_, s)| s.name.clone()).collect();
    let component = program.symbol(component);
    let label = format!("{}({})", component.name, arguments.join(", "));
    Some(Signature { label, text: component.text.clone().unwrap_or_default(), arguments, active })
}
