//! Descriptions of the thing at a position.

use std::ops::Range;

use smpl_compiler::model::Quantity;
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::{Declaration, Role, Statement, StatementKind, UnitExpr};
use smpl_dsl::units::{OwnUnits, Unit, resolve};
use smpl_dsl::{latex, words};

use crate::check::{Fact, Facts};
use crate::program::{BuiltIn, Program};
use crate::reference;
use crate::symbols::{Symbol, SymbolId, SymbolKind};
use crate::token::{TokenKind, tokens, word_at};

/// Description of the thing at a position, in Markdown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hover {
    /// Bytes that the answer is about.
    pub range: Range<usize>,
    /// The answer.
    pub markdown: String,
}

/// Describes what is at a byte of a file: a symbol, a unit, a built-in name or a keyword.
#[must_use]
pub fn hover(program: &Program, facts: &Facts, file: FileId, offset: usize) -> Option<Hover> {
    if let Some(found) = program.occurrence_at(file, offset) {
        let markdown = describe(program, facts, found.symbol);
        return Some(Hover { range: found.span.start as usize..found.span.end as usize, markdown });
    }
    if let Some((span, kind)) = program.built_in_at(file, offset) {
        let name = program.text(span);
        let markdown = match kind {
            BuiltIn::Name => reference::built_in(name),
            BuiltIn::Unit => reference::unit(name),
        }?;
        return Some(Hover { range: span.start as usize..span.end as usize, markdown });
    }
    of_word(program, facts, file, offset)
}

/// A word of a statement that could not be parsed, a keyword, or the code of a diagnostic in a
/// comment.
fn of_word(program: &Program, facts: &Facts, file: FileId, offset: usize) -> Option<Hover> {
    let text = &program.file(file)?.text;
    let range = word_at(text, offset);
    let word = &text[range.clone()];
    let token = tokens(text).into_iter().find(|token| token.range.start <= range.start && range.end <= token.range.end)?;
    let markdown = match token.kind {
        TokenKind::Comment => code(word)?,
        TokenKind::Word => keyword_at(text, &range, word)
            .or_else(|| program.symbols().lookup(program.scope_at(file, offset), word).map(|id| describe(program, facts, id)))
            .or_else(|| reference::built_in(word))
            .or_else(|| reference::unit(word))?,
        _ => return None,
    };
    Some(Hover { range, markdown })
}

/// A keyword where a statement begins.
fn keyword_at(text: &str, range: &Range<usize>, word: &str) -> Option<String> {
    let line = text[..range.start].rfind('\n').map_or(0, |at| at + 1);
    let before = text[line..range.start].trim();
    (before.is_empty() || before.ends_with(['{', ';'])).then(|| reference::keyword(word)).flatten()
}

fn code(word: &str) -> Option<String> {
    let entry = reference::explain(word)?;
    Some(format!("**{}**\n\n{}", entry.code.id(), entry.section))
}

/// Describes a symbol: declaration, unit, value, description, equation, uses.
#[must_use]
pub fn describe(program: &Program, facts: &Facts, id: SymbolId) -> String {
    let symbol = program.symbol(id);
    let fact = facts.get(&program.symbols().path(id));
    let mut parts = vec![format!("```eq\n{}\n```", headline(program, id))];
    parts.extend(symbol.text.clone());
    let kind = match symbol.kind {
        SymbolKind::Member => "member",
        kind => kind.words(),
    };
    let mut line = vec![kind.to_owned()];
    if let Some(within) = symbol.within.filter(|_| !symbol.kind.is_local()) {
        let owner = program.symbol(within);
        line.push(format!("of the {} `{}`", owner.kind.words(), owner.name));
    }
    let unit = unit_of(program, symbol, fact).or_else(|| own_unit(program, symbol));
    line.extend(unit.map(|unit| format!("— {}", unit.describe())));
    parts.push(line.join(" "));
    parts.extend(fact.and_then(|fact| numbers(symbol, fact)));
    parts.extend(size(symbol, fact));
    parts.extend(equation(program, id));
    parts.push(uses(program, fact, id));
    parts.retain(|part| !part.is_empty());
    parts.join("\n\n")
}

/// The declaration as written, shortened to one line.
fn headline(program: &Program, id: SymbolId) -> String {
    let symbol = program.symbol(id);
    let Some(site) = symbol.sites.first() else { return symbol.name.clone() };
    let written = program.text(site.declaration).split(" {").next().unwrap_or_default();
    let line = written.split_whitespace().collect::<Vec<_>>().join(" ");
    let line = line.split('"').next().unwrap_or_default().trim_end().to_owned();
    let line = if line.is_empty() { symbol.name.clone() } else { line };
    let keyword = match symbol.kind {
        SymbolKind::Variable(role) => role_keyword(role),
        _ => "",
    };
    let short: String = line.chars().take(160).collect();
    if keyword.is_empty() || line.starts_with(keyword) { short } else { format!("{keyword} {short}") }
}

/// The keyword of a role.
#[must_use]
pub fn role_keyword(role: Role) -> &'static str {
    match role {
        Role::Param => "param",
        Role::Action => "action",
        Role::State => "state",
        Role::Var => "var",
        Role::Let => "let",
        Role::Discrete => "discrete",
        Role::Disturbance => "disturbance",
        Role::Random => "random",
    }
}

/// The meaning of a symbol that declares a unit.
fn own_unit(program: &Program, symbol: &Symbol) -> Option<Unit> {
    (symbol.kind == SymbolKind::Unit).then(|| program.symbols().own_units().get(&symbol.name).cloned()).flatten()
}

/// The unit of a symbol: declared, else derived by the compiler.
#[must_use]
pub fn unit_of(program: &Program, symbol: &Symbol, fact: Option<&Fact>) -> Option<Unit> {
    let own = program.symbols().own_units();
    let declared = symbol.unit.as_ref().and_then(|unit| resolved(unit, own));
    declared.or_else(|| fact?.unit.clone()).or_else(|| match symbol.kind {
        SymbolKind::Variable(role) if role != Role::Let && role != Role::Random => Some(Unit::one()),
        _ => None,
    })
}

/// The meaning of a written unit; `None` for units of other quantities and unknown symbols.
#[must_use]
pub fn resolved(unit: &UnitExpr, own: &OwnUnits) -> Option<Unit> {
    let refuse = |e: &smpl_dsl::syntax::Expr| {
        Err(smpl_dsl::diagnostic::Diagnostic::error(smpl_dsl::diagnostic::codes::UNKNOWN_UNIT, "not known here", e.span))
    };
    resolve(unit, own, &mut { refuse }).ok()
}

/// Values and bounds of a variable, from the compiler.
fn numbers(symbol: &Symbol, fact: &Fact) -> Option<String> {
    let first = fact.quantities.first()?;
    let what = match symbol.kind {
        SymbolKind::Variable(Role::Param) => "value",
        SymbolKind::Variable(Role::Action) => "nominal value",
        SymbolKind::Variable(Role::State) => "initial value",
        _ => "",
    };
    let mut out = Vec::new();
    if !what.is_empty() {
        let of = |q: &Quantity| {
            let list: Vec<String> = q.default.iter().take(4).map(|x| reference::shown(*x)).collect();
            let more = if q.default.len() > 4 { ", ..." } else { "" };
            (!q.default.iter().all(|x| x.is_nan())).then(|| format!("{}{more}", list.join(", ")))
        };
        let many = fact.quantities.len() > 1;
        let values = fact.quantities.iter().take(4).filter_map(|q| {
            let value = of(q)?;
            Some(if many { format!("`{}` {value}", q.name) } else { value })
        });
        let values: Vec<String> = values.collect();
        let unit = if first.unit == "1" { String::new() } else { format!(" {}", first.unit) };
        if !values.is_empty() {
            out.push(format!("{what} {}{unit}", values.join(", ")));
        }
    }
    let (low, high) = (Quantity::pick(&first.low, 0), Quantity::pick(&first.high, 0));
    if low.is_finite() || high.is_finite() {
        out.push(format!("bounds {} .. {}", reference::shown(low), reference::shown(high)));
    }
    (!out.is_empty()).then(|| out.join("; "))
}

fn size(symbol: &Symbol, fact: Option<&Fact>) -> Option<String> {
    let size = fact?.size?;
    match symbol.kind {
        SymbolKind::Domain => Some(format!("{size} cells")),
        SymbolKind::Set => Some(format!("{size} members")),
        _ => None,
    }
}

/// The defining equation typeset.
fn equation(program: &Program, id: SymbolId) -> Option<String> {
    let found = program.equations().iter().find(|equation| equation.determines == Some(id))?;
    let file = program.file(found.span.file)?;
    let typeset = typeset_at(&file.tree.statements, found.span.start, &program.symbol(id).name)?;
    Some(format!("$$\n{typeset}\n$$"))
}

/// The equation or definition of a name that begins at a byte, typeset.
fn typeset_at(statements: &[Statement], start: u32, name: &str) -> Option<String> {
    let statement = statements.iter().find(|s| s.span.start <= start && start < s.span.end)?;
    match &statement.kind {
        StatementKind::Equation { lhs, rhs, binders } => Some(latex::equation(lhs, rhs, binders)),
        StatementKind::Declare { declarations, .. } => {
            let found = declarations.iter().find(|d| d.span.start == start || d.name.text == name)?;
            definition(found)
        }
        _ => typeset_at(statement.kind.block(), start, name),
    }
}

/// A named expression typeset.
#[must_use]
pub(crate) fn definition(d: &Declaration) -> Option<String> {
    let value = d.value.as_ref()?;
    let left = if d.indices.is_empty() {
        latex::name(&d.name.text)
    } else {
        let indices: Vec<String> = d.indices.iter().map(|binder| latex::name(&binder.name.text)).collect();
        format!("{}_{{{}}}", latex::name(&d.name.text), indices.join(","))
    };
    Some(format!("{left} = {}", latex::expression(value)))
}

/// Places where the symbol is determined and used.
fn uses(program: &Program, fact: Option<&Fact>, id: SymbolId) -> String {
    let mut out = Vec::new();
    let mut lines: Vec<usize> = program.equations().iter().filter(|e| e.determines == Some(id)).map(|e| program.line(e.span)).collect();
    if lines.is_empty() && matches!(program.symbol(id).kind, SymbolKind::Variable(Role::Var | Role::State)) {
        lines.extend(fact.iter().flat_map(|fact| fact.determined_by.iter().copied()));
    }
    if !lines.is_empty() && program.symbol(id).kind != SymbolKind::Variable(Role::Let) {
        let list: Vec<String> = lines.iter().take(4).map(ToString::to_string).collect();
        let word = if lines.len() == 1 { "line" } else { "lines" };
        out.push(format!("determined by {word} {}", list.join(", ")));
    }
    let using = program.equations().iter().filter(|e| e.mentions.contains(&id) && e.determines != Some(id)).count();
    if using > 0 {
        out.push(format!("used in {using} {}", if using == 1 { "equation" } else { "equations" }));
    }
    let all = program.occurrences_of(id).filter(|o| !o.declares).count();
    if using == 0 && !program.symbol(id).kind.is_local() {
        out.push(if all == 0 { "not used".to_owned() } else { format!("named {all} times") });
    }
    out.join("; ")
}

/// Returns whether a word is a keyword of the language.
#[must_use]
pub fn is_keyword(word: &str) -> bool {
    words::keywords().any(|known| known == word)
}
