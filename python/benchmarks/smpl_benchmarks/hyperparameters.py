"""Hyperparameters of the learners of this package, from mappings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, TypeVar

from smpl.support.arguments import as_count, check_names, check_numbers

Kind = TypeVar("Kind", bound="Checked")


@dataclass(frozen=True)
class Checked:
    """Hyperparameters with a default each; a subclass is a frozen dataclass.

    Attributes:
        NAME: the algorithm, for messages.
        COUNTS: names of those that are whole numbers above 0.
    """

    NAME: ClassVar[str]
    COUNTS: ClassVar[tuple[str, ...]]

    @classmethod
    def of(cls: type[Kind], given: Mapping[str, Any]) -> Kind:
        """From a mapping.

        Raises:
            ValueError: an unknown name or an invalid number.
        """
        check_names(cls.NAME, given, [one.name for one in fields(cls)])
        check_numbers(cls.NAME, given, {one.name: one.default for one in fields(cls)})
        for name in cls.COUNTS:
            as_count(name, given.get(name, 1))
        return cls(**given)
