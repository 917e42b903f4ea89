"""Pictures and text of an episode; the drawing is that of the command line."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl import _native

if TYPE_CHECKING:
    from collections.abc import Sequence

    from smpl.envs import Env

Pixels = npt.NDArray[np.uint8]
_MOST_LINES = 12


class History:
    """Record of an environment since its last reset, kept only for rendering."""

    def __init__(self, env: Env) -> None:
        self._env = env
        self._recording: _native.Recording | None = None
        self.rewards: list[float] = []
        self.end = ""
        self.phase = ""

    def start(self) -> None:
        """Forget the last episode and record the first state."""
        self._recording = _native.Recording(self._env.native)
        self.rewards, self.end, self.phase = [], "", ""

    def add(self, result: tuple[Any, ...]) -> None:
        """Record a step."""
        if self._recording is None:
            return
        self._recording.add(self._env.native)
        _, reward, terminated, truncated, info = result
        self.rewards.append(float(reward))
        self.phase = info.get("phase", "")
        if terminated or truncated:
            self.end = info["failure"] or ("success" if info["success"] else "time limit")

    def go_back(self) -> None:
        """The environment has returned to a snapshot: what was recorded after it goes."""
        if self._recording is not None and not self._recording.go_back(self._env.native):
            self._recording = None  # a point of another episode
        self.rewards, self.end = self.rewards[: self._env.steps], ""

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_recording": None}  # another process draws from its next reset on

    def __deepcopy__(self, memo: dict[int, Any]) -> History:
        twin = History(memo.get(id(self._env), self._env))
        memo[id(self)] = twin
        twin._recording = copy.copy(self._recording)
        twin.rewards, twin.end, twin.phase = list(self.rewards), self.end, self.phase
        return twin

    @property
    def is_recorded(self) -> bool:
        """True if there is an episode to draw."""
        return self._recording is not None

    @property
    def recording(self) -> _native.Recording:
        """The rows so far.

        Raises:
            ValueError: there is no episode.
        """
        if self._recording is None:
            raise ValueError("there is no episode to draw: call reset first (after restore, too)")
        return self._recording

    def render(self, mode: str | None) -> Pixels | str:
        """The episode as a picture (`rgb_array`) or as text (`ansi`)."""
        return self.text() if mode == "ansi" else self.picture().rgb()

    def picture(self, show: Sequence[str] = ()) -> _native.Picture:
        """The picture of what `show` names."""
        return self.recording.picture(list(show), self._note())

    def _note(self) -> str:
        env = self._env
        parts = [f"step {len(self.rewards)}, time {env.time:g} {env.model.time_unit}"]
        if self.rewards:
            parts.append(f"sum of {env.model.reward} = {sum(self.rewards):.6g}")
        return "; ".join(part for part in (*parts, self.phase, self.end) if part)

    def text(self) -> str:
        """One line a quantity."""
        env = self._env
        head = f"{env.model.name}  step {len(self.rewards)}  time {env.time:g} {env.model.time_unit}"
        lines = ["  ".join(part for part in (head, self.phase, self.end) if part)]
        states = env.state.tolist()[:_MOST_LINES]
        for name, unit, value in zip(env.state_names, env.state_units, states, strict=False):
            lines.append(f"  {name:24} {value: .6g} {unit}")
        if self.rewards:
            actions = env.action.tolist()[:_MOST_LINES]
            for name, unit, value in zip(env.action_names, env.action_units, actions, strict=False):
                lines.append(f"  {name:24} {value: .6g} {unit}  (action)")
            lines.append(f"  {env.model.reward:24} {self.rewards[-1]: .6g}  (sum {sum(self.rewards):.6g})")
        return "\n".join(lines)
