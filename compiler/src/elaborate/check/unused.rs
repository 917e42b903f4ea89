//! What nothing asked for: a fault is one even where it has no effect yet.
//!
//! Named expressions and fluxes are worked out at their own indices. A function is worked out with arguments that fit everywhere, a component
//! as one instance whose parameters without values have sample values; of these, faults that depend on the values are not told.

use smpl_dsl::diagnostic::{Code, codes};
use smpl_dsl::span::Span;
use smpl_dsl::syntax::{Binder, BinderSet, Expr, ExprKind, Ident, Statement, StatementKind};

use crate::elaborate::declare::symbols::{ScopeId, SymbolId, SymbolKind, Symbols};
use crate::elaborate::select::items::{Item, items};
use crate::elaborate::{Bound, Elaborator, Options, Place, Site};
use crate::ir::FastSet;

/// Value of a parameter without one in a sample: many numbers divide it, and ranges up to it stay loops.
pub(in crate::elaborate) const SAMPLE: f64 = 60.0;
/// Most instances in the samples of a model.
const MAX_SAMPLES: u32 = 500;
/// Deepest nest of components in a sample.
const MAX_SAMPLE_DEPTH: usize = 4;

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

/// Components that stand for themselves.
#[derive(Debug, Default)]
pub(in crate::elaborate) struct Samples {
    /// Whether this elaboration is one of samples, and how many instances it has.
    instances: Option<u32>,
}

impl Samples {
    /// Whether what is elaborated is a sample.
    pub(in crate::elaborate) fn taken(&self) -> bool {
        self.instances.is_some()
    }

    /// Counts an instance; `false` where a sample has enough of them.
    pub(in crate::elaborate) fn may_instantiate(&mut self, depth: usize) -> bool {
        self.instances.as_mut().is_none_or(|n| {
            *n += 1;
            *n <= MAX_SAMPLES && depth < MAX_SAMPLE_DEPTH
        })
    }
}

impl<'a> Elaborator<'a> {
    /// Checks what nothing asked for.
    pub(in crate::elaborate) fn check_unused(&mut self) {
        let hidden = self.hidden.len();
        self.check_unused_symbols(is_expression);
        // Nothing of the rest stays: the numbers of expressions, and with them the code, are those of what is used.
        let used = self.exprs.clone();
        [is_random, is_flux, is_function].into_iter().for_each(|kind| self.check_unused_symbols(kind));
        self.check_unused_levels();
        self.check_connectors();
        self.exprs = used;
        self.hidden.truncate(hidden);
        if !self.instances.samples.taken() {
            self.check_unused_components();
        }
    }

    fn check_unused_symbols(&mut self, wanted: fn(&SymbolKind) -> bool) {
        let mut seen = FastSet::default();
        let symbols: Vec<SymbolId> = self.symbols.list.keys().filter(|s| !self.expansions.is_used(*s)).collect();
        for symbol in symbols {
            let (kind, span) = (self.symbols[symbol].kind.clone(), self.symbols[symbol].span);
            // One instance of a component is as good as another.
            if wanted(&kind) && (is_expression(&kind) || seen.insert(span)) && !self.expansions.is_used(symbol) {
                self.check_symbol(symbol, kind, span);
            }
        }
    }

    fn check_symbol(&mut self, symbol: SymbolId, kind: SymbolKind<'a>, span: Span) {
        let scope = self.symbols[symbol].scope;
        match kind {
            SymbolKind::Let { declaration, .. } => {
                let place = Place::new(scope, Site::Instant);
                let index: Vec<Expr> = declaration.indices.iter().map(index_of).collect();
                self.nest(&declaration.indices, &place, &mut |s, inner| s.symbol_value(symbol, &index, declaration.span, inner));
            }
            SymbolKind::Flux { flux, .. } => {
                let place = Place::new(scope, Site::Dynamics);
                let base = Box::new(Expr { span, kind: ExprKind::Name(flux.name.clone()) });
                let element = Expr { span, kind: ExprKind::Index(base, flux.indices.iter().map(index_of).collect()) };
                self.nest(&flux.indices, &place, &mut |s, inner| s.divergence(span, &element, inner));
            }
            SymbolKind::Def { parameters, body } => {
                let mut place = Place::new(scope, Site::Instant);
                for parameter in parameters {
                    place = place.bind(&parameter.text, Bound::Value(self.poison()));
                }
                self.expansions.enter(symbol);
                let before = self.ledger.reports.diagnostics.len();
                self.value(body, &place);
                self.expansions.leave();
                // Where it is called from decides which functions have a meaning.
                self.ledger
                    .reports
                    .diagnostics
                    .retain_after(before, |d| d.code != codes::MISPLACED_FUNCTION && !OF_VALUES.contains(&d.code));
            }
            _ => {}
        }
    }

    /// Observations of levels that are not chosen; what is odd about them matters when they are.
    fn check_unused_levels(&mut self) {
        let before = self.ledger.reports.diagnostics.len();
        for (scope, items_of) in self.instances.blocks.clone() {
            for item in items_of {
                let Item::Other(Statement { kind: StatementKind::Level { name, body, .. }, .. }) = item else { continue };
                if self.input.options.observation.as_ref() == Some(&name.text) {
                    continue;
                }
                self.check_level(scope, items(body, &self.input.selection));
            }
        }
        self.ledger.reports.diagnostics.retain_after(before, |d| d.is_error());
    }

    /// Units and sets of connectors.
    fn check_connectors(&mut self) {
        let place = Place::new(ScopeId::from_u32(0), Site::Dynamics);
        let mut connectors: Vec<&Statement> = self.instances.connectors.values().copied().collect();
        connectors.sort_by_key(|s| (s.span.file, s.span.start));
        for statement in connectors {
            let StatementKind::Connector { members, .. } = &statement.kind else { continue };
            for member in members {
                self.axes(&member.indices, &place);
                member.unit.iter().for_each(|u| {
                    self.unit(u, &place);
                });
            }
        }
    }

    /// Components of which there is no instance, elaborated apart, beside what the file declares.
    fn check_unused_components(&mut self) {
        let unused =
            |s: &&Statement| matches!(&s.kind, StatementKind::Component { name, .. } if !self.instances.used.contains(&*name.text));
        let mut unused: Vec<&'a Statement> = self.instances.components.values().copied().filter(unused).collect();
        if unused.is_empty() {
            return;
        }
        unused.sort_by_key(|s| (s.span.file, s.span.start));
        let options = Options::default();
        let mut sample = Elaborator::new(self.input.files, self.input.imports, &options);
        sample.input.selection = self.input.selection.clone();
        sample.instances.samples.instances = Some(0);
        sample.declare_samples(&unused);
        sample.declare_defaults();
        sample.check_ends();
        sample.ledger.speculation.enabled = true;
        sample.elaborate_equations();
        sample.elaborate_control();
        sample.check_unused();
        sample.ledger.reports.name_calls();
        let inside = |span: Span| unused.iter().any(|s| s.span.contains(span));
        for d in &sample.ledger.reports.diagnostics {
            let of_component = inside(d.primary.span) || d.secondary.iter().any(|l| inside(l.span));
            if of_component && !OF_VALUES.contains(&d.code) {
                self.ledger.report(d.clone());
            }
        }
    }

    /// Declares what components see of the file, and one instance of each.
    fn declare_samples(&mut self, components: &[&'a Statement]) {
        let root = self.declare_seen();
        let place = Place::new(root, Site::Dynamics);
        for statement in components {
            let StatementKind::Component { name, .. } = &statement.kind else { continue };
            self.instantiate(statement, &name.text, name.span, &[], &place, 0);
        }
    }
}

impl<'a> Symbols<'a> {
    /// Kind of a structural parameter in a sample: a set where something runs over it, else a number.
    pub(in crate::elaborate) fn sampled(&self, scope: ScopeId, name: &Ident, body: &[Statement]) -> SymbolKind<'a> {
        if !body.iter().any(|s| runs_over(s, &name.text)) {
            return SymbolKind::Integer(SAMPLE as i64);
        }
        // The set that it stands for mostly has its name.
        match self.lookup(scope, &name.text).map(|s| self[s].kind.clone()) {
            Some(kind @ SymbolKind::Set(_)) => kind,
            _ => SymbolKind::Faulty,
        }
    }
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

/// Whether an index of a statement runs over a name.
fn runs_over(statement: &Statement, name: &str) -> bool {
    let any = |binders: &[Binder]| {
        binders.iter().any(|b| match &b.over {
            BinderSet::Itself => b.name.text == name,
            BinderSet::Set(set) => set.text == name,
            BinderSet::Range(..) | BinderSet::Tuple(_) => false,
        })
    };
    let inside = |e: &Expr| {
        let mut found = false;
        e.walk(&mut |e| found |= matches!(&e.kind, ExprKind::Reduce { binders, .. } if any(binders)));
        found
    };
    match &statement.kind {
        StatementKind::Declare { declarations, .. } => declarations.iter().any(|d| any(&d.indices) || d.value.iter().any(inside)),
        StatementKind::Flux(flux) => any(&flux.indices) || inside(&flux.inner),
        StatementKind::Table(table) => table.indices.iter().any(|set| set.text == name),
        StatementKind::Equation { lhs, rhs, binders } => any(binders) || inside(lhs) || inside(rhs),
        StatementKind::Instance { indices, .. } => any(indices),
        StatementKind::When { body, .. } | StatementKind::Variant { body, .. } => body.iter().any(|s| runs_over(s, name)),
        _ => false,
    }
}
