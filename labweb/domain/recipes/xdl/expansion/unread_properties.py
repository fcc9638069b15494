"""A mapping that knows what nobody has asked it for: what a recipe says and nothing does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")


class Heeded(dict[str, T]):
    """Values by name, and which of them anybody has asked for."""

    def __init__(self, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._asked: set[str] = set()

    def __getitem__(self, name: str) -> T:
        self._asked.add(name)
        return super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        self._asked.add(str(name))
        return super().__contains__(name)

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 - as a dict has it
        """Return a value, and remember that it was asked for."""
        self._asked.add(name)
        return super().get(name, default)

    def unheeded(self) -> tuple[str, ...]:
        """Return the names that nobody has asked for by now."""
        return tuple(sorted(self.keys() - self._asked))
