"""CasADi functions that know nominal values: what a call leaves out is taken from them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from smpl.export.modules import CasadiModel

# Elements of c that are the same in every step of an episode at nominal parameters.
_CONSTANT = ("steady(", "step_length")


@lru_cache(maxsize=1)
def _function_class() -> type[Any]:
    """The class, made when CasADi is there."""
    import casadi as ca

    class ModelFunction(ca.Function):
        """A function of a model.

        Calls by position may omit `z` if the model has no algebraic variables, `c` if only its
        constants are read, and `p`. `p` may also be a mapping from names to values that replace
        nominal ones. In everything else it is a function as any other.
        """

        def __init__(self, function: Any, model: CasadiModel) -> None:
            super().__init__(function)
            self._model = model

        def __call__(self, *arguments: Any, **named: Any) -> Any:
            return super().__call__(*(arguments if named else completed(self, self._model, arguments)), **named)

    return ModelFunction


def completing(function: Any, model: CasadiModel) -> Any:
    """The function with nominal values for what calls leave out."""
    return None if function is None else _function_class()(function, model)


def completed(function: Any, model: CasadiModel, arguments: tuple[Any, ...]) -> list[Any]:
    """The arguments of a call with those that were left out.

    Raises:
        TypeError: too few or too many, or `c` is left out and holds what changes from step to step.
    """
    names, given = function.name_in(), list(arguments)
    if "z" in names and not model.algebraic_names:
        at = names.index("z")
        if len(given) < len(names) and not (len(given) > at and _is_empty(given[at])):
            given.insert(at, [])
    if "p" in names and len(given) == names.index("p"):
        given.append(model.parameters())
    if "c" in names and len(given) == names.index("c"):
        given.append(_constants(function, model))
    if len(given) != len(names):
        expected = ", ".join(names)
        raise TypeError(f"{function.name()}({expected}) was called with {len(arguments)} arguments")
    return [model.parameters(value) if isinstance(value, Mapping) else value for value in given]


def _is_empty(value: Any) -> bool:
    size = getattr(value, "numel", None)
    return (size() if size else len(value) if hasattr(value, "__len__") else 1) == 0


def _constants(function: Any, model: CasadiModel) -> Any:
    """The vector c of a function that reads only constants of it."""
    at = function.name_in().index("c")
    names = model.context_names
    read = {names[k] for i in range(function.n_out()) for k in _columns(function.jac_sparsity(i, at))}
    changing = sorted(name for name in read if not name.startswith(_CONSTANT))
    if changing:
        shown = ", ".join(changing[:6]) + (", ..." if len(changing) > 6 else "")
        raise TypeError(f"{function.name()} needs c, for it reads {shown}: give context({{name: value}})")
    return model.context()


def _columns(sparsity: Any) -> set[int]:
    """Columns that hold something."""
    starts = sparsity.colind()
    return {k for k in range(sparsity.size2()) if starts[k + 1] > starts[k]}
