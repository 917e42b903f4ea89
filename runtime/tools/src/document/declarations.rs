//! Declarations, sets, tables, domains, components' outsides and units: what a model is made of.

use smpl_dsl::latex;
use smpl_dsl::syntax::{
    Binder, BinderSet, Clip, Declaration, Domain, Expr, ExprKind, Ident, Measured, Role, SetMembers, Statement, StatementKind, Table,
    TableCells, TablePoints, TableRow, TimeTable, TimeTableKind,
};

use super::equations;
use super::markdown::{self, code, display, math, prose};
use super::statements::{Writer, declared};

const PARAMETERS: &[&str] = &["parameter", "symbol", "unit", "value", "drawn at reset", "range", "meaning"];
const ACTIONS: &[&str] = &["action", "symbol", "unit", "nominal", "range", "scale", "meaning"];
const STATES: &[&str] = &["state", "symbol", "unit", "start", "drawn at reset", "range", "scale", "meaning"];
const VARIABLES: &[&str] = &["algebraic variable", "symbol", "unit", "range", "scale", "meaning"];
const DISCRETES: &[&str] = &["discrete variable", "symbol", "unit", "start", "drawn at reset", "range", "meaning"];
const DISTURBANCES: &[&str] = &["disturbance", "symbol", "unit", "start", "next value", "range", "meaning"];
const RANDOMS: &[&str] = &["random number", "symbol", "drawn at reset", "meaning"];
const MEMBERS: &[&str] = &["member", "symbol", "unit", "range", "meaning"];
const OWN_UNITS: &[&str] = &["unit of measure", "size", "meaning"];
const SETS: &[&str] = &["set", "members", "meaning"];
const DOMAINS: &[&str] = &["domain", "from", "to", "cells", "scheme", "geometry", "particulars", "meaning"];
const TIME_TABLES: &[&str] = &["table", "unit", "values", "meaning"];
const UNITS: &[&str] = &["unit", "is a", "with"];
const CONNECTIONS: &[&str] = &["connection"];
const CHOICES: &[&str] = &["choice", "options, the first one is the default", "meaning"];

impl<'s> Writer<'s> {
    /// Declared quantities, one a row.
    pub(super) fn declarations(&mut self, role: Role, declarations: &'s [Declaration]) {
        for d in declarations {
            let columns = match role {
                Role::Param => PARAMETERS,
                Role::Action => ACTIONS,
                Role::State => STATES,
                Role::Var | Role::Let => VARIABLES,
                Role::Discrete => DISCRETES,
                Role::Disturbance => DISTURBANCES,
                Role::Random => RANDOMS,
            };
            let row = columns.iter().map(|column| self.cell(column, d)).collect();
            self.row(columns, row);
        }
    }

    /// Value of a declaration for a column.
    fn cell(&self, column: &str, d: &Declaration) -> String {
        let inline = |value: &Option<Expr>| value.as_ref().map(|e| self.inline(e)).unwrap_or_default();
        match column {
            "symbol" => math(&latex::expression(&equations::element(&d.name, &d.indices))),
            "unit" => self.unit(d.unit.as_ref()),
            "value" | "nominal" | "start" => inline(&d.value),
            "next value" if d.measured.is_some() => d.measured.as_deref().map(followed).unwrap_or_default(),
            "drawn at reset" | "next value" => {
                let clip = d.clip.as_ref().map(|clip| self.clip(clip)).unwrap_or_default();
                format!("{}{clip}", inline(&d.sample))
            }
            "range" => {
                let bounds = d.bounds.as_ref().map(|(low, high)| self.range(low, high));
                bounds.into_iter().chain(d.nonnegative.map(|_| "nonnegative".to_owned())).collect::<Vec<_>>().join(", ")
            }
            "scale" => inline(&d.scale),
            "meaning" => {
                let pattern = d.pattern.as_ref().map(|pattern| format!("named {}", code(pattern)));
                let text = d.text.as_ref().map(|text| prose(text));
                text.into_iter().chain(pattern).collect::<Vec<_>>().join("; ")
            }
            _ => code(&declared(&d.name, &d.indices)),
        }
    }

    /// Bounds of values.
    pub(super) fn clip(&self, clip: &Clip) -> String {
        match clip {
            Clip::Bounds(_) => ", kept within its bounds".to_owned(),
            Clip::Range(low, high) => format!(", kept within {}", self.range(low, high)),
        }
    }

    /// Two ends.
    pub(super) fn range(&self, low: &Expr, high: &Expr) -> String {
        format!("{} to {}", self.inline(low), self.inline(high))
    }

    /// `let`s: name, meaning, unit, and what they are.
    pub(super) fn definitions(&mut self, statement: &'s Statement, declarations: &'s [Declaration]) {
        for d in declarations {
            let text = d.text.clone().unwrap_or_else(|| self.remark(statement.span));
            self.label("", &declared(&d.name, &d.indices), &self.unit(d.unit.as_ref()), &text);
            if let Some(line) = equations::definition(d) {
                self.block(&display(&line));
            }
        }
    }

    /// Writes statements of the model's structure; returns false for others.
    pub(super) fn structure(&mut self, kind: &'s StatementKind) -> bool {
        match kind {
            StatementKind::Time { name, unit } => {
                let unit = self.unit(Some(unit));
                self.block(&format!("Time is {}, in {unit}.", code(&name.text)));
            }
            StatementKind::Unit { name, size, text } => {
                let size = size.as_ref().map_or_else(|| "its own dimension".to_owned(), |size| self.inline(size));
                self.row(OWN_UNITS, vec![code(&name.text), size, prose(text.as_deref().unwrap_or(""))]);
            }
            StatementKind::Set { name, members, formulas, text } => {
                let members = match members {
                    SetMembers::Names(names) => {
                        let formula =
                            |n: &Ident| formulas.iter().find(|(member, _)| member.text == n.text).map(|(_, f)| format!(" ({})", f.text));
                        let member = |n: &Ident| format!("{}{}", code(&n.text), formula(n).unwrap_or_default());
                        names.iter().map(member).collect::<Vec<_>>().join(", ")
                    }
                    SetMembers::Range(low, high) => self.range(low, high),
                    SetMembers::Of(e @ Expr { kind: ExprKind::Binary(..), .. }) => math(&latex::set(e)),
                    SetMembers::Of(e) => self.inline(e),
                };
                self.row(SETS, vec![code(&name.text), members, prose(text.as_deref().unwrap_or(""))]);
            }
            StatementKind::Table(table) => self.table(table),
            StatementKind::TimeTable(table) => self.time_table(table),
            StatementKind::Domain(domain) => self.domain(domain),
            StatementKind::Connector { name, members, flows } => {
                self.block(&format!("Connector {}, what flows through a port:", code(&name.text)));
                if !flows.is_empty() {
                    let list: Vec<String> = flows.iter().map(|name| code(&name.text)).collect();
                    self.block(&format!("Positive into the component, with the sum zero at a node: {}.", list.join(", ")));
                }
                for d in members {
                    let row = MEMBERS.iter().map(|column| self.cell(column, d)).collect();
                    self.row(MEMBERS, row);
                }
            }
            StatementKind::Port { names, connector } => {
                let names: Vec<String> = names.iter().map(|port| code(&declared(&port.name, &port.indices))).collect();
                self.block(&format!("Ports {}: {}.", names.join(", "), code(&connector.text)));
            }
            StatementKind::Instance { component, name, indices, arguments } => self.instance(component, name, indices, arguments),
            StatementKind::Connect { chain, binders } => {
                let ends: Vec<String> = chain.iter().map(|end| code(self.source.texts.text(end.span))).collect();
                let over = latex::binders(binders);
                let over = if over.is_empty() { over } else { format!(", {}", math(&over)) };
                self.row(CONNECTIONS, vec![format!("{}{over}", ends.join(" → "))]);
            }
            StatementKind::Choice { name, options, text } => {
                let options: Vec<String> = options.iter().map(|o| code(&o.text)).collect();
                self.row(CHOICES, vec![code(&name.text), options.join(", "), prose(text.as_deref().unwrap_or(""))]);
            }
            StatementKind::Model { .. }
            | StatementKind::Import { .. }
            | StatementKind::Def { .. }
            | StatementKind::Declare { .. }
            | StatementKind::Equation { .. }
            | StatementKind::Flux(_)
            | StatementKind::Reaction(_)
            | StatementKind::Component { .. }
            | StatementKind::Initial { .. }
            | StatementKind::StartEquation { .. }
            | StatementKind::StartSteady { .. }
            | StatementKind::Steady { .. }
            | StatementKind::Observe { .. }
            | StatementKind::Level { .. }
            | StatementKind::Reward { .. }
            | StatementKind::Fail { .. }
            | StatementKind::Success { .. }
            | StatementKind::Constraint { .. }
            | StatementKind::Invariant { .. }
            | StatementKind::Episode { .. }
            | StatementKind::Solver { .. }
            | StatementKind::Policy { .. }
            | StatementKind::At { .. }
            | StatementKind::Control(_)
            | StatementKind::Next { .. }
            | StatementKind::Reset { .. }
            | StatementKind::Clamp { .. }
            | StatementKind::Event { .. }
            | StatementKind::Phase(_)
            | StatementKind::Test { .. }
            | StatementKind::TestStep(_)
            | StatementKind::Variant { .. }
            | StatementKind::Remove { .. }
            | StatementKind::When { .. } => return false,
        }
        true
    }

    fn instance(&mut self, component: &Ident, name: &Ident, indices: &[Binder], arguments: &[(Ident, Expr)]) {
        let over = indices.iter().filter_map(|binder| match &binder.over {
            BinderSet::Range(low, high) => Some(format!("{} = {}", code(&binder.name.text), self.range(low, high))),
            _ => None,
        });
        let given = arguments.iter().map(|(name, value)| format!("{} = {}", code(&name.text), self.inline(value)));
        let with: Vec<String> = over.chain(given).collect();
        self.row(UNITS, vec![code(&declared(name, indices)), code(&component.text), with.join(", ")]);
    }

    fn domain(&mut self, d: &Domain) {
        let mut particulars = Vec::new();
        let given = [("stretch", &d.stretch), ("faces", &d.faces), ("areas", &d.areas), ("volumes", &d.volumes)];
        for (what, value) in given.into_iter().filter_map(|(what, value)| Some((what, value.as_ref()?))) {
            particulars.push(format!("{what} {}", self.inline(value)));
        }
        particulars.extend(d.periodic.map(|_| "periodic".to_owned()));
        let name = |ident: &Option<Ident>| ident.as_ref().map(|i| i.text.clone()).unwrap_or_default();
        let row = vec![
            code(&d.name.text),
            self.inline(&d.range.0),
            self.inline(&d.range.1),
            self.inline(&d.cells),
            name(&d.scheme),
            name(&d.geometry),
            particulars.join(", "),
            prose(d.text.as_deref().unwrap_or("")),
        ];
        self.row(DOMAINS, row);
    }

    /// Values over time in one line.
    fn time_table(&mut self, table: &TimeTable) {
        let unit = self.unit(Some(&table.time_unit));
        let word = match table.kind {
            TimeTableKind::Until => "until",
            TimeTableKind::From => "from",
            TimeTableKind::Linear => "at",
            TimeTableKind::Cubic => "cubic, at",
        };
        let list = |list: &[Expr]| list.iter().map(|e| self.inline(e)).collect::<Vec<_>>().join(", ");
        let entries = match &table.points {
            TablePoints::Entries(entries) => {
                entries.iter().map(|(at, value)| format!("{}: {}", self.inline(at), self.inline(value))).collect::<Vec<_>>().join(", ")
            }
            TablePoints::Grid { columns, rows } => {
                let rows: Vec<String> = rows.iter().map(|(first, cells)| format!("{}: {}", self.inline(first), list(cells))).collect();
                format!("columns ({}) {}; {}", self.unit(table.second_unit.as_ref()), list(columns), rows.join("; "))
            }
            TablePoints::File { path, .. } => format!("the points of {}", code(path)),
        };
        let outside = table.outside.as_ref().map(|word| format!("; {} outside", word.text)).unwrap_or_default();
        let text = prose(table.text.as_deref().unwrap_or(""));
        let values = format!("{word} ({unit}) {entries}{outside}");
        self.row(TIME_TABLES, vec![code(&table.name.text), self.unit(table.unit.as_ref()), values, text]);
    }

    fn table(&mut self, table: &Table) {
        let over: Vec<&str> = table.indices.iter().map(|i| i.text.as_str()).collect();
        let names: Vec<String> = table.columns.iter().map(|c| code(&format!("{}[{}]", c.name.text, over.join(", ")))).collect();
        let default = table.default.as_ref().map(|e| format!(", {} by default", self.inline(e))).unwrap_or_default();
        let text = table.text.as_ref().map(|text| format!(": {}", prose(text))).unwrap_or_default();
        self.block(&format!("Table{} {}{text}{default}.", if names.len() > 1 { "s" } else { "" }, names.join(", ")));
        let first = over.first().map(|name| code(name)).unwrap_or_default();
        let mut heading: Vec<String> = vec![first];
        if table.indices.len() > 1 {
            heading.push("entries".to_owned());
        } else {
            heading.extend(table.columns.iter().map(|column| match self.unit(column.unit.as_ref()) {
                unit if unit.is_empty() => code(&column.name.text),
                unit => format!("{} ({unit})", code(&column.name.text)),
            }));
        }
        let rows: Vec<Vec<String>> = table.rows.iter().map(|row| self.table_row(row, table.indices.len() > 1)).collect();
        let heading: Vec<&str> = heading.iter().map(String::as_str).collect();
        self.block(&markdown::table(&heading, &rows));
    }

    fn table_row(&self, row: &TableRow, joined: bool) -> Vec<String> {
        let cells: Vec<String> = match &row.cells {
            TableCells::Values(values) => values.iter().map(|value| self.inline(value)).collect(),
            TableCells::Sparse(entries) => {
                entries.iter().map(|(member, value)| format!("{} = {}", code(&member.text), self.inline(value))).collect()
            }
        };
        let label = code(&row.label.text);
        if joined { vec![label, cells.join(", ")] } else { std::iter::once(label).chain(cells).collect() }
    }
}

/// The data that a disturbance follows.
fn followed(measured: &Measured) -> String {
    let kind = match measured.kind {
        TimeTableKind::Until => "until each point",
        TimeTableKind::From => "steps",
        TimeTableKind::Linear => "linear",
        TimeTableKind::Cubic => "cubic",
    };
    let outside = measured.outside.as_ref().map(|word| format!(", {} outside", word.text)).unwrap_or_default();
    format!("data of {}, {kind}{outside}", code(&measured.path))
}
