//! Rules of the grammar as a reader would name them.

use super::Rule;

pub(super) const EXPRESSION: &str = "an expression";
pub(super) const OPERATOR: &str = "an operator";
pub(super) const END: &str = "the end of the statement";
pub(super) const BRACKETS: &str = "a unit in brackets";

/// A rule as a reader would name it; empty where naming it would only distract.
pub(super) fn describe(rule: Rule) -> &'static str {
    match rule {
        Rule::expr | Rule::number | Rule::paren | Rule::prefix | Rule::if_expr | Rule::derivative | Rule::region => EXPRESSION,
        Rule::infix => OPERATOR,
        Rule::index | Rule::member | Rule::as_unit | Rule::kw_as | Rule::arguments | Rule::unit_operator | Rule::unit_power => "",
        Rule::name | Rule::place => "a name",
        Rule::option => "an option",
        Rule::integer | Rule::signed => "a number",
        Rule::text => "a text in quotes",
        Rule::equals | Rule::value => "`=`",
        Rule::tilde | Rule::sample => "`~`",
        Rule::colon => "`:`",
        Rule::declared_unit => "`: unit`",
        Rule::dots => "`..`",
        Rule::arrow => "`->`",
        Rule::bar => "`|`",
        Rule::open | Rule::set_names => "`{`",
        Rule::close => "`}`",
        Rule::unit | Rule::unit_symbol | Rule::unit_group | Rule::unit_of => "a unit",
        Rule::unit_brackets => BRACKETS,
        Rule::kw_at => "`at`",
        Rule::kw_bounds => "`bounds`",
        Rule::kw_columns => "`columns:`",
        Rule::kw_event => "`event`",
        Rule::kw_if => "`if`",
        Rule::kw_then => "`then`",
        Rule::kw_else => "`else`",
        Rule::kw_in | Rule::bounds => "`in`",
        Rule::kw_for | Rule::for_clause | Rule::reduction | Rule::phase_for | Rule::observation_for => "`for`",
        Rule::kw_over => "`over`",
        Rule::kw_rate => "`rate`",
        Rule::kw_scale | Rule::scale => "`scale`",
        Rule::kw_clip | Rule::clip => "`clip`",
        Rule::kw_when => "`when`",
        Rule::kw_until | Rule::phase_until => "`until`",
        Rule::phase_then => "`then`",
        Rule::kw_default | Rule::table_default => "`default`",
        Rule::kw_every | Rule::every => "`every`",
        Rule::kw_delay | Rule::delay => "`delay`",
        Rule::kw_noise | Rule::noise => "`noise`",
        Rule::kw_nonnegative => "`nonnegative`",
        Rule::kw_named | Rule::named => "`named`",
        Rule::time_kind => "a word such as `until`",
        Rule::indices => "an index list",
        Rule::table_sets => "names of sets in brackets, as `[species]`",
        Rule::parameters => "a parameter list",
        Rule::instance_arguments | Rule::structural => "`(`",
        Rule::binder | Rule::set_binder => "an index",
        Rule::binder_tuple => "a list in parentheses",
        Rule::declaration => "a declaration",
        Rule::argument | Rule::place_entry | Rule::steady_entry | Rule::structural_parameter => "`name = value`",
        Rule::row | Rule::sparse_cell => "a row of the table",
        Rule::time_entry => "`time: value`",
        Rule::column => "a column",
        Rule::domain_clause | Rule::domain_word | Rule::domain_choice => "`cells`, `scheme` or another clause",
        Rule::flux_end | Rule::flux_side => "`low =` or `high =`",
        Rule::observation | Rule::observed_name => "what is observed",
        Rule::observation_clause => "a clause such as `in low..high`",
        Rule::instance => "the name of an instance",
        Rule::EOI => END,
        _ => "",
    }
}
