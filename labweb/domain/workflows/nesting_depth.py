"""How deep, wide and long the parts of a workflow may be, asked before they are walked through."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from labweb.domain.errors import Finding

DEEPEST = 8
LONGEST_TEXT = 1000
MOST_ITEMS = 200


def check_depth(value: object) -> Finding | None:
    """Refuse what is nested too deep or too wide before anything walks through it."""
    level: list[object] = [value]
    # The head, its lists, their entries and those entries' params come before any argument.
    for _ in range(DEEPEST + 4):
        level = [child for parent in level for child in _children(parent)]
        if not level:
            return None
    return Finding(
        "protocol.too_deep",
        f"arguments are nested deeper than {DEEPEST} levels",
        "",
        {"field": "steps"},
    )


def _children(value: object) -> list[object]:
    if isinstance(value, Mapping):
        return list(value.values())
    return list(value) if isinstance(value, list | tuple) else []


def arguments_problem(value: object) -> tuple[str, str] | None:
    """Return the code and the reason for which no device could be told this; None: it could."""
    if not isinstance(value, Mapping):
        return _wrong("protocol.not_object", "arguments are an object")
    stack: list[object] = [value]
    while stack:
        item = stack.pop()
        children = _children(item)
        if len(children) > MOST_ITEMS:
            return _wrong(
                "protocol.too_long", f"arguments have at most {MOST_ITEMS} items on a level"
            )
        if isinstance(item, int | float) and not abs(item) <= sys.float_info.max:
            return _wrong("protocol.not_finite", f"{item!r:.40} is no number a device can be told")
        if isinstance(item, str) and len(item) > LONGEST_TEXT:
            return _wrong(
                "protocol.too_long", f"a text in arguments is longer than {LONGEST_TEXT} characters"
            )
        if isinstance(item, Mapping) and not all(isinstance(key, str) for key in item):
            return _wrong("protocol.bad_name", "names of arguments are text")
        stack += children
    return None


def _wrong(code: str, message: str) -> tuple[str, str]:
    return code, message
