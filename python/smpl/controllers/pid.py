"""Proportional-integral-derivative control of any model, by names.

The algorithm is that of K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (1997), section
8.5: set-point weight, filtered derivative of the measurement by backward differences, integral by
forward differences, and back calculation against windup. With the sampling interval h, set-point r,
measurement y:

    P_k = K (b r_k - y_k)

    D_k = T_d/(T_d + N h) D_(k-1) - K T_d N/(T_d + N h) (y_k - y_(k-1))

    v_k = P_k + I_k + D_k,  u_k = saturated v_k

    I_(k+1) = I_k + K h/T_i (r_k - y_k) + h/T_t (u_k - v_k)
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from smpl.controllers.base import TakesWrapped
from smpl.controllers.names import Measured, action_index, measured, operating_action, slow_gain
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_finite_number, as_mapping, as_number
from smpl.support.options import Options, takes

SetPoint = float | Callable[[float], float]
FORMS = ("positional", "velocity")
ANTI_WINDUP = ("back_calculation", "clamping", "none")


@dataclass(frozen=True, kw_only=True, repr=False)
class PIDOptions(Options):
    """Options of `PID`.

    Attributes:
        integral_time, derivative_time: T_i and T_d in the model's unit of time; infinite and 0 for
            none.
        set_point: in the unit of the measurement, or a function of the time; None for the model's
            steady state.
        filter: N, the largest gain of the derivative over K.
        set_point_weight: b.
        form: `positional`, or `velocity`, which computes changes of the action and cannot wind up.
        anti_windup: of the positional form: `back_calculation` with the tracking time, `clamping`
            (no integration that would drive a saturated action further) or `none`.
        tracking_time: T_t in the model's unit of time; None for sqrt(T_i T_d), or T_i if T_d is 0.
        low, high: limits of the action in its unit; None for its box.
        bumpless: the first action of an episode is the operating action: the integral is
            initialised accordingly.
        sees: `observation` (`env.reading`) or `state`.
    """

    integral_time: float = math.inf
    derivative_time: float = 0.0
    set_point: SetPoint | None = None
    filter: float = 10.0
    set_point_weight: float = 1.0
    form: str = "positional"
    anti_windup: str = "back_calculation"
    tracking_time: float | None = None
    low: float | None = None
    high: float | None = None
    bumpless: bool = False
    sees: str = "observation"


class PID(TakesWrapped):
    """One control loop, an action by a measurement; `Loops` has several, `Cascade` a series.

    Args:
        measurement: name of an observation, or of a state with `sees="state"`.
        action: name of the action.
        gain: K, units of the action over those of the measurement; negative where a larger action
            lowers the measurement.
        options: `PIDOptions`, and options as keyword arguments; `integral_time` and
            `derivative_time` may follow `gain` by position.

    Example:
        PID("T", "T_c", -2.0, 5.0, set_point=52.0)
        PID("T", "T_c", -2.0, PIDOptions(integral_time=5.0, set_point=52.0))
    """

    @takes(PIDOptions, "integral_time", "derivative_time")
    def __init__(self, measurement: str, action: str, gain: float, options: PIDOptions) -> None:
        form, anti_windup, tracking_time = options.form, options.anti_windup, options.tracking_time
        if form not in FORMS or anti_windup not in ANTI_WINDUP:
            raise ValueError(
                f"form is {form!r}, anti_windup {anti_windup!r}; there are: {', '.join(FORMS)} and "
                f"{', '.join(ANTI_WINDUP)}"
            )
        if form == "velocity" and math.isinf(options.integral_time):
            raise ValueError("the velocity form without an integral does not know its set-point: give integral_time")
        self.measurement, self.manipulated = measurement, action
        self.set_point: SetPoint | None = options.set_point
        self.view = options.sees
        self.form, self.anti_windup, self.bumpless = form, anti_windup, bool(options.bumpless)
        self._tracking = None if tracking_time is None else as_finite_number("tracking_time", tracking_time)
        if self._tracking is not None and self._tracking <= 0:
            raise ValueError(f"tracking_time is {tracking_time!r}, expected a positive number")
        self._limits = _limits(options.low, options.high)
        self.gain = self.integral_time = self.derivative_time = self.filter = self.set_point_weight = 0.0
        self.interval = 1.0
        self.low, self.high = -math.inf, math.inf
        self._set(gain, options.integral_time, options.derivative_time, options.filter, options.set_point_weight)
        self._measured: Measured | None = None
        # The model of which the sign of the gain was looked at; with other loops it does not follow
        # from this one.
        self._signed: Model | None = None
        self._alone = True
        self._index, self._base = 0, np.zeros(0)
        self.begin(0.0, None)

    # The law itself, without an environment.

    def begin(self, action: float, measurement: float | None, set_point: float = 0.0) -> None:
        """Forget the past; `action` is the one without error.

        Args:
            action: what the integral begins with.
            measurement: if given, the integral begins where the first action is `action` whatever
                the error.
            set_point: at the beginning, for that.
        """
        proportional = 0.0 if measurement is None else self.gain * (self.set_point_weight * set_point - measurement)
        # The proportional part is that of the weighted set-point: without error it is not zero
        # unless b = 1.
        self._integral = action - proportional
        self._derivative, self._last = 0.0, measurement
        self._applied, self._before = action, None if measurement is None else (proportional, 0.0)

    def update(self, measurement: float, set_point: float) -> float:
        """The saturated action for a measurement, one sampling interval after the last one."""
        proportional = self.gain * (self.set_point_weight * set_point - measurement)
        change = self._differentiate(measurement)
        error = set_point - measurement
        if self.form == "velocity":
            wanted = self._applied + self._increment(proportional, error) + change
            self._before = proportional, error
        else:
            wanted = proportional + self._integral + self._derivative
        action = min(max(wanted, self.low), self.high)
        if self.form == "positional":
            self._integrate(error, wanted, action)
        self._applied = action
        return action

    def tune(self, **changes: float) -> None:
        """Changes gain, times, filter or set_point_weight without a jump of the action."""
        known = ("gain", "integral_time", "derivative_time", "filter", "set_point_weight")
        wrong = [name for name in changes if name not in known]
        if wrong:
            raise ValueError(f"tune: unknown {', '.join(wrong)}; there are: {', '.join(known)}")
        before = self.gain, self.set_point_weight
        self._set(*(changes.get(name, getattr(self, name)) for name in known))
        if self._last is not None:
            set_point = getattr(self, "_reference", 0.0)
            old = before[0] * (before[1] * set_point - self._last)
            new = self.gain * (self.set_point_weight * set_point - self._last)
            self._integral += old - new

    def track(self, action: float) -> None:
        """Continues from an action applied instead of the last one, as by an operator."""
        if self.form == "positional":
            self._integral += action - self._applied
        self._applied = action

    def _set(self, gain: float, integral: float, derivative: float, filter: float, weight: float) -> None:
        self.gain, self.integral_time = as_number("gain", gain), as_number("integral_time", integral)
        self.derivative_time, self.filter = as_number("derivative_time", derivative), as_number("filter", filter)
        self.set_point_weight = as_number("set_point_weight", weight)
        if not (self.integral_time > 0 and self.derivative_time >= 0 and self.filter > 0 and math.isfinite(self.gain)):
            raise ValueError(
                f"gain {gain}, integral_time {integral}, derivative_time {derivative}, filter {filter}: expected a "
                "finite gain, a positive integral time (infinite for none), a derivative time that is not negative"
            )

    def _differentiate(self, measurement: float) -> float:
        """Filtered derivative part; returns its change."""
        before, last = self._derivative, measurement if self._last is None else self._last
        if self.derivative_time > 0:
            time, slope = self.derivative_time, self.filter * self.interval
            self._derivative = (time * before - self.gain * time * self.filter * (measurement - last)) / (time + slope)
        self._last = measurement
        return self._derivative - before

    def _increment(self, proportional: float, error: float) -> float:
        if self._before is None:
            return proportional
        before, last_error = self._before
        return proportional - before + self.gain * self.interval / self.integral_time * last_error

    def _integrate(self, error: float, wanted: float, action: float) -> None:
        step = self.gain * self.interval / self.integral_time * error
        if self.anti_windup == "clamping":
            if (wanted - action) * step <= 0:
                self._integral += step
            return
        self._integral += step
        if self.anti_windup == "back_calculation" and math.isfinite(self.integral_time):
            self._integral += self.interval / self._tracking_time() * (action - wanted)

    def _tracking_time(self) -> float:
        natural = self.integral_time
        if self.derivative_time > 0:
            natural = math.sqrt(self.integral_time * self.derivative_time)
        # Shorter than the interval, back calculation would overshoot.
        return max(self.interval, self._tracking or natural)

    # In an environment.

    def reset(self, env: Env) -> None:
        """Begin an episode at the operating action.

        Raises:
            ValueError: no such measurement or action, or no set-point is known.
        """
        self._attach(env)
        value, goal = self._measured_value(env), self._goal(env)
        # The integral that holds the operating action when there is no error.
        level = self._base[self._index]
        weight = self.gain * (self.set_point_weight - 1) * goal
        if self.bumpless:
            self.begin(level, value, goal)
        elif self.form == "velocity":
            self.begin(level, None)
            self._before = weight, 0.0
        else:
            self.begin(level - weight, None)

    def action(self, env: Env) -> FloatArray:
        """The operating action with this loop's own in its place."""
        chosen = self._base.copy()
        chosen[self._index] = self.next(env)
        return chosen

    def next(self, env: Env) -> float:
        """The loop's own action."""
        return self.update(self._measured_value(env), self._goal(env))

    def describe(self, env: Env) -> str:
        """The loop in one line, with units."""
        self._attach(env)
        unit = env.action_units[self._index]
        of = self._measured.unit if self._measured else "1"
        return (
            f"{self.manipulated} [{unit}] by {self.measurement} [{of}]: K = {self.gain:.6g} ({unit})/({of}), "
            f"T_i = {self.integral_time:.6g} {env.model.time_unit}, "
            f"T_d = {self.derivative_time:.6g} {env.model.time_unit}"
        )

    def _attach(self, env: Env) -> None:
        self._measured = measured(env, self.measurement, self.view)
        self._index = action_index(env.model, self.manipulated)
        self._base = operating_action(env)
        self.interval = env.model.step
        low, high = self._limits
        self.low = float(env.action_low[self._index]) if low is None else low
        self.high = float(env.action_high[self._index]) if high is None else high
        if self.low >= self.high:
            name = self.manipulated
            raise ValueError(f"low is {self.low:g} and high {self.high:g} of {name}, expected low below high")
        if self._alone and self._signed is not env.model:
            self._signed = env.model
            self._warn_of_sign(env)

    def _warn_of_sign(self, env: Env) -> None:
        """Warn where the gain has the sign that drives the measurement away from its set-point."""
        assert self._measured is not None
        slope = slow_gain(env.model, self._index, self._measured)
        if slope * self.gain < 0:
            unit = f"{self._measured.unit}/({env.action_units[self._index]})"
            text = (
                f"the gain {self.gain:g} has the wrong sign: at the steady state of {env.model.name} a larger "
                f"{self.manipulated} {'raises' if slope > 0 else 'lowers'} {self.measurement} ({slope:.3g} {unit} in "
                "the long run), so that the loop drives it away from the set-point; negate the gain"
            )
            warnings.warn(text, stacklevel=2)

    def _measured_value(self, env: Env) -> float:
        assert self._measured is not None, "reset comes before action"
        return self._measured.value(env)

    def _goal(self, env: Env) -> float:
        goal = self.set_point
        if goal is None:
            assert self._measured is not None, "reset comes before action"
            goal = self._measured.steady(env)
        self._reference = float(goal(env.time)) if callable(goal) else as_number("set_point", goal)
        return self._reference


def _limits(low: float | None, high: float | None) -> tuple[float | None, float | None]:
    """Limits of an action or set-point; a missing one is that of the action's box."""
    ends = [None if end is None else as_number(what, end) for what, end in (("low", low), ("high", high))]
    if any(end is not None and math.isnan(end) for end in ends):
        raise ValueError(f"low is {low!r} and high {high!r}, expected numbers")
    if ends[0] is not None and ends[1] is not None and ends[0] >= ends[1]:
        raise ValueError(f"low is {low!r} and high {high!r}, expected low below high")
    return ends[0], ends[1]


class Loops(TakesWrapped):
    """Several loops, each with its own action; other actions stay at the operating point.

    Args:
        loops: `PID` or `Cascade`.
        others: actions by name that are held instead of the operating ones.
    """

    def __init__(self, *loops: PID | Cascade, others: Mapping[str, float] | None = None) -> None:
        names = [loop.manipulated for loop in loops]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two loops choose the action {', '.join(twice)}")
        held = as_mapping("others", others)
        self._loops, self._others = loops, {n: as_finite_number(f"others[{n!r}]", held[n]) for n in held}
        self._signed: Model | None = None
        for loop in loops:
            if isinstance(loop, PID):
                loop._alone = len(loops) == 1
        both = [name for name in self._others if name in names]
        if both:
            raise ValueError(f"others holds {', '.join(both)}, which a loop chooses: leave one of them out")

    def reset(self, env: Env) -> None:
        """Begin an episode in all loops."""
        for name in self._others:
            action_index(env.model, name)
        for loop in self._loops:
            loop.reset(env)
        if len(self._loops) > 1 and self._signed is not env.model:
            self._signed = env.model
            self._warn_of_signs(env)

    def _warn_of_signs(self, env: Env) -> None:
        """Warns if no integrating loops with these signs are stable: det(G K) must be positive.

        A. Niederlinski, Automatica 7 (1971) 691-701.
        """
        single = [loop for loop in self._loops if isinstance(loop, PID) and loop._measured is not None]
        if len(single) < len(self._loops):
            return
        gains = np.array([[slow_gain(env.model, by._index, of._measured) for by in single] for of in single])  # type: ignore[arg-type]
        size = np.abs(gains).max(axis=1, initial=0.0)
        if (size > 0).all() and np.linalg.det(gains / size[:, None] * [np.sign(one.gain) for one in single]) < -1e-6:
            names = ", ".join(one.manipulated for one in single)
            text = (
                f"the gains of the loops of {names} have signs with which no integrating loops are stable together: at "
                f"the steady state of {env.model.name} the determinant of the slow gains times the gains is negative"
            )
            warnings.warn(text, stacklevel=2)

    def action(self, env: Env) -> FloatArray:
        """Actions of all loops."""
        chosen = operating_action(env)
        for name, value in self._others.items():
            chosen[action_index(env.model, name)] = value
        for loop in self._loops:
            chosen[action_index(env.model, loop.manipulated)] = loop.next(env)
        return chosen


class Cascade(TakesWrapped):
    """Two loops in series: the outer one chooses the set-point of the inner one.

    Args:
        outer: its `action` names the inner loop's measurement; `low` and `high` limit that
            set-point.
        inner: its `set_point` is not looked at but at the beginning, where it is the outer loop's
            operating point.
        every: the outer loop is updated every so many steps.
    """

    def __init__(self, outer: PID, inner: PID, every: int = 1) -> None:
        if outer.manipulated != inner.measurement:
            raise ValueError(
                f"the outer loop chooses {outer.manipulated}, the inner one measures {inner.measurement}: "
                "the outer loop's action must be the inner loop's measurement"
            )
        self.outer, self.inner, self._every = outer, inner, as_count("every", every)
        self.manipulated = inner.manipulated
        self._first = inner.set_point

    def reset(self, env: Env) -> None:
        """Begin an episode in both loops."""
        self.inner.set_point = self._first
        self.inner.reset(env)
        outer = self.outer
        outer._measured = measured(env, outer.measurement, outer.view)
        outer.interval = env.model.step * self._every
        low, high = outer._limits
        outer.low, outer.high = -math.inf if low is None else low, math.inf if high is None else high
        goal = outer._goal(env)
        outer.begin(self.inner._goal(env) - outer.gain * (outer.set_point_weight - 1) * goal, None)

    def next(self, env: Env) -> float:
        """The inner loop's action."""
        if env.steps % self._every == 0:
            self.inner.set_point = self.outer.next(env)
        return self.inner.next(env)

    def action(self, env: Env) -> FloatArray:
        """The operating action with this cascade's own in its place."""
        chosen = operating_action(env)
        chosen[action_index(env.model, self.manipulated)] = self.next(env)
        return chosen
