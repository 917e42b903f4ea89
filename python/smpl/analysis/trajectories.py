"""Methods of a model over control steps, see `smpl.Model`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, cast

import numpy.typing as npt

from smpl.analysis.adjoint import EpisodeGradient, gradient
from smpl.analysis.rollout import Rollout, rollout
from smpl.analysis.sensitivity import StepDerivatives, linearize_rollout, linearize_step
from smpl.support.arguments import FloatArray
from smpl.support.options import listed

if TYPE_CHECKING:
    from smpl.model import Model


class Trajectories:
    """Trajectories of a compiled model and their derivatives."""

    @listed
    def rollout(
        self,
        states: npt.ArrayLike,
        actions: npt.ArrayLike,
        parameters: Mapping[str, npt.ArrayLike] | None = None,
        discrete: Mapping[str, npt.ArrayLike] | None = None,
        disturbances: Mapping[str, npt.ArrayLike] | None = None,
        seed: int | None = None,
        method: str | None = None,
        threads: int | None = None,
        *,
        first_step: int = 0,
        outputs: bool = False,
        history: Mapping[str, npt.ArrayLike] | None = None,
    ) -> Rollout:
        """Many trajectories at once, on all cores and without the interpreter lock.

        Each trajectory is an episode from a given state: the same, bit for bit, as steps of an
        `smpl.Env` that was reset to it, for any number of threads.

        Args:
            states: differential states at the start, physical units: (N, states), or (states,) for
                all trajectories.
            actions: physical units: (N, H, actions), or (H, actions) for all trajectories.
            parameters: values by name, one for all trajectories or one for each, shape (N,).
            discrete: discrete variables at the start, likewise.
            disturbances: recorded sequences by name, (H,) for all trajectories or (N, H), or one
                number throughout.
            seed: trajectory i has the random numbers of `reset(seed=seed + i)`. Without one, random
                numbers are at their means and observations without noise: what is expected.
            method: what takes the steps, `ida`, `rosenbrock`, `explicit` or `auto`; the model's or
                scenario's if none.
            threads: all processors if none.
            first_step: steps that count as completed at the start: the clock begins there.
            outputs: also return the algebraic outputs.
            history: the past that delayed values read, of all trajectories, instead of what holds
                at the start. `states` (k, states) and `actions` (k, actions) are those of the last
                k steps before the start, each at the beginning of its step. With `times` (k,),
                which are below zero, they are at these times from the start. An action holds until
                the next time; states are cubic between the times.

        Raises:
            ValueError: an unknown name, a wrong shape, no finite number; the message names the
                argument.
        """
        return rollout(
            cast("Model", self),
            states,
            actions,
            parameters=parameters,
            discrete=discrete,
            disturbances=disturbances,
            seed=seed,
            method=method,
            threads=threads,
            first_step=first_step,
            outputs=outputs,
            history=history,
        )

    @listed
    def sensitivity(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        parameters: Iterable[str] = (),
        *,
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A control step with its exact derivatives by states, actions and the named parameters.

        Arguments and errors are those of `step`; `linearize_step` has derivatives of rewards and
        observations too.

        Returns:
            `(x_next, dx_dx, dx_du, dx_dp)` of shapes (n,), (n, n), (n, m) and (n, parameters), each
            with a leading axis N if `x` or `u` has points.
        """
        found = self.linearize_step(
            x, u, p, parameters=parameters, method=method, threads=threads, first_step=first_step
        )
        return found.states, found.dx_dx, found.dx_du, found.dx_dp

    @listed
    def linearize_step(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        by: Sequence[str] = ("state", "action"),
        parameters: Iterable[str] = (),
        discrete: Iterable[str] = (),
        disturbances: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> StepDerivatives:
        """A control step with the exact derivatives of states, rewards and observations.

        Updates and resets at sampling instants are part of the step, and so are events, by their
        jump conditions. A step that has no derivative is refused by the name of the event.

        Args:
            x, u, p, method, threads, first_step: as for `step`.
            by: `"state"`, `"action"`, or both: what else derivatives are taken by.
            parameters: names of parameters, whole arrays too.
            discrete: names of discrete variables, by whose values at the start derivatives are
                taken.
            disturbances: names of disturbances.

        Raises:
            ValueError: as for `step`.
            SimulationError: the step does not come to its end, or has no derivative.
        """
        return linearize_step(
            cast("Model", self),
            x,
            u,
            p,
            by=by,
            parameters=parameters,
            discrete=discrete,
            disturbances=disturbances,
            method=method,
            threads=threads,
            first_step=first_step,
        )

    def linearize_rollout(
        self,
        x: npt.ArrayLike,
        actions: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        by: Sequence[str] = ("state", "action"),
        parameters: Iterable[str] = (),
        discrete: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> StepDerivatives:
        """Control steps with the exact derivatives of states, rewards and observations after each.

        Derivatives include the memory of a model: dead times, discrete variables, earlier values.
        The past before the first step is that of a reset to `x`.

        Args:
            x: states at the start, (states,) or (N, states).
            actions: (H, actions) or (N, H, actions), physical units.
            p: parameters and discrete variables by name, as for `step`; disturbances with one value
                per step.
            by: `"state"`, `"action"`, or both. Columns of actions are those of the first step, then
                of the next.
            parameters, discrete, method, threads, first_step: as for `linearize_step`.

        Returns:
            `StepDerivatives` with an axis of H steps: `dx_du` has shape (H, states, H * actions).

        Raises:
            ValueError: as for `step`.
            SimulationError: a step does not come to its end, or has no derivative.

        Example:
            found = model.linearize_rollout(x, actions, parameters=["theta"])
            found.dx_dp[:, 0, 0]    # of the first state after each step by the dead time
        """
        return linearize_rollout(
            cast("Model", self),
            x,
            actions,
            p,
            by=by,
            parameters=parameters,
            discrete=discrete,
            method=method,
            threads=threads,
            first_step=first_step,
        )

    @listed
    def gradient(
        self,
        x: npt.ArrayLike,
        actions: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        reward: str | None = None,
        final: npt.ArrayLike | None = None,
        discount: float = 1.0,
        parameters: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> EpisodeGradient:
        """The value of an episode with its exact derivatives by start, actions and parameters.

        The value is the sum of the reward, each step's multiplied by another `discount`, and of
        `final` times the last states. Derivatives of the steps are accumulated backwards in time.

        Args:
            x: states at the start, (states,), or (N, states) for N episodes on all cores.
            actions: (steps, actions) or (N, steps, actions).
            p, method, threads, first_step: as for `step`, for all steps.
            reward: its name; the model's chosen one if none.
            final: what each of the last states is worth, (states,).
            discount: from 0 to 1.
            parameters: names of parameters, whole arrays too.

        Raises:
            ValueError: as for `step`; or the model remembers more than its states, so that an
                episode is not a chain of steps.
            SimulationError: the episode ends early, or a step has no derivative.
        """
        return gradient(
            cast("Model", self),
            x,
            actions,
            p,
            reward=reward,
            final=final,
            discount=discount,
            parameters=parameters,
            method=method,
            threads=threads,
            first_step=first_step,
        )
