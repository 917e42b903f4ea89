//! Connections of ports.
//!
//! Ports without flows are connected one after another: every member of `b` in `connect a -> b`
//! equals that of `a`. Ports with flows form nodes, however many are connected: members are equal
//! there, and flows, positive into the component, sum to zero. Of each equation of a node the
//! compiler takes that unknown as defined which nothing else defines, so that explicit networks
//! stay explicit.

use std::collections::BTreeMap;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, Expr};

use crate::elaborate::equation::{Equation, EquationForm};
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::lower::ranges::SHORTEST;
use crate::elaborate::lower::{Lowering, indices, nests, paths};
use crate::elaborate::symbols::{Axis, Port, ScopeId, SymbolId, SymbolKind};
use crate::ir::{Affine, ExprId, FastMap, FastSet, Flavour, LoopVar, VarId};

/// Ports that are connected by statements of one scope.
#[derive(Debug)]
struct Together {
    /// Scope of the statements.
    scope: ScopeId,
    /// The ports.
    ports: Vec<ScopeId>,
    /// The first statement.
    span: Span,
}

/// Nodes of ports with flows.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    list: Vec<Together>,
    /// Node of a port, by the scope of the statements.
    known: FastMap<(ScopeId, ScopeId), usize>,
}

/// Equations of a node over one member: the variable of each port.
struct Member {
    /// Symbols with their ports; for a flow with its sign.
    parts: Vec<(SymbolId, ScopeId, f64)>,
    is_flow: bool,
    span: Span,
}

/// `connect a[k] -> b[k] for k in 1..3 if k != 2`: one connection for each value of the indices.
pub(super) fn connections(
    l: &mut Lowering<'_, '_>,
    scope: ScopeId,
    (chain, binders): (&[Expr], &[Binder]),
    span: Span,
    (out, nodes): (&mut Vec<Equation>, &mut Nodes),
) {
    let pieces = nests::nest(l, binders, &Place::new(scope, Site::Dynamics), &mut |s, inner| {
        let mut found = Vec::new();
        if inner.depth > 0 {
            let message = "connections go over sets and ranges of numbers, not over the cells of a domain";
            s.ledger.report(Diagnostic::error(codes::WRONG_KIND, message, span));
        } else {
            connect(s, inner, (chain, span), &mut found, nodes);
        }
        found
    });
    out.extend(pieces.into_iter().flat_map(|piece| piece.value));
}

/// `connect a -> b`
fn connect(l: &mut Lowering<'_, '_>, place: &Place, (chain, span): (&[Expr], Span), out: &mut Vec<Equation>, nodes: &mut Nodes) {
    for pair in chain.windows(2) {
        let (Some(from), Some(to)) = (paths::scope_of(l, &pair[0], place), paths::scope_of(l, &pair[1], place)) else { continue };
        if from == to {
            let message = format!("`{}` is connected to itself", l.symbols.scopes[from].prefix.trim_end_matches('.'));
            let fault = Diagnostic::error(codes::CYCLIC_DEFINITION, message, pair[1].span);
            l.ledger.report(fault.help("connect it to another port, or leave the connection out"));
            continue;
        }
        let members = |s: &Lowering<'_, '_>, scope: ScopeId| -> BTreeMap<String, SymbolId> {
            s.symbols.scopes[scope].names.iter().map(|(n, &id)| (n.clone(), id)).collect()
        };
        let (sources, targets) = (members(l, from), members(l, to));
        let flows = [from, to].map(|scope| flows_of(l, scope));
        if sources.keys().ne(targets.keys()) || flows[0] != flows[1] {
            let fault = different_connectors(l, [from, to], span);
            l.ledger.report(fault);
            continue;
        }
        if !flows[0].is_empty() {
            nodes.add(place.scope, [from, to], span);
            continue;
        }
        for (name, source) in sources {
            if let Some(&target) = targets.get(&name) {
                join(l, [source, target], [from, to], span, out);
            }
        }
    }
}

fn port_at<'s>(l: &'s Lowering<'_, '_>, scope: ScopeId) -> Option<&'s Port> {
    // Ports are declared in the order of their scopes.
    let at = l.symbols.ports.binary_search_by_key(&scope, |port| port.scope).ok()?;
    l.symbols.ports.get(at)
}

/// Names of the flows of a port.
fn flows_of(l: &Lowering<'_, '_>, scope: ScopeId) -> Vec<String> {
    let names = &l.symbols.scopes[scope].names;
    let flows = port_at(l, scope).map(|port| port.flows.as_slice()).unwrap_or_default();
    let mut found: Vec<String> = names.iter().filter(|(_, symbol)| flows.contains(symbol)).map(|(name, _)| name.clone()).collect();
    found.sort_unstable();
    found
}

impl Nodes {
    /// Puts two ports into one node.
    fn add(&mut self, scope: ScopeId, ports: [ScopeId; 2], span: Span) {
        let [a, b] = ports.map(|port| self.node_of(scope, port, span));
        if a == b {
            return;
        }
        let (into, from) = if self.list[a].ports.len() < self.list[b].ports.len() { (b, a) } else { (a, b) };
        let moved = std::mem::take(&mut self.list[from].ports);
        self.known.extend(moved.iter().map(|&port| ((scope, port), into)));
        self.list[into].ports.extend(moved);
    }

    /// The node of a port, a new one if it has none.
    fn node_of(&mut self, scope: ScopeId, port: ScopeId, span: Span) -> usize {
        *self.known.entry((scope, port)).or_insert_with(|| {
            self.list.push(Together { scope, ports: vec![port], span });
            self.list.len() - 1
        })
    }

    /// Equations of all nodes.
    pub(super) fn close(self, l: &mut Lowering<'_, '_>, out: &mut Vec<Equation>) {
        if self.list.is_empty() {
            return;
        }
        let definitions = out.iter().filter_map(|equation| match equation.form {
            EquationForm::Definition { var, .. } => Some(var),
            _ => None,
        });
        let mut defined: FastSet<VarId> = definitions.collect();
        let (mut waiting, mut flows): (Vec<Member>, Vec<Member>) =
            self.list.iter().filter(|node| !node.ports.is_empty()).flat_map(|node| node.members(l)).partition(|member| !member.is_flow);
        loop {
            let before = waiting.len() + flows.len();
            waiting.retain(|member| {
                let first = member.first_defined(l, &defined);
                if let Some(first) = first {
                    member.equal(l, first, &mut defined, out);
                }
                first.is_none()
            });
            flows.retain(|member| {
                let [(symbol, ..)] = member.undefined(l, &defined)[..] else { return true };
                member.balance(l, Some(symbol), &mut defined, out);
                false
            });
            if waiting.len() + flows.len() < before {
                continue;
            }
            // Nothing defines the members of a node: another equation determines the first one.
            if waiting.is_empty() {
                break;
            }
            waiting.remove(0).equal(l, 0, &mut defined, out);
        }
        flows.iter().for_each(|member| member.balance(l, None, &mut defined, out));
    }
}

impl Together {
    /// The members of the node. Flows of a port of the component around go out of the node.
    fn members(&self, l: &Lowering<'_, '_>) -> Vec<Member> {
        let Some(first) = port_at(l, self.ports[0]) else { return Vec::new() };
        let root = ScopeId::from_u32(0);
        let sign = |port: ScopeId| if l.symbols.scopes[port].parent == Some(self.scope) && self.scope != root { -1.0 } else { 1.0 };
        let part = |port: ScopeId, symbol: SymbolId| {
            let name = l.symbols[symbol].path.rsplit('.').next().unwrap_or_default();
            l.symbols.scopes[port].names.get(name).map(|&own| (own, port, sign(port)))
        };
        let member = |&symbol: &SymbolId| Member {
            parts: self.ports.iter().filter_map(|&port| part(port, symbol)).collect(),
            is_flow: first.flows.contains(&symbol),
            span: self.span,
        };
        first.members.iter().map(member).collect()
    }
}

/// The variable of a symbol.
fn variable(l: &Lowering<'_, '_>, symbol: SymbolId) -> Option<VarId> {
    match l.symbols[symbol].kind {
        SymbolKind::Variable { var, .. } => Some(var),
        _ => None,
    }
}

impl Member {
    fn first_defined(&self, l: &Lowering<'_, '_>, defined: &FastSet<VarId>) -> Option<usize> {
        self.parts.iter().position(|(symbol, ..)| variable(l, *symbol).is_some_and(|var| defined.contains(&var)))
    }

    fn undefined(&self, l: &Lowering<'_, '_>, defined: &FastSet<VarId>) -> Vec<(SymbolId, ScopeId, f64)> {
        self.parts.iter().filter(|(symbol, ..)| variable(l, *symbol).is_some_and(|var| !defined.contains(&var))).copied().collect()
    }

    /// All others equal one of them.
    fn equal(&self, l: &mut Lowering<'_, '_>, first: usize, defined: &mut FastSet<VarId>, out: &mut Vec<Equation>) {
        let (source, from, _) = self.parts[first];
        for &(target, to, _) in self.parts.iter().filter(|part| part.0 != source) {
            join(l, [source, target], [from, to], self.span, out);
            defined.extend(variable(l, target));
        }
    }

    /// The sum is zero; one of the flows is defined by it, if any.
    fn balance(&self, l: &mut Lowering<'_, '_>, own: Option<SymbolId>, defined: &mut FastSet<VarId>, out: &mut Vec<Equation>) {
        let (first, port, _) = self.parts[0];
        if self.parts[1..].iter().any(|&(symbol, other, _)| !fits(l, [first, symbol], [port, other], self.span)) {
            return;
        }
        let Some((addresses, sets)) = addresses(l, first) else { return };
        for (extents, at) in addresses {
            let runs = u8::from(sets && !extents.is_empty());
            let form = match own.and_then(|own| self.parts.iter().find(|part| part.0 == own)) {
                Some(&(symbol, _, sign)) => {
                    let (Some(var), Some(rest)) = (variable(l, symbol), self.sum(l, at, (symbol, -sign), Some(symbol))) else { return };
                    EquationForm::Definition { var, at, value: rest }
                }
                None => {
                    let Some(residual) = self.sum(l, at, (first, 1.0), None) else { return };
                    EquationForm::Implicit { residual }
                }
            };
            out.push(Equation { extents, runs, repeats: None, form, span: self.span });
        }
        defined.extend(own.and_then(|own| variable(l, own)));
    }

    /// The sum of the flows except one, each with its sign times `factor`, in a symbol's unit.
    fn sum(&self, l: &mut Lowering<'_, '_>, at: Affine, (unit_of, factor): (SymbolId, f64), without: Option<SymbolId>) -> Option<ExprId> {
        let SymbolKind::Variable { unit: wanted, .. } = l.symbols[unit_of].kind.clone() else { return None };
        let mut sum = None;
        for &(symbol, _, sign) in self.parts.iter().filter(|part| Some(part.0) != without) {
            let SymbolKind::Variable { var, unit, .. } = l.symbols[symbol].kind.clone() else { return None };
            let load = l.exprs.load(var, Flavour::Value, at);
            let term = l.values().convert(load, &unit, &wanted)?;
            let positive = sign * factor > 0.0;
            sum = Some(match (sum, positive) {
                (None, true) => term,
                (None, false) => l.exprs.neg(term),
                (Some(sum), true) => l.exprs.add(sum, term),
                (Some(sum), false) => l.exprs.sub(sum, term),
            });
        }
        Some(sum.unwrap_or_else(|| l.exprs.constant(0.0)))
    }
}

/// The fault of a connection of two ports that do not fit, with the connectors of both.
fn different_connectors(l: &Lowering<'_, '_>, ports: [ScopeId; 2], span: Span) -> Diagnostic {
    let known = ports.map(|scope| {
        let path = l.symbols.scopes[scope].prefix.trim_end_matches('.').to_owned();
        let port = port_at(l, scope);
        (path, port.map(|port| port.connector.as_str()))
    });
    let [(a, Some(first)), (b, Some(second))] = &known else {
        return Diagnostic::error(codes::WRONG_SHAPE, "two ports of different connectors are connected", span);
    };
    let message = format!("ports of different connectors are connected: `{a}` is a `{first}`, `{b}` a `{second}`");
    let mut fault = Diagnostic::error(codes::WRONG_SHAPE, message, span);
    for connector in [first, second] {
        if let Some(declared) = l.instances.connectors.get(connector) {
            fault = fault.secondary(declared.span, format!("`{connector}`"));
        }
    }
    fault.help("give both ports the same connector")
}

/// Makes a member of one port equal to that of another.
fn join(l: &mut Lowering<'_, '_>, [source, target]: [SymbolId; 2], ports: [ScopeId; 2], span: Span, out: &mut Vec<Equation>) {
    if !fits(l, [source, target], ports, span) {
        return;
    }
    let (SymbolKind::Variable { var: from, unit, .. }, SymbolKind::Variable { var: to, unit: wanted, .. }) =
        (l.symbols[source].kind.clone(), l.symbols[target].kind.clone())
    else {
        return;
    };
    let Some((addresses, sets)) = addresses(l, target) else { return };
    for (extents, at) in addresses {
        let runs = u8::from(sets && !extents.is_empty());
        let load = l.exprs.load(from, Flavour::Value, at);
        let Some(value) = l.values().convert(load, &unit, &wanted) else { continue };
        let form = EquationForm::Definition { var: to, at, value };
        out.push(Equation { extents, runs, repeats: None, form, span });
    }
}

/// An address, with the lengths of the loops that it runs in.
type Looped = (Vec<u32>, Affine);

/// Elements of a member, in loops if they are many or cells; and whether they run over sets.
fn addresses(l: &Lowering<'_, '_>, symbol: SymbolId) -> Option<(Vec<Looped>, bool)> {
    let SymbolKind::Variable { var, axes, .. } = &l.symbols[symbol].kind else { return None };
    let len = i64::from(l.symbols.vars[*var].len);
    let sets = axes.iter().all(|a| matches!(a, Axis::Set(_)));
    let list = if sets && len < SHORTEST {
        (0..len).map(|i| (Vec::new(), Affine::constant(i))).collect()
    } else {
        vec![(vec![len as u32], Affine::along(0, LoopVar(0), 1))]
    };
    Some((list, sets))
}

/// Returns `true` if two members have the same elements; reports what differs.
fn fits(l: &mut Lowering<'_, '_>, [source, target]: [SymbolId; 2], [from_port, to_port]: [ScopeId; 2], span: Span) -> bool {
    let (SymbolKind::Variable { var: from, axes: source_axes, .. }, SymbolKind::Variable { var: to, axes, .. }) =
        (l.symbols[source].kind.clone(), l.symbols[target].kind.clone())
    else {
        l.ledger.report(Diagnostic::error(codes::WRONG_KIND, "only ports are connected", span));
        return false;
    };
    if l.symbols.vars[from].len != l.symbols.vars[to].len || source_axes.len() != axes.len() {
        let fault = different_connectors(l, [from_port, to_port], span);
        let (a, b) = (&l.symbols[source].path, &l.symbols[target].path);
        let (m, n) = (l.symbols.vars[from].len, l.symbols.vars[to].len);
        l.ledger.report(fault.note(format!("`{a}` and `{b}` have different sizes: {m} and {n}")));
        return false;
    }
    let elsewhere = source_axes.iter().zip(axes.iter()).any(|pair| match pair {
        (Axis::Domain(a), Axis::Domain(b)) => !indices::same_cells(l, *a, *b),
        (a, b) => matches!(a, Axis::Domain(_)) || matches!(b, Axis::Domain(_)),
    });
    if elsewhere {
        let (a, b) = (&l.symbols[source].path, &l.symbols[target].path);
        let message = format!("the cells of `{a}` and `{b}` lie elsewhere");
        let help =
            "declare both domains with as many cells between the same ends, written with the same numbers and parameters of the file";
        l.ledger.report(Diagnostic::error(codes::WRONG_SHAPE, message, span).help(help));
        return false;
    }
    true
}
