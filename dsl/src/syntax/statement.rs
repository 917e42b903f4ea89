//! Parts that statements have in common: names, blocks, expressions. Each function lists every kind
//! of statement, so that the compiler asks for a new one.

use super::{
    Binder, Clip, Declaration, Domain, Expect, Expr, Flux, Ident, Observation, Parameter, ParameterKind, Phase, Reaction, SetMembers,
    Statement, StatementKind, Table, TableCells, TablePoints, TestStep, TimeTable,
};

impl StatementKind {
    /// The names that the statement declares; those in its block are declared by the statements
    /// there.
    #[must_use]
    pub fn declares(&self) -> Vec<&Ident> {
        match self {
            Self::Model { name, .. }
            | Self::Time { name, .. }
            | Self::Unit { name, .. }
            | Self::Set { name, .. }
            | Self::TimeTable(TimeTable { name, .. })
            | Self::Def { name, .. }
            | Self::Domain(Domain { name, .. })
            | Self::Flux(Flux { name, .. })
            | Self::Connector { name, .. }
            | Self::Component { name, .. }
            | Self::Instance { name, .. }
            | Self::Level { name, .. }
            | Self::Reward { name, .. }
            | Self::Fail { name, .. }
            | Self::Success { name, .. }
            | Self::Constraint { name, .. }
            | Self::Invariant { name, .. }
            | Self::Policy { name, .. }
            | Self::Event { name, .. }
            | Self::Phase(Phase { name, .. })
            | Self::Variant { name, .. }
            | Self::Choice { name, .. } => vec![name],
            Self::Table(table) => table.columns.iter().map(|column| &column.name).collect(),
            Self::Declare { declarations, .. } => declarations.iter().map(|declaration| &declaration.name).collect(),
            Self::Port { names, .. } => names.iter().map(|port| &port.name).collect(),
            Self::Reaction(reaction) => vec![&reaction.declaration.name],
            Self::Observe { items } => items.iter().filter_map(|item| item.name.as_ref()).collect(),
            Self::Import { .. }
            | Self::Equation { .. }
            | Self::Connect { .. }
            | Self::Initial { .. }
            | Self::StartEquation { .. }
            | Self::StartSteady { .. }
            | Self::Steady { .. }
            | Self::Episode { .. }
            | Self::Solver { .. }
            | Self::At { .. }
            | Self::Control(_)
            | Self::Next { .. }
            | Self::Reset { .. }
            | Self::Clamp { .. }
            | Self::Test { .. }
            | Self::TestStep(_)
            | Self::Remove { .. }
            | Self::When { .. } => Vec::new(),
        }
    }

    /// The statements in the block of the statement.
    #[must_use]
    pub fn block(&self) -> &[Statement] {
        match self {
            Self::Component { body, .. }
            | Self::Level { body, .. }
            | Self::At { body, .. }
            | Self::Phase(Phase { body, .. })
            | Self::Test { body, .. }
            | Self::Variant { body, .. }
            | Self::When { body, .. } => body,
            Self::Model { .. }
            | Self::Import { .. }
            | Self::Time { .. }
            | Self::Unit { .. }
            | Self::Set { .. }
            | Self::Table(_)
            | Self::TimeTable(_)
            | Self::Def { .. }
            | Self::Declare { .. }
            | Self::Equation { .. }
            | Self::Domain(_)
            | Self::Flux(_)
            | Self::Reaction(_)
            | Self::Connector { .. }
            | Self::Port { .. }
            | Self::Instance { .. }
            | Self::Connect { .. }
            | Self::Initial { .. }
            | Self::StartEquation { .. }
            | Self::StartSteady { .. }
            | Self::Steady { .. }
            | Self::Observe { .. }
            | Self::Reward { .. }
            | Self::Fail { .. }
            | Self::Success { .. }
            | Self::Constraint { .. }
            | Self::Invariant { .. }
            | Self::Episode { .. }
            | Self::Solver { .. }
            | Self::Policy { .. }
            | Self::Control(_)
            | Self::Next { .. }
            | Self::Reset { .. }
            | Self::Clamp { .. }
            | Self::Event { .. }
            | Self::TestStep(_)
            | Self::Remove { .. }
            | Self::Choice { .. } => &[],
        }
    }

    /// The expressions of the statement, outside of its block, in the order of the text.
    #[must_use]
    pub fn expressions(&self) -> Vec<&Expr> {
        match self {
            Self::Model { .. }
            | Self::Import { .. }
            | Self::Level { .. }
            | Self::Test { .. }
            | Self::Variant { .. }
            | Self::Choice { .. }
            | Self::When { .. } => Vec::new(),
            Self::Time { unit, .. } => unit.children().collect(),
            Self::Unit { size, .. } => size.iter().collect(),
            Self::Set { members: SetMembers::Names(_), .. } => Vec::new(),
            Self::Set { members: SetMembers::Range(low, high), .. } => vec![low, high],
            Self::Set { members: SetMembers::Of(members), .. } => vec![members],
            Self::Table(table) => table.expressions(),
            Self::TimeTable(table) => table.points.expressions(),
            Self::Def { parameters, locals, body, .. } => {
                let indices = parameters.iter().flat_map(Parameter::binders);
                indices.flat_map(Binder::children).chain(locals.iter().map(|local| &local.value)).chain([body]).collect()
            }
            Self::Declare { declarations, .. } | Self::Connector { members: declarations, .. } => {
                declarations.iter().flat_map(Declaration::expressions).collect()
            }
            Self::Equation { lhs, rhs, binders } => [lhs, rhs].into_iter().chain(children(binders)).collect(),
            Self::Domain(domain) => domain.expressions(),
            Self::Flux(Flux { indices, inner, low, high, .. }) => children(indices).chain([inner]).chain(low).chain(high).collect(),
            Self::Reaction(reaction) => reaction.expressions(),
            Self::Component { parameters, .. } => parameters.iter().filter_map(|(_, value)| value.as_ref()).collect(),
            Self::Instance { indices, arguments, .. } => children(indices).chain(arguments.iter().map(|(_, value)| value)).collect(),
            Self::Port { names, .. } => names.iter().flat_map(|port| children(&port.indices)).collect(),
            Self::Connect { chain, binders } => chain.iter().chain(children(binders)).collect(),
            Self::Initial { target, value, clip, binders, .. } => {
                [target, value].into_iter().chain(clip.iter().flat_map(Clip::expressions)).chain(children(binders)).collect()
            }
            Self::StartEquation { lhs, rhs, free, binders } => [lhs, rhs].into_iter().chain(free).chain(children(binders)).collect(),
            Self::StartSteady { targets } => targets.iter().collect(),
            Self::Steady { entries, free } => pairs(entries).chain(free).collect(),
            Self::Observe { items } => items.iter().flat_map(Observation::expressions).collect(),
            Self::Reward { value, .. } => vec![value],
            Self::Fail { condition, .. }
            | Self::Success { condition, .. }
            | Self::Constraint { condition, .. }
            | Self::Event { condition, .. } => vec![condition],
            Self::Invariant { value, rate, .. } => [value].into_iter().chain(rate).collect(),
            Self::Episode { entries } | Self::Solver { entries } => entries.iter().map(|(_, value)| value).collect(),
            Self::Policy { entries, .. } => pairs(entries).collect(),
            Self::At { every, .. } => every.iter().collect(),
            Self::Control(control) => control.expressions().chain(children(&control.binders)).collect(),
            Self::Remove { target, .. } => vec![target],
            Self::Next { target, value, binders } | Self::Reset { target, value, binders } => {
                [target, value].into_iter().chain(children(binders)).collect()
            }
            Self::Clamp { target, value, condition, binders } => [target, value, condition].into_iter().chain(children(binders)).collect(),
            Self::Phase(Phase { duration, until, .. }) => duration.iter().chain(until).collect(),
            Self::TestStep(step) => step.expressions(),
        }
    }
}

fn pairs(entries: &[(Expr, Expr)]) -> impl Iterator<Item = &Expr> {
    entries.iter().flat_map(|(left, right)| [left, right])
}

/// The expressions that binders run over.
fn children(binders: &[Binder]) -> impl Iterator<Item = &Expr> {
    binders.iter().flat_map(Binder::children)
}

impl Parameter {
    fn binders(&self) -> &[Binder] {
        match &self.kind {
            ParameterKind::Array(binders) => binders,
            ParameterKind::Value | ParameterKind::Index(_) => &[],
        }
    }
}

impl Clip {
    fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let range = match self {
            Clip::Bounds(_) => None,
            Clip::Range(low, high) => Some([low, high]),
        };
        range.into_iter().flatten()
    }
}

impl Declaration {
    fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let bounds = self.bounds.iter().flat_map(|(low, high)| [low, high]);
        let clip = self.clip.iter().flat_map(Clip::expressions);
        children(&self.indices).chain(&self.value).chain(&self.sample).chain(clip).chain(bounds).chain(&self.scale)
    }
}

impl Reaction {
    fn expressions(&self) -> Vec<&Expr> {
        self.terms.iter().filter_map(|term| term.coefficient.as_ref()).chain(self.declaration.expressions()).collect()
    }
}

impl Observation {
    fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let bounds = self.bounds.iter().flat_map(|(low, high)| [low, high]);
        [&self.value].into_iter().chain(children(&self.binders)).chain(bounds).chain(&self.noise).chain(&self.every).chain(&self.delay)
    }
}

impl Domain {
    fn expressions(&self) -> Vec<&Expr> {
        let Domain { range: (low, high), cells, stretch, faces, volumes, areas, .. } = self;
        [low, high, cells].into_iter().chain(stretch).chain(faces).chain(volumes).chain(areas).collect()
    }
}

impl Table {
    fn expressions(&self) -> Vec<&Expr> {
        let cells = self.rows.iter().flat_map(|row| match &row.cells {
            TableCells::Values(values) => values.iter().collect::<Vec<_>>(),
            TableCells::Sparse(values) => values.iter().map(|(_, value)| value).collect(),
        });
        self.default.iter().chain(cells).collect()
    }
}

impl TablePoints {
    fn expressions(&self) -> Vec<&Expr> {
        match self {
            TablePoints::Entries(entries) => pairs(entries).collect(),
            TablePoints::Grid { columns, rows } => {
                columns.iter().chain(rows.iter().flat_map(|(at, values)| [at].into_iter().chain(values))).collect()
            }
            TablePoints::File { .. } => Vec::new(),
        }
    }
}

impl TestStep {
    fn expressions(&self) -> Vec<&Expr> {
        match self {
            TestStep::Start(_) | TestStep::Choose { .. } | TestStep::Policy(_) => Vec::new(),
            TestStep::Assign { target, value } => vec![target, value],
            TestStep::Steps(value) | TestStep::For(value) => vec![value],
            TestStep::Expect(Expect::Holds(condition)) => vec![condition],
            TestStep::Expect(Expect::Within { value, tolerance, target }) => vec![value, tolerance, target],
            TestStep::Expect(Expect::Steady(tolerance)) => tolerance.iter().collect(),
            TestStep::Expect(Expect::Failure(_) | Expect::Success(_)) => Vec::new(),
        }
    }
}
