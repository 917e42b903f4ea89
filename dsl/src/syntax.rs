//! The syntax tree of an `.eq` file: what was written, nothing resolved, every node with its span.
//!
//! A file is a list of [`Statement`]s. Order carries no meaning. Declarations share one shape,
//! [`Declaration`]; equations and expressions keep units where they were written. Names are not
//! looked up here: `c[i, z]` is a [`ExprKind::Index`] whatever `c`, `i` and `z` are.

mod parts;
mod statement;
mod visit;

use serde::{Deserialize, Serialize};

use crate::span::Span;

pub use parts::{Control, Expect, Local, Parameter, ParameterKind, PortName, TestStep};
pub use visit::Form;

/// A name as written, with its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ident {
    /// The text of the name.
    pub text: String,
    /// Place in the text.
    pub span: Span,
}

/// One parsed file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct File {
    /// Statements in the order of the text.
    pub statements: Vec<Statement>,
}

/// One statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statement {
    /// From the first to the last character of the statement.
    pub span: Span,
    /// Content.
    pub kind: StatementKind,
}

/// The kinds of statement, each introduced by its own keyword.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the example of each kind names its fields")]
#[allow(clippy::large_enum_variant, reason = "statements are few and are moved once")]
pub enum StatementKind {
    /// `model Reactor "text"`
    Model { name: Ident, text: Option<String> },
    /// `use "lib/streams.eq"`
    Import { path: String, path_span: Span },
    /// `time t : h`
    Time { name: Ident, unit: UnitExpr },
    /// `unit USD`, a unit with a new dimension; `unit kUSD = 1000 [USD]`
    Unit { name: Ident, size: Option<Expr>, text: Option<String> },
    /// `set species = { tropine, DMF }`, `set species = { S "C6H12O6", O2 "O2" }` or `set class =
    /// 1..9`
    Set { name: Ident, members: SetMembers, formulas: Vec<(Ident, Ident)>, text: Option<String> },
    /// `table M[species] : g/mol = { ... }`, and the form with columns
    Table(Table),
    /// `table Fs_recipe : L/h over time : h until { 3: 8, 12: 15 }`
    TimeTable(TimeTable),
    /// `def arrhenius(k0, E, T) = k0 * exp(-E / T)`, `def f(T) = { let th = T / 2; th^2 }`
    Def { name: Ident, parameters: Vec<Parameter>, locals: Vec<Local>, body: Expr },
    /// `param`, `action`, `state`, `var`, `let`, `discrete`, `disturbance`, `random`
    Declare { role: Role, declarations: Vec<Declaration> },
    /// `eq lhs = rhs for i in species, z`, `eq lhs = rhs for i in s, j in s if i != j`
    Equation { lhs: Expr, rhs: Expr, binders: Vec<Binder> },
    /// `domain z in 0..L cells n_z scheme central`
    Domain(Domain),
    /// `flux J[i in species, z] : unit = expr, low = expr, high = expr`
    Flux(Flux),
    /// `reaction growth: S + 2 O2 -> 1.1 X rate mu*X`
    Reaction(Reaction),
    /// `connector Stream { Q : L/min, c[species] : mol/L }`, `connector Heat { T : K, flow Q : W }`
    Connector { name: Ident, members: Vec<Declaration>, flows: Vec<Ident> },
    /// `component TubularReactor(n_cells = 40) { ... }`, `component B extends A { ... }`
    Component { name: Ident, parameters: Vec<(Ident, Option<Expr>)>, extends: Option<Ident>, text: Option<String>, body: Vec<Statement> },
    /// `port inlet, outlet : Stream`, `port n[j in links] : Heat`
    Port { names: Vec<PortName>, connector: Ident },
    /// `use TubularReactor as R1(V = 2 [mL])`, `use Column as col[k in 1..2](...)`
    Instance { component: Ident, name: Ident, indices: Vec<Binder>, arguments: Vec<(Ident, Expr)> },
    /// `connect M1.outlet -> R1.inlet` (a chain of two or more), `connect s[k].out -> s[k+1].in for
    /// k in 1..9 if k != 4`
    Connect { chain: Vec<Expr>, binders: Vec<Binder> },
    /// `initial c_A ~ uniform(0.7, 1.3) * value(steady(c_A)) clip bounds for x in (...)`
    Initial { target: Expr, random: bool, value: Expr, clip: Option<Clip>, binders: Vec<Binder> },
    /// `initial eq p = 2 [bar] free n`, `initial d/dt T = 0 for z`: a condition at the start
    StartEquation { lhs: Expr, rhs: Expr, free: Vec<Expr>, binders: Vec<Binder> },
    /// `initial steady for (T, c)`: rates that are zero at the start
    StartSteady { targets: Vec<Expr> },
    /// `steady { T_c = 26.85 [degC], h = 0.659 [m], A + B = 1 }`, `steady { p = 8.5 [bar], free Q
    /// }`
    Steady { entries: Vec<(Expr, Expr)>, free: Vec<Expr> },
    /// `observe c_A, T` or `observe pH = -log10(H) in 0..16`
    Observe { items: Vec<Observation> },
    /// `level online "text" { observe ... }`: a named set of observations
    Level { name: Ident, extends: Option<Ident>, text: Option<String>, body: Vec<Statement> },
    /// `reward setpoint : kg default = expr "text"`
    Reward { name: Ident, unit: Option<UnitExpr>, default: bool, value: Expr, text: Option<String> },
    /// `fail state_box when ...`, `fail empty event h <= 0 [m]`
    Fail { name: Ident, event: bool, condition: Expr, text: Option<String> },
    /// `success finished when condition`, `success full event h >= 2 [m]`
    Success { name: Ident, event: bool, condition: Expr, text: Option<String> },
    /// `constraint pool : g/L = expr <= limit`: a cost that ends nothing
    Constraint { name: Ident, condition: Expr, text: Option<String> },
    /// `invariant mass = expr rate expr`
    Invariant { name: Ident, value: Expr, rate: Option<Expr>, text: Option<String> },
    /// `episode { step = 0.1 [min], max_steps = 100, error_reward = -1000 }`
    Episode { entries: Vec<(Ident, Expr)> },
    /// `solver { rtol = 1e-8 }`
    Solver { entries: Vec<(Ident, Expr)> },
    /// `policy nominal { T = 13 [degC] }`: actions of a named open-loop policy
    Policy { name: Ident, entries: Vec<(Expr, Expr)> },
    /// `at start { ... }`, `at end { ... }`, `at swap { ... }`, `at every 3 [s] { ... }`
    At { instant: Ident, every: Option<Expr>, body: Vec<Statement> },
    /// `control u from y setpoint r gain K reset T limits 0..100 every 3 [s]`
    Control(Control),
    /// `next Fb = expr` inside `at`
    Next { target: Expr, value: Expr, binders: Vec<Binder> },
    /// `reset x = expr for z` inside `at`
    Reset { target: Expr, value: Expr, binders: Vec<Binder> },
    /// `clamp DO2 at 1 when DO2 < 2` inside `at`
    Clamp { target: Expr, value: Expr, condition: Expr, binders: Vec<Binder> },
    /// `event breakthrough when c[z.last] >= 0.01 * c_in`
    Event { name: Ident, condition: Expr, text: Option<String> },
    /// `phase elute for 60 [min] then strip`, `phase load until breakthrough then wash { ... }`
    Phase(Phase),
    /// `test "rises" { steps 3; expect x > 1 }`
    Test { name: String, name_span: Span, body: Vec<Statement> },
    /// A statement inside of `test`
    TestStep(TestStep),
    /// `variant vacuole_flux "text" { overriding statements }`
    Variant { name: Ident, extends: Option<Ident>, text: Option<String>, body: Vec<Statement> },
    /// `remove state_box`, `remove eq d/dt T`, `remove at swap`, `remove connect a -> b` (a tuple),
    /// `remove at every 3 [s]` (of the kind `every`): statements that a variant takes out
    Remove { kind: Option<Ident>, target: Expr },
    /// `choice axial_scheme = central | downwind "text"`
    Choice { name: Ident, options: Vec<Ident>, text: Option<String> },
    /// `when axial_scheme = downwind { overriding statements }`
    When { choice: Ident, option: Ident, body: Vec<Statement> },
}

/// Kind of a declared name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Role {
    /// Constant over an episode; may be drawn at reset.
    Param,
    /// Manipulated input, held over a step.
    Action,
    /// Differential state.
    State,
    /// Algebraic variable, defined by equations.
    Var,
    /// Named sub-expression; with a unit it is an output of the model.
    Let,
    /// Updated at sampling instants only.
    Discrete,
    /// Exogenous sequence, one value a step.
    Disturbance,
    /// Random number drawn at reset and shared by what mentions it.
    Random,
}

/// `name[i in set, z] named "n{}" : unit from "file" linear = value ~ sample in low..high scale s
/// nonnegative prefer "text"`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Declaration {
    /// Name as written.
    pub name: Ident,
    /// Index list: set or domain names, each optionally with a binder (`i in species`).
    pub indices: Vec<Binder>,
    /// Flattened-name pattern: `named "n{}"`.
    pub pattern: Option<String>,
    /// Unit after the colon; `None` where none was written.
    pub unit: Option<UnitExpr>,
    /// `from "weather.csv" linear`: data that a disturbance follows.
    pub measured: Option<Box<Measured>>,
    /// After `=`: default, definition (`let`), or initial value.
    pub value: Option<Expr>,
    /// After `~`: distribution drawn at reset (`param`), update rule (`disturbance`).
    pub sample: Option<Expr>,
    /// `clip bounds` or `clip lo..hi` after `~`.
    pub clip: Option<Clip>,
    /// `in low..high`
    pub bounds: Option<(Expr, Expr)>,
    /// `scale s`: typical magnitude, for tolerances.
    pub scale: Option<Expr>,
    /// `nonnegative`: a state that never falls below zero.
    pub nonnegative: Option<Span>,
    /// `prefer`: a state that index reduction keeps rather than others.
    pub prefer: Option<Span>,
    /// Describing text.
    pub text: Option<String>,
    /// The whole declaration.
    pub span: Span,
}

/// `from "weather.csv" linear outside cyclic`: data over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Path as written.
    pub path: String,
    /// Place of the path.
    pub path_span: Span,
    /// Interpolation between the points.
    pub kind: TimeTableKind,
    /// Word after `outside`.
    pub outside: Option<Ident>,
    /// Reading of the data at the present time: a call, without arguments, of a function whose
    /// name no text can have.
    pub read: Expr,
}

/// `clip bounds` or `clip low..high`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Clip {
    /// To the declared bounds of the target.
    Bounds(Span),
    /// To an interval.
    Range(Expr, Expr),
}

/// Members of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SetMembers {
    /// `{ a, b, c }`
    Names(Vec<Ident>),
    /// `1..9`: integers, both ends included
    Range(Expr, Expr),
    /// `species - solids`: members of other sets; `(c_A, T, h)`: variables
    Of(Expr),
}

/// `i in species`, `z`, `z in 2..n`, `x in (c_A, T, h)`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Binder {
    /// The index name; the set's own name where none is given.
    pub name: Ident,
    /// Set of its values.
    pub over: BinderSet,
    /// `for i in s, j in s if i != j`: condition on the values, at the last binder of a list.
    pub condition: Option<Box<Expr>>,
    /// The whole binder.
    pub span: Span,
}

/// Set of the values of a binder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum BinderSet {
    /// `z`: the set or domain of that name
    Itself,
    /// `i in species`
    Set(Ident),
    /// `z in 2..n`: cell numbers of the domain `z`, or integers
    Range(Box<Expr>, Box<Expr>),
    /// `x in (c_A, T, h)`, `i in {D, E, F}`, `i in species - solids`
    Tuple(Vec<Expr>),
}

/// `table ...`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Form `table M[species] : g/mol = {...}`: one entry. Form `table over species { columns: ...
    /// }`: one a column.
    pub columns: Vec<TableColumn>,
    /// The index sets.
    pub indices: Vec<Ident>,
    /// Value of entries left out.
    pub default: Option<Expr>,
    /// Rows in the order of the text.
    pub rows: Vec<TableRow>,
    /// Describing text.
    pub text: Option<String>,
}

/// Name and unit of one column of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TableColumn {
    /// Name of the table that the column defines.
    pub name: Ident,
    /// Unit of its values.
    pub unit: Option<UnitExpr>,
}

/// `tropine: 141.21, 1020, 1e-10` or `r1: tropine = -1, intermediate = 1`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TableRow {
    /// Member of the first index set.
    pub label: Ident,
    /// The cells.
    pub cells: TableCells,
    /// The whole row.
    pub span: Span,
}

/// Cells of a table's row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TableCells {
    /// One value a column, or one a member of the second set.
    Values(Vec<Expr>),
    /// `member = value`, the rest at the default.
    Sparse(Vec<(Ident, Expr)>),
}

/// A value over time or another quantity, or over two of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeTable {
    /// Name, called as a function of time: `Fs_recipe(t)`.
    pub name: Ident,
    /// Unit of the values.
    pub unit: Option<UnitExpr>,
    /// Unit of the times.
    pub time_unit: UnitExpr,
    /// Unit of the second argument of a table over two quantities.
    pub second_unit: Option<UnitExpr>,
    /// Validity of values between the given times.
    pub kind: TimeTableKind,
    /// Word after `outside`: how the table is read outside of its points.
    pub outside: Option<Ident>,
    /// Points of the table.
    pub points: TablePoints,
    /// Describing text.
    pub text: Option<String>,
}

/// Points of a table over quantities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TablePoints {
    /// `{ 0: 0, 50: 0.2 }`: argument and value.
    Entries(Vec<(Expr, Expr)>),
    /// `{ columns: 1, 2 \n 0: 0, 10 }`: values of the second argument, then for each of the first
    /// one the values of the table.
    Grid {
        /// Values of the second argument.
        columns: Vec<Expr>,
        /// Values of the first argument and of the table.
        rows: Vec<(Expr, Vec<Expr>)>,
    },
    /// `from "k.csv"`
    File {
        /// Path as written.
        path: String,
        /// Place of the path.
        span: Span,
    },
}

/// Interpolation of a time table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeTableKind {
    /// `until`: a value holds up to and including its time.
    Until,
    /// `from` or `step`: a value holds from its time on.
    From,
    /// `linear`: linear between the points.
    Linear,
    /// `cubic`: monotone cubic polynomials (PCHIP); over two quantities bicubic ones.
    Cubic,
}

/// `domain r in 0..r_p cells n_r scheme central geometry spherical`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Domain {
    /// Name, used as the index too.
    pub name: Ident,
    /// Lower and upper end.
    pub range: (Expr, Expr),
    /// Number of cells.
    pub cells: Expr,
    /// `scheme NAME`
    pub scheme: Option<Ident>,
    /// `geometry NAME`: planar (default), cylindrical, spherical
    pub geometry: Option<Ident>,
    /// `periodic`: the first cell follows the last one; the place of the word
    pub periodic: Option<Span>,
    /// `stretch q`: ratio of neighbouring cells
    pub stretch: Option<Expr>,
    /// `faces expr`: position of face k (0..n), with `k` bound
    pub faces: Option<Expr>,
    /// `volumes expr`: measure of cell k (1..n), with `k` bound
    pub volumes: Option<Expr>,
    /// `areas expr`: area of face k (0..n), with `k` bound
    pub areas: Option<Expr>,
    /// Describing text.
    pub text: Option<String>,
}

/// `flux J[i in species, z] : unit = inner, low = expr, high = expr`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flux {
    /// Name of the flux.
    pub name: Ident,
    /// Index list; the last one is the domain along which it flows.
    pub indices: Vec<Binder>,
    /// Unit, where given.
    pub unit: Option<UnitExpr>,
    /// Value at inner faces; field values there come from the domain's scheme.
    pub inner: Expr,
    /// Value at the lower end; the scheme's one-sided value where left out.
    pub low: Option<Expr>,
    /// Value at the upper end.
    pub high: Option<Expr>,
}

/// `reaction growth[z]: S + 2 O2 -> 1.1 X rate mu*X[z] "text"`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reaction {
    /// Name and indices; the value is the rate, by default `rate[growth, z]` of an array.
    pub declaration: Declaration,
    /// The rate is written.
    pub rated: bool,
    /// Both sides.
    pub terms: Vec<ReactionTerm>,
}

/// A species on a side of a reaction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReactionTerm {
    /// On the left side.
    pub consumed: bool,
    /// Stoichiometric coefficient; 1 where left out.
    pub coefficient: Option<Expr>,
    /// The species: a member of a set, or an index of the reaction.
    pub species: Ident,
}

/// One observation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// Own name; for a bare variable the variable's (flattened) name.
    pub name: Option<Ident>,
    /// Unit, where given.
    pub unit: Option<UnitExpr>,
    /// Observed expression.
    pub value: Expr,
    /// Index list of an observation of many (`SEP.F_OR[i] for i in species`).
    pub binders: Vec<Binder>,
    /// Own bounds; the variable's where left out.
    pub bounds: Option<(Expr, Expr)>,
    /// `noise normal(0, 0.1)`
    pub noise: Option<Expr>,
    /// `every n`: sampled each n steps and held
    pub every: Option<Expr>,
    /// `delay n`: reported n steps late
    pub delay: Option<Expr>,
    /// Describing text.
    pub text: Option<String>,
    /// The whole item.
    pub span: Span,
}

/// A phase of a schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Phase {
    /// Name of the phase.
    pub name: Ident,
    /// `for 60 [min]`
    pub duration: Option<Expr>,
    /// `until condition`
    pub until: Option<Expr>,
    /// `then NEXT`
    pub next: Option<Ident>,
    /// Statements that run at its end (`reset`, `next`).
    pub body: Vec<Statement>,
}

/// An expression.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Expr {
    /// Place in the text.
    pub span: Span,
    /// Kind.
    pub kind: ExprKind,
}

/// The kinds of expression.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the example of each kind names its fields")]
pub enum ExprKind {
    /// `3.5`, `3.5 [m]`
    Number { value: f64, unit: Option<UnitExpr> },
    /// `true`, `false`
    Bool(bool),
    /// `x`
    Name(Ident),
    /// `R1.inlet`, `z.last`
    Member(Box<Expr>, Ident),
    /// `c[i, z-1]`
    Index(Box<Expr>, Vec<Expr>),
    /// `exp(x)`, `steady(x)`, `div(J)`; `i in solids` is a call of `in`, and `{ A: 1, B: 2 }` is
    /// a call of [`BY_MEMBER`]
    Call { function: Ident, arguments: Vec<Expr> },
    /// `sum(e for i in set, j in other if condition)`; function is sum, product, min, max, mean,
    /// any, all
    Reduce { function: Ident, body: Box<Expr>, binders: Vec<Binder>, condition: Option<Box<Expr>> },
    /// `d/dt x` or `der(x)`
    Derivative(Box<Expr>),
    /// `-x`, `+x`, `not x`
    Unary(UnaryOp, Box<Expr>),
    /// `a + b`, `a and b`, `a < b`
    Binary(BinaryOp, Box<Expr>, Box<Expr>),
    /// `if c then a else b`
    If(Box<Expr>, Box<Expr>, Box<Expr>),
    /// `x as [1/h]`: states the unit of a dimensionless number, or converts to a commensurable unit
    As(Box<Expr>, UnitExpr),
    /// `(a, b, c)`
    Tuple(Vec<Expr>),
}

/// Function of the call that values by member are: its arguments are the indices of the array, then
/// members and values in turn.
pub const BY_MEMBER: &str = "by member";

/// Prefix operators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum UnaryOp {
    /// `-x`
    Neg,
    /// `+x`
    Plus,
    /// `not x`
    Not,
}

/// Infix operators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum BinaryOp {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
    Lt,
    Le,
    Gt,
    Ge,
    Eq,
    Ne,
    And,
    Or,
}

/// A unit as written: a product of powers, `kJ/(kg K)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitExpr {
    /// Place in the text.
    pub span: Span,
    /// Factors with rational exponents, in the order of the text; empty for `1`.
    pub factors: Vec<UnitFactor>,
}

/// One factor of a unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitFactor {
    /// Symbol (`kJ`) or, inside `unit(x)`, the expression whose unit is intended.
    pub base: UnitBase,
    /// Exponent as numerator and denominator.
    pub exponent: (i32, i32),
}

/// Base of a unit factor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum UnitBase {
    /// `kJ`
    Symbol(Ident),
    /// `unit(x)`: the unit of differences of `x`
    Of(Box<Expr>),
    /// a pure number, as in `100 mL`; kept exact as written
    Number(f64, Span),
}
