"""Windows of a batch of episodes that are linear in the actions, for policy gradients.

The batch runs as in any other training. `smpl.analysis.sensitivity.linearize_rollout` then has the
exact derivatives of states, rewards and observations by all actions of the window, across events,
updates and phases. The actions of the centre of a formulation follow the states and observations
that it reads; what it remembers counts as given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.analysis.sensitivity import linearize_rollout
from smpl.learning.environments import FormulatedVectorEnv
from smpl.policies import Rows
from smpl.support.arguments import FloatArray

Array = npt.NDArray[Any]
# Difference of an episode and its derivation, relative to the largest value, beyond which the model
# remembers what the derivation is not given.
_SAME = 1e-3
# Smallest value that differences are relative to.
_TINY = 1e-6
# Difference of an action, relative to its range, for derivatives of a formulation.
_SMALL = 1e-5


@dataclass(frozen=True)
class Window:
    """Steps of a batch in a formulation; arrays are (steps, environments, ...).

    Attributes:
        seen: observations of the learner before each step.
        rows: inputs of the centre before each step.
        parameters, discrete: parameters of the episode and discrete variables before each step.
        disturbances: those of each step; of the next episode where one ends.
        actions: of the learner.
        physical: actions of the process.
        rewards: of the learner.
        terminated, truncated: ends of episodes.
        following: observations of the learner after each step, in the same episode.
    """

    seen: FloatArray
    rows: Sequence[Rows]
    parameters: FloatArray
    discrete: FloatArray
    disturbances: FloatArray
    actions: FloatArray
    physical: FloatArray
    rewards: FloatArray
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    following: FloatArray

    @property
    def done(self) -> npt.NDArray[np.bool_]:
        """True where an episode ends."""
        return self.terminated | self.truncated

    @property
    def cut(self) -> npt.NDArray[np.bool_]:
        """True for steps that are not derived: an end that jumps, or has unknown disturbances."""
        return self.done if self.disturbances.shape[-1] else self.terminated


def collect(batch: FormulatedVectorEnv, seen: Array, act: Callable[[Array, int], Array], steps: int) -> Window:
    """Run a batch with same-step autoreset for a window.

    Args:
        batch: after its reset.
        seen: its present observations.
        act: the actions of the learner for observations and the number of the step.
        steps: length of the window.
    """
    columns: list[tuple[Any, ...]] = []
    for step in range(steps):
        rows = replace(batch.rows, steps=batch.rows.steps.copy(), memory=[dict(one) for one in batch.rows.memory])
        before = _values(batch, "parameter"), _values(batch, "discrete")
        actions = act(seen, step)
        physical = batch.form.physical(batch.rows, actions)
        after, rewards, terminated, truncated, infos = batch.step(actions)
        following = np.array(after, dtype=np.float64)
        for i in np.flatnonzero(terminated | truncated):
            following[i] = infos["final_obs"][i]
        values = *before, _values(batch, "disturbance"), actions, physical, rewards
        columns.append((seen.astype(np.float64), rows, *values, terminated, truncated, following))
        seen = after
    parts = list(zip(*columns, strict=True))
    arrays = [np.stack(part) if at != 1 else part for at, part in enumerate(parts)]
    return Window(*arrays)  # type: ignore[arg-type]


def _values(batch: FormulatedVectorEnv, role: str) -> FloatArray:
    return np.array(batch.get_attr(role), dtype=np.float64).reshape(batch.num_envs, -1)


@dataclass(frozen=True)
class Piece:
    """Steps of some environments between resets, linear in the K actions that are derived by.

    Attributes:
        first: number of the first step in the window.
        places: environments, (n,).
        seen: observations before each step and after the last one, (n, L + 1, observations).
        seen_by: their derivatives, (n, L + 1, observations, K).
        rewards: of the learner, (n, L).
        rewards_by: their derivatives, (n, L, K).
        actions: of the learner, (n, L, learned).
        moved: derivatives of the actions of a step by those of the learner, (n, L, K / L, learned).
        centred: derivatives of these actions through the centre, (n, L, K / L, K).
    """

    first: int
    places: npt.NDArray[np.intp]
    seen: FloatArray
    seen_by: FloatArray
    rewards: FloatArray
    rewards_by: FloatArray
    actions: FloatArray
    moved: FloatArray
    centred: FloatArray


def pieces(window: Window, batch: FormulatedVectorEnv, threads: int | None = None) -> list[Piece]:
    """The parts of a window between resets, with derivatives.

    The reward of a step that terminates an episode jumps, and has no derivative. Such a step is
    left out, and the piece ends with the value of the state before it.

    Raises:
        NotImplementedError: an episode is not a function of states, given values and actions.
        SimulationError: a step has no derivative.
    """
    return [
        _derived(window, batch, first, length, places, threads) for first, length, places in _parts(window)
    ]  # fmt: skip


def _parts(window: Window) -> Iterator[tuple[int, int, npt.NDArray[np.intp]]]:
    """First step, length and environments of pieces that begin at the same step of an episode."""
    found: dict[tuple[int, int, int], list[int]] = {}
    steps, count = window.rewards.shape
    for i in range(count):
        ends = [*np.flatnonzero(window.done[:, i]).tolist(), steps - 1]
        first = 0
        for last in dict.fromkeys(ends):
            length = last - first + (not window.cut[last, i])
            if length:
                found.setdefault((first, length, int(window.rows[first].steps[i])), []).append(i)
            first = last + 1
    for (first, length, _), places in found.items():
        yield first, length, np.array(places, dtype=np.intp)


def _derived(
    window: Window,
    batch: FormulatedVectorEnv,
    first: int,
    length: int,
    places: npt.NDArray[np.intp],
    threads: int | None,
) -> Piece:
    model, span = batch.model, slice(first, first + length)
    physical = window.physical[span, places].swapaxes(0, 1)
    chosen = _moving(batch, window.physical)
    found = linearize_rollout(
        model,
        window.rows[first].states[places],
        physical,
        _given(window, batch, span, places),
        by=("action",),
        actions_by=[batch.action_names[i] for i in chosen],
        threads=threads,
        first_step=int(window.rows[first].steps[places[0]]),
    )
    at = model.reward_names.index(model.reward)
    # With one step the arrays of a rollout have no axis of steps.
    shape = (len(places), length)
    states, measured, gains = (
        one.reshape(*shape, *one.shape[-2:]) for one in (found.dx_du, found.dy_du, found.dr_du)
    )  # fmt: skip
    earned = found.rewards.reshape(*shape, -1)[..., at]
    _check_same(window, batch, (first, places), found.states.reshape(*shape, -1), earned)
    seen = np.concatenate([window.seen[span, places], window.following[first + length - 1, places][None]])
    seen_by = np.zeros((*shape[:1], length + 1, seen.shape[-1], states.shape[-1]))
    for step in range(1, length + 1):
        seen_by[:, step] = batch.form.slopes(seen[step])[..., None] * measured[:, step - 1]
    moved, centred = _actions_by(window, batch, (first, length, places, chosen), states, measured)
    scaled = _slope(batch, earned)[..., None] * gains[:, :, at]
    return Piece(
        first,
        places,
        seen.swapaxes(0, 1),
        seen_by,
        window.rewards[span, places].T,
        scaled,
        window.actions[span, places].swapaxes(0, 1),
        moved,
        centred,
    )


def _given(
    window: Window, batch: FormulatedVectorEnv, span: slice, places: npt.NDArray[np.intp]
) -> dict[str, FloatArray]:
    """Discrete variables, disturbances, and parameters that are not the declared ones."""
    model, first = batch.model, span.start
    given = dict(zip(model.discrete_names, window.discrete[first, places].T, strict=True))
    parameters = window.parameters[first, places]
    changed = (parameters != model.native.defaults("parameter")).any(axis=0)
    given |= {name: parameters[:, i] for i, name in enumerate(model.parameter_names) if changed[i]}
    each = window.disturbances[span, places].T
    # Values of a single step have no axis of steps.
    each = each[..., 0] if each.shape[-1] == 1 else each
    return given | dict(zip(model.disturbance_names, each, strict=True))


def _moving(batch: FormulatedVectorEnv, physical: FloatArray) -> list[int]:
    """Actions that are learned, and those of the centre that are not the same everywhere."""
    varying = np.ptp(physical.reshape(-1, physical.shape[-1]), axis=0) > 0
    varying[batch.form.learned] = True
    return np.flatnonzero(varying).tolist()


def _slope(batch: FormulatedVectorEnv, earned: FloatArray) -> FloatArray:
    """Derivative of the learner's reward by that of the process."""
    formulation = batch.form.formulation
    scaled = earned * formulation.reward_scale
    low, high = formulation.reward_range or (-np.inf, np.inf)
    return np.where((scaled > low) & (scaled < high), formulation.reward_scale, 0.0)


def _check_same(
    window: Window,
    batch: FormulatedVectorEnv,
    where: tuple[int, npt.NDArray[np.intp]],
    states: FloatArray,
    earned: FloatArray,
) -> None:
    """An error where the episodes are not what the derivation made of states and actions."""
    (first, places), length = where, earned.shape[1]
    inner = range(first, first + length)
    given = batch.form.formulation.reward(earned, np.zeros(earned.shape, dtype=bool))
    pairs = [("the reward", given[:, k - first], window.rewards[k, places], ~window.done[k, places]) for k in inner]
    whole = np.abs([rows.states for rows in window.rows]).max(axis=(0, 1))
    sizes = [np.abs(window.rewards).max()] * len(pairs)
    for k in inner[1:]:
        pairs += [
            (name, states[:, k - 1 - first, i], window.rows[k].states[places, i], np.ones(len(places), bool))
            for i, name in enumerate(batch.model.state_names)
        ]
        sizes += whole.tolist()
    for (name, here, there, valid), size in zip(pairs, sizes, strict=True):
        if np.any(valid & (np.abs(here - there) > _SAME * max(size, _TINY))):
            worst = int(np.argmax(np.abs(here - there) * valid))
            raise NotImplementedError(
                f"{batch.model.name}: {name} of an episode is {there[worst]:.6g}, but {here[worst]:.6g} from its "
                "states, discrete variables, disturbances and actions: keep initial or earlier values in discrete "
                "variables"
            )


def _actions_by(
    window: Window,
    batch: FormulatedVectorEnv,
    which: tuple[int, int, npt.NDArray[np.intp], list[int]],
    states: FloatArray,
    measured: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Derivatives `moved` and `centred` of a piece, by differences of the formulation."""
    first, length, places, chosen = which
    width = len(chosen)
    moved = np.zeros((len(places), length, width, window.actions.shape[-1]))
    centred = np.zeros((len(places), length, width, length * width))
    learned = window.actions.shape[-1]
    scale = batch.observation_high - batch.observation_low
    factor = np.where(np.isfinite(scale) & (scale > 0) & bool(batch.normalize), 2 / scale, 1.0)
    sizes = _SMALL * np.where(np.isfinite(ranges := batch.action_high - batch.action_low), ranges, 1.0)
    for step in range(length):
        rows, actions = _taken(window.rows[first + step], places), window.actions[first + step, places]
        for j in range(learned):
            shift = _SMALL * np.eye(learned)[j]
            up, down = (batch.form.physical(rows, actions + sign * shift) for sign in (1, -1))
            moved[:, step, :, j] = (up - down)[:, chosen] / (2 * _SMALL)
        if step and not batch.form.follows_step:
            active = step * width
            by = states[:, step - 1, :, :active], factor[:, None] * measured[:, step - 1, :, :active]
            found = _differences(batch, rows, actions, by, np.tile(sizes[chosen], step))
            centred[:, step, :, :active] = found[:, chosen]
    return moved, centred


def _differences(
    batch: FormulatedVectorEnv, rows: Rows, actions: FloatArray, by: tuple[FloatArray, FloatArray], sizes: FloatArray
) -> FloatArray:
    """Derivatives of all actions along K directions of states and observations, (n, actions, K).

    At a kink or a jump it is the smaller of the two one-sided differences.
    """
    count, directions = len(actions), len(sizes)
    middle = batch.form.physical(rows, actions)[:, :, None]
    every = _taken(rows, np.repeat(np.arange(count), directions))
    sides = []
    for sign in (1, -1):
        shifts = [sign * np.swapaxes(one * sizes, 1, 2).reshape(count * directions, -1) for one in by]
        moved = replace(every, states=every.states + shifts[0], observations=every.observations + shifts[1])
        given = batch.form.physical(moved, np.repeat(actions, directions, axis=0))
        sides.append(sign * (given.reshape(count, directions, -1).swapaxes(1, 2) - middle) / sizes)
    up, down = sides
    agree = np.abs(up - down) <= 0.5 * np.maximum(np.abs(up), np.abs(down))
    return np.where(agree, (up + down) / 2, np.where(np.abs(up) < np.abs(down), up, down))


def _taken(rows: Rows, places: npt.NDArray[np.intp]) -> Rows:
    """Some of the rows, with observations in double precision."""
    return replace(
        rows,
        observations=rows.observations[places].astype(np.float64),
        states=rows.states[places],
        steps=rows.steps[places],
        memory=[dict(rows.memory[i]) for i in places],
        places=places if rows.places is None else rows.places[places],
    )
