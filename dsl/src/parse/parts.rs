//! The parts of a rule as the grammar gives them, and where they are.

use pest::iterators::{Pair, Pairs};

use super::{Fallible, Rule, rules};
use crate::diagnostic::{Diagnostic, codes};
use crate::span::{FileId, Span, span};
use crate::syntax::Ident;
use crate::words::is_reserved;

/// Properties of the present statement for lowering.
pub(super) struct Context<'t> {
    pub(super) file: FileId,
    /// Byte of the file at which the parsed text begins.
    pub(super) offset: usize,
    pub(super) keyword: &'t str,
}

impl Context<'_> {
    pub(super) fn span(&self, pair: &Pair<'_, Rule>) -> Span {
        // A rule that ends in an optional part has taken the blanks before it.
        let at = pair.as_span();
        let end = at.start() + at.as_str().trim_end().len();
        span(self.file, self.offset + at.start(), self.offset + end)
    }

    /// A name; reserved words are refused.
    pub(super) fn ident(&self, pair: &Pair<'_, Rule>) -> Fallible<Ident> {
        let ident = self.word(pair);
        if is_reserved(&ident.text) {
            let message = format!("`{}` is a reserved word and cannot be a name", ident.text);
            let fault = Diagnostic::error(codes::RESERVED_WORD, message, ident.span).label("expected a name or an expression");
            return Err(Box::new(fault));
        }
        Ok(ident)
    }

    /// A word, reserved or not.
    pub(super) fn word(&self, pair: &Pair<'_, Rule>) -> Ident {
        Ident { text: pair.as_str().to_owned(), span: self.span(pair) }
    }

    /// The text between the quotes.
    pub(super) fn text(pair: &Pair<'_, Rule>) -> String {
        pair.as_str().trim_matches('"').to_owned()
    }
}

/// The parts of a rule, taken in their order.
pub(super) struct Children<'t> {
    pub(super) pairs: Pairs<'t, Rule>,
    /// Whole text of the rule, for faults that have no better place.
    pub(super) whole: Option<Pair<'t, Rule>>,
}

impl<'t> Children<'t> {
    pub(super) fn new(pair: Pair<'t, Rule>) -> Self {
        Self { pairs: pair.clone().into_inner(), whole: Some(pair) }
    }

    pub(super) fn of_statement(mut pairs: Pairs<'t, Rule>) -> Self {
        match pairs.next() {
            Some(pair) => Self::new(pair),
            None => Self { pairs, whole: None },
        }
    }

    pub(super) fn peek(&self) -> Option<Rule> {
        self.pairs.peek().map(|pair| pair.as_rule())
    }

    /// The next part if it is of this rule.
    pub(super) fn take(&mut self, rule: Rule) -> Option<Pair<'t, Rule>> {
        if self.peek() == Some(rule) { self.pairs.next() } else { None }
    }

    /// Takes a marker such as `=` and says whether it was there.
    pub(super) fn skip(&mut self, rule: Rule) -> bool {
        self.take(rule).is_some()
    }

    /// The next part, which the grammar demands to be of this rule.
    pub(super) fn expect(&mut self, context: &Context<'_>, rule: Rule) -> Fallible<Pair<'t, Rule>> {
        self.take(rule).ok_or_else(|| self.mismatch(context, rule))
    }

    fn mismatch(&self, context: &Context<'_>, rule: Rule) -> Box<Diagnostic> {
        let place = self.whole.as_ref().map_or_else(|| span(context.file, context.offset, context.offset), |pair| context.span(pair));
        let message = format!("expected {} in `{}`", rules::describe(rule), context.keyword);
        Box::new(Diagnostic::error(codes::SYNTAX, message, place))
    }

    pub(super) fn name(&mut self, context: &Context<'_>) -> Fallible<Ident> {
        context.ident(&self.expect(context, Rule::name)?)
    }

    pub(super) fn text(&mut self) -> Option<String> {
        self.take(Rule::text).map(|pair| Context::text(&pair))
    }
}
