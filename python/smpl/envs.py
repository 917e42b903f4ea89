"""The Gymnasium environment."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from smpl import _native
from smpl.analysis.rollout import Rollout, rollout
from smpl.model import Model, compile
from smpl.rendering import History
from smpl.support.arguments import FloatArray, as_flag, as_mapping, as_vector, check_limit, check_method
from smpl.support.compiling import Setting, as_variants
from smpl.support.names import Named
from smpl.support.options import listed
from smpl.support.reset_options import start_from_options
from smpl.support.scaling import NOMINAL, as_normalize, from_share, from_unit, to_share, to_unit
from smpl.support.seeds import check_seed, native_seed

Observation = npt.NDArray[np.float32]


class ResetNeeded(gymnasium.error.ResetNeeded, _native.SimulationError):
    """A step without a running episode: Gymnasium's own error, and a `SimulationError`."""


class Interface(Named):
    """Names, units, bounds and single spaces of an environment."""

    model: Model
    normalize: bool | str
    constraint_names: tuple[str, ...]
    action_low: FloatArray
    action_high: FloatArray
    observation_low: FloatArray
    observation_high: FloatArray

    def _describe(self, model: Model, normalize: bool | str) -> tuple[Box, Box]:
        """Set everything but the spaces; return those of observations and actions."""
        self.model, self.normalize = model, as_normalize(normalize)
        self._share_names(model)
        self.action_low, self.action_high = model.action_low, model.action_high
        self.observation_low, self.observation_high = model.observation_low, model.observation_high
        return (
            _box(self.observation_low, self.observation_high, bool(normalize)),
            _box(self.action_low, self.action_high, bool(normalize)),
        )

    def to_physical(self, action: npt.ArrayLike) -> FloatArray:
        """An action of the action space in physical units; the bound if both bounds coincide."""
        values = np.asarray(action, dtype=np.float64)
        if not self.normalize:
            return values
        if self.normalize == NOMINAL:
            return from_share(values, self.action_low, self.model.action_nominal, self.action_high)
        return from_unit(values, self.action_low, self.action_high)

    def from_physical(self, action: npt.ArrayLike) -> FloatArray:
        """A physical action in the action space; 0 if both bounds coincide."""
        values = np.asarray(action, dtype=np.float64)
        if not self.normalize:
            return values
        if self.normalize == NOMINAL:
            return to_share(values, self.action_low, self.model.action_nominal, self.action_high)
        return to_unit(values, self.action_low, self.action_high)


class Env(Interface, gymnasium.Env[Any, Any]):
    """A process model as a Gymnasium environment.

    Actions and observations are `float32` boxes: [-1, 1], or physical units with `normalize=False`.
    Arithmetic is in double precision whatever the type of an action. Observations are
    clipped to their bounds; one whose bounds are not finite is never normalised.

    Args:
        model: a compiled model, an environment (of which the model is taken), a path or the name of
            a shipped model.
        normalize: scale actions and observations to [-1, 1] by their bounds: 0 is the middle of the
            box. With `"nominal"`, 0 of an action is its nominal value (the declared default) and -1
            and 1 are its bounds, linear on each side.
        dense_reward: if false, the reward is 0 but in the last step, which brings the sum.
        reward: name of the reward that `step` returns.
        observation: observation level (`default`, `full`, or one of the model's).
        scenario, variants, settings: as for `smpl.compile`; not with a compiled model.
        max_steps: time limit instead of the scenario's.
        render_mode: `rgb_array`, `ansi` or none.
        info_state: add the state to `info`.
        method: integration method, `ida`, `rosenbrock`, `explicit` or `auto`, instead of the
            model's or scenario's.
        max_step: longest internal step in the model's unit of time, as the setting of this name;
            not with a compiled model.
        extra: statements that follow those of the file, as for `smpl.compile`; not with a compiled
            model.

    Attributes:
        model: the compiled model.
        state_names, algebraic_names, discrete_names, action_names, observation_names, reward_names:
            names; units are `state_units` and so on.
        action_low, action_high, observation_low, observation_high: bounds in physical units.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": ["rgb_array", "ansi"],
        "render_fps": 10,
    }

    @listed
    def __init__(
        self,
        model: Model | Interface | str | os.PathLike[str],
        *,
        normalize: bool | str = True,
        dense_reward: bool = True,
        reward: str | None = None,
        observation: str = "default",
        scenario: str | os.PathLike[str] | None = None,
        variants: Iterable[str] = (),
        settings: Mapping[str, Setting] | None = None,
        max_steps: int | None = None,
        render_mode: str | None = None,
        info_state: bool = False,
        method: str | None = None,
        max_step: float | None = None,
        extra: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is {render_mode!r}; there are: {', '.join(self.metadata['render_modes'])}")
        compiled = choose_model(model, observation, reward, scenario, variants, settings, extra, max_step)
        self.observation_space, self.action_space = self._describe(compiled, normalize)
        self.render_mode = render_mode
        flags = as_flag("dense_reward", dense_reward), as_flag("info_state", info_state)
        self._options = (self.normalize, *flags, check_limit(max_steps), check_method(method))
        self._native = _native.Env(compiled.native, *self._options)
        self.constraint_names = tuple(self._native.constraint_names)
        self.max_steps = self._native.max_steps
        self._seeded = False
        self._returned: Observation | None = None
        self._history: Any = None
        if render_mode is not None:
            self._history = History(self)

    def __repr__(self) -> str:
        scaled = "" if self.normalize is True else f", normalize={self.normalize!r}"
        return f"<smpl.Env {self.model.name}: level {self.model.level!r}, reward {self.model.reward!r}{scaled}>"

    # Gymnasium's interface.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        An episode is a function of the seed and of its number since that seed was given: with a
        seed it is the first one, without the next one. An environment that was never given a seed
        draws one.

        Args:
            seed: seed of the random numbers, an integer that is not negative.
            options: see `smpl.support.reset_options.start_from_options`; what is set is what is
                simulated.

        Raises:
            ValueError: an unknown option or name, a wrong shape, or an invalid seed (also
                `gymnasium.error.Error`).
        """
        start = start_from_options(self.model, options)
        seed = check_seed(seed)
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**63))
        self._seeded = True
        result = self._native.reset(None if seed is None else native_seed(seed), start)
        self._returned = result[0]
        if self._history is not None:
            self._history.start()
        return result

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action over one sampling interval.

        Raises:
            ValueError: the action has a wrong shape or is NaN; nothing is stepped then.
            gymnasium.error.ResetNeeded: the episode is over, or has not begun.
        """
        try:
            try:
                result = self._native.step(action)
            except TypeError:  # not a plain vector of floating-point numbers: nothing was stepped
                result = self._native.step(as_vector("action", action, len(self.action_low)))
        except _native.SimulationError as error:
            raise_ended(error)
        self._returned = result[0]
        if self._history is not None:
            self._history.add(result)
        return result

    def render(self) -> Any:
        """The episode so far: a picture (`rgb_array`, (height, width, 3)) or text (`ansi`)."""
        if self._history is None:
            gymnasium.logger.warn("render() without a render_mode: give one of rgb_array, ansi to make()")
            return None
        return self._history.render(self.render_mode)

    def picture(self, show: str | Sequence[str] = ()) -> _native.Picture:
        """The episode so far as a picture, as `smpl simulate --plot` draws it.

        Args:
            show: names of quantities, `states`, `actions` and so on; a sensible choice where it is
                empty.

        Raises:
            ValueError: the environment was made without a `render_mode`, there is no episode, or an
                unknown name.
        """
        if self._history is None:
            raise ValueError("nothing is recorded without a render_mode: give rgb_array or ansi to make()")
        return self._history.picture([show] if isinstance(show, str) else show)

    def _repr_html_(self) -> str | None:
        """The episode so far, in a notebook; none without a `render_mode` or an episode."""
        if self._history is None or not self._history.is_recorded:
            return None
        return self.picture()._repr_html_()

    def _repr_svg_(self) -> str | None:
        """The episode so far; none without a `render_mode` or an episode."""
        if self._history is None or not self._history.is_recorded:
            return None
        return self.picture().svg()

    @property
    def native(self) -> _native.Env:
        """The compiled part."""
        return self._native

    # What is beneath the observation.

    @property
    def state(self) -> FloatArray:
        """A copy of the differential states, physical units, order of `state_names`."""
        return self._native.values("state")

    @property
    def reading(self) -> FloatArray:
        """The last observation in physical units, with noise and delay.

        Raises:
            ValueError: nothing was observed since the environment was made or restored from a
                snapshot.
        """
        if self._returned is None:
            raise ValueError("nothing was observed yet: call reset or step first")
        values = self._returned.astype(np.float64)
        if not self.normalize:
            return values
        return from_unit(values, self.observation_low, self.observation_high)

    @property
    def algebraic(self) -> FloatArray:
        """A copy of the algebraic variables, order of `algebraic_names`."""
        return self._native.values("algebraic")

    @property
    def discrete(self) -> FloatArray:
        """A copy of the discrete variables, order of `discrete_names`."""
        return self._native.values("discrete")

    @property
    def action(self) -> FloatArray:
        """A copy of the last applied action, physical units, order of `action_names`."""
        return self._native.values("action")

    @property
    def time(self) -> float:
        """Time since the start of the episode, in the model's unit of time."""
        return self._native.time

    @property
    def steps(self) -> int:
        """Number of completed steps of the episode."""
        return self._native.steps

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the episode by name."""
        return dict(zip(self.model.parameter_names, self._native.values("parameter").tolist(), strict=True))

    @property
    def steady_state(self) -> FloatArray | None:
        """Steady state of the model's `steady` block with the episode's parameters, or None.

        Raises:
            SimulationError: where the block has no solution and nothing needs it.
        """
        return self._native.steady_state

    @property
    def steady_action(self) -> FloatArray | None:
        """Action of that steady state."""
        return self._native.steady_action

    @property
    def episode(self) -> tuple[int, int]:
        """Seed of the running episode and its number since that seed, for random numbers."""
        return self._native.episode

    def policy(self, name: str) -> FloatArray:
        """Actions in physical units that a policy of the model chooses for the coming step.

        Args:
            name: one of `model.policies`; `smpl.controllers.Policy` runs one as a controller.

        Raises:
            ValueError: the model declares no such policy.
        """
        return self._native.policy(name)

    @property
    def solver_statistics(self) -> dict[str, int]:
        """Counts of the solver since the start of the episode: steps, residuals, Jacobians, ..."""
        return self._native.solver_statistics

    def snapshot(self) -> _native.Snapshot:
        """All that the environment would go on from, to be given to `restore`."""
        return self._native.snapshot()

    def restore(self, snapshot: _native.Snapshot) -> None:
        """Go back to a snapshot of this environment, or of another one of the same model.

        Raises:
            ValueError: the snapshot is of another model, or damaged.
        """
        self._native.restore(snapshot)
        self._returned = None
        if self._history is not None:
            self._history.go_back()

    def rollout(
        self, actions: npt.ArrayLike, seed: int | None = None, threads: int | None = None, *, outputs: bool = False
    ) -> Rollout:
        """Simulates actions from the present state; the environment does not change.

        Args:
            actions: physical units: (N, H, actions), or (H, actions).
            seed: random numbers of trajectory i are those of seed + i. Without one they are at
                their means, and observations without noise.
            threads, outputs: as for `smpl.Model.rollout`.

        Raises:
            ValueError: a wrong shape, or a NaN; there is no running episode.
        """
        *_, limit, method = self._options
        return rollout(
            self.model,
            self.snapshot(),
            actions,
            seed=seed,
            method=method,
            threads=threads,
            outputs=outputs,
            max_steps=limit,
        )

    # Copies and pickles go on where the original is. A copy shares the model; a pickle names it,
    # and the snapshot in it identifies the file found under that name.

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_native": self.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._native = _native.Env(self.model.native, *self._options)
        self._native.restore(state["_native"])


def choose_model(
    model: Model | Interface | str | os.PathLike[str],
    observation: str,
    reward: str | None,
    scenario: str | os.PathLike[str] | None,
    variants: Iterable[str],
    settings: Mapping[str, Setting] | None,
    extra: str | None = None,
    max_step: float | None = None,
) -> Model:
    """The compiled model that an environment's arguments ask for.

    Raises:
        ValueError: a compiled model is given together with a scenario, variants, settings or
            further statements.
    """
    given: Any = model.unwrapped if isinstance(model, gymnasium.Wrapper) else model
    model = given.model if isinstance(given, Interface) else given
    if max_step is not None:
        settings = {**as_mapping("settings", settings), "max_step": max_step}
    if not isinstance(model, Model):
        return compile(
            model,
            scenario=scenario,
            variants=variants,
            settings=settings,
            observation=observation,
            reward=reward,
            extra=extra,
        )
    if scenario is not None or as_variants(variants) or as_mapping("settings", settings):
        raise ValueError("the model is compiled already: give scenario, variants and settings to smpl.compile")
    if extra is not None:
        raise ValueError("the model is compiled already: give extra to smpl.compile")
    changes = {
        key: value
        for key, value, default in (("observation", observation, "default"), ("reward", reward, None))
        if value != default
    }
    return model.variant_of(**changes) if changes else model


def raise_ended(error: _native.SimulationError) -> NoReturn:
    """Raise the error of a step, as `ResetNeeded` if no episode runs."""
    if "the episode is over" in str(error):
        raise ResetNeeded(str(error)) from None
    raise error


def _box(low: FloatArray, high: FloatArray, normalize: bool) -> Box:
    """Space with these bounds; those that are finite become -1 and 1 if normalised."""
    if normalize:
        finite = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(finite, -1.0, low), np.where(finite, 1.0, high)
    return Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
