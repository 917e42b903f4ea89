//! Each invariant with a model that breaks it alone.

use cranelift_entity::EntityRef;
use smpl_dsl::diagnostic::SourceMap;

use super::verify_equations;
use crate::compile::flatten;
use crate::elaborate::{Equation, EquationForm, Options};
use crate::ir::{Affine, BinaryFn, Compare, Expr, ExprId, Flavour, LoopVar, Place, ReduceFn, Role, Store, Target, UnaryFn, VarId};
use crate::model::{Axis, Model, Port, PortMember, RootAction};

const TEXT: &str = "
param L : m = 1
param k : 1/s = 0.1
domain z in 0..L cells 4 scheme upwind
choice law = linear | square
action u = 0 in 0..1
discrete n = 0
random draw ~ normal(0, 1)
state x = 1 in 0..10
state c[z] = 1
var y in 0..10
let total = integral(x)
eq d/dt x = (u - y)*k
eq d/dt c[z] = -k*c[z]*(1 + sum(c[z] for z))    for z
eq y^3 + y = x + delay(x, 2 [s])
steady { u = 0.5 }
observe x, y every 2 noise normal(0, 0.1)
reward r default = total/(1 [s])
fail low event x <= 0
invariant mass = x
policy nominal { u = 0.5 }
at end { next n = n + draw }
";

fn model() -> Model {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", TEXT);
    let options = Options { verify: true, ..Options::default() };
    let flat = flatten(&mut sources, main, &mut |_| None, &options);
    flat.unwrap_or_else(|faults| panic!("{faults:?}")).0
}

/// The message of a model after a change.
fn broken(change: impl FnOnce(&mut Model)) -> String {
    let mut model = model();
    change(&mut model);
    model.verify().err().map(|violation| violation.to_string()).unwrap_or_default()
}

fn var(model: &Model, name: &str) -> VarId {
    model.vars.iter().find(|(_, v)| v.name == name).expect("a variable").0
}

fn role(model: &Model, role: Role) -> VarId {
    model.vars.iter().find(|(_, v)| v.role == role).expect("a variable").0
}

fn load(model: &mut Model, name: &str, flavour: Flavour, at: Affine) -> ExprId {
    let var = var(model, name);
    model.exprs.raw(Expr::Load { var, flavour, at })
}

/// A condition.
fn truth(model: &mut Model) -> ExprId {
    let x = load(model, "x", Flavour::Value, Affine::default());
    let zero = model.exprs.constant(0.0);
    model.exprs.raw(Expr::Compare(Compare::Lt, x, zero))
}

#[test]
fn a_compiled_model_keeps_every_invariant() {
    assert_eq!(broken(|_| {}), "");
}

#[test]
fn variables_of_the_runtime_have_its_sizes() {
    let longer = |of: Role| {
        broken(|m| {
            let var = role(m, of);
            m.vars[var].len += 1;
        })
    };
    assert!(longer(Role::Draw).starts_with("variables: variables of role Draw have 2 elements in all, the random numbers (`draws`) 1"));
    assert!(longer(Role::Quadrature).contains("role Quadrature have 2 elements in all, the `integrals` 1"));
    assert!(longer(Role::Delayed).contains("role Delayed have 6 elements in all, the `delays` 5"));
    assert!(
        broken(|m| {
            m.vars.push(m.vars[role(m, Role::Draw)].clone());
        })
        .contains("role Draw have 2")
    );
}

#[test]
fn unknowns_are_states_then_algebraic_variables_each_once() {
    assert_eq!(broken(|m| m.unknowns.push(m.unknowns[0])), "unknowns[3]: is in the list already");
    assert_eq!(broken(|m| m.unknowns.reverse()), "unknowns[1]: a state follows an algebraic variable");
    assert_eq!(broken(|m| m.unknowns[0] = var(m, "u")), "unknowns[0]: `u` is neither state nor algebraic variable");
    assert_eq!(broken(|m| m.unknowns[0] = VarId::new(999)).split(',').next(), Some("unknowns[0]: there is no variable 999"));
    assert_eq!(
        broken(|m| {
            m.unknowns.remove(0);
        }),
        "unknowns: the state `x` is missing"
    );
}

#[test]
fn quantities_have_the_shape_of_their_variables() {
    let states = |change: fn(&mut Model)| broken(change);
    assert!(
        states(|m| m.interface.quantities.states[1].axes.clear())
            .contains("quantities.states[1]: its axes have 1 elements, variable `c` has 4")
    );
    assert_eq!(states(|m| m.interface.quantities.states[1].low = vec![0.0; 3]), "quantities.states[1].low: expected 1 number or 4");
    assert!(states(|m| m.interface.quantities.actions[0].var = None).contains("nothing holds the quantity"));
    assert!(states(|m| m.interface.quantities.actions[0].var = m.interface.quantities.states[0].var).contains("is of another role"));
    assert!(
        states(|m| {
            let q = m.interface.quantities.states[0].clone();
            m.interface.quantities.states.push(q);
        })
        .contains("belongs to another quantity")
    );
    assert!(states(|m| drop(m.interface.quantities.states.pop())).contains("quantities.states: 1 elements, the `unknowns` have 5"));
    assert!(states(|m| drop(m.interface.quantities.solved.pop())).contains("quantities.solved: 0 elements, the `unknowns` have 1"));
    assert!(states(|m| m.interface.grids[0].faces.push(2.0)).contains("which does not exist or has other faces"));
    assert!(states(|m| m.interface.quantities.states[1].axes = vec![Axis::Cells { grid: 7, count: 4 }]).contains("4 cells of grid 7"));
}

#[test]
fn indices_of_the_interface_exist() {
    assert_eq!(broken(|m| m.interface.quantities.state_order = Some(vec![0; 5])), "state_order: expected each of the 5 states once");
    assert_eq!(broken(|m| m.interface.finish.default_reward = 1), "finish.default_reward: there is no reward 1, there are 1");
    assert_eq!(broken(|m| m.interface.alternatives.choices[0].at = 2), "choices[0].chosen: there is no option 2, there are 2");
    assert!(broken(|m| m.interface.steady.iter_mut().for_each(|s| s.fixed = vec![5])).contains("steady.fixed[0]: there is no element 5"));
    assert!(broken(|m| m.roots[0].action = RootAction::Fail(9)).starts_with("events[0].does: there is no failure 9"));
    assert!(broken(|m| m.roots[0].action = RootAction::Run(0)).starts_with("events[0].does: there is no program of an event 0"));
    let port = |output: &str, equals: &str| Port {
        name: "p".into(),
        connector: "C".into(),
        members: vec![PortMember { name: "a".into(), output: output.into(), equals: Some(equals.into()), flow: false }],
    };
    assert_eq!(broken(|m| m.interface.measured.push("none".into())), "measured[0]: there is no output `none`");
    assert_eq!(broken(|m| m.interface.ports.push(port("none", "x"))), "ports[0].members[0].output: there is no such output");
    assert!(broken(|m| m.interface.ports.push(port("y", "c"))).contains("equals: there is no such quantity of 1 elements"));
}

#[test]
fn settings_are_in_their_ranges() {
    assert_eq!(broken(|m| m.interface.episode.step = 0.0), "episode.step: expected a number that is positive and finite, found 0");
    assert!(broken(|m| m.interface.episode.max_steps = 0).starts_with("episode.max_steps: "));
    assert!(broken(|m| m.interface.solver.rtol = 1.0).starts_with("solver.rtol: "));
    assert!(broken(|m| m.interface.solver.max_order = 6).starts_with("solver.max_order: "));
    assert!(broken(|m| m.interface.finish.observations[1].every = 0).starts_with("finish.observations[1].every: "));
    assert!(broken(|m| m.interface.finish.observations[1].noise = f64::NAN).starts_with("finish.observations[1].noise: "));
}

#[test]
fn expressions_have_operands_of_the_right_kind() {
    let residual = |make: fn(&mut Model) -> Expr| {
        broken(|m| {
            let node = make(m);
            m.rows[0].residual = m.exprs.raw(node);
        })
    };
    assert!(residual(|m| Expr::Unary(UnaryFn::Exp, truth(m))).contains("equations[0]: node "));
    assert!(residual(|m| Expr::Not(m.exprs.time())).contains("is a number, node"));
    assert!(residual(|m| Expr::Not(truth(m))).contains("is a truth value, a number is expected"));
    assert!(
        residual(|m| {
            let t = m.exprs.time();
            Expr::Select(t, t, t)
        })
        .contains("expects a truth value")
    );
    assert!(residual(|_| Expr::Counter(LoopVar(0))).contains("counter 0 is used outside of its loop"));
    assert!(
        residual(|m| Expr::Load { var: var(m, "k"), flavour: Flavour::Derivative, at: Affine::default() })
            .contains("has no copy Derivative")
    );
    assert!(
        residual(|m| Expr::Load { var: var(m, "c"), flavour: Flavour::Value, at: Affine::constant(4) })
            .contains("`c`: elements 4 to 4 of 4")
    );
    assert!(
        residual(|m| {
            let body = load(m, "c", Flavour::Value, Affine::along(1, LoopVar(0), 1));
            Expr::Reduce { op: ReduceFn::Sum, depth: LoopVar(0), extent: 4, body }
        })
        .contains("`c`: elements 1 to 4 of 4")
    );
    assert!(broken(|m| m.rows[0].residual = ExprId::new(999_999)).contains("there is no node 999999"));
    assert!(
        broken(|m| {
            let t = truth(m);
            m.quadratures[0] = t;
        })
        .starts_with("integrals[0]: ")
    );
}

#[test]
fn every_element_of_an_unknown_has_one_equation() {
    assert!(broken(|m| drop(m.rows.pop())).contains("equations: no equation for element 0 of `y`"));
    assert!(broken(|m| m.rows[1].at = Affine::default()).contains("element 0 of `c` has another equation"));
    assert!(broken(|m| m.rows[1].extents = vec![5]).contains("equations[1]: "));
    assert!(
        broken(|m| {
            let k = var(m, "k");
            m.rows[0].var = k;
        })
        .contains("`k` is not an unknown")
    );
    assert_eq!(broken(|m| m.explicit = !m.explicit), "explicit: the equations state otherwise");
}

#[test]
fn programs_store_inside_of_variables_and_outputs() {
    let first = |place: Place, at: i64| {
        broken(|m| {
            let value = m.exprs.constant(1.0);
            let target = Target { place, at: Affine::constant(at) };
            m.programs.policies[0].1.nests[0].stores.push(Store { target, value });
        })
    };
    assert_eq!(first(Place::Out, 1), "programs.policy nominal.nests[0].stores[1]: `the output`: elements 1 to 1 of 1");
    assert!(first(Place::Var(VarId::new(999)), 0).contains("there is no variable 999"));
    assert!(first(Place::Table { table: 0, plus: Affine::default(), add: false }, 0).contains("belong to the back end"));
    assert!(broken(|m| m.programs.end.nests[0].loops = vec![(3, 2)]).contains("not numbered by depth"));
    assert_eq!(broken(|m| m.programs.lags.nests.clear()), "programs.lags: leaves out a delayed element");
    let twice = broken(|m| {
        let nest = m.programs.lags.nests[0].clone();
        m.programs.lags.nests.push(nest);
    });
    assert_eq!(twice, "programs.lags: does not store each of 1 delayed elements once");
    assert!(broken(|m| m.delays[0].bounds = (0.0, 1.0)).starts_with("delays[0].bounds: "));
}

#[test]
fn equations_before_matching_are_checked_as_well() {
    let mut model = model();
    let condition = truth(&mut model);
    let own = var(&model, "c");
    let value = model.exprs.constant(0.0);
    let equation = |extents: Vec<u32>, form| Equation { extents, runs: 0, repeats: None, form, span: Default::default() };
    let rate = |extents, stride| equation(extents, EquationForm::Rate { var: own, at: Affine::along(0, LoopVar(0), stride), value });
    let violation = |equation: Equation| verify_equations(&model, &[equation]).err().map(|v| v.to_string()).unwrap_or_default();
    assert_eq!(violation(rate(vec![4], 1)), "");
    assert_eq!(violation(rate(vec![4], 2)), "equations[0]: `c`: elements 0 to 6 of 4");
    assert_eq!(violation(rate(vec![], 1)), "equations[0]: `c`: an address follows counter 0 outside of its loop");
    assert!(violation(equation(vec![], EquationForm::Implicit { residual: condition })).contains("is a truth value"));
    let sum = model.exprs.raw(Expr::Binary(BinaryFn::Add, condition, condition));
    let violation = verify_equations(&model, &[equation(vec![], EquationForm::Implicit { residual: sum })]);
    assert!(violation.is_err());
}
