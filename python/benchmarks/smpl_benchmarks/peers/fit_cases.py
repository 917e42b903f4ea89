"""Models and runs for `python -m smpl.bench fit`, with equations for SciPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import smpl
from smpl.analysis.sensors import sensors
from smpl.controllers import OpenLoop, Policy
from smpl.evaluation import run_episode
from smpl.support.arguments import FloatArray

# K. H. Johansson, The quadruple-tank process, IEEE Transactions on Control Systems Technology 8
# (2000) 456-465.
FOUR_TANKS = """model FourTanks
time t : s
param a_1 : cm^2 = 0.071, a_2 : cm^2 = 0.057, a_3 : cm^2 = 0.071, a_4 : cm^2 = 0.057
param g : cm/s^2 = 981, k_c : V/cm = 0.5, k_1 : cm^3/(V s) = 3.33, k_2 : cm^3/(V s) = 3.35
param gamma_1 = 0.7 in 0..1
param gamma_2 = 0.6 in 0..1
action v_1 : V = 3 in 0..10
action v_2 : V = 3 in 0..10
state h_1 : cm = 12.4 in 0.01..30
state h_2 : cm = 12.7 in 0.01..30
state h_3 : cm = 1.8 in 0.01..30
state h_4 : cm = 1.4 in 0.01..30
eq d/dt h_1 = (-a_1*sqrt(2*g*h_1) + a_3*sqrt(2*g*h_3) + gamma_1*k_1*v_1) / 28 [cm^2]
eq d/dt h_2 = (-a_2*sqrt(2*g*h_2) + a_4*sqrt(2*g*h_4) + gamma_2*k_2*v_2) / 32 [cm^2]
eq d/dt h_3 = (-a_3*sqrt(2*g*h_3) + (1 - gamma_2)*k_2*v_2) / 28 [cm^2]
eq d/dt h_4 = (-a_4*sqrt(2*g*h_4) + (1 - gamma_1)*k_1*v_1) / 32 [cm^2]
observe y_1 : V = k_c*h_1 in 0..15 noise normal(0, 0.02), y_2 : V = k_c*h_2 in 0..15 noise normal(0, 0.02)
reward none default = 0
episode { step = 2 [s], max_steps = 60, error_reward = 0 }
"""

Rates = Callable[[float, FloatArray, FloatArray, FloatArray], Any]


@dataclass(frozen=True)
class Case:
    """Runs of one model.

    Attributes:
        name: for the table.
        arguments: of `smpl.compile`, observation level included.
        truth: parameters that the runs are made with; the declared ones are the first guesses.
        initial: states that are unknown at the start, and lie 4 to 12 % below their nominal values.
        controller: makes what chooses the actions of a draw.
        rates: of a user of SciPy: time, state, action, parameters in the order of `truth`.
        seen: what he compares: names of observations -> function of the states and the parameters.
    """

    name: str
    arguments: dict[str, Any]
    truth: dict[str, float]
    initial: tuple[str, ...]
    controller: Callable[[int], Any]
    rates: Rates
    seen: dict[str, Callable[[FloatArray], Any]]

    def model(self) -> smpl.Model:
        """The model."""
        return smpl.compile(**self.arguments)

    def record(self, model: smpl.Model, draw: int) -> dict[str, FloatArray]:
        """A noisy run as columns: actions, readings, and the known states of the start."""
        generator = np.random.default_rng([7, draw])
        nominal = smpl.Env(model, normalize=False)
        nominal.reset(seed=0, options={"start": "nominal"})
        start = dict(zip(nominal.state_names, nominal.state.tolist(), strict=True))
        unknown = {name: start[name] * generator.uniform(0.88, 0.96) for name in self.initial}
        options = {"start": "nominal", "state": unknown, "parameters": self.truth}
        episode = run_episode(nominal, self.controller(draw), draw, options)
        assert episode.applied is not None and episode.readings is not None  # of an environment in physical units
        rows = np.vstack([episode.applied[:1], episode.applied])
        columns = dict(zip(model.action_names, rows.T, strict=True))
        readings = zip(model.observation_names, episode.readings.T, strict=True)
        columns |= {f"obs.{name}": values for name, values in readings if name in self.seen}
        later = np.full(episode.steps, np.nan)
        begin = zip(model.state_names, episode.states[0].tolist(), strict=True)
        return columns | {name: np.append(value, later) for name, value in begin if name not in self.initial}


@dataclass(frozen=True)
class Peer:
    """The same least-squares problem for SciPy: initial value problems and differences."""

    case: Case
    model: smpl.Model
    record: dict[str, FloatArray]

    def solve(self, rtol: float = 1e-8) -> Any:
        """The result of `least_squares`."""
        from scipy.integrate import solve_ivp
        from scipy.optimize import least_squares

        case, model = self.case, self.model
        env = smpl.Env(model, normalize=False)
        env.reset(seed=0, options={"start": "nominal"})
        start = np.array([
            self.record[name][0] if name in self.record else value
            for name, value in zip(model.state_names, env.state.tolist(), strict=True)
        ])  # fmt: skip
        actions = np.stack([self.record[name][1:] for name in model.action_names], axis=1)
        defaults = dict(zip(model.parameter_names, model.native.defaults("parameter").tolist(), strict=True))
        places = [model.state_names.index(name) for name in case.initial]
        guess = np.array([*(defaults[name] for name in case.truth), *start[places]])
        samples = self._samples(len(actions))

        def residuals(z: FloatArray) -> FloatArray:
            values = z * guess
            p, x = values[: len(case.truth)], start.copy()
            x[places] = values[len(case.truth) :]
            states = [x]
            for k, u in enumerate(actions):
                span = (k * model.step, (k + 1) * model.step)
                found = solve_ivp(
                    case.rates, span, states[-1], method="LSODA", rtol=rtol, atol=1e-2 * rtol, args=(u, p)
                )
                states.append(found.y[:, -1])
            return np.array([(case.seen[name](states[k]) - reading) / sigma for name, k, reading, sigma in samples])

        return least_squares(residuals, np.ones(len(guess)))

    def _samples(self, steps: int) -> list[tuple[str, int, float, float]]:
        """First readings: name, step of the sample, reading, deviation."""
        declared, names = sensors(self.model), self.model.observation_names
        return [
            (names[i], taken, float(self.record[f"obs.{names[i]}"][k]), float(declared.noise[i]))
            for k in range(steps + 1)
            for taken, arrived in declared.arriving(k).items()
            for i in arrived
            if names[i] in self.case.seen and np.isfinite(self.record[f"obs.{names[i]}"][k])
        ]


def _steps(low: FloatArray, high: FloatArray, moves: int, length: int) -> Callable[[int], OpenLoop]:
    """Actions at random between two, each held."""

    def make(draw: int) -> OpenLoop:
        values = np.random.default_rng([11, draw]).uniform(low, high, (moves, len(low)))
        return OpenLoop(np.repeat(values, length, axis=0), hold=True)

    return make


def _reactor(_: float, x: FloatArray, u: FloatArray, p: FloatArray) -> list[Any]:
    c, T, h = x
    area = np.pi * 0.219**2
    dilution = 0.1 / (area * h)
    rate = 7.2e10 * np.exp(-8750 / (T + 273.15)) * c
    heat = 1000 * 0.239
    cooling = 2 * p[0] / (0.219 * heat) * (u[0] - T)
    return [dilution * (p[1] - c) - rate, dilution * (76.85 - T) + 5e4 / heat * rate + cooling, (0.1 - u[1]) / area]


def _tanks(_: float, x: FloatArray, u: FloatArray, p: FloatArray) -> list[Any]:
    out = np.array([p[2], 0.057, 0.071, 0.057]) * np.sqrt(2 * 981 * np.maximum(x, 0))
    first, second = 3.33 * u[0], 3.35 * u[1]
    return [
        (-out[0] + out[2] + p[0] * first) / 28,
        (-out[1] + out[3] + p[1] * second) / 32,
        (-out[2] + (1 - p[1]) * second) / 28,
        (-out[3] + (1 - p[0]) * first) / 32,
    ]


def _beer(_: float, x: FloatArray, u: FloatArray, p: FloatArray) -> list[Any]:
    active, lag, dead, sugar, ethanol, diacetyl, _ester = x
    kelvin = u[0] + 273.15
    mu_x = np.exp(p[0] - 31934.09 / kelvin) * sugar / (65 + ethanol)
    settling = np.exp(33.82 - 10033.28 / kelvin) * 65 / (65 + ethanol)
    monod = np.exp(-119.63 + 34203.95 / kelvin)
    uptake = np.exp(-41.92 + 11654.64 / kelvin) * sugar / (monod + sugar)
    made = np.exp(p[1] - 1267.24 / kelvin) * sugar / (monod + sugar)
    waking, dying = np.exp(30.72 - 9501.54 / kelvin) * lag, np.exp(130.16 - 38313 / kelvin) * active
    return [
        mu_x * active - dying + waking,
        -waking,
        -settling * dead + dying,
        -uptake * active,
        (1 - ethanol / 65) * made * active,
        p[2] * sugar * active - 0.00113864 * diacetyl * ethanol,
        np.exp(89.92 - 26589 / kelvin) * mu_x * active,
    ]


CASES = (
    Case(
        "reactor", {"path": "reactor", "observation": "laboratory", "settings": {"max_steps": 60}},
        {"U": 52.0, "c_Af": 1.02}, ("c_A",), _steps(np.array([23.0, 0.09]), np.array([27.0, 0.11]), 12, 5),
        _reactor, {"T": lambda x: x[1], "h": lambda x: x[2], "c_A": lambda x: x[0]},
    ),
    Case(
        "four tanks", {"source": FOUR_TANKS},
        {"gamma_1": 0.66, "gamma_2": 0.63, "a_1": 0.073}, ("h_3", "h_4"),
        _steps(np.array([2.0, 2.0]), np.array([4.0, 4.0]), 6, 10), _tanks,
        {"y_1": lambda x: 0.5 * x[0], "y_2": lambda x: 0.5 * x[1]},
    ),
    Case(
        "beer", {"path": "beer", "observation": "laboratory"},
        {"a_mu_x0": 108.36, "a_mu_e0": 3.25, "mu_DY": 1.2e-4}, ("X_L",), lambda _: Policy("profile"), _beer,
        {"S": lambda x: x[3], "biomass": lambda x: x[0] + x[1] + x[2], "EtOH": lambda x: x[4], "DY": lambda x: x[5]},
    ),
)  # fmt: skip
