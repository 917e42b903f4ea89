//! Reactions: their set, their rates, source terms and stoichiometric coefficients.

use std::rc::Rc;

use smpl_dsl::diagnostic::{Diagnostic, codes};
use smpl_dsl::syntax::{Binder, BinderSet, Ident, Reaction, ReactionTerm, Statement, StatementKind};

use crate::elaborate::declare::declaring::Declaring;
use crate::elaborate::lower::place::{Place, Site};
use crate::elaborate::select::items::Item;
use crate::elaborate::symbols::{Axis, DomainId, OneReaction, Reactions, ScopeId, SetId, SymbolId, SymbolKind};

/// Names that reactions declare.
const MADE: [&str; 3] = ["reactions", "source", "stoichiometry"];

/// A reaction at members of the sets of its indices, and its label.
struct Listed<'a> {
    reaction: &'a Reaction,
    bound: Vec<(&'a str, SetId, usize)>,
    label: String,
}

/// The reactions of a block.
fn reactions<'a>(list: &[Item<'a>]) -> impl Iterator<Item = &'a Reaction> {
    list.iter().filter_map(|item| match item {
        Item::Other(Statement { kind: StatementKind::Reaction(reaction), .. }) => Some(reaction),
        _ => None,
    })
}

impl<'a> Declaring<'_, 'a> {
    /// Declares the set of the reactions of a block.
    pub(in crate::elaborate::declare) fn declare_reaction_names(&mut self, scope: ScopeId, list: &[Item<'a>]) {
        let Some(first) = reactions(list).next() else { return };
        let names: Vec<&Ident> = reactions(list).map(|reaction| &reaction.declaration.name).collect();
        self.work.ledger.check_members("reactions", names);
        let labels = self.listed(scope, list).into_iter().map(|one| one.label).collect();
        let name = Ident { text: MADE[0].to_owned(), span: first.declaration.name.span };
        self.new_set(scope, &name, labels, None);
    }

    /// Declares rates, source terms and stoichiometric coefficients of the reactions of a block.
    pub(in crate::elaborate::declare) fn declare_reactions(&mut self, scope: ScopeId, list: &[Item<'a>]) {
        let Some(first) = reactions(list).next() else { return };
        let place = Place::new(scope, Site::Dynamics);
        let mut domains: Vec<DomainId> = Vec::new();
        let mut rates: Vec<Option<SymbolId>> = Vec::new();
        for reaction in reactions(list) {
            let d = &reaction.declaration;
            if !reaction.rated && self.symbols.lookup(scope, "rate").is_none() {
                self.without_rate(scope, reaction);
                rates.push(None);
                continue;
            }
            let rate = match (self.axes(&d.indices, &place), &d.value) {
                (Some((axes, names)), Some(definition)) => {
                    for axis in &axes {
                        if let Axis::Domain(domain) = axis
                            && !domains.contains(domain)
                        {
                            domains.push(*domain);
                        }
                    }
                    let (axes, binders) = (axes.into(), names.into());
                    let kind = SymbolKind::Let { axes, binders, unit: None, definition, random: false, declaration: d };
                    self.declare(scope, &d.name, kind)
                }
                _ => {
                    self.faulty(scope, &d.name);
                    None
                }
            };
            rates.push(rate);
        }
        let made = self.made(scope, list, &rates, domains);
        for (name, kind) in MADE[1..].iter().zip([SymbolKind::Source, SymbolKind::Stoichiometry]) {
            let name = Ident { text: (*name).to_owned(), span: first.declaration.name.span };
            self.declare(scope, &name, made.clone().map_or(SymbolKind::Faulty, kind));
        }
    }

    /// Reports a reaction that neither states its rate nor takes it from an array of rates.
    fn without_rate(&mut self, scope: ScopeId, reaction: &Reaction) {
        let name = &reaction.declaration.name;
        let consumed = reaction.terms.iter().find(|term| term.consumed).map_or("c", |term| &term.species.text);
        let fault = Diagnostic::error(codes::MISSING_CLAUSE, format!("the reaction `{}` has no rate", name.text), name.span);
        let help = format!("add `rate k*c[{consumed}]`, or declare `var rate[reactions]` with an equation for each reaction");
        self.work.ledger.report(fault.help(help));
        self.faulty(scope, name);
    }

    /// The reactions of a block with their species; `None` after a report.
    fn made(&mut self, scope: ScopeId, list: &[Item<'a>], rates: &[Option<SymbolId>], domains: Vec<DomainId>) -> Option<Rc<Reactions<'a>>> {
        let names = match self.symbols.lookup(scope, MADE[0]).map(|symbol| &self.symbols[symbol].kind) {
            Some(SymbolKind::Set(set)) => *set,
            _ => return None,
        };
        let rate_of = |one: &Reaction| reactions(list).position(|other| std::ptr::eq(one, other)).and_then(|at| rates[at]);
        let listed = self.listed(scope, list);
        let mut of = Vec::with_capacity(listed.len());
        for Listed { reaction, bound, .. } in listed {
            of.push(OneReaction { rate: rate_of(reaction)?, reaction, bound });
        }
        let species = self.species_of(scope, &of)?;
        Some(Rc::new(Reactions { species, names, domains, list: of }))
    }

    /// The reactions at each member of the sets of their indices.
    fn listed(&mut self, scope: ScopeId, list: &[Item<'a>]) -> Vec<Listed<'a>> {
        let mut out = Vec::new();
        for reaction in reactions(list) {
            let name = &reaction.declaration.name.text;
            let mut rows: Vec<Vec<(&'a str, SetId, usize)>> = vec![Vec::new()];
            for binder in &reaction.declaration.indices {
                let Some(set) = self.set_of(scope, binder) else { continue };
                let count = self.symbols.sets[set].labels.len();
                let members: Vec<_> = (0..count).map(|i| (binder.name.text.as_str(), set, i)).collect();
                rows = rows.iter().flat_map(|row| members.iter().map(move |one| [row.as_slice(), &[*one]].concat())).collect();
            }
            for bound in rows {
                let labels: Vec<&str> = bound.iter().map(|(_, set, i)| self.symbols.sets[*set].labels[*i].as_str()).collect();
                let label = if labels.is_empty() { name.clone() } else { format!("{name}[{}]", labels.join(",")) };
                out.push(Listed { reaction, bound, label });
            }
        }
        out
    }

    /// The set that an index of a reaction runs over; `None` for a domain, which is declared later.
    fn set_of(&mut self, scope: ScopeId, binder: &'a Binder) -> Option<SetId> {
        let name = match &binder.over {
            BinderSet::Itself => &binder.name,
            BinderSet::Set(set) => set,
            BinderSet::Range(..) => {
                let place = Place::new(scope, Site::Dynamics);
                return match self.axes(std::slice::from_ref(binder), &place)?.0.as_slice() {
                    [Axis::Set(set)] => Some(*set),
                    _ => None,
                };
            }
            BinderSet::Tuple(_) => return None,
        };
        match self.symbols.lookup(scope, &name.text).map(|symbol| &self.symbols[symbol].kind) {
            Some(SymbolKind::Set(set)) => Some(*set),
            _ => None,
        }
    }

    /// The largest set in sight that has all species of reactions.
    fn species_of(&mut self, scope: ScopeId, list: &[OneReaction<'a>]) -> Option<SetId> {
        let mut sets = Vec::new();
        let mut at = Some(scope);
        while let Some(id) = at {
            let mut own: Vec<SymbolId> = self.symbols.scopes[id].names.values().copied().collect();
            own.sort_unstable();
            sets.extend(own.into_iter().filter_map(|symbol| match self.symbols[symbol].kind {
                SymbolKind::Set(set) if self.symbols.sets[set].first.is_none() => Some(set),
                _ => None,
            }));
            at = self.symbols.scopes[id].parent;
        }
        let terms = |one: &OneReaction<'a>| -> Vec<(String, &'a ReactionTerm)> {
            one.reaction.terms.iter().map(|term| (self.symbols.species_label(one, term).to_owned(), term)).collect()
        };
        let all: Vec<(String, &ReactionTerm)> = list.iter().flat_map(terms).collect();
        let lacks = |set: &SetId| all.iter().filter(|(label, _)| self.symbols.sets[*set].position(label).is_none()).count();
        // Of equally good ones the first.
        let best = sets.iter().copied().min_by_key(|set| (lacks(set), usize::MAX - self.symbols.sets[*set].labels.len()));
        let best = best.filter(|set| lacks(set) < all.len());
        let missing = all.iter().find(|(label, _)| best.is_none_or(|set| self.symbols.sets[set].position(label).is_none()));
        let Some((label, term)) = missing else { return best };
        let span = term.species.span;
        let fault =
            match best {
                Some(set) => {
                    let set = &self.symbols.sets[set];
                    let help = self.work.ledger.reports.did_you_mean(label, set.labels.iter().map(String::as_str));
                    let message = format!("the species `{label}` is not a member of `{}`", set.name);
                    Diagnostic::error(codes::UNKNOWN_NAME, message, span).help(help.unwrap_or_else(|| {
                        format!("add it to the set: all species of the reactions are in one set, such as `{}`", set.name)
                    }))
                }
                None => Diagnostic::error(codes::UNKNOWN_NAME, format!("the species `{label}` is not a member of a set"), span)
                    .help("declare the species: `set species = { S, O2, X }`"),
            };
        self.work.ledger.report(fault);
        None
    }

    /// Formulas of the members of a set.
    pub(in crate::elaborate::declare) fn declare_formulas(&mut self, set: SetId, formulas: &[(Ident, Ident)]) {
        for (member, text) in formulas {
            match (crate::elaborate::formula::read(&text.text), self.symbols.sets[set].position(&member.text)) {
                (Some(formula), Some(at)) => {
                    self.symbols.formulas.insert((set, at), formula);
                }
                (Some(_), None) => {}
                (None, _) => {
                    let message = format!("`{}` is not the formula of a species", text.text);
                    let fault = Diagnostic::error(codes::BAD_SETTING, message, text.span);
                    self.work.ledger.report(fault.help("write elements with their numbers, `C6H12O6`, and a charge at the end, `NH4+`"));
                }
            }
        }
    }
}
