//! Declarations: variants, imports, sets, tables, variables, components.

use std::collections::HashMap;

use smpl_dsl::diagnostic::{Diagnostic, codes, did_you_mean};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{
    self, Binder, Declaration, Expr, ExprKind, Ident, SetMembers, Statement, StatementKind, Table, TableCells, TimeTable,
};
use smpl_dsl::units::Unit;

use super::items::{Item, items, overlay, plain, select};
use super::names::{Axis, Domain, Geometry, Scheme, Scope, ScopeId, Set, SetId, Symbol, SymbolId, SymbolKind};
use super::{Bound, Elaborator, Setting, Site};
use crate::ir::{Role, VarId};
use crate::model::Variable;

/// Deepest nest of components.
const MAX_COMPONENT_DEPTH: usize = 32;
/// Most elements of one variable.
const MAX_ELEMENTS: i64 = 50_000_000;

impl<'a> Elaborator<'a> {
    /// Decides which variants are on and which options are chosen; unknown names are faults.
    pub(super) fn select_variants(&mut self) {
        let mut switches = Vec::new();
        let mut choices = Vec::new();
        for file in self.files {
            collect_variants(&file.statements, &mut switches, &mut choices);
        }
        for file in self.files {
            self.check_whens(&file.statements, &switches, &choices);
        }
        for (name, options) in &choices {
            if let Some(first) = options.first() {
                self.selection.chosen.insert((*name).to_owned(), first.text.clone());
            }
        }
        let mut asked: Vec<(String, String)> = self.options.variants.clone();
        for (name, value) in &self.options.settings {
            let is_choice = choices.iter().any(|(c, _)| c == name) || switches.iter().any(|s| s == name);
            if is_choice {
                self.used_parameters.insert(name.clone());
                asked.push((
                    name.clone(),
                    match value {
                        Setting::Text(text) => text.clone(),
                        Setting::Number(x) => x.to_string(),
                    },
                ));
            }
        }
        for (name, option) in asked {
            if let Some((_, options)) = choices.iter().find(|(c, _)| **c == name) {
                if options.iter().any(|o| o.text == option) {
                    self.selection.chosen.insert(name, option);
                } else {
                    let known: Vec<&str> = options.iter().map(|o| o.text.as_str()).collect();
                    self.scenario_fault(format!("`{name}` cannot be `{option}`; it is one of {}", known.join(", ")));
                }
            } else if switches.iter().any(|s| **s == name) {
                match option.as_str() {
                    "true" | "false" => {
                        self.selection.chosen.insert(name, option);
                    }
                    _ => self.scenario_fault(format!("the variant `{name}` is a switch: it takes true or false, not `{option}`")),
                }
            } else {
                let known: Vec<&str> = switches.iter().copied().chain(choices.iter().map(|(c, _)| *c)).collect();
                let hint = did_you_mean(&name, known.iter().copied());
                let list = if known.is_empty() { "the model has none".to_owned() } else { format!("the model has {}", known.join(", ")) };
                self.scenario_fault_with(format!("unknown variant `{name}`: {list}"), hint);
            }
        }
        let chosen = &self.selection.chosen;
        self.model.interface.variants = switches.iter().map(|s| ((*s).to_owned(), chosen.get(*s).is_some_and(|v| v == "true"))).collect();
        self.model.interface.choices = choices
            .iter()
            .map(|(name, options)| {
                let labels: Vec<String> = options.iter().map(|o| o.text.clone()).collect();
                let at = chosen.get(*name).and_then(|c| labels.iter().position(|l| l == c)).unwrap_or(0);
                ((*name).to_owned(), labels, at as u32)
            })
            .collect();
    }

    /// A `when` that no choice can fulfil is a fault.
    fn check_whens(&mut self, statements: &[Statement], switches: &[&str], choices: &[(&str, &[Ident])]) {
        for statement in statements {
            match &statement.kind {
                StatementKind::When { choice, option, body } => {
                    let known = choices.iter().find(|(c, _)| **c == choice.text).map(|(_, options)| *options);
                    match known {
                        Some(options) if options.iter().any(|o| o.text == option.text) => {}
                        Some(options) => {
                            let list: Vec<&str> = options.iter().map(|o| o.text.as_str()).collect();
                            let message = format!("`{}` has no option `{}`: {}", choice.text, option.text, list.join(", "));
                            let help = did_you_mean(&option.text, list);
                            self.report(Diagnostic::error(codes::UNKNOWN_NAME, message, option.span).maybe_help(help));
                        }
                        None if switches.contains(&choice.text.as_str()) && matches!(option.text.as_str(), "true" | "false") => {}
                        None => {
                            let help = did_you_mean(&choice.text, choices.iter().map(|(c, _)| *c).chain(switches.iter().copied()));
                            let message = format!("unknown choice `{}`", choice.text);
                            self.report(Diagnostic::error(codes::UNKNOWN_NAME, message, choice.span).maybe_help(help));
                        }
                    }
                    self.check_whens(body, switches, choices);
                }
                StatementKind::Variant { body, .. } | StatementKind::Component { body, .. } => self.check_whens(body, switches, choices),
                _ => {}
            }
        }
    }

    pub(super) fn scenario_fault(&mut self, message: String) {
        self.scenario_fault_with(message, None);
    }

    fn scenario_fault_with(&mut self, message: String, help: Option<String>) {
        // Several may share the place (none): they are told apart by their text.
        self.diagnostics.push(Diagnostic::error(codes::BAD_SCENARIO, message, Span::default()).maybe_help(help));
    }

    /// Declares everything of the main file and what it imports.
    pub(super) fn declare_file(&mut self) {
        let root = self.names.scopes.push(Scope::default());
        let mut list = Vec::new();
        let mut seen = vec![false; self.files.len()];
        self.gather(0, &mut seen, &mut list);
        overlay(&mut list, items(&self.options.overlay, &self.selection));
        for item in &list {
            if let Item::Other(statement) = item {
                self.register(statement);
            }
        }
        self.declare_time(root, &list);
        self.declare_block(root, list, 0);
    }

    /// Items of a file after those of its imports.
    fn gather(&mut self, file: usize, seen: &mut [bool], out: &mut Vec<Item<'a>>) {
        if std::mem::replace(&mut seen[file], true) {
            return;
        }
        let files = self.files;
        for item in plain(&files[file].statements) {
            if let Item::Other(Statement { kind: StatementKind::Import { path, path_span }, .. }) = item {
                match self.imports.get(path) {
                    Some(&imported) => self.gather(imported, seen, out),
                    None => self.report(Diagnostic::error(
                        codes::UNKNOWN_IMPORT,
                        format!("the file `{path}` was not found beside the model or in the library"),
                        *path_span,
                    )),
                }
                continue;
            }
            out.push(item);
        }
        // Variants and choices may replace what is imported.
        select(out, &files[file].statements, &self.selection);
    }

    fn register(&mut self, statement: &'a Statement) {
        let (table, name) = match &statement.kind {
            StatementKind::Component { name, .. } => (&mut self.components, name),
            StatementKind::Connector { name, .. } => (&mut self.connectors, name),
            _ => return,
        };
        if let Some(before) = table.insert(&name.text, statement) {
            let at = before.span;
            self.duplicate(name, at);
        }
    }

    fn duplicate(&mut self, name: &Ident, before: Span) {
        // Kinds are declared one after another; the reader goes by the order of the text.
        let position = |s: Span| (s.file, s.start);
        let (before, second) = if position(before) <= position(name.span) { (before, name.span) } else { (name.span, before) };
        self.report(
            Diagnostic::error(codes::DUPLICATE_NAME, format!("`{}` is declared twice", name.text), second)
                .label("second declaration")
                .secondary(before, "first declaration"),
        );
    }

    fn declare_time(&mut self, root: ScopeId, list: &[Item<'a>]) {
        let mut name = "t".to_owned();
        let mut unit = Unit::named("s");
        let mut span = Span::default();
        let mut model_seen: Option<Span> = None;
        for item in list {
            let Item::Other(statement) = item else { continue };
            match &statement.kind {
                StatementKind::Time { name: n, unit: u } => {
                    name.clone_from(&n.text);
                    span = statement.span;
                    let place = self.place(root, Site::Dynamics);
                    unit = self.unit(u, &place);
                }
                StatementKind::Model { name: n, text } => {
                    if let Some(before) = model_seen.replace(statement.span) {
                        self.duplicate(n, before);
                    }
                    self.model.interface.name.clone_from(&n.text);
                    self.model.interface.text = text.clone().unwrap_or_default();
                }
                _ => {}
            }
        }
        self.time_unit = unit.unwrap_or_else(Unit::one);
        self.time_name.clone_from(&name);
        self.model.interface.time = (name.clone(), self.time_unit.to_string());
        let symbol = Symbol { path: name.clone(), scope: root, span, kind: SymbolKind::Time };
        let _ = self.names.declare(&name, symbol);
    }

    /// Declares a symbol; a second one of that name is a fault.
    fn declare(&mut self, scope: ScopeId, name: &Ident, kind: SymbolKind<'a>) -> Option<SymbolId> {
        let path = format!("{}{}", self.names.scopes[scope].prefix, name.text);
        match self.names.declare(&name.text, Symbol { path, scope, span: name.span, kind }) {
            Ok(id) => Some(id),
            Err(before) => {
                let at = self.names.symbols[before].span;
                self.duplicate(name, at);
                // Which of both is meant is not known: what depends on it is not reported.
                self.names.symbols[before].kind = SymbolKind::Faulty;
                None
            }
        }
    }

    /// A name whose declaration is at fault: its uses cause no further report.
    fn faulty(&mut self, scope: ScopeId, name: &Ident) {
        self.declare(scope, name, SymbolKind::Faulty);
    }

    /// Statements with names of their own: two with one name are a fault.
    fn check_names(&mut self, list: &[Item<'a>]) {
        let mut seen: HashMap<String, Span> = HashMap::new();
        for item in list {
            let (what, name, span) = match item {
                Item::Observe(o) => match &o.name {
                    Some(name) => ("observations", name.text.clone(), o.span),
                    None => ("observations", super::items::text(&o.value), o.span),
                },
                Item::At(instant, s) => match &s.kind {
                    StatementKind::Next { target, .. } => {
                        let text = format!("next {}", super::items::text(target));
                        match seen.insert(format!("at {} {text}", instant.text), s.span) {
                            Some(first) => self.report(
                                Diagnostic::error(codes::DUPLICATE_NAME, format!("two `{text}` at one instant"), s.span)
                                    .secondary(first, "the first one")
                                    .help("all `next` of an instant assign together, so there can be one only"),
                            ),
                            None => continue,
                        }
                        continue;
                    }
                    _ => continue,
                },
                Item::Other(s) => match &s.kind {
                    StatementKind::Reward { name, .. } => ("rewards", name.text.clone(), name.span),
                    StatementKind::Fail { name, .. } => ("failures", name.text.clone(), name.span),
                    StatementKind::Success { name, .. } => ("successes", name.text.clone(), name.span),
                    StatementKind::Constraint { name, .. } => ("constraints", name.text.clone(), name.span),
                    StatementKind::Invariant { name, .. } => ("invariants", name.text.clone(), name.span),
                    StatementKind::Policy { name, .. } => ("policies", name.text.clone(), name.span),
                    StatementKind::Level { name, .. } => ("levels", name.text.clone(), name.span),
                    StatementKind::Event { name, .. } => ("events", name.text.clone(), name.span),
                    _ => continue,
                },
                Item::Declare(..) => continue,
            };
            if let Some(first) = seen.insert(format!("{what} {name}"), span) {
                self.report(
                    Diagnostic::error(codes::DUPLICATE_NAME, format!("two {what} are called `{name}`"), span)
                        .secondary(first, "the first one"),
                );
            }
        }
        let mut defaults = list.iter().filter_map(|i| match i {
            Item::Other(Statement { kind: StatementKind::Reward { name, default: true, .. }, .. }) => Some(name.span),
            _ => None,
        });
        if let (Some(first), Some(second)) = (defaults.next(), defaults.next()) {
            self.report(
                Diagnostic::error(codes::DUPLICATE_CLAUSE, "two rewards are the default", second).secondary(first, "the first one"),
            );
        }
    }

    /// Declares a block: sets and scalars first, since sizes of domains may need them, then what is indexed, then instances.
    pub(super) fn declare_block(&mut self, scope: ScopeId, list: Vec<Item<'a>>, depth: usize) {
        self.declare_phases(scope, &list);
        self.check_names(&list);
        let is_range = |s: &Statement| matches!(s.kind, StatementKind::Set { members: SetMembers::Range(..), .. });
        for item in &list {
            if let Item::Other(statement) = item
                && !is_range(statement)
            {
                self.declare_set(scope, statement);
            }
        }
        for item in &list {
            if let Item::Declare(role, d) = item
                && d.indices.is_empty()
            {
                self.declare_variable(scope, *role, d);
            }
        }
        // The ends of a range may be computed from scalars.
        for item in &list {
            if let Item::Other(statement) = item
                && is_range(statement)
            {
                self.declare_set(scope, statement);
            }
        }
        for item in &list {
            if let Item::Other(statement) = item {
                match &statement.kind {
                    StatementKind::Table(table) => self.declare_table(scope, table),
                    StatementKind::TimeTable(table) => self.declare_time_table(scope, table),
                    StatementKind::Def { name, parameters, body } => {
                        self.declare(scope, name, SymbolKind::Def { parameters, body });
                    }
                    StatementKind::Domain(domain) => self.declare_domain(scope, domain),
                    _ => {}
                }
            }
        }
        for item in &list {
            match item {
                Item::Declare(role, d) if !d.indices.is_empty() => self.declare_variable(scope, *role, d),
                Item::Other(statement) => match &statement.kind {
                    StatementKind::Flux(flux) => {
                        let place = self.place(scope, Site::Dynamics);
                        let Some((axes, binders)) = self.axes(&flux.indices, &place) else {
                            self.faulty(scope, &flux.name);
                            continue;
                        };
                        if !matches!(axes.last(), Some(Axis::Domain(_))) {
                            self.report(Diagnostic::error(
                                codes::WRONG_SHAPE,
                                format!("the last index of the flux `{}` must be the domain along which it flows", flux.name.text),
                                flux.name.span,
                            ));
                            self.faulty(scope, &flux.name);
                            continue;
                        }
                        self.declare(scope, &flux.name, SymbolKind::Flux { flux, axes, binders });
                    }
                    StatementKind::Port { names, connector } => {
                        for name in names {
                            self.declare_port(scope, name, connector);
                        }
                    }
                    _ => {}
                },
                _ => {}
            }
        }
        let at = self.blocks.len();
        self.blocks.push((scope, Vec::new()));
        for item in &list {
            if let Item::Other(statement) = item
                && let StatementKind::Instance { component, name, indices, arguments } = &statement.kind
            {
                self.declare_instance(scope, component, name, indices, arguments, depth);
            }
        }
        self.blocks[at].1 = list;
    }

    fn declare_set(&mut self, scope: ScopeId, statement: &'a Statement) {
        match &statement.kind {
            StatementKind::Choice { name, options, .. } => {
                let chosen = self.selection.chosen.get(&name.text).and_then(|c| options.iter().position(|o| o.text == *c));
                self.declare(scope, name, SymbolKind::Choice { options, chosen: chosen.unwrap_or(0) });
            }
            StatementKind::Set { name, members, .. } => {
                let place = self.place(scope, Site::Dynamics);
                let (labels, first) = match members {
                    SetMembers::Names(names) => (names.iter().map(|n| n.text.clone()).collect::<Vec<_>>(), None),
                    SetMembers::Range(a, b) => {
                        let (Some(a), Some(b)) = (self.integer(a, &place), self.integer(b, &place)) else {
                            return self.faulty(scope, name);
                        };
                        if b.saturating_sub(a) >= 100_000 {
                            self.report(
                                Diagnostic::error(codes::TOO_LARGE, "a set of more than a hundred thousand members", name.span)
                                    .help("use a `domain`: its cells stay a loop"),
                            );
                            return self.faulty(scope, name);
                        }
                        ((a..=b).map(|i| i.to_string()).collect(), Some(a))
                    }
                };
                if labels.is_empty() {
                    self.report(Diagnostic::error(codes::EMPTY_SET, format!("the set `{}` has no members", name.text), name.span));
                }
                if let SetMembers::Names(names) = members {
                    self.check_members(names);
                }
                self.new_set(scope, name, labels, first);
            }
            // `table over species { ... }` declares the set as well, unless it exists.
            StatementKind::Table(table) => {
                if let [index] = table.indices.as_slice()
                    && self.names.lookup(scope, &index.text).is_none()
                {
                    let labels = table.rows.iter().map(|r| r.label.text.clone()).collect();
                    self.new_set(scope, index, labels, None);
                }
            }
            _ => {}
        }
    }

    /// Members of a set are distinct.
    fn check_members(&mut self, names: &[Ident]) {
        let mut seen: HashMap<&str, Span> = HashMap::new();
        for name in names {
            if let Some(&first) = seen.get(name.text.as_str()) {
                self.report(
                    Diagnostic::error(codes::DUPLICATE_NAME, format!("`{}` is twice in the set", name.text), name.span)
                        .secondary(first, "first here"),
                );
            }
            seen.entry(&name.text).or_insert(name.span);
        }
    }

    fn new_set(&mut self, scope: ScopeId, name: &Ident, labels: Vec<String>, first: Option<i64>) {
        let set = self.names.sets.push(Set { name: name.text.clone(), labels, first });
        self.declare(scope, name, SymbolKind::Set(set));
    }

    fn set_named(&mut self, scope: ScopeId, name: &Ident) -> Option<SetId> {
        match self.names.lookup(scope, &name.text).map(|s| self.names.symbols[s].kind.clone()) {
            Some(SymbolKind::Set(set) | SymbolKind::Phase(set)) => Some(set),
            Some(SymbolKind::Faulty) => None,
            _ => {
                let known: Vec<String> = self.names.sets.values().map(|s| s.name.clone()).collect();
                let help = did_you_mean(&name.text, known.iter().map(String::as_str));
                self.report(Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown set `{}`", name.text), name.span).maybe_help(help));
                None
            }
        }
    }

    fn declare_table(&mut self, scope: ScopeId, table: &'a Table) {
        let mut sets = Vec::new();
        for index in &table.indices {
            let Some(set) = self.set_named(scope, index) else {
                for column in &table.columns {
                    self.faulty(scope, &column.name);
                }
                return;
            };
            sets.push(set);
        }
        let place = self.place(scope, Site::Dynamics);
        let columns = table.columns.len().max(1);
        let inner: usize = sets.iter().skip(1).map(|&s| self.names.sets[s].labels.len()).product();
        let outer = sets.first().map_or(1, |&s| self.names.sets[s].labels.len());
        // One table of several columns, or one table of one or two indices.
        let width = if columns > 1 { columns } else { inner };
        let mut values = vec![vec![f64::NAN; outer * inner]; columns];
        let mut tables_units = Vec::new();
        for column in &table.columns {
            let unit = match &column.unit {
                Some(u) => self.unit(u, &place),
                None => Some(Unit::one()),
            };
            tables_units.push(unit.unwrap_or_else(Unit::one));
        }
        if let Some(e) = &table.default
            && let Some(x) = self.table_number(e, tables_units.first(), &place)
        {
            for v in &mut values {
                v.fill(x);
            }
        }
        let before = self.diagnostics.len();
        for row in &table.rows {
            let Some(i) = sets.first().and_then(|&s| self.row_member(s, &row.label)) else { continue };
            match &row.cells {
                TableCells::Values(cells) => {
                    if cells.len() != width {
                        self.report(
                            Diagnostic::error(codes::WRONG_SHAPE, format!("this row has {} values, not {width}", cells.len()), row.span)
                                .help("one value a column, or a member of the second set"),
                        );
                        continue;
                    }
                    for (j, e) in cells.iter().enumerate() {
                        let (table, at) = if columns > 1 { (j, i) } else { (0, i * inner + j) };
                        if let Some(x) = self.table_number(e, tables_units.get(table), &place) {
                            values[table][at] = x;
                        }
                    }
                }
                TableCells::Sparse(cells) => {
                    let Some(&second) = sets.get(1) else {
                        self.report(Diagnostic::error(codes::WRONG_SHAPE, "`member = value` needs a table over two sets", row.span));
                        continue;
                    };
                    for (label, e) in cells {
                        let Some(j) = self.row_member(second, label) else { continue };
                        if let Some(x) = self.table_number(e, tables_units.first(), &place) {
                            values[0][i * inner + j] = x;
                        }
                    }
                }
            }
        }
        // What a faulty row would have given is not missing.
        if self.diagnostics.len() == before {
            self.check_table(table, &sets, &values);
        }
        for ((column, unit), values) in table.columns.iter().zip(tables_units).zip(values) {
            self.declare(scope, &column.name, SymbolKind::Table { axes: sets.clone(), unit, values });
        }
    }

    /// Reports the first entry that has no value.
    fn check_table(&mut self, table: &Table, sets: &[SetId], values: &[Vec<f64>]) {
        for (column, values) in table.columns.iter().zip(values) {
            let Some(at) = values.iter().position(|v| v.is_nan()) else { continue };
            let mut rest = at;
            let mut labels = Vec::new();
            for &set in sets.iter().rev() {
                let members = &self.names.sets[set].labels;
                labels.push(members[rest % members.len().max(1)].clone());
                rest /= members.len().max(1);
            }
            labels.reverse();
            self.report(
                Diagnostic::error(
                    codes::MISSING_DEFAULT,
                    format!("`{}` has no value for `{}`", column.name.text, labels.join(", ")),
                    column.name.span,
                )
                .help("give every member a row, or the table a `default`"),
            );
            // The other columns lack the same rows.
            return;
        }
    }

    fn row_member(&mut self, set: SetId, label: &Ident) -> Option<usize> {
        let found = self.names.sets[set].labels.iter().position(|l| *l == label.text);
        if found.is_none() {
            let name = self.names.sets[set].name.clone();
            let help = did_you_mean(&label.text, self.names.sets[set].labels.iter().map(String::as_str));
            self.report(
                Diagnostic::error(codes::OUT_OF_RANGE, format!("`{}` is no member of `{name}`", label.text), label.span).maybe_help(help),
            );
        }
        found
    }

    fn table_number(&mut self, e: &Expr, unit: Option<&Unit>, place: &super::Place) -> Option<f64> {
        let one = Unit::one();
        let expr = self.number_in(e, unit.unwrap_or(&one), "the table's entry", Span::default(), place);
        let reports = self.diagnostics.len();
        let value = self.constant_value(expr);
        if value.is_none() && reports == self.diagnostics.len() {
            self.missing_value("an entry of a table", e.span);
        }
        value.filter(|v| !v.is_nan())
    }

    fn declare_time_table(&mut self, scope: ScopeId, table: &'a TimeTable) {
        let place = self.place(scope, Site::Dynamics);
        let unit = match &table.unit {
            Some(u) => self.unit(u, &place).unwrap_or_else(Unit::one),
            None => Unit::one(),
        };
        let time_unit = self.unit(&table.time_unit, &place).unwrap_or_else(Unit::one);
        let mut points = Vec::with_capacity(table.entries.len());
        for (time, value) in &table.entries {
            let t = self.table_number(time, Some(&time_unit), &place);
            let v = self.table_number(value, Some(&unit), &place);
            if let (Some(t), Some(v)) = (t, v) {
                if points.last().is_some_and(|&(before, _): &(f64, f64)| before >= t) {
                    self.report(Diagnostic::error(codes::BAD_SETTING, "times of a table must increase", time.span));
                }
                points.push((t, v));
            }
        }
        if points.is_empty() {
            self.report(Diagnostic::error(codes::EMPTY_SET, format!("the table `{}` is empty", table.name.text), table.name.span));
        }
        self.declare(scope, &table.name, SymbolKind::TimeTable { unit, time_unit, kind: table.kind, points });
    }

    fn declare_domain(&mut self, scope: ScopeId, domain: &'a syntax::Domain) {
        let place = self.place(scope, Site::Dynamics);
        let Some(cells) = self.integer(&domain.cells, &place) else { return self.faulty(scope, &domain.name) };
        if !(1..=MAX_ELEMENTS).contains(&cells) {
            let code = if cells < 1 { codes::EMPTY_SET } else { codes::TOO_LARGE };
            self.report(
                Diagnostic::error(code, format!("a domain of {cells} cells"), domain.cells.span).label("at least 1, at most 50 million"),
            );
            return self.faulty(scope, &domain.name);
        }
        let scheme = self.option(
            domain.scheme.as_ref(),
            "scheme",
            Scheme::Central,
            &[
                ("upwind", Scheme::Upwind),
                ("downwind", Scheme::Downwind),
                ("central", Scheme::Central),
                ("upwind2", Scheme::Upwind2),
                ("limited", Scheme::Limited),
            ],
        );
        let geometry = self.option(
            domain.geometry.as_ref(),
            "geometry",
            Geometry::Planar,
            &[("planar", Geometry::Planar), ("cylindrical", Geometry::Cylindrical), ("spherical", Geometry::Spherical)],
        );
        let id = self.names.domains.push(Domain {
            name: domain.name.text.clone(),
            scope,
            declaration: domain,
            cells,
            scheme,
            geometry,
            ends: None,
        });
        self.declare(scope, &domain.name, SymbolKind::Domain(id));
    }

    fn option<T: Copy>(&mut self, written: Option<&Ident>, what: &str, default: T, known: &[(&str, T)]) -> T {
        let Some(name) = written else { return default };
        if let Some((_, value)) = known.iter().find(|(k, _)| *k == name.text) {
            return *value;
        }
        let list: Vec<&str> = known.iter().map(|(k, _)| *k).collect();
        self.report(
            Diagnostic::error(codes::BAD_SETTING, format!("unknown {what} `{}`", name.text), name.span)
                .help(format!("it is one of {}", list.join(", "))),
        );
        default
    }

    /// Declares a parameter, state, `let` and so on.
    fn declare_variable(&mut self, scope: ScopeId, role: syntax::Role, d: &'a Declaration) {
        let place = self.place(scope, Site::Dynamics);
        let Some((axes, binders)) = self.axes(&d.indices, &place) else { return self.faulty(scope, &d.name) };
        let written = d.unit.as_ref().map(|u| self.unit(u, &place));
        if matches!(written, Some(None)) {
            // The unit is at fault; the name is declared so that its uses cause no further report.
            return self.declare_poison(scope, role, d, axes, binders);
        }
        let unit = written.flatten();
        let role = match role {
            syntax::Role::Let | syntax::Role::Random => {
                let random = role == syntax::Role::Random;
                let definition = if random { d.sample.as_ref().or(d.value.as_ref()) } else { d.value.as_ref() };
                let Some(definition) = definition else {
                    self.report(
                        Diagnostic::error(codes::MISSING_CLAUSE, format!("`{}` has no definition", d.name.text), d.span)
                            .help("write `= expression`, or declare a `var` and give it an equation"),
                    );
                    return self.faulty(scope, &d.name);
                };
                self.declare(scope, &d.name, SymbolKind::Let { axes, binders, unit, definition, random, declaration: d });
                return;
            }
            syntax::Role::Param => Role::Param,
            syntax::Role::Action => Role::Action,
            syntax::Role::State => Role::State,
            syntax::Role::Var => Role::Algebraic,
            syntax::Role::Discrete => Role::Discrete,
            syntax::Role::Disturbance => Role::Disturbance,
        };
        let unit = unit.unwrap_or_else(Unit::one);
        self.new_variable(scope, &d.name, role, axes, unit, d);
    }

    fn declare_poison(&mut self, scope: ScopeId, role: syntax::Role, d: &'a Declaration, axes: Vec<Axis>, binders: Vec<String>) {
        if matches!(role, syntax::Role::Let | syntax::Role::Random) {
            if let Some(definition) = d.value.as_ref().or(d.sample.as_ref()) {
                self.declare(scope, &d.name, SymbolKind::Let { axes, binders, unit: None, definition, random: false, declaration: d });
            }
            return;
        }
        self.declare(scope, &d.name, SymbolKind::Faulty);
    }

    fn new_variable(&mut self, scope: ScopeId, name: &Ident, role: Role, axes: Vec<Axis>, unit: Unit, d: &'a Declaration) -> Option<VarId> {
        let len = axes.iter().try_fold(1_i64, |n, &a| n.checked_mul(self.names.axis_len(a))).unwrap_or(i64::MAX);
        if len > MAX_ELEMENTS {
            self.report(
                Diagnostic::error(codes::TOO_LARGE, format!("`{}` would have {len} elements", name.text), d.span)
                    .label("at most 50 million"),
            );
            self.faulty(scope, name);
            return None;
        }
        let path = format!("{}{}", self.names.scopes[scope].prefix, name.text);
        let var = self.vars.push(Variable { name: path, role, len: len as u32, span: d.span });
        let symbol = self.declare(scope, name, SymbolKind::Variable { var, axes, unit, declaration: d })?;
        self.symbol_of.insert(var, symbol);
        Some(var)
    }

    fn declare_port(&mut self, scope: ScopeId, name: &Ident, connector: &Ident) {
        let Some(StatementKind::Connector { members, .. }) = self.connectors.get(connector.text.as_str()).map(|s| &s.kind) else {
            let known: Vec<&str> = self.connectors.keys().copied().collect();
            let help = did_you_mean(&connector.text, known);
            self.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown connector `{}`", connector.text), connector.span).maybe_help(help),
            );
            return self.faulty(scope, name);
        };
        let prefix = format!("{}{}.", self.names.scopes[scope].prefix, name.text);
        let port = self.names.scopes.push(Scope { prefix, parent: Some(scope), names: Default::default() });
        self.declare(scope, name, SymbolKind::Instance(port));
        for member in members {
            let place = self.place(scope, Site::Dynamics);
            let Some((axes, _)) = self.axes(&member.indices, &place) else { continue };
            let unit = match &member.unit {
                Some(u) => self.unit(u, &place),
                None => Some(Unit::one()),
            };
            let Some(unit) = unit else { continue };
            if let Some(var) = self.new_variable(port, &member.name, Role::Algebraic, axes, unit, member) {
                self.port_variables.insert(var);
            }
        }
    }

    fn declare_instance(
        &mut self,
        scope: ScopeId,
        component: &'a Ident,
        name: &'a Ident,
        indices: &'a [Binder],
        arguments: &'a [(Ident, Expr)],
        depth: usize,
    ) {
        if depth >= MAX_COMPONENT_DEPTH {
            self.report(Diagnostic::error(codes::CYCLIC_DEFINITION, format!("`{}` contains itself", component.text), component.span));
            return self.faulty(scope, name);
        }
        let Some(statement) = self.components.get(component.text.as_str()).copied() else {
            let known: Vec<&str> = self.components.keys().copied().collect();
            let help = did_you_mean(&component.text, known);
            self.report(
                Diagnostic::error(codes::UNKNOWN_NAME, format!("unknown component `{}`", component.text), component.span).maybe_help(help),
            );
            return self.faulty(scope, name);
        };
        let place = self.place(scope, Site::Dynamics);
        let path = format!("{}{}", self.names.scopes[scope].prefix, name.text);
        if indices.is_empty() {
            let inner = self.instantiate(statement, &path, name.span, arguments, &place, depth);
            self.declare(scope, name, SymbolKind::Instance(inner));
            return;
        }
        let [binder] = indices else {
            self.report(Diagnostic::error(codes::WRONG_SHAPE, "instances take one index", name.span));
            return self.faulty(scope, name);
        };
        let mut list = Vec::new();
        for value in self.bindings_of(binder, &place) {
            let super::functions::BinderValue::One(bound) = value else {
                self.report(Diagnostic::error(codes::WRONG_KIND, "instances are counted by a set", binder.span));
                return self.faulty(scope, name);
            };
            let label = match &bound {
                Bound::Member(set, i) => self.names.sets[*set].labels[*i].clone(),
                Bound::Number(e) => self.exprs.as_const(*e).map_or_else(String::new, |x| x.to_string()),
                _ => continue,
            };
            let inner_place = place.bind(&binder.name.text, bound);
            let inner = self.instantiate(statement, &format!("{path}[{label}]"), name.span, arguments, &inner_place, depth);
            list.push((label, inner));
        }
        self.declare(scope, name, SymbolKind::Instances(list));
    }

    fn instantiate(
        &mut self,
        statement: &'a Statement,
        path: &str,
        used: Span,
        arguments: &'a [(Ident, Expr)],
        outer: &super::Place,
        depth: usize,
    ) -> ScopeId {
        let root = ScopeId::from_u32(0);
        let scope = self.names.scopes.push(Scope { prefix: format!("{path}."), parent: Some(root), names: Default::default() });
        self.used_at.insert(scope, used);
        let StatementKind::Component { name, parameters, body, .. } = &statement.kind else { return scope };
        for (parameter, default) in parameters {
            let given = arguments.iter().find(|(a, _)| a.text == parameter.text).map(|(_, e)| e);
            self.structural(scope, (path, used), parameter, given, default.as_ref(), outer);
        }
        let list = items(body, &self.selection);
        for (argument, e) in arguments {
            if parameters.iter().any(|(p, _)| p.text == argument.text) {
                continue;
            }
            let known: Vec<&str> = list
                .iter()
                .filter_map(|i| match i {
                    Item::Declare(syntax::Role::Param, d) => Some(d.name.text.as_str()),
                    _ => None,
                })
                .chain(parameters.iter().map(|(p, _)| p.text.as_str()))
                .collect();
            if known.contains(&argument.text.as_str()) {
                self.given.insert((scope, argument.text.clone()), (e, outer.clone()));
            } else {
                let help = did_you_mean(&argument.text, known);
                self.report(
                    Diagnostic::error(
                        codes::WRONG_ARGUMENTS,
                        format!("the component `{}` has no parameter `{}`", name.text, argument.text),
                        argument.span,
                    )
                    .maybe_help(help),
                );
            }
        }
        self.declare_block(scope, list, depth + 1);
        scope
    }

    /// A structural parameter: a whole number or a set; a setting `R1.n_cells` or `n_cells` overrides it.
    fn structural(
        &mut self,
        scope: ScopeId,
        (path, used): (&str, Span),
        name: &'a Ident,
        given: Option<&Expr>,
        default: Option<&Expr>,
        outer: &super::Place,
    ) {
        for key in [format!("{path}.{}", name.text), name.text.clone()] {
            if let Some(Setting::Number(x)) = self.options.settings.get(&key) {
                self.used_parameters.insert(key.clone());
                if x.fract() == 0.0 && *x >= 0.0 && *x < 1e9 {
                    self.declare(scope, name, SymbolKind::Integer(*x as i64));
                    return;
                }
                self.scenario_fault(format!("`{key}` takes a whole number, not {x}"));
            }
        }
        let Some(e) = given.or(default) else {
            self.report(
                Diagnostic::error(codes::MISSING_DEFAULT, format!("`{path}` needs a value of `{}`", name.text), used)
                    .secondary(name.span, "it has no default")
                    .help(format!("write `({} = ...)` after the instance's name", name.text)),
            );
            return self.faulty(scope, name);
        };
        if let ExprKind::Name(n) = &e.kind
            && let Some(symbol) = self.names.lookup(outer.scope, &n.text)
            && let SymbolKind::Set(set) = self.names.symbols[symbol].kind
        {
            self.declare(scope, name, SymbolKind::Set(set));
            return;
        }
        let kind = self.integer(e, outer).map_or(SymbolKind::Faulty, SymbolKind::Integer);
        self.declare(scope, name, kind);
    }
}

fn collect_variants<'a>(statements: &'a [Statement], switches: &mut Vec<&'a str>, choices: &mut Vec<(&'a str, &'a [Ident])>) {
    for statement in statements {
        match &statement.kind {
            StatementKind::Variant { name, body, .. } => {
                if !switches.contains(&name.text.as_str()) {
                    switches.push(&name.text);
                }
                collect_variants(body, switches, choices);
            }
            StatementKind::Choice { name, options, .. } => {
                if !choices.iter().any(|(c, _)| *c == name.text) {
                    choices.push((&name.text, options));
                }
            }
            StatementKind::When { body, .. } | StatementKind::Component { body, .. } => collect_variants(body, switches, choices),
            _ => {}
        }
    }
}
