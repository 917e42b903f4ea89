"""Tuning of PID loops: SIMC from the linearisation, and the relay experiment.

S. Skogestad, Simple analytic rules for model reduction and PID controller tuning, Journal of
Process Control 13 (2003) 291-309; K. J. Astrom and T. Hagglund, Automatica 20 (1984) 645-651; B. D.
Tyreus and W. L. Luyben, Industrial and Engineering Chemistry Research 31 (1992) 2625-2628.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl.controllers.base import plain
from smpl.controllers.lqr import sampled
from smpl.controllers.names import action_index, measured, operating_action, operating_point
from smpl.controllers.pid import PID
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_number
from smpl.support.names import listing

# Names of rules: K over the ultimate gain, T_i and T_d over the ultimate period.
RULES = {
    "ziegler_nichols_pi": (0.45, 1 / 1.2, 0.0),
    "ziegler_nichols": (0.6, 0.5, 0.125),
    "tyreus_luyben_pi": (1 / 3.2, 2.2, 0.0),
    "tyreus_luyben": (1 / 2.2, 2.2, 1 / 6.3),
}


@dataclass(frozen=True)
class Lag:
    """A process of first or second order with delay: k exp(-theta s) / ((tau s + 1)(tau_2 s + 1)).

    Attributes:
        gain: k, or the slope k' = k/tau where it integrates.
        delay, lag, second_lag: theta, tau, tau_2; an infinite tau integrates.
    """

    gain: float
    delay: float
    lag: float
    second_lag: float = 0.0


def simc(process: Lag, closed_loop: float | None = None) -> tuple[float, float, float]:
    """Gain, integral and derivative time by Skogestad's rules, of the parallel (ideal) form.

    Args:
        process: the reduced process; with a second lag the rule has a derivative.
        closed_loop: tau_c, the wanted time constant; the delay if none ("tight control").

    Raises:
        ValueError: neither a delay nor tau_c, so that the gain has no limit.
    """
    theta, tau = process.delay, process.lag
    tau_c = theta if closed_loop is None else as_number("closed_loop", closed_loop)
    if not (tau_c + theta > 0 and process.gain != 0):
        raise ValueError(
            f"a gain of {process.gain} with delay {theta} and closed_loop {tau_c}: expected a gain that is not 0, and"
            " a delay or a closed-loop time constant above zero"
        )
    slope = process.gain if math.isinf(tau) else process.gain / tau
    gain = 1 / (slope * (tau_c + theta))
    integral = min(tau, 4 * (tau_c + theta))
    # From the series form of the paper to the parallel one, its equation (36).
    factor = 1 + process.second_lag / integral
    return gain * factor, integral * factor, process.second_lag / factor


def half_rule(
    gain: float, lags: Sequence[float], delay: float = 0.0, inverse: Sequence[float] = (), order: int = 1
) -> Lag:
    """Skogestad's half rule: the first neglected lag counts half as delay and half as lag.

    Args:
        gain: steady gain.
        lags: time constants of the denominator.
        delay: dead time.
        inverse: time constants T of numerators (1 - T s).
        order: 1 or 2 lags that stay.
    """
    if order not in (1, 2) or not lags or min(lags) < 0:
        raise ValueError(f"order is {order}, lags {list(lags)}: expected order 1 or 2 and lags that are not negative")
    sorted_lags = [*sorted(lags, reverse=True), 0.0, 0.0]
    kept, first, rest = sorted_lags[:order], sorted_lags[order], sorted_lags[order + 1 :]
    kept[-1] += first / 2
    theta = delay + first / 2 + sum(rest) + sum(inverse)
    return Lag(gain, theta, kept[0], kept[1] if order == 2 else 0.0)


def step_response(
    model: Model,
    measurement: str,
    action: str,
    at: tuple[Any, Any] | None = None,
    p: Mapping[str, float] | None = None,
) -> Lag:
    """First order with delay from the times of 28.3 and 63.2 % of the linear step response.

    A response that does not come to rest within a thousand intervals is an integrator: its slope at
    the end, and the delay at which that line begins. A stable process with a delay of less than
    half a sampling interval has that delay: the controller is a sampled one.

    Args:
        model: any model; the measurement is one of its observations, else a state.
        measurement, action: names.
        at, p: where it is linearised, as for `LQR`.

    Raises:
        ValueError: an unknown name, no effect, or an unstable process.
    """
    y, u = operating_point(model, at, p)
    A, B, C, D = model.linearize(y, u, p, minimal=False)
    column = action_index(model, action)
    row, through = _output(model, measurement, C, D[:, column])
    unstable = np.linalg.eigvals(A).real.max(initial=0.0)
    if unstable > 1e-7 / model.step:
        raise ValueError(
            f"{model.name} is unstable at this point (eigenvalue {unstable:.4g}/{model.time_unit}): "
            "SIMC needs a stable process; use LQR, or the relay experiment"
        )
    response = _response(A, B[:, column], row, through, model.step)
    return _reduce(response, model.step, f"{measurement} by {action}")


def tune(
    model: Model,
    measurement: str,
    action: str,
    *,
    closed_loop: float | None = None,
    at: tuple[Any, Any] | None = None,
    p: Mapping[str, float] | None = None,
    **options: Any,
) -> PID:
    """A PI loop tuned by SIMC from the step response of the linearised model.

    Args:
        model, measurement, action, at, p: as for `step_response`.
        closed_loop: tau_c in the model's unit of time.
        options: further arguments of `PID`.
    """
    gain, integral, derivative = simc(step_response(model, measurement, action, at, p), closed_loop)
    options.setdefault("sees", "observation" if measurement in model.observation_names else "state")
    return PID(measurement, action, gain, integral, derivative, **options)


@dataclass(frozen=True)
class Ultimate:
    """Result of a relay experiment: the signed gain at which a loop oscillates, and the period."""

    gain: float
    period: float

    def rule(self, name: str = "tyreus_luyben_pi") -> tuple[float, float, float]:
        """Gain, integral and derivative time by one of `RULES`.

        Raises:
            ValueError: there is no such rule.
        """
        if name not in RULES:
            raise ValueError(f"rule is {name!r}; there are: {', '.join(RULES)}")
        gain, integral, derivative = RULES[name]
        return gain * self.gain, integral * self.period, derivative * self.period


def relay(
    env: Env,
    measurement: str,
    action: str,
    amplitude: float,
    *,
    sign: float = 1.0,
    hysteresis: float = 0.0,
    set_point: float | None = None,
    cycles: int = 6,
    sees: str = "observation",
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
) -> Ultimate:
    """Relay experiment: the action jumps by +-amplitude when the measurement crosses its set-point.

    Args:
        env: the environment; it is reset, by default to its steady state.
        measurement, action, sees: as for `PID`.
        amplitude: of the action, physical units.
        sign: -1 where a larger action lowers the measurement.
        hysteresis: half width of the band around the set-point in which the relay stays; above the
            noise.
        set_point: that of the steady state if none.
        cycles: how many are waited for; the last two count.
        seed, options: of the reset.

    Raises:
        ValueError: the loop does not oscillate within the episode.
    """
    env = plain(env)
    amplitude, cycles = abs(as_number("amplitude", amplitude)), as_count("cycles", cycles, 3, "at least 3")
    column, base = action_index(env.model, action), operating_action(env)
    env.reset(seed=seed, options=dict(options or {"start": "steady"}))
    seen = measured(env, measurement, sees)
    goal = seen.steady(env) if set_point is None else as_number("set_point", set_point)
    state = 1.0
    crossings: list[int] = []
    values: list[float] = []
    over = False
    while not over and len(crossings) <= 2 * cycles:
        error = goal - seen.value(env)
        values.append(-error)
        wanted = state if abs(error) <= hysteresis else math.copysign(1.0, error)
        if wanted != state:
            crossings.append(len(values) - 1)
        state = wanted
        chosen = base.copy()
        chosen[column] += sign * state * amplitude
        _, _, terminated, truncated, _ = env.step(env.from_physical(chosen))
        over = terminated or truncated
    if len(crossings) < 5:
        raise ValueError(
            f"{measurement} crossed its set-point {len(crossings)} times in {len(values)} steps, expected 5 or more: "
            "more max_steps, another amplitude or sign, or less hysteresis"
        )
    last = crossings[-5:]
    period = (last[-1] - last[0]) / 2 * env.model.step
    swing = np.ptp(np.asarray(values[last[0] : last[-1] + 1])) / 2
    # Describing function of a relay with hysteresis.
    limited = math.sqrt(max(swing**2 - hysteresis**2, 1e-300))
    return Ultimate(math.copysign(4 * amplitude / (math.pi * limited), sign), period)


def _output(model: Model, name: str, C: FloatArray, through: FloatArray) -> tuple[FloatArray, float]:
    """Row of an observation or a state, and its direct effect."""
    if name in model.observation_names:
        index = model.observation_names.index(name)
        return C[index], float(through[index])
    if name in model.state_names:
        return np.eye(len(model.state_names))[model.state_names.index(name)], 0.0
    known = listing(model.observation_names, model.observation_units)
    raise ValueError(
        f"measurement {name!r} is neither an observation nor a state of {model.name}; observed are: {known}"
    )


def _response(A: FloatArray, b: FloatArray, c: FloatArray, d: float, step: float) -> FloatArray:
    """Unit-step response at a thousand instants that reach ten times the slowest time constant."""
    rates = np.abs(np.linalg.eigvals(A).real)
    slow = rates[rates > 1e-9 / step].min(initial=1 / step)
    interval = max(10 / slow, 20 * step) / 1000
    Ad, Bd = sampled(A, b[:, None], interval)
    x, values = np.zeros(len(b)), [d]
    for _ in range(1000):
        x = Ad @ x + Bd[:, 0]
        values.append(float(c @ x) + d)
    return np.stack([interval * np.arange(1001), values])


def _reduce(response: FloatArray, step: float, what: str) -> Lag:
    times, values = response
    end = values[-1]
    slope = (values[-1] - values[-101]) / (times[-1] - times[-101])
    if max(abs(values)) == 0.0:
        raise ValueError(f"{what}: the action has no effect on the measurement")
    if abs(slope * times[-1]) > 0.2 * abs(end):
        return Lag(slope, max(times[-1] - end / slope, 0.0) + step / 2, math.inf)
    # The first time at which the response is there, between two instants.
    fraction = np.maximum.accumulate(values / end)
    early, late = np.interp([1 - math.exp(-1 / 3), 1 - math.exp(-1)], fraction, times)
    lag = 1.5 * (late - early)
    return Lag(end, max(late - lag, 0.0) + step / 2, lag)
