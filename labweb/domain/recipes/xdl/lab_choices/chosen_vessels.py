"""Which vessels the plan of a rig took where a recipe names none: wastes and spare flasks.

The plan knows what each waste takes and which flasks are empty, so a workflow of the same recipe
takes the same ones, at each place of the recipe in the order in which the plan came there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace

Row = Mapping[str, Any]
"""`line` and `column` of the recipe, `stands_for` (`@waste`, `@buffer`, `@kept`), and `key`."""


@dataclass(frozen=True, slots=True)
class OnRig:
    """What a proved plan says of the rig that a workflow is for."""

    unstirred: frozenset[str] = frozenset()
    """Keys of vessels that nothing stirs there: the plan does without."""

    chosen: tuple[Row, ...] = ()


class Chosen:
    """What a plan has chosen; every choice is taken once."""

    def __init__(self, rig: OnRig | None) -> None:
        """Read the rows of a plan; None: there is no plan, and nothing was chosen."""
        self.is_planned = rig is not None
        self._left: dict[tuple[int, int, str], deque[str]] = {}
        for row in () if rig is None else rig.chosen:
            at = (row.get("line", 0), row.get("column", 0), row["stands_for"])
            self._left.setdefault(at, deque()).append(row["key"])

    def take(self, place: FilePlace, name: str) -> str:
        """Return the key of the next vessel that stands for a name at a place; "": none."""
        left = self._left.get((place.line, place.column, name))
        return left.popleft() if left else ""
