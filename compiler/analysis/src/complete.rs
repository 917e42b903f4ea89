//! Completions at a position, also while the statement is half-written.

use std::ops::Range;
use std::path::Path;

use smpl_compiler::elaborate::{BUILTINS, block_entries, built_in_names};
use smpl_dsl::span::FileId;
use smpl_dsl::syntax::Role;
use smpl_dsl::units::{OwnUnits, Unit, symbols};
use smpl_dsl::words;

use crate::check::Facts;
use crate::hover::{self, unit_of};
use crate::line::{Line, Wanted};
use crate::program::Program;
use crate::reference;
use crate::symbols::{SymbolId, SymbolKind};
use crate::texts::Texts;
use crate::token::TokenKind;

/// Kinds of proposal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposalKind {
    /// A statement keyword with its form.
    Keyword,
    /// A symbol.
    Symbol(SymbolKind),
    /// A built-in function.
    Function,
    /// A built-in name, an option or another word of the place.
    Word,
    /// A unit.
    Unit,
    /// A file.
    File,
}

/// Something that can be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proposal {
    /// Shown name.
    pub label: String,
    /// Kind.
    pub kind: ProposalKind,
    /// Short text behind the name: unit, meaning.
    pub detail: String,
    /// Inserted text; a snippet with `${1:..}` if [`Self::snippet`].
    pub insert: String,
    /// True if `insert` is a snippet.
    pub snippet: bool,
    /// Order: smaller first.
    pub rank: u8,
}

/// Proposals, and the bytes that one of them replaces.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Completion {
    /// The word that was begun.
    pub replaces: Range<usize>,
    /// Proposals, the likeliest first.
    pub proposals: Vec<Proposal>,
}

/// Units of process models, offered when no dimension is known.
const COMMON_UNITS: &[&str] = &[
    "1",
    "%",
    "s",
    "min",
    "h",
    "m",
    "cm",
    "mm",
    "m^2",
    "m^3",
    "L",
    "mL",
    "kg",
    "g",
    "mg",
    "mol",
    "mol/L",
    "g/L",
    "kg/m^3",
    "K",
    "degC",
    "Pa",
    "kPa",
    "bar",
    "J",
    "kJ",
    "kW",
    "kg/s",
    "kg/h",
    "L/min",
    "L/h",
    "m^3/h",
    "1/s",
    "1/min",
    "1/h",
    "J/mol",
    "J/(mol K)",
    "kJ/(kg K)",
    "W/(m^2 K)",
    "mol/(L min)",
    "g/(L h)",
    "Pa s",
    "m^2/s",
    "N",
    "V",
    "A",
];

/// Proposals at a byte of a file.
#[must_use]
pub fn complete(program: &Program, facts: &Facts, texts: &dyn Texts, file: FileId, offset: usize) -> Completion {
    let Some(source) = program.file(file) else { return Completion::default() };
    let offset = source.text.floor_char_boundary(offset.min(source.text.len()));
    let line = Line::new(&source.text, offset);
    let wanted = line.wanted(program, facts, file);
    let mut out = Proposals { program, facts, file, offset, list: Vec::new() };
    out.fill(&wanted, &line, texts, &source.path);
    out.list.sort_by(|a, b| (a.rank, &a.label).cmp(&(b.rank, &b.label)));
    let mut seen = std::collections::HashSet::new();
    out.list.retain(|p| seen.insert(p.label.clone()));
    Completion { replaces: line.prefix.clone(), proposals: out.list }
}

struct Proposals<'p> {
    program: &'p Program,
    facts: &'p Facts,
    file: FileId,
    offset: usize,
    list: Vec<Proposal>,
}

impl Proposals<'_> {
    fn fill(&mut self, wanted: &Wanted, line: &Line<'_>, texts: &dyn Texts, path: &Path) {
        match wanted {
            Wanted::Nothing => {}
            Wanted::Statement => self.statements(line),
            Wanted::Members(path) => self.members(path),
            Wanted::Units(expected) => self.units(expected.as_ref()),
            Wanted::Kinds(kinds) => self.kinds(kinds),
            Wanted::Files => self.files(texts, path),
            Wanted::Index(path, position) => self.index(path, *position, line),
            Wanted::Arguments(component) => self.arguments(component),
            Wanted::Entries(block) => self.entries(block),
            Wanted::Words(list) => list.iter().for_each(|word| self.word(word, "", 0)),
            Wanted::Options(name) => self.options(name),
            Wanted::Expression => self.expression(line),
            Wanted::Random => {
                ["uniform", "normal", "lognormal"].into_iter().for_each(|name| self.function(name, 0));
                self.expression(line);
            }
            Wanted::Instants => {
                self.word("start", "the begin of every step", 0);
                self.word("end", "the end of every step", 0);
                self.kinds(&[SymbolKind::Event, SymbolKind::Phase]);
            }
        }
    }

    fn push(&mut self, label: &str, kind: ProposalKind, detail: String, rank: u8) {
        let insert = label.to_owned();
        self.list.push(Proposal { label: label.to_owned(), kind, detail, insert, snippet: false, rank });
    }

    fn word(&mut self, word: &str, detail: &str, rank: u8) {
        self.push(word, ProposalKind::Word, detail.to_owned(), rank);
    }

    fn symbol(&mut self, id: SymbolId, rank: u8) {
        let symbol = self.program.symbol(id);
        let unit = unit_of(self.program, symbol, self.facts.get(&self.program.symbols().path(id)));
        let unit = unit.filter(|unit| !unit.is_one()).map(|unit| format!("[{unit}]"));
        let text = symbol.text.clone().unwrap_or_else(|| symbol.kind.words().to_owned());
        let detail = unit.into_iter().chain([text]).collect::<Vec<_>>().join(" ");
        let label = symbol.name.clone();
        let call = symbol.kind == SymbolKind::Function || symbol.kind == SymbolKind::TimeTable;
        let insert = if call { format!("{label}($1)") } else { label.clone() };
        self.list.push(Proposal { label, kind: ProposalKind::Symbol(symbol.kind), detail, insert, snippet: call, rank });
    }

    fn function(&mut self, name: &str, rank: u8) {
        let Some(builtin) = reference::function(name) else { return };
        let detail = format!("{} — {}", reference::usage(builtin), builtin.meaning);
        let insert = format!("{name}($1)");
        let (label, kind) = (name.to_owned(), ProposalKind::Function);
        self.list.push(Proposal { label, kind, detail, insert, snippet: true, rank });
    }

    fn statements(&mut self, line: &Line<'_>) {
        if line.block.as_deref() == Some("test") {
            words::IN_TESTS.iter().for_each(|word| self.word(word, "of a test", 0));
            self.kinds(&[Role::Action, Role::Param, Role::Disturbance, Role::State, Role::Discrete].map(SymbolKind::Variable));
        }
        for (word, meaning, snippet) in reference::STATEMENTS {
            let inside = matches!(*word, "next" | "reset" | "clamp");
            let block = line.block.as_deref();
            let fits = if block == Some("test") || *word == "expect" {
                block == Some("test") && *word == "expect"
            } else if block == Some("at") {
                inside
            } else {
                !inside || block == Some("phase")
            };
            let (label, insert) = ((*word).to_owned(), (*snippet).to_owned());
            let rank = u8::from(!fits);
            self.list.push(Proposal { label, kind: ProposalKind::Keyword, detail: (*meaning).to_owned(), insert, snippet: true, rank });
        }
    }

    /// Members of what a path names: a component's names, a connector's, the ends of a domain.
    fn members(&mut self, path: &[String]) {
        let symbols = self.program.symbols();
        let mut at = path.first().and_then(|name| symbols.lookup(self.program.scope_at(self.file, self.offset), name));
        for name in path.iter().skip(1) {
            at = at.and_then(|id| symbols.scope_of(id)).and_then(|scope| symbols.find(Some(scope), true, name));
        }
        let Some(id) = at else { return };
        match self.program.symbol(id).kind {
            SymbolKind::Domain => {
                ["first", "last", "low", "high", "number"].into_iter().for_each(|word| self.word(word, "of the domain", 0))
            }
            _ => {
                let scope = symbols.scope_of(id);
                let members: Vec<SymbolId> = scope.iter().flat_map(|s| symbols.members(Some(*s))).map(|(id, _)| id).collect();
                members.into_iter().for_each(|id| self.symbol(id, 0));
            }
        }
    }

    /// Units: those of the expected dimension first.
    fn units(&mut self, expected: Option<&Unit>) {
        if let Some(unit) = expected.filter(|unit| !unit.is_one()) {
            let written = unit.to_string();
            self.push(&written, ProposalKind::Unit, "the declared unit".to_owned(), 0);
        }
        let fits = |unit: &Unit| expected.is_some_and(|e| e.commensurable(unit));
        for written in COMMON_UNITS {
            let unit = composed(written);
            let rank = if unit.as_ref().is_some_and(fits) { 1 } else { 2 };
            let detail = unit.map(|unit| unit.dimension().describe()).unwrap_or_default();
            self.push(written, ProposalKind::Unit, detail, rank);
        }
        for symbol in symbols() {
            let rank = if Unit::named(symbol.symbol).as_ref().is_some_and(fits) { 1 } else { 3 };
            self.push(symbol.symbol, ProposalKind::Unit, format!("{}: {}", symbol.name, symbol.dimension().describe()), rank);
        }
        self.used_units(expected);
    }

    /// Units that the model writes.
    fn used_units(&mut self, expected: Option<&Unit>) {
        let own = self.program.symbols().own_units();
        let written = self.program.symbols().iter().filter_map(|(_, symbol)| hover::resolved(symbol.unit.as_ref()?, own));
        let mut used: Vec<Unit> = written.chain(own.iter().map(|(_, unit)| unit.clone())).collect();
        used.dedup_by_key(|unit| unit.to_string());
        for unit in used {
            let rank = if expected.is_some_and(|e| e.commensurable(&unit)) { 1 } else { 2 };
            self.push(&unit.to_string(), ProposalKind::Unit, unit.dimension().describe(), rank);
        }
    }

    fn kinds(&mut self, kinds: &[SymbolKind]) {
        let found: Vec<SymbolId> =
            self.program.visible(self.file, self.offset).into_iter().filter(|id| kinds.contains(&self.program.symbol(*id).kind)).collect();
        found.into_iter().for_each(|id| self.symbol(id, 0));
    }

    fn files(&mut self, texts: &dyn Texts, path: &Path) {
        let folder = path.parent().unwrap_or(Path::new(""));
        for model in texts.models(path) {
            if let Ok(relative) = model.strip_prefix(folder)
                && model != path
            {
                self.push(&relative.to_string_lossy().replace('\\', "/"), ProposalKind::File, String::new(), 0);
            }
        }
    }

    /// Members of the set of an index, and names in scope.
    fn index(&mut self, path: &[String], position: usize, line: &Line<'_>) {
        let symbols = self.program.symbols();
        let scope = self.program.scope_at(self.file, self.offset);
        let mut at = path.first().and_then(|name| symbols.lookup(scope, name));
        for name in path.iter().skip(1) {
            at = at.and_then(|id| symbols.scope_of(id)).and_then(|scope| symbols.find(Some(scope), true, name));
        }
        let set =
            at.and_then(|id| symbols.lookup(self.program.symbol(id).within.or(scope), self.program.symbol(id).indices.get(position)?));
        if let Some(set) = set {
            let members: Vec<SymbolId> = symbols.members(Some(set)).map(|(id, _)| id).collect();
            members.into_iter().for_each(|id| self.symbol(id, 1));
            if self.program.symbol(set).kind == SymbolKind::Domain {
                let name = self.program.symbol(set).name.clone();
                ["", ".first", ".last"].into_iter().for_each(|end| self.word(&format!("{name}{end}"), "cell", 1));
            }
        }
        self.bound(line);
    }

    /// Indices that the statement binds.
    fn bound(&mut self, line: &Line<'_>) {
        for i in 1..line.tokens.len() {
            if line.word(i) == "in" && line.tokens[i - 1].kind == TokenKind::Word && i >= 2 && matches!(line.word(i - 2), "for" | "," | "[")
            {
                let name = line.word(i - 1).to_owned();
                self.push(&name, ProposalKind::Symbol(SymbolKind::Index), format!("index over {}", line.word(i + 1)), 0);
            }
        }
        // A `for` may follow behind the cursor.
        let Some(source) = self.program.file(self.file) else { return };
        let rest = source.text[self.offset..].lines().next().unwrap_or_default();
        let Some((_, clause)) = rest.split_once(" for ") else { return };
        for binder in clause.split(',') {
            let name = binder.split_whitespace().next().unwrap_or_default();
            if !name.is_empty() && name.chars().all(crate::token::is_word) {
                self.push(name, ProposalKind::Symbol(SymbolKind::Index), "index".to_owned(), 0);
            }
        }
    }

    fn arguments(&mut self, component: &str) {
        let symbols = self.program.symbols();
        let Some(component) = symbols.find(None, true, component) else { return };
        let takes = |kind| matches!(kind, SymbolKind::Structural | SymbolKind::Variable(Role::Param));
        let list: Vec<SymbolId> = symbols.members(Some(component)).filter(|(_, s)| takes(s.kind)).map(|(id, _)| id).collect();
        for id in list {
            self.symbol(id, 0);
            if let Some(last) = self.list.last_mut() {
                let unit = unit_of(self.program, self.program.symbol(id), None).filter(|unit| !unit.is_one());
                let unit = unit.map(|unit| format!(" [{unit}]")).unwrap_or_default();
                last.insert = format!("{} = ${{1:0}}{unit}", last.label);
                last.snippet = true;
            }
        }
    }

    fn entries(&mut self, block: &str) {
        for (name, words) in block_entries(block) {
            let detail = words.map(|words| format!("one of {words}")).unwrap_or_default();
            let (label, insert) = (name.to_owned(), format!("{name} = $1"));
            self.list.push(Proposal { label, kind: ProposalKind::Word, detail, insert, snippet: true, rank: 0 });
        }
        match block {
            "policy" => self.kinds(&[SymbolKind::Variable(Role::Action)]),
            "steady" => self.kinds(&[SymbolKind::Variable(Role::Action), SymbolKind::Variable(Role::State)]),
            _ => {}
        }
    }

    /// Options of a choice, or words that an entry takes.
    fn options(&mut self, name: &str) {
        let symbols = self.program.symbols();
        let scope = self.program.scope_at(self.file, self.offset);
        if let Some(choice) = symbols.lookup(scope, name) {
            let options: Vec<SymbolId> = symbols.members(Some(choice)).map(|(id, _)| id).collect();
            options.into_iter().for_each(|id| self.symbol(id, 0));
        }
        let words =
            ["episode", "solver"].into_iter().flat_map(block_entries).find(|(entry, _)| *entry == name).and_then(|(_, words)| words);
        for word in words.unwrap_or_default().split(|c: char| !crate::token::is_word(c)).filter(|w| !w.is_empty() && *w != "or") {
            self.word(word, "", 0);
        }
    }

    fn expression(&mut self, line: &Line<'_>) {
        self.bound(line);
        for id in self.program.visible(self.file, self.offset) {
            let rank = match self.program.symbol(id).kind {
                SymbolKind::Variable(_) | SymbolKind::Time | SymbolKind::Port => 1,
                SymbolKind::Instance | SymbolKind::Table | SymbolKind::TimeTable | SymbolKind::Function | SymbolKind::Flux => 2,
                SymbolKind::Structural => 2,
                SymbolKind::Domain | SymbolKind::Event | SymbolKind::Phase => 3,
                _ => continue,
            };
            self.symbol(id, rank);
        }
        if line.word(0) == "eq" && line.tokens.len() == 1 {
            self.word("d/dt ", "time derivative", 0);
        }
        BUILTINS.iter().for_each(|builtin| self.function(builtin.name, 4));
        built_in_names().for_each(|(name, meaning)| self.word(name, meaning, 5));
        ["if", "not", "true", "false"].into_iter().for_each(|word| self.word(word, "", 5));
    }
}

/// The meaning of a unit as written.
#[must_use]
pub fn composed(written: &str) -> Option<Unit> {
    let text = format!("param x : {written}");
    let parsed = smpl_dsl::parse(&text, FileId(0));
    let smpl_dsl::syntax::StatementKind::Declare { declarations, .. } = &parsed.file.statements.first()?.kind else { return None };
    hover::resolved(declarations.first()?.unit.as_ref()?, &OwnUnits::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn common_units_exist() {
        for unit in COMMON_UNITS {
            assert!(composed(unit).is_some(), "{unit}");
        }
    }
}
