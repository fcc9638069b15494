"""Collects what is wrong with a recipe, each finding with its place."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from labweb.domain.errors import Finding
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace


class Findings:
    """All that is wrong so far, in the order in which it was met."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def tell(self, code: str, message: str, place: FilePlace, **facts: object) -> None:
        """Add one finding; `facts` are what its message says, for programs."""
        context: dict[str, object] = {"path": place.path} if place.path else {}
        if place.line:
            context = {"line": place.line, "column": place.column}
        self.all.append(Finding(code, message, str(place), context | facts))


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint at the known name that looks most like this one, "" when none does."""
    near = get_close_matches(name[:80], list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
