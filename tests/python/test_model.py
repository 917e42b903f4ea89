"""Equations and derivatives of compiled models, against published values and finite differences."""

import pickle
import warnings

import numpy as np
import pytest
import scipy.stats

import smpl

ACTION = np.array([26.85, 0.1])
# Steady states of the reactor at the nominal action and h = 0.659 with the eigenvalues of the (c_A, T) part.
STEADY_STATES = [
    ((0.8778252005501434, 51.34660619295078), (-1.057 - 0.540j, -1.057 + 0.540j)),
    ((0.501894113975015, 76.84405451311673), (-0.463, 2.846)),
    ((0.2065530809547568, 96.87549909213137), (1.351 - 1.601j, 1.351 + 1.601j)),
]


@pytest.mark.parametrize(("state", "eigenvalues"), STEADY_STATES)
def test_the_linearisation_has_the_published_eigenvalues(reactor_model, state, eigenvalues):
    A, B, C, D = reactor_model.linearize([*state, 0.659], ACTION)
    assert A.shape == (3, 3) and B.shape == (3, 2) and C.shape == (3, 3) and D.shape == (3, 2)
    found = np.sort_complex(np.linalg.eigvals(A[:2, :2]))
    np.testing.assert_allclose(found, np.sort_complex(np.array(eigenvalues)), atol=6e-4)
    np.testing.assert_allclose(C, np.eye(3))
    np.testing.assert_allclose(D, 0.0)


@pytest.mark.parametrize(("state", "eigenvalues"), STEADY_STATES)
def test_the_right_hand_side_vanishes_at_the_published_steady_states(reactor_model, state, eigenvalues):
    del eigenvalues
    np.testing.assert_allclose(reactor_model.rhs(0.0, [*state, 0.659], ACTION), 0.0, atol=1e-11)


def test_the_steady_state_is_the_published_one(reactor_model):
    found = reactor_model.steady_state(ACTION, fixed={"h": 0.659})
    np.testing.assert_allclose(found, [*STEADY_STATES[0][0], 0.659], rtol=1e-11)
    without_heel = reactor_model.steady_state(ACTION, p={"V_0": 0.0}, fixed={"h": 0.659})
    np.testing.assert_allclose(without_heel[:2], [0.877825190292089, 51.3466085559445], rtol=1e-11)


@pytest.mark.parametrize("name", ["reactor", "beer"])
def test_the_jacobian_is_the_derivative_of_the_residual(name):
    model = smpl.compile(name)
    low, high = model.native.bounds("state")
    generator = np.random.default_rng(3)
    y = generator.uniform(low + 0.2 * (high - low), low + 0.8 * (high - low))
    yp = generator.normal(size=y.size)
    u = model.native.defaults("action")
    cj = 2.5
    jacobian = model.jacobian(0.3, y, yp, u, cj)
    assert jacobian.has_sorted_indices
    columns = []
    for i in range(y.size):
        step = 1e-6 * (high - low)[i]
        direction = np.eye(y.size)[i] * step
        forward = model.residual(0.3, y + direction, yp + cj * direction, u)
        backward = model.residual(0.3, y - direction, yp - cj * direction, u)
        columns.append((forward - backward) / (2 * step))
    expected = np.array(columns).T
    np.testing.assert_allclose(jacobian.toarray(), expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())


def test_the_residual_is_the_right_hand_side_less_the_rates(reactor_model):
    y, yp = [0.7, 44.0, 0.8], np.array([0.1, -0.2, 0.3])
    rates = reactor_model.rhs(0.0, y, ACTION)
    np.testing.assert_allclose(reactor_model.residual(0.0, y, yp, ACTION), rates - yp, rtol=1e-14)


def test_the_right_hand_side_agrees_with_an_independent_implementation(reference, reactor_model):
    table = reference("rhs_reactor.csv")
    for i in range(len(table["c_A"])):
        found = reactor_model.rhs(
            0.0, [table[n][i] for n in ("c_A", "T", "h")], [table[n][i] for n in ("T_c", "q_out")]
        )
        np.testing.assert_allclose(found, [table[f"der.{n}"][i] for n in ("c_A", "T", "h")], rtol=1e-12)


def test_the_right_hand_side_of_the_beer_agrees_with_an_independent_implementation(reference):
    model, table = smpl.compile("beer"), reference("rhs_beer.csv")
    states = model.state_names
    for i in range(len(table["T"])):
        found = model.rhs(0.0, [table[n][i] for n in states], [table["T"][i]])
        expected = np.array([table[f"der.{n}"][i] for n in states])
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_parameters_take_the_place_of_defaults(reactor_model):
    y = [0.7, 44.0, 0.8]
    plain = reactor_model.rhs(0.0, y, ACTION)
    changed = reactor_model.rhs(0.0, y, ACTION, p={"q_in": 0.2})
    area = np.pi * 0.219**2
    assert changed[2] - plain[2] == pytest.approx(0.1 / area, rel=1e-12)
    np.testing.assert_array_equal(reactor_model.rhs(0.0, y, ACTION), plain)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, [1.0, 2.0], ACTION), r"y has shape \(2,\), expected \(3,\)"),
        ((0.0, [1.0, 2.0, 3.0], [1.0]), r"u has shape \(1,\), expected \(2,\)"),
        ((0.0, [1.0, 2.0, 3.0], ACTION, {"x": 1.0}), "unknown 'x'.*q_in"),
    ],
)
def test_wrong_arguments_are_named(reactor_model, arguments, message):
    with pytest.raises(ValueError, match=message):
        reactor_model.rhs(*arguments)


def test_doubts_of_the_compiler_are_warnings():
    text = "param p : % = 20\nstate x = 1\neq d/dt x = -(p + 1) * x / 1 [s]\n"
    expected = r"<source>:3:19: 1 without a unit is 100 \[%\] here .*write `1 \[%\]`"
    with pytest.warns(smpl.CompileWarning, match=expected):
        model = smpl.compile(source=text)
    (found,) = model.warnings
    assert (found.severity, found.line, found.column) == ("warning", 3, 19)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert smpl.compile(source=text.replace("+ 1", "+ 1 [%]")).warnings == ()
        assert smpl.compile("reactor", scenario="legacy").warnings  # published, and stated in the text


def test_a_model_can_be_made_of_its_text():
    model = smpl.compile(
        source="""
        model Tank
        time t : min
        param A : m^2 = 0.5
        action q : m^3/min = 0.1 in 0..0.3
        state h : m = 1 in 0..2
        eq d/dt h = (q - 0.1 [m^2.5/min] * sqrt(h)) / A
        observe h
        reward level default = -sq((h - 1 [m]) / 1 [m])
        episode { step = 1 [min], max_steps = 50, error_reward = -100 }
        """
    )
    assert model.rhs(0.0, [0.25], [0.2])[0] == pytest.approx((0.2 - 0.1 * 0.5) / 0.5, rel=1e-14)
    env = smpl.Env(model)
    env.reset(seed=0)
    assert env.step(np.zeros(1))[1] <= 0.0


def test_a_fault_in_the_text_is_shown_with_its_place():
    with pytest.raises(smpl.CompileError) as caught:
        smpl.compile(source="model M\ntime t : s\nstate x : m = 1\neq d/dt x = -k*x\n")
    found = caught.value.diagnostics[0]
    assert (found.line, found.column) == (4, 14)
    assert "k" in found.message and found.code
    assert found.file in str(caught.value)


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.eq"):
        smpl.compile("models/nowhere.eq")
    with pytest.raises(FileNotFoundError, match="reactor"):
        smpl.compile("reaktor")


@pytest.mark.parametrize(
    "arguments",
    [
        {"scenario": "nowhere"},
        {"variants": ["nowhere"]},
        {"settings": {"nowhere": 1}},
    ],
)
def test_an_unknown_scenario_variant_or_setting_is_refused(arguments):
    with pytest.raises(smpl.ScenarioError, match="nowhere"):
        smpl.compile("reactor", **arguments)


def test_a_model_is_compiled_once_for_the_same_arguments():
    assert smpl.compile("reactor") is smpl.compile("reactor")
    assert smpl.compile("reactor") is not smpl.compile("reactor", scenario="legacy")


def test_a_model_survives_pickling(reactor_model):
    again = pickle.loads(pickle.dumps(reactor_model))
    y = [0.7, 44.0, 0.8]
    np.testing.assert_array_equal(again.rhs(0.0, y, ACTION), reactor_model.rhs(0.0, y, ACTION))


def test_a_setting_changes_a_parameter():
    model = smpl.compile("reactor", settings={"q_in": 0.2})
    area = np.pi * 0.219**2
    assert model.rhs(0.0, [0.7, 44.0, 0.8], ACTION)[2] == pytest.approx(0.1 / area, rel=1e-12)


def test_tanks_that_are_connected_over_an_index_answer_as_a_row_of_tanks():
    model = smpl.compile(
        source="""
        time t : min
        connector Stream { Q : L/min, c : mol/L }
        component Tank(V = 1) {
          port inlet, outlet : Stream
          state c : mol/L = 0
          eq d/dt c = inlet.Q / (V * 1 [L]) * (inlet.c - c)
          eq outlet.Q = inlet.Q
          eq outlet.c = c
        }
        action q : L/min = 3 in 0..5
        use Tank as a[k in 1..4](V = 2), b[k in 1..4](V = 2)
        connect a[k].outlet -> b[k].inlet for k in 1..4
        connect b[k].outlet -> a[k+1].inlet for k in 1..3
        eq a[1].inlet.Q = q
        eq a[1].inlet.c = 1 [mol/L]
        observe b[4].c in 0..1
        solver { rtol = 1e-10 }
        episode { step = 1 [min], max_steps = 8 }
        """
    )
    found = model.rollout(np.zeros(8), np.full((1, 8, 1), 3.0)).states[0]
    times = np.arange(9) * 3.0 / 2.0
    for place, name in enumerate(model.state_names):
        number = 2 * int(name[2]) - (name[0] == "a")
        # A step through n equal tanks is the distribution of Erlang.
        expected = scipy.stats.gamma.cdf(times, number)
        np.testing.assert_allclose(found[:, place], expected, rtol=0, atol=1e-8, err_msg=name)


@pytest.mark.parametrize("read", ["previous(x)", "initial(x)", "previous(3*x)/3", "steady(x) + previous(x) - 0.5"])
def test_the_start_and_the_step_before_are_the_point_itself(read):
    """dx/dt = u - x + 2 (read - x) is u - x where what is read is x, and 0.5 at rest is steady(x) for u = 0.5."""
    model = smpl.compile(
        source=f"""model W
        time t : s
        action u = 0.5 in 0..1
        state x = 3 in 0..10
        eq d/dt x = (u - x + 2*({read} - x))/1 [s]
        steady {{ u = 0.5 }}
        observe x in 0..10
        episode {{ step = 1 [s], max_steps = 30 }}
        """
    )
    np.testing.assert_allclose(model.residual(0.0, [2.0], [0.0], [0.5]), [-1.5], rtol=1e-14)
    np.testing.assert_allclose(model.rhs(0.0, [2.0], [0.5]), [-1.5], rtol=1e-14)
    np.testing.assert_allclose(model.steady_state([0.5]), [0.5], rtol=1e-12)
    np.testing.assert_allclose(smpl.Env(model).unwrapped.steady_state, [0.5], rtol=1e-12)
    # In one step it is the value that the step begins with.
    decay = np.exp(-3.0)
    np.testing.assert_allclose(model.step([2.0], [0.5]), [2 * decay + (0.5 + 4) / 3 * (1 - decay)], rtol=1e-5)
    # What the linearisation holds: the value that is read.
    a, b, _, _ = model.linearize([2.0], [0.5])
    np.testing.assert_allclose([a, b], [[[-3.0]], [[1.0]]], rtol=1e-14)


def test_actions_at_the_step_before_are_nominal_as_in_a_first_step():
    model = smpl.compile(
        source="""model W
        time t : s
        action u = 0.5 in 0..1
        state x = 3 in 0..10
        eq d/dt x = (u - previous(u))/1 [s]
        episode { step = 1 [s], max_steps = 30 }
        """
    )
    np.testing.assert_allclose(model.rhs(0.0, [2.0], [0.75]), [0.25], rtol=1e-14)
    np.testing.assert_allclose(model.step([2.0], [0.75]), [2.25], rtol=1e-6)


@pytest.mark.parametrize(("u", "z", "gain"), [(0.5, 0.0, 2.0), (0.5 + 1.0 - np.log(1.5), np.log(1.5), 1.5)])
def test_algebraic_equations_that_read_rates_are_linearised_with_them(u, z, gain):
    """exp(z) = 1 + x'/2, x' = u - x + z: dz = dx' / (2 exp(z)), dx' = gain (du - dx), at rest and at x' = 1."""
    model = smpl.compile(
        source="""model W
        time t : s
        action u = 0.5 in -2..2
        state x = 0.5 in -10..10
        var z = 0
        eq d/dt x = (u - x + z)/1 [s]
        eq exp(z) = 1 + 0.5*value(d/dt x)
        observe zz = z in -10..10, dx = value(der(x)) in -10..10
        episode { step = 1 [s], max_steps = 3 }
        """
    )
    a, b, c, d = model.linearize([0.5, z], [u])
    part = gain / 2 / np.exp(z)
    np.testing.assert_allclose([a, b], [[[-gain]], [[gain]]], rtol=1e-12)
    np.testing.assert_allclose(np.hstack([c, d]), [[-part, part], [-gain, gain]], rtol=1e-12)


def test_findings_have_notes_and_related_places():
    text = "state x = 1\nstate y = 0\neq d/dt x = -x/1 [s]\neq d/dt y = -y/1 [s]\neq x^2 + y^2 = 1\n"
    with pytest.raises(smpl.CompileError, match="its time derivative is") as caught:
        smpl.compile(source=text)
    (finding,) = caught.value.diagnostics
    assert finding.notes == ["its time derivative is `eq 2*x*d/dt x + 2*y*d/dt y = 0`"]
    assert finding.related == []
    with pytest.raises(smpl.CompileError) as caught:
        smpl.compile(source="state x = 1\nstate x = 2\neq d/dt x = 0\n")
    place = caught.value.diagnostics[0].related[0]
    assert (place.line, place.column, place.end_column) == (1, 7, 8)
