"""Anything that chooses actions, behind one interface.

A controller (`action(env)`, `reset(env)` if it has a memory; physical units), a policy (`predict(observations)` as of
Stable-Baselines3 and d3rlpy, `compute_single_action(observation)` as of RLlib; actions of the action space) or a
function of the observation. Policies with `predict` and some of our own controllers act on a whole batch at once.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import inspect
import io
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import smpl.controllers as controllers
from smpl._arguments import FloatArray, as_vector
from smpl._identity import Description, describe
from smpl._optional import load
from smpl.controllers.adapt import check_spaces
from smpl.controllers.beer import profile_temperature
from smpl.controllers.reactor import SET_POINT, STEADY_ACTION
from smpl.envs import Env, Interface, native_seed
from smpl.model import Model

Array = npt.NDArray[Any]
# Endings of the files of policies.
FILES = (".zip", ".d3", ".pt")


@dataclass
class Rows:
    """What an agent sees of a batch: arrays have one row an environment.

    Attributes:
        interface: names, bounds and scaling, the same for all.
        observations: as the environments returned them.
        states: physical units.
        steps: completed steps of each episode.
        memory: per environment, what the agent keeps from step to step; emptied at each reset.
        places: of the rows in the batch `interface`; all of it if none.
    """

    interface: Interface
    observations: Array
    states: FloatArray
    steps: npt.NDArray[np.int64]
    memory: list[dict[str, Any]]
    places: npt.NDArray[np.intp] | None = None


class Agent:
    """A controller or policy by its name.

    Args:
        name: what reports and data sets call it.
        chooser: a controller, a policy or a function.
        physical: whether a function or policy gives physical units.

    Raises:
        TypeError: `chooser` is none of these.
    """

    def __init__(self, name: str, chooser: Any, physical: bool = False) -> None:
        self.name, self.chooser, self.physical = name, chooser, physical
        # Text and model that it was made from: in another process it is made anew, whatever it has built meanwhile.
        self.origin: tuple[str, Model] | None = None
        self.kind = _kind(chooser)
        self._state_aware = self.kind == "predict" and "episode_start" in _parameters(chooser.predict)

    def __reduce__(self) -> tuple[Any, ...]:
        if self.origin is not None:
            files = _files(self.origin[0])
            return (_unpacked, (*self.origin, self.name, files)) if files else (agent, (*self.origin, self.name))
        return Agent, (self.name, self.chooser, self.physical)

    @property
    def batched(self) -> bool:
        """Whether `act` is there."""
        return self.kind in ("predict", "rows") or type(self.chooser) in _BATCHED

    @property
    def reads_states(self) -> bool:
        """Whether `act` looks at the states of a batch, as far as one can tell."""
        return self.kind == "rows" or isinstance(self.chooser, controllers.Proportional)

    @property
    def asks_model(self) -> bool:
        """Whether `act` asks the environments of a batch, so that it knows nothing of recorded episodes."""
        return isinstance(self.chooser, (controllers.Policy, controllers.Nominal))

    def reset(self, env: Env) -> dict[str, Any]:
        """Begin an episode; returns an empty memory."""
        if self.kind == "action":
            forget = getattr(self.chooser, "reset", None)
            if forget is not None:
                forget(env)
        elif callable(getattr(self.chooser, "reset", None)) and self.kind == "call":
            self.chooser.reset()
        return {}

    def choose(self, env: Env, observation: Array, memory: dict[str, Any]) -> FloatArray:
        """Action for one environment, in its action space."""
        if self.kind == "action":
            given = as_vector("the controller's action", self.chooser.action(env), len(env.action_names))
            return env.from_physical(given)
        if self.kind == "call":
            return self._scaled(env, _one(self.chooser(observation), len(env.action_names)))
        if self.kind == "single":
            given = self.chooser.compute_single_action(observation, explore=False)
            return self._scaled(env, _one(given[0] if isinstance(given, tuple) else given, len(env.action_names)))
        if self.kind == "rows":
            return np.asarray(self.chooser.act(_one_row(env, observation, memory))[0])
        return self._scaled(env, self.predict(observation[None], [memory], len(env.action_names))[0])

    def act(self, rows: Rows) -> FloatArray:
        """Actions for a batch, in the action space, shape (environments, actions).

        Raises:
            ValueError: they have another shape.
        """
        expected = len(rows.steps), len(rows.interface.action_names)
        if self.kind == "predict":
            return self._scaled(rows.interface, self.predict(rows.observations, rows.memory, expected[1]))
        given = self.chooser.act(rows) if self.kind == "rows" else _BATCHED[type(self.chooser)](self.chooser, rows)
        actions = np.asarray(given, dtype=np.float64)
        if actions.shape != expected:
            raise ValueError(f"{self.name} gave actions of shape {actions.shape}, expected {expected}")
        return actions if self.kind == "rows" else rows.interface.from_physical(actions)

    def check(self, env: Env) -> None:
        """Refuse an environment that the agent is not for: reset once as an episode would.

        Raises:
            ValueError: a policy has other observations or actions than the environment.
        """
        if self.kind == "predict" and not self.physical:
            check_spaces(self.chooser, env.observation_space, env.action_space, env)
        elif self.kind == "rows" and callable(getattr(self.chooser, "check", None)):
            self.chooser.check(env)
        self.reset(env)

    def _scaled(self, interface: Interface, action: FloatArray) -> FloatArray:
        return interface.from_physical(action) if self.physical else action

    def predict(self, observations: Array, memory: list[dict[str, Any]], width: int) -> FloatArray:
        """What a policy's `predict` gives for a batch; its hidden state, if it has one, is kept in `memory`.

        Raises:
            ValueError: a wrong shape.
        """
        options: dict[str, Any] = {}
        if self._state_aware and any("state" in one for one in memory):
            shape = next(one["state"] for one in memory if "state" in one)
            states = [one.get("state") or [np.zeros_like(part) for part in shape] for one in memory]
            options["state"] = tuple(np.stack(parts, axis=-2) for parts in zip(*states, strict=True))
            options["episode_start"] = np.array(["state" not in one for one in memory])
        if "deterministic" in _parameters(self.chooser.predict):
            options["deterministic"] = True
        given = self.chooser.predict(observations, **options)
        if isinstance(given, tuple):
            given, state = given
            if state is not None:
                for i, one in enumerate(memory):
                    one["state"] = [part[..., i, :] for part in state]
        actions = np.asarray(given, dtype=np.float64)
        if actions.shape != (len(observations), width):
            raise ValueError(f"predict gave shape {actions.shape}, expected {(len(observations), width)}")
        return actions


def agent(spec: Any, model: Model, name: str | None = None) -> Agent:
    """An agent of a name, a file or an object.

    Args:
        spec: a name of `names(model)`; `constant:26.85,0.1` (physical units); `module:attribute`; a path of a policy
            file (`.zip` of Stable-Baselines3 as `PPO:policy.zip`, `.d3` of d3rlpy, `.pt` of TorchScript); an `Agent`;
            a controller, a policy or a function.
        model: of the environment that it is for.
        name: in place of the one that it would have.

    Raises:
        ValueError: a name that nobody has; the message lists the right ones.
        ImportError: a package is missing that the file or controller needs.
    """
    if isinstance(spec, Agent):
        return spec
    if not isinstance(spec, str):
        return Agent(name or type(spec).__name__, spec)
    if (named := re.match(r"([\w -]+)=(.+)", spec)) is not None:
        name, spec = name or named[1], named[2]
    made = Agent(name or _title(spec), _made(spec, model))
    made.origin = (spec, model)
    return made


def _files(spec: str) -> dict[str, bytes]:
    """The file of a policy and its formulation, for a machine that has them not; nothing for anything else."""
    file = Path(spec.rpartition(":")[2])
    if file.suffix not in FILES or not file.is_file():
        return {}
    from smpl.learning.saved import sidecars

    return {one.name: one.read_bytes() for one in (file, *sidecars(file)) if one.is_file()}


def _unpacked(spec: str, model: Model, name: str, files: Mapping[str, bytes]) -> Agent:
    """The agent of a policy whose files came along."""
    prefix, colon, file = spec.rpartition(":")
    with tempfile.TemporaryDirectory() as place:
        for one, content in files.items():
            (Path(place) / one).write_bytes(content)
        return agent(f"{prefix}{colon}{Path(place) / Path(file).name}", model, name)


def described(one: Agent) -> Description:
    """What a controller is, its settings and code included: results are not continued with other ones."""
    if one.origin is not None:
        file = Path(one.origin[0].rpartition(":")[2])
        if file.suffix in FILES and file.is_file():
            text = b"".join(_files(one.origin[0]).values())
            return {"": f"{type(one.chooser).__qualname__} {hashlib.sha256(text).hexdigest()}"}
    return {**describe(one.chooser), **({"physical": "True"} if one.physical else {})}


def _title(spec: str) -> str:
    """Name of a policy file without its folder and ending; of anything else the text itself."""
    file = Path(spec.rpartition(":")[2])
    return file.stem if file.suffix in FILES else spec


def _made(spec: str, model: Model) -> Any:
    known = _known(model)
    if spec in known:
        return known[spec]()
    if spec.startswith("constant:"):
        return controllers.Constant(_numbers(spec))
    if Path(spec.rpartition(":")[2]).suffix in FILES:
        from smpl.learning.saved import in_its_formulation

        return in_its_formulation(_policy_file(spec), Path(spec.rpartition(":")[2]), model)
    if ":" in spec:
        return _imported(spec)
    later = _baseline(model, spec)
    if later is not None:
        return later
    raise ValueError(
        f"controller is {spec!r}; {model.name} has: {', '.join(names(model))}; "
        "others: constant:NUMBER,..., MODULE:ATTRIBUTE, PPO:FILE.zip, FILE.d3, FILE.pt"
    )


def names(model: Model) -> tuple[str, ...]:
    """Names of the controllers for a model."""
    listed: Any = getattr(controllers, "baselines", None)
    try:
        more = listed(model.name) if listed is not None else ()
    except ValueError:  # a model that is not shipped has none
        more = ()
    return tuple(dict.fromkeys((*_known(model), *more)))


def _known(model: Model) -> dict[str, Callable[[], Any]]:
    """Controllers by name: those of every model, the baselines of this one, and the policies that it declares."""
    known: dict[str, Callable[[], Any]] = {"nominal": controllers.Nominal, "random": controllers.Uniform}
    if model.action_names == ("T_c", "q_out"):
        known |= {"pid": controllers.Proportional, "mpc": _reactor_mpc}
    if model.action_names == ("T",) and "S" in model.state_names:
        known |= {"profile": controllers.Profile, "isothermal": controllers.isothermal}
    for policy in model.policies:
        known.setdefault(policy, partial(controllers.Policy, policy))
    return known


def _reactor_mpc() -> Any:
    from smpl.controllers.reactor import ReactorNMPC

    return ReactorNMPC()


def _baseline(model: Model, name: str) -> Any:
    """What `smpl.controllers.baseline` has under a name, none if it has not."""
    baseline = getattr(controllers, "baseline", None)
    if baseline is None:
        return None
    try:
        return baseline(model.name, name)
    except (ValueError, KeyError):
        return None


def _policy_file(spec: str) -> Any:
    algorithm, _, file = spec.rpartition(":")
    if not Path(file).is_file():
        raise ValueError(f"policy file {file!r} is not there")
    if file.endswith(".zip"):
        return _stable_baselines(algorithm, file)
    if file.endswith(".d3"):
        d3rlpy = _needs("d3rlpy")
        with _of_file(file, "d3rlpy"):
            return d3rlpy.load_learnable(file)
    torch = _needs("torch")
    with of_torchscript(), _of_file(file, "TorchScript"):
        return _TorchPolicy(torch.jit.load(file).eval())


@contextlib.contextmanager
def _of_file(file: str, what: str) -> Iterator[None]:
    """Name the file where a package cannot read it, whatever it raises then."""
    try:
        yield
    except ImportError:
        raise
    except Exception as error:
        said = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ValueError(f"policy file {file!r} cannot be read as one of {what}: {said}") from error


@contextlib.contextmanager
def of_torchscript() -> Iterator[None]:
    """Without what torch says of the age of TorchScript: it is the form that each of the pinned versions reads."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`torch\.jit\.", FutureWarning)
        yield


def _stable_baselines(algorithm: str, file: str) -> Any:
    if not algorithm:
        raise ValueError(f"which algorithm made {file!r}? Write it before the file, as in PPO:{file}")
    _needs("stable_baselines3")
    for package in ("stable_baselines3", "sb3_contrib"):
        try:
            found = getattr(importlib.import_module(package), algorithm, None)
        except ImportError:
            continue
        if found is not None:
            with _of_file(file, algorithm):
                return found.load(file, device="cpu")
    raise ValueError(f"algorithm {algorithm!r} is none of stable-baselines3 or sb3-contrib (is that installed?)")


class _TorchPolicy:
    """A TorchScript module that maps a batch of observations to actions."""

    def __init__(self, module: Any) -> None:
        self._module = module

    def predict(self, observations: Array) -> Array:
        torch = importlib.import_module("torch")
        with torch.no_grad():
            return np.asarray(self._module(torch.as_tensor(observations)).numpy())


def _needs(module: str) -> Any:
    # The gym that d3rlpy imports, and Stable-Baselines3 where it is there, greets with a banner.
    with contextlib.redirect_stderr(io.StringIO()):
        return load(module, "this policy")


def _imported(spec: str) -> Any:
    module, _, attribute = spec.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"controller {spec!r} is not there: {error}") from error
    return found() if isinstance(found, type) else found


def _numbers(spec: str) -> list[float]:
    try:
        return [float(number) for number in spec.partition(":")[2].split(",")]
    except ValueError as error:
        raise ValueError(f"controller is {spec!r}, expected constant:NUMBER,NUMBER,...") from error


def _kind(chooser: Any) -> str:
    if not isinstance(chooser, type):
        if callable(getattr(chooser, "action", None)):
            return "action"
        if callable(getattr(chooser, "predict", None)):
            return "predict"
        if callable(getattr(chooser, "act", None)):
            return "rows"
        if callable(getattr(chooser, "compute_single_action", None)):
            return "single"
        if callable(chooser):
            return "call"
    what = f"the class {chooser.__name__}" if isinstance(chooser, type) else type(chooser).__name__
    raise TypeError(
        f"controller is {what}, expected an object with action(env) or predict(observations), or a function"
    )


def _parameters(function: Any) -> Mapping[str, Any]:
    try:
        return inspect.signature(function).parameters
    except (TypeError, ValueError):
        return {}


def _one_row(env: Env, observation: Array, memory: dict[str, Any]) -> Rows:
    return Rows(env, observation[None], env.state[None], np.array([env.steps]), [memory])


def _one(given: Any, length: int) -> FloatArray:
    return as_vector("the controller's action", np.ravel(given), length)


# Our own controllers on a batch: physical units, row by row what `action` gives.


def _proportional(controller: controllers.Proportional, rows: Rows) -> FloatArray:
    error = rows.states[:, [0, 2]] - SET_POINT[[0, 2]]
    return np.clip(STEADY_ACTION + controller._gains * error, rows.interface.action_low, rows.interface.action_high)


def _constant(controller: controllers.Constant, rows: Rows) -> FloatArray:
    return np.tile(controller._action, (len(rows.steps), 1))


def _profile(_: controllers.Profile, rows: Rows) -> FloatArray:
    return np.array([[profile_temperature(int(step))] for step in rows.steps])


def _uniform(controller: controllers.Uniform, rows: Rows) -> FloatArray:
    low, high = rows.interface.action_low, rows.interface.action_high
    for memory in rows.memory:
        if "generator" not in memory:
            # The first episode of a seed has the number 0.
            memory["generator"] = np.random.default_rng([controller._seed, native_seed(memory["seed"]), 0])
    return np.stack([memory["generator"].uniform(low, high) for memory in rows.memory])


def _policy(controller: controllers.Policy, rows: Rows) -> FloatArray:
    return _of_model(controller._name, rows)


def _nominal(_: controllers.Nominal, rows: Rows) -> FloatArray:
    return _of_model("nominal", rows)


def _of_model(policy: str, rows: Rows) -> FloatArray:
    """What a policy of the model chooses in the environments of the rows, as they stand."""
    batch: Any = rows.interface
    chosen: FloatArray = np.atleast_2d(batch.policy(policy))
    return chosen if rows.places is None else chosen[rows.places]


_BATCHED: dict[type, Callable[[Any, Rows], FloatArray]] = {
    controllers.Proportional: _proportional,
    controllers.Constant: _constant,
    controllers.Profile: _profile,
    controllers.Uniform: _uniform,
    controllers.Policy: _policy,
    controllers.Nominal: _nominal,
}
