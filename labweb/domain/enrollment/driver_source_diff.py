"""What differs between the texts of two versions of a driver."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import SequenceMatcher
from typing import Literal

import msgspec

from labweb.domain.errors import DefinitionError

CONTEXT_LINES = 3
MOST_LINES = 20_000
"""Longest texts that are compared: above, the time is no longer that of a page."""

Sign = Literal["", "-", "+"]


class ChangedLine(msgspec.Struct, frozen=True):
    """One line of a comparison."""

    sign: Sign
    """`-` only before, `+` only after, "" the same in both."""

    before: int | None
    """Its number before, from 1."""

    after: int | None
    text: str


class ModuleChange(msgspec.Struct, frozen=True):
    """One module that is not the same in both versions."""

    module: str
    is_new: bool
    is_gone: bool
    removed_count: int
    added_count: int
    hunks: tuple[tuple[ChangedLine, ...], ...]
    """Places that differ, each with the lines around it."""


def compare(before: Mapping[str, str], after: Mapping[str, str]) -> list[ModuleChange]:
    r"""List the modules that differ, line by line.

    Raises:
        DefinitionError: The texts are too long to be compared.

    Example:
        >>> (found,) = compare({"a": "x = 1\n"}, {"a": "x = 2\n"})
        >>> [(line.sign, line.text) for line in found.hunks[0]]
        [('-', 'x = 1'), ('+', 'x = 2')]
    """
    length = sum(text.count("\n") for texts in (before, after) for text in texts.values())
    if length > MOST_LINES:
        text = f"the versions have {length} lines together; {MOST_LINES} are compared at most"
        raise DefinitionError(text, code="driver.too_long")
    names = sorted(before.keys() | after.keys())
    return [
        _compare(name, before.get(name), after.get(name))
        for name in names
        if before.get(name) != after.get(name)
    ]


def _compare(module: str, before: str | None, after: str | None) -> ModuleChange:
    old, new = _lines(before), _lines(after)
    groups = SequenceMatcher(None, old, new).get_grouped_opcodes(CONTEXT_LINES)
    hunks = tuple(tuple(_hunk(group, old, new)) for group in groups)
    signs = [line.sign for hunk in hunks for line in hunk]
    return ModuleChange(
        module=module,
        is_new=before is None,
        is_gone=after is None,
        removed_count=signs.count("-"),
        added_count=signs.count("+"),
        hunks=hunks,
    )


def _lines(text: str | None) -> list[str]:
    """Split at line feeds alone, as Python counts lines; a missing end is a difference."""
    if not text:
        return []
    *lines, last = text.split("\n")
    return [*lines, f"{last}\\ no line feed at the end"] if last else lines


def _hunk(
    group: list[tuple[str, int, int, int, int]], old: list[str], new: list[str]
) -> list[ChangedLine]:
    lines: list[ChangedLine] = []
    for tag, old_from, old_to, new_from, new_to in group:
        if tag == "equal":
            both = zip(range(old_from, old_to), range(new_from, new_to), strict=True)
            lines += [ChangedLine("", at + 1, to + 1, old[at]) for at, to in both]
            continue
        lines += [ChangedLine("-", at + 1, None, old[at]) for at in range(old_from, old_to)]
        lines += [ChangedLine("+", None, at + 1, new[at]) for at in range(new_from, new_to)]
    return lines
