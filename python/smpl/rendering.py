"""Pictures and text of an episode.

With matplotlib (extra `plot`) a picture has axes and names; without it the curves are drawn alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl._native import SimulationError

if TYPE_CHECKING:
    from smpl.envs import Env

Picture = npt.NDArray[np.uint8]
_MOST_PANELS = 12
_COLOURS = ((31, 119, 180), (214, 39, 40), (44, 160, 44))


@dataclass(frozen=True)
class Panel:
    """One curve over time with its bounds and set-point."""

    title: str
    times: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]
    low: float
    high: float
    target: float | None
    held: bool
    colour: tuple[int, int, int]


class History:
    """What an environment went through since its last reset, recorded only where it is to be rendered."""

    def __init__(self, env: Env) -> None:
        self._env = env
        self.times: list[float] = []
        self.states: list[npt.NDArray[np.float64]] = []
        self.actions: list[npt.NDArray[np.float64]] = []
        self.rewards: list[float] = []
        self.end = ""
        self.phase = ""

    def start(self) -> None:
        """Forget the last episode and record the first state."""
        self.times, self.states, self.actions, self.rewards = [self._env.time], [self._env.state], [], []
        self.end, self.phase = "", ""

    def add(self, action: npt.NDArray[np.float64], result: tuple[Any, ...]) -> None:
        """Record a step."""
        _, reward, terminated, truncated, info = result
        self.times.append(self._env.time)
        self.states.append(self._env.state)
        self.actions.append(self._env.to_physical(action))
        self.rewards.append(float(reward))
        self.phase = info.get("phase", "")
        if terminated or truncated:
            self.end = info["failure"] or ("success" if info["success"] else "time limit")

    def render(self, mode: str | None) -> Picture | str:
        """The episode as a picture (`rgb_array`) or as text (`ansi`)."""
        return self.text() if mode == "ansi" else self.picture()

    def text(self) -> str:
        """One line a quantity."""
        env = self._env
        head = f"{env.model.name}  step {len(self.actions)}  time {env.time:g} {env.model.time_unit}"
        lines = ["  ".join(part for part in (head, self.phase, self.end) if part)]
        for name, unit, value in zip(env.state_names, env.state_units, self._last(self.states), strict=False):
            lines.append(f"  {name:24} {value: .6g} {unit}")
        for name, unit, value in zip(env.action_names, env.action_units, self._last(self.actions), strict=False):
            lines.append(f"  {name:24} {value: .6g} {unit}  (action)")
        if self.rewards:
            lines.append(f"  {env.model.reward:24} {self.rewards[-1]: .6g}  (sum {sum(self.rewards):.6g})")
        return "\n".join(lines)

    def picture(self) -> Picture:
        """The curves of states, actions and the reward."""
        panels = self._panels()
        try:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure
        except ImportError:
            return draw(panels)
        columns = 3 if len(panels) > 4 else 2
        rows = -(-len(panels) // columns)
        figure = Figure(figsize=(3.2 * columns, 2.0 * rows + 0.3), dpi=100, layout="constrained")
        canvas: Any = FigureCanvasAgg(figure)
        title = f"{self._env.model.name}, time in {self._env.model.time_unit}"
        title += f", {self.phase}" if self.phase else ""
        figure.suptitle(f"{title}: {self.end}" if self.end else title, fontsize=9)
        for index, panel in enumerate(panels):
            _plot(figure.add_subplot(rows, columns, index + 1), panel)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[:, :, :3].copy()

    @staticmethod
    def _last(values: Sequence[npt.NDArray[np.float64]]) -> list[float]:
        return values[-1].tolist()[:_MOST_PANELS] if values else []

    def _panels(self) -> list[Panel]:
        env = self._env
        times = np.asarray(self.times)
        low, high = env.model.native.bounds("state")
        try:
            targets = env.steady_state
        except SimulationError:  # declared without a solution, and not needed
            targets = None
        states = np.asarray(self.states)
        most = max(1, _MOST_PANELS - len(env.action_names) - 1)
        panels = [
            Panel(
                f"{name} [{env.state_units[i]}]",
                times,
                states[:, i],
                float(low[i]),
                float(high[i]),
                None if targets is None else float(targets[i]),
                held=False,
                colour=_COLOURS[0],
            )
            for i, name in enumerate(env.state_names[:most])
        ]
        actions = np.asarray(self.actions).reshape(-1, len(env.action_names))
        for i, name in enumerate(env.action_names[: _MOST_PANELS - len(panels) - 1]):
            bounds = float(env.action_low[i]), float(env.action_high[i])
            title = f"{name} [{env.action_units[i]}]"
            panels.append(Panel(title, times[1:], actions[:, i], *bounds, None, held=True, colour=_COLOURS[1]))
        rewards = np.asarray(self.rewards)
        panels.append(
            Panel(env.model.reward, times[1:], rewards, -np.inf, np.inf, None, held=False, colour=_COLOURS[2])
        )
        return panels


def _plot(axes: Any, panel: Panel) -> None:
    """Draw a panel into matplotlib axes; bounds only where they are near enough to leave the curve readable."""
    style = {
        "color": tuple(c / 255 for c in panel.colour),
        "linewidth": 1.2,
        "marker": "." if len(panel.times) < 3 else None,
    }
    if panel.held:
        axes.step(panel.times, panel.values, where="pre", **style)
    else:
        axes.plot(panel.times, panel.values, **style)
    for bound in (panel.low, panel.high):
        if np.isfinite(bound):
            axes.axhline(bound, color="0.7", linewidth=0.8, linestyle=":")
    axes.set_ylim(*_limits(panel))
    if panel.target is not None:
        axes.axhline(panel.target, color="0.4", linewidth=0.8, linestyle="--")
    axes.set_title(panel.title, fontsize=8)
    axes.tick_params(labelsize=7)


def _limits(panel: Panel) -> tuple[float | None, float | None]:
    """Vertical limits that show the curve, but no more than half a range beyond the bounds."""
    values = panel.values[np.isfinite(panel.values)]
    if values.size == 0 or not np.isfinite(panel.high - panel.low):
        return None, None
    reach = 0.5 * (panel.high - panel.low)
    marks = [*values.tolist(), *([] if panel.target is None else [panel.target])]
    bottom, top = max(min(marks), panel.low - reach), min(max(marks), panel.high + reach)
    margin = 0.05 * ((top - bottom) or (panel.high - panel.low))
    return bottom - margin, top + margin


def draw(panels: Sequence[Panel], width: int = 240, height: int = 120) -> Picture:
    """The panels side by side without axes: frames, bounds, set-points and curves.

    Returns:
        An array of shape (rows * height, columns * width, 3).
    """
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    picture = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        _draw_panel(picture[row * height : (row + 1) * height, column * width : (column + 1) * width], panel)
    return picture


def _draw_panel(area: Picture, panel: Panel) -> None:
    height, width = area.shape[:2]
    margin = 6
    area[margin:-margin, [margin, -margin]] = 200
    area[[margin, -margin], margin:-margin] = 200
    values = panel.values[np.isfinite(panel.values)]
    if values.size == 0:
        return
    marks = [x for x in (panel.low, panel.high, panel.target) if x is not None and np.isfinite(x)]
    bottom, top = min([*marks, values.min()]), max([*marks, values.max()])
    span = (top - bottom) or 1.0

    def rows(x: npt.ArrayLike) -> npt.NDArray[np.int64]:
        fraction = (np.nan_to_num(np.asarray(x, dtype=np.float64), nan=bottom) - bottom) / span
        return (height - 2 * margin - 1 - np.clip(fraction, 0, 1) * (height - 3 * margin)).astype(np.int64)

    for mark in marks:
        area[rows(mark), margin : width - margin : 3] = 160
    across = np.linspace(0, max(len(panel.values) - 1, 0), width - 3 * margin)
    positions = np.arange(len(panel.values), dtype=np.float64)
    heights = rows(np.interp(across, positions, np.nan_to_num(panel.values, nan=bottom)))
    before = np.concatenate([heights[:1], heights[:-1]])
    for column, (y, y_before) in enumerate(zip(heights, before, strict=True)):
        area[min(y, y_before) : max(y, y_before) + 2, column + margin] = panel.colour
