//! The statements of a block as single items, with the active variants and choices worked in.
//!
//! A statement in an active `variant` or `when` block replaces the items with the same key and is added where there is none.

use std::collections::HashMap;
use std::fmt::Write;

use smpl_dsl::syntax::{BinderSet, Declaration, Expr, ExprKind, Ident, Observation, Role, Statement, StatementKind};

/// A statement, with declarations, observations and contents of `at` blocks taken one by one.
#[derive(Clone, Copy, Debug)]
pub enum Item<'a> {
    /// One declaration.
    Declare(Role, &'a Declaration),
    /// One observation.
    Observe(&'a Observation),
    /// One statement of an `at` block.
    At(&'a Ident, &'a Statement),
    /// Any other statement.
    Other(&'a Statement),
}

/// Which variants are on and which options are chosen.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Option of each choice, `true` for a variant that is on.
    pub chosen: HashMap<String, String>,
}

impl Selection {
    fn holds(&self, name: &str, option: &str) -> bool {
        self.chosen.get(name).is_some_and(|o| o == option)
    }
}

/// The items of a block under a selection.
pub fn items<'a>(statements: &'a [Statement], selection: &Selection) -> Vec<Item<'a>> {
    let mut base = plain(statements);
    for body in selected(statements, selection) {
        overlay(&mut base, items(body, selection));
    }
    base
}

/// The items of a block without its variants and choices.
pub fn plain(statements: &[Statement]) -> Vec<Item<'_>> {
    let mut base = Vec::new();
    for statement in statements {
        push(statement, &mut base);
    }
    base
}

/// The bodies of the active variants and choices of a block.
pub fn selected<'a>(statements: &'a [Statement], selection: &Selection) -> impl Iterator<Item = &'a [Statement]> {
    statements.iter().filter_map(|statement| match &statement.kind {
        StatementKind::Variant { name, body, .. } if selection.holds(&name.text, "true") => Some(body.as_slice()),
        StatementKind::When { choice, option, body } if selection.holds(&choice.text, &option.text) => Some(body.as_slice()),
        _ => None,
    })
}

fn push<'a>(statement: &'a Statement, out: &mut Vec<Item<'a>>) {
    match &statement.kind {
        StatementKind::Declare { role, declarations } => {
            out.extend(declarations.iter().map(|d| Item::Declare(*role, d)));
        }
        StatementKind::Observe { items } => out.extend(items.iter().map(Item::Observe)),
        StatementKind::At { instant, body } => out.extend(body.iter().map(|s| Item::At(instant, s))),
        _ => out.push(Item::Other(statement)),
    }
}

/// Works overriding items into those of a block.
pub fn overlay<'a>(base: &mut Vec<Item<'a>>, over: Vec<Item<'a>>) {
    let keys: Vec<Option<String>> = over.iter().map(key).collect();
    let mut placed = vec![false; over.len()];
    let mut result = Vec::with_capacity(base.len() + over.len());
    for item in base.drain(..) {
        let own = key(&item);
        match own.as_ref().and_then(|k| keys.iter().position(|o| o.as_ref() == Some(k))) {
            Some(at) => {
                // All overriding items of one key stand where the first overridden one stood.
                for (i, k) in keys.iter().enumerate() {
                    if *k == keys[at] && !placed[i] {
                        placed[i] = true;
                        result.push(over[i]);
                    }
                }
            }
            None => result.push(item),
        }
    }
    result.extend(over.iter().zip(&placed).filter(|(_, p)| !**p).map(|(i, _)| *i));
    *base = result;
}

fn key(item: &Item) -> Option<String> {
    Some(match item {
        Item::Declare(_, d) => format!("name {}", d.name.text),
        Item::Observe(o) => match &o.name {
            Some(name) => format!("observe {}", name.text),
            None => format!("observe {}", text(&o.value)),
        },
        Item::At(Ident { text: instant, .. }, s) => match &s.kind {
            StatementKind::Next { target, .. } => format!("at {instant} next {}", text(target)),
            StatementKind::Reset { target, .. } => format!("at {instant} reset {}", text(target)),
            StatementKind::Clamp { target, .. } => format!("at {instant} clamp {}", text(target)),
            _ => return None,
        },
        Item::Other(s) => match &s.kind {
            StatementKind::Equation { lhs, .. } => format!("eq {}", text(lhs)),
            StatementKind::Initial { target, .. } => format!("initial {}", text(target)),
            StatementKind::Fail { name, .. } => format!("fail {}", name.text),
            StatementKind::Success { name, .. } => format!("success {}", name.text),
            StatementKind::Constraint { name, .. } => format!("constraint {}", name.text),
            StatementKind::Reward { name, .. } => format!("reward {}", name.text),
            StatementKind::Policy { name, .. } => format!("policy {}", name.text),
            StatementKind::Invariant { name, .. } => format!("invariant {}", name.text),
            StatementKind::Level { name, .. } => format!("level {}", name.text),
            StatementKind::Event { name, .. } => format!("event {}", name.text),
            StatementKind::Phase(phase) => format!("phase {}", phase.name.text),
            StatementKind::Flux(flux) => format!("name {}", flux.name.text),
            StatementKind::Domain(domain) => format!("name {}", domain.name.text),
            StatementKind::Set { name, .. } | StatementKind::Def { name, .. } | StatementKind::Instance { name, .. } => {
                format!("name {}", name.text)
            }
            StatementKind::TimeTable(table) => format!("name {}", table.name.text),
            StatementKind::Table(table) => format!("table {}", table.columns.first()?.name.text),
            StatementKind::Time { .. } => "time".to_owned(),
            StatementKind::Connect { chain } => format!("connect {}", chain.iter().map(text).collect::<Vec<_>>().join("->")),
            _ => return None,
        },
    })
}

/// A short canonical text of an expression: equal texts mean equal expressions.
pub fn text(e: &Expr) -> String {
    let mut out = String::new();
    write_expr(e, &mut out);
    out
}

fn write_list(list: &[Expr], out: &mut String) {
    for (i, e) in list.iter().enumerate() {
        if i > 0 {
            out.push(',');
        }
        write_expr(e, out);
    }
}

fn write_expr(e: &Expr, out: &mut String) {
    match &e.kind {
        ExprKind::Number { value, .. } => {
            let _ = write!(out, "{value}");
        }
        ExprKind::Bool(b) => {
            let _ = write!(out, "{b}");
        }
        ExprKind::Name(n) => out.push_str(&n.text),
        ExprKind::Member(a, n) => {
            write_expr(a, out);
            out.push('.');
            out.push_str(&n.text);
        }
        ExprKind::Index(a, list) => {
            write_expr(a, out);
            out.push('[');
            write_list(list, out);
            out.push(']');
        }
        ExprKind::Call { function, arguments } => {
            out.push_str(&function.text);
            out.push('(');
            write_list(arguments, out);
            out.push(')');
        }
        ExprKind::Reduce { function, body, binders, .. } => {
            out.push_str(&function.text);
            out.push('(');
            write_expr(body, out);
            for b in binders {
                let _ = write!(out, " for {}", b.name.text);
                if let BinderSet::Set(s) = &b.over {
                    let _ = write!(out, " in {}", s.text);
                }
            }
            out.push(')');
        }
        ExprKind::Derivative(a) => {
            out.push_str("der(");
            write_expr(a, out);
            out.push(')');
        }
        ExprKind::Unary(op, a) => {
            let _ = write!(out, "{op:?}(");
            write_expr(a, out);
            out.push(')');
        }
        ExprKind::Binary(op, a, b) => {
            let _ = write!(out, "{op:?}(");
            write_expr(a, out);
            out.push(',');
            write_expr(b, out);
            out.push(')');
        }
        ExprKind::If(c, a, b) => {
            out.push_str("if(");
            write_expr(c, out);
            out.push(',');
            write_expr(a, out);
            out.push(',');
            write_expr(b, out);
            out.push(')');
        }
        ExprKind::As(a, _) => write_expr(a, out),
        ExprKind::Tuple(list) => {
            out.push('(');
            write_list(list, out);
            out.push(')');
        }
    }
}
