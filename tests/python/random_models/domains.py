"""Finite volumes by the documented formulas: cells, faces, measures, fluxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .terms import Expr, Number, Scope, World, real

SCHEMES = ("upwind", "downwind", "central", "upwind2", "limited")
GEOMETRIES = {"planar": (1, 1.0), "cylindrical": (2, np.pi), "spherical": (3, 4 * np.pi / 3)}


@dataclass(frozen=True)
class Domain:
    """A row of `cells` equal cells from 0 to the parameter `length`."""

    name: str
    cells: int
    length: str
    scheme: str
    geometry: str

    def edge(self, world: World, face: float) -> Number:
        return world.get((self.length, ())) * face / self.cells

    def measure(self, world: World, cell: int) -> Number:
        power, factor = GEOMETRIES[self.geometry]
        return factor * (self.edge(world, cell) ** power - self.edge(world, cell - 1) ** power)

    def area(self, world: World, face: int) -> Number:
        power, factor = GEOMETRIES[self.geometry]
        return factor * power * self.edge(world, face) ** (power - 1)

    def at_face(self, face: int, cells: Sequence[Number], forward: bool = True) -> Number:
        """The value at a face, at an end that of the last cell. `forward`: the flow goes up."""
        if face in (0, self.cells):
            return cells[0] if face == 0 else cells[-1]
        low, high = cells[face - 1], cells[face]
        if self.scheme in ("downwind", "central"):
            return high if self.scheme == "downwind" else (low + high) / 2
        # Cells in the direction of the flow, the last one behind the face.
        behind, ahead = (cells[:face], high) if forward else (cells[: face - 1 : -1], low)
        near = behind[-1]
        if self.scheme == "upwind" or len(behind) == 1:
            return near
        before, after = near - behind[-2], ahead - near
        if self.scheme == "upwind2":
            return near + before / 2
        return near + before * after / (before + after) if real(before) * real(after) > 0 else near

    @property
    def directed(self) -> bool:
        """True if the scheme follows the flow."""
        return self.scheme in ("upwind", "upwind2", "limited")


@dataclass(frozen=True)
class Field:
    """A declared name and what its indices run over: domains by name, `i` for the species."""

    name: str
    axes: tuple[str, ...]


@dataclass(frozen=True)
class Flux:
    field: Field
    inside: Expr
    ends: tuple[Expr | None, Expr | None]

    def value(self, world: World, scope: Scope, domain: Domain, face: int) -> Number:
        end = self.ends[0] if face == 0 else self.ends[1] if face == domain.cells else None
        return (end or self.inside).value(world, {**scope, domain.name: face})
