//! The text of a model, statement after statement.

use smpl_compiler::model::Interface;
use smpl_dsl::latex;
use smpl_dsl::span::{FileId, Span};
use smpl_dsl::syntax::{Expr, ExprKind, Ident, Role, Statement, StatementKind, UnitExpr};

use super::markdown::{self, code, display, prose};
use super::{Source, equations};
use smpl_runtime::failure::Short;

/// The chapters of a text.
pub(super) fn page(source: &Source, interface: &Interface) -> String {
    let mut writer = Writer::new(source, interface);
    writer.file(0);
    writer.alternatives();
    writer.flush();
    writer.page
}

/// Rows of a table that goes on.
struct Rows {
    heading: &'static [&'static str],
    rows: Vec<Vec<String>>,
}

/// Statements that are not part of the present model, or may be taken out of it.
struct Alternative<'s> {
    title: String,
    text: String,
    body: &'s [Statement],
}

/// Writes a page. It has many methods: one for each kind of statement, in one file a part of the
/// page.
pub(super) struct Writer<'s> {
    pub source: &'s Source,
    pub interface: &'s Interface,
    page: String,
    rows: Option<Rows>,
    /// Headings that are still empty, with their levels.
    waiting: Vec<(usize, String)>,
    alternatives: Vec<Alternative<'s>>,
    /// Files that are there already.
    seen: Vec<bool>,
    /// The chapter that is open, where the text names none.
    chapter: &'static str,
    /// The text has its own headings.
    titled: bool,
    /// The component that is written down, or a variant: no chapters inside.
    inside: Option<&'s str>,
}

impl<'s> Writer<'s> {
    fn new(source: &'s Source, interface: &'s Interface) -> Self {
        let (page, rows, waiting) = (String::new(), None, Vec::new());
        let (alternatives, seen) = (Vec::new(), vec![false; source.files.len()]);
        Self { source, interface, page, rows, waiting, alternatives, seen, chapter: "", titled: false, inside: None }
    }

    // ---- what others write with

    /// A heading; it waits for what is under it.
    fn heading(&mut self, level: usize, text: &str) {
        self.flush();
        self.waiting.retain(|(above, _)| *above < level);
        self.waiting.push((level, format!("{} {text}", "#".repeat(level))));
    }

    /// The headings that wait.
    fn headings(&mut self) {
        for (_, heading) in std::mem::take(&mut self.waiting) {
            self.page.push('\n');
            self.page.push_str(&heading);
            self.page.push('\n');
        }
    }

    /// A paragraph, a display.
    pub(super) fn block(&mut self, text: &str) {
        self.flush();
        self.headings();
        self.page.push('\n');
        self.page.push_str(text);
        if !text.ends_with('\n') {
            self.page.push('\n');
        }
    }

    /// A row of a table with these columns; the table goes on where it has them already.
    pub(super) fn row(&mut self, heading: &'static [&'static str], row: Vec<String>) {
        if self.rows.as_ref().is_none_or(|rows| rows.heading != heading) {
            self.flush();
            self.headings();
            self.rows = Some(Rows { heading, rows: Vec::new() });
        }
        if let Some(rows) = &mut self.rows {
            rows.rows.push(row);
        }
    }

    fn flush(&mut self) {
        if let Some(Rows { heading, rows }) = self.rows.take() {
            self.page.push('\n');
            self.page.push_str(&markdown::table(heading, &rows));
        }
    }

    /// A unit as it is written.
    pub(super) fn unit(&self, unit: Option<&UnitExpr>) -> String {
        unit.map(|unit| markdown::unit(self.source.texts.text(unit.span))).unwrap_or_default()
    }

    /// An expression within a line: a number as it is, else mathematics.
    pub(super) fn inline(&self, value: &Expr) -> String {
        let sign = |e: &Expr| matches!(&e.kind, ExprKind::Number { .. });
        match &value.kind {
            ExprKind::Number { value, unit } => format!("{} {}", Short(*value), self.unit(unit.as_ref())).trim_end().to_owned(),
            ExprKind::Unary(smpl_dsl::syntax::UnaryOp::Neg, inner) if sign(inner) => format!("-{}", self.inline(inner)),
            ExprKind::Name(name) if name.text == "inf" => "∞".to_owned(),
            ExprKind::Bool(value) => value.to_string(),
            _ => markdown::math(&latex::expression(value)),
        }
    }

    /// Name, meaning and unit of what a display below defines; `what` shows what it is.
    pub(super) fn label(&mut self, what: &str, name: &str, unit: &str, text: &str) {
        let what = if what.is_empty() { String::new() } else { format!("{what} ") };
        let unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
        let text = if text.is_empty() { String::new() } else { format!(": {}", prose(text)) };
        self.block(&format!("{what}{}{text}{unit}", code(name)));
    }

    // ---- the walk

    fn file(&mut self, file: usize) {
        if std::mem::replace(&mut self.seen[file], true) {
            return;
        }
        let source = self.source;
        let Some(text) = source.files[file].statements.first().and_then(|s| source.texts.file(s.span.file)) else { return };
        let before = std::mem::replace(&mut self.titled, text.text().lines().any(|line| title(line).is_some()));
        self.chapter = "";
        self.statements(&source.files[file].statements, 0);
        self.titled = before;
        self.chapter = "";
    }

    /// Statements of a block that begins at a place of its file.
    fn statements(&mut self, statements: &'s [Statement], begin: u32) {
        let mut at = begin;
        for statement in statements {
            self.comments(statement.span.file, at, statement.span.start);
            self.statement(statement);
            at = statement.span.end;
        }
    }

    /// Comments between statements: headings and prose.
    fn comments(&mut self, file: FileId, from: u32, to: u32) {
        let Some(text) = self.source.texts.file(file).and_then(|file| file.text().get(from as usize..to as usize)) else { return };
        let mut paragraph: Vec<String> = Vec::new();
        // The first line is the rest of one that a statement is on, but at the head of a file.
        let lines: Vec<&str> = text.lines().skip(usize::from(from > 0)).collect();
        for line in lines.iter().copied().chain([""]) {
            match (title(line), line.trim_start().strip_prefix('#')) {
                (Some(title), _) => {
                    self.paragraph(&mut paragraph);
                    self.chapter = "";
                    self.heading(if self.inside.is_some() { 4 } else { 2 }, &prose(title));
                }
                (None, Some(words)) => paragraph.push(prose(words.trim())),
                (None, None) => self.paragraph(&mut paragraph),
            }
        }
    }

    fn paragraph(&mut self, lines: &mut Vec<String>) {
        if !lines.is_empty() {
            self.block(&lines.join("\n"));
            lines.clear();
        }
    }

    /// The comment behind a statement on its line.
    pub(super) fn remark(&self, span: Span) -> String {
        let text = self.source.texts.file(span.file).and_then(|file| file.text().get(span.end as usize..)).unwrap_or("");
        let rest = text.lines().next().unwrap_or("").trim_start();
        rest.strip_prefix('#').map(|words| words.trim().to_owned()).unwrap_or_default()
    }

    fn statement(&mut self, statement: &'s Statement) {
        self.open_chapter(&statement.kind);
        match &statement.kind {
            StatementKind::Model { .. } => {}
            StatementKind::Import { path, .. } => self.import(path),
            StatementKind::When { choice, option, body } => self.when(statement, choice, option, body),
            StatementKind::Variant { name, extends, text, body } => {
                let on = self.interface.alternatives.has_chosen(&name.text, "true");
                let base = extending(extends.as_ref());
                let title = format!("Variant {}{base}{}{}", code(&name.text), self.place(), if on { " (on)" } else { "" });
                self.alternatives.push(Alternative { title, text: text.clone().unwrap_or_default(), body });
            }
            StatementKind::Component { name, parameters, extends, text, body } => {
                self.heading(3, &format!("Component {}{}", code(&name.text), extending(extends.as_ref())));
                if let Some(text) = text {
                    self.block(&prose(text));
                }
                self.component_parameters(parameters);
                self.component(statement, name, body);
            }
            StatementKind::Equation { lhs, rhs, binders } => self.equation(statement, &latex::equation(lhs, rhs, binders)),
            StatementKind::Declare { role: Role::Let, declarations } => self.definitions(statement, declarations),
            StatementKind::Declare { role, declarations } => self.declarations(*role, declarations),
            StatementKind::Def { name, parameters, locals, body } => {
                let mut lines = equations::function(name, parameters, locals, body);
                let last = lines.pop().unwrap_or_default();
                lines.iter().for_each(|line| self.block(&display(line)));
                self.equation(statement, &last);
            }
            StatementKind::Reaction(reaction) => {
                let d = &reaction.declaration;
                let remark = self.remark(statement.span);
                let text = d.text.clone().unwrap_or(remark);
                self.label("Reaction", &declared(&d.name, &d.indices), "", &text);
                self.block(&display(&equations::reaction(reaction)));
            }
            StatementKind::Flux(flux) => {
                self.label("Flux", &declared(&flux.name, &flux.indices), &self.unit(flux.unit.as_ref()), &self.remark(statement.span));
                equations::flux_at_faces(flux).iter().for_each(|line| self.block(&display(line)));
            }
            kind => {
                if !self.structure(kind) {
                    self.control(statement);
                }
            }
        }
    }

    fn equation(&mut self, statement: &Statement, latex: &str) {
        self.block(&display(latex));
        match self.remark(statement.span) {
            remark if remark.is_empty() => {}
            remark => self.block(&prose(&remark)),
        }
    }

    /// Statements of an import, at its place, once.
    fn import(&mut self, path: &str) {
        self.block(&format!("From {}:", code(path)));
        if let Some(&file) = self.source.imports.get(path) {
            let (titled, chapter) = (self.titled, self.chapter);
            self.file(file);
            (self.titled, self.chapter) = (titled, chapter);
        }
    }

    /// An option that is in force is part of the model; others come behind it.
    fn when(&mut self, statement: &'s Statement, choice: &Ident, option: &Ident, body: &'s [Statement]) {
        if self.interface.alternatives.has_chosen(&choice.text, &option.text) {
            self.statements(body, statement.span.start);
            return;
        }
        let title = format!("{}{}", code(&format!("{} = {}", choice.text, option.text)), self.place());
        self.alternatives.push(Alternative { title, text: String::new(), body });
    }

    /// Place of an alternative.
    fn place(&self) -> String {
        self.inside.map(|name| format!(" in {}", code(name))).unwrap_or_default()
    }

    /// Parameters in the head of a component.
    fn component_parameters(&mut self, parameters: &[(Ident, Option<Expr>)]) {
        let value = |value: &Option<Expr>| value.as_ref().map(|e| format!(" = {}", self.inline(e))).unwrap_or_default();
        let list: Vec<String> = parameters.iter().map(|(name, given)| format!("{}{}", code(&name.text), value(given))).collect();
        if !list.is_empty() {
            self.block(&format!("Parameters: {}.", list.join(", ")));
        }
    }

    fn component(&mut self, statement: &'s Statement, name: &'s Ident, body: &'s [Statement]) {
        let outer = self.inside.replace(&name.text);
        self.statements(body, statement.span.start);
        self.inside = outer;
        self.chapter = "component";
    }

    /// The alternatives, under a separate heading. They may hold others.
    fn alternatives(&mut self) {
        if !self.alternatives.is_empty() {
            self.heading(2, "Variants and options");
            self.block(
                "A statement below takes the place of the one of the same name above, or is added. `--variant NAME` and \
                 `--variant CHOICE=OPTION` put them in force.",
            );
        }
        while !self.alternatives.is_empty() {
            for Alternative { title, text, body } in std::mem::take(&mut self.alternatives) {
                self.heading(3, &title);
                if !text.is_empty() {
                    self.block(&prose(&text));
                }
                self.inside = Some("the alternative");
                let begin = body.first().map_or(0, |first| first.span.start);
                self.statements(body, begin);
                self.inside = None;
            }
        }
    }

    /// A heading where the text has none: one for each kind of statement.
    fn open_chapter(&mut self, kind: &StatementKind) {
        let chapter = chapter(kind);
        let another_component = chapter == "Components" && self.chapter == "component";
        if self.inside.is_some() || chapter.is_empty() || chapter == self.chapter || another_component {
            return;
        }
        if !self.titled || self.chapter == "component" {
            self.heading(2, chapter);
        }
        self.chapter = chapter;
    }
}

/// Base of a component, a level or a variant.
pub(super) fn extending(base: Option<&Ident>) -> String {
    base.map(|base| format!(" extends {}", code(&base.text))).unwrap_or_default()
}

/// The chapter of a kind of statement.
fn chapter(kind: &StatementKind) -> &'static str {
    match kind {
        StatementKind::Unit { .. } => "Units",
        StatementKind::Set { .. } | StatementKind::Table(_) | StatementKind::TimeTable(_) => "Sets and tables",
        StatementKind::Domain(_) => "Domains",
        StatementKind::Declare { role, .. } => match role {
            Role::Param | Role::Random => "Parameters",
            Role::Action | Role::Disturbance => "Inputs",
            Role::State | Role::Discrete => "States",
            Role::Var | Role::Let => "Equations",
        },
        StatementKind::Equation { .. } | StatementKind::Def { .. } | StatementKind::Flux(_) | StatementKind::Reaction(_) => "Equations",
        StatementKind::Connector { .. } | StatementKind::Component { .. } => "Components",
        StatementKind::Instance { .. } | StatementKind::Connect { .. } => "Units and connections",
        StatementKind::Initial { .. }
        | StatementKind::StartEquation { .. }
        | StatementKind::StartSteady { .. }
        | StatementKind::Steady { .. } => "Start and steady state",
        StatementKind::At { .. } | StatementKind::Control(_) | StatementKind::Event { .. } | StatementKind::Phase(_) => {
            "Instants, events and phases"
        }
        StatementKind::Observe { .. } | StatementKind::Level { .. } => "Observations",
        StatementKind::Reward { .. } => "Rewards",
        StatementKind::Fail { .. } | StatementKind::Success { .. } | StatementKind::Constraint { .. } => "Ends and constraints",
        StatementKind::Invariant { .. } => "Invariants",
        StatementKind::Episode { .. } | StatementKind::Solver { .. } => "Episode and solver",
        StatementKind::Policy { .. } => "Policies",
        StatementKind::Choice { .. } => "Choices",
        StatementKind::Test { .. } => "Tests",
        StatementKind::Model { .. }
        | StatementKind::Import { .. }
        | StatementKind::Time { .. }
        | StatementKind::Port { .. }
        | StatementKind::Next { .. }
        | StatementKind::Reset { .. }
        | StatementKind::Clamp { .. }
        | StatementKind::TestStep(_)
        | StatementKind::Variant { .. }
        | StatementKind::Remove { .. }
        | StatementKind::When { .. } => "",
    }
}

/// The title in a comment `# ---- Title ----`.
fn title(line: &str) -> Option<&str> {
    let words = line.trim().strip_prefix('#')?.trim();
    let inner = words.strip_prefix("--")?.strip_suffix("--")?;
    Some(inner.trim_matches('-').trim()).filter(|title| !title.is_empty())
}

/// A name with its indices as it is declared: `c[species, z]`.
pub(super) fn declared(name: &Ident, indices: &[smpl_dsl::syntax::Binder]) -> String {
    use smpl_dsl::syntax::BinderSet;
    if indices.is_empty() {
        return name.text.clone();
    }
    let over = |binder: &smpl_dsl::syntax::Binder| match &binder.over {
        BinderSet::Set(set) => set.text.clone(),
        BinderSet::Itself | BinderSet::Range(..) | BinderSet::Tuple(_) => binder.name.text.clone(),
    };
    format!("{}[{}]", name.text, indices.iter().map(over).collect::<Vec<_>>().join(", "))
}
