//! The registry of diagnostic codes: identifier and one line of explanation, in one table.
//!
//! `E01xx` text and syntax, `E02xx` names, `E03xx` units, `E04xx` shapes and indices, `E05xx`
//! structure of the equations, `E06xx` the control problem, `E07xx` scenarios and data. Warnings
//! begin with `W`. An identifier, once released, keeps its meaning.

use std::fmt;

use serde::{Serialize, Serializer};

/// A stable identifier such as `E0201-unknown-name`, with its explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Code {
    id: &'static str,
    explanation: &'static str,
}

impl Code {
    /// A code outside the registry, for tools that build on this crate.
    #[must_use]
    pub const fn new(id: &'static str, explanation: &'static str) -> Self {
        Self { id, explanation }
    }

    /// The identifier.
    #[must_use]
    pub const fn id(self) -> &'static str {
        self.id
    }

    /// Meaning of the code, in one line.
    #[must_use]
    pub const fn explanation(self) -> &'static str {
        self.explanation
    }

    /// The code with this identifier; the number alone (`E0201`) is enough.
    #[must_use]
    pub fn find(id: &str) -> Option<Self> {
        let matches = |code: &&Code| code.id.eq_ignore_ascii_case(id) || code.number().eq_ignore_ascii_case(id);
        ALL.iter().find(matches).copied()
    }

    fn number(self) -> &'static str {
        self.id.split('-').next().unwrap_or(self.id)
    }
}

impl fmt::Display for Code {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.id)
    }
}

impl Serialize for Code {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id)
    }
}

macro_rules! registry {
    ($($name:ident $id:literal $explanation:literal)*) => {
        $(#[doc = $explanation] pub const $name: Code = Code::new($id, $explanation);)*
        /// Every code, in the order of the identifiers.
        pub const ALL: &[Code] = &[$($name),*];
    };
}

registry! {
    UNCLOSED_BRACKET "E0101-unclosed-bracket" "a bracket or block is opened and never closed, or closed by one of another kind"
    UNMATCHED_CLOSING "E0102-unmatched-closing" "a closing bracket has no opening one"
    UNCLOSED_TEXT "E0103-unclosed-text" "a text in double quotes must end on the line where it begins"
    UNEXPECTED_CHARACTER "E0104-unexpected-character" "a character that the language does not use, outside comments and texts"
    TOO_LARGE "E0105-too-large" "a file, a nesting or an expression is beyond what a model can reasonably need"
    SYNTAX "E0106-syntax" "the statement is not formed as its kind demands"
    UNKNOWN_STATEMENT "E0107-unknown-statement" "unknown statement keyword"
    RESERVED_WORD "E0108-reserved-word" "`if then else and or not for in as true false` cannot be names"
    CHAINED_COMPARISON "E0109-chained-comparison" "comparisons do not chain: write `a < b and b < c`"
    DUPLICATE_CLAUSE "E0110-duplicate-clause" "a clause of a statement may be given once"
    MISSING_CLAUSE "E0111-missing-clause" "a clause that the statement needs is missing"
    BAD_NUMBER "E0112-bad-number" "a number that cannot be represented"
    BAD_BINDER "E0113-bad-binder" "an index runs over a set, a range `low..high` or a list `(a, b)`"
    MISPLACED_BLOCK "E0114-misplaced-block" "this kind of statement has no block, or lacks the one that it must have"
    MORE_FAULTS "E0115-more-faults" "more faults than are worth reading at once: the last entry of a list says how many follow"
    UNKNOWN_NAME "E0201-unknown-name" "a name that is declared nowhere"
    DUPLICATE_NAME "E0202-duplicate-name" "two declarations of one name"
    UNKNOWN_IMPORT "E0203-unknown-import" "an imported file that does not exist or may not be read"
    WRONG_KIND "E0204-wrong-kind" "a name that stands for another kind of thing than the place needs"
    CYCLIC_DEFINITION "E0205-cyclic-definition" "definitions that need each other"
    WRONG_ARGUMENTS "E0206-wrong-arguments" "a function or component called with arguments that it does not take"
    UNKNOWN_UNIT "E0301-unknown-unit" "a unit symbol that is not in the table of units"
    UNIT_MISMATCH "E0302-unit-mismatch" "two quantities of different dimensions meet where one dimension is needed"
    AFFINE_UNIT "E0303-affine-unit" "a point on a temperature scale is used as a quantity; `kelvin(T)` gives the absolute temperature"
    NOT_DIMENSIONLESS "E0304-not-dimensionless" "an argument that must be dimensionless has a unit"
    UNIT_OVERFLOW "E0305-unit-overflow" "an exponent or factor of a unit beyond what can be represented"
    WRONG_SHAPE "E0401-wrong-shape" "a quantity has other indices than the place needs"
    OUT_OF_RANGE "E0402-out-of-range" "an index outside its set or domain"
    EMPTY_SET "E0403-empty-set" "a set or domain without members"
    UNDERDETERMINED "E0501-underdetermined" "unknowns that no equation determines"
    OVERDETERMINED "E0502-overdetermined" "more equations than unknowns"
    HIGH_INDEX "E0503-high-index" "the equations have an index above 1"
    MISSING_DEFAULT "E0504-missing-default" "a value that must be known is not given"
    UNREACHABLE_PHASE "E0601-unreachable-phase" "a phase that no other phase leads to"
    MISPLACED_FUNCTION "E0602-misplaced-function" "a function that has no meaning in this place"
    BAD_SETTING "E0603-bad-setting" "an entry that `episode` or `solver` does not know, or with a value that it cannot take"
    BACK_END "E0604-back-end" "the equations are right, but no machine code could be made for them"
    NOT_NONNEGATIVE "E0605-not-nonnegative" "`nonnegative` belongs to states that start at zero or above, in a unit without an offset"
    BAD_TEST "E0606-bad-test" "a test that expects nothing, or with a statement that its run cannot follow"
    UNBALANCED_REACTION "E0607-unbalanced-reaction" "a reaction that consumes more or less of an element than it produces, by the formulas of its species"
    UNREADABLE "E0700-unreadable" "a file that cannot be read"
    BAD_SCENARIO "E0701-bad-scenario" "a scenario with a key, name or value that the model does not know"
    BAD_DATA "E0702-bad-data" "missing columns or non-numeric cells in a data file"
    HIDDEN_BUILT_IN "W0201-hidden-built-in" "a declaration takes the place of a built-in name such as `n` or `e`"
    UNUSED_PARAMETER "W0202-unused-parameter" "a parameter that is never used"
    BARE_NUMBER "W0301-bare-number" "a number without a unit next to a percentage or an angle in degrees, or one of these rounded as a number"
    MAGIC_NUMBER "W0302-magic-number" "a constant of nature as a bare number in an expression"
    ONE_SIDED_LIMIT "W0601-one-sided-limit" "a reward that limits a change over a step on one side only"
    START_OUTSIDE_BOUNDS "W0602-start-outside-bounds" "a state whose initial value exceeds its declared bounds"
    INCOMPLETE_STEADY "W0603-incomplete-steady" "a `steady` block that leaves actions at their nominal values without saying so"
    NO_EPISODE "W0604-no-episode" "a model without an `episode` block: sampling interval and time limit are defaults"
    IDLE_EVENT "W0605-idle-event" "an event at which nothing happens"
    UNREACHABLE_EVENT "W0606-unreachable-event" "an event whose threshold is outside of the declared bounds of the variable that it compares"
    MISSING_SCALE "W0607-missing-scale" "a state far from the scale by which its absolute tolerance is chosen"
    OPEN_BOUNDS "W0608-open-bounds" "an observation that is bounded on one side only"
    NO_BOX "W0609-unbounded-observation" "an observation without bounds: learners need a finite box"
    UNBALANCED_MASS "W0610-unbalanced-mass" "a reaction that does not keep the mass, by the molar masses of its species"
    REPLACED_START "W0611-replaced-start" "a condition at the start that replaces the declared value of a state that it does not name"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_unique_and_sorted() {
        assert!(ALL.windows(2).all(|pair| pair[0].number() < pair[1].number()));
    }

    #[test]
    fn a_code_is_found_by_its_number_in_any_case() {
        assert_eq!(Code::find("e0301"), Some(UNKNOWN_UNIT));
        assert_eq!(Code::find("E0301-unknown-unit"), Some(UNKNOWN_UNIT));
        assert_eq!(Code::find("E9999"), None);
    }
}
