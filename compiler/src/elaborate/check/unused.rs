//! Unused declarations, whose faults are reported although they have no effect yet.
//!
//! Named expressions and fluxes are worked out at their own indices. A function is elaborated with
//! arguments that fit everywhere, a component as one instance whose parameters without values have
//! sample values. Faults that depend on sample values are not reported.

use smpl_dsl::diagnostic::{Code, Diagnostic, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind, Ident, Statement, StatementKind};

use crate::elaborate::episode::check_level;
use crate::elaborate::ledger::Ledger;
use crate::elaborate::lower::place::{Bound, Place, Site};
use crate::elaborate::lower::{Lowering, binders, definitions, nests, units};
use crate::elaborate::select::items::{Item, items};
use crate::elaborate::space::flux;
use crate::elaborate::symbols::{ScopeId, SymbolId, SymbolKind};
use crate::ir::FastSet;

/// Faults that depend on values and places, which a sample does not have.
const OF_VALUES: &[Code] = &[
    codes::TOO_LARGE,
    codes::UNIT_OVERFLOW,
    codes::OUT_OF_RANGE,
    codes::EMPTY_SET,
    codes::UNDERDETERMINED,
    codes::MISSING_DEFAULT,
    codes::UNREACHABLE_PHASE,
    codes::BAD_SETTING,
    codes::BAD_SCENARIO,
];

/// Checks what nothing asked for.
pub(in crate::elaborate) fn check_unused(l: &mut Lowering<'_, '_>) {
    let hidden = l.hidden.len();
    check_unused_symbols(l, is_expression);
    // Nothing of the rest stays: the numbers of expressions, and with them the code, are those of
    // what is used.
    let used = l.exprs.clone();
    [is_random, is_flux, is_function].into_iter().for_each(|kind| check_unused_symbols(l, kind));
    check_unused_levels(l);
    check_connectors(l);
    *l.exprs = used;
    l.hidden.truncate(hidden);
}

fn check_unused_symbols(l: &mut Lowering<'_, '_>, wanted: fn(&SymbolKind) -> bool) {
    let mut seen = FastSet::default();
    let symbols: Vec<SymbolId> = l.symbols.list.keys().filter(|s| !l.expansions.is_used(*s)).collect();
    for symbol in symbols {
        let (kind, span) = (l.symbols[symbol].kind.clone(), l.symbols[symbol].span);
        // One instance of a component is as good as another.
        if wanted(&kind) && (is_expression(&kind) || seen.insert(span)) && !l.expansions.is_used(symbol) {
            check_symbol(l, symbol, kind, span);
        }
    }
}

fn check_symbol<'a>(l: &mut Lowering<'_, 'a>, symbol: SymbolId, kind: SymbolKind<'a>, span: Span) {
    let scope = l.symbols[symbol].scope;
    match kind {
        SymbolKind::Let { declaration, .. } => {
            let place = Place::new(scope, Site::Instant);
            let index: Vec<Expr> = declaration.indices.iter().map(index_of).collect();
            nests::nest(l, &declaration.indices, &place, &mut |s, inner| s.symbol_value(symbol, &index, declaration.span, inner));
        }
        SymbolKind::Flux { flux, .. } => {
            let place = Place::new(scope, Site::Dynamics);
            let base = Box::new(Expr { span, kind: ExprKind::Name(flux.name.clone()) });
            let element = Expr { span, kind: ExprKind::Index(base, flux.indices.iter().map(index_of).collect()) };
            nests::nest(l, &flux.indices, &place, &mut |s, inner| flux::divergence(s, span, &element, inner));
        }
        SymbolKind::Def { parameters, locals, body } => {
            let mut place = Place::new(scope, Site::Instant);
            for parameter in parameters {
                let sets = definitions::generic_sets(l, &parameter.kind, scope);
                for name in std::iter::once(&parameter.name).chain(sets) {
                    place = place.bind(&name.text, Bound::Value(l.poison()));
                }
            }
            l.expansions.enter(symbol);
            let before = l.ledger.reports.diagnostics.len();
            let place = definitions::with_locals(l, locals, place);
            l.value(body, &place);
            l.expansions.leave();
            // Where it is called from decides which functions have a meaning.
            l.ledger.reports.diagnostics.retain_after(before, |d| d.code != codes::MISPLACED_FUNCTION && !OF_VALUES.contains(&d.code));
        }
        _ => {}
    }
}

/// Observations of levels that are not chosen; what is odd about them matters when they are.
fn check_unused_levels(l: &mut Lowering<'_, '_>) {
    let before = l.ledger.reports.diagnostics.len();
    for (scope, items_of) in &l.instances.blocks {
        for item in items_of {
            let Item::Other(Statement { kind: StatementKind::Level { name, body, .. }, .. }) = item else { continue };
            if l.input.options.observation.as_ref() == Some(&name.text) {
                continue;
            }
            check_level(l, *scope, items(body, &l.input.selection));
        }
    }
    l.ledger.reports.diagnostics.retain_after(before, |d| d.is_error());
}

/// Units and sets of connectors; a domain, or a set that a component is given, is found where the
/// component has the port.
fn check_connectors(l: &mut Lowering<'_, '_>) {
    let place = Place::new(ScopeId::from_u32(0), Site::Dynamics);
    let mut connectors: Vec<&Statement> = l.instances.connectors.values().copied().collect();
    connectors.sort_by_key(|s| (s.span.file, s.span.start));
    for statement in connectors {
        let StatementKind::Connector { name, members, .. } = &statement.kind else { continue };
        for member in members {
            for binder in &member.indices {
                if !is_of_component(l, name, binder) && binders::index_over(l, binder, &place).is_none() {
                    break;
                }
            }
            member.unit.iter().for_each(|u| {
                units::unit(l, u, &place);
            });
        }
    }
}

/// Returns `true` if a component with a port of the connector declares what an index of it runs
/// over.
fn is_of_component(l: &Lowering<'_, '_>, connector: &Ident, binder: &Binder) -> bool {
    let over = match &binder.over {
        BinderSet::Itself => &binder.name,
        BinderSet::Set(set) => set,
        BinderSet::Range(..) | BinderSet::Tuple(_) => return false,
    };
    l.instances.components.values().any(|component| {
        let bodies = with_bases(l, component);
        let declares = |s: &Statement| match &s.kind {
            StatementKind::Domain(domain) => domain.name.text == over.text,
            StatementKind::Set { name, .. } => name.text == over.text,
            _ => false,
        };
        let has_port = |s: &Statement| matches!(&s.kind, StatementKind::Port { connector: of, .. } if of.text == connector.text);
        let any = |is_so: &dyn Fn(&Statement) -> bool| bodies.iter().any(|(_, body)| anywhere(body, is_so));
        any(&has_port) && (bodies.iter().any(|(parameters, _)| parameters.iter().any(|(p, _)| p.text == over.text)) || any(&declares))
    })
}

/// Structural parameters and body of a component.
type ComponentBody<'a> = (&'a [(Ident, Option<Expr>)], &'a [Statement]);

/// A component and those that it extends.
fn with_bases<'a>(l: &Lowering<'_, 'a>, component: &'a Statement) -> Vec<ComponentBody<'a>> {
    const DEEPEST: usize = 32;
    let (mut out, mut at) = (Vec::new(), Some(component));
    while let Some(Statement { kind: StatementKind::Component { parameters, extends, body, .. }, .. }) = at.filter(|_| out.len() < DEEPEST)
    {
        out.push((parameters.as_slice(), body.as_slice()));
        at = extends.as_ref().and_then(|base| l.instances.components.get(base.text.as_str()).copied());
    }
    out
}

/// Returns `true` if a statement of a component is so, in whatever choice.
fn anywhere(body: &[Statement], is_so: &dyn Fn(&Statement) -> bool) -> bool {
    body.iter().any(|s| match &s.kind {
        StatementKind::When { body, .. } | StatementKind::Variant { body, .. } => anywhere(body, is_so),
        _ => is_so(s),
    })
}

/// Components of which there is no instance, in the order of the text; a sample has none.
pub(in crate::elaborate) fn components<'a>(l: &Lowering<'_, 'a>) -> Vec<&'a Statement> {
    if l.instances.samples.taken() {
        return Vec::new();
    }
    let is_unused = |s: &&Statement| matches!(&s.kind, StatementKind::Component { name, .. } if !l.instances.used.contains(&*name.text));
    let mut unused: Vec<&'a Statement> = l.instances.components.values().copied().filter(is_unused).collect();
    unused.sort_by_key(|s| (s.span.file, s.span.start));
    unused
}

/// Of the reports on samples of components, the faults inside them that do not depend on values.
pub(in crate::elaborate) fn of_components(ledger: &Ledger, components: &[&Statement]) -> Vec<Diagnostic> {
    let inside = |span: Span| components.iter().any(|s| s.span.contains(span));
    let of_component = |d: &&Diagnostic| inside(d.primary.span) || d.secondary.iter().any(|label| inside(label.span));
    ledger.reports.diagnostics.iter().filter(of_component).filter(|d| !OF_VALUES.contains(&d.code)).cloned().collect()
}

fn is_expression(kind: &SymbolKind) -> bool {
    matches!(kind, SymbolKind::Let { random: false, .. })
}

fn is_random(kind: &SymbolKind) -> bool {
    matches!(kind, SymbolKind::Let { random: true, .. })
}

fn is_flux(kind: &SymbolKind) -> bool {
    matches!(kind, SymbolKind::Flux { .. })
}

fn is_function(kind: &SymbolKind) -> bool {
    matches!(kind, SymbolKind::Def { .. })
}

fn index_of(binder: &Binder) -> Expr {
    Expr { span: binder.span, kind: ExprKind::Name(binder.name.clone()) }
}
