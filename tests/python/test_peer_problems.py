"""Problems and networks that the benchmarks hand to other solvers are those of this package."""

from pathlib import Path

import numpy as np
import pytest

import smpl
import smpl_benchmarks.peers.stiff_problems as stiff
from smpl_benchmarks.peers.network import Network, model_text, read_network
from smpl_benchmarks.peers.networks import slopes, without_idle

PROBLEMS = Path(__file__).parents[1] / "problems"
NETWORK = """
begin parameters
    1 forward  2.0  # Constant
    2 half     forward/4
    3 off      0
end parameters
begin species
    1 A() 1
    2 B() 3*half
    3 C() 0
end species
begin reactions
    1 1,2 3 forward #binds
    2 3 1,2 half #leaves
    3 1,1 3 off
    4 3 1,2 0.5*half #_leaves again
end reactions
"""


def end_of(model: smpl.Model) -> np.ndarray:
    env = smpl.Env(model, normalize=False, method="rosenbrock")
    env.reset(options={"start": "nominal"})
    env.step(np.zeros(0))
    return np.array(env.state)


@pytest.mark.parametrize("problem", [one for one in stiff.PROBLEMS if one.path], ids=lambda one: one.name)
def test_equations_for_other_solvers_have_the_solution_of_the_published_problem(problem, tmp_path):
    scenario = tmp_path / "tight.yaml"
    scenario.write_text("solver: {rtol: 1.0e-10, max_steps: 1000000}\n")
    published = smpl.compile(PROBLEMS / f"{problem.path}.eq", scenario=scenario)
    again = smpl.compile(source=problem.model_text(), scenario=scenario)
    first, second = end_of(published), end_of(again)
    scale = 1e-2 * np.array(problem.scale)
    np.testing.assert_allclose(first / scale, second / scale, rtol=1e-5, atol=1e-5)


@pytest.fixture
def network(tmp_path) -> Network:
    path = tmp_path / "small.net"
    path.write_text(NETWORK)
    return read_network(path)


def test_a_network_file_becomes_a_model_with_the_equilibrium_of_mass_action(network):
    assert network.start.tolist() == [1.0, 1.5, 0.0]
    assert network.constants.tolist() == [2.0, 0.5, 0.0, 0.25]
    a, b, c = end_of(smpl.compile(source=model_text(network, 1000.0, 1)))
    # Closed form: 2 a b = 0.75 c with a = 1 - c and b = 1.5 - c.
    expected = min(np.roots([2.0, -5.75, 3.0]))
    np.testing.assert_allclose([a, b, c], [1 - expected, 1.5 - expected, expected], rtol=1e-6)


def test_slopes_of_a_network_are_those_of_differences(network):
    active = without_idle(network)
    assert len(active.constants) == 3

    def rates(y):
        amounts = np.append(y, 1.0)
        rate = active.constants * amounts[active.first] * amounts[active.second]
        return np.bincount(active.rows, active.counts * rate[active.reactions], minlength=3)

    y, step = np.array([0.3, 0.7, 1.1]), 1e-6
    positions, others, weights = slopes(active)
    jacobian = np.zeros(9)
    np.add.at(jacobian, positions, weights * np.append(y, 1.0)[others])
    differences = [(rates(y + step * e) - rates(y - step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(jacobian.reshape(3, 3), differences, atol=1e-8)


def test_a_network_with_three_reactants_is_refused_by_the_number_of_the_reaction(tmp_path):
    path = tmp_path / "three.net"
    path.write_text(NETWORK.replace("1 1,2 3 forward", "1 1,2,2 3 forward"))
    with pytest.raises(ValueError, match="reaction 1 has more than two reactants"):
        read_network(path)
